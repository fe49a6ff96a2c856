"""The discrete Lagrange top of Bobenko and Suris: explicit, Poisson and integrable, with an energy of its own.

A step is a kick, a rotation, a kick, as in a splitting. But the rotation about K is the Cayley transform, by 2 atan(h|K|/2):

    K = J + (h/2) alpha e3×x        x̃ − x = (h/2) K×(x + x̃)        J̃ = K + (h/2) alpha e3×x̃

With K₊ of the next step and K₋ of the one before, alpha e3·(x̃ − x) = −½ K·(K₊ − K₋), and the sum over the steps telescopes. So
besides J3, C1 and C2 the map conserves

    E = ½ K·K₋ + alpha x3 = H − (h²/8) |alpha e3×x|²,        so that |H − E| ≤ h² alpha² C1/8 for ever.

With the exact rotation alpha e3·(x̃ − x) is a quotient that depends on |K|, and nothing telescopes. The authors' variables are
(K₋, x), half a kick earlier: J̃ = J + h alpha e3×x, then x̃ from J̃. That form is conjugate to this one. It has order 1, is not
symmetric, and conserves H + (h/2) J·(alpha e3×x).

In any field the kicks are (h/2) ∇U(x)×x. The map is Poisson and symmetric, and no energy of its own is known.

The rotation is written as in `lie_group`: a relative error of 1 + (h/2)²|K|² does not change |x| to first order. Still C1 drifts
in proportion to time: in the top `figure1`, with h|J| about 1, by at most 0.01 ulps a step.

Source: Bobenko & Suris, Commun. Math. Phys. 204 (1999) 147, the discrete Lagrange top in the rest frame; symmetric form
and its energy: this project.
"""

from functools import cache

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.methods.gauss import check_span
from lagrange_bench.integrators.methods.lie_group import dot, turn
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop

LONGEST = 100.0  # largest |h|, in time scales of the top: the Cayley transform loses digits of |x| like h²


@cache
def kernel(system: System) -> Compiled:
    """The step of |J|²/2 + U(x); constants: h, then t and the parameters."""
    torque, numbers = machine_code(system.torque), tuple_loader(1 + system.parameters)
    conserves_J3 = 2 in system.constant

    @jit(inline=True)
    def kick(J, k, t):
        return J[0] + k * t[0], J[1] + k * t[1], J[2] if conserves_J3 else J[2] + k * t[2]

    @jit(inline=True)
    def step(s, c, counters):
        x, q, k = s[3:], numbers(c, 1), 0.5 * c[0]
        J = kick(s[:3], k, torque(x, q))
        v = k * J[0], k * J[1], k * J[2]
        x = turn(v, 1.0 / (1.0 + dot(v, v)), x)
        J = kick(J, k, torque(x, q))
        return J + x

    return step


def prepare(problem: Problem, y0: Array, h: float) -> FixedStepper:
    """Any |h| up to LONGEST time scales. An energy of its own is known only in a uniform field."""
    check_span("bobenko_suris", abs(h) / problem.scales(y0)[2], h, LONGEST)
    return FixedStepper("bobenko_suris", h, kernel(problem.system), np.array((h, problem.start, *problem.numbers)))


def energy(top: LagrangeTop, h: float, y: Array) -> tuple[Array, float]:
    """E = H − (h²/8) alpha² (x1² + x2²) of states (N, 6), and the size of its terms."""
    kick = h / 2 * top.alpha
    rate, length, _ = top.scales(y[0])
    values = top.invariants(y)[:, 0] - kick * kick / 2 * (y[:, 3] ** 2 + y[:, 4] ** 2)
    return values, (rate * rate + (kick * length) ** 2) / 2


METHOD = Method(
    name="bobenko_suris",
    label="Bobenko–Suris",
    family="integrable",
    order=2,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}, conserves_own={"E": energy}),
    source="Bobenko and Suris, Commun. Math. Phys. 204 (1999) 147, in symmetric form",
    prepare=prepare,
    needs=kinds.top,
)
