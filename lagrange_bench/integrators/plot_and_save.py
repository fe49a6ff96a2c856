"""Draws trajectories, and writes them to files: `Trajectory.plot` and `save`."""

from __future__ import annotations

import io
import json
import textwrap
from collections.abc import Callable, Mapping
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
        for name, values in zip(run.columns(), run.states.T, strict=True):
            ax.plot(run.t, values, **{"label": name, **_look(run, look)})
        ax.set_ylabel("components")
    elif what == "invariants":
        first, scales = run.top.invariants(run.start.state, 0.0), run.top.invariant_scales(run.start.state)
        for name, drift in zip(run.top.names, ((run.invariants() - first) / scales).T, strict=True):
            ax.plot(run.t, np.maximum(np.abs(drift), LEAST), **{"label": name, **look})
        ax.set(yscale="log", ylabel="relative change of the invariants")
    else:
        from lagrange_bench.integrators.truth import truths

        ax.plot(run.t, np.maximum(run.error(), LEAST), **{"label": run.method, **look})
        ax.set(yscale="log", ylabel=f"error against the {truths.name(run.top)}")
    ax.set(xlabel="time t", title=textwrap.shorten(f"{run.method}: {run.top!r}", 60, placeholder=" …"))
    ax.legend()
    return ax


def _axis(run: Any) -> Array:
    """The axis x of a top, or the unit vector along the axis of a symmetric body, at all times, (N, 3)."""
    problem = run.top
    if problem.space.name == "e3":
        return run.states[:, 3:6]
    if not kinds.rigid_body(problem) or problem.symmetry is None:
        raise ValueError(f"what: {problem!r} has no axis on a sphere")
    return run.rotation.apply(problem.axes[problem.symmetry])


def _plot_axis(run: Any, ax: Any, look: dict[str, Any]) -> Axes:
    x = _axis(run)
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
    near_side = np.where((x @ towards > 0)[:, None], x, np.nan)
    ax.plot(*near_side.T, **{"label": run.method, **_look(run, look)})
    ax.plot(*x[:1].T, "o", color="black", ms=4, label="start")
    ends = [-radius, 0.0, radius]
    ax.set(
        xlabel="$x_1$", ylabel="$x_2$", zlabel="$x_3$ (up)", xticks=ends, yticks=ends, zticks=ends, box_aspect=(1, 1, 1)
    )
    ax.legend(loc="upper left", frameon=False)
    return ax


def _look(run: Any, look: dict[str, Any]) -> dict[str, Any]:
    """How states are drawn: joined by a line if they are close together, else as dots."""
    turns = np.ptp(run.t) / (2 * np.pi * run.top.scales(run.states[0])[2]) if len(run.t) else 0.0
    return look if len(run.t) >= JOINED * turns else {**DOTS, **look}


def save(
    path: Path, facts: Mapping[str, Any], arrays: Callable[[], dict[str, Array]], frame: Callable[[], pd.DataFrame]
) -> Path:
    """Write arrays (.npz) or a table (.csv, .parquet), and the facts of the run, each as JSON; see `Trajectory.save`."""
    kind = check_choice(path.suffix.lower(), "the ending of the file's name", FORMATS)
    texts = {key: _json(value) for key, value in facts.items()}
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


def _json(value: Any) -> str:
    """A fact as JSON. Values of NumPy become numbers; others that JSON lacks, such as a complex option, become their repr."""
    return json.dumps(value, ensure_ascii=False, default=lambda v: v.tolist() if hasattr(v, "tolist") else repr(v))
