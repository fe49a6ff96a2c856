"""Somebody's own potential: a top is in it, with a finite force, or one clear error names it.

No function, number or state may end in anything but a ValueError that names the potential.
"""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

from __future__ import annotations

import math
import operator

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lagrange_bench.integrators import (
    PERTURBED_TOPS,
    POTENTIALS,
    LagrangeTop,
    PerturbedTop,
    Potential,
    StepError,
    integrate,
    sqrt,
)
from lagrange_bench.integrators.truth import reference

TOP, Y = LagrangeTop(1.0), (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)
FEW = settings(max_examples=60, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))


def followed(potential, parameters=(), y0=Y):
    """Finite states, or None after an error that names the potential."""
    try:
        top = PerturbedTop(TOP, potential, parameters)
        top.check_state(np.array(y0))  # as `integrate` does
        assert "force" in top.offers
    except ValueError as error:
        assert type(error) is ValueError
        assert f"potential {potential.name}" in str(error)
        assert "\n" not in str(error)
        return None
    force = top.gradient(*y0[3:])
    assert np.isfinite(force).all()
    return force


# ---------------------------------------------------------------- functions that are no formula


def forever(*numbers):
    return forever(*numbers)


NO_FORMULAS = {
    "too few arguments": lambda x1, x2: x1,
    "too many arguments": lambda x1, x2, x3, p, q: x1,
    "nothing": lambda x1, x2, x3, p: None,
    "a word": lambda x1, x2, x3, p: "V",
    "a tuple": lambda x1, x2, x3, p: (x1, x2),
    "a list": lambda x1, x2, x3, p: [x1],
    "a complex number": lambda x1, x2, x3, p: 1j * x1,
    "an array": lambda x1, x2, x3, p: np.array([x1, x2]),
    "NaN": lambda x1, x2, x3, p: math.nan,
    "infinity": lambda x1, x2, x3, p: x1 * math.inf,
    "a sine": lambda x1, x2, x3, p: math.sin(x1),
    "a function of arrays": lambda x1, x2, x3, p: np.arctan(x1),
    "a comparison": lambda x1, x2, x3, p: x1 if x1 > 0 else -x1,
    "a truth value": lambda x1, x2, x3, p: x1 and x2,
    "an absolute value": lambda x1, x2, x3, p: abs(x1),
    "a third power": lambda x1, x2, x3, p: x1 ** (1 / 3),
    "a power of two": lambda x1, x2, x3, p: 2.0**x1,
    "a whole part": lambda x1, x2, x3, p: x1 // 1,
    "a parameter too many": lambda x1, x2, x3, p: p[0] * x1,
    "an exception": lambda x1, x2, x3, p: {}["no such key"],
    "without end": lambda x1, x2, x3, p: forever(x1),
    "division by nothing": lambda x1, x2, x3, p: x1 / 0,
    "division by 0": lambda x1, x2, x3, p: x1 / (x2 - x2),
    "too large": lambda x1, x2, x3, p: x1 * 10**400,
    "overflow": lambda x1, x2, x3, p: 1e308 * x1 * 1e308 * x2,
}


@pytest.mark.parametrize("what", NO_FORMULAS)
def test_what_is_no_formula_is_refused(what):
    assert followed(Potential("of mine", NO_FORMULAS[what])) is None


def test_a_formula_is_followed():
    """The control."""
    assert followed(Potential("of mine", lambda x1, x2, x3, p: x1 * x2 / (2 + x3) + sqrt(3 + x1))) is not None


@pytest.mark.parametrize("word", ["gradient", "one of them", "of a sign", "count"])
def test_a_wrong_gradient_is_refused(word):
    wrong = {
        "gradient": lambda x1, x2, x3, p: (x2 * 1.0001, x1, 0.0 * x3),
        "one of them": lambda x1, x2, x3, p: (x2, x1, x3),
        "of a sign": lambda x1, x2, x3, p: (-x2, -x1, 0.0),
        "count": lambda x1, x2, x3, p: (x2, x1),
    }
    value = lambda x1, x2, x3, p: x1 * x2  # noqa: E731
    assert followed(Potential("of mine", value, wrong[word])) is None
    assert followed(Potential("of mine", value, lambda x1, x2, x3, p: (x2, x1, 0.0))) is not None


# ---------------------------------------------------------------- random formulas, numbers, states

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
LEAF = st.one_of(
    st.sampled_from(("x1", "x2", "x3", "p")), NUMBER, st.sampled_from((0.0, 1.0, -1.0, math.inf, math.nan))
)
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


def evaluated(tree, names):
    if not isinstance(tree, tuple):
        return names.get(tree, tree)
    word, one, *other = tree
    if word == "sqrt":
        return sqrt(evaluated(one, names))
    if word == "**":
        return evaluated(one, names) ** other[0]
    return BINARY[word](evaluated(one, names), evaluated(other[0], names))


@FEW
@given(TREE, NUMBER)
def test_any_formula(tree, number):
    value = lambda x1, x2, x3, p: evaluated(tree, {"x1": x1, "x2": x2, "x3": x3, "p": p[0]})  # noqa: E731
    followed(Potential("of mine", value), (number,))


@FEW
@given(st.sampled_from(list(POTENTIALS)), st.lists(NUMBER, max_size=7), st.lists(NUMBER, min_size=3, max_size=3))
def test_any_parameters_and_any_axis(name, numbers, axis):
    axis = axis if any(axis) else [0.0, 0.0, 1.0]
    followed(POTENTIALS[name], tuple(numbers), (*Y[:3], *axis))


@pytest.mark.parametrize("bad", [(math.nan,), (math.inf,), ("1",), (1j,), (None,), "1", 3, None, (True,)])
def test_parameters_that_are_no_numbers(bad):
    with pytest.raises(ValueError, match=r"^parameters"):
        PerturbedTop(TOP, POTENTIALS["axisymmetric"], bad)


def test_a_singularity_at_the_start_and_on_the_way():
    charge = POTENTIALS["charge"]
    with pytest.raises(ValueError, match="potential charge is not finite"):
        integrate(PerturbedTop(TOP, charge, (1.0, *Y[3:])), Y, 0.1, 5, "strang")
    top, fall = PerturbedTop(TOP, charge, (1.0, 0.0, 0.0, 1.0)), (0.0, 0.0, 0.0, 0.6, 0.0, 0.8)
    with pytest.raises(StepError):
        reference.solution(top, fall, [10.0])
    assert PERTURBED_TOPS["magnet"].potential is charge
