"""What this machine has for a process: cores, memory and its limit; and when Ctrl-C takes effect."""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

GB = 1e9
VARIABLE = "LAGRANGE_BENCH_MEMORY"
DEFAULT = 4.0  # GB for one worker; one that has compiled every method takes 0.6


def limit() -> float:
    """GB that a worker may take."""
    text = os.environ.get(VARIABLE, "")
    with suppress(ValueError):
        value = float(text or DEFAULT)
        if 0 < value < math.inf:
            return value
    raise ValueError(f"{VARIABLE} must be a positive number of GB for each worker process; got {text!r}")


def restrain() -> None:
    """Limits the memory of this process to `limit()`, where the system can. What is beyond is a MemoryError.

    What is written to counts (RLIMIT_DATA), not what is reserved: compilers and threads reserve much.
    """
    with suppress(ImportError):  # Windows
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        wanted = int(limit() * GB)
        soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def available() -> float:
    """GB that this process can have now; infinity where the system does not say."""
    found = [math.inf]
    with suppress(OSError, ValueError, KeyError):  # Linux
        facts = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        found.append(1024 * int(facts["MemAvailable"].split()[0]))
    with suppress(OSError, ValueError):  # a container; without a limit it reads "max"
        most, used = (int(Path(f"/sys/fs/cgroup/memory.{name}").read_text()) for name in ("max", "current"))
        found.append(most - used)
    return max(min(found), 0) / GB


def check(rows: int, each: int, room: float, name: str, advice: str) -> None:
    """ValueError if `rows` rows of `each` bytes do not fit into `room` GB."""
    needed = rows * each / GB
    if needed > room:
        raise ValueError(
            f"{name}: {rows} rows take about {needed:.3g} GB of memory, and there are {room:.2g}: {advice}"
        )


def usable_cores() -> int:
    """Cores this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# ---------------------------------------------------------------- Ctrl-C


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Around all that a process does: the first Ctrl-C raises KeyboardInterrupt, later ones do nothing.

    The end that the first one begins is short, as worker processes are killed. A second Ctrl-C in the middle of it could
    only leave processes behind, or print a traceback.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # e.g. nohup
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt(*_: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Ctrl-C takes effect at the end, and processes started meanwhile never see it.

    They inherit the blocked signal; here a handler is needed too, for any thread of a library may catch it.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    from multiprocessing import resource_tracker

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
