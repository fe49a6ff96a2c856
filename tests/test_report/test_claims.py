"""A claim passes only on rows that bear it out: not on missing ones, not on failed cells, not on NaN."""

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
from lagrange_bench.report.claims import Bound, Claim, NoData
from lagrange_bench.results.store import default_results

pytestmark = pytest.mark.xdist_group("claims")  # all are judged once
BIASED = "biased, as the method says"


def test_claims_are_few_grouped_and_confirmed_by_the_stored_rows(judged):
    assert len({claim.id for claim in promises.CLAIMS}) == len(promises.CLAIMS) <= 21
    assert {method for claim in promises.CLAIMS for method in claim.about} <= METHODS.keys()
    assert [group for group, _ in claims.grouped(judged)] == list(claims.GROUPS)
    assert {each.claim.id: each.verdict.word for each in judged if each.verdict.word != claims.CONFIRMED} == {}


def test_a_claim_names_its_runs_and_the_full_profile_has_them_all():
    for claim in promises.CLAIMS:
        planned = pd.DataFrame(load(claim.experiment).cells("full"))
        for bound in claim.bounds:
            assert bound.where, claim.id
            assert bound.missing(planned) == "", claim.id
    quick = {claim.id for claim in promises.CLAIMS if claim.profile == "quick"}
    assert quick == {"set-up", "magnet-orders", "orders", "form-of-the-map"}


def fields(journal):
    """Of its cells: what was asked for, not measured."""
    return {name for record in journal.latest for name in record["cell"]}


def numbers(experiment, rows, cell):
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
        covered = with_nan(claims.select(rows, **bound.where), columns)
        verdict = claims.judge(replace(claim, bounds=(bound,)), covered)
        assert verdict.word == "refuted"
        assert "NotANumber" in verdict.note


def test_the_experiments_name_every_number_that_all_rows_of_a_part_have(stored, journals):
    """Else NaN in it would not be seen; and each of them is seen alone."""
    for experiment, rows in stored.items():
        cell = fields(journals[experiment])
        for part, names in load(experiment).MEASURED.items():
            done = rows[(rows.status == "done") & ((rows.part == part) if part else True)]
            always = {name for name in done if done[name].dtype.kind == "f" and done[name].notna().all()}
            assert always - cell - {"x1"} <= set(names), (experiment, part)
            for name in set(names) & set(numbers(experiment, done, cell)):
                assert (reductions.lacking(with_nan(done, [name]), {part: names}) == name).any()
        assert reductions.settled(rows, load(experiment).MEASURED) is rows


def judge(rows, bound):
    return claims.judge(Claim("c", "cost", "", "drift", (bound,)), rows)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_never_passes(value):
    rows = pd.DataFrame({"part": "a", "drift": [0.0, value]})
    for sign, passed in (("≤", False), ("<", False), ("≥", value == np.inf), (">", False)):
        verdict = judge(rows, Bound(lambda rows: rows.drift, sign, 0.0 if sign == ">" else -1.0))
        assert verdict.findings[0].passed is passed


def test_a_run_that_fails_or_is_declined_refutes_every_claim_about_it_and_no_other():
    rows = pd.DataFrame({"method": ["a", "a", "b"], "status": ["done", "failed", "done"], "steps": 10})
    rows = rows.assign(failure=[None, "StepError: too large", None], name=["H", None, "H"], x=[1, None, 1])
    for method, steps, word in (("a", 0, "refuted"), ("a", 10**7, "refuted"), ("b", 0, "confirmed")):
        bound = Bound(("x",), "≤", 9.0, where={"name": "H", "method": method}, steps=steps)
        assert judge(rows, bound).word == word


def test_a_broken_check_is_no_data_and_is_reported():
    rows = pd.DataFrame({"status": ["done"]})
    for measure, told in ((lambda rows: 1 / 0, "ZeroDivisionError"), (lambda rows: rows["gone"], "gone")):
        verdict = judge(rows, Bound(measure, "≤", 1.0))
        assert verdict.word == "not tested"
        assert told in verdict.note
        assert verdict.findings[0].broken == (told == "ZeroDivisionError")


def test_missing_rows_test_nothing():
    for claim in promises.CLAIMS:
        assert claims.judge(claim, pd.DataFrame()).word == "not tested"
        for bound in claim.bounds:
            with pytest.raises(NoData):
                claims.select(pd.DataFrame({"status": ["done"]}), **bound.where)


def test_other_runs_can_agree_with_a_claim_but_not_decide_it():
    bound = Bound(("drift",), "≤", 1.0, where={"top": "a"}, steps=10**7)
    long, short = 10**7, 10**5
    words = {(long, 0.5): "confirmed", (long, 2.0): "refuted", (short, 0.5): "consistent", (short, 2.0): "not tested"}
    for (length, drift), word in {**words, (short, np.nan): "refuted"}.items():
        rows = pd.DataFrame({"status": ["done"], "top": "a", "steps": [length], "drift": [drift]})
        assert judge(rows, bound).word == word
        other = replace(bound, where={"top": ("a", "b")}, steps=0)
        assert judge(rows, other).word in ("consistent", "not tested", "refuted"), "of b there is no run"


def test_no_data_for_want_of_long_runs_names_the_profile_that_has_them():
    quick = origin.find(default_results("quick"), [("quick",)])
    rows = {"drift": pd.DataFrame({"status": ["done"], "part": "h", "method": "backlund", "steps": 10**5})}
    found = {each.claim.id: each for each in page.judge(rows, quick)}
    for name, profile, experiment in (("unpinned", "full", "drift"), ("orders", "quick", "phase")):
        assert found[name].verdict.word == "not tested"
        assert found[name].command == (
            f"lagrange-bench run {experiment} --profile {profile} && lagrange-bench report --results results/local/{profile}"
        )


CHANGES = [  # of the lines of one method in a table of stored rows, and what becomes of the claim about all
    ("theory", {}, "confirmed"),
    ("theory", {"share left": 0.03}, "refuted"),
    ("theory", {"share left": np.nan}, "refuted"),
    ("theory", {"in range": False}, "refuted"),  # the runs of this method say nothing
    ("claims-of-methods", {}, "confirmed"),
    ("claims-of-methods", {"exponent": 0.8}, "refuted"),
    ("claims-of-methods", {"exponent": 0.8, "claimed": False}, "confirmed"),
    ("claims-of-methods", {"exponent": 0.8, BIASED: "a rounded constant"}, "confirmed"),
    ("claims-of-methods", {"exponent": np.nan, "verdict": "failed"}, "refuted"),
    ("claims-of-methods", {"exponent": np.nan, "verdict": "undecided"}, "refuted"),
    ("claims-of-methods", {"exponent": 0.9, "verdict": "round-off"}, "confirmed"),
]


@pytest.mark.parametrize(("name", "changes", "word"), CHANGES)
def test_one_method_that_breaks_a_promise_refutes_it(name, changes, word, stored, monkeypatch):
    (claim,) = (claim for claim in promises.CLAIMS if claim.id == name)
    claim, rows = replace(claim, bounds=claim.bounds[:1]), stored[claim.experiment]
    table = promises.table(rows, claim.experiment, "theory" if name == "theory" else "verdicts")
    mine = (table.method == "strang") & (table.invariant.eq("C1") if "invariant" in table else True)
    changed = table.assign(**{column: table[column].mask(mine, value) for column, value in changes.items()})
    monkeypatch.setattr(promises, "table", lambda *_: changed)
    assert claims.judge(claim, rows).word == word
    monkeypatch.setattr(promises, "table", lambda *_: table[table.method != "strang"])
    verdict = claims.judge(claim, rows[rows.method != "strang"])
    assert (verdict.word, "strang" in verdict.note) == ("not tested", True)


@pytest.mark.parametrize(("setup", "error", "ratio"), [(0.0, 1e-13, 10.0), (1.9, 1e-13, 0.5), (0.0, 1e-3, 0.0)])
def test_who_leads_is_told_with_set_up(setup, error, ratio):
    """A Bäcklund map takes 0.1 s and `setup` to its error, every other method 1 s to 1e-13, closed forms 4 s."""
    rows = pd.DataFrame({"method": list(METHODS), "status": "done", "span": 10.0, "state": "generic"})
    rows = rows.assign(error=1e-13, seconds=1.0, setup_seconds=0.0)
    rows.loc[rows.method.str.startswith("backlund"), ["seconds", "setup_seconds", "error"]] = (0.1, setup, error)
    rows.loc[rows.method.isin(["theta_functions", "addition_theorem"]), "seconds"] = 4.0
    for closed, times in ((False, 1), (True, 4)):
        found = promises.lead(rows, [(10.0, 1e-4, 1e-12)], closed=closed)
        assert np.allclose(found.values, times * ratio)
        assert len(found.values) == 5


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_times_are_judged_as_ratios(slower):
    cost = pd.DataFrame({"setup_us": [10.0, 20.0], "ns_per_step": [16.0, 20.0]}) * slower
    cost = cost.assign(status="done", part="step", method="backlund")
    assert max(promises.setup_in_steps(cost)) == pytest.approx(20e3 / 16)
    runs = pd.DataFrame({"ns_per_time": [1.0, 2.0, 300.0, 90.0]}) * slower
    runs = runs.assign(error=[1e-9, 1e-12, 1e-10, 1e-6], method=["backlund"] * 2 + ["taylor"] * 2)
    runs = runs.assign(part="rival", status="done")
    assert promises.batch_ratios(runs, ["taylor"]) == pytest.approx([150.0, 90.0])
    magnets = pd.DataFrame({"seconds": [1.0, 9.0, 2.0, 0.1]}) * slower
    magnets = magnets.assign(setup_seconds=[7 * slower, 0.0, 0.0, 0.0], error=[1e-15, 1e-12, 1e-5, np.nan], span=64.0)
    magnets = magnets.assign(variant=["exact", "a", "b", "b"], method="rk4", part="work", status="done")
    assert promises.magnet_runs(magnets) == pytest.approx([2 / 8, 9 / 8, 9 / 8])


def test_an_installed_plug_in_without_rows_changes_no_verdict(monkeypatch, stored, judged):
    module = ModuleType("somebody_elses")
    module.METHOD = replace(METHODS["rk4"], name="mine")
    monkeypatch.setitem(sys.modules, "somebody_elses", module)
    monkeypatch.setitem(METHODS._entries, "mine", EntryPoint("mine", "somebody_elses:METHOD", METHODS.group))
    assert "mine" in METHODS
    of_all = [claim for claim in promises.CLAIMS if any(callable(bound.measure) for bound in claim.bounds)]
    monkeypatch.setattr(promises, "CLAIMS", of_all)
    verdicts = {each.claim.id: each.verdict for each in judged}
    assert [each.verdict for each in page.judge(stored)] == [verdicts[claim.id] for claim in of_all]
