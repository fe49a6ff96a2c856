"""The digest stored with a row: of all the code that computes it, as it was imported; and of nothing else."""

import importlib
import os
import sys
from pathlib import Path

import pytest
from faults import python

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.imported import Sources
from lagrange_bench.results import sources
from lagrange_bench.results.store import cell_key

ROOT = Path(__file__).resolve().parents[2]
CELLS = {(e, m) for e in ("drift", "phase") for m in ("rk4", "kahan", "bobenko_suris", "backlund", "taylor")}


INTERPRETED = """
import sys
from lagrange_bench.experiments import drift
from lagrange_bench.integrators import METHODS, LagrangeTop, available, imported
from lagrange_bench.results import sources

tried = 0
for method in (name for name in METHODS if available(METHODS[name]) and METHODS[name].takes(LagrangeTop()) is None):
    called, cell = set(), {"part": "h", "method": method, "state": "generic", "span": 1, "h": 0.25}
    sys.setprofile(lambda frame, event, _: called.add(frame.f_code.co_filename))
    drift.measure(cell)
    sys.setprofile(None)
    homes = {module.__file__: name for name, module in sys.modules.items() if getattr(module, "__file__", None)}
    ours = {homes[file] for file in called if homes.get(file, "").partition(".")[0] == imported.BENCH}
    ours = {name for name in ours if not imported.NO_ROW.fullmatch(name)}
    found = imported.IMPORTED.files({"lagrange_bench.experiments.drift", METHODS.module(method)})
    assert ours <= set(found), (method, ours - set(found))
    assert METHODS.module(method) in ours or METHODS[method].requires, "negative control"
    assert sources.of_cell("drift", cell)
    tried += 1
print(tried)
"""


def printed(folder, program, **environment):
    done = python("-c", program, cwd=folder, env={**os.environ, "PYTHONPATH": str(folder), **environment})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_measuring_calls_is_in_the_digest():
    """With kernels in the interpreter, where it is seen what they call."""
    assert int(printed(ROOT, INTERPRETED, NUMBA_DISABLE_JIT="1")) > 30


class Edited(Sources):
    def __init__(self, file):
        super().__init__()
        path = ROOT / file
        self.content[str(path)] = path.read_bytes() + b"\n# edited\n"


def of(*words):
    return {cell for cell in CELLS if set(cell) & set(words)}


def test_an_edit_marks_the_cells_that_depend_on_the_file():
    def digests(files):
        return {(e, m): sources.of_cell(e, {"method": m}, files) for e, m in CELLS}

    before = digests(Sources())
    assert None not in before.values()
    for file, marked in {
        "integrators/methods/kahan.py": of("kahan"),
        "integrators/methods/bobenko_suris.py": of("bobenko_suris"),
        "integrators/problem/top.py": CELLS,
        "experiments/drift.py": of("drift"),
        "experiments/measuring/states.py": CELLS,
        "integrators/registry.py": set(),
        "experiments/drawing/style.py": set(),
        "results/store.py": set(),
        "lagrange_bench/runner/workers.py": set(),
    }.items():
        now = digests(Edited(file))
        assert {cell for cell in CELLS if now[cell] != before[cell]} == marked, file


def test_methods_that_an_experiment_names_count_for_its_cells():
    """`cost` races the exact step against Taylor series, in a cell of the latter."""
    files = Sources(), Edited("integrators/methods/backlund.py")
    before, now = (sources.of_cell("cost", {"method": "taylor"}, some) for some in files)
    assert before != now


PRINT = """
from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.integrators import METHODS
from lagrange_bench.results import sources
print(*(sources.of_cell(e, {"method": m}) for e in EXPERIMENTS for m in [*METHODS][::6]))
"""


def test_it_is_the_same_in_every_process_and_folder(tree):
    here = Sources()
    found = [sources.of_cell(e, {"method": m}, here) for e in EXPERIMENTS for m in [*METHODS][::6]]
    assert printed(tree, PRINT).split() == found


def test_a_digest_of_the_kind_before_is_unknown():
    now = sources.of_cell("drift", {"method": "rk4"})
    assert sources.compared(now, "0" * 16) == sources.compared(None, now) == sources.UNKNOWN
    assert (sources.compared(now, now), sources.compared(now, "0" * 24)) == (sources.SAME, sources.OTHER)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of the user's: write(name, text) → the digest of the cells of mine:METHOD."""
    monkeypatch.chdir(tmp_path)

    def write(name, text, method="mine:METHOD"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        importlib.invalidate_caches()
        return sources.of_cell("drift", {"method": method}, Sources())

    return write


IMPORTS = (
    "import helper as h, os",
    "from helper import (  # a comment)\n    x,\n)",
    "def f():\n    from helper import x",
    "import numpy; import helper",
    "import \\\n    helper",
    "import middle",
    "from lagrange_bench import integrate\nimport helper",
)


@pytest.mark.parametrize("text", IMPORTS)
def test_all_that_a_file_of_ones_own_imports_counts(folder, text):
    folder("middle/__init__.py", "from .inner import y\n")
    folder("middle/inner.py", "from .. import z\nimport helper\n")
    folder("helper.py", "x = 1\n")
    folder("other.py", "x = 1\n")
    first = folder("mine.py", text)
    assert first not in (None, folder("helper.py", "x = 2\n"))
    assert first == folder("helper.py", "x = 1\n") == folder("other.py", "x = 2\n")
    assert "mine" not in sys.modules, "nothing of the user's is run for it"


def test_an_installed_package_counts_if_it_is_asked_for(folder):
    folder("x-1.dist-info/METADATA", "")
    folder("deep/__init__.py", "")
    folder("deep/methods.py", "from deep import kernels\nimport beside\n")
    folder("beside.py", "")
    first = folder("deep/kernels.py", "x = 1\n", "deep.methods:METHOD")
    assert first is not None
    assert first == folder("beside.py", "x = 1\n", "deep.methods:METHOD")
    assert first != folder("deep/kernels.py", "x = 2\n", "deep.methods:METHOD")


def test_what_cannot_be_known_is_not(folder):
    assert sources.of_cell("drift", {"method": "no_such_module:METHOD"}) is None
    assert sources.of_cell("no.such", {}) is None
    assert folder("mine.py", "x = '\\udc80'\n") is not None


def test_an_edit_of_ones_own_file_is_another_key_and_of_the_benchs_is_none():
    for method, field, count in (("rk4", "tide", 1), ("mine:METHOD", "tide", 2), ("backlund", "mine:POTENTIAL", 2)):
        cell = {"method": method, "potential": field}
        assert len({cell_key("drift", 1, cell, digest) for digest in ("1" * 24, "2" * 24)}) == count


@pytest.mark.parametrize("back", [False, True])
def test_an_edit_is_noticed_by_the_process_that_read_the_file_before(folder, back):
    """Also one that was taken back, as by git: what was imported in between is not known."""
    folder("mine.py", "VALUE = 1\n")
    files = Sources()
    code = sources.code_of_cell("drift", {"method": "mine:METHOD"}, files)
    folder("other.py", "")
    assert not files.edited(code), "negative control"
    assert folder("mine.py", "VALUE = 2\n") != code.digest
    if back:
        assert folder("mine.py", "VALUE = 1\n") == code.digest
    assert files.edited(code)
