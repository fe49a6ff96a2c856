"""Explicit Runge-Kutta formulas at a fixed step, compiled: RK4, Dormand-Prince 5, DOP853, Verner 9, and Verner 9 projected.

A formula is a tableau of coefficients. The step of any problem is written out from it, without terms for coefficients that
vanish. Products of h and parameters are computed once, before the loop. A component whose derivative vanishes, such as J3, is
conserved. The other invariants drift, and the phase error grows like t².

`verner9_projected` moves the state z after every step to the nearest point with the H, C1 and C2 it was prepared with.
Distances are in units where |x| and |J| + √(|alpha||x|) are of order one. A Newton step goes to z + Gᵀλ with
G Gᵀ λ = g. Here g is what H, |x|²/2 and x·J lack, and the rows of G are their gradients. A second Newton step follows
only if the first was longer than √TINY.

The gradients depend on each other in a regular precession and for a vertical or hanging top, and only part of g can be
corrected. So the Schur complement of |x|² in G Gᵀ is damped by DAMPING; |x|² itself never vanishes. Then the round-off u of an
invariant moves the state by u/(2√DAMPING) at most, and the rest that is not corrected is no larger than DAMPING.

Sources: the tableaux's; projection: Hairer, Lubich & Wanner, Geometric Numerical Integration (2006), section IV.4; damping:
Levenberg, Q. Appl. Math. 2 (1944) 164.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import FixedStepper, Kernel, StateUnits
from lagrange_bench.integrators.compiling.tape import Split, Tape
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.tableaux import DOP853, DORMAND_PRINCE, RK4, VERNER9, Row, Tableau
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units, ldexp, units_in_field
from lagrange_bench.integrators.problem.vectors import dot
from lagrange_bench.integrators.torus.real_map import OFF_TORUS

PROJECTING = "verner9_projected"
ALPHA, ENERGY, C1, C2 = range(4)  # places of the constants of the projection
DAMPING = 2.0**-46
TINY = 2.0**-50  # after a correction with a smaller square only round-off is left
LIMIT = 10  # Newton steps
NOT_CONVERGED = 1
FAILURES = {NOT_CONVERGED: f"the projection is not done after {LIMIT} Newton steps; take a smaller |h|"}


def weigh(weights: tuple[float, ...], slopes: Any) -> Any:
    """Σ w_j k_j of slopes k_j, without terms for weights that vanish."""
    terms = [tuple(w * k for k in slope) for w, slope in zip(weights, slopes, strict=True) if w]
    total = terms[0]
    for term in terms[1:]:
        total = tuple(t + k for t, k in zip(total, term, strict=True))
    return total


def stages(
    system: System, rows: tuple[tuple[float, ...], ...], tape: Tape, t: Any, y: Any, h: Any, p: Any, slopes: Any = ()
) -> tuple[Any, ...]:
    """h f(u_i) of all stages on a tape, u_i = y + Σ a_ij h f(u_j) for each row. slopes : those already known, else h f(y)."""
    slopes = list(slopes) or [system.rates(tape, t, y, p, h)]
    for row in rows:
        u = tuple(a + d for a, d in zip(y, weigh(row, slopes), strict=True))
        slopes.append(system.rates(tape, t + math.fsum(row) * h if system.timed else t, u, p, h))
    return tuple(slopes)


def floats(row: Row) -> tuple[float, ...]:
    return tuple(float(a) for a in row)


@cache
def increment_of(tableau: Tableau, system: System) -> Split:
    """What the formula adds to the components of the state that move."""
    a, b = tuple(map(floats, tableau.a)), floats(tableau.b)

    def increment(tape: Tape, t: Any, y: Any, h: Any, p: Any) -> Any:
        total = weigh(b, stages(system, a, tape, t, y, h, p))
        return [total[i] for i in system.moving]

    return system.split(increment)


@cache
def adding(size: int, moving: tuple[int, ...]) -> Any:
    """(s, d) → the state s with the increment d of its moving components."""

    @unrolled
    def added(s, d):
        return tuple(s[i] + d[moving.index(i)] if i in moving else s[i] for i in range(size))

    return added


START, STEP, FIRST = range(3)  # places of the constants: the time at the start, h, and those of the formula


@cache
def stepping(split: Split, system: System) -> Callable[..., Any]:
    """The step of an explicit method for any system, from what it adds to the state."""
    increment, constants, timed = machine_code(split.moving), tuple_loader(len(split.fixed.outputs)), system.timed
    finish = adding(system.size, system.moving)

    @jit
    def step(s, c, counters):
        t = c[START] + c[STEP] * counters[loops.CLOCK] if timed else 0.0
        return finish(s, increment((t,) + s, constants(c, FIRST)))  # noqa: RUF005 - compiled code does not unpack

    return step


def constants_of(split: Split, problem: Any, h: float) -> Array:
    """The `c` of `stepping`."""
    return np.array((problem.start, h, *split.constants(h, *problem.numbers)))


def stepper(name: str, problem: Any, h: float, split: Split, calls: int) -> FixedStepper:
    """A stepper of an explicit method, from what it adds to the state. calls : right-hand sides a step."""
    system = problem.system
    kernel = Kernel(stepping(split, system), rhs_per_step=calls, timed=system.timed)
    return FixedStepper(name, h, kernel, constants_of(split, problem, h), size=system.size)


# ------------------------------------------------------------------------------------ projection


@jit
def products(J1, J2, J3, x1, x2, x3):
    """J1² + J2², J1x1 + J2x2, |x|², x·J."""
    t = J1 * x1 + J2 * x2
    return J1 * J1 + J2 * J2, t, (x1 * x1 + x2 * x2) + x3 * x3, t + J3 * x3


@jit
def lack(c, j, J3, x3, xx, xJ):
    """By how much H, |x|²/2 and x·J fall short."""
    return c[ENERGY] - (0.5 * (j + J3 * J3) + c[ALPHA] * x3), 0.5 * (c[C1] - xx), c[C2] - xJ


@jit(inline=True)
def multipliers(a11, a12, a13, a22, a23, a33, g1, g2, g3):
    """λ of G Gᵀ λ = g, damped."""
    # a22 times the Schur complement of a22, and its right-hand side
    u1, u3, u = a22 * a11 - a12 * a12 + DAMPING, a22 * a33 - a23 * a23 + DAMPING, a22 * a13 - a12 * a23
    b1, b3 = a22 * g1 - a12 * g2, a22 * g3 - a23 * g2
    r, q = 1.0 / (u1 * u3 - u * u), 1.0 / a22
    l1, l3 = (u3 * b1 - u * b3) * r, (u1 * b3 - u * b1) * r
    return l1, (g2 - (a12 * l1 + a23 * l3)) * q, l3


@jit
def projected(s, c, counters):
    J1, J2, J3, x1, x2, x3 = s
    alpha = c[ALPHA]
    for _ in range(LIMIT):
        j, t, a22, a23 = products(J1, J2, J3, x1, x2, x3)
        g1, g2, g3 = lack(c, j, J3, x3, a22, a23)
        # G Gᵀ; gradients by (J1, J2, x1, x2, x3): (J1, J2, 0, 0, alpha), (0, 0, x), (x1, x2, J)
        a11, a33 = j + alpha * alpha, (a22 - x3 * x3) + (j + J3 * J3)
        a12, a13 = alpha * x3, t + alpha * J3
        l1, l2, l3 = multipliers(a11, a12, a13, a22, a23, a33, g1, g2, g3)
        J1, J2, x1, x2, x3 = (
            J1 + (l1 * J1 + l3 * x1),
            J2 + (l1 * J2 + l3 * x2),
            x1 + (l2 * x1 + l3 * J1),
            x2 + (l2 * x2 + l3 * J2),
            x3 + (l1 * alpha + (l2 * x3 + l3 * J3)),
        )
        square = l1 * g1 + l2 * g2 + l3 * g3
        if square <= TINY:
            break
    else:
        counters[loops.FAILURE] = NOT_CONVERGED
        counters[loops.RESIDUAL] = square
    return J1, J2, J3, x1, x2, x3


IN_ENERGY, IN_C1, IN_C2, PER_RATE, PER_LENGTH, NUMBERS = range(6)  # places of the constants of the projection


@cache
def projected_in_field(system: System) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """`projected` for any |J|²/2 + U(x), and (s, c) → (J, x, force, residuals). J3 is left alone where the motion conserves it.

    c : the places above, then t and the parameters. The state is in the user's units, the projection in units of order one.
    """
    numbers, conserves_J3 = tuple_loader(1 + system.parameters), 2 in system.constant
    rest = (0.0, 0.0, 0.0)
    moved = adding(6, tuple(range(6)))

    @unrolled
    def scaled(s, q, per_rate, per_length):
        """J, x, the force, and the values of H, |x|²/2 and x·J, in units of order one."""
        per_energy = per_rate * per_rate
        J, x = tuple(v * per_rate for v in s[:3]), tuple(v * per_length for v in s[3:])
        (U,) = system.energy(q[0], *rest, *s[3:], *q[1:])
        g = tuple(v * (per_energy / per_length) for v in system.gradient(q[0], *rest, *s[3:], *q[1:])[3:])
        return J, x, g, (0.5 * dot(J, J) + U * per_energy, 0.5 * dot(x, x), dot(x, J))

    @unrolled
    def products(J, x, g):
        """G Gᵀ of the gradients (J, g), (0, x), (x, J), without J3 if it is conserved."""

        def moving(v, w):
            plane = v[0] * w[0] + v[1] * w[1]
            return plane if conserves_J3 else plane + v[2] * w[2]

        a11, a13, a33 = moving(J, J) + dot(g, g), moving(J, x) + dot(g, J), moving(x, x) + dot(J, J)
        return a11, dot(g, x), a13, dot(x, x), dot(x, J), a33

    @unrolled
    def correction(J, x, g, l1, l2, l3, per_rate, per_length):
        rows = [(l1 * a + l3 * b) / per_rate for a, b in zip(J, x, strict=True)]
        if conserves_J3:
            rows[2] = 0.0
        return *rows, *((l1 * a + (l2 * b + l3 * j)) / per_length for a, b, j in zip(g, x, J, strict=True))

    @jit
    def lacking(s, c):
        J, x, g, values = scaled(s, numbers(c, NUMBERS), c[PER_RATE], c[PER_LENGTH])
        return J, x, g, (c[IN_ENERGY] - values[0], c[IN_C1] - values[1], c[IN_C2] - values[2])

    @jit
    def finish(s, c, counters):
        for _ in range(LIMIT):
            J, x, g, (g1, g2, g3) = lacking(s, c)
            a11, a12, a13, a22, a23, a33 = products(J, x, g)
            l1, l2, l3 = multipliers(a11, a12, a13, a22, a23, a33, g1, g2, g3)
            s = moved(s, correction(J, x, g, l1, l2, l3, c[PER_RATE], c[PER_LENGTH]))
            square = l1 * g1 + l2 * g2 + l3 * g3
            if square <= TINY:
                break
        else:
            counters[loops.FAILURE] = NOT_CONVERGED
            counters[loops.RESIDUAL] = square
        return s

    return finish, lacking


@cache
def followed_by(tableau: Tableau, system: System, finish: Callable[..., Any]) -> Callable[..., Any]:
    """The step of a formula, then `finish(s, c, counters)`, whose constants follow those of `stepping`."""
    split = increment_of(tableau, system)
    step, first = stepping(split, system), FIRST + len(split.fixed.outputs)

    @jit
    def both(s, c, counters):
        return finish(step(s, c, counters), c[first:], counters)

    return both


def fixed(name: str, label: str, tableau: Tableau, source: str) -> Method:
    def prepare(problem: Any, y0: Array, h: float) -> FixedStepper:
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

CLASSICAL = fixed("rk4", "RK4", RK4, "Kutta, Z. Math. Phys. 46 (1901) 435")
FIFTH = fixed(
    "rk45_fixed", "RK45, fixed step", DORMAND_PRINCE, "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19"
)
EIGHTH = fixed(
    "dop853_fixed",
    "DOP853, fixed step",
    DOP853,
    "Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5",
)
NINTH = fixed("verner9_fixed", "Verner 9, fixed step", VERNER9, VERNER)


def prepare_projected(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Every step ends on the H, C1 and C2 of y0."""
    units, c = Units(top, y0, h), np.zeros(4)
    c[ALPHA] = units.alpha

    def lacking(state: Array) -> tuple[float, ...]:
        j, _, xx, xJ = products(*state)
        return lack(c, j, state[2], state[5], xx, xJ)  # type: ignore[no-any-return]

    energy, half, product = lacking(units.enter(y0))
    c[ENERGY], c[C1], c[C2] = -energy, -2.0 * half, -product
    first = constants_of(increment_of(VERNER9, top.system), LagrangeTop(units.alpha), units.time(h))
    step = followed_by(VERNER9, top.system, projected)
    return _on_torus(h, np.array((*first, *c)), step, lacking, units)


def prepare_projected_in_field(problem: Any, y0: Array, h: float) -> FixedStepper:
    """As `prepare_projected`, for any field."""
    units = units_in_field(PROJECTING, problem, y0, h)
    finish, lacking_in = projected_in_field(problem.system)
    c = np.array((0.0, 0.0, 0.0, ldexp(1.0, -units.rate), ldexp(1.0, -units.length), problem.start, *problem.numbers))

    def lacking(y: Array) -> tuple[float, ...]:
        return lacking_in(tuple(y.tolist()), c)[3]  # type: ignore[no-any-return]

    c[IN_ENERGY : IN_C2 + 1] = [-lack for lack in lacking(y0)]
    first = constants_of(increment_of(VERNER9, problem.system), problem, h)
    step = followed_by(VERNER9, problem.system, finish)
    return _on_torus(h, np.array((*first, *c)), step, lacking, loops.OWN_UNITS)


def _on_torus(
    h: float, c: Array, step: Any, lacking: Callable[[Array], tuple[float, ...]], units: StateUnits
) -> FixedStepper:
    """A stepper that refuses states whose invariants are off by more than round-off."""
    if not loops.finite(c):
        raise StepError(PROJECTING, "the top, its state or h is beyond the range of doubles", h=h)

    class ProjectedStepper(FixedStepper):
        def enter(self, y: Array) -> Array:
            state = super().enter(y)
            if not all(abs(lack) <= OFF_TORUS for lack in lacking(state)):
                raise StepError(PROJECTING, "the state is not on the torus this step was prepared for", h=h)
            return state

    return ProjectedStepper(PROJECTING, h, Kernel(step, failures=FAILURES, rhs_per_step=VERNER9.stages), c, units)


PROJECTED = replace(
    NINTH,
    name=PROJECTING,
    label="Verner 9, projected",
    claims=Claims(conserves={"H", "J3", "C1", "C2"}),
    source=f"{VERNER}; Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), IV.4",
    prepare=prepare_projected_in_field,
    needs=kinds.top,
    kernels_for={"uniform": prepare_projected},  # the general kernel costs 2.2 times as much there
)
