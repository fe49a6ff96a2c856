"""Some methods, some tops: what is run, stored and drawn of them, and how what stands out looks."""

from dataclasses import replace

import pytest

from lagrange_bench.experiments import drift, phase
from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS
from lagrange_bench.results.choice import Choice
from lagrange_bench.results.store import Journal, Store, make_record

CELLS = [
    {"method": "rk4", "state": "generic"},
    {"method": "strang", "state": "generic"},
    {"method": "strang", "top": "mine"},
    {"part": "cost"},
]
ROWS = [{"error": 1.0}]


@pytest.mark.parametrize(
    ("names", "taken", "leaves_out"),
    [
        ({}, [0, 1, 2, 3], False),
        ({"methods": ("strang",)}, [1, 2], True),
        ({"tops": ("mine",)}, [2], True),
        ({"methods": ("rk4", "strang"), "tops": ("generic",)}, [0, 1], True),
        ({"highlight": ("rk4",)}, [0, 1, 2, 3], False),
    ],
)
def test_what_is_chosen_is_shown(tmp_path, names, taken, leaves_out):
    choice = Choice(**names)
    Store(tmp_path).append(*(make_record("toy", 1, i, cell, rows=ROWS) for i, cell in enumerate(CELLS)))
    assert [record["position"] for record in Store(tmp_path, choice).latest("toy")] == taken
    assert bool(choice) is leaves_out
    choice.check(CELLS)


@pytest.mark.parametrize("words", [("phase_h",), ("--all", "--format", "svg", "--width", "column")])
def test_a_figure_names_the_chosen_methods_that_it_lacks(run, tmp_path, monkeypatch, words):
    """In one reading of each journal."""
    cell = {"part": "h", "state": "generic", "span": 64, "h": 0.25}
    for module, method in ((phase, "rk4"), (drift, "strang")):
        name = module.__name__.split(".")[-1]
        Store(tmp_path).append(make_record(name, module.VERSION, 0, {**cell, "method": method}, rows=ROWS))
        monkeypatch.setattr(module, "draw", lambda rows: {"h": style.figure("column")[0]})
    read, rows = [], Journal.rows
    monkeypatch.setattr(
        Journal, "rows", lambda self: read.extend(r["experiment"] for r in self.latest[:1]) or rows(self)
    )
    drawn = tmp_path / "drawn"
    code, out, err = run("figure", *words, "--methods", "rk4,strang", "--results", tmp_path, "--output", drawn)
    assert (code, out[: len(str(drawn))]) == (1, str(drawn)), err
    assert "not drawn: phase has no rows of strang: lagrange-bench run phase --methods strang\n" in err
    assert sorted(read) == (["phase"] if words == ("phase_h",) else ["drift", "phase"])
    code, out, err = run("figure", "phase_h", "--methods", "strang", "--results", tmp_path)
    assert (code, out) == (2, "")
    assert err.endswith("phase has no rows of strang: lagrange-bench run phase --methods strang\n")


def test_a_method_that_takes_none_of_the_tops_is_refused_with_its_reason():
    in_potentials = [{"method": "rk4", "state": "weak_tide"}]
    for cells, said in (
        (in_potentials, "^--methods: backlund does not take the potential tide: it is a map of the torus"),
        ([*in_potentials, {"method": "rk4", "state": "generic"}], "no cell here has the method 'backlund'"),
    ):
        with pytest.raises(ValueError, match=said):
            Choice(("backlund",)).check(cells)


def test_a_choice_may_leave_nothing_of_one_of_several_experiments(run, in_process, tmp_path):
    words = ("--methods", "backlund", "--tops", "figure2", "--quiet", "--results", tmp_path)
    code, out, err = run("run", "ensemble", "paper", *words)
    assert (code, err) == (0, "")
    assert [line.split()[:2] for line in out.splitlines()[1:3]] == [["ensemble", "0"], ["paper", "2"]]


def test_what_stands_out_has_a_look_that_nothing_else_has():
    plain = {name: style.of(name) for name in METHODS}
    assert style.OWN not in {look["color"] for look in plain.values()}
    assert not {str(dash) for dash in style.OWN_DASHES} & {str(look["linestyle"]) for look in plain.values()}
    with style.apply(highlight=["rk4", "kahan"]):
        looks = {name: style.of(name) for name in METHODS}
    assert [name for name in METHODS if looks[name]["color"] == style.OWN] == ["rk4", "kahan"]
    assert looks["rk4"]["label"] == plain["rk4"]["label"]
    assert str(looks["rk4"]["linestyle"]) != str(looks["kahan"]["linestyle"])
    assert {name: style.of(name) for name in METHODS} == plain


def test_a_plug_in_stands_out_and_a_few_are_all_named():
    many = ["backlund", "rk4", "strang", "kahan", "gauss4", "taylor_fixed", "rkmk4", "theta_functions", "gauss6"]
    assert style.of("somebody:METHOD")["color"] == style.OWN
    with METHODS.lent(replace(METHODS["strang"], name="mine", label="Mine")):
        looks = style.looks([*many, "mine"], named=["backlund"])
    assert (looks["mine"]["color"], looks["mine"]["label"], looks["rk4"]["label"]) == (style.OWN, "Mine", "_thin")
    assert style.of("mine")["color"] != style.OWN
    few = style.looks(many[: style.FEW], named=[])
    assert not [look for look in few.values() if look["label"].startswith("_")]
    both = style.looks(["gauss4", "gauss6"], named=[])
    assert both["gauss4"]["color"] != both["gauss6"]["color"], "of one family, and still told apart"
