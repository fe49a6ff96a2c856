"""The exact motion of a symmetric rigid body, from its Lagrange top (J, x) and the frame that turns with J.

With the moments of inertia A across and C along the axis a, and the constant L_a = L·a,

    J = R L/A        ω = J + σ x,   σ = L_a (A − C)/(A C)
    R(t) = F(t) R(0) exp(σ t â)        L(t) = A R(t)ᵀ J(t)

F is the rotation of the frame with the angular velocity J, F(0) = 1. Methods that are exact on the top follow it, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_grid
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import two_prod
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.rotation import quaternion_product

PARTED = 1e-6  # largest difference of F x(0) and x(t): on a stable orbit the two agree to round-off
PI = Fraction("3.14159265358979323846264338327950288419716939937510582")


@jit
def compose(frames, left, right, axis, half_turns, times, x):
    """Put left·F(t)·right·(the own spin about the axis) into `frames`. Returns the largest difference of F x[0] and x[1 + i]."""
    apart, x0 = 0.0, (0.0, x[0, 0], x[0, 1], x[0, 2])
    for i in range(len(times)):
        F = (frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3])
        _, a, b, c = quaternion_product(quaternion_product(F, x0), (F[0], -F[1], -F[2], -F[3]))
        for off in (a - x[i + 1, 0], b - x[i + 1, 1], c - x[i + 1, 2]):
            apart = max(apart, abs(off)) if abs(off) < math.inf else math.inf
        p, e = two_prod(times[i], half_turns[0])
        half = 2.0 * math.pi * ((p - np.rint(p)) + (e + times[i] * half_turns[1]))
        s = math.sin(half)
        own = (math.cos(half), s * axis[0], s * axis[1], s * axis[2])
        g = quaternion_product(quaternion_product(left, F), quaternion_product(right, own))
        frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3] = g
    return apart


def follow(name: str, body: RigidBody, y0: Array, times: Array, states: Array, frames: Array) -> Array:
    """The states (N, 7) of the body at `times`, from the states (N, 6) of its top and the quaternions (N, 4) of F.

    Raises
    ------
    StepError
        `states` and `frames` do not belong together: the orbit is unstable.
    """
    from scipy.spatial.transform import Rotation

    k, A, start = body.symmetry, body.across, body.reduced(y0)
    assert k is not None
    C, along = float(body.inertia[k]), float(y0[4 + k])
    turns = Fraction(along) * (Fraction(A) - Fraction(C)) / (Fraction(A) * Fraction(C)) / (4 * PI)
    half_turns = float(turns), float(turns - Fraction(float(turns)))
    world = Rotation.from_matrix(body.world)
    turn = Rotation.from_quat(y0[:4], scalar_first=True)
    left, right = (tuple(q.as_quat(scalar_first=True).tolist()) for q in (world.inv(), world * turn))
    x = np.concatenate((start[None, 3:], states[:, 3:]))
    axis = tuple(np.eye(3)[k].tolist())
    y = np.empty((len(times), 7))
    quaternions = np.array(frames)
    apart = compose(quaternions, left, right, axis, half_turns, times, x)
    if not apart < PARTED:
        raise StepError(name, f"attitude and state have parted by {apart:.1e}: the orbit is unstable")
    q = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    y[:, :4] = q
    back = Rotation.from_quat(q, scalar_first=True).inv() if len(q) else Rotation.identity(0)
    y[:, 4:] = A * back.apply(states[:, :3] @ body.world) if len(q) else 0.0
    y[:, 4 + k] = along
    y[times == 0.0] = y0
    return y


class BodyStepper(Stepper):
    """Steps of h for a symmetric body.

    top_stepper : (top, state, h) → a stepper of its top. frames : (top, state, times) → quaternions (N, 4) of F.
    """

    from_start = True

    def __init__(self, name: str, body: RigidBody, h: float, top_stepper: Callable[..., Stepper], frames: Any):
        self.name, self.body, self.h, self._build, self._frames = name, body, h, top_stepper, frames
        self.work = Work()

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        top, start = self.body.top, self.body.reduced(y)
        stepper = self._build(top, start, self.h)
        states = stepper.record(start, n, every)
        self.work.steps += n
        times = self.h * (every * np.arange(len(states), dtype=np.float64))
        return follow(self.name, self.body, y, times, states, self._frames(top, start, times))


def prepared(
    name: str, body: RigidBody, y0: Array, h: float, prepare: Callable[..., Stepper], frames: Any, **options: Any
) -> BodyStepper:
    """The stepper of a symmetric body, from `prepare` and `frames` for its top."""

    def build(top: Any, state: Array, h: float) -> Stepper:
        return prepare(top, state, h, **options)

    build(body.top, body.reduced(y0), h)  # fails here, and not in the first step
    return BodyStepper(name, body, h, build, frames)


def evaluated(
    name: str, body: RigidBody, y0: Array, times: Array, evaluate: Callable[..., Any], frames: Any
) -> tuple[Array, Work]:
    """The states (N, 7) of a symmetric body at `times`, from `evaluate` and `frames` for its top."""
    top, start = body.top, body.reduced(y0)
    states, work = evaluate(top, start, times)
    return follow(name, body, y0, times, states, frames(top, start, times)), work
