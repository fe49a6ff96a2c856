"""One figure, for a paper.

For authors of papers. Draw a figure of the page again: as SVG, PDF (with fonts) or PNG, as wide as a column or a page. Without a
NAME list the names of the figures that can be drawn. The same stored numbers give the same bytes. docs/your-own-figures.md draws
any column of the stored numbers against any other.

examples:
  lagrange-bench figure
  lagrange-bench figure phase_h --width column --output phase.pdf
  lagrange-bench figure work_precision_time --methods mine:METHOD,rk4,backlund --results quick
  lagrange-bench figure drift_time --results quick --output drift.svg
"""

import argparse
from pathlib import Path

from lagrange_bench.commands.arguments import add_choice, add_module, choice_of, location, refuse, results_folder
from lagrange_bench.support import announce
from lagrange_bench.support.output import PICTURES, Answer, check_target


def add_options(command: argparse.ArgumentParser) -> None:
    text = "the name printed below a figure of the page, e.g. phase_h; without it they are listed"
    command.add_argument("name", nargs="?", metavar="NAME", help=text)
    command.add_argument("--width", choices=("column", "page"), help="3.4 or 7 inches (default: as on the page)")
    text = "results: reference, quick, full, or a folder (default: as for lagrange-bench report)"
    command.add_argument("--results", type=results_folder, metavar="DIR", help=text)
    text = f"the file: a name that ends in {', '.join(PICTURES)} (default: NAME.svg)"
    command.add_argument("--output", type=location, metavar="PATH", help=text)
    add_choice(command)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.report import export
    from lagrange_bench.results.store import find_results

    results = find_results(options.results)
    choice = choice_of(options, results)
    if options.name is None:
        refuse(options, ("width", "output"), "belongs to the NAME of a figure")
        with announce.long_work("figures are drawn to see which there are"):
            figures = export.names(results, choice)
        return Answer("\n".join(figures), {"figures": figures, "results": str(results)})
    path = options.output or Path(f"{options.name}.svg")
    check_target("--output", path, PICTURES)
    remarks = [f"drawn from {results}", *export.export(options.name, results, path, options.width, choice)]
    return Answer(str(path), {"written": [str(path)], "notes": remarks, "results": str(results)}, remarks=remarks)
