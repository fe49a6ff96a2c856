"""Two stores are compared to the last digit, times by a test that does not cry wolf, and a stored run can be checked."""

import json
import math
import random

import pytest
from faults import HERE

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import compare
from lagrange_bench.results.store import Store, clean_rows, make_record
from lagrange_bench.runner import verify


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


def test_what_was_added_removed_and_changed(run, old, tmp_path):
    other = store(tmp_path / "other", *reversed(CELLS))  # the order is no difference, nor are provenance and seconds
    code, out, err = run("compare", old, other, "--times")
    assert (code, err, out.splitlines()[-2:]) == (0, "", ["no timing cells to compare", "the same"])
    rows = [{"error": 1e-9 * 1.001, "steps": 7}, {"error": math.nan, "steps": 9}]
    more = [({"i": i, "part": "ab"[i > 12]}, []) for i in range(9, 14)]
    new = store(tmp_path / "new", (CELLS[0][0], rows), CELLS[1], CELLS[2], *more)
    cells = compare.compare(old, new).experiments["toy.none"]
    assert (cells.same, cells.added, cells.removed) == (2, [cell for cell, _ in more], [{"i": 3}])
    (changed,) = cells.changed
    cell, differing = changed["cell"], changed["columns"]
    assert cell == {"i": 0}
    error, steps = differing["error"], differing["steps"]
    assert (error.rows, error.relative, error.absolute) == (1, pytest.approx(1e-3, rel=1e-2), pytest.approx(1e-12))
    assert (steps.old, steps.new) == (8, 9)
    assert "added: 5 cells of toy.none (4 of a, 1 of b); " in run("compare", old, new)[1]
    assert 'removed: toy.none {"i": 3}\n' in run("compare", old, new, "--verbose")[1]
    code, out, _ = run("compare", old, new, "--json")
    assert (code, json.loads(out)["experiments"]["toy.none"]["changed"][0]["columns"]["steps"]["new"]) == (1, 9)


@pytest.mark.parametrize(
    ("error", "options", "same"),
    [
        (1e-9 * (1 + 2**-52), {}, False),  # the last bit
        (1e-9 * 1.001, {"rtol": 2e-3}, True),
        (1e-9 * 1.01, {"rtol": 2e-3}, False),
        (1e-9 * 1.01, {"rtol": 2e-3, "atol": 1e-10}, True),
        (math.nan, {"rtol": 1.0, "atol": 1e9}, False),
        (None, {"rtol": 1.0, "atol": 1e9}, False),
    ],
)
def test_tolerances(old, tmp_path, error, options, same):
    new = store(tmp_path / "new", (CELLS[0][0], [{"error": error, "steps": 7}, FIRST[1]]), *CELLS[1:])
    assert compare.compare(old, new, **options).same is same


@pytest.mark.parametrize(
    ("rows", "column", "words"), [(None, "status", ("done", "StepError: no")), (FIRST[:1], "rows", (2, 1))]
)
def test_failures_and_other_numbers_of_rows_are_changes(old, tmp_path, rows, column, words):
    new = store(tmp_path / "new", (CELLS[0][0], rows), *CELLS[1:])
    differing = compare.compare(old, new).experiments["toy.none"].changed[0]["columns"]
    assert (differing[column].old, differing[column].new) == words
    assert not compare.compare(new, old).same
    assert compare.compare(new, new).same


def test_how_far_a_timing_cell_goes_is_the_clocks_business(tmp_path):
    cell = {"timing": True}
    rows = [{"h": 1.0, "error": 1e-3, "seconds": 1.0}, {"h": 0.5, "error": 1e-4, "seconds": 2.0}]
    old = store(tmp_path / "old", (cell, rows))
    for name, new, same in (
        ("row", rows[:1], True),
        ("column", [rows[0], {"h": 0.5, "stopped": "too long", "predicted": 3.0}], True),
        ("wrong", [rows[0], {**rows[1], "error": 2e-4}], False),
    ):
        assert compare.compare(old, store(tmp_path / name, (cell, new))).same is same


def timed(folder, seed, ratio=1.0, raw=False):
    """A store of timings: lognormal noise, the samples of a cell together and each by itself."""
    draw, listed = random.Random(seed), []
    for i in range(16):
        base = 20.0 * ratio * draw.lognormvariate(0, 0.05)
        samples = [base * draw.lognormvariate(0, 0.05) for _ in range(5)]
        row = {"ns_per_step": min(samples), "steps": 7, "unstable": i % 2 == seed}
        row |= {"samples_ns": samples} if raw else {}
        listed.append(({"i": i, "method": "backlund", "timing": True}, [row]))
    return store(folder, *listed)


@pytest.mark.parametrize("raw", [False, True])
def test_times_that_differ(run, tmp_path, raw):
    old, new = timed(tmp_path / "old", 0, raw=raw), timed(tmp_path / "new", 1, 1.3, raw=raw)
    assert compare.compare(old, new).same  # without --times they are not looked at
    (group,) = compare.compare(old, new, times=True).times
    assert (group.column, group.cells, group.pairs) == (("samples_ns", 16, 80) if raw else ("ns_per_step", 16, 16))
    assert (group.verdict, group.ratio) == ("slower", pytest.approx(1.3, rel=0.1))
    assert compare.compare(new, old, times=True).times[0].verdict == "faster"
    code, out, _ = run("compare", old, new, "--times")
    assert (code, "slower" in out) == (1, True)
    assert run("compare", old, new, "--times", "--threshold", "0.5")[0] == 0


def test_the_same_code_twice_has_the_same_times():
    """Fifty pairs of runs of one code, the second on a machine 5 % slower: at most two are called different."""
    same = 0
    for seed in range(50):
        draw = random.Random(seed)

        def record(shift, draw=draw):
            row = {"ns_per_step": 20.0 * shift * draw.lognormvariate(0, 0.05)}
            return {"experiment": "toy", "cell": {"method": "m", "timing": True}, "rows": [row]}

        (group,) = compare.paired_times([(record(1.0), record(1.05)) for _ in range(24)])
        same += group.verdict == "same"
    assert same >= 48


def test_which_columns_are_times_and_many_tests_are_corrected_for():
    groups = [compare.Times("e", f"m{i}", "c", 9, 9, 2.0, p, "same") for i, p in enumerate((0.004, 0.5, 0.02))]
    compare._holm(groups)
    assert [group.p for group in groups] == pytest.approx([0.012, 0.5, 0.04])
    times = {"ns_per_step", "setup_us", "seconds", "samples", "ratio", "s", "memory", "mine"}
    others = {"steps", "steps_per_time", "error", "backlund_error", "iterations_per_step"}
    assert {name for name in times | others if compare.is_time(name, {"timing": True}, own=("mine",))} == times
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
    code, out, err = run("verify", folder, *OWN)
    assert (code, err) == (0, "")
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
    code, out, _ = run("verify", folder, *OWN, "--old")
    assert (code, out[:7]) == (0, "0 cells"), "all of these are of these sources"
    out = run("compare", folder, made.folder)[1]
    assert "2 of the 4 cells in both were computed with different source code\nthe same\n" in out
    made.append({**records[1], "rows": [{"square": 5.0, "odd": True}], "sources": None})
    out = run("compare", folder, made.folder)[1]
    assert "2 of the 4 cells in both were computed with source code that was not recorded\nnot the same\n" in out


@pytest.mark.parametrize("words", [(), ("--json",), ("--old",)])
def test_nothing_verified_is_no_success(run, toy, monkeypatch, words):
    path = Store(toy()).path(TOY)
    whole = path.read_bytes()

    def refused(*reasons):
        code, out, err = run("verify", path.parent, *OWN, *words)
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
