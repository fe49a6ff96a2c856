"""The exact step inside a splitting: schemes, corrector, tables, what it keeps; and how a pilot chooses scheme and step."""

import math
import re
import warnings
from fractions import Fraction
from functools import partial
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

from lagrange_bench import PERTURBED_TOPS, POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, metrics
from lagrange_bench.experiments import perturbed
from lagrange_bench.integrators import exact, integrate, prepare, reference
from lagrange_bench.integrators.methods import backlund_choice as bc
from lagrange_bench.integrators.methods import backlund_schemes, fitted_corrector
from lagrange_bench.integrators.methods import backlund_splitting as bs
from lagrange_bench.integrators.torus import step_table
from tests.reference import drift

NAME = "backlund_splitting"
ORDERS = {
    "strang": (2, 2),
    "processed6": (2, 2),
    "saba4": (8, 2),
    "aba84": (8, 4),
    "aba104": (10, 4),
    "aba864": (8, 6),
    "aba1064": (10, 6),
}
pytestmark = [
    pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning"),
    pytest.mark.usefixtures("one_degree"),
]


@pytest.fixture
def one_degree(monkeypatch):
    """Tables of one degree, in which higher coefficients are 0: there is a kernel for each degree."""
    monkeypatch.setattr(step_table, "DEGREES", step_table.DEGREES[-1:])


def problem(name):
    named = PERTURBED_TOPS[name]
    return named.top, named.state, named.top.scales(named.state)[2]


@pytest.mark.parametrize("name", bs.SCHEMES)
def test_schemes_integrate_the_perturbation_to_their_order(name):
    """To first order in ε a scheme is a quadrature of V along the flow: exact for polynomials below its first order."""
    a, b, *_ = bs.SCHEMES[name]
    nodes, order = np.cumsum([Fraction(w) for w in a])[:-1] - Fraction(1, 2), ORDERS[name][0]
    moments = [Fraction((k + 1) % 2, (k + 1) * 2**k) for k in range(order + 1)]
    defects = [abs(float(np.array(list(map(Fraction, b))) @ nodes**k - moment)) for k, moment in enumerate(moments)]
    assert max(defects[:order]) < 1e-15
    assert defects[order] > 1e-7  # and no more


def oscillator(name, h, eps, t=3.0):
    """The error of p²/2 + q²/2 + ε q²/2 with the flow of ε = 0 exact; 2 × 2 matrices in extended precision."""
    a, b, *_ = bs.SCHEMES[name]
    a, b = ([mpmath.mpf(w) / sum(map(mpmath.mpf, part)) for w in part] for part in (a, b))
    n, h, step = round(t / h), mpmath.mpf(h), mpmath.eye(2)
    for i, part in enumerate(a):
        c, s = mpmath.cos(part * h), mpmath.sin(part * h)
        step = mpmath.matrix([[c, s], [-s, c]]) * step
        if i < len(b):
            step = mpmath.matrix([[1, 0], [-eps * b[i] * h, 1]]) * step
    w = mpmath.sqrt(1 + mpmath.mpf(eps))
    c, s = mpmath.cos(w * n * h), mpmath.sin(w * n * h)
    return step**n - mpmath.matrix([[c, s / w], [-w * s, c]])


@pytest.mark.parametrize("name", bs.SCHEMES)
def test_schemes_have_their_order_in_the_square_of_the_perturbation(name):
    """The part of the error that is even in ε, ε² and higher, falls like the second number of the scheme."""
    with mpmath.workdps(40):
        eps = mpmath.mpf(10) ** -6
        errors = [mpmath.norm(oscillator(name, h, eps) + oscillator(name, h, -eps)) for h in (0.25, 0.125)]
        assert float(mpmath.log(errors[0] / errors[1], 2)) == pytest.approx(ORDERS[name][1], abs=0.3)


@pytest.mark.parametrize("name", bs.PROCESSED)
def test_the_corrector_fits_the_boundary_term(name):
    chosen = bs.SCHEMES[name]
    b, times = backlund_schemes.corrector_kicks(chosen), np.cumsum(chosen.a)[:-1] - 0.5
    for w, bound in ((0.3, 1e-11), (0.65, 5e-11), (1.3, 1e-9), (2.0, 1e-8), (3.0, 1e-6)):
        assert abs(boundary(b, backlund_schemes.SPACING, w, np.cos(w * times) @ chosen.b)) < bound


def boundary(b, spacing, w, kicks=1.0):
    """By how much a corrector misses the boundary term of the harmonic w, whose part in the kicks of a step is `kicks`."""
    made = 2 * sum(kick * math.sin(spacing * j * w) for j, kick in enumerate(b, 1))
    return made - (kicks / (2 * math.sin(w / 2)) - 1 / w)


@pytest.mark.parametrize("steps", [8.5, -9.1])
def test_a_fitted_corrector_fits_the_harmonics_of_its_motion(steps):
    """Those of a planar pendulum are multiples of one frequency: they are not told to the fit, which has V along the motion."""
    y0 = np.array(TOPS["planar"].y0)
    top = PerturbedTop(TOPS["planar"].top, POTENTIALS["tide"], (1e-4, 0.6, 0.0, 0.8))
    h = bc.nutation_period(top, y0) / steps
    fitted = fitted_corrector.fitted_kicks(top.formula.perturbation, y0, np.array(top.numbers), h)
    general = backlund_schemes.corrector_kicks(bs.SCHEMES["strang"])
    harmonics = [2 * math.pi * k / abs(steps) for k in range(1, 8)]
    missed = [abs(boundary(fitted, fitted_corrector.SPACING, w)) for w in harmonics]
    assert max(missed[:3]) < 1e-8
    assert max(missed) < 1e-4
    assert abs(boundary(general, backlund_schemes.SPACING, harmonics[-1])) > 1e-2  # negative control


@pytest.mark.parametrize("h", [1.0, -1.0])
def test_a_fitted_corrector_takes_away_what_long_steps_leave(h):
    top, y, unit = problem("weak_tide")
    right = integrate(top, y, t=[400 * h * unit], method="taylor").y
    stepper = prepare(top, y, h * unit, NAME, corrector="fitted")
    errors = [
        metrics.scaled_error(top, y, s.advance(y, 400), right[0]) for s in (stepper, prepare(top, y, h * unit, NAME))
    ]
    assert errors[0] < 0.05 * errors[1]
    back = stepper.leave(stepper.enter(y)[None])[0]  # its ways are inverse to each other
    np.testing.assert_allclose(back, y, atol=1e-14)


def test_where_v_is_constant_there_is_nothing_to_fit():
    top, y, unit = problem("weak_tide")
    still = PerturbedTop(top.top, POTENTIALS["tide"], (0.0, 1.0, 0.0, 0.0))
    steppers = [prepare(still, y, 0.1 * unit, NAME, corrector=value) for value in (True, "fitted")]
    assert len({s.advance(y, 4).tobytes() for s in steppers}) == 1


@pytest.mark.parametrize(("name", "left"), [("strang", 3), ("processed6", 5)])
def test_the_part_of_second_order_is_right_for_long_times(name, left):
    """Of kicks at the times t_i, in this order whatever the times are, and of kicks by W: 1/w is left as w³, or w⁵."""
    a, b, _, c, *_ = bs.SCHEMES[name]
    with mpmath.workdps(40):
        times = np.cumsum([mpmath.mpf(w) for w in a])[:-1] - mpmath.mpf(1) / 2

        def excess(w):
            pairs = [(i, j) for j in range(len(b)) for i in range(j)]
            within = mpmath.fsum(b[i] * b[j] * mpmath.sin(w * (times[j] - times[i])) for i, j in pairs)
            total = mpmath.fsum(k * mpmath.cos(w * t) for k, t in zip(b, times, strict=True))
            return within + total**2 * mpmath.cot(w / 2) / 2 + 2 * sum(map(mpmath.mpf, c)) * w - 1 / w

        w = mpmath.mpf(2) ** -5
        assert float(mpmath.log(abs(excess(w) / excess(w / 2)), 2)) == pytest.approx(left, abs=0.01)


def errors_of(name, steps, **options):
    """After 16 units of time in a field, of steps of so many units."""
    top, y, unit = problem(name)
    right = reference.solution(top, y, [16 * unit]).states[0]
    ends = [prepare(top, y, h * unit, NAME, **options).advance(y, round(16 / h)) for h in steps]
    return [float(metrics.scaled_error(top, y, end, right)) for end in ends]


@pytest.mark.parametrize("name", ["moderate_tide", "axisymmetric"])
def test_strang_with_both_corrections_has_order_four(name):
    coarse, fine = errors_of(name, (0.25, 0.125))
    assert math.log2(coarse / fine) == pytest.approx(4, abs=0.25)
    assert fine < 1e-6
    # negative controls: without either it has order two, and is worse
    for without in ("corrector", "modified_kick"):
        worse = errors_of(name, (0.25, 0.125), **{without: False})
        assert math.log2(worse[0] / worse[1]) == pytest.approx(2, abs=0.3)
        assert worse[1] > 3 * fine


def test_processed6_has_order_six(monkeypatch):
    whole, run = bs.SCHEMES["processed6"], partial(errors_of, "strong_tide", (0.5, 0.25), scheme="processed6")
    coarse, fine = run()
    assert math.log2(coarse / fine) == pytest.approx(6, abs=0.5)
    # negative controls: without any of its parts it has order four or two
    for part, wrong, order in (("c", (0.0, 0.0), 2), ("d", (), 4), ("second", 0.0, 4)):
        monkeypatch.setitem(bs.SCHEMES, "processed6", whole._replace(**{part: wrong}))
        worse = run()
        assert math.log2(worse[0] / worse[1]) < order + 0.6, part
        assert worse[1] > 3 * fine, part


@pytest.mark.parametrize("scheme", bs.SCHEMES)
def test_tables_and_plain_doubles_agree(scheme):
    top, y, unit = problem("weak_tide")
    tabled, plain = (prepare(top, y, 0.25 * unit, NAME, scheme=scheme, table=table) for table in (True, False))
    assert tabled.degree > 0
    assert plain.degree == 0
    a, b = tabled.advance(y, 400), plain.advance(y, 400)
    assert tabled.work.iterations == 0  # no flow outside of the box
    assert metrics.scaled_error(top, y, a, b) < 1e-12


def test_outside_of_its_box_a_table_is_not_used(monkeypatch):
    monkeypatch.setattr(bs, "MARGIN", 0.2)
    top, y, unit = problem("moderate_tide")
    small, plain = (prepare(top, y, 0.25 * unit, NAME, table=table) for table in (True, False))
    assert metrics.scaled_error(top, y, small.advance(y, 400), plain.advance(y, 400)) < 1e-12
    assert 0 < small.work.iterations < 400


@pytest.mark.parametrize("name", ["moderate_tide", "axisymmetric"])
def test_it_is_poisson_and_symmetric(name):
    top, y, unit = problem(name)
    for options in ({}, {"scheme": "aba864"}, {"scheme": "processed6"}, {"table": False}):
        for h in (0.5 * unit, -0.25 * unit):
            defect = metrics.poisson_defect(
                lambda z, h=h, o=options: prepare(top, z, h, NAME, **o).advance(z, 1), top, y
            )
            assert defect.defect < 1e-8
            there = prepare(top, y, h, NAME, **options).advance(y, 5)
            back = prepare(top, there, -h, NAME, **options).advance(there, 5)
            assert metrics.scaled_error(top, y, back, y) < 1e-13


def test_the_energy_error_does_not_grow():
    top, y, unit = problem("moderate_tide")
    run = integrate(top, y, 0.5 * unit, 300_000, NAME, every=300)
    off = drift(top, y, run.y)
    assert off[:, 2:].max() < 64 * 2.0**-52
    early, late = off[1:334, 0].max(), off[-333:, 0].max()
    assert late < 1.5 * early
    assert early < 1e-7


def test_it_says_where_it_is_the_wrong_method():
    top, y, unit = problem("strong_tide")
    with pytest.warns(bs.StepWarning, match="blanes_moan6 costs less"):
        prepare(PerturbedTop(top.top, POTENTIALS["tide"], (3.0, 1.0, 0.0, 0.0)), y, 0.1 * unit, NAME)
    with pytest.warns(bs.StepWarning, match="near resonance"):
        prepare(top, y, 1.5 * unit, NAME)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prepare(*problem("weak_tide")[:2], 0.25 * unit, NAME)
    with pytest.raises(StepError, match="in resonance with it; take less than a half"):
        prepare(top, y, 12 * unit, NAME)


def test_near_the_separatrix_it_falls_back():
    """λ(H, J3) is not smooth there: no table, or none of its digits, and the step is exact all the same."""
    top, y, unit = problem("separatrix_tide")
    for h in (0.5, 1.0):
        stepper = prepare(top, y, h * unit, NAME, corrector=False, modified_kick=False)
        off = drift(top, y, stepper.record(y, 2000, 20))
        assert off[:, 2:].max() < 64 * 2.0**-52
        assert off[:, 0].max() < 1e-3


UNITS = 300.0  # of time; the pilot of these tops has 78
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
