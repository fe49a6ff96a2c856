"""Explicit methods of your own for any problem: you write what a step adds once, as a formula of the right-hand side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.methods.runge_kutta import stepper
from lagrange_bench.integrators.problem.system import System

Rates = Callable[[Any, Sequence[Any]], tuple[Any, ...]]
Increment = Callable[[Rates, Any, Sequence[Any], Any], Sequence[Any]]


def explicit_stepper(name: str, problem: Any, h: float, increment: Increment) -> FixedStepper:
    """A compiled stepper of an explicit one-step method of your own, for any problem.

    Parameters
    ----------
    name : str
        The method, in messages.
    problem : LagrangeTop, PerturbedTop, Problem, …
        The problem that `prepare` of the method gets. It must offer "rhs".
    h : float
        The step.
    increment : callable
        (rates, t, y, h) → what a step of h adds to the numbers y of a state. rates(t, y) is h y', as many numbers. It is called
        once, with symbols: + − × ÷ and the functions of formulas, no branches.

    Returns
    -------
    FixedStepper
        One step per h. It counts each call of `rates` as one right-hand side.

    Raises
    ------
    ValueError
        `increment` gives more or fewer numbers than a state has.
    """
    formula, calls = _recorded(increment, problem.system)
    return stepper(name, problem, h, formula, calls)


@cache
def _recorded(increment: Increment, system: System) -> tuple[Program, int]:
    """The formula for the components that move, and how many right-hand sides it takes."""
    calls = 0

    def formula(tape: Tape, t: Any, y: Any, h: Any, p: Any) -> list[Any]:
        def rates(time: Any, state: Sequence[Any]) -> tuple[Any, ...]:
            nonlocal calls
            calls += 1
            return system.rates(tape, time if system.timed else t, tuple(state), p, h)

        total = tuple(increment(rates, t, y, h))
        if len(total) != system.size:
            raise ValueError(f"increment gives {len(total)} numbers; a state has {system.size}")
        return [total[i] for i in system.moving]

    return system.record_step(formula), calls
