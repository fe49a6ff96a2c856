"""Sections 1 and 2: brackets, r-matrix algebra, sheets of the spectral curve (itself: `test_errata`)."""

import numpy as np
import pytest

from lagrange_bench.integrators.paper import contraction as con
from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.phase_space import (
    cartesian,
    gradient,
    invariants,
    ladder,
    poisson_tensor,
    vector_field,
)
from tests.test_integrators.paper.tools import largest


def test_ladder_brackets(p):
    """(1.3), (1.4): all brackets of J3, J±, x3, x±."""
    J3, Jm, Jp, x3, xm, xp = ladder(p.y)
    p.same(cartesian(*ladder(p.y)), p.y)
    D = gradient(lambda z: np.array(ladder(z)), p.y)
    table = {
        (0, 2): -1j * Jp, (0, 1): 1j * Jm, (2, 1): -2j * J3,
        (0, 5): -1j * xp, (0, 4): 1j * xm, (3, 2): -1j * xp, (3, 1): 1j * xm,
        (2, 4): -2j * x3, (5, 1): -2j * x3,
    }  # fmt: skip
    expected = np.zeros((6, 6), dtype=complex).astype(p.y.dtype)
    for (a, b), value in table.items():
        expected[a, b], expected[b, a] = value, -value
    p.same(D @ poisson_tensor(p.y) @ D.T, expected)


def test_casimirs_integrals_and_the_flow(p):
    """(1.1) is {y, H}; (1.5) C1, C2 are central; (1.7) {H, J3} = 0; (1.8) H in J±."""
    slopes = gradient(lambda z: np.array(invariants(p.top, z)), p.y)
    flows = poisson_tensor(p.y) @ slopes.T
    p.same(flows[:, 0], vector_field(p.top, p.y))
    p.same(flows[:, 2:], np.zeros((6, 2)))
    p.same(slopes[1] @ flows[:, 0], 0)
    J3, Jm, Jp, x3, _, _ = ladder(p.y)
    p.same(invariants(p.top, p.y)[0], (Jp * Jm + J3 * J3) / 2 + p.top.alpha * x3)


@pytest.mark.parametrize("n", [1, 3])
def test_gaudin_r_matrix_algebra(p, n):
    """(2.5), (2.6), and element by element (2.7)–(2.10). The other sign or normalisation of r fails."""
    alpha, sites, spins, u, v = p.number(), p.numbers(n), p.numbers(3 * n).reshape(n, 3), p.u, p.number()
    gradients = [np.concatenate([lax.PAULI / (w - a) for a in sites]) for w in (u, v)]
    brackets = lax.matrix_brackets(gradients[0], poisson_tensor(*spins), gradients[1])
    Lu, Lv = lax.gaudin_matrix(alpha, sites, spins, u), lax.gaudin_matrix(alpha, sites, spins, v)
    f, scale, (a, b, c) = lax.FACTOR_GAUDIN / (u - v), sum(map(largest, (brackets, Lu, Lv))), ((0, 0), (0, 1), (1, 0))
    p.same(lax.linear_algebra_defect(brackets, Lu, Lv, lax.r_matrix(u - v)), np.zeros((4, 4)), scale)

    def of(left, right):  # {element ij, element kl} is [2i + k, 2j + l]
        return brackets[2 * left[0] + right[0], 2 * left[1] + right[1]]

    p.same([of(a, a), of(b, b), of(c, c)], [0, 0, 0])
    right = f * (Lv[b] - Lu[b]), f * (Lu[c] - Lv[c]), 2 * f * (Lu[a] - Lv[a])
    p.same((of(a, b), of(a, c), of(c, b)), right, scale)
    for factor in (-lax.FACTOR_GAUDIN, lax.FACTOR_TOP):
        defect = lax.linear_algebra_defect(brackets, Lu, Lv, lax.r_matrix(u - v, factor))
        assert largest(defect) > 1e-3 * largest(brackets)


def test_two_spins_are_o4(p):
    """(2.17): at ε = 1 J and J − 2x have the brackets of o(4), the antisymmetric matrices of four dimensions."""
    E = np.zeros((6, 4, 4))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        E[k, j, i] = E[3 + k, k, 3] = 1.0
        E[k] -= E[k].T
        E[3 + k] -= E[3 + k].T
    brackets = [[np.einsum("ij,cij->c", a @ b - b @ a, E) / 2 for b in E] for a in E]
    D = np.kron(((1, 0), (1, -2)), np.eye(3, dtype=int))
    p.same(D @ con.bracket(p.y, 1) @ D.T, np.array(brackets) @ (D @ p.y))


def test_what_is_exact(p):
    """(2.15), (2.18), (2.20), (5.2.13), (5.2.14) corrected, and 2H = ε H_2 + s_1² + s_2², H_1 + H_2 = 2 alpha J3.

    (2.20) corrected: {x1, x2} = ε x3; C1 and x·J − (ε/2)|J|² are central, x·J is not.
    """
    y, u, eps = p.y, p.number(), (1 + 0 * p.lam).real / 4
    magnet, spins = con.to_magnet(p.top, y, eps)
    H, J3, C1, C2 = invariants(p.top, y)
    ell, squares = con.lax_vector(p.top, y, u, eps), magnet.casimirs(spins)
    p.same(con.from_magnet(spins, eps), y)
    p.same(1j * lax.gaudin_matrix(p.top.alpha, magnet.sites, spins, u), 1j * lax.pauli(ell), 100)
    p.same(1j * lax.pauli(con.lax_vector(p.top, y, u)), lax.lax_matrix(p.top, y, u), 10)
    _, Jm, Jp, _, xm, xp = ladder(y)
    _, claimed, *_ = gf.contraction_arguments(C1, C2, np.sum(y[:3] ** 2), (xm, Jm), (xp, Jp), 0, eps)
    p.same(squares, claimed, 100)
    p.same(con.energy(magnet, spins), H, 100)
    p.same(np.sum(magnet.hamiltonians(spins)), 2 * p.top.alpha * J3, 1000)
    p.same(con.casimirs(y, eps), (eps**2 * squares[1], (squares[1] - squares[0]) * eps / 2), 100)
    p.same(con.casimirs(y), (C1, C2))
    D = gradient(lambda z: con.from_magnet(z.reshape(2, 3), eps), spins.ravel())
    P = D @ magnet.poisson(spins) @ D.T
    p.same(P, con.bracket(y, eps), 100)
    p.same(P @ gradient(lambda z: np.array(con.casimirs(z, eps)), y).T, np.zeros((6, 2)), 100)
    p.same(con.bracket(y), poisson_tensor(y))
    naive = gradient(lambda z: np.array(con.casimirs(z)), y)
    assert np.max(np.abs((P @ naive.T).astype(complex))) > 1e-3
