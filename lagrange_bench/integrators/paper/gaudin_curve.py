"""Points of the spectral curve of the Gaudin magnet, and the flow that a two-point step is.

A point (λ, v), v² = ℓ(λ)·ℓ(λ), is given by λ, a `site` k and a `sheet`: (u − a_k) v is continued along the straight
segment from a_k, where it is sheet · |s_k|, to λ. On sheet 1 of site k short two-point steps follow the flow of +H_k.

One real two-point step with (λ, v) is the flow over time 1 of the interpolating Hamiltonian of section 5.6 (without the
paper's factor i), with μ = iv and the path from λ back along the segment and on to λ̄:

    ∫_λ^λ̄ μ du,   that is the flow of Σ c_j H_j with   c_j = Im ∫_a_k^λ du/(v (u − a_j)).

The c_j are functions of the H_j and s_j², and so the same at every step. All steps commute: steps with λ_1 … λ_k are the flow
with the sum of their c. There are two ways to the flow of one H_j over a time h:

- to order 2k with λ_i = a_j + |s_j| h z_i, where Im Σ z_i = 1 and Im Σ z_i^m = 0 for m = 2 … 2k. The 1/z_i are the
  roots of the denominator of the diagonal Padé approximant of exp(2it). For k = 1 this is λ = a_j + i |s_j| h, the
  paper's time step;
- exactly, by k = ⌊n/2⌋ steps and, for odd n, a turn about e3: see `gaudin_doubling`.

(Both are results of this project.)
"""

import math
from functools import reduce
from typing import Any

import numpy as np
import scipy.linalg
from mpmath import mp

from lagrange_bench.integrators.paper.lax import check_sheet
from lagrange_bench.integrators.paper.phase_space import Numbers, check_numbers, dot, root_near


def check_parameter(magnet: Any, lam: Any, name: str = "lam") -> Any:
    """λ as one finite number off every site."""
    array = check_numbers(lam, name)
    if array.ndim:
        raise ValueError(f"{name} must be one number; got shape {array.shape}")
    if any(array[()] == a for a in magnet.sites):
        raise ValueError(f"{name} = {lam} lies on a site")
    return array[()]


def check_upper(magnet: Any, lam: Any, name: str = "lam") -> Any:
    """λ in the upper half-plane."""
    lam = check_parameter(magnet, lam, name)
    if not lam.imag > 0:
        raise ValueError(f"{name} must have a positive imaginary part; got {lam}")
    return lam


def eigenvalue(magnet: Any, spins: Any, lam: Any, sheet: int = 1, site: int = 0) -> Any:
    """v with det(L_G(λ) − v) = 0, (2.11); for `sheet` and `site` see the module.

    ValueError if lam lies on a site, the spin at `site` is zero, or a branch point lies on the segment.
    """
    lam = check_parameter(magnet, lam)
    ell = magnet.vector(spins, lam)
    return check_sheet(sheet) * root_near(dot(ell, ell), _branch(magnet, spins, lam, magnet.check_site(site)))


def _branch(magnet: Any, spins: Any, lam: Any, site: int) -> complex:
    """v on sheet 1 in double: |s_site|/z Π √(1 − z/u_i)/Π (1 − z/a_j), z = λ − a_site, u_i the branch points.

    No principal root jumps on the segment unless u_i lies on it. Sites and u_i are counted from a_site, because they may lie far
    from 0.
    """
    start = magnet.sites[site]
    z, others = complex(lam - start), np.array([complex(a - start) for a in magnet.sites if a != start])
    square = dot(*[np.asarray(spins).astype(complex)[site]] * 2)
    if square == 0:
        raise ValueError(f"spins: the one at site {site} is zero")
    zeros = branch_points(magnet, spins, start)
    share = zeros / z
    if np.any((np.abs(share.imag) < 1e-12) & (share.real > 0) & (share.real < 1)):
        raise ValueError(f"lam = {lam}: a branch point of the curve lies on the segment to it")
    return complex(np.sqrt(square) * np.prod(np.sqrt(1 - z / zeros)) / np.prod(1 - z / others) / z)


def branch_points(magnet: Any, spins: Any, origin: Any = 0) -> Numbers:
    """The zeros of v², less `origin`, in double; a site without a spin counts as two.

    v² = α² + Σ H_j/(u − a_j) + C_j/(u − a_j)² is a transfer function, c (u − A)⁻¹ b + α² with a block of two for each site. Its
    zeros are the eigenvalues of a pencil, and better conditioned than the roots of Q.
    """
    n = len(magnet)
    A, N = np.zeros((2 * n + 1, 2 * n + 1), dtype=complex), np.eye(2 * n + 1)
    H, C, N[-1, -1] = magnet.hamiltonians(spins), magnet.casimirs(spins), 0.0
    for j, a in enumerate(magnet.sites):
        A[2 * j, 2 * j] = A[2 * j + 1, 2 * j + 1] = complex(a - origin)
        A[2 * j, 2 * j + 1], A[-1, 2 * j] = 1.0, -1.0
        A[2 * j, -1], A[2 * j + 1, -1] = complex(H[j]), complex(C[j])
    A[-1, -1] = -(float(magnet.alpha) ** 2)
    zeros = scipy.linalg.eigvals(A, N)
    return zeros[np.isfinite(zeros)]


def spectral_polynomial(magnet: Any, spins: Any) -> Numbers:
    """Ascending coefficients of Q(u) = Π (u − a_j)² v², of degree 2n; (2.12)."""
    H, C = magnet.hamiltonians(spins), magnet.casimirs(spins)
    squares = [np.array((a * a, -2 * a, 1)) for a in magnet.sites]
    Q = reduce(np.convolve, squares, np.array((magnet.alpha * magnet.alpha,)))
    for j, a in enumerate(magnet.sites):
        others = squares[:j] + squares[j + 1 :]
        Q = Q + reduce(np.convolve, others, np.array((C[j] - a * H[j], H[j], 0)))
    return Q


def pade_roots(k: int) -> list[Any]:
    """The z_i, i = 1 … k, with Im Σ z_i = 1 and Im Σ z_i^m = 0 for m = 2 … 2k, mpmath numbers."""
    f = math.factorial
    denominator = [f(2 * k - j) * f(k) // (f(j) * f(k - j)) * (-1) ** j for j in range(k + 1)]
    return [2j / root for root in polynomial_roots(denominator)]


def polynomial_roots(p: Any) -> list[Any]:
    """All roots of a polynomial with ascending coefficients, mpmath numbers: the eigenvalues of its companion matrix."""
    n = len(p) - 1
    if n == 1:  # mpmath 1.3 returns the eigenvalue of one number in a tuple
        return [-mp.mpc(p[0]) / p[1]]
    companion = mp.matrix(n)
    for i in range(n):
        companion[i, n - 1] = -mp.mpf(p[i]) / p[n]
        if i:
            companion[i, i - 1] = 1
    return mp.eig(companion, left=False, right=False)
