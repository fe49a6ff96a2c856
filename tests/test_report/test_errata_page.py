"""The errata page: every erratum is on it, wrong as printed and right as corrected; the command and the report show it."""

import json
import subprocess
import sys

import pytest

from lagrange_bench import __main__ as cli
from lagrange_bench.experiments.measuring import errata
from lagrange_bench.report import page, readme

# What was found wrong when every equation was checked, by section and equation.
PROSE = {  # a sentence, beside formulas that are right
    ("1", "(1.1), text"),
    ("2", "(2.5)–(2.6) with (2.21)"),
    ("2", "(2.11), text"),
    ("2", "(2.20)"),
    ("3", "(3.5), text"),
    ("5.5", "before (5.5.2)"),
    ("5.5", "(5.5.11)"),
    ("5.6", "(5.6.1), text"),
}
CHECKLIST = {
    ("1", "(1.1), text"): "direction of gravity",
    ("2", "(2.5)–(2.6) with (2.21)"): "r-matrix of L = i L_G",
    ("2", "(2.11), text"): "which Jacobian",
    ("2", "(2.18)"): "remainder of the contraction",
    ("2", "(2.20)"): "the morphism holds in the limit only",
    ("2", "(2.22)"): "2 alpha J3/u",
    ("3", "(3.4) with (3.5)"): "v1 and −A(u1)",
    ("3", "(3.5), text"): "which point is on the curve",
    ("4", "(4.5), θ"): "imaginary half-period",
    ("4", "(4.5), φ"): "factor 2 and sign",
    ("4", "(4.5), p_θ"): "sign",
    ("5.1", "(5.1.9)"): "2 alpha J3/λ",
    ("5.1", "(5.1.11) J̃2"): "(86), three slips",
    ("5.1", "(5.1.11) x̃1"): "(88), three slips",
    ("5.1", "(5.1.11) x̃2"): "(89), five slips",
    ("5.2", "(5.2.11), sign"): "(conGF)",
    ("5.2", "(5.2.11), order"): "(conGF)",
    ("5.2", "(5.2.13)"): "(zs1)",
    ("5.3", "(5.3.2), middle member"): "k²/λ²",
    ("5.4", "(5.4.4)"): "(111), two slips",
    ("5.4", "(5.4.11)–(5.4.15)"): "elliptic integrals",
    ("5.4", "(5.4.16)"): "zero field, sign",
    ("5.5", "before (5.5.2)"): "which maps are inverse to each other",
    ("5.5", "(5.5.9) J̃-"): "alpha",
    ("5.5", "(5.5.9) J̃+"): "alpha",
    ("5.5", "(5.5.9) x̃3"): "alpha for x",
    ("5.5", "(5.5.9) x̃-"): "sign, alpha",
    ("5.5", "(5.5.9) x̃+"): "sign, alpha",
    ("5.5", "(5.5.10) J̃1"): "(145), alpha",
    ("5.5", "(5.5.10) J̃2"): "(146), alpha",
    ("5.5", "(5.5.10) x̃1"): "(148), braces exchanged, alpha",
    ("5.5", "(5.5.10) x̃2"): "(149), braces exchanged, alpha",
    ("5.5", "(5.5.10) x̃3"): "(150), alpha",
    ("5.5", "(5.5.11)"): "reality needs μ2 = −μ̄1",
    ("5.6", "(5.6.1), text"): "the time step",
    ("5.6", "(5.6.6)"): "2 alpha J3/λ2",
    ("5.6", "(5.6.9), (5.6.10)"): "sign of the physical limit",
    ("5.6", "below (5.6.10)"): "{H, L}",
    ("5.6", "(5.6.11)"): "factor i",
}
# Wrong too, but without a formula to evaluate: a bracket is missing in (5.5.5).


def test_every_erratum_is_listed():
    """That each is wrong as printed and right as corrected is tested in test_integrators/paper/test_errata.py."""
    assert set(CHECKLIST) <= {(e.section, e.equation) for e in errata.measure(points=1)}


def test_sentences_are_counted_apart_from_formulas():
    found = errata.measure(points=1)
    assert {(e.section, e.equation) for e in found if e.prose} == PROSE
    assert errata.count(found) == f"{len(found) - len(PROSE)} formulas and {len(PROSE)} sentences beside right formulas"
    assert errata.count(e for e in found if e.prose).startswith("0 formulas")


def test_order_of_the_paper():
    sections = [[int(n) for n in e.section.split(".")] for e in errata.measure(points=1)]
    assert sections == sorted(sections)


def test_magnitude():
    assert [errata.magnitude(r) for r in (0.0, 2e-16, 1e-3, 0.1, 0.7, 3.0)] == [0.0, 1e-15, 1e-3, 0.1, 1.0, 10.0]


# ---------------------------------------------------------------- the command


def run(capsys, *words):
    code = cli.main(list(words))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_command(capsys):
    code, out, err = run(capsys, "errata", "--points", "2")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["section", "equation", "wrong", "residual", "statement"]
    assert lines[-1].startswith(f"wrong: {errata.count(errata.measure())}; at 2 random points each:")
    assert sum(" sentence " in line for line in lines[1:-2:2]) == len(PROSE)
    for e in errata.measure(2):
        assert e.equation in out
        assert e.printed_text in out
        assert e.corrected_text in out
    starts = {line.replace("\u0303", "").replace("\u0304", "").index("printed  ") for line in lines[1:-2:2]}
    assert len(starts) == 1  # columns stay aligned where letters carry a tilde


def test_command_json(capsys):
    code, out, _ = run(capsys, "errata", "--points", "2", "--seed", "5", "--json")
    assert code == 0
    data = json.loads(out)
    fields = ("section", "equation", "printed_text", "corrected_text", "prose", "printed", "corrected")
    assert all(set(fields) == set(e) for e in data)
    assert {(e["section"], e["equation"]) for e in data} >= set(CHECKLIST)
    assert run(capsys, "errata", "--points", "2", "--seed", "5", "--json")[1] == out
    assert run(capsys, "errata", "--points", "2", "--seed", "6", "--json")[1] != out


@pytest.mark.parametrize("words", [("--points", "0"), ("--points", "x"), ("--seed", "1.5")])
def test_command_bad_input(capsys, words):
    code, out, err = run(capsys, "errata", *words)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert words[0] in err


def test_command_help(capsys):
    code, out, _ = run(capsys, "errata", "--help")
    assert code == 0
    assert out.count("  lagrange-bench errata") == 3
    program = "import sys; from lagrange_bench.__main__ import main; main(['errata', '--help'])\n"
    program += "print(sorted({'numpy', 'mpmath', 'numba', 'scipy', 'pandas'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


# ---------------------------------------------------------------- the page


@pytest.fixture
def results(tmp_path):
    """One stored cell of the experiment that the errata belong to."""
    (tmp_path / "results").mkdir()
    stored = (readme.ROOT / "results" / "reference" / "paper.jsonl").read_text(encoding="utf-8")
    (tmp_path / "results" / "paper.jsonl").write_text(stored.splitlines(keepends=True)[0], encoding="utf-8")
    return tmp_path / "results"


def test_page(results):
    text = page.html(page.assemble(results))
    assert text == page.html(page.assemble(results))
    assert text.count('href="#errata"') == 1
    section = text.split('<section id="errata">')[1].split("</section>")[0]
    assert section.count("<tr>") == len(errata.measure()) + 1
    for e in errata.measure():
        assert e.equation in section
    assert section.count(">sentence</td>") == len(PROSE)
    assert f"({len(errata.measure()) - len(PROSE)} formulas,\n{len(PROSE)} sentences)" in section
    assert "10⁻¹" in section
    after = [text.index(f'<section id="{name}">') for name in ("paper", "errata", "failures")]
    assert after == sorted(after)


def test_page_without_errata(results, monkeypatch):
    def broken():
        raise ZeroDivisionError("no luck")

    monkeypatch.setattr(errata, "measure", broken)
    report = page.assemble(results)
    assert report.errors == ["errata: cannot be evaluated: ZeroDivisionError: no luck"]
    assert "where its formulas can be evaluated" in page.html(report)
