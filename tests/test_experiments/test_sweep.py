"""Sweeps: a TOML file lists cells of an experiment, which computes and draws them; what is wrong in it is told with its place."""

import re
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench.commands.run import _own_modules
from lagrange_bench.experiments import sweep
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import states
from lagrange_bench.integrators import integrate
from lagrange_bench.results.store import Store

PAGE = Path(__file__).resolve().parents[2] / "docs" / "sweeps.md"
(GOOD,) = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)  # as documented
IN_A_TIDE = """
experiment = "perturbed"
tops.heavy = { alpha = 1.5, J = [0.3, -0.4, 2.0], x = [0.48, 0.6, 0.64], potential = "tide", parameters = [0.1, 1, 0, 0] }
sweep = [{ part = "drift", methods = "rk4", tops = "heavy", h_scaled = [0.5, 0.25] }]
"""
BAD = [  # what to replace in GOOD, by what, and what the message must say
    ('"drift"', '"drfit"', "unknown experiment 'drfit'; did you mean 'drift'?"),
    ("alpha = 1.5", "alfa = 1.5", "[tops.heavy], unknown key 'alfa'; did you mean 'alpha'?"),
    ("[tops.heavy]", "[tops.generic]", "[tops.generic], the bench has a top of this name; choose another"),
    ('methods = ["backlund", "strang", "implicit_midpoint"]\n', "", "methods must be given, a list of names"),
    ('"generic"]', '"magnet"]', "methods: backlund needs a top in a uniform field"),
    ("h_scaled = [", "h = [", "[[sweep]] 1, h: write h_scaled = …, in the time scale of each top"),
    ("span_scaled = 1000", 'span_scaled = "long"', "span_scaled must be a real number; got 'long'"),
]


@pytest.fixture
def write(tmp_path):
    def call(text):
        path = tmp_path / "my.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return call


def test_a_sweep_does_not_mix_with_the_results_of_the_bench(folder, run):
    (folder / "quick.toml").write_text(GOOD, encoding="utf-8")
    code, _, err = run("run", "quick.toml")
    assert (code, "rename it" in err) == (2, True)


@pytest.mark.parametrize(("old", "new", "words"), BAD, ids=[f"{old[:8]} {new[-24:]}" for old, new, _ in BAD])
def test_what_is_wrong_is_told_with_its_place(write, old, new, words):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}, .*{re.escape(words)}"):
        sweep.read(path)


def test_what_a_file_asks_for(write):
    again = '[[sweep]]\npart = "h"\nmethods = "strang"\ntops = "heavy"\nh_scaled = [0.5, -2]\nspan_scaled = 1000\n'
    name, experiment, cells = sweep.read(write(GOOD + again))
    assert (name, experiment, len(cells)) == ("my", "drift", 3 * 2 * 3 + 1), "each cell once"
    generic = {"part": "h", "method": "strang", "state": "generic", "span": 1000, "h": 0.5}
    cell = {**generic, "state": "heavy", "alpha": 1.5, "y0": "0.3,-0.4,2.0,0.48,0.6,0.64"}
    assert (generic in cells, cell in cells) == (True, True), "their keys"
    row, *_ = load("drift").measure(cell)
    top, y0 = states.of_cell(cell)
    run = integrate(top, y0, 0.5 * top.scales(y0)[2], 2000, every=1, method="strang")
    change = (run.invariants()[:, 0] - run.invariants()[0, 0]) / top.invariant_scales(y0)[0]
    assert 0.5 * np.max(np.abs(change)) < row["H"] <= 1.001 * np.max(np.abs(change))


def test_a_top_in_a_potential_and_a_method_of_ones_own(write):
    cells = sweep.read(write(IN_A_TIDE)).cells
    assert {(cell["potential"], cell["parameters"]) for cell in cells} == {("tide", "0.1,1.0,0.0,0.0")}
    top, y0 = states.of_cell(cells[0])
    assert (top.potential.name, top.parameters, y0[2]) == ("tide", (0.1, 1.0, 0.0, 0.0), 2.0)
    race = IN_A_TIDE.replace('"drift"', '"work"').replace("h_scaled = [0.5, 0.25]", "span_scaled = 50")
    assert "scheme" not in sweep.read(write(race)).cells[0], "the first cell of this part is of another method"
    assert _own_modules(["drift"], cells) == []
    assert _own_modules(["my.study"], [{"method": "mine:METHOD", "potential": "other:V"}]) == [
        "my.study",
        "mine",
        "other",
    ]


def test_the_experiment_draws_tops_of_the_file(run, write, tmp_path, in_process):
    text = GOOD.replace(', "generic"', "").replace(', "implicit_midpoint"', "").replace("= 1000", "= 5")
    code, out, err = run("run", write(text), "--results", tmp_path / "out", "--jobs", "1", "--quiet")
    assert code == 0, err
    rows = Store(tmp_path / "out").rows("drift")
    assert set(zip(rows.state, rows.status, strict=True)) == {("heavy", "done")}
    assert run("report", "--results", tmp_path / "out", "--quiet")[0] == 0
    assert any("Strang" in path.read_text() for path in (tmp_path / "out" / "page" / "figures").glob("*.svg")), out
    page = (tmp_path / "out" / "page" / "index.html").read_text("utf-8")
    assert ("redraw: " in page, "recompute: " in page) == (True, False), "it would add the cells of a profile"
