"""The errata page: every erratum is on it; the command and the report show it."""

import json
from collections import Counter

import pytest

from lagrange_bench.experiments.measuring import errata
from lagrange_bench.report import page, readme

# How much was found wrong when every equation was checked, by section. (5.5.5) lacks a bracket, and has no formula to evaluate.
KNOWN = {"1": 1, "2": 5, "3": 2, "4": 3, "5.1": 4, "5.2": 3, "5.3": 1, "5.4": 3, "5.5": 12, "5.6": 5}
PROSE = {"1": 1, "2": 3, "3": 1, "5.5": 2, "5.6": 1}  # a sentence, beside formulas that are right


@pytest.fixture(scope="module")
def found():
    return errata.measure()


def test_every_erratum_is_listed_wrong_as_printed_and_right_as_corrected(found):
    assert Counter(e.section for e in found) == KNOWN
    assert Counter(e.section for e in found if e.prose) == PROSE
    assert len({(e.section, e.equation) for e in found}) == len(found)
    assert errata.count(found) == f"{len(found) - 8} formulas and 8 sentences beside right formulas"
    for e in found:
        assert e.printed > 1e-6, e.equation
        assert e.corrected <= 1e-12, e.equation
        assert e.printed_text != e.corrected_text
    sections = [[int(n) for n in e.section.split(".")] for e in found]
    assert sections == sorted(sections)


def test_the_readme_counts_them(found):
    assert f"corrected: {errata.count(found)}." in " ".join((readme.ROOT / "README.md").read_text("utf-8").split())


def test_the_command_lists_them(run, found, monkeypatch):
    measure = errata.measure
    monkeypatch.setattr(errata, "measure", lambda points, seed: found if points == 8 else measure(points, seed))
    code, out, err = run("errata")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].startswith(f"wrong: {errata.count(found)}; at {errata.POINTS} random points each:")
    assert all(text in out for e in found for text in (e.equation, e.printed_text, e.corrected_text))
    first, other = (run("errata", "--points", "1", "--seed", seed, "--json")[1] for seed in (5, 6))
    assert first != other
    assert len(json.loads(first)) == len(found)


def test_the_page_lists_them_beside_the_rows_of_their_experiment(tmp_path, found, monkeypatch):
    stored = (readme.ROOT / "results" / "reference" / "paper.jsonl").read_text(encoding="utf-8")
    (tmp_path / "paper.jsonl").write_text(stored.splitlines(keepends=True)[0], encoding="utf-8")
    monkeypatch.setattr("lagrange_bench.report.sections.draw_figures", lambda *_: [])
    monkeypatch.setattr(errata, "measure", lambda: found)
    text = page.html(page.assemble(tmp_path))
    section = text.split('<section id="errata">')[1].split("</section>")[0]
    assert section.count("<tr>") == len(found) + 1
    assert all(e.equation in section for e in found)
    assert section.count(">sentence</td>") == 8
    monkeypatch.setattr(errata, "measure", lambda: 1 / 0)
    without = page.assemble(tmp_path)
    assert without.errors == ["errata: cannot be made: ZeroDivisionError: division by zero"], "only this part is lost"
