"""Bodies in closed form: rows of the truth, and the attitude of a symmetric body for methods that are exact on its top.

A symmetric body with the moment A across its axis a has a top J = R L/A, x = R a. A method that is exact on the top gives J. The
closed form of the body gives R. Then L = A Rᵀ J.
"""

from collections.abc import Callable

import numpy as np

from lagrange_bench.integrators.checks import check_grid
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.truth import truths

LARGEST_GAP = 1e-6  # between R a and x: on a stable orbit the two agree to round-off
Solution = Callable[[RigidBody, Array, Array], Array]  # (body, start, times) → states (N, 7)


def closed_form(body: RigidBody, y0: Array, times: Array) -> Array:
    """The states (N, 7) of a free or symmetric body at any times."""
    try:
        y = truths.solution(body, y0, times)
    except ValueError as error:
        raise StepError("theta_functions", str(error)) from None
    y[times == 0.0] = y0
    return y


def with_attitude(name: str, body: RigidBody, y0: Array, times: Array, states: Array) -> Array:
    """The states (N, 7) of a symmetric body at `times`, from the states (N, 6) of its top there.

    Raises
    ------
    StepError
        The two have parted: the orbit is unstable.
    """
    y, k, axis = closed_form(body, y0, times), body.symmetry, body.axis
    assert k is not None
    assert axis is not None
    R = body.world @ body.rotations(y).as_matrix() @ body.axes.T
    x = R[:, :, k] * np.sign(axis @ body.axes[k])
    gap = np.max(np.abs(x - states[:, 3:]), initial=0.0)
    if not gap < LARGEST_GAP:
        raise StepError(name, f"attitude and state have parted by {gap:.1e}: the orbit is unstable")
    y[:, 4:] = body.across * (R.transpose(0, 2, 1) @ states[:, :3, None])[:, :, 0]
    y[:, 4 + k] = y0[4 + k]
    y[times == 0.0] = y0
    return y


class BodyStepper(Stepper):
    """The states of a body at every multiple of h."""

    from_start = True

    def __init__(self, body: RigidBody, h: float, solution: Solution):
        self.body, self.h, self.solution, self.work = body, h, solution, Work()

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        self.work.steps += n
        return self.solution(self.body, y, self.h * (every * np.arange(n // every + 1, dtype=np.float64)))
