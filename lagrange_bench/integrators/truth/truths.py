"""The truth about a run: the exact solution if there is a closed form, else the reference solution."""

import math
from decimal import ROUND_DOWN, Context
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import warn_caller
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.truth import exact

LONGEST = 2000.0  # time scales: a reference of this length takes about ten seconds
LOST = 1e-12  # error of a reference state; beyond it, no method in doubles can follow the motion
BITS = 44  # precision of the times for which reference solutions are computed


def solution(problem: Any, y0: Array, times: ArrayLike, longest: float = LONGEST) -> Array:
    """The true states (N, n) at `times` of the motion that is at y0 at t = 0.

    States are NaN from where a chaotic motion is lost, and for a body beyond `longest`, with a warning. ValueError if there is no
    truth to compare with; the message says why. longest : of a reference solution, in time scales.
    """
    times = np.asarray(times, dtype=float)
    return _solution(problem, y0, times, np.zeros_like(times), longest)


def after_steps(problem: Any, y0: Array, h: float, counts: ArrayLike, longest: float = LONGEST) -> Array:
    """As `solution`, after `counts` steps of h: at the exact times n·h, which need not be doubles."""
    n = np.asarray(counts, dtype=float)
    return _solution(problem, y0, h * n, exact.rounded_off(h, n), longest)


def closed_form(problem: Any) -> bool:
    """Whether there is a closed form: for a top in alpha x3 + k x3²/2, and for a free or a symmetric body."""
    if kinds.rigid_body(problem):
        return kinds.free_body(problem) or kinds.symmetric_body(problem)
    return exact.vertical_field(problem) is not None


def name(problem: Any) -> str:
    """The name of the truth about a problem, for messages and figures."""
    return "exact solution" if closed_form(problem) else "reference solution"


def _solution(problem: Any, y0: Array, times: Array, rest: Array, longest: float) -> Array:
    """The truth at `times` + `rest`."""
    has_no_axis = not kinds.rigid_body(problem) and not np.any(y0[3:])  # a problem may start with x = 0
    if closed_form(problem) and not has_no_axis:
        return exact.in_doubles(exact.motion_of(problem, y0), times, rest)
    end, most = np.max(np.abs(times), initial=0.0), longest * problem.scales(y0)[2]
    if end > most:
        possible = float(Context(prec=4, rounding=ROUND_DOWN).create_decimal_from_float(most))  # rounded down
        reason = f"t = {end:g} is longer than {longest:g} time scales of the motion: take times up to {possible:.4g}"
        if not kinds.rigid_body(problem):
            raise ValueError(reason)
        warn_caller(f"{reason}; later states are not compared", RuntimeWarning)
        states, near = np.full((len(times), len(y0)), math.nan), np.abs(times) <= most
        states[near] = _reference(problem, y0, times[near], rest[near])
        return states
    return _reference(problem, y0, times, rest)


def _reference(problem: Any, y0: Array, times: Array, rest: Array) -> Array:
    """The reference solution at `times` + `rest`.

    Runs of one length with different steps end an ulp apart. They share one reference, at times rounded to BITS bits. One term of
    the Taylor series leads over the rest of the time, about 1e-13 of it.
    """
    from lagrange_bench.integrators.truth import reference

    mantissas, exponents = np.frexp(times)
    shared = np.ldexp(np.rint(np.ldexp(mantissas, BITS)), exponents - BITS)
    try:
        result = reference.solution(problem, y0, shared)
    except StepError as error:
        raise ValueError(error.reason) from None
    rates = problem.rhs(result.states, times)
    states = result.states + (result.tail + ((times - shared) + rest)[:, None] * rates)
    return np.where(result.error[:, None] <= LOST, states, math.nan)
