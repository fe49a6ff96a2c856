"""A file that is edited while a run goes on makes no false row: the rows of other code are not stored, and the run says so."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from lagrange_bench.results.store import Store

pytestmark = pytest.mark.processes

STUDY = """
import json, os, time
from pathlib import Path
from lagrange_bench.integrators.problem import units
from own import helper

VERSION = 1

def cells(profile):
    return json.loads(os.environ["CELLS"])

def measure(cell):
    if cell.get("edit") and "EDIT" in os.environ:
        file = Path(os.environ["EDIT"])
        file.write_text(file.read_text().replace("VALUE = 1", "VALUE = 2") + "# edited\\n")
    time.sleep(60 if cell.get("hang") and "EDIT" in os.environ else 0)
    return [{"value": float(helper.VALUE)}]

def draw(rows): return {}
def tables(rows): return {}
"""
HANGING = [{"i": 0, "edit": True, "hang": True}, {"i": 1}, {"i": 2}]  # the third process begins after the edit
TIMING = [{"i": 0}, {"i": 1, "edit": True}, {"i": 2, "timing": True}]


@pytest.mark.parametrize(
    ("file", "cells", "stored"),
    [("own/helper.py", HANGING, []), ("lagrange_bench/integrators/problem/units.py", TIMING, [0])],
)
def test_an_edit_in_the_middle_of_a_run(tree, file, cells, stored):
    """Of a plug-in or of the bench: what was done before it is stored, the rest is set aside."""
    (tree / "own").mkdir()
    (tree / "own" / "study.py").write_text(STUDY)
    (tree / "own" / "helper.py").write_text("VALUE = 1\n")
    text = (tree / file).read_text()

    def run(**environment):
        settings = {**os.environ, "PYTHONPATH": str(tree), "CELLS": json.dumps(cells), **environment}
        words = ("run", "own.study", "--results", "out", "--jobs", "1", "--time-limit", "3", "--quiet", "--json")
        command = [sys.executable, "-m", "lagrange_bench", *words]
        done = subprocess.run(command, cwd=tree, env=settings, capture_output=True, text=True, check=False)
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)["experiments"]["own.study"]

    def values():
        rows = Store(tree / "out").rows("own.study")
        return {row.i: row.value for row in rows.itertuples() if row.status == "done"}

    code, tally = run(EDIT=file)
    assert (code, tally["computed"], tally["set_aside"]) == (1, len(stored), 3 - len(stored) - tally["failed"])
    assert values() == dict.fromkeys(stored, 1.0)
    (tree / file).write_text(text)
    code, tally = run()
    assert (code, tally["computed"], tally["stored"], tally["set_aside"]) == (0, 3 - len(stored), len(stored), 0)
    assert values() == dict.fromkeys(range(3), 1.0)
