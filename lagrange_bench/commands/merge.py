"""`lagrange-bench merge`: gather the results of several folders."""

from __future__ import annotations

import argparse

from lagrange_bench.arguments import location
from lagrange_bench.text import Answer, table

SUMMARY = "gather results of several folders"

DESCRIPTION = """\
Gather the results of several folders in one, such as the shards of a run: append what it has not yet. Damaged lines are
left behind. Of two records of one cell the one merged last counts."""


EXAMPLES = """\
examples:
  lagrange-bench merge shard-* --results all
  lagrange-bench merge /mnt/cluster/top --results results/local/full"""


def run(options: argparse.Namespace) -> Answer:
    """Append to one store what others have and it has not."""
    from lagrange_bench.results.store import Store, StoreError

    target = Store(options.results)
    for folder in options.folders:
        if not Store(folder).experiments():
            raise StoreError(f"no results in {folder}: give folders that lagrange-bench run wrote to")
    rows, data, damaged = [("from", "experiment", "records added", "damaged lines left out")], [], 0
    for folder in options.folders:
        for experiment, (added, torn) in target.merge(Store(folder)).items():
            rows.append((str(folder), experiment, str(added), str(torn)))
            data.append({"from": str(folder), "experiment": experiment, "added": added, "damaged": torn})
            damaged += torn
    note = "\nthe cells of damaged lines count as not computed: the run that made them computes them again"
    text = "\n".join([*table(rows), f"results: {options.results}"])
    return Answer(text + (note if damaged else ""), {"results": str(options.results), "merged": data})


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("folders", nargs="+", type=location, metavar="DIR", help="folders that runs wrote to")
    command.add_argument("--results", type=location, metavar="DIR", required=True, help="where to; created if need be")
