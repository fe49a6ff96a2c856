"""What runs are judged by: the exact solution where there is a closed form, else the reference solution."""

from __future__ import annotations

import math
from decimal import ROUND_DOWN, Context
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import warn_caller
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.truth import exact, free_body, symmetric_body

LONGEST = 2000.0  # time scales: a reference of this length takes some ten seconds
LOST = 1e-12  # error of a reference state: where it is larger no method that computes in doubles follows the motion
BITS = 44  # of the times for which reference solutions are computed and kept


def solution(problem: Any, y0: Array, times: ArrayLike, longest: float = LONGEST) -> Array:
    """The states (N, n) at `times` of the motion that is at y0 at t = 0.

    NaN where a chaotic motion is lost, and of a body beyond `longest`, with a warning.

    longest : of a run with a reference solution, in time scales.

    Raises
    ------
    ValueError : there is nothing to compare with; the message says why.
    """
    times = np.asarray(times, dtype=float)
    return _found("solution", problem, y0, (times,), times, np.zeros_like(times), longest)


def after_steps(problem: Any, y0: Array, h: float, counts: ArrayLike, longest: float = LONGEST) -> Array:
    """As `solution`, after n steps of h: at the times n·h themselves, which no doubles need be."""
    n = np.asarray(counts, dtype=float)
    return _found("after_steps", problem, y0, (h, counts), h * n, exact.rounded_off(h, n), longest)


def closed_form(problem: Any) -> bool:
    """Whether the motion is known for any length of time: of a top in alpha x3 + k x3²/2, and of a free or symmetric body."""
    return _of_body(problem) is not None or exact.vertical_field(problem) is not None


def name(problem: Any) -> str:
    """What the truth about a problem is called."""
    return "exact solution" if closed_form(problem) else "reference solution"


def _of_body(problem: Any) -> Any:
    """The closed form of a rigid body, a function; None if there is none."""
    if not isinstance(problem, RigidBody):
        return None
    forms = {"free": free_body.solution, "symmetric": symmetric_body.solution}
    return next((form for word, form in forms.items() if word in problem.offers), None)


def _found(
    which: str, problem: Any, y0: Array, when: tuple[Any, ...], times: Array, rest: Array, longest: float
) -> Array:
    """By the function `which` of `exact` of `when`; or by the reference at `times` + `rest`."""
    if (of_body := _of_body(problem)) is not None:
        return of_body(problem, y0, times, more=rest)  # type: ignore[no-any-return]
    if closed_form(problem) and np.any(y0[3:]):  # a problem may be posed without an axis
        return getattr(exact, which)(problem, y0, *when)
    end, most = np.max(np.abs(times), initial=0.0), longest * problem.scales(y0)[2]
    if end > most:
        possible = float(Context(prec=4, rounding=ROUND_DOWN).create_decimal_from_float(most))  # not a time beyond it
        reason = f"t = {end:g} is longer than {longest:g} time scales of the motion: take times up to {possible:.4g}"
        if not isinstance(problem, RigidBody):
            raise ValueError(reason)
        warn_caller(f"{reason}; later states are not compared", RuntimeWarning)
        states, near = np.full((len(times), len(y0)), math.nan), np.abs(times) <= most
        states[near] = _reference(problem, y0, times[near], rest[near])
        return states
    return _reference(problem, y0, times, rest)


def _reference(problem: Any, y0: Array, times: Array, rest: Array) -> Array:
    """Runs of one length with different steps end an ulp apart. They share one reference, at times of BITS bits, and the
    rest of the time, some 1e-13 of it, is one term of the Taylor series.
    """
    from lagrange_bench.integrators.truth import reference

    mantissas, exponents = np.frexp(times)
    shared = np.ldexp(np.rint(np.ldexp(mantissas, BITS)), exponents - BITS)
    try:
        found = reference.solution(problem, y0, shared)
    except StepError as error:
        raise ValueError(error.reason) from None
    rates = problem.rhs(found.states, times)
    states = found.states + (found.tail + ((times - shared) + rest)[:, None] * rates)
    return np.where(found.error[:, None] <= LOST, states, math.nan)
