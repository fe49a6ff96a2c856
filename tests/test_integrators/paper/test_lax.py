"""Sections 1 and 2: brackets, Lax matrices, r-matrix algebra, spectral curve and its sheets, the Lax equation."""

import numpy as np
import pytest
from mpmath import mp, mpc

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.phase_space import (
    cartesian,
    invariants,
    ladder,
    poisson_tensor,
    vector_field,
)
from tests.test_integrators.paper.tools import DIGITS, jacobian, largest, points

both = pytest.mark.parametrize("digits", DIGITS)
FIGURES = ("figure1", "figure2", "generic", "inverted")


# ---------------------------------------------------------------------------------------------- section 1


@pytest.mark.parametrize("name", FIGURES)
def test_complex_formulas_agree_with_the_top(name):
    top, y = TOPS[name].top, TOPS[name].state
    assert np.array_equal(vector_field(top, y), top.rhs(y))
    assert np.array_equal(np.array(invariants(top, y)), top.invariants(y))
    assert np.array_equal(poisson_tensor(y), top.poisson(y))


@both
def test_ladder_brackets(digits):
    """(1.3), (1.4): all brackets of J3, J±, x3, x±."""
    for p in points(digits):
        y = p.state()
        J3, Jm, Jp, x3, xm, xp = ladder(y)
        p.same(cartesian(*ladder(y)), y)
        D = jacobian(lambda z: np.array(ladder(z)), y)
        table = {
            (0, 2): -1j * Jp, (0, 1): 1j * Jm, (2, 1): -2j * J3,
            (0, 5): -1j * xp, (0, 4): 1j * xm, (3, 2): -1j * xp, (3, 1): 1j * xm,
            (2, 4): -2j * x3, (5, 1): -2j * x3,
        }  # fmt: skip
        expected = np.zeros((6, 6), dtype=complex).astype(y.dtype)
        for (a, b), value in table.items():
            expected[a, b], expected[b, a] = value, -value
        p.same(D @ poisson_tensor(y) @ D.T, expected)


@both
def test_casimirs_integrals_and_the_flow(digits):
    """(1.1) is {y, H}; (1.5) C1, C2 are central; (1.7) {H, J3} = 0; (1.8) H in J±."""
    for p in points(digits):
        y, top = p.state(), p.top
        gradient = jacobian(lambda z, top=top: np.array(invariants(top, z)), y)
        flows = poisson_tensor(y) @ gradient.T
        p.same(flows[:, 0], vector_field(top, y))
        p.same(flows[:, 2:], np.zeros((6, 2)))
        p.same(gradient[1] @ flows[:, 0], 0)
        J3, Jm, Jp, x3, _, _ = ladder(y)
        p.same(invariants(top, y)[0], (Jp * Jm + J3 * J3) / 2 + top.alpha * x3)


@both
def test_spin_brackets(digits):
    """(2.3) between and within sites; (2.4) the spins are central."""
    for p in points(digits):
        s = [p.numbers(3) for _ in range(3)]

        def plus_minus(z):
            return np.array([f for j in (0, 3, 6) for f in (z[j + 2], z[j] + 1j * z[j + 1], z[j] - 1j * z[j + 1])])

        D = jacobian(plus_minus, np.concatenate(s))
        B = D @ poisson_tensor(*s) @ D.T
        values = plus_minus(np.concatenate(s))
        for j in range(9):
            for k in range(9):
                if j // 3 != k // 3:
                    assert B[j, k] == 0
        for j in (0, 3, 6):
            p.same([B[j, j + 1], B[j, j + 2]], [-1j * values[j + 1], 1j * values[j + 2]])
            p.same(B[j + 1, j + 2], -2j * values[j])
            p.same(values[j] ** 2 + values[j + 1] * values[j + 2], s[j // 3] @ s[j // 3])
        spin = jacobian(
            lambda z: np.array([z[j] * z[j] + z[j + 1] ** 2 + z[j + 2] ** 2 for j in (0, 3, 6)]), np.concatenate(s)
        )
        p.same(spin @ poisson_tensor(*s), np.zeros((3, 9)))


# ------------------------------------------------------------------------------------- r-matrix, both normalisations


@both
@pytest.mark.parametrize("n", [1, 2, 4])
def test_gaudin_r_matrix_algebra(digits, n):
    """(2.5), (2.6), and element by element (2.7)–(2.10). The other sign or normalisation of r fails."""
    for p in points(digits, 4):
        alpha, sites, spins, u, v = (
            p.number(),
            p.numbers(n),
            np.array([p.numbers(3) for _ in range(n)]),
            p.number(),
            p.number(),
        )
        brackets = lax.matrix_brackets(
            lax.gaudin_gradient(sites, u), poisson_tensor(*spins), lax.gaudin_gradient(sites, v)
        )
        Lu, Lv = lax.gaudin_matrix(alpha, sites, spins, u), lax.gaudin_matrix(alpha, sites, spins, v)

        def defect(factor, args=(brackets, Lu, Lv, u - v)):
            return lax.linear_algebra_defect(*args[:3], lax.r_matrix(args[3], factor))

        p.same(defect(lax.FACTOR_GAUDIN), np.zeros((4, 4)), largest(brackets) + largest(Lu) + largest(Lv))
        assert largest(defect(-lax.FACTOR_GAUDIN)) > 1e-3 * largest(brackets)
        assert largest(defect(lax.FACTOR_TOP)) > 1e-3 * largest(brackets)
        check_elements(p, brackets, Lu, Lv, 1j / (u - v))


@both
def test_the_top_needs_r_without_the_i(digits):
    """L = i L_G of (2.21) obeys (2.5) with −P/(u − v); r = iP/(u − v), as the paper has it, fails."""
    for p in points(digits):
        y, u, v = p.state(), p.number(), p.number()
        brackets = lax.matrix_brackets(lax.lax_gradient(u), poisson_tensor(y), lax.lax_gradient(v))
        Lu, Lv = lax.lax_matrix(p.top, y, u), lax.lax_matrix(p.top, y, v)
        p.same(lax.linear_algebra_defect(brackets, Lu, Lv, lax.r_matrix(u - v, lax.FACTOR_TOP)), np.zeros((4, 4)), 100)
        assert largest(lax.linear_algebra_defect(brackets, Lu, Lv, lax.r_matrix(u - v))) > 1e-2
        check_elements(p, brackets, Lu, Lv, -1 / (u - v))
        p.same(lax.linear_algebra_defect(-brackets, Lu / 1j, Lv / 1j, lax.r_matrix(u - v)), np.zeros((4, 4)), 100)


def check_elements(p, brackets, Lu, Lv, f):
    """(2.7)–(2.10) with i/(u − v) → f. The bracket of elements ij and kl is [2i + k, 2j + l]."""
    a, b, c = (0, 0), (0, 1), (1, 0)

    def of(left, right):
        return brackets[2 * left[0] + right[0], 2 * left[1] + right[1]]

    scale = 1 + largest(brackets)
    p.same([of(a, a), of(b, b), of(c, c)], [0, 0, 0])
    p.same(of(a, b), f * (Lv[b] - Lu[b]), scale)
    p.same(of(a, c), f * (Lu[c] - Lv[c]), scale)
    p.same(of(c, b), 2 * f * (Lu[a] - Lv[a]), scale)


@both
def test_two_sites_become_the_top(digits):
    """(2.15), (2.16) in su(2); (2.18), (2.20) exactly at finite ε; the remainder is ε x/u³ + O(ε²), not O(ε²)."""
    for p in points(digits):
        y, u, eps = p.state(), p.number(), p.number() / 8
        J, x, alpha = y[:3], y[3:], p.top.alpha
        spins = np.array([J - x / eps, x / eps])
        L = 1j * lax.gaudin_matrix(alpha, np.array([0 * eps, eps]), spins, u)
        exact = 1j * (alpha * lax.PAULI[2] + lax.pauli(J) / u + lax.pauli(x) / (u * (u - eps)))
        p.same(L, exact, 100)
        rest = L - lax.lax_matrix(p.top, y, u)
        p.same(rest, 1j * lax.pauli(x) * (eps / (u * u * (u - eps))), 100)
        # {s1 + s2, s1 + s2} = J, {J, ε s2} = x, {ε s2, ε s2} = ε x
        mix = np.kron(np.array([[1, 1], [0, 1]]), np.eye(3, dtype=int)) * np.repeat(np.array([1, eps]), 3)[:, None]
        tensor = mix @ poisson_tensor(*spins) @ mix.T
        expected = poisson_tensor(y)
        expected[3:, 3:] = expected[3:, :3] * eps
        p.same(tensor, expected, 100)


def test_L_is_in_su2_for_real_data():
    """(2.15), (2.16), (2.17): i L_G is anti-Hermitian and traceless for real sites, spins and u."""
    rng = np.random.default_rng(1)
    L = 1j * lax.gaudin_matrix(0.7, (0.0, 0.4), rng.normal(size=(5, 2, 3)), 1.3)
    assert L.shape == (5, 2, 2)
    assert np.array_equal(L, -np.conj(np.swapaxes(L, -1, -2)))
    assert np.array_equal(np.trace(L, axis1=-2, axis2=-1), np.zeros(5))


# ----------------------------------------------------------------------------------------- curve and sheets


@both
def test_spectral_curve(digits):
    """(2.22) corrected: det(L(u) − v) = 0. With the printed 2 J3/u it is not."""
    for p in points(digits):
        y, u, top = p.state(), p.number(), p.top
        L, square = lax.lax_matrix(top, y, u), lax.spectral_curve(top, y, u)
        p.same(-(L[0, 0] * L[1, 1] - L[0, 1] * L[1, 0]), square, 10)
        for sheet in (1, -1):
            M = L - lax.eigenvalue(top, y, u, sheet) * np.eye(2, dtype=int)
            p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], 0, 10 * (1 + abs(square)))
        slip = 2 * (top.alpha - 1) * y[2] / u
        assert top.alpha == 1 or abs(slip) > 1e-2


@both
def test_root_follows_the_segment(digits):
    """m is what continuation of √Q from √C1 along 0 → λ in small steps gives."""
    for p in points(digits, 5):
        y, lam = p.state(), 3 * p.number()
        q = [complex(c) for c in lax.spectral_polynomial(p.top, y)]
        m = np.sqrt(q[0])
        for t in np.linspace(0, 1, 4001)[1:]:
            new = np.sqrt(np.polyval(q[::-1], t * complex(lam)))
            m = new if abs(new - m) < abs(new + m) else -new
        value = lax.root(p.top, y, lam)
        assert abs(complex(value) - m) <= 1e-10 * abs(m)
        p.same(value * value, -(lam**4) * lax.spectral_curve(p.top, y, lam), 100 * (1 + abs(value) ** 2))


@pytest.mark.parametrize("name", TOPS)
def test_root_on_every_named_top(name):
    """Q > 0 on the real axis and m > 0 there; conjugate λ have conjugate m; also at double roots and alpha = 0."""
    top, y = TOPS[name].top, TOPS[name].state
    for lam in (0.0, 0.37, -1.9):
        m = lax.root(top, y, lam)
        assert m.real >= 0
        assert abs(m.imag) <= 1e-7 * (1 + abs(m))
    m = lax.root(top, y, 0.3 + 0.8j)
    assert abs(np.conj(m) - lax.root(top, y, 0.3 - 0.8j)) <= 1e-14 * abs(m)


def test_sheets_agree_between_double_mpmath_and_arrays():
    rng = np.random.default_rng(2)
    Y = rng.normal(size=(7, 6)) + 1j * rng.normal(size=(7, 6))
    top, lam = LagrangeTop(1.5), 0.9 - 1.7j
    mu = lax.eigenvalue(top, Y, lam, -1)
    assert mu.shape == (7,)
    with mp.workdps(30):
        for y, value in zip(Y, mu, strict=True):
            assert abs(lax.eigenvalue(top, y, lam, -1) - value) <= 1e-13 * abs(value)
            exact = lax.eigenvalue(top, [mpc(v) for v in y], mpc(lam), -1)
            assert abs(complex(exact) - value) <= 1e-12 * abs(value)


# ---------------------------------------------------------------------------------------------- Lax equation


@both
def test_lax_equation_of_the_flow(digits):
    """L' = [(i/2u) σ·x, L] = [−(i/2)(alpha u σ3 + σ·J), L] is the motion (1.1), that is {L, H}; section 5.6."""
    for p in points(digits):
        y, u, top = p.state(), p.number(), p.top
        moved = np.einsum("aij,a->ij", lax.lax_gradient(u), vector_field(top, y))
        p.same(lax.lax_rate(top, y, u), moved, 10)
        L, N = lax.lax_matrix(top, y, u), -0.5j * (top.alpha * u * lax.PAULI[2] + lax.pauli(y[:3]))
        p.same(N @ L - L @ N, moved, 10)
        J3, Jm, Jp, x3, xm, xp = ladder(y)
        printed = lax.matrix(
            (Jm * xp - Jp * xm) / (2 * u * u),
            (J3 * xm - Jm * x3) / (u * u) + top.alpha * xm / u,
            (Jp * x3 - J3 * xp) / (u * u) - top.alpha * xp / u,
        )
        p.same(printed, moved, 10)


def test_arrays_of_states():
    Y = np.stack([TOPS[n].state for n in FIGURES])
    top = LagrangeTop(1.5)
    for f in (lax.lax_matrix, lax.lax_rate):
        assert np.array_equal(f(top, Y, 0.3j), np.stack([f(top, y, 0.3j) for y in Y]))


def test_bad_input():
    top, y = TOPS["generic"].top, TOPS["generic"].state
    with pytest.raises(ValueError, match="pole at u = 0"):
        lax.lax_matrix(top, y, 0.0)
    with pytest.raises(ValueError, match="pole of μ"):
        lax.eigenvalue(top, y, 0)
    with pytest.raises(ValueError, match="sheet must be 1 or -1"):
        lax.eigenvalue(top, y, 1j, 2)
    with pytest.raises(ValueError, match="C1 = 0"):
        lax.eigenvalue(top, (1, 2, 3, 1, 1j, 0), 1j)
    with pytest.raises(ValueError, match="on a site"):
        lax.gaudin_matrix(1.0, (0.0, 0.5), np.ones((2, 3)), 0.5)
