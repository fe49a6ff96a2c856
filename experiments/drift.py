"""Drift: do H, J3, C1 and C2 stay where they were?

Every method follows the named tops and sixteen generic ones; the relative error of each invariant is recorded at
log-spaced times. How its root-mean-square over the sixteen grows, error ~ t^p, gives the verdict: bounded (p near 0),
a random walk of round-off (p near 1/2, Brouwer's law) or biased (p near 1). A second part varies h (or the tolerance)
at a fixed length of run. Times and steps are in units of 1/(|J| + √(|alpha||x|)).
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments import engine, metrics
from experiments.states import RANDOM, find, log_counts, options_of, rounded, sample
from integrators.top import TOPS

VERSION = 1

INVARIANTS = ("H", "J3", "C1", "C2")
STEP = 0.125  # of the runs against time
# method: (steps of STEP in the quick, in the full profile); bounded by what a run costs, see the cost experiment
LENGTHS = {
    "backlund": (10**5, 10**7),
    "backlund_unpinned": (10**5, 10**7),
    "backlund_paper": (10**5, 10**7),
    "backlund_textbook": (10**5, 10**7),
    "taylor": (10**5, 10**7),
    "taylor_fixed": (10**5, 10**7),
    "rk45": (2 * 10**3, 5 * 10**4),
    "rk45_fixed": (10**5, 10**7),
    "implicit_midpoint": (10**5, 10**7),
}
SHORT = (10**5, 10**7)  # a method that joins from outside is taken for a compiled one
AGAINST_H = {  # steps tried, in the same units; and tolerances, for methods that have one
    "quick": ((1 / 16, 1 / 4, 1.0), (1e-6, 1e-9, 1e-12)),
    "full": (tuple(2.0**k for k in range(-6, 3)), tuple(10.0**k for k in range(-13, -3))),
}
SPAN = {"quick": 10**3, "full": 10**4}  # length of the runs against h
H_STATES = ("generic", "figure1")


def cells(profile: str) -> list[dict]:
    from integrators import METHODS

    full = profile == "full"
    listed = []
    for method in METHODS:
        steps = LENGTHS.get(method, SHORT)[full]
        for state in (*TOPS, *RANDOM):
            listed.append({"part": "time", "method": method, "state": state, "h": STEP, "steps": steps})
    sizes, tolerances = AGAINST_H[profile]
    for method in METHODS:
        knobs = [{"h": 1.0, "tol": tol} for tol in tolerances] if method == "taylor" else [{"h": h} for h in sizes]
        if method == "rk45":
            knobs = [{"h": 1.0, "rtol": tol} for tol in tolerances]
        for state in H_STATES:
            for knob in knobs:
                span = SPAN[profile] // 10 if method == "rk45" else SPAN[profile]
                listed.append({"part": "h", "method": method, "state": state, "span": span, **knob})
    return listed


def measure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    rate, _, unit = top.scales(y0)
    steps = cell["steps"] if cell["part"] == "time" else round(cell["span"] / cell["h"])
    counts = log_counts(steps, per_octave=4)
    options = options_of(cell)
    times, states = sample(top, y0, cell["method"], cell["h"] * unit, counts, **options)
    invariants = top.invariants(np.vstack((y0, states)))
    drift = metrics.relative_drift(invariants, top.invariant_scales(y0))[1:]
    if cell["part"] == "h":
        return [{name: rounded(np.max(np.abs(drift[:, i]))) for i, name in enumerate(INVARIANTS)}]
    return [
        {"t": rounded(t * rate), **{name: rounded(e) for name, e in zip(INVARIANTS, errors, strict=True)}}
        for t, errors in zip(times, drift, strict=True)
    ]


# ------------------------------------------------------------------------------------------ what the rows say


def against_time(rows: pd.DataFrame) -> pd.DataFrame:
    """Per method and invariant: claimed or not, exponent with interval, largest error, verdict; the sixteen states."""
    from integrators import METHODS

    rows = rows[(rows.part == "time") & (rows.status == "done") & rows.state.isin(RANDOM)]
    table = []
    for method, group in rows.groupby("method", sort=False):
        for name in INVARIANTS:
            errors = group.pivot(index="state", columns="t_index", values=name).to_numpy()
            t = np.sort(group.groupby("t_index").t.median().to_numpy())
            growth = metrics.growth_exponent(t, errors)
            largest = float(np.max(np.abs(errors)))
            claimed = method in METHODS and name in METHODS[method].conserves
            table.append(
                {
                    "method": method,
                    "invariant": name,
                    "claimed": claimed,
                    "largest relative error": largest,
                    "length of run": float(t[-1]),
                    "exponent": growth.p,
                    "low": growth.low,
                    "high": growth.high,
                    "verdict": metrics.verdict(*growth, largest, floor=FLOOR),
                }
            )
    return pd.DataFrame(table)


FLOOR = 16 * 2.0**-52  # sixteen ulps: an error that never exceeds this is round-off, whatever its slope


def indexed(rows: pd.DataFrame) -> pd.DataFrame:
    """Adds the position of each sample in its run, the same for all states of a method."""
    rows = rows.copy()
    rows["t_index"] = rows.groupby("key", sort=False).cumcount()
    return rows


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    rows = indexed(rows)
    timed = rows[(rows.part == "time") & (rows.status == "done")]
    if timed.empty:
        return {}
    worst = timed.assign(worst=timed[list(INVARIANTS)].abs().max(axis=1))
    named = worst[worst.state.isin(TOPS)].pivot_table(
        index="state", columns="method", values="worst", aggfunc="max", sort=False
    )
    return {"verdicts": against_time(rows), "named_tops": named.reset_index()}


def draw(rows: pd.DataFrame) -> dict:
    from report import style

    rows = indexed(rows)
    figures = {}
    timed = rows[(rows.part == "time")]
    if not timed.empty:
        figures["time"] = _draw_time(timed, style)
    swept = rows[rows.part == "h"]
    if not swept.empty:
        figures["h"] = _draw_h(swept, style)
    return figures


def _draw_time(rows: pd.DataFrame, style):
    fig, axes = style.figure("page", 5.2, nrows=2, ncols=2, sharex=True, sharey=True)
    chosen = rows[rows.state.isin(RANDOM)]
    for ax, name in zip(axes.flat, INVARIANTS, strict=True):
        for method in style.ordered(chosen.method):
            good = chosen[(chosen.method == method) & (chosen.status == "done")]
            if good.empty:
                continue
            groups = good.groupby("t_index")
            t = groups.t.median().to_numpy()
            rms = np.sqrt(groups[name].apply(lambda e: np.mean(np.square(e))).to_numpy())
            ax.loglog(t, np.where(rms > 0, rms, np.nan), **{**style.of(method), "marker": "none"})
        if np.any(chosen[name].fillna(0)):
            style.slope_guide(ax, 0.5, (1e3, 3e-14), 100, "√t")
            style.slope_guide(ax, 1.0, (1e3, 1e-10), 100, "t")
        else:
            ax.text(0.5, 0.5, "exactly constant, every method", transform=ax.transAxes, ha="center", color=style.INK)
        ax.set_title({"H": "energy H", "J3": "vertical momentum J3", "C1": "C1 = |x|²", "C2": "C2 = x·J"}[name])
        ax.axhline(2.0**-52, color=style.FAINT, linewidth=0.6)
    axes[0, 0].set_ylim(bottom=1e-17)
    for ax in axes[1]:
        ax.set_xlabel("time · (|J| + √(α|x|))")
    for ax in axes[:, 0]:
        ax.set_ylabel("relative error, RMS of 16 tops")
    style.legend_below(fig)
    fig.caption = (
        "Relative error of each invariant against time, root mean square over sixteen generic tops, step 1/8. The "
        "grey line is one ulp. `backlund` and `backlund_paper` are moved back onto their invariants every eighth step, the "
        "others never."
    )
    return fig


def _draw_h(rows: pd.DataFrame, style):
    fig, axes = style.figure("page", 3.4, ncols=2, sharey=True)
    rows = rows.assign(worst=rows[list(INVARIANTS)].max(axis=1))
    for ax, state in zip(axes, H_STATES, strict=True):
        for method in style.ordered(rows.method):
            chosen = rows[(rows.method == method) & (rows.state == state)]
            if "tol" in chosen and chosen.tol.notna().any():
                continue
            if "rtol" in chosen and chosen.rtol.notna().any():
                continue
            chosen = chosen.sort_values("h")
            ax.loglog(chosen.h, chosen.worst.clip(lower=1e-17), **style.of(method))
            style.failure_marks(ax, chosen[chosen.status == "failed"].h, method)
        ax.set_title(TOPS[state].label)
        ax.set_xlabel("step h · (|J| + √(α|x|))")
    axes[0].set_ylabel("largest relative error of H, J3, C1, C2")
    style.legend_below(fig)
    fig.caption = (
        "The worst of the four invariants over a run of fixed length, against the step. Crosses: the method failed."
    )
    return fig


if __name__ == "__main__":
    raise SystemExit(engine.main("drift"))
