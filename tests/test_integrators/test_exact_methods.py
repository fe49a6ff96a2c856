"""Methods that are exact in time, at any step: the Bäcklund map as it is sold, the addition theorem, theta functions."""

import math

import numpy as np
import pytest

from lagrange_bench import TOPS, LagrangeTop, StepError, exact, integrate, metrics, prepare, two_point
from lagrange_bench.experiments.measuring.states import WIDE, find
from lagrange_bench.integrators.torus import time_step as ts
from tests.reference import drift
from tests.test_integrators.test_exact import BOUND, STATES

EPS = np.finfo(float).eps


UNSTABLE = ("sleeping_unstable", "near_separatrix", "homoclinic")


@pytest.mark.parametrize("method", ["backlund", "addition_theorem"])
def test_map_follows_the_exact_solution(method):
    """1000 steps, of named tops and random ones; long steps by whole periods. Next to the separatrix the bound grows."""
    for name in (*(name for name in TOPS if method == "backlund" or name not in UNSTABLE), *WIDE[:5]):
        top, y0 = find(name)
        rate, (z1, z2, z3) = top.scales(y0)[0], (z[0] for z in ts.nutation_roots(top.alpha, tuple(y0)))
        close = (z1 - z2) / (z1 - z3) if z1 > z3 else 1.0  # k'² = (e1 − e2)/(e1 − e3)
        for h in (0.03, -0.7, 2.0, 300.0):
            run = integrate(top, y0, h / rate, 1000, method, every=100)
            bound = (1e-13 + 2e-15 * np.abs(run.t) * rate) * (max(1.0, 1e-3 / close) if close > 0 else math.inf)
            assert np.all(run.error() <= bound)


@pytest.mark.parametrize("name", [*TOPS, "released at a tilt"])
def test_invariants_after_millions_of_steps(name):
    """8 eps, at most 16 ulps, of the scale of each; measured 1–2 ulps. J3 is never touched."""
    tilted = LagrangeTop(-0.7), np.array((1.1, 0.9, -2.3, 0.55, 0.45, -1.15))
    top, y0 = (TOPS[name].top, TOPS[name].state) if name in TOPS else tilted
    for h in (0.1, 2.0):
        y = prepare(top, y0, h * top.scales(y0)[2]).advance(y0, 10**6)
        assert np.all(drift(top, y0, y) <= 8 * EPS)
        assert y[2] == y0[2]


BY_THE_VERTICAL = LagrangeTop(0.25), np.array((0.0, 2.0**-18, 3.0, 2.0**-18, 0.0, 1.0)), 0.51


@pytest.mark.parametrize(("top", "y0", "periods"), [(*find("planar_rotation"), 2.5), BY_THE_VERTICAL])
def test_steps_that_come_back_drift_unpinned(top, y0, periods):
    """To one of few states, or nearly, each of which rounds alike every time. 2.5 nutations have no turn on the first top."""
    h = periods * exact.nutation_period(top, y0)
    pinned, unpinned = (prepare(top, y0, h, name).advance(y0, 10**6) for name in ("backlund", "backlund_unpinned"))
    assert 1e-11 < np.max(drift(top, y0, unpinned)) < 1e-10
    assert np.max(drift(top, y0, pinned)) < 4 * EPS


def test_pins_do_not_amplify_round_off_where_the_invariants_are_nearly_dependent():
    """Near the vertical. With residuals in plain doubles the error would be 5e-15."""
    top, y0, n = LagrangeTop(0.25), np.array((0.0, 2.0**-14, 3.0, 2.0**-14, 0.0, 1.0)), 10**5
    h = top.scales(y0)[2]
    error = prepare(top, y0, h, "backlund").advance(y0, n) - exact.after_steps(top, y0, h, [n])[0]
    assert np.max(np.abs(error)) < 1e-15


@pytest.mark.parametrize(
    ("name", "lam"), [("figure2", 500 + 5000j), ("generic", -0.07159512589181724 + 0.6718896187898421j)]
)
def test_far_away_and_at_a_root_of_q_the_map_keeps_the_invariants(name, lam):
    """The root is a simple one, to all digits."""
    top, y = TOPS[name].top, TOPS[name].state
    assert np.max(drift(top, y, two_point(top, y, lam))) < 4e-15


@pytest.mark.parametrize("h", [1e-300, 1e-12, 1e10, -1e13])
def test_extreme_steps(h):
    named = TOPS["generic"]
    y = prepare(named.top, named.state, h).advance(named.state, 3)
    jump = integrate(named.top, named.state, t=[3 * h]).y[0]
    assert np.max(np.abs(y - jump)) < 1e-14 + 1e-15 * min(abs(h), 1e3) + 1e-16 * abs(h)


# ---------------------------------------------------------------- addition theorem and theta functions

GENERIC = TOPS["generic"]


def test_map_refuses_what_it_cannot_do():
    """Steps so long that, next to the separatrix, its denominator vanishes; what it does accept is right."""
    top, y0 = LagrangeTop(1.0), np.array((2.0 + 1e-12, 0.0, 1.0, 1.0, 0.0, -0.75))
    refused = 0
    for h in np.linspace(1.0, 12.0, 12):
        try:
            run = integrate(top, y0, h, 1, "addition_theorem")
        except StepError:
            refused += 1
            continue
        assert run.error()[-1] < 1e-10
    assert refused >= 5
    with pytest.raises(StepError, match="separatrix"):
        prepare(top, y0, 7.0, "addition_theorem")


LATE = np.array([1e-3, 0.5, -3.0, 7.0, 1e2, 1e4, -1e6])


def worst(top, y0):
    times = LATE * 2 / (top.scales(y0)[0] or 1.0)
    return np.max(integrate(top, y0, t=times, method="theta_functions").error())


@pytest.mark.parametrize("name", STATES)
def test_theta_functions_at_any_time(name):
    """On the separatrix too; the bound is the one of the truth itself, up to t = 10⁶."""
    alpha, k, y0 = STATES[name]
    if not k:
        assert worst(LagrangeTop(alpha), np.array(y0)) < BOUND


def test_theta_functions_next_to_special_orbits():
    """Poles, planar motion, precession, vertical J, hardly any weight or spin; next to the vertical it may be refused."""
    for kick in (1e-20, 1e-100):
        for alpha, y0 in (
            (1.0, (1.5, 0.3, 1, 0.1 * kick, kick, -1)),
            (1.0, (1.5, 0.3, 1, 0.1 * kick, kick, 1)),
            (1.0, (2.5, 0, kick, 0, 0.6, -0.8)),
            (1.0, (1.5, kick, 2.5, 0.75, 0, 1)),
            (-1.0, (0, kick, 0.5, 0.48, 0.6, 0.64)),
            (kick, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)),
            (-1.0, (0.3, -0.4, 1 / kick, 0.48, 0.6, 0.64)),
        ):
            assert worst(LagrangeTop(alpha), np.array(y0, dtype=float)) < 1e-14
    with pytest.raises(StepError, match="off the vertical"):
        worst(LagrangeTop(1.0), np.array((1e-100, 0, 3, 0, 0, 1)))


def test_a_run_starts_from_the_state_it_is_given():
    """Also on another torus; and a run is evaluated from its start, not from step to step."""
    stepper = prepare(GENERIC.top, GENERIC.state, 0.1, "theta_functions")
    first = stepper.advance(GENERIC.state, 1000)
    other = np.array((1.0, 0.2, -0.3, 0.0, 0.6, 0.8))
    truth = exact.after_steps(GENERIC.top, other, 0.1, [1000])[0]
    assert metrics.scaled_error(GENERIC.top, other, stepper.advance(other, 1000), truth) < 4e-15
    assert np.array_equal(stepper.advance(GENERIC.state, 1000), first)
