"""Tells a person at a terminal what he waits for."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from time import perf_counter

LONG = 2.0  # seconds of waiting before anything is said
quiet = False  # set by --quiet, and in workers, whose progress the parent shows
_OUTERMOST = threading.Lock()  # held by the work that may be announced; work within it is not


@contextlib.contextmanager
def long_work(name: str) -> Iterator[None]:
    """Write the name of this work to a terminal once it has taken `LONG`, and at the end the seconds.

    If stderr is no terminal, nothing is written.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty() or not _OUTERMOST.acquire(blocking=False):
        yield
        return
    begin = perf_counter()
    written = threading.Event()

    def write() -> None:
        written.set()
        print(f"{name}: ", end="", file=sys.stderr, flush=True)

    timer = threading.Timer(LONG, write)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        _OUTERMOST.release()
        if written.is_set():
            print(f"{perf_counter() - begin:.0f} s", file=sys.stderr)
