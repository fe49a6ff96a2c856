"""What methods look like: name → label, colour, marker, line style.

Each family has a colour. The colours are the hues of Okabe and Ito, safe for colour-blind readers. The place of a method in its
family gives shade, marker and dashes, so a figure also reads in grey. A method that is not registered is grey. Methods of
plug-ins have black dashes, which no method of the bench has, and are named in every figure.
"""

from collections import Counter
from collections.abc import Collection, Iterable
from contextlib import suppress
from functools import lru_cache
from typing import Any

import pandas as pd

from lagrange_bench.experiments.drawing.canvas import plain, printable, title
from lagrange_bench.integrators.registry import BUILT_IN, MANY, METHODS, find_stored, without_archive

# family → (colours, markers), in registry order within the family; no crosses: they show where a method failed
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
OTHERS = "others"  # methods no longer registered, and families of plug-ins
STRANGER = "#5A5A5A"
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))
OWN = "#000000"  # colour of methods that stand out, with these markers and dashes
OWN_MARKERS = "*Phd"
OWN_DASHES: tuple[Any, ...] = ((0, (3, 1)), (0, (6, 1, 1, 1)), (0, (1, 0.8)), (0, (9, 2)))
EXACT_STEPS = ("backlund", "backlund_splitting")
MOST_NAMED = 8
GREY = "#c2c2c2"
FEW = MANY  # up to so many methods are all named


def of(method: str) -> dict[str, Any]:
    """label, color, marker and linestyle of a method: keywords for `Axes.plot`, with a label that makes no formula."""
    look = _look(method)
    return {**look, "label": plain(look["label"])}


def _look(method: str) -> dict[str, Any]:
    look = _known(METHODS.state)[1].get(method) or _stranger(method)
    mine = _standing_out()
    if method not in mine and ":" not in method:
        return look
    with suppress(Exception):  # a method that cannot be loaded here keeps its name in the rows
        look = {**look, "label": find_stored(method, METHODS).label}
    place = mine.index(method) if method in mine else 0
    return {**_style(look["label"], (OWN,), OWN_MARKERS, OWN_DASHES, place), "linewidth": 1.8}


def _standing_out() -> list[str]:
    """The methods with the reserved look: those of plug-ins."""
    return [name for name in METHODS if name not in BUILT_IN]


def label(method: str) -> str:
    """The name of a method in tables and sentences. In a figure: `plain(label(method))`, or the label of `of`."""
    return printable(_look(method)["label"])


def ordered(methods: Iterable[str]) -> list[str]:
    """Distinct names in legend order: registered methods in the registry's order, then the others by name."""
    known = list(_known(METHODS.state)[1])
    return sorted(set(methods), key=lambda name: (known.index(name) if name in known else len(known), name))


def shown(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows that figures show: of many methods the archive is left out, except methods that stand out."""
    if "method" not in rows:
        return rows
    names = [*without_archive(rows.method.dropna()), *_standing_out()]
    return rows[rows.method.isna() | rows.method.isin(names)]


def family(method: str) -> str:
    """The family that a method is drawn with: its own if it has colours here, otherwise OTHERS."""
    return _known(METHODS.state)[0].get(method, OTHERS)


def looks(methods: Iterable[str], named: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The look of each method, in legend order. Up to FEW methods are all bold and named. Methods that stand out are named, too.

    named : which of more methods are bold, the most important first: the exact steps and these, MOST_NAMED in all.
    """
    names = ordered(methods)
    first = [name for name in dict.fromkeys((*EXACT_STEPS, *named)) if name in names]
    chosen = names if len(names) <= FEW else first[:MOST_NAMED]
    mine = _standing_out()
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


@lru_cache(maxsize=8)
def _known(state: tuple[tuple[str, Any], ...]) -> tuple[dict[str, str], dict[str, dict[str, Any]]]:
    """Family and style of each registered method. One that cannot be loaded here may have rows, and looks like a stranger."""
    families: dict[str, str] = {}
    styles: dict[str, dict[str, Any]] = {}
    places: Counter[str] = Counter()
    for name, method, _ in METHODS.each():
        styles[name] = _stranger(name)
        if method and method.family in FAMILIES:
            families[name] = method.family
            styles[name] = _style(method.label, *FAMILIES[method.family], DASHES, places[method.family])
            places[method.family] += 1
        elif method:
            styles[name]["label"] = method.label
    return families, styles


def _stranger(name: str) -> dict[str, Any]:
    return {"label": name, "color": STRANGER, "marker": "+", "linestyle": "-"}


def _style(text: str, colours: tuple[str, ...], markers: str, dashes: tuple[Any, ...], place: int) -> dict[str, Any]:
    def pick(options: Any) -> Any:
        return options[place % len(options)]

    return {"label": text, "color": pick(colours), "marker": pick(markers), "linestyle": pick(dashes)}
