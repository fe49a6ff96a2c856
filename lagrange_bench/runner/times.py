"""Measures ratios of times that claims are about, here and now, in one process: the experiments measure a few of their cells."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.work_precision import best, useful
from lagrange_bench.report.claims import SIGNS
from lagrange_bench.report.promises import CLAIMS, EXACT
from lagrange_bench.results.store import REFERENCE, Store
from lagrange_bench.runner import workers

SPAN, ERROR = 1e4, 1e-8  # length of the races, and the error that is asked for
HEADLINE = {"part": "headline", "method": "taylor", "fraction": 0.5, "time": 1e5}
STEP = {"part": "step", "method": "backlund", "h": 1 / 16, "repeats": 5}
RACE = {"state": "generic", "span": SPAN, "state_every": 1.0, "per_octave": 2, "decades": 1, "longest": 1.0}
OURS = {**RACE, "method": "backlund"}
CLOSED = [{**RACE, "method": name} for name in ("theta_functions", "addition_theorem")]
TOPS = {"part": "rival", "span": SPAN}
BATCH = [{**TOPS, "method": "backlund", "tops": 128, "h": 1.0}, {**TOPS, "method": "taylor", "tops": 64, "tol": 1e-9}]


class Ratio(NamedTuple):
    """A ratio that was measured, and the bound of the claim."""

    text: str
    value: float
    required: str
    passed: bool


def ratios() -> Iterator[Ratio]:
    """Five ratios, each as soon as it is measured."""
    races = useful(Store(REFERENCE).rows("work_precision"))
    races = best(races[(races.span == SPAN) & (races.state == "generic")], ERROR, "total")
    rival = races[~races.family.isin(EXACT)].method.iloc[0]  # the best one of the published runs
    yield _ratio("cost-of-a-state", "", "a state by heyoka over one by the exact step", HEADLINE)
    yield _ratio("set-up", "", "the set-up of the exact step over a step", STEP)
    yield _ratio("long-and-short-runs", "from 10⁻⁶ on", f"{rival} over the exact step", OURS, {**RACE, "method": rival})
    yield _ratio("closed-forms", "t = 10⁴, 10⁶", "the best closed form over the exact step", OURS, *CLOSED)
    yield _ratio("many-tops", "heyoka", "many tops by heyoka over the exact step", *BATCH)


def _ratio(name: str, bound_name: str, text: str, *cells: Mapping[str, Any]) -> Ratio:
    (claim,) = (each for each in CLAIMS if each.id == name)
    bound = next(bound for bound in claim.bounds if bound.what == bound_name)
    rows = []
    for cell in cells:
        workers.restrain(cell["method"])
        rows += [{**cell, **row, "status": "done"} for row in load(claim.experiment).measure(dict(cell))]
    frame = pd.DataFrame(rows)
    if claim.experiment == "work_precision":
        race = best(useful(frame[~(frame.h > 1)]), ERROR, "total").set_index("method").total  # with a state every unit
        value = race.drop("backlund").min() / race["backlund"]
    else:
        measured = bound.measure(frame)  # type: ignore[operator]
        value = np.asarray(getattr(measured, "values", measured)).item()  # of these cells there is one ratio
    required = f"{bound.sign} {bound.limit:g} {bound.unit}"
    return Ratio(text, float(value), required, bool(SIGNS[bound.sign](value, bound.limit)))
