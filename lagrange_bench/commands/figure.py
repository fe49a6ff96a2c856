"""`lagrange-bench figure`: one figure, for a paper."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lagrange_bench.arguments import add_choice, add_module, check_choice, choice_of, location
from lagrange_bench.text import Answer

SUMMARY = "one figure, for a paper"

FORMATS = ("svg", "pdf", "png")

DESCRIPTION = """\
Draw a stored figure again, for a paper: as SVG, PDF (fonts embedded) or PNG, as wide as a column or a page. The same
rows give the same bytes."""


EXAMPLES = """\
examples:
  lagrange-bench figure --list
  lagrange-bench figure phase_h --format pdf --width column
  lagrange-bench figure work_precision_time --methods mine,rk4,backlund --results results/local/quick
  lagrange-bench figure drift_time --results results/local/quick --output drift.svg
  lagrange-bench figure --all --format pdf --output paper/figures"""


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "name", nargs="?", metavar="NAME", help="the name printed below a figure of the page, e.g. phase_h"
    )
    command.add_argument(
        "--all", action="store_true", help="every figure, in every format and width unless one is given"
    )
    command.add_argument("--list", action="store_true", help="print the names of the figures that can be drawn")
    command.add_argument("--format", choices=FORMATS, help="of the file (default: as its name ends, else svg)")
    command.add_argument("--width", choices=("column", "page"), help="3.4 or 7 inches (default: as on the page)")
    text = "what lagrange-bench run stored (default: as for lagrange-bench report)"
    command.add_argument("--results", type=location, metavar="DIR", help=text)
    text = "the file, or the folder for --all (default: NAME.FORMAT, or ./figures)"
    command.add_argument("--output", type=location, metavar="PATH", help=text)
    command.add_argument("--quiet", action="store_true", help="nothing on stderr")
    add_choice(command)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    """Draw one stored figure, or all of them, as files."""
    from lagrange_bench.integrators.files import replace_file
    from lagrange_bench.integrators.registry import import_modules
    from lagrange_bench.report import export
    from lagrange_bench.results.store import find_results
    from lagrange_bench.runner import progress

    if sum((options.all, options.list, options.name is not None)) != 1:
        raise ValueError("give one of: the name of a figure, as phase_h; --all; --list")
    if options.list and (given := [word for word in ("output", "format", "width") if getattr(options, word)]):
        raise ValueError(f"--{given[0]} is for figures that are drawn, and --list draws none")
    import_modules(options.module)
    results, _ = find_results(options.results)
    choice = choice_of(options)
    check_choice(results, choice)
    if options.list:
        found = export.names(results, choice)
        return Answer("\n".join(found), {"figures": found, "results": str(results)})
    done: list[str] = []

    def write(path: Path, content: bytes) -> None:
        done.append(replace_file(path, content))

    with progress.drawing(results, show=not (options.quiet or options.json)) as drawn:
        if options.all:
            chosen = {"kinds": options.format, "widths": options.width}
            some = {name: (value,) for name, value in chosen.items() if value}
            folder = options.output or Path("figures")
            written, unknown, notes = export.export_all(
                results, folder, **some, drawn=drawn, choice=choice, write=write
            )
        else:
            kind, width = _format(options), options.width
            path, unknown, notes = export.export(options.name, results, options.output, kind, width, choice, write)
            written = [path]
    replaced = [line for line in done if line.startswith("replaced")]  # stdout names all that are written
    for line in [*replaced, *(f"not drawn: {reason}" for reason in unknown), *notes] if not options.quiet else ():
        print(line, file=sys.stderr)
    paths = [str(path) for path in written]
    data = {"written": paths, "not_drawn": unknown, "notes": notes, "results": str(results)}
    return Answer("\n".join(map(str, written)), data, 1 if unknown else 0)


def _format(options: argparse.Namespace) -> str:
    """As asked for, or as the name of the file ends, or SVG. ValueError if the two contradict each other."""
    suffix = "" if options.output is None else Path(options.output).suffix.removeprefix(".").lower()
    if suffix and suffix not in FORMATS:
        raise ValueError(f"--output {options.output}: the name must end in .{', .'.join(FORMATS)}")
    if options.format and suffix and suffix != options.format:
        raise ValueError(
            f"--format {options.format} and --output {options.output} contradict each other: give one format"
        )
    return str(options.format or suffix or "svg")
