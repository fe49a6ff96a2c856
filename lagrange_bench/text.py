"""What commands print: answers, tables, JSON."""

import io
import math
import shutil
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

HEAD = 9  # letters of a word above a column that are not broken
WIDEST = 10_000  # columns of what is no terminal


class Answer(NamedTuple):
    """What a command prints, as text or with --json as data, and the exit code."""

    text: str
    data: Any
    code: int = 0


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns, the first row above them; in a terminal wrapped to its width, else a line for each row."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    head, *body = rows
    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    for i, name in enumerate(head):
        least = min(max(map(len, name.split()), default=0), HEAD)
        made.add_column(Text(name), no_wrap=i == 0, overflow="fold", min_width=least)
    for row in body:
        made.add_row(*map(Text, row))
    console = Console(file=io.StringIO(), width=terminal_width(), color_system=None)
    with console.capture() as captured:
        console.print(made)
    return [line.rstrip() for line in captured.get().splitlines()]


def terminal_width() -> int:
    """Columns of the terminal; plenty where stdout is none: a line for each row can be searched."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else WIDEST


def plain(value: Any) -> Any:
    """`value` for JSON: arrays become lists, NaN and infinities null."""
    if isinstance(value, dict):
        return {str(key): plain(content) for key, content in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(content) for content in value]
    if isinstance(value, complex):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
