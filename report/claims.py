"""How a claim is checked against stored rows; `promises` has the claims themselves.

A check is a function of one experiment's rows. A claim is confirmed or refuted by the runs it is about. Where these are
missing it is consistent with shorter ones, or not tested; a cell that failed refutes every claim about it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from experiments import PROFILES
from experiments.catalogue import load
from experiments.drawing import tables

SIGNS = {operator.le: "≤", operator.ge: "≥"}
CONFIRMED, CONSISTENT, REFUTED, UNTESTED = "confirmed", "consistent", "refuted", "not tested"
WORDS = (CONFIRMED, CONSISTENT, REFUTED, UNTESTED)


@dataclass(frozen=True)
class Verdict:
    """What a check found. `passed` None: there is nothing to judge by, `note` says why."""

    value: Any
    bound: Any
    passed: bool | None
    note: str = ""
    over: str = ""  # what was found under other conditions than those of the bound, in short
    sign: str = "≤"  # of the bound: value sign bound is what the claim requires
    short: str = ""  # which of the claim's runs are missing, where shorter ones were judged instead

    @property
    def word(self) -> str:
        if self.passed is None:
            return UNTESTED
        return (CONSISTENT if self.short else CONFIRMED) if self.passed else REFUTED


Check = Callable[[pd.DataFrame], Verdict]
Need = Callable[[pd.DataFrame], str]  # which runs are missing in rows, or in the cells of a profile; "" if none is


def nothing(rows: pd.DataFrame) -> str:
    """The need of a claim that every profile has the runs for."""
    return ""


def steps(length: int) -> Need:
    """Runs of at least so many steps."""
    missing = f"no run of {tables.show(length)} steps is stored"
    return lambda rows: "" if (_column(rows, "steps") >= length).any() else missing


def spans(*lengths: float) -> Need:
    """Runs of each of these lengths."""

    def missing(rows: pd.DataFrame) -> str:
        absent = sorted(set(lengths) - set(_column(rows, "span")))
        return f"no run up to t = {tables.show(absent[0])} is stored" if absent else ""

    return missing


def tops(*names: str) -> Need:
    """Runs on each of these tops."""

    def missing(rows: pd.DataFrame) -> str:
        absent = [name for name in names if name not in set(_column(rows, "state"))]
        return f"no run of the top {absent[0]} is stored" if absent else ""

    return missing


def _column(rows: pd.DataFrame, name: str) -> pd.Series:
    return rows[name] if name in rows else pd.Series(dtype=float)


@dataclass(frozen=True)
class Claim:
    """One sentence of the README or the paper, and how to check it."""

    id: str
    text: str
    experiment: str
    check: Check
    needs: Need = nothing  # the runs it is about; without them there is no data
    brief: str = ""  # the sentence in at most fifteen words, for the README; "" where it is not among those named there
    unit: str = ""  # of what is found and required
    about: tuple[str, ...] = ()  # the methods whose panels on the page show it

    @property
    def profile(self) -> str:
        """The smallest profile that has the runs it is about."""
        if self.needs is nothing:
            return PROFILES[0]
        cells = load(self.experiment).cells
        return next((p for p in PROFILES if not self.needs(pd.DataFrame(cells(p)))), PROFILES[-1])


class NoData(LookupError):
    """The rows a claim needs are not there; the message says which."""


class CellFailed(RuntimeError):
    """A claim is about cells that failed: it does not hold."""


def judge(claim: Claim, rows: pd.DataFrame) -> tuple[Verdict, str | None]:
    """The verdict on a claim, and what went wrong in the check itself (None: nothing)."""
    if rows.empty:
        return Verdict(None, None, None, f"nothing of {claim.experiment} is stored"), None
    missing_runs = claim.needs(rows)
    try:
        verdict = claim.check(rows)
    except NoData as missing:
        return Verdict(None, None, None, missing_runs or str(missing)), None
    except KeyError as missing:
        return Verdict(None, None, None, f"{claim.experiment} has no column {missing}"), None
    except Exception as error:  # a mistake in one check must not take the page with it
        if missing_runs:
            return Verdict(None, None, None, missing_runs), None
        reason = f"{type(error).__name__}: {error}"
        return Verdict(None, None, None, f"the check itself failed: {reason}"), f"claim {claim.id}: {reason}"
    passed = verdict.passed
    if missing_runs and (passed or verdict.value is not None):
        # shorter runs can agree with a claim, but not refute it unless they failed; what they found is shown
        note = f"{missing_runs}, judged by shorter ones"
        verdict = replace(verdict, note="; ".join(filter(None, (note, verdict.note))), short=missing_runs)
        passed = passed or None
    return replace(verdict, passed=None if passed is None else bool(passed)), None  # a NumPy bool is not a bool


# ---------------------------------------------------------------- checks to choose from


def values(rows: pd.DataFrame, *columns: str, **where: Any) -> np.ndarray:
    """Values of measured columns in the rows with the given fields (a tuple or a list: any of them), in one array.

    Raises
    ------
    NoData : no such rows or column. CellFailed : a cell they would come from failed.
    """
    chosen = select(rows, **where)
    if chosen.empty:
        raise NoData("no rows" + (f" with {_said(where)}" if where else ""))
    failed = chosen[_failed(chosen)]
    if len(failed):
        raise CellFailed(f"{len(failed)} of {len(chosen)} failed: {failed['failure'].iloc[0]}")
    if missing := [name for name in columns if name not in chosen]:
        raise NoData(f"no column {missing[0]!r}")
    return np.asarray(chosen[list(columns)], dtype=float)


def _failed(rows: pd.DataFrame) -> pd.Series:
    return rows["status"] == "failed" if "status" in rows else pd.Series(False, index=rows.index)


def select(rows: pd.DataFrame, **where: Any) -> pd.DataFrame:
    """Rows with the given fields. A failed cell has no measured fields, so there its cell's fields decide."""
    keep = pd.Series(True, index=rows.index)
    for name, wanted in where.items():
        if name not in rows:
            raise NoData(f"no column {name!r}")
        hit = rows[name].isin(wanted if isinstance(wanted, (tuple, list, set)) else [wanted])
        keep &= hit | (_failed(rows) & rows[name].isna())
    return rows[keep]


def within(bound: float, *columns: str, **where: Any) -> Check:
    """Every |value| of the columns is ≤ bound; NaN is not."""
    return compare(lambda rows: float(np.max(np.abs(values(rows, *columns, **where)))), operator.le, bound)


def at_most(bound: float, *columns: str, **where: Any) -> Check:
    """Every value of the columns is ≤ bound; NaN is not."""
    return compare(lambda rows: float(np.max(values(rows, *columns, **where))), operator.le, bound)


def at_least(bound: float, *columns: str, **where: Any) -> Check:
    """Every value of the columns is ≥ bound; NaN is not."""
    return compare(lambda rows: float(np.min(values(rows, *columns, **where))), operator.ge, bound)


def on(derive: Callable[[pd.DataFrame], pd.DataFrame], check: Check) -> Check:
    """The check of what an experiment makes of its rows, a table of it for instance."""
    return lambda rows: check(derive(rows))


def compare(measure: Callable[[pd.DataFrame], float], holds: Callable[..., bool], bound: float) -> Check:
    """The check `holds(measure(rows), bound)`; a failed cell refutes it."""

    def check(rows: pd.DataFrame) -> Verdict:
        try:
            value = measure(rows)
        except CellFailed as failure:
            return Verdict(None, bound, False, str(failure), sign=SIGNS[holds])
        return Verdict(value, bound, bool(holds(value, bound)), sign=SIGNS[holds])

    return check


def _said(where: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {wanted}" for name, wanted in where.items())
