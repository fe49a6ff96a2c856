"""Computes cells in processes of their own, so that a cell that hangs or kills its process fails alone.

A cell is a pure function of its fields, so a process needs only the name of the experiment and the cell. Each process has one
thread. `Local` runs cells on this machine, and `cluster.Cluster` on a cluster, whose workers have a `Worker` each. Both give the
same rows.
"""

import faulthandler
import multiprocessing
import os
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, Self

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import sources
from lagrange_bench.results.store import clean_rows, restore, text_of
from lagrange_bench.support import announce, interrupts

# numerical libraries read these when they are imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
TRACEBACK = 4000  # characters kept of a traceback, from its end
HOME = f"{Path(__file__).resolve().parents[2]}{os.sep}"
DIED = "WorkerDied"
GRACE = 30.0  # s after the limit of a cell until a worker without a parent ends itself


@dataclass(frozen=True, slots=True)
class Task:
    experiment: str
    version: int
    position: int
    cell: dict[str, Any]


Outcome = dict[str, Any]  # status, rows, error, warnings, seconds; and digests of the sources, unless the process died


class Executor(Protocol):
    """Something that computes several tasks at a time."""

    ahead: int  # so many tasks are handed over before the first is done, for no process to wait

    def submit(self, task: Task) -> Future[Outcome]: ...


def compute_all(
    tasks: Iterable[Task], executor: Executor, begin: Callable[[str], None]
) -> Iterator[list[tuple[Task, Outcome]]]:
    """Compute every task, and yield the outcomes by the handful. begin : gets the experiment of a task that is handed over."""
    waiting, running = iter(tasks), dict[Future[Outcome], Task]()
    while True:
        for task in islice(waiting, executor.ahead - len(running)):
            begin(task.experiment)
            running[executor.submit(task)] = task
        if not running:
            return
        done, _ = wait(running, return_when=FIRST_COMPLETED)
        yield [(running.pop(future), future.result()) for future in done]


class Local:
    """An `Executor` with `jobs` processes on this machine, and a thread that waits for each.

    limit : how many seconds a cell may take.
    """

    def __init__(self, jobs: int, limit: float):
        self.ahead, self._limit = 2 * jobs, limit
        self._threads = ThreadPoolExecutor(jobs)
        self._workers = [Worker() for _ in range(jobs)]
        self._idle = [*self._workers]  # as many as threads, so that there is always one

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            self._threads.shutdown(wait=False, cancel_futures=True)
            for worker in self._workers:
                worker.close()
            self._threads.shutdown()

    def submit(self, task: Task) -> Future[Outcome]:
        return self._threads.submit(self._compute, task)

    def _compute(self, task: Task) -> Outcome:
        worker = self._idle.pop()
        try:
            return worker.compute(task, self._limit)
        finally:
            self._idle.append(worker)


class Worker:
    """Computes cells in a process, and in a new one if this process died or hung."""

    _LOCK = threading.Lock()  # `multiprocessing` looks after all processes of a program, from any thread

    def __init__(self) -> None:
        self._process: Any = None
        self._closed = False

    def compute(self, task: Task, limit: float) -> Outcome:
        """The outcome of a cell, also if its process dies or takes longer than `limit` seconds."""
        if self._process is None:
            self._start()
        begin = perf_counter()
        try:
            self._pipe.send((limit, task.experiment, task.cell))
            if self._pipe.poll(limit):
                return self._pipe.recv()  # type: ignore[no-any-return]
        except (EOFError, OSError):
            return failure(DIED, self._end(), "", perf_counter() - begin)
        self._end()
        words = f"not done after {limit:g} s, so its process was ended; --time-limit SECONDS allows more"
        return failure("TimeLimit", words, "", perf_counter() - begin)

    def close(self) -> None:
        """Kill the process, in the middle of a cell and from any thread; there is no new one."""
        with self._LOCK:
            self._closed = True
            if self._process is not None:
                self._process.kill()  # a plug-in's thread could keep it alive
                self._process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        with self._LOCK, theirs:
            if self._closed:
                raise CancelledError
            # processes of this thread never see Ctrl-C; multiprocessing's helper would unblock the signal when it starts
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            self._process = context.Process(target=_serve, args=(theirs,))
            self._process.start()

    def _end(self) -> str:
        """End the process, even if it is in compiled code, and return how it ended."""
        with self._LOCK:
            self._process.join(1)
            self._process.kill()
            self._process.join()
            code, self._process = self._process.exitcode, None
        self._pipe.close()
        if code >= 0:
            return f"the worker process ended itself with exit code {code}"
        return f"the worker process was killed by {signal.Signals(-code).name}"


def _serve(pipe: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.update(dict.fromkeys(THREADS, "1"))
    announce.quiet = True  # the parent shows the progress
    os.dup2(2, 1)  # compiled libraries print warnings on stdout, which belongs to the data
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent is gone
        while True:
            limit, *task = pipe.recv()
            # if the parent is killed while this process is in compiled code, `_end_with_parent` cannot run
            faulthandler.dump_traceback_later(limit + GRACE, exit=True)
            pipe.send(compute(*task))
            faulthandler.cancel_dump_traceback_later()


def _end_with_parent() -> None:
    """End this worker when its parent ends, even if the parent was killed."""
    multiprocessing.parent_process().join()  # type: ignore[union-attr]
    os._exit(1)


def compute(experiment: str, cell: dict[str, Any]) -> Outcome:
    """Measure one cell. Exceptions and warnings become part of the outcome.

    If a source file was edited since this process read it, nobody knows which version was imported: the cell fails.
    """
    start = perf_counter()
    code = sources.of_cell(experiment, cell)  # the files are read before they are imported
    outcome = _measure(experiment, cell)
    if code.edited:
        advice = "a source file was edited during the run: run the same command again"
        outcome = failure("SourceEdited", advice, "", 0.0)
    return {**outcome, **code.digests, "seconds": round(perf_counter() - start, 3)}


def _measure(experiment: str, cell: dict[str, Any]) -> Outcome:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default")
            module = load(experiment)
            if "method" in cell:
                restrain(cell["method"])
            rows = clean_rows(cell, list(module.measure(restore(cell))))
        messages = sorted({f"{warning.category.__name__}: {text_of(warning.message)}" for warning in caught})
    except BaseException as error:  # SystemExit, too, must end neither the worker nor the run
        return failure(type(error).__name__, text_of(error), traceback.format_exc(), 0.0)
    return {"status": "done", "rows": rows, "error": None, "warnings": messages[:5]}


def failure(type_: str, message: str, trace: str, seconds: float) -> Outcome:
    trace = trace.replace(HOME, "")  # the folder differs between machines, and is private
    error = {"type": type_, "message": message, "traceback": text_of(trace[-TRACEBACK:])}
    return {"status": "failed", "rows": [], "error": error, "warnings": [], "seconds": round(seconds, 3)}


@cache
def restrain(method: str) -> None:
    """Let heyoka use one thread and print nothing. It reads no environment variable, so it is told by calls."""
    from lagrange_bench.integrators.registry import METHODS

    if ":" in method:  # only the user names such a method
        METHODS.include(method)
    if METHODS[method].requires == "heyoka":
        import heyoka

        heyoka.set_nthreads(1)
        heyoka.set_logger_level_critical()
