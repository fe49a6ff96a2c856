"""Any top, any step, any option: every method returns a result within its claim, or says by name why it does not.

A call may return finite states that keep what the method's record claims. Or it raises a ValueError that begins with the
name of the argument, or a StepError with method, h and reason. No other exception, no NaN, no warning, no hang.

FUZZ_EXAMPLES=2000 in the environment takes so many random examples for every method in place of some fixed ones.
"""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

import faulthandler
import math
import os
import re
import signal
import time
import warnings
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.measuring.metrics import scaled_error
from integrators import (
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
from integrators.checks import keyword_options
from integrators.interface import INVARIANTS
from integrators.methods import backlund, runge_kutta
from integrators.truth import exact
from integrators.truth.orbit import units

EPS = float(np.finfo(float).eps)
TINY = 5e-324
EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))
COMPILED, INTERPRETED = 1.0, 5.0  # seconds of processor time that a call may take
COMPILING = 60.0  # and the first one
HUNG = 300  # seconds after which code that listens to no signal is taken for hung: the process ends and says where


def examples(few):
    """`few` examples, the same in every run; or as many as FUZZ_EXAMPLES says, at random."""
    return settings(
        max_examples=EXAMPLES or few,
        derandomize=not EXAMPLES,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )


def those(have):
    """Names of the methods that have what a test is about."""
    return [name for name, record in METHODS.items() if have(record)]


def method(name):
    if not available(METHODS[name]):
        pytest.skip(f"{METHODS[name].requires} is not installed")
    return METHODS[name]


# ---------------------------------------------------------------- what there is to try

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
SIGN = st.sampled_from((1.0, -1.0))
MANTISSA = st.one_of(st.sampled_from((0.5, 0.75, 1 - 2.0**-53)), st.floats(0.5, 1.0, exclude_max=True))


def power(*widths):
    """Exponents of two: none, or up to one of these widths to either side."""
    return st.one_of(st.just(0), *(st.integers(-width, width) for width in widths))


def ldexp(number, exponent):
    """number · 2^exponent, at most the largest double."""
    try:
        return math.ldexp(number, exponent)
    except OverflowError:
        return math.copysign(1.7976931348623157e308, number)


VECTORS = (
    (0.0, 0.0, 1.0),
    (0.0, 0.0, -1.0),
    (1.0, 0.0, 0.0),
    (0.6, 0.0, -0.8),
    (0.48, 0.6, 0.64),
    (2.0**-30, 0.0, 1.0),
    (2.0**-60, -(2.0**-30), -1.0),
    (0.0, TINY, 1.0),
    (1.0, 2.0**-30, 2.0**-52),
)
UNIT = st.floats(-1.0, 1.0)
VECTOR = st.one_of(st.sampled_from(VECTORS), st.tuples(UNIT, UNIT, UNIT))
NAMED = [(t.alpha, t.y0) for t in TOPS.values()]


def tops(*widths):
    """(alpha, y0), its sizes 2 to the power of some number within the widths; often a special orbit."""
    return drawn_tops(widths).filter(lambda top: any(top[1][3:]))


@st.composite
def drawn_tops(draw, widths):
    if draw(st.booleans()):
        alpha, y0 = draw(st.sampled_from(NAMED))
        J, x = y0[:3], y0[3:]
        kind = draw(st.sampled_from(("as it is", "reversed", "kicked")))
        if kind == "reversed":
            alpha, x = -alpha, tuple(-v for v in x)
        elif kind == "kicked":
            J = (J[0] + ldexp(1.0, -draw(st.integers(1, 60))), *J[1:])
    else:
        J, x, alpha = draw(VECTOR), draw(VECTOR), draw(SIGN) * draw(MANTISSA)
        kind = draw(st.sampled_from(("any", "parallel", "antiparallel", "no spin", "no weight")))
        if kind in ("parallel", "antiparallel"):
            J = tuple(v if kind == "parallel" else -v for v in x)
        J = (0.0, 0.0, 0.0) if kind == "no spin" else J
        alpha = 0.0 if kind == "no weight" else alpha
    rate, length = draw(power(*widths)), draw(power(*widths))
    weight = 2 * rate - length + draw(power(3, 40))
    alpha = ldexp(alpha, weight) if draw(st.integers(0, 9)) or len(widths) < 2 else draw(NUMBER)
    return alpha, (*(ldexp(v, rate) for v in J), *(ldexp(v, length) for v in x))


def scale(alpha, y0):
    """The time scale of a top, by exponents only: 2 to this power."""
    return -units(alpha, y0)[0]


@st.composite
def cases(draw, longest=70, widths=(20, 300, 1070), absolute=True):
    """(alpha, y0, h) with |h| up to 2^longest time scales, or any number."""
    alpha, y0 = draw(tops(*widths))
    if absolute and draw(st.integers(0, 9)) == 0:
        return alpha, y0, draw(NUMBER.filter(bool))
    span = draw(st.one_of(st.integers(-7, min(3, longest)), st.integers(-longest, longest)))
    h = draw(SIGN) * ldexp(draw(MANTISSA), span + scale(alpha, y0))
    return alpha, y0, h or TINY


PLACES = st.sampled_from([(n, every) for n in (*range(13), 40) for every in range(1, n + 2) if n % every == 0])

GOOD = {
    "pin": st.sampled_from((0, 1, 2, 8, 2**40)),
    "lam": st.one_of(st.none(), st.builds(lambda r, i: complex(r, abs(i) or TINY), NUMBER, NUMBER)),
    "tol": st.sampled_from((EPS, 1e-9, 1.0)),  # heyoka compiles for each
    "high_accuracy": st.booleans(),
    "order": st.integers(1, 60),
    "rtol": st.sampled_from((2.5e-14, 1e-9, 1.0)),
    "atol": st.sampled_from((0.0, TINY, 1e-12, 1e300)),
    "solver": st.sampled_from(("auto", "newton", "fixed_point")),
    "compensated": st.booleans(),
    "form": st.sampled_from(("symmetric", "lagrange")),
    "scheme": st.sampled_from(("strang", "saba4", "aba864")),
    "corrector": st.sampled_from((None, False, True)),
    "modified_kick": st.sampled_from((None, False, True)),
    "table": st.booleans(),
}
JUNK = (
    *(
        None,
        True,
        False,
        0,
        1,
        -1,
        3,
        2.5,
        -0.0,
        TINY,
        1e300,
        float("nan"),
        float("inf"),
        10**400,
        -(2**63),
        1j,
        1 - 1j,
    ),
    *(
        "",
        "Newton",
        "1",
        b"auto",
        [],
        [1.0],
        (),
        {},
        {"a"},
        np.array([1.0, 2.0]),
        np.array(["auto", "b"]),
        object(),
        int,
    ),
    *(np.int64(3), np.float32(0.5), np.bool_(True), np.array(3), np.datetime64("now"), lambda: 0),
)


@st.composite
def options(draw, names):
    """Values of some options, often of none."""
    chosen = draw(st.lists(st.sampled_from(names), unique=True)) if names and draw(st.booleans()) else []
    return {name: draw(GOOD[name]) for name in sorted(chosen)}


# ---------------------------------------------------------------- what a call may do

REPORT = {}


@pytest.fixture(scope="module", autouse=True)
def watchdog(request):
    """Where a process that hangs says so: the standard error that pytest hides."""
    capture = request.config.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():
        REPORT["file"] = os.fdopen(os.dup(2), "w")
    yield
    REPORT.pop("file").close()


def attempt(name, function, *args, h=None, arguments=(), **kwargs):
    """What the call returns, or None after an error that says what is wrong."""
    interpreted = name in METHODS and METHODS[name].engine in ("scipy", "python")
    limit = INTERPRETED if interpreted else COMPILED
    start = time.thread_time()
    result = alone(INTERPRETED if interpreted else COMPILING, name, function, args, kwargs, h, arguments)
    if time.thread_time() - start > limit:  # the first use of a kernel compiles it
        start = time.thread_time()
        result = alone(COMPILING, name, function, args, kwargs, h, arguments)
        spent = time.thread_time() - start
        assert spent <= limit, f"{spent:.1f} s of processor time"
    return result


def alone(limit, name, function, args, kwargs, h, arguments):
    """The call, with its errors looked at, under a watch."""
    faulthandler.dump_traceback_later(HUNG, exit=True, file=REPORT["file"])
    before = signal.signal(signal.SIGPROF, hung)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return function(*args, **kwargs)
    except ValueError as error:
        assert type(error) is ValueError, f"{type(error).__name__}: {error}"
        assert any(re.match(rf"(unknown )?{argument}\b", str(error)) for argument in arguments), str(error)
    except StepError as error:
        assert error.method == name, str(error)
        assert error.h in h if isinstance(h, list) else error.h == h, str(error)
        assert error.reason
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        faulthandler.cancel_dump_traceback_later()
    return None


def hung(*_):
    raise AssertionError("hung")


# ---------------------------------------------------------------- justified limits

# A method with steps of its own takes time in proportion to |h| n: a long run is long, not hung.
LONGEST = {"step": 70, "tolerance": 3}

# An absolute tolerance has the units of the state. Far below the round-off of a component that stays at zero, as some do where
# x is parallel to J, no step is short enough: SciPy's solvers then crawl, as they are asked to.
LEAST_ATOL = 2.0**-48

# heyoka's tolerance is absolute below norm 1, `atol` always: their steps depend on the units.

# `verner9_projected` answers a round-off u of an invariant by a move of up to u/(2√DAMPING) along the torus.
AMPLIFIED = {"verner9_projected": 1 / (2 * math.sqrt(runge_kutta.DAMPING))}


def judged(record, chosen):
    """Whether the method claims anything with these options."""
    if (
        record.name == "backlund_textbook"
    ):  # it divides by what nearly vanishes close to the vertical, which it is there to show
        return False
    if record.name == "addition_theorem":  # off its torus it runs away, as its docstring says of `pin`
        return chosen.get("pin") in (None, 1)
    return True


def sensible(record, y0, chosen):
    """The options, `atol` in the units of the state if that is large."""
    if "atol" not in record.options:
        return chosen
    return chosen | {"atol": max(chosen.get("atol", 1e-12), min(LEAST_ATOL * max(map(abs, y0)), 1e300))}


# ---------------------------------------------------------------- what a result must be

MODERATE = 4.0  # |h| and the length of a run, in time scales of the top, up to which claims are judged
SHORT = 0.25  # |h| up to which an error is judged by its order
ULPS = 256 * EPS


def judge(record, alpha, y0, h, rows, every, chosen):
    """Finite states, the first of them y0, that keep what the method claims; a row after every `every` steps of h."""
    assert rows.dtype == np.float64
    assert np.all(np.isfinite(rows))
    assert rows[0].tobytes() == np.array(y0).tobytes()
    # the same run in units of order one: powers of two, exact but for what underflows, far below round-off
    rate, length = units(alpha, y0)
    top = LagrangeTop(ldexp(alpha, length - 2 * rate))
    y = np.ldexp(rows, [-rate] * 3 + [-length] * 3)
    h = ldexp(h, rate)
    span = abs(h) * top.scales(y[0])[0]
    if span > MODERATE or not judged(record, chosen):
        return
    steps = every * np.arange(len(y), dtype=float)
    coarse = ldexp(TINY, -min(rate, length))  # what denormal numbers are rounded to
    bound = (steps + 1) * ((1 + span * span) * ULPS + 64 * coarse)
    with np.errstate(
        all="ignore"
    ):  # a loose tolerance may lead anywhere, where some may overflow that nobody claims to keep
        drift = np.abs(top.invariants(y) - top.invariants(y[0]))
    for invariant, values, size in zip(INVARIANTS, drift.T, top.invariant_scales(y[0]), strict=True):
        if invariant in record.conserves:
            within(invariant, values, bound * size)
    order = order_of(record, chosen)
    if span <= SHORT and "form" not in chosen:  # beyond, a modified energy may have a pole on the way
        for quantity, value in record.keeps.items():
            values, size = value(top, h, y)
            within(quantity, np.abs(values - values[0]), bound * size)
    if span * steps[-1] <= MODERATE and (order is None or (order > 0 and span <= SHORT)):
        error = scaled_error(top, y[0], y, exact.solution(top, y[0], h * steps))
        truncation = 0.0 if order is None else 1e2 * span ** (order + 1) * steps
        round_off = bound * AMPLIFIED.get(record.name, 1.0)
        within("solution", error, (round_off + truncation) * np.exp(span * steps))


def order_of(record, chosen):
    """None for an exact step, 0 for what is not judged by its order."""
    if record.control == "tolerance" or chosen.get("lam") is not None:
        return 0
    return 1 if chosen.get("form") == "lagrange" else chosen.get("order", record.order)


def within(what, values, bound):
    with np.errstate(divide="ignore"):  # what has no size must not change at all
        ratio = np.divide(values, bound, out=np.zeros_like(values), where=values != 0)
    assert np.max(ratio) <= 1, f"{what}: {np.max(ratio):.2g} times the bound"


def run(name, alpha, y0, h, n, every, chosen):
    return integrate(LagrangeTop(alpha), y0, h, n, name, every, **chosen)


# ---------------------------------------------------------------- the tests


def test_every_option_is_tried():
    names = {option for name in METHODS if available(METHODS[name]) for option in METHODS[name].options}
    assert names <= set(GOOD), "say here what values these options take"


@pytest.mark.parametrize("name", METHODS)
def test_any_top(name):
    record = method(name)
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
    record = method(name)
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


@pytest.mark.parametrize("name", METHODS)
def test_any_stepper(name):
    """`advance` goes where `record` does; a stepper takes any state, or says why not, and changes neither."""
    record = method(name)

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


@pytest.mark.parametrize("name", METHODS)
def test_any_option(name):
    """Whatever an option is set to: a result, or a ValueError that begins with its name."""
    record = method(name)
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
    record = method(name)

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
    record = method(name)

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


@pytest.mark.parametrize("name", METHODS)
def test_any_ensemble(name, monkeypatch):
    """Each top is what it is alone, to the bit but for heyoka's batches; NaN where alone it fails."""
    monkeypatch.setattr(backlund, "SHORT", 0)  # short runs take λ(h) in plain doubles, see test_ensemble
    record = method(name)
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
    record = METHODS["implicit_midpoint"]
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
