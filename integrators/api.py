"""What a user calls: `prepare`, `integrate`, `two_point`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import check_grid, check_options, check_state, check_step, check_times
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

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet

FEW = 8  # numbers for which Python is quicker than NumPy
TOP_TYPES = "a LagrangeTop, a RigidTop, a PerturbedTop or a Problem"


@dataclass(frozen=True)
class Trajectory:
    """Times (N,) in the units of h, states (N, 6) in those of y0, of a magnet (N, n, 3), and the work they took."""

    top: Any  # the LagrangeTop, the PerturbedTop or the GaudinMagnet
    method: str
    t: Array
    y: Array
    work: Work
    follow: Callable[[], Array] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def _followed(self) -> Array | None:
        return self.follow() if self.follow else None

    @property
    def attitude(self) -> Array | None:
        """(N, 4) unit quaternions, scalar first, body to world; None where the start has none. Followed when first asked."""
        return self._followed

    @property
    def rotation(self) -> Rotation:
        """The body's N rotations, a SciPy Rotation from the body's frame to the world's."""
        from scipy.spatial.transform import Rotation

        if self.attitude is None:
            raise ValueError("y0 has no rotation: start from top.state(rotation=…), or integrate(…, attitude=True)")
        return Rotation.from_quat(self.attitude, scalar_first=True)

    def invariants(self) -> Array:
        """H, J3, C1, C2 along the trajectory, shape (N, 4); of a magnet all H_j and s_j², (N, 2n); of a Problem its `names`."""
        return self.top.invariants(self.y, self.t) if isinstance(self.top, Problem) else self.top.invariants(self.y)

    def euler_angles(self) -> Array:
        """(theta, phi, psi) of the body, rad, shape (N, 3): R = R3(phi) R2(theta) R3(psi).

        Within 1e-7 of the vertical only phi ± psi has a meaning; all of it is then given to phi.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # says that
            return self.rotation.as_euler("ZYZ")[:, (1, 0, 2)]


@dataclass(frozen=True)
class RigidTrajectory(Trajectory):
    """A trajectory of a RigidTop, in SI units; y (N, 6) is (J, x) in the frame whose third axis points up."""

    body: RigidTop = field(kw_only=True)
    spin: float | None = field(default=None, kw_only=True)  # rad/s, about the axis

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


@dataclass(frozen=True)
class BodyTrajectory(Trajectory):
    """A trajectory of a WholeBody, in SI units; y (N, 7) is (q, L), see `problem.whole_body`."""

    @property
    def attitude(self) -> Array:
        """(N, 4) unit quaternions, scalar first, body to world."""
        quaternions: Array = self.rotation.as_quat(scalar_first=True)
        return quaternions

    @property
    def rotation(self) -> Rotation:
        """The body's N rotations, a SciPy Rotation from the body's frame to the world's."""
        turns: Rotation = self.top.rotations(self.y)
        return turns

    @property
    def position(self) -> Array:
        """The centre of mass in the world's frame, m, shape (N, 3)."""
        return self.rotation.apply(self.top.com)

    @property
    def omega_body(self) -> Array:
        """Angular velocity in the body's frame, rad/s, shape (N, 3)."""
        omega: Array = self.top.angular_velocity(self.y)
        return omega

    @property
    def omega_world(self) -> Array:
        """Angular velocity in the world's frame, rad/s, shape (N, 3)."""
        return self.rotation.apply(self.omega_body)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy, J, shape (N,)."""
        energy: Array = self.top.energy(self.y)
        return energy


def prepare(
    top: LagrangeTop | RigidTop | PerturbedTop | Problem,
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
    top: LagrangeTop | RigidTop | PerturbedTop | Problem | GaudinMagnet,
    y0: ArrayLike,
    h: float | None = None,
    steps: int | None = None,
    method: str | Method = "backlund",
    every: int | None = None,
    t: ArrayLike | None = None,
    attitude: bool | ArrayLike = False,
    **options: Any,
) -> Trajectory:
    """Follow a top, a problem of your own, or a magnet, from y0.

    Give either `h` and `steps`, or `t`. With `h` and `steps` every `every` steps are recorded (default: only the start
    and the end). With `t`, any times counted from that of y0, the method's dense output is used. The exact Bäcklund map takes one
    map for each time then: a jump, not a sequence of steps. With `t`, `backlund_splitting` chooses its step for `tol`
    and reports it in `work.notes`.

    Parameters
    ----------
    top : LagrangeTop, RigidTop (time in s then), PerturbedTop, or Problem; or a GaudinMagnet, with h and steps only.
    y0 : (6,), initial (J, x); of a Problem as many numbers as its space has; of a magnet its spins (n, 3).
    h : step, negative runs backwards. Times are in the top's own unit, 1 over the unit of J.
    steps : number of steps. method : a name in METHODS, or a Method; for a magnet a name in MAGNET_METHODS.
    every : must divide `steps`. t : (N,), finite. attitude : True, or a unit quaternion (4,), scalar first: the initial attitude
    of a HeavyTop, or of the body with equal moments of inertia that a LagrangeTop is. A state from `RigidTop.state` has its own.
    options : the method's own.

    Returns
    -------
    a `Trajectory`: t (N,), y (N, 6), of a Problem (N, size), of a magnet (N, n, 3), and work; `rotation` where the start has
    one. Of a RigidTop and a WholeBody also `position`, `omega_body`, `omega_world` and `energy`, in SI units. The rotation of
    a top is followed when it is first asked for, by backlund, theta_functions and taylor; that of a WholeBody is in y.

    Raises
    ------
    ValueError : bad input; the message names the argument. StepError : the method failed.
    """
    if "spins" in getattr(top, "offers", ()):
        if t is not None or (attitude is not False and attitude is not None):
            raise ValueError(f"{'attitude' if t is None else 't'}: not for a GaudinMagnet; give h and steps")
        return _follow_magnet(top, y0, h, steps, method, every, options)
    given, (top, found, state) = top, _look_up(top, y0, method)
    wanted = attitude is not False and attitude is not None
    if wanted and isinstance(top, (PerturbedTop, Problem)):
        kind = type(top).__name__
        raise ValueError(f"attitude: the body of a {kind} is not followed; give a LagrangeTop or a HeavyTop")
    if wanted and isinstance(given, RigidTop) and not isinstance(given, HeavyTop):
        raise ValueError("attitude: a RigidTop starts from top.state(rotation=…, omega_body=…), which has it")
    turn = getattr(y0, "rotation", None)
    if wanted and (turn is None or attitude is not True):
        turn = body.check_attitude(attitude, state)
    if t is not None:
        for name, value in (("h", h), ("steps", steps), ("every", every)):
            if value is not None:
                raise ValueError(f"give either t or h and steps; got t and {name}")
        run = _evaluate(found, top, state, t, options)
    elif h is None or steps is None:
        raise ValueError("give h and steps, or output times t")
    else:
        run = _advance(found, top, state, check_step(h), *check_grid(steps, every, "steps"), options)
    if "body" in getattr(top, "offers", ()):
        return BodyTrajectory(top, run.method, run.t, run.y, run.work)
    if isinstance(top, (PerturbedTop, Problem)):
        return run
    start = y0 if isinstance(y0, BodyState) else state
    follow = None if turn is None else partial(body.follow, found, given, start, turn, run.t, run.y, h, options)
    if isinstance(given, RigidTop):
        exact = start.spin if isinstance(start, BodyState) else None
        spin = None if exact is None else float(exact)
        facts = (top, run.method, run.t, run.y, run.work)
        run = RigidTrajectory(*facts, follow=follow, body=given, spin=spin)
    elif follow:
        run = replace(run, follow=follow)
    if wanted:
        run.attitude  # noqa: B018 - now, so that it fails here
    return run


def _advance(
    found: Method, top: Any, state: Array, h: float, steps: int, every: int, options: dict[str, Any]
) -> Trajectory:
    """`integrate` by steps of h."""
    at_once = getattr(found.prepare, "at_once", None)
    if at_once and steps <= INTERRUPTIBLE and not (options or isinstance(top, (PerturbedTop, Problem))):
        y = at_once(top, state, h, steps, every)
        if y is not None and math.isfinite(h * steps):
            if len(y) != steps // every + 1:
                check_rows(found.name, "at_once", y, (steps // every + 1, 6))
            return Trajectory(top, found.name, grid_times(h, every, len(y)), y, Work(steps=steps))
    stepper = _prepare(found, top, state, h, options)
    if not math.isfinite(h * steps):
        raise StepError(found.name, "the time n h is beyond the largest double", h=h)
    y = stepper.record(state, steps, every)
    return Trajectory(top, found.name, grid_times(h, every, len(y)), y, stepper.work)


def _follow_magnet(
    magnet: Any, spins: Any, h: Any, steps: Any, method: Any, every: Any, options: dict[str, Any]
) -> Trajectory:
    from lagrange_bench.integrators.paper.gaudin_methods import (
        prepare_method,  # with mpmath: a top does not wait for it
    )

    if h is None or steps is None:
        raise ValueError("give h and steps")
    steps, every = check_grid(steps, every, "steps")
    stepper = prepare_method(magnet, spins, h, method, options)
    y = stepper.record(spins, steps, every)
    return Trajectory(magnet, method, grid_times(stepper.h, every, len(y)), y, stepper.work)


def two_point(top: LagrangeTop | RigidTop, y: ArrayLike, lam: complex, sheet: int = 1) -> Array:
    """One step of the two-point Bäcklund transformation with parameters λ and λ̄, any λ with Im λ > 0.

    `sheet` = 1 takes the branch of √Q(λ) continuous from +√C1 along the segment from 0 to λ; −1 the other
    one, which is the inverse map. At a root of Q they meet: within 1e-14 of a simple root, or 1e-8 of a double one,
    round-off decides which is which. At a double root there is no inverse: a homoclinic state
    goes to the sleeping top. Shape (6,). Source: paper, section 5.5; docs/exact-step.md.

    Raises
    ------
    ValueError : y, λ or sheet make no sense. StepError : the image is beyond the range of doubles.
    """
    top = top.top if isinstance(top, RigidTop) else top
    _check_top(top)
    if isinstance(top, (PerturbedTop, Problem)):
        raise ValueError("top must be a LagrangeTop or a RigidTop: the map is that of a uniform field")
    return any_parameter.two_point(top, check_state(y, "y"), lam, sheet)


def grid_times(h: float, every: int, rows: int) -> Array:
    """0, every·h, 2 every·h, …"""
    if rows <= FEW:
        return np.array([h * (float(every) * k) for k in range(rows)])
    return h * (every * np.arange(rows, dtype=np.float64))


def _look_up(top: Any, y0: ArrayLike, method: str | Method) -> tuple[Any, Method, Array]:
    """The top without its body, the method and the state, all checked."""
    plain = top.top if isinstance(top, RigidTop) else top
    _check_top(plain)
    if isinstance(top, Problem):
        return top, find_method(method), top.check_state(y0)
    found, state = find_method(method), check_state(y0)
    if isinstance(top, (RigidTop, PerturbedTop)):
        top.check_state(y0 if isinstance(y0, BodyState) else state)
    return plain, found, state


def _prepare(method: Method, top: Any, y0: Array, h: float, options: dict[str, Any]) -> Stepper:
    """`prepare`, of what has been checked."""
    build = method.prepare_for(top)
    check_options(method.name, build, options)
    start = perf_counter()
    before = y0.tobytes()
    stepper = watched(method.name, build(top, y0, h, **options), len(y0))
    if y0.tobytes() != before:
        raise ValueError(f"{method.name}: prepare wrote to y0")
    stepper.work.setup_seconds = perf_counter() - start
    return stepper


def _check_top(top: Any) -> None:
    if isinstance(top, NamedTop):
        raise ValueError(f"top must be {TOP_TYPES}; {top.name!r} has one: pass named.top, named.state")
    if not isinstance(top, (LagrangeTop, PerturbedTop, Problem)):
        raise ValueError(f"top must be {TOP_TYPES}; got {type(top).__name__}")
    top.single()


def _evaluate(method: Method, top: Any, y0: Array, t: ArrayLike, options: dict[str, Any]) -> Trajectory:
    evaluate = method.evaluate_for(top)
    if evaluate is None:
        raise ValueError(f"t: {method.name} steps on a grid only; give h and steps")
    times = check_times(t)
    check_options(method.name, evaluate, options)
    y, work = evaluate(top, y0, times, **options)
    check_rows(method.name, "evaluate", y, (len(times), len(y0)))
    return Trajectory(top, method.name, times, y, work)
