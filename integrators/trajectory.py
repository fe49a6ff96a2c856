"""What `integrate` returns: a trajectory, which can be made a table, drawn, saved and held against the truth.

run = integrate(top, y0, h=0.1, steps=1000, every=10)
run.to_frame(), run.plot("axis"), run.error(), run.save("run.csv")
"""

from __future__ import annotations

import importlib.util
import io
import json
import math
import textwrap
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import check_choice, check_times, warn_caller
from lagrange_bench.integrators.files import write_file
from lagrange_bench.integrators.interface import Array, Method, StepError, Work
from lagrange_bench.integrators.problem.body import RigidTop
from lagrange_bench.integrators.problem.units import scaled_size

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from scipy.spatial.transform import Rotation

LEAST = 2.0**-54  # a quarter of an ulp of 1: smaller errors, 0 among them, are drawn there on a logarithmic axis
KINDS = ("components", "invariants", "error", "axis")
FORMATS = (".csv", ".npz", ".parquet")
E3_COLUMNS, BODY_COLUMNS = ("J1", "J2", "J3", "x1", "x2", "x3"), ("q0", "q1", "q2", "q3", "L1", "L2", "L3")
MOTION_COLUMNS = {  # of the body, in the conventions of `Case`
    "position": ("px", "py", "pz"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "omega_body": ("wx", "wy", "wz"),
}


@dataclass(frozen=True)
class Start:
    """How a run began: what a trajectory needs to be judged, or evaluated at other times.

    state : (n,) numbers. method : the method's record. h : the step, None of jumps and of methods that choose their own steps.
    options : those of the method.
    """

    state: Array
    method: Method
    h: float | None
    options: Mapping[str, Any]


class Table:
    """What runs and ensembles have in common: a problem, named columns, a table, a file."""

    top: Any
    method: str
    t: Array
    y: Array
    _axes = 1  # of y, before those of a state

    @cached_property
    def problem(self) -> Any:
        """What was integrated: of a body its top, of a magnet its flow as a `Problem`."""
        return getattr(self.top, "problem", self.top)

    def columns(self) -> tuple[str, ...]:
        """The names of the n numbers of a state.

        Returns
        -------
        tuple of str
            Of a top J1, J2, J3, x1, x2, x3.
        """
        space = self.problem.space
        if space.name in ("e3", "body"):
            return E3_COLUMNS if space.name == "e3" else BODY_COLUMNS
        if space.vectors == 1:
            return "J1", "J2", "J3"
        return tuple(f"s{j}_{i}" for j in range(1, space.vectors + 1) for i in (1, 2, 3))

    def _places(self) -> dict[str, Array]:
        """The first columns of the table."""
        return {"t": self.t}

    def _motion(self) -> dict[str, Array]:
        """What is known of the motion of a body, beside the state: names of MOTION_COLUMNS, arrays with a row for each time."""
        return {}

    def _origin(self) -> dict[str, Any]:
        """What a file says of the run."""
        parameters = getattr(self.top, "parameters", ())
        return {"top": repr(self.top), **({"parameters": parameters} if len(parameters) else {})}

    @property
    def states(self) -> Array:
        """(N, n), of an ensemble (rows, motions, n): `y` with one row of numbers for each state."""
        return self.y.reshape(*self.y.shape[: self._axes], math.prod(self.y.shape[self._axes :]))

    def invariants(self) -> Array:
        """The invariants of the problem at all times.

        Returns
        -------
        (..., m)
            Shape (N, m), of an ensemble (rows, motions, m); of a top H, J3, C1, C2; else see `problem.names`.
        """
        return self.problem.invariants(self.states, self.t.reshape(-1, *(1,) * (self._axes - 1)))

    def to_frame(self, invariants: bool = False) -> pd.DataFrame:
        """A pandas frame with a row for each time (and motion).

        Parameters
        ----------
        invariants : bool
            Whether it has columns for the invariants, too.

        Returns
        -------
        DataFrame
            t, the place of the motion in an ensemble, and the numbers of the state. Of a RigidTop or a WholeBody also
            the position px py pz, and where the method follows the rotation its quaternion qw qx qy qz and the angular velocity
            in the body wx wy wz, in SI units. Last the invariants, if asked for.
        """
        import pandas as pd

        parts = {self.columns(): self.y, **{MOTION_COLUMNS[name]: part for name, part in self._motion().items()}}
        parts |= {self.problem.names: self.invariants()} if invariants else {}
        columns = self._places()
        for names, values in parts.items():
            columns |= dict(zip(names, values.reshape(-1, len(names)).T, strict=True))
        return pd.DataFrame(columns)

    def save(self, path: str | Path, metadata: Mapping[str, Any] | None = None) -> Path:
        """Write times and states, every double exactly.

        A table is that of `to_frame`; .npz has the arrays t and y, and of a body position, quaternion and omega_body.

        Parameters
        ----------
        path : str or Path
            A file that ends in .csv, .npz or .parquet.
        metadata : dict, optional
            What JSON can hold; it is written beside the method, the top or body and its parameters, the start, the step
            and the options.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError
            Another ending, or .parquet without pyarrow.
        OSError
            It cannot be written; nothing is lost.
        """
        path, facts = Path(path), {"method": self.method, **self._origin(), **(metadata or {})}
        kind = check_choice(path.suffix.lower(), "the ending of the file's name", FORMATS)
        if kind == ".npz":
            buffer = io.BytesIO()
            arrays: dict[str, Any] = {"t": self.t, "y": self.y, **self._motion(), "metadata": np.array(_text(facts))}
            np.savez(buffer, **arrays)
            return write_file(path, buffer.getvalue())
        if kind == ".parquet":
            return write_file(path, _parquet(self.to_frame(), facts))
        head = [f"# {key}: {_text(value)}\n" for key, value in facts.items()]
        return write_file(path, "".join(head) + self.to_frame().to_csv(index=False, na_rep="nan", lineterminator="\n"))


@dataclass(frozen=True, repr=False)
class Trajectory(Table):
    """Times and states of one motion: what `integrate` returns.

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, Problem, …
        What was followed.
    method : str
        The method's name.
    t : (N,)
        Times in the units of h.
    y : (N, 6)
        States in those of y0; of a Problem (N, size), of a magnet (N, n, 3).
    work : Work
        The work they took.
    follow : callable, optional
        () → (N, 4), the attitudes, where the start has one; called when they are first asked for.
    start : Start, optional
        How the run began.
    """

    top: Any
    method: str
    t: Array
    y: Array
    work: Work
    follow: Callable[[], Array] | None = field(default=None, compare=False)
    start: Start | None = field(default=None, compare=False, kw_only=True)

    def __repr__(self) -> str:
        count = len(self.t)
        span = f", t = {self.t[0]:.10g} … {self.t[-1]:.10g}" if count else ""
        return f"<{type(self).__name__} of {self.top!r} by {self.method}: {count} state{'s' * (count != 1)}{span}>"

    def _repr_html_(self) -> str:
        import html

        return f"<p>{html.escape(repr(self))}</p>{self.to_frame().to_html(max_rows=10, index=False)}"

    # ------------------------------------------------------------------ numbers

    def error(self) -> Array:
        """Distances to the exact or the reference solution, relative to the scales of the motion.

        Returns
        -------
        (N,)
            NaN where the reference solution is lost.

        Raises
        ------
        ValueError
            The run is too long for a reference solution, or there is none.
        """
        from lagrange_bench.integrators.truth import truths  # with mpmath: a run does not wait for it

        start = self._started("error")
        if start.h is None:
            true = truths.solution(self.problem, start.state, self.t)
        else:
            true = truths.after_steps(self.problem, start.state, start.h, np.rint(self.t / start.h).astype(np.int64))
        return scaled_size(self.problem, start.state, self.states - true)

    def sol(self, t: ArrayLike) -> Array:
        """States at any times, also later than the end of the run, by the method's dense output or jumps from the start.

        Parameters
        ----------
        t : float or (M,)
            Times in the units of h, counted from the start.

        Returns
        -------
        (6,) or (M, 6)
            The states, each of them shaped as a row of `y`.

        Raises
        ------
        ValueError
            The method steps on a grid only, or its dense output lacks an option of the run.
        """
        start, times = self._started("sol"), check_times(t, single=True)
        evaluate = start.method.evaluate_for(self.problem, start.options)
        if evaluate is None:
            raise ValueError(f"sol: {self.method} steps on a grid only; record more states with `every`")
        states, _ = evaluate(self.problem, start.state, np.atleast_1d(times), **start.options)
        return states.reshape(*times.shape, *self.y.shape[1:])

    def _origin(self) -> dict[str, Any]:
        if self.start is None:
            return super()._origin()
        start = self.start
        return {**super()._origin(), "y0": start.state.tolist(), "h": start.h, "options": dict(start.options)}

    def _started(self, word: str) -> Start:
        if self.start is None:
            raise ValueError(f"{word}: this trajectory does not know how it began")
        return self.start

    # ------------------------------------------------------------------ pictures and files

    def plot(self, what: str = "components", ax: Axes | None = None, **look: Any) -> Axes:
        """Draw the run.

        Parameters
        ----------
        what : str
            "components" of the state against time; "invariants", how far each one is from its start, relative to its terms;
            "error", see `error`; or "axis", the path of x on its sphere, of a top.
        ax : Axes, optional
            Axes to draw on, of a 3D projection for "axis"; by default those of a new figure.
        **look : dict
            Of the lines, as of matplotlib's `plot`.

        Returns
        -------
        Axes
            Those that were drawn on.
        """
        from matplotlib import pyplot as plt

        check_choice(what, "what", KINDS)
        if what == "axis":
            return self._plot_axis(ax or plt.figure().add_subplot(projection="3d"), look)
        ax = ax or plt.figure(layout="constrained").add_subplot()
        if what == "components":
            for name, values in zip(self.columns(), self.states.T, strict=True):
                ax.plot(self.t, values, **{"label": name, **look})
            ax.set_ylabel("components")
        elif what == "invariants":
            first = self.problem.invariants(self._started("plot").state, 0.0)
            scales = self.problem.invariant_scales(self._started("plot").state)
            for name, drift in zip(self.problem.names, ((self.invariants() - first) / scales).T, strict=True):
                ax.plot(self.t, np.maximum(np.abs(drift), LEAST), **{"label": name, **look})
            ax.set(yscale="log", ylabel="relative change of the invariants")
        else:
            from lagrange_bench.integrators.truth import truths

            ax.plot(self.t, np.maximum(self.error(), LEAST), **{"label": self.method, **look})
            ax.set(yscale="log", ylabel=f"error against the {truths.name(self.problem)}")
        ax.set(xlabel="time t", title=textwrap.shorten(f"{self.method}: {self.top!r}", 60, placeholder=" …"))
        ax.legend()
        return ax

    def _plot_axis(self, ax: Any, look: dict[str, Any]) -> Axes:
        if self.columns() != E3_COLUMNS:
            raise ValueError(f"what: {self.top!r} has no axis x on a sphere")
        if not hasattr(ax, "set_zlabel"):
            raise ValueError("ax: the axis is drawn in space: give axes made with projection='3d'")
        x = self.y[:, 3:]
        radius = float(np.linalg.norm(x[0]))
        around, half = np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13)
        sphere = (
            np.outer(np.cos(around), np.sin(half)),
            np.outer(np.sin(around), np.sin(half)),
            np.outer(around**0, np.cos(half)),
        )
        ax.plot_wireframe(*(radius * part for part in sphere), color="0.85", linewidth=0.4)
        ax.plot(*x.T, **{"label": self.method, **look})
        ax.plot(*x[:1].T, "o", color="black", ms=4, label="start")
        ax.set(xlabel="$x_1$", ylabel="$x_2$", zlabel="$x_3$ (up)", box_aspect=(1, 1, 1))
        ax.legend()
        return ax  # type: ignore[no-any-return]

    # ------------------------------------------------------------------ the body

    @cached_property
    def attitude(self) -> Array | None:
        """(N, 4) unit quaternions, scalar first, body to world; None where the start has none. Followed when first asked."""
        return self.follow() if self.follow else None

    @property
    def rotation(self) -> Rotation:
        """The body's N rotations, a SciPy Rotation from the body's frame to the world's."""
        from scipy.spatial.transform import Rotation

        if self.attitude is None:
            raise ValueError("y0 has no rotation: start from top.state(rotation=…), or integrate(…, attitude=True)")
        return Rotation.from_quat(self.attitude, scalar_first=True)

    def euler_angles(self) -> Array:
        """Euler angles of the body.

        Within 1e-7 of the vertical only phi ± psi has a meaning; all of it is then given to phi.

        Returns
        -------
        (N, 3)
            (theta, phi, psi) in rad: R = R3(phi) R2(theta) R3(psi).
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # says that
            return self.rotation.as_euler("ZYZ")[:, (1, 0, 2)]


@dataclass(frozen=True, repr=False)
class RigidTrajectory(Trajectory):
    """A trajectory of a RigidTop, in SI units; y (N, 6) is (J, x) in the frame whose third axis points up."""

    body: RigidTop = field(kw_only=True)
    spin: float | None = field(default=None, kw_only=True)  # rad/s, about the axis

    def _origin(self) -> dict[str, Any]:
        return {**super()._origin(), "body": repr(self.body)}

    def _motion(self) -> dict[str, Array]:
        place = {"position": self.position}
        try:
            return place if self.attitude is None else {**place, **_turning(self)}
        except ValueError:  # the method does not follow the rotation
            return place
        except StepError as lost:
            warn_caller(f"the table has no rotation: {lost}", RuntimeWarning)
            return place

    @property
    def position(self) -> Array:
        """The centre of mass in the world's frame, m, shape (N, 3)."""
        return self.body.positions(self.y)

    @property
    def omega_world(self) -> Array:
        """Angular velocity in the world's frame, rad/s, shape (N, 3)."""
        return np.einsum("ij,jk->ik", self.body.angular_velocity(self.y, self.spin), self.body.world)

    @property
    def omega_body(self) -> Array:
        """Angular velocity in the body's frame, rad/s, shape (N, 3)."""
        return self.rotation.apply(self.omega_world, inverse=True)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy, J, shape (N,)."""
        return self.body.energy(self.y)


@dataclass(frozen=True, repr=False)
class BodyTrajectory(Trajectory):
    """A trajectory of a WholeBody, in SI units; y (N, 7) is (q, L), see `problem.whole_body`."""

    def _motion(self) -> dict[str, Array]:
        known = self._turned()
        found = {name: np.full((len(known), len(columns)), np.nan) for name, columns in MOTION_COLUMNS.items()}
        if not known.any():  # SciPy 1.15 makes no Rotation of none
            return found
        run = replace(self, y=self.y[known])
        for name, part in {"position": run.position, **_turning(run)}.items():
            found[name][known] = part
        return found

    def _turned(self) -> NDArray[np.bool_]:
        """The rows that have a rotation, a mask: not those where the method failed."""
        with np.errstate(over="ignore"):
            size = np.sum(self.y[:, :4] ** 2, axis=1)
        return (size > 0.0) & (size < math.inf)

    @cached_property
    def attitude(self) -> Array:
        """(N, 4) unit quaternions, scalar first, body to world."""
        return self.rotation.as_quat(scalar_first=True)

    @property
    def rotation(self) -> Rotation:
        """The body's N rotations, a SciPy Rotation from the body's frame to the world's."""
        if not (known := self._turned()).all():
            lost = self.y[~known][0]
            raise ValueError(f"there is no rotation where the method failed: the state is {lost.tolist()}")
        return self.top.rotations(self.y)

    @property
    def position(self) -> Array:
        """The centre of mass in the world's frame, m, shape (N, 3)."""
        return self.rotation.apply(self.top.com)

    @property
    def omega_body(self) -> Array:
        """Angular velocity in the body's frame, rad/s, shape (N, 3)."""
        return self.top.angular_velocity(self.y)

    @property
    def omega_world(self) -> Array:
        """Angular velocity in the world's frame, rad/s, shape (N, 3)."""
        return self.rotation.apply(self.omega_body)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy, J, shape (N,)."""
        return self.top.energy(self.y)


@dataclass(frozen=True, repr=False, eq=False)
class EnsembleTrajectory(Table, np.lib.mixins.NDArrayOperatorsMixin):
    """Times and states of many motions: what `integrate_ensemble` returns.

    As an array (`np.asarray`, indexing, arithmetic) it is `y`; or, where only the end is recorded, that one row, of shape (n, 6).

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, Problem, …
        What was followed, with an array of alphas or parameters where the motions differ.
    method : str
        The method's name.
    t : (rows,)
        Times in the units of h.
    y : (rows, n, 6)
        States in those of Y0; of a Problem (rows, n, size), of a magnet (rows, n, sites, 3).
    end_only : bool
        Whether the one row is the end.
    begin : callable
        Number of a motion → its top and its start.
    """

    top: Any
    method: str
    t: Array
    y: Array
    end_only: bool
    begin: Callable[[int], tuple[Any, Start]]  # top and start of the motion of a place
    _axes = 2

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.y[0] if self.end_only else self.y, dtype=dtype, copy=copy)

    def __array_ufunc__(self, ufunc: np.ufunc, how: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(v) if isinstance(v, EnsembleTrajectory) else v for v in inputs)
        return getattr(ufunc, how)(*arrays, **options)

    def __getitem__(self, place: Any) -> Any:
        return np.asarray(self)[place]

    def __len__(self) -> int:
        return len(np.asarray(self))

    @property
    def shape(self) -> tuple[int, ...]:
        """Of what it is as an array."""
        return np.asarray(self).shape

    def __repr__(self) -> str:
        rows, n, top = *self.y.shape[:2], textwrap.shorten(repr(self.top), 60, placeholder=" …")
        span = f", t = {self.t[0]:.10g} … {self.t[-1]:.10g}" if rows else ""
        return f"<{type(self).__name__} of {top} by {self.method}: {n} motions, {rows} states each{span}>"

    def motion(self, place: int) -> Trajectory:
        """The motion of one place, with its own `error()`, `plot()` and `sol()`.

        Y0 is not copied: do not change it before.

        Parameters
        ----------
        place : int
            Its row in Y0.

        Returns
        -------
        Trajectory
            Of that motion.

        Raises
        ------
        ValueError, IndexError
            `place` is no whole number, or there are not so many motions.
        """
        motions = self.y.shape[1]
        if isinstance(place, bool) or not isinstance(place, (int, np.integer)):
            raise ValueError(f"place must be a whole number, that of one motion; got {place!r}")
        if not -motions <= place < motions:
            raise IndexError(f"place must be below {motions}, the number of motions; got {place}")
        return self._run(self.y[:, place], *self.begin(place % motions))

    def _run(self, y: Array, top: Any, start: Start | None = None) -> Trajectory:
        facts = (self.method, self.t, y, Work())
        if isinstance(top, RigidTop):
            return RigidTrajectory(top.problem, *facts, start=start, body=top)
        whole = "body" in getattr(top, "problem", top).offers
        return (BodyTrajectory if whole else Trajectory)(top, *facts, start=start)

    def _motion(self) -> dict[str, Array]:
        if not isinstance(self.top, RigidTop) and self.columns() != BODY_COLUMNS:
            return {}
        known = self._run(self.y.reshape(-1, self.y.shape[2]), self.top)._motion()  # all motions are of the same body
        return {name: part.reshape(*self.y.shape[:2], part.shape[1]) for name, part in known.items()}

    def _places(self) -> dict[str, Array]:
        """Times and numbers of the motions."""
        rows, n = self.y.shape[:2]
        return {"t": np.repeat(self.t, n), "motion": np.tile(np.arange(n), rows)}


def _turning(run: Any) -> dict[str, Array]:
    """Rotation and angular velocity of a body."""
    return {"quaternion": run.rotation.as_quat(canonical=True, scalar_first=True), "omega_body": run.omega_body}


def _text(value: Any) -> str:
    """JSON; what that cannot hold, such as a complex option, as Python writes it, but numbers of NumPy as numbers."""
    numbers = np.generic, np.ndarray
    return json.dumps(value, ensure_ascii=False, default=lambda v: v.tolist() if isinstance(v, numbers) else repr(v))


def _parquet(frame: pd.DataFrame, facts: Mapping[str, Any]) -> bytes:
    if importlib.util.find_spec("pyarrow") is None:
        raise ValueError("pyarrow is not installed: pip install pyarrow; or write .csv or .npz")
    import pyarrow
    from pyarrow import parquet

    texts = {key: _text(value) for key, value in facts.items()}
    table = pyarrow.table({name: pyarrow.array(frame[name].to_numpy()) for name in frame}, metadata=texts)
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()
