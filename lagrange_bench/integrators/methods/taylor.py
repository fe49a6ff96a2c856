"""heyoka's Taylor series, on its natural steps.

`taylor` is heyoka's adaptive integrator as it is meant to be used: natural steps, unrolled machine code (`compact_mode=False`),
one call for a whole run. h is only the output grid, which its dense output fills. To cut steps to h would be unfair: the order
follows from the tolerance, and the step from the decay of the coefficients.

The tolerance is relative above norm 1 and absolute below, so a state smaller than 1 may need other units. A top whose rate
|J| + √(|alpha||x|) or |x| is beyond 2^±FAR is followed in units, powers of two, in which both are of order one. (Twentieth
powers of extreme numbers under- or overflow.) alpha is a runtime parameter, so heyoka compiles once in a process for each
tolerance and each pair of switches.

With `high_accuracy` the series is summed with compensation. With `compact_mode` the machine code is what heyoka makes for large
systems: loops over tables, not unrolled, compiled sooner and slower here.

J3, whose coefficients vanish, is conserved; no other invariant is. One right-hand side is counted for each Taylor coefficient:
`order` in each step.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99; Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka).
"""

from __future__ import annotations

import copy
import math
import threading
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators.checks import check_flag, check_real
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Problem, Run, dense
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.system import System, uniform_system
from lagrange_bench.integrators.problem.units import Units, ldexp, units_of

EPS = float(np.finfo(float).eps)
FAR = 10  # powers of two: the tolerance is relative to the largest number of a state
INTERRUPTIBLE = 1 << 20  # most steps in one call of heyoka, which does not see Ctrl-C


class Equations(NamedTuple):
    """What the equations depend on, besides numbers: the system, and whether rates and lengths have units.

    If they have, the two units are numbers, too, in front of the others.
    """

    system: System
    units: bool = False


def equations(own: Equations | None = None) -> list[Any]:
    """The equations of motion in heyoka's symbols, by default those of the Lagrange top.

    The parameters are heyoka's runtime parameters; the time at the start is the last one.
    """
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    system, units = own or Equations(uniform_system())
    first, count = 2 * units, system.parameters
    names = ("J1", "J2", "J3", "x1", "x2", "x3") if system.size == 6 else [f"y{i}" for i in range(system.size)]
    y = hy.make_vars(*names)
    rate, length = (hy.par[0], hy.par[1]) if units else (1.0, 1.0)
    scales = (rate,) * 3 + (length,) * 3 if units else None
    states = [u * v for u, v in zip(scales, y, strict=True)] if scales else y
    t = hy.time + hy.par[first + count] if system.timed else 0.0
    rates = system.rhs(t, *states, *(hy.par[first + i] for i in range(count)))
    if scales:
        rates = tuple(f / (rate * u) for f, u in zip(rates, scales, strict=True))
    return [(v, f if isinstance(f, hy.expression) else hy.expression(f)) for v, f in zip(y, rates, strict=True)]


def set_numbers(ta: Any, numbers: Any) -> None:
    """Set the runtime parameters. heyoka has only those that the equations contain, up to the last of them."""
    ta.pars[:] = numbers[: len(ta.pars)]


@lru_cache(maxsize=64)
def compile_integrator(
    tol: float, high_accuracy: bool, compact_mode: bool = False, own: Equations | None = None
) -> Any:
    """heyoka's integrator for one tolerance. It has a state: see `integrator_here`."""
    import heyoka as hy

    system = equations(own)
    return hy.taylor_adaptive(
        system, [1.0] * len(system), tol=tol, high_accuracy=high_accuracy, compact_mode=compact_mode
    )


def integrator_here(*key: Any) -> Any:
    """The integrator of this thread: a copy takes 0.7 ms, in which heyoka follows 700 units of time.

    Steppers share it, because each run sets all that the run before has left in it.
    """
    compiled: dict[Any, Any] = _here.__dict__.setdefault("integrators", {})
    if key not in compiled:
        compiled[key] = copy.deepcopy(compile_integrator(*key))
    return compiled[key]


_here = threading.local()


def check_tolerance(tol: Any, least: float = EPS) -> float:
    tol = check_real(tol, "tol")
    if not least <= tol <= 1:
        raise ValueError(f"tol must be between {least:.3g} and 1; got {tol:g}")
    return tol


def far_units(name: str, top: Any, y: Array, end: float) -> Units | None:
    """The units in which to follow a state; None: the user's, which every problem that is not a top has."""
    if not kinds.top(top):
        return None
    rate, size, _ = top.scales(y)
    if 2.0**-FAR < size < 2.0**FAR and 2.0**-FAR < rate < 2.0**FAR:
        return None
    units = units_of(name, top, y, end)
    return units if max(abs(units.rate), abs(units.length)) > FAR else None


def runner(top: Problem, *, tol: float = EPS, high_accuracy: bool = False, compact_mode: bool = False) -> Run:
    """Natural steps with the local error below `tol` (relative above norm 1).

    high_accuracy : compensated sums. compact_mode : loops over tables in place of unrolled code.
    """
    switches = check_flag(high_accuracy, "high_accuracy"), check_flag(compact_mode, "compact_mode")
    key = check_tolerance(tol), *switches, Equations(top.system)
    numbers = (*top.numbers, *((top.start,) * top.system.timed))
    integrator_here(*key)

    def run(y: Array, grid: Array, work: Work) -> Array:
        if units := far_units("taylor", top, y, float(grid[-1])):
            scaled = np.array([units.time(t) for t in grid.tolist()])
            try:
                return units.leave(follow(units.enter(y), scaled, work, *in_units(units)))
            except StepError as error:
                raise StepError("taylor", f"{error.reason}, in units of 2^{-units.rate}", step=error.step) from None
        return follow(y, grid, work, key, numbers)

    def in_units(units: Units) -> tuple[Any, Any]:
        if kinds.uniform(top):
            return key, (units.alpha,)
        own = Equations(top.system, units=True)
        return (*key[:3], own), (ldexp(1.0, units.rate), ldexp(1.0, units.length), *numbers)

    def follow(y: Array, grid: Array, work: Work, key: Any, numbers: Any) -> Array:
        ta = integrator_here(*key)  # of the thread that runs
        set_numbers(ta, numbers)
        ta.time = 0.0
        ta.state[:] = y
        out, steps = _until(ta, grid[0]) if len(grid) == 1 else _on_grid(ta, y, grid)
        work.steps += steps
        work.rhs_evals += steps * ta.order
        return out

    return run


def _until(ta: Any, end: float) -> tuple[Array, int]:
    """The state at one time: natural steps, of which the last is shortened."""
    steps, limited = 0, True
    while limited:  # resuming at a limit of steps changes no bit
        outcome, _, _, taken, *_ = ta.propagate_until(end, max_steps=INTERRUPTIBLE)
        steps += taken
        limited = _check(ta, outcome, steps)
    return ta.state.copy().reshape(1, -1), steps


def _on_grid(ta: Any, y: Array, grid: Array) -> tuple[Array, int]:
    """The states on a grid, by dense output."""
    grid = np.concatenate(((0.0,), grid))
    # A run on a grid cannot be resumed without a shorter step. A callback lets Ctrl-C in after each step and changes no bit,
    # but it costs half as much as the step. So only long runs start again with a callback.
    for limit in ({"max_steps": INTERRUPTIBLE}, {"callback": lambda ta: True}):
        ta.time, ta.state[:] = 0.0, y
        outcome, _, _, steps, _, out = ta.propagate_grid(grid, **limit)
        if not _check(ta, outcome, steps):
            break
    return out[1:], steps


def _check(ta: Any, outcome: Any, steps: int) -> bool:
    """Whether heyoka stopped at its limit of steps; StepError unless that or the end of the run is the reason."""
    import heyoka as hy

    if outcome == hy.taylor_outcome.time_limit:
        return False
    if outcome == hy.taylor_outcome.step_limit:
        return True
    at = f" at t = {ta.time:g}" if math.isfinite(ta.time) else ""
    raise StepError("taylor", f"heyoka: {outcome.name}{at}", step=steps)


PREPARE, EVALUATE = dense("taylor", runner)
NATURAL = Method(
    name="taylor",
    label="Taylor (heyoka)",
    family="taylor",
    order=20,
    claims=Claims(conserves={"J3"}),
    control="tolerance",
    source="heyoka.taylor_adaptive; Biscani and Izzo, MNRAS 504 (2021) 2614",
    prepare=PREPARE,
    evaluate=EVALUATE,
    requires="heyoka",
    engine="heyoka",
    needs="smooth",
)
