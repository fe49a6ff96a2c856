"""Compilation and its cache: it is never stale, and it may fail to be written."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from lagrange_bench import integrators
from lagrange_bench.integrators.compiling import numba_internals

PACKAGE = Path(integrators.__file__).parent


pytestmark = pytest.mark.processes

STEP = """
from lagrange_bench.integrators import TOPS, integrate
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


# the end of the run of each method; with the numbers of functions as Numba counts them, if it is asked to
METHODS_ONE_BY_ONE = """
import itertools, sys
import numba
from lagrange_bench.integrators import TOPS, integrate
from lagrange_bench.integrators.compiling import numba_internals
if sys.argv[1] == "counted":
    numba.core.bytecode.FunctionIdentity._unique_ids = itertools.count(1)
named = TOPS["generic"]
for name in sys.argv[2:]:
    print(name, integrate(named.top, named.state, 0.3, 20, name).y[-1].tolist())
"""


@pytest.mark.parametrize("numbers", ["random", "counted"])
def test_code_that_two_processes_kept_is_told_apart_by_a_third(tmp_path, numbers):
    """Two loops of one source: with Numba's own numbers for functions, the first that is loaded runs for both.

    The third finds all that the others kept: it writes nothing.
    """

    def run(*names):
        environment = {**os.environ, "LAGRANGE_BENCH_CACHE": str(tmp_path)}
        command = [sys.executable, "-c", METHODS_ONE_BY_ONE, numbers, *names]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def kept():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}

    alone = run("rk4")
    assert len(kept()) >= 3  # the step, the addition in it, the loop around it
    alone += run("rk45_fixed")
    before = kept()
    assert (run("rk4", "rk45_fixed") == alone) == (numbers == "random")
    assert numbers != "random" or kept() == before


def test_two_that_keep_their_code_at_once_do_not_take_each_others(tmp_path):
    """Of one source and two closures. Numba numbers the files of a cache: both would write number 1."""

    def made(value):
        def kernel(x):
            return x + value

        return numba_internals.keep_code(numba.njit(cache=True), kernel, str(tmp_path))

    first, second = made(1.0), made(2.0)
    mine, other = first._cache._cache_file, second._cache._cache_file
    save_data = mine._save_data

    def late(name, data):  # the other one has read the index before this one wrote it, and saves everything now
        other._load_index = dict
        assert second(0.0) == 2.0
        save_data(name, data)

    mine._save_data = late
    assert first(0.0) == 1.0
    assert (made(1.0)(0.0), made(2.0)(0.0)) == (1.0, 2.0)


# a kernel that calls an outlined function: its result, whether it holds that function's division, and whether it came
# from the cache
OUTLINED = """
from lagrange_bench.integrators.compiling import interpreted
from lagrange_bench.integrators.compiling.compiled import jit_as
from lagrange_bench.integrators.compiling.interpreted import outlined
from lagrange_bench.integrators.compiling.numba_internals import stack

def cube(numbers):
    numbers[1] = numbers[0] ** 3 / 7.5
    return 2

def made():
    call = outlined(cube, "cube")
    @jit_as("caller")
    def caller(x):
        numbers = stack(2)
        numbers[0] = x
        found = call(numbers)
        return found * numbers[1]
    return caller

def report():
    caller = made()
    assert len({caller(3.0) for _ in range(100 * interpreted.OFTEN + 2)}) == 1  # interpreted at first, then compiled
    print(caller(3.0), "fdiv" in caller.inspect_llvm(caller.signatures[0]), sum(caller.stats.cache_hits.values()))
"""


def test_an_outlined_function_is_called_by_kernels_out_of_the_cache(tmp_path):
    (tmp_path / "outlining.py").write_text(OUTLINED, encoding="utf-8")
    environment = {**os.environ, "LAGRANGE_BENCH_CACHE": str(tmp_path / "cache")}

    def run(before="", **settings):
        command = [sys.executable, "-c", f"{before}import outlining; outlining.report()"]
        done = subprocess.run(
            command, env={**environment, **settings}, cwd=tmp_path, capture_output=True, text=True, timeout=120
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    assert run() == ["7.2", "False", "0"]
    other_types_first = "from numba import types; types.UniTuple(types.float64, 77); "  # Numba numbers its types
    assert run(other_types_first) == ["7.2", "False", "1"]
    checked = "0" if os.environ.get("NUMBA_BOUNDSCHECK") else "1"
    assert run(NUMBA_BOUNDSCHECK=checked) == ["7.2", "False", "0"]  # other machine code, so not that of the cache


# a kernel of `methods` that calls one of `torus`: its result, and how many of its variants came from the cache. (Where a
# closure calls it, Numba sees for itself that a callee has changed.)
CALLER = """
from lagrange_bench.integrators.methods.theta_functions import largest_root
print(largest_root((-1.0, 0.0), (-1.0, 0.0), (0.5, 0.0))[0].hex())
print(sum(largest_root.stats.cache_hits.values()))
"""
EDIT = """
import re
from pathlib import Path
from lagrange_bench.integrators.torus import time_step
source = Path(time_step.__file__)
text = source.read_text()
edited = re.sub(r"(def cubic_root.*?return) root\\n", r"\\1 scale(root, 2.0)\\n", text, count=1, flags=re.DOTALL)
assert edited != text
source.write_text(edited)
"""


def test_an_edited_callee_in_another_room_is_compiled_again(tree):
    """And no other is: a run after an edit elsewhere takes its code from the cache.

    The process that edits has imported the callee, and not yet the caller: it keeps nothing.
    """
    environment = {**os.environ, "PYTHONPATH": str(tree), "LAGRANGE_BENCH_CACHE": str(tree / "cache")}

    def run(before=""):
        command = [sys.executable, "-c", before + CALLER]
        done = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    root, hits = run()
    assert hits == "0"
    with (tree / "lagrange_bench" / "integrators" / "methods" / "kahan.py").open("a", encoding="utf-8") as unrelated:
        unrelated.write("# edited\n")
    assert run() == [root, "1"]
    assert run(EDIT) == [root, "0"]
    doubled, hits = run()
    assert float.fromhex(doubled) == 2 * float.fromhex(root)
    assert hits == "0"
