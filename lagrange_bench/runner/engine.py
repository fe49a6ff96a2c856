"""Runs the cells of experiments that are not stored yet, and stores each when it is done.

Accuracy cells run in parallel, here or on a cluster. Then timing cells run one at a time, always here. A cell that fails is
stored with its error. A run that was stopped in any way is continued by the same command.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from lagrange_bench.experiments import PROFILES
from lagrange_bench.experiments.catalogue import load, missing_package, with_units
from lagrange_bench.results import sources
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import ADDED, Store, cell_key, clean, failure_text, make_record
from lagrange_bench.runner import cluster, progress, workers
from lagrange_bench.runner.workers import Outcome, Task
from lagrange_bench.support import interrupts, machine
from lagrange_bench.support.output import table

TIME_LIMITS = {"quick": 300.0, "full": 3600.0}  # s for one cell; the longest take 20 s and 40 s on two idle cores
SHOWN = 10  # so many failures are listed


@dataclass
class Counts:
    """How many cells of one experiment had which outcome."""

    cells: int = 0
    computed: int = 0
    stored: int = 0  # before this run
    # stored cells that were not computed by the present sources, by `sources.compared`
    old: dict[str, int] = field(default_factory=dict)
    unavailable: int = 0  # skipped: a package is not installed here, or the run leaves out timings
    declined: int = 0  # the method declined the step, which is a result
    failed: int = 0
    seconds: float = 0.0  # sum over the cells that were computed or failed in this run


@dataclass
class Summary:
    results: Path
    profile: str
    experiments: dict[str, Counts] = field(default_factory=dict)
    failures: list[dict[str, Any]] = field(default_factory=list)  # experiment, cell, error
    notes: list[str] = field(default_factory=list)  # damaged lines, methods that are not available

    @property
    def exit_code(self) -> int:
        """1 if a cell failed by accident. A step that a method declines (StepError) is a result."""
        return 1 if any(counts.failed for counts in self.experiments.values()) else 0

    def __str__(self) -> str:
        rows: list[tuple[str, ...]] = [
            ("experiment", "cells", "computed", "stored", "skipped", "declined", "failed", "core-seconds")
        ]
        for name, t in self.experiments.items():
            numbers = (t.cells, t.computed, t.stored, t.unavailable, t.declined, t.failed)
            rows.append((name, *map(str, numbers), f"{t.seconds:.1f}"))
        lines = table(rows)
        for each in self.failures[:SHOWN]:
            cell = json.dumps(with_units(each["experiment"], each["cell"]))
            lines.append(f"{_word(each['error'])}: {each['experiment']} {cell}: {each['error']}")
        if len(self.failures) > SHOWN:
            lines.append(f"… and {len(self.failures) - SHOWN} more")
        for name, t in self.experiments.items():
            ages = {**t.old, sources.SAME: t.stored - sum(t.old.values())}
            lines += [f"old: {name}: {sources.summary(ages)}"] if t.old else []
        return "\n".join([*lines, *self.notes, f"results: {self.results}"])

    @property
    def old(self) -> bool:
        """Whether some stored cells do not come from the present sources, or may not."""
        return any(counts.old for counts in self.experiments.values())


def run(
    experiments: Sequence[str],
    profile: str,
    results: str | Path,
    jobs: int | None = None,
    show: bool = True,
    *,
    time_limit: float | None = None,
    scheduler: str | None = None,
    timings: bool = True,
    again: bool = False,
    choice: Choice = ALL,
    cells: Mapping[str, Sequence[dict[str, Any]]] | None = None,
) -> Summary:
    """Compute the cells of experiments that are not stored in `results` yet.

    Parameters
    ----------
    experiments : names in EXPERIMENTS, or dotted paths of modules. profile : "quick" or "full".
    jobs : worker processes; default: one per usable core. show : progress on stderr.
    time_limit : s; a cell that takes longer fails. Default: TIME_LIMITS[profile].
    scheduler : of Dask, "tcp://host:port" or "local:N". Accuracy cells are computed there, timing cells never.
    timings : whether to compute timing cells.
    again : also compute stored cells of other or unknown sources.
    choice : only cells of these methods and tops. cells : of an experiment, in place of the cells of its profile.

    Raises
    ------
    ValueError : no such experiment, scheduler, method or top.
    StoreError : `results` cannot be written or read; nothing is lost.
    ClusterError : the scheduler went away, or its workers would give other rows.
    KeyboardInterrupt : Ctrl-C. The workers have ended, finished cells are stored, and the message says so.
    """
    limit = TIME_LIMITS[profile] if time_limit is None else time_limit
    store, summary = Store(results), Summary(Path(results), profile)
    grids = {name: (cells or {}).get(name) or load(name).cells(profile) for name in experiments}
    choice.check(cell for grid in grids.values() for cell in grid)
    if profile == PROFILES[0] and cells is None and not choice.methods:
        grids = {name: _without_archive(grid) for name, grid in grids.items()}
    files = sources.Sources()  # as they are when the run begins
    plan = {name: _missing(name, grid, choice, files, store, summary, timings, again) for name, grid in grids.items()}
    tasks = [task for missing in plan.values() for task in missing]
    timed = [task for task in tasks if task.cell.get("timing")]
    others = [task for task in tasks if not task.cell.get("timing")]
    pool = cluster.Cluster(scheduler, limit) if scheduler else workers.Local(jobs or machine.usable_cores(), limit)
    with progress.follow({name: len(missing) for name, missing in plan.items() if missing}, show) as bar:
        try:
            for part, executor in ((others, pool), (timed, workers.Local(1, limit))):
                if part:
                    with executor:
                        for outcomes in workers.compute_all(part, executor, bar.begin):
                            _keep(outcomes, store, summary, bar)
        except KeyboardInterrupt:
            stored = sum(counts.stored + counts.computed for counts in summary.experiments.values())
            wanted = sum(counts.cells - counts.unavailable for counts in summary.experiments.values())
            message = f"interrupted: {stored} of {wanted} cells are stored in {summary.results}"
            raise KeyboardInterrupt(f"{message}; run the same command again to resume") from None
    return summary


def _without_archive(cells: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The cells of the methods that a quick run measures; the orders, which take no time, are those of all."""
    from lagrange_bench.integrators.registry import without_archive  # with NumPy: `--help` does not wait for it

    methods = {None, *without_archive(cell["method"] for cell in cells if "method" in cell)}
    return [cell for cell in cells if cell.get("method") in methods or cell.get("part") == "order"]


def _missing(
    experiment: str,
    cells: Sequence[dict[str, Any]],
    choice: Choice,
    files: sources.Sources,
    store: Store,
    summary: Summary,
    timings: bool,
    again: bool,
) -> list[Task]:
    """The cells to compute now. The others are counted in the summary.

    Raises
    ------
    ValueError : two cells are equal, or a field has a name the store adds.
    """
    module = load(experiment)
    counts = summary.experiments[experiment] = Counts()
    journal = store.open(experiment)
    done = journal.done()
    summary.notes += journal.problems
    keys, tasks = set(), []
    for position, cell in enumerate(map(clean, cells)):
        if not choice.takes(cell):
            continue
        counts.cells += 1
        digests = sources.of_cell(experiment, cell, files).digests
        key = cell_key(experiment, module.VERSION, cell, digests.get("own_sources"))
        if key in keys:
            raise ValueError(f"experiment {experiment!r} lists the cell {cell} twice")
        if reserved := set(ADDED) & set(cell):
            field = f"experiment {experiment!r}: cell field {reserved.pop()!r}"
            raise ValueError(f"{field}: this name is reserved by the store")
        keys.add(key)
        age = sources.compared(done.get(key), digests["sources"])
        if key in done and (age == sources.SAME or not again):
            counts.stored += 1
            if age != sources.SAME:
                counts.old[age] = counts.old.get(age, 0) + 1
        elif reason := _unavailable(experiment, cell, timings):
            counts.unavailable += 1
            if (note := f"skipped: {reason}") not in summary.notes:
                summary.notes.append(note)
        else:
            tasks.append(Task(experiment, module.VERSION, position, cell))
    return tasks


def _unavailable(experiment: str, cell: Mapping[str, Any], timings: bool) -> str | None:
    """Why a cell cannot be computed here, or is not to be; None if it can."""
    if package := _missing_package(cell.get("method")) or missing_package(experiment, cell):
        return f"{cell.get('method', f'a part of {experiment}')} needs {package}, which is not installed here"
    if cell.get("timing") and not timings:
        return f"the timing cells of {experiment}, as asked"
    return None


@cache
def _missing_package(method: Any) -> str | None:
    """The package that a method needs and that is not installed here; None if there is none."""
    from lagrange_bench.integrators.registry import METHODS, available

    with suppress(Exception):  # no method, an unknown or a broken one: such cells fail, each with the reason
        if not available(method := METHODS[method]):
            return method.requires
    return None


def _word(error: str) -> str:
    """Either "declined", if the method declined the step, or "failed"."""
    return "declined" if error.startswith("StepError:") else "failed"


def _keep(outcomes: Sequence[tuple[Task, Outcome]], store: Store, summary: Summary, bar: progress.Cells) -> None:
    """Store and count what was computed."""
    with interrupts.interrupt_held_back():  # a cell is both stored and counted, or neither
        store.append(*(make_record(t.experiment, t.version, t.position, t.cell, **o) for t, o in outcomes))
        words = [_count(summary, task, outcome) for task, outcome in outcomes]
    for (task, _), word in zip(outcomes, words, strict=True):
        bar.advance(task.experiment, word == "failed")


def _count(summary: Summary, task: Task, outcome: Outcome) -> str:
    """Count a cell, and return as what."""
    counts, word = summary.experiments[task.experiment], "computed"
    if outcome["error"]:
        error = failure_text(outcome["error"])
        word = _word(error)
        summary.failures.append({"experiment": task.experiment, "cell": task.cell, "error": error})
    counts.seconds += outcome["seconds"]
    setattr(counts, word, getattr(counts, word) + 1)
    return word
