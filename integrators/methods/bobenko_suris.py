"""The discrete Lagrange top of Bobenko and Suris: explicit, Poisson and integrable, with an energy of its own.

Kicks and rotations as in a splitting, but the rotation about K is the Cayley transform, by 2 atan(h|K|/2), not h|K|:

    K = J + (h/2) alpha e3×x        x̃ − x = (h/2) K×(x + x̃)        J̃ = K + (h/2) alpha e3×x̃

Then alpha e3·(x̃ − x) = −½ K·(K₊ − K₋), K± being the K of the next step and of the one before, and the sum telescopes: besides
J3, C1 and C2 the map keeps

    E = ½ K·K₋ + alpha x3 = H − (h²/8) |alpha e3×x|²,        so that |H − E| ≤ h² alpha² C1/8 for ever.

An exact rotation would turn alpha e3·(x̃ − x) into a quotient that depends on |K|, and nothing telescopes. The authors'
own variables are (K₋, x), half a kick earlier: J̃ = J + h alpha e3×x, then x̃ from J̃. That form is conjugate to this one, of
order 1, not symmetric, and keeps H + (h/2) J·(alpha e3×x).

Round-off is a random walk because no product is formed of constants alone: (h/2) J3, J3² or alpha h²/4 would err the same way in
every step, and C1, C2 and E would drift in proportion to time. Hence |K|² = (K1 − J3)² + K2² + 2 K1 J3.

In any field the kicks are (h/2) ∇U(x)×x; the map is Poisson and symmetric, and no energy of its own is known. The rotation is
written as in `lie_group`, where a relative error of 1 + (h/2)²|K|² does not change |x| to first order.

Source: Bobenko & Suris, Commun. Math. Phys. 204 (1999) 147, the discrete Lagrange top in the rest frame; symmetric form
and its energy: this project.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.methods.lie_group import add, cross, dot, times
from lagrange_bench.integrators.methods.lie_group import turn as rotated
from lagrange_bench.integrators.problem.field import Field
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units

HALF, KICK = range(2)  # places of the constants h/2 and alpha h/2


@jit
def turn(K1, K2, J3, x, k):
    """x̃ − x where x̃ − x = k K×(x + x̃): 2k (u + k K×u)/(1 + k²|K|²) with u = K×x."""
    K = K1, K2, J3
    u = cross(K, x)
    t, w2 = k * (K1 - J3), k * K2
    q = (2.0 * k) / ((1.0 + (t * t + w2 * w2)) + (2.0 * k) * (k * (K1 * J3)))
    return times(q, add(u, k, cross(K, u)))


@jit
def step(s, c, counters):
    J1, J2, J3, x1, x2, x3 = s
    k, kick = c[HALF], c[KICK]
    d1, d2, d3 = turn(J1 - kick * x2, J2 + kick * x1, J3, (x1, x2, x3), k)
    return J1 - kick * (2.0 * x2 + d2), J2 + kick * (2.0 * x1 + d1), J3, x1 + d1, x2 + d2, x3 + d3


@cache
def kernel_in_field(field: Field, conserves_J3: bool) -> Any:
    """The step in a field; constants: h, then alpha and the parameters of the potential. `conserves_J3`: the field keeps J3."""
    torque, numbers = machine_code(field.torque), tuple_loader(field.parameters)

    @jit(inline=True)
    def kicked(J, k, t):
        return J[0] + k * t[0], J[1] + k * t[1], J[2] if conserves_J3 else J[2] + k * t[2]

    @jit(inline=True)
    def step(s, c, counters):
        x, q, k = (s[3], s[4], s[5]), numbers(c, 1), 0.5 * c[0]
        J = kicked((s[0], s[1], s[2]), k, torque(x, q))
        v = k * J[0], k * J[1], k * J[2]
        x = rotated(v, 1.0 / (1.0 + dot(v, v)), x)
        J = kicked(J, k, torque(x, q))
        return J[0], J[1], J[2], x[0], x[1], x[2]

    return step


def prepare(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Any h."""
    units = Units(top, y0, h)
    half = units.time(h) / 2
    c = np.array((half, half * units.alpha))
    return FixedStepper("bobenko_suris", h, c, step, enter=units.enter, leave=units.leave)


def prepare_in_field(top: PerturbedTop, y0: Array, h: float) -> FixedStepper:
    """As `prepare`; the kicks are those of the whole potential, and no energy of its own is known."""
    kernel = kernel_in_field(top.field, "J3" in top.conserved)
    return FixedStepper("bobenko_suris", h, np.array((h, *top.numbers)), kernel)


def energy(top: LagrangeTop, h: float, y: Array) -> tuple[Array, float]:
    """H − (h²/8) alpha² (x1² + x2²)."""
    kick = h / 2 * top.alpha
    rate, length, _ = top.scales(y[0])
    values = top.invariants(y)[:, 0] - kick * kick / 2 * (y[:, 3] ** 2 + y[:, 4] ** 2)
    return values, (rate * rate + (kick * length) ** 2) / 2


METHOD = Method(
    name="bobenko_suris", label="Bobenko–Suris", family="integrable", order=2,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}, conserves_own={"E": energy}),
    source="Bobenko and Suris, Commun. Math. Phys. 204 (1999) 147, in symmetric form", prepare=prepare_in_field,
    needs="force",
    kernels_for={"uniform": prepare},  # the general kernel costs 1.3 times as much there
)  # fmt: skip
