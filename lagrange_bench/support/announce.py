"""Tells a person at a terminal what he waits for."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from time import perf_counter

LONG = 2.0  # seconds of waiting before anything is said
quiet = False  # set by --quiet, and in workers, whose progress the parent shows


class Waiting(threading.local):
    """What a thread waits for."""

    name = ""


waiting = Waiting()


@contextlib.contextmanager
def long_work(name: str) -> Iterator[None]:
    """Write the name of this work to a terminal once it has taken `LONG`, and at the end the seconds.

    Work within such work is not announced. If stderr is no terminal, nothing is.
    """
    if waiting.name or quiet or sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    written = threading.Event()

    def write() -> None:
        written.set()
        print(f"{name}: ", end="", file=sys.stderr, flush=True)

    waiting.name, begin, timer = name, perf_counter(), threading.Timer(LONG, write)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        waiting.name = ""
        timer.cancel()
        timer.join()
        if written.is_set():
            print(f"{perf_counter() - begin:.0f} s", file=sys.stderr)
