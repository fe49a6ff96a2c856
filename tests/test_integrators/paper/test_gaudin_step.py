"""Compiled steps of the magnet: the map itself, round-off over long runs, which flow a step is, order and exactness."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import StepError
from lagrange_bench.integrators.paper.gaudin_curve import pade_parameters, times
from lagrange_bench.integrators.paper.gaudin_magnets import random_magnet, unit_of_time
from lagrange_bench.integrators.paper.gaudin_maps import two_point
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from lagrange_bench.integrators.paper.gaudin_step import MagnetStepper, prepare, prepare_exact

PROMISE = 1e-12  # of issue 3: relative change of every |s_j| and H_j over 1e5 steps


def magnet(n, seed=0, pairs=False):
    """A central spin at 0 and others at real sites of one sign, or at a conjugate pair."""
    rng = np.random.default_rng(seed)
    spins = rng.normal(size=(n, 3))
    if not pairs:
        return GaudinMagnet((0.0, *-np.cumsum(rng.uniform(0.3, 1, n - 1))), 0.7), spins
    spins = spins + 1j * rng.normal(size=(n, 3))
    spins[0], spins[2] = spins[0].real, spins[1].conj()
    return GaudinMagnet((0.0, 0.6 + 0.4j, 0.6 - 0.4j), 0.7), spins


def flow(m, spins, c, t=1.0):
    """The flow of Σ c_j H_j by SciPy's DOP853, good to 1e-12 here."""
    found = solve_ivp(
        lambda _, y: m.rhs(y.reshape(spins.shape), c).ravel(), (0, t), spins.ravel(), "DOP853", rtol=1e-13, atol=1e-13
    )
    assert found.success
    return found.y[:, -1].reshape(spins.shape)


def drift(m, spins, image):
    """Largest relative change of the |s_j| and of the H_j."""
    lengths = np.sqrt(m.casimirs(image) / m.casimirs(spins)) - 1
    energies = (m.hamiltonians(image) - m.hamiltonians(spins)) / m.hamiltonian_scales(spins)
    return np.max(np.abs(lengths)), np.max(np.abs(energies))


# ---------------------------------------------------------------------------------------------- the compiled map


@pytest.mark.parametrize("n", [1, 3, 8])
@pytest.mark.parametrize("sheet", [1, -1])
def test_the_kernel_is_the_map(n, sheet):
    m, spins = magnet(n)
    lams = (0.2 + 0.3j, -1.1 + 0.6j)
    image = spins
    for lam in lams:
        image = two_point(m, image, lam, sheet)
    stepper = MagnetStepper(m, spins, lams, sheet)
    got = stepper.advance(spins, 1)
    assert np.max(np.abs(got - image)) < 1e-13
    back = MagnetStepper(m, got, lams, -sheet).advance(got, 1)
    assert np.max(np.abs(back - spins)) < 1e-13
    assert stepper.work.steps == 1


def test_conjugate_sites_run_in_the_same_kernel():
    m, spins = magnet(3, pairs=True)
    stepper = prepare(m, spins, 0.4)
    assert np.max(np.abs(stepper.advance(spins, 1) - two_point(m, spins, stepper.lams[0]))) < 1e-13
    image = stepper.advance(spins, 1000)
    assert max(drift(m, spins, image)) < PROMISE
    assert np.max(np.abs(image[m.partners].conj() - image)) < 1e-12


def test_recording():
    m, spins = magnet(3)
    before = spins.copy()
    stepper = prepare(m, spins, 0.3, factors=2)
    rows = stepper.record(spins, 40, 8)
    assert rows.shape == (6, 3, 3)
    assert np.array_equal(rows[0], spins)
    assert np.array_equal(rows[-1], stepper.advance(spins, 40))
    assert np.array_equal(rows[2], stepper.advance(spins, 16))  # multiples of the pin
    assert np.array_equal(spins, before)
    assert np.array_equal(stepper.advance(spins, 0), spins)
    with pytest.raises(ValueError, match="every"):
        stepper.record(spins, 10, 3)
    with pytest.raises(StepError, match="torus"):
        stepper.advance(spins * (1 + 1e-6), 1)


# ---------------------------------------------------------------------------------------------- round-off


@pytest.mark.parametrize(
    ("n", "factors", "steps"), [(8, 4, 100_000), (2, 1, 100_000), (3, 2, 100_000), (32, 1, 20_000)]
)
def test_promise_of_long_runs(n, factors, steps):
    m, spins = magnet(n)
    image = prepare(m, spins, 0.3, factors=factors).advance(spins, steps)
    lengths, energies = drift(m, spins, image)
    assert lengths <= 4e-16  # pinned
    assert energies <= PROMISE


def test_the_promise_is_broken_by_a_wrong_point_of_the_curve():
    """Negative control: v off by 1e-9 is no longer on the curve."""
    m, spins = magnet(8)
    stepper = prepare(m, spins, 0.3)
    stepper.v = stepper.v * (1 + 1e-9)
    assert drift(m, spins, stepper.advance(spins, 1000))[1] > PROMISE


@pytest.mark.parametrize("sheet", [1, -1])
def test_frozen_v_draws_the_state_back(sheet):
    """Two spins, H_j pushed off by 1e-10: the step with v of the torus returns to it, forwards and backwards."""
    m, spins = magnet(2)
    stepper = MagnetStepper(m, spins, 0.1 + 0.3j, sheet)
    pushed = spins + 1e-10 * np.cross(spins, [[1.0, 2.0, 3.0], [-1.0, 0.5, 2.0]])  # lengths stay
    assert drift(m, spins, pushed)[1] > 1e-11
    assert drift(m, spins, stepper.advance(pushed, 20_000))[1] < 1e-13


# ---------------------------------------------------------------------------------------------- which flow a step is


@pytest.mark.parametrize(("n", "site"), [(1, 0), (2, None), (3, 0), (5, None)])
def test_one_step_is_the_interpolating_flow(n, site):
    """Section 5.6: a step is the flow of ∫ μ du (no factor i) over time 1, that is of Σ c_j H_j with c of `times`."""
    m, spins = magnet(n)
    for lam in (0.25 + 0.3j, -0.9 + 0.7j):
        c = times(m, spins, lam, 1, site)
        assert np.max(np.abs(two_point(m, spins, lam, 1, site) - flow(m, spins, c))) < 1e-11
        assert np.max(np.abs(two_point(m, spins, lam, -1, site) - flow(m, spins, -c))) < 1e-11


def test_the_same_with_conjugate_sites():
    m, spins = magnet(3, pairs=True)
    for site in (0, None):
        c = times(m, spins, 0.25 + 0.3j, 1, site)
        assert abs(c[1] - c[2].conjugate()) < 1e-14
        assert np.max(np.abs(two_point(m, spins, 0.25 + 0.3j, 1, site) - flow(m, spins, c))) < 1e-11


def test_times_are_constants_of_motion():
    m, spins = magnet(4)
    c = times(m, spins, 0.2 + 0.4j)
    assert np.max(np.abs(times(m, prepare(m, spins, 0.5).advance(spins, 100), 0.2 + 0.4j) - c)) < 1e-13


@pytest.mark.parametrize("factors", [1, 2, 3])
def test_pade_steps_have_order_twice_their_number(factors):
    m, spins = magnet(6)
    truth = flow(m, spins, np.eye(6)[0])
    errors = []
    for steps in (4, 8, 16):
        image = prepare(m, spins, 1 / steps, factors=factors).advance(spins, steps)
        errors.append(np.max(np.abs(image - truth)))
    orders = -np.diff(np.log2(errors))
    assert abs(orders[-1] - 2 * factors) < 0.35


def test_first_pade_parameter_is_the_papers():
    m, spins = magnet(3)
    assert abs(pade_parameters(m, spins, 0.2)[0] - 0.2j * np.linalg.norm(spins[0])) < 1e-16


@pytest.mark.parametrize(("n", "h"), [(1, 0.7), (2, 12.0), (3, 0.5), (4, 8.0), (5, -7.0), (8, 5.0)])
def test_exact_steps(n, h):
    """⌊n/2⌋ maps, and a turn for odd n, are the flow of H_1 over any h; also of another H_j."""
    m, spins = magnet(n)
    for site in {0, n - 1}:
        stepper = prepare_exact(replace(m, site=site), spins, h)
        assert len(stepper.lams) == n // 2
        truth = flow(m, spins, np.eye(n)[site], 2 * h)
        assert np.max(np.abs(stepper.advance(spins, 2) - truth)) < 2e-11
        stepper.turn += Fraction(1, 10**6)  # negative control
        assert np.max(np.abs(stepper.advance(spins, 2) - truth)) > 1e-7


@pytest.mark.parametrize("alpha", [0.7, 0.0])
@pytest.mark.parametrize("c", [(0.5, -1.5, 0.25, 0.0), (1.0, 1.0, 1.0, 1.0)])
def test_exact_steps_of_any_hamiltonian(c, alpha):
    m, spins = magnet(4)
    m = replace(m, alpha=alpha, hamiltonian=c)
    image = prepare_exact(m, spins, 3.0).advance(spins, 1)
    assert np.max(np.abs(image - flow(m, spins, np.array(c), 3.0))) < 2e-11


def test_exact_step_without_all_spins():
    """A spin that is zero stays so."""
    m, spins = magnet(4)
    spins[2] = 0
    image = prepare_exact(m, spins, 3.0).advance(spins, 1)
    assert np.max(np.abs(image - flow(m, spins, np.eye(4)[0], 3.0))) < 2e-11


def test_long_runs_of_long_steps_keep_everything():
    for n in (5, 8):
        m, spins = magnet(n)
        lengths, energies = drift(m, spins, prepare_exact(m, spins, 10.0).advance(spins, 100_000))
        assert max(lengths, energies) <= PROMISE


def test_a_step_that_drives_states_away_follows_them():
    """Two maps that nearly undo one another: with frozen v round-off grows by a factor e in thousands of steps."""
    m, spins = random_magnet(4, 3)
    stepper = prepare_exact(m, spins, 5 * unit_of_time(m, spins))
    assert stepper.follow
    assert max(drift(m, spins, stepper.advance(spins, 50_000))) < PROMISE
    stepper.follow = False
    assert max(drift(m, spins, stepper.advance(spins, 50_000))) > 1e-8


def test_exact_step_with_conjugate_sites():
    m, spins = magnet(3, pairs=True)
    stepper = prepare_exact(m, spins, 4.0)
    assert np.max(np.abs(stepper.advance(spins, 1) - flow(m, spins, np.eye(3)[0], 4.0))) < 1e-11


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda m, s: prepare(m, s, 0.0), "h"),
        (lambda m, s: prepare(m, s, np.nan), "h"),
        (lambda m, s: prepare(m, s, 0.1, factors=0), "factors"),
        (lambda m, s: prepare(m, s, 0.1, factors=99), "factors"),
        (lambda m, s: prepare(replace(m, site=4), s, 0.1), "site"),
        (lambda m, s: prepare(replace(m, hamiltonian=(1, 2, 3)), s, 0.1), "hamiltonian"),
        (lambda m, s: replace(m, hamiltonian=(1, 2)), "hamiltonian"),
        (lambda m, s: replace(m, site=1, hamiltonian=(1, 2, 3)), "either"),
        (lambda m, s: prepare(m, s * np.array(((0,), (1,), (1,))), 0.1), "site"),
        (lambda m, s: prepare_exact(m, s, np.inf), "h"),
        (lambda m, s: pade_parameters(m, s, -0.1), "h"),
        (lambda m, s: MagnetStepper(m, s, -1j), "lams"),
        (lambda m, s: MagnetStepper(m, s, np.nan), "lams"),
        (lambda m, s: MagnetStepper(m, s[:2], 1j), "spins"),
        (lambda m, s: times(m, s, 0.3), "lams"),
    ],
)
def test_bad_input(call, named):
    with pytest.raises(ValueError, match=named):
        call(*magnet(3))
