"""Tells a person at a terminal what he waits for."""

import contextlib
import sys
import threading
from collections.abc import Iterator

LONG = 2.0  # seconds of waiting before anything is said
quiet = False  # set by --quiet, and in workers, whose progress the parent shows
_OUTERMOST = threading.Lock()  # held by the work that may be announced; work within it is not


@contextlib.contextmanager
def long_work(name: str) -> Iterator[None]:
    """Write the name of this work to a terminal once it has taken `LONG`; nothing if stderr is no terminal."""
    if quiet or sys.stderr is None or not sys.stderr.isatty() or not _OUTERMOST.acquire(blocking=False):
        yield
        return
    timer = threading.Timer(LONG, print, [f"{name} …"], {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        _OUTERMOST.release()
