"""Shows progress on stderr: bars on a terminal, else a line now and then."""

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from time import monotonic
from typing import Any

INTERVAL = 10.0  # s between two lines of one experiment


class Cells:
    """How many cells of each experiment are done and failed. bars : rich's `Progress`. plain : print lines, too."""

    def __init__(self, totals: Mapping[str, int], bars: Any, plain: bool):
        self.bars, self.plain = bars, plain
        self.tasks = {name: bars.add_task(name, total=n, start=False, failures="") for name, n in totals.items()}
        self.failed = Counter[str]()
        self.printed: dict[str, float] = {}  # when the last line of an experiment was

    def begin(self, experiment: str) -> None:
        if experiment not in self.printed:
            self.bars.start_task(self.tasks[experiment])
            total = self.bars.tasks[self.tasks[experiment]].total
            self._print(experiment, f"{total} cells; the first ones take longer, their methods are compiled")

    def advance(self, experiment: str, failed: bool) -> None:
        self.failed[experiment] += failed
        failures = f"{self.failed[experiment]} failed" if self.failed[experiment] else ""
        self.bars.update(self.tasks[experiment], advance=1, failures=failures)
        task = self.bars.tasks[self.tasks[experiment]]
        if task.completed == task.total or monotonic() - self.printed[experiment] >= INTERVAL:
            self._print(experiment, ", ".join(filter(None, (f"{task.completed}/{task.total} cells", failures))))

    def _print(self, experiment: str, text: str) -> None:
        self.printed[experiment] = monotonic()
        if self.plain:
            print(f"{experiment}: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def follow(totals: Mapping[str, int], show: bool = True) -> Iterator[Cells]:
    """Show progress through the cells of experiments. totals : how many cells each experiment has to compute."""
    with _bars("[red]{task.fields[failures]}", show=show and bool(totals)) as bars:
        yield Cells(totals, bars, show and bars.disable)


@contextlib.contextmanager
def drawing(show: bool = True) -> Iterator[Callable[[list[str]], Iterable[str]]]:
    """Show progress through the parts of a page: iterate over the result, called with their names."""
    with _bars(show=show) as bars:
        yield lambda names: bars.track(names, description="drawing")


@contextlib.contextmanager
def _bars(*texts: str, show: bool) -> Iterator[Any]:
    """Progress bars on stderr. They show nothing unless stderr is a terminal that can move its cursor."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    bar, time = BarColumn(bar_width=24), TimeRemainingColumn(elapsed_when_finished=True)
    columns = (TextColumn("{task.description}"), bar, MofNCompleteColumn(), *map(TextColumn, texts), time)
    console = Console(stderr=True, highlight=False)
    hidden = not show or not sys.stderr.isatty() or console.is_dumb_terminal
    with Progress(*columns, console=console, refresh_per_second=5, disable=hidden) as bars:
        yield bars
