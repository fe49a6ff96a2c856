"""The closed form in a vertical tide against Taylor series in integers, and which fields it is found in."""

import math

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench import POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, Problem, exact, integrate, phase
from lagrange_bench.integrators.truth import tide, truths
from tests.reference import errors, flows, largest
from tests.test_integrators.test_exact import BOUND, STATES

GENERIC = TOPS["generic"]
LOOP = (1.0, 0.0, 1.0, 1.0, 0.0, -0.75)  # with k = -1: f = (x3 - alpha)² (9/16 - x3²)

CASES = {  # alpha, k, state: each where f has other roots, or double ones
    "k > 0": (1.0, 0.5, GENERIC.y0),
    "two real roots": (1.0, -0.5, GENERIC.y0),
    "one of two wells": (0.125, -100.0, (0.5, -0.25, 1.5, 0.5, 0.25, -0.75)),
    "the other": (0.125, -100.0, (0.5, -0.25, 1.5, 0.5, 0.25, 0.75)),
    "no weight": (0.0, 3.0, (0.5, -0.25, 1.5, 0.5, 0.25, 0.75)),
    "weak": (-1.0, 1e-6, (3.0, -4.0, 12.0, 0.48, 0.6, 0.64)),
    "next to nothing": (1.0, -1e-300, GENERIC.y0),
    "strong": (0.5, 1e3, GENERIC.y0),
    "released": (1.0, -4.0, (0.0, 0.0, 0.0, 0.48, 0.6, 0.64)),
    "released, spinning": (-0.5, 2.0, (0.96, 1.2, 1.28, 0.48, 0.6, 0.64)),
    "through both poles": (0.5, 1.0, (2.5, 0.0, 0.0, 0.0, 0.6, -0.8)),
    "starts at a pole": (1.0, -1.0, (0.5, 1.0, 1.0, 0.0, 0.0, -1.0)),
    "small oscillations": (1.0, 0.25, (1e-9, 0.0, 1.0, 0.0, 1e-9, -1.0)),
    "sleeping": (1.0, 0.5, (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)),
    "steady precession": (0.5, 2.0, (0.5, 0.0, 1.0, 1.0, 0.0, -0.25)),
    "J vertical where the field vanishes": (1.0, -2.0, (0.0, 0.0, 1.0, 1.0, 0.0, 0.5)),
    "falls back asleep": (1.0, 0.25, (2.0, 0.5, 1.0, 1.0, 0.0, -0.75)),
    "falls back to a precession": (0.25, -1.0, LOOP),
    "the same from above": (0.25, -1.0, (-0.5, 0.0, 1.0, 1.0, 0.0, 0.75)),
    "hardly by a precession": (0.25, -1.0, (1.0, 1e-9, 1.0, 1.0, 0.0, -0.75)),
    "an equilibrium beside": (1.0, -1.0, (1.75, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "an equilibrium at the pole": (1.25, -1.0, (2.0, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a double root outside": (2.0, -1.0, (2.75, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a triple root": (0.75, -1.0, (1.5, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a triple root at the pole": (-3.0, -2.0, (-2.0, 0.0, 2.0, 1.0, 0.0, 0.0)),
    "an ulp from a triple root": (0.75, math.nextafter(-1.0, 0.0), (1.5, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "from pole to pole": (0.0, 1.0, (0.0, 0.75, 0.0, 0.75, 0.0, 1.0)),
    "back": (0.0, 1.0, (0.0, -0.75, 0.0, 0.75, 0.0, 1.0)),
    "nearly from pole to pole": (0.0, 1.0, (1e-9, 0.75, 1e-9, 0.75, 0.0, 1.0)),
}
DRAW = np.random.default_rng(514)
for _n in range(2):
    _alpha, _k = DRAW.choice((-1, 1), 2) * 10.0 ** DRAW.uniform((-2, -6), (1, 3))
    _J, _x = DRAW.normal(size=(2, 3)) * [[10 ** DRAW.uniform(-1, 1.5)], [1.0]]
    CASES[f"random {_n}"] = (float(_alpha), float(_k), (*_J.tolist(), *_x.tolist()))


def in_tide(alpha, k):
    return PerturbedTop(LagrangeTop(alpha), POTENTIALS["tide"], (k, 0.0, 0.0, 1.0))


def scale(alpha, k, y0):
    """Of J; that of `scales` knows nothing of a force that is 0 at the start."""
    size = math.hypot(*y0[3:])
    return math.hypot(*y0[:3]) + math.sqrt(abs(alpha) * size) + math.sqrt(abs(k)) * size


@pytest.mark.parametrize("case", CASES)
def test_states_follow_the_equations_of_motion(case):
    alpha, k, y0 = CASES[case]
    top, rate = in_tide(alpha, k), scale(alpha, k, y0)
    sizes = np.repeat((rate, math.hypot(*y0[3:])), 3)
    times = (-1 if len(case) % 2 else 1) * np.array((0.2, 2.0, 25.0)) / rate
    reference = flows(alpha, y0, times, 44, k)
    assert largest((exact.solution(top, y0, times, digits=28) - reference) / sizes) < 1e-27
    times = np.concatenate((times, [0.0], np.array((1e2, -1e3, 3e4, -1e6)) / rate))
    closed = exact.solution(top, y0, times, digits=25)
    assert largest((closed[:3] - reference) / sizes) < 1e-24
    assert largest((closed[3] - y0) / sizes) < 1e-24
    assert largest((exact.solution(top, y0, times) - closed) / sizes) < BOUND


@pytest.mark.parametrize("case", STATES)
def test_without_a_tide_it_is_the_closed_form_of_the_uniform_field(case):
    """Another formula, other code: every special case of the Lagrange top is one here, too."""
    alpha, y0 = STATES[case]
    orbit, top = tide.find_orbit(alpha, 0, y0, 55), LagrangeTop(alpha)
    unit = top.scales(y0)[2]
    times = [t * (unit if math.isfinite(unit) else 1.0) for t in (0.0, 2.0, -17.0, 300.0)]
    with mp.workdps(70):
        states = [exact.in_mpmath_at(orbit, mp.ldexp(mpf(t), orbit.rate)) for t in times]
    assert max(errors(top, y0, states, exact.solution(top, y0, times, digits=50))) < 1e-48


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


def test_runs_of_any_length_are_judged():
    """Beyond the 2000 time scales of a reference solution; exactly at n h."""
    top = in_tide(1.0, 0.5)
    assert truths.name(top) == "exact solution"
    run = integrate(top, GENERIC.state, h=0.125, steps=40_000, method="blanes_moan6", every=20_000)
    assert run.error()[0] < 1e-15
    assert 1e-11 < run.error()[-1] < 1e-6
    assert phase("blanes_moan6", [(top, GENERIC.state)], h=0.25, steps=20_000).frame["error"].max() < 1e-5
