"""The canvas of every figure: sizes, fonts, panels, ticks and plain text. The looks of methods are in `looks`.

Text in SVG files is text, so a reader can search and copy it. Without DejaVu Sans a browser takes Verdana, which has the same
widths. PDF and PNG files contain the font.
"""

import math
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

WIDTHS = {"column": 3.4, "page": 7.0}  # inches: one and two columns of a journal page
TALLEST = 9.2  # inches: the height of a journal page
PANEL = 2.3  # inches: the height of a panel of a figure that is taller than a page
INK, FAINT = "#222222", "#6b6b6b"
TITLE = "title: "  # begins the gid of a line; the rest is the name that an SVG shows where one points at the line

RC: Any = {
    "svg.hashsalt": "lagrange-bench",  # ids in an SVG depend on its content only: same rows, same bytes
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # TrueType, which journals ask for
    "font.family": "DejaVu Sans",  # comes with matplotlib, so every machine lays out the same figure
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # the usual place, but matplotlib need not search for it
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.prop_cycle": cycler(color=["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5A5A5A"]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "lines.solid_capstyle": "round",
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
}
TICKS = {"labelsize": 7, "color": FAINT, "labelcolor": INK}
TICKS |= {"major.width": 0.6, "minor.width": 0.4, "major.size": 3, "minor.size": 1.5}
RC |= {f"{axis}tick.{name}": value for axis in "xy" for name, value in TICKS.items()}


# of the figures drawn inside `apply`: "column" or "page"; None: each has its own
_WIDTH: ContextVar[str | None] = ContextVar("width of figures", default=None)


class Figure(matplotlib.figure.Figure):
    """A matplotlib figure with its caption. pyplot does not know it, so it goes when nobody uses it."""

    caption: str = ""
    headline: str = ""  # the finding, in a few words


@contextmanager
def apply(width: str | None = None) -> Iterator[None]:
    """Use this style inside the block, to draw and to save, whatever the user's matplotlibrc says.

    width : "column" or "page", for every figure drawn inside; None: each has its own. ValueError : another width.
    """
    if width is not None and width not in WIDTHS:
        raise ValueError(f"width must be one of {', '.join(WIDTHS)}, got {width!r}")
    before = _WIDTH.set(width)
    try:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(RC)
            yield
    finally:
        _WIDTH.reset(before)


def figure(
    width: str | float = "page",
    height: float = 2.4,
    nrows: int = 1,
    ncols: int = 1,
    squeeze: bool = True,
    **subplots: Any,
) -> tuple[Figure, Any]:
    """A figure and its axes, as `Figure.subplots` gives them.

    width : "column" (3.4 in), "page" (7 in) or inches. height : inches. Inside `apply("column")` the panels stand one below the
    other, and share their axes or not.
    """
    width = _WIDTH.get() or width
    rows, columns = nrows, ncols
    if width == "column" and ncols > 1:
        rows, columns = nrows * ncols, 1
        height = min(height * ncols, max(TALLEST, PANEL * rows))
        subplots |= {name: bool(subplots[name]) for name in ("sharex", "sharey") if name in subplots}
    inches = WIDTHS[width] if isinstance(width, str) else width
    fig = Figure(figsize=(inches, height), layout="constrained")
    grid = fig.subplots(rows, columns, squeeze=False, **subplots).reshape(nrows, ncols)
    if not squeeze:
        return fig, grid
    return fig, np.squeeze(grid) if grid.size > 1 else grid.item()


def panels(
    titles: Sequence[str], columns: int, heights: tuple[float, float], xlabel: str, ylabel: str, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each title, `columns` to a row. heights : inches, of the figure without rows, and of a row."""
    columns = 1 if _WIDTH.get() == "column" else min(columns, len(titles))
    rows = math.ceil(len(titles) / columns)
    fig, grid = figure("page", heights[0] + heights[1] * rows, rows, columns, squeeze=False, **shared)
    axes, spare = list(grid.flat[: len(titles)]), grid.flat[len(titles) :]
    for ax in spare:
        ax.remove()
    for ax, title in zip(axes, titles, strict=True):
        ax.set_title(title)
    for ax in axes[-columns:]:  # the lowest of each column
        ax.set_xlabel(xlabel)
        ax.tick_params(labelbottom=True)
    fig.supylabel(ylabel, fontsize=RC["axes.labelsize"])
    return fig, axes


def plain(name: str) -> str:
    """A name as text of a figure: dollars in it make no formula, and nothing is left that cannot be printed."""
    return printable(name).replace("$", r"\$")


def printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def label_decades(ax: Any) -> None:
    """Label a logarithmic x axis at whole decades, and at 3 if it shows fewer than two: more would cover each other."""
    if ax.get_xscale() != "log":
        return
    low, high = ax.get_xlim()
    if math.floor(math.log10(high)) > math.ceil(math.log10(low)):
        ax.xaxis.set_minor_formatter(NullFormatter())
    else:
        ax.xaxis.set_minor_locator(LogLocator(subs=(3.0,)))


def title(text: str) -> str:
    """The gid of a line: an SVG shows this text where one points at the line."""
    return TITLE + printable(text).replace(r"\$", "$")
