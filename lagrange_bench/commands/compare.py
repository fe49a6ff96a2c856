"""Differences between two results.

For those who changed the code, or the machine, and ask what changed in the results. Compare two results of lagrange-bench run
cell by cell. (A cell is the smallest piece that is measured and stored.) List the cells that were added, removed or changed, and
by how much each column differs. Everything but times must be equal, unless --rtol or --atol allows a difference. With --times,
the times of each method are compared over all its cells, by Wilcoxon's signed-rank test.

examples:
  lagrange-bench compare reference full
  lagrange-bench compare before after --times               is the new code slower?
  lagrange-bench compare here there --rtol 1e-3 --atol 1e-12     from two kinds of machine

exit codes: 0 the same · 1 not the same · 2 no such results
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from typing import Any

from lagrange_bench.commands.arguments import add_module, results_folder, tolerance
from lagrange_bench.experiments.catalogue import with_units
from lagrange_bench.support.output import Answer, table

MOST = 10  # so many cells of each kind are listed


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("old", type=results_folder, metavar="OLD", help="results: reference, quick, full, or a folder")
    command.add_argument("new", type=results_folder, metavar="NEW", help="other results")
    text = "relative difference that is allowed, even where --atol does not allow it (default: 0)"
    command.add_argument("--rtol", type=tolerance, metavar="R", default=0.0, help=text)
    command.add_argument("--atol", type=tolerance, metavar="A", default=0.0, help="the same, absolute (default: 0)")
    command.add_argument("--times", action="store_true", help="also test whether times differ")
    command.add_argument("--verbose", action="store_true", help="list every cell that was added or removed")
    text = "times with a ratio up to 1 + R count as the same (default: 0.1)"
    command.add_argument("--threshold", type=tolerance, metavar="R", default=0.1, help=text)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.results import compare as stores

    tolerance = {"rtol": options.rtol, "atol": options.atol}
    result = stores.compare(options.old, options.new, **tolerance, times=options.times, threshold=options.threshold)
    rows: list[tuple[str, ...]] = [("experiment", "cells old", "new", "same", "added", "removed", "changed")]
    for name, c in result.experiments.items():
        counts = (c.old, c.new, c.same, len(c.added), len(c.removed), len(c.changed))
        rows.append((name, *map(str, counts)))
    lines = table(rows)
    for name, c in result.experiments.items():
        for what, cells in (("removed", c.removed), ("added", c.added)):
            lines += listed(name, what, cells, None) if options.verbose else _counted(name, what, cells)
        lines += changed_columns(name, c.changed)
    if options.times:
        lines += ["", *_times(result.times, options.threshold)]
    lines += [*result.notes, "the same" if result.same else "not the same"]
    return Answer("\n".join(lines), {"same": result.same, **vars(result)}, 0 if result.same else 1)


def _counted(experiment: str, what: str, cells: Sequence[dict[str, Any]]) -> list[str]:
    if not cells:
        return []
    parts = Counter(str(cell["part"]) for cell in cells if "part" in cell)
    shares = f" ({', '.join(f'{count} of {part}' for part, count in parts.items())})" if parts else ""
    return [f"{what}: {len(cells)} cell{'' if len(cells) == 1 else 's'} of {experiment}{shares}; --verbose lists them"]


def _times(tested: Sequence[Any], threshold: float) -> list[str]:
    if not tested:
        return ["no timing cells to compare"]
    different = [group for group in tested if group.verdict != "same"]
    rows: list[tuple[str, ...]] = [("times", "method", "column", "cells", "pairs", "new/old", "p", "verdict")]
    for g in different:
        counts = (str(g.cells), str(g.pairs), f"{g.ratio:.3f}", f"{g.p:.1e}")
        rows.append((g.experiment, g.method, g.column, *counts, g.verdict))
    sum_up = f"{len(tested)} groups of times, {len(different)} differ by more than {threshold:.0%} and significantly"
    return [*(table(rows) if different else []), sum_up]


def listed(experiment: str, what: str, cells: Sequence[dict[str, Any]], most: int | None = MOST) -> list[str]:
    shown = (json.dumps(with_units(experiment, cell), ensure_ascii=False) for cell in cells[:most])
    lines = [f"{what}: {experiment} {cell}" for cell in shown]
    return lines + ([f"… and {len(cells) - len(lines)} more {what} in {experiment}"] if len(cells) > len(lines) else [])


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
        rows.append((column, *counts, *sizes, _short(worst.old), _short(worst.new)))
    cells = listed(experiment, "changed", [each["cell"] for each in changed])
    return ["", f"changed in {experiment}:", *table(rows), *cells]


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:59]}…"
