"""The canvas of every figure: sizes, fonts, panels, ticks and plain text. What methods look like is not its concern.

Text in SVG files is text: a reader can search and copy it. Where there is no DejaVu Sans, Verdana has the same widths; PDF and
PNG have the font in them.
"""

import math
import textwrap
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator

from lagrange_bench.experiments.drawing.tables import show

WIDTHS = {"column": 3.4, "page": 7.0}  # inches: one and two columns of a journal page
TALLEST = 9.2  # inches: what a journal page holds
LONGEST = 44  # letters of a label in a column
_FORCED: ContextVar[str | None] = ContextVar("width of every figure", default=None)
HIGHLIGHTED: ContextVar[tuple[str, ...]] = ContextVar("methods that stand out", default=())
ARCHIVED: ContextVar[bool] = ContextVar("methods of the archive are drawn, too", default=False)
_LIMITS: ContextVar[dict[str, tuple[float, float]]] = ContextVar("limits of every panel", default={})  # noqa: B039
DECADES = 4  # an axis of more has no ticks between the powers of ten
LESS = 0.6  # decades: an axis of less has no room for numbers at 1, 2 and 5
INK, FAINT = "#222222", "#6b6b6b"
TITLE = "title: "  # before the name of a line, as its gid: what an SVG shows of a line pointed at

RC: Any = {
    "svg.hashsalt": "lagrange-bench",  # ids in an SVG depend on its content only: same rows, same bytes
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # TrueType, which journals ask for
    "savefig.dpi": 200,  # of what is rasterized inside an SVG
    "font.family": "DejaVu Sans",  # comes with matplotlib, so every machine lays out the same figure
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5,
    "axes.titley": 1.0,  # where it would be anyhow, but nobody has to search
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.prop_cycle": cycler(color=["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5A5A5A"]),
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "lines.markeredgewidth": 0.8,
    "lines.solid_capstyle": "round",
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
}
TICKS = {"labelsize": 7, "color": FAINT, "labelcolor": INK}
TICKS |= {"major.width": 0.6, "minor.width": 0.4, "major.size": 3, "minor.size": 1.5}
RC |= {f"{axis}tick.{name}": value for axis in "xy" for name, value in TICKS.items()}


class Figure(matplotlib.figure.Figure):
    """A matplotlib figure with the sentence that goes below it. Belongs to no pyplot, so nothing leaks."""

    caption: str = ""
    headline: str = ""  # what the rows show, in a few words
    stacked: Any = None  # the panels as they would be side by side, where they are on top of each other

    def savefig(self, *args: Any, **settings: Any) -> None:
        """In this style, whatever the reader's own matplotlibrc says."""
        with apply():
            super().savefig(*args, **settings)

    def draw(self, renderer: Any) -> None:
        for ax in self.axes:
            _choose_ticks(ax)
        super().draw(renderer)


def _choose_ticks(ax: Axes) -> None:
    """On logarithmic axes: none between the powers of ten of many decades; labels of x that do not touch on few."""
    for axis, scale, limits in ((ax.xaxis, ax.get_xscale(), ax.get_xlim()), (ax.yaxis, ax.get_yscale(), ax.get_ylim())):
        if scale != "log":
            continue
        low, high = sorted(np.log10(limits))
        if high - low > DECADES:
            axis.set_minor_locator(NullLocator())
        powers = math.floor(high) - math.ceil(low) + 1
        if axis is ax.xaxis and powers < 2 and type(axis.get_major_locator()) is LogLocator:
            few_decades(axis, high - low)


@contextmanager
def apply(width: str | None = None, highlight: Sequence[str] = (), archive: bool = False) -> Iterator[None]:
    """The style, whatever the reader's own matplotlibrc says. Draw and save inside.

    width : "column" or "page", of every figure drawn inside; None leaves it to who draws. highlight : methods that stand
    out, as those of plug-ins do. archive : whether figures of many methods show those of the archive, too.
    """
    if width is not None and width not in WIDTHS:
        raise ValueError(f"width must be one of {', '.join(WIDTHS)}, got {width!r}")
    before, highlighted, archived = _FORCED.set(width), HIGHLIGHTED.set(tuple(highlight)), ARCHIVED.set(archive)
    try:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(RC)
            yield
    finally:
        _FORCED.reset(before)
        HIGHLIGHTED.reset(highlighted)
        ARCHIVED.reset(archived)


@contextmanager
def limits(**ends: tuple[float, float] | None) -> Iterator[None]:
    """Figures that are printed inside have these limits in every panel: xlim, ylim, as of `set_xlim`."""
    before = _LIMITS.set({name: pair for name, pair in ends.items() if pair is not None})
    try:
        yield
    finally:
        _LIMITS.reset(before)


def width() -> str:
    """Of a figure meant for a page: "page", or "column" where `apply` forces that."""
    return _FORCED.get() or "page"


def figure(width: str | float = "page", height: float | None = None, **subplots: Any) -> tuple[Figure, Any]:
    """A figure and its axes, as `Figure.subplots(**subplots)` gives them.

    width : "column" (3.4 in), "page" (7 in) or inches. height : inches; default: the width's share of each row of axes.
    Where `apply` forces another width, a figure meant for a page has its panels one below the other in a column.
    """
    inches = WIDTHS[width] if isinstance(width, str) else width
    rows, columns = subplots.get("nrows", 1), subplots.get("ncols", 1)
    if height is None:
        height = 0.4 + rows * min(0.68 * inches / columns, 3.2)
    forced, stacked, panels_high = _FORCED.get(), False, height * columns
    if forced is not None and WIDTHS[forced] != inches:
        # a list of many rows gets narrower, but not shorter; more panels than a page holds are there to be scrolled
        many = panels_high > 1.6 * TALLEST
        stacked = forced == "column" and columns > 1 and (rows > 1 or not many)
        inches, height = WIDTHS[forced], panels_high if stacked else height
        height = height if stacked and many else min(height, TALLEST)
    fig = Figure(figsize=(inches, height), layout="constrained")
    if not stacked:
        return fig, fig.subplots(**subplots)
    fig.stacked = _stack(fig, **subplots)
    squeezed = fig.stacked if not subplots.get("squeeze", True) else np.squeeze(fig.stacked)
    return fig, squeezed if squeezed.ndim else squeezed.item()


def _stack(fig: Figure, nrows: int = 1, ncols: int = 1, subplot_kw: Any = None, **more: Any) -> Any:
    """Axes as `Figure.subplots` makes them, but all in one column; what they share they share."""
    grid = np.empty((nrows, ncols), dtype=object)
    for i, j in np.ndindex(nrows, ncols):
        firsts = {True: grid[0, 0], "all": grid[0, 0], "row": grid[i, 0], "col": grid[0, j]}
        shared = {name: firsts.get(more.get(name)) for name in ("sharex", "sharey")}
        grid[i, j] = fig.add_subplot(nrows * ncols, 1, i * ncols + j + 1, **shared, **(subplot_kw or {}))
    return grid


def panels(
    titles: Sequence[str], columns: int, heights: tuple[float, float], xlabel: str, ylabel: str, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A panel for each title, so many to a row; `heights` of the figure without them, and of a row, in inches."""
    columns = min(columns, len(titles))
    rows = -(-len(titles) // columns)
    fig, grid = figure("page", heights[0] + heights[1] * rows, nrows=rows, ncols=columns, squeeze=False, **shared)
    for ax, title in zip(grid.flat, titles, strict=False):
        ax.set_title(title)
    for ax in grid.flat[len(titles) :]:
        ax.remove()
    for column in grid.T:
        last = [ax for ax in column if ax.figure is not None][-1]
        last.set_xlabel(xlabel)
        last.tick_params(labelbottom=True)
    if rows > 1:
        fig.supylabel(ylabel, fontsize=RC["axes.labelsize"])
    else:
        grid[0, 0].set_ylabel(ylabel)
    return fig, list(grid.flat[: len(titles)])


def plain(name: str) -> str:
    """A name as text of a figure: no formula, whatever dollars are in it, and nothing that cannot be printed."""
    return printable(name).replace("$", r"\$")


def printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def set_limits(ax: Any, limits: Mapping[str, tuple[float | None, float | None]]) -> None:
    """Limits of xlim and ylim. ValueError: those of a logarithmic axis are not positive; matplotlib would ignore them."""
    for name, ends in limits.items():
        if getattr(ax, f"get_{name[0]}scale")() == "log" and any(end is not None and end <= 0 for end in ends):
            given = ", ".join("None" if end is None else f"{end:g}" for end in ends)
            raise ValueError(f"{name}: the axis is logarithmic, so limits must be positive; got {given}")
        ax.set(**{name: ends})


def finish(fig: matplotlib.figure.Figure) -> None:
    """Makes a figure ready to be saved; panels on top of each other get the labels they had from their neighbours."""
    for ax in fig.axes:
        set_limits(ax, _LIMITS.get())
        _choose_ticks(ax)  # or thousands of them are made, to be looked at and thrown away
    if fig.get_figwidth() == WIDTHS["column"]:
        for ax in fig.axes:
            place = ax.get_subplotspec()
            if place and place.get_gridspec().ncols > 2:
                ax.set_xlabel(textwrap.fill(ax.get_xlabel(), 10), fontsize=RC["xtick.labelsize"])
            elif len(ax.get_xlabel()) > LONGEST:
                ax.set_xlabel(textwrap.fill(ax.get_xlabel(), LONGEST))
    grid = getattr(fig, "stacked", None)
    if grid is None:
        return
    fig.stacked = None  # type: ignore[attr-defined]
    left = [ax for ax in grid.flat if ax.figure is not None]
    for row in grid:
        for ax in row[1:]:
            ax.set_ylabel(ax.get_ylabel() or row[0].get_ylabel())
    for column in grid.T:
        lowest = [ax.get_xlabel() for ax in column if ax.get_xlabel()][-1:]
        for ax in column:
            ax.set_xlabel(ax.get_xlabel() or "".join(lowest))
    if len(left) < grid.size:  # close the gaps of panels that were taken out
        fig.set_figheight(fig.get_figheight() * len(left) / grid.size)
        places = fig.add_gridspec(len(left), 1)
        for i, ax in enumerate(left):
            ax.set_subplotspec(places[i])
    for ax, below in pairwise(left):  # on one scale of x, the lowest panel names it for all
        if ax.get_shared_x_axes().joined(ax, below):
            below.set_xlabel(below.get_xlabel() or ax.get_xlabel())
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)


def title(text: str) -> str:
    """The gid of a line that an SVG is to name by this text where one points at it."""
    return TITLE + printable(text).replace(r"\$", "$")


def few_decades(axis: Any, decades: float = 1.0) -> None:
    """Plain numbers for a logarithmic axis of a decade or two: at 1, 2 and 5; at 1 and 3 if it has more than one decade."""
    digits = (1, 3) if decades > 1 else (1, 2, 5)
    axis.set_major_locator(LogLocator(subs=digits) if decades > LESS else MaxNLocator(2, steps=(1, 2, 5, 10)))
    axis.set_major_formatter(lambda value, _: show(float(value)))
    axis.set_minor_formatter(NullFormatter())
