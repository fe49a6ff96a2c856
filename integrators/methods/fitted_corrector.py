"""A corrector fitted to one motion: for long runs in weak fields, at steps from a fifteenth of a nutation on.

The corrector of `backlund_schemes` holds for all frequencies ω of V with |ωh| < 4, and takes nothing of the others. A motion
has the frequencies of its own torus, and no others; at long steps those beyond 4 decide. So here the kicks b_j are fitted to
V along the motion of the top without V. With S_n = Σ V((i + ½)h) over i < n, I_n = ∫V dt/h from 0 to nh, what a corrector is
to take away is S_n − I_n, and it does if

    S_n − I_n + Σ_j b_j (V(nh + jh/3) − V(nh − jh/3))    does not depend on n:

the boundary term of docs/perturbed.md, (1), without the knowledge of any ω. The b_j are those of least squares over `STEPS`
steps. I_n is the trapezoidal rule on a grid of h/6, with its own boundary term taken away to twelve differences.

The frequencies may lie on both sides of a resonance ωh = 2π, not close to it: there b_j grow without bounds. Measurements:
docs/perturbed.md, section 3. Source: this project.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import machine_code, take
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.backlund_schemes import least_squares
from lagrange_bench.integrators.problem.field import Field
from lagrange_bench.integrators.torus.plain_step import invariants, move, parameter

GRID = 6  # points of V in a step: even, for the kicks are in the middle
SKIP = 2  # of these points from one kick of the corrector to the next
KICKS, STEPS = 24, 95
ROWS = STEPS + 1 + KICKS  # a multiple of 8
SPACING = SKIP / GRID  # of the corrector's kicks, in h
DIFFERENCES = 12  # of V, in the boundary term of the trapezoidal rule
MARGIN = SKIP * KICKS  # points of V before the first step, and after the last
RIDGE = 1e-9  # b_j are kept small where V is not known to more digits


@cache
def trapezoidal_ends() -> Array:
    """c_j with Σ_j 2 c_j sin(jw) = 1/(2 tan(w/2)) − 1/w, for the w on a grid of h/GRID."""
    import mpmath

    widest = 8.0 / GRID
    return np.array(least_squares(lambda w: mpmath.cot(w / 2) / 2 - 1 / w, 1.0, DIFFERENCES, widest, GRID / 2))


@jit(inline=True)
def dot(a, b):
    """a·b of ROWS numbers, in eight sums side by side."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for i in range(0, ROWS, 8):
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
        s4 += a[i + 4] * b[i + 4]
        s5 += a[i + 5] * b[i + 5]
        s6 += a[i + 6] * b[i + 6]
        s7 += a[i + 7] * b[i + 7]
    return ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@jit
def solve(A, b):
    """The b of least squares: Σ_j b_j A[j] = A[KICKS], by modified Gram and Schmidt; A is used up."""
    R = np.empty((KICKS, KICKS + 1))
    for j in range(KICKS):
        square = dot(A[j], A[j])
        for k in range(j + 1, KICKS + 1):
            r = R[j, k] = dot(A[j], A[k]) / square
            for i in range(ROWS):
                A[k, i] -= r * A[j, i]
    for j in range(KICKS - 1, -1, -1):
        b[j] = R[j, KICKS]
        for k in range(j + 1, KICKS):
            b[j] -= R[j, k] * b[k]


@jit
def equations(V, ends):
    """The columns of the least squares as rows, without their means and with the ridge, the right-hand side last; their size."""
    A, total = np.zeros((KICKS + 1, ROWS)), 0.0
    for n in range(STEPS + 1):
        at = MARGIN + n * GRID
        A[KICKS, n] = -total
        for j in range(1, DIFFERENCES + 1):
            A[KICKS, n] += ends[j - 1] * (V[at + j] - V[at - j]) / GRID
        mean = 0.5 * (V[at] + V[at + GRID])
        for k in range(1, GRID):
            mean += V[at + k]
        total += V[at + GRID // 2] - mean / GRID
    for j in range(KICKS):
        for n in range(STEPS + 1):
            at = MARGIN + n * GRID
            A[j, n] = V[at + SKIP * (j + 1)] - V[at - SKIP * (j + 1)]
    square = 0.0
    for k in range(KICKS + 1):
        mean = 0.0
        for n in range(STEPS + 1):
            mean += A[k, n]
        mean /= STEPS + 1
        for n in range(STEPS + 1):
            A[k, n] -= mean
        square += dot(A[k], A[k])
    size = math.sqrt(square / KICKS)
    for j in range(KICKS):
        A[j, STEPS + 1 + j] = RIDGE * size
    return A, size


@cache
def fit_over(field: Field) -> Any:
    """(y, numbers, h, ends, b) → b_j of the corrector for steps h along the motion from y; False if that is not possible."""
    potential, numbers = machine_code(field.potential), take(field.parameters)

    @jit
    def run(y, numbers_of, h, ends, b):
        alpha, q, s = numbers_of[0], numbers(numbers_of, 0), (y[0], y[1], y[2], y[3], y[4], y[5])
        R, eta, mr, mi, found = parameter(invariants(s, alpha), s[2], alpha, h / GRID)
        V = np.empty(2 * MARGIN + STEPS * GRID + 1)
        for k in range(len(V)):
            V[k] = potential((s[3], s[4], s[5]), q)[0]
            s = move(s, alpha, (R, eta, mr, mi))
        A, size = equations(V, ends)
        if not (found and 0.0 < size < math.inf):
            return False
        solve(A, b)
        return True

    return at_first_interpreted(run)


def fitted_kicks(field: Field, y0: Array, numbers: Array, h: float) -> Array | None:
    """b_j for h = 1 of the corrector for steps of |h| from y0; None where V does not move, or the step does not reach."""
    b = np.empty(KICKS)
    return b if fit_over(field)(y0, numbers, abs(h), trapezoidal_ends(), b) and np.isfinite(b).all() else None
