"""Splittings: compositions of the two exact flows of H = |J|²/2 + alpha x3.

    A(t), of |J|²/2:    x turns about the constant J at rate |J|
    B(t), of alpha x3:  J += t alpha e3×x with constant x, a kick

Both are Poisson maps that keep J3, |x|² and x·J, and so is whatever is composed of them; H oscillates. A scheme is a
list of coefficients, first letter … last letter; all are palindromes, and the maps symmetric. Two properties of this H
are used. It is quadratic in J, so [B,[B,[B,A]]] = 0, and coefficients for Runge-Kutta-Nyström equations apply. And
[B,[A,B]] and [B,[B,[A,[A,B]]]] are functions of x: a kick with force gradients is the exact flow of

    hB b + h³c [B,[A,B]] + h⁵d [B,[B,[A,[A,B]]]],

its torques are those of `System.commutator_torque` and `System.second_commutator_torque`. Any potential U(x) takes the place of
alpha x3.

Taken n times, a scheme ends every step with the flow that begins the next. So the loop runs over a conjugate map, in which
the two are one, and `enter` and `leave` of the stepper apply the first flow and its inverse. The processor of Takahashi
and Imada goes the same way.

Rotation. With v = (t/2) J, z = |v|² and u = v×x, p = v×u, r = v×p, the rotation by 2|v| is

    x + 2u + 2p + r + a(z) u + b(z) p,    a = sin(2√z)/√z − 2 + z,   b = (1 − cos 2√z)/z − 2,

in which r takes the place of −zu. Part of the error of z is the same in every step, because v3² is rounded the same
way. With r, what is left of this error is a change of the angle, and the length of x is kept to higher order. Both a
and b are small, of order z, and so are their errors. Beyond 2|v| = 1 the turn is made in 2, 4, 8, … equal parts. No
library function is called: the bits are the same everywhere.

Any other Hamiltonian is a sum of `parts` with closed flows; schemes for two flows become sweeps through all of them.

Sources: with each scheme. McLachlan & Quispel, Acta Numerica 11 (2002) 341, for splittings; López-Marcos, Sanz-Serna &
Skeel, SIAM J. Sci. Comput. 18 (1997) 223, for processing; the rotation and the processor: this project.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from itertools import accumulate, chain, zip_longest
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators.checks import check_flag
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import two_sum
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader, tuple_storer
from lagrange_bench.integrators.compiling.loops import CLOCK, FAILURE, MEMORY, ConjugateStepper, FixedStepper, finite
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.parts import Part
from lagrange_bench.integrators.problem.system import System

FARTHEST = 4.0  # g |x| of `process`, which loses a factor of 1 + 2(g|x|)², squared, of the digits of |x|


class Scheme(NamedTuple):
    """Coefficients of one step; `a` of the rotations and `b`, `c`, `d` of the kicks, all palindromes."""

    order: int
    first: str  # letter: "A" rotation, "B" kick
    a: tuple[float, ...]
    b: tuple[float, ...]
    source: str
    c: tuple[float, ...] = ()
    d: tuple[float, ...] = ()
    processor: float = 0.0  # g: the scheme is exp(gh²[A,B]) · letters · exp(−gh²[A,B])
    nystrom: bool = False  # of this order only because [B,[B,[B,A]]] = 0


def mirror(half: tuple[float, ...], n: int) -> tuple[float, ...]:
    """A palindrome of n numbers from its first half, the middle one included."""
    return (*half, *half[: n // 2][::-1])


def palindrome(first: tuple[float, ...], n: int) -> tuple[float, ...]:
    """A palindrome of n numbers with sum 1 from all of its first half but the last, or middle, one."""
    rest = math.fsum((1.0, *(-2 * w for w in first)))
    return mirror((*first, rest if n % 2 else rest / 2), n)


def composition(order: int, source: str, first: tuple[float, ...]) -> Scheme:
    """Strang steps of lengths w h: `first` are all w before the middle one."""
    w = palindrome(first, 2 * len(first) + 1)
    return Scheme(order, "B", w, tuple((p + q) / 2 for p, q in zip((0.0, *w), (*w, 0.0), strict=True)), source)


KAHAN_LI = "Kahan and Li, Math. Comp. 66 (1997) 1089"
BLANES_MOAN = "Blanes and Moan, J. Comput. Appl. Math. 142 (2002) 313"
GRADIENTS = "Omelyan, Mryglod and Folk, Phys. Rev. E 66 (2002) 026701"

SCHEMES = {
    "strang": composition(2, "Strang, SIAM J. Numer. Anal. 5 (1968) 506", ()),
    "takahashi_imada": Scheme(
        4, "B", (1.0,), (1 / 2, 1 / 2), "Takahashi and Imada, J. Phys. Soc. Japan 53 (1984) 3765",
        c=(1 / 48, 1 / 48), processor=1 / 12,
    ),
    "blanes_moan4": Scheme(
        4, "B",
        palindrome((0.245298957184271, 0.604872665711080), 6),
        palindrome((0.0829844064174052, 0.396309801498368, -0.0390563049223486), 7),
        f"{BLANES_MOAN}, SRKN6b",
    ),
    # two conditions for a1, b1, c1, c2: b1 and c1 are the ones of least error of degree 5
    "force_gradient4": Scheme(
        4, "B",
        palindrome((0.27377798630646189,), 3),
        palindrome((0.080868,), 4),
        f"class of {GRADIENTS}; coefficients: this project",
        c=mirror((0.000232, 0.0029821796916614993), 4),
    ),
    "kahan_li6": composition(
        6, KAHAN_LI,
        (0.39216144400731413927925056, 0.33259913678935943859974864, -0.70624617255763935980996482,
         0.08221359629355080023149045),
    ),
    "blanes_moan6": Scheme(
        6, "A",
        palindrome((0.0378593198406116, 0.102635633102435, -0.0258678882665587, 0.314241403071447, -0.130144459517415,
                    0.106417700369543, -0.00879424312851058), 15),
        palindrome((0.09171915262446165, 0.183983170005006, -0.05653436583288827, 0.004914688774712854,
                    0.143761127168358, 0.328567693746804), 14),
        f"{BLANES_MOAN}, SRKN14a", nystrom=True,
    ),
    "force_gradient6": Scheme(
        6, "A",
        palindrome((0.10951155775140214, 0.44517150809552086), 5),
        palindrome((0.26872220820482184,), 4),
        f"class of {GRADIENTS}; coefficients: this project",
        c=mirror((0.0008056816670964243, 0.003955911930041659), 4),
        d=mirror((1.935749212896712e-05, 5.0722352657284275e-05), 4), nystrom=True,
    ),
    "kahan_li8": composition(
        8, KAHAN_LI,
        (0.13020248308889008087881763, 0.56116298177510838456196441, -0.38947496264484728640807860,
         0.15884190655515560089621075, -0.39590389413323757733623154, 0.18453964097831570709183254,
         0.25837438768632204729397911, 0.29501172360931029887096624),
    ),
    "sofroniou_spaletta10": composition(
        10, "Sofroniou and Spaletta, Optim. Methods Softw. 20 (2005) 597",
        (0.07879572252168641, 0.3130961034151085, 0.027918383235078066, -0.22959284159390708, 0.13096206107716488,
         -0.2697334056545107, 0.07497334315589144, 0.1119934239998102, 0.36613344954622673, -0.3991056301360359,
         0.10308739852747108, 0.41143087395589023, -0.0048663605831352616, -0.3920333537086399, 0.05194250296244965,
         0.050665090759924494, 0.049674370639729876),
    ),
}  # fmt: skip


A, B, C, D, STRIDE = range(5)  # places in each group of constants: one rotation, one kick
PART = 0.25  # z = (angle/2)² of a turn made at once: an angle of 1
LARGE = 1e154  # what has a square
MOST = 128.0**2  # z beyond which no turn is made: an angle of 256
TOO_FAR = 1
FAILURES = {TOO_FAR: "the axis turns by more than 256 radians in one part of the step; take a smaller |h|"}


@jit(inline=True)
def small_coefficients(z):
    """a/z and b/z of the rotation, 0 <= z <= 1/4; a and b to 3e-19.

    Least squares, one coefficient rounded after the other, so that the next ones mend what its rounding does: the rounded
    polynomials keep |x|² to 2e-19.
    """
    z2 = z * z
    z4 = z2 * z2
    a = (-0.3333333333333333 + 0.2666666666666631 * z) + z2 * (-0.025396825396671374 + 0.001410934741425644 * z)
    b = (-0.6666666666666666 + 0.08888888888888634 * z) + z2 * (-0.006349206349141372 + 0.00028218694802735093 * z)
    a += z4 * ((-5.1306691152203537e-05 + 1.315420958644531e-06 * z) - 2.470580985210812e-08 * z2)
    b += z4 * ((-8.55111385492195e-06 + 1.8791375066112914e-07 * z) - 3.08449838086915e-09 * z2)
    return a, b


@jit(inline=True)
def turn(x1, x2, x3, v1, v2, v3, a, b, z):
    """Change of x by the rotation about v, |v|² = z; a and b stand for a/z and b/z."""
    u1, u2, u3 = v2 * x3 - v3 * x2, v3 * x1 - v1 * x3, v1 * x2 - v2 * x1
    p1, p2, p3 = v2 * u3 - v3 * u2, v3 * u1 - v1 * u3, v1 * u2 - v2 * u1
    r1, r2, r3 = v2 * p3 - v3 * p2, v3 * p1 - v1 * p3, v1 * p2 - v2 * p1
    return (
        (2.0 * (u1 + p1) + r1) + (a * (z * u1) + b * (z * p1)),
        (2.0 * (u2 + p2) + r2) + (a * (z * u2) + b * (z * p2)),
        (2.0 * (u3 + p3) + r3) + (a * (z * u3) + b * (z * p3)),
    )


@jit(inline=True)
def add(x, lost, change, compensated):
    """x + (change + what the last sum lost), and what this one loses."""
    return two_sum(x, change + lost) if compensated else (x + change, lost)


@jit(inline=True)
def rotate(part, J1, J2, J3, x1, x2, x3, l1, l2, l3, compensated):
    """x turned about v = part·J, |v| half the angle, and what its sums lose; False if that is too far to be done."""
    v1, v2, v3 = part * J1, part * J2, part * J3
    z = (v1 * v1 + v2 * v2) + v3 * v3
    parts = 1
    if z > PART:
        if not z <= MOST:
            return False, x1, x2, x3, l1, l2, l3
        while z > PART:
            v1, v2, v3, z, parts = 0.5 * v1, 0.5 * v2, 0.5 * v3, 0.25 * z, 2 * parts
    a, b = small_coefficients(z)
    d1, d2, d3 = turn(x1, x2, x3, v1, v2, v3, a, b, z)
    x1, l1 = add(x1, l1, d1, compensated)
    x2, l2 = add(x2, l2, d2, compensated)
    x3, l3 = add(x3, l3, d3, compensated)
    for _ in range(1, parts):
        d1, d2, d3 = turn(x1, x2, x3, v1, v2, v3, a, b, z)
        x1, l1 = add(x1, l1, d1, compensated)
        x2, l2 = add(x2, l2, d2, compensated)
        x3, l3 = add(x3, l3, d3, compensated)
    return True, x1, x2, x3, l1, l2, l3


@cache
def torques(system: System, gradients: int) -> Any:
    """(x, q, weights) → the sum of the torque of U(t, x) and of so many of its gradients, each times its weight; q = (t, *p)."""
    programs = (system.torque, system.commutator_torque, system.second_commutator_torque)[: gradients + 1]

    @unrolled
    def total(x, q, weights):
        t = tuple(weights[0] * v for v in programs[0](*x, *q))
        for weight, program in zip(weights[1:], programs[1:], strict=False):
            t = tuple(v + weight * w for v, w in zip(t, program(*x, *q), strict=True))
        return t

    return total


@cache
def push_by(system: System, gradients: int) -> Any:
    """(x, c, i) → the kick of group i, with so many of its gradients; t and the parameters follow the four constants there."""
    total, numbers = torques(system, gradients), tuple_loader(1 + system.parameters)

    @jit(inline=True)
    def push(x, c, i):
        return total(x, numbers(c, i + STRIDE), (c[i + B], c[i + C], c[i + D]))

    return push


@cache
def kernel(system: System, gradients: int, compensated: bool) -> Any:
    """One step of |J|²/2 + U(x): rotation and kick for each group of constants."""
    push, stride, conserves_J3 = push_by(system, gradients), STRIDE + 1 + system.parameters, 2 in system.constant
    load, store = tuple_loader(5), tuple_storer(5)

    @jit(inline=True)
    def step(s, c, counters):
        J1, J2, J3, x1, x2, x3 = s
        k1 = k2 = k3 = l1 = l2 = l3 = 0.0
        if compensated:
            k1, k2, l1, l2, l3 = load(counters, MEMORY)
            if not conserves_J3:
                k3 = counters[MEMORY + 5]
        for i in range(0, len(c), stride):
            done, x1, x2, x3, l1, l2, l3 = rotate(c[i + A], J1, J2, J3, x1, x2, x3, l1, l2, l3, compensated)
            if not done:
                counters[FAILURE] = TOO_FAR
                return s
            p1, p2, p3 = push((x1, x2, x3), c, i)
            J1, k1 = add(J1, k1, p1, compensated)
            J2, k2 = add(J2, k2, p2, compensated)
            if not conserves_J3:
                J3, k3 = add(J3, k3, p3, compensated)
        if compensated:
            store(counters, MEMORY, (k1, k2, l1, l2, l3))
            if not conserves_J3:
                counters[MEMORY + 5] = k3
        return J1, J2, J3, x1, x2, x3

    return step


@jit(inline=True)
def process(s, g):
    """The exact flow of [A,B] for a time 2g/alpha. Its Hamiltonian is alpha (x2 J1 − x1 J2), linear in J.

    x runs along its meridian: with D = cosh σ + (x3/|x|) sinh σ and σ = 2g|x|, (x1, x2) becomes (x1, x2)/D and x3
    (x3 cosh σ + |x| sinh σ)/D. Here sinh(σ/2) = g|x| in place of σ/2. That makes all of it algebraic, and is a change
    of time of relative order g²|x|²: |x| being a Casimir function, the map is still Poisson, and still even in h.
    """
    J1, J2, J3, x1, x2, x3 = s
    w1, w2, w3 = g * x1, g * x2, g * x3
    square = (w1 * w1 + w2 * w2) + w3 * w3
    twice, cosh = 2.0 * math.sqrt(1.0 + square), 1.0 + 2.0 * square
    D = cosh + twice * w3
    z = cosh * x3 + twice * ((w1 * x1 + w2 * x2) + w3 * x3)
    return D * J1 - twice * J3 * w1, D * J2 - twice * J3 * w2, J3, x1 / D, x2 / D, z / D


@cache
def map_over(step: Any, processed: bool) -> Any:
    """Of each row, in place: one rotation and one kick; if `processed`, with the flow of [A,B] before and after them."""
    get, write = tuple_loader(6), tuple_storer(6)

    @jit
    def run(rows, before, flow, after, counters):
        for row in rows:
            s = get(row, 0)
            if processed:
                s = process(s, before)
            s = step(s, flow, counters)
            if processed:
                s = process(s, after)
            write(row, 0, s)

    return run


@cache
def groups(scheme: Scheme) -> tuple[Array, Array]:
    """The step that is repeated, as groups (a, b, c, d) of a rotation and a kick, and the flow that begins the scheme.

    A B A … B A becomes (A² B)(A B) …, entered by A⁻¹; B A B … A B becomes (A B) … (A B²), entered by B.
    """
    none = (0.0,) * len(scheme.b)
    rotations, kicks = np.array(scheme.a), np.column_stack((scheme.b, scheme.c or none, scheme.d or none))
    first = np.zeros(STRIDE)
    if scheme.first == "A":
        first[A] = -rotations[0]
        rotations = np.append(rotations[0] + rotations[-1], rotations[1:-1])
    else:
        first[B:] = kicks[0]
        kicks = np.vstack((kicks[1:-1], kicks[0] + kicks[-1]))
    return np.column_stack((rotations, kicks)), first[None]


@jit
def scaled(groups, scales, numbers):
    """Groups of coefficients times their scales, each followed by the numbers, in one row."""
    stride = STRIDE + len(numbers)
    c = np.zeros(len(groups) * stride)
    for i in range(len(groups)):
        for k in range(STRIDE):
            if groups[i, k] != 0.0:  # 0 · ∞ is not to be: a coefficient that vanishes has no scale
                c[i * stride + k] = groups[i, k] * scales[k]
        for k in range(len(numbers)):  # Numba compiles an assignment to a slice for two seconds
            c[i * stride + STRIDE + k] = numbers[k]
    return c


def square(number: float) -> float:
    """number²; beyond the range of doubles it is infinite."""
    return number**2 if abs(number) < LARGE else math.inf


def prepare(name: str, problem: Any, y0: Array, h: float, *, compensated: bool = False) -> FixedStepper:
    """Of |J|²/2 + U(x) over the conjugate of a scheme: states enter and leave through its first flow and its processor.

    `compensated`: what rounding takes from a sum is kept for the next one, from step to step within a call.
    """
    carried = check_flag(compensated, "compensated")
    if not kinds.top(problem):
        if compensated:
            raise ValueError(f"compensated: {name} carries no sums for a Problem that is no top in a fixed potential")
        return prepare_parts(name, problem, h)
    scheme, system, numbers = SCHEMES[name], problem.system, np.array((problem.start, *problem.numbers))
    gradients = bool(scheme.c) + bool(scheme.d)
    scales = np.array((0.5 * h, h, -h * (h * h), h * square(h * h)))
    steps, first = groups(scheme)
    constants, begin, end = (scaled(*part, numbers) for part in ((steps, scales), (first, scales), (first, -scales)))
    processor = 0.5 * scheme.processor * (problem.numbers[0] * h) * h if scheme.processor else 0.0
    if not (finite(constants) and finite(begin) and math.isfinite(processor)):
        raise StepError(name, "the coefficients of the step are beyond the range of doubles", h=h)
    if FARTHEST < abs(processor) * math.hypot(*y0[3:]) < math.inf:
        reason = "h is so long that its processor turns every axis into the vertical, but for round-off"
        raise StepError(name, reason, h=h)
    return ConjugateStepper(
        name, h, constants, kernel(system, gradients, carried),
        map_rows=map_over(kernel(system, gradients, False), scheme.processor != 0.0),
        preprocess=(processor, begin, 0.0), postprocess=(0.0, end, -processor), rhs_per_step=len(steps), failures=FAILURES,
    )  # fmt: skip


# ------------------------------------------------------------------------------------ any parts


Stage = tuple[int, float, float]  # which part flows, how long, and when, in units of h


def stages_of(scheme: Scheme, parts: Sequence[Part]) -> list[Stage]:
    """The flows of one step.

    Of two parts, of which the first does not depend on t, they are the letters of the scheme, and t goes on with the first.
    In general the scheme is made of sweeps φ*, φ, φ*, … through all parts, φ* in the opposite order (McLachlan, SIAM J. Sci.
    Comput. 16 (1995) 151), with t as one more part.
    """
    letters = (scheme.a, scheme.b) if scheme.first == "A" else (scheme.b, scheme.a)
    stages: list[Stage] = []
    now = 0.0

    def flow(part: int, length: float) -> None:
        last, before, when = stages[-1] if stages else (-1, 0.0, 0.0)
        if last == part and (when == now or not parts[part].timed):
            stages[-1] = part, before + length, when
        else:
            stages.append((part, length, now))

    if len(parts) == 2 and not parts[0].timed:
        for i, length in enumerate(alternating(*letters)):
            first = (i % 2 == 0) == (scheme.first == "A")
            flow(0 if first else 1, length)
            now += length if first else 0.0
        return stages
    for i, weight in enumerate(weights_of_two(*letters)):
        now += weight if i % 2 else 0.0
        for part in range(len(parts)) if i % 2 else reversed(range(len(parts))):
            flow(part, weight)
        now += 0.0 if i % 2 else weight
    return stages


def alternating(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """a1, b1, a2, b2, …"""
    return [x for pair in zip_longest(a, b) for x in pair if x is not None]


def weights_of_two(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """The weights of φ*, φ, φ*, … that for a sum of two parts is the splitting a1, b1, a2, b2, … (McLachlan)."""
    return list(accumulate(alternating(a, b)[:-1], lambda weight, letter: letter - weight))


# places of the constants: time at the start, h, number of stages; then these, numbers
START, TIME_STEP, STAGES = range(3)


@cache
def kernel_of_parts(parts: tuple[Part, ...]) -> Any:
    """One step of any stages; the constants of the parts follow them."""
    timed = any(part.timed for part in parts)

    def flow_of(number: int) -> Any:
        split = parts[number].flow
        program, numbers = machine_code(split.moving), tuple_loader(len(split.fixed.outputs))
        skipped = sum(len(part.flow.fixed.outputs) for part in parts[:number])
        others = flow_of(number + 1) if number + 1 < len(parts) else None

        @jit(inline=True)
        def flow(part, s, t, span, c, first):
            if others is None or part == number:
                return program((t,) + s + (span,), numbers(c, first + skipped))  # noqa: RUF005 - as elsewhere
            return others(part, s, t, span, c, first)

        return flow

    flow = flow_of(0)

    @jit(inline=True)
    def step(s, c, counters):
        first = STAGES + 1 + 3 * int(c[STAGES])
        for i in range(STAGES + 1, first, 3):
            t = c[START] + c[TIME_STEP] * (counters[CLOCK] + c[i + 2]) if timed else 0.0
            s = flow(int(c[i]), s, t, c[i + 1], c, first)
        return s

    return step


def prepare_parts(name: str, problem: Any, h: float) -> FixedStepper:
    """One step of a `Problem` by the flows of its parts."""
    parts, system = problem.parts, problem.system
    stages = [(part, length * h, when) for part, length, when in stages_of(SCHEMES[name], parts)]
    numbers = [v for part in parts for v in part.flow.constants(*problem.numbers)]
    c = np.array((problem.start, h, len(stages), *chain.from_iterable(stages), *numbers))
    step = kernel_of_parts(parts)
    return FixedStepper(name, h, c, step, rhs_per_step=len(stages), size=system.size, timed=system.timed)


def _record(name: str, label: str) -> Method:
    scheme = SCHEMES[name]
    needs: Any = kinds.top if scheme.c else "kinetic" if scheme.nystrom else "parts"
    return Method(
        name=name, label=label, family="splitting", order=scheme.order,
        claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
        source=scheme.source, prepare=partial(prepare, name),
        needs="uniform" if scheme.processor else needs,  # the processor is known in closed form there only
    )  # fmt: skip


STRANG = _record("strang", "Strang")
TAKAHASHI_IMADA = _record("takahashi_imada", "Takahashi–Imada, processed")
BLANES_MOAN4 = _record("blanes_moan4", "Blanes–Moan 4")
FORCE_GRADIENT4 = _record("force_gradient4", "Force gradient 4")
FORCE_GRADIENT6 = _record("force_gradient6", "Force gradient 6")
BLANES_MOAN6 = _record("blanes_moan6", "Blanes–Moan 6")
KAHAN_LI6 = _record("kahan_li6", "Kahan–Li 6")
KAHAN_LI8 = _record("kahan_li8", "Kahan–Li 8")
SOFRONIOU_SPALETTA10 = _record("sofroniou_spaletta10", "Sofroniou–Spaletta 10")
