"""Cells in processes of their own, one thread each: their death or their hanging is a result, not an accident.

A cell is a pure function of its fields, so a process needs nothing but the experiment's name and the cell. Here cells
are run by `Local`, on a cluster by `cluster.Cluster`; on both each is computed by `Slots.compute`, with the same rows.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import queue
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.integrators import interrupts, memory
from lagrange_bench.results import sources
from lagrange_bench.results.store import clean_rows, restore, text_of

# read by the numerical libraries when they are imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
TRACEBACK = 4000  # characters kept of a traceback, from its end
HOME = f"{Path(__file__).resolve().parents[2]}{os.sep}"
DIED, OTHER_SOURCES = "WorkerDied", "OtherSources"
GRACE = 30.0  # s the parent of a hanging cell has to end it


@dataclass(frozen=True, slots=True)
class Task:
    """One cell to compute."""

    experiment: str
    version: int
    position: int
    cell: dict[str, Any]
    sources: str | None = None  # digest of the source code that is to compute it; None for any


Outcome = dict[str, Any]  # status, rows, error, warnings, seconds; and sources, if the process lived to say
Finish = Callable[[Sequence[tuple[Task, Outcome]]], None]


class Executor(Protocol):
    """Something that computes tasks, several at a time."""

    @property
    def room(self) -> bool:
        """Whether to hand over more now."""
        ...

    @property
    def size(self) -> int:
        """How many tasks to hand over in one go."""
        ...

    def submit(self, tasks: list[Task]) -> None:
        """Hands over tasks, without waiting."""
        ...

    def finished(self) -> list[tuple[Task, Outcome]]:
        """Waits for some of the tasks handed over, and returns their outcomes."""
        ...


def compute_all(tasks: Iterable[Task], executor: Executor, begin: Callable[[Task], None], finish: Finish) -> None:
    """Computes every task and calls `finish` here with a handful of outcomes as soon as it is there.

    `tasks` is read as it is needed. A cell whose process died is computed once more in the end, with no other beside
    it: the process may have been killed from outside, or for want of memory. The second death is the cell's own.
    """
    suspects: list[Task] = []
    for outcomes in _stream(iter(tasks), executor, begin):
        suspects += [task for task, outcome in outcomes if died(outcome)]
        if good := [(task, outcome) for task, outcome in outcomes if not died(outcome)]:
            finish(good)
    for suspect in suspects:
        for outcomes in _stream(iter([suspect]), executor, begin):
            finish(outcomes)


def _stream(
    tasks: Iterator[Task], executor: Executor, begin: Callable[[Task], None]
) -> Iterator[list[tuple[Task, Outcome]]]:
    """Outcomes as they come; as many tasks are out at a time as the executor has room for, so memory is bounded."""
    out = 0
    while True:
        while executor.room and (handful := list(islice(tasks, executor.size))):
            executor.submit(handful)
            out += len(handful)
            for task in handful:
                begin(task)
        if not out:
            return
        outcomes = executor.finished()
        out -= len(outcomes)
        yield outcomes


def died(outcome: Outcome) -> bool:
    """Whether the process of the cell ended before the cell did."""
    return outcome["status"] == "failed" and outcome["error"]["type"] == DIED


# ---------------------------------------------------------------- on this machine


class Local:
    """`jobs` cells at a time on this machine, and `ahead` more that wait, so that no process waits for the store.

    Left through an exception (Ctrl-C), the processes are killed.
    """

    size = 1

    def __init__(self, jobs: int, limit: float | None = None, ahead: int = 0):
        self._jobs, self._ahead, self._limit, self._slots, self._out = jobs, ahead, limit, Slots(), 0
        self._done: queue.SimpleQueue[tuple[Task, Future[Outcome]]] = queue.SimpleQueue()

    def __enter__(self) -> Local:
        if hasattr(signal, "pthread_sigmask"):
            resource_tracker.ensure_running()  # multiprocessing's helper; starting it unblocks the signal
        self._threads = ThreadPoolExecutor(self._jobs, initializer=_block_interrupts)
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        with interrupts.interrupt_held_back():  # the end is short, and a second Ctrl-C would leave processes behind
            if kind is not None:
                self._slots.kill()
            self._threads.shutdown(wait=True, cancel_futures=True)
            self._slots.close()

    @property
    def room(self) -> bool:
        return self._out < self._jobs + self._ahead

    def submit(self, tasks: list[Task]) -> None:
        (task,) = tasks
        self._out += 1
        with interrupts.interrupt_held_back():  # else the pool would not wait for a thread that it just started
            future = self._threads.submit(self._slots.compute, task.experiment, task.cell, self._limit, task.sources)
        future.add_done_callback(lambda done: self._done.put((task, done)))

    def finished(self) -> list[tuple[Task, Outcome]]:
        found = [self._done.get()]
        while not self._done.empty():  # also what was finished while the last were stored
            found.append(self._done.get())
        self._out -= len(found)
        return [(task, future.result()) for task, future in found]


def _block_interrupts() -> None:
    """In a thread: Ctrl-C is for the main one, and processes started here inherit the blocked signal."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


class Slots:
    """Processes that compute one cell at a time each and are used again; as many as there are callers at a time."""

    def __init__(self) -> None:
        self._idle: list[_Slot] = []
        self._all: set[_Slot] = set()
        self._lock, self._killed = threading.Lock(), False

    def compute(
        self, experiment: str, cell: dict[str, Any], limit: float | None, expected: str | None = None
    ) -> Outcome:
        """The outcome of a cell, whatever it does to its process; `limit` is in seconds, None for no limit."""
        slot, start = self._take(), perf_counter()
        try:
            with self._lock:
                if self._killed:
                    raise BrokenProcessPool
                future = slot.submit(experiment, cell, limit, expected)
            outcome = future.result(limit)
        except TimeoutError:
            slot.kill()
            reason = f"not done after {limit:g} s, so its process was ended; --time-limit SECONDS allows more"
            outcome = failure("TimeLimit", reason, "", perf_counter() - start)
        except BrokenProcessPool:
            outcome = failure(DIED, slot.reason(), "", perf_counter() - start)
        else:
            self._idle.append(slot)
            return outcome
        slot.close()
        self._all.discard(slot)
        return outcome

    def _take(self) -> _Slot:
        with self._lock:
            if self._idle:
                return self._idle.pop()
            slot = _Slot()
            self._all.add(slot)
            return slot

    def kill(self) -> None:
        """Ends every process, even within a compiled call; what is being computed becomes a failure."""
        with self._lock:
            self._killed = True
            for slot in list(self._all):
                slot.kill()

    def close(self) -> None:
        """Ends the processes; nothing may be being computed."""
        for slot in self._all:
            slot.close()
        self._all.clear()
        self._idle.clear()


class _Slot:
    """One fresh process."""

    def __init__(self) -> None:
        self._executor = _executor()
        self._process: BaseProcess | None = None

    def submit(self, *what: Any) -> Future[Outcome]:
        """Starts `compute(*what)`."""
        with _STARTING, _one_thread_each():  # the process is started in here
            others = set(multiprocessing.active_children())
            try:
                future = self._executor.submit(compute, *what)
            except BrokenProcessPool:  # it died between two cells
                self._executor.shutdown()
                self._executor, self._process = _executor(), None
                future = self._executor.submit(compute, *what)
            if self._process is None:
                self._process = (set(multiprocessing.active_children()) - others).pop()
        return future

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        self.kill()  # it has nothing to lose, and a plug-in's thread could keep it alive
        self._executor.shutdown(wait=True, cancel_futures=True)

    def reason(self) -> str:
        """How the process died."""
        self._executor.shutdown()  # waits for its end
        code = None if self._process is None else self._process.exitcode
        if code is None:
            return "the worker process died"
        if code >= 0:
            return f"the worker process ended itself with exit code {code}"
        try:
            return f"the worker process was killed by {signal.Signals(-code).name}"
        except ValueError:
            return f"the worker process was killed by signal {-code}"


_STARTING = threading.Lock()  # one process is started at a time: whose it is, and its environment, are not confused


def _executor() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_start_worker)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Sets the environment of the processes started meanwhile."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


# ---------------------------------------------------------------- inside a worker


def compute(experiment: str, cell: dict[str, Any], limit: float | None = None, expected: str | None = None) -> Outcome:
    """Measures one cell. Whatever is raised becomes part of the outcome; warnings are collected.

    limit : kept by the parent; here it only ends a process that lost its parent within a compiled call. expected : digest of
    the source code; a cell that other code would compute here is not begun.
    """
    start = perf_counter()
    found = sources.of_cell(experiment, cell)
    if expected not in (None, found):
        return {**failure(OTHER_SOURCES, "the source code here is not that of this run", "", 0.0), "sources": found}
    outcome = _measure(experiment, cell, limit)
    seconds = round(perf_counter() - start, 3)
    return {**outcome, "seconds": seconds, "sources": sources.of_cell(experiment, cell)}  # as it was imported meanwhile


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
    except BaseException as error:  # also SystemExit: it must end neither the worker nor the run
        message = text_of(error)
        if isinstance(error, MemoryError):
            message = f"more than {memory.limit():g} GB; {memory.VARIABLE} in the environment, in GB, allows more"
        return failure(type(error).__name__, message, traceback.format_exc(), 0.0)
    finally:
        faulthandler.cancel_dump_traceback_later()
    return {"status": "done", "rows": rows, "error": None, "warnings": messages[:5]}


def failure(type_: str, message: str, trace: str, seconds: float) -> Outcome:
    """The outcome of a cell that has no rows."""
    trace = trace.replace(HOME, "")  # where the suite lies is nobody's business, and differs between machines
    error = {"type": type_, "message": message, "traceback": text_of(trace[-TRACEBACK:])}
    return {"status": "failed", "rows": [], "error": error, "warnings": [], "seconds": round(seconds, 3)}


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    memory.restrain()
    os.dup2(2, 1)  # stdout belongs to the data; compiled libraries print warnings there
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for its next task for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@cache
def _restrain(method: str) -> None:
    """Heyoka reads no environment variable: one thread and no chatter are set by call."""
    from lagrange_bench.integrators.registry import METHODS

    if ":" in method:  # the user named it: no experiment lists another one
        METHODS.include(method)
    found = METHODS[method]
    if found.requires == "heyoka":
        import heyoka

        heyoka.set_nthreads(1)
        heyoka.set_logger_level_critical()
