"""Explicit Runge-Kutta formulas at a fixed step, compiled: RK4, Dormand-Prince 5, DOP853, Verner 9, and Verner 9 projected.

A formula is a tableau of coefficients. The step of any problem is written out from it, without terms for coefficients that
vanish. Products of h and parameters are computed once, before the loop. A component whose derivative vanishes, such as J3, is
conserved. The other invariants drift, and the phase error grows like t².

`verner9_projected` moves the state z after every step to the nearest point with the H, C1 and C2 it was prepared with.
Distances are in units where |x| and |J| + √(|alpha||x|) are of order one. A Newton step goes to z + Gᵀλ with
G Gᵀ λ = g. Here g is the defect of H, |x|²/2 and x·J, and the rows of G are their gradients. A second Newton step follows only
if the first was longer than √TINY.

The gradients depend on each other in a regular precession and for a vertical or hanging top, and only part of g can be
corrected. So the Schur complement of |x|² in G Gᵀ is damped by DAMPING; |x|² itself never vanishes. Then the round-off u of an
invariant moves the state by u/(2√DAMPING) at most, and the rest that is not corrected is no larger than DAMPING.

Sources: the tableaux's; projection: Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), section IV.4; damping:
Levenberg, Q. Appl. Math. 2 (1944) 164.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import FixedStepper, Kernel
from lagrange_bench.integrators.compiling.tape import Tape, Term, Terms
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.tableaux import DOP853, DORMAND_PRINCE, RK4, VERNER9, Row, Tableau
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.units import ldexp, units_in_field
from lagrange_bench.integrators.problem.vectors import dot
from lagrange_bench.integrators.torus.real_map import OFF_TORUS

PROJECTING = "verner9_projected"
DAMPING = 2.0**-46  # of the Schur complement, see above
TINY = 2.0**-50  # after a correction with a smaller square only round-off is left
LIMIT = 10  # Newton steps
NOT_CONVERGED = 1
FAILURES = {NOT_CONVERGED: f"the projection is not done after {LIMIT} Newton steps; take a smaller |h|"}
Weights = tuple[float, ...]


def weigh(weights: Weights, slopes: Sequence[Sequence[Any]]) -> tuple[Any, ...]:
    """Σ w_j k_j of slopes k_j, without terms for weights that vanish."""
    terms = [tuple(w * k for k in slope) for w, slope in zip(weights, slopes, strict=True) if w]
    total = terms[0]
    for term in terms[1:]:
        total = tuple(t + k for t, k in zip(total, term, strict=True))
    return total


def stages(
    system: System, a: Sequence[Weights], tape: Tape, t: Term, y: Terms, h: Term, p: Terms, slopes: Sequence[Terms] = ()
) -> tuple[Terms, ...]:
    """h f(u_i) of all stages on a tape, u_i = y + Σ a_ij h f(u_j) for each row of a. slopes : the first, by default h f(y)."""
    slopes = list(slopes) or [system.rates(tape, t, y, p, h)]
    for row in a:
        u = tuple(v + d for v, d in zip(y, weigh(row, slopes), strict=True))
        slopes.append(system.rates(tape, t + math.fsum(row) * h if system.timed else t, u, p, h))
    return tuple(slopes)


def floats(row: Row) -> Weights:
    return tuple(float(a) for a in row)


@cache
def increment_of(tableau: Tableau, system: System) -> Program:
    """The increment of the components of the state that move."""
    a, b = tuple(map(floats, tableau.a)), floats(tableau.b)

    def increment(tape: Tape, t: Term, y: Terms, h: Term, p: Terms) -> list[Term]:
        total = weigh(b, stages(system, a, tape, t, y, h, p))
        return [total[i] for i in system.moving]

    return system.record_step(increment)


@cache
def adder(size: int, moving: tuple[int, ...]) -> Compiled:
    """(s, d) → the state s with the increment d of its moving components."""

    @unrolled
    def add(s, d):
        return tuple(s[i] + d[moving.index(i)] if i in moving else s[i] for i in range(size))

    return add


START, STEP = range(2)  # places of the constants: the time at the start, h; then the parameters


@cache
def kernel(formula: Program, system: System) -> Compiled:
    """The step of an explicit method for any system. formula : the increment."""
    increment, numbers, timed = machine_code(formula), tuple_loader(1 + system.parameters), system.timed
    add = adder(system.size, system.moving)

    @jit
    def step(s, c, counters):
        t = c[START] + c[STEP] * counters[loops.CLOCK] if timed else 0.0
        return add(s, increment((t, *s), numbers(c, STEP)))

    return step


def constants_of(problem: Problem, h: float) -> Array:
    """The constants of `kernel`."""
    return np.array((problem.start, h, *problem.numbers))


def stepper(name: str, problem: Problem, h: float, formula: Program, calls: int) -> FixedStepper:
    """A stepper of an explicit method. formula : the increment. calls : right-hand sides a step."""
    system = problem.system
    step = Kernel(kernel(formula, system), rhs_per_step=calls, timed=system.timed)
    return FixedStepper(name, h, step, constants_of(problem, h), size=system.size)


# ------------------------------------------------------------------------------------ projection

# places of the constants; the parameters are the last
IN_ENERGY, IN_C1, IN_C2, PER_RATE, PER_LENGTH, RATE, LENGTH, NUMBERS = range(8)


@unrolled
def multipliers(a11, a12, a13, a22, a23, a33, g1, g2, g3):
    """λ of G Gᵀ λ = g, damped."""
    # a22 times the Schur complement of a22, and its right-hand side
    u1, u3, u = a22 * a11 - a12 * a12 + DAMPING, a22 * a33 - a23 * a23 + DAMPING, a22 * a13 - a12 * a23
    b1, b3 = a22 * g1 - a12 * g2, a22 * g3 - a23 * g2
    r, q = 1.0 / (u1 * u3 - u * u), 1.0 / a22
    l1, l3 = (u3 * b1 - u * b3) * r, (u1 * b3 - u * b1) * r
    return l1, (g2 - (a12 * l1 + a23 * l3)) * q, l3


@cache
def projection(system: System) -> tuple[Compiled, Compiled]:
    """(s, c, counters) → the nearest state on the torus, for any |J|²/2 + U(x); and (s, c) → the numbers of the projection.

    These are J, x, the force, and the values of H, |x|²/2 and x·J, in units of order one. The state is in the user's units.
    """
    numbers, add = tuple_loader(system.parameters), adder(6, tuple(range(6)))
    conserves_J3 = 2 in system.constant  # then J3 is not moved

    @unrolled
    def scale(s, p, per_rate, per_length):
        per_energy, position = per_rate * per_rate, (0.0, 0.0, 0.0, 0.0, *s[3:], *p)
        J, x = tuple(v * per_rate for v in s[:3]), tuple(v * per_length for v in s[3:])
        (U,) = system.energy(*position)
        g = tuple(v * (per_energy / per_length) for v in system.gradient(*position)[3:])
        return J, x, g, (0.5 * dot(J, J) + U * per_energy, 0.5 * dot(x, x), dot(x, J))

    @unrolled
    def newton(J, x, g, defects, rate, length):
        """The increment of the state, and its square in units of order one."""

        def inner(v, w):
            plane = v[0] * w[0] + v[1] * w[1]
            return plane if conserves_J3 else plane + v[2] * w[2]

        # G Gᵀ of the gradients (J, g), (0, x), (x, J), without J3 if it is conserved
        a11, a13, a33 = inner(J, J) + dot(g, g), inner(J, x) + dot(g, J), inner(x, x) + dot(J, J)
        l1, l2, l3 = multipliers(a11, dot(g, x), a13, dot(x, x), dot(x, J), a33, *defects)
        rows = [(l1 * a + l3 * b) * rate for a, b in zip(J, x, strict=True)]
        if conserves_J3:
            rows[2] = 0.0
        increment = *rows, *((l1 * a + (l2 * b + l3 * j)) * length for a, b, j in zip(g, x, J, strict=True))
        return increment, dot((l1, l2, l3), defects)

    @jit
    def in_units(s, c):
        return scale(s, numbers(c, NUMBERS), c[PER_RATE], c[PER_LENGTH])

    @jit
    def project(s, c, counters):
        for _ in range(LIMIT):
            J, x, g, (energy, half, product) = in_units(s, c)
            defects = c[IN_ENERGY] - energy, c[IN_C1] - half, c[IN_C2] - product
            increment, square = newton(J, x, g, defects, c[RATE], c[LENGTH])
            s = add(s, increment)
            if square <= TINY:
                break
        else:
            counters[loops.FAILURE] = NOT_CONVERGED
            counters[loops.RESIDUAL] = square
        return s

    return project, in_units


@cache
def projected_kernel(system: System) -> Compiled:
    """The step of Verner 9, then the projection, whose constants follow those of `kernel`."""
    step, (project, _) = kernel(increment_of(VERNER9, system), system), projection(system)
    first = STEP + 1 + system.parameters

    @jit
    def step_and_project(s, c, counters):
        return project(step(s, c, counters), c[first:], counters)

    return step_and_project


def fixed_step_method(name: str, label: str, tableau: Tableau, source: str) -> Method:
    def prepare(problem: Problem, y0: Array, h: float) -> FixedStepper:
        return stepper(name, problem, h, increment_of(tableau, problem.system), tableau.stages)

    return Method(
        name=name,
        label=label,
        family="runge-kutta",
        order=tableau.order,
        claims=Claims(conserves={"J3"}),
        source=source,
        prepare=prepare,
        needs="rhs",
    )


VERNER = "Verner, Numer. Algorithms 53 (2010) 383, most efficient 9(8)"

CLASSICAL = fixed_step_method("rk4", "RK4", RK4, "Kutta, Z. Math. Phys. 46 (1901) 435")
FIFTH = fixed_step_method(
    "rk45_fixed", "RK45, fixed step", DORMAND_PRINCE, "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19"
)
EIGHTH = fixed_step_method(
    "dop853_fixed",
    "DOP853, fixed step",
    DOP853,
    "Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5",
)
NINTH = fixed_step_method("verner9_fixed", "Verner 9, fixed step", VERNER9, VERNER)


def prepare_projected(problem: Problem, y0: Array, h: float) -> FixedStepper:
    """Every step ends on the H, C1 and C2 of y0."""
    units, system = units_in_field(PROJECTING, problem, y0, h), problem.system
    scales = [ldexp(1.0, power) for power in (-units.rate, -units.length, units.rate, units.length)]
    c, in_units = np.array((0.0, 0.0, 0.0, *scales, *problem.numbers)), projection(system)[1]

    def invariants(y: Array) -> Array:
        return np.array(in_units(tuple(y.tolist()), c)[3])

    c[IN_ENERGY : IN_C2 + 1] = invariants(y0)
    constants = np.array((*constants_of(problem, h), *c))
    if not loops.finite(constants):
        raise StepError(PROJECTING, "the top, its state or h is beyond the range of doubles", h=h)

    class ProjectedStepper(FixedStepper):
        def enter(self, y: Array) -> Array:
            if not np.all(np.abs(invariants(y) - c[: IN_C2 + 1]) <= OFF_TORUS):
                raise StepError(PROJECTING, "the state is not on the torus this step was prepared for", h=h)
            return super().enter(y)

    step = Kernel(projected_kernel(system), failures=FAILURES, rhs_per_step=VERNER9.stages)
    return ProjectedStepper(PROJECTING, h, step, constants)


PROJECTED = replace(
    NINTH,
    name=PROJECTING,
    label="Verner 9, projected",
    claims=Claims(conserves={"H", "J3", "C1", "C2"}),
    source=f"{VERNER}; Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), IV.4",
    prepare=prepare_projected,
    needs=kinds.top,
)
