"""Magnets behind `integrate`: all methods follow one flow, with the orders and invariants they claim; bad input is named."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from lagrange_bench.integrators import MAGNET_METHODS, MAGNETS, GaudinMagnet, StepError, integrate
from lagrange_bench.integrators.paper.gaudin_magnets import central_spin, random_magnet
from lagrange_bench.integrators.paper.gaudin_methods import prepare_method, weights_of_two
from lagrange_bench.integrators.registry import available
from tests.faults import interrupted

MAGNET, SPINS = central_spin(4)
HERE = [name for name, method in MAGNET_METHODS.items() if method.requires is None or available(method)]
GENERAL = replace(MAGNET, hamiltonian=(1.0, -0.5, 0.25, 0.0))


@pytest.mark.parametrize(
    ("method", "magnet"),
    [
        pytest.param(method, magnet, id=f"{method.name}-{word}")
        for method in map(MAGNET_METHODS.get, HERE)
        for word, magnet in (("site", MAGNET), ("hamiltonian", GENERAL))
        if (method.name, word) != ("backlund_paper", "hamiltonian")
    ],
)
def test_methods_follow_one_flow_and_keep_what_they_claim(method, magnet):
    truth = integrate(magnet, SPINS, h=2.0, steps=1, method="backlund").y[-1]
    errors = []
    for steps in (32, 64):
        run = integrate(magnet, SPINS, h=2 / steps, steps=steps, method=method.name, every=8)
        assert run.y.shape == (steps // 8 + 1, 4, 3)
        assert np.array_equal(run.y[0], SPINS)
        assert run.t[-1] == 2.0
        errors.append(np.max(np.abs(run.y[-1] - truth)))
    if method.order is None:
        assert max(errors) < 1e-12
    else:
        assert abs(np.log2(errors[0] / errors[1]) - method.order) < 0.1
    found = run.invariants()
    kept = {"H_j": found[:, :4], "|s_j|": found[:, 4:], "S3": np.sum(run.y[..., 2], axis=1)[:, None]}
    drift = {name: np.max(np.abs(values - values[0])) for name, values in kept.items()}
    assert max(drift[name] for name in (method.conserves or kept)) < 1e-13
    if method.order and "H_j" not in method.conserves:  # negative control: the claim leaves out what is not kept
        assert drift["H_j"] > 1e-10


@pytest.mark.parametrize("method", [m for m in MAGNET_METHODS.values() if m.control == "step"], ids=lambda m: m.name)
def test_methods_are_poisson_as_claimed(method):
    """M P M^T = P at the image, the derivative M of one step by central differences."""
    magnet, spins = central_spin(2)
    spins = 0.7 * spins

    def step(y):
        given = {"magnet": magnet, "spins": y.reshape(2, 3), "h": 0.5, "method": method.name, "options": {}}
        return prepare_method(**given).advance(y.reshape(2, 3), 1).ravel()

    y, d = spins.ravel(), 1e-5
    M = np.array([(step(y + d * e) - step(y - d * e)) / (2 * d) for e in np.eye(6)]).T
    here, there = magnet.poisson(spins), magnet.poisson(step(y).reshape(2, 3))
    defect = np.max(np.abs(M @ here.astype(float) @ M.T - there.astype(float)))
    assert defect < 1e-8 if method.poisson else defect > 1e-5


TOLERANT = [name for name in HERE if MAGNET_METHODS[name].control == "tolerance"]


@pytest.mark.parametrize("size", [1e-8, 1e-100])
@pytest.mark.parametrize("method", TOLERANT)
def test_tolerances_are_relative_to_the_spins(method, size):
    """A magnet with small spins moves slowly, and otherwise in the same way."""
    field, spins = replace(MAGNET, alpha=size * MAGNET.alpha), size * SPINS
    end = integrate(field, spins, h=0.5 / size, steps=4, method=method).y[-1] / size
    assert np.max(np.abs(end - integrate(MAGNET, SPINS, h=2.0, steps=1, method="backlund").y[-1])) < 1e-12


@pytest.mark.skipif("taylor" not in TOLERANT, reason="heyoka is not installed here")
def test_threads_may_share_a_stepper():
    stepper = prepare_method(MAGNET, SPINS, 0.05, "taylor", {})
    expected = {n: stepper.advance(SPINS, n) for n in (2000, 700)}
    with ThreadPoolExecutor(2) as pool:
        for n, end in pool.map(lambda n: (n, stepper.advance(SPINS, n)), [2000, 700] * 8):
            assert np.array_equal(end, expected[n])


def test_steps_backwards():
    for name in ("backlund", "strang", "implicit_midpoint"):
        there = integrate(MAGNET, SPINS, h=0.5, steps=1, method=name).y[-1]
        assert np.max(np.abs(integrate(MAGNET, there, h=-0.5, steps=1, method=name).y[-1] - SPINS)) < 1e-13


@pytest.mark.parametrize("n", [2, 5])
@pytest.mark.parametrize("method", HERE)
def test_only_differences_of_sites_count(method, n):
    magnet, spins = random_magnet(n, 1)
    sites = [round(1024 * a) / 1024 for a in magnet.sites]
    options = {"factors": 2} if method == "backlund_paper" else {}
    here, *there = (
        integrate(replace(magnet, sites=tuple(a + far for a in sites)), spins, 0.125, 16, method, **options)
        for far in (0.0, 2.0**20, -(2.0**30), 2.0**40)
    )
    for run in there:
        assert np.max(np.abs(run.y - here.y)) < 1e-12
        assert np.max(np.abs(run.invariants() - here.invariants())) < 1e-12


@pytest.mark.parametrize("flow", [*({"site": j} for j in range(4)), {"hamiltonian": (0.3, -0.2, 1.0, 0.5)}], ids=str)
def test_groups_of_sites_far_apart(flow):
    pytest.importorskip("heyoka")
    magnet = GaudinMagnet((-5e7, 1e8, 1e8 + 0.5, 1e8 + 2), 0.7, **flow)
    for h in (1.0, -5.0):
        exact, truth = (integrate(magnet, SPINS, h, 1, method).y[-1] for method in ("backlund", "taylor"))
        assert np.max(np.abs(exact - truth)) < 1e-13


@pytest.mark.parametrize(("method", "steps"), [("taylor", 1), ("taylor", 4), ("implicit_midpoint", 10**9)])
def test_control_c_ends_a_long_run(method, steps):
    if method not in HERE:
        pytest.skip(f"{method} is not installed here")
    magnet, spins = MAGNETS["central32"]
    stepper = prepare_method(magnet, spins, 1e8 if method == "taylor" else 0.1, method, {})
    stepper.advance(spins, 0 if method == "taylor" else 1)
    with interrupted():
        stepper.record(spins, steps, max(1, steps // 4))


@pytest.mark.parametrize("tol", [0.0, -1e-9, 2.0, np.nan, "1e-9"])
def test_tolerances_of_heyoka(tol):
    pytest.importorskip("heyoka")
    with pytest.raises(ValueError, match=r"^tol must be"):
        integrate(MAGNET, SPINS, 0.5, 2, "taylor", tol=tol)


@pytest.mark.parametrize("method", TOLERANT)
def test_times_that_no_steps_reach(method):
    with pytest.raises(StepError, match=rf"^{method} at h = 1e\+300: a spin may turn .* times"):
        integrate(MAGNET, SPINS, 1e300, 1, method)


def test_options_reach_the_method():
    loose = integrate(MAGNET, SPINS, h=5.0, steps=1, method="dop853", rtol=1e-4).y[-1]
    truth = integrate(MAGNET, SPINS, h=5.0, steps=1).y[-1]
    assert 1e-7 < np.max(np.abs(loose - truth)) < 1e-2
    four = integrate(MAGNET, SPINS, h=0.25, steps=20, method="backlund_paper", factors=2).y[-1]
    assert np.max(np.abs(four - truth)) < 1e-3


def test_coefficients_of_two_parts():
    """Strang is φ* φ at half the step; a scheme of two parts and its weights have the same sums."""
    assert np.array_equal(weights_of_two((0.5, 0.5), (1.0,)), (0.5, 0.5))
    weights = weights_of_two((0.1, 0.3, 0.2, 0.3, 0.1), (0.25, 0.25, 0.25, 0.25))
    assert np.isclose(np.sum(weights), 1)
    assert np.allclose(weights, weights[::-1])


def test_named_and_random_magnets():
    assert {len(named.magnet) for named in MAGNETS.values()} == {8, 32, 128}
    magnet, spins = random_magnet(5, 3)
    assert magnet == random_magnet(5, 3).magnet
    assert magnet != random_magnet(5, 4).magnet
    assert spins.shape == (5, 3)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"method": "backlnd"}, "backlund"),
        ({"h": 0.0}, "h"),
        ({"h": None}, "h and steps"),
        ({"steps": -1}, "steps"),
        ({"every": 3}, "every"),
        ({"y0": SPINS[:3]}, "spins"),
        ({"y0": SPINS * np.nan}, "spins"),
        ({"y0": SPINS * 1j}, "spins"),
        ({"t": [0.0, 1.0]}, "t"),
        ({"attitude": True}, "attitude"),
        ({"tol": 1e-3}, "tol"),
        *(({"method": "dop853", "rtol": rtol}, "^rtol must be") for rtol in ("small", 0.0, -1e-9, 1e-17, 2.0, np.nan)),
        *(({"method": "backlund_paper", "factors": k}, "^factors must be") for k in (0, 17, 1.5, True, "2", None)),
        ({"method": "backlund_paper", "top": GENERAL}, "hamiltonian"),
        ({"top": MAGNETS["central128"].magnet, "y0": MAGNETS["central128"].spins}, "at most 32"),
        ({"top": GaudinMagnet((0, 1j, -1j, 2), 0.5)}, "sites"),
        ({"top": "magnet"}, "top"),
    ],
)
def test_bad_input(change, named):
    call = {"top": MAGNET, "y0": SPINS, "h": 0.5, "steps": 2}
    if "t" in change:
        call |= {"h": None, "steps": None}
    with pytest.raises(ValueError, match=named):
        integrate(**call | change)


@pytest.mark.parametrize("method", HERE)
@pytest.mark.parametrize("kind", [mpmath.mpf, complex, np.float32])
def test_sites_and_alpha_may_be_any_real_numbers(method, kind):
    plain, alpha = GaudinMagnet((0.0, 0.5, 2.0**70, -1.5), 0.5), 0.5 if kind is complex else kind(0.5)
    other = GaudinMagnet((kind(0.0), kind(0.5), 2**70, kind(-1.5)), alpha)
    ends = [integrate(magnet, SPINS, h=0.3, steps=4, method=method).y[-1] for magnet in (plain, other)]
    assert np.array_equal(*ends)


def test_an_iteration_that_does_not_converge_is_an_error():
    with pytest.raises(StepError, match="iterations"):
        integrate(MAGNET, SPINS, h=50.0, steps=1, method="implicit_midpoint")
