"""Backward error analysis: power series of steps are those steps, and runs go wrong as predicted."""

from dataclasses import replace

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.phase import theory_steps
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, exact, integrate, predicted_phase, prepare
from lagrange_bench.integrators.backward_error.prediction import local_error
from lagrange_bench.integrators.backward_error.steps import STEPS

TOP, Y0 = LagrangeTop(0.9), np.array([0.5, -0.7, 0.3, 0.6, -0.3, 0.5])
SLOW, Z0 = LagrangeTop(0.9 / 4), Y0 / (2, 2, 2, 1, 1, 1)  # the same in the units of `Units`


def series(name, top, y, h):
    return local_error(top, y[None], h, METHODS[name])[0]


@pytest.mark.interpreted
@pytest.mark.parametrize("name", STEPS)
def test_the_series_of_a_step_is_the_step(name):
    h = theory_steps(METHODS[name].order)[1] * (1.1 if name == "verner9_projected" else 1.4)
    step = prepare(SLOW, Z0, h, name).advance(Z0, 1) - exact.solution(SLOW, Z0, h)
    size = np.max(np.abs(step))
    assert size > 5e-15
    assert np.max(np.abs(series(name, SLOW, Z0, h) - step)) < 1e-3 * size + 2e-15
    assert np.max(np.abs(series(name, SLOW, Z0, 0.9 * h) - step)) > 0.1 * size, "negative control"


RUNS = [  # a method, its step, steps, its error at least, what theory leaves at most: as a share, or at all
    ("backlund_paper", -0.1, 32_000, 0.5, 0.0, 1e-10),
    ("strang", 0.01, 30_000, 1e-5, 1e-4, 0.0),
    ("implicit_midpoint", 0.05, 100_000, 0.1, 0.02, 0.0),
    ("rk4", 0.05, 6_000, 1e-5, 1e-4, 0.0),
    # all modes of number 16, 32, … have the same phase at every step
    ("rkmk4", exact.nutation_period(TOP, Y0) / 16, 800, 1e-3, 0.01, 0.0),
]


@pytest.mark.parametrize(("name", "h", "steps", "least", "share", "rest"), RUNS)
def test_theory_takes_the_error_away(name, h, steps, least, share, rest):
    """Symmetric or not, drifting or not, backwards too; of the two-point map it leaves round-off."""
    n = steps // 16 * np.arange(1, 17)
    run = integrate(TOP, Y0, h=h, steps=int(n[-1]), method=name, every=int(n[0]))
    predicted = predicted_phase(TOP, Y0, h, name)
    assert run.error().max() > least
    left = metrics.scaled_error(TOP, Y0, run.y[1:], predicted.states(h * n)).max()
    assert left < share * run.error().max() + rest


def test_theory_needs_errors_below_the_nutation():
    """A top that nods by 0.015: at an error of 6e-3 theory leaves a fifth of it, with an eighth of the step next to nothing."""
    top = LagrangeTop(0.44297347914548224)
    y0 = np.array((0.01, 0.02, 1.503358966490317, 0.009716099430588352, 0.004858049715294176, 0.4858049715294176))
    left = {}
    for share in (1, 8):
        h, n = 0.90952 * top.scales(y0)[2] / share, share * 35 * np.arange(1, 17)
        run = integrate(top, y0, h=h, steps=int(n[-1]), method="rk4", every=int(n[0]))
        predicted = predicted_phase(top, y0, h, "rk4")
        left[share] = metrics.scaled_error(top, y0, run.y[1:], predicted.states(h * n)).max() / run.error().max()
    assert left[1] > 0.1
    assert left[8] < 1e-3


@pytest.mark.parametrize("name", ["strang", "force_gradient4", "rkmk4"])
def test_a_method_that_is_exact_without_weight_has_no_phase_error(name):
    named = TOPS["weightless"]
    found = predicted_phase(named.top, named.state, 0.05, name)
    assert (found.clock, found.turn, found.clock_growth, found.turn_growth) == (0.0, 0.0, 0.0, 0.0)
    assert predicted_phase(named.top, named.state, 0.05, "rk4").clock != 0.0  # negative control
    assert predicted_phase(TOP, Y0, 0.1, "backlund").clock == 0.0  # of an exact one: that it is exact


@pytest.mark.parametrize(
    ("state", "name", "h", "reason"),
    [
        ("homoclinic", "strang", 0.1, "no period"),
        ("regular", "strang", 0.1, "regular precession"),
        ("generic", "taylor", 0.1, "chooses its own steps"),
        ("generic", "strang", 50.0, "does not converge"),
        ("weightless", "backlund_paper", 1e-300, "time scales"),
        ("generic", replace(METHODS["rk4"], name="stranger"), 0.1, "no power series of a step"),
    ],
)
def test_why_there_is_no_prediction(state, name, h, reason):
    with pytest.raises(ValueError, match=reason):
        predicted_phase(TOPS[state].top, TOPS[state].state, h, name)
