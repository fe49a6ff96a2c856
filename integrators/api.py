"""What a user calls: `prepare`, `integrate`, `two_point`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from integrators.checks import check_grid, check_options, check_state, check_step, check_times
from integrators.compiling.loops import INTERRUPTIBLE
from integrators.interface import Array, Method, StepError, Stepper, Work
from integrators.problem import body
from integrators.problem.body import HeavyTop
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.rotated import evaluate_for, prepare_for
from integrators.problem.top import LagrangeTop, NamedTop
from integrators.registry import find_method
from integrators.torus import any_parameter

FEW = 8  # numbers for which Python is quicker than NumPy
TOP_TYPES = "a LagrangeTop, a HeavyTop or a PerturbedTop"


@dataclass(frozen=True)
class Trajectory:
    """Times (N,) in the units of h, states (N, 6) in those of y0, of a magnet (N, n, 3), and the work they took."""

    top: Any  # the LagrangeTop, the PerturbedTop or the GaudinMagnet
    method: str
    t: Array
    y: Array
    work: Work
    attitude: Array | None = None  # (N, 4) unit quaternions, scalar first, body to rest frame; see `body`

    def invariants(self) -> Array:
        """H, J3, C1, C2 along the trajectory, shape (N, 4); of a magnet all H_j and s_j², shape (N, 2n)."""
        return self.top.invariants(self.y)

    def euler_angles(self) -> Array:
        """(theta, phi, psi) of the body, rad, shape (N, 3); needs `integrate(…, attitude=True)`."""
        if self.attitude is None:
            raise ValueError("the attitude was not followed: integrate(…, attitude=True)")
        return body.to_euler(self.attitude)


def prepare(
    top: LagrangeTop | HeavyTop | PerturbedTop,
    y0: ArrayLike,
    h: float,
    method: str | Method = "backlund",
    **options: Any,
) -> Stepper:
    """A stepper for `method` with step h; everything slow (compilation, λ(h)) happens here, once.

    Raises
    ------
    ValueError : a state, step or option that makes no sense, or a method that does not take the top's potential; the
    message names the argument.
    StepError : the method cannot be prepared for this top and step.
    """
    top, found, state = _look_up(top, y0, method)
    return _prepare(found, top, state, check_step(h), options)


def integrate(
    top: LagrangeTop | HeavyTop | PerturbedTop,
    y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    attitude: bool | ArrayLike = False,
    **options: Any,
) -> Trajectory:
    """Follow the top from y0: `any_problem.integrate`, which describes the arguments, without the magnets.

    What measures tops calls this one: its rows do not depend on the sources of the magnets.
    """
    heavy = top if isinstance(top, HeavyTop) else None
    top, found, state = _look_up(top, y0, method)
    wanted = attitude is not False and attitude is not None
    if wanted and isinstance(top, PerturbedTop):
        raise ValueError("attitude: the body of a PerturbedTop is not followed; give a LagrangeTop or a HeavyTop")
    if wanted and found.attitude is None:
        raise ValueError(f"attitude: {found.name} does not follow the body; backlund and taylor do")
    if t is not None:
        for name, given in (("h", h), ("steps", steps), ("every", every), ("attitude", attitude if wanted else None)):
            if given is not None:
                raise ValueError(f"give either t or h and steps; got t and {name}")
        return _evaluate(found, top, state, t, options)
    if h is None or steps is None:
        raise ValueError("give h and steps, or output times t")
    steps, every = check_grid(steps, every, "steps")
    h = check_step(h)
    at_once = getattr(found.prepare, "at_once", None)
    if at_once and steps <= INTERRUPTIBLE and not (options or wanted or isinstance(top, PerturbedTop)):
        y = at_once(top, state, h, steps, every)
        if y is not None and math.isfinite(h * steps):
            return Trajectory(top, found.name, grid_times(h, every, len(y)), y, Work(steps=steps))
    stepper = _prepare(found, top, state, h, options)
    if not math.isfinite(h * steps):
        raise StepError(found.name, "the time n h is beyond the largest double", h=h)
    g0 = body.check_attitude(attitude, state) if wanted else None
    y = stepper.record(state, steps, every)
    g = None
    if g0 is not None:
        own_spin = heavy.own_spin(state) if heavy else 0.0
        assert isinstance(top, LagrangeTop)
        g = body.follow(found, top, y, h, every, g0, own_spin, options)
    return Trajectory(top, found.name, grid_times(h, every, len(y)), y, stepper.work, g)


def two_point(top: LagrangeTop | HeavyTop, y: ArrayLike, lam: complex, sheet: int = 1) -> Array:
    """One step of the two-point Bäcklund transformation with parameters λ and λ̄, any λ with Im λ > 0.

    `sheet` = 1 takes the branch of √Q(λ) continuous from +√C1 along the segment from 0 to λ; −1 the other
    one, which is the inverse map. At a root of Q they meet: within 1e-14 of a simple root, or 1e-8 of a double one,
    round-off decides which is which. Shape (6,). Source: paper, section 5.5; docs/exact-step.md.

    Raises
    ------
    ValueError : y, λ or sheet make no sense. StepError : the image is beyond the range of doubles.
    """
    top = top.top if isinstance(top, HeavyTop) else top
    _check_top(top)
    if isinstance(top, PerturbedTop):
        raise ValueError("top must be a LagrangeTop or a HeavyTop: the map is that of a uniform field")
    return any_parameter.two_point(top, check_state(y, "y"), lam, sheet)


def grid_times(h: float, every: int, rows: int) -> Array:
    """0, every·h, 2 every·h, …"""
    if rows <= FEW:
        return np.array([h * (float(every) * k) for k in range(rows)])
    return h * (every * np.arange(rows, dtype=np.float64))


def _look_up(top: Any, y0: ArrayLike, method: str | Method) -> tuple[Any, Method, Array]:
    """The top without its body, the method and the state, all checked."""
    plain = top.top if isinstance(top, HeavyTop) else top
    _check_top(plain)
    found, state = find_method(method), check_state(y0)
    if isinstance(top, (HeavyTop, PerturbedTop)):
        top.check_state(state)
    return plain, found, state


def _prepare(method: Method, top: Any, y0: Array, h: float, options: dict[str, Any]) -> Stepper:
    """`prepare`, of what has been checked."""
    build = prepare_for(method, top)
    check_options(method.name, build, options)
    start = perf_counter()
    stepper = build(top, y0, h, **options)
    if stepper is None:
        raise ValueError(f"{method.name}: prepare returned None: return a stepper")
    stepper.work.setup_seconds = perf_counter() - start
    return stepper


def _check_top(top: Any) -> None:
    if isinstance(top, NamedTop):
        raise ValueError(f"top must be {TOP_TYPES}; {top.name!r} has one: pass named.top, named.state")
    if not isinstance(top, (LagrangeTop, PerturbedTop)):
        raise ValueError(f"top must be {TOP_TYPES}; got {type(top).__name__}")
    top.single()


def _evaluate(method: Method, top: Any, y0: Array, t: ArrayLike, options: dict[str, Any]) -> Trajectory:
    evaluate = evaluate_for(method, top)
    if evaluate is None:
        raise ValueError(f"t: {method.name} steps on a grid only; give h and steps")
    times = check_times(t)
    check_options(method.name, evaluate, options)
    y, work = evaluate(top, y0, times, **options)
    return Trajectory(top, method.name, times, y, work)
