"""Section 2 of the paper: Lax matrices of the top and of the Gaudin magnet, spectral curve, r-matrix algebra.

States and numbers are those of `phase_space`. With Pauli matrices

    L_G(u) = alpha σ3 + Σ σ·s_j/(u − a_j)                n sites                                    (2.1), (2.2)
    L(u)   = i (alpha σ3 + σ·J/u + σ·x/u²)               the top, L = i L_G after the contraction   (2.21)

Two points lie over each λ of the spectral curve, distinguished by `sheet`: μ = ±i m/λ² with m = √Q(λ), the branch that
comes from √C1 at λ = 0 along the straight segment. Code passes m, which has no pole, where the paper passes μ.

Corrected here (see `ERRATA`): the curve (2.22) has 2 alpha J3/u, and L of (2.21) has the r-matrix −P/(u − v).
"""

from random import Random
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.paper import phase_space
from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.phase_space import E3, Numbers, cartesian, components, ladder, lift, root_near
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth.curve import horner

PAULI = np.array((((0, 1), (1, 0)), ((0, -1j), (1j, 0)), ((1, 0), (0, -1))))
PERMUTATION = np.array(((1, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
FACTOR_GAUDIN = 1j  # r = factor P/(u − v) for L_G, (2.6)
FACTOR_TOP = -1.0  # the same for L = i L_G


def square(a: Any, b: Any, c: Any, d: Any) -> Numbers:
    """((a, b), (c, d)), shape (..., 2, 2)."""
    entries = np.stack(np.broadcast_arrays(a, b, c, d), axis=-1)
    return entries.reshape(*entries.shape[:-1], 2, 2)


def determinant(M: Numbers) -> Any:
    """The determinants of matrices (..., 2, 2) of any numbers."""
    return M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1] * M[..., 1, 0]


def adjugate(M: Numbers) -> Numbers:
    """det M times the inverse of matrices (..., 2, 2)."""
    trace = np.asarray(np.trace(M, axis1=-2, axis2=-1))
    return trace[..., None, None] * np.eye(2, dtype=int) - M


def commutator(a: Numbers, b: Numbers) -> Numbers:
    """a b − b a."""
    return a @ b - b @ a


def pauli(v: Any) -> Numbers:
    """σ·v = ((v3, v-), (v+, −v3)), shape (..., 2, 2), of vectors (..., 3)."""
    v1, v2, v3 = components(v)
    return square(v3 + 0j, v1 - 1j * v2, v1 + 1j * v2, -v3 + 0j)


def from_pauli(J: Numbers, x: Numbers) -> Numbers:
    """The state (..., 6) of σ·J and σ·x."""
    return cartesian(*(m[..., i, j] for m in (J, x) for i, j in ((0, 0), (0, 1), (1, 0))))


def entries(top: LagrangeTop, y: Any, u: Any) -> tuple[Any, Any, Any]:
    """A(u), B(u), C(u) of the top's L(u) = ((A, B), (C, −A)); (2.21)."""
    phase_space.refuse(u, "the Lax matrix of the top has its pole at u = 0")
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    u = lift(u, J3)
    u2 = u * u
    return 1j * (J3 / u + x3 / u2 + top.alpha), 1j * (Jm / u + xm / u2), 1j * (Jp / u + xp / u2)


def lax_matrix(top: LagrangeTop, y: Any, u: Any) -> Numbers:
    """L(u) of the top, (..., 2, 2); (2.21)."""
    A, B, C = entries(top, y, u)
    return square(A, B, C, -A)


def gaudin_vector(alpha: Any, sites: ArrayLike, spins: Any, u: Any) -> Numbers:
    """ℓ(u) = alpha e3 + Σ s_j/(u − a_j), (..., 3), of the Gaudin magnet, (2.2): sites (n,), spins (..., n, 3).

    A, B, C are ℓ3, ℓ1 − iℓ2, ℓ1 + iℓ2. ValueError at a site.
    """
    gaps = u - np.asarray(sites)
    if np.any(gaps == 0):
        raise ValueError(f"lam = {u} lies on a site")
    return np.sum(np.asarray(spins) / gaps[:, None], axis=-2) + alpha * E3


def gaudin_matrix(alpha: Any, sites: ArrayLike, spins: Any, u: Any) -> Numbers:
    """L_G(u) of the n-site sl(2) Gaudin magnet, (..., 2, 2); (2.1). `1j` times it is L of (2.15)."""
    return pauli(gaudin_vector(alpha, sites, spins, u))


def spectral_polynomial(top: LagrangeTop, y: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Ascending coefficients of Q(u) = C1 + 2 C2 u + 2H u² + 2 alpha J3 u³ + alpha² u⁴ = u⁴ det L(u)."""
    H, J3, C1, C2 = phase_space.invariants(top, y)
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

    ValueError for C1 = 0. If a root of Q lies on the segment, round-off decides the side: choose another λ.
    """
    q = spectral_polynomial(top, y)
    phase_space.refuse(q[0], "C1 = 0: the two sheets of the spectral curve meet at 0, there is no branch to follow")
    return root_near(horner(q, lam), branch(q, lam))


def branch(q: Any, lam: Any) -> Numbers:
    """√Q(λ) in double, continuous from the principal √Q(0) along the segment, of Q with the ascending coefficients q.

    It is √q0 Π √(1 − λ w), 1/w the roots of Q. Along the segment each factor runs straight from 1 to 1 − λ w and meets the cut
    of the principal root only if the segment meets 1/w. The w are the eigenvalues of a companion matrix, 0 where the degree of
    Q is less than its coefficients allow.
    """
    coefficients, lam = [np.asarray(c).astype(complex) for c in q], np.asarray(lam).astype(complex)
    degree = len(q) - 1
    shape = np.broadcast_shapes(*(c.shape for c in coefficients))
    companion = np.zeros((*shape, degree, degree), dtype=complex)
    for k in range(degree):
        companion[..., 0, k] = -coefficients[k + 1] / coefficients[0]
    companion[..., range(1, degree), range(degree - 1)] = 1
    w = np.linalg.eigvals(companion)
    return np.sqrt(coefficients[0]) * np.prod(np.sqrt(1 - lam[..., None] * w), axis=-1)


def eigenvalue(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1) -> Any:
    """μ with det(L(λ) − μ) = 0, (5.1.7), (5.1.9): μ = sheet · i m/λ², continuous in λ from +i √C1/λ² for sheet 1."""
    phase_space.refuse(lam, "λ = 0 is the pole of μ")
    m = root(top, y, lam)
    lam = lift(lam, m)
    return check_sheet(sheet) * 1j * m / (lam * lam)


def check_sheet(sheet: int) -> int:
    """The sheet, 1 or −1; ValueError for anything else."""
    if sheet not in (1, -1):
        raise ValueError(f"sheet must be 1 or -1; got {sheet!r}")
    return sheet


def r_matrix(w: Any, factor: complex = FACTOR_GAUDIN) -> Numbers:
    """factor · P/w, P the permutation of C² ⊗ C²; (2.6) with factor i."""
    return PERMUTATION * (factor / w)


def matrix_brackets(left: Numbers, P: Numbers, right: Numbers) -> Numbers:
    """{L(u) ⊗ 1, 1 ⊗ L(v)}, (4, 4), from the gradients (n, 2, 2) of L(u) and of L(v) and the Poisson tensor (n, n)."""
    return np.einsum("aij,ab,bkl->ikjl", left, P, right).reshape(4, 4)


def lax_gradient(u: Any) -> Numbers:
    """∂L(u)/∂y of the top, (6, 2, 2); L is affine in y."""
    return np.concatenate((1j * PAULI / u, 1j * PAULI / (u * u)))


def linear_algebra_defect(brackets: Numbers, Lu: Numbers, Lv: Numbers, r: Numbers) -> Numbers:
    """{L¹(u), L²(v)} − [r(u − v), L¹(u) + L²(v)], (4, 4): zero by (2.5) for L_G with factor i, for L with −1."""
    one = np.eye(2, dtype=int)
    return brackets - commutator(r, np.kron(Lu, one) + np.kron(one, Lv))


def quadratic_algebra_defect(brackets: Numbers, Mu: Numbers, Mv: Numbers, r: Numbers) -> Numbers:
    """{M¹(u), M²(v)} − [r(u − v), M¹(u) M²(v)], (4, 4): (5.1.5)."""
    return brackets - commutator(r, np.kron(Mu, Mv))


def lax_rate(top: LagrangeTop, y: Any, u: Any) -> Numbers:
    """L'(u) = [(i/2u) σ·x, L(u)] along the flow (1.1), that is {L, H}; section 5.6, below (5.6.10)."""
    return commutator(pauli(np.asarray(y)[..., 3:]) * (0.5j / u), lax_matrix(top, y, u))


# ------------------------------------------------------------------------------------------------ misprints


def _r_matrix(rng: Random, printed: bool) -> float:
    top, y = draw(rng)
    u, v = 0.5 + rng.random(), -0.5 - rng.random() * 1j
    brackets = matrix_brackets(lax_gradient(u), phase_space.poisson_tensor(y), lax_gradient(v))
    r = r_matrix(u - v, FACTOR_GAUDIN if printed else FACTOR_TOP)
    defect = linear_algebra_defect(brackets, lax_matrix(top, y, u), lax_matrix(top, y, v), r)
    return float(np.max(np.abs(defect))) / 16


def curve_residual(rng: Random, printed: bool) -> float:
    """det L(u) against −v² of the curve, with 2 J3/u or with 2 alpha J3/u, relative to the terms."""
    top, y = draw(rng)
    u = 0.5 + rng.random() + 1j * rng.random()
    slip = 2 * (top.alpha - 1) * y[2] / u if printed else 0
    A, B, C = entries(top, y, u)
    return float(abs(A * A + B * C - spectral_curve(top, y, u) - slip) / (1 + abs(A * A) + abs(B * C)))


def _hamiltonian_sign(rng: Random, printed: bool) -> float:
    """{H, L}, corrected {L, H}, against the Lax equation of section 5.6."""
    top, y = draw(rng)
    u = 0.5 + rng.random()
    flow = phase_space.vector_field(top, y) * (-1 if printed else 1)
    return float(np.max(np.abs(np.einsum("aij,a->ij", lax_gradient(u), flow) - lax_rate(top, y, u)))) / 16


ERRATA = [
    Erratum(
        "(2.5)–(2.6) with (2.21)", "2", "r = iP/(u − v) for L of (2.21)", "r = −P/(u − v) for L = i L_G",
        _r_matrix, prose=True,
    ),
    Erratum("(2.22)", "2", "… + 2 J3/u + alpha²", "… + 2 alpha J3/u + alpha²", curve_residual),
    Erratum("(5.1.9)", "5.1", "… + 2 J3/λ + alpha²", "… + 2 alpha J3/λ + alpha²", curve_residual),
    Erratum("below (5.6.10)", "5.6", "L' = {H, L}", "L' = {L, H}, the flow (1.1)", _hamiltonian_sign),
]  # fmt: skip
