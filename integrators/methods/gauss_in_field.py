"""Gauss collocation in any field, of any number of stages, and what its kernels share with those of the top alone (`gauss`).

The unknowns are the K of x1, x2, x3 of all stages, J follows from the torque ∇U×x of the stages, and Newton's matrix holds all
of them. C1, C2 and, where the top keeps it, J3 stay; H does in a quadratic potential only. No bound for one solution is known. A
step whose iteration does not end is taken again, by Newton from the state itself, and then refused. So is a solution with
det(1 − h A f') < 0: on the way to it from h = 0 the determinant, 1 there, has passed through 0, a fold of the equations.

Vectors over the stages lie one component after the other: K and X of x1, x2, x3, then L and J of J1, J2, J3. Matrices lie by
columns.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from integrators.checks import check_choice, check_flag
from integrators.compiling.compiled import inlined, jit_as
from integrators.compiling.double_double import two_sum
from integrators.compiling.expression import machine_code, take, with_slopes
from integrators.compiling.loops import FAILURE, ITERATIONS, MEMORY, RESIDUAL, RHS_EVALS, FixedStepper
from integrators.compiling.numba_internals import stack
from integrators.interface import Array, StepError
from integrators.methods.gauss_coefficients import matrices
from integrators.problem.field import Field
from integrators.problem.perturbed import PerturbedTop

# contraction below which the fixed point leaves no bias to be seen in some 10⁷ steps, without and with compensated sums
WEAK = (1 / 10, 1 / 16)
LIMIT = 500  # iterations; the fixed point takes 5 to 40, Newton 3 to 9
LONGEST = 1e6  # of |h|, in time scales of the top

NOT_CONVERGED, FOLDED = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the stage equations are not solved after {LIMIT} iterations; take a smaller |h| or solver='newton'",
    FOLDED: "the stage equations have several solutions, and a wrong one was found; take a smaller |h|",
}

# Constants of a kernel: the solver, compensation, β, μ, ν = 1/μ, extrapolation, numbers.
FIELD_BETA = 2
SOLVERS = ("fixed_point", "newton", "auto")


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
