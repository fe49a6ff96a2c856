"""Some methods, some tops: what is run, stored and drawn of them, and how what stands out looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lagrange_bench import work_precision
from lagrange_bench.experiments import drift, phase
from lagrange_bench.experiments import work_precision as experiment
from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS
from lagrange_bench.report import sections
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import Journal, Store, make_record
from lagrange_bench.runner import engine

CELLS = [
    {"method": "rk4", "state": "generic"},
    {"method": "strang", "state": "generic"},
    {"method": "strang", "top": "mine"},
    {"part": "cost"},
]


def test_what_is_chosen():
    def taken(**names):
        return [CELLS.index(cell) for cell in CELLS if Choice(**names).takes(cell)]

    assert taken() == [0, 1, 2, 3]
    assert taken(methods=("strang",)) == [1, 2]
    assert taken(tops=("mine",)) == [2]
    assert taken(methods=("rk4", "strang"), tops=("generic",)) == [0, 1]
    assert taken(highlight=("rk4",)) == [0, 1, 2, 3]
    assert (bool(ALL), bool(Choice(tops=("mine",))), bool(Choice(highlight=("rk4",)))) == (False, True, False)
    assert Choice(("a", "b c"), (), ("d",)).words == " --methods 'a,b c' --highlight d"


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"methods": ("rk4", "strnag")}, "--methods: no cell here has the method 'strnag'; did you mean 'strang'?"),
        ({"tops": ("x",)}, "--tops: no cell here has the top 'x'. Known: generic, mine"),
        ({"highlight": ("rk44",)}, "--highlight: no cell here has the method 'rk44'; did you mean 'rk4'?"),
        (
            {"methods": ("rk4",), "tops": ("mine",)},
            "--methods rk4 --tops mine: no cell here has such a method on such a top",
        ),
    ],
)
def test_a_name_that_nothing_has(names, message):
    with pytest.raises(ValueError, match="no cell here") as caught:
        Choice(**names).check(CELLS)
    assert str(caught.value) == message
    Choice(("rk4", "strang"), ("mine",)).check(CELLS)


def test_a_method_that_takes_none_of_the_tops_is_refused_with_its_reason():
    in_potentials = [{"method": "rk4", "state": "weak_tide"}]
    with pytest.raises(
        ValueError, match="--methods: backlund does not take the potential tide: it is a map of the torus"
    ):
        Choice(("backlund",)).check(in_potentials)
    with pytest.raises(ValueError, match="no cell here has the method 'backlund'"):
        Choice(("backlund",)).check([*in_potentials, {"method": "rk4", "state": "generic"}])


def test_a_chosen_method_without_rows_is_named(run, tmp_path):
    cells = [{"part": "h", "method": "rk4", "state": "generic", "span": 64, "h": 0.25}]
    done = {"status": "done", "rows": [{"error": 1.0}], "error": None, "warnings": [], "seconds": 0.1}
    Store(tmp_path).append(*(make_record("phase", phase.VERSION, i, cell, **done) for i, cell in enumerate(cells)))
    rows = Store(tmp_path).rows("phase")
    assert sections.lacking(phase, rows, Choice(("rk4", "strang", "nobody"))) == ["strang"]
    assert sections.lacking(phase, rows, Choice(("rk4",))) == []
    Store(tmp_path).append(make_record("drift", drift.VERSION, 0, {"method": "strang", "state": "generic"}, **done))
    code, out, err = run("figure", "phase_h", "--methods", "strang", "--results", tmp_path)
    assert (code, out) == (2, "")
    assert err.endswith("phase has no rows of strang: lagrange-bench run phase --methods strang\n")


@pytest.mark.parametrize("words", [("phase_h",), ("--all",)])
def test_a_figure_names_the_chosen_methods_that_it_lacks(run, tmp_path, monkeypatch, words):
    """In one reading of each journal."""
    done = {"status": "done", "rows": [{"error": 1.0}], "error": None, "warnings": [], "seconds": 0.1}
    cell = {"part": "h", "state": "generic", "span": 64, "h": 0.25}
    for module, method in ((phase, "rk4"), (drift, "strang")):
        Store(tmp_path).append(
            make_record(module.__name__.split(".")[-1], module.VERSION, 0, {**cell, "method": method}, **done)
        )
        monkeypatch.setattr(module, "draw", lambda rows: {"h": style.figure("column")[0]})
    read, rows = [], Journal.rows
    monkeypatch.setattr(Journal, "rows", lambda self: read.append(self.latest[0]["experiment"]) or rows(self))
    drawn = tmp_path / "drawn"
    code, out, err = run("figure", *words, "--methods", "rk4,strang", "--results", tmp_path, "--output", drawn)
    assert code == 1, err
    assert out.startswith(str(drawn))
    assert "not drawn: phase has no rows of strang: lagrange-bench run phase --methods strang\n" in err
    assert sorted(read) == (["phase"] if words == ("phase_h",) else ["drift", "phase"])


def test_a_store_shows_what_is_chosen(tmp_path):
    done = {"status": "done", "rows": [{"error": 1.0}], "error": None, "warnings": [], "seconds": 0.1}
    Store(tmp_path).append(*(make_record("toy", 1, i, cell, **done) for i, cell in enumerate(CELLS)))
    assert len(Store(tmp_path).rows("toy")) == 4
    assert Store(tmp_path, Choice(("strang",))).rows("toy").method.tolist() == ["strang"] * 2
    assert len(Store(tmp_path, Choice(("strang",))).open("toy").provenance()) == 2


def test_a_run_computes_what_is_chosen():
    def cells(choice):
        return dict(engine._Plan("phase", "quick", choice).cells())

    every, some = cells(ALL), cells(Choice(("rk4", "strang"), ("generic",)))
    assert some == {place: cell for place, cell in every.items() if Choice(("rk4", "strang"), ("generic",)).takes(cell)}
    assert {(cell["method"], cell["state"]) for cell in some.values()} == {("rk4", "generic"), ("strang", "generic")}
    assert len(some) < len(every)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (
            "run drift --methods rk44 --results {0}",
            "--methods: no cell here has the method 'rk44'; did you mean 'rk4'?",
        ),
        ("run drift --methods mine.py --results {0}", "method mine.py: write mine:METHOD"),
        ("run drift --highlight far/mine.py --results {0}", "method far/mine.py: write mine:METHOD in the folder far"),
        ("run drfit --results {0}", "did you mean 'drift'?"),
        ("run drift --tops , --results {0}", "--tops: must be names separated by commas"),
        ("figure phase_h --methods bakclund", "did you mean 'backlund'?"),
        ("report --tops generik --output {0}", "did you mean 'generic'?"),
        ("run phase --methods rk4 --tops figure1 --results {0}", "--methods rk4 --tops figure1: no cell here"),
        (
            "report --methods theta_functions --tops weak_tide --output {0}",
            "--methods theta_functions --tops weak_tide: no cell here",
        ),
    ],
)
def test_wrong_names_on_the_command_line(run, tmp_path, words, named):
    code, out, err = run(*words.format(tmp_path / "out").split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert named in err
    assert list(tmp_path.iterdir()) == []


def test_a_choice_may_leave_nothing_of_one_of_several_experiments(run, tmp_path):
    code, out, err = run(
        "run", "ensemble", "paper", *["--methods", "backlund", "--tops", "figure2", "--quiet", "--results"], tmp_path
    )
    assert (code, err) == (0, "")
    cells = {line.split()[0]: line.split()[1] for line in out.splitlines()[1:3]}
    assert (cells["ensemble"], cells["paper"]) == ("0", "2")


# ---------------------------------------------------------------- what stands out

BENCH = ["backlund", "rk4", "strang", "kahan", "gauss4", "taylor_fixed", "rkmk4", "theta_functions", "gauss6"]


def test_what_stands_out_has_a_look_that_nothing_else_has():
    plain = {name: style.of(name) for name in METHODS}
    assert style.OWN not in {look["color"] for look in plain.values()}
    assert not {str(dash) for dash in style.OWN_DASHES} & {str(look["linestyle"]) for look in plain.values()}
    with style.apply(highlight=["rk4", "kahan"]):
        looks = {name: style.of(name) for name in METHODS}
        assert [name for name in METHODS if looks[name]["color"] == style.OWN] == ["rk4", "kahan"]
        assert looks["rk4"]["label"] == plain["rk4"]["label"]
        assert len({str(looks[name]["linestyle"]) for name in ("rk4", "kahan")}) == 2
    assert {name: style.of(name) for name in METHODS} == plain


def test_a_plug_in_stands_out_and_is_named_among_many():
    mine = replace(METHODS["strang"], name="mine", label="Mine")
    assert style.of("somebody:METHOD")["color"] == style.OWN
    with METHODS.lent(mine):
        looks = style.looks([*BENCH, "mine"], named=["backlund"])
        assert (looks["mine"]["color"], looks["mine"]["label"]) == (style.OWN, "Mine")
        assert looks["rk4"]["label"] == "_thin"
    assert style.of("mine")["color"] != style.OWN


def test_a_few_are_all_named():
    looks = style.looks(BENCH[: style.FEW], named=[])
    assert not [look for look in looks.values() if look["label"].startswith("_")]
    both = style.looks(["gauss4", "gauss6"], named=[])
    assert both["gauss4"]["color"] != both["gauss6"]["color"], "of one family, and still told apart"


# ---------------------------------------------------------------- from Python


def test_a_method_without_a_useful_run_is_named_too():
    rows = pd.DataFrame({"method": ["rk4", "rk4", "strang"], "error": [1e-3, 1e-6, 2.0], "seconds": [1.0, 2.0, np.nan]})
    rows = rows.assign(setup_seconds=0.0, state="generic", span=100.0, status="done")
    with style.apply():
        (ax,) = experiment.draw_frontier(rows, style).axes
    assert [text.get_text() for text in ax.texts if text.get_gid() == "failed"] == ["× Strang"]


def test_work_precision_from_python(short_races):
    mine = replace(METHODS["strang"], name="mine", label="Mine")
    figure, frame = work_precision([mine, "rk4"], top="moderate_tide", time=10, longest=0.005)
    assert isinstance(frame, pd.DataFrame)
    assert frame.groupby("method").error.min().between(1e-15, 1e-3).all()
    (ax,) = figure.axes
    looks = {line.get_label(): line.get_color() for line in ax.get_lines()}
    assert looks["Mine"] == style.OWN
    assert looks[METHODS["rk4"].label] != style.OWN
    assert "mine" not in METHODS


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ({"methods": []}, "methods: give at least one"),
        ({"methods": ["rk4", "rk4"]}, "each name once"),
        ({"methods": ["rk44"]}, "did you mean 'rk4'"),
        ({"methods": ["rk4"], "top": "nowhere"}, "unknown state 'nowhere'"),
        ({"methods": ["backlund"], "top": "magnet"}, "does not take the potential charge"),
        *(({"methods": methods}, "^methods must be a list") for methods in (None, "rk4", METHODS["rk4"])),
        *(({"methods": ["rk4"], "time": time}, "^time must be from 0.001") for time in (0, 1e-9, 1e15, 1e300)),
        ({"methods": ["rk4"], "longest": 0}, "^longest must be positive"),
        ({"methods": ["rk4"], "top": None}, "^top must be a name"),
        ({"methods": ["rk4"], "longest": 1e-9}, "no run has an error below"),
    ],
)
def test_work_precision_of_what_cannot_be(words, named):
    with pytest.raises(ValueError, match=named):
        work_precision(**words)
