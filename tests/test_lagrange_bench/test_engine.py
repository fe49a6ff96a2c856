"""A run computes what is missing, survives what cells do to it, and stops before it does harm."""

import json
import re
import signal
import sys
import threading
import time

import pytest
from faults import TOY, nobody_left, squares, start

from lagrange_bench.integrators import registry
from lagrange_bench.integrators.interface import Method
from lagrange_bench.results.store import Store
from lagrange_bench.runner import engine, progress

pytestmark = [pytest.mark.processes, pytest.mark.xdist_group("engine")]


def tally(summary):
    """(computed, stored, failed)"""
    found = summary.experiments[TOY]
    return found.computed, found.stored, found.failed


def test_only_what_is_missing(toy, in_process, monkeypatch):
    first = toy(squares(1, 2, 3))
    assert (tally(first), first.exit_code) == ((3, 0, 0), 0)
    again = toy(squares(3, 4, 1))
    assert (tally(again), again.old) == ((1, 2, 0), False)
    toy.store.append(*({**record, "sources": "0" * 24} for record in toy.store.open(TOY).latest))
    assert f"old: {TOY}: 2 of 2 stored cells computed with other source code" in str(toy(squares(1, 3)))
    table = toy.store.rows(TOY)
    assert sorted(zip(table["i"], table["square"], strict=True)) == [(i, i * i) for i in (1, 2, 3, 4)]
    summary = toy(squares(5, 6, timing=True), timings=False)
    assert (tally(summary), summary.experiments[TOY].unavailable, summary.exit_code) == ((0, 0, 0), 2, 0)
    assert summary.notes == ["skipped: the timing cells of toys.behaviour, as asked"]
    monkeypatch.setattr(engine.load(TOY), "VERSION", 2)
    assert tally(toy(squares(1))) == (1, 0, 0)
    assert toy.store.rows(TOY)["i"].tolist() == [1]


ERRORS = {
    "segfault": "WorkerDied: the worker process was killed by SIGSEGV",
    "die": "WorkerDied: the worker process ended itself with exit code 3",
    "compiled loop": "TimeLimit: not done after 15 s, so its process was ended; --time-limit SECONDS allows more",
    "raise": "ArithmeticError: cell 104 was told to",
    "bad row": "TypeError: cannot store",
    "exit": "SystemExit: 3",
    "long text": f"ValueError: {'x' * 1999}…",
}


def test_cells_that_die_hang_or_chatter_fail_alone_and_timing_cells_come_last(tmp_path):
    """Two workers; the timing cells come alone, in order, in a fresh process with one thread."""
    facts = {"facts": True, "seconds": 0.05}
    waiting = {"do": "wait for lines", "i": 5, "file": str(tmp_path / f"{TOY}.jsonl"), "lines": 4}  # finishes late
    odd = "segfault", "compiled loop", "wrong clock", "warn", "raise", "bad row", "exit", "long text"
    odd = [{"do": what, "i": 100 + i} for i, what in enumerate(odd)]
    timing = [{"do": "die", "i": 120, "timing": True}, *squares(9, 8, timing=True, **facts)]
    cells = [waiting, *squares(4, 3, 2, 1, **facts), *odd, *timing]
    run = start(cells, tmp_path, "--json", "--time-limit", "15", OMP_NUM_THREADS="7")
    out, err = run.communicate(timeout=300)  # the loop would take ten minutes
    assert nobody_left(run.pid)
    assert ("chatter" in err, "toy warning" in err, "Traceback" in err) == (True, False, False)
    summary, store = json.loads(out), Store(tmp_path)
    assert (summary["exit_code"], summary["experiments"][TOY]["computed"]) == (1, 9)
    errors = {failure["cell"]["do"]: failure["error"] for failure in summary["failures"]}
    assert {what: error[: len(ERRORS[what])] for what, error in errors.items()} == ERRORS
    assert store.path(TOY).stat().st_size < 50_000
    latest = store.open(TOY).latest
    assert [r["warnings"] for r in latest if r["cell"]["do"] == "warn"] == [["RuntimeWarning: toy warning"]]
    assert all(0 <= record["seconds"] < 30 for record in latest)
    table = store.rows(TOY)
    assert table["i"].tolist() == [5, 4, 3, 2, 1, *range(100, 108), 120, 9, 8]
    assert len(store.read(TOY)[0]) == len(table), "none is computed twice and stored twice"
    table = table[table["facts"].eq(True)]
    timing, accuracy = table[table["timing"].eq(True)], table[table["timing"].isna()]
    assert timing["started"].min() >= accuracy["started"].max()  # "started" is read when the work is done
    assert timing["started"].is_monotonic_increasing
    assert (timing["process"].nunique(), timing["process"].isin(accuracy["process"]).any()) == (1, False)
    assert set(table["threads"]) == {"1"}


def test_a_failing_cell_is_a_result_and_is_tried_again(toy, in_process, run, tmp_path):
    cells = [{"do": "fail until there", "i": 0, "file": str(tmp_path / "there")}, *squares(7, 8)]
    first = toy(cells)
    assert (tally(first), first.exit_code) == ((2, 0, 1), 1)
    assert "raise FileNotFoundError" in toy.store.open(TOY).latest[0]["error"]["traceback"]
    code, out, err = run("report", "--results", toy.store.folder, "--module", TOY, "--quiet")
    assert (code, out) == (0, f"{toy.store.folder / 'page' / 'index.html'}\n"), err
    (tmp_path / "there").write_text("")
    assert tally(toy(cells)) == (1, 2, 0)


def test_a_method_that_is_not_available_is_skipped_and_said_once(toy, in_process):
    ghost = Method("ghost", "", "", 1, "", lambda: None, requires="no_such_package")
    with registry.METHODS.temporarily_registered(ghost):
        summary = toy(squares(1, 2, method="ghost") + squares(3))
    assert (tally(summary), summary.experiments[TOY].unavailable, summary.exit_code) == ((1, 0, 0), 2, 0)
    assert str(summary).count("ghost needs no_such_package") == 1


def test_an_interrupt_while_cells_are_stored_waits_until_they_are_counted(toy, in_process, monkeypatch):
    """Whichever thread catches it: those of libraries do not block it, and Python acts on it in the main one."""
    real, ended = Store.append, threading.Event()
    thread = threading.Thread(target=ended.wait, daemon=True)
    thread.start()

    def append(self, *records):
        real(self, *records)
        signal.pthread_kill(thread.ident, signal.SIGINT)
        time.sleep(0.05)

    monkeypatch.setattr(Store, "append", append)
    with pytest.raises(KeyboardInterrupt) as caught:
        toy(squares(1, 2, 3))
    ended.set()
    stored = len(toy.store.open(TOY).latest)
    assert str(caught.value).startswith(f"interrupted: {stored} of 3 cells are stored in ")
    assert stored > 0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("cells", "message"), [(squares(1, 1), "twice"), (squares(1, status=0), "'status'")])
def test_what_cannot_be_run_is_found_before_anything_is_computed(toy, cells, message):
    with pytest.raises(ValueError, match=message):
        toy(cells)
    assert not toy.store.path(TOY).exists()


def test_progress_is_sparse(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])

    def shown(show=True):
        with progress.follow({"drift": 300}, show=show) as bar:
            for i in range(300):
                bar.begin("drift")
                now[0] += 0.5
                bar.advance("drift", failed=i == 100)
        return capsys.readouterr().err

    begin, *lines = shown().splitlines()
    assert begin.startswith("drift: 300 cells; the first ones")
    assert 10 <= len(lines) <= 17  # 150 s, one in 10 s
    assert (lines[2], lines[-1]) == ("drift: 60/300 cells", "drift: 300/300 cells, 1 failed")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    assert re.search("drift .* 300/300 .*1 failed", re.sub(r"\x1b\[[\d;?]*\w", "", shown()), re.DOTALL)
    assert "drift" not in shown(False)
