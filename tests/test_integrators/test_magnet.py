"""A Gaudin magnet is a problem as any other: all methods that accept it follow one flow, and keep their claims on it."""

from dataclasses import replace

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import MAGNETS, METHODS, GaudinMagnet, integrate, prepare
from lagrange_bench.integrators.paper.gaudin_model import central_spin, random_magnet
from lagrange_bench.integrators.registry import available
from tests.faults import interrupted

MAGNET, SPINS = central_spin(4)
GENERAL = replace(MAGNET, hamiltonian=(1.0, -0.5, 0.25, 0.0))
TAKEN = [name for name, method in METHODS.items() if available(method) and method.takes(MAGNET.problem) is None]
IN_ARRAYS = [name for name in TAKEN if METHODS[name].needs == "spins" or "spins" in METHODS[name].special]
TOLERANT = [name for name in IN_ARRAYS if METHODS[name].control == "tolerance"]
ONE_SITE = {"backlund_paper", "backlund_textbook"}  # their time step is that of one H_j


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("name", "magnet"),
    [
        pytest.param(name, magnet, id=f"{name}-{word}")
        for name in (*IN_ARRAYS, "rk4")
        for word, magnet in (("site", MAGNET), ("hamiltonian", GENERAL))
        if not (word == "hamiltonian" and name in ONE_SITE)
    ],
)
def test_methods_follow_one_flow_and_keep_what_they_claim(name, magnet):
    method, truth = METHODS[name], integrate(magnet, SPINS, h=2.0, steps=1, method="backlund").y[-1]
    errors = []
    for steps in (64, 128):
        run = integrate(magnet, SPINS, h=2 / steps, steps=steps, method=name, every=8)
        errors.append(np.max(np.abs(run.y[-1] - truth)))
    if method.control == "step" and method.order and errors[-1] > 1e-12:
        assert abs(np.log2(errors[0] / errors[1]) - method.order) < 0.1
    else:
        assert max(errors) < (1e-8 if method.control == "tolerance" else 1e-12)
    drift = np.max(np.abs(run.invariants() - run.invariants()[0]), axis=0)
    kept = method.kept(magnet.problem)
    assert all(size < 1e-13 for word, size in zip(magnet.problem.names, drift, strict=True) if word in kept)


@pytest.mark.parametrize("name", [pytest.param("strang", marks=pytest.mark.interpreted), "implicit_midpoint"])
def test_claims_hold_on_a_magnet(name, monkeypatch):
    monkeypatch.setattr(check, "FIELD_STEPS", 100)
    liar = replace(METHODS[name], poisson=True, if_quadratic=frozenset({"H"}), order=3)
    with np.errstate(all="ignore"):  # where nothing is compiled, NumPy warns of an overflow
        verdicts, lies = (check.check(method, quick=True, problem=MAGNET, y0=SPINS) for method in (name, liar))
    assert [verdict.claim for verdict in verdicts if verdict.passed is False] == []
    wrong = {f"magnet: {claim}" for claim in ("order 3", "Poisson map", "conserves H_0")}
    honest = {"magnet: conserves H_0"} if name == "implicit_midpoint" else {"magnet: Poisson map"}
    failures = {verdict.claim for verdict in lies if verdict.passed is False}
    assert failures & wrong == wrong - honest


@pytest.mark.interpreted
def test_the_tape_and_the_arrays_are_one_problem():
    problem, y = GENERAL.problem, SPINS.ravel()
    tape = problem._values(problem.system.rhs, y, 0.0)
    np.testing.assert_allclose(problem.rhs(y), tape, atol=1e-15)
    slope = [(problem.energy(y + 1e-6 * e) - problem.energy(y - 1e-6 * e)) / 2e-6 for e in np.eye(12)]
    np.testing.assert_allclose(problem.poisson(y) @ slope, problem.rhs(y), atol=1e-9)
    assert MAGNETS["central32"].magnet.problem.offers == {"spins"}


@pytest.mark.interpreted
@pytest.mark.parametrize("method", TOLERANT)
def test_tolerances_are_relative_to_the_spins(method):
    """A magnet with small spins moves slowly, and otherwise in the same way."""
    size = 1e-100
    field, spins = replace(MAGNET, alpha=size * MAGNET.alpha), size * SPINS
    end = integrate(field, spins, h=0.5 / size, steps=4, method=method).y[-1] / size
    assert np.max(np.abs(end - integrate(MAGNET, SPINS, h=2.0, steps=1, method="backlund").y[-1])) < 1e-12


@pytest.mark.interpreted
@pytest.mark.parametrize("method", IN_ARRAYS)
def test_only_differences_of_sites_count(method):
    magnet, spins = random_magnet(5, 1)
    sites = [round(1024 * a) / 1024 for a in magnet.sites]
    options = {"factors": 2} if method == "backlund_paper" else {}
    here, *there = (
        integrate(replace(magnet, sites=tuple(a + far for a in sites)), spins, 0.125, 16, method, **options)
        for far in (0.0, -(2.0**30), 2.0**40)
    )
    for run in there:
        assert np.max(np.abs(run.y - here.y)) < 1e-12
        assert np.max(np.abs(run.invariants() - here.invariants())) < 1e-12


@pytest.mark.interpreted
@pytest.mark.parametrize("flow", [{"site": 2}, {"hamiltonian": (0.3, -0.2, 1.0, 0.5)}], ids=str)
def test_groups_of_sites_far_apart(flow):
    pytest.importorskip("heyoka")
    magnet = GaudinMagnet((-5e7, 1e8, 1e8 + 0.5, 1e8 + 2), 0.7, **flow)
    for h in (1.0, -5.0):
        exact, truth = (integrate(magnet, SPINS, h, 1, method).y[-1] for method in ("backlund", "taylor"))
        assert np.max(np.abs(exact - truth)) < 1e-13


@pytest.mark.parametrize(("method", "steps"), [("taylor", 1), ("implicit_midpoint", 10**9)])
def test_control_c_ends_a_long_run(method, steps):
    if method not in TAKEN:
        pytest.skip(f"{method} is not installed here")
    magnet, spins = MAGNETS["central32"]
    stepper, y = prepare(magnet, spins, 1e8 if method == "taylor" else 0.1, method), spins.ravel()
    stepper.advance(y, 0 if method == "taylor" else 1)
    with interrupted():
        stepper.record(y, steps, max(1, steps // 4))
