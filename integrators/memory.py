"""Memory of a process: what there is, and the limit of a worker."""

from __future__ import annotations

import math
import os
from contextlib import suppress
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
        sizes = f"about {needed:.3g} GB of memory, and there are {room:.2g}"
        raise ValueError(f"{name}: {rows} rows take {sizes}: {advice}")
