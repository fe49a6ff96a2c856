"""The command line, `lagrange-bench` or `python -m experiments`. Imports nothing slow before it knows what is asked.

Exit codes: 0 done; 1 something failed, each command's help says what; 2 bad input, or a file that cannot be read or
written; 130 interrupted (Ctrl-C); 141 the reader of stdout went away.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

from experiments import EXPERIMENTS, integrate, interrupted_once

INTRODUCTION = """\
Benchmarks of geometric integrators for the symmetric Lagrange top, judged by its exact solution."""

EPILOGUE = """\
examples:
  lagrange-bench run --profile quick            measure everything, in less than three minutes
  lagrange-bench report                         figures, tables and the page of the published results
  lagrange-bench integrate --top figure1 --h 0.1 --steps 10000

Each command explains itself: lagrange-bench COMMAND --help. Data and JSON go to stdout, everything else to stderr.

exit codes: 0 done · 1 something failed or differs, COMMAND --help says what · 2 bad input or a file problem · 130
interrupted"""

METHODS = """\
List the integration methods and what they claim: order, symmetry, Poisson map, invariants kept at round-off."""

METHODS_EXAMPLES = """\
examples:
  lagrange-bench methods
  lagrange-bench methods --verbose              with sources and options (for integrate --option)
  lagrange-bench methods --json | jq -r '.[] | select(.poisson) | .name'

A method of your own package joins through the entry-point group lagrange_bench.methods (name = package.module:METHOD);
lagrange-bench check tests what it claims."""

TOPS = """\
List the named tops: weight parameter alpha, initial state (J1, J2, J3, x1, x2, x3), kind of motion, nutation period."""

TOPS_EXAMPLES = """\
The equations are J' = alpha e3 × x, x' = J × x; units are yours, alpha has those of J²/x. A period is inf where x3 is
constant and unstable, or on the separatrix (null in JSON).

examples:
  lagrange-bench tops
  lagrange-bench tops --json | jq '.[] | select(.regime == "elliptic") | .name'
  lagrange-bench integrate --top near_separatrix --h 0.1 --steps 1000"""

RUN = """\
Measure the cells of experiments that are not stored yet, each kept as soon as it is done. A run that was stopped is
continued, and failed cells are tried again, by the same command. A cell that hangs or crashes fails alone. Cells whose
source code changed since are counted, and computed afresh with --again."""

RUN_EXAMPLES = """\
examples:
  lagrange-bench run                            everything, quick: less than three minutes on two cores
  lagrange-bench run cost --profile full        one experiment as published; leave the machine alone meanwhile
  lagrange-bench run my.toml                    tops, methods and steps of your own (docs/sweeps.md)
  lagrange-bench run drift --scheduler tcp://head:8786      on the workers of a Dask scheduler
  lagrange-bench run drift --shard 3/100 --no-timings       a hundredth of the cells, for one of a hundred jobs

After you edited a method or an experiment, lagrange-bench run --again computes the cells it changed: with each cell the
source code is recorded that its rows come from, what measures, the method, and all the functions these call. Comments,
figures and other methods do not count. New rows are added to the journal, and the old ones stay in it.

Timing cells are measured on this machine, one at a time, after all others, whatever --jobs and --scheduler say; with
--no-timings not at all. Needs for --scheduler: pip install 'lagrange-bench[cluster]' (docs/cluster.md).

An experiment of your own is named by its module: lagrange-bench run my_package.my_experiment

exit codes: 0 done; a method that refuses a step (StepError) is a result, told and drawn · 1 a cell failed otherwise ·
2 bad input, or results cannot be written · 130 interrupted; what was finished is stored"""

MERGE = """\
Gather the results of several folders, of the shards of a run say, in one: append what it has not yet. Damaged lines are
left behind. Of two records of one cell the one merged last counts."""

MERGE_EXAMPLES = """\
examples:
  lagrange-bench merge shard-* --results all
  lagrange-bench merge /mnt/cluster/top --results results/local/full"""

COMPARE = """\
Compare two stores cell by cell: which were added, removed or changed, and by how much in each column. Everything but
times must be equal; --times tests those too, each method's over all its cells, by Wilcoxon's signed-rank test."""

COMPARE_EXAMPLES = """\
examples:
  lagrange-bench compare results/reference results/local/full
  lagrange-bench compare before after --times               is the new code slower?
  lagrange-bench compare here there --rtol 1e-3 --atol 1e-12     of two kinds of machine

exit codes: 0 the same · 1 not the same · 2 no such results"""

VERIFY = """\
Compute some of the cells of a store again, here and now, and compare: what a compiled method did to the invariants, and
all counts, bit by bit; what a library or the exact solution has a part in, to its round-off; times not at all."""

VERIFY_EXAMPLES = """\
examples:
  lagrange-bench verify                              sixty cells of the published results
  lagrange-bench verify --sample 10000 --longest 60 --seed 1      all of them: a quarter of an hour
  lagrange-bench verify results/local/quick --sample 20 --json
  lagrange-bench verify results/local/full --old --sample 10000   did your edit change any row?

The sample is drawn in turn from every part and method of every experiment. exit codes: 0 the same · 1 changed · 2 no
such results, or an experiment's VERSION is newer than they are"""

REPORT = """\
Turn stored results into one offline page (index.html), figures (SVG) and tables (Markdown, LaTeX, CSV)."""

REPORT_EXAMPLES = """\
examples:
  lagrange-bench report                                        the published results
  lagrange-bench report --results results/local/quick          your own run
  lagrange-bench report --results /scratch/top --output /tmp/page

exit codes: 0 the page is complete; a claim that is refuted is a finding, told on stderr and on the page · 1 a part could
not be drawn, which the page says in its place · 2 no such results, or files cannot be written"""

FIGURE = """\
Draw a stored figure again, for a paper: as SVG, PDF (fonts embedded) or PNG, as wide as a column or a page. The same
rows give the same bytes."""

FIGURE_EXAMPLES = """\
examples:
  lagrange-bench figure phase_h --format pdf --width column
  lagrange-bench figure drift_time --results results/local/quick --output drift.svg
  lagrange-bench figure --all --format pdf --output paper/figures"""

CHECK = """\
Test what a method claims: its order, symmetry, Poisson map, invariants, and the contract of a stepper. Prints a verdict
per claim: pass, fail or not judged. For your own method before you publish it, too."""

CHECK_EXAMPLES = """\
examples:
  lagrange-bench check backlund
  lagrange-bench check implicit_midpoint --quick
  lagrange-bench check my_package.my_method:METHOD     no entry point needed; the current folder is searched too

exit codes: 0 nothing fails · 1 a claim fails · 2 no such method"""

ERRATA = """\
List the errata of the paper the Bäcklund methods come from: wrong formulas, and wrong sentences beside right formulas.
Each is evaluated as printed and as corrected, at random points; what it misses by is printed beside it."""

ERRATA_EXAMPLES = """\
examples:
  lagrange-bench errata
  lagrange-bench errata --points 100 --seed 7
  lagrange-bench errata --json | jq -r '.[] | select(.section == "5.5") | .corrected_text'

alpha, J1 … x3, λ, μ, x, X as in the paper, J̃ for the image; ℓ = x·J, C1 = |x|². The list is the ERRATA of each module
of integrators.integrable, where the corrected formulas are."""


BITS = """\
Do the compiled kernels compute on this machine what they computed on another, to the last bit? Prints a verdict for
each: same, differs at a place, or not written down. Adaptive methods and libraries promise no bits and are left out."""

BITS_EXAMPLES = """\
examples:
  lagrange-bench bits                           every kernel, a million steps on three tops: a minute
  lagrange-bench bits backlund gauss4 --python  two, and their first thousand steps in the interpreter
  lagrange-bench bits --quick --json | jq '.verdicts[] | select(.passed == false) | .kernel'

exit codes: 0 nothing differs · 1 a kernel differs · 2 no such kernel"""

COMPLETION = """\
Print a script that lets the shell complete commands, options, experiments, methods and tops."""

COMPLETION_EXAMPLES = """\
examples:
  eval "$(lagrange-bench completion bash)"      for this shell; into ~/.bashrc for every one
  lagrange-bench completion zsh > ~/.lagrange-bench.zsh     and `source ~/.lagrange-bench.zsh` after compinit
  lagrange-bench completion fish > ~/.config/fish/completions/lagrange-bench.fish

The names are those of today: print it again after you installed a plug-in."""


class Help(argparse.HelpFormatter):
    """Fills paragraphs to the width of the terminal, but leaves indented lines as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        blocks = text.split("\n\n")
        return "\n\n".join(b if "\n  " in b else super(Help, self)._fill_text(b, width, indent) for b in blocks)


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, and where to read on."""

    def __init__(self, **settings: Any):
        super().__init__(**settings, formatter_class=Help, allow_abbrev=False)

    def print_help(self, file: Any = None) -> None:
        _emit(self.format_help().rstrip())  # argparse's own hides a full disk

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


def parser() -> Parser:
    """The command line; every command names the function that carries it out."""
    top = Parser(prog="lagrange-bench", description=INTRODUCTION, epilog=EPILOGUE)
    top.add_argument("--version", action="store_true", help="print the version and stop")
    commands = top.add_subparsers(metavar="COMMAND", title="commands")

    def add(name: str, summary: str, description: str, examples: str, function: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=summary, description=description, epilog=examples)
        command.set_defaults(function=function)
        command.add_argument("--json", action="store_true", help="print JSON, and nothing else, on stdout")
        return command

    methods = add("methods", "the integrators and what they claim", METHODS, METHODS_EXAMPLES, "commands:methods")
    methods.add_argument("--verbose", action="store_true", help="also print where each method comes from, its options")
    add("tops", "the named tops", TOPS, TOPS_EXAMPLES, "commands:tops")
    _add_run(add("run", "measure what is missing", RUN, RUN_EXAMPLES, "commands:run"))
    _add_report(add("report", "page, figures and tables of results", REPORT, REPORT_EXAMPLES, "commands:report"))
    _add_figure(add("figure", "one figure, for a paper", FIGURE, FIGURE_EXAMPLES, "commands:figure"))
    merge = add("merge", "gather results of several folders", MERGE, MERGE_EXAMPLES, "commands:merge")
    merge.add_argument("folders", nargs="+", type=Path, metavar="DIR", help="folders that runs wrote to")
    merge.add_argument("--results", type=Path, metavar="DIR", required=True, help="where to; created if need be")
    _add_compare(add("compare", "what two results differ in", COMPARE, COMPARE_EXAMPLES, "commands:compare"))
    _add_verify(add("verify", "compute stored cells again", VERIFY, VERIFY_EXAMPLES, "commands:verify"))
    summary = "follow one top with one method"
    integrate.add_options(add("integrate", summary, integrate.DESCRIPTION, integrate.EXAMPLES, "integrate:integrate"))
    check = add("check", "test what a method claims", CHECK, CHECK_EXAMPLES, "commands:check")
    check.add_argument("method", metavar="METHOD", help="a name (see lagrange-bench methods) or package.module:METHOD")
    check.add_argument("--quick", action="store_true", help="fewer and shorter runs, for while you are developing")
    summary = "errata of the paper, printed and corrected"
    errata = add("errata", summary, ERRATA, ERRATA_EXAMPLES, "commands:errata")
    errata.add_argument("--points", type=positive, default=8, metavar="N", help="random points for each (default: 8)")
    errata.add_argument("--seed", type=whole, default=0, metavar="N", help="of the points (default: 0)")
    summary = "completion for bash, zsh or fish"
    shell = add("completion", summary, COMPLETION, COMPLETION_EXAMPLES, "completion:completion")
    shell.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
    _add_bits(add("bits", "are the kernels' bits the same here", BITS, BITS_EXAMPLES, "commands:bits"))
    return top


def _add_bits(command: argparse.ArgumentParser) -> None:
    text = "a method, with or without “ compensated” (default: all that are compiled)"
    command.add_argument("kernels", nargs="*", metavar="KERNEL", help=text)
    command.add_argument("--quick", action="store_true", help="ten thousand steps instead of a million")
    command.add_argument("--python", action="store_true", help="the first thousand steps in the interpreter, too")
    command.add_argument("--quiet", action="store_true", help="print only what differs or is not written down")


def _add_run(command: argparse.ArgumentParser) -> None:
    known = ", ".join(EXPERIMENTS)
    command.add_argument(
        "experiments", nargs="*", metavar="EXPERIMENT", help=f"{known}, or FILE.toml (default: all of them)"
    )
    profiles = ("quick", "full")
    text = "quick: everything, coarsely; full: the published numbers (default: quick)"
    command.add_argument("--profile", choices=profiles, default="quick", help=text)
    text = "where results are stored, and looked for (default: results/local/PROFILE of the source tree, or "
    text += "./results/PROFILE; of a FILE.toml its name instead of PROFILE)"
    command.add_argument("--results", type=Path, metavar="DIR", help=text)
    text = "worker processes; timings always run one at a time (default: one per usable core)"
    command.add_argument("--jobs", type=positive, metavar="N", help=text)
    text = "a cell that takes longer fails, and the rest goes on (default: 300 in the quick, 3600 in the full profile)"
    command.add_argument("--time-limit", type=seconds, metavar="SECONDS", help=text)
    text = "only every N-th cell of each experiment, starting with the I-th; I counts from 0"
    command.add_argument("--shard", type=shard, metavar="I/N", default=(0, 1), help=text)
    text = "compute on a Dask cluster: the address tcp://HOST:PORT of its scheduler, or local:N for one with N workers "
    text += "here, for the time of the run"
    command.add_argument("--scheduler", type=scheduler, metavar="ADDRESS", help=text)
    command.add_argument("--no-timings", action="store_true", help="leave out the timing cells")
    text = "also compute the stored cells that were computed with other source code, or nobody knows with which"
    command.add_argument("--again", action="store_true", help=text)
    command.add_argument("--quiet", action="store_true", help="no progress on stderr")


def _add_compare(command: argparse.ArgumentParser) -> None:
    command.add_argument("old", type=Path, metavar="OLD", help="results: a folder that lagrange-bench run wrote to")
    command.add_argument("new", type=Path, metavar="NEW", help="other results")
    text = "relative difference allowed, where the absolute one is not (default: 0)"
    command.add_argument("--rtol", type=tolerance, metavar="R", default=0.0, help=text)
    command.add_argument("--atol", type=tolerance, metavar="A", default=0.0, help="absolute difference (default: 0)")
    command.add_argument("--times", action="store_true", help="test times too")
    command.add_argument("--verbose", action="store_true", help="list every cell that was added or removed")
    text = "a ratio of times up to 1 + R is called the same (default: 0.1)"
    command.add_argument("--threshold", type=tolerance, metavar="R", default=0.1, help=text)
    _add_module(command)


def _add_verify(command: argparse.ArgumentParser) -> None:
    text = "results (default: the published ones)"
    command.add_argument("folder", nargs="?", type=Path, metavar="DIR", help=text)
    text = "how many cells (default: 60, less than a minute on two cores)"
    command.add_argument("--sample", type=positive, metavar="N", default=60, help=text)
    command.add_argument("--seed", type=whole, metavar="N", default=0, help="another sample (default: 0)")
    text = "only cells that were computed with other source code, or nobody knows with which"
    command.add_argument("--old", action="store_true", help=text)
    text = "leave out cells that took longer when they were stored (default: 3)"
    command.add_argument("--longest", type=seconds, metavar="SECONDS", default=3.0, help=text)
    command.add_argument("--jobs", type=positive, metavar="N", help="worker processes (default: one per usable core)")
    command.add_argument("--quiet", action="store_true", help="no progress on stderr")
    _add_module(command)


def _add_report(command: argparse.ArgumentParser) -> None:
    text = "what lagrange-bench run stored (default: results/reference, the published ones; else your latest run)"
    command.add_argument("--results", type=Path, metavar="DIR", help=text)
    text = "where the page goes; it is created (default: the folder page in that of the results)"
    command.add_argument("--output", type=Path, metavar="DIR", help=text)
    command.add_argument(
        "--quiet", action="store_true", help="no remarks on stderr; the page and the exit code have them"
    )
    _add_module(command)


def _add_figure(command: argparse.ArgumentParser) -> None:
    command.add_argument("name", nargs="?", metavar="NAME", help="as below a figure of the page: phase_h, say")
    command.add_argument(
        "--all", action="store_true", help="every figure, in every format and width unless one is given"
    )
    command.add_argument("--format", choices=("svg", "pdf", "png"), help="of the file (default: svg)")
    command.add_argument("--width", choices=("column", "page"), help="3.4 or 7 inches (default: as on the page)")
    text = "what lagrange-bench run stored (default: as for lagrange-bench report)"
    command.add_argument("--results", type=Path, metavar="DIR", help=text)
    text = "the file, or the folder for --all (default: NAME.FORMAT, or ./figures)"
    command.add_argument("--output", type=Path, metavar="PATH", help=text)
    command.add_argument("--quiet", action="store_true", help="nothing on stderr")
    _add_module(command)


def _add_module(command: argparse.ArgumentParser) -> None:
    text = "import this module of yours: an experiment, or methods named MODULE:METHOD; else only what is built in, "
    text += "installed or a sweep is known, whatever the results say; may be repeated"
    command.add_argument("--module", action="append", default=[], metavar="MODULE", help=text)


LONGEST = 1e7  # s, of a --time-limit: four months


def whole(text: str) -> int:
    """A whole number."""
    try:
        return int(integrate.read(int, text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a whole number; got {text!r}") from None


def positive(text: str) -> int:
    """A whole number from 1 on."""
    number = whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1; got {number}")
    return number


def seconds(text: str) -> float:
    """A length of time that is worth waiting for."""
    number = integrate.number(text)
    if not 0 < number <= LONGEST:
        raise argparse.ArgumentTypeError(f"must be positive and at most {LONGEST:g}; got {text}")
    return number


def tolerance(text: str) -> float:
    """A number that is not negative."""
    number = integrate.number(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"must not be negative; got {text}")
    return number


def shard(text: str) -> tuple[int, int]:
    """(I, N) of "I/N", 0 ≤ I < N."""
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    if found is None or not int(found[1]) < int(found[2]):
        raise argparse.ArgumentTypeError(f"must be I/N with 0 <= I < N, as 0/4 … 3/4; got {text!r}")
    return int(found[1]), int(found[2])


def scheduler(text: str) -> str:
    """The address of a Dask scheduler, or local:N."""
    from experiments.cluster import check_address

    try:
        return check_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


# ---------------------------------------------------------------- running a command


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns the exit code; what went wrong is one line on stderr."""
    try:
        with interrupted_once() if argv is None else contextlib.nullcontext():
            return _run(sys.argv[1:] if argv is None else list(argv))
    except KeyboardInterrupt as interrupt:
        return _say(str(interrupt) or "interrupted", 130)
    except BrokenPipeError:
        return 141
    except MemoryError:
        return _say("error: out of memory: record fewer states (--every)", 1)
    except OSError as error:
        path = "" if error.filename is None else f"{error.filename}: "
        return _say(f"error: {path}{error.strerror or error}", 2)
    except (ValueError, RuntimeError) as error:
        expected = _exit_code(error)
        if expected is None or sys.flags.dev_mode:  # python -X dev -m experiments: for developers
            raise
        return _say(f"error: {error}", expected)


def _run(argv: list[str]) -> int:
    for stream in (sys.stdout, sys.stderr):  # a terminal without λ shows \u03bb; it is no reason to stop
        with contextlib.suppress(AttributeError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        options = parser().parse_args(_join_negative(argv))
    except SystemExit as done:  # --help
        return int(done.code or 0)
    if options.version:
        from experiments.provenance import version

        _emit(f"lagrange-bench {version('lagrange-bench') or '(not installed)'}")
        return 0
    if not hasattr(options, "function"):
        raise ValueError("give a command: run, report or integrate, say (see lagrange-bench --help)")
    options.words = argv
    with _stdout_for_data_only() if options.json else contextlib.nullcontext():
        answer = _function(options.function)(options)
    if not getattr(options, "quiet", False):
        _note_cache()
    _emit(json.dumps(answer.data, allow_nan=False) if options.json else answer.text)
    return int(answer.code)


def _function(path: str) -> Callable[[argparse.Namespace], Any]:
    module, name = path.split(":")
    function: Callable[[argparse.Namespace], Any] = getattr(importlib.import_module(f"experiments.{module}"), name)
    return function


def _join_negative(argv: list[str]) -> list[str]:
    """`--h -1e-3` as `--h=-1e-3`: argparse takes what starts with a minus for an option, not for its value."""
    joined: list[str] = []
    for word in argv:
        if joined and re.match(r"-\.?\d", word) and re.fullmatch(r"--[a-z]+", joined[-1]):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _exit_code(error: Exception) -> int | None:
    """2 for bad input and unusable files, 1 for a method that failed, None for what nobody expected."""
    from experiments.store import StoreError

    cluster = sys.modules.get("experiments.cluster")
    if isinstance(error, (ValueError, StoreError)) or (cluster and isinstance(error, cluster.ClusterError)):
        return 2
    interface = sys.modules.get("integrators.interface")
    return 1 if interface is not None and isinstance(error, interface.StepError) else None


@cache
def _note_cache() -> None:
    """Where nothing compiled can be kept, every start takes as long as the first: worth a word, once."""
    compiled, place = sys.modules.get("integrators.compiled"), os.environ.get("LAGRANGE_BENCH_CACHE")
    if compiled is None or compiled.config.DISABLE_JIT or place == "" or compiled._folder() is not None:
        return
    where = f"in {place}, where LAGRANGE_BENCH_CACHE points" if place else "in your cache folder"
    advice = "let LAGRANGE_BENCH_CACHE name a folder that can be written to"
    print(f"note: no compiled code can be kept {where}, so each start compiles again; {advice}", file=sys.stderr)


def _say(message: str, code: int) -> int:
    with contextlib.suppress(OSError):
        print("lagrange-bench:", " ".join(message.split()), file=sys.stderr, flush=True)
    return code


def _emit(text: str) -> None:
    """Print on stdout, now: a full disk or a closed pipe can still be answered for."""
    if not text:
        return
    try:
        print(text, flush=True)
    except OSError as error:
        with contextlib.suppress(OSError, ValueError):  # the interpreter would fail on what is buffered, at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise OSError(error.errno, error.strerror, "standard output") from error


@contextlib.contextmanager
def _stdout_for_data_only() -> Iterator[None]:
    """What anybody prints meanwhile, compiled libraries too, goes to stderr."""
    with contextlib.redirect_stdout(sys.stderr):
        try:
            saved = os.dup(1)
            os.dup2(2, 1)
        except OSError as error:
            if error.errno != errno.EBADF:
                raise
            yield  # no such streams here, so nothing to protect
            return
        try:
            yield
        finally:
            os.dup2(saved, 1)
            os.close(saved)


if __name__ == "__main__":
    sys.exit(main())
