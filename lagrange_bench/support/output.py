"""Formats what commands print: answers, tables, JSON. Checks and writes the files that the user names."""

import importlib.util
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

TABLES, PICTURES = (".csv", ".npz", ".parquet"), (".svg", ".pdf", ".png")
LEAST = 20  # characters to a line of the last column of a table


class Answer(NamedTuple):
    """The answer of a command: text, or data for --json; the exit code; and remarks for stderr, unless --quiet."""

    text: str
    data: Any
    code: int = 0
    remarks: Sequence[str] = ()


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns. A terminal that is too narrow wraps the last column."""
    *widths, last = (max(map(len, column)) for column in zip(*rows, strict=True))
    indent = sum(width + 2 for width in widths)
    if sys.stdout.isatty():
        last = max(shutil.get_terminal_size().columns - indent, LEAST)
    lines = []
    for *cells, end in rows:
        start = "".join(f"{cell:<{width + 2}}" for cell, width in zip(cells, widths, strict=True))
        first, *others = textwrap.wrap(end, max(last, 1)) or [""]
        lines += [(start + first).rstrip(), *(" " * indent + part for part in others)]
    return lines


def visible(text: str) -> str:
    """Text for a terminal, with control characters spelt out, except line ends and tabs."""
    return re.sub(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", lambda match: f"\\x{ord(match[0]):02x}", text)


def plain(value: Any) -> Any:
    """`value` for JSON: arrays become lists, dataclasses become objects, NaN and infinities become null."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {str(key): plain(content) for key, content in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(content) for content in value]
    if isinstance(value, complex):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_target(flag: str, path: Path | None, suffixes: tuple[str, ...]) -> None:
    """ValueError that names `flag` if `path` cannot be written, as far as this can be known before. None is fine."""
    if path is None:
        return
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{flag} {path}: the name must end in {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise ValueError(f"{flag} {path}: there is no folder {path.parent}")
    if path.suffix.lower() == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise ValueError(f"{flag} {path}: needs pyarrow: pip install pyarrow; or write .csv or .npz")
    if not os.access(path.parent, os.W_OK):
        raise ValueError(f"{flag} {path}: no permission to write in {path.parent.resolve()}")
