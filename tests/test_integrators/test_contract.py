"""Every method in the registry keeps what its record claims; and what is particular to one of them."""

import copy
import inspect
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, metrics
from lagrange_bench.integrators import (
    METHODS,
    PERTURBED_TOPS,
    TOPS,
    LagrangeTop,
    StepError,
    available,
    integrate,
    methods,
    prepare,
)
from lagrange_bench.integrators.interface import Work
from lagrange_bench.integrators.methods import implicit_midpoint, taylor
from lagrange_bench.integrators.registry import BUILT_IN
from lagrange_bench.integrators.truth import exact
from tests.installed import FOR_TOPS, in_uniform_fields, installed

GENERIC = TOPS["generic"]
EPS = np.finfo(float).eps


# ---------------------------------------------------------------- all of them


@pytest.mark.parametrize("name", METHODS)
def test_claims(name):
    verdicts = check.check(installed(name))
    failed = [f"{v.claim}: {v.measured} {v.bound} ({v.how})" for v in verdicts if v.passed is False]
    assert not failed
    assert sum(v.passed is True for v in verdicts) >= 8
    assert not any(v.claim.startswith("takes") for v in verdicts), "a moderate step was not taken"


def ends():
    """The bits of the state after four steps of each method, in the uniform field and in two others."""
    found, fields = {}, {name: PERTURBED_TOPS[name] for name in ("weak_tide", "magnet")}
    for label, named in {"uniform": GENERIC, **fields}.items():
        h = 0.05 * named.top.scales(named.state)[2]
        for name, record in METHODS.items():
            if available(record) and record.takes(named.top) is None:
                found[f"{name} {label}"] = integrate(named.top, named.state, h, 4, name).y[-1].tobytes().hex()
    return found


@pytest.mark.processes
def test_without_compilation_each_method_has_the_same_bits():
    """Numba rearranges nothing; and no kernel leaves its arrays, for NumPy would refuse it."""
    done = subprocess.run(
        [sys.executable, "-c", "import json, test_contract; print(json.dumps(test_contract.ends()))"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[2])},
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    interpreted = json.loads(done.stdout)
    assert len(interpreted) > 90
    assert interpreted == ends()


def test_every_file_of_methods_is_registered():
    files = {path.stem for path in Path(methods.__file__).parent.glob("*.py")} - {
        "__init__",
        "backlund_choice",
        "backlund_schemes",
        "dense",
        "gauss_coefficients",
        "gauss_in_field",
        "tableaux",
    }  # what several of them use
    known = {entry.value.partition(":")[0].rpartition(".")[2] for entry in METHODS._entries.values()}
    assert files <= known


def test_a_reason_for_a_uniform_field_only_is_given_where_it_is_so():
    """And only there: a splitting of the force alone does not answer with the reason of the processed one."""
    assert {name for name in BUILT_IN if METHODS[name].uniform_only} == {
        name for name in BUILT_IN if METHODS[name].needs == "uniform"
    }


@pytest.mark.parametrize("name", METHODS)
def test_options_are_keywords_with_defaults(name):
    """So that every method runs without any, and `evaluate` takes none that `prepare` does not know."""
    record = installed(name)
    parameters = inspect.signature(record.prepare).parameters
    assert all(parameters[option].default is not inspect.Parameter.empty for option in record.options)


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_output_times(name):
    record = installed(name)
    if record.evaluate is None:
        with pytest.raises(ValueError, match=r"^t: "):
            integrate(GENERIC.top, GENERIC.state, t=[1.0], method=name)
        return
    t = np.array([3.0, -2.0, 0.0, 3.0, 60.0, -50.0, 1e-3])
    run = integrate(GENERIC.top, GENERIC.state, t=t, method=name)
    error = metrics.scaled_error(GENERIC.top, GENERIC.state, run.y, exact.solution(GENERIC.top, GENERIC.state, t))
    assert np.max(error) < 1e-6  # RK45 at its default rtol 1e-9; the others are at round-off
    assert np.array_equal(run.y[2], GENERIC.state)
    assert np.array_equal(run.y[0], run.y[3])
    assert integrate(GENERIC.top, GENERIC.state, t=[], method=name).y.shape == (0, 6)


@pytest.mark.parametrize(
    "name", ["taylor", "taylor_accurate", "taylor_compact", "dop853", "rk45", "scipy_dop853", "lsoda", "radau"]
)
def test_dense_output_is_the_same_at_any_times_and_on_a_grid(name):
    record = installed(name)
    grid = prepare(GENERIC.top, GENERIC.state, -0.3, name).record(GENERIC.state, 100, 5)
    times = -0.3 * np.arange(0, 101, 5.0)
    assert np.array_equal(record.evaluate(GENERIC.top, GENERIC.state, times)[0], grid)


# ---------------------------------------------------------------- Taylor


@pytest.mark.parametrize("order", [1, 4, 8, 12, 16])
def test_taylor_has_the_order_asked_for(order):
    build = partial(taylor.prepare_fixed, order=order)
    record = in_uniform_fields(METHODS["taylor_fixed"], order=order, prepare=build)
    (verdict,) = check.order(record, quick=False)
    assert verdict.passed, verdict


def test_taylor_step_is_the_step_of_heyoka():
    """The polynomial of heyoka's own step, evaluated at h. Both sum 20 terms: a few ulp."""
    hy = pytest.importorskip("heyoka")
    ta = copy.deepcopy(taylor.compile_integrator(EPS, False))
    for top, y0 in ((GENERIC.top, GENERIC.state), (TOPS["figure1"].top, TOPS["figure1"].state)):
        h = 0.5 * top.scales(y0)[2]
        ta.time, ta.state[:], ta.pars[0] = 0.0, y0, top.alpha
        outcome, _ = ta.step(write_tc=True)
        assert outcome == hy.taylor_outcome.success
        y = prepare(top, y0, h, "taylor_fixed").advance(y0, 1)
        assert metrics.scaled_error(top, y0, y, ta.update_d_output(h)) < 4 * EPS


def test_taylor_uses_heyoka_as_it_is():
    """The bits of one call of propagate_until, the order heyoka chose, and its steps."""
    installed("taylor")
    ta = copy.deepcopy(taylor.compile_integrator(EPS, False))
    assert ta.order == METHODS["taylor"].order
    ta.time, ta.state[:], ta.pars[0] = 0.0, GENERIC.state, GENERIC.alpha
    steps = ta.propagate_until(500 * 0.1)[3]
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "taylor")
    assert np.array_equal(stepper.advance(GENERIC.state, 500), ta.state)
    assert stepper.work == Work(steps=steps, rhs_evals=20 * steps, setup_seconds=stepper.work.setup_seconds)


def test_taylor_in_pieces_changes_no_bit(monkeypatch):
    installed("taylor")
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "taylor")
    end, rows, steps = stepper.advance(GENERIC.state, 900), stepper.record(GENERIC.state, 900, 30), stepper.work.steps
    monkeypatch.setattr(taylor, "INTERRUPTIBLE", 7)
    assert np.array_equal(stepper.advance(GENERIC.state, 900), end)
    assert np.array_equal(stepper.record(GENERIC.state, 900, 30), rows)
    assert np.array_equal(end, rows[-1])
    assert stepper.work.steps == 2 * steps


@pytest.mark.parametrize("tol", [1e-6, 1e-10, 1.0])
def test_taylor_meets_its_tolerance(tol):
    """Per step; over t = 20, some 90 steps, an error grows like t²."""
    installed("taylor")
    y = prepare(GENERIC.top, GENERIC.state, 20.0, "taylor", tol=tol).advance(GENERIC.state, 1)
    error = metrics.scaled_error(GENERIC.top, GENERIC.state, y, exact.solution(GENERIC.top, GENERIC.state, [20.0])[0])
    assert error < 100 * tol
    high = prepare(GENERIC.top, GENERIC.state, 20.0, "taylor", high_accuracy=True).advance(GENERIC.state, 1)
    assert (
        metrics.scaled_error(GENERIC.top, GENERIC.state, high, exact.solution(GENERIC.top, GENERIC.state, [20.0])[0])
        < 1e-14
    )


def test_taylor_says_what_heyoka_says():
    installed("taylor")
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "taylor")
    for call in (lambda y: stepper.advance(y, 1), lambda y: stepper.record(y, 4, 1)):
        with pytest.raises(StepError, match=r"taylor at h = 0\.1, step 0: heyoka: err_nf_state"):
            call(np.full(6, np.nan))
    assert np.all(np.isfinite(stepper.advance(GENERIC.state, 1)))  # and is none the worse for it


@pytest.mark.parametrize(
    ("name", "high_accuracy", "compact_mode"), [("taylor_accurate", True, False), ("taylor_compact", False, True)]
)
def test_taylor_variants_are_heyokas_switches(name, high_accuracy, compact_mode):
    """The bits of heyoka with that switch, which are not those of `taylor`; both name themselves."""
    record = installed(name)
    ta = copy.deepcopy(taylor.compile_integrator(EPS, high_accuracy, compact_mode))
    assert (ta.high_accuracy, ta.compact_mode) == (high_accuracy, compact_mode)
    ta.time, ta.state[:], ta.pars[0] = 0.0, GENERIC.state, GENERIC.alpha
    ta.propagate_until(500 * 0.1)
    y = prepare(GENERIC.top, GENERIC.state, 0.1, name).advance(GENERIC.state, 500)
    assert np.array_equal(y, ta.state)
    assert not np.array_equal(y, prepare(GENERIC.top, GENERIC.state, 0.1, "taylor").advance(GENERIC.state, 500))
    assert record.options == ("tol",)
    with pytest.raises(StepError, match=f"^{name} at"):
        prepare(GENERIC.top, GENERIC.state, 0.1, name).advance(np.full(6, np.nan), 1)
    with pytest.raises(ValueError, match="tol"):
        prepare(GENERIC.top, GENERIC.state, 0.1, name, tol=0.0)


def many_tops(n):
    draw = np.random.default_rng(n)
    return draw.normal(size=n), draw.normal(size=(n, 6))


def batches(alphas, Y0, times, width=4, tol=taylor.EPS):
    width = width or taylor.recommended_width()
    return taylor._batches(None, alphas[:, None], Y0, np.array(times, dtype=float), tol, width)


@pytest.mark.parametrize(("n", "width"), [(1, 4), (4, 4), (11, 4), (3, 1), (5, None)])
@pytest.mark.parametrize("times", [[7.0], [0.0, 0.5, 2.0, 7.0], [-0.5, -7.0], [0.0], []])
def test_taylor_batch_is_each_top_for_itself(n, width, times):
    """Each with its own alpha; n need not be a multiple of the width. Other code than one top's: round-off."""
    installed("taylor")
    alphas, Y0 = many_tops(n)
    states = batches(alphas, Y0, times, width)
    assert states.shape == (len(times), n, 6)
    for i in range(n):
        top = LagrangeTop(alphas[i])
        alone = METHODS["taylor"].evaluate(top, Y0[i], np.array(times, dtype=float))[0]
        if times:
            assert np.max(metrics.scaled_error(top, Y0[i], states[:, i], alone)) < 2e-14
        if times and times[0] == 0.0:
            assert np.array_equal(states[0, i], Y0[i])


def test_taylor_batch_in_pieces_changes_no_bit(monkeypatch):
    installed("taylor")
    alphas, Y0 = many_tops(6)
    whole = [batches(alphas, Y0, t) for t in ([30.0], [10.0, 20.0, 30.0])]
    monkeypatch.setattr(taylor, "INTERRUPTIBLE", 7)
    for states, t in zip(whole, ([30.0], [10.0, 20.0, 30.0]), strict=True):
        assert np.array_equal(batches(alphas, Y0, t), states)


def test_taylor_batch_meets_its_tolerance_and_its_own_alpha():
    """Negative control: with the alphas the other way round the states are others."""
    installed("taylor")
    alphas, Y0 = many_tops(5)
    loose = batches(alphas, Y0, [20.0], tol=1e-6)
    tight, other = (batches(a, Y0, [20.0]) for a in (alphas, alphas[::-1]))
    for i, alpha in enumerate(alphas):
        top = LagrangeTop(alpha)
        truth = exact.solution(top, Y0[i], [20.0])[0]
        assert metrics.scaled_error(top, Y0[i], tight[0, i], truth) < 1e-12
        assert 1e-10 < metrics.scaled_error(top, Y0[i], loose[0, i], truth) < 1e-3
        assert i == 2 or metrics.scaled_error(top, Y0[i], other[0, i], truth) > 1e-3


def test_taylor_batch_says_which_top_failed():
    installed("taylor")
    alphas, Y0 = many_tops(6)
    Y0[5] *= 1e200  # its series overflows
    for times in ([1.0], [0.5, 1.0]):
        with pytest.raises(StepError, match=r"taylor.*heyoka: err_nf_state, top 5 of the batch"):
            batches(alphas, Y0, times)


# ---------------------------------------------------------------- implicit midpoint


def residual(top, y, z, h):
    """Of the midpoint equation, in scaled units."""
    unit = np.repeat(top.scales(y)[:2], 3)
    return np.max(np.abs((z - y - h * top.rhs((y + z) / 2)) / unit))


@pytest.mark.parametrize("contraction", [1e-4, 0.1, 0.9, 3.0, 10.0, 100.0])
def test_midpoint_solves_its_equation_or_says_why_not(contraction):
    """To round-off, a few ulp times the length of the step; random tops, all three solvers where they apply."""
    draw = np.random.default_rng(7)
    refused = []
    for _ in range(100):
        y = draw.normal(size=6) * draw.choice([0.1, 1.0, 10.0])
        top = LagrangeTop(draw.normal())
        h = 2 * np.sqrt(contraction / abs(top.alpha) / np.linalg.norm(y[3:]))
        solvers = ("auto", "newton", "fixed_point") if contraction < 0.5 else ("auto", "newton")
        for solver in solvers:
            try:
                z = prepare(top, y, h, "implicit_midpoint", solver=solver).advance(y, 1)
            except StepError as error:
                refused.append(error.reason)
                continue
            assert residual(top, y, z, h) < 16 * EPS * (1 + h * top.scales(y)[0]) ** 2
    assert all("three solutions" in reason for reason in refused)
    if contraction < 1:  # there the step is unique: no excuse
        assert not refused


def test_midpoint_raises_where_the_fixed_point_does_not_converge():
    """With step, residual and h in the message. At h = 30 the map does not contract and runs in a cycle."""
    stepper = prepare(GENERIC.top, GENERIC.state, 30.0, "implicit_midpoint", solver="fixed_point")
    with pytest.raises(
        StepError, match=r"implicit_midpoint at h = 30, step \d+: .*500 iterations.*residual \d"
    ) as caught:
        stepper.advance(GENERIC.state, 1000)
    assert caught.value.step is not None
    with pytest.raises(StepError, match="time scale"):
        prepare(GENERIC.top, GENERIC.state, 1e9, "implicit_midpoint")


def test_midpoint_cubic_is_the_midpoint_equation():
    """The guess alone solves the step, to half the digits at least: the polish only rounds."""
    h = 1.5
    c = np.array((GENERIC.alpha, h, 1.0))
    tally = np.zeros(5)
    v1, v2 = implicit_midpoint.cubic_guess(tuple(GENERIC.state), c, tally)
    x = GENERIC.state[3:]
    d = implicit_midpoint.cayley.py_func(*x, v1, v2, 0.5 * h * GENERIC.state[2])[3:6]
    J = GENERIC.state[:3] + 0.5 * h * GENERIC.alpha * np.array((-(x[1] + d[1]), x[0] + d[0], 0.0))
    assert abs(v1 - 0.5 * h * J[0]) + abs(v2 - 0.5 * h * J[1]) < 1e-14


def test_midpoint_counts_iterations():
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "implicit_midpoint")
    stepper.advance(GENERIC.state, 1000)
    assert 4 <= stepper.work.iterations / 1000 <= 8


@pytest.mark.parametrize("top", [GENERIC.top, PERTURBED_TOPS["weak_tide"].top], ids=["alone", "in-a-field"])
@pytest.mark.parametrize("name", ["implicit_midpoint", "collective_midpoint"])
def test_midpoint_takes_one_right_hand_side_in_each_iteration(name, top):
    stepper = prepare(top, GENERIC.state, 0.1, name)
    stepper.advance(GENERIC.state, 10)
    assert stepper.work.rhs_evals == stepper.work.iterations > 10
