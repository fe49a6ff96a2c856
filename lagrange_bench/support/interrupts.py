"""When Ctrl-C takes effect."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


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
