"""Results of somebody else run no code, and stop no page; those of other code than this are never shown in silence."""

import json
import re
import sys
from html import unescape
from pathlib import Path
from types import ModuleType

import pytest
from test_cli import STUDY
from test_plugin import install

from lagrange_bench.experiments import catalogue
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.integrators import METHODS
from lagrange_bench.report import page
from lagrange_bench.results import sources
from lagrange_bench.results.choice import Choice
from lagrange_bench.results.store import Store, make_record

MODULE = f"""
from dataclasses import replace
from pathlib import Path
from lagrange_bench.integrators import METHODS, Potential

Path(__file__).with_name("ran").touch()
POTENTIAL = Potential("evil", lambda x1, x2, x3, p: p[0] * x1)
METHOD = replace(METHODS["strang"], name="evil", label="Evil Strang")
{STUDY}"""


def stored(folder, experiment, cell, rows=({"square": 0.1},), version=1):
    Store(folder).append(make_record(experiment, version, 0, cell, rows=list(rows)))


@pytest.fixture
def evil(folder, swept, one_core, monkeypatch):
    """Results of somebody whose modules can be imported from the current folder, as can any other."""
    monkeypatch.setitem(vars(METHODS), "_entries", METHODS._entries)
    (folder / "evilpkg").mkdir()
    for name in ("exp", "method"):
        (folder / "evilpkg" / f"{name}.py").write_text(MODULE)
    for name in ("results", "other", "own"):
        (folder / name).mkdir()
    stored("results", "evilpkg.exp", {"i": 0})
    stored("results", "unittest.__main__", {"i": 0})
    swept("results", "sweep_x", method="evilpkg.method:METHOD")
    cell = {"method": "evilpkg.method:METHOD", "part": "longtime", "state": "generic", "h": 0.1}
    stored("results", "drift", cell, [{"t": 1.0, "n": 10, "H": 1e-9}], load("drift").VERSION)
    stored("other", "evilpkg.exp", {"i": 0}, [{"square": 0.2}])
    swept("own", "sweep_x", method="strang", potential="evilpkg.method:POTENTIAL", parameters="0.1")
    yield folder
    catalogue.installed.cache_clear()


COMMANDS = {  # → exit code, what they say
    "report --results results --output plain": (1, "not drawn: evilpkg.exp: unknown experiment 'evilpkg.exp'"),
    "figure evilpkg.exp_squares --results results": (2, "unknown"),
    "compare results other --times": (1, "unknown experiment 'evilpkg.exp'"),
    "verify results --quiet --longest 10": (2, "unknown experiment 'unittest.__main__'"),
    "verify own --quiet": (2, "not computed: evilpkg.method:POTENTIAL: not available here"),
}


def test_nothing_is_imported_that_no_command_names(evil, run):
    """Here or in a process that a command started."""
    for words, (code, said) in COMMANDS.items():
        found, out, err = run(*words.split())
        assert (found, said in out + err) == (code, True), err
        assert not (evil / "evilpkg" / "ran").exists(), words
        assert "evilpkg" not in sys.modules
    text = (evil / "plain" / "index.html").read_text(encoding="utf-8")
    assert "evilpkg.method:METHOD" in text  # the rows are shown, under the name they have
    assert "Evil Strang" not in text
    words = ("--module", "evilpkg.exp", "--module", "evilpkg.method")
    assert "not drawn: evilpkg.exp" not in run("report", "--results", "results", "--output", "page", *words)[2]
    assert (evil / "evilpkg" / "ran").exists()
    assert "Evil Strang" in (evil / "page" / "index.html").read_text(encoding="utf-8")
    code, out, err = run("verify", "own", "--quiet", "--module", "evilpkg.method")
    assert (code, "not computed" in out + err) == (1, False)  # the stored rows are made up


def test_an_installed_experiment_needs_no_permission(evil, in_process, run):
    install(evil, "evil", {"lagrange_bench.experiments": {"evil": "evilpkg.exp", "drift": "evilpkg.exp"}})
    catalogue.installed.cache_clear()  # a process that lists experiments does so once
    code, out, err = run("run", "evil", "--results", "rows", "--jobs", "1", "--quiet", "--json")
    assert (code, json.loads(out)["experiments"]["evil"]["computed"]) == (0, 6), err + out
    assert run("figure", "evil_squares", "--results", "rows", "--quiet")[:2] == (0, "evil_squares.svg\n")
    assert "6 identical" in run("verify", "rows", "--quiet")[1]
    assert load("drift").__name__ == "lagrange_bench.experiments.drift"


@pytest.mark.parametrize("name", ["page", "page/index.html", "page/figures"])
def test_a_link_in_a_foreign_folder_is_not_followed(run, tmp_path, name):
    """What it points to is the reader's."""
    foreign, target = tmp_path / "results", tmp_path / "mine"
    target.write_text("mine") if name.endswith(".html") else target.mkdir()
    (foreign / name).parent.mkdir(parents=True)
    stored(foreign, "drift", {"state": "generic", "method": "rk4"})
    (foreign / name).symlink_to(target)
    code, out, err = run("report", "--results", foreign, "--quiet")
    assert (code, out) == (2, "")
    assert f"{foreign / name} is a symbolic link: remove it, or give another folder with --output" in err
    assert target.read_text() == "mine" if target.is_file() else not list(target.iterdir())


NAME = "toy.study"


@pytest.fixture
def study(one_core, monkeypatch, tmp_path):
    """An experiment of six cells whose rows are in ./out, computed with VERSION 1; the page has nothing else."""
    module = ModuleType(NAME, "A study of squares.\n\nNothing more.")
    exec(STUDY, vars(module))
    monkeypatch.setitem(sys.modules, NAME, module)
    monkeypatch.setattr(page, "EXPERIMENTS", (NAME,))
    monkeypatch.setattr(sources, "of_cell", lambda *cell: "1" * 24)  # it has no file
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    append(module, *range(6))
    return module


def append(module, *numbers):
    for i in numbers:
        Store("out").append(make_record(NAME, module.VERSION, i, {"i": i}, rows=module.measure({"i": i})))


def shown():
    """What one reads on the page that is drawn from ./out."""
    text = page.html(page.assemble(Path("out")))
    return unescape(re.sub("<[^>]*>", "", text))


AGAIN = "Compute them again: lagrange-bench run toy.study --profile quick --results out --again"
FIGURE = ("figure", f"{NAME}_squares", "--results", "out")


def test_rows_of_another_version_are_named_until_there_are_newer_ones(run, study):
    def old():
        code, out, err = run(*FIGURE)
        assert code == 0, err
        return re.findall("(.) (?:stored cells were computed with|cells of) another VERSION", err)

    assert old() == [], "negative control"
    study.VERSION = 2
    assert old() == ["6"]
    assert f"6 stored cells were computed with another VERSION of the experiment than this. {AGAIN}" in shown()
    assert "--again computes them again" in run("report", "--results", "out", "--output", "page")[2]
    append(study, 0, 1)
    assert (old(), Store("out").rows(NAME)["i"].tolist()) == (["4"], [0, 1]), "those left out"
    study.VERSION = 1
    assert len(Store("out").rows(NAME)) == 6, "taken back, as `run` takes its cells for computed"
    study.VERSION = 3
    assert Store("out").rows(NAME)["i"].tolist() == [0, 1], "the newest there is"
    Store("out").append(make_record(NAME, 1, 9, {"i": 9, "method": "rk4"}, rows=[{"square": 81.0}]))
    one = Store("out", Choice(methods=("rk4",))).open(NAME)
    assert (one.latest, "1 cells of another VERSION" in one.problems[0]) == ([], True), (
        "nor by a choice of only older ones"
    )


def test_old_rows_and_damaged_lines_are_named(run, study):
    for i in (1, 2):
        Store("out").append(make_record(NAME, 1, i, {"i": i}, rows=study.measure({"i": i}), sources="0" * 24))
    path = Store("out").path(NAME)
    path.write_bytes(path.read_bytes().replace(b'"square":25.0', b'"square":26.0'))
    damaged = "toy.study.jsonl, line 6: damaged; skipped, its cell counts as not computed"
    other = f"{NAME}: 2 stored cells were computed with other source code than this. {AGAIN}"
    code, out, err = run(*FIGURE)
    assert (code, err.endswith(f"{damaged}\n{other}\n")) == (0, True), err
    assert {damaged, other.removeprefix(f"{NAME}: ")} <= set(shown().splitlines())
    assert json.loads(run(*FIGURE, "--json")[1])["notes"] == [damaged, other]
    assert run(*FIGURE, "--quiet")[2] == ""
    path.write_bytes(b"{}\n")
    code, out, err = run(*FIGURE)
    assert (code, out) == (2, "")
    assert "cannot be drawn from out: toy.study.jsonl, line 1: damaged" in err
