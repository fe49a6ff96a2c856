"""What runs are judged by: the exact solution of a Lagrange top, the reference solution of a top in a potential.

A top in a uniform field is a Lagrange top about another vertical, and has an exact solution, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from integrators.interface import Array, StepError
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.rotated import turn
from integrators.truth import exact

LONGEST = 2000.0  # time scales: a reference of this length takes some ten seconds
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
    from integrators.truth import reference

    times = np.abs(when[0] if len(when) == 1 else when[0] * np.asarray(when[1], dtype=float))
    if np.max(times, initial=0.0) > LONGEST * problem.scales(y0)[2]:
        raise ValueError(f"the run is longer than {LONGEST:g} time scales 1/(|J| + √(|alpha||x|))")
    try:
        found = getattr(reference, which)(problem, y0, *when)
    except StepError as error:
        raise ValueError(error.reason) from None
    return np.where(found.error[:, None] <= LOST, found.states, np.nan)
