"""A claim passes only on rows that bear it out: not on missing ones, not on failed cells, not on NaN."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from experiments import EXPERIMENTS
from experiments.catalogue import load
from integrators import METHODS
from report import claims, origin, page, promises
from report.claims import Claim, NoData, Verdict
from results.store import Store, default_results


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
    assert claims.at_most(9.0, "x", name="H")(rows).passed is False


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


# ---------------------------------------------------------------- claims about all methods at once


def verdicts(**changes):
    """A table of drift verdicts in which every method keeps what it claims, but for `changes` to one of them."""
    rows = [
        {"method": name, "invariant": "C1", "claimed": True, "exponent": 0.5, "verdict": "random walk", REASON: ""}
        for name in METHODS
    ]
    rows[3].update(changes)
    return pd.DataFrame(rows)


REASON = "biased, as the method says"


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({}, True),
        ({"share left": 0.03}, False),
        ({"share left": np.nan}, False),
        ({"in range": False}, False),  # the only run of this method says nothing
        ({"in range": np.nan, "method": "mine"}, True),  # of a plug-in there is no theory
    ],
)
def test_theory_must_hold_for_every_method(monkeypatch, changes, passed):
    monkeypatch.setattr(promises, "table", lambda *_: lambda rows: rows)
    names = [name for name in METHODS if METHODS[name].order and METHODS[name].control == "step"]
    rows = [{"method": name, "state": "generic", "h": 0.1, "share left": 0.01, "in range": True} for name in names]
    table = pd.DataFrame([*rows, {**rows[3], **changes}]).assign(part="theory")
    if changes.get("in range") is False:
        table = table.drop(index=3)
    verdict = promises.taken_by_theory(table)
    assert verdict.passed is passed
    unpredicted = promises.taken_by_theory(pd.concat([table, table.iloc[:1].assign(**{"in range": np.nan})]))
    assert "no prediction for 1 more" in unpredicted.note or verdict.value is None
    assert "no prediction" not in verdict.note or verdict.value is None
    with pytest.raises(NoData, match=f"not held against theory: {min(names[:3])}"):
        promises.taken_by_theory(table[~table.method.isin(names[:3])])


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({}, True),
        ({"exponent": 0.8}, False),
        ({"exponent": 0.8, "claimed": False}, True),
        ({"exponent": 0.8, REASON: "a rounded constant"}, True),
        ({"exponent": np.nan, "verdict": "failed"}, False),
        ({"exponent": np.nan}, False),
        ({"exponent": 0.9, "verdict": "round-off"}, True),
    ],
)
def test_a_growing_error_must_be_called_biased(monkeypatch, changes, passed):
    monkeypatch.setattr(promises, "table", lambda *_: lambda rows: rows)
    verdict = promises.kept_as_claimed(verdicts(**changes))
    assert verdict.passed is passed
    assert ("called biased" in verdict.note) == (REASON in changes)


def test_a_method_nobody_measured_is_no_data(monkeypatch):
    monkeypatch.setattr(promises, "table", lambda *_: lambda rows: rows)
    with pytest.raises(NoData, match="not measured: backlund"):
        promises.kept_as_claimed(verdicts().iloc[1:])


def races(seconds, setup=0.0):
    """Runs of all methods with an error of 1e-13: the Bäcklund map in `seconds`, the others in 1."""
    rows = [
        {"method": name, "status": "done", "span": 10.0, "state": "generic", "error": 1e-13, "seconds": 1.0}
        for name in METHODS
    ]
    runs = pd.DataFrame(rows).assign(setup_seconds=0.0)
    runs.loc[runs.method.str.startswith("backlund"), ["seconds", "setup_seconds"]] = (seconds, setup)
    return runs


def test_who_leads_is_told_with_set_up_and_without():
    def lead(rows, price, longest):
        return promises.lead({10.0: 1e-12}, price, longest)(rows)

    assert lead(races(0.1), "total", True).passed
    assert lead(races(0.1), "total", True).value == pytest.approx(10)
    assert not lead(races(0.1, setup=2.0), "total", True).passed
    assert lead(races(0.1, setup=2.0), "seconds", True).passed
    assert lead(races(0.1, setup=2.0), "total", False).passed
    assert not lead(races(2.0), "total", True).passed
    short = races(0.1)
    short.loc[short.method.str.startswith("backlund"), "error"] = 1e-3  # others reach what it does not
    assert lead(short, "total", True).value == 0.0
    assert not lead(races(0.1).assign(error=1e-11), "total", True).passed  # 1e-12 is reached by nobody
    assert promises.lead({10.0: 1e-10}, "total", True)(races(0.1).assign(error=1e-11)).passed  # nor asked for


# ---------------------------------------------------------------- which runs a claim needs

FULL = {
    "invariants-for-ever", "unpinned", "claims-of-methods", "cheapest-long", "loses-short", "midpoint-is-unbiased",
    "midpoint-keeps-J3", "rk45-drifts", "magnet", "magnet-long-steps", "phase-of-the-pinned-step", "long-run",
    "wins-perturbed", "loses-perturbed",
}  # fmt: skip


def test_the_profile_a_claim_needs_is_read_off_the_cells():
    """The quick profile has no runs for FULL, and the full one has the runs of every claim."""
    assert {claim.id for claim in promises.CLAIMS if claim.profile == "full"} == FULL
    for claim in promises.CLAIMS:
        assert claim.needs(pd.DataFrame(load(claim.experiment).cells("full"))) == ""


def test_no_data_for_want_of_long_runs_names_the_profile_that_has_them():
    quick = origin.find(default_results("quick"), [("quick",)])
    rows = {
        "drift": pd.DataFrame({"status": ["done"], "part": "time", "method": "backlund", "steps": 10**5}),
        "work_precision": pd.DataFrame({"status": ["done"], "method": "backlund", "span": 100.0}),
    }
    judged = {each.claim.id: each for each in page.judge(rows, quick)[0]}
    assert judged["unpinned"].verdict.note == "no run of 10⁷ steps is stored"
    assert judged["cheapest-long"].verdict.note == "no run up to t = 10⁴ is stored"
    for name, experiment in (("unpinned", "drift"), ("cheapest-long", "work_precision")):
        assert judged[name].verdict.passed is None
        assert judged[name].command == (
            f"lagrange-bench run {experiment} --profile full && lagrange-bench report --results results/local/full"
        )
    assert judged["orders"].command.startswith("lagrange-bench run phase --profile quick && "), "that will do"


def test_a_claim_on_strong_fields_needs_runs_in_them_and_no_longer_ones():
    (claim,) = (claim for claim in promises.CLAIMS if claim.id == "loses-perturbed")
    runs = pd.DataFrame({"state": ["strong_tide", "magnet", "weak_tide"], "span": 1e3})
    assert claim.needs(runs) == ""
    assert claim.needs(runs[1:]) == "no run of the top strong_tide is stored"


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_times_are_judged_as_ratios(slower):
    """A machine on which everything takes twice as long has the same verdicts."""
    cost = pd.DataFrame({"setup_us": [10.0, 20.0], "ns_per_step": [16.0, 20.0]}) * slower
    cost = cost.assign(status="done", part="step", method="backlund")
    assert promises.setup_in_steps(cost) == pytest.approx(20e3 / 16)
    many = pd.DataFrame({"pinned_ns": [16.0, np.nan], "ns_per_step_and_core": [np.nan, 4.0]}) * slower
    many = many.assign(status="done", part=["bound", "tops"], threads=1, tops=1024)
    assert promises.ensemble_step(many) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("length", "drift", "word", "passed"),
    [
        (10**7, 0.5, "confirmed", True),
        (10**7, 2.0, "refuted", False),
        (10**5, 0.5, "consistent", True),
        (10**5, 2.0, "not tested", None),
    ],
)
def test_shorter_runs_can_agree_with_a_claim_but_not_decide_it(length, drift, word, passed):
    claim = Claim("c", "", "drift", claims.within(1.0, "drift"), claims.steps(10**7))
    verdict, _ = claims.judge(claim, pd.DataFrame({"status": ["done"], "steps": [length], "drift": [drift]}))
    assert (verdict.word, verdict.passed, verdict.value) == (word, passed, drift)
    assert bool(verdict.short) == (length < 10**7)
    if verdict.short:
        assert verdict.note == "no run of 10⁷ steps is stored, judged by shorter ones"


def test_runs_that_failed_refute_a_claim_about_longer_ones():
    claim = Claim("c", "", "drift", claims.within(1.0, "drift"), claims.steps(10**7))
    rows = pd.DataFrame({"status": ["failed"], "failure": ["E"], "steps": [10], "drift": [None]})
    assert claims.judge(claim, rows)[0].word == "refuted"


# ---------------------------------------------------------------- somebody else's method


def test_an_installed_plug_in_without_rows_changes_no_verdict(monkeypatch):
    rows = {name: Store(default_results()).rows(name) for name in EXPERIMENTS}
    judged = page.judge(rows)[0]
    before = [each.verdict for each in judged]
    of_all = ("claims-of-methods", "cheapest-long", "loses-short")
    assert [each.verdict.passed for each in judged if each.claim.id in of_all] == [True, True, True]
    module = ModuleType("somebody_elses")
    module.METHOD = replace(METHODS["rk4"], name="mine")
    monkeypatch.setitem(sys.modules, "somebody_elses", module)
    monkeypatch.setitem(METHODS._entries, "mine", EntryPoint("mine", "somebody_elses:METHOD", METHODS.group))
    assert "mine" in METHODS
    assert [each.verdict for each in page.judge(rows)[0]] == before
