"""Tables and figures of the experiment `phase`. They have a file of their own, so an edit here makes no row old."""

import numpy as np
import pandas as pd
import scipy

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.orders import hides_leading_term
from lagrange_bench.experiments.measuring.reductions import largest
from lagrange_bench.experiments.phase_runs import PROMISE_H, SPAN, STATES
from lagrange_bench.integrators import METHODS

ROUND_OFF = 1e-12  # a smaller error is round-off
ON_TORUS = 1e-10  # a smaller error off the torus: the invariants are kept
SMALL = 0.1  # a larger error cannot be split to first order


@of_part(
    "",
    "Orders: claimed, and measured as the slope of the error of single steps against the step. Errors are relative to the "
    "scales of J and x; hidden: the leading term is too small to show",
)
def orders(good: pd.DataFrame) -> pd.DataFrame:
    """The measured order of each method with a step: from single steps, without them from the runs on each top."""
    table = []

    def enter(name: str, where: str, points: pd.DataFrame, order: float, stderr: float, used: int) -> None:
        measured = {"measured": order, "standard error": stderr, "points": used}
        # at such large steps the terms after a very small leading one still show: see `orders.hides_leading_term`
        excess = order - (METHODS[name].order or order)
        measured["hidden"] = hides_leading_term(float(points.h.min()), excess)
        sizes = {"smallest error": float(points.error.to_numpy().min()), "largest error": largest(points.error)}
        claimed = METHODS[name].order or "exact"
        table.append({"method": name, "state": where, "claimed": claimed, **measured, **sizes})

    single = good[good.part == "order"]
    for name, points in single.groupby("method", sort=False):
        if name in METHODS:
            few = len(points) < 4
            fit = None if few else scipy.stats.linregress(np.log(points.h), np.log(points.error))
            order, stderr = (np.nan, np.nan) if fit is None else (fit.slope - 1, fit.stderr)
            where = "short runs" if "run" in points and points.run.notna().any() else "single steps"
            enter(name, f"{where}, 8 tops", points, order, stderr, len(points))
    runs = good[(good.part == "h") & ~good.method.isin(set(single.method))]
    for (name, state), points in runs.groupby(["method", "state"], sort=False):
        if name in METHODS and METHODS[name].control == "step":
            fit = metrics.order(points.h.to_numpy(), points.error.to_numpy(), floor=1e-14, saturation=1e-3)
            enter(name, state, points, fit.p, fit.stderr, int(fit.mask.sum()))
    return pd.DataFrame(table)


@by_group(
    ("method", "state"),
    "time",
    "Phase errors of the runs against time, fitted as a constant shift of each frequency (relative for the nutation, radians per "
    "unit of time for the precession) and a residual, while the error is below 0.1",
)
def frequency_shifts(method: str, state: str, run: pd.DataFrame) -> dict:
    small = run[(run.error > SMALL).cumsum() == 0]
    t = small.t.to_numpy()
    nutation, precession = (metrics.frequency_shift(t, small[name].to_numpy()) for name in ("time", "angle"))
    return {
        "fitted up to t": float(t[-1]) if len(t) else np.nan,
        "relative time shift": nutation.slope,
        "time residual": nutation.residual_size,
        "precession shift": precession.slope,
        "angle residual": precession.residual_size,
        "error at the end of the run": run.error.iloc[-1],
    }


@of_part(
    "promise",
    "The exact step on every named top and many others, and the same without pins on tops of every kind and on those released "
    "with pure spin: for each step size the largest error, and how many ulps in the initial state would make the same error",
)
def promise(rows: pd.DataFrame) -> pd.DataFrame:
    rows = rows.assign(step=rows.h.where(rows.h.isin(PROMISE_H)).map("{:g}".format, na_action="ignore"))
    rows["step"] = rows.step.fillna("fractions of the nutation period")
    worst = rows.loc[rows.groupby(["method", "step"], sort=False).ulps.idxmax()]
    table = worst[["method", "step", "state", "error", "ulps"]].reset_index(drop=True)
    return table.rename(columns={"state": "worst top", "ulps": "ulps of the initial state"})


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
    tops = list(STATES["quick"]) if {*STATES["quick"]} <= {*stored} else stored[:2]
    fig, axes = style.figure("page", 3.6, ncols=len(tops), sharex=True, sharey=True, squeeze=False)
    best = best_of_families(rows[rows.state == tops[0]])
    for ax, state in zip(axes[0], tops, strict=True):
        draw_steps(ax, rows[rows.state == state], best, style)
        ax.set_title(style.plain(states.label(state)))
        ax.set_ylabel("" if ax is not axes[0, 0] else ax.get_ylabel())
    style.label_ends(axes[0] if fig.stacked is not None else axes[0][-1:])
    ours = rows[(rows.method == "backlund") & (rows.status == "done")].error
    if ours.max() < ROUND_OFF:
        fig.headline = "Any step: the error of the exact step stays at round-off"
    exact = "; the exact Bäcklund step has none, at any h" if (rows.method == "backlund").any() else ""
    fig.caption = (
        f"Largest error against the exact solution up to t = {SPAN:g}, relative to the scales of J and x, against the "
        f"step. {style.naming(rows.method, 'named: RK4, and of the families the best at a step of 1/8')}. "
        f"A method of order p has slope p{exact}. A line ends where its method fails. The thin grey line is one ulp."
    )
    return fig


def first_top(rows: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """The rows of the first top, and its label."""
    state = rows.state.iloc[0] if len(rows) else ""
    return rows[rows.state == state], states.label(state)


def draw_steps(ax, rows: pd.DataFrame, best: list[str], style) -> None:
    """Draw the error of every method against the step, on one top, into one panel; the methods `best` are bold."""
    here = rows[(rows.part == "h") & rows.h.notna()].sort_values("h")
    for method, look in style.looks(here.method, best).items():
        chosen = here[(here.method == method) & (here.error > 0)]
        if not chosen.empty:
            ax.loglog(chosen.h, chosen.error, **look, zorder=1.5 if look["label"] == "_thin" else 3)
        elif not look["label"].startswith("_"):
            style.failed_label(ax, method)
    style.ulp_line(ax)
    ax.set(xlabel=style.STEP, ylabel=f"largest error up to t = {SPAN:g}", ylim=(1e-16, 30))


def best_of_families(rows: pd.DataFrame) -> list[str]:
    """RK4, then from each family the method with the smallest error at the step nearest to 1/8, the best first."""
    from lagrange_bench.experiments.drawing import style

    good = rows[(rows.part == "h") & (rows.status == "done") & rows.error.notna() & rows.h.notna()]
    if good.empty:
        return []
    near = good.h.unique()[np.argmin(np.abs(np.log(8 * good.h.unique())))]
    runs = good[good.h == near].assign(family=lambda rows: rows.method.map(style.family))
    best = runs.loc[runs.groupby("family").error.idxmin()].sort_values("error").method
    return list(dict.fromkeys(["rk4", *best]))


@of_part("h", failed=True)
def _draw_families(rows: pd.DataFrame, style):
    here, top = first_top(rows[rows.h.notna()])
    if here.empty:
        return None
    ylabel = f"largest error up to t = {SPAN:g}"
    fig, _ = style.by_family(here, "h", "error", style.STEP, ylabel, (1e-16, 1e5))
    fig.caption = (
        f"Largest error against the exact solution up to t = {SPAN:g} on “{top}”, against the step; a panel "
        "for each family of methods; pale blue: the exact Bäcklund step. "
        "Crosses, in its colour: a method declined the step or failed."
    )
    return fig


@of_part("time", failed=True)
def _draw_time(rows: pd.DataFrame, style):
    here, top = first_top(rows)
    lines = [here[here.status != "done"][["method", "status"]]]
    for method, run in here[here.status == "done"].groupby("method", sort=False):
        t, largest = metrics.block_maxima(run.t, run.time, blocks=30)
        shown = {"t": t, "time": np.where(largest > 0, largest, np.nan)}
        lines.append(pd.DataFrame({"method": method, "status": "done", **shown}))
    runs = here[here.status == "done"].groupby("method")
    lost = (runs.off.max() < ON_TORUS) & (runs.time.agg(lambda error: error.abs().max()) > SMALL)
    ylabel = "|nutation phase error|"
    fig, _ = style.by_family(pd.concat(lines), "t", "time", style.TIME, ylabel, (1e-17, 1e4), marker="none")
    if lost.any():
        fig.headline = "To keep every invariant is not enough: the clock drifts"
    fig.caption = (
        "Phase error against time at step 1/4, or the default tolerance: the time by which the nutation is early or late, "
        "in units of 1/(|J| + √(|α||x|)), largest over blocks of time; pale blue: the exact Bäcklund step. A straight line of "
        "slope 1 is a constant shift of frequency, slope 2 one that drifts; of the order of one, the phase is lost. The "
        f"precession and the other tops are in the table of frequency shifts. The top is “{top}”."
    )
    return fig


@of_part("theory")
def _draw_theory(rows: pd.DataFrame, style):
    if "left" not in rows:
        return None
    here, top = first_top(rows[rows.error > 0])

    def line(ax, method, look):
        run = here[here.method == method]
        run = run[run.h == run.h.max()]
        if run.empty:
            return
        predicted, measured = np.hypot(run.predicted_time, run.predicted_angle), np.hypot(run.time, run.angle)
        dots = {"linestyle": "none", "marker": "o", "markersize": 2.6, "label": "_measured"}
        dotted = {"linewidth": 0.9, "linestyle": (0, (1, 2)), "marker": "none", "label": "_left"}
        ax.loglog(run.t, predicted, **{**look, "linestyle": "-", "marker": "none"})
        ax.loglog(run.t, measured, **{**look, **dots})
        ax.loglog(run.t, run.left.cummax(), **{**look, **dotted})

    fig, axes = style.multiples(here.method, line, style.TIME, "phase error", (1e-17, 1e0))
    style.label_ends(axes)
    fig.caption = (
        f"Phase errors against time, measured (dots) and predicted by backward error analysis (lines under them), on “{top}”, "
        "each method at the larger of its two steps: √(τ² + θ²), where τ is the nutation's error in units of time and θ the "
        "precession's in radians. Dotted: what the prediction misses, the largest so far of the whole state."
    )
    return fig


tables = tabulated(orders, frequency_shifts, promise, theory)
draw = drawn(h=_draw_h, families=_draw_families, time=_draw_time, theory=_draw_theory)
