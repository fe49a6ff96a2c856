"""Compares two stores of results, cell by cell.

Cells are matched by experiment and content. What is not a time must be equal, to the last digit stored unless a
tolerance is given. Times differ from run to run, so they are tested in groups: one column of one method, over all its cells.
The test is Wilcoxon's signed-rank test on the logarithms of the ratios. The times are called different only if the test
is significant and the ratio is above a threshold. On a machine that is not quite idle, two runs of the same code differ by
less than this threshold.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from lagrange_bench.experiments.catalogue import UnknownExperiment, declared, load_stored
from lagrange_bench.results import sources
from lagrange_bench.results.store import SAMPLES, Record, Store, _canonical, failure_text, find_results, restore

# a column of a timing cell is a time if its name has one of these words, or if the experiment lists it in TIMES
WORDS = frozenset(("ns", "us", "ms", "s", "seconds", "ratio", "speedup", "samples", "unstable", "predicted", "memory"))
UNITS = frozenset(("ns", "us", "ms", "s", "seconds"))  # --times tests the columns with one of these words
SIGNIFICANT = 0.01  # over all tests of a comparison together (Holm)
THRESHOLD = 0.1  # between two processes minima differ by some 6 %


@dataclass
class Difference:
    """What changed in one column of one cell. `old` and `new` come from the row with the largest relative difference."""

    rows: int
    absolute: float  # the largest; inf if the values are no numbers, or a row is missing
    relative: float  # |new − old|/max(|old|, |new|), the largest
    old: Any
    new: Any


@dataclass
class Cells:
    """How the cells of one experiment differ between two stores."""

    old: int = 0
    new: int = 0
    same: int = 0
    other_sources: int = 0  # cells in both stores, computed with different source code
    unknown_sources: int = 0  # cells in both stores, one of them without a record of its source code
    added: list[dict[str, Any]] = field(default_factory=list)
    removed: list[dict[str, Any]] = field(default_factory=list)
    changed: list[dict[str, Any]] = field(default_factory=list)  # {"cell": …, "columns": {name: Difference}}


@dataclass
class Times:
    """One group of paired times: a column of a method of an experiment."""

    experiment: str
    method: str  # and variant or form, if there are any
    column: str
    cells: int
    pairs: int
    ratio: float  # new/old, median over the cells of the ratio of their minima
    p: float  # Holm-corrected
    verdict: str  # "same", "slower" or "faster"


@dataclass
class Comparison:
    """How two stores differ."""

    experiments: dict[str, Cells]
    times: list[Times]
    notes: list[str]

    @property
    def same(self) -> bool:
        cells = all(not (c.added or c.removed or c.changed) for c in self.experiments.values())
        return cells and all(t.verdict == "same" for t in self.times)


def compare(
    old: Path, new: Path, rtol: float = 0.0, atol: float = 0.0, times: bool = False, threshold: float = THRESHOLD
) -> Comparison:
    """Compare the store in the folder `new` with the one in `old`. FileNotFoundError if a folder holds no results."""
    stores = Store(find_results(old)), Store(find_results(new))
    result = Comparison({}, [], [])
    pairs: list[tuple[Record, Record]] = []
    for experiment in sorted({*stores[0].experiments(), *stores[1].experiments()}):
        journals = [store.open(experiment) for store in stores]
        result.notes += [problem for journal in journals for problem in journal.problems]
        before, after = ({_canonical(record["cell"]): record for record in journal.latest} for journal in journals)
        both = [(before[key], after[key]) for key in before if key in after]
        cells = result.experiments[experiment] = _cells(experiment, both, (rtol, atol))
        cells.old, cells.new = len(before), len(after)
        cells.removed = [record["cell"] for key, record in before.items() if key not in after]
        cells.added = [record["cell"] for key, record in after.items() if key not in before]
        pairs += both
        if cells.changed:
            try:
                load_stored(experiment)
            except UnknownExperiment as error:
                result.notes.append(f"all columns are compared, times too: {error}")
    if times:
        result.times = paired_times(pairs, threshold)
        machines = {r["provenance"].get("cpu") for pair in pairs for r in pair if r["cell"].get("timing")}
        if len(machines) > 1:
            result.notes.append(f"times were measured on different machines: {', '.join(sorted(map(str, machines)))}")
    words = f"of the {len(pairs)} cells in both were computed with"
    if other := sum(cells.other_sources for cells in result.experiments.values()):
        result.notes.append(f"{other} {words} different source code")
    unknown = sum(cells.unknown_sources for cells in result.experiments.values())
    if unknown and not result.same:
        result.notes.append(f"{unknown} {words} source code that was not recorded")
    return result


def _cells(experiment: str, both: Sequence[tuple[Record, Record]], tolerance: tuple[float, float]) -> Cells:
    """How the cells that both stores have differ."""
    cells, own = Cells(), declared(experiment, "TIMES", ())
    for before, after in both:
        age = sources.compared(before.get("sources"), after.get("sources"))
        cells.other_sources += age == sources.OTHER
        cells.unknown_sources += age == sources.UNKNOWN
        if differing := differences(before, after, own, lambda _: tolerance):
            cells.changed.append({"cell": before["cell"], "columns": differing})
    cells.same = len(both) - len(cells.changed)
    return cells


def is_time(column: str, cell: dict[str, Any], own: Iterable[str] = ()) -> bool:
    """Whether a column depends on the clock."""
    return column in own or (bool(cell.get("timing")) and not WORDS.isdisjoint(column.split("_")))


def differences(old: Record, new: Record, own: Iterable[str], tolerance: Any) -> dict[str, Difference]:
    """Columns that differ by more than `tolerance(column)` = (rtol, atol). Times, also those in `own`, are left out."""
    if old["status"] != new["status"] or old["status"] == "failed":
        words = [r["status"] if r["error"] is None else failure_text(r["error"]) for r in (old, new)]
        return {} if words[0] == words[1] else {"status": Difference(0, math.inf, math.inf, *words)}
    timed = bool(old["cell"].get("timing"))  # the clock decides how many rows there are: compare those that both have
    if len(old["rows"]) != len(new["rows"]) and not timed:
        counts = len(old["rows"]), len(new["rows"])
        return {"rows": Difference(0, float(abs(counts[1] - counts[0])), math.inf, *counts)}
    changes: dict[str, Difference] = {}
    for before, after in zip(old["rows"], new["rows"], strict=False):
        for column in [*before, *(name for name in after if name not in before)]:
            if is_time(column, old["cell"], own) or (timed and (column not in before or column not in after)):
                continue
            a, b = restore(before.get(column)), restore(after.get(column))
            absolute, relative = _distance(a, b)
            rtol, atol = tolerance(column)
            if relative > rtol and absolute > atol:
                entry = changes.setdefault(column, Difference(0, 0.0, 0.0, a, b))
                entry.rows += 1
                entry.absolute = max(entry.absolute, absolute)
                if relative > entry.relative:
                    entry.relative, entry.old, entry.new = relative, a, b
    return changes


def _distance(a: Any, b: Any) -> tuple[float, float]:
    """Absolute and relative difference of two values; (inf, inf) if they are not numbers, or not finite, and differ."""
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    if numbers and math.isfinite(a) and math.isfinite(b):
        return abs(b - a), abs(b - a) / (max(abs(a), abs(b)) or 1.0)
    equal = a == b or (numbers and math.isnan(a) and math.isnan(b))
    return (0.0, 0.0) if equal else (math.inf, math.inf)


def paired_times(pairs: Sequence[tuple[Record, Record]], threshold: float = THRESHOLD) -> list[Times]:
    """Test every column of times of every method, over the cells in both stores; corrected for the number of tests."""
    from scipy.stats import wilcoxon

    groups: dict[tuple[str, str, str], list[tuple[list[float], list[float]]]] = {}
    for old, new in pairs:
        for what, column, a, b in _durations(old, new):
            groups.setdefault((old["experiment"], what, column), []).append((a, b))
    tested = []
    for (experiment, method, column), cells in groups.items():
        logs = [math.log(y / x) for a, b in cells for x, y in zip(a, b, strict=False)]
        ratio = median(min(b) / min(a) for a, b in cells)
        p = float(wilcoxon(logs, zero_method="zsplit").pvalue) if any(logs) else 1.0  # that the median is zero
        tested.append(Times(experiment, method, column, len(cells), len(logs), ratio, p, "same"))
    _holm(tested)
    for group in tested:
        if group.p < SIGNIFICANT and abs(math.log(group.ratio)) > math.log1p(threshold):
            group.verdict = "slower" if group.ratio > 1 else "faster"
    return tested


def _durations(old: Record, new: Record) -> Iterator[tuple[str, str, list[float], list[float]]]:
    """Method, column, and the samples in both stores. Raw samples, if stored, replace the numbers computed from them."""
    if not old["cell"].get("timing"):
        return
    for before, after in zip(old["rows"], new["rows"], strict=False):
        what = {**old["cell"], **before}
        name = " ".join(str(what[field]) for field in ("method", "variant", "form") if field in what)
        shared = [column for column in before if column in after and not UNITS.isdisjoint(column.split("_"))]
        raw = [column for column in shared if SAMPLES.search(column) and isinstance(before[column], list)]
        for column in raw or shared:
            a, b = (value if isinstance(value, list) else [value] for value in (before[column], after[column]))
            if a and b and all(isinstance(x, (int, float)) and x > 0 for x in (*a, *b)):
                yield name, column, a, b


def _holm(tested: list[Times]) -> None:
    """Corrects the p values in place: with n tests the smallest counts n times, the next n − 1 times, …"""
    largest = 0.0
    for rank, group in enumerate(sorted(tested, key=lambda group: group.p)):
        largest = max(largest, min(1.0, group.p * (len(tested) - rank)))
        group.p = largest
