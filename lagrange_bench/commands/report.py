"""`lagrange-bench report`: the page, figures and tables of results."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lagrange_bench.arguments import add_module
from lagrange_bench.text import Answer

SUMMARY = "page, figures and tables of results"

DESCRIPTION = """\
Turn stored results into one offline page (index.html), figures (SVG) and tables (Markdown, LaTeX, CSV)."""


EXAMPLES = """\
examples:
  lagrange-bench report                                        the published results
  lagrange-bench report --results results/local/quick          your own run
  lagrange-bench report --results /scratch/top --output /tmp/page

exit codes: 0 the page is complete; a claim that is refuted is a finding, told on stderr and on the page · 1 a part could
not be drawn, which the page says in its place · 2 no such results, or files cannot be written"""


def add_options(command: argparse.ArgumentParser) -> None:
    text = "what lagrange-bench run stored (default: results/reference, the published ones; else your latest run)"
    command.add_argument("--results", type=Path, metavar="DIR", help=text)
    text = "where the page goes; it is created (default: the folder page in that of the results)"
    command.add_argument("--output", type=Path, metavar="DIR", help=text)
    command.add_argument(
        "--quiet", action="store_true", help="no remarks on stderr; the page and the exit code have them"
    )
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    """Build the page from stored results, and say what could not be drawn."""
    from report.__main__ import make

    show = not (options.quiet or options.json)
    made = make(options.results, options.output, show, options.module)
    for line in made.remarks if not options.quiet else ():
        print(line, file=sys.stderr)
    data = {"page": str(made.page), "results": str(made.results), "not_drawn": made.errors, "notes": made.notes}
    return Answer(str(made.page), data, made.exit_code)
