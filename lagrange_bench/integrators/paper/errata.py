"""The errata of the paper as data. Each can be evaluated as printed and as corrected.

There are two kinds: wrong formulas, and wrong sentences beside right formulas (`prose`). A module that implements a section of
the paper lists the errata of this section in `ERRATA`. `errata()` collects them in the order of the paper, to show them; the
corrected formulas are tested elsewhere.
"""

import cmath
import importlib
import math
from collections.abc import Callable
from random import Random
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.problem.top import LagrangeTop

MODULES = (
    "phase_space", "contraction", "lax", "separation", "euler_angles", "one_point", "generating_functions", "eulerian",
    "two_point", "interpolating_flow", "gaudin_model",
)  # fmt: skip


class Erratum(NamedTuple):
    """One erratum: the printed text, the corrected text, and the residual of either."""

    equation: str  # number in the paper, or its label and line, e.g. "(2.22)"
    section: str  # numbers and dots, "5.1"
    printed_text: str  # as printed, plain text
    corrected_text: str  # as it must read
    # |left − right| at a random point: as printed (True) visibly not zero, > 1e-6; as corrected round-off, ≤ 1e-12
    residual: Callable[[Random, bool], float]
    prose: bool = False  # a sentence is wrong; the formulas beside it are right


def errata() -> list[Erratum]:
    """All errata, in the order of the paper's sections."""
    modules = (importlib.import_module(f"{__package__}.{name}") for name in MODULES)
    return sorted(
        (e for module in modules for e in module.ERRATA), key=lambda e: [int(n) for n in e.section.split(".")]
    )


def draw(rng: Random) -> tuple[LagrangeTop, np.ndarray]:
    """A random top and a random complex state: alpha in (1/2, 1) or (3/2, 2), entries of size 1/2 to 3/2."""
    alpha = rng.choice((0.5, 1.5)) + 0.5 * rng.random()
    y = np.array([cmath.rect(0.5 + rng.random(), 2 * math.pi * rng.random()) for _ in range(6)])
    return LagrangeTop(alpha), y
