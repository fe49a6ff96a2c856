"""The command line: it teaches, says in one line what is wrong, prints data alone on stdout; what the commands do."""

import hashlib
import json
import os
import re
import shlex
import sys
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from faults import python

from lagrange_bench import LagrangeTop, PerturbedTop, integrate
from lagrange_bench import __main__ as cli
from lagrange_bench.commands import integrate as command
from lagrange_bench.integrators import CASES, METHODS, PERTURBED_TOPS, POTENTIALS, TOPS, registry
from lagrange_bench.integrators.problem.examples import problem
from lagrange_bench.runner import engine
from tests.mutants import ROOT

COMMANDS = tuple(" ".join(cli.GROUPS.values()).split())
SLOW = "numpy numba scipy matplotlib pandas heyoka mpmath flint rich jinja2 multiprocessing"
SHORT = ("integrate", "--h", "0.1", "--steps", "20")


def test_help_imports_nothing_slow():
    """What makes `--help` fast, without a clock."""
    program = f"""
import sys
from lagrange_bench.__main__ import main
for command in ((), *((c,) for c in {COMMANDS!r})):
    assert main([*command, "--help"]) == 0
print("loaded:", set({SLOW!r}.split()) & set(sys.modules))
"""
    done = python("-c", program)
    assert done.stdout.splitlines()[-1:] == ["loaded: set()"], done.stderr


@pytest.mark.processes
def test_cases_are_judged_without_heyoka_and_numba(tmp_path):
    """Rows of every case are right; code of every closed form is written."""
    program = f"""
import sys
sys.modules |= dict.fromkeys(("heyoka", "numba", "llvmlite"))
from lagrange_bench.__main__ import main
for name in {list(CASES)!r}:
    assert main(["case", name, "--until", "0.5", "--every", "0.1", "--output", f"{{name}}.csv"]) == 0
    assert main(["judge", f"{{name}}.csv", "--case", name, "--quiet"]) == 0
    assert main(["case", name, "--code", "c", "--output", f"{{name}}.c"]) == (2 if name == "kovalevskaya" else 0)
"""
    done = python("-c", program, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("The start is right.") == len(CASES)


def examples(text):
    lines = [re.split(r"[|>] ", line)[0] for line in text.splitlines() if line.startswith("  lagrange-bench ")]
    return [shlex.split(re.split(r"\s{2,}", line.strip())[0])[1:] for line in lines]


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_every_help_has_examples_that_are_understood(run, command):
    code, out, err = run(*([command] if command else []), "--help")
    assert (code, err) == (0, "")
    assert len(examples(out)) >= 2
    for words in examples(out):  # those of `integrate` are also run
        assert hasattr(cli.parser().parse_args(words), "run")
    assert command or (out == run()[1] and re.fullmatch(r"lagrange-bench \d+\.\d+\S*\n", run("--version")[1]))


BAD = {  # words → what the line must name
    "integrat": "unknown 'integrat'; did you mean 'integrate'?",
    "integrate --method heyoka --h 1 --steps 1": "unknown method 'heyoka'; did you mean 'taylor'?",
    "integrate --top magnet --method backlund --h 1 --steps 1": "(these take it: backlund_splitting, taylor, ",
    "integrate --h 1 --steps 1 --output x.txt": "--output x.txt: the name must end in .csv",
    "integrate --times 0:1:3 --h-scaled 1": "--h-scaled does not go with --times",
    "run drift --profil quick": "unknown argument '--profil'; did you mean '--profile'? (see lagrange-bench run --help)",
    "run drift --methods rk44": "--methods: no cell here has the method 'rk44'; did you mean 'rk4'?",
    "run mine.broken": "cannot be loaded: ModuleNotFoundError: No module named 'nonexistent_thing'",
    "run --results ''": "argument --results: must name a file or folder; got an empty word",  # $RESULTS, where it is not set
    "judge run.csv --case bruels --step 1/0": "--step: must be a positive number such as 0.5 or 1/60, at most 1e+06",
    "case kovalevskaya --code c": "no closed form",
}


FAILURES = {  # what was asked rightly but cannot be done, and what is said
    "integrate --method rk4 --h 1e3 --steps 100": "rk4 at h = 1000 (own unit), step 3: the state left the range of floating-",
    "integrate --h 1 --steps 1000000000000000 --every 1": "out of memory: record fewer states (--every), or take fewer times",
}


@pytest.mark.parametrize("words", [*BAD, *FAILURES])
def test_what_cannot_be_done_is_said_in_one_line(run, words, folder):
    (folder / "run.csv").write_text("t,x,y,z\n0,0,1,0\n")
    (folder / "mine").mkdir()
    (folder / "mine" / "broken.py").write_text("import nonexistent_thing")
    before = sorted(folder.iterdir())
    code, out, err = run(*shlex.split(words))
    assert (code, out) == (1 if words in FAILURES else 2, "")
    assert re.fullmatch(r"lagrange-bench: error: .*\n", err), err
    assert (BAD | FAILURES)[words] in err
    assert sorted(folder.iterdir()) == before


def test_json_is_alone_on_stdout(run, folder):
    (folder / "chatter.py").write_text(
        "from dataclasses import replace\nfrom lagrange_bench import METHODS\n"
        "def prepare(*a, **k):\n    print('chatter')\n    return METHODS['backlund'].prepare(*a, **k)\n"
        "METHOD = replace(METHODS['backlund'], prepare=prepare)\n"
    )
    code, out, err = run(*SHORT, "--method", "chatter:METHOD", "--json")
    assert (code, json.loads(out)["method"], err) == (0, "backlund", "chatter\n")


def test_a_reader_of_stdout_that_went_away():
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as stdout:
        done = python("-m", "lagrange_bench", "--version", stdout=stdout)
    assert (done.returncode, done.stderr) == (141, "")


# an experiment of somebody's own, in which other tests define some functions anew
STUDY = """
VERSION = 1
def cells(profile): return [{"i": i} for i in range(6)]
def measure(cell): return [{"square": float(cell["i"] ** 2)}]
def tables(rows): return {}
def draw(rows):
    from lagrange_bench import style
    fig, ax = style.figure("column")
    ax.plot(rows.i, rows.square)
    return {"squares": fig}
"""


def test_an_experiment_of_your_own_is_drawn_where_it_was_run(run, in_process, folder):
    (folder / "my_study").mkdir()
    (folder / "my_study" / "energy.py").write_text(STUDY)
    code, out, err = run("run", "my_study.energy", "--results", "my out", "--jobs", "1", "--quiet")
    assert (code, err) == (0, "")
    after = shlex.split(re.search("^next: lagrange-bench (.*)", out, re.MULTILINE)[1])
    assert run("figure", *after[1:])[1] == "my_study.energy_squares\n"
    page = Path(run(*after, "--output", "page")[1].strip()).read_text(encoding="utf-8")
    assert "cannot be loaded" not in page
    again = unescape(re.sub("<[^>]*>", "", re.search(r"redraw: <code[^>]*>(.*?)</code>", page)[1]))
    assert again == "lagrange-bench figure my_study.energy_squares --results 'my out' --module my_study.energy"
    code, out, _ = run(*shlex.split(again)[1:])
    assert (code, out) == (0, "my_study.energy_squares.svg\n")


@pytest.mark.parametrize(
    ("command", "known"),
    [("methods", METHODS), ("tops", TOPS), ("tops", PERTURBED_TOPS), ("potentials", POTENTIALS), ("case", CASES)],
)
def test_all_there_is_is_listed(run, answer, command, known):
    code, out, err = run(command, "--archive") if command == "methods" else run(command)
    assert (code, err) == (0, "")
    tables = [[line.split()[0] for line in table.splitlines()[1:]] for table in out.split("\n\nin a potential:\n")]
    assert any(table[: len(known)] == list(known) for table in tables)
    assert [listed["name"] for listed in answer(command) if listed["name"] in known] == list(known)


def test_the_archive_is_left_out_of_lists_and_quick_runs_of_many_methods(run):
    last = run("methods")[1].splitlines()[-1]
    assert last.startswith(f"{len(registry.ARCHIVE)} more are in the archive")
    cells = [{"part": part, "method": name} for part in ("order", "time") for name in METHODS]
    left = engine._without_archive([*cells, {"part": "tolerance"}])
    assert {cell["method"] for cell in left if cell["part"] == "time"} == set(METHODS) - registry.ARCHIVE
    assert {cell["method"] for cell in left if cell["part"] == "order"} == set(METHODS)
    assert left[-1] == {"part": "tolerance"}


def test_methods_of_a_top(run, answer):
    left_out = run("methods", "--top", "magnet")[1].split("\nleft out: ", 1)[1]
    data = {method["name"]: method for method in answer("methods", "--top", "magnet")}
    refused = METHODS["theta_functions"].takes(PERTURBED_TOPS["magnet"].top)
    assert (data["theta_functions"]["refuses"], data["strang"]["refuses"]) == (refused, None)
    assert refused.replace(" ", ": ", 1) in left_out
    assert data["strang"]["conserves"] == ["C1", "C2"]


@pytest.mark.parametrize("name", CASES)
def test_the_reference_files(name, run):
    text, sums = ((ROOT / "docs" / "cases" / file).read_bytes() for file in (f"{name}.csv", "SHA256SUMS"))
    assert f"{hashlib.sha256(text).hexdigest()}  {name}.csv" in sums.decode().splitlines()
    lines = text.decode().splitlines()
    code, out, _ = run("case", name, "--until", lines[8].split(",")[0], "--digits", "25")
    assert code == 0
    assert out.splitlines() == lines[:9]
    assert len(lines) == 27


def test_check_a_method_that_promises_too_much(run, folder):
    (folder / "liar.py").write_text(
        "from dataclasses import replace\nfrom lagrange_bench import METHODS\nRK4 = METHODS['rk4']\n"
        "METHOD = replace(RK4, name='liar', claims=replace(RK4.claims, symmetric=True))\n"
    )
    code, out, err = run("check", "liar:METHOD", "--quick", "--json")
    data = json.loads(out)
    assert (code, err, data["method"], data["passed"]) == (1, "", "liar", False)
    assert ("symmetric", False) in {(verdict["claim"], verdict["passed"]) for verdict in data["verdicts"]}


GENERIC = TOPS["generic"]


@pytest.mark.parametrize("words", examples(command.__doc__), ids=" ".join)
def test_the_examples_of_integrate_run(run, words, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "mine", SimpleNamespace(PROBLEM=problem("free_body")[0]))
    code, out, err = run(*words)
    assert code == 0, err
    assert re.search("against the (exact|reference) solution", out)
    for flag in {"--output", "--draw"} & set(words):
        assert Path(words[words.index(flag) + 1]).stat().st_size > 0


def test_summary(run, answer):
    code, out, err = run(*SHORT)
    assert (code, err) == (0, "")
    expected = integrate(GENERIC.top, GENERIC.state, 0.1, 20)
    shown = next(line for line in out.splitlines() if line.startswith("end")).split()[1:]
    assert [float(word) for word in shown] == expected.y[-1].tolist()
    unit = GENERIC.top.scales(GENERIC.state)[2]
    scaled = run("integrate", "--h-scaled", repr(0.1 / unit), "--steps", "20")[1]
    assert f"h = 0.1 (own unit), h_scaled = {0.1 / unit:g}, 20 steps, up to t = 2," in scaled
    data = answer(*SHORT)
    assert (data["h_scaled"], data["t"], data["work"]["steps"]) == (0.1 / unit, [0.0, 2.0], 20)
    assert all(v["largest_drift"] < 1e-15 for v in data["invariants"].values())
    energy = answer(*SHORT, "--method", "strang", "--steps", "40", "--every", "1")["invariants"]["H"]
    assert energy["largest_drift"] > 1.1 * abs(energy["drift"]) > 0


def test_where_and_when_a_trajectory_is(answer, tmp_path):
    state = "-0.3,0.4,-1.2,-0.48,.6,64e-2"
    words = ("integrate", "--state", state, "--alpha", "-2", "--h", "-1e-1", "--steps", "5", "--every", "1")
    data = answer(*words)
    assert (data["y0"], data["t"]) == ([-0.3, 0.4, -1.2, -0.48, 0.6, 0.64], [-0.1 * n for n in range(6)])
    potential = ("--potential", "tide", "--parameters", "-0.1,0,0,1", "--method", "strang")
    data = answer(*words, *potential, "--output", tmp_path / "run.csv")
    top = PerturbedTop(LagrangeTop(-2.0), POTENTIALS["tide"], (-0.1, 0.0, 0.0, 1.0))
    assert data["y_final"] == integrate(top, data["y0"], -0.1, 5, "strang").y[-1].tolist()
    header = ('potential: "tide"', "parameters: [-0.1, 0.0, 0.0, 1.0]", "alpha: -2.0", f'numpy: "{np.__version__}"')
    assert {f"# {line}" for line in header} <= set((tmp_path / "run.csv").read_text("utf-8").splitlines())
    data = answer("integrate", "--times", "-1:0.1:12")
    assert np.allclose(data["t"], np.linspace(-1, 0.1, 12), rtol=1e-14)
    expected = integrate(GENERIC.top, GENERIC.state, 0.1, 20, lam=0.1 + 0.5j, pin=0)
    data = answer(*SHORT, "--option", "lam=0.1+0.5j", "--option", "pin=0")
    assert data["y_final"] == expected.y[-1].tolist()
    assert (data["error"]["final"], data["error"]["note"][:9]) == (None, "lam given"), "a step is not the flow over h"


def test_a_run_longer_than_the_reference_solution_is_not_judged(answer):
    error = answer("integrate", "--h", "1", "--steps", "3000", "--top", "axisymmetric", "--method", "strang")["error"]
    assert (error["final"], error["largest"]) == (None, None)
    assert "longer than 2000 time scales" in error["note"]


def test_a_file_is_replaced_whole_and_not_in_silence(run, tmp_path, monkeypatch):
    path, link = tmp_path / "run.csv", tmp_path / "link.csv"
    link.symlink_to(path)
    assert run(*SHORT, "--output", path)[2] == f"written: {path}\n"
    assert run(*SHORT, "--output", link, "--every", "20")[2] == f"replaced: {link}\n"
    before = path.read_bytes()
    monkeypatch.setattr(os, "fsync", lambda file: os.close(-1))
    code, _, err = run(*SHORT, "--output", path)
    assert (code, err.count("\n"), path.read_bytes() == before) == (2, 1, True), err
    assert (link.is_symlink(), sorted(tmp_path.iterdir())) == (True, [link, path]), "no pieces are left"
