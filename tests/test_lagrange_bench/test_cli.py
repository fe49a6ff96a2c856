"""The command line: it teaches, says in one line what is wrong, prints data alone on stdout; what `run` and `figure` do."""

import json
import os
import re
import shlex
import sys
import warnings
from html import unescape
from pathlib import Path

import pytest
from faults import python

from lagrange_bench import __main__ as cli
from lagrange_bench import integrators
from lagrange_bench.experiments import EXPERIMENTS, phase
from lagrange_bench.integrators import registry
from lagrange_bench.results.store import Store, make_record
from lagrange_bench.runner import engine

COMMANDS = tuple(module.__name__.rpartition(".")[2] for module in cli.COMMANDS)
SLOW = ["numpy", "numba", "scipy", "matplotlib", "pandas", "heyoka", "mpmath", "rich", "jinja2", "multiprocessing"]
SHORT = ("integrate", "--h", "0.1", "--steps", "20")


def test_help_imports_nothing_slow():
    """What makes `--help` fast, without a clock; and the engine is as light, but for multiprocessing."""
    program = f"""
import sys
from lagrange_bench.__main__ import main
for command in ((), *((c,) for c in {COMMANDS!r})):
    assert main([*command, "--help"]) == 0
loaded = set({SLOW!r}) & set(sys.modules)
import lagrange_bench.runner.engine
print("loaded:", loaded or set({SLOW!r}) & set(sys.modules) - {{"multiprocessing"}})
"""
    done = python("-c", program)
    assert done.stdout.splitlines()[-1:] == ["loaded: set()"], done.stderr


def examples(text):
    lines = [re.split(r"[|>] ", line)[0] for line in text.splitlines() if line.startswith("  lagrange-bench ")]
    return [shlex.split(re.split(r"\s{2,}", line.strip())[0])[1:] for line in lines]


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_every_help_has_examples_that_are_understood(run, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = run(*([command] if command else []), "--help")
    assert (code, err) == (0, "")
    assert len(examples(out)) >= 2
    for words in examples(out):  # those of `integrate` are also run
        assert hasattr(cli.parser().parse_args(words), "run")
    assert command or (out == run()[1] and re.fullmatch(r"lagrange-bench \d+\.\d+\S*\n", run("--version")[1]))


I = "integrate --h 0.1 --steps 3"
T = "integrate --times 0,1"
JUDGE = "judge run.csv --case bruels"
BAD = {  # words → what the line must name
    "integrat": "unknown 'integrat'; did you mean 'integrate'?",
    "run drift --profil quick": "unknown argument '--profil'; did you mean '--profile'? (see lagrange-bench run --help)",
    "integrate --times 0:1:1e10": "--times: must be t0:t1:n, with n from 2 to 10^7",
    f"{JUDGE} --bounds axis=low": "--bounds: axis must be a number; got 'low'",
    "run mine.broken": "cannot be loaded: ModuleNotFoundError: No module named 'nonexistent_thing'",
    "figure": "one of the arguments NAME --all --list is required",
    "run --results ''": "argument --results: must name a file or folder; got an empty word",  # $RESULTS, where it is not set
    f"{I} --option pin=1 --option pin=0": "--option: each name once",
    f"{T} --physical mass=1,distance=1,A=2,C=1,theta=30,dpsi=3": "theta = 30 is in rad, not in degrees",
    f"{I} --output folder.csv": "folder.csv: this is not a file",
    f"{T} --potential json:loads": "json:loads is a function, not a lagrange_bench.Potential",
    f"{I} --top magnet": "no exact one is known here; name one, such as taylor",
    f"{I} --potential tide --parameters 0.1,1,0,0 --method backlund": "methods --potential tide --parameters 0.1,1.0,0.0,0.0)",
    f"{JUDGE} --bounds omega=1": "no columns to judge omega by",
    f"{JUDGE} --step 1/0": "--step: must be a positive number such as 0.5 or 1/60, at most 1e+07; got '1/0'",
    "case --until 3": "--until belongs to the NAME of a case",
    "run drift --methods rk44": "--methods: no cell here has the method 'rk44'; did you mean 'rk4'?",
    "run drift --methods mine.py": "method mine.py: write mine:METHOD",
    "figure phase_h --xlim 0,1": "the axis is logarithmic, so limits must be positive; got 0, 1",
    "figure phase_h --x h --y of --results small": "y must be a column of numbers; got 'of'; did you mean 'off'?",
    "figure phase_h --output x.eps --results small": "--output x.eps: the name must end in",
}


@pytest.mark.parametrize("words", BAD)
def test_bad_input(run, words, folder, monkeypatch):
    (folder / "mine.toml").touch()
    (folder / "run.csv").write_text("t,x,y,z\n0,0,1,0\n")
    for name in ("folder.csv", "mine", "small"):
        (folder / name).mkdir()
    cell = {"part": "h", "state": "generic", "method": "backlund", "h": 0.5}
    Store(folder / "small").append(make_record("phase", phase.VERSION, 0, cell, rows=[{"off": 1.0}], sources=None))
    (folder / "mine" / "broken.py").write_text("import nonexistent_thing")
    before = sorted(folder.iterdir())
    monkeypatch.setattr("lagrange_bench.report.page.assemble", lambda *_: pytest.fail("drawn"))
    code, out, err = run(*shlex.split(words))
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: .*\n", err), err  # one line
    assert BAD[words] in err
    assert sorted(path for path in folder.iterdir() if path.name != "__pycache__") == before


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (integrators.StepError("backlund", "no λ", h=1e300), 1, "error: backlund at h = 1e\\+300 \\(own unit\\): no λ"),
        (registry.NotInstalled("taylor", "is not here"), 2, "error: taylor: is not here"),
        (MemoryError(), 1, "error: out of memory: record fewer states \\(--every\\), or take fewer times"),
        (OSError(28, "No space left", "run.csv"), 2, "error: run.csv: No space left"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ZeroDivisionError("a bug"), None, ""),
    ],
)
def test_errors_and_exit_codes(run, monkeypatch, error, code, line):

    def fails(*_, **__):
        raise error

    monkeypatch.setattr(integrators, "integrate", fails)
    if code is None:
        with pytest.raises(type(error)):
            run(*SHORT, "--method", "rk4")
    else:
        found, out, err = run(*SHORT, "--method", "rk4")
        assert (found, out) == (code, "")
        assert re.fullmatch(f"lagrange-bench: {line}\n", err), err


def test_a_warning_is_one_line(run, monkeypatch):
    def warns(*_, **__):
        sys.stderr.write(warnings.formatwarning("two\nlines", UserWarning, "file.py", 1))
        raise KeyboardInterrupt

    monkeypatch.setattr(integrators, "integrate", warns)
    assert run(*SHORT, "--method", "rk4")[2] == "lagrange-bench: warning: two lines\nlagrange-bench: interrupted\n"
    assert "file.py" in warnings.formatwarning("later", UserWarning, "file.py", 1)


def test_json_is_alone_on_stdout(run, folder):
    (folder / "chatter.py").write_text(
        "from dataclasses import replace\nfrom lagrange_bench import METHODS\n"
        "def prepare(*a, **k):\n    print('chatter')\n    return METHODS['backlund'].prepare(*a, **k)\n"
        "METHOD = replace(METHODS['backlund'], prepare=prepare)\n"
    )
    code, out, err = run(*SHORT, "--method", "chatter:METHOD", "--json")
    assert (code, json.loads(out)["method"], err) == (0, "backlund", "chatter\n")


def test_stdout_that_cannot_be_written_to():
    """A reader that went away, a full disk, and a terminal without Greek."""
    program = ("-m", "lagrange_bench")
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as stdout:
        done = python(*program, "--version", stdout=stdout)
    assert (done.returncode, done.stderr) == (141, "")
    if Path("/dev/full").exists():
        with open("/dev/full", "w") as stdout:
            done = python(*program, "--version", stdout=stdout)
        assert (done.returncode, done.stderr.count("\n"), "No space left" in done.stderr) == (2, 1, True)
    done = python(*program, "run", "--help", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert r"\xb7" in done.stdout


def test_run_takes_all_experiments_by_default(run, monkeypatch):
    asked = {}

    def instead(names, profile, results, jobs, show, **more):
        asked.update(names=names, profile=profile, results=results.name, jobs=jobs, show=show, **more)
        return engine.Summary(results, profile)

    monkeypatch.setattr(engine, "run", instead)
    assert run("run", "--profile", "full")[0] == 0
    assert asked.items() >= {"names": EXPERIMENTS, "profile": "full", "results": "full", "again": False}.items()
    assert run("run", "--again", "--scheduler", "local:2", "--jobs", "3", "--no-timings")[0] == 0
    assert asked.items() >= {"scheduler": "local:2", "again": True, "jobs": 3, "timings": False}.items()


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


def test_an_experiment_of_your_own_is_drawn_where_it_was_run(run, in_process, one_core, folder):
    (folder / "my_study").mkdir()
    (folder / "my_study" / "energy.py").write_text(STUDY)
    code, out, err = run("run", "my_study.energy", "--results", "my out", "--jobs", "1", "--draw", "--quiet")
    assert (code, err, "drawn: my out/page/figures/my_study.energy_squares.svg" in out) == (0, "", True)
    after = shlex.split(re.search("^next: lagrange-bench (.*)", out, re.MULTILINE)[1])
    page = Path(run(*after, "--output", "page")[1].strip()).read_text(encoding="utf-8")
    assert "my_study.energy_squares" in page
    assert "cannot be loaded" not in page
    again = unescape(re.sub("<[^>]*>", "", re.search(r"redraw: <code[^>]*>(.*?)</code>", page)[1]))
    assert again == "lagrange-bench figure my_study.energy_squares --results 'my out' --module my_study.energy"
    words, replaced = shlex.split(again)[1:], "replaced: my_study.energy_squares.svg"
    code, out, err = run(*words)
    assert (code, out, replaced in err) == (0, "my_study.energy_squares.svg\n", False)
    assert replaced in run(*words)[2].splitlines()
    assert run(*words, "--quiet")[2] == ""
