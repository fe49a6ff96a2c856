"""Draws trajectories, and writes them to files: `Trajectory.plot` and `save`."""

from __future__ import annotations

import importlib.util
import io
import json
import textwrap
import warnings
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
# rows a nutation, from which on they are joined
JOINED = 8
# points a nutation of a smooth orbit
SMOOTH = 48
# most nutations of a smooth orbit
MOST_TURNS = 500
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
            ax.plot(run.t, values, **{"label": name, **look})
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


def _plot_axis(run: Any, ax: Any, look: dict[str, Any]) -> Axes:
    if run.problem.space.name != "e3":
        raise ValueError(f"what: {run.top!r} has no axis x on a sphere")
    if not hasattr(ax, "set_zlabel"):
        raise ValueError("ax: the axis is drawn in space: give axes made with projection='3d'")
    x, orbit = run.y[:, 3:], _orbit(run)
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
    in_front = [np.where((points @ towards > 0)[:, None], points, np.nan) for points in (x, orbit)]
    rows = {"marker": "o", "ms": 3.5, "linestyle": "none"} if len(orbit) != len(x) else {}
    (dots,) = ax.plot(*in_front[0].T, **{"label": run.method, **rows, **look})
    if len(orbit) != len(x):
        ax.plot(*in_front[1].T, color=dots.get_color(), linewidth=0.6, alpha=0.6)
    ax.plot(*x[:1].T, "o", color="black", ms=4, label="start")
    ends = [-radius, 0.0, radius]
    ax.set(
        xlabel="$x_1$", ylabel="$x_2$", zlabel="$x_3$ (up)", xticks=ends, yticks=ends, zticks=ends, box_aspect=(1, 1, 1)
    )
    ax.legend(loc="upper left", frameon=False)
    return ax  # type: ignore[no-any-return]


def _orbit(run: Any) -> Array:
    """The axis along the run (N, 3): the rows if there are enough to be joined, else by dense output, or nothing (0, 3)."""
    from lagrange_bench.integrators.truth import exact

    if not kinds.uniform(run.problem):
        return run.y[:, 3:]
    turns = abs(run.t[-1] - run.t[0]) / exact.nutation_period(run.problem, run.y[0])
    if len(run.t) >= JOINED * turns:
        return run.y[:, 3:]
    nothing = np.empty((0, 3))
    if turns > MOST_TURNS:
        return nothing
    try:
        return run.sol(np.linspace(run.t[0], run.t[-1], int(SMOOTH * turns) + 2))[:, 3:]
    except ValueError:  # the method steps on a grid only
        text = (
            f"plot: {len(run.t) / turns:.1f} rows a nutation are drawn as dots; record {JOINED} to join them (every=…)"
        )
        warnings.warn(text, stacklevel=5)
        return nothing


def save(
    path: Path, facts: Mapping[str, Any], arrays: Callable[[], dict[str, Array]], frame: Callable[[], pd.DataFrame]
) -> Path:
    """Write arrays (.npz) or a table (.csv, .parquet), and the facts of the run, each as JSON; see `Trajectory.save`."""
    kind = check_choice(path.suffix.lower(), "the ending of the file's name", FORMATS)
    texts = {key: _json(key, value) for key, value in facts.items()}
    if kind == ".npz":
        buffer, metadata = io.BytesIO(), json.dumps({key: json.loads(text) for key, text in texts.items()})
        named: dict[str, Any] = {**arrays(), "metadata": np.array(metadata)}
        np.savez(buffer, **named)
        return write_file(path, buffer.getvalue())
    if kind == ".parquet":
        return write_file(path, _parquet(frame(), texts))
    head = "".join(f"# {key}: {text}\n" for key, text in texts.items())
    return write_file(path, head + frame().to_csv(index=False, na_rep="nan", lineterminator="\n"))


def _json(key: Any, value: Any) -> str:
    """A fact as JSON. Values of NumPy become numbers; others that JSON lacks, such as a complex option, become their repr."""
    if not (isinstance(key, str) and key.isprintable() and ": " not in key):
        raise ValueError(f"metadata: a name must be a text of one line without “: ”; got {key!r}")
    try:
        return json.dumps(value, ensure_ascii=False, default=lambda v: v.tolist() if hasattr(v, "tolist") else repr(v))
    except (TypeError, ValueError) as error:  # such as a dict whose keys are no texts
        raise ValueError(f"metadata: {key} cannot be written as JSON: {error}") from None


def _parquet(frame: pd.DataFrame, texts: Mapping[str, str]) -> bytes:
    if importlib.util.find_spec("pyarrow") is None:
        raise ValueError("pyarrow is not installed: pip install pyarrow; or write .csv or .npz")
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table({name: pyarrow.array(frame[name].to_numpy()) for name in frame}, metadata=dict(texts))
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()
