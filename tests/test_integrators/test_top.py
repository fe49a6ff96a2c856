"""The top: derivatives, scales, SI units. Its equations and bracket are those of the paper, in `paper/test_lax`."""

import math

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, HeavyTop, LagrangeTop, integrate

DRAW = np.random.default_rng(1)
STATES = [DRAW.normal(size=6) for _ in range(5)]
EPS = np.finfo(float).eps


@pytest.fixture(params=[1.0, -2.5, 0.0, 3.345])
def top(request):
    return LagrangeTop(request.param)


@pytest.mark.parametrize(("function", "derivative"), [("rhs", "jacobian"), ("invariants", "gradients")])
def test_derivatives(top, function, derivative):
    """Of quadratic functions: central differences have no truncation error, only rounding over their step of 1."""
    f = getattr(top, function)
    assert np.array_equal(f(np.array(STATES)), [f(y) for y in STATES])
    for y in STATES:
        D = np.column_stack([(f(y + e) - f(y - e)) / 2 for e in np.eye(6)])
        assert np.allclose(getattr(top, derivative)(y), D, rtol=0, atol=32 * EPS * (1 + y @ y + abs(top.alpha)))


def test_jacobi_identity(top):
    """P is linear in y, P(y) = Σ y_l C_l: Σ P_il ∂_l P_jk over cyclic (i, j, k) vanishes in whole numbers."""
    C = np.stack([top.poisson(e) for e in np.eye(6)])  # structure constants, C[l, j, k] = ∂_l P_jk
    y = np.array((2.0, 3.0, 5.0, 7.0, 11.0, 13.0))
    T = np.einsum("il,ljk->ijk", top.poisson(y), C)
    assert not np.any(T + T.transpose(1, 2, 0) + T.transpose(2, 0, 1))


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
