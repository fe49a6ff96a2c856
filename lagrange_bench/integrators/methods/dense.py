"""The common part of methods that choose their own steps.

Such a method supplies `run(y, grid, work) -> (len(grid), 6)`: the states at the times of a strictly monotone `grid` that leads
away from 0. `run` counts its work in `work`, leaves `y` alone, and raises `StepError` if the library reports a failure.
"""

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import as_state, check_count, check_grid, check_real
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.problem.problem import Problem

FARTHEST = 1e12  # time scales of a top: with one step of a microsecond in each, eleven days
Run = Callable[[Array, Array, Work], Array]


class DenseStepper(Stepper):
    """A `Stepper` whose h only makes the output grid."""

    def __init__(self, name: str, top: Problem, y0: Array, h: float, run: Run):
        self.name, self.h, self.run, self.farthest = name, h, run, farthest(top, y0)
        self.work, self.size, self.from_start = Work(), len(y0), top.system.timed

    def advance(self, y: Array, n: int) -> Array:
        # not by `record`: its arrays cost as much as a short run
        y = as_state(y, self.size)
        if check_count(n, "n") == 0:
            return y.copy()
        return self._to(y, np.array((self.h * n,)))[0]

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        y = as_state(y, self.size)
        out = np.empty((n // every + 1, self.size))
        out[0] = y
        if n:
            with np.errstate(over="ignore"):
                grid = self.h * np.arange(every, n + 1, every, dtype=np.float64)
            out[1:] = self._to(y, grid)
        return out

    def _to(self, y: Array, grid: Array) -> Array:
        if not math.isfinite(grid[-1]):
            raise StepError(self.name, "the time n h is beyond the largest double", h=self.h)
        if abs(grid[-1]) > self.farthest:
            raise StepError(self.name, too_far(grid[-1], self.farthest), h=self.h)
        try:
            return finite(self.name, self.run(y, grid, self.work))
        except StepError as error:
            raise StepError(error.method, error.reason, h=self.h, step=error.step) from None


def dense(
    name: str, runner: Callable[..., Run]
) -> tuple[Callable[..., DenseStepper], Callable[..., tuple[Array, Work]]]:
    """`prepare` and `evaluate` of a method with the options of `runner`, where `runner(top, *, …)` makes its `run`."""

    def prepare(top: Problem, y0: Array, h: float, **options: Any) -> DenseStepper:
        return DenseStepper(name, top, y0, h, runner(top, **options))

    def evaluate(top: Problem, y0: Array, times: Array, **options: Any) -> tuple[Array, Work]:
        return at_times(name, top, runner(top, **options), y0, times)

    options = [p for p in inspect.signature(runner).parameters.values() if p.kind is p.KEYWORD_ONLY]
    functions: tuple[Any, ...] = prepare, evaluate
    for function in functions:
        parameters = list(inspect.signature(function).parameters.values())[:-1]
        function.__signature__ = inspect.Signature(parameters + options)
    return prepare, evaluate


def check_tolerance(tol: Any, least: float, most: float) -> float:
    """`tol` as a float; ValueError if it is not between `least` and `most`."""
    value = check_real(tol, "tol")
    if not least <= value <= most:
        raise ValueError(f"tol must be between {least:.3g} and {most:g}; got {value:g}")
    return value


def farthest(top: Problem, y0: Array) -> float:
    """The longest time from y0 on that steps can reach; inf at an equilibrium, where steps grow without limit."""
    with np.errstate(all="ignore"):
        return FARTHEST * top.scales(y0)[2] if np.any(top.rhs(y0)) else math.inf


def too_far(t: float, limit: float) -> str:
    """The reason why a time is refused."""
    return (
        f"|t| = {abs(t):g} is over {FARTHEST:g} times the shortest time scale of the motion, {limit / FARTHEST:g}: "
        f"more steps than can be taken"
    )


def at_times(name: str, top: Problem, run: Run, y0: Array, times: Array) -> tuple[Array, Work]:
    """States at any times, in any order and on both sides of 0."""
    work, limit, longest = Work(), farthest(top, y0), np.max(np.abs(times), initial=0.0)
    if longest > limit:
        raise StepError(name, too_far(longest, limit))
    out = np.empty((len(times), len(y0)))
    out[times == 0.0] = y0
    for side, sign in ((times > 0.0, 1.0), (times < 0.0, -1.0)):
        if np.any(side):
            grid, places = np.unique(sign * times[side], return_inverse=True)  # away from 0, each time once
            out[side] = finite(name, run(y0, sign * grid, work))[places]
    return out, work


def finite(name: str, states: Array) -> Array:
    # for a few numbers NumPy takes longer than Python
    is_finite = all(map(math.isfinite, states[0].tolist())) if len(states) == 1 else np.isfinite(states).all()
    if not is_finite:
        raise StepError(name, "the state left the range of floating-point numbers")
    return states
