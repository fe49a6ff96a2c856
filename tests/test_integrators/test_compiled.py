"""Compilation and its cache: it is never stale, it may fail to be written, and Numba is asked for what it rests on."""

import os
import resource
from functools import partial

import numba
import numpy as np
import pytest

from lagrange_bench.integrators.compiling import interpreted, numba_internals
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.compiling.loops import FixedStepper, KernelError
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


# a kernel of `methods` that calls one of `torus`: its result, and how many of its variants came from the cache. (Where a
# closure calls it, Numba sees for itself that a callee has changed.)
CALLER = """
from lagrange_bench.integrators.methods.addition_theorem import cubic
print(cubic(1.0, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))[0][0].hex())
print(sum(cubic.stats.cache_hits.values()))
"""


def test_a_full_disk_or_no_folder_changes_nothing(tmp_path):
    """File size limited to 4 kB, a file in place of the folder, no cache at all: the same number, compiled each time."""
    (tmp_path / "file").touch()
    limited = python(CALLER, cache=tmp_path / "limited", limit=4096)
    for folder in (tmp_path / "file", ""):
        assert python(CALLER, cache=folder) == limited


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


@pytest.mark.parametrize("numbers", ["random", pytest.param("counted", marks=pytest.mark.slow)])
def test_code_that_two_processes_kept_is_told_apart_by_a_third(tmp_path, numbers):
    """Two loops of one source: with Numba's own numbers for functions, the first that is loaded runs for both.

    The third finds all that the others kept: it writes nothing.
    """

    def run(*names):  # without bounds checked: the wrong loop reads beyond the constants of the right one
        return python(METHODS_ONE_BY_ONE, numbers, *names, cache=tmp_path, NUMBA_BOUNDSCHECK="0")

    def kept():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}

    alone = run("rk4")
    assert len(kept()) >= 3  # the step, the addition in it, the loop around it
    alone += run("rk45_fixed")
    before = kept()
    assert (run("rk4", "rk45_fixed") == alone) == (numbers == "random")
    assert numbers != "random" or kept() == before


# a callee that needs its environment in Python: Numba has it in each function, we in what callees are linked into
CALLEE = """
from lagrange_bench.integrators.compiling.compiled import jit

@jit
def callee(x):
    if x > 1.0:
        raise ValueError("too large")
    print("callee", x)
    return 2.0 * x

@jit
def caller(x):
    return callee(x) + 1.0

def report():
    print(caller(0.5), callee(0.25))
    try:
        caller(3.0)
    except ValueError as error:
        print(error)
"""


def test_a_callee_prints_and_raises_in_compiled_callers_and_from_python(tmp_path):
    (tmp_path / "called.py").write_text(CALLEE, encoding="utf-8")
    for _ in range(2):  # compiled, then out of the cache
        printed = python("import called; called.report()", cache=tmp_path / "cache", cwd=tmp_path)
        assert printed.split("\n") == ["callee 0.5", "callee 0.25", "2.0 0.5", "too large", ""]


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

    def run(before="", **settings):
        code = f"{before}import outlining; outlining.report()"
        return python(code, cache=tmp_path / "cache", cwd=tmp_path, **settings).split()

    assert run() == ["7.2", "False", "0"]
    other_types_first = "from numba import types; types.UniTuple(types.float64, 77); "  # Numba numbers its types
    assert run(other_types_first) == ["7.2", "False", "1"]
    checked = "0" if os.environ.get("NUMBA_BOUNDSCHECK") else "1"
    assert run(NUMBA_BOUNDSCHECK=checked) == ["7.2", "False", "0"]  # other machine code, so not that of the cache


EDIT = """
from pathlib import Path
from lagrange_bench.integrators.torus import time_step
source = Path(time_step.__file__)
text = source.read_text()
edited = text.replace("return c1, scale(c2, 2.0), h2,", "return c1, scale(c2, 2.0), scale(h2, 2.0),")
assert edited != text
source.write_text(edited)
"""


def test_an_edited_callee_in_another_room_is_compiled_again(tree):
    """And no other is: a run after an edit elsewhere takes its code from the cache.

    The process that edits has imported the callee, and not yet the caller: what it keeps is of the callee as it was.
    """

    def run(before=""):
        return python(before + CALLER, cache=tree / "cache", cwd=tree, PYTHONPATH=str(tree)).splitlines()

    energy, hits = run()
    assert hits == "0"
    with (tree / "lagrange_bench" / "integrators" / "methods" / "kahan.py").open("a", encoding="utf-8") as unrelated:
        unrelated.write("# edited\n")
    assert run() == [energy, "1"]
    assert run(EDIT) == [energy, "0"]
    doubled, hits = run()
    assert float.fromhex(doubled) == 2 * float.fromhex(energy)
    assert hits == "0"


OFTEN = 10

# last states of runs that begin one after the other, and which of them found the set-up compiled
RUNS = """
import sys
from lagrange_bench import *  # also what measures times, for which all is compiled at once
from lagrange_bench.integrators import PERTURBED_TOPS, TOPS
from lagrange_bench.integrators.compiling.interpreted import OFTEN
from lagrange_bench.integrators.methods import backlund
method = sys.argv[1]
named, h = (TOPS["generic"], 20.0) if method == "backlund" else (PERTURBED_TOPS["weak_tide"], 0.1)
ends = [integrate(named.top, named.y0, h, 20, method).y[-1].tobytes().hex()]
print(bool(backlund.run.overloads), bool(backlund.real_map.exact_constants.overloads))
ends += [integrate(named.top, named.y0, h, 20, method).y[-1].tobytes().hex() for _ in range(OFTEN)]
print(ends[0], len(set(ends)))
print(bool(backlund.run.overloads))
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["backlund", "backlund_splitting"])
def test_the_first_run_waits_for_no_set_up_to_compile_and_has_the_same_bits(tmp_path, method):
    first, second = (python(RUNS, method, cache=tmp_path).splitlines() for _ in range(2))
    assert first[0] == "False False"
    assert first[1].endswith(" 1")
    assert second[1] == first[1]
    if method == "backlund":
        assert first[2] == "True"
        assert second[0].startswith("True")  # out of the cache, from the first call on


def test_where_python_raises_compiled_code_begins_anew(monkeypatch):
    """And finds its arrays as they were."""
    monkeypatch.setattr(interpreted, "OFTEN", OFTEN)  # 0 where times are measured

    @compiled
    def divided(a, x):
        a[0] += 1.0
        a[0] += 1.0 / x
        return 2.0 * a[0]

    call, a = at_first_interpreted(divided), np.zeros(1)
    assert (call(a, 0.5), a[0], len(divided.overloads)) == (6.0, 3.0, 0)
    assert (call(a, 0.0), a[0], len(divided.overloads)) == (np.inf, np.inf, 1)


def test_kernels_that_cannot_be_compiled_are_refused():
    def plain(s, c, tally):
        return s[:5]

    with pytest.raises(ValueError, match=r"^the kernel plain is not compiled: put @compiled above it$"):
        FixedStepper("mine", 0.5, np.ones(1), plain)
    with pytest.raises(KernelError, match=r"^the kernel plain cannot be compiled: "):
        FixedStepper("mine", 0.5, np.ones(1), compiled(plain))
