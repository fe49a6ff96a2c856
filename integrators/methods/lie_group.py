"""Two Lie-group methods of order 4: every update is a motion of space, an element of SE(3), acting on (J, x).

The coadjoint action of exp(a, b) is x → R x, J → R J + (V b)×(R x), with R = exp(a×) and V = ∫₀¹ exp(s a×) ds. The top moves by
the generator (J, ∇U), in a uniform field (J, alpha e3). The commutator is [(a, b), (c, d)] = (a×c, a×d − c×b). Whatever the
generator, |x| and x·J stay: C1 and C2 are kept for every h. J3 and H are not; they drift in proportion to time, as for a plain
Runge-Kutta method.

`rkmk4` is the classical Runge-Kutta method on the Lie algebra, with the two commutators that order 4 needs; `commutator_free4`
composes exponentials instead, five in all, of which one is used twice.

R is written with w = a tan(θ/2)/θ, θ = |a|: R x = x + d + w×(x + d), d = (w×x + w×(w×x)) cos²(θ/2). A relative error of d then
does not change |R x| to first order, and round-off is a random walk. As x + sin θ/θ a×x + …, with sine and cosine
rounded apart, C1 drifts. The coefficients are polynomials in θ²: no library function, the same bits on every machine. Beyond
θ = 1 the motion is taken in parts, so that it is good to round-off up to any θ; over `MOST` rad a step is refused.

Sources: Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; Munthe-Kaas & Owren, Phil. Trans. R. Soc. A 357 (1999) 957 (two
commutators); Celledoni, Marthinsen & Owren, Future Gener. Comput. Syst. 19 (2003) 341 (commutator-free, order 4).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from integrators.compiling.compiled import jit, jit_as
from integrators.compiling.expression import machine_code, take
from integrators.compiling.loops import FAILURE, FixedStepper
from integrators.interface import AnyField, Array, Method
from integrators.problem.field import Field
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.top import LagrangeTop

H, ALPHA_H = range(2)  # places of the constants; in a field h, then alpha and the parameters of the potential
STAGES = 4
MOST = 1024.0
TURNED = 1
FAILURES = {TURNED: f"an exponential of this step turns by more than {MOST:g} rad; take a smaller |h|"}

# series in θ², for θ ≤ 1 to less than half an ulp: sin φ/φ and cos φ at φ = θ/2, and (θ − sin θ)/θ³
SINC = tuple((-1) ** k / (math.factorial(2 * k + 1) * 4**k) for k in range(8))
COS = tuple((-1) ** k / (math.factorial(2 * k) * 4**k) for k in range(8))
LAG = tuple((-1) ** k / math.factorial(2 * k + 3) for k in range(8))

# weights of the generators of the four stages: rkmk4, and the two factors of commutator_free4
RK4 = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
FIRST, LAST = (1 / 4, 1 / 6, 1 / 6, -1 / 12), (-1 / 12, 1 / 6, 1 / 6, 1 / 4)


@jit
def polynomial(p, z):
    y = z * z
    return ((p[0] + p[1] * z) + (p[2] + p[3] * z) * y) + ((p[4] + p[5] * z) + (p[6] + p[7] * z) * y) * (y * y)


@jit
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit
def dot(a, b):
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


@jit
def times(r, a):
    return r * a[0], r * a[1], r * a[2]


@jit
def add(a, r, b):
    """a + r b."""
    return a[0] + r * b[0], a[1] + r * b[1], a[2] + r * b[2]


@jit
def combine(w, a1, a2, a3, a4):
    a = add(times(w[0], a1), w[3], a4)
    return add(add(a, w[1], a2), w[2], a3)


@jit
def turn(w, q, v):
    """R v."""
    u = cross(w, v)
    d = times(q, add(u, 1.0, cross(w, u)))
    e = cross(w, d)
    return v[0] + (d[0] + (u[0] + e[0])), v[1] + (d[1] + (u[1] + e[1])), v[2] + (d[2] + (u[2] + e[2]))


@jit
def move(a, b, s, tally):
    """exp(a, b) acting on s."""
    z = (a[0] * a[0] + a[1] * a[1]) + a[2] * a[2]
    if not z <= MOST * MOST:
        tally[FAILURE] = TURNED
        return s
    parts = 1
    while z > 1.0:
        z *= 0.25
        parts *= 2
    if parts > 1:
        a, b = times(1.0 / parts, a), times(1.0 / parts, b)
    sinc, cos = polynomial(SINC, z), polynomial(COS, z)
    u = cross(a, b)
    Vb = add(add(b, 0.5 * (sinc * sinc), u), polynomial(LAG, z), cross(a, u))
    w, q = times(sinc / (2.0 * cos), a), cos * cos
    J, x = (s[0], s[1], s[2]), (s[3], s[4], s[5])
    for _ in range(parts):
        x = turn(w, q, x)
        J = add(turn(w, q, J), 1.0, cross(Vb, x))
    return J[0], J[1], J[2], x[0], x[1], x[2]


@jit
def spin(h, s):
    """The rotation part a of h times the generator at s; the other part is the same everywhere, b = h alpha e3."""
    return h * s[0], h * s[1], h * s[2]


@jit
def rkmk4_step(s, c, tally):
    h = c[H]
    b, half_b = (0.0, 0.0, c[ALPHA_H]), (0.0, 0.0, 0.5 * c[ALPHA_H])
    a1 = spin(h, s)
    a2 = spin(h, move(times(0.5, a1), half_b, s, tally))
    # ½ k2 − ⅛ [k1, k2]
    a = add(times(0.5, a2), -0.125, cross(a1, a2))
    a3 = spin(h, move(a, add(half_b, -0.125, cross(add(a1, -1.0, a2), b)), s, tally))
    a4 = spin(h, move(a3, b, s, tally))
    # (k1 + 2 k2 + 2 k3 + k4)/6 − [k1, k4]/12
    a = add(combine(RK4, a1, a2, a3, a4), -1.0 / 12.0, cross(a1, a4))
    return move(a, add(b, -1.0 / 12.0, cross(add(a1, -1.0, a4), b)), s, tally)


@jit
def commutator_free4_step(s, c, tally):
    h = c[H]
    half_b = (0.0, 0.0, 0.5 * c[ALPHA_H])
    a1 = spin(h, s)
    half_a1 = times(0.5, a1)
    middle = move(half_a1, half_b, s, tally)
    a2 = spin(h, middle)
    a3 = spin(h, move(times(0.5, a2), half_b, s, tally))
    a4 = spin(h, move(add(a3, -1.0, half_a1), half_b, middle, tally))  # the exponential of k1/2 is used again
    middle = move(combine(FIRST, a1, a2, a3, a4), half_b, s, tally)
    return move(combine(LAST, a1, a2, a3, a4), half_b, middle, tally)


# ------------------------------------------------------------------------------------ any field


@jit
def commutator(k, l):
    """[k, l] of two generators (a, b)."""
    return cross(k[0], l[0]), add(cross(k[0], l[1]), -1.0, cross(l[0], k[1]))


@jit
def scaled(r, k):
    return times(r, k[0]), times(r, k[1])


@jit
def plus(k, r, l):
    """k + r l."""
    return add(k[0], r, l[0]), add(k[1], r, l[1])


@jit
def mean(w, k1, k2, k3, k4):
    return combine(w, k1[0], k2[0], k3[0], k4[0]), combine(w, k1[1], k2[1], k3[1], k4[1])


@cache
def generator_in_field(field: Field) -> Any:
    """(h, c, s) → h times the generator (J, g) at s."""
    gradient, numbers = machine_code(field.gradient), take(field.parameters)

    @jit_as(f"generator {field.digest}")
    def generator(h, c, s):
        g = gradient((s[3], s[4], s[5]), numbers(c, 1))
        return (h * s[0], h * s[1], h * s[2]), (h * g[0], h * g[1], h * g[2])

    return generator


@cache
def rkmk4_in_field(field: Field) -> Any:
    generator = generator_in_field(field)

    @jit_as(f"rkmk4 {field.digest}")
    def step(s, c, tally):
        h = c[H]
        k1 = generator(h, c, s)
        k = scaled(0.5, k1)
        k2 = generator(h, c, move(k[0], k[1], s, tally))
        k = plus(scaled(0.5, k2), -0.125, commutator(k1, k2))
        k3 = generator(h, c, move(k[0], k[1], s, tally))
        k4 = generator(h, c, move(k3[0], k3[1], s, tally))
        k = plus(mean(RK4, k1, k2, k3, k4), -1.0 / 12.0, commutator(k1, k4))
        return move(k[0], k[1], s, tally)

    return step


@cache
def commutator_free4_in_field(field: Field) -> Any:
    generator = generator_in_field(field)

    @jit_as(f"commutator_free4 {field.digest}")
    def step(s, c, tally):
        h = c[H]
        k1 = generator(h, c, s)
        half = scaled(0.5, k1)
        middle = move(half[0], half[1], s, tally)
        k2 = generator(h, c, middle)
        k = scaled(0.5, k2)
        k3 = generator(h, c, move(k[0], k[1], s, tally))
        k = plus(k3, -1.0, half)
        k4 = generator(h, c, move(k[0], k[1], middle, tally))
        k = mean(FIRST, k1, k2, k3, k4)
        middle = move(k[0], k[1], s, tally)
        k = mean(LAST, k1, k2, k3, k4)
        return move(k[0], k[1], middle, tally)

    return step


def in_field(name: str, kernel: Any) -> AnyField:
    def prepare(top: PerturbedTop, y0: Array, h: float) -> FixedStepper:
        """Any h for which no exponential turns by more than `MOST` rad."""
        c = np.array((h, *top.numbers))
        return FixedStepper(name, h, c, kernel(top.field), rhs_per_step=STAGES, failures=FAILURES)

    return AnyField(prepare, conserves=frozenset({"C1", "C2"}))


# ------------------------------------------------------------------------------------ methods


def prepare_rkmk4(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Any h for which no exponential turns by more than `MOST` rad: four exponentials, two commutators."""
    return _stepper("rkmk4", rkmk4_step, top, h)


def prepare_commutator_free4(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Any h for which no exponential turns by more than `MOST` rad: five exponentials."""
    return _stepper("commutator_free4", commutator_free4_step, top, h)


def _stepper(name: str, kernel: Any, top: LagrangeTop, h: float) -> FixedStepper:
    return FixedStepper(name, h, np.array((h, h * top.alpha)), kernel, rhs_per_step=STAGES, failures=FAILURES)


RKMK4 = Method(
    name="rkmk4",
    label="RKMK 4",
    family="lie-group",
    order=4,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"C1", "C2"}),
    control="step",
    source="Munthe-Kaas, Appl. Numer. Math. 29 (1999) 115; Munthe-Kaas and Owren, Phil. Trans. R. Soc. A 357 (1999) 957",
    prepare=prepare_rkmk4,
    in_field=in_field("rkmk4", rkmk4_in_field),
)

COMMUTATOR_FREE4 = replace(
    RKMK4,
    name="commutator_free4",
    label="Commutator-free 4",
    source="Celledoni, Marthinsen and Owren, Future Gener. Comput. Syst. 19 (2003) 341",
    prepare=prepare_commutator_free4,
    in_field=in_field("commutator_free4", commutator_free4_in_field),
)
