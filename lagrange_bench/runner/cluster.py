"""Runs cells on a Dask cluster. Needs the extra `cluster` (dask.distributed).

A Dask worker has a `workers.Worker`, as `workers.Local` has here, so a cell that hangs or crashes fails alone. Dask finds
another worker if one is lost. Only the process that asks for the cells writes the store.
"""

import importlib.util
import logging
import multiprocessing
import sys
import threading
from concurrent.futures import CancelledError, Future
from functools import cache
from typing import Any, Self

from lagrange_bench.results import provenance, sources
from lagrange_bench.runner.workers import DIED, Outcome, Task, Worker, failure
from lagrange_bench.support import interrupts
from lagrange_bench.support.words import scheduler

CONNECT = 30.0  # s to wait for the scheduler


class ClusterError(RuntimeError):
    """The cluster cannot be used, or not any more. The message says what to do. Finished cells are stored."""


class Cluster:
    """A `workers.Executor`: hands cells to the workers of a Dask scheduler."""

    ahead = 500  # for Dask to spread

    def __init__(self, address: str, limit: float):
        self._address, self._limit = scheduler(address), limit
        self._started: list[Any] = []

    def __enter__(self) -> Self:
        try:
            import dask
            import distributed
        except ImportError as error:
            reason = f"dask.distributed cannot be imported here ({error})"
            raise ValueError(f"--scheduler: {reason}; in the clone: pip install '.[cluster]'") from error
        try:
            with interrupts.interrupt_held_back():  # processes started in here never see Ctrl-C
                address: Any = self._address
                if address.startswith("local:"):
                    count = int(address.removeprefix("local:"))
                    quiet = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
                    # so no cell waits behind another
                    with dask.config.set({"distributed.scheduler.worker-saturation": 1.0}):
                        address = distributed.LocalCluster(n_workers=count, threads_per_worker=1, **quiet)
                        self._started.append(address)
                self._client = distributed.Client(address, timeout=CONNECT)
                self._started.append(self._client)
            found = self._client.run(versions)
            for theirs in found.values():
                _compare(theirs)
        except BaseException as error:
            self.__exit__()
            if isinstance(error, OSError):
                start = "`dask scheduler` and `dask worker ADDRESS` start them; local:N needs neither"
                reason = f"no Dask scheduler answers at {self._address} ({error or 'no connection'})"
                raise ClusterError(f"{reason}; {start}") from error
            if isinstance(error, ImportError):
                advice = "install the same lagrange-bench where the workers run"
                raise ClusterError(f"a Dask worker cannot import a module: {error}; {advice}") from error
            raise
        if not found:
            print(f"waiting: no Dask worker is connected to {self._address}", file=sys.stderr, flush=True)
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            for started in reversed(self._started):
                started.close()

    def submit(self, task: Task) -> Future[Outcome]:
        answer: Future[Outcome] = Future()

        def resolve(future: Any) -> None:
            try:
                answer.set_result(self._outcome(future, task))
            except BaseException as error:
                answer.set_exception(error)

        self._client.submit(compute, task, self._limit, pure=False).add_done_callback(resolve)
        return answer

    def _outcome(self, future: Any, task: Task) -> Outcome:
        from distributed.scheduler import KilledWorker

        try:
            theirs, outcome = future.result()
        except KilledWorker as error:
            lost = f"{error.allowed_failures + 1} Dask workers died one after another while they had this cell"
            return failure(DIED, lost, "", 0.0)
        except (CancelledError, OSError) as error:  # OSError: in the middle of an answer
            gone = f"the scheduler at {self._address} went away"
            raise ClusterError(f"{gone}; what was finished is stored: run the same command again") from error
        except Exception as error:  # something is wrong with the workers: cells do not raise
            raise ClusterError(f"the Dask workers cannot compute cells: {type(error).__name__}: {error}") from error
        _compare(theirs)
        digests = sources.of_cell(task.experiment, task.cell).digests
        if outcome["status"] == "done" and any(outcome[name] != digest for name, digest in digests.items()):
            reason = f"the Dask workers have other files of {task.experiment} or its method"
            raise ClusterError(f"{reason}: copy yours there")
        return outcome  # type: ignore[no-any-return]


def _compare(theirs: dict[str, Any]) -> None:
    """ClusterError if a worker has other source files of the bench, or other versions of packages."""
    here = versions()
    if different := [name for name in here if theirs[name] != here[name]]:
        listed = ", ".join(f"{name} is {theirs[name]}, here {here[name]}" for name in different)
        advice = "install the same versions there and restart the workers"
        raise ClusterError(f"the Dask workers do not run what this machine does: {listed}; {advice}")


def compute(task: Task, limit: float) -> tuple[dict[str, Any], Outcome]:
    """Compute a cell on a Dask worker, and return its versions and the outcome.

    A worker may join late and may miss the experiment. That must stop the run, and not make the cell a failed one.
    """
    if "." in task.experiment and importlib.util.find_spec(task.experiment) is None:
        raise ModuleNotFoundError(f"no module {task.experiment}")
    outcome = _worker(threading.get_ident()).compute(task, limit)
    return versions(), {**outcome, "provenance": provenance.provenance()}


@cache
def versions() -> dict[str, Any]:
    """What decides about rows: the source files that compute, and the versions of packages."""
    packages = {package: provenance.version(package) for package in provenance.DECISIVE}
    return {**packages, "the code of lagrange-bench": sources.of_bench()}


@cache
def _worker(thread: int) -> Worker:
    """The process that computes the cells of a thread. It ends with this process (`workers._end_with_parent`)."""
    process = multiprocessing.current_process()
    if process.daemon:
        process.daemon = False  # or it could not have processes of its own
    return Worker()
