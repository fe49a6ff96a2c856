"""A claim passes only on rows that bear it out: not on missing ones, not on failed cells, not on NaN."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from experiments import EXPERIMENTS
from report import claims, promises
from report.claims import Claim, NoData, Verdict


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_never_passes(value):
    rows = pd.DataFrame({"status": ["done"] * 2, "drift": [0.0, value]})
    assert claims.within(1.0, "drift")(rows).passed is False
    assert claims.at_most(1.0, "drift")(rows).passed is False
    assert claims.at_least(-1.0, "drift")(rows).passed is (value == np.inf)


def test_a_failed_cell_counts_where_a_measured_field_is_asked_for():
    rows = pd.DataFrame(
        {
            "method": ["a", "a"],
            "status": ["done", "failed"],
            "failure": [None, "E"],
            "name": ["H", None],
            "x": [1, None],
        }
    )
    assert claims.within(9.0, "x", name="H")(rows).passed is False
    assert claims.ratio_at_least(2.0, "x", {"name": "H"}, {"name": "H"})(rows).passed is False


def test_a_broken_check_is_no_data_and_is_reported():
    rows = pd.DataFrame({"status": ["done"]})
    verdict, error = claims.judge(Claim("c", "", "e", lambda rows: 1 / 0), rows)  # type: ignore[arg-type]
    assert verdict.passed is None
    assert error is not None
    assert "ZeroDivisionError" in error
    verdict, error = claims.judge(Claim("c", "", "e", lambda rows: Verdict(1, 2, rows["gone"].all())), rows)
    assert (verdict.passed, error) == (None, None)
    assert "gone" in verdict.note


def test_claims_of_the_project_can_be_judged_by_nothing():
    assert len({claim.id for claim in promises.CLAIMS}) == len(promises.CLAIMS)
    for claim in promises.CLAIMS:
        assert claim.experiment in EXPERIMENTS
        verdict, error = claims.judge(claim, pd.DataFrame())
        assert (verdict.passed, error) == (None, None)
        with pytest.raises((NoData, KeyError, AttributeError)):
            claim.check(pd.DataFrame())
