"""The same rows on a Dask cluster as here, whatever happens to its workers. Real schedulers, real processes."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from faults import HERE, TOY, comparable, end, nobody_left, squares, start, wait_for_lines

from lagrange_bench.results import provenance
from lagrange_bench.results.store import Store
from lagrange_bench.runner import cluster
from lagrange_bench.runner.workers import Task

pytest.importorskip("distributed")
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for left-over processes in /proc")
pytestmark = [linux, pytest.mark.processes]


@pytest.fixture
def dask():
    """dask(*words) starts a scheduler or a worker, which is gone after the test."""
    processes = []

    def begin(*words):
        command = [sys.executable, "-m", "dask", *map(str, words)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
        environment = {**os.environ, "PYTHONPATH": str(HERE)}
        processes.append(subprocess.Popen(command, env=environment, cwd=HERE.parent, **quiet))
        return processes[-1]

    yield begin
    for process in reversed(processes):
        end(process)
    assert all(nobody_left(process.pid) for process in processes)


@pytest.mark.slow
def test_workers_and_a_scheduler_that_are_killed(dask, toy, tmp_path):
    """The other worker and a new one take over; without a scheduler the run stops, and goes on here. No cell is stored twice."""
    there, at = tmp_path / "there", ("--scheduler-file", tmp_path / "scheduler.json")
    scheduler = dask("scheduler", "--port", 0, "--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", *at)
    worker = ("worker", "--nthreads", 1, "--no-nanny", "--no-dashboard", "--local-directory", tmp_path / "scratch", *at)
    doomed = dask(*worker)
    dask(*worker)
    wait_for_lines(at[1], 1, scheduler)
    cells, path = squares(*range(60), seconds=0.1), there / f"{TOY}.jsonl"
    cells[3]["do"] = "die"
    run = start(cells, there, "--scheduler", json.loads(at[1].read_text())["address"])
    wait_for_lines(path, 5, run)
    doomed.kill()
    assert nobody_left(doomed.pid)  # also the process that computed for it
    dask(*worker)
    wait_for_lines(path, 30, run)
    scheduler.kill()
    _, err = run.communicate(timeout=120)
    assert run.returncode == 2, err
    assert "went away; what was finished is stored: run the same command again" in err
    assert start(cells, there).communicate(timeout=60)
    done = [record["key"] for record in Store(there).read(TOY)[0] if record["status"] == "done"]
    assert len(set(done)) == len(done) == 59
    toy(cells)
    assert comparable(there) == comparable(toy.store.folder)


def test_workers_with_other_versions_or_code_are_refused():
    """What a worker sends with its rows is compared, whenever it joined."""
    here, task = provenance.provenance(), Task("phase", 1, 0, {"part": "h", "method": "rk4"})
    other, files = {**here, "mpmath": "0.1"}, {"provenance": here, "sources": "0" * 24}
    for outcome, message in (({"provenance": other}, r"mpmath is 0\.1, here .*"), (files, "other files of .*phase")):
        future = SimpleNamespace(result=lambda outcome=outcome: outcome)
        with pytest.raises(cluster.ClusterError, match=message):
            cluster.Cluster("local:1", None)._outcome(future, task)


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
