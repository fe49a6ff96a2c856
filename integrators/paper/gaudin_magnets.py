"""Named magnets: the central-spin model with 8, 32 and 128 spins, and random magnets."""

import math
import random
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet


class NamedMagnet(NamedTuple):
    """A magnet and its initial spins (n, 3)."""

    magnet: GaudinMagnet
    spins: Array


def central_spin(n: int) -> NamedMagnet:
    """Unit spins in random directions, couplings A_k = 2/(a_1 − a_k) ~ exp(−2k/n) with Σ A_k² = 1, field 2 alpha = 1.

    The generator is Python's own, whose `random()` never changes.
    """
    couplings = [math.exp(-2 * k / n) for k in range(1, n)]
    size = math.sqrt(math.fsum(A * A for A in couplings))
    draw = random.Random(f"gaudin{n}")
    spins = np.array([_drawn(draw, 1.0) for _ in range(n)])
    return NamedMagnet(GaudinMagnet((0.0, *(-2 * size / A for A in couplings)), 0.5), spins)


def random_magnet(n: int, seed: int) -> NamedMagnet:
    """Sites at distances of 0.3 to 1, the moving one anywhere among them, alpha of either sign, spins of 0.2 to 1.5."""
    draw = random.Random(f"magnet{n}/{seed}")
    sites = [0.0]
    while len(sites) < n:
        sites.append(sites[-1] + draw.uniform(0.3, 1))
    alpha = draw.choice((-1, 1)) * draw.uniform(0.2, 1.5)
    spins = np.array([_drawn(draw, draw.uniform(0.2, 1.5)) for _ in range(n)])
    return NamedMagnet(GaudinMagnet(tuple(sites), alpha, site=draw.randrange(n)), spins)


def _drawn(draw: random.Random, size: float) -> tuple[float, float, float]:
    """A spin in a random direction."""
    z, phi = draw.uniform(-1, 1), draw.uniform(0, 2 * math.pi)
    r = math.sqrt(1 - z * z)
    return size * r * math.cos(phi), size * r * math.sin(phi), size * z


def unit_of_time(magnet: GaudinMagnet, spins: Array) -> float:
    """1/√(Σ A_k² |s_k|²), A_k the couplings of the magnet's site: 1 for `central_spin`; 1/(2 |alpha|) for one spin."""
    site = magnet.site or 0
    field = magnet.couplings[site] * np.linalg.norm(spins, axis=1)
    return 1 / float(np.linalg.norm(field) if len(magnet) > 1 else 2 * abs(magnet.alpha))


MAGNETS = {f"central{n}": central_spin(n) for n in (8, 32, 128)} | {"random": random_magnet(8, 0)}
