"""Section 5.1: the one-point map, its Lax equation, sheets, deformation in λ and iteration."""

import numpy as np
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper.interpolating_flow import limit_rate
from lagrange_bench.integrators.paper.phase_space import invariants, ladder, poisson_tensor, sqrt
from tests.test_integrators.paper.tools import jacobian, largest, size


def test_intertwining_and_spectrality(p):
    """(5.1.3), (5.1.4), (5.1.6)–(5.1.10): M L = L̃ M at random u, both forms of q, a given μ."""
    y, lam, u, top = p.y, p.lam, p.u, p.top
    new = op.one_point(top, y, lam, p.sheet)
    P, q = op.parameters(top, y, lam, p.sheet)
    M = op.dressing_matrix(P, q, lam, u)
    p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], u - lam, 1 + abs(P * q))
    p.same(M @ lax.lax_matrix(top, y, u), lax.lax_matrix(top, new, u) @ M, size(new, y, [q]))
    (J3, Jm, _, *_), (J3_new, _, Jp_new, *_) = ladder(y), ladder(new)
    p.same([J3_new, P, q], [J3, Jm / (2 * top.alpha), Jp_new / (2 * top.alpha)])
    mu, (A, B, C) = lax.eigenvalue(top, y, lam, p.sheet), lax.entries(top, y, lam)
    p.same(mu * mu, A * A + B * C, 10 * (1 + abs(mu) ** 2))
    p.same([q * B, q * (A + mu)], [A - mu, -C], 10 * (1 + abs(q)) * (1 + abs(mu)))
    p.same(op.one_point(top, y, lam, mu=mu), new, 10 * size(new, y))


def test_quadratic_algebra_of_the_dressing_matrix(p):
    """(5.1.5) with r of (2.6) holds for {p, q} = −i and not for +i."""
    P, q, lam, u, v = p.numbers(5)
    gradient, r = np.array((((q, 1), (0, 0)), ((P, 0), (1, 0)))), lax.r_matrix(u - v)  # of M by p and q, for every u
    Mu, Mv = op.dressing_matrix(P, q, lam, u), op.dressing_matrix(P, q, lam, v)

    def defect(bracket):
        brackets = lax.matrix_brackets(gradient, np.array(((0, bracket), (-bracket, 0))), gradient)
        return lax.quadratic_algebra_defect(brackets, Mu, Mv, r)

    p.same(defect(-1j), np.zeros((4, 4)), largest(r) * largest(Mu) * largest(Mv))
    assert largest(defect(1j)) > 1e-2


def test_k_and_its_sign(p):
    """(5.2.6): k = x3 − q x- = x̃3 − p x̃+, k² = C1 + λ x- x̃+, and k → sheet · √C1 as λ → 0, where the map is regular."""
    y, lam, top, sheet = p.y, p.lam, p.top, p.sheet
    new = op.one_point(top, y, lam, sheet)
    k, (P, q) = op.k_value(top, y, lam, sheet), op.parameters(top, y, lam, sheet)
    (*_, x3, xm, _), (*_, x3_new, _, xp_new), c1 = ladder(y), ladder(new), invariants(top, y)[2]
    p.same([k, k], [x3 - q * xm, x3_new - P * xp_new], size(new, y))
    p.same(k * k, c1 + lam * xm * xp_new, size(new, y))
    p.same(op.k_value(top, y, lam, mu=lax.eigenvalue(top, y, lam, sheet)), k, size(new, y))
    p.same(op.k_value(top, y, 0, sheet), sheet * sqrt(c1))
    at_zero, near = op.one_point(top, y, 0, sheet), op.one_point(top, y, p.tol, sheet)
    p.same(at_zero, near, size(at_zero) ** 3 * 100)
    p.same(invariants(top, at_zero), invariants(top, y), size(at_zero))


def test_the_two_sheets_do_not_undo_each_other(p):
    """Section 5.5 has B_(λ,−μ) as the inverse of B_(λ,μ). Their product is T, independent of λ, not the identity."""
    T = op.sheet_exchange(p.top, p.y)
    for lam in (p.lam, p.nu):
        middle = op.one_point(p.top, p.y, lam)
        p.same(op.one_point(p.top, middle, lam, -1), T, size(middle, T) ** 3)
        p.same(op.one_point(p.top, middle, lam, mu=-lax.eigenvalue(p.top, p.y, lam)), T, size(middle, T) ** 3)
    assert largest(T - p.y) > 1e-2


def test_deformation(p):
    """∂z̃/∂λ = {−μ(λ), z̃}."""
    y, lam, top = p.y, p.lam, p.top
    slope = jacobian(lambda z: op.one_point(top, y, z[0], p.sheet), np.array([lam]))[:, 0]
    new = op.one_point(top, y, lam, p.sheet)
    p.same(-1j * limit_rate(top, new, lam, p.sheet), slope, size(new) ** 3)
    mu_gradient = jacobian(lambda z: np.array([lax.eigenvalue(top, z, lam, p.sheet)]), new)[0]
    p.same(poisson_tensor(new) @ mu_gradient, slope, size(new) ** 3)  # {z, μ}


def test_stable_q():
    """One form of q loses all digits where B(λ) → 0, the other is right."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    _, Jm, _, _, xm, _ = ladder(y)
    lam = complex(-xm / Jm)
    mu, (A, _, _) = lax.eigenvalue(top, y, lam), lax.entries(top, y, lam)
    good = 1 if abs(A + mu) > abs(A - mu) else -1
    assert largest(op.one_point(top, y, 0.2 + 0.1j).imag) > 0.1  # the image of a real state is not real
    for nudge in (0.0, 1e-13, 1e-9):
        with mp.workdps(50):
            exact = op.one_point(top, [mpf(v) for v in y], mp.mpc(lam + nudge), good)
        assert largest(op.one_point(top, y, lam + nudge, good) - exact.astype(complex)) <= 1e-13
    upright = (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)  # J- = x- = 0: q/p of the paper is 0/0
    assert np.array_equal(op.one_point(top, upright, 0.7), upright)
    tilted = np.array((0.0, 0.0, 1.2, 0.48, 0.6, 0.64))  # J- = 0 alone
    assert largest(np.array(invariants(top, op.one_point(top, tilted, 0.7j))) - top.invariants(tilted)) <= 1e-12


def test_balanced_iteration_keeps_the_invariants():
    """Relative to the size of the orbit nothing is lost beyond one round-off a step. The plain iteration is lost."""
    top, y, steps = TOPS["generic"].top, TOPS["generic"].state, 500
    states, exponents = op.orbit(top, y, 3.0, steps)
    start, values = np.array(invariants(top, y)), np.array(invariants(top, states)).T
    sizes = np.maximum(top.invariant_scales(y), largest(states) ** 2)
    assert largest((values - start) / sizes) <= steps * np.finfo(float).eps
    assert largest(states) < 100 * largest(y)
    assert abs(exponents[-1]) > 50
    plain = [y]
    for _ in range(60):
        plain.append(op.one_point(top, plain[-1], 3.0))
    assert abs(invariants(top, plain[-1])[2] - start[2]) > 0.1
    for n in range(6):
        assert largest(op.gauge(states[n], 2.0 ** -exponents[n]) - plain[n]) <= 1e-12 * largest(plain[n])
