"""Runs what is missing of an experiment's cells and stores each as it is finished.

Accuracy cells in parallel, then timing cells one at a time. A cell that fails becomes a record with its error; a run
that is stopped, in whatever way, is continued by the same command.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from experiments import EXPERIMENTS, load, progress, provenance, workers
from experiments.store import ADDED, Store, StoreError, cell_key, clean, default_results, make_record
from experiments.workers import Outcome, Task

__all__ = ["EXPERIMENTS", "PROFILES", "Summary", "Tally", "load", "main", "run"]

PROFILES = ("quick", "full")


@dataclass
class Tally:
    """What became of the cells of one experiment."""

    cells: int = 0
    computed: int = 0
    stored: int = 0  # before this run
    unavailable: int = 0  # their method needs a package that is not installed here
    failed: int = 0
    seconds: float = 0.0  # sum over the cells computed or failed now


@dataclass
class Summary:
    """What a run did."""

    results: Path
    profile: str
    tallies: dict[str, Tally] = field(default_factory=dict)
    failures: list[tuple[str, dict[str, Any], str]] = field(default_factory=list)  # experiment, cell, error
    notes: list[str] = field(default_factory=list)  # damaged lines, methods that are not available

    @property
    def exit_code(self) -> int:
        """1 if a cell failed by accident. A method that refuses (StepError) is a result: it is drawn and told."""
        return 1 if any(not error.startswith("StepError:") for _, _, error in self.failures) else 0

    def as_dict(self) -> dict[str, Any]:
        """JSON-able."""
        failures = [{"experiment": name, "cell": cell, "error": error} for name, cell, error in self.failures]
        tallies = {name: asdict(tally) for name, tally in self.tallies.items()}
        head = {"results": str(self.results), "profile": self.profile, "exit_code": self.exit_code}
        return {**head, "experiments": tallies, "failures": failures, "notes": self.notes}

    def __str__(self) -> str:
        lines = [
            f"{'experiment':<16}{'cells':>7}{'computed':>10}{'stored':>8}{'skipped':>9}{'failed':>8}{'seconds':>10}"
        ]
        for name, t in self.tallies.items():
            counts = f"{t.cells:>7}{t.computed:>10}{t.stored:>8}{t.unavailable:>9}{t.failed:>8}{t.seconds:>10.1f}"
            lines.append(f"{name:<16}{counts}")
        lines += [f"failed: {name} {json.dumps(cell)}: {error}" for name, cell, error in self.failures[:10]]
        if len(self.failures) > 10:
            lines.append(f"… and {len(self.failures) - 10} more")
        return "\n".join([*lines, *self.notes, f"results: {self.results}"])


def run(
    experiments: Sequence[str], profile: str, results: str | Path, jobs: int | None = None, show: bool = True
) -> Summary:
    """Computes the cells of some experiments that are not stored in `results` yet.

    Parameters
    ----------
    experiments : names in EXPERIMENTS, or dotted paths of modules. profile : "quick" or "full".
    jobs : worker processes; default: one per usable core. show : progress on stderr.

    Raises
    ------
    ValueError : no such experiment or profile. StoreError : `results` cannot be written or read; nothing is lost.
    KeyboardInterrupt : Ctrl-C; the workers are gone, what was finished is stored, and stderr says so.
    """
    if profile not in PROFILES:
        raise ValueError(f"profile must be one of {', '.join(PROFILES)}; got {profile!r}")
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs must be at least 1; got {jobs}")
    store, summary = Store(results), Summary(Path(results), profile)
    tasks = [_tasks(name, profile) for name in dict.fromkeys(experiments)]
    store.check_writable()  # before anything is computed
    missing = [task for listed in tasks for task in _missing(listed, store, summary)]
    totals = {name: sum(task.experiment == name for task in missing) for name in summary.tallies}
    with progress.follow({name: total for name, total in totals.items() if total}, show) as bar:

        def begin(task: Task) -> None:
            bar.begin(task.experiment)

        def finish(task: Task, outcome: Outcome) -> None:
            with workers.interrupt_held_back():  # stored and counted, or neither
                store.append(make_record(task.experiment, task.version, task.position, task.cell, **outcome))
                _count(summary, task, outcome)
            bar.advance(task.experiment, outcome["status"] == "failed")

        try:
            accuracy = [task for task in missing if not task.cell.get("timing")]
            workers.compute_all(accuracy, jobs or provenance.usable_cores(), begin, finish)
            workers.compute_all([task for task in missing if task.cell.get("timing")], 1, begin, finish)
        except KeyboardInterrupt:
            finished = sum(tally.computed for tally in summary.tallies.values())
            message = f"\ninterrupted: {finished} of {len(missing)} cells are stored in {summary.results}"
            print(f"{message}; run the same command again to resume", file=sys.stderr, flush=True)
            raise
    return summary


def _tasks(experiment: str, profile: str) -> list[Task]:
    """The cells of an experiment, in its order.

    Raises
    ------
    ValueError : two cells are equal, or a field has a name the store adds.
    """
    module = load(experiment)
    cells = [clean(cell) for cell in module.cells(profile)]
    seen = set()
    for cell in cells:
        key = cell_key(experiment, module.VERSION, cell)
        if key in seen:
            raise ValueError(f"experiment {experiment!r} lists the cell {cell} twice")
        if taken := set(ADDED) & set(cell):
            raise ValueError(f"experiment {experiment!r}: cell field {taken.pop()!r}: the store has one of this name")
        seen.add(key)
    return [Task(experiment, module.VERSION, position, cell) for position, cell in enumerate(cells)]


def _missing(tasks: list[Task], store: Store, summary: Summary) -> list[Task]:
    """Of the tasks of one experiment those to compute now; enters the others in the summary."""
    if not tasks:
        return []
    experiment = tasks[0].experiment
    tally = summary.tallies[experiment] = Tally(cells=len(tasks))
    records, problems = store.read(experiment)
    summary.notes += problems
    done = {record["key"] for record in records if record["status"] == "done"}
    missing = []
    for task in tasks:
        if cell_key(experiment, task.version, task.cell) in done:
            tally.stored += 1
        elif package := _lacks(task.cell.get("method")):
            tally.unavailable += 1
            note = f"skipped: {task.cell['method']} needs {package}, which is not installed here"
            summary.notes += [note] if note not in summary.notes else []
        else:
            missing.append(task)
    return missing


@cache
def _lacks(method: str | None) -> str | None:
    """The package a method needs and this machine has not."""
    if method is None:
        return None
    from integrators.registry import METHODS, available

    try:
        found = METHODS[method]
    except Exception:  # unknown or broken: its cells fail, each with the reason
        return None
    return None if available(found) else found.requires


def _count(summary: Summary, task: Task, outcome: Outcome) -> None:
    tally = summary.tallies[task.experiment]
    tally.seconds += outcome["seconds"]
    if outcome["status"] == "done":
        tally.computed += 1
    else:
        tally.failed += 1
        error = outcome["error"]
        summary.failures.append((task.experiment, task.cell, f"{error['type']}: {error['message']}"))


# ---------------------------------------------------------------- python -m experiments.<name>


def main(name: str, argv: Sequence[str] | None = None) -> int:
    """Command line of one experiment: run what is missing, then draw. Exit code 1: cells failed, 2: no such folder."""
    first_line = (load(name).__doc__ or name).strip().splitlines()[0]
    parser = argparse.ArgumentParser(prog=f"python -m {load(name).__name__}", description=first_line)
    parser.add_argument("--profile", choices=PROFILES, default="quick")
    parser.add_argument("--results", type=Path, metavar="DIR", help="where results are stored and looked for")
    parser.add_argument("--output", type=Path, metavar="DIR", help="where figures go (default: report in --results)")
    parser.add_argument("--jobs", type=_count_argument, metavar="N", help="worker processes (default: one per core)")
    parser.add_argument("--redraw-only", action="store_true", help="compute nothing, draw what is stored")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    options = parser.parse_args(argv)
    results = options.results or default_results(options.profile)
    code = 0
    try:
        if not options.redraw_only:
            summary = run([name], options.profile, results, options.jobs)
            print(summary, file=sys.stderr)
            if options.json:
                print(json.dumps(summary.as_dict()))
            code = summary.exit_code
        _draw(name, results, options.output or results / "report")
    except StoreError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return code


def _count_argument(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1; got {count}")
    return count


def _draw(name: str, results: Path, output: Path) -> None:
    """Figures and tables of what is stored, by the report if it is installed."""
    try:
        from report import page
    except ImportError as error:
        print(f"no figures: {error}", file=sys.stderr)
        return
    if not Store(results).latest(name):
        raise StoreError(f"nothing of {name} is stored in {results}: run it first, or give its folder with --results")
    for path in page.write_experiment(name, results, output):
        print(f"written: {path}", file=sys.stderr)
