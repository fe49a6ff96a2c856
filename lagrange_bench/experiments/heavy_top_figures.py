"""Tables and figures of the experiment `heavy_top`. They have a file of their own, so an edit here makes no row old."""

from typing import Any

import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import CASES, METHODS

NAMED = ("rk4", "rattle", "simo_wong", "generalized_alpha", "verner9_fixed", "strang")  # named in the figure
FLOOR = 1e-13  # smaller errors do not show the order


@by_group(
    ("case", "method"),
    "",
    "Whole bodies: the order that a method claims and those of its errors of position and rotation. Then errors with the "
    "smallest step: position (m), rotation (rad), energy, momentum about the vertical, Kovalevskaya's K",
)
def orders(case: str, method: str, group: pd.DataFrame) -> dict:
    record, columns = METHODS.get(method), ("h", "position", "rotation", "energy", "momentum", "K")
    line = {"order": record.order if record else None, **measured_orders(group)}
    return {**line, **group.loc[group.h.idxmin(), [name for name in columns if name in group]]}


def measured_orders(group: pd.DataFrame) -> dict[str, float]:
    """The orders of both errors. The step with the least error separates order from round-off: smaller steps show its size."""
    orders = {}
    for name in ("position", "rotation"):
        error = group[name]
        best = group.h[error == error.min()].max()
        floor = max(FLOOR, error[group.h < best].max())
        orders[f"order of {name}"] = metrics.order(group.h, error, floor=floor).p
    return orders


@of_part(failed=True)
def _draw_steps(rows: pd.DataFrame, style):
    steps = _draw_errors(rows, "h", "step, s", style)
    steps.caption = (
        "Errors of the centre of mass and of the rotation at the end against the step. Many methods lose the spin long "
        "before the axis: compare the columns. Crosses: a method declined the step. "
        f"{style.naming(rows.method, 'some are named')}."
    )
    return steps


@of_part(failed=True)
def _draw_work(rows: pd.DataFrame, style):
    seconds = rows.ns_per_step * 1e-9 * rows.case.map(lambda case: CASES[case].until) / rows.h
    work = _draw_errors(rows.assign(seconds=seconds), "seconds", "wall time of the run, s", style)
    work.caption = (
        "The same errors against the wall time of the run: its steps times the least time of a step; down and left is better. "
        f"{style.naming(rows.method, 'some are named')}."
    )
    return work


def _draw_errors(rows: pd.DataFrame, column: str, text: str, style: Any) -> Any:
    """Draw both errors against the column `column`, with a row of panels for each case."""
    cases, quantities = list(dict.fromkeys(rows.case)), {"position": "m", "rotation": "rad"}
    looks = style.looks(rows.method, NAMED)
    size = {"nrows": len(cases), "ncols": 2, "sharex": "row", "squeeze": False}
    fig, grid = style.figure("page", 0.9 + 2.2 * len(cases), **size)
    for line, case in zip(grid, cases, strict=True):
        for ax, (name, unit) in zip(line, quantities.items(), strict=True):
            for method, look in looks.items():
                run = rows[(rows.case == case) & (rows.method == method)]
                run = run.sort_values("h", ascending=column == "h")  # names stand where lines end: at the right
                good = run[run.status == "done"]
                if not good.empty:
                    ax.loglog(good[column], good[name].clip(lower=1e-16), **{**look, "markersize": 3.0})
                style.failure_marks(ax, run[run.status == "failed"][column].dropna(), method)
            ax.set(title=f"{case}, t = {CASES[case].until:g} s", xlabel=text, ylabel=f"error of {name}, {unit}")
    style.label_ends(grid[:, -1])
    return fig


tables = tabulated(orders)
draw = drawn(steps=_draw_steps, work=_draw_work)
