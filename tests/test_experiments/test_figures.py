"""Figures as files: the same bytes every time, in three formats and two widths; small as SVG, and the same picture."""

import io
import re
import sys
from itertools import pairwise
from types import ModuleType

import matplotlib
import matplotlib.image
import numpy as np
import pytest
from matplotlib.text import Text

from lagrange_bench.__main__ import main
from lagrange_bench.experiments.drawing import figures, style
from lagrange_bench.report import export, page
from lagrange_bench.results import store

pytestmark = pytest.mark.xdist_group("figures")  # they are drawn once


def draw(rows):
    """Panels side by side, some taken out; small multiples; one panel as wide as a column."""
    fig, axes = style.figure("page", 4.0, nrows=2, ncols=2, sharex=True, sharey=True, squeeze=False)
    for i, ax in enumerate(list(axes.flat)[:3]):
        ax.loglog(rows.h, rows.error * 10**i, **style.of("backlund"))
        ax.set_title(f"panel {i}")
    axes[1, 1].remove()
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    axes[1, 0].set_xlabel("step")

    def line(ax, method, look):
        ax.loglog(rows.h, rows.error, **look)

    families, panels = style.by_family(["backlund", "rk4", "strang"], line, "step", "error", (1e-16, 1))
    style.label_ends(panels)
    single, ax = style.figure("column")
    ax.scatter(rows.h, rows.error)
    style.failure_marks(ax, [0.1])
    return {"panels": fig, "families": families, "single": single}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    for i, h in enumerate((0.01, 0.1, 1.0)):
        rows = [{"error": 1e-12 * 3.0**i}]
        done = {"status": "done", "rows": rows, "error": None, "warnings": [], "seconds": 0.1}
        store.Store(folder).append(store.make_record("toy.figures", 1, i, {"h": h}, **done))
    module = ModuleType("toy.figures", "Toy.")
    module.VERSION, module.cells, module.measure = 1, None, None
    module.draw, module.tables = draw, lambda rows: {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "toy.figures", module)
        yield folder


@pytest.fixture(scope="module")
def written(results, tmp_path_factory):
    return export.export_all(results, tmp_path_factory.mktemp("a"))[0]


def test_every_figure_in_three_formats_and_two_widths_the_same_bytes_twice(results, written, tmp_path, monkeypatch):
    assert len(written) == 3 * 3 * 2
    monkeypatch.setitem(matplotlib.rcParams, "lines.linewidth", 7.0)  # the reader's own taste
    again = export.export_all(results, tmp_path, widths=("column",))[0]
    before = {path.name: path.read_bytes() for path in written}
    assert len(again) == 3 * 3
    assert [path.name for path in again if path.read_bytes() != before[path.name]] == []


def test_widths_are_those_asked_for(written):
    for path in written:
        inches = style.WIDTHS["column" if "-column" in path.name else "page"]
        if path.suffix == ".svg":
            found = float(re.search(r'viewBox="0 0 ([\d.]+)', path.read_text())[1]) / 72
        elif path.suffix == ".pdf":
            found = float(re.search(rb"/MediaBox \[ *0 0 ([\d.]+)", path.read_bytes())[1]) / 72
        else:
            found = matplotlib.image.imread(path).shape[1] / figures.DPI["column" if "-column" in path.name else "page"]
        assert abs(found - inches) < 0.01, path.name


def test_a_pdf_has_its_fonts_and_no_date(written):
    for path in written:
        if path.suffix == ".pdf":
            content = path.read_bytes()
            assert b"/FontFile2" in content, "TrueType, embedded"
            assert b"/Type3" not in content
            assert b"CreationDate" not in content


def test_in_a_column_panels_are_on_top_of_each_other_and_keep_their_labels(results):
    with style.apply("column"):
        drawn = draw(store.Store(results).rows("toy.figures"))
    fig = drawn["panels"]
    tall = fig.get_figheight()
    style.finish(fig)
    fig.draw_without_rendering()
    boxes = [ax.get_position() for ax in fig.axes]
    assert len(boxes) == 3
    assert all(above.y0 > below.y1 for above, below in pairwise(boxes))
    assert all(box.width > 0.6 for box in boxes)
    assert [ax.get_ylabel() for ax in fig.axes] == ["error"] * 3
    assert [ax.get_xlabel() for ax in fig.axes] == ["", "", "step"]
    assert fig.get_figheight() == pytest.approx(0.75 * tall), "no gap where the fourth was"
    style.finish(fig)
    assert fig.get_figheight() == pytest.approx(0.75 * tall), "once is enough"


def test_compact_svg_is_the_same_picture(results):
    document = figures.svg(draw(store.Store(results).rows("toy.figures"))["panels"])
    assert "<!--" not in document
    assert not re.search(r"\.\d{4,}", re.sub('style="[^"]*"', "", document))
    used = set(re.findall(r'href="#([^"]+)"', document)) | set(re.findall(r"url\(#([^)]+)\)", document))
    assert used == set(re.findall(r'\bid="([^"]+)"', document))


@pytest.mark.parametrize(
    ("path", "short"),
    [
        ("M 1.23456 2 \nL 3.005 4.5 \nL 3.005 4.5 \nz \n", "M1.23 2l1.77 2.5z"),
        ("M 0 0 L -0.25 10.001 M 5 5 L 5 5", "M0 0l-.25 10M5 5l0 0"),
        ("M 0 -2.5 C 0.663008 -2.5 1.29895 -2.23 1.7 -1.7 z", "M 0 -2.5 C .66 -2.5 1.3 -2.23 1.7 -1.7 z"),
    ],
)
def test_paths(path, short):
    assert figures.compact(f'<path d="{path}"/>') == f'<path d="{short}"/>'


def test_rounding_does_not_add_up():
    steps = np.cumsum(np.full(1000, 0.0333))
    text = figures.compact(f'<path d="M 0 0 {" ".join(f"L {x:.6f} 1" for x in steps)}"/>')
    ends = [float(x) for x, _ in re.findall(r"[Ml](-?[\d.]+) ?(-?[\d.]+)", text)]
    assert sum(ends) == pytest.approx(steps[-1], abs=0.006)


def test_words_can_be_searched_and_lines_say_whose_they_are(results):
    fig, ax = style.figure("column")
    ax.plot([1, 2], [1, 2], **style.thin("rk4"))
    ax.plot([1, 2], [2, 1], **style.of("strang"))
    ax.plot([1, 2], [2, 2], label="_guide")
    ax.set_xlabel("step <h> in $units")
    document = figures.svg(fig)
    assert ">step &lt;h&gt; in $units</text>" in document
    titles = re.findall("<g><title>([^<]*)</title>", document)
    assert titles == [style.label("rk4"), style.label("strang")]
    assert f"<title>{titles[0]}</title>" in figures.inline(document, "f", "label")


def test_one_figure_by_name(results, tmp_path):
    path, *_ = export.export("toy.figures_single", results, tmp_path / "here.pdf", "pdf", "column")
    assert path.read_bytes().startswith(b"%PDF")
    for name, said in (("toy.figures_singel", "did you mean 'toy.figures_single'"), ("nonsense", "toy.figures_panels")):
        with pytest.raises(ValueError, match=re.escape(said)):
            export.export(name, results)
    with pytest.raises(ValueError, match="format must be"):
        export.export("toy.figures_single", results, tmp_path / "x", "gif")
    with pytest.raises(ValueError, match="width must be"):
        export.export("toy.figures_single", results, tmp_path / "x", "svg", "wall")
    with pytest.raises(ValueError, match="nothing is stored"):
        export.export("toy.figures_single", tmp_path / "empty")
    assert list(tmp_path.iterdir()) == [path]


def test_a_png_shows_something(written):
    for path in written:
        if path.suffix == ".png":
            pixels = matplotlib.image.imread(io.BytesIO(path.read_bytes()))
            assert pixels[..., :3].std() > 0.02


def test_the_page_names_the_command_that_draws_a_figure(results):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "EXPERIMENTS", ("toy.figures",))
        text = page.html(page.assemble(results))
    assert "<span>lagrange-bench</span> <span>figure</span> <span>toy.figures_panels</span>" in text


def test_command_line(results, tmp_path, capsys):
    here = tmp_path / "f.pdf"
    words = ["toy.figures_single", "--format", "pdf", "--results", str(results), "--output", str(here)]
    assert main(["figure", *words]) == 0
    assert capsys.readouterr().out == f"{here}\n"
    assert (
        main(
            [
                "figure",
                "--all",
                "--format",
                "svg",
                "--width",
                "page",
                "--results",
                str(results),
                "--output",
                str(tmp_path),
            ]
        )
        == 0
    )
    assert len(list(tmp_path.glob("*-page.svg"))) == 3
    capsys.readouterr()
    before = here.read_bytes()
    two = [*words[:1], "--format", "svg", *words[3:]]
    for wrong in ([], ["toy.figures_single", "--all"], ["toy.figures_nothing", "--results", str(results)], two):
        assert main(["figure", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert here.read_bytes() == before


NAMES = [r"$\frac{$", "$x$", "a$b", "bell \a, escape \x1b[31m, null \0", "\ud800"]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_no_formulas(name):
    """Of methods, as a legend, an axis or a corner of a panel has them, and of whatever else is in a row."""
    fig, ax = style.figure("column")
    look = style.of(name)
    ax.plot([1, 2], [1, 2], **look)
    ax.set_yticks([1, 2], [style.plain(name), "b"])
    style.failed_label(ax, name)
    style.label_ends([ax])
    ax.set_title(name)  # of a row, by somebody who does not know of `plain`
    ax.plot([1, 2], [2, 1], label=f"{name}, too")
    ax.set_ylabel("$x_1$")
    style.legend_below(fig)
    assert figures.svg(fig)
    readable = "".join(c for c in name if c.isprintable())
    assert style.label(name) == readable
    parsed = [text._preprocess_math(text.get_text()) for text in fig.findobj(Text)]
    shown = [text for text, formula in parsed if not formula]
    assert sum(readable in text for text in shown) >= 4
    formulas = {text for text, formula in parsed if formula and "mathdefault" not in text}
    assert formulas == ({"$x$", "$x$, too", "$x_1$"} if name == "$x$" else {"$x_1$"})
    assert figures.pdf(fig)
    assert figures.png(fig)
