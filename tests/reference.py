"""What tests share: the motion of a top by Taylor series in integers, which no closed form uses, and distances."""

import math
from fractions import Fraction

import numpy as np
from mpmath import mp, mpf
from mpmath.libmp import to_rational

from lagrange_bench.integrators.truth.rigid_body import solve


def flows(alpha, y, times, digits=40, k=0.0):
    """States at `times`, monotone from 0, in V = k x3²/2, by Taylor series in integers."""
    J, x = (math.hypot(*map(float, part)) for part in (y[:3], y[3:]))
    rate = Fraction(J + math.sqrt(abs(float(alpha))) * math.sqrt(x) + math.sqrt(abs(float(k))) * x) or Fraction(1)
    unit = (-1 if times[-1] < 0 else 1) / rate
    alpha, k, *y = map(exactly, (alpha, k, *y))
    force = [(-alpha * unit, 4), (-k * unit, 5, 4)], [(alpha * unit, 3), (k * unit, 5, 3)], []
    moves = [[(unit, i, 3 + j), (-unit, j, 3 + i)] for i, j in ((1, 2), (2, 0), (0, 1))]
    bits = int(3.33 * digits) + 60
    found = solve([*force, *moves], y, [exactly(t) / unit for t in times], bits)
    with mp.workprec(bits + 60):
        return np.array([[mpf(v.numerator) / v.denominator for v in state] for state in found], dtype=object)


def exactly(v):
    """A number as a fraction."""
    return Fraction(*to_rational(v._mpf_)) if isinstance(v, mpf) else Fraction(float(v))


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
