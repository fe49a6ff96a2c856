"""Compiled steps of the magnet: the map itself, round-off over long runs, which flow a step is, order and exactness."""

from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import StepError
from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue
from lagrange_bench.integrators.paper.gaudin_maps import two_point
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet, random_magnet, unit_of_time
from lagrange_bench.integrators.paper.gaudin_step import MagnetStepper, prepare, prepare_exact

PROMISE = 1e-12  # of issue 3: relative change of every |s_j| and H_j over 1e5 steps


def magnet(n):
    """A central spin at 0 and others at sites of one sign."""
    rng = np.random.default_rng(0)
    spins = rng.normal(size=(n, 3))
    return GaudinMagnet((0.0, *-np.cumsum(rng.uniform(0.3, 1, n - 1))), 0.7), spins


def maps(m, spins, lams, sheet):
    """A stepper of these maps, counted from the site at 0."""
    v = [eigenvalue(m, spins, lam, sheet) for lam in lams]
    return MagnetStepper(m, spins, 0.1, [0] * len(lams), np.array(lams), v, Fraction(0))


def flow(m, spins, c, t=1.0):
    """The flow of Σ c_j H_j by SciPy's DOP853, good to 1e-12 here."""
    found = solve_ivp(
        lambda _, y: m.rhs(y.reshape(spins.shape), c).ravel(), (0, t), spins.ravel(), "DOP853", rtol=1e-13, atol=1e-13
    )
    assert found.success
    return found.y[:, -1].reshape(spins.shape)


def drift(m, spins, image):
    """Largest relative change of the H_j and of the s_j²."""
    scales = np.concatenate((m.hamiltonian_scales(spins), m.casimirs(spins)))
    return np.max(np.reshape(np.abs(m.invariants(image) - m.invariants(spins)) / scales, (2, -1)), axis=1)


@pytest.mark.parametrize(("n", "sheet"), [(1, 1), (8, -1)])
def test_the_kernel_is_the_map(n, sheet):
    m, spins = magnet(n)
    lams = (0.2 + 0.3j, -1.1 + 0.6j)
    image = two_point(m, two_point(m, spins, lams[0], sheet), lams[1], sheet)
    stepper = maps(m, spins, lams, sheet)
    got = stepper.advance(spins, 1)
    assert np.max(np.abs(got - image)) < 1e-13
    assert np.max(np.abs(maps(m, got, lams, -sheet).advance(got, 1) - spins)) < 1e-13
    assert max(drift(m, spins, stepper.advance(spins, 1000))) < PROMISE


def test_off_the_torus():
    m, spins = magnet(3)
    with pytest.raises(StepError, match="torus"):
        prepare(m, spins, 0.3).advance(spins * (1 + 1e-6), 1)


@pytest.mark.parametrize(
    ("prepare_step", "n", "steps"),
    [
        (partial(prepare, h=0.3, factors=4), 8, 100_000),
        (partial(prepare, h=0.3), 32, 20_000),
        (partial(prepare_exact, h=10.0), 5, 100_000),
    ],
    ids=["order 8", "32 spins", "exact"],
)
def test_promise_of_long_runs(prepare_step, n, steps):
    """Lengths are pinned. With v off by 1e-9, no longer on the curve, the promise is broken."""
    m, spins = magnet(n)
    stepper = prepare_step(m, spins)
    energies, squares = drift(m, spins, stepper.advance(spins, steps))
    assert squares <= 8e-16
    assert energies <= PROMISE
    stepper.v, stepper.follow = stepper.v * (1 + 1e-9), False
    assert drift(m, spins, stepper.advance(spins, 1000))[0] > PROMISE


def times(m, spins, lam):
    """c_j = Im ∫ du/(v (u − a_j)) along the segment from site 0 to λ."""
    x, weights = np.polynomial.legendre.leggauss(100)
    u = lam * (x + 1) / 2
    v = np.array([eigenvalue(m, spins, w) for w in u])
    return ((weights * lam / (2 * v)) @ (1 / (u[:, None] - m.sites))).imag


@pytest.mark.parametrize("n", [1, 5])
def test_one_step_is_the_interpolating_flow(n):
    """Section 5.6: a step is the flow of ∫ μ du (no factor i) over time 1, that is of Σ c_j H_j."""
    m, spins = magnet(n)
    for lam in (0.25 + 0.3j, -0.9 + 0.7j):
        c, image = times(m, spins, lam), two_point(m, spins, lam)
        assert np.max(np.abs(image - flow(m, spins, c))) < 1e-11
        assert np.max(np.abs(two_point(m, spins, lam, -1) - flow(m, spins, -c))) < 1e-11
        assert np.max(np.abs(times(m, image, lam) - c)) < 1e-12  # constants of motion


@pytest.mark.parametrize("factors", [1, 3])
def test_pade_steps_have_order_twice_their_number(factors):
    m, spins = magnet(6)
    truth = flow(m, spins, np.eye(6)[0])
    errors = []
    for steps in (4, 8, 16):
        image = prepare(m, spins, 1 / steps, factors=factors).advance(spins, steps)
        errors.append(np.max(np.abs(image - truth)))
    orders = -np.diff(np.log2(errors))
    assert abs(orders[-1] - 2 * factors) < 0.35


def exact_cases():
    """Magnets, spins and times: 1 to 8 spins, no field, a spin that is zero."""
    for n, h in ((1, 0.7), (5, -7.0), (8, 5.0)):
        m, spins = magnet(n)
        yield replace(m, site=n - 1), spins, h
    m, spins = magnet(4)
    yield replace(m, alpha=0.0), spins, 3.0
    yield from ((m, spins * np.array([[a], [1], [0], [1]]), 3.0) for a in (0, 1))


@pytest.mark.parametrize("case", range(6))
def test_exact_steps(case):
    """At most ⌊n/2⌋ maps, and a turn, are the flow of H_site over any h; with another turn they are not."""
    m, spins, h = list(exact_cases())[case]
    stepper = prepare_exact(m, spins, h)
    assert len(stepper.lams) <= len(m) // 2
    truth = flow(m, spins, m.flow, 2 * h)
    assert np.max(np.abs(stepper.advance(spins, 2) - truth)) < 2e-11
    stepper.turn += Fraction(1, 10**6)
    assert np.max(np.abs(stepper.advance(spins, 2) - truth)) > 1e-7


def test_a_step_that_drives_states_away_follows_them():
    """Two maps that nearly undo one another: with frozen v round-off grows by a factor e in thousands of steps."""
    m, spins = random_magnet(4, 3)
    stepper = prepare_exact(m, spins, 5 * unit_of_time(m, spins))
    assert stepper.follow
    assert max(drift(m, spins, stepper.advance(spins, 50_000))) < PROMISE
    stepper.follow = False
    assert max(drift(m, spins, stepper.advance(spins, 50_000))) > 1e-8
