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
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np
from mpmath import mp

from lagrange_bench.integrators.paper.lax import branch, check_sheet
from lagrange_bench.integrators.paper.phase_space import Numbers, dot, root_near


def eigenvalue(magnet: Any, spins: Any, lam: Any, sheet: int = 1, site: int = 0) -> Any:
    """v with det(L_G(λ) − v) = 0, (2.11); for `sheet` and `site` see the module. ValueError if lam lies on a site.

    Sites are counted from a_site, because they may lie far from 0.
    """
    ell, origin = magnet.vector(spins, lam), magnet.sites[magnet.check_site(site)]
    near = replace(magnet, sites=tuple(a - origin for a in magnet.sites))
    z, others = complex(lam - origin), np.array([complex(b) for b in near.sites if b != 0])
    at_site = np.prod(np.sign(-others.real))  # the sign of Π (u − a_j) there, without u − a_site
    m = at_site * branch(spectral_polynomial(near, spins), z)
    return check_sheet(sheet) * root_near(dot(ell, ell), complex(m / (z * np.prod(z - others))))


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
