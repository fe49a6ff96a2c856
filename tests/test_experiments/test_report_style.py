"""Numbers, tables and figures as a reader sees them."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.experiments.drawing.looks import _luminance
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.interface import FAMILIES
from lagrange_bench.results.store import Store, default_results

TEX = next(filter(None, map(shutil.which, ("pdflatex", "lualatex", "xelatex", "tectonic"))), None)


@pytest.mark.parametrize(
    ("value", "text", "tex"),
    [
        (0.0, "0", r"\num{0}"),
        (-0.0, "0", r"\num{0}"),
        (1, "1", r"\num{1}"),
        (1234567, "1\u202f234\u202f567", r"\num{1234567}"),
        (0.125, "0.125", r"\num{0.125}"),
        (99.96, "100", r"\num{100}"),
        (1234.5, "1230", r"\num{1230}"),
        (9999.9, "10⁴", r"\num{1e4}"),
        (1024.0, "1024", r"\num{1024}"),
        (47369.0, "47\u202f369", r"\num{47369}"),
        (47369.5, "4.74×10⁴", r"\num{4.74e4}"),
        (10_000_000, "10⁷", r"\num{1e7}"),
        (-1e-12, "−10⁻¹²", r"\num{-1e-12}"),
        (
            "rtol = 1e-05, h = 4.3e-05",
            "rtol = 10⁻⁵, h = 4.3×10⁻⁵",
            r"rtol = 10${}^{-}{}^{5}$, h = 4.3$\times$10${}^{-}{}^{5}$",
        ),
        (-1.234e-5, "−1.23×10⁻⁵", r"\num{-1.23e-5}"),
        (5e-324, "4.94×10⁻³²⁴", r"\num{4.94e-324}"),
        (float("-inf"), "−∞", r"$-\infty$"),
        (float("nan"), "–", "--"),
        (None, "–", "--"),
        (np.bool_(True), "yes", "yes"),
        (np.int64(7), "7", r"\num{7}"),
        ("λ² [a] \\", "λ² [a] \\", r"$\lambda{}^{2}$ {[}a] \textbackslash{}"),
    ],
)
def test_values(value, text, tex):
    assert tables.show(value) == text
    assert tables.tex(value) == tex


def test_a_column_that_needs_three_digits_shows_three():
    frame = pd.DataFrame({"e": [1.5e-9, 2.25e-9], "h": [0.5, 0.25], "n": [1, 20000]})
    assert [[cell.text for cell in row] for row in tables.cells(frame)] == [
        ["1.50×10⁻⁹", "0.5", "1"],
        ["2.25×10⁻⁹", "0.25", "20\u202f000"],
    ]
    assert pd.read_csv(io.StringIO(tables.csv(frame))).equals(frame)


def test_a_column_of_whole_numbers_shows_them_whole():
    """Also where a missing value made floats of them. Among measured numbers a whole one is a measured one."""
    frame = pd.DataFrame({"tops": [1024.0, np.nan, 65536.0], "ns": [1024.0, 2048.4, np.nan], "huge": [1e7, 1e9, 2.5e8]})
    expected = [["1024", "1020", "10⁷"], ["–", "2050", "10⁹"], ["65\u202f536", "–", "2.5×10⁸"]]
    assert [[cell.text for cell in row] for row in tables.cells(frame)] == expected
    assert tables.markdown(frame).splitlines()[2] == "| 1024 | 1020 | 10⁷ |"
    assert r"\num{1024} & \num{1020}" in tables.latex(frame)


def test_latex_tables_are_whole_and_long_ones_break_over_pages():
    for n in (3, 200):
        frame = pd.DataFrame({"a_b": ["α & β"] * n, "error": np.geomspace(1e-9, 1, n), "n": range(n)})
        text = tables.latex(frame, "50 % of α")
        kind = "longtable" if n > tables.PAGE else "tabular"
        opened, closed = re.findall(r"\\begin{(\w+)}", text), re.findall(r"\\end{(\w+)}", text)
        assert opened == closed == [kind]
        body = text.split("\\endfoot" if n > tables.PAGE else "\\midrule")[1]
        lines = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert len(lines) == n
        assert all(line.count(" & ") == 2 and line.count(r"\num{") == 2 for line in lines)
        assert text.count("{") == text.count("}")
        assert ("longtable" in text.splitlines()[0]) == (n > tables.PAGE)


def lacks_siunitx():
    """Whether a TeX distribution is here that tells what it has, and has not the package."""
    asked = shutil.which("kpsewhich")
    return asked is not None and not subprocess.run([asked, "siunitx.sty"], capture_output=True, check=False).stdout


@pytest.mark.skipif(TEX is None, reason="needs a TeX engine: pdflatex, lualatex, xelatex or tectonic")
@pytest.mark.skipif(lacks_siunitx(), reason="needs the LaTeX package siunitx")
def test_latex_tables_compile(tmp_path):
    rows = {
        "text": ["50 % of a_b & [λ²] * ~ ^ \\ <a|b>", "…–—, 2x̄ − λ̄ µs"],
        "x": [1.5e-9, -np.inf],
        "n": [20_000, 1],
        "y": [np.nan, 2.0],
    }
    frame = pd.DataFrame(rows)
    body = "\n\n".join(tables.latex(f, "a caption, 100 %") for f in (frame, pd.concat([frame] * 50)))
    packages = "\\usepackage{booktabs,siunitx,longtable}"
    (tmp_path / "all.tex").write_text(
        f"\\documentclass{{article}}{packages}\\begin{{document}}\n{body}\n\\end{{document}}\n"
    )
    options = [] if TEX.endswith("tectonic") else ["-interaction=nonstopmode", "-halt-on-error"]
    done = subprocess.run([TEX, *options, "all.tex"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:]


def test_every_letter_of_the_reference_tables_is_known_to_latex():
    store = Store(default_results())
    for name in EXPERIMENTS:
        for table in load(name).tables(store.rows(name)).values():
            text = tables.latex(tables.flat(table), table.attrs.get("caption", ""))
            assert {
                letter for letter in text.replace(f"% {table.attrs.get('caption', '')}", "") if letter > "ÿ"
            } == set()


def test_headings_are_words():
    assert [tables.heading(name) for name in ("ns_per_step", "setup_us", "H", "us per use", 2, 32.0, "1e-06")] == [
        "ns per step", "setup µs", "H", "µs per use", "2", "32", "10⁻⁶",
    ]  # fmt: skip


# ---------------------------------------------------------------- style


def test_a_method_looks_the_same_everywhere_and_unlike_its_family():
    assert style.of("not_registered") == style.of("not_registered")
    assert style.of("not_registered")["label"] == "not_registered"
    assert style.ordered(["zeta", "rk45", "backlund", "alpha", "rk45"]) == ["backlund", "rk45", "alpha", "zeta"]
    for colours, markers in style.FAMILIES.values():
        assert len(set(colours)) == len(colours) <= len(markers) + 1


def test_a_method_lent_for_a_while_is_drawn_as_itself_whatever_was_drawn_before():
    mine = replace(METHODS["rk4"], name="mine", label="My RK4")
    drawn = style.looks(["rk4"], ())
    with METHODS.lent(mine):
        assert style.family("mine") == "runge-kutta"
        assert style.of("mine")["label"] == "My RK4"
        assert style.ordered(["zero", "mine", "rk4"]) == ["rk4", "mine", "zero"]
    assert style.family("mine") == style.OTHERS
    assert style.looks(["rk4"], ()) == drawn


def test_every_family_has_colours_and_a_title():
    assert set(style.FAMILIES) == set(FAMILIES) == set(style.TITLES)
    for name in METHODS:
        assert style.family(name) in FAMILIES
    assert style.family("not_registered") == style.OTHERS
    for family in FAMILIES:  # no two methods of a panel look the same
        looks = [
            (look["color"], look["marker"], str(look["linestyle"]))
            for name in METHODS
            if style.family(name) == family and (look := style.of(name))
        ]
        assert len(set(looks)) == len(looks), family


def test_small_multiples_show_every_method_once_and_name_it_apart_from_the_others():
    def line(ax, method, look):
        if method == "rk45":
            style.failed_label(ax, method)
        else:
            ax.loglog([1, 10], [1e-9, 1e-9 * (1 + len(method))], **look)

    names = [*METHODS, "not_registered"]
    with style.apply():
        fig, axes = style.by_family(reversed(names), line, "x", "y", (1e-16, 1))
        style.label_ends(axes)
        fig.draw_without_rendering()
        texts = [text for ax in axes for text in ax.texts]
        assert sorted(text.get_text() for text in texts) == sorted(
            f"× {style.label(name)}" if name == "rk45" else style.label(name) for name in names
        )
        for ax in axes:
            boxes = sorted((Text.get_window_extent(text) for text in ax.texts), key=lambda box: box.y0)
            ends = [box for box in boxes if box.x0 > ax.bbox.x1]
            assert all(below.y1 <= above.y0 + 0.5 for below, above in pairwise(ends))
            assert all(box.x1 <= fig.bbox.x1 for box in boxes)
        assert len(axes) == len({style.family(name) for name in names})


def test_names_at_the_ends_stay_apart_in_a_column_and_at_any_resolution():
    def line(ax, method, look):
        ax.loglog([1, 10], [1e-9, 1e-9], **look)

    with style.apply("column"):
        fig, axes = style.by_family(METHODS, line, "x", "y", (1e-16, 1))
        style.label_ends(axes)
        for dpi in (72, 600):
            fig.set_dpi(dpi)
            fig.draw_without_rendering()
            boxes = sorted((Text.get_window_extent(text) for ax in axes for text in ax.texts), key=lambda box: box.y0)
            assert all(below.y1 <= above.y0 + 0.007 * dpi for below, above in pairwise(boxes))


def test_failures_of_several_methods_do_not_hide_each_other():
    with style.apply():
        fig, ax = style.figure("column")
        ax.semilogx([1, 10], [0, 1], label="_line")
        for method in ("rk4", "rk45", "strang"):
            style.failure_marks(ax, [2.0, 5.0], method)
        style.failed_label(ax, "backlund")
        style.label_end(ax)
        fig.draw_without_rendering()
        crosses = [line for line in ax.get_lines() if line.get_gid() == "failed"]
        heights = [line.get_transform().transform(line.get_xydata())[0, 1] for line in crosses]
        assert all(above - below > 3 * fig.dpi / 72 for above, below in pairwise(heights))
        assert max(heights) < ax.bbox.y1
        (name,) = ax.texts
        assert name.get_text().startswith("×")
        assert Text.get_window_extent(name).x0 > ax.bbox.x1, "out of the way of the data"


def test_coloured_text_can_be_read():
    for colours, _ in style.FAMILIES.values():
        for colour in (*colours, "#ffffff", "#000000"):
            text = style.readable(colour)
            assert 1.05 / (_luminance(np.array(text)) + 0.05) >= style.CONTRAST
    assert style.readable("#000000") == (0.0, 0.0, 0.0)
    assert style.readable("#0072B2") == pytest.approx((0, 0x72 / 255, 0xB2 / 255)), "no darker than it has to be"


def test_ticks_between_the_decades_only_where_they_can_be_told_apart():
    with style.apply():
        fig, (few, many) = style.figure("page", ncols=2)
        few.loglog([1, 100], [1, 2])
        many.loglog([1, 1e6], [1, 2])
        style.few_decades(few.yaxis)
        fig.draw_without_rendering()
        assert len(few.get_xticks(minor=True)) > 8
        assert len(many.get_xticks(minor=True)) == 0
        assert "2" in [text.get_text() for text in few.get_yticklabels()]


@pytest.mark.parametrize("ends", [(2.5e-3, 8e-2), (1.2e-2, 8.5e-2), (1.1, 2.3), (1.2e-5, 4e-5)])
def test_numbers_below_a_short_logarithmic_axis_do_not_overlap(ends):
    with style.apply():
        fig, (ax, *_) = style.figure("page", 1.8, ncols=3)
        ax.loglog(ends, [1, 2])
        fig.draw_without_rendering()
        ticks = ax.get_xticklabels() + ax.get_xticklabels(minor=True)
        shown = [text.get_window_extent() for text in ticks if text.get_text()]
    inside = sorted((box for box in shown if ax.bbox.x0 <= (box.x0 + box.x1) / 2 <= ax.bbox.x1), key=lambda box: box.x0)
    assert len(inside) >= 2
    assert all(left.x1 < right.x0 for left, right in pairwise(inside))


def test_labels_at_the_ends_do_not_overlap():
    with style.apply():
        fig, ax = style.figure("column")
        for i in range(6):
            ax.plot([0, 1], [0, 1 + i / 100], label=f"line {i}")
        ax.plot([], [], label="empty")
        style.label_end(ax)
        fig.draw_without_rendering()
        boxes = sorted((Text.get_window_extent(text) for text in ax.texts), key=lambda box: box.y0)
    assert len(boxes) == 6
    assert all(below.y1 <= above.y0 + 0.5 for below, above in pairwise(boxes))
    assert all(box.x1 <= fig.bbox.x1 for box in boxes)


def test_legend_fits_below_and_names_each_once():
    with style.apply():
        fig, axes = style.figure("column", ncols=2)
        for ax in axes:
            for i in range(7):
                ax.plot([0, 1], [0, i], label=f"a method with a long name {i}")
            style.failure_marks(ax, [0.5, 0.7])
            style.failure_marks(ax, [])
        style.legend_below(fig)
        fig.draw_without_rendering()
        (legend,) = fig.legends
        assert legend.get_window_extent().width <= fig.bbox.width
        assert fig.get_figheight() < style.TALLEST
    assert [text.get_text() for text in legend.get_texts()].count("failed") == 1
    assert len(legend.get_texts()) == 8


def test_dense_figures_are_stored_as_pixels():
    with style.apply():
        fig, ax = style.figure("column")
        ax.plot(*np.random.default_rng(0).normal(size=(2, 30_000)), ".")
        document = figures.svg(fig)
    assert "data:image/png" in document
    assert len(document) < 300_000
