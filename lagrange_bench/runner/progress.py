"""Progress on stderr: bars on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

INTERVAL = 10.0  # s between two plain lines of one experiment


class Lines:
    """Plain lines, for logs; none with `quiet`."""

    def __init__(self, totals: Mapping[str, int], quiet: bool = False):
        self.totals, self.quiet = totals, quiet
        self.finished, self.failed = Counter[str](), Counter[str]()
        self.last: dict[str, float] = {}  # when a line was printed

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, experiment: str) -> None:
        """A cell of this experiment is handed over."""
        self.last.setdefault(experiment, monotonic())

    def advance(self, experiment: str, failed: bool) -> None:
        """A cell of this experiment is finished."""
        self.finished[experiment] += 1
        self.failed[experiment] += failed
        self.show(experiment)

    def show(self, experiment: str) -> None:
        done, total, now = self.finished[experiment], self.totals[experiment], monotonic()
        if not self.quiet and (done == total or now - self.last[experiment] >= INTERVAL):
            self.last[experiment] = now
            print(f"{experiment}: {done}/{total} cells{self.failures(experiment)}", file=sys.stderr, flush=True)

    def failures(self, experiment: str) -> str:
        failed = self.failed[experiment]
        return f", {failed} failed" if failed else ""


class Bars(Lines):
    """A bar for each experiment, on a terminal: what is done and failed, and the time left."""

    def __init__(self, totals: Mapping[str, int], console: Console):
        super().__init__(totals)
        self.display = _progress(console, "[red]{task.fields[failures]}")
        self.tasks = {
            name: self.display.add_task(name, start=False, total=total, failures="") for name, total in totals.items()
        }

    def __enter__(self) -> Bars:
        self.display.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.display.stop()

    def begin(self, experiment: str) -> None:
        if experiment not in self.last:
            self.display.start_task(self.tasks[experiment])
        super().begin(experiment)

    def show(self, experiment: str) -> None:
        failures = self.failures(experiment).lstrip(", ")
        self.display.update(self.tasks[experiment], completed=self.finished[experiment], failures=failures)


def follow(totals: Mapping[str, int], show: bool = True) -> Lines:
    """What suits stderr; `totals` are the cells to compute of each experiment."""
    if show and totals and (console := _terminal()):
        return Bars(totals, console)
    return Lines(totals, quiet=not show)


@contextlib.contextmanager
def drawing(results: Path, show: bool = True) -> Iterator[Callable[[int, int], None]]:
    """A bar while something is drawn, on a terminal; then what it was drawn from. Called with (parts done, of how many)."""
    console = _terminal() if show else None
    if console is None:
        yield lambda done, total: None
    else:
        with _progress(console) as bar:
            task = bar.add_task("drawing", total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)
    if show:
        place = results.relative_to(Path.cwd()) if results.is_relative_to(Path.cwd()) else results
        print(f"drawn from {place}", file=sys.stderr, flush=True)


def _progress(console: Console, *more: str) -> Progress:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    bar, time = BarColumn(bar_width=24), TimeRemainingColumn(elapsed_when_finished=True)
    columns = (TextColumn("{task.description}"), bar, MofNCompleteColumn(), *map(TextColumn, more), time)
    return Progress(*columns, console=console, refresh_per_second=5)


def _terminal() -> Console | None:
    """stderr, if it is a terminal that can move its cursor."""
    if not sys.stderr.isatty():
        return None
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    return None if console.is_dumb_terminal else console
