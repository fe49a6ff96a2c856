"""Progress on stderr: bars on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

INTERVAL = 10.0  # s between two plain lines of one experiment


class Cells:
    """What is done and failed of the cells of each experiment. display : bars; without them lines are printed, if `show`."""

    def __init__(self, totals: Mapping[str, int], display: Progress | None, show: bool):
        self.totals, self.display, self.plain = totals, display, show and display is None
        self.finished, self.failed = Counter[str](), Counter[str]()
        self.last: dict[str, float] = {}  # when a line was printed
        self.tasks: dict[str, Any] = {}
        if display is not None:
            self.tasks = {name: display.add_task(name, start=False, total=n, failures="") for name, n in totals.items()}

    def begin(self, experiment: str) -> None:
        """A cell of this experiment is handed over."""
        if experiment not in self.last:
            self.last[experiment] = monotonic()
            if self.display is not None:
                self.display.start_task(self.tasks[experiment])

    def advance(self, experiment: str, failed: bool) -> None:
        """A cell of this experiment is finished."""
        self.finished[experiment] += 1
        self.failed[experiment] += failed
        done, total, now = self.finished[experiment], self.totals[experiment], monotonic()
        failures = f"{self.failed[experiment]} failed" if self.failed[experiment] else ""
        if self.display is not None:
            self.display.update(self.tasks[experiment], completed=done, failures=failures)
        elif self.plain and (done == total or now - self.last[experiment] >= INTERVAL):
            self.last[experiment] = now
            line = ", ".join(filter(None, (f"{experiment}: {done}/{total} cells", failures)))
            print(line, file=sys.stderr, flush=True)


@contextlib.contextmanager
def follow(totals: Mapping[str, int], show: bool = True) -> Iterator[Cells]:
    """What suits stderr; `totals` are the cells to compute of each experiment."""
    with _bars("[red]{task.fields[failures]}", show=show and bool(totals)) as display:
        yield Cells(totals, display, show)


@contextlib.contextmanager
def drawing(results: Path, show: bool = True) -> Iterator[Callable[[int, int], None]]:
    """A bar while something is drawn, on a terminal; then what it was drawn from. Called with (parts done, of how many)."""
    with _bars(show=show) as display:
        if display is None:
            yield lambda done, total: None
        else:
            task = display.add_task("drawing", total=None)
            yield lambda done, total: display.update(task, completed=done, total=total)
    if show:
        place = results.relative_to(Path.cwd()) if results.is_relative_to(Path.cwd()) else results
        print(f"drawn from {place}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def waiting(text: str, show: bool = True) -> Iterator[None]:
    """A text and the signs of life of a terminal, while something runs that does not say how far it is."""
    console = _terminal() if show else None
    with console.status(text) if console else contextlib.nullcontext():
        yield


@contextlib.contextmanager
def _bars(*more: str, show: bool) -> Iterator[Progress | None]:
    """Bars on stderr, if it is a terminal that can move its cursor."""
    console = _terminal() if show else None
    if console is None:
        yield None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    bar, time = BarColumn(bar_width=24), TimeRemainingColumn(elapsed_when_finished=True)
    columns = (TextColumn("{task.description}"), bar, MofNCompleteColumn(), *map(TextColumn, more), time)
    with Progress(*columns, console=console, refresh_per_second=5) as display:
        yield display


def _terminal() -> Console | None:
    if not sys.stderr.isatty():
        return None
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    return None if console.is_dumb_terminal else console
