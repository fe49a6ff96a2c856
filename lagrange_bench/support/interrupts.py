"""Holds Ctrl-C back until a piece of work is whole."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Let Ctrl-C take effect at the end of the block. Processes started in the block never see it.

    These processes inherit the blocked signal. This one also needs a handler, because any thread of a library may get the signal.
    """
    if threading.current_thread() is not threading.main_thread():
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
