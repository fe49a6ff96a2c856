"""No field and no Hamiltonian is taken to be more symmetric than it is, and plain symmetries are seen."""

import math
import random

import numpy as np
import pytest

from lagrange_bench import METHODS, POTENTIALS, LagrangeTop, PerturbedTop, Potential, Problem, RigidBody
from lagrange_bench.integrators import cos, exp, log, sin, sqrt

TOP = LagrangeTop(1.0)


def field(value, *numbers):
    return PerturbedTop(TOP, Potential("mine", value), numbers)


SYMMETRIC = {  # terms that a turn about the vertical does not change
    "nothing": lambda x, y, z: 0.0,
    "height": lambda x, y, z: 0.1 * z * z,
    "distance": lambda x, y, z: 0.3 * sqrt(x * x + y * y + 2.0),
    "charge": lambda x, y, z: -0.2 / sqrt(x * x + y * y + (z - 1.7) ** 2),
    "steep": lambda x, y, z: 1e12 * (x * x + y * y) ** 2,
}
NARROW = {  # of the square of the distance from the centre and a coordinate from there, both in widths
    "gaussian": lambda square, along: exp(-square / 2.0),
    "lorentzian": lambda square, along: 1.0 / (1.0 + square),
    "high lorentzian": lambda square, along: 1.0 / (1.0 + square) ** 8,
    "soft wall": lambda square, along: exp(along),
    "corner": lambda square, along: (along + sqrt(along * along)) ** 2,
}


@pytest.mark.parametrize("seed", range(60))
def test_a_narrow_feature_off_the_axis_is_seen(seed):
    draw = random.Random(seed)
    kind, plain = draw.choice(list(NARROW)), draw.choice(list(SYMMETRIC))
    size, height, azimuth = 10 ** draw.uniform(-2, 2), draw.uniform(-0.99, 0.99), draw.uniform(-3.0, 3.0)
    width = draw.uniform(0.02, 0.5) * draw.choice((1.0, size))
    across = math.sqrt(1.0 - height * height)
    a = (size * across * math.cos(azimuth), size * across * math.sin(azimuth), size * height)
    strength = 10 ** draw.uniform(-20, 0)

    def value(x, y, z, p):
        offsets = [(v - c) / p[0] for v, c in zip((x, y, z), a, strict=True)]
        return SYMMETRIC[plain](x, y, z) + strength * NARROW[kind](sum(d * d for d in offsets), offsets[0])

    top = field(value, width)
    assert "J3" not in top.conserved
    assert not top.quadratic
    assert not top.system.constant


AXISYMMETRIC = [  # a formula, its numbers, whether it is quadratic
    (lambda x, y, z, p: x**2 + 2 * y**2 - y * y, (), True),
    (lambda x, y, z, p: ((x + y) ** 2 + (x - y) ** 2) / 2, (), True),
    (lambda x, y, z, p: x * x / 0.6 + y * y * (1 / 0.6) + z, (), True),
    (lambda x, y, z, p: 0.1 * x * x + 0.2 * x * x + 0.3 * y * y, (), True),
    (lambda x, y, z, p: p[0] * x * x - p[1] * y * y, (0.3, -0.3), True),
    (lambda x, y, z, p: z * z + p[0] * exp(x / 0.01), (0.0,), True),
    (lambda x, y, z, p: z**4 + p[0] * z**6, (0.7,), False),
    (lambda x, y, z, p: (x * cos(z) + y * sin(z)) ** 2 + (y * cos(z) - x * sin(z)) ** 2, (), True),
    (lambda x, y, z, p: cos(x - y) ** 2 + sin(y - x) ** 2 + z, (), True),
    (lambda x, y, z, p: 1 / sqrt(x * x + y * y + (z - p[0]) ** 2) + log(x * x + y * y + 1), (1.5,), False),
    (lambda x, y, z, p: sqrt(x * x + y * y) ** 2 + z, (), True),
    (lambda x, y, z, p: exp(-((x / 0.3) ** 2)) * exp(-((y / 0.3) ** 2)), (), False),
    (lambda x, y, z, p: sum(1 / sqrt(x * x + y * y + (z - k / 10) ** 2) for k in range(20)), (), False),
]


@pytest.mark.parametrize(("value", "numbers", "quadratic"), AXISYMMETRIC)
def test_a_plain_symmetry_is_seen(value, numbers, quadratic):
    top = field(value, *numbers)
    assert "J3" in top.conserved
    assert top.system.constant == {2}
    assert top.quadratic == quadratic


def test_numbers_that_are_nearly_right_are_not():
    """They differ by a rounding, which a J3 that is kept would hide; and what a formula makes of them may be large."""
    assert "J3" not in field(lambda x, y, z, p: p[0] * x * x + p[1] * y * y, 0.3, 0.1 + 0.2).conserved
    assert "J3" not in field(lambda x, y, z, p: (p[0] + p[1] - p[2]) * 1e16 * x, 0.1, 0.2, 0.3).conserved
    tide = PerturbedTop(TOP, POTENTIALS["tide"], (0.1, math.cos(math.pi / 2), 0.0, 1.0))
    assert "J3" not in tide.conserved


def turning(t, y, p):
    return y[:3] @ y[:3] / 2


def far(t, y, p):
    """Finite for x1 > 2 alone."""
    return turning(t, y, p) + y[5] + 0.5 * log(y[3] - 2)


def bump(t, y, p):
    return 0.1 * exp(-((y[3] - 0.6) ** 2 + (y[4] - 0.5) ** 2) / (2 * 0.02**2))


def uneven(t, y, p):
    return turning(t, y, p) + p[0] * y[3] ** 2 + p[1] * y[4] ** 2


def posed(hamiltonian, *numbers, **words):
    return Problem("mine", "e3", hamiltonian, numbers, **words)


J3 = {"J3": lambda t, y, p: y[2]}
NOT_CONSERVED = r"invariants\['J3'\] is not conserved, as far as the formulas show"
REFUSED = [
    (lambda: posed(far, invariants=J3), NOT_CONSERVED),
    (lambda: posed(lambda t, y, p: uneven(t, y, (1, 1)) + bump(t, y, p), invariants=J3), NOT_CONSERVED),
    (lambda: posed(lambda t, y, p: turning(t, y, p) + bump(t, y, p), parts=[turning]), "parts do not add up"),
    (lambda: posed(far, parts=[turning, lambda t, y, p: y[5]]), "parts do not add up"),
]


@pytest.mark.parametrize(("call", "reason"), REFUSED)
def test_what_the_formulas_refute_is_refused(call, reason):
    with pytest.raises(ValueError, match=reason):
        call()


def test_only_what_the_formulas_show_is_held_fixed():
    """0.3 is not three times 0.1, but for round-off: J3 may be said to be conserved, and is computed all the same."""
    shown = posed(lambda t, y, p: uneven(t, y, p) + bump(t, 0 * y, p), 0.3, 0.3, invariants=J3)
    meant = posed(lambda t, y, p: uneven(t, y, (p[0], 3 * p[1])), 0.3, 0.1, invariants=J3)
    assert (shown.system.constant, meant.system.constant) == ({2}, set())
    assert shown.conserved == meant.conserved == {"H", "C1", "C2", "J3"}
    assert posed(far).conserved == {"H", "C1", "C2"}


def test_a_small_cubic_is_not_quadratic():
    """What implicit midpoint would be said to keep."""
    small = Problem("small", "so3", lambda t, y, p: p[0] * (y[0] ** 3 + y[1] ** 2 * y[2]) + 1e-14 * y[2] ** 2, (1e-14,))
    assert METHODS["implicit_midpoint"].conserves_on(small) == {"C"}
    square = Problem("small", "so3", lambda t, y, p: 1e-14 * y[2] ** 2 + p[0] * y[0] ** 3, (0.0,))
    assert METHODS["implicit_midpoint"].conserves_on(square) == {"C", "H"}


def test_squares_do_not_underflow():
    assert RigidBody(1.0, (0.0, 0.0, 1e-170), (0.1, 0.2, 0.25)).symmetry is None
    assert RigidBody(1.0, (0.0, 0.0, 1e-170), (0.2, 0.2, 0.25)).symmetry == 2
    assert RigidBody(1.0, (3e-170, 0.0, 4e-170), (0.2, 0.2, 0.25)).symmetry is None
    for gravity, up in (((0.0, 1e-170, 0.0), (0.0, -1.0, 0.0)), ((0.0, 5e-324, -5e-324), (0.0, -(0.5**0.5), 0.5**0.5))):
        body = RigidBody(1.0, (0.0, 0.0, 0.1), (0.2, 0.2, 0.25), gravity)
        np.testing.assert_allclose(body.up, up, rtol=0, atol=1e-15)
        np.testing.assert_allclose(body.world @ body.world.T, np.eye(3), rtol=0, atol=1e-15)
