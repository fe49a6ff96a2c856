"""What goes wrong on real machines: nothing confirmed is lost, half-written or false, and the message says what to do.

The store by itself is tested in `test_store`, a cluster in `test_cluster`. LAGRANGE_BENCH_KILLS=50 kills more often.
"""

import contextlib
import os
import random
import signal
import sys
import time

import pytest
from faults import TOY, comparable, nobody_left, squares, start, wait_for_lines

from lagrange_bench.results.store import Store

linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
pytestmark = [linux, pytest.mark.processes]
KILLS = int(os.environ.get("LAGRANGE_BENCH_KILLS", 3))


def test_killed_at_random_moments_and_resumed(toy, in_process, tmp_path):
    """SIGKILL: no handler, no clean-up. The moments are spread over the whole run, its start included.

    The same command again computes what is missing, and nothing twice; the rows are those of a run without accidents.
    """
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
    run = start(cells, path.parent)
    _, err = run.communicate(timeout=120)
    assert run.returncode == 0, err
    records, problems = Store(path.parent).read(TOY)
    assert problems == []
    assert len({r["key"] for r in records}) == len(records) == len(cells)
    toy(cells)
    assert comparable(path.parent) == comparable(toy.store.folder)


@pytest.mark.parametrize("words", [(), pytest.param(("--scheduler", "local:2"), marks=pytest.mark.slow)])
def test_interrupt(tmp_path, words):
    """Ctrl-C of a terminal reaches every process of the group."""
    if words:
        pytest.importorskip("distributed")
    run = start([*squares(1, 2, 3), {"do": "compiled loop", "i": 99}, *squares(4, 5, 6)], tmp_path, *words)
    wait_for_lines(tmp_path / f"{TOY}.jsonl", 6, run)
    os.killpg(run.pid, signal.SIGINT)
    out, err = run.communicate(timeout=30)  # the cell would have taken ten minutes
    assert (run.returncode, out, "Traceback" in err, err.count("interrupted")) == (130, "", False, 1)
    assert err.endswith(f"6 of 7 cells are stored in {tmp_path}; run the same command again to resume\n")
    assert nobody_left(run.pid)


EDITS = """
import os
from pathlib import Path
from own import helper

VERSION = 1

def cells(profile):
    return [{"i": 0}, {"i": 1, "edit": True}, {"i": 2}, {"i": 3, "timing": True}]

def measure(cell):
    if cell.get("edit") and "EDIT" in os.environ:
        Path(os.environ["EDIT"]).write_text("VALUE = 22\\n")
    return [{"value": float(helper.VALUE)}]

def tables(rows): return {}
def draw(rows): return {}
"""


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
    assert "old: own.study: 1 of 2 stored cells computed with other source code than this" in out
    assert answer(*command, "--again")["experiments"]["own.study"]["computed"] == 1
    assert stored() == dict.fromkeys(range(4), 1.0)
