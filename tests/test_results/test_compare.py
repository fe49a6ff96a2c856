"""Two stores are compared to the last digit; a stored run can be checked.

With a row there is a digest of all the code that computes it, as it was imported; and of nothing else.
"""

import importlib
import json
import math
import os
import sys
from pathlib import Path

import pytest
from faults import HERE, python

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import compare, sources
from lagrange_bench.results.store import Store, cell_key, clean_rows, make_record
from lagrange_bench.runner import verify
from lagrange_bench.support.source_digest import Sources


def store(folder, *cells, experiment="toy.none", error="StepError: no"):
    """A store of (cell, rows); rows None: failed."""
    made = Store(folder)
    made.folder.mkdir(exist_ok=True)
    failed = {"traceback": "", **dict(zip(("type", "message"), error.split(": "), strict=True))}
    for position, (cell, rows) in enumerate(cells):
        outcome = {"error": failed} if rows is None else {"rows": clean_rows(cell, rows)}
        made.append(make_record(experiment, 1, position, cell, **outcome))
    return made.folder


CELLS = [({"i": i}, [{"error": 1e-9 * (i + 1), "steps": 7}, {"error": math.nan, "steps": 8}]) for i in range(4)]
FIRST = CELLS[0][1]


@pytest.fixture
def old(tmp_path):
    return store(tmp_path / "old", *CELLS)


def test_what_is_missing_and_changed(run, old, tmp_path):
    other = store(tmp_path / "other", *reversed(CELLS))  # the order is no difference, nor are provenance and seconds
    code, out, err = run("compare", old, other)
    assert (code, err, out.splitlines()[-1]) == (0, "", "the same")
    rows = [{"error": 1e-9 * 1.001, "steps": 7}, {"error": math.nan, "steps": 9}]
    more = [({"i": i, "part": "ab"[i > 12]}, []) for i in range(9, 14)]
    new = store(tmp_path / "new", (CELLS[0][0], rows), CELLS[1], CELLS[2], *more)
    cells = compare.compare(old, new).experiments["toy.none"]
    assert (cells.same, cells.close) == (2, 0)
    assert cells.missing == {"old": [cell for cell, _ in more], "new": [{"i": 3}]}
    assert compare.compare(old, new, rtol=0.5).experiments["toy.none"].close == 1
    (changed,) = cells.changed
    cell, differing = changed["cell"], changed["columns"]
    assert cell == {"i": 0}
    error, steps = differing["error"], differing["steps"]
    assert (error.rows, error.relative, error.absolute) == (1, pytest.approx(1e-3, rel=1e-2), pytest.approx(1e-12))
    assert (steps.old, steps.new) == (8, 9)
    assert "missing in old: 5 cells of toy.none (4 of a, 1 of b); " in run("compare", old, new)[1]
    assert 'missing in new: toy.none {"i": 3}\n' in run("compare", old, new, "--verbose")[1]
    assert json.loads(run("compare", old, new, "--json")[1])["experiments"]["toy.none"]["missing"]["new"] == [{"i": 3}]


def test_a_foreign_journal_sends_nothing_to_the_terminal(run, tmp_path):
    evil = "\x1b]0;mine\x07\x1b[2J\x9b31m\r\x7f"
    cells = ({"i": 1, evil: evil}, [{"word": evil}]), ({"i": 2}, None)
    old, new = store(tmp_path / "old", *cells, error=f"A: {evil}"), store(tmp_path / "new", *cells[:1], error="A: b")
    for words in (
        ("compare", old, new, "--verbose"),
        ("compare", new, old),
        ("verify", old),
        ("figure", "x", "--results", old),
    ):
        _, out, err = run(*words)
        assert out + err
        assert not [c for c in out + err if c != "\n" and not c.isprintable()], words


def test_tolerances_and_what_none_forgives(old, tmp_path):
    for i, (error, options, same) in enumerate((
        (1e-9 * (1 + 2**-52), {}, False),  # the last bit
        (1e-9 * 1.01, {"rtol": 2e-3}, False),
        (1e-9 * 1.01, {"rtol": 2e-3, "atol": 1e-10}, True),
        (math.nan, {"rtol": 1.0, "atol": 1e9}, False),
        (None, {"rtol": 1.0, "atol": 1e9}, False),
    )):  # fmt: skip
        new = store(tmp_path / str(i), (CELLS[0][0], [{"error": error, "steps": 7}, FIRST[1]]), *CELLS[1:])
        assert compare.compare(old, new, **options).same is same, (error, options)
    for rows, column, words in ((None, "status", ("done", "StepError: no")), (FIRST[:1], "rows", (2, 1))):
        new = store(tmp_path / column, (CELLS[0][0], rows), *CELLS[1:])
        differing = compare.compare(old, new).experiments["toy.none"].changed[0]["columns"]
        assert (differing[column].old, differing[column].new) == words
        assert (compare.compare(new, old).same, compare.compare(new, new).same) == (False, True)


def test_times_are_not_compared(run, tmp_path):
    def timed(name, ns, steps):
        return store(tmp_path / name, ({"i": 0, "timing": True}, [{"ns_per_step": ns, "steps": steps}]))

    assert compare.compare(timed("old", 20.0, 7), timed("new", 30.0, 7)).same
    assert not compare.compare(timed("old", 20.0, 7), timed("other", 20.0, 8)).same
    times = {"ns_per_step", "setup_us", "seconds", "samples", "ratio", "s", "memory", "mine"}
    others = {"steps", "steps_per_time", "error", "backlund_error", "iterations_per_step"}
    assert {name for name in times | others if compare.is_time(name, {"timing": True}, times=("mine",))} == times
    assert not any(compare.is_time(name, {}) for name in times)


TOY = "toys.behaviour"
OWN = ("--quiet", "--module", TOY)


@pytest.fixture
def toy(in_process, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(HERE))

    def fill(**changed):
        good = [({"do": "square", "i": i}, [{"square": float(i**2), "odd": bool(i % 2), **changed}]) for i in range(3)]
        failed = ({"do": "raise", "i": 3}, None)
        return store(tmp_path / "stored", *good, failed, experiment=TOY, error="ArithmeticError: cell 3 was told to")

    return fill


def test_what_is_still_computed_and_damaged_lines_are_named(run, toy):
    folder = toy()
    code, out, _ = run("verify", folder, *OWN)
    assert code == 0
    assert out == "4 cells computed again: 4 identical, 0 within the tolerance of libraries, 0 changed\n"
    path = Store(folder).path(TOY)
    path.write_bytes(path.read_bytes().replace(b'"odd":true', b'"odd":false'))
    code, out, _ = run("verify", folder, *OWN, "--sample", "2", "--json")
    data = json.loads(out)
    assert (code, data["cells"]) == (0, 2)
    assert data["notes"] == [f"{path}, line 2: damaged; skipped, its cell counts as not computed"]


def test_rows_that_are_computed_otherwise_now_and_whose_sources_they_are(run, toy, tmp_path):
    folder = toy(square=4.0)
    records = Store(folder).read(TOY)[0]
    made = Store(tmp_path / "mixed")
    made.folder.mkdir()
    digests = (None, "0" * 24, "0" * 24, records[3]["sources"])
    made.append(*({**record, "sources": digest} for record, digest in zip(records, digests, strict=True)))
    code, out, _ = run("verify", made.folder, *OWN)
    assert "2 identical, 0 within the tolerance of libraries, 2 changed; 1 of them stored with other source" in out
    code, out, _ = run("verify", made.folder, *OWN, "--old", "--json")
    data = json.loads(out)
    assert (code, data["cells"], data["stored"]) == (1, 3, {"unknown": 1, "other": 2, "same": 1})
    assert sorted(change["sources"] for change in data["changed"]) == ["other", "unknown"]
    assert {change["columns"]["square"]["old"] for change in data["changed"]} == {4.0}
    out = run("compare", folder, made.folder)[1]
    assert "3 of the 4 cells in both were computed with other or unknown source code\nthe same\n" in out
    made.append({**records[1], "rows": [{"square": 5.0, "odd": True}], "sources": None})
    out = run("compare", folder, made.folder)[1]
    assert "3 of the 4 cells in both were computed with other or unknown source code\nnot the same\n" in out


def test_nothing_verified_is_no_success(run, toy, monkeypatch):
    path = Store(toy()).path(TOY)
    whole = path.read_bytes()

    def refused(*reasons):
        code, out, err = run("verify", path.parent, *OWN)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert all(reason in err for reason in reasons), err

    path.write_bytes(whole.replace(b'"seconds"', b'"Seconds"'))
    refused("no cell of", "line 1: damaged", "line 3: damaged", "; 1 more")
    path.write_bytes(b"")
    refused("nothing is stored in")
    path.write_bytes(whole)
    with monkeypatch.context() as newer:
        newer.setattr(load(TOY), "VERSION", 2)
        refused(f"{TOY} changed (VERSION) since this was stored: lagrange-bench run {TOY}")
    path.rename(path.with_name("toys.nobody.jsonl"))
    refused("no cell of", "unknown experiment 'toys.nobody'; if it is your own, add --module")


def test_cells_of_a_method_whose_package_is_missing_are_left_out(monkeypatch):
    monkeypatch.setattr(verify, "available", lambda method: method.name != "taylor")
    cells = ({"method": "taylor"}, {"method": "rk4"}, {"potential": "nobody"})
    assert list(map(verify._absent, cells)) == ["taylor", None, "nobody"]


def test_compiled_methods_are_held_to_the_bit():
    old = {"status": "done", "error": None, "cell": {"method": "backlund"}, "rows": [{"H": 1e-16, "error": 1e-15}]}
    for rows, method, changed in (
        ({"H": 1.0001e-16, "error": 1e-15}, "backlund", ["H"]),
        ({"H": 1.0001e-16, "error": 1e-15}, "taylor", []),  # a library: not bit by bit on every machine
        ({"H": 1e-16, "error": 3e-15}, "backlund", []),  # the truth
        ({"H": 1e-16, "error": 3e-9}, "backlund", ["error"]),
        ({"H": 1e-16, "error": 3e-9}, "taylor", ["error"]),
    ):
        assert list(compare.differences(old, {**old, "rows": [rows]}, (), verify._tolerance(method))) == changed


ROOT = Path(__file__).resolve().parents[2]
COMPUTED = {(e, m) for e in ("drift", "phase", "engines") for m in ("rk4", "kahan", "backlund", "taylor")}


INTERPRETED = """
import sys
from lagrange_bench.experiments import drift
from lagrange_bench.integrators import METHODS, LagrangeTop, available
from lagrange_bench.support import source_digest
from lagrange_bench.results import sources

tried = 0
for method in (name for name in METHODS if available(METHODS[name]) and METHODS[name].takes(LagrangeTop()) is None):
    called, cell = set(), {"part": "h", "method": method, "state": "generic", "span": 1, "h": 0.25}
    sys.setprofile(lambda frame, event, _: called.add(frame.f_code.co_filename))
    drift.measure(cell)
    sys.setprofile(None)
    homes = {module.__file__: name for name, module in sys.modules.items() if getattr(module, "__file__", None)}
    ours = {homes[file] for file in called if homes.get(file, "").partition(".")[0] == source_digest.BENCH}
    ours = {name for name in ours if not source_digest.IGNORED_MODULES.fullmatch(name)}
    found = source_digest.IMPORTED_SOURCES.files({"lagrange_bench.experiments.drift", METHODS.module(method)})
    assert ours <= set(found), (method, ours - set(found))
    assert METHODS.module(method) in ours or METHODS[method].requires, "negative control"
    assert sources.of_cell("drift", cell)
    tried += 1
print(tried)
"""


def test_what_measuring_calls_is_in_the_digest():
    """With kernels in the interpreter, where it is seen what they call."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"}
    done = python("-c", INTERPRETED, cwd=ROOT, env=environment)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 30


class Edited(Sources):
    def __init__(self, file):
        super().__init__()
        path = ROOT / file  # as it is imported
        self.content[str(path)] = path.read_bytes() + b"\nEDITED = True\n"


def of(*words):
    return {cell for cell in COMPUTED if set(cell) & set(words)}


def test_an_edit_marks_the_cells_that_depend_on_the_file():
    def digests(files):
        return {(e, m): sources.of_cell(e, {"method": m}, files) for e, m in COMPUTED}

    before = digests(Sources())
    assert None not in before.values()
    for file, marked in {
        "lagrange_bench/integrators/methods/kahan.py": of("kahan"),
        "lagrange_bench/integrators/methods/backlund.py": COMPUTED,  # the experiments name it
        "lagrange_bench/integrators/problem/top.py": COMPUTED,
        "lagrange_bench/experiments/drift.py": of("drift"),
        "lagrange_bench/integrators/registry.py": set(),
        "lagrange_bench/experiments/programs.py": of("engines"),
        "lagrange_bench/experiments/drawing/style.py": set(),
        "lagrange_bench/experiments/drift_figures.py": set(),
        "lagrange_bench/experiments/heavy_top.py": set(),
        "lagrange_bench/results/store.py": set(),
    }.items():
        now = digests(Edited(file))
        assert {cell for cell in COMPUTED if now[cell] != before[cell]} == marked, file


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
    "import middle",
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


CODE = 'def f(x):\n    if x:\n        return """a\n\n    # b"""\n    return (x, 2)\n'


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("", "# a comment\n", True),
        ("def f(x):\n", 'def f(x):\n    """Two\n\n    lines."""  # and more\n\n', True),
        ("    if x:\n", "    # why\n    if x:  # so\n\n", True),
        ("(x, 2)", "(\n        x,  # the one\n        2,\n    )", False),  # a comma more
        ("# b", "# c", False),
        ("a\n\n", "a\n", False),
        ("return (x, 2)", '"""return (x, 2)"""', False),
    ],
)
def test_comments_and_docstrings_are_no_code(folder, old, new, same):
    assert (folder("mine.py", CODE) == folder("mine.py", CODE.replace(old, new, 1))) == same


def test_what_cannot_be_known_is_not(folder):
    now = sources.of_cell("drift", {"method": "rk4"})
    assert sources.compared(now, "0" * 16) == sources.compared(None, now) == sources.UNKNOWN, "a digest of other things"
    assert (sources.compared(now, now), sources.compared(now, "0" * 24)) == (sources.SAME, sources.OTHER)
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
