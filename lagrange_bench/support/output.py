"""Formats what commands print: answers, tables, JSON. Checks and writes the files that the user names."""

import importlib.util
import io
import math
import os
import re
import shutil
import sys
from collections.abc import Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

TABLES, PICTURES = (".csv", ".npz", ".parquet"), (".svg", ".pdf", ".png")
HEAD = 9  # words of a heading up to this length are not broken
WIDEST = 10_000  # columns, if stdout is no terminal


class Answer(NamedTuple):
    """The answer of a command: text, or data for --json; the exit code; and remarks for stderr, unless --quiet."""

    text: str
    data: Any
    code: int = 0
    remarks: Sequence[str] = ()


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns below the first row. A terminal wraps them to its width; else each row is a line."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    head, *body = rows
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    for i, name in enumerate(head):
        least = min(max(map(len, name.split()), default=0), HEAD)
        grid.add_column(Text(name), no_wrap=i == 0, overflow="fold", min_width=least)
    for row in body:
        grid.add_row(*map(Text, row))
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDEST
    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as captured:
        console.print(grid)
    return [line.rstrip() for line in captured.get().splitlines()]


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
    folder = path.parent
    if not folder.is_dir():
        raise ValueError(f"{flag} {path}: there is no folder {folder}")
    if path.exists() and not path.is_file():
        raise ValueError(f"{flag} {path}: this is not a file")
    if path.suffix.lower() == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise ValueError(f"{flag} {path}: needs pyarrow: pip install pyarrow; or write .csv or .npz")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{flag} {path}: no permission to write in {folder.resolve()}")
