"""Figures: how methods look, names and marks in panels, and files: the same bytes every time, in three formats and two widths."""

import io
import re
import sys
from dataclasses import replace
from itertools import combinations, pairwise
from types import ModuleType

import matplotlib
import matplotlib.image
import pandas as pd
import pytest
from matplotlib.text import Text

from lagrange_bench.experiments.drawing import figures, style
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.interface import FAMILIES
from lagrange_bench.results import store


def test_families_have_colours_and_their_methods_differ():
    """Two methods of a panel never look the same; one that nobody registered has a look of its own, always the same."""
    assert set(style.FAMILIES) == set(FAMILIES)
    assert style.family("not_registered") == style.OTHERS
    assert style.of("not_registered")["label"] == "not_registered"
    assert style.ordered(["zeta", "rk45", "backlund", "alpha", "rk45"]) == ["backlund", "rk45", "alpha", "zeta"]
    looks = {name: style.of(name) for name in METHODS}
    for one, other in combinations(METHODS, 2):
        if style.family(one) == style.family(other):
            assert any(looks[one][key] != looks[other][key] for key in ("color", "marker", "linestyle")), (one, other)


def test_a_method_lent_for_a_while_is_drawn_as_itself_whatever_was_drawn_before():
    mine = replace(METHODS["rk4"], name="mine", label="My RK4")
    drawn = style.looks(["rk4"], ())
    with METHODS.lent(mine):
        assert style.family("mine") == "runge-kutta"
        assert style.of("mine")["label"] == "My RK4"
        assert style.ordered(["zero", "mine", "rk4"]) == ["rk4", "mine", "zero"]
    assert style.family("mine") == style.OTHERS
    assert style.looks(["rk4"], ()) == drawn


def test_small_multiples_name_every_method_once_and_apart_from_the_others():
    """In a column, where all lines end in one place."""

    def line(ax, method, look):
        if method == "rk45":
            style.failed_label(ax, method)
        else:
            ax.loglog([1, 10], [1e-9, 1e-9], **look)

    names = [*METHODS, "not_registered"]
    with style.apply("column"):
        fig, axes = style.multiples(reversed(names), line, "x", "y", (1e-16, 1))
        style.label_ends(axes)
        fig.draw_without_rendering()
        for ax in axes:
            boxes = sorted(map(Text.get_window_extent, ax.texts), key=lambda box: box.y0)
            ends = [box for box in boxes if box.x0 > ax.bbox.x1]
            assert all(below.y1 <= above.y0 + 0.007 * fig.dpi for below, above in pairwise(ends))
            assert all(box.x1 <= fig.bbox.x1 for box in boxes)
    texts = [text.get_text() for ax in axes for text in ax.texts]
    assert sorted(texts) == sorted(f"{'× ' * (name == 'rk45')}{style.label(name)}" for name in names)
    assert len(axes) == len({style.family(name) for name in names})


def test_failures_of_several_methods_do_not_hide_each_other():
    with style.apply():
        fig, ax = style.figure("column")
        ax.semilogx([1, 10], [0, 1], label="_line")
        for method in ("rk4", "rk45", "strang"):
            style.failure_marks(ax, [2.0, 5.0], method)
        style.failure_marks(ax, [])
        style.failed_label(ax, "backlund")
        style.label_ends([ax])
        fig.draw_without_rendering()
        crosses = [line for line in ax.get_lines() if line.get_gid() == "failed"]
        heights = [line.get_transform().transform(line.get_xydata())[0, 1] for line in crosses]
        assert len(crosses) == 3
        assert all(above - below > 3 * fig.dpi / 72 for above, below in pairwise(heights))
        (name,) = ax.texts
        assert name.get_text().startswith("×")
        assert Text.get_window_extent(name).x0 > ax.bbox.x1, "out of the way of the data"


def test_legend_fits_below_and_names_each_once():
    with style.apply():
        fig, axes = style.figure("column", ncols=2)
        for ax in axes:
            for i in range(7):
                ax.plot([0, 1], [0, i], label=f"a method with a long name {i}")
        style.legend_below(fig)
        fig.draw_without_rendering()
        (legend,) = fig.legends
        assert legend.get_window_extent().width <= fig.bbox.width
    assert len(legend.get_texts()) == 7


def test_numbers_below_a_short_logarithmic_axis_do_not_overlap():
    with style.apply():
        fig, axes = style.figure("page", 1.8, ncols=3)
        for ax, ends in zip(axes, ((2.5e-3, 8e-2), (1.1, 2.3), (1, 1e6)), strict=True):
            ax.loglog(ends, [1, 2])
        fig.draw_without_rendering()
        assert len(axes[2].get_xticks(minor=True)) == 0
        for ax in axes[:2]:
            ticks = ax.get_xticklabels() + ax.get_xticklabels(minor=True)
            shown = sorted((text.get_window_extent() for text in ticks if text.get_text()), key=lambda box: box.x0)
            inside = [box for box in shown if ax.bbox.x0 <= (box.x0 + box.x1) / 2 <= ax.bbox.x1]
            assert len(inside) >= 2
            assert all(left.x1 < right.x0 for left, right in pairwise(inside))


def test_names_are_no_formulas():
    """Of methods, as a legend, an axis or a corner of a panel has them."""
    name = "$\\frac{$ bell \a, null \0, \ud800"
    fig, ax = style.figure("column")
    ax.plot([1, 2], [1, 2], **style.of(name))
    ax.set_yticks([1, 2], [style.plain(name), "b"])
    style.failed_label(ax, name)
    style.legend_below(fig)
    assert all(draw(fig) for draw in figures.FORMATS.values())
    readable = "".join(c for c in name if c.isprintable())
    assert style.label(name) == readable
    parsed = [text._preprocess_math(text.get_text()) for text in fig.findobj(Text)]
    assert sum(readable in text for text, formula in parsed if not formula) >= 3


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


def test_in_a_column_panels_are_on_top_of_each_other_and_keep_their_labels():
    with style.apply("column"):
        fig, axes = style.figure("page", 4.0, nrows=2, ncols=2, sharex=True, sharey=True, squeeze=False)
    axes[1, 1].remove()
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    axes[1, 0].set_xlabel("step")
    style.finish(fig)
    fig.draw_without_rendering()
    boxes = [ax.get_position() for ax in fig.axes]
    assert len(boxes) == 3
    assert all(above.y0 > below.y1 for above, below in pairwise(boxes))
    assert [ax.get_ylabel() for ax in fig.axes] == ["error"] * 3
    assert [ax.get_xlabel() for ax in fig.axes] == ["", "", "step"]


def test_an_svg_refers_to_what_it_has_and_its_words_can_be_searched():
    fig, ax = style.figure("column")
    ax.plot([1, 2], [1, 2], **style.thin("rk4"))
    ax.plot([1, 2], [2, 1], **style.of("strang"))
    ax.plot([1, 2], [2, 2], label="_guide")
    ax.set_xlabel("step <h> in $units")
    document = figures.svg(fig)
    used = set(re.findall(r'href="#([^"]+)"', document)) | set(re.findall(r"url\(#([^)]+)\)", document))
    assert used == set(re.findall(r'\bid="([^"]+)"', document))
    assert ">step &lt;h&gt; in $units</text>" in document
    titles = re.findall("<g><title>([^<]*)</title>", document)
    assert titles == [style.label("rk4"), style.label("strang")], "a line says whose it is"
    assert f"<title>{titles[0]}</title>" in figures.inline(document, "f", "label")


def test_paths_are_shortened_and_rounding_does_not_add_up():
    for path, short in (
        ("M 1.23456 2 \nL 3.005 4.5 \nL 3.005 4.5 \nz \n", "M1.23 2l1.77 2.5z"),
        ("M 0 0 L -0.25 10.001 M 5 5 L 5 5", "M0 0l-.25 10M5 5l0 0"),
        ("M 0 -2.5 C 0.663008 -2.5 1.29895 -2.23 1.7 -1.7 z", "M 0 -2.5 C .66 -2.5 1.3 -2.23 1.7 -1.7 z"),
    ):
        assert figures.compact(f'<path d="{path}"/>') == f'<path d="{short}"/>'
    long = figures.compact(f'<path d="M 0 0 {" ".join(f"L {0.0333 * k:.6f} 1" for k in range(1, 1001))}"/>')
    ends = [float(x) for x, _ in re.findall(r"[Ml](-?[\d.]+) ?(-?[\d.]+)", long)]
    assert sum(ends) == pytest.approx(33.3, abs=0.006)


def test_the_command_writes_what_is_asked_for_or_nothing(run, tmp_path, monkeypatch):
    module = ModuleType("toy.figures", "Toy.")
    vars(module).update(VERSION=1, cells=None, measure=None, draw=draw, tables=lambda rows: {})
    monkeypatch.setitem(sys.modules, "toy.figures", module)
    rows = ROWS[["error"]].to_dict("records")
    store.Store(tmp_path).append(store.make_record("toy.figures", 1, 0, {"h": 0.1}, rows=rows))
    here, stored = tmp_path / "f.pdf", ["--results", tmp_path]
    words = ["figure", "toy.figures_curve", *stored, "--output", here]
    assert run(*words, "--format", "pdf")[:2] == (0, f"{here}\n")
    before = here.read_bytes()
    assert run("figure", "--all", "--format", "svg", *stored, "--output", tmp_path / "all")[0] == 0
    names = {path.name for path in (tmp_path / "all").iterdir()}
    assert names == {f"toy.figures_curve-{width}.svg" for width in style.WIDTHS}
    assert run(*words, "--format", "svg")[0] == 2
    assert "did you mean 'toy.figures_curve'" in run("figure", "toy.figures_curv", *stored)[2]
    assert here.read_bytes() == before
