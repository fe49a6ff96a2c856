"""Shows progress on stderr: a line now and then."""

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import monotonic

INTERVAL = 10.0  # s between two lines of one experiment


class Progress:
    """How many cells of each experiment are done and failed. totals : how many each has to compute."""

    def __init__(self, totals: Mapping[str, int], show: bool):
        self.totals, self.show = totals, show
        self.done, self.failed = Counter[str](), Counter[str]()
        self.printed: dict[str, float] = {}  # when the last line of an experiment was

    def begin(self, experiment: str) -> None:
        if experiment not in self.printed:
            self._print(
                experiment, f"{self.totals[experiment]} cells; the first ones take longer, methods are compiled"
            )

    def advance(self, experiment: str, failed: bool) -> None:
        self.done[experiment] += 1
        self.failed[experiment] += failed
        done, total, failures = self.done[experiment], self.totals[experiment], self.failed[experiment]
        if done == total or monotonic() - self.printed[experiment] >= INTERVAL:
            self._print(experiment, f"{done}/{total} cells" + (f", {failures} failed" if failures else ""))

    def _print(self, experiment: str, text: str) -> None:
        self.printed[experiment] = monotonic()
        if self.show:
            print(f"{experiment}: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def drawing(results: Path, show: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Say how many parts of a page are drawn, then where its rows come from. Call the result with (done, total)."""

    def advance(done: int, total: int) -> None:
        if show and done == 0:
            print(f"drawing {total} parts", file=sys.stderr, flush=True)

    yield advance
    if show:
        place = results.relative_to(Path.cwd()) if results.is_relative_to(Path.cwd()) else results
        print(f"drawn from {place}", file=sys.stderr, flush=True)
