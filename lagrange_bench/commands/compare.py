"""Differences between two results.

For those who changed the code, or the machine, and ask what changed in the results. Compare two results of lagrange-bench run
cell by cell. (A cell is the smallest piece that is measured and stored.) A cell is the same, close (within --rtol or --atol),
changed, or missing from one of the two. For changed cells, say by how much each column differs. Times are not compared. --json
lists all changed and missing cells.

examples:
  lagrange-bench compare reference full
  lagrange-bench compare before after --json
  lagrange-bench compare here there --rtol 1e-3 --atol 1e-12     from two kinds of machine

exit codes: 0 the same · 1 not the same · 2 no such results
"""

import argparse
import json
import textwrap
from collections.abc import Sequence
from typing import Any

from lagrange_bench.commands.arguments import add_module, results_folder, tolerance
from lagrange_bench.experiments.catalogue import with_units
from lagrange_bench.support.output import Answer, table

MOST = 10  # so many changed cells are listed


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("old", type=results_folder, metavar="OLD", help="results: reference, quick, full, or a folder")
    command.add_argument("new", type=results_folder, metavar="NEW", help="other results")
    text = "relative difference that is allowed, even where --atol does not allow it (default: 0)"
    command.add_argument("--rtol", type=tolerance, metavar="R", default=0.0, help=text)
    command.add_argument("--atol", type=tolerance, metavar="A", default=0.0, help="the same, absolute (default: 0)")
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.results.compare import compare

    result = compare(options.old, options.new, options.rtol, options.atol)
    rows: list[tuple[str, ...]] = [("experiment", "same", "close", "changed", "missing in old", "missing in new")]
    for name, c in result.experiments.items():
        missing = len(c.missing["old"]), len(c.missing["new"])
        rows.append((name, *map(str, (c.same, c.close, len(c.changed), *missing))))
    lines = table(rows)
    for name, c in result.experiments.items():
        lines += changed_columns(name, c.changed)
    lines += [*result.notes, "the same" if result.same else "not the same"]
    return Answer("\n".join(lines), {"same": result.same, **vars(result)}, 0 if result.same else 1)


def changed_columns(experiment: str, changed: Sequence[dict[str, Any]]) -> list[str]:
    """How much each column differs, then the first few changed cells."""
    if not changed:
        return []
    rows: list[tuple[str, ...]] = [("column", "cells", "rows", "largest difference", "relative", "old", "new")]
    for column in dict.fromkeys(name for each in changed for name in each["columns"]):
        changes = [each["columns"][column] for each in changed if column in each["columns"]]
        worst = max(changes, key=lambda difference: difference.relative)
        sizes = (f"{max(difference.absolute for difference in changes):.1e}", f"{worst.relative:.1e}")
        counts = (str(len(changes)), str(sum(difference.rows for difference in changes)))
        values = (textwrap.shorten(str(value), 60, placeholder="…") for value in (worst.old, worst.new))
        rows.append((column, *counts, *sizes, *values))
    shown = [json.dumps(with_units(experiment, each["cell"]), ensure_ascii=False) for each in changed[:MOST]]
    cells = [f"changed: {experiment} {cell}" for cell in shown]
    if len(changed) > MOST:
        cells.append(f"… and {len(changed) - MOST} more")
    return ["", f"changed in {experiment}:", *table(rows), *cells]
