"""Sections 5.2 to 5.4: the one-point map from its generating function, of top and magnet, in e(3) and in Euler angles."""

from functools import partial

import numpy as np
from mpmath import mpf

from lagrange_bench.integrators import LagrangeTop
from lagrange_bench.integrators.paper import eulerian
from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper.phase_space import gradient, sqrt
from tests.test_integrators.paper.tools import largest


def arguments(p, side=gf):
    """λ, c1, c2, old, new and a root k, all random: F needs no map."""
    lam, c1, c2, *v = p.numbers(7)
    root = sqrt(c1 + lam * v[0] * v[2]) if side is gf else eulerian.kappa(lam, v[:2], v[2:], 1.0)
    return lam, c1, c2, tuple(v[:2]), tuple(v[2:]), root * p.rng.choice((-1, 1))


def slopes(function, args):
    """∂F by x-, J-, x̃+, J̃+ (or the angles) and λ, by differences: more than 25 digits."""
    lam, *leaf, old, new, k = args
    return gradient(lambda v: function(v[4], *leaf, tuple(v[:2]), tuple(v[2:4]), k), (*old, *new, lam))


def test_canonical_relations(fine):
    """∂F of (5.2.7) by (5.2.5) gives (5.2.6), of (5.4.11) by (5.4.9) gives (5.4.4), (5.4.5); (5.3.1) −∂F/∂λ is μ."""
    args = arguments(fine)
    slope = slopes(partial(gf.generating_function, fine.top), args)
    claimed = (*gf.momenta(fine.top, *args), gf.eigenvalue(fine.top, *args))
    found = np.array((*gf.from_gradient(*args[3:5], slope), -slope[4]))
    assert largest(found - np.array(claimed)) < mpf(10) ** -30 * (1 + largest(claimed))
    for top in (fine.top, LagrangeTop(0.0)):  # (5.4.16)
        args = arguments(fine, eulerian)
        slope = slopes(partial(eulerian.generating_function, top), args)
        claimed = np.array(eulerian.momenta(top, *args))
        assert largest(slope[:4] * (1, 1, -1, -1) - claimed) < mpf(10) ** -30 * (1 + largest(claimed))


def test_symmetry(p):
    """(5.4.7), (5.4.8), (5.4.10): F is symmetric in θ, θ̃; p_φ too, and p_θ turns into −p̃_θ."""
    lam, c1, c2, old, new, k = arguments(p, eulerian)
    swapped = (new[0], old[1]), (old[0], new[1])
    leaf = lam, c1, c2
    p.same(*(eulerian.generating_function(p.top, *leaf, *pair, k) for pair in ((old, new), swapped)))
    a, b = (eulerian.momenta(p.top, *leaf, *pair, k) for pair in ((old, new), swapped))
    p.same((b[0], b[1], b[2]), (-a[2], a[1], -a[0]))
    # the exchange (θ, φ) ↔ (−θ̃, −φ̃) exchanges p_θ and p̃_θ
    mirrored = (-new[0], -new[1]), (-old[0], -old[1])
    p.same(eulerian.kappa(lam, *mirrored, k), k)
    p.same(eulerian.momenta(p.top, *leaf, *mirrored, k), (a[2], a[1], a[0], a[1]))


def test_zero_field_is_degenerate(fine):
    """(5.4.16): at alpha = 0 the mixed derivatives have rank one and F defines no map; at alpha ≠ 0 they have rank two."""
    lam, c1, c2, old, new, k = arguments(fine, eulerian)
    for top, degenerate in ((LagrangeTop(0.0), True), (fine.top, False)):
        mixed = gradient(lambda v, top=top: np.array(eulerian.momenta(top, lam, c1, c2, old, tuple(v), k)[:2]), new)
        rank_one = abs(mixed[0, 0] * mixed[1, 1] - mixed[0, 1] * mixed[1, 0]) < 1e-20 * largest(mixed) ** 2
        assert rank_one == degenerate


def test_gaudin_gradient(fine):
    """(5.2.8)–(5.2.10): gaudin_momenta are i s ∂F/∂s and −∂F/∂λ, by differences of (5.2.9)."""
    n, alpha, lam = 2, fine.top.alpha, fine.lam
    sites, squares, minus, plus = (fine.numbers(n) for _ in range(4))
    z = sqrt(squares - (sites - lam) * plus * minus)
    D = gradient(lambda v: gf.gaudin_function(alpha, v[4], sites, squares, v[:2], v[2:4], z), (*minus, *plus, lam))
    old3, new3, mu = gf.gaudin_momenta(alpha, lam, sites, squares, minus, plus, z)
    assert largest(1j * minus * D[:n] - old3) < mpf(10) ** -30
    assert largest(1j * plus * D[n:-1] - new3) < mpf(10) ** -30
    assert abs(D[-1] + mu) < mpf(10) ** -30
