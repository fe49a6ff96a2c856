"""What running a cell costs beyond computing it: `python -m lagrange_bench.runner.overhead` prints the table of docs/cluster.md.

The same cells, that do nothing or keep a core busy for a known time, here and on a Dask cluster on this machine, with one
and with two workers. Then how fast one journal is written and read.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

from lagrange_bench.results.store import Store, make_record
from lagrange_bench.runner import cluster, engine, workers
from lagrange_bench.text import table

VERSION = 1
NAME = "lagrange_bench.runner.overhead"
LENGTHS = {0.0: 2000, 0.02: 200, 0.2: 40}  # s a cell is busy: how many of them
RECORDS = 20_000


def cells(profile: str) -> Iterator[dict[str, Any]]:
    """All cells, as an experiment would list them."""
    return ({"busy": busy, "i": i} for busy, count in LENGTHS.items() for i in range(count))


def measure(cell: dict[str, Any]) -> list[dict[str, Any]]:
    """Keeps a core busy."""
    end = perf_counter() + cell["busy"]
    while perf_counter() < end:
        pass
    return [{"t": cell["busy"] * i, "H": 1e-16, "J3": 0.0, "C1": 1e-16, "C2": 1e-16} for i in range(4)]


def tables(rows: Any) -> dict[str, Any]:
    return {}


def draw(rows: Any) -> dict[str, Any]:
    return {}


def seconds(executor: Any, busy: float, folder: Path) -> float:
    """Wall time of all cells of one length, stored, once the workers are warm."""
    store = Store(folder)
    store.check_writable()

    def finish(outcomes: Any) -> None:
        store.append(*(make_record(t.experiment, t.version, t.position, t.cell, **o) for t, o in outcomes))

    def tasks(count: int, busy: float) -> Iterator[workers.Task]:
        return (workers.Task(NAME, VERSION, i, {"busy": busy, "i": i}) for i in range(count))

    workers.compute_all(tasks(20, 0.1), executor, lambda _: None, finish)
    start = perf_counter()
    workers.compute_all(tasks(LENGTHS[busy], busy), executor, lambda _: None, finish)
    return perf_counter() - start


def scaling(most: int) -> list[tuple[str, ...]]:
    """For each kind of executor and number of workers: ms beyond the cell's own, and cells at once."""
    rows: list[tuple[str, ...]] = []
    for kind in ("here", "Dask"):
        for count in range(1, most + 1):
            for busy, number in LENGTHS.items():
                made: Any = (
                    workers.Local(count, ahead=count) if kind == "here" else cluster.Cluster(f"local:{count}", None)
                )
                with tempfile.TemporaryDirectory() as folder, made as executor:
                    wall = seconds(executor, busy, Path(folder))
                each = wall / number
                speed = f"{busy / each:.2f}" if busy else "-"
                rows.append(
                    (kind, str(count), f"{busy * 1e3:g}", str(number), f"{wall:.2f}", f"{each * 1e3:.2f}", speed)
                )
    return rows


def journal() -> list[tuple[str, ...]]:
    """One journal: bytes of a record, and µs to write and to read it."""
    outcome = {"status": "done", "rows": measure({"busy": 0.0}), "error": None, "warnings": [], "seconds": 0.1}
    rows: list[tuple[str, ...]] = []
    for together in (1, 100):
        with tempfile.TemporaryDirectory() as folder:
            store = Store(folder)
            count = RECORDS if together > 1 else RECORDS // 20
            start = perf_counter()
            for first in range(0, count, together):
                batch = range(first, first + together)
                store.append(*(make_record("toy", 1, i, {"busy": 0.0, "i": i}, **outcome) for i in batch))
            written = (perf_counter() - start) / count
            size = store.path("toy").stat().st_size / count
            start = perf_counter()
            store.done("toy")
            read = (perf_counter() - start) / count
        rows.append((str(together), f"{size:.0f}", f"{written * 1e6:.0f}", f"{read * 1e6:.0f}"))
    return rows


def planning() -> tuple[str, ...]:
    """µs and bytes the driver needs for a cell it has not computed yet, of a million."""
    count, listed = 1_000_000, LENGTHS.copy()
    LENGTHS.clear()
    LENGTHS[0.0] = count
    sys.modules.setdefault(NAME, sys.modules[__name__])
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        summary = engine.Summary(Path(folder), "full")
        plan = engine._plan(NAME, "full", Store(folder), summary, True)
    took, grown = perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    LENGTHS.clear()
    LENGTHS.update(listed)
    return f"{plan.missing}", f"{took / count * 1e6:.0f}", f"{grown * 1024 / count:.0f}"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m lagrange_bench.runner.overhead", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="from 1 to N (default: 2)")
    options = parser.parse_args()
    print("\n".join(table([("cells planned", "µs each", "bytes each"), planning()])), end="\n\n", flush=True)
    print(
        "\n".join(table([("synced together", "bytes", "µs to write", "µs to read"), *journal()])),
        end="\n\n",
        flush=True,
    )
    header = ("where", "workers", "cell, ms", "cells", "wall, s", "ms per cell", "cells at once")
    print("\n".join(table([header, *scaling(options.workers)])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
