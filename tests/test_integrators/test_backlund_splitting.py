"""The exact step inside a splitting: schemes, corrector, tables, and what the whole keeps."""

import math
import warnings
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import PERTURBED_TOPS, POTENTIALS, PerturbedTop, StepError, integrate, prepare
from lagrange_bench.integrators.methods import backlund_schemes
from lagrange_bench.integrators.methods import backlund_splitting as bs
from lagrange_bench.integrators.truth import reference

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
    pytest.mark.xdist_group("splitting"),  # kernels are compiled once for the two files about it
]


def problem(name):
    named = PERTURBED_TOPS[name]
    return named.top, named.state, named.top.scales(named.state)[2]


@pytest.mark.parametrize("name", bs.SCHEMES)
def test_schemes_integrate_the_perturbation_to_their_order(name):
    """To first order in ε a scheme is a quadrature of V along the flow: exact for polynomials below its first order."""
    a, b, *_ = bs.SCHEMES[name]
    nodes, order = np.cumsum([Fraction(w) for w in a])[:-1] - Fraction(1, 2), ORDERS[name][0]
    defects = [
        abs(float(sum(w * c**k for w, c in zip(map(Fraction, b), nodes, strict=True)) - moment(k)))
        for k in range(order + 1)
    ]
    assert max(defects[:order]) < 1e-15
    assert defects[order] > 1e-7  # and no more


def moment(k):
    return Fraction(1, (k + 1) * 2**k) if k % 2 == 0 else Fraction(0)


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
    chosen, b = bs.SCHEMES[name], backlund_schemes.corrector_kicks(bs.SCHEMES[name])
    times = np.cumsum(chosen.a)[:-1] - 0.5
    for w, bound in ((0.3, 1e-11), (0.65, 5e-11), (1.3, 1e-9), (2.0, 1e-8), (3.0, 1e-6)):
        fitted = 2 * sum(b[j] * math.sin(backlund_schemes.SPACING * (j + 1) * w) for j in range(backlund_schemes.NODES))
        assert abs(fitted - (np.cos(w * times) @ chosen.b / (2 * math.sin(w / 2)) - 1 / w)) < bound


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


@pytest.mark.parametrize("name", ["moderate_tide", "axisymmetric"])
def test_strang_with_both_corrections_has_order_four(name):
    top, y, unit = problem(name)
    right = reference.solution(top, y, [16 * unit]).states[0]

    def error(h, **options):
        return metrics.scaled_error(top, y, prepare(top, y, h * unit, NAME, **options).advance(y, round(16 / h)), right)

    errors = [error(h) for h in (0.25, 0.125)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.25)
    assert errors[1] < 1e-6
    # negative controls: without either it has order two, and is worse
    for without in ("corrector", "modified_kick"):
        worse = [error(h, **{without: False}) for h in (0.25, 0.125)]
        assert math.log2(worse[0] / worse[1]) == pytest.approx(2, abs=0.3)
        assert worse[1] > 3 * errors[1]


def test_processed6_has_order_six(monkeypatch):
    top, y, unit = problem("strong_tide")
    right = reference.solution(top, y, [16 * unit]).states[0]

    def errors(**without):
        monkeypatch.setitem(bs.SCHEMES, "processed6", whole._replace(**without))
        steps = (0.5, 0.25)
        runs = [prepare(top, y, h * unit, NAME, scheme="processed6").advance(y, round(16 / h)) for h in steps]
        return [float(metrics.scaled_error(top, y, run, right)) for run in runs]

    whole = bs.SCHEMES["processed6"]
    coarse, fine = errors()
    assert math.log2(coarse / fine) == pytest.approx(6, abs=0.5)
    # negative controls: without any of its parts it has order four or two
    for part, order in (("c", 2), ("d", 4), ("second", 4)):
        wrong = {"c": (0.0, 0.0), "d": (), "second": 0.0}[part]
        worse = errors(**{part: wrong})
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
    drift = np.abs(metrics.relative_drift(run.invariants(), top.invariant_scales(y)))
    assert drift[:, 2:].max() < 64 * 2.0**-52
    early, late = drift[1:334, 0].max(), drift[-333:, 0].max()
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
    for options, message in (
        ({"scheme": "leapfrog"}, "scheme must be one of"),
        ({"scheme": "aba864", "corrector": True}, "corrector belongs to scheme='strang' or 'processed6'"),
        ({"modified_kick": "yes"}, "modified_kick must be True or False"),
        ({"table": 3}, "table must be True or False"),
    ):
        with pytest.raises(ValueError, match=message):
            prepare(top, y, 0.1, NAME, **options)


def test_near_the_separatrix_it_falls_back():
    """λ(H, J3) is not smooth there: no table, or none of its digits, and the step is exact all the same."""
    top, y, unit = problem("separatrix_tide")
    for h in (0.5, 1.0):
        stepper = prepare(top, y, h * unit, NAME, corrector=False, modified_kick=False)
        run = stepper.record(y, 2000, 20)
        assert np.isfinite(run).all()
        drift = np.abs(metrics.relative_drift(top.invariants(run), top.invariant_scales(y)))
        assert drift[:, 2:].max() < 64 * 2.0**-52
        assert drift[:, 0].max() < 1e-3
