"""Steps for a given error `tol`: run, halve the step, run again, until two runs agree. No estimate is fitted to anything.

States are compared at all output times, and at `PLACES` of the run if these are few. So two runs cannot agree by chance at one
time. A run is good if the one with twice its step differs by at most `tol`. This difference must also be at most half of the one
before, or both must be below `tol`. That takes at least three runs. While each halving at least halves the difference, the error
is at most the last difference (a geometric series). For a method of order p that shows its order the error is 1/(2^p − 1) of
that (Richardson). This factor is not used: near a close encounter two differences can show an order that the third denies. An
event so short that all runs step over it is not seen.

If halving does not help three times, with differences of at most `MOST`, only round-off is left, or the motion is sensitive to
it. On a chaotic motion runs never agree.

Source: this project; Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.4.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.interface import Array, StepError

LEAST, MOST = 1e-13, 0.1  # the smallest and the largest tol
PLACES = 16
HALVINGS, STALLS = 10, 3
NO_ROWS = np.full((1, 6), np.nan)


def check_tolerance(tol: Any) -> float:
    """`tol` as a float; ValueError if doubles cannot have such an error."""
    value = check_real(tol, "tol")
    if not LEAST <= value <= MOST:
        raise ValueError(f"tol must be between {LEAST:g} and {MOST:g}; got {value:g}")
    return value


def agreeing(
    name: str, run: Callable[[int], Array], tol: float, scales: tuple[float, float]
) -> tuple[Array, int, float]:
    """The states (N, 6) of a run that agrees with the one before, how often its step was halved, and the last difference.

    run : n → the states with 1/n of the first step. scales : of J and x.

    Raises
    ------
    StepError : the runs do not agree.
    """
    before, stalled, coarse = math.nan, 0, NO_ROWS
    for halved in range(HALVINGS + 1):
        try:
            fine, why = run(2**halved), ""
        except StepError as error:  # a step that long cannot be taken
            fine, why = NO_ROWS, f" ({error.reason})"
        difference = _difference(coarse, fine, scales)
        falls = difference <= 0.5 * before
        if difference <= tol and (falls or before <= tol):
            return fine, halved, difference
        stalled += before <= MOST and not falls
        if stalled == STALLS:
            why = ": half of the step does not help, what is left is round-off, or the motion is sensitive to it"
            break
        before, coarse = difference, fine
    reason = f"tol = {tol:g} is not reached: two runs differ by {difference:.0e}{why}"
    raise StepError(name, f"{reason}; take a larger tol, or method='taylor', which chooses each step")


def _difference(a: Array, b: Array, scales: tuple[float, float]) -> float:
    """The largest of several states, relative to the scales of J and x."""
    sizes = [np.linalg.norm((a - b)[:, 3 * i : 3 * i + 3], axis=1).max() / scale for i, scale in enumerate(scales)]
    return float(np.max(sizes))
