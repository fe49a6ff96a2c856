"""Limits the memory of worker processes."""

from __future__ import annotations

import math
import os
from contextlib import suppress

GB = 1e9
VARIABLE = "LAGRANGE_BENCH_MEMORY"
DEFAULT = 4.0  # GB for one worker; one that has compiled every method takes 0.6


def limit() -> float:
    """How many GB a worker may take."""
    text = os.environ.get(VARIABLE, "")
    with suppress(ValueError):
        value = float(text or DEFAULT)
        if 0 < value < math.inf:
            return value
    raise ValueError(f"{VARIABLE} must be a positive number of GB for each worker process; got {text!r}")


def restrain() -> None:
    """Limit the memory of this process to `limit()`, if the system can. To take more raises MemoryError.

    The limit counts memory that is written to (RLIMIT_DATA). Compilers and threads reserve much more, which does not count.
    """
    with suppress(ImportError):  # Windows
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        wanted = int(limit() * GB)
        soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
