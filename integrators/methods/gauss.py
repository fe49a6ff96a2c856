"""Gauss collocation of order 4, 6, 8 and 12, the stage equations solved to round-off.

With Kᵢ = h bᵢ f(Yᵢ) the method reads Yᵢ = y + Σ μᵢⱼ Kⱼ and ỹ = y + Σ Kⱼ, where μᵢⱼ = aᵢⱼ/bⱼ; all that linear and quadratic
invariants, here H, J3, C1 and C2, ask of it is μᵢⱼ + μⱼᵢ = 1. In Legendre polynomials at the nodes zᵢ on [−1, 1],

    μᵢⱼ = ½ + ½ Σ_{0<k<s} (L_k(zᵢ) L_{k−1}(zⱼ) − L_{k−1}(zᵢ) L_k(zⱼ)),

exact fractions here, then rounded to multiples of 2⁻⁵², so that the sums of 1 stay exact. Rounded a and b would miss them
in every step the same way, and the invariants would drift in proportion to time. The maps are symmetric, not Poisson.

∇H is affine, so the discrete gradients (Gonzalez's, the averaged vector field, the energy-momentum method of Simo and
Wong) all are the implicit midpoint rule, s = 1 of this family. The tests show it; they need no entry of their own.

Solvers. J of the stages follows from their x, so the unknowns are the K of x1, x2, x3.
fixed_point: K ← h b J×x, with J from the newest x; contracts like ρ(A) |h| (|J| + √(|alpha||x|)). An iteration takes 15 ns for
s = 2, 55 for s = 6.
newton: the K of x3 is eliminated too, which leaves 2s equations of 6s; a factorisation serves as long as each iteration
divides the residual by 2⁸. A step takes 0.3 to 0.6 µs for s = 2, 1.3 to 4 µs for s = 6.
Both start from the collocation polynomial of the last step, extrapolated (in the first step of a call from the state
itself), and go on until the residual stagnates: what a tolerance leaves has a direction, and drifts. So does what the fixed
point leaves where it contracts slowly, since a rounded iteration stops on the side it comes from; there Newton takes over.

For h²|alpha||x| below UNIQUE the stage equations have one solution; beyond, some states have several, and a StepError says so.

In any field the unknowns are the same 3s, J follows from the torque ∇U×x of the stages, and Newton's matrix holds all of
them. C1, C2 and, where the top keeps it, J3 stay; H does in a quadratic potential only. No bound for one solution is known
there. A step whose iteration does not end is taken again, by Newton from the state itself, and then refused. So is a solution
with det(1 − h A f') < 0: on the way to it from h = 0 the determinant, 1 there, has passed through 0, a fold of the equations.

Sources: Hairer, Lubich & Wanner, Geometric Numerical Integration, II.1.3, IV.2.1, VIII.5, VIII.6.1; Hairer & Wanner, Solving
Ordinary Differential Equations II, IV.5 (the W-transformation); Antoñana, Makazaga & Murua, Numer. Algorithms 76 (2017) 861 (μ);
Hairer, McLachlan & Razakarivony, BIT 48 (2008) 231 (round-off). Elimination and uniqueness: this project.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from integrators.checks import check_choice, check_flag
from integrators.compiling.compiled import inlined, jit, jit_as
from integrators.compiling.double_double import two_sum
from integrators.compiling.expression import machine_code, take, with_slopes
from integrators.compiling.loops import FAILURE, ITERATIONS, MEMORY, RESIDUAL, RHS_EVALS, FixedStepper
from integrators.compiling.numba_internals import stack
from integrators.interface import AnyField, Array, Method, StepError
from integrators.problem.field import Field
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.top import LagrangeTop

# h²|alpha||x| at the first fold of the stage equations, over all J and x, rounded down: found by minimising it under the
# equations and det = 0 from some hundred random starts (the same search gives 4 for s = 1, where the cubic proves it)
UNIQUE = {2: 11.8, 3: 18.6, 4: 27.3, 6: 41.7}
RADIUS = {2: 0.2887, 3: 0.2154, 4: 0.1654, 6: 0.1154}  # spectral radius of A
# contraction below which the fixed point leaves no bias to be seen in some 10⁷ steps, without and with compensated sums
WEAK = (1 / 10, 1 / 16)
LIMIT = 500  # iterations; the fixed point takes 5 to 40, Newton 3 to 9
LONGEST = 1e6  # of |h|, in time scales of the top

SMALL, NEWTON, COMPENSATED, BETA = range(4)  # places of the constants; from BETA on: β, αβ, μ, 1/μ, extrapolation
NOT_CONVERGED, FOLDED = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the stage equations are not solved after {LIMIT} iterations; take a smaller |h| or solver='newton'",
    FOLDED: "the stage equations have several solutions, and a wrong one was found; take a smaller |h|",
}


# ------------------------------------------------------------------------------------ coefficients


@cache
def tableau(stages: int) -> tuple[list[Fraction], list[Fraction], list[list[Fraction]]]:
    """Nodes c on [0, 1], weights b and μ, to 35 digits (μ + μᵀ = 1 without error)."""
    z = legendre_zeros(stages)
    L = [legendre(stages, x) for x in z]
    b = [(1 - x * x) / (stages * P[stages - 1]) ** 2 for x, P in zip(z, L, strict=True)]
    mu = [[sum((P[k] * Q[k - 1] - P[k - 1] * Q[k] for k in range(1, stages)), Fraction(1)) / 2 for Q in L] for P in L]
    return [(1 + x) / 2 for x in z], b, mu


def legendre(n: int, x: Fraction) -> list[Fraction]:
    """L₀(x), …, Lₙ(x)."""
    L = [Fraction(1), x]
    for k in range(1, n):
        L.append(((2 * k + 1) * x * L[k] - k * L[k - 1]) / (k + 1))
    return L


def legendre_zeros(n: int) -> list[Fraction]:
    """The zeros of Lₙ, rising, in multiples of 2⁻¹²⁰: Newton's iteration from a double."""
    zeros = []
    for k in range(n):
        x = Fraction(-math.cos(math.pi * (k + 0.75) / (n + 0.5)))
        for _ in range(6):
            L = legendre(n, x)
            x -= L[n] * (1 - x * x) / (n * (L[n - 1] - x * L[n]))
            x = Fraction(round(x * 2**120), 2**120)
        zeros.append(x)
    return [(a - b) / 2 for a, b in zip(zeros, reversed(zeros), strict=True)]


def inverse(A: list[list[Fraction]]) -> list[list[Fraction]]:
    """A⁻¹, by elimination without pivoting."""
    n = len(A)
    M = [[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(A)]
    for k in range(n):
        M[k] = [v / M[k][k] for v in M[k]]
        for i in (i for i in range(n) if i != k):
            M[i] = [u - M[i][k] * v for u, v in zip(M[i], M[k], strict=True)]
    return [row[n:] for row in M]


@cache
def matrices(stages: int) -> tuple[Array, Array, Array, Array]:
    """b, μ, μ⁻¹ and the matrix that extrapolates K from one step to the next, in doubles."""
    c, b, mu = tableau(stages)
    grid = 2**52
    mu = [[Fraction(round(m * grid), grid) for m in row] for row in mu]
    ahead = [[b[i] / b[j] * lagrange(c, j, c[i] + 1) for j in range(stages)] for i in range(stages)]
    return tuple(np.array(values, dtype=float) for values in (b, mu, inverse(mu), ahead))  # type: ignore[return-value]


def lagrange(c: list[Fraction], j: int, t: Fraction) -> Fraction:
    """The polynomial that is 1 at c[j] and 0 at the other c."""
    return math.prod(((t - node) / (c[j] - node) for node in c if node != c[j]), start=Fraction(1))


# ------------------------------------------------------------------------------------ kernels
#
# `n` is a tuple with one place for each stage: its length is part of its type. Vectors over the stages lie one component
# after the other: K and X of x1, x2, x3, then L (of K, for J1 and J2) and J of J1, J2. Matrices lie by columns.


@inlined
def accumulate(S, c, place, K, X):
    """X += M K of three components, the matrix M (S, S) by columns at c[place]."""
    for j in range(S):
        for i in range(S):
            w = c[place + S * j + i]
            X[i] += w * K[j]
            X[S + i] += w * K[S + j]
            X[2 * S + i] += w * K[2 * S + j]


@inlined
def residual(n, s, c, low, K, X, L, J, R):
    """X, L, J and R = h b J×x − K of the stages that K makes; returns Σ|R|."""
    S = len(n)
    G, MU = BETA + S, BETA + 2 * S
    J1, J2, J3, x1, x2, x3 = s
    for i in range(S):
        X[i], X[S + i], X[2 * S + i] = low[2], low[3], low[4]
        J[i], J[S + i] = low[0], low[1]
    accumulate(S, c, MU, K, X)  # small terms first
    for i in range(S):
        X[i] += x1
        X[S + i] += x2
        X[2 * S + i] += x3
        L[i] = -c[G + i] * X[S + i]
        L[S + i] = c[G + i] * X[i]
    for j in range(S):
        for i in range(S):
            m = c[MU + S * j + i]
            J[i] += m * L[j]
            J[S + i] += m * L[S + j]
    for i in range(S):
        J[i] += J1
        J[S + i] += J2
        y1, y2, y3 = c[BETA + i] * X[i], c[BETA + i] * X[S + i], c[BETA + i] * X[2 * S + i]
        R[i] = (J[S + i] * y3 - J3 * y2) - K[i]
        R[S + i] = (J3 * y1 - J[i] * y3) - K[S + i]
        R[2 * S + i] = (J[i] * y2 - J[S + i] * y1) - K[2 * S + i]
    size = 0.0
    for i in range(3 * S):
        size += abs(R[i])
    return size


@inlined
def stagnates(size, last, c):
    """Whether a residual has stopped falling where only round-off is left of it."""
    return size == 0.0 or (size >= last and size <= c[SMALL])


@inlined
def fixed_point(n, s, c, low, K, L, tally):
    """K and L of the step. Returns the number of iterations, 0 if there were too many."""
    X, J, R = stack(18), stack(12), stack(18)
    last = math.inf
    for k in range(LIMIT):
        size = residual(n, s, c, low, K, X, L, J, R)
        for i in range(3 * len(n)):
            K[i] += R[i]
        if stagnates(size, last, c):
            return k + 1
        last = size
    tally[RESIDUAL] = last
    return 0


@jit
def newton(n, s, c, low, K, L, tally):
    """K and L of the step. Returns the number of iterations, 0 if there were too many."""
    X, J, R, A, T, P, pivots = stack(18), stack(12), stack(18), stack(144), stack(72), stack(12), stack(12)
    last = math.inf
    for k in range(LIMIT):
        size = residual(n, s, c, low, K, X, L, J, R)
        done = stagnates(size, last, c)
        if not done:
            if last == math.inf or size > max(2.0**-8 * last, c[SMALL]):
                eliminate(n, s[2], c, X, J, A, T, P)
                factor(2 * len(n), A, pivots)
            correct(n, c, A, T, P, pivots, R)
        for i in range(3 * len(n)):
            K[i] += R[i]  # in the end to h b J×x itself, which is orthogonal to x
        if done:
            return k + 1
        last = size
    tally[RESIDUAL] = last
    return 0


@inlined
def eliminate(n, J3, c, X, J, A, T, P):
    """The matrix A (2s, 2s, by rows) of the linearised equations in δx1, δx2 of the stages.

    They are ν δx − β (J×δx + δJ×x) = r, ν = μ⁻¹, δJ = μ αβ e3×δx. The third gives δx3 = μ r3 − T (δx1, δx2); P = β (J1, J2).
    """
    S = len(n)
    G, MU, NU, m = BETA + S, BETA + 2 * S, BETA + 2 * S + S * S, 2 * S
    for i in range(S):
        P[i], P[S + i] = c[BETA + i] * J[i], c[BETA + i] * J[S + i]
    for i in range(S):
        for j in range(S):
            a1 = a2 = 0.0
            for k in range(S):
                w = c[MU + S * k + i] * c[BETA + k] * c[MU + S * j + k]
                a1 += w * X[k]
                a2 += w * X[S + k]
            w = c[MU + S * j + i]
            T[m * i + j] = c[G + j] * a1 + w * P[S + j]
            T[m * i + S + j] = c[G + j] * a2 - w * P[j]
    for i in range(S):
        spin, z = c[BETA + i] * J3, c[BETA + i] * X[2 * S + i]
        for j in range(S):
            d = c[NU + S * j + i] - z * c[MU + S * j + i] * c[G + j]
            A[m * i + j] = d + P[S + i] * T[m * i + j]
            A[m * i + S + j] = P[S + i] * T[m * i + S + j]
            A[m * (S + i) + j] = -P[i] * T[m * i + j]
            A[m * (S + i) + S + j] = d - P[i] * T[m * i + S + j]
        A[m * i + S + i] += spin
        A[m * (S + i) + i] -= spin


@inlined
def factor(m, A, pivots):
    """A (m, m) = LU with partial pivoting, in its place; the diagonal of U inverted."""
    for k in range(m):
        p = k
        for i in range(k + 1, m):
            if abs(A[m * i + k]) > abs(A[m * p + k]):
                p = i
        pivots[k] = p
        for j in range(m):
            A[m * k + j], A[m * p + j] = A[m * p + j], A[m * k + j]
        A[m * k + k] = 1.0 / A[m * k + k]
        for i in range(k + 1, m):
            A[m * i + k] *= A[m * k + k]
            for j in range(k + 1, m):
                A[m * i + j] -= A[m * i + k] * A[m * k + j]


@inlined
def substitute(m, A, pivots, r):
    """A⁻¹ r in the place of r, of the factors of A."""
    for k in range(m):
        p = int(pivots[k])
        r[k], r[p] = r[p], r[k]
    for k in range(m):
        for j in range(k):
            r[k] -= A[m * k + j] * r[j]
    for k in range(m - 1, -1, -1):
        for j in range(k + 1, m):
            r[k] -= A[m * k + j] * r[j]
        r[k] *= A[m * k + k]


@inlined
def correct(n, c, A, T, P, pivots, R):
    """From the residual R to the correction δK = ν δx, in its place."""
    S = len(n)
    MU, NU, m = BETA + 2 * S, BETA + 2 * S + S * S, 2 * S
    r, t = stack(12), stack(6)
    for i in range(S):
        t[i] = 0.0
        for j in range(S):
            t[i] += c[MU + S * j + i] * R[2 * S + j]
        r[i], r[S + i] = R[i] + P[S + i] * t[i], R[S + i] - P[i] * t[i]
    substitute(m, A, pivots, r)
    for i in range(S):
        for j in range(m):
            t[i] -= T[m * i + j] * r[j]
    for i in range(S):
        R[i] = R[S + i] = R[2 * S + i] = 0.0
        for j in range(S):
            R[i] += c[NU + S * j + i] * r[j]
            R[S + i] += c[NU + S * j + i] * r[S + j]
            R[2 * S + i] += c[NU + S * j + i] * t[j]


@inlined
def step(n, s, c, tally):
    S = len(n)
    AHEAD, LOW = BETA + 2 * S + 2 * S * S, MEMORY + 3 * S
    K, L, low = stack(18), stack(12), stack(5)
    for i in range(3 * S):
        K[i] = 0.0
    accumulate(S, c, AHEAD, tally[MEMORY:], K)
    for i in range(5):
        low[i] = tally[LOW + i]
    iterations = newton(n, s, c, low, K, L, tally) if c[NEWTON] != 0.0 else fixed_point(n, s, c, low, K, L, tally)
    if iterations == 0:
        tally[FAILURE] = NOT_CONVERGED
    tally[ITERATIONS] += iterations
    tally[RHS_EVALS] += S * iterations
    for i in range(3 * S):
        tally[MEMORY + i] = K[i]
    for i in range(S):
        low[0] += L[i]
        low[1] += L[S + i]
        low[2] += K[i]
        low[3] += K[S + i]
        low[4] += K[2 * S + i]
    J1, l1 = two_sum(s[0], low[0])
    J2, l2 = two_sum(s[1], low[1])
    x1, l3 = two_sum(s[3], low[2])
    x2, l4 = two_sum(s[4], low[3])
    x3, l5 = two_sum(s[5], low[4])
    if c[COMPENSATED] != 0.0:
        tally[LOW], tally[LOW + 1], tally[LOW + 2], tally[LOW + 3], tally[LOW + 4] = l1, l2, l3, l4, l5
    return J1, J2, s[2], x1, x2, x3


TWO, THREE, FOUR, SIX = (0,) * 2, (0,) * 3, (0,) * 4, (0,) * 6


@jit
def step4(s, c, tally):
    return step(TWO, s, c, tally)


@jit
def step6(s, c, tally):
    return step(THREE, s, c, tally)


@jit
def step8(s, c, tally):
    return step(FOUR, s, c, tally)


@jit
def step12(s, c, tally):
    return step(SIX, s, c, tally)


KERNELS = {2: step4, 3: step6, 4: step8, 6: step12}


# ------------------------------------------------------------------------------------ kernels for any field
#
# As above, with three components of J and L. Constants: the solver, compensation, β, μ, ν = 1/μ, extrapolation, numbers.

FIELD_BETA = 2
SOLVERS = ("fixed_point", "newton", "auto")


@cache
def kernel_in_field(stages: int, field: Field, level: bool) -> Any:
    """The step in a field; `level`: the field keeps J3."""
    S, m = stages, 3 * stages
    MU, NU, AHEAD, NUMBERS = (FIELD_BETA + S + k * S * S for k in range(4))
    torque, slopes = machine_code(field.torque), machine_code(with_slopes(field.torque, 3))
    numbers, name = take(field.parameters), f"{stages} {field.digest} {level}"

    @jit_as(f"residual {name}", forceinline=True)
    def residual(s, c, low, K, X, L, J, R):
        """X, L, J and R = h b J×x − K of the stages that K makes; returns Σ|R| and the size of the terms in it."""
        q = numbers(c, NUMBERS)
        for i in range(S):
            X[i], X[S + i], X[2 * S + i] = low[3], low[4], low[5]
            J[i], J[S + i], J[2 * S + i] = low[0], low[1], low[2]
        accumulate(S, c, MU, K, X)  # small terms first
        for i in range(S):
            X[i] += s[3]
            X[S + i] += s[4]
            X[2 * S + i] += s[5]
            t, b = torque((X[i], X[S + i], X[2 * S + i]), q), c[FIELD_BETA + i]
            L[i], L[S + i], L[2 * S + i] = b * t[0], b * t[1], 0.0 if level else b * t[2]
        for j in range(S):
            for i in range(S):
                w = c[MU + S * j + i]
                J[i] += w * L[j]
                J[S + i] += w * L[S + j]
                if not level:
                    J[2 * S + i] += w * L[2 * S + j]
        size = terms = 0.0
        for i in range(S):
            J[i] += s[0]
            J[S + i] += s[1]
            J[2 * S + i] += s[2]
            b = c[FIELD_BETA + i]
            y1, y2, y3 = b * X[i], b * X[S + i], b * X[2 * S + i]
            R[i] = (J[S + i] * y3 - J[2 * S + i] * y2) - K[i]
            R[S + i] = (J[2 * S + i] * y1 - J[i] * y3) - K[S + i]
            R[2 * S + i] = (J[i] * y2 - J[S + i] * y1) - K[2 * S + i]
            size += abs(R[i]) + abs(R[S + i]) + abs(R[2 * S + i])
            rate = abs(J[i]) + abs(J[S + i]) + abs(J[2 * S + i]) + abs(L[i]) + abs(L[S + i]) + abs(L[2 * S + i])
            terms += rate * (abs(y1) + abs(y2) + abs(y3))
        return size, terms

    @jit_as(f"linearise {name}")
    def linearise(c, X, J, A, pivots):
        """Factors of the matrix of ν δx − β (J×δx + δJ×x) = r, δJ = μ β T' δx, T' the derivative of the torque.

        Returns the sign of its determinant.
        """
        q, M = numbers(c, NUMBERS), stack(54)
        for j in range(S):
            t, b = slopes((X[j], X[S + j], X[2 * S + j]), q), c[FIELD_BETA + j]
            for k in range(3):
                M[9 * j + 3 * k] = b * t[3 + 3 * k]
                M[9 * j + 3 * k + 1] = b * t[4 + 3 * k]
                M[9 * j + 3 * k + 2] = 0.0 if level else b * t[5 + 3 * k]
        for i in range(S):
            b = c[FIELD_BETA + i]
            y1, y2, y3 = b * X[i], b * X[S + i], b * X[2 * S + i]
            for j in range(S):
                w, v = c[MU + S * j + i], c[NU + S * j + i]
                for k in range(3):
                    t1, t2, t3 = M[9 * j + 3 * k], M[9 * j + 3 * k + 1], M[9 * j + 3 * k + 2]
                    A[m * i + k * S + j] = w * (y2 * t3 - y3 * t2)
                    A[m * (S + i) + k * S + j] = w * (y3 * t1 - y1 * t3)
                    A[m * (2 * S + i) + k * S + j] = w * (y1 * t2 - y2 * t1)
                for k in range(3):
                    A[m * (k * S + i) + k * S + j] += v
            v1, v2, v3 = b * J[i], b * J[S + i], b * J[2 * S + i]
            A[m * i + S + i] += v3
            A[m * i + 2 * S + i] -= v2
            A[m * (S + i) + 2 * S + i] += v1
            A[m * (S + i) + i] -= v3
            A[m * (2 * S + i) + i] += v2
            A[m * (2 * S + i) + S + i] -= v1
        factor(m, A, pivots)
        sign = 1.0
        for k in range(m):
            if (A[m * k + k] < 0.0) != (int(pivots[k]) != k):
                sign = -sign
        return sign

    @jit_as(f"solve {name}")
    def solve(s, c, low, K, L, tally, newton):
        """K and L of the step. Returns the number of iterations, 0 if there were too many."""
        X, J, R, A, r, pivots = stack(18), stack(18), stack(18), stack(324), stack(18), stack(18)
        weak = WEAK[1] if c[1] != 0.0 else WEAK[0]
        last, sign, fresh = math.inf, 1.0, True
        for k in range(LIMIT):
            size, terms = residual(s, c, low, K, X, L, J, R)
            if not size < math.inf:
                break
            small = 2.0**-45 * terms
            done = size == 0.0 or (size >= last and size <= small)
            if not done:
                newton = newton or (c[0] == 2.0 and size > max(weak * last, small))
                if newton:
                    if fresh or size > max(2.0**-8 * last, small):
                        sign = linearise(c, X, J, A, pivots)
                        fresh = False
                    for i in range(m):
                        r[i] = R[i]
                    substitute(m, A, pivots, r)
                    for i in range(S):
                        for a in range(3):
                            R[a * S + i] = 0.0
                            for j in range(S):
                                R[a * S + i] += c[NU + S * j + i] * r[a * S + j]
            for i in range(m):
                K[i] += R[i]
            if done:
                if sign < 0.0:
                    tally[FAILURE] = FOLDED
                return k + 1
            last = size
        tally[RESIDUAL] = last
        return 0

    @jit_as(f"step {name}")
    def step(s, c, tally):
        LOW = MEMORY + m
        K, L, low = stack(18), stack(18), stack(6)
        for i in range(m):
            K[i] = 0.0
        accumulate(S, c, AHEAD, tally[MEMORY:], K)
        for i in range(6):
            low[i] = tally[LOW + i]
        iterations = solve(s, c, low, K, L, tally, c[0] == 1.0)
        if iterations == 0 and c[0] != 0.0:  # once more from the state itself
            for i in range(m):
                K[i] = 0.0
            tally[RESIDUAL] = 0.0
            iterations = solve(s, c, low, K, L, tally, True)
        if iterations == 0:
            tally[FAILURE] = NOT_CONVERGED
        tally[ITERATIONS] += iterations
        tally[RHS_EVALS] += S * iterations
        for i in range(m):
            tally[MEMORY + i] = K[i]
        for i in range(S):
            low[0] += L[i]
            low[1] += L[S + i]
            low[2] += L[2 * S + i]
            low[3] += K[i]
            low[4] += K[S + i]
            low[5] += K[2 * S + i]
        J1, l1 = two_sum(s[0], low[0])
        J2, l2 = two_sum(s[1], low[1])
        J3, l3 = two_sum(s[2], low[2])
        x1, l4 = two_sum(s[3], low[3])
        x2, l5 = two_sum(s[4], low[4])
        x3, l6 = two_sum(s[5], low[5])
        if c[1] != 0.0:
            tally[LOW], tally[LOW + 1], tally[LOW + 2] = l1, l2, l3
            tally[LOW + 3], tally[LOW + 4], tally[LOW + 5] = l4, l5, l6
        return J1, J2, J3, x1, x2, x3

    return step


def stepper_in_field(
    name: str, stages: int, top: PerturbedTop, y0: Array, h: float, solver: str, compensated: bool = False
) -> FixedStepper:
    """Collocation in so many Gauss nodes. Options as those of `method`."""
    check_choice(solver, "solver", SOLVERS)
    check_flag(compensated, "compensated")
    slope = np.linalg.norm(top.jacobian(y0)[:3, 3:], 2)
    span = abs(h) * (math.hypot(*y0[:3]) + math.sqrt(slope * math.hypot(*y0[3:])))
    if not span <= LONGEST:
        raise StepError(name, f"|h| is over {LONGEST:g} times the time scale of the top", h=h)
    b, mu, nu, ahead = matrices(stages)
    parts = (h * b, mu.T.ravel(), nu.T.ravel(), (ahead if span <= 1 else 0 * ahead).T.ravel(), top.numbers)
    c = np.concatenate(((SOLVERS.index(solver), bool(compensated)), *parts))
    kernel = kernel_in_field(stages, top.field, "J3" in top.conserved)
    return FixedStepper(name, h, c, kernel, failures=FAILURES)


# ------------------------------------------------------------------------------------ the methods


def method(stages: int) -> Method:
    name = f"gauss{2 * stages}"

    def prepare(
        top: LagrangeTop, y0: Array, h: float, *, solver: str = "auto", compensated: bool = False
    ) -> FixedStepper:
        """Iterates every step until it stagnates.

        Parameters
        ----------
        solver : "fixed_point"; "newton"; "auto": the fixed point where it contracts by 10 or more (16 if compensated),
            else Newton.
        compensated : carry what the sums of a step round off into the next one.
        """
        check_choice(solver, "solver", SOLVERS)
        check_flag(compensated, "compensated")
        span = abs(h) * top.scales(y0)[0]
        if not span <= LONGEST:
            raise StepError(name, f"|h| is over {LONGEST:g} times the time scale of the top", h=h)
        if not h * h * abs(top.alpha) * math.hypot(*y0[3:]) <= UNIQUE[stages]:
            reason = f"h²|alpha||x| is over {UNIQUE[stages]}: the stage equations may have several solutions"
            raise StepError(name, reason, h=h)
        newton = solver == "newton" or (solver == "auto" and RADIUS[stages] * span > WEAK[bool(compensated)])
        c = constants(stages, top, y0, h, newton, compensated, span <= 1)
        return FixedStepper(name, h, c, KERNELS[stages], failures=FAILURES)

    def prepare_in_field(
        top: PerturbedTop, y0: Array, h: float, *, solver: str = "auto", compensated: bool = False
    ) -> FixedStepper:
        """As `prepare`; "auto" passes to Newton in a step in which the fixed point contracts by less."""
        return stepper_in_field(name, stages, top, y0, h, solver, compensated)

    return Method(
        name=name,
        label=f"Gauss {2 * stages}",
        family="implicit",
        order=2 * stages,
        symmetric=True,
        poisson=False,
        conserves=frozenset({"H", "J3", "C1", "C2"}),
        control="step",
        source="Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), II.1.3 and IV.2.1",
        prepare=prepare,
        in_field=AnyField(prepare_in_field, frozenset({"J3", "C1", "C2"}), if_quadratic=frozenset({"H"})),
    )


def constants(
    stages: int, top: LagrangeTop, y0: Array, h: float, newton: bool, compensated: bool, extrapolate: bool
) -> Array:
    """What a kernel needs, in the order of its places."""
    b, mu, nu, ahead = matrices(stages)
    J, x = math.hypot(*y0[:3]), math.hypot(*y0[3:])
    # a residual that has stopped falling is round-off only if it is this small
    small = 2.0**-45 * stages * (abs(h) * J + abs(h) * abs(h * top.alpha) * x) * x
    ahead = ahead if extrapolate else 0 * ahead
    scalars = np.array((small, newton, compensated), dtype=float)
    return np.concatenate((scalars, h * b, h * top.alpha * b, mu.T.ravel(), nu.T.ravel(), ahead.T.ravel()))


GAUSS4, GAUSS6, GAUSS8, GAUSS12 = (method(stages) for stages in (2, 3, 4, 6))
