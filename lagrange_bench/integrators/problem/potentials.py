"""Potentials that are built in, and named tops in them.

As alpha x3, V is energy over the moment of inertia across the axis, in the units of |J|². x is the axis, of any length.
"""

from functools import partial
from typing import Any

from lagrange_bench.integrators.compiling.expression import sqrt
from lagrange_bench.integrators.problem.perturbed import PerturbedTop, Potential
from lagrange_bench.integrators.problem.top import TOPS, NamedTop
from lagrange_bench.integrators.problem.vectors import dot


def _quadratic(x1: Any, x2: Any, x3: Any, p: Any) -> Any:
    across = p[3] * x1 * x2 + p[4] * x1 * x3 + p[5] * x2 * x3
    return (p[0] * x1 * x1 + p[1] * x2 * x2 + p[2] * x3 * x3) / 2 + across


def _axisymmetric(x1: Any, x2: Any, x3: Any, p: Any) -> Any:
    total: Any = 0.0
    for c in reversed(p):
        total = (total + c) * x3
    return total * x3


def _charge(x1: Any, x2: Any, x3: Any, p: Any) -> Any:
    d = (x1 - p[1], x2 - p[2], x3 - p[3])
    return -p[0] / sqrt(dot(d, d))


def _tide(x1: Any, x2: Any, x3: Any, p: Any) -> Any:
    along = dot(p[1:], (x1, x2, x3))
    return p[0] * (along * along) / 2


# V = x·Sx/2: an uneven field to second order. Near a point any smooth field is uniform up to this term. V is also the energy of
# a soft magnetic body in a uniform field: its induced moment is a linear function of the axis.
# Source: Landau & Lifshitz, Electrodynamics of Continuous Media (1984), sections 4 and 8.
QUADRATIC = Potential(
    "quadratic", _quadratic, parameters=("S11", "S22", "S33", "S12", "S13", "S23"),
    note="x·Sx/2: an uneven field to second order, or an induced moment; S in units of J²/x²",
)  # fmt: skip

# V = c2 x3² + c3 x3³ + …: any field that is symmetric about the vertical, as a polynomial in the height. J3 is conserved and the
# motion integrable: by elliptic functions if only c2 is not 0, by hyperelliptic ones from the third power on.
AXISYMMETRIC = Potential(
    "axisymmetric", _axisymmetric,
    note="c2 x3² + c3 x3³ + …: a field symmetric about the vertical; ck in units of J²/x^k",
)  # fmt: skip

# V = −k/|x − a|: a point charge (or mass) at a attracts the tip of the axis, k > 0, or repels it. Singular at a.
# Source: Jackson, Classical Electrodynamics (1998), section 1.5.
CHARGE = Potential(
    "charge", _charge, parameters=("k", "a1", "a2", "a3"),
    note="−k/|x − a|: a point charge or mass at a pulls the tip of the axis; k in units of J² x",
)  # fmt: skip

# V = k (n·x)²/2: the tide of a distant mass M in the direction n (a unit vector), at distance r, on a symmetric body:
# k = 3 (GM/r³)(C − A)/A for |x| = 1, from MacCullagh's formula. Source: Murray & Dermott, Solar System Dynamics (1999),
# section 5.3; Goldstein, Poole & Safko, Classical Mechanics (2002), section 5.8.
TIDE = Potential(
    "tide", _tide, parameters=("k", "n1", "n2", "n3"),
    note="k (n·x)²/2: the tide of a distant mass in direction n; k = 3 (GM/r³)(C − A)/A, in units of J²/x²",
)  # fmt: skip


POTENTIALS_BUILT_IN = {potential.name: potential for potential in (QUADRATIC, AXISYMMETRIC, CHARGE, TIDE)}


def _named(
    name: str, label: str, base: str, potential: Potential, parameters: tuple[float, ...], note: str
) -> NamedTop:
    field = partial(PerturbedTop, potential=potential, parameters=parameters)
    return NamedTop(name, label, TOPS[base].alpha, TOPS[base].y0, note, field)


PERTURBED_TOPS = {
    top.name: top
    for top in (
        _named("tide_1e-6", "tide, ε = 1e-6", "generic", TIDE, (1e-6, 1.0, 0.0, 0.0),
               "the generic top in a tide of 1e-6 of its weight, from the horizon"),
        _named("weak_tide", "weak tide, ε = 1e-4", "generic", TIDE, (1e-4, 1.0, 0.0, 0.0),
               "the generic top in a tide of 1e-4 of its weight"),
        _named("moderate_tide", "moderate tide, ε = 0.01", "generic", TIDE, (1e-2, 1.0, 0.0, 0.0),
               "the generic top in a tide of a hundredth of its weight"),
        _named("strong_tide", "strong tide, ε = 0.1", "generic", TIDE, (1e-1, 1.0, 0.0, 0.0),
               "the generic top in a tide of a tenth of its weight"),
        _named("fast_tide", "fast top, weak tide", "fast", TIDE, (1e-4, 1.0, 0.0, 0.0),
               "the fast top in a tide of 1e-4 of its weight"),
        _named("magnet", "magnet near the path", "generic", CHARGE, (0.02, 0.75, 0.75, 0.75),
               "the generic top, its tip attracted by a point 0.3 beyond the sphere it moves on"),
        _named("triaxial", "triaxial field", "generic", QUADRATIC, (0.06, -0.04, 0.02, 0.01, 0.02, -0.01),
               "the generic top in an uneven field without symmetry"),
        _named("axisymmetric", "axisymmetric field", "generic", AXISYMMETRIC, (0.3, -0.2),
               "the generic top in a field of third order that keeps J3: integrable"),
        _named("separatrix_tide", "near the separatrix, weak tide", "near_separatrix", TIDE, (1e-3, 1.0, 0.0, 0.0),
               "the homoclinic state with a kick of 2^-10, in a tide of 1e-3 of its weight"),
        _named("chaotic", "chaotic", "planar", QUADRATIC, (2.0, -1.5, 0.5, 0.5, 1.0, -0.5),
               "the swinging planar pendulum in a strong uneven field: Lyapunov exponent about 0.1 in its own unit of time"),
    )
}  # fmt: skip
