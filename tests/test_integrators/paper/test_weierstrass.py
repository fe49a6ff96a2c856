"""Weierstrass' functions by their definitions, on lattices of both shapes."""

import itertools

import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators.paper.weierstrass import Weierstrass

DIGITS = 40
ROOTS = {"square": ("1", "0"), "wide": ("1", "0.999"), "tall": ("2", "-0.9")}  # e1, e2
POINTS = (mpc("0.3", "0.2"), mpc("13.5", "-9.25"))


@pytest.fixture(params=ROOTS)
def wp(request):
    with mp.workdps(DIGITS):
        e1, e2 = map(mpf, ROOTS[request.param])
        e3 = -e1 - e2
        yield Weierstrass(-4 * (e1 * e2 + e1 * e3 + e2 * e3), 4 * e1 * e2 * e3)


def close(a, b, digits=DIGITS - 5):
    assert abs(a - b) < mpf(10) ** -digits * max(1, abs(a), abs(b)), (a, b)


def test_differential_equations_and_addition(wp):
    """℘'² = 4℘³ − g2 ℘ − g3, ℘ = −ζ', ζ = σ'/σ, (℘)' = ℘'; ℘(u) − ℘(v) = −σ(u + v) σ(u − v)/(σ(u)² σ(v)²)."""
    for z in POINTS:
        close(wp.p_prime(z) ** 2, 4 * wp.p(z) ** 3 - wp.g2 * wp.p(z) - wp.g3)
        close(mp.diff(wp.zeta, z), -wp.p(z), 30)
        close(mp.diff(wp.p, z), wp.p_prime(z), 30)
        value, slope = wp.sigma_and_derivative(z)
        close(slope / value, wp.zeta(z))
    u, v = POINTS[0], mpc("-0.7", "1.1")
    close(wp.p(u) - wp.p(v), -wp.sigma(u + v) * wp.sigma(u - v) / (wp.sigma(u) * wp.sigma(v)) ** 2)


def test_origin_and_half_periods(wp):
    """σ(z) = z + O(z⁵), poles at 0; ℘ is e1, e2, e3 at ω1, ω1 + ω3, ω3; Legendre's relation; (quasi-)periods."""
    z = mpc("1e-12", "2e-12")
    close(wp.sigma(z) / z, 1, 28)  # relative digits are lost next to a zero
    assert wp.sigma(mpc(0)) == 0
    for f in (wp.p, wp.zeta, wp.p_prime):
        with pytest.raises(ValueError, match="pole"):
            f(mpc(0))
    for w, e in zip((wp.omega1, wp.omega1 + wp.omega3, wp.omega3), wp.roots, strict=True):
        close(wp.p(w), e)
    close(wp.zeta(wp.omega1), wp.eta1)
    close(wp.eta1 * wp.omega3 - wp.zeta(wp.omega3) * wp.omega1, mpc(0, mp.pi / 2))
    z, w = POINTS[0], 2 * wp.omega1 - 4 * wp.omega3
    close(wp.p(z + w), wp.p(z))
    close(wp.zeta(z + w), wp.zeta(z) + 2 * wp.eta1 - 4 * wp.zeta(wp.omega3))


def test_inverse(wp):
    e1, e2, e3 = wp.roots
    for sign, share in itertools.product((1, -1), (mpf(1) / 8, mpf(3) / 4)):
        p = e3 + share * (e2 - e3)
        z = wp.omega3 + wp.inverse_oval(p, sign)
        close(wp.p(z), p)
        assert wp.p_prime(z).real * sign > 0
        for p in (e2 + share * (e1 - e2), e3 - share, e3 - 1000 * share):
            z = wp.inverse_imaginary(p, sign)
            close(wp.p(z), p)
            assert wp.p_prime(z).imag * sign > 0
    close(wp.inverse_oval(e2, 0), wp.omega1, DIGITS // 2 - 5)  # the root costs half of the digits
    assert wp.inverse_oval(e3, 0) == 0


def test_third_kind(wp):
    """Continuous over periods, with the derivative ℘'(a)/(℘(z) − ℘(a))."""
    e1, e2, e3 = wp.roots
    for p in ((e1 + 3 * e2) / 4, e3 - mpf(1) / 16):
        a = wp.inverse_imaginary(p, 1)
        for u in (mpf("-0.8"), wp.omega1 * mpf("6.99")):
            slope = wp.p_prime(a) / (wp.p(wp.omega3 + u) - p)
            close(mp.diff(lambda v, a=a: wp.third_kind(a, v), u), slope, 25)
        per_period = 2 * (2 * wp.zeta(a) - 2 * wp.eta1 * a / wp.omega1) * wp.omega1
        samples = [wp.third_kind(a, wp.omega1 * k / 8) for k in range(49)]
        assert max(abs(v - u) for u, v in itertools.pairwise(samples)) < 3.2  # a slip would be 2π
        close(samples[48] - samples[0], 3 * per_period, 30)


def test_a_double_root_is_refused():
    with pytest.raises(ValueError, match="distinct"):
        Weierstrass(mpf(12), mpf(8))
