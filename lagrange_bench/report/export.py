"""Figures as files for a paper: any stored figure as SVG, PDF or PNG, as wide as a column or a page."""

from collections.abc import Iterator
from pathlib import Path

from lagrange_bench.experiments.catalogue import UnknownExperiment, load_stored
from lagrange_bench.experiments.drawing import figures, style
from lagrange_bench.report import origin, sections
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import Store
from lagrange_bench.support.words import suggestion


def names(results: Path, choice: Choice) -> list[str]:
    """The names of all figures that can be drawn, in the order of the page."""
    return [name for experiment in _stored(results)[0] for name, _ in _drawn(_section(experiment, results, choice))]


def export(name: str, results: Path, path: Path, width: str | None, choice: Choice = ALL) -> list[str]:
    """Writes one figure, and returns remarks: whether an old file was replaced, its caption, what is to be said of its rows.

    name : as in the page, `phase_h` for instance. path : ends in .svg, .pdf or .png. width : "column", "page" or None, as drawn.

    Raises
    ------
    ValueError : no such figure can be drawn from `results`; the message says which can.
    """
    stored, problems = _stored(results)
    for experiment in sorted(stored, key=len, reverse=True):
        if not f"{name}_".startswith(f"{experiment}_"):
            continue
        section = _section(experiment, results, choice)
        problems += section.notes[:1]
        if choice and section.rows.empty:
            raise ValueError(f"{experiment} has no rows of {', '.join((*choice.methods, *choice.tops))}")
        drawn = dict(_drawn(section, width))
        if name in drawn:
            done = figures.write(path, drawn[name])
            caption = getattr(drawn[name], "caption", "")
            return [done, *([f"caption: {caption}"] if caption else []), *_remarks(section)]
    if known := names(results, choice):
        raise ValueError(f"unknown figure {name!r}{suggestion(name, known)} Known: {', '.join(known)}")
    why = "; ".join(problems) or "nothing is stored"
    raise ValueError(f"{name!r} cannot be drawn from {results}: {why}")


def _stored(results: Path) -> tuple[list[str], list[str]]:
    """The experiments in the order of the page, and why others are left out."""
    known, unknown = [], []
    for name in Store(results).experiments():
        try:
            load_stored(name)
            known.append(name)
        except UnknownExperiment as error:
            unknown.append(str(error))
    return known, unknown


def _section(experiment: str, results: Path, choice: Choice) -> sections.Section:
    """What is stored of an experiment, not drawn yet."""
    section = sections.Section(experiment, origin=origin.find(results, choice))
    sections.read(section, Store(results, choice), load_stored(experiment))
    return section


def _drawn(section: sections.Section, width: str | None = None) -> Iterator[tuple[str, figures.Figure]]:
    """(name, figure) of every figure that an experiment draws from its rows. ValueError: the drawing fails."""
    if section.rows.empty:
        return
    try:
        with style.apply(width):
            drawn = load_stored(section.experiment).draw(section.rows)
    except Exception as error:  # perhaps because of the rows
        reason = " ".join(sections.described(error).split())
        raise ValueError(f"no figure can be drawn from {section.experiment}.jsonl: {reason}") from error
    yield from ((section.file(name), figure) for name, figure in drawn.items())


def _remarks(section: sections.Section) -> list[str]:
    """What is to be said of the rows of a figure."""
    remarks = [*section.notes]
    if section.old:
        remarks.append(f"{section.experiment}: {section.old}: the same run with --again computes them again")
    if section.without_rows:
        remarks.append(f"{section.experiment}: no rows of {', '.join(section.without_rows)}")
    return remarks
