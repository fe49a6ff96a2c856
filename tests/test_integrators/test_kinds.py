"""The three kinds of problem that a file each defines: closed forms, known cases, and what is conserved."""

import numpy as np
import pytest

from lagrange_bench.experiments import driven as driven_tops
from lagrange_bench.integrators import (
    METHODS,
    LagrangeTop,
    PerturbedTop,
    Potential,
    Problem,
    cos,
    free_body,
    integrate,
    kirchhoff_body,
    orbiting_tide,
    reference,
    vibrating_pivot,
)
from lagrange_bench.integrators.problem import free_body as euler

pytestmark = pytest.mark.interpreted


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


Y0 = np.array((0.3, -0.2, 1.1, 0.4, 0.1, 0.9))
END = 12.0


def driven(t, y, p):
    weight = 1.0 + p[0] * cos(1.1 * t)  # a part of it is constant
    return y[:3] @ y[:3] / 2.0 + weight * y[5] + p[0] * cos(0.7 * t) * (y[3] * y[3] - 0.5 * y[4] * y[5])


DRIVEN = Problem("driven", "e3", driven, (0.01,)).starting(1.3)


SCHEMES = [
    *(("strang", 4, {}), ("processed6", 6, {}), ("aba864", 6, {})),
    ("strang", 2, {"corrector": False, "modified_kick": False}),
]
CASES = [  # a problem, a state, a time, numbers of steps, a scheme, its order, options
    *((DRIVEN, Y0, END, 48, *scheme) for scheme in SCHEMES),
    *(
        (problem, driven_tops.start(name), driven_tops.SPANS[name] / 4, 256 if name == "kapitza" else 64, *scheme)
        for name, problem in driven_tops.PROBLEMS.items()
        for scheme in SCHEMES[:2]
    ),
]


@pytest.mark.parametrize(("problem", "y0", "span", "steps", "scheme", "order", "options"), CASES)
@pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning")
def test_every_scheme_keeps_its_order_in_a_driven_field(problem, y0, span, steps, scheme, order, options):
    right = reference.solution(problem, y0, [span]).states[0]

    def error(n):
        run = integrate(problem, y0, h=span / n, steps=n, method="backlund_splitting", scheme=scheme, **options)
        return np.max(np.abs(run.y[-1] - right))

    assert np.log2(error(steps) / error(2 * steps)) == pytest.approx(order, abs=0.25)


def test_rows_on_the_way_do_not_change_the_run():
    """Each row leaves the run at its own time."""
    rows = integrate(DRIVEN, Y0, h=0.25, steps=48, every=12, method="backlund_splitting").y
    ends = [integrate(DRIVEN, Y0, h=0.25, steps=n, method="backlund_splitting").y[-1] for n in (12, 24, 36, 48)]
    np.testing.assert_array_equal(rows[1:], ends)


FIELD = Problem(
    "mine", "e3", lambda t, y, p: y[:3] @ y[:3] / 2.0 + 1.3 * y[5] + p[0] * (y[3] * y[3] - y[4] * y[5]), (0.01,)
)
SAME = PerturbedTop(LagrangeTop(1.3), Potential("mine", lambda a, b, c, p: p[0] * (a * a - b * c)), (0.01,))


@pytest.mark.parametrize("name", ["backlund_splitting", "force_gradient4", "kahan", "verner9_projected"])
def test_a_problem_posed_by_hand_is_followed_as_a_top_in_a_potential(name):
    method = METHODS[name]
    assert method.takes(FIELD) is None
    assert method.kept(FIELD) == method.kept(SAME)
    rows = [integrate(top, Y0, h=0.1, steps=20, every=5, method=name).y for top in (FIELD, SAME)]
    np.testing.assert_array_equal(*rows)


def on_an_orbit(eccentricity, M, x):
    """(a/r)³ (n·x)², by Newton's method for Kepler's equation."""
    E = M
    for _ in range(50):
        E -= (E - eccentricity * np.sin(E) - M) / (1.0 - eccentricity * np.cos(E))
    r = 1.0 - eccentricity * np.cos(E)
    toward = np.array((np.cos(E) - eccentricity, np.sqrt(1.0 - eccentricity**2) * np.sin(E), 0.0)) / r
    return (toward @ x) ** 2 / r**3


def test_the_tide_of_an_orbit_misses_a_part_of_the_cube_of_its_eccentricity():
    x = np.array((0.3, -0.5, 0.6))

    def missed(eccentricity):
        tide = orbiting_tide(2.0, eccentricity, 1.5)
        times = np.linspace(0.0, 4.0, 33)
        energies = [tide.starting(t).energy(np.r_[0.0, 0.0, 0.0, x]) for t in times]
        return max(abs(H - 2.0 * on_an_orbit(eccentricity, 1.5 * t, x)) for t, H in zip(times, energies, strict=True))

    assert missed(0.0) < 1e-14
    assert np.log2(missed(0.02) / missed(0.01)) == pytest.approx(3.0, abs=0.1)
