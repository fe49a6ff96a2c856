"""Sections 3 and 4: separation variables and a Darboux chart, at general C1; Euler angles, and the solution by σ functions."""

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.experiments.measuring.states import WIDE, find
from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper import separation as sep
from lagrange_bench.integrators.paper.euler_angles import angles, from_angles, rates, states, to_angles
from lagrange_bench.integrators.paper.phase_space import gradient, invariants, poisson_tensor, vector_field
from lagrange_bench.integrators.truth import exact
from tests.test_integrators.paper.tools import CANONICAL, largest

SEPARATED = np.kron(np.eye(2, dtype=int), ((0, -1), (1, 0)))  # {v_k, u_l} = δ_kl of (u1, v1, u2, v2)
CHARTS = {
    "separated": (sep.separate, sep.unseparate, SEPARATED),
    "darboux": (sep.to_darboux, sep.from_darboux, CANONICAL),
}


def sizes(*arrays):
    """Size of the terms: powers up to four of the variables of a chart."""
    return max(largest(a) for a in arrays) ** 4


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


def test_generating_function(fine):
    """(3.13), (3.14): p = ∂F/∂q and u = −∂F/∂v by differences, and they connect the two charts of one state."""
    q, w, leaf = sep.to_darboux(fine.y), sep.separate(fine.y), invariants(fine.top, fine.y)[2:]
    momenta, u = sep.generated(q[:2], w[1::2], *leaf)
    fine.same((*momenta, *u), (*q[2:], *w[::2]), sizes(w, 1 / w))
    slopes = gradient(lambda z: sep.generating_function(z[:2], z[2:], *leaf), (*q[:2], *w[1::2]))
    assert largest(slopes - np.concatenate((momenta, -u))) <= mpf("1e-35") * sizes(w, 1 / w)


# ---------------------------------------------------------------- section 4: Euler angles


def test_canonical(fine):
    """(4.2): {p_θ, θ} = {p_φ, φ} = 1 is the bracket of e(3) on the leaf; θ' = −p_θ … is (1.1)."""
    q, leaf = fine.numbers(4), (fine.number() ** 2, fine.number())
    D, y = gradient(lambda z: from_angles(z, *leaf), q), from_angles(q, *leaf)
    assert largest(D @ -CANONICAL @ D.T - poisson_tensor(y)) < mpf(10) ** -30
    assert largest(D @ rates(fine.top.alpha, q, *leaf) - vector_field(fine.top, y)) < mpf(10) ** -30


@pytest.mark.parametrize("name", ["generic", "inverted"])
def test_sigma_form_and_angles_are_the_exact_solution(name):
    """J+, x+, x3 by ℘, ζ, σ, and corrected (4.5): θ, φ, p_θ, p_φ: to 30 digits; `paper euler` sees doubles."""
    top, y, t = TOPS[name].top, TOPS[name].state, (0.0, -2.9, 11.3)
    with mp.workdps(40):
        truth = exact.solution(top, y, t, digits=38)
        leaf = invariants(top, truth[0])[2:]
        for found in (states(top, y, t, 32), [from_angles(row, *leaf) for row in angles(top, y, t, 32)]):
            assert largest(found - truth) < mpf(10) ** -30 * (1 + largest(truth))


@pytest.mark.parametrize("case", ["figure2", "inverted", *WIDE[:2]])
def test_phi_is_continuous(case):
    """φ(t + T) − φ(t) is minus the precession per nutation, which counts the turns."""
    top, y = find(case)
    period, swept = exact.nutation_period(top, y), exact.precession_per_nutation(top, y)
    phi = angles(top, y, [0.25, 0.25 + period, 0.25 + 7 * period])[:, 1]
    np.testing.assert_allclose((phi[1:] - phi[0]) / -swept, (1, 7), rtol=1e-12)
    assert angles(top, y, 0.0)[1] == pytest.approx(to_angles(y)[1], abs=1e-13)
