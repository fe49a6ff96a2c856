"""Rows that do not come from the code that is here are never shown in silence, whatever command shows them."""

from __future__ import annotations

import json
import re
import sys
from html import unescape
from pathlib import Path
from types import ModuleType

import pytest

from lagrange_bench.experiments.drawing import style
from lagrange_bench.report import page
from lagrange_bench.results import sources
from lagrange_bench.results.choice import Choice
from lagrange_bench.results.store import Store, make_record

NAME = "toy.study"


def draw(rows):
    figure, ax = style.figure("column")
    ax.plot(rows.i, rows.square)
    figure.caption = "Squares."
    return {"squares": figure}


@pytest.fixture
def study(one_core, monkeypatch, tmp_path):
    """An experiment of six cells whose rows are in ./out, computed with VERSION 1; the page has nothing else."""
    module = ModuleType(NAME, "A study of squares.\n\nNothing more.")
    module.VERSION, module.draw, module.tables = 1, draw, lambda rows: {}
    module.cells = lambda profile: [{"i": i} for i in range(6)]
    module.measure = lambda cell: [{"square": float(cell["i"] ** 2)}]
    monkeypatch.setitem(sys.modules, NAME, module)
    monkeypatch.setattr(page, "EXPERIMENTS", (NAME,))
    monkeypatch.setattr(sources, "of_cell", lambda *cell: "1" * 24)  # it has no file
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    append(module, *range(6))
    return module


def append(module, *numbers, folder="out"):
    for i in numbers:
        Store(folder).append(make_record(NAME, module.VERSION, i, {"i": i}, rows=module.measure({"i": i})))


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
