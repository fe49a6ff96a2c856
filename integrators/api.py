"""What a user calls: `prepare`, `integrate`, `two_point`."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import check_grid, check_state, check_step, check_times_or_grid
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.interface import Array, Method, StepError, Stepper, Work
from lagrange_bench.integrators.problem import body
from lagrange_bench.integrators.problem.body import BodyState, HeavyTop, RigidTop
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop, NamedTop
from lagrange_bench.integrators.problem.watched import check_rows, watched
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.torus import any_parameter
from lagrange_bench.integrators.trajectory import Start, Trajectory

FEW = 8  # numbers for which Python is quicker than NumPy
TOP_TYPES = "a LagrangeTop, a RigidTop, a PerturbedTop or a Problem"


def prepare(
    top: LagrangeTop | RigidTop | PerturbedTop | Problem,
    y0: ArrayLike,
    h: float,
    method: str | Method = "backlund",
    **options: Any,
) -> Stepper:
    """A stepper for `method` with step h; everything slow (compilation, λ(h)) happens here, once.

    Parameters
    ----------
    top : LagrangeTop, RigidTop, PerturbedTop or Problem
        What to follow.
    y0 : (6,)
        A state, as for `integrate`.
    h : float
        The step, not 0, in the units of the top.
    method : str or Method
        A name in METHODS, or a record.
    **options : dict
        The method's own.

    Returns
    -------
    Stepper
        It starts from any state of the top.

    Raises
    ------
    ValueError
        A state, step or option that makes no sense, or a method that does not take the top's potential; the message names the
        argument.
    StepError
        The method cannot be prepared for this top and step.
    """
    problem, found, state = _look_up(top, y0, method)
    return _prepare(found, problem, state, check_step(h), options)


def integrate(
    top: LagrangeTop | RigidTop | PerturbedTop | Problem,
    y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    attitude: bool | ArrayLike = False,
    **options: Any,
) -> Trajectory:
    """Follow a top, or a problem of your own, from y0.

    Give either `h` and `steps`, or `t`. With `h` and `steps` every `every` steps are recorded (default: only the start
    and the end). With `t`, any times counted from that of y0, the method's dense output is used. The exact Bäcklund map takes one
    map for each time then: a jump, not a sequence of steps. With `t`, `backlund_splitting` chooses its step for `tol`
    and reports it in `work.notes`.

    Parameters
    ----------
    top : LagrangeTop, RigidTop, PerturbedTop or Problem
        What to follow.
    y0 : (6,)
        Initial (J, x); of a Problem as many numbers as its space has.
    h : float
        The step, in the top's own unit of time, 1 over the unit of J; of a RigidTop in s. A negative one runs backwards.
    steps : int
        Number of steps.
    method : str or Method
        A name in METHODS, or a record.
    every : int
        Record every so many steps; must divide `steps`.
    t : (N,)
        Finite times, in the unit of h.
    attitude : bool or (4,)
        True, or a unit quaternion, scalar first: the initial attitude of a HeavyTop, or of the body with equal moments of inertia
        that a LagrangeTop is. A state from `RigidTop.state` has its own.
    **options : dict
        The method's own.

    Returns
    -------
    Trajectory
        t (N,), y (N, 6), of a Problem (N, size), and work; `rotation` where the start has one. Of a
        RigidTop and a WholeBody also `position`, `omega_body`, `omega_world` and `energy`, in SI units. The rotation of a top
        is followed when it is first asked for, by backlund, theta_functions and taylor; the rotation of a WholeBody is in y.

    Raises
    ------
    ValueError
        Bad input; the message names the argument.
    StepError
        The method failed.
    """
    problem, found, state = _look_up(top, y0, method)
    wanted = attitude is not False and attitude is not None
    if wanted and "uniform" not in problem.offers:
        kind, advice = type(top).__name__, "is not followed; give a LagrangeTop or a HeavyTop"
        advice = "has its rotation in y; leave attitude out" if "body" in problem.offers else advice
        raise ValueError(f"attitude: the body of a {kind} {advice}")
    if wanted and isinstance(top, RigidTop) and not isinstance(top, HeavyTop):
        raise ValueError("attitude: a RigidTop starts from top.state(rotation=…, omega_body=…), which has it")
    turn = getattr(y0, "rotation", None)
    if wanted and (turn is None or attitude is not True):
        turn = body.check_attitude(attitude, state)
    if t is None and (h is None or steps is None):
        found.prepare_for(problem, options)  # who gives dt learns more from the option than from h, which is missing
    times = check_times_or_grid(t, h, steps, every)
    if times is not None:
        run = _evaluate(found, problem, state, times, options)
    else:
        run = _advance(found, problem, state, check_step(h), *check_grid(steps, every, "steps"), options)
    if "body" in problem.offers:
        return replace(run, body=problem)
    if "uniform" not in problem.offers:
        return run
    first = y0 if isinstance(y0, BodyState) else state
    follow = None if turn is None else partial(body.follow, found, top, first, turn, run.t, run.y, h, options)
    if isinstance(top, RigidTop):
        spin = getattr(first, "spin", None)
        run = replace(run, follow=follow, body=top, spin=None if spin is None else float(spin))
    elif follow:
        run = replace(run, follow=follow)
    if wanted:
        run.attitude  # noqa: B018 - now, so that it fails here
    return run


def _advance(
    found: Method, top: Any, state: Array, h: float, steps: int, every: int, options: dict[str, Any]
) -> Trajectory:
    """`integrate` by steps of h."""
    start = Start(state, found, h if found.control == "step" else None, options)
    at_once = getattr(found.prepare, "at_once", None)
    if at_once and steps <= INTERRUPTIBLE and "uniform" in top.offers and not options:
        y = at_once(top, state, h, steps, every)
        if y is not None and math.isfinite(h * steps):
            if len(y) != steps // every + 1:
                check_rows(found.name, "at_once", y, (steps // every + 1, 6))
            return Trajectory(top, found.name, grid_times(h, every, len(y)), y, Work(steps=steps), start=start)
    stepper = _prepare(found, top, state, h, options)
    if not math.isfinite(h * steps):
        raise StepError(found.name, "the time n h is beyond the largest double", h=h)
    y = stepper.record(state, steps, every)
    return Trajectory(top, found.name, grid_times(h, every, len(y)), y, stepper.work, start=start)


def two_point(top: LagrangeTop | RigidTop, y: ArrayLike, lam: complex, sheet: int = 1) -> Array:
    """One step of the two-point Bäcklund transformation with parameters λ and λ̄, any λ with Im λ > 0.

    At a root of Q the two sheets meet: within 1e-14 of a simple root, or 1e-8 of a double one, round-off decides which is which.
    At a double root there is no inverse: a homoclinic state goes to the sleeping top. Source: paper, section 5.5;
    docs/exact-step.md.

    Parameters
    ----------
    top : LagrangeTop or RigidTop
        The top.
    y : (6,)
        The state.
    lam : complex
        λ, in units of x/J.
    sheet : int
        1 takes the branch of √Q(λ) continuous from +√C1 along the segment from 0 to λ; −1 the other one, which is the inverse
        map.

    Returns
    -------
    (6,)
        The image.

    Raises
    ------
    ValueError
        y, λ or sheet make no sense.
    StepError
        The image is beyond the range of doubles.
    """
    problem = problem_of(top)
    problem.single()
    if "uniform" not in problem.offers:
        raise ValueError("top must be a LagrangeTop or a RigidTop: the map is that of a uniform field")
    return any_parameter.two_point(problem, check_state(y, "y"), lam, sheet)


def problem_of(top: Any) -> Any:
    """What is integrated: of a RigidTop its LagrangeTop. ValueError: it is none."""
    if isinstance(top, NamedTop):
        raise ValueError(f"top must be {TOP_TYPES}; {top.name!r} has one: pass named.top, named.state")
    problem = getattr(top, "problem", top)
    if not isinstance(problem, (LagrangeTop, PerturbedTop, Problem)):
        hint = ": pass its problem()" if callable(problem) else ""
        raise ValueError(f"top must be {TOP_TYPES}; got {type(top).__name__}{hint}")
    return problem


def grid_times(h: float, every: int, rows: int) -> Array:
    """0, every·h, 2 every·h, …"""
    if rows <= FEW:
        return np.array([h * (float(every) * k) for k in range(rows)])
    return h * (every * np.arange(rows, dtype=np.float64))


def _look_up(top: Any, y0: ArrayLike, method: str | Method) -> tuple[Any, Method, Array]:
    """The problem that is followed, of a body its top, the method and the state, all checked."""
    plain = problem_of(top)
    plain.single()
    found, state = find_method(method), plain.check_state(y0)
    if isinstance(top, RigidTop):
        top.check_start(y0 if isinstance(y0, BodyState) else state)
    return plain, found, state


def _prepare(method: Method, top: Any, y0: Array, h: float, options: dict[str, Any]) -> Stepper:
    """`prepare`, of what has been checked."""
    build = method.prepare_for(top, options)
    start = perf_counter()
    before = y0.tobytes()
    try:
        built = build(top, y0, h, **options)
    except Exception as error:
        error.add_note(f"in prepare of the method {method.name}")
        raise
    stepper = watched(method.name, built, len(y0))
    if y0.tobytes() != before:
        raise ValueError(f"{method.name}: prepare wrote to y0")
    stepper.work.setup_seconds = perf_counter() - start
    return stepper


def _evaluate(method: Method, top: Any, y0: Array, times: Array, options: dict[str, Any]) -> Trajectory:
    evaluate = method.evaluate_for(top, options)
    if evaluate is None:
        raise ValueError(f"t: {method.name} steps on a grid only; give h and steps")
    y, work = evaluate(top, y0, times, **options)
    check_rows(method.name, "evaluate", y, (len(times), len(y0)))
    return Trajectory(top, method.name, times, y, work, start=Start(y0, method, None, options))
