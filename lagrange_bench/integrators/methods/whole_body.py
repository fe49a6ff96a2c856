"""Methods of multibody dynamics for a `RigidBody`: states (q, L), with L in the frame of the body's principal axes.

    rattle            symplectic: half a kick, the discrete Moser–Veselov step of the free body, half a kick
    simo_wong         a Cayley midpoint of Simo and Wong's kind: turns by the mean angular velocity; the torque of the mean
                      position keeps the energy
    lie_midpoint      turns by the mean angular velocity, by the exponential; the torque is that of the midpoint
    generalized_alpha Newmark's formulas with weights α on the Lie group, which damp numerically

One step is R̃ = R F. With the quaternion f of F, the moments of inertia I, and the vector Θ of a rotation:

    rattle       2 (f0 I f + f × I f) = h L½,            L̃½ = L½ − (4/h) f × I f
    simo_wong    I Θ = h (L + L̃)/2,   L̃ = Fᵀ L + h Γ̃ × (w + Fᵀ w)/2,           F = (1 − Θ̂/2)⁻¹ (1 + Θ̂/2)
    lie_midpoint I Θ = h (L + L̃)/2,   L̃ = exp(−Θ̂/2) (exp(−Θ̂/2) L + h τ̄),   F = exp(Θ̂)

In the world the torque of simo_wong belongs to the mean of both positions. This torque times the turn is the loss of potential
energy, and the torque is horizontal. So the energy and the momentum about the vertical are conserved. (w + Fᵀ w)/2 is
(1 + Θ̂/2)⁻¹ w.

The equations are solved by Newton's method to round-off. Its matrix lacks the derivative of the torque, which is of order h².

Sources: McLachlan & Zanna, Found. Comput. Math. 5 (2005) 87 (Moser–Veselov in quaternions); Simo & Wong, Int. J. Numer.
Methods Eng. 31 (1991) 19 (not seen: the formulas are ours); Brüls, Cardona & Arnold, Mech. Mach. Theory 48 (2012)
121 (generalized-α).
"""

import math
from functools import cache

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import store_tuple
from lagrange_bench.integrators.compiling.loops import FAILURE, ITERATIONS, MEMORY, RESIDUAL, FixedStepper, Kernel
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.methods import lie_group
from lagrange_bench.integrators.methods.lie_group import add, cross, dot, times
from lagrange_bench.integrators.problem.rigid_body import RigidBody

STEP, INERTIA, WEIGHT, UP = 0, 1, 4, 7  # places of the constants
# Iterations: short steps take 3 to 6. In long steps, without the derivative of the torque, each halves the error.
LIMIT = 50
SMALL = 2.0**-40  # a correction that has stopped falling is round-off only if it is relatively smaller
NOT_CONVERGED = lie_group.TURNED + 1
UNSOLVED = f"the equations of the step are not solved after {LIMIT} iterations; take a smaller |h|"
FAILURES = {**lie_group.FAILURES, NOT_CONVERGED: UNSOLVED}
ZERO = (0.0, 0.0, 0.0)
vector, turn_from_right = tuple_loader(3), lie_group.turn_body(True)


@jit
def multiply(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@jit
def divide(a, b):
    return a[0] / b[0], a[1] / b[1], a[2] / b[2]


@jit
def vertical(s, c):
    """Γ, the vertical in the body."""
    q, up = s[1:4], vector(c, UP)
    product = cross(up, q)  # R^T u = u + 2 q0 u × q + 2 (u × q) × q
    return add(add(up, 2.0 * s[0], product), 2.0, cross(product, q))


@jit
def torque(s, c):
    return cross(vertical(s, c), vector(c, WEIGHT))


@jit
def compose(s, f0, f):
    """The quaternion q f, with the length of q. f is a unit quaternion but for round-off."""
    q0, q = s[0], s[1:4]
    n0, n = q0 * f0 - dot(q, f), add(add(times(f0, q), q0, f), 1.0, cross(q, f))
    return lie_group.of_length(q0 * q0 + dot(q, q), n0, n)


@jit
def rotate(s, a, counters):
    """The state with its body turned by exp(â)."""
    return turn_from_right(times(-1.0, a) + ZERO, s, counters)


@jit
def rows(I, scale, f, m):
    """The matrix scale·I + f̂ I − m̂."""
    return (
        (scale * I[0], m[2] - f[2] * I[1], f[1] * I[2] - m[1]),
        (f[2] * I[0] - m[2], scale * I[1], m[0] - f[0] * I[2]),
        (m[1] - f[1] * I[0], f[0] * I[1] - m[0], scale * I[2]),
    )


@cache
def newton(residual: Compiled) -> Compiled:
    """(x, a, c, counters) → the root of `residual` near x, to round-off. `residual` returns a vector and the rows of a matrix."""

    @jit
    def solve(x, a, c, counters):
        last = math.inf
        for i in range(LIMIT):
            g, (r0, r1, r2) = residual(x, a, c, counters)
            p = cross(r1, r2)
            d = add(add(times(g[0], p), g[1], cross(r2, r0)), g[2], cross(r0, r1))
            x = add(x, -1.0 / dot(r0, p), d)
            size = math.sqrt(dot(d, d)) / abs(dot(r0, p))
            if size == 0.0 or (size >= last and size * size <= SMALL * SMALL * (dot(x, x) + 1e-300)):
                counters[ITERATIONS] += i + 1
                return x
            last = size
        counters[FAILURE], counters[RESIDUAL] = NOT_CONVERGED, last
        return x

    return solve


@jit
def free_residual(f, a, c, counters):
    """2 (f0 I f + f × I f) − a with a = h L½, and its derivative."""
    I = vector(c, INERTIA)
    m, f0 = multiply(I, f), math.sqrt(max(1.0 - dot(f, f), 1e-30))
    g = add(times(2.0, add(times(f0, m), 1.0, cross(f, m))), -1.0, a)
    r0, r1, r2 = rows(I, f0, f, m)
    w = -1.0 / f0
    r0, r1, r2 = add(r0, w * m[0], f), add(r1, w * m[1], f), add(r2, w * m[2], f)
    return g, (times(2.0, r0), times(2.0, r1), times(2.0, r2))


@jit
def rattle(s, c, counters):
    h, I = c[STEP], vector(c, INERTIA)
    L = add(s[4:], 0.5 * h, torque(s, c))
    guess = divide(times(0.5 * h, L), I)
    guess = times(1.0 / math.sqrt(1.0 + dot(guess, guess)), guess)
    f = free(guess, times(h, L), c, counters)
    square = dot(f, f)
    if not square < 1.0:
        counters[FAILURE] = NOT_CONVERGED
        return s
    q = compose(s, math.sqrt(1.0 - square), f)
    L = add(L, -4.0 / h, cross(f, multiply(I, f)))
    L = add(L, 0.5 * h, torque(q, c))
    return q[:4] + L


@jit
def middle(turn, g):
    """(1 + Θ̂/2)⁻¹ g."""
    v = times(0.5, turn)
    return times(1.0 / (1.0 + dot(v, v)), add(add(g, -1.0, cross(v, g)), dot(v, g), v))


@jit
def mean_push(turn, up, w):
    """Γ̃ × (1 + Θ̂/2)⁻¹ w, plus Θ/2 × this."""
    image = add(times(2.0, middle(turn, up)), -1.0, up)
    push = cross(image, middle(turn, w))
    return add(push, 0.5, cross(turn, push))


@jit
def cayley_residual(turn, a, c, counters):
    """For a = (L, Γ): (1 + Θ̂/2) (2 I Θ − h (L + L̃)), and its matrix."""
    h, I = c[STEP], vector(c, INERTIA)
    m, push = multiply(I, turn), mean_push(turn, a[3:], vector(c, WEIGHT))
    g = add(add(times(2.0, m), 1.0, cross(turn, m)), -2.0 * h, a[:3])
    return add(g, -h * h, push), rows(I, 2.0, turn, m)


@jit
def simo_wong(s, c, counters):
    h, I, L = c[STEP], vector(c, INERTIA), s[4:]
    up = vertical(s, c)
    turn = cayley(divide(times(h, L), I), L + up, c, counters)
    v = times(0.5, turn)
    f0 = 1.0 / math.sqrt(1.0 + dot(v, v))
    q = compose(s, f0, times(f0, v))
    L = add(L, -1.0 / h, cross(turn, multiply(I, turn)))
    L = add(L, h, mean_push(turn, up, vector(c, WEIGHT)))
    return q[:4] + L


@jit
def next_momentum(turn, s, c, counters):
    """L̃ of lie_midpoint."""
    push, back = torque(rotate(s, times(0.5, turn), counters), c), times(-0.5, turn)
    L = add(lie_group.turn_one(back, s[4:], counters), c[STEP], push)
    return lie_group.turn_one(back, L, counters)


@jit
def midpoint_residual(turn, s, c, counters):
    h, I = c[STEP], vector(c, INERTIA)
    L = next_momentum(turn, s, c, counters)
    g = add(add(multiply(I, turn), -0.5 * h, s[4:]), -0.5 * h, L)
    return g, rows(I, 1.0, ZERO, times(0.5 * h, L))


@jit
def lie_midpoint(s, c, counters):
    h, I, L = c[STEP], vector(c, INERTIA), s[4:]
    turn = midpoint(divide(times(h, L), I), s, c, counters)
    L, q = next_momentum(turn, s, c, counters), rotate(s, turn, counters)
    return q[:4] + L


@jit
def rate(v, s, c):
    """v' = I⁻¹ (I v × v + τ)."""
    I = vector(c, INERTIA)
    return divide(add(torque(s, c), 1.0, cross(multiply(I, v), v)), I)


RHO = 0.9  # the spectral radius at infinite frequency: 0 damps most, 1 does not damp
ALPHA_M, ALPHA_F = (2.0 * RHO - 1.0) / (RHO + 1.0), RHO / (RHO + 1.0)
GAMMA = 0.5 + ALPHA_F - ALPHA_M
BETA = 0.25 * (GAMMA + 0.5) ** 2


@jit
def newmark(b, a, c):
    """Newmark's formulas: the next a, v and the turn Θ, if b is the next v'. The argument `a` holds q, v, v' and a.

    (1 − α_m) ã = (1 − α_f) b + α_f v' − α_m a,    ṽ = v + h ((1 − γ) a + γ ã),    Θ = h v + h² ((1/2 − β) a + β ã)
    """
    h, v, a0 = c[STEP], a[4:7], a[10:]
    a1 = times(1.0 / (1.0 - ALPHA_M), add(add(times(1.0 - ALPHA_F, b), ALPHA_F, a[7:10]), -ALPHA_M, a0))
    v1 = add(add(v, (1.0 - GAMMA) * h, a0), GAMMA * h, a1)
    turn = add(add(times(h, v), (0.5 - BETA) * h * h, a0), BETA * h * h, a1)
    return a1, v1, turn


@jit
def alpha_residual(b, a, c, counters):
    I = vector(c, INERTIA)
    _, v, turn = newmark(b, a, c)
    g = multiply(I, add(b, -1.0, rate(v, rotate(a[:4] + ZERO, turn, counters), c)))
    k = GAMMA * c[STEP] * (1.0 - ALPHA_F) / (1.0 - ALPHA_M)
    return g, rows(I, 1.0, times(k, v), times(k, multiply(I, v)))


@jit
def generalized_alpha(s, c, counters):
    I = vector(c, INERTIA)
    v = divide(s[4:], I)
    if counters[MEMORY] == 0.0:  # the first step: both accelerations are v' of the motion
        counters[MEMORY] = 1.0
        b = rate(v, s, c)
        store_tuple(counters, MEMORY + 1, b + b)
    b, a = vector(counters, MEMORY + 1), vector(counters, MEMORY + 4)
    motion = s[:4] + v + b + a
    b = alpha(b, motion, c, counters)
    a, v, turn = newmark(b, motion, c)
    store_tuple(counters, MEMORY + 1, b + a)
    q, L = rotate(s, turn, counters), multiply(I, v)
    return q[:4] + L


free, cayley, midpoint, alpha = map(newton, (free_residual, cayley_residual, midpoint_residual, alpha_residual))


def method(name: str, label: str, step: Compiled, claims: Claims, source: str, has_memory: bool = False) -> Method:
    """The record of a step. has_memory : whether numbers go from step to step, so that a run depends on where it starts.

    The names of the invariants are explained in `problem.rigid_body`.
    """

    def prepare(body: RigidBody, y0: Array, h: float) -> FixedStepper:
        c = np.array((h, *body.inertia, *body.weight, *body.up), dtype=float)
        stepper = FixedStepper(name, h, Kernel(step, failures=FAILURES), c, size=7)
        stepper.from_start = has_memory
        return stepper

    return Method(name, label, "whole-body", 2, source, prepare, claims, needs="body")


RATTLE = method(
    "rattle",
    "RATTLE",
    rattle,
    Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
    "McLachlan and Zanna, Found. Comput. Math. 5 (2005) 87",
)
SIMO_WONG = method(
    "simo_wong",
    "Cayley midpoint",
    simo_wong,
    Claims(symmetric=True, conserves={"H", "J3", "C1"}),
    "after Simo and Wong, Int. J. Numer. Methods Eng. 31 (1991) 19, not seen",
)
LIE_MIDPOINT = method(
    "lie_midpoint",
    "Lie midpoint",
    lie_midpoint,
    Claims(symmetric=True, conserves={"J3", "C1"}),
    "as simo_wong, with the exponential",
)
GENERALIZED_ALPHA = method(
    "generalized_alpha",
    "Generalized-α",
    generalized_alpha,
    Claims(conserves={"C1", "C2"}),
    "Brüls, Cardona and Arnold, Mech. Mach. Theory 48 (2012) 121",
    has_memory=True,
)
