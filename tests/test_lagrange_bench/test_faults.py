"""What goes wrong on real machines: nothing confirmed is lost, nothing is half-written, and the message says what to do.

The store by itself is tested in `test_store`, a cluster in `test_cluster`. LAGRANGE_BENCH_KILLS=50 kills more often.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from faults import HERE, TOY, comparable, nobody_left, session, squares, start, wait_for_lines

from lagrange_bench.results import provenance
from lagrange_bench.results.store import SCHEMA, Store, make_record
from lagrange_bench.runner import engine

pytestmark = pytest.mark.processes
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
KILLS = int(os.environ.get("LAGRANGE_BENCH_KILLS", 12))


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """run(cells, …) -> Summary; the store is in tmp_path/"here". pace=0: without the pauses of the cells."""
    monkeypatch.syspath_prepend(str(HERE))

    def run(cells, pace=1, **options):
        monkeypatch.setenv("TOY_CELLS", json.dumps(cells))
        monkeypatch.setenv("TOY_PACE", str(pace))
        return engine.run([TOY], "quick", tmp_path / "here", 2, show=False, **options)

    return run


def finish(run):
    out, err = run.communicate(timeout=120)
    return run.returncode, out, err


def workers_of(run):
    return [pid for pid in session(run.pid) if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()]


def wait_for_worker(run):
    for _ in range(1500):
        if workers_of(run):
            return
        time.sleep(0.02)
    raise AssertionError("it never had a worker")


def one_line(err):
    assert re.fullmatch(r"lagrange-bench: error: [^\n]*\n", err), err
    return err


# ---------------------------------------------------------------- killed


@linux
@pytest.mark.slow
def test_killed_at_random_moments_and_resumed(toy, tmp_path):
    """SIGKILL: no handler, no clean-up. The moments are spread over the whole run, its start included."""
    cells = [*squares(*range(40), seconds=0.05), *squares(*range(40, 46), timing=True)]
    path, draw = tmp_path / "killed" / f"{TOY}.jsonl", random.Random(7)
    sizes, died = [], 0
    for kill in range(KILLS):
        run = start(cells, path.parent)
        if kill % 4:  # after some cell of this run; else at any time after its start
            lines = path.read_bytes().count(b"\n") if path.exists() else 0
            with contextlib.suppress(AssertionError):  # it was done before
                wait_for_lines(path, lines + 1, run)
        time.sleep(draw.uniform(0, 0.1 if kill % 4 else 0.8))
        run.kill()
        run.communicate()
        died += run.returncode == -signal.SIGKILL
        assert nobody_left(run.pid)  # workers notice that they are alone
        sizes.append(len(comparable(path.parent)))
        if sizes[-1] > 0.8 * len(cells):  # start afresh; what was lost would be seen here
            check_complete(cells, path.parent)
            path.unlink()
    assert died > KILLS / 2
    assert max(sizes) > 0
    check_complete(cells, path.parent)
    toy(cells, pace=0)
    assert comparable(path.parent) == comparable(tmp_path / "here")


def check_complete(cells, folder):
    code, out, err = finish(start(cells, folder))
    assert code == 0, err
    records, problems = Store(folder).read(TOY)
    assert problems == []
    assert len({r["key"] for r in records}) == len(records) == len(cells)


@linux
def test_a_worker_that_is_killed_costs_nothing(toy, tmp_path):
    run = start(squares(*range(30), seconds=0.1), tmp_path / "killed", jobs=1)
    wait_for_lines(tmp_path / "killed" / f"{TOY}.jsonl", 3, run)
    (worker,) = workers_of(run)
    os.kill(int(worker), signal.SIGKILL)
    code, out, err = finish(run)
    assert code == 0, out
    toy(squares(*range(30), seconds=0.1), pace=0)
    assert comparable(tmp_path / "killed") == comparable(tmp_path / "here")


# ---------------------------------------------------------------- interrupted more than once


@linux
@pytest.mark.parametrize("words", [(), ("--scheduler", "local:2")], ids=["here", "Dask"])
def test_more_interrupts_change_nothing(tmp_path, words):
    """One for every moment of the end, the interpreter's own included: nothing but the first one's message and exit code."""
    if words:
        pytest.importorskip("distributed")
    run = start([*squares(1, 2), {"do": "compiled loop", "i": 3}], tmp_path, *words)
    wait_for_lines(tmp_path / f"{TOY}.jsonl", 2, run)
    while run.poll() is None:
        os.killpg(run.pid, signal.SIGINT)
        time.sleep(0.001)
    out, err = run.communicate()
    assert (run.returncode, out) == (130, ""), err
    assert re.fullmatch(r"lagrange-bench: interrupted: 2 of 3 cells are stored in .*; run the same [^\n]*\n", err), err
    assert nobody_left(run.pid)


# ---------------------------------------------------------------- cells that hang or crash


def test_a_cell_that_hangs_is_ended_and_the_rest_goes_on(toy, tmp_path):
    cells = [{"do": "compiled loop", "i": 100}, *squares(1, 2, 3), {"do": "compiled loop", "i": 101, "timing": True}]
    before = time.monotonic()
    summary = toy([*cells, *squares(4, timing=True)], time_limit=3.0)
    assert time.monotonic() - before < 30  # each would have taken a minute
    assert summary.tallies[TOY].computed == 4
    assert [error for _, _, error in summary.failures] == 2 * [
        "TimeLimit: not done after 3 s, so its process was ended; --time-limit SECONDS allows more"
    ]
    assert summary.exit_code == 1
    assert multiprocessing.active_children() == []
    assert [r["seconds"] >= 3 for r in Store(tmp_path / "here").latest(TOY) if r["status"] == "failed"] == [True, True]
    assert engine.TIME_LIMITS.keys() == set(engine.PROFILES)


def test_neighbours_of_a_crash_are_not_computed_again(toy, tmp_path):
    cells = [{"do": "segfault", "i": 100}, *squares(*range(20), facts=True, seconds=0.05)]
    summary = toy(cells)
    assert summary.failures[0][2] == "WorkerDied: the worker process was killed by SIGSEGV"
    records = Store(tmp_path / "here").read(TOY)[0]
    assert len(records) == 21
    processes = {r["rows"][0]["process"] for r in records if r["status"] == "done"}
    assert len(processes) == 2  # the neighbour's went on; the other was replaced


# ---------------------------------------------------------------- damaged stores


@pytest.fixture
def stored(toy, tmp_path):
    toy(squares(*range(6)))
    return tmp_path / "here" / f"{TOY}.jsonl"


@pytest.mark.parametrize("damage", ["torn", "middle", "duplicate", "binary"])
def test_a_damaged_journal_is_mended_by_the_next_run(toy, stored, tmp_path, damage):
    clean, whole = comparable(tmp_path / "here"), stored.read_bytes()
    lines = whole.splitlines(keepends=True)
    stored.write_bytes(
        {
            "torn": whole[:-40],
            "middle": whole.replace(b'"square":4.0', b'"square":5.0'),
            "duplicate": whole + lines[2] + lines[2],
            "binary": b"".join([*lines[:3], bytes(range(256)) * 30 + b"\n", *lines[3:]]),
        }[damage]
    )
    damaged = stored.read_bytes()
    summary = toy(squares(*range(6)))
    lost = {"torn": 1, "middle": 1, "duplicate": 0, "binary": 0}[damage]
    assert (summary.tallies[TOY].computed, summary.tallies[TOY].stored) == (lost, 6 - lost)
    words = {"torn": ["cut off"], "middle": [": damaged"], "duplicate": [], "binary": ["damaged"]}[damage]
    assert all(any(word in note for note in summary.notes) for word in words)
    assert all("its cell counts as not computed" in note for note in summary.notes)
    assert comparable(tmp_path / "here") == clean
    assert stored.read_bytes().startswith(damaged)  # nothing is rewritten


def test_a_store_of_a_newer_version(toy, stored, tmp_path):
    record = {**Store(tmp_path / "here").read(TOY)[0][0], "schema": SCHEMA + 1}
    Store(tmp_path / "here").append(record)
    before = stored.read_bytes()
    code, out, err = finish(start(squares(1), tmp_path / "here"))
    assert code == 2
    assert f"line 7: written with schema {SCHEMA + 1}, this version reads {SCHEMA}: update" in one_line(err)
    assert stored.read_bytes() == before


@linux
def test_two_runs_into_one_store_at_once(toy, tmp_path):
    gate = tmp_path / "gate"
    cells = [{"do": "wait for lines", "i": 100, "file": str(gate), "lines": 1}, *squares(*range(24))]
    runs = [start(cells, tmp_path / "shared", jobs=1) for _ in range(2)]
    for run in runs:
        wait_for_worker(run)
    gate.write_text("both have begun\n")
    assert [finish(run)[0] for run in runs] == [0, 0]
    records, problems = Store(tmp_path / "shared").read(TOY)
    assert problems == []
    assert [r["cell"]["i"] for r in records].count(100) == 2  # they did meet
    toy(cells)
    assert comparable(tmp_path / "shared") == comparable(tmp_path / "here")


# ---------------------------------------------------------------- disks


@contextlib.contextmanager
def mounted(folder, options):
    """A file system of its own in memory; skips where that is not permitted."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, check=False
    )
    if done.returncode:
        pytest.skip(f"mount is not permitted here: {done.stderr.decode().strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@linux
def test_a_disk_that_is_full(toy, tmp_path):
    cells = squares(*range(200))
    with mounted(tmp_path / "small", "size=64k"):
        code, out, err = finish(start(cells, tmp_path / "small" / "results"))
        assert code == 2
        assert "No space left on device. To go on: free some space, or choose another folder with --results" in err
        assert "What was stored before is kept" in err.splitlines()[-1]
        records, problems = Store(tmp_path / "small" / "results").read(TOY)
        assert problems == []
        assert 0 < len(records) < 200
        shutil.copytree(tmp_path / "small" / "results", tmp_path / "here")  # the other folder goes on with them
    summary = toy(cells)
    assert summary.tallies[TOY].stored == len(records)
    assert summary.tallies[TOY].computed == 200 - len(records)


@linux
def test_a_disk_that_is_read_only(tmp_path):
    with mounted(tmp_path / "frozen", "size=64k,ro"):
        code, out, err = finish(start(squares(1), tmp_path / "frozen" / "results"))
        assert (code, out) == (2, "")
        assert "Read-only file system" in one_line(err)
        assert "--results" in err


LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
from lagrange_bench.__main__ import main
if __name__ == "__main__":
    sys.exit(main(["run", "toys.behaviour", "--quiet", "--results", sys.argv[1]]))
"""


@linux
def test_a_run_that_meets_a_limit_on_file_sizes(toy, tmp_path):
    cells = squares(*range(60))
    environment = {**os.environ, "TOY_CELLS": json.dumps(cells), "PYTHONPATH": str(HERE)}
    command = [sys.executable, "-c", LIMITED, str(tmp_path / "here")]
    done = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "File too large. To go on: raise the limit on file sizes (ulimit -f), or" in one_line(done.stderr)
    records, problems = Store(tmp_path / "here").read(TOY)
    assert problems == []
    assert 0 < len(records) < 60
    assert toy(cells).tallies[TOY].computed == 60 - len(records)


# ---------------------------------------------------------------- clocks


def test_a_clock_that_goes_backwards(toy, tmp_path, monkeypatch):
    """Durations are of a clock that cannot; the time of day is only told. Which record counts is their order."""
    assert toy([{"do": "wrong clock", "i": 1}]).exit_code == 0
    (record,) = Store(tmp_path / "here").read(TOY)[0]
    assert 0 <= record["seconds"] < 60

    class Backwards:
        now_ = datetime(2030, 1, 1, tzinfo=UTC)

        @classmethod
        def now(cls, zone):
            cls.now_ -= timedelta(hours=1)
            return cls.now_

    monkeypatch.setattr(provenance, "datetime", Backwards)
    store = Store(tmp_path / "clock")
    store.folder.mkdir()
    for value in (1.0, 2.0):
        row = {"status": "done", "rows": [{"value": value}], "error": None, "warnings": [], "seconds": 0.0}
        store.append(make_record(TOY, 1, 0, {"i": 1}, **row))
    first, second = store.read(TOY)[0]
    assert first["provenance"]["utc"] > second["provenance"]["utc"]
    assert store.rows(TOY)["value"].tolist() == [2.0]


# ---------------------------------------------------------------- again


def test_real_experiments_give_the_same_rows_again(tmp_path):
    """Stopped and resumed, or in one go: the same bits, cell by cell."""
    once, pieces = tmp_path / "once", tmp_path / "pieces"
    engine.run(["paper"], "quick", once, 2, show=False)
    engine.run(["paper"], "quick", pieces, 1, show=False)
    path = pieces / "paper.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[::2]))
    engine.run(["paper"], "quick", pieces, 1, show=False)
    assert comparable(once, "paper") == comparable(pieces, "paper")
    assert len(comparable(once, "paper")) == len(engine.load("paper").cells("quick"))
    path = once / "paper.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-2]))
    assert engine.run(["paper"], "quick", once, 1, show=False).tallies["paper"].computed == 2
    assert comparable(once, "paper") == comparable(pieces, "paper")
