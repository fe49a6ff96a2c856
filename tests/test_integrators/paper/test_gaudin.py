"""The Gaudin magnet: brackets, integrals, spectral curve, one- and two-point maps, in double and in 50 digits; its exact step."""

from dataclasses import replace
from functools import partial, reduce

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue, pade_roots, spectral_polynomial
from lagrange_bench.integrators.paper.gaudin_maps import one_point, two_point
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from lagrange_bench.integrators.paper.one_point import dressing_matrix
from lagrange_bench.integrators.paper.phase_space import gradient
from tests.test_integrators.paper.tools import largest

SIZES = pytest.mark.parametrize("n", [1, 5])


def magnet_of(p, n, real=False):
    """A magnet with n sites that are apart, and complex or real spins."""
    spins = p.numbers(3 * n).reshape(n, 3)
    if real:
        spins = np.array([[v.real for v in s] for s in spins])
    return GaudinMagnet(tuple(2 * j + p.number().real for j in range(n)), p.top.alpha), spins


def upper(z):
    return z if z.imag > 0 else z.conjugate()


def defect(f, magnet, spins):
    """D P Dᵀ − P̃, and the size of its terms."""
    D = gradient(lambda z: np.asarray(f(magnet, z.reshape(len(magnet), 3))).ravel(), spins.ravel())
    pushed = D @ magnet.poisson(spins) @ D.T
    return pushed - magnet.poisson(f(magnet, spins)), largest(pushed)


@SIZES
def test_brackets_and_commuting_integrals(p, n):
    """(2.3) the brackets, (2.4) s_j² central, (2.13), (2.14) {H_j, H_k} = 0, Σ H_j = 2 alpha S³; the flow is {s, H}."""
    magnet, spins = magnet_of(p, n)
    P = magnet.poisson(spins)
    for j, (s1, s2, s3) in enumerate(spins):
        three, minus, plus = (np.zeros(3 * n, dtype=complex) for _ in range(3))
        three[3 * j + 2], minus[3 * j : 3 * j + 2], plus[3 * j : 3 * j + 2] = 1, (1, -1j), (1, 1j)
        p.same((three @ P @ plus, three @ P @ minus, plus @ P @ minus), (s2 - 1j * s1, s2 + 1j * s1, -2j * s3))
        assert not np.any(np.delete(P[3 * j : 3 * j + 3], [3 * j, 3 * j + 1, 3 * j + 2], axis=1))
    H, C = (gradient(lambda z, f=f: f(z.reshape(n, 3)), spins.ravel()) for f in (magnet.hamiltonians, magnet.casimirs))
    p.same(P @ C.T, np.zeros((3 * n, n)))
    p.same(H @ P @ H.T, np.zeros((n, n)), 10)
    p.same(np.sum(magnet.hamiltonians(spins)), 2 * magnet.alpha * np.sum(spins[:, 2]))
    c = p.numbers(n)
    p.same(magnet.gradient(spins, c).ravel(), c @ H)
    p.same(magnet.rhs(spins, c).ravel(), P @ (c @ H), 10)


@SIZES
def test_lax_vector_and_curve(p, n):
    """(2.1), (2.2) L_G = σ·ℓ; (2.11), (2.12) v² = alpha² + Σ (H_j/(u − a_j) + s_j²/(u − a_j)²), and Q = Π(u − a_j)² v²."""
    magnet, spins = magnet_of(p, n)
    u, a = p.number(), np.array(magnet.sites)
    ell = magnet.vector(spins, u)
    p.same(lax.pauli(ell), lax.gaudin_matrix(magnet.alpha, magnet.sites, spins, u))
    square = np.sum(ell * ell)
    H, C = magnet.hamiltonians(spins), magnet.casimirs(spins)
    p.same(square, magnet.alpha**2 + np.sum(H / (u - a) + C / (u - a) ** 2), 100)
    Q = sum(c * u**k for k, c in enumerate(spectral_polynomial(magnet, spins)))
    p.same(Q, np.prod((u - a) ** 2) * square, 100)
    p.same(eigenvalue(magnet, spins, u) ** 2, square, 10)
    p.same(eigenvalue(magnet, spins, u, sheet=-1), -eigenvalue(magnet, spins, u))


def one_point_inverse(magnet, spins, lam, v):
    """The spins that `one_point` sends to `spins`: its mirror image τ B τ, τ: s² → −s², which transposes L."""
    mirror = np.array((1, -1, 1))
    return one_point(magnet, spins * mirror, lam, v=v) * mirror


@SIZES
def test_one_point_map(p, n):
    """(5.1.3)–(5.1.8): L̃ M = M L, all s_j², H_j kept, the inverse; (5.2.8)–(5.2.10) its generating function."""
    magnet, spins = magnet_of(p, n)
    lam, u, alpha, a = p.number(), p.number() + 7, magnet.alpha, np.array(magnet.sites)
    v = eigenvalue(magnet, spins, lam, p.sheet)
    image = one_point(magnet, spins, lam, p.sheet)
    p.same(image, one_point(magnet, spins, lam, v=v), 100)
    p.same(magnet.invariants(image), magnet.invariants(spins), 100 * largest(image))
    minus, plus = spins[:, 0] - 1j * spins[:, 1], image[:, 0] + 1j * image[:, 1]
    P, q = np.sum(minus) / (2 * alpha), np.sum(plus) / (2 * alpha)
    M = dressing_matrix(P, q, lam, u)
    L, L_new = (lax.gaudin_matrix(alpha, magnet.sites, s, u) for s in (spins, image))
    p.same(M @ L, L_new @ M, 100)
    p.same(one_point_inverse(magnet, image, lam, v=v), spins, 1000 * largest(image))
    squares, z = magnet.casimirs(spins), spins[:, 2] - q * minus
    p.same(z * z, squares - (a - lam) * plus * minus)
    old3, new3, mu = gf.gaudin_momenta(alpha, lam, a, squares, minus, plus, z)
    p.same((*old3, *new3, mu), (*spins[:, 2], *image[:, 2], 1j * v))


@SIZES
def test_two_point_map(p, n):
    """The real form with n sites is B_(λ̄,v̄)⁻¹ ∘ B_(λ,v); sheet −1 is the inverse; all integrals are kept."""
    magnet, spins = magnet_of(p, n, real=True)
    lam, sheet, site = upper(p.lam), p.sheet, p.rng.randrange(n)
    bar, v = lam.conjugate(), eigenvalue(magnet, spins, lam, sheet, site)
    image = two_point(magnet, spins, lam, sheet, site)
    tolerance = 1000 * largest(image)
    p.same(image, two_point(magnet, spins, lam, v=v), 100)
    back = one_point_inverse(magnet, one_point(magnet, spins, lam, v=-v), bar, v=-v.conjugate())
    p.same(image, back, 100 * tolerance)
    p.same(magnet.invariants(image), magnet.invariants(spins), tolerance)
    p.same(two_point(magnet, image, lam, -sheet, site), spins, tolerance)
    p.same(np.conjugate(image), image)


@SIZES
def test_maps_are_poisson_only_with_v_of_the_state(p, n):
    """D P Dᵀ = P̃ with v of the state, D exact to round-off; with v frozen not."""
    magnet, spins = magnet_of(p, n if p.digits == 15 else min(n, 4), real=True)
    lam = upper(p.lam)
    v = eigenvalue(magnet, spins, lam)
    for f, terms in ((partial(one_point, lam=lam), 1000), (partial(two_point, lam=lam), 100)):
        error, size = defect(f, magnet, spins)
        p.same(error, 0 * error, terms * size)
        assert largest(defect(partial(f, v=v), magnet, spins)[0]) > 1e-4


def magnet(n):
    """A central spin at 0 and others at sites of one sign; multiples of 1/1024."""
    rng = np.random.default_rng(0)
    spins = rng.normal(size=(n, 3))
    return GaudinMagnet((0.0, *-np.cumsum(np.rint(1024 * rng.uniform(0.3, 1, n - 1)) / 1024)), 0.7), spins


def flow(m, spins, c, t=1.0):
    """The flow of Σ c_j H_j by SciPy's DOP853, good to 1e-12 here."""
    found = solve_ivp(
        lambda _, y: m.rhs(y.reshape(spins.shape), c).ravel(), (0, t), spins.ravel(), "DOP853", rtol=1e-13, atol=1e-13
    )
    assert found.success
    return found.y[:, -1].reshape(spins.shape)


@pytest.mark.parametrize("factors", [1, 3])
def test_pade_steps_have_order_twice_their_number(factors):
    m, spins = magnet(6)
    truth, z, errors = flow(m, spins, np.eye(6)[0]), list(map(complex, pade_roots(factors))), []
    for steps in (4, 8, 16):
        lams = np.tile(np.linalg.norm(spins[0]) / steps * np.array(z), steps)
        errors.append(np.max(np.abs(reduce(lambda s, lam: two_point(m, s, lam), lams, spins) - truth)))
    orders = -np.diff(np.log2(errors))
    assert abs(orders[-1] - 2 * factors) < 0.35


@pytest.mark.parametrize(("n", "site", "alpha", "h"), [(1, 0, 0.7, 0.7), (2, 1, 0.7, 40.0), (4, 0, 0.0, 3.0)])
def test_the_exact_step_is_the_flow(n, site, alpha, h):
    """Also at the last of several sites, and without a field."""
    m, spins = magnet(n)
    m = replace(m, site=site, alpha=alpha)
    image = m.exact_step(spins, h)
    assert np.max(np.abs(image - flow(m, spins, np.eye(n)[site], h))) < 2e-11
    assert np.max(np.abs(m.exact_step(image, -h) - spins)) < 1e-13
    assert np.array_equal(m.exact_step(spins, 0.0), spins)


def test_only_differences_of_sites_count():
    apart, spins = GaudinMagnet((-5e7, 1e8, 1e8 + 0.5, 1e8 + 2), 0.7, site=2), magnet(4)[1]
    image = apart.exact_step(spins, 5.0)
    assert np.max(np.abs(image - flow(apart, spins, np.eye(4)[2], 5.0))) < 1e-11
