"""Rows that do not come from the code that is here are never shown in silence, whatever command shows them."""

from __future__ import annotations

import json
import re
import sys
from html import unescape
from pathlib import Path
from types import ModuleType

import pytest

from experiments.drawing import style
from report import page
from results.store import Store, clean, make_record

NAME = "toy.study"


def draw(rows):
    figure, ax = style.figure("column")
    ax.plot(rows.i, rows.square)
    figure.caption = "Squares."
    return {"squares": figure}


@pytest.fixture
def study(monkeypatch, tmp_path):
    """An experiment of six cells whose rows are in ./out, computed with VERSION 1; the page has nothing else."""
    module = ModuleType(NAME, "A study of squares.\n\nNothing more.")
    module.VERSION, module.draw, module.tables = 1, draw, lambda rows: {}
    module.cells = lambda profile: [{"i": i} for i in range(6)]
    module.measure = lambda cell: [{"square": float(cell["i"] ** 2)}]
    monkeypatch.setitem(sys.modules, NAME, module)
    monkeypatch.setattr(page, "EXPERIMENTS", (NAME,))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    append(module, *range(6))
    return module


def append(module, *numbers, folder="out"):
    for i in numbers:
        done = {"status": "done", "rows": module.measure({"i": i}), "error": None, "warnings": [], "seconds": 0.1}
        Store(folder).append(make_record(NAME, module.VERSION, i, clean({"i": i}), **done))


def shown(run):
    """What report, figure, figure --all and compare have to say: the words of the page, and of the others all lines."""
    code, out, err = run("report", "--results", "out", "--output", "page", "--quiet")
    assert code == 0, err
    words = unescape(re.sub("<[^>]*>", "", Path("page/index.html").read_text(encoding="utf-8")))
    found = [words]
    for arguments in (
        (f"{NAME}_squares", "--output", "one.svg"),
        ("--all", "--format", "svg", "--width", "page", "--output", "all"),
    ):
        code, out, err = run("figure", *arguments, "--results", "out")
        assert code == 0, err
        found.append(err)
        code, out, err = run("figure", *arguments, "--results", "out", "--json")
        assert "\n".join(json.loads(out)["notes"]) in found[-1]
    code, out, err = run("compare", "out", "out")
    assert (code, err) == (0, "")
    return [*found, out]


AGAIN = "Compute them again: lagrange-bench run toy.study --profile quick --results out --again"


def test_rows_of_another_version_are_named(run, study):
    assert not any("VERSION" in words for words in shown(run)), "negative control"
    study.VERSION = 2
    old = "6 stored cells were computed with another VERSION of the experiment than this"
    for words in shown(run):
        assert f"{old}. {AGAIN}" in words
    append(study, 0, 1)
    old = "4 stored cells were computed with another VERSION of the experiment than this, and left out"
    for words in shown(run):
        assert f"{old}. {AGAIN}" in words
    assert Store("out").rows(NAME)["i"].tolist() == [0, 1]
    append(study, *range(2, 6))
    assert not any("VERSION" in words for words in shown(run))


def test_a_version_that_is_taken_back_shows_its_rows(run, study):
    """As `run` does, which takes its cells for computed."""
    study.VERSION = 2
    append(study, 0, 1)
    study.VERSION = 1
    assert Store("out").rows(NAME)["i"].tolist() == [*range(6)]
    assert not any("VERSION" in words for words in shown(run))
    study.VERSION = 3
    assert "2 stored cells were computed with another VERSION of the experiment than this; 4 stored" in shown(run)[1]


def test_cells_that_the_experiment_no_longer_has_are_not_missed(run, study):
    study.VERSION = 2
    append(study, *range(3))
    study.cells = lambda profile: [{"i": i} for i in range(3)]
    assert not any("VERSION" in words for words in shown(run))
