"""Engines beside the bench: adapters, what is not installed, and the engines themselves where they are."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments import engines, heavy_top
from lagrange_bench.integrators import StepError
from lagrange_bench.results.store import Store, StoreError, make_record
from lagrange_bench.runner import verify
from lagrange_bench.runner.engine import run

ABSENT = {"timing": True, "case": "slow", "engine": "absent", "integrator": "none", "setting": "", "h": 0.25}


def start(advance, _, case, kind, h, rail):
    """The exact end, turned by h² about the vertical."""
    turn = Rotation.from_rotvec((0.0, 0.0, h * h)) * Rotation.from_matrix(heavy_top.end(case.name))
    matrix = turn.as_matrix() * (np.nan if kind == "nan" else 1.0)
    return advance, lambda: (matrix @ case.top.com, matrix)


def fake(advance=lambda n: None, package="numpy", release=""):
    return engines.Engine(partial(start, advance), package, package, {"one": ""}, release)


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


def test_an_engine_that_gives_up_is_a_result(monkeypatch):
    def fails(n):
        raise RuntimeError("singular joint. See the manual")

    for engine, kind, why in ((fake(fails), "one", "singular joint$"), (fake(), "nan", "not finite")):
        monkeypatch.setitem(engines.ENGINES, "fake", engine)
        with pytest.raises(StepError, match=why):
            engines.measure({**ABSENT, "engine": "fake", "integrator": kind})


def test_cells_of_an_engine_that_is_not_there_are_skipped(monkeypatch, tmp_path):
    monkeypatch.setitem(engines.ENGINES, "absent", fake(package="no-such-engine"))
    monkeypatch.setattr(engines, "cells", lambda profile: [ABSENT])
    summary = run(["engines"], "full", tmp_path, show=False)
    assert (summary.experiments["engines"].unavailable, summary.exit_code) == (1, 0)
    assert "needs no-such-engine, which is not installed" in summary.notes[0]
    row = {"position": 1.0, "rotation": 1.0, "ns_per_step": 1.0, "version": "1", "date": "2026-11-25"}
    Store(tmp_path).append(make_record("engines", engines.VERSION, 0, ABSENT, rows=[row]))
    assert run(["engines"], "full", tmp_path, show=False).experiments["engines"].stored == 1
    with pytest.raises(StoreError, match="not computed: no-such-engine: not available here"):
        verify.verify(tmp_path, 10, seed=0, longest=3.0, jobs=None, show=False, old=False)


def test_the_quick_profile_needs_no_engine():
    quick = engines.cells("quick")
    assert {cell["engine"] for cell in quick} == {engines.OURS}
    assert [engines.lacks(cell) for cell in quick] == [None] * len(quick)
    assert fake(release="0.1").version is None, "another release than the one that is meant"


ORDERS = [
    ("MuJoCo", "RK4", 4),
    ("MuJoCo 3", "RK4", 2),
    ("Exudyn", "generalized-alpha", 2),
    ("Exudyn", "RK67", 6),
    ("Drake", "runge_kutta3", 3),
    ("Pinocchio", "RKMK4", 4),
    ("PyBullet", "Euler, undamped", 1),
    ("DART", "Euler", 1),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind", "order"), ORDERS)
@pytest.mark.filterwarnings("ignore")  # of the engines
def test_the_engines_follow_the_slow_top(name, kind, order):
    engine = engines.ENGINES[name]
    pytest.importorskip(engine.module, exc_type=ImportError)
    if engine.version is None:
        pytest.skip(f"this is not {name}")
    steps = (2**11, 2**12) if order < 5 else (2**7, 2**8)
    cells = [{**ABSENT, "engine": name, "integrator": kind, "h": engines.UNTIL / n} for n in steps]
    coarse, fine = (engines.measure(cell)[0] for cell in cells)
    if order > 1:
        assert np.log2(coarse["rotation"] / fine["rotation"]) == pytest.approx(order, abs=0.6)
    assert fine["position"] < (1e-3 if order > 1 else 2.0)
