"""Progress on stderr. Of a run: a live table with the time left on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

INTERVAL = 10.0  # s between two plain lines of one experiment
WIDE = 72  # columns of a terminal that has room for bars
NARROW = 32  # columns that the numbers take in a narrower one
TELLING = 5  # cells an estimate needs; and a tenth of all, and WARM: the first ones compile
SOON = 3.0  # s: a first cell that takes longer is being compiled, for every other one is done by then
WARM, PATIENT = 30.0, 300.0  # s before an estimate, and before one from less than a tenth of the cells


class Lines:
    """Plain lines, for logs. Also says nothing at all, with `quiet`."""

    def __init__(self, totals: Mapping[str, int], quiet: bool = False):
        self.totals, self.quiet = totals, quiet
        self.finished, self.failed = dict.fromkeys(totals, 0), dict.fromkeys(totals, 0)
        self.start: dict[str, float] = {}
        self.last: dict[str, float] = {}  # when a line was printed, or in a table a cell finished

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, experiment: str) -> None:
        """A cell of this experiment is handed over."""
        self.last.setdefault(experiment, self.start.setdefault(experiment, monotonic()))

    def advance(self, experiment: str, failed: bool) -> None:
        """A cell of this experiment is finished."""
        self.finished[experiment] += 1
        self.failed[experiment] += failed
        self.show(experiment, monotonic())

    def show(self, experiment: str, now: float) -> None:
        complete = self.finished[experiment] == self.totals[experiment]
        if not self.quiet and (complete or now - self.last[experiment] >= INTERVAL):
            self.last[experiment] = now
            print(self._line(experiment, now - self.start[experiment]), file=sys.stderr, flush=True)

    def _line(self, experiment: str, elapsed: float) -> str:
        finished, total, failed = self.finished[experiment], self.totals[experiment], self.failed[experiment]
        left = remaining(finished, total, elapsed)
        time = "" if left is None else f", about {duration(left)} left"
        failures = f", {failed} failed" if failed else ""
        return (
            f"{experiment}: {finished}/{total} cells{failures}{f', {duration(elapsed)}' if finished == total else time}"
        )


class Live(Lines):
    """A live table for a terminal: what is done, running, failed, and the time left."""

    def __init__(self, totals: Mapping[str, int], console: Console, at_a_time: int | None = None):
        from rich.live import Live as Display

        super().__init__(totals)
        self.at_a_time, self.console = at_a_time, console
        self.out: list[str] = []  # the experiments of the cells handed over, oldest first
        self.display = Display(get_renderable=self._table, console=console, refresh_per_second=5)

    def __enter__(self) -> Live:
        self.display.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.out.clear()
        self.display.stop()

    def begin(self, experiment: str) -> None:
        super().begin(experiment)
        self.out.append(experiment)

    def show(self, experiment: str, now: float) -> None:
        self.last[experiment] = now
        if experiment in self.out:
            self.out.remove(experiment)

    def _table(self) -> Table:
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        room = self.console.width
        wide = room >= WIDE
        table = Table(box=None, padding=(0, 2 if wide else 1, 0, 0), pad_edge=False, header_style="dim")
        table.add_column("experiment", no_wrap=True, overflow="ellipsis")
        if wide:
            table.add_column("")
        for name in ("done", "running", "failed", "time") if wide else ("done", "failed", "time"):
            table.add_column(name, justify="right", no_wrap=True)
        out = self.out[: self.at_a_time]
        for name, total in self.totals.items():
            done, failed = self.finished[name], self.failed[name]
            count, failures, time = f"{done}/{total}", f"[red]{failed}[/red]" if failed else "", self._time(name)
            if wide:
                bar, running = ProgressBar(total, done, width=24), str(out.count(name) or "")
                table.add_row(name, bar, count, running, failures, time)
            else:
                short = name if len(name) <= room - NARROW else f"{name[: max(room - NARROW - 1, 1)]}…"
                table.add_row(short, count, failures, time)
        return table

    def _time(self, name: str) -> str:
        """How long it took, or will take by what it took so far."""
        done, total = self.finished[name], self.totals[name]
        if name not in self.start:
            return ""
        if done == total:
            return duration(self.last[name] - self.start[name])
        elapsed = monotonic() - self.start[name]
        if not done and elapsed > SOON:
            return "compiling"
        left = remaining(done, total, elapsed)
        return duration(elapsed) if left is None else f"{duration(left)} left"


def follow(totals: Mapping[str, int], show: bool = True, at_a_time: int | None = None) -> Lines:
    """What suits stderr; `totals` are the cells to compute of each experiment, `at_a_time` how many run at once."""
    if show and totals and (console := _terminal()):
        return Live(totals, console, at_a_time)
    return Lines(totals, quiet=not show)


@contextlib.contextmanager
def drawing(results: Path, show: bool = True) -> Iterator[Callable[[int, int], None]]:
    """A bar while something is drawn, on a terminal; then what it was drawn from. Called with (parts done, of how many)."""
    console = _terminal() if show else None
    if console is None:
        yield lambda done, total: None
    else:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("drawing"), BarColumn(bar_width=24), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("", total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total)
    if show:
        place = results.relative_to(Path.cwd()) if results.is_relative_to(Path.cwd()) else results
        print(f"drawn from {place}", file=sys.stderr, flush=True)


def remaining(done: int, total: int, elapsed: float) -> float | None:
    """Seconds until the last cell, by what the first took; None if that would say little."""
    if done < TELLING or elapsed < (WARM if 10 * done >= total else PATIENT):
        return None
    return elapsed / done * (total - done)


def _terminal() -> Console | None:
    """stderr, if it is a terminal that can move its cursor."""
    if not sys.stderr.isatty():
        return None
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    return None if console.is_dumb_terminal else console


def duration(seconds: float) -> str:
    """A length of time in words: "3.2 s", "41 s", "7 min", "2 h 05 min"."""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
