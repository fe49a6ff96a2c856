"""Phase: how far is the top from its true place on the torus?

A method that conserves every invariant can still be anywhere on the torus. The error against the exact solution is split along
the two flows of the torus: a time error (nutation phase) and an angle error (precession phase). The rest is drift off the torus.
Orders are measured on single steps.

Part “promise” tests the exact Bäcklund step: its error must be no larger than an initial state changed by some ulps would make.
It runs on every named top, on 400 others, on 300 that are released with pure spin, and on 32 close to the separatrix (quick
profile: 32, 32 and 8). On tops of every kind and on released ones it also runs without pins.

Part “theory” compares other methods with backward error analysis: `predicted_phase` predicts their phases. Times are in units of
1/(|J| + √(|alpha||x|)).
"""

from itertools import product

import numpy as np
import pandas as pd
import scipy

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.orders import SPANS as ORDER_SPANS
from lagrange_bench.experiments.measuring.orders import hides_leading_term, order_points
from lagrange_bench.experiments.measuring.reductions import largest
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.backward_error.prediction import NoPrediction, predicted_phase
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.truth import exact

# tops of the runs against h, and the length of these
STATES = ("generic", "through_pole")
SPAN = 64.0
PROMISE_H = (0.03, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 7.0, 11.0)  # steps of the part “promise”


VERSION = 3
SCALED_TIMES = True
MEASURED = {
    "h": ("time", "angle", "off", "error"),
    "order": ("h", "error"),
    "time": ("t", "time", "angle", "off", "error"),
    "promise": ("h", "error", "ulps"),
    "theory": ("t", "error", "left", "clock", "turn", "clock_growth", "turn_growth"),
}

STEPS = {"quick": tuple(2.0**-k for k in range(7)), "full": tuple(2.0 ** (-k / 2) for k in range(-6, 19))}
LONG = {"quick": (0.25, 10**4), "full": (0.25, 4 * 10**6)}  # step and number of steps of the runs against time
LONG_STATE = "generic"
PROMISE_STEPS = 2000  # steps of each size
PROMISE_TURNS = (0.25, 0.49, 0.5, 1.0, 1.5)  # sizes beside PROMISE_H, as fractions of the nutation period
PROMISE_RANDOM = {"quick": 16, "full": 200}  # tops of each drawn kind, at most
UNSTABLE_SPAN = 20.0  # length of the runs on orbits without a period: errors grow exponentially there
THEORY_STATES = {"quick": ("generic",), "full": ("generic", "figure1", "fast", "through_pole")}
THEORY_SPAN = 512.0  # length of the runs that are compared with theory


def cells(profile: str) -> list[dict]:
    methods = states.methods_on()
    stepping = {name: method.order for name, method in methods.items() if method.control == "step"}
    on = [{"method": name, "state": state} for state in STATES for name in stepping]
    all_cells: list[dict] = [{"part": "h", **each, "h": h} for each in on for h in STEPS[profile]]
    all_cells += [{"part": "order", "method": name} for name, order in stepping.items() if order is not None]
    h, steps = LONG[profile]
    for name, method in methods.items():
        n = states.affordable(method, steps, profile == "full")
        all_cells.append({"part": "time", "method": name, "state": LONG_STATE, "h": h, "steps": n})
    for state, (name, order) in product(THEORY_STATES[profile], stepping.items()):
        all_cells += [{"part": "theory", "method": name, "state": state, "h": h} for h in theory_steps(order)]
    count = PROMISE_RANDOM[profile]
    any_kind = (*states.WIDE[:count], *states.RELEASED[:count], *states.SPINNING[:count])
    tops = (*TOPS, *(f"random{i:03d}" for i in range(count)), *states.CLOSE[: count // 2], *any_kind)
    promised = (*product(("backlund",), tops), *product(("backlund_unpinned",), any_kind))
    return all_cells + [{"part": "promise", "method": method, "state": state} for method, state in promised]


def measure(cell: dict) -> list[dict]:
    if cell["part"] == "order":
        return _one_step(cell["method"])
    top, y0 = states.of_cell(cell)
    if cell["part"] == "promise":
        return promised_errors(top, y0, cell["method"])
    if cell["part"] == "theory":
        return _against_theory(cell, top, y0)
    if cell["part"] == "h":
        errors = _followed(cell, top, y0, states.places(max(round(SPAN / cell["h"]), 1)))[2]
        return [{name: states.rounded(np.max(np.abs(e))) for name, e in errors.items()}]
    times, _, errors = _followed(cell, top, y0, states.log_counts(cell["steps"], per_octave=4))
    return states.as_rows({"t": times * top.scales(y0)[0], **errors})


def _one_step(name: str) -> list[dict]:
    """Errors of single steps above round-off, as geometric means over eight tops and both signs of h.

    Single steps show the order: in long runs a method of high order may show the next order, or round-off. If a step depends on
    earlier ones, short runs are made, and their errors divided by the number of steps.
    """
    points = order_points(METHODS[name], ORDER_SPANS)
    return states.as_rows({"h": points.spans, "error": points.errors})


def theory_steps(order: int | None) -> tuple[float, ...]:
    """Two steps at which a method of this order has a small error above round-off in runs of `THEORY_SPAN`."""
    return () if order is None else tuple(states.rounded(2.0 ** (k + 1 - 15 / order)) for k in (1, 0))


def _against_theory(cell: dict, top, y0) -> list[dict]:
    """Errors of a run, the distance of its states from the predicted ones (`left`), and what is predicted of its phases."""
    rate, _, unit = top.scales(y0)
    try:
        predicted = predicted_phase(top, y0, cell["h"] * unit, METHODS[cell["method"]])
    except NoPrediction as reason:
        return [{"reason": str(reason)}]
    times, y, errors = _followed(cell, top, y0, states.log_counts(round(THEORY_SPAN / cell["h"]), per_octave=1))
    left = metrics.scaled_error(top, y0, y, predicted.states(times))
    columns = {"t": times * rate, "error": errors["error"], "left": left}
    rates = {"clock": predicted.clock, "turn": predicted.turn * unit}
    rates |= {"clock_growth": predicted.clock_growth * unit, "turn_growth": predicted.turn_growth * unit * unit}
    rates = {name: states.rounded(value) for name, value in rates.items()}
    return [row | rates for row in states.as_rows(columns)]


def _followed(cell: dict, top, y0, counts: list[int]) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Times, states and scaled errors: of time and angle (in radians of their own phase), off the torus, and of the whole state.

    Only a top in a uniform field has a known torus. Any other problem has the error of the whole state alone.
    """
    h, method = cell["h"] * top.scales(y0)[2], METHODS[cell["method"]]
    times, y = states.sample(top, y0, cell["method"], h, counts, **states.options_of(cell))
    truth = states.truth(top, y0, method, h, counts)
    whole = metrics.scaled_error(top, y0, y, truth)
    if not kinds.uniform(top):
        return times, y, {"error": whole}
    split = metrics.phase_split(top, truth, y - truth)
    time = split["time"] * top.scales(y0)[0]
    return times, y, {"time": time, "angle": split["angle"], "off": split["off"], "error": whole}


def promised_errors(top, y0, method) -> list[dict]:
    """For each step size: the largest error at twenty places of 2000 steps, and the ulps of y0 that make the same error."""
    rate, _, unit = top.scales(y0)
    period = exact.nutation_period(top, y0) * rate
    has_period, rows = np.isfinite(period), []
    for h in (*PROMISE_H, *(period * part for part in PROMISE_TURNS if has_period)):
        steps = PROMISE_STEPS if has_period else max(int(UNSTABLE_SPAN / unit / h), 1)
        counts = states.places(steps, 20)
        times, y = states.sample(top, y0, method, h * unit, counts)
        error = metrics.scaled_error(top, y0, y, exact.after_steps(top, y0, h * unit, counts))
        ulps = error / (metrics.condition(top, y0, times) * np.finfo(float).eps)
        rows.append({"h": h, "error": states.rounded(np.max(error)), "ulps": states.rounded(np.max(ulps))})
    return rows


# ---------------------------------------------------------------- tables and figures


FEWEST = 4  # steps that show an order
ROUND_OFF = 1e-12  # a smaller error is round-off
ON_TORUS = 1e-10  # a smaller error off the torus: the invariants are kept
SMALL = 0.1  # a larger phase error: the phase is lost


@by_group(
    ("method",),
    "order",
    "Orders: claimed, and measured on eight tops as the slope of the error of single steps against the step (of short runs, if "
    "a step depends on earlier ones). Errors are relative to the scales of J and x; hidden: the leading term is too small to "
    "show",
)
def orders(method: str, points: pd.DataFrame) -> dict:
    """The measured order of each method with a step, from single steps."""
    if method not in METHODS:
        return {}
    order, stderr, claimed = np.nan, np.nan, METHODS[method].order
    if len(points) >= FEWEST:
        fit = scipy.stats.linregress(np.log(points.h), np.log(points.error))
        order, stderr = fit.slope - 1, fit.stderr
    return {
        "claimed": claimed,
        "measured": order,
        "standard error": stderr,
        "points": len(points),
        # at such large steps the terms after a very small leading one still show: see `orders.hides_leading_term`
        "hidden": hides_leading_term(float(points.h.min()), order - claimed),
    }


RANGE = (1e-9, 1e-2)  # errors above round-off and of first order: they show how good the theory is


@by_group(
    ("method", "state", "h"),
    "theory",
    "Predicted phases: by how much the clock (nutation) is fast, and by how many radians the turn (precession) is too wide, per "
    "unit of time; how these two grow per unit of time; the largest error of the run, what the prediction leaves of it, and "
    "that share",
)
def theory(method: str, state: str, h: float, run: pd.DataFrame) -> dict:
    first = run.iloc[0]
    if pd.notna(first.get("reason")):
        return {"reason": first.reason}
    rates = {name.replace("_", " "): first[name] for name in ("clock", "turn", "clock_growth", "turn_growth")}
    error, left = largest(run.error), largest(run.left)
    judged = not (error < RANGE[0] or error > RANGE[1])  # a run that failed (NaN) is judged, too
    return {**rates, "error": error, "left": left, "share left": left / error, "in range": judged}


@of_part("h", failed=True)
def _draw_h(rows: pd.DataFrame, style):
    """Draw the page's first figure. Every method is a thin line; one of each family is bold and named."""
    stored = list(dict.fromkeys(rows.state))
    tops = list(STATES) if {*STATES} <= {*stored} else stored[:2]
    titles = [style.plain(states.label(state)) for state in tops]
    ylabel = f"largest error up to t = {SPAN:g}"
    fig, axes = style.panels(titles, 2, (0.0, 3.6), style.STEP, ylabel, sharex=True, sharey=True)
    first = rows[(rows.state == tops[0]) & (rows.status == "done")]
    best = ["rk4", "strang", *style.best_of_families(first[first.h == 1 / 8].set_index("method").error)]
    for ax, state in zip(axes, tops, strict=True):
        style.draw_methods(ax, rows[(rows.state == state) & ~(rows.error <= 0)], "h", "error", best)
        style.ulp_line(ax)
        ax.set_ylim(1e-16, 30)
    style.legend_below(fig)
    ours = rows[(rows.method == "backlund") & (rows.status == "done")].error
    if ours.max() < ROUND_OFF:
        fig.headline = "Any step: the error of the exact step stays at round-off"
    exact = "; the exact Bäcklund step has none, at any h" if (rows.method == "backlund").any() else ""
    fig.caption = (
        f"Largest error against the exact solution up to t = {SPAN:g}, relative to the scales of J and x, against the "
        f"step. {style.naming(rows.method, 'named: RK4, Strang, and of the families the best at a step of 1/8')}. "
        f"A method of order p has slope p{exact}. A line ends where its method fails. The thin grey line is one ulp."
    )
    return fig


@of_part("time", failed=True)
def _draw_time(rows: pd.DataFrame, style):
    of_state = rows[rows.state == rows.state.iloc[0]]
    done = of_state[of_state.status == "done"]
    runs = done.groupby("method")
    far = runs.time.agg(largest)
    so_far = of_state.time.abs().groupby(of_state.method).cummax()
    fig, ax = style.figure("page", 3.8)
    named = ["rk4", "strang", *style.best_of_families(runs.time.last().abs())]
    style.draw_methods(ax, of_state.assign(time=so_far.where(so_far > 0)), "t", "time", named)
    ax.set(xlabel=style.TIME, ylabel="|nutation phase error|", ylim=(1e-17, 1e4))
    style.legend_below(fig)
    if ((runs.off.max() < ON_TORUS) & (far > SMALL)).any():
        fig.headline = "To keep every invariant is not enough: the clock drifts"
    fig.caption = (
        "Phase error against time at step 1/4, or the default tolerance: the time by which the nutation is early or late, "
        "in units of 1/(|J| + √(|α||x|)), the largest so far. "
        f"{style.naming(of_state.method, 'named: RK4, Strang, and of the families the best at the end')}. A straight line of "
        "slope 1 is a constant shift of frequency, slope 2 one that drifts; of the order of one, the phase is lost. The top is "
        f"“{states.label(of_state.state.iloc[0])}”."
    )
    return fig


tables = tabulated(orders, theory)
draw = drawn(h=_draw_h, time=_draw_time)
