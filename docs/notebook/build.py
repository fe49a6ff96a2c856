"""Runs the cells of the-top.ipynb and stores what they print and draw: python docs/notebook/build.py.

Needs neither Jupyter nor nbformat; the same cells and the same versions of NumPy and Matplotlib give the same bytes.
"""

import base64
import contextlib
import io
import json
from pathlib import Path
from typing import Any

import matplotlib

NOTEBOOK = Path(__file__).with_name("the-top.ipynb")
DPI = 80


def run(code: str, scope: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs one cell; its outputs: what it printed, and the figures it left open."""
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(NOTEBOOK), "exec"), scope)
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
    """The notebook with the outputs of today."""
    matplotlib.use("agg")
    scope: dict[str, Any] = {"__name__": "__main__"}
    written = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    code = [cell for cell in written["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(code, 1):
        cell |= {"execution_count": count, "outputs": run("".join(cell["source"]), scope)}
    return written


if __name__ == "__main__":
    NOTEBOOK.write_text(json.dumps(notebook(), ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
    print(NOTEBOOK, f"{NOTEBOOK.stat().st_size // 1000} kB")
