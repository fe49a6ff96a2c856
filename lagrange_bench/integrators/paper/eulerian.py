"""Section 5.4: the one-point map in Euler angles; its generating function is elementary.

With r = √c1, ℓ = c2, c = cos θ, c̃ = cos θ̃ and κ² = 1 + λ e^{i(φ − φ̃)} sin θ sin θ̃ (5.4.6), κ = k/r,

    F = 2iαλ (c − κ)(c̃ − κ)/(κ² − 1) − iαλ + i r κ/λ + i (ℓ/r) ln[(1 + κ)/(1 − κ) · tan(θ/2) tan(θ̃/2)]
    p_θ = ∂F/∂θ,   p_φ = ∂F/∂φ,   p̃_θ = −∂F/∂θ̃,   p̃_φ = −∂F/∂φ̃,   μ = −∂F/∂λ,

instead of the paper's elliptic integrals, which are wrong.

Proof. By (4.1), p_θ dθ + p_φ dφ and the one-form that (5.2.7) generates differ by d[i x3 J-/x- + i (ℓ/r) ln tan(θ/2)].
The same holds with tildes. By (5.2.6), r J-/x- = 2αλ (c̃ − κ)/(κ² − 1) and r J̃+/x̃+ = 2αλ (c − κ)/(κ² − 1). Insert
both into (5.2.7).

`old` = (θ, φ), `new` = (θ̃, φ̃): complex numbers, arrays of them or mpmath numbers. κ is the root closest to `near`. Which of the
two it must be follows from the sheet of the curve (`arguments`).
"""

from collections.abc import Callable
from functools import partial
from random import Random
from typing import Any

import numpy as np
from mpmath import mp

from lagrange_bench.integrators.paper.errata import Erratum
from lagrange_bench.integrators.paper.euler_angles import to_angles
from lagrange_bench.integrators.paper.phase_space import Numbers, function, gradient, ladder, refuse, root_near, sqrt
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.support.precision import workdps

Pair = tuple[Any, Any]


def kappa(lam: Any, old: Pair, new: Pair, near: Any) -> Any:
    """κ = k/r, (5.4.6). ValueError where the chart is singular: λ sin θ sin θ̃ = 0, or κ = 0, a branch point."""
    sines = function("sin", old[0]) * function("sin", new[0])
    refuse(lam * sines, "λ = 0, or a pole sin θ = 0: the generating function is singular")
    square = 1 + lam * function("exp", 1j * (old[1] - new[1])) * sines
    refuse(square, "κ = 0: a branch point of the generating function")
    return root_near(square, near)


def generating_function(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> Any:
    """F_λ(θ, φ | θ̃, φ̃), principal logarithm; alpha = 0 is the zero-field case.

    At alpha = 0 F depends on both sides together only through κ. The determinant of its mixed second derivatives is 0, and it
    defines no map: p_θ and p_φ do not determine θ̃ and φ̃. (Nor is there a one-point map at alpha = 0: p and q are infinite.)
    """
    k, r = kappa(lam, old, new, near), sqrt(c1)
    c, c_new = function("cos", old[0]), function("cos", new[0])
    tangents = function("tan", old[0] / 2) * function("tan", new[0] / 2)
    weight = 2j * top.alpha * lam * ((c - k) * (c_new - k) / (k * k - 1) - 0.5)
    return weight + 1j * r * k / lam + 1j * c2 / r * function("log", (1 + k) / (1 - k) * tangents + 0j)


def momenta(top: LagrangeTop, lam: Any, c1: Any, c2: Any, old: Pair, new: Pair, near: Any) -> tuple[Any, ...]:
    """p_θ, p_φ, p̃_θ, p̃_φ = p_φ by (5.4.4) [111] corrected and (5.4.5), general c1."""
    k, r, field = kappa(lam, old, new, near), sqrt(c1), top.alpha * lam
    (s, c), (s_new, c_new) = ((function("sin", v), function("cos", v)) for v in (old[0], new[0]))
    w, l = k * k - 1, c2 / r
    p_phi = (l + field * (c + c_new) - r * w / (2 * lam)) / k + 2 * field * ((c - k) * (c_new - k) / w - 1)
    p_theta = 1j * (l - p_phi * c) / s - 2j * field * s * (c_new - k) / w
    p_theta_new = 1j * (p_phi * c_new - l) / s_new + 2j * field * s_new * (c - k) / w
    return p_theta, p_phi, p_theta_new, p_phi


def arguments(top: LagrangeTop, y: Any, y_new: Any) -> tuple[Pair, Pair, Any]:
    """old, new and κ = (x3 − q x-)/r of a state and its image under the one-point map: κ without a root."""
    old, new = to_angles(y), to_angles(y_new)
    (*_, x3, xm, xp), Jp = ladder(y), ladder(y_new)[2]
    r = sqrt(x3 * x3 + xm * xp)
    return (old[..., 0], old[..., 1]), (new[..., 0], new[..., 1]), (x3 - xm * Jp / (2 * top.alpha)) / r


# ---------------------------------------------------------------- misprints of section 5.4


def printed_elliptic(alpha: Any, lam: Any, l: Any, old: Pair, new: Pair, k: Any) -> Any:
    """(5.4.11–15): the printed F_λ with the elliptic integrals E, F, Π; mpmath numbers, c1 = 1."""

    def half(theta: Any, theta_new: Any) -> Any:
        s, c, c_new, w = mp.sin(theta), mp.cos(theta), mp.cos(theta_new), k * k - 1
        f = mp.expj(old[1] - new[1])
        S = k * c * w / (k * k - 2 * k + c * c) * mp.sqrt(s * (k - 1 - s))
        xi, zeta = k * mp.sqrt(s / (w + s)), (w + s) / s
        eta = mp.sqrt(-(w + s) / (w - s))
        m, n = mp.sin(eta) ** 2, zeta**2  # ξ is an amplitude, η a modular angle
        tangent, ratio, s2_new = mp.log(s / (c + 1)), mp.log((1 + k) / (1 - k)), mp.sin(theta_new) ** 2
        braces = mp.log(s) * (1 + c_new) - k + (k * k - 2) / w * c + k / (2 * w) * (1 + c * c_new)
        braces += theta * s * s2_new / (w * (c_new - 1)) + tangent + c * ratio / 2
        braces += 3 * mp.log((k + 1) / (k - 1)) / 4
        a0 = 1j * l * tangent - 1j * k / (2 * lam) + 1j * l * ratio / 2 + 2j * alpha * lam * braces
        front, common = 2j * alpha * S / (k * c), 2 / (lam * f**2 * (1 - c_new))
        a1 = front * ((1 + c_new) * (3 * lam - 1 / (f**2 * s2_new)) - common)
        a2 = front * (common - (1 + c_new) * (3 * lam + 1 / (f * mp.sin(theta_new))))
        a3 = 2j * alpha * lam * S * (1 - c_new) * (w + s) / (k * c * s)
        return a0 + a1 * mp.ellipe(xi, m) + a2 * mp.ellipf(xi, m) + a3 * mp.ellippi(n, xi, m)

    logarithm = 1j * (old[1] - new[1])
    return -1j * alpha * lam * (2 * logarithm + 1) + half(old[0], new[0]) + half(new[0], old[0])


def random_point(rng: Random) -> tuple[LagrangeTop, Any, Any, Pair, Pair, Any]:
    """top, λ, ℓ, (θ, φ), (θ̃, φ̃) and a root κ, complex, c1 = 1."""

    def number(low: float, high: float) -> complex:
        return complex(rng.uniform(low, high), rng.uniform(-0.3, 0.3))

    old, new = ((number(0.6, 1.2), number(0, 3)) for _ in range(2))
    lam = number(0.5, 1.5)
    near = kappa(lam, old, new, 1.0) * rng.choice((-1, 1))
    return LagrangeTop(rng.uniform(0.5, 1.5)), lam, number(0.5, 1.5), old, new, near


def by_old(
    F: Callable[..., Any], lam: Any, old: Pair, new: Pair, near: Any, count: int = 2, digits: int = 30
) -> Numbers:
    """∂F/∂θ and ∂F/∂φ, or the first `count` of them, of F(old, new, κ), with κ on its sheet, in `digits` digits."""

    def value(z: Any) -> Any:
        pair = (*z, *(mp.mpc(v) for v in old[count:]))
        return F(pair, partner, kappa(lam, pair, partner, near))

    with workdps(digits):
        partner = (mp.mpc(new[0]), mp.mpc(new[1]))
        return gradient(value, old[:count]).astype(complex)


def p_phi_residual(rng: Random, printed: bool) -> float:
    """(5.4.4) against ∂F/∂φ."""
    top, lam, l, old, new, k = random_point(rng)
    truth = by_old(partial(generating_function, top, lam, mp.mpf(1), l), lam, old, new, k)[1]
    field, c, c_new, w = top.alpha * lam, np.cos(old[0]), np.cos(new[0]), k * k - 1
    p_phi = (l + field * (c + c_new) + w / (2 * lam)) / k + 2 * field * ((c - 1) * (c_new - 1) / w - 1)
    return float(abs((p_phi if printed else momenta(top, lam, 1.0, l, old, new, k)[1]) - truth))


def elliptic_residual(rng: Random, printed: bool) -> float:
    """∂F/∂θ against p_θ of (5.4.5)."""
    top, lam, l, old, new, k = random_point(rng)
    F = partial(generating_function, top, lam, mp.mpf(1), l)
    if printed:
        F = partial(printed_elliptic, top.alpha, lam, l)
    slope = by_old(F, lam, old, new, k, count=1, digits=15 if printed else 30)[0]  # elliptic integrals are slow
    return float(abs(slope - momenta(top, lam, 1.0, l, old, new, k)[0]))


def zero_field_residual(rng: Random, printed: bool) -> float:
    """p_φ = [ℓ − (κ² − 1)/2λ]/κ, (5.4.4) at alpha = 0, against ∂/∂φ of iℓ ln[…] − iκ/λ, corrected + iκ/λ."""
    _, lam, l, old, new, k = random_point(rng)
    by_phi = 1j * (1j * (-1 if printed else 1) / lam - 2j * l / (k * k - 1)) * (k * k - 1) / (2 * k)
    return float(abs(by_phi - momenta(LagrangeTop(0.0), lam, 1.0, l, old, new, k)[1]))


ERRATA = [
    Erratum(
        "(5.4.4)", "5.4",
        "p_φ = (1/k)[… + (k² − 1)/2λ] + 2αλ[(cos θ − 1)(cos θ̃ − 1)/(k² − 1) − 1]",
        "p_φ = (1/k)[… − (k² − 1)/2λ] + 2αλ[(cos θ − k)(cos θ̃ − k)/(k² − 1) − 1]", p_phi_residual,
    ),
    Erratum(
        "(5.4.11)–(5.4.15)", "5.4", "a0 + a1 E(ξ|η) + a2 F(ξ|η) + a3 Π(ζ; ξ|η) + exchanged",
        "elementary: 2iαλ (c − k)(c̃ − k)/(k² − 1) − iαλ + ik/λ + iℓ ln[(1 + k)/(1 − k) tan(θ/2) tan(θ̃/2)]",
        elliptic_residual,
    ),
    Erratum(
        "(5.4.16)", "5.4", "iℓ ln[…] − ik/λ", "iℓ ln[…] + ik/λ; it defines no map: det ∂²F/∂q∂q̃ = 0",
        zero_field_residual,
    ),
]  # fmt: skip
