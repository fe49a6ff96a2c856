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
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, Self

from pebble import ProcessExpired, ProcessPool

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import sources
from lagrange_bench.results.store import clean_rows, restore, text_of
from lagrange_bench.support import announce, interrupts

# numerical libraries read these when they are imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
TRACEBACK = 4000  # characters kept of a traceback, from its end
HOME = f"{Path(__file__).resolve().parents[2]}{os.sep}"
DIED, OTHER_SOURCES = "WorkerDied", "OtherSources"
LONGEST_WAIT = 1e6  # s; the watch of `faulthandler` counts in 32 bits
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
    """Something that computes several tasks at a time."""

    ahead: int  # how many tasks it takes before the first is done

    def submit(self, task: Task) -> Future[Any]: ...

    def outcome(self, future: Future[Any]) -> Outcome: ...  # of a future that is done


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
    out, outcomes = dict[Future[Any], Task](), list[tuple[Task, Outcome]]()
    while True:
        while len(out) < executor.ahead and (task := next(tasks, None)):
            out[executor.submit(task)] = task
            begin(task.experiment)
        if outcomes:
            yield outcomes
        if not out:
            return
        done, _ = wait(out, return_when=FIRST_COMPLETED)
        outcomes = [(out.pop(future), executor.outcome(future)) for future in done]


def failed_by(outcome: Outcome, reason: str) -> bool:
    """Whether the cell failed for this reason: DIED (its process ended) or OTHER_SOURCES."""
    return outcome["status"] == "failed" and outcome["error"]["type"] == reason


class Local:
    """An `Executor` with up to `jobs` processes on this machine. Each computes many cells, and is killed at the end.

    limit : how many seconds a cell may take.
    """

    def __init__(self, jobs: int, limit: float):
        self.ahead, self._limit = jobs, limit
        self._pool: ProcessPool | None = None
        self._environment: dict[str, str | None] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts.interrupt_held_back():
            self.end()

    def submit(self, task: Task) -> Future[Any]:
        words = (task.experiment, task.cell, self._limit, task.sources)
        with interrupts.interrupt_held_back():  # so no process is started and then forgotten
            if self._pool is None or not self._pool.active:  # a process that died between two cells breaks the pool
                self.end()
                self._begin()
            assert self._pool is not None
            return self._pool.schedule(compute, words, timeout=min(self._limit, LONGEST_WAIT))

    def outcome(self, future: Future[Any]) -> Outcome:
        try:
            return future.result()  # type: ignore[no-any-return]
        except TimeoutError:
            more = "so its process was ended; --time-limit SECONDS allows more"
            return failure("TimeLimit", f"not done after {self._limit:g} s, {more}", "", self._limit)
        except ProcessExpired as error:
            code = error.exitcode
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended itself with exit code {code}"
            return failure(DIED, f"the worker process {how}", "", 0.0)
        except BrokenProcessPool:
            return failure(DIED, "the worker process ended before it had the cell", "", 0.0)

    def _begin(self) -> None:
        """Start the pool. Its processes, now and later, inherit an environment that gives each one thread."""
        self._environment = {name: os.environ.get(name) for name in THREADS}
        os.environ.update(dict.fromkeys(THREADS, "1"))
        self._pool = ProcessPool(self.ahead, initializer=_prepare, context=multiprocessing.get_context("spawn"))

    def end(self) -> None:
        """Kill all processes, even those in compiled code. The next task starts new ones."""
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None
        for name, value in self._environment.items():
            os.environ.pop(name)
            os.environ.update({} if value is None else {name: value})
        self._environment = {}


def _prepare() -> None:
    """Prepare a worker process."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # ends it at once, in compiled code, too
    _limit_memory()
    announce.quiet = True  # the parent shows the progress
    gc.set_threshold(10_000)  # Numba makes many objects: collecting garbage would take a twentieth of a compilation
    os.dup2(2, 1)  # compiled libraries print warnings on stdout, which belongs to the data
    threading.Thread(target=_end_with_parent, daemon=True).start()


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
