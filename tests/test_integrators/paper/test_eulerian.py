"""Section 5.4: the one-point map in Euler angles and its elementary generating function."""

import itertools
import random

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import LagrangeTop
from lagrange_bench.integrators.paper import eulerian
from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper.euler_angles import to_angles
from lagrange_bench.integrators.paper.lax import eigenvalue
from lagrange_bench.integrators.paper.one_point import one_point
from lagrange_bench.integrators.paper.phase_space import invariants, sqrt
from tests.test_integrators.paper.tools import DIGITS, largest, points

both = pytest.mark.parametrize("digits", DIGITS)
sheets = pytest.mark.parametrize("sheet", [1, -1])


def arguments(p):
    """λ, c1, c2, (θ, φ), (θ̃, φ̃), κ at random."""
    lam, c1, c2, theta, phi, theta_new, phi_new = p.numbers(7)
    old, new = (theta, phi), (theta_new, phi_new)
    return lam, c1, c2, old, new, eulerian.kappa(lam, old, new, 1.0) * p.rng.choice((-1, 1))


@both
def test_canonical_relations(digits):
    """(5.4.9) with F elementary gives (5.4.4) corrected and (5.4.5), general c1, both κ."""
    for p in points(digits):
        args = arguments(p)
        theta, phi, theta_new, phi_new, _ = eulerian.gradient(p.top, *args)
        p.same((theta, phi, -theta_new, -phi_new), eulerian.momenta(p.top, *args))


def test_gradient():
    """The derivatives done by hand, against differences of F: 30 digits."""
    for p in points(50, count=4):
        lam, c1, c2, old, new, k = arguments(p)

        def F(*v, p=p, leaf=(c1, c2), k=k):
            return eulerian.generating_function(p.top, v[4], *leaf, v[:2], v[2:4], k)

        values = (*old, *new, lam)
        for i, exact in enumerate(eulerian.gradient(p.top, lam, c1, c2, old, new, k)):
            order = tuple(int(i == j) for j in range(5))
            assert abs(mp.diff(F, values, order) - exact) < mpf(10) ** -30 * max(1, abs(exact))


@both
@sheets
def test_map_obeys_the_generating_function(digits, sheet):
    """The one-point map of complex states, in angles: momenta on both sides, p_φ conserved, μ = −∂F/∂λ."""
    for p in points(digits):
        y, lam = p.state(), p.number()
        y_new = one_point(p.top, y, lam, sheet)
        _, _, c1, c2 = invariants(p.top, y)
        old, new, k = eulerian.arguments(p.top, y, y_new)
        a, b = to_angles(y), to_angles(y_new)
        scale = largest(y_new) ** 2  # B(λ) nearly 0 sends the state far away
        p.same(k, eulerian.kappa(lam, old, new, k), terms=scale)
        p.same(eulerian.momenta(p.top, lam, c1, c2, old, new, k), (*a[2:], *b[2:]), terms=scale)
        mu = -eulerian.gradient(p.top, lam, c1, c2, old, new, k)[4]
        p.same(mu, eigenvalue(p.top, y, lam, sheet), terms=scale)


@both
def test_from_the_first_generating_function(digits):
    """Modulo a constant, 2πℓ/r times a whole number and half of one, F is (5.2.7) plus i x3 J-/x- + … on each side."""
    for p in points(digits):
        y, lam = p.state(), p.number()
        y_new = one_point(p.top, y, lam)
        _, _, c1, c2 = invariants(p.top, y)
        old, new, k = gf.arguments(p.top, y, y_new)
        first = gf.generating_function(p.top, lam, c1, c2, old, new, k)
        first += 1j * (y[5] * old[1] / old[0] + y_new[5] * new[1] / new[0])
        angles = eulerian.arguments(p.top, y, y_new)
        second = eulerian.generating_function(p.top, lam, c1, c2, *angles)
        l = c2 / sqrt(c1)
        for theta in (angles[0][0], angles[1][0]):
            tangent = (mp.tan if digits > 15 else np.tan)(theta / 2)
            first += 1j * l * (mp.log if digits > 15 else np.log)(tangent + 0j)
        turns = (second - first) / (2 * l * (mp.pi if digits > 15 else np.pi))
        p.same(turns, round(float(turns.real)), terms=largest(y_new) ** 2 / abs(l))


@both
def test_symmetry(digits):
    """(5.4.8), (5.4.10): F is symmetric in θ, θ̃; p_φ too, and p_θ turns into −p̃_θ."""
    for p in points(digits):
        lam, c1, c2, old, new, k = arguments(p)
        swapped = (new[0], old[1]), (old[0], new[1])
        leaf = lam, c1, c2
        F = [eulerian.generating_function(p.top, *leaf, *pair, k) for pair in ((old, new), swapped)]
        p.same(*F)
        a, b = (eulerian.momenta(p.top, *leaf, *pair, k) for pair in ((old, new), swapped))
        p.same((b[0], b[1], b[2]), (-a[2], a[1], -a[0]))
        # the exchange (θ, φ) ↔ (−θ̃, −φ̃) exchanges p_θ and p̃_θ
        mirrored = (-new[0], -new[1]), (-old[0], -old[1])
        p.same(eulerian.kappa(lam, *mirrored, k), k)
        p.same(eulerian.momenta(p.top, *leaf, *mirrored, k), (a[2], a[1], a[0], a[1]))


def mixed(p, top, args):
    """∂²F/∂(θ, φ)∂(θ̃, φ̃) by differences."""
    lam, c1, c2, old, new, k = args

    def F(*v):
        return eulerian.generating_function(top, lam, c1, c2, v[:2], v[2:], k)

    def order(i, j):
        return tuple(int(n in (i, 2 + j)) for n in range(4))

    return np.array([[mp.diff(F, (*old, *new), order(i, j)) for j in range(2)] for i in range(2)])


def test_zero_field_is_degenerate():
    """(5.4.16): at alpha = 0 the mixed derivatives have rank one and F defines no map; at alpha ≠ 0 they have rank two."""
    for p in points(40, count=3):
        args = arguments(p)
        still, field = mixed(p, LagrangeTop(0.0), args), mixed(p, p.top, args)
        assert largest(still - eulerian.zero_field_hessian(*args)) < mpf(10) ** -20 * largest(still)
        assert abs(still[0, 0] * still[1, 1] - still[0, 1] * still[1, 0]) < mpf(10) ** -20 * largest(still) ** 2
        assert abs(field[0, 0] * field[1, 1] - field[0, 1] * field[1, 0]) > 1e-3


@both
def test_zero_field_rank(digits):
    """The same in closed form: determinant 0."""
    for p in points(digits):
        h = eulerian.zero_field_hessian(*arguments(p))
        p.same(h[0, 0] * h[1, 1], h[0, 1] * h[1, 0])


def test_zero_field_momenta():
    """At alpha = 0 the relations hold as well: p_φ and p_θ of F with + iκ/λ."""
    for p in points(50):
        args, top = arguments(p), LagrangeTop(0.0)
        theta, phi, theta_new, _, _ = eulerian.gradient(top, *args)
        p.same((theta, phi, -theta_new), eulerian.momenta(top, *args)[:3])


@pytest.mark.parametrize("readings", list(itertools.product((0, 1), repeat=4)))
def test_no_reading_of_the_elliptic_integrals_works(readings):
    """(5.4.11)–(5.4.15): amplitude, modulus, characteristic and sign of S read either way; ∂F/∂θ is never p_θ."""
    assert eulerian.elliptic_residual(random.Random(1), True, readings) > 1e-2


@pytest.mark.parametrize("singular", ["lam", "theta", "theta_new", "kappa"])
def test_singular_charts_are_refused(singular):
    top = LagrangeTop(1.0)
    lam = {"lam": 0.0, "kappa": -1 / np.sin(1.0) ** 2}.get(singular, 0.5)
    old, new = (0.0 if singular == "theta" else 1.0, 0.0), (0.0 if singular == "theta_new" else 1.0, 0.0)
    with pytest.raises(ValueError, match=r"singular|branch point"):
        eulerian.momenta(top, lam, 1.0, 0.5, old, new, 1.0)


@pytest.mark.parametrize("erratum", eulerian.ERRATA, ids=lambda e: e.equation)
def test_errata(erratum):
    for seed in range(10):
        assert erratum.printed(random.Random(seed)) > 1e-2
        assert erratum.corrected(random.Random(seed)) < 1e-12
