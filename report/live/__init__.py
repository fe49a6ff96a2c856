"""The live top: the part of the page that computes in the reader's browser.

`top.js` is the mathematics (the exact Bäcklund map and three rivals), `picture.js` draws on canvases,
`view.js` has the controls. Nothing is fetched.
"""

from __future__ import annotations

import json
from pathlib import Path

from markupsafe import Markup

from experiments.drawing import style
from integrators.problem.top import TOPS

HERE = Path(__file__).parent
METHODS = ("backlund", "backlund_paper", "implicit_midpoint", "strang", "rk4")  # those of top.js
FREE = {"name": "free", "label": "Bäcklund, λ of your own", "color": "#5A5A5A"}


def script() -> Markup:
    """What the section needs: the tops and colours as data, the mathematics, the pictures, the controls."""
    data = {
        "tops": [
            {"name": t.name, "label": t.label, "note": t.note, "alpha": t.alpha, "y": t.y0} for t in TOPS.values()
        ],
        "methods": [{"name": name, **{key: style.of(name)[key] for key in ("label", "color")}} for name in METHODS]
        + [FREE],
    }
    parts = [f"const LIVE = {json.dumps(data, ensure_ascii=False)};", *map(_read, ("top.js", "picture.js", "view.js"))]
    return Markup("\n".join(parts).replace("</", "<\\/"))


def _read(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
