"""Phase: where on its torus is the top, compared with where it should be?

A method that conserves every invariant can still be anywhere on the torus. The error against the exact solution is
split along the two flows of the torus: a time error (nutation phase) and an angle error (precession phase); what is
left is drift off the torus. Against h the slope of these errors is the measured order; against time they split into a
constant frequency shift and a residual. A third part holds the exact Bäcklund step to its promise, on every named
top and on two hundred others. Times are in units of 1/(|J| + √(|alpha||x|)).
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments import engine, metrics
from experiments.states import find, log_counts, options_of, rounded, sample
from integrators import exact
from integrators.top import TOPS

VERSION = 1

STATES = ("generic", "figure1", "fast", "through_pole")
SPAN = 64.0  # length of the runs against h
STEPS = {"quick": tuple(2.0**-k for k in range(0, 7)), "full": tuple(2.0**-k for k in range(-3, 9))}
TOLERANCES = {"quick": (1e-4, 1e-8, 1e-12), "full": tuple(10.0**-k for k in range(3, 16))}
RTOLS = {"quick": (1e-4, 1e-8), "full": tuple(10.0**-k for k in range(3, 13))}
LONG = {"quick": (0.25, 10**4), "full": (0.25, 4 * 10**6)}  # step and number of steps of the runs against time
LONG_SLOW = {"quick": 10**3, "full": 4 * 10**4}  # the same for SciPy, a thousand times slower per step
LONG_STATES = {"quick": ("generic",), "full": ("generic", "figure1", "near_separatrix")}
PROMISE_STEPS = 2000  # real steps, of each of these sizes
PROMISE_H = (0.03, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 7.0, 11.0)
PROMISE_TURNS = (0.25, 0.49, 0.5, 1.0, 1.5)  # and of these fractions of the nutation period
PROMISE_RANDOM = {"quick": 16, "full": 200}
UNSTABLE_SPAN = 20.0  # on the homoclinic orbit the promise ends here: errors grow exponentially


def cells(profile: str) -> list[dict]:
    from integrators import METHODS

    listed = []
    for method in METHODS:
        for state in STATES:
            for knob in _knobs(method, METHODS[method].control, profile):
                listed.append({"part": "h", "method": method, "state": state, **knob})
        h, steps = LONG[profile]
        steps = LONG_SLOW[profile] if method == "rk45" else steps
        for state in LONG_STATES[profile]:
            listed.append({"part": "time", "method": method, "state": state, "h": h, "steps": steps})
    for state in (*TOPS, *(f"random{i:03d}" for i in range(PROMISE_RANDOM[profile]))):
        listed.append({"part": "promise", "method": "backlund", "state": state})
    return listed


def _knobs(method: str, control: str, profile: str) -> list[dict]:
    if control == "step":
        return [{"h": h} for h in STEPS[profile]]
    if method.startswith("rk45"):
        return [{"rtol": tol} for tol in RTOLS[profile]]
    return [{"tol": tol} for tol in TOLERANCES[profile]]


def measure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    rate, _, unit = top.scales(y0)
    if cell["part"] == "promise":
        return [_promise(top, y0, h, cell["state"]) for h in _promise_steps(top, y0)]
    options = options_of(cell)
    if cell["part"] == "h":
        h = cell.get("h", 1.0)
        n = max(round(SPAN / h), 1)
        counts = sorted({max(n * k // 16, 1) for k in range(1, 17)})  # sixteen places: not by chance at a good one
    else:
        h, counts = cell["h"], log_counts(cell["steps"], per_octave=4)
    times, states = sample(top, y0, cell["method"], h * unit, counts, **options)
    errors = _errors(top, y0, times, states, rate)
    if cell["part"] == "h":
        return [{name: rounded(np.max(np.abs(e))) for name, e in errors.items()}]
    columns = {"t": times * rate, **errors}
    return [{name: rounded(value[i]) for name, value in columns.items()} for i in range(len(times))]


def _errors(top, y0, times, states, rate) -> dict[str, np.ndarray]:
    """time and angle (in radians of their own phase), what is off the torus, and the whole error, all scaled."""
    truth = exact.solution(top, y0, times)
    error = states - truth
    whole = metrics.scaled_error(top, y0, states, truth)
    split = metrics.phase_split(top, truth, error)
    off = np.sqrt(sum(np.square(_off_torus(top, truth, split, name)) for name in ("H", "J3", "C1", "C2")))
    return {"time": split["time"] * rate, "angle": split["angle"], "off": off, "error": whole}


def _off_torus(top, truth, split, name) -> np.ndarray:
    """Size of one gradient component of the error, in scaled units."""
    rate, size, _ = top.scales(truth[0])
    gradients = np.array([top.gradients(y) for y in truth])[:, ("H", "J3", "C1", "C2").index(name)]
    scaled = gradients / np.repeat((rate, size), 3)
    return split[name] * np.linalg.norm(scaled, axis=1)


def promised(top, y0, t, state) -> np.ndarray:
    """The promise of the exact step: (1e-13 + 1e-15 t) max(1, 1e-3/k'²), k'² = (e1 − e2)/(e1 − e3), t scaled.

    Half an ulp in y0 moves the period by ε/k'²: near the separatrix that is what the data are worth. On the
    homoclinic orbit itself a perturbation grows like exp(κt), κ² = alpha |x| − J3²/4.
    """
    base = 1e-13 + 1e-15 * np.abs(t)
    if state == "homoclinic":
        rate, size, unit = top.scales(y0)
        return base * np.exp(np.sqrt(top.alpha * size - y0[2] ** 2 / 4) * t * unit)
    e1, e2, e3 = exact.roots(top, y0)
    gap = e1 - e2 if top.alpha >= 0 else e2 - e3  # between the root out of reach and the motion
    close = gap / (e1 - e3) if np.isfinite(e1 - e3) and e1 > e3 else 1.0
    return base * (max(1.0, 1e-3 / close) if close > 0 else np.inf)


def _promise_steps(top, y0) -> list[float]:
    period = exact.nutation_period(top, y0) * top.scales(y0)[0]
    return [*PROMISE_H, *(period * part for part in PROMISE_TURNS if np.isfinite(period))]


def _promise(top, y0, h, state) -> dict:
    """The largest error over the promise, at twenty places of 2000 real steps of size h."""
    unit = top.scales(y0)[2]
    steps = PROMISE_STEPS
    if state == "homoclinic":
        steps = max(int(UNSTABLE_SPAN / unit / h), 1)
    counts = sorted({max(steps * k // 20, 1) for k in range(1, 21)})
    times, states = sample(top, y0, "backlund", h * unit, counts)
    error = metrics.scaled_error(top, y0, states, exact.solution(top, y0, times))
    share = error / promised(top, y0, times / unit, state)
    return {"h": h, "error": rounded(np.max(error)), "share": rounded(np.max(share))}


# ------------------------------------------------------------------------------------------ what the rows say

SMALL = 0.1  # errors up to here are split to first order in earnest


def orders(rows: pd.DataFrame) -> pd.DataFrame:
    """Measured order per method with a step, from the error against h on each top."""
    from integrators import METHODS

    rows = rows[(rows.part == "h") & (rows.status == "done")]
    table = []
    for method, group in rows.groupby("method", sort=False):
        if method not in METHODS or METHODS[method].control != "step":
            continue
        for state, points in group.groupby("state", sort=False):
            fit = metrics.order(points.h.to_numpy(), points.error.to_numpy(), floor=1e-14, saturation=1e-3)
            table.append(
                {
                    "method": method,
                    "state": state,
                    "claimed": METHODS[method].order or "exact",
                    "measured": fit.p,
                    "standard error": fit.stderr,
                    "points": int(fit.mask.sum()),
                    "smallest error": float(points.error.min()),
                    "largest error": float(points.error.max()),
                }
            )
    return pd.DataFrame(table)


def shifts(rows: pd.DataFrame) -> pd.DataFrame:
    """Frequency shift and residual of the runs against time, fitted while the error is small."""
    rows = rows[(rows.part == "time") & (rows.status == "done")]
    table = []
    for (method, state), run in rows.groupby(["method", "state"], sort=False):
        last = run.error.iloc[-1]
        run = run[(run.error > SMALL).cumsum() == 0]
        t = run.t.to_numpy()
        nutation, precession = (metrics.frequency_shift(t, run[name].to_numpy()) for name in ("time", "angle"))
        table.append(
            {
                "method": method,
                "state": state,
                "fitted up to t": float(t[-1]) if len(t) else np.nan,
                "relative time shift": nutation.slope,
                "time residual": nutation.residual_size,
                "precession shift": precession.slope,
                "angle residual": precession.residual_size,
                "error at the end of the run": last,
            }
        )
    return pd.DataFrame(table)


def promise(rows: pd.DataFrame) -> pd.DataFrame:
    """The worst of the exact step over all tops, for each h."""
    rows = rows[(rows.part == "promise") & (rows.status == "done")]
    rows = rows.assign(step=rows.h.where(rows.h.isin(PROMISE_H)).map("{:g}".format, na_action="ignore"))
    rows["step"] = rows.step.fillna("fractions of the nutation period")
    worst = rows.loc[rows.groupby("step", sort=False).share.idxmax()] if len(rows) else rows
    table = worst[["step", "state", "error", "share"]].reset_index(drop=True)
    return table.rename(columns={"state": "worst top", "share": "error / promise"})


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return {"orders": orders(rows), "frequency_shifts": shifts(rows), "promise": promise(rows)}


def draw(rows: pd.DataFrame) -> dict:
    from report import style

    figures = {}
    if (rows.part == "h").any():
        figures["h"] = _draw_h(rows[rows.part == "h"], style)
    if (rows.part == "time").any():
        figures["time"] = _draw_time(rows[rows.part == "time"], style)
    return figures


def _draw_h(rows: pd.DataFrame, style):
    fig, axes = style.figure("page", 5.4, nrows=2, ncols=2, sharex=True, sharey=True)
    for ax, state in zip(axes.flat, STATES, strict=True):
        for method in style.ordered(rows.method):
            chosen = rows[(rows.method == method) & (rows.state == state)].sort_values("h")
            chosen = chosen[chosen.h.notna()]
            if chosen.empty:
                continue
            error = chosen.error.where(chosen.error > 0)
            ax.loglog(chosen.h, error, **style.of(method))
            style.failure_marks(ax, chosen[chosen.status == "failed"].h, method)
        ax.set_title(TOPS[state].label)
        ax.axhline(2.0**-52, color=style.FAINT, linewidth=0.6)
    for ax in axes[1]:
        ax.set_xlabel("step h · (|J| + √(α|x|))")
    for ax in axes[:, 0]:
        ax.set_ylabel(f"largest error up to t = {SPAN:g}")
    axes[0, 0].set_ylim(1e-16, 30)
    style.legend_below(fig)
    fig.caption = (
        f"Largest error against the exact solution up to t = {SPAN:g}, relative to the scales of J and x, against the "
        "step. A method of order p has slope p; the exact Bäcklund step has none, at any h. Crosses: failed."
    )
    return fig


def _draw_time(rows: pd.DataFrame, style):
    states = list(dict.fromkeys(rows.state))
    fig, axes = style.figure(
        "page", 2.6 * len(states), nrows=len(states), ncols=2, sharex=True, sharey=True, squeeze=False
    )
    for row, state in zip(axes, states, strict=True):
        for ax, name in zip(row, ("time", "angle"), strict=True):
            for method in style.ordered(rows.method):
                chosen = rows[(rows.method == method) & (rows.state == state) & (rows.status == "done")]
                e = chosen[name].abs()
                ax.loglog(chosen.t, e.where(e > 0), **{**style.of(method), "marker": "none"})
            what = "nutation phase" if name == "time" else "precession phase"
            ax.set_title(f"{TOPS[state].label}: {what}")
        row[0].set_ylabel("|phase error|")
    for ax in axes[-1]:
        ax.set_xlabel("time · (|J| + √(α|x|))")
    axes[0, 0].set_ylim(1e-18, 30)
    style.legend_below(fig)
    fig.caption = (
        "Phase errors against time at step 1/4: the time by which the nutation is early or late (in units of "
        "1/(|J| + √(α|x|))) and the angle by which the precession is ahead or behind (rad). A straight line of slope 1 "
        "is a constant shift of frequency. Errors of the order of one mean that the phase is lost."
    )
    return fig


if __name__ == "__main__":
    raise SystemExit(engine.main("phase"))
