"""Section 5.6: the continuum limit, the interpolating Hamiltonian flow, T(λ), Θ(λ), χ(λ), and the exact step as a map."""

import math

import numpy as np
import pytest
from mpmath import mp, mpc
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper import interpolating_flow as flow
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import gradient, numbers, poisson_tensor, vector_field
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.torus import clock
from lagrange_bench.integrators.torus import time_step as ts
from tests import reference
from tests.test_integrators.paper.tools import largest

pytestmark = pytest.mark.interpreted
NAMES = ("generic", "figure2", "inverted", "near_separatrix")


def unit(name):
    """Length of λ that goes with the top: |x| over |J| + √(|alpha||x|)."""
    rate, size, _ = TOPS[name].top.scales(TOPS[name].state)
    return size / rate


def test_continuum_limit(p):
    """(5.6.1)–(5.6.5) [160], (5.6.7), (5.6.8): exact derivatives in ε = i(λ1 − λ2) at 0 of x, X, M(u), of the map and of L(u)."""
    y, lam, u, top, sheet = p.y, p.lam, p.u, p.top, p.sheet
    second = tp.point(top, y, lam, sheet)

    def at(f):
        """f of the point over λ1 = λ2 − iε at ε = 0, and its derivative by ε."""

        def values(z):
            return f(tp.point(top, y, z[0], sheet))

        return values(np.array([lam])), -1j * gradient(values, np.array([lam]))[..., 0]

    (x, X), (_, X_rate) = at(lambda first: np.array(tp.parameters(top, y, first, second)))
    x0, X0 = flow.limit_parameters(top, y, second)
    scale = 10 * (1 + abs(x0)) ** 3 * (1 + abs(X0)) ** 2
    p.same([x, X, X_rate], [x0, 0, X0], scale)
    M, M_rate = at(lambda first: tp.dressing_matrix(*tp.parameters(top, y, first, second), first[0], lam, u))
    p.same(M, (u - lam) * np.eye(2), scale)
    p.same(M_rate, (u - lam) * flow.limit_matrix(top, y, u, second), scale)
    _, rate = at(lambda first: tp.explicit(top, y, first, second))
    p.same(rate, flow.limit_rate(top, y, lam, sheet), scale)
    p.same(at(lambda first: tp.pole_free(top, y, first[0], lam, sheet))[1], rate, scale)
    p.same(flow.limit_lax_rate(top, y, u, second), np.tensordot(rate, lax.lax_gradient(u), axes=1), scale)
    mu = gradient(lambda z: tp.point(top, z, lam, sheet)[1], y)
    p.same(-poisson_tensor(y) @ (1j * mu), rate, 10 * (1 + largest(rate)) ** 2)  # {iμ2, z}
    p.same(flow.limit_rate(top, y, 0, sheet), -sheet * vector_field(top, y) / lax.root(top, y, 0), 100)


def attitude_angle(top, y, lam):
    """χ, (6) of docs/exact-step.md: 2π − 2 arg λ − 2√C1 Im ∫_0^λ (1/√Q − 1/√C1) du/u, without the cancellation at u = 0."""
    q = lax.spectral_polynomial(top, numbers(y))
    r = mp.sqrt(q[0])

    def integrand(u, m):
        return -(q[1] + u * (q[2] + u * (q[3] + u * q[4]))) / (r * m * (r + m))

    return 2 * mp.pi - 2 * mp.arg(lam) - 2 * r * clock.integral(q, lam, integrand).imag


@pytest.mark.parametrize(("share", "name"), [*((0.45, name) for name in TOPS), (5e-7, "generic"), (0.15, "weightless")])
def test_the_time_of_the_exact_step(name, share):
    """T(λ(h)) = h and Θ = 0, below half a nutation, to 28 digits. Measured 5e-31."""
    named = TOPS[name]
    period = ts.torus(named.alpha, named.y0, 0.0)[1][0]
    h = share * min(period, 10 * named.top.scales(named.state)[2])
    lam, _, _ = ts.time_step(*ts.torus(named.alpha, named.y0, h), h)
    with mp.workdps(31):
        lam = mpc(reference.real(lam[0]), reference.real(lam[1]))
        T, turn = flow.time_and_turn(named.top, named.y0, lam)
        assert abs(T - h) <= 1e-28 * h
        assert abs(turn) <= 1e-28 * (1 + abs(named.alpha) * h)


@pytest.mark.parametrize("name", ["generic", "inverted"])
def test_attitude_of_any_step(name):
    """g̃ = q rot(x/|x|, χ) g against g' = J g/2 integrated with the motion over T, then turned about e3 by Θ."""
    top, y = TOPS[name].top, TOPS[name].state
    for lam in (0.2 + 0.3j, -0.1 + 0.2j):
        lam *= unit(name)
        T, turn = map(float, flow.time_and_turn(top, y, lam))

        def rhs(_, s, top=top):
            return np.concatenate((top.rhs(s[:6]), np.array(product((0, *s[:3]), s[6:])) / 2))

        g = solve_ivp(rhs, (0, T), (*y, 1, 0, 0, 0), "DOP853", rtol=1e-13, atol=1e-14).y[6:, -1]
        g = product((math.cos(turn / 2), 0, 0, math.sin(turn / 2)), g)
        chi, w = float(attitude_angle(top, y, lam)), tp.axis(top, y, lam, lam.conjugate()).real
        about_x = math.cos(chi / 2), *(math.sin(chi / 2) * y[3:] / np.linalg.norm(y[3:]))
        step = np.array(product((-lam.real, *-w), about_x)) / abs(lam)
        assert largest(step - g) <= 1e-11
