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

import numpy as np

from lagrange_bench.integrators.interface import Array, StepError

LEAST = 1e-13  # the smallest tol
MOST = 0.1  # the largest tol
PLACES = 16  # least number of states that are compared
HALVINGS = 10  # at most
STALLS = 3  # halvings that do not help: there are no more
NO_ROWS = np.full((1, 6), np.nan)  # of a run that fails


def agreeing_run(
    name: str, run: Callable[[int], Array], tol: float, scales: tuple[float, float]
) -> tuple[Array, int, float]:
    """The states (N, 6) of a run that agrees with the one before, the number of halvings of its step, and the last difference.

    run : n → the states with 1/n of the first step. scales : of J and x.

    Raises
    ------
    StepError : the runs do not agree.
    """
    previous, stalls, coarse = math.nan, 0, NO_ROWS
    for halvings in range(HALVINGS + 1):
        try:
            fine, cause = run(2**halvings), ""
        except StepError as error:  # a step that long cannot be taken
            fine, cause = NO_ROWS, f" ({error.reason})"
        difference = _difference(coarse, fine, scales)
        is_falling = difference <= 0.5 * previous
        if difference <= tol and (is_falling or previous <= tol):
            return fine, halvings, difference
        if previous <= MOST and not is_falling:
            stalls += 1
        if stalls == STALLS:
            cause = ": half of the step does not help, what is left is round-off, or the motion is sensitive to it"
            break
        previous, coarse = difference, fine
    reason = f"tol = {tol:g} is not reached: two runs differ by {difference:.0e}{cause}"
    raise StepError(name, f"{reason}; take a larger tol, or method='taylor', which chooses each step")


def _difference(a: Array, b: Array, scales: tuple[float, float]) -> float:
    """The largest of several states, relative to the scales of J and x."""
    sizes = [np.linalg.norm((a - b)[:, 3 * i : 3 * i + 3], axis=1).max() / scale for i, scale in enumerate(scales)]
    return float(np.max(sizes))
