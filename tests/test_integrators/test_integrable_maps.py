"""The two integrable discretisations: what they keep is proved in rational arithmetic, on maps written down a second time."""

import random
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.integrators import LagrangeTop, StepError
from lagrange_bench.integrators.methods import bobenko_suris, kahan
from lagrange_bench.integrators.problem.top import TOPS
from tests.test_integrators.paper.tools import jacobian

EPS = float(np.finfo(float).eps)
GENERIC = TOPS["generic"]
METHODS = (kahan.METHOD, bobenko_suris.METHOD)
LAGRANGE = replace(
    bobenko_suris.METHOD,
    order=1,
    symmetric=False,
    prepare=partial(bobenko_suris.prepare, form="lagrange"),
    keeps={"E": bobenko_suris.energy_lagrange},
    needs="uniform",
    special={},
)


def rationals(n, seed):
    draw = random.Random(seed)
    return [Fraction(draw.randint(-99, 99) or 1, draw.randint(10, 99)) for _ in range(n)]


def rational_cases(count=4):
    """alpha, h and a state. An identity of rational functions that holds at a few random points holds: Schwartz and Zippel."""
    for seed in range(count):
        alpha, h, *y = rationals(8, seed)
        yield alpha, h, y


# ---------------------------------------------------------------- the maps, in any kind of number


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(u * v for u, v in zip(a, b, strict=True))


def plus(a, b, r=1):
    return [u + r * v for u, v in zip(a, b, strict=True)]


def rhs(alpha, y):
    return [-alpha * y[4], alpha * y[3], 0 * alpha, *cross(y[:3], y[3:])]


def hat(v):
    return [[0 * v[0], -v[2], v[1]], [v[2], 0 * v[0], -v[0]], [-v[1], v[0], 0 * v[0]]]


def derivative(alpha, y):
    """f'(y)."""
    zero = 0 * alpha
    top = [[zero] * 3 + row for row in ([zero, -alpha, zero], [alpha, zero, zero], [zero] * 3)]
    return top + [[-u for u in a] + b for a, b in zip(hat(y[3:]), hat(y[:3]), strict=True)]


def eliminate(A, b):
    """The solution of A x = b, and det A."""
    rows = [[*row, v] for row, v in zip(A, b, strict=True)]
    n, det = len(rows), 1
    for i in range(n):
        pivot = next(r for r in range(i, n) if rows[r][i] != 0)
        if pivot != i:
            rows[i], rows[pivot], det = rows[pivot], rows[i], -det
        det = det * rows[i][i]
        for r in range(n):
            if r != i:
                rows[r] = plus(rows[r], rows[i], -(rows[r][i] / rows[i][i]))
    return [rows[i][n] / rows[i][i] for i in range(n)], det


def kahan_map(alpha, h, y):
    """(1 − (h/2) f'(y)) (ỹ − y) = h f(y): Kahan's method for any quadratic f."""
    identity = [[int(i == j) for j in range(6)] for i in range(6)]
    A = [plus(one, row, -h / 2) for one, row in zip(identity, derivative(alpha, y), strict=True)]
    return plus(y, eliminate(A, [h * v for v in rhs(alpha, y)])[0])


def kick(alpha, t, y):
    return [y[0] - t * alpha * y[4], y[1] + t * alpha * y[3], *y[2:]]


def cayley(h, y):
    w, x = [h / 2 * v for v in y[:3]], y[3:]
    u = cross(w, x)
    return [*y[:3], *plus(x, plus(u, cross(w, u)), 2 / (1 + dot(w, w)))]


def lagrange_map(alpha, h, y):
    return cayley(h, kick(alpha, h, y))


def symmetric_map(alpha, h, y):
    return kick(alpha, h / 2, cayley(h, kick(alpha, h / 2, y)))


MAPS = {"kahan": kahan_map, "bobenko_suris": symmetric_map, "lagrange": lagrange_map}


def invariants(alpha, y):
    J, x = y[:3], y[3:]
    return {"H": dot(J, J) / 2 + alpha * x[2], "J3": J[2], "C1": dot(x, x), "C2": dot(x, J)}


def kept_by_kahan(alpha, h, y):
    J, x = y[:3], y[3:]
    eps = alpha * h * h / 4
    e = J[0] ** 2 + J[1] ** 2 + 2 * alpha * x[2] - eps * alpha * (x[0] ** 2 + x[1] ** 2)
    r0 = dot(x, J) / (1 - eps * x[2])
    rho = h * r0 / 2
    v = [h * J[0] / 2, h * J[1] / 2, h * J[2] / 2 + eps * rho]
    return {"J3": J[2], "e": e, "r0": r0, "kappa": (dot(x, x) + rho**2) / (1 + dot(v, v))}


def kept_by_symmetric(alpha, h, y):
    I = invariants(alpha, y)
    return I | {"H": I["H"] - h * h / 8 * alpha**2 * (y[3] ** 2 + y[4] ** 2)}


def kept_by_lagrange(alpha, h, y):
    I = invariants(alpha, y)
    return I | {"H": I["H"] + h / 2 * alpha * (y[3] * y[1] - y[4] * y[0])}


KEPT = {"kahan": kept_by_kahan, "bobenko_suris": kept_by_symmetric, "lagrange": kept_by_lagrange}


# ---------------------------------------------------------------- proofs


@pytest.mark.parametrize("name", MAPS)
def test_integrals_are_exact(name):
    for alpha, h, y in rational_cases():
        image = MAPS[name](alpha, h, y)
        assert KEPT[name](alpha, h, image) == KEPT[name](alpha, h, y)
        assert invariants(alpha, image)["H"] != invariants(alpha, y)["H"]


@pytest.mark.parametrize("name", ["kahan", "bobenko_suris"])
def test_the_inverse_is_the_map_of_minus_h(name):
    for alpha, h, y in rational_cases():
        assert MAPS[name](alpha, -h, MAPS[name](alpha, h, y)) == y


def test_kahan_is_bilinear_and_has_the_energy_of_bobenko_and_suris():
    for alpha, h, y in rational_cases():
        z = kahan_map(alpha, h, y)
        J, x, K, X = y[:3], y[3:], z[:3], z[3:]
        assert plus(K, J, -1) == [h * alpha / 2 * v for v in cross([0, 0, 1], plus(x, X))]
        assert plus(X, x, -1) == [h / 2 * v for v in plus(cross(K, x), cross(J, X))]
        kept = kept_by_kahan(alpha, h, y)
        assert kept["e"] == 2 * kept_by_symmetric(alpha, h, y)["H"] - y[2] ** 2


def test_kahan_keeps_a_volume():
    """det DΦ = density(ỹ)/density(y), DΦ from dual numbers; the flow's own volume is not kept."""
    for alpha, h, y in rational_cases(2):

        def density(y, alpha=alpha, h=h):
            eps = alpha * h * h / 4
            rho = h / 2 * dot(y[:3], y[3:]) / (1 - eps * y[5])
            return (1 - eps * y[5]) * (dot(y[3:], y[3:]) + rho**2)

        D = jacobian(lambda z, alpha=alpha, h=h: kahan_map(alpha, h, list(z)), y)
        det = eliminate(D.tolist(), y)[1]
        assert det == density(kahan_map(alpha, h, y)) / density(y) != 1


@pytest.mark.parametrize(("name", "poisson"), [("kahan", False), ("bobenko_suris", True), ("lagrange", True)])
def test_poisson_or_not(name, poisson):
    """D P(y) Dᵀ = P(ỹ), with D exact."""

    def tensor(y):
        J, x, zero = -np.array(hat(y[:3])), -np.array(hat(y[3:])), np.zeros((3, 3), dtype=int)
        return np.block([[J, x], [x, zero]])

    for alpha, h, y in rational_cases(2):

        def image(z, name=name, alpha=alpha, h=h):
            return MAPS[name](alpha, h, list(z))

        D = jacobian(image, y)
        assert np.array_equal(D @ tensor(y) @ D.T, tensor(image(y))) == poisson


def test_the_two_forms_are_conjugate():
    for alpha, h, y in rational_cases():
        z = kick(alpha, h / 2, y)
        assert symmetric_map(alpha, h, z) == kick(alpha, h / 2, lagrange_map(alpha, h, y))
        assert kept_by_symmetric(alpha, h, z) == kept_by_lagrange(alpha, h, y)
        K, image = kick(alpha, h, y)[:3], lagrange_map(alpha, h, y)
        assert plus(image[3:], y[3:], -1) == [h / 2 * v for v in cross(K, plus(y[3:], image[3:]))]


# ---------------------------------------------------------------- the kernels


def one_step(method, top, y0, h):
    """The state after it, or the StepError."""
    try:
        return method.prepare_for(top)(top, y0, h).advance(y0, 1)
    except StepError as error:
        return error


@pytest.mark.parametrize(("name", "method"), list(zip(MAPS, (*METHODS, LAGRANGE), strict=True)))
def test_a_step_is_the_map(name, method):
    """Within a few ulp, and so are the quantities the record keeps; doubles taken as the rationals they are."""
    compared = 0
    for state in ("generic", "figure1", "fast", "slow", "weightless", "inverted", "hanging", *states.RANDOM):
        top, y0 = states.find(state)
        for span in (0.1, -0.5, 3.0):
            h = span * top.scales(y0)[2]
            y = one_step(method, top, y0, h)
            if isinstance(y, StepError):
                assert (name, span) == ("kahan", 3.0)
                continue
            alpha, exact_h, exact_y = Fraction(top.alpha), Fraction(h), list(map(Fraction, y0))
            z = np.array(MAPS[name](alpha, exact_h, exact_y), dtype=float)
            assert metrics.scaled_error(top, y0, y, z) < 16 * EPS, (state, span)
            kept = KEPT[name](alpha, exact_h, exact_y)
            for quantity, function in method.keeps.items():
                values, size = function(top, h, y0[None])
                value = float(kept.get(quantity, kept.get("H")))
                assert abs(values[0] - value) < 8 * EPS * size
                assert abs(value) <= size * (1 + 8 * EPS)
            compared += 1
    assert compared > 60


@pytest.mark.parametrize("method", [*METHODS, LAGRANGE], ids=["kahan", "symmetric", "lagrange"])
def test_what_is_kept_is_judged(method):
    verdicts = list(check.conserves(method, True)) if method is not LAGRANGE else check.check(method, quick=True)
    assert not [v for v in verdicts if v.passed is False]
    assert {f"conserves {name}" for name in method.keeps} <= {v.claim for v in verdicts if v.passed}


def test_kahan_refuses_what_lies_beyond_its_poles():
    """det(1 − (h/2) f') ≤ 0 or eps x3 ≥ 1; everywhere else it steps."""
    draw = np.random.default_rng(3)
    verdicts = set()
    for _ in range(400):
        y, h = draw.normal(size=6), draw.choice([0.5, 2.0, 4.0])
        top = LagrangeTop(draw.normal())
        near = 1 - h * h * top.alpha * y[5] / 4
        det = np.linalg.det(np.eye(6) - h / 2 * top.jacobian(y))
        if min(abs(near), abs(det)) < 1e-10:
            continue
        refused = isinstance(one_step(kahan.METHOD, top, y, h), StepError)
        assert refused == bool(near <= 0 or det <= 0)
        verdicts.add((bool(near > 0), bool(det > 0)))
    assert len(verdicts) == 4
    y = np.array((0.0, 0, 0, 0, 0, 1))
    with pytest.raises(StepError, match=r"kahan at h = 2, step 0: .*pole"):  # det = 0: 1 − eps x3 = J3 = 0
        kahan.prepare(LagrangeTop(1.0), y, 2.0).advance(y, 1)


# ---------------------------------------------------------------- true invariants: bounded, and by how much


@pytest.mark.parametrize("state", ["generic", "planar_rotation", "inverted"])
def test_energy_of_bobenko_suris_is_bounded_a_priori(state):
    """0 ≤ H − E ≤ h² alpha² C1/8; a planar pendulum that goes over the top uses all of it."""
    top, y0 = states.find(state)
    h = 0.5 * top.scales(y0)[2]
    y = bobenko_suris.prepare(top, y0, h).record(y0, 100_000, 1)
    bound = h**2 * top.alpha**2 * np.sum(y0[3:] ** 2) / 8
    excess = top.invariants(y)[:, 0] - bobenko_suris.energy(top, h, y0[None])[0][0]
    room = 1e-12 * top.invariant_scales(y0)[0]  # round-off of 100000 steps
    assert -room <= np.min(excess)
    assert np.max(excess) <= bound + room
    if state == "planar_rotation":
        assert np.ptp(excess) > 0.999 * bound


def test_kahan_does_not_drift():
    """H, C1 and C2 oscillate by a few h², in the last tenth of a million steps no more than in the first."""
    top, y0, h = GENERIC.top, GENERIC.state, 0.05
    rows = kahan.prepare(top, y0, h).record(y0, 10**6, 20)
    drift = np.abs(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0)))[:, [0, 2, 3]]
    first, last = np.max(drift[:5000], axis=0), np.max(drift[-5000:], axis=0)
    assert np.all(first < h**2)
    assert np.all(first > 1e-5)
    assert np.all(last < 1.001 * first)
