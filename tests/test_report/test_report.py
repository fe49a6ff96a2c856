"""The report shows what is stored, all of it, offline, the same bytes every time; and says what it cannot show."""

import base64
import gzip
import io
import os
import re
import shutil
import stat
import sys
from dataclasses import replace
from datetime import UTC, date, datetime
from html import unescape
from html.parser import HTMLParser
from importlib.metadata import EntryPoint
from types import ModuleType

import matplotlib
import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS
from lagrange_bench.report import lists, page, promises, sections
from lagrange_bench.report.claims import Bound, Claim, ShortAnswer
from lagrange_bench.results import sources, store
from lagrange_bench.results.choice import Choice
from lagrange_bench.support.files import write_file
from lagrange_bench.support.source_digest import SourceDigest

NASTY = "50 % of a_b & <script>alert(1)</script> | α"
TOYS = ("toy.good", "toy.broken", "toy.empty")
TOY_METHODS, STEPS = ("backlund", "rk45", "somebody_elses"), (0.01, 0.1, 1.0)
DRIFT = [1e-12 * h**i for i in range(3) for h in STEPS]


def toy(name):
    module = ModuleType(name, f"Toy {name}: does it show?\n\nAbout {name}.")
    module.VERSION, module.draw, module.tables = 1, draw_good if name == "toy.good" else draw_broken, make_tables
    module.cells = lambda profile: [{"method": m, "h": h} for m in TOY_METHODS for h in (*STEPS, 2.0, 3.0, 4.0)]
    module.measure = lambda *_: pytest.fail("the report must not measure")
    return module


def draw_good(rows):
    drawn = {}
    for name in ("first", "second"):
        drawn[name], ax = style.figure("column")
        ax.loglog(rows.h, rows.drift, **style.of("backlund"))
        ax.fill_between([1e-2, 1], 1e-9, 1e-8, hatch="/", clip_on=True)  # has ids
        drawn[name].caption = f"The {name} caption, {NASTY}"
    return drawn


def draw_broken(rows):
    raise ZeroDivisionError("<b>no luck</b>")


def make_tables(rows):
    drift = rows[rows.status == "done"][["method", "h", "drift"]].rename(columns={"drift": "max_drift & more"})
    return {"all": drift, "median": rows.groupby("method")[["drift"]].median().assign(note=NASTY)}


def put(folder, experiment, index, method, h, *drift, **fields):
    """Stores a cell with these rows, or one that was declined if there are none."""
    failed = {"error": {"type": "StepError", "message": "Newton gave up <here>", "traceback": "…"}}
    outcome = {"rows": [{"drift": x} for x in drift]} if drift else failed
    record = store.make_record(experiment, 1, index, {"method": method, "h": h}, **outcome)
    store.Store(folder).append({**record, **fields})


def claim(name, text, limit, column="drift", experiment="toy.good", year=2026, **where):
    bounds, answers = (Bound((column,), "≤", limit, where=where),), (ShortAnswer(f"{text} In short?", "{claim.worst}"),)
    first, last = date(2026, 11, 24), datetime(year, 11, 24, tzinfo=UTC)
    return Claim(name, "cost", text, experiment, first, last, bounds, answers)


CLAIMS = [
    claim("holds", "Drift stays small.", 1e-3, method="backlund"),
    claim("refuted", "Drift stays tiny.", 1e-30, year=2999, method="backlund"),
    claim("failed", "A method that declines is fine.", 1e9, method="rk45"),
    claim("absent", "Nobody measured this.", 1.0, "colour", method="backlund"),
    claim("unstored", "Nothing is stored.", 1.0, experiment="toy.empty"),
]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of three toys: one in order (with a declined cell), one that cannot be drawn, one empty."""
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        for name in TOYS:
            patch.setitem(sys.modules, name, toy(name))
        for module in (page, store):
            patch.setattr(module, "EXPERIMENTS", TOYS)
        patch.setattr(promises, "CLAIMS", CLAIMS)
        known = sources.CellSources(SourceDigest("1" * 24, ()), None)
        patch.setattr(sources, "of_cell", lambda *cell: known)  # toys have no file
        for name in TOYS[:2]:
            for i, drift in enumerate(DRIFT):
                method, h = TOY_METHODS[i // 3], STEPS[i % 3]
                put(folder, name, i, method, h, *([] if (method, h) == ("rk45", 1.0) else [drift]))
        yield folder


@pytest.fixture(scope="module")
def report(results):
    return page.assemble(results)


@pytest.fixture(scope="module")
def output(report, tmp_path_factory):
    return page.write(report, tmp_path_factory.mktemp("page")).parent


@pytest.fixture(scope="module")
def text(output):
    return (output / "index.html").read_text(encoding="utf-8")


@pytest.fixture
def undrawn(monkeypatch):
    monkeypatch.setattr(sections, "draw_figures", lambda *_: [])


def markup(text):
    """The page without what is between its script tags: there `url(` and `href="#` are text of a program."""
    return re.sub(r"(<script[^>]*>).*?(</script>)", r"\1\2", text, flags=re.DOTALL)


def words(report):
    return " ".join(unescape(re.sub("<[^>]*>", "", markup(page.html(report)))).split())


class Elements(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.attributes, self.tags = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs


def test_page_is_one_offline_file_with_every_figure_and_table(text, output, results):
    found = Elements(text)
    assert str(results.parent) not in text, "not where it is on this machine"
    assert found.tags.count("svg") == 2, "the picture of the exact step and a figure: the other is packed"
    for name, value in found.attributes:
        if name in ("src", "href", "xlink:href", "action", "poster", "srcset"):
            beside = re.fullmatch(r"(figures|tables)/[\w.-]+", value) and (output / value).is_file()
            assert value.startswith("#") or beside, (name, value)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert ("default-src 'none'" in policy, "connect-src" in policy) == (True, False), "a browser asks for nothing"


def test_ids_are_unique_and_text_from_results_is_escaped(text):
    ids = [value for name, value in Elements(text).attributes if name == "id"]
    assert len(ids) == len(set(ids))
    targets = set(re.findall(r'(?:href="#|url\(#)([^")]+)', markup(text)))
    assert targets <= set(ids)
    assert any(target.startswith("toy.good_first-") for target in targets), "the figures use no ids: a vacuous test"
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert Elements(text).tags.count("script") == 1 + 2 + 1, "the page's own, rows of two, a figure"


def test_rows_are_in_the_page_and_tables_beside_it(report, text, output):
    for section in report.sections:
        found = re.search(rf'id="rows-{section.experiment}">([^<]*)<', text)
        assert bool(found) == bool(len(section.rows))
        if found:
            rows = pd.read_csv(io.BytesIO(gzip.decompress(base64.b64decode(found[1]))))
            assert rows.drift.dropna().tolist() == section.rows.drift.dropna().tolist()
            assert rows.status.tolist() == section.rows.status.tolist()
    whole = pd.read_csv(output / "tables" / "toy.good_all.csv")
    assert whole["max_drift & more"].tolist() == [*DRIFT[:5], *DRIFT[6:]]
    assert pd.read_csv(output / "tables" / "toy.good_median.csv").note[0] == NASTY
    lines = (output / "tables" / "toy.good_median.md").read_text(encoding="utf-8").splitlines()
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {4}


def test_same_rows_same_bytes(results, output, tmp_path, monkeypatch):
    moved = shutil.copytree(results, tmp_path / "elsewhere" / results.name)
    monkeypatch.setitem(matplotlib.rcParams, "lines.linewidth", 7.0)  # the reader's own taste
    again = page.write(page.assemble(moved), tmp_path / "page").parent
    first, second = ({p.relative_to(at): p.read_bytes() for p in at.rglob("*.*")} for at in (output, again))
    assert len(first) == 1 + 2 + 12
    assert first == second


def test_what_is_missing_is_said_in_its_place(report, text):
    parts = {part.split('"')[0]: part for part in re.split('<(?:details|div) id="', text)[1:]}
    assert "ZeroDivisionError: &lt;b&gt;no luck&lt;/b&gt;" in parts["toy.broken"]
    assert "toy.broken_median" in parts["toy.broken"], "the tables do not need the figures"
    assert "toy.empty" not in parts, "what has no rows is named in one place"
    assert "run</span> <span>toy.empty</span>" in parts["missing"]
    held, changed = (parts["claims"].split(f"claim-{name}")[1].split("</li>")[0] for name in ("holds", "refuted"))
    assert "bounds set on 2026-11-24, before these rows were measured" in held
    assert "bounds set on 2026-11-24, last changed on 2999-11-24, with these rows known" in changed
    pages = text, page.html(replace(report, claims=report.claims[3:]))  # with answers, and without
    assert ["<h2>In short</h2>" in each for each in pages] == [True, False]
    assert "Newton gave up &lt;here&gt;" in parts["failures"]
    assert np.__version__ in parts["environment"]
    assert report.errors == ["toy.broken: figures cannot be drawn: ZeroDivisionError: <b>no luck</b>"]


def test_no_results_and_a_broken_plug_in_stop_neither_page_nor_run(tmp_path, monkeypatch):
    broken = EntryPoint("broken", "no_such_module:METHOD", METHODS.group)
    monkeypatch.setattr(METHODS, "_entries", {**METHODS._entries, "broken": broken})
    assert len(lists.methods()) == len(METHODS) - 1
    assert "broken" not in {cell.get("method") for cell in load("drift").cells("quick")}
    empty = page.assemble(tmp_path)
    assert empty.errors == []
    assert page.html(empty).count("nothing of this experiment is stored") == len(page.EXPERIMENTS)
    assert {judged.verdict.word for judged in empty.claims} == {"not tested"}


def test_the_page_of_an_experiment_of_ones_own_shows_nothing_else(results, monkeypatch, undrawn):
    for module in (page, store):
        monkeypatch.setattr(module, "EXPERIMENTS", ("drift", "phase"))
    monkeypatch.setattr(page.errata, "measure", lambda: pytest.fail("evaluated for nothing"))
    ids = re.findall('<(?:section|details) id="([^"]+)"', markup(page.html(page.assemble(results))))
    assert " ".join(ids) == "answer figures evidence toy.broken toy.good reference units failures environment"


def test_a_page_of_some_methods(results, undrawn):
    some = page.assemble(results, choice=Choice(methods=("rk45",)))
    assert {method for section in some.sections for method in section.rows.method} == {"rk45"}
    assert [section.experiment for section in some.sections] == ["toy.good", "toy.broken"]
    assert some.claims == [], "they are about all methods"
    assert " --methods rk45" in some.sections[0].redraw("first")


def test_a_page_of_somebody_elses_stays(results, tmp_path, run):
    (tmp_path / "index.html").write_text("<!doctype html><title>My home page</title>")
    code, out, err = run("report", "--results", results, "--output", tmp_path)
    assert (code, out, "is not a page of lagrange-bench" in err) == (2, "", True)
    assert "My home page" in (tmp_path / "index.html").read_text()


def test_a_file_is_written_to_the_disk_before_it_replaces_the_old_one_with_its_permissions(tmp_path, monkeypatch):
    old, done, replace_old = tmp_path / "old.txt", [], os.replace
    old.write_text("old")
    old.chmod(0o600)
    with monkeypatch.context() as watched:
        watched.setattr(os, "fsync", lambda file: done.append("on disk"))
        watched.setattr(os, "replace", lambda new, place: (done.append(new.name), replace_old(new, place)))
        for _ in range(2):
            assert stat.S_IMODE(write_file(old, "newer").stat().st_mode) == 0o600
    assert done[0] == done[2] == "on disk"
    assert done[1] != done[3], "two writers do not share a file"
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write to any file
    with pytest.raises(OSError, match="cannot be written: the file is read-only"):
        write_file(old, "newest")
    assert old.read_text() == "newer"


def test_command_line(results, tmp_path, run, undrawn, monkeypatch):
    (tmp_path / "none").mkdir()
    code, _, err = run("report", "--results", tmp_path / "none", "--output", tmp_path / "page")
    assert (code, "nothing is stored in" in err, (tmp_path / "page").exists()) == (2, True, False)
    words, opened = ("report", "--results", results, "--output"), []
    page_of = (tmp_path / "out" / "index.html").resolve()
    monkeypatch.setattr("webbrowser.open", opened.append)
    code, out, err = run(*words, tmp_path / "out", "--open")
    assert (code, out, f"drawn from {results}" in err.splitlines()) == (0, f"{page_of}\n", True)
    assert opened == [page_of.as_uri()]
    monkeypatch.setattr(sections, "draw_figures", lambda *_: draw_broken(None))
    code, _, err = run(*words, tmp_path / "out")
    assert (code, "not drawn: toy.broken" in err) == (1, True)
    assert run(*words, tmp_path / "out" / "index.html")[0] == 2


def test_old_rows_and_damaged_lines_are_named(results, undrawn, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = shutil.copytree(results, tmp_path / "out") / "toy.good.jsonl"
    for i in (1, 2):
        put("out", "toy.good", i, "backlund", STEPS[i], DRIFT[i], sources="0" * 24)
    path.write_bytes(path.read_bytes().replace(b'"message":"Newton', b'"message":"Euler'))
    damaged = "toy.good.jsonl, line 6: damaged; skipped, its cell counts as not computed"
    old = "stored cells computed with other source code than this"
    figure = ("figure", "toy.good_first", "--results", "out")
    code, _, err = run(*figure)
    end = f"{damaged}\ntoy.good: 2 of 8 {old}: the same run with --again computes them again\n"
    assert (code, err.endswith(end)) == (0, True), err
    assert run(*figure, "--quiet")[2] == ""
    shown = words(page.assemble(tmp_path / "out"))
    assert damaged in shown
    assert f"2 of 17 {old}: toy.good (lagrange-bench verify" in shown
    path.write_bytes(b"{}\n")
    path.with_name("toy.broken.jsonl").unlink()
    assert "cannot be drawn from out: toy.good.jsonl, line 1: damaged" in run(*figure)[2]
