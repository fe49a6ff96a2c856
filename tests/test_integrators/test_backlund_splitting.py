"""The exact step inside a splitting: schemes, corrector, tables, what it keeps, and which step is taken for an error."""

import math
import random
import re
import warnings
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench import (
    PERTURBED_TOPS,
    POTENTIALS,
    TOPS,
    LagrangeTop,
    PerturbedTop,
    Problem,
    StepError,
    cos,
    metrics,
    sin,
)
from lagrange_bench.integrators import integrate, prepare
from lagrange_bench.integrators.compiling.tape import bandwidth, record
from lagrange_bench.integrators.interface import StepWarning
from lagrange_bench.integrators.methods import backlund_splitting as bs
from lagrange_bench.integrators.methods import step_halving
from lagrange_bench.integrators.torus import step_table
from tests.reference import drift

NAME = "backlund_splitting"
ORDERS = {"strang": 2, "processed6": 2, "aba864": 8}  # in the first power of the perturbation
pytestmark = [
    pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning"),
    pytest.mark.usefixtures("one_degree"),
]


@pytest.fixture
def one_degree(monkeypatch):
    """Tables of one degree, in which higher coefficients are 0: there is a kernel for each degree."""
    monkeypatch.setattr(step_table, "DEGREES", step_table.DEGREES[-1:])


def problem(name, units=1.0):
    named = PERTURBED_TOPS[name]
    return named.top, named.state, units * named.top.scales(named.state)[2]


@pytest.mark.parametrize("name", bs.SCHEMES)
def test_schemes_integrate_the_perturbation_to_their_order(name):
    """To first order in ε a scheme is a quadrature of V along the flow: exact for polynomials below its first order."""
    scheme, order = bs.SCHEMES[name], ORDERS[name]
    nodes = np.cumsum([Fraction(w) for w in scheme.a])[:-1] - Fraction(1, 2)
    moments = [Fraction((k + 1) % 2, (k + 1) * 2**k) for k in range(order + 1)]
    defects = [
        abs(float(np.array(list(map(Fraction, scheme.b))) @ nodes**k - moment)) for k, moment in enumerate(moments)
    ]
    assert max(defects[:order]) < 1e-15
    assert defects[order] > 1e-7  # and no more


def test_degrees_of_the_tables(monkeypatch):
    monkeypatch.undo()  # tables of every degree
    text = (Path(__file__).parents[2] / "docs" / "perturbed.md").read_text("utf-8")
    (shown,) = re.findall(r"^\| degree \| (.*) \|$", text, re.MULTILINE)
    starts = map(problem, ("tide_1e-6", "weak_tide", "moderate_tide", "strong_tide"))
    found = [prepare(top, y0, 0.5 * unit, NAME).degree for top, y0, unit in starts]
    assert [int(word) for word in shown.split(" | ")] == found


@pytest.mark.parametrize("scheme", bs.SCHEMES)
def test_outside_of_its_box_a_table_is_not_used(scheme, monkeypatch):
    """And λ, computed in place, agrees with the one of the table."""
    top, y, unit = problem("weak_tide")
    tabled = prepare(top, y, 0.25 * unit, NAME, scheme=scheme)
    monkeypatch.setattr(bs.kernels, "MARGIN", 0.2)
    small = prepare(top, y, 0.25 * unit, NAME, scheme=scheme)
    assert min(tabled.degree, small.degree) > 0
    assert metrics.scaled_error(top, y, tabled.advance(y, 400), small.advance(y, 400)) < 1e-12
    assert tabled.work.iterations == 0
    assert 0 < small.work.iterations < 400 * len(bs.SCHEMES[scheme].b)


@pytest.mark.parametrize("scheme", bs.SCHEMES)
def test_it_is_poisson_and_symmetric(scheme):
    top, y, unit = problem("moderate_tide")
    for h in (0.5 * unit, -0.25 * unit):
        defect = metrics.poisson_defect(lambda z, h=h: prepare(top, z, h, NAME, scheme=scheme).advance(z, 1), top, y)
        assert defect.defect < 1e-8
        there = prepare(top, y, h, NAME, scheme=scheme).advance(y, 5)
        back = prepare(top, there, -h, NAME, scheme=scheme).advance(there, 5)
        assert metrics.scaled_error(top, y, back, y) < 1e-13


@pytest.mark.parametrize("name", ["moderate_tide", "separatrix_tide"])
def test_the_energy_error_does_not_grow(name):
    """At the separatrix λ(H, J3) is not smooth: no table, or none of its digits, and the step is exact all the same."""
    top, y, h = problem(name, 0.5)
    run = integrate(top, y, h, 100_000, NAME, every=100)
    off = drift(top, y, run.y)
    assert off[:, 2:].max() < 64 * 2.0**-52
    early, late = off[1:334, 0].max(), off[-333:, 0].max()
    assert late < 1.5 * early
    assert early < (1e-7 if name == "moderate_tide" else 1e-3)


def test_it_says_where_it_is_the_wrong_method():
    top, y, unit = problem("strong_tide")
    with pytest.warns(StepWarning, match="blanes_moan6 costs less"):
        prepare(PerturbedTop(top.top, POTENTIALS["tide"], (3.0, 1.0, 0.0, 0.0)), y, 0.1 * unit, NAME)
    with pytest.warns(StepWarning, match="near resonance"):
        prepare(top, y, 1.5 * unit, NAME)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prepare(*problem("weak_tide")[:2], 0.25 * unit, NAME)
    with pytest.raises(StepError, match="in resonance with it; take less than a half"):
        prepare(top, y, 12 * unit, NAME)


chosen = partial(integrate, method=NAME)


def error(top, y0, run):
    right = integrate(top, y0, t=run.t, method="taylor").y
    return float(np.max(metrics.scaled_error(top, y0, run.y, right)))


def close_to_a_charge():
    """In the first 64 units the axis comes as near as 0.2, later as 0.03."""
    place = (0.7580321693903884, -0.06423653660933308, -0.6943780652740548)
    top = PerturbedTop(LagrangeTop(1.0), POTENTIALS["charge"], (1.9986239217691903e-06, *place))
    J = 0.036973207474528515, -0.19949174751407084, 0.6726115401587713
    return top, np.array([*J, -0.8623134313733983, -0.5055541329254171, -0.028819520382288254]), 176.20673867153934


@pytest.mark.parametrize(
    ("case", "tol"),
    [
        (problem("strong_tide", 300), 1e-6),
        (problem("fast_tide", 300), 1e-12),
        (problem("triaxial", 3000), 1e-6),  # unstable, late
        (close_to_a_charge(), 1e-8),
    ],
)
def test_the_error_is_at_most_the_one_asked_for(case, tol):
    """Also where what perturbs it comes close, long after the start."""
    top, y0, t = case
    assert error(top, y0, chosen(top, y0, t=[t], tol=tol)) <= tol


@pytest.mark.parametrize(
    ("values", "runs", "difference"),
    [
        ((1.0, 1.0 + 1e-9, 0.9, 0.89, 0.889, 0.88895), 6, 5e-5),  # two agree by chance
        ((None, None, 0.9, 0.9, 0.9), 5, 0.0),
        (((0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (0.0, 0.0)), 4, 0.0),  # the second agrees at the end alone
    ],
)
def test_runs_agree_by_two_halvings(values, runs, difference):
    """Runs of one state whose J1 takes these values, one after the other; None: the step cannot be taken."""
    given = iter(values)

    def run(finer):
        if (value := next(given)) is None:
            raise StepError(NAME, "too long")
        return np.outer(np.atleast_1d(value), np.eye(6)[0])

    rows, halved, found = step_halving.agreeing_run(NAME, run, 1e-4, (1.0, 1.0))
    assert halved == runs - 1
    assert np.array_equal(rows[:, 0], np.atleast_1d(values[halved]))
    assert found == pytest.approx(difference, abs=1e-12)


@pytest.mark.parametrize(("name", "units", "tol"), [("weak_tide", 3000, 1e-13), ("chaotic", 1500, 1e-8)])
def test_what_is_below_round_off_or_chaotic_is_refused(name, units, tol):
    top, y0, t = problem(name, units)
    with pytest.raises(StepError, match=f"tol = {tol} is not reached: .*; take .*'taylor'"):
        chosen(top, y0, t=[t], tol=tol)


def test_at_any_times():
    """In any order, on both sides of 0, closer together than the step, or than a double can tell."""
    top, y0, unit = problem("axisymmetric")
    t = unit * np.array([31.4, -2.0, 0.0, 1e-6, 0.013, 31.4, -77.7, 31.41])
    run = chosen(top, y0, t=[*t, 5e-324], tol=1e-8)
    assert error(top, y0, run) <= 1e-8
    assert np.array_equal(run.y[[2, 8]], [y0, y0])
    assert np.array_equal(run.y[0], run.y[5])
    assert np.ptp(run.y[:, 2]) == 0.0


def test_where_there_is_little_to_follow():
    """Without a potential it is the exact step."""
    named, t = TOPS["generic"], [0.0, 1.0, -3.3, 1000.0]
    assert np.array_equal(chosen(named.top, named.state, t=t).y, integrate(named.top, named.state, t=t).y)
    top, hanging = PerturbedTop(LagrangeTop(1.0), POTENTIALS["tide"], (0.01, 1.0, 0.0, 0.0)), np.eye(6)[5] * -1.0
    assert np.array_equal(chosen(top, hanging, t=[0.0, 1e6, -5.0]).y, np.tile(hanging, (3, 1)))


# ---------------------------------------------------------------- H that depends on time


def drive(t, y, p):
    """A drive of the size p0, the frequency p1 and the phase p2."""
    x1, x2, x3 = y[3:]
    form = p[3] * x1 * x3 * x3 + p[4] * x1 * x2 + p[5] * x3
    return y[:3] @ y[:3] / 2.0 + p[6] * x3 + p[0] * cos(p[1] * t + p[2]) * form


def test_random_drives_are_followed_or_warned_about():
    """Frequencies from 0.1 to 50, steps from 0.01 to 1. Without a warning the error is a thousandth of what the drive does."""
    draw, silent = random.Random(1), 0

    def warned(problem, y0, steps):
        """The end of a run to t = 64, and whether it warned."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            end = integrate(problem, y0, h=64.0 / steps, steps=steps, method=NAME).y[-1]
        return end, any("near resonance" in str(warning.message) for warning in caught)

    for _ in range(16):
        top = LagrangeTop(draw.choice((-1.0, 1.0)))
        J, x, form = (np.array([draw.gauss(0.0, 1.0) for _ in range(3)]) for _ in range(3))
        y0 = np.concatenate((J, x / np.linalg.norm(x)))
        size, frequency = 10.0 ** draw.uniform(-6, -2), 10.0 ** draw.uniform(-1, math.log10(50))
        problem = Problem("drive", "e3", drive, (size, frequency, 1.0, *form, top.alpha))
        right, still = (integrate(one, y0, t=[64.0], method="taylor").y[0] for one in (problem, top))
        try:
            end, said = warned(problem, y0, round(64 / 10.0 ** draw.uniform(-2, 0)))
        except StepError:
            continue
        silent += not said
        assert said or metrics.scaled_error(top, y0, end, right) < 1e-3 * metrics.scaled_error(top, y0, still, right)
        found = chosen(problem, y0, t=[10.0, 64.0], tol=1e-8).y[1]
        assert metrics.scaled_error(top, y0, found, right) < 1e-8
    assert silent >= 8


def test_frequencies_are_read_off_the_formula():
    program = record(lambda t, p: (cos(p * t + 1.0) ** 3 / (2.0 + sin(t)),), 2)
    assert bandwidth(program, 0, (np.linspace(0.0, 20.0, 999), 9.0)) == pytest.approx(28.0, rel=1e-3)
