"""Vectors, rotations and axes of many rows at once."""

import itertools
import math

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import RigidBody

Array = np.ndarray
# rows that are so many times larger than the median do not count in a fit
FAR = 10.0
# how near to a signed permutation a matrix is taken for it
NEAR = 0.02
ONE = np.eye(3)
# all signed permutations of three axes (48, 3, 3)
SIGNED = np.array(
    [
        ONE[list(p)] * np.array(s)[:, None]
        for p in itertools.permutations(range(3))
        for s in itertools.product((1, -1), repeat=3)
    ]
)
PROPER = SIGNED[np.linalg.det(SIGNED) > 0]


def size(vectors: Array) -> float:
    """The median length of vectors or matrices (N, …); NaN of none."""
    return float(np.median(np.linalg.norm(vectors.reshape(len(vectors), -1), axis=1))) if len(vectors) else math.nan


def common(vectors: Array) -> Array:
    """A mask of the vectors (N, …) that are not far larger than most."""
    length = np.linalg.norm(vectors.reshape(len(vectors), -1), axis=1)
    return length <= FAR * np.median(length)


def rotvec(R: Array) -> Array:
    """The rotation vectors (N, 3) of matrices (N, 3, 3); NaN of a matrix that holds one."""
    known = np.isfinite(R).all((1, 2))
    vectors = np.full((len(R), 3), np.nan)
    if known.any():
        vectors[known] = Rotation.from_matrix(R[known]).as_rotvec()
    return vectors


def steps(R: Array) -> Array:
    """The rotation vectors from each attitude to the next, in the body, (N − 1, 3); NaN beside a row with a NaN."""
    return rotvec(R[:-1].transpose(0, 2, 1) @ R[1:])


def tensor(body: RigidBody) -> Array:
    """The moments of inertia (3, 3) in the body: about the fixed point, of a flying body about the centre of mass."""
    return body.momentum_of(ONE, ONE)


def to_world(R: Array, v: Array) -> Array:
    """Vectors of the body (N, 3) in the world, by attitudes (N, 3, 3)."""
    return np.asarray((R @ v[..., None])[..., 0])


def to_body(R: Array, v: Array) -> Array:
    """Vectors of the world (N, 3) in the body, by attitudes (N, 3, 3)."""
    return np.asarray((v[:, None, :] @ R)[:, 0])


def nearest_rotation(H: Array) -> tuple[Array, float]:
    """The rotation Q with the largest tr(QᵀH) (Kabsch), and how well H tells it: 0 if a turn about an axis is free."""
    U, S, V = np.linalg.svd(H)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V, float(S[1] / S[0]) if S[0] else 0.0


def nearest_axes(H: Array) -> tuple[Array, Array]:
    """The signed permutations with the largest and the second largest tr(PᵀH)."""
    trace = np.einsum("pij,ij->p", SIGNED, H)
    last, best = np.argsort(trace)[-2:]
    return SIGNED[best], SIGNED[last]


def is_axes(M: Array, tolerance: float = NEAR) -> bool:
    """Whether a matrix is near to a signed permutation."""
    return bool(np.abs(M - M.round()).max() < tolerance and np.allclose(M.round() @ M.round().T, ONE))
