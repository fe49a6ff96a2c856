"""Which fields the closed form in a vertical tide is found in."""

import math

import numpy as np
import pytest

from lagrange_bench import POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, Problem, exact
from lagrange_bench.integrators.truth import truths
from tests.test_integrators.test_exact import in_tide

GENERIC = TOPS["generic"]


def own(x1, x2, x3, p):
    return p[0] * x3**2 / 2


def posed(t, y, p):
    return (y[0] ** 2 + y[1] ** 2 + y[2] ** 2) / 2 + y[5] + p[0] * y[5] * y[5] / 2


TIDES = [  # potential, parameters, alpha, k
    ("tide", (0.125, 0.0, 0.0, -2.0), 1.0, 0.5),
    ("axisymmetric", (0.25, 0.0), 1.0, 0.5),
    ("quadratic", (0.25, 0.25, 0.75, 0.0, 0.0, 0.0), 1.0, 0.5),
    ("dipole", (0.0, 0.0, -2.0), -1.0, 0.0),
    (Potential("own", own), (0.5,), 1.0, 0.5),
    (Potential("factors", lambda x1, x2, x3, p: (x3 - p[0]) * (x3 + p[0]) / 4 + x1 * 0.0), (3.0,), 1.0, 0.5),
]
OTHERS = [
    ("tide", (0.5, 1e-9, 0.0, 1.0)),
    ("axisymmetric", (0.25, 1e-9)),
    ("quadratic", (0.25, math.nextafter(0.25, 1.0), 0.75, 0.0, 0.0, 0.0)),
    ("charge", (0.1, 0.0, 0.0, 3.0)),
]


def test_a_vertical_tide_is_seen_in_any_formula():
    for potential, parameters, alpha, k in TIDES:
        top = PerturbedTop(GENERIC.top, POTENTIALS.get(potential, potential), parameters)
        assert exact.vertical_field(top) == (alpha, k)
        assert truths.name(top) == "exact solution"
        np.testing.assert_array_equal(
            exact.solution(top, GENERIC.state, 9.0),
            exact.solution(in_tide(alpha, k) if k else LagrangeTop(alpha), GENERIC.state, 9.0),
        )
    problem = Problem("tide", "e3", posed, (0.5,))
    assert exact.vertical_field(problem) == (1.0, 0.5)
    assert truths.solution(problem, np.array((0.1, 0.2, 0.3, 0.0, 0.0, 0.0)), [1.0]).tolist() == [
        [0.1, 0.2, 0.3, 0, 0, 0]
    ]
    for potential, parameters in OTHERS:
        top = PerturbedTop(GENERIC.top, POTENTIALS[potential], parameters)
        assert truths.name(top) == "reference solution"
        with pytest.raises(ValueError, match="alpha x3"):
            exact.solution(top, GENERIC.state, 1.0)
    timed = Problem("timed", "e3", lambda t, y, p: posed(t, y, p) * (1 + t * 1e-9), (0.5,))
    assert exact.vertical_field(timed) is None
