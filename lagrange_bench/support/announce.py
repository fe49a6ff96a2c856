"""What a person at a terminal is told while he waits."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from time import perf_counter

LONG = 2.0  # seconds after which a person is told what he waits for
quiet = False  # of this process: --quiet, and workers, whose parent shows how far they are


class Waiting(threading.local):
    """Of a thread: what it waits for."""

    name = ""


waiting = Waiting()


@contextlib.contextmanager
def long_work(name: str) -> Iterator[None]:
    """Writes the name of what happens here to a terminal once it has taken `LONG`, and at the end the seconds.

    Of what happens within such work nothing is said. Where stderr is a file, nothing is said at all.
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
