"""The Bäcklund map as it is sold: exact in time at any step, invariants at round-off for ever, any λ, any scale."""

import math
import random

import numpy as np
import pytest

from lagrange_bench import TOPS, LagrangeTop, exact, integrate, prepare, two_point
from lagrange_bench.experiments import phase
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators.torus import time_step as ts
from tests.reference import drift

EPS = np.finfo(float).eps


@pytest.mark.parametrize("name", [name for name in TOPS if name != "homoclinic"])
def test_named_tops_follow_the_exact_solution(name):
    """Errors stay far below (1e-13 + 1e-15 t) max(1, 1e-3/k'²) for 2000 steps; t in units of 1/(|J| + √(|alpha||x|))."""
    top, y0 = TOPS[name].top, TOPS[name].state
    rate, (z1, z2, z3) = top.scales(y0)[0], (z[0] for z in ts.nutation_roots(top.alpha, tuple(y0)))
    close = (z1 - z2) / (z1 - z3) if z1 > z3 else 1.0  # k'² = (e1 − e2)/(e1 − e3)
    for h in (0.03, 0.5, 2.0, 11.0, -0.7):
        run = integrate(top, y0, h / rate, 2000, every=100)
        bound = (1e-13 + 1e-15 * np.abs(run.t) * rate) * (max(1.0, 1e-3 / close) if close > 0 else math.inf)
        assert np.all(run.error() <= bound)


def drawn_with_pure_spin(number):
    """A top released at any tilt: alpha from 0.01 to 100, J from 0.1 to 100 times x, either sign of both."""
    draw = random.Random(f"pure spin {number}")
    z, angle, size = draw.uniform(-1, 1), draw.uniform(0, 2 * math.pi), 10 ** draw.uniform(-0.5, 0.5)
    flat = size * math.sqrt(1 - z * z)
    x = np.array([flat * math.cos(angle), flat * math.sin(angle), size * z])
    alpha, spin = (10 ** draw.uniform(*span) * draw.choice((-1, 1)) for span in ((-2, 2), (-1, 2)))
    return LagrangeTop(alpha), np.array([*spin * x, *x])


DEPENDENT = {f"pure spin {number}": drawn_with_pure_spin(number) for number in range(8)}


@pytest.mark.parametrize("steps", [10**6, pytest.param(10**7, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", [*TOPS, *DEPENDENT])
def test_invariants_after_millions_of_steps(name, steps):
    """8 eps, at most 16 ulps, of the scale of each; measured 1–2 ulps. J3 is never touched."""
    top, y0 = DEPENDENT.get(name) or (TOPS[name].top, TOPS[name].state)
    for h in (0.1, 2.0):
        y = prepare(top, y0, h * top.scales(y0)[2]).advance(y0, steps)
        assert np.all(drift(top, y0, y) <= 8 * EPS)
        assert y[2] == y0[2]


def test_a_top_released_with_pure_spin():
    """The gradients of H, C1 and C2 are nearly dependent where J is parallel to x and fast; digits by other programs."""
    top, y0 = LagrangeTop(0.5), np.array([8 * 0.28, 0, 8 * 0.96, 0.28, 0, 0.96])
    right = (0.68615167714453, 2.13234015580143, 7.68, 0.086872190448706, 0.266466229369369, 0.959921335908477)
    truth = exact.after_steps(top, y0, 0.02, [1000])[0]
    assert np.max(np.abs(truth - right)) < 1e-14
    for method in ("backlund", "backlund_unpinned"):
        assert np.max(np.abs(prepare(top, y0, 0.02, method).advance(y0, 1000) - truth)) < 3e-15


def test_any_top_released_with_pure_spin():
    """In ulps of the initial state that do the same. A fast light top hardly moves: no error of its state grows, and what
    its steps round off is all there is, most at half a nutation, where every other step rounds alike; unpinned up to 640."""
    for number in range(10):
        top, y0 = drawn_with_pure_spin(number)
        slow = y0[:3] @ y0[:3] <= 100 * abs(top.alpha) * np.linalg.norm(y0[3:])
        assert max(row["ulps"] for row in phase.promised_errors(top, y0, "backlund")) <= (16 if slow else 800)


BY_THE_VERTICAL = LagrangeTop(0.25), np.array((0.0, 2.0**-18, 3.0, 2.0**-18, 0.0, 1.0)), 0.51


@pytest.mark.parametrize(("top", "y0", "periods"), [(*find("planar_rotation"), 2.5), BY_THE_VERTICAL])
def test_steps_that_come_back_drift_unpinned(top, y0, periods):
    """To one of few states, or nearly, each of which rounds alike every time. 2.5 nutations have no turn on the first top."""
    h = periods * exact.nutation_period(top, y0)
    pinned, unpinned = (prepare(top, y0, h, name).advance(y0, 10**6) for name in ("backlund", "backlund_unpinned"))
    assert 1e-11 < np.max(drift(top, y0, unpinned)) < 1e-10
    assert np.max(drift(top, y0, pinned)) < 4 * EPS


@pytest.mark.parametrize(
    ("name", "lam"),
    [
        ("homoclinic", -0.5 + 1.00000000001j),  # a double root of Q is −0.5 + i
        ("homoclinic", -0.5 + 1j),
        ("regular", -2 + 1.5j),
        ("generic", -0.07159512589181724 + 0.6718896187898421j),  # a simple root, to all digits
    ],
)
def test_next_to_a_root_of_q_the_map_keeps_the_invariants(name, lam):
    named = TOPS[name]
    image = two_point(named.top, named.state, lam)
    assert np.max(drift(named.top, named.state, image)) < 4e-15


@pytest.mark.parametrize("h", [1e-300, 1e-30, 1e-12, 1e10, -1e13])
def test_extreme_steps(h):
    named = TOPS["generic"]
    y = prepare(named.top, named.state, h).advance(named.state, 3)
    jump = integrate(named.top, named.state, t=[3 * h]).y[0]
    assert np.max(np.abs(y - jump)) < 1e-14 + 1e-15 * min(abs(h), 1e3) + 1e-16 * abs(h)
