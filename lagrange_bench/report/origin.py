"""What a page was drawn from, in words, and in commands that do not depend on where the page was built."""

import os
import shlex
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from lagrange_bench.results import provenance
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import REFERENCE, name_of


@dataclass(frozen=True)
class Origin:
    """A folder of results, and the profile it was computed with, if the name of the folder says it."""

    folder: str  # as commands name it: reference, quick or full, or a path
    profile: str | None = None
    choice: Choice = ALL  # of what is stored there

    @property
    def option(self) -> str:
        """What `report` and `figure` need to draw it."""
        results = "" if self.folder == REFERENCE.name else f" --results {shlex.quote(self.folder)}"
        return results + self.choice.words

    def run(self, experiment: str) -> str:
        """The command that computes an experiment like this."""
        results = f"--profile {self.profile}" if self.profile else f"--results {shlex.quote(self.folder)}"
        return f"lagrange-bench run {shlex.quote(experiment)} {results}{self.choice.words}"

    @property
    def report(self) -> str:
        """The command that draws what `run` computed. The published results are never written to."""
        return f"lagrange-bench report --results {shlex.quote(self.profile or self.folder)}{self.choice.words}"


PUBLISHED = Origin(REFERENCE.name, "full")


def find(folder: Path, choice: Choice = ALL) -> Origin:
    """The origin of what is stored in a folder: its name, or its path from the current folder or the clone.

    Of a folder elsewhere, a page tells only the last part of the path.
    """
    name = name_of(folder)
    if name == PUBLISHED.folder:
        return replace(PUBLISHED, choice=choice)
    place = Path(os.path.abspath(folder))
    bases = (base for base in (Path.cwd(), provenance.checkout()) if base is not None and place.is_relative_to(base))
    shown_path = next((place.relative_to(base).as_posix() for base in bases), place.name)
    return Origin(name or shown_path, name, choice)


def described(origin: Origin) -> str:
    """Folder, profile and choice in one line."""
    words = [origin.folder, *([f"{origin.profile} profile"] if origin.profile else [])]
    chosen = {"methods": origin.choice.methods, "tops": origin.choice.tops}
    return "; ".join(words + [f"only the {word} {', '.join(names)}" for word, names in chosen.items() if names])


def days(cells: pd.DataFrame) -> str:
    """When: a day, or the first and the last."""
    return " to ".join(sorted({cells["utc"].min()[:10], cells["utc"].max()[:10]}))


def commits(cells: pd.DataFrame) -> pd.Series:
    """The commit of each cell, short, and whether the tree had changes."""
    return cells["commit"].fillna("unknown").str.slice(0, 12) + cells["dirty"].map({True: " with changes"}).fillna("")
