"""Computes cells in processes of their own, so that a cell that hangs or kills its process fails alone.

A cell is a pure function of its fields, so a process needs only the name of the experiment and the cell. Each process has one
thread. `Local` runs cells on this machine, and `cluster.Cluster` on a cluster, whose workers have a `Local` each. Both give the
same rows.
"""

import faulthandler
import gc
import math
import multiprocessing
import os
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from multiprocessing import connection
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any, Protocol, Self

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import sources
from lagrange_bench.results.store import clean_rows, restore, text_of
from lagrange_bench.support import announce, interrupts

# numerical libraries read these when they are imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
TRACEBACK = 4000  # characters kept of a traceback, from its end
HOME = f"{Path(__file__).resolve().parents[2]}{os.sep}"
DIED, OTHER_SOURCES = "WorkerDied", "OtherSources"
LONGEST_WAIT = 1e6  # s; the system counts milliseconds in 32 bits
GRACE = 30.0  # s after the limit; then a worker whose parent did not end it ends itself
MEMORY = "LAGRANGE_BENCH_MEMORY"  # in the environment: GB for one worker
DEFAULT_MEMORY = 4.0  # GB; a worker that has compiled every method takes 0.6


@dataclass(frozen=True, slots=True)
class Task:
    experiment: str
    version: int
    position: int
    cell: dict[str, Any]
    sources: dict[str, str | None] | None = None  # digests of the source code that must compute it; None for any


Outcome = dict[str, Any]  # status, rows, error, warnings, seconds; and sources, unless the process died
Finish = Callable[[Sequence[tuple[Task, Outcome]]], None]


class Executor(Protocol):
    """Something that computes several tasks at a time. `submit` does not wait; `finished` waits for some outcomes."""

    @property
    def room(self) -> bool: ...  # whether it takes another task now

    def submit(self, task: Task) -> None: ...

    def finished(self) -> list[tuple[Task, Outcome]]: ...


def compute_all(tasks: Iterable[Task], executor: Executor, begin: Callable[[str], None], finish: Finish) -> None:
    """Compute every task, and call `finish` in this process with each handful of outcomes.

    If a process dies, its cell is computed once more at the end, alone: the process may have been killed from outside, or the
    memory was full. If it dies again, the cell has failed.
    """
    suspects: list[Task] = []
    for outcomes in _stream(iter(tasks), executor, begin):
        suspects += [task for task, outcome in outcomes if failed_by(outcome, DIED)]
        if good := [(task, outcome) for task, outcome in outcomes if not failed_by(outcome, DIED)]:
            finish(good)
    for suspect in suspects:
        for outcomes in _stream(iter([suspect]), executor, begin):
            finish(outcomes)


def _stream(
    tasks: Iterator[Task], executor: Executor, begin: Callable[[str], None]
) -> Iterator[list[tuple[Task, Outcome]]]:
    """Outcomes as they come. The next tasks are submitted first, so that no process waits for the store."""
    out, outcomes = 0, list[tuple[Task, Outcome]]()
    while True:
        while executor.room and (task := next(tasks, None)):
            executor.submit(task)
            begin(task.experiment)
            out += 1
        if outcomes:
            yield outcomes
        if not out:
            return
        outcomes = executor.finished()
        out -= len(outcomes)


def failed_by(outcome: Outcome, reason: str) -> bool:
    """Whether the cell failed for this reason: DIED (its process ended) or OTHER_SOURCES."""
    return outcome["status"] == "failed" and outcome["error"]["type"] == reason


class Local:
    """An `Executor` with up to `jobs` processes on this machine. Each computes many cells, and is killed at the end.

    limit : how many seconds a cell may take.
    """

    def __init__(self, jobs: int, limit: float):
        self._jobs, self._limit = jobs, limit
        self._idle: list[_Worker] = []
        self._busy: dict[_Worker, Task] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            for worker in (*self._idle, *self._busy):
                worker.end()  # it is killed, for a plug-in's thread could keep it alive

    @property
    def room(self) -> bool:
        return len(self._busy) < self._jobs

    def submit(self, task: Task) -> None:
        with interrupts.interrupt_held_back():  # so no process is started and then forgotten
            worker = self._idle.pop() if self._idle else _Worker()
            self._busy[worker] = task
        worker.start(task, self._limit)

    def finished(self) -> list[tuple[Task, Outcome]]:
        outcomes: list[tuple[Task, Outcome]] = []
        while not outcomes:
            left = min(worker.deadline for worker in self._busy) - monotonic()
            connection.wait([worker.pipe for worker in self._busy], min(max(left, 0), LONGEST_WAIT))
            for worker in list(self._busy):
                if (outcome := worker.outcome()) is not None:
                    outcomes.append((self._busy.pop(worker), outcome))
                    self._idle += [] if worker.pipe.closed else [worker]
        return outcomes


class _Worker:
    """One process, and the cell that it computes."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, its = context.Pipe()
        self.process = context.Process(target=_serve, args=(its,))
        with _STARTING, _one_thread_each():
            self.process.start()
        its.close()

    def start(self, task: Task, limit: float) -> None:
        self.limit, self.begin = limit, monotonic()
        self.deadline = self.begin + limit
        with suppress(OSError):  # the process died after its last cell: `outcome` says so
            self.pipe.send((task.experiment, task.cell, limit, task.sources))

    def outcome(self) -> Outcome | None:
        """The outcome of the cell, also if its process died or hangs; None if it is still being computed."""
        error = None
        try:
            if self.pipe.poll():
                return self.pipe.recv()  # type: ignore[no-any-return]
        except (EOFError, OSError):
            error = DIED, self._reason()
        if monotonic() >= self.deadline and error is None:
            more = "so its process was ended; --time-limit SECONDS allows more"
            error = "TimeLimit", f"not done after {self.limit:g} s, {more}"
        if error is None:
            return None
        self.end()
        return failure(*error, "", monotonic() - self.begin)

    def _reason(self) -> str:
        self.process.join(1)
        code = self.process.exitcode
        if code is None or code >= 0:
            return f"the worker process ended itself with exit code {code}"
        return f"the worker process was killed by {signal.Signals(-code).name}"

    def end(self) -> None:
        """Kill the process, even if it is in compiled code."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


_STARTING = threading.Lock()  # one process is started at a time, since all share one environment


@contextmanager
def _one_thread_each() -> Iterator[None]:
    before = {name: os.environ[name] for name in THREADS if name in os.environ}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name in THREADS:
            del os.environ[name]
        os.environ.update(before)


def _serve(pipe: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit_memory()
    announce.quiet = True  # the parent shows the progress
    gc.set_threshold(10_000)  # Numba makes many objects: collecting garbage would take a twentieth of a compilation
    os.dup2(2, 1)  # compiled libraries print warnings on stdout, which belongs to the data
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent is gone
        while True:
            pipe.send(compute(*pipe.recv()))


def _end_with_parent() -> None:
    """End this worker when its parent ends, even if the parent was killed."""
    multiprocessing.parent_process().join()  # type: ignore[union-attr]
    os._exit(1)


def memory_limit() -> float:
    """How many GB a worker may take."""
    text = os.environ.get(MEMORY, "")
    with suppress(ValueError):
        value = float(text or DEFAULT_MEMORY)
        if 0 < value < math.inf:
            return value
    raise ValueError(f"{MEMORY} must be a positive number of GB for each worker process; got {text!r}")


def _limit_memory() -> None:
    """Limit the memory of this process, if the system can. To take more raises MemoryError.

    The limit counts memory that is written to (RLIMIT_DATA). Compilers and threads reserve much more, which does not count.
    """
    with suppress(ImportError):  # Windows
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        wanted = int(1e9 * memory_limit())
        soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def compute(
    experiment: str,
    cell: dict[str, Any],
    limit: float | None = None,
    expected: dict[str, str | None] | None = None,
) -> Outcome:
    """Measure one cell. Exceptions and warnings become part of the outcome.

    limit : s; the parent watches it. Here it only ends a process in compiled code that has lost its parent.
    expected : digests of the source code, as `CellSources.digests`. If the code here is another, or was edited meanwhile, the
    outcome is OTHER_SOURCES.
    """
    start = perf_counter()
    code = sources.of_cell(experiment, cell)  # the files are read before they are imported
    if expected in (None, code.digests) and not code.edited:
        outcome = {**_measure(experiment, cell, limit), "seconds": round(perf_counter() - start, 3)}
        if not code.edited:
            return {**outcome, **code.digests}
    return failure(OTHER_SOURCES, "the source code here is not that of this run", "", 0.0)


def _measure(experiment: str, cell: dict[str, Any], limit: float | None) -> Outcome:
    try:
        if limit is not None:
            faulthandler.dump_traceback_later(limit + GRACE, exit=True)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default")
            module = load(experiment)
            if "method" in cell:
                _restrain(cell["method"])
            rows = clean_rows(cell, list(module.measure(restore(cell))))
        messages = sorted({f"{warning.category.__name__}: {text_of(warning.message)}" for warning in caught})
    except BaseException as error:  # SystemExit, too, must end neither the worker nor the run
        message = text_of(error)
        if isinstance(error, MemoryError):
            message = f"more than {memory_limit():g} GB; {MEMORY} in the environment, in GB, allows more"
        return failure(type(error).__name__, message, traceback.format_exc(), 0.0)
    finally:
        faulthandler.cancel_dump_traceback_later()
    return {"status": "done", "rows": rows, "error": None, "warnings": messages[:5]}


def failure(type_: str, message: str, trace: str, seconds: float) -> Outcome:
    trace = trace.replace(HOME, "")  # the folder differs between machines, and is private
    error = {"type": type_, "message": message, "traceback": text_of(trace[-TRACEBACK:])}
    return {"status": "failed", "rows": [], "error": error, "warnings": [], "seconds": round(seconds, 3)}


@cache
def _restrain(method: str) -> None:
    """Let heyoka use one thread and print nothing. It reads no environment variable, so it is told by calls."""
    from lagrange_bench.integrators.registry import METHODS

    if ":" in method:  # only the user names such a method
        METHODS.include(method)
    if METHODS[method].requires == "heyoka":
        import heyoka

        heyoka.set_nthreads(1)
        heyoka.set_logger_level_critical()
