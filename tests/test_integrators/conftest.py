"""What tests of integrators share."""

import pytest

from lagrange_bench.integrators import ensemble
from lagrange_bench.integrators.compiling import lanes


@pytest.fixture
def in_lanes(monkeypatch):
    """The numbers of tops that were done in lanes, call by call."""
    met = []

    def run(*arguments, **options):
        fine = lanes.run_lanes(*arguments, **options)
        met.append(int(fine.sum()))
        return fine

    monkeypatch.setattr(ensemble, "run_lanes", run)
    return met
