"""The experiment on the central-spin magnet, at a tiny size: heyoka and the maps agree, every row is drawn."""

import math

import numpy as np
import pandas as pd
import pytest

from experiments import gaudin
from experiments.drawing import style


def rows_of(cells):
    frame = [{**cell, **row, "status": "done"} for cell in cells for row in gaudin.measure(cell)]
    return pd.DataFrame(frame)


def test_the_magnet_is_the_central_spin_model():
    magnet, spins = gaudin.central_spin(8)
    assert np.allclose(np.linalg.norm(spins, axis=1), 1, atol=1e-15)
    assert math.isclose(np.sum(magnet.couplings[0] ** 2), 1)
    field = magnet.gradient(spins, np.eye(8)[0])
    assert np.allclose(
        field[1:], magnet.couplings[0, 1:, None] * spins[0], atol=1e-15
    )  # the bath feels the centre only


@pytest.mark.parametrize("n", [2, 9])
def test_heyoka_follows_the_same_flow(n):
    pytest.importorskip("heyoka")
    magnet, spins = gaudin.central_spin(n)
    states, steps = gaudin.heyoka(magnet, spins)
    assert np.max(np.abs(states(np.array((1.0, 2.0)))[-1] - gaudin.reference(magnet, spins, 2.0))) < 1e-12
    exact = gaudin.gaudin_step.prepare(magnet, spins, 0.5, None, exact=True)
    assert np.max(np.abs(states(np.array((8.0,)))[0] - exact.advance(spins, 16))) < 1e-12
    assert steps(2.0) > 0


@pytest.mark.parametrize("profile", ["quick", "full"])
def test_cells_are_distinct_and_timing_cells_are_marked(profile):
    cells = gaudin.cells(profile)
    assert len({str(cell) for cell in cells}) == len(cells)
    assert {cell["part"] for cell in cells if cell.get("timing")} == {"cost"}


def test_rows_are_tabulated_and_drawn():
    listed = [cell for cell in gaudin.cells("quick") if cell["n"] in (2, 8) and cell["variant"] != "taylor"]
    small = [{**cell, "steps": 40} if cell["part"] == "time" else cell for cell in listed]
    rows = rows_of([cell for cell in small if cell["part"] != "cost" or cell["n"] == 2])
    assert rows[rows.part == "time"][["spins", "hamiltonians"]].max().max() < 1e-14
    tables = gaudin.tables(rows)
    found = tables["orders"].set_index("variant")
    for order in gaudin.ORDERS:
        assert abs(found.order[f"order {order}"] - order) < 0.35
    assert rows[(rows.part == "h") & (rows.variant == "exact")].error.max() < 1e-12
    assert set(tables) == {"drift", "orders", "cost"}
    with style.apply():
        figures = gaudin.draw(rows)
        assert set(figures) == {"time", "h"}
        for figure in figures.values():
            assert figure.caption
            figure.draw_without_rendering()
        assert gaudin.draw(rows[:0]) == {}
