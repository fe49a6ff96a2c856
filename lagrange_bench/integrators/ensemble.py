"""Many motions at once: `integrate_ensemble`.

The exact Bäcklund step offers `Method.many`: it takes a thousand tops in a uniform field in one compiled call, in SIMD lanes. All
other motions are runs of `integrate`, one by one in each thread; compiled code releases Python's lock.

Every motion has the bits of `integrate`. A motion depends neither on the threads, nor on its place or its neighbours.
"""

from __future__ import annotations

import math
import threading
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators import checks
from lagrange_bench.integrators.api import default_method, grid_times, integrate
from lagrange_bench.integrators.interface import Array, Method, StepError, Work
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.start import check_problem, split_state
from lagrange_bench.integrators.trajectory import EnsembleTrajectory, RunInputs
from lagrange_bench.support import machine

CHUNK = 1024  # tops in one call, at most: their constants stay in the processor's cache


def integrate_ensemble(
    top: Problem,
    Y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method | None = None,
    every: int | None = None,
    t: ArrayLike | None = None,
    threads: int | None = None,
    on_failure: str = "raise",
    **options: Any,
) -> EnsembleTrajectory:
    """Follow n tops from Y0 (n, 6), as `integrate` does one: to the end, on a grid or at times.

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, RigidBody or Problem
        One for all motions; or LagrangeTop(alpha=array) with one alpha for each.
    Y0 : (n, 6)
        Initial states; of a Problem (n, size), and then the returned ones have this size, too.
    h, steps, method : float, int, str or Method
        As in `integrate`.
    every : int
        Record one state in `every`: steps//every + 1 rows, the first of them Y0. By default the end alone.
    t : (m,)
        Output times in place of h and steps: m rows. The exact Bäcklund step jumps from Y0 to each of them.
    threads : int
        Default: one per usable core.
    on_failure : str
        "raise" a StepError that names the first top for which the method fails, and says how many there are; or "nan": all rows
        of such tops are NaN.
    **options : dict
        Options of the method.

    Returns
    -------
    EnsembleTrajectory
        t (rows,) and y (rows, n, 6); by default one row, the end.

    Raises
    ------
    ValueError
        Bad input; the message names the argument.
    StepError
        See `on_failure`.
    KeyboardInterrupt
        Ctrl-C, seen within a fraction of a second (between two tops, where they are taken one by one).
    """
    states = _check_states(top, Y0)
    n, sample = len(states), top.motion(0) if len(states) else LagrangeTop()
    record = find_method(default_method(sample) if method is None else method)
    threads = machine.usable_cores() if threads is None else checks.check_count(threads, "threads", least=1)
    checks.check_choice(on_failure, "on_failure", ("raise", "nan"))
    times = checks.check_times_or_grid(t, h, steps, every)
    if times is None:
        h = checks.check_step(h)
        record.prepare_for(sample, options)
        steps, stride = checks.check_grid(steps, every, "steps")
        grid: dict[str, Any] = {"h": h, "steps": steps, "every": stride}
        times = grid_times(h, stride, steps // stride + 1)[-1 if every is None else 0 :]
    else:
        record.evaluate_for(sample, options)  # or a ValueError
        grid = {"t": times}
    work = _Work(top, states, record, grid, options, np.empty((len(times), *states.shape)))
    work.do(threads)
    if work.failures and on_failure == "raise":
        place, error = min(work.failures, key=lambda failure: failure[0])
        reason = f"top {place}: {error.reason}"
        if len(work.failures) > 1:
            reason += f"; {len(work.failures)} of {n} tops fail"
        raise StepError(record.name, reason, h=grid.get("h"), step=error.step) from error
    start = RunInputs(states, record, grid.get("h") if record.control == "step" else None, options)
    return EnsembleTrajectory(top, record.name, times, work.out, Work(), start)


@dataclass
class _Work:
    """The motions to follow. `grid` holds arguments of `integrate`; the states go into `out` (rows, n, size)."""

    problem: Any
    states: Array
    method: Method
    grid: dict[str, Any]
    options: dict[str, Any]
    out: Array
    failures: list[tuple[int, StepError]] = field(default_factory=list)
    stop: threading.Event = field(default_factory=threading.Event)

    def do(self, threads: int) -> None:
        """Follow all motions."""
        n = len(self.states)
        length = max(1, min(CHUNK, -(-n // threads)))
        chunks = [slice(first, min(first + length, n)) for first in range(0, n, length)]
        if threads == 1 or len(chunks) < 2:
            for chunk in chunks:
                self.follow(chunk)
            return
        if self.method.many is None:
            with suppress(StepError):  # compiles once, not in every thread
                self.alone(0, {"t": ()} if "t" in self.grid else {"h": self.grid["h"], "steps": 0})
        with ThreadPoolExecutor(threads) as pool:
            try:
                for done in as_completed([pool.submit(self.follow, chunk) for chunk in chunks]):
                    done.result()
            except BaseException:  # Ctrl-C, or a state that is refused
                self.stop.set()
                pool.shutdown(cancel_futures=True)
                raise

    def follow(self, chunk: slice) -> None:
        """Follow a chunk of motions: together where the method can, the others one by one."""
        for i in np.flatnonzero(~self.together(chunk)):
            if self.stop.is_set():
                return
            place = chunk.start + int(i)
            try:
                self.out[:, place] = self.alone(place, self.grid)[-len(self.out) :]
            except StepError as error:
                self.out[:, place] = np.nan
                self.failures.append((place, error))

    def alone(self, place: int, grid: dict[str, Any]) -> Array:
        """The rows of one motion."""
        problem, y0 = self.problem.motion(place), self.states[place]
        return integrate(problem, y0, method=self.method, **grid, **self.options).y

    def together(self, chunk: slice) -> NDArray[np.bool_]:
        """Follow a chunk in one call. Returns a mask of the motions that are done."""
        states, out, steps = self.states[chunk], self.out[:, chunk], self.grid.get("steps")
        done = np.zeros(len(states), dtype=bool)
        uniform = kinds.uniform(self.problem)
        if not (self.method.many and uniform and steps and math.isfinite(self.grid["h"] * steps)):
            return done
        every = self.grid["every"]
        alphas = np.broadcast_to(self.problem.alpha, len(self.states))[chunk]
        out[0] = states  # if only the end is recorded, it replaces this
        arguments = alphas, states, self.grid["h"], steps, every, out[len(out) - steps // every :]
        done = self.method.many(*arguments, self.stop.is_set, **self.options)
        finite = np.isfinite(out)
        if not finite.all():  # along some axes only, `all` takes many times as long
            done &= finite.all(axis=(0, 2))
        return done


def _check_states(top: Any, Y0: ArrayLike) -> Array:
    """The states (n, size), contiguous float64; of a LagrangeTop not copied if Y0 is that already."""
    problem = check_problem(top)
    try:
        rows: Any = np.asarray(Y0) if hasattr(Y0, "__array__") else list(Y0)  # type: ignore[arg-type]
        n = len(rows)
    except TypeError:
        raise ValueError(f"Y0 must be states, one for each motion; got {type(Y0).__name__}") from None
    alpha: Any = getattr(problem, "alpha", 0.0)
    if np.ndim(alpha) and len(alpha) != n:
        raise ValueError(f"Y0 has {n} states, and the top {len(alpha)} values of alpha")
    is_table = kinds.uniform(problem) and isinstance(rows, np.ndarray) and rows.shape == (n, 6)
    # along one axis only, `all` takes many times as long
    if is_table and rows.dtype.kind in "iuf" and np.isfinite(rows).all() and rows[:, 3:].any(axis=1).all():
        return np.ascontiguousarray(rows, dtype=np.float64)
    checked = [_check_state(problem.motion(i), y, f"Y0[{i}]") for i, y in enumerate(rows)]
    return np.array(checked) if checked else np.empty((0, problem.space.size))


def _check_state(problem: Any, y: Any, name: str) -> Array:
    """A state, checked as `integrate` does."""
    y, flight = split_state(problem, y)
    state: Array = problem.check_state(y, name)
    return state if flight is None else np.concatenate((state, flight))
