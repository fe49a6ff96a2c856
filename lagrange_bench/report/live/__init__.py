"""The live top: the part of the page that computes in the reader's browser.

`top.js` is the mathematics (the exact Bäcklund map, three rivals, and all in a weak tide), `picture.js` draws on
canvases, `view.js` has the controls; `tumble.js` is the tumbling body, whole. Nothing is fetched.
"""

import json
from pathlib import Path

from markupsafe import Markup

from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators.problem.top import TOPS

HERE = Path(__file__).parent
# those of top.js, and what each becomes in a tide: the exact step the inside of a splitting; None: it is for no tide
METHODS = {
    "backlund": "backlund_splitting",
    "backlund_paper": None,
    "implicit_midpoint": "implicit_midpoint",
    "strang": "strang",
    "rk4": "rk4",
}
FREE = {"name": "free", "label": "Bäcklund, λ of your own", "color": "#5A5A5A", "offered": True}

DISTURBED = {
    "name": "sleeping_disturbed",
    "label": "sleeping, unstable, tilted by 10⁻³",
    "note": "falls from the upright, and comes back to it",
    "y": (0.0, 0.0, 1.0, 1e-3, 0.0, 1.0),
}


def script() -> Markup:
    """What the section needs: the tops and colours as data, the mathematics, the pictures, the controls."""
    tops = [{"name": t.name, "label": t.label, "note": t.note, "alpha": t.alpha, "y": t.y0} for t in TOPS.values()]
    tops.append({**next(top for top in tops if top["name"] == "sleeping_unstable"), **DISTURBED})
    data = {
        "tops": tops,
        "methods": [
            *({**_look(name), "offered": True, "tide": other} for name, other in METHODS.items()),
            FREE,
            *(_look(other) for other in METHODS.values() if other and other not in METHODS),
        ],
    }
    scripts = [(HERE / name).read_text(encoding="utf-8") for name in ("top.js", "picture.js", "view.js", "tumble.js")]
    parts = [f"const LIVE = {json.dumps(data, ensure_ascii=False)};", *scripts]
    return Markup("\n".join(parts).replace("</", "<\\/"))


def _look(name: str) -> dict[str, str]:
    look = style.of(name)
    return {"name": name, "label": look["label"], "color": look["color"]}
