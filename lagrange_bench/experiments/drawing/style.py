"""One look for every figure: the canvas, the looks of methods, and lines and marks in panels.

Text in SVG files is text, so a reader can search and copy it. Without DejaVu Sans a browser takes Verdana, which has the same
widths. PDF and PNG files contain the font.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
import pandas as pd
from cycler import cycler
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import LogLocator, NullFormatter

from lagrange_bench.experiments.drawing.tables import label, printable, record_of, show
from lagrange_bench.integrators.registry import BUILT_IN, MANY, METHODS, without_archive

# ---------------------------------------------------------------- the canvas

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

    width : "column" or "page", for every figure drawn inside; None: each has its own.
    """
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
    return fig, np.squeeze(grid)[()] if squeeze else grid


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


def label_decades(ax: Any) -> None:
    """Label a logarithmic x axis at whole decades, and at 3 if it shows fewer than two: more would cover each other."""
    if ax.get_xscale() != "log":
        return
    low, high = ax.get_xlim()
    if math.floor(math.log10(high)) > math.ceil(math.log10(low)):
        ax.xaxis.set_minor_formatter(NullFormatter())
    else:
        ax.xaxis.set_minor_locator(LogLocator(subs=(3.0,)))


# ---------------------------------------------------------------- the looks of methods

# Each family has a colour. The colours are the hues of Okabe and Ito, safe for colour-blind readers. The place of a method in its
# family gives shade, marker and dashes, so a figure also reads in grey. No crosses: they show where a method failed.
FAMILIES: dict[str, tuple[tuple[str, ...], str]] = {
    "backlund": (("#0072B2", "#3F93CF", "#003B5C", "#7D9BD1", "#0B4F9E"), "osDh^"),
    "closed-form": (("#1A1A1A", "#6E6E6E", "#454545"), "osD"),
    "taylor": (("#009E73", "#00503A", "#45B894", "#2E7D5B", "#4FA98A"), "^v<>os"),
    "runge-kutta": (("#D55E00", "#8A3A00", "#E8742E", "#B04C00", "#5C2700"), "<Pp8osD"),
    "splitting": (("#C78900", "#7A5400", "#DB9400", "#4D3500", "#A8770F"), ">osD^v<"),
    "integrable": (("#7A5BB8", "#4B3585", "#9A82CC"), "posD"),  # blue is the exact step, in all figures
    "implicit": (("#C0649A", "#7B2E5E", "#D07AAE", "#A0437C", "#54183E"), "dosH^v"),
    "lie-group": (("#8C8000", "#544D00", "#A39700"), "hosD"),
    "whole-body": (("#8A5A44", "#5C3A2B", "#B07A60", "#3E2519", "#A0664B"), "vosD^"),
}
OTHERS = "others"  # the family of methods no longer registered, and of families of plug-ins
# methods of plug-ins are black, with dashes that no method of the bench has, and named in every figure
OWN = "#000000"
OWN_MARKERS = "*Phd"
OWN_DASHES: tuple[Any, ...] = ((0, (3, 1)), (0, (6, 1, 1, 1)), (0, (1, 0.8)), (0, (9, 2)))
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))
STRANGER = {"color": "#5A5A5A", "marker": "+", "linestyle": "-"}
EXACT_STEPS = ("backlund", "backlund_splitting")
MOST_NAMED = 8
GREY = "#c2c2c2"
FEW = MANY  # up to so many methods are all named


def of(method: str) -> dict[str, Any]:
    """label, color, marker and linestyle of a method: keywords for `Axes.plot`, with a label that makes no formula."""
    look: dict[str, Any] = {"label": plain(label(method))}
    plug_ins = _plug_ins()
    if method in plug_ins or ":" in method:
        place = plug_ins.index(method) if method in plug_ins else 0
        return look | _style((OWN,), OWN_MARKERS, OWN_DASHES, place) | {"linewidth": 1.8}
    if method not in BUILT_IN:
        return look | STRANGER
    siblings = [name for name in BUILT_IN if family(name) == family(method)]
    return look | _style(*FAMILIES[family(method)], DASHES, siblings.index(method))


def _style(colours: Sequence[str], markers: str, dashes: Sequence[Any], place: int) -> dict[str, Any]:
    options = {"color": colours, "marker": markers, "linestyle": dashes}
    return {name: those[place % len(those)] for name, those in options.items()}


def _plug_ins() -> list[str]:
    return [name for name in METHODS if name not in BUILT_IN]


def family(method: str) -> str:
    """The family that a method is drawn with: its own if it has colours here, otherwise OTHERS."""
    record = record_of(method)
    return record.family if record and record.family in FAMILIES else OTHERS


def ordered(methods: Iterable[str]) -> list[str]:
    """Distinct names in legend order: registered methods in the registry's order, then the others by name."""
    known = list(METHODS)
    return sorted(set(methods), key=lambda name: (known.index(name) if name in known else len(known), name))


def shown(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows that figures show: of many methods the archive is left out, except methods that stand out."""
    if "method" not in rows:
        return rows
    names = [*without_archive(rows.method.dropna()), *_plug_ins()]
    return rows[rows.method.isna() | rows.method.isin(names)]


def looks(methods: Iterable[str], named: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The look of each method, in legend order. Up to FEW methods are all bold and named. Methods that stand out are named, too.

    named : which of more methods are bold, the most important first: the exact steps and these, MOST_NAMED in all.
    """
    names = ordered(methods)
    first = [name for name in dict.fromkeys((*EXACT_STEPS, *named)) if name in names]
    chosen = names if len(names) <= FEW else first[:MOST_NAMED]
    mine = _plug_ins()
    return {name: of(name) if name in mine else bold(name) if name in chosen else thin(name) for name in names}


def naming(methods: Collection[str], chosen: str) -> str:
    """What a caption says of the lines of `looks`. chosen : the words for the named ones, if not all are named."""
    if len(set(methods)) <= FEW:
        return "Every method that is drawn is named"
    return f"Grey: the other methods; {chosen}"


def thin(method: str) -> dict[str, Any]:
    """A method in the background: grey, with its name only where one points at it."""
    return {"color": GREY, "linewidth": 0.6, "label": "_thin", "gid": title(label(method)), "zorder": 1.5}


def bold(method: str) -> dict[str, Any]:
    """A method that a legend names: in its own colour and dashes, the exact step the widest."""
    width, order = (2.4, 6) if method in EXACT_STEPS else (1.6, 3)
    return {**of(method), "linewidth": width, "zorder": order, "marker": "none"}


def plain(name: str) -> str:
    """A name as text of a figure: dollars in it make no formula, and nothing is left that cannot be printed."""
    return printable(name).replace("$", r"\$")


def title(text: str) -> str:
    """The gid of a line: an SVG shows this text where one points at the line."""
    return TITLE + printable(text).replace(r"\$", "$")


# ---------------------------------------------------------------- lines and marks in panels

# Forty lines in one panel are not readable. So of more than FEW methods all lines are thin and grey except a few, such as the
# best of each family. A legend below the panels names the others.
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
    """A line for every method in one panel: up to FEW in their colours, of more all but the `named` thin and grey."""
    draw_lines(ax, rows.sort_values(x, kind="stable"), x, y, (), looks(rows.method, named))


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
