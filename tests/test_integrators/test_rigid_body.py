"""Rigid bodies with their rotation, any axis and any gravity, and the named cases: against Taylor series in integers."""

import math
import pickle
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, METHODS, Case, RigidBody, StepError
from lagrange_bench.integrators import integrate
from lagrange_bench.integrators.cases import matrix, quaternion
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.truth import exact as truth
from lagrange_bench.integrators.truth import truths
from lagrange_bench.integrators.truth.rigid_body import rigid_motion
from tests.reference import exactly, largest
from tests.test_integrators.test_exact import MANY

REFERENCE = Path(__file__).parents[2] / "docs" / "cases"
EXACT = ("backlund", "theta_functions", "taylor")
BALL = RigidBody(1.0, (0, 0, 1), (1, 1, 2), (0, 0, -2.5))  # the homoclinic top, as a body with equal moments
TURNED = Rotation.from_rotvec((0.3, -0.5, 0.4))
SKEW = RigidBody(
    1.3, (0.1, 0.3, -0.2), TURNED.as_matrix() @ np.diag((1.0, 1.5, 2.0)) @ TURNED.as_matrix().T, (3.0, 4.0, -5.0)
)
ROUND = RigidBody(2.0, TURNED.apply((0, 0, 0.5)), TURNED.as_matrix() @ np.diag((1, 1, 0.3)) @ TURNED.as_matrix().T)
WHOLE = {"rotation": Rotation.from_rotvec((1.0, 0.2, 0.5)), "omega_body": (1.0, -2.0, 1.5)}


def pairs_of_cases():
    """Every exact method with every case that it takes; not Taylor where what is rounded off grows by 10¹²."""
    for name, case in CASES.items():
        unstable = kinds.free_body(case.body) and case.body.axis is None
        for method in EXACT:
            if not (METHODS[method].takes(case.body) or (method == "taylor" and unstable)):
                yield name, method


@pytest.mark.parametrize(("name", "method"), list(pairs_of_cases()))
def test_the_cases_against_their_reference_files(name, method):
    """25 digits on file: position to 1e-14 m in one step, rotation to 1e-13, through 500 rad of spin."""
    case, file = CASES[name], np.loadtxt(REFERENCE / f"{name}.csv", delimiter=",", skiprows=6)
    t, position, R, omega = file[:, 0], file[:, 1:4], file[:, 8:17].reshape(-1, 3, 3), file[:, 17:]
    one = integrate(case.body, case.state, h=t[-1], steps=1, method=method)
    dense = integrate(case.body, case.state, t=t, method=method)
    for run, rows in ((one, [0, -1]), (dense, slice(None))):
        assert np.max(np.abs(run.position - position[rows])) < 1e-14 * max(1, np.max(np.abs(position)))
        assert np.max(np.abs(run.rotation.as_matrix() - R[rows])) < 1e-13
        assert np.max(np.abs(run.omega_body - omega[rows])) < 2e-15 * np.max(np.abs(omega)) * (1 + t[-1])
    assert np.max(np.abs(case.doubles(t) - file)) < 1e-13 * max(1, np.max(np.abs(omega)))


def test_rotation_and_state_that_part_are_refused():
    """Near the unstable vertical round-off grows exponentially."""
    upright = Rotation.align_vectors((0.8, 0.0, -0.6), (0, 0, 1))[0]
    start = BALL.state(rotation=upright, omega_world=(2.0, 0.0, 1.0))
    coarse, fine = (integrate(BALL, start, h, n) for h, n in ((20.0, 1), (0.5, 40)))
    assert (coarse.rotation[-1].inv() * fine.rotation[-1]).magnitude() < 1e-6
    assert coarse.method == "backlund"
    with pytest.raises(StepError, match="the orbit is unstable"):
        integrate(BALL, start, 100.0, 1)


@pytest.mark.interpreted
def test_a_body_that_flies():
    """It turns as a free body and falls as a point."""
    facts = (2.0, (0.3, 0.0, 0.0), (0.4, 0.5, 0.7), (0.0, 1.0, -9.0))
    body, place, speed = RigidBody(*facts, fixed=False), np.array((1.0, 2.0, 3.0)), np.array((-4.0, 5.0, 6.0))
    y0 = body.state(**WHOLE, position=place, velocity=speed)
    run = integrate(body, y0, h=0.1, steps=20, every=10, method="gauss8")
    t = run.t[:, None]
    assert np.allclose(run.position, place + t * speed + t * t / 2 * np.array(facts[3]), rtol=1e-15)
    assert np.allclose(run.velocity, speed + t * np.array(facts[3]), rtol=1e-15)
    assert np.ptp(run.energy) < 1e-12 * abs(run.energy[0])
    assert np.max(run.error()) < 1e-7
    dense = integrate(body, y0, t=[0.5, 2.0], method="taylor")
    assert np.allclose(dense.y[-1, 7:], run.y[-1, 7:], rtol=1e-14)
    with pytest.raises(ValueError, match="position and velocity are those of a body that flies"):
        SKEW.state(**WHOLE, position=place)


def apart(y, other):
    """Distances of states (N, 7) and others: of q or −q, and of L relative to |L|."""
    turned = np.minimum(*(np.max(np.abs(both[:, :4]), axis=1) for both in (y - other, y + other)))
    size = np.sqrt(float(np.sum(other[0, 4:] ** 2)))
    return np.maximum(turned, np.max(np.abs(y[:, 4:] - other[:, 4:]), axis=1) / size)


def of_integers(body, y0, times, digits):
    """States as fractions, q of length 1, by the series in integers; of a body with a weight that of a unit mass on its axis."""
    weight, up = ([Fraction(v) for v in values.tolist()] for values in (body.weight, body.up))
    inertia = [Fraction(v) for v in body.inertia.tolist()]
    inertia_com = [v - sum(w * w for m, w in enumerate(weight) if m != n) for n, v in enumerate(inertia)]
    omega = [Fraction(v) / w for v, w in zip(y0[4:].tolist(), inertia, strict=True)]
    found = rigid_motion(1, weight, inertia_com, [-v for v in up], matrix(y0[:4]), omega, times, digits)
    return np.array([[*quaternion(R), *(v * w for v, w in zip(spin, inertia, strict=True))] for R, spin in found])


def free_bodies():
    """Moments and L: any; within 1e-3 … 1e-15 of the separatrix, of equal moments, of an axis; needles and plates."""
    rng = np.random.default_rng(31)
    for n in range(12):
        moments, L, near = 10 ** rng.uniform(-1, 1, 3), rng.normal(size=3), 10 ** rng.uniform(-15, -3)
        i, j, k = np.argsort(moments)
        kind = n % 6
        if kind == 1:
            a = 1 / moments
            L[i] = L[k] * np.sqrt((a[j] - a[k]) / (a[i] - a[j])) * (1 + near)
        elif kind == 2:
            moments[j] = moments[i] * (1 + near)
        elif kind == 3:
            L[[i, j, k]] *= np.roll((1.0, near, near), n // 6)
        elif kind >= 4:
            thin, apart = 10 ** rng.uniform(-6, -1), 10 ** rng.uniform(-9, 0)
            moments = np.array(((thin, 1, 1 + apart * thin), (1, 1 + apart, 2 + apart - thin))[kind - 4])
            L *= moments  # all angular velocities of one size
        yield moments, L
    for moments in ((2, 2, 3), (3, 2, 2), (2, 2, 2)):
        yield moments, (0.2, -1.0, 0.3)
    yield (2, 1, 3), (0.0, -1.0, 0.0)
    yield (0.5, 0.75, 1.5), (1.0, 2.0, 1.0)  # the separatrix
    yield (3, 5, 9), (0.0, 5.0, 0.009)  # a quarter period from where u = 0
    yield (1e6, 1e-6, 1.0), (1.0, -1.0, 1.0)  # no matter


def heavy_bodies():
    """Symmetric bodies with a weight, and (q, L): any, either way up, along any axis; sleeping; homoclinic; at rest."""
    yield ROUND, ROUND.state(**WHOLE)
    for com in ((0, 0, -0.1), (0, 0.2, 0)):
        body = RigidBody(3.0, com, np.where(np.array(com) != 0, 0.4, 1.0))
        yield body, np.array((0.5, -0.5, 0.5, 0.5, 1.0, 2.0, 0.75))
    for q, L in (
        ((0, 1, 0, 0), (0, 0, 1)),
        ((0, 0.8, 0.6, 0), (1e-9, 0, 1)),
        ((1, 0, 0, 0), (1, 0, 1)),
        ((0.5, 0.5, 0.5, 0.5), (0, 0.0, 1e-3)),
        ((0.5, 0.5, 0.5, 0.5), (0, 2.5, 1)),
    ):
        yield BALL, np.array((*q, *L), dtype=float)
    yield (
        RigidBody(1.0, (0, 0, 0.5), (0.75, 0.75, 1), (-6, 0, -8)),
        np.array((1, 0, 0, 0, 2.4, 0, 3.2 + 1.25)),
    )  # steady


def with_state(body, state):
    """A body and its state (q, L), also of a free one that is given by its moments and L."""
    free = not isinstance(body, RigidBody)
    return (RigidBody(1.0, (0, 0, 0), body), np.array((0.5, -0.5, 0.5, 0.5, *state))) if free else (body, state)


@pytest.mark.interpreted
@pytest.mark.filterwarnings("ignore:inertia_com")
@pytest.mark.parametrize(("body", "state"), [*free_bodies(), *heavy_bodies()])
def test_the_truth_of_a_body(body, state):
    """To 25 digits and in doubles against the series in integers; doubles, and a method, against digits at any time."""
    body, y0 = with_state(body, state)
    is_free, across = kinds.free_body(body), np.median(body.inertia)
    bound = 2e-15 if is_free else 4e-15
    rate = np.max(np.abs(y0[4:] / body.inertia)) + np.sqrt(np.max(np.abs(body.weight)) / across)
    if not is_free:
        bound *= max(1.0, rate * across / np.linalg.norm(y0[4:]))  # `apart` is relative to |L|
    times = (np.array((0.0, 0.5, 7.0)) / rate).tolist()
    right = of_integers(body, y0, times, 30)
    if sum(v * v for v in map(Fraction, y0[:4].tolist())) == 1:
        digits = np.vectorize(exactly, otypes=[object])(truth.solution(body, y0, times, digits=25))
        assert largest(apart(digits, right)) < 1e-9 * bound
    assert largest(apart(truth.solution(body, y0, times), right)) < bound
    on_separatrix = truth.motion_of(body, y0).node is not None
    far = [-3e2 / rate, 1e2 / rate, 1e3 / rate] if on_separatrix else [-3e5 / rate, 1e6 / rate, 1e9 / rate]
    there = truth.solution(body, y0, far, digits=20)
    assert largest(apart(truth.solution(body, y0, far), there)) < bound
    assert largest(apart(truth.solution(body, y0, np.resize(far, MANY))[:3], there)) < bound
    assert np.array_equal(truths.solution(body, y0, far), truth.solution(body, y0, far))
    if is_free:
        assert largest(apart(integrate(body, y0, t=far, method="theta_functions").y, there)) < 4e-15


def test_a_body_without_a_closed_form_is_judged_as_far_as_its_reference_goes():
    y0 = SKEW.state(**WHOLE)
    limit = 2.0 * SKEW.scales(y0)[2]
    with pytest.warns(RuntimeWarning, match="take times up to .*; later states are not compared"):
        states = truths.solution(SKEW, y0, [0.5 * limit, 10 * limit, -10 * limit], longest=2.0)
    assert np.array_equal(states[0], truths.solution(SKEW, y0, [0.5 * limit])[0])
    assert np.all(np.isnan(states[1:]))


@pytest.mark.interpreted
def test_runs_of_a_free_body_are_judged_at_any_length():
    """After a million periods, where L is as before, at n h itself; q and −q are the same rotation."""
    body = RigidBody(1.0, (0, 0, 0), (1.0, 2.0, 2.5))
    y0 = body.state(**WHOLE)
    h = body.period(y0)
    run = integrate(body, y0, h=h, steps=10**6, every=10**5, method="theta_functions")
    assert np.max(np.abs(run.y[:, 4:] - y0[4:])) < 1e-8 * np.max(np.abs(y0[4:]))
    moved = truths.solution(body, y0 * (1 + 2.0**-52 * np.repeat((0, 1), (4, 3))), run.t)
    assert 1e-11 < max(run.error()) < 32 * max(apart(moved, truths.solution(body, y0, run.t)))
    opposite = replace(run, y=run.y * np.repeat((-1.0, 1.0), (4, 3)))
    assert np.array_equal(opposite.error(), run.error())
    n = np.array((10**6, 3 * 10**6 + 1))
    with mp.workdps(40):
        right = truth.solution(body, y0, [mpf(h) * int(v) for v in n], digits=20)
    assert largest(apart(truths.after_steps(body, y0, h, n), right)) < 2e-15


def test_books_have_bodies_that_no_matter_has():
    for moments in ((2.0, 1.0, 2.0 / 3.0), (0.5e-45, 2e-45, 3e-45), (-0.1, -0.1, 0.3)):
        with pytest.warns(RuntimeWarning, match="no body of matter has the moments"):
            RigidBody(1.0, (0, 0, 1), moments)
    RigidBody(1.0, (0, 0, 1), (1e-45, 2e-45, 3e-45 * (1 + 1e-12)))  # a flat one, but for a rounding


@pytest.mark.interpreted
def test_numbers_that_are_no_body_or_no_rotation_are_refused():
    facts = {"mass": 1.0, "com": (0.0, 0.0, 1.0), "inertia_com": (0.4, 0.5, 0.6)}
    for wrong, message in (
        ({"inertia_com": ((0.4, 1e-11, 0), (0, 0.5, 0), (0, 0, 0.6))}, "inertia_com must be a symmetric matrix"),
        ({"inertia_com": (0.4, 0.0, 0.4), "com": (0, 0, 0)}, "moments about the fixed point must be positive"),
        ({"mass": -1.0}, "mass must be positive"),
        ({"gravity": (0, 0, math.inf)}, "gravity must be finite real numbers, shape"),
    ):
        with pytest.raises(ValueError, match=message):
            RigidBody(**{**facts, **wrong})
    y = SKEW.check_state(SKEW.state(**WHOLE))
    SKEW.check_state(y * (*[1 + 0.5e-6] * 4, 1, 1, 1))  # what a poor run may lose
    with pytest.raises(ValueError, match="must be a unit one"):
        SKEW.check_state(y * (*[1 + 1e-5] * 4, 1, 1, 1))


@pytest.mark.interpreted
def test_the_vectors_of_a_run_are_those_of_its_rotations():
    """Of a body with products of inertia: by differences of the rotations in time, and by the matrix about the fixed point.

    R = R3(phi) R2(theta) R3(psi).
    """
    inertia = np.array(((0.4, 0.05, 0.02), (0.05, 0.5, -0.03), (0.02, -0.03, 0.3)))
    com, mass, h = (0.1, -0.2, 0.3), 1.5, 1e-4
    body = RigidBody(mass, com, inertia)
    start = Rotation.from_rotvec((0.3, -0.5, 0.8))
    omega = np.array((1.0, -2.0, 0.5))
    run = integrate(body, body.state(rotation=start, omega_world=omega), h=h, steps=2, every=1, method="taylor_fixed")
    R = run.rotation.as_matrix()
    assert R[0] == pytest.approx(start.as_matrix(), abs=1e-14)
    theta, phi, psi = run.euler_angles()[0]
    assert Rotation.from_euler("ZYZ", (phi, theta, psi)).as_matrix() == pytest.approx(R[0], abs=1e-14)
    assert run.omega_world[0] == pytest.approx(omega, abs=1e-14)
    spin = (R[2] - R[0]) / (2 * h) @ R[1].T
    assert run.omega_world[1] == pytest.approx((spin[2, 1], spin[0, 2], spin[1, 0]), abs=1e-6)
    assert run.omega_body[1] == pytest.approx(R[1].T @ run.omega_world[1], abs=1e-13)
    assert run.position[1] == pytest.approx(R[1] @ com, abs=1e-14)
    assert run.velocity[1] == pytest.approx((run.position[2] - run.position[0]) / (2 * h), abs=1e-6)
    about_point = inertia + mass * (np.dot(com, com) * np.eye(3) - np.outer(com, com))
    assert run.momentum[1] == pytest.approx(R[1] @ about_point @ run.omega_body[1], abs=1e-13)
    height = mass * 9.81 * run.position[1, 2]
    assert run.energy[1] == pytest.approx(run.omega_body[1] @ about_point @ run.omega_body[1] / 2 + height, abs=1e-12)


def test_a_start_in_seven_digits_is_scaled():
    body = RigidBody(1.0, (0, 0, 0), (10, 20, 26))
    with pytest.warns(RuntimeWarning, match="a unit quaternion.*it is scaled"):
        y = body.state(rotation=(0.7071068, 0, 0.7071068, 0), omega_body=(1, 15, 1))
    assert y[:4] == pytest.approx((0.5**0.5, 0, 0.5**0.5, 0), abs=1e-15)
    with pytest.raises(ValueError, match="an orthogonal matrix with determinant 1"):
        body.state(rotation=-np.eye(3), omega_body=(1, 15, 1))
    with pytest.raises(ValueError, match="must be a unit quaternion"):
        body.state(rotation=(0.7072, 0, 0.7071, 0), omega_body=(1, 15, 1))


def test_nearly_equal_moments_keep_their_difference():
    """A needle whose other moments differ by 5e-13: the middle axis is unstable at a rate of √(5e-13/1e-12) of its spin."""
    needle = RigidBody(1.0, (0, 0, 0), (1.0, 1.0 + 5e-13, 1e-12 + 5e-13))
    assert needle.axis is None
    assert RigidBody(1.0, (0, 0, 0), (0.1 + 0.2, 0.3, 0.4)).axis is not None  # apart by an ulp
    close = RigidBody(1.0, (0, 0, 0), (3.0, 3.0 * (1 + 2e-12), 5.0))
    rates = close.rhs(close.state(rotation=np.eye(3), omega_body=(1.0, 1.0, 1.0)))[4:]
    difference = 3.0 * (1 + 2e-12) - 3.0  # what the double is
    assert rates[2] == pytest.approx(-difference, rel=1e-11, abs=0)


@pytest.mark.interpreted
@pytest.mark.parametrize("body", [SKEW, ROUND], ids=["skew", "round"])
def test_any_body_in_any_gravity_against_integers(body):
    """The digits of a case of one's own, which start from the doubles, and the doubles of a method."""
    times = [0, "0.5", 2.0]
    assert np.array_equal(eval(repr(body)).numbers, body.numbers)
    case = Case("mine", body, WHOLE["rotation"].as_matrix(), WHOLE["omega_body"], until=2.0)
    digits = list(case.digits(times, 30))
    assert len(str(digits[0][4]).lstrip("-0.").replace(".", "")) >= 29
    rows = np.array(digits, dtype=float)
    assert np.max(np.abs(rows - case.doubles(rows[:, 0]))) < 1e-13
    R, omega = rows[:, 8:17].reshape(-1, 3, 3), rows[:, 17:]
    run = integrate(body, body.state(**WHOLE), t=rows[:, 0], method="dop853", rtol=1e-13, atol=1e-13)
    assert np.max(np.abs(run.rotation.as_matrix() - R)) < 1e-11
    assert np.max(np.abs(run.omega_body - omega)) < 1e-11
    assert np.max(np.abs(run.position - R @ body.com)) < 1e-11
    energies = [body.energy(body.state(**WHOLE)), *run.energy, *body.energy_of(R, omega)]
    assert np.ptp(energies) < 1e-11 * np.max(np.abs(energies))
    assert all(np.max(error) < 1e-11 for error in body.errors(run.y, R).values())
    assert ("C2" in body.names) is (body is ROUND)
    for wrong in ([0, "0.2", "0.1"], ["inf"]):
        with pytest.raises(ValueError, match="times must"):
            next(case.digits(wrong))


def test_errors_tell_position_from_spin():
    body = CASES["bruels"].body
    y = body.state(rotation=np.eye(3), omega_body=(0, 1, 0))[None]
    spun = Rotation.from_rotvec((0, 0.25, 0)).inv().as_matrix()[None]
    found = body.errors(y, spun)
    assert found["position"][0] < 1e-15
    assert found["rotation"][0] == pytest.approx(0.25) == found["spin"][0]


def test_generalized_alpha_as_published():
    """Errors of position (m) and rotation (rad) at t = 2 s with h = 1e-4, found by another program."""
    body, state = CASES["bruels"].body, CASES["bruels"].state
    run = integrate(body, state, h=1e-4, steps=20_000, method="generalized_alpha")
    errors = body.errors(run.y[-1:], CASES["bruels"].solution([2.0]).rotation.as_matrix())
    assert (errors["position"][0], errors["rotation"][0]) == pytest.approx((2.0e-3, 3.3e-3), rel=0.1)


@pytest.mark.interpreted
def test_a_step_that_is_not_solved_is_refused():
    y0 = SKEW.state(**WHOLE)
    with np.errstate(all="ignore"), pytest.raises(StepError, match="not solved after 50 iterations"):
        integrate(SKEW, y0, h=50.0, steps=1, method="rattle")


@pytest.mark.interpreted
@pytest.mark.parametrize("size", [1e-310, 1e-300, 1e-160, 1e160, 1e300])
@pytest.mark.parametrize("facts", [(1, 0, 0, 0), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 1, 1)])
def test_extreme_numbers_make_a_body_or_a_named_error(facts, size):
    """A choice of inertia_com, mass, com and gravity is extreme."""
    moments, mass, com, gravity = (size if extreme else 1.0 for extreme in facts)
    for inertia in ((2 * moments, 3 * moments, 4 * moments), np.diag((2 * moments, 3 * moments, 4 * moments))):
        refusal = ""
        try:
            numbers = RigidBody(mass, (0.0, 0.0, com), inertia, (0.0, 0.0, -gravity)).numbers
        except ValueError as error:
            refusal = str(error)
        assert "take other units" in refusal or np.all(np.isfinite(numbers))


@pytest.mark.interpreted
def test_bodies_with_the_same_zeros_share_their_formulas():
    """Recording them takes ten times as long as all else, and a body is made for each of many runs."""
    one, two = (RigidBody(m, (0.1, -0.3, 0.9), (0.4, 0.5, 0.3), (0.0, 0.0, -9.81)) for m in (0.8, 0.9))
    flat = RigidBody(0.8, (0.1, -0.3, 0.0), (0.4, 0.5, 0.3), (0.0, 0.0, -9.81))
    assert one.system is two.system
    assert one.numbers != two.numbers
    assert flat.system != one.system
    assert pickle.loads(pickle.dumps(SKEW)) == SKEW
