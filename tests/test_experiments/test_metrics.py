"""The metrics say what they should of signals whose answer is known, and something else of their neighbours."""

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.drawing import shown
from lagrange_bench.experiments.measuring import metrics, reductions
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop
from lagrange_bench.integrators.truth import exact
from tests.reference import turned

T = np.arange(1, 40_001) * 0.05  # 40 000 samples
STATES = 16


def signal(kind):
    """Errors (STATES, N) of a known kind, of very different sizes from state to state."""
    rng = np.random.default_rng(0)
    size = rng.uniform(0.5, 2.0, (STATES, 1))
    phase, omega = rng.uniform(0, 2 * np.pi, (STATES, 1)), rng.uniform(1, 3, (STATES, 1))
    oscillation = np.cos(omega * T + phase) - np.cos(phase)  # starts at 0, as errors do
    walk = np.cumsum(rng.standard_normal((STATES, len(T))), axis=1)
    ulp = 2.0**-52
    noise = rng.standard_normal((STATES, len(T)))
    return {
        "oscillation": 1e-6 * size * oscillation,
        "noise": ulp * size * noise,
        "walk": ulp * size * walk,
        "linear": 1e-12 * size * T * rng.choice((-1, 1), (STATES, 1)),
        "linear in noise": ulp * (20 * noise + size * T),  # the drift overtakes the noise only in the last two decades
        "walk with an oscillation": ulp * (walk + 5 * oscillation),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "p", "tolerance", "verdict"),
    # tolerance: 16 states give the RMS of a walk to 1/√32; over ln(100) = 4.6 that is ±0.05 (1 σ), taken 3 times
    [
        ("oscillation", 0.0, 0.03, "bounded"),
        ("linear", 1.0, 0.01, "biased"),
        ("linear in noise", 1.0, 0.25, "biased"),
        ("walk with an oscillation", 0.5, 0.15, "random walk"),
    ],
)
def test_growth_of_known_signals(kind, p, tolerance, verdict):
    E = signal(kind)
    growth = metrics.growth_exponent(T, E)
    assert growth.p == pytest.approx(p, abs=tolerance)
    assert growth.low <= growth.p <= growth.high
    assert metrics.verdict(*growth, np.max(np.abs(E))) == verdict
    assert metrics.growth_exponent(T, 2.0**20 * np.abs(E)) == pytest.approx(growth)
    # experiments store some hundred log-spaced samples, not every step. A block of a dozen samples of an oscillation gives its
    # RMS to some per cent; over ln(100) that is ±0.02
    keep = np.unique(np.geomspace(1, len(T), 400).astype(int)) - 1
    assert metrics.growth_exponent(T[keep], E[:, keep]).p == pytest.approx(growth.p, abs=0.06)


def test_growth_interval_covers():
    """Nominal 95 %; the bootstrap of 16 states may fall a little short of it, but not of 88 %."""
    t = np.unique(np.geomspace(1, 10_000, 200).astype(int)).astype(float)
    hits = 0
    for seed in range(100):
        steps = np.random.default_rng(seed).standard_normal((STATES, len(t))) * np.sqrt(np.diff(t, prepend=0))
        growth = metrics.growth_exponent(t, np.cumsum(steps, axis=1), resamples=400)
        hits += growth.low <= 0.5 <= growth.high
    assert 88 <= hits < 100  # an interval that never misses is too long


def test_growth_of_nothing():
    assert np.isnan(metrics.growth_exponent(T, np.zeros((STATES, len(T)))).p)
    assert np.isnan(metrics.growth_exponent(T, signal("noise") * 1e-3).p)  # below the floor
    assert np.isnan(metrics.growth_exponent(T, np.where(T > 100, np.nan, signal("walk"))).p)
    alone = metrics.growth_exponent(T, signal("linear")[0])
    assert (alone.p, np.isnan(alone.low)) == (pytest.approx(1, abs=0.01), True)
    with pytest.raises(ValueError, match="growing"):
        metrics.growth_exponent(T[::-1], signal("walk"))


def test_verdict():
    for growth, max_error, said in (
        ((np.nan, np.nan, np.nan), 0.0, "exact"),
        ((0.5, 0.4, 0.6), 2.0**-52, "round-off"),
        ((0.0, -0.1, 0.1), np.nan, "failed"),
        ((0.0, -0.1, 0.6), 1e-3, "undecided"),
        ((0.5, 0.3, 1.1), 1e-3, "undecided"),
        ((0.9, 0.3, 1.5), 1e-3, "undecided"),
        ((0.5, np.nan, np.nan), 1e-3, "undecided"),
    ):
        assert metrics.verdict(*growth, max_error) == said


def test_scaled_error_takes_the_worse_half():
    top, y0 = LagrangeTop(1.0), TOPS["fast"].state
    rate, size, _ = top.scales(y0)
    y = y0 + np.array(((rate, 0, 0, 0, 0, 0), (0, 0, 0, 0, 3 * size, 4 * size), (0, 0, 0, 0, 0, 0)))
    assert metrics.scaled_error(top, y0, y, y0) == pytest.approx([1, 5, 0])
    at_rest = np.array((0.0, 0, 0, 0, 0, 1))
    moved = np.array((at_rest, at_rest))
    moved[0, 0] = 1e-9
    assert np.array_equal(metrics.scaled_error(LagrangeTop(0.0), at_rest, moved, at_rest), (np.inf, 0))


def test_pareto_front():
    cost = np.array([1, 2, 3, 2, 4, np.nan, 0.5, 5])
    error = np.array([9, 4, 5, 4, 1, 0, np.inf, 1])
    assert metrics.pareto_front(cost, error).tolist() == [0, 1, 4]
    assert metrics.pareto_front([], []).size == 0


def test_reductions_keep_nan():
    rows = pd.DataFrame({"a": [1.0, -3.0], "b": [np.nan, 2.0]})
    assert np.isnan(reductions.largest(rows.b))
    assert reductions.largest(rows.a) == 3.0
    assert reductions.worst(rows, ("a", "b")).tolist() == pytest.approx([np.nan, 3.0], nan_ok=True)
    assert reductions.mean_square(rows.b, [0, 0]).isna().all()
    assert reductions.mean_square(rows.a, [0, 0]).tolist() == [5.0]


def test_tables_and_figures_are_made_of_the_rows_of_their_part():
    rows = pd.DataFrame({"part": ["a", "a", "b"], "status": ["done", "failed", "done"], "x": [1, 2, 3]})
    asked = {"table": shown.of_part("a", "table"), "crosses": shown.of_part("a", failed=True)}
    asked |= {"all": shown.of_part(), "none": shown.of_part("c")}
    made = {name: of_part(lambda rows: rows)(rows) for name, of_part in asked.items()}
    assert made.pop("none") is None
    assert {name: table.x.tolist() for name, table in made.items()} == {"table": [1], "crosses": [1, 2], "all": [1, 3]}
    assert made["table"].attrs["caption"] == "table"


@pytest.mark.parametrize("name", ["near_regular", "near_separatrix", "inverted"])
def test_phase_split_recovers_shifts(name):
    top, y = TOPS[name].top, TOPS[name].state
    unit = top.scales(y)[2]
    size = 1e-6 if name == "near_regular" else 1e-4  # well below the amplitude of the nutation, there 1e-3
    dt, angle = size * unit, -2 * size
    shifted = turned(np.cos(angle), np.sin(angle), exact.solution(top, y, dt))
    split = metrics.phase_split(top, y, shifted - y)
    # what is left out is cubic, and magnified by the condition number of the basis; that of second order would be 1e-4
    assert split["time"][0] == pytest.approx(dt, rel=1e-6)
    assert split["angle"][0] == pytest.approx(angle, rel=1e-6)
    # the shifted state is on the same torus: its invariants differ by (∇F·∇F)·coefficients = 0
    coefficients = np.array([split[name][0] for name in ("H", "J3", "C1", "C2")])
    G = top.gradients(y)
    assert np.abs(G @ G.T @ coefficients / top.invariant_scales(y)).max() < 10 * size**2
    drift = metrics.phase_split(top, y, 1e-9 * top.gradients(y)[2])  # pure drift is no phase
    assert abs(drift["time"][0]) < 1e-20
    assert drift["C1"][0] == pytest.approx(1e-9)


@pytest.mark.parametrize("p", [1, 8])
def test_order_between_round_off_and_saturation(p):
    h = 2.0 ** -np.arange(16)
    rng = np.random.default_rng(p)
    error = np.minimum(3.0, 2 * h**p * (1 + 0.5 * h)) + 1e-14 * rng.uniform(0.5, 2, 16) / h
    assert metrics.order(h, error) == pytest.approx(p, abs=0.15)
    shuffled = rng.permutation(16)
    again = metrics.order(-h[shuffled], error[shuffled])  # any order, any sign of h
    assert again == pytest.approx(metrics.order(h, error))


def test_order_of_no_power_law():
    h = 2.0 ** -np.arange(8)
    rng = np.random.default_rng(0)
    for error in (np.full(8, 1e-3), np.full(8, np.nan), np.zeros(8)):
        assert np.isnan(metrics.order(h, error))
    assert np.isnan(metrics.order(h, 1e-15 * rng.uniform(0.5, 2, 8), floor=1e-15))
    assert np.isnan(metrics.order(h[:2], h[:2] ** 2 / 20))  # two points are no fit
    assert metrics.order(h, h**2 / 20, floor=1e-4) == pytest.approx(2.0)


def test_the_condition_of_a_known_motion():
    """The weightless top turns: a change stays what it is, but for one of J along J, which turns x by itself times t."""
    top, y0 = LagrangeTop(0.0), np.array([0.0, 0.0, 2.0, 1.0, 0.0, 0.0])
    t = np.array([0.0, 1.0, 10.0, 100.0])
    first, *_, last = metrics.condition(top, y0, t)
    assert first == pytest.approx(1.0, rel=1e-3)
    assert last == pytest.approx(200.0, rel=2e-2)  # in scaled units: time · |J|
