"""Checks rotations and angular velocities that users pass in. Multiplies quaternions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.integrators.checks import Array, check_array, warn_caller
from lagrange_bench.integrators.compiling.compiled import jit

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

# distance from a rotation up to which it is taken as it is
EXACT = 1e-12
# and up to which it is scaled, with a warning: 7 printed digits
ROUNDED = 1e-6


def as_rotation(rotation: Any) -> Rotation:
    """A single SciPy Rotation from a Rotation, a matrix (3, 3) or a unit quaternion (4,), scalar first.

    Warns if the quaternion or matrix is off by more than 1e-12, as printed digits and single precision are.

    Raises
    ------
    ValueError
        `rotation` is none of these, or off by more than 1e-6.
    """
    from scipy.spatial.transform import Rotation  # not at the start: it takes 0.2 s

    if isinstance(rotation, Rotation):
        if not rotation.single:
            raise ValueError(f"rotation must be a single one; got {len(rotation)}")
        return rotation
    R = check_array(rotation, "rotation", (3, 3), (4,))
    if R.shape == (4,):
        kind, off = "a unit quaternion, scalar first", abs(float(np.linalg.norm(R)) - 1.0)
    else:
        kind, off = "an orthogonal matrix with determinant 1", float(np.max(np.abs(R.T @ R - np.eye(3))))
        off = off if np.linalg.det(R) > 0 else np.inf
    if not off <= ROUNDED:
        raise ValueError(f"rotation must be {kind}; got {R.tolist()}")
    if off > EXACT:
        warn_caller(f"rotation is {kind}, but for {off:.1e}: it is scaled", RuntimeWarning)
    return Rotation.from_quat(R, scalar_first=True) if R.shape == (4,) else Rotation.from_matrix(R)


def as_motion(rotation: Any, omega_body: Any, omega_world: Any) -> tuple[Rotation, Array]:
    """A Rotation and the angular velocity in the body's frame, which is given there or in the world's frame."""
    turn = as_rotation(rotation)
    if (omega_body is None) == (omega_world is None):
        raise ValueError("give either omega_body or omega_world")
    if omega_world is None:
        return turn, check_array(omega_body, "omega_body", (3,))
    return turn, turn.inv().apply(check_array(omega_world, "omega_world", (3,)))


def product(a: Any, b: Any) -> Any:
    """The product of two quaternions, scalar first, given by their components: numbers or arrays."""
    return (
        a[0] * b[0] - (a[1] * b[1] + a[2] * b[2] + a[3] * b[3]),
        a[0] * b[1] + a[1] * b[0] + (a[2] * b[3] - a[3] * b[2]),
        a[0] * b[2] + a[2] * b[0] + (a[3] * b[1] - a[1] * b[3]),
        a[0] * b[3] + a[3] * b[0] + (a[1] * b[2] - a[2] * b[1]),
    )


quaternion_product = jit(product)  # for kernels
