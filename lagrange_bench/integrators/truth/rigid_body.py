"""The motion of any heavy rigid body with a fixed point, to any number of digits. It checks the closed forms and the methods.

It shares nothing with them, assumes no symmetry, and needs only the standard library. Taylor series in integers solve the
equations of the whole body, in the body's frame, with I about the fixed point (`solve` takes any equations of this kind):

    R' = R Ω̂        L' = L × Ω + m X × RᵀG        L = I Ω

The rows r of R obey r' = r × Ω. Numbers are integers, multiples of 2^-b, so only the last of b bits is rounded.
Source for degree and step: Jorba and Zou, Exp. Math. 14 (2005) 99, section 3.
"""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from operator import mul
from typing import Any

Vector = list[Fraction]
Matrix = list[list[Fraction]]
Terms = list[tuple[Any, ...]]  # of a rate: (c, i) stands for c u_i, (c, i, j) for c u_i u_j
GUARD = 64  # bits beyond the digits, since rounding adds up over thousands of steps and errors grow like t or faster


def rigid_motion(
    mass: Any,
    com: Sequence[Any],
    inertia_com: Sequence[Any],
    gravity: Sequence[Any],
    rotation: Sequence[Any],
    omega_body: Sequence[Any],
    times: Sequence[Any],
    digits: int = 30,
) -> Iterator[tuple[Matrix, Vector]]:
    """The rotation matrix (body to world) and the angular velocity in the body, at `times`.

    Parameters
    ----------
    mass, com (3,), inertia_com (3,) or (3, 3), gravity (3,), omega_body (3,), rotation (3, 3) : SI units, as anything that
    Fraction takes exactly: ints, doubles, decimal strings, fractions.
    times : rising from 0; otherwise ValueError before the first row.
    digits : errors are below 10^-digits of the sizes of R and Ω, if the motion magnifies errors by less than 10^10.

    Yields
    ------
    Fractions: R as three rows, and Ω.
    """
    moments = _ascending(times)
    x, G, w = ([Fraction(v) for v in values] for values in (com, gravity, omega_body))
    R = [[Fraction(v) for v in row] for row in rotation]
    inertia = about_fixed_point(Fraction(mass), x, inertia_com)
    bits = math.ceil(digits * math.log2(10)) + GUARD
    # time in units 2^-s, in which the rates are about 1/2; inertia over its largest entry
    size = max(abs(v) for row in inertia for v in row)
    inverse = _inverse([[v / size for v in row] for row in inertia])
    pull = [Fraction(mass) * v / size for v in x]
    fastest = float(sum(v * v for v in w)) + float(max(map(abs, pull)) * sum(map(abs, G)) * max(map(max, inverse)))
    s = math.frexp(2 * math.sqrt(fastest) or 1.0)[1]
    unit = Fraction(2) ** -s
    spins = [sum(a * b for a, b in zip(row, w, strict=True)) * unit / size for row in inertia]
    # u: L, and the rows of R
    L, *rows = (range(first, first + 3) for first in (0, 3, 6, 9))
    rates = [terms for v in (L, *rows) for terms in _cross(v, [list(zip(row, L, strict=True)) for row in inverse])]
    for g, row in zip(G, rows, strict=True):
        pulls = [[(g * unit**2 * v,)] for v in pull]
        for terms, weights in zip(rates, _cross(row, pulls), strict=False):
            terms += [(-c, i) for c, i in weights]
    start = spins + [Fraction(v) for row in R for v in row]
    for turned in solve(rates, start, [time / unit for time in moments], bits):
        omega = [sum(a * b for a, b in zip(row, turned[:3], strict=True)) / unit for row in inverse]
        yield [turned[3:6], turned[6:9], turned[9:]], omega


def _cross(v: Sequence[int], w: list[list[tuple[Any, ...]]]) -> list[Terms]:
    """The terms of v × w, from the places of v and the parts of w, sums of terms (c, *places)."""
    pairs = (1, 2), (2, 0), (0, 1)
    return [
        [(c, v[i], *places) for c, *places in w[j] if c] + [(-c, v[j], *places) for c, *places in w[i] if c]
        for i, j in pairs
    ]


def solve(rates: Sequence[Terms], start: Vector, times: Vector, bits: int) -> Iterator[Vector]:
    """The solution u of u' = Σ c u_i u_j + Σ c u_i at rising times, in multiples of 2^-bits. u and its rates are of size 1."""
    fixed = [[(*_fixed([c], bits), *places) for c, *places in terms] for terms in rates]
    begin, series = 0, _series(fixed, _fixed(start, bits), bits)
    length = _length(series, bits)
    for time in times:
        place = time * 2**bits
        while place > begin + length:
            begin, series = begin + length, _series(fixed, _value(series, length, bits), bits)
            length = _length(series, bits)
        yield [Fraction(v, 2**bits) for v in _value(series, round(place) - begin, bits)]


def _ascending(times: Sequence[Any]) -> Vector:
    try:
        moments = [Fraction(time) for time in times]
    except (ValueError, OverflowError) as error:  # NaN or infinity
        raise ValueError(f"times must be finite numbers: {error}") from None
    for before, time in pairwise((Fraction(0), *moments)):
        if time < before:
            raise ValueError(f"times must ascend from 0; got {float(time):g} after {float(before):g}")
    return moments


def about_fixed_point(mass: Fraction, com: Vector, inertia_com: Sequence[Any]) -> Matrix:
    """The moments of inertia about the fixed point: I + m (|X|² − X Xᵀ)."""
    square = sum(v * v for v in com)
    rows = range(3)
    if not hasattr(inertia_com[0], "__len__") or isinstance(inertia_com[0], str):
        inertia_com = [[inertia_com[i] if i == k else 0 for k in rows] for i in rows]
    return [[Fraction(inertia_com[i][k]) + mass * ((i == k) * square - com[i] * com[k]) for k in rows] for i in rows]


def _fixed(values: Sequence[Fraction], bits: int) -> list[int]:
    return [round(v * 2**bits) for v in values]


def _inverse(a: Matrix) -> Matrix:
    """The inverse of a matrix, by cofactors."""
    cofactors = [
        [a[(i + 1) % 3][(k + 1) % 3] * a[(i + 2) % 3][(k + 2) % 3] - a[(i + 1) % 3][(k + 2) % 3] * a[(i + 2) % 3][(k + 1) % 3]
         for k in range(3)]
        for i in range(3)
    ]  # fmt: skip
    determinant = sum(v * c for v, c in zip(a[0], cofactors[0], strict=True))
    return [[cofactors[k][i] / determinant for k in range(3)] for i in range(3)]


def _series(rates: list[Terms], state: list[int], bits: int) -> list[list[int]]:
    """Taylor coefficients of each u."""
    u = [[v] for v in state]
    pairs = {tuple(places) for terms in rates for _, *places in terms if len(places) == 2}
    for k in range(bits // 3):
        back = [values[::-1] for values in u]
        products: dict[Any, int] = {(i, j): sum(map(mul, u[i], back[j])) >> bits for i, j in pairs}
        products |= {(i,): values[k] for i, values in enumerate(u)}
        totals = [sum(c * products[tuple(places)] for c, *places in terms) for terms in rates]
        for values, total in zip(u, totals, strict=True):
            values.append((total >> bits) // (k + 1))
    return u


def _length(series: list[list[int]], bits: int) -> int:
    """The length of a step for which the last terms are below the last bit."""
    degree = len(series[0]) - 1
    last = max(math.log2(max(abs(a[n]) for a in series) + 1) / n for n in (degree - 1, degree))
    return math.floor(2.0 ** min(8.0, -last) * 2**30) << (bits - 30)


def _value(series: list[list[int]], time: int, bits: int) -> list[int]:
    """The values of the polynomials at a time, by Horner's rule."""
    values = [0] * len(series)
    for n in range(len(series[0]) - 1, -1, -1):
        values = [((v * time) >> bits) + a[n] for v, a in zip(values, series, strict=True)]
    return values
