"""Which method to take: the cheapest stored run that reaches the error and conserves what is asked for."""

import pandas as pd
import pytest

from lagrange_bench.report import chooser

RUNS = [  # method, h, error, seconds, set-up
    ("rk4", 0.5, 3e-5, 1e-3, 0.0),
    ("rk4", 0.1, 3e-9, 5e-3, 0.0),
    ("backlund", 8.0, 1e-15, 2e-3, 2e-3),
    ("strang", 0.1, 2e-5, 2e-3, 0.0),
    ("strang", 0.3, float("nan"), 1e-6, 0.0),
]


@pytest.fixture
def answers():
    columns = ["method", "h", "error", "seconds", "setup_seconds"]
    rows = pd.DataFrame(RUNS, columns=columns).assign(state="generic", span=100.0, status="done")
    return chooser.answers({"work_precision": rows}).set_index(["error at most", "must conserve"])


def test_the_cheapest_with_set_up_that_reaches_the_error(answers):
    best = answers.name.xs(chooser.NOTHING, level=1).to_dict()
    assert best == {"10⁻⁴": "rk4", **dict.fromkeys(("10⁻⁶", "10⁻⁸", "10⁻¹⁰", "10⁻¹²"), "backlund")}
    first = answers.loc[("10⁻⁶", chooser.NOTHING)]
    assert first[["with", "cost"]].to_list() == ["h = 8", "4 ms"]
    assert first["best of another family"] == "RK4, 1.2 times as long"


def test_what_must_be_conserved_is_what_the_method_claims(answers):
    assert answers.name["10⁻⁴", chooser.LENGTHS] == "strang"
    assert answers.name["10⁻⁴", chooser.ENERGY] == "backlund"


def test_a_body_is_priced_by_all_its_steps_and_nan_never_wins():
    position = [1e-5, float("nan"), 1e-9]
    rows = pd.DataFrame({"method": ["rk4", "rk4", "rkmk4"], "h": [0.1, 0.2, 0.05], "position": position})
    rows = rows.assign(rotation=1e-9, ns_per_step=1e3, case="kovalevskaya", status="done")
    found = chooser.answers({"heavy_top": rows})
    found = found[found["must conserve"] == chooser.NOTHING].set_index("error at most")
    assert (found["with"]["10⁻⁴"], found.cost["10⁻⁴"]) == ("h = 0.1", "0.1 ms")
    assert found["best of another family"]["10⁻⁴"].endswith("2 times as long")
    assert found.name["10⁻⁸"] == "rkmk4"


def test_without_rows_there_is_no_answer():
    assert chooser.answers({}).empty
