"""One look for every figure: sizes, fonts, and method name → label, colour, marker, line style.

Colours go by family. They are the hues of Okabe and Ito, safe for colour-blind readers, with yellow and orange darkened
so that text in them can be read. Shades, markers and dashes go by the place of a method within its family, so a figure
also reads in grey. A method nobody registered gets a grey of its own, always the same. One of a plug-in, or a
highlighted one, has black dashes, which no method of the bench has, and is named in every figure.

Forty lines in one panel are not readable. Either every family has a panel of its own (`by_family`), or all are thin
but the best of each (`looks`); lines are named where they end (`label_ends`), not in a legend.

Text in SVG files is text: a reader can search and copy it. Where there is no DejaVu Sans, Verdana has the same widths; PDF and
PNG have the font in them.
"""

from __future__ import annotations

import hashlib
import math
import textwrap
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from itertools import pairwise
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from cycler import cycler
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter, NullLocator
from matplotlib.transforms import blended_transform_factory, offset_copy

from integrators.registry import BUILT_IN, METHODS

WIDTHS = {"column": 3.4, "page": 7.0}  # inches: one and two columns of a journal page
TALLEST = 9.2  # inches: what a journal page holds
LONGEST = 44  # letters of a label in a column
_FORCED: ContextVar[str | None] = ContextVar("width of every figure", default=None)
_HIGHLIGHTED: ContextVar[tuple[str, ...]] = ContextVar("methods that stand out", default=())
DECADES = 4  # an axis of more has no ticks between the powers of ten
LESS = 0.6  # decades: an axis of less has no room for numbers at 1, 2 and 5
CONTRAST = 4.5  # of coloured text on white, as WCAG asks for
INK, FAINT = "#222222", "#6b6b6b"

# family → (colours, markers), used in registry order within the family
FAMILIES: dict[str, tuple[Sequence[str], Sequence[str]]] = {
    "backlund": (("#0072B2", "#3F93CF", "#003B5C", "#7D9BD1", "#0B4F9E"), ("o", "s", "D", "h", "^")),
    "closed-form": (("#1A1A1A", "#6E6E6E", "#454545"), ("o", "s", "D")),
    "taylor": (("#009E73", "#00503A", "#45B894", "#2E7D5B", "#4FA98A"), ("^", "v", "<", ">", "o", "s")),
    "runge-kutta": (("#D55E00", "#8A3A00", "#E8742E", "#B04C00", "#5C2700"), ("X", "P", "p", "8", "o", "s", "D")),
    "splitting": (("#C78900", "#7A5400", "#DB9400", "#4D3500", "#A8770F"), (">", "o", "s", "D", "^", "v", "<")),
    "integrable": (("#1E95CC", "#0F5C80", "#3AA0DA"), ("p", "o", "s", "D")),
    "implicit": (("#C0649A", "#7B2E5E", "#D07AAE", "#A0437C", "#54183E"), ("d", "o", "s", "H", "^", "v")),
    "lie-group": (("#8C8000", "#544D00", "#A39700"), ("h", "o", "s", "D")),
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
}
TITLE = "title: "  # before the name of a line, as its gid: what an SVG shows of a line pointed at
OTHERS = "others"  # methods no longer registered, and families of plug-ins
REFERENCE = "backlund"  # in grey in every panel of small multiples
STRANGERS = (("#5A5A5A", "#8F8F8F", "#333333", "#B0B0B0"), ("+", "x", "1", "2"))
OWN = "#000000"  # of what stands out, with these markers and dashes
OWN_MARKERS = ("*", "P", "X", "d")
OWN_DASHES: tuple[Any, ...] = ((0, (3, 1)), (0, (6, 1, 1, 1)), (0, (1, 0.8)), (0, (9, 2)))
FEW = 8  # methods: all of so many can be named
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))

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
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.prop_cycle": cycler(color=["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5A5A5A"]),
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
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


class Figure(matplotlib.figure.Figure):
    """A matplotlib figure with the sentence that goes below it. Belongs to no pyplot, so nothing leaks."""

    caption: str = ""
    stacked: Any = None  # the panels as they would be side by side, where they are on top of each other
    ends: tuple[_Ends, ...] = ()  # names at the ends of lines: how high they go is known only after the layout

    def savefig(self, *args: Any, **settings: Any) -> None:
        """In this style, whatever the reader's own matplotlibrc says."""
        with apply():
            super().savefig(*args, **settings)

    def draw(self, renderer: Any) -> None:
        for ax in self.axes:
            _choose_ticks(ax)
        engine = self.get_layout_engine()
        if engine is None:
            super().draw(renderer)
            return
        engine.execute(self)
        for end in self.ends:
            end.spread()
        self.set_layout_engine("none")  # or it would be laid out twice
        super().draw(renderer)
        self.set_layout_engine(engine)


def _choose_ticks(ax: Axes) -> None:
    """On logarithmic axes: none between the powers of ten of many decades; labels of x that do not touch on few."""
    for axis, scale, limits in (
        (ax.xaxis, ax.get_xscale(), ax.get_xlim()),
        (ax.yaxis, ax.get_yscale(), ax.get_ylim()),
    ):
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
    forced = _FORCED.get()
    if forced is None or WIDTHS[forced] == inches:
        fig = Figure(figsize=(inches, height), layout="constrained")
        return fig, fig.subplots(**subplots)
    panels, each = rows * columns, height / rows
    if forced == "page":
        fig = Figure(figsize=(WIDTHS[forced], min(height, TALLEST)), layout="constrained")
        return fig, fig.subplots(**subplots)
    if columns == 1 or each * panels > 1.6 * TALLEST:  # a list of many rows: narrower, but not shorter
        fig = Figure(figsize=(WIDTHS[forced], min(height, TALLEST)), layout="constrained")
        return fig, fig.subplots(**subplots)
    fig = Figure(figsize=(WIDTHS[forced], min(each * panels, TALLEST)), layout="constrained")
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


def plain(name: str) -> str:
    """A name as text of a figure: no formula, whatever dollars are in it, and nothing that cannot be printed."""
    return _printable(name).replace("$", r"\$")


def _printable(text: str) -> str:
    return "".join(c for c in text if c == "\n" or not unicodedata.category(c).startswith("C"))


def _keep_to_the_letter(artist: Artist) -> None:
    """What looks like a formula and is none, as words of somebody's rows may, is drawn as it stands."""
    for text in artist.findobj(Text):
        text.set_text(_printable(text.get_text()))
        if "$" in text.get_text() and not _formula(text.get_text()):
            text.set_parse_math(False)


def _formula(text: str) -> bool:
    """Whether matplotlib can read the formulas in a text."""
    try:
        MathTextParser("path").parse(text)
    except ValueError:
        return False
    return True


def finish(fig: matplotlib.figure.Figure) -> None:
    """Makes a figure ready to be saved; panels on top of each other get the labels they had from their neighbours."""
    for ax in fig.axes:
        _choose_ticks(ax)  # or thousands of them are made, to be looked at and thrown away
    _keep_to_the_letter(fig)
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


# ---------------------------------------------------------------- methods


def of(method: str) -> dict[str, Any]:
    """label, color, marker, linestyle of a method: keywords for `Axes.plot`, which would read a label as a formula."""
    look = _look(method)
    return {**look, "label": plain(look["label"])}


def _look(method: str) -> dict[str, Any]:
    look = _methods().get(method) or _stranger(method)
    mine = _standing_out()
    if method not in mine and ":" not in method:
        return look
    with suppress(Exception):  # one that cannot be loaded here keeps the name that it has in the rows
        look = {**look, "label": METHODS[method].label}
    place = mine.index(method) if method in mine else _digest(method)
    marker, dashes = OWN_MARKERS[place % len(OWN_MARKERS)], OWN_DASHES[place % len(OWN_DASHES)]
    return {"label": look["label"], "color": OWN, "marker": marker, "linestyle": dashes, "linewidth": 1.8}


def _standing_out() -> list[str]:
    """The methods with the reserved look: those of plug-ins, and the highlighted ones."""
    return list(dict.fromkeys((*(name for name in METHODS if name not in BUILT_IN), *_HIGHLIGHTED.get())))


def label(method: str) -> str:
    """What a table or a sentence calls a method. In a figure: `plain(label(method))`, or the label of `of`."""
    return _printable(_look(method)["label"])


def ordered(methods: Iterable[str]) -> list[str]:
    """Distinct names in legend order: the registry's, then the unknown ones by name."""
    known = list(_methods())
    return sorted(set(methods), key=lambda name: (known.index(name) if name in known else len(known), name))


def family(method: str) -> str:
    """The family a method is drawn with: its own if that has colours here, else OTHERS."""
    return _families().get(method, OTHERS)


def looks(methods: Iterable[str], named: Collection[str]) -> dict[str, dict[str, Any]]:
    """The look of each method where some are named and bold, in legend order; what stands out, and FEW, are all named."""
    names = ordered(methods)
    if len(names) <= FEW:
        alone = Counter(family(name) for name in names)
        return {name: bold(name) if alone[family(name)] == 1 else {**of(name), "linewidth": 1.6} for name in names}
    mine = _standing_out()
    return {name: of(name) if name in mine else bold(name) if name in named else thin(name) for name in names}


def naming(methods: Collection[str], chosen: str) -> str:
    """What a caption says of the lines of `looks`; chosen : which are named, if not all."""
    return (
        "Every method is named"
        if len(set(methods)) <= FEW
        else f"Thin: the other methods, each in the colour of its family; {chosen}"
    )


def thin(method: str) -> dict[str, Any]:
    """A method in the background: the colour of its family, its name only where one points at it."""
    look = {"color": of(method)["color"], "linewidth": 0.55, "alpha": 0.5}
    return {**look, "label": "_thin", "gid": title(label(method))}


def title(text: str) -> str:
    """The gid of a line that an SVG is to name by this text where one points at it."""
    return TITLE + _printable(text).replace(r"\$", "$")


def bold(method: str) -> dict[str, Any]:
    """The best of a family: what `label_ends` names."""
    if method in _standing_out():
        return of(method)
    return {**of(method), "color": _main_colour(method), "linestyle": "-", "linewidth": 1.9, "marker": "none"}


def _main_colour(method: str) -> str:
    name = family(method)
    return FAMILIES[name][0][0] if name in FAMILIES else str(of(method)["color"])


@cache
def _families() -> dict[str, str]:
    found = {}
    for name in METHODS:
        with suppress(Exception):  # a method that cannot be loaded here: one of the others
            found[name] = METHODS[name].family
    return {name: group for name, group in found.items() if group in FAMILIES}


@cache
def _methods() -> dict[str, dict[str, Any]]:
    styles: dict[str, dict[str, Any]] = {}
    members: dict[str, int] = {}
    for name in METHODS:
        try:
            method = METHODS[name]
        except Exception:  # a method that cannot be loaded here may still have rows: it is drawn as a stranger
            styles[name] = _stranger(name)
            continue
        place = members.setdefault(method.family, 0)
        members[method.family] += 1
        if method.family in FAMILIES:
            styles[name] = _style(method.label, *FAMILIES[method.family], place)
        else:
            styles[name] = {**_stranger(name), "label": method.label}
    return styles


def _stranger(name: str) -> dict[str, Any]:
    return _style(name, *STRANGERS, _digest(name))


def _digest(name: str) -> int:
    return hashlib.sha256(name.encode(errors="surrogatepass")).digest()[0]


def _style(text: str, colours: Sequence[str], markers: Sequence[str], place: int) -> dict[str, Any]:
    def pick(options: Sequence[Any]) -> Any:
        return options[place % len(options)]

    return {"label": text, "color": pick(colours), "marker": pick(markers), "linestyle": pick(DASHES)}


# ---------------------------------------------------------------- marks and labels


Line = Callable[[Axes, str, dict[str, Any]], None]  # draws one method into a panel, with this look


def by_family(
    methods: Iterable[str], line: Line, xlabel: str, ylabel: str, ylim: tuple[float, float]
) -> tuple[Figure, list[Axes]]:
    """Small multiples: a panel for each family that has any of the methods, two to a row, the reference grey in each."""
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


def label_end(ax: Axes, fontsize: float = 7) -> None:
    """Write each labelled line's name at its right end, pushed apart so that none overlap. Call it last."""
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    figure.ends += (_Ends(ax, fontsize),)


def label_ends(panels: Iterable[Axes], fontsize: float = 6.5) -> None:
    """`label_end` of several panels."""
    for ax in panels:
        label_end(ax, fontsize)


class _Ends:
    """The names at the ends of the lines of a panel, those without a line (`failed_label`) on top."""

    def __init__(self, ax: Axes, fontsize: float) -> None:
        self.ax, self.fontsize = ax, fontsize
        lines = [line for line in ax.get_lines() if not str(line.get_label()).startswith("_")]
        self.lines = [line for line in lines if line.get_label() != "failed" and _last_point(ax, line) is not None]
        look: dict[str, Any] = {"fontsize": fontsize, "va": "center", "transform": ax.transAxes}
        self.texts = [
            ax.text(1.05, 0.5, str(line.get_label()), color=readable(line.get_color()), **look) for line in self.lines
        ]
        self.failed = [text for text in ax.texts if text.get_gid() == "failed"]
        for text in self.failed:
            text.set(x=1.05, y=0.5, **look)
        colours = [line.get_color() for line in self.lines]
        self.leaders = LineCollection([], colors=colours, linewidths=0.4, transform=ax.transAxes, clip_on=False)
        self.leaders.set_in_layout(False)
        ax.add_collection(self.leaders, autolim=False)

    def spread(self) -> None:
        """Puts them where they belong, once the panel has its size."""
        panel = self.ax.get_window_extent()
        figure = self.ax.get_figure(root=True)
        assert figure is not None
        gap = 1.25 * self.fontsize * figure.dpi / 72 / panel.height
        ends = [_last_point(self.ax, line) or (1.0, 1.0) for line in self.lines]
        upwards = sorted(range(len(ends)), key=lambda i: ends[i][1])
        places = _spread([*(ends[i][1] for i in upwards), *(1.0 for _ in self.failed)], gap)
        for text, place in zip([*(self.texts[i] for i in upwards), *self.failed], places, strict=True):
            text.set_y(place)
        self.leaders.set_segments([(ends[i], (1.04, self.texts[i].get_position()[1])) for i in range(len(ends))])


def _last_point(ax: Axes, line: Any) -> tuple[float, float] | None:
    """The last finite point of a line, in fractions of the axes, held inside them; None if there is none."""
    data = np.column_stack([np.asarray(v, dtype=float) for v in line.get_data()])
    with np.errstate(all="ignore"):
        points = ax.transAxes.inverted().transform(ax.transData.transform(data))
    points = points[np.isfinite(points).all(axis=1)]
    return None if len(points) == 0 else (float(np.clip(points[-1][0], 0, 1)), float(np.clip(points[-1][1], 0, 1)))


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
    places = {of(name)["label"]: i for i, name in enumerate(_methods())}
    texts = sorted(entries, key=lambda text: places.get(text, len(places)))
    handles = [entries[text] for text in texts]
    for columns in range(len(texts), 0, -1):
        legend = fig.legend(handles, texts, loc="outside lower center", ncols=columns, columnspacing=1.4)
        _keep_to_the_letter(legend)
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


def failed_label(ax: Axes, method: str, name: str | None = None) -> None:
    """The name of a method that has nothing to show in a panel, crossed: in its corner, or where `label_ends` puts it."""
    above = sum(text.get_gid() == "failed" for text in ax.texts)
    text = f"× {plain(name or label(method))}"
    ax.text(
        0.02, 0.97 - 0.09 * above, text, color=readable(of(method)["color"]), fontsize=6.5, va="top",
        transform=ax.transAxes, gid="failed",
    )  # fmt: skip


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


def few_decades(axis: Any, decades: float = 1.0) -> None:
    """Plain numbers for a logarithmic axis of a decade or two: at 1, 2 and 5; at 1 and 3 if it has more than one decade."""
    from experiments.drawing.tables import show

    digits = (1, 3) if decades > 1 else (1, 2, 5)
    axis.set_major_locator(LogLocator(subs=digits) if decades > LESS else MaxNLocator(4, steps=(1, 2, 5, 10)))
    axis.set_major_formatter(lambda value, _: show(float(value)))
    axis.set_minor_formatter(NullFormatter())


def slope_guide(ax: Axes, exponent: float, anchor: tuple[float, float], span: float = 10.0, text: str = "") -> None:
    """A thin line y ∝ x^exponent on log-log axes from `anchor` over a factor `span` in x, with its name."""
    x0, y0 = anchor
    x1, y1 = x0 * span, y0 * span**exponent
    ax.plot([x0, x1], [y0, y1], color=FAINT, linewidth=0.7, linestyle=(0, (1, 1)), marker="none", label="_guide")
    ax.annotate(
        text or f"slope {exponent:g}", (x1, y1), (2, 0), textcoords="offset points", fontsize=6.5, color=FAINT,
        va="center",
    ).set_in_layout(False)  # fmt: skip
