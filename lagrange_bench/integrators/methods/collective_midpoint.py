"""The collective midpoint rule: the implicit midpoint rule on pairs of quaternions, seen in (J, x).

Quaternions q and p stand for the state x = q k q̄, J = ½ Im(p q̄), with |q|² = |x|. The map (q, p) → (J, x) is Poisson, and the
flow of H comes from q' = ½Jq, p' = ½Jp + 2 alpha kqk. The implicit midpoint rule for these is symplectic. It commutes with the
linear symplectic maps (q, p) → (q e^{kφ}, p e^{kφ}) and (q, p) → (q, p + cq), which lead to all pairs of the same state. So (J̃,
x̃) does not depend on the pair, and (J, x) → (J̃, x̃) is a Poisson map. It conserves J3, C1 and C2, but not H.

No pair need be computed. Let u = (h/4) J̄ with J̄ = ½ Im(P Q̄) at the midpoint (Q, P), n = |u|², and R the Cayley transform of
u. The rule for q gives Q = (1 − u)⁻¹ q, so Q k Q̄ = x̂/(1 + n) with x̂ = Rx, and x̃ = Rx̂. The rule for p gives

    (1 + n) u = (h/4) (J + (h alpha/2) B/(1 + n)),   B = e3×x + x3 u − u3 x − (u·x) e3,
    J̃ = J + h alpha e3×x̂/(1 + n).

The derivative of (left − right) has a positive definite symmetric part if (h²|alpha||x|/8) (1 − t)² (1 + 2√t) < 1, t = n/(1 +
n). The factor with t is at most 1.3254. So for h²|alpha||x| < 6.03 the step is unique; longer steps are refused.

In any field p' = ½Jp + 2gqk with g = ∇U(x). With X = x̂/(1 + n) and g = ∇U(X) the same derivation gives

    (1 + n) u = (h/4) (RJ + (h/2) (g×X − (g·X) u + u×(g×X))),    J̃ = J + h g×X,    x̃ = Rx̂.

No bound for a unique step is known. The determinant of Newton's matrix I − … is positive for h → 0. If it is not at the solution,
a fold of the equations lies between, and the step is refused.

Round-off: both turns are written so that a relative error of 1 + n does not change |x| to first order (as in
`implicit_midpoint`), and u is iterated until it stagnates. C2 stays if u is parallel to J + (h alpha/2) B/(1 + n) with the same
h alpha that kicks J. A constant h² alpha/8 would have another rounding error, and C2 would drift in proportion to time.

Sources: McLachlan, Modin & Verdier, Nonlinearity 27 (2014) 1525 (collective integrators); reduced equations and uniqueness: this
project.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_choice
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.interpreted import interpreted
from lagrange_bench.integrators.compiling.loops import FAILURE, ITERATIONS, RESIDUAL, RHS_EVALS, FixedStepper
from lagrange_bench.integrators.compiling.tape import Tape, with_slopes
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.gauss import SOLVERS, check_span
from lagrange_bench.integrators.methods.lie_group import cross as vector
from lagrange_bench.integrators.methods.lie_group import dot as scalar
from lagrange_bench.integrators.methods.lie_group import turn
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.vectors import cross, dot

QUARTER, KICK = range(2)  # places of the constants: h/4 and h alpha
turned = interpreted(turn)  # takes symbols
UNIQUE = 6.03  # below this h²|alpha||x| the step is unique: 8/max (1 − t)²(1 + 2√t), at √t = (√6 − 1)/5
WEAK = 2.0**-8  # below this contraction the fixed point stagnates within half an ulp of the solution
LIMIT = 500  # iterations; the fixed point takes 4 to 8, Newton 3 to 6
NOT_CONVERGED, FOLDED = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the midpoint equation is not solved after {LIMIT} iterations; take a smaller |h| or solver='newton'",
    FOLDED: "the midpoint equation has several solutions, and a wrong one was found; take a smaller |h|",
}


@jit
def residual(s, c, u1, u2, u3):
    """B, q = 1/(1 + n), and r = q ((h/4) J + q k B) − u with k = (h/4)(h alpha/2): B = e3×x + x3 u − u3 x − (u·x) e3."""
    J1, J2, J3, x1, x2, x3 = s
    q = 1.0 / (1.0 + ((u1 * u1 + u2 * u2) + u3 * u3))
    b1 = (x3 * u1 - u3 * x1) - x2
    b2 = (x3 * u2 - u3 * x2) + x1
    b3 = -((u1 * x1 + u2 * x2) + u3 * x3)
    w, p = 0.5 * c[KICK] * q, c[QUARTER] * q
    r1 = p * (J1 + w * b1) - u1
    r2 = p * (J2 + w * b2) - u2
    r3 = p * (J3 + w * b3) - u3
    return b1, b2, b3, q, r1, r2, r3


@jit
def newton_correction(s, c, u1, u2, u3, b1, b2, b3, q, r1, r2, r3):
    """Solve (I + 2q uuᵀ − q²k S + 2q³k Buᵀ) δ = r, S = x3 − x e3ᵀ − e3 xᵀ, by Cramer's rule."""
    x1, x2, x3 = s[3], s[4], s[5]
    w = q * q * (0.5 * c[QUARTER] * c[KICK])
    v = 2.0 * q * w
    f1, f2, f3 = 2.0 * q * u1 + v * b1, 2.0 * q * u2 + v * b2, 2.0 * q * u3 + v * b3
    a1, a2, a3 = (1.0 - w * x3) + f1 * u1, f2 * u1, f3 * u1 + w * x1
    c1, c2, c3 = f1 * u2, (1.0 - w * x3) + f2 * u2, f3 * u2 + w * x2
    d1, d2, d3 = f1 * u3 + w * x1, f2 * u3 + w * x2, (1.0 + w * x3) + f3 * u3
    a, b, d, r = (a1, a2, a3), (c1, c2, c3), (d1, d2, d3), (r1, r2, r3)
    m = vector(b, d)
    p = 1.0 / scalar(a, m)
    return p * scalar(m, r), p * scalar(vector(d, a), r), p * scalar(vector(a, b), r)


@jit
def step(s, c, counters, newton):
    J1, J2, J3, x1, x2, x3 = s
    h, k = c[QUARTER], 0.5 * c[QUARTER] * c[KICK]
    u1, u2, u3 = h * J1 - k * x2, h * J2 + k * x1, h * J3
    # a change that has stopped falling is round-off only if it is this small
    small = 2.0**-45 * (abs(u1) + abs(u2) + abs(u3) + abs(k) * (abs(x1) + abs(x2) + abs(x3)))
    last = math.inf
    for i in range(LIMIT):
        b1, b2, b3, q, r1, r2, r3 = residual(s, c, u1, u2, u3)
        size = abs(r1) + abs(r2) + abs(r3)
        if size == 0.0 or (size >= last and size <= small):
            counters[ITERATIONS] += i + 1
            counters[RHS_EVALS] += i + 1
            break
        last = size
        if newton:
            r1, r2, r3 = newton_correction(s, c, u1, u2, u3, b1, b2, b3, q, r1, r2, r3)
        u1 += r1
        u2 += r2
        u3 += r3
    else:
        counters[FAILURE] = NOT_CONVERGED
        counters[RESIDUAL] = last
    u = u1, u2, u3
    y = turn(u, q, (x1, x2, x3))
    z = turn(u, q, y)
    kick = q * c[KICK]
    return J1 - kick * y[1], J2 + kick * y[0], J3, z[0], z[1], z[2]


@jit
def fixed_point_step(s, c, counters):
    return step(s, c, counters, False)


@jit
def newton_step(s, c, counters):
    return step(s, c, counters, True)


@cache
def rule_in_field(system: System) -> Program:
    """(u, J, x, h, t, p) → the residual of the equation for u, and the kick h g×X."""
    tape = Tape()
    u, J, x = (tuple(tape.input() for _ in range(3)) for _ in range(3))
    h, t, *p = (tape.input() for _ in range(2 + system.parameters))
    n = 1.0 / (1.0 + dot(u, u))
    X = tuple(n * a for a in turned(u, n, x))
    g = system.force(tape, t, X, p)
    kick = tuple(h * v for v in cross(g, X))
    w = h * dot(g, X)
    pull = (0.5 * (k - w * a + b) for k, a, b in zip(kick, u, cross(u, kick), strict=True))
    r = (0.25 * h) * n
    left = tuple(r * (a + b) - c for a, b, c in zip(turned(u, n, J), pull, u, strict=True))
    return tape.program((*left, *kick))


@cache
def kernel_in_field(system: System) -> Any:
    """The step of |J|²/2 + U(x); constants: the number of the solver, h, t and the parameters."""
    rule, slopes = machine_code(rule_in_field(system)), machine_code(with_slopes(rule_in_field(system), 3))
    numbers, conserves_J3 = tuple_loader(2 + system.parameters), 2 in system.constant

    @jit
    def step(s, c, counters):
        J1, J2, J3, x1, x2, x3 = s
        q, h = numbers(c, 1), 0.25 * c[1]
        u1, u2, u3 = h * J1, h * J2, h * J3
        last, det, newton = math.inf, 1.0, c[0] == 1.0
        for i in range(LIMIT):
            v = (u1, u2, u3, J1, J2, J3, x1, x2, x3)
            r = rule(v, q)
            size, kick = abs(r[0]) + abs(r[1]) + abs(r[2]), (r[3], r[4], r[5])
            if not size < math.inf:
                counters[FAILURE] = NOT_CONVERGED
                return s
            # a change that has stopped falling is round-off only if it is this small
            terms = abs(u1) + abs(u2) + abs(u3) + abs(h) * (abs(r[3]) + abs(r[4]) + abs(r[5]))
            small = 2.0**-45 * terms
            if size == 0.0 or (size >= last and size <= small):
                counters[ITERATIONS] += i + 1
                counters[RHS_EVALS] += i + 1
                break
            newton = newton or (c[0] == 2.0 and size > max(WEAK * last, small))
            last = size
            d1, d2, d3 = r[0], r[1], r[2]
            if newton:
                f = slopes(v, q)
                a, b, e = (-f[6], -f[7], -f[8]), (-f[12], -f[13], -f[14]), (-f[18], -f[19], -f[20])
                p1, p2, p3 = vector(b, e), vector(e, a), vector(a, b)
                det = scalar(a, p1)
                d1, d2, d3 = scalar(p1, r) / det, scalar(p2, r) / det, scalar(p3, r) / det
            u1 += d1
            u2 += d2
            u3 += d3
        else:
            counters[FAILURE] = NOT_CONVERGED
            counters[RESIDUAL] = last
        if det < 0.0:
            counters[FAILURE] = FOLDED
        u = u1, u2, u3
        p = 1.0 / (1.0 + scalar(u, u))
        z = turn(u, p, turn(u, p, (x1, x2, x3)))
        return J1 + kick[0], J2 + kick[1], J3 if conserves_J3 else J3 + kick[2], z[0], z[1], z[2]

    return step


def prepare_in_field(problem: Any, y0: Array, h: float, *, solver: str = "auto") -> FixedStepper:
    """As `prepare`, for any field. "auto" passes to Newton in a step in which the fixed point contracts by less than 256."""
    check_choice(solver, "solver", SOLVERS)
    check_span("collective_midpoint", abs(h) * problem.scales(y0)[0], h)
    c = np.array((SOLVERS.index(solver), h, problem.start, *problem.numbers))
    return FixedStepper("collective_midpoint", h, c, kernel_in_field(problem.system), failures=FAILURES)


def prepare(top: LagrangeTop, y0: Array, h: float, *, solver: str = "auto") -> FixedStepper:
    """Every step is iterated until it stagnates.

    Parameters
    ----------
    solver : "fixed_point"; "newton"; or "auto": the fixed point if it contracts by 256 or more, else Newton.
    """
    check_choice(solver, "solver", SOLVERS)
    span = abs(h) * top.scales(y0)[0]
    check_span("collective_midpoint", span, h)
    if not h * h * abs(top.alpha) * math.hypot(*y0[3:]) <= UNIQUE:
        reason = f"h²|alpha||x| is over {UNIQUE}: the midpoint equation may have several solutions"
        raise StepError("collective_midpoint", reason, h=h)
    # the fixed point contracts like 2n + |k||x|, n about (h|J|/4)²
    fixed = solver == "fixed_point" or (solver == "auto" and span * span / 8 < WEAK)
    c = np.array((0.25 * h, h * top.alpha))
    return FixedStepper("collective_midpoint", h, c, fixed_point_step if fixed else newton_step, failures=FAILURES)


METHOD = Method(
    name="collective_midpoint", label="Collective midpoint", family="implicit", order=2,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
    source="McLachlan, Modin and Verdier, Nonlinearity 27 (2014) 1525",
    prepare=prepare_in_field, needs=kinds.top,
    kernels_for={"uniform": prepare},  # the general kernel costs 3.6 times as much there
)  # fmt: skip
