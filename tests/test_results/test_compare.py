"""Two stores are compared to the last digit; a stored run can be checked.

With a row there is a digest of the files that may compute it, as they were imported; and one of the user's own.
"""

import importlib
import json
import math
import sys

import pytest
from faults import HERE

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import compare, sources
from lagrange_bench.results.store import Store, clean_rows, make_record
from lagrange_bench.runner import times, verify
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


def test_what_is_missing_and_changed(run, answer, old, tmp_path):
    other = store(tmp_path / "other", *reversed(CELLS))  # the order is no difference, nor are provenance and seconds
    code, out, err = run("compare", old, other)
    assert (code, err, out.splitlines()[-1]) == (0, "", "the same")
    rows = [{"error": 1e-9 * 1.001, "steps": 7}, {"error": math.nan, "steps": 9}]
    more = [({"i": i}, []) for i in range(9, 14)]
    new = store(tmp_path / "new", (CELLS[0][0], rows), CELLS[1], CELLS[2], *more)
    cells = compare.compare(old, new).experiments["toy.none"]
    assert (cells.same, cells.close) == (2, 0)
    assert cells.missing == {"old": [cell for cell, _ in more], "new": [{"i": 3}]}
    assert compare.compare(old, new, rtol=0.5).experiments["toy.none"].close == 1
    (changed,) = cells.changed
    error, steps = changed["columns"]["error"], changed["columns"]["steps"]
    assert (error.rows, error.relative, error.absolute) == (1, pytest.approx(1e-3, rel=1e-2), pytest.approx(1e-12))
    assert (changed["cell"], steps.old, steps.new) == ({"i": 0}, 8, 9)
    code, out, _ = run("compare", old, new)
    assert (code, out.splitlines()[1].split()) == (1, ["toy.none", "2", "0", "1", "5", "1"])


def test_a_foreign_journal_sends_nothing_to_the_terminal(run, tmp_path):
    evil = "\x1b]0;mine\x07\x1b[2J\x9b31m\r\x7f"
    cells = ({"i": 1, evil: evil}, [{"word": evil}]), ({"i": 2}, None)
    old, new = store(tmp_path / "old", *cells, error=f"A: {evil}"), store(tmp_path / "new", *cells[:1], error="A: b")
    for words in (("compare", old, new), ("verify", old), ("figure", "x", "--results", old)):
        _, out, err = run(*words)
        assert out + err
        assert not [c for c in out + err if c != "\n" and not c.isprintable()], words


TOLERANCES = [  # an error, 1e-9 before, the options, and whether the results are the same then
    (1e-9 * (1 + 2**-52), {}, False),  # the last bit
    (1e-9 * 1.01, {"rtol": 2e-3}, False),
    (1e-9 * 2, {"rtol": 0.6}, True),  # of the larger value
    (1e-9 * 1.01, {"rtol": 2e-3, "atol": 1e-10}, True),
    (math.nan, {"rtol": 1.0, "atol": 1e9}, False),
]


def test_tolerances_and_what_none_forgives(old, tmp_path):
    for i, (error, options, same) in enumerate(TOLERANCES):
        new = store(tmp_path / str(i), (CELLS[0][0], [{"error": error, "steps": 7}, FIRST[1]]), *CELLS[1:])
        assert compare.compare(old, new, **options).same is same, (error, options)
    for rows, column, words in ((None, "status", ("done", "StepError: no")), (FIRST[:1], "rows", (2, 1))):
        new = store(tmp_path / column, (CELLS[0][0], rows), *CELLS[1:])
        differing = compare.compare(old, new).experiments["toy.none"].changed[0]["columns"]
        assert (differing[column].old, differing[column].new) == words


def test_times_are_not_compared(tmp_path):
    def timed(name, ns):
        return store(tmp_path / name, ({"i": 0, "timing": True}, [{"ns_per_step": ns, "steps": 7, "mine": ns}]))

    (changed,) = compare.compare(timed("old", 20.0), timed("new", 30.0)).experiments["toy.none"].changed
    assert list(changed["columns"]) == ["mine"], "of no experiment that says which columns are times"
    assert compare.is_time("mine", {}, times=("mine",))
    assert not any(compare.is_time(name, {"timing": True}) for name in ("steps", "steps_per_time", "backlund_error"))


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


def test_what_is_still_computed_and_damaged_lines_are_named(run, answer, toy):
    folder = toy()
    code, out, _ = run("verify", folder, *OWN)
    assert code == 0
    assert out == "4 cells computed again: 4 identical, 0 within the tolerance of libraries, 0 changed\n"
    path = Store(folder).path(TOY)
    path.write_bytes(path.read_bytes().replace(b'"odd":true', b'"odd":false'))
    data = answer("verify", folder, *OWN, "--sample", "2")
    assert data["cells"] == 2
    assert data["notes"] == [f"{path}, line 2: damaged; skipped, its cell counts as not computed"]


def test_rows_that_are_computed_otherwise_now_and_whose_sources_they_are(run, toy, tmp_path):
    folder = toy(square=4.0)
    records = Store(folder).read(TOY)[0]
    made = Store(tmp_path / "mixed")
    made.folder.mkdir()
    digests = (None, "0" * 24, "0" * 24, records[3]["sources"])
    made.append(*({**record, "sources": digest} for record, digest in zip(records, digests, strict=True)))
    code, out, _ = run("verify", made.folder, *OWN)
    assert "2 identical, 0 within the tolerance of libraries, 2 changed; 1 of them computed with other source" in out
    code, out, _ = run("verify", made.folder, *OWN, "--old", "--json")
    data = json.loads(out)
    assert (code, data["cells"], data["stored"]) == (1, 3, {"unknown": 1, "other": 2, "same": 1})
    assert sorted(change["sources"] for change in data["changed"]) == ["other", "unknown"]
    assert {change["columns"]["square"]["old"] for change in data["changed"]} == {4.0}
    out = run("compare", folder, made.folder)[1]
    assert "3 of the 4 cells in both were computed with other or unknown source code\nthe same\n" in out


def test_nothing_verified_is_no_success(run, toy, monkeypatch):
    path = Store(toy()).path(TOY)
    whole = path.read_bytes()

    def refused(*reasons):
        code, out, err = run("verify", path.parent, *OWN)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert all(reason in err for reason in reasons), err

    path.write_bytes(whole.replace(b'"seconds"', b'"Seconds"'))
    refused("no cell of", "line 1: damaged", "line 3: damaged")
    path.write_bytes(whole)
    with monkeypatch.context() as other:
        for version in (0, 2):
            other.setattr(load(TOY), "VERSION", version)
            refused(f"{TOY} changed (VERSION) since this was stored: lagrange-bench run {TOY}")
            assert Store(path.parent).open(TOY).source_ages() == {"outdated": 4}
    path.rename(path.with_name("toys.nobody.jsonl"))
    refused("no cell of", "unknown experiment 'toys.nobody'; if it is your own, add --module")


def test_compiled_methods_are_held_to_the_bit():
    old = {"status": "done", "error": None, "cell": {"method": "backlund"}, "rows": [{"H": 1e-16, "error": 1e-15}]}
    for rows, method, changed in (
        ({"H": 1.0001e-16, "error": 1e-15}, "backlund", ["H"]),
        ({"H": 1.0001e-16, "error": 1e-15}, "taylor", []),  # a library: not bit by bit on every machine
        ({"H": 1e-16, "error": 3e-15}, "backlund", []),  # the truth
        ({"H": 1e-16, "error": 3e-9}, "backlund", ["error"]),
        ({"H": 1e-16, "error": 3e-9}, "taylor", ["error"]),
    ):
        new = {**old, "rows": [rows]}
        assert list(compare.compare_cell(old, new, (), verify.tolerance_of(method))[1]) == changed


@pytest.mark.slow
def test_ratios_of_times_are_those_of_claims(run, answer, monkeypatch):
    """Measured by the experiments, and held to the bounds of the claims."""
    pytest.importorskip("heyoka")
    bounds = ["≥ 25 ×", "≤ 5000 steps", "≥ 8 ×", "≥ 1.7 ×", "≥ 50 ×"]
    monkeypatch.setattr(times, "SIGNS", dict.fromkeys("≤≥", lambda value, limit: value > 0))
    assert [(ratio["required"], ratio["passed"]) for ratio in answer("verify", "--times")] == [
        (b, True) for b in bounds
    ]
    monkeypatch.setattr(times, "SIGNS", dict.fromkeys("≤≥", lambda value, limit: limit == 25))
    code, out, _ = run("verify", "--times")
    assert (code, out.count("not as claimed")) == (1, 4)


CELL = {"method": "kahan"}


def test_an_edit_marks_the_cells_that_the_file_may_compute(tree, monkeypatch):
    """Those of all experiments, if it is one of integrators or measuring; those of its own, if it is an experiment's."""
    copy = tree / "lagrange_bench"

    def digests():
        return {name: sources.of_cell(name, CELL, Sources()).digests["sources"] for name in ("drift", "phase")}

    published = digests()
    monkeypatch.setattr(sources, "PACKAGE", copy)
    monkeypatch.setattr(sources, "COMPUTING", (copy / "integrators", copy / "experiments" / "measuring"))
    before = digests()
    assert (before, len({*before.values()}), None in before.values()) == (published, 2, False)
    for file, marked in {
        "integrators/methods/new.py": {"drift", "phase"},
        "integrators/cases/bruels.toml": {"drift", "phase"},
        "experiments/measuring/metrics.py": {"drift", "phase"},
        "experiments/drift.py": {"drift"},
        "experiments/drawing/style.py": set(),
    }.items():
        path = copy / file
        old = path.read_bytes() if path.exists() else b""
        path.write_bytes(old + b"\n# edited\n")
        now = digests()
        assert {name for name in now if now[name] != before[name]} == marked, file
        before = now


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of the user's: write(name, text) → the digest of the method mine.py there."""
    monkeypatch.chdir(tmp_path)

    def write(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        importlib.invalidate_caches()
        own = sources.of_cell("drift", {"method": "mine:METHOD"}, Sources()).own
        return own and own.digest

    return write


def test_an_edit_of_ones_own_file_is_another_key(folder):
    """Of its file, or of any in its package; nothing of it is imported for that."""

    def key(cell):
        return make_record("drift", 1, 0, cell, **sources.of_cell("drift", cell, Sources()).digests)["key"]

    folder("pack/inner/mine.py", "")
    for file, cell in (
        ("mine.py", {"method": "mine:METHOD"}),
        ("mine.py", {"method": "rk4", "potential": "mine:POTENTIAL"}),
        ("pack/helper.py", {"method": "pack.inner.mine:METHOD"}),
    ):
        folder(file, "x = 1\n")
        first = key(cell)
        folder("other.py", "")
        assert first == key(cell), "negative control"
        folder(file, "x = 2\n")
        assert first != key(cell)
    assert not {"mine", "pack"} & set(sys.modules)
    assert sources.of_cell("drift", {"method": "no_such_module:METHOD"}).digests == {"sources": None}


def test_an_edit_is_noticed_by_the_process_that_read_the_file_before(folder):
    """Also one that was taken back, as by git: what was imported in between is not known."""
    folder("mine.py", "VALUE = 1\n")
    code = sources.of_cell("drift", {"method": "mine:METHOD"}, Sources())
    folder("other.py", "")
    assert not code.edited, "negative control"
    assert folder("mine.py", "VALUE = 2\n") != code.own.digest == folder("mine.py", "VALUE = 1\n")
    assert code.edited
