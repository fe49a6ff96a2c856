"""Random tops, steps and options for the tests, calls under a watch, and what a result must be."""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

import faulthandler
import math
import os
import re
import signal
import time
import warnings

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from lagrange_bench.experiments.measuring.metrics import scaled_error
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, StepError, integrate
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.methods import runge_kutta
from lagrange_bench.integrators.truth import exact
from lagrange_bench.integrators.truth.orbit import units
from tests.installed import FOR_TOPS

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
    return [name for name, record in FOR_TOPS.items() if have(record)]


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
        if invariant in record.kept(top):
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
    return 1 if chosen.get("form") == "lagrange" else chosen.get("order", record.order_for(LagrangeTop()))


def within(what, values, bound):
    with np.errstate(divide="ignore"):  # what has no size must not change at all
        ratio = np.divide(values, bound, out=np.zeros_like(values), where=values != 0)
    assert np.max(ratio) <= 1, f"{what}: {np.max(ratio):.2g} times the bound"


def run(name, alpha, y0, h, n, every, chosen):
    return integrate(LagrangeTop(alpha), y0, h, n, name, every, **chosen)
