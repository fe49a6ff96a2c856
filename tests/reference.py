"""An independent integrator for the tests: Taylor series of the equations of motion in integers. No method of the bench."""

import math
from fractions import Fraction
from operator import mul

import numpy as np
from mpmath import mp, mpf
from mpmath.libmp import to_rational

from lagrange_bench import Problem


def free_body(*moments):
    """Euler's free body: its angular momentum in the frame of the body."""
    hamiltonian = lambda t, y, p: (y[0] * y[0] / p[0] + y[1] * y[1] / p[1] + y[2] * y[2] / p[2]) / 2.0  # noqa: E731
    return Problem("free_body", "so3", hamiltonian, moments, frame="body")


def flows(alpha, y, times, digits=40, k=0.0):
    """States at `times`, monotone from 0, in V = k x3²/2; numbers are multiples of 2^-bits.

    Eight steps to the unit 1/(|J| + √(|alpha||x|) + √|k| |x|).
    """
    bits = int(3.33 * digits) + 60
    J, x = (math.hypot(*map(float, part)) for part in (y[:3], y[3:]))
    rate = Fraction(J + math.sqrt(abs(float(alpha))) * math.sqrt(x) + math.sqrt(abs(float(k))) * x)
    alpha, k, *y = (_fixed(exactly(v), bits) for v in (alpha, k, *y))
    now, states = Fraction(0), []
    for t in map(exactly, times):
        steps = math.ceil(8 * rate * abs(t - now)) or 1
        h, now = _fixed((t - now) / steps, bits), t
        for _ in range(steps):
            y = _step(alpha, k, y, h, bits)
        with mp.workprec(bits + 60):
            states.append([mp.ldexp(mpf(v), -bits) for v in y])
    return np.array(states, dtype=object)


def exactly(v):
    """A number as a fraction."""
    return Fraction(*to_rational(v._mpf_)) if isinstance(v, mpf) else Fraction(float(v))


def _fixed(q, bits):
    return (q.numerator << bits) // q.denominator


def _step(alpha, k, y, h, bits):
    """The terms of order n + 1 from those up to n, with h^n in them, until they vanish."""
    J1, J2, J3, x1, x2, x3 = series = [[v] for v in y]
    force = []  # alpha + k x3
    n = 0
    while n == 0 or any(c[-1] or c[-2] for c in series):

        def product(a, b):
            return sum(map(mul, a, reversed(b)))

        force.append((k * x3[n] >> bits) + (0 if n else alpha))
        rates = (
            -product(force, x2),
            product(force, x1),
            0,
            product(J2, x3) - product(J3, x2),
            product(J3, x1) - product(J1, x3),
            product(J1, x2) - product(J2, x1),
        )
        n += 1
        new = [(r * h >> 2 * bits) // n for r in rates]
        new = [0 if v == -1 else v for v in new]  # rounding is downwards: -1 would never vanish
        for c, v in zip(series, new, strict=True):
            c.append(v)
    return [sum(c) for c in series]


def real(z):
    """The number that is the sum of two doubles."""
    return mpf(z[0]) + mpf(z[1])


def turned(c, s, y):
    """(J, x) turned about e3 by the angle with cosine c and sine s."""
    J1, J2, J3, x1, x2, x3 = y
    return [c * J1 - s * J2, s * J1 + c * J2, J3, c * x1 - s * x2, s * x1 + c * x2, x3]


def largest(a):
    """The largest |entry|; NaN if one is NaN or infinite, which `max` may drop: every comparison with NaN is false."""
    sizes = [abs(v) for v in np.asarray(a).ravel()]
    return max(sizes, default=0) if all(size < math.inf for size in sizes) else math.nan


def as_mpf(a):
    """An array of mpf."""
    return np.vectorize(mpf, otypes=[object])(np.asarray(a, dtype=object))


def drift(problem, y0, y):
    """How far the invariants of states are from those of y0, relative to their scales."""
    return np.abs(problem.invariants(y) - problem.invariants(y0)) / problem.invariant_scales(y0)


def errors(problem, y0, y, truth):
    """The largest error of each state, or of one, in the scales of J and x."""
    rate, size, _ = problem.scales(y0)
    with mp.workdps(130):
        off = (as_mpf(y) - as_mpf(truth)) / np.repeat((mpf(rate or 1.0), mpf(size)), 3)
        return [float(largest(row)) for row in np.atleast_2d(off)]
