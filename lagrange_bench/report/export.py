"""Figures as files for a paper: any stored figure as SVG, PDF or PNG, as wide as a column or a page."""

from pathlib import Path

from lagrange_bench.experiments.drawing import figures
from lagrange_bench.report import sections
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import Store
from lagrange_bench.support.words import suggestion


def names(results: Path, choice: Choice) -> list[str]:
    """The names of all figures that can be drawn, in the order of the page."""
    store = Store(results, choice)
    return [name for experiment in store.experiments() for name in _drawn(sections.read(experiment, store))]


def export(name: str, results: Path, path: Path, width: str | None, choice: Choice = ALL) -> list[str]:
    """Writes one figure, and returns remarks: whether an old file was replaced, its caption, what is to be said of its rows.

    name : as in the page, `phase_h` for instance. path : ends in .svg, .pdf or .png. width : "column", "page" or None, as drawn.

    Raises
    ------
    ValueError : no such figure can be drawn from `results`; the message says which can.
    """
    store, problems = Store(results, choice), list[str]()
    for experiment in sorted(store.experiments(), key=len, reverse=True):
        if not f"{name}_".startswith(f"{experiment}_"):
            continue
        section = sections.read(experiment, store)
        problems += [*section.errors, *section.notes][:1]
        if choice and section.rows.empty:
            raise ValueError(f"{experiment} has no rows of {', '.join((*choice.methods, *choice.tops))}")
        drawn = _drawn(section, width)
        if name in drawn:
            done = figures.write(path, drawn[name])
            caption = getattr(drawn[name], "caption", "")
            return [done, *([f"caption: {caption}"] if caption else []), *_remarks(section)]
    if known := names(results, choice):
        raise ValueError(f"unknown figure {name!r}{suggestion(name, known)} Known: {', '.join(known)}")
    why = "; ".join(problems) or "nothing is stored"
    raise ValueError(f"{name!r} cannot be drawn from {results}: {why}")


def _drawn(section: sections.Section, width: str | None = None) -> dict[str, figures.Figure]:
    """The figures of an experiment, by the names of their files. ValueError: the drawing fails."""
    try:
        drawn = sections.plots(section, width)
    except Exception as error:  # perhaps because of the rows
        reason = " ".join(sections.described(error).split())
        raise ValueError(f"no figure can be drawn from {section.experiment}.jsonl: {reason}") from error
    return {section.file(name): figure for name, figure in drawn.items()}


def _remarks(section: sections.Section) -> list[str]:
    """What is to be said of the rows of a figure."""
    remarks = [*section.notes]
    if section.old:
        remarks.append(f"{section.experiment}: {section.old}: the same run with --again computes them again")
    if section.without_rows:
        remarks.append(f"{section.experiment}: no rows of {', '.join(section.without_rows)}")
    return remarks
