"""What docs/exact-step.md and docs/perturbed.md say and no other test shows."""

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import solve_ivp

from lagrange_bench import TOPS, LagrangeTop, exact, prepare, two_point
from lagrange_bench.experiments.measuring.metrics import poisson_defect
from lagrange_bench.integrators.paper import interpolating_flow, lax
from lagrange_bench.integrators.paper import two_point as paper_two_point
from tests.reference import largest, turned
from tests.test_integrators.test_backlund_splitting import problem

pytestmark = pytest.mark.interpreted
PERTURBED = Path(__file__).parents[2] / "docs" / "perturbed.md"


def test_two_states_of_a_torus_are_one_step_apart():
    """Any translation (T, Θ) of any torus is one step, and the linear equations find it; on the other sheet it is not."""
    draw, sheets = random.Random(3), {1: 0, -1: 0}
    for _ in range(60):
        top, y = LagrangeTop(draw.uniform(-2, 2)), np.array([draw.gauss(0, 1) for _ in range(6)])
        T = draw.uniform(-1, 1) * exact.nutation_period(top, y)
        turn = draw.uniform(0, 2 * math.pi)
        image = np.array(turned(math.cos(turn), math.sin(turn), exact.solution(top, y, T)))
        d, s, moved = image[:3] - y[:3], image[:3] + y[:3], image[3:] - y[3:]
        w = np.array((d[1], -d[0], 0.0)) / (2 * top.alpha)
        R, w[2] = np.linalg.solve(((d[0], s[1]), (d[1], -s[0])), (moved - np.cross(s, w))[:2])
        lam = complex(R, np.linalg.norm(w))  # by linear equations; (3)
        errors = {sheet: np.max(np.abs(two_point(top, y, lam, sheet) - image)) for sheet in sheets}
        found = min(errors, key=errors.get)
        assert errors[found] < 1e-10
        assert errors[-found] > 1e-4
        sheets[found] += 1
    assert min(sheets.values()) > 20


@pytest.mark.parametrize("sheet", [1, -1])
@pytest.mark.parametrize("angle", [0.3, 1.5, 2.5])
def test_far_away_a_step_is_a_turn(angle, sheet):
    """|λ| → ∞ with m ≈ ± alpha λ²: T = 0, Θ = ± 2 arg λ."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    image = two_point(top, y, 1e9 * complex(math.cos(angle), math.sin(angle)), sheet)
    assert np.max(np.abs(image - turned(math.cos(2 * angle), sheet * math.sin(2 * angle), y))) < 1e-7


def test_a_double_root_leads_to_the_sleeping_top():
    """λ at the complex double root of a homoclinic orbit: m = 0, every state of it has one image, and T is infinite."""
    with mp.workdps(60):
        top, lam, asleep = LagrangeTop(1.0), mp.mpc("-0.6", "0.8"), np.array([0, 0, mp.mpf("1.2"), 0, 0, 1])
        y = np.array([mp.mpf("0.6"), mp.sqrt(mp.mpf("0.44")), mp.mpf("1.2"), mp.mpf("0.8"), mp.mpf(0), mp.mpf("0.6")])
        assert largest(y[3:] + lam * y[:3] + np.array((0, 0, lam * lam))) > 0.5  # a(λ) is not 0

        def image(y, share=1):
            return paper_two_point.pole_free(top, y, share * lam, (share * lam).conjugate())

        for state in (y, y * (1, -1, 1, 1, 1, 1)):
            assert largest(image(state) - asleep) < 1e-28  # √Q(λ) halves the digits
            assert largest(image(state, mp.mpf("0.999")) - asleep) > 1e-4, "negative control"
    with mp.workdps(25):
        times = [interpolating_flow.time_and_turn(top, y, lam * (1 - mp.mpf(10) ** -k))[0] for k in (3, 4)]
    assert float(times[1] - times[0]) == pytest.approx(math.log(10) / 0.8, rel=1e-3)  # −ln δ/(alpha η) + …
    assert float(times[1] - 4 * math.log(10) / 0.8) == pytest.approx(0.5875, abs=1e-3)
    with pytest.raises(ValueError, match="a root of Q"):
        interpolating_flow.time_and_turn(top, y, complex(lam))


@pytest.mark.parametrize(("name", "back"), [("generic", False), ("inverted", False), (None, True)])
def test_where_lambda_goes_after_a_whole_nutation(name, back):
    """dλ/dh = −m λ̄/2η up to T_nut: to infinity, or, where kP is a multiple of 2π as in a plane, back to 0 on the other sheet."""
    if name:
        top, y = TOPS[name].top, TOPS[name].state
    else:  # over the top, in a plane
        top, y = LagrangeTop(1.0), np.array([3.0, 0.0, 0.0, 0.0, math.sin(1.0), math.cos(1.0)])
    q, end = [float(c) for c in lax.spectral_polynomial(top, y)], 0.999 * exact.nutation_period(top, y)
    slope = [k * c for k, c in enumerate(q)][1:]
    start, r = 1e-4, math.sqrt(q[0])

    def rhs(_, z):  # dm/dh = Q'(λ)/2m dλ/dh, regular at m = 0
        lam, m = complex(z[0], z[1]), complex(z[2], z[3])
        rates = -m * lam.conjugate(), -sum(c * lam**k for k, c in enumerate(slope)) * lam.conjugate() / 2
        return [part for rate in rates for part in ((rate / (2 * lam.imag)).real, (rate / (2 * lam.imag)).imag)]

    first = (0.0, start * r / 2, r, q[1] / (2 * r) * start * r / 2)
    found = solve_ivp(rhs, (start, end), first, "DOP853", rtol=1e-10, atol=1e-12).y
    size, unit = np.hypot(found[0], found[1]), top.scales(y)[1] / top.scales(y)[0]
    assert np.all(found[1] > 0)
    if back:
        assert size[-1] < 0.01 * size.max()
        assert found[2, -1] == pytest.approx(-r, rel=0.01)
    else:
        assert size[-1] > 50 * unit


def test_degrees_of_the_tables():
    text = PERTURBED.read_text("utf-8")
    (shown,) = re.findall(r"^\| degree \| (.*) \|$", text, re.MULTILINE)
    found = []
    for name in ("tide_1e-6", "weak_tide", "moderate_tide", "strong_tide"):
        top, y0, unit = problem(name)
        found.append(prepare(top, y0, 0.5 * unit, "backlund_splitting").degree)
    assert [int(word) for word in shown.split(" | ")] == found


def test_a_smooth_lambda_is_not_enough_for_a_poisson_map():
    top, y0 = TOPS["generic"].top, TOPS["generic"].state

    def defect(of_H, of_J3):
        def step(y):
            H, J3 = (top.invariants(y) - top.invariants(y0))[:2]
            return two_point(top, y, 0.1 + 0.4j + of_H * H + of_J3 * J3)

        return poisson_defect(step, top, y0).defect

    assert defect(0, 0) < 1e-10
    assert min(defect(c, 0) for c in (0.1, 0.1j)) > 1e-2
    assert min(defect(0, c) for c in (0.1, 0.1j)) > 1e-2
