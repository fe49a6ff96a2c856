"""A figure as SVG, PDF or PNG, the same bytes every time; and as SVG inside a page next to others, made small."""

import io
import re
from collections.abc import Callable
from html import escape
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from lagrange_bench.experiments.drawing import style

WIDE = 360  # points: a figure wider than a column gets a row of the page to itself
DPI = {"column": 600, "page": 400}  # of a PNG: what journals ask for line art

FONTS = "'DejaVu Sans',Verdana,sans-serif"
TITLED = re.compile(rf'<g id="{style.TITLE}([^"]*)">')
NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
PLACED = re.compile(r'(\b(?:x|y|width|height)=|translate|rotate)("[^"p]*"|\([^)]*\))')


# ---------------------------------------------------------------- files


def svg(figure: Figure) -> str:
    """The figure as a complete SVG document: no date, no version, so the same figure is the same text."""
    without = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    return compact(_printed(figure, FigureCanvasSVG, "svg", style.RC["savefig.dpi"], without).decode())


def pdf(figure: Figure) -> bytes:
    """The figure as PDF, fonts embedded as TrueType: text can be searched, and no date is in it."""
    without = dict.fromkeys(("CreationDate", "Creator", "Producer"))
    return _printed(figure, FigureCanvasPdf, "pdf", style.RC["savefig.dpi"], without)


def wide(figure: Figure) -> bool:
    """Whether it is wider than a column."""
    return bool(72 * figure.get_figwidth() > WIDE)


def png(figure: Figure) -> bytes:
    """The figure as PNG."""
    width = "page" if wide(figure) else "column"
    return _printed(figure, FigureCanvasAgg, "png", DPI[width], {"Software": None})


FORMATS: dict[str, Callable[[Figure], bytes]] = {"svg": lambda figure: svg(figure).encode(), "pdf": pdf, "png": png}


def _printed(figure: Figure, canvas: Any, kind: str, dpi: float, metadata: dict[str, Any]) -> bytes:
    """Not by figure.savefig: that would lay everything out once more before it prints. dpi: of what is pixels."""
    style.finish(figure)
    for line in (line for ax in figure.axes for line in ax.lines):
        if line.get_gid() is None and not str(line.get_label()).startswith("_"):
            line.set_gid(style.title(str(line.get_label())))
    buffer = io.BytesIO()
    with style.apply():
        figure.set_dpi(dpi)
        getattr(canvas(figure), f"print_{kind}")(buffer, metadata=metadata)
    return buffer.getvalue()


# ---------------------------------------------------------------- fewer bytes of SVG


def compact(document: str) -> str:
    """The same picture in fewer bytes: hundredths of a point, relative paths, no comments, no ids nobody refers to."""
    document = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", document, flags=re.DOTALL)
    document = TITLED.sub(r"<g><title>\1</title>", document)
    document = document.replace("font-family: 'DejaVu Sans'; ", "")  # that of the document, once
    document = re.sub(r' transform="rotate\(-?0 [^"]*\)"', "", document)
    document = document.replace("<svg ", f'<svg font-family="{FONTS}" ', 1)
    kept = {name for pair in re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', document) for name in pair}
    document = re.sub(r' id="([^"]+)"', lambda match: match[0] if match[1] in kept else "", document)
    document = re.sub(r'\bd="([^"]*)"', lambda match: f'd="{_path(match[1])}"', document)
    document = PLACED.sub(lambda match: match[1] + NUMBER.sub(lambda n: _short(n[0]), match[2]), document)
    document = re.sub(r'style="[^"]*"', lambda match: match[0].replace(": ", ":").replace("; ", ";"), document)
    document = re.sub(r">\s+<", "><", document)
    return re.sub(r"<defs></defs>|<g></g>", "", document)


def _path(data: str) -> str:
    """Path data with relative coordinates, rounded so that errors do not add up. Curves stay absolute."""
    if re.search(r"[^MLZz\d\s.e-]", data):
        return " ".join(token if token.isalpha() else _short(token) for token in data.split())
    text, at, start = [], (0, 0), (0, 0)
    for kind, x, y in re.findall(r"([MLZz]?)\s*(?:(-?\d\S*)\s+(-?\d\S*))?", data):
        if kind in ("Z", "z"):
            text.append("z")
            at = start
        if not x:
            continue
        to = (round(100 * float(x)), round(100 * float(y)))
        if kind == "M":
            text.append("M" + _pair(*to))
            start = to
        elif to != at:
            text.append("l" + _pair(to[0] - at[0], to[1] - at[1]))
        elif not text[-1].startswith("l"):
            text.append("l0 0")  # a point, which round caps show
        at = to
    return "".join(text)


def _pair(x: int, y: int) -> str:
    second = _hundredths(y)
    return _hundredths(x) + ("" if second.startswith("-") else " ") + second


def _short(number: str) -> str:
    return _hundredths(round(100 * float(number)))


def _hundredths(n: int) -> str:
    sign, whole, rest = "-" if n < 0 else "", abs(n) // 100, f"{abs(n) % 100:02d}".rstrip("0")
    return f"{sign}{whole or ''}.{rest}" if rest else f"{sign}{whole}"


# ---------------------------------------------------------------- in a page


def inline(document: str, prefix: str, label: str) -> str:
    """The `<svg>` element of a document for a page with others: ids get a prefix, a reader gets a label."""
    element = document[document.index("<svg") :]
    element = re.sub(r"<style.*?</style>", "", element, flags=re.DOTALL)  # would style the page; page.css has it
    element = re.sub(r'(\bid="|href="#|url\(#)', lambda match: f"{match[1]}{prefix}-", element)
    element = element.replace("xlink:href=", "href=")
    head, rest = element.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    assert view, "matplotlib writes a viewBox"
    width = float(view[0].split()[2])
    size = f'class="{"wide" if width > WIDE else "narrow"}" style="--w:{width:g}"'
    named = f'{size} role="img" aria-label="{escape(label)}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" font-family="{FONTS}" {view[0]} {named}>{rest}'
