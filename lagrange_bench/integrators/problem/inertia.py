"""Moments of inertia: principal axes about a fixed point, the axis of symmetry, and differences without cancellation."""

import math
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, warn_caller

ULP = 2.0**-52
DECIMAL, TURNED = 4 * ULP, 64 * ULP  # relative size of rounding in moments, and in a matrix about turned axes
UNREAL = 1e-12  # relative: moments that fail the triangle inequality by more belong to no body


def check_inertia(inertia: Array) -> None:
    """ValueError if the matrix is not symmetric; a warning if no body has such moments."""
    size = float(np.max(np.abs(inertia)))
    if np.max(np.abs(inertia - inertia.T)) > UNREAL * size:
        raise ValueError(f"inertia_com must be a symmetric matrix; got {inertia.tolist()}")
    least, middle, most = np.linalg.eigvalsh(inertia).tolist()
    if least < -UNREAL * size or most > least + middle + UNREAL * size:
        warn_caller(
            f"inertia_com: no body of matter has the moments {[least, middle, most]} about its centre of mass; "
            "they are taken as they are",
            RuntimeWarning,
        )


def principal(inertia_com: Array, mass: float, lever: Array, heavy: bool) -> tuple[Array, Array, int | None]:
    """Principal moments of I_com + mass (|lever|² 1 − lever leverᵀ), their axes as rows, the number of the symmetry axis or None.

    lever : from the fixed point to the centre of mass. Moments that differ by rounding only are made equal.
    """
    diagonal = not np.count_nonzero(inertia_com - np.diag(np.diag(inertia_com)))
    straight = diagonal and np.count_nonzero(lever) <= 1
    slack = (DECIMAL if straight else TURNED) * float(np.max(np.abs(inertia_com)))
    along = lever if np.any(lever) else None
    if along is not None and (pair := _about(inertia_com, along, slack)) is not None:
        C, A = pair
        A += Fraction(mass) * _dot(along, along)
        if straight:
            k, axes = int(np.flatnonzero(lever)[0]), np.eye(3)
        else:
            k, axes = 2, upright(direction_of(along))
        inertia = np.array([float(C) if i == k else float(A) for i in range(3)])
        return _positive(inertia), axes, k
    inertia = inertia_com + mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    check_range(inertia)
    if straight:
        moments, axes = np.diag(inertia).copy(), np.eye(3)
    else:
        moments, columns = np.linalg.eigh(inertia)
        axes = columns.T * np.linalg.det(columns)
    slack = (DECIMAL if straight else TURNED) * float(np.max(np.abs(moments)))
    pairs = [(i, j, k) for i, j, k in ((0, 1, 2), (1, 2, 0), (0, 2, 1)) if abs(moments[i] - moments[j]) <= slack]
    for i, j, _ in pairs:
        moments[j] = moments[i]
    free = not (heavy and np.any(lever))
    return _positive(moments), axes, max((k for *_, k in pairs), default=None) if free else None


def check_range(values: ArrayLike) -> None:
    """ValueError if a product of the numbers of a body is beyond the largest double."""
    if not np.all(np.isfinite(values)):
        raise ValueError("mass, com, inertia_com, gravity: their products leave the range of doubles; take other units")


def _positive(moments: Array) -> Array:
    check_range(moments)
    if np.min(moments) <= 0.0:
        raise ValueError(f"inertia_com: moments about the fixed point must be positive; got {moments.tolist()}")
    return moments


def _about(inertia: Array, along: Array, slack: float) -> tuple[Fraction, Fraction] | None:
    """C = n·I n and A = (tr I − C)/2, exact, n = along/|along|; None if I differs from A 1 + (C − A) n nᵀ by over `slack`."""
    direction = direction_of(along)
    C = direction @ inertia @ direction
    A = (np.trace(inertia) - C) / 2
    if np.max(np.abs(inertia - A * np.eye(3) - (C - A) * np.outer(direction, direction))) > slack:
        return None
    rows = [_dot(row, along) for row in inertia]
    exact = sum((v * Fraction(float(a)) for v, a in zip(rows, along, strict=True)), Fraction(0)) / _dot(along, along)
    return exact, (sum(map(Fraction, np.diag(inertia).tolist()), Fraction(0)) - exact) / 2


def direction_of(v: Array) -> Array:
    """v/|v|. A power of two is taken out first, so that squares do not underflow."""
    v = v / math.ldexp(1.0, math.frexp(np.max(np.abs(v)))[1] - 1)
    return v / np.linalg.norm(v)


def _dot(a: Array, b: Array) -> Fraction:
    return sum((Fraction(v) * Fraction(w) for v, w in zip(a.tolist(), b.tolist(), strict=True)), Fraction(0))


def differences_of_inverses(inertia: Array) -> tuple[int, list[float]]:
    """r and D_i = 1/I_i − 1/I_r = (I_r − I_i)/(I_i I_r), without cancellation; I_r is one of the two nearest moments."""
    I = inertia.tolist()
    unit = math.frexp(max(I))[1]  # so that no product underflows
    near = [math.ldexp(v, -unit) for v in I]
    r = min(
        ((0, 1), (1, 2), (2, 0)), key=lambda pair: abs(near[pair[0]] - near[pair[1]]) / (near[pair[0]] * near[pair[1]])
    )[0]
    return r, [(I[r] - v) / I[r] / v for v in I]


def upright(up: Array) -> Array:
    """A right-handed frame as rows (3, 3), the third being the unit vector `up`; for up = e3 the identity."""
    if up[2] == 1.0:
        return np.eye(3)
    first = np.zeros(3)
    first[(np.argmax(np.abs(up)) + 1) % 3] = 1.0
    first -= (first @ up) * up
    first /= np.linalg.norm(first)
    return np.array((first, np.cross(up, first), up))
