"""What kind of field a potential is with its numbers, and whether a given gradient is its derivative.

Both are found from values at random points, in 50 digits. Formulas that are the same everywhere agree there.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.precision import workdps
from lagrange_bench.integrators.problem.field import Formula

POINTS = 6  # random points at which two formulas that are not the same are told apart
DIGITS = 50
FAR = (1.0, 1 / 16, -1 / 4, 4.0, -4.0, 16.0, -16.0)  # sizes of points where there may be a wall
SAME = 1e-8  # relative difference between a gradient that is given and the one that is derived
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Nature:
    """What a field is, with its numbers."""

    quadratic: bool  # V'' is the same everywhere
    axisymmetric: bool  # V keeps J3


PLAIN = Nature(False, False)


@cache
def _points(sizes: tuple[float, ...] = (1.0,)) -> list[Point]:
    draw = random.Random("points of comparison")
    points = [(draw.uniform(-1, 1), draw.uniform(-1, 1), draw.uniform(-1, 1)) for _ in range(POINTS)]
    return [(r * x1, r * x2, r * x3) for r in sizes for x1, x2, x3 in points]


@lru_cache(maxsize=4096)
def _nature(formula: Formula, parameters: tuple[float, ...]) -> Nature:
    return natures(formula, np.array([parameters]))[0] or _looks(formula, parameters) or PLAIN


def natures(formula: Formula, parameters: Array) -> list[Nature | None]:
    """Those of many rows of parameters (n, k) at once, from doubles; None where it takes more digits to tell.

    What a formula is with random parameters it is with all. So digits are needed only for what parameters of their own do.
    """
    n, k = parameters.shape
    generic, found = _generic(formula, k), np.empty((POINTS, 12, n))
    with np.errstate(all="ignore"):
        for values, point in zip(found, _points(), strict=True):
            for i, value in enumerate(formula.bends(*map(np.float64, point), *parameters.T)):
                values[i] = value
        slope, bend, (x1, x2, _) = found[:, :3], found[:, 3:], np.array(_points()).T[..., None]
        least = 1e-6 * np.max(np.abs(found), axis=(0, 1))
        quadratic = (np.abs(bend - bend[0]) <= least).all(axis=(0, 1))
        axisymmetric = (np.abs(slope[:, 0] * x2 - slope[:, 1] * x1) <= least).all(axis=0)
        finite = np.isfinite(least)
    rough = [Nature(*flags) for flags in np.transpose((quadratic, axisymmetric)).tolist()]
    return [kind if good and kind in (PLAIN, generic) else None for kind, good in zip(rough, finite, strict=True)]


@cache
def _generic(formula: Formula, count: int) -> Nature | None:
    """What the field is with random parameters; None if they do not tell."""
    draw = random.Random("generic parameters")
    return _looks(formula, tuple(draw.uniform(0.1, 1) for _ in range(count)))


def _looks(formula: Formula, parameters: tuple[float, ...]) -> Nature | None:
    """What the field is at random points, in 50 digits; None if it is finite at less than two of them.

    A root of a square is one formula on one side of a plane and another one on the other: then the points are near and far,
    and the field is not quadratic.
    """
    corners = formula.value.corners(3)
    with workdps(DIGITS):
        points = _points(FAR) if corners else _points()
        found = [(x, v) for x, v in _values(formula.bends, parameters, points) if not any(map(_imaginary, v))]
        if len(found) < 2:
            return None
        least = 10.0 ** (10 - DIGITS) * max(abs(v) for _, values in found for v in values)
        first = found[0][1][3:]
        same = all(abs(a - b) <= least for _, values in found for a, b in zip(values[3:], first, strict=True))
        level = all(abs(values[0] * x[1] - values[1] * x[0]) <= least for x, values in found)
        return Nature(quadratic=same and not corners, axisymmetric=level)


def _imaginary(number: Any) -> bool:
    return bool(getattr(number, "imag", 0))


def _values(bends: Program, parameters: tuple[float, ...], points: Sequence[Point]) -> list[tuple[Point, list[Any]]]:
    """∇V and V'' at these points, in mpmath's digits, where they are finite."""
    import mpmath

    found = []
    for point in points:
        try:
            values = bends(*map(mpmath.mpf, point), *map(mpmath.mpf, parameters))
        except (ZeroDivisionError, OverflowError, ValueError):
            continue
        if all(v - v == 0 for v in values):
            found.append((point, list(values)))
    return found


@lru_cache(maxsize=4096)
def _wrong(formula: Formula, parameters: tuple[float, ...]) -> str:
    """Where a given gradient is not the derivative of the value, "" if it is, at random points near and far.

    With these parameters and with random ones: a mistake in a term shows only where its parameter is not 0.
    """
    import mpmath

    assert formula.given is not None
    draw = random.Random("generic parameters")
    with workdps(DIGITS):
        for numbers in (parameters, tuple(draw.uniform(0.1, 1) for _ in parameters)):
            for point in _points(FAR):
                found = []
                for program in (formula.given, formula.derived):
                    found += [values[:3] for _, values in _values(program, numbers, [point])]
                if len(found) < 2 or any(map(_imaginary, (*found[0], *found[1]))):
                    continue
                size = max(map(abs, (*found[0], *found[1])))
                if any(mpmath.mpf(abs(a - b)) > SAME * size for a, b in zip(*found, strict=True)):
                    return f"x = {point}" + (f", parameters {numbers}" if numbers else "")
    return ""
