"""What `check` says about a claim of a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.start import Start

NOT_CLAIMED = "not claimed"


@dataclass(frozen=True)
class Verdict:
    """The verdict on one claim. passed : None if it is not judged; `how` says why. at : state and step of the largest value."""

    claim: str
    passed: bool | None
    how: str
    measured: float | None = None
    bound: str = ""
    at: str = ""

    def __str__(self) -> str:
        measured = "" if self.measured is None else f" {self.measured:.4g}, bound {self.bound};"
        return f"{self.claim}:{measured} {self.how}"

    @property
    def word(self) -> str:
        if self.passed is None:
            return NOT_CLAIMED if self.how.startswith(NOT_CLAIMED) else "not judged"
        return "pass" if self.passed else "fail"


class Worst(NamedTuple):
    """The largest of several errors, with its top and step. NaN counts as infinite."""

    size: float = 0.0
    at: str = ""

    def worse_of(self, size: float, start: Start, span: float) -> Worst:
        size = float("inf") if np.isnan(size) else float(size)
        return self if self.at and size <= self.size else Worst(size, f"{start.name}, h_scaled = {span:g}")

    def verdict(self, claim: str, bound: float, evidence: str) -> Verdict:
        """Whether it is at most the bound."""
        where = f"; largest on {self.at}" if self.at else ""
        return Verdict(claim, self.size <= bound, evidence + where, self.size, f"≤ {bound:.2g}", self.at)
