"""A rigid body with one point fixed, in a uniform field, position and rotation together: any body, any direction of gravity.

    H = Σ L_i²/(2 I_i) + w·Γ,   w = m |g| X,   Γ = Rᵀ(up)

y = (q, L) are seven numbers: the unit quaternion of R, scalar first, and the angular momentum about the fixed point along the
principal axes of inertia. H depends on q by the quadratic form q̄ up q. So |q| and the momentum about the vertical are conserved
for any |q|, and H is quadratic: what conserves quadratic functions conserves energy. The names of the invariants are those of
the top: C1 is |q|², J3 the momentum about the vertical, and C2, of a symmetric body only, that about its axis.

Source: Arnold, Mathematical Methods of Classical Mechanics (1989), sections 29 and 30.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_real
from lagrange_bench.integrators.problem.body import SYMMETRIC, UNIT, RigidTop, as_motion, principal_moments, real_array
from lagrange_bench.integrators.problem.problem import Problem

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

EQUAL = 1e-14  # relative: what the rounding of a rotated matrix leaves of a component that vanishes
WEIGHT, UP = 3, 6  # places of the parameters, after the inverse moments of inertia


class WholeBody(Problem):
    """A heavy rigid body as a `Problem` on "body", SI units; not necessarily symmetric.

    Parameters
    ----------
    mass : float
        In kg.
    com : (3,)
        In m, the centre of mass in the body's frame, from the fixed point.
    inertia_com : (3,) or (3, 3)
        In kg m², about the centre of mass: three moments or a matrix.
    gravity : (3,)
        In m/s², in the world's frame.

    Attributes
    ----------
    inertia : (3,)
        In kg m², principal moments about the fixed point.
    axes : (3, 3)
        Their axes as rows, in the body's frame.
    axis : int or None
        The number of the axis of symmetry.
    weight, up : (3,)
        w in the principal frame, and the direction against gravity in the world's.

    Raises
    ------
    ValueError
        A malformed number, or moments of inertia that no body has.
    """

    def __init__(
        self, mass: float, com: ArrayLike, inertia_com: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)
    ) -> None:
        mass, field, at = check_real(mass, "mass"), real_array(gravity, "gravity", (3,)), real_array(com, "com", (3,))
        moments = real_array(inertia_com, "inertia_com", (3,), (3, 3))
        self.facts = {"mass": mass, "com": at.tolist(), "inertia_com": moments.tolist(), "gravity": field.tolist()}
        matrix = np.diag(moments) if moments.ndim == 1 else moments
        if mass <= 0:
            raise ValueError(f"mass must be positive; got {mass}")
        principal_moments(matrix)
        self.com, size = at, float(np.linalg.norm(field))
        self.inertia, self.axes = _principal(matrix + mass * (at @ at * np.eye(3) - np.outer(at, at)))
        self.up = -field / size if size else np.array((0.0, 0.0, 1.0))
        weight = mass * size * (self.axes @ at)
        self.weight = np.where(np.abs(weight) > EQUAL * np.max(np.abs(weight)), weight, 0.0)
        self.axis = _axis_of_symmetry(self.inertia, self.weight)
        numbers = (*(1.0 / self.inertia), *self.weight, *self.up)
        invariants = {"J3": self._vertical}
        if (axis := self.axis) is not None:
            invariants["C2"] = lambda t, y, p: y[4 + axis]
        super().__init__("whole_body", "body", self._hamiltonian, numbers, invariants=invariants, frame="body")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self.facts.items())})"

    @classmethod
    def of(cls, top: RigidTop) -> WholeBody:
        """The body of a symmetric top."""
        if not isinstance(top, RigidTop):
            raise ValueError(f"top must be a RigidTop, which has a mass; got {type(top).__name__}")
        return cls(top.mass, top.com, top.inertia_com, top.gravity)

    def _vertical_axis(self, y: Any, p: Any) -> list[Any]:
        """|q|² Rᵀ(up), components of `up` that are 0 or 1 as constants."""
        up = [float(v) if v in (0.0, 1.0) else p[UP + i] for i, v in enumerate(self.up.tolist())]
        q0, q = y[0], y[1:4]
        scalar, along = q0 * q0 - sum(v * v for v in q), 2.0 * sum(v * u for v, u in zip(q, up, strict=True))
        pairs = [(1, 2), (2, 0), (0, 1)]
        across = [2.0 * q0 * (q[j] * up[k] - q[k] * up[j]) for j, k in pairs]
        return [scalar * u + along * v - w for u, v, w in zip(up, q, across, strict=True)]

    def _hamiltonian(self, t: Any, y: Any, p: Any) -> Any:
        kinetic = sum(p[i] * (y[4 + i] * y[4 + i]) for i in range(3)) / 2.0
        heights = enumerate(self._vertical_axis(y, p))
        return kinetic + sum(p[WEIGHT + i] * height for i, height in heights if self.weight[i])

    def _vertical(self, t: Any, y: Any, p: Any) -> Any:
        return sum(v * w for v, w in zip(y[4:7], self._vertical_axis(y, p), strict=True))

    @cached_property
    def offers(self) -> frozenset[str]:
        """As any problem's, and "body"."""
        return super().offers | {"body"}

    # ------------------------------------------------------------------ states and what is seen of them

    def state(
        self, *, rotation: Rotation | ArrayLike, omega_body: ArrayLike | None = None, omega_world: Any = None
    ) -> Array:
        """The state (7,) that `integrate` takes.

        rotation : a SciPy Rotation, a matrix (3, 3) or a unit quaternion (4,), scalar first, body to world. omega_body or
        omega_world : (3,) rad/s.
        """
        from scipy.spatial.transform import Rotation

        turn, omega = as_motion(rotation, omega_body, omega_world)
        q = (turn * Rotation.from_matrix(self.axes.T)).as_quat(scalar_first=True)
        return np.concatenate((q, self.inertia * (self.axes @ omega)))

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """As of any problem; ValueError also for a quaternion that is no unit one."""
        state = super().check_state(y, name)
        if abs((length := np.linalg.norm(state[:4])) - 1.0) > UNIT:
            raise ValueError(f"{name}: the quaternion must be a unit one; its length is {length:.9g}")
        return state

    def rotations(self, y: ArrayLike) -> Rotation:
        """Of states (N, 7): from the body's frame to the world's."""
        from scipy.spatial.transform import Rotation

        quaternions = np.asarray(y, dtype=float)[..., :4]
        return Rotation.from_quat(quaternions, scalar_first=True) * Rotation.from_matrix(self.axes)

    def angular_velocity(self, y: ArrayLike) -> Array:
        """ω of states (N, 7) in the body's frame, rad/s, shape (N, 3)."""
        return (np.asarray(y, dtype=float)[..., 4:] / self.inertia) @ self.axes

    def errors(self, y: ArrayLike, rotation: ArrayLike) -> dict[str, Array]:
        """How far states (N, 7) are from the rotations (N, 3, 3) of another solution, body to world.

        position : m, of the centre of mass. rotation : rad, the angle between the two. spin : rad, of a symmetric body,
        the part of it about the axis.
        """
        from scipy.spatial.transform import Rotation

        matrices = np.asarray(rotation, dtype=float)
        off = Rotation.from_matrix(matrices).inv() * self.rotations(y)
        found = {
            "position": np.linalg.norm(self.rotations(y).apply(self.com) - matrices @ self.com, axis=-1),
            "rotation": off.magnitude(),
        }
        if self.axis is not None:
            q = off.as_quat(scalar_first=True)
            twist = 2.0 * np.arctan2(q[..., 1:] @ self.axes[self.axis], q[..., 0])
            found["spin"] = np.abs(np.remainder(twist + math.pi, 2.0 * math.pi) - math.pi)
        return found


def _principal(inertia: Array) -> tuple[Array, Array]:
    """The principal moments, equal ones to the bit, and their axes as rows; those of the frame if the matrix is diagonal."""
    if np.count_nonzero(inertia - np.diag(np.diag(inertia))):
        moments, columns = np.linalg.eigh(inertia)
        axes = columns.T * np.linalg.det(columns)
    else:
        moments, axes = np.diag(inertia).copy(), np.eye(3)
    size = float(np.max(np.abs(moments)))
    for i, j in ((0, 1), (1, 2), (0, 2)):
        if abs(moments[i] - moments[j]) <= SYMMETRIC * size:
            moments[j] = moments[i]
    if np.min(moments) <= 0.0:
        raise ValueError(f"inertia_com: moments about the fixed point must be positive; got {moments.tolist()}")
    return moments, axes


def _axis_of_symmetry(moments: Array, weight: Array) -> int | None:
    """The number of the axis about which a turn changes nothing; None if there is none among the principal axes."""
    for k in (2, 1, 0):
        i, j = (k + 1) % 3, (k + 2) % 3
        if moments[i] == moments[j] and weight[i] == weight[j] == 0.0:
            return k
    return None
