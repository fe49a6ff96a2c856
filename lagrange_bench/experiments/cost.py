"""Cost: how much time do a step and a set-up take?

Timing cells run one at a time in one process. Samples are calibrated and repeated; quote the minimum. The headline runs the exact
Bäcklund step and heyoka in turn, over the same time, from the same state. Times and steps are in units of
1/(|J| + √(|alpha||x|)).
"""

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.states import (
    ACCURACY_OPTIONS,
    accuracy_settings,
    find,
    interpreted,
    methods_on,
    options_of,
    rounded,
)
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.api import integrate
from lagrange_bench.integrators.truth import exact

VERSION = 4
SCALED_TIMES = ("step", "periods")  # parts
A_STEP = ("ns_per_step", "ns_per_step_median", "setup_us")  # the least time and the median, in ns; least set-up in µs
MEASURED = {
    "step": A_STEP,
    "periods": A_STEP,
    "headline": ("h", "steps", "backlund_s", "heyoka_s", "ratio", "backlund_error", "heyoka_error"),
}

STATE = "generic"
STEPS = {"quick": (1 / 16,), "full": tuple(2.0**k for k in range(-8, 3, 2))}
TOLERANCES = {"quick": (1e-9,), "full": (1e-3, 1e-6, 1e-9, 1e-12, 1e-14)}
ROUNDS = {"quick": 1, "full": 2}
REPEATS = 5
PERIODS = {"quick": (1.0,), "full": (0.3, 0.49, 0.51, 1.0, 1.3, 2.5)}  # steps of the exact one, in nutation periods
HEADLINE_TIME = 1e6  # of cells without a `time`
HEADLINES = {  # h as a fraction of the nutation period
    "quick": ({"fraction": 0.5, "time": 1e5},),
    "full": tuple({"fraction": fraction} for fraction in (0.125, 0.5, 0.95, 2.5)),
}
# kind of method → steps in one call of `advance`: so many that the cost of the call itself does not matter
CALL = {"step": 20_000, "tolerance": 1000, "interpreted": 100}


def cells(profile: str) -> list[dict]:
    all_cells: list[dict] = []
    for round_ in range(ROUNDS[profile]):
        for name, method in methods_on().items():
            step = {"part": "step", "method": name, "round": round_, "repeats": REPEATS}
            all_cells += [
                {**step, **setting} for setting in accuracy_settings(method, STEPS[profile], TOLERANCES[profile])
            ]
    all_cells += [{"part": "periods", "method": "backlund", "periods": p, "repeats": REPEATS} for p in PERIODS[profile]]
    all_cells += [{"part": "headline", "method": "taylor", **race} for race in HEADLINES[profile]]
    return [{"timing": True, **cell} for cell in all_cells]


def measure(cell: dict) -> list[dict]:
    return _measure_headline(cell) if cell["part"] == "headline" else _measure_step(cell)


def _measure_step(cell: dict) -> list[dict]:
    top, y0 = find(cell.get("state", STATE))
    unit = top.scales(y0)[2]
    options = options_of(cell)
    h = cell["periods"] * exact.nutation_period(top, y0) if "periods" in cell else cell.get("h", 1.0) * unit
    stepper = prepare(top, y0, h, cell["method"], **options)
    n = CALL["interpreted" if interpreted(METHODS[cell["method"]]) else METHODS[cell["method"]].control]
    stepper.advance(y0, n)
    steps = stepper.work.steps
    timed = timing.time_call(lambda: stepper.advance(y0, n), repeats=cell["repeats"])
    setups = [prepare(top, y0, h, cell["method"], **options).work.setup_seconds for _ in range(5)]
    return [
        {
            "ns_per_step": rounded(timed.min() / steps * 1e9),
            "ns_per_step_median": rounded(float(np.median(timed)) / steps * 1e9),
            "setup_us": rounded(min(setups) * 1e6),
        }
    ]


def _measure_headline(cell: dict) -> list[dict]:
    """The exact step and raw heyoka at tol = eps over a long time, timed in turn, with the errors of both."""
    top, y0 = find(STATE)
    unit = top.scales(y0)[2]
    t = cell.get("time", HEADLINE_TIME) * unit
    steps = round(t / (cell["fraction"] * exact.nutation_period(top, y0)))
    h = t / steps
    raw = raw_heyoka(top, y0)
    runs = {
        "backlund": lambda: integrate(top, y0, h, steps, "backlund", every=steps).y[-1],
        "heyoka": lambda: raw(t),
    }
    runs["backlund"]()  # compiled before the first sample
    repeats = 3 if t >= HEADLINE_TIME * unit else 9  # the ratio of two short runs is noisier
    timed = timing.interleave(runs, repeats=repeats)
    right = {"backlund": exact.after_steps(top, y0, h, [steps])[0], "heyoka": exact.solution(top, y0, t)}
    errors = {name: metrics.scaled_error(top, y0, runs[name](), y) for name, y in right.items()}
    return [
        {
            "h": rounded(h / unit),
            "steps": steps,
            "backlund_s": rounded(timed["backlund"].min()),
            "heyoka_s": rounded(timed["heyoka"].min()),
            "ratio": rounded(float(np.median(timed["heyoka"] / timed["backlund"]))),
            **{f"{name}_error": rounded(float(error)) for name, error in errors.items()},
        }
    ]


def raw_heyoka(top, y0):
    """heyoka without this bench, as in its documentation: a function t → state."""
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


# ---------------------------------------------------------------- tables and figures


def quickest(steps: pd.DataFrame) -> pd.DataFrame:
    """The least of every number over all rounds, for each method and step or tolerance."""
    columns = [name for name in ACCURACY_OPTIONS if name in steps]
    return steps.groupby(["method", *columns], sort=False, dropna=False).min(numeric_only=True).reset_index()


PRICES = {"ns_per_step": "ns per step", "setup_us": "set-up of a stepper, µs"}


@of_part("step")
def _draw_steps(steps: pd.DataFrame, style):
    """Draw a row for each method, by family, and within a family from cheap to dear."""
    level = steps.groupby("method").ns_per_step.min()
    families = [*style.FAMILIES, style.OTHERS]
    names = sorted(level.index, key=lambda name: (families.index(style.family(name)), level[name]))
    fig, axes = style.figure("page", 0.9 + 0.155 * len(names), ncols=len(PRICES), sharey=True)
    places = np.arange(len(names))[::-1]
    least = quickest(steps).groupby("method")
    for ax, (column, text) in zip(axes, PRICES.items(), strict=True):
        ends = least[column].agg(["min", "max"]).loc[names]
        colours = [style.bold(name)["color"] for name in names]
        ax.hlines(places, ends["min"], ends["max"], colors=colours, linewidth=2.2, alpha=0.35)
        ax.scatter(ends["min"], places, c=colours, s=14, zorder=3)
        ax.set_xscale("log")
        ax.margins(x=0.1)  # no dot across the edge
        ax.set_xlabel(text)
        for first, second in zip(range(len(names) - 1), range(1, len(names)), strict=True):
            if style.family(names[first]) != style.family(names[second]):
                ax.axhline(places[first] - 0.5, color="#d5d5d5", linewidth=0.6)
    axes[0].set_yticks(places, [style.of(name)["label"] for name in names])
    axes[0].set_ylim(-0.7, len(names) - 0.3)
    fig.caption = (
        "What a step and a set-up cost, by family: the dot is the least of all step sizes or tolerances tried, the bar "
        "reaches to the most. One trajectory; minima of repeated samples, compilation not included. What a given error "
        "costs is in `work_precision`."
    )
    return fig


tables = tabulated()
draw = drawn(steps=_draw_steps)
