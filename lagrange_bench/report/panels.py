"""What the panel of a method shows beside its row in the list: its curves on a few tops, and how its claims fare.

The curves of all methods are stored together, so that a panel shows its own among the others. Numbers are decimal logarithms, in
twentieths of a decade.
"""

import json
from collections.abc import Hashable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing import style
from lagrange_bench.experiments.drawing.tables import numbers_in, show
from lagrange_bench.experiments.measuring.reductions import done, worst
from lagrange_bench.experiments.work_precision_figures import useful
from lagrange_bench.integrators.interface import INVARIANTS, Method, needed
from lagrange_bench.integrators.registry import METHODS, NAMED_TOPS
from lagrange_bench.report.claims import NoData
from lagrange_bench.report.promises import CLAIMS, table

PARTS = 20  # of a decade
LEAST = 1e-17  # what is smaller, or 0, is drawn here
THINNED = 4  # of the drift every fourth time is drawn
SPAN = 1e4  # length of the runs of the work, or the longest below that

Curves = dict[str, list[int]]  # method → x0, y0, x1, y1, …


def script(rows: dict[str, pd.DataFrame]) -> str:
    """The data of all panels as JSON; empty if there are no curves."""
    states = [*_part(rows, "phase", "h").get("state", ()), *_part(rows, "perturbed", "work").get("state", ())]
    tops = [_top(name, rows) for name in dict.fromkeys(states) if name in NAMED_TOPS]
    if not tops:
        return ""
    methods = dict.fromkeys(method for claim in CLAIMS for method in claim.about)
    about = {method: [claim.id for claim in CLAIMS if method in claim.about] for method in methods}
    records = [(name, record) for name, record, _ in METHODS.each() if record]
    facts = {
        name: {"engine": m.engine, "needs": needed(m.needs), "source": m.source, "to run it": _line(name, m)}
        for name, m in records
    }
    colours = {name: style.of(name)["color"] for name, _ in records}
    data = {"tops": tops, "facts": facts, "colours": colours, "kept": findings(rows), "about": about, "parts": PARTS}
    return json.dumps(data, ensure_ascii=False, separators=(",", ":"))


def _line(name: str, method: Method) -> str:
    """A line of Python that runs the method: on the generic top, or else on a body."""
    problem = "kovalevskaya" if method.takes(NAMED_TOPS["generic"].top) else "generic"
    return f'integrate("{problem}", h=0.1, steps=100, method="{name}")'


def _top(state: str, rows: dict[str, pd.DataFrame]) -> dict[str, Any]:
    def here(*choices: tuple[str, str]) -> pd.DataFrame:
        chosen = [_part(rows, experiment, part) for experiment, part in choices]
        return pd.concat([each[each.state == state] for each in chosen if len(each)] or [pd.DataFrame()])

    errors, drift = here(("phase", "h"), ("perturbed", "order")), here(("drift", "time"), ("perturbed", "drift"))
    work = here(("work_precision", ""), ("perturbed", "work"))
    if len(work):
        work = work[work.span == max((s for s in work.span.unique() if s <= SPAN), default=work.span.min())]
    return {
        "name": state,
        "label": numbers_in(NAMED_TOPS[state].label),
        "h": _curves(errors, "h", "error"),
        "drift": _curves(_largest_so_far(drift, state), "t", "error"),
        "work": _curves(useful(work) if len(work) else work, "total", "error"),
        "span": show(float(work.span.iloc[0])) if len(work) else "",
    }


def _part(rows: Mapping[str, pd.DataFrame], experiment: str, part: str) -> pd.DataFrame:
    """What was computed of a part of an experiment, or nothing."""
    return done(rows.get(experiment, pd.DataFrame()), part)


def _largest_so_far(rows: pd.DataFrame, state: str) -> pd.DataFrame:
    """Of the invariants of the top, at every fourth time."""
    names = [name for name in INVARIANTS if name in NAMED_TOPS[state].top.conserved]
    runs = [run for _, run in rows.groupby("method", sort=False)] if len(rows) else []
    return pd.concat([run.assign(error=worst(run, names).cummax())[::-THINNED][::-1] for run in runs] or [rows])


def _curves(rows: pd.DataFrame, x: str, y: str) -> Curves:
    if not {"method", x, y} <= set(rows.columns):
        return {}
    return {str(name): list(_points(run[x], run[y])) for name, run in rows.groupby("method", sort=False)}


def _points(x: pd.Series, y: pd.Series) -> Iterator[int]:
    for pair in zip(x.astype(float), y.astype(float), strict=True):
        if np.isfinite(pair).all() and pair[0] > 0:
            yield from (round(PARTS * float(np.log10(max(value, LEAST)))) for value in pair)


def findings(rows: Mapping[str, pd.DataFrame]) -> dict[str, list[list[str]]]:
    """Of each method (what it claims, what was found): its order, and each invariant on random tops."""
    kept: dict[str, list[list[str]]] = {}
    for run in _lines(rows, "phase", "h", "orders"):
        order = "the leading term is below round-off" if run["hidden"] else show(round(run["measured"], 2))
        if run["claimed"] != "exact":
            kept.setdefault(run["method"], []).append([f"order {run['claimed']}", f"{order} ({run['state']})"])
    for run in _lines(rows, "drift", "time", "verdicts"):
        claimed = f"{run['invariant']} {'kept' if run['claimed'] else 'not claimed'}"
        error = show(float(f"{run['largest relative error']:.1e}"))
        kept.setdefault(run["method"], []).append([claimed, f"{run['verdict']}, largest error {error} (random tops)"])
    return kept


def _lines(rows: Mapping[str, pd.DataFrame], experiment: str, part: str, name: str) -> list[dict[Hashable, Any]]:
    """The lines of a table; none if too little is stored for it."""
    try:
        stored = len(_part(rows, experiment, part))
        return table(rows[experiment], experiment, name).to_dict("records") if stored else []
    except NoData:
        return []
