"""Runs of toy cells in this process and its workers."""

import json

import pytest
from faults import TOY

from lagrange_bench.results.store import Store
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
