"""Compute stored cells again.

For those who doubt stored results. Compute a sample of their cells, the smallest pieces that were measured, again on this
machine, and compare. Counts, and the invariants of compiled methods, must be the same to the bit. Numbers that depend on a
library or on the exact solution must agree within round-off. Times are not compared, but with --times five ratios of times are
measured, those of claims about speed, each printed with its bound.

examples:
  lagrange-bench verify                          sixty cells of the published results: about a minute
  lagrange-bench verify --times                  is it as fast as claimed? a minute; leave the machine alone meanwhile
  lagrange-bench verify --sample 10000 --longest 60 --seed 1      all of them: a quarter of an hour
  lagrange-bench verify quick --sample 20 --json
  lagrange-bench verify full --old --sample 10000   did your edit change any row?

The sample has cells from every part and method of every experiment, taken in turn.

exit codes: 0 the same · 1 changed, or a ratio beyond its bound · 2 no such results, no cell can be computed again, or an
experiment has a newer VERSION
"""

import argparse
from collections import Counter
from pathlib import Path

from lagrange_bench.commands.arguments import add_module, count, positive, results_folder, seconds
from lagrange_bench.commands.compare import changed_columns
from lagrange_bench.support.output import Answer, table


def add_options(command: argparse.ArgumentParser) -> None:
    text = "results: reference, quick, full, or a folder (default: reference, the published ones)"
    command.add_argument("folder", nargs="?", type=results_folder, metavar="DIR", help=text)
    command.add_argument("--times", action="store_true", help="measure ratios of times instead, here and now")
    text = "how many cells (default: 60, which take a minute or a little more on two cores)"
    command.add_argument("--sample", type=positive, metavar="N", default=60, help=text)
    command.add_argument("--seed", type=count, metavar="N", default=0, help="another sample (default: 0)")
    text = "only cells that were computed with other or unknown source code"
    command.add_argument("--old", action="store_true", help=text)
    text = "leave out cells that took longer when they were stored (default: 3)"
    command.add_argument("--longest", type=seconds, metavar="SECONDS", default=3.0, help=text)
    add_module(command)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.results import sources
    from lagrange_bench.runner.verify import verify

    if options.times:
        return _times(options.folder)
    result = verify(options.folder, options.sample, options.seed, options.longest, not options.quiet, options.old)
    lines: list[str] = []
    for name in dict.fromkeys(each["experiment"] for each in result.changed):
        lines += changed_columns(name, [each for each in result.changed if each["experiment"] == name])
    sum_up = f"{result.cells} cells computed again: {result.identical} identical, {result.close} within the tolerance "
    sum_up += f"of libraries, {len(result.changed)} changed"
    ages = Counter(each["sources"] for each in result.changed)
    words = [f"{ages[age]} of them {text}" for age, text in sources.WORDS.items() if ages[age]]
    text = "\n".join([*lines, *result.notes, "; ".join([sum_up, *words])])
    return Answer(text, vars(result), 1 if result.changed else 0)


def _times(folder: Path | None) -> Answer:
    from lagrange_bench.runner.times import ratios

    if folder is not None:
        raise ValueError("--times measures here and now: it takes no folder of results")
    measured = list(ratios())
    words = {True: "as claimed", False: "not as claimed"}
    rows = [(ratio.text, f"{ratio.value:.3g}", ratio.required, words[ratio.passed]) for ratio in measured]
    lines = table([("ratio of times", "measured", "bound", "verdict"), *rows])
    data = [ratio._asdict() for ratio in measured]
    return Answer("\n".join(lines), data, 0 if all(ratio.passed for ratio in measured) else 1)
