"""Kahan's map, written down a second time."""

import numpy as np
import pytest

from lagrange_bench import LagrangeTop, PerturbedTop, StepError, metrics, prepare
from lagrange_bench.integrators.problem.potentials import TIDE
from tests.test_integrators.test_gauss import starts

pytestmark = pytest.mark.interpreted
EPS = float(np.finfo(float).eps)


def hat(v):
    """The matrix of v×, in any kind of number."""
    zero = 0 * v[0]
    return np.array(((zero, -v[2], v[1]), (v[2], zero, -v[0]), (-v[1], v[0], zero)))


FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "uniform": LagrangeTop(1.0),
    "quadratic": PerturbedTop(LagrangeTop(1.0), TIDE, (0.8, 0.6, -0.4, 0.7)),
}


@pytest.mark.parametrize("top", FIELDS.values(), ids=FIELDS)
def test_kahan_is_the_polarised_step_and_refuses_its_poles(top):
    """ỹ = y + h (1 − (h/2) f')⁻¹ f. A pole passed between 0 and h leaves det ≤ 0, or a real eigenvalue of D ≤ 0."""
    refused, taken = 0, 0
    for y in starts(80):
        for h in (0.3, -1.0, 2.5):
            D = np.eye(6) - h / 2 * top.jacobian(y)
            small = np.eye(3) - h / 2 * hat(y[:3]) + h * h / 4 * hat(y[3:]) @ top.jacobian(y)[:3, 3:]
            eigenvalues = np.linalg.eigvals(small)
            near = 1 - h * h * y[5] / 4 if isinstance(top, LagrangeTop) else 1.0  # its first pole
            try:
                z = prepare(top, y, h, "kahan").advance(y, 1)
            except StepError:
                e1, e2 = np.trace(small), (np.trace(small) ** 2 - np.trace(small @ small)) / 2
                assert min(np.linalg.det(D), near, e1, e2) < 1e-12
                refused += 1
                continue
            assert near > 0
            assert np.all(eigenvalues.real[np.abs(eigenvalues.imag) < 1e-12] > 0)
            taken += 1
            expected = y + h * np.linalg.solve(D, top.rhs(y))
            assert metrics.scaled_error(top, y, z, expected) < 64 * EPS * np.linalg.cond(D)
    assert refused > 5
    assert taken > 150
