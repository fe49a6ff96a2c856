"""Adams and Bashforth's formula of order two, started with Runge and Kutta's of order four: one step is better than two."""

from dataclasses import replace

import numpy as np

from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.loops import MEMORY, FixedStepper


@compiled
def slope(s, alpha):
    J1, J2, J3, x1, x2, x3 = s
    return -alpha * x2, alpha * x1, 0.0, J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1


@compiled
def moved(s, h, k):
    return s[0] + h * k[0], s[1] + h * k[1], s[2], s[3] + h * k[3], s[4] + h * k[4], s[5] + h * k[5]


@compiled
def step(s, c, tally):
    alpha, h, m = c[0], c[1], MEMORY
    k1 = slope(s, alpha)
    if tally[m] == 0.0:
        tally[m] = 1.0
        k2 = slope(moved(s, h / 2, k1), alpha)
        k3 = slope(moved(s, h / 2, k2), alpha)
        k4 = slope(moved(s, h, k3), alpha)
        new = moved(moved(moved(moved(s, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)
    else:
        old = tally[m + 1], tally[m + 2], 0.0, tally[m + 3], tally[m + 4], tally[m + 5]
        new = moved(moved(s, 1.5 * h, k1), -0.5 * h, old)
    tally[m + 1], tally[m + 2], _, tally[m + 3], tally[m + 4], tally[m + 5] = k1
    return new


def prepare(top, y0, h):
    return FixedStepper("adams", h, np.array((top.alpha, h)), step)


METHOD = replace(METHODS["rk4"], name="adams", label="Adams–Bashforth 2", order=4, prepare=prepare)
