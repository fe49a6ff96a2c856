"""The command line: it teaches, says in one line what is wrong, and keeps every bit."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from lagrange_bench import __main__ as cli
from lagrange_bench import integrators
from lagrange_bench.integrators import METHODS, registry

COMMANDS = tuple(module.__name__.rpartition(".")[2] for module in cli.COMMANDS)
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
    ("run --jobs 1_0", "--jobs"),
    ("verify --seed \u0661", "--seed"),
    ("errata --seed 1_0", "--seed"),
    ("verify --module no.such_module", "--module no.such_module"),
    ("run --jobs 0", "--jobs"),
    ("run --jobs two", "--jobs"),
    ("run --profile slow", "--profile"),
    ("run --time-limit 0", "--time-limit"),
    ("run --time-limit inf", "--time-limit"),
    ("run --time-limit soon", "--time-limit"),
    ("run --scheduler head", "--scheduler"),
    ("run --scheduler local:0", "--scheduler"),
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
    ("integrate --times 0,1 --parameters 1,2", "--parameters"),
    ("integrate --times 0,1 --potential tid", "did you mean 'tide'?"),
    ("integrate --times 0,1 --potential json:loads", "json:loads is a function, not a lagrange_bench.Potential"),
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
    monkeypatch.setattr(
        "lagrange_bench.report.page.assemble", lambda *_: pytest.fail("drawn before it was known where to")
    )
    code, out, err = run(*words.split())
    assert (code, out) == (2, "")
    assert re.fullmatch(r"lagrange-bench: error: .*\n", err), err  # one line
    assert named in err


@pytest.mark.parametrize("word", ["run", "report", "figure", "verify", "compare x", "integrate"])
def test_an_empty_word_is_no_folder(run, tmp_path, monkeypatch, word):
    """$RESULTS, where it is not set, would be the current folder."""
    monkeypatch.chdir(tmp_path)
    flag = {"compare x": [], "integrate": ["--output"]}.get(word, ["--results"])
    code, out, err = run(*word.split(), *flag, "")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"argument {(flag or ['NEW'])[0]}: must name a file or folder; got an empty word" in err
    assert list(tmp_path.iterdir()) == []


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
        "import os\nfrom dataclasses import replace\nfrom lagrange_bench import METHODS\n"
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


def test_a_cache_that_cannot_be_written_is_told_once(run, monkeypatch):
    compiled = sys.modules["lagrange_bench.integrators.compiling.compiled"]
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
