"""Round-off: how far the invariants may wander in a million steps, and that the forms compared in the experiment are one map.

u = 2⁻⁵³ is half an ulp of 1. Errors are relative to the size of the terms in each invariant. Steps are in units of the top's
own time scale 1/(|J| + √(|alpha||x|)).
"""

import numpy as np
import pytest

from lagrange_bench.experiments import round_off
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.truth import exact

U, N = 2.0**-53, 10**5
TABLE = [  # method, options, h, bound of H, C1 and C2
    # pinned: what eight steps round, for ever
    ("backlund", {}, 2.0, 16 * U),
    ("backlund_paper", {}, 2.0, 16 * U),
    # constants rounded once push the same way in every step; divisions lose digits
    ("backlund", {"pin": 0}, 0.1, U / 64 * N),
    ("backlund_textbook", {}, 0.1, U / 16 * N),
    # a random walk of roundings of u or less: 3 σ of √n u, over four states; larger steps round more
    ("implicit_midpoint", {}, 0.5, 6 * U * N**0.5),
    ("implicit_midpoint", {"solver": "newton"}, 0.1, 3 * U * N**0.5),
]


@pytest.mark.parametrize(("method", "options", "h", "bound"), TABLE)
def test_invariants_wander_no_further_than_this(method, options, h, bound):
    for name in ("generic", "figure1", "fast", "slow"):
        top, y0 = find(name)
        rows = prepare(top, y0, h * top.scales(y0)[2], method, **options).record(y0, N, N // 20)
        drift = np.abs(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0)))
        assert np.max(drift[:, [0, 2, 3]]) <= bound, (name, np.max(drift, axis=0) / U)


def test_errors_of_a_midpoint_rule_that_is_solved_to_a_tolerance_drift():
    """What its iteration leaves has a direction; solved to round-off, its errors walk at random (test_random_walks.py)."""
    n, errors = 100_000, []
    for name in states.RANDOM:
        top, y0 = find(name)
        stepper = round_off.FORMS["midpoint, tolerance 1e-12"][1](top, y0, 0.25 * top.scales(y0)[2])
        rows = stepper.record(y0, n, n // 1000)
        errors.append(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0)))
    assert max(metrics.growth_exponent(np.arange(1001.0), np.array(errors)[:, :, k]).p for k in (0, 2, 3)) > 0.9


STEPS = 200


def run(form, state, span):
    top, y0 = find(state)
    return top, y0, round_off.FORMS[form][1](top, y0, span * top.scales(y0)[2]).advance(y0, STEPS)


@pytest.mark.parametrize("method", ["backlund", "implicit_midpoint", "strang"])
def test_forms_are_one_map_but_for_round_off(method):
    forms = [form for form, (of, _) in round_off.FORMS.items() if of == method]
    for state, span in (("generic", 0.125), ("random003", 0.125), ("random003", 1.0 if method == "backlund" else 0.1)):
        top, y0, expected = run(forms[-1], state, span)
        for form in forms[:-1]:
            found = run(form, state, span)[2]
            assert metrics.scaled_error(top, y0, found, expected) < 1e-10, form
            assert form.startswith("pinned") or not np.array_equal(found, expected), form


@pytest.mark.parametrize("fraction", round_off.FRACTIONS)
def test_forms_of_long_steps_are_one_map(fraction):
    forms = {c["form"] for c in round_off.cells("quick") if c.get("fraction") == fraction}
    top, y0 = find("random003")
    h = fraction * exact.nutation_period(top, y0)
    truth = exact.after_steps(top, y0, h, [STEPS])[0]
    ends = [round_off.FORMS[form][1](top, y0, h).advance(y0, STEPS) for form in forms]
    assert max(metrics.scaled_error(top, y0, y, truth) for y in ends) < 1e-10
