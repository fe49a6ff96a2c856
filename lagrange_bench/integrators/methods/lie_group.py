"""A Lie-group method of order 4. An element of SE(3), a rigid motion, moves (J, x) in each update; a rotation moves a spin.

exp(a, b) acts by x → R x, J → R J + (V b)×(R x), with R = exp(a×) and V = ∫₀¹ exp(s a×) ds: the coadjoint action. The generator
of the motion is (∂H/∂J, ∂H/∂x) on e3, so (J, alpha e3) for a top in a uniform field. A spin turns by exp(∂H/∂s). The commutator
is [(a, b), (c, d)] = (a×c, a×d − c×b). Casimir functions such as |x| and x·J are conserved for every h, whatever the generator.
J3 and H are not: they drift in proportion to time, as by a plain Runge-Kutta method.

`rkmk4` is the classical Runge-Kutta method on the Lie algebra, with the two commutators that order 4 needs.

A whole body (q, L) is moved by SO(3)×R³: q is turned by exp(a/2) from the right, in its own frame, and L grows by b = h L'. The
commutator is (a × c, 0), and |q| is conserved.

With θ = |a| and w = a tan(θ/2)/θ, R x = x + d + w×(x + d), d = (w×x + w×(w×x)) cos²(θ/2). In this form a relative error of d does
not change |R x| to first order. In x + sin θ/θ a×x + … sine and cosine are rounded apart, and C1
drifts. The coefficients are polynomials in θ². They call no library function, so the bits are the same on every machine. Beyond
θ = 1 the motion is divided into parts, which are right to round-off up to θ = `MOST`. A step with a larger θ is refused.

Sources: Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; Munthe-Kaas & Owren, Phil. Trans. R. Soc. A 357 (1999) 957 (two
commutators).
"""

import math
from functools import cache

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import CLOCK, FAILURE, FixedStepper, Kernel
from lagrange_bench.integrators.compiling.tape import Tape, Term, Terms
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.problem import vectors
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import BODY, Space, System

START, STEP = range(2)  # places of the constants: the time at the start, h; then the parameters
STAGES = 4
MOST = 1024.0  # largest θ of an exponential
TURNED = 1
FAILURES = {TURNED: f"an exponential of this step turns by more than {MOST:g} rad; take a smaller |h|"}

# series in θ², for θ ≤ 1 to less than half an ulp; φ = θ/2
SINC = tuple((-1) ** k / (math.factorial(2 * k + 1) * 4**k) for k in range(8))  # sin φ/φ
COS = tuple((-1) ** k / (math.factorial(2 * k) * 4**k) for k in range(8))  # cos φ
LAG = tuple((-1) ** k / math.factorial(2 * k + 3) for k in range(8))  # (θ − sin θ)/θ³

# weights of the generators of the four stages
RK4 = (1 / 6, 1 / 3, 1 / 3, 1 / 6)


@jit
def polynomial(p, z):
    y = z * z
    return ((p[0] + p[1] * z) + (p[2] + p[3] * z) * y) + ((p[4] + p[5] * z) + (p[6] + p[7] * z) * y) * (y * y)


cross, dot = jit(vectors.cross), jit(vectors.dot)


@jit
def times(r, a):
    return r * a[0], r * a[1], r * a[2]


@jit
def add(a, r, b):
    """a + r b."""
    return a[0] + r * b[0], a[1] + r * b[1], a[2] + r * b[2]


@jit
def turn(w, q, v):
    """R v, for w and q = cos²(θ/2)."""
    u = cross(w, v)
    d = times(q, add(u, 1.0, cross(w, u)))
    e = cross(w, d)
    return v[0] + (d[0] + (u[0] + e[0])), v[1] + (d[1] + (u[1] + e[1])), v[2] + (d[2] + (u[2] + e[2]))


@jit(inline=True)
def exponential(a, counters):
    """Divide a into `parts` equal ones of θ ≤ 1. Returns w, cos²(θ/2), parts, a, θ² and sin(θ/2)/(θ/2), all of one part."""
    z = dot(a, a)
    if not z <= MOST * MOST:
        counters[FAILURE] = TURNED
        z, a = 0.0, (0.0, 0.0, 0.0)
    parts = 1
    while z > 1.0:
        z *= 0.25
        parts *= 2
    a = times(1.0 / parts, a)
    sinc, cos = polynomial(SINC, z), polynomial(COS, z)
    return times(sinc / (2.0 * cos), a), cos * cos, parts, a, z, sinc


@jit
def move(k, s, counters):
    """exp(a, b) acts on a state of e3, k = (a, b) in six numbers; V b = b + (1 − cos θ)/θ² a×b + (θ − sin θ)/θ³ a×(a×b)."""
    w, q, parts, a, z, sinc = exponential(k[:3], counters)
    b = times(1.0 / parts, k[3:])
    u = cross(a, b)
    Vb = add(add(b, 0.5 * (sinc * sinc), u), polynomial(LAG, z), cross(a, u))
    J, x = s[:3], s[3:]
    for _ in range(parts):
        x = turn(w, q, x)
        J = add(turn(w, q, J), 1.0, cross(Vb, x))
    return J + x


@jit
def turn_one(k, s, counters):
    """The rotation exp(k×) of one vector."""
    w, q, parts, _, _, _ = exponential(k, counters)
    v = s
    for _ in range(parts):
        v = turn(w, q, v)
    return v


@cache
def turn_all(count: int) -> Compiled:
    """Rotations of `count` vectors."""
    if count == 1:
        return turn_one
    turn_others = turn_all(count - 1)

    @jit
    def turn_vectors(k, s, counters):
        return turn_one(k[:3], s[:3], counters) + turn_others(k[3:], s[3:], counters)

    return turn_vectors


@jit
def of_length(square, q0, q):
    """The quaternion (q0, q), scaled to the length √square, which it has but for round-off; four numbers."""
    lack = 0.5 * (square - (q0 * q0 + dot(q, q))) / square
    q = add(q, lack, q)
    return q0 + lack * q0, q[0], q[1], q[2]


@cache
def turn_body(from_right: bool) -> Compiled:
    """(a, b) of SO(3)×R³ acts on a whole body (q, L): q exp(−a/2) if `from_right`, else exp(a/2) q; and L + b."""

    @jit
    def act(k, s, counters):
        _, _, parts, a, z, sinc = exponential(k[:3], counters)
        c, v = polynomial(COS, z), times(-0.5 * sinc if from_right else 0.5 * sinc, a)
        q0, q = s[0], s[1:4]
        square = q0 * q0 + dot(q, q)
        for _ in range(parts):
            product = cross(q, v) if from_right else cross(v, q)
            q0, q = c * q0 - dot(v, q), add(add(times(c, q), q0, v), 1.0, product)
        return of_length(square, q0, q) + add(s[4:], 1.0, k[3:])

    return act


@cache
def generator_of(system: System) -> Program:
    """h times the generator of the motion: the gradient of H, with the sign of the bracket."""

    def generator(tape: Tape, t: Term, y: Terms, h: Term, p: Terms) -> list[Term]:
        slopes, scale = system.slopes(tape, t, y, p), -h if system.body else h
        if system.space == BODY:
            return [*(scale * slope for slope in slopes[-3:]), *system.rates(tape, t, y, p, h)[4:]]
        return [scale * slope for slope in slopes]

    return system.record_step(generator)


@cache
def algebra(space: Space) -> tuple[Compiled, Compiled, Compiled]:
    """For generators: k → k/2; (k1, k2) → ½ k2 − ⅛ [k1, k2]; (k1, …, k4) → (k1 + 2 k2 + 2 k3 + k4)/6 − [k1, k4]/12."""

    def commutator(k, l):
        if space == BODY:
            return *vectors.cross(k[:3], l[:3]), *(0.0 * v for v in k[3:])
        if space.affine:
            pairs = zip(vectors.cross(k[:3], l[3:]), vectors.cross(l[:3], k[3:]), strict=True)
            return *vectors.cross(k[:3], l[:3]), *(a - b for a, b in pairs)
        return tuple(v for i in range(0, space.size, 3) for v in vectors.cross(k[i : i + 3], l[i : i + 3]))

    @unrolled
    def half(k):
        return tuple(0.5 * v for v in k)

    @unrolled
    def middle(k1, k2):
        return tuple(0.5 * a + -0.125 * c for a, c in zip(k2, commutator(k1, k2), strict=True))

    @unrolled
    def mean(k1, k2, k3, k4):
        w, rows = RK4, zip(k1, k2, k3, k4, commutator(k1, k4), strict=True)
        return tuple((((w[0] * a + w[3] * d) + w[1] * b) + w[2] * c) + (-1.0 / 12.0) * e for a, b, c, d, e in rows)

    return half, middle, mean


@cache
def kernel(system: System) -> Compiled:
    """The step for any system; constants: the time at the start, h, and the parameters."""
    timed, space = system.timed, system.space
    program, numbers = machine_code(generator_of(system)), tuple_loader(1 + system.parameters)
    half, middle, mean = algebra(space)
    act = turn_body(system.body)
    if space != BODY:
        act = move if space.affine else turn_all(space.size // 3)

    @jit
    def generator(s, node, c, counters):
        t = c[START] + c[STEP] * (counters[CLOCK] + node) if timed else 0.0
        return program((t, *s), numbers(c, STEP))

    @jit
    def rkmk4(s, c, counters):
        k1 = generator(s, 0.0, c, counters)
        k2 = generator(act(half(k1), s, counters), 0.5, c, counters)
        k3 = generator(act(middle(k1, k2), s, counters), 0.5, c, counters)
        k4 = generator(act(k3, s, counters), 1.0, c, counters)
        return act(mean(k1, k2, k3, k4), s, counters)

    return rkmk4


def prepare(problem: Problem, y0: Array, h: float) -> FixedStepper:
    """The steps for any h for which no exponential turns by more than `MOST` rad."""
    system = problem.system
    c = np.array((problem.start, h, *problem.numbers))
    step, size, timed = kernel(system), system.size, system.timed
    return FixedStepper("rkmk4", h, Kernel(step, failures=FAILURES, rhs_per_step=STAGES, timed=timed), c, size=size)


RKMK4 = Method(
    name="rkmk4",
    label="RKMK 4",
    family="lie-group",
    order=4,
    claims=Claims(conserves={"C1", "C2"}),
    source="Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; Munthe-Kaas and Owren, Phil. Trans. R. Soc. A 357 (1999) 957",
    prepare=prepare,
    needs="rhs",
)
