"""Any option and any potential: a finite result, or an error that says by name what is wrong.

A ValueError begins with the name of the argument; a StepError has method, h and reason. No other exception, no NaN, no warning,
no endless call. Any numbers in a state and a step are drawn in `test_laws`; `check` tries all tops, and extreme sizes.
"""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

import math
import operator
import re
import time
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, integrate, sqrt
from lagrange_bench.integrators.checks import keyword_options
from tests.installed import FOR_TOPS, installed

LIMITS = {"compiled": 1.0, "scipy": 5.0, "python": 5.0}  # s of processor time that a call may take, by engine
GENERIC = TOPS["generic"]
JUNK = [
    *(None, True, 0, -1, 3, 2.5, 5e-324, 1e300, math.nan, math.inf, 10**400, 1 - 1j),
    *("", "Newton", b"auto", [1.0], {}, np.array([1.0, 2.0])),
    *(object(), int, np.int64(3), np.float32(0.5), np.array(3), np.datetime64("now")),
]
interpreted = pytest.mark.interpreted


def attempt(name, option, value, *args, **kwargs):
    """A run of the generic top with this option, None after an error that says what is wrong; in time, once compiled."""
    for _ in range(2):
        start = time.thread_time()
        result = allowed(name, option, *args, method=name, **{option: value}, **kwargs)
        if (spent := time.thread_time() - start) <= LIMITS.get(METHODS[name].engine, 1.0):
            return result
    raise AssertionError(f"{spent:.1f} s of processor time")


def allowed(name, option, *args, **kwargs):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return integrate(GENERIC.top, GENERIC.state, *args, **kwargs)
    except ValueError as error:
        assert type(error) is ValueError, f"{type(error).__name__}: {error}"
        assert re.match(rf"(unknown )?{option}\b", str(error)), str(error)
    except StepError as error:
        assert (error.method, error.h) in ((name, 0.1), (name, None)), str(error)
        assert error.reason
    return None


@interpreted
@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_option(name):
    """Whatever an option is set to: a result, or a ValueError that begins with its name."""
    record = installed(name)
    for option in record.options:
        for value in JUNK:
            made = attempt(name, option, value, 0.1, 3)
            assert made is None or np.all(np.isfinite(made.y))
            if record.evaluate is not None and option in keyword_options(record.evaluate):
                attempt(name, option, value, t=[0.1])


def test_a_run_that_lost_its_top_ends():
    """atol is 10⁵ times the size of J: the steps grew beyond all measure, |x| with them, and then it took 10¹⁰ steps."""
    y = (5.6e-18, -6.9e-18, 1.1e-17, -4.6e-70, -2.1e-70, 2.8e-70)
    with pytest.raises(StepError, match="rtol and atol do not hold this state"):
        integrate(LagrangeTop(-1.7e35), y, -2.9e17, 40, "dop853", every=10, atol=1e-12)


Y = (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
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
@settings(max_examples=60, derandomize=True, deadline=None)
@given(TREE, NUMBER)
def test_any_formula(tree, number):
    value = lambda x1, x2, x3, p: evaluated(tree, {"x1": x1, "x2": x2, "x3": x3, "p": p[0]})  # noqa: E731
    force(Potential("of mine", value), (number,))
