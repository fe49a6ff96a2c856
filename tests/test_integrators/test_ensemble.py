"""Many tops at once: the bits of one at a time, whatever the chunks and threads; failures are named; input is checked."""

import math
from functools import partial

import numpy as np
import pandas as pd
import pytest

from lagrange_bench import METHODS, TOPS, LagrangeTop, PerturbedTop, StepError, available, exact
from lagrange_bench.integrators import integrate, integrate_ensemble, prepare
from lagrange_bench.integrators.compiling import lanes
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

RNG = np.random.default_rng(5)
STATES = RNG.uniform(-1, 1, (8, 6))
STATES[:, 3:] /= np.linalg.norm(STATES[:, 3:], axis=1)[:, None]

# formulas that other tests use too: they are compiled once for all
HARDLY = [STATES[1], *([J, -J, 0.0, 1.0, 0.0, 0.0] for J in (1e-155, 1e-163, 1e-170, 5e-324, 0.0))]  # squares underflow
TOPS_IN = {
    "charge": (PerturbedTop(LagrangeTop(0.7), CHARGE, (0.3, 2.0, 1.0, 0.5)), STATES),
    "weak tide": (PerturbedTop(LagrangeTop(0.7), TIDE, (1e-6, 0.8, 0.0, 0.6)), STATES),
    "hardly turning": (PerturbedTop(LagrangeTop(0.0), TIDE, (0.3, 0.6, 0.0, 0.8)), HARDLY),
}
HEYOKA = pytest.mark.skipif(not available(METHODS["taylor"]), reason="heyoka is not installed")


def together(*arguments, **run):
    """Rows of many tops (rows, n, 6)."""
    return integrate_ensemble(*arguments, **run).y


def one(problem, place):
    """The top at this place of many."""
    return LagrangeTop(problem.alpha[place]) if np.ndim(problem.alpha) else problem


def one_by_one(problem, states, **run):
    """Rows of many tops, each by itself."""
    return np.stack([integrate(one(problem, i), y, **run).y for i, y in enumerate(states)], axis=1)


@pytest.mark.parametrize("h", [0.1, 5.0])
def test_every_named_top_and_any_size_has_the_bits_of_its_own_run(h):
    """In all forms of the exact step, with turns after the steps and without; side by side with powers of two from 2^-1060 to
    2^500, which are in their own units all the same, or taken alone."""
    y, sizes = TOPS["generic"].state, ((0, 0), (-400, 0), (400, 0), (-1000, -300), (500, 0), (0, -1060))
    tops = [(n.alpha, n.state) for n in TOPS.values()]
    tops += [(math.ldexp(1.0, max(2 * b - a, -1074)), y * np.ldexp(1.0, [b, b, b, a, a, a])) for a, b in sizes]
    many, states = LagrangeTop(np.array([alpha for alpha, _ in tops])), np.array([state for _, state in tops])
    run = {"h": h, "steps": 40, "every": 40}
    assert np.array_equal(together(many, states, **run), one_by_one(many, states, method="backlund", **run))


def test_nothing_depends_on_place_threads_or_interruptions(monkeypatch):
    order = np.random.default_rng(2).permutation(SIZE)
    for h, steps in ((1.5, 16), (0.1, 64)):
        end = together(TOP, Y0, h, steps, threads=1)[0]
        assert np.array_equal(together(LagrangeTop(ALPHAS[order]), Y0[order], h, steps)[0], end[order])
    monkeypatch.setattr(lanes, "INTERRUPTIBLE", 7)
    assert np.array_equal(together(TOP, Y0, 0.1, 64, every=4, threads=3)[-1], end)


TIMES = {"t": [0.3, 0.0, -2.0]}


@pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning")
@pytest.mark.parametrize(
    ("name", "tops", "grid", "options"),
    [
        ("backlund", SIZE, -0.3, {}),
        ("backlund", SIZE, 40.0, {}),  # with turns
        ("backlund", 40, 0.2, {"lam": 0.3 + 0.4j}),
        ("backlund", SIZE, {"t": [0.3, 0.0, -2.0, 1e4]}, {}),
        *((name, 20, 0.02, {}) for name in ("rk4", "dop853", "rk45")),
        *(("dop853", "charge", grid, {}) for grid in (0.02, TIMES)),
        ("backlund_splitting", "weak tide", 0.1, {}),
        *(("backlund_splitting", "hardly turning", grid, {}) for grid in (0.05, TIMES)),
        *(pytest.param("taylor", "charge", grid, {}, marks=HEYOKA) for grid in (0.1, TIMES)),
    ],
)
def test_every_method_has_the_bits_of_one_top_alone(name, tops, grid, options):
    """At each step size, and at any times."""
    problem, states = TOPS_IN[tops] if tops in TOPS_IN else (LagrangeTop(ALPHAS[:tops]), Y0[:tops])
    grid = grid if isinstance(grid, dict) else {"h": grid, "steps": 18, "every": 6}
    rows = together(problem, states, method=name, threads=2, **grid, **options)
    assert np.array_equal(rows, one_by_one(problem, states, method=name, **grid, **options))
    if options:  # they are seen
        assert not np.array_equal(rows, one_by_one(problem, states, method=name, **grid))
    if tops in TOPS_IN:  # the potential is there
        assert np.max(np.abs(rows - together(LagrangeTop(problem.alpha), states, **grid))) > 1e-7


@pytest.mark.parametrize("name", ["backlund", "strang"])
def test_failures_among_others(name):
    """The errors of one top alone, step number included, and no harm to its neighbours."""
    states = Y0[:64].copy()
    states[5] *= 1e160
    states[40] *= np.repeat((1e7, 1e5), 3)
    states[50] *= 1e-170
    top, errors = LagrangeTop(np.abs(ALPHAS[:64])), {}
    (got,) = together(top, states, 0.1, 20, name, threads=1, on_failure="nan")
    for i, y in enumerate(states):
        try:
            assert np.array_equal(got[i], prepare(LagrangeTop(top.alpha[i]), y, 0.1, name).advance(y, 20))
        except StepError as error:
            errors[i] = error
            assert np.isnan(got[i]).all()
    first = min(errors)
    count = f".*; {len(errors)} of 64 tops fail$" if len(errors) > 1 else ""  # of the second method there are several
    with pytest.raises(StepError, match=f"top {first}: {count}") as caught:
        integrate_ensemble(top, states, 0.1, 20, name)
    assert (caught.value.step, caught.value.h) == (errors[first].step, 0.1)
    assert errors[first].reason in caught.value.reason


def test_states_may_come_from_a_frame_or_be_none():
    frame = pd.DataFrame(Y0, columns=["J1", "J2", "J3", "x1", "x2", "x3"])
    assert np.array_equal(together(TOP, frame, 0.1, 4), together(TOP, Y0, 0.1, 4))
    assert together(LagrangeTop(np.empty(0)), np.empty((0, 6)), 0.1, 10, every=5).shape == (3, 0, 6)


def test_a_top_with_many_alphas_is_for_ensembles_only():
    many, y = LagrangeTop(np.array([1.0, 2.0])), TOPS["generic"].state
    for call in (many.scales, many.jacobian, partial(exact.solution, many, t=1.0), partial(prepare, many, h=0.1)):
        with pytest.raises(ValueError, match="2 values of alpha"):
            call(y0=y) if isinstance(call, partial) else call(y)
    rows = np.array([[y, y], [y, y]])
    assert np.array_equal(many.invariants(rows)[1, 1], LagrangeTop(2.0).invariants(y))
    assert np.array_equal(many.rhs(rows)[0, 0], LagrangeTop(1.0).rhs(y))


def test_control_c():
    integrate_ensemble(TOP, Y0, 0.1, 1)  # compiled
    with interrupted():
        integrate_ensemble(TOP, Y0, 0.1, 10**10, threads=2)
