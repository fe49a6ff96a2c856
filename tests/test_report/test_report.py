"""The report shows what is stored, all of it, offline, the same bytes every time; and says what it cannot show."""

from __future__ import annotations

import base64
import gzip
import io
import re
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from importlib.metadata import EntryPoint
from types import ModuleType

import matplotlib
import numpy as np
import pandas as pd
import pytest

from lagrange_bench.__main__ import main
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import style
from lagrange_bench.experiments.measuring.states import methods_on
from lagrange_bench.integrators import METHODS
from lagrange_bench.report import fairness, lists, origin, page, promises, sections, summary
from lagrange_bench.report.claims import Bound, Claim
from lagrange_bench.results import sources, store
from lagrange_bench.results.choice import Choice

NASTY = "50 % of a_b & <script>alert(1)</script> | α"


def toy_cells(profile):
    steps = (0.01, 0.1, 1.0, 2.0, 3.0, 4.0)
    return [{"method": method, "h": h} for method in ("backlund", "rk45", "somebody_elses") for h in steps]


def toy(name: str, draw, make_tables) -> ModuleType:
    module = ModuleType(name, f"Toy {name}: does it show?\n\nAbout {name}.")

    def forbidden(*_):
        raise AssertionError("the report must not measure")

    module.VERSION, module.cells, module.measure = 1, toy_cells, forbidden
    module.draw, module.tables = draw, make_tables
    return module


def draw_good(rows):
    drawn = {}
    for name in ("first", "second"):
        fig, ax = style.figure("column")
        for method in style.ordered(rows.method):
            chosen = rows[rows.method == method]
            ax.loglog(chosen.h, chosen.drift, **style.of(method))
            style.failure_marks(ax, chosen[chosen.status == "failed"].h, method)
        ax.fill_between([1e-2, 1], 1e-9, 1e-8, hatch="/", clip_on=True)
        style.legend_below(fig)
        fig.caption = f"The {name} caption, {NASTY}"
        drawn[name] = fig
    return drawn


def make_tables(rows):
    drift = rows[rows.status == "done"][["method", "h", "drift"]].rename(columns={"drift": "max_drift & more"})
    return {"all": drift, "median": rows.groupby("method")[["drift"]].median().assign(note=NASTY)}


def draw_broken(rows):
    raise ZeroDivisionError("<b>no luck</b>")


def outcome(rows=(), message=None):
    error = message and {"type": "StepError", "message": message, "traceback": "Traceback …"}
    status = "failed" if message else "done"
    return {"status": status, "rows": list(rows), "error": error, "warnings": [], "seconds": 0.5}


def claim(name, text, limit, column="drift", experiment="toy.good", **where):
    return Claim(name, "cost", text, experiment, (Bound((column,), "≤", limit, where=where),))


CLAIMS = [
    claim("holds", "Drift stays small.", 1e-3, method="backlund"),
    claim("refuted", "Drift stays tiny.", 1e-30, method="backlund"),
    claim("failed", "A method that declines is fine.", 1e9, method="rk45"),
    claim("absent", "Nobody measured this.", 1.0, "colour", method="backlund"),
    claim("unstored", "Nothing is stored.", 1.0, experiment="toy.empty"),
]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of three toys: one in order (with a failed cell and a torn line), one that cannot be drawn, one empty."""
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        for name, draw in (("toy.good", draw_good), ("toy.broken", draw_broken), ("toy.empty", draw_broken)):
            patch.setitem(sys.modules, name, toy(name, draw, make_tables))
        patch.setattr(page, "EXPERIMENTS", ("toy.good", "toy.broken", "toy.empty"))
        patch.setattr(promises, "CLAIMS", CLAIMS)
        patch.setattr(sources, "of_cell", lambda *cell: "1" * 24)  # toys have no file
        journals = store.Store(folder)
        for name in ("toy.good", "toy.broken"):
            for i, method in enumerate(("backlund", "rk45", "somebody_elses")):
                for j, h in enumerate((0.01, 0.1, 1.0)):
                    bad = "Newton gave up <here>" if (method, h) == ("rk45", 1.0) else None
                    done = outcome([{"drift": 1e-12 * h**i}], bad)
                    journals.append(store.make_record(name, 1, 3 * i + j, {"method": method, "h": h}, **done))
        with (folder / "toy.good.jsonl").open("ab") as file:
            file.write(b'{"torn')
        yield folder


@pytest.fixture(scope="module")
def report(results):
    return page.assemble(results)


@pytest.fixture
def text(report, tmp_path):
    """The page; it is in tmp_path/out."""
    return page.write(report, tmp_path / "out").read_text(encoding="utf-8")


def markup(text):
    """The page without what is between its script tags: there `url(` and `href="#` are text of a program."""
    return re.sub(r"(<script[^>]*>).*?(</script>)", r"\1\2", text, flags=re.DOTALL)


class Elements(HTMLParser):
    """Every element's attributes, and the text outside style and script."""

    def __init__(self, text):
        super().__init__()
        self.attributes, self.tags, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data):
        self.words.append(data)


def test_page_is_one_offline_file_with_every_figure_and_table(text, tmp_path):
    found = Elements(text)
    assert found.tags.count("svg") == 2
    assert sorted(p.name for p in (tmp_path / "out" / "figures").iterdir()) == [
        "toy.good_first.svg",
        "toy.good_second.svg",
    ]
    assert {p.suffix for p in (tmp_path / "out" / "tables").iterdir()} == {".md", ".tex", ".csv"}
    for name, value in found.attributes:
        if name in ("src", "href", "xlink:href", "action", "poster", "srcset"):
            beside = re.fullmatch(r"(figures|tables)/[\w.-]+", value)
            assert value.startswith("#") or (beside and (tmp_path / "out" / value).is_file()), (name, value)
    assert not {"link", "iframe", "object", "embed", "img"} & set(found.tags)
    assert not re.search(r"@import|url\((?!#)", markup(text))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert "default-src 'none'" in policy, "what a script might ask for, a browser would not let it have"
    assert "connect-src" not in policy
    assert set(re.findall(r"https?://[^\s\"'<]*", markup(text))) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }


def test_ids_are_unique_and_every_reference_has_its_target(text):
    ids = [value for name, value in Elements(text).attributes if name == "id"]
    assert len(ids) == len(set(ids))
    plain = markup(text)
    targets = set(re.findall(r'href="#([^"]+)"', plain)) | set(re.findall(r"url\(#([^)]+)\)", plain))
    assert targets <= set(ids)
    assert any(target.startswith("toy.good_second-") for target in targets), "the figures use no ids: a vacuous test"


def test_the_rows_are_in_the_page(report, text):
    for section in report.sections:
        found = re.search(rf'id="rows-{section.experiment}">([^<]*)<', text)
        assert bool(found) == bool(len(section.rows))
        if found:
            rows = pd.read_csv(io.BytesIO(gzip.decompress(base64.b64decode(found[1]))))
            assert len(rows) == len(section.rows)
            assert rows.drift.dropna().tolist() == section.rows.drift.dropna().tolist()
            assert rows.status.tolist() == section.rows.status.tolist()


def test_the_summary_leaves_out_what_is_missing(report, text):
    assert [sentence.found for sentence in report.summary] == [False] * 3
    assert "nothing of phase is stored" not in text


def test_the_summary_is_written_from_rows():
    phase = [("backlund", 1.0, 3.91e-15), ("backlund", 8.0, 2e-15), ("taylor_fixed", 1.0, 5.5e-11), ("rk4", 1.0, 0.1)]
    rows = {
        "phase": pd.DataFrame(phase, columns=["method", "h", "error"]).assign(part="h", state="generic", status="done"),
        "cost": pd.DataFrame({"part": ["step"]}),
    }
    accuracy, cost, drift = summary.sentences(rows)
    assert accuracy.found
    for words in (
        "from 1 to 8",
        "within 4×10⁻¹⁵",  # rounded up
        "“Taylor 20, fixed step”, has an error of 5.5×10⁻¹¹",
        "1 of the 2 have errors above",
    ):
        assert words in accuracy.text
    assert not cost.found
    assert not drift.found
    refuted = rows["phase"].assign(status="failed", failure="StepError: no", error=np.nan)
    assert "failed" in summary.sentences({"phase": refuted})[0].text


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ({10.0: 3.5, 100.0: 2.0, 1e4: 0.1}, "takes up to 3.5 times (to t = 10) and up to 2 times (to t = 100) as long"),
        ({10.0: 1.002, 100.0: 0.5}, "more than 10 % cheaper"),  # as long to three digits: no loss
        (
            {10.0: 0.1, 100.0: 3.5},
            "takes up to 3.5 times (to t = 100) as long",
        ),  # not only the shortest run is looked at
    ],
)
def test_a_loss_is_a_difference_beyond_the_noise_of_timing(seconds, words):
    runs = [(span, name, time) for span, ours in seconds.items() for name, time in (("backlund", ours), ("rk4", 1.0))]
    rows = pd.DataFrame(runs, columns=["span", "method", "seconds"])
    rows = rows.assign(setup_seconds=0.0, state="generic", status="done", error=1e-13)
    said = summary._where_it_loses(rows)
    assert words in said
    assert ("loses" in said) == (max(seconds.values()) > 1.1)
    assert summary._where_it_loses(rows[rows.method == "rk4"]) == ""  # nothing to compare


def test_same_rows_same_bytes(results, tmp_path, monkeypatch):
    first = page.build(results, tmp_path / "a").parent
    moved = shutil.copytree(results, tmp_path / "elsewhere" / results.name)
    monkeypatch.setitem(matplotlib.rcParams, "lines.linewidth", 7.0)  # the reader's own taste
    second = page.build(moved, tmp_path / "b").parent
    files = sorted(p.relative_to(first) for p in first.rglob("*") if p.is_file())
    assert len(files) == 1 + 2 + 12
    assert files == sorted(p.relative_to(second) for p in second.rglob("*") if p.is_file())
    for file in files:
        assert (first / file).read_bytes() == (second / file).read_bytes(), file


def test_the_page_says_what_it_was_drawn_from_and_how_to_draw_that_again(results, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(results, tmp_path / "mine" / "quick")
    report = page.assemble(tmp_path / "mine" / "quick")
    told = markup(page.html(report))
    words = unescape(re.sub("<[^>]*>", "", told))
    assert "Drawn from mine/quick; quick profile; 20" in words
    assert "redraw: lagrange-bench figure toy.good_first --results mine/quick " in words
    assert "recompute: lagrange-bench run toy.good --profile quick --results mine/quick" in words
    assert "check: lagrange-bench run toy.good --profile quick --results mine/quick && lagrange-bench report" in words
    assert str(tmp_path) not in told
    assert page.assemble(results).origin.startswith(f"{results.name}; "), "not where it is on this machine"


def test_the_page_says_which_rows_are_old(results, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = shutil.copytree(results, tmp_path / "mine" / "quick")
    assert not any(section.old for section in page.assemble(folder).sections)
    assert "other source code" not in page.html(page.assemble(folder))
    for i, digest in enumerate(("0" * 24, "0" * 24, None)):
        record = store.make_record(
            "toy.good", 1, 9 + i, {"method": "backlund", "h": 2.0 + i}, **outcome([{"drift": 1e-9}])
        )
        store.Store(folder).append({**record, "sources": digest})
    report = page.assemble(folder)
    old = "2 stored cells were computed with other source code than this; "
    old += "1 stored cell was computed with source code that was not recorded"
    assert [section.old for section in report.sections] == [old, "", ""]
    compare = "lagrange-bench verify mine/quick computes a sample again and compares"
    assert report.origin.endswith(f"; {old} ({compare})")
    words = unescape(re.sub("<[^>]*>", "", markup(page.html(report))))
    assert (
        f"{old}. Compute them again: lagrange-bench run toy.good --profile quick --results mine/quick --again" in words
    )


def test_machines_and_commits_are_named_if_they_are_few():
    source = pd.DataFrame(
        {"utc": "2026-11-21T00:00:00", "cpu": "EPYC", "commit": list("abc"), "dirty": [False, True, None]}
    )
    assert origin.told(origin.Origin("r"), [source]) == "r; 2026-11-21; EPYC; 3 commits"
    assert origin.told(origin.PUBLISHED, [source[:2]]).endswith(
        "; full profile; 2026-11-21; EPYC; commit a, b with changes"
    )
    assert origin.told(origin.Origin("r"), []) == "r"


def record(cell):
    return {"cell": store.clean(cell)}


def test_the_profile_is_known_by_the_cells():
    module = ModuleType("study")
    module.cells = lambda profile: [{"h": h} for h in ((0.1, 1.0) if profile == "quick" else (0.01, 0.1))]
    for stored, known in (((0.1,), ("quick", "full")), ((1.0,), ("quick",)), ((0.01, 0.1), ("full",)), ((7.0,), ())):
        assert origin.profiles_of(module, [record({"h": h}) for h in stored]) == known
    del module.cells
    assert origin.profiles_of(module, []) is None


@pytest.mark.parametrize(
    ("folder", "profiles", "profile"),
    [
        ("out", [("quick", "full"), ("full",), None], "full"),
        ("out", [("quick", "full")], "quick"),  # the same cells
        ("full", [("quick", "full")], "full"),
        ("full", [("quick",)], "quick"),
        ("quick", [None], "quick"),
        ("out", [None], None),
        ("out", [("quick",), ("full",)], None),
    ],
)
def test_the_profile_of_a_folder(tmp_path, monkeypatch, folder, profiles, profile):
    monkeypatch.chdir(tmp_path)
    assert origin.find(tmp_path / folder, profiles) == origin.Origin(folder, profile)


def test_commands_of_the_usual_folders_are_short():
    reference = origin.find(store.default_results(), [()])
    assert (reference.option, reference.run("phase")) == ("", "lagrange-bench run phase --profile full")
    assert reference.report == "lagrange-bench report --results results/local/full"
    quick = origin.find(store.default_results("quick"), [("quick",)])
    assert quick.run("phase") == "lagrange-bench run phase --profile quick"
    assert quick.report == "lagrange-bench report --results results/local/quick"
    sweep = origin.find(store.default_results("mine"), [None])
    assert sweep.run("sweep_mine") == "lagrange-bench run mine.toml"
    assert origin.Origin("my out").run("sweep_mine") == "lagrange-bench run mine.toml --results 'my out'"


@pytest.mark.slow
def test_drawn_in_two_processes_it_is_the_same(tmp_path):
    for name in ("ensemble", "paper"):
        shutil.copy(store.default_results() / f"{name}.jsonl", tmp_path)
    started = []

    def pool(*args, **more):
        started.append(args[0])
        return ProcessPoolExecutor(*args, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "EXPERIMENTS", ("ensemble", "paper", "no_such_experiment"))
        patch.setattr(sections, "ProcessPoolExecutor", pool)
        alone = page.assemble(tmp_path, processes=2)
        assert started == [], "two journals are drawn sooner than two processes start"
        patch.setattr(sections, "WORTH", 1)
        shared = page.assemble(tmp_path, processes=2)
        assert started == [2]
    assert page.html(shared) == page.html(alone)
    assert [len(section.figures) > 0 for section in shared.sections] == [True, True, False]
    assert any("no_such_experiment" in error for error in shared.errors)


def test_what_is_missing_is_said_in_its_place(report, text):
    sections = {part.split('"')[0]: part for part in text.split('<section id="')[1:]}
    assert "ZeroDivisionError: &lt;b&gt;no luck&lt;/b&gt;" in sections["toy.broken"]
    assert "toy.broken_median" in sections["toy.broken"], "the tables do not need the figures"
    assert "toy.empty" not in sections, "what has no rows is named in one place"
    assert "run</span> <span>toy.empty</span>" in sections["missing"]
    found, away = sections["claims"].split("about experiments that are not stored here")
    assert ("claim-holds" in found, "claim-unstored" in found, "claim-unstored" in away) == (True, False, True)
    assert "toy.good.jsonl, line 10: cut off while it was written" in sections["toy.good"]
    declined, failed = sections["failures"].split("No stored cell failed.")
    assert "Declined: toy.good <small>(1 cells)" in declined
    assert "Newton gave up &lt;here&gt;" in declined
    assert "numpy" in sections["environment"]
    assert np.__version__ in sections["environment"]
    assert report.errors == ["toy.broken: figures cannot be drawn: ZeroDivisionError: <b>no luck</b>"]


def test_text_from_results_is_escaped(text):
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert Elements(text).tags.count("script") == text.count("<script") == 1 + 2, "the page's own, rows of two"


def test_no_results_at_all(tmp_path):
    report = page.assemble(tmp_path)
    text = page.write(report, tmp_path / "out").read_text(encoding="utf-8")
    assert text.count("nothing of this experiment is stored") == len(page.EXPERIMENTS)
    assert {judged.verdict.word for judged in report.claims} == {"not tested"}


def test_a_plug_in_that_cannot_be_loaded_stops_neither_page_nor_run(monkeypatch, tmp_path):
    broken = EntryPoint("broken", "no_such_module:METHOD", METHODS.group)
    monkeypatch.setattr(METHODS, "_entries", {**METHODS._entries, "broken": broken})
    with pytest.raises(ImportError):
        METHODS["broken"]
    assert len(lists.methods()) == len(METHODS) - 1
    assert "broken" not in {cell.get("method") for cell in load("drift").cells("quick")}
    assert page.assemble(tmp_path).errors == []


def test_the_page_of_an_experiment_of_ones_own_shows_nothing_else(results, monkeypatch):
    monkeypatch.setattr(page, "EXPERIMENTS", ("drift", "phase"))
    monkeypatch.setattr(page.errata, "measure", lambda: pytest.fail("evaluated for nothing"))
    report = page.assemble(results)
    assert [section.experiment for section in report.sections] == ["toy.broken", "toy.good"]
    text = markup(page.html(report))
    assert re.findall('<section id="([^"]+)"', text) == ["toy.broken", "toy.good", "failures", "environment"]
    assert "No data" not in text
    assert "<h1>" in text
    links = set(re.findall(r'href="#([\w.]+)"', text))
    assert links <= {value for name, value in Elements(text).attributes if name == "id"}


def test_a_page_of_some_methods(results):
    report = page.assemble(results, choice=Choice(methods=("rk45",), highlight=("rk45",)))
    assert {method for section in report.sections for method in section.rows.method} == {"rk45"}
    assert [section.experiment for section in report.sections] == ["toy.good", "toy.broken"]
    assert report.claims == [], "they are about all methods"
    assert "only the methods rk45" in report.origin
    assert " --methods rk45 --highlight rk45" in report.sections[0].redraw("first")
    assert "--methods" not in report.sections[0].command.partition("--results")[0]


def test_a_journal_of_another_schema_costs_only_its_section(results, tmp_path, monkeypatch):
    with monkeypatch.context() as future:
        future.setattr(store, "SCHEMA", 99)
        store.Store(tmp_path).append(store.make_record("toy.broken", 1, 0, {}, **outcome([{"drift": 1.0}])))
    (error,) = page.assemble(tmp_path).errors
    assert error.startswith("toy.broken: toy.broken.jsonl, line 1: written with schema 99"), error


def test_files_of_the_page_before_go_and_all_others_stay(report, tmp_path):
    page.write(report, tmp_path)
    good = next(section for section in report.sections if section.experiment == "toy.good")
    fewer = replace(report, sections=[replace(good, figures=good.figures[:1], tables=good.tables[:1])])
    mine = [tmp_path / name for name in ("figures/toy.good_mine.svg", "tables/toy.good_mine.csv")]
    for path in mine:
        path.write_text("mine")
    page.write(fewer, tmp_path)
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*")}
    made = {"figures/toy.good_first.svg", *(f"tables/toy.good_all.{kind}" for kind in ("md", "tex", "csv"))}
    assert left == {"index.html", "figures/toy.good_mine.svg", "tables/toy.good_mine.csv"} | made
    assert all(path.read_text() == "mine" for path in mine)


def test_a_page_of_somebody_elses_stays(results, tmp_path, run):
    (tmp_path / "index.html").write_text("<!doctype html><title>My home page</title>")
    code, out, err = run("report", "--results", results, "--output", tmp_path)
    assert (code, out) == (2, "")
    line = f"lagrange-bench: error: {tmp_path / 'index.html'} is not a page of lagrange-bench"
    assert (err.count("\n"), err.startswith(line), "--output" in err) == (1, True, True)
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]
    assert "My home page" in (tmp_path / "index.html").read_text()


def test_an_interrupted_page_is_the_old_one_whole(report, tmp_path, monkeypatch):
    index = page.write(report, tmp_path)
    good = next(section for section in report.sections if section.experiment == "toy.good")
    fewer = replace(report, sections=[replace(good, figures=[])])

    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(page, "html", interrupt)
    with pytest.raises(KeyboardInterrupt):
        page.write(fewer, tmp_path)
    links = {value for _, value in Elements(index.read_text(encoding="utf-8")).attributes if value and "s/toy" in value}
    assert len(links) == 2 + 4 * 3
    assert all((tmp_path / link).is_file() for link in links)


def test_a_write_that_fails_leaves_the_old_page(report, tmp_path, monkeypatch):
    index = page.write(report, tmp_path)
    before = index.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(page.os, "replace", full)
    with pytest.raises(OSError, match="No space") as raised:
        page.write(report, tmp_path)
    assert raised.value.filename == str(tmp_path / "figures" / "toy.good_first.svg"), "not the temporary one"
    assert index.read_bytes() == before
    assert not list(tmp_path.rglob(".*"))


def test_write_experiment_draws_one_and_raises_what_drawing_raises(results, tmp_path):
    written = sections.write_experiment("toy.good", results, tmp_path)
    assert len(written) == 2 + 2 * 3
    assert all(path.is_file() for path in written)
    with pytest.raises(ZeroDivisionError):
        sections.write_experiment("toy.broken", results, tmp_path)


def test_command_line(results, tmp_path, capsys):
    assert main(["report", "--results", str(results), "--output", str(tmp_path / "out")]) == 1, "a toy cannot be drawn"
    out, err = capsys.readouterr()
    assert out == f"{(tmp_path / 'out' / 'index.html').resolve()}\n"
    assert "not drawn: toy.broken" in err
    assert err.startswith(f"drawn from {results}\n")
    assert main(["report", "--results", str(tmp_path / "nowhere"), "--output", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    (tmp_path / "file").write_text("")
    assert main(["report", "--results", str(results), "--output", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_verdicts(report, text):
    verdicts = {judged.claim.id: judged.verdict for judged in report.claims}
    assert {name: verdict.word for name, verdict in verdicts.items()} == {
        "holds": "confirmed",
        "refuted": "refuted",
        "failed": "refuted",
        "absent": "not tested",
        "unstored": "not tested",
    }
    assert "1 of 3 failed: StepError" in verdicts["failed"].note
    assert "colour" in verdicts["absent"].note
    for words in ("1 confirmed", "2 refuted", "2 not tested", "run</span> <span>toy.good</span>"):
        assert words in text


def test_other_results_stand_beside(results, tmp_path, monkeypatch):
    """Where the other run drifts the verdict beside is another one, and those on the page stay."""
    folder = tmp_path / "published"
    folder.mkdir()
    for i, method in enumerate(("backlund", "rk45")):
        rows = [{"drift": 1.0 if method == "backlund" else 1e-12}]
        record = store.make_record("toy.good", 1, i, {"method": method, "h": 0.1}, **outcome(rows))
        store.Store(folder).append({**record, "sources": None})
    held = page.assemble(results, beside=folder)
    assert [judged.verdict.word for judged in held.claims][:3] == ["confirmed", "refuted", "refuted"]
    assert [judged.beside.word for judged in held.claims][:3] == ["refuted", "refuted", "confirmed"]
    words = unescape(re.sub("<[^>]*>", "", markup(page.html(held))))
    assert (
        "published: 1 confirmed, 2 refuted, 2 not tested; 2 stored cells were computed with source code that was"
        in words
    )
    assert "beside: refuted, 1 · check" in words


def test_fairness_tells_every_method_and_needs_no_rows(report, text):
    methods = report.fairness.methods.set_index("method")
    assert list(methods.index) == list(methods_on())
    assert methods.engine["rk45"] == "SciPy, interpreted"
    assert methods.engine["backlund"].startswith("compiled")
    assert '<section id="fairness">' in text
    assert "no property of the method" not in text, "nothing of the cost experiment is stored"


def test_fairness_says_what_the_rows_say():
    cost = pd.DataFrame(
        {
            "part": "step",
            "status": "done",
            "method": ["backlund", "rk45", "rk45_fixed"],
            "ns_per_step": [20.0, 36000.0, 40.0],
            "evals_per_step": [0.0, 6.1, 6.0],
            "setup_us": [60.0, 4.0, 3.0],
        }
    )
    work = pd.DataFrame(
        {
            "method": ["a", "a", "b", "b"],
            "span": 100.0,
            "state": "generic",
            "longest": 1.0,
            "seconds": [1e-5, np.nan, 2e-5, 4e-5],
            "stopped": [None, "too long", "refused", None],
        }
    )
    assert "is Python" not in dict(fairness.assemble({"cost": cost}).rules)["Set-up and compilation apart."]
    ensemble = pd.DataFrame({"part": "setup", "status": "done", "setup_us": [2.0, 7.0]})
    rules, methods = fairness.assemble({"cost": cost, "work_precision": work, "ensemble": ensemble})
    said = dict(rules)
    assert "take 2 µs for a top. They take more for longer steps, up to 7 µs" in said["Set-up and compilation apart."]
    assert "a factor of 900," in said["Compiled or not."]
    assert "60 µs for the exact" in said["Set-up and compilation apart."]
    ends = "Of 2 curves 0 end where the error falls no more, 1 where one run would take too long, and 1 at the tightest"
    assert ends in said["Each at its best step."]
    methods = methods.set_index("method")
    assert methods["evaluations per step"]["backlund"] == "none"
    assert methods["evaluations per step"]["rk45_fixed"] == 6.0


def test_three_formats_of_a_table(text, tmp_path):
    path = tmp_path / "out" / "tables"
    whole = pd.read_csv(path / "toy.good_all.csv")
    assert list(whole.columns) == ["method", "h", "max_drift & more"]
    assert whole["max_drift & more"].tolist() == [1e-12 * h**i for i in range(3) for h in (0.01, 0.1, 1.0)][:5] + [
        1e-12 * h**2 for h in (0.01, 0.1, 1.0)
    ]
    assert pd.read_csv(path / "toy.good_median.csv").note[0] == NASTY
    lines = (path / "toy.good_median.md").read_text(encoding="utf-8").splitlines()
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {4}
    tex = (path / "toy.good_median.tex").read_text(encoding="utf-8")
    for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\begin{tabular}{@{}lrl@{}}"):
        assert rule in tex
    assert r"50 \% of a\_b \& \textless{}script\textgreater{}alert(1)" in tex
    assert r"somebody\_elses" in tex
