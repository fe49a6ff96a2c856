"""Work against precision: what does an error cost, over a short and over a long run?

Each method runs with a range of steps or tolerances; the error is the largest over the last fifth of the run, against
the exact solution, relative to the scales of J and x. Wall time is the least of two or more compiled runs without
set-up; set-up is in a column of its own. The implicit midpoint rule is solved to round-off in every step. "Evaluations"
are right-hand sides, for methods that have any. Times are in units of 1/(|J| + √(|alpha||x|)).
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pandas as pd

from experiments import engine, metrics, timing
from experiments.states import find, options_of, rounded, sample
from integrators import METHODS, exact, prepare
from integrators.top import TOPS

VERSION = 1

STATES = {"quick": ("generic",), "full": ("generic", "figure1")}
SPANS = {"quick": (100.0, 10_000.0), "full": (100.0, 100_000.0)}
STEPS = {"quick": (2.0, 0.5, 0.125, 2.0**-5), "full": tuple(2.0 ** (-k / 2) for k in range(-4, 17))}
TOLERANCES = {"quick": (1e-4, 1e-8, 1e-12), "full": tuple(10.0**-k for k in range(2, 16))}
SLOW = 10_000.0  # SciPy's RK45 goes no further than this in time with tolerances below 1e-6: minutes a run
LONG_RUN = 0.3  # s; shorter runs are repeated to fill a sample. All are timed three times, the longest twice
LONGEST_RUN = 5.0


def cells(profile: str) -> list[dict]:
    listed = []
    for span in SPANS[profile]:
        for state in STATES[profile]:
            for method in METHODS:
                for knob in _knobs(method, profile, span):
                    listed.append({"timing": True, "method": method, "state": state, "span": span, **knob})
    return listed


def _knobs(method: str, profile: str, span: float) -> list[dict]:
    if METHODS[method].control == "step":
        return [{"h": h} for h in STEPS[profile]]
    if method.startswith("rk45"):
        least = 1e-6 if span > SLOW else 1e-9 if span > 1000 else 1e-13
        return [{"rtol": tol} for tol in TOLERANCES[profile] if tol > 0.99 * least]
    return [{"tol": tol} for tol in TOLERANCES[profile]]


def measure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    unit = top.scales(y0)[2]
    options = options_of(cell)
    method = METHODS[cell["method"]]
    n = round(cell["span"] / cell["h"]) if method.control == "step" else 16
    h = cell["span"] * unit / n
    stepper = prepare(top, y0, h, method, **options)
    stepper.advance(y0, 1)  # compiles
    before = (stepper.work.steps, stepper.work.rhs_evals, stepper.work.iterations)
    seconds = [_seconds(stepper, y0, n)]
    after = (stepper.work.steps, stepper.work.rhs_evals, stepper.work.iterations)
    if seconds[0] < LONG_RUN:
        seconds = list(timing.time_call(lambda: stepper.advance(y0, n), min_time=0.005, repeats=3).samples)
    else:
        seconds += [_seconds(stepper, y0, n) for _ in range(2 if seconds[0] < LONGEST_RUN else 1)]
    times, states = sample(top, y0, method.name, h, sorted({max(n * k // 16, 1) for k in (13, 14, 15, 16)}), **options)
    error = metrics.scaled_error(top, y0, states, exact.solution(top, y0, times))
    steps, evals, iterations = (b - a for a, b in zip(before, after, strict=True))
    setups = [prepare(top, y0, h, method, **options).work.setup_seconds for _ in range(3)]
    return [
        {
            "error": rounded(float(np.max(error))),
            "seconds": rounded(min(seconds)),
            "samples": len(seconds),
            "setup_seconds": rounded(min(setups)),
            "steps": steps,
            "evals": evals,
            "iterations": iterations,
        }
    ]


def _seconds(stepper, y0, n) -> float:
    start = perf_counter()
    stepper.advance(y0, n)
    return perf_counter() - start


# ------------------------------------------------------------------------------------------ what the rows say

TARGETS = (1e-3, 1e-6, 1e-9, 1e-12)


def cheapest(rows: pd.DataFrame) -> pd.DataFrame:
    """For each run and target error: the least time of every method that reaches it, best first."""
    good = rows[(rows.status == "done") & rows.error.notna()]
    table = []
    for (span, state), group in good.groupby(["span", "state"], sort=False):
        for target in TARGETS:
            reached = group[group.error <= target]
            best = reached.loc[reached.groupby("method").seconds.idxmin()].sort_values("seconds")
            if best.empty:
                continue
            first = best.iloc[0]
            second = best.iloc[1] if len(best) > 1 else None
            table.append(
                {
                    "span": span,
                    "state": state,
                    "error at most": target,
                    "cheapest": first.method,
                    "seconds": first.seconds,
                    "next": "" if second is None else second.method,
                    "times as long": np.nan if second is None else second.seconds / first.seconds,
                    "not reached by": ", ".join(m for m in dict.fromkeys(group.method) if m not in set(best.method)),
                }
            )
    return pd.DataFrame(table)


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    columns = ["method", "state", "span", "h", "tol", "rtol", "error", "seconds", "setup_seconds", "steps", "evals"]
    good = rows[rows.status == "done"]
    return {"cheapest": cheapest(rows), "runs": good[[c for c in columns if c in good]].reset_index(drop=True)}


def draw(rows: pd.DataFrame) -> dict:
    from report import style

    figures = {"time": _draw(rows, style, "seconds", "wall time of the run, s")}
    if (rows.evals > 0).any():
        figures["evaluations"] = _draw(rows[~(rows.evals == 0)], style, "evals", "right-hand side evaluations")
    return figures


def _draw(rows: pd.DataFrame, style, column: str, label: str):
    spans, states = sorted(set(rows.span)), list(dict.fromkeys(rows.state))
    fig, axes = style.figure(
        "page", 0.6 + 2.6 * len(states), nrows=len(states), ncols=len(spans), sharey=True, squeeze=False
    )
    for line, state in zip(axes, states, strict=True):
        for ax, span in zip(line, spans, strict=True):
            here = rows[(rows.span == span) & (rows.state == state)]
            for method in style.ordered(here.method):
                chosen = here[(here.method == method) & (here.status == "done")]
                ax.loglog(chosen[column], chosen.error.clip(lower=1e-17), **style.of(method))
            ax.set_title(f"{TOPS[state].label}, t = {span:g}")
            ax.set_ylim(1e-16, 30)
        line[0].set_ylabel("error at the end")
    for ax in axes[-1]:
        ax.set_xlabel(label)
    style.legend_below(fig)
    fig.caption = (
        f"Error at the end of the run against {label}; each point is one step size or tolerance. Down and to the left "
        "is better. " + ("Set-up and compilation are not included." if column == "seconds" else "")
    ).strip()
    return fig


if __name__ == "__main__":
    raise SystemExit(engine.main("work_precision"))
