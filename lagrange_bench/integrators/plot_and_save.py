"""Draws trajectories, and writes them to files: `Trajectory.plot` and `save`."""

from __future__ import annotations

import io
import json
import textwrap
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.integrators.checks import check_choice
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.support.files import write_file

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

# a quarter of an ulp of 1: where a logarithmic axis shows smaller errors and 0
LEAST = 2.0**-54
# rows in a turn of the motion (2π of its time scale), from which on a line joins them
JOINED = 8
# points in a turn of a smooth line through fewer rows, which is drawn for at most MOST_TURNS turns
SMOOTH = 48
MOST_TURNS = 500
DOTS = {"marker": "o", "ms": 3.5, "linestyle": "none"}
KINDS = ("components", "invariants", "error", "axis")
FORMATS = (".csv", ".npz", ".parquet")


def plot(run: Any, what: str, ax: Axes | None, look: dict[str, Any]) -> Axes:
    """See `Trajectory.plot`."""
    from matplotlib import pyplot as plt

    check_choice(what, "what", KINDS)
    if what == "axis":
        return _plot_axis(run, ax or plt.figure().add_subplot(projection="3d"), look)
    ax = ax or plt.figure(layout="constrained").add_subplot()
    if what == "components":
        t, states = _line(run)
        for k, name in enumerate(run.columns()):
            _plot_rows(ax, (run.t, run.states[:, k]), (t, states[:, k]), {"label": name, **look})
        ax.set_ylabel("components")
    elif what == "invariants":
        first, scales = run.problem.invariants(run.start.state, 0.0), run.problem.invariant_scales(run.start.state)
        for name, drift in zip(run.problem.names, ((run.invariants() - first) / scales).T, strict=True):
            ax.plot(run.t, np.maximum(np.abs(drift), LEAST), **{"label": name, **look})
        ax.set(yscale="log", ylabel="relative change of the invariants")
    else:
        from lagrange_bench.integrators.truth import truths

        ax.plot(run.t, np.maximum(run.error(), LEAST), **{"label": run.method, **look})
        ax.set(yscale="log", ylabel=f"error against the {truths.name(run.problem)}")
    ax.set(xlabel="time t", title=textwrap.shorten(f"{run.method}: {run.top!r}", 60, placeholder=" …"))
    ax.legend()
    return ax


def _axis(problem: Any, states: Array) -> Array:
    """The axis x of a top, or the unit vector along the axis of a symmetric body, in each state, (N, 3)."""
    if problem.space.name == "e3":
        return states[:, 3:6]
    if not kinds.rigid_body(problem) or problem.symmetry is None:
        raise ValueError(f"what: {problem!r} has no axis on a sphere")
    if not len(states):
        return np.empty((0, 3))
    return problem.rotations(states).apply(problem.axes[problem.symmetry])


def _plot_axis(run: Any, ax: Any, look: dict[str, Any]) -> Axes:
    if not hasattr(ax, "set_zlabel"):
        raise ValueError("ax: the axis is drawn in space: give axes made with projection='3d'")
    x, line = (_axis(run.problem, states) for states in (run.states, _line(run)[1]))
    radius = float(np.linalg.norm(x[0]))
    around, half = np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13)
    sphere = (
        np.outer(np.cos(around), np.sin(half)),
        np.outer(np.sin(around), np.sin(half)),
        np.outer(around**0, np.cos(half)),
    )
    ax.plot_wireframe(*(radius * part for part in sphere), color="0.85", linewidth=0.4)
    ax.set_proj_type("ortho")
    elevation, azimuth = np.radians((ax.elev, ax.azim))
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    rows, joined = (np.where((points @ towards > 0)[:, None], points, np.nan) for points in (x, line))
    _plot_rows(ax, rows.T, joined.T, {"label": run.method, **look})
    ax.plot(*x[:1].T, "o", color="black", ms=4, label="start")
    ends = [-radius, 0.0, radius]
    ax.set(
        xlabel="$x_1$", ylabel="$x_2$", zlabel="$x_3$ (up)", xticks=ends, yticks=ends, zticks=ends, box_aspect=(1, 1, 1)
    )
    ax.legend(loc="upper left", frameon=False)
    return ax


def _line(run: Any) -> tuple[Array, Array]:
    """Times and states that may be joined by a line: the rows if they are close together, else by dense output, or none."""
    turns = np.ptp(run.t) / (2 * np.pi * run.problem.scales(run.states[0])[2]) if len(run.t) else 0.0
    if len(run.t) >= JOINED * turns:
        return run.t, run.states
    if turns <= MOST_TURNS:
        times = np.linspace(run.t[0], run.t[-1], int(SMOOTH * turns) + 2)
        with suppress(ValueError):  # the method steps on a grid only
            return times, run.sol(times)[:, : run.states.shape[1]]
    return run.t[:0], run.states[:0]


def _plot_rows(ax: Any, rows: Iterable[Array], line: Iterable[Array], look: dict[str, Any]) -> None:
    """Draw rows (coordinates, each (N,)) as a line if it joins them, else as dots, with the line through them, if any."""
    rows, line = np.array([*rows]), np.array([*line])
    if rows.shape == line.shape:
        ax.plot(*rows, **look)
        return
    (dots,) = ax.plot(*rows, **{**DOTS, **look})
    ax.plot(*line, color=dots.get_color(), linewidth=0.6, alpha=0.6)


def save(
    path: Path, facts: Mapping[str, Any], arrays: Callable[[], dict[str, Array]], frame: Callable[[], pd.DataFrame]
) -> Path:
    """Write arrays (.npz) or a table (.csv, .parquet), and the facts of the run, each as JSON; see `Trajectory.save`."""
    kind = check_choice(path.suffix.lower(), "the ending of the file's name", FORMATS)
    texts = {key: _json(key, value) for key, value in facts.items()}
    metadata = {key: json.loads(text) for key, text in texts.items()}
    if kind == ".npz":
        buffer, named = io.BytesIO(), {**arrays(), "metadata": np.array(json.dumps(metadata))}
        np.savez(buffer, **named)  # type: ignore[arg-type]
        return write_file(path, buffer.getvalue())
    table = frame()
    if kind == ".parquet":
        table.attrs = metadata
        try:
            return write_file(path, table.to_parquet(engine="pyarrow"))
        except ImportError:
            raise ValueError("pyarrow is not installed: pip install pyarrow; or write .csv or .npz") from None
    head = "".join(f"# {key}: {text}\n" for key, text in texts.items())
    return write_file(path, head + table.to_csv(index=False, na_rep="nan", lineterminator="\n"))


def _json(key: Any, value: Any) -> str:
    """A fact as JSON. Values of NumPy become numbers; others that JSON lacks, such as a complex option, become their repr."""
    if not (isinstance(key, str) and key.isprintable() and ": " not in key):
        raise ValueError(f"metadata: a name must be a text of one line without “: ”; got {key!r}")
    try:
        return json.dumps(value, ensure_ascii=False, default=lambda v: v.tolist() if hasattr(v, "tolist") else repr(v))
    except (TypeError, ValueError) as error:  # such as a dict whose keys are no texts
        raise ValueError(f"metadata: {key} cannot be written as JSON: {error}") from None
