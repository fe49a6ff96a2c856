"""One figure, for a paper.

For authors of papers. Draw a figure of the page again: as SVG, PDF (with fonts) or PNG, as wide as a column or a page. The same
stored numbers give the same bytes. With --x and --y, draw any column of the stored numbers against any other.

examples:
  lagrange-bench figure --list
  lagrange-bench figure phase_h --format pdf --width column
  lagrange-bench figure work_precision_time --methods mine,rk4,backlund --results quick
  lagrange-bench figure drift_time --results quick --output drift.svg
  lagrange-bench figure phase_h --xlim 1e-2,1 --ylim 1e-12,1
  lagrange-bench figure drift_time --x t_scaled --y C2 --tops random000 --methods rk4,backlund
  lagrange-bench figure --all --format pdf --output paper/figures
"""

import argparse
from pathlib import Path
from typing import Any

from lagrange_bench.commands.arguments import add_choice, add_module, choice_of, limits, location, results_folder
from lagrange_bench.support import announce
from lagrange_bench.support.output import PICTURES, Answer

FORMATS = tuple(suffix.removeprefix(".") for suffix in PICTURES)


def add_options(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    text = "the name printed below a figure of the page, e.g. phase_h; with --x and --y also an experiment"
    what.add_argument("name", nargs="?", metavar="NAME", help=text)
    text = "every figure, in every format and width, or only in those that are given"
    what.add_argument("--all", action="store_true", help=text)
    what.add_argument("--list", action="store_true", help="print the names of the figures that can be drawn")
    command.add_argument("--format", choices=FORMATS, help="format of the file (default: its suffix, else svg)")
    command.add_argument("--width", choices=("column", "page"), help="3.4 or 7 inches (default: as on the page)")
    for flag in ("--x", "--y"):
        text = "draw these columns of the stored numbers, a panel for each top; results/README.md lists their names"
        command.add_argument(flag, metavar="COLUMN", help=text)
    for flag in ("--xlim", "--ylim"):
        command.add_argument(flag, type=limits, metavar="A,B", help="limits of this axis, in every panel")
    text = "results: reference, quick, full, or a folder (default: as for lagrange-bench report)"
    command.add_argument("--results", type=results_folder, metavar="DIR", help=text)
    text = "the file, or the folder for --all (default: NAME.FORMAT, or ./figures)"
    command.add_argument("--output", type=location, metavar="PATH", help=text)
    add_choice(command)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.report import export
    from lagrange_bench.results.store import find_results
    from lagrange_bench.runner import progress
    from lagrange_bench.support.files import replace_file

    if (options.x is None) != (options.y is None) or (options.x and options.name is None):
        raise ValueError("--x and --y go together, with the name of a figure or of an experiment")
    results = find_results(options.results)
    choice = choice_of(options, None if options.x else results)
    if options.list:
        with announce.long_work("figures are drawn to see which there are"):
            figures = export.names(results, choice)
        return Answer("\n".join(figures), {"figures": figures, "results": str(results)})
    kind = _format(options)
    path = options.output or Path("figures" if options.all else f"{options.name}.{kind}")
    shown = progress.drawing(results, show=not (options.quiet or options.json))
    with style.limits(xlim=options.xlim, ylim=options.ylim), shown as drawn:
        if options.x:
            done = replace_file(path, _columns(options, results, choice, kind))
            written: export.Written = {path: done}, [], []
        elif options.all:
            written = export.export_all(results, path, options.format, options.width, choice, drawn)
        else:
            written = export.export(options.name, results, path, kind, options.width, choice)
    paths, unknown, notes = written
    replaced = [line for line in paths.values() if line.startswith("replaced")]  # stdout names all that are written
    remarks = [*replaced, *(f"not drawn: {reason}" for reason in unknown), *notes]
    files = list(map(str, paths))
    data = {"written": files, "not_drawn": unknown, "notes": notes, "results": str(results)}
    return Answer("\n".join(files), data, 1 if unknown else 0, remarks)


def _columns(options: argparse.Namespace, results: Path, choice: Any, kind: str) -> bytes:
    """A figure of two columns, as the bytes of a file, from the rows of an experiment or of the named figure."""
    import numpy as np

    from lagrange_bench.ask.comparison import Comparison
    from lagrange_bench.ask.data import load
    from lagrange_bench.experiments.drawing import figures, style

    stored = load(results)
    names = sorted((name for name in stored if f"{options.name}_".startswith(f"{name}_")), key=len)
    frame = stored[names[-1] if names else options.name]
    part = options.name.removeprefix(names[-1]).removeprefix("_") if names else ""
    if "part" in frame and part in set(frame["part"]):
        frame = frame[frame["part"] == part]

    def panels(tops: list[str]) -> Any:
        return style.panels(tops, 2, (0.4, 2.7), "", "")[1]

    with style.apply(options.width, choice.highlight):
        axes = Comparison(frame).plot(options.x, options.y, choice.methods or None, choice.tops or None, panels)
        return figures.FORMATS[kind](np.ravel(axes)[0].figure)


def _format(options: argparse.Namespace) -> str:
    """The format: of --format, else the suffix of --output, else SVG. ValueError if the suffix is of another."""
    suffix = "" if options.output is None or options.all else options.output.suffix.removeprefix(".").lower()
    if suffix and suffix not in ([options.format] if options.format else FORMATS):
        raise ValueError(f"--output {options.output}: the name must end in .{options.format or ' or .'.join(FORMATS)}")
    return str(options.format or suffix or "svg")
