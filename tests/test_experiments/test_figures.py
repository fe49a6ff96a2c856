"""Figures and tables as a reader sees them: looks, names and numbers, and files: the same bytes every time."""

import io
import re
from itertools import combinations, pairwise

import matplotlib
import matplotlib.image
import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.interface import FAMILIES


def test_families_have_colours_and_their_methods_differ():
    assert set(style.FAMILIES) == set(FAMILIES)
    assert style.ordered(["zeta", "rk45", "backlund", "alpha", "rk45"]) == ["backlund", "rk45", "alpha", "zeta"]
    looks = {name: style.of(name) for name in METHODS}
    markers = [*(look["marker"] for look in looks.values()), *style.STRANGERS[1], *style.OWN_MARKERS]
    assert not set(markers) & set("xX"), "a cross is a failure"
    for one, other in combinations(METHODS, 2):
        if style.family(one) == style.family(other):
            assert any(looks[one][key] != looks[other][key] for key in ("color", "marker", "linestyle")), (one, other)


def test_failures_of_several_methods_do_not_hide_each_other():
    with style.apply():
        fig, ax = style.figure("column")
        ax.semilogx([1, 10], [0, 1], label="_line")
        for method in ("rk4", "rk45", "strang"):
            style.failure_marks(ax, [2.0, 5.0], method)
        style.failure_marks(ax, [])
        style.failed_label(ax, "backlund")
        fig.draw_without_rendering()
        crosses = [line for line in ax.get_lines() if line.get_gid() == "failed"]
        heights = [line.get_transform().transform(line.get_xydata())[0, 1] for line in crosses]
        assert len(crosses) == 3
        assert all(above - below > 3 * fig.dpi / 72 for above, below in pairwise(heights))
        (name,) = ax.texts
        assert name.get_text().startswith("×")


ROWS = pd.DataFrame({"h": [0.01, 0.1, 1.0], "error": [1e-12, 3e-12, 9e-12]})


def draw(rows):
    fig, ax = style.figure("page")
    ax.loglog(rows.h, rows.error, **style.of("backlund"))
    ax.set_xlabel("step")
    return {"curve": fig}


def printed(width):
    with style.apply(width):
        return {kind: figure(draw(ROWS)["curve"]) for kind, figure in figures.FORMATS.items()}


@pytest.mark.parametrize("width", style.WIDTHS)
def test_files_have_the_width_asked_for_embedded_fonts_and_no_date(width, monkeypatch):
    """And the same bytes, whatever the reader's own taste is."""
    monkeypatch.setattr(figures, "DPI", dict.fromkeys(figures.DPI, 100))  # a sixth of it: PNG takes most of the time
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
    assert titles == [style.label("rk4"), style.label("strang")], "a line says whose it is"
    assert f"<title>{titles[0]}</title>" in figures.inline(document, "f", "label")


VALUES = [  # a value, as text, in LaTeX
    (-0.0, "0", r"\num{0}"),
    (9999.9, "10⁴", r"\num{1e4}"),
    (47369.5, "4.74×10⁴", r"\num{4.74e4}"),
    (-1e-12, "−10⁻¹²", r"\num{-1e-12}"),
    (5e-324, "4.94×10⁻³²⁴", r"\num{4.94e-324}"),
    (float("-inf"), "−∞", r"$-\infty$"),
    (float("nan"), "–", "--"),
    (np.bool_(True), "yes", "yes"),
    ("λ² [a] \\", "λ² [a] \\", r"$\lambda{}^{2}$ {[}a] \textbackslash{}"),
    ("x\u0304² α₁²", "x\u0304² α₁²", r"$\bar{x}{}^{2}$ $\alpha{}_{1}{}^{2}$"),
    ("rtol = 1e-05", "rtol = 10⁻⁵", r"rtol = 10${}^{-5}$"),
]


@pytest.mark.parametrize(("value", "text", "tex"), VALUES, ids=lambda value: repr(value)[:12])
def test_values(value, text, tex):
    assert tables.show(value) == text
    assert tables.tex(value) == tex


def test_a_column_shows_three_digits_where_one_of_its_numbers_needs_them_and_whole_numbers_whole():
    frame = pd.DataFrame({"e": [1.5e-9, 2.25e-9], "n": [1, 20_000], "tops": [1024.0, np.nan], "ns": [1024.0, 2048.4]})
    expected = [["1.50×10⁻⁹", "1", "1024", "1020"], ["2.25×10⁻⁹", "20\u202f000", "–", "2050"]]
    assert [[cell.text for cell in row] for row in tables.cells(frame)] == expected
    assert tables.markdown(frame).splitlines()[2] == "| 1.50×10⁻⁹ | 1 | 1024 | 1020 |"
    assert r"\num{1024} & \num{1020}" in tables.latex(frame)
    assert pd.read_csv(io.StringIO(tables.csv(frame))).equals(frame)
    formulas = pd.DataFrame({"=1+1": ["=1+1", "@SUM(1)", "-1,2", "a=b"]})
    assert tables.csv(formulas) == "'=1+1\n'=1+1\n'@SUM(1)\n\"-1,2\"\na=b\n"
    columns = ["ns_per_step", "setup_us", "us per use", 32.0, "1e-06"]
    assert [*map(tables.heading, columns)] == ["ns per step", "setup µs", "µs per use", "32", "10⁻⁶"]


@pytest.mark.parametrize(("n", "kind"), [(3, "tabular"), (200, "longtable")])
def test_latex_tables_are_whole_and_long_ones_break_over_pages(n, kind):
    frame = pd.DataFrame({"a_b": ["α & β"] * n, "error": np.geomspace(1e-9, 1, n), "n": range(n)})
    text = tables.latex(frame, "50 % of α")
    opened, closed = re.findall(r"\\begin{(\w+)}", text), re.findall(r"\\end{(\w+)}", text)
    assert opened == closed == [kind]
    body = text.split("\\endfoot" if kind == "longtable" else "\\midrule")[1]
    lines = [line for line in body.splitlines() if line.endswith(r"\\")]
    assert [(line.count(" & "), line.count(r"\num{")) for line in lines] == [(2, 2)] * n
    assert text.count("{") == text.count("}")
