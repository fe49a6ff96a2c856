"""A method that promises too much: kick and rotation, which is of order 1, not symmetric, and loses H."""

from __future__ import annotations

import math

import numpy as np

from lagrange_bench.integrators import Method, StepError, Stepper, Work


class KickAndRotation(Stepper):
    def __init__(self, alpha, h):
        self.kick, self.h, self.work = alpha * h, h, Work()

    def advance(self, y, n):
        J1, J2, J3, x1, x2, x3 = y.tolist()
        for _ in range(n):
            J1, J2 = J1 - self.kick * x2, J2 + self.kick * x1
            J = math.hypot(J1, J2, J3)
            if not math.isfinite(J * self.h):
                raise StepError("lies", "overflow", h=self.h)
            s, c = (math.sin(J * self.h) / J, (math.sin(J * self.h / 2) / J) ** 2 * 2) if J else (self.h, 0.0)
            d1, d2, d3 = J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1
            x1, x2, x3 = (
                x1 + s * d1 + c * (J2 * d3 - J3 * d2),
                x2 + s * d2 + c * (J3 * d1 - J1 * d3),
                x3 + s * d3 + c * (J1 * d2 - J2 * d1),
            )
        self.work.steps += n
        return np.array((J1, J2, J3, x1, x2, x3))

    def record(self, y, n, every):
        rows = [y]
        for _ in range(n // every):
            rows.append(self.advance(rows[-1], every))
        return np.array(rows)


METHOD = Method(
    name="lies",
    label="kick and rotation",
    family="splitting",
    order=2,
    symmetric=True,
    poisson=True,
    conserves=frozenset({"H", "J3", "C1"}),
    control="step",
    source="a toy",
    prepare=lambda top, y0, h: KickAndRotation(top.alpha, h),
)
