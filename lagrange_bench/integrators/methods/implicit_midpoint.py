"""The implicit midpoint rule ỹ = y + h f((y + ỹ)/2), solved to round-off.

In a uniform field the midpoint (J̄, x̄) satisfies J̄ = J + (h/2) alpha e3×x̄ and x̄ = x + (h/2) J̄×x̄. J̄3 = J3 is known. For
given v = (h/2) J̄ the second equation is a Cayley transform: x̄ = x + d, d = (v×x + v×(v×x))/(1 + |v|²). One equation for (v1,
v2) is left, v = F(v). F contracts by L = h²|alpha||x|/4, because the Cayley transform and its inverse lengthen nothing. So for
L < 1 the step is unique. For any h, eliminating J̄1, J̄2, x̄1 and x̄2 leaves one cubic for x̄3, with all its real roots in
[−|x|, |x|]. If it has three, the step is not unique, and is refused.

In any other field the rule is Gauss collocation with one stage, by the kernel of `gauss`.

All four invariants are linear or quadratic, and conserved, as by every Gauss method. The map is symmetric, not Poisson.

Round-off. In x̃ = x + d + v×x̄ a relative error of 1 + |v|² does not change |x̃| to first order. (Its constant part v3² is
rounded the same way in every step.) In x + 2d it does, and |x|² would drift in proportion to time. The iteration goes on until
it stagnates: the rest that a tolerance leaves has a direction, and drifts, too.

Sources: Hairer, Lubich & Wanner, Geometric Numerical Integration, sections II.1.1 and IV.2.1; reduction and cubic: this project.
"""

import math

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import FAILURE, ITERATIONS, RESIDUAL, RHS_EVALS, FixedStepper, Kernel
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.methods.gauss import check_span, stepper
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.vectors import cross, dot

ALPHA, H, LARGE = range(3)  # places of the constants
LONGEST = 100.0  # largest |h|, in time scales of the top: the solution's errors of the invariants grow like h²
LIMIT = 500  # iterations; the fixed point takes 5 to 20, Newton 3 to 6
NOT_CONVERGED, NOT_UNIQUE = 1, 2
FAILURES = {
    NOT_CONVERGED: f"the midpoint equation is not solved after {LIMIT} iterations; take a smaller |h|",
    NOT_UNIQUE: "the midpoint equation has three solutions; take a smaller |h|",
}
# Below this contraction the fixed point is as quick as Newton, and stagnates within half an ulp of the solution. Above, it stops
# an ulp or more before the solution, on the side it comes from.
WEAK = 2.0**-8


@unrolled
def cayley(x, v):
    """u = v×x, d = (1 − v×)⁻¹ u and q = 1/(1 + |v|²)."""
    u, q = cross(v, x), 1.0 / (1.0 + dot(v, v))
    return u, tuple(q * (a + b) for a, b in zip(u, cross(v, u), strict=True)), q


@unrolled
def newton_correction(x1, x2, x3, v1, v2, v3, q, k, r1, r2):
    """(1 − F')⁻¹ r at v, where x̄ = (x1, x2, x3); δx̄ = q (b + v×b + v (v·b)) for b = δv×x̄, δF = k e3×δx̄."""
    t = v3 * x2 - v2 * x3
    a1 = q * (v2 * x2 + v3 * x3 + v1 * t)
    a2 = q * (v2 * t - x3 - v1 * x2)
    t = v1 * x3 - v3 * x1
    b1 = q * (x3 - v2 * x1 + v1 * t)
    b2 = q * (v3 * x3 + v1 * x1 + v2 * t)
    m11, m12, m21, m22 = 1.0 + k * a2, k * b2, -k * a1, 1.0 - k * b1
    r = 1.0 / (m11 * m22 - m12 * m21)
    return (m22 * r1 - m12 * r2) * r, (m11 * r2 - m21 * r1) * r


@jit(inline=True)
def solve(s, c, counters, is_newton, v1, v2):
    """One step, from a first guess of v1 and v2; by Newton's method or the fixed point."""
    J1, J2, J3, x1, x2, x3 = s
    half = 0.5 * c[H]
    kick = half * c[ALPHA]
    v3 = half * J3
    # a change that has stopped falling is round-off only if it is this small
    threshold = 2.0**-45 * (abs(v1) + abs(v2) + abs(half * kick) * (abs(x1) + abs(x2) + abs(x3)))
    norm = last = math.inf
    for i in range(LIMIT):
        u, d, q = cayley((x1, x2, x3), (v1, v2, v3))
        d1, d2, d3 = d
        r1 = half * (J1 - kick * (x2 + d2)) - v1
        r2 = half * (J2 + kick * (x1 + d1)) - v2
        norm = abs(r1) + abs(r2)
        if norm == 0.0 or (norm >= last and norm <= threshold):
            counters[ITERATIONS] += i + 1
            counters[RHS_EVALS] += i + 1
            break
        last = norm
        if is_newton:
            r1, r2 = newton_correction(x1 + d1, x2 + d2, x3 + d3, v1, v2, v3, q, half * kick, r1, r2)
        v1 += r1
        v2 += r2
    else:
        counters[FAILURE] = NOT_CONVERGED
        counters[RESIDUAL] = norm
    return image(s, 2.0 * kick, u, d, (v1, v2, v3))


@unrolled
def image(s, kick, u, d, v):
    J1, J2, J3, *x = s
    e = tuple(a + b for a, b in zip(u, cross(v, d), strict=True))  # v × x̄, equal to d but for round-off
    m1, m2 = (x[i] + 0.5 * (d[i] + e[i]) for i in (0, 1))
    return J1 - kick * m2, J2 + kick * m1, J3, *((a + b) + c for a, b, c in zip(x, d, e, strict=True))


@unrolled
def explicit_guess(s, alpha, h):
    J1, J2, _, x1, x2, _ = s
    half = 0.5 * h
    return half * (J1 - half * alpha * x2), half * (J2 + half * alpha * x1)


@jit(inline=True)
def cubic_guess(s, c, counters):
    """v1, v2 from the root z = x̄3 of ((1 − az)² + b²)(z − x3) + gz + k, where x̄1 + i x̄2 = (X − i half Jz)/(1 − az − ib)."""
    J1, J2, J3, x1, x2, x3 = s
    half = 0.5 * c[H]
    a, b = half * half * c[ALPHA], half * J3
    turn = J1 * x2 - J2 * x1
    g = half * (half * (J1 * J1 + J2 * J2) - a * turn)
    k = a * (x1 * x1 + x2 * x2) - half * (turn + b * (J1 * x1 + J2 * x2))
    # three solutions: the cubic falls from above zero to below between two turning points
    p2, p1 = -a * (2.0 + a * x3), 1.0 + b * b + 2.0 * a * x3 + g
    w = p2 * p2 - 3.0 * a * a * p1
    if w > 0.0:
        peak = (-p2 - math.sqrt(w)) / (3.0 * a * a)
        valley = (-p2 + math.sqrt(w)) / (3.0 * a * a)
        if cubic(peak, a, b, x3, g, k)[0] > 0.0 and cubic(valley, a, b, x3, g, k)[0] < 0.0:
            counters[FAILURE] = NOT_UNIQUE
    high = 1.001 * math.sqrt(x1 * x1 + x2 * x2 + x3 * x3)
    low, z = -high, x3
    for _ in range(200):
        value, slope = cubic(z, a, b, x3, g, k)
        low, high = (low, z) if value > 0.0 else (z, high)
        new = z - value / slope
        if not low < new < high:
            new = 0.5 * (low + high)
        if new == z or high - low <= 2.0**-50 * abs(z):
            break
        z = new
    u = 1.0 - a * z
    r = 1.0 / (u * u + b * b)
    n1, n2 = x1 + half * J2 * z, x2 - half * J1 * z
    y1, y2 = (n1 * u - n2 * b) * r, (n2 * u + n1 * b) * r
    return half * J1 - a * y2, half * J2 + a * y1


@unrolled
def cubic(z, a, b, x3, g, k):
    u = 1.0 - a * z
    w = u * u + b * b
    return w * (z - x3) + g * z + k, w - 2.0 * a * u * (z - x3) + g


@jit(inline=True)
def fixed_point_step(s, c, counters):
    return solve(s, c, counters, False, *explicit_guess(s, c[ALPHA], c[H]))


@jit(inline=True)
def newton_step(s, c, counters):
    guess = cubic_guess(s, c, counters) if c[LARGE] else explicit_guess(s, c[ALPHA], c[H])
    return solve(s, c, counters, True, *guess)


def prepare(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Every step is iterated until it stagnates: by the fixed point for h²|alpha||x| < 1/64, else by Newton's method."""
    check_span("implicit_midpoint", abs(h) * top.scales(y0)[0], h, LONGEST)
    contraction = 0.25 * h * h * abs(top.alpha) * math.hypot(*y0[3:])
    c = np.array((top.alpha, h, contraction >= 0.25))
    kernel = fixed_point_step if contraction < WEAK else newton_step
    return FixedStepper("implicit_midpoint", h, Kernel(kernel, failures=FAILURES), c)


def prepare_in_field(problem: Problem, y0: Array, h: float) -> FixedStepper:
    """The steps for any problem: Gauss collocation with one stage."""
    return stepper("implicit_midpoint", 1, problem, y0, h)


METHOD = Method(
    name="implicit_midpoint",
    label="Implicit midpoint",
    family="implicit",
    order=2,
    claims=Claims(symmetric=True, conserves={"J3", "C1", "C2"}, conserves_if_quadratic={"H"}),
    source="Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), II.1.1 and IV.2.1",
    prepare=prepare_in_field,
    needs="rhs",
    # In a uniform field one cubic equation solves the step, and shows whether it is unique. The general kernel costs 4.8 times
    # as much there.
    kernels_for={"uniform": prepare},
)
