"""Many tops at once: `integrate_ensemble`.

The tops are cut into chunks, the chunks shared out among threads; compiled code lets go of Python's lock. A method that
offers `advance_many` (or `evaluate_many`) takes a chunk in one call: the exact Bäcklund step with its set-up compiled,
heyoka in its batch mode. Other fixed-step methods whose steppers declare a `lane` take their tops in the same SIMD
lanes as the Bäcklund step. All have the bits of one top alone, with two exceptions, which differ by round-off:
heyoka's batches, and short runs of the Bäcklund step. `backlund.SHORT` steps or fewer take λ(h) in plain doubles, of
any h. The splitting with the exact step inside takes λ(h) from the table of each top, other splittings one rotation
and kick after the other. Implicit methods take their tops one by one, because each top needs its own number of
iterations. So does all that is not compiled here. Tops that are left undone are also taken one by one: those of
extreme size, and those for which the method fails. Then the StepError is the scalar one. A `PerturbedTop` goes the
same ways, each top with its own numbers; the motions of a `Problem` are taken one by one. What becomes of a
top depends on nothing but itself: not on the chunks, the threads, or its place.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators import checks, machine
from lagrange_bench.integrators.compiling.lanes import LANES, run_lanes
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.interface import Array, Method, StepError, Stepper
from lagrange_bench.integrators.problem.body import RigidTop, has_unit_axis
from lagrange_bench.integrators.problem.nature import natures
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.watched import check_rows, watched
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.trajectory import EnsembleTrajectory, Start

CHUNK = 1024  # tops in one call, at most: their constants stay in the processor's cache
FEW = LANES // 2  # tops of the last block below which they are quicker one by one


@dataclass(frozen=True)
class _Begin:
    """How each motion of an ensemble began."""

    top: Any
    states: Array
    method: Method
    h: float | None
    options: dict[str, Any]

    def __call__(self, place: int) -> tuple[Any, Start]:
        def own(value: Any) -> float:
            return float(value[place] if np.ndim(value) else value)

        top = self.top
        if isinstance(top, PerturbedTop):
            top = PerturbedTop(LagrangeTop(own(top.alpha)), top.potential, tuple(map(own, top.parameters)))
        elif isinstance(top, LagrangeTop):
            top = LagrangeTop(own(top.alpha))
        return top, Start(self.states[place], self.method, self.h, self.options)


def integrate_ensemble(
    top: LagrangeTop | RigidTop | PerturbedTop | Problem,
    Y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    threads: int | None = None,
    on_failure: str = "raise",
    **options: Any,
) -> EnsembleTrajectory:
    """Follow n tops from Y0 (n, 6), as `integrate` does one: to the end, on a grid or at times.

    Parameters
    ----------
    top : LagrangeTop, RigidTop, PerturbedTop or Problem
        The same for all; or LagrangeTop(alpha=array) with one alpha for each; of a PerturbedTop alpha and every parameter may be
        such an array.
    Y0 : (n, 6)
        Of a Problem (n, size), and so are the states that are returned.
    h, steps, method : float, int, str or Method
        As in `integrate`.
    every : int
        Record every `every` steps, row 0 is Y0: steps//every + 1 rows; default: the end alone.
    t : (m,)
        Output times in place of h and steps: m rows; for the exact Bäcklund map one map away from Y0 each: jumps, not steps.
    threads : int
        Default: one per usable core.
    on_failure : str
        "raise" a StepError that names the first top for which the method fails, and says how many there are; or "nan": all rows
        of such tops are NaN.
    **options : dict
        The method's own.

    Returns
    -------
    EnsembleTrajectory
        t (rows,) and y (rows, n, 6). As an array it is y; of the end alone (n, 6).

    Raises
    ------
    ValueError
        Bad input; the message names the argument.
    StepError
        See `on_failure`.
    KeyboardInterrupt
        Ctrl-C, seen within a fraction of a second (between two tops, where they are taken one by one).
    """
    tops, states = _check_tops(top, Y0)
    n = len(states)
    found = find_method(method)
    sample = tops.one(0) if n else LagrangeTop()
    threads = machine.usable_cores() if threads is None else checks.check_count(threads, "threads", least=1)

    def collected(h: float | None, times: Array, out: Array, end_only: bool) -> EnsembleTrajectory:
        begin = _Begin(top, states, found, h if found.control == "step" else None, options)
        return EnsembleTrajectory(top, found.name, times, out, end_only, begin)

    checks.check_choice(on_failure, "on_failure", ("raise", "nan"))
    times = checks.check_times_or_grid(t, h, steps, every)
    if times is not None:
        if found.evaluate_for(sample, options) is None:
            raise ValueError(f"t: {found.name} steps on a grid only; give h and steps")
        out = np.empty((len(times), *states.shape))
        failures = _run(_Jumps(found, tops, states, out, options, times), threads)
        return collected(None, times, _judge(found, None, out, failures, on_failure), end_only=False)
    h = checks.check_step(h)
    found.prepare_for(sample, options)
    steps, stride = checks.check_grid(steps, every, "steps")
    if every is None:
        out = np.empty((1, *states.shape))
        rows = out if steps else out[:0]
    else:
        out = np.empty((steps // stride + 1, *states.shape))
        rows = out[1:]
    if every is not None or steps == 0:
        out[0] = states
    failures = _run(_Steps(found, tops, states, rows, options, h, steps, stride), threads)
    counts = np.array([steps]) if every is None else stride * np.arange(len(out))
    with np.errstate(over="ignore"):  # of an h with which nothing but turns can be made
        times = h * counts.astype(np.float64)
    return collected(h, times, _judge(found, h, out, failures, on_failure), end_only=every is None)


# ---------------------------------------------------------------- the work on one chunk

Failures = list[tuple[int, StepError]]
Mask = NDArray[np.bool_]


class _Tops(NamedTuple):
    """What is followed: the problem of one place, and those of a chunk as a method's own way to take many gets them.

    In a uniform field these are alphas, in a potential a list of problems; None if they cannot be taken so.
    """

    one: Callable[[int], Any]
    those: Callable[[slice], Any]


def _in_field(problem: PerturbedTop, alphas: Array, parameters: Array) -> _Tops:
    """Tops in a potential, one for each row of its parameters."""
    parts = (parameters[first : first + CHUNK] for first in range(0, len(parameters), CHUNK))
    kinds = [nature for part in parts for nature in natures(problem.formula, part)]

    def one(place: int) -> PerturbedTop:
        return problem.like(float(alphas[place]), tuple(parameters[place].tolist()), kinds[place])

    return _Tops(one, lambda chunk: [one(i) for i in range(*chunk.indices(len(alphas)))])


@dataclass
class _Work:
    """What is to be done with each top; `out` (rows, n, 6) is filled."""

    method: Method
    tops: _Tops
    states: Array
    out: Array
    options: dict[str, Any]
    stop: threading.Event = field(default_factory=threading.Event, kw_only=True)
    # what makes a step holds the interpreter: in turns is as quick
    preparing: Any = field(default_factory=threading.Lock, kw_only=True)

    def many(self, chunk: slice) -> Mask:
        """The tops of a chunk that were done in one call, a mask."""
        raise NotImplementedError

    def one(self, place: int) -> Array:
        """The rows (rows, 6) of one top."""
        raise NotImplementedError

    def __call__(self, chunk: slice) -> Failures:
        out, failures = self.out[:, chunk], []
        if self.stop.is_set() or len(out) == 0:
            return []
        done = self.many(chunk)
        finite = np.isfinite(out)
        if not finite.all():  # along some axes only it takes many times as long
            done = done & finite.all(axis=(0, 2))
        for i in np.flatnonzero(~done):
            if self.stop.is_set():
                break
            place = chunk.start + int(i)
            try:
                out[:, i] = self.one(place)
            except StepError as error:
                out[:, i] = np.nan
                failures.append((place, error))
        return failures


@dataclass
class _Steps(_Work):
    h: float
    steps: int
    every: int
    prepared: dict[int, Any] = field(default_factory=dict)  # by place, for tops that are taken alone after all

    def many(self, chunk: slice) -> Mask:
        call = self.method.advance_many
        tops = None if call is None else self.tops.those(chunk)
        states, out = self.states[chunk], self.out[:, chunk]
        done = np.zeros(len(states), dtype=bool)
        if call is not None and tops is not None:
            grid = (self.h, self.steps, self.every)
            done = call(tops, states, *grid, out, self.stop.is_set, **self.options)
        if self.method.engine == "numba" and np.count_nonzero(~done) >= FEW:
            for members in self._alike(chunk, done):
                self._in_lanes(members, chunk, done)
        return done

    def _alike(self, chunk: slice, done: Mask) -> list[list[int]]:
        """Places of a chunk whose steppers run on the same kernel; none if it has no lanes."""
        kinds: dict[Any, list[int]] = {}
        for place in (np.flatnonzero(~done) + chunk.start).tolist():
            if self.stop.is_set():
                return []
            try:
                stepper = self.prepared[place] = self.prepare(place)
            except StepError:
                continue  # again when it is taken alone
            if not isinstance(stepper, FixedStepper) or stepper.lane is None or stepper.size != 6:
                return []
            kinds.setdefault((stepper.lane, stepper.pin, stepper.block, len(stepper.constants)), []).append(place)
        return list(kinds.values())

    def _in_lanes(self, places: list[int], chunk: slice, done: Mask) -> None:
        """Many steppers that differ in their constants; some of the tops may be left undone."""
        steppers, states = [], []
        for place in places[: len(places) // LANES * LANES if len(places) % LANES < FEW else None]:
            stepper = self.prepared[place]
            with contextlib.suppress(StepError):
                states.append(stepper.enter(self.states[place]))
                steppers.append((place, stepper))
        if not steppers:
            return
        (_, first), n = steppers[0], len(steppers)
        step, size = first.lane
        constants = np.array([stepper.constants for _, stepper in steppers])
        rows, starts = np.empty((len(self.out), n, 6)), np.array(states)
        fine = run_lanes(
            (step, first.pin, first.block), starts, constants, np.arange(n), np.ones((n, 6)), self.steps, self.every, rows,
            self.stop.is_set, size=size,
        )  # fmt: skip
        for i in np.flatnonzero(fine):
            place, stepper = steppers[i]
            with contextlib.suppress(StepError):
                self.out[:, place] = stepper.rows(np.concatenate((starts[None, i], rows[:, i])), self.every)[1:]
                done[place - chunk.start] = True
                del self.prepared[place]

    def prepare(self, place: int) -> Stepper:
        with self.preparing:
            top = self.tops.one(place)
            build = self.method.prepare_for(top)
            y0 = self.states[place].copy()
            return watched(self.method.name, build(top, y0, self.h, **self.options), len(y0))

    def one(self, place: int) -> Array:
        stepper = self.prepared.pop(place, None) or self.prepare(place)
        return stepper.record(self.states[place], self.steps, self.every)[1:]


@dataclass
class _Jumps(_Work):
    times: Array

    def many(self, chunk: slice) -> Mask:
        call, states = self.method.evaluate_many, self.states[chunk]
        tops = None if call is None else self.tops.those(chunk)
        if call is None or tops is None:
            return np.zeros(len(states), dtype=bool)
        return call(tops, states, self.times, self.out[:, chunk], **self.options)

    def one(self, place: int) -> Array:
        top, y0 = self.tops.one(place), self.states[place].copy()
        with self.preparing:
            evaluate: Any = self.method.evaluate_for(top)
            y = evaluate(top, y0, self.times, **self.options)[0]
            check_rows(self.method.name, "evaluate", y, (len(self.times), len(y0)))
            return y


def _run(work: _Work, threads: int) -> Failures:
    """All chunks, in threads; the failures in the order of the tops."""
    n = len(work.states)
    length = max(1, min(CHUNK, -(-n // threads)))
    chunks = [slice(first, min(first + length, n)) for first in range(0, n, length)]
    failures: Failures = []
    if threads == 1 or len(chunks) < 2:
        for chunk in chunks:
            failures += work(chunk)
        return failures
    with ThreadPoolExecutor(threads) as pool:
        try:
            for done in as_completed([pool.submit(work, chunk) for chunk in chunks]):
                failures += done.result()
        except BaseException:  # Ctrl-C, or a wrong option
            work.stop.set()
            pool.shutdown(cancel_futures=True)
            raise
    return sorted(failures, key=lambda failure: failure[0])


def _judge(method: Method, h: float | None, out: Array, failures: Failures, on_failure: str) -> Array:
    if not failures:
        return out
    if on_failure == "raise":
        place, error = failures[0]
        more = f"; {len(failures)} of {out.shape[1]} tops fail" if len(failures) > 1 else ""
        raise StepError(method.name, f"top {place}: {error.reason}{more}", h=h, step=error.step) from error
    out[:, [place for place, _ in failures]] = np.nan
    return out


# ---------------------------------------------------------------- checking what a user passes in


def _check_tops(top: Any, Y0: ArrayLike) -> tuple[_Tops, Array]:
    """The tops, and their states (n, 6), contiguous float64; the caller's own memory where that is what it holds."""
    unit = isinstance(top, RigidTop)
    kind, top = type(top).__name__, getattr(top, "problem", top)
    if isinstance(top, Problem):
        try:
            rows: list[Any] = list(Y0)  # type: ignore[arg-type]
            checked = [top.check_state(y, f"Y0[{i}]") for i, y in enumerate(rows)]
            states = np.reshape(checked, (len(rows), -1)) if rows else np.empty((0, top.space.size))
            return _Tops(lambda _: top, lambda _: None), states
        except TypeError:
            raise ValueError(f"Y0 must be states, one for each motion; got {type(Y0).__name__}") from None
    if not isinstance(top, (LagrangeTop, PerturbedTop)):
        kinds = "a LagrangeTop, a RigidTop, a PerturbedTop or a Problem"
        hint = ": pass its problem()" if callable(top) else ""
        raise ValueError(f"top must be {kinds}; got {kind}{hint}")
    try:
        states = np.asarray(Y0)
    except ValueError as error:
        raise ValueError(f"Y0 must be states (n, 6): {error}") from None
    if states.ndim != 2 or states.shape[1] != 6:
        raise ValueError(f"Y0 must have shape (n, 6), a row (J1, J2, J3, x1, x2, x3) for each top; got {states.shape}")
    if states.dtype.kind not in "iuf":
        raise ValueError(f"Y0 must be real numbers; got dtype {states.dtype}")
    states = np.ascontiguousarray(states, dtype=np.float64)
    if not np.isfinite(states).all():  # along one axis only it takes many times as long
        _refuse(np.any(~np.isfinite(states), axis=1), "is not finite", states)
    vertical = (states[:, 3] == 0.0) & (states[:, 4] == 0.0)
    _refuse(vertical & (states[:, 5] == 0.0), "has x = 0: the axis of a top needs |x| > 0", states)
    if unit:
        _refuse(~has_unit_axis(states), "has |x| not 1: the axis of a RigidTop is the direction x", states)
    alphas = _one_for_each(top.alpha, "alpha", len(states))
    if isinstance(top, LagrangeTop):
        return _Tops(lambda i: LagrangeTop(float(alphas[i])), lambda chunk: alphas[chunk]), states
    columns = [_one_for_each(value, f"parameters[{i}]", len(states)) for i, value in enumerate(top.parameters)]
    arguments, bad = (*states[:, 3:].T, alphas, *columns), np.zeros(len(states), dtype=bool)
    with np.errstate(all="ignore"):
        for value in (*top.field.potential(*arguments), *top.field.gradient(*arguments)):
            bad |= ~np.isfinite(value)
    _refuse(bad, f"is where the potential {top.potential.name} is not finite", states)
    return _in_field(top, alphas, np.reshape(columns, (len(columns), len(states))).T), states


def _one_for_each(value: Any, name: str, n: int) -> Array:
    """A number, or an array with one for each of n tops, as an array (n,)."""
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.ndim and len(numbers) != n:
        raise ValueError(f"top holds {len(numbers)} values of {name}, Y0 {n} states")
    return np.broadcast_to(numbers, n)


def _refuse(bad: Mask, why: str, states: Array) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        more = f", and so do {int(bad.sum()) - 1} others" if bad.sum() > 1 else ""
        raise ValueError(f"Y0[{first}] = {states[first].tolist()} {why}{more}")
