"""Sums a trajectory up in words, saves it, and draws it, for the command `integrate`."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import Trajectory
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.truth import exact, truths
from lagrange_bench.results import provenance
from lagrange_bench.support.output import table


def judge(trajectory: Trajectory, y0: Array) -> dict[str, Any]:
    """The invariants, their drift relative to `invariant_scales`, and the error against the true solution."""
    top, y = trajectory.top, np.vstack([y0, trajectory.y])
    with np.errstate(all="ignore"):  # |x|² may overflow: then the values that contain it are not given
        invariants = top.invariants(y)
        drift = metrics.relative_drift(invariants, top.invariant_scales(y0))
    try:
        errors = trajectory.error()
        if np.isnan(errors).any():
            raise ValueError("the motion is chaotic: no digit of its final state is known")
        judged: dict[str, Any] = {"final": errors[-1], "largest": errors.max(), "note": ""}
    except ValueError as error:  # the method has a result, but there is no truth to compare it with
        judged = {"final": None, "largest": None, "note": str(error)}
    judged["against"] = truths.name(top)
    facts, names = ("start", "final", "drift", "largest_drift", "conserved"), top.names
    conserved = [name in top.conserved for name in names]
    columns = zip(invariants[0], invariants[-1], drift[-1], np.abs(drift).max(axis=0), conserved, strict=True)
    changes = {name: dict(zip(facts, column, strict=True)) for name, column in zip(names, columns, strict=True)}
    return {
        "t_final": trajectory.t[-1],
        "y_final": trajectory.y[-1],
        "recorded": len(trajectory.t),
        "invariants": changes,
        "error": judged,
    }


def describe(trajectory: Trajectory, y0: Array, data: dict[str, Any], label: str) -> str:
    """The text that `integrate` prints."""
    top, work, error = trajectory.top, data["work"], data["error"]
    settings = "".join(f", {key} = {value}" for key, value in data["options"].items())
    grid = "given times"
    if data["h"] is not None:
        grid = f"h = {data['h']:g} (own unit), h_scaled = {data['h_scaled']:g}, {data['steps']} steps"
    count = data["recorded"]
    head = [
        f"top     {data['top'] or 'of your own'}: {_kind(top, y0)}",
        f"method  {data['method']}: {label}{settings}",
        f"times   {grid}, up to t = {data['t_final']:.10g}, {count} state{'' if count == 1 else 's'} recorded",
    ]
    states = [("", *(f" {name}" for name in trajectory.columns()))]
    states += [("start", *_exactly(y0)), ("end", *_exactly(trajectory.y[-1]))]
    rows = [("invariant", "start", "end", "drift at the end", "largest recorded")]
    for name, v in data["invariants"].items():
        changes = "" if v["conserved"] else ", not conserved"
        start, end = _exactly((v["start"], v["final"]))
        rows.append((f"{name}{changes}", start, end, _short(v["drift"], "+"), _short(v["largest_drift"])))
    if error["note"]:
        judged = f"error   no {error['against']} to compare with: {error['note']}"
    else:
        final, largest = _short(error["final"]), _short(error["largest"])
        judged = f"error   {final} at the end, {largest} the largest recorded, against the "
        judged += f"{error['against']} (relative to the sizes of {'J and x' if top.space.affine else 'its vectors'})"
    words = {"steps": "steps", "rhs_evals": "right-hand sides", "iterations": "iterations", "rejected": "rejected"}
    counted = ", ".join(f"{work[name]} {word}" for name, word in words.items() if work[name] or name == "steps")
    counts = f"work    {counted}; {data['seconds']:.3g} s in all, compilation included, "
    counts += f"{work['setup_seconds']:.3g} s of it to prepare"
    chosen = [f"chosen  {work['notes']}"] if work.get("notes") else []
    return "\n".join([*head, "", *table(states), "", *table(rows), "", judged, counts, *chosen])


def _kind(top: Any, y0: Array) -> str:
    """The kind of motion, or the potential."""
    if not hasattr(top, "alpha"):
        return f"{top.description}, {top.space.size} numbers"
    alpha = f"alpha = {top.alpha:.10g}"
    if kinds.uniform(top):
        return f"{alpha}, {exact.regime(top, y0)}, nutation period {exact.nutation_period(top, y0):.6g}"
    names = top.potential.parameters or [f"p{i}" for i in range(1, len(top.parameters) + 1)]
    values = ", ".join(f"{name} = {value:.10g}" for name, value in zip(names, top.parameters, strict=True))
    return f"{alpha}, in the potential {top.potential.name}" + (f" ({values})" if values else "")


def _exactly(values: Any) -> tuple[str, ...]:
    """The shortest decimals that are these doubles, with aligned signs; a dash for None."""
    return tuple(" –" if value is None else f"{'' if value < 0 else ' '}{float(value)!r}" for value in values)


def _short(value: float | None, sign: str = "-") -> str:
    """Two digits; a dash for None."""
    return "–" if value is None else f"{value:{sign}.1e}"


def save(path: Path, trajectory: Trajectory, facts: dict[str, Any]) -> str:
    """Save times, states and metadata with `Trajectory.save`, and return whether a file was replaced."""
    version, existed = f"lagrange-bench {provenance.version('lagrange-bench')}", path.exists()
    trajectory.save(path, {"program": version, **facts, **provenance.provenance()})
    return f"{'replaced' if existed else 'written'}: {path}"


def draw(path: Path, trajectory: Trajectory, name: str | None) -> str:
    from lagrange_bench.experiments.drawing import figures, style

    with style.apply():
        figure, ax = style.figure(4.2, 4.2, subplot_kw={"projection": "3d"})
        trajectory.plot("axis", ax=ax, color=style.of(trajectory.method)["color"], label="axis x", linewidth=0.9, ms=2)
        times = f"t = {trajectory.t[0]:g} … {trajectory.t[-1]:g}, {len(trajectory.t)} states"
        title = f"Axis of the top{f' “{name}”' if name else ''}, |x| = {math.hypot(*trajectory.y[0, 3:]):.4g}"
        ax.set_title(f"{style.plain(title)}\n{style.plain(trajectory.method)}, {times}")
        ax.set_box_aspect((1, 1, 1), zoom=0.88)  # leaves room for the labels, which the layout engine does not see
        ax.locator_params(nbins=5)
        ax.get_legend().remove()
        figure.legend(loc="outside lower center", ncols=2)
    return figures.write(path, figure)
