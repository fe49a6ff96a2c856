"""Files that a command is asked to write."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagrange_bench.experiments.drawing.style import Figure

TABLES, PICTURES = (".csv", ".npz", ".parquet"), (".svg", ".pdf", ".png")


def check_target(flag: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """ValueError naming `flag` if the file could not be written, as far as that can be known before."""
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


def write_picture(path: Path, figure: Figure) -> str:
    """Write a figure in the format that the name ends in, and say what was done."""
    from lagrange_bench.experiments.drawing import figures
    from lagrange_bench.integrators.files import replace_file

    return replace_file(path, figures.FORMATS[path.suffix.lower().removeprefix(".")](figure))
