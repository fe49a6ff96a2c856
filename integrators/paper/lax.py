"""Section 2 of the paper: Lax matrices of the top and of the Gaudin magnet, spectral curve, r-matrix algebra.

States and numbers are those of `phase_space`. With Pauli matrices

    L_G(u) = alpha σ3 + Σ σ·s_j/(u − a_j)                n sites                                    (2.1), (2.2)
    L(u)   = i (alpha σ3 + σ·J/u + σ·x/u²)               the top, L = i L_G after the contraction   (2.21)

Two points lie over each λ of the spectral curve, distinguished by `sheet`: μ = ±i m/λ² with m = √Q(λ), the branch that
comes from √C1 at λ = 0 along the straight segment. Code passes m, which has no pole, where the paper passes μ.

Corrected here (see `ERRATA`): the curve (2.22) has 2 alpha J3/u, and L of (2.21) has the r-matrix −P/(u − v).
"""

from __future__ import annotations

from random import Random
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.phase_space import (
    Numbers,
    components,
    invariants,
    ladder,
    lift,
    poisson_tensor,
    sqrt,
)
from lagrange_bench.integrators.problem.top import LagrangeTop

PAULI = np.array((((0, 1), (1, 0)), ((0, -1j), (1j, 0)), ((1, 0), (0, -1))))
PERMUTATION = np.array(((1, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
FACTOR_GAUDIN = 1j  # r = factor P/(u − v) for L_G, (2.6)
FACTOR_TOP = -1.0  # the same for L = i L_G


# ------------------------------------------------------------------------------------------ Lax matrices


def pauli(v: Any) -> Numbers:
    """σ·v = ((v3, v-), (v+, −v3)), shape (..., 2, 2), of vectors (..., 3)."""
    v1, v2, v3 = components(v)
    rows = (np.stack((v3 + 0j, v1 - 1j * v2), axis=-1), np.stack((v1 + 1j * v2, -v3 + 0j), axis=-1))
    return np.stack(rows, axis=-2)


def entries(top: LagrangeTop, y: Any, u: Any) -> tuple[Any, Any, Any]:
    """A(u), B(u), C(u) of the top's L(u) = ((A, B), (C, −A)); (2.21)."""
    if np.any(np.asarray(u) == 0):
        raise ValueError("the Lax matrix of the top has its pole at u = 0")
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    u = lift(u, J3)
    u2 = u * u
    return 1j * (J3 / u + x3 / u2 + top.alpha), 1j * (Jm / u + xm / u2), 1j * (Jp / u + xp / u2)


def matrix(A: Any, B: Any, C: Any) -> Numbers:
    """((A, B), (C, −A)), shape (..., 2, 2)."""
    return np.stack((np.stack((A, B), axis=-1), np.stack((C, -A), axis=-1)), axis=-2)


def lax_matrix(top: LagrangeTop, y: Any, u: Any) -> Numbers:
    """L(u) of the top, (..., 2, 2); (2.21)."""
    return matrix(*entries(top, y, u))


def gaudin_entries(alpha: Any, sites: ArrayLike, spins: Any, u: Any) -> tuple[Any, Any, Any]:
    """A(u), B(u), C(u) of the Gaudin magnet, (2.2): sites (n,), spins (..., n, 3) as (s¹, s², s³)."""
    gaps = u - np.asarray(sites)
    if np.any(gaps == 0):
        raise ValueError(f"u = {u} lies on a site of the magnet")
    s1, s2, s3 = components(spins)
    total = [np.sum(s / gaps, axis=-1) for s in (s3, s1 - 1j * s2, s1 + 1j * s2)]
    return alpha + total[0], total[1], total[2]


def gaudin_matrix(alpha: Any, sites: ArrayLike, spins: Any, u: Any) -> Numbers:
    """L_G(u) of the n-site sl(2) Gaudin magnet, (..., 2, 2); (2.1). `1j` times it is L of (2.15)."""
    return matrix(*gaudin_entries(alpha, sites, spins, u))


# ----------------------------------------------------------------------------------------- spectral curve


def spectral_polynomial(top: LagrangeTop, y: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Ascending coefficients of Q(u) = C1 + 2 C2 u + 2H u² + 2 alpha J3 u³ + alpha² u⁴ = u⁴ det L(u)."""
    H, J3, C1, C2 = invariants(top, y)
    alpha = lift(top.alpha, J3)
    return C1, 2 * C2, 2 * H, 2 * alpha * J3, alpha * alpha


def spectral_curve(top: LagrangeTop, y: Any, u: Any) -> Any:
    """v² of the two eigenvalues ±v of L(u); (2.22) corrected.

    −v² = C1/u⁴ + 2 C2/u³ + 2H/u² + 2 alpha J3/u + alpha².
    """
    q0, q1, q2, q3, q4 = spectral_polynomial(top, y)
    u = lift(u, q0)
    return -(q0 / u**4 + q1 / u**3 + q2 / u**2 + q3 / u + q4)


def root(top: LagrangeTop, y: Any, lam: Any) -> Any:
    """m = √Q(λ), continuous from the principal √C1 at 0 along the straight segment to λ.

    ValueError for C1 = 0. If a root of Q lies on the segment, the side is decided by round-off: choose another λ.
    """
    q = spectral_polynomial(top, y)
    if np.any(np.asarray(q[0]) == 0):
        raise ValueError("C1 = 0: the two sheets of the spectral curve meet at 0, there is no branch to follow")
    value = q[4]
    for coefficient in q[3::-1]:
        value = value * lam + coefficient
    m = sqrt(value)
    guess = _branch([np.asarray(c).astype(complex) for c in q], np.asarray(lam).astype(complex))
    sign = np.where(np.real(np.asarray(m).astype(complex) * np.conj(guess)) < 0, -1, 1)
    return sign * m if np.ndim(m) else int(sign) * m


def _branch(q: list[Numbers], lam: Numbers) -> Numbers:
    """√Q(λ) in double on the branch of `root`: √C1 Π √(1 − λ w), 1/w the roots of Q.

    Along the segment each factor runs straight from 1 to 1 − λ w and meets the cut of the principal root only if
    the segment meets 1/w. The w are the eigenvalues of a companion matrix, 0 where the degree of Q is less than 4.
    """
    shape = np.broadcast_shapes(*(c.shape for c in q))
    companion = np.zeros((*shape, 4, 4), dtype=complex)
    for k in range(4):
        companion[..., 0, k] = -q[k + 1] / q[0]
    companion[..., (1, 2, 3), (0, 1, 2)] = 1
    w = np.linalg.eigvals(companion)
    product: Numbers = np.sqrt(q[0]) * np.prod(np.sqrt(1 - lam[..., None] * w), axis=-1)
    return product


def eigenvalue(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1) -> Any:
    """μ with det(L(λ) − μ) = 0, (5.1.7), (5.1.9): μ = sheet · i m/λ², continuous in λ from +i √C1/λ² for sheet 1."""
    if np.any(np.asarray(lam) == 0):
        raise ValueError("λ = 0 is the pole of μ")
    m = root(top, y, lam)
    lam = lift(lam, m)
    return check_sheet(sheet) * 1j * m / (lam * lam)


def check_sheet(sheet: int) -> int:
    if sheet not in (1, -1):
        raise ValueError(f"sheet must be 1 or -1; got {sheet!r}")
    return sheet


# ----------------------------------------------------------------------------------------- r-matrix algebra


def r_matrix(w: Any, factor: complex = FACTOR_GAUDIN) -> Numbers:
    """factor · P/w, P the permutation of C² ⊗ C²; (2.6) with factor i."""
    r: Numbers = PERMUTATION * (factor / w)
    return r


def tensor_first(L: Numbers) -> Numbers:
    """L ⊗ 1, shape (4, 4)."""
    return np.kron(L, np.eye(2, dtype=int))


def tensor_second(L: Numbers) -> Numbers:
    """1 ⊗ L, shape (4, 4)."""
    return np.kron(np.eye(2, dtype=int), L)


def matrix_brackets(left: Numbers, P: Numbers, right: Numbers) -> Numbers:
    """{L(u) ⊗ 1, 1 ⊗ L(v)}, (4, 4), from the gradients (n, 2, 2) of L(u) and of L(v) and the Poisson tensor (n, n)."""
    brackets: Numbers = np.einsum("aij,ab,bkl->ikjl", left, P, right).reshape(4, 4)
    return brackets


def lax_gradient(u: Any) -> Numbers:
    """∂L(u)/∂y of the top, (6, 2, 2); L is affine in y."""
    return np.concatenate((1j * PAULI / u, 1j * PAULI / (u * u)))


def gaudin_gradient(sites: ArrayLike, u: Any) -> Numbers:
    """∂L_G(u)/∂(s_1, …, s_n), (3n, 2, 2)."""
    return np.concatenate([PAULI / (u - a) for a in np.asarray(sites)])


def linear_algebra_defect(brackets: Numbers, Lu: Numbers, Lv: Numbers, r: Numbers) -> Numbers:
    """{L¹(u), L²(v)} − [r(u − v), L¹(u) + L²(v)], (4, 4): zero by (2.5) for L_G with factor i, for L with −1."""
    total = tensor_first(Lu) + tensor_second(Lv)
    defect: Numbers = brackets - (r @ total - total @ r)
    return defect


def quadratic_algebra_defect(brackets: Numbers, Mu: Numbers, Mv: Numbers, r: Numbers) -> Numbers:
    """{M¹(u), M²(v)} − [r(u − v), M¹(u) M²(v)], (4, 4): (5.1.5)."""
    product = tensor_first(Mu) @ tensor_second(Mv)
    defect: Numbers = brackets - (r @ product - product @ r)
    return defect


# ------------------------------------------------------------------------------------ Lax equation of the flow


def lax_partner(y: Any, u: Any) -> Numbers:
    """(i/2u) σ·x, (..., 2, 2); section 5.6, below (5.6.10)."""
    partner: Numbers = pauli(np.asarray(y)[..., 3:]) * (0.5j / u)
    return partner


def lax_rate(top: LagrangeTop, y: Any, u: Any) -> Numbers:
    """L'(u) = [(i/2u) σ·x, L(u)] along the flow (1.1), that is {L, H}; section 5.6."""
    L, N = lax_matrix(top, y, u), lax_partner(y, u)
    rate: Numbers = N @ L - L @ N
    return rate


# ------------------------------------------------------------------------------------------------ misprints


def _contraction(rng: Random, exact: bool) -> float:
    """L_G of sites 0, ε with s2 = x/ε, s1 = J − x/ε, against (2.18); without `exact` the remainder over ε."""
    top, y = draw(rng)
    eps, u = (0.125, 0.5 + rng.random()) if exact else (2.0**-20, 0.5 + rng.random())
    J, x = y[:3], y[3:]
    L = gaudin_matrix(top.alpha, (0.0, eps), (J - x / eps, x / eps), u)
    second = u * (u - eps) if exact else u * u
    rest = L - top.alpha * PAULI[2] - pauli(J) / u - pauli(x) / second
    return float(np.max(np.abs(rest))) / (1.0 if exact else eps)


def _morphism(rng: Random, exact: bool) -> float:
    """{x1, x2} for x = ε s2, against 0 or ε x3."""
    _, y = draw(rng)
    eps, s2 = 0.125, y[3:] / 0.125
    P = poisson_tensor(s2)
    return float(abs(eps * eps * P[0, 1] - (eps * y[5] if exact else 0)))


def _r_matrix(rng: Random, factor: complex) -> float:
    top, y = draw(rng)
    u, v = 0.5 + rng.random(), -0.5 - rng.random() * 1j
    brackets = matrix_brackets(lax_gradient(u), poisson_tensor(y), lax_gradient(v))
    defect = linear_algebra_defect(brackets, lax_matrix(top, y, u), lax_matrix(top, y, v), r_matrix(u - v, factor))
    return float(np.max(np.abs(defect))) / 16


def _curve(rng: Random, corrected: bool) -> float:
    """det(L(u) − v) with v² from the curve, over the largest coefficient."""
    top, y = draw(rng)
    u = 0.5 + rng.random() + 1j * rng.random()
    slip = 0 if corrected else 2 * (top.alpha - 1) * y[2] / u
    A, B, C = entries(top, y, u)
    return float(abs(A * A + B * C - (spectral_curve(top, y, u) + slip)) / (1 + abs(A * A) + abs(B * C)))


def _hamiltonian_sign(rng: Random, sign: int) -> float:
    """sign·{L, H} against the Lax equation of section 5.6."""
    top, y = draw(rng)
    u = 0.5 + rng.random()
    gradient = np.array((y[0], y[1], y[2], 0, 0, top.alpha))
    flow = poisson_tensor(y) @ gradient  # {y, H}
    return float(np.max(np.abs(sign * np.einsum("aij,a->ij", lax_gradient(u), flow) - lax_rate(top, y, u)))) / 16


ERRATA = [
    Erratum(
        "(2.18)", "2", "remainder O(ε²)", "remainder ε x/u³ + …: exactly L/i = alpha σ3 + J/u + x/(u(u − ε))",
        lambda g: _contraction(g, False), lambda g: _contraction(g, True),
    ),
    Erratum(
        "(2.20)", "2", "the morphisms hold: {x1, x2} = 0", "in the limit only: {x1, x2} = ε x3",
        lambda g: _morphism(g, False), lambda g: _morphism(g, True), prose=True,
    ),
    Erratum(
        "(2.5)–(2.6) with (2.21)", "2", "r = iP/(u − v) for L of (2.21)", "r = −P/(u − v) for L = i L_G",
        lambda g: _r_matrix(g, FACTOR_GAUDIN), lambda g: _r_matrix(g, FACTOR_TOP), prose=True,
    ),
    Erratum(
        "(2.22)", "2", "… + 2 J3/u + alpha²", "… + 2 alpha J3/u + alpha²",
        lambda g: _curve(g, False), lambda g: _curve(g, True),
    ),
    Erratum(
        "(5.1.9)", "5.1", "… + 2 J3/λ + alpha²", "… + 2 alpha J3/λ + alpha²",
        lambda g: _curve(g, False), lambda g: _curve(g, True),
    ),
    Erratum(
        "below (5.6.10)", "5.6", "L' = {H, L}", "L' = {L, H}, the flow (1.1)",
        lambda g: _hamiltonian_sign(g, -1), lambda g: _hamiltonian_sign(g, 1),
    ),
]  # fmt: skip
