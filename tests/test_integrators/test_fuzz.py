"""Any top, any step, any option: every method returns a result within its claims, or says by name why it does not.

A call may return finite states that keep what the method's record claims. Or it raises a ValueError that begins with the
name of the argument, or a StepError with method, h and reason. No other exception, no NaN, no warning, no endless call.
`test_laws` draws ordinary tops; here are special orbits, sizes up to 2^±1070, and options.

FUZZ_EXAMPLES=2000 in the environment takes so many random examples for every method in place of some fixed ones.
"""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

import math
import operator
import os
import re
import time
import warnings
from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lagrange_bench.integrators import (
    METHODS,
    TOPS,
    LagrangeTop,
    PerturbedTop,
    Potential,
    StepError,
    available,
    integrate,
    sqrt,
)
from lagrange_bench.integrators.checks import keyword_options
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.truth.orbit import units
from tests.installed import FOR_TOPS, installed

EPS, TINY, HUGE = float(np.finfo(float).eps), 5e-324, 1.7976931348623157e308
EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))
LIMITS = {"compiled": 1.0, "scipy": 5.0, "python": 5.0}  # s of processor time that a call may take, by engine
# a method with steps of its own takes time in proportion to |h| n: a long run is long, and not endless
LONGEST = {"step": 70, "tolerance": 3}  # |h| is at most 2 to this power, in time scales of the top
GENERIC = TOPS["generic"]
interpreted = pytest.mark.interpreted  # beyond the sizes of ordinary doubles NumPy warns, and kernels do not


def examples(few):
    """`few` examples, the same in every run; or as many as FUZZ_EXAMPLES says, at random."""
    slow = [HealthCheck.too_slow, HealthCheck.data_too_large]
    return settings(
        max_examples=EXAMPLES or few, derandomize=not EXAMPLES, database=None, deadline=None, suppress_health_check=slow
    )


# ---------------------------------------------------------------- what is drawn

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
PLACES = st.sampled_from([(n, every) for n in (*range(13), 40) for every in range(1, n + 2) if n % every == 0])
POWER = st.one_of(st.just(0), *(st.integers(-width, width) for width in (20, 300, 1070)))


def ldexp(number, exponent):
    """number · 2^exponent, at most the largest double."""
    try:
        return math.ldexp(number, exponent)
    except OverflowError:
        return math.copysign(HUGE, number)


@st.composite
def cases(draw, longest, absolute):
    """(alpha, y0, h): a named top, most of them special orbits, or any; of any size, turned round, kicked, or without weight.

    |h| is up to 2^longest time scales, or any number.
    """
    named = draw(st.sampled_from(list(TOPS.values())))
    J, x = np.array(named.y0[:3]), np.array(named.y0[3:])
    if draw(st.booleans()):
        J, x = (np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3))) for _ in "Jx")
    J[0] += draw(st.sampled_from((0.0, 1.0, 2.0**-20, 2.0**-60)))
    J = draw(st.sampled_from((J, 0 * J, x, -x)))
    rate, length = draw(POWER), draw(POWER)
    weight = draw(st.sampled_from((1.0, -1.0, 0.0))) * named.alpha
    alpha = ldexp(weight, 2 * rate - length + draw(st.integers(-40, 40)))
    x = x if np.any(x) else np.array((0.0, 0.0, 1.0))
    y0 = (*(ldexp(v, rate) for v in J), *(ldexp(v, length) for v in x[:2]), ldexp(x[2], length) or TINY)
    if absolute and draw(st.integers(0, 9)) == 0:
        return draw(NUMBER), y0, draw(NUMBER.filter(bool))
    span = draw(st.one_of(st.integers(-7, min(3, longest)), st.integers(-longest, longest)))
    sign = draw(st.sampled_from((0.75, -0.75, 1 - 2.0**-53)))
    return alpha, y0, ldexp(sign, span - units(alpha, y0)[0]) or TINY


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
JUNK = [
    *(None, True, 0, -1, 3, 2.5, TINY, 1e300, math.nan, math.inf, 10**400, 1 - 1j),
    *("", "Newton", b"auto", [1.0], {}, np.array([1.0, 2.0])),
    *(object(), int, np.int64(3), np.float32(0.5), np.array(3), np.datetime64("now")),
]


@st.composite
def options(draw, names):
    """Values of some options, often of none."""
    chosen = draw(st.lists(st.sampled_from(names), unique=True)) if names and draw(st.booleans()) else []
    return {name: draw(GOOD[name]) for name in sorted(chosen)}


# ---------------------------------------------------------------- what a call may do, and what a result must be


def attempt(name, function, *args, h=None, arguments=(), **kwargs):
    """What the call returns, or None after an error that says what is wrong."""
    limit = LIMITS.get(METHODS[name].engine, 1.0) if name in METHODS else 1.0
    for _ in range(2):  # the first use of a kernel compiles it
        start = time.thread_time()
        result = allowed(name, function, args, kwargs, h, arguments)
        if (spent := time.thread_time() - start) <= limit:
            return result
    raise AssertionError(f"{spent:.1f} s of processor time")


def allowed(name, function, args, kwargs, h, arguments):
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
    return None


# An absolute tolerance has the units of the state. Far below the round-off of a component that stays at zero, as some do where
# x is parallel to J, no step is short enough: SciPy's solvers then crawl, as they are asked to.
LEAST_ATOL = 2.0**-48
MODERATE = 4.0  # |h| in time scales of the top, up to which claims are judged


def sensible(record, y0, chosen):
    """The options, `atol` in the units of the state if that is large."""
    if "atol" not in record.options:
        return chosen
    return chosen | {"atol": max(chosen.get("atol", 1e-12), min(LEAST_ATOL * max(map(abs, y0)), 1e300))}


def judge(record, alpha, y0, h, rows, every, chosen):
    """Finite states, the first of them y0, that keep what the method claims; a row after every `every` steps of h."""
    assert np.all(np.isfinite(rows))
    assert rows[0].tobytes() == np.array(y0).tobytes()
    # the same run in units of order one: powers of two, exact but for what underflows, far below round-off
    rate, length = units(alpha, y0)
    top = LagrangeTop(ldexp(alpha, length - 2 * rate))
    y = np.ldexp(rows, [-rate] * 3 + [-length] * 3)
    span = abs(ldexp(h, rate)) * top.scales(y[0])[0]
    # the first divides by what nearly vanishes close to the vertical; the second leaves its torus, as it says
    unstable = (
        record.name == "backlund_textbook",
        record.name == "addition_theorem" and chosen.get("pin") not in (None, 1),
    )
    if span > MODERATE or any(unstable):
        return
    coarse = ldexp(TINY, -min(rate, length))  # what denormal numbers are rounded to
    bound = (every * np.arange(len(y)) + 1.0) * ((1 + span * span) * 256 * EPS + 64 * coarse)
    with np.errstate(all="ignore"):  # a loose tolerance may lead where invariants overflow that nobody claims to keep
        drift = np.abs(top.invariants(y) - top.invariants(y[0]))
    for invariant, values, size in zip(INVARIANTS, drift.T, top.invariant_scales(y[0]), strict=True):
        assert invariant not in record.kept(top) or np.all(values <= bound * size), invariant


# ---------------------------------------------------------------- tops, steps and options


def test_every_option_is_tried():
    names = {option for name in FOR_TOPS if available(METHODS[name]) for option in METHODS[name].options}
    assert names <= set(GOOD), "say here what values these options take"


@pytest.mark.slow  # `check` and `test_laws` try extremes, too
@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_top(name):
    record = installed(name)
    results = Counter()

    @examples(16)
    @given(cases(LONGEST[record.control], record.control == "step"), PLACES, options(record.options))
    def one(case, places, chosen):
        (alpha, y0, h), (n, every) = case, places
        chosen = sensible(record, y0, chosen)
        found = attempt(name, integrate, LagrangeTop(alpha), y0, h, n, name, every, h=h, arguments=chosen, **chosen)
        results[found is not None] += 1
        if found is not None:
            assert found.y.shape == (n // every + 1, 6)
            assert min(found.work.steps, found.work.rhs_evals, found.work.iterations, found.work.rejected) >= 0
            judge(record, alpha, y0, h, found.y, every, chosen)

    one()
    assert results[True] > results[False] / 3, "hardly anything was judged"


@interpreted
@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_option(name):
    """Whatever an option is set to: a result, or a ValueError that begins with its name."""
    record = installed(name)
    for option in record.options:
        for value in JUNK:
            settings = {"h": 0.1, "arguments": (option,), option: value}
            made = attempt(name, integrate, GENERIC.top, GENERIC.state, 0.1, 3, name, **settings)
            assert made is None or np.all(np.isfinite(made.y))
            if record.evaluate is not None and option in keyword_options(record.evaluate):
                settings["h"] = [None, 0.1]
                attempt(name, integrate, GENERIC.top, GENERIC.state, t=[0.1], method=name, **settings)


# ---------------------------------------------------------------- what was found this way


def test_a_run_that_lost_its_top_ends():
    """atol is 10⁵ times the size of J: the steps grew beyond all measure, |x| with them, and then it took 10¹⁰ steps."""
    y = (5.6e-18, -6.9e-18, 1.1e-17, -4.6e-70, -2.1e-70, 2.8e-70)
    with pytest.raises(StepError, match="rtol and atol do not hold this state"):
        integrate(LagrangeTop(-1.7e35), y, -2.9e17, 40, "dop853", every=10, atol=1e-12)


@pytest.mark.parametrize("size", [1e-300, 1e160])
def test_the_axis_of_the_body_whatever_its_length(size):
    y0 = np.array((*GENERIC.state[:3], *(size * GENERIC.state[3:])))
    g = integrate(LagrangeTop(1 / size), y0, 0.1, 10, attitude=True).attitude
    np.testing.assert_allclose(g, integrate(GENERIC.top, GENERIC.state, 0.1, 10, attitude=True).attitude, atol=1e-13)


@interpreted
def test_what_is_no_attitude_is_refused():
    for bad in ((1.0, 0.0, 0.0), "up", (1j, 0, 0, 0), (1e300, 0, 0, 0), (math.nan,) * 4):
        with pytest.raises(ValueError, match=r"^attitude "):
            integrate(GENERIC.top, GENERIC.state, 0.1, 3, attitude=bad)


# ---------------------------------------------------------------- potentials of one's own

Y = (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)
LEAF = st.one_of(st.sampled_from(("x1", "x2", "x3", "p", 0.0, 1.0, -1.0, math.inf, math.nan)), NUMBER)
BINARY = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
TREE = st.recursive(
    LEAF,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(tuple(BINARY)), inner, inner),
        st.tuples(st.just("sqrt"), inner),
        st.tuples(st.just("**"), inner, st.sampled_from((2, 3, -1, 0.5, 1.5, 0, 0.3))),
    ),
    max_leaves=8,
)


def force(potential, parameters=(), y0=Y):
    """A finite force, or None after an error that names the potential."""
    try:
        top = PerturbedTop(LagrangeTop(1.0), potential, parameters)
        top.check_state(np.array(y0))  # as `integrate` does
        assert "force" in top.offers
    except ValueError as error:
        assert type(error) is ValueError
        assert f"potential {potential.name}" in str(error)
        assert "\n" not in str(error)
        return None
    assert np.isfinite(top.gradient(*y0[3:])).all()
    return top


def evaluated(tree, names):
    if not isinstance(tree, tuple):
        return names.get(tree, tree)
    word, one, *other = tree
    if word == "sqrt":
        return sqrt(evaluated(one, names))
    if word == "**":
        return evaluated(one, names) ** other[0]
    return BINARY[word](evaluated(one, names), evaluated(other[0], names))


@interpreted
@examples(60)
@given(TREE, NUMBER)
def test_any_formula(tree, number):
    value = lambda x1, x2, x3, p: evaluated(tree, {"x1": x1, "x2": x2, "x3": x3, "p": p[0]})  # noqa: E731
    force(Potential("of mine", value), (number,))


@interpreted
@pytest.mark.parametrize("fault", [np.nan, 1 + 2048 * EPS])
def test_faults_are_found(fault):
    arguments = (GENERIC.alpha, GENERIC.y0, 0.1)
    rows = integrate(GENERIC.top, GENERIC.y0, 0.1, 3, "implicit_midpoint", every=1).y
    judge(METHODS["implicit_midpoint"], *arguments, rows, 1, {})
    rows[1:, 3:] *= fault
    with pytest.raises(AssertionError):
        judge(METHODS["implicit_midpoint"], *arguments, rows, 1, {})
