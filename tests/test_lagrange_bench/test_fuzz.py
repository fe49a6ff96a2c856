"""Any top, any step, any option: every method returns a result within its claim, or says by name why it does not.

A call may return finite states that keep what the method's record claims. Or it raises a ValueError that begins with the
name of the argument, or a StepError with method, h and reason. No other exception, no NaN, no warning, no hang.

FUZZ_EXAMPLES=2000 in the environment takes so many random examples for every method in place of some fixed ones.
"""

import os
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lagrange_bench.integrators import (
    METHODS,
    TOPS,
    LagrangeTop,
    StepError,
    available,
    integrate,
    integrate_ensemble,
    prepare,
    two_point,
)
from lagrange_bench.integrators.checks import keyword_options
from lagrange_bench.integrators.methods import backlund
from tests.fuzzing import (
    COMPILED,
    EPS,
    GOOD,
    JUNK,
    LONGEST,
    PLACES,
    REPORT,
    TINY,
    ULPS,
    attempt,
    cases,
    examples,
    judge,
    ldexp,
    options,
    run,
    sensible,
    those,
    tops,
)
from tests.installed import FOR_TOPS, in_uniform_fields, installed


@pytest.fixture(scope="module", autouse=True)
def watchdog(request):
    """Where a process that hangs says so: the standard error that pytest hides."""
    capture = request.config.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():
        REPORT["file"] = os.fdopen(os.dup(2), "w")
    yield
    REPORT.pop("file").close()


def test_every_option_is_tried():
    names = {option for name in FOR_TOPS if available(METHODS[name]) for option in METHODS[name].options}
    assert names <= set(GOOD), "say here what values these options take"


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_top(name):
    record = installed(name)
    results = Counter()

    @examples(24)
    @given(cases(LONGEST[record.control], absolute=record.control == "step"), PLACES, options(record.options))
    def one(case, places, chosen):
        alpha, y0, h = case
        n, every = places
        chosen = sensible(record, y0, chosen)
        made = attempt(name, run, name, alpha, y0, h, n, every, chosen, h=h, arguments=chosen)
        results[made is not None] += 1
        if made is not None:
            assert made.y.shape == (n // every + 1, 6)
            assert min(made.work.steps, made.work.rhs_evals, made.work.iterations, made.work.rejected) >= 0
            judge(record, alpha, y0, h, made.y, every, chosen)

    one()
    assert results[True] > results[False] / 3, "hardly anything was judged"


@pytest.mark.parametrize("name", those(lambda record: record.evaluate is not None))
def test_any_times(name):
    record = installed(name)
    longest = LONGEST[record.control]

    @examples(12)
    @given(cases(longest, absolute=False), st.lists(st.floats(-1, 1), max_size=6), options(record.options))
    def one(case, times, chosen):
        alpha, y0, h = case
        chosen = sensible(record, y0, {k: v for k, v in chosen.items() if k in keyword_options(record.evaluate)})
        times = [h * t for t in times]
        made = attempt(
            name, integrate, LagrangeTop(alpha), y0, t=times, method=name, h=[None, *times], arguments=chosen, **chosen
        )
        if made is not None:
            assert made.y.shape == (len(times), 6)
            for t, y in zip(times, made.y, strict=True):
                if t != 0.0:
                    judge(record, alpha, y0, t, np.array((y0, y)), 1, chosen)
                else:
                    assert np.array_equal(y, y0)

    one()


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_stepper(name):
    """`advance` goes where `record` does; a stepper takes any state, or says why not, and changes neither."""
    record = installed(name)

    @examples(12)
    @given(cases(LONGEST[record.control], absolute=False), tops(20, 1070), PLACES, options(record.options))
    def one(case, other, places, chosen):
        alpha, y0, h = case
        z0 = np.array(other[1])
        n, every = places
        chosen = sensible(record, (*y0, *(z0 if record.control == "tolerance" else ())), chosen)
        stepper = attempt(name, prepare, LagrangeTop(alpha), y0, h, name, h=h, arguments=chosen, **chosen)
        if stepper is None:
            return
        y = np.array(y0)
        end = attempt(name, stepper.advance, y, n, h=h)
        rows = attempt(name, stepper.record, y, n, every, h=h)
        assert y.tobytes() == np.array(y0).tobytes()
        if rows is not None and record.control == "step":
            assert end.tobytes() == rows[-1].tobytes()
        if record.control == "step":  # the other top may be so much quicker that its run is long
            strange = attempt(name, stepper.record, z0, n, every, h=h)
            assert z0.tobytes() == np.array(other[1]).tobytes()
            assert strange is None or np.all(np.isfinite(strange))

    one()


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_option(name):
    """Whatever an option is set to: a result, or a ValueError that begins with its name."""
    record = installed(name)
    top, y0 = TOPS["generic"].top, TOPS["generic"].state
    for option in record.options:
        for value in JUNK:
            made = attempt(name, integrate, top, y0, 0.1, 3, name, arguments=(option,), h=0.1, **{option: value})
            assert made is None or np.all(np.isfinite(made.y))
            if record.evaluate is not None and option in keyword_options(record.evaluate):
                attempt(
                    name,
                    integrate,
                    top,
                    y0,
                    t=[0.1],
                    method=name,
                    h=[None, 0.1],
                    arguments=(option,),
                    **{option: value},
                )
            if record.attitude is not None:
                attempt(
                    name, integrate, top, y0, 0.1, 3, name, attitude=True, arguments=(option,), h=0.1, **{option: value}
                )


@pytest.mark.parametrize("name", those(lambda record: record.control != "tolerance"))  # of which each has a unit
def test_units(name):
    """J, x, alpha and h in other units, powers of two: the same bits in those units."""
    record = installed(name)

    @examples(8)
    @given(cases(0, (20,), absolute=False), st.integers(-60, 60), st.integers(-60, 60), PLACES, options(record.options))
    def one(case, rate, length, places, chosen):
        alpha, y0, h = case
        n, every = places
        if chosen.get("lam") is not None:
            return
        exponents = [rate] * 3 + [length] * 3
        same = ldexp(alpha, 2 * rate - length), np.ldexp(y0, exponents), ldexp(h, -rate)
        if np.any((np.abs(y0) < 1e-200) & (np.array(y0) != 0.0)):
            return
        here = attempt(name, run, name, alpha, y0, h, n, every, chosen, h=h)
        there = attempt(name, run, name, *same, n, every, chosen, h=same[2])
        assert (here is None) == (there is None)
        if here is not None:
            assert np.array_equal(np.ldexp(here.y, exponents), there.y)

    one()


@examples(100)
@given(tops(20, 300, 1070), GOOD["lam"], st.sampled_from((1, -1)))
def test_any_parameter(case, lam, sheet):
    alpha, y0 = case
    lam = 1j if lam is None else lam
    y = attempt("two_point", two_point, LagrangeTop(alpha), y0, lam, sheet)
    if y is not None:
        judge(METHODS["backlund"], alpha, y0, TINY, np.array((y0, y)), 1, {"lam": lam})


@pytest.mark.parametrize("name", those(lambda record: record.attitude is not None))
def test_any_attitude(name):
    record = installed(name)

    @examples(12)
    @given(cases(6, absolute=False), PLACES, options(record.options))
    def one(case, places, chosen):
        alpha, y0, h = case
        n, every = places
        made = attempt(
            name, integrate, LagrangeTop(alpha), y0, h, n, name, every, attitude=True, h=h, arguments=chosen, **chosen
        )
        if made is not None:
            assert made.attitude.shape == (n // every + 1, 4)
            assert np.all(np.abs(np.linalg.norm(made.attitude, axis=1) - 1) <= ULPS * (n + 1))

    one()


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_ensemble(name, monkeypatch):
    """Each top is what it is alone, to the bit but for heyoka's batches; NaN where alone it fails."""
    monkeypatch.setattr(backlund, "SHORT", 0)  # short runs take λ(h) in plain doubles, see test_ensemble
    record = installed(name)
    longest = LONGEST[record.control]

    @examples(8)
    @given(
        cases(longest, absolute=False),
        st.lists(tops(20, 300, 1070), min_size=1, max_size=5),
        PLACES,
        st.integers(1, 3),
        options(record.options),
    )
    def one(case, others, places, threads, chosen):
        alpha, y0, h = case
        n, every = places
        if record.control == "tolerance":
            others = [(alpha, y0)]
        alphas, Y0 = np.array([alpha, *(a for a, _ in others)]), np.array([y0, *(y for _, y in others)])
        chosen = sensible(record, y0, chosen)
        many = attempt(
            name,
            integrate_ensemble,
            LagrangeTop(alpha=alphas),
            Y0,
            h,
            n,
            name,
            every,
            threads=threads,
            on_failure="nan",
            h=h,
            arguments=chosen,
            **chosen,
        )
        if many is None:
            return
        assert many.shape == (n // every + 1, len(Y0), 6)
        for i, (a, y) in enumerate(zip(alphas, Y0, strict=True)):
            stepper = attempt(name, prepare, LagrangeTop(a), y, h, name, h=h, **chosen)
            alone = attempt(name, stepper.record, y, n, every, h=h) if stepper is not None else None
            if n == 0:
                assert np.array_equal(many[0, i], y)
            elif alone is None:
                assert np.all(np.isnan(many[:, i]))
            elif record.advance_many is not None and record.engine == "heyoka":
                assert np.all(np.isfinite(many[:, i]))
            else:
                assert np.array_equal(alone, many[:, i])

    one()


# ---------------------------------------------------------------- what was found this way


GENERIC = TOPS["generic"]


def test_a_run_that_lost_its_top_ends():
    """atol is 10⁵ times the size of J: the steps grew beyond all measure, |x| with them, and then it took 10¹⁰ steps."""
    y = (5.6e-18, -6.9e-18, 1.1e-17, -4.6e-70, -2.1e-70, 2.8e-70)
    with pytest.raises(StepError, match="rtol and atol do not hold this state"):
        integrate(LagrangeTop(-1.7e35), y, -2.9e17, 40, "dop853", every=10, atol=1e-12)


HUGE = 1.7976931348623157e308
FOUND = {
    "the time n h overflows": (1.0, (0.0, 0.0, 3e-309, 1.0, -0.8, 6.0), 9e307, 2, "kahan"),
    "so does |J|": (0.0, (5e307, 1.4e308, HUGE, 1.2, -0.8, 6.8), 0.03, 1, "gauss4"),
    "and |x|": (7e-308, (2.3, 6.4, 8.0, 5e307, -3.5e307, HUGE), 0.03, 1, "collective_midpoint"),
    "a component of x, as it turns": (2e-308, (2.3, 6.4, 8.0, HUGE, -1.4e308, HUGE), 0.03, 1, "verner9_projected"),
    "its stages, until steps change nothing": (5e-322, (2.3, 6.4, 8.0, HUGE, -HUGE, HUGE), -0.06, 1, "dop853"),
}


@pytest.mark.parametrize("what", FOUND)
def test_beyond_the_largest_double(what):
    alpha, y0, h, n, name = FOUND[what]
    with pytest.raises(StepError, match=f"^{name} at h = "):
        run(name, alpha, y0, h, n, 1, {})


@pytest.mark.parametrize("name", ["kahan", "bobenko_suris", "addition_theorem", "backlund_textbook"])
def test_a_state_beyond_the_units_of_a_stepper(name):
    stepper = prepare(GENERIC.top, 2.0**-40 * GENERIC.state, 0.1, name)
    with pytest.raises(StepError, match=f"^{name} at h = 0.1"):
        stepper.advance(np.array((0.0, 0.0, HUGE, 0.0, 0.0, HUGE)), 1)


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e160, 1e300])
def test_the_axis_of_the_body_whatever_its_length(size):
    y0 = np.array((*GENERIC.state[:3], *(size * GENERIC.state[3:])))
    g = integrate(LagrangeTop(1 / size), y0, 0.1, 10, attitude=True).attitude
    np.testing.assert_allclose(g, integrate(GENERIC.top, GENERIC.state, 0.1, 10, attitude=True).attitude, atol=1e-13)


@pytest.mark.parametrize(
    "attitude", [(1.0, 0.0, 0.0), "up", [[1.0], [1.0, 2.0]], (1j, 0, 0, 0), (1e300, 0, 0, 0), (float("nan"), 0, 0, 0)]
)
def test_attitudes_that_are_none(attitude):
    with pytest.raises(ValueError, match=r"^attitude "):
        integrate(GENERIC.top, GENERIC.state, 0.1, 3, attitude=attitude)


# ---------------------------------------------------------------- and whether it would be found


class Faulty:
    """A stepper of the midpoint rule whose `record` goes wrong in one way."""

    def __init__(self, fault, stepper):
        self.fault, self.stepper, self.work = fault, stepper, stepper.work

    def record(self, y, n, every):
        rows = self.stepper.record(y, n, every)
        self.fault(rows)
        return rows


def fault_nan(rows):
    rows[1, 0] = np.nan


def fault_drift(rows):
    rows[1:, 3:] *= 1 + 2048 * EPS


def fault_start(rows):
    rows[0, 0] = np.nextafter(rows[0, 0], 1)


def fault_warning(rows):
    np.float64(1.0) / np.float64(0.0)


def fault_exception(rows):
    raise ZeroDivisionError


def fault_value_error(rows):
    raise ValueError("something is wrong")


def fault_step_error(rows):
    raise StepError("another", "it does not work", h=0.1)


def fault_slow(rows):
    end = time.thread_time() + COMPILED + 0.1
    while time.thread_time() < end:
        pass


FAULTS = [value for name, value in globals().items() if name.startswith("fault_")]


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_found(fault):
    record = in_uniform_fields(METHODS["implicit_midpoint"])
    h = 0.1

    def faulty(*args, **kwargs):
        return Faulty(fault, record.prepare(*args, **kwargs))

    def look(prepare):
        method = replace(record, prepare=prepare)
        rows = attempt(record.name, run, method, GENERIC.alpha, GENERIC.y0, h, 3, 1, {}, h=h).y
        judge(record, GENERIC.alpha, GENERIC.y0, h, rows, 1, {})

    look(record.prepare)
    with pytest.raises((AssertionError, ArithmeticError, RuntimeWarning)):
        look(faulty)


def test_the_wrong_order_is_found():
    record, h = METHODS["strang"], 1e-3
    rows = run("strang", GENERIC.alpha, GENERIC.y0, h, 3, 1, {}).y
    judge(record, GENERIC.alpha, GENERIC.y0, h, rows, 1, {})
    with pytest.raises(AssertionError, match="solution"):
        judge(replace(record, order=4), GENERIC.alpha, GENERIC.y0, h, rows, 1, {})
