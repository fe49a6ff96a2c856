"""The two Lie-group methods: their steps against the textbook on 6 × 6 matrices."""

import numpy as np
import pytest
from scipy.linalg import expm

from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.integrators import prepare
from tests.test_integrators.test_integrable_maps import hat

EPS = float(np.finfo(float).eps)


def generators(top, h):
    """h (J, alpha e3) at a state, as a matrix acting on (J, x)."""
    weight, zero = hat((0, 0, top.alpha)), np.zeros((3, 3))
    return lambda y: h * np.block([[hat(y[:3]), weight], [zero, hat(y[:3])]])


def bracket(A, B):
    return A @ B - B @ A


def textbook_rkmk4(top, h, y):
    k = generators(top, h)
    k1 = k(y)
    k2 = k(expm(k1 / 2) @ y)
    k3 = k(expm(k2 / 2 - bracket(k1, k2) / 8) @ y)
    k4 = k(expm(k3) @ y)
    return expm((k1 + 2 * k2 + 2 * k3 + k4) / 6 - bracket(k1, k4) / 12) @ y


def textbook_commutator_free4(top, h, y):
    k = generators(top, h)
    k1 = k(y)
    k2 = k(expm(k1 / 2) @ y)
    k3 = k(expm(k2 / 2) @ y)
    k4 = k(expm(k3 - k1 / 2) @ expm(k1 / 2) @ y)
    first = expm((3 * k1 + 2 * k2 + 2 * k3 - k4) / 12)
    return expm((-k1 + 2 * k2 + 2 * k3 + 3 * k4) / 12) @ first @ y


TEXTBOOK = {"rkmk4": textbook_rkmk4, "commutator_free4": textbook_commutator_free4}


@pytest.mark.parametrize("name", TEXTBOOK)
def test_a_step_is_the_textbook_s(name):
    for state in ("generic", "figure1", "fast", "slow", "inverted", "weightless", "random000", "random001"):
        top, y0 = states.find(state)
        for span in (0.1, -0.5, 2.0):
            h = span * top.scales(y0)[2]
            y = prepare(top, y0, h, name).advance(y0, 1)
            assert metrics.scaled_error(top, y0, y, TEXTBOOK[name](top, h, y0)) < 64 * EPS, (state, span)
