"""What the bench shows, as the numbers of three sentences of the page: each read from stored rows, or left out."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import ROUND_CEILING, Decimal
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments import phase, work_precision
from lagrange_bench.experiments.drawing import style, tables
from lagrange_bench.experiments.measuring.states import RANDOM
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.report.claims import NoData, Refuted, select, values
from lagrange_bench.report.promises import EXACT, against_others, span, table

OURS = "backlund"
STATE = "generic"  # the top of comparisons
POOR = 1e-3  # an error of which one says that the phase is off
NOISE = 1.1  # two times whose ratio is closer to 1 may differ by the noise of timing alone

Rows = Mapping[str, pd.DataFrame]


def numbers(rows: Rows) -> dict[str, dict[str, Any]]:
    """What the sentences on accuracy, cost and invariants need, by the experiment that has it.

    rows : of all experiments, by name. An experiment whose rows are missing or not sound is left out.
    """
    found = {}
    for experiment, read in (("phase", accuracy), ("cost", cost), ("drift", invariants)):
        try:
            if len(rows.get(experiment, ())):
                found[experiment] = {**read(rows), "top": TOPS[STATE].label}
        except (NoData, Refuted, KeyError):
            continue
    return found


def accuracy(rows: Rows) -> dict[str, Any]:
    """The exact step at every step size on every top, and the best of the others at a long one on one top."""
    swept = select(rows["phase"], part="h")
    h, error = values(swept, "h", "error", method=OURS).T
    here = select(swept, state=STATE)
    others = here[~here.method.map(work_precision.family_of).isin(EXACT) & (here.h > 0)]
    if others.empty:
        raise NoData("no other method was measured")
    steps = others.h.unique()
    at = others[others.h == steps[np.argmin(np.abs(np.log(steps)))]]
    errors = at.error.where(at.status == "done", np.inf).fillna(np.inf)
    best = at.loc[errors.idxmin()]
    return {
        "tops": select(swept, method=OURS).state.nunique(),
        "shortest": two_digits(h.min()),
        "longest": two_digits(h.max()),
        "worst": rounded_up(error.max()),
        "end": f"{phase.SPAN:g}",
        "others": len(at),
        "h": two_digits(best.h),
        "best": style.label(best.method),
        "least": two_digits(errors.min()),
        "poor": int((errors > POOR).sum()),
        "limit": tables.show(POOR),
    }


def cost(rows: Rows) -> dict[str, Any]:
    """The headline run against the Taylor series; and where the exact step loses."""
    names = ("fraction", "backlund_s", "heyoka_s", "ratio", "backlund_error", "heyoka_error", "steps", "h")
    fraction, ours, theirs, ratio, error, their_error, steps, h = values(rows["cost"], *names, part="headline").T
    return {
        "times": span(np.round(ratio)),
        "spacings": span(fraction),
        "end": two_digits(float(f"{(steps * h).max():.2g}")),
        "ours": span(1e9 * ours / steps),
        "theirs": span(1e6 * theirs / steps),
        "error": two_digits(error.max()),
        "their_error": two_digits(their_error.max()),
        "losses": losses(rows.get("work_precision", pd.DataFrame())),
        "noise": round(100 * NOISE - 100),
    }


def losses(rows: pd.DataFrame) -> list[tuple[str, str]] | None:
    """(ratio, length) of the runs in which another method is cheaper than every Bäcklund map, set-up counted.

    None: nothing can be compared.
    """
    most: dict[float, float] = {}
    for length, _, _, ours, others in against_others(work_precision.useful(rows), "total") if len(rows) else ():
        if len(ours) and len(others):
            most[length] = max(most.get(length, 0.0), ours.min() / others.min())
    if not most:
        return None
    return [(rounded_up(ratio), two_digits(length)) for length, ratio in sorted(most.items()) if ratio > NOISE]


def invariants(rows: Rows) -> dict[str, Any]:
    """What the exact step keeps over the longest runs, and how many others do not."""
    mine = select(rows["drift"], part="time", method=OURS)
    kept = rounded_up(np.abs(values(mine, *INVARIANTS)).max())
    verdicts = table(rows["drift"], "drift", "verdicts")
    others = verdicts[verdicts.invariant.isin(INVARIANTS) & ~verdicts.method.map(work_precision.family_of).isin(EXACT)]
    return {
        "kept": kept,
        "steps": two_digits(int(mine.steps.max())),
        "tops": mine.state.nunique(),
        "random": mine.state[mine.state.isin(RANDOM)].nunique(),
        "others": others.method.nunique(),
        "drifting": others[others.verdict.isin(("biased", "failed"))].method.nunique(),
    }


def rounded_up(value: float) -> str:
    """Two digits, rounded up: nothing that was measured is beyond."""
    exact = Decimal(repr(float(value)))
    return two_digits(float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - 1), ROUND_CEILING)))


def two_digits(value: float) -> str:
    """Counts exactly, measured numbers with two digits."""
    return tables.show(value if float(value).is_integer() else float(f"{value:.2g}"))
