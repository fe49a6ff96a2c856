"""Gauss collocation of order 4, 6 and 8 for any problem, the stage equations solved to round-off.

With Kᵢ = h bᵢ f(Yᵢ) and μᵢⱼ = aᵢⱼ/bⱼ the method reads Yᵢ = y + Σ μᵢⱼ Kⱼ and ỹ = y + Σ Kⱼ. It conserves linear and quadratic
invariants if μᵢⱼ + μⱼᵢ = 1: J3, C1 and C2, and H in a quadratic potential. The μ used here fulfil this without error
(`gauss_coefficients`). The maps are symmetric, not Poisson.

For a quadratic H, ∇H is affine, so the discrete gradients (Gonzalez's, the averaged vector field) are the midpoint rule, s = 1.

Unknowns. The rates of some components depend on other components only: a top's J, whose torque is a function of x. Their K
follow from the other stages. The unknowns are the other K, and Newton's matrix holds all of them.

Solvers. The fixed point contracts like ρ(A) |h| (|J| + √(|alpha||x|)) for a top. A factorisation of Newton's matrix serves while
each iteration divides the residual by 2⁸. Both start from the collocation polynomial of the last step, extrapolated; the first
step of a call starts from the state itself. They end when the residual stagnates: what a tolerance leaves has a direction, and
drifts. So does the rest of a slow fixed point, because a rounded iteration stops on the side it comes from; there Newton takes
over.

In a uniform field the stage equations of a top have one solution for h²|alpha||x| below UNIQUE, and longer steps are refused. In
general no bound is known. If an iteration does not end, Newton starts again from the state itself; then the step is refused. It
is also refused if det(1 − h A f') < 0: the determinant is 1 at h = 0, and has passed through 0, a fold of the equations.

Vectors over the stages hold one stage after the other. Matrices of stages are stored by columns.

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
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader, tuple_storer
from lagrange_bench.integrators.compiling.intrinsics import stack
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.gauss_coefficients import matrices
from lagrange_bench.integrators.methods.runge_kutta import two_sums
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.system import System, depends

# Below this contraction, without and with compensated sums, some 10⁷ steps show no bias of the fixed point.
WEAK = (1 / 10, 1 / 16)
LIMIT = 500  # iterations; the fixed point takes 5 to 40, Newton 3 to 9
# The least h²|alpha||x| over all J and x at which the stage equations have a fold in a uniform field, rounded down. It was
# minimised under the equations and det = 0 from some hundred random starts. (For s = 1 this gives 4, as a cubic proves.)
UNIQUE = {2: 11.8, 3: 18.6, 4: 27.3}
LONGEST = 1e6  # largest |h|, in time scales of the top: beyond, differences lose as many digits as h has

NOT_CONVERGED, FOLDED = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the stage equations are not solved after {LIMIT} iterations; take a smaller |h| or solver='newton'",
    FOLDED: "the stage equations have several solutions, and a wrong one was found; take a smaller |h|",
}

# Constants of a kernel: the solver, compensation, time at the start, h; then β, nodes, μ, ν = 1/μ, extrapolation, numbers
SOLVER, COMPENSATED, START, STEP, BETAS = range(5)
SOLVERS = ("fixed_point", "newton", "auto")


@jit(inline=True)
def at_stage(i, S, count, c, place, K, low, places, s, out):
    """Put s + (low + M K) at stage i into `out`, for the components at `places`; M (S, S) lies by columns at c[place]."""
    for a in range(count):
        total = low[places[a]]
        for j in range(S):
            total += c[place + S * j + i] * K[count * j + a]  # small terms first
        out[count * i + a] = total + s[places[a]]


@jit(inline=True)
def factor(m, A, pivots):
    """A (m, m) = LU with partial pivoting, in the place of A; the diagonal of U is inverted."""
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


@jit(inline=True)
def substitute(m, A, pivots, r):
    """Solve with the factors of A: A⁻¹ r in the place of r."""
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
def groups(system: System) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The unknown components, and the eliminated ones, whose rates depend on the unknown ones only."""
    n, moving = system.size, system.moving
    eliminated = tuple(i for i in moving if i < 3) if system.space.affine else ()
    own = Program(system.rhs.inputs, system.rhs.lines, tuple(system.rhs.outputs[i] for i in eliminated))
    if depends(own, [1 + i for i in eliminated]):
        eliminated = ()
    return tuple(i for i in range(n) if i in moving and i not in eliminated), eliminated


@cache
def formulas(system: System) -> tuple[Program, Program, Program, Program]:
    """Programs of (t, y, p): rates of the unknown, rates of the eliminated; derivatives; sizes of the terms in the rates."""
    unknown, eliminated = groups(system)

    def slopes(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        """By rows: unknown by unknown, unknown by eliminated, eliminated by unknown."""
        rates = system.rates(tape, t, y, p)
        columns = {k: tape.along(rates, y, np.eye(len(y))[k].tolist()) for k in (*unknown, *eliminated)}
        blocks = ((unknown, unknown), (unknown, eliminated), (eliminated, unknown))
        return [columns[k][i] for rows, across in blocks for i in rows for k in across]

    def terms(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        """Σ |∂H/∂v| |v| over the vectors v: the round-off of a rate is proportional to it."""
        g = system.slopes(tape, t, y, p)
        total = tape.constant(0.0)
        for turning, vector in system.space.rotations(g, y):
            total = total + ((sum(v * v for v in turning)) * sum(v * v for v in vector)).sqrt()
        return [total]

    def some(places: tuple[int, ...]) -> Program:
        return system.record(lambda *inputs: [system.rates(*inputs)[i] for i in places])

    return some(unknown), some(eliminated), system.record(slopes), system.record(terms)


@cache
def kernel(stages: int, system: System) -> Any:
    """The step of any system; the last constants are the parameters."""
    S, n, (unknown, eliminated) = stages, system.size, groups(system)
    U, E = len(unknown), len(eliminated)
    m, timed = S * U, system.timed
    NODES, MU, NU, AHEAD, NUMBERS = (BETAS + k for k in (S, 2 * S, 2 * S + S * S, 2 * S + 2 * S * S, 2 * S + 3 * S * S))
    rates_u, rates_e, slopes, terms = map(machine_code, formulas(system))
    numbers, whole, keep = tuple_loader(system.parameters), tuple_loader(n), tuple_storer(n)
    keep_u, keep_e, keep_slopes = (tuple_storer(max(count, 1)) for count in (U, E, U * U + 2 * U * E))
    ROW, LOW = U * U + 2 * U * E, loops.MEMORY + m
    K_SIZE, L_SIZE, Y_SIZE, M_SIZE, A_SIZE = (max(count, 1) for count in (m, S * E, S * n, S * ROW, m * m))
    places_u, places_e = np.array(unknown or (0,)), np.array(eliminated or (0,))

    @unrolled
    def place(s, u, e):
        """The state with new unknown and eliminated components."""
        new = dict(zip((*unknown, *eliminated), (*u, *e), strict=True))
        return tuple(new.get(i, s[i]) for i in range(n))

    get_u, get_e = tuple_loader(U), tuple_loader(E)

    @jit
    def residual(s, c, counters, low, K, Y, L, R):
        """Put Y, L and R = h b f(Y) − K of the stages that follow from K into arrays. Returns Σ|R|."""
        q = numbers(c, NUMBERS)
        u, e = stack(K_SIZE), stack(L_SIZE)
        size = 0.0
        for i in range(S):
            at_stage(i, S, U, c, MU, K, low, places_u, s, u)
            for a in range(E):
                e[E * i + a] = s[places_e[a]]
            y = place(s, get_u(u, U * i), get_e(e, E * i))
            t = c[START] + c[STEP] * (counters[loops.CLOCK] + c[NODES + i]) if timed else 0.0
            if E > 0:
                keep_e(L, E * i, rates_e((t,) + y, q))  # noqa: RUF005 - compiled code does not unpack
                for a in range(E):
                    L[E * i + a] *= c[BETAS + i]
        for i in range(S):
            at_stage(i, S, E, c, MU, L, low, places_e, s, e)
            y = place(s, get_u(u, U * i), get_e(e, E * i))
            t = c[START] + c[STEP] * (counters[loops.CLOCK] + c[NODES + i]) if timed else 0.0
            keep(Y, n * i, y)
            keep_u(R, U * i, rates_u((t,) + y, q))  # noqa: RUF005
            for a in range(U):
                R[U * i + a] = c[BETAS + i] * R[U * i + a] - K[U * i + a]
                size += abs(R[U * i + a])
        return size

    @jit
    def linearise(c, counters, Y, A, pivots):
        """Factor the matrix of ν δu − β (f_u δu + f_e δe) = r, δe = μ β g δu. Returns the sign of its determinant."""
        q, M = numbers(c, NUMBERS), stack(M_SIZE)
        for j in range(S):
            t = c[START] + c[STEP] * (counters[loops.CLOCK] + c[NODES + j]) if timed else 0.0
            keep_slopes(M, ROW * j, slopes((t,) + whole(Y, n * j), q))  # noqa: RUF005
        for i in range(S):
            for j in range(S):
                mu, b = c[MU + S * j + i], c[BETAS + j]
                for a in range(U):
                    for k in range(U):
                        total = 0.0
                        for e in range(E):
                            total += M[ROW * i + U * U + E * a + e] * M[ROW * j + U * U + U * E + U * e + k]
                        total *= mu * b
                        if i == j:
                            total += M[ROW * i + U * a + k]
                        A[m * (U * i + a) + U * j + k] = -c[BETAS + i] * total
                    A[m * (U * i + a) + U * j + a] += c[NU + S * j + i]
        factor(m, A, pivots)
        sign = 1.0
        for k in range(m):
            if (A[m * k + k] < 0.0) != (int(pivots[k]) != k):
                sign = -sign
        return sign

    @jit
    def solve(s, c, low, K, L, counters, newton):
        """Compute K and L of the step. Returns the number of iterations, or 0 if there were too many."""
        Y, R, A, r, pivots = stack(Y_SIZE), stack(K_SIZE), stack(A_SIZE), stack(K_SIZE), stack(K_SIZE)
        weak = WEAK[1] if c[COMPENSATED] != 0.0 else WEAK[0]
        t = c[START] + c[STEP] * counters[loops.CLOCK] if timed else 0.0
        small = 2.0**-45 * abs(c[STEP]) * terms((t,) + s, numbers(c, NUMBERS))[0]  # noqa: RUF005
        last, sign, fresh = math.inf, 1.0, True
        for k in range(LIMIT):
            size = residual(s, c, counters, low, K, Y, L, R)
            if not size < math.inf:
                break
            done = size == 0.0 or (size >= last and size <= small)
            if not done:
                newton = newton or (c[SOLVER] == 2.0 and size > max(weak * last, small))
                if newton:
                    if fresh or size > max(2.0**-8 * last, small):
                        sign = linearise(c, counters, Y, A, pivots)
                        fresh = False
                    for i in range(m):
                        r[i] = R[i]
                    substitute(m, A, pivots, r)
                    for i in range(S):
                        for a in range(U):
                            R[U * i + a] = 0.0
                            for j in range(S):
                                R[U * i + a] += c[NU + S * j + i] * r[U * j + a]
            for i in range(m):
                K[i] += R[i]
            if done:
                if sign < 0.0:
                    counters[loops.FAILURE] = FOLDED
                return k + 1
            last = size
        counters[loops.RESIDUAL] = last
        return 0

    @unrolled
    def sums(s, change):
        return tuple(map(tuple, two_sums(s, change)))

    @jit
    def step(s, c, counters):
        K, L, low = stack(K_SIZE), stack(L_SIZE), stack(n)
        for i in range(S):
            for a in range(U):
                K[U * i + a] = 0.0
                for j in range(S):
                    K[U * i + a] += c[AHEAD + S * j + i] * counters[loops.MEMORY + U * j + a]
        for i in range(n):
            low[i] = counters[LOW + i]
        iterations = solve(s, c, low, K, L, counters, c[SOLVER] == 1.0)
        if iterations == 0 and c[SOLVER] != 0.0:  # once more from the state itself
            for i in range(m):
                K[i] = 0.0
            counters[loops.RESIDUAL] = 0.0
            iterations = solve(s, c, low, K, L, counters, True)
        if iterations == 0:
            counters[loops.FAILURE] = NOT_CONVERGED
        counters[loops.ITERATIONS] += iterations
        counters[loops.RHS_EVALS] += S * iterations
        for i in range(m):
            counters[loops.MEMORY + i] = K[i]
        for i in range(S):
            for a in range(U):
                low[places_u[a]] += K[U * i + a]
            for a in range(E):
                low[places_e[a]] += L[E * i + a]
        new, lost = sums(s, whole(low, 0))
        if c[COMPENSATED] != 0.0:
            keep(counters, LOW, lost)
        return new

    return step


def check_span(name: str, span: float, h: float, longest: float = LONGEST) -> None:
    """StepError if h is more than `longest` time scales of the motion. span : |h| in time scales."""
    if not span <= longest:
        raise StepError(name, f"|h| is over {longest:g} times the time scale of the top or problem", h=h)


def stepper(
    name: str, stages: int, problem: Any, y0: Array, h: float, solver: str, compensated: bool = False
) -> loops.FixedStepper:
    """Collocation in so many Gauss nodes; options as those of `method`."""
    check_choice(solver, "solver", SOLVERS)
    check_flag(compensated, "compensated")
    system = problem.system
    if kinds.top(problem):
        slope = float(np.linalg.svd(problem.jacobian(y0)[:3, 3:], compute_uv=False)[0])  # half the time of `norm`
        span = abs(h) * (math.hypot(*y0[:3]) + math.sqrt(slope) * math.sqrt(math.hypot(*y0[3:])))
    else:
        span = abs(h) / problem.scales(y0)[2]
    check_span(name, span, h)
    nodes, b, mu, nu, ahead = matrices(stages)
    parts = (h * b, nodes, mu.T.ravel(), nu.T.ravel(), (ahead if span <= 1 else 0 * ahead).T.ravel(), problem.numbers)
    c = np.concatenate(((SOLVERS.index(solver), bool(compensated), problem.start, h), *parts))
    memory = (stages + 1) * system.size
    step = kernel(stages, system)
    return loops.FixedStepper(name, h, c, step, failures=FAILURES, size=system.size, timed=system.timed, memory=memory)


def method(stages: int) -> Method:
    name = f"gauss{2 * stages}"

    def prepare(
        problem: Any, y0: Array, h: float, *, solver: str = "auto", compensated: bool = False
    ) -> loops.FixedStepper:
        """Every step is iterated until it stagnates.

        Parameters
        ----------
        solver : "fixed_point"; "newton"; "auto": Newton from the step on in which the fixed point contracts by less than 10 (16
            if compensated).
        compensated : True: carry the rounding errors of the sums of a step into the next one.
        """
        if kinds.uniform(problem) and not h * h * abs(problem.alpha) * math.hypot(*y0[3:]) <= UNIQUE[stages]:
            reason = f"h²|alpha||x| is over {UNIQUE[stages]}: the stage equations may have several solutions"
            raise StepError(name, reason, h=h)
        return stepper(name, stages, problem, y0, h, solver, compensated)

    return Method(
        name=name, label=f"Gauss {2 * stages}", family="implicit", order=2 * stages,
        claims=Claims(symmetric=True, conserves={"J3", "C1", "C2"}, conserves_if_quadratic={"H"}),
        source="Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), II.1.3 and IV.2.1",
        prepare=prepare, needs="rhs",
    )  # fmt: skip


GAUSS4, GAUSS6, GAUSS8 = (method(stages) for stages in (2, 3, 4))
