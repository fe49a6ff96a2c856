"""The command line: it teaches, says in one line what is wrong, and keeps every bit."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import integrators
from experiments import EXPERIMENTS
from experiments.measuring import bits, check
from integrators import METHODS, PERTURBED_TOPS, POTENTIALS, TOPS, registry
from integrators.registry import NAMED_TOPS
from lagrange_bench import __main__ as cli
from lagrange_bench import text
from lagrange_bench.commands import completion
from lagrange_bench.runner import engine
from report import page
from results.store import Store, default_results

COMMANDS = (
    "methods",
    "tops",
    "potentials",
    "run",
    "report",
    "merge",
    "compare",
    "verify",
    "integrate",
    "check",
    "errata",
    "paper",
    "bits",
    "completion",
)
SLOW = (
    "numpy",
    "numba",
    "scipy",
    "matplotlib",
    "pandas",
    "heyoka",
    "mpmath",
    "rich",
    "jinja2",
    "multiprocessing",
    "distributed",
)
HERE = Path(__file__).resolve().parents[1]  # the tests, where toys are
SHORT = ("integrate", "--h", "0.1", "--steps", "20")


def process(*words, **settings):
    command = [sys.executable, "-m", "lagrange_bench", *words]
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60, **settings}
    return subprocess.run(command, cwd=HERE.parent, check=False, **settings)


# ---------------------------------------------------------------- help


def test_help_imports_nothing_slow():
    # what makes `--help` fast, without a clock: 0.1 s here, and pandas alone would take 0.3
    program = f"""
import sys
from lagrange_bench.__main__ import main
for command in ((), *((c,) for c in {COMMANDS!r})):
    assert main([*command, "--help"]) == 0
print("loaded:", sorted(set({SLOW!r}) & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.splitlines()[-1:] == ["loaded: []"], done.stderr


def examples(text):
    """The commands of a help text, as words."""
    lines = [re.split(r"[|>] ", line)[0] for line in text.splitlines() if line.startswith("  lagrange-bench ")]
    return [shlex.split(re.split(r"\s{2,}", line.strip())[0])[1:] for line in lines]


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_every_help_teaches(run, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = run(*([command] if command else []), "--help")
    assert (code, err) == (0, "")
    found = examples(out)
    assert 2 <= len(found) <= 5
    for words in found:  # they are understood; those of `integrate` are also run, below
        assert hasattr(cli.parser().parse_args(words), "run")


def test_the_bare_command_helps(run):
    code, out, err = run()
    assert (code, err) == (0, "")
    assert out == run("--help")[1]


def test_version(run):
    code, out, _ = run("--version")
    assert code == 0
    assert re.fullmatch(r"lagrange-bench \d+\.\d+\S*\n", out)


# ---------------------------------------------------------------- what is wrong, in one line

OWN = ("h", "steps", "every", "t", "top", "y0", "method", "attitude")  # of `integrate` itself
BAD = [  # words, what the line must name
    ("integrat", "unknown 'integrat'; did you mean 'integrate'?"),
    ("--versio", "did you mean '--version'? (see lagrange-bench --help)"),
    (
        "run drift --profil quick",
        "unknown argument '--profil'; did you mean '--profile'? (see lagrange-bench run --help)",
    ),
    ("run --profile fulll", "did you mean 'full'?"),
    ("figure", "the name of a figure"),
    ("figure phase_h --list", "the name of a figure"),
    ("methods --vebose", "--vebose"),
    ("run nothing", "'nothing'"),
    ("run no.such_module", "no.such_module"),
    ("run .", "unknown experiment '.'"),
    ("run ../x", "unknown experiment '../x'"),
    ("run .drift", "did you mean 'drift'?"),
    ("run --scheduler ucx://head:1", "--scheduler"),
    ("run --scheduler local:\u0661", "--scheduler"),
    ("run --shard \u0661/3", "--shard"),
    ("run --jobs 1_0", "--jobs"),
    ("verify --seed \u0661", "--seed"),
    ("verify --module no.such_module", "--module no.such_module"),
    ("run --jobs 0", "--jobs"),
    ("run --jobs two", "--jobs"),
    ("run --profile slow", "--profile"),
    ("run --time-limit 0", "--time-limit"),
    ("run --time-limit inf", "--time-limit"),
    ("run --time-limit soon", "--time-limit"),
    ("run --shard 3/3", "--shard"),
    ("run --shard 3", "--shard"),
    ("run --scheduler head", "--scheduler"),
    ("run --scheduler local:0", "--scheduler"),
    ("merge results/reference", "--results"),
    ("merge /no/such/folder --results /no/such/other", "/no/such/folder"),
    ("compare results/reference", "NEW"),
    ("compare results/reference /no/such/folder", "/no/such/folder"),
    ("compare a b --rtol -1", "--rtol"),
    ("compare a b --rtol x", "--rtol"),
    ("verify /no/such/folder", "/no/such/folder"),
    ("verify --sample 0", "--sample"),
    ("report --results /no/such/folder", "/no/such/folder"),
    ("report --output pyproject.toml", "pyproject.toml"),
    ("report --output pyproject.toml/page", "pyproject.toml"),
    ("report --output /proc/page", "/proc/page"),
    ("integrate", "--h"),
    ("integrate --h 0.1", "--steps"),
    ("integrate --h 0 --steps 3", "--h"),
    ("integrate --h inf --steps 3", "--h"),
    ("integrate --h 1_0 --steps 3", "--h"),
    ("integrate --h \u0661 --steps 3", "--h"),
    ("integrate --h 0.1 --steps 1_0", "--steps"),
    ("integrate --h 0.1 --steps 1e10 --every 1", "--steps: 10000000001 rows take about"),
    ("integrate --times 0:1:1e10", "--times: 0:1:1e10: 10000000000 rows take about"),
    ("integrate --h 0.1 --steps 2.5", "--steps"),
    ("integrate --h 0.1 --steps -3", "--steps"),
    ("integrate --h 0.1 --steps 1e300", "--steps"),
    ("integrate --h 0.1 --steps 10 --every 3", "--every"),
    ("integrate --h 0.1 --steps 10 --every 0", "--every"),
    ("integrate --h 0.1 --times 0,1", "--times"),
    ("integrate --times 0:1", "--times"),
    ("integrate --times 0:1:1", "--times"),
    ("integrate --times 0,nan", "--times"),
    ("integrate --times 0,1 --method backlund_paper", "--times"),
    ("integrate --times 0,1 --top generi", "did you mean 'generic'?"),
    ("integrate --times 0,1 --top generic --state 1,2,3,4,5,6", "--state"),
    ("integrate --times 0,1 --alpha 1", "--alpha"),
    ("integrate --times 0,1 --alpha 1e999 --state 1,2,3,4,5,6", "--alpha"),
    ("integrate --times 0,1 --state -1,2,3", "--state"),
    ("integrate --times 0,1 --state 1,2,3,0,0,0", "--state"),
    ("integrate --times 0,1 --state 1,2,3,4,5,x", "--state"),
    ("integrate --times 0,1 --physical mass=1", "distance"),
    ("integrate --times 0,1 --physical masss=1", "did you mean 'mass'?"),
    ("integrate --times 0,1 --physical mass=1,mass=2", "mass"),
    ("integrate --times 0,1 --physical mass=x", "mass"),
    ("integrate --times 0,1 --physical mass=-1,distance=1,A=1,C=1,theta=1,dpsi=3", "mass"),
    ("integrate --times 0,1 --method backlnd", "did you mean 'backlund'?"),
    ("integrate --times 0,1 --method json:loads", "json:loads"),
    ("integrate --times 0,1 --method no.such_module:METHOD", "no.such_module"),
    ("integrate --h 0.1 --steps 3 --option pim=3", "'pim'"),
    ("integrate --h 0.1 --steps 3 --option pin", "--option"),
    ("integrate --h 0.1 --steps 3 --option pin=1_0", "pin"),
    *((f"integrate --h 0.1 --steps 3 --option {name}=2", f"unknown option '{name}' of backlund") for name in OWN),
    ("integrate --h 0.1 --steps 3 --option pin=0.5", "pin"),
    ("integrate --h 0.1 --steps 3 --option lam=word", "lam"),
    ("integrate --h 0.1 --steps 3 --option lam=-1j", "lam"),
    ("integrate --h 0.1 --steps 3 --option pin=1 --option pin=2", "pin"),
    ("integrate --h 0.1 --steps 3 --output run.txt", "--output"),
    ("integrate --h 0.1 --steps 3 --output no/such/folder/run.csv", "--output"),
    ("integrate --h 0.1 --steps 3 --draw axis.gif", "--draw"),
    ("integrate --h 0.1 --steps 3 --animate axis.mp4", "--animate"),
    ("integrate --times 0,1 --parameters 1,2", "--parameters"),
    ("integrate --times 0,1 --potential tid", "did you mean 'tide'?"),
    ("integrate --times 0,1 --potential json:loads", "json:loads is a function, not an integrators.Potential"),
    ("integrate --times 0,1 --potential no.such_module:POTENTIAL", "no.such_module"),
    ("integrate --times 0,1 --potential tide", "4 numbers (k, n1, n2, n3); got 0"),
    ("integrate --times 0,1 --potential tide --parameters 1,x", "--parameters"),
    (
        "integrate --times 0,1 --potential tide --parameters 1,2,3,4,5",
        "the potential tide: 4 numbers (k, n1, n2, n3); got 5",
    ),
    (
        "integrate --times 0,1 --top magnet --potential dipole --parameters 1,0,0",
        "magnet is in the potential charge already",
    ),
    ("integrate --times 0,1 --top magnt --method dop853", "did you mean 'magnet'?"),
    ("integrate --h 0.1 --steps 3 --top magnet", "--method: backlund does not take the potential charge"),
    ("integrate --h 0.1 --steps 3 --top magnet", "lagrange-bench methods --top magnet"),
    ("integrate --times 0,1 --top magnet --method strang", "--times: strang"),
    (
        "integrate --h 0.1 --steps 3 --method rk4 --potential charge --parameters 1,0.48,0.6,0.64",
        "the potential charge is not finite",
    ),
    ("methods --top generi", "did you mean 'generic'?"),
    ("methods --parameters 1", "--parameters"),
    ("check nothing", "'nothing'"),
    ("verify one --results two", "give either DIR or --results DIR"),
    ("bits backlnd", "did you mean 'backlund'?"),
]


@pytest.mark.parametrize(("words", "named"), BAD, ids=[words for words, _ in BAD])
def test_bad_input(run, words, named, monkeypatch):
    monkeypatch.chdir(HERE.parent)
    monkeypatch.setattr("report.page.assemble", lambda *_: pytest.fail("drawn before it was known where to"))
    code, out, err = run(*words.split())
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: .*\n", err), err  # one line
    assert named in err


def test_a_method_that_fails(run):
    code, out, err = run("integrate", "--h", "1e300", "--steps", "3")
    assert (code, out) == (1, "")
    assert re.fullmatch(r"lagrange-bench: error: backlund at h = 1e\+300: .*\n", err)


def test_a_package_that_is_not_there(run, monkeypatch):
    monkeypatch.setattr(integrators, "available", lambda method: method.name != "backlund")
    monkeypatch.setattr(registry, "available", integrators.available)
    monkeypatch.setitem(vars(METHODS["backlund"]), "requires", "heyoka")
    code, out, err = run("methods")
    assert (code, err) == (0, "")
    assert out.count("conda-forge") == 1
    assert "backlund: heyoka is not installed here" in out
    code, _, err = run(*SHORT)
    assert code == 2
    assert "conda-forge" in err


def test_no_memory(run, monkeypatch):
    def integrate(*_, **__):
        raise MemoryError

    monkeypatch.setattr(integrators, "integrate", integrate)
    code, _, err = run(*SHORT)
    assert (code, err.count("\n")) == (1, 1)
    assert "--every" in err


def test_an_unexpected_error_is_not_hidden(run, monkeypatch):
    def integrate(*_, **__):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(integrators, "integrate", integrate)
    with pytest.raises(ZeroDivisionError):
        run(*SHORT)


# ---------------------------------------------------------------- stdout


def test_json_is_alone_on_stdout(tmp_path):
    # a library that chatters, on the C level and in Python, as heyoka does about its cache
    (tmp_path / "chatter.py").write_text(
        "import os\nfrom dataclasses import replace\nfrom integrators import METHODS\n"
        "def prepare(*a, **k):\n    print('python'); os.write(1, b'library\\n')\n"
        "    return METHODS['backlund'].prepare(*a, **k)\n"
        "METHOD = replace(METHODS['backlund'], prepare=prepare)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = process(*SHORT, "--method", "chatter:METHOD", "--json", env=environment)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["method"] == "backlund"
    assert sorted(done.stderr.split()) == ["library", "python"]


def test_closed_pipe():
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as stdout:
        done = process("methods", "--help", stdout=stdout)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("words", ["methods", "tops --json", "integrate --h 0.1 --steps 2 --output run.csv"])
@pytest.mark.parametrize("number", [1, 2])
def test_a_closed_stream(tmp_path, words, number):
    """As `lagrange-bench methods >&-`; what would be said on a closed stderr does not go to stdout."""
    line = f"exec {sys.executable} -W error -m lagrange_bench {words} {number}>&-"
    environment = {**os.environ, "PYTHONPATH": str(HERE.parent)}
    settings = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True, "timeout": 60}
    done = subprocess.run(["/bin/sh", "-c", line], check=False, **settings)
    written = "run.csv" in words
    assert done.returncode == 0, done.stderr
    assert done.stderr == ("written: run.csv\n" if written and number == 1 else "")
    assert (done.stdout == "") == (number == 1)
    assert "written" not in done.stdout
    assert not written or "J1,J2,J3" in (tmp_path / "run.csv").read_text()


def test_workers_of_a_run_with_closed_streams(tmp_path):
    line = f"exec {sys.executable} -W error -m lagrange_bench run paper --results {tmp_path} >&- 2>&-"
    assert subprocess.run(["/bin/sh", "-c", line], cwd=HERE.parent, timeout=60, check=False).returncode == 0
    assert len(Store(tmp_path).rows("paper")) > 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_stdout_on_a_full_disk():
    with open("/dev/full", "w") as stdout:
        done = process("methods", "--help", stdout=stdout)
    assert done.returncode == 2
    assert re.fullmatch(r"lagrange-bench: error: .*\n", done.stderr)


def test_a_terminal_without_greek():
    done = process("methods", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert r"B\xe4cklund" in done.stdout


# ---------------------------------------------------------------- methods and tops


@pytest.mark.parametrize("command", [("methods",), ("tops", "--verbose"), ("potentials",), ("check", "rk4", "--quick")])
def test_tables_fit_a_terminal(run, command, monkeypatch):
    wide = run(*command)[1]
    assert max(map(len, wide.splitlines())) > 80 or command[0] == "check"
    monkeypatch.setattr(text, "room", lambda: 80)
    narrow = run(*command)[1]
    lines = (
        narrow.splitlines()[:-2] if command[0] == "check" else narrow.splitlines()
    )  # the last two are not of the table
    assert max(map(len, lines)) <= 80
    assert sorted("".join(narrow.split())) == sorted("".join(wide.split())), "wrapped, and nothing is lost"


def test_methods(run, answer):
    code, out, err = run("methods", "--verbose")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[1 : len(METHODS) + 1]] == list(METHODS)
    assert METHODS["backlund"].source in out
    data = {method["name"]: method for method in answer("methods")}
    assert list(data) == list(METHODS)
    for name, method in METHODS.items():
        assert data[name]["order"] == method.order
        assert set(data[name]["conserves"]) == method.conserves
        assert data[name]["options"] == list(method.options)


@pytest.mark.parametrize(
    ("module", "why"),
    [("no_such_module", "ModuleNotFoundError: "), ("leaves", "ImportError: it calls sys.exit('no')")],
)
@pytest.mark.parametrize("known", [METHODS, POTENTIALS, NAMED_TOPS], ids=lambda known: known.word)
def test_a_plug_in_that_cannot_be_loaded_is_listed(run, answer, tmp_path, monkeypatch, known, module, why):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "leaves.py").write_text("raise SystemExit('no')\n")
    broken = registry.EntryPoint("broken", f"{module}:IT", known.group)
    monkeypatch.setitem(vars(known), "_entries", {**known._entries, "broken": broken})
    code, out, _ = run(f"{known.word}s")
    assert code == 0
    assert f"broken: cannot be loaded: {why}" in out
    listed = answer(f"{known.word}s")
    assert len(listed) == len(known)
    assert listed[-1]["error"].startswith(why)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("check", "leaves:METHOD", "--quick"), "method leaves:METHOD"),
        (("integrate", "--method", "leaves:METHOD", "--h", "0.1", "--steps", "1"), "method leaves:METHOD"),
        (
            ("integrate", "--potential", "leaves:WELL", "--h", "0.1", "--steps", "1"),
            "--potential: potential leaves:WELL",
        ),
        (("integrate", "--top", "leaves:TOP", "--h", "0.1", "--steps", "1"), "--top: top leaves:TOP"),
        (("methods", "--top", "leaves:TOP"), "--top: top leaves:TOP"),
        (("run", "phase", "--methods", "leaves:METHOD"), "method leaves:METHOD"),
        (("run", "mine.leaves"), "experiment 'mine.leaves'"),
        (("report", "--module", "leaves"), "--module leaves"),
    ],
)
def test_a_file_that_ends_the_process_is_named(run, tmp_path, monkeypatch, words, what):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    for path in ("leaves.py", "mine/leaves.py"):
        (tmp_path / path).write_text("import sys\n\nsys.exit(0)\n")
    code, out, err = run(*words)
    verb = "imported" if what.startswith("--module") else "loaded"
    assert (code, out) == (2, "")
    assert err == f"lagrange-bench: error: {what} cannot be {verb}: ImportError: it calls sys.exit(0)\n"


def test_tops(run, answer):
    code, out, _ = run("tops")
    assert code == 0
    above, below = out.split("\n\nin a potential:\n")
    assert TOPS["figure2"].note not in out
    assert TOPS["figure2"].note in run("tops", "--verbose")[1]
    assert [line.split()[0] for line in above.splitlines()[1:]] == list(TOPS)
    assert [line.split()[0] for line in below.splitlines()[1:]] == list(PERTURBED_TOPS)
    data = {top["name"]: top for top in answer("tops")}
    assert data["generic"]["nutation_period"] == pytest.approx(4.22213, abs=1e-5)
    assert data["homoclinic"]["nutation_period"] is None
    for name, top in TOPS.items():
        assert (data[name]["alpha"], data[name]["state"]) == (top.alpha, list(top.y0))

    for name, top in PERTURBED_TOPS.items():
        assert (data[name]["potential"], data[name]["parameters"]) == (top.potential.name, list(top.parameters))
        assert data[name]["state"] == list(top.y0)
    assert data["axisymmetric"]["conserves"] == ["H", "J3", "C1", "C2"]
    assert data["magnet"]["conserves"] == ["H", "C1", "C2"]


def test_potentials(run, answer):
    code, out, _ = run("potentials")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[1:]] == list(POTENTIALS)
    data = {potential["name"]: potential for potential in answer("potentials")}
    assert data["tide"]["parameters"] == ["k", "n1", "n2", "n3"]
    assert data["axisymmetric"]["parameters"] is None
    assert all("units of" in potential["note"] for potential in data.values())


def test_methods_of_a_top(run, answer):
    """Which take it, what they keep of it, and why the others do not."""
    code, out, err = run("methods", "--top", "magnet")
    assert (code, err) == (0, "")
    table, left_out = out.split("\nleft out: ", 1)
    taken = [line.split()[0] for line in table.splitlines()[1:]]
    top = PERTURBED_TOPS["magnet"].top
    assert taken == [name for name, method in METHODS.items() if method.takes(top) is None]
    assert "strang" in taken
    assert "theta_functions: does not take the potential charge: it is the closed form" in left_out
    data = {method["name"]: method for method in answer("methods", "--top", "magnet")}
    assert data["theta_functions"]["refuses"] == METHODS["theta_functions"].takes(top)
    assert (data["strang"]["refuses"], data["strang"]["conserves"]) == (None, ["C1", "C2"])
    words = ("methods", "--potential", "charge", "--parameters", "0.1,0,0,2")  # on the vertical: J3 stays
    assert {m["name"]: m for m in answer(*words)}["strang"]["conserves"] == ["J3", "C1", "C2"]
    assert not any(method["refuses"] for method in answer("methods", "--top", "generic"))
    assert "refuses" not in answer("methods")[0]


# ---------------------------------------------------------------- run, report, check


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("TOY_CELLS", json.dumps([{"do": "square", "i": 3}, {"do": "raise", "i": 4}]))
    return "toys.behaviour"


@pytest.mark.processes
def test_run(run, toy, tmp_path, monkeypatch):
    words = ("run", toy, "--results", tmp_path / "my results", "--jobs", "1")
    code, out, err = run(*words, "--quiet")
    assert (code, err) == (1, "")
    assert "cell 4 was told to" in out
    assert f"next: lagrange-bench report --results '{tmp_path / 'my results'}'" in out
    monkeypatch.setenv("TOY_CELLS", json.dumps([{"do": "square", "i": 3}]))
    code, out, _ = run(*words, "--json")
    assert code == 0
    assert json.loads(out)["experiments"][toy]["stored"] == 1


def test_run_takes_all_experiments_by_default(run, monkeypatch):
    asked = {}

    def instead(names, profile, results, jobs, show, **more):
        asked.update(names=names, profile=profile, results=results, jobs=jobs, show=show, **more)
        return engine.Summary(results, profile)

    monkeypatch.setattr(engine, "run", instead)
    assert run("run", "--profile", "full")[0] == 0
    assert asked["names"] == EXPERIMENTS
    assert (asked["profile"], asked["jobs"], asked["show"]) == ("full", None, True)
    assert asked["results"].name == "full"
    asked_nothing = {"time_limit": None, "shard": (0, 1), "scheduler": None, "timings": True}
    assert {name: asked[name] for name in asked_nothing} == asked_nothing
    assert run("run", "--time-limit", "9", "--shard", "2/5", "--scheduler", "local:2", "--no-timings")[0] == 0
    asked_this = {"time_limit": 9.0, "shard": (2, 5), "scheduler": "local:2", "timings": False}
    assert {name: asked[name] for name in asked_this} == asked_this


def test_run_stopped_or_without_a_place(run, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("in the way")
    code, out, err = run("run", "paper", "--results", tmp_path / "file" / "results")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: cannot write results to .*\n", err)

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "run", stopped)
    code, out, err = run("run", "paper", "--results", tmp_path)
    assert (code, out, err) == (130, "", "lagrange-bench: interrupted\n")


@pytest.mark.processes
def test_report(run, tmp_path):
    (tmp_path / "results").mkdir()
    words = ("report", "--results", tmp_path / "results", "--output", tmp_path / "page")
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: nothing is stored in .*\n", err)
    assert not (tmp_path / "page").exists(), "a page that is there is worth more"
    shutil.copy(default_results() / "paper.jsonl", tmp_path / "results")
    code, out, err = run(*words)
    assert code == 0, err
    assert err.splitlines()[0] == f"drawn from {tmp_path / 'results'}"
    page = Path(out.strip())
    assert page == (tmp_path / "page" / "index.html").resolve()
    assert page.stat().st_size > 1000
    (tmp_path / "file").write_text("in the way")
    code, out, err = run("report", "--results", tmp_path / "results", "--output", tmp_path / "file")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: .*\n", err)


STUDY = """
VERSION = 1
def cells(profile): return [{"i": i} for i in range(3)]
def measure(cell): return [{"square": cell["i"] ** 2}]
def tables(rows): return {}
def draw(rows):
    from lagrange_bench import style
    fig, ax = style.figure("column")
    ax.plot(rows.i, rows.square)
    return {"squares": fig}
"""


@pytest.mark.processes
def test_an_experiment_of_your_own_is_drawn_where_it_was_run(tmp_path):
    (tmp_path / "my_study").mkdir()
    (tmp_path / "my_study" / "energy.py").write_text(STUDY)
    tool = f"{sys.executable} -c 'import sys; from lagrange_bench.__main__ import main; sys.path.remove(\"\"); sys.exit(main())'"
    paths = os.pathsep.join(path for path in sys.path if path)

    def typed(line):
        line = line.replace("lagrange-bench", tool)
        environment = {**os.environ, "PYTHONPATH": f"{HERE.parent}{os.pathsep}{paths}", "PYTHONSAFEPATH": ""}
        return subprocess.run(
            line, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )

    out = typed("lagrange-bench run my_study.energy --results out").stdout
    after = re.search("^next: (.*)", out, re.MULTILINE)[1]
    page = Path(typed(f"{after} --output page").stdout.strip()).read_text(encoding="utf-8")
    assert "my_study.energy_squares" in page
    assert "cannot be loaded" not in page
    again = re.search(r"redraw: <code[^>]*>(.*?)</code>", page)[1]
    again = re.sub("<[^>]*>", "", again)
    assert again == "lagrange-bench figure my_study.energy_squares --results out --module my_study.energy"
    assert typed(again).stdout == "my_study.energy_squares.svg\n"


def test_figures_are_listed_and_completed(run, answer, tmp_path, monkeypatch):
    shutil.copy(default_results() / "ensemble.jsonl", tmp_path)
    listed = ["ensemble_throughput", "ensemble_rivals"]
    assert run("figure", "--list", "--results", tmp_path)[:2] == (0, "\n".join(listed) + "\n")
    (tmp_path / "page" / "figures").mkdir(parents=True)
    for name in listed:
        (tmp_path / "page" / "figures" / f"{name}.svg").touch()
    monkeypatch.setattr("results.store.default_results", lambda profile=None: tmp_path)
    assert set(listed) <= set(completion.names()["name"])


def test_report_opens_the_page(run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    shutil.copy(default_results() / "ensemble.jsonl", tmp_path)
    empty = page.Report([], [], page.NO_FAIRNESS, pd.DataFrame(), [], [], "", False)
    monkeypatch.setattr(page, "assemble", lambda *_: empty)
    code, out, _ = run("report", "--results", tmp_path, "--quiet", "--open")
    assert code == 0
    assert opened == [Path(out.strip()).as_uri()]


def test_a_figure_that_cannot_be_written_is_named(run, tmp_path):
    (tmp_path / "file").write_text("in the way")
    shutil.copy(default_results() / "ensemble.jsonl", tmp_path)
    target = tmp_path / "file" / "z.svg"
    code, _, err = run("figure", "ensemble_throughput", "--results", tmp_path, "--output", target)
    assert code == 2
    assert str(tmp_path / "file") in err
    assert ".z.svg" not in err


def test_a_picture_is_not_replaced_in_silence(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(default_results() / "ensemble.jsonl", tmp_path)
    drawn = ("figure", "ensemble_throughput", "--results", tmp_path)
    for words, file in ((drawn, "ensemble_throughput.svg"), (("paper", "separation"), "paper-separation.svg")):
        assert "replaced" not in run(*words)[2]
        code, _, err = run(*words)
        assert (code, err.splitlines().count(f"replaced: {file}")) == (0, 1)
    assert run(*drawn, "--quiet")[::2] == (0, "")


def test_a_cache_that_cannot_be_written_is_told_once(run, monkeypatch):
    compiled = sys.modules["integrators.compiling.compiled"]
    monkeypatch.setattr(compiled, "_folder", lambda module: None)
    monkeypatch.setenv("LAGRANGE_BENCH_CACHE", "/read/only")
    cli._note_cache.cache_clear()
    err = run("tops")[2]
    assert err.startswith("note: no compiled code can be kept in /read/only, where LAGRANGE_BENCH_CACHE points")
    assert run("tops")[::2] == (0, "")
    cli._note_cache.cache_clear()
    monkeypatch.setenv("LAGRANGE_BENCH_CACHE", "")  # as told
    assert run("tops")[::2] == (0, "")
    cli._note_cache.cache_clear()


def test_check_a_method_that_keeps_its_word(run):
    code, out, err = run("check", "backlund", "--quick")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["verdict", "claim", "measured", "bound"]
    assert any(line.startswith("pass") and "conserves H" in line for line in lines)
    assert re.fullmatch(r"backlund \(.*/methods/backlund.py\): \d+ claims hold, 0 fail", lines[-2])
    assert lines[-1] == "next: lagrange-bench run work_precision phase --methods backlund,rk4,strang"


def test_check_a_method_that_does_not(run, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    code, out, err = run("check", "toys.lies:METHOD", "--quick", "--json")
    assert (code, err) == (1, "")
    data = json.loads(out)
    assert (data["method"], data["passed"]) == ("lies", False)
    passed = {verdict["claim"]: verdict["passed"] for verdict in data["verdicts"]}
    false = {"order 2", "symmetric", "conserves H"}
    assert {claim for claim, kept in passed.items() if kept is False} == false
    # what is true of it is not refuted, and what it does not claim is not judged
    assert passed["Poisson map"]
    assert passed["conserves J3"]
    assert passed["conserves C2"] is None


def test_check_says_why_a_claim_fails_and_with_verbose_how_every_one_was_measured(run, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setattr(check, "CHECKS", (check.symmetric, check.poisson))
    out = run("check", "toys.lies:METHOD", "--quick")[1]
    assert re.search(r"^fail: symmetric: a step and its inverse, .*; largest on \w+, h = 3$", out, re.MULTILINE)
    assert "central differences" not in out
    assert "central differences" in run("check", "toys.lies:METHOD", "--quick", "--verbose")[1]


def test_check_finds_plug_ins(run, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    entries = {**METHODS._entries, "lies": registry.EntryPoint("lies", "toys.lies:METHOD", METHODS.group)}
    monkeypatch.setitem(vars(METHODS), "_entries", entries)
    monkeypatch.setattr(check, "CHECKS", (check.order,))
    code, out, _ = run("check", "lies")
    assert code == 1
    file = HERE / "toys" / "lies.py"
    assert out.splitlines()[-1] == f"lies (kick and rotation, {file}): 0 claims hold, 1 fail: order 2"


# ---------------------------------------------------------------- bits


@pytest.fixture
def written(monkeypatch):
    """What is written down of two kernels, as this machine computes it."""
    hashes = bits.measured(1000, ["rk4", "strang"])
    monkeypatch.setattr(bits, "golden", lambda: hashes)
    return hashes


def test_bits_that_are_the_same(run, answer, written):
    code, out, err = run("bits", "rk4", "--quick", "--python")
    assert (code, err) == (0, "")
    words = [line.split() for line in out.splitlines()]
    assert ["rk4", "interpreted", "6", "same"] in words
    assert ["rk4", "compensated", "compiled", "6", "same"] in words
    assert words[-1][:3] == ["4", "the", "same,"]
    assert run("bits", "rk4", "--quick", "--quiet")[1] == "2 the same, 0 differ, 0 not written down\n"
    data = answer("bits", "strang compensated", "--quick")
    assert [verdict["kernel"] for verdict in data["verdicts"]] == ["strang compensated"]


def test_bits_of_what_has_no_kernel(run, written):
    code, out, err = run("bits", "rk4", "dop853", "--quick")
    assert (code, out) == (2, "")
    assert "dop853 has no kernel of its own" in err


def test_bits_that_differ_or_are_not_written_down(run, written):
    written["rk4"]["figure1 1000"] = "0"
    del written["strang"]
    code, out, err = run("bits", "rk4", "strang", "--quick")
    assert (code, err) == (1, "")
    assert re.search(r"^rk4 +compiled +6 +differs at figure1 1000$", out, re.MULTILINE)
    assert re.search(r"^strang +compiled +0 +not written down$", out, re.MULTILINE)
    assert out.splitlines()[-1] == "2 the same, 1 differ, 1 not written down"


@pytest.mark.parametrize(
    "word", ["run", "report", "figure", "verify", "merge x", "compare x", "check rk4", "integrate"]
)
def test_an_empty_word_is_no_folder(run, tmp_path, monkeypatch, word):
    """$RESULTS, where it is not set, would be the current folder."""
    monkeypatch.chdir(tmp_path)
    flag = {"compare x": [], "check rk4": ["--write-bounds"], "integrate": ["--output"]}.get(word, ["--results"])
    code, out, err = run(*word.split(), *flag, "")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"argument {(flag or ['NEW'])[0]}: must name a file or folder; got an empty word" in err
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- completion

COMPLETED = [  # what is typed, some of what is offered, and what is not
    ("lagrange-bench integrate --top ", {"generic", "magnet"}, {"backlund"}),
    ("lagrange-bench methods --potential ", {"tide", "charge"}, {"generic"}),
    ("lagrange-bench ", {"run", "integrate", "completion"}, {"backlund", "--json"}),
    ("lagrange-bench -", {"--help", "--version"}, {"run"}),
    ("lagrange-bench in", {"integrate"}, {"run"}),
    ("lagrange-bench run ", {"drift", "phase"}, {"--jobs", "run"}),
    ("lagrange-bench run drift ph", {"phase"}, {"drift"}),
    ("lagrange-bench run --pro", {"--profile"}, {"--json"}),
    ("lagrange-bench run drift --profile ", {"quick", "full"}, {"drift"}),
    ("lagrange-bench integrate --method back", {"backlund", "backlund_paper"}, {"strang"}),
    ("lagrange-bench integrate --top fi", {"figure1", "figure2"}, {"generic"}),
    ("lagrange-bench check ba", {"backlund"}, {"figure1"}),
    ("lagrange-bench report --results ", {"tests"}, {"backlund", "--json"}),
    ("lagrange-bench report --methods ba", {"backlund"}, {"strang"}),
    ("lagrange-bench run --tops g", {"generic"}, {"backlund"}),
]


@pytest.fixture(scope="module")
def script():
    return process("completion", "bash").stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(("typed", "offered", "not_offered"), COMPLETED, ids=[typed for typed, *_ in COMPLETED])
def test_completion_in_bash(script, typed, offered, not_offered):
    program = f"{script}\nCOMP_WORDS=({typed.rstrip()}{' ' + chr(34) * 2 if typed.endswith(' ') else ''})\n"
    program += 'COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _shtab_lagrange_bench; printf "%s\\n" "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-u", "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    words = set(done.stdout.split())
    assert offered <= words
    assert not not_offered & words


@pytest.mark.skipif(shutil.which("fish") is None, reason="needs fish")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("comp", {"compare", "completion"}),
        ("run --sch", {"--scheduler"}),
        ("integrate --method gauss", {"gauss4", "gauss6", "gauss8", "gauss12"}),
        ("figure --format ", {"svg", "pdf", "png"}),
    ],
)
def test_completion_in_fish(run, tmp_path, typed, offered):
    program = f"{run('completion', 'fish')[1]}\ncomplete -C 'lagrange-bench {typed}'"
    home = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(["fish", "-c", program], capture_output=True, text=True, env=home, cwd=tmp_path, check=True)
    assert {line.split("\t")[0] for line in done.stdout.splitlines()} == offered


NEEDED = {  # of these commands, for them to be understood
    "merge": ("a", "--results", "b"),
    "compare": ("a", "b"),
    "check": ("rk4",),
    "completion": ("bash",),
}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_every_option(run, shell):
    code, out, err = run("completion", shell)
    assert (code, err) == (0, "")
    for module in cli.COMMANDS:
        name = module.__name__.rpartition(".")[2]
        assert name in out
        for flag in cli.parser().parse_args([name, *NEEDED.get(name, ())]).flags:
            assert flag.lstrip("-") in out or len(flag) == 2
    if syntax := shutil.which(shell):
        assert subprocess.run([syntax, "-n"], input=out, capture_output=True, text=True, check=False).stderr == ""
