"""Experiments beyond tops: spins, bodies and driven tops have no code of their own; engines beside the bench."""

import json
from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments import engine_figures, engines, heavy_top, perturbed, programs
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import check
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS, Problem, StepError, cos, integrate, sin
from lagrange_bench.integrators.problem.examples import PROBLEMS
from lagrange_bench.results.store import Store, StoreError, make_record
from lagrange_bench.runner import verify
from lagrange_bench.runner.engine import run


@pytest.mark.parametrize("state", PROBLEMS)
def test_a_run_on_any_problem_has_its_error_and_its_invariants(state):
    cell = {"part": "problem", "method": "rk4", "state": state, "h": 0.5}
    (row,) = perturbed.measure(cell)
    problem, y0 = find(state)
    unit = problem.scales(y0)[2]
    true = integrate(problem, y0, t=[32.0 * unit], method="taylor").y[0]
    run = integrate(problem, y0, h=0.5 * unit, steps=64, method="rk4")
    moved = np.abs(run.invariants() - run.invariants()[0]) / problem.invariant_scales(y0)
    keeps = [name in METHODS["rk4"].conserves_on(problem) for name in problem.names]
    error = np.max(np.abs(run.y[-1].ravel() - true.ravel()) / problem.sizes(y0))
    assert error / 2 < row["error"] < 2 * error  # components here, vectors there
    assert row["others"] <= np.max(moved[:, ~np.array(keeps)]) * (1 + 1e-4)
    assert row["kept"] < 1e-14


def test_drift_phase_work_and_cost_of_spins():
    def measured(experiment, **cell):
        return load(experiment).measure({"method": "rk4", "state": "central_spin", **cell})

    assert set(measured("drift", part="time", h=0.5, steps=8)[-1]) == {"t", *find("central_spin")[0].names}
    (row,) = measured("phase", part="h", h=0.25)
    assert 0.0 < row["error"] < 1e-2
    curve = measured("work_precision", span=8.0, per_octave=1, decades=1, longest=0.002)
    assert curve[-1]["stopped"] == "too long"
    assert min(run.get("error", 1.0) for run in curve) < 1e-6
    (price,) = measured("cost", part="step", h=0.25, repeats=1)
    assert (price["evals_per_step"], price["ns_per_step"] > 0.0) == (4.0, True)


def swinging(t, y, p):
    return (y[0] ** 2 + y[1] ** 2 + y[2] ** 2) / 2 + (1 + 0.3 * cos(2 * t)) * y[5] + 0.2 * y[3] * y[4] * sin(t)


def test_the_way_back_is_judged_on_the_same_motion():
    """In a field that depends on time the errors at −t and t have nothing to do with each other."""
    start = Problem("swinging", "e3", swinging), np.array((0.3, -0.4, 1.2, 0.48, 0.6, 0.64))
    (verdict,) = check.solution(METHODS["blanes_moan6"], True, (start,))
    assert verdict.passed is True


ABSENT = {"timing": True, "case": "slow", "engine": "absent", "integrator": "none", "setting": "", "h": 0.25}


def start(taken, _, body, kind, h, rail=False):
    """The exact motion, turned by h² about the vertical; "wrong": in singles, and with energy lost; "nan": lost at the end."""
    turn = Rotation.from_rotvec((0.0, 0.0, h * h))

    def run(steps, every):
        taken(steps)
        exact = body.case.solution(np.arange(every, steps + 1, every) * h)
        place, omega = turn.apply(exact.position), turn.apply(exact.omega_world)
        rotation = (turn * exact.rotation).as_matrix()
        if kind == "nan":
            rotation[-1] = np.nan
        if kind == "wrong":
            rotation, omega = (turn * exact.rotation).as_quat().astype(np.float32), 0.5 * omega
        return list(zip(place, rotation, omega, strict=True))

    return run


def fake(taken=lambda n: None, package="numpy", release=""):
    return programs.Engine(partial(start, taken), package, {"one": ""}, release=release)


def test_errors_and_orders_are_those_of_the_adapter(monkeypatch):
    taken = []
    monkeypatch.setitem(engines.ENGINES, "fake", fake(taken.append))
    rows = []
    for h in (1 / 16, 1 / 32, 1 / 64, 1 / 1024):
        cell = {**ABSENT, "engine": "fake", "integrator": "one", "h": h}
        (row,) = engines.measure(cell)
        assert row["rotation"] == pytest.approx(h * h, rel=1e-4)
        assert row["position"] == pytest.approx(h * h * np.linalg.norm(heavy_top.end("slow")[:2, 1]), rel=1e-3)
        assert (row["version"], row["overhead_ns_per_step"] > 0) == (np.__version__, True)
        rows.append({**cell, **row, "status": "done"})
    assert {32, 64, 128, 2048} == set(taken), "all steps of a run"
    (line,) = engines.tables(pd.DataFrame(rows))["orders"].to_dict("records")
    assert line["order of position"] == line["order of rotation"] == pytest.approx(2.0, abs=1e-3)
    assert line["rotation, h = 1/1024"] == line["rotation there"] == rows[-1]["rotation"]


def stored(name, how, errors, spin=0.0, turns_over=2.6):
    """Rows of an engine on `slow` and `racket`, with steps from 1/60 s."""
    line = {"engine": name, "integrator": how, "setting": how, "version": "1", "status": "done", "until": 0.5}
    line["precision"] = "double" if name == "level" else "single"
    rows = [
        {**line, "case": "slow", "h": h, "position": error, "spin": spin, "energy": -1e-3, "energy_growth": 1.0}
        for h, error in zip((1 / 60, 1 / 1024, 1 / 4096), errors, strict=True)
    ]
    return [*rows, {**line, "case": "racket", "h": 1 / 60, "turns_over": turns_over}]


def test_what_an_engine_tends_to():
    falling, level = (1.0, 0.25, 0.06), (1.0, 0.0021, 0.002)
    kinds = {
        "right": (stored("right", "default", falling), "the exact motion"),
        "single": (stored("single", "best", level), "the exact motion, to round-off"),
        "level": (stored("level", "best", level), "errors of 0.002 m: another motion?"),
        "damped": (stored("damped", "best", falling, spin=-0.2), "another motion: damping"),
        "bare": (stored("bare", "best", falling, turns_over=np.nan), "another motion: no gyroscopic torque"),
        "other": (stored("other", "", falling), None),
    }
    rows = pd.DataFrame([row for found, _ in kinds.values() for row in found])
    named = engines.tables(rows)
    assert set(named) == {"overview", "energy"}
    damped = named["energy"].set_index("engine").loc["damped"].tolist()
    assert damped[1:] == ["best", -1e-3, 1.0, "single", 0.06, 1 / 4096]
    lines = engine_figures.overview(rows, kinds).set_index("engine")
    assert lines.limit.to_dict() == {f"{name}, 1": limit for name, (_, limit) in kinds.items() if limit}
    assert lines.loc["right, 1"].tolist()[:4] == ["default", 1.0, 0.25, 0.5]
    part = engine_figures.overview(pd.DataFrame(stored("MJX", "best", falling)), ["MJX"])
    assert part.limit.tolist() == ["the exact motion", *[engines.ENGINES["MJX"].missing] * 2]  # Euler and RK4
    found = [[name for name, _, _ in family] for family in engine_figures.families(rows)]
    assert sorted(map(sorted, found)) == [["bare", "damped", "other", "right"], ["level", "single"]]
    figures = engines.draw(rows)
    assert set(figures) == {"families", "racket"}
    labels = [label.get_text() for label in figures["families"].axes[0].get_figure().legends[0].get_texts()]
    assert labels == ["right, damped, bare, other", "single, level"]
    times = figures["racket"].axes[0].get_lines()[1].get_xdata()
    assert list(times) == [2.6, 2.6, 2.6, 2.6, programs.RACKET.until], "the last never turns over"


def test_an_engine_that_gives_up_is_a_result(monkeypatch):
    def fails(n):
        raise RuntimeError("singular joint. See the manual")

    for engine, kind, why in ((fake(fails), "one", "singular joint$"), (fake(), "nan", "not finite after 2 s")):
        monkeypatch.setitem(engines.ENGINES, "fake", engine)
        for timing in (True, False):
            with pytest.raises(StepError, match=why):
                engines.measure({**ABSENT, "engine": "fake", "integrator": kind, "timing": timing})


def test_cells_of_an_engine_that_is_not_there_are_skipped(monkeypatch, tmp_path):
    assert fake(release="0.1").version is None, "another release than the one that is meant"
    monkeypatch.setitem(engines.ENGINES, "absent", fake(package="no-such-engine"))
    monkeypatch.setattr(engines, "cells", lambda profile: [ABSENT])
    summary = run(["engines"], "full", tmp_path, show=False)
    assert (summary.experiments["engines"].unavailable, summary.exit_code) == (1, 0)
    assert "needs no-such-engine, which is not installed" in summary.notes[0]
    row = {"position": 1.0, "rotation": 1.0, "ns_per_step": 1.0, "version": "1", "date": "2026-11-25"}
    Store(tmp_path).append(make_record("engines", engines.VERSION, 0, ABSENT, rows=[row]))
    assert run(["engines"], "full", tmp_path, show=False).experiments["engines"].stored == 1
    for name in ("x1", "x2", "x3"):
        monkeypatch.setitem(engines.ENGINES, name, fake(package=name))
        Store(tmp_path).append(make_record("engines", engines.VERSION, 0, {**ABSENT, "engine": name}, rows=[row]))
    with pytest.raises(StoreError, match="not computed: cells of no-such-engine, x1, x2 and 1 more: not available"):
        verify.verify(tmp_path, 10, seed=0, longest=3.0, jobs=None, show=False, old=False)


def test_followed_bodies(monkeypatch):
    monkeypatch.setitem(engines.ENGINES, "fake", fake())
    cell = {"case": "slow", "engine": "fake", "integrator": "one", "setting": "", "h": 1 / 64}
    (right,) = engines.measure(cell)
    assert right["rotation"] == pytest.approx(1 / 4096, rel=1e-4)
    assert right["position"] > 0.0
    assert (abs(right["spin"]) < 1e-12, abs(right["energy"]) < 1e-12, right["until"]) == (True, True, 2.0)
    assert (right["precision"], "turns_over" in right, "ns_per_step" in right) == ("double", False, False)
    (wrong,) = engines.measure({**cell, "integrator": "wrong"})
    assert (wrong["precision"], wrong["energy"] < -0.1, wrong["until"]) == ("single", True, 2.0)
    (racket,) = engines.measure({**cell, "case": "racket", "integrator": "one", "h": 0.25})
    assert ("position" in racket, racket["until"], racket["turns_over"]) == (False, 5.0, 2.75)
    exact = programs.RACKET.solution([2.5, 2.75]).omega_body[:, programs.AXIS]
    assert exact[0] > 0 > exact[1]
    (far,) = engines.measure({**cell, "h": 0.5})
    assert (far["rotation"], far["until"]) == (pytest.approx(0.25, rel=1e-4), 0.5)


def test_an_energy_and_a_spin_that_are_lost_and_an_energy_that_grows():
    rows = start(lambda n: None, None, programs.adapters.Body.of(programs.RACKET), "wrong", 1e-3, False)(100, 10)
    found = engines.errors(programs.RACKET, np.arange(1, 11) * 0.01, rows)
    assert (found["energy"], found["spin"]) == (pytest.approx(-0.75, abs=1e-6), pytest.approx(-2.5, abs=1e-3))
    assert np.isnan(found["turns_over"])
    assert found["energy_growth"] == pytest.approx(0.0, abs=1e-6), "lost at once"
    t = np.arange(1, 513) / 256
    exact = programs.RACKET.solution(t)
    turns, omega = exact.rotation.as_matrix(), exact.omega_world

    def growth(factors):
        rows = [(np.zeros(3), *row) for row in zip(turns, omega * factors[:, None], strict=True)]
        return engines.errors(programs.RACKET, t, rows)["energy_growth"]

    assert growth(1 + 1e-6 * t) == pytest.approx(1.0, abs=1e-3)
    assert growth(1 + 1e-6 * t**2) == pytest.approx(2.0, abs=1e-2)
    assert np.isnan(growth(np.ones(512))), "round-off is no growth"


def test_each_engine_says_what_it_needs():
    found = {name: engines.missing_package({"engine": name}) for name in engines.ENGINES}
    assert (found["lagrange-bench"], found["MuJoCo 3.6"]) == (None, "mujoco==3.6.*")
    cells = engines.cells("full")
    assert {cell["engine"] for cell in cells} == set(engines.ENGINES)
    assert {cell["engine"] for cell in engines.cells("quick")} == {engines.OURS}
    text = (programs.adapters.WEB / "package.json").read_text("utf-8")
    pinned = json.loads(text)["dependencies"]
    web = {engine.package: engine for engine in engines.ENGINES.values() if isinstance(engine, programs.WebEngine)}
    assert (set(pinned), "http" in text) == (set(web), False)
    for engine in web.values():
        assert (programs.adapters.WEB / f"{engine.start.args[0]}.mjs").is_file()


ORDERS = [
    ("MuJoCo", "RK4", 4),
    ("Exudyn", "generalized-alpha", 2),
    ("Exudyn", "RK67", 6),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "order"), ORDERS)
@pytest.mark.filterwarnings("ignore")  # of the engines
def test_the_engines_follow_the_slow_top(name, kind, order):
    engine = engines.ENGINES[name]
    if engine.version is None:
        pytest.skip(f"there is no {name}")
    steps = (2**11, 2**12) if order < 5 else (2**7, 2**8)
    cells = [{**ABSENT, "engine": name, "integrator": kind, "h": engines.UNTIL / n} for n in steps]
    coarse, fine = (engines.measure(cell)[0] for cell in cells)
    assert np.log2(coarse["rotation"] / fine["rotation"]) == pytest.approx(order, abs=0.6)
    assert fine["position"] < 1e-3
