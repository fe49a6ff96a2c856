"""What runs are judged by: the exact solution of a Lagrange top, the reference solution of a top in a potential.

A top in a uniform field is a Lagrange top about another vertical, and has an exact solution, too.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from integrators.interface import Array, StepError
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.rotated import turn
from integrators.truth import exact

LOST = 1e-12  # error of a reference state: where it is larger no method that computes in doubles follows the motion


def solution(problem: Any, y0: Array, times: ArrayLike) -> Array:
    """The states (N, 6) at `times` of the motion that is at y0 at t = 0; NaN where a chaotic motion is lost.

    Raises
    ------
    ValueError : there is nothing to compare with; the message says why.
    """
    return _found("solution", problem, y0, np.asarray(times, dtype=float))


def after_steps(problem: Any, y0: Array, h: float, counts: ArrayLike) -> Array:
    """As `solution`, after n steps of h: at the times n·h themselves, which no doubles need be."""
    return _found("after_steps", problem, y0, h, counts)


def name(problem: Any) -> str:
    """What the truth about a problem is called."""
    perturbed = isinstance(problem, PerturbedTop) and problem.uniform() is None
    return "reference solution" if perturbed else "exact solution"


def _found(which: str, problem: Any, y0: Array, *when: Any) -> Array:
    if not isinstance(problem, PerturbedTop):
        states: Array = getattr(exact, which)(problem, y0, *when)
        return states
    if (uniform := problem.uniform()) is not None:
        top, R = uniform
        return turn(R.T, getattr(exact, which)(top, turn(R, y0), *when))
    try:
        reference = importlib.import_module("integrators.truth.reference")
        found = getattr(reference, which)(problem, y0, *when)
    except (ImportError, StepError) as error:
        raise ValueError(getattr(error, "reason", "the reference solution is missing")) from None
    return np.where(found.error[:, None] <= LOST, found.states, np.nan)
