"""The canvas of every figure: sizes, fonts, panels, ticks and plain text. The looks of methods are in `looks`.

Text in SVG files is text, so a reader can search and copy it. Without DejaVu Sans a browser takes Verdana, which has the same
widths. PDF and PNG files contain the font.
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
from matplotlib.ticker import LogLocator, NullFormatter

WIDTHS = {"column": 3.4, "page": 7.0}  # inches: one and two columns of a journal page
TALLEST = 9.2  # inches: the height of a journal page
LONGEST = 44  # letters in a line of a label in a column
_FORCED: ContextVar[str | None] = ContextVar("width of every figure", default=None)
HIGHLIGHTED: ContextVar[tuple[str, ...]] = ContextVar("methods that stand out", default=())
ARCHIVED: ContextVar[bool] = ContextVar("methods of the archive are drawn, too", default=False)
_LIMITS: ContextVar[dict[str, tuple[float, float]]] = ContextVar("limits of every panel", default={})  # noqa: B039
INK, FAINT = "#222222", "#6b6b6b"
TITLE = "title: "  # begins the gid of a line; the rest is the name that an SVG shows where one points at the line

RC: Any = {
    "svg.hashsalt": "lagrange-bench",  # ids in an SVG depend on its content only: same rows, same bytes
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # TrueType, which journals ask for
    "savefig.dpi": 200,  # of pixels inside an SVG
    "font.family": "DejaVu Sans",  # comes with matplotlib, so every machine lays out the same figure
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5,
    "axes.titley": 1.0,  # the usual place, but matplotlib need not search for it
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
    """A matplotlib figure with its caption. pyplot does not know it, so it goes when nobody uses it."""

    caption: str = ""
    headline: str = ""  # the finding, in a few words
    stacked: Any = None  # of panels on top of each other, the grid that they have side by side

    def savefig(self, *args: Any, **settings: Any) -> None:
        """Save in this style, whatever the user's matplotlibrc says."""
        with apply():
            super().savefig(*args, **settings)


@contextmanager
def apply(width: str | None = None, highlight: Sequence[str] = (), archive: bool = False) -> Iterator[None]:
    """Use this style inside the block, to draw and to save, whatever the user's matplotlibrc says.

    width : "column" or "page", for every figure drawn inside; None: each has its own. highlight : methods that stand out, as
    methods of plug-ins do. archive : whether figures of many methods show the archive, too. ValueError : another width.
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
    """Give every panel of the figures that are printed inside the block these limits: xlim, ylim, as of `set_xlim`."""
    before = _LIMITS.set({name: pair for name, pair in ends.items() if pair is not None})
    try:
        yield
    finally:
        _LIMITS.reset(before)


def width() -> str:
    """The width of a figure meant for a page: "page", or "column" inside `apply("column")`."""
    return _FORCED.get() or "page"


def figure(width: str | float = "page", height: float | None = None, **subplots: Any) -> tuple[Figure, Any]:
    """A figure and its axes, as `Figure.subplots(**subplots)` gives them.

    width : "column" (3.4 in), "page" (7 in) or inches. height : inches; by default in proportion to the width of a panel.
    Inside `apply("column")`, a figure meant for a page has its panels one below the other.
    """
    inches = WIDTHS[width] if isinstance(width, str) else width
    rows, columns = subplots.get("nrows", 1), subplots.get("ncols", 1)
    if height is None:
        height = 0.4 + rows * min(0.68 * inches / columns, 3.2)
    forced, stacked, panels_high = _FORCED.get(), False, height * columns
    if forced is not None and WIDTHS[forced] != inches:
        # a list of many rows gets narrower, but not shorter; a reader scrolls more panels than a page holds
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
    """Axes as `Figure.subplots` makes them and with the same shared axes, but all in one column."""
    grid = np.empty((nrows, ncols), dtype=object)
    for i, j in np.ndindex(nrows, ncols):
        firsts = {True: grid[0, 0], "all": grid[0, 0], "row": grid[i, 0], "col": grid[0, j]}
        shared = {name: firsts.get(more.get(name)) for name in ("sharex", "sharey")}
        grid[i, j] = fig.add_subplot(nrows * ncols, 1, i * ncols + j + 1, **shared, **(subplot_kw or {}))
    return grid


def panels(
    titles: Sequence[str], columns: int, heights: tuple[float, float], xlabel: str, ylabel: str, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each title, `columns` to a row. heights : inches, of the figure without rows, and of a row."""
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
    """A name as text of a figure: dollars in it make no formula, and nothing is left that cannot be printed."""
    return printable(name).replace("$", r"\$")


def printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def set_limits(ax: Any, limits: Mapping[str, tuple[float | None, float | None]]) -> None:
    """Set xlim and ylim. ValueError: limits of a logarithmic axis are not positive; matplotlib would ignore them."""
    for name, ends in limits.items():
        if getattr(ax, f"get_{name[0]}scale")() == "log" and any(end is not None and end <= 0 for end in ends):
            given = ", ".join("None" if end is None else f"{end:g}" for end in ends)
            raise ValueError(f"{name}: the axis is logarithmic, so limits must be positive; got {given}")
        ax.set(**{name: ends})


def label_decades(ax: Any) -> None:
    """Label a logarithmic x axis at whole decades, and at 3 if it shows fewer than two: more would cover each other."""
    if ax.get_xscale() != "log":
        return
    low, high = ax.get_xlim()
    if math.floor(math.log10(high)) > math.ceil(math.log10(low)):
        ax.xaxis.set_minor_formatter(NullFormatter())
    else:
        ax.xaxis.set_minor_locator(LogLocator(subs=(3.0,)))


def finish(fig: matplotlib.figure.Figure) -> None:
    """Make a figure ready to be saved. Panels on top of each other get the labels that they shared side by side."""
    for ax in fig.axes:
        set_limits(ax, _LIMITS.get())
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
    if len(left) < grid.size:  # close the gaps of removed panels
        fig.set_figheight(fig.get_figheight() * len(left) / grid.size)
        places = fig.add_gridspec(len(left), 1)
        for i, ax in enumerate(left):
            ax.set_subplotspec(places[i])
    for ax, below in pairwise(left):  # the lowest panel names a shared x
        if ax.get_shared_x_axes().joined(ax, below):
            below.set_xlabel(below.get_xlabel() or ax.get_xlabel())
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)


def title(text: str) -> str:
    """The gid of a line: an SVG shows this text where one points at the line."""
    return TITLE + printable(text).replace(r"\$", "$")
