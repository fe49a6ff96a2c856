"""Measures how well integrators follow spinning rigid bodies, by their exact motion.

examples:
  lagrange-bench run --profile quick            measure everything coarsely, in a few minutes
  lagrange-bench report                         figures, tables and the page of the published results
  lagrange-bench integrate --top figure1 --h 0.1 --steps 10000

Each command explains itself: lagrange-bench COMMAND --help. Data and JSON go to stdout, everything else to stderr.

exit codes: 0 done · 1 something failed or differs, COMMAND --help says what · 2 bad input, or a file that cannot be read or
written · 130 interrupted (Ctrl-C) · 141 the reader of stdout went away
"""

import argparse
import contextlib
import importlib
import json
import os
import re
import sys
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

from lagrange_bench.support import announce
from lagrange_bench.support.output import plain, visible
from lagrange_bench.support.words import suggestion


class Help(argparse.HelpFormatter):
    """Fills paragraphs to the width of the terminal, but leaves indented lines as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        blocks = text.split("\n\n")
        return "\n\n".join(b if "\n  " in b else super(Help, self)._fill_text(b, width, indent) for b in blocks)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line: what is wrong, and where to read on. text : a module's docstring, for --help."""

    def __init__(self, text: str, **settings: Any):
        about, mark, examples = text.strip().partition("\n\nexamples:")
        settings |= {"description": about, "epilog": f"{mark}{examples}".strip()}
        super().__init__(**settings, formatter_class=Help, allow_abbrev=False)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # so `--state -1,2,…` and `--h -1e-3` have values

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            message = f"unknown {value!r}{suggestion(str(value), known)} Known: {', '.join(known)}"
            raise argparse.ArgumentError(action, message)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return arg_string if action.type is None else action.type(arg_string)  # type: ignore[operator]
        except ValueError as error:
            raise argparse.ArgumentError(action, str(error)) from None

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code. An error is one line on stderr, and so is a warning."""
    usual, warnings.formatwarning = warnings.formatwarning, _one_line
    try:
        return _run(sys.argv[1:] if argv is None else list(argv))
    except SystemExit as done:  # --help
        return int(done.code or 0)
    except KeyboardInterrupt as interrupt:
        return _report(str(interrupt) or "interrupted", 130)
    except BrokenPipeError:
        return 141
    except MemoryError:
        return _report("error: out of memory: record fewer states (--every), or take fewer times", 1)
    except OSError as error:
        path = "" if error.filename is None else f"{error.filename}: "
        return _report(f"error: {path}{error.strerror or error}", 2)
    except (ValueError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not type(error).__module__.startswith("lagrange_bench."):
            raise  # a fault of the bench
        return _report(f"error: {error}", 1 if type(error).__name__ == "StepError" else 2)
    finally:
        warnings.formatwarning = usual


def _one_line(message: Warning | str, *where: Any, **line: Any) -> str:
    return f"lagrange-bench: warning: {visible(' '.join(str(message).split()))}\n"


def _run(argv: list[str]) -> int:
    for stream in (sys.stdout, sys.stderr):  # a terminal without λ shows \u03bb
        with contextlib.suppress(AttributeError):
            stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    commands = parser()
    options, unknown = commands.parse_known_args(argv)
    if unknown:
        command = f"lagrange-bench {options.command}".rstrip()
        hint = suggestion(unknown[0], options.flags)
        raise ValueError(f"unknown argument {unknown[0]!r}{hint} (see {command} --help)")
    if options.version:
        from lagrange_bench.results.provenance import version

        _print(f"lagrange-bench {version('lagrange-bench') or '(not installed)'}")
        return 0
    if not options.command:
        commands.print_help()
        return 0
    options.words = argv
    announce.quiet = bool(options.quiet)
    with contextlib.redirect_stdout(sys.stderr) if options.json else contextlib.nullcontext():
        if getattr(options, "module", ()):
            from lagrange_bench.integrators.own_modules import import_modules

            import_modules(options.module)
        answer = options.run(options)
    for remark in answer.remarks if not options.quiet else ():
        print(visible(remark), file=sys.stderr)
    _print(json.dumps(plain(answer.data), allow_nan=False) if options.json else visible(answer.text))
    return int(answer.code)


def _report(message: str, code: int) -> int:
    print("lagrange-bench:", visible(" ".join(message.split())), file=sys.stderr)
    return code


def _print(text: str) -> None:
    """Print on stdout at once, so that a full disk or a closed pipe can still be reported."""
    try:
        print(text, end="\n" if text else "", flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else the interpreter fails on it again at exit
        raise OSError(error.errno, error.strerror, "standard output") from error


GROUPS = {
    "to start with": "judge integrate check run report",
    "to look something up": "methods tops potentials case errata paper",
    "to work with results": "figure compare verify",
}


def parser() -> Parser:
    """The parser of the command line. Each command has a module, whose docstring is its help (empty with python -OO)."""
    top = Parser(__doc__ or "", prog="lagrange-bench", usage="lagrange-bench COMMAND …")
    top.add_argument("--version", action="store_true", help="print the version and stop")
    top.set_defaults(command="", flags=top._option_string_actions)
    commands = top.add_subparsers(metavar="COMMAND", prog=top.prog, help=argparse.SUPPRESS)
    for heading, names in GROUPS.items():
        top.description = f"{top.description}\n\n{heading}:"
        for name in names.split():
            module = importlib.import_module(f"lagrange_bench.commands.{name}")
            summary, _, text = (module.__doc__ or "").partition("\n\n")
            top.description += f"\n  {name:<12}{summary.rstrip('.')}"
            command = commands.add_parser(name, text=text)
            command.set_defaults(run=module.run, command=name, flags=command._option_string_actions)
            command.add_argument("--json", action="store_true", help="print JSON, and nothing else, on stdout")
            command.add_argument("--quiet", action="store_true", help="print nothing on stderr but errors")
            if hasattr(module, "add_options"):
                module.add_options(command)
    return top


if __name__ == "__main__":
    sys.exit(main())
