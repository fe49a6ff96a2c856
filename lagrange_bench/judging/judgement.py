"""The result of `judge`: the errors of a trajectory, how they grow, observed orders."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.judging.frames import UNITS
from lagrange_bench.support.growth import growth_exponent

Array = np.ndarray
SOME_ROWS = 8  # fewer do not show how an error grows
KEPT = {"length", "orthogonality", "spin_rate", "energy", "momentum"}  # constant in the exact motion
ROUNDING = 1e-10  # relative: larger errors do not come from rounding
ROUND_OFF = 1e-15  # relative to the size of a quantity: errors below it do not grow


class Error(NamedTuple):
    """The largest error of all rows, and the error of the last row; NaN if a row holds NaN, or lacks the quantity."""

    max: float
    end: float


@dataclass(frozen=True)
class Judgement:
    """The result of `judge`. `errors` has the quantities of `UNITS` that the trajectory has columns for, each also an attribute.

    span : s, first and last time. start : time and errors of the first row, and whether it is the start of the case, in doubles
    (`right`) and in single precision (`single`), or None if its time is not 0; empty if no start is known. floor : errors
    below it are lost in the printed digits. hints : conventions that the rows perhaps have. curves : times and errors (2, M) to
    draw. columns : how the columns of a file were read. turns : of the motion. sizes : some errors are compared with them.
    """

    case: str
    rows: int
    span: tuple[float, float]
    errors: dict[str, Error]
    start: dict[str, Any]
    floor: dict[str, float] = field(default_factory=dict)
    hints: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    curves: dict[str, Array] = field(default_factory=dict, repr=False)
    turns: float = 0.0
    sizes: dict[str, float] = field(default_factory=dict)
    file: str | None = None
    columns: str = ""

    @property
    def step(self) -> float:
        """The mean distance of two rows, s."""
        return (self.span[1] - self.span[0]) / (self.rows - 1) if self.rows > 1 else math.nan

    def ends_before(self, until: float) -> bool:
        """Whether the last row is before this time, s, by more than half of the distance of two rows."""
        return self.span[1] < until - (0.5 * self.step if self.rows > 1 else 0.0)

    def summary(self) -> list[str]:
        """One sentence on the error at the end, and one on how long the run is near the exact motion."""
        name = next((name for name in ("axis", "rotation", "omega", "position", "energy") if name in self.errors), None)
        if name is None or self.rows < 2 or not math.isfinite(self.errors[name].end):
            return []
        if "omega" not in self.errors and "energy" in self.errors:  # without a start
            names = [name for name in ("energy", "momentum") if self.sizes.get(name)]
            off = [
                f"{name} off by {self.errors[name].end / self.sizes[name]:.1e} of its size{self._growing(name)}"
                for name in names
            ]
        else:
            off = [f"{name} off by {self.errors[name].end:.1e} {UNITS[name]}{self._growing(name)}"]
        turns = "" if math.isnan(self.turns) else f", {self.turns:.3g} turns"
        lines = [f"After {self.span[1] - self.span[0]:.4g} s{turns}: {'; '.join(off)}."] if off else []
        near, bound = self._near()
        if self.leaves:
            t, error = self.curves[near]
            first = int(np.argmax(~(error <= bound)))
            until = f"until t = {t[first]:.3g} s" if first else "at no time"
            lines.append(f"The {near} is within {bound:.2g} {UNITS[near]} {until}.")
        return lines

    @property
    def leaves(self) -> bool:
        """Whether an error gets larger than a tenth of the body, or 0.1 rad."""
        near, bound = self._near()
        return near in self.errors and self.errors[near].max > bound

    def _near(self) -> tuple[str, float]:
        """The error that tells whether a trajectory is near the exact one, and how large it may be."""
        return ("position", 0.1 * self.sizes["position"]) if "position" in self.errors else ("rotation", 0.1)

    def growth(self, name: str) -> float:
        """The exponent p of an error that grows like t^p; NaN where the rows do not tell."""
        t, error = self.curves[name]
        least = 1 / self.step if name == "kinematics" else self.sizes.get(name, 1.0)
        floor = max(self.floor.get(name, 0.0), ROUND_OFF * least)
        if np.count_nonzero(error > floor) < SOME_ROWS:
            return math.nan
        return growth_exponent(t - t[0], error, floor=floor).p

    def grows(self, name: str) -> str:
        """`growth` in words."""
        power = self.growth(name)
        if math.isnan(power):
            return ""
        if power < 0.25:
            return "bounded"
        nearest = round(power)
        law = "t" if nearest == 1 else f"t^{nearest}"
        law = law if abs(power - nearest) < 0.25 else f"t^{power:.1f}"
        rounding = name in KEPT and self.errors[name].max < ROUNDING * self.sizes.get(name, 1.0)
        return f"{law}, a random walk" if power < 0.75 and rounding else law

    def _growing(self, name: str) -> str:
        grows = self.grows(name)
        return f", {grows}" if grows == "bounded" else f", growing like {grows}" if grows else ""

    def __getattr__(self, name: str) -> Error:
        if name in UNITS and name in self.errors:
            return self.errors[name]
        raise AttributeError(f"{name} is not judged: there are no columns for it" if name in UNITS else name)

    def __repr__(self) -> str:
        errors = ", ".join(f"{name} {error.max:.1e}" for name, error in self.errors.items())
        hint = f"; perhaps {self.hints[0]}" if self.hints else ""
        return f"<{self.case}, {self.rows} rows to t = {self.span[1]:.6g}: {errors}{hint}>"

    def as_dict(self) -> dict[str, Any]:
        """The numbers of --json for a file."""
        errors = {name: {**error._asdict(), "growth": self.growth(name)} for name, error in self.errors.items()}
        facts = {"rows": self.rows, "step": self.step, **errors}
        return {**facts, "start": self.start, "floor": self.floor, "hints": self.hints, "notes": self.notes}


def orders(judged: Sequence[Judgement], steps: Sequence[float]) -> dict[str, list[float]]:
    """Observed orders of position and rotation between neighbours, from the largest step to the smallest.

    NaN if an error says nothing; no orders of a quantity that some file has no columns for.
    """
    pairs = sorted(zip(steps, judged, strict=True), key=lambda pair: -pair[0])
    observed: dict[str, list[float]] = {"position": [], "rotation": []}
    for name, values in observed.items():
        known = all(name in each.errors for each in judged)
        for (h, coarse), (k, fine) in itertools.pairwise(pairs) if known else ():
            large, small = coarse.errors[name].max, fine.errors[name].max
            says = h > k and large > 0 and small > fine.floor.get(name, 0.0)
            values.append(math.log(large / small) / math.log(h / k) if says else math.nan)
    return observed


def converges_elsewhere(orders: Sequence[float]) -> bool:
    """Whether errors stop falling far from round-off, as those of a program that follows another motion."""
    known = [order for order in orders if math.isfinite(order)]
    return len(known) > 1 and known[-1] < 0.3 < max(known)
