"""What `integrate` and `integrate_ensemble` return: times and states, and what follows from them.

run = integrate(top, y0, h=0.1, steps=1000, every=10)
run.to_frame(), run.plot("axis"), run.error(), run.save("run.csv")

Pictures and files are made by `plot_and_save`.
"""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators import plot_and_save
from lagrange_bench.integrators.checks import check_times
from lagrange_bench.integrators.interface import Array, Method, Work
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import scaled_distance

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from scipy.spatial.transform import Rotation

E3_COLUMNS, BODY_COLUMNS = ("J1", "J2", "J3", "x1", "x2", "x3"), ("q0", "q1", "q2", "q3", "L1", "L2", "L3")
MOTION_COLUMNS = {  # of the body, in the conventions of `Case`
    "position": ("px", "py", "pz"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "omega_body": ("wx", "wy", "wz"),
    "velocity": ("vx", "vy", "vz"),
}


@dataclass(frozen=True, eq=False)
class Start:
    """How a run began: what a trajectory needs to be judged, or evaluated at other times.

    state : (n,) numbers. method : the method's record. h : the step, None of jumps and of methods that choose their own steps.
    options : those of the method. flight : of a flying body (6,), position and velocity.
    """

    state: Array
    method: Method
    h: float | None
    options: Mapping[str, Any]
    flight: Array | None = None


class Table:
    """What runs and ensembles have in common: a problem, named columns, a table, a file."""

    top: Any
    method: str
    t: Array
    y: Array

    @property
    def problem(self) -> Any:
        """What was followed."""
        return self.top

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
        """(N, n), of an ensemble (rows, motions, n): `y` without the place of a flying body."""
        return self.y[..., : self.problem.space.size]

    def invariants(self) -> Array:
        """The invariants of the problem at all times.

        Returns
        -------
        (..., m)
            Shape (N, m), of an ensemble (rows, motions, m); of a top H, J3, C1, C2; else see `problem.names`.
        """
        return self.problem.invariants(self.states, self.t.reshape(-1, *(1,) * (self.y.ndim - 2)))

    def to_frame(self, invariants: bool = False) -> pd.DataFrame:
        """A pandas frame with a row for each time (and motion).

        Parameters
        ----------
        invariants : bool
            Whether it has columns for the invariants, too.

        Returns
        -------
        DataFrame
            t, the place of the motion in an ensemble, and the numbers of the state. Of a RigidBody also the position px py pz,
            the quaternion qw qx qy qz, the angular velocity in the body wx wy wz, and where it flies the velocity vx vy vz, in
            SI units. Last the invariants, if asked for.
        """
        import pandas as pd

        parts = {self.columns(): self.states, **{MOTION_COLUMNS[name]: part for name, part in self._motion().items()}}
        parts |= {self.problem.names: self.invariants()} if invariants else {}
        columns = self._places()
        for names, values in parts.items():
            columns |= dict(zip(names, values.reshape(-1, len(names)).T, strict=True))
        return pd.DataFrame(columns)

    def save(self, path: str | Path, metadata: Mapping[str, Any] | None = None) -> Path:
        """Write times and states, every double exactly.

        A table is that of `to_frame`; .npz has the arrays t and y, and of a body position, quaternion, omega_body and velocity.

        Parameters
        ----------
        path : str or Path
            A file that ends in .csv, .npz or .parquet.
        metadata : dict, optional
            Texts → what JSON can hold; it is written beside the method, the top or body and its parameters, the start, the
            step and the options.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError
            Another ending, .parquet without pyarrow, or metadata that JSON cannot hold or that would be misread in the file.
        OSError
            It cannot be written; nothing is lost.
        """
        if metadata is not None and not isinstance(metadata, Mapping):
            raise ValueError(f"metadata must be a dict; got {metadata!r}")
        facts = {"method": self.method, **self._origin(), **(metadata or {})}
        return plot_and_save.save(
            Path(path), facts, lambda: {"t": self.t, "y": self.y, **self._motion()}, self.to_frame
        )


@dataclass(frozen=True, repr=False, eq=False)
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
        States in those of y0; of a Problem (N, size), of a flying body (N, 13).
    work : Work
        The work they took.
    start : Start, optional
        How the run began.
    """

    top: Any
    method: str
    t: Array
    y: Array
    work: Work
    start: Start | None = None

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
            NaN where the reference solution is lost; of a heavy body without symmetry also beyond 2000 time scales, with a
            warning.

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
        return scaled_distance(self.problem, start.state, self.states, true)

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
        if start.flight is not None:
            states = np.hstack((states, self.problem.flown(start.flight, np.atleast_1d(times))))
        return states.reshape(*times.shape, *self.y.shape[1:])

    def _origin(self) -> dict[str, Any]:
        origin = super()._origin()
        if (start := self.start) is not None:
            origin |= {"y0": start.state.tolist(), "h": start.h, "options": dict(start.options)}
        return origin

    def _started(self, word: str) -> Start:
        if self.start is None:
            raise ValueError(f"{word}: this trajectory does not know how it began")
        return self.start

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
        if what == "invariants":
            self._started("plot")
        return plot_and_save.plot(self, what, ax, look)

    # ------------------------------------------------------------------ the body

    @property
    def _body(self) -> RigidBody:
        """The body that moves. AttributeError: there is none."""
        if not isinstance(self.problem, RigidBody):
            raise AttributeError(f"{self.top!r} has no rotation or position: follow a RigidBody")
        return self.problem

    def _with_rotation(self) -> NDArray[np.bool_]:
        """The rows that have a rotation, a mask: not those where the method failed."""
        with np.errstate(over="ignore"):
            size = np.sum(self.y[:, :4] ** 2, axis=1)
        return (size > 0.0) & (size < math.inf)

    @property
    def rotation(self) -> Rotation:
        """The N rotations of a RigidBody, a SciPy Rotation from the body's frame to the world's."""
        body = self._body
        if not (known := self._with_rotation()).all():
            raise ValueError(f"there is no rotation where the method failed: the state is {self.y[~known][0].tolist()}")
        return body.rotations(self.y)

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

    @property
    def position(self) -> Array:
        """The centre of mass of a RigidBody in the world's frame, m, shape (N, 3)."""
        return self.rotation.apply(self._body.com) if self._body.fixed else self.y[:, 7:10]

    @property
    def velocity(self) -> Array:
        """The velocity of the centre of mass of a RigidBody in the world's frame, m/s, shape (N, 3)."""
        return np.cross(self.omega_world, self.position) if self._body.fixed else self.y[:, 10:]

    @property
    def omega_body(self) -> Array:
        """Angular velocity of a RigidBody in its own frame, rad/s, shape (N, 3)."""
        return self._body.angular_velocity(self.y)

    @property
    def omega_world(self) -> Array:
        """Angular velocity of a RigidBody in the world's frame, rad/s, shape (N, 3)."""
        return self.rotation.apply(self.omega_body)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy of a RigidBody, J, shape (N,); 0 at rest at the height of the origin."""
        body, turning = self._body, self.problem.energy(self.states)
        if body.fixed:
            return turning
        return turning + body.mass * (np.sum(self.velocity**2, axis=1) / 2 - self.position @ body.gravity)

    @property
    def momentum(self) -> Array:
        """Angular momentum of a RigidBody about its fixed point (or its centre of mass, if it flies) in the world's frame.

        kg m²/s, shape (N, 3).
        """
        return self.rotation.apply(self.y[:, 4:7] @ self._body.axes)

    def _motion(self) -> dict[str, Array]:
        if not isinstance(self.problem, RigidBody):
            return {}
        known, names = self._with_rotation(), ["position", "quaternion", "omega_body"]
        names += [] if self.problem.fixed else ["velocity"]
        motion = {name: np.full((len(known), len(MOTION_COLUMNS[name])), np.nan) for name in names}
        if known.any():  # SciPy 1.15 makes no Rotation of none
            run = replace(self, y=self.y[known])
            motion["quaternion"][known] = run.rotation.as_quat(canonical=True, scalar_first=True)
            for name in {*names} - {"quaternion"}:
                motion[name][known] = getattr(run, name)
        return motion


def motion_of(top: Any, place: int) -> Any:
    """What is followed in the motion of this place of an ensemble: of arrays of alphas or parameters its own."""

    def number(value: Any) -> float:
        return float(value[place] if np.ndim(value) else value)

    if isinstance(top, PerturbedTop):
        return PerturbedTop(LagrangeTop(number(top.alpha)), top.potential, tuple(map(number, top.parameters)))
    return LagrangeTop(number(top.alpha)) if isinstance(top, LagrangeTop) else top


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
        States in those of Y0; of a Problem (rows, n, size).
    end_only : bool
        Whether the one row is the end.
    start : Start
        How the run began: its `state` (n, 6) are those of all motions.
    """

    top: Any
    method: str
    t: Array
    y: Array
    end_only: bool
    start: Start

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
        state, top = self.start.state[place], motion_of(self.top, place)
        state, flight = top.parted(state) if isinstance(top, RigidBody) else (state, None)
        start = replace(self.start, state=state, flight=flight)
        return Trajectory(top, self.method, self.t, self.y[:, place], Work(), start)

    def _motion(self) -> dict[str, Array]:
        if not isinstance(self.problem, RigidBody):
            return {}
        rows = self.y.reshape(-1, self.y.shape[2])  # all motions are of the same body
        motion = Trajectory(self.top, self.method, self.t, rows, Work())._motion()
        return {name: part.reshape(*self.y.shape[:2], part.shape[1]) for name, part in motion.items()}

    def _places(self) -> dict[str, Array]:
        """Times and numbers of the motions."""
        rows, n = self.y.shape[:2]
        return {"t": np.repeat(self.t, n), "motion": np.tile(np.arange(n), rows)}
