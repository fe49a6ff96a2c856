"""What tests of integrators share."""

import pytest

from lagrange_bench.integrators import ensemble
from lagrange_bench.integrators.compiling import lanes
from lagrange_bench.integrators.torus import step_table


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


@pytest.fixture
def one_degree(monkeypatch):
    """Tables of one degree, in which higher coefficients are 0: there is a kernel for each degree."""
    monkeypatch.setattr(step_table, "DEGREES", step_table.DEGREES[-1:])
