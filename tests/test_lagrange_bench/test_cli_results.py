"""`lagrange-bench run`, `report` and `figure`: what they print, write and refuse to replace."""

import json
import re
import shlex
import shutil
from pathlib import Path

from lagrange_bench.commands import completion
from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.results.store import default_results
from lagrange_bench.runner import engine


def test_run(run, in_process, tmp_path, monkeypatch):
    """It draws if asked, and never a figure without rows."""
    toy = "toys.behaviour"
    monkeypatch.setenv("TOY_CELLS", json.dumps([{"do": "square", "i": 3}, {"do": "raise", "i": 4}]))
    drawn, results = [], tmp_path / "my results"
    figure = results / "page" / "figure.svg"
    write = "lagrange_bench.report.sections.write_experiment"
    monkeypatch.setattr(write, lambda *asked: drawn.append(asked) or [figure])
    words = ("run", toy, "--results", results, "--jobs", "1")
    code, out, err = run(*words, "--quiet")
    assert (code, err, drawn) == (1, "", [])
    assert "cell 4 was told to" in out
    assert f"next: lagrange-bench report --results '{results}'" in out
    monkeypatch.setenv("TOY_CELLS", json.dumps([{"do": "square", "i": 3}]))
    code, out, _ = run(*words, "--json")  # and nothing else on stdout
    assert (code, json.loads(out)["experiments"][toy]["stored"]) == (0, 1)
    assert f"drawn: {figure}" in run(*words, "--draw")[1]
    assert drawn[0][:3] == (toy, results, results / "page")


def test_run_takes_all_experiments_by_default(run, monkeypatch):
    asked = {}

    def instead(names, profile, results, jobs, show, **more):
        asked.update(names=names, profile=profile, results=results.name, jobs=jobs, show=show, **more)
        return engine.Summary(results, profile)

    monkeypatch.setattr(engine, "run", instead)
    usual = {"names": EXPERIMENTS, "profile": "full", "results": "full", "jobs": None, "show": True}
    usual |= {"time_limit": None, "scheduler": None, "timings": True, "again": False}
    assert run("run", "--profile", "full")[0] == 0
    assert asked.items() >= usual.items()
    given = {"time_limit": 9.0, "scheduler": "local:2", "timings": False, "again": True, "jobs": 3}
    assert run("run", "--time-limit", "9", "--scheduler", "local:2", "--no-timings", "--again", "--jobs", "3")[0] == 0
    assert asked.items() >= given.items()


# an experiment of somebody's own, in which other tests define some functions anew
STUDY = """
VERSION = 1
def cells(profile): return [{"i": i} for i in range(6)]
def measure(cell): return [{"square": float(cell["i"] ** 2)}]
def tables(rows): return {}
def draw(rows):
    from lagrange_bench import style
    fig, ax = style.figure("column")
    ax.plot(rows.i, rows.square)
    return {"squares": fig}
"""


def test_an_experiment_of_your_own_is_drawn_where_it_was_run(run, in_process, one_core, folder):
    """Each command prints the next one."""
    (folder / "my_study").mkdir()
    (folder / "my_study" / "energy.py").write_text(STUDY)
    out = run("run", "my_study.energy", "--results", "out", "--jobs", "1")[1]
    after = shlex.split(re.search("^next: lagrange-bench (.*)", out, re.MULTILINE)[1])
    page = Path(run(*after, "--output", "page")[1].strip()).read_text(encoding="utf-8")
    assert "my_study.energy_squares" in page
    assert "cannot be loaded" not in page
    again = re.sub("<[^>]*>", "", re.search(r"redraw: <code[^>]*>(.*?)</code>", page)[1])
    assert again == "lagrange-bench figure my_study.energy_squares --results out --module my_study.energy"
    words, replaced = shlex.split(again)[1:], "replaced: my_study.energy_squares.svg"
    code, out, err = run(*words)
    assert (code, out, replaced in err) == (0, "my_study.energy_squares.svg\n", False)
    assert replaced in run(*words)[2].splitlines()
    assert run(*words, "--quiet")[2] == ""
    (folder / "file").write_text("in the way")
    code, _, err = run(*words, "--output", "file/z.svg")
    assert (code, "file" in err, ".z.svg" in err) == (2, True, False)


def test_figures_are_listed_in_the_order_of_the_page_and_completed(run, swept, tmp_path, monkeypatch):
    """The user's own experiments come first."""
    for name in ("ensemble", "cost"):
        shutil.copy(default_results() / f"{name}.jsonl", tmp_path)
    swept(tmp_path, "sweep_mine", method="strang")
    code, out, err = run("figure", "--list", "--results", tmp_path)
    assert code == 0, err
    assert [name.partition("_")[0] for name in out.split()] == ["sweep", "cost", "ensemble", "ensemble"]
    (tmp_path / "page" / "figures").mkdir(parents=True)
    for name in out.split():
        (tmp_path / "page" / "figures" / f"{name}.svg").touch()
    monkeypatch.setattr("lagrange_bench.results.store.default_results", lambda profile=None: tmp_path)
    assert set(out.split()) <= set(completion.names()["name"])
