"""The same rows on a Dask cluster as here, whatever happens to its workers. Real schedulers, real processes."""

import json
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from faults import HERE, TOY, comparable, end, nobody_left, squares, start, wait_for_lines

from lagrange_bench.results.store import Store
from lagrange_bench.runner import cluster

pytest.importorskip("distributed")
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
pytestmark = [linux, pytest.mark.processes]


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler on a port of its own: its address in `address`, workers by `worker()`."""
    file, processes = tmp_path / "scheduler.json", []

    def dask(*words, **variables):
        environment = {**os.environ, "PYTHONPATH": str(HERE), **variables}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        command = [sys.executable, "-m", "dask", *map(str, words), "--scheduler-file", str(file)]
        processes.append(subprocess.Popen(command, env=environment, cwd=HERE.parent, **quiet))
        return processes[-1]

    def worker(**variables):
        words = ("--nthreads", 1, "--no-nanny", "--no-dashboard", "--local-directory", tmp_path / "scratch")
        return dask("worker", *words, **variables)

    first = dask("scheduler", "--port", 0, "--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0")
    for _ in range(1500):
        if file.exists() and file.read_text().strip().endswith("}"):
            break
        time.sleep(0.02)
    yield SimpleNamespace(process=first, address=json.loads(file.read_text())["address"], worker=worker)
    for process in reversed(processes):
        end(process)
    assert all(nobody_left(process.pid) for process in processes)


def keys(folder):
    return [r["key"] for r in Store(folder).read(TOY)[0]]


@pytest.mark.slow
def test_the_same_rows_from_a_local_cluster_of_as_many_workers_as_asked(toy, tmp_path):
    who = squares(*range(200, 209), facts=True, seconds=0.3)
    odd = [{"do": what, "i": 100 + i} for i, what in enumerate(("raise", "die", "segfault", "bad row"))]
    cells = [*who, *squares(*range(20)), *odd, *squares(50, 51, timing=True)]
    hung = {"do": "compiled loop", "i": 104}  # only there, for it takes as long as it may
    run = start([*cells, hung], tmp_path / "there", "--scheduler", "local:3", "--time-limit", "20", "--json")
    out, err = run.communicate(timeout=120)
    assert (run.returncode, out[:1], "Traceback" in err) == (1, "{", False), err
    summary = json.loads(out)
    tally = summary["experiments"][TOY]
    assert (tally["cells"], tally["computed"], tally["failed"]) == (36, 31, 5)
    assert any("timing cells ran one at a time on this machine" in note for note in summary["notes"])
    assert nobody_left(run.pid)
    *there, last = comparable(tmp_path / "there")
    toy(cells)
    assert there[len(who) :] == comparable(toy.store.folder)[len(who) :]
    assert len({record["rows"][0]["process"] for record in there[: len(who)]}) == 3
    assert (last["cell"], last["status"], last["error"]["type"]) == (hung, "failed", "TimeLimit")
    assert len(set(keys(tmp_path / "there"))) == len(keys(tmp_path / "there")) == 36


@pytest.mark.slow
def test_workers_and_a_scheduler_that_are_killed(scheduler, toy, tmp_path):
    """The other worker and a new one take over; without a scheduler the run stops, and goes on here. No cell is stored twice."""
    doomed = scheduler.worker()
    scheduler.worker()
    cells, path = squares(*range(60), seconds=0.1), tmp_path / "there" / f"{TOY}.jsonl"
    run = start(cells, tmp_path / "there", "--scheduler", scheduler.address)
    wait_for_lines(path, 5, run)
    doomed.kill()
    assert nobody_left(doomed.pid)  # also the process that computed for it
    scheduler.worker()
    wait_for_lines(path, 30, run)
    scheduler.process.kill()
    out, err = run.communicate(timeout=120)
    assert run.returncode == 2, err
    assert "went away; what was finished is stored: run the same command again" in err
    assert start(cells, tmp_path / "there").communicate(timeout=60)
    assert len(set(keys(tmp_path / "there"))) == len(keys(tmp_path / "there")) == 60
    toy(cells)
    assert comparable(tmp_path / "there") == comparable(toy.store.folder)


def test_workers_with_other_versions_or_code_are_refused(monkeypatch):
    """What a worker sends with its rows is compared, whenever it joined."""
    here = cluster.versions()
    for name in ("mpmath", "the code of lagrange-bench"):
        future = SimpleNamespace(result=lambda name=name: ({**here, name: "0.1"}, {"status": "done"}))
        message = rf"{name} is 0\.1, here .*; install the same versions there and restart the workers"
        with pytest.raises(cluster.ClusterError, match=message):
            cluster.Cluster("local:1", None)._outcome(future)


def test_a_cluster_that_is_not_there(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    message = r"no Dask scheduler answers at tcp://127\.0\.0\.1:1 .*dask scheduler"
    with pytest.raises(cluster.ClusterError, match=message), cluster.Cluster("tcp://127.0.0.1:1", None):
        pytest.fail("connected")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"pip install '\.\[cluster\]'"), cluster.Cluster("local:2", None):
        pytest.fail("connected")
    for address in ("local:0", "head:8786", "tcp://head"):
        with pytest.raises(ValueError, match="tcp://HOST:PORT or local:N"):
            cluster.Cluster(address, None)
