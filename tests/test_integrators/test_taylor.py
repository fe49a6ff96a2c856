"""Methods of Taylor series: the order of the own one, and heyoka used as it is, one top at a time and in batches."""

import copy
from functools import partial

import numpy as np
import pytest

from lagrange_bench import METHODS, POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, Work
from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import integrate, prepare
from lagrange_bench.integrators.methods import taylor, taylor_fixed
from lagrange_bench.integrators.problem.potentials import TIDE
from tests.installed import in_uniform_fields, installed

GENERIC = TOPS["generic"]
TOP, Y0 = GENERIC.top, GENERIC.state
EPS = np.finfo(float).eps


def test_taylor_has_the_order_asked_for():
    record = in_uniform_fields(METHODS["taylor_fixed"], order=8, prepare=partial(taylor_fixed.prepare, order=8))
    (verdict,) = check.order(record, quick=False)
    assert verdict.passed, verdict


@pytest.mark.parametrize("accurate", [False, True])
def test_heyoka_is_used_as_it_is(accurate):
    """The bits of one call of propagate_until, the order heyoka chose, and its steps."""
    record = installed("taylor")
    ta = copy.deepcopy(taylor.compile_integrator(EPS, accurate))
    assert (ta.high_accuracy, ta.compact_mode) == (accurate, False)
    assert ta.order == record.order
    ta.time, ta.state[:], ta.pars[0] = 0.0, Y0, TOP.alpha
    steps = ta.propagate_until(500 * 0.1)[3]
    stepper = prepare(TOP, Y0, 0.1, record, high_accuracy=accurate)
    assert np.array_equal(stepper.advance(Y0, 500), ta.state)
    assert stepper.work == Work(steps=steps, rhs_evals=ta.order * steps, setup_seconds=stepper.work.setup_seconds)
    for call in (lambda y: stepper.advance(y, 1), lambda y: stepper.record(y, 4, 1)):
        with pytest.raises(StepError, match=r"^taylor at h = 0\.1 \(own unit\), step 0: heyoka: err_nf_state"):
            call(np.full(6, np.nan))
    assert np.all(np.isfinite(stepper.advance(Y0, 1)))  # and is none the worse for it


@pytest.mark.parametrize("power", [-31, 300])
def test_taylor_in_any_units_of_time(power):
    """Twentieth powers of |J| are beyond the range of doubles here, or a tolerance relative to J is none of x; in a field too."""
    installed("taylor")
    rate, tide = 2.0**power, POTENTIALS["tide"]
    scale, times = np.repeat((rate, 1.0), 3), np.array((20.0, -7.0)) / rate
    for strength in (0.0, 0.1):
        top = PerturbedTop(LagrangeTop(rate**2), tide, (strength * rate**2, 1.0, 0.0, 0.0))
        usual = PerturbedTop(LagrangeTop(1.0), tide, (strength, 1.0, 0.0, 0.0))
        same = integrate(usual, Y0, t=times * rate, method="taylor").y
        assert np.max(np.abs(integrate(top, Y0 * scale, t=times, method="taylor").y / scale - same)) < 1e-13


def test_numbers_that_the_force_does_not_contain():
    """heyoka has no place for them."""
    installed("taylor")
    idle = Potential("idle", lambda x1, x2, x3, p: p[1] + p[0] * x1 * x1 / 2 + p[2] * 0.0)
    ends = [
        prepare(PerturbedTop(TOP, *field), Y0, 0.5, "taylor").advance(Y0, 2)
        for field in ((TIDE, (0.3, 1.0, 0.0, 0.0)), (idle, (0.3, 5.0, 6.0)))
    ]
    assert np.max(np.abs(ends[1] - ends[0])) < 1e-15
