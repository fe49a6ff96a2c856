"""The two integrable discretisations: their maps, written down a second time, in rational arithmetic."""

import random
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from lagrange_bench import METHODS, LagrangeTop, PerturbedTop, StepError, metrics, prepare, states
from lagrange_bench.integrators.paper.phase_space import invariants, vector_field
from lagrange_bench.integrators.problem.potentials import CHARGE, TIDE
from tests.test_integrators.test_gauss import starts

pytestmark = pytest.mark.interpreted
EPS = float(np.finfo(float).eps)
E3 = np.array((0, 0, 1))


def rational_cases(count=4):
    """alpha, h and a state. An identity of rational functions that holds at a few random points holds: Schwartz and Zippel."""
    for seed in range(count):
        draw = random.Random(seed)
        alpha, h, *y = [Fraction(draw.randint(-99, 99) or 1, draw.randint(10, 99)) for _ in range(8)]
        yield alpha, h, np.array(y)


def eliminate(A, b):
    """The solution of A x = b, and det A."""
    rows, n, det = np.column_stack((A, b)), len(A), 1
    for i in range(n):
        pivot = next(r for r in range(i, n) if rows[r, i] != 0)
        if pivot != i:
            rows[[i, pivot]], det = rows[[pivot, i]], -det
        det = det * rows[i, i]
        for r in set(range(n)) - {i}:
            rows[r] = rows[r] - rows[i] * (rows[r, i] / rows[i, i])
    return np.array([rows[i, n] / rows[i, i] for i in range(n)]), det


def hat(v):
    """The matrix of v×, in any kind of number."""
    zero = 0 * v[0]
    return np.array(((zero, -v[2], v[1]), (v[2], zero, -v[0]), (-v[1], v[0], zero)))


def kahan_map(alpha, h, y):
    """(1 − (h/2) f'(y)) (ỹ − y) = h f(y): Kahan's method for any quadratic f."""
    rate = vector_field(SimpleNamespace(alpha=alpha), y)
    return y + eliminate(near_one(alpha, -h, y), h * rate)[0]


def near_one(alpha, h, y):
    """1 + (h/2) f'(y)."""
    slope = np.block([[np.zeros((3, 3), dtype=int), alpha * hat(E3)], [-hat(y[3:]), hat(y[:3])]])
    return np.eye(6, dtype=int) + h / 2 * slope


def kick(alpha, t, y):
    return np.array((y[0] - t * alpha * y[4], y[1] + t * alpha * y[3], *y[2:]))


def cayley(h, y):
    w, x = h / 2 * y[:3], y[3:]
    u = np.cross(w, x)
    return np.concatenate((y[:3], x + (u + np.cross(w, u)) * (2 / (1 + w @ w))))


def symmetric_map(alpha, h, y):
    return kick(alpha, h / 2, cayley(h, kick(alpha, h / 2, y)))


MAPS = {"kahan": kahan_map, "bobenko_suris": symmetric_map}


def kept_by_kahan(alpha, h, y):
    J, x = y[:3], y[3:]
    eps = alpha * h * h / 4
    e = J[0] ** 2 + J[1] ** 2 + 2 * alpha * x[2] - eps * alpha * (x[0] ** 2 + x[1] ** 2)
    r0 = (x @ J) / (1 - eps * x[2])
    v = h * J / 2 + eps * h * r0 / 2 * E3
    return {"J3": J[2], "e": e, "r0": r0, "kappa": (x @ x + (h * r0 / 2) ** 2) / (1 + v @ v)}


def kept_by_symmetric(alpha, h, y):
    H, J3, C1, C2 = invariants(SimpleNamespace(alpha=alpha), y)
    return {"H": H - h * h / 8 * alpha**2 * (y[3] ** 2 + y[4] ** 2), "J3": J3, "C1": C1, "C2": C2}


KEPT = {"kahan": kept_by_kahan, "bobenko_suris": kept_by_symmetric}


@pytest.mark.parametrize("name", MAPS)
def test_a_step_is_the_map(name):
    """Within a few ulp, and so are the quantities the record keeps; doubles taken as the rationals they are."""
    for state in ("generic", "figure1", "fast", "slow", "weightless", "inverted", "hanging", *states.RANDOM[:5]):
        top, y0 = states.find(state)
        for span in (0.1, -0.5, 3.0):
            h = span * top.scales(y0)[2]
            try:
                y = prepare(top, y0, h, name).advance(y0, 1)
            except StepError:
                assert (name, span) == ("kahan", 3.0)
                continue
            exactly = Fraction(top.alpha), Fraction(h), np.array(list(map(Fraction, y0)))
            z = MAPS[name](*exactly).astype(float)
            assert metrics.scaled_error(top, y0, y, z) < 16 * EPS, (state, span)
            kept = KEPT[name](*exactly)
            for quantity, function in METHODS[name].claims.conserves_own.items():
                values, size = function(top, h, y0[None])
                value = float(kept.get(quantity, kept.get("H")))
                assert abs(values[0] - value) < 8 * EPS * size
                assert abs(value) <= size * (1 + 8 * EPS)


FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "quadratic": PerturbedTop(LagrangeTop(1.0), TIDE, (0.8, 0.6, -0.4, 0.7)),
    "charge": PerturbedTop(LagrangeTop(1.0), CHARGE, (0.4, 1.1, -0.7, 0.9)),
}


@pytest.mark.parametrize("field", FIELDS)
def test_in_a_field_bobenko_suris_is_kick_rotation_kick(field):
    top, h = FIELDS[field], 0.3
    for y in starts(3):
        expected = cayley(h, y + h / 2 * top.rhs(y) * (1, 1, 1, 0, 0, 0))
        expected = expected + h / 2 * top.rhs(expected) * (1, 1, 1, 0, 0, 0)
        z = prepare(top, y, h, "bobenko_suris").advance(y, 1)
        assert metrics.scaled_error(top, y, z, expected) < 16 * EPS


@pytest.mark.parametrize("top", [FIELDS["quadratic"], LagrangeTop(1.0)], ids=["quadratic", "uniform"])
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
