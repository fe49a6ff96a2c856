"""mpmath and FLINT with more digits, for one thread at a time: each has one precision for the whole process."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

ONE_AT_A_TIME = threading.RLock()


@contextmanager
def workdps(digits: int) -> Iterator[None]:
    """As `mpmath.workdps`, but another thread waits until this one has left, or it would change the digits."""
    import mpmath

    with ONE_AT_A_TIME, mpmath.workdps(digits):
        yield


@contextmanager
def workprec(bits: int) -> Iterator[None]:
    """The same for the ball arithmetic of FLINT, in bits."""
    import flint

    with ONE_AT_A_TIME, flint.ctx.workprec(bits):
        yield
