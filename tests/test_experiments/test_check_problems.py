"""`check` on problems of one's own, and on bodies: right claims pass, false ones do not."""

from dataclasses import replace

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, metrics
from lagrange_bench.integrators import METHODS, Problem
from lagrange_bench.integrators.problem import free_body
from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot
from lagrange_bench.integrators.truth import truths

BODY, START = free_body.free_body(1.0, 2.0, 3.0), (0.3, -0.4, 1.2)
PIVOT, TOP_START = vibrating_pivot(1.0, 0.02, 3.0), (0.3, -0.2, 1.1, 0.4, 0.1, 0.9)
SPINS = Problem(
    "spins", 2, lambda t, y, p: p[0] * (y[0] * y[3] + y[1] * y[4] + y[2] * y[5]) + y[2] + 2.0 * y[5], (1.0,)
)
SPINS_START = (1.0, 0.0, 0.2, 0.3, -0.5, 0.6)


def failed(verdicts):
    return {v.claim for v in verdicts if v.passed is False}


@pytest.mark.parametrize(
    ("method", "problem", "y0"),
    [
        ("strang", BODY, START),
        ("rkmk4", SPINS, SPINS_START),
        ("strang", SPINS, SPINS_START),
        ("rk4", PIVOT, TOP_START),
        ("backlund_splitting", PIVOT, TOP_START),
    ],
    ids=["strang-body", "rkmk4-spins", "strang-spins", "rk4-pivot", "backlund-pivot"],
)
def test_claims_hold_on_a_problem(method, problem, y0):
    verdicts = check.check(method, quick=True, problem=problem, y0=y0)
    assert not failed(verdicts)
    assert any("order" in v.claim and v.passed for v in verdicts)
    assert {v.claim.partition(": ")[0] for v in verdicts} == {problem.name}


def test_false_claims_fail_on_a_problem():
    honest = METHODS["rk4"]
    liar = replace(honest, symmetric=True, poisson=True, conserves=frozenset({"C1", "C2"}), order=3)
    wrong = {"order 3", "symmetric", "Poisson map", "conserves C"}
    assert failed(check.check(liar, quick=True, problem=BODY, y0=START)) == {f"free_body: {claim}" for claim in wrong}


def test_the_reference_of_a_problem_is_the_closed_form():
    times = np.array((-3.0, 0.5, 20.0))
    exact = free_body.solution(BODY, START, times)
    np.testing.assert_allclose(truths.solution(BODY, np.array(START), times), exact, atol=1e-14)
    later = truths.after_steps(BODY, np.array(START), 0.1, [200])
    assert metrics.scaled_error(BODY, np.array(START), later, exact[2:])[0] < 1e-14


def test_bad_calls_are_refused():
    for words, reason in (
        ({"method": "backlund_splitting", "problem": BODY, "y0": START}, "problem: backlund_splitting needs"),
        ({"method": "rk4", "problem": BODY}, "y0: give a state"),
        ({"method": "rk4", "problem": BODY, "y0": (1.0, 2.0)}, "y0"),
    ):
        with pytest.raises(ValueError, match=reason):
            check.check(**words)
