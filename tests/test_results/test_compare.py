"""Two stores are compared to the last digit, times by a test that does not cry wolf, and a stored run can be checked."""

from __future__ import annotations

import json
import math
import random

import pytest
from faults import HERE

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results import compare
from lagrange_bench.results.store import Store, clean_rows, make_record
from lagrange_bench.runner import verify


def store(folder, *cells, experiment="toy.none", version=1):
    """A store of (cell, rows); rows None: failed."""
    made = Store(folder)
    made.folder.mkdir(exist_ok=True)
    for position, (cell, rows) in enumerate(cells):
        done = {"status": "done", "rows": clean_rows(cell, rows or []), "error": None}
        if rows is None:
            done = {"status": "failed", "rows": [], "error": {"type": "StepError", "message": "no", "traceback": ""}}
        made.append(make_record(experiment, version, position, cell, **done, warnings=[], seconds=0.1))
    return made.folder


CELLS = [({"i": i}, [{"error": 1e-9 * (i + 1), "steps": 7}, {"error": math.nan, "steps": 8}]) for i in range(4)]


@pytest.fixture
def old(tmp_path):
    return store(tmp_path / "old", *CELLS)


def found(old, new, **options):
    return compare.compare(old, new, **options)


def test_the_same(run, old, tmp_path):
    new = store(tmp_path / "new", *reversed(CELLS))  # the order is no difference, nor are provenance and seconds
    assert found(old, new).same
    code, out, err = run("compare", old, new)
    assert (code, err) == (0, "")
    assert out.splitlines()[1].split() == ["toy.none", "4", "4", "4", "0", "0", "0"]
    assert out.splitlines()[-1] == "the same"


def test_what_was_added_removed_and_changed(run, old, tmp_path):
    rows = [{"error": 1e-9 * 1.001, "steps": 7}, {"error": math.nan, "steps": 9}]
    new = store(tmp_path / "new", (CELLS[0][0], rows), CELLS[1], CELLS[2], ({"i": 9}, []))
    cells = found(old, new).experiments["toy.none"]
    assert (cells.same, cells.added, cells.removed) == (2, [{"i": 9}], [{"i": 3}])
    ((cell, differing),) = cells.changed
    assert cell == {"i": 0}
    assert differing["error"].rows == 1
    assert differing["error"].relative == pytest.approx(1e-3, rel=1e-2)
    assert differing["error"].absolute == pytest.approx(1e-12)
    assert (differing["steps"].old, differing["steps"].new) == (8, 9)
    code, out, _ = run("compare", old, new)
    assert code == 1
    for line in (
        "changed in toy.none:",
        "removed: 1 cell of toy.none; --verbose lists them",
        "added: 1 cell",
        "not the same",
    ):
        assert line in out
    out = run("compare", old, new, "--verbose")[1]
    assert 'removed: toy.none {"i": 3}\nadded: toy.none {"i": 9}\n' in out
    code, out, _ = run("compare", old, new, "--json")
    data = json.loads(out)
    assert (code, data["same"]) == (1, False)
    assert data["experiments"]["toy.none"]["changed"][0]["columns"]["steps"]["new"] == 9


@pytest.mark.parametrize(
    ("error", "options", "same"),
    [
        (1e-9 * (1 + 2**-52), {}, False),  # the last bit
        (1e-9 * 1.001, {"rtol": 2e-3}, True),
        (1e-9 * 1.01, {"rtol": 2e-3}, False),
        (1e-9 * 1.01, {"rtol": 2e-3, "atol": 1e-10}, True),
        (-1e-9, {"rtol": 1.0}, False),
        (math.nan, {"rtol": 1.0, "atol": 1e9}, False),
        (None, {"rtol": 1.0, "atol": 1e9}, False),
    ],
)
def test_tolerances(old, tmp_path, error, options, same):
    rows = [{"error": error, "steps": 7}, CELLS[0][1][1]]
    new = store(tmp_path / "new", (CELLS[0][0], rows), *CELLS[1:])
    assert found(old, new, **options).same is same


def test_failures_are_changes(run, old, tmp_path):
    new = store(tmp_path / "new", (CELLS[0][0], None), *CELLS[1:])
    ((_, differing),) = found(old, new).experiments["toy.none"].changed
    assert (differing["status"].old, differing["status"].new) == ("done", "StepError: no")
    assert not found(new, old).same
    assert found(new, new).same
    code, out, _ = run("compare", old, new)
    assert code == 1
    assert "StepError: no" in out


def test_another_number_of_rows(old, tmp_path):
    new = store(tmp_path / "new", (CELLS[0][0], CELLS[0][1][:1]), *CELLS[1:])
    ((_, differing),) = found(old, new).experiments["toy.none"].changed
    assert (differing["rows"].old, differing["rows"].new) == (2, 1)


def test_how_far_a_timing_cell_goes_is_the_clocks_business(tmp_path):
    cell = {"timing": True}
    rows = [{"h": 1.0, "error": 1e-3, "seconds": 1.0}, {"h": 0.5, "error": 1e-4, "seconds": 2.0}]
    slow = [rows[0], {"h": 0.5, "stopped": "too long", "predicted": 3.0}]
    old = store(tmp_path / "old", (cell, rows))
    for name, less in (("row", rows[:1]), ("column", slow)):
        assert found(old, store(tmp_path / name, (cell, less))).same
    wrong = [rows[0], {**rows[1], "error": 2e-4}]
    assert not found(old, store(tmp_path / "wrong", (cell, wrong))).same


def test_of_other_cells_one_line_each(run, old, tmp_path):
    many = store(tmp_path / "many", *(({"i": i, "part": "ab"[i > 8]}, []) for i in range(12)))
    out = run("compare", old, many)[1]
    assert "removed: 4 cells of toy.none; " in out
    assert "added: 12 cells of toy.none (9 of a, 3 of b); " in out
    assert len(out.splitlines()) == 5
    assert len(run("compare", old, many, "--verbose")[1].splitlines()) == 3 + 16


def test_no_results(run, old, tmp_path):
    code, out, err = run("compare", old, tmp_path / "nothing")
    assert (code, out) == (2, "")
    assert "no results in" in err


# ---------------------------------------------------------------- times


def timed(folder, seed, ratio=1.0, noise=0.05, raw=False, cells=16):
    """A store of timings: lognormal noise, the samples of a cell together and each by itself."""
    draw, listed = random.Random(seed), []
    for i in range(cells):
        base = 20.0 * ratio * draw.lognormvariate(0, noise)
        samples = [base * draw.lognormvariate(0, noise) for _ in range(5)]
        row = {"ns_per_step": min(samples), "samples_ns": samples} if raw else {"ns_per_step": min(samples)}
        listed.append(
            ({"i": i, "method": "backlund", "timing": True}, [{**row, "steps": 7, "unstable": i % 2 == seed}])
        )
    return store(folder, *listed)


@pytest.mark.parametrize("raw", [False, True])
def test_times_that_differ(run, tmp_path, raw):
    old, new = timed(tmp_path / "old", 0, raw=raw), timed(tmp_path / "new", 1, 1.3, raw=raw)
    assert found(old, new).same  # without --times they are not looked at
    (group,) = found(old, new, times=True).times
    assert (group.column, group.cells, group.pairs) == (("samples_ns", 16, 80) if raw else ("ns_per_step", 16, 16))
    assert group.verdict == "slower"
    assert group.ratio == pytest.approx(1.3, rel=0.1)
    assert found(new, old, times=True).times[0].verdict == "faster"
    code, out, _ = run("compare", old, new, "--times")
    assert code == 1
    assert "slower" in out
    assert "no timing cells to compare" not in out
    assert run("compare", old, new, "--times", "--threshold", "0.5")[0] == 0
    assert run("compare", old, new)[0] == 0


def test_no_times_to_compare(run, old):
    code, out, _ = run("compare", old, old, "--times")
    assert code == 0
    assert out.splitlines()[-2:] == ["no timing cells to compare", "the same"]


def test_the_same_code_twice_is_the_same(tmp_path):
    """A hundred pairs of runs of one code, the second on a machine 5 % slower: at least 95 are called the same."""
    same = 0
    for seed in range(100):
        draw = random.Random(seed)

        def record(shift, draw=draw):
            row = {"ns_per_step": 20.0 * shift * draw.lognormvariate(0, 0.05)}
            return {"experiment": "toy", "cell": {"method": "m", "timing": True}, "rows": [row]}

        (group,) = compare.paired_times([(record(1.0), record(1.05)) for _ in range(24)])
        same += group.verdict == "same"
    assert same >= 95


def test_many_tests_are_corrected_for():
    groups = [compare.Times("e", f"m{i}", "c", 9, 9, 2.0, p, "same") for i, p in enumerate((0.004, 0.5, 0.02))]
    compare._holm(groups)
    assert [group.p for group in groups] == pytest.approx([0.012, 0.5, 0.04])


def test_samples_may_be_lists_and_nothing_else():
    assert clean_rows({}, [{"samples_ns": [1.5, 2]}]) == [{"samples_ns": [1.5, 2]}]
    for row in ({"resamples": [1.0]}, {"samples_ns": ["x"]}, {"samples_ns": [[1.0]]}, {"samples_ns": [math.nan]}):
        with pytest.raises(TypeError):
            clean_rows({}, [row])


@pytest.mark.parametrize(
    ("column", "time"),
    [
        *((name, True) for name in ("ns_per_step", "setup_us", "seconds", "samples", "ratio", "s", "memory", "mine")),
        *((name, False) for name in ("steps", "steps_per_time", "error", "backlund_error", "iterations_per_step")),
    ],
)
def test_which_columns_are_times(column, time):
    assert compare.is_time(column, {"timing": True}, own=("mine",)) is time
    assert not compare.is_time(column, {})


# ---------------------------------------------------------------- computing again


OWN = ("--quiet", "--module", "toys.behaviour")


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """A store of toy cells that are computed again, `run.folder`; `toy(row)` has the stored rows say so instead."""
    monkeypatch.syspath_prepend(str(HERE))

    def fill(**changed):
        cells = [{"do": "square", "i": i} for i in range(3)] + [{"do": "raise", "i": 3}]
        good = [(c, [{"square": float(c["i"] ** 2), "odd": bool(c["i"] % 2), **changed}]) for c in cells[:3]]
        folder = store(tmp_path / "stored", *good, experiment="toys.behaviour")
        error = {"type": "ArithmeticError", "message": "cell 3 was told to", "traceback": ""}
        outcome = {"status": "failed", "rows": [], "error": error, "warnings": [], "seconds": 0.0}
        Store(folder).append(make_record("toys.behaviour", 1, 3, cells[3], **outcome))
        return folder

    return fill


def test_what_is_still_computed(run, toy):
    folder = toy()
    code, out, err = run("verify", folder, *OWN)
    assert (code, err) == (0, "")
    assert out == "4 cells computed again: 4 identical, 0 within the tolerance of libraries, 0 changed\n"
    assert run("verify", folder, "--sample", "2", *OWN)[1].startswith("2 cells")


def test_what_is_computed_no_more(run, toy):
    code, out, _ = run("verify", toy(square=4.0), *OWN)
    assert code == 1
    assert "2 identical" in out  # 2² and the failure
    assert "2 changed" in out
    assert "changed in toys.behaviour:" in out
    code, out, _ = run("verify", toy(square=4.0), *OWN, "--json")
    data = json.loads(out)
    assert (code, data["identical"], len(data["changed"])) == (1, 2, 2)
    assert data["changed"][0]["columns"]["square"]["old"] == 4.0


def test_rows_of_other_sources_are_told_apart(run, toy, tmp_path):
    folder = toy(square=4.0)
    (changed, same, other, failed) = Store(folder).read("toys.behaviour")[0]
    made = Store(tmp_path / "mixed")
    made.folder.mkdir()
    made.append({**changed, "sources": None}, {**same, "sources": "0" * 24}, {**other, "sources": "0" * 24}, failed)
    code, out, _ = run("verify", made.folder, *OWN)
    assert code == 1
    assert "2 stored cells were computed with other source code than this; 1 stored cell was computed with" in out
    assert out.endswith(
        "2 changed; 1 of them stored with other source code; 1 of them stored with source code that was not recorded\n"
    )
    code, out, _ = run("verify", made.folder, *OWN, "--old", "--json")
    data = json.loads(out)
    assert (code, data["cells"], data["stored"]) == (1, 3, {"unknown": 1, "other": 2, "same": 1})
    assert sorted(change["sources"] for change in data["changed"]) == ["other", "unknown"]
    code, out, _ = run("verify", folder, *OWN, "--old")
    assert (code, out[:7]) == (0, "0 cells"), "all of these are of these sources"
    out = run("compare", folder, made.folder)[1]
    assert "2 of the 4 cells in both were computed with different source code\nthe same\n" in out
    made.append({**same, "rows": [{"square": 5.0, "odd": True}], "sources": None})
    out = run("compare", folder, made.folder)[1]
    assert "2 of the 4 cells in both were computed with source code that was not recorded\nnot the same\n" in out


def test_outdated_results(run, toy, monkeypatch):
    folder = toy()
    monkeypatch.setattr(load("toys.behaviour"), "VERSION", 2)
    code, out, err = run("verify", folder, *OWN)
    assert (code, out) == (2, "")
    assert "toys.behaviour changed (VERSION) since this was stored: lagrange-bench run toys.behaviour" in err


@pytest.mark.parametrize("words", [(), ("--json",), ("--old",)])
def test_nothing_verified_is_no_success(run, toy, words):
    """All lines damaged, none there, or all of an experiment that nobody named."""
    folder = toy()
    path = Store(folder).path("toys.behaviour")
    whole = path.read_bytes()

    def refused(*reasons):
        code, out, err = run("verify", folder, *OWN, *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert all(reason in err for reason in ("no cell of", *reasons)), err

    path.write_bytes(whole.replace(b'"seconds"', b'"Seconds"'))
    refused("line 1: damaged", "line 3: damaged", "; 1 more")
    path.write_bytes(b"")
    refused("no cells with anything but times")
    path.rename(path.with_name("toys.nobody.jsonl"))
    refused("unknown experiment 'toys.nobody'; if it is your own, add --module")


def test_verify_names_damaged_lines(run, toy):
    path = Store(toy()).path("toys.behaviour")
    path.write_bytes(path.read_bytes().replace(b'"odd":true', b'"odd":false'))
    code, out, err = run("verify", path.parent, *OWN)
    assert (code, err) == (0, "")
    assert f"{path}, line 2: damaged; skipped" in out
    assert out.endswith("\n3 cells computed again: 3 identical, 0 within the tolerance of libraries, 0 changed\n")
    (note,) = json.loads(run("verify", path.parent, *OWN, "--json")[1])["notes"]
    assert note in out


def test_compiled_methods_are_held_to_the_bit():
    old = {"status": "done", "error": None, "cell": {"method": "backlund"}, "rows": [{"H": 1e-16, "error": 1e-15}]}
    ulp = {**old, "rows": [{"H": 1.0001e-16, "error": 1e-15}]}
    truth = {**old, "rows": [{"H": 1e-16, "error": 3e-15}]}
    wrong = {**old, "rows": [{"H": 1e-16, "error": 3e-9}]}

    def changed(new, method):
        return list(compare.differences(old, new, (), verify._tolerance(method)))

    assert changed(ulp, "backlund") == ["H"]
    assert changed(ulp, "taylor") == []  # a library: not bit by bit on every machine
    assert changed(truth, "backlund") == []
    assert changed(wrong, "backlund") == changed(wrong, "taylor") == ["error"]
