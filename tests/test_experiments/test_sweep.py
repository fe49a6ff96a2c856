"""Sweeps from TOML files: what is computed is what the file says, and what is wrong in it is told with its place."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from lagrange_bench.arguments import numbers
from lagrange_bench.commands.run import _own_modules
from lagrange_bench.experiments import sweep
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.integrators import INVARIANTS, METHODS, PERTURBED_TOPS, TOPS, integrate
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.results.store import Store
from tests.reference import largest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "sweeps.md"
HERE = Path(__file__).resolve().parents[1]  # the tests, where toys are
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


# ---------------------------------------------------------------- what is wrong, and where

BAD = [  # what to replace in GOOD, by what, and what the message must say
    ("[tops.heavy]", "[top.heavy]", "unknown key 'top'; did you mean 'tops'?"),
    ("alpha = 1.5", "alfa = 1.5", "[tops.heavy]: unknown key 'alfa'; did you mean 'alpha'?"),
    ("alpha = 1.5", "", "[tops.heavy] lacks alpha"),
    ("alpha = 1.5", 'alpha = "1.5"', "[tops.heavy], alpha must be a real number; got '1.5'"),
    ("alpha = 1.5", "alpha = inf", "[tops.heavy], alpha must be finite"),
    ("[0.3, -0.4, 2.0]", "[0.3, -0.4]", "[tops.heavy], J must be three numbers; got 2"),
    ("[0.3, -0.4, 2.0]", "0.3", "[tops.heavy], J must be a list"),
    ("[0.48, 0.6, 0.64]", "[0, 0, 0]", "[tops.heavy] has x = 0"),
    ("alpha = 1.5\nJ = [0.3, -0.4, 2.0]", "alpha = 0\nJ = [0, 0, 0]", "at rest for ever"),
    ("tops.heavy", "tops.generic", "[tops.generic]: the bench has a top of this name"),
    ("[[sweep]]", "[sweep]", "write [[sweep]], with two brackets"),
    ("[[sweep]]", "[[sweeps]]", "unknown key 'sweeps'; did you mean 'sweep'?"),
    ("[[sweep]]", "[[sweep]", "not TOML"),
    ('"backlund"', '"backlnd"', "[[sweep]], methods: unknown method 'backlnd'; did you mean 'backlund'?"),
    ('"backlund"', '"json:loads"', "[[sweep]], methods: method json:loads"),
    ('"backlund"', "3", "[[sweep]], methods must be names; got 3"),
    ('methods = ["strang", "backlund"]', "", "[[sweep]], methods must be a list"),
    ('"backlund"', '"dop853"', "[[sweep]], h: dop853 chooses its own steps: give it rtol"),
    ("h = [0.5, 0.25]", "rtol = [1e-6]", "[[sweep]], rtol: strang steps by h: give it h"),
    ("h = [0.5, 0.25]", "h = []", "[[sweep]], h must be a list with something in it"),
    ("h = [0.5, 0.25]", "h = 0.5", "[[sweep]], h must be a list"),
    ("h = [0.5, 0.25]", "h = [0.5, 0]", "[[sweep]], h[1] must not be 0"),
    ("h = [0.5, 0.25]", "h = [true]", "[[sweep]], h[0] must be a real number"),
    ("h = [0.5, 0.25]", "H = [0.5]", "[[sweep]]: unknown key 'H'; did you mean 'h'?"),
    ("h = [0.5, 0.25]", "h = [0.5]\ntol = [1e-3]", "[[sweep]] needs one of h, tol, rtol; got h and tol"),
    ("h = [0.5, 0.25]", "h = [1e-99]", "[[sweep]], time / h must be at most"),
    ("h = [0.5, 0.25]", "h = [1e300]", "[[sweep]], h[0] must be between 1e-100 and 1e+100"),
    ("time = 50", "", "[[sweep]] needs one of time, steps"),
    ("time = 50", "time = -1", "[[sweep]], time must be positive"),
    ("time = 50", "time = 0.01", "[[sweep]], time / h must be at least 1"),
    ("time = 50", "steps = 2.5", "[[sweep]], steps must be a whole number"),
    ("time = 50", "time = 50\nsteps = 3", "got time and steps"),
    ("time = 50", "time = 50\nsamples = 1", "[[sweep]], samples must be at least 2"),
    ("time = 50", 'time = 50\ntops = ["havy"]', "[[sweep]], tops: unknown top 'havy'; did you mean 'heavy'?"),
    ("time = 50", "time = 50\noptions = {}\n[[sweep]]\nh = [1]", "[[sweep]] 2 needs one of time, steps"),
    ("time = 50", "time = 50\noptions = { pin = 0 }", "[[sweep]], options: unknown option 'pin' of strang"),
    ("time = 50", "time = 50\noptions = { compensated = [1] }", "options.compensated must be a number"),
    ("time = 50", "time = 50\noptions = { compensated = 7 }", "[[sweep]], options of strang: compensated must be"),
    ("time = 50", "time = 50\noptions = 3", "[[sweep]], options must be a table"),
    (
        "alpha = 1.5",
        'alpha = 1.5\npotential = "tid"',
        "[tops.heavy], potential: unknown potential 'tid'; did you mean 'tide'?",
    ),
    ("alpha = 1.5", 'alpha = 1.5\npotential = "tide"', "potential tide: 4 numbers (k, n1, n2, n3); got 0"),
    (
        "alpha = 1.5",
        'alpha = 1.5\npotential = "tide"\nparameters = [1, 2]',
        "potential tide: 4 numbers (k, n1, n2, n3); got 2",
    ),
    (
        "alpha = 1.5",
        'alpha = 1.5\npotential = "tide"\nparameters = ["1"]',
        "[tops.heavy], parameters[0] must be a real",
    ),
    ("alpha = 1.5", 'alpha = 1.5\npotential = "tide"\nparameters = 1', "[tops.heavy], parameters must be a list"),
    ("alpha = 1.5", "alpha = 1.5\npotential = 1", "[tops.heavy], potential must be a name; got 1"),
    ("alpha = 1.5", "alpha = 1.5\nparameters = [1]", "[tops.heavy], parameters: of which potential?"),
    (
        "alpha = 1.5",
        'alpha = 1.5\npotential = "charge"\nparameters = [1, 0.48, 0.6, 0.64]',
        "[tops.heavy], y0: the potential charge is not finite",
    ),
    (
        "time = 50",
        'time = 50\ntops = ["magnet"]',
        "[[sweep]], methods: backlund does not take the potential charge: it is a map of the torus of an integrable top",
    ),
    ("[tops", 'name = "a b"\n[tops', "name must consist of letters"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD, ids=[message for *_, message in BAD])
def test_what_is_wrong_is_told_and_nothing_computed(run, write, tmp_path, old, new, message):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    code, out, err = run("run", path, "--results", tmp_path / "results")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert str(path) in err
    assert not (tmp_path / "results").exists()


def test_two_files_of_one_name_and_no_file(write, run, tmp_path):
    (tmp_path / "other").mkdir()
    first = sweep.read(write(GOOD))
    assert sweep.read(write(GOOD, "other/my.toml")) == first  # the same cells: no matter
    with pytest.raises(ValueError, match="another file of this run is called 'my'"):
        sweep.read(write(GOOD.replace("time = 50", "time = 60"), "other/my.toml"))
    assert "No such file" in run("run", tmp_path / "none.toml")[2]
    with pytest.raises(ValueError, match=r"lagrange-bench run FILE\.toml"):
        load("sweep_none").cells("quick")


# ---------------------------------------------------------------- what is read


def test_what_a_file_asks_for(write):
    found = cells(
        write(GOOD + 'options = {}\n[[sweep]]\nmethods = ["strang"]\nh = [0.5, -2]\ntime = 50\nsamples = 32\n')
    )
    assert [(cell["method"], cell["h"], cell["steps"]) for cell in found] == [
        ("strang", 0.5, 100), ("strang", 0.25, 200), ("backlund", 0.5, 100), ("backlund", 0.25, 200), ("strang", -2.0, 25),
    ]  # fmt: skip
    assert {cell["top"] for cell in found} == {"heavy"}
    assert numbers(found[0]["y0"]) == [0.3, -0.4, 2.0, 0.48, 0.6, 0.64]
    assert sweep.read(write(GOOD, "another.toml")) == "sweep_another"


def test_options_are_those_of_integrate(write):
    text = GOOD.replace('"strang", ', "") + 'options = { lam = "0.1+0.5j", pin = 0 }\nsamples = 2\n'
    first, _ = cells(write(text))
    assert first["options"] == "lam=0.1+0.5j, pin=0"
    top, y0 = LagrangeTop(first["alpha"]), np.array(numbers(first["y0"]))
    h = 0.5 * top.scales(y0)[2]
    expected = integrate(top, y0, h, 100, every=1, method="backlund", lam=0.1 + 0.5j, pin=0)
    rows = sweep.measure(first)
    drift = (top.invariants(expected.y)[[1, 100], 0] - top.invariants(y0)[0]) / top.invariant_scales(y0)[0]
    assert [row["H"] for row in rows] == pytest.approx(drift, rel=1e-4)
    assert [row["t"] for row in rows] == [0.5, 50.0]


def test_rows_say_what_the_run_did():
    top, y0 = TOPS["generic"].top, TOPS["generic"].state
    cell = {"method": "strang", "top": "generic", "alpha": 1.0, "y0": ",".join(map(repr, y0.tolist())), "options": ""}
    assert top.alpha == cell["alpha"]
    rows = sweep.measure({**cell, "h": 0.125, "steps": 512, "samples": 10})
    assert [row["t"] for row in rows] == [0.125 * 2**k for k in range(10)]
    assert set(rows[0]) == {"t", "H", "J3", "C1", "C2", "error", "time", "angle", "seconds"}
    halved = sweep.measure({**cell, "h": 0.0625, "steps": 1024, "samples": 11})
    assert 3.8 < rows[-1]["error"] / halved[-1]["error"] < 4.2  # of second order
    assert 3.8 < rows[-1]["time"] / halved[-1]["time"] < 4.2
    assert largest([row[name] for row in rows for name in ("J3", "C1", "C2")]) < 1e-14
    assert max(abs(row["H"]) for row in rows) > 1e-6
    exact = sweep.measure({**cell, "method": "backlund", "h": 0.125, "steps": 512, "samples": 10})
    assert max(row["error"] for row in exact) < 1e-13


def test_beyond_the_exact_solution_the_invariants_remain():
    cell = {"method": "backlund_paper", "top": "w", "alpha": 0.0, "y0": "0.3,-0.4,1.2,0.48,0.6,0.64", "options": ""}
    with pytest.warns(RuntimeWarning, match="no exact solution"):
        rows = sweep.measure({**cell, "h": 1e13, "steps": 10000, "samples": 2})
    assert np.isnan(rows[-1]["error"])
    assert abs(rows[-1]["C1"]) < 1e-12


# ---------------------------------------------------------------- tops in a potential

IN_A_FIELD = GOOD.replace('"backlund"', '"rk4"').replace(
    "alpha = 1.5", 'alpha = 1.5\npotential = "charge"\nparameters = [0.1, 0, 0, 2]'
)


def test_cells_carry_the_potential(write):
    found = cells(write(IN_A_FIELD + 'tops = ["heavy", "weak_tide", "generic"]\n'))
    kinds = {cell["top"]: (cell.get("potential"), cell.get("parameters")) for cell in found}
    assert kinds["heavy"] == ("charge", "0.1,0.0,0.0,2.0")
    assert kinds["weak_tide"] == ("tide", "0.0001,1.0,0.0,0.0")
    assert kinds["generic"] == (None, None)
    assert "potential" not in next(cell for cell in found if cell["top"] == "generic")  # its key is what it was


def test_the_module_of_a_potential_of_the_users_own_is_named_for_the_page(write):
    own = IN_A_FIELD.replace('"charge"', '"lagrange_bench.integrators.problem.potentials:CHARGE"')
    assert _own_modules([sweep.read(write(own))]) == ["lagrange_bench.integrators.problem.potentials"]
    sweep._cells.clear()
    assert _own_modules([sweep.read(write(IN_A_FIELD))]) == []


def test_rows_in_a_potential_are_judged_by_the_reference():
    named = PERTURBED_TOPS["strong_tide"]
    cell = {"method": "strang", "top": "strong_tide", "alpha": 1.0, "options": "", "samples": 4}
    cell |= {"y0": ",".join(map(repr, named.y0)), "potential": "tide", "parameters": "0.1,1,0,0"}
    coarse, fine = (sweep.measure({**cell, "h": 4 / n, "steps": n})[-1] for n in (64, 128))
    assert 3.8 < coarse["error"] / fine["error"] < 4.2  # of second order
    assert largest([coarse[name] for name in ("C1", "C2")]) < 1e-14
    assert abs(coarse["H"]) > 1e-6
    assert all(np.isnan(coarse[name]) for name in ("J3", "time", "angle"))  # there is no such invariant, and no torus
    uniform = sweep.measure({**cell, "parameters": "0,1,0,0", "h": 4 / 64, "steps": 64})[-1]
    assert uniform["J3"] == 0.0
    long = {**cell, "h": 1.0, "steps": 3000}
    with pytest.warns(RuntimeWarning, match="no reference solution to compare with"):
        assert np.isnan(sweep.measure(long)[-1]["error"])


@pytest.mark.processes
def test_a_run_in_a_potential_is_drawn(run, write, tmp_path):
    text = IN_A_FIELD.replace("time = 50", "time = 5") + 'samples = 4\ntops = ["heavy", "generic"]\n'
    results = tmp_path / "results"
    code, out, err = run("run", write(text), "--results", results, "--jobs", "1", "--quiet")
    assert code == 0, out + err
    rows = Store(results).rows("sweep_my")
    table = load("sweep_my").tables(rows)["runs"]
    assert table["largest error"].notna().all()
    assert table["drift of J3"].notna().all()  # a charge on the vertical keeps it
    assert "a reference solution" in table.attrs["caption"]
    assert "a reference solution" in load("sweep_my").draw(rows)["time"].caption
    code, out, err = run("verify", results, "--sample", "2", "--jobs", "1")
    assert code == 0, out + err
    assert run("report", "--results", results)[0] == 0


# ---------------------------------------------------------------- run and report


@pytest.mark.processes
def test_run_draws_and_resumes_and_the_report_needs_no_file(run, write, tmp_path):
    text = GOOD + '[[sweep]]\nmethods = ["dop853", "toys.lies:METHOD"]\nrtol = [1e-6]\ntime = 5\n'
    path, results = write(text.replace(', "toys.lies:METHOD"', "")), tmp_path / "results"
    code, out, err = run("run", path, "--results", results, "--jobs", "2", "--json")
    assert code == 0, out + err
    data = json.loads(out)
    assert data["experiments"]["sweep_my"]["computed"] == 5
    assert {Path(name).name for name in data["drawn"]} >= {"sweep_my_time.svg", "sweep_my_h.svg", "sweep_my_runs.csv"}
    assert all(Path(name).stat().st_size > 100 for name in data["drawn"])
    code, out, err = run("run", path, "--results", results)
    assert (code, err) == (0, "")
    assert re.search(r"^sweep_my +5 +0 +5 ", out, re.MULTILINE)
    page = results / "page"
    assert f"next: lagrange-bench report --results {results}" in out
    assert run("run", path, "--results", tmp_path / "again", "--jobs", "1", "--quiet")[0] == 0
    assert run("compare", results, tmp_path / "again")[0] == 0  # every bit but the seconds
    sweep._cells.clear()
    code, out, err = run("report", "--results", results)
    assert code == 0, out + err
    assert "Sweep my" in (page / "index.html").read_text("utf-8")
    assert (page / "figures" / "sweep_my_time.svg").exists()
    rows = Store(results).rows("sweep_my")
    assert rows.groupby("key", sort=False).method.first().tolist() == [
        "strang",
        "strang",
        "backlund",
        "backlund",
        "dop853",
    ]


@pytest.mark.parametrize("order", [1, -1])
def test_the_finest_run_that_did_not_fail_is_drawn(order):
    start = {"experiment": "sweep_my", "top": "generic", "method": "strang", "options": "", "error": 1e-9}
    start |= dict.fromkeys(INVARIANTS, 1e-9)
    runs = [
        {**start, "key": "coarse", "h": 0.1, "status": "done", "t": 1.0},
        {**start, "key": "fine", "h": 0.05, "status": "failed", "failure": "StepError"},
        {**start, "key": "coarser", "h": 0.2, "status": "done", "t": 2.0},
    ]
    figure = sweep.draw(pd.DataFrame(runs[::order]))["time"]
    drawn = [line for ax in figure.axes for line in ax.lines if line.get_label() == METHODS["strang"].label]
    assert [line.get_xdata().tolist() for line in drawn] == [[1.0], [1.0]]


@pytest.mark.processes
def test_a_method_of_ones_own_and_one_that_fails(run, write, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    text = (
        GOOD.replace('"backlund"', '"toys.lies:METHOD"')
        .replace("[0.5, 0.25]", "[0.5, 1e99]")
        .replace("time = 50", "steps = 9")
    )
    code, out, _ = run("run", write(text), "--results", tmp_path / "results", "--jobs", "1", "--quiet")
    rows = Store(tmp_path / "results").rows("sweep_my")
    assert set(rows[rows.status == "done"].method) == {"strang", "toys.lies:METHOD"}
    failed = set(rows[rows.status == "failed"].h)
    assert failed <= {1e99}
    assert failed, out
    table = load("sweep_my").tables(rows)["runs"]
    assert table.failure.astype(bool).sum() == (rows.status == "failed").sum()
    figures = load("sweep_my").draw(rows)
    texts = {text.get_text() for figure in figures.values() for text in figure.findobj(Text)}
    assert METHODS["strang"].label in texts
    assert "kick and rotation" in texts
    assert not any("toys.lies:METHOD" in text for text in texts)
    lost = rows.assign(method=rows.method.replace("toys.lies:METHOD", "no_such_module:METHOD"))
    figures = load("sweep_my").draw(lost)  # where it cannot be loaded it has the name it was asked for by
    assert any(text.get_text() == "no_such_module:METHOD" for text in figures["time"].findobj(Text))


def test_a_method_that_must_start_at_the_beginning_does(monkeypatch):
    """A multistep method, started again at every sample, would be another one."""
    monkeypatch.syspath_prepend(str(HERE))
    cell = {"method": "toys.multistep:METHOD", "top": "generic", "alpha": 1.0, "options": "", "h": 0.0625, "steps": 512}
    cell["y0"] = ",".join(map(repr, TOPS["generic"].state.tolist()))

    def errors():
        return [sweep.measure({**cell, "samples": samples})[-1]["error"] for samples in (2, 9)]

    broken_off = errors()
    assert broken_off[0] != broken_off[1]
    monkeypatch.setattr(sys.modules["toys.multistep"].FixedStepper, "from_start", True, raising=False)
    through = errors()
    assert through[0] == through[1] not in broken_off


def test_the_documented_file_works(write):
    (text,) = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    found = cells(write(text))
    assert sweep.read(write(text.replace("heavy-top", "x"))) == "sweep_x"
    assert len(found) == 3 * 2 * 3 + 2 + 1
    documented = set(
        re.findall(r"`(\w+)`", "".join(line.split("|")[1] for line in PAGE.read_text().splitlines() if "|" in line[:1]))
    )
    assert documented == set(sweep.KEYS["sweep"]) | {"name", "potential", "parameters"}
    assert set(tomllib.loads(text)) == set(sweep.KEYS["file"])
