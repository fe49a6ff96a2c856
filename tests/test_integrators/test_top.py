"""Tops in a uniform field and in potentials: derivatives, scales, SI units, and the formulas that potentials are recorded as."""

import math
import pickle

import numpy as np
import pytest

from lagrange_bench import METHODS, PERTURBED_TOPS, POTENTIALS, LagrangeTop, PerturbedTop, Potential, integrate
from lagrange_bench.integrators import Problem, RigidBody, exp, log, sqrt

EPS = np.finfo(float).eps


def test_scales():
    """|J| + √(|alpha||x|), |x| and the time; |J|²/2 + |alpha||x| for H, the others by the scales of J and x."""
    top, y = LagrangeTop(-2.0), (0.0, 3.0, 4.0, 0.0, 2.0, 0.0)
    assert top.scales(y) == pytest.approx((7.0, 2.0, 1 / 7.0))
    assert top.invariant_scales(y) == pytest.approx((12.5 + 4.0, 7.0, 4.0, 14.0))
    assert all(0.0 < scale < math.inf for scale in top.scales((1.7e308, 1.7e308, 0.0, 1.7e308, 0.0, 1.7e308)))


Y = np.array((0.3, -0.4, 1.2, 0.48, 0.6, 0.64))
TOP = LagrangeTop(1.0)
HOMEMADE = Potential(
    "homemade", lambda x1, x2, x3, p: p[0] * x1**2 * x3 / 2 + p[1] * sqrt(2.0 + x2 * x3) - x1 / (3 + x3)
)
FIELDS = {"uniform": LagrangeTop(-2.5), "homemade": PerturbedTop(TOP, HOMEMADE, (0.3, -0.2))}
FIELDS |= {name: named.top for name, named in PERTURBED_TOPS.items()}


def edge(w):
    return w + sqrt(w * w)


FORMULAS = [  # a potential, its numbers, whether it is seen to be smooth, quadratic, and of x3 only
    ("tide", (0.1, 1.0, 0.0, 0.0), True, True, False),
    ("quadratic", (0.0, 0.0, 0.3, 0.0, 0.0, 0.0), True, True, True),
    ("charge", (0.1, 0.0, 0.0, 2.0), True, False, False),
    (lambda x, y, z, p: y * y, (), True, True, False),
    # V = 0 on one side of a plane: only the other sign of a root shows that it is not 0 everywhere
    (lambda x, y, z, p: edge(x - p[0]) ** 2, (0.9,), False, False, False),
    (lambda x, y, z, p: edge(z - p[0]) ** 2, (0.9,), False, False, True),
    # √(w²) is |w|, on which no Taylor series goes on where w changes its sign; it is no quadratic field either
    (lambda x, y, z, p: sqrt((x * x - 2 * y * y) ** 2), (), False, False, False),
    (lambda x, y, z, p: sqrt(p[0] * p[0] * (x * x + 2)), (0.3,), True, False, False),
    (lambda x, y, z, p: 1 / ((x - 2) ** 2 + y**2 + z**2) ** 1.5, (), True, False, False),
]
ROUND = [  # likewise, symmetric about the vertical
    (lambda x, y, z, p: p[0] * x * x - p[1] * y * y, (0.3, -0.3), True, True, False),
    (lambda x, y, z, p: z * z + p[0] * exp(x / 0.01), (0.0,), True, True, True),
    (lambda x, y, z, p: z**4 + p[0] * z**6, (0.7,), True, False, True),
    (lambda x, y, z, p: 1 / sqrt(x * x + y * y + (z - p[0]) ** 2) + log(x * x + y * y + 1), (1.5,), True, False, False),
]


def field(value, *numbers, **words):
    return PerturbedTop(
        TOP, POTENTIALS[value] if isinstance(value, str) else Potential("mine", value), numbers, **words
    )


@pytest.mark.parametrize(("value", "numbers", "smooth", "quadratic", "of_height"), [*FORMULAS, *ROUND])
def test_a_symmetry_is_seen_or_said(value, numbers, smooth, quadratic, of_height):
    top = field(value, *numbers)
    assert top.offers == {"rhs", "parts", "kinetic"} | ({"smooth"} if smooth else set())
    assert top.quadratic == quadratic
    assert (("J3" in top.conserved), top.system.constant) == (of_height, {2} if of_height else set())
    with pytest.raises(ValueError, match="no exact one is known here"):
        integrate(top, Y, 0.1, 10)
    if not smooth:
        with pytest.raises(ValueError, match="taylor needs a Hamiltonian without corners, which the potential mine is"):
            integrate(top, Y, 0.1, 10, "taylor")
    if (value, numbers, smooth, quadratic, of_height) in ROUND:
        said = field(value, *numbers, axisymmetric=True)
        assert ("J3" in said.conserved, said.system.constant, said.quadratic) == (True, {2}, quadratic)
        assert pickle.loads(pickle.dumps(said)) == said.motion(0) == said


def test_a_top_in_a_potential_is_a_value():
    for top in FIELDS.values():
        again = pickle.loads(pickle.dumps(top))
        assert (again, hash(again)) == (top, hash(top))
        assert np.array_equal(again.rhs(Y), top.rhs(Y))
        assert np.allclose(top.poisson(Y) @ top.gradients(Y)[0], top.rhs(Y), atol=1e-14)  # f' = {f, H}
        slopes = [(top.energy(Y + e) - top.energy(Y - e)) / 2e-6 for e in 1e-6 * np.eye(6)]
        assert np.allclose(top.gradients(Y)[0], slopes, rtol=0, atol=1e-8)
        several = np.array((Y, 2 * Y, -Y))
        assert np.array_equal(top.invariants(several), [top.invariants(y) for y in several])
    assert FIELDS["weak_tide"] != FIELDS["moderate_tide"]
    retyped = Potential("tide", lambda x1, x2, x3, p: p[0] * x1 * x1 / 2)
    renamed = Potential("other", lambda a, b, c, k: k[0] * a * a / 2)
    assert PerturbedTop(TOP, retyped, (0.1,)) == PerturbedTop(TOP, renamed, (0.1,))


NO_FORMULA = [  # a potential, and why it is refused with p = 1e308
    (lambda x1, x2, x3, p: math.sqrt(x1), "log of lagrange_bench"),
    (lambda x1, x2, x3, p: x1 if x1 > 0 else x2, "cannot branch"),
    (lambda x1, x2, x3, p: np.tan(x1), "got numpy's tan"),
    (lambda x1, x2, x3, p: x1**0.3, "power"),
    (lambda x1, x2, x3, p: x1 + 1 / 0.0, "division by zero"),
    *(
        (value, "is not finite at x")
        for value in (
            lambda x1, x2, x3, p: x1 / 0.0,
            lambda x1, x2, x3, p: x2 / (x1 - x1),
            lambda x1, x2, x3, p: x1 * math.inf,
            lambda x1, x2, x3, p: x1 * (math.inf - math.inf),
            lambda x1, x2, x3, p: sqrt(x1 - 9.0),
            lambda x1, x2, x3, p: (0.0 * x1) ** -1,
            lambda x1, x2, x3, p: x1 * p[0] * p[0],
            lambda x1, x2, x3, p: x1 / p[0] + sqrt(-p[0]),
        )
    ),
]


@pytest.mark.parametrize(("value", "reason"), NO_FORMULA)
def test_what_is_no_formula_or_not_finite_is_refused_by_name(value, reason):
    with pytest.raises(ValueError, match=f"potential mine.*{reason}") as caught:
        PerturbedTop(TOP, Potential("mine", value), (1e308,)).check_state(Y)  # as `integrate` does
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("J", [0.0, 1e-300, 1.0])
def test_scales_of_a_weightless_top_are_those_of_its_field(J):
    """They must not jump where J is next to 0, as a computed cos π/2 is."""
    top = PerturbedTop(LagrangeTop(0.0), POTENTIALS["tide"], (1.0, 1.0, 0.0, 0.0))
    rate, size, time = top.scales((J, 0.0, 0.0, 0.6, 0.0, 0.8))
    assert (rate, size, time) == pytest.approx((max(J, math.sqrt(0.6)), 1.0, 1 / max(J, math.sqrt(0.6))))
    assert np.allclose(top.invariant_scales((J, 0.0, 0.0, 0.6, 0.0, 0.8)), (J * J / 2 + 0.18, rate, 1.0, rate))
    heavy = PerturbedTop(LagrangeTop(-2.0), POTENTIALS["tide"], (1.0, 1.0, 0.0, 0.0))
    assert heavy.invariant_scales((J, 0.0, 0.0, 0.6, 0.0, 0.8))[0] == pytest.approx(J * J / 2 + 2.0 + 0.18)


@pytest.mark.parametrize("strength", [1.0, 1e-9])
def test_a_symmetry_that_is_only_said_is_refused(strength):
    for value in (
        lambda x, y, z, p: p[0] * x,
        lambda x, y, z, p: p[0] * (x * x + 1.01 * y * y),
        lambda x, y, z, p: (x * x + y * y) ** 2 + p[0] * exp(-((x - 0.6) ** 2 + y * y) / 0.5),
        lambda x, y, z, p: sqrt(x - 1e9),  # finite nowhere
    ):
        with pytest.raises(ValueError, match="axisymmetric: the potential mine changes when x turns about the vert"):
            field(value, strength, axisymmetric=True)


def turning(t, y, p):
    return y[:3] @ y[:3] / 2


def far(t, y, p):
    """Finite for x1 > 2 alone."""
    return turning(t, y, p) + y[5] + 0.5 * log(y[3] - 2)


def uneven(t, y, p):
    return turning(t, y, p) + p[0] * y[3] ** 2 + p[1] * y[4] ** 2


def posed(hamiltonian, *numbers, **words):
    return Problem("mine", "e3", hamiltonian, numbers, **words)


J3 = {"J3": lambda t, y, p: y[2]}
NOT_CONSERVED = r"invariants\['J3'\] is not conserved"
REFUSED = [
    (lambda: posed(far, invariants=J3), NOT_CONSERVED),
    (lambda: posed(lambda t, y, p: uneven(t, y, p), 1.0, 1.0 + 1e-9, invariants=J3), NOT_CONSERVED),
    (lambda: posed(turning, invariants={"late": lambda t, y, p: y[0] + 1e-9 * t}), "not conserved"),
]


@pytest.mark.parametrize(("call", "reason"), REFUSED)
def test_what_random_states_refute_is_refused(call, reason):
    with pytest.raises(ValueError, match=reason):
        call()


def test_what_is_said_and_not_refuted_is_held_fixed():
    """0.3 is not three times 0.1, but for round-off."""
    assert posed(lambda t, y, p: uneven(t, y, (p[0], 3 * p[1])), 0.3, 0.1, invariants=J3).system.constant == {2}
    assert posed(uneven, 0.3, 0.3).system.constant == set()
    assert posed(far).conserved == {"H", "C1", "C2"}


def test_a_small_cubic_is_not_quadratic():
    """What implicit midpoint would be said to keep."""
    small = Problem("small", "so3", lambda t, y, p: p[0] * (y[0] ** 3 + y[1] ** 2 * y[2]) + 1e-14 * y[2] ** 2, (1e-14,))
    assert small.conserved_by(METHODS["implicit_midpoint"]) == {"C"}
    square = Problem("small", "so3", lambda t, y, p: 1e-14 * y[2] ** 2 + p[0] * y[0] ** 3, (0.0,))
    assert square.conserved_by(METHODS["implicit_midpoint"]) == {"C", "H"}


def test_squares_do_not_underflow():
    assert RigidBody(1.0, (0.0, 0.0, 1e-170), (0.2, 0.2, 0.25)).symmetry == 2
    assert RigidBody(1.0, (3e-170, 0.0, 4e-170), (0.2, 0.2, 0.25)).symmetry is None
    body = RigidBody(1.0, (0.0, 0.0, 0.1), (0.2, 0.2, 0.25), (0.0, 5e-324, -5e-324))
    np.testing.assert_allclose(body.up, (0.0, -(0.5**0.5), 0.5**0.5), rtol=0, atol=1e-15)
