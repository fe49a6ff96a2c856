"""Claims pass only on rows that bear them out; and what else the page says: methods to take, origins, errata."""

from dataclasses import replace
from datetime import UTC, date, datetime

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import tables
from lagrange_bench.experiments.measuring import errata, reductions
from lagrange_bench.experiments.work_precision import TARGETS
from lagrange_bench.integrators import METHODS, integrate
from lagrange_bench.report import chooser, claims, lists, origin, page, promises, readme
from lagrange_bench.report.claims import Bound, Claim
from lagrange_bench.results.store import default_results

pytestmark = pytest.mark.xdist_group("claims")  # all are judged once
PENDING: dict[str, str] = {}  # claims whose rows come with the next run of the reference, and their verdicts until then


def test_claims_are_few_grouped_and_confirmed_by_the_stored_rows(judged):
    assert len({claim.id for claim in promises.CLAIMS}) == len(promises.CLAIMS) <= 20
    assert [group for group, _ in claims.grouped(judged)] == list(claims.GROUPS)
    others = {each.claim.id: each.verdict.word for each in judged if each.verdict.word != claims.CONFIRMED}
    assert others == PENDING


def test_a_claim_names_its_runs_and_the_full_profile_has_them_all():
    for claim in promises.CLAIMS:
        planned = pd.DataFrame(load(claim.experiment).cells("full"))
        for bound in claim.bounds:
            assert bound.where, claim.id
            assert bound.missing(planned) == "", claim.id


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
        if claim.id in PENDING and (bound.missing(rows) or not set(bound.where) <= set(rows)):
            continue
        covered = with_nan(claims.select(rows, **bound.where), columns)
        verdict = claims.judge(replace(claim, bounds=(bound,)), covered)
        assert verdict.word == "refuted"
        assert "NotANumber" in verdict.note


def test_the_experiments_name_every_number_that_all_rows_of_a_part_have(stored, journals):
    """Else NaN in it would not be seen; and each of them is seen alone."""
    for experiment, rows in stored.items():
        cell = fields(journals[experiment])
        for part, names in load(experiment).MEASURED.items():
            done = rows[(rows.status == "done") & reductions.in_part(rows, part)]
            always = {name for name in done if done[name].dtype.kind == "f" and done[name].notna().all()}
            assert always - cell - {"x1"} <= set(names), (experiment, part)
            for name in set(names) & set(numbers(experiment, done, cell)):
                assert (reductions.missing_value(with_nan(done, [name]), {part: names}) == name).any()
        assert reductions.with_failures(rows, load(experiment).MEASURED) is rows


def judge(rows, bound):
    return claims.judge(
        Claim("c", "cost", "", "drift", date(2026, 11, 24), datetime(2026, 11, 24, tzinfo=UTC), (bound,)), rows
    )


def test_bounds():
    for values, limit, passed in (([0.0, np.nan], -1.0, ""), ([0.0, np.inf], -1.0, "≥>"), ([1.0], 1.0, "≤≥")):
        rows = pd.DataFrame({"part": "a", "drift": values})
        for sign in claims.SIGNS:
            (finding,) = judge(rows, Bound(lambda rows: rows.drift, sign, limit)).findings
            assert finding.passed is (sign in passed), (values, sign)


def test_only_times_may_be_missing_of_a_run_that_is_far_off():
    rows = pd.DataFrame({"status": "done", "error": [0.2, 0.2], "seconds": [np.nan, 1.0], "C1": [1.0, np.nan]})
    assert reductions.missing_value(rows, {"": ("seconds", "C1")}).tolist() == ["", "C1"]


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
    quick = origin.find(default_results("quick"))
    rows = {"drift": pd.DataFrame({"status": ["done"], "part": "h", "method": "backlund", "steps": 10**5})}
    found = {each.claim.id: each for each in page.judge(rows, quick)}
    assert found["unpinned"].verdict.word == "not tested"
    assert (
        found["unpinned"].command == "lagrange-bench run drift --profile full && lagrange-bench report --results full"
    )


CHANGES = [  # of the lines of one method in a table of stored rows, and what becomes of the claim about all
    ("theory", {}, "confirmed"),
    ("theory", {"share left": 0.03}, "refuted"),
    ("theory", {"share left": np.nan}, "refuted"),
    ("theory", {"in range": False}, "refuted"),  # the runs of this method say nothing
    ("claims-of-methods", {}, "confirmed"),
    ("claims-of-methods", {"exponent": 0.8}, "refuted"),
    ("claims-of-methods", {"exponent": 0.8, "claimed": False}, "confirmed"),
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
    if name == "theory":  # of a plug-in there is none
        changed = pd.concat([changed, table[mine].assign(method="mine", **{"in range": np.nan, "share left": 1.0})])
    monkeypatch.setattr(promises, "table", lambda *_: changed)
    assert claims.judge(claim, rows).word == word
    monkeypatch.setattr(promises, "table", lambda *_: table[table.method != "strang"])
    verdict = claims.judge(claim, rows[rows.method != "strang"])
    assert (verdict.word, "strang" in verdict.note) == ("not tested", True)


def test_who_leads_is_told_with_set_up_and_of_steps_that_give_a_state_every_unit():
    """Every method takes 5 s at one unit, one with a tolerance 3 s; the Bäcklund map 1 s at one unit, 0.1 s at 16."""
    rows = pd.DataFrame({"method": [*METHODS, "backlund"], "status": "done", "span": 10.0, "state": "generic"})
    rows = rows.assign(error=1e-13, seconds=5.0, setup_seconds=0.0, h=1.0)
    ours = rows.method == "backlund"
    rows.loc[ours, ["seconds", "h"]] = [(1.0, 1.0), (0.1, 16.0)]
    rows.loc[rows.method == "taylor", ["seconds", "h"]] = (3.0, np.nan)
    errors = [(10.0, 1e-4, 1e-12)]
    late = rows.assign(setup_seconds=np.where(ours, 0.5, 0.0))
    far = rows.assign(error=np.where(rows.method.str.startswith("backlund"), 1e-3, 1e-13))
    for runs, options, ratio in (
        (rows, {}, 30.0),
        (rows, {"every": 1.0}, 3.0),
        (rows, {"closed": True}, 50.0),
        (late, {}, 5.0),
        (far, {}, 0.0),
    ):
        found = promises.lead(runs, errors, **options).values
        assert np.allclose(found, ratio)
        assert len(found) == 5
    with pytest.raises(claims.NoData, match="backlund over"):
        promises.lead(rows[~(ours & (rows.h == 1.0))], errors, every=1.0)


def test_times_are_judged_as_ratios():
    cost = pd.DataFrame({"setup_us": [10.0, 20.0], "ns_per_step": [16.0, 20.0]})
    cost = cost.assign(status="done", part="step", method="backlund")
    assert max(promises.setup_in_steps(cost)) == pytest.approx(20e3 / 16)
    runs = pd.DataFrame({"ns_per_time": [1.0, 2.0, 300.0, 90.0]})
    runs = runs.assign(error=[1e-9, 1e-12, 1e-10, 1e-6], method=["backlund"] * 2 + ["taylor"] * 2)
    runs = runs.assign(part="rival", status="done")
    assert promises.batch_ratios(runs, ["taylor"]) == pytest.approx([150.0, 90.0])


RUNS = [  # method, h, error, seconds, set-up
    ("rk4", 0.5, 3e-5, 1e-3, 0.0),
    ("rk4", 0.1, 3e-9, 5e-3, 0.0),
    ("backlund", 8.0, 1e-15, 2e-3, 2e-3),
    ("strang", 0.1, 2e-5, 2e-3, 0.0),
    ("strang", 0.3, float("nan"), 1e-6, 0.0),
]


def test_the_cheapest_with_set_up_that_reaches_the_error_and_claims_to_conserve_what_must_be():
    columns = ["method", "h", "error", "seconds", "setup_seconds"]
    rows = pd.DataFrame(RUNS, columns=columns).assign(state="generic", span=100.0, status="done")
    answers = chooser.answers({"work_precision": rows}).set_index(["error at most", "must conserve"])
    best = answers.name.xs(chooser.NOTHING, level=1).to_dict()
    assert best == {"10⁻⁴": "rk4", **dict.fromkeys(("10⁻⁶", "10⁻⁸", "10⁻¹⁰", "10⁻¹²"), "backlund")}
    first = answers.loc[("10⁻⁶", chooser.NOTHING)]
    assert first[["python", "cost"]].to_list() == [
        'integrate("generic", h=3.62319, steps=12, method="backlund")  # to t = 43.48, which is 100 units',
        "4 ms",
    ]
    assert first["beside it"] == "best that is not exact: RK4, 1.2 times as long"
    assert answers.name["10⁻⁴", chooser.LENGTHS] == "strang"
    assert answers.name["10⁻⁴", chooser.ENERGY] == "backlund"


@pytest.mark.slow
def test_the_line_of_python_gives_the_promised_error(stored):
    answers = chooser.answers({"work_precision": stored["work_precision"]})
    answers = answers[answers["length of the run"] != "10⁶"].drop_duplicates("python", keep="last")
    targets = {tables.show(target): target for target in TARGETS}
    assert set(answers["length of the run"]) == {"10", "100", "10⁴"}, "how many lines differ depends on times"
    for line, target in zip(answers.python, answers["error at most"].map(targets), strict=True):
        assert eval(line, {"integrate": integrate}).error()[-1] <= target, line


def test_a_recommended_method_is_named_if_it_takes_at_most_a_fifth_more_and_rk4_beside_the_best_rival():
    runs = {"theta_functions": 1.0, "addition_theorem": 1.5, "strang": 4.0, "rk4": 9.0}
    for price, named in ((1.19, "backlund"), (1.21, "theta_functions")):
        rows = pd.DataFrame({**runs, "backlund": price}.items(), columns=["method", "seconds"])
        rows = rows.assign(setup_seconds=0.0, h=1.0, error=1e-13, state="generic", span=1e4, status="done")
        answer = chooser.answers({"work_precision": rows}).iloc[0]
        assert answer["name"] == named
    assert answer["beside it"] == "best that is not exact: Strang, 4 times as long; RK4, 9 times as long"


def test_a_body_is_priced_by_all_its_steps_and_nan_never_wins():
    position = [1e-5, float("nan"), 1e-9]
    rows = pd.DataFrame({"method": ["rk4", "rk4", "rkmk4"], "h": [0.1, 0.2, 0.05], "position": position})
    rows = rows.assign(rotation=1e-9, ns_per_step=1e3, case="kovalevskaya", status="done")
    found = chooser.answers({"heavy_top": rows})
    found = found[found["must conserve"] == chooser.NOTHING].set_index("error at most")
    line = 'integrate("kovalevskaya", h=0.1, steps=100, method="rk4")'
    assert (found.python["10⁻⁴"], found.cost["10⁻⁴"]) == (line, "0.1 ms")
    assert found["beside it"]["10⁻⁴"].endswith("2 times as long")
    assert found.name["10⁻⁸"] == "rkmk4"


def test_commands_name_a_folder_or_the_profile_that_its_name_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder, run in ((tmp_path / "out", "--results out"), (default_results("quick"), "--profile quick")):
        assert origin.find(folder).run("drift") == f"lagrange-bench run drift {run}"
    assert origin.find(default_results()).report == "lagrange-bench report --results full"


def test_the_equations_that_are_misprinted_are_counted_and_listed(run):
    found = errata.measure(points=1)
    code, out, err = run("errata", "--points", 1)
    assert (code, err) == (0, "")
    texts = [text for e in found for text in (e.equation, e.printed_text, e.corrected_text)]
    assert all(text in out for text in (*texts, errata.count(found)))
    assert errata.count(found) in (readme.ROOT / "docs" / "equations.md").read_text("utf-8")


def test_the_table_of_programs_needs_an_engine(stored):
    rows = stored["engines"]
    assert "MuJoCo 4.0.0" in set(lists.programs(rows).iloc[:, 0])
    assert lists.programs(rows[rows.engine == "lagrange-bench"]).empty, "as in the quick profile"
