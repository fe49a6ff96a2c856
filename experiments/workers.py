"""Fresh worker processes: they compute cells one thread each, and their death is a result, not an accident.

A cell is a pure function of its fields, so a worker needs nothing but the experiment's name and the cell.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import perf_counter
from typing import Any

from experiments import load
from experiments.store import clean_rows, restore

# read by the numerical libraries when they are imported
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS")
TRACEBACK = 4000  # characters kept of a traceback, from its end
HOME = f"{Path(__file__).resolve().parents[1]}{os.sep}"


@dataclass(frozen=True)
class Task:
    """One cell to compute."""

    experiment: str
    version: int
    position: int
    cell: dict[str, Any]


Outcome = dict[str, Any]  # status, rows, error, warnings, seconds
Finish = Callable[[Task, Outcome], None]


def compute_all(tasks: Iterable[Task], jobs: int, begin: Callable[[Task], None], finish: Finish) -> None:
    """Computes every task in `jobs` fresh processes and calls `finish(task, outcome)` here as each is done.

    A task that takes its process down with it costs its neighbours in the pool nothing: all that were in
    flight run again, each in a process of its own, and the one that dies alone is the culprit.
    """
    waiting = deque(tasks)
    while waiting:
        suspects, reason = _until_broken(waiting, min(jobs, len(waiting)), begin, finish)
        if len(suspects) == 1:
            finish(suspects[0], _failure("WorkerDied", reason, "", 0.0))
        else:
            for suspect in suspects:
                compute_all([suspect], 1, begin, finish)


def _until_broken(
    waiting: deque[Task], jobs: int, begin: Callable[[Task], None], finish: Finish
) -> tuple[list[Task], str]:
    """Computes tasks until none is left or a process dies; returns those in flight then, and how it died.

    No more than `jobs` are submitted at a time: the suspects are few.
    """
    running: dict[Future[Outcome], Task] = {}
    broken = False
    with _pool(jobs) as pool:
        while not broken and (waiting or running):
            while waiting and len(running) < jobs and not broken:
                try:
                    future = pool.submit(waiting[0])
                except BrokenProcessPool:  # died between two tasks
                    broken = True
                else:
                    running[future] = waiting.popleft()
                    begin(running[future])
            wait(running, return_when=FIRST_COMPLETED)
            # what finished before the death counts; the rest of a broken pool is done too, with this exception
            for future in [future for future in running if future.done()]:
                if isinstance(future.exception(), BrokenProcessPool):
                    broken = True
                else:
                    finish(running.pop(future), future.result())
    return list(running.values()), pool.reason()


# ---------------------------------------------------------------- the pool


@dataclass
class _Pool:
    executor: ProcessPoolExecutor
    others: set[BaseProcess]
    processes: set[BaseProcess] = field(default_factory=set)

    def submit(self, task: Task) -> Future[Outcome]:
        # processes start in here; they inherit the blocked signal, and are stopped by us, not by the terminal
        with interrupt_held_back():
            future = self.executor.submit(compute, task.experiment, task.cell)
        self.look()
        return future

    def look(self) -> None:
        self.processes |= set(multiprocessing.active_children()) - self.others

    def kill(self) -> None:
        self.look()
        for process in self.processes:
            process.kill()

    def reason(self) -> str:
        """How the process that died first did: the executor terminates the rest."""
        codes = [process.exitcode for process in self.processes if process.exitcode not in (None, 0, -signal.SIGTERM)]
        if not codes or codes[0] is None:
            return "the worker process died"
        if codes[0] > 0:
            return f"the worker process ended itself with exit code {codes[0]}"
        try:
            return f"the worker process was killed by {signal.Signals(-codes[0]).name}"
        except ValueError:
            return f"the worker process was killed by signal {-codes[0]}"


@contextmanager
def _pool(jobs: int) -> Iterator[_Pool]:
    """`jobs` fresh processes; left through an exception (Ctrl-C) they are killed, even within a compiled call."""
    spawn = multiprocessing.get_context("spawn")
    with _one_thread_each():
        executor = ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_start_worker)
        pool = _Pool(executor, others=set(multiprocessing.active_children()))
        try:
            yield pool
        except BaseException:
            pool.kill()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


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


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Ctrl-C takes effect at the end, and processes started meanwhile never see it.

    They inherit the blocked signal; here a handler is needed too, for any thread of a library may catch it.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    caught = threading.Event()
    resource_tracker.ensure_running()  # multiprocessing's helper; starting it unblocks the signal
    handler = signal.signal(signal.SIGINT, lambda *_: caught.set())
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
        if caught.is_set():
            signal.raise_signal(signal.SIGINT)


# ---------------------------------------------------------------- inside a worker


def compute(experiment: str, cell: dict[str, Any]) -> Outcome:
    """Measures one cell. Whatever is raised becomes part of the outcome; warnings are collected."""
    start = perf_counter()
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default")
            module = load(experiment)
            if "method" in cell:
                _restrain(cell["method"])
            rows = clean_rows(cell, list(module.measure(restore(cell))))
    except BaseException as error:  # also SystemExit: it must end neither the worker nor the run
        return _failure(type(error).__name__, str(error), traceback.format_exc(), perf_counter() - start)
    messages = sorted({f"{warning.category.__name__}: {warning.message}" for warning in caught})
    outcome = {"status": "done", "rows": rows, "error": None, "warnings": messages[:5]}
    return {**outcome, "seconds": round(perf_counter() - start, 3)}


def _failure(type_: str, message: str, trace: str, seconds: float) -> Outcome:
    trace = trace.replace(HOME, "")  # where the suite lies is nobody's business, and differs between machines
    error = {"type": type_, "message": message, "traceback": trace[-TRACEBACK:]}
    return {"status": "failed", "rows": [], "error": error, "warnings": [], "seconds": round(seconds, 3)}


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
    from integrators.registry import METHODS

    if METHODS[method].requires == "heyoka":
        import heyoka

        heyoka.set_nthreads(1)
        heyoka.set_logger_level_critical()
