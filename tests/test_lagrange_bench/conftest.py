"""Runs of toy cells in this process and its workers."""

import json

import pytest
from faults import TOY

from lagrange_bench.experiments.sweep import VERSION
from lagrange_bench.integrators import INVARIANTS
from lagrange_bench.results.store import Store, make_record
from lagrange_bench.runner import engine


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """toy(cells, …) → Summary; the cells make no pauses; the rows are in `toy.store`, below tmp_path/"here"."""

    def run(cells, jobs=2, **options):
        with monkeypatch.context() as patch:
            patch.setenv("TOY_PACE", "0")
            patch.setenv("TOY_CELLS", json.dumps(cells))
            return engine.run([TOY], "quick", run.store.folder, jobs, **{"show": False, **options})

    run.store = Store(tmp_path / "here")
    return run


@pytest.fixture
def swept():
    """swept(folder, experiment, …) stores a run of a sweep on the generic top, with these fields."""
    start = {"top": "generic", "alpha": 1.0, "y0": "0.3,-0.4,1.2,0.48,0.6,0.64", "options": "", "h": 0.1, "steps": 2}
    rows = [{"t": t, **dict.fromkeys(INVARIANTS, 1e-9), "error": 1e-9, "seconds": 0.1} for t in (1.0, 2.0)]

    def store(folder, experiment, **fields):
        Store(folder).append(make_record(experiment, VERSION, 0, {**start, "samples": 2, **fields}, rows=rows))

    return store
