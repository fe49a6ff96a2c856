"""`lagrange-bench completion`: a shell offers what there is."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from test_cli import process

from lagrange_bench import __main__ as cli

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
    "compare": ("a", "b"),
    "check": ("rk4",),
    "completion": ("bash",),
    "judge": ("a.csv", "--case", "bruels"),
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
