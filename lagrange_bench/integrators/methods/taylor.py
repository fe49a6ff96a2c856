"""heyoka's Taylor series, on its natural steps.

`taylor` is heyoka's adaptive integrator as it is meant to be used: natural steps, unrolled machine code (`compact_mode=False`),
one call for a whole run. h is only the output grid, which its dense output fills. To cut steps to h would be unfair: the order
follows from the tolerance, and the step from the decay of the coefficients.

The tolerance is relative above norm 1 and absolute below, so a state smaller than 1 may need other units. A top whose rate
|J| + √(|alpha||x|) or |x| is beyond 2^±FAR is followed in units, powers of two, in which both are of order one. (Twentieth
powers of extreme numbers under- or overflow.) alpha is a runtime parameter, so heyoka compiles once in a process for each
tolerance, with and without `high_accuracy`.

With `high_accuracy` the series is summed with compensation.

J3, whose coefficients vanish, is conserved; no other invariant is. One right-hand side is counted for each Taylor coefficient:
`order` in each step.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99; Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka).
"""

import copy
import math
import threading
from functools import lru_cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_flag
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Run, check_tolerance, dense
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System, uniform_system
from lagrange_bench.integrators.problem.units import Units, ldexp, units_of

EPS = float(np.finfo(float).eps)
FAR = 10  # powers of two: the tolerance is relative to the largest number of a state


def equations(system: System | None = None, has_units: bool = False) -> list[Any]:
    """The equations of motion in heyoka's symbols, by default those of the Lagrange top.

    The parameters are heyoka's runtime parameters; the time at the start is the last one. With `has_units` those of rates and of
    lengths are two more parameters, in front of the others.
    """
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    system = system or uniform_system()
    first, count = 2 if has_units else 0, system.parameters
    names = ("J1", "J2", "J3", "x1", "x2", "x3") if system.size == 6 else [f"y{i}" for i in range(system.size)]
    y = hy.make_vars(*names)
    rate, length = (hy.par[0], hy.par[1]) if has_units else (1.0, 1.0)
    scales = (rate, rate, rate, length, length, length) if has_units else None
    states = [u * v for u, v in zip(scales, y, strict=True)] if scales else y
    t = hy.time + hy.par[first + count] if system.timed else 0.0
    rates = system.rhs(t, *states, *(hy.par[first + i] for i in range(count)))
    if scales:
        rates = tuple(f / (rate * u) for f, u in zip(rates, scales, strict=True))
    return [(v, f if isinstance(f, hy.expression) else hy.expression(f)) for v, f in zip(y, rates, strict=True)]


@lru_cache(maxsize=64)
def compile_integrator(tol: float, high_accuracy: bool, system: System | None = None, has_units: bool = False) -> Any:
    """heyoka's integrator for one tolerance. It has a state: see `integrator_of_thread`."""
    import heyoka as hy

    motion = equations(system, has_units)
    return hy.taylor_adaptive(motion, [1.0] * len(motion), tol=tol, high_accuracy=high_accuracy, compact_mode=False)


def integrator_of_thread(*key: Any) -> Any:
    """The integrator of this thread, copied once, because a copy costs more than a short run.

    Steppers share it: each run sets its whole state anew.
    """
    integrators: dict[Any, Any] = _of_thread.__dict__.setdefault("integrators", {})
    if key not in integrators:
        integrators[key] = copy.deepcopy(compile_integrator(*key))
    return integrators[key]


_of_thread = threading.local()


def far_units(top: Problem, y: Array, end: float) -> Units | None:
    """The units in which to follow a state; None for the user's own, which serve every problem that is not a top."""
    units = units_of("taylor", top, y, end) if kinds.top(top) else None
    return units if units and max(abs(units.rate), abs(units.length)) > FAR else None


def runner(top: Problem, *, tol: float = EPS, high_accuracy: bool = False) -> Run:
    """Natural steps with the local error below `tol` (relative above norm 1).

    high_accuracy : compensated sums.
    """
    key = check_tolerance(tol, EPS, 1.0), check_flag(high_accuracy, "high_accuracy"), top.system
    numbers = (*top.numbers, top.start) if top.system.timed else tuple(top.numbers)
    integrator_of_thread(*key)

    def run(y: Array, grid: Array, work: Work) -> Array:
        units = far_units(top, y, float(grid[-1]))
        if units is None:
            return follow(y, grid, work, key, numbers)
        scaled_grid = np.array([units.time(t) for t in grid.tolist()])
        in_units: tuple[Any, Any] = key, (units.alpha,)
        if not kinds.uniform(top):
            in_units = (*key, True), (ldexp(1.0, units.rate), ldexp(1.0, units.length), *numbers)
        try:
            return units.leave(follow(units.enter(y), scaled_grid, work, *in_units))
        except StepError as error:
            raise StepError("taylor", f"{error.reason}, in units of 2^{-units.rate}", step=error.step) from None

    def follow(y: Array, grid: Array, work: Work, key: Any, numbers: Any) -> Array:
        ta = integrator_of_thread(*key)  # of the thread that runs
        ta.pars[:] = numbers[: len(ta.pars)]  # heyoka has only those that the equations contain, up to the last of them
        ta.time = 0.0
        ta.state[:] = y
        out, steps = _until(ta, grid[0]) if len(grid) == 1 else _on_grid(ta, y, grid)
        work.steps += steps
        work.rhs_evals += steps * ta.order
        return out

    return run


def _until(ta: Any, end: float) -> tuple[Array, int]:
    """The state at one time: natural steps, of which the last is shortened."""
    steps, is_limited = 0, True
    while is_limited:  # resuming at a limit of steps changes no bit
        outcome, _, _, steps_of_call, *_ = ta.propagate_until(end, max_steps=INTERRUPTIBLE)
        steps += steps_of_call
        is_limited = _check(ta, outcome, steps)
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
    place = f" at t = {ta.time:g}" if math.isfinite(ta.time) else ""
    raise StepError("taylor", f"heyoka: {outcome.name}{place}", step=steps)


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
