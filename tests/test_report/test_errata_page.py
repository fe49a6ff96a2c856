"""The errata page: every erratum is on it; the command and the report show it."""

import json

import pytest

from lagrange_bench.experiments.measuring import errata
from lagrange_bench.report import page, readme

# What was found wrong when every equation was checked, by section. (5.5.5) lacks a bracket, and has no formula to evaluate.
KNOWN = {
    "1": ["(1.1), text"],
    "2": ["(2.5)–(2.6) with (2.21)", "(2.11), text", "(2.18)", "(2.20)", "(2.22)"],
    "3": ["(3.4) with (3.5)", "(3.5), text"],
    "4": ["(4.5), θ", "(4.5), φ", "(4.5), p_θ"],
    "5.1": ["(5.1.9)", "(5.1.11) J̃2", "(5.1.11) x̃1", "(5.1.11) x̃2"],
    "5.2": ["(5.2.11), sign", "(5.2.11), order", "(5.2.13)"],
    "5.3": ["(5.3.2), middle member"],
    "5.4": ["(5.4.4)", "(5.4.11)–(5.4.15)", "(5.4.16)"],
    "5.5": ["before (5.5.2)", *(f"(5.5.9) {name}" for name in ["J̃-", "J̃+", "x̃3", "x̃-", "x̃+"]),
            *(f"(5.5.10) {name}" for name in ["J̃1", "J̃2", "x̃1", "x̃2", "x̃3"]), "(5.5.11)"],
    "5.6": ["(5.6.1), text", "(5.6.6)", "(5.6.9), (5.6.10)", "below (5.6.10)", "(5.6.11)"],
}  # fmt: skip
PROSE = {  # a sentence, beside formulas that are right
    "1": ["(1.1), text"],
    "2": ["(2.5)–(2.6) with (2.21)", "(2.11), text", "(2.20)"],
    "3": ["(3.5), text"],
    "5.5": ["before (5.5.2)", "(5.5.11)"],
    "5.6": ["(5.6.1), text"],
}


def pairs(listed):
    return {(section, equation) for section, equations in listed.items() for equation in equations}


@pytest.fixture(scope="module")
def found():
    return errata.measure()


def test_every_erratum_is_listed_wrong_as_printed_and_right_as_corrected(found):
    assert pairs(KNOWN) <= {(e.section, e.equation) for e in found}
    assert {(e.section, e.equation) for e in found if e.prose} == pairs(PROSE)
    assert errata.count(found) == f"{len(found) - 8} formulas and 8 sentences beside right formulas"
    for e in found:
        assert e.printed > 1e-6, e.equation
        assert e.corrected <= 1e-12, e.equation
        assert e.printed_text != e.corrected_text
    sections = [[int(n) for n in e.section.split(".")] for e in found]
    assert sections == sorted(sections)


def test_the_readme_counts_them(found):
    assert f"corrected: {errata.count(found)}." in " ".join((readme.ROOT / "README.md").read_text("utf-8").split())


def test_magnitude():
    assert [errata.magnitude(r) for r in (0.0, 2e-16, 1e-3, 0.1, 0.7, 3.0)] == [0.0, 1e-15, 1e-3, 0.1, 1.0, 10.0]


def test_command(run, found, monkeypatch):
    measure = errata.measure
    monkeypatch.setattr(errata, "measure", lambda points, seed: found if points == 8 else measure(points, seed))
    code, out, err = run("errata")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].startswith(f"wrong: {errata.count(found)}; at {errata.POINTS} random points each:")
    assert all(text in out for e in found for text in (e.equation, e.printed_text, e.corrected_text))
    first, other = (run("errata", "--points", "1", "--seed", seed, "--json")[1] for seed in (5, 6))
    assert first != other
    assert {(e["section"], e["equation"]) for e in json.loads(first)} >= pairs(KNOWN)


@pytest.fixture
def results(tmp_path):
    """One stored cell of the experiment that the errata belong to."""
    stored = (readme.ROOT / "results" / "reference" / "paper.jsonl").read_text(encoding="utf-8")
    (tmp_path / "paper.jsonl").write_text(stored.splitlines(keepends=True)[0], encoding="utf-8")
    return tmp_path


def test_page(results, found, monkeypatch):
    monkeypatch.setattr("lagrange_bench.report.sections.draw_figures", lambda *_: [])
    monkeypatch.setattr(errata, "measure", lambda: found)
    text = page.html(page.assemble(results))
    section = text.split('<section id="errata">')[1].split("</section>")[0]
    assert section.count("<tr>") == len(found) + 1
    assert all(e.equation in section for e in found)
    assert section.count(">sentence</td>") == 8
    monkeypatch.setattr(errata, "measure", lambda: 1 / 0)
    without = page.assemble(results)
    assert without.errors == ["errata: cannot be made: ZeroDivisionError: division by zero"], "only this part is lost"
