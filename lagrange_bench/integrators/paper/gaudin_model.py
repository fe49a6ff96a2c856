"""The sl(2) Gaudin magnet (paper, section 2): its Lax matrix, brackets, Hamiltonians and flows.

n spins s_j = (s¹, s², s³) at sites a_j, in a field alpha along e3; spins are arrays (n, 3), states of several runs
(..., n, 3). The Lax matrix is L_G(u) = σ·ℓ(u), with the vector

    ℓ(u) = alpha e3 + Σ s_j/(u − a_j)                                                                  (2.1), (2.2)
    {s_j¹, s_j²} = s_j³ (cyclic), spins at different sites commute                                           (2.3)
    v² = ℓ·ℓ = alpha² + Σ (H_j/(u − a_j) + s_j²/(u − a_j)²)                                          (2.11), (2.12)
    H_j = 2 alpha s_j³ + Σ_{k≠j} 2 s_j·s_k/(a_j − a_k)                                                      (2.13)

Alpha and sites are real; the spins may be complex. Everything here is + − * / and a square root: it runs in double, and
in mpmath on object arrays.

Points (λ, v) of the curve are in `gaudin_curve`, the maps that take them in `gaudin_maps`, the exact step in
`gaudin_doubling`, the limit in which two sites become a top in `contraction`.
"""

from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import Array, check_count, check_real
from lagrange_bench.integrators.paper import gaudin_doubling
from lagrange_bench.integrators.paper.errata import Erratum
from lagrange_bench.integrators.paper.lax import gaudin_vector
from lagrange_bench.integrators.paper.phase_space import (
    E3,
    Numbers,
    check_numbers,
    check_reals,
    dot,
    poisson_tensor,
)
from lagrange_bench.integrators.problem.problem import Problem


@dataclass(frozen=True)
class GaudinMagnet:
    """n spins at sites in a field, and which of their n commuting flows they follow. Hashable, picklable.

        magnet = GaudinMagnet(sites=(0.0, -1.0, -3.0), alpha=0.5)
        magnet.exact_step(spins, 80.0)

    Parameters
    ----------
    sites : tuple
        The a_j: real numbers, also mpmath ones.
    alpha : number
        The field, along e3.
    site : int
        Follow the flow of H_site.

    Raises
    ------
    ValueError
        Sites that coincide; sites or alpha that are not real and finite; there is no such site.
    """

    sites: tuple[Any, ...]
    alpha: Any = 1.0
    site: int = 0

    def __post_init__(self) -> None:
        sites, alpha = check_reals(self.sites, "sites"), check_reals(self.alpha, "alpha")
        if sites.ndim != 1 or len(sites) == 0:
            raise ValueError(f"sites must be a sequence of one or more numbers; got shape {sites.shape}")
        for j, a in enumerate(sites):
            if any(a == b for b in sites[:j]):
                raise ValueError(f"sites must be distinct; {a} appears twice")
        if alpha.ndim:
            raise ValueError(f"alpha must be one number; got {self.alpha!r}")
        object.__setattr__(self, "sites", tuple(sites.tolist()))
        object.__setattr__(self, "alpha", alpha.tolist())
        self.check_site(self.site)

    def exact_step(self, spins: Any, h: float) -> Array:
        """The spins after the flow of H_site over a time h, as one step; computed in many digits and rounded once.

        Parameters
        ----------
        spins : (n, 3) or (3n,)
            Real spins.
        h : float
            The time, of either sign and any length. Units: alone, H_j turns s_j by 2 alpha h about e3.

        Returns
        -------
        (n, 3)
            The spins.

        Raises
        ------
        ValueError
            Spins that are not real, or not n of them; or h is not a finite number.
        ArithmeticError
            600 digits are not enough.
        """
        return gaudin_doubling.exact_step(self, self.check_real_spins(spins), check_real(h, "h"))

    def problem(self) -> Problem:
        """The flow of H_site as a `Problem`, for general methods. Its states have 3n numbers; magnets of a size share kernels."""
        n, site = len(self), self.site

        def energy(t: Any, y: Any, p: Any) -> Any:
            s = y.reshape(n, 3)
            return p[0] * s[site, 2] + sum(p[1 + k] * (s[site] @ s[k]) for k in range(n) if k != site)

        return Problem("magnet", n, energy, tuple(map(float, (2 * self.alpha, *self.couplings[site]))))

    def __len__(self) -> int:
        return len(self.sites)

    def vector(self, spins: Any, u: Any) -> Numbers:
        """ℓ(u), shape (..., 3); (2.1), (2.2). ValueError at a site."""
        return gaudin_vector(self.alpha, self.sites, spins, u)

    def casimirs(self, spins: Any) -> Numbers:
        """The squares s_j² of the spins, shape (..., n); (2.4)."""
        return dot(spins, spins)

    def hamiltonians(self, spins: Any) -> Numbers:
        """H_j, shape (..., n); (2.13)."""
        spins = np.asarray(spins)
        products = spins @ np.swapaxes(spins, -1, -2)
        return 2 * self.alpha * spins[..., 2] + np.sum(self.couplings * products, axis=-1)

    def invariants(self, spins: Any) -> Numbers:
        """H_j and s_j², shape (..., 2n)."""
        return np.concatenate((self.hamiltonians(spins), self.casimirs(spins)), axis=-1)

    @property
    def couplings(self) -> Numbers:
        """2/(a_j − a_k), 0 on the diagonal, shape (n, n)."""
        a = np.asarray(self.sites)
        gaps = a[:, None] - a + np.eye(len(a), dtype=int)
        return 2 / gaps * (1 - np.eye(len(a), dtype=int))

    def gradient(self, spins: Any, c: Any) -> Numbers:
        """Gradient of Σ c_j H_j: at site j 2 alpha c_j e3 + Σ_k 2 (c_j − c_k)/(a_j − a_k) s_k; shape (..., n, 3)."""
        c = np.asarray(c)
        return (self.couplings * (c[:, None] - c)) @ np.asarray(spins) + 2 * self.alpha * c[:, None] * E3

    def rhs(self, spins: Any, c: Any) -> Numbers:
        """Equations of motion of Σ c_j H_j, f' = {f, Σ c_j H_j}: each spin turns about its gradient; (..., n, 3)."""
        return np.cross(self.gradient(spins, c), np.asarray(spins))

    def poisson(self, spins: Any) -> Numbers:
        """The Poisson tensor (3n, 3n) at spins (n, 3); (2.3)."""
        return poisson_tensor(*spins)

    def check_spins(self, spins: Any, name: str = "spins") -> Numbers:
        """`spins`, (n, 3) or (3n,), as an array (n, 3) of its own; ValueError naming the argument if they are anything else."""
        array = check_numbers(spins, name)
        if array.shape == (3 * len(self),):
            array = array.reshape(-1, 3)
        if array.shape != (len(self), 3):
            raise ValueError(f"{name} must have shape ({len(self)}, 3), one row for each site; got {array.shape}")
        return array.astype(float) if array.dtype.kind in "iu" else array

    def check_real_spins(self, spins: Any) -> Numbers:
        """As `check_spins`; ValueError unless they are real but for round-off."""
        array = self.check_spins(spins)
        s = array.astype(complex)
        if np.max(np.abs(s.imag)) > 1e-12 * np.max(np.abs(s)):
            raise ValueError(f"spins must be real; got {array.tolist()!r}")
        return array

    def check_site(self, site: Any) -> int:
        """The number of a site."""
        if check_count(site, "site") >= len(self):
            raise ValueError(f"site must be from 0 to {len(self) - 1}; got {site}")
        return site


# ------------------------------------------------------------------------------------------------ misprints


def _dimension(rng: Random, printed: bool) -> float:
    """How far the flows of H_1, H_2, H_3 and the turn about e3 of three spins leave a space of 2 or 3 dimensions.

    It is the next singular value of their unit vectors at a random state: 0 if that many dimensions hold them all.
    """
    magnet = GaudinMagnet((-2.0 + rng.random(), rng.random(), 2.0 + rng.random()), alpha=0.5 + rng.random())
    spins = np.array([[rng.gauss(0, 1) for _ in range(3)] for _ in range(3)])
    flows = [magnet.rhs(spins, c).ravel() for c in np.eye(3)] + [np.cross(E3, spins).ravel()]
    directions = [flow / np.linalg.norm(flow) for flow in flows]
    return float(np.linalg.svd(directions, compute_uv=False)[2 if printed else 3])


ERRATA = [
    Erratum(
        "(2.11), text", "2", "the motion is linearised on the Jacobian of Γ_G, of dimension n − 1",
        "on a generalised Jacobian, of dimension n: the Jacobian and the turns about e3", _dimension, prose=True,
    ),
]  # fmt: skip
