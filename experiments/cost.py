"""Cost: what a step, a unit of time, a set-up and a compilation take.

Timing cells run one at a time in one process; samples are calibrated and repeated, the minimum is the figure to quote.
Compilation is timed in fresh processes, once with nothing cached and once as the next process finds it. The headline
runs the exact Bäcklund step and heyoka in turn, over the same time, from the same state.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

import numpy as np
import pandas as pd

from experiments import engine, metrics, timing
from experiments.states import find, options_of, rounded
from integrators import METHODS, exact, integrate, prepare

VERSION = 1

STATE = "generic"
STEPS = {"quick": (1 / 16, 1.0), "full": tuple(2.0**k for k in range(-8, 3))}
TOLERANCES = {"quick": (1e-6, 1e-12), "full": tuple(10.0**-k for k in range(3, 15))}
ROUNDS = {"quick": 1, "full": 3}
START = {"quick": ("backlund", "taylor", "implicit_midpoint"), "full": ()}  # none: all
HEADLINE_TIME = 1e6
HEADLINE_STEPS = {"quick": (0.5,), "full": (0.125, 0.5, 0.95, 2.5)}  # in nutation periods


def cells(profile: str) -> list[dict]:
    listed: list[dict] = []
    for round_ in range(ROUNDS[profile]):
        for method in METHODS:
            knobs = [{"h": h} for h in STEPS[profile]]
            if METHODS[method].control == "tolerance":
                name = "rtol" if method.startswith("rk45") else "tol"
                knobs = [{name: tol} for tol in TOLERANCES[profile] if name == "tol" or tol > 1e-13]
            listed += [{"part": "step", "method": method, "round": round_, **knob} for knob in knobs]
    for method in START[profile] or METHODS:
        listed += [{"part": "start", "method": method, "cached": cached} for cached in (False, True)]
    for fraction in HEADLINE_STEPS[profile]:
        listed.append({"part": "headline", "method": "taylor", "fraction": fraction})
    return [{"timing": True, **cell} for cell in listed]


def measure(cell: dict) -> list[dict]:
    return {"step": _measure_step, "start": _measure_start, "headline": _measure_headline}[cell["part"]](cell)


def _measure_step(cell: dict) -> list[dict]:
    top, y0 = find(STATE)
    unit = top.scales(y0)[2]
    options = options_of(cell)
    h = cell.get("h", 1.0) * unit
    stepper = prepare(top, y0, h, cell["method"], **options)
    compiled = METHODS[cell["method"]].control == "step"
    n = 20_000 if compiled else 100 if cell["method"].startswith("rk45") else 1000
    stepper.advance(y0, 10)
    before = (stepper.work.steps, stepper.work.rhs_evals, stepper.work.iterations, stepper.work.rejected)
    stepper.advance(y0, n)
    after = (stepper.work.steps, stepper.work.rhs_evals, stepper.work.iterations, stepper.work.rejected)
    steps, evals, iterations, rejected = (b - a for a, b in zip(before, after, strict=True))
    timed = timing.time_call(lambda: stepper.advance(y0, n), repeats=5)
    setups = [prepare(top, y0, h, cell["method"], **options).work.setup_seconds for _ in range(5)]
    return [
        {
            "ns_per_step": rounded(timed.min / steps * 1e9),
            "ns_per_step_median": rounded(timed.median / steps * 1e9),
            "ns_per_time": rounded(timed.min / (n * h) * 1e9),
            "steps_per_time": rounded(steps / (n * h)),
            "evals_per_step": rounded(evals / steps),
            "iterations_per_step": rounded(iterations / steps),
            "rejected_per_step": rounded(rejected / steps),
            "setup_us": rounded(min(setups) * 1e6),
            "unstable": timed.unstable,
        }
    ]


PROBE = """
import json, sys, time
start = time.perf_counter()
from integrators import TOPS, prepare
imported = time.perf_counter()
if sys.argv[2] == "cold" and sys.argv[1].startswith("taylor"):
    try:
        import heyoka
        heyoka.llvm_state.set_diskcache_enabled(False)
    except ImportError:
        pass
named = TOPS["generic"]
seconds = []
for _ in range(2):
    begin = time.perf_counter()
    prepare(named.top, named.state, 0.1, sys.argv[1]).advance(named.state, 1)
    seconds.append(time.perf_counter() - begin)
print(json.dumps({"import_s": imported - start, "first_s": seconds[0], "second_s": seconds[1]}))
"""


def _measure_start(cell: dict) -> list[dict]:
    """Import, first and second use in a fresh process; "cached": as a second process finds the caches."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "LAGRANGE_BENCH_CACHE": folder, "HEYOKA_CACHE_DIR": folder}
        kinds = ("warm", "warm") if cell["cached"] else ("cold",)
        for kind in kinds:
            command = [sys.executable, "-c", PROBE, cell["method"], kind]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            if done.returncode:
                raise RuntimeError(f"the probe process failed: {done.stderr.strip().splitlines()[-1:]}")
    return [{name: rounded(value) for name, value in json.loads(done.stdout.splitlines()[-1]).items()}]


def _measure_headline(cell: dict) -> list[dict]:
    """The exact step against raw heyoka at tol = eps over t = 10⁶, interleaved, with the errors of both."""
    top, y0 = find(STATE)
    steps = round(HEADLINE_TIME / (cell["fraction"] * exact.nutation_period(top, y0)))
    h = HEADLINE_TIME / steps
    raw = raw_heyoka(top, y0)
    natural = prepare(top, y0, HEADLINE_TIME, "taylor")

    def backlund():
        return integrate(top, y0, h, steps, "backlund").y[-1]

    def heyoka():
        return raw(HEADLINE_TIME)

    def adapter():
        return natural.advance(y0, 1)

    backlund()  # compiled before the first sample
    timed = timing.interleave({"backlund": backlund, "heyoka": heyoka, "adapter": adapter}, repeats=3)
    truth = exact.solution(top, y0, HEADLINE_TIME)
    seconds = {name: t.min for name, t in timed.timings.items()}
    return [
        {
            "h": rounded(h),
            "steps": steps,
            "backlund_s": rounded(seconds["backlund"]),
            "heyoka_s": rounded(seconds["heyoka"]),
            "ratio": rounded(float(np.median(timed.ratios("heyoka", "backlund")))),
            "adapter_ratio": rounded(float(np.median(timed.ratios("adapter", "heyoka")))),
            "backlund_error": rounded(float(metrics.scaled_error(top, y0, backlund(), truth))),
            "heyoka_error": rounded(float(metrics.scaled_error(top, y0, heyoka(), truth))),
        }
    ]


def raw_heyoka(top, y0):
    """heyoka with nothing around it: the function t → state, as its documentation would have it written."""
    import heyoka as hy

    J1, J2, J3, x1, x2, x3 = hy.make_vars("J1", "J2", "J3", "x1", "x2", "x3")
    system = [
        (J1, -hy.par[0] * x2),
        (J2, hy.par[0] * x1),
        (J3, hy.expression(0.0)),
        (x1, J2 * x3 - J3 * x2),
        (x2, J3 * x1 - J1 * x3),
        (x3, J1 * x2 - J2 * x1),
    ]
    ta = hy.taylor_adaptive(system, list(y0), pars=[top.alpha], compact_mode=False)

    def run(t):
        ta.time = 0.0
        ta.state[:] = y0
        outcome = ta.propagate_until(t)[0]
        if outcome != hy.taylor_outcome.time_limit:
            raise RuntimeError(f"heyoka stopped: {outcome}")
        return ta.state.copy()

    return run


# ------------------------------------------------------------------------------------------ what the rows say


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    good = rows[rows.status == "done"]
    found = {}
    steps = good[good.part == "step"]
    if not steps.empty:
        columns = [name for name in ("h", "tol", "rtol") if name in steps]
        measured = ["ns_per_step", "ns_per_time", "steps_per_time", "evals_per_step", "iterations_per_step", "setup_us"]
        groups = steps.groupby(["method", *columns], sort=False, dropna=False)
        found["steps"] = groups[measured].min().reset_index().dropna(axis=1, how="all")
    start = good[good.part == "start"]
    if not start.empty:
        wide = start.pivot(index="method", columns="cached", values=["import_s", "first_s", "second_s"])
        table = pd.DataFrame(
            {
                "import, s": wide[("import_s", True)],
                "first use, nothing cached, s": wide[("first_s", False)],
                "first use, cached, s": wide[("first_s", True)],
                "second use, s": wide[("second_s", True)],
            }
        )
        found["start"] = table.loc[list(dict.fromkeys(start.method))].reset_index()
    headline = good[good.part == "headline"]
    if not headline.empty:
        columns = ["h", "steps", "backlund_s", "heyoka_s", "ratio", "adapter_ratio", "backlund_error", "heyoka_error"]
        found["headline"] = headline[["fraction", *columns]].rename(columns={"fraction": "h / nutation period"})
    return found


def draw(rows: pd.DataFrame) -> dict:
    from report import style

    steps = rows[rows.part == "step"]
    if steps.empty:
        return {}
    fig, (left, right) = style.figure("page", 3.4, ncols=2)
    for method in style.ordered(steps.method):
        chosen = steps[(steps.method == method) & (steps.status == "done")]
        if chosen.empty:
            continue
        if chosen.h.notna().any():
            best = chosen.groupby("h")[["ns_per_step", "ns_per_time"]].min()
            left.loglog(best.index, best.ns_per_step, **style.of(method))
            right.loglog(best.index, best.ns_per_time, **style.of(method))
        else:
            level = chosen.ns_per_time
            right.axhspan(
                level.min(), level.max(), color=style.of(method)["color"], alpha=0.25, label=None, linewidth=0
            )
            right.annotate(
                style.label(method), (0.98, float(level.max())), (0, -2), textcoords="offset points",
                xycoords=("axes fraction", "data"), fontsize=7, va="top", ha="right",
            )  # fmt: skip
    for ax, text in ((left, "ns per step"), (right, "ns per unit of time")):
        ax.set_xlabel("step h · (|J| + √(α|x|))")
        ax.set_ylabel(text)
    left.set_ylim(10, 1000)
    style.legend_below(fig)
    fig.caption = (
        "Left: time per step against h; implicit methods iterate more at larger h. Right: time per unit of time; the "
        "bands are the methods that choose their own steps, over the tolerances tried. Minima of repeated samples."
    )
    return {"steps": fig}


if __name__ == "__main__":
    raise SystemExit(engine.main("cost"))
