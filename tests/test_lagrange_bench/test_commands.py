"""Commands that list, check and complete: what they print is what there is, and the reasons where something fails."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lagrange_bench import __main__ as cli
from lagrange_bench import output
from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import CASES, METHODS, PERTURBED_TOPS, POTENTIALS, TOPS, registry
from lagrange_bench.integrators.registry import NAMED_TOPS
from tests.test_docs import commands


def test_tables_fit_a_terminal(run, monkeypatch):
    wide = run("tops", "--verbose")[1]
    assert max(map(len, wide.splitlines())) > 80
    monkeypatch.setattr(output, "terminal_width", lambda: 80)
    narrow = run("tops", "--verbose")[1]
    assert max(map(len, narrow.splitlines())) <= 80
    assert sorted("".join(narrow.split())) == sorted("".join(wide.split())), "wrapped, and nothing is lost"


@pytest.mark.parametrize(
    ("command", "known"),
    [("methods", METHODS), ("tops", TOPS), ("tops", PERTURBED_TOPS), ("potentials", POTENTIALS), ("case", CASES)],
)
def test_all_there_is_is_listed(run, answer, command, known):
    code, out, err = run(command)
    assert (code, err) == (0, "")
    tables = [[line.split()[0] for line in table.splitlines()[1:]] for table in out.split("\n\nin a potential:\n")]
    assert any(table[: len(known)] == list(known) for table in tables)
    assert [listed["name"] for listed in answer(command) if listed["name"] in known] == list(known)


@pytest.mark.parametrize("known", [METHODS, POTENTIALS, NAMED_TOPS], ids=lambda known: known.word)
def test_a_plug_in_that_cannot_be_loaded_is_listed(run, answer, folder, monkeypatch, known):
    (folder / "leaves.py").write_text("raise SystemExit('no')\n")
    broken = registry.EntryPoint("broken", "leaves:IT", known.group)
    monkeypatch.setitem(vars(known), "_entries", {**known._entries, "broken": broken})
    assert "broken: cannot be loaded: ImportError: it calls sys.exit('no')" in run(f"{known.word}s")[1]
    listed = answer(f"{known.word}s")
    assert (len(listed), listed[-1]["error"]) == (len(known), "ImportError: it calls sys.exit('no')")


def test_a_top_is_told_by_its_numbers(answer):
    data = {top["name"]: top for top in answer("tops")}
    assert data["generic"]["nutation_period"] == pytest.approx(4.22213, abs=1e-5)
    assert data["homoclinic"]["nutation_period"] is None
    top = PERTURBED_TOPS["magnet"]
    facts = {"alpha": top.alpha, "state": list(top.y0), "potential": "charge", "parameters": list(top.parameters)}
    assert data["magnet"].items() >= {**facts, "conserves": ["H", "C1", "C2"]}.items()


UNITS = {  # so that V has those of J²
    "quadratic": "S in units of J²/x²",
    "axisymmetric": "ck in units of J²/x^k",
    "charge": "k in units of J² x",
    "dipole": "b in units of J²/x",
    "tide": "k = 3 (GM/r³)(C − A)/A, in units of J²/x²",
}


def test_potentials(answer):
    data = {potential["name"]: potential for potential in answer("potentials")}
    assert data["tide"]["parameters"] == ["k", "n1", "n2", "n3"]
    assert data["axisymmetric"]["parameters"] is None
    assert all(potential["note"].endswith(UNITS[name]) for name, potential in data.items())


def test_methods_of_a_top(run, answer):
    """Which take it, what they keep of it, and why the others do not."""
    table, left_out = run("methods", "--top", "magnet")[1].split("\nleft out: ", 1)
    data = {method["name"]: method for method in answer("methods", "--top", "magnet")}
    taken = [name for name, method in data.items() if method["refuses"] is None]
    assert taken == [line.split()[0] for line in table.splitlines()[1:]]
    refused = METHODS["theta_functions"].takes(PERTURBED_TOPS["magnet"].top)
    assert data["theta_functions"]["refuses"] == refused
    assert refused.replace(" ", ": ", 1) in left_out
    assert data["strang"]["conserves"] == ["C1", "C2"]
    words = ("methods", "--potential", "charge", "--parameters", "0.1,0,0,2")  # on the vertical: J3 stays
    assert {m["name"]: m for m in answer(*words)}["strang"]["conserves"] == ["J3", "C1", "C2"]
    refused = {method["name"] for method in answer("methods", "--top", "generic") if method["refuses"]}
    assert refused == {name for name, method in METHODS.items() if method.needs in ("body", "spins")}
    assert "refuses" not in answer("methods")[0]


REFERENCE = Path(__file__).parents[2] / "docs" / "cases"


def test_a_file_of_doubles(run, tmp_path):
    """17 digits make the doubles again; pandas reads it; the times are the decimals that were asked for."""
    path = tmp_path / "ref.csv"
    assert run("case", "bruels", "--until", "2", "--every", "0.1", "--output", str(path))[0] == 0
    table = np.loadtxt(path, delimiter=",", skiprows=6)  # before version 3.1 pandas loses an ulp
    assert table[:, 0].tolist() == pd.read_csv(path, comment="#")["t"].tolist() == [k / 10 for k in range(21)]
    assert np.array_equal(table, CASES["bruels"].doubles(table[:, 0]))
    header = path.read_text("utf-8").splitlines()[:6]
    assert all(line.startswith("# ") for line in header[:5])
    assert header[5].startswith("t,x,y,z,qw,qx,qy,qz,r11,")


@pytest.mark.parametrize("name", CASES)
def test_the_reference_files(name, run):
    """Their first rows again, to the last of 25 digits; their checksums."""
    text, sums = (REFERENCE / f"{name}.csv").read_bytes(), (REFERENCE / "SHA256SUMS").read_text("utf-8")
    assert f"{hashlib.sha256(text).hexdigest()}  {name}.csv" in sums.splitlines()
    lines = text.decode().splitlines()
    code, out, _ = run("case", name, "--until", lines[8].split(",")[0], "--digits", "25")
    assert code == 0
    assert out.splitlines() == lines[:9]
    assert len(lines) == 27


def test_check_a_method_that_does_not(run):
    code, out, err = run("check", "toys.lies:METHOD", "--quick", "--json")
    assert (code, err) == (1, "")
    data = json.loads(out)
    assert (data["method"], data["passed"]) == ("lies", False)
    passed = {verdict["claim"]: verdict["passed"] for verdict in data["verdicts"]}
    false = {"symmetric", "conserves H", "conserves C1", "StepErrors name the method"}
    assert {claim for claim, kept in passed.items() if kept is False} == false
    # what is true of it is not refuted, and what it does not claim is not judged
    assert passed["order 5"]
    assert passed["conserves J3"]
    assert passed["conserves C2"] is None


def test_check_says_why_a_claim_fails_and_with_verbose_how_every_one_was_measured(run, monkeypatch):
    monkeypatch.setattr(check, "CHECKS", (check.symmetric, check.order))
    out = run("check", "toys.lies:METHOD", "--quick")[1]
    assert re.search(r"^fail: symmetric: a step and its inverse, .*; largest on \w+, h = 3$", out, re.MULTILINE)
    assert "one step against the exact solution" not in out
    assert "one step against the exact solution" in run("check", "toys.lies:METHOD", "--quick", "--verbose")[1]


COMPLETED = [  # what is typed, some of what is offered, and what is not
    ("", {"run", "integrate", "completion"}, {"backlund", "--json"}),
    ("-", {"--help", "--version"}, {"run"}),
    ("run drift ph", {"phase"}, {"drift"}),
    ("run --pro", {"--profile"}, {"--json"}),
    ("run drift --profile ", {"quick", "full"}, {"drift"}),
    ("run --tops g", {"generic"}, {"backlund"}),
    ("integrate --top ", {"generic", "magnet"}, {"backlund"}),
    ("integrate --method back", {"backlund", "backlund_paper"}, {"strang"}),
    ("methods --potential ", {"tide", "charge"}, {"generic"}),
    ("report --results ", {"tests"}, {"backlund", "--json"}),
]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_completion_in_bash(run, monkeypatch):
    monkeypatch.chdir(cli.__file__.rpartition("/lagrange_bench/")[0])
    program = run("completion", "bash")[1]
    for typed, _, _ in COMPLETED:
        words = f"lagrange-bench {typed.rstrip()}{' ' + chr(34) * 2 if typed.endswith(' ') or not typed else ''}"
        program += f"\nCOMP_WORDS=({words})\nCOMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _shtab_lagrange_bench\n"
        program += 'echo "${COMPREPLY[@]}"\n'
    done = subprocess.run(["bash", "-u", "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for (typed, offered, others), line in zip(COMPLETED, done.stdout.splitlines(), strict=True):
        assert offered <= set(line.split()), typed
        assert not others & set(line.split()), typed


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_every_command_and_option(run, shell):
    code, out, err = run("completion", shell)
    assert (code, err) == (0, "")
    for name, command in commands().items():
        assert name in out
        assert not [flag for flag in command if flag.startswith("--") and flag.lstrip("-") not in out]
    if syntax := shutil.which(shell):
        assert subprocess.run([syntax, "-n"], input=out, capture_output=True, text=True, check=False).stderr == ""
