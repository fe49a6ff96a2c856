"""Engines beside the bench: their rows are judged, and say which motion they follow."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench import judge
from lagrange_bench.experiments import engines, heavy_top
from lagrange_bench.experiments.engines import figures, programs
from lagrange_bench.integrators import CASES, StepError
from lagrange_bench.results.store import Store, StoreError, make_record
from lagrange_bench.runner import verify
from lagrange_bench.runner.engine import run

ABSENT = {"timing": True, "case": "slow", "engine": "absent", "integrator": "none", "setting": "", "h": 0.25}
TAKEN = []  # steps of each run


def exact(body, kind, h, steps, every):
    """The exact motion, turned by h² about the vertical; "wrong": in singles, and with energy lost; "nan": lost at the end."""
    turn = Rotation.from_rotvec((0.0, 0.0, h * h))
    motion = body.case.solution(np.arange(0, steps + 1, every) * h)
    place, omega = turn.apply(motion.position), turn.apply(motion.omega_world)
    rotation = (turn * motion.rotation).as_matrix().reshape(-1, 9)
    if kind == "nan":
        rotation[-1] = np.nan
    if kind == "wrong":
        rotation, omega = (turn * motion.rotation).as_quat().astype(np.float32), 0.5 * omega
    if kind == "fails":
        raise RuntimeError("singular joint. See the manual")
    TAKEN.append(steps)
    yield from np.hstack((place, rotation, omega))


@pytest.fixture
def engine(monkeypatch):
    """An engine "fake"; and a function that adds another one."""
    monkeypatch.setitem(sys.modules, "lagrange_bench.experiments.engines.fake_run", SimpleNamespace(run=exact))

    def add(name, package="numpy", **facts):
        made = programs.Engine("fake", package, {"one": ""}, **facts)
        monkeypatch.setitem(engines.ENGINES, name, made)
        return made

    add("fake")
    return add


def test_errors_and_orders_are_those_of_the_engine(engine):
    TAKEN.clear()
    rows = []
    for h in (1 / 16, 1 / 32, 1 / 64, 1 / 1024):
        cell = {**ABSENT, "engine": "fake", "integrator": "one", "h": h}
        (row,) = engines.measure(cell)
        assert row["rotation"] == pytest.approx(h * h, rel=1e-4)
        assert row["position"] == pytest.approx(h * h * np.linalg.norm(heavy_top.end("slow")[:2, 1]), rel=1e-3)
        assert (row["version"], row["ns_per_step"] > 0) == (np.__version__, True)
        rows.append({**cell, **row, "status": "done"})
    assert {32, 64, 128, 2048} == set(TAKEN), "all steps of a run"
    (line,) = engines.tables(pd.DataFrame(rows))["orders"].to_dict("records")
    assert [line["order of position"], line["order of rotation"]] == pytest.approx([2.0, 2.0], abs=1e-3)
    assert line["rotation, h = 1/1024"] == line["rotation there"] == rows[-1]["rotation"]


def stored(name, how, errors, spin=0.0, turns_over=2.6):
    """Rows of an engine on `slow` and `racket`, with steps from 1/60 s."""
    line = {"engine": name, "integrator": how, "setting": how, "version": "1", "status": "done", "until": 0.5}
    line["precision"] = "double" if name == "level" else "single"
    rows = [
        {**line, "case": "slow", "h": h, "position": error, "spin": spin}
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
    lines = figures.overview(rows, kinds).set_index("engine")
    assert lines.limit.to_dict() == {f"{name} 1": limit for name, (_, limit) in kinds.items() if limit}
    assert lines.loc["right 1"].tolist()[:4] == ["default", 1.0, 0.25, 0.5]


def test_a_version_is_that_of_the_engine_with_the_package_beside_it():
    known = {"MuJoCo 3.10": "3.10.0", "PhysX": "2.7.3", "Jolt": "1.1.0", "gone": "1"}
    assert [figures.title(name, version) for name, version in known.items()] == [
        "MuJoCo 3.10.0", "PhysX 5.6.1 (physx-js-webidl 2.7.3)", "Jolt (jolt-physics 1.1.0)", "gone 1",
    ]  # fmt: skip


def test_the_advice_that_is_worse_says_why():
    rows = pd.DataFrame(stored("Newton", "default", (1.0, 0.1, 0.1)) + stored("Newton", "best", (1.0, 0.2, 0.05)))
    assert figures.overview(rows, ["Newton"]).setting.tolist() == [
        "default",
        "as its documents advise (but it converges)",
    ]


@pytest.mark.parametrize(("kind", "why"), [("fails", "singular joint$"), ("nan", "not finite after 2 s")])
@pytest.mark.parametrize("timing", [True, False])
def test_an_engine_that_gives_up_is_a_result(engine, kind, why, timing):
    with pytest.raises(StepError, match=why):
        engines.measure({**ABSENT, "engine": "fake", "integrator": kind, "timing": timing})


def test_cells_of_an_engine_that_is_not_there_are_skipped(engine, monkeypatch, tmp_path):
    assert engine("other", release="0.1").version is None, "another release than the one that is meant"
    engine("absent", "no-such-engine")
    monkeypatch.setattr(engines, "cells", lambda profile: [ABSENT])
    summary = run(["engines"], "full", tmp_path, show=False)
    assert (summary.experiments["engines"].unavailable, summary.exit_code) == (1, 0)
    assert "needs no-such-engine, which is not installed" in summary.notes[0]
    row = {"position": 1.0, "rotation": 1.0, "ns_per_step": 1.0, "version": "1", "date": "2026-11-25"}
    Store(tmp_path).append(make_record("engines", engines.VERSION, 0, ABSENT, rows=[row]))
    assert run(["engines"], "full", tmp_path, show=False).experiments["engines"].stored == 1
    for name in ("x1", "x2", "x3"):
        engine(name, name)
        Store(tmp_path).append(make_record("engines", engines.VERSION, 0, {**ABSENT, "engine": name}, rows=[row]))
    with pytest.raises(StoreError, match="not computed: 4 cells: no-such-engine, x1, x2 and others: not available"):
        verify.verify(tmp_path, 10, seed=0, longest=3.0, show=False, old=False)


def test_followed_bodies(engine):
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
    over = programs.RACKET.solution([2.5, 2.75]).omega_body[:, programs.AXIS]
    assert over[0] > 0 > over[1]
    (far,) = engines.measure({**cell, "h": 0.5})
    assert (far["rotation"], far["until"]) == (pytest.approx(0.25, rel=1e-4), 0.0)


def test_each_engine_says_what_it_needs_and_has_a_file():
    found = {name: engines.missing_package({"engine": name}) for name in engines.ENGINES}
    assert (found["lagrange-bench"], found["MuJoCo 3.6"]) == (None, "mujoco==3.6.*")
    cells = engines.cells("full")
    assert {cell["engine"] for cell in cells} == set(engines.ENGINES)
    assert {cell["engine"] for cell in engines.cells("quick")} == {engines.OURS}
    text = (programs.WEB / "package.json").read_text("utf-8")
    pinned = json.loads(text)["dependencies"]
    web = {engine.package for engine in engines.ENGINES.values() if engine.in_node}
    assert (set(pinned), "http" in text) == (web, False)
    for engine in engines.ENGINES.values():
        file = programs.HERE / (f"{engine.run}.mjs" if engine.in_node else f"{engine.run}_run.py")
        assert file.is_file()
        assert engine.in_node or len(file.read_text("utf-8").splitlines()) <= 40, "short enough to read and to copy"


@pytest.mark.processes
def test_a_run_is_a_file_that_judge_reads(tmp_path):
    words = ("bench", "strang", "0.0078125", "256", "16", "slow")
    module = "lagrange_bench.experiments.engines.follow"
    done = subprocess.run([sys.executable, "-m", module, *words], capture_output=True, text=True, check=True)
    file = tmp_path / "run.csv"
    file.write_text(done.stdout, "utf-8")
    t, *columns = np.loadtxt(file, delimiter=",", skiprows=1).T
    matrices = np.transpose(columns[3:12]).reshape(-1, 3, 3)
    judged = judge(t, rotation=matrices, omega=np.transpose(columns[12:]), omega_frame="world", case=CASES["slow"])
    assert done.stdout.startswith("t,x,y,z,r11,")
    assert judged.start["right"] is True
    cell = {"case": "slow", "engine": "lagrange-bench", "method": "strang", "h": 1 / 128}
    assert judged.rotation.end == pytest.approx(engines.measure(cell)[0]["rotation"], rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "order"), [("MuJoCo", "RK4", 4), ("Exudyn", "generalized-alpha", 2)])
@pytest.mark.filterwarnings("ignore")  # of the engines
def test_the_engines_follow_the_slow_top(name, kind, order):
    if engines.ENGINES[name].version is None:
        pytest.skip(f"there is no {name}")
    cells = [{**ABSENT, "engine": name, "integrator": kind, "h": engines.UNTIL / n} for n in (2**11, 2**12)]
    coarse, fine = (engines.measure(cell)[0]["rotation"] for cell in cells)
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.6)
