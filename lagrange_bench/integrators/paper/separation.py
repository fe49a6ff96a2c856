"""Section 3: separation of variables, the Darboux chart, and the generating function between the two.

For general C1 = c1 = s² and C2 = c2 (the paper has s = 1, c2 = ℓ). The separation variables are

    u1 = −x-/J-      v1 = i (J-/x-)(J3 − (J-/x-) x3)      u2 = J-      v2 = −i J3/J-        {v_k, u_l} = δ_kl

v1 is the explicit expression of (3.5). It equals −A(u1) + i alpha, not −A(u1) as in (3.4), and all later formulas of the section
need it so. The point on the spectral curve is (u1, v1 − i alpha). With f' = {f, H}: u' = −∂H/∂v, v' = ∂H/∂u.

Both charts are complex. States with x- = 0, and in the first chart J- = 0, are outside: ValueError.
"""

from random import Random
from typing import Any

import numpy as np

from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.lax import determinant, entries, lax_matrix
from lagrange_bench.integrators.paper.phase_space import Numbers, cartesian, components, function, ladder, refuse, sqrt
from lagrange_bench.integrators.problem.top import LagrangeTop


def adjugate_row(top: LagrangeTop, y: Any, u: Any, v: Any) -> Numbers:
    """(1, 0)(L(u) − v)^, shape (..., 2): zero at the separation point (u1, v1 − i alpha); (3.1)."""
    A, B, _ = entries(top, y, u)
    return np.stack((-A - v, -B), axis=-1)


def baker_akhiezer(top: LagrangeTop, y: Any, u: Any, v: Any) -> Numbers:
    """Ψ = (1, (v − A)/B), shape (..., 2): L Ψ = v Ψ with first component 1, for (u, v) on the curve; (3.2), (3.3).

    Its pole is the separation point: ValueError where B(u) = 0.
    """
    A, B, _ = entries(top, y, u)
    refuse(B, "B(u) = 0: the pole of the Baker–Akhiezer function")
    return np.stack((1 + 0 * B, (v - A) / B), axis=-1)


def separate(y: Any) -> Numbers:
    """(u1, v1, u2, v2), shape (..., 4), of states (..., 6); (3.5), (3.6). ValueError where J- = 0 or x- = 0."""
    J3, Jm, _, x3, xm, _ = ladder(y)
    refuse(Jm, "J- = 0: outside the chart of the separation variables (u2 = 0)")
    refuse(xm, "x- = 0: outside the chart of the separation variables (u1 = 0)")
    return np.stack((-xm / Jm, 1j * Jm / xm * (J3 - Jm / xm * x3), Jm, -1j * J3 / Jm), axis=-1)


def unseparate(w: Any, c1: Any = 1.0, c2: Any = 0.0) -> Numbers:
    """State (..., 6) on the leaf C1 = c1, C2 = c2 from w = (u1, v1, u2, v2); (3.8). ValueError where u1 or u2 = 0."""
    u1, v1, u2, v2 = components(w)
    refuse(u1, "u1 = 0: outside the chart of the separation variables (x- = 0)")
    refuse(u2, "u2 = 0: outside the chart of the separation variables (J- = 0)")
    Jp = -2 * c2 / (u1 * u2) + v2**2 * u2 - c1 / (u1**2 * u2) - u1**2 * v1**2 / u2
    xp = -c1 / (u1 * u2) - v2**2 * u1 * u2 + 2 * v1 * v2 * u1**2 - u1**3 * v1**2 / u2
    return cartesian(1j * v2 * u2, u2, Jp, 1j * u1 * (u1 * v1 - u2 * v2), -u1 * u2, xp)


def separated_hamiltonian(top: LagrangeTop, w: Any, c1: Any = 1.0, c2: Any = 0.0) -> Any:
    """H of w = (u1, v1, u2, v2): the separation equation (3.9); J3 enters as a constant of motion."""
    u1, v1, _, _ = components(w)
    kinetic = u1**2 * (1j * top.alpha * v1 - v1**2 / 2)
    return kinetic - c2 / u1 - c1 / (2 * u1**2) - top.alpha * separated_J3(w) * u1


def separated_J3(w: Any) -> Any:
    """J3 = i v2 u2; (3.10)."""
    _, _, u2, v2 = components(w)
    return 1j * v2 * u2


def separated_rates(top: LagrangeTop, w: Any, c1: Any = 1.0, c2: Any = 0.0) -> Numbers:
    """(u1', v1', u2', v2') along the flow (1.1): u' = −∂H/∂v, v' = ∂H/∂u with H of (3.9), (3.10)."""
    u1, v1, u2, v2 = components(w)
    alpha, J3 = top.alpha, separated_J3(w)
    v1_rate = 2 * u1 * (1j * alpha * v1 - v1**2 / 2) + c2 / u1**2 + c1 / u1**3 - alpha * J3
    return np.stack((u1**2 * (v1 - 1j * alpha), v1_rate, 1j * alpha * u1 * u2, -1j * alpha * u1 * v2), axis=-1)


def to_darboux(y: Any) -> Numbers:
    """(q1, q2, p1, p2), shape (..., 4), of states (..., 6): inverse of (3.11). ValueError where x- = 0 or C1 = 0."""
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    s, c2 = _radius(x3 * x3 + xm * xp), J3 * x3 + (Jm * xp + Jp * xm) / 2
    refuse(xm, "x- = 0: outside the Darboux chart (q2 = 0)")
    p1 = 1j * (x3 + s) / xm
    return np.stack((Jm, xm, p1, (1j * (J3 + c2 / s) - Jm * p1) / xm), axis=-1)


def from_darboux(z: Any, c1: Any = 1.0, c2: Any = 0.0) -> Numbers:
    """State (..., 6) on the leaf C1 = c1, C2 = c2 from z = (q1, q2, p1, p2), {q_k, p_l} = δ_kl; (3.11), (3.12)."""
    q1, q2, p1, p2 = components(z)
    s = _radius(c1)
    Jp = q1 * p1**2 + 2 * q2 * p1 * p2 - 2j * (c2 / s) * p1 - 2j * s * p2
    J3 = -1j * (q1 * p1 + q2 * p2) - c2 / s
    return cartesian(J3, q1, Jp, -1j * q2 * p1 - s, q2, q2 * p1**2 - 2j * s * p1)


def generating_function(q: Any, v: Any, c1: Any = 1.0, c2: Any = 0.0) -> Any:
    """F(q1, q2 | v1, v2) with p = ∂F/∂q, u = −∂F/∂v; (3.13). Principal logarithm."""
    (q1, q2), (v1, v2) = components(q), components(v)
    s = _radius(c1)
    refuse(q1 * q2, "q1 = J- = 0 or q2 = x- = 0: the generating function has a pole")
    return 1j * s * q1 / q2 + 1j * (c2 / s) * function("log", q2 + 0j) - q1 * v2 + q2 * v1 / q1


def generated(q: Any, v: Any, c1: Any = 1.0, c2: Any = 0.0) -> tuple[Numbers, Numbers]:
    """p = ∂F/∂q and u = −∂F/∂v, each (..., 2), of the generating function; (3.14)."""
    (q1, q2), (v1, v2) = components(q), components(v)
    s = _radius(c1)
    refuse(q1 * q2, "q1 = J- = 0 or q2 = x- = 0: the generating function has a pole")
    p1 = 1j * s / q2 - v2 - q2 * v1 / q1**2
    p2 = -1j * s * q1 / q2**2 + 1j * (c2 / s) / q2 + v1 / q1
    return np.stack((p1, p2), axis=-1), np.stack((-q2 / q1, q1), axis=-1)


def _radius(c1: Any) -> Any:
    refuse(c1, "C1 = 0: the Darboux chart divides by |x|")
    return sqrt(c1)


# ------------------------------------------------------------------------------------------------ misprints


def _v1(rng: Random, printed: bool) -> float:
    """v1 of (3.5) against −A(u1), corrected −A(u1) + i alpha."""
    top, y = draw(rng)
    u1, v1, _, _ = separate(y)
    A, _, _ = entries(top, y, u1)
    return float(abs(v1 + A - (0 if printed else 1j * top.alpha)) / (1 + abs(v1)))


def _on_curve(rng: Random, printed: bool) -> float:
    """det(L(u1) − v), v = v1, corrected v1 − i alpha."""
    top, y = draw(rng)
    u1, v1, _, _ = separate(y)
    v = v1 if printed else v1 - 1j * top.alpha
    return float(abs(determinant(lax_matrix(top, y, u1) - v * np.eye(2))) / (1 + abs(v)) ** 2)


ERRATA = [
    Erratum(
        "(3.4) with (3.5)", "3", "v1 = −A(u1) = i (J-/x-)(J3 − (J-/x-) x3)",
        "v1 = −A(u1) + i alpha = i (J-/x-)(J3 − (J-/x-) x3)", _v1,
    ),
    Erratum(
        "(3.5), text", "3", "(u1, v1) lies on the spectral curve", "(u1, v1 − i alpha) lies on it",
        _on_curve, prose=True,
    ),
]  # fmt: skip
