"""Measures the errata of the paper: by how much each statement fails at random points, as printed and as corrected."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from random import Random

from lagrange_bench.integrators.paper import errata

POINTS, SEED = 8, 0  # defaults of the command and the page


@dataclass(frozen=True)
class Measured:
    """One erratum: its smallest residual as printed, its largest as corrected. prose : a sentence is wrong, but no formula."""

    equation: str
    section: str
    printed_text: str
    corrected_text: str
    prose: bool
    printed: float
    corrected: float


@cache
def measure(points: int = POINTS, seed: int = SEED) -> tuple[Measured, ...]:
    """Every erratum in the order of the paper, at `points` random points from the seeds seed, seed + 1, …"""
    residuals = []
    for e in errata.errata():
        printed = min(e.residual(Random(seed + k), True) for k in range(points))
        corrected = max(e.residual(Random(seed + k), False) for k in range(points))
        residuals.append(Measured(e.equation, e.section, e.printed_text, e.corrected_text, e.prose, printed, corrected))
    return tuple(residuals)


def count(measured: Iterable[Measured]) -> str:
    """“3 wrong formulas and 2 wrong sentences”."""
    prose = [e.prose for e in measured]
    return f"{prose.count(False)} wrong formulas and {prose.count(True)} wrong sentences"


def magnitude(residual: float) -> float:
    """The power of ten above a residual: it hardly ever depends on the machine."""
    return 0.0 if residual == 0 else float(f"1e{math.ceil(math.log10(residual))}")
