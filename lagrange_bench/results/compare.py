"""Compares two stores of results, cell by cell.

Cells are matched by experiment and content. A cell is the same if everything but times is equal to the last stored digit, close
if it is within a tolerance, and else changed. It is missing where only the other store has it. Times are not compared.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lagrange_bench.experiments.catalogue import declared
from lagrange_bench.results.store import Record, Store, _canonical, failure_text, find_results, restore

# a column of a timing cell is a time if its name has one of these words, or if the experiment lists it in TIMES
WORDS = frozenset(("ns", "us", "ms", "s", "seconds", "ratio", "speedup", "samples", "predicted", "memory"))

Tolerance = Callable[[str], tuple[float, float]]  # name of a column → (rtol, atol)


@dataclass
class Difference:
    """What changed in one column of one cell. `old` and `new` come from the row with the largest relative difference."""

    rows: int
    absolute: float  # the largest; inf if the values are no numbers, or a row is missing
    relative: float  # |new − old|/max(|old|, |new|), the largest
    old: Any
    new: Any


@dataclass
class ComparedCells:
    """How the cells of one experiment differ between two stores."""

    same: int = 0
    close: int = 0
    changed: list[dict[str, Any]] = field(default_factory=list)  # {"cell": …, "columns": {name: Difference}}
    missing: dict[str, list[dict[str, Any]]] = field(default_factory=dict)  # in "old" or "new" → cells


@dataclass
class ComparedStores:
    """How two stores differ."""

    experiments: dict[str, ComparedCells]
    notes: list[str]

    @property
    def same(self) -> bool:
        return not any(cells.changed or any(cells.missing.values()) for cells in self.experiments.values())


def compare(old: Path, new: Path, rtol: float = 0.0, atol: float = 0.0) -> ComparedStores:
    """Compare the store in the folder `new` with the one in `old`. FileNotFoundError if a folder holds no results."""
    stores = Store(find_results(old)), Store(find_results(new))
    result, both, others = ComparedStores({}, []), 0, 0
    for experiment in sorted({*stores[0].experiments(), *stores[1].experiments()}):
        journals = [store.open(experiment) for store in stores]
        result.notes += [problem for journal in journals for problem in journal.problems]
        before, after = ({_canonical(record["cell"]): record for record in journal.latest} for journal in journals)
        cells, times = ComparedCells(), declared(experiment, "TIMES", ())
        for key in (key for key in before if key in after):
            pair = before[key], after[key]
            word, columns = compare_cell(*pair, times, lambda _: (rtol, atol))
            cells.same += word == "same"
            cells.close += word == "close"
            if columns:
                cells.changed.append({"cell": pair[0]["cell"], "columns": columns})
            digests = {record.get("sources") for record in pair}
            both += 1
            others += len(digests) > 1 or None in digests
        cells.missing["old"] = [record["cell"] for key, record in after.items() if key not in before]
        cells.missing["new"] = [record["cell"] for key, record in before.items() if key not in after]
        result.experiments[experiment] = cells
    if others:
        result.notes.append(f"{others} of the {both} cells in both were computed with other or unknown source code")
    return result


def is_time(column: str, cell: dict[str, Any], times: Iterable[str] = ()) -> bool:
    """Whether a column depends on the clock."""
    return column in times or (bool(cell.get("timing")) and not WORDS.isdisjoint(column.split("_")))


def compare_cell(
    old: Record, new: Record, times: Iterable[str], tolerance: Tolerance
) -> tuple[str, dict[str, Difference]]:
    """ "same", "close" or "changed", and the columns that differ by more than the tolerance.

    Times are left out. times : names of columns that are times, too.
    """
    if "failed" in (old["status"], new["status"]):
        words = [r["status"] if r["error"] is None else failure_text(r["error"]) for r in (old, new)]
        if words[0] == words[1]:
            return "same", {}
        return "changed", {"status": Difference(0, math.inf, math.inf, *words)}
    timed = bool(old["cell"].get("timing"))  # the clock decides how many rows there are: compare those that both have
    if len(old["rows"]) != len(new["rows"]) and not timed:
        counts = len(old["rows"]), len(new["rows"])
        return "changed", {"rows": Difference(0, float(abs(counts[1] - counts[0])), math.inf, *counts)}
    word, changes = "same", dict[str, Difference]()
    for before, after in zip(old["rows"], new["rows"], strict=False):
        for column in dict.fromkeys((*before, *after)):
            if is_time(column, old["cell"], times) or (timed and (column not in before or column not in after)):
                continue
            a, b = restore(before.get(column)), restore(after.get(column))
            absolute, relative = _distance(a, b)
            if relative > 0.0:
                word = "close"
            rtol, atol = tolerance(column)
            if relative > rtol and absolute > atol:
                entry = changes.setdefault(column, Difference(0, 0.0, 0.0, a, b))
                entry.rows += 1
                entry.absolute = max(entry.absolute, absolute)
                if relative > entry.relative:
                    entry.relative, entry.old, entry.new = relative, a, b
    return "changed" if changes else word, changes


def _distance(a: Any, b: Any) -> tuple[float, float]:
    """Absolute and relative difference of two values; (inf, inf) if they are not numbers, or not finite, and differ."""
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    if numbers and math.isfinite(a) and math.isfinite(b):
        return abs(b - a), abs(b - a) / (max(abs(a), abs(b)) or 1.0)
    equal = a == b or (numbers and math.isnan(a) and math.isnan(b))
    return (0.0, 0.0) if equal else (math.inf, math.inf)
