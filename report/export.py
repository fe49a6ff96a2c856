"""Figures as files for a paper: any stored figure as SVG, PDF or PNG, as wide as a column or a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import UnknownExperiment, load_stored
from lagrange_bench.experiments.drawing import figures, style
from lagrange_bench.integrators.files import write_file
from lagrange_bench.integrators.words import suggestion
from lagrange_bench.report import origin, sections
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import Store

Write = Callable[[Path, bytes], object]


class UnknownFigure(ValueError):
    """No stored rows draw a figure of this name; the message says which they draw."""


def _section(experiment: str, store: Store) -> sections.Section:
    """What is stored of an experiment, not drawn yet."""
    section = sections.Section(experiment)
    sections.read(section, store, load_stored(experiment))
    section.origin = replace(origin.find(store.folder, [section.profiles]), choice=store.choice)
    return section


def _notes(section: sections.Section) -> list[str]:
    """What is to be said of the rows that a figure shows."""
    old = f"{section.experiment}: {section.old}. Compute them again: {section.command} --again"
    return [*section.notes, *([old] if section.old else [])]


def _drawn(
    experiment: str, rows: pd.DataFrame, width: str | None, choice: Choice
) -> Iterator[tuple[str, figures.Figure]]:
    """(name, figure) of every figure that an experiment draws from its rows.

    Raises
    ------
    UnknownFigure : the drawing fails, perhaps because of the rows.
    """
    if rows.empty:
        return
    try:
        with style.apply(width, choice.highlight):
            drawn = load_stored(experiment).draw(rows)
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise UnknownFigure(f"no figure can be drawn from {experiment}.jsonl: {reason}") from error
    for name, figure in drawn.items():
        yield sections.Section(experiment).file(name), figure


def names(results: Path, choice: Choice = ALL) -> list[str]:
    """The names of all figures that can be drawn, in the order of the page."""
    store = Store(results, choice)
    return [name for mine in _stored(results)[0] for name, _ in _drawn(mine, store.rows(mine), None, choice)]


def export(
    name: str,
    results: Path,
    output: Path | None = None,
    kind: str = "svg",
    width: str | None = None,
    choice: Choice = ALL,
    write: Write = write_file,
) -> tuple[Path, list[str], list[str]]:
    """Writes one figure; gives its path, what it does not show and why, and what is to be said of its rows.

    name : as in the page, `phase_h` for instance. kind : svg, pdf or png. width : "column", "page" or None, as drawn.
    output : a file; default: the figure's name in the current folder.

    Raises
    ------
    UnknownFigure : no such figure can be drawn from `results`. ValueError : no such kind or width.
    """
    if kind not in figures.FORMATS:
        raise ValueError(f"format must be one of {', '.join(figures.FORMATS)}, got {kind!r}")
    stored, unknown = _stored(results)
    mine = [experiment for experiment in stored if name.startswith(f"{experiment}_")]
    known: list[str] = []
    for experiment in sorted(mine, key=len, reverse=True):
        section = _section(experiment, Store(results, choice))
        unknown += section.notes[:1]
        if choice and section.rows.empty:
            raise UnknownFigure(_no_rows(experiment, choice))
        for found, figure in _drawn(experiment, section.rows, width, choice):
            if found == name:
                path = output or Path(f"{name}.{kind}")
                write(path, figures.FORMATS[kind](figure))
                return path, _lacking(section, choice), _notes(section)
            known.append(found)
    if not known:
        known = names(results, choice)
    if not known and unknown:
        raise UnknownFigure(f"{name!r} cannot be drawn from {results}: {'; '.join(unknown)}")
    if not known:
        raise UnknownFigure(f"nothing is stored in {results}: compute it with lagrange-bench run")
    raise UnknownFigure(f"unknown figure {name!r}{suggestion(name, known)} Known: {', '.join(known)}")


def _lacking(section: sections.Section, choice: Choice) -> list[str]:
    """The chosen methods that its figures do not show because it has no rows of them."""
    lacking = tuple(section.lacking)
    return [_no_rows(section.experiment, replace(choice, methods=lacking))] if lacking else []


def _no_rows(experiment: str, choice: Choice) -> str:
    chosen = ", ".join((*choice.methods, *choice.tops))
    return f"{experiment} has no rows of {chosen}: lagrange-bench run {experiment}{choice.words}"


def export_all(
    results: Path,
    folder: Path,
    kinds: Sequence[str] = tuple(figures.FORMATS),
    widths: Sequence[str] = tuple(style.WIDTHS),
    drawn: sections.Drawn = lambda done, total: None,
    choice: Choice = ALL,
    write: Write = write_file,
) -> tuple[list[Path], list[str], list[str]]:
    """Writes every figure as `NAME-WIDTH.KIND` into a folder.

    Gives the paths, what cannot be drawn and why, and what is to be said of the rows.
    """
    written, notes = [], []
    stored, unknown = _stored(results)
    store = Store(results, choice)
    for i, experiment in enumerate(stored):
        section = _section(experiment, store)
        unknown += _lacking(section, choice)
        notes += _notes(section)
        for k, width in enumerate(widths):
            drawn(i * len(widths) + k, len(stored) * len(widths))
            for name, figure in _drawn(experiment, section.rows, width, choice):
                for kind in kinds:
                    path = Path(folder) / f"{name}-{width}.{kind}"
                    write(path, figures.FORMATS[kind](figure))
                    written.append(path)
    return written, unknown, notes


def _stored(results: Path) -> tuple[list[str], list[str]]:
    """The experiments in the order of the page, and why others are left out."""
    stored, known, unknown = Store(results).experiments(), [], []
    own = [name for name in stored if name not in EXPERIMENTS]
    for name in [*own, *(name for name in EXPERIMENTS if name in stored)]:
        try:
            load_stored(name)
            known.append(name)
        except UnknownExperiment as error:
            unknown.append(str(error))
    return known, unknown
