"""The contraction of the two-site Gaudin magnet to the top (paper, section 2, (2.15)–(2.21); section 5.2).

Sites 0 and ε, J = s_1 + s_2, x = ε s_2. Some equations are exact at every ε (`E`), others hold in the limit (`L`):

    E  L_G(u) = alpha σ3 + σ·J/u + σ·x/(u(u − ε))                       L  x/u²: the remainder is O(ε), against (2.18)
    E  {J_k, J_l} = J_m, {J_k, x_l} = x_m, {x_k, x_l} = ε x_m           L  {x, x} = 0: e(3) instead of o(4), (2.20)
    E  s_2² = C1/ε², s_1² = |J|² − 2 C2/ε + C1/ε²                       L  C1 and C2 central: at finite ε, ε²s_2² = C1
       and x·J − (ε/2)|J|² = (s_2² − s_1²) ε/2 are
    E  2H = ε H_2 + s_1² + s_2², H_1 + H_2 = 2 alpha J3: the top's flow is that of (ε/2) H_2, with the bracket of o(4)
    L  the one- and two-point maps, with λ and the sheet of site 1 (the second, `site=1`): u²v → m = √Q, +√C1 at 0

Every limit has an error O(ε). The contraction of the generating function is in `generating_functions`.
"""

from random import Random
from typing import Any

import numpy as np

from lagrange_bench.integrators.paper import gaudin_maps
from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from lagrange_bench.integrators.paper.lax import pauli, spectral_curve
from lagrange_bench.integrators.paper.one_point import one_point
from lagrange_bench.integrators.paper.phase_space import E3, Numbers, dot, poisson_tensor, vector_field
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.torus.any_parameter import two_point

SITE = 1  # the second site: its sheets are the sheets of the top


def to_magnet(top: LagrangeTop, y: Any, eps: Any) -> tuple[GaudinMagnet, Numbers]:
    """The magnet with sites 0, ε and its spins s_1 = J − x/ε, s_2 = x/ε for a state (6,) of the top; (2.20).

    ValueError for eps = 0.
    """
    if not abs(eps) > 0:
        raise ValueError(f"eps must not be 0; got {eps!r}")
    y = np.asarray(y)
    J, x = y[..., :3], y[..., 3:]
    return GaudinMagnet((0 * eps, eps), top.alpha), np.stack((J - x / eps, x / eps), axis=-2)


def from_magnet(spins: Any, eps: Any) -> Numbers:
    """The state (J, x) = (s_1 + s_2, ε s_2) of the top, shape (..., 6); (2.20)."""
    spins = np.asarray(spins)
    return np.concatenate((spins[..., 0, :] + spins[..., 1, :], eps * spins[..., 1, :]), axis=-1)


def lax_vector(top: LagrangeTop, y: Any, u: Any, eps: Any = 0) -> Numbers:
    """ℓ(u) = alpha e3 + J/u + x/(u(u − ε)), exact for the magnet; for ε = 0 it is ℓ(u) of the top. (2.18) corrected."""
    y = np.asarray(y)
    return top.alpha * E3 + y[..., :3] / u + y[..., 3:] / (u * (u - eps))


def bracket(y: Any, eps: Any = 0) -> Numbers:
    """The Poisson tensor (6, 6) of (J, x) at finite ε: that of the top except {x_k, x_l} = ε x_m. (2.20) corrected."""
    P = poisson_tensor(y)
    P[3:, 3:] = eps * poisson_tensor(np.asarray(y)[3:])
    return P


def casimirs(y: Any, eps: Any = 0) -> tuple[Any, Any]:
    """The two central functions at finite ε: |x|² and x·J − (ε/2)|J|²; for ε = 0 C1 and C2."""
    y = np.asarray(y)
    J, x = y[..., :3], y[..., 3:]
    return dot(x, x), dot(x, J) - eps / 2 * dot(J, J)


def energy(magnet: GaudinMagnet, spins: Any) -> Any:
    """H of the top, (ε H_2 + s_1² + s_2²)/2, exact at every ε."""
    eps = magnet.sites[1] - magnet.sites[0]
    return (eps * magnet.hamiltonians(spins)[..., 1] + np.sum(magnet.casimirs(spins), axis=-1)) / 2


def deviations(top: LagrangeTop, y: Any, lam: complex, eps: float) -> dict[str, float]:
    """The largest differences between the magnet at one ε and the limit, in double. Each is O(ε).

    y : real. lam : also the u of the Lax matrix and the curve, Im > 0.
    """
    y = np.asarray(y, dtype=float)
    magnet, spins = to_magnet(top, y, eps)
    ell = magnet.vector(spins, lam)
    flow = from_magnet(magnet.rhs(spins, (0.0, eps / 2)), eps)
    two = gaudin_maps.two_point(magnet, spins, lam, site=SITE)
    one = gaudin_maps.one_point(magnet, spins, lam, site=SITE)
    pairs = {
        "Lax matrix": (ell, lax_vector(top, y, lam)),
        "bracket": (bracket(y, eps), bracket(y)),
        "Casimir x·J": (casimirs(y, eps)[1], casimirs(y)[1]),
        "spectral curve": (dot(ell, ell), -spectral_curve(top, y, lam)),
        "flow": (flow, vector_field(top, y)),
        "one-point map": (from_magnet(one, eps), one_point(top, y, lam)),
        "two-point map": (from_magnet(two, eps), two_point(top, y, lam)),
    }
    return {name: float(np.max(np.abs(a - b))) for name, (a, b) in pairs.items()}


# ------------------------------------------------------------------------------------------------ misprints


def _remainder(rng: Random, printed: bool) -> float:
    """(2.18). Printed: its remainder, which is claimed to be o(ε), over ε. Corrected: there is no remainder."""
    top, y = draw(rng)
    eps, u = 2.0**-20 if printed else 0.125, 0.5 + rng.random()
    magnet, spins = to_magnet(top, y, eps)
    rest = pauli(magnet.vector(spins, u) - lax_vector(top, y, u, 0 if printed else eps))
    return float(np.max(np.abs(rest))) / (eps if printed else 1.0)


def _morphism(rng: Random, printed: bool) -> float:
    """{x1, x2} for x = ε s2, against 0 or ε x3."""
    top, y = draw(rng)
    magnet, spins = to_magnet(top, y, eps := 0.125)
    brackets = eps * eps * magnet.poisson(spins)[3:, 3:]
    return float(abs(brackets[0, 1] - bracket(y, 0 if printed else eps)[3, 4]))


ERRATA = [
    Erratum(
        "(2.18)", "2", "remainder O(ε²)", "remainder ε x/u³ + …: exactly L/i = alpha σ3 + J/u + x/(u(u − ε))", _remainder,
    ),
    Erratum(
        "(2.20)", "2", "the morphisms hold: {x1, x2} = 0", "in the limit only: {x1, x2} = ε x3", _morphism, prose=True,
    ),
]  # fmt: skip
