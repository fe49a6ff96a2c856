"""The methods that choose their steps, and projected Verner, for a top in any potential."""

import math
import threading

import numpy as np
import pytest
import scipy.integrate

from lagrange_bench.integrators import (
    METHODS,
    POTENTIALS,
    TOPS,
    LagrangeTop,
    StepError,
    available,
    exact,
    integrate,
    prepare,
)
from lagrange_bench.integrators.methods import taylor
from lagrange_bench.integrators.methods.scipy_ivp import functions_of
from lagrange_bench.integrators.problem.perturbed import PerturbedTop, Potential
from lagrange_bench.integrators.problem.potentials import CHARGE, TIDE
from lagrange_bench.integrators.truth import reference

FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "quadratic": PerturbedTop(LagrangeTop(1.0), TIDE, (0.7, 1.0, 0.0, 0.0)),
    "charge": PerturbedTop(LagrangeTop(0.8), CHARGE, (0.9, 2.0, 1.0, 0.5)),
    "axial": PerturbedTop(LagrangeTop(1.0), CHARGE, (0.4, 0.0, 0.0, 1.6)),
}
NOTHING = PerturbedTop(LagrangeTop(1.0), CHARGE, (0.0, 0.0, 0.0, 1.6))
Y0 = TOPS["generic"].state
# what is asked for, the step, and the error after t = 5 in units of the state that it leads to at most
SETTINGS = {
    "dop853": ({"rtol": 1e-12, "atol": 1e-14}, 2e-11),
    "rk45": ({"rtol": 1e-9, "atol": 1e-11}, 5e-8),
    "scipy_dop853": ({"rtol": 1e-12, "atol": 1e-14}, 2e-11),
    "lsoda": ({"rtol": 1e-11, "atol": 1e-13}, 2e-8),
    "radau": ({"rtol": 1e-8, "atol": 1e-10}, 2e-7),
    "taylor": ({}, 2e-14),
    "taylor_accurate": ({}, 2e-14),
    "taylor_compact": ({}, 2e-14),
    "verner9_projected": ({}, 1e-12),
}
NAMES = [pytest.param(n, marks=pytest.mark.skipif(not available(METHODS[n]), reason="not installed")) for n in SETTINGS]
needs_heyoka = pytest.mark.skipif(not available(METHODS["taylor"]), reason="heyoka is not installed")


def truth(problem, times, y=Y0):
    """SciPy's DOP853 at rtol 3e-14, on the right-hand side of the problem itself."""
    ends = []
    for t in times:
        run = scipy.integrate.solve_ivp(lambda t, y: problem.rhs(y), (0, t), y, "DOP853", rtol=3e-14, atol=1e-16)
        ends.append(run.y[:, -1])
    return np.array(ends)


def error(problem, y, exact):
    rate, size, _ = problem.scales(Y0)
    return np.max(np.abs(y - exact) / np.repeat((rate, size), 3))


TIMES = (5.0, -2.5)
EXACT = {name: truth(problem, TIMES) for name, problem in FIELDS.items()}


@pytest.mark.parametrize("field", ["quadratic", "charge"])
@pytest.mark.parametrize("name", NAMES)
def test_error(name, field):
    """On a grid and at any times, forwards and backwards; far from the motion without the potential."""
    options, most = SETTINGS[name]
    problem = FIELDS[field]
    for t, right in zip(TIMES, EXACT[field], strict=True):
        h = math.copysign(0.05, t)
        end = prepare(problem, Y0, h, name, **options).advance(Y0, round(t / h))
        assert error(problem, end, right) <= most
        assert error(problem, end, exact.solution(LagrangeTop(problem.alpha), Y0, t)) > 1e-3
    if name != "verner9_projected":
        run = integrate(problem, Y0, t=[*TIMES, 0.0], method=name, **options)
        assert np.array_equal(run.y[2], Y0)
        assert run.work.steps > 0
        assert all(error(problem, y, right) <= most for y, right in zip(run.y[:2], EXACT[field], strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_without_a_potential_it_is_the_method_for_uniform_fields(name):
    options, _ = SETTINGS[name]
    one = prepare(NOTHING, Y0, 0.05, name, **options)
    other = prepare(LagrangeTop(1.0), Y0, 0.05, name, **options)
    # the first step of dop853 takes account of J3 in a potential: its steps are not quite the same
    most = 1e-11 if name == "dop853" else 1e-12 if name == "radau" else 1e-14
    assert error(NOTHING, one.advance(Y0, 20), other.advance(Y0, 20)) <= most
    assert abs(one.work.steps - other.work.steps) <= 1


@pytest.mark.parametrize("name", NAMES)
def test_what_is_claimed_is_kept_and_only_that(name):
    """`kept` at round-off, at a step or tolerance where the error itself is far larger; J3 about the axis of a field."""
    method, problem = METHODS[name], FIELDS["axial"]
    options = {} if method.control == "step" else {method.knob: 1e-4}
    rows = prepare(problem, Y0, 0.3, name, **options).record(Y0, 300, 3)
    drift = np.max(np.abs(problem.invariants(rows) - problem.invariants(Y0)), axis=0) / problem.invariant_scales(Y0)
    kept = method.kept(problem)
    assert "J3" in kept
    assert "J3" not in method.kept(FIELDS["charge"])
    for invariant, d in zip(("H", "J3", "C1", "C2"), drift, strict=True):
        if invariant in kept:
            assert d <= (0.0 if invariant == "J3" else 4e-15), invariant
        else:
            assert d > 1e-9, invariant


@pytest.mark.parametrize("name", ["verner9_projected", "radau", "lsoda"])
def test_units_do_not_matter(name):
    """Powers of two: J by 2^a, x by 2^b, V by 2^2a; the same bits where steps are made in units of order one."""
    rate, length = 2.0**30, 2.0**-20
    scaled = Potential("scaled", lambda x1, x2, x3, p: p[0] * x1 * x1 / 2 + p[1] * x1 * x2 * x3)
    y = Y0 * np.repeat((rate, length), 3)
    small = PerturbedTop(LagrangeTop(1.0), scaled, (0.7, 0.2))
    large = PerturbedTop(LagrangeTop(rate**2 / length), scaled, (0.7 * rate**2 / length**2, 0.2 * rate**2 / length**3))
    options = {} if name == "verner9_projected" else {"rtol": 1e-6, "atol": 0.0}
    got = prepare(large, y, 0.1 / rate, name, **options).advance(y, 50) / np.repeat((rate, length), 3)
    assert np.array_equal(got, prepare(small, Y0, 0.1, name, **options).advance(Y0, 50))


@pytest.mark.parametrize("name", NAMES)
def test_into_a_singularity(name):
    """A charge that attracts, and stands where the axis goes: an end with a StepError, not a number."""
    problem = PerturbedTop(LagrangeTop(0.0), Potential("pole", lambda x1, x2, x3, p: -p[0] / (1 - x3) ** 2), (1.0,))
    y = np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    with pytest.raises(StepError):
        prepare(problem, y, 0.05, name).advance(y, 400)
    with pytest.raises(ValueError, match="the potential pole is not finite"):
        prepare(problem, np.array((0.0, 0.0, 1.0, 0.0, 0.0, 1.0)), 0.05, name)


@pytest.mark.parametrize("spin", [0.3, 0.0])
def test_lsoda_does_not_step_over_a_pole(spin):
    """Its steps do not see this one: the energy does."""
    pole = PerturbedTop(LagrangeTop(0.0), POTENTIALS["charge"], (1.0, 1.0, 0.0, 0.0))
    with pytest.raises(StepError, match=r"lsoda: .* its energy is off"):
        integrate(pole, (0.0, spin, 0.0, 0.6, 0.0, 0.8), t=[5.0], method="lsoda")


@needs_heyoka
@pytest.mark.parametrize("name", ["taylor", "taylor_accurate", "taylor_compact"])
@pytest.mark.parametrize("power", [-300, -31, 300])
def test_taylor_in_any_units_of_time(name, power):
    """Twentieth powers of |J| are beyond the range of doubles here."""
    rate, named = 2.0**power, TOPS["generic"]
    scale, times = np.repeat((rate, 1.0), 3), np.array((20.0, -7.0)) / rate
    top, y = LagrangeTop(named.alpha * rate**2), named.state * scale
    assert np.max(np.abs(integrate(top, y, t=times, method=name).y - exact.solution(top, y, times)) / scale) < 1e-13
    tide = PerturbedTop(top, POTENTIALS["tide"], (0.1 * rate**2, 1.0, 0.0, 0.0))
    usual = PerturbedTop(named.top, POTENTIALS["tide"], (0.1, 1.0, 0.0, 0.0))
    same = integrate(usual, named.state, t=times * rate, method=name).y
    assert np.max(np.abs(integrate(tide, y, t=times, method=name).y / scale - same)) < 1e-13


@needs_heyoka
def test_heyoka_compiles_once_for_each_formula(monkeypatch):
    monkeypatch.setattr(taylor, "_here", threading.local())
    taylor.compile_integrator.cache_clear()
    for number in (0.3, 0.4, 0.5):
        for alpha in (1.0, 2.0):
            problem = PerturbedTop(LagrangeTop(alpha), TIDE, (number, 1.0, 0.0, 0.0))
            end = prepare(problem, Y0, 0.5, "taylor").advance(Y0, 2)
            assert error(problem, end, truth(problem, [1.0])[0]) <= 2e-14
    assert taylor.compile_integrator.cache_info().misses == 1
    prepare(FIELDS["axial"], Y0, 0.5, "taylor")
    assert taylor.compile_integrator.cache_info().misses == 2


@needs_heyoka
def test_parameters_that_the_force_does_not_contain():
    """heyoka has no place for the last ones."""
    idle = Potential("idle", lambda x1, x2, x3, p: p[1] + p[0] * x1 * x1 / 2 + p[2] * 0.0)
    problem = PerturbedTop(LagrangeTop(1.0), idle, (0.7, 5.0, 6.0))
    same = prepare(FIELDS["quadratic"], Y0, 0.5, "taylor").advance(Y0, 10)
    assert np.array_equal(prepare(problem, Y0, 0.5, "taylor").advance(Y0, 10), same)


@needs_heyoka
def test_threads_do_not_share_numbers():
    """Two potentials of one formula, in two threads at once: each has the bits of a run alone."""
    problems = [PerturbedTop(LagrangeTop(1.0), TIDE, (number, 1.0, 0.0, 0.0)) for number in (0.2, 0.9)]
    steppers = [prepare(problem, Y0, 0.1, "taylor") for problem in problems]
    alone = [stepper.advance(Y0, 3000) for stepper in steppers]
    got = [[], []]

    def work(i):
        got[i] = [steppers[i].advance(Y0, 3000) for _ in range(20)]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(2):
        assert all(np.array_equal(y, alone[i]) for y in got[i])
    assert not np.array_equal(*alone)


def test_the_jacobians_are_those_of_the_problem():
    for problem in FIELDS.values():
        f, c, jacobian = functions_of(problem)
        assert np.max(np.abs(f(c, 0.0, Y0) - problem.rhs(Y0))) <= 1e-15
        assert np.max(np.abs(jacobian(c, 0.0, Y0) - problem.jacobian(Y0))) <= 1e-15
        assert not np.array_equal(jacobian(c, 0.0, Y0), jacobian(c, 0.0, Y0 + 1e-6))


def test_taylor_fixed_reads_its_recurrences_off_the_formula():
    """One step is as good in a field as in none, to round-off; of a low order it is not."""
    for problem in FIELDS.values():
        if METHODS["taylor_fixed"].takes(problem) is None:
            truth = reference.solution(problem, Y0, [0.0625]).states[0]
            assert np.max(np.abs(prepare(problem, Y0, 0.0625, "taylor_fixed").advance(Y0, 1) - truth)) < 1e-15 * 8
            assert np.max(np.abs(prepare(problem, Y0, 0.0625, "taylor_fixed", order=2).advance(Y0, 1) - truth)) > 1e-7
