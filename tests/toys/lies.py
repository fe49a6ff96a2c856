"""A method that promises too much: kick and rotation, which is of order 1, not symmetric, and loses H."""

import math
from dataclasses import replace

import numpy as np

from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.loops import FixedStepper


@compiled
def step(s, c, tally):
    J1, J2, J3, x1, x2, x3 = s
    h = c[1]
    J1, J2 = J1 - c[0] * h * x2, J2 + c[0] * h * x1
    J = math.hypot(math.hypot(J1, J2), J3)
    a, b = (math.sin(J * h) / J, (math.sin(J * h / 2) / J) ** 2 * 2) if J > 0 else (h, 0.0)
    d1, d2, d3 = J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1
    x1, x2 = x1 + a * d1 + b * (J2 * d3 - J3 * d2), x2 + a * d2 + b * (J3 * d1 - J1 * d3)
    return J1, J2, J3, x1, x2, x3 + a * d3 + b * (J1 * d2 - J2 * d1)


METHOD = replace(
    METHODS["strang"],
    name="lies",
    label="kick and rotation",
    conserves=frozenset({"H", "J3", "C1"}),
    source="a toy",
    prepare=lambda top, y0, h: FixedStepper("lies", h, np.array((top.alpha, h)), step),
    needs="uniform",
    special={},
)
