"""What a page was drawn from, in words, and in commands that do not depend on where the page was built."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pandas as pd

from lagrange_bench.experiments import PROFILES
from lagrange_bench.experiments.catalogue import load_stored
from lagrange_bench.results import provenance
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import REFERENCE, Record, _canonical, clean, default_results, name_of


@dataclass(frozen=True)
class Origin:
    """A folder of results, and the profile it was computed with, if that is known."""

    folder: str  # as commands name it: reference, quick or full, or a path
    profile: str | None = None
    default: bool = False  # the one that is drawn if nobody says which
    choice: Choice = ALL  # of what is stored there

    @property
    def option(self) -> str:
        """What `report` and `figure` need to draw it."""
        return self._results_option + self.choice.words

    @property
    def _results_option(self) -> str:
        return "" if self.default else f" --results {shlex.quote(self.folder)}"

    def run(self, experiment: str) -> str:
        """The command that computes an experiment like this."""
        profile = "" if self.profile is None else f" --profile {self.profile}"
        usual = self.folder == named(default_results(self.profile or PROFILES[0]))
        folder = "" if self.default or usual else self._results_option
        return f"lagrange-bench run {shlex.quote(experiment)}{profile}{folder}{self.choice.words}"

    @property
    def report(self) -> str:
        """The command that draws what `run` computed. The published results are never written to."""
        if self.default and self.profile is not None:
            return f"lagrange-bench report --results {shlex.quote(named(default_results(self.profile)))}{self.choice.words}"
        return f"lagrange-bench report{self.option}"

    def reaching(self, profile: str) -> Origin:
        """This origin, or the folder of a larger profile: two profiles in one folder would be drawn into one figure."""
        return self if profile in (PROFILES[0], self.profile) else Origin(named(default_results(profile)), profile)


PUBLISHED = Origin(REFERENCE.name, "full", default=True)


def named(folder: Path) -> str:
    """The name of results, or a folder as seen from the current folder or the clone; of any other only its own name."""
    if name := name_of(folder):
        return name
    place = Path(os.path.abspath(folder))
    for base in (Path.cwd(), provenance.checkout()):
        if base is not None and place.is_relative_to(base):
            return place.relative_to(base).as_posix()
    return place.name


def find(folder: Path, profiles: Sequence[Collection[str] | None]) -> Origin:
    """The origin of what is stored in a folder. profiles : of each experiment there; see `profiles_of`."""
    name, default = named(folder), os.path.abspath(folder) == os.path.abspath(default_results())
    if default and name == PUBLISHED.folder:
        return PUBLISHED
    known, word = [set(some) for some in profiles if some is not None], Path(name).name
    possible = set.intersection(*known) if known else {word}
    likely = [profile for profile in (word, *PROFILES) if profile in PROFILES and profile in possible]
    return Origin(name, likely[0] if likely else None, default)


def profiles_of(module: ModuleType, records: Sequence[Record]) -> tuple[str, ...] | None:
    """The profiles that have all stored cells; None if the experiment cannot list its cells."""
    stored = {_canonical(record["cell"]) for record in records}
    try:
        return tuple(p for p in PROFILES if stored <= {_canonical(clean(cell)) for cell in module.cells(p)})
    except Exception:  # somebody's own, perhaps of another version: no reason to lose the page
        return None


def again(folder: Path, experiment: str, records: Sequence[Record]) -> str:
    """The command that computes again the stored cells of an experiment in a folder."""
    return f"{find(folder, [profiles_of(load_stored(experiment), records)]).run(experiment)} --again"


def described(origin: Origin, sources: Sequence[pd.DataFrame]) -> str:
    """Folder, profile, dates, machine and commit in one line. sources : provenance of each experiment."""
    words = [origin.folder, *([f"{origin.profile} profile"] if origin.profile else [])]
    chosen = {"methods": origin.choice.methods, "tops": origin.choice.tops}
    words += [f"only the {what} {', '.join(names)}" for what, names in chosen.items() if names]
    if stored := [source for source in sources if len(source)]:
        cells = pd.concat(stored, ignore_index=True)
        words += [days(cells), _few(cells["cpu"].dropna(), "", "machines"), _few(commits(cells), "commit ", "commits")]
    return "; ".join(filter(None, words))


def days(cells: pd.DataFrame) -> str:
    """When: a day, or the first and the last."""
    return " to ".join(sorted({cells["utc"].min()[:10], cells["utc"].max()[:10]}))


def commits(cells: pd.DataFrame) -> pd.Series:
    """The commit of each cell, short, and whether the tree had changes."""
    return cells["commit"].fillna("unknown").str.slice(0, 12) + cells["dirty"].map({True: " with changes"}).fillna("")


def _few(values: pd.Series, before: str, what: str) -> str:
    different = sorted(set(values))
    return f"{len(different)} {what}" if len(different) > 2 else before + ", ".join(different)
