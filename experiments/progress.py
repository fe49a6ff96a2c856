"""Progress of a run on stderr: a bar with the time left on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from time import monotonic

INTERVAL = 10.0  # s between two plain lines of one experiment
TELLING = 5  # cells an estimate needs: the first ones compile


class Lines:
    """Plain lines, for logs. Also says nothing at all, with `quiet`."""

    def __init__(self, totals: Mapping[str, int], quiet: bool = False):
        self.totals, self.quiet = totals, quiet
        self.finished = dict.fromkeys(totals, 0)
        self.failed = dict.fromkeys(totals, 0)
        self.start: dict[str, float] = {}
        self.printed: dict[str, float] = {}

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, experiment: str) -> None:
        """A cell of this experiment is about to be computed."""
        self.printed.setdefault(experiment, self.start.setdefault(experiment, monotonic()))

    def advance(self, experiment: str, failed: bool) -> None:
        """A cell of this experiment is finished."""
        self.finished[experiment] += 1
        self.failed[experiment] += failed
        now = monotonic()
        last = self.finished[experiment] == self.totals[experiment]
        if not self.quiet and (last or now - self.printed[experiment] >= INTERVAL):
            self.printed[experiment] = now
            print(self._line(experiment, now - self.start[experiment]), file=sys.stderr, flush=True)

    def _line(self, experiment: str, elapsed: float) -> str:
        finished, total, failed = self.finished[experiment], self.totals[experiment], self.failed[experiment]
        failures = f", {failed} failed" if failed else ""
        if finished == total:
            time = f", {duration(elapsed)}"
        elif finished < TELLING:
            time = ""
        else:
            time = f", about {duration(elapsed / finished * (total - finished))} left"
        return f"{experiment}: {finished}/{total} cells{failures}{time}"


class Bars:
    """One bar per experiment, for a terminal."""

    def __init__(self, totals: Mapping[str, int]):
        from rich import progress
        from rich.console import Console

        columns = (
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TextColumn("[red]{task.fields[failures]}"),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
        )
        self.bars = progress.Progress(*columns, console=Console(stderr=True))
        self.failed = dict.fromkeys(totals, 0)
        self.tasks = {name: self.bars.add_task(name, start=False, total=n, failures="") for name, n in totals.items()}

    def __enter__(self) -> Bars:
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def begin(self, experiment: str) -> None:
        """A cell of this experiment is about to be computed."""
        self.bars.start_task(self.tasks[experiment])

    def advance(self, experiment: str, failed: bool) -> None:
        """A cell of this experiment is finished."""
        self.failed[experiment] += failed
        failures = f"{self.failed[experiment]} failed" if self.failed[experiment] else ""
        self.bars.update(self.tasks[experiment], advance=1, failures=failures)


def follow(totals: Mapping[str, int], show: bool = True) -> Lines | Bars:
    """What suits stderr; `totals` are the cells to compute of each experiment."""
    return Bars(totals) if show and sys.stderr.isatty() else Lines(totals, quiet=not show)


def duration(seconds: float) -> str:
    """A length of time in words: "3.2 s", "41 s", "7 min", "2 h 05 min"."""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
