"""The Gaudin magnet: brackets, integrals, spectral curve, one- and two-point maps; in double and in 50 digits."""

from itertools import chain

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators.compiling.double_double import dd
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue, spectral_polynomial, times
from lagrange_bench.integrators.paper.gaudin_maps import one_point, one_point_inverse, two_point, two_point_textbook
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from lagrange_bench.integrators.paper.phase_space import poisson_tensor
from lagrange_bench.integrators.torus import time_step
from tests.test_integrators.paper.tools import DIGITS, jacobian, largest, points

both = pytest.mark.parametrize("digits", DIGITS)
SIZES = (1, 2, 3, 4)


def cases(digits, real=False, sizes=SIZES):
    """(point, magnet, spins) of every size; the sites are real and apart, the spins complex or real."""
    for n, p in zip(sizes, points(digits, count=len(sizes)), strict=True):
        sites = tuple(2 * j + p.number().real for j in range(n))
        spins = p.numbers(3 * n).reshape(n, 3)
        if real:
            spins = np.array([[v.real for v in s] for s in spins])
        yield p, GaudinMagnet(sites, p.top.alpha), spins


def conjugates(digits):
    """A magnet with a real site and a conjugate pair."""
    for p in points(digits, count=3):
        a, s, t = p.number() + 2, p.numbers(3), p.numbers(3)
        real = np.array([v.real for v in s])
        yield p, GaudinMagnet((p.number().real, a, a.conjugate()), p.top.alpha), np.array((real, t, np.conjugate(t)))


def upper(p):
    z = p.number()
    return z if z.imag > 0 else z.conjugate()


def flat(f, magnet):
    """f of spins (n, 3) as a function of 3n numbers."""
    return lambda z: np.asarray(f(z.reshape(len(magnet), 3))).ravel()


def defect(f, magnet, spins):
    """Largest entry of D P Dᵀ − P̃."""
    image = f(spins)
    D = jacobian(flat(f, magnet), spins.ravel())
    return D @ magnet.poisson(spins) @ D.T, magnet.poisson(image)


# ---------------------------------------------------------------------------------------------- the magnet


@both
def test_brackets_and_commuting_integrals(digits):
    """(2.3) the brackets, (2.4) s_j² central, (2.13), (2.14) {H_j, H_k} = 0, Σ H_j = 2 alpha S³; the flow is {s, H}."""
    for p, magnet, spins in cases(digits):
        n, P = len(magnet), magnet.poisson(spins)
        for j in range(n):
            s3, minus, plus = (np.zeros(3 * n, dtype=complex) for _ in range(3))
            s3[3 * j + 2], minus[3 * j : 3 * j + 2], plus[3 * j : 3 * j + 2] = 1, (1, -1j), (1, 1j)
            s = spins[j]
            p.same(s3 @ P @ plus, -1j * (s[0] + 1j * s[1]))
            p.same(s3 @ P @ minus, 1j * (s[0] - 1j * s[1]))
            p.same(plus @ P @ minus, -2j * s[2])
        H = jacobian(flat(magnet.hamiltonians, magnet), spins.ravel())
        C = jacobian(flat(magnet.casimirs, magnet), spins.ravel())
        p.same(P @ C.T, np.zeros((3 * n, n)))
        p.same(H @ P @ H.T, np.zeros((n, n)), 10)
        p.same(np.sum(magnet.hamiltonians(spins)), 2 * magnet.alpha * np.sum(spins[:, 2]))
        c = p.numbers(n)
        p.same(magnet.gradient(spins, c).ravel(), c @ H)
        p.same(magnet.rhs(spins, c).ravel(), P @ (c @ H), 10)


@both
def test_lax_vector_and_curve(digits):
    """(2.1), (2.2) L_G = σ·ℓ; (2.11), (2.12) v² = alpha² + Σ (H_j/(u − a_j) + s_j²/(u − a_j)²), and Q = Π(u − a_j)² v²."""
    for p, magnet, spins in cases(digits):
        u, a = p.number(), np.array(magnet.sites)
        ell = magnet.vector(spins, u)
        p.same(lax.pauli(ell), lax.gaudin_matrix(magnet.alpha, magnet.sites, spins, u))
        square = np.sum(ell * ell)
        H, C = magnet.hamiltonians(spins), magnet.casimirs(spins)
        p.same(square, magnet.alpha**2 + np.sum(H / (u - a) + C / (u - a) ** 2), 100)
        Q = 0
        for coefficient in spectral_polynomial(magnet, spins)[::-1]:
            Q = Q * u + coefficient
        p.same(Q, np.prod((u - a) ** 2) * square, 100)
        p.same(eigenvalue(magnet, spins, u) ** 2, square, 10)
        p.same(eigenvalue(magnet, spins, u, sheet=-1), -eigenvalue(magnet, spins, u))


def test_sheets():
    """(u − a_k) v → |s_k| at its site, v → |ℓ| at Re λ; continuous in between, also around a branch point."""
    for _, magnet, spins in cases(15, real=True):
        for site, a in enumerate(magnet.sites):
            lam = a + 1e-9j
            assert abs((lam - a) * eigenvalue(magnet, spins, lam, site=site) - np.linalg.norm(spins[site])) < 1e-8
        lam = 0.3 + 1e-9j
        size = np.linalg.norm(magnet.vector(spins, 0.3))
        assert abs(eigenvalue(magnet, spins, lam, site=None) - size) < 1e-8 * (1 + size)
        path = [magnet.sites[0] + t * (1 + 2j) for t in np.linspace(0.05, 1, 200)]
        v = np.array([eigenvalue(magnet, spins, u) for u in path])
        assert np.max(np.abs(np.diff(v)) / np.abs(v[1:])) < 0.5


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("height", [1e-1, 1e-2, 1e-3, 1e-4])
def test_sheets_beside_a_small_spin(size, height):
    """The path passes a pole and two branch points that lie close together; v and the times by very many short strides."""
    magnet = GaudinMagnet((0.0, 1.0), 0.7, site=0)
    spins = np.array(((0.6, 0.0, 0.8), (0.0, 0.6 * size, 0.8 * size)))
    lam = 1.93 + 1j * height
    edges = np.concatenate(
        ([0.0], np.sort(1 / 1.93 + np.outer((-1, 1), np.geomspace(1e-7, 0.48, 4000)).ravel()), [1.0])
    )
    x, weights = np.polynomial.legendre.leggauss(6)
    t = (edges[:-1, None] + np.diff(edges)[:, None] * (x + 1) / 2).ravel()
    f = (np.diff(edges)[:, None] * weights / 2).ravel()
    ell = np.array([magnet.vector(spins, u) for u in t * lam])
    w = t * lam * np.sqrt(np.sum(ell * ell, axis=1))
    sign = np.cumprod([np.sign(w[0].real), *np.where((w[1:] * w[:-1].conj()).real < 0, -1.0, 1.0)])
    v = w * sign / (t * lam)
    c = [np.sum(f * lam / (v * (t * lam - a))).imag for a in magnet.sites]
    assert (eigenvalue(magnet, spins, lam) * v[-1].conjugate()).real > 0
    assert np.allclose(times(magnet, spins, lam), c, rtol=1e-7, atol=1e-9)


# ---------------------------------------------------------------------------------------------- the one-point map


@both
def test_one_point_map(digits):
    """(5.1.3)–(5.1.8): L̃ M = M L with det M = u − λ, all s_j², H_j kept, q = S̃+/2 alpha, the inverse."""
    for p, magnet, spins in cases(digits):
        lam, u, sheet = p.number(), p.number() + 7, p.rng.choice((1, -1))
        v = eigenvalue(magnet, spins, lam, sheet)
        image = one_point(magnet, spins, lam, sheet)
        p.same(image, one_point(magnet, spins, lam, v=v), 100)
        p.same(magnet.casimirs(image), magnet.casimirs(spins), 100 * largest(image))
        p.same(magnet.hamiltonians(image), magnet.hamiltonians(spins), 100 * largest(image))
        minus, plus = np.sum(spins[:, 0] - 1j * spins[:, 1]), np.sum(image[:, 0] + 1j * image[:, 1])
        a, q = minus / (2 * magnet.alpha), plus / (2 * magnet.alpha)
        M = np.array(((u - lam + a * q, a), (q, 1 + 0 * q)))
        L, L_new = (lax.gaudin_matrix(magnet.alpha, magnet.sites, s, u) for s in (spins, image))
        p.same(M @ L, L_new @ M, 100)
        p.same(one_point_inverse(magnet, image, lam, v=v), spins, 1000 * largest(image))


@both
def test_one_point_map_is_poisson_only_with_v_of_the_state(digits):
    for p, magnet, spins in cases(digits, sizes=(1, 2, 3)):
        lam = p.number()
        pushed, target = defect(lambda s, m=magnet, u=lam: one_point(m, s, u), magnet, spins)
        p.same(pushed, target, 1000 * largest(pushed))
        v = eigenvalue(magnet, spins, lam)
        pushed, target = defect(lambda s, m=magnet, u=lam, v=v: one_point(m, s, u, v=v), magnet, spins)
        assert largest(pushed - target) > 1e-4


# ---------------------------------------------------------------------------------------------- the two-point map


@both
def test_two_forms_of_the_two_point_map(digits):
    """(5.5.2)–(5.5.6) with n sites = the real form; B_(λ̄,v̄)⁻¹ ∘ B_(λ,v); sheet −1 is the inverse; all integrals kept."""
    for p, magnet, spins in chain(cases(digits, real=True), conjugates(digits)):
        lam, sheet, site = upper(p), p.rng.choice((1, -1)), p.rng.choice((0, None))
        bar, v = lam.conjugate(), eigenvalue(magnet, spins, lam, sheet, site)
        image = two_point(magnet, spins, lam, sheet, site)
        tolerance = 1000 * largest(image)
        p.same(image, two_point(magnet, spins, lam, v=v), 100)
        p.same(image, two_point_textbook(magnet, spins, lam, -v, bar, -v.conjugate()), tolerance)
        p.same(image, two_point_textbook(magnet, spins, bar, v.conjugate(), lam, v), tolerance)
        back = one_point_inverse(magnet, one_point(magnet, spins, lam, v=-v), bar, v=-v.conjugate())
        p.same(image, back, 100 * tolerance)
        p.same(magnet.hamiltonians(image), magnet.hamiltonians(spins), tolerance)
        p.same(magnet.casimirs(image), magnet.casimirs(spins), tolerance)
        p.same(two_point(magnet, image, lam, -sheet, site), spins, tolerance)
        p.same(two_point_textbook(magnet, image, bar, -v.conjugate(), lam, -v), spins, tolerance)
        p.same(np.conjugate(image[magnet.partners]), image)


@both
def test_two_point_maps_compose_and_commute(digits):
    """B(P2, Q3) ∘ B(P1, Q2) = B(P1, Q3), section 5.5; any two commute. Complex spins."""
    for p, magnet, spins in cases(digits):
        lams = p.numbers(4)
        v = [eigenvalue(magnet, spins, lam) for lam in lams]

        def step(s, i, j, m=magnet, lams=lams, v=v):
            return two_point_textbook(m, s, lams[i], v[i], lams[j], v[j])

        two = step(step(spins, 0, 1), 1, 2)
        size = max(largest(two), largest(step(spins, 0, 1)))
        p.same(two, step(spins, 0, 2), 1000 * size**2)
        one_way, other = step(step(spins, 0, 1), 2, 3), step(step(spins, 2, 3), 0, 1)
        p.same(one_way, other, 1000 * max(largest(step(spins, 0, 1)), largest(step(spins, 2, 3)), largest(other)) ** 2)


@both
def test_two_point_map_is_poisson_only_with_v_of_the_state(digits):
    for p, magnet, spins in cases(digits, real=True, sizes=(1, 2, 3)):
        lam = upper(p)
        pushed, target = defect(lambda s, m=magnet, u=lam: two_point(m, s, u), magnet, spins)
        p.same(pushed, target, 100)
        v = eigenvalue(magnet, spins, lam)
        frozen = lambda s, m=magnet, u=lam, v=v: two_point_textbook(m, s, u, -v, u.conjugate(), -v.conjugate())  # noqa: E731
        pushed, target = defect(frozen, magnet, spins)
        assert largest(pushed - target) > 1e-4


def test_zero_field_keeps_the_total_spin():
    """At alpha = 0 the two-point map exists, the one-point map does not."""
    for p, magnet, spins in cases(15, real=True):
        free = GaudinMagnet(magnet.sites, 0.0)
        image = two_point(free, spins, upper(p))
        p.same(np.sum(image, axis=0), np.sum(spins, axis=0))
        p.same(free.hamiltonians(image), free.hamiltonians(spins), 10)


def test_two_sites_double_as_the_top_does():
    """Two steps with (λ, m) are one with the (λ', m') of `time_step.double_time`, Q = Π(u − a_j)² v², m = Π(u − a_j) v."""
    for p, magnet, spins in cases(15, real=True, sizes=(2,) * 6):
        q = tuple(dd(float(c)) for c in spectral_polynomial(magnet, spins))
        a, b = magnet.sites
        lam = a + 0.1 * upper(p)
        m = (lam - a) * (lam - b) * eigenvalue(magnet, spins, lam)
        (re, im), (m_re, m_im) = time_step.double_time(
            q, (dd(lam.real), dd(lam.imag)), (dd(float(m.real)), dd(float(m.imag)))
        )
        if not im[0] > 0:
            continue
        lam2, m2 = complex(re[0], im[0]), complex(m_re[0], m_im[0])
        once = two_point(magnet, spins, lam2, v=m2 / ((lam2 - a) * (lam2 - b)))
        p.same(once, two_point(magnet, two_point(magnet, spins, lam), lam), 1000)


# ---------------------------------------------------------------------------------------------- bad input

MAGNET = GaudinMagnet((0.0, 1.0), 1.0)
SPINS = np.array(((0.0, 0.6, 0.8), (1.0, 0.0, 0.5)))
PAIR = GaudinMagnet((0.5 + 1j, 0.5 - 1j), 1.0)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: GaudinMagnet((1.0, 2.0, 1.0)), "sites"),
        (lambda: GaudinMagnet(()), "sites"),
        (lambda: GaudinMagnet((1.0, np.nan)), "sites"),
        (lambda: GaudinMagnet(("a", 1.0)), "sites"),
        (lambda: GaudinMagnet(((1.0, 2.0), (3.0, 4.0))), "sites"),
        (lambda: GaudinMagnet((1.0,), np.inf), "alpha"),
        (lambda: GaudinMagnet((1.0,), 1j), "alpha"),
        (lambda: GaudinMagnet((1.0,), mpc(1, 1)), "alpha"),
        (lambda: MAGNET.check_spins(np.zeros(6)), "spins"),
        (lambda: two_point(MAGNET, SPINS[:1], 1j + 1), "spins"),
        (lambda: two_point(MAGNET, SPINS * np.nan, 1j + 1), "spins"),
        (lambda: two_point(MAGNET, SPINS * (1 + 1j), 1j + 1), "spins"),
        (lambda: two_point(MAGNET, SPINS * np.array(((0,), (1,))), 1j + 1), "spins"),
        (lambda: two_point(GaudinMagnet((0.0, 1j)), SPINS, 1j + 1), "sites"),
        (lambda: two_point(PAIR, SPINS, 1j + 1, site=None), "spins"),
        (lambda: two_point(MAGNET, SPINS, 1.5), "lam"),
        (lambda: two_point(MAGNET, SPINS, 1.5 - 1j), "lam"),
        (lambda: two_point(MAGNET, SPINS, np.nan), "lam"),
        (lambda: two_point(MAGNET, SPINS, [1j, 2j]), "lam"),
        (lambda: two_point(MAGNET, SPINS, 1 + 1j, site=None), "site"),
        (lambda: two_point(PAIR, (SPINS + 1j, SPINS - 1j)[0], 0.5 + 1j), "lam"),
        (lambda: two_point(MAGNET, SPINS, 1j, site=2), "site"),
        (lambda: two_point(MAGNET, SPINS, 1j, sheet=0), "sheet"),
        (lambda: one_point(MAGNET, SPINS, 1.0), "lam"),
        (lambda: one_point(GaudinMagnet((0.0, 1.0), 0.0), SPINS, 2j), "alpha"),
        (lambda: two_point_textbook(MAGNET, SPINS, 1.0, 1.0, 2j, 1.0), "lam1"),
        (lambda: two_point_textbook(MAGNET, SPINS, 1j, 1.0, 0.0, 1.0), "lam2"),
        (lambda: MAGNET.vector(SPINS, 1.0), "lam"),
    ],
)
def test_bad_input(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_numbers_of_every_kind():
    """Integers, floats and mpmath numbers; a magnet can be pickled and is a key."""
    assert GaudinMagnet([0, 1], 1) == GaudinMagnet((0, 1), 1)
    assert hash(MAGNET) == hash(GaudinMagnet((0.0, 1.0), 1.0))
    with mp.workdps(30):
        fine = GaudinMagnet((mpf(0), mpf(1)), mpf(1))
        image = two_point(fine, [[mpf(v) for v in s] for s in SPINS], mpc(0.5, 0.5))
        assert largest(image - two_point(MAGNET, SPINS, 0.5 + 0.5j)) < 1e-14
    assert np.array_equal(MAGNET.poisson(SPINS), poisson_tensor(*SPINS))
