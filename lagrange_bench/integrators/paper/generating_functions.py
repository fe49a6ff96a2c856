"""Sections 5.2 and 5.3: generating functions of the one-point map, of the top and of the Gaudin magnet; spectrality.

On the leaf |x|² = c1, x·J = c2 the four numbers x-, J- | x̃+, J̃+ determine the states on both sides of the one-point
map, up to the choice of a root k. This root is k = x3 − q x- = x̃3 − p x̃+ with p = J-/2α and q = J̃+/2α. With r = √c1,
ℓ = c2

    F = −i J- J̃+/2α − ik (J-/x- + J̃+/x̃+ − 1/λ) + i (ℓ/r) log[(r + k)/(r − k)] − iαλ                    (5.2.7) [104]
    k² = c1 + λ x- x̃+                                                                                  (5.2.6) [99]
    x3 = i x- ∂F/∂J-,  J3 = i x- ∂F/∂x- + i J- ∂F/∂J-,  the same with tildes and +;  μ = −∂F/∂λ         (5.2.5) [95–98]

`old` = (x-, J-), `new` = (x̃+, J̃+): complex numbers, arrays of them or mpmath numbers. F is two-valued; k is the root
closest to `near`. Only the states show which root belongs to a point (λ, μ) of the curve (`arguments`). At α = 0 there is no
one-point map: p and q are infinite. For Euler angles, and α = 0, see `eulerian`.
"""

from functools import partial
from random import Random
from typing import Any

import numpy as np
from mpmath import mp

from lagrange_bench.integrators.paper.errata import Erratum
from lagrange_bench.integrators.paper.eulerian import Pair
from lagrange_bench.integrators.paper.lax import entries
from lagrange_bench.integrators.paper.phase_space import Numbers, cartesian, function, ladder, refuse, root_near, sqrt
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.support.precision import workdps


def root_k(top: LagrangeTop, lam: Any, c1: Any, old: Pair, new: Pair, near: Any) -> Any:
    """k, k² = c1 + λ x- x̃+ (5.2.6). ValueError for α = 0 and where the chart is singular."""
    refuse(top.alpha, "alpha = 0: p = J-/2 alpha is infinite, there is no one-point map")
    refuse(lam * old[0] * new[0], "λ, x- or x̃+ is 0: the generating function is singular")
    square = c1 + lam * old[0] * new[0]
    refuse(square, "k = 0: a branch point of the generating function")
    return root_near(square, near)


def generating_function(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> Any:
    """F_λ(x-, J- | x̃+, J̃+), (5.2.7) for general c1, principal logarithm (the others add multiples of 2πℓ/r)."""
    k, r, (xm, Jm), (xp, Jp) = root_k(top, lam, c1, old, new, near), sqrt(c1), old, new
    logarithm = function("log", (r + k) / (r - k) + 0j)
    F = -1j * Jm * Jp / (2 * top.alpha) - 1j * k * (Jm / xm + Jp / xp - 1 / lam)
    return F + 1j * c2 / r * logarithm - 1j * top.alpha * lam


def from_gradient(old: Pair, new: Pair, F: tuple[Any, ...]) -> tuple[Any, Any, Any, Any]:
    """J3, x3, J̃3, x̃3 from ∂F/∂(x-, J-, x̃+, J̃+), (5.2.5)."""
    (xm, Jm), (xp, Jp) = old, new
    return 1j * (xm * F[0] + Jm * F[1]), 1j * xm * F[1], 1j * (xp * F[2] + Jp * F[3]), 1j * xp * F[3]


def momenta(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> tuple[Any, ...]:
    """J3, x3, J̃3 = J3, x̃3 in closed form, (5.2.6) [99–102]: what `from_gradient` gives."""
    k, (xm, Jm), (xp, Jp) = root_k(top, lam, c1, old, new, near), old, new
    J3 = (c2 + lam * (Jm * xp + xm * Jp) / 2 - xm * xp / 2) / k + Jm * Jp / (2 * top.alpha)
    return J3, xm * Jp / (2 * top.alpha) + k, J3, Jm * xp / (2 * top.alpha) + k


def eliminated(c1: Any, c2: Any, J3: Any, x3: Any, x: Any, J: Any) -> Pair:
    """(x+, J+) from x-, J-, or (x̃-, J̃-) from x̃+, J̃+, by the Casimirs (5.2.1–2): (5.2.3–4) [91–94]."""
    product = c1 - x3 * x3
    return product / x, (2 * c2 - 2 * J3 * x3 - J * product / x) / x


def states(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> tuple[Numbers, Numbers]:
    """The states y and ỹ on both sides of the map: (5.2.6) and (5.2.3–4)."""
    J3, x3, _, x3_new = momenta(top, lam, c1, c2, old, new, near)
    xp, Jp = eliminated(c1, c2, J3, x3, *old)
    xm, Jm = eliminated(c1, c2, J3, x3_new, *new)
    return cartesian(J3, old[1], Jp, x3, old[0], xp), cartesian(J3, Jm, new[1], x3_new, xm, new[0])


def arguments(top: LagrangeTop, y: Any, y_new: Any) -> tuple[Pair, Pair, Any]:
    """old, new and k = x3 − q x- of a state and its image. So k comes without a root, on the sheet of the map."""
    _, Jm, _, x3, xm, _ = ladder(y)
    _, _, Jp, _, _, xp = ladder(y_new)
    return (xm, Jm), (xp, Jp), x3 - xm * Jp / (2 * top.alpha)


def eigenvalue(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> Any:
    """μ = A(λ) − q B(λ) = −∂F/∂λ, the middle member of (5.3.2) corrected.

    μ = (i/k) [k²/λ² + ℓ/λ + (x- x̃+/2)(J-/x- + J̃+/x̃+ − 1/λ) + αk].
    """
    k, (xm, Jm), (xp, Jp) = root_k(top, lam, c1, old, new, near), old, new
    bracket = k * k / (lam * lam) + c2 / lam + xm * xp / 2 * (Jm / xm + Jp / xp - 1 / lam)
    return 1j / k * (bracket + top.alpha * k)


# ---------------------------------------------------------------- the Gaudin magnet


def roots_z(lam: Any, sites: Any, squares: Any, minus: Any, plus: Any, near: Any) -> Numbers:
    """z_j, z_j² = s_j² − (a_j − λ) s̃_j⁺ s_j⁻ (5.2.10), each the root closest to near_j."""
    refuse((sites - lam) * minus * plus, "λ on a site, or s_j⁻ s̃_j⁺ = 0: the generating function is singular")
    return np.asarray(root_near(squares - (sites - lam) * plus * minus, near))


def gaudin_function(alpha: Any, lam: Any, sites: Any, squares: Any, minus: Any, plus: Any, near: Any) -> Any:
    """F_λ(s_1⁻, …, s_n⁻ | s̃_1⁺, …, s̃_n⁺), (5.2.9) [Ggf], arrays (n,); `squares` are the s_j².

    F = −(i/2α) Σ_jk s_j⁻ s̃_k⁺ − i Σ_j (2 z_j + s_j log[(z_j − s_j)/(z_j + s_j)]) − iαλ; even in each s_j.
    """
    return _gaudin_sum(alpha, lam, squares, minus, plus, roots_z(lam, sites, squares, minus, plus, near))


def _gaudin_sum(alpha: Any, lam: Any, squares: Any, minus: Any, plus: Any, z: Any) -> Any:
    s = sqrt(squares)
    logs = s * function("log", (z - s) / (z + s))
    return -1j * np.sum(minus) * np.sum(plus) / (2 * alpha) - 1j * np.sum(2 * z + logs) - 1j * alpha * lam


def gaudin_momenta(
    alpha: Any, lam: Any, sites: Any, squares: Any, minus: Any, plus: Any, near: Any
) -> tuple[Numbers, Numbers, Any]:
    """s_j³ = i s_j⁻ ∂F/∂s_j⁻ = z_j + q s_j⁻, s̃_j³ = i s̃_j⁺ ∂F/∂s̃_j⁺ = z_j + p s̃_j⁺ (5.2.8), and μ = −∂F/∂λ.

    p = Σ s_j⁻/2α, q = Σ s̃_j⁺/2α, and μ = i(α + Σ z_j/(λ − a_j)) = iv, an eigenvalue of L = i L_G.
    """
    z = roots_z(lam, sites, squares, minus, plus, near)
    p, q = np.sum(minus) / (2 * alpha), np.sum(plus) / (2 * alpha)
    return z + q * minus, z + p * plus, 1j * (alpha + np.sum(z / (lam - sites)))


# ---------------------------------------------------------------- contraction, n = 2 → top


def contraction_arguments(
    c1: Any, c2: Any, J2: Any, old: Pair, new: Pair, k: Any, eps: Any
) -> tuple[Numbers, Numbers, Numbers, Numbers, Numbers]:
    """sites, squares, minus, plus, near of the magnet with s_1 = J − x/ε, s_2 = x/ε, (2.20); J2 = J·J.

    ζ_2 = k/ε and ζ_1 ≈ −k/ε have opposite signs; s_1² = J·J − 2ℓ/ε + c1/ε², s_2² = c1/ε² (5.2.13–14).
    """
    (xm, Jm), (xp, Jp) = old, new
    squares = np.array((J2 - 2 * c2 / eps + c1 / eps**2, c1 / eps**2))
    minus, plus = np.array((Jm - xm / eps, xm / eps)), np.array((Jp - xp / eps, xp / eps))
    return np.array((0 * eps, eps)), squares, minus, plus, np.array((-k / eps, k / eps))


def contracted(alpha: Any, lam: Any, squares: Any, minus: Any, plus: Any, near: Any, eps: Any) -> Any:
    """(5.2.11) [conGF] corrected: (5.2.9) for n = 2, a_2 = a_1 + ε, to the order ε⁰ when s_j = O(1/ε).

    It is the same sum with ζ_j² = s_j² + λ s̃_j⁺ s_j⁻ in place of z_j² (5.2.12), plus iεζ_2/λ. The error is O(ε), not O(ε²):
    −(iε²/2)(s̃_2⁺ s_2⁻/2λζ_2 − ζ_2/λ²) + O(ε²). For ε → 0 it is (5.2.7) plus a constant ±πℓ/r.
    """
    zeta = roots_z(lam, 0 * squares, squares, minus, plus, near)
    return _gaudin_sum(alpha, lam, squares, minus, plus, zeta) + 1j * eps * zeta[1] / lam


# ---------------------------------------------------------------- misprints of sections 5.2 and 5.3


def random_point(rng: Random) -> tuple[LagrangeTop, Any, Any, Pair, Pair, Any]:
    """top, λ, ℓ, (x-, J-), (x̃+, J̃+) and a root k, complex, c1 = 1."""

    def number() -> complex:
        return complex(rng.uniform(0.4, 1.2), rng.uniform(-0.8, 0.8))

    old, new, lam, l = (number(), number()), (number(), number()), number(), number()
    return LagrangeTop(rng.uniform(1.2, 2.0)), lam, l, old, new, sqrt(1 + lam * old[0] * new[0])


def contraction_residual(rng: Random, printed: bool, power: int) -> float:
    """|(5.2.9) − (5.2.11)|/ε^power at ε = 1e-20 in 70 digits: for power 0 with the sign of iεζ_2/λ in question, for 1 with
    the term O(ε), which the paper leaves out.
    """
    top, lam, l, old, new, k = random_point(rng)
    with workdps(70):
        eps, lam, l, k = mp.mpf(10) ** -20, mp.mpc(lam), mp.mpc(l), mp.mpc(k)
        old, new = ((mp.mpc(a), mp.mpc(b)) for a, b in (old, new))
        sites, squares, minus, plus, near = contraction_arguments(mp.mpf(1), l, mp.mpf(2), old, new, k, eps)
        zeta, w = roots_z(lam, 0 * sites, squares, minus, plus, near)[1], minus[1] * plus[1]
        rest = gaudin_function(top.alpha, lam, sites, squares, minus, plus, near)
        rest -= contracted(top.alpha, lam, squares, minus, plus, near, eps)
        if printed and power == 0:
            rest += 2j * eps * zeta / lam
        if not printed and power == 1:
            rest += 0.5j * eps**2 * (w / (2 * lam * zeta) - zeta / lam**2)
        return float(abs(rest) / eps**power)


def zeta_residual(rng: Random, printed: bool) -> float:
    """ζ_1² − s_1² of (5.2.13), over λ/ε², with − x- x̃+/ε², corrected +, against λ s̃_1⁺ s_1⁻."""
    _, lam, _, (xm, Jm), (xp, Jp), _ = random_point(rng)
    eps = 0.25
    expanded = Jm * Jp - (Jp * xm + Jm * xp) / eps + (-1 if printed else 1) * xm * xp / eps**2
    return float(abs(expanded - (Jp - xp / eps) * (Jm - xm / eps)) * eps**2)


def spectrality_residual(rng: Random, printed: bool) -> float:
    """The middle member of (5.3.2) against A(λ) − q B(λ), from the states."""
    top, lam, l, old, new, k = random_point(rng)
    A, B, _ = entries(top, states(top, lam, 1.0, l, old, new, k)[0], lam)
    mu = A - new[1] / (2 * top.alpha) * B
    middle = eigenvalue(top, lam, 1.0, l, old, new, k)
    return float(abs(middle - mu + (1j / k * (1 - k * k) / lam**2 if printed else 0)))


ERRATA = [
    Erratum(
        "(5.2.11), sign", "5.2", "… − iεζ2/λ − iαλ", "… + iεζ2/λ − iαλ", partial(contraction_residual, power=0),
    ),
    Erratum(
        "(5.2.11), order", "5.2", "O(ε²)", "O(ε): −(iε²/2)(s̃2+ s2-/2λζ2 − ζ2/λ²), s and ζ = O(1/ε)",
        partial(contraction_residual, power=1),
    ),
    Erratum("(5.2.13)", "5.2", "ζ1² = s1² + λ(… − x- x̃+/ε²)", "ζ1² = s1² + λ(… + x- x̃+/ε²)", zeta_residual),
    Erratum(
        "(5.3.2), middle member", "5.3", "(i/k)[1/λ² + ℓ/λ + …]", "(i/k)[k²/λ² + ℓ/λ + …]", spectrality_residual,
    ),
]  # fmt: skip
