"""The Bäcklund transformations of the Gaudin magnet (paper, sections 5.1, 5.2, 5.5 with n sites).

A map takes a point (λ, v) of the curve, given by λ, `sheet` and `site`: see `gaudin_curve`. The value v is a function
of the state. With v from the curve at every state the maps are Poisson. With a fixed v they are not.
"""

from typing import Any

import numpy as np

from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue
from lagrange_bench.integrators.paper.lax import adjugate, determinant, from_pauli, pauli
from lagrange_bench.integrators.paper.one_point import dressing_matrix
from lagrange_bench.integrators.paper.phase_space import Numbers, dot, refuse
from lagrange_bench.integrators.torus.any_parameter import check_parameter


def one_point(magnet: Any, spins: Any, lam: Any, sheet: int = 1, site: int = 0, v: Any = None) -> Numbers:
    """The one-point map, a complex Poisson map: L̃(u) = M L M⁻¹, M = ((u − λ + pq, p), (q, 1)); (5.1.3)–(5.1.8).

    p = S-/(2 alpha), q = (A − v)/B = −C/(A + v) at λ, S the total spin. All s_j² and H_j are conserved.
    v : in place of v on the curve through the state. ValueError for alpha = 0, λ on a site, or where the map sends the state to
    infinity: B(λ) = 0 on this sheet.
    """
    refuse(magnet.alpha, "alpha = 0: the one-point map does not exist (p and q ~ 1/alpha); the two-point map does")
    spins = magnet.check_spins(spins)
    v = eigenvalue(magnet, spins, lam, sheet, site) if v is None else v
    (A, B), (C, _) = pauli(magnet.vector(spins, lam))
    above, below = (A - v, B) if abs(A - v) > abs(A + v) else (-C, A + v)
    refuse(below, "B(λ) = 0 on this sheet: the one-point map sends the state to infinity")
    p, q = np.sum(spins[:, 0] - 1j * spins[:, 1]) / (2 * magnet.alpha), above / below
    return _dress(spins, dressing_matrix(p, q, lam, np.array(magnet.sites)))


def two_point(magnet: Any, spins: Any, lam: Any, sheet: int = 1, site: int = 0, v: Any = None) -> Numbers:
    """The real two-point map of λ and λ̄, without poles: every spin turns about one axis. Sheet −1 is the inverse.

    With ℓ(λ) = p + iq, n = Re v p + Im v q − p×q, w = Im λ n/|n| and g_j = a_j − Re λ

        s̃_j = s_j + 2/(g_j² + w·w) (w×(w×s_j) − g_j w×s_j),

    a turn by 2 arg(a_j − λ) about n; M(u) = u − Re λ + i σ·w. |n| = (|v|² + |p|² + |q|²)/2 vanishes only with ℓ(λ).
    It is the one-point map of (λ, −v), followed by the inverse of that of (λ̄, −v̄).
    ValueError unless Im λ > 0 and the spins are real.
    """
    spins = magnet.check_real_spins(spins)
    check_parameter(lam)
    bar = lam.conjugate()
    if v is None:  # no conjugation of spins: the map is written as a holomorphic function of them
        v, v_bar = (eigenvalue(magnet, spins, u, sheet, site) for u in (lam, bar))
    else:
        v_bar = v.conjugate()
    up, down = magnet.vector(spins, lam), magnet.vector(spins, bar)
    n = (up * v_bar + down * v) / 2 - np.cross(up, down) * 0.5j  # p×q = (i/2) ℓ(λ)×ℓ(λ̄)
    square = dot(n, n)
    if square == 0:
        raise ValueError(f"lam = {lam}: ℓ(lam) = 0, there is no axis to turn about")
    w = n * (lam.imag / square**0.5)
    g = np.array([a - lam.real for a in magnet.sites])[:, None]
    turned = np.cross(w, spins)
    image = spins + 2 / (g * g + dot(w, w)) * (np.cross(w, turned) - g * turned)
    return image if spins.dtype == object else image.real


def _dress(spins: Numbers, M: Numbers) -> Numbers:
    """The spins of M(a_j) (σ·s_j) M(a_j)⁻¹, M (n, 2, 2)."""
    image = M @ pauli(spins) @ adjugate(M) / determinant(M)[:, None, None]
    return from_pauli(image, image)[:, :3]
