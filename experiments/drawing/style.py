"""One look for every figure: the canvas, then what methods look like, then marks and names in panels.

Text in SVG files is text: a reader can search and copy it. Where there is no DejaVu Sans, Verdana has the same widths; PDF and
PNG have the font in them.

Colours go by family. They are the hues of Okabe and Ito, safe for colour-blind readers, with yellow and orange darkened
so that text in them can be read. Shades, markers and dashes go by the place of a method within its family, so a figure
also reads in grey. A method nobody registered gets a grey of its own, always the same. One of a plug-in, or a
highlighted one, has black dashes, which no method of the bench has, and is named in every figure.

Forty lines in one panel are not readable. Either every family has a panel of its own (`by_family`), or all are thin
but the best of each (`looks`). Lines are named where they end (`label_ends`), not in a legend.
"""

import hashlib
import math
import textwrap
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from itertools import pairwise
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
import pandas as pd
from cycler import cycler
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter, NullLocator
from matplotlib.transforms import blended_transform_factory, offset_copy

from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.integrators.registry import BUILT_IN, METHODS, find_stored_method

WIDTHS = {"column": 3.4, "page": 7.0}  # inches: one and two columns of a journal page
TALLEST = 9.2  # inches: what a journal page holds
LONGEST = 44  # letters of a label in a column
_FORCED: ContextVar[str | None] = ContextVar("width of every figure", default=None)
_HIGHLIGHTED: ContextVar[tuple[str, ...]] = ContextVar("methods that stand out", default=())
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
def apply(width: str | None = None, highlight: Sequence[str] = ()) -> Iterator[None]:
    """The style, whatever the reader's own matplotlibrc says. Draw and save inside.

    width : "column" or "page", of every figure drawn inside; None leaves it to who draws. highlight : methods that stand
    out, as those of plug-ins do.
    """
    if width is not None and width not in WIDTHS:
        raise ValueError(f"width must be one of {', '.join(WIDTHS)}, got {width!r}")
    before, highlighted = _FORCED.set(width), _HIGHLIGHTED.set(tuple(highlight))
    try:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(RC)
            yield
    finally:
        _FORCED.reset(before)
        _HIGHLIGHTED.reset(highlighted)


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
        # a list of many rows gets narrower, but not shorter
        stacked = forced == "column" and columns > 1 and panels_high <= 1.6 * TALLEST
        inches, height = WIDTHS[forced], min(panels_high if stacked else height, TALLEST)
    fig = Figure(figsize=(inches, height), layout="constrained")
    if not stacked:
        return fig, fig.subplots(**subplots)
    fig.stacked = _stack(fig, **subplots)
    squeezed = fig.stacked if not subplots.get("squeeze", True) else np.squeeze(fig.stacked)
    return fig, squeezed if squeezed.ndim else squeezed.item()


def _stack(fig: Figure, nrows: int = 1, ncols: int = 1, subplot_kw: Any = None, **more: Any) -> Any:
    """Axes as `Figure.subplots` makes them, but all in one column; what they share they share."""
    grid = np.empty((nrows, ncols), dtype=object)
    for i in range(nrows):
        for j in range(ncols):
            firsts = {True: grid[0, 0], "all": grid[0, 0], "row": grid[i, 0], "col": grid[0, j]}
            shared = {name: firsts.get(more.get(name)) for name in ("sharex", "sharey")}
            grid[i, j] = fig.add_subplot(nrows * ncols, 1, i * ncols + j + 1, **shared, **(subplot_kw or {}))
    return grid


def panels(
    titles: Sequence[str], columns: int, heights: tuple[float, float], xlabel: str, ylabel: str, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A panel for each title, so many to a row; `heights` of the figure without them, and of a row, in inches."""
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
    if rows > 4 and columns == 1:  # panels too low for it
        fig.supylabel(ylabel, fontsize=RC["axes.labelsize"])
    else:
        for ax in grid[:, 0]:
            ax.set_ylabel(ylabel)
    return fig, list(grid.flat[: len(titles)])


def plain(name: str) -> str:
    """A name as text of a figure: no formula, whatever dollars are in it, and nothing that cannot be printed."""
    return printable(name).replace("$", r"\$")


def printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def finish(fig: matplotlib.figure.Figure) -> None:
    """Makes a figure ready to be saved; panels on top of each other get the labels they had from their neighbours."""
    for ax in fig.axes:
        ax.set(**_LIMITS.get())
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
            if ax in left and not ax.get_ylabel():
                ax.set_ylabel(row[0].get_ylabel())
    for column in grid.T:
        named = [ax for ax in column if ax in left and ax.get_xlabel()]
        for ax in column:
            if ax in left and named and not ax.get_xlabel():
                ax.set_xlabel(named[-1].get_xlabel())
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
    axis.set_major_locator(LogLocator(subs=digits) if decades > LESS else MaxNLocator(4, steps=(1, 2, 5, 10)))
    axis.set_major_formatter(lambda value, _: show(float(value)))
    axis.set_minor_formatter(NullFormatter())


# ---------------------------------------------------------------- looks of methods

CONTRAST = 4.5  # of coloured text on white, as WCAG asks for

# family → (colours, markers), used in registry order within the family
FAMILIES: dict[str, tuple[Sequence[str], str]] = {
    "backlund": (("#0072B2", "#3F93CF", "#003B5C", "#7D9BD1", "#0B4F9E"), "osDh^"),
    "closed-form": (("#1A1A1A", "#6E6E6E", "#454545"), "osD"),
    "taylor": (("#009E73", "#00503A", "#45B894", "#2E7D5B", "#4FA98A"), "^v<>os"),
    "runge-kutta": (("#D55E00", "#8A3A00", "#E8742E", "#B04C00", "#5C2700"), "XPp8osD"),
    "splitting": (("#C78900", "#7A5400", "#DB9400", "#4D3500", "#A8770F"), ">osD^v<"),
    "integrable": (("#1E95CC", "#0F5C80", "#3AA0DA"), "posD"),
    "implicit": (("#C0649A", "#7B2E5E", "#D07AAE", "#A0437C", "#54183E"), "dosH^v"),
    "lie-group": (("#8C8000", "#544D00", "#A39700"), "hosD"),
    "whole-body": (("#8A5A44", "#5C3A2B", "#B07A60", "#3E2519", "#A0664B"), "vosD^"),
}
TITLES = {
    "backlund": "Bäcklund maps",
    "closed-form": "closed form",
    "taylor": "Taylor series",
    "runge-kutta": "explicit Runge–Kutta",
    "splitting": "splitting",
    "integrable": "integrable discretisations",
    "implicit": "implicit, multistep",
    "lie-group": "Lie group",
    "whole-body": "multibody dynamics",
}
OTHERS = "others"  # methods no longer registered, and families of plug-ins
STRANGERS = (("#5A5A5A", "#8F8F8F", "#333333", "#B0B0B0"), "+x12")
OWN = "#000000"  # of what stands out, with these markers and dashes
OWN_MARKERS = "*PXd"
OWN_DASHES: tuple[Any, ...] = ((0, (3, 1)), (0, (6, 1, 1, 1)), (0, (1, 0.8)), (0, (9, 2)))
FEW = 8  # methods: all of so many can be named
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))


def of(method: str) -> dict[str, Any]:
    """label, color, marker, linestyle of a method: keywords for `Axes.plot`, which would read a label as a formula."""
    look = _look(method)
    return {**look, "label": plain(look["label"])}


def _look(method: str) -> dict[str, Any]:
    look = _known(METHODS.changes)[1].get(method) or _stranger(method)
    mine = _standing_out()
    if method not in mine and ":" not in method:
        return look
    with suppress(Exception):  # one that cannot be loaded here keeps the name that it has in the rows
        look = {**look, "label": find_stored_method(method).label}
    place = mine.index(method) if method in mine else _digest(method)
    marker, dashes = OWN_MARKERS[place % len(OWN_MARKERS)], OWN_DASHES[place % len(OWN_DASHES)]
    return {"label": look["label"], "color": OWN, "marker": marker, "linestyle": dashes, "linewidth": 1.8}


def _standing_out() -> list[str]:
    """The methods with the reserved look: those of plug-ins, and the highlighted ones."""
    return list(dict.fromkeys((*(name for name in METHODS if name not in BUILT_IN), *_HIGHLIGHTED.get())))


def label(method: str) -> str:
    """What a table or a sentence calls a method. In a figure: `plain(label(method))`, or the label of `of`."""
    return printable(_look(method)["label"])


def ordered(methods: Iterable[str]) -> list[str]:
    """Distinct names in legend order: the registry's, then the unknown ones by name."""
    known = list(_known(METHODS.changes)[1])
    return sorted(set(methods), key=lambda name: (known.index(name) if name in known else len(known), name))


def family(method: str) -> str:
    """The family a method is drawn with: its own if that has colours here, else OTHERS."""
    return _known(METHODS.changes)[0].get(method, OTHERS)


def looks(methods: Iterable[str], named: Collection[str]) -> dict[str, dict[str, Any]]:
    """The look of each method where some are named and bold, in legend order; what stands out, and FEW, are all named."""
    names = ordered(methods)
    if len(names) <= FEW:
        alone = Counter(family(name) for name in names)
        return {name: _prominent(name, alone) for name in names}
    mine, alone = _standing_out(), Counter(family(name) for name in names if name in named)
    return {
        name: of(name) if name in mine else thin(name) if name not in named else _prominent(name, alone)
        for name in names
    }


def _prominent(method: str, alone: Counter[str]) -> dict[str, Any]:
    """The bold line of its family; with its own shade, marker and dashes where others of its family stand out, too."""
    return bold(method) if alone[family(method)] == 1 else {**of(method), "linewidth": 1.6}


def naming(methods: Collection[str], chosen: str) -> str:
    """What a caption says of the lines of `looks`; chosen : which are named, if not all."""
    if len(set(methods)) <= FEW:
        return "Every method is named"
    return f"Thin: the other methods, each in the colour of its family; {chosen}"


def thin(method: str) -> dict[str, Any]:
    """A method in the background: the colour of its family, its name only where one points at it."""
    look = {"color": of(method)["color"], "linewidth": 0.55, "alpha": 0.5}
    return {**look, "label": "_thin", "gid": title(label(method))}


def bold(method: str) -> dict[str, Any]:
    """The best of a family: what `label_ends` names."""
    look, colours = of(method), FAMILIES.get(family(method), ((),))[0]
    if method in _standing_out():
        return look
    main = colours[0] if colours else look["color"]
    return {**look, "color": main, "linestyle": "-", "linewidth": 1.9, "marker": "none"}


@lru_cache(maxsize=1)
def _known(changes: int) -> tuple[dict[str, str], dict[str, dict[str, Any]]]:
    """Family and style of each registered method, as the registry is after so many changes.

    A method that cannot be loaded here may still have rows: it is drawn as a stranger.
    """
    families: dict[str, str] = {}
    styles: dict[str, dict[str, Any]] = {}
    places: Counter[str] = Counter()
    for name, method, _ in METHODS.each():
        styles[name] = _stranger(name)
        if method and method.family in FAMILIES:
            families[name] = method.family
            styles[name] = _style(method.label, *FAMILIES[method.family], places[method.family])
            places[method.family] += 1
        elif method:
            styles[name]["label"] = method.label
    return families, styles


def _stranger(name: str) -> dict[str, Any]:
    return _style(name, *STRANGERS, _digest(name))


def _digest(name: str) -> int:
    return hashlib.sha256(name.encode(errors="surrogatepass")).digest()[0]


def _style(text: str, colours: Sequence[str], markers: str, place: int) -> dict[str, Any]:
    def pick(options: Sequence[Any]) -> Any:
        return options[place % len(options)]

    return {"label": text, "color": pick(colours), "marker": pick(markers), "linestyle": pick(DASHES)}


def readable(colour: Any) -> tuple[float, float, float]:
    """The colour, darkened as far as text in it needs on white."""
    rgb = np.array(to_rgb(colour))
    while 1.05 / (_luminance(rgb) + 0.05) < CONTRAST:
        rgb *= 0.97
    r, g, b = rgb.tolist()
    return r, g, b


def _luminance(rgb: Any) -> float:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


# ---------------------------------------------------------------- marks and names

TIME, STEP = "time · (|J| + √(|α||x|))", "step h · (|J| + √(|α||x|))"  # axes in the units of the top
REFERENCE = "backlund"  # in grey in every panel of small multiples
LEAST = 1e-17  # where an error of 0 is drawn
WORDS = {"span_scaled": "t", "span": "t", "h_scaled": "h"}  # what names of lines call columns


def draw_method(
    ax: Axes, rows: pd.DataFrame, method: str, x: str, y: str, look: dict[str, Any], log: Sequence[bool] = (True, True)
) -> None:
    """y against x of what one method has in `rows`, on logarithmic axes its absolute value.

    Crosses where it failed; or, of one that only failed at no x, before its name. Not of a line without a name.
    """
    mine = rows[rows.method == method]
    good = mine[(mine.status == "done") & mine[x].notna() & mine[y].notna()]
    if not good.empty:
        ax.plot(good[x], good[y].abs().clip(lower=LEAST) if log[1] else good[y], **look)
        ax.set(**{f"{axis}scale": "log" for axis, is_log in zip("xy", log, strict=True) if is_log})
    if not str(look["label"]).startswith("_"):
        failed = mine[mine.status == "failed"][x].dropna()
        failure_marks(ax, failed, method)
        if good.empty and failed.empty:
            failed_label(ax, method)


def draw_lines(
    ax: Axes,
    rows: pd.DataFrame,
    x: str,
    y: str,
    apart: Sequence[str],
    looks: Mapping[str, dict[str, Any]],
    log: Sequence[bool] = (True, True),
) -> None:
    """`draw_method` of each method in `looks`; a line for each set of values of the columns `apart`.

    The lines of one method differ by their dashes, and their names say the values. Rows are joined in their order.
    """
    for method, look in looks.items():
        for i, (words, line) in enumerate(lines(rows[rows.method == method], apart)):
            named = {**look, "label": ", ".join([look["label"], *map(plain, words)])}
            if i and "linestyle" in look:
                dashes = DASHES if look["linestyle"] in DASHES else OWN_DASHES
                named["linestyle"] = dashes[(dashes.index(look["linestyle"]) + i) % len(dashes)]
            draw_method(ax, line, method, x, y, named, log)


def lines(rows: pd.DataFrame, apart: Sequence[str]) -> list[tuple[list[str], pd.DataFrame]]:
    """The rows of each line of one method, and what its name says of the columns that differ."""
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
    """Small multiples of `draw_method`: a panel for each family, two to a row, the reference grey in each, lines named.

    marker : "none" for lines without any.
    """

    def line(ax: Axes, method: str, look: dict[str, Any]) -> None:
        draw_method(ax, rows, method, x, y, look | ({"marker": marker} if marker else {}))

    rows = rows.sort_values(x, kind="stable")
    fig, axes = multiples(rows.method, line, xlabel, ylabel, ylim)
    label_ends(axes)
    return fig, axes


def multiples(
    methods: Iterable[str], line: Callable[..., None], xlabel: str, ylabel: str, ylim: tuple[float, float]
) -> tuple[Figure, list[Axes]]:
    """The panels of `by_family`, with lines of another kind: line(ax, method, look) draws one."""
    names = ordered(methods)
    groups = [group for group in (*FAMILIES, OTHERS) if any(family(name) == group for name in names)]
    narrow = width() == "column"
    columns = 1 if narrow else min(len(groups), 2)
    small = {"markersize": 2.2 if narrow else 3.0, "markeredgewidth": 0.4}
    titles = [TITLES.get(group, group) for group in groups]
    fig, axes = panels(titles, columns, (0.45, 1.75), xlabel, ylabel, sharex=True, sharey=True)
    for ax, group in zip(axes, groups, strict=True):
        if group != family(REFERENCE) and REFERENCE in names:
            grey = {"color": "#a5a5a5", "linewidth": 2.2, "marker": "o", "label": "_reference", "zorder": 1}
            line(ax, REFERENCE, {**grey, **small})
        for name in names:
            if family(name) == group:
                line(ax, name, {**of(name), **small})
        ax.set_ylim(ylim)
    low, high = (math.ceil(math.log10(limit)) for limit in ylim)
    powers = [10.0**k for k in range(low, high + 1) if k % (5 if narrow else 3) == 0]
    axes[0].yaxis.set_major_locator(FixedLocator(powers))
    return fig, axes


def label_ends(panels: Iterable[Axes], fontsize: Any = 6.5) -> None:
    """Write each labelled line's name where it leaves its panel, pushed apart so that none overlap. Call it last."""
    for ax in panels:
        _Ends(ax, fontsize)


class _Ends(Artist):
    """The names at the ends of the lines of a panel, those without a line (`failed_label`) on top.

    They are placed each time the panel is drawn, for limits and sizes may have changed: right of the panel, or, where the
    figure has no room there, inside it. Names of lines that are not in sight are not shown.
    """

    zorder = -1.0  # drawn before what it moves

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
        """Puts the names where they belong, now that the panel has its size."""
        names = [*self.texts, *self.failed]
        if not names:
            return
        ends = [_last_point(self.panel, line) for line in self.lines]
        upwards = sorted((end[1], i) for i, end in enumerate(ends) if end)
        width, height = self.panel.bbox.size
        gap = 1.25 * float(names[0].get_fontsize()) * renderer.points_to_pixels(1.0) / height
        places = _spread([*(y for y, _ in upwards), *(1.0 for _ in self.failed)], gap)
        outside = _room(self.panel) >= 1.05 * width + max(text.get_window_extent(renderer).width for text in names)
        for text, end in zip(self.texts, ends, strict=True):
            text.set_visible(end is not None)
        for text, place in zip([*(self.texts[i] for _, i in upwards), *self.failed], places, strict=True):
            text.set(x=1.05 if outside else 0.99, y=place, ha="left" if outside else "right")
            text.set_path_effects([] if outside else [withStroke(linewidth=2, foreground="white")])
        joined = zip(ends, self.texts, strict=True)
        drawn = [(end, (1.04, text.get_position()[1])) if end and outside else np.empty((0, 2)) for end, text in joined]
        self.leaders.set_segments(drawn)


def _room(ax: Axes) -> float:
    """Pixels from the left end of a panel to the next one on its right, or the end of the figure."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    others = [other.bbox for other in figure.axes if other is not ax and other.bbox.x0 >= ax.bbox.x1]
    beside = [box.x0 for box in others if box.y0 < ax.bbox.y1 and ax.bbox.y0 < box.y1]
    return float(min([figure.bbox.x1, *beside]) - ax.bbox.x0)


def _last_point(ax: Axes, line: Any) -> tuple[float, float] | None:
    """Where a line is last seen, in fractions of the axes; if it is only above or below, at that edge; else None."""
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


def _spread(places: Sequence[float], gap: float) -> list[float]:
    """Ascending places in [0, 1] moved as little as needed to lie `gap` apart: runs that overlap share their mean."""
    runs: list[list[float]] = []
    for place in places:
        runs.append([place])
        while len(runs) > 1 and _centre(runs[-1], gap) - _centre(runs[-2], gap) < gap * len(runs[-2] + runs[-1]) / 2:
            last = runs.pop()
            runs[-1] += last
    return [_centre(run, gap) + gap * (i - (len(run) - 1) / 2) for run in runs for i in range(len(run))]


def _centre(run: Sequence[float], gap: float) -> float:
    half = min(gap * len(run) / 2, 0.5)  # a run stays inside the axes if it can
    return float(np.clip(sum(run) / len(run), half, 1 - half))


def legend_below(fig: matplotlib.figure.Figure) -> None:
    """One legend for all axes, each name once, below them, in as many columns as fit. The figure grows by it if it can."""
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
    """The name of a method that has nothing to show in a panel, crossed: in its corner, or where `label_ends` puts it."""
    above = sum(text.get_gid() == "failed" for text in ax.texts)
    text = f"× {plain(label(method))}"
    ax.text(
        0.02, 0.97 - 0.09 * above, text, color=readable(of(method)["color"]), fontsize=6.5, va="top",
        transform=ax.transAxes, gid="failed",
    )  # fmt: skip


def ulp_line(ax: Axes) -> None:
    """A thin line where an error is one ulp."""
    ax.axhline(2.0**-52, color=FAINT, linewidth=0.6)


def slope_guide(ax: Axes, exponent: float, anchor: tuple[float, float], span: float, text: str) -> None:
    """A thin line y ∝ x^exponent on log-log axes from `anchor` over a factor `span` in x, with its name."""
    x0, y0 = anchor
    x1, y1 = x0 * span, y0 * span**exponent
    ax.plot([x0, x1], [y0, y1], color=FAINT, linewidth=0.7, linestyle=(0, (1, 1)), marker="none", label="_guide")
    name = ax.annotate(text, (x1, y1), (2, 0), textcoords="offset points", fontsize=6.5, color=FAINT, va="center")
    name.set_in_layout(False)
