"""Many tops in a potential at once: the bits of one at a time, each with its own numbers; what is refused says why."""

import numpy as np
import pytest

from lagrange_bench.integrators import (
    METHODS,
    LagrangeTop,
    StepError,
    available,
    ensemble,
    integrate,
    integrate_ensemble,
    prepare,
)
from lagrange_bench.integrators.methods import backlund_splitting, taylor
from lagrange_bench.integrators.problem.perturbed import PerturbedTop, Potential
from lagrange_bench.integrators.problem.potentials import CHARGE, TIDE

SIZE = 45  # a block of lanes and thirteen tops more
RNG = np.random.default_rng(5)
STATES = RNG.uniform(-1, 1, (SIZE, 6))
STATES[:, 3:] /= np.linalg.norm(STATES[:, 3:], axis=1)[:, None]
ALPHAS, NUMBERS = RNG.uniform(0.5, 2, SIZE), RNG.uniform(0.1, 0.9, SIZE)

# formulas that other tests use too: they are compiled once for all
ALONG, PLACE, ABOVE = (0.8, 0.0, 0.6), (2.0, 1.0, 0.5), (0.0, 0.0, 1.6)
TOPS_IN = {
    "all numbers": PerturbedTop(LagrangeTop(ALPHAS), TIDE, (NUMBERS, *ALONG)),
    "some numbers": PerturbedTop(LagrangeTop(0.7), CHARGE, (NUMBERS, *PLACE)),
    "alpha only": PerturbedTop(LagrangeTop(ALPHAS), CHARGE, (0.4, *ABOVE)),
}
HEYOKA = pytest.mark.skipif(not available(METHODS["taylor"]), reason="heyoka is not installed")


def one(problem, place):
    """The top at this place of many."""
    alpha, *parameters = (
        float(value[place]) if isinstance(value, np.ndarray) else value
        for value in (problem.alpha, *getattr(problem, "parameters", ()))
    )
    top = LagrangeTop(alpha)
    return PerturbedTop(top, problem.potential, parameters) if parameters else top


def one_by_one(problem, states, h, steps, every, name, **options):
    """Rows of many tops, each by itself."""
    rows = [prepare(one(problem, i), y, h, name, **options).record(y, steps, every) for i, y in enumerate(states)]
    return np.stack(rows, axis=1)


@pytest.mark.parametrize(
    ("name", "kind", "options"),
    [
        *(("rk4", kind, {}) for kind in ("all numbers", "alpha only")),
        *(("strang", "some numbers", options) for options in ({}, {"compensated": True})),
        pytest.param("dop853", "some numbers", {}, marks=pytest.mark.interpreted),
    ],
)
def test_the_bits_of_one_top_alone(name, kind, options, in_lanes):
    problem = TOPS_IN[kind]
    got = integrate_ensemble(problem, STATES, 0.02, 12, name, every=3, threads=1, **options)
    assert np.array_equal(got, one_by_one(problem, STATES, 0.02, 12, 3, name, **options))
    assert sum(in_lanes) == (0 if name == "dop853" else 32)
    another = integrate_ensemble(LagrangeTop(problem.alpha), STATES, 0.02, 12, name, every=3)
    assert np.max(np.abs(another - got)) > 1e-4  # the potential is there


WEAK = PerturbedTop(LagrangeTop(ALPHAS), TIDE, (1e-3 * NUMBERS, *ALONG))


@pytest.mark.parametrize(("potential", "fixed", "options"), [(TIDE, ALONG, {}), (CHARGE, ABOVE, {"scheme": "saba4"})])
def test_the_exact_step_with_a_parameter_for_each_top(potential, fixed, options, in_lanes):
    """From a table or without one, rows on the way included; C1 and C2 stay."""
    problem = PerturbedTop(LagrangeTop(ALPHAS), potential, (1e-6 * NUMBERS, *fixed))
    got = integrate_ensemble(problem, STATES, 0.1, 120, "backlund_splitting", every=60, threads=1, **options)
    assert np.array_equal(got, one_by_one(problem, STATES, 0.1, 120, 60, "backlund_splitting", **options))
    assert sum(in_lanes) >= 32
    C = np.stack([np.sum(got[..., 3:] ** 2, axis=-1), np.sum(got[..., 3:] * got[..., :3], axis=-1)])
    assert np.max(np.abs(C - C[:, :1])) < 16 * 2.0**-52
    other = integrate_ensemble(LagrangeTop(ALPHAS), STATES, 0.1, 120, every=60)
    assert np.max(np.abs(got - other)) > 1e-7  # the potential is there


def test_where_lanes_do_not_reach_tops_are_taken_alone(in_lanes, monkeypatch):
    """They leave the box of their table."""
    monkeypatch.setattr(backlund_splitting, "MARGIN", 0.9)
    got = integrate_ensemble(WEAK, STATES, 0.1, 120, "backlund_splitting", threads=1)
    assert np.array_equal(got, one_by_one(WEAK, STATES, 0.1, 120, 120, "backlund_splitting")[-1])
    assert 0 < sum(in_lanes) < 32


BOTH = Potential("both", lambda x1, x2, x3, p: x3 * x3 + p[0] * x1 * x2)


@pytest.mark.interpreted
def test_tops_that_keep_j3_and_tops_that_do_not(in_lanes):
    """For some of the numbers the potential does not depend on the direction: other kernels, side by side."""
    problem = PerturbedTop(LagrangeTop(ALPHAS), BOTH, (np.where(np.arange(SIZE) % 2 == 1, 0.0, NUMBERS),))
    got = integrate_ensemble(problem, STATES, 0.05, 10, "rk4", threads=1)
    assert np.array_equal(got, one_by_one(problem, STATES, 0.05, 10, 10, "rk4")[-1])
    assert sorted(in_lanes) == [22, 23]
    assert np.array_equal(got[1::2, 2], STATES[1::2, 2])
    assert not np.any(got[::2, 2] == STATES[::2, 2])


@HEYOKA
def test_heyoka_in_batches(monkeypatch):
    """None is taken alone; of tops that keep J3 and of others. Other code than that of one top: round-off."""
    mixed = PerturbedTop(LagrangeTop(ALPHAS), BOTH, (np.where(np.arange(SIZE) % 2 == 0, 0.0, NUMBERS),))
    problems = (LagrangeTop(ALPHAS), TOPS_IN["all numbers"], TOPS_IN["alpha only"], mixed)
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


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["dop853", "scipy_dop853", pytest.param("taylor", marks=HEYOKA)])
def test_at_times(name):
    problem, t = TOPS_IN["some numbers"], [1.0, 0.0, -0.5]
    problem = PerturbedTop(problem.top, problem.potential, (NUMBERS[:4], *PLACE))
    got = integrate_ensemble(problem, STATES[:4], t=t, method=name)
    for i in range(4):
        assert np.array_equal(got[:, i], integrate(one(problem, i), STATES[i], t=t, method=name).y)
    assert not np.array_equal(got[0], got[2])


@pytest.mark.interpreted
def test_failures():
    """The charge is met by the axis of top 1."""
    pole = Potential("pole", lambda x1, x2, x3, p: -p[0] / (1 - x3) ** 2)
    states = np.array([(0.0, 0.0, 0.0, 0.0, 0.6, -0.8), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)])
    problem = PerturbedTop(LagrangeTop(0.0), pole, (np.array([0.0, 1.0]),))
    with pytest.raises(StepError, match=r"dop853.*top 1: the step fell below"):
        integrate_ensemble(problem, states, 0.05, 400, "dop853")
    got = integrate_ensemble(problem, states, 0.05, 400, "dop853", on_failure="nan")
    assert np.isnan(got[1]).all()
    assert np.isfinite(got[0]).all()
