"""The real Gaudin magnet as a `Problem` on n spins: what `integrate`, `check` and the experiments see of it.

    H = Σ_j b_j s_j³ + Σ_{j<k} K_jk s_j·s_k,    b_j = 2 alpha c_j,    K_jk = 2 (c_j − c_k)/(a_j − a_k)

is Σ c_j H_j but for a constant. A state is the 3n numbers of the spins. The b and K are the parameters of H, so magnets of one
size share their kernels. Methods on a tape unroll all pairs of spins, so only magnets of up to `UNROLLED` spins offer a tape;
methods that loop over arrays of spins need "spins" and take any number.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.compiling.expression import record
from lagrange_bench.integrators.problem.field import dot
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import Space, System, make_system

UNROLLED = 6  # spins, 15 pairs: a right-hand side of some 200 operations


class MagnetProblem(Problem):
    """The flow of a magnet with real sites; made by `GaudinMagnet.problem`.

    Attributes
    ----------
    magnet : the magnet, its sites and alpha as doubles. names : H_0 … of its sites, and C1 … Cn, the squares of the spins.

    Raises
    ------
    ValueError : a site is not real.
    """

    def __init__(self, magnet: Any) -> None:
        if any(a.imag for a in magnet.sites):
            raise ValueError(
                "sites must be real numbers for `integrate`; lagrange_bench.integrators.paper takes conjugate pairs too"
            )
        sites = tuple(float(a.real) for a in magnet.sites)
        self.magnet = replace(magnet, sites=sites, alpha=float(magnet.alpha))
        n, c = len(sites), self.magnet.flow
        self.pairs = np.argwhere(np.triu(np.ones((n, n)), 1))
        K = (self.magnet.couplings * (c[:, None] - c))[tuple(self.pairs.T)]
        self.name, self.space, self.start = "magnet", Space(f"so3**{n}" if n > 1 else "so3", n), 0.0
        self.numbers = (*(2.0 * self.magnet.alpha * c).tolist(), *K.tolist())
        self.given, self.posed = {}, ()

    def __reduce__(self) -> Any:
        return MagnetProblem, (self.magnet,)

    @cached_property
    def system(self) -> System:  # type: ignore[override]
        """H and its bracket as formulas."""
        n = len(self.magnet)

        def energy(t: Any, *numbers: Any) -> tuple[Any]:
            spins, p = [numbers[3 * j : 3 * j + 3] for j in range(n)], numbers[3 * n :]
            in_field = (p[j] * spins[j][2] for j in range(n))
            bonds = (p[n + i] * dot(spins[j], spins[k]) for i, (j, k) in enumerate(self.pairs.tolist()))
            return (sum((*in_field, *bonds), start=0.0),)

        return make_system(self.space, record(energy, 1 + 3 * n + len(self.numbers)))

    @property
    def timed(self) -> bool:
        return False

    @cached_property
    def offers(self) -> frozenset[str]:
        """ "spins"; of few spins also "rhs", "smooth" and "parts"."""
        few = len(self.magnet) <= UNROLLED
        return frozenset({"spins", *(("rhs", "smooth", "parts") if few else ())})

    @property
    def as_top(self) -> None:
        """It is no top."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        n = len(self.magnet)
        return (*(f"H_{j}" for j in range(n)), *(f"C{j}" for j in range(1, n + 1)))

    def kept_by(self, claims: Any) -> frozenset[str]:
        """H_j are quadratic, C_j the Casimir functions."""
        quadratic = "H" in claims.conserves | claims.if_quadratic
        casimirs = {"C1", "C2"} <= claims.conserves
        return frozenset(name for name in self.names if (quadratic if name.startswith("H") else casimirs))

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """Spins (n, 3) or (3n,) as a fresh array (3n,). ValueError: they are none."""
        shape = np.shape(y)
        spins = self.magnet.check_spins(np.reshape(y, (-1, 3)) if len(shape) == 1 and shape[0] % 3 == 0 else y, name)
        if spins.dtype.kind != "f":
            raise ValueError(f"{name} must be real numbers; got dtype {spins.dtype}")
        return np.array(spins, dtype=float).ravel()

    # ------------------------------------------------------------------ its functions, by arrays

    def _spins(self, y: ArrayLike) -> Array:
        return np.reshape(np.asarray(y, dtype=float), (*np.shape(y)[:-1], len(self.magnet), 3))

    def rhs(self, y: ArrayLike, t: Any = 0.0) -> Array:
        rates: Array = self.magnet.rhs(self._spins(y), self.magnet.flow)
        return rates.reshape(np.shape(y))

    def poisson(self, y: ArrayLike) -> Array:
        return np.array(self.magnet.poisson(self._spins(y)), dtype=float)

    def invariants(self, y: ArrayLike, t: Any = 0.0) -> Array:
        values: Array = self.magnet.invariants(self._spins(y))
        return values

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes of the terms in `names` at one state (3n,)."""
        spins = self._spins(y)
        return np.concatenate((self.magnet.hamiltonian_scales(spins), self.magnet.casimirs(spins)))

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """Scale of the spins, 1, and of time: 1 over the largest rate at which a spin may turn."""
        sizes, c = np.linalg.norm(self._spins(y), axis=1), self.magnet.flow
        fields = np.abs(self.magnet.couplings * (c[:, None] - c)) @ sizes
        rate = float(np.max(np.abs(2.0 * self.magnet.alpha * c) + fields))
        return float(np.max(sizes)), 1.0, 1.0 / rate if rate else float("inf")
