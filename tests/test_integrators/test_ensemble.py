"""Many tops at once: the bits of one at a time, whatever the chunks and threads; failures are named; input is checked."""

import math
import pickle
from functools import partial

import numpy as np
import pytest

from lagrange_bench import METHODS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, available, exact, metrics
from lagrange_bench.integrators import ensemble, integrate, integrate_ensemble, prepare
from lagrange_bench.integrators.compiling import lanes
from lagrange_bench.integrators.methods import backlund_splitting, taylor
from lagrange_bench.integrators.methods.backlund import SHORT
from lagrange_bench.integrators.problem.potentials import CHARGE, TIDE
from tests.faults import interrupted

SIZE = 150  # more than four blocks of lanes, the last one not full


def draw(n, seed=1):
    """alphas and states of generic tops, of both signs of alpha, |x| from 1/2 to 2."""
    rng = np.random.default_rng(seed)
    Y = rng.uniform(-2, 2, (n, 6))
    Y[:, 3:] *= (rng.uniform(0.5, 2, n) / np.linalg.norm(Y[:, 3:], axis=1))[:, None]
    return rng.uniform(-2, 2, n), Y


ALPHAS, Y0 = draw(SIZE)
TOP = LagrangeTop(ALPHAS)

FEW = 45  # a block of lanes and thirteen tops more
RNG = np.random.default_rng(5)
STATES = RNG.uniform(-1, 1, (FEW, 6))
STATES[:, 3:] /= np.linalg.norm(STATES[:, 3:], axis=1)[:, None]
HEAVY, NUMBERS = LagrangeTop(RNG.uniform(0.5, 2, FEW)), RNG.uniform(0.1, 0.9, FEW)

# formulas that other tests use too: they are compiled once for all
ALONG, PLACE, ABOVE = (0.8, 0.0, 0.6), (2.0, 1.0, 0.5), (0.0, 0.0, 1.6)
BOTH = Potential("both", lambda x1, x2, x3, p: x3 * x3 + p[0] * x1 * x2)
TOPS_IN = {
    "all numbers": PerturbedTop(HEAVY, TIDE, (NUMBERS, *ALONG)),
    "some numbers": PerturbedTop(LagrangeTop(0.7), CHARGE, (NUMBERS, *PLACE)),
    "alpha only": PerturbedTop(HEAVY, CHARGE, (0.4, *ABOVE)),
    "J3 kept by some": PerturbedTop(HEAVY, BOTH, (np.where(np.arange(FEW) % 2 == 1, 0.0, NUMBERS),)),
    "weak tide": PerturbedTop(HEAVY, TIDE, (1e-6 * NUMBERS, *ALONG)),
    "weak charge": PerturbedTop(HEAVY, CHARGE, (1e-6 * NUMBERS, *ABOVE)),
}
HEYOKA = pytest.mark.skipif(not available(METHODS["taylor"]), reason="heyoka is not installed")


@pytest.fixture
def in_lanes(monkeypatch):
    """The numbers of tops that were done in lanes, call by call."""
    met = []

    def run(*arguments, **options):
        fine = lanes.run_lanes(*arguments, **options)
        met.append(int(fine.sum()))
        return fine

    monkeypatch.setattr(ensemble, "run_lanes", run)
    return met


def one(problem, place):
    """The top at this place of many."""
    alpha, *parameters = (
        float(value[place]) if isinstance(value, np.ndarray) else value
        for value in (problem.alpha, *getattr(problem, "parameters", ()))
    )
    top = LagrangeTop(alpha)
    return PerturbedTop(top, problem.potential, parameters) if parameters else top


def one_by_one(problem, states, h, steps, every, name="backlund", **options):
    """Rows of many tops, each by itself."""
    rows = [prepare(one(problem, i), y, h, name, **options).record(y, steps, every) for i, y in enumerate(states)]
    return np.stack(rows, axis=1)


@pytest.mark.parametrize("h", [0.1, 5.0])
def test_every_named_top_and_any_size_has_the_bits_of_its_own_run(h):
    """In all forms of the exact step, with turns after the steps and without; side by side with powers of two from 2^-1060
    to 2^500, which are in their own units all the same, or taken alone."""
    y, sizes = TOPS["generic"].state, ((0, 0), (-400, 0), (400, 0), (-1000, -300), (500, 0), (0, -1060))
    states = [*(n.state for n in TOPS.values()), *(y * np.ldexp(1.0, [b, b, b, a, a, a]) for a, b in sizes)]
    alphas = [*(n.alpha for n in TOPS.values()), *(math.ldexp(1.0, max(2 * b - a, -1074)) for a, b in sizes)]
    many, states = LagrangeTop(np.array(alphas)), np.array(states)
    got = integrate_ensemble(many, states, h, 40, every=40)
    assert np.array_equal(got, one_by_one(many, states, h, 40, 40))


def test_nothing_depends_on_place_chunks_threads_or_interruptions(monkeypatch):
    order = np.random.default_rng(2).permutation(SIZE)
    for h, steps in ((1.5, SHORT), (0.1, 64)):
        end = integrate_ensemble(TOP, Y0, h, steps, threads=1)
        assert np.array_equal(integrate_ensemble(LagrangeTop(ALPHAS[order]), Y0[order], h, steps), end[order])
        assert np.array_equal(integrate_ensemble(LagrangeTop(ALPHAS[5]), Y0[5:6], h, steps)[0], end[5])
    rows = integrate_ensemble(TOP, Y0, 0.1, 64, every=4)
    for chunk, threads, stride in ((1, 3, 1 << 20), (37, 2, 100), (1000, 5, 7)):
        monkeypatch.setattr(ensemble, "CHUNK", chunk)
        monkeypatch.setattr(lanes, "INTERRUPTIBLE", stride)
        assert np.array_equal(integrate_ensemble(TOP, Y0, 0.1, 64, threads=threads), end)
        assert np.array_equal(integrate_ensemble(TOP, Y0, 0.1, 64, every=4, threads=threads), rows)


@pytest.mark.parametrize(
    ("name", "problem", "states"),
    [
        ("backlund", TOP, Y0),
        *((name, TOPS_IN["some numbers"], STATES) for name in ("dop853", "scipy_dop853")),
        pytest.param("taylor", TOPS_IN["some numbers"], STATES, marks=HEYOKA),
    ],
)
def test_at_times(name, problem, states):
    t = [0.3, 0.0, -2.0] + [1e4] * (name == "backlund")
    got = integrate_ensemble(problem, states, t=t, method=name)
    assert np.array_equal(got[1], states)
    for i in range(0, len(states), 10):
        assert np.array_equal(got[:, i], integrate(one(problem, i), states[i], t=t, method=name).y)


def errors(alphas, states, got, expected):
    """Of each top's own state."""
    return np.array(
        [metrics.scaled_error(LagrangeTop(a), *rest) for a, *rest in zip(alphas, states, got, expected, strict=True)]
    )


@pytest.mark.parametrize("h", [0.1, -2.5])
def test_long_runs_have_the_bits_of_one_top_alone_short_ones_its_accuracy(h):
    for steps in (SHORT, SHORT + 1):
        got, expected = integrate_ensemble(TOP, Y0, h, steps), one_by_one(TOP, Y0, h, steps, steps)[-1]
        same = (got == expected).all(axis=1)
        assert np.max(errors(ALPHAS, Y0, got, expected)) < 5e-14 * max(1.0, abs(h))
        assert same.all() == (steps > SHORT)


def draw_upright(n, seed):
    """Tops whose spin passes the vertical, where half a revolution hangs on the last digits; also released from rest."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(n, 6))
    states[:, :2] *= np.where(np.arange(n) % 3, 10.0 ** rng.uniform(-16, 0, n), 0.0)[:, None]
    states[::4, 2] = 0.0
    states[1::4, 3:5] *= 10.0 ** rng.uniform(-16, 0, len(states[1::4]))[:, None]  # close to the vertical with J
    states[1::4, 5] = 0.5
    return np.where(np.arange(n) % 4 == 1, rng.uniform(-2, 0, n), rng.uniform(-2, 2, n)), states  # those hang


@pytest.mark.parametrize(
    ("tops", "h", "steps", "middle", "most"),
    [
        *(
            (draw(5000, 4), h, 10, middle, 5e-14) for h, middle in ((0.5, 2e-15), (-7.3, 5e-15))
        ),  # periods are 1.3 to 10
        (draw_upright(3000, 7), -37.0, 1, 5e-15, 1e-12),
    ],
    ids=["short", "long", "upright"],
)
def test_ten_steps_against_jumps_in_double_double(tops, h, steps, middle, most):
    top, states = LagrangeTop(tops[0]), tops[1]
    jumps = integrate_ensemble(top, states, t=[steps * h])[0]
    error = errors(*tops, integrate_ensemble(top, states, h, steps), jumps)
    assert np.median(error) < middle
    assert np.max(error) < most


IN_LANES = ("rk4", "strang", "force_gradient6", "kahan", "bobenko_suris", "addition_theorem")
ALONE = [
    *("theta_functions", "taylor_fixed", "verner9_projected", "backlund_textbook"),
    *("implicit_midpoint", "dop853", "rk45"),
]


@pytest.mark.parametrize(
    ("name", "tops", "h", "options", "in_blocks"),
    [
        *((name, 53, 0.02, {}, {53}) for name in IN_LANES),  # 21 are left over, which fill more than half of a block
        *((name, 53, 0.02, {}, {0}) for name in ALONE),
        ("strang", 40, 0.1, {"compensated": True}, {32}),  # eight are left over, too few
        ("strang", SIZE, 0.7, {}, range(1, SIZE)),  # some lanes turn by more than they can: these tops are taken alone
        ("backlund", SIZE, -0.3, {}, {0}),  # it has a loop of its own
        ("backlund", SIZE, 40.0, {}, {0}),  # with turns after the steps
        ("backlund", SIZE, 0.2, {"pin": 3}, {0}),
        ("backlund", SIZE, 0.2, {"lam": 0.3 + 0.4j}, {SIZE}),
        *(("rk4", tops, 0.02, {}, {32}) for tops in ("all numbers", "alpha only")),
        *(("strang", "some numbers", 0.02, options, {32}) for options in ({}, {"compensated": True})),
        ("rk4", "J3 kept by some", 0.05, {}, {FEW}),  # 22 and 23, side by side: they have other kernels
        ("dop853", "some numbers", 0.02, {}, {0}),
        ("backlund_splitting", "weak tide", 0.1, {}, {32, FEW}),  # its step is from a table or without one
        ("backlund_splitting", "weak charge", 0.1, {"scheme": "saba4"}, {32, FEW}),
    ],
)
def test_every_kernel_has_the_bits_of_one_top_alone(name, tops, h, options, in_blocks, in_lanes, monkeypatch):
    problem, states = (TOPS_IN[tops], STATES) if tops in TOPS_IN else (LagrangeTop(ALPHAS[:tops]), Y0[:tops])
    monkeypatch.setattr(lanes, "INTERRUPTIBLE", 7)  # several calls of a loop
    rows = integrate_ensemble(problem, states, h, 18, name, every=6, threads=1, **options)
    monkeypatch.undo()
    assert np.array_equal(rows, one_by_one(problem, states, h, 18, 6, name, **options))
    assert sum(in_lanes) in in_blocks
    if options:  # they are seen
        assert not np.array_equal(rows, one_by_one(problem, states, h, 18, 6, name))
    if tops in TOPS_IN:  # the potential is there
        assert np.max(np.abs(rows - integrate_ensemble(HEAVY, STATES, h, 18, every=6))) > 1e-7


def test_where_lanes_do_not_reach_tops_are_taken_alone(in_lanes, monkeypatch):
    """They leave the box of their table."""
    monkeypatch.setattr(backlund_splitting, "MARGIN", 0.9)
    weak = PerturbedTop(HEAVY, TIDE, (1e-3 * NUMBERS, *ALONG))
    got = integrate_ensemble(weak, STATES, 0.1, 120, "backlund_splitting", threads=1)
    assert np.array_equal(got, one_by_one(weak, STATES, 0.1, 120, 120, "backlund_splitting")[-1])
    assert 0 < sum(in_lanes) < 32


@HEYOKA
def test_heyoka_in_batches(monkeypatch):
    """None is taken alone; of tops that keep J3 and of others. Other code than that of one top: round-off."""
    problems = (HEAVY, *(TOPS_IN[kind] for kind in ("all numbers", "alpha only", "J3 kept by some")))
    alone = [one_by_one(problem, STATES, 0.1, 20, 10, "taylor") for problem in problems]
    batches, make = [], taylor._batches

    def counted(form, *rest):
        batches.append(form is None or 2 in form.system.kept)
        return make(form, *rest)

    monkeypatch.setattr(taylor, "_batches", counted)
    monkeypatch.setattr(ensemble._Steps, "one", None)
    runs = [integrate_ensemble(problem, STATES, 0.1, 20, "taylor", every=10, threads=1) for problem in problems]
    assert batches[:-2] == [True, False, True]
    assert sorted(batches[-2:]) == [False, True]
    for got, right in zip(runs, alone, strict=True):
        assert np.max(np.abs(got - right)) < 2e-14
    assert np.array_equal(runs[2][2, :, 2], STATES[:, 2])
    assert np.max(np.abs(runs[3] - alone[1])) > 1e-3


@pytest.mark.parametrize("name", ["strang", "kahan", "verner9_projected"])
def test_failures_among_lanes(name, in_lanes):
    """The errors of one top alone, step number included, and no harm to its neighbours."""
    states = Y0[:64].copy()
    states[5] *= 1e160
    states[40] *= np.repeat((1e7, 1e5), 3)
    states[50] *= 1e-170
    top, errors = LagrangeTop(np.abs(ALPHAS[:64])), {}
    got = integrate_ensemble(top, states, 0.1, 20, name, threads=1, on_failure="nan")
    for i, y in enumerate(states):
        try:
            assert np.array_equal(got[i], prepare(LagrangeTop(top.alpha[i]), y, 0.1, name).advance(y, 20))
        except StepError as error:
            errors[i] = error
            assert np.isnan(got[i]).all()
    assert sum(in_lanes) >= (0 if name == "verner9_projected" else 32)
    first = min(errors)
    with pytest.raises(StepError, match=f"top {first}: ") as caught:
        integrate_ensemble(top, states, 0.1, 20, name)
    assert (caught.value.step, caught.value.h) == (errors[first].step, 0.1)
    assert errors[first].reason in caught.value.reason


def test_a_failure_names_the_first_top_and_counts(monkeypatch):
    """Top 3 and top 7 are too quick for their phase to be known; the others are ordinary."""
    monkeypatch.setattr(ensemble, "CHUNK", 2)
    top, states = LagrangeTop(ALPHAS[:10]), Y0[:10].copy()
    states[3, :3] *= 1e20
    states[7, :3] *= 1e30
    with pytest.raises(StepError, match=r"^backlund at h = 0\.1: top 3: \|h\| is over 1e15 .*; 2 of 10 tops fail$"):
        integrate_ensemble(top, states, 0.1, 10, threads=3)
    with pytest.raises(StepError, match="top 3"):
        integrate_ensemble(top, states, t=[0.1], threads=1)
    good = [i for i in range(10) if i not in (3, 7)]
    rows = integrate_ensemble(top, states, 0.1, 10, every=5, on_failure="nan")
    assert np.isnan(rows[:, [3, 7]]).all()
    whole = integrate_ensemble(LagrangeTop(ALPHAS[good]), Y0[good], 0.1, 10, every=5)
    assert np.array_equal(rows[:, good], whole)


def test_control_c():
    integrate_ensemble(TOP, Y0, 0.1, 1)  # compiled
    with interrupted():
        integrate_ensemble(TOP, Y0, 0.1, 10**10, threads=2)


def test_input_is_not_modified_and_may_lie_anyhow_in_memory():
    end = integrate_ensemble(TOP, Y0, 0.1, 5)
    wide = np.zeros((SIZE, 12))
    wide[:, ::2] = Y0
    for layout in (np.asfortranarray(Y0), wide[:, ::2], Y0[::-1].copy()[::-1], Y0.astype(">f8"), Y0.tolist()):
        before = np.array(layout)
        assert np.array_equal(integrate_ensemble(TOP, layout, 0.1, 5), end)
        assert np.array_equal(layout, before)
    assert not np.shares_memory(integrate_ensemble(TOP, Y0, 0.1, 0), Y0)


def test_no_tops_and_no_steps():
    none = np.empty((0, 6))
    assert integrate_ensemble(LagrangeTop(), none, 0.1, 10).shape == (0, 6)
    assert integrate_ensemble(LagrangeTop(np.empty(0)), none, 0.1, 10, every=5).shape == (3, 0, 6)
    assert integrate_ensemble(LagrangeTop(), none, t=[1.0]).shape == (1, 0, 6)
    nobody = PerturbedTop(LagrangeTop(), TIDE, (np.empty(0), 0.8, 0.0, 0.6))
    assert integrate_ensemble(nobody, none, 0.1, 10, "strang").shape == (0, 6)
    assert integrate_ensemble(TOP, Y0, t=[]).shape == (0, SIZE, 6)
    assert integrate_ensemble(TOP, Y0, 0.1, 0, every=3).shape == (1, SIZE, 6)


def test_a_top_with_many_alphas_is_for_ensembles_only():
    source, y = np.array([1.0, 2.0]), TOPS["generic"].state
    many = LagrangeTop(source)
    source[0] = 5.0
    assert many.alpha[0] == 1.0
    calls = (many.scales, many.jacobian, many.gradients, partial(exact.solution, many, t=1.0))
    for call in (*calls, partial(prepare, many, h=0.1), partial(integrate, many, h=0.1, steps=1)):
        with pytest.raises(ValueError, match="2 values of a parameter"):
            call(y0=y) if isinstance(call, partial) else call(y)
    rows = np.array([[y, y], [y, y]])
    assert np.array_equal(many.invariants(rows)[1, 1], LagrangeTop(2.0).invariants(y))
    assert np.array_equal(many.rhs(rows)[0, 0], LagrangeTop(1.0).rhs(y))
    assert np.array_equal(pickle.loads(pickle.dumps(many)).alpha, many.alpha)
