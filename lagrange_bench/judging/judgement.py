"""The result of `judge`: the errors of a trajectory, how they grow, observed orders."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.judging.findings import Finding
from lagrange_bench.judging.frames import UNITS
from lagrange_bench.support.growth import growth_exponent

Array = np.ndarray
SOME_ROWS = 8  # fewer do not show how an error grows
KEPT = {"length", "orthogonality", "spin_rate", "energy", "momentum"}  # constant in the exact motion
ROUNDING = 1e-10  # relative: larger errors do not come from rounding
ROUND_OFF = 1e-15  # relative to the size of a quantity: errors below it do not grow
NEAR = 0.3  # rad: orders are of the time for which rotations are nearer than this
LOST = 3.0  # rad: a rotation that is off by more is off by as much as it can be
ORDERED = ("position", "rotation", "omega", "energy")  # these have orders


class Error(NamedTuple):
    """The largest error of all rows, and the error of the last row; NaN if a row holds NaN, or lacks the quantity."""

    max: float
    end: float


@dataclass(frozen=True)
class Judgement:
    """The result of `judge`. `errors` has the quantities of `UNITS` that the trajectory has columns for, each also an attribute.

    span : s, first and last time. start : time and errors of the first row, and whether it is the start of the case, in doubles
    (`right`) and in single precision (`single`), or None if its time is not 0; empty if no start is known. floor : errors
    below it are lost in the printed digits. findings : what is wrong. remark : the errors if rows are read as these
    say, or what was looked at in vain.
    curves : times and errors (2, M) to draw. columns : how the columns of a file were read. turns : of the motion. sizes :
    some errors are compared with them.
    """

    case: str
    rows: int
    span: tuple[float, float]
    errors: dict[str, Error]
    start: dict[str, Any]
    floor: dict[str, float] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    remark: str = ""
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
            off = [f"{name} off by {_in_unit(name, self.errors[name].end, '.1e')}{self._growing(name)}"]
        turns = "" if math.isnan(self.turns) else f", {self.turns:.3g} turns"
        lines = [f"After {self.span[1] - self.span[0]:.4g} s{turns}: {'; '.join(off)}."] if off else []
        near, bound = ("rotation", 0.1)
        if "position" in self.errors:
            near, bound = "position", 0.1 * self.sizes["position"]
        if near in self.errors and self.errors[near].max > bound:
            t = self.near_until(near, bound)
            until = f"until t = {t:.3g} s" if t > self.curves[near][0, 0] else "at no time"
            lines.append(f"The {near} is within {_in_unit(near, bound, '.2g')} {until}.")
        if "rotation" in self.errors and self.errors["rotation"].max > LOST:
            lost = self.near_until("rotation", NEAR) - self.curves["rotation"][0, 0]
            lines.append(f"The rotation is lost after {lost:.3g} s: it is off by up to half a turn.")
        return lines

    def near_until(self, name: str, bound: float) -> float:
        """The time, s, until which an error is below a bound; infinite if it always is, or is not known."""
        t, error = self.curves.get(name, np.zeros((2, 1)))
        far = ~(error <= bound)
        return float(t[np.argmax(far)]) if far.any() else math.inf

    def largest(self, name: str, until: float) -> float:
        """The largest error before this time, NaN without one."""
        t, error = self.curves[name]
        return float(error[t < until].max(initial=-math.inf)) if np.any(t < until) else math.nan

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
        why = f"; perhaps {self.findings[0].text}" if self.findings else ""
        return f"<{self.case}, {self.rows} rows to t = {self.span[1]:.6g}: {errors}{why}>"

    def as_dict(self) -> dict[str, Any]:
        """The numbers of --json for a file."""
        errors = {name: {**error._asdict(), "growth": self.growth(name)} for name, error in self.errors.items()}
        facts = {name: getattr(self, name) for name in ("rows", "step", "start", "floor", "remark", "notes")}
        return {**facts, **errors, "findings": [finding._asdict() for finding in self.findings]}

    def reasons(self) -> list[str]:
        """A line for each finding: the cause, the misfit before and after it is mended, and what mends it."""
        lines = []
        for finding in self.findings:
            misfit = f" Misfit {finding.before:.2g} → {finding.after:.1g}." if math.isfinite(finding.before) else ""
            mend = "" if finding.option in finding.text else f" To mend it: {finding.option}."
            lines.append(f"Perhaps {finding.text}{misfit}{mend}")
        return [*lines, self.remark] if self.remark else lines


def _in_unit(name: str, error: float, digits: str) -> str:
    """An error with its unit, an angle also in degrees."""
    degrees = f" ({math.degrees(error):.3g}°)" if UNITS[name] == "rad" else ""
    return f"{error:{digits}} {UNITS[name]}{degrees}"


def orders(judged: Sequence[Judgement], steps: Sequence[float]) -> tuple[dict[str, list[float]], list[str]]:
    """Observed orders of what all files have, over the longest time for which all of them are near the exact motion.

    From the largest step to the smallest, NaN where there is none; and in words, which say why.
    """
    pairs = sorted(zip(steps, judged, strict=True), key=lambda pair: -pair[0])
    until = math.inf
    for each in judged:
        name = next((name for name in ("rotation", "axis", "position") if name in each.errors), "")
        until = min(until, each.near_until(name, NEAR * each.sizes.get(name, 1.0)))
    values, lines = dict[str, list[float]](), list[str]()
    for name in [name for name in ORDERED if all(name in each.errors for each in judged)]:
        both = [_order(name, coarse, fine, until) for coarse, fine in itertools.pairwise(pairs)]
        values[name], words = [order for order, _ in both], [word for _, word in both]
        if any(words):
            lines.append(f"order of {name}, from the largest step to the smallest: {', '.join(words)}")
    if math.isfinite(until) and any(map(math.isfinite, itertools.chain(*values.values()))):
        lines.append(f"These are the orders until t = {until:.4g} s, while all files are within {NEAR} rad.")
    return values, lines


def _order(
    name: str, coarse: tuple[float, Judgement], fine: tuple[float, Judgement], until: float
) -> tuple[float, str]:
    """An observed order and the word for it."""
    (h, one), (k, two) = coarse, fine
    large, small = one.largest(name, until), two.largest(name, until)
    if not h > k:
        return math.nan, ""
    if not (large > 0 and small > 0 and math.isfinite(large + small)):
        return math.nan, "none, the errors are as large as they can be" if until <= 0 else "none"
    order, size = math.log(large / small) / math.log(h / k), two.sizes.get(name, 1.0)
    if small <= two.floor.get(name, 0.0):
        return math.nan, "none, the digits of the file hide it"
    if small < ROUNDING * size and order < 0.5:
        return math.nan, "none, at round-off"
    return order, f"{order:.2f}"
