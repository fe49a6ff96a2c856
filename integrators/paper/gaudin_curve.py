"""Points of the spectral curve of the Gaudin magnet, the flow that a two-point step is, and λ for a given time.

A point (λ, v), v² = ℓ(λ)·ℓ(λ), is given by λ, a `site` k and a `sheet`: (u − a_k) v is continued along the straight
segment from a_k, where it is sheet · |s_k|, to λ. With `site=None` it is v that is continued, from sheet · |ℓ| at Re λ.
Sheet 1 of site k is the one on which short two-point steps follow the flow of +H_k.

One real two-point step with (λ, v) is the flow over time 1 of the interpolating Hamiltonian of section 5.6 (without the
paper's factor i), with μ = iv and the path from λ back along the segment and on to λ̄:

    ∫_λ^λ̄ μ du,   that is the flow of Σ c_j H_j with   c_j = i ∫_λ^λ̄ du/(2v (u − a_j)).

The c_j are functions of the H_j and s_j²: the same at every step. All steps commute, so steps with λ_1 … λ_k are the
flow with the sum of their c. The flow of one H_j over a time h, the central-spin model for j the central site, is got

- to order 2k with λ_i = a_j + |s_j| h z_i, where Im Σ z_i = 1 and Im Σ z_i^m = 0 for m = 2 … 2k. The 1/z_i are the
  roots of the denominator of the diagonal Padé approximant of exp(2it). For k = 1 this is λ = a_j + i |s_j| h, the
  paper's time step;
- exactly, by k = ⌊n/2⌋ steps and, for odd n, a turn about e3: see `gaudin_doubling`.

(Both are results of this project.)
"""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
import scipy.linalg

from lagrange_bench.integrators.checks import check_count
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet, check_parameter, check_upper
from lagrange_bench.integrators.paper.lax import check_sheet
from lagrange_bench.integrators.paper.phase_space import E3, Numbers, dot, root_near, sqrt

STRIDE = 1 / 16  # longest interval of the grid, as a share of the segment
NODES = 14  # of the quadrature, per stride
FACTORS = 16  # steps that are composed, at most


def eigenvalue(magnet: GaudinMagnet, spins: Any, lam: Any, sheet: int = 1, site: int | None = 0) -> Any:
    """v with det(L_G(λ) − v) = 0, (2.11); for `sheet` and `site` see the module.

    ValueError if lam lies on a site, the spin at `site` is zero, or a branch point lies on the segment.
    """
    lam = check_parameter(magnet, lam)
    ell = magnet.vector(spins, lam)
    guess = complex(_follow(magnet, spins, lam, site)[1](np.ones(1))[0])
    if site is not None:
        guess /= complex(lam) - complex(magnet.sites[site])
    return check_sheet(sheet) * root_near(dot(ell, ell), guess)


def _follow(
    magnet: GaudinMagnet, spins: Any, lam: Any, site: int | None
) -> tuple[Callable[[Numbers], Numbers], Callable[[Numbers], Numbers], Numbers]:
    """w = (u − a_site) v (site None: v) on sheet 1 along u = start + t (λ − start), in double.

    Returns w² and w as functions of t (m,), and a grid from 0 to 1. Its intervals are no longer than the distance of each of
    their points from the nearest site and branch point, so w is smooth on each of them. The w serves to choose a root of w²:
    it is the product of the principal roots √(1 − z/(u_i − start)), z = u − start, over the branch points u_i, and none of
    these jumps unless u_i lies on the segment. Only differences from the start enter: the sites may lie far from 0.
    """
    start = _start(magnet, lam, site)
    length = complex(lam - start)
    gaps, rest, pole = -_from(magnet, start), np.asarray(spins).astype(complex), np.zeros(3)
    if site is not None:  # (u − a_site) ℓ has no pole at the start
        gaps, rest, pole = np.delete(gaps, site), np.delete(rest, site, axis=0), rest[site]
    elif np.any(gaps == 0):
        raise ValueError(f"lam = {lam} lies above a site: name it as `site`")

    def square(t: Numbers) -> Numbers:
        z = t[:, None] * length
        ell = float(magnet.alpha) * E3 + (1 / (gaps + z)) @ rest
        ell = ell if site is None else pole + z * ell
        return np.sum(ell * ell, axis=1)

    first = complex(square(np.zeros(1))[0])
    if first == 0:
        raise ValueError(f"spins: {'ℓ(Re lam)' if site is None else f'the one at site {site}'} is zero")
    zeros, poles = branch_points(magnet, spins, start), -gaps
    zeros = zeros[zeros != 0]

    def root(t: Numbers) -> Numbers:
        z = t[:, None] * length
        return np.sqrt(first) * np.prod(np.sqrt(1 - z / zeros), axis=1) / np.prod(1 - z / poles, axis=1)

    grid, near = [0.0], np.concatenate((zeros, poles)) / length
    while grid[-1] < 1:
        stride = min(STRIDE, 0.5 * np.min(np.abs(near - grid[-1]), initial=1.0))
        if stride < 1e-12:
            raise ValueError(f"lam = {lam}: a branch point of the curve lies on the segment to it")
        grid.append(min(grid[-1] + stride, 1.0))
    return square, root, np.array(grid)


def branch_points(magnet: GaudinMagnet, spins: Any, origin: Any = 0) -> Numbers:
    """The zeros of v², less `origin`, in double; each site without a spin is one twice.

    v² = α² + Σ H_j/(u − a_j) + C_j/(u − a_j)² is a transfer function, c (u − A)⁻¹ b + α² with a block of two for each site. Its
    zeros are the eigenvalues of a pencil, better conditioned than the roots of Q.
    """
    n = len(magnet)
    A, N = np.zeros((2 * n + 1, 2 * n + 1), dtype=complex), np.eye(2 * n + 1)
    H, C, N[-1, -1] = magnet.hamiltonians(spins), magnet.casimirs(spins), 0.0
    for j, site in enumerate(_from(magnet, origin)):
        A[2 * j, 2 * j] = A[2 * j + 1, 2 * j + 1] = site
        A[2 * j, 2 * j + 1], A[-1, 2 * j] = 1.0, -1.0
        A[2 * j, -1], A[2 * j + 1, -1] = complex(H[j]), complex(C[j])
    A[-1, -1] = -(float(magnet.alpha) ** 2)
    found = scipy.linalg.eigvals(A, N)
    return found[np.isfinite(found)]


def _from(magnet: GaudinMagnet, origin: Any) -> Numbers:
    """a_j − origin, in double: each difference is rounded once, so a common part of the sites leaves no trace."""
    return np.array([complex(a - origin) for a in magnet.sites])


def _start(magnet: GaudinMagnet, lam: Any, site: Any) -> Any:
    """Where the segment to λ starts: a_site, or Re λ."""
    if site is None:
        return lam.real
    if isinstance(site, bool) or not isinstance(site, (int, np.integer)) or not 0 <= site < len(magnet):
        raise ValueError(f"site must be None or a whole number from 0 to {len(magnet) - 1}; got {site!r}")
    return magnet.sites[site]


def spectral_polynomial(magnet: GaudinMagnet, spins: Any) -> Numbers:
    """Ascending coefficients of Q(u) = Π (u − a_j)² v², of degree 2n; (2.12)."""
    H, C = magnet.hamiltonians(spins), magnet.casimirs(spins)
    squares = [np.array((a * a, -2 * a, 1)) for a in magnet.sites]
    Q = reduce(np.convolve, squares, np.array((magnet.alpha * magnet.alpha,)))
    for j, a in enumerate(magnet.sites):
        others = squares[:j] + squares[j + 1 :]
        Q = Q + reduce(np.convolve, others, np.array((C[j] - a * H[j], H[j], 0)))
    return Q


# ------------------------------------------------------------------------------------------ the flow of a step


def times(magnet: GaudinMagnet, spins: Any, lams: Any, sheet: int = 1, site: int | None = 0) -> Numbers:
    """c_j, shape (n,): steps with all of `lams` are the flow of Σ c_j H_j over time 1. Real at real sites."""
    c = np.zeros(len(magnet), dtype=complex)
    for lam in np.atleast_1d(lams):
        c += _segment(magnet, spins, check_upper(magnet, complex(lam), "lams"), site)
    c *= check_sheet(sheet)
    return c.real if not any(a.imag for a in magnet.sites) else c


def _segment(magnet: GaudinMagnet, spins: Any, lam: complex, site: int | None) -> Numbers:
    """i ∫ du/(2v (u − a_j)) from λ down the segment to its start and up the conjugate one.

    Gauss-Legendre between the points of a grid that keeps its distance from sites and branch points: full accuracy with few
    nodes.
    """
    square, root, grid = _follow(magnet, spins, lam, site)
    x, weights = np.polynomial.legendre.leggauss(NODES)
    stride = np.diff(grid)[:, None]
    t = (grid[:-1, None] + stride * (x + 1) / 2).ravel()
    v = root_near(square(t), root(t))
    start = _start(magnet, lam, site)
    length = complex(lam - start)
    z = t * length
    v = v if site is None else v / z
    f = (stride * weights / 2).ravel() * length / v
    above, below = 1 / (z[:, None] - _from(magnet, start)), 1 / (z.conj()[:, None] - _from(magnet, start.conjugate()))
    return 0.5j * (f.conj() @ below - f @ above)


def pade_parameters(magnet: GaudinMagnet, spins: Any, h: float, factors: int = 1, site: int = 0) -> Numbers:
    """λ_i − a_site, shape (factors,), of a step of order 2·factors for the flow of H_site over the time h > 0."""
    if check_count(factors, "factors", least=1) > FACTORS:
        raise ValueError(f"factors must be from 1 to {FACTORS}; got {factors!r}")
    return real_spin(magnet, spins, site)[1] * h * pade_roots(factors)


def real_spin(magnet: GaudinMagnet, spins: Any, site: int) -> tuple[Any, Any]:
    """a_site and |s_site|, both real. ValueError if they are not, or the spin is zero."""
    a, size = _start(magnet, 0j, site), sqrt(dot(spins[site], spins[site]))
    if a.imag or size.imag or not size.real > 0:
        raise ValueError(f"site: {site} must be a real site with a real spin that is not zero")
    return a.real, size.real


def pade_roots(k: int) -> Numbers:
    """The z_i, shape (k,), with Im Σ z_i = 1 and Im Σ z_i^m = 0 for m = 2 … 2k."""
    f = math.factorial
    denominator = [f(2 * k - j) * f(k) // (f(j) * f(k - j)) / f(2 * k) * (-1) ** j for j in range(k + 1)]
    z = 2j / np.roots(denominator[::-1])
    return z[np.argsort(z.real)]
