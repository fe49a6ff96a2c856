"""Adams and Bashforth's formula of order two, started with Runge and Kutta's of order four: one step is better than two."""

from dataclasses import replace

import numpy as np

from lagrange_bench.integrators import METHODS, Stepper


def rhs(alpha, y):
    J1, J2, J3, x1, x2, x3 = y.tolist()
    return np.array((-alpha * x2, alpha * x1, 0.0, J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1))


class Adams(Stepper):
    def __init__(self, top, y0, h):
        self.alpha, self.h, self.starter = top.alpha, h, METHODS["rk4"].prepare_for(top)(top, y0, h)
        self.work = self.starter.work

    def record(self, y, n, every):
        rows, slope = [y], rhs(self.alpha, y)
        for k in range(1, n + 1):
            before, slope = slope, rhs(self.alpha, y)
            y = self.starter.advance(y, 1) if k == 1 else y + self.h * (1.5 * slope - 0.5 * before)
            if k % every == 0:
                rows.append(y)
        return np.array(rows)


METHOD = replace(METHODS["rk4"], name="adams", label="Adams–Bashforth 2", order=4, prepare=Adams)
