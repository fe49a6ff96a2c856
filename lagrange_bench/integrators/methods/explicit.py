"""Explicit methods of your own for any problem: you write the increment of a step once, as a formula of the right-hand side."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.compiling.tape import Tape, Term, Terms
from lagrange_bench.integrators.methods.runge_kutta import stepper
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System

Rates = Callable[[Term, Terms], tuple[Term, ...]]
Increment = Callable[[Rates, Term, Terms, Term], Terms]


def explicit_stepper(name: str, problem: Problem, h: float, increment: Increment) -> FixedStepper:
    """A compiled stepper of an explicit one-step method of your own, for any problem.

    Parameters
    ----------
    name : str
        The method, in messages.
    problem : Problem
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
    formula, calls = _record(increment, problem.system)
    return stepper(name, problem, h, formula, calls)


@cache
def _record(increment: Increment, system: System) -> tuple[Program, int]:
    """The formula for the components that move, and its number of right-hand sides."""
    calls = 0

    def formula(tape: Tape, t: Term, y: Terms, h: Term, p: Terms) -> list[Term]:
        def rates(time: Term, state: Terms) -> tuple[Term, ...]:
            nonlocal calls
            calls += 1
            return system.rates(tape, time if system.timed else t, tuple(state), p, h)

        total = tuple(increment(rates, t, y, h))
        if len(total) != system.size:
            raise ValueError(f"increment gives {len(total)} numbers; a state has {system.size}")
        return [total[i] for i in system.moving]

    return system.record_step(formula), calls
