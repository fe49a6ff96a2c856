"""Tables and figures of the experiment `perturbed`. They have a file of their own, so an edit here makes no row old."""

from functools import partial

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import numbers_in, show
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.reductions import largest
from lagrange_bench.experiments.work_precision_figures import APART, TARGETS, best, draw_runs, races, useful
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.interface import INVARIANTS

OURS = "backlund_splitting"  # the splitting with the exact step inside
SPANS = (1e3, 1e4, 1e5)  # of the part “work”: each has a figure
EPSILON = {"tide_1e-6": 1e-6, "weak_tide": 1e-4, "moderate_tide": 1e-2, "strong_tide": 1e-1}  # strengths of one tide
FLOOR, SATURATION = 1e-13, 1e-2  # orders are read off the errors between these


@by_group(
    ("state", "method"), "drift", "Tops in a potential: the largest relative error of each invariant that the top has"
)
def kept(state: str, method: str, run: pd.DataFrame) -> dict:
    """A line for each top and method."""
    top = states.of_cell({**run.iloc[0], "state": state})[0]
    errors = {name: largest(run[name]) if name in top.conserved else np.nan for name in INVARIANTS}
    says = METHODS[method].conserves_on(top) if method in METHODS else ()
    return {"steps": int(run.steps.max()), **errors, "claimed": ", ".join(name for name in INVARIANTS if name in says)}


@by_group(
    ("state", "method"),
    "problem",
    "Problems that are no top in a fixed field: the largest relative error of the invariants that a method says it keeps, and of "
    "the others, over all steps",
)
def problems(state: str, method: str, run: pd.DataFrame) -> dict:
    """A line for each problem and method."""
    return {"invariants it claims": largest(run.kept), "its other invariants": largest(run.get("others", np.nan))}


@by_group(
    ("part", "state", "method", "scheme"),
    "",
    "Orders claimed, and measured as the slope of the error against the step: after 32 units, of driven tops at the end of the "
    "shortest runs. At these steps some slopes are still below the order. Empty where fewer than three steps tell",
)
def orders(part: str, state: str, method: str, scheme: str, run: pd.DataFrame) -> dict:
    """A line for each top or problem, method and scheme."""
    record = METHODS.get(method)
    if part not in ("order", "problem", "driven") or (record and record.accuracy_option != "h"):
        return {}
    if part == "driven":
        run = run[run.span == run.span.min()]
    claimed = 6 if scheme == "processed6" else record.order if record else None
    return {"claimed": claimed, "measured": metrics.order(run.h, run.error, FLOOR, SATURATION).p}


@of_part(
    "",
    "The cheapest method, set-up counted, and the best of the others beside the splitting with the exact step. The part “work” "
    "has tops in a potential, the part “driven” tops with a Hamiltonian that depends on time, in their own unit of time",
)
def winners(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each top, length of run and target error."""
    good = useful(rows[rows.part.isin(("work", "driven"))])
    table = []
    for fields, race in races(good, ["part", *APART], TARGETS, "total") if len(good) else ():
        own, others = race[race.method == OURS].total, race[race.method != OURS]
        line = {**fields, "cheapest": race.method.iloc[0], "seconds": race.total.iloc[0]}
        line["best of the others"] = others.method.iloc[0] if len(others) else ""
        ratio = others.total.min() / own.min() if len(own) and len(others) else np.nan
        table.append({**line, "times as long as the exact step inside": ratio})
    return pd.DataFrame(table)


@by_group(
    ("field", "span", "tol"),
    "tolerance",
    "The splitting with the exact step, given an error tol in place of a step, on random tops: how many runs it answers and "
    "refuses, and the largest error. Chaotic runs are left out",
)
def tolerances(field: str, span: float, tol: float, group: pd.DataFrame) -> dict:
    """A line for each field, length of run and tolerance."""
    answered = group.reindex(columns=["answer", "error"])[group.answer == "given"]
    refused = int((group.answer == "refused").sum())
    return {
        "answered": len(answered),
        "refused": refused,
        "share refused": refused / max(refused + len(answered), 1),
        "chaotic": int((group.answer == "chaotic").sum()),
        "largest error / tol": float(np.max(answered.error.to_numpy() / tol, initial=0.0)),
    }


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    named = rows.assign(scheme=rows.scheme.astype(object).fillna("") if "scheme" in rows else "")
    return tabulated(kept, orders, winners, tolerances, problems)(named)


@of_part()
def _draw_work(rows: pd.DataFrame, style, part: str, span: float | None = None):
    """Draw error against time, with a panel for each top. span : of the runs; None: each has a panel of its own."""
    good = useful(rows[rows.part == part])
    if span and len(good):
        good = good[good.span == span]
    if good.empty:
        return None

    def named(here: pd.DataFrame) -> list[str]:
        quickest = best(here, 1e-8, "total").method
        return [OURS, *quickest[quickest != OURS][:2]]

    runs = dict(list(good.groupby(APART, sort=False)))
    titles = [
        numbers_in(states.label(state)) if span else f"{state.replace('_', ' ')}, t = {length:g}"
        for length, state in runs
    ]
    labels = "wall time of the run with set-up, s", "error at the end"
    fig, axes = style.panels(titles, 2, (0.5, 2.6), *labels, sharex=bool(span), sharey=True)
    for ax, here in zip(axes, runs.values(), strict=True):
        most_accurate = here.method[here.error.idxmin()]
        draw_runs(ax, here.assign(seconds=here.total), [most_accurate, *named(here)], style, ours=OURS)
    style.label_ends(axes)
    which = f"in a potential, t = {show(span)}" if span else "with a Hamiltonian that depends on time"
    fig.caption = (
        f"Error at the end against wall time, set-up included, for tops {which}; down and left is better. "
        f"{style.naming(good.method, 'named: the exact step inside, the two others quickest to 1e-8, and the most accurate')}. "
        "Each curve joins a method's Pareto-optimal runs, one for each step size or tolerance."
    )
    return fig


@of_part("work")
def _draw_winner(rows: pd.DataFrame, style):
    """Draw a map over (ε, error) of the best other method's time, in units of the time of the exact step inside."""
    from matplotlib import colors

    table = winners(rows[rows.state.isin(EPSILON)])
    if table is None or table.empty:
        return None
    spans, tops = sorted(set(table.span)), [state for state in EPSILON if state in set(table.state)]
    targets = sorted(set(table["error at most"]), reverse=True)
    titles, labels = [f"t = {show(span)}" for span in spans], ("size of the tide, ε", "error at most")
    fig, axes = style.panels(titles, len(spans), (0.0, 2.6), *labels)
    for ax, span in zip(axes, spans, strict=True):
        here = table[table.span == span]
        wide = here.pivot(index="error at most", columns="state", values="times as long as the exact step inside")
        ratios = wide.reindex(index=targets, columns=tops).to_numpy(dtype=float)
        norm = colors.LogNorm(vmin=0.1, vmax=10.0)
        ax.pcolormesh(np.ma.masked_invalid(ratios), cmap="RdBu", norm=norm, edgecolors="white", linewidth=1.0)
        for (i, j), ratio in np.ndenumerate(ratios):
            unknown = "–" if tops[j] in set(here.state) else ""
            word = f"{ratio:.2g}" if np.isfinite(ratio) else unknown
            dark = np.isfinite(ratio) and not 0.3 < ratio < 3.3
            ax.text(j + 0.5, i + 0.5, word, ha="center", va="center", fontsize=7, color="white" if dark else "black")
        ax.set_xticks(np.arange(len(tops)) + 0.5, [show(EPSILON[state]) for state in tops])
        ax.set_yticks(np.arange(len(targets)) + 0.5, [show(target) for target in targets])
        ax.grid(visible=False)
    fig.caption = (
        "Who wins on the generic top in a tide of size ε: the wall time of the best other method, set-up included, in units "
        "of the splitting's time. Above 1, blue: the splitting with the exact step is quicker. Below, red: another method is. "
        "A dash: one of the two does not get there. Empty: not run over this time."
    )
    return fig


@of_part("order")
def _draw_order(rows: pd.DataFrame, style):
    if "error" not in rows or rows.error.isna().all():
        return None
    state = "weak_tide" if rows.state.eq("weak_tide").any() else rows.state.iloc[0]
    here = rows[rows.state == state]
    label = states.label(state)
    fig, _ = style.by_family(here, "h", "error", style.STEP, f"error after 32 units\n{label}", (1e-16, 10))
    fig.caption = (
        f"Error after 32 units against the step on “{label}”, one panel for each family of methods. The slopes are the "
        "orders; their numbers for all tops are in the table. A cross before a name: the method has no result."
    )
    return fig


draw = drawn(
    **{f"work_t{span:.0f}": partial(_draw_work, part="work", span=span) for span in SPANS},
    driven=partial(_draw_work, part="driven"),
    winner=_draw_winner,
    order=_draw_order,
)
