"""Numbers and tables as a reader sees them: on the page, in Markdown, LaTeX and CSV."""

import io
import re

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.drawing import tables

VALUES = [  # a value, as text, in LaTeX
    (-0.0, "0", r"\num{0}"),
    (1234567, "1\u202f234\u202f567", r"\num{1234567}"),
    (0.125, "0.125", r"\num{0.125}"),
    (99.96, "100", r"\num{100}"),
    (9999.9, "10⁴", r"\num{1e4}"),
    (1024.0, "1024", r"\num{1024}"),
    (47369.5, "4.74×10⁴", r"\num{4.74e4}"),
    (10_000_000, "10⁷", r"\num{1e7}"),
    (-1e-12, "−10⁻¹²", r"\num{-1e-12}"),
    (-1.234e-5, "−1.23×10⁻⁵", r"\num{-1.23e-5}"),
    (5e-324, "4.94×10⁻³²⁴", r"\num{4.94e-324}"),
    (float("-inf"), "−∞", r"$-\infty$"),
    (float("nan"), "–", "--"),
    (None, "–", "--"),
    (np.bool_(True), "yes", "yes"),
    (np.int64(7), "7", r"\num{7}"),
    ("λ² [a] \\", "λ² [a] \\", r"$\lambda{}^{2}$ {[}a] \textbackslash{}"),
    ("rtol = 1e-05", "rtol = 10⁻⁵", r"rtol = 10${}^{-}{}^{5}$"),
]


@pytest.mark.parametrize(("value", "text", "tex"), VALUES, ids=lambda value: repr(value)[:12])
def test_values(value, text, tex):
    assert tables.show(value) == text
    assert tables.tex(value) == tex


def test_a_column_shows_three_digits_where_one_of_its_numbers_needs_them_and_whole_numbers_whole():
    """Also where a missing value made floats of whole ones. Among measured numbers a whole one is a measured one."""
    frame = pd.DataFrame({"e": [1.5e-9, 2.25e-9], "n": [1, 20_000], "tops": [1024.0, np.nan], "ns": [1024.0, 2048.4]})
    expected = [["1.50×10⁻⁹", "1", "1024", "1020"], ["2.25×10⁻⁹", "20\u202f000", "–", "2050"]]
    assert [[cell.text for cell in row] for row in tables.cells(frame)] == expected
    assert tables.markdown(frame).splitlines()[2] == "| 1.50×10⁻⁹ | 1 | 1024 | 1020 |"
    assert r"\num{1024} & \num{1020}" in tables.latex(frame)
    assert pd.read_csv(io.StringIO(tables.csv(frame))).equals(frame)


def test_headings_are_words():
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
    assert len(lines) == n
    assert all(line.count(" & ") == 2 and line.count(r"\num{") == 2 for line in lines)
    assert text.count("{") == text.count("}")
    assert ("longtable" in text.splitlines()[0]) == (kind == "longtable")
