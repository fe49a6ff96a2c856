"""Runs cells on a Dask cluster. Needs the extra `cluster` (dask.distributed).

A Dask worker has a `workers.Worker`, as `workers.Local` has here, so a cell that hangs or crashes fails alone. Dask finds
another worker if one is lost. Only the process that asks for the cells writes the store.
"""

import logging
import multiprocessing
import threading
from concurrent.futures import CancelledError, Future
from contextlib import ExitStack
from functools import cache
from typing import Any, Self

from lagrange_bench.results import provenance, sources
from lagrange_bench.runner.workers import Outcome, Task, Worker
from lagrange_bench.support import interrupts
from lagrange_bench.support.words import scheduler

CONNECT = 30.0  # s to wait for the scheduler
# no cell waits behind another, and nothing is printed
LOCAL = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}


class ClusterError(RuntimeError):
    """The cluster cannot be used, or not any more. The message says what to do. Finished cells are stored."""


class Cluster:
    """A `workers.Executor`: hands cells to the workers of a Dask scheduler."""

    ahead = 500  # for Dask to spread

    def __init__(self, address: str, limit: float):
        self._address, self._limit = scheduler(address), limit
        self._started = ExitStack()

    def __enter__(self) -> Self:
        try:
            import dask
            import distributed
        except ImportError as error:
            raise ValueError(f"--scheduler: {error}; in the clone: pip install '.[cluster]'") from error
        address: Any = self._address
        try:
            with interrupts.interrupt_held_back(), dask.config.set({"distributed.scheduler.worker-saturation": 1.0}):
                if address.startswith("local:"):
                    count = int(address.removeprefix("local:"))
                    address = self._started.enter_context(distributed.LocalCluster(n_workers=count, **LOCAL))
                self._client = self._started.enter_context(distributed.Client(address, timeout=CONNECT))
        except BaseException as error:
            self.__exit__()
            if isinstance(error, OSError):
                start = "`dask scheduler` and `dask worker ADDRESS` start them; local:N needs neither"
                raise ClusterError(f"no Dask scheduler answers at {self._address} ({error}); {start}") from error
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            self._started.close()

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
        """What a worker found. ClusterError if it has other source files than this machine, or other versions of packages."""
        try:
            outcome: Outcome = future.result()
        except (CancelledError, OSError) as error:  # OSError: in the middle of an answer
            gone = f"the scheduler at {self._address} went away"
            raise ClusterError(f"{gone}; what was finished is stored: run the same command again") from error
        except Exception as error:  # something is wrong with the workers: cells do not raise
            raise ClusterError(f"the Dask workers cannot compute cells: {type(error).__name__}: {error}") from error
        theirs, ours = outcome["provenance"], provenance.provenance()
        for package in provenance.DECISIVE:
            if theirs[package] != ours[package]:
                other = f"{package} is {theirs[package]}, here {ours[package]}"
                raise ClusterError(f"{other}: install the same version where the Dask workers run, and restart them")
        digests = sources.of_cell(task.experiment, task.cell).digests
        if any(outcome.get(name, digest) != digest for name, digest in digests.items()):
            reason = f"the Dask workers have other files of lagrange-bench, of {task.experiment} or its method"
            raise ClusterError(f"{reason}: copy yours there, and restart them")
        return outcome


def compute(task: Task, limit: float) -> Outcome:
    """Compute a cell on a Dask worker."""
    outcome = _worker(threading.get_ident()).compute(task, limit)
    return {**outcome, "provenance": provenance.provenance()}


@cache
def _worker(thread: int) -> Worker:
    """The process that computes the cells of a thread. It ends with this process (`workers._end_with_parent`)."""
    process = multiprocessing.current_process()
    if process.daemon:
        process.daemon = False  # or it could not have processes of its own
    return Worker()
