"""The three kinds of problem that a file each defines: closed forms, known cases, and what is conserved."""

import numpy as np
import pytest

from lagrange_bench.integrators import LagrangeTop, free_body, integrate, kirchhoff_body, vibrating_pivot
from lagrange_bench.integrators.problem import free_body as euler


@pytest.mark.parametrize(
    "moments", [(1.0, 2.0, 3.0), (3.0, 1.0, 2.0), (2.0, 3.0, 1.0), (3.0, 2.0, 1.0), (1.3, 1.1, 1.2)]
)
def test_the_closed_form_of_the_free_body_is_its_motion(moments):
    """In all orders of the axes and on both sides of the separatrix, and off by more for another body."""
    body = free_body(*moments)
    for y0 in np.random.default_rng(2).normal(size=(8, 3)):
        found = integrate(body, y0, h=1.5, steps=4, method="taylor", every=1)
        truth = euler.solution(body, y0, found.t)
        assert np.max(np.abs(found.y - truth)) < 1e-13
        assert np.max(np.abs(euler.solution(free_body(1.0, 1.5, 4.0), y0, found.t) - truth)) > 1e-3
    backwards = integrate(body, y0, h=-1.5, steps=1, method="taylor").y[-1]
    assert np.max(np.abs(euler.solution(body, y0, [-1.5]) - backwards)) < 1e-13
    with pytest.raises(ValueError, match="three different moments"):
        euler.solution(free_body(1.0, 1.0, 2.0), y0, [1.0])
    with pytest.raises(ValueError, match="moments of inertia must be positive"):
        free_body(1.0, -1.0, 2.0)


def test_a_symmetric_free_body_is_one_exact_flow():
    """|J|² does nothing, J3² turns: one part, whose flow has no error for any step."""
    body, y0 = free_body(2.0, 2.0, 5.0), np.array((0.3, -0.4, 1.2))
    found = integrate(body, y0, h=50.0, steps=1, method="strang").y[-1]
    angle = 50.0 * y0[2] * (1 / 2 - 1 / 5)
    turned = np.array(((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))) @ y0[:2]
    assert np.max(np.abs(found - (*turned, y0[2]))) < 1e-14


def test_a_pivot_that_does_not_vibrate_is_a_lagrange_top():
    y0 = np.array((0.3, -0.4, 1.2, 0.48, 0.6, 0.64))
    for method in ("verner9_fixed", "blanes_moan6", "taylor"):
        at_rest = integrate(vibrating_pivot(1.0, 0.0, 3.0), y0, h=0.1, steps=20, method=method).y[-1]
        top = integrate(LagrangeTop(1.0), y0, h=0.1, steps=20, method=method).y[-1]
        assert np.max(np.abs(at_rest - top)) < 1e-14


def test_vibration_holds_a_top_upright():
    """Kapitza: a slowly turning top falls, and does not on a pivot that vibrates fast; J3 stays to the last bit."""
    y0 = np.array((0.01, 0.0, 0.2, 0.0, 0.0, 1.0))
    lowest = []
    for strength in (0.0, 200.0):
        path = integrate(
            vibrating_pivot(1.0, strength, 60.0), y0, h=2.0**-9, steps=2**14, method="blanes_moan4", every=8
        )
        lowest.append(path.y[:, 5].min())
        assert np.all(path.y[:, 2] == 0.2)
    assert lowest[0] < -0.9
    assert lowest[1] > 0.9


def test_a_round_body_in_a_fluid_keeps_its_spin():
    y0 = np.random.default_rng(4).normal(size=6)
    a, b, c = (1.0, 1.0, 0.5), (0.1, 0.1, -0.2), (0.6, 0.6, 0.9)
    path = integrate(kirchhoff_body(a, b, c), y0, h=0.1, steps=50, method="gauss8", every=1)
    assert path.top.names == ("H", "C1", "C2", "J3")
    assert np.max(np.abs(path.invariants() - path.invariants()[0])) < 1e-13
    other = integrate(kirchhoff_body((1.0, 1.1, 0.5), b, c), y0, h=0.1, steps=50, method="gauss8", every=1)
    assert np.max(np.abs(other.y[:, 2] - y0[2])) > 1e-3
    with pytest.raises(ValueError, match="three numbers each"):
        kirchhoff_body((1.0, 2.0), b, c)
