"""The forms compared in the round-off experiment are one map each: they differ by round-off only, and not by nothing."""

import numpy as np
import pytest

from lagrange_bench.experiments import round_off
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import StepError, prepare
from lagrange_bench.integrators.truth import exact

STEPS = 200


def run(form, state, span):
    top, y0 = find(state)
    h = span * top.scales(y0)[2]
    return top, y0, round_off.FORMS[form][1](top, y0, h).advance(y0, STEPS)


@pytest.mark.parametrize("span", round_off.SIZES)
@pytest.mark.parametrize("form", [form for form, (of, _) in round_off.FORMS.items() if of == "backlund"])
def test_forms_of_the_exact_step_are_one_map(form, span):
    for state in ("generic", "figure1", "random003"):
        top, y0, expected = run("pinned, every 8", state, span)
        _, _, found = run(form, state, span)
        assert metrics.scaled_error(top, y0, found, expected) < 1e-10
        if not form.startswith("pinned"):
            assert not np.array_equal(found, expected)


@pytest.mark.parametrize("fraction", round_off.FRACTIONS)
def test_forms_of_long_steps_are_one_map(fraction):
    forms = {c["form"] for c in round_off.cells("quick") if c.get("fraction") == fraction}
    for state in ("generic", "random003"):
        top, y0 = find(state)
        h = fraction * exact.nutation_period(top, y0)
        ends = {form: round_off.FORMS[form][1](top, y0, h).advance(y0, STEPS) for form in forms}
        truth = exact.after_steps(top, y0, h, [STEPS])[0]
        assert max(metrics.scaled_error(top, y0, y, truth) for y in ends.values()) < 1e-10


def test_a_form_that_leaves_its_torus_is_followed():
    """Negative control: the registered method refuses such a state."""
    top, y0 = find("generic")
    away = y0 * (1 + 1e-9)
    h = 0.125 * top.scales(y0)[2]
    assert np.isfinite(round_off.FORMS["x assigned"][1](top, y0, h).advance(away, STEPS)).all()
    with pytest.raises(StepError, match="not on the torus"):
        prepare(top, y0, h, "backlund_unpinned").advance(away, STEPS)


@pytest.mark.parametrize("of", ["implicit_midpoint", "strang"])
def test_forms_of_a_rival_are_one_map(of):
    forms = [form for form, (method, _) in round_off.FORMS.items() if method == of]
    for state in ("generic", "figure1"):
        ends = [run(form, state, 0.125) for form in forms]
        top, y0, expected = ends[-1]
        for _, _, found in ends[:-1]:
            assert 0 < metrics.scaled_error(top, y0, found, expected) < 1e-9


def test_the_long_run_meets_heyoka():
    pytest.importorskip("heyoka")
    rows = round_off.measure({"part": "long", "state": "generic", "h": 0.125, "steps": 4096})
    assert {row["method"] for row in rows} == {"backlund", "taylor"}
    assert max(row["error"] for row in rows) < 1e-10
