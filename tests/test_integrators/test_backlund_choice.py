"""The choice of scheme and step by a pilot: the error asked for, at any output times, at a cost that is in proportion."""

import re
from functools import partial

import numpy as np
import pytest

from experiments.measuring import metrics
from integrators import (
    PERTURBED_TOPS,
    POTENTIALS,
    TOPS,
    LagrangeTop,
    PerturbedTop,
    Potential,
    StepError,
    integrate,
    sqrt,
)
from integrators.methods import backlund_choice as bc
from integrators.methods import backlund_splitting as bs
from integrators.truth import exact, reference
from tests.test_integrators.test_backlund_splitting import problem

NAME = "backlund_splitting"
NAMES = ("weak_tide", "moderate_tide", "strong_tide", "magnet", "axisymmetric")
UNITS = 300.0  # of time; the pilot of these tops has 78
pytestmark = [
    pytest.mark.filterwarnings("ignore::integrators.interface.StepWarning"),
    pytest.mark.xdist_group("splitting"),  # kernels are compiled once for the two files about it
]
chosen = partial(integrate, method=NAME)


def error(top, y0, run):
    return float(np.max(metrics.scaled_error(top, y0, run.y, reference.solution(top, y0, run.t).states)))


def step(run):
    scheme, h = re.match(r"(\w+), h = ([-\d.e]+), expected error ", run.work.notes).groups()
    return scheme, float(h)


# ---------------------------------------------------------------- the error asked for


@pytest.mark.parametrize("tol", [1e-6, 1e-9])
@pytest.mark.parametrize("name", NAMES)
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


def test_a_pilot_that_sees_no_error_is_found_out(monkeypatch):
    """Negative control: the bounds above are not met by any step."""
    monkeypatch.setattr(bc, "_distance", lambda a, b, scales: np.full(np.shape(a)[:-1], 1e-16))
    top, y0, unit = problem("strong_tide")
    assert error(top, y0, chosen(top, y0, t=[UNITS * unit], tol=1e-9)) > 1e-8


def test_a_narrow_resonance_of_the_step():
    """docs/perturbed.md, section 6: it lies far below the steps that are refused, and a short pilot does not see it."""
    magnet = Potential("magnet", lambda x1, x2, x3, p: p[0] / sqrt((x1 - 1.5) ** 2 + x2**2 + (x3 + 0.3) ** 2))
    top, T = PerturbedTop(LagrangeTop(-1.0), magnet, (4e-3,)), 342.474
    y0 = np.array((1.0675067012, 0.9490114745, 0.5509228205, 0.37246957301, 0.70953452273, -0.59818657467))
    right = integrate(top, y0, T / 20_000, 20_000, "blanes_moan6").y[-1]

    def error_of(steps):
        return float(metrics.scaled_error(top, y0, integrate(top, y0, T / steps, steps, NAME).y[-1], right))

    shorter, resonant, longer = map(error_of, (3480, 3468, 3460))
    assert resonant > 5 * max(shorter, longer)
    assert exact.nutation_period(top.top, y0) / 25 > T / 3468


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


def test_a_weaker_potential_and_a_larger_error_take_longer_steps():
    found = {}
    for name in ("weak_tide", "moderate_tide", "strong_tide"):
        top, y0, unit = problem(name)
        for tol in (1e-5, 1e-9):
            run = chosen(top, y0, t=[UNITS * unit], tol=tol)
            found[name, tol] = stride(run)
    for tol in (1e-5, 1e-9):
        assert found["weak_tide", tol] > found["moderate_tide", tol] > found["strong_tide", tol]
    assert all(found[name, 1e-5] > found[name, 1e-9] for name, _ in found)
    assert step(chosen(*problem("weak_tide")[:2], t=[100.0], tol=1e-8))[0] == "strang"


# ---------------------------------------------------------------- output times


@pytest.mark.parametrize("name", ["moderate_tide", "magnet"])
def test_on_a_uniform_grid_the_step_divides_the_spacing(name):
    top, y0, unit = problem(name)
    run = chosen(top, y0, t=np.linspace(0.0, 100 * unit, 11), tol=1e-8)
    ratio = 10 * unit / step(run)[1]
    assert ratio == pytest.approx(round(ratio), abs=1e-4)  # h is printed with six digits
    assert np.array_equal(run.y[0], y0)
    assert error(top, y0, run) <= 1e-7


@pytest.mark.parametrize("name", NAMES)
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


def test_a_shorter_step_is_needed(monkeypatch):
    """Negative control: the last whole step itself is not the state at a time between two."""
    top, y0, unit = problem("moderate_tide")

    def careless(stepper, y, grid, work, tol, shorter, scales):
        return right(stepper, y, grid, work, tol, lambda y, h, parts: (y, 0), scales)

    right = bc._at_any
    monkeypatch.setattr(bc, "_at_any", careless)
    assert error(top, y0, chosen(top, y0, t=unit * np.array([20.0, 31.4]), tol=1e-8)) > 1e-3


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


def test_a_time_next_to_nothing():
    top = PERTURBED_TOPS["weak_tide"].top
    run = chosen(top, TOPS["generic"].state, t=[5e-324, -1e-318, 1e-20])
    assert np.allclose(run.y, TOPS["generic"].state, rtol=1e-15)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize("tol", [0.0, -1e-9, 9e-14, 1.0, np.nan, np.inf, "1e-9", True, None])
@pytest.mark.parametrize("top", [TOPS["generic"].top, PERTURBED_TOPS["weak_tide"].top], ids=["uniform", "tide"])
def test_impossible_tolerances(top, tol):
    with pytest.raises(ValueError, match=r"^tol must be"):
        chosen(top, TOPS["generic"].state, t=[1.0], tol=tol)


def test_what_is_below_round_off_is_refused():
    top, y0, unit = problem("moderate_tide")
    with pytest.raises(StepError, match=r"tol = 1e-12 is not reached at t = .* round-off alone .* or another method"):
        chosen(top, y0, t=[3000 * unit], tol=1e-12)
    assert error(top, y0, chosen(top, y0, t=[3 * unit], tol=1e-12)) < 1e-11


def test_a_strong_potential_is_warned_of():
    top, y0, _ = problem("strong_tide")
    strong = PerturbedTop(top.top, POTENTIALS["tide"], (3.0, 1.0, 0.0, 0.0))
    with pytest.warns(bs.StepWarning, match="blanes_moan6 costs less") as caught:
        integrate(strong, y0, t=[1.0], method=NAME, tol=1e-6)
    assert caught[0].filename == __file__
