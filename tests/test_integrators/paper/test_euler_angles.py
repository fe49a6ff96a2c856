"""Section 4: Euler angles, Hamiltonian, and the Weierstrass solution against the theta functions of `exact`."""

import functools
import random

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import euler_angles
from lagrange_bench.integrators.paper.euler_angles import (
    angles,
    from_angles,
    hamiltonian,
    motion,
    rates,
    states,
    to_angles,
)
from lagrange_bench.integrators.paper.phase_space import invariants, poisson_tensor, vector_field
from lagrange_bench.integrators.paper.weierstrass import Weierstrass
from lagrange_bench.integrators.truth import exact
from tests.test_integrators.paper.tools import DIGITS, largest, points

both = pytest.mark.parametrize("digits", DIGITS)
ELLIPTIC = [name for name, top in TOPS.items() if exact.regime(top.top, top.y0) == "elliptic"]
POLES = {"planar", "planar_rotation", "through_pole"}
TIMES = (0.0, 0.37, -2.9, 11.3)


def random_top(seed):
    """A top with alpha of either sign and |x| between 0.3 and 6."""
    rng = random.Random(seed)
    y = np.array([rng.gauss(0, 1.5) for _ in range(6)])
    y[3:] *= rng.uniform(0.3, 6.0) / np.linalg.norm(y[3:])
    return LagrangeTop(rng.choice((-1, 1)) * rng.uniform(0.1, 3.0)), y


# ---------------------------------------------------------------------------------------------- the map (4.1)


@both
def test_there_and_back(digits):
    """(4.1) and its inverse on complex states of any leaf."""
    for p in points(digits):
        y = p.state()
        _, _, c1, c2 = invariants(p.top, y)
        p.same(from_angles(to_angles(y), c1, c2), y)


@both
def test_leaf(digits):
    """(1.5): from_angles lands on |x|² = c1, x·J = c2; (4.3), (4.4): H and J3."""
    for p in points(digits):
        q, c1, c2 = p.numbers(4), p.number() ** 2, p.number()
        y = from_angles(q, c1, c2)
        p.same(invariants(p.top, y), (hamiltonian(p.top.alpha, q, c1, c2), q[3], c1, c2))


def test_real_ranges():
    rng = np.random.default_rng(0)
    y = rng.normal(size=(50, 6))
    q = to_angles(y)
    assert q.dtype == float
    assert np.all((q[:, 0] > 0) & (q[:, 0] < np.pi) & (q[:, 1] >= 0) & (q[:, 1] < 2 * np.pi))
    np.testing.assert_allclose(q[:, 1], np.arctan2(y[:, 3], y[:, 4]) % (2 * np.pi), rtol=1e-14)
    np.testing.assert_allclose(q[:, 0], np.arccos(y[:, 5] / np.linalg.norm(y[:, 3:], axis=1)), rtol=1e-12)
    inv = LagrangeTop(1.0).invariants(y)
    np.testing.assert_allclose(from_angles(q, inv[:, 2], inv[:, 3]), y, rtol=1e-12, atol=1e-12)


def partial(f, values, i, k):
    """∂f_i/∂values_k."""
    return mp.diff(lambda v: f([*values[:k], v, *values[k + 1 :]])[i], values[k])


def test_canonical():
    """(4.2): {p_θ, θ} = {p_φ, φ} = 1 is the bracket of e(3) on the leaf: D Ω Dᵀ = P, to 30 digits."""
    omega = np.array(((0, 0, -1, 0), (0, 0, 0, -1), (1, 0, 0, 0), (0, 1, 0, 0)))
    for p in points(45, count=3):
        q, leaf = p.numbers(4), (p.number() ** 2, p.number())
        f = functools.partial(_on_leaf, leaf)
        D = np.array([[partial(f, list(q), i, k) for k in range(4)] for i in range(6)])
        assert largest(D @ omega @ D.T - poisson_tensor(f(q))) < mpf(10) ** -30


def test_equations_of_motion():
    """θ' = −p_θ, φ' = −∂H/∂p_φ, p_θ' = ∂H/∂θ, p_φ' = 0 are (1.1), to 30 digits."""
    for p in points(45, count=3):
        q, leaf = p.numbers(4), (p.number() ** 2, p.number())
        f, rate = functools.partial(_on_leaf, leaf), rates(p.top.alpha, q, *leaf)
        D = np.array([[partial(f, list(q), i, k) for k in range(4)] for i in range(6)])
        assert largest(D @ rate - vector_field(p.top, f(q))) < mpf(10) ** -30


def _on_leaf(leaf, q):
    return from_angles(q, *leaf)


def test_poles_are_refused():
    with pytest.raises(ValueError, match="poles"):
        to_angles((0.1, 0.2, 0.3, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="poles"):
        to_angles(np.array([mpc(1), mpc(2), mpc(3), mpc(0), mpc(0), mpc(-1)]))
    with pytest.raises(ValueError, match="poles"):
        from_angles((0.0, 0.2, 0.3, 0.1))


# ---------------------------------------------------------------------------------------------- the solution


@pytest.mark.parametrize("case", [*ELLIPTIC, *range(8)])
def test_sigma_form_is_the_exact_solution(case):
    """J+, x+, x3 by ℘, ζ, σ: 30 digits, and 1e-14 in double, both signs of alpha, any |x|, also through poles."""
    top, y = random_top(case) if isinstance(case, int) else (TOPS[case].top, TOPS[case].state)
    scale = max(top.scales(y)[:2])
    truth = exact.solution(top, y, TIMES, digits=35)
    with mp.workdps(40):
        assert largest(states(top, y, TIMES, digits=32) - truth) < mpf(10) ** -30 * scale
    assert np.max(np.abs(states(top, y, TIMES) - truth.astype(float))) < 1e-14 * scale


@pytest.mark.parametrize("case", [*(name for name in ELLIPTIC if name not in POLES), *range(8)])
def test_angles_are_those_of_the_exact_solution(case):
    """Corrected (4.5): θ(t), φ(t) mod 2π, p_θ(t), p_φ, to 30 digits and to 1e-12 in double."""
    top, y = random_top(case) if isinstance(case, int) else (TOPS[case].top, TOPS[case].state)
    with mp.workdps(40):
        truth = np.array([to_angles(row) for row in exact.solution(top, y, TIMES, digits=38)])
        error = angles(top, y, TIMES, digits=32) - truth
        turns = [e / (2 * mp.pi) for e in error[:, 1]]
        error[:, 1] = [2 * mp.pi * (t - mp.nint(t)) for t in turns]
        assert largest(error) < mpf(10) ** -30 * max(1, top.scales(y)[0])
    error = angles(top, y, TIMES) - truth.astype(float)
    error[:, 1] = (error[:, 1] + np.pi) % (2 * np.pi) - np.pi
    assert np.max(np.abs(error)) < 1e-12 * max(1, top.scales(y)[0])


@pytest.mark.parametrize("case", ["figure2", "inverted", *range(6)])
def test_phi_is_continuous(case):
    """φ(t + T) − φ(t) is minus the precession per nutation, which counts the turns."""
    top, y = random_top(case) if isinstance(case, int) else (TOPS[case].top, TOPS[case].state)
    period, swept = exact.nutation_period(top, y), exact.precession_per_nutation(top, y)
    phi = angles(top, y, [0.25, 0.25 + period, 0.25 + 7 * period])[:, 1]
    np.testing.assert_allclose((phi[1:] - phi[0]) / -swept, (1, 7), rtol=1e-12)
    assert angles(top, y, 0.0)[1] == pytest.approx(to_angles(y)[1], abs=1e-13)


def test_rates_along_the_solution():
    """(θ, φ, p_θ) by ℘, ζ, σ satisfy the equations of motion, φ too: its derivative, to 20 digits."""
    top, y = random_top(3)
    with mp.workdps(60):
        _, _, c1, c2 = invariants(top, [mpf(v) for v in y])
        h, t = mpf(10) ** -20, mpf(0.7)
        before, now, after = angles(top, y, [t - h, t, t + h], digits=55)
        assert largest((after - before) / (2 * h) - rates(mpf(top.alpha), now, c1, c2)) < mpf(10) ** -25


def test_paper_scaling():
    """x3 = H/3α + ℘(√(α/2)(t − t0) + ω3; G2, G3); the half-period ω1 + ω3 counts from the highest point."""
    top, y = TOPS["figure1"].top, TOPS["figure1"].state
    with mp.workdps(60):
        o = motion(top, y, 25)
        a, l = mpf(top.alpha), mp.fdot(map(mpf, y[:3]), map(mpf, y[3:]))
        G2 = 4 * (o.H**2 / (3 * a**2) + o.c1 - l * o.m / a)
        G3 = o.H**3 / 27 - a * l * o.m * o.H / 6 - a**2 * o.c1 * o.H / 3 + a**2 * (l**2 + o.c1 * o.m**2) / 4
        G3 *= 8 / a**3
        wp, root, t = Weierstrass(G2, G3), mp.sqrt(a / 2), mpf(0.41)
        truth = exact.solution(top, y, t, digits=40)[5]
        highest = t + o.u0 - wp.omega1 / root
        for z in (root * (t + o.u0) + wp.omega3, root * highest + wp.omega1 + wp.omega3):
            assert abs(o.H / (3 * a) + wp.p(z).real - truth) < mpf(10) ** -30
        as_printed = o.H / (3 * a) + wp.p(root * t).real  # without ω3, c1 = 1 or not: never a cosine
        assert as_printed > mp.sqrt(o.c1)
        assert abs(float(2 * wp.omega1 / root) - exact.nutation_period(top, y)) < 1e-14


def test_long_times():
    """σ grows like exp(t²): the digits of its exponent are provided for."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    for t in (1e3, 1e6):
        with mp.workdps(40):
            assert largest(states(top, y, t, digits=30) - exact.solution(top, y, t, digits=35)) < mpf(10) ** -28


def test_starts_where_J_plus_vanishes():
    """J+(0) = 0 and ℘'(b) = 0: ζ(z + b) has a pole, σ' does not."""
    top, y = LagrangeTop(1.0), np.array((0.0, 0.0, 0.5, 0.75, 0.0, 1.0))
    assert np.max(np.abs(states(top, y, TIMES) - exact.solution(top, y, TIMES))) < 1e-14


def test_next_to_the_poles():
    """alpha = 1e200: the poles a of φ are half-periods but for 1e-200 of them; the digits are provided for."""
    top, y = LagrangeTop(1e200), TOPS["generic"].state
    times = np.array((0.0, 1e-100, 5e-100))
    truth = to_angles(exact.solution(top, y, times))
    error = angles(top, y, times) - truth
    assert np.max(np.abs(error[:, 0])) < 1e-12
    assert np.max(np.abs(np.sin(error[:, 1]))) < 1e-12
    assert np.max(np.abs(error[:, 2])) < 1e-12 * 1e100


@pytest.mark.parametrize("name", sorted(set(TOPS) - set(ELLIPTIC)))
def test_degenerate_tops_are_refused(name):
    """No elliptic functions: alpha = 0, separatrix, regular precession, vertical tops."""
    with pytest.raises(ValueError, match=r"exact\.solution"):
        states(TOPS[name].top, TOPS[name].state, 1.0)


@pytest.mark.parametrize("name", sorted(POLES))
def test_orbits_through_poles_have_no_phi(name):
    with pytest.raises(ValueError, match="pole"):
        angles(TOPS[name].top, TOPS[name].state, 0.5)


def test_bad_arguments():
    top, y = TOPS["generic"].top, TOPS["generic"].state
    with pytest.raises(ValueError, match="digits"):
        states(top, y, 1.0, digits=0)
    with pytest.raises(ValueError, match="t must be"):
        angles(top, y, "now")
    with pytest.raises(ValueError, match="y0"):
        states(top, y[:5], 1.0)


@pytest.mark.parametrize("erratum", euler_angles.ERRATA, ids=lambda e: e.equation)
def test_errata(erratum):
    for seed in range(10):
        assert erratum.printed(random.Random(seed)) > 1e-2
        assert erratum.corrected(random.Random(seed)) < 1e-13
