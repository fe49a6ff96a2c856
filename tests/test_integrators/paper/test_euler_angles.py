"""Section 4: Euler angles, Hamiltonian, and the Weierstrass solution against the theta functions of `exact`."""

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.experiments.measuring.states import WIDE, find
from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper.euler_angles import angles, from_angles, hamiltonian, rates, states, to_angles
from lagrange_bench.integrators.paper.phase_space import gradient, invariants, poisson_tensor, vector_field
from lagrange_bench.integrators.truth import exact
from tests.test_integrators.paper.tools import CANONICAL, largest

ELLIPTIC = [name for name, top in TOPS.items() if exact.regime(top.top, top.y0) == "elliptic"]
POLES = {"planar", "planar_rotation", "through_pole"}
QUICK = ("generic", "inverted", "through_pole")
TIMES = (0.0, -2.9, 11.3)


def test_there_and_back(p):
    """(4.1) and its inverse on complex states of any leaf."""
    p.same(from_angles(to_angles(p.y), *invariants(p.top, p.y)[2:]), p.y)


def test_leaf(p):
    """(1.5): from_angles lands on |x|² = c1, x·J = c2; (4.3), (4.4): H and J3."""
    q, c1, c2 = p.numbers(4), p.number() ** 2, p.number()
    p.same(invariants(p.top, from_angles(q, c1, c2)), (hamiltonian(p.top.alpha, q, c1, c2), q[3], c1, c2))


def test_canonical(fine):
    """(4.2): {p_θ, θ} = {p_φ, φ} = 1 is the bracket of e(3) on the leaf; θ' = −p_θ … is (1.1)."""
    q, leaf = fine.numbers(4), (fine.number() ** 2, fine.number())
    D, y = gradient(lambda z: from_angles(z, *leaf), q), from_angles(q, *leaf)
    assert largest(D @ -CANONICAL @ D.T - poisson_tensor(y)) < mpf(10) ** -30
    assert largest(D @ rates(fine.top.alpha, q, *leaf) - vector_field(fine.top, y)) < mpf(10) ** -30


@pytest.mark.parametrize(
    "case",
    [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in (*ELLIPTIC, *WIDE[:4])],
)
def test_sigma_form_and_angles_are_the_exact_solution(case):
    """J+, x+, x3 by ℘, ζ, σ, and corrected (4.5): θ, φ mod 2π, p_θ, p_φ: 30 digits, and round-off in double."""
    top, y = find(case)
    scale, rate = max(top.scales(y)[:2]), max(1, top.scales(y)[0])
    with mp.workdps(40):
        truth = exact.solution(top, y, TIMES, digits=38)
        for digits, bound, bound_of_angles in ((32, mpf(10) ** -30, mpf(10) ** -30), (None, 1e-14, 1e-12)):
            assert largest(states(top, y, TIMES, digits) - truth) < bound * scale
            if case not in POLES:
                error = angles(top, y, TIMES, digits) - [to_angles(row) for row in truth]
                error[:, 1] = [e - 2 * mp.pi * mp.nint(e / (2 * mp.pi)) for e in error[:, 1]]
                assert largest(error) < bound_of_angles * rate


@pytest.mark.parametrize("case", ["figure2", "inverted", *WIDE[:2]])
def test_phi_is_continuous(case):
    """φ(t + T) − φ(t) is minus the precession per nutation, which counts the turns."""
    top, y = find(case)
    period, swept = exact.nutation_period(top, y), exact.precession_per_nutation(top, y)
    phi = angles(top, y, [0.25, 0.25 + period, 0.25 + 7 * period])[:, 1]
    np.testing.assert_allclose((phi[1:] - phi[0]) / -swept, (1, 7), rtol=1e-12)
    assert angles(top, y, 0.0)[1] == pytest.approx(to_angles(y)[1], abs=1e-13)
