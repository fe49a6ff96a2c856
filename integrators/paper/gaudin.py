"""The sl(2) Gaudin magnet (paper, section 2) and its Bäcklund transformations (sections 5.1, 5.2, 5.5 with n sites).

n spins s_j = (s¹, s², s³) at sites a_j, in a field alpha along e3; spins are arrays (n, 3), states of several runs
(..., n, 3). The Lax matrix is L_G(u) = σ·ℓ(u), with the vector

    ℓ(u) = alpha e3 + Σ s_j/(u − a_j)                                                                  (2.1), (2.2)
    {s_j¹, s_j²} = s_j³ (cyclic), spins at different sites commute                                           (2.3)
    v² = ℓ·ℓ = alpha² + Σ (H_j/(u − a_j) + s_j²/(u − a_j)²)                                          (2.11), (2.12)
    H_j = 2 alpha s_j³ + Σ_{k≠j} 2 s_j·s_k/(a_j − a_k)                                                      (2.13)

The real magnet has real alpha and sites that are real, with real spins, or come in conjugate pairs with conjugate
spins. Everything here is + − * / and a square root: it runs in double, and in mpmath on object arrays.

Maps take a point (λ, v) of the curve by λ, `sheet` and `site`, see `gaudin_curve`. v is a function of the state: with v
from the curve at every state the maps are Poisson, with v frozen they are not. Compiled steps are in `gaudin_step`, the
limit in which two sites become a top is in `contraction`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any

import mpmath
import numpy as np

from integrators.paper.errata import Erratum
from integrators.paper.gaudin_curve import (
    E3,
    check_numbers,
    check_parameter,
    check_upper,
    eigenvalue,
)
from integrators.paper.lax import gaudin_entries, pauli
from integrators.paper.phase_space import Numbers, poisson_tensor


@dataclass(frozen=True)
class GaudinMagnet:
    """Sites and field of a magnet: numbers, also complex or mpmath ones. Hashable, picklable.

    ValueError for sites that coincide, are not finite or not numbers; for alpha that is not real and finite.
    """

    sites: tuple[Any, ...]
    alpha: Any = 1.0

    def __post_init__(self) -> None:
        sites = check_numbers(self.sites, "sites")
        if sites.ndim != 1 or len(sites) == 0:
            raise ValueError(f"sites must be a sequence of one or more numbers; got shape {sites.shape}")
        for j, a in enumerate(sites):
            if any(a == b for b in sites[:j]):
                raise ValueError(f"sites must be distinct; {a} appears twice")
        alpha = check_numbers(self.alpha, "alpha")
        if alpha.ndim or isinstance(alpha[()], (complex, mpmath.mpc)):
            raise ValueError(f"alpha must be a real number; got {self.alpha!r}")
        object.__setattr__(self, "sites", tuple(sites.tolist()))
        object.__setattr__(self, "alpha", alpha.tolist())

    def __len__(self) -> int:
        return len(self.sites)

    def vector(self, spins: Any, u: Any) -> Numbers:
        """ℓ(u), shape (..., 3); (2.1), (2.2). ValueError at a site."""
        gaps = u - np.asarray(self.sites)
        if np.any(gaps == 0):
            raise ValueError(f"lam = {u} lies on a site")
        vector: Numbers = np.sum(spins / gaps[:, None], axis=-2) + self.alpha * E3
        return vector

    def casimirs(self, spins: Any) -> Numbers:
        """The squares s_j² of the spins, shape (..., n); (2.4)."""
        return _dot(spins, spins)

    def hamiltonians(self, spins: Any) -> Numbers:
        """H_j, shape (..., n); (2.13)."""
        spins = np.asarray(spins)
        products = spins @ np.swapaxes(spins, -1, -2)
        hamiltonians: Numbers = 2 * self.alpha * spins[..., 2] + np.sum(self.couplings * products, axis=-1)
        return hamiltonians

    def hamiltonian_scales(self, spins: Any) -> Numbers:
        """Sizes of the terms in H_j, shape (..., n): what a relative error refers to."""
        size = np.sqrt(np.sum(np.abs(np.asarray(spins)) ** 2, axis=-1))
        scales: Numbers = size * (2 * abs(self.alpha) + size @ np.abs(self.couplings))
        return scales

    @property
    def couplings(self) -> Numbers:
        """2/(a_j − a_k), 0 on the diagonal, shape (n, n)."""
        a = np.asarray(self.sites)
        gaps = a[:, None] - a + np.eye(len(a), dtype=int)
        matrix: Numbers = 2 / gaps * (1 - np.eye(len(a), dtype=int))
        return matrix

    def gradient(self, spins: Any, c: Any) -> Numbers:
        """Gradient of Σ c_j H_j: at site j 2 alpha c_j e3 + Σ_k 2 (c_j − c_k)/(a_j − a_k) s_k; shape (..., n, 3)."""
        c = np.asarray(c)
        gradient: Numbers = (self.couplings * (c[:, None] - c)) @ np.asarray(spins) + 2 * self.alpha * c[:, None] * E3
        return gradient

    def rhs(self, spins: Any, c: Any) -> Numbers:
        """Equations of motion of Σ c_j H_j, f' = {f, Σ c_j H_j}: each spin turns about its gradient; (..., n, 3)."""
        return _cross(self.gradient(spins, c), np.asarray(spins))

    def poisson(self, spins: Any) -> Numbers:
        """The Poisson tensor (3n, 3n) at spins (n, 3); (2.3)."""
        return poisson_tensor(*spins)

    def check_spins(self, spins: Any, name: str = "spins") -> Numbers:
        """`spins` as an array (n, 3) of its own; ValueError naming the argument if they are anything else."""
        array = check_numbers(spins, name)
        if array.shape != (len(self), 3):
            raise ValueError(f"{name} must have shape ({len(self)}, 3), one row for each site; got {array.shape}")
        return array.astype(float) if array.dtype.kind in "iu" else array

    @property
    def partners(self) -> list[int]:
        """For each site the place of its conjugate, itself if it is real. ValueError if there is none."""
        for a in self.sites:
            if a.conjugate() not in self.sites:
                raise ValueError(f"sites must be real or conjugate pairs; {a} has no partner")
        return [self.sites.index(a.conjugate()) for a in self.sites]

    def check_real(self, spins: Any, name: str = "spins") -> None:
        """ValueError unless spins are real at real sites, conjugate at conjugate ones, but for round-off."""
        s = np.asarray(spins).astype(complex)
        if np.max(np.abs(s[self.partners].conj() - s)) > 1e-12 * np.max(np.abs(s)):
            raise ValueError(f"{name} must be real at real sites and conjugate at conjugate sites")


# ------------------------------------------------------------------------------------------ the maps


def one_point(
    magnet: GaudinMagnet, spins: Any, lam: Any, sheet: int = 1, site: int | None = 0, v: Any = None
) -> Numbers:
    """The one-point map, a complex Poisson map: L̃(u) = M L M⁻¹, M = ((u − λ + pq, p), (q, 1)); (5.1.3)–(5.1.8).

    p = S-/(2 alpha), q = (A − v)/B = −C/(A + v) at λ, S the total spin. All s_j² and H_j are kept.
    v : in place of the one on the curve through the state. ValueError for alpha = 0, λ on a site, or B(λ) = 0 on the
    sheet that is sent to infinity.
    """
    if magnet.alpha == 0:
        raise ValueError("alpha = 0: the one-point map does not exist (p and q ~ 1/alpha); the two-point map does")
    spins, lam = magnet.check_spins(spins), check_parameter(magnet, lam)
    v = eigenvalue(magnet, spins, lam, sheet, site) if v is None else v
    A, B, C = gaudin_entries(magnet.alpha, magnet.sites, spins, lam)
    above, below = (A - v, B) if abs(A - v) > abs(A + v) else (-C, A + v)
    if below == 0:
        raise ValueError("B(λ) = 0 on this sheet: the one-point map sends the state to infinity")
    p, q = np.sum(spins[:, 0] - 1j * spins[:, 1]) / (2 * magnet.alpha), above / below
    return _dress(magnet, spins, lambda u: ((u - lam + p * q, p), (q, 1 + 0 * p)))


def one_point_inverse(
    magnet: GaudinMagnet, spins: Any, lam: Any, sheet: int = 1, site: int | None = 0, v: Any = None
) -> Numbers:
    """The spins that `one_point` sends to `spins`: its mirror image τ B τ, τ: s² → −s², which transposes L."""
    mirror = np.array((1, -1, 1))
    image: Numbers = one_point(magnet, magnet.check_spins(spins) * mirror, lam, sheet, site, v) * mirror
    return image


def two_point_textbook(magnet: GaudinMagnet, spins: Any, lam1: Any, v1: Any, lam2: Any, v2: Any) -> Numbers:
    """The two-point map of (λ1, v1), (λ2, v2) as in section 5.5, (5.5.2)–(5.5.6): complex, with its divisions.

    M(λ1) annuls the eigenvector of v1, M(λ2) that of −v2. The inverse exchanges the two points. The map is real for
    λ2 = λ̄1, v2 = v̄1; then it is `two_point` of (λ1, −v1).
    """
    spins = magnet.check_spins(spins)
    lam1, lam2 = check_parameter(magnet, lam1, "lam1"), check_parameter(magnet, lam2, "lam2")
    A1, B1, _ = gaudin_entries(magnet.alpha, magnet.sites, spins, lam1)
    A2, B2, _ = gaudin_entries(magnet.alpha, magnet.sites, spins, lam2)
    if B1 == 0 or B2 == 0:
        raise ValueError("B vanishes at lam1 or lam2: use `two_point`, which has no poles")
    x = (A1 - v1) / B1
    gap = x - (A2 + v2) / B2
    if gap == 0:
        raise ValueError("(lam1, v1) and (lam2, v2): the map is singular here; use `two_point`, which has no poles")
    X = (lam1 - lam2) / gap
    return _dress(magnet, spins, lambda u: ((u - lam1 + x * X, X), (-x * x * X + (lam1 - lam2) * x, u - lam2 - x * X)))


def two_point(
    magnet: GaudinMagnet, spins: Any, lam: Any, sheet: int = 1, site: int | None = 0, v: Any = None
) -> Numbers:
    """The real two-point map of λ and λ̄, without poles: every spin turns about one axis. Sheet −1 is the inverse.

    With ℓ(λ) = p + iq, n = Re v p + Im v q − p×q, w = Im λ n/|n| and g_j = a_j − Re λ

        s̃_j = s_j + 2/(g_j² + w·w) (w×(w×s_j) − g_j w×s_j),

    a turn by 2 arg(a_j − λ) about n; M(u) = u − Re λ + i σ·w. |n| = (|v|² + |p|² + |q|²)/2 vanishes only with ℓ(λ).
    It is `two_point_textbook` of (λ, −v), (λ̄, −v̄): there sheet 1 steps backwards.
    ValueError unless Im λ > 0 and sites and spins are real or conjugate.
    """
    spins, lam = magnet.check_spins(spins), check_upper(magnet, lam)
    magnet.check_real(spins)
    bar = lam.conjugate()
    if v is None:  # no conjugation of spins: the map is written as a holomorphic function of them
        v, v_bar = (eigenvalue(magnet, spins, u, sheet, site) for u in (lam, bar))
    else:
        v_bar = v.conjugate()
    up, down = magnet.vector(spins, lam), magnet.vector(spins, bar)
    n = (up * v_bar + down * v) / 2 - _cross(up, down) * 0.5j  # p×q = (i/2) ℓ(λ)×ℓ(λ̄)
    square = _dot(n, n)
    if square == 0:
        raise ValueError(f"lam = {lam}: ℓ(lam) = 0, there is no axis to turn about")
    w = n * (lam.imag / square**0.5)
    g = np.array([a - lam.real for a in magnet.sites])[:, None]
    turned = _cross(w, spins)
    image: Numbers = spins + 2 / (g * g + _dot(w, w)) * (_cross(w, turned) - g * turned)
    if spins.dtype == object:
        return image
    return (image + image[magnet.partners].conj()) / 2 if spins.dtype.kind == "c" else image.real


# ------------------------------------------------------------------------------------------ vectors and matrices


def _dress(magnet: GaudinMagnet, spins: Numbers, M: Any) -> Numbers:
    """The spins of M(a_j) (σ·s_j) M(a_j)⁻¹."""
    images = []
    for a, s in zip(magnet.sites, spins, strict=True):
        (a11, a12), (a21, a22) = M(a)
        det = a11 * a22 - a12 * a21
        product = np.array(((a11, a12), (a21, a22))) @ pauli(s) @ np.array(((a22, -a12), (-a21, a11))) / det
        (s3, minus), (plus, _) = product
        images.append(((minus + plus) / 2, (plus - minus) * -0.5j, s3))
    return np.array(images)


def _dot(a: Any, b: Any) -> Numbers:
    product: Numbers = np.sum(np.asarray(a) * b, axis=-1)
    return product


def _cross(a: Any, b: Any) -> Numbers:
    (a1, a2, a3), (b1, b2, b3) = (np.moveaxis(v, -1, 0) for v in np.broadcast_arrays(a, b))
    return np.stack((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1), axis=-1)


# ------------------------------------------------------------------------------------------------ misprints


def _beyond(rng: Random, dimension: int) -> float:
    """How far the flows of H_1, H_2, H_3 and the turn about e3 of three spins leave a space of so many dimensions.

    It is the next singular value of their unit vectors at a random state: 0 if that many dimensions hold them all.
    """
    magnet = GaudinMagnet((-2.0 + rng.random(), rng.random(), 2.0 + rng.random()), alpha=0.5 + rng.random())
    spins = np.array([[rng.gauss(0, 1) for _ in range(3)] for _ in range(3)])
    flows = [magnet.rhs(spins, c).ravel() for c in np.eye(3)] + [_cross(E3, spins).ravel()]
    directions = [flow / np.linalg.norm(flow) for flow in flows]
    return float(np.linalg.svd(directions, compute_uv=False)[dimension])


ERRATA = [
    Erratum(
        "(2.11), text", "2", "the motion is linearised on the Jacobian of Γ_G, of dimension n − 1",
        "on a generalised Jacobian, of dimension n: the Jacobian and the turns about e3",
        partial(_beyond, dimension=2), partial(_beyond, dimension=3), prose=True,
    ),
]  # fmt: skip
