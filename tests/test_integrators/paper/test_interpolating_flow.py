"""Section 5.6: the continuum limit."""

import numpy as np
import pytest

from lagrange_bench.integrators.paper import interpolating_flow as flow
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import gradient, poisson_tensor, vector_field
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
