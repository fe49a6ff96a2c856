"""The other exact ways: the addition theorem's rational map, and theta functions at any time."""

import numpy as np
import pytest

from lagrange_bench import TOPS, LagrangeTop, StepError, exact, integrate, metrics, prepare
from lagrange_bench.experiments.measuring.states import WIDE, find
from tests.test_integrators.test_exact import BOUND, STATES

GENERIC = TOPS["generic"]
UNSTABLE = ("sleeping_unstable", "near_separatrix", "homoclinic")


@pytest.mark.parametrize("h", [0.03, -0.7, 300.0])
def test_map_follows_the_exact_solution(h):
    """The promise of the exact Bäcklund step, over 1000 steps; named tops, and random ones. Beyond T/2 by whole periods."""
    for name in (*set(TOPS).difference(UNSTABLE), *WIDE[:5]):
        top, y0 = find(name)
        rate = top.scales(y0)[0]
        run = integrate(top, y0, h / rate, 1000, "addition_theorem", every=100)
        assert np.all(run.error() <= 1e-13 + 2e-15 * np.abs(run.t) * rate)


def test_without_pins_the_map_leaves_its_torus_and_says_so():
    with pytest.raises(StepError, match="left the torus"):
        prepare(GENERIC.top, GENERIC.state, 0.4, "addition_theorem", pin=0).advance(GENERIC.state, 400)


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


def test_a_long_step_close_to_the_unstable_vertical_has_its_turn():
    """The precession of the map itself, two halves of a nutation, was off by 1e-7 and more there."""
    top, h = LagrangeTop(-0.3478474207437309), 50.0
    y0 = np.array([-2.05348e-06, -2.56570e-06, -0.3800268718527828, 9.84613e-08, -3.13748e-08, -1.104986429927274])
    for method in ("backlund", "addition_theorem"):
        y = prepare(top, y0, h, method).advance(y0, 1)
        assert metrics.scaled_error(top, y0, y, exact.solution(top, y0, h)) < 1e-13


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


@pytest.mark.parametrize("kick", [1e-20, 1e-100])
def test_theta_functions_next_to_special_orbits(kick):
    """Poles, planar motion, precession, vertical J, hardly any weight or spin; next to the vertical it may be refused."""
    for alpha, y0 in (
        (1.0, (1.5, 0.3, 1, 0.1 * kick, kick, -1)),
        (1.0, (1.5, 0.3, 1, 0.1 * kick, kick, 1)),
        (1.0, (2.5, 0, kick, 0, 0.6, -0.8)),
        (1.0, (1.5, kick, 2.5, 0.75, 0, 1)),
        (-1.0, (0, kick, 0.5, 0.48, 0.6, 0.64)),
        (kick, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64)),
        (-1.0, (0.3, -0.4, 1 / kick, 0.48, 0.6, 0.64)),
        (1.0, (1e-20, 0, 3, 0, 0, 1)),
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
