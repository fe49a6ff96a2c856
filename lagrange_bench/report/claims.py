"""How a claim is checked against stored rows; `promises` reads the claims themselves.

A claim is a sentence and the bounds it sets. Each bound names the rows it is about. If all these rows are stored, the claim is
confirmed or refuted. If some are missing, the others can agree with it (consistent), but not confirm it. A failed row always
refutes it: an accident, a step that a method declined, or NaN in a row that is done.
"""

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date, datetime
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from string import Formatter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from lagrange_bench.experiments.catalogue import declared
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring.reductions import with_failures

SIGNS = {"≤": operator.le, "<": operator.lt, "≥": operator.ge, ">": operator.gt}
GROUPS = ("exactness", "conservation", "cost", "fields", "method")
CONFIRMED, CONSISTENT, REFUTED, UNTESTED = "confirmed", "consistent", "refuted", "not tested"
WORDS = (CONFIRMED, CONSISTENT, REFUTED, UNTESTED)


class NoData(LookupError):
    """The rows a claim needs are not there; the message says which."""


class Refuted(RuntimeError):
    """A claim does not hold, whatever the other numbers are: a row it is about failed, for instance."""


class Reading(NamedTuple):
    """All numbers that a bound is about, and which is the worst."""

    values: ArrayLike
    note: str = ""


Measure = Callable[[pd.DataFrame], Reading | ArrayLike]


@dataclass(frozen=True)
class Bound:
    """What one number of a claim must be.

    Attributes
    ----------
    measure : the measured columns, whose absolute values count, or a function of all rows of the experiment. Every value that it
        gives has to satisfy the bound.
    where : the rows it is about: field → its value, or a tuple of all values it must have.
    steps : the length that the longest of these runs must have. what : which of the claim's numbers this is.
    ranged : show the least and the largest value, not the worst alone.
    """

    measure: tuple[str, ...] | Measure
    sign: str
    limit: float
    unit: str = ""
    where: Mapping[str, Any] = field(default_factory=dict)
    steps: int = 0
    what: str = ""
    ranged: bool = False

    def missing(self, rows: pd.DataFrame) -> str:
        """Which of its runs are not among these rows, or the cells of a profile; "" if none is.

        A field that no run of the part has is not looked at: cells of a profile lack what is measured.
        """
        selected = rows
        where = {name: wanted for name, wanted in self.where.items() if name in rows}
        for name, wanted in where.items():
            if selected[name].notna().any():
                selected = select(selected, **{name: wanted})
        for name, wanted in where.items():
            present = set(selected[name].dropna())
            absent = [value for value in _all(wanted) if value not in present]
            if absent and (present or selected.empty):
                return f"a run with {name} = {show(absent[0])} is missing"
        if self.steps and not ("steps" in selected and (selected["steps"] >= self.steps).any()):
            return f"no run of {show(self.steps)} steps is stored"
        return ""


class BoundCheck(NamedTuple):
    """What was found for one bound. `passed` None: it decides nothing, and `note` says why."""

    bound: Bound
    values: tuple[float, float] | None = None  # the least and the largest
    passed: bool | None = None
    note: str = ""
    short: str = ""  # which of its runs are missing, where others were judged instead
    broken: bool = False  # the check itself failed

    @property
    def value(self) -> float | None:
        """The worst value."""
        return None if self.values is None else self.values[self.bound.sign in "≤<"]

    @property
    def measured(self) -> str:
        """The worst value or the range, for a reader."""
        if self.values is None:
            return ""
        least, most = map(show, self.values)
        number = f"{least}–{most}" if self.bound.ranged and least != most else show(self.value)
        words = (self.bound.what and f"{self.bound.what}:", number, self.bound.unit)
        return " ".join(filter(None, words)).replace(" ×", "×")

    @property
    def required(self) -> str:
        return f"{self.bound.sign} {show(self.bound.limit)}"


class ClaimVerdict(NamedTuple):
    """What the checks of a claim found."""

    findings: tuple[BoundCheck, ...]

    @property
    def word(self) -> str:
        passed = [finding.passed for finding in self.findings]
        if False in passed:
            return REFUTED
        if True not in passed:
            return UNTESTED
        return CONSISTENT if None in passed or self.short else CONFIRMED

    @property
    def short(self) -> str:
        """Which runs of the claim are missing."""
        return next((finding.short for finding in self.findings if finding.short), "")

    @property
    def note(self) -> str:
        short = f"{self.short}, judged by others" if self.short and self.word != UNTESTED else ""
        return "; ".join(dict.fromkeys(filter(None, (short, *(finding.note for finding in self.findings)))))


class Range(NamedTuple):
    """The numbers of a bound as an answer shows them: two digits, rounded so that all that was measured is between."""

    worst: str
    least: str
    most: str


class ShortAnswer(NamedTuple):
    """A question that a claim answers, in the README and at the top of the page.

    text : {name.worst}, {name.least} and {name.most} stand for numbers of the bound whose `what` is the name, or of the one
    without ("claim").
    """

    question: str
    text: str

    def filled(self, verdict: ClaimVerdict) -> str | None:
        """The answer with what was measured; None if some of it was not."""
        numbers = {}
        for finding in verdict.findings:
            if finding.values is None:
                continue
            ends = zip(finding.values, (ROUND_FLOOR, ROUND_CEILING), strict=True)
            least, most = (show(float(Context(2, rounding).create_decimal(end))) for end, rounding in ends)
            worst = most if finding.bound.sign in "≤<" else least
            numbers[finding.bound.what or "claim"] = Range(worst, least, most)
        names = {name.partition(".")[0] for _, name, _, _ in Formatter().parse(self.text) if name}
        return self.text.format_map(numbers) if names <= set(numbers) else None


@dataclass(frozen=True)
class Claim:
    """One sentence of the README or the paper, and what it requires of the stored rows."""

    id: str
    group: str
    text: str
    experiment: str
    bounds_set: date  # when its bounds were first set
    bounds_changed: datetime  # when the last of them was changed
    bounds: tuple[Bound, ...]
    answers: tuple[ShortAnswer, ...] = ()  # of the README


def judge(claim: Claim, rows: pd.DataFrame) -> ClaimVerdict:
    """The verdict on a claim."""
    if rows.empty:
        note = f"nothing of {claim.experiment} is stored"
        return ClaimVerdict(tuple(BoundCheck(bound, note=note) for bound in claim.bounds))
    rows = with_failures(rows, declared(claim.experiment, "MEASURED", {}))
    return ClaimVerdict(tuple(_judge(bound, rows) for bound in claim.bounds))


def _judge(bound: Bound, rows: pd.DataFrame) -> BoundCheck:
    short = ""
    try:
        short = bound.missing(rows)
        reading = _read(bound, rows)
    except NoData as missing:
        return BoundCheck(bound, note=short or str(missing))
    except Refuted as failure:
        return BoundCheck(bound, None, False, str(failure))
    except KeyError as missing:
        return BoundCheck(bound, note=f"no column {missing}")
    except Exception as error:  # a mistake in one check must not take the page with it
        reason = f"the check itself failed: {type(error).__name__}: {error}"
        return BoundCheck(bound, note=short or reason, broken=not short)
    numbers = np.asarray(reading.values, dtype=float)
    passed: bool | None = all(SIGNS[bound.sign](float(number), bound.limit) for number in numbers.flat)
    if short and not passed and np.all(np.isfinite(numbers)):
        passed = None  # other runs than those of the claim can agree with it, but not refute it unless they failed
    return BoundCheck(bound, (float(np.min(numbers)), float(np.max(numbers))), passed, reading.note, short)


def _read(bound: Bound, rows: pd.DataFrame) -> Reading:
    covered = _sound(select(rows, **bound.where), bound.where)
    if not callable(bound.measure):
        return Reading(np.abs(values(covered, *bound.measure)))
    reading = bound.measure(rows)
    return reading if isinstance(reading, Reading) else Reading(reading)


def values(rows: pd.DataFrame, *columns: str, **where: Any) -> np.ndarray:
    """Values of measured columns in the rows with the given fields (a tuple or a list: any of them), in one array.

    Raises
    ------
    NoData : no such rows or column. Refuted : a cell they would come from failed.
    """
    chosen = _sound(select(rows, **where), where)
    if missing := [name for name in columns if name not in chosen]:
        raise NoData(f"no column {missing[0]!r}")
    return np.asarray(chosen[list(columns)], dtype=float)


def select(rows: pd.DataFrame, **where: Any) -> pd.DataFrame:
    """Rows with the given fields. A failed cell has no measured fields, so there its cell's fields decide."""
    keep = pd.Series(True, index=rows.index)
    for name, wanted in where.items():
        if name not in rows:
            raise NoData(f"no column {name!r}")
        keep &= rows[name].isin(_all(wanted)) | (_failed(rows) & rows[name].isna())
    return rows[keep]


def _sound(chosen: pd.DataFrame, where: Mapping[str, Any]) -> pd.DataFrame:
    """The chosen rows, if there are any and none of them failed."""
    if chosen.empty:
        fields = ", ".join(f"{name} = {wanted}" for name, wanted in where.items())
        raise NoData("no rows" + (f" with {fields}" if fields else ""))
    failed = chosen[_failed(chosen)]
    if len(failed):
        raise Refuted(f"{len(failed)} of {len(chosen)} failed: {failed['failure'].iloc[0]}")
    return chosen


def _failed(rows: pd.DataFrame) -> pd.Series:
    return rows["status"] == "failed" if "status" in rows else pd.Series(False, index=rows.index)


def _all(wanted: Any) -> list[Any]:
    return list(wanted) if isinstance(wanted, (tuple, list, set)) else [wanted]


def grouped(judged: list[Any]) -> Iterator[tuple[str, list[Any]]]:
    """(group, the judged claims in it), for those groups that have any."""
    for group in GROUPS:
        if members := [each for each in judged if each.claim.group == group]:
            yield group, members
