"""Work against precision: what does an error cost, over short, long and very long runs?

Each method runs with ever smaller steps or tolerances, from the coarsest on. Its curve ends for one of three reasons: a run would
take too long (estimated from a short one), the error falls no more, or the tightest tolerance is reached. The tightest is 1e-15,
and 1e-13 for Runge-Kutta pairs. The rule is the same for every method, with one exception: methods that are
exact in time go on to steps of one unit, so that runs with a state every unit can be compared.

The error is the largest at four places in the last fifth of the run, against the exact solution, relative to the scales of J and
x. Wall time is the least of several compiled runs; a run of half a second or more is timed once. Set-up, such as the λ(h) of a
torus, has a column of its own. Nonlinear equations are solved to round-off.
"Evaluations" are right-hand sides, for methods that have any. Times are in units of 1/(|J| + √(|alpha||x|)).
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring import metrics, states, timing
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.interface import StepError
from lagrange_bench.integrators.problem import kinds

VERSION = 3
SCALED_TIMES = True
MEASURED = {"": ("error", "seconds", "setup_seconds", "steps", "evals", "iterations")}

# span: (states, steps in an octave, decades of tolerance between two runs, longest run in s)
SPANS: dict[str, dict[float, tuple[tuple[str, ...], int, int, float]]] = {
    "quick": {100.0: (("generic",), 1, 3, 0.02), 10_000.0: (("generic",), 1, 3, 0.02)},
    "full": {
        10.0: (("generic", "figure1"), 2, 1, 0.1),
        100.0: (("generic", "figure1"), 2, 1, 0.4),
        10_000.0: (("generic", "figure1"), 2, 1, 1.0),
        1_000_000.0: (("generic",), 1, 1, 3.0),
    },
}
COARSEST, FINEST = 16.0, 2.0**-24  # steps; every curve ends before the finest
STATE_EVERY = 1.0  # the curve of an exact method goes on at least to this step
LOOSEST, TIGHTEST = 2, 15  # decades of tolerance
USEFUL = 0.1  # an error above this is no solution: its time is not measured
COARSE, FLOOR_RUNS = 1e-4, 3  # below the error COARSE, FLOOR_RUNS runs in a row without a smaller error end a curve
TRIALS = 4  # short runs that are timed, to estimate how long a run takes
SAMPLE = 0.005  # s, the least length of a timing sample; shorter runs are repeated


def cells(profile: str) -> list[dict]:
    all_cells = []
    for span, (tops, per_octave, decades, longest) in SPANS[profile].items():
        sweep = {"span": span, "per_octave": per_octave, "decades": decades, "longest": longest}
        for state in tops:
            for name, method in states.methods_on().items():
                exact = {"state_every": STATE_EVERY} if method.order is None and method.control == "step" else {}
                all_cells.append({"timing": True, "method": name, "state": state, **sweep, **exact})
    return all_cells


def measure(cell: dict) -> list[dict]:
    """The curve of one method: a row for each step or tolerance. The last row has `stopped` unless nothing was left to try."""
    method = METHODS[cell["method"]]
    steps = COARSEST * 2.0 ** -np.arange(0, np.log2(COARSEST / FINEST) + 0.01, 1 / cell["per_octave"])
    tolerances = 10.0 ** -np.arange(LOOSEST, TIGHTEST + 0.5, cell["decades"])
    rows: list[dict] = []
    least, in_vain = np.inf, 0
    for setting in states.accuracy_settings(method, steps[steps <= cell["span"]].tolist(), tolerances.tolist()):
        try:
            row = _run({**cell, **setting})
        except StepError as refusal:  # the step is too large or the tolerance too small: go on with the next
            row = {"stopped": "refused", "reason": refusal.reason}
        error = row.get("error", np.inf)
        in_vain = 0 if error < 0.9 * least or least > COARSE else in_vain + 1
        least = min(least, error)
        if in_vain >= FLOOR_RUNS and setting.get("h", 0.0) <= cell.get("state_every", np.inf) and "stopped" not in row:
            row["stopped"] = "round-off"
        rows.append({**{name: states.rounded(value) for name, value in setting.items()}, **row})
        if row.get("stopped") in ("too long", "round-off"):
            break
    return rows


def _run(cell: dict) -> dict:
    """The error of one run, and its time if the error is useful."""
    top, y0 = states.of_cell(cell)
    unit = top.scales(y0)[2]
    options = states.options_of(cell)
    method = METHODS[cell["method"]]
    n = round(cell["span"] / cell["h"]) if method.accuracy_option == "h" else 16
    h = cell["span"] * unit / n
    stepper = prepare(top, y0, h, method, **options)
    predicted = _predicted(cell, method, stepper, h, n, options)
    if predicted > cell["longest"]:
        return {"stopped": "too long", "predicted": states.rounded(predicted)}
    # in a potential only at the end: each time would need a reference solution of its own
    counts = sorted({max(n * k // 16, 1) for k in (13, 14, 15, 16)}) if kinds.uniform(top) else [n]
    _, y = states.sample(top, y0, cell["method"], h, counts, **options)
    with np.errstate(over="ignore"):  # of a step much too large
        error = float(np.max(metrics.scaled_error(top, y0, y, states.truth(top, y0, method, h, counts))))
    if not np.isfinite(error):
        return {"stopped": "refused", "reason": "the error is beyond the range of doubles"}
    if error > USEFUL:
        return {"error": states.rounded(error)}
    setups = [prepare(top, y0, h, method, **options).work.setup_seconds for _ in range(3)]
    stepper = prepare(top, y0, h, method, **options)  # which counts the work of one run
    seconds, work = [_seconds(stepper, y0, n)], replace(stepper.work)
    if seconds[0] < SAMPLE:
        seconds += timing.time_call(lambda: stepper.advance(y0, n), min_time=SAMPLE, repeats=3).tolist()
    else:
        repeats = 3 if seconds[0] < 20 * SAMPLE else 1 if seconds[0] < 0.5 else 0
        seconds += [_seconds(stepper, y0, n) for _ in range(repeats)]
    return {
        "error": states.rounded(error),
        "seconds": states.rounded(min(seconds)),
        "seconds_samples": [states.rounded(sample) for sample in seconds],
        "setup_seconds": states.rounded(min(*setups, work.setup_seconds)),
        "steps": work.steps,
        "evals": work.rhs_evals,
        "iterations": work.iterations,
    }


def _predicted(cell: dict, method, stepper, h: float, n: int, options: dict) -> float:
    """An estimate of the seconds of a run, from the quickest of several short ones: a disturbance does not matter."""
    top, y0 = states.of_cell(cell)
    trial, steps = max(cell["span"] / 2**14, min(cell["span"], 10.0)), 1
    if method.accuracy_option == "h":
        steps = max(round(n * trial / cell["span"]), 1)
        share = n / steps
    else:
        stepper, share = prepare(top, y0, trial * top.scales(y0)[2], method, **options), cell["span"] / trial
    return share * min(_seconds(stepper, y0, steps) for _ in range(TRIALS))


def _seconds(stepper, y0, n) -> float:
    start = perf_counter()
    stepper.advance(y0, n)
    return perf_counter() - start


# ---------------------------------------------------------------- tables and figures


OURS = "backlund"  # the exact step
APART = ["span", "state"]  # runs are compared only if they have these in common
SHORT = 100.0  # up to this length of run, the quickest run takes hardly longer than a call
WALL = "wall time of the run, s"
TARGETS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


def useful(rows: pd.DataFrame) -> pd.DataFrame:
    """The runs that were timed, with their `family` and `total`, the time with set-up."""
    rows = rows.assign(**{name: np.nan for name in ("error", "seconds", "setup_seconds") if name not in rows})
    good = rows[(rows.status == "done") & rows.error.notna() & rows.seconds.notna()]
    families = {name: METHODS[name].family if name in METHODS else "others" for name in set(good.method)}
    return good.assign(total=good.seconds + good.setup_seconds, family=good.method.map(families))


def best(good: pd.DataFrame, target: float, price: str = "seconds") -> pd.DataFrame:
    """The cheapest run of every method with an error of at most `target`, the cheapest method first."""
    reached = good[good.error <= target]
    return reached.loc[reached.groupby("method")[price].idxmin()].sort_values(price)


def races(
    rows: pd.DataFrame, apart: Sequence[str], targets: Sequence[float], price: str
) -> Iterator[tuple[dict, pd.DataFrame]]:
    """For each group of runs (by the columns `apart`) and each target error that a run reaches: its fields and `best` runs."""
    for values, group in rows.groupby(list(apart), sort=False):
        for target in targets:
            race = best(group, target, price)
            if len(race):
                yield {**dict(zip(apart, values, strict=True)), "error at most": target}, race


def champions(good: pd.DataFrame) -> list[str]:
    """From each family the method that is cheapest at most of the target errors; from the Bäcklund maps the exact step."""
    winners = pd.concat([best(good, target).drop_duplicates("family") for target in TARGETS])
    families = winners.groupby("family", sort=False).method
    chosen = {str(family): Counter(names).most_common(1)[0][0] for family, names in families}
    if (good.method == OURS).any():
        chosen[METHODS[OURS].family] = OURS
    return list(chosen.values())


@of_part(failed=True)
def _draw_frontier(rows: pd.DataFrame, style):
    """Draw error against time of runs on the first top, with a panel for each length that has useful runs."""
    good = useful(rows[rows.state == rows.state.iloc[0]])
    if good.empty:
        return None
    titles = {span: f"t = {show(span)}" for span in sorted(set(good.span))}
    longest = good[good.span == max(titles)]
    named = [longest.method[longest.error.idxmin()], *champions(good)]
    fig = draw_panels(good, "span", titles, "seconds", (WALL, "largest error, last fifth of the run"), named, style)
    winners = [best(longest, target).method.iloc[:1] for target in TARGETS[:3]]
    if max(titles) > SHORT and all(winner.eq(OURS).any() for winner in winners):
        fig.headline = "In long runs the exact step costs least"
    words = style.naming(good.method, "named: the most accurate, and of families the cheapest at most errors")
    fig.caption = (
        "Largest error in the last fifth of the run against the wall time of the run on "
        f"“{states.label(good.state.iloc[0])}”; down and to the left is better. Each curve shows a method's Pareto-optimal runs. "
        f"{words}. Runs of up to t = {SHORT:g} take hardly longer than the call from Python. Set-up and compilation are not "
        "included."
    )
    return fig


def draw_panels(
    good: pd.DataFrame,
    column: str,
    titles: Mapping[Any, str],
    price: str,
    labels: tuple[str, str],
    named: Sequence[str],
    style: Any,
) -> Any:
    """A figure of error against `price`, with a panel for each value of `column`: the methods' Pareto-optimal runs.

    titles : value → title of its panel. labels : of the axes. named : methods, see `looks`.
    """
    fig, axes = style.panels(list(titles.values()), 2, (0.4, 2.7), *labels, sharey=True)
    for ax, value in zip(axes, titles, strict=True):
        for method, look in style.looks(good.method, named).items():
            runs = good[(good[column] == value) & (good.method == method)]
            runs = runs.iloc[metrics.pareto_front(runs[price], runs.error)]
            if len(runs) < 3:  # hardly a line
                look |= {"marker": "o", "markersize": 2.5}
            ax.loglog(runs[price], runs.error.clip(lower=1e-17), **look)
        ax.set_ylim(1e-16, 1)
    style.legend_below(fig)
    return fig


tables = tabulated()
draw = drawn(time=_draw_frontier)
