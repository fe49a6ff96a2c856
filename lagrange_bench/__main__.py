"""The command line, `lagrange-bench` or `python -m lagrange_bench`. Imports nothing slow before it knows what is asked.

Exit codes: 0 done; 1 something failed, each command's help says what; 2 bad input, or a file that cannot be read or
written; 130 interrupted (Ctrl-C); 141 the reader of stdout went away.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import sys
import threading
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NoReturn

from lagrange_bench.commands import (
    bits,
    case,
    check,
    compare,
    completion,
    errata,
    figure,
    integrate,
    judge,
    methods,
    paper,
    potentials,
    report,
    run,
    tops,
    verify,
)
from lagrange_bench.integrators.interrupts import interrupted_once
from lagrange_bench.integrators.words import suggestion

INTRODUCTION = """\
Benchmarks of geometric integrators for the symmetric Lagrange top, judged by its exact solution."""


EPILOGUE = """\
examples:
  lagrange-bench run --profile quick            measure everything, in about five minutes
  lagrange-bench report                         figures, tables and the page of the published results
  lagrange-bench integrate --top figure1 --h 0.1 --steps 10000

Each command explains itself: lagrange-bench COMMAND --help. Data and JSON go to stdout, everything else to stderr.

exit codes: 0 done · 1 something failed or differs, COMMAND --help says what · 2 bad input or a file problem · 130
interrupted"""


class Help(argparse.HelpFormatter):
    """Fills paragraphs to the width of the terminal, but leaves indented lines as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        blocks = text.split("\n\n")
        return "\n\n".join(b if "\n  " in b else super(Help, self)._fill_text(b, width, indent) for b in blocks)


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, and where to read on."""

    def __init__(self, **settings: Any):
        super().__init__(**settings, formatter_class=Help, allow_abbrev=False)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            message = f"unknown {value!r}{suggestion(str(value), known)} Known: {', '.join(known)}"
            raise argparse.ArgumentError(action, message)

    def print_help(self, file: Any = None) -> None:
        _emit(self.format_help().rstrip())  # argparse's own hides a full disk

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns the exit code; what went wrong is one line on stderr."""
    code = _guarded(argv)
    if argv is None and any(not t.daemon and t is not threading.main_thread() for t in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)  # Python would wait for the thread of a plug-in
    return code


def _guarded(argv: Sequence[str] | None) -> int:
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
        if expected is None or sys.flags.dev_mode:  # python -X dev -m lagrange_bench: for developers
            raise
        return _say(f"error: {error}", expected)


def _run(argv: list[str]) -> int:
    for stream in (sys.stdout, sys.stderr):  # a terminal without λ shows \u03bb; it is no reason to stop
        with contextlib.suppress(AttributeError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        commands = parser()
        options, unknown = commands.parse_known_args(_join_negative(argv))
    except SystemExit as done:  # --help
        return int(done.code or 0)
    if options.version:
        from lagrange_bench.results.provenance import version

        _emit(f"lagrange-bench {version('lagrange-bench') or '(not installed)'}")
        return 0
    if unknown:
        known = options.flags if hasattr(options, "run") else commands._option_string_actions
        command = f"lagrange-bench {options.command}" if hasattr(options, "run") else "lagrange-bench"
        raise ValueError(f"unknown argument {unknown[0]!r}{suggestion(unknown[0], known)} (see {command} --help)")
    if not hasattr(options, "run"):
        commands.print_help()
        return 0
    options.words, options.parser = argv, commands
    with _stdout_for_data_only() if options.json else contextlib.nullcontext():
        answer = options.run(options)
    if not getattr(options, "quiet", False):
        _note_cache()
    _emit(json.dumps(answer.data, allow_nan=False) if options.json else answer.text)
    return int(answer.code)


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
    from lagrange_bench.results.store import StoreError

    cluster = sys.modules.get("lagrange_bench.runner.cluster")
    if isinstance(error, (ValueError, StoreError)) or (cluster and isinstance(error, cluster.ClusterError)):
        return 2
    interface, registry = (sys.modules.get(f"lagrange_bench.integrators.{name}") for name in ("interface", "registry"))
    if registry is not None and isinstance(error, registry.NotInstalled):
        return 2
    return 1 if interface is not None and isinstance(error, interface.StepError) else None


@cache
def _note_cache() -> None:
    """Where nothing compiled can be kept, every start takes as long as the first: worth a word, once."""
    compiled, place = (
        sys.modules.get("lagrange_bench.integrators.compiling.compiled"),
        os.environ.get("LAGRANGE_BENCH_CACHE"),
    )
    if (
        compiled is None
        or compiled.config.DISABLE_JIT
        or place == ""
        or compiled._folder(compiled.__name__) is not None
    ):
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
        saved = os.dup(1)
        os.dup2(2, 1)
        try:
            yield
        finally:
            os.dup2(saved, 1)
            os.close(saved)


COMMANDS = (
    *(methods, tops, potentials, case, judge, run, report, figure, compare),
    *(verify, integrate, check, errata, paper, completion, bits),
)


def parser() -> Parser:
    """The command line; every command has a module of its own."""
    top = Parser(prog="lagrange-bench", description=INTRODUCTION, epilog=EPILOGUE)
    top.add_argument("--version", action="store_true", help="print the version and stop")
    commands = top.add_subparsers(metavar="COMMAND", title="commands")
    for module in COMMANDS:
        name = module.__name__.rpartition(".")[2]
        command = commands.add_parser(name, help=module.SUMMARY, description=module.DESCRIPTION, epilog=module.EXAMPLES)
        command.set_defaults(run=module.run, command=name, flags=command._option_string_actions)
        command.add_argument("--json", action="store_true", help="print JSON, and nothing else, on stdout")
        module.add_options(command)
    return top


if __name__ == "__main__":
    sys.exit(main())
