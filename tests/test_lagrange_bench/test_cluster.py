"""The same rows on a Dask cluster as here, whatever happens to its workers. Real schedulers, real processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from faults import HERE, TOY, comparable, end, nobody_left, squares, start, wait_for_lines

from lagrange_bench.results.store import Store
from lagrange_bench.runner import cluster, engine

pytest.importorskip("distributed")
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
pytestmark = [linux, pytest.mark.processes, pytest.mark.slow]

ODD = [{"do": "raise", "i": 100}, {"do": "die", "i": 101}, {"do": "segfault", "i": 102}, {"do": "bad row", "i": 103}]


def dask(*words, cwd=HERE.parent, **variables):
    environment = {**os.environ, "PYTHONPATH": str(HERE), **variables}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    command = [sys.executable, "-m", "dask", *map(str, words)]
    return subprocess.Popen(command, env=environment, cwd=cwd, **quiet)


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler on a port of its own: its address in `address`, workers by `worker()`."""

    class Scheduler:
        file, processes = tmp_path / "scheduler.json", []

        def worker(self, **variables):
            words = ("--scheduler-file", self.file, "--nthreads", 1, "--no-nanny", "--no-dashboard")
            process = dask("worker", *words, "--local-directory", tmp_path / "scratch", **variables)
            self.processes.append(process)
            return process

    made = Scheduler()
    words = ("--port", 0, "--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", made.file)
    made.process = dask("scheduler", *words)
    made.processes.append(made.process)
    for _ in range(1500):
        if made.file.exists() and made.file.read_text().strip().endswith("}"):
            break
        time.sleep(0.02)
    made.address = json.loads(made.file.read_text())["address"]
    yield made
    for process in reversed(made.processes):
        end(process)
    for process in made.processes:
        assert nobody_left(process.pid)


def here(cells, folder, monkeypatch):
    """What this machine makes of the cells, without their pauses."""
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("TOY_PACE", "0")
    monkeypatch.setenv("TOY_CELLS", json.dumps(cells))
    engine.run([TOY], "quick", folder, 2, show=False)
    return comparable(folder)


def keys(folder):
    return [r["key"] for r in Store(folder).read(TOY)[0]]


def test_the_same_rows_from_a_local_cluster_of_as_many_workers_as_asked(tmp_path, monkeypatch):
    # first: later ones may come from a process in place of a dead one
    who = squares(*range(200, 212), facts=True, seconds=0.2)
    cells = [*who, *squares(*range(40)), *ODD, *squares(50, 51, timing=True)]
    hung = {"do": "compiled loop", "i": 104}  # only there, for it takes as long as it may
    run = start([*cells, hung], tmp_path / "there", "--scheduler", "local:3", "--time-limit", "5", "--json")
    out, err = run.communicate(timeout=120)
    assert (run.returncode, out[:1]) == (1, "{"), err
    summary = json.loads(out)
    tally = summary["experiments"][TOY]
    assert (tally["cells"], tally["computed"], tally["failed"]) == (59, 54, 5)
    assert any("timing cells ran one at a time on this machine" in note for note in summary["notes"])
    assert "Traceback" not in err
    assert nobody_left(run.pid)
    *there, last = comparable(tmp_path / "there")
    assert there[len(who) :] == here(cells, tmp_path / "here", monkeypatch)[len(who) :]
    assert len({record["rows"][0]["process"] for record in there[: len(who)]}) == 3
    assert (last["cell"], last["status"], last["error"]["type"]) == (hung, "failed", "TimeLimit")
    assert last["error"]["message"] == "not done after 5 s, so its process was ended; --time-limit SECONDS allows more"
    assert len(set(keys(tmp_path / "there"))) == len(keys(tmp_path / "there")) == 59


def test_a_worker_killed_in_the_middle(scheduler, tmp_path, monkeypatch):
    """Every cell is computed, none is twice in the store. The other worker and a new one take over."""
    doomed = scheduler.worker()
    scheduler.worker()
    cells = squares(*range(60), seconds=0.1)
    run = start(cells, tmp_path / "there", "--scheduler", scheduler.address)
    wait_for_lines(tmp_path / "there" / f"{TOY}.jsonl", 8, run)
    doomed.kill()
    before = len(keys(tmp_path / "there"))
    assert before < 60
    assert nobody_left(doomed.pid)  # also the process that computed for it
    scheduler.worker()
    out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err
    assert len(set(keys(tmp_path / "there"))) == len(keys(tmp_path / "there")) == 60
    assert comparable(tmp_path / "there") == here(cells, tmp_path / "here", monkeypatch)
    again = start(cells, tmp_path / "there", "--scheduler", scheduler.address, "--json")
    assert json.loads(again.communicate(timeout=60)[0])["experiments"][TOY]["stored"] == 60


def test_a_scheduler_that_goes_away(scheduler, tmp_path):
    scheduler.worker()
    cells = squares(*range(60), seconds=0.1)
    run = start(cells, tmp_path / "there", "--scheduler", scheduler.address)
    wait_for_lines(tmp_path / "there" / f"{TOY}.jsonl", 5, run)
    scheduler.process.kill()
    out, err = run.communicate(timeout=120)
    assert run.returncode == 2, err
    assert "went away; what was finished is stored: run the same command again" in err
    resumed = start(cells, tmp_path / "there")
    assert resumed.communicate(timeout=60)
    assert resumed.returncode == 0
    assert len(set(keys(tmp_path / "there"))) == len(keys(tmp_path / "there")) == 60


@pytest.mark.parametrize("whom", ["terminal", "parent"])
def test_interrupt(tmp_path, whom):
    cells = [*squares(*range(8)), {"do": "compiled loop", "i": 99}, {"do": "compiled loop", "i": 98}]
    run = start(cells, tmp_path, "--scheduler", "local:2")
    wait_for_lines(tmp_path / f"{TOY}.jsonl", 8, run)
    before = time.monotonic()
    os.killpg(run.pid, signal.SIGINT) if whom == "terminal" else run.send_signal(signal.SIGINT)
    err = run.communicate(timeout=60)[1]
    assert time.monotonic() - before < 20  # the cells would have taken a minute
    assert run.returncode == 130, err
    assert f"8 of 10 cells are stored in {tmp_path}" in err
    assert "Traceback" not in err
    assert nobody_left(run.pid)


def joins_late(scheduler, monkeypatch, **variables):
    """A run asks the workers at its start; this one is not there yet."""
    enter = cluster.Cluster.__enter__

    def join(self):
        entered = enter(self)
        scheduler.worker(**variables)
        return entered

    monkeypatch.setattr(cluster.Cluster, "__enter__", join)


def here_only(folder):
    return {"PYTHONPATH": ""}


def another_mpmath(folder):
    """A worker with another version would store its rows under this machine's."""
    info = folder / "mpmath-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mpmath\nVersion: 0.1\n")
    return {"PYTHONPATH": f"{folder}{os.pathsep}{HERE}"}


LACKING = r"a Dask worker lacks something: No module named .toys.; install the same"
OLDER = r"mpmath is 0\.1, here .*; install the same versions there and restart the workers"


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(("other", "message"), [(here_only, LACKING), (another_mpmath, OLDER)])
def test_workers_that_differ_are_refused(tmp_path, scheduler, monkeypatch, other, message, late):
    """Whether they are there before the run or not. What they lack is no result: nothing is stored."""
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("TOY_CELLS", json.dumps(squares(1, 2)))
    variables = other(tmp_path)
    if late:
        joins_late(scheduler, monkeypatch, **variables)
    else:
        scheduler.worker(**variables)
    with pytest.raises(cluster.ClusterError, match=message):
        engine.run([TOY], "quick", tmp_path, scheduler=scheduler.address, show=False)
    assert keys(tmp_path) == []


STUDY = """
from own import helper
VERSION = 1
def cells(profile): return [{"i": i} for i in range(3)]
def measure(cell): return [{"value": helper.VALUE}]
def draw(rows): return {}
def tables(rows): return {}
"""


@pytest.mark.parametrize("late", [False, True])
def test_rows_of_another_file_of_the_users_are_not_stored(tmp_path, scheduler, monkeypatch, late):
    """A worker imports what is in its own folder: the rows are set aside, and those of a worker with the same file stored."""
    for name in ("here", "there"):
        (tmp_path / name / "own").mkdir(parents=True)
        (tmp_path / name / "own" / "study_of_values.py").write_text(STUDY)
        (tmp_path / name / "own" / "helper.py").write_text(f"VALUE = '{name}'\n")
    monkeypatch.chdir(tmp_path / "here")
    other = {"cwd": tmp_path / "there", "PYTHONPATH": str(HERE.parent)}
    with monkeypatch.context() as patch:
        joins_late(scheduler, patch, **other) if late else scheduler.worker(**other)
        summary = engine.run(["own.study_of_values"], "quick", tmp_path, scheduler=scheduler.address, show=False)
    tally = summary.tallies["own.study_of_values"]
    assert (tally.computed, tally.set_aside, summary.exit_code) == (0, 3, 1)
    assert "set aside: own.study_of_values: 3 of the cells are not stored: a worker had other source code" in str(
        summary
    )
    summary = engine.run(["own.study_of_values"], "quick", tmp_path, scheduler="local:1", show=False)
    assert (summary.tallies["own.study_of_values"].computed, summary.exit_code) == (3, 0)
    assert set(Store(tmp_path).rows("own.study_of_values").value) == {"here"}


def test_nobody_there(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with (
        pytest.raises(
            cluster.ClusterError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1 .*dask scheduler"
        ),
        cluster.Cluster("tcp://127.0.0.1:1", None),
    ):
        pytest.fail("connected")


def test_without_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    cluster._distributed.cache_clear()
    with pytest.raises(ValueError, match=r"pip install 'lagrange-bench\[cluster\]'"), cluster.Cluster("local:2", None):
        pytest.fail("connected")
    cluster._distributed.cache_clear()


@pytest.mark.parametrize("address", ["local", "local:0", "local:x", "head:8786", "tcp://head", ""])
def test_addresses(address):
    with pytest.raises(ValueError, match="tcp://HOST:PORT or local:N"):
        cluster.check_address(address)
