"""The contraction of two sites to the top, as far as it is exact at every ε. The limits: see `test_paper_sections`."""

import numpy as np

from lagrange_bench.integrators.paper import contraction as con
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.phase_space import invariants, poisson_tensor
from tests.test_integrators.paper.tools import jacobian


def test_what_is_exact(p):
    """(2.15), (2.18), (2.20), (5.2.13), (5.2.14) corrected, and 2H = ε H_2 + s_1² + s_2², H_1 + H_2 = 2 alpha J3."""
    y, u, eps = p.y, p.number(), (1 + 0 * p.lam).real / 4
    magnet, spins = con.to_magnet(p.top, y, eps)
    H, J3, C1, C2 = invariants(p.top, y)
    ell, squares = con.lax_vector(p.top, y, u, eps), magnet.casimirs(spins)
    p.same(con.from_magnet(spins, eps), y)
    p.same(1j * lax.gaudin_matrix(p.top.alpha, magnet.sites, spins, u), 1j * lax.pauli(ell), 100)
    p.same(1j * lax.pauli(con.lax_vector(p.top, y, u)), lax.lax_matrix(p.top, y, u), 10)
    p.same(np.sum(ell * ell), con.curve(p.top, y, u, eps), 1000)
    p.same(squares, con.spins_squared(y, eps), 100)
    p.same(con.energy(magnet, spins), H, 100)
    p.same(np.sum(magnet.hamiltonians(spins)), 2 * p.top.alpha * J3, 1000)
    p.same(con.casimirs(y, eps), (eps**2 * squares[1], (squares[1] - squares[0]) * eps / 2), 100)
    p.same(con.casimirs(y), (C1, C2))


def test_the_bracket_at_finite_epsilon(p):
    """(2.20) corrected: {x1, x2} = ε x3; C1 and x·J − (ε/2)|J|² are central, x·J is not."""
    y, eps = p.y, (1 + 0 * p.lam).real / 4
    magnet, spins = con.to_magnet(p.top, y, eps)
    D = jacobian(lambda z: con.from_magnet(z.reshape(2, 3), eps), spins.ravel())
    P = D @ magnet.poisson(spins) @ D.T
    p.same(P, con.bracket(y, eps), 100)
    p.same(P @ jacobian(lambda z: np.array(con.casimirs(z, eps)), y).T, np.zeros((6, 2)), 100)
    p.same(con.bracket(y), poisson_tensor(y))
    naive = jacobian(lambda z: np.array(con.casimirs(z)), y)
    assert np.max(np.abs((P @ naive.T).astype(complex))) > 1e-3
