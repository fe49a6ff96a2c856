"""A figure as SVG: a file of its own, and inline in a page next to others."""

from __future__ import annotations

import io
import re
from html import escape

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from report import style

WIDE = 360  # points: a figure wider than a column gets a row of the page to itself
DENSE = 20_000  # points of one line or scatter beyond which it is stored as pixels


def svg(figure: Figure) -> str:
    """The figure as a complete SVG document: no date, no version, so the same figure is the same text."""
    for artist in figure.findobj():
        if _points(artist) > DENSE:
            artist.set_rasterized(True)
    buffer = io.StringIO()
    with style.apply():
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return buffer.getvalue()


def inline(document: str, prefix: str, label: str) -> str:
    """The `<svg>` element of a document for a page with others: ids get a prefix, a reader gets a label."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<style.*?</style>", "", element, flags=re.DOTALL)  # would style the page; page.css has it
    element = re.sub(r'(\bid="|href="#|url\(#)', lambda match: f"{match[1]}{prefix}-", element)
    head, rest = element.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    assert view, "matplotlib writes a viewBox"
    width = float(view[0].split()[2])
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    size = f'class="{"wide" if width > WIDE else "narrow"}" style="--w:{width:g}"'
    return f'<svg {spaces} {view[0]} {size} role="img" aria-label="{escape(label)}">{rest}'


def _points(artist: Artist) -> int:
    if isinstance(artist, Line2D):
        return int(np.size(artist.get_xdata()))
    return int(np.shape(artist.get_offsets())[0]) if isinstance(artist, PathCollection) else 0
