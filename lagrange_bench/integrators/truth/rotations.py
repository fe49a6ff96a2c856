"""Quaternions and rotation matrices of exact numbers and of balls: scalar first, of any length, from body to world."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from flint import arb

from lagrange_bench.integrators.checks import Array

POWERS_OF_I = np.array((1, 1j, -1, -1j))


def conjugate(q: Sequence[Any]) -> list[Any]:
    return [q[0], -q[1], -q[2], -q[3]]


def square(q: Sequence[Any]) -> Any:
    return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]


def matrix(q: Sequence[Any]) -> list[list[Any]]:
    """The rotation of q/|q|, as rows."""
    w, x, y, z = q
    n = square(q)
    return [
        [(w * w + x * x - y * y - z * z) / n, 2 * (x * y - w * z) / n, 2 * (x * z + w * y) / n],
        [2 * (x * y + w * z) / n, (w * w - x * x + y * y - z * z) / n, 2 * (y * z - w * x) / n],
        [2 * (x * z - w * y) / n, 2 * (y * z + w * x) / n, (w * w - x * x - y * y + z * z) / n],
    ]


def quaternion(R: Sequence[Sequence[Any]], root: Callable[[Any], Any] = arb.sqrt) -> list[Any]:
    """One of the two unit quaternions of a matrix: from the row of 4 q qᵀ with the largest diagonal. root : the square root."""
    (a, b, c), (d, e, f), (g, h, i) = R
    rows = [
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ]
    k = max(range(4), key=lambda n: float(rows[n][n]))
    size = 2 * root(rows[k][k])
    return [v / size for v in rows[k]]


def unit_turn(turns: Array) -> Any:
    """cos + i sin of some turns. Quarter turns are taken off first, so that the rounding of the angle is small."""
    quarters = np.rint(4 * turns)
    return np.exp(2j * math.pi * (turns - quarters / 4)) * POWERS_OF_I[quarters.astype(int) % 4]


def turns_about(axis: Sequence[float], turns: Array) -> list[Array]:
    """The quaternions (4, N) of some turns about a unit vector."""
    half = unit_turn(turns / 2)
    return [half.real, *(v * half.imag for v in axis)]
