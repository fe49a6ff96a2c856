"""The store loses nothing it has confirmed, never takes a damaged line for a result, and shows what is chosen."""

import errno
import json
import math
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench.experiments import drift, phase
from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS
from lagrange_bench.results import provenance, store
from lagrange_bench.results.choice import Choice
from lagrange_bench.results.store import Store, StoreError, make_record


def record(attempt, status="done", version=1, **cell):
    failed = {"error": {"type": "ArithmeticError", "message": f"attempt {attempt}", "traceback": "…"}}
    outcome = {"done": {"rows": [{"square": float(attempt**2)}]}, "failed": failed}[status]
    return store.make_record("toy", version, attempt, cell or {"i": attempt}, **outcome)


@pytest.fixture
def filled(tmp_path):
    results = Store(tmp_path)
    results.append(*(record(i) for i in range(5)))
    return results


def squares(results):
    return [r["rows"][0]["square"] for r in results.read("toy")[0]]


AWKWARD = {
    "nan": math.nan,
    "inf": np.float64(np.inf),
    "minus_zero": -0.0,
    "tiny": 5e-324,
    "single": np.float32(0.1),
    "count": np.int64(2**62),
    "flag": np.bool_(True),
    "quarter": Fraction(1, 4),
}


def test_rows_survive_bit_by_bit(tmp_path):
    cell, words = {"i": 1, "label": np.str_("name"), "limit": math.inf}, {"text": "Bäcklund λ\n\\ud800", "none": None}
    rows = store.clean_rows(cell, [AWKWARD | words])
    results = Store(tmp_path)
    results.append({**record(1), "cell": store.clean(cell), "rows": rows})
    json.loads(results.path("toy").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    (row,) = results.rows("toy").to_dict("records")
    for name, value in AWKWARD.items():
        assert np.float64(row[name]).tobytes() == np.float64(value).tobytes(), name
    assert (row["text"], row["none"], row["label"], row["limit"]) == (*words.values(), "name", math.inf)
    assert row["flag"] is np.True_ or row["flag"] is True


@pytest.mark.parametrize(
    ("row", "error"),
    [
        *(({"x": value}, TypeError) for value in (np.zeros(3), 1j, [1.0], {"a": 1})),
        *(({"samples_ns": value}, TypeError) for value in (["x"], [math.nan])),
        ({"h": 0.2}, ValueError),
        ({"status": "done"}, ValueError),
    ],
)
def test_rows_that_cannot_be_stored_are_refused(row, error):
    with pytest.raises(error, match=str(next(iter(row))) if error is ValueError else None):
        store.clean_rows({"h": 0.1}, [row])
    assert store.clean_rows({"h": 0.1}, [{"h": np.float64(0.1), "samples_ns": [1.5, 2]}])


def test_a_key_is_of_everything_that_matters(monkeypatch):
    def made(experiment="toy", version=1, **cell):
        return store.cell_key(experiment, version, {"a": 1, "b": 2.0, **cell})

    assert made() == store.cell_key("toy", 1, {"b": np.float64(2.0), "a": np.int64(1)})
    keys = {made(), made("two"), made(version=2), made(b=2.5)}
    monkeypatch.setattr(store, "_packages", lambda: {"numpy": "2.0"})
    assert len(keys | {made()}) == 5
    golden = "6d8442c1de6ff5ea2133bc23150e855a869c81875ae628560e5ff26e54e2ca84"
    assert store.cell_key("drift", 3, {"method": "rk4", "h": 0.125}) == golden, "published rows keep their keys"


@pytest.mark.parametrize("missing", [1, 2, 10_000])
def test_a_torn_last_line_costs_one_cell(filled, missing):
    path = filled.path("toy")
    whole = path.read_bytes()
    torn = whole[: -min(missing, len(whole.splitlines()[-1]))]
    path.write_bytes(torn)
    records, problems = filled.read("toy")
    kept = 5 if missing == 1 else 4  # the end of the line alone: the record is whole
    assert (len(records), len(problems)) == (kept, 5 - kept)
    assert all("line 5: cut off" in problem for problem in problems)
    filled.append(record(5))  # on a fresh line
    assert squares(filled) == [i * i for i in (*range(kept), 5)]
    assert path.read_bytes().startswith(torn)  # nothing is rewritten


def test_lines_that_are_no_record_are_skipped(filled):
    lines = [b"[]", b"7", b'{"sha256": 1}', b"\x80", b"[" * 100_000]
    filled.append({**record(5), "experiment": "other"})
    with filled.path("toy").open("ab") as file:
        file.writelines(line + b"\n" for line in (*lines, filled.path("other").read_bytes()[:-1]))
    journal = filled.open("toy")
    assert len(journal.rows()) == len(journal.done()) == 5
    assert [f"line {n}: damaged" in text for n, text in enumerate(journal.problems, 6)] == [True] * (len(lines) + 1)


ATTEMPTS = [  # how a cell ended, with which environment or sources; and the attempt whose rows are shown then
    ("failed", "a", None),
    ("failed", "a", None),
    ("done", "a", 2),
    ("done", "a", 3),
    ("failed", "a", 3),
    ("failed", "b", None),
    ("done", "b", 6),
    ("failed", "a", None),
]


@pytest.mark.parametrize("field", ["key", "sources"])
def test_the_last_success_counts_but_for_what_another_environment_or_source_made(tmp_path, field):
    """What worked with others is not shown for what fails with these, nor after a change back, and is computed again."""
    results = Store(tmp_path)
    for attempt, (status, value, shown) in enumerate(ATTEMPTS):
        results.append({**record(attempt, status, i=1), field: value})
        (row,) = results.rows("toy").to_dict("records")
        assert (row["status"], row.get("square")) == (("done", shown**2) if shown else ("failed", None))
        assert shown or row["failure"] == f"ArithmeticError: attempt {attempt}", "of failures the last"
        assert len(results.open("toy").done()) == (shown is not None)


def test_a_failed_append_says_what_to_do_and_costs_no_other_cell(filled, monkeypatch):
    real = os.write

    def full(file, data):
        if len(data) < 400:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(file, data[:100])

    with monkeypatch.context() as disk:
        disk.setattr(store.os, "write", full)
        with pytest.raises(StoreError, match=rf"{filled.folder}.*{os.strerror(errno.ENOSPC)}.*--results"):
            filled.append(record(5))
    assert len(squares(filled)) == 5
    filled.append(record(5))
    assert squares(filled)[-1] == 25


def test_what_is_confirmed_is_synced(filled, monkeypatch):
    synced = []
    monkeypatch.setattr(store.os, "fsync", lambda file: synced.append(os.readlink(f"/proc/self/fd/{file}")))
    filled.append(record(5))
    assert synced == [str(filled.path("toy"))]


WRITER = """
import sys, time
from lagrange_bench.results import store
real = store.os.write

def short(file, data):  # many short writes for one line, with time for the other process in between
    time.sleep(1e-5)
    return real(file, data[:64])

store.os.write = short
store.provenance.provenance = lambda: {"utc": "", "commit": None, "dirty": None, "cpu": None}
results = store.Store(sys.argv[1])
print("ready", flush=True)
sys.stdin.read()
for i in range(60):
    cell = {"writer": sys.argv[2], "i": i}
    results.append(store.make_record("toy", 1, i, cell))
"""


@pytest.mark.processes
def test_two_writers_and_a_reader(tmp_path):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), name], **pipes) for name in "ab"]
    for writer in writers:
        writer.stdout.readline()
    for writer in writers:  # both are ready: now
        writer.stdin.close()
    torn = []
    while any(writer.poll() is None for writer in writers):
        torn += Store(tmp_path).read("toy")[1]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    for writer in writers:
        writer.stdout.close()
    records, problems = Store(tmp_path).read("toy")
    assert (problems, torn) == ([], [])
    for name in "ab":
        assert [r["cell"]["i"] for r in records if r["cell"]["writer"] == name] == list(range(60))


def test_provenance_is_flat_and_discreet():
    facts = provenance.provenance()
    json.dumps(facts, allow_nan=False)
    assert (facts["numpy"], provenance.version("no-such-package")) == (np.__version__, None)
    assert set(facts) >= {"utc", "commit", "dirty", "python", "cpu", "cores", "platform", "lagrange-bench", "heyoka"}
    assert os.uname().nodename not in json.dumps(list(facts.values()))


def test_names_of_results_mean_the_same_from_any_folder(monkeypatch, tmp_path):
    """A folder of the same name here is a path, ./quick; the error of an absent run says where it would be."""

    def fill(folder):
        folder.mkdir(parents=True)
        (folder / "drift.jsonl").write_text("{}\n")

    monkeypatch.setattr(provenance, "checkout", lambda: tmp_path / "clone")
    local = tmp_path / "clone" / "lagrange_bench" / "results" / "local"
    fill(tmp_path / "quick")
    monkeypatch.chdir(tmp_path)
    assert store.find_results("reference") == store.find_results(None) == store.REFERENCE
    assert store.find_results("./quick") == store.find_results(Path("quick")) == Path("quick")
    with pytest.raises(FileNotFoundError, match=f"no quick run yet in {local / 'quick'}: .* --profile quick"):
        store.find_results("quick")
    fill(local / "quick")
    assert (store.name_of(store.find_results("quick")), store.name_of(Path("quick"))) == ("quick", None)
    monkeypatch.setattr(provenance, "checkout", lambda: None)  # of an installed package
    assert store.default_results("quick") == Path("results/quick")


def test_every_column_is_explained():
    """Fields of the published cells and rows, in the table of columns."""
    columns = (Path(store.__file__).parent / "README.md").read_text(encoding="utf-8").partition("\n## Columns\n")[2]
    for journal in sorted(store.REFERENCE.glob("*.jsonl")):
        lines = [line for line in columns.splitlines() if line.startswith(("| all ", f"| {journal.stem} "))]
        names = set()
        for record in map(json.loads, journal.read_text(encoding="utf-8").splitlines()):
            names.update(record["cell"], *record["rows"])
        explained = "\n".join(lines)
        assert [n for n in sorted(names) if f"`{n}`" not in explained and not n.startswith("kept: ")] == [], (
            journal.stem
        )


ROWS = [{"error": 1.0}]


def test_what_is_chosen_is_shown(tmp_path):
    named = (("rk4", "generic"), ("strang", "generic"), ("strang", "mine"))
    cells = [*({"method": name, "state": top} for name, top in named), {"part": "cost"}]
    Store(tmp_path).append(*(make_record("toy", 1, i, cell, rows=ROWS) for i, cell in enumerate(cells)))
    for choice, taken in ((Choice(("strang",)), [1, 2]), (Choice(("rk4", "strang"), ("generic",)), [0, 1])):
        assert [record["position"] for record in Store(tmp_path, choice).open("toy").latest] == taken
        choice.check(cells)
    with pytest.raises(ValueError, match=r"^--methods: no cell here has the method 'rk44'; did you mean 'rk4'\?$"):
        Choice(("rk44",)).check(cells)
    with pytest.raises(ValueError, match=r"^--tops: no cell here has the top 'xyz'\. Known: generic, mine$"):
        Choice(tops=("xyz",)).check(cells)


def test_a_figure_is_as_wide_as_asked_and_names_the_chosen_methods_that_it_lacks(run, tmp_path, monkeypatch):
    cell = {"part": "h", "state": "generic", "span": 64, "h": 0.25}
    for module, method in ((phase, "rk4"), (drift, "strang")):
        name = module.__name__.split(".")[-1]
        Store(tmp_path).append(make_record(name, module.VERSION, 0, {**cell, "method": method}, rows=ROWS))
        monkeypatch.setattr(module, "draw", lambda rows: {"h": style.figure("column")[0]})
    drawn = set()
    for width in style.WIDTHS:
        words = ("--methods", "rk4,strang", "--results", tmp_path, "--width", width, "--output", tmp_path / "h.svg")
        code, _, err = run("figure", "phase_h", *words)
        assert (code, "phase: no rows of strang\n" in err) == (0, True), err
        drawn.add((tmp_path / "h.svg").read_bytes())
    assert len(drawn) == len(style.WIDTHS)


def test_a_plug_in_stands_out_and_a_few_are_all_named():
    assert not [name for name in METHODS if style.of(name)["color"] == style.OWN]
    assert style.of("somebody:METHOD")["color"] == style.OWN
    many = ["backlund", "rk4", "strang", "kahan", "gauss4", "taylor_fixed", "rkmk4", "theta_functions", "gauss6"]
    assert style.looks(many, named=["backlund"])["rk4"]["label"] == "_thin"
    assert [look for look in style.looks(many[: style.FEW], named=[]).values() if look["label"].startswith("_")] == []
