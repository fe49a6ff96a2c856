"""A claim passes only on rows that bear it out: not on missing ones, not on failed cells, not on NaN."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import reductions
from lagrange_bench.integrators import METHODS
from lagrange_bench.report import claims, origin, page, promises
from lagrange_bench.report.claims import Bound, Claim, NoData, Refuted
from lagrange_bench.results.store import default_results

pytestmark = pytest.mark.xdist_group("claims")  # all are judged once
BIASED = "biased, as the method says"


# ---------------------------------------------------------------- the list of claims


def test_claims_are_few_grouped_and_confirmed_by_the_stored_rows(judged):
    assert len({claim.id for claim in promises.CLAIMS}) == len(promises.CLAIMS) <= 21
    assert [group for group, _ in claims.grouped(judged)] == list(claims.GROUPS)
    assert {each.claim.id: each.verdict.word for each in judged if each.verdict.word != claims.CONFIRMED} == {}


def test_an_entry_with_a_misspelt_word_is_an_error():
    bound = {"columns": ["x"], "where": {"part": "a"}, "required": "≤ 1 of scale", "steps": 10}
    entry = {"id": "c", "group": "cost", "experiment": "drift", "text": "", "bound": [bound]}
    assert promises._claim(dict(entry)).bounds[0] == Bound(("x",), "≤", 1.0, "of scale", {"part": "a"}, 10)
    for wrong in ({"bound": [{**bound, "step": 1}]}, {"bound": [{**bound, "read": "nothing"}]}, {"kind": "cost"}):
        with pytest.raises((TypeError, KeyError)):
            promises._claim({**entry, **wrong})


def test_a_claim_names_its_runs_and_the_full_profile_has_them_all():
    """The quick profile has those of few claims."""
    for claim in promises.CLAIMS:
        planned = pd.DataFrame(load(claim.experiment).cells("full"))
        for bound in claim.bounds:
            assert bound.where, claim.id
            assert bound.missing(planned) == "", claim.id
    quick = {claim.id for claim in promises.CLAIMS if claim.profile == "quick"}
    assert quick == {"set-up", "many-tops", "magnet-orders", "orders", "form-of-the-map"}


# ---------------------------------------------------------------- NaN, failed, declined, missing


def fields(journal):
    """Of its cells: what was asked for, not measured."""
    return {name for record in journal.latest for name in record["cell"]}


def numbers(experiment, rows, cell):
    """The measured columns of numbers."""
    found = [name for name in rows.columns if rows[name].dtype.kind == "f" and name not in reductions.EXCUSES]
    return [name for name in found if name not in cell or any(name in m for m in load(experiment).MEASURED.values())]


def with_nan(rows, columns):
    """The rows, with NaN for the later half of every run."""
    late = rows.groupby("key").cumcount() >= rows.groupby("key").key.transform("size") // 2
    return rows.assign(**{name: rows[name].astype(float).mask(late) for name in columns})


@pytest.mark.parametrize("claim", promises.CLAIMS, ids=lambda claim: claim.id)
def test_nan_in_the_later_half_of_its_runs_refutes_a_claim(claim, stored, journals):
    rows = stored[claim.experiment]
    columns = numbers(claim.experiment, rows, fields(journals[claim.experiment]))
    for bound in claim.bounds:
        covered = claims.select(rows, **bound.where)
        parts = set(covered.get("part", [""]))
        always = {name for part in parts for name in load(claim.experiment).MEASURED[part]}
        for chosen in (columns, *([name] for name in columns if name in always)):
            verdict, error = claims.judge(replace(claim, bounds=(bound,)), with_nan(covered, chosen))
            assert (verdict.word, error) == ("refuted", None), chosen
            assert "NotANumber" in verdict.note


def test_the_experiments_name_every_number_that_all_rows_of_a_part_have(stored, journals):
    """Else NaN in it would not be seen."""
    for experiment, rows in stored.items():
        cell = fields(journals[experiment])
        for part, names in load(experiment).MEASURED.items():
            done = rows[(rows.status == "done") & ((rows.part == part) if part else True)]
            always = {name for name in done if done[name].dtype.kind == "f" and done[name].notna().all()}
            assert always - cell - {"x1"} <= set(names), (experiment, part)
        assert reductions.settled(rows, load(experiment).MEASURED) is rows


@pytest.mark.parametrize(
    ("experiment", "table", "column", "measured"),
    [
        ("perturbed", "kept", "H", "H"),
        ("drift", "verdicts", "largest relative error", "C1"),
        ("drift", "long_steps", "H", "H"),
        ("gaudin", "drift", "spins", "spins"),
        ("paper", "invariants", "C2", "C2"),
        ("phase", "theory", "share left", "left"),
        ("phase", "orders", "measured", "error"),
        ("perturbed", "orders", "measured", "error"),
        ("round_off", "forms", "largest error of H", "H"),
        ("round_off", "forms", "phase error / t", "time"),
    ],
)
def test_no_table_skips_nan(experiment, table, column, measured, stored):
    """Nor would one that is made without `settled`."""
    rows = stored[experiment]
    some = rows[
        rows.get("form", rows.get("method")).isin(("backlund", "backlund_unpinned", "rk4", "increments", "real form"))
    ]
    made = load(experiment).tables(with_nan(some, [measured]))[table]
    assert made[column].isna().any()


def test_the_worst_and_the_mean_of_numbers_with_nan_are_nan():
    rows = pd.DataFrame({"H": [np.nan, -2.0], "C1": [1.0, 1.0]})
    assert np.array_equal(reductions.worst(rows, ["H", "C1"]), [np.nan, 2.0], equal_nan=True)
    assert np.isnan(reductions.mean_square(rows.H, [0, 0])).all()


def judge(rows, *bounds):
    return claims.judge(Claim("c", "cost", "", "drift", bounds), rows)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_never_passes(value):
    rows = pd.DataFrame({"part": "a", "drift": [0.0, value]})
    for sign, passed in (("≤", False), ("<", False), ("≥", value == np.inf), (">", False)):
        verdict, _ = judge(rows, Bound(lambda rows: rows.drift, sign, 0.0 if sign == ">" else -1.0))
        assert verdict.findings[0].passed is passed


@pytest.mark.parametrize("failure", ["StepError: too large", "ValueError: an accident"])
def test_a_run_that_fails_or_is_declined_refutes_every_claim_about_it_and_no_other(failure):
    rows = pd.DataFrame(
        {"method": ["a", "a", "b"], "status": ["done", "failed", "done"], "failure": [None, failure, None],
         "name": ["H", None, "H"], "x": [1, None, 1], "steps": 10}
    )  # fmt: skip
    for method, steps, word in (("a", 0, "refuted"), ("a", 10**7, "refuted"), ("b", 0, "confirmed")):
        bound = Bound(("x",), "≤", 9.0, where={"name": "H", "method": method}, steps=steps)
        assert judge(rows, bound)[0].word == word


def test_a_broken_check_is_no_data_and_is_reported():
    rows = pd.DataFrame({"status": ["done"]})
    for measure, told in ((lambda rows: 1 / 0, "ZeroDivisionError"), (lambda rows: rows["gone"], "gone")):
        verdict, error = judge(rows, Bound(measure, "≤", 1.0))
        assert verdict.word == "not tested"
        assert told in verdict.note
        assert bool(error) == (told == "ZeroDivisionError")


def test_missing_rows_test_nothing():
    for claim in promises.CLAIMS:
        assert claims.judge(claim, pd.DataFrame())[0].word == "not tested"
        for bound in claim.bounds:
            with pytest.raises(NoData):
                claims.select(pd.DataFrame({"status": ["done"]}), **bound.where)


@pytest.mark.parametrize(
    ("length", "drift", "word"),
    [(10**7, 0.5, "confirmed"), (10**7, 2.0, "refuted"), (10**5, 0.5, "consistent"), (10**5, 2.0, "not tested"),
     (10**5, np.nan, "refuted")],
)  # fmt: skip
def test_other_runs_can_agree_with_a_claim_but_not_decide_it(length, drift, word):
    bounds = (
        Bound(("drift",), "≤", 1.0, where={"top": "a"}, steps=10**7),
        Bound(("drift",), "≤", 1.0, where={"top": ("a",)}, steps=10**7),
    )
    rows = pd.DataFrame({"status": ["done"], "top": "a", "steps": [length], "drift": [drift]})
    verdict, _ = judge(rows, *bounds)
    assert verdict.word == word
    if word == "consistent":
        assert verdict.note == "no run of 10⁷ steps is stored, judged by others"
        wider = replace(bounds[0], where={"top": ("a", "b")}, steps=0)
        assert judge(rows, wider)[0].note.startswith("no run with top = b")


def test_no_data_for_want_of_long_runs_names_the_profile_that_has_them():
    quick = origin.find(default_results("quick"), [("quick",)])
    rows = {"drift": pd.DataFrame({"status": ["done"], "part": "h", "method": "backlund", "steps": 10**5})}
    found = {each.claim.id: each for each in page.judge(rows, quick)[0]}
    for name, profile, experiment in (("unpinned", "full", "drift"), ("orders", "quick", "phase")):
        assert found[name].verdict.word == "not tested"
        assert found[name].command == (
            f"lagrange-bench run {experiment} --profile {profile} && lagrange-bench report --results results/local/{profile}"
        )


# ---------------------------------------------------------------- claims about all methods at once


@pytest.fixture
def as_table(monkeypatch):
    monkeypatch.setattr(promises, "table", lambda rows, *_: rows)


def holds(measure, rows, sign, limit):
    """Whether all numbers satisfy the bound, and the note; refuted is False."""
    try:
        found = measure(rows)
    except Refuted as reason:
        return False, str(reason)
    return bool(np.all(claims.SIGNS[sign](np.asarray(found.values, dtype=float), limit))), found.note


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
def test_theory_must_hold_for_every_method(as_table, changes, passed):
    names = [name for name in METHODS if METHODS[name].order and METHODS[name].control == "step"]
    rows = [{"method": name, "state": "generic", "h": 0.1, "share left": 0.01, "in range": True} for name in names]
    table = pd.DataFrame([*rows, {**rows[3], **changes}]).assign(part="theory")
    if changes.get("in range") is False:
        table = table.drop(index=3)
    assert holds(promises.taken_by_theory, table, "≥", 0.98)[0] is passed
    with pytest.raises(NoData, match=f"not held against theory: {min(names[:3])}"):
        promises.taken_by_theory(table[~table.method.isin(names[:3])])


@pytest.mark.parametrize(
    ("changes", "passed"),
    [
        ({}, True),
        ({"exponent": 0.8}, False),
        ({"exponent": 0.8, "claimed": False}, True),
        ({"exponent": 0.8, BIASED: "a rounded constant"}, True),
        ({"exponent": np.nan, "verdict": "failed"}, False),
        ({"exponent": np.nan}, False),
        ({"exponent": 0.9, "verdict": "round-off"}, True),
    ],
)
def test_a_growing_error_must_be_called_biased(as_table, changes, passed):
    like = {"invariant": "C1", "claimed": True, "exponent": 0.5, "verdict": "random walk", BIASED: ""}
    rows = [{"method": name, **like} for name in METHODS]
    rows[3].update(changes)
    held, note = holds(promises.kept_as_claimed, pd.DataFrame(rows), "<", 0.75)
    assert held is passed
    assert ("called biased" in note) == (BIASED in changes)
    with pytest.raises(NoData, match="not measured: backlund"):
        promises.kept_as_claimed(pd.DataFrame(rows[1:]))


@pytest.mark.parametrize(
    ("seconds", "setup", "error", "ratio"),
    [(0.1, 0.0, 1e-13, 10.0), (0.1, 1.9, 1e-13, 0.5), (2.0, 0.0, 1e-13, 0.5), (0.1, 0.0, 1e-3, 0.0)],
)
def test_who_leads_is_told_with_set_up(seconds, setup, error, ratio):
    """A Bäcklund map takes `seconds` and `setup` to its error, every other method 1 to 1e-13."""
    rows = pd.DataFrame({"method": list(METHODS), "status": "done", "span": 10.0, "state": "generic"})
    rows = rows.assign(error=1e-13, seconds=1.0, setup_seconds=0.0)
    rows.loc[rows.method.str.startswith("backlund"), ["seconds", "setup_seconds", "error"]] = (seconds, setup, error)
    found = promises.lead(rows, [(10.0, 1e-4, 1e-12)])
    assert np.allclose(found.values, ratio)
    assert len(found.values) == 5


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_times_are_judged_as_ratios(slower):
    """A machine on which everything takes twice as long has the same verdicts."""
    cost = pd.DataFrame({"setup_us": [10.0, 20.0], "ns_per_step": [16.0, 20.0]}) * slower
    cost = cost.assign(status="done", part="step", method="backlund")
    assert max(promises.setup_in_steps(cost)) == pytest.approx(20e3 / 16)
    runs = pd.DataFrame({"ns_per_time": [1.0, 2.0, 300.0, 90.0]}) * slower
    runs = runs.assign(
        error=[1e-9, 1e-12, 1e-10, 1e-6], part="rival", status="done", method=["backlund"] * 2 + ["taylor"] * 2
    )
    assert promises.batch_ratios(runs) == pytest.approx([150.0, 90.0])


# ---------------------------------------------------------------- somebody else's method


def test_an_installed_plug_in_without_rows_changes_no_verdict(monkeypatch, stored, judged):
    module = ModuleType("somebody_elses")
    module.METHOD = replace(METHODS["rk4"], name="mine")
    monkeypatch.setitem(sys.modules, "somebody_elses", module)
    monkeypatch.setitem(METHODS._entries, "mine", EntryPoint("mine", "somebody_elses:METHOD", METHODS.group))
    assert "mine" in METHODS
    again = page.judge(stored)[0]
    assert [each.verdict for each in again] == [each.verdict for each in judged]
