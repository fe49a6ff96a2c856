"""Gauss collocation of order 4, 6 and 8 for any problem, the stage equations solved to round-off.

With Kᵢ = h bᵢ f(Yᵢ) and μᵢⱼ = aᵢⱼ/bⱼ the method reads Yᵢ = y + Σ μᵢⱼ Kⱼ and ỹ = y + Σ Kⱼ. It conserves linear and quadratic
invariants if μᵢⱼ + μⱼᵢ = 1: J3, C1 and C2, and H in a quadratic potential. The μ used here fulfil this without error
(`gauss_coefficients`). The maps are symmetric, not Poisson.

For a quadratic H, ∇H is affine, so the discrete gradients (Gonzalez's, the averaged vector field) are the midpoint rule, s = 1.

The equations. Newton's method with a fixed matrix D adds ν D⁻¹ R to K, where ν = μ⁻¹, R = h b f(Y) − K and D = ν − h b f'. It
starts with D = ν, which is the fixed point iteration and costs nothing. If an iteration divides the residual by less than 1/WEAK,
D is computed and factored at the present stages, and from then on whenever an iteration divides the residual by less than 2⁸.
The iteration starts from the collocation polynomial of the last step, extrapolated, in the first step of a call from the state
itself. It ends when the residual stagnates: the rest that a tolerance leaves has a direction, and drifts.
So does the rest of a slow fixed point, because a rounded iteration stops on the side it comes from.

In a uniform field the stage equations of a top have one solution for h²|alpha||x| below UNIQUE, and longer steps are refused. In
general no bound is known. A step is also refused if det(1 − h A f') < 0: the determinant is 1 at h = 0, and has passed through 0,
a fold of the equations.

Vectors over the stages hold one stage after the other. Matrices of stages are stored by columns.

Sources: Hairer, Lubich & Wanner, Geometric Numerical Integration, II.1.3, IV.2.1, VIII.5, VIII.6.1; Hairer & Wanner, Solving
Ordinary Differential Equations II, IV.5 (the W-transformation); Antoñana, Makazaga & Murua, Numer. Algorithms 76 (2017) 861 (μ);
Hairer, McLachlan & Razakarivony, BIT 48 (2008) 231 (round-off). Uniqueness: this project.
"""

import math
from functools import cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import stack, store_tuple
from lagrange_bench.integrators.compiling.tape import Tape, Term, Terms
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.gauss_coefficients import matrices
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import BODY, System
from lagrange_bench.integrators.problem.top import LagrangeTop

# below this contraction some 10⁷ steps show no bias of the fixed point
WEAK = 1 / 16
# a residual that no longer falls is round-off if it is this small, relative to its terms
SMALL = 2.0**-45
# iterations; 3 to 40 are needed
LIMIT = 500
# The least h²|alpha||x| over all J and x at which the stage equations have a fold in a uniform field, by stages, rounded down. It
# was minimised under the equations and det = 0 from some hundred random starts. (For s = 1 this gives 4, as a cubic proves.)
UNIQUE = {2: 11.8, 3: 18.6, 4: 27.3}
# largest |h|, in time scales of the top: beyond, differences lose as many digits as h has
LONGEST = 1e6

NOT_CONVERGED, FOLDED = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the stage equations are not solved after {LIMIT} iterations; take a smaller |h|",
    FOLDED: "the stage equations have several solutions, and a wrong one was found; take a smaller |h|",
}


class Places(NamedTuple):
    """Where the constants of a kernel begin."""

    start: int
    step: int
    weights: int  # h b
    nodes: int
    mu: int
    nu: int
    extrapolation: int  # from K to the K of the next step
    numbers: int


def places(stages: int) -> Places:
    """The places for so many stages."""
    sizes = (1, 1, stages, stages, stages**2, stages**2, stages**2)
    return Places(*accumulate(sizes, initial=0))


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
def sizes_of(system: System) -> Program:
    """For each component the length of its vector, then for each the torque of the others: |g||x| for J in e3, |g||q| for L."""

    def sizes(tape: Tape, t: Term, y: Terms, p: Terms) -> list[Term]:
        def length(vector: Terms) -> Term:
            return sum((v * v for v in vector), tape.constant(0.0)).sqrt()

        g = system.slopes(tape, t, y, p)
        vectors = [vector for _, vector in system.space.rotations(g, y)]
        torques = [tape.constant(0.0) for _ in vectors]
        if system.space.affine:
            torques[0] = length(g[3:]) * length(y[3:])
        elif system.space == BODY:
            torques[1] = length(g[:4]) * length(y[:4])
        lengths = [length(vector) for vector in vectors]
        sizes_and_vectors = zip(lengths + torques, vectors + vectors, strict=True)
        return [size for size, vector in sizes_and_vectors for _ in vector]

    return system.record(sizes)


@cache
def kernel(stages: int, system: System) -> Compiled:
    """The step of any system; the last constants are the parameters."""
    S, n, timed = stages, system.size, system.timed
    m, MATRIX_SIZE, SLOPES_SIZE = S * n, (S * n) ** 2, n * n  # `stack` wants constants
    START, STEP, WEIGHTS, NODES, MU, NU, EXTRAPOLATION, NUMBERS = places(S)
    rates, jacobian, sizes = map(machine_code, (system.rhs, system.jacobian, sizes_of(system)))
    numbers, state_at = tuple_loader(system.parameters), tuple_loader(n)

    @jit(inline=True)
    def time(c, counters, node):
        return c[START] + c[STEP] * (counters[loops.CLOCK] + node) if timed else 0.0

    @jit(inline=True)
    def times_stages(c, place, vector, first, product):
        """Put the product of a matrix of stages and a vector over them into `product`."""
        for i in range(S):
            for a in range(n):
                product[n * i + a] = 0.0
                for j in range(S):
                    product[n * i + a] += c[place + S * j + i] * vector[first + n * j + a]

    @jit
    def residual(s, c, counters, K, Y, R, per_size):
        """Put Y = s + μ K and R = h b f(Y) − K into arrays. Returns Σ|R|, each relative to the size of its vector."""
        norm = 0.0
        times_stages(c, MU, K, 0, Y)
        for i in range(S):
            for a in range(n):
                Y[n * i + a] += s[a]
            t = time(c, counters, c[NODES + i])
            store_tuple(R, n * i, rates((t, *state_at(Y, n * i)), numbers(c, NUMBERS)))
            for a in range(n):
                R[n * i + a] = c[WEIGHTS + i] * R[n * i + a] - K[n * i + a]
                norm += abs(R[n * i + a]) * per_size[a]
        return norm

    @jit
    def linearise(c, counters, Y, D, pivots, per_size):
        """Factor D = ν − h b f'(Y), each row over the size of its vector, so that units do not choose the pivots.

        Returns the sign of its determinant.
        """
        slopes = stack(SLOPES_SIZE)
        for i in range(S):
            t = time(c, counters, c[NODES + i])
            store_tuple(slopes, 0, jacobian((t, *state_at(Y, n * i)), numbers(c, NUMBERS)))
            for a in range(n):
                row = m * (n * i + a)
                for k in range(m):
                    D[row + k] = 0.0
                for k in range(n):
                    D[row + n * i + k] = -c[WEIGHTS + i] * slopes[n * k + a]
                for j in range(S):
                    D[row + n * j + a] += c[NU + S * j + i]
                for k in range(m):
                    D[row + k] *= per_size[a]
        factor(m, D, pivots)
        sign = 1.0
        for k in range(m):
            if (D[m * k + k] < 0.0) != (int(pivots[k]) != k):
                sign = -sign
        return sign

    @jit
    def solve(s, c, K, counters):
        """Compute K of the step. Returns the number of iterations, or 0 if there were too many."""
        Y, R, D, r, pivots, per_size = stack(m), stack(m), stack(MATRIX_SIZE), stack(m), stack(m), stack(n)
        lengths_and_torques = sizes((time(c, counters, 0.0), *s), numbers(c, NUMBERS))
        for a in range(n):
            size = lengths_and_torques[a] + abs(c[STEP]) * lengths_and_torques[n + a]
            per_size[a] = 1.0 / size if 0.0 < size < math.inf else 1.0  # a vector without size does not move
        last, sign, is_factored = math.inf, 1.0, False
        for k in range(LIMIT):
            norm = residual(s, c, counters, K, Y, R, per_size)
            if not norm < math.inf:
                break
            if norm == 0.0 or (norm >= last and norm <= SMALL):
                for i in range(m):
                    K[i] += R[i]
                if sign < 0.0:
                    counters[loops.FAILURE] = FOLDED
                return k + 1
            if norm > max((2.0**-8 if is_factored else WEAK) * last, SMALL):
                sign, is_factored = linearise(c, counters, Y, D, pivots, per_size), True
            if is_factored:
                for i in range(m):
                    r[i] = R[i] * per_size[i % n]
                substitute(m, D, pivots, r)
                times_stages(c, NU, r, 0, R)
            for i in range(m):
                K[i] += R[i]
            last = norm
        counters[loops.RESIDUAL] = last
        return 0

    @jit
    def step(s, c, counters):
        K, change = stack(m), stack(n)
        for a in range(n):
            change[a] = 0.0
        times_stages(c, EXTRAPOLATION, counters, loops.MEMORY, K)
        iterations = solve(s, c, K, counters)
        if iterations == 0:
            counters[loops.FAILURE] = NOT_CONVERGED
        counters[loops.ITERATIONS] += iterations
        counters[loops.RHS_EVALS] += S * iterations
        for i in range(S):
            for a in range(n):
                counters[loops.MEMORY + n * i + a] = K[n * i + a]
                change[a] += K[n * i + a]
        for a in range(n):
            change[a] += s[a]
        return state_at(change, 0)

    return step


def check_span(name: str, span: float, h: float, longest: float = LONGEST) -> None:
    """StepError if h is more than `longest` time scales of the motion. span : |h| in time scales."""
    if not span <= longest:
        raise StepError(name, f"|h| is over {longest:g} times the time scale of the top or problem", h=h)


def stepper(name: str, stages: int, problem: Problem, y0: Array, h: float) -> loops.FixedStepper:
    """Collocation in so many Gauss nodes."""
    system, span = problem.system, abs(h) / problem.scales(y0)[2]
    check_span(name, span, h)
    nodes, b, mu, nu, extrapolation = matrices(stages)
    if span > 1:
        extrapolation = 0 * extrapolation
    parts = (h * b, nodes, mu.T.ravel(), nu.T.ravel(), extrapolation.T.ravel(), problem.numbers)
    c = np.concatenate(((problem.start, h), *parts))
    memory = stages * system.size
    step = loops.Kernel(kernel(stages, system), failures=FAILURES, timed=system.timed, memory=memory)
    return loops.FixedStepper(name, h, step, c, size=system.size)


def method(stages: int) -> Method:
    name = f"gauss{2 * stages}"

    def prepare(problem: Problem, y0: Array, h: float) -> loops.FixedStepper:
        """Every step is iterated until it stagnates."""
        if isinstance(problem, LagrangeTop) and not h * h * abs(problem.alpha) * math.hypot(*y0[3:]) <= UNIQUE[stages]:
            reason = f"h²|alpha||x| is over {UNIQUE[stages]}: the stage equations may have several solutions"
            raise StepError(name, reason, h=h)
        return stepper(name, stages, problem, y0, h)

    return Method(
        name=name,
        label=f"Gauss {2 * stages}",
        family="implicit",
        order=2 * stages,
        claims=Claims(symmetric=True, conserves={"J3", "C1", "C2"}, conserves_if_quadratic={"H"}),
        source="Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), II.1.3 and IV.2.1",
        prepare=prepare,
        needs="rhs",
    )


GAUSS4, GAUSS6, GAUSS8 = (method(stages) for stages in (2, 3, 4))
