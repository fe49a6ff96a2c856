"""The result of `integrate_ensemble`."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lagrange_bench.integrators.interface import Array, Work
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.trajectory import Rows, RunInputs, Trajectory


@dataclass(frozen=True, repr=False, eq=False)
class EnsembleTrajectory(Rows, np.lib.mixins.NDArrayOperatorsMixin):
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
        States in the units of Y0; of a Problem (rows, n, size).
    end_only : bool
        Whether the one row is the end.
    start : RunInputs
        How the run began; its `state` (n, 6) is Y0.
    """

    top: Any
    method: str
    t: Array
    y: Array
    end_only: bool
    start: RunInputs

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
        """The shape as an array."""
        return np.asarray(self).shape

    def __repr__(self) -> str:
        rows, n, top = *self.y.shape[:2], textwrap.shorten(repr(self.top), 60, placeholder=" …")
        span = f", t = {self.t[0]:.10g} … {self.t[-1]:.10g}" if rows else ""
        return f"<{type(self).__name__} of {top} by {self.method}: {n} motions, {rows} states each{span}>"

    def motion(self, place: int) -> Trajectory:
        """One of the motions, with its own `error()`, `plot()` and `sol()`.

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
        motions = self.y.shape[1]
        if isinstance(place, bool) or not isinstance(place, (int, np.integer)):
            raise ValueError(f"place must be a whole number, that of one motion; got {place!r}")
        if not -motions <= place < motions:
            raise IndexError(f"place must be below {motions}, the number of motions; got {place}")
        state, top = self.start.state[place], self.top.motion(place)
        state, flight = top.split_state(state)
        start = replace(self.start, state=state, flight=flight)
        return Trajectory(top, self.method, self.t, self.y[:, place], Work(), start)

    def _motion(self) -> dict[str, Array]:
        if not kinds.rigid_body(self.problem):
            return {}
        rows = self.y.reshape(-1, self.y.shape[2])  # all motions are of the same body
        motion = Trajectory(self.top, self.method, self.t, rows, Work())._motion()
        return {name: part.reshape(*self.y.shape[:2], part.shape[1]) for name, part in motion.items()}

    def _places(self) -> dict[str, Array]:
        """Times and numbers of the motions."""
        rows, n = self.y.shape[:2]
        return {"t": np.repeat(self.t, n), "motion": np.tile(np.arange(n), rows)}
