"""The misprints of the paper, measured: how far each formula misses as printed and as corrected, at random points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from random import Random

from integrators.integrable import errata

POINTS, SEED = 8, 0  # what the command and the page take unless told otherwise


@dataclass(frozen=True)
class Measured:
    """One misprint. `printed` is the smallest residual over the points, `corrected` the largest."""

    equation: str
    section: str
    printed_text: str
    corrected_text: str
    printed: float
    corrected: float


@cache
def measure(points: int = POINTS, seed: int = SEED) -> tuple[Measured, ...]:
    """Every misprint in the order of the paper, at `points` random points each, drawn from seed, seed + 1, …"""
    found = []
    for e in errata.errata():
        printed, corrected = (
            [residual(Random(seed + k)) for k in range(points)] for residual in (e.printed, e.corrected)
        )
        texts = (e.equation, e.section, e.printed_text, e.corrected_text)
        found.append(Measured(*texts, min(printed), max(corrected)))
    return tuple(found)


def magnitude(residual: float) -> float:
    """The power of ten above a residual: what of it does not depend on the machine, but for bad luck."""
    return 0.0 if residual == 0 else float(f"1e{math.ceil(math.log10(residual))}")
