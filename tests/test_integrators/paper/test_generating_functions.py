"""Sections 5.2 and 5.3: the one-point map from its generating function, of the top and of the Gaudin magnet."""

import itertools
import random

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper.lax import eigenvalue, gaudin_entries, lax_matrix, pauli
from lagrange_bench.integrators.paper.one_point import dressing_matrix, k_value, one_point
from lagrange_bench.integrators.paper.phase_space import cartesian, invariants, ladder, sqrt
from tests.test_integrators.paper.tools import DIGITS, largest, points

both = pytest.mark.parametrize("digits", DIGITS)
sheets = pytest.mark.parametrize("sheet", [1, -1])


def arguments(p):
    """λ, c1, c2, (x-, J-), (x̃+, J̃+) and a k, all random: F needs no map."""
    lam, c1, c2, xm, Jm, xp, Jp = p.numbers(7)
    return lam, c1, c2, (xm, Jm), (xp, Jp), sqrt(c1 + lam * xm * xp) * p.rng.choice((-1, 1))


# ---------------------------------------------------------------------------------------------- the top


@both
def test_canonical_relations(digits):
    """(5.2.5) with ∂F/∂… from (5.2.7) gives (5.2.6), at general c1 and on both roots k."""
    for p in points(digits):
        args = arguments(p)
        F = gf.gradient(p.top, *args)
        p.same(gf.from_gradient(*args[3:5], F), gf.momenta(p.top, *args))


@both
def test_spectrality(digits):
    """(5.3.1), (5.3.2): μ = −∂F/∂λ = A(λ) − q B(λ) = the middle member corrected, on the curve."""
    for p in points(digits):
        args = lam, *_, new, _ = arguments(p)
        y, _ = gf.states(p.top, *args)
        L = lax_matrix(p.top, y, lam)
        mu = L[0, 0] - new[1] / (2 * p.top.alpha) * L[0, 1]
        p.same(-gf.gradient(p.top, *args)[4], mu)
        p.same(gf.eigenvalue(p.top, *args), mu)
        p.same(mu * mu, L[0, 0] * L[0, 0] + L[0, 1] * L[1, 0])


def test_gradient():
    """The derivatives of (5.2.7) done by hand, against differences: 30 digits."""
    for p in points(50, count=4):
        lam, c1, c2, old, new, k = arguments(p)
        values = [*old, *new, lam]

        def F(xm, Jm, xp, Jp, lam, p=p, leaf=(c1, c2), k=k):
            return gf.generating_function(p.top, lam, *leaf, (xm, Jm), (xp, Jp), k)

        for i, exact in enumerate(gf.gradient(p.top, lam, c1, c2, old, new, k)):
            order = tuple(int(i == j) for j in range(5))
            assert abs(mp.diff(F, tuple(values), order) - exact) < mpf(10) ** -30 * max(1, abs(exact))


@both
def test_states_are_related_by_the_map(digits):
    """Any four numbers and k give y and ỹ with M L = L̃ M (5.1.3), so with equal invariants: F generates the map."""
    for p in points(digits):
        args = lam, c1, c2, old, new, _ = arguments(p)
        y, y_new = gf.states(p.top, *args)
        H, J3, C1, C2 = invariants(p.top, y)
        p.same((C1, C2), (c1, c2))
        p.same(invariants(p.top, y_new), (H, J3, c1, c2))
        M_factors = old[1] / (2 * p.top.alpha), new[1] / (2 * p.top.alpha)
        for u in p.numbers(2):
            M = dressing_matrix(*M_factors, lam, u)
            p.same(M @ lax_matrix(p.top, y, u), lax_matrix(p.top, y_new, u) @ M)
        p.same(one_point(p.top, y, lam, mu=gf.eigenvalue(p.top, *args)), y_new)


@both
@sheets
def test_map_obeys_the_generating_function(digits, sheet):
    """From the map to F: k is k_value on its sheet, (5.2.6) gives both sides, −∂F/∂λ the μ of that sheet."""
    for p in points(digits):
        y, lam = p.state(), p.number()
        y_new = one_point(p.top, y, lam, sheet)
        old, new, k = gf.arguments(p.top, y, y_new)
        _, _, c1, c2 = invariants(p.top, y)
        scale = largest(y_new) ** 2  # B(λ) nearly 0 sends the state far away
        p.same(k, k_value(p.top, y, lam, sheet), terms=scale)
        p.same(k * k, gf.root_k(p.top, lam, c1, old, new, k) ** 2, terms=scale)
        expected = y[2], y[5], y_new[2], y_new[5]
        p.same(gf.momenta(p.top, lam, c1, c2, old, new, k), expected, terms=scale)
        p.same(-gf.gradient(p.top, lam, c1, c2, old, new, k)[4], eigenvalue(p.top, y, lam, sheet), terms=scale)


@pytest.mark.parametrize("name", ["figure1", "figure2"])
@sheets
def test_figures(name, sheet):
    """Real data of the paper's figures, |x| ≠ 1, complex λ: relations and spectrality to 1e-12 relative."""
    top, y, lam = TOPS[name].top, TOPS[name].state, 0.7 + 0.4j
    y_new = one_point(top, y, lam, sheet)
    old, new, k = gf.arguments(top, y, y_new)
    _, _, c1, c2 = top.invariants(y)
    expected = np.array((y[2], y[5], y_new[2], y_new[5]))
    error = gf.momenta(top, lam, c1, c2, old, new, k) - expected
    assert largest(error) < 1e-12 * largest(y_new)
    mu = eigenvalue(top, y, lam, sheet)
    assert abs(gf.gradient(top, lam, c1, c2, old, new, k)[4] + mu) < 1e-12 * largest(y_new)


def test_arrays():
    """Many points at once give what one at a time does."""
    singles = [arguments(p)[:5] for p in points(15, 5)]
    top, lam = LagrangeTop(1.5), np.array([a[0] for a in singles])
    c1, c2 = (np.array([a[i] for a in singles]) for i in (1, 2))
    old, new = (tuple(np.array([a[i][j] for a in singles]) for j in (0, 1)) for i in (3, 4))
    values = gf.generating_function(top, lam, c1, c2, old, new, np.ones(5))
    for a, value in zip(singles, values, strict=True):
        assert gf.generating_function(top, *a, 1.0) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("zero", ["alpha", "lam", "xm", "xp", "k"])
def test_singular_charts_are_refused(zero):
    top = LagrangeTop(0.0 if zero == "alpha" else 1.0)
    lam, xm, xp = (0.0 if zero == name else 1.0 for name in ("lam", "xm", "xp"))
    c1 = -1.0 if zero == "k" else 1.0
    for f in (gf.generating_function, gf.gradient, gf.momenta, gf.eigenvalue):
        with pytest.raises(ValueError, match=r"singular|branch point|no one-point map"):
            f(top, lam, c1, 0.5, (xm, 1.0), (xp, 1.0), 1.0)


# ---------------------------------------------------------------------------------------------- the Gaudin magnet


def dressed(alpha, sites, spins, lam, sheet):
    """One-point map of the magnet, s̃_j = M(a_j) s_j M(a_j)⁻¹, and v."""
    A, B, C = gaudin_entries(alpha, sites, spins, lam)
    v = sheet * sqrt(A * A + B * C)
    p, q = sum(spins[:, 0] - 1j * spins[:, 1]) / (2 * alpha), (A - v) / B
    images = []
    for a, s in zip(sites, spins, strict=True):
        M, N = dressing_matrix(p, q, lam, a), np.array(((1, -p), (-q, a - lam + p * q)))
        S = M @ pauli(s) @ N / (a - lam)
        images.append(((S[0, 1] + S[1, 0]) / 2, 1j * (S[0, 1] - S[1, 0]) / 2, S[0, 0]))
    return np.array(images), v


@both
@sheets
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_gaudin(digits, sheet, n):
    """(5.2.8)–(5.2.10) and μ = iv = −∂F/∂λ for the map of n sites."""
    for p in points(digits, count=4):
        alpha, sites, spins, lam = p.top.alpha, p.numbers(n), p.numbers(3 * n).reshape(n, 3), p.number()
        images, v = dressed(alpha, sites, spins, lam, sheet)
        minus, plus = spins[:, 0] - 1j * spins[:, 1], images[:, 0] + 1j * images[:, 1]
        squares, z = np.sum(spins * spins, axis=1), spins[:, 2] - sum(plus) / (2 * alpha) * minus
        p.same(z * z, squares - (sites - lam) * plus * minus)
        old3, new3, mu = gf.gaudin_momenta(alpha, lam, sites, squares, minus, plus, z)
        p.same(old3, spins[:, 2])
        p.same(new3, images[:, 2])
        p.same(mu, 1j * v)


def test_gaudin_gradient():
    """gaudin_momenta are i s ∂F/∂s and −∂F/∂λ, by differences of (5.2.9): 30 digits."""
    for p in points(50, count=3):
        n, alpha = 2, p.top.alpha
        sites, squares, minus, plus, lam = p.numbers(n), p.numbers(n), p.numbers(n), p.numbers(n), p.number()
        z = sqrt(squares - (sites - lam) * plus * minus)

        def F(*v, n=n, alpha=alpha, sites=sites, squares=squares, z=z):
            return gf.gaudin_function(alpha, v[2 * n], sites, squares, np.array(v[:n]), np.array(v[n : 2 * n]), z)

        values = (*minus, *plus, lam)
        D = [mp.diff(F, values, tuple(int(i == j) for j in range(2 * n + 1))) for i in range(2 * n + 1)]
        old3, new3, mu = gf.gaudin_momenta(alpha, lam, sites, squares, minus, plus, z)
        assert largest(1j * minus * np.array(D[:n]) - old3) < mpf(10) ** -30
        assert largest(1j * plus * np.array(D[n:-1]) - new3) < mpf(10) ** -30
        assert abs(D[-1] + mu) < mpf(10) ** -30


def test_gaudin_refusals():
    one = np.ones(2)
    with pytest.raises(ValueError, match="site"):
        gf.gaudin_function(1.0, 1.0, np.array((0.0, 1.0)), one, one, one, one)
    with pytest.raises(ValueError, match="singular"):
        gf.gaudin_momenta(1.0, 0.5, np.array((0.0, 1.0)), one, 0 * one, one, one)


# ---------------------------------------------------------------------------------------------- contraction


def contraction(p, eps):
    """Errors at ε of (5.2.9) against (5.2.11), of (5.2.11) against (5.2.7), of the momenta and of μ."""
    args = lam, c1, c2, old, new, k = arguments(p)
    y, _ = gf.states(p.top, *args)
    _, Jm, Jp, *_ = ladder(y)
    sites, *spins, near = gf.contraction_arguments(c1, c2, y[2] * y[2] + Jp * Jm, old, new, k, eps)
    magnet = gf.gaudin_function(p.top.alpha, lam, sites, *spins, near)
    contracted = gf.contracted(p.top.alpha, lam, *spins, near, eps)
    constant = mp.pi * c2 / sqrt(c1)
    last = contracted - gf.generating_function(p.top, *args)
    old3, new3, mu = gf.gaudin_momenta(p.top.alpha, lam, sites, *spins, near)
    J3, x3, _, x3_new = gf.momenta(p.top, *args)
    momenta = np.array((sum(old3) - J3, eps * old3[1] - x3, sum(new3) - J3, eps * new3[1] - x3_new))
    mu_error = abs(mu - gf.eigenvalue(p.top, *args))
    return abs(magnet - contracted), min(abs(last - constant), abs(last + constant)), largest(momenta), mu_error


def test_contraction_is_of_first_order():
    """(5.2.11)–(5.2.14): F, its derivatives and μ of the magnet become those of the top, F up to ±πℓ/r, as O(ε).

    Every error falls by 2 when ε does, to 1%: O(ε), not O(ε²), the first one included.
    """
    for seed in range(5):
        errors = []
        for eps in (mpf(10) ** -8, mpf(10) ** -8 / 2):
            p = next(itertools.islice(points(50, seed + 1), seed, None))
            with mp.workdps(50):
                errors.append(contraction(p, eps))
        for first, second in zip(*errors, strict=True):
            assert 0 < first < 1e-5
            assert 1.99 < first / second < 2.01


def test_contraction_squares():
    """(5.2.12)–(5.2.14): ζ_1² and ζ_2² in the variables of the top, z_2² = ζ_2² − ε s̃_2⁺ s_2⁻."""
    for p in points(50):
        lam, c1, c2, (xm, Jm), (xp, Jp), k = arguments(p)
        eps, J2 = mpf(1) / 8, p.number()
        sites, squares, minus, plus, near = gf.contraction_arguments(c1, c2, J2, (xm, Jm), (xp, Jp), k, eps)
        zeta = squares + lam * plus * minus
        expanded = Jm * Jp - (Jp * xm + Jm * xp) / eps + xm * xp / eps**2
        p.same(zeta, (squares[0] + lam * expanded, (c1 + lam * xm * xp) / eps**2))
        z = gf.roots_z(lam, sites, squares, minus, plus, near)
        p.same(z[1] ** 2, zeta[1] - eps * plus[1] * minus[1])


def test_contracted_states():
    """The morphism (2.20) applied to what contraction_arguments takes apart."""
    for p in points(15, 3):
        _, c1, c2, old, new, k = arguments(p)
        _, squares, minus, plus, _ = gf.contraction_arguments(c1, c2, 1.0, old, new, k, 0.125)
        p.same((0.125 * minus[1], sum(minus), 0.125 * plus[1], sum(plus)), (*old, *new))
        p.same(squares[1] * 0.125**2, c1)


@pytest.mark.parametrize("erratum", [e for e in gf.ERRATA if e.section != "5.4"], ids=lambda e: e.equation)
def test_errata(erratum):
    for seed in range(10):
        assert erratum.printed(random.Random(seed)) > 1e-2
        assert erratum.corrected(random.Random(seed)) < 1e-12


def test_cartesian_of_states():
    """`states` puts the given four numbers where they belong."""
    for p in points(15, 3):
        args = arguments(p)
        y, y_new = gf.states(p.top, *args)
        _, Jm, _, _, xm, _ = ladder(y)
        _, _, Jp, _, _, xp = ladder(y_new)
        p.same((xm, Jm, xp, Jp), (*args[3], *args[4]))
        p.same(cartesian(*ladder(y)), y)
