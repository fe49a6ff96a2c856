"""Writes the-top.ipynb from the_top.py, runs its cells and stores what they print and draw: python docs/notebook/build.py.

A cell begins with a line `# %%`, or `# %% [markdown]` for text. Needs neither Jupyter nor nbformat; the same sources and the same
versions of NumPy and Matplotlib give the same bytes.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import matplotlib

SOURCE = Path(__file__).with_name("the_top.py")
TARGET = Path(__file__).with_name("the-top.ipynb")
DPI = 80


def cells() -> list[tuple[str, str]]:
    """(kind, text) of each cell of the source, kind "markdown" or "code"."""
    parts = re.split(r"^# %%(| \[markdown\])\n", SOURCE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = []
    for mark, text in zip(parts[1::2], parts[2::2], strict=True):
        kind = "markdown" if mark else "code"
        found.append((kind, re.sub(r"^# ?", "", text, flags=re.MULTILINE).strip() if mark else text.strip()))
    return found


def run(code: str, scope: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs one cell; its outputs: what it printed, and the figures it left open."""
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(TARGET), "exec"), scope)
    outputs: list[dict[str, Any]] = []
    if text := printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)})
    for number in plt.get_fignums():
        picture = io.BytesIO()
        plt.figure(number).savefig(picture, format="png", dpi=DPI, metadata={"Software": None})
        data = {"image/png": base64.b64encode(picture.getvalue()).decode(), "text/plain": ["<Figure>"]}
        outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})
    plt.close("all")
    return outputs


def notebook() -> dict[str, Any]:
    """The notebook as its format wants it, version 4.5."""
    matplotlib.use("agg")
    scope: dict[str, Any] = {"__name__": "__main__"}
    written, count = [], 0
    for number, (kind, text) in enumerate(cells()):
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number:02}", "metadata": {}}
        cell["source"] = text.splitlines(keepends=True)
        if kind == "code":
            count += 1
            cell |= {"execution_count": count, "outputs": run(text, scope)}
        written.append(cell)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": written, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


if __name__ == "__main__":
    TARGET.write_text(json.dumps(notebook(), ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
    print(TARGET, f"{TARGET.stat().st_size // 1000} kB")
