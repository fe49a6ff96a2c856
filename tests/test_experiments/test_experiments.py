"""Every experiment at a tiny size: measured, stored, and drawn from what was stored."""

import pandas as pd
import pytest
from tiny import tiny

from experiments import EXPERIMENTS, cost, perturbed
from experiments.catalogue import load
from experiments.drawing import style
from results.store import Store, make_record

pytestmark = pytest.mark.usefixtures("short_races")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_measured_stored_and_drawn(name, tmp_path):
    module, store = load(name), Store(tmp_path)
    for position, cell in enumerate(tiny(name)):
        outcome = {"status": "done", "rows": module.measure(cell), "error": None, "warnings": [], "seconds": 0.0}
        store.append(make_record(name, module.VERSION, position, cell, **outcome))
    rows = store.rows(name)
    assert len(rows) > 0
    assert (rows.status == "done").all()
    with style.apply():
        figures = module.draw(rows)
        assert figures
        for figure in figures.values():
            figure.draw_without_rendering()
            assert figure.caption
    tables = module.tables(rows)
    assert tables
    assert all(isinstance(table, pd.DataFrame) and len(table) for table in tables.values())


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_cell_that_failed_is_drawn_too(name, tmp_path):
    """One cell measured, the others failed: figures and tables still come out."""
    module, store = load(name), Store(tmp_path)
    error = {"type": "StepError", "message": "no", "traceback": ""}
    for position, cell in enumerate(tiny(name)):
        done = position % 2 == 0 and cell.get("part") != "headline"
        outcome = {"rows": module.measure(cell), "status": "done", "error": None} if done else {
            "rows": [], "status": "failed", "error": error}  # fmt: skip
        store.append(make_record(name, module.VERSION, position, cell, **outcome, warnings=[], seconds=0.0))
    rows = store.rows(name)
    assert (rows.status == "failed").any()
    with style.apply():
        for figure in module.draw(rows).values():
            figure.draw_without_rendering()
    module.tables(rows)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_profiles(name):
    """Cells are JSON-able, different, and the quick profile is the smaller one."""
    module = load(name)
    quick, full = module.cells("quick"), module.cells("full")
    assert len(quick) <= len(full)
    assert len({str(sorted(cell.items())) for cell in full}) == len(full)


def test_what_a_fresh_process_needs():
    """The probe of the cost experiment, once: a fresh process imports, compiles and steps."""
    rows = cost.measure({"part": "start", "method": "rk45_fixed"})
    assert [row["cached"] for row in rows] == [False, True]
    for row in rows:
        assert 0 < row["second_s"] <= row["first_s"]
    assert rows[1]["first_s"] < rows[0]["first_s"], "nothing was kept for the second process"


def test_perturbed_tops_are_compared_by_steps_and_not_by_time():
    runs = [("exact, order 2", 1.0, 1e-9), ("exact, order 2", 4.0, 1e-5), ("rotation, order 2", 0.5, 1e-9)]
    rows = pd.DataFrame(runs, columns=["variant", "h", "error"]).assign(eps=1e-4, status="done", seconds=1.0)
    table = perturbed.longest_steps(rows).set_index("error at most")
    assert table["exact, order 2"].tolist()[:3] == [4.0, 1.0, 1.0]
    assert table["exact, order 2"].isna().tolist() == [False, False, False, True]
    assert table["rotation, order 2"].tolist()[:3] == [0.5] * 3
    assert table["exact, SABA4"].isna().all()
    assert set(table) == {"ε", *perturbed.EXACT, *perturbed.ROTATION}
