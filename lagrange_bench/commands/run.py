"""Run experiments: measure what is not stored yet.

An experiment asks one question about many methods, tops and steps. It is divided into cells, the smallest pieces that are
measured and stored. Measure the cells that are not stored yet, and store each as soon as it is done. The same command continues
a run that was stopped, and tries failed cells again. A cell that hangs or crashes fails alone. lagrange-bench report draws the
results.

examples:
  lagrange-bench run                            everything, quick: a few minutes on two cores
  lagrange-bench run cost --profile full        one experiment as published; leave the machine alone meanwhile
  lagrange-bench run drift phase --methods mine:METHOD,rk4,strang --tops generic,random000
  lagrange-bench run my.toml                    tops, methods and steps of your own (docs/sweeps.md)
  lagrange-bench run drift --scheduler tcp://head:8786      on the workers of a Dask scheduler

After an edit of the bench, the run says how many stored cells are of other sources. --again computes them again, and
lagrange-bench verify --old a sample of them. The bench knows them by a digest (a hash) that is stored with each cell: of the
experiment, and of all that measures and integrates. New results are added to the file of the experiment, and the old ones stay
in it. Methods and potentials in files of your own need no --again: after an edit a plain run computes their cells. If a file is
edited while the run goes on, the cells of a process that had read it before fail; the same command computes them again.

Timing cells, which measure times, run on this machine, one at a time, after all others, whatever --jobs and --scheduler say.
--no-timings leaves them out. For --scheduler, install the extra in the clone: pip install '.[cluster]' (docs/cluster.md).

An experiment of your own is named by its module: lagrange-bench run my_package.my_experiment

exit codes: 0 done; a method that refuses a step (StepError) is a result, reported and drawn · 1 a cell failed otherwise ·
2 bad input, or results cannot be written · 130 interrupted; what was finished is stored
"""

import argparse
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lagrange_bench.commands.arguments import add_choice, choice_of, positive, results_folder, scheduler, seconds
from lagrange_bench.experiments import EXPERIMENTS, PROFILES
from lagrange_bench.support.output import Answer


def add_options(command: argparse.ArgumentParser) -> None:
    text = f"{', '.join(EXPERIMENTS)} (default: all of them), or a FILE.toml alone"
    command.add_argument("experiments", nargs="*", metavar="EXPERIMENT", help=text)
    text = "quick: everything, coarsely; full: the published numbers (default: quick)"
    command.add_argument("--profile", choices=PROFILES, default="quick", help=text)
    text = "results to add to: quick, full, or a folder (default: the profile, or the name of FILE.toml; in "
    text += "lagrange_bench/results/local of the clone, or without a clone in ./results)"
    command.add_argument("--results", type=results_folder, metavar="DIR", help=text)
    add_choice(command)
    text = "worker processes; timings always run one at a time (default: one per usable core)"
    command.add_argument("--jobs", type=positive, metavar="N", help=text)
    text = "a cell that takes longer fails, and the rest goes on (default: 300 in the quick, 3600 in the full profile)"
    command.add_argument("--time-limit", type=seconds, metavar="SECONDS", help=text)
    text = "compute on a Dask cluster: the address tcp://HOST:PORT of its scheduler, or local:N for one with N workers "
    text += "here, for the time of the run"
    command.add_argument("--scheduler", type=scheduler, metavar="ADDRESS", help=text)
    command.add_argument("--no-timings", action="store_true", help="leave out the timing cells")
    text = "also compute the stored cells that were computed with other or unknown source code"
    command.add_argument("--again", action="store_true", help=text)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments import sweep
    from lagrange_bench.results.store import NAMES, default_results, name_of
    from lagrange_bench.runner import engine

    names, file = options.experiments or EXPERIMENTS, None
    if any(name.endswith(".toml") for name in names):
        if len(names) > 1:
            raise ValueError("a TOML file is run alone: its results have a folder of their own")
        file = sweep.read(Path(names[0]))
        if file.name in NAMES and not options.results:
            raise ValueError(f"{names[0]}: {file.name} are results of the bench: rename it, or give --results DIR")
        names = [file.experiment]
    results = options.results or default_results(file.name if file else options.profile)
    choice = choice_of(options)
    summary = engine.run(
        names,
        options.profile,
        results,
        options.jobs,
        not options.quiet,
        time_limit=options.time_limit,
        scheduler=options.scheduler,
        timings=not options.no_timings,
        again=options.again,
        choice=choice,
        cells={file.experiment: file.cells} if file else None,
    )
    lines = [str(summary)]
    command, place = shlex.join(["lagrange-bench", *options.words]), shlex.quote(name_of(results) or str(results))
    if summary.exit_code:
        lines.append(f"again, the failed cells only: {command}")
    if summary.old and not options.again:
        lines.append(f"again, the old cells: {command} --again")
        lines.append(f"or whether they still hold: lagrange-bench verify {place} --old")
    modules = "".join(f" --module {module}" for module in _own_modules(names, file.cells if file else ()))
    report = f"lagrange-bench report --results {place}{modules}{choice.words}"
    data = {**vars(summary), "results": str(results), "exit_code": summary.exit_code, "next": report}
    return Answer("\n".join([*lines, f"next: {report}"]), data, summary.exit_code)


def _own_modules(experiments: Iterable[str], cells: Iterable[dict[str, Any]]) -> list[str]:
    """The user's own modules in this run. The command of the report must name them again."""
    named = (str(cell.get(word, "")) for cell in cells for word in ("method", "potential"))
    mine = [*(name for name in experiments if "." in name), *(name.partition(":")[0] for name in named if ":" in name)]
    return list(dict.fromkeys(mine))
