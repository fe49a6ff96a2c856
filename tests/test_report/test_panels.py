"""The data of the methods' panels: curves of the stored rows, whoever wrote the method and whatever field the top is in."""

import json

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.integrators import METHODS
from lagrange_bench.report import panels, promises
from lagrange_bench.report.promises import CLAIMS


def frame(**columns):
    return pd.DataFrame({"status": "done", **columns})


@pytest.fixture
def rows(monkeypatch):
    order = {"method": "mine", "claimed": 2, "measured": 1.987, "hidden": False, "state": "generic"}
    verdict = {"method": "mine", "invariant": "H", "claimed": False, "verdict": "biased"}
    verdict |= {"largest relative error": 0.0123}
    tables = {"orders": pd.DataFrame([order]), "verdicts": pd.DataFrame([verdict])}
    monkeypatch.setattr(panels, "table", lambda stored, experiment, name: tables[name])
    inf, nan = np.inf, np.nan
    return {
        "phase": frame(part="h", state="generic", method=["mine", "mine", "rk4"], h=[0.1, 1.0, 1.0], error=[1e-3, 0.0, inf]),
        "drift": frame(
            part="time", state="generic", method="mine", t=[1.0, 10.0, 100.0], H=[1e-9, -1e-3, 1e-5], J3=0.0, C1=0.0, C2=0.0
        ),
        "perturbed": frame(
            part=["work", "work", "drift", "drift"], state="weak_tide", method="mine", span=[1e3, 1e5, nan, nan],
            error=[1e-8, 1e-9, nan, nan], seconds=[0.05, 9.0, nan, nan], setup_seconds=[0.05, 0.0, nan, nan],
            t=[nan, nan, 1.0, 10.0], H=[nan, nan, 1e-6, 1e-7], J3=[nan, nan, 0.5, 0.5], C1=1e-16, C2=0.0,
        ),
    }  # fmt: skip


def test_curves_of_a_plug_in_in_any_field(rows):
    generic, tide = json.loads(panels.script(rows))["tops"]
    assert (generic["name"], generic["h"]) == ("generic", {"mine": [-20, -60, 0, -340], "rk4": []})
    assert generic["drift"] == {"mine": [40, -60]}  # the largest so far
    assert (generic["work"], generic["span"]) == ({}, "")
    assert (tide["name"], tide["span"], tide["work"]) == ("weak_tide", "1000", {"mine": [-20, -160]})
    assert tide["drift"] == {"mine": [20, -120]}  # J3 is not conserved there
    kept = json.loads(panels.script(rows))["kept"]["mine"]
    assert kept == [["order 2", "1.99 (generic)"], ["H not claimed", "biased, largest error 0.012 (random tops)"]]


def test_without_rows_there_are_no_panels_and_without_a_table_no_facts(rows, monkeypatch):
    assert panels.script({}) == panels.script({"drift": rows["drift"]}) == ""
    monkeypatch.setattr(panels, "table", promises.table)
    for experiment in rows:
        promises.keep(experiment, rows[experiment], {})
    assert json.loads(panels.script(rows))["kept"] == {}


def test_the_claims_about_a_method_are_claims_of_the_page(rows):
    about = json.loads(panels.script(rows))["about"]
    listed = {name for names in about.values() for name in names}
    assert listed <= {claim.id for claim in CLAIMS}
    assert {"backlund", "taylor", "implicit_midpoint"} <= about.keys() <= METHODS.keys()
