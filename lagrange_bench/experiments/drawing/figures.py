"""Figures as SVG, PDF or PNG files, the same bytes every time, and as SVG inside a page."""

import io
import re
from html import escape
from pathlib import Path

from matplotlib.figure import Figure

from lagrange_bench.experiments.drawing import style
from lagrange_bench.support.files import replace_file

WIDE = 360  # points: a wider figure gets a row of the page to itself
DPI = 600  # of a PNG: journals ask for this much in line art

FONTS = "'DejaVu Sans',Verdana,sans-serif"
TITLED = re.compile(rf'<g id="{style.TITLE}([^"]*)">')


# metadata that differ from day to day
WITHOUT = {
    "svg": ("Date", "Creator", "Format", "Type"),
    "pdf": ("CreationDate", "Creator", "Producer"),
    "png": ("Software",),
}

# ---------------------------------------------------------------- files


def content(figure: Figure, kind: str) -> bytes:
    """The bytes of a file: "svg", "pdf" or "png", without date and version, so that the same figure gives the same bytes.

    PDF and PNG have the font in them. A line of an SVG shows its name where one points at it; without DejaVu Sans, text has
    another font.
    """
    for ax in figure.axes:
        for line in ax.lines:
            if line.get_gid() is None and not str(line.get_label()).startswith("_"):
                line.set_gid(style.title(str(line.get_label())))
    buffer = io.BytesIO()
    with style.apply():
        figure.savefig(buffer, format=kind, dpi=DPI, metadata=dict.fromkeys(WITHOUT[kind]))
    if kind != "svg":
        return buffer.getvalue()
    document = TITLED.sub(r"<g><title>\1</title>", buffer.getvalue().decode())
    document = document.replace("font-family: 'DejaVu Sans'; ", "")
    return document.replace("<svg ", f'<svg font-family="{FONTS}" ', 1).encode()


def svg(figure: Figure) -> str:
    """The figure as a complete SVG document."""
    return content(figure, "svg").decode()


def wide(figure: Figure) -> bool:
    """Whether the figure is wider than a column."""
    return bool(72 * figure.get_figwidth() > WIDE)


def write(path: Path, figure: Figure) -> str:
    """Write a figure in the format of the suffix, and return whether a file was replaced."""
    return replace_file(path, content(figure, path.suffix.lower().removeprefix(".")))


# ---------------------------------------------------------------- in a page


def inline(document: str, prefix: str, label: str) -> str:
    """The `<svg>` element of a document for a page with others. prefix : of its ids. label : for screen readers."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<style.*?</style>", "", element, flags=re.DOTALL)  # would style the page; page.css has its rules
    element = re.sub(r'(\bid="|href="#|url\(#)', lambda match: f"{match[1]}{prefix}-", element)
    element = element.replace("xlink:href=", "href=")
    head, rest = element.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    assert view, "matplotlib writes a viewBox"
    width = float(view[0].split()[2])
    size = f'class="{"wide" if width > WIDE else "narrow"}" style="--w:{width:g}"'
    named = f'{size} role="img" aria-label="{escape(label)}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" font-family="{FONTS}" {view[0]} {named}>{rest}'
