"""Figures and tables as a reader sees them: looks, names and numbers, and files: the same bytes every time."""

import io
import re
from itertools import combinations

import matplotlib
import matplotlib.image
import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.integrators import METHODS


def test_families_have_colours_and_their_methods_differ():
    assert set(style.FAMILIES) == {method.family for method in METHODS.values()}
    assert style.ordered(["zeta", "rk45", "backlund", "alpha", "rk45"]) == ["backlund", "rk45", "alpha", "zeta"]
    looks = {name: style.of(name) for name in METHODS}
    markers = [*(look["marker"] for look in looks.values()), *style.OWN_MARKERS]
    assert not set(markers) & set("xX"), "a cross is a failure"
    for one, other in combinations(METHODS, 2):
        if style.family(one) == style.family(other):
            assert any(looks[one][key] != looks[other][key] for key in ("color", "marker", "linestyle")), (one, other)


ROWS = pd.DataFrame({"h": [0.01, 0.1, 1.0], "error": [1e-12, 3e-12, 9e-12]})


def draw(rows):
    fig, ax = style.figure("page")
    ax.loglog(rows.h, rows.error, **style.of("backlund"))
    ax.set_xlabel("step")
    return {"curve": fig}


def printed(width):
    with style.apply(width):
        return {kind: figures.content(draw(ROWS)["curve"], kind) for kind in figures.WITHOUT}


@pytest.mark.parametrize("width", style.WIDTHS)
def test_files_have_the_width_asked_for_embedded_fonts_and_no_date(width, monkeypatch):
    """And the same bytes, whatever the reader's own taste is."""
    monkeypatch.setattr(figures, "DPI", 100)  # a sixth of it: PNG takes most of the time
    files = printed(width)
    if width == "page":
        monkeypatch.setitem(matplotlib.rcParams, "lines.linewidth", 7.0)
        assert [kind for kind, content in printed(width).items() if content != files[kind]] == []
    pixels = matplotlib.image.imread(io.BytesIO(files["png"]))
    widths = [
        float(re.search(rb'viewBox="0 0 ([\d.]+)', files["svg"])[1]) / 72,
        float(re.search(rb"/MediaBox \[ *0 0 ([\d.]+)", files["pdf"])[1]) / 72,
        pixels.shape[1] / 100,
    ]
    assert widths == pytest.approx([style.WIDTHS[width]] * 3, abs=0.01)
    assert pixels[..., :3].std() > 0.02, "it shows something"
    assert b"/FontFile2" in files["pdf"], "TrueType, embedded"
    assert not any(word in files["pdf"] for word in (b"/Type3", b"CreationDate"))


def test_the_words_of_an_svg_can_be_searched():
    fig, ax = style.figure("column")
    ax.plot([1, 2], [1, 2], **style.thin("rk4"))
    ax.plot([1, 2], [2, 1], **style.of("strang"))
    ax.plot([1, 2], [2, 2], label="_guide")
    ax.set_xlabel("step <h> in $units")
    document = figures.svg(fig)
    assert f'<svg font-family="{figures.FONTS}" ' in document
    assert ">step &lt;h&gt; in $units</text>" in document
    titles = re.findall("<g><title>([^<]*)</title>", document)
    assert titles == [tables.label("rk4"), tables.label("strang")], "a line says whose it is"
    assert f"<title>{titles[0]}</title>" in figures.inline(document, "f", "label")


VALUES = [  # a value, as text, in LaTeX
    (-0.0, "0", "0"),
    (9999.9, "10⁴", "1e4"),
    (47369.5, "4.74×10⁴", "4.74e4"),
    (20_000, "20\u202f000", "20000"),
    (-1e-12, "−10⁻¹²", "-1e-12"),
    (5e-324, "4.94×10⁻³²⁴", "4.94e-324"),
    (float("-inf"), "−∞", r"{$-\infty$}"),
    (float("nan"), "–", r"{\textendash}"),
    (np.bool_(True), "yes", "yes"),
    ("rtol = 1e-05, λ", "rtol = 10⁻⁵, λ", r"rtol = 10\ensuremath{^-}\ensuremath{^5}, \ensuremath{\lambda}"),
]


def test_values_and_headings():
    assert [(tables.show(value), tables.tex(value)) for value, *_ in VALUES] == [tuple(texts) for _, *texts in VALUES]
    columns = ["ns_per_step", "setup_us", "us per use", 1e-6]
    assert [*map(tables.heading, columns)] == ["ns per step", "setup µs", "µs per use", "10⁻⁶"]


def test_a_table_for_a_paper_has_labels_and_numbers():
    columns = {"method": "rk4", "p": 3.9912, "steps": [np.nan, 1, 2], "a_b": "α & β"}
    frame = pd.DataFrame(columns, index=range(3))
    text = tables.latex(frame, "50 % of α")
    assert "{lSSl}" in text
    lines = [line for line in text.splitlines() if line.startswith("RK4 ")]
    assert lines[1] == r"RK4 & 3.99 & 1 & \ensuremath{\alpha} \& \ensuremath{\beta} \\"
    assert (len(lines), lines[0].split(" & ")[2]) == (3, r"{{\textendash}}")
    assert text.count("{") == text.count("}")
    assert tables.markdown(frame).splitlines()[3] == "| rk4 | 3.99 | 1 | α & β |"
    assert tables.cells(frame)[1] == [("rk4", None), ("3.99", "3.9912"), ("1", "1.0"), ("α & β", None)]
    assert tables.cells(frame)[0][2] == ("–", "")
    assert pd.read_csv(io.StringIO(tables.csv(frame))).equals(frame)
