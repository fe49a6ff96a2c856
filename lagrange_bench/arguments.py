"""The words on a command line, and what they mean."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lagrange_bench.integrators import words


def argument(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """`parse` as the type of an option: what it says about a word becomes the message."""

    def kind(text: str) -> Any:
        try:
            return parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return kind


number, numbers, option = argument(words.number), argument(words.numbers), argument(words.option)


def count(text: str) -> int:
    """A whole number, also as 1e6."""
    value = number(text)
    if value != int(value) or not 0 <= value <= 2**53:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 2^53; got {text!r}")
    return int(value)


def whole(text: str) -> int:
    """A whole number."""
    try:
        return int(words.read(int, text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a whole number; got {text!r}") from None


def positive(text: str) -> int:
    """A whole number from 1 on."""
    number = whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1; got {number}")
    return number


LONGEST = 1e7  # s, of a --time-limit: four months


def seconds(text: str) -> float:
    """A length of time that is worth waiting for."""
    value = number(text)
    if not 0 < value <= LONGEST:
        raise argparse.ArgumentTypeError(f"must be positive and at most {LONGEST:g}; got {text}")
    return float(value)


def tolerance(text: str) -> float:
    """A number that is not negative."""
    value = number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"must not be negative; got {text}")
    return float(value)


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    found = tuple(word.strip() for word in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"must be names separated by commas; got {text!r}")
    return found


def location(text: str) -> Path:
    """A file or folder. An empty word, as of a shell variable that is not set, would be the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("must name a file or folder; got an empty word")
    return Path(text)


def limits(text: str) -> tuple[float, float]:
    """Two numbers, the ends of an axis."""
    ends = numbers(text)
    if len(ends) != 2 or ends[0] == ends[1]:
        raise argparse.ArgumentTypeError(f"must be two numbers, as 1e-3,10; got {text!r}")
    return float(ends[0]), float(ends[1])


def add_choice(command: argparse.ArgumentParser) -> None:
    for flag, what in (("--methods", "methods (of mine.py: mine:METHOD)"), ("--tops", "tops")):
        text = f"only the cells of these {what}; cells that belong to none are left out, too (default: all)"
        command.add_argument(flag, type=names, metavar="a,b,…", default=(), help=text)
    text = "draw these methods in black dashes and name them in every figure, as plug-ins always are"
    command.add_argument("--highlight", type=names, metavar="a,b,…", default=(), help=text)


def choice_of(options: argparse.Namespace) -> Any:
    """What `add_choice` was given; methods in files of the user's own are known from then on."""
    from lagrange_bench.results.choice import Choice

    choice = Choice(options.methods, options.tops, options.highlight)
    choice.include()
    return choice


def check_choice(results: Any, choice: Any) -> None:
    """ValueError for a name that nothing in a folder of results has."""
    from lagrange_bench.results.store import Store

    store = Store(results)
    choice.check(record["cell"] for name in store.experiments() for record in store.latest(name))


def named_top(name: str) -> Any:
    """The named top, in a potential or not, of the bench, of a package or of the user's own `module:TOP`."""
    from lagrange_bench.integrators.registry import find_top

    try:
        return find_top(name)
    except ValueError as error:
        raise ValueError(f"--top: {error}") from None


def add_potential(command: Any) -> None:
    text = "put the top in this potential: a name, see lagrange-bench potentials, or package.module:POTENTIAL"
    command.add_argument("--potential", metavar="NAME", help=text)
    text = "the numbers of its parameters, in their order"
    command.add_argument("--parameters", type=numbers, metavar="p,p,…", help=text)


def in_potential(top: Any, options: argparse.Namespace) -> Any:
    """The top in the potential of --potential and --parameters, if there is one."""
    from lagrange_bench.integrators import PerturbedTop
    from lagrange_bench.integrators.registry import find_potential

    if options.potential is None:
        if options.parameters is not None:
            raise ValueError("--parameters belongs to --potential")
        return top
    if "uniform" not in top.offers:
        raise ValueError(f"--potential: {options.top} is in the potential {top.potential.name} already")
    try:
        return PerturbedTop(top, find_potential(options.potential), tuple(options.parameters or ()))
    except ValueError as error:
        raise ValueError(f"--potential: {error}") from None


def add_module(command: argparse.ArgumentParser) -> None:
    text = "import this module of yours: an experiment, or methods and potentials named MODULE:NAME; else only what is built "
    text += "in, installed or a sweep is known, whatever the results say; may be repeated"
    command.add_argument("--module", action="append", default=[], metavar="MODULE", help=text)
