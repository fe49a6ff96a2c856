"""Shows progress on stderr: bars on a terminal, else a line now and then."""

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import Any

INTERVAL = 10.0  # s between two lines of one experiment


class Cells:
    """How many cells of each experiment are done and failed. bars : rich's `Progress`. plain : print lines, too."""

    def __init__(self, totals: Mapping[str, int], bars: Any, plain: bool):
        self.bars, self.plain = bars, plain
        many = [f" ({i} of {len(totals)})" if len(totals) > 1 else "" for i in range(1, len(totals) + 1)]
        self.titles = {name: f"{name}{place}" for name, place in zip(totals, many, strict=True)}
        more = {"start": False, "failures": ""}
        self.tasks = {name: bars.add_task(self.titles[name], total=n, **more) for name, n in totals.items()}
        self.failed = Counter[str]()
        self.last: dict[str, float] = {}  # when a line was printed
        # at the first line after a fifth of all cells: the time, and how many were done
        self.fifth: tuple[float, float] | None = None

    def begin(self, experiment: str) -> None:
        if experiment not in self.last:
            self.last[experiment] = monotonic()
            self.bars.start_task(self.tasks[experiment])
            if self.plain:
                count = f"{self.titles[experiment]}: {self.bars.tasks[self.tasks[experiment]].total} cells"
                text = f"{count}; the first ones take longer, their methods are compiled"
                print(text, file=sys.stderr, flush=True)

    def advance(self, experiment: str, failed: bool) -> None:
        self.failed[experiment] += failed
        failures = f"{self.failed[experiment]} failed" if self.failed[experiment] else ""
        self.bars.update(self.tasks[experiment], advance=1, failures=failures)
        task, now = self.bars.tasks[self.tasks[experiment]], monotonic()
        if self.plain and (task.completed == task.total or now - self.last[experiment] >= INTERVAL):
            self.last[experiment] = now
            words = f"{self.titles[experiment]}: {task.completed}/{task.total} cells", failures, self._left(now)
            print(", ".join(filter(None, words)), file=sys.stderr, flush=True)

    def _left(self, now: float) -> str:
        """How long all experiments will still take, if the other cells take as long as those done after the first fifth.

        In the first fifth methods are compiled.
        """
        done, total = (sum(getattr(task, name) for task in self.bars.tasks) for name in ("completed", "total"))
        if self.fifth is None:
            self.fifth = (now, done) if done > total / 5 else None
            return ""
        begun, before = self.fifth
        minutes = (now - begun) * (total - done) / (done - before) / 60
        return f"about {minutes:.0f} min left" if minutes >= 1 else ""


@contextlib.contextmanager
def follow(totals: Mapping[str, int], show: bool = True) -> Iterator[Cells]:
    """Show progress through the cells of experiments. totals : how many cells each experiment has to compute."""
    with _bars("[red]{task.fields[failures]}", show=show and bool(totals)) as bars:
        yield Cells(totals, bars, show and bars.disable)


@contextlib.contextmanager
def drawing(results: Path, show: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Show progress through the parts of a page, then where its rows come from. Call the result with (done, total)."""
    with _bars(show=show) as bars:
        task = bars.add_task("drawing", total=None)

        def advance(done: int, total: int) -> None:
            if show and bars.disable and bars.tasks[task].total is None:
                print(f"drawing {total} parts", file=sys.stderr, flush=True)
            bars.update(task, completed=done, total=total)

        yield advance
    if show:
        place = results.relative_to(Path.cwd()) if results.is_relative_to(Path.cwd()) else results
        print(f"drawn from {place}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def waiting(text: str, show: bool = True) -> Iterator[None]:
    """Show a text and a spinner, while something runs that does not say how far it is."""
    console = _console(show)
    with contextlib.nullcontext() if console.quiet else console.status(text):
        yield


@contextlib.contextmanager
def _bars(*more: str, show: bool) -> Iterator[Any]:
    """Progress bars on stderr. They show nothing unless stderr is a terminal that can move its cursor."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    bar, time = BarColumn(bar_width=24), TimeRemainingColumn(elapsed_when_finished=True)
    columns = (TextColumn("{task.description}"), bar, MofNCompleteColumn(), *map(TextColumn, more), time)
    console = _console(show)
    with Progress(*columns, console=console, refresh_per_second=5, disable=console.quiet) as bars:
        yield bars


def _console(show: bool) -> Any:
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    console.quiet = not show or not sys.stderr.isatty() or console.is_dumb_terminal
    return console
