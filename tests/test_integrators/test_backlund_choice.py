"""The choice of scheme and step by a pilot: the error asked for, at any output times, at a cost that is in proportion."""

import re
import warnings
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from lagrange_bench.experiments import perturbed
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, integrate
from lagrange_bench.integrators.methods import backlund_choice as bc
from lagrange_bench.integrators.methods import backlund_splitting as bs
from lagrange_bench.integrators.truth import exact, reference
from tests.test_integrators.test_backlund_splitting import problem

NAME = "backlund_splitting"
UNITS = 300.0  # of time; the pilot of these tops has 78
pytestmark = [
    pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning"),
    pytest.mark.usefixtures("one_degree"),
    pytest.mark.xdist_group("splitting"),  # kernels are compiled once for the two files about it
]
chosen = partial(integrate, method=NAME)


def error(top, y0, run):
    return float(np.max(metrics.scaled_error(top, y0, run.y, reference.solution(top, y0, run.t).states)))


def step(run):
    scheme, h = re.match(r"(\w+), h = ([-\d.e]+), expected error ", run.work.notes).groups()
    return scheme, float(h)


@pytest.mark.parametrize(("name", "tol"), [("weak_tide", 1e-9), ("strong_tide", 1e-6)])
def test_the_error_is_that_asked_for(name, tol):
    top, y0, unit = problem(name)
    run = chosen(top, y0, t=[UNITS * unit], tol=tol)
    assert error(top, y0, run) <= 10 * tol
    # and the run is not much finer than that, unless the step is as long as it may be
    scheme, h = step(run)
    wider = bs.prepare_in_field(top, y0, UNITS * unit / max(round(UNITS * unit / h / 4), 1), scheme=scheme)
    end = wider.advance(y0, round(UNITS * unit / wider.h))
    assert metrics.scaled_error(top, y0, end, reference.solution(top, y0, run.t).states[0]) > 0.3 * tol
    # pilots of three schemes, each of some runs of a quarter of the time; 6000 kicks where the first steps tried are good
    cost = UNITS * unit / h * len(bs.SCHEMES[scheme].b)
    assert cost < run.work.rhs_evals < 12 * cost + 6000


def close_to_a_charge():
    """In the first 64 units the axis comes as near as 0.2, later as 0.03."""
    place = (0.7580321693903884, -0.06423653660933308, -0.6943780652740548)
    top = PerturbedTop(LagrangeTop(1.0), POTENTIALS["charge"], (1.9986239217691903e-06, *place))
    J = 0.036973207474528515, -0.19949174751407084, 0.6726115401587713
    return top, np.array([*J, -0.8623134313733983, -0.5055541329254171, -0.028819520382288254]), 176.20673867153934


def in_resonance():
    """A tenth of its nutation period is a step that beats slowly with the motion."""
    third = Potential("third", lambda x1, x2, x3, p: p[0] * (0.6 * x1 * x2 - 0.4 * x3 * x3 + 0.3 * x1 * x1 * x3))
    J, x = (-0.0233476, 0.0385728, 0.1539092), (-0.0064909713, 0.8459815766, -0.5331726169)
    return PerturbedTop(LagrangeTop(-1.0), third, (1e-5,)), np.array([*J, *x]), 2154.47


@pytest.mark.parametrize(
    ("case", "tol"), [(close_to_a_charge, 1e-8), pytest.param(in_resonance, 1e-6, marks=pytest.mark.slow)]
)
def test_a_step_that_h_contradicts_is_not_taken(case, tol, monkeypatch):
    top, y0, t = case()
    run = chosen(top, y0, t=[t], tol=tol)
    assert error(top, y0, run) <= tol
    assert "H moved by" in run.work.notes
    monkeypatch.setattr(bc, "DOUBT", np.inf)  # negative control: without the guard the error is what the audit found
    monkeypatch.setattr(bc, "SENSITIVE", np.inf)
    assert error(top, y0, chosen(top, y0, t=[t], tol=tol)) > 10 * tol


def test_what_stays_wrong_is_refused(monkeypatch):
    monkeypatch.setattr(bc, "RUNS", 2)
    top, y0, t = close_to_a_charge()
    with pytest.raises(StepError, match=r"tol = 1e-08 is not reached at t = 176.207: .* take method='taylor'"):
        chosen(top, y0, t=[t], tol=1e-8)


@pytest.mark.parametrize("case", [close_to_a_charge, in_resonance])
def test_a_fixed_step_is_watched(case):
    """It warns where H moves by more than in the first steps, and not on the same motion with a step that is good."""
    top, y0, t = case()
    period = exact.nutation_period(top.top, y0)
    long, short = (period / 10, period / 13.5) if case is in_resonance else (0.0559, 0.003)
    with pytest.warns(bs.StepWarning, match=r"H moves by .* times as far as in the first steps") as caught:
        integrate(top, y0, t / round(t / long), round(t / long), NAME)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        integrate(top, y0, t / round(t / short), round(t / short), NAME)


def test_tops_drawn_at_random():
    """None is wrong in silence, few are refused, and what is expected is near: 16 tops near charges, 8 in tides, 300 units."""
    near = refused = 0
    for field, count in (("random charges", 16), ("random tides", 8)):
        for number in range(100, 100 + count):
            top, y0 = perturbed.random_top(field, number)
            t = [UNITS * top.scales(y0)[2]]
            try:
                run = chosen(top, y0, t=t, tol=1e-8)
            except StepError:
                refused += 1
                continue
            right = integrate(top, y0, t=t, method="taylor").y
            true = float(metrics.scaled_error(top.top, y0, run.y, right)[0])
            assert true <= 1e-7
            near += 0.1 <= run.work.expected / true <= 10
    assert refused <= 4
    assert near >= 0.85 * (24 - refused)


def test_the_error_is_extrapolated_to_the_end():
    """Ten times the pilot's length at least; a step chosen for a short time is too long here."""
    top, y0, unit = problem("moderate_tide")
    long = chosen(top, y0, t=[3000 * unit], tol=1e-8)
    short = chosen(top, y0, t=[30 * unit], tol=1e-8)
    assert error(top, y0, long) <= 1e-7
    assert stride(long) < stride(short)


def stride(run):
    """Time for each kick."""
    scheme, h = step(run)
    return h / len(bs.SCHEMES[scheme].b)


def test_on_a_uniform_grid_the_step_divides_the_spacing():
    top, y0, unit = problem("moderate_tide")
    run = chosen(top, y0, t=np.linspace(0.0, 100 * unit, 11), tol=1e-8)
    ratio = 10 * unit / step(run)[1]
    assert ratio == pytest.approx(round(ratio), abs=1e-4)  # h is printed with six digits
    assert np.array_equal(run.y[0], y0)
    assert error(top, y0, run) <= 1e-7


@pytest.mark.parametrize("name", ["strong_tide", "axisymmetric"])
def test_at_any_times(name):
    """In any order, on both sides of 0, closer together than the step."""
    top, y0, unit = problem(name)
    t = unit * np.array([31.4, -2.0, 0.0, 1e-6, 0.013, 31.4, -77.7, 31.41])
    run = chosen(top, y0, t=t, tol=1e-8)
    assert error(top, y0, run) <= 1e-7
    assert np.array_equal(run.y[2], y0)
    assert np.array_equal(run.y[0], run.y[5])
    assert run.work.notes.count("h = -") == 1
    close = chosen(top, y0, t=unit * np.linspace(0.0, 3.0, 601), tol=1e-8)
    assert error(top, y0, close) <= 1e-7
    if "J3" in top.conserved:
        assert np.ptp(close.y[:, 2]) == 0.0


def test_without_a_potential_it_is_the_exact_step():
    top, y0 = TOPS["generic"].top, TOPS["generic"].state
    t = [0.0, 1.0, -3.3, 1000.0]
    run = chosen(top, y0, t=t, tol=1e-3)
    assert np.array_equal(run.y, integrate(top, y0, t=t).y)
    assert run.work.notes == "one exact step to each time"
    nothing = PerturbedTop(top, POTENTIALS["axisymmetric"], (0.0, 0.0))  # what other tests here compile, too
    assert metrics.scaled_error(top, y0, chosen(nothing, y0, t=t).y, exact.solution(top, y0, t)).max() < 1e-11


def test_where_there_is_little_to_follow():
    tide = POTENTIALS["tide"]
    resting = PerturbedTop(LagrangeTop(1.0), tide, (0.01, 1.0, 0.0, 0.0))
    hanging = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    run = chosen(resting, hanging, t=[0.0, 1e6, -5.0])
    assert np.array_equal(run.y, np.tile(hanging, (3, 1)))
    assert "an equilibrium" in run.work.notes
    assert chosen(resting, hanging, t=[]).y.shape == (0, 6)
    weightless = PerturbedTop(LagrangeTop(0.0), tide, (0.3, 0.6, 0.0, 0.8))
    y0 = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    assert error(weightless, y0, chosen(weightless, y0, t=[7.0, 9.5], tol=1e-7)) < 1e-6


def test_what_is_below_round_off_is_refused():
    top, y0, unit = problem("moderate_tide")
    with pytest.raises(StepError, match=r"tol = 1e-12 is not reached at t = .* round-off alone .* or another method"):
        chosen(top, y0, t=[3000 * unit], tol=1e-12)
    assert error(top, y0, chosen(top, y0, t=[3 * unit], tol=1e-12)) < 1e-11


@pytest.mark.slow
def test_an_instability_that_comes_late():
    """What docs/perturbed.md says that the pilot does not see."""
    top, y0, unit = problem("triaxial")
    run = chosen(top, y0, t=[3000 * unit], tol=1e-6)
    assert error(top, y0, run) > 1e-5


@pytest.mark.parametrize(("power", "growth"), [(1, 10.0), (2, 10.0), (3, 100.0)])
def test_an_error_that_grows_faster_than_t2_is_taken_to_grow_like_t2(power, growth):
    """From a pilot of 16 units of time to a run of 160."""
    pilot = object.__new__(bc._Pilot)
    pilot.span, pilot.last, pilot.unit, pilot.scales = 16.0, 160.0, 1.0, np.ones(2)
    pilot.candidate = SimpleNamespace(cost=1.0)
    exact, rows = np.zeros((17, 6)), np.zeros((17, 6))
    rows[:, 0] = (np.arange(17) / 16) ** power * 1e-6
    error, expected = pilot.errors((rows, None), (exact, None), 1)
    assert expected / error == pytest.approx(growth)
