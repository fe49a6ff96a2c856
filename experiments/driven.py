"""Driven tops: which method is best if the Hamiltonian depends on time?

`kapitza` is Kapitza's top: upright, too slow to stand, and held by a pivot that vibrates fast and strongly. `weak_pivot` is a
heavy top whose pivot vibrates a little. `tide` is a planet or satellite in a weak tide; it spins about one and a half times in
each orbit of eccentricity 0.2. In `strong_tide` the tide is a hundred times as strong. Times are in units of the problems.

Every compiled method that takes the problems follows them with ever smaller steps or tolerances. The error is measured at the
end, against the reference in quadruple precision, which takes time as one more variable. Wall time is the least of several
runs, with set-up. The best methods also make runs eight times as long, in which set-up matters less. The splitting with the
exact step kicks by the part that depends on time. If this part is weak, the splitting can take long steps.
"""

import warnings
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments import work_precision
from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.states import accuracy_settings, interpreted, options_of, rounded
from lagrange_bench.integrators import METHODS, orbiting_tide, prepare, vibrating_pivot
from lagrange_bench.integrators.interface import Array, Method, StepWarning
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.truth import reference

VERSION = 1
MEASURED = {"": ("error", "seconds", "setup_seconds")}
OURS, SCHEMES = "backlund_splitting", ("strang", "processed6")
PROBLEMS: dict[str, Problem] = {
    "kapitza": vibrating_pivot(1.0, 60.0, 20.0),
    "weak_pivot": vibrating_pivot(1.0, 0.02, 3.0),
    "tide": orbiting_tide(1e-3, 0.2, 1.0),
    "strong_tide": orbiting_tide(0.1, 0.2, 1.0),
}
STARTS = {"kapitza": (0.05, -0.02, 0.3, 0.08, 0.06, 0.995), "weak_pivot": (0.3, -0.2, 1.1, 0.48, 0.6, 0.64)}
SPINNING = (0.3, -0.2, 1.4, 0.36, 0.48, 0.8)  # start in the tides
SPANS = {"kapitza": 32.0, "weak_pivot": 64.0, "tide": 128.0, "strong_tide": 128.0}
# runs take 2^k steps
POWERS = {"kapitza": range(9, 16), "weak_pivot": range(5, 13), "tide": range(5, 13), "strong_tide": range(7, 15)}
TOLERANCES = (1e-5, 1e-8, 1e-11, 1e-14)
QUICK = (OURS, "rk4", "strang", "blanes_moan4", "taylor")
QUICK_PROBLEM = "kapitza"  # the only one in the quick profile: each takes seconds to compile
LONGER = 8  # the factor of the long runs
CHAOTIC = "strong_tide"  # no method follows this problem so far: it has no long runs
RIVALS = ("blanes_moan4", "blanes_moan6", "verner9_fixed", "dop853_fixed", "kahan_li8", "taylor")  # in the longer runs
NAMED = (OURS, "rk4", "strang", "blanes_moan6", "gauss8", "taylor")  # in the figure


def methods() -> dict[str, Method]:
    """The compiled methods that take every problem."""
    loaded = {name: method for name, method, _ in METHODS.each() if method and not interpreted(method)}
    return {n: m for n, m in loaded.items() if all(m.takes(problem) is None for problem in PROBLEMS.values())}


def start(problem: str) -> Array:
    return np.array(STARTS.get(problem, SPINNING))


def cells(profile: str) -> list[dict]:
    full, listed = profile == "full", []
    chosen = {1: tuple(methods()), LONGER: (OURS, *RIVALS)} if full else {1: QUICK}
    for (problem, powers), (factor, names) in product(POWERS.items(), chosen.items()):
        if (problem, factor) == (CHAOTIC, LONGER) or not (full or problem == QUICK_PROBLEM):
            continue
        steps = [SPANS[problem] / 2**k for k in (powers if full else powers[1:-1:3])]
        for name in (name for name in names if name in methods()):
            for setting in accuracy_settings(METHODS[name], steps, TOLERANCES if full else TOLERANCES[::2]):
                cell = {"timing": True, "problem": problem, "span": factor * SPANS[problem], "method": name, **setting}
                listed += [{**cell, "scheme": scheme} for scheme in SCHEMES] if name == OURS else [cell]
    return listed


def measure(cell: dict) -> list[dict]:
    name, method = cell["problem"], METHODS[cell["method"]]
    problem, y0, span = PROBLEMS[name], start(name), cell["span"]
    n = round(span / cell["h"]) if "h" in cell else 1

    def ready() -> Any:
        return prepare(problem, y0, span / n, method, **options_of(cell))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)  # the part that depends on time may be strong here
        stepper = ready()
        end = stepper.advance(y0, n)
        seconds = timing.time_call(lambda: stepper.advance(y0, n), min_time=0.005, repeats=5).min
        setup = min(ready().work.setup_seconds for _ in range(3))
    right = reference.solution(problem, y0, [span]).states[0]
    row = {"error": float(metrics.scaled_error(problem, y0, end, right)), "seconds": seconds, "setup_seconds": setup}
    return [{column: rounded(value) for column, value in row.items()}]


ORDERS = "Driven tops: orders claimed and measured. Empty where fewer than three steps tell"


@by_group(("problem", "method", "scheme"), "", ORDERS)
def orders(problem: str, method: str, scheme: str, run: pd.DataFrame) -> dict:
    if method not in METHODS or METHODS[method].accuracy_option != "h":
        return {}
    run = run[run.span <= SPANS[problem]]
    measured = metrics.order(run.h, run.error, floor=1e-13, saturation=1e-2).p
    return {"claimed": 6 if scheme == "processed6" else METHODS[method].order, "measured": measured}


@of_part(
    "",
    "Driven tops: the cheapest method, set-up counted, and the best of the others beside the splitting with the exact step",
)
def winners(rows: pd.DataFrame) -> pd.DataFrame:
    good = work_precision.useful(rows)
    return work_precision.against_ours(good, ["problem", "span"], work_precision.TARGETS, OURS)


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    named = rows.assign(scheme=rows.scheme.astype(object).fillna("") if "scheme" in rows else "")
    return tabulated(winners, orders)(named)


@of_part()
def _draw_work(rows: pd.DataFrame, style):
    good = work_precision.useful(rows)
    if good.empty:
        return None
    apart = ["problem", "span"]
    titles = {run: f"{run[0].replace('_', ' ')}, t = {run[1]:g}" for run, _ in good.groupby(apart, sort=False)}
    fig = work_precision.draw_panels(good, titles, apart, (2, 2.6), style, lambda here: NAMED, sharey=True)
    bold = "named: the exact step inside, well-known methods, and the most accurate of each panel"
    fig.caption = (
        "Error at the end against wall time, set-up included, of tops with a Hamiltonian that depends on time; down and left is "
        f"better. {style.naming(good.method, bold)}. Each curve joins Pareto-optimal runs."
    )
    return fig


draw = drawn(work=_draw_work)
