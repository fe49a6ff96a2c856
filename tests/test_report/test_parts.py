"""Parts of the page: which method to take, panels of methods, where rows come from, and the errata."""

import json
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.measuring import errata
from lagrange_bench.report import chooser, origin, page, panels, promises, readme
from lagrange_bench.report.origin import Origin
from lagrange_bench.results import store

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


def test_the_profile_is_known_by_the_cells_and_a_sweep_by_its_file():
    module = ModuleType("study")
    module.cells = lambda profile: [{"h": h} for h in ((0.1, 1.0) if profile == "quick" else (0.01, 0.1))]
    for h, known in ((0.1, ("quick", "full")), (1.0, ("quick",)), (0.01, ("full",)), (7.0, ())):
        assert origin.profiles_of(module, [{"cell": store.clean({"h": h})}]) == known
    assert Origin("my out").run("sweep_mine") == "lagrange-bench run mine.toml --results 'my out'"
    del module.cells
    assert origin.profiles_of(module, []) is None


def test_the_profile_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    both, full, quick = ("quick", "full"), ("full",), ("quick",)
    for folder, profiles, profile in (
        ("out", [both, full, None], "full"),
        ("out", [both], "quick"),  # the same cells
        ("full", [both], "full"),
        ("full", [quick], "quick"),
        ("quick", [None], "quick"),
        ("out", [quick, full], None),
    ):
        assert origin.find(tmp_path / folder, profiles) == Origin(folder, profile)


@pytest.fixture(scope="module")
def found():
    return errata.measure()


def test_the_readme_counts_them(found):
    assert all(e.printed > 1e-6 and e.corrected <= 1e-12 for e in found)
    assert f"corrected: {errata.count(found)}." in " ".join((readme.ROOT / "README.md").read_text("utf-8").split())


def test_the_command_lists_them(run, found, monkeypatch):
    measure = errata.measure
    monkeypatch.setattr(errata, "measure", lambda points, seed: found if points == 8 else measure(points, seed))
    code, out, err = run("errata")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].startswith(f"wrong: {errata.count(found)}; at {errata.POINTS} random points each:")
    assert all(text in out for e in found for text in (e.equation, e.printed_text, e.corrected_text))
    first, other = (run("errata", "--points", "1", "--seed", seed, "--json")[1] for seed in (5, 6))
    assert first != other
    assert len(json.loads(first)) == len(found)


def test_the_page_lists_them_beside_the_rows_of_their_experiment(tmp_path, found, monkeypatch):
    stored = (readme.ROOT / "results" / "reference" / "paper.jsonl").read_text(encoding="utf-8")
    (tmp_path / "paper.jsonl").write_text(stored.splitlines(keepends=True)[0], encoding="utf-8")
    monkeypatch.setattr("lagrange_bench.report.sections.draw_figures", lambda *_: [])
    monkeypatch.setattr(errata, "measure", lambda: found)
    text = page.html(page.assemble(tmp_path))
    section = text.split('<section id="errata">')[1].split("</section>")[0]
    assert section.count("<tr>") == len(found) + 1
    assert all(e.equation in section for e in found)
    assert section.count(">sentence</td>") == 8
    monkeypatch.setattr(errata, "measure", lambda: 1 / 0)
    without = page.assemble(tmp_path)
    assert without.errors == ["errata: cannot be made: ZeroDivisionError: division by zero"], "only this part is lost"
