"""Page, figures and tables of results.

Turn the results that lagrange-bench run stored into one page that needs no network (index.html), figures (SVG) and tables
(Markdown, LaTeX, CSV). Nothing is measured.

examples:
  lagrange-bench report                          the published results
  lagrange-bench report --results quick --open   your own run, in the browser; from any folder
  lagrange-bench report --results quick --methods mine:METHOD,rk4,backlund --output my_page

exit codes: 0 the page is complete · 1 a part could not be drawn; the page says so in its place · 2 no such results, or files
cannot be written. A refuted claim is a result: the page and stderr name it, and the exit code stays 0.
"""

import argparse
import webbrowser
from pathlib import Path

from lagrange_bench.commands.arguments import add_choice, add_module, choice_of, location, results_folder
from lagrange_bench.support.output import Answer


def add_options(command: argparse.ArgumentParser) -> None:
    text = "results: reference, quick, full, or a folder (default: reference, the published ones)"
    command.add_argument("--results", type=results_folder, metavar="DIR", help=text)
    text = "the folder of the page; it is created (default: page in the folder of the results)"
    command.add_argument("--output", type=location, metavar="DIR", help=text)
    command.add_argument("--open", action="store_true", help="open the page in the browser")
    add_choice(command)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.report import claims, page
    from lagrange_bench.results import provenance
    from lagrange_bench.results.store import REFERENCE, find_results
    from lagrange_bench.runner import progress

    results = find_results(options.results)
    installed = results == REFERENCE and provenance.checkout() is None  # nothing is written into a package
    output = options.output or (Path("page") if installed else results / "page")
    choice = choice_of(options, results)
    page.refuse_foreign(output)  # before the drawing
    with progress.drawing(show=not (options.quiet or options.json)) as followed:
        report = page.assemble(results, choice, followed)
        path = page.write(report, output).resolve()
    notes = [f"{s.experiment}: no rows of {', '.join(s.without_rows)}" for s in report.sections if s.without_rows]
    notes += [report.old] if report.old else []
    notes += [f"refuted: {judged.claim.text}" for judged in report.claims if judged.verdict.word == claims.REFUTED]
    summary = f"{path.stat().st_size / 1e6:.1f} MB" + (f", claims: {page.fare(report.claims)}" if report.claims else "")
    remarks = [f"drawn from {results}", *(f"not drawn: {error}" for error in report.errors), *notes, summary]
    if options.open:
        webbrowser.open(path.as_uri())
    data = {"page": str(path), "results": str(results), "not_drawn": report.errors, "notes": notes}
    return Answer(str(path), data, 1 if report.errors else 0, remarks)
