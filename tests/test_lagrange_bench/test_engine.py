"""A run computes what is missing, survives what cells do to it, and stops before it does harm."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import sys
import time

import pytest
from faults import HERE, TOY, squares

from lagrange_bench.integrators import memory, registry
from lagrange_bench.integrators.interface import Method
from lagrange_bench.results.store import Store, StoreError
from lagrange_bench.runner import engine, progress, workers

pytestmark = pytest.mark.processes


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """run(cells, …) -> Summary, with a store in `run.store`."""
    monkeypatch.syspath_prepend(str(HERE))

    def run(cells, jobs=2, **options):
        monkeypatch.setenv("TOY_CELLS", json.dumps(cells))
        return engine.run([TOY], "quick", tmp_path, jobs, **{"show": False, **options})

    run.store = Store(tmp_path)
    return run


def tally(summary):
    """(computed, stored, failed)"""
    found = summary.tallies[TOY]
    return found.computed, found.stored, found.failed


# ---------------------------------------------------------------- what is computed


def test_only_what_is_missing(toy, in_process, monkeypatch):
    first = toy(squares(1, 2, 3))
    assert (tally(first), first.exit_code) == ((3, 0, 0), 0)
    assert tally(toy(squares(3, 4, 1))) == (1, 2, 0)
    table = toy.store.rows(TOY)
    assert table["square"].tolist() == [i * i for i in table["i"]]
    assert sorted(table["i"]) == [1, 2, 3, 4]
    monkeypatch.setattr(engine.load(TOY), "VERSION", 2)
    assert tally(toy(squares(1))) == (1, 0, 0)
    assert toy.store.rows(TOY)["i"].tolist() == [1]


def test_rows_come_in_the_order_of_the_cells(toy):
    first = {"do": "wait for lines", "i": 5, "file": str(toy.store.path(TOY)), "lines": 4}  # and finishes last
    toy([first, *squares(4, 3, 2, 1)])
    assert toy.store.rows(TOY)["i"].tolist() == [5, 4, 3, 2, 1]
    assert toy.store.read(TOY)[0][-1]["cell"]["i"] == 5


def test_timing_cells_come_last_alone_in_order_and_with_one_thread(toy, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    timing = squares(9, 8, timing=True, facts=True, seconds=0.05)
    others = squares(1, 2, 3, facts=True, seconds=0.1)
    summary = toy([*timing, *others], timings=False)
    assert (tally(summary), summary.tallies[TOY].unavailable, summary.exit_code) == ((3, 0, 0), 2, 0)
    assert summary.notes == ["skipped: the timing cells of toys.behaviour, as asked"]
    toy.store.path(TOY).unlink()
    assert tally(toy([*timing, *others])) == (5, 0, 0)
    table = toy.store.rows(TOY)
    timing, accuracy = table[table["timing"] == True], table[table["timing"].isna()]  # noqa: E712
    assert timing["started"].min() >= accuracy["started"].max()  # "started" is read when the work is done
    assert timing["started"].is_monotonic_increasing
    assert timing["i"].tolist() == [9, 8]
    assert (timing["process"].nunique(), accuracy["process"].nunique()) == (1, 2)
    assert not set(timing["process"]) & set(accuracy["process"])  # fresh
    assert set(table["threads"]) == {"1"}
    assert (os.environ["OMP_NUM_THREADS"], os.environ.get("MKL_NUM_THREADS")) == ("7", None)


def test_warnings_and_chatter_are_kept_out_of_the_way(toy, capfd):
    assert toy([{"do": "warn", "i": 1}]).exit_code == 0
    streams = capfd.readouterr()
    assert streams.out == ""  # stdout is for data
    assert "chatter" in streams.err
    assert "toy warning" not in streams.err
    assert toy.store.read(TOY)[0][0]["warnings"] == ["RuntimeWarning: toy warning"]


# ---------------------------------------------------------------- cells that fail

ERRORS = {
    "raise": "ArithmeticError: cell 0 was told to",
    "bad row": "TypeError: cannot store",
    "exit": "SystemExit: 3",
    "surrogate": "ValueError: no such \\udcff file",
    "long text": f"ValueError: {'x' * 2000}… (10000000 characters)",
    "fail until there": "FileNotFoundError",
}


def test_a_failing_cell_is_a_result(toy, in_process, run, one_core, tmp_path):
    """Whatever a plug-in raises is a text of bounded length that can be printed, stored and put on a page."""
    file = tmp_path / "there"
    cells = [{"do": what, "i": i, "file": str(file)} for i, what in enumerate(ERRORS)] + squares(7, 8)
    cells += squares(9, method="nonsense")
    first = toy(cells)
    assert (tally(first), first.exit_code) == ((2, 0, 7), 1)
    errors = {cell["do"]: error for _, cell, error in first.failures}
    assert "unknown method 'nonsense'" in errors.pop("square")
    assert {what: error[: len(ERRORS[what])] for what, error in errors.items()} == ERRORS
    assert "raise ArithmeticError" in toy.store.open(TOY).failures()["error_traceback"][0]
    assert b"ArithmeticError" in str(first).encode()
    assert toy.store.path(TOY).stat().st_size < 50_000
    file.write_text("")
    second = toy(cells)  # failures are tried again, successes are not
    assert tally(second) == (1, 2, 6)
    code, out, err = run("report", "--results", tmp_path, "--module", TOY, "--quiet")
    assert (code, out) == (0, f"{tmp_path / 'page' / 'index.html'}\n"), err


def test_a_cell_that_kills_its_process_fails_alone(toy):
    """Also a timing cell. The neighbours are not computed again: their process goes on."""
    deadly = [{"do": "die", "i": 100}, {"do": "segfault", "i": 101}]
    timing = [{"do": "die", "i": 102, "timing": True}, *squares(6, timing=True)]
    summary = toy([deadly[0], *squares(*range(1, 6), seconds=0.05), deadly[1], *timing])
    assert (tally(summary), summary.exit_code) == ((6, 0, 3), 1)
    ended = "WorkerDied: the worker process ended itself with exit code 3"
    assert {(cell["i"], error) for _, cell, error in summary.failures} == {
        (100, ended),
        (101, "WorkerDied: the worker process was killed by SIGSEGV"),
        (102, ended),
    }
    assert len(toy.store.read(TOY)[0]) == 9
    assert multiprocessing.active_children() == []


def test_a_cell_that_hangs_is_ended_and_the_rest_goes_on(toy):
    """Also a cell that changes its clock, which decides about nothing."""
    cells = [{"do": "compiled loop", "i": 100}, *squares(1, 2), {"do": "compiled loop", "i": 101, "timing": True}]
    before = time.monotonic()
    summary = toy([*cells, {"do": "wrong clock", "i": 3}, *squares(4, timing=True)], time_limit=3.0)
    assert time.monotonic() - before < 30  # each would have taken a minute
    assert (tally(summary), summary.exit_code) == ((4, 0, 2), 1)
    assert {error for _, _, error in summary.failures} == {
        "TimeLimit: not done after 3 s, so its process was ended; --time-limit SECONDS allows more"
    }
    assert multiprocessing.active_children() == []
    for record in toy.store.latest(TOY):
        assert (3 <= record["seconds"] < 30) if record["status"] == "failed" else (0 <= record["seconds"] < 3)
    assert engine.TIME_LIMITS.keys() == set(engine.PROFILES)


def test_a_process_that_lost_its_parent_in_a_compiled_call_ends_itself(toy, monkeypatch):
    """No thread of Python runs in one: the watch is faulthandler's."""
    calls = []
    for name in ("dump_traceback_later", "cancel_dump_traceback_later"):
        monkeypatch.setattr(workers.faulthandler, name, lambda *a, name=name, **k: calls.append((name, a, k)))
    workers.compute(TOY, {"do": "raise", "i": 1}, limit=5.0)
    assert calls[0] == ("dump_traceback_later", (5.0 + workers.GRACE,), {"exit": True})
    assert [name for name, _, _ in calls[1:]] == ["cancel_dump_traceback_later"]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the limit does not hold")
def test_a_cell_that_takes_too_much_memory_fails_alone(toy, monkeypatch):
    monkeypatch.setenv(memory.VARIABLE, "0.5")
    summary = toy([{"do": "memory", "GB": 0.1, "i": 1}, {"do": "memory", "GB": 0.6, "i": 2}, *squares(3)])
    assert [(cell["i"], error) for _, cell, error in summary.failures] == [
        (2, "MemoryError: more than 0.5 GB; LAGRANGE_BENCH_MEMORY in the environment, in GB, allows more")
    ]
    monkeypatch.setenv(memory.VARIABLE, "0.9")
    assert toy([{"do": "memory", "GB": 0.6, "i": 2}]).failures == []


def test_a_method_that_is_not_available_is_skipped_and_said_once(toy, in_process):
    ghost = Method("ghost", "", "", 1, "", lambda: None, requires="no_such_package")
    engine._lacks.cache_clear()
    with registry.METHODS.lent(ghost):
        summary = toy(squares(1, 2, method="ghost") + squares(3))
    engine._lacks.cache_clear()
    assert (tally(summary), summary.tallies[TOY].unavailable, summary.exit_code) == ((1, 0, 0), 2, 0)
    assert str(summary).count("ghost needs no_such_package") == 1


# ---------------------------------------------------------------- runs that stop


def test_an_interrupt_while_cells_are_stored_waits_until_they_are_counted(toy, monkeypatch):
    real = Store.append

    def append(self, *records):
        real(self, *records)
        os.kill(os.getpid(), 2)
        time.sleep(0.01)

    monkeypatch.setattr(Store, "append", append)
    with pytest.raises(KeyboardInterrupt) as caught:
        toy(squares(1, 2, 3))
    stored = len(toy.store.latest(TOY))
    assert str(caught.value).startswith(f"interrupted: {stored} of 3 cells are stored in ")
    assert stored > 0
    assert multiprocessing.active_children() == []


NO_NAMES = {
    "drfit": "did you mean 'drift'",
    "no.such": r"unknown experiment 'no\.such'",
    "toys.__init__": "lacks VERSION, cells",
    "half.broken": "cannot be loaded: .*nonexistent_thing",
}


def test_a_module_that_is_no_experiment(toy, tmp_path, monkeypatch):
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "broken.py").write_text("import nonexistent_thing")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name, message in NO_NAMES.items():
        with pytest.raises(ValueError, match=message):
            engine.load(name)


def test_what_cannot_be_run_is_found_before_anything_is_computed(toy, monkeypatch, tmp_path):
    monkeypatch.setattr(workers, "compute_all", lambda *_: pytest.fail("computed"))
    for cells, options, message in (
        (squares(1, 1), {}, "twice"),
        (squares(1, status=0), {}, "'status'"),
        (squares(1), {"jobs": 0}, "jobs"),
        (squares(1), {"time_limit": 0.0}, "time_limit"),
        (squares(1), {"scheduler": "nowhere"}, "scheduler"),
    ):
        with pytest.raises(ValueError, match=message):
            toy(cells, **options)
    for text in ("0", "inf", "nan", "four"):
        monkeypatch.setenv(memory.VARIABLE, text)
        with pytest.raises(ValueError, match=f"LAGRANGE_BENCH_MEMORY must be a positive number of GB.*got '{text}'"):
            toy(squares(1))
    monkeypatch.delenv(memory.VARIABLE)
    (tmp_path / "taken").write_text("")
    with pytest.raises(StoreError, match="--results"):
        engine.run([TOY], "quick", tmp_path / "taken", show=False)


# ---------------------------------------------------------------- progress


def test_plain_progress_is_sparse(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with progress.follow({"drift": 300}) as bar:  # no terminal here
        for i in range(300):
            bar.begin("drift")
            now[0] += 0.5
            bar.advance("drift", failed=i == 100)
    lines = capsys.readouterr().err.splitlines()
    assert 10 <= len(lines) <= 16  # 150 s, one in 10 s
    assert (lines[0], lines[-1]) == ("drift: 20/300 cells", "drift: 300/300 cells, 1 failed")


def test_a_terminal_gets_bars(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "dumb")
    with progress.follow({"drift": 2}) as bar:
        assert bar.display is None
    monkeypatch.setenv("TERM", "xterm-256color")
    for show in (True, False):
        with progress.follow({"drift": 2, "phase": 1}, show=show) as bar:
            for name in ("drift", "drift", "phase"):
                bar.begin(name)
                bar.advance(name, failed=name == "phase")
        with progress.drawing(tmp_path, show=show) as drawn:
            drawn(1, 2)
        err = re.sub(r"\x1b\[[\d;?]*\w", "", capsys.readouterr().err)
        if show:
            assert re.search(r"drift .* 2/2 ", err)
            assert re.search(r"phase .* 1/1 +1 failed", err)
            assert re.search("drawing .* 1/2", err)
            assert err.endswith(f"drawn from {tmp_path}\n")
    assert err == ""
