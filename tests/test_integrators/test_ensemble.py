"""Many tops at once: the bits of one at a time, whatever the chunks and threads; failures are named; input is checked.

Short runs of the exact step have λ(h) in plain doubles, and the accuracy of one at a time, not its bits.
"""

import math
import pickle

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import (
    METHODS,
    TOPS,
    HeavyTop,
    LagrangeTop,
    StepError,
    available,
    ensemble,
    integrate,
    integrate_ensemble,
    prepare,
)
from lagrange_bench.integrators.compiling import lanes
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.methods import backlund
from lagrange_bench.integrators.methods.backlund import SHORT
from lagrange_bench.integrators.torus.plain_step import HALVES, many_plain_constants
from lagrange_bench.integrators.torus.real_map import (
    CONSTANTS,
    KERNELS,
    NO_TURN,
    many_constants,
    step,
    turning_step,
)
from lagrange_bench.integrators.truth import exact
from tests.faults import interrupted
from tests.installed import FOR_TOPS, installed

SIZE = 150  # more than four blocks of lanes, the last one not full


def draw(n, seed=1):
    """alphas and states of generic tops, of both signs of alpha, |x| from 1/2 to 2."""
    rng = np.random.default_rng(seed)
    Y = rng.uniform(-2, 2, (n, 6))
    Y[:, 3:] *= (rng.uniform(0.5, 2, n) / np.linalg.norm(Y[:, 3:], axis=1))[:, None]
    return rng.uniform(-2, 2, n), Y


ALPHAS, Y0 = draw(SIZE)
TOP = LagrangeTop(ALPHAS)
NAMED_STEPS = (0.1, 5.0)  # for the named tops: every form of the kernel


def one_by_one(h, steps, method="backlund", every=None, **options):
    rows = [
        prepare(LagrangeTop(a), y, h, method, **options).record(y, steps, every or steps)
        for a, y in zip(ALPHAS, Y0, strict=True)
    ]
    return np.stack(rows, axis=1) if every else np.stack(rows)[:, -1]


# ---------------------------------------------------------------- the exact step


@pytest.mark.parametrize("h", [0.1, -0.3, 2.5, 40.0])
def test_the_bits_of_one_top_alone(h):
    """Steps, and steps with turns after them, with their pins."""
    assert np.array_equal(integrate_ensemble(TOP, Y0, h, 100), one_by_one(h, 100))


def test_all_forms_of_the_kernel_are_met():
    """Otherwise the tests of the same bits show less than they say."""
    states = np.array([n.state for n in TOPS.values()])
    forms, n = np.empty(len(states), dtype=np.int64), len(states)
    alphas = np.array([n.alpha for n in TOPS.values()])
    met, turns = set(), np.empty((n, 4))
    for h in NAMED_STEPS:
        many_constants(alphas, states, h, np.empty((n, 6)), np.empty((n, CONSTANTS)), np.empty((n, 6)), forms, turns)
        turned = (turns != np.ravel(NO_TURN)).any(axis=1)
        met |= set(zip(forms.tolist(), turned.tolist(), strict=True))
    assert met == {(KERNELS.index(k), turned) for k in (step, turning_step) for turned in (False, True)}


@pytest.mark.parametrize("options", [{"pin": 0}, {"pin": 3}, {"method": "backlund_unpinned"}])
def test_options(options):
    assert np.array_equal(integrate_ensemble(TOP, Y0, 0.2, 50, **options), one_by_one(0.2, 50, **options))


def test_another_lambda():
    got = integrate_ensemble(TOP, Y0[:], 0.2, 9, lam=0.3 + 0.4j)
    assert np.array_equal(got, one_by_one(0.2, 9, lam=0.3 + 0.4j))


@pytest.mark.parametrize("every", [1, 7, 21])
def test_rows(every):
    rows = integrate_ensemble(TOP, Y0, 0.1, 21, every=every)
    assert rows.shape == (21 // every + 1, SIZE, 6)
    assert np.array_equal(rows, one_by_one(0.1, 21, every=every))
    assert np.array_equal(rows[0], Y0)


def test_nothing_depends_on_place_chunks_threads_or_interruptions(monkeypatch):
    end = integrate_ensemble(TOP, Y0, 0.1, 64, threads=1)
    order = np.random.default_rng(2).permutation(SIZE)
    assert np.array_equal(integrate_ensemble(LagrangeTop(ALPHAS[order]), Y0[order], 0.1, 64), end[order])
    assert np.array_equal(integrate_ensemble(LagrangeTop(ALPHAS[5]), Y0[5:6], 0.1, 64)[0], end[5])
    rows = integrate_ensemble(TOP, Y0, 0.1, 64, every=4)
    for chunk, threads, stride in ((1, 3, 1 << 20), (37, 2, 100), (1000, 5, 7)):
        monkeypatch.setattr(ensemble, "CHUNK", chunk)
        monkeypatch.setattr(lanes, "INTERRUPTIBLE", stride)
        assert np.array_equal(integrate_ensemble(TOP, Y0, 0.1, 64, threads=threads), end)
        assert np.array_equal(integrate_ensemble(TOP, Y0, 0.1, 64, every=4, threads=threads), rows)


def test_named_tops_keep_the_promise_of_the_exact_step():
    """All regimes side by side, each with its own alpha, h and torus; 1000 steps."""
    named = [n for n in TOPS.values() if n.name not in ("homoclinic", "sleeping_unstable")]
    h = 0.05
    states = np.array([n.state for n in named])
    got = integrate_ensemble(LagrangeTop(np.array([n.alpha for n in named])), states, h, 1000)
    for n, y in zip(named, got, strict=True):
        t = 1000 * h * n.top.scales(n.state)[0]
        error = metrics.scaled_error(n.top, n.state, y, exact.solution(n.top, n.state, [1000 * h])[0])
        assert error <= 1e-13 + 1e-15 * t, n.name


def test_every_named_top_has_the_bits_of_its_own_run():
    states = np.array([n.state for n in TOPS.values()])
    for h in NAMED_STEPS:
        got = integrate_ensemble(LagrangeTop(np.array([n.alpha for n in TOPS.values()])), states, h, 40)
        for n, y in zip(TOPS.values(), got, strict=True):
            assert np.array_equal(y, prepare(n.top, n.state, h).advance(n.state, 40)), n.name


def test_extreme_sizes_side_by_side():
    """Powers of two from 2^-1060 to 2^500: in their own units all the same, or taken alone."""
    y, states, alphas = TOPS["generic"].state, [], []
    for a, b in ((0, 0), (-400, 0), (400, 0), (-1000, -300), (500, 0), (0, -1060)):
        states.append(y * np.ldexp(1.0, [b, b, b, a, a, a]))
        alphas.append(math.ldexp(1.0, max(2 * b - a, -1074)))
    got = integrate_ensemble(LagrangeTop(np.array(alphas)), np.array(states), 0.01, 20)
    for alpha, start, end in zip(alphas, states, got, strict=True):
        assert np.array_equal(end, prepare(LagrangeTop(alpha), start, 0.01).advance(start, 20))


def test_jumps():
    t = np.array([0.0, 0.3, -2.0, 1e4])
    got = integrate_ensemble(TOP, Y0, t=t)
    assert got.shape == (4, SIZE, 6)
    assert np.array_equal(got[0], Y0)
    for i in range(SIZE):
        assert np.array_equal(got[:, i], integrate(LagrangeTop(ALPHAS[i]), Y0[i], t=t).y)
    assert integrate_ensemble(TOP, Y0, t=[]).shape == (0, SIZE, 6)


# ---------------------------------------------------------------- short runs of the exact step: λ(h) in plain doubles


def errors(alphas, states, got, expected):
    """Of states (n, 6), as `metrics.scaled_error`."""
    size = np.linalg.norm(states[:, 3:], axis=1)
    rate = np.linalg.norm(states[:, :3], axis=1) + np.sqrt(np.abs(alphas) * size)
    off = got - expected
    return np.maximum(np.linalg.norm(off[:, :3], axis=1) / rate, np.linalg.norm(off[:, 3:], axis=1) / size)


def test_ten_steps_of_half_a_unit():
    """A hundred thousand tops against jumps in double-double."""
    alphas, states = draw(100_000, seed=4)
    top = LagrangeTop(alphas)
    error = errors(
        alphas, states, integrate_ensemble(top, states, 0.5, 10), integrate_ensemble(top, states, t=[5.0])[0]
    )
    assert np.median(error) < 2e-15
    assert np.max(error) < 5e-14


@pytest.mark.parametrize("h", [0.1, -0.3, 2.5, 40.0])
def test_long_runs_have_the_bits_of_one_top_alone_short_ones_its_accuracy(h):
    for steps in (SHORT, SHORT + 1):
        got, expected = integrate_ensemble(TOP, Y0, h, steps), one_by_one(h, steps)
        same = (got == expected).all(axis=1)
        assert np.max(errors(ALPHAS, Y0, got, expected)) < 5e-14 * max(1.0, abs(h))
        assert same.all() == (steps > SHORT)


@pytest.mark.parametrize("h", [1.9, -7.3, 31.0])
def test_ten_steps_of_up_to_many_nutations(h):
    """Whole nutations are taken off; few tops are left to double-double. Periods are 1.3 to 10 here."""
    n = 10_000
    alphas, states = draw(n, seed=4)
    top = LagrangeTop(alphas)
    error = errors(
        alphas, states, integrate_ensemble(top, states, h, 10), integrate_ensemble(top, states, t=[10 * h])[0]
    )
    assert np.median(error) < 5e-15
    assert np.max(error) < 5e-14
    exact_c, plain_c, numbers = np.empty((n, CONSTANTS)), np.empty((n, CONSTANTS)), np.empty(n, dtype=np.int64)
    for set_up, c in ((many_constants, exact_c), (many_plain_constants, plain_c)):
        set_up(alphas, states, h, np.empty((n, 6)), c, np.empty((n, 6)), numbers, np.empty((n, 4)))
    assert HALVES in numbers
    assert np.mean((exact_c == plain_c).all(axis=1)) < 0.02


@pytest.mark.parametrize("h", [3.0, -37.0])
def test_tops_whose_spin_passes_the_vertical(h):
    """There half a revolution of each nutation hangs on the last digits; tops released from rest are among them."""
    rng, n = np.random.default_rng(7), 3000
    states = rng.normal(size=(n, 6))
    states[:, :2] *= np.where(np.arange(n) % 3, 10.0 ** rng.uniform(-16, 0, n), 0.0)[:, None]
    states[::4, 2] = 0.0
    states[1::4, 3:5] *= 10.0 ** rng.uniform(-16, 0, len(states[1::4]))[:, None]  # close to the vertical with J
    states[1::4, 5] = 0.5
    alphas = np.where(np.arange(n) % 4 == 1, rng.uniform(-2, 0, n), rng.uniform(-2, 2, n))  # those hang
    top = LagrangeTop(alphas)
    error = errors(alphas, states, integrate_ensemble(top, states, h, 1), integrate_ensemble(top, states, t=[h])[0])
    assert np.median(error) < 5e-15
    assert np.max(error) < 1e-12


@pytest.mark.parametrize(("h", "wrong"), [(0.5, 1e-13), (31.0, 2e-15)])
def test_a_plain_parameter_that_errs_would_be_found(h, wrong, monkeypatch):
    """Negative control: a clock that is wrong, or a period."""
    alphas, states = draw(2000, seed=4)
    top = LagrangeTop(alphas)

    def late(alphas, Y, h, *rest):
        many_plain_constants(alphas, Y, h * (1 + wrong), *rest)

    monkeypatch.setattr(backlund, "many_plain_constants", late)
    error = errors(
        alphas, states, integrate_ensemble(top, states, h, 10), integrate_ensemble(top, states, t=[10 * h])[0]
    )
    assert np.max(error) > 5e-14


def test_in_short_runs_too_nothing_depends_on_place_chunks_or_threads(monkeypatch):
    """Few tops or many, ordinary or of extreme size."""
    states, alphas = np.concatenate((Y0, Y0[:2] * 1e200, Y0[:2] * 2.0**-1040)), np.concatenate((ALPHAS, ALPHAS[:4]))
    end = integrate_ensemble(LagrangeTop(alphas), states, 1e-3, 8, threads=1, on_failure="nan")
    assert np.isfinite(end[:SIZE]).all()
    for chunk, threads in ((1, 3), (37, 2)):
        monkeypatch.setattr(ensemble, "CHUNK", chunk)
        again = integrate_ensemble(LagrangeTop(alphas), states, 1e-3, 8, threads=threads, on_failure="nan")
        assert np.array_equal(again, end, equal_nan=True)


# ---------------------------------------------------------------- every other method


def kinds():
    """One method of every family, engine, control, and way to take many tops."""
    there = [m for m in FOR_TOPS.values() if available(m)]
    return sorted({(m.family, m.engine, m.control, m.advance_many is None): m.name for m in there[::-1]}.values())


@pytest.mark.parametrize("name", kinds())
def test_every_kind_of_method(name):
    """As one by one: the same bits, or for heyoka in its batch mode the same up to what its tolerance leaves."""
    alphas, states, unit = ALPHAS[:5], Y0[:5], 0.02
    got = integrate_ensemble(LagrangeTop(alphas), states, unit, 18, name, every=9, threads=2)
    assert got.shape == (3, 5, 6)
    for i in range(5):
        alone = prepare(LagrangeTop(alphas[i]), states[i], unit, name).record(states[i], 18, 9)
        if METHODS[name].advance_many is None or METHODS[name].engine == "numba":
            assert np.array_equal(got[:, i], alone)
        else:
            assert np.max(np.abs(got[:, i] - alone)) < 1e-14


COMPILED = [m.name for m in FOR_TOPS.values() if available(m) and m.engine == "numba" and m.control == "step"]
ALONE = {"theta_functions", "taylor_fixed", "verner9_projected", "backlund_textbook", "rkmk4", "commutator_free4"}
ALONE |= {m.name for m in FOR_TOPS.values() if m.family == "implicit"}
COMPENSATED = [name for name in COMPILED if "compensated" in METHODS[name].options]


def alone(n, h, steps, every, name, **options):
    rows = [
        prepare(LagrangeTop(a), y, h, name, **options).record(y, steps, every)
        for a, y in zip(ALPHAS[:n], Y0[:n], strict=True)
    ]
    return np.stack(rows, axis=1)


@pytest.mark.parametrize("name", COMPILED)
def test_every_compiled_method_has_the_bits_of_one_top_alone(name, in_lanes):
    """In lanes or not; of 85 tops a block of 21 is left over, which fills more than half of one."""
    n, h = 85, 0.02
    got = integrate_ensemble(LagrangeTop(ALPHAS[:n]), Y0[:n], h, 18, name, every=3, threads=1)
    assert np.array_equal(got, alone(n, h, 18, 3, name))
    if METHODS[name].advance_many is None:
        assert sum(in_lanes) == (0 if name in ALONE else n)


@pytest.mark.parametrize("name", COMPENSATED)
def test_what_a_kernel_carries_along_is_carried_in_lanes(name, in_lanes, monkeypatch):
    monkeypatch.setattr(lanes, "INTERRUPTIBLE", 7)  # several calls of the loop
    n, h, options = 40, 0.1, {"compensated": True}
    got = integrate_ensemble(LagrangeTop(ALPHAS[:n]), Y0[:n], h, 30, name, every=10, threads=1, **options)
    monkeypatch.undo()
    assert np.array_equal(got, alone(n, h, 30, 10, name, **options))
    assert not np.array_equal(got, integrate_ensemble(LagrangeTop(ALPHAS[:n]), Y0[:n], h, 30, name, every=10))
    assert name in ALONE or sum(in_lanes) == 32  # eight are left over, too few for a block


@pytest.mark.parametrize("name", ["strang", "blanes_moan6", "force_gradient4"])
def test_turns_in_parts_are_made_alone(name, in_lanes):
    """In some of the lanes z > PART; all tops have their own bits."""
    for h in (0.7, -2.5):
        got = integrate_ensemble(TOP, Y0, h, 8, name, every=4, threads=1)
        assert np.array_equal(got, one_by_one(h, 8, name, 4))
    assert 0 < sum(in_lanes) < 2 * SIZE


@pytest.mark.parametrize("name", ["strang", "kahan", "bobenko_suris", "rk4", "takahashi_imada"])
def test_failures_among_lanes(name, in_lanes):
    """The errors of one top alone, step number included, and no harm to its neighbours."""
    states = Y0[:64].copy()
    states[5] *= 1e160
    states[40, :3] *= 1e7
    states[40, 3:] *= 1e5
    states[50] *= 1e-170
    top = LagrangeTop(np.abs(ALPHAS[:64]))
    got = integrate_ensemble(top, states, 0.1, 20, name, threads=1, on_failure="nan")
    first = None
    for i, y in enumerate(states):
        try:
            assert np.array_equal(got[i], prepare(LagrangeTop(top.alpha[i]), y, 0.1, name).advance(y, 20))
        except StepError as error:
            first = first or (i, error)
            assert np.isnan(got[i]).all()
    assert sum(in_lanes) >= 32
    if first is not None:
        with pytest.raises(StepError, match=f"top {first[0]}: ") as caught:
            integrate_ensemble(top, states, 0.1, 20, name)
        assert (caught.value.step, caught.value.h) == (first[1].step, 0.1)
        assert first[1].reason in caught.value.reason
    else:
        assert name == "bobenko_suris"


def test_a_lane_that_errs_would_be_found(monkeypatch, in_lanes):
    """The tests of the same bits, on lanes that lose one."""
    right = integrate_ensemble(TOP, Y0, 0.1, 5, "rk4")

    def run(kernel, states, constants, *rest, **options):
        return lanes.run_lanes(kernel, np.nextafter(states, 9), constants, *rest, **options)

    monkeypatch.setattr(ensemble, "run_lanes", run)
    assert not np.array_equal(integrate_ensemble(TOP, Y0, 0.1, 5, "rk4"), right)


@pytest.mark.parametrize("name", ["rkmk4", "implicit_midpoint", "taylor_fixed", "backlund_textbook"])
def test_a_lane_that_should_not_be_declared(name, in_lanes, monkeypatch):
    """Of kernels with loops, or with complex numbers: the bits of one top alone, in lanes or not."""
    monkeypatch.setitem(FixedStepper.__init__.__kwdefaults__, "lane", True)
    n, h = 40, 0.02
    got = integrate_ensemble(LagrangeTop(ALPHAS[:n]), Y0[:n], h, 12, name, threads=1)
    assert np.array_equal(got, alone(n, h, 12, 12, name)[-1])
    assert sum(in_lanes) == (0 if name == "backlund_textbook" else 32)


@pytest.mark.parametrize("name", ["rk45", "taylor"])
def test_times_of_other_methods(name):
    installed(name)
    t = [1.0, 0.5]
    got = integrate_ensemble(LagrangeTop(ALPHAS[:3]), Y0[:3], t=t, method=name)
    for i in range(3):
        assert np.array_equal(got[:, i], integrate(LagrangeTop(ALPHAS[i]), Y0[i], t=t, method=name).y)


# ---------------------------------------------------------------- failures


def failing():
    """Top 3 and top 7 are too quick for their phase to be known; the others are ordinary."""
    states = Y0[:10].copy()
    states[3, :3] *= 1e20
    states[7, :3] *= 1e30
    return LagrangeTop(ALPHAS[:10]), states


@pytest.mark.parametrize("threads", [1, 3])
def test_a_failure_names_the_first_top_and_counts(threads, monkeypatch):
    monkeypatch.setattr(ensemble, "CHUNK", 2)
    top, states = failing()
    with pytest.raises(StepError, match=r"^backlund at h = 0\.1: top 3: \|h\| is over 1e15 .*; 2 of 10 tops fail$"):
        integrate_ensemble(top, states, 0.1, 10, threads=threads)
    with pytest.raises(StepError, match=r"^backlund at h = 0\.1: top 3: [^;]*$"):
        integrate_ensemble(LagrangeTop(ALPHAS[:5]), states[:5], 0.1, 10, threads=threads)
    with pytest.raises(StepError, match="top 3"):
        integrate_ensemble(top, states, t=[0.1], threads=threads)


@pytest.mark.parametrize("every", [None, 5])
def test_failures_as_nan(every):
    top, states = failing()
    good = [i for i in range(10) if i not in (3, 7)]
    rows = integrate_ensemble(top, states, 0.1, 10, every=every, on_failure="nan")
    assert np.isnan(rows[..., [3, 7], :]).all()
    whole = integrate_ensemble(LagrangeTop(ALPHAS[good]), Y0[good], 0.1, 10, every=every)
    assert np.array_equal(rows[..., good, :], whole)


def test_a_step_that_fails_on_the_way():
    """The implicit midpoint rule at a step where it has three solutions, for one top of two."""
    h = 3.0
    states = np.array([Y0[0] * 1e-3, (0.3, -0.4, 0.1, 0.0, 0.6, 0.8)])
    with pytest.raises(StepError) as alone:
        prepare(LagrangeTop(20.0), states[1], h, "implicit_midpoint").advance(states[1], 5)
    with pytest.raises(StepError, match=r"implicit_midpoint at h = 3, step \d+: top 1: ") as caught:
        integrate_ensemble(LagrangeTop(20.0), states, h, 5, "implicit_midpoint")
    assert (caught.value.step, caught.value.h) == (alone.value.step, 3.0)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("threads", [1, 2])
def test_control_c(threads):
    integrate_ensemble(TOP, Y0, 0.1, 1)  # compiled
    with interrupted():
        integrate_ensemble(TOP, Y0, 0.1, 10**10, threads=threads)


# ---------------------------------------------------------------- input


def test_input_is_not_modified_and_may_lie_anyhow_in_memory():
    end = integrate_ensemble(TOP, Y0, 0.1, 5)
    wide = np.zeros((SIZE, 12))
    wide[:, ::2] = Y0
    for layout in (np.asfortranarray(Y0), wide[:, ::2], Y0[::-1].copy()[::-1], Y0.astype(">f8"), Y0.tolist()):
        before = np.array(layout)
        assert np.array_equal(integrate_ensemble(TOP, layout, 0.1, 5), end)
        assert np.array_equal(layout, before)
    frozen = Y0.copy()
    frozen.flags.writeable = False
    got = integrate_ensemble(TOP, frozen, 0.1, 0)
    assert np.array_equal(got, Y0)
    assert not np.shares_memory(got, frozen)
    whole = integrate_ensemble(LagrangeTop(1.0), np.array([[0, 1, 2, 0, 1, 0]]), 0.1, 2)
    assert np.array_equal(whole, integrate_ensemble(LagrangeTop(1.0), [[0.0, 1, 2, 0, 1, 0]], 0.1, 2))


def test_no_tops_and_no_steps():
    none = np.empty((0, 6))
    assert integrate_ensemble(LagrangeTop(), none, 0.1, 10).shape == (0, 6)
    assert integrate_ensemble(LagrangeTop(np.empty(0)), none, 0.1, 10, every=5).shape == (3, 0, 6)
    assert integrate_ensemble(LagrangeTop(), none, t=[1.0]).shape == (1, 0, 6)
    assert integrate_ensemble(TOP, Y0, 0.1, 0, every=3).shape == (1, SIZE, 6)


def test_a_heavy_top_counts_in_seconds():
    heavy = HeavyTop(mass=0.1, gravity=9.81, distance=0.04, A=2e-4, C=1e-4)
    y = heavy.state((0.4, 0.3, 0.1), (0.2, 1.5, 120.0))
    got = integrate_ensemble(heavy, [y, y], 1e-3, 50)
    assert np.array_equal(got[1], prepare(heavy, y, 1e-3).advance(y, 50))


def replaced(value, column=4):
    states = Y0.copy()
    states[2, column] = value
    return states


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ({"Y0": replaced(math.nan)}, r"Y0\[2\]"),
        ({"Y0": replaced(math.inf, 0)}, r"Y0\[2\]"),
        ({"Y0": np.where(np.arange(6) > 2, 0.0, Y0)}, r"Y0\[0\] .* x = 0.* 149 others"),
        ({"Y0": Y0[0]}, "Y0 must have shape"),
        ({"Y0": Y0[:, :5]}, "Y0 must have shape"),
        ({"Y0": Y0.astype(complex)}, "Y0 must be real"),
        ({"Y0": Y0.astype(str)}, "Y0 must be real"),
        ({"Y0": [[1.0], [1.0, 2.0]]}, "Y0 must be states"),
        ({"Y0": Y0[1:]}, "150 values of alpha, Y0 149"),
        ({"h": 0.0}, "h must not be 0"),
        ({"h": math.nan}, "h must be finite"),
        ({"h": None}, "give h and steps"),
        ({"steps": -1}, "steps"),
        ({"steps": 2.0}, "steps"),
        ({"every": 3}, "every = 3"),
        ({"every": 0}, "every"),
        ({"t": [1.0]}, "either t or h"),
        ({"t": [math.nan], "h": None, "steps": None}, "t must be"),
        ({"t": [1.0], "h": None, "steps": None, "method": "rk45_fixed"}, "t: rk45_fixed"),
        ({"threads": 0}, "threads"),
        ({"on_failure": "ignore"}, "on_failure"),
        ({"method": "backlunt"}, "did you mean 'backlund'"),
        ({"method": 3}, "method"),
        ({"pim": 3}, "did you mean 'pin'"),
        ({"pin": -1}, "pin"),
        ({"lam": -1j}, "lam"),
        ({"top": 1.0}, "top must be"),
    ],
)
def test_bad_input(wrong, name):
    arguments = {"top": TOP, "Y0": Y0, "h": 0.1, "steps": 10, **wrong}
    with pytest.raises(ValueError, match=name):
        integrate_ensemble(**arguments)


def test_a_top_with_many_alphas_is_for_ensembles_only():
    many = LagrangeTop(np.array([1.0, 2.0]))
    y = TOPS["generic"].state
    calls = (
        lambda: integrate(many, y, 0.1, 1),
        lambda: prepare(many, y, 0.1),
        lambda: exact.solution(many, y, 1.0),
        lambda: exact.nutation_period(many, y),
        lambda: many.scales(y),
        lambda: many.jacobian(y),
        lambda: many.gradients(y),
    )
    for call in calls:
        with pytest.raises(ValueError, match="2 values of alpha"):
            call()
    rows = np.array([[y, y], [y, y]])
    assert np.array_equal(many.invariants(rows)[1, 1], LagrangeTop(2.0).invariants(y))
    assert np.array_equal(many.rhs(rows)[0, 0], LagrangeTop(1.0).rhs(y))
    for bad in (np.array([1.0, math.nan]), np.array([1j]), np.array(["1"])):
        with pytest.raises(ValueError, match="alpha"):
            LagrangeTop(bad)
    source = np.array([1.0, 2.0])
    held = LagrangeTop(source)
    source[0] = 5.0
    assert held.alpha[0] == 1.0
    assert np.array_equal(pickle.loads(pickle.dumps(held)).alpha, held.alpha)
