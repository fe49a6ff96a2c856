"""Explicit Runge-Kutta: projection, step control."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench import TOPS, LagrangeTop, PerturbedTop, Potential, StepError, exact, integrate, metrics, prepare
from lagrange_bench.integrators.methods import dop853, runge_kutta
from tests.reference import drift

EPS = np.finfo(float).eps
U = EPS / 2


@pytest.mark.parametrize("name", ["generic", "fast", "regular", "sleeping_unstable", "hanging", "homoclinic"])
def test_projection_holds_the_invariants(name):
    """Bounded by what one evaluation rounds, also where gradients depend on each other: no more than DAMPING is lost."""
    top, y0 = TOPS[name].top, TOPS[name].state

    def off(method, span, n):
        return np.max(drift(top, y0, prepare(top, y0, span * top.scales(y0)[2], method).record(y0, n, n // 1000)))

    ordinary = name in ("generic", "fast")
    for span in (0.1, 0.6):
        assert off("verner9_projected", span, 20_000) < 16 * U + (0 if ordinary else 2 * runge_kutta.DAMPING)


@pytest.mark.parametrize(("name", "rtol"), [("generic", 1e-3), ("figure1", 1e-6), ("fast", 1e-9), ("slow", 1e-12)])
def test_dop853_does_as_scipys(name, rtol):
    """The same formula and much the same control: as many steps, errors within a factor of two."""
    top, y0 = TOPS[name].top, TOPS[name].state
    t = 30 * top.scales(y0)[2]
    run = integrate(top, y0, t, 1, "dop853", rtol=rtol, atol=1e-3 * rtol)
    work = run.work
    assert work.rhs_evals == 2 + 12 * (work.steps + work.rejected)  # first step; 11 stages and a new slope
    scipys = solve_ivp(lambda t, y: top.rhs(y), (0.0, t), y0, "DOP853", rtol=rtol, atol=1e-3 * rtol)
    assert work.steps == pytest.approx(len(scipys.t) - 1, rel=0.1, abs=1)
    error = metrics.scaled_error(top, y0, scipys.y[:, -1], exact.solution(top, y0, [t])[0])
    assert run.error()[-1] == pytest.approx(error, rel=1.0, abs=1e-12)


def test_a_run_that_lost_its_top_ends():
    """atol is 10⁵ times the size of J: the steps grew beyond all measure, |x| with them, and then it took 10¹⁰ steps."""
    y = (5.6e-18, -6.9e-18, 1.1e-17, -4.6e-70, -2.1e-70, 2.8e-70)
    with pytest.raises(StepError, match="rtol and atol do not hold this state"):
        integrate(LagrangeTop(-1.7e35), y, -2.9e17, 40, "dop853", every=10, atol=1e-12)


@pytest.mark.interpreted
def test_the_step_after_a_rejected_one_does_not_grow():
    tried = []

    def trial(s, t, h, c):
        tried.append(h)
        return s, (2.0 if len(tried) == 2 else 0.5), (0.5 if len(tried) == 2 else 2.0), None

    walk = np.zeros(dop853.WALK)
    walk[dop853.STEP] = 0.125
    run = dop853.compile_loop.__wrapped__(trial, None, None, 1)
    run(np.zeros(1), np.array([1.5]), 100, None, walk, np.zeros((1, 1)))
    assert tried == [0.125, 0.25, 0.125, 0.125, 0.25, 0.5, 0.375]


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")
@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["dop853", "rk45", "verner9_projected"])
def test_into_a_singularity(name):
    """A charge that attracts, and stands where the axis goes: an end with a StepError, not a number."""
    pole = Potential("pole", lambda x1, x2, x3, p: -p[0] / (1 - x3) ** 2)
    problem, y = PerturbedTop(LagrangeTop(0.0), pole, (1.0,)), np.array((0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    with pytest.raises(StepError):
        prepare(problem, y, 0.05, name).advance(y, 400)
