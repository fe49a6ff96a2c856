"""Compilation and its cache: it is never stale, it may fail to be written, and Numba is asked for what it rests on."""

import io
import os
import pickle
import resource
import sys
from functools import partial

import numba
import numpy as np
import pytest

from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.compiling import interpreted
from lagrange_bench.integrators.compiling.compiled import _sources, compiled, jit
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.problem import kirchhoff
from lagrange_bench.integrators.registry import find_top
from lagrange_bench.support import announce, source_digest
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


# a kernel of `methods` that calls one of `torus`: a number of its result, and how many of its variants came from the cache
CALLER = """
from lagrange_bench.integrators.methods.backlund_kernel import exact_flow
print(exact_flow((0.1, 0.2, 0.3, 0.4, 0.5, 0.6), 1.0, 0.1)[0][0].hex())
print(sum(exact_flow.stats.cache_hits.values()))
"""


def test_a_full_disk_or_no_folder_changes_nothing(tmp_path):
    """File size limited to 4 kB, or a file in place of the folder: the same number, compiled each time."""
    (tmp_path / "file").touch()
    assert python(CALLER, cache=tmp_path / "file") == python(CALLER, cache=tmp_path / "limited", limit=4096)


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


EDIT = """
from pathlib import Path
from lagrange_bench.integrators.torus import plain_step
source = Path(plain_step.__file__)
text = source.read_text()
edited = text.replace("return J1 + d1, J2 + d2,", "return 2.0 * (J1 + d1), J2 + d2,")
assert edited != text
source.write_text(edited)
"""


def test_an_edited_callee_in_another_room_is_compiled_again(tree):
    """And no other is: a run after an edit elsewhere takes its code from the cache.

    The process that edits has imported the callee, and not yet the caller: what it keeps is of the callee as it was.
    """

    def run(before="", **settings):
        return python(before + CALLER, cache=tree / "cache", cwd=tree, PYTHONPATH=str(tree), **settings).splitlines()

    number, hits = run()
    assert hits == "0"
    with (tree / "lagrange_bench" / "integrators" / "methods" / "kahan.py").open("a", encoding="utf-8") as unrelated:
        unrelated.write("# edited\n")
    assert run() == [number, "1"]
    assert run(EDIT) == [number, "0"]
    doubled, hits = run()
    assert float.fromhex(doubled) == 2 * float.fromhex(number)
    assert hits == "0"


def test_kept_code_depends_on_kernels_that_come_as_arguments(monkeypatch):
    """`loops` imports no problem; its steps are made of their formulas. With bounds checked it is other code."""
    files, place, path = (
        source_digest.IMPORTED_SOURCES,
        "lagrange_bench.integrators.compiling.loops",
        kirchhoff.__file__,
    )
    digests = []
    for text in (files.read(path), b"# edited"):
        monkeypatch.setitem(files.content, path, text)
        monkeypatch.setattr(files, "known", {})
        digests.append(_sources(place))
    assert None not in digests
    monkeypatch.setattr(files, "known", {})
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 7)
    assert len({*digests, _sources(place)}) == 3


def test_where_python_raises_compiled_code_begins_anew(monkeypatch):
    """And finds its arrays as they were."""
    monkeypatch.setattr(interpreted, "PATIENCE", 10.0)  # 0 where times are measured

    @compiled
    def divided(a, x):
        a[0] += 1.0
        a[0] += 1.0 / x
        return 2.0 * a[0]

    call, a = at_first_interpreted(divided), np.zeros(1)
    assert (call(a, 0.5), a[0], len(divided.overloads)) == (6.0, 3.0, 0)
    assert (call(a, 0.0), a[0], len(divided.overloads)) == (np.inf, np.inf, 1)


def test_what_has_been_interpreted_for_long_is_compiled(monkeypatch):
    monkeypatch.setattr(interpreted, "PATIENCE", 1e-6)

    @compiled
    def half(x):
        return 0.5 * x

    call = at_first_interpreted(half)
    assert (call(1.0), len(half.overloads)) == (0.5, 0)
    assert (call(1.0), len(half.overloads)) == (0.5, 1)


class Terminal(io.StringIO):
    """A stream where a person reads."""

    def isatty(self):
        return True


def test_a_person_is_told_of_long_compiling_once(monkeypatch):
    monkeypatch.setattr(announce, "LONG", 0.0)

    @compiled
    def inner(x):
        return x + 1.0

    @compiled
    def outer(x):
        return inner(x) + 1.0

    for stream, quiet, said in (
        (Terminal(), False, "compiling: 0 s\n"),
        (Terminal(), True, ""),
        (io.StringIO(), False, ""),
    ):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(announce, "quiet", quiet)
        kind = {"": complex, "compiling: 0 s\n": float}[said]
        outer(kind(1.0) if not quiet else 1)
        assert stream.getvalue() == said


def test_compilation_switched_off_later_changes_nothing(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)

    @jit
    def half(x):
        return 0.5 * x

    assert half(1.0) == 0.5
    assert len(half.overloads) == 1


# what a process prints that gets a stepper and its state
ARRIVED = """
import pickle, sys
stepper, y0 = pickle.loads(bytes.fromhex(sys.argv[1]))
print(stepper.advance(y0, 10).tobytes().hex())
"""


def test_steppers_of_kernels_go_to_other_processes(tmp_path):
    found = find_top("weak_tide")
    stepper = prepare(found.top, found.y0, 0.1, "strang")
    sent = pickle.dumps((stepper, np.array(found.y0))).hex()
    assert python(ARRIVED, sent, cache=tmp_path).strip() == stepper.advance(found.y0, 10).tobytes().hex()
