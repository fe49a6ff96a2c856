"""A top in a uniform field that is not vertical: the same top seen in a frame in which it is.

V = b·x adds a constant vector to the force, so the motion is that of a `LagrangeTop` with another vertical: what its methods
compute in that frame is turned back. Rotations are Poisson maps; they cost an error of some ulps at the start and the end.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import as_state
from lagrange_bench.integrators.interface import Array, Method, Stepper, Work
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.watched import watched


class Rotated(Stepper):
    """A stepper of a LagrangeTop as one of a PerturbedTop with a uniform field."""

    def __init__(self, stepper: Stepper, R: Array):
        self.stepper, self.R = stepper, R
        self.from_start = stepper.from_start

    @property
    def work(self) -> Work:  # type: ignore[override]
        """That of the stepper inside."""
        return self.stepper.work

    def advance(self, y: Array, n: int) -> Array:
        y = as_state(y)
        return turn(self.R.T, self.stepper.advance(turn(self.R, y), n)) if n else y.copy()

    def record(self, y: Array, n: int, every: int) -> Array:
        y = as_state(y)
        rows = turn(self.R.T, self.stepper.record(turn(self.R, y), n, every))
        rows[0] = y
        return rows


def turn(R: Array, y: Array) -> Array:
    """J and x of states (..., 6), both rotated; no bit of a row depends on the others, as it may in a product of matrices."""
    turned = np.empty(y.shape)
    for first in (0, 3):
        a, b, c = y[..., first], y[..., first + 1], y[..., first + 2]
        for k in range(3):
            turned[..., first + k] = (R[k, 0] * a + R[k, 1] * b) + R[k, 2] * c
    return turned


def prepare_for(method: Method, problem: Any) -> Callable[..., Stepper]:
    """(problem, y0, h, **options) → stepper, of a method that takes the problem; ValueError with the reason if not."""
    offers = _offers(method, problem)
    if offers is None:
        return method.prepare
    if method.in_field is not None:
        return method.in_field.prepare

    @wraps(method.prepare)
    def build(problem: PerturbedTop, y0: Array, h: float, **options: Any) -> Stepper:
        top, R = frame(problem)
        return Rotated(watched(method.name, method.prepare(top, turn(R, y0), h, **options)), R)

    return build


def evaluate_for(method: Method, problem: Any) -> Callable[..., tuple[Array, Work]] | None:
    """(problem, y0, times, **options) → states and work, as `prepare_for`; None if the method steps on a grid only."""
    offers = _offers(method, problem)
    if offers is None:
        return method.evaluate
    if method.in_field is not None:
        return method.in_field.evaluate
    if method.evaluate is None:
        return None
    evaluate = method.evaluate

    @wraps(evaluate)
    def run(problem: PerturbedTop, y0: Array, times: Array, **options: Any) -> tuple[Array, Work]:
        top, R = frame(problem)
        states, work = evaluate(top, turn(R, y0), times, **options)
        states = turn(R.T, states)
        states[times == 0.0] = y0
        return states, work

    return run


def _offers(method: Method, problem: Any) -> Any:
    if reason := method.takes(problem):
        raise ValueError(f"method: {reason}")
    return getattr(problem, "offers", None)


def frame(problem: PerturbedTop) -> tuple[Any, Array]:
    """The top and the rotation of `PerturbedTop.uniform`."""
    found = problem.uniform()
    assert found is not None
    return found
