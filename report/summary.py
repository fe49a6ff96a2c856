"""What the bench shows, in three sentences: each written from stored rows, or saying that they are missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import ROUND_CEILING, Decimal

import numpy as np
import pandas as pd

from lagrange_bench.experiments import phase, work_precision
from lagrange_bench.experiments.drawing import style, tables
from lagrange_bench.experiments.measuring.states import RANDOM
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.report.claims import NoData, Refuted, select, values
from lagrange_bench.report.promises import EXACT, against_others, table

OURS = "backlund"
STATE = "generic"  # the top of comparisons
LABEL = TOPS[STATE].label
POOR = 1e-3  # an error of which one says that the phase is off
NOISE = 1.1  # two times whose ratio is closer to 1 may differ by the noise of timing alone

OTHERS = "methods that are neither Bäcklund maps nor closed forms"

Said = tuple[str, str, str]  # the number, what it is, the sentence


@dataclass(frozen=True)
class Sentence:
    """One finding: its number, what that is, and all of it in words. `found` False: there are no rows to find it in."""

    head: str
    value: str
    gloss: str
    text: str
    section: str
    found: bool


def sentences(rows: dict[str, pd.DataFrame]) -> list[Sentence]:
    """Accuracy, cost and invariants, in this order."""
    made = []
    for head, section, say in (
        ("Accuracy.", "phase", accuracy),
        ("Cost.", "cost", cost),
        ("Invariants.", "drift", invariants),
    ):
        made.append(_sentence(head, section, say, rows))
    return made


def _sentence(
    head: str, section: str, say: Callable[[dict[str, pd.DataFrame]], Said], rows: dict[str, pd.DataFrame]
) -> Sentence:
    try:
        if rows.get(section, pd.DataFrame()).empty:
            raise NoData(f"nothing of {section} is stored")
        return Sentence(head, *say(rows), section, True)
    except (NoData, Refuted, KeyError) as missing:
        why = f"no column {missing}" if isinstance(missing, KeyError) else str(missing)
        return Sentence(head, "–", f"{head} No data.", f"No data: {why}.", section, False)


def accuracy(rows: dict[str, pd.DataFrame]) -> Said:
    """The exact step at every step size on every top, and the best of the others at a long one on one top."""
    swept = select(rows["phase"], part="h")
    ours = values(swept, "h", "error", method=OURS)
    tops, here = select(swept, method=OURS).state.nunique(), select(swept, state=STATE)
    others = here[~here.method.map(work_precision.family_of).isin(EXACT) & (here.h > 0)]
    if others.empty:
        raise NoData("no other method was measured")
    h = others.h.unique()[np.argmin(np.abs(np.log(others.h.unique())))]
    at = others[others.h == h]
    errors = at.error.where(at.status == "done", np.inf).fillna(np.inf)
    best = at.loc[errors.idxmin()]
    poor = int((errors > POOR).sum())
    shortest, longest, worst = _show(ours[:, 0].min()), _show(ours[:, 0].max()), _bound(ours[:, 1].max())
    return (
        worst,
        f"largest error of the exact step, at any h from {shortest} to {longest}, up to t\xa0=\xa0{phase.SPAN:g}",
        f"On {tops} tops, at any step from {shortest} to {longest}, the exact Bäcklund step is within {worst} of the true state "
        f"up to t = {phase.SPAN:g}. {len(at)} {OTHERS} have a fixed step. On the {LABEL}, at a step of {_show(h)}, the best "
        f"of them, {_name(best.method)}, has an error of {_show(errors.min())}. There {poor} of the {len(at)} have errors above "
        f"{_show(POOR)} or fail.",
    )


def cost(rows: dict[str, pd.DataFrame]) -> Said:
    """The headline run against the Taylor series; and where the exact step loses."""
    names = ("fraction", "backlund_s", "heyoka_s", "ratio", "backlund_error", "heyoka_error", "steps", "h")
    fraction, ours, theirs, ratio, error, their_error, steps, h = values(rows["cost"], *names, part="headline").T
    times, spacings, end = _range(np.round(ratio)), _range(fraction), _show(float(f"{(steps * h).max():.2g}"))
    gloss = f"the time of a Taylor series up to t\xa0=\xa0{end}, with a state every {spacings} nutation periods"
    text = (
        f"On the {LABEL} up to t = {end} a state takes {_range(1e9 * ours / steps)} ns, at every spacing of {spacings} nutation "
        f"periods. The largest error is {_show(error.max())}. A Taylor series at machine precision takes {times} times as long "
        f"({_range(1e6 * theirs / steps)} µs), with an error of {_show(their_error.max())}."
    )
    return f"{times}×", gloss, text + _where_it_loses(rows.get("work_precision", pd.DataFrame()))


def _where_it_loses(rows: pd.DataFrame) -> str:
    """In runs of which length another method is cheaper than every Bäcklund map, set-up counted, and by how much at most."""
    if rows.empty:
        return ""
    most: dict[float, float] = {}
    for span, _, _, ours, others in against_others(work_precision.useful(rows), "total"):
        if len(ours) and len(others):
            most[span] = max(most.get(span, 0.0), ours.min() / others.min())
    if not most:
        return ""
    if lost := {span: ratio for span, ratio in sorted(most.items()) if ratio > NOISE}:
        times = " and ".join(f"up to {_bound(ratio)} times (to t = {_show(span)})" for span, ratio in lost.items())
        return (
            f" It loses short runs, set-up counted: the cheapest Bäcklund map takes {times} as long as the cheapest method "
            "that is not exact."
        )
    return (
        f" Set-up counted, no method that is not exact is more than {100 * NOISE - 100:.0f} % cheaper than the cheapest "
        "Bäcklund map in any stored run."
    )


def invariants(rows: dict[str, pd.DataFrame]) -> Said:
    """What the exact step keeps over the longest runs, and how many others do not."""
    drift = rows["drift"]
    mine = select(drift, part="time", method=OURS)
    found = np.abs(values(mine, *INVARIANTS))
    steps = int(mine.steps.max())
    verdicts = table("drift", "verdicts")(drift)
    verdicts = verdicts[verdicts.invariant.isin(INVARIANTS)]
    others = verdicts[~verdicts.method.map(work_precision.family_of).isin(EXACT)]  # from the random tops
    drifting = others[others.verdict.isin(("biased", "failed"))].method.nunique()
    kept, tops, random = _bound(found.max()), mine.state.nunique(), mine.state[mine.state.isin(RANDOM)].nunique()
    return (
        kept,
        f"largest error of H, J3, C1 and C2, relative to their scales, in {_show(steps)} steps on {tops} tops",
        f"Over {_show(steps)} steps on {tops} tops H, J3, C1 and C2 stay within {kept} of their scales. Of "
        f"{others.method.nunique()} {OTHERS}, {drifting} let at least one of the four drift steadily on {random} of these "
        "tops, the random ones; interpreted methods run shorter.",
    )


def _name(method: str) -> str:
    return f"“{style.label(method)}”"


def _range(numbers: np.ndarray) -> str:
    """The least and the largest number, or the one."""
    least, most = (tables.show(float(number)) for number in (numbers.min(), numbers.max()))
    return least if least == most else f"{least}–{most}"


def _bound(value: float) -> str:
    """Two digits, rounded up: nothing that was measured is beyond."""
    exact = Decimal(repr(float(value)))
    return _show(float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - 1), ROUND_CEILING)))


def _show(value: float) -> str:
    """Counts exactly, measured numbers with two digits."""
    return tables.show(value if float(value).is_integer() else float(f"{value:.2g}"))
