"""Computes a sample of stored cells again, and compares their rows."""

import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

from lagrange_bench.experiments.catalogue import UnknownExperiment, declared, load_stored, missing_package
from lagrange_bench.integrators.registry import METHODS, POTENTIALS, available, find_stored
from lagrange_bench.report import origin
from lagrange_bench.results import sources
from lagrange_bench.results.compare import Tolerance, compare_cell, is_time
from lagrange_bench.results.store import Record, Store, StoreError, _canonical, find_results
from lagrange_bench.runner import progress, workers
from lagrange_bench.runner.workers import Task
from lagrange_bench.support import machine
from lagrange_bench.support.source_digest import Sources

# tolerances if a library takes the steps, or if the truth needs more than + − × ÷ √
RTOL, ATOL = 1e-3, 1e-12
ATOLS = {"ulps": 1.0}  # the truth may be off by an ulp of the initial state
COUNTS = ("n", "steps", "evals", "iterations", "rejected", "maps", "evals_per_step", "iterations_per_step")
STATES = ("t", "J1", "J2", "J3", "x1", "x2", "x3", "H", "C1", "C2")
EXACT = frozenset((*STATES, *COUNTS))  # columns of a compiled method that must agree bit by bit
SHOWN = 3  # so many reasons, or names of what is absent, are listed


@dataclass
class Verification:
    stored: Counter[str] = field(default_factory=Counter)  # all stored cells, by `sources.judge`
    cells: int = 0
    identical: int = 0
    close: int = 0  # within the tolerance
    # each with its experiment, cell, columns as in `ComparedCells`, and sources: what `sources.judge` says of the stored cell
    changed: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def verify(folder: Path | None, sample: int, seed: int, longest: float, show: bool, old: bool) -> Verification:
    """Compute a sample of stored cells again and compare their rows.

    Parameters
    ----------
    folder : of results; default: the published ones.
    sample : how many cells, taken in turn from every part and method of every experiment. seed : another seed, other cells.
    longest : s; cells that took longer are left out. old : only cells of other or unknown source code.

    Raises
    ------
    FileNotFoundError : no such results.
    StoreError : no cell can be computed again, or an experiment has another VERSION now. With `old` it is no error that all
    cells come from the present source code.
    """
    result, present, folder = Verification(), Sources(), find_results(folder)
    records = _sample(Store(folder), sample, random.Random(seed), longest, result, old, present)
    if not records and not (old and set(result.stored) == {sources.SAME} and not result.notes):
        reasons = result.notes[:SHOWN] or ["it has no cells with anything but times"]
        raise StoreError(f"no cell of {folder} was computed again: {'; '.join(reasons)}")
    if ages := sources.summary(result.stored):
        result.notes.append(ages)
    current: dict[tuple[str, str], Record] = {}
    tasks = [Task(r["experiment"], r["version"], r["position"], r["cell"]) for r in records]
    processes = workers.Local(machine.usable_cores(), limit=100 * longest)
    with progress.follow({"verify": len(records)}, show) as bar, processes as executor:
        for outcomes in workers.compute_all(tasks, executor, lambda _: bar.begin("verify")):
            for task, outcome in outcomes:
                current[task.experiment, _canonical(task.cell)] = {"cell": task.cell, **outcome}
                bar.advance("verify", False)
    result.cells = len(records)
    for record in records:
        experiment, cell = record["experiment"], record["cell"]
        times, tolerance = declared(experiment, "TIMES", ()), tolerance_of(cell.get("method"))
        word, columns = compare_cell(record, current[experiment, _canonical(cell)], times, tolerance)
        result.identical += word == "same"
        result.close += word == "close"
        if columns:
            age = sources.judge(record, present)
            result.changed.append({"experiment": experiment, "cell": cell, "columns": columns, "sources": age})
    return result


def tolerance_of(method: Any) -> Tolerance:
    compiled = isinstance(method, str) and find_stored(method, METHODS).engine == "numba"
    return lambda column: (0.0, 0.0) if compiled and column in EXACT else (RTOL, ATOLS.get(column, ATOL))


def _sample(
    store: Store, sample: int, draw: random.Random, longest: float, result: Verification, old: bool, present: Sources
) -> list[Record]:
    """Stored cells, in turn from every (experiment, part, method), in random order within each."""
    groups: dict[tuple[str, str, str], list[Record]] = {}
    absent, long = Counter[str](), 0
    for experiment in store.experiments():
        try:
            module = load_stored(experiment)
        except UnknownExperiment as error:
            result.notes.append(f"not computed: {error}")
            continue
        journal = store.open(experiment)
        result.notes += journal.problems
        if journal.latest and journal.latest[0]["version"] != module.VERSION:
            again = f"{origin.find(store.folder).run(experiment)} --again"
            raise StoreError(f"{store.folder}: {experiment} changed (VERSION) since this was stored: {again}")
        for record in journal.latest:
            cell, age = record["cell"], sources.judge(record, present)
            result.stored[age] += 1
            if old and age == sources.SAME:
                continue
            if reason := _absent(cell) or missing_package(experiment, cell):
                absent[reason] += 1
            elif record["seconds"] > longest:
                long += 1
            elif _comparable(record, getattr(module, "TIMES", ())):
                group = (experiment, str(cell.get("part", "")), str(cell.get("method") or cell.get("variant", "")))
                groups.setdefault(group, []).append(record)
    if absent:
        names = ", ".join([*absent][:SHOWN]) + (" and others" if len(absent) > SHOWN else "")
        where = "not available here (of a file of your own: --module NAME)"
        result.notes.append(f"not computed: {absent.total()} cells: {names}: {where}")
    if long:
        result.notes.append(f"not computed: {long} cells that took longer than {longest:g} s")
    for records in groups.values():
        draw.shuffle(records)
    turns = zip_longest(*groups.values())
    return [record for turn in turns for record in turn if record is not None][:sample]


def _comparable(record: Record, times: Iterable[str]) -> bool:
    """Whether a record has anything to compare but times."""
    if record["status"] == "failed":
        return record["error"]["type"] not in ("TimeLimit", workers.DIED)
    return any(not is_time(column, record["cell"], times) for row in record["rows"] for column in row)


def _absent(cell: dict[str, Any]) -> str | None:
    """The method or potential of a stored cell that cannot run here, or is somebody's own and was not imported."""
    for registry in (METHODS, POTENTIALS):
        if isinstance(name := cell.get(registry.word), str):
            try:
                record = find_stored(name, registry)
            except ValueError:
                return name
            if registry is METHODS and not available(record):
                return name
    return None
