"""One figure, for a paper.

For authors of papers. Draw a figure of the page again: as SVG, PDF (with fonts) or PNG, as wide as a column or a page. The same
stored numbers give the same bytes. docs/your-own-figures.md draws any column of the stored numbers against any other.

examples:
  lagrange-bench figure --list
  lagrange-bench figure phase_h --format pdf --width column
  lagrange-bench figure work_precision_time --methods mine,rk4,backlund --results quick
  lagrange-bench figure drift_time --results quick --output drift.svg
  lagrange-bench figure --all --format pdf --output paper/figures
"""

import argparse
from pathlib import Path

from lagrange_bench.commands.arguments import add_choice, add_module, choice_of, location, results_folder
from lagrange_bench.support import announce
from lagrange_bench.support.output import PICTURES, Answer

FORMATS = tuple(suffix.removeprefix(".") for suffix in PICTURES)


def add_options(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    text = "the name printed below a figure of the page, e.g. phase_h"
    what.add_argument("name", nargs="?", metavar="NAME", help=text)
    text = "every figure, in every format and width, or only in those that are given"
    what.add_argument("--all", action="store_true", help=text)
    what.add_argument("--list", action="store_true", help="print the names of the figures that can be drawn")
    command.add_argument("--format", choices=FORMATS, help="format of the file (default: its suffix, else svg)")
    command.add_argument("--width", choices=("column", "page"), help="3.4 or 7 inches (default: as on the page)")
    text = "results: reference, quick, full, or a folder (default: as for lagrange-bench report)"
    command.add_argument("--results", type=results_folder, metavar="DIR", help=text)
    text = "the file, or the folder for --all (default: NAME.FORMAT, or ./figures)"
    command.add_argument("--output", type=location, metavar="PATH", help=text)
    add_choice(command)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.report import export
    from lagrange_bench.results.store import find_results
    from lagrange_bench.runner import progress

    results = find_results(options.results)
    choice = choice_of(options, results)
    if options.list:
        with announce.long_work("figures are drawn to see which there are"):
            figures = export.names(results, choice)
        return Answer("\n".join(figures), {"figures": figures, "results": str(results)})
    kind = _format(options)
    path = options.output or Path("figures" if options.all else f"{options.name}.{kind}")
    with progress.drawing(results, show=not (options.quiet or options.json)) as drawn:
        if options.all:
            written = export.export_all(results, path, options.format, options.width, choice, drawn)
        else:
            written = export.export(options.name, results, path, kind, options.width, choice)
    paths, unknown, notes = written
    replaced = [line for line in paths.values() if line.startswith("replaced")]  # stdout names all that are written
    remarks = [*replaced, *(f"not drawn: {reason}" for reason in unknown), *notes]
    files = list(map(str, paths))
    data = {"written": files, "not_drawn": unknown, "notes": notes, "results": str(results)}
    return Answer("\n".join(files), data, 1 if unknown else 0, remarks)


def _format(options: argparse.Namespace) -> str:
    """The format: of --format, else the suffix of --output, else SVG. ValueError if the suffix is of another."""
    suffix = "" if options.output is None or options.all else options.output.suffix.removeprefix(".").lower()
    if suffix and suffix not in ([options.format] if options.format else FORMATS):
        raise ValueError(f"--output {options.output}: the name must end in .{options.format or ' or .'.join(FORMATS)}")
    return str(options.format or suffix or "svg")
