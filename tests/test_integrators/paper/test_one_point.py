"""Section 5.1: the one-point map, its real form, inverse, sheets, gauge and iteration."""

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper.phase_space import invariants, ladder, poisson_tensor, sqrt
from tests.test_integrators.paper.tools import DIGITS, jacobian, largest, points, size

both = pytest.mark.parametrize("digits", DIGITS)
sheets = pytest.mark.parametrize("sheet", [1, -1])


# ------------------------------------------------------------------------------------------- equations of 5.1


@both
@sheets
def test_intertwining_and_spectrality(digits, sheet):
    """(5.1.3), (5.1.4), (5.1.6)–(5.1.10): M L = L̃ M at random u, both forms of q, invariants to round-off."""
    for p in points(digits):
        y, lam, u, top = p.state(), p.number(), 2 * p.number(), p.top
        new = op.one_point(top, y, lam, sheet)
        P, q = op.parameters(top, y, lam, sheet)
        M = op.dressing_matrix(P, q, lam, u)
        p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], u - lam, 1 + abs(P * q))
        left, right = M @ lax.lax_matrix(top, y, u), lax.lax_matrix(top, new, u) @ M
        p.same(left, right, size(new, y, [q]))
        (J3, Jm, _, *_), (J3_new, _, Jp_new, *_) = ladder(y), ladder(new)
        p.same([J3_new, P, q], [J3, Jm / (2 * top.alpha), Jp_new / (2 * top.alpha)])
        mu, (A, B, C) = lax.eigenvalue(top, y, lam, sheet), lax.entries(top, y, lam)
        p.same(mu * mu, A * A + B * C, 10 * (1 + abs(mu) ** 2))
        p.same([q * B, q * (A + mu)], [A - mu, -C], 10 * (1 + abs(q)) * (1 + abs(mu)))
        p.same(invariants(top, new), invariants(top, y), size(new, y))
        p.same(op.one_point(top, y, lam, mu=mu), new, 10 * size(new, y))


@both
@sheets
def test_real_form(digits, sheet):
    """(5.1.11), label 85–90, corrected; the printed J̃2, x̃1, x̃2 miss by order one."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        new = op.one_point(top, y, lam, sheet)
        p.same(op.real_form(top, y, lam, sheet), new, size(new, y))
    printed = op._as_printed(top, y, lam)
    assert all(abs(value - op.one_point(top, y, lam)[place]) > 1e-3 for place, value in printed.items())


@both
def test_quadratic_algebra_of_the_dressing_matrix(digits):
    """(5.1.5) with r of (2.6) holds for {p, q} = −i and not for +i."""
    for p in points(digits):
        P, q, lam, u, v = p.numbers(5)
        dp, dq = np.array(((q, 1), (0, 0))), np.array(((P, 0), (1, 0)))  # of M, for every u
        gradient, r = np.stack((dp, dq)), lax.r_matrix(u - v)
        Mu, Mv = op.dressing_matrix(P, q, lam, u), op.dressing_matrix(P, q, lam, v)
        for bracket, holds in ((-1j, True), (1j, False)):
            tensor = np.array(((0, bracket), (-bracket, 0)))
            defect = lax.quadratic_algebra_defect(lax.matrix_brackets(gradient, tensor, gradient), Mu, Mv, r)
            if holds:
                p.same(defect, np.zeros((4, 4)), largest(r) * largest(Mu) * largest(Mv))
            else:
                assert largest(defect) > 1e-2


@both
@sheets
def test_inverse(digits, sheet):
    """Both ways, at the same (λ, μ); and the adjugate dresses the image back."""
    for p in points(digits):
        y, lam, u, top = p.state(), p.number(), 2 * p.number(), p.top
        new, old = op.one_point(top, y, lam, sheet), op.inverse(top, y, lam, sheet)
        p.same(op.inverse(top, new, lam, sheet), y, size(new) ** 2)
        p.same(op.one_point(top, old, lam, sheet), y, size(old) ** 2)
        P, q = op.parameters(top, op.transpose(y), lam, sheet)[::-1]  # p from the curve, q from J+
        N = op.dressing_matrix(P, q, lam, u)
        adjugate = np.array(((N[1, 1], -N[0, 1]), (-N[1, 0], N[0, 0])))
        p.same(adjugate @ lax.lax_matrix(top, y, u), lax.lax_matrix(top, old, u) @ adjugate, size(old, y, [P]))


@both
@sheets
def test_k_and_its_sign(digits, sheet):
    """(5.2.6): k = x3 − q x- = x̃3 − p x̃+, k² = C1 + λ x- x̃+, and k → sheet · √C1 as λ → 0, where the map is regular."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        new = op.one_point(top, y, lam, sheet)
        k, (P, q) = op.k_value(top, y, lam, sheet), op.parameters(top, y, lam, sheet)
        _, _, _, x3, xm, _ = ladder(y)
        _, _, _, x3_new, _, xp_new = ladder(new)
        _, _, c1, _ = invariants(top, y)
        p.same([k, k], [x3 - q * xm, x3_new - P * xp_new], size(new, y))
        p.same(k * k, c1 + lam * xm * xp_new, size(new, y))
        p.same(op.k_value(top, y, lam, mu=lax.eigenvalue(top, y, lam, sheet)), k, size(new, y))
        p.same(op.k_value(top, y, 0, sheet), sheet * sqrt(c1))
        at_zero, near = op.one_point(top, y, 0, sheet), op.one_point(top, y, p.tol, sheet)
        p.same(at_zero, near, size(at_zero) ** 3 * 100)
        p.same(invariants(top, at_zero), invariants(top, y), size(at_zero))


@pytest.mark.parametrize("name", ["figure1", "figure2", "generic", "inverted"])
def test_real_tops(name):
    """The data of the paper's figures, C1 ≠ 1: invariants to 1e-12, and the image of a real state is not real."""
    top, y = TOPS[name].top, TOPS[name].state
    for lam in (0.3, 0.2 + 0.1j):
        new = op.one_point(top, y, lam)
        scale = np.maximum(top.invariant_scales(y), 1) * max(1, largest(new) / largest(y)) ** 2
        assert largest((np.array(invariants(top, new)) - top.invariants(y)) / scale) <= 1e-12
        assert largest(new.imag) > 0.1


def test_stable_q():
    """One form of q loses all digits where B(λ) → 0, the other is right; on the other sheet it is a pole."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    _, Jm, _, _, xm, _ = ladder(y)
    lam = complex(-xm / Jm)
    mu = lax.eigenvalue(top, y, lam)
    A, B, C = lax.entries(top, y, lam)
    good = 1 if abs(A + mu) > abs(A - mu) else -1
    for nudge in (0.0, 1e-13, 1e-9):
        with mp.workdps(50):
            exact = op.one_point(top, [mpf(v) for v in y], mp.mpc(lam + nudge), good)
        new = op.one_point(top, y, lam + nudge, good)
        assert largest(new - exact.astype(complex)) <= 1e-13
    upright = (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)  # J- = x- = 0: q/p of the paper is 0/0
    assert np.array_equal(op.one_point(top, upright, 0.7), upright)
    with pytest.raises(ValueError, match="to infinity"):
        op.one_point(top, upright, 0.7, -1)
    tilted = np.array((0.0, 0.0, 1.2, 0.48, 0.6, 0.64))  # J- = 0 alone
    new = op.one_point(top, tilted, 0.7j)
    assert largest(np.array(invariants(top, new)) - top.invariants(tilted)) <= 1e-12


# ------------------------------------------------------------------------------------ gauge and iteration


@both
@sheets
def test_rotations_about_e3_commute_with_the_map(digits, sheet):
    for p in points(digits):
        y, lam, d, top = p.state(), p.number(), p.number(), p.top
        new = op.one_point(top, y, lam, sheet)
        p.same(op.one_point(top, op.gauge(y, d), lam, sheet), op.gauge(new, d), size(new) * 10)
        D = jacobian(lambda z, d=d: op.gauge(z, d), y)
        p.same(D @ poisson_tensor(y) @ D.T, poisson_tensor(op.gauge(y, d)), largest(D) ** 2)


def test_near_the_identity_for_large_parameters():
    """On the sheet with v = −iμ → alpha, after the gauge −1/λ: the image tends to the state like 1/λ."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    errors = [largest(op.gauge(op.one_point(top, y, lam), -1 / lam) - y) for lam in (1e3, 1e4, 1e5)]
    assert errors[0] < 0.05
    assert errors[1] / errors[0] == pytest.approx(0.1, rel=0.05)
    assert errors[2] / errors[1] == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("name", ["generic", "figure1", "figure2", "inverted"])
@pytest.mark.parametrize("lam", [0.5, 3.0])
def test_balanced_iteration_keeps_the_invariants(name, lam):
    """2000 iterations: relative to the size of the orbit nothing is lost beyond 2000 round-offs."""
    top, y = TOPS[name].top, TOPS[name].state
    states, exponents = op.orbit(top, y, lam, 2000)
    start, values = np.array(invariants(top, y)), np.array(invariants(top, states)).T
    sizes = np.maximum(top.invariant_scales(y), largest(states) ** 2)
    assert largest((values - start) / sizes) <= 2000 * np.finfo(float).eps
    assert largest(states) < 100 * largest(y)
    assert abs(exponents[-1]) > 50  # the plain iteration would have left double precision, or most of it


def test_plain_iteration_is_lost():
    """The negative control: without the gauge C1 is gone after 60 steps; with it, the orbit is the same."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    plain = y
    for _ in range(60):
        plain = op.one_point(top, plain, 3.0)
    assert abs(invariants(top, plain)[2] - 1) > 0.1
    assert largest(plain) > 1e20
    states, exponents = op.orbit(top, y, 3.0, 5)
    state = y
    for n in range(6):
        assert largest(op.gauge(states[n], 2.0 ** -exponents[n]) - state) <= 1e-12 * largest(state)
        state = op.one_point(top, state, 3.0)
    upright = TOPS["sleeping_stable"].state
    assert np.array_equal(op.orbit(top, upright, 0.7, 3)[0], np.tile(upright, (4, 1)))


def test_balanced_iteration_in_mpmath():
    with mp.workdps(40):
        top, y = TOPS["figure2"].top, [mpf(v) for v in TOPS["figure2"].y0]
        states, _ = op.orbit(top, y, mpf(3), 100)
        assert largest(np.array(invariants(top, states[-1])) - np.array(invariants(top, y))) <= mpf("1e-32")


def test_python_numbers_as_parameters_do_not_cost_digits():
    """alpha = 3.345 and λ = 0.3 + 0.2i are doubles taken as exact: nothing is rounded to double on the way."""
    with mp.workdps(40):
        top, y, lam = TOPS["figure1"].top, [mpf(v) for v in TOPS["figure1"].y0], 0.3 + 0.2j
        for f in (op.one_point, op.real_form, op.inverse):
            new = f(top, y, lam)
            assert largest(np.array(invariants(top, new)) - np.array(invariants(top, y))) <= mpf("1e-34")
            assert largest(new - f(top, y, mp.mpc(lam))) <= mpf("1e-36")
        assert largest(op.inverse(top, op.one_point(top, y, lam), lam) - np.array(y)) <= mpf("1e-34")
        k, (_, q) = op.k_value(top, y, lam), op.parameters(top, y, lam)
        assert abs(k - (y[5] - q * (y[3] - 1j * y[4]))) <= mpf("1e-35")
        mu, v2 = lax.eigenvalue(top, y, lam), lax.spectral_curve(top, y, lam)
        A, B, C = lax.entries(top, y, lam)
        assert largest([mu * mu - v2, A * A + B * C - v2]) <= mpf("1e-33")
        assert largest(op.one_point(top, y, lam, mu=mu) - op.one_point(top, y, lam)) <= mpf("1e-34")


# ---------------------------------------------------------------------------------------- arrays and errors


def test_arrays_of_states():
    Y = np.stack([TOPS[n].state for n in ("figure1", "figure2", "generic")])
    top, lam = LagrangeTop(1.5), 0.3 + 0.4j
    for f in (op.one_point, op.inverse, op.real_form, op.deformation):
        one_by_one = np.stack([f(top, y, lam, -1) for y in Y])
        assert largest(f(top, Y, lam, -1) - one_by_one) <= 1e-13 * largest(one_by_one)
    assert op.sheet_exchange(top, Y).shape == op.gauge(Y, 2.0).shape == (3, 6)
    assert op.k_value(top, Y, lam).shape == (3,)


def test_bad_input():
    y = TOPS["generic"].state
    for f in (op.one_point, op.inverse, op.real_form, op.parameters, op.k_value):
        with pytest.raises(ValueError, match="alpha = 0: the one-point map does not exist"):
            f(LagrangeTop(0.0), y, 0.3)
        with pytest.raises(ValueError, match="C1 = 0"):
            f(LagrangeTop(1.0), (1.0, 2.0, 3.0, 0.0, 0.0, 0.0), 0.3)
        with pytest.raises(ValueError, match="sheet must be 1 or -1"):
            f(LagrangeTop(1.0), y, 0.3, 0)
    with pytest.raises(ValueError, match="alpha = 0"):
        op.sheet_exchange(LagrangeTop(0.0), y)
