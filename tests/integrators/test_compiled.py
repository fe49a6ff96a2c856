"""Compilation and its cache: a cache that cannot be written is no reason to fail."""

import os
import resource
import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes

STEP = """
from integrators import TOPS, integrate
named = TOPS["generic"]
print(integrate(named.top, named.state, 0.1, 10, "rk45_fixed").y[-1])
"""


def run(folder, **limits):
    def restrict():
        for name, value in limits.items():
            resource.setrlimit(getattr(resource, name), (value, value))

    environment = {**os.environ, "LAGRANGE_BENCH_CACHE": str(folder)}
    command = [sys.executable, "-c", STEP]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, preexec_fn=restrict, check=False, timeout=120
    )


def test_a_full_disk_or_no_folder_changes_nothing(tmp_path):
    """File size limited to 4 kB, a file in place of the folder, no cache at all: the same states."""
    (tmp_path / "file").touch()
    limited = run(tmp_path / "limited", RLIMIT_FSIZE=4096)
    assert limited.returncode == 0, limited.stderr
    assert limited.stderr == ""
    for folder in (tmp_path / "file", ""):
        assert run(folder).stdout == limited.stdout


def test_a_second_process_finds_the_code_of_the_first(tmp_path):
    first = run(tmp_path)
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}
    second = run(tmp_path)
    assert first.stdout == second.stdout
    assert len(kept) >= 3  # the step, the addition in it, the loop around it
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")} == kept
