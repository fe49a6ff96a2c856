"""Runs cells on a Dask cluster. Needs the extra `cluster` (dask.distributed).

A Dask worker starts a process that computes the cells, as `workers.Local` does here. So a cell that hangs or crashes fails
alone, with the same message. Dask finds a worker for each cell, and another one if the worker is lost. Only the process that
asks for the cells writes the store.
"""

import importlib.util
import logging
import multiprocessing
import queue
import sys
import threading
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import cache
from typing import Any, Self

from lagrange_bench.results import provenance
from lagrange_bench.runner import workers
from lagrange_bench.runner.workers import DIED, Outcome, Task, failure
from lagrange_bench.support import interrupts
from lagrange_bench.support.words import scheduler

CONNECT = 30.0  # s to wait for the scheduler
PATIENCE = 30.0  # s without a finished cell before asking whether a worker is connected
AHEAD = 500  # cells handed over at a time, for Dask to spread


class ClusterError(RuntimeError):
    """The cluster cannot be used, or not any more. The message says what to do. Finished cells are stored."""


class Cluster:
    """A `workers.Executor`: hands cells to the workers of a Dask scheduler."""

    def __init__(self, address: str, limit: float):
        self._address, self._limit = scheduler(address), limit
        self._client: Any = None
        self._own: Any = None  # the scheduler and the workers that local:N starts
        self._out: dict[Any, Task] = {}  # the tasks that are being computed, by future
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        distributed = _distributed()
        import dask  # comes with it

        try:
            with interrupts.interrupt_held_back():  # processes started in here never see Ctrl-C
                if self._address.startswith("local:"):
                    count = int(self._address.removeprefix("local:"))
                    quiet = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
                    # so no cell waits behind another
                    with dask.config.set({"distributed.scheduler.worker-saturation": 1.0}):
                        self._own = distributed.LocalCluster(n_workers=count, threads_per_worker=1, **quiet)
                self._client = distributed.Client(self._own or self._address, timeout=CONNECT)
            for facts in self._client.run(look).values():
                _compare(facts)
        except BaseException as error:
            self.__exit__()
            if isinstance(error, Exception) and not isinstance(error, ClusterError):
                raise ClusterError(self._explanation(error)) from error
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            for part in (self._client, self._own):
                if part is not None:
                    part.close()

    @property
    def room(self) -> bool:
        return len(self._out) < AHEAD

    def submit(self, task: Task) -> None:
        future = self._client.submit(compute, task.experiment, task.cell, task.sources, self._limit, pure=False)
        self._out[future] = task
        future.add_done_callback(self._done.put)

    def finished(self) -> list[tuple[Task, Outcome]]:
        done = [self._next()]
        while not self._done.empty():  # also cells that were finished while the last ones were stored
            done.append(self._done.get())
        return [(self._out.pop(future), self._outcome(future)) for future in done]

    def _next(self) -> Any:
        while True:
            with suppress(queue.Empty):
                return self._done.get(timeout=PATIENCE)
            with suppress(OSError):  # the scheduler went away: then all tasks are cancelled, and `_outcome` says so
                if not self._client.nthreads():
                    print(f"waiting: no Dask worker is connected to {self._address}", file=sys.stderr, flush=True)

    def _outcome(self, future: Any) -> Outcome:
        distributed = _distributed()
        try:
            facts, outcome = future.result()
        except distributed.scheduler.KilledWorker as error:
            lost = f"{error.allowed_failures + 1} Dask workers died one after another while they had this cell"
            return failure(DIED, lost, "", 0.0)
        except (CancelledError, OSError) as error:  # OSError: in the middle of an answer
            gone = f"the scheduler at {self._address} went away"
            raise ClusterError(f"{gone}; what was finished is stored: run the same command again") from error
        except Exception as error:  # something is wrong with the workers: cells do not raise
            raise ClusterError(self._explanation(error)) from error
        _compare(facts)
        return outcome  # type: ignore[no-any-return]

    def _explanation(self, error: Exception) -> str:
        if isinstance(error, ImportError):
            advice = "install the same lagrange-bench where the workers run"
            return f"a Dask worker cannot import a module: {error}; {advice}"
        if isinstance(error, OSError):
            start = "`dask scheduler` and `dask worker ADDRESS` start them; local:N needs neither"
            return f"no Dask scheduler answers at {self._address} ({error or 'no connection'}); {start}"
        return f"the Dask workers cannot compute cells: {type(error).__name__}: {error}"


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        reason = f"dask.distributed cannot be imported here ({error})"
        raise ValueError(f"--scheduler: {reason}; in the clone: pip install '.[cluster]'") from error
    return distributed


def _compare(facts: dict[str, Any]) -> None:
    """ClusterError if a worker has other versions of packages. `workers.compute` compares its source code for each cell."""
    here = look()
    if different := [name for name in here if facts[name] != here[name]]:
        listed = ", ".join(f"{name} is {facts[name]}, here {here[name]}" for name in different)
        advice = "install the same versions there and restart the workers"
        raise ClusterError(f"the Dask workers do not run what this machine does: {listed}; {advice}")


def compute(
    experiment: str, cell: dict[str, Any], expected: dict[str, str | None] | None, limit: float
) -> tuple[dict[str, Any], Outcome]:
    """Compute a cell on a Dask worker: the worker's versions of packages, and the outcome.

    A worker may join late and may miss the experiment. That must stop the run, and not make the cell a failed one.
    """
    facts, executor = look(experiment), _executor(threading.get_ident(), limit)
    executor.submit(Task(experiment, 0, 0, cell, expected))
    ((_, outcome),) = executor.finished()
    return facts, {**outcome, "provenance": provenance.provenance()}


@cache
def look(experiment: str = "") -> dict[str, Any]:
    """The versions of packages that decide about rows. ModuleNotFoundError if the module of an experiment is missing."""
    workers.memory_limit()  # ValueError for a wrong one
    if "." in experiment and importlib.util.find_spec(experiment) is None:
        raise ModuleNotFoundError(f"no module {experiment}")
    return {package: provenance.version(package) for package in provenance.DECISIVE}


@cache
def _executor(thread: int, limit: float) -> workers.Local:
    """The process that computes the cells of a thread. It ends with this process (`workers._end_with_parent`)."""
    process = multiprocessing.current_process()
    if process.daemon:
        process.daemon = False  # or it could not have processes of its own
    return workers.Local(1, limit)
