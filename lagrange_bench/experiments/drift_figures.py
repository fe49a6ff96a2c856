"""Tables and figures of the experiment `drift`. They have a file of their own, so an edit here makes no row old."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.reductions import largest, mean_square, worst
from lagrange_bench.experiments.step_forms import FORM_INVARIANTS, FORMS, OWN
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop

FLOOR = 16 * 2.0**-52  # sixteen ulps: an error that stays below is round-off, whatever its slope


def indexed(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the position of each sample in its run, which is the same for all states of a method or a form."""
    return rows.assign(t_index=rows.groupby("key", sort=False).cumcount())


def _times(runs: pd.DataFrame) -> np.ndarray:
    """The times at which runs on several tops were sampled: the median over the tops."""
    return np.sort(runs.groupby("t_index").t.median().to_numpy())


def _growth(runs: pd.DataFrame, columns: list[str]) -> Iterator[tuple[str, float, metrics.Growth]]:
    """Each column with its largest error and the growth of its root mean square over the tops of these runs."""
    t = _times(runs)
    for name in columns:
        errors = runs.pivot(index="state", columns="t_index", values=name).to_numpy(dtype=float)
        yield name, largest(errors), metrics.growth_exponent(t, errors)


def _rms(rows: pd.DataFrame, column: str, runs: list[pd.Series]) -> pd.DataFrame:
    """The root mean square of a column over the tops, and the time, for each of the groups `runs`; NaN where it is 0."""
    squares = mean_square(rows[column], runs)
    return pd.DataFrame({"t": rows.groupby(runs).t.median(), "error": np.sqrt(squares.where(squares > 0))})


@of_part(
    "time",
    "How each invariant's error grows: sixteen random tops. Other quantities (e.g. a modified energy) are those a method itself "
    "claims to conserve",
)
def verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method and quantity."""
    from lagrange_bench.integrators import METHODS

    rows = indexed(rows[rows.state.isin(states.RANDOM)])
    own = [name for name in rows.columns if name.startswith(OWN)]
    table = []
    for method, group in rows.groupby("method", sort=False):
        record = METHODS.get(method)
        has = {OWN + quantity for quantity in record.claims.conserves_own} if record else set()
        columns = [*INVARIANTS, *(column for column in own if column in has or group[column].notna().any())]
        for name, most, growth in _growth(group, columns):
            claimed = record is not None and (name.startswith(OWN) or name in record.conserves_on(LagrangeTop()))
            table.append(
                {
                    "method": method,
                    "invariant": name.removeprefix(OWN),
                    "claimed": claimed,
                    "largest relative error": most,
                    "length of run": float(_times(group)[-1]),
                    "exponent": growth.p,
                    "low": growth.low,
                    "high": growth.high,
                    "verdict": metrics.verdict(*growth, most, floor=FLOOR),
                }
            )
    return pd.DataFrame(table)


@of_part("time", "Largest relative error of H, J3, C1 and C2 on the named tops, and the top where it is")
def named_tops(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method."""
    named = rows[rows.state.isin(TOPS)].reset_index(drop=True)
    named = named.assign(error=worst(named, INVARIANTS).fillna(np.inf))
    table = named.loc[named.groupby("method", sort=False).error.idxmax(), ["method", "steps", "error", "state"]]
    return table.rename(columns={"error": "largest error", "state": "worst top"})


@of_part("long", "Largest relative error of each invariant where steps are long: tops of every kind")
def long_steps(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method and each length of step."""
    grouped = rows.groupby(["method", "fraction"], sort=False)
    table = grouped[list(INVARIANTS)].agg(largest)
    table.insert(0, "tops", grouped.state.nunique())
    table.insert(1, "steps", grouped.steps.max())
    return table.reset_index().rename(columns={"fraction": "step / nutation period"})


@of_part(
    "",
    "Ways to write a step: largest relative error of each invariant, exponent of its growth, phase error, "
    "nanoseconds a step. Exponent 0: bounded, ½: a random walk, 1: drift",
)
def forms(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each form and each step."""
    runs, cost = indexed(rows[rows.part == "form"]), rows[rows.part == "form_cost"]
    if runs.empty:
        return runs
    runs = runs.assign(fraction=runs.get("fraction", np.nan))
    table = []
    for (h, fraction, form), group in runs.groupby(["h", "fraction", "form"], sort=False, dropna=False):
        row: dict[str, Any] = {"form": form, "h": h, "nutation periods": fraction, "steps": group.steps.max()}
        for name, most, growth in _growth(group, list(FORM_INVARIANTS)):
            row |= {f"largest error of {name}": most, f"exponent of {name}": growth.p}
        last = group[group.t_index == group.t_index.max()]
        row["phase error / t"] = float(np.sqrt(np.mean(np.square((last.time / last.t).to_numpy()))))
        row["ns per step"] = cost[(cost.form == form) & (cost.h == h)].ns_per_step.min() if len(cost) else np.nan
        table.append(row)
    return pd.DataFrame(table)


@of_part("time", failed=True)
def _draw_time(rows: pd.DataFrame, style):
    random = rows[rows.state.isin(states.RANDOM)]
    rows = indexed(rows if random.empty else random)
    done = rows[rows.status == "done"]
    lines = _rms(done, "H", [done.method, done.t_index]).reset_index().assign(status="done")
    lines = pd.concat([lines, rows[~rows.method.isin(done.method)][["method", "status"]]])
    label = f"RMS error of H, {rows.state.nunique()} tops"
    fig, axes = style.by_family(lines, "t", "error", style.TIME, label, (1e-17, 1.0), marker="none")
    for ax in axes:
        style.ulp_line(ax)
    style.slope_guide(axes[0], 0.5, (1e0, 1e-9), 1e4, "√t")  # once: the panels have one scale
    style.slope_guide(axes[0], 1.0, (1e0, 1e-9), 1e4, "t")
    fig.caption = (
        f"Relative error of the energy H against time, root mean square over {rows.state.nunique()} tops, step 1/8 or the "
        "default tolerance, one panel for each family of methods; pale blue: the exact Bäcklund step. The thin line is one ulp; "
        "dotted, in the first panel: growth like √t and t. A cross before a name: the method declined the step or failed. "
        "The other invariants are in the table."
    )
    return fig


@of_part("h", failed=True)
def _draw_h(rows: pd.DataFrame, style):
    state = rows.state.iloc[0]
    here = rows[rows.state == state].assign(worst=worst(rows, INVARIANTS))
    ylabel = "largest error of H, J3, C1, C2"
    fig, _ = style.by_family(here, "h", "worst", style.STEP, ylabel, (1e-17, 1e2))
    fig.caption = (
        f"The worst of the four invariants over t = {here.span.max():g} on “{states.label(state)}”, against the step; pale blue: "
        "the exact Bäcklund step. Crosses, in its colour: a method declined the step or failed. Errors above 100 are cut off."
    )
    return fig


@of_part("form")
def _draw_forms(rows: pd.DataFrame, style):
    from matplotlib import colormaps

    h = rows.h.min()
    runs = indexed(rows[rows.h == h]).assign(worst=worst(rows, FORM_INVARIANTS))
    names = [form for form in FORMS if (runs.form == form).any()]
    shades = {False: colormaps["viridis"], True: colormaps["Oranges"]}
    fig, axes = style.figure("page", 2.9, ncols=2)
    panels = (("worst", "largest error of H, C1, C2"), ("time", "phase (time) error"))
    for ax, (what, text) in zip(axes, panels, strict=True):
        for i, form in enumerate(names):
            run = runs[runs.form == form]
            line = _rms(run, what, [run.t_index])
            pinned = form.startswith("pinned")
            colour = shades[pinned](0.5 + 0.05 * i if pinned else 0.7 * i / len(names))
            look = {"color": colour, "linestyle": style.DASHES[i % len(style.DASHES)], "linewidth": 1.0}
            ax.loglog(line.t, line.error, **look, label=form)
        ax.set(xlabel=style.TIME, ylabel=text)
        if what != "time":
            style.ulp_line(ax)
    style.label_ends(axes)
    fig.caption = (
        f"The exact Bäcklund step in different forms, root mean square over {runs.state.nunique()} tops, h = {show(h)}: the "
        "worst relative error of its invariants, and the phase error, in units of 1/(|J| + √(|α||x|)). Increments: the change of "
        "x is added; turned: x is turned about a vector made exactly long. Compensated: what an addition rounds off goes into "
        "the next. Pinned (orange): moved back onto the invariants. The thin line is one ulp."
    )
    return fig


@of_part("longest")
def _draw_longest(rows: pd.DataFrame, style):
    fig, (left, right) = style.figure("page", 2.9, ncols=2)
    for name in style.ordered(rows.method):
        run = rows[rows.method == name].sort_values("t")
        most = worst(run, FORM_INVARIANTS)
        left.loglog(run.t, run.error, **style.of(name))
        right.loglog(run.t, most.where(most > 0), **style.of(name))
    for ax, text in ((left, "error against the exact solution"), (right, "worst error of H, C1, C2")):
        ax.set(xlabel=style.TIME, ylabel=text)
        style.ulp_line(ax)
    style.slope_guide(left, 1.0, (1e3, 1e-15), 100, "$t$")
    style.slope_guide(left, 1.5, (1e0, 1e-12), 100, "$t^{3/2}$")
    style.legend_below(fig)
    fig.caption = (
        "The exact Bäcklund map over the longest run, step 1/8, and heyoka on its natural steps for as long on the clock: "
        "error against the exact solution, relative to the scales of J and x, and the worst relative error of the "
        "invariants. Dotted: growth like t, and like t^(3/2), Brouwer's law. The thin line is one ulp; errors that are "
        "exactly zero are left out."
    )
    return fig


tables = tabulated(verdicts, named_tops, long_steps, forms)
draw = drawn(time=_draw_time, h=_draw_h, form=_draw_forms, longest=_draw_longest)
