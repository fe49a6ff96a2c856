"""Tables of λ(h) and m over a box of tori, for a splitting, in which every step starts on another torus.

With C1, C2, alpha and h fixed, the parameter of the exact step is a smooth function of (H, J3). It is interpolated at Chebyshev
nodes, and stored as monomials in u and v: u = (2H − its middle)/(half the width), and v likewise from J3. A table is made only if
it has all digits: relative to the functions, the coefficients of its two highest degrees must vanish up to round-off.

`tables` makes tables; `look_up` gives λ = R + iη and m = mr + i mi at (u, v). Source: this project.
"""

from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.torus.plain_step import parameter

DEGREES = (1, 2, 3, 4, 6, 8, 10, 12)
TAIL = 2.0**-50  # largest relative size of the coefficients of highest degree
GRIDS = (6, 14)  # nodes along each side; the second is tried if the first does not suffice


@cache
def look_up(degree: int, conserves_J3: bool) -> Any:
    """A kernel (c, first, u, v) → the four functions of a table at (u, v) in [−1, 1]².

    The coefficients of u^i v^j fall in i, then in j; those of the four functions stand side by side.
    """

    @jit(inline=True)
    def look(c, first, u, v):
        p = q = r = s = 0.0
        place = first
        for i in range(degree, -1, -1):
            d, e, f, g = c[place], c[place + 1], c[place + 2], c[place + 3]
            place += 4
            if not conserves_J3:
                for _ in range(degree - i):
                    d, e, f, g = d * v + c[place], e * v + c[place + 1], f * v + c[place + 2], g * v + c[place + 3]
                    place += 4
            p, q, r, s = p * u + d, q * u + e, r * u + f, s * u + g
        return p, q, r, s

    return look


def table_size(degree: int, conserves_J3: bool) -> int:
    """How many numbers a table has."""
    return 4 * len(order_of(degree, conserves_J3)[0]) if degree else 0


@cache
def chebyshev(n: int) -> tuple[Array, Array, Array]:
    """Nodes on [−1, 1], the matrix from values at them to Chebyshev coefficients, and the matrix from these to monomials."""
    k = np.arange(n)
    angles = np.pi * (k + 0.5) / n
    to_chebyshev = 2.0 / n * np.cos(np.outer(k, angles))
    to_chebyshev[0] *= 0.5
    to_monomials = np.zeros((n, n))  # column i: T_i
    for i in range(n):
        to_monomials[: i + 1, i] = np.polynomial.chebyshev.cheb2poly(np.eye(n)[i])
    return np.cos(angles), to_chebyshev, to_monomials


LEVEL = np.zeros(1), np.ones((1, 1)), np.ones((1, 1))  # the same for a variable that nothing depends on


@jit
def product(A, B, out):
    """out = A B."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[i, k] * B[k, j]
            out[i, j] = total


@jit
def tabulate(top, box, h, along_u, along_v, coefficients):
    """Put the coefficients (4, n, m) of u^i v^j, for λ and m over the box, into an array. Returns the degree, or 0."""
    (us, u_chebyshev, u_monomials), (vs, v_chebyshev, v_monomials) = along_u, along_v
    n, m = len(us), len(vs)
    values, half = np.empty((4, n, m)), np.empty((n, m))
    for i in range(n):
        for j in range(m):
            h2, j3 = box[0] + us[i] / box[1], box[2] + vs[j] / box[3]
            R, eta, mr, mi, ok = parameter((top[1], 2.0 * top[2], h2), j3, top[0], h)
            if not ok:
                return 0
            values[0, i, j], values[1, i, j], values[2, i, j], values[3, i, j] = R, eta, mr, mi
    tails = np.zeros(n + m)
    for k in range(4):
        product(u_chebyshev, values[k], half)
        product(half, v_chebyshev.T, coefficients[k])
        size = 0.0  # R and η share a size, and so do the parts of m
        for i in range(n):
            for j in range(m):
                size = max(size, abs(values[k, i, j]), abs(values[1 if k < 2 else 2, i, j]))
        for i in range(n):
            for j in range(m):
                tails[i + j] = max(tails[i + j], abs(coefficients[k, i, j]) / size)
    least = 0
    for degree in range(n - 2, 0, -1):  # the two highest degrees show that the series has ended
        if tails[degree + 1] > TAIL:
            break
        least = degree
    for k in range(4):
        for i in range(n):
            for j in range(m):
                if i + j > max(least, 1):
                    coefficients[k, i, j] = 0.0
        product(u_monomials, coefficients[k], half)
        product(half, v_monomials.T, coefficients[k])
    return least


@cache
def order_of(degree: int, conserves_J3: bool) -> tuple[Array, Array]:
    """The powers of u and v, in the order of `look_up`."""
    order = [(i, j) for i in range(degree, -1, -1) for j in range(0 if conserves_J3 else degree - i, -1, -1)]
    rows, columns = np.array(order).T
    return rows, columns


def tables(top: Array, box: Array, times: tuple[float, ...], conserves_J3: bool) -> tuple[int, list[Array]]:
    """The degree, and for each time the coefficients in the order of `look_up`. The degree is 0 if a time has no table.

    top : alpha, C1, C2. box : the middle of 2H, the reciprocal of half its width, and the same for J3.
    conserves_J3 : is J3 constant?
    """
    size = max(*GRIDS, DEGREES[-1] + 1)
    for n in GRIDS:
        coefficients, degree = np.zeros((len(times), 4, size, 1 if conserves_J3 else size)), 0
        for k, h in enumerate(times):
            along = chebyshev(n)
            least = tabulate(top, box, h, along, LEVEL if conserves_J3 else along, coefficients[k, :, :n, :n])
            if least == 0:
                break
            degree = max(degree, least)
        else:
            degree = next(d for d in DEGREES if d >= degree)
            rows, columns = order_of(degree, conserves_J3)
            return degree, [of_time[:, rows, columns].T.ravel() for of_time in coefficients]
    return 0, []
