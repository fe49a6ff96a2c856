"""The store loses nothing it has confirmed, and never takes a damaged line for a result."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench.results import provenance, store
from lagrange_bench.results.store import Store, StoreError


def record(attempt, status="done", experiment="toy", version=1, position=None, **cell):
    done = status == "done"
    error = None if done else {"type": "ArithmeticError", "message": f"attempt {attempt}", "traceback": "…"}
    rows = [{"square": float(attempt**2)}] if done else []
    cell = cell or {"i": attempt}
    position = attempt if position is None else position
    return store.make_record(
        experiment, version, position, cell, status=status, rows=rows, error=error, warnings=[], seconds=0.1
    )


@pytest.fixture
def filled(tmp_path):
    results = Store(tmp_path)
    for i in range(5):
        results.append(record(i))
    return results


def squares(results):
    return [r["rows"][0]["square"] for r in results.read("toy")[0]]


# ---------------------------------------------------------------- what goes in comes out


AWKWARD = {
    "nan": math.nan,
    "inf": np.float64(np.inf),
    "minus_inf": -math.inf,
    "minus_zero": -0.0,
    "tiny": 5e-324,
    "tenth": np.float64(0.1),
    "single": np.float32(0.1),
    "count": np.int64(2**62),
    "flag": np.bool_(True),
    "text": "Bäcklund λ\n\\ud800",
    "none": None,
    "quarter": Fraction(1, 4),
}


def test_rows_survive_bit_by_bit(tmp_path):
    cell = {"i": 1, "label": np.str_("name"), "limit": math.inf}
    rows = store.clean_rows(cell, [AWKWARD])
    results = Store(tmp_path)
    results.append(store.make_record("toy", 1, 0, cell, status="done", rows=rows, error=None, warnings=[], seconds=1))
    text = results.path("toy").read_text()
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    (row,) = results.rows("toy").to_dict("records")
    for name, value in AWKWARD.items():
        if isinstance(value, str) or value is None:
            assert row[name] == value or (value is None and row[name] is None)
        else:
            assert np.float64(row[name]).tobytes() == np.float64(value).tobytes(), name
    assert row["limit"] == math.inf
    assert row["flag"] is np.True_ or row["flag"] is True


@pytest.mark.parametrize("value", [np.zeros(3), 1j, object(), [1.0], {"a": 1}, b"bytes", {1, 2}])
def test_what_is_no_scalar_is_refused(value):
    with pytest.raises(TypeError):
        store.clean_rows({}, [{"x": value}])


def test_a_row_must_not_contradict_its_cell():
    assert store.clean_rows({"h": 0.1}, [{"h": np.float64(0.1)}]) == [{"h": 0.1}]
    with pytest.raises(ValueError, match="'h'"):
        store.clean_rows({"h": 0.1}, [{"h": 0.2}])
    with pytest.raises(ValueError, match="'status'"):
        store.clean_rows({}, [{"status": "done"}])


def test_key_is_of_everything_that_matters(monkeypatch):
    key = store.cell_key("toy", 1, {"a": 1, "b": 2.0})
    assert key == store.cell_key("toy", 1, {"b": np.float64(2.0), "a": np.int64(1)})
    others = [("toy", 2, {"a": 1, "b": 2.0}), ("two", 1, {"a": 1, "b": 2.0}), ("toy", 1, {"a": 1, "b": 2.5})]
    assert key not in [store.cell_key(*other) for other in others]
    monkeypatch.setattr(store, "_packages", lambda: {"numpy": "1"})
    assert key != store.cell_key("toy", 1, {"a": 1, "b": 2.0})


# ---------------------------------------------------------------- damage


def test_a_torn_last_line_costs_one_cell(filled):
    path = filled.path("toy")
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    for missing in (2, 3, last // 2, last - 1):
        path.write_bytes(whole[:-missing])
        records, problems = filled.read("toy")
        assert len(records) == 4
        assert len(problems) == 1
        assert "line 5" in problems[0]
        assert "cut off" in problems[0]
        filled.append(record(4))  # on a fresh line
        assert squares(filled) == [0, 1, 4, 9, 16]
        assert path.read_bytes().startswith(whole[:-missing])  # nothing is rewritten


def test_a_last_line_that_only_lacks_its_end_is_whole(filled):
    path = filled.path("toy")
    path.write_bytes(path.read_bytes()[:-1])
    assert squares(filled) == [0, 1, 4, 9, 16]
    filled.append(record(5))
    assert squares(filled) == [0, 1, 4, 9, 16, 25]


def test_any_damaged_byte_costs_one_cell(filled):
    path = filled.path("toy")
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    start = len(lines[0]) + len(lines[1])
    for position in range(start, start + len(lines[2]) - 1, 7):
        for byte in (b"\x00", b"7", b"\xff"):
            damaged = whole[:position] + byte + whole[position + 1 :]
            if damaged == whole:
                continue
            path.write_bytes(damaged)
            records, problems = filled.read("toy")
            assert [r["cell"]["i"] for r in records] == [0, 1, 3, 4]
            assert len(problems) == 1
            assert "line 3" in problems[0]
            assert path.read_bytes() == damaged


@pytest.mark.parametrize("line", [b"[]", b"{}", b"null", b"7", b'{"sha256": 1}', b"\x80", b"[" * 100_000, b"NaN"])
def test_lines_that_are_no_record(filled, line):
    with filled.path("toy").open("ab") as file:
        file.write(line + b"\n")
    records, problems = filled.read("toy")
    assert len(records) == 5
    assert len(problems) == 1


SHAPES = [
    ("version", "1"),
    ("position", "first"),
    ("cell", [1]),
    ("cell", {"i": {"float": [1]}}),
    ("rows", None),
    ("rows", [1, 2]),
    ("rows", [{"square": {"float": "abc"}}]),
    ("key", "no digits"),
    ("error", None),
    ("error", {"type": "ArithmeticError"}),
    ("experiment", "other"),
    ("status", "done"),
    ("status", "perhaps"),
    ("seconds", "long"),
    ("sources", 7),
    ("provenance", []),
    ("provenance", {"commit": None, "dirty": None, "cpu": None}),
]
GONE = object()


@pytest.mark.parametrize(("name", "value"), [*SHAPES, *((name, GONE) for name in dict(SHAPES) if name != "sources")])
def test_a_record_of_another_shape_is_damaged(filled, name, value):
    """Its SHA-256 is right: a program wrote it that was not ours."""
    made = {**record(5, "failed"), name: value}
    if value is GONE:
        del made[name]
    with filled.path("toy").open("a") as file:
        file.write(json.dumps({**made, "sha256": store._digest(made)}) + "\n")
    journal = filled.open("toy")
    assert (len(journal.rows()), len(journal.failures())) == (5, 0)
    assert [problem.partition(", ")[2] for problem in journal.problems] == [
        "line 6: damaged; skipped, its cell counts as not computed"
    ]
    assert len(filled.done("toy")[0]) == 5


def test_another_schema_is_an_error_that_says_so(filled, tmp_path):
    filled.append({**record(5), "schema": store.SCHEMA + 1})
    with pytest.raises(StoreError, match=r"line 6.*schema 2.*--results"):
        filled.read("toy")
    damaged = Store(tmp_path / "other")  # the control: a damaged digit is damage, not another schema
    damaged.folder.mkdir()
    line = filled.path("toy").read_bytes().splitlines()[0].replace(b'"schema":1', b'"schema":3')
    damaged.path("toy").write_bytes(line + b"\n")
    assert damaged.read("toy")[0] == []


# ---------------------------------------------------------------- which record counts


def test_the_last_success_counts(tmp_path):
    results = Store(tmp_path)
    for r in (record(1, "failed"), record(1), record(2), record(3, i=1, position=1), record(9, "failed", i=1)):
        results.append(r)
    table = results.rows("toy")
    assert table["i"].tolist() == [1, 2]  # in the order of the cells
    assert table["square"].tolist() == [9, 4]
    assert results.open("toy").failures().empty
    assert len(results.done("toy")[0]) == 2


def test_a_new_environment_replaces_even_by_failure(tmp_path, monkeypatch):
    """What worked with other versions is not shown for what fails with these."""
    results = Store(tmp_path)
    results.append(record(1))
    monkeypatch.setattr(store, "_packages", lambda: {"numpy": "99"})
    assert bytes.fromhex(store.cell_key("toy", 1, {"i": 1})) not in results.done("toy")[0]
    results.append(record(1, "failed"))
    assert results.rows("toy")["status"].tolist() == ["failed"]


@pytest.mark.parametrize("status", ["done", "failed"])
def test_what_is_as_it_was_counts_again(tmp_path, monkeypatch, status):
    """A user's method, or a package, was changed and changed back: the later record must not stand for the earlier."""
    results = Store(tmp_path)
    results.append(record(1))
    key = bytes.fromhex(store.cell_key("toy", 1, {"i": 1}))
    with monkeypatch.context() as changed:
        changed.setattr(store, "_packages", lambda: {"numpy": "99"})
        results.append(record(2, status, position=1, i=1))
    assert results.done("toy")[1] == {key}
    assert results.latest("toy")[0]["rows"] != [{"square": 1.0}], "negative control"
    results.revive("toy", {key})
    assert results.latest("toy")[0]["rows"] == [{"square": 1.0}]
    assert key not in results.done("toy")[1]


def test_other_sources_replace_even_by_failure(tmp_path):
    """What worked with other source code is not shown for what fails with this, and is tried again."""
    results = Store(tmp_path)
    results.append({**record(1), "sources": "a"})
    results.append({**record(1, "failed"), "sources": "a"})
    assert results.rows("toy")["status"].tolist() == ["done"]
    assert list(results.done("toy")[0].values()) == ["a"]
    results.append({**record(1, "failed"), "sources": "b"})
    assert results.rows("toy")["status"].tolist() == ["failed"]
    assert results.done("toy")[0] == {}
    results.append({**record(1), "sources": "b"})
    assert list(results.done("toy")[0].values()) == ["b"]


def test_only_the_newest_version_is_shown(tmp_path):
    results = Store(tmp_path)
    for r in (record(1), record(2), record(2, version=2)):
        results.append(r)
    assert results.rows("toy")["i"].tolist() == [2]


def test_failures_are_rows(tmp_path):
    results = Store(tmp_path)
    for r in (record(2), record(1, "failed")):
        results.append(r)
    table = results.rows("toy")
    assert table["i"].tolist() == [1, 2]
    assert table["status"].tolist() == ["failed", "done"]
    assert table["failure"][0] == "ArithmeticError: attempt 1"
    assert np.isnan(table["square"][0])
    assert results.open("toy").failures()["error_message"].tolist() == ["attempt 1"]
    facts = results.open("toy").provenance().set_index("key").loc[table["key"][0]]
    assert facts["numpy"] == np.__version__


def test_nothing_stored(tmp_path):
    results = Store(tmp_path / "missing")
    assert results.rows("toy").empty
    assert {"key", "status", "failure"} <= set(results.rows("toy").columns)
    assert results.open("toy").failures().empty
    assert results.done("toy") == ({}, set(), [])
    assert not results.folder.exists()


# ---------------------------------------------------------------- where nothing can be written


def failing(monkeypatch, name, code, after=0):
    """os.<name> raises this error from its call number `after` on; writes before that are cut short."""
    real, calls = getattr(os, name), []

    def broken(*arguments):
        calls.append(arguments)
        if len(calls) > after:
            raise OSError(code, os.strerror(code))
        return real(arguments[0], arguments[1][:100]) if name == "write" else real(*arguments)

    monkeypatch.setattr(store.os, name, broken)


@pytest.mark.parametrize("name", ["write", "fsync"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO])
@pytest.mark.parametrize("after", [0, 1])
def test_a_failed_append_leaves_the_journal_as_it_was(filled, monkeypatch, name, code, after):
    before = filled.path("toy").read_bytes()
    with monkeypatch.context() as patch:
        failing(patch, name, code, after=after if name == "write" else 0)
        with pytest.raises(StoreError) as caught:
            filled.append(record(5))
    message = str(caught.value)
    assert str(filled.folder) in message
    assert os.strerror(code) in message
    assert "--results" in message
    assert filled.path("toy").read_bytes() == before
    filled.append(record(5))
    assert squares(filled)[-1] == 25


def test_where_not_even_that_works_the_torn_line_is_skipped(filled, monkeypatch):
    with monkeypatch.context() as patch:
        failing(patch, "write", errno.ENOSPC, after=1)
        failing(patch, "ftruncate", errno.EIO)
        with pytest.raises(StoreError, match="No space left"):
            filled.append(record(5))
    assert len(filled.read("toy")[1]) == 1
    filled.append(record(5))
    assert squares(filled) == [0, 1, 4, 9, 16, 25]


def test_read_only_folder(filled, monkeypatch):
    """Permission bits do not bind root, who may be running this: the system call is made to refuse."""
    failing(monkeypatch, "open", errno.EROFS)
    with pytest.raises(StoreError, match=r"Read-only.*--results"):
        filled.append(record(5))


@pytest.mark.parametrize("code", [errno.EROFS, errno.ENOSPC])
def test_a_folder_is_checked_before_anything_is_computed(tmp_path, monkeypatch, code):
    results = Store(tmp_path / "a" / "b")
    results.check_writable()
    assert list(results.folder.iterdir()) == []  # the probe is gone
    failing(monkeypatch, "fsync", code)
    with pytest.raises(StoreError, match="--results"):
        results.check_writable()
    assert list(results.folder.iterdir()) == []


@pytest.mark.parametrize("below", [".", "deeper/still"])
def test_a_file_in_place_of_the_folder(tmp_path, below):
    (tmp_path / "taken").write_text("something else")
    with pytest.raises(StoreError, match=r"taken.*--results"):
        Store(tmp_path / "taken" / below).check_writable()
    assert (tmp_path / "taken").read_text() == "something else"


# ---------------------------------------------------------------- other processes


WRITER = """
import os, sys, time
from lagrange_bench.results import store
real = os.write

def short(file, data):  # many short writes for one line, with time for the other writer in between
    time.sleep(1e-5)
    return real(file, data[:64])

store.os.write = short
if sys.argv[3] == "without lock":
    store.fcntl = None
store.provenance.provenance = lambda: {"utc": "", "commit": None, "dirty": None, "cpu": None}
results = store.Store(sys.argv[1])
print("ready", flush=True)
sys.stdin.read()
for i in range(60):
    cell = {"writer": sys.argv[2], "i": i}
    results.append(store.make_record("toy", 1, i, cell, status="done", rows=[], error=None, warnings=[], seconds=0))
"""


@pytest.mark.processes
@pytest.mark.parametrize("lock", ["with lock", "without lock"])
def test_two_writers(tmp_path, lock):
    """The negative control without the lock shows that it is the lock that keeps lines apart."""
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        subprocess.Popen([*command, "a", lock], **pipes) as one,
        subprocess.Popen([*command, "b", lock], **pipes) as two,
    ):
        for writer in (one, two):
            writer.stdout.readline()
        for writer in (one, two):  # both are ready: now
            writer.stdin.close()
        assert [writer.wait(60) for writer in (one, two)] == [0, 0]
    records, problems = Store(tmp_path).read("toy")
    if lock == "with lock":
        assert problems == []
        for name in ("a", "b"):
            assert [r["cell"]["i"] for r in records if r["cell"]["writer"] == name] == list(range(60))
    else:
        assert problems


LIMITED = """
import resource, signal, sys
from lagrange_bench.results import store
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
results = store.Store(sys.argv[1])
results.check_writable()
for i in range(100):
    cell = {"i": i}
    results.append(store.make_record("toy", 1, i, cell, status="done", rows=[], error=None, warnings=[], seconds=0))
    print(i, flush=True)
"""


@pytest.mark.processes
def test_a_real_limit_on_file_sizes(tmp_path):
    run = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert "StoreError" in run.stderr
    assert "File too large" in run.stderr
    records, problems = Store(tmp_path).read("toy")
    assert problems == []
    assert [r["cell"]["i"] for r in records] == [int(word) for word in run.stdout.split()]  # all that was confirmed
    assert records


# ---------------------------------------------------------------- provenance and places


def test_provenance_is_flat_and_discreet():
    facts = provenance.provenance()
    json.dumps(facts, allow_nan=False)
    assert facts["numpy"] == np.__version__
    assert set(facts) >= {"utc", "commit", "dirty", "python", "cpu", "cores", "platform", "lagrange-bench", "heyoka"}
    assert os.uname().nodename not in json.dumps(list(facts.values()))


def test_provenance_never_fails(monkeypatch):
    def broken(*_, **__):
        raise OSError("no such thing")

    monkeypatch.setattr(provenance.subprocess, "run", broken)
    monkeypatch.setattr(provenance.Path, "read_text", broken)
    assert provenance._git_state() == (None, None)
    provenance._cpu_model()
    assert provenance.version("no-such-package") is None


def test_default_results(monkeypatch, tmp_path):
    root = Path(store.__file__).resolve().parent.parent
    assert store.default_results("quick") == root / "results" / "local" / "quick"
    assert store.default_results() == root / "results" / "reference"
    monkeypatch.setattr(provenance, "checkout", lambda: None)  # installed
    monkeypatch.chdir(tmp_path)
    assert store.default_results("quick") == Path("results/quick")
    assert store.default_results() == Path("results/full")
    (tmp_path / "results" / "quick").mkdir(parents=True)
    assert store.default_results() == Path("results/quick")


def test_a_folder_of_the_checkout_is_found_from_elsewhere(filled, tmp_path, monkeypatch):
    """As the commands on a page name it; a folder of that name here comes first."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.setattr(provenance, "checkout", lambda: tmp_path.parent)
    chosen = Path(tmp_path.name)
    found, notes = store.find_results(chosen)
    assert (found, notes) == (tmp_path, [f"no folder {chosen} here: showing {tmp_path}"])
    chosen.mkdir()
    with pytest.raises(FileNotFoundError, match="nothing is stored in"):
        store.find_results(chosen)
    monkeypatch.setattr(provenance, "checkout", lambda: None)
    with pytest.raises(FileNotFoundError, match="no such folder of results"):
        store.find_results(Path("nowhere"))


def unexplained(columns):
    """Fields of the cells and rows of the reference run that a table of columns does not name: experiment → their names."""
    found = {}
    for journal in sorted((Path(store.__file__).parent / "reference").glob("*.jsonl")):
        lines = [line for line in columns.splitlines() if line.startswith(("| all ", f"| {journal.stem} "))]
        names = set()
        for line in journal.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            names.update(record["cell"], *record["rows"])
        names = {name for name in names if not name.startswith("kept: ")} - set(
            re.findall("`([^`]+)`", "\n".join(lines))
        )
        found |= {journal.stem: names} if names else {}
    return found


def test_every_column_is_explained():
    columns = (Path(store.__file__).parent / "README.md").read_text(encoding="utf-8").partition("\n## Columns\n")[2]
    assert not unexplained(columns)
    assert unexplained(columns.replace("`fraction`", ""))["drift"] == {"fraction"}
