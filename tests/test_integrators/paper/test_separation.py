"""Section 3: separation variables, Darboux chart, generating function, separated equations, at general C1."""

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import separation as sep
from lagrange_bench.integrators.paper.phase_space import invariants, poisson_tensor, sqrt, vector_field
from tests.test_integrators.paper.tools import (
    CANONICAL,
    DIGITS,
    jacobian,
    largest,
    points,
)

both = pytest.mark.parametrize("digits", DIGITS)
SEPARATED = np.array(
    ((0, -1, 0, 0), (1, 0, 0, 0), (0, 0, 0, -1), (0, 0, 1, 0))
)  # {v_k, u_l} = δ_kl of (u1, v1, u2, v2)


def sizes(*arrays):
    """Size of the terms: powers up to four of the variables of a chart."""
    return max(largest(a) for a in arrays) ** 4


@both
def test_separation_point(digits):
    """(3.1)–(3.5): (u1, v1 − i alpha) is the pole of the Baker–Akhiezer function, v1 = −A(u1) + i alpha."""
    for p in points(digits):
        y, top = p.state(), p.top
        u1, v1, _, _ = sep.separate(y)
        v = v1 - 1j * top.alpha
        A, B, C = lax.entries(top, y, u1)
        p.same(sep.adjugate_row(top, y, u1, v), [0, 0], 1 + abs(A))
        p.same(v, -A)
        p.same(v * v, lax.spectral_curve(top, y, u1), 10 * (1 + abs(v)) ** 2)
        assert abs(v1 + A) > 0.4  # the printed v1 = −A(u1)
        lam = p.number()
        mu = lax.eigenvalue(top, y, lam)
        psi = sep.baker_akhiezer(top, y, lam, mu)
        p.same(psi[0], 1)
        p.same(lax.lax_matrix(top, y, lam) @ psi, mu * psi, (1 + abs(mu)) * largest(psi) * 10)


@both
def test_separation_variables_are_canonical(digits):
    """(3.7), both ways, and that the leaf is the right one."""
    for p in points(digits):
        y, top = p.state(), p.top
        w = sep.separate(y)
        D = jacobian(sep.separate, y)
        p.same(D @ poisson_tensor(y) @ D.T, SEPARATED, largest(D) ** 2)
        w = p.numbers(4)
        c1, c2 = p.number(), p.number()
        y = sep.unseparate(w, c1, c2)
        D = jacobian(lambda z, c1=c1, c2=c2: sep.unseparate(z, c1, c2), w)
        p.same(D @ SEPARATED @ D.T, poisson_tensor(y), largest(D) ** 2)
        p.same(invariants(top, y)[2:], [c1, c2], sizes(y))


@both
def test_separation_and_back(digits):
    """(3.8) for any C1, C2."""
    for p in points(digits):
        y = p.state()
        _, _, c1, c2 = invariants(p.top, y)
        w = sep.separate(y)
        p.same(sep.unseparate(w, c1, c2), y, sizes(w, 1 / w))
        w = p.numbers(4)
        p.same(sep.separate(sep.unseparate(w, c1, c2)), w)


@both
def test_separation_equations(digits):
    """(3.9), (3.10), and the motion in separated variables."""
    for p in points(digits):
        y, top = p.state(), p.top
        H, J3, c1, c2 = invariants(top, y)
        w = sep.separate(y)
        p.same(sep.separated_J3(w), J3)
        p.same(sep.separated_hamiltonian(top, w, c1, c2), H, sizes(w, 1 / w))
        rates = sep.separated_rates(top, w, c1, c2)
        D = jacobian(sep.separate, y)
        p.same(D @ vector_field(top, y), rates, sizes(w, 1 / w))
        gradient = jacobian(lambda z, top=top, c1=c1, c2=c2: sep.separated_hamiltonian(top, z, c1, c2), w)[0]
        p.same(SEPARATED @ gradient, rates, sizes(w, 1 / w))


@both
def test_darboux_chart(digits):
    """(3.11), (3.12): both round trips, {q, p} = 1, Casimirs."""
    for p in points(digits):
        y = p.state()
        _, _, c1, c2 = invariants(p.top, y)
        z = sep.to_darboux(y)
        p.same(sep.from_darboux(z, c1, c2), y, sizes(z))
        D = jacobian(sep.to_darboux, y)
        p.same(D @ poisson_tensor(y) @ D.T, CANONICAL, largest(D) ** 2)
        z = p.numbers(4)
        y = sep.from_darboux(z, c1, c2)
        p.same(invariants(p.top, y)[2:], [c1, c2], sizes(y))
        p.same(sep.to_darboux(y), z, sizes(y))
        D = jacobian(lambda z, c1=c1, c2=c2: sep.from_darboux(z, c1, c2), z)
        p.same(D @ CANONICAL @ D.T, poisson_tensor(y), largest(D) ** 2)


@both
def test_generating_relations(digits):
    """(3.14): p = ∂F/∂q, u = −∂F/∂v connect the two charts of one state."""
    for p in points(digits):
        y = p.state()
        _, _, c1, c2 = invariants(p.top, y)
        q, w = sep.to_darboux(y), sep.separate(y)
        momenta, u = sep.generated(q[:2], w[1::2], c1, c2)
        p.same(momenta, q[2:], sizes(w, 1 / w))
        p.same(u, w[::2])


def test_generating_function_has_these_derivatives():
    """(3.13), by numerical differentiation in 50 digits."""
    for p in points(50, 4):
        q, v = p.numbers(2), p.numbers(2)
        c1, c2 = p.number(), p.number()
        momenta, u = sep.generated(q, v, c1, c2)

        def F(*a, c1=c1, c2=c2):
            return sep.generating_function(a[:2], a[2:], c1, c2)

        gradient = [mp.diff(F, (*q, *v), n) for n in np.eye(4, dtype=int).tolist()]
        assert largest(np.array(gradient) - np.concatenate((momenta, -u))) <= mpf("1e-35")
    assert isinstance(sep.generating_function((1.0, 2.0), (0.3, 1j)), complex)


@pytest.mark.parametrize("name", ["figure1", "figure2", "generic", "fast"])
def test_real_tops(name):
    """The paper's two figures have C1 ≠ 1; c1 and c2 default to the paper's 1 and 0."""
    top, y = TOPS[name].top, TOPS[name].state
    H, J3, c1, c2 = invariants(top, y)
    w, z = sep.separate(y), sep.to_darboux(y)
    assert largest(sep.unseparate(w, c1, c2) - y) <= 1e-12 * largest(y)
    assert largest(sep.from_darboux(z, c1, c2) - y) <= 1e-12 * largest(y)
    assert abs(sep.separated_hamiltonian(top, w, c1, c2) - H) <= 1e-12 * abs(H)
    assert invariants(top, sep.unseparate(w))[2] == pytest.approx(1, abs=1e-11)


def test_arrays_of_states():
    Y = np.stack([TOPS[n].state for n in ("figure1", "figure2", "generic")])
    c1, c2 = (np.array(c) for c in invariants(LagrangeTop(), Y)[2:])
    for f, back in ((sep.separate, sep.unseparate), (sep.to_darboux, sep.from_darboux)):
        W = f(Y)
        assert W.shape == (3, 4)
        assert largest(W - np.stack([f(y) for y in Y])) <= 1e-13 * largest(W)
        assert largest(back(W, c1, c2) - Y) <= 1e-12 * largest(Y)
    momenta, u = sep.generated(sep.to_darboux(Y)[:, :2], sep.separate(Y)[:, 1::2], c1, c2)
    assert largest(momenta - sep.to_darboux(Y)[:, 2:]) <= 1e-11
    assert largest(sqrt(c1) ** 2 - c1) <= 1e-12 * largest(c1)


def test_singular_charts_say_so():
    top = LagrangeTop(1.0)
    with pytest.raises(ValueError, match="J- = 0"):
        sep.separate((0.0, 0.0, 1.0, 0.6, 0.0, 0.8))
    with pytest.raises(ValueError, match="x- = 0"):
        sep.separate(((1.0, 0.0, 1.0, 0.6, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0, 0.0, 1.0)))  # one bad state of two
    with pytest.raises(ValueError, match="x- = 0"):
        sep.to_darboux((1.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="C1 = 0"):
        sep.to_darboux((1.0, 0.0, 0.0, 1.0, 1j, 0.0))
    with pytest.raises(ValueError, match="C1 = 0"):
        sep.from_darboux((1.0, 0.5, 0.0, 1.0), c1=0.0)
    for w, message in (((0.0, 1.0, 1.0, 1.0), "u1 = 0"), ((1.0, 1.0, 0.0, 1.0), "u2 = 0")):
        with pytest.raises(ValueError, match=message):
            sep.unseparate(w)
    for q, message in (((0.0, 1.0), "q1"), ((1.0, 0.0), "q2")):
        with pytest.raises(ValueError, match=message):
            sep.generating_function(q, (1.0, 1.0))
        with pytest.raises(ValueError, match=message):
            sep.generated(q, (1.0, 1.0))
    y = np.array((0.5, 0.25, 1.0, 0.5, 0.25, 0.8))  # x- = J-: u1 = −1
    with pytest.raises(ValueError, match="pole of the Baker"):
        sep.baker_akhiezer(top, y, -1.0, 0.3)
