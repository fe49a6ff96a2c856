"""An independent integrator for the tests: Taylor series of the equations of motion in mpmath. No method of the bench."""

import math

import numpy as np
from mpmath import mp, mpf


def flow(alpha, y, t, digits=40):
    """State at time t from doubles taken as exact, as six mpf; Taylor series, eight steps to the unit 1/(|J| + √(|alpha||x|))."""
    with mp.workdps(digits + 10):
        alpha, y, t = mpf(alpha), [mpf(v) for v in y], mpf(t)
        rate = mp.sqrt(sum(v * v for v in y[:3])) + mp.sqrt(abs(alpha) * mp.sqrt(sum(v * v for v in y[3:])))
        steps = int(mp.ceil(abs(t) * rate * 8)) or 1
        h = t / steps
        for _ in range(steps):
            y = _step(alpha, y, h, order=digits + 8)
        return y


def _step(alpha, y, h, order):
    c = [[v] for v in y]
    for k in range(order):

        def product(i, j, k=k):
            return mp.fdot(c[i][: k + 1], c[j][k::-1])

        rates = (
            -alpha * c[4][k],
            alpha * c[3][k],
            mpf(0),
            product(1, 5) - product(2, 4),
            product(2, 3) - product(0, 5),
            product(0, 4) - product(1, 3),
        )
        for series, rate in zip(c, rates, strict=True):
            series.append(rate / (k + 1))
    return [horner(series, h) for series in c]


def horner(coefficients, u):
    """Polynomial by ascending coefficients."""
    value = mpf(0)
    for c in reversed(coefficients):
        value = value * u + c
    return value


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
