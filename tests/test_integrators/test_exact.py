"""The closed-form solution against Taylor series in integers, which share nothing with it; its properties; where it is found."""

import math

import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

from lagrange_bench import CASES, POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, Problem, exact
from lagrange_bench.experiments.measuring.states import WIDE, find
from lagrange_bench.integrators.truth import truths
from lagrange_bench.integrators.truth.exact import FEW, as_mpf, motion_of
from lagrange_bench.support.precision import workprec
from tests.reference import errors, flows, largest, turned

BOUND = 4e-15  # of the scales: what methods that are exact in time promise, 18 eps
TABLE = 5e-16  # of the scales: what exact.solution promises at many times
PROVEN = 1.2e-16  # half an ulp, and 1e-17
MANY = FEW + 1  # times for which it takes a table

NUTATING = [t for t in TOPS.values() if exact.regime(t.top, t.state) == "elliptic"]
NUMBER = st.floats(-1e300, 1e300)


def error(top, y0, y, truth):
    """Largest error over states (n, 6) or (6,) in units of the scales."""
    return largest(errors(top, y0, y, truth))


SPECIAL = {  # alpha, state: each on or next to a place where a formula could break
    "starts at the upper pole": (1.0, (0.5, 1.0, 1.0, 0.0, 0.0, 1.0)),
    "through the lower pole": (1.0, (0.5, 1.0, -0.25, 1.0, 0.0, 0.75)),
    "J vertical": (1.0, (0.0, 0.0, 1.2, 0.48, 0.6, 0.64)),
    "released from rest": (1.0, (0.0, 0.0, 0.0, 0.48, 0.6, 0.64)),
    "pendulum on the separatrix": (1.0, (0.0, 2.0, 0.0, 1.0, 0.0, -0.75)),
    "marginally stable, tilted": (1.0, (0.0, 0.0, 2.0, 2.0**-10, 0.0, 1.0)),
    "marginally stable, at rest": (1.0, (0.0, 0.0, 2.0, 0.0, 0.0, 1.0)),
    "J along x": (1.0, (0.96, 1.2, 1.28, 0.48, 0.6, 0.64)),
    "hardly any gravity": (1e-100, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)),
    "gravity alone": (1e6, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)),
    "k'² = 1e-20": (1.0, (0.0, 0.0, 1.0, 2.0**-33, 0.0, 1.0)),
    "nothing at all": (0.0, (0.0, 0.0, 0.0, 0.6, 0.0, 0.8)),
}


TIDES = {  # alpha, k, state: each where f has other roots, or double ones
    "k > 0": (1.0, 0.5, TOPS["generic"].y0),
    "two real roots": (1.0, -0.5, TOPS["generic"].y0),
    "one of two wells": (0.125, -100.0, (0.5, -0.25, 1.5, 0.5, 0.25, -0.75)),
    "through both poles": (0.5, 1.0, (2.5, 0.0, 0.0, 0.0, 0.6, -0.8)),
    "starts at a pole": (1.0, -1.0, (0.5, 1.0, 1.0, 0.0, 0.0, -1.0)),
    "steady precession": (0.5, 2.0, (0.5, 0.0, 1.0, 1.0, 0.0, -0.25)),
    "J vertical where the field vanishes": (1.0, -2.0, (0.0, 0.0, 1.0, 1.0, 0.0, 0.5)),
    "falls back asleep": (1.0, 0.25, (2.0, 0.5, 1.0, 1.0, 0.0, -0.75)),
    "hardly by a precession": (0.25, -1.0, (1.0, 1e-9, 1.0, 1.0, 0.0, -0.75)),
    "an equilibrium beside": (1.0, -1.0, (1.75, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a double root outside": (2.0, -1.0, (2.75, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a triple root": (0.75, -1.0, (1.5, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "a triple root at the pole": (-3.0, -2.0, (-2.0, 0.0, 2.0, 1.0, 0.0, 0.0)),
    "an ulp from a triple root": (0.75, math.nextafter(-1.0, 0.0), (1.5, 0.0, 1.0, 1.0, 0.0, -0.75)),
    "from pole to pole": (0.0, 1.0, (0.0, 0.75, 0.0, 0.75, 0.0, 1.0)),
}
STATES = {
    **{name: (named.alpha, 0.0, named.y0) for name, named in TOPS.items()},
    **{name: (find(name)[0].alpha, 0.0, tuple(find(name)[1])) for name in WIDE[:3]},
    **{name: (alpha, 0.0, y0) for name, (alpha, y0) in SPECIAL.items()},
    **TIDES,
}


def in_tide(alpha, k):
    return PerturbedTop(LagrangeTop(alpha), POTENTIALS["tide"], (k, 0.0, 0.0, 1.0)) if k else LagrangeTop(alpha)


@pytest.mark.parametrize("case", STATES)
def test_states_follow_the_equations_of_motion(case):
    """Near the separatrix 50 digits of integration lose 10. Far away digits are the truth of doubles, but on the separatrix."""
    alpha, k, y0 = STATES[case]
    top, size = in_tide(alpha, k), math.hypot(*y0[3:])
    # `scales` knows nothing of a force that is 0 at the start
    rate = math.hypot(*y0[:3]) + math.sqrt(abs(alpha) * size) + math.sqrt(abs(k)) * size or 1.0
    sizes = np.repeat((rate, size), 3)
    times = (-1 if len(case) % 2 else 1) * np.array((0.2, 2.0, 12.0)) / rate
    reference = flows(alpha, y0, times, 50, k)
    assert largest((exact.solution(top, y0, times, digits=34) - reference) / sizes) < 1e-33
    node = motion_of(top, y0).node
    far = np.array((1e2, -1e3, 3e4, -1e6) if node is None else (1e2, -1e3)) / rate
    times = np.concatenate((times, [0.0], far))
    closed = exact.solution(top, y0, times, digits=25)
    assert largest((closed[:3] - reference) / sizes) < 1e-24
    assert largest((closed[3] - y0) / sizes) < 1e-24
    assert largest((exact.solution(top, y0, times) - closed) / sizes) < (PROVEN if node is None else TABLE)
    assert largest((exact.solution(top, y0, np.resize(times, MANY))[: len(times)] - closed) / sizes) < TABLE


@pytest.mark.parametrize("case", STATES)
def test_enclosures_contain_what_more_digits_enclose(case):
    alpha, k, y0 = STATES[case]
    top, rate = in_tide(alpha, k), math.hypot(*y0[:3]) or 1.0
    times = [0.0, 0.1 / rate, -300.0 / rate, 1e5 / rate][: 4 if motion_of(top, y0).node is None else 3]
    wide, narrow = (exact.enclosure(top, y0, times, digits) for digits in (8, 200))
    with mp.workdps(1000):
        assert np.all(abs(wide.midpoints - narrow.midpoints) + narrow.radii <= wide.radii)
        assert largest(wide.radii) <= 1e-8 * max(math.hypot(*y0[3:]), motion_of(top, y0).scale)


def test_enclosures_of_bodies():
    for case in (CASES["box"], CASES["bruels"]):
        start = case.state[:7]
        ball, y = exact.enclosure(case.body, start, 1.5, 30), exact.solution(case.body, start, 1.5)
        assert largest(ball.midpoints.astype(float) - y) < 1e-15 * largest(y)
        assert largest(ball.radii) < 1e-27
    with pytest.raises(ValueError, match="no closed form"):
        exact.enclosure(CASES["kovalevskaya"].body, CASES["kovalevskaya"].state, 1.0)


def test_doubles_keep_their_accuracy():
    """As long as they resolve the phase: the period is 0.49, n needs more than 26 bits from 3e7 on."""
    named, times = TOPS["fast"], [2.0**27 + 0.25, 1e9 + 0.1, -1.1e13]
    truth = exact.solution(named.top, named.state, times, digits=30)
    assert (
        error(named.top, named.state, exact.solution(named.top, named.state, np.resize(times, MANY))[:3], truth) < TABLE
    )


@pytest.mark.parametrize("named", NUTATING, ids=lambda named: named.name)
def test_after_a_nutation_period_everything_has_turned_by_the_precession(named):
    top, y0 = named.top, named.state
    motion = motion_of(top, y0)
    with workprec(160):
        jump = arb.pi() if named.name in ("planar", "through_pole") else arb(0)  # at the one pole that the axis passes
        period, swept, angle = (as_mpf(v.mid()) for v in (motion.period(), motion.swept(), motion.swept() + jump))
    with mp.workdps(40):
        times = [mpf(v) for v in (-3, 0, 0.7)]
        later = exact.solution(top, y0, [t + period for t in times], digits=30)
        start = [turned(mp.cos(angle), mp.sin(angle), y) for y in exact.solution(top, y0, times, digits=30)]
        assert error(top, y0, later, start) < 1e-29
    assert exact.nutation_period(top, y0) == pytest.approx(float(period), rel=1e-15)
    assert exact.precession_per_nutation(top, y0) == pytest.approx(float(swept), rel=1e-15, abs=1e-15)


def test_regimes_are_told_apart_exactly():
    special = {"regular": "precession", "weightless": "free", "homoclinic": "homoclinic"}
    special |= dict.fromkeys(("sleeping_stable", "sleeping_unstable", "hanging"), "equilibrium")
    for name, named in TOPS.items():
        assert exact.regime(named.top, named.state) == special.get(name, "elliptic")
    for name in ("regular", "homoclinic"):
        for component in range(6):
            named = TOPS[name]
            y0 = named.state  # and one ulp beside it
            y0[component] = np.nextafter(y0[component], np.inf)
            assert exact.regime(named.top, y0) == "elliptic"


LIMITS = [  # alpha and state where there is no nutation or no weight; next to it; how close the periods are
    (1.0, TOPS["regular"].y0, 1.0, (1.5, 2.0**-20, 2.5, 0.75, 0.0, 1.0), 1e-11),
    *((1.0, (0, 0, J, 0, 0, x), 1.0, (0, 0, J, 1e-9, 0, x), 1e-14) for J, x in ((3, 1), (1, -1), (0, -1))),
    (0.0, (1.0, 0.5, 0.25, 0.75, 0.5, 0.25), 1e-30, (1.0, 0.5, 0.25, 0.75, 0.5, 0.25), 1e-15),
]


@pytest.mark.parametrize(("alpha", "y0", "other", "near", "apart"), LIMITS)
def test_periods_are_the_limits_of_others(alpha, y0, other, near, apart):
    top, close = LagrangeTop(alpha), LagrangeTop(other)
    assert exact.nutation_period(top, y0) == pytest.approx(exact.nutation_period(close, near), rel=apart)
    swept, limit = exact.precession_per_nutation(top, y0), exact.precession_per_nutation(close, near)
    jump = (
        np.pi if y0[2] and not any(y0[3:5]) else 0.0
    )  # of an upright spinning top; all pendulums pass through the pole
    assert math.remainder(swept + jump - limit, 2 * np.pi) == pytest.approx(0, abs=max(1e-12, 8 * apart))
    if not any(y0[3:5]):  # upright: the frequency of the linearisation
        frequency = math.sqrt(y0[2] ** 2 - 4 * alpha * y0[5])
        assert exact.nutation_period(top, y0) == pytest.approx(2 * np.pi / frequency, rel=1e-15)


def test_infinite_periods():
    for name in ("homoclinic", "sleeping_unstable"):
        named = TOPS[name]
        assert exact.nutation_period(named.top, named.state) == math.inf
        assert math.isnan(exact.precession_per_nutation(named.top, named.state))
    assert exact.nutation_period(LagrangeTop(1.0), (0, 0, 2, 0, 0, 1)) == math.inf
    assert exact.nutation_period(LagrangeTop(0.0), (0, 0, 0, 0, 0, 1)) == math.inf


@settings(max_examples=25, deadline=None, derandomize=True)
@given(NUMBER, st.tuples(*[NUMBER] * 6), st.sampled_from((0.1, -30.0)))
def test_any_state_is_solved_or_refused(alpha, y0, t):
    top = LagrangeTop(alpha)
    unit = top.scales(y0)[2] if any(y0[3:]) else 1.0
    t = t * unit if math.isfinite(unit) else t
    try:
        start, later = exact.solution(top, y0, [0.0, t])
    except ValueError as refused:
        if "overflow" in str(refused) or "x = 0" in str(refused):
            return
        raise
    bound = BOUND * np.repeat(top.scales(y0)[:2], 3) + 1e-323  # the smallest doubles are 5e-324 apart
    assert np.all(np.abs(start - y0) <= bound)
    if min(top.scales(y0)[:2]) > 1e-290:  # else rounding is not relative
        assert error(top, y0, later, exact.solution(top, y0, t, digits=20)) < BOUND
    length = math.hypot(*y0[3:])
    assert math.hypot(*later[3:]) == pytest.approx(length, rel=BOUND, abs=1e-322)


@pytest.mark.parametrize("name", ["generic", "regular", "weightless"])
def test_after_steps_is_at_the_product_itself(name):
    """At n·h, and not at the double next to it, which is as far off as a good method."""
    named, h, counts = TOPS[name], 0.12345678901234567, [1, 7, 10**3, 10**9, 10**6 + 1]
    with mp.workdps(40):
        times = [mpf(h) * n for n in counts]
    truth = exact.solution(named.top, named.state, times, digits=25).astype(float)
    assert np.max(np.abs(exact.after_steps(named.top, named.state, h, counts) - truth)) < BOUND
    assert np.max(np.abs(exact.after_steps(named.top, named.state, h, np.resize(counts, MANY))[:5] - truth)) < BOUND
    rounded = exact.solution(named.top, named.state, [h * n for n in counts])
    assert np.max(np.abs(rounded - truth)) > 1e-10  # what the test can see


def posed(t, y, p):
    return (y[0] ** 2 + y[1] ** 2 + y[2] ** 2) / 2 + y[5] + p[0] * y[5] * y[5] / 2


def test_a_vertical_tide_is_seen_in_any_formula():
    """V = k x3²/2, but for a function of |x|, in a field alpha."""
    generic = TOPS["generic"]
    factors = Potential("factors", lambda x1, x2, x3, p: (x3 - p[0]) * (x3 + p[0]) / 4 + x1 * 0.0)
    for potential, parameters, alpha, k in (
        (POTENTIALS["tide"], (0.125, 0.0, 0.0, -2.0), 1.0, 0.5),
        (POTENTIALS["quadratic"], (0.25, 0.25, 0.75, 0.0, 0.0, 0.0), 1.0, 0.5),
        (factors, (3.0,), 1.0, 0.5),
    ):
        top = PerturbedTop(generic.top, potential, parameters)
        assert exact.vertical_field(top) == (alpha, k)
        assert truths.name(top) == "exact solution"
        right = exact.solution(in_tide(alpha, k), generic.state, 9.0)
        np.testing.assert_array_equal(exact.solution(top, generic.state, 9.0), right)
    for potential, parameters in (
        ("tide", (0.5, 1e-9, 0.0, 1.0)),
        ("axisymmetric", (0.25, 1e-9)),
        ("quadratic", (0.25, math.nextafter(0.25, 1.0), 0.75, 0.0, 0.0, 0.0)),
    ):
        top = PerturbedTop(generic.top, POTENTIALS[potential], parameters)
        assert truths.name(top) == "reference solution"
        with pytest.raises(ValueError, match="alpha x3"):
            exact.solution(top, generic.state, 1.0)
    assert exact.vertical_field(Problem("tide", "e3", posed, (0.5,))) == (1.0, 0.5)
    timed = Problem("timed", "e3", lambda t, y, p: posed(t, y, p) * (1 + t * 1e-9), (0.5,))
    assert exact.vertical_field(timed) is None
