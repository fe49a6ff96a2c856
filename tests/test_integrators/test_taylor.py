"""Methods of Taylor series: the order of the own one, and heyoka used as it is, one top at a time and in batches."""

import copy
from functools import partial

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, metrics
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, StepError, prepare
from lagrange_bench.integrators.interface import Work
from lagrange_bench.integrators.methods import taylor
from lagrange_bench.integrators.truth import exact
from tests.installed import in_uniform_fields, installed

GENERIC = TOPS["generic"]
EPS = np.finfo(float).eps


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


@pytest.mark.parametrize(
    ("name", "switches"),
    [("taylor", (False, False)), ("taylor_accurate", (True, False)), ("taylor_compact", (False, True))],
)
def test_heyoka_is_used_as_it_is(name, switches):
    """The bits of one call of propagate_until with its switches, the order heyoka chose, and its steps."""
    record = installed(name)
    ta = copy.deepcopy(taylor.compile_integrator(EPS, *switches))
    assert (ta.high_accuracy, ta.compact_mode) == switches
    assert ta.order == record.order
    ta.time, ta.state[:], ta.pars[0] = 0.0, GENERIC.state, GENERIC.alpha
    steps = ta.propagate_until(500 * 0.1)[3]
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, name)
    assert np.array_equal(stepper.advance(GENERIC.state, 500), ta.state)
    assert stepper.work == Work(steps=steps, rhs_evals=ta.order * steps, setup_seconds=stepper.work.setup_seconds)
    for call in (lambda y: stepper.advance(y, 1), lambda y: stepper.record(y, 4, 1)):
        with pytest.raises(StepError, match=rf"^{name} at h = 0\.1, step 0: heyoka: err_nf_state"):
            call(np.full(6, np.nan))
    assert np.all(np.isfinite(stepper.advance(GENERIC.state, 1)))  # and is none the worse for it
    with pytest.raises(ValueError, match="tol"):
        prepare(GENERIC.top, GENERIC.state, 0.1, name, tol=0.0)


def test_the_switches_of_heyoka_make_a_difference():
    installed("taylor")
    names = ("taylor", "taylor_accurate", "taylor_compact")
    ends = {prepare(GENERIC.top, GENERIC.state, 0.1, name).advance(GENERIC.state, 500).tobytes() for name in names}
    assert len(ends) == 3


def test_taylor_in_pieces_changes_no_bit(monkeypatch):
    installed("taylor")
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "taylor")
    alphas, Y0 = many_tops(6)
    grids = ([30.0], [10.0, 20.0, 30.0])
    whole = [batches(alphas, Y0, t) for t in grids]
    end, rows, steps = stepper.advance(GENERIC.state, 900), stepper.record(GENERIC.state, 900, 30), stepper.work.steps
    monkeypatch.setattr(taylor, "INTERRUPTIBLE", 7)
    assert np.array_equal(stepper.advance(GENERIC.state, 900), end)
    assert np.array_equal(stepper.record(GENERIC.state, 900, 30), rows)
    assert np.array_equal(end, rows[-1])
    assert stepper.work.steps == 2 * steps
    assert all(np.array_equal(batches(alphas, Y0, t), states) for t, states in zip(grids, whole, strict=True))


def test_taylor_meets_its_tolerance():
    """Per step; over t = 20, some 90 steps, an error grows like t²."""
    installed("taylor")
    truth = exact.solution(GENERIC.top, GENERIC.state, [20.0])[0]
    for options, bound in (({"tol": 1e-6}, 1e-4), ({"tol": 1e-10}, 1e-8), ({"high_accuracy": True}, 1e-14)):
        y = prepare(GENERIC.top, GENERIC.state, 20.0, "taylor", **options).advance(GENERIC.state, 1)
        assert metrics.scaled_error(GENERIC.top, GENERIC.state, y, truth) < bound


def many_tops(n):
    draw = np.random.default_rng(n)
    return draw.normal(size=n), draw.normal(size=(n, 6))


def batches(alphas, Y0, times, width=4, tol=taylor.EPS):
    width = width or taylor.recommended_width()
    return taylor._batches(None, alphas[:, None], Y0, np.array(times, dtype=float), tol, width)


@pytest.mark.parametrize(
    ("n", "width", "times"),
    [(1, 4, [7.0]), (4, 4, [0.0, 0.5, 2.0, 7.0]), (11, 4, [-0.5, -7.0]), (3, 1, [0.0]), (5, None, [7.0]), (5, 4, [])],
)
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
