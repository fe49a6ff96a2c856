"""Section 3: separation variables, Darboux chart, generating function, separated equations, at general C1."""

import numpy as np
import pytest
from mpmath import mpf

from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import separation as sep
from lagrange_bench.integrators.paper.phase_space import gradient, invariants, poisson_tensor, vector_field
from tests.test_integrators.paper.tools import CANONICAL, largest

SEPARATED = np.kron(np.eye(2, dtype=int), ((0, -1), (1, 0)))  # {v_k, u_l} = δ_kl of (u1, v1, u2, v2)
CHARTS = {
    "separated": (sep.separate, sep.unseparate, SEPARATED),
    "darboux": (sep.to_darboux, sep.from_darboux, CANONICAL),
}


def sizes(*arrays):
    """Size of the terms: powers up to four of the variables of a chart."""
    return max(largest(a) for a in arrays) ** 4


def test_separation_point(p):
    """(3.1)–(3.5): (u1, v1 − i alpha) is the pole of the Baker–Akhiezer function, v1 = −A(u1) + i alpha."""
    y, top, lam = p.y, p.top, p.lam
    u1, v1, _, _ = sep.separate(y)
    v = v1 - 1j * top.alpha
    A, _, _ = lax.entries(top, y, u1)
    p.same(sep.adjugate_row(top, y, u1, v), [0, 0], 1 + abs(A))
    p.same(v, -A)
    p.same(v * v, lax.spectral_curve(top, y, u1), 10 * (1 + abs(v)) ** 2)
    mu = lax.eigenvalue(top, y, lam)
    psi = sep.baker_akhiezer(top, y, lam, mu)
    p.same(psi[0], 1)
    p.same(lax.lax_matrix(top, y, lam) @ psi, mu * psi, (1 + abs(mu)) * largest(psi) * 10)


@pytest.mark.parametrize("chart", CHARTS)
def test_charts_are_canonical_and_invertible(p, chart):
    """(3.5)–(3.8), (3.11), (3.12): both round trips, brackets both ways, Casimirs of the leaf."""
    f, back, brackets = CHARTS[chart]
    _, _, c1, c2 = invariants(p.top, p.y)
    w, D = f(p.y), gradient(f, p.y)
    p.same(back(w, c1, c2), p.y, sizes(w, 1 / w))
    p.same(D @ poisson_tensor(p.y) @ D.T, brackets, largest(D) ** 2)
    w, c1, c2 = p.numbers(4), p.number(), p.number()
    y, D = back(w, c1, c2), gradient(lambda z: back(z, c1, c2), w)
    p.same(D @ brackets @ D.T, poisson_tensor(y), largest(D) ** 2)
    p.same(invariants(p.top, y)[2:], [c1, c2], sizes(y))
    p.same(f(y), w, sizes(y) if chart == "darboux" else 1)


def test_separation_equations(p):
    """(3.9), (3.10), and the motion in separated variables."""
    H, J3, c1, c2 = invariants(p.top, p.y)
    w = sep.separate(p.y)
    p.same(sep.separated_J3(w), J3)
    p.same(sep.separated_hamiltonian(p.top, w, c1, c2), H, sizes(w, 1 / w))
    rates = sep.separated_rates(p.top, w, c1, c2)
    p.same(gradient(sep.separate, p.y) @ vector_field(p.top, p.y), rates, sizes(w, 1 / w))
    slopes = gradient(lambda z: sep.separated_hamiltonian(p.top, z, c1, c2), w)
    p.same(SEPARATED @ slopes, rates, sizes(w, 1 / w))


def test_generating_function(fine):
    """(3.13), (3.14): p = ∂F/∂q and u = −∂F/∂v by differences, and they connect the two charts of one state."""
    q, w, leaf = sep.to_darboux(fine.y), sep.separate(fine.y), invariants(fine.top, fine.y)[2:]
    momenta, u = sep.generated(q[:2], w[1::2], *leaf)
    fine.same((*momenta, *u), (*q[2:], *w[::2]), sizes(w, 1 / w))
    slopes = gradient(lambda z: sep.generating_function(z[:2], z[2:], *leaf), (*q[:2], *w[1::2]))
    assert largest(slopes - np.concatenate((momenta, -u))) <= mpf("1e-35") * sizes(w, 1 / w)
