"""A run computes what is missing, survives what cells do to it, and can be stopped at any moment."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
import time

import pytest
from faults import HERE, TOY, comparable, nobody_left, session, squares, start, wait_for_lines
from rich.console import Console

from lagrange_bench.integrators import interrupts, registry
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
    return summary.tallies[TOY]


# ---------------------------------------------------------------- what is computed


def test_only_what_is_missing(toy, monkeypatch):
    first = toy(squares(1, 2, 3))
    assert (tally(first).computed, tally(first).stored, first.exit_code) == (3, 0, 0)
    second = toy(squares(3, 4, 1))
    assert (tally(second).computed, tally(second).stored) == (1, 2)
    table = toy.store.rows(TOY)
    assert sorted(table["i"]) == [1, 2, 3, 4]
    assert table["square"].tolist() == [i * i for i in table["i"]]
    assert set(table["status"]) == {"done"}
    monkeypatch.setattr(engine.load(TOY), "VERSION", 2)
    assert tally(toy(squares(1))).computed == 1
    assert toy.store.rows(TOY)["i"].tolist() == [1]


def test_what_is_as_it_was_is_shown_again_and_not_computed(toy, monkeypatch):
    toy(squares(1, 2))
    first = [record["key"] for record in toy.store.latest(TOY)]
    with monkeypatch.context() as changed:
        changed.setattr("lagrange_bench.results.store._packages", lambda: {"numpy": "99"})
        assert tally(toy(squares(1, 2))).computed == 2
        assert [record["key"] for record in toy.store.latest(TOY)] != first
    again = tally(toy(squares(1, 2)))
    assert (again.computed, again.stored) == (0, 2)
    assert [record["key"] for record in toy.store.latest(TOY)] == first


def test_rows_come_in_the_order_of_the_cells(toy):
    journal = str(toy.store.path(TOY))
    first = {"do": "wait for lines", "i": 5, "file": journal, "lines": 4}  # and finishes last
    toy([first, *squares(4, 3, 2, 1)])
    assert toy.store.rows(TOY)["i"].tolist() == [5, 4, 3, 2, 1]
    assert [r["cell"]["i"] for r in toy.store.read(TOY)[0]][-1] == 5


def test_timing_cells_come_last_alone_and_in_order(toy):
    cells = squares(9, 8, timing=True, facts=True, seconds=0.05) + squares(1, 2, 3, facts=True, seconds=0.1)
    assert tally(toy(cells)).computed == len(toy.store.read(TOY)[0]) == 5
    table = toy.store.rows(TOY)
    timing, accuracy = table[table["timing"] == True], table[table["timing"].isna()]  # noqa: E712
    assert timing["started"].min() >= accuracy["started"].max()  # "started" is read when the work is done
    assert timing["started"].is_monotonic_increasing
    assert timing["i"].tolist() == [9, 8]
    assert timing["process"].nunique() == 1
    assert accuracy["process"].nunique() == 2
    assert not set(timing["process"]) & set(accuracy["process"])  # fresh


def test_workers_use_one_thread_and_leave_the_parent_alone(toy, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    toy(squares(1, facts=True))
    assert toy.store.rows(TOY)["threads"].tolist() == ["1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_warnings_and_chatter_are_kept_out_of_the_way(toy, capfd):
    assert toy([{"do": "warn", "i": 1}]).exit_code == 0
    streams = capfd.readouterr()
    assert streams.out == ""  # stdout is for data
    assert "chatter" in streams.err
    assert "toy warning" not in streams.err
    assert toy.store.read(TOY)[0][0]["warnings"] == ["RuntimeWarning: toy warning"]


def test_timings_can_be_left_out(toy):
    summary = toy(squares(1) + squares(2, 3, timing=True), timings=False)
    assert (tally(summary).computed, tally(summary).unavailable, summary.exit_code) == (1, 2, 0)
    assert summary.notes == ["skipped: the timing cells of toys.behaviour, as asked"]
    assert tally(toy(squares(1) + squares(2, 3, timing=True))).computed == 2


def test_cells_are_not_held_in_memory(toy, monkeypatch):
    """However many cells there are, few exist at a time: the list is a generator, read as cells are finished."""
    alive, most = set(), [0]

    class Cell(dict):
        def __del__(self):
            alive.discard(id(self))

    def cells(profile):
        for i in range(300):
            cell = Cell(do="square", i=i)
            alive.add(id(cell))
            most[0] = max(most[0], len(alive))
            yield cell
            del cell

    monkeypatch.setattr(engine.load(TOY), "cells", cells)
    assert tally(toy([])).computed == 300
    assert most[0] < 10


# ---------------------------------------------------------------- cells that fail


def test_a_failing_cell_is_a_result(toy, tmp_path):
    file = tmp_path / "there"
    cells = [{"do": "raise", "i": 1}, {"do": "fail until there", "i": 2, "file": str(file)}, {"do": "bad row", "i": 3}]
    cells += [{"do": "exit", "i": 4}, *squares(5, 6)]
    first = toy(cells)
    assert first.exit_code == 1
    assert (tally(first).computed, tally(first).failed) == (2, 4)
    errors = {cell["do"]: error for _, cell, error in first.failures}
    assert errors["raise"] == "ArithmeticError: cell 1 was told to"
    assert errors["bad row"].startswith("TypeError: cannot store")
    assert errors["exit"] == "SystemExit: 3"
    assert "raise ArithmeticError" in toy.store.open(TOY).failures()["error_traceback"][0]
    assert "ArithmeticError" in str(first)
    file.write_text("")
    second = toy(cells)  # failures are tried again, successes are not
    assert (tally(second).computed, tally(second).failed, tally(second).stored) == (1, 3, 2)
    assert toy.store.rows(TOY)["status"].tolist() == ["failed", "done", "failed", "failed", "done", "done"]


def test_whatever_a_plug_in_raises_is_a_text_of_bounded_length(toy, run, tmp_path):
    """And can be printed, stored and put on a page."""
    said = {
        "no text": "NoText: (no text: its __str__ raises RuntimeError)",
        "surrogate": "ValueError: no such \\udcff file",
        "long text": f"ValueError: {'x' * 2000}… (10000000 characters)",
    }
    summary = toy([{"do": what, "i": i} for i, what in enumerate(said)])
    assert {cell["do"]: error for _, cell, error in summary.failures} == said
    str(summary).encode()
    assert toy.store.path(TOY).stat().st_size < 50_000
    code, out, err = run("report", "--results", tmp_path, "--module", TOY, "--quiet")
    assert (code, out) == (0, f"{tmp_path / 'page' / 'index.html'}\n"), err


def test_a_thread_of_a_plug_in_keeps_no_process(tmp_path, monkeypatch):
    """Neither a worker nor the command, both of which import it."""
    monkeypatch.setenv("TOY_THREAD", "1")
    before = time.monotonic()
    run = start(squares(1, 2), tmp_path, "--time-limit", "20", jobs=1)
    assert run.communicate(timeout=60)
    assert (run.returncode, time.monotonic() - before < 40) == (0, True)  # the thread would live for a minute
    assert nobody_left(run.pid)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_cell_that_kills_its_process_is_found(toy, jobs):
    deadly = [{"do": "die", "i": 100}, {"do": "segfault", "i": 101}]
    cells = [*squares(1, 2, seconds=0.1), deadly[0], *squares(3, 4, seconds=0.1), deadly[1], *squares(5, 6)]
    summary = toy(cells, jobs)
    assert tally(summary).computed == 6
    assert {(cell["i"], error) for _, cell, error in summary.failures} == {
        (100, "WorkerDied: the worker process ended itself with exit code 3"),
        (101, "WorkerDied: the worker process was killed by SIGSEGV"),
    }
    assert summary.exit_code == 1
    assert multiprocessing.active_children() == []


def test_a_timing_cell_that_dies_does_not_stop_the_others(toy):
    cells = [{"do": "die", "i": 1, "timing": True}, *squares(2, 3, timing=True)]
    found = tally(toy(cells))
    assert (found.computed, found.failed) == (2, 1)


def test_a_method_that_is_not_available_is_skipped_and_said_once(toy):
    ghost = Method("ghost", "", "", 1, False, False, frozenset(), "step", "", lambda: None, requires="no_such_package")

    engine._lacks.cache_clear()
    with registry.METHODS.lent(ghost):
        summary = toy(squares(1, 2, method="ghost") + squares(3))
    engine._lacks.cache_clear()
    assert (tally(summary).unavailable, tally(summary).computed, summary.exit_code) == (2, 1, 0)
    assert str(summary).count("ghost needs no_such_package") == 1


def test_a_method_nobody_knows_is_a_failure(toy):
    (failure,) = toy(squares(1, method="nonsense")).failures
    assert "unknown method 'nonsense'" in failure[2]


# ---------------------------------------------------------------- stopped runs


@pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
@pytest.mark.parametrize("whom", ["terminal", "parent"])
def test_interrupt(tmp_path, whom):
    """Ctrl-C of a terminal reaches every process of the group; `kill -INT` only the one that is named."""
    hanging = {"do": "compiled loop", "i": 99}
    run = start([*squares(1, 2, 3), hanging, *squares(4, 5, 6)], tmp_path, jobs=2)
    wait_for_lines(tmp_path / f"{TOY}.jsonl", 6)
    before = time.monotonic()
    if whom == "terminal":
        os.killpg(run.pid, signal.SIGINT)
    else:
        run.send_signal(signal.SIGINT)
    message = run.communicate(timeout=60)[1]
    assert time.monotonic() - before < 30  # the cell would have taken a minute
    assert run.returncode == 130
    assert f"6 of 7 cells are stored in {tmp_path}" in message
    assert "again to resume" in message
    assert "Traceback" not in message
    assert nobody_left(run.pid)
    assert len(comparable(tmp_path)) == 6
    resumed = start([*squares(1, 2, 3), *squares(4, 5, 6, 7)], tmp_path)
    assert "1/1 cells" in resumed.communicate(timeout=60)[1]
    assert resumed.returncode == 0
    assert len(Store(tmp_path).read(TOY)[0]) == 7  # nothing twice


@pytest.mark.skipif(sys.platform != "linux", reason="looks for worker processes in /proc")
def test_interrupt_while_workers_start(tmp_path):
    for attempt in range(5):
        run = start(squares(*range(50), seconds=0.1), tmp_path / str(attempt))
        while len(session(run.pid)) < 2:
            assert run.poll() is None
            time.sleep(0.001)
        time.sleep(0.012 * attempt)
        os.killpg(run.pid, signal.SIGINT)
        message = run.communicate(timeout=60)[1]
        assert run.returncode == 130, message
        assert "of 50 cells are stored" in message
        assert "Traceback" not in message
        assert nobody_left(run.pid)


def test_interrupt_while_a_thread_starts(toy, monkeypatch):
    """The pool waits for a thread that it knows. One that it was interrupted in starting would go on building a process."""
    start, build, unfinished = threading.Thread.start, workers._executor, threading.Event()

    def interrupted_start(thread):
        start(thread)
        if thread.name.startswith("ThreadPoolExecutor"):
            signal.raise_signal(signal.SIGINT)

    def slow_build():
        unfinished.set()
        time.sleep(0.3)
        unfinished.clear()
        return build()

    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    monkeypatch.setattr(workers, "_executor", slow_build)
    with pytest.raises(KeyboardInterrupt, match=r"interrupted: 0 of 3 cells are stored in .*again to resume"):
        toy(squares(1, 2, 3))
    assert not unfinished.is_set()
    assert [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPoolExecutor")] == []
    assert multiprocessing.active_children() == []


def test_interrupt_is_held_back_whichever_thread_catches_it():
    """Libraries have threads that do not block the signal; Python acts on it in the main thread all the same."""
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    reached = False
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        with interrupts.interrupt_held_back():
            signal.pthread_kill(thread.ident, signal.SIGINT)
            time.sleep(0.05)
            reached = True
        pytest.fail("the interrupt was lost")
    ended.set()
    thread.join()
    assert reached
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_disk_that_fills_up_stops_the_run_and_loses_nothing(toy, monkeypatch):
    real, calls = Store.append, []

    def append(self, *records):
        calls.append(records)
        if len(calls) > 2:
            raise StoreError("full")
        real(self, *records)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "append", append)
        before = time.monotonic()
        with pytest.raises(StoreError, match="full"):
            toy([*squares(1, 2, 3), {"do": "compiled loop", "i": 9}, *squares(4, 5, 6)])
        assert time.monotonic() - before < 30  # the cell would have taken a minute
    assert multiprocessing.active_children() == []
    confirmed = sum(map(len, calls[:2]))
    assert len(toy.store.latest(TOY)) == confirmed < 6
    assert tally(toy(squares(1, 2, 3, 4, 5, 6))).computed == 6 - confirmed


def test_a_folder_that_cannot_be_written_is_found_first(toy, monkeypatch, tmp_path):
    (tmp_path / "taken").write_text("")
    monkeypatch.setenv("TOY_CELLS", json.dumps(squares(1)))
    monkeypatch.setattr(workers, "compute_all", lambda *_: pytest.fail("computed"))
    with pytest.raises(StoreError, match="--results"):
        engine.run([TOY], "quick", tmp_path / "taken", show=False)


# ---------------------------------------------------------------- the protocol


def test_names(toy, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="did you mean 'drift'"):
        engine.load("drfit")
    with pytest.raises(ValueError, match=r"unknown experiment 'no\.such'"):
        engine.load("no.such")
    with pytest.raises(ValueError, match="lacks VERSION, cells"):
        engine.load("toys.__init__")
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "broken.py").write_text("import nonexistent_thing")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ValueError, match=r"^experiment 'half\.broken' cannot be loaded: .*nonexistent_thing"):
        engine.load("half.broken")
    with pytest.raises(ValueError, match="profile"):
        engine.run([TOY], "fast", tmp_path)
    for wrong in ({"jobs": 0}, {"time_limit": 0.0}, {"scheduler": "nowhere"}):
        monkeypatch.setenv("TOY_CELLS", json.dumps(squares(1)))
        with pytest.raises(ValueError, match=next(iter(wrong))):
            engine.run([TOY], "quick", tmp_path, **wrong)


@pytest.mark.parametrize(("cells", "match"), [(squares(1, 1), "twice"), (squares(1, status=0), "'status'")])
def test_cells_that_cannot_be_told_apart(toy, cells, match):
    with pytest.raises(ValueError, match=match):
        toy(cells)


def test_run_draws_if_asked(toy, tmp_path, monkeypatch, run):
    written = []

    def write_experiment(experiment, results, output, choice):
        written.append((experiment, results, output))
        return [output / "figure.svg"]

    monkeypatch.setattr("lagrange_bench.report.sections.write_experiment", write_experiment)
    monkeypatch.setenv("TOY_CELLS", json.dumps([*squares(1), {"do": "raise", "i": 2}]))
    words = ["run", TOY, "--results", tmp_path, "--jobs", 1]
    code, out, _ = run(*words, "--json")
    summary = json.loads(out)  # and nothing else on stdout
    assert (code, written) == (1, [])
    assert summary["experiments"][TOY]["computed"] == 1
    assert summary["failures"][0]["error"].startswith("ArithmeticError")
    code, out, _ = run(*words, "--draw")
    assert written == [(TOY, tmp_path, tmp_path / "page")]
    assert "drawn: " in out
    assert "figure.svg" in out
    assert run("run", TOY, "--jobs", 0)[0] == 2


def test_the_engine_is_light_to_import():
    """The command line shows its help without the scientific stack."""
    heavy = "{'numpy', 'scipy', 'pandas', 'matplotlib', 'numba', 'heyoka', 'rich'} & set(sys.modules)"
    code = f"import sys, lagrange_bench.runner.engine; assert not {heavy}, {heavy}"
    subprocess.run([sys.executable, "-c", code], check=True)


# ---------------------------------------------------------------- progress


def test_plain_progress_is_sparse_and_estimates(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with progress.follow({"drift": 300}) as bar:
        assert isinstance(bar, progress.Lines)  # no terminal here
        for i in range(300):
            bar.begin("drift")
            now[0] += 0.5
            bar.advance("drift", failed=i == 100)
    lines = capsys.readouterr().err.splitlines()
    assert 10 <= len(lines) <= 16  # 150 s, one in 10 s
    assert lines[0] == "drift: 20/300 cells", "the first ones compile: no estimate yet"
    assert lines[2] == "drift: 60/300 cells, about 2 min left"
    assert lines[-1] == "drift: 300/300 cells, 1 failed, 2 min"
    with progress.follow({"cost": 9}) as bar:
        bar.begin("cost")
        now[0] += 60  # the first cell compiles: no nine minutes are announced
        bar.advance("cost", failed=False)
    assert capsys.readouterr().err == "cost: 1/9 cells\n"


def test_a_terminal_gets_a_live_table(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress.follow({"drift": 2, "phase": 1}) as bar:
        assert isinstance(bar, progress.Live)
        for name in ("drift", "drift", "phase"):
            bar.begin(name)
            bar.advance(name, failed=name == "phase")
    err = capsys.readouterr().err
    assert "2/2" in err
    assert re.search(r"phase .* 1/1 +1 ", re.sub(r"\x1b\[[\d;?]*\w", "", err))  # one failed, none is running
    with progress.follow({"drift": 1}, show=False) as bar:
        bar.begin("drift")
        bar.advance("drift", failed=False)
    assert capsys.readouterr().err == ""


def test_a_terminal_is_told_that_the_first_cell_compiles(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    bar = progress.Live({"drift": 9}, Console())
    bar.begin("drift")
    now[0] = progress.SOON
    assert bar._time("drift") == "3.0 s"
    now[0] += 1
    assert bar._time("drift") == "compiling"
    bar.advance("drift", failed=False)
    assert bar._time("drift") == "4.0 s"


@pytest.mark.parametrize(
    ("done", "total", "elapsed", "left"),
    [
        (5, 873, 28, None),  # nonsense: 28 s of compilation a cell
        (87, 873, 40, None),  # less than a tenth
        (88, 873, 40, 40 / 88 * 785),
        (88, 873, 29, None),  # too soon
        (4, 9, 60, None),
        (5, 9, 60, 48.0),
        (50, 5000, 299, None),
        (50, 5000, 300, 29700.0),  # of a long run less than a tenth must do
    ],
)
def test_no_estimate_before_it_says_something(done, total, elapsed, left):
    assert progress.remaining(done, total, elapsed) == (None if left is None else pytest.approx(left))


def test_what_was_drawn_from_is_said_and_a_terminal_gets_a_bar(monkeypatch, capsys, tmp_path):
    with progress.drawing(tmp_path) as drawn:
        drawn(1, 2)
    assert capsys.readouterr().err == f"drawn from {tmp_path}\n"
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress.drawing(tmp_path) as drawn:
        drawn(1, 2)
    err = capsys.readouterr().err
    assert "1/2" in err
    assert err.endswith(f"drawn from {tmp_path}\n")
    with progress.drawing(tmp_path, show=False) as drawn:
        drawn(1, 2)
    assert capsys.readouterr().err == ""


def test_durations():
    said = [progress.duration(s) for s in (0.04, 9.94, 9.96, 59, 61, 3600 * 2 + 300)]
    assert said == ["0.0 s", "9.9 s", "10 s", "59 s", "1 min", "2 h 05 min"]
