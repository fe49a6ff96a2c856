"""The limit of memory of a worker process."""

from __future__ import annotations

import math
import os
from contextlib import suppress

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
