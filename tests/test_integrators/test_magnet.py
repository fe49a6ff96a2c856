"""A Gaudin magnet is a problem as any other: all methods that accept it follow one flow, and keep their claims on it."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import MAGNETS, METHODS, GaudinMagnet, StepError, integrate, prepare
from lagrange_bench.integrators.methods.magnet import weights_of_two
from lagrange_bench.integrators.paper.gaudin_magnets import central_spin, random_magnet
from lagrange_bench.integrators.registry import available
from tests.faults import interrupted

MAGNET, SPINS = central_spin(4)
GENERAL = replace(MAGNET, hamiltonian=(1.0, -0.5, 0.25, 0.0))
TAKEN = [name for name, method in METHODS.items() if available(method) and method.takes(MAGNET.problem) is None]
IN_ARRAYS = [name for name in TAKEN if METHODS[name].needs == "spins" or "spins" in METHODS[name].special]
TOLERANT = [name for name in IN_ARRAYS if METHODS[name].control == "tolerance"]
LONG_TO_COMPILE = {
    "gauss6",
    "gauss8",
    "gauss12",
    "dop853",
    "taylor_fixed",
    "taylor_accurate",
    "kahan_li6",
    "verner9_fixed",
}


ONE_SITE = {"backlund_paper", "backlund_textbook"}  # their time step is that of one H_j


@pytest.mark.parametrize(
    ("name", "magnet"),
    [
        pytest.param(name, magnet, id=f"{name}-{word}")
        for name in TAKEN
        for word, magnet in (("site", MAGNET), ("hamiltonian", GENERAL))
        if name not in LONG_TO_COMPILE and not (word == "hamiltonian" and name in ONE_SITE)
    ],
)
def test_methods_follow_one_flow_and_keep_what_they_claim(name, magnet):
    method, truth = METHODS[name], integrate(magnet, SPINS, h=2.0, steps=1, method="backlund").y[-1]
    errors = []
    for steps in (64, 128):
        run = integrate(magnet, SPINS, h=2 / steps, steps=steps, method=name, every=8)
        assert run.y.shape == (steps // 8 + 1, 4, 3)
        assert np.array_equal(run.y[0], SPINS)
        assert run.t[-1] == 2.0
        errors.append(np.max(np.abs(run.y[-1] - truth)))
    if method.control == "step" and method.order and errors[-1] > 1e-12:
        assert abs(np.log2(errors[0] / errors[1]) - method.order) < 0.1
    else:
        assert max(errors) < 1e-8 if method.control == "tolerance" else 1e-12
    drift = np.max(np.abs(run.invariants() - run.invariants()[0]), axis=0)
    kept = method.kept(magnet.problem)
    assert all(size < 1e-13 for word, size in zip(magnet.problem.names, drift, strict=True) if word in kept)
    if name == "strang":  # negative control: the claim leaves out what is not kept
        assert kept
        assert drift[0] > 1e-10


@pytest.mark.parametrize("name", ["spherical_midpoint", "strang", "implicit_midpoint"])
def test_claims_hold_on_a_magnet(name):
    verdicts = check.check(name, quick=True, problem=MAGNET, y0=SPINS)
    assert [verdict.claim for verdict in verdicts if verdict.passed is False] == []
    liar = replace(METHODS[name], poisson=True, if_quadratic=frozenset({"H"}), order=3)
    wrong = {f"magnet: {claim}" for claim in ("order 3", "Poisson map", "conserves H_0")}
    honest = {"magnet: conserves H_0"} if name == "implicit_midpoint" else {"magnet: Poisson map"}
    failures = {verdict.claim for verdict in check.check(liar, True, MAGNET, SPINS) if verdict.passed is False}
    assert failures & wrong == wrong - honest


def test_the_tape_and_the_arrays_are_one_problem():
    problem, y = GENERAL.problem, SPINS.ravel()
    tape = problem._values(problem.system.rhs, y, 0.0)
    np.testing.assert_allclose(problem.rhs(y), tape, atol=1e-15)
    slope = [(problem.energy(y + 1e-6 * e) - problem.energy(y - 1e-6 * e)) / 2e-6 for e in np.eye(12)]
    np.testing.assert_allclose(problem.poisson(y) @ slope, problem.rhs(y), atol=1e-9)
    assert MAGNETS["central32"].magnet.problem.offers == {"spins"}


@pytest.mark.parametrize("size", [1e-8, 1e-100])
@pytest.mark.parametrize("method", TOLERANT)
def test_tolerances_are_relative_to_the_spins(method, size):
    """A magnet with small spins moves slowly, and otherwise in the same way."""
    field, spins = replace(MAGNET, alpha=size * MAGNET.alpha), size * SPINS
    end = integrate(field, spins, h=0.5 / size, steps=4, method=method).y[-1] / size
    assert np.max(np.abs(end - integrate(MAGNET, SPINS, h=2.0, steps=1, method="backlund").y[-1])) < 1e-12


def test_threads_may_share_a_stepper():
    pytest.importorskip("heyoka")
    stepper, y = prepare(MAGNET, SPINS, 0.05, "taylor"), SPINS.ravel()
    expected = {n: stepper.advance(y, n) for n in (2000, 700)}
    with ThreadPoolExecutor(2) as pool:
        for n, end in pool.map(lambda n: (n, stepper.advance(y, n)), [2000, 700] * 8):
            assert np.array_equal(end, expected[n])


@pytest.mark.parametrize("n", [2, 5])
@pytest.mark.parametrize("method", IN_ARRAYS)
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
    if method not in TAKEN:
        pytest.skip(f"{method} is not installed here")
    magnet, spins = MAGNETS["central32"]
    stepper, y = prepare(magnet, spins, 1e8 if method == "taylor" else 0.1, method), spins.ravel()
    stepper.advance(y, 0 if method == "taylor" else 1)
    with interrupted():
        stepper.record(y, steps, max(1, steps // 4))


@pytest.mark.parametrize("method", TOLERANT)
def test_times_that_no_steps_reach(method):
    with pytest.raises(StepError, match=rf"^{method} at h = 1e\+300: .*more steps than can be taken"):
        integrate(MAGNET, SPINS, 1e300, 1, method)


def test_options_reach_the_method():
    loose = integrate(MAGNET, SPINS, h=5.0, steps=1, method="scipy_dop853", rtol=1e-4).y[-1]
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
        ({"method": "theta_functions"}, "does not take the problem magnet"),
        ({"h": 0.0}, "h"),
        ({"h": None}, "h and steps"),
        ({"steps": -1}, "steps"),
        ({"every": 3}, "every"),
        ({"y0": SPINS[:3]}, "y0"),
        ({"y0": SPINS * np.nan}, "y0"),
        ({"y0": SPINS * 1j}, "y0"),
        ({"t": [0.0, 1.0]}, "^t: backlund steps on a grid only"),
        ({"attitude": True}, "attitude"),
        ({"tol": 1e-3}, "tol"),
        *(({"method": "taylor", "tol": tol}, "^tol must be") for tol in (0.0, -1e-9, 2.0, np.nan, "1e-9")),
        *(({"method": "scipy_dop853", "rtol": rtol}, "^rtol must be") for rtol in ("small", 0.0, -1e-9, 1e-17, np.nan)),
        *(({"method": "backlund_paper", "factors": k}, "^factors must be") for k in (0, 17, 1.5, True, "2", None)),
        ({"method": "backlund_paper", "top": GENERAL}, "hamiltonian"),
        ({"top": MAGNETS["central128"].magnet, "y0": MAGNETS["central128"].spins}, "at most 32"),
        ({"top": GaudinMagnet((0, 1j, -1j, 2), 0.5)}, "sites"),
        ({"top": "magnet"}, "top"),
    ],
)
def test_bad_input(change, named):
    if change.get("method") == "taylor":
        pytest.importorskip("heyoka")
    call = {"top": MAGNET, "y0": SPINS, "h": 0.5, "steps": 2}
    if "t" in change:
        call |= {"h": None, "steps": None}
    with pytest.raises(ValueError, match=named):
        integrate(**call | change)


@pytest.mark.parametrize("method", IN_ARRAYS)
@pytest.mark.parametrize("kind", [mpmath.mpf, complex, np.float32])
def test_sites_and_alpha_may_be_any_real_numbers(method, kind):
    plain, alpha = GaudinMagnet((0.0, 0.5, 2.0**70, -1.5), 0.5), 0.5 if kind is complex else kind(0.5)
    other = GaudinMagnet((kind(0.0), kind(0.5), 2**70, kind(-1.5)), alpha)
    ends = [integrate(magnet, SPINS, h=0.3, steps=4, method=method).y[-1] for magnet in (plain, other)]
    assert np.array_equal(*ends)


def test_an_iteration_that_does_not_converge_is_an_error():
    with pytest.raises(StepError, match="iterations"):
        integrate(MAGNET, SPINS, h=50.0, steps=1, method="implicit_midpoint")
