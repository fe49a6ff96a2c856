"""Lines and marks in panels, by the looks of methods.

Forty lines in one panel are not readable. So of more than FEW methods all lines are thin and grey except a few (`draw_methods`),
such as the best of each family (`best_of_families`). A legend below the panels names the others.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.figure
import pandas as pd
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties

from lagrange_bench.experiments.drawing.canvas import FAINT, plain
from lagrange_bench.experiments.drawing.looks import DASHES, OWN_DASHES, family, looks, of
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.integrators.registry import METHODS

TIME, STEP = "time · (|J| + √(|α||x|))", "step h · (|J| + √(|α||x|))"  # axes in the units of the top
LEAST = 1e-17  # where an error of 0 is drawn
WORDS = {"span_scaled": "t", "span": "t", "h_scaled": "h"}  # column → its word in the names of lines
ENTRY = 16  # font sizes: the width of an entry of a legend


def draw_method(
    ax: Axes, rows: pd.DataFrame, method: str, x: str, y: str, look: dict[str, Any], log: Sequence[bool] = (True, True)
) -> None:
    """Draw y against x for one method of `rows`; on a logarithmic axis the absolute value.

    A cross marks each x at which the method failed. A method without result is named with a cross. A line without a name has
    no crosses.
    """
    mine = rows[rows.method == method]
    good = mine[(mine.status == "done") & mine[x].notna() & mine[y].notna() & ((mine[x] > 0) | (not log[0]))]
    if not good.empty:
        ax.plot(good[x], good[y].abs().clip(lower=LEAST) if log[1] else good[y], **look)
        ax.set(**{f"{axis}scale": "log" for axis, is_log in zip("xy", log, strict=True) if is_log})
    if not str(look["label"]).startswith("_"):
        failed = mine[mine.status == "failed"][x].dropna()
        if not failed.empty:
            failure_marks(ax, failed, look["color"])
        if good.empty and failed.empty and (mine.status == "failed").any():
            ax.plot([], [], "x", color=look["color"], label=look["label"])


def draw_methods(ax: Axes, rows: pd.DataFrame, x: str, y: str, named: Iterable[str]) -> None:
    """`draw_method` for every method in one panel: up to FEW in their colours, of more all but the `named` thin and grey."""
    rows = rows.sort_values(x, kind="stable")
    for method, look in looks(rows.method, named).items():
        draw_method(ax, rows, method, x, y, look)


def best_of_families(errors: pd.Series) -> list[str]:
    """From each family the method with the least error, the best first. errors : by method."""
    known = errors.dropna().sort_values()
    return list(known[~pd.Series(known.index.map(family), known.index).duplicated()].index)


def draw_lines(
    ax: Axes,
    rows: pd.DataFrame,
    x: str,
    y: str,
    apart: Sequence[str],
    looks: Mapping[str, dict[str, Any]],
    log: Sequence[bool] = (True, True),
) -> None:
    """`draw_method` for each method in `looks`, with a line for each set of values of the columns `apart`.

    The lines of one method differ by their dashes, and their names say the values. A line joins rows in their order.
    """
    for method, look in looks.items():
        for i, (words, line) in enumerate(lines(rows[rows.method == method], apart)):
            named = {**look, "label": ", ".join([look["label"], *map(plain, words)])}
            if i and "linestyle" in look:
                dashes = DASHES if look["linestyle"] in DASHES else OWN_DASHES
                named["linestyle"] = dashes[(dashes.index(look["linestyle"]) + i) % len(dashes)]
            draw_method(ax, line, method, x, y, named, log)


def lines(rows: pd.DataFrame, apart: Sequence[str]) -> list[tuple[list[str], pd.DataFrame]]:
    """For each line of one method: the words of its name about the columns that differ, and its rows."""
    columns = [name for name in apart if name in rows and rows[name].nunique() > 1]
    if not columns:
        return [([], rows)]

    def words(values: Any) -> list[str]:
        known = [pair for pair in zip(columns, values, strict=True) if pd.notna(pair[1]) and pair[1] != ""]
        return [v if isinstance(v, str) else f"{WORDS.get(name, name)} = {show(v)}" for name, v in known]

    return [(words(values), line) for values, line in rows.groupby(columns, dropna=False)]


def legend_below(fig: matplotlib.figure.Figure) -> None:
    """One legend for all axes below them, each name once. The figure grows by it."""
    entries: dict[str, Any] = {}
    for ax in fig.axes:
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            entries.setdefault(text, handle)
    places = {of(name)["label"]: i for i, name in enumerate(METHODS)}
    texts = sorted(entries, key=lambda text: places.get(text, len(places)))
    size = FontProperties(size=rcParams["legend.fontsize"]).get_size_in_points()
    columns = max(int(72 * fig.get_figwidth() / (ENTRY * size)), 1)
    fig.set_figheight(fig.get_figheight() + 1.5 * size / 72 * math.ceil(len(texts) / columns))
    fig.legend([entries[text] for text in texts], texts, loc="outside lower center", ncols=columns)


def failure_marks(ax: Axes, x: pd.Series, colour: str) -> None:
    """A cross at the top of the axes for every x at which a method failed."""
    is_first = not any(line.get_gid() == "failed" for line in ax.get_lines())
    at_top: dict[str, Any] = {"transform": ax.get_xaxis_transform(), "clip_on": False, "zorder": 5}
    ax.plot(x, [0.99] * len(x), "x", gid="failed", label="failed" if is_first else "_failed", color=colour, **at_top)


def ulp_line(ax: Axes) -> None:
    """A thin line at an error of one ulp."""
    ax.axhline(2.0**-52, color=FAINT, linewidth=0.6)


def slope_guide(ax: Axes, exponent: float, anchor: tuple[float, float], span: float, text: str) -> None:
    """A dotted line y ∝ x^exponent on log-log axes, from `anchor` over a factor `span` in x, with the name `text` at its end."""
    x0, y0 = anchor
    x1, y1 = x0 * span, y0 * span**exponent
    ax.plot([x0, x1], [y0, y1], color=FAINT, linewidth=1.0, linestyle=":", label="_guide")
    ax.annotate(text, (x1, y1), (2, 0), textcoords="offset points", fontsize=6.5, color=FAINT).set_in_layout(False)
