"""The questions of the bench from Python, any column against any other, and stored rows as frames."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt

from lagrange_bench import METHODS, TOPS, Comparison, LagrangeTop, Problem, integrate, load
from lagrange_bench.ask.questions import drift, order, phase, work_precision
from lagrange_bench.results.store import REFERENCE, Store, make_record

MINE = Problem("mine", "e3", lambda t, y, p: (y[0] ** 2 + 2 * y[1] ** 2) / 2 + y[5], ())
OWN = ("mine", MINE, (1.0, 0, 2, 0, 0.6, 0.8))
RESTING = ("rest", LagrangeTop(1.0), (0, 0, 1.0, 0, 0, 1.0))
GENERIC = TOPS["generic"]
STEP = "step h, in the time scale of the motion"
UNIT = GENERIC.top.scales(GENERIC.state)[2]
NAMED = replace(METHODS["strang"], name="named", label="Named")


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_drift_is_that_of_a_run_in_both_units_of_time():
    frame = drift([NAMED, "rk4"], ["generic", "free_body"], h=0.1, steps=8.0).frame
    run = integrate(GENERIC.top, GENERIC.state, 0.1, 8, "rk4", every=1)
    here = frame[(frame.method == "rk4") & (frame.top == "generic")]
    change = np.abs(run.invariants() - run.invariants()[0]) / GENERIC.top.invariant_scales(GENERIC.state)
    last = here.iloc[-1]
    assert (last.t, last.t_scaled) == pytest.approx((0.8, 0.8 / UNIT), rel=1e-4)
    assert (last.h, last.h_scaled) == pytest.approx((0.1, 0.1 / UNIT))
    assert last[["H", "J3", "C1", "C2"]].abs().to_list() == pytest.approx(change[-1], rel=1e-4, abs=1e-20)
    body = frame[frame.top == "free_body"]
    assert body.t.iloc[-1] == pytest.approx(0.8, rel=1e-4), "its time scale is not 1 over that of the momenta"
    assert "named" not in METHODS


def test_a_method_that_fails_is_a_row_with_the_reason():
    (failed,) = drift(["backlund"], "generic", h_scaled=1e17, steps=3).frame.itertuples()
    assert (failed.status, "|h| is over" in failed.failure) == ("failed", True)


def test_phase_splits_the_error_where_there_is_a_torus():
    frame = phase(["rk4"], ["generic", OWN], h_scaled=0.1, steps=20).frame
    on_torus, own = frame[frame.top == "generic"], frame[frame.top == "mine"]
    assert on_torus[["time", "angle", "off", "error"]].notna().all(axis=None)
    assert own.error.between(1e-12, 1e-3).all()
    assert own.time.isna().all()


def test_order_of_a_method_on_a_top_and_on_a_problem():
    frame = order([NAMED, "rk4"], ["fast", OWN]).frame
    measured = frame.groupby(["method", "top"]).order.first().round(0)
    assert measured.to_dict() == {(m, top): p for m, p in (("named", 2), ("rk4", 4)) for top in ("fast", "mine")}
    answer = order(["backlund", "rk45"]).frame
    assert answer.groupby("method").order.last().to_dict() == {"backlund": "exact", "rk45": "own steps"}


@pytest.mark.parametrize("top", ["moderate_tide", "free_body"])
def test_races_count_what_an_error_costs(short_races, top):
    answer = work_precision(["rk4"], top, t_scaled=10, longest=0.005)
    frame = answer.frame
    assert frame.groupby("method").error.min().between(1e-15, 1e-9).all()
    done = frame[frame.seconds.notna()]
    assert np.allclose(done.total, done.seconds + done.setup_seconds)
    assert np.allclose(frame.span_scaled, 10)
    (line,) = answer.plot().get_lines()
    assert np.all(np.diff(line.get_xdata()) > 0)
    assert np.all(np.diff(line.get_ydata()) < 0), "no run beats another in both"


def made(methods=("rk4", "strang"), tops=("generic", "fast")):
    h = 2.0 ** -np.arange(6)
    rows = [
        pd.DataFrame({"method": m, "top": top, "h_scaled": h, "error": h ** (k + 1), "H": 0.0, "height": np.sin(9 * h)})
        for k, m in enumerate(methods)
        for top in tops
    ]
    return Comparison(pd.concat(rows, ignore_index=True).assign(status="done", evals=7))


BAD = {
    "^methods must be names": lambda: drift(4),
    "no reference solution beyond": lambda: phase(["rk4"], "weak_tide", steps=10**6),
    "every run failed: rk4: every step is exact up to round-off on rest": lambda: order(["rk4"], RESTING).plot(),
    "^y must be a column of numbers": lambda: made().plot(y="method"),
    "no row has both": lambda: Comparison(made().frame.assign(error=np.nan)).plot(),
}


@pytest.mark.parametrize("words", BAD)
def test_what_cannot_be_asked_or_drawn(words):
    with pytest.raises(ValueError, match=words):
        BAD[words]()


def test_tops_by_name_and_by_object():
    for tops, names in (
        ([GENERIC, "random000"], ["generic", "random000"]),
        (OWN, ["mine"]),
        ((GENERIC.top, GENERIC.state), ["LagrangeTop(alpha=1.0)"]),
    ):
        assert drift(["rk4"], tops, steps=1).frame.top.tolist() == names


def test_any_column_against_any_other_a_panel_for_each_top():
    axes = made().plot()
    assert [(ax.get_title(), len(ax.get_lines())) for ax in axes] == [("generic unit top", 2), ("fast top", 2)]
    assert (axes[0].get_xscale(), axes[0].get_yscale(), axes[0].get_xlabel()) == ("log", "log", STEP)
    ax = made().plot("error", "height", methods=["rk4"], tops="fast", xlim=(0.1, 1), ylim=(-2, 2))
    assert (ax.get_xscale(), ax.get_yscale(), ax.get_title()) == ("log", "linear", "fast top")
    assert (ax.get_xlim(), ax.get_ylim(), ax.get_ylabel()) == ((0.1, 1), (-2, 2), "height")
    axes = made().plot("h_scaled", "H", tops=["fast", "generic"])
    assert [ax.get_title() for ax in axes] == ["fast top", "generic unit top"]
    assert axes[0].get_ylabel() == "relative error of H"
    zero = Comparison(made().frame.assign(H=lambda rows: 1 - rows.h_scaled)).plot("h_scaled", "H", tops="fast")
    assert zero.get_ylabel() == "relative error of H (0 is drawn at 10⁻¹⁷)"
    _, ax = plt.subplots()
    made().plot(ax=ax)
    assert (len(ax.get_lines()), ax.get_title()) == (4, "generic unit top, fast top")
    (legend,) = made().plot(tops=["generic"]).figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["RK4", "Strang"]


ROWS = [{"error": 1e-3, "off": 1e-4}]


@pytest.fixture
def folder(tmp_path):
    cell = {"part": "h", "method": "rk4", "state": "generic", "h": 0.5}
    Store(tmp_path).append(
        *(make_record("phase", 3, i, {**cell, "h": h}, rows=ROWS) for i, h in enumerate((0.5, 0.25))),
        make_record("phase", 3, 2, {"part": "order", "method": "rk4"}, rows=[{"h": 0.1, "error": 1e-6, "off": 1.0}]),
        make_record("heavy_top", 1, 0, {"case": "bruels", "method": "rk4", "h": 0.1}, rows=ROWS),
    )
    return tmp_path


def test_stored_rows_are_frames_in_both_units(folder):
    stored = load(folder)
    assert set(stored) == {"heavy_top", "phase"}
    frame = stored["phase"]
    assert np.isnan(frame[frame.part == "order"].h).all(), "of no top"
    frame = frame[frame.part == "h"]
    assert frame.h_scaled.tolist() == [0.5, 0.25]
    assert frame.h.tolist() == pytest.approx([0.5 * UNIT, 0.25 * UNIT])
    assert frame.top.tolist() == ["generic"] * 2
    assert stored["heavy_top"][["top", "h"]].to_numpy().tolist() == [["bruels", 0.1]]
    assert Comparison(frame).plot(y="off").get_title() == "generic unit top"
    driven = {"part": "driven", "state": "kapitza", "method": "rk4", "h": 0.1, "span": 32.0}
    longer = {**driven, "span": 256.0}
    Store(folder).append(*(make_record("nobody.knows", 1, 0, cell, rows=ROWS) for cell in (driven, longer)))
    frame = load(folder)["nobody.knows"]
    assert "h_scaled" not in frame, "as stored"
    ax = Comparison(frame).plot()
    assert (ax.get_title(), "own unit" in ax.get_xlabel()) == ("kapitza", True), "no top of the bench"
    assert len(ax.lines) == 2, "one for each length"


def test_rows_that_are_stored_in_own_units_are_in_both_units(folder):
    race = {"part": "headline", "state": "generic", "method": "taylor", "h": 0.5}
    Store(folder).append(make_record("cost", 1, 0, race, rows=ROWS))
    assert load(folder)["cost"][["h", "h_scaled"]].iloc[0].tolist() == pytest.approx([0.5, 0.5 / UNIT])


def test_names_of_experiments_and_damaged_lines(folder):
    assert sorted(load()) == sorted(path.stem for path in REFERENCE.glob("*.jsonl")), "part of the package"
    with pytest.raises(KeyError, match="did you mean 'phase'"):
        load(folder)["phrase"]
    with (folder / "phase.jsonl").open("a") as file:
        file.write("{broken\n")
    with pytest.warns(RuntimeWarning, match="line 4"):
        assert len(load(folder)["phase"]) == 3
