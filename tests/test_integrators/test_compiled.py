"""Compilation and its cache: it is never stale, it may fail to be written, and damaged files are not loaded."""

import io
import os
import resource
import sys
from functools import partial

import numba
import pytest

from lagrange_bench.integrators.compiling.compiled import compiled, jit
from lagrange_bench.support import announce
from tests import faults

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled"),
]


def python(code, *words, cache, cwd=None, limit=None, **settings):
    """What a process of its own prints; `limit` on the size of files."""
    environment = {**os.environ, "LAGRANGE_BENCH_CACHE": str(cache), **settings}
    restrict = limit and partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
    done = faults.python("-c", code, *words, env=environment, cwd=cwd, preexec_fn=restrict, timeout=300)
    assert done.returncode == 0, done.stderr
    assert not limit or done.stderr == ""
    return done.stdout


# a small kernel: its result
SMALL = """
from lagrange_bench.integrators.methods.theta_functions import angle_of_periods
print(angle_of_periods(3.0, 0.1, 1e-20).hex())
"""


def test_a_full_disk_or_no_folder_changes_nothing(tmp_path):
    """File size limited to 4 kB, or a file in place of the folder: the same number, compiled each time."""
    (tmp_path / "file").touch()
    assert python(SMALL, cache=tmp_path / "file") == python(SMALL, cache=tmp_path / "limited", limit=4096)


# the end of the run of each method
METHODS_ONE_BY_ONE = """
import sys
from lagrange_bench.integrators import TOPS, integrate
named = TOPS["generic"]
for name in sys.argv[1:]:
    print(name, integrate(named.top, named.state, 0.3, 20, name).y[-1].tolist())
"""


def test_code_that_two_processes_kept_is_told_apart_by_a_third(tmp_path):
    """Two loops of one source: Numba counts functions, so both have one number, and by one name the first would run for both.

    The third finds all that the others kept: it writes nothing.
    """

    def run(*names):  # without bounds checked: the wrong loop reads beyond the constants of the right one
        return python(METHODS_ONE_BY_ONE, *names, cache=tmp_path, NUMBA_BOUNDSCHECK="0")

    def kept():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}

    alone = run("rk4")
    assert len(kept()) >= 3  # the step, the addition in it, the loop around it
    alone += run("rk45_fixed")
    before = kept()
    assert run("rk4", "rk45_fixed") == alone
    assert kept() == before


KERNELS = {  # of two rooms
    "torus/callee.py": "@jit\ndef callee(x):\n    return x * x\n",
    "methods/caller.py": "from ..torus.callee import callee\n\n@jit\ndef caller(x):\n    return callee(x) * 2.0\n",
}
# a number, and how many variants of the caller came from the cache
CALL = """
from lagrange_bench.integrators.methods.caller import caller
print(caller(3.0), sum(caller.stats.cache_hits.values()))
"""
EDIT = """
from pathlib import Path
from lagrange_bench.integrators.torus import callee
source = Path(callee.__file__)
source.write_text(source.read_text().replace("x * x", "x + x"))
"""


def test_an_edited_callee_in_another_room_is_compiled_again(tree):
    """The process that edits has imported the callee, and not yet the caller: it saves nothing."""
    integrators = tree / "lagrange_bench" / "integrators"
    for file, kernel in KERNELS.items():
        (integrators / file).write_text(f"from lagrange_bench.integrators.compiling.compiled import jit\n{kernel}")

    def run(before=""):
        return python(before + CALL, cache=tree / "cache", cwd=tree, PYTHONPATH=str(tree)).split()

    assert run() == ["18.0", "0"]
    assert run() == ["18.0", "1"]
    assert run(EDIT) == ["18.0", "0"]
    assert run() == ["12.0", "0"]
    assert run() == ["12.0", "1"]


DAMAGES = (
    ("nbi", lambda content: b""),
    ("nbi", lambda content: content[: len(content) // 2]),
    ("nbc", lambda content: content[: len(content) // 2]),
    ("nbc", lambda content: bytes(byte ^ 0x5A for byte in content)),
)


def test_damaged_machine_code_is_compiled_anew(tmp_path):
    """Numba would end in a raw error, or in a segmentation fault."""

    def run():
        return python(SMALL + "print(sum(angle_of_periods.stats.cache_hits.values()))", cache=tmp_path).split()

    number, hits = run()
    assert hits == "0"
    for kind, damage in DAMAGES:
        damaged = list(tmp_path.rglob(f"*.{kind}"))
        assert damaged
        for file in damaged:
            file.write_bytes(damage(file.read_bytes()))
        assert run() == [number, "0"]
    assert run() == [number, "1"], "the cache is whole again"


@pytest.mark.parametrize(("person", "said"), [(True, "compiling …\n"), (False, "")])
def test_a_person_is_told_of_long_compiling_once(person, said, monkeypatch):
    @compiled
    def inner(x):
        return x + 1.0

    @compiled
    def outer(x):
        return inner(x) + 1.0

    stream = io.StringIO()
    monkeypatch.setattr(announce, "LONG", 0.0)
    monkeypatch.setattr(stream, "isatty", lambda: person)
    monkeypatch.setattr(sys, "stderr", stream)
    outer(1.0)
    assert stream.getvalue() == said


def test_compilation_switched_off_later_changes_nothing(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)

    @jit
    def half(x):
        return 0.5 * x

    assert half(1.0) == 0.5
    assert len(half.overloads) == 1
