"""The words on a command line, and what they mean."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import Any

from lagrange_bench import integrate


def read(kind: Callable[[str], Any], text: str) -> Any:
    """`kind(text)`, for ASCII without underscores: Python also reads 1_0 and the digits of other scripts, users do not."""
    if not text.isascii() or "_" in text:
        raise ValueError(text)
    return kind(text)


def number(text: str) -> float:
    """A finite real number."""
    try:
        value: float = read(float, text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be a number; got {text!r}") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be finite; got {text}")
    return value


def numbers(text: str) -> list[float]:
    """Numbers separated by commas."""
    return [number(word) for word in text.split(",")]


def count(text: str) -> int:
    """A whole number, also as 1e6."""
    value = number(text)
    if value != int(value) or not 0 <= value <= 2**53:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 2^53; got {text!r}")
    return int(value)


def option(text: str) -> tuple[str, Any]:
    """key=value; the value is an int, a float, a complex number or a bool if it reads as one, else a word."""
    key, equals, value = text.partition("=")
    if not equals or not key.isidentifier():
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE; got {text!r}")
    for kind in (int, float, complex):
        try:
            return key, read(kind, value)
        except ValueError:
            continue
    return key, {"true": True, "false": False}.get(value.lower(), value)


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


LONGEST = 1e7  # s, of a --time-limit: four months


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
    from lagrange_bench.runner.cluster import check_address

    try:
        return check_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_module(command: argparse.ArgumentParser) -> None:
    text = "import this module of yours: an experiment, or methods named MODULE:METHOD; else only what is built in, "
    text += "installed or a sweep is known, whatever the results say; may be repeated"
    command.add_argument("--module", action="append", default=[], metavar="MODULE", help=text)
