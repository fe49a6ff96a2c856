"""`lagrange-bench completion`: a shell offers what there is."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from lagrange_bench import __main__ as cli
from tests.test_docs import commands

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
