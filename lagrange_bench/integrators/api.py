"""The functions that a user calls: `prepare` and `integrate`."""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.checks import (
    check_count,
    check_grid,
    check_rows,
    check_step,
    check_times_or_grid,
    warn_caller,
)
from lagrange_bench.integrators.interface import Array, Method, StepError, Stepper, StepWarning, Work
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import NamedTop
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.start import Start
from lagrange_bench.integrators.trajectory import RunInputs, Trajectory

# steps of a run that records each of them by default, and the most states that a longer run records
LONG = 100_000
MOST_STATES = 1000


def prepare(
    top: Problem | NamedTop | Case | str,
    y0: ArrayLike | None,
    h: float | None = None,
    method: str | Method | None = None,
    *,
    h_scaled: float | None = None,
    **options: Any,
) -> Stepper:
    """A stepper of `method` with step h. Everything slow happens here, once: compiling, finding λ(h).

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, RigidBody or Problem
        What to follow.
    y0 : (6,)
        A state, as for `integrate`.
    h : float
        The step, not 0, in the top's own unit of time.
    method : str or Method, optional
        As in `integrate`.
    h_scaled : float
        The step in the time scale of the motion, in place of `h`; see `integrate`.
    **options : dict
        Options of the method.

    Returns
    -------
    Stepper
        It starts from any state of the top.

    Raises
    ------
    ValueError
        A state, step or option that makes no sense, or a method that does not take this top; the message names the argument.
    StepError
        The method cannot be prepared for this top and step.
    """
    start = Start.of(top, y0)
    record = find_method(default_method(start.top) if method is None else method)
    h = check_step(own_step(h, h_scaled, start.top, start.state))
    return _prepare(record, start.top, start.state, h, options)


def integrate(
    top: Problem | NamedTop | Case | str,
    y0: ArrayLike | None = None,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method | None = None,
    every: int | None = None,
    t: ArrayLike | None = None,
    *,
    h_scaled: float | None = None,
    **options: Any,
) -> Trajectory:
    """Follow a top, or a problem of your own, from y0.

    Give either `h` and `steps`, or `t`. With `h` and `steps`, one state in `every` is recorded. With `t`, the method's dense
    output gives the states at these times, which count from y0. For this `backlund` takes one map from y0 to each time: a jump,
    not a sequence of steps. With `t` and `tol`, `backlund_splitting` halves its step until two runs agree, and reports the step
    in `work.notes`.

    Parameters
    ----------
    top : LagrangeTop, PerturbedTop, RigidBody, Problem, NamedTop, Case or str
        What to follow; a name such as "generic" or "bruels" stands for a named top or case (of "slow" for the top).
    y0 : (6,), optional
        The initial (J, x); of a Problem as many numbers as its space has; of a RigidBody what its `state` returns. A named top
        or case has its own.
    h : float
        The step, in the top's own unit of time, 1 over the unit of J; of a RigidBody in s. A negative one runs backwards.
    steps : int
        Number of steps.
    method : str or Method, optional
        A name in METHODS, or a record. By default `backlund`, the exact step; of a free body `theta_functions`, the closed form.
        Other problems need a name.
    every : int
        Record every so many steps; must divide `steps`. By default 1; a run of 100 000 steps or more keeps at most 1000 states
        after the start, and a warning says so.
    t : (N,)
        Finite times, in the unit of h.
    h_scaled : float
        In place of `h`: the step in the time scale of the motion. This scale is 1/(|J| + √(|alpha||x|)) at y0 for a top in a
        uniform field, and `top.scales(y0)[2]` for any problem.
    **options : dict
        Options of the method.

    Returns
    -------
    Trajectory
        t (N,), y (N, 6), of a Problem (N, size), and work. For a RigidBody y is (N, 7), or (N, 13) if it flies, and there are
        also `position`, `velocity`, `rotation`, `omega_body`, `omega_world`, `energy` and `momentum`, in SI units.

    Raises
    ------
    ValueError
        Bad input; the message names the argument.
    StepError
        The method failed.
    """
    start = Start.of(top, y0)
    problem, state = start.top, start.state
    record = find_method(default_method(problem) if method is None else method)
    h = own_step(h, h_scaled, problem, state)
    if t is None and (h is None or steps is None):
        record.prepare_for(problem, options)  # who gives dt learns more from the option than from h, which is missing
    times = check_times_or_grid(t, h, steps, every)
    if times is not None:
        y, work = _evaluate(record, problem, state, times, options)
    else:
        h = check_step(h)
        steps, every = check_grid(steps, default_every(steps) if every is None else every, "steps")
        stepper = _prepare(record, problem, state, h, options)
        if not math.isfinite(h * steps):
            raise StepError(record.name, "the time n h is beyond the largest double", h=h)
        before = state.tobytes()
        y, work = stepper.record(state, steps, every), stepper.work
        check_rows(record.name, "record", y, (steps // every + 1, len(state)))
        if state.tobytes() != before or y[0].tobytes() != before:  # of a stepper that a user wrote
            raise ValueError(f"{record.name}: record must leave its input as it is, and return it as row 0")
        _check_finite(record, y, h)
        times = grid_times(h, every, len(y))
    step = h if record.control == "step" and t is None else None
    inputs = RunInputs(state, record, step, options, start.flight)
    if start.flight is not None:
        y = np.hstack((y, problem.flight_at(start.flight, times)))
    return Trajectory(problem, record.name, times, y, work, inputs)


def _check_finite(record: Method, y: Array, h: float | None) -> None:
    if not np.isfinite(y).all():
        raise StepError(record.name, "it returned a state that is not finite", h=h)


def default_every(steps: Any) -> int:
    """How many steps there are by default from one recorded state to the next. It divides `steps`; a long run gets a warning."""
    steps = check_count(steps, "steps")
    if steps < LONG:
        return 1
    every = steps // max(rows for rows in range(1, MOST_STATES + 1) if steps % rows == 0)
    warn_caller(
        f"one state in {every} of {steps} steps is recorded, {steps // every + 1} in all; set every= for others",
        StepWarning,
    )
    return every


def own_step(h: Any, h_scaled: Any, problem: Any, y0: Array) -> Any:
    """The step in the problem's own unit: h, or h_scaled in the time scale of the motion, or None.

    ValueError if both are set, or if the motion is at rest and has no time scale.
    """
    if h_scaled is None:
        return h
    if h is not None:
        raise ValueError("give h or h_scaled, not both")
    unit = float(problem.scales(y0)[2])
    if not math.isfinite(unit):
        raise ValueError("h_scaled: a motion that is at rest for ever has no time scale; give h")
    return check_step(h_scaled, "h_scaled") * unit


def grid_times(h: float, every: int, rows: int) -> Array:
    """0, every·h, 2 every·h, …"""
    return h * (every * np.arange(rows, dtype=np.float64))


def default_method(problem: Any) -> str:
    """The name of the exact method of a problem; ValueError where there is none."""
    if kinds.uniform(problem) or kinds.symmetric_body(problem):
        return "backlund"
    if kinds.free_body(problem):
        return "theta_functions"
    raise ValueError(
        "method: no exact one is known here; name one, such as taylor (round-off at every step) or blanes_moan6 (a splitting, "
        "which keeps the energy near its start in long runs)"
        + (", or backlund_splitting (the exact step in a weak field)" if problem.is_top else "")
    )


def _prepare(method: Method, top: Any, y0: Array, h: float, options: dict[str, Any]) -> Stepper:
    """`prepare` with arguments that have been checked."""
    build = method.prepare_for(top, options)
    start = perf_counter()
    try:
        stepper = build(top, y0, h, **options)
    except Exception as error:
        error.add_note(f"in prepare of the method {method.name}")
        raise
    if not isinstance(getattr(stepper, "work", None), Work):
        raise ValueError(f"{method.name}: prepare returned {stepper!r}: return a Stepper, with its work")
    stepper.work.setup_seconds = perf_counter() - start
    return stepper


def _evaluate(method: Method, top: Any, y0: Array, times: Array, options: dict[str, Any]) -> tuple[Array, Work]:
    y, work = method.evaluate_for(top, options)(top, y0, times, **options)
    check_rows(method.name, "evaluate", y, (len(times), len(y0)))
    _check_finite(method, y, None)
    return y, work
