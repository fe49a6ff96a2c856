"""Reads the words that a user writes, on a command line or in a file, and suggests the word he may have meant."""

import difflib
import math
import re
from collections.abc import Callable, Iterable
from typing import Any

SYNONYMS = {"heyoka": "taylor", "midpoint": "implicit_midpoint"}  # what others call a method


def suggestion(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the closest known name, if one is close. Capitals do not matter."""
    lower = {word.lower(): word for word in known}
    word = SYNONYMS.get(name.lower(), name.lower())
    close = [word] if word in lower else difflib.get_close_matches(word, lower, n=1)
    return f"; did you mean {lower[close[0]]!r}?" if close else "."


def read(kind: Callable[[str], Any], text: str) -> Any:
    """`kind(text)`, for ASCII without underscores. Python also reads 1_0 and digits of other scripts; users do not write them."""
    if not text.isascii() or "_" in text:
        raise ValueError(text)
    return kind(text)


def number(text: str) -> float:
    """A finite real number."""
    try:
        value: float = read(float, text)
    except ValueError:
        raise ValueError(f"must be a number; got {text!r}") from None
    if not math.isfinite(value):
        raise ValueError(f"must be finite; got {text}")
    return value


def numbers(text: str) -> list[float]:
    """Numbers separated by commas."""
    return [number(word) for word in text.split(",")]


def option(text: str) -> tuple[str, Any]:
    """key=value. The value becomes an int, a float, a complex number or a bool if possible; else it stays a word."""
    key, equals, value = text.partition("=")
    if not equals or not key.isidentifier():
        raise ValueError(f"must be KEY=VALUE; got {text!r}")
    for kind in (int, float, complex):
        try:
            return key, read(kind, value)
        except ValueError:
            continue
    return key, {"true": True, "false": False}.get(value.lower(), value)


def scheduler(text: str) -> str:
    """local:N, or the address of a Dask scheduler."""
    if re.fullmatch(r"local:[1-9]\d*|(tcp|tls)://.+:\d+", text, re.ASCII):
        return text
    raise ValueError(f"the scheduler must be tcp://HOST:PORT or local:N; got {text!r}")
