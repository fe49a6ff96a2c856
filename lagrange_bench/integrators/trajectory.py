"""The result of `integrate`: times and states of one motion, and what follows from them.

run = integrate(top, y0, h=0.1, steps=1000, every=10)
run.to_frame(), run.plot("axis"), run.error(), run.save("run.csv")

`plot_and_save` draws and writes, and `body_motion` is the part for rigid bodies. EnsembleTrajectory is the result of ensembles.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.integrators import plot_and_save
from lagrange_bench.integrators.body_motion import MOTION_COLUMNS, BodyMotion
from lagrange_bench.integrators.interface import Array, Method, Work
from lagrange_bench.integrators.problem.units import scaled_distance
from lagrange_bench.integrators.registry import METHODS, find_method

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class RunInputs:
    """How a run began. With it a trajectory can be judged.

    state : (n,) numbers. method : the method's record. h : the step; None for jumps, and for methods that choose their own steps.
    options : those of the method. flight : position and velocity (6,) of a flying body.
    """

    state: Array
    method: Method
    h: float | None
    options: Mapping[str, Any]
    flight: Array | None = None

    def __getstate__(self) -> dict[str, Any]:
        """A registered method goes to other processes by its name: pickle refuses functions that its record may hold."""
        known = METHODS.get(self.method.name) is self.method
        return {**vars(self), "method": self.method.name if known else self.method}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, method=find_method(state["method"]))


@dataclass(frozen=True, repr=False, eq=False)
class Rows:
    """The common part of runs and ensembles: a problem, named columns, a table, a file."""

    top: Any
    method: str
    t: Array
    y: Array
    work: Work
    start: RunInputs | None = None

    def columns(self) -> tuple[str, ...]:
        """The names of the n numbers of a state.

        Returns
        -------
        tuple of str
            Of a top J1, J2, J3, x1, x2, x3.
        """
        names: tuple[str, ...] = self.top.space.columns
        return names

    def _motion(self) -> dict[str, Array]:
        """The motion of a body: names of MOTION_COLUMNS → arrays with a row for each time. Empty for other problems."""
        return {}

    @property
    def states(self) -> Array:
        """The states (N, n), of an ensemble (rows, motions, n): `y` without position and velocity of a flying body."""
        return self.y[..., : self.top.space.size]

    def invariants(self) -> Array:
        """The invariants of the problem at all times.

        Returns
        -------
        (..., m)
            Shape (N, m), of an ensemble (rows, motions, m); of a top H, J3, C1, C2; else see `problem.names`.
        """
        return self.top.invariants(self.states, self.t.reshape(-1, *(1,) * (self.y.ndim - 2)))

    def to_frame(self, invariants: bool = False) -> pd.DataFrame:
        """A pandas frame with a row for each time (and motion).

        Parameters
        ----------
        invariants : bool
            Whether it has columns for the invariants, too.

        Returns
        -------
        DataFrame
            t, the place of the motion in an ensemble, and the numbers of the state. A RigidBody also has the position px py pz,
            the quaternion qw qx qy qz, and the angular velocity in the body wx wy wz, in SI units. A flying one has the velocity
            vx vy vz, too. The invariants come last.
        """
        import pandas as pd

        parts = {self.columns(): self.states, **{MOTION_COLUMNS[name]: part for name, part in self._motion().items()}}
        if invariants:
            parts[self.top.names] = self.invariants()
        n = self.y.shape[1] if self.y.ndim == 3 else 1
        columns = {"t": np.repeat(self.t, n)}
        if self.y.ndim == 3:
            columns["motion"] = np.tile(np.arange(n), len(self.t))
        for names, values in parts.items():
            columns |= dict(zip(names, values.reshape(-1, len(names)).T, strict=True))
        return pd.DataFrame(columns)

    def save(self, path: str | Path, metadata: Mapping[str, Any] | None = None) -> Path:
        """Write times and states, every double exactly.

        Tables are those of `to_frame`; .npz has the arrays t and y, and of a body position, quaternion, omega_body and velocity.

        Parameters
        ----------
        path : str or Path
            A file that ends in .csv, .npz or .parquet.
        metadata : dict, optional
            Names → values that JSON can hold. They are written beside the method, the top or body and its parameters, the start,
            the step and the options.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError
            Another ending, or .parquet without pyarrow.
        TypeError
            Metadata that JSON cannot hold.
        OSError
            The file cannot be written; an older one is untouched.
        """
        facts: dict[str, Any] = {"method": self.method, "top": repr(self.top)}
        if len(parameters := getattr(self.top, "parameters", ())):
            facts["parameters"] = parameters
        if self.start is not None and self.y.ndim == 2:
            facts |= {"y0": self.start.state.tolist(), "h": self.start.h, "options": dict(self.start.options)}
        facts |= metadata or {}
        return plot_and_save.save(
            Path(path), facts, lambda: {"t": self.t, "y": self.y, **self._motion()}, self.to_frame
        )


class Trajectory(BodyMotion, Rows):
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
        States in the units of y0; of a Problem (N, size), of a flying body (N, 13).
    work : Work
        The work of the run.
    start : RunInputs, optional
        How the run began.
    """

    def __repr__(self) -> str:
        count = len(self.t)
        span = f", t = {self.t[0]:.10g} … {self.t[-1]:.10g}" if count else ""
        return f"<{type(self).__name__} of {self.top!r} by {self.method}: {count} state{'s' * (count != 1)}{span}>"

    def error(self) -> Array:
        """Distances to the exact or the reference solution, relative to the scales of the motion.

        Returns
        -------
        (N,)
            NaN where a chaotic reference solution is lost; of a heavy body without symmetry also beyond 2000 time scales, with a
            warning.

        Raises
        ------
        ValueError
            The run is too long for a reference solution, or there is none; or λ was given, and a step does not take the time h.
        """
        from lagrange_bench.integrators.truth import truths  # with mpmath: a run does not wait for it

        start = self._started("error")
        if start.method.family == "backlund" and start.options.get("lam") is not None:
            raise ValueError("lam given: one step is the flow over another time than h, and a turn")
        if start.h is None:
            true = truths.solution(self.top, start.state, self.t)
        else:
            true = truths.after_steps(self.top, start.state, start.h, np.rint(self.t / start.h).astype(np.int64))
        return scaled_distance(self.top, start.state, self.states, true)

    def _started(self, word: str) -> RunInputs:
        if self.start is None:
            raise ValueError(f"{word}: this trajectory does not know how it began")
        return self.start

    def animate(self, path: str | Path, frames: int = 72, seconds: float = 6.0) -> Path:
        """Write a moving picture: the axis of a top, or the three principal axes of a body, on a sphere.

        Parameters
        ----------
        path : str or Path
            The file to write, a GIF.
        frames : int
            How many pictures, equally spaced in the rows of the run.
        seconds : float
            How long one round of the film takes.

        Returns
        -------
        Path
            The file that was written.

        Raises
        ------
        ValueError
            The run has fewer rows than frames, or it has no axis in space.
        """
        from lagrange_bench.integrators import animation

        return animation.animate(self, Path(path), frames, seconds)

    def plot(self, what: str = "components", ax: Axes | None = None, **look: Any) -> Axes:
        """Draw the run.

        Parameters
        ----------
        what : str
            "components" of the state against time; "invariants", how far each one is from its start, relative to its terms;
            "error", see `error`; or "axis", the path of x on its sphere, of a top. States that are far apart are dots.
        ax : Axes, optional
            Axes to draw on, of a 3D projection for "axis"; by default those of a new figure.
        **look : dict
            Options of matplotlib's `plot` for the lines.

        Returns
        -------
        Axes
            The axes with the picture.
        """
        if what == "invariants":
            self._started("plot")
        return plot_and_save.plot(self, what, ax, look)


class EnsembleTrajectory(Rows):
    """Times and states of many motions: what `integrate_ensemble` returns.

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, Problem, …
        What was followed, with an array of alphas where the tops differ.
    method : str
        The method's name.
    t : (rows,)
        Times in the units of h.
    y : (rows, n, 6)
        States in the units of Y0; of a Problem (rows, n, size).
    work : Work
        Not counted here.
    start : RunInputs
        How the run began; its `state` (n, 6) is Y0.
    """

    start: RunInputs

    def __repr__(self) -> str:
        rows, n, top = *self.y.shape[:2], textwrap.shorten(repr(self.top), 60, placeholder=" …")
        span = f", t = {self.t[0]:.10g} … {self.t[-1]:.10g}" if rows else ""
        return f"<{type(self).__name__} of {top} by {self.method}: {n} motions, {rows} states each{span}>"

    def motion(self, place: int) -> Trajectory:
        """One of the motions, with its own `error()` and `plot()`.

        Y0 is not copied, so do not change it before this call.

        Parameters
        ----------
        place : int
            Its row in Y0.

        Returns
        -------
        Trajectory
            The motion.

        Raises
        ------
        ValueError, IndexError
            `place` is no whole number, or there are not so many motions.
        """
        if not isinstance(place, (int, np.integer)):
            raise ValueError(f"place must be a whole number, that of one motion; got {place!r}")
        y, top = self.y[:, place], self.top.motion(place)  # or an IndexError
        state, flight = np.split(self.start.state[place], [top.space.size])
        return Trajectory(
            top,
            self.method,
            self.t,
            y,
            Work(),
            replace(self.start, state=state, flight=flight if len(flight) else None),
        )

    def _motion(self) -> dict[str, Array]:
        rows = self.y.reshape(-1, self.y.shape[2])  # all motions are of the same body
        motion = Trajectory(self.top, self.method, self.t, rows, Work())._motion()
        return {name: part.reshape(*self.y.shape[:2], part.shape[1]) for name, part in motion.items()}
