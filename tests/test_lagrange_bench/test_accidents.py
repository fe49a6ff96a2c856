"""What goes wrong on real machines: nothing confirmed is lost, half-written or false, and the message says what to do.

The store by itself is tested in `test_store`, a cluster in `test_cluster`. LAGRANGE_BENCH_KILLS=50 kills more often.
"""

import contextlib
import json
import os
import random
import signal
import sys
import time

import pytest
from faults import TOY, comparable, nobody_left, squares, start, wait_for_lines
from test_cli import STUDY

from lagrange_bench.results.store import Store

linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
pytestmark = [linux, pytest.mark.processes]
KILLS = int(os.environ.get("LAGRANGE_BENCH_KILLS", 3))


def finish(run):
    out, err = run.communicate(timeout=120)
    return run.returncode, out, err


def check_complete(toy, cells, folder):
    """The same command again computes what is missing, and nothing twice; the rows are those of a run without accidents."""
    code, out, err = finish(start(cells, folder))
    assert code == 0, err
    records, problems = Store(folder).read(TOY)
    assert problems == []
    assert len({r["key"] for r in records}) == len(records) == len(cells)
    toy(cells)
    assert comparable(folder) == comparable(toy.store.folder)


def test_killed_at_random_moments_and_resumed(toy, in_process, tmp_path):
    """SIGKILL: no handler, no clean-up. The moments are spread over the whole run, its start included."""
    cells = [*squares(*range(40), seconds=0.05), *squares(*range(40, 46), timing=True)]
    path, draw = tmp_path / "killed" / f"{TOY}.jsonl", random.Random(7)
    for kill in range(KILLS):
        run = start(cells, path.parent)
        if kill % 4:  # after some cell of this run; else at any time after its start
            lines = path.read_bytes().count(b"\n") if path.exists() else 0
            with contextlib.suppress(AssertionError):  # it was done before
                wait_for_lines(path, lines + 1, run)
        time.sleep(draw.uniform(0, 0.1 if kill % 4 else 0.8))
        run.kill()
        run.communicate()
        assert nobody_left(run.pid)  # workers notice that they are alone
    check_complete(toy, cells, path.parent)


INTERRUPTS = {"terminal": (os.killpg, ()), "parent": (os.kill, ()), "cluster": (os.killpg, ("--scheduler", "local:2"))}


@pytest.mark.parametrize(
    "whom", ["terminal", *(pytest.param(w, marks=pytest.mark.slow) for w in ("parent", "cluster"))]
)
def test_interrupt(tmp_path, whom):
    """Ctrl-C of a terminal reaches every process of the group; `kill -INT` only the one that is named."""
    kill, words = INTERRUPTS[whom]
    if whom == "cluster":
        pytest.importorskip("distributed")
    run = start([*squares(1, 2, 3), {"do": "compiled loop", "i": 99}, *squares(4, 5, 6)], tmp_path, *words)
    wait_for_lines(tmp_path / f"{TOY}.jsonl", 6, run)
    before = time.monotonic()
    kill(run.pid, signal.SIGINT)
    code, out, err = finish(run)
    assert time.monotonic() - before < 30  # the cell would have taken a minute
    assert (code, out, "Traceback" in err, err.count("interrupted")) == (130, "", False, 1)
    assert err.endswith(f"6 of 7 cells are stored in {tmp_path}; run the same command again to resume\n")
    assert nobody_left(run.pid)


def test_a_run_that_meets_a_full_disk(toy, in_process, run, monkeypatch):
    """What was confirmed is whole, and the next run goes on."""
    cells, write = squares(*range(60)), os.write

    def full(file, data):
        if os.fstat(file).st_size > 20_000:
            raise OSError(28, "No space left on device")
        return write(file, data)

    with monkeypatch.context() as patch:
        patch.setenv("TOY_CELLS", json.dumps(cells))
        patch.setattr(os, "write", full)
        code, _, err = run("run", TOY, "--quiet", "--results", toy.store.folder)
    assert (code, err.count("\n")) == (2, 1)
    assert "No space left on device. What was stored before is kept. To go on: " in err
    records, problems = toy.store.read(TOY)
    assert (problems, 0 < len(records) < len(cells)) == ([], True)
    assert toy(cells).experiments[TOY].computed == len(cells) - len(records)


EDITS = (
    STUDY
    + """
import os
from pathlib import Path
from own import helper

def cells(profile):
    return [{"i": 0}, {"i": 1, "edit": True}, {"i": 2}, {"i": 3, "timing": True}]

def measure(cell):
    if cell.get("edit") and "EDIT" in os.environ:
        Path(os.environ["EDIT"]).write_text("VALUE = 22\\n")
    return [{"value": float(helper.VALUE)}]
"""
)


def test_an_edit_in_the_middle_of_a_run_makes_no_false_row(folder, answer, run, monkeypatch):
    """The process that read the old file stores no row any more; a new process, that of the timings, reads the new file."""
    (folder / "own").mkdir()
    (folder / "own" / "study.py").write_text(EDITS)
    helper = folder / "own" / "helper.py"
    command = ("run", "own.study", "--results", "out", "--jobs", "1")

    def stored():
        return {row.i: row.value for row in Store("out").rows("own.study").itertuples() if row.status == "done"}

    helper.write_text("VALUE = 1\n")
    with monkeypatch.context() as patch:
        patch.setenv("EDIT", str(helper))
        code, out, _ = run(*command)
    assert (code, out.count("SourceEdited: a source file was edited"), stored()) == (1, 2, {0: 1.0, 3: 22.0})
    helper.write_text("VALUE = 1\n")
    code, out, _ = run(*command)
    assert (code, stored()) == (0, {0: 1.0, 1: 1.0, 2: 1.0, 3: 22.0})
    assert "old: own.study: 1 stored cell was computed with other source code than this" in out
    assert answer(*command, "--again")["experiments"]["own.study"]["computed"] == 1
    assert stored() == dict.fromkeys(range(4), 1.0)
