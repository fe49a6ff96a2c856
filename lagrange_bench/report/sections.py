"""One experiment as it is stored and drawn: from its journal to a section of the page, and to files."""

import base64
import gzip
import os
import re
import shlex
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import pandas as pd
from markupsafe import Markup

from lagrange_bench.experiments.catalogue import UnknownExperiment, load_stored
from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.experiments.measuring.reductions import with_failures
from lagrange_bench.report import origin
from lagrange_bench.report.origin import PUBLISHED, Origin, commits, days
from lagrange_bench.results import sources
from lagrange_bench.results.store import Store, StoreError
from lagrange_bench.support.files import write_file

DECLINED = "StepError: "  # how the failure of a method begins that declines a step
OPENED = ("phase_h", "work_precision_time", "phase_time")  # figures that are not folded, in this order
# of each experiment the rows that tables were made of last, and these tables
_TABLES: dict[str, tuple[pd.DataFrame, dict[str, pd.DataFrame]]] = {}


@dataclass
class DrawnFigure:
    name: str
    document: str
    caption: str
    headline: str = ""  # what it shows, in a few words
    phone: str = ""  # the document of a drawing for a narrow screen, if there is one


class DrawnTable(NamedTuple):
    name: str
    frame: pd.DataFrame
    caption: str


@dataclass
class Section:
    """One experiment as stored and drawn."""

    experiment: str
    title: str = ""
    about: str = ""
    module: ModuleType | None = None  # None: it cannot be loaded here
    rows: pd.DataFrame = field(default_factory=pd.DataFrame)
    packed: str = ""  # the rows as CSV with every digit, see `packed`
    figures: list[DrawnFigure] = field(default_factory=list)
    tables: list[DrawnTable] = field(default_factory=list)
    provenance: pd.DataFrame = field(default_factory=pd.DataFrame)
    origin: Origin = PUBLISHED
    source_ages: Counter[str] = field(default_factory=Counter)  # of the cells: see `Journal.source_ages`
    notes: list[str] = field(default_factory=list)  # damaged lines of the journal
    errors: list[str] = field(default_factory=list)  # of the drawing

    @property
    def absent(self) -> bool:
        """Whether nothing of the experiment is stored, and there is no error and no note to show."""
        return self.rows.empty and not self.errors and not self.notes

    @property
    def without_rows(self) -> list[str]:
        """The chosen methods that are not among its rows."""
        return [name for name in self.origin.choice.methods if name not in set(self.rows.get("method", ()))]

    @property
    def command(self) -> str:
        """The command that computes the section."""
        return self.origin.run(self.experiment)

    def redraw(self, figure: str) -> str:
        """The command that draws one of its figures from the same rows."""
        return f"lagrange-bench figure {self.file(figure)}{self.origin.option}{self._module}"

    @property
    def _module(self) -> str:
        """The options that import the user's own modules again, if they were imported for this page."""
        named = [str(name) for word in ("method", "potential") for name in self.rows.get(word, ())]
        modules = [name.partition(":")[0] for name in named if ":" in name]
        modules = [name for name in modules if name in sys.modules]
        if "." in self.experiment:
            modules.insert(0, self.experiment)
        chosen = {name.partition(":")[0] for name in self.origin.choice.methods}
        return "".join(f" --module {shlex.quote(name)}" for name in dict.fromkeys(modules) if name not in chosen)

    @property
    def measured(self) -> str:
        """How many cells there are, when and how long they were computed, and from which commit."""
        p = self.provenance
        if p.empty:
            return ""
        kinds = {"declined": len(self.ended(declined=True)), "failed": len(self.ended(declined=False))}
        ends = "".join(f", {count} {word}" for word, count in kinds.items() if count)
        seconds = tables.show(float(p["seconds"].sum()))
        return f"{len(p)} cells{ends}; {days(p)}, {seconds} s of computing; commit {', '.join(sorted(set(commits(p))))}"

    @property
    def old(self) -> str:
        """How many cells come from other source code than the present one, or from unknown code."""
        return sources.summary(self.source_ages)

    @property
    def failures(self) -> pd.DataFrame:
        """A row for each cell that was declined, failed or lacks a number."""
        return self.rows[self.rows["status"] == "failed"] if len(self.rows) else self.rows

    def ended(self, declined: bool) -> pd.DataFrame:
        """The cells whose method declined the step (a result), or those that failed by accident: their fields, the reason."""
        cells = self.failures
        if cells.empty:
            return cells
        cells = cells[cells["failure"].str.startswith(DECLINED) == declined]
        fields = cells.drop(columns=["key", "status", "failure"]).dropna(axis="columns", how="all")
        return fields.assign(reason=cells["failure"].str.removeprefix(DECLINED))

    def file(self, name: str) -> str:
        """Name of the file, without suffix, of a figure or table."""
        return re.sub(r"[^\w.-]+", "-", f"{self.experiment}_{name}")


def read(experiment: str, store: Store) -> Section:
    """The section of what is stored of an experiment, not drawn yet. What cannot be loaded or read is said in it."""
    title = experiment.replace("_", " ").capitalize()
    section = Section(experiment, title, origin=origin.find(store.folder, store.choice))
    try:
        section.module = load_stored(experiment)
        title, _, about = (section.module.__doc__ or section.title).strip().partition("\n")
        section.title, section.about = title.rstrip("."), about.strip()
    except UnknownExperiment as error:
        section.errors.append(str(error))  # its rows are still shown
    try:
        journal = store.open(experiment)
    except StoreError as error:
        section.errors.append(str(error).replace(f"{store.folder}{os.sep}", ""))
        return section
    section.notes = [note.replace(f"{store.folder}{os.sep}", "") for note in journal.problems]
    section.rows, section.provenance, section.source_ages = journal.rows(), journal.provenance(), journal.source_ages()
    if measured := getattr(section.module, "MEASURED", None):
        section.rows = with_failures(section.rows, measured)
    return section


def draw(section: Section) -> None:
    """Adds figures, tables and packed rows to a section. What cannot be drawn is said in it."""
    if section.rows.empty:
        return
    full_columns = section.rows.drop(columns="key", errors="ignore").dropna(axis="columns", how="all")
    section.packed = packed(tables.csv(full_columns))
    if section.module is None:
        return
    try:
        section.figures = draw_figures(section)
    except Exception as error:
        section.errors.append(f"figures cannot be drawn: {described(error)}")
    try:
        frames = tables_of(section.experiment, section.rows)
        section.tables = [DrawnTable(name, tables.flat(t), t.attrs.get("caption", "")) for name, t in frames.items()]
    except Exception as error:
        section.errors.append(f"tables cannot be made: {described(error)}")


def draw_figures(section: Section) -> list[DrawnFigure]:
    """All figures of an experiment, those in OPENED for phones too; raises whatever drawing raises."""
    drawn = plots(section)
    words = {name: (getattr(f, "caption", ""), getattr(f, "headline", "")) for name, f in drawn.items()}
    drawings = [DrawnFigure(name, figures.svg(f), *words[name]) for name, f in drawn.items()]
    opened = [figure for figure in drawings if section.file(figure.name) in OPENED]
    if any(figures.wide(drawn[figure.name]) for figure in opened):
        narrow = plots(section, "column")
        for figure in opened:
            figure.phone = figures.svg(narrow[figure.name])
    return drawings


def plots(section: Section, width: str | None = None) -> dict[str, figures.Figure]:
    """The figures that an experiment draws from its rows; raises whatever drawing raises."""
    if section.module is None or section.rows.empty:
        return {}
    with style.apply(width):
        drawn: dict[str, figures.Figure] = section.module.draw(section.rows.copy())
    return drawn


def tables_of(experiment: str, rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The tables that an experiment makes of its rows. The last ones are kept: claims ask for those of the page again."""
    if experiment not in _TABLES or _TABLES[experiment][0] is not rows:
        _TABLES[experiment] = rows, load_stored(experiment).tables(rows.copy())
    return _TABLES[experiment][1]


def described(error: Exception) -> str:
    """The kind of an error, and its message."""
    return f"{type(error).__name__}: {error}"


def write(section: Section, output: Path) -> list[Path]:
    """Writes `figures/*.svg` and `tables/*`; their paths."""
    files = {f"figures/{section.file(figure.name)}.svg": figure.document for figure in section.figures}
    for table in section.tables:
        name = f"tables/{section.file(table.name)}"
        files[f"{name}.md"] = tables.markdown(table.frame)
        files[f"{name}.tex"] = tables.latex(table.frame, table.caption)
        files[f"{name}.csv"] = tables.csv(table.frame)
    return [write_file(output / name, text) for name, text in files.items()]


def packed(text: str) -> Markup:
    """A long text for a script of the page to unpack: gzip, as base64. Empty if there is none."""
    return Markup(base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode() if text else "")
