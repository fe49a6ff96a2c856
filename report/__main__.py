"""`python -m report` and `lagrange-bench report`: the page, the figures and the tables of what is stored."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

LARGE = 8_000_000  # bytes of a page that is slow on a phone


@dataclass(frozen=True)
class Made:
    """What was written, from what, and what the reader should know."""

    page: Path
    results: Path
    errors: list[str]  # what could not be drawn; the page says so too
    notes: list[str]
    summary: str  # of what is on the page

    @property
    def remarks(self) -> list[str]:
        """What is told beside the page, a line each."""
        return [*(f"not drawn: {error}" for error in self.errors), *self.notes, self.summary]

    @property
    def exit_code(self) -> int:
        return 1 if self.errors else 0


def make(
    results: Path | None = None, output: Path | None = None, show: bool = True, modules: Sequence[str] = ()
) -> Made:
    """The report of `results`, or of the ones at hand, in `output` or their folder `page`.

    Parameters
    ----------
    show : progress on stderr. modules : of the user's own, to be imported: experiments, or methods of sweeps.

    Raises
    ------
    OSError : there is nothing in the folder of results, or no such folder, or `output` cannot be written.
    ValueError : a module cannot be imported.
    """
    from experiments import progress, provenance
    from experiments.commands import import_modules
    from report import page

    results, notes = find(results)
    output = output or results / "page"
    page.check_writable(output)
    import_modules(modules)
    with progress.drawing(results, show) as drawn:
        report = page.assemble(results, provenance.usable_cores(), drawn, modules)
        path = page.write(report, output).resolve()
    size = path.stat().st_size
    if size > LARGE:
        notes.append(f"the page is large: {size / 1e6:.1f} MB; draw dense figures with rasterized=True")
    notes += [f"refuted: {judged.claim.text}" for judged in report.claims if judged.verdict.passed is False]
    return Made(path, results, report.errors, notes, f"{page.counted(report)}; {size / 1e6:.1f} MB")


def main(argv: Sequence[str] | None = None) -> int:
    """Returns the exit code: 0, 1 if a part could not be drawn (the page says which), 2 for wrong usage."""
    parser = argparse.ArgumentParser(prog="lagrange-bench report", description="Draw what is stored; compute nothing.")
    parser.add_argument("--results", type=Path, metavar="DIR", help="where the results are (default: the reference)")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="where index.html, figures and tables go (default: RESULTS/page)"
    )
    options = parser.parse_args(argv)
    try:
        made = make(options.results, options.output)
    except OSError as error:
        what = f"{error.strerror}: {error.filename}" if error.strerror else str(error)
        print(f"error: {what}", file=sys.stderr)
        return 2
    for line in made.remarks:
        print(line, file=sys.stderr)
    print(made.page)
    return made.exit_code


def find(chosen: Path | None) -> tuple[Path, list[str]]:
    """The folder asked for; else the reference results; else the local ones computed last, and a word about it.

    Raises
    ------
    FileNotFoundError : there is no such folder, or nothing is stored there.
    """
    from experiments.store import default_results

    if chosen is not None:
        if not chosen.is_dir():
            raise FileNotFoundError(f"no such folder of results: {chosen}")
        if not any(path.stat().st_size for path in chosen.glob("*.jsonl")):
            raise FileNotFoundError(f"nothing is stored in {chosen}: give a folder that lagrange-bench run wrote to")
        return chosen, []
    reference, local = default_results(), default_results("full")
    if any(reference.glob("*.jsonl")):
        return reference, []
    journals = [] if local == reference else sorted(local.parent.glob("*/*.jsonl"))
    if not journals:
        raise FileNotFoundError(f"nothing is stored in {reference}: compute it with lagrange-bench run")
    newest = max(journals, key=lambda path: path.stat().st_mtime).parent
    return newest, [f"nothing is stored in {reference}: showing {newest}"]


if __name__ == "__main__":
    raise SystemExit(main())
