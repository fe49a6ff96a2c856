"""Every experiment at a tiny size: measured, stored, and drawn from what was stored."""

from functools import cache

import pandas as pd
import pytest
from tiny import tiny

from lagrange_bench.experiments import EXPERIMENTS, cost, perturbed
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import style
from lagrange_bench.results.store import Store, make_record

pytestmark = [
    pytest.mark.usefixtures("short_races"),
    pytest.mark.xdist_group("measured"),  # with test_sources.py: the same cells, whose kernels are compiled once
]
each = pytest.mark.parametrize("name", EXPERIMENTS)


@cache
def measured(name):
    """Cells and their rows, measured once for the tests of one experiment."""
    return [(cell, load(name).measure(cell)) for cell in tiny(name)]


@each
def test_measured_stored_and_drawn(name, tmp_path):
    module, store = load(name), Store(tmp_path)
    for position, (cell, found) in enumerate(measured(name)):
        outcome = {"status": "done", "rows": found, "error": None, "warnings": [], "seconds": 0.0}
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


@each
def test_a_cell_that_failed_is_drawn_too(name, tmp_path):
    """Every second cell failed: figures and tables still come out."""
    module, store = load(name), Store(tmp_path)
    error = {"type": "StepError", "message": "no", "traceback": ""}
    for position, (cell, found) in enumerate(measured(name)):
        done = position % 2 == 0 and cell.get("part") != "headline"
        outcome = {"rows": found, "status": "done", "error": None} if done else {
            "rows": [], "status": "failed", "error": error}  # fmt: skip
        store.append(make_record(name, module.VERSION, position, cell, **outcome, warnings=[], seconds=0.0))
    rows = store.rows(name)
    assert (rows.status == "failed").any()
    with style.apply():
        for figure in module.draw(rows).values():
            figure.draw_without_rendering()
    module.tables(rows)


SWEEP = {"longest", "per_octave", "decades"}  # of a curve of error and cost
SHORTER = {  # fields in which cells of the quick profile differ from their like of the full one: the length of the runs
    "drift": {"steps"},
    "phase": {"steps"},
    "cost": {"time"},
    "work_precision": SWEEP,
    "perturbed": {"steps", *SWEEP, "tops"},
    "round_off": {"steps"},
    "gaudin": {"steps", "magnets"},
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_quick_profile_is_a_part_of_the_full_one(name):
    """Cells are different; those of the quick profile are some of the full one's, but for the length of some runs."""
    module = load(name)
    quick, full = module.cells("quick"), module.cells("full")
    assert len({str(sorted(cell.items())) for cell in full}) == len(full)
    lengths = SHORTER.get(name, set())
    like = {}
    for cell in full:
        like.setdefault(str(sorted((k, v) for k, v in cell.items() if k not in lengths)), []).append(cell)
    differs, shared = set(), 0
    for cell in quick:
        found = like[str(sorted((k, v) for k, v in cell.items() if k not in lengths))]
        if cell in found:
            shared += 1
            continue
        differs |= {k for k in cell if all(cell[k] != other.get(k) for other in found)}
        for k in lengths & cell.keys():
            most = max(other.get(k, float("inf")) for other in found)
            assert cell[k] >= most if k == "decades" else cell[k] <= most, (cell, k)
    assert differs == lengths, "only what is listed differs, and all that is listed"
    assert shared or name == "work_precision", "what was computed for one profile serves the other"


def test_what_a_fresh_process_needs():
    """The probe of the cost experiment, once: a fresh process imports, compiles and steps."""
    rows = cost.measure({"part": "start", "method": "rk45_fixed"})
    assert [row["cached"] for row in rows] == [False, True]
    for row in rows:
        assert 0 < row["second_s"] <= row["first_s"]
    assert rows[1]["first_s"] < rows[0]["first_s"], "nothing was kept for the second process"


def test_perturbed_tops_say_who_wins_and_who_loses():
    """The cheapest run of each method that reaches an error, set-up counted."""
    runs = [
        (perturbed.OURS, 1e-9, 1.0, 0.5),
        (perturbed.OURS, 1e-5, 0.25, 0.5),
        ("taylor", 1e-11, 3.0, 0.0),
        ("rk4", 1e-3, 0.1, 0.0),
    ]
    rows = pd.DataFrame(runs, columns=["method", "error", "seconds", "setup_seconds"])
    rows = rows.assign(part="work", status="done", state="weak_tide", span=1e3)
    table = perturbed.winners(rows).set_index("error at most")
    ratios = table["times as long as the exact step inside"]
    assert ratios.tolist()[:3] == [4.0, 2.0, 2.0]
    assert ratios.isna().tolist() == [False, False, False, True]
    assert table.cheapest.tolist() == [perturbed.OURS] * 3 + ["taylor"]
    assert table["best of the others"].tolist() == ["taylor"] * 4
