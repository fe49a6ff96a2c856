"""Splittings: compositions of the two exact flows of H = |J|²/2 + alpha x3.

    A(t), of |J|²/2:    x turns about the constant J at rate |J|
    B(t), of alpha x3:  J += t alpha e3×x with constant x, a kick

Both flows are Poisson maps that conserve J3, |x|² and x·J, and so is every composition of them. H oscillates. A scheme is a list
of coefficients, first letter … last letter. All are palindromes, so the maps are symmetric. Two properties of this H are used.
It is quadratic in J, so [B,[B,[B,A]]] = 0, and coefficients for Runge-Kutta-Nyström equations apply. And [B,[A,B]] and
[B,[B,[A,[A,B]]]] are functions of x. So a kick with force gradients is the exact flow of

    hB b + h³c [B,[A,B]] + h⁵d [B,[B,[A,[A,B]]]],

with the torques `System.commutator_torque` and `System.second_commutator_torque`. Any potential U(x) takes the place of alpha x3.

A scheme ends each step with the flow that begins the next. So the loop repeats a conjugate map, in which the two flows are one.
The stepper's `enter` and `leave` apply the first flow and its inverse.

The rotation. With v = (t/2) J, z = |v|² and u = v×x, p = v×u, r = v×p, the rotation by 2|v| is

    x + 2u + 2p + r + a(z) u + b(z) p,    a = sin(2√z)/√z − 2 + z,   b = (1 − cos 2√z)/z − 2,

where r replaces −zu. Part of the error of z is the same in every step, because v3² is rounded the same way. With r, only the
angle feels this error, and the length of x is kept to higher order. a and b are small, of order z, and so are their errors.
Beyond 2|v| = 1 the turn is made in 2, 4, 8, … equal parts. No library function is called: the bits are the same everywhere.

The coefficients are in `splitting_schemes`. `part_splitting` takes any other Hamiltonian that is a sum of parts with closed
flows.

Sources: with each scheme; McLachlan & Quispel, Acta Numerica 11 (2002) 341; this form of the rotation: this project.
"""

from functools import cache, partial

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.loops import FAILURE, ConjugateStepper, FixedStepper, Kernel, finite
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.methods.part_splitting import prepare_parts
from lagrange_bench.integrators.methods.splitting_schemes import SCHEMES, Scheme
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.vectors import cross

A, B, C, D, STRIDE = range(5)  # places in each group of constants: one rotation, one kick
LARGE = 1e154  # larger numbers have no square in doubles; h is refused long before
TOO_FAR = 1
FAILURES = {TOO_FAR: "the axis turns by more than 256 radians in one part of the step; take a smaller |h|"}


# ------------------------------------------------------------------------------------ the rotation

PART = 0.25  # largest z = (angle/2)² of one part: an angle of 1
MOST = 128.0**2  # largest z of a turn: an angle of 256


@jit(inline=True)
def small_coefficients(z):
    """a/z and b/z of the rotation, 0 <= z <= 1/4; a and b to 3e-19.

    Least squares, with one coefficient rounded after the other, so that the later ones mend the rounding of the earlier. The
    rounded polynomials keep |x|² to 2e-19.
    """
    z2 = z * z
    z4 = z2 * z2
    a = (-0.3333333333333333 + 0.2666666666666631 * z) + z2 * (-0.025396825396671374 + 0.001410934741425644 * z)
    b = (-0.6666666666666666 + 0.08888888888888634 * z) + z2 * (-0.006349206349141372 + 0.00028218694802735093 * z)
    a += z4 * ((-5.1306691152203537e-05 + 1.315420958644531e-06 * z) - 2.470580985210812e-08 * z2)
    b += z4 * ((-8.55111385492195e-06 + 1.8791375066112914e-07 * z) - 3.08449838086915e-09 * z2)
    return a, b


@unrolled
def turn(x, v, a, b, z):
    """The change of x by the rotation about v, |v|² = z; a and b stand for a/z and b/z."""
    u = cross(v, x)
    p = cross(v, u)
    parts = zip(u, p, cross(v, p), strict=True)
    return tuple((2.0 * (u + p) + r) + (a * (z * u) + b * (z * p)) for u, p, r in parts)


@unrolled
def add(x, change):
    return tuple(a + d for a, d in zip(x, change, strict=True))


@jit(inline=True)
def rotate(part, J, x):
    """Whether the angle is small enough, and x turned about v = part·J, |v| half the angle."""
    v = part * J[0], part * J[1], part * J[2]
    z = (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]
    parts = 1
    if z > PART:
        if not z <= MOST:
            return False, x
        while z > PART:
            v, z, parts = (0.5 * v[0], 0.5 * v[1], 0.5 * v[2]), 0.25 * z, 2 * parts
    a, b = small_coefficients(z)
    x = add(x, turn(x, v, a, b, z))
    for _ in range(1, parts):
        x = add(x, turn(x, v, a, b, z))
    return True, x


# ------------------------------------------------------------------------------------ the step


@cache
def torques(system: System, gradients: int) -> Compiled:
    """(x, q, weights) → the torques of U(t, x) and of the first `gradients` force gradients, times their weights; q = (t, *p)."""
    programs = (system.torque, system.commutator_torque, system.second_commutator_torque)[: gradients + 1]

    @unrolled
    def total(x, q, weights):
        t = tuple(weights[0] * v for v in programs[0](*x, *q))
        for weight, program in zip(weights[1:], programs[1:], strict=False):
            t = tuple(v + weight * w for v, w in zip(t, program(*x, *q), strict=True))
        return t

    return total


@cache
def kernel(system: System, gradients: int) -> Compiled:
    """One step of |J|²/2 + U(x): rotation and kick for each group of constants, four and then t and the parameters."""
    kick, numbers, conserves_J3 = torques(system, gradients), tuple_loader(1 + system.parameters), 2 in system.constant
    stride = STRIDE + 1 + system.parameters

    @jit(inline=True)
    def step(s, c, counters):
        J1, J2, J3, x1, x2, x3 = s  # a tuple that a loop changes would cost twice the time
        for i in range(0, len(c), stride):
            is_turned, (x1, x2, x3) = rotate(c[i + A], (J1, J2, J3), (x1, x2, x3))
            if not is_turned:
                counters[FAILURE] = TOO_FAR
                return s
            change = kick((x1, x2, x3), numbers(c, i + STRIDE), (c[i + B], c[i + C], c[i + D]))
            J1, J2, J3 = add((J1, J2, J3), change)
            if conserves_J3:
                J3 = s[2]
        return J1, J2, J3, x1, x2, x3

    return step


@cache
def groups(scheme: Scheme) -> tuple[Array, Array]:
    """The step that is repeated, as groups (a, b, c, d) of a rotation and a kick; and the flow that begins the scheme.

    A B A … B A becomes (A² B)(A B) …, entered by A⁻¹. B A B … A B becomes (A B) … (A B²), entered by B.
    """
    zeros = (0.0,) * len(scheme.b)
    rotations, kicks = np.array(scheme.a), np.column_stack((scheme.b, scheme.c or zeros, scheme.d or zeros))
    first = np.zeros(STRIDE)
    if scheme.first == "A":
        first[A] = -rotations[0]
        rotations = np.append(rotations[0] + rotations[-1], rotations[1:-1])
    else:
        first[B:] = kicks[0]
        kicks = np.vstack((kicks[1:-1], kicks[0] + kicks[-1]))
    return np.column_stack((rotations, kicks)), first[None]


def scale_groups(groups: Array, scales: Array, numbers: Array) -> Array:
    """The groups of coefficients, times `scales`, each followed by `numbers`, in one row."""
    parts = np.empty((len(groups), STRIDE + len(numbers)))
    with np.errstate(all="ignore"):  # 0 · ∞ is not a number: a coefficient that vanishes has no scale
        parts[:, :STRIDE] = np.where(groups == 0.0, 0.0, groups * scales)
    parts[:, STRIDE:] = numbers
    return parts.ravel()


def prepare(name: str, problem: Problem, y0: Array, h: float) -> FixedStepper:
    """A stepper for |J|²/2 + U(x), or for the parts of any other problem."""
    if not kinds.top(problem):
        return prepare_parts(name, problem, h)
    scheme, system, numbers = SCHEMES[name], problem.system, np.array((problem.start, *problem.numbers))
    gradients = bool(scheme.c) + bool(scheme.d)
    scales = np.array((0.5 * h, h, -h * (h * h), h * min(h * h, LARGE) ** 2))
    steps, first = groups(scheme)
    parts = (steps, scales), (first, scales), (first, -scales)
    constants, preprocess, postprocess = (scale_groups(*part, numbers) for part in parts)
    if not (finite(constants) and finite(preprocess)):
        raise StepError(name, "the coefficients of the step are beyond the range of doubles", h=h)
    step = kernel(system, gradients)
    return ConjugateStepper(
        name,
        h,
        Kernel(step, failures=FAILURES, rhs_per_step=len(steps)),
        constants,
        conversion=step,
        preprocess=preprocess,
        postprocess=postprocess,
    )


def _method(name: str, label: str) -> Method:
    scheme = SCHEMES[name]
    return Method(
        name=name,
        label=label,
        family="splitting",
        order=scheme.order,
        claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
        source=scheme.source,
        prepare=partial(prepare, name),
        needs=kinds.top if scheme.c else "kinetic" if scheme.is_nystrom else "parts",
    )


STRANG = _method("strang", "Strang")
BLANES_MOAN4 = _method("blanes_moan4", "Blanes–Moan 4")
FORCE_GRADIENT4 = _method("force_gradient4", "Force gradient 4")
FORCE_GRADIENT6 = _method("force_gradient6", "Force gradient 6")
BLANES_MOAN6 = _method("blanes_moan6", "Blanes–Moan 6")
KAHAN_LI8 = _method("kahan_li8", "Kahan–Li 8")
