"""Gauss collocation of order 4, 6, 8 and 12, the stage equations solved to round-off.

With Kᵢ = h bᵢ f(Yᵢ) the method reads Yᵢ = y + Σ μᵢⱼ Kⱼ and ỹ = y + Σ Kⱼ, where μᵢⱼ = aᵢⱼ/bⱼ; all that linear and quadratic
invariants, here H, J3, C1 and C2, ask of it is μᵢⱼ + μⱼᵢ = 1. The μ used here do so without error (`gauss_coefficients`). The
maps are symmetric, not Poisson.

∇H is affine, so the discrete gradients (Gonzalez's, the averaged vector field) all are the midpoint rule, s = 1.

Solvers. J of the stages follows from their x, so the unknowns are the K of x1, x2, x3.
fixed_point: K ← h b J×x, with J from the newest x; contracts like ρ(A) |h| (|J| + √(|alpha||x|)).
newton: the K of x3 is eliminated too, which leaves 2s equations of 6s; a factorisation serves as long as each iteration
divides the residual by 2⁸.
Both start from the collocation polynomial of the last step, extrapolated (in the first step of a call from the state
itself), and go on until the residual stagnates: what a tolerance leaves has a direction, and drifts. So does what the fixed
point leaves where it contracts slowly, since a rounded iteration stops on the side it comes from; there Newton takes over.

For h²|alpha||x| below UNIQUE the stage equations have one solution; beyond, some states have several, and a StepError says so.

The step in any field is in `gauss_in_field`.

Sources: Hairer, Lubich & Wanner, Geometric Numerical Integration, II.1.3, IV.2.1, VIII.5, VIII.6.1; Hairer & Wanner, Solving
Ordinary Differential Equations II, IV.5 (the W-transformation); Antoñana, Makazaga & Murua, Numer. Algorithms 76 (2017) 861 (μ);
Hairer, McLachlan & Razakarivony, BIT 48 (2008) 231 (round-off). Elimination and uniqueness: this project.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_choice, check_flag
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import two_sum
from lagrange_bench.integrators.compiling.intrinsics import stack
from lagrange_bench.integrators.compiling.loops import FAILURE, ITERATIONS, MEMORY, RESIDUAL, RHS_EVALS, FixedStepper
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods import gauss_in_field as general
from lagrange_bench.integrators.methods.gauss_coefficients import matrices
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.top import LagrangeTop

# h²|alpha||x| at the first fold of the stage equations, over all J and x, rounded down: found by minimising it under the
# equations and det = 0 from some hundred random starts (the same search gives 4 for s = 1, where the cubic proves it)
UNIQUE = {2: 11.8, 3: 18.6, 4: 27.3, 6: 41.7}
RADIUS = {2: 0.2887, 3: 0.2154, 4: 0.1654, 6: 0.1154}  # spectral radius of A

SMALL, NEWTON, COMPENSATED, BETA = range(4)  # places of the constants; from BETA on: β, αβ, μ, 1/μ, extrapolation


# ------------------------------------------------------------------------------------ kernels
#
# `n` is a tuple with one place for each stage: its length is part of its type. Vectors over the stages lie one component
# after the other: K and X of x1, x2, x3, then L (of K, for J1 and J2) and J of J1, J2. Matrices lie by columns.


@jit(inline=True)
def residual(n, s, c, low, K, X, L, J, R):
    """X, L, J and R = h b J×x − K of the stages that K makes; returns Σ|R|."""
    S = len(n)
    G, MU = BETA + S, BETA + 2 * S
    J1, J2, J3, x1, x2, x3 = s
    for i in range(S):
        X[i], X[S + i], X[2 * S + i] = low[2], low[3], low[4]
        J[i], J[S + i] = low[0], low[1]
    general.accumulate(S, c, MU, K, X)  # small terms first
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


@jit(inline=True)
def solve(n, s, c, low, K, L, counters, by_newton):
    """K and L of the step. Returns the number of iterations, 0 if there were too many."""
    X, J, R, A, T, P, pivots = stack(18), stack(12), stack(18), stack(144), stack(72), stack(12), stack(12)
    last = math.inf
    for k in range(general.LIMIT):
        size = residual(n, s, c, low, K, X, L, J, R)
        # a residual has stopped falling where only round-off is left of it
        done = size == 0.0 or (size >= last and size <= c[SMALL])
        if by_newton and not done:
            if last == math.inf or size > max(2.0**-8 * last, c[SMALL]):
                eliminate(n, s[2], c, X, J, A, T, P)
                general.factor(2 * len(n), A, pivots)
            correct(n, c, A, T, P, pivots, R)
        for i in range(3 * len(n)):
            K[i] += R[i]  # in the end to h b J×x itself, which is orthogonal to x
        if done:
            return k + 1
        last = size
    counters[RESIDUAL] = last
    return 0


@jit
def newton(n, s, c, low, K, L, counters):
    return solve(n, s, c, low, K, L, counters, True)


@jit(inline=True)
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


@jit(inline=True)
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
    general.substitute(m, A, pivots, r)
    for i in range(S):
        for j in range(m):
            t[i] -= T[m * i + j] * r[j]
    for i in range(S):
        R[i] = R[S + i] = R[2 * S + i] = 0.0
        for j in range(S):
            R[i] += c[NU + S * j + i] * r[j]
            R[S + i] += c[NU + S * j + i] * r[S + j]
            R[2 * S + i] += c[NU + S * j + i] * t[j]


@jit(inline=True)
def step(n, s, c, counters):
    S = len(n)
    AHEAD, LOW = BETA + 2 * S + 2 * S * S, MEMORY + 3 * S
    K, L, low = stack(18), stack(12), stack(5)
    for i in range(3 * S):
        K[i] = 0.0
    general.accumulate(S, c, AHEAD, counters[MEMORY:], K)
    for i in range(5):
        low[i] = counters[LOW + i]
    iterations = (
        newton(n, s, c, low, K, L, counters) if c[NEWTON] != 0.0 else solve(n, s, c, low, K, L, counters, False)
    )
    if iterations == 0:
        counters[FAILURE] = general.NOT_CONVERGED
    counters[ITERATIONS] += iterations
    counters[RHS_EVALS] += S * iterations
    for i in range(3 * S):
        counters[MEMORY + i] = K[i]
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
        counters[LOW], counters[LOW + 1], counters[LOW + 2], counters[LOW + 3], counters[LOW + 4] = l1, l2, l3, l4, l5
    return J1, J2, s[2], x1, x2, x3


@cache
def kernel(stages: int) -> Any:
    """`step` of so many stages."""
    n = (0,) * stages

    @jit
    def run(s, c, counters):
        return step(n, s, c, counters)

    return run


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
        check_choice(solver, "solver", general.SOLVERS)
        check_flag(compensated, "compensated")
        span = abs(h) * top.scales(y0)[0]
        general.check_span(name, span, h)
        if not h * h * abs(top.alpha) * math.hypot(*y0[3:]) <= UNIQUE[stages]:
            reason = f"h²|alpha||x| is over {UNIQUE[stages]}: the stage equations may have several solutions"
            raise StepError(name, reason, h=h)
        newton = solver == "newton" or (solver == "auto" and RADIUS[stages] * span > general.WEAK[bool(compensated)])
        c = constants(stages, top, y0, h, newton, compensated, span <= 1)
        return FixedStepper(name, h, c, kernel(stages), failures=general.FAILURES)

    def prepare_in_field(
        top: PerturbedTop, y0: Array, h: float, *, solver: str = "auto", compensated: bool = False
    ) -> FixedStepper:
        """As `prepare`; "auto" passes to Newton in a step in which the fixed point contracts by less."""
        return general.stepper_in_field(name, stages, top, y0, h, solver, compensated)

    return Method(
        name=name, label=f"Gauss {2 * stages}", family="implicit", order=2 * stages,
        claims=Claims(symmetric=True, conserves={"J3", "C1", "C2"}, conserves_if_quadratic={"H"}),
        source="Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), II.1.3 and IV.2.1",
        prepare=prepare_in_field, needs="rhs",
        # with a bound for unique solutions; the general kernel costs 1.3 to 1.7 times as much
        kernels_for={"uniform": prepare},
    )  # fmt: skip


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
