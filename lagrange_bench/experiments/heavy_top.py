"""Heavy tops of multibody dynamics: how well do integrators follow position and rotation of a whole body?

Every method with a fixed step that takes a `RigidBody` follows four motions. `bruels` is the usual test of multibody codes, with
300 rad of spin. `slow` has a fifteenth of this spin. The others are `simo_wong` and Kovalevskaya's body, which is not symmetric.

Rows hold the errors at the end: of the centre of mass (m), of the rotation (rad), and of the spin of a symmetric body (rad).
Beside them are the largest errors of the energy and of the momentum about the vertical, relative to their terms. The truth is the
closed form. For Kovalevskaya's body it is a Taylor series in integers.
"""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.reductions import worst
from lagrange_bench.experiments.measuring.states import methods_on, rounded
from lagrange_bench.experiments.work_precision import draw_panels, useful
from lagrange_bench.integrators import CASES, METHODS, integrate, prepare
from lagrange_bench.integrators.interface import Array

VERSION = 1
MEASURED = {"": ("position", "rotation", "energy", "momentum", "ns_per_step")}

# runs take 2^k steps
POWERS = {"bruels": range(9, 17), "slow": range(5, 13), "simo_wong": range(8, 16), "kovalevskaya": range(6, 14)}
QUICK = ("bruels", "kovalevskaya")  # motions of the quick profile
CHOSEN = ("strang", "rk4", "rkmk4", "rattle", "simo_wong", "lie_midpoint", "generalized_alpha")  # methods of it
TIMED = 2000  # most steps in a call that is timed


def cells(profile: str) -> list[dict]:
    full = profile == "full"
    on_bodies = methods_on(CASES["kovalevskaya"].body)
    stepping = [name for name, method in on_bodies.items() if method.control == "step"]
    return [
        {"timing": True, "case": case, "method": name, "h": CASES[case].until / 2**k}
        for case, powers in POWERS.items()
        if full or case in QUICK
        for name in (stepping if full else CHOSEN)
        for k in (powers if full else powers[1:-1:3])
    ]


@cache
def end(case: str) -> Array:
    """The rotation matrix at the end."""
    return CASES[case].solution([CASES[case].until]).rotation.as_matrix()[0]


def measure(cell: dict) -> list[dict]:
    case, h = cell["case"], cell["h"]
    body, y0 = CASES[case].body, CASES[case].state
    steps = round(CASES[case].until / h)
    run = integrate(body, y0, h=h, steps=steps, method=cell["method"], every=steps // 16)
    errors = body.errors(run.y[-1:], end(case)[None])
    drift = dict(zip(body.names, metrics.relative_drift(run.invariants(), body.invariant_scales(y0)).T, strict=True))
    row: dict[str, Any] = {name: rounded(error[0]) for name, error in errors.items()}
    stepper = prepare(body, y0, h, cell["method"])
    n = min(steps, TIMED)
    row["ns_per_step"] = rounded(timing.time_call(lambda: stepper.advance(y0, n), repeats=5).min() / n * 1e9)
    row |= {"energy": rounded(np.max(np.abs(drift["H"]))), "momentum": rounded(np.max(np.abs(drift["J3"])))}
    return [row]


# ---------------------------------------------------------------- tables and figures


NAMED = ("rk4", "rattle", "simo_wong", "generalized_alpha", "verner9_fixed", "strang")  # named in the figure
FLOOR = 1e-13  # smaller errors do not show the order


@by_group(
    ("case", "method"),
    "",
    "Whole bodies: the order that a method claims and those of its errors of position and rotation. Then errors with the "
    "smallest step: position (m), rotation (rad), energy, momentum about the vertical",
)
def orders(case: str, method: str, group: pd.DataFrame) -> dict:
    record, columns = METHODS.get(method), ("h", "position", "rotation", "energy", "momentum")
    line = {"order": record.order if record else None, **measured_orders(group)}
    return {**line, **group.loc[group.h.idxmin(), [name for name in columns if name in group]]}


def measured_orders(group: pd.DataFrame) -> dict[str, float]:
    """The orders of both errors. The step with the least error separates order from round-off: smaller steps show its size."""
    orders = {}
    for name in ("position", "rotation"):
        error = group[name]
        best = group.h[error == error.min()].max()
        floor = max(FLOOR, error[group.h < best].max())
        orders[f"order of {name}"] = metrics.order(group.h, error, floor=floor)
    return orders


@of_part()
def _draw_work(rows: pd.DataFrame, style):
    errors = worst(rows, ("position", "rotation"))
    seconds = rows.ns_per_step * 1e-9 * rows.case.map(lambda case: CASES[case].until) / rows.h
    good = useful(rows.assign(error=errors, seconds=seconds, setup_seconds=0.0))
    titles = {case: f"{case}, t = {CASES[case].until:g} s" for case in dict.fromkeys(good.case)}
    labels = "wall time of the run, s", "larger error, m or rad"
    fig = draw_panels(good, "case", titles, "seconds", labels, NAMED, style)
    fig.caption = (
        "The larger of the errors of the centre of mass (m) and of the rotation (rad) at the end against the wall time of the "
        "run: its steps times the least time of a step; down and left is better. Each curve shows a method's Pareto-optimal "
        f"runs. {style.naming(good.method, 'some are named')}."
    )
    return fig


tables = tabulated(orders)
draw = drawn(work=_draw_work)
