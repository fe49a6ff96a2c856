"""The experiment on the Gaudin magnet, at a tiny size: heyoka and the maps agree, every row is drawn."""

import math

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments import gaudin


def rows_of(cells):
    frame = [{**cell, **row, "status": "done"} for cell in cells for row in gaudin.measure(cell)]
    return pd.DataFrame(frame)


def test_the_magnet_is_the_central_spin_model():
    magnet, spins = gaudin.central_spin(8)
    assert np.allclose(np.linalg.norm(spins, axis=1), 1, atol=1e-15)
    assert math.isclose(np.sum(magnet.couplings[0] ** 2), 1)
    assert math.isclose(gaudin.unit_of_time(magnet, spins), 1)
    field = magnet.gradient(spins, np.eye(8)[0])
    assert np.allclose(
        field[1:], magnet.couplings[0, 1:, None] * spins[0], atol=1e-15
    )  # the bath feels the centre only


def test_a_step_that_is_off_shows_in_the_rows_of_random_magnets(monkeypatch):
    pytest.importorskip("heyoka")
    cell = {"part": "random", "n": 2, "variant": "exact", "h": 5, "magnets": 2, "steps": 100}
    (row,) = gaudin.measure(cell)
    assert row["failed"] == 0
    assert row["error"] < 1e-13
    assert row["drift"] < 1e-14
    real = gaudin._stepper
    monkeypatch.setattr(gaudin, "_stepper", lambda m, s, v, h: real(m, s, v, h * (1 + 1e-9 * (v == "exact"))))
    assert gaudin.measure(cell)[0]["error"] > 1e-10


def test_maps_keep_spins_and_hamiltonians_and_have_their_order():
    cells = [cell for cell in gaudin.cells("quick") if cell["n"] == 8 and cell["part"] in ("time", "h")]
    maps = ("order 2", "order 6", "exact")
    rows = rows_of({**cell, **({"steps": 40} if "steps" in cell else {})} for cell in cells if cell["variant"] in maps)
    assert rows[["spins", "hamiltonians"]].max().max() < 1e-14
    found = gaudin.tables(rows)["orders"].set_index("variant")
    for order in (2, 6):
        assert abs(found.order[f"order {order}"] - order) < 0.35
    assert rows[(rows.part == "h") & (rows.variant == "exact")].error.max() < 1e-12
    assert gaudin.draw(rows[:0]) == {}


def test_the_quickest_other_is_no_map_of_ours():
    rows = pd.DataFrame(
        [
            {"variant": "exact", "method": "backlund", "error": 1e-14, "seconds": 1.0, "setup_seconds": 9.0},
            {"variant": "order 8", "method": "backlund_paper", "error": 1e-12, "seconds": 0.5, "setup_seconds": 0.0},
            {"variant": "taylor", "method": "taylor", "error": 1e-8, "seconds": 3.0, "setup_seconds": 0.0},
            {"variant": "strang", "method": "strang", "error": 1e-5, "seconds": 2.0, "setup_seconds": 2.0},
        ]
    ).assign(span=64.0, part="work", status="done")
    found = gaudin.work(rows).set_index("error at most")
    assert list(found.index) == [1e-4, 1e-7]
    assert list(found["quickest other"]) == ["strang", "taylor"]
    assert list(found[gaudin.RUN]) == [2, 3]
    assert list(found["quickest with set-up"]) == ["taylor", "taylor"]
    assert list(found[gaudin.WHOLE]) == [0.3, 0.3]
