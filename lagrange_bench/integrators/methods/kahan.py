"""The discretisation of Kahan, Hirota and Kimura: every product is polarised, xy → (x ỹ + x̃ y)/2.

    (J̃ − J)/h = alpha e3 × (x + x̃)/2        (x̃ − x)/h = (J̃×x + J×x̃)/2

The new state enters linearly, and h → −h exchanges y and ỹ. So the step is explicit, birational and symmetric. Let d = x̃ − x,
eps = alpha h²/4 and W = J + (h/2) alpha e3×x. Then the third equation gives d3, and two equations are left:

    d = h W×x + (h/2) W×d + eps (x3 d1 − x1 d3, x3 d2 − x2 d3, 0).

The map is known to be integrable in the frame of the body. In the rest frame it conserves J3 and

    e     = J1² + J2² + 2 alpha x3 − eps alpha (x1² + x2²)        ρ = (h/2) r0
    r0    = x·J / (1 − eps x3)                                   κ = (|x|² + ρ²) / (1 + |(h/2) J + eps ρ e3|²)

which tend to 2H − J3², C2 and C1, and the volume dJ dx/[(1 − eps x3)(|x|² + ρ²)]. e is twice the energy of Bobenko and Suris'
map, minus J3². H, C1 and C2 oscillate, and the map is not Poisson for the bracket of the top.

A step is refused where it has passed a pole of the map, because orbits no longer follow the top there: eps x3 ≥ 1, or the
determinant of the step is not positive.

In a uniform field no two constants are multiplied: (h/2) J3 or alpha h²/4 would have the same rounding error in every step, and e
and r0 would drift in proportion to time. So the code has k (J3 − …) and k (alpha k x3), k = h/2. Round-off is then a random walk
in short steps. In longer ones, such as h|J| = 0.4 or 1, e, r0 and κ drift by some 0.01 ulps a step.

In any quadratic potential ỹ = y + h (1 − (h/2) f'(y))⁻¹ f(y). With the torque T(x) = ∇U×x and its derivative T', eliminating J̃
leaves D d = h W×x, where D = 1 − k J× + k² x× T' and W = J + k T. A real eigenvalue of D that is not positive shows that a pole
has been passed, and the step is refused. Poles of invariants, such as eps x3 = 1, are not known there. J3 is conserved where the
top conserves it.

Sources: Kahan, lecture notes (1993, unpublished); Kimura & Hirota, J. Phys. Soc. Japan 69 (2000) 3193; Petrera, Pfadler &
Suris, Regul. Chaotic Dyn. 16 (2011) 245 (body frame). Rest frame, e, r0, κ and the volume: this project; the tests prove
them in rational arithmetic.
"""

from functools import cache

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import FAILURE, FixedStepper, Kernel
from lagrange_bench.integrators.compiling.tape import with_slopes
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.methods.lie_group import add, cross, dot, times
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units

HALF, KICK = range(2)  # places of the constants h/2 and alpha h/2
BEYOND, BEYOND_IN_FIELD = 1, 2
FAILURES = {
    BEYOND: "the orbit or the step has passed a pole of the map, as for h² alpha x3 ≥ 4; take a smaller |h|",
    BEYOND_IN_FIELD: "the step has passed a pole of the map; take a smaller |h|",
}


@jit
def step(s, c, counters):
    J1, J2, J3, x1, x2, x3 = s
    k, kick = c[HALF], c[KICK]
    W1, W2 = J1 - kick * x2, J2 + kick * x1
    v1, v2 = k * J1, k * J2
    w1, w2 = k * W1, k * W2
    # With d3 = h (W×x)3 + w1 d2 − w2 d1 the others are a d1 + b d2 = h g1, −f d1 + g d2 = h g2.
    margin = 1.0 - k * (kick * x3)
    a, b = margin + v2 * w2, k * (J3 - v2 * W1)
    f, g = k * (J3 + v1 * W2), margin + v1 * w1
    det = a * g + b * f
    if not (margin > 0.0 and det > 0.0):
        counters[FAILURE] = BEYOND
        return s
    u3 = W1 * x2 - W2 * x1
    g1 = (W2 * x3 - J3 * x2) + v2 * u3
    g2 = (J3 * x1 - W1 * x3) - v1 * u3
    r = (2.0 * k) / det
    d1 = r * (g * g1 - b * g2)
    d2 = r * (a * g2 + f * g1)
    d3 = (2.0 * k) * u3 + (w1 * d2 - w2 * d1)
    return J1 - kick * (2.0 * x2 + d2), J2 + kick * (2.0 * x1 + d1), J3, x1 + d1, x2 + d2, x3 + d3


@cache
def kernel_in_field(system: System) -> Compiled:
    """The step of |J|²/2 + U(x) with a quadratic U; constants: h, then t and the parameters."""
    slopes, numbers = machine_code(with_slopes(system.torque, 3)), tuple_loader(1 + system.parameters)
    conserves_J3 = 2 in system.constant

    @jit(inline=True)
    def step(s, c, counters):
        J, x, k = s[:3], s[3:], 0.5 * c[0]
        f = slopes(x, numbers(c, 1))
        t, m1, m2, m3 = f[:3], f[3:6], f[6:9], f[9:]
        # columns of D = 1 − k J× + k² x× T'
        v = times(k, J)
        d1, d2 = times(k, cross(x, times(k, m1))), times(k, cross(x, times(k, m2)))
        d3 = times(k, cross(x, times(k, m3)))
        d1 = 1.0 + d1[0], d1[1] - v[2], d1[2] + v[1]
        d2 = d2[0] + v[2], 1.0 + d2[1], d2[2] - v[0]
        d3 = d3[0] - v[1], d3[1] + v[0], 1.0 + d3[2]
        p1, p2, p3 = cross(d2, d3), cross(d3, d1), cross(d1, d2)
        det = dot(d1, p1)
        if not (det > 0.0 and p1[0] + p2[1] + p3[2] > 0.0 and d1[0] + d2[1] + d3[2] > 0.0):
            counters[FAILURE] = BEYOND_IN_FIELD
            return s
        r, w = (2.0 * k) / det, cross(add(J, k, t), x)
        e1, e2, e3 = r * dot(p1, w), r * dot(p2, w), r * dot(p3, w)
        J = add(J, k, add(add(add(times(2.0, t), e1, m1), e2, m2), e3, m3))
        if conserves_J3:
            J = J[0], J[1], s[2]
        return *J, x[0] + e1, x[1] + e2, x[2] + e3

    return step


def prepare_in_field(problem: Problem, y0: Array, h: float) -> FixedStepper:
    """The steps in any quadratic potential, up to a pole of the map."""
    c = np.array((h, problem.start, *problem.numbers))
    return FixedStepper("kahan", h, Kernel(kernel_in_field(problem.system), failures=FAILURES), c)


def prepare(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """The steps in a uniform field, up to a pole of the map."""
    units = Units(top, y0, h)
    half = units.time(h) / 2
    c = np.array((half, half * units.alpha))
    return FixedStepper("kahan", h, Kernel(step, failures=FAILURES), c, units)


def e(top: LagrangeTop, h: float, y: Array) -> tuple[Array, float]:
    """e = J1² + J2² + 2 alpha x3 − alpha² h²/4 (x1² + x2²) of states (N, 6), and the size of its terms."""
    J1, J2, _, x1, x2, x3 = y.T
    kick = h / 2 * top.alpha
    rate, length, _ = top.scales(y[0])
    values = J1 * J1 + J2 * J2 + 2 * top.alpha * x3 - kick * kick * (x1 * x1 + x2 * x2)
    return values, rate * rate + (kick * length) ** 2


def r0(top: LagrangeTop, h: float, y: Array) -> tuple[Array, float]:
    """r0 = x·J/(1 − eps x3) of states (N, 6), and the size of its terms."""
    margin = 1 - h * h / 4 * top.alpha * y[:, 5]
    rate, length, _ = top.scales(y[0])
    return np.sum(y[:, :3] * y[:, 3:], axis=1) / margin, length * rate / abs(margin[0])


def kappa(top: LagrangeTop, h: float, y: Array) -> tuple[Array, float]:
    """κ = (|x|² + ρ²)/(1 + |(h/2) J + eps ρ e3|²) of states (N, 6), and its size: it is a quotient of sums of squares."""
    rho = h / 2 * r0(top, h, y)[0]
    v = h / 2 * y[:, :3]
    v[:, 2] += h * h / 4 * top.alpha * rho
    values = (np.sum(y[:, 3:] ** 2, axis=1) + rho**2) / (1 + np.sum(v * v, axis=1))
    return values, float(values[0])


METHOD = Method(
    name="kahan",
    label="Kahan–Hirota–Kimura",
    family="integrable",
    order=2,
    claims=Claims(symmetric=True, conserves={"J3"}, conserves_own={"e": e, "r0": r0, "kappa": kappa}),
    source="Kimura and Hirota, J. Phys. Soc. Japan 69 (2000) 3193; in the rest frame: this project",
    prepare=prepare_in_field,
    needs=kinds.quadratic_top,
    # in a uniform field the general kernel would let kappa drift, by 40 000 ulps in 10⁵ steps
    kernels_for={"uniform": prepare},
)
