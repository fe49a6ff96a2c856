"""Marks and names in panels, by the looks of methods.

Forty lines in one panel are not readable. So every family has a panel of its own (`by_family`), or all lines are thin except the
best of each family (`looks`). Lines are named where they end (`label_ends`), not in a legend.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import matplotlib.figure
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator
from matplotlib.transforms import blended_transform_factory, offset_copy

from lagrange_bench.experiments.drawing.canvas import FAINT, INK, TALLEST, Figure, panels, plain, width
from lagrange_bench.experiments.drawing.looks import (
    DASHES,
    FAMILIES,
    OTHERS,
    OWN_DASHES,
    TITLES,
    family,
    label,
    looks,
    of,
    ordered,
    readable,
)
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.integrators.registry import METHODS

TIME, STEP = "time · (|J| + √(|α||x|))", "step h · (|J| + √(|α||x|))"  # axes in the units of the top
REFERENCE = "backlund"  # pale in every panel of small multiples
LEAST = 1e-17  # where an error of 0 is drawn
WORDS = {"span_scaled": "t", "span": "t", "h_scaled": "h"}  # column → its word in the names of lines


def draw_method(
    ax: Axes, rows: pd.DataFrame, method: str, x: str, y: str, look: dict[str, Any], log: Sequence[bool] = (True, True)
) -> None:
    """Draw y against x for one method of `rows`; on a logarithmic axis the absolute value.

    A cross marks each x at which the method failed. A method without result and without such an x has a cross before its name.
    A line without a name has no crosses.
    """
    mine = rows[rows.method == method]
    good = mine[(mine.status == "done") & mine[x].notna() & mine[y].notna() & ((mine[x] > 0) | (not log[0]))]
    if not good.empty:
        ax.plot(good[x], good[y].abs().clip(lower=LEAST) if log[1] else good[y], **look)
        ax.set(**{f"{axis}scale": "log" for axis, is_log in zip("xy", log, strict=True) if is_log})
    if not str(look["label"]).startswith("_"):
        failed = mine[mine.status == "failed"][x].dropna()
        failure_marks(ax, failed, method)
        if good.empty and failed.empty:
            failed_label(ax, method)


def draw_methods(ax: Axes, rows: pd.DataFrame, x: str, y: str, named: Iterable[str]) -> None:
    """`draw_method` for every method in one panel: up to FEW in their colours, of more all but the `named` thin and grey."""
    rows = rows.sort_values(x, kind="stable")
    for method, look in looks(rows.method, named).items():
        draw_method(ax, rows, method, x, y, {**look, "zorder": 1.5 if look["label"] == "_thin" else 3})


def nearest(rows: pd.DataFrame, column: str, value: float) -> pd.DataFrame:
    """The rows whose positive `column` is nearest to a value."""
    values = rows[column].dropna().unique()
    return rows[rows[column] == values[np.argmin(np.abs(np.log(values / value)))]] if len(values) else rows


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


def by_family(
    rows: pd.DataFrame, x: str, y: str, xlabel: str, ylabel: str, ylim: tuple[float, float], marker: str | None = None
) -> tuple[Figure, list[Axes]]:
    """Small multiples of `draw_method`: a panel for each family, two to a row, the reference pale in each, lines named."""

    def line(ax: Axes, method: str, look: dict[str, Any]) -> None:
        draw_method(ax, rows, method, x, y, look | ({"marker": marker} if marker else {}))

    rows = rows.sort_values(x, kind="stable")
    fig, axes = multiples(rows.method, line, xlabel, ylabel, ylim)
    label_ends(axes)
    return fig, axes


def multiples(
    methods: Iterable[str], line: Callable[..., None], xlabel: str, ylabel: str, ylim: tuple[float, float]
) -> tuple[Figure, list[Axes]]:
    """The panels of `by_family` with any lines: line(ax, method, look) draws one."""
    names = ordered(methods)
    groups = [group for group in (*FAMILIES, OTHERS) if any(family(name) == group for name in names)]
    narrow = width() == "column"
    columns = 1 if narrow else min(len(groups), 2)
    small = {"markersize": 2.2 if narrow else 3.0, "markeredgewidth": 0.4}
    titles = [TITLES.get(group, group) for group in groups]
    fig, axes = panels(titles, columns, (0.45, 1.75), xlabel, ylabel, sharex=True, sharey=True)
    for ax, group in zip(axes, groups, strict=True):
        if group != family(REFERENCE) and REFERENCE in names:
            beside = {"color": of(REFERENCE)["color"], "alpha": 0.35, "linewidth": 2.2, "marker": "o", "zorder": 1}
            line(ax, REFERENCE, {**beside, **small, "label": "_reference"})
        for name in names:
            if family(name) == group:
                line(ax, name, {**of(name), **small})
        ax.set_ylim(ylim)
    low, high = (math.ceil(math.log10(limit)) for limit in ylim)
    powers = [10.0**k for k in range(low, high + 1) if k % (5 if narrow else 3) == 0]
    axes[0].yaxis.set_major_locator(FixedLocator(powers))
    return fig, axes


def label_ends(panels: Iterable[Axes], fontsize: Any = 6.5) -> None:
    """Write the name of each labelled line where it leaves its panel, without overlap. Call it last."""
    for ax in panels:
        _Ends(ax, fontsize)


class _Ends(Artist):
    """The names at the ends of the lines of a panel; names without a line (`failed_label`) are on top.

    They are placed each time the panel is drawn, because limits and sizes may have changed. They stand right of the panel, or
    inside it if the figure has no room there. A line out of sight has no name.
    """

    zorder = -1.0  # drawn before the names that it moves

    def __init__(self, ax: Axes, fontsize: Any) -> None:
        super().__init__()
        self.panel = ax
        lines = [line for line in ax.get_lines() if not str(line.get_label()).startswith("_")]
        self.lines = [line for line in lines if line.get_label() != "failed" and np.isfinite(line.get_ydata()).any()]
        look: dict[str, Any] = {"x": 1.05, "y": 0.5, "fontsize": fontsize, "va": "center", "transform": ax.transAxes}
        self.texts = [ax.text(s=str(line.get_label()), color=readable(line.get_color()), **look) for line in self.lines]
        self.failed = [text for text in ax.texts if text.get_gid() == "failed"]
        for text in self.failed:
            text.set(**look)
        colours = [line.get_color() for line in self.lines]
        self.leaders = LineCollection([], colors=colours, linewidths=0.4, transform=ax.transAxes, clip_on=False)
        self.leaders.set_in_layout(False)
        self.set_in_layout(False)
        ax.add_collection(self.leaders, autolim=False)
        ax.add_artist(self)

    def draw(self, renderer: Any) -> None:
        """Place the names, now that the panel has its size."""
        names = [*self.texts, *self.failed]
        if not names:
            return
        ends = [_last_point(self.panel, line) for line in self.lines]
        upwards = sorted((end[1], i) for i, end in enumerate(ends) if end)
        width, height = self.panel.bbox.size
        gap = 1.25 * float(names[0].get_fontsize()) * renderer.points_to_pixels(1.0) / height
        places = _spread([*(y for y, _ in upwards), *(1.0 for _ in self.failed)], gap)
        widest = max(text.get_window_extent(renderer).width for text in names)
        here = (self.panel, *twins(self.panel))
        numbers = any(ax.yaxis.get_ticks_position() == "right" for ax in here)  # are where the names would be
        outside = not numbers and _room(self.panel) >= 1.05 * width + widest
        for text, end in zip(self.texts, ends, strict=True):
            text.set_visible(end is not None)
        for text, place in zip([*(self.texts[i] for _, i in upwards), *self.failed], places, strict=True):
            text.set(x=1.05 if outside else 0.99, y=place, ha="left" if outside else "right")
            text.set_path_effects([] if outside else [withStroke(linewidth=2, foreground="white")])
        joined = zip(ends, self.texts, strict=True)
        drawn = [(end, (1.04, text.get_position()[1])) if end and outside else np.empty((0, 2)) for end, text in joined]
        self.leaders.set_segments(drawn)


def twins(ax: Axes) -> list[Axes]:
    """The other axes in the place of a panel."""
    together = ax.get_shared_x_axes().get_siblings(ax)
    return [each for each in together if each is not ax and each.bbox.bounds == ax.bbox.bounds]


def _room(ax: Axes) -> float:
    """Pixels from the left end of a panel to the next panel on its right, or to the end of the figure."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    others = [other.bbox for other in figure.axes if other is not ax and other.bbox.x0 >= ax.bbox.x1]
    beside = [box.x0 for box in others if box.y0 < ax.bbox.y1 and ax.bbox.y0 < box.y1]
    return float(min([figure.bbox.x1, *beside]) - ax.bbox.x0)


def _last_point(ax: Axes, line: Any) -> tuple[float, float] | None:
    """The last visible point of a line, in fractions of the axes. A line above or below has it at that edge; others have None."""
    data = np.column_stack([np.asarray(v, dtype=float) for v in line.get_data()])
    with np.errstate(all="ignore"):
        points = ax.transAxes.inverted().transform(ax.transData.transform(data))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        return None
    way = np.diff(points, axis=0, append=points[-1:])
    way[way == 0] = 1e-12
    near, far = np.sort([-points / way, (1 - points) / way], axis=0)  # of each segment, where it meets the edges
    leave = np.minimum(far.min(axis=1), 1)
    seen = np.flatnonzero(np.maximum(near.max(axis=1), 0) <= leave)
    over = np.flatnonzero((points[:, 0] >= 0) & (points[:, 0] <= 1))
    if len(seen) == len(over) == 0:
        return None
    end = points[seen[-1]] + leave[seen[-1]] * way[seen[-1]] if len(seen) else points[over[-1]]
    x, y = np.clip(end, 0, 1)
    return float(x), float(y)


def _spread(places: Sequence[float], gap: float) -> np.ndarray:
    """Ascending places in [0, 1], moved as little as possible to lie `gap` apart, and inside the axes if there is room."""
    from scipy.optimize import isotonic_regression  # not at the start: it takes 0.2 s

    steps = gap * np.arange(len(places))
    low, high = gap / 2, 1 - gap * (len(places) - 0.5)
    middle = (low + high) / 2
    rising = isotonic_regression(places - steps).x if len(places) else steps
    return rising.clip(min(low, middle), max(high, middle)) + steps


def legend_below(fig: matplotlib.figure.Figure) -> None:
    """One legend for all axes below them, each name once, in as many columns as fit. The figure grows by it, up to TALLEST."""
    entries: dict[str, Any] = {}
    for ax in fig.axes:
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            entries.setdefault(text, handle)
    places = {of(name)["label"]: i for i, name in enumerate(METHODS)}
    texts = sorted(entries, key=lambda text: places.get(text, len(places)))
    handles = [entries[text] for text in texts]
    for columns in range(len(texts), 0, -1):
        legend = fig.legend(handles, texts, loc="outside lower center", ncols=columns, columnspacing=1.4)
        size = legend.get_window_extent()
        if columns == 1 or size.width <= 0.92 * fig.bbox.width:
            height = fig.get_figheight()
            fig.set_figheight(min(height + size.height / fig.dpi, max(height, TALLEST)))
            return
        legend.remove()


def failure_marks(ax: Axes, x: Iterable[float], method: str | None = None) -> None:
    """A cross at the top of the axes for every x at which a method failed, in a row for each method."""
    positions = list(x)
    if not positions:
        return
    figure = ax.get_figure(root=True)
    row = sum(line.get_gid() == "failed" for line in ax.get_lines())
    at_top = blended_transform_factory(ax.transData, ax.transAxes)
    ax.plot(
        positions, [1.0] * len(positions), linestyle="none", marker="x", markersize=3.2, markeredgewidth=0.9,
        color=of(method)["color"] if method else INK, clip_on=False, zorder=5, gid="failed",
        label="_failed" if row else "failed", transform=offset_copy(at_top, figure, y=-2 - 3.8 * row, units="points"),
    )  # fmt: skip


def failed_label(ax: Axes, method: str) -> None:
    """The name of a method without result in a panel, with a cross, in the corner, or where `label_ends` puts it."""
    above = sum(text.get_gid() == "failed" for text in ax.texts)
    text = f"× {plain(label(method))}"
    ax.text(
        0.02, 0.97 - 0.09 * above, text, color=readable(of(method)["color"]), fontsize=6.5, va="top",
        transform=ax.transAxes, gid="failed",
    )  # fmt: skip


def ulp_line(ax: Axes) -> None:
    """A thin line at an error of one ulp."""
    ax.axhline(2.0**-52, color=FAINT, linewidth=0.6)


def slope_guide(ax: Axes, exponent: float, anchor: tuple[float, float], span: float, text: str) -> None:
    """A thin line y ∝ x^exponent on log-log axes, from `anchor` over a factor `span` in x, with the name `text`."""
    x0, y0 = anchor
    x1, y1 = x0 * span, y0 * span**exponent
    ax.plot([x0, x1], [y0, y1], color=FAINT, linewidth=1.0, linestyle=(0, (1, 2)), marker="none", label="_guide")
    name = ax.annotate(text, (x1, y1), (2, 0), textcoords="offset points", fontsize=6.5, color=FAINT, va="center")
    name.set_in_layout(False)
