"""The top: equations, brackets, invariants, named states, SI units; in rational numbers where an identity is exact."""

import math

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, HeavyTop, LagrangeTop, integrate

DRAW = np.random.default_rng(1)
STATES = [DRAW.normal(size=6) for _ in range(20)]
EPS = np.finfo(float).eps


@pytest.fixture(params=[1.0, -2.5, 0.0, 3.345])
def top(request):
    return LagrangeTop(request.param)


# ---------------------------------------------------------------- equations


def test_the_equations_are_the_papers(top):
    """J' = alpha e3 × x, x' = J × x (1.1)."""
    for y in STATES:
        expected = np.concatenate((top.alpha * np.cross((0, 0, 1), y[3:]), np.cross(y[:3], y[3:])))
        assert np.allclose(top.rhs(y), expected, rtol=0, atol=8 * EPS * (1 + y @ y))
    assert np.array_equal(top.rhs(np.array(STATES)), [top.rhs(y) for y in STATES])


def test_jacobian_is_the_derivative_of_the_right_hand_side(top):
    """f is quadratic: central differences have no truncation error, only rounding over their step of 1."""
    for y in STATES:
        D = np.column_stack([(top.rhs(y + e) - top.rhs(y - e)) / 2 for e in np.eye(6)])
        assert np.allclose(top.jacobian(y), D, rtol=0, atol=32 * EPS * (1 + y @ y))


def test_gradients_are_the_derivatives_of_the_invariants(top):
    """All four are quadratic, too."""
    for y in STATES:
        D = np.column_stack([(top.invariants(y + e) - top.invariants(y - e)) / 2 for e in np.eye(6)])
        assert np.allclose(top.gradients(y), D, rtol=0, atol=32 * EPS * (1 + y @ y + abs(top.alpha)))


# ---------------------------------------------------------------- Poisson structure


def test_the_bracket_of_e3(top):
    """{J1,J2} = J3, {J1,x2} = x3, {x1,x2} = 0 and cyclic; antisymmetric."""
    for y in STATES:
        P = top.poisson(y)
        assert np.array_equal(P, -P.T)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            assert P[i, j] == y[k]
            assert P[i, 3 + j] == P[3 + i, j] == y[3 + k]
        assert not np.any(P[3:, 3:])


def test_jacobi_identity(top):
    """P is linear in y, P(y) = Σ y_l C_l: Σ P_il ∂_l P_jk over cyclic (i, j, k) vanishes in whole numbers."""
    C = np.stack([top.poisson(e) for e in np.eye(6)])  # structure constants, C[l, j, k] = ∂_l P_jk
    y = np.array((2.0, 3.0, 5.0, 7.0, 11.0, 13.0))
    T = np.einsum("il,ljk->ijk", top.poisson(y), C)
    assert not np.any(T + T.transpose(1, 2, 0) + T.transpose(2, 0, 1))


def test_flow_and_casimirs(top):
    """f = P∇H; P∇C1 = P∇C2 = 0; {H, J3} = 0."""
    for y in STATES:
        H, J3, C1, C2 = top.gradients(y)
        P = top.poisson(y)
        scale = 16 * EPS * (1 + y @ y) * (1 + abs(top.alpha))
        assert np.allclose(P @ H, top.rhs(y), rtol=0, atol=scale)
        assert np.allclose(P @ C1, 0, rtol=0, atol=scale)
        assert np.allclose(P @ C2, 0, rtol=0, atol=scale)
        assert abs(H @ P @ J3) <= scale


def test_invariants_are_constant_along_the_flow(top):
    for y in STATES:
        assert np.allclose(
            top.gradients(y) @ top.rhs(y), 0, rtol=0, atol=32 * EPS * (1 + y @ y) ** 2 * (1 + abs(top.alpha))
        )


# ---------------------------------------------------------------- scales


def test_scales_have_the_right_units():
    """y = (J, x) in units of length L and rate R: alpha has R²/L, time 1/R. Powers of two: exact."""
    top, y = TOPS["figure1"].top, TOPS["figure1"].state
    L, R = 8.0, 1 / 64
    other = LagrangeTop(top.alpha * R * R / L)
    z = np.concatenate((R * y[:3], L * y[3:]))
    rate, size, time = top.scales(y)
    assert other.scales(z) == pytest.approx((R * rate, L * size, time / R), rel=2 * EPS)
    assert np.allclose(other.invariant_scales(z), top.invariant_scales(y) * (R * R, R, L * L, L * R), rtol=4 * EPS)
    assert np.array_equal(other.invariants(z), top.invariants(y) * (R * R, R, L * L, L * R))


def test_scales_of_the_invariants():
    """|J|²/2 + |alpha||x| for H; the others by the scales of J and x."""
    top, y = LagrangeTop(-2.0), (0.0, 3.0, 4.0, 0.0, 2.0, 0.0)
    assert top.invariant_scales(y) == pytest.approx((12.5 + 4.0, 7.0, 4.0, 14.0))


def test_scales_of_a_top_without_any():
    assert LagrangeTop(0.0).scales((0, 0, 0, 0, 0, 2.0)) == (0.0, 2.0, math.inf)


@pytest.mark.parametrize("size", [1e-160, 1e-300, 1e160, 1e300])
def test_scales_neither_overflow_nor_underflow(size):
    rate, length, time = LagrangeTop(1.0).scales(size * TOPS["generic"].state)
    assert length == pytest.approx(size)
    assert 0 < rate < math.inf
    assert time * rate == pytest.approx(1)


# ---------------------------------------------------------------- a real top, by hand


def test_real_top_against_a_hand_calculation():
    """Tilted by 30° towards +x1 (phi = 0), turning at known rates: every number by trigonometry on paper.

    axis = (½, 0, √3/2). ω = theta' (0,1,0) + phi' (0,0,1) + psi' axis = (1, 0.5, 3 + √3) for theta' = 0.5, phi' = 3, psi' = 2.
    Its part along the axis is psi' + phi' cos 30° = 2 + 3√3/2, and M = A ω + (C − A)(ω·axis) axis.
    """
    m, l, g, A, C = 2.0, 0.25, 10.0, 0.5, 0.25
    heavy = HeavyTop(mass=m, distance=l, gravity=g, A=A, C=C)
    top, y = heavy.top, heavy.state(angles=(math.pi / 6, 0.0, 1.0), rates=(0.5, 3.0, 2.0))
    assert top.alpha == m * g * l / A == 10.0
    axis = np.array((0.5, 0.0, math.sqrt(3) / 2))
    omega = np.array((1.0, 0.5, 3 + math.sqrt(3)))
    spin = 2 + 1.5 * math.sqrt(3)
    M = A * omega + (C - A) * spin * axis
    assert np.allclose(y, np.concatenate((M / A, axis)), rtol=0, atol=8 * EPS)

    # ω from J as in `HeavyTop`, and the energy of a real top from H
    J, x = y[:3], y[3:]
    assert np.allclose(J + (A / C - 1) * (x @ J) * x, omega, rtol=0, atol=16 * EPS)
    energy = 0.5 * (A * (omega @ omega - spin**2) + C * spin**2) + m * g * l * math.cos(math.pi / 6)
    H, _, _, C2 = top.invariants(y)
    assert pytest.approx(energy, rel=8 * EPS) == A * H + A * A * C2**2 * (1 / C - 1 / A) / 2


def test_real_top_turns_with_the_precession():
    """phi turns the whole state about e3, psi does not enter."""

    def state(phi, psi):
        heavy = HeavyTop(mass=1.0, distance=0.1, gravity=9.81, A=1e-2, C=5e-3)
        return heavy.state(angles=(0.7, phi, psi), rates=(0.1, 0.2, 30.0))

    y = state(0.0, 0.0)
    c, s = math.cos(1.3), math.sin(1.3)
    turn = np.kron(np.eye(2), ((c, -s, 0), (s, c, 0), (0, 0, 1)))
    assert np.allclose(state(1.3, 2.0), turn @ y, rtol=0, atol=64 * EPS)
    assert math.hypot(*y[3:]) == pytest.approx(1, abs=4 * EPS)


def test_what_is_not_a_state_or_a_top_is_told(top):
    for y in (np.ones((2, 5)), np.ones((6, 2)), 1.0):
        for function in (top.invariants, top.rhs):
            with pytest.raises(ValueError, match=r"y must be states .* shape \(\.\.\., 6\); got shape"):
                function(y)
    with pytest.raises(KeyError, match="unknown top 'genric'; did you mean 'generic'"):
        TOPS["genric"]
    assert TOPS.get("genric") is None
    named = TOPS["generic"]
    with pytest.raises(ValueError, match=r"pass named\.top, named\.state"):
        integrate(named, named.y0, 0.1, 10)
