"""How a rigid body moves along a run: the part of a `Trajectory` that only a `RigidBody` has."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MOTION_COLUMNS = {  # in tables, named as in `Case`
    "position": ("px", "py", "pz"),
    "quaternion": ("qw", "qx", "qy", "qz"),
    "omega_body": ("wx", "wy", "wz"),
    "velocity": ("vx", "vy", "vz"),
}


class BodyMotion:
    """Rotation, position, velocities, energy and momentum of a `RigidBody` at the N times of a run; AttributeError for others."""

    top: Any
    y: Array
    states: Array

    @property
    def _body(self) -> RigidBody:
        """The body that moves; AttributeError for other problems."""
        if not kinds.rigid_body(self.top):
            raise AttributeError(f"{self.top!r} has no rotation or position: follow a RigidBody")
        return self.top

    def _with_rotation(self) -> NDArray[np.bool_]:
        """A mask of the rows with a rotation: there is none where the method failed."""
        with np.errstate(over="ignore"):
            size = np.sum(self.y[:, :4] ** 2, axis=1)
        return (size > 0.0) & (size < math.inf)

    @property
    def rotation(self) -> Rotation:
        """The N rotations of a RigidBody, a SciPy Rotation from the body's frame to the world's."""
        body = self._body
        if not (known := self._with_rotation()).all():
            raise ValueError(f"there is no rotation where the method failed: the state is {self.y[~known][0].tolist()}")
        return body.rotations(self.y)

    def euler_angles(self) -> Array:
        """Euler angles of the body.

        Within 1e-7 of the vertical only phi ± psi has a meaning; phi is then all of it.

        Returns
        -------
        (N, 3)
            (theta, phi, psi) in rad: R = R3(phi) R2(theta) R3(psi).
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # SciPy warns of the vertical
            return self.rotation.as_euler("ZYZ")[:, (1, 0, 2)]

    @property
    def position(self) -> Array:
        """The centre of mass of a RigidBody in the world's frame, m, shape (N, 3)."""
        return self.rotation.apply(self._body.com) if self._body.fixed else self.y[:, 7:10]

    @property
    def velocity(self) -> Array:
        """The velocity of the centre of mass of a RigidBody in the world's frame, m/s, shape (N, 3)."""
        return np.cross(self.omega_world, self.position) if self._body.fixed else self.y[:, 10:]

    @property
    def omega_body(self) -> Array:
        """Angular velocity of a RigidBody in its own frame, rad/s, shape (N, 3)."""
        return self._body.angular_velocity(self.y)

    @property
    def omega_world(self) -> Array:
        """Angular velocity of a RigidBody in the world's frame, rad/s, shape (N, 3)."""
        return self.rotation.apply(self.omega_body)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy of a RigidBody, J, shape (N,); 0 at rest at the height of the origin."""
        body, turning = self._body, self.top.energy(self.states)
        if body.fixed:
            return turning
        return turning + body.mass * (np.sum(self.velocity**2, axis=1) / 2 - self.position @ body.gravity)

    @property
    def momentum(self) -> Array:
        """Angular momentum of a RigidBody about its fixed point (or its centre of mass, if it flies) in the world's frame.

        kg m²/s, shape (N, 3).
        """
        return self.rotation.apply(self.y[:, 4:7] @ self._body.axes)

    def _motion(self) -> dict[str, Array]:
        if not kinds.rigid_body(self.top):
            return {}
        known, names = self._with_rotation(), ["position", "quaternion", "omega_body"]
        names += [] if self.top.fixed else ["velocity"]
        motion = {name: np.full((len(known), len(MOTION_COLUMNS[name])), np.nan) for name in names}
        if known.any():  # SciPy 1.15 cannot make a Rotation of no rows
            run = replace(self, y=self.y[known])  # type: ignore[type-var]
            motion["quaternion"][known] = run.rotation.as_quat(canonical=True, scalar_first=True)
            for name in {*names} - {"quaternion"}:
                motion[name][known] = getattr(run, name)
        return motion
