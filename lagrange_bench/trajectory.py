"""A trajectory summed up in words, kept in a file, and drawn. Files appear whole or not at all."""

from __future__ import annotations

import importlib.util
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import INVARIANTS, Trajectory
from lagrange_bench.integrators.files import replace_file
from lagrange_bench.integrators.interface import Array, Method
from lagrange_bench.integrators.trajectory import E3_COLUMNS
from lagrange_bench.integrators.truth import exact, truths
from lagrange_bench.results import provenance
from lagrange_bench.text import table

if TYPE_CHECKING:
    from lagrange_bench.experiments.drawing.style import Figure
    from lagrange_bench.integrators import Method

VIEW = (22, -55)  # degrees above the horizon and around it, of who looks at the sphere
CHORD = 0.3  # rad between two recorded directions of the axis; beyond, a line between them would say too much


# ---------------------------------------------------------------- words


LAM = "lam given: one step is the flow over another time than h, and a turn"


def judge(trajectory: Trajectory, y0: Array, lam: bool = False) -> dict[str, Any]:
    """Invariants, their drift relative to `invariant_scales`, and the error against the exact or reference solution.

    lam : whether a parameter of the map was given, which is then no step of time h.
    """
    top, y = trajectory.top, np.vstack([y0, trajectory.y])
    with np.errstate(all="ignore"):  # |x|² may be no double: what it is a part of is then not given
        invariants = top.invariants(y)
        drift = metrics.relative_drift(invariants, top.invariant_scales(y0))
    try:
        if lam:
            raise ValueError(LAM)
        errors = trajectory.error()
        if np.isnan(errors).any():
            raise ValueError("the motion is chaotic: no digit of its final state is known")
        judged: dict[str, Any] = {"final": errors[-1], "largest": errors.max(), "note": ""}
    except ValueError as error:  # beyond what doubles resolve: the method has an answer, the truth has none
        judged = {"final": None, "largest": None, "note": str(error)}
    judged["against"] = truths.name(top)
    conserved = getattr(top, "conserved", INVARIANTS)
    return {
        "t_final": trajectory.t[-1],
        "y_final": trajectory.y[-1],
        "recorded": len(trajectory.t),
        "invariants": {
            name: {
                "start": first,
                "final": last,
                "drift": final,
                "largest_drift": largest,
                "conserved": name in conserved,
            }
            for name, first, last, final, largest in zip(
                INVARIANTS, invariants[0], invariants[-1], drift[-1], np.abs(drift).max(axis=0), strict=True
            )
        },
        "error": judged,
    }


def describe(trajectory: Trajectory, y0: Array, data: dict[str, Any], label: str) -> str:
    """What `integrate` prints."""
    top, work, error = trajectory.top, data["work"], data["error"]
    settings = "".join(f", {key} = {value}" for key, value in data["options"].items())
    grid = "given times" if data["h"] is None else f"h = {data['h']:g}, {data['steps']} steps"
    upto = f"up to t = {data['t_final']:.10g}" if error["note"] != LAM else "which h only labels"
    count = data["recorded"]
    head = [
        f"top     {data['top'] or 'of your own'}: alpha = {top.alpha:.10g}, {_kind(top, y0)}",
        f"method  {data['method']}: {label}{settings}",
        f"times   {grid}, {upto}, {count} state{'' if count == 1 else 's'} recorded",
    ]
    states = [
        ("", *(f" {name}" for name in E3_COLUMNS)),
        ("start", *_exactly(y0)),
        ("end", *_exactly(trajectory.y[-1])),
    ]
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
        judged += f"{error['against']} (relative to the sizes of J and x)"
    words = {"steps": "steps", "rhs_evals": "right-hand sides", "iterations": "iterations", "rejected": "rejected"}
    counted = ", ".join(f"{work[name]} {word}" for name, word in words.items() if work[name] or name == "steps")
    counts = f"work    {counted}; {data['seconds']:.3g} s in all, compilation included, "
    counts += f"{work['setup_seconds']:.3g} s of it to prepare"
    chosen = [f"chosen  {work['notes']}"] if work.get("notes") else []
    return "\n".join([*head, "", *table(states), "", *table(rows), "", judged, counts, *chosen])


def _kind(top: Any, y0: Array) -> str:
    """What motion it is; in a potential, which one."""
    if "uniform" in top.offers:
        return f"{exact.regime(top, y0)}, nutation period {exact.nutation_period(top, y0):.6g}"
    names = top.potential.parameters or [f"p{i}" for i in range(1, len(top.parameters) + 1)]
    values = ", ".join(f"{name} = {value:.10g}" for name, value in zip(names, top.parameters, strict=True))
    return f"in the potential {top.potential.name}" + (f" ({values})" if values else "")


def _exactly(values: Any) -> tuple[str, ...]:
    """The shortest decimals that are these doubles, minus signs apart; a dash for none."""
    return tuple(" –" if value is None else f"{'' if value < 0 else ' '}{float(value)!r}" for value in values)


def _short(value: float | None, sign: str = "-") -> str:
    """Two digits; a dash for none."""
    return "–" if value is None else f"{value:{sign}.1e}"


# ---------------------------------------------------------------- files


def check_target(flag: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """ValueError naming `flag` if the file could not be written, as far as that can be known before."""
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{flag} {path}: the name must end in {' or '.join(suffixes)}")
    folder = path.parent
    if not folder.is_dir():
        raise ValueError(f"{flag} {path}: there is no folder {folder}")
    if path.exists() and not path.is_file():
        raise ValueError(f"{flag} {path}: this is not a file")
    if path.suffix.lower() == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise ValueError(f"{flag} {path}: needs pyarrow: pip install pyarrow; or write .csv or .npz")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{flag} {path}: no permission to write in {folder.resolve()}")


def save(path: Path, trajectory: Trajectory, facts: dict[str, Any]) -> str:
    """Write times, states and metadata as `Trajectory.save` does, and say what was done."""
    version, existed = f"lagrange-bench {provenance.version('lagrange-bench')}", path.exists()
    trajectory.save(path, {"program": version, **facts, **provenance.provenance()})
    return f"{'replaced' if existed else 'written'}: {path}"


# ---------------------------------------------------------------- a drawing


def draw(path: Path, trajectory: Trajectory, method: Method, name: str | None) -> str:
    """Draw where the axis went on its sphere and write the picture."""
    from lagrange_bench.experiments.drawing import figures, style

    with style.apply():
        figure = sphere(trajectory, method, name)
    return replace_file(path, figures.FORMATS[path.suffix.lower().removeprefix(".")](figure))


def sphere(trajectory: Trajectory, method: Method, name: str | None) -> Figure:
    """The axis x on the sphere of radius |x|, seen from outside; what is behind the sphere is pale."""
    from lagrange_bench.experiments.drawing import style

    x, radius = trajectory.y[:, 3:], math.hypot(*trajectory.y[0, 3:])
    view = _view()
    kind = {"projection": "3d", "proj_type": "ortho", "computed_zorder": False}
    figure, ax = style.figure(4.2, 4.2, subplot_kw=kind)
    ax.view_init(*VIEW)
    for circle in _graticule(radius, view):
        ax.plot(*_parts(circle, view, front=True), color="#cfcfcf", linewidth=0.4, zorder=2)
    colour = style.of(method.name)["color"]
    for front, pale, order in ((True, 1.0, 3), (False, 0.35, 1)):
        look = {"linestyle": "-", "linewidth": 0.9} if _dense(x) else {"linestyle": "none", "marker": ".", "ms": 3}
        ax.plot(*_parts(x, view, front), color=colour, alpha=pale, zorder=order, gid="way", **look)
    for state, marker, text in ((x[0], "o", "start"), (x[-1], "s", "end")):
        fill = colour if text == "start" else "white"
        ax.plot(*state[:, None], marker, color=colour, markerfacecolor=fill, ms=5, zorder=4, label=text, ls="none")
    ax.set(xlabel="$x_1$", ylabel="$x_2$", zlabel="$x_3$ (up)")
    ax.set_box_aspect((1, 1, 1), zoom=0.88)  # leaves room for the labels, which the layout engine does not see
    ax.set(xlim=(-radius, radius), ylim=(-radius, radius), zlim=(-radius, radius))
    ax.locator_params(nbins=5)
    times = f"t = {trajectory.t[0]:g} … {trajectory.t[-1]:g}, {len(x)} states"
    ax.set_title(
        f"Axis of the top{f' “{name}”' if name else ''}, |x| = {radius:.4g}\n{style.plain(method.label)}, {times}"
    )
    figure.legend(loc="outside lower center", ncols=2)
    figure.caption = "The axis x in the rest frame, in units of the initial state; pale where it is behind the sphere."
    return figure


def _view() -> Array:
    """The direction the sphere is seen from."""
    elevation, azimuth = np.radians(VIEW)
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def _graticule(radius: float, view: Array) -> list[Array]:
    """Meridians and parallels every 30 degrees and the outline, (n, 3) each."""
    around, half = np.linspace(0, 2 * np.pi, 121), np.linspace(-np.pi / 2, np.pi / 2, 61)
    curves = [(np.cos(b) * np.cos(around), np.cos(b) * np.sin(around), 0 * around + np.sin(b)) for b in half[10:51:10]]
    curves += [(np.cos(half) * np.cos(a), np.cos(half) * np.sin(a), np.sin(half)) for a in around[:-1:10]]
    right = np.cross((0.0, 0.0, 1.0), view) / np.hypot(*view[:2])
    outline = np.outer(np.cos(around), right) + np.outer(np.sin(around), np.cross(view, right)) + 1e-9 * view
    return [radius * curve for curve in [outline, *(np.stack(curve, axis=-1) for curve in curves)]]


def _parts(points: Array, view: Array, front: bool) -> Array:
    """Coordinates (3, n) of a curve, NaN where it is on the other side; the segments across the edge are kept."""
    here = (points @ view >= 0) == front
    here[1:] |= here[:-1].copy()
    return np.where(here, points.T, np.nan)


def _dense(x: Array) -> bool:
    """Whether recorded directions are so close that lines between them stay near the sphere."""
    unit = x / np.hypot.reduce(x, axis=1, keepdims=True)
    chords = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    return bool(chords.max(initial=0.0) < CHORD)
