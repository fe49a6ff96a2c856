"""Sweeps from TOML files: what is computed is what the file says, and what is wrong in it is told with its place."""

import re
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from lagrange_bench.arguments import numbers
from lagrange_bench.commands.run import _own_modules
from lagrange_bench.experiments import sweep
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import states
from lagrange_bench.integrators import INVARIANTS, METHODS, PERTURBED_TOPS, TOPS, integrate
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.results.store import Store
from lagrange_bench.runner import engine
from tests.reference import largest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "sweeps.md"
GOOD = """
[tops.heavy]
alpha = 1.5
J = [0.3, -0.4, 2.0]
x = [0.48, 0.6, 0.64]

[[sweep]]
methods = ["strang", "backlund"]
h = [0.5, 0.25]
time = 50
"""
FIELD = 'alpha = 1.5\npotential = "charge"\nparameters = [0.1, 0, 0, 2]'
IN_A_FIELD = GOOD.replace('"backlund"', '"rk4"').replace("alpha = 1.5", FIELD)


@pytest.fixture(autouse=True)
def nothing_read(monkeypatch):
    monkeypatch.setattr(sweep, "_cells", {})


@pytest.fixture
def write(tmp_path):
    def call(text, name="my.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return call


def cells(path):
    return load(sweep.read(path)).cells("quick")


@pytest.fixture
def computed(in_process, tmp_path, monkeypatch):
    monkeypatch.setitem(vars(METHODS), "_entries", METHODS._entries)

    def rows(path):
        engine.run([sweep.read(path)], "quick", tmp_path, show=False)
        return Store(tmp_path).rows("sweep_my")

    return rows


A_TOP, J, X, H, TIME = "alpha = 1.5", "[0.3, -0.4, 2.0]", "[0.48, 0.6, 0.64]", "h = [0.5, 0.25]", "time = 50"
BAD = [  # what to replace in GOOD, by what, where the message says it is, and what it must say
    ("[[sweep]]", "[sweep]", "", "write [[sweep]], with two brackets"),
    ("[tops.heavy]", "[top.heavy]", "", "unknown key 'top'; did you mean 'tops'?"),
    (X, "[0, 0, 0]", "[tops.heavy]", "x = 0"),
    (f"{A_TOP}\nJ = {J}", "alpha = 0\nJ = [0, 0, 0]", "[tops.heavy]", "at rest for ever"),
    ("tops.heavy", "tops.generic", "[tops.generic]", "the bench has a top of this name"),
    ("[tops", 'name = "a b"\n[tops', "", "name must"),
    ('"backlund"', '"backlnd"', "[[sweep]], methods", "did you mean 'backlund'?"),
    ('"backlund"', '"dop853"', "[[sweep]], h", "dop853 chooses its own steps: give it rtol"),
    ('methods = ["strang", "backlund"]\n', "", "[[sweep]]", "methods must be given"),
    (TIME, 'time = "long"', "[[sweep]]", "time must be"),
    (A_TOP, "alfa = 1.5", "[tops.heavy]", "did you mean 'alpha'?"),
    (H, "rtol = [1e-6]", "[[sweep]], rtol", "strang steps by h: give it h"),
    (H, "h = [0.5, 0]", "[[sweep]]", "h[1] must not be 0"),
    (H, "h = [0.5]\ntol = [1e-3]", "[[sweep]]", "one of h, tol, rtol; got h and tol"),
    (H, "h = [0.1, 1e200]", "[[sweep]]", "h[1] must be between 1e-100 and 1e+100"),
    (H, "h = [1e-99]", "[[sweep]]", "time / h must be at most"),
    (TIME, "time = -1", "[[sweep]]", "time must be positive"),
    (TIME, "time = 50\noptions = { compensated = 7 }", "[[sweep]], options of strang", "compensated must be"),
    (A_TOP, 'alpha = 1.5\npotential = "tide"', "[tops.heavy], potential", "4 numbers (k, n1, n2, n3); got 0"),
    (A_TOP, "alpha = 1.5\nparameters = [1]", "[tops.heavy]", "parameters: of which potential?"),
    (A_TOP, FIELD.replace("[0.1, 0, 0, 2]", "[1, 0.48, 0.6, 0.64]"), "[tops.heavy]", "charge is not finite"),
    (TIME, 'time = 50\ntops = ["magnet"]', "[[sweep]], methods", "backlund does not take the potential charge"),
]


@pytest.mark.parametrize(("old", "new", "place", "words"), BAD, ids=[f"{old[:8]} {new[-24:]}" for old, new, *_ in BAD])
def test_what_is_wrong_is_told_with_its_place(write, old, new, place, words):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}") as raised:
        sweep.read(path)
    assert place in str(raised.value)
    assert words in str(raised.value).partition(place or str(path))[2]


def test_two_files_of_one_name_and_none(write, tmp_path):
    with pytest.raises(ValueError, match=r"lagrange-bench run FILE\.toml"):
        load("sweep_none").cells("quick")
    (tmp_path / "other").mkdir()
    first = sweep.read(write(GOOD))
    assert sweep.read(write(GOOD, "other/my.toml")) == first  # the same cells: no matter
    with pytest.raises(ValueError, match="another file of this run is called 'my'"):
        sweep.read(write(GOOD.replace(TIME, "time = 60"), "other/my.toml"))


def test_what_a_file_asks_for(write):
    more = 'options = {}\n[[sweep]]\nmethods = ["strang"]\nh = [0.5, -2]\ntime = 50\nsamples = 32\n'
    found = cells(write(GOOD + more))
    sizes = {0.5: 100, 0.25: 200}
    both = [(method, h, steps) for method in ("strang", "backlund") for h, steps in sizes.items()]
    assert [(cell["method"], cell["h"], cell["steps"]) for cell in found] == [*both, ("strang", -2.0, 25)]
    start = {"top": "heavy", "alpha": 1.5, "y0": "0.3,-0.4,2.0,0.48,0.6,0.64"}
    assert found[0] == {"method": "strang", **start, "options": "", "h": 0.5, "steps": 100, "samples": 32}, "its key"
    assert sweep.read(write(GOOD, "another.toml")) == "sweep_another"


def test_cells_carry_the_potential_and_name_its_module(write):
    found = cells(write(IN_A_FIELD + 'tops = ["heavy", "weak_tide", "generic"]\n'))
    kinds = {cell["top"]: (cell.get("potential"), cell.get("parameters")) for cell in found}
    own, tide, none = ("charge", "0.1,0.0,0.0,2.0"), ("tide", "0.0001,1.0,0.0,0.0"), (None, None)
    assert kinds == {"heavy": own, "weak_tide": tide, "generic": none}
    assert _own_modules(["sweep_my"]) == []
    own = IN_A_FIELD.replace('"charge"', '"lagrange_bench.integrators.problem.potentials:CHARGE"')
    assert _own_modules([sweep.read(write(own, "own.toml"))]) == ["lagrange_bench.integrators.problem.potentials"]


def test_options_are_those_of_integrate(write):
    text = GOOD.replace('"strang", ', "") + 'options = { lam = "0.1+0.5j", pin = 0 }\nsamples = 2\n'
    first, _ = cells(write(text))
    assert first["options"] == "lam=0.1+0.5j, pin=0"
    top, y0 = LagrangeTop(first["alpha"]), np.array(numbers(first["y0"]))
    expected = integrate(top, y0, 0.5 * top.scales(y0)[2], 100, every=1, method="backlund", lam=0.1 + 0.5j, pin=0)
    rows = sweep.measure(first)
    drift = (top.invariants(expected.y)[[1, 100], 0] - top.invariants(y0)[0]) / top.invariant_scales(y0)[0]
    assert [row["H"] for row in rows] == pytest.approx(drift, rel=1e-4)
    assert [row["t"] for row in rows] == [0.5, 50.0]


def test_the_documented_file_works(write):
    (text,) = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert len(cells(write(text))) == 3 * 2 * 3 + 2 + 1
    named = "".join(line.split("|")[1] for line in PAGE.read_text("utf-8").splitlines() if line.startswith("|"))
    assert set(re.findall(r"`(\w+)`", named)) == set(sweep.KEYS["sweep"]) | {"name", "potential", "parameters"}
    assert set(tomllib.loads(text)) == set(sweep.KEYS["file"])


def cell_of(name, **more):
    named = TOPS[name] if name in TOPS else PERTURBED_TOPS[name]
    return {"top": name, "alpha": 1.0, "y0": ",".join(map(repr, named.state.tolist())), "options": "", **more}


def test_rows_say_what_the_run_did():
    cell = cell_of("generic", method="strang")
    rows = sweep.measure({**cell, "h": 0.125, "steps": 512, "samples": 10})
    assert [row["t"] for row in rows] == [0.125 * 2**k for k in range(10)]
    assert set(rows[0]) == {"t", "H", "J3", "C1", "C2", "error", "time", "angle", "seconds"}
    halved = sweep.measure({**cell, "h": 0.0625, "steps": 1024, "samples": 11})
    for name in ("error", "time"):
        assert 3.8 < rows[-1][name] / halved[-1][name] < 4.2  # of second order
    assert largest([row[name] for row in rows for name in ("J3", "C1", "C2")]) < 1e-14
    assert max(abs(row["H"]) for row in rows) > 1e-6
    exact = sweep.measure({**cell, "method": "backlund", "h": 0.125, "steps": 512, "samples": 10})
    assert max(row["error"] for row in exact) < 1e-13


@pytest.mark.parametrize("knob", [{"h": 0.5, "steps": 64}, {"rtol": 1e-8, "span": 32.0}])
def test_seconds_leave_out_what_the_first_run_compiles(monkeypatch, knob):
    """On a clock that only runs move: the first one by 60 s."""
    now, runs = [0.0], iter((60.0, *[0.5] * 9))

    def run(*arguments, **options):
        now[0] += next(runs)
        return SimpleNamespace(y=np.tile(TOPS["generic"].state, (3, 1)))

    stepper = SimpleNamespace(advance=lambda y, n: run().y[0], from_start=False)
    monkeypatch.setattr(sweep, "integrate", run)
    monkeypatch.setattr(sweep, "prepare", lambda *arguments, **options: stepper)
    for module in (sweep, states):
        monkeypatch.setattr(module, "perf_counter", lambda: now[0])
    rows = sweep.measure(cell_of("generic", method="strang" if "h" in knob else "dop853", samples=3, **knob))
    assert rows[-1]["seconds"] == (1.5 if "h" in knob else 0.5)


def test_rows_in_a_potential_are_judged_by_the_reference():
    cell = cell_of("strong_tide", method="strang", samples=4, potential="tide", parameters="0.1,1,0,0")
    coarse, fine = (sweep.measure({**cell, "h": 4 / n, "steps": n})[-1] for n in (64, 128))
    assert 3.8 < coarse["error"] / fine["error"] < 4.2  # of second order
    assert largest([coarse[name] for name in ("C1", "C2")]) < 1e-14
    assert abs(coarse["H"]) > 1e-6
    assert all(np.isnan(coarse[name]) for name in ("J3", "time", "angle"))  # there is no such invariant, and no torus
    with pytest.warns(RuntimeWarning, match="no reference solution to compare with"):
        assert np.isnan(sweep.measure({**cell, "h": 1.0, "steps": 3000})[-1]["error"])


def test_a_method_that_must_start_at_the_beginning_does(monkeypatch):
    """A multistep method, started again at every sample, would be another one."""
    cell = cell_of("generic", method="toys.multistep:METHOD", h=0.0625, steps=512)

    def errors():
        return [sweep.measure({**cell, "samples": samples})[-1]["error"] for samples in (2, 9)]

    broken_off = errors()
    assert broken_off[0] != broken_off[1]
    monkeypatch.setattr(sys.modules["toys.multistep"].Adams, "from_start", True)
    through = errors()
    assert through[0] == through[1] not in broken_off


def test_the_runs_are_drawn_in_a_potential_and_out_of_it(write, computed):
    text = IN_A_FIELD.replace(TIME, "time = 5") + 'samples = 4\ntops = ["heavy", "generic"]\n'
    rows = computed(write(text))
    table = sweep.tables(rows)["runs"]
    assert table["largest error"].notna().all()
    assert table["drift of J3"].notna().all()  # a charge on the vertical keeps it
    figures = sweep.draw(rows)
    assert set(figures) == {"time", "h"}
    for figure in figures.values():
        assert [ax.get_title() for ax in figure.axes[::2]] == ["heavy: error", "generic: error"]
        assert all(len([line for line in ax.lines if line.get_label()[0] != "_"]) == 2 for ax in figure.axes)


@pytest.mark.filterwarnings("ignore:no exact solution")
def test_a_method_of_ones_own_and_one_that_fails(write, computed):
    text = GOOD.replace('"backlund"', '"toys.lies:METHOD"').replace("[0.5, 0.25]", "[0.5, 1e99]")
    rows = computed(write(text.replace(TIME, "steps = 9")))
    assert set(rows[rows.status == "done"].method) == {"strang", "toys.lies:METHOD"}
    assert set(rows[rows.status == "failed"].h) == {1e99}
    table = sweep.tables(rows)["runs"]
    assert table.failure.astype(bool).sum() == (rows.status == "failed").sum()

    def texts(rows):
        return {text.get_text() for figure in sweep.draw(rows).values() for text in figure.findobj(Text)}

    assert {METHODS["strang"].label, "a liar"} <= texts(rows)
    assert not any("toys.lies:METHOD" in text for text in texts(rows))
    assert sweep.draw(rows[rows.status == "failed"]) == {}
    lost = rows.assign(method=rows.method.replace("toys.lies:METHOD", "no_such_module:METHOD"))
    assert "no_such_module:METHOD" in texts(lost), "it has the name it was asked for by"


def test_the_finest_run_that_did_not_fail_is_drawn():
    start = {"experiment": "sweep_my", "top": "generic", "method": "strang", "options": "", "error": 1e-9}
    start |= dict.fromkeys(INVARIANTS, 1e-9)
    runs = [
        {**start, "key": "coarser", "h": 0.2, "status": "done", "t": 2.0},
        {**start, "key": "coarse", "h": 0.1, "status": "done", "t": 1.0},
        {**start, "key": "fine", "h": 0.05, "status": "failed", "failure": "StepError"},
    ]
    figure = sweep.draw(pd.DataFrame(runs))["time"]
    drawn = [line for ax in figure.axes for line in ax.lines if line.get_label() == METHODS["strang"].label]
    assert [line.get_xdata().tolist() for line in drawn] == [[1.0], [1.0]]


@pytest.mark.slow
def test_run_draws_and_the_report_needs_no_file(run, answer, write, tmp_path, in_process, one_core):
    data = answer("run", write(GOOD.replace(TIME, "time = 5")), "--results", tmp_path / "results")
    assert data["experiments"]["sweep_my"]["computed"] == 4
    assert {Path(name).name for name in data["drawn"]} >= {"sweep_my_time.svg", "sweep_my_h.svg", "sweep_my_runs.csv"}
    sweep._cells.clear()
    code, out, err = run("report", "--results", tmp_path / "results")
    assert code == 0, out + err
    assert "Sweep my" in (tmp_path / "results" / "page" / "index.html").read_text("utf-8")
