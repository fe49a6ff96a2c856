"""Section 5.6: the continuum limit; T(λ) and Θ(λ) of the exact step."""

import numpy as np
import pytest
from mpmath import mp, mpc

from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper import interpolating_flow as flow
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import gradient, poisson_tensor, vector_field
from lagrange_bench.integrators.torus import time_step as ts
from tests import reference
from tests.test_integrators.paper.tools import largest

pytestmark = pytest.mark.interpreted


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
