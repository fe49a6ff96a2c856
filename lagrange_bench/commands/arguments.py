"""What several commands share: types of options, options, checks. The message of a ValueError is shown to the user."""

import argparse
import math
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

from lagrange_bench.support.words import number, numbers, option, read, scheduler

__all__ = ["number", "numbers", "option", "scheduler"]  # types of options, too


def in_range(parse: Callable[[str], Any], least: float, most: float, wanted: str) -> Callable[[str], Any]:
    """A type of options: `parse`, with a ValueError that says what is `wanted` if the value is not in the range."""

    def kind(text: str) -> Any:
        with suppress(ValueError, ArithmeticError):
            value = read(parse, text)
            if least <= value <= most:
                return value
        raise ValueError(f"must be {wanted}; got {text!r}")

    return kind


def _count(text: str) -> int:
    """A whole number; 1e6 is one, too."""
    value = float(text)
    if not value.is_integer():
        raise ValueError(text)
    return int(value)


LONGEST = 1e6  # s, of a --time-limit: the system counts milliseconds in 32 bits
count = in_range(_count, 0, 2**53, "a whole number from 0 to 2^53")
several = in_range(_count, 2, 10**7, "t0:t1:n, with n from 2 to 10^7")
positive = in_range(int, 1, math.inf, "a whole number, at least 1")
seconds = in_range(
    lambda text: float(Fraction(text)), 1e-9, LONGEST, f"a positive number such as 0.5 or 1/60, at most {LONGEST:g}"
)
tolerance = in_range(float, 0, sys.float_info.max, "a number that is not negative")


def pairs(text: str) -> dict[str, str]:
    """name=value,…, each name once."""
    values: dict[str, str] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        if not name or not value:
            raise ValueError(f"must be name=value,…; got {part!r}")
        if name in values:
            raise ValueError(f"{name} is given twice")
        values[name] = value
    return values


def names(text: str) -> tuple[str, ...]:
    words = tuple(word.strip() for word in text.split(","))
    if not all(words):
        raise ValueError(f"must be names separated by commas; got {text!r}")
    return words


def location(text: str) -> Path:
    """A file or folder. An empty word is refused: a shell variable that is not set would mean the current folder."""
    if not text:
        raise ValueError("must name a file or folder; got an empty word")
    return Path(text)


def results_folder(text: str) -> Path:
    """A folder of results: the name reference, quick or full, or a path."""
    from lagrange_bench.results.store import folder_of

    location(text)
    return folder_of(text)


def refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """ValueError if one of these options was given. why : goes on behind the option, such as "belongs to …"."""
    for name in names:
        if getattr(options, name) is not None:
            raise ValueError(f"--{name.replace('_', '-')} {why}")


def loaded(registry: Any) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """The records of a registry by name, and the name and the error of each that cannot be loaded."""
    each = list(registry.each())
    records = {name: record for name, record, error in each if not error}
    return records, [{"name": name, "error": error} for name, _, error in each if error]


def add_choice(command: argparse.ArgumentParser) -> None:
    for flag, kind in (("--methods", "methods (of mine.py: mine:METHOD)"), ("--tops", "tops")):
        text = f"only the cells of these {kind}; cells that belong to none are left out, too (default: all)"
        command.add_argument(flag, type=names, metavar="a,b,…", default=(), help=text)


def choice_of(options: argparse.Namespace, results: Path | None = None) -> Any:
    """The choice of methods and tops from the options of `add_choice`. It loads methods in the user's own files.

    results : a folder of results. ValueError if no cell in it has one of the names.
    """
    from lagrange_bench.results.choice import Choice
    from lagrange_bench.results.store import Store

    choice = Choice(options.methods, options.tops)
    choice.include()
    if results is not None:
        store = Store(results)
        choice.check(record["cell"] for name in store.experiments() for record in store.open(name).latest)
    return choice


def own_problem(word: str, state: list[float] | None) -> tuple[Any, Any]:
    """The problem `module:PROBLEM` and its state. ValueError if it cannot be loaded, or if there is no state."""
    from lagrange_bench.integrators import Problem
    from lagrange_bench.integrators.registry import Registry, find

    if state is None:
        raise ValueError("--problem needs --state, the numbers of a state")
    problem = find(word, Registry("problem", Problem, {}))
    return problem, problem.check_state(state, "--state")


def add_module(command: argparse.ArgumentParser) -> None:
    text = "import this module of yours, which holds an experiment, or methods and potentials named MODULE:NAME; without it, "
    text += "only experiments, methods and potentials that are built in or installed are known; may be repeated"
    command.add_argument("--module", action="append", default=[], metavar="MODULE", help=text)
