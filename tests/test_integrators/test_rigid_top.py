"""Real tops with their attitude, any axis and any gravity, the named cases, whole bodies: against Taylor series in integers."""

import json
import math
import pickle
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, METHODS, TOPS, Case, HeavyTop, LagrangeTop, RigidTop, StepError, WholeBody, available
from lagrange_bench.integrators import integrate
from lagrange_bench.integrators.cases import matrix
from lagrange_bench.integrators.truth.rigid_body import about_fixed_point, rigid_motion
from tests.reference import largest

REFERENCE = Path(__file__).parents[2] / "docs" / "cases"
FOLLOWING = [name for name in METHODS if METHODS[name].attitude is not None and available(METHODS[name])]
# a brass gyroscope: 0.1 kg, 3 cm from the tip to the centre of mass
TOY = HeavyTop(mass=0.1, distance=0.03, gravity=9.81, A=1.5e-4, C=6e-5)
DISK = {"mass": 15.0, "com": (0, 1, 0), "inertia_com": (0.234375, 0.46875, 0.234375)}


def motion(facts, rotation, omega, times):
    """Rotation matrices (N, 3, 3) and angular velocities (N, 3) in the body, from integers; `facts` are those of RigidTop."""
    start = matrix(rotation.as_quat(scalar_first=True))
    found = list(rigid_motion(*facts, start, omega, times, digits=17))
    return tuple(np.array([np.array(row[k], dtype=float) for row in found]) for k in (0, 1))


def random_top(seed):
    """A top with a random axis, gravity and orientation; its start; and a time of some 60 rad."""
    rng = np.random.default_rng(seed)
    Q, up, start = Rotation.random(3, random_state=rng)
    C = 10 ** rng.uniform(-3, 0)
    across, mass, distance = C * rng.uniform(0.5, 4), 10 ** rng.uniform(-1, 1.5), rng.uniform(0.02, 1.0)
    inertia = (Q.as_matrix() * (across, across, C)) @ Q.as_matrix().T
    axis = Q.apply((0, 0, 1))
    top = RigidTop(mass, distance * axis, (inertia + inertia.T) / 2, up.apply((0, 0, rng.uniform(1, 20))))
    spin = 10 ** rng.uniform(0, math.log10(500))
    omega = spin * axis + np.cross(axis, rng.normal(size=3)) * 10 ** rng.uniform(-1, 1)
    return top, start, omega, min(2.0, 60 / spin)


def free_top(**body):
    return RigidTop(**body), Rotation.from_rotvec((0.3, -0.2, 1.0)), (1.0, 20.0, -3.0), 2.0


MOTIONS = {
    **{f"random {seed}": random_top(seed) for seed in range(3)},
    "held at its centre": free_top(**{**DISK, "com": (0, 0, 0)}),
    "no gravity": free_top(**{**DISK, "gravity": (0, 0, 0)}),
    "a ball": free_top(mass=1.0, com=(0, 0, 0), inertia_com=(2, 2, 2)),
}


@pytest.mark.interpreted
@pytest.mark.parametrize("motion_of", MOTIONS)
def test_any_top_by_every_method(motion_of):
    top, start, omega, end = MOTIONS[motion_of]
    times = [0.0, 0.3 * end, end]
    R, Omega = motion((top.mass, top.com, top.inertia_com, top.gravity), start, omega, times)
    state = top.state(rotation=start, omega_body=omega)
    for method in FOLLOWING:
        for run, rows in (
            (integrate(top, state, t=times, method=method), [0, 1, 2]),
            (integrate(top, state, h=end / 10, steps=10, method=method), [0, 2]),
            (integrate(top, state, h=end, steps=1, method=method), [0, 2]),
        ):
            assert np.max(np.abs(run.position - R[rows] @ top.com)) <= 1e-13 * top.distance
            assert np.max(np.abs(run.rotation.as_matrix() - R[rows])) < 1e-13
            assert np.max(np.abs(run.omega_body - Omega[rows])) < 1e-13 * np.max(np.abs(omega))
            turned = run.rotation.apply(run.omega_body)
            np.testing.assert_allclose(turned, run.omega_world, rtol=0, atol=1e-13 * np.max(np.abs(omega)))
            energies = (*run.energy, *top.energy(run.rotation, run.omega_body))
            for kept in (energies, top.vertical_momentum(run.rotation, run.omega_body)):
                assert np.ptp(kept) < 1e-12 * np.max(np.abs(kept))


@pytest.mark.parametrize("method", FOLLOWING)
@pytest.mark.parametrize("name", CASES)
def test_the_cases_against_their_reference_files(name, method):
    """25 digits on file: position to 1e-14 m in one step, rotation to 1e-13, through 500 rad of spin."""
    case, file = CASES[name], np.loadtxt(REFERENCE / f"{name}.csv", delimiter=",", skiprows=6)
    t, position, R, omega = file[:, 0], file[:, 1:4], file[:, 8:17].reshape(-1, 3, 3), file[:, 17:]
    one = integrate(case.top, case.state, h=t[-1], steps=1, method=method)
    dense = integrate(case.top, case.state, t=t, method=method)
    for run, rows in ((one, [0, -1]), (dense, slice(None))):
        assert np.max(np.abs(run.position - position[rows])) < 1e-14
        assert np.max(np.abs(run.rotation.as_matrix() - R[rows])) < 1e-13
        assert np.max(np.abs(run.omega_body - omega[rows])) < 2e-15 * np.max(np.abs(omega)) * (1 + t[-1])
    assert np.max(np.abs(case.doubles(t) - file)) < 1e-13 * max(1, np.max(np.abs(omega)))


def test_a_heavy_top_is_a_rigid_top(tmp_path):
    """The same body by its moments about the fixed point; the state from Euler angles has the rotation too."""
    rigid = RigidTop(0.1, (0, 0, 0.03), (1e-4, 1e-4, 6e-5))
    heavy = HeavyTop(mass=0.1, distance=0.03, gravity=9.81, A=rigid.A, C=rigid.C)
    state = heavy.state((0.4, 0.3, 0.1), (0.2, 1.5, 120.0))
    run = integrate(heavy, state, h=0.5, steps=4, every=1)
    assert json.loads(str(np.load(run.save(tmp_path / "a.npz"))["metadata"]))["body"] == repr(heavy)
    sent = integrate(eval(repr(heavy)), pickle.loads(pickle.dumps(state)), h=0.5, steps=4, every=1)
    assert np.array_equal(sent.rotation.as_quat(), run.rotation.as_quat())
    same = integrate(rigid, rigid.state(rotation=state.rotation, omega_world=run.omega_world[0]), t=run.t)
    np.testing.assert_allclose(run.position, same.position, atol=1e-14)
    np.testing.assert_allclose(run.rotation.as_matrix(), same.rotation.as_matrix(), atol=3e-13)
    np.testing.assert_allclose(run.energy, same.energy, rtol=1e-13)
    plain = integrate(heavy, np.array(state), h=0.5, steps=4, every=1)  # its spin follows from J·x
    np.testing.assert_allclose(plain.omega_world, run.omega_world, rtol=1e-12)


def test_a_case_of_ones_own():
    """Its digits start from the doubles; a matrix serves as well as a Rotation."""
    top, turn = RigidTop(**DISK), Rotation.from_rotvec((0.1, 0.2, 0.3))
    case = Case("mine", top, turn.as_matrix(), (1.0, 5.0, 2.0), until=1.0)
    rows = np.array([list(map(float, row)) for row in case.digits([0, "0.25", 0.5], 20)])
    assert np.max(np.abs(rows - case.doubles([0, 0.25, 0.5]))) < 1e-14
    assert [len(str(v).lstrip("-0.").replace(".", "")) for v in next(iter(case.digits([0.0], 30)))][4] >= 29
    for wrong in (["-0.1"], [0, "0.2", "0.1"], [float("inf")], [0.1, float("nan")], ["inf"]):
        with pytest.raises(ValueError, match="times must"):
            next(case.digits(wrong))


def test_digits_of_a_quaternion_have_a_scalar_that_is_not_negative():
    rows = list(CASES["metis"].digits([k / 4 for k in range(9)], 17))
    assert all(row[4] >= 0 for row in rows)
    assert np.max(np.abs(np.array(rows, dtype=float) - CASES["metis"].doubles([k / 4 for k in range(9)]))) < 1e-11


@pytest.mark.parametrize("name", ["figure1", "near_separatrix", "through_pole", "regular"])
def test_attitudes_at_any_times(name):
    """In any order, on both sides of 0, over many nutations: the methods agree, and with steps; g e3 ḡ = x/|x|."""
    named, unit = TOPS[name], TOPS[name].top.scales(TOPS[name].state)[2]
    t = unit * np.array([3.0, -5.0, 0.1, 0.0, 70.0, 3.0])
    jumps = [integrate(named.top, named.state, t=t, method=m, attitude=True) for m in FOLLOWING]
    steps = [integrate(named.top, named.state, h=h * unit, steps=n, attitude=True) for h, n in ((0.1, 700), (10.0, 7))]
    for run in jumps:
        assert np.max((run.rotation.inv() * jumps[0].rotation).magnitude()) < 2e-12
    for run in steps:
        assert (run.rotation[-1].inv() * jumps[0].rotation[4]).magnitude() < 2e-12
    for run in (*jumps, *steps):
        axis = run.y[:, 3:] / np.linalg.norm(run.y[:, 3:], axis=1, keepdims=True)
        assert np.max(np.abs(run.rotation.as_matrix()[:, :, 2] - axis)) < 4e-13


@pytest.mark.parametrize(("h", "steps"), [(40.0, 1), (100.0, 4), (1000.0, 1), (-45.0, 2)])
def test_an_unstable_sleeping_top_turns_at_a_constant_rate(h, steps):
    """There is no nutation to divide a long step by."""
    run = integrate(LagrangeTop(1.0), (0.0, 0.0, 1.0, 0.0, 0.0, 1.0), h, steps, attitude=True)
    assert abs(math.remainder(run.euler_angles()[-1, 1] - h * steps, 2 * math.pi)) < 1e-12


def test_a_long_step_to_the_unstable_vertical_is_many_short_ones():
    named = TOPS["homoclinic"]
    coarse = integrate(named.top, named.state, 25.0, 1, attitude=True).attitude[-1]
    fine = integrate(named.top, named.state, 0.5, 50, attitude=True).attitude[-1]
    assert min(np.max(np.abs(fine - coarse)), np.max(np.abs(fine + coarse))) < 1e-6  # round-off grows exponentially
    with pytest.raises(StepError, match="the orbit is unstable"):
        integrate(named.top, named.state, 100.0, 1, attitude=True)


@pytest.mark.parametrize("size", [1e-300, 1e160])
def test_the_axis_of_the_body_whatever_its_length(size):
    named = TOPS["generic"]
    y0 = named.state * np.repeat((1, size), 3)
    g = integrate(LagrangeTop(1 / size), y0, 0.1, 10, attitude=True).attitude
    np.testing.assert_allclose(g, integrate(named.top, named.state, 0.1, 10, attitude=True).attitude, atol=1e-13)


@pytest.mark.parametrize("angles", [(0.4, 0.3, -2.0), (3.0, -3.0, 3.0), (0.0, 0.7, 0.0)])
def test_euler_angles_round_trip(angles):
    """Those of `state` come back; on the vertical phi has all of the turn, and no warning is given."""
    run = integrate(TOY, TOY.state(angles, (0.1, 0.2, 0.3)), t=[0.0])
    assert np.allclose(run.euler_angles(), angles, atol=1e-14)


def test_the_exact_values_of_bruels():
    """45 digits from a program that shares nothing with this one; here at t = 0.1 s, and at 2 s in the reference file."""
    last = (REFERENCE / "bruels.csv").read_text("utf-8").splitlines()[-1].split(",")
    assert last[1].startswith("-0.150416822745641759810030")
    assert last[3].startswith("-0.67302226956044409605022")
    assert last[-1].startswith("-5.85562458920545772829141")


@pytest.mark.parametrize("gravity", [(0, 0, 0), (Fraction(1, 2), -1, Fraction(-981, 100))])
def test_an_asymmetric_body(gravity):
    """An orthogonal R, energy and vertical momentum to 25 digits; of a free body all of the angular momentum."""
    com, moments = (np.array([Fraction(n, 10) for n in row]) for row in ((1, 2, -3), (3, 5, 7)))
    inertia, gravity = np.array(about_fixed_point(Fraction(2), com, moments)), np.array(gravity, dtype=object)
    kept = []
    for R, omega in rigid_motion(2, com, moments, gravity, np.eye(3).tolist(), (3, -2, 5), [0, 1, 2], 25):
        R, omega = np.array(R), np.array(omega)
        momentum = R @ inertia @ omega
        energy = omega @ inertia @ omega / 2 - 2 * gravity @ R @ com
        kept.append([energy, *(R @ R.T).ravel(), *([gravity @ momentum] if any(gravity) else momentum)])
    assert largest(np.array(kept) - kept[0]) < 1e-24


TURNED = Rotation.from_rotvec((0.3, -0.5, 0.4))
SKEW = WholeBody(
    1.3, (0.1, 0.3, -0.2), TURNED.as_matrix() @ np.diag((1.0, 1.5, 2.0)) @ TURNED.as_matrix().T, (3.0, 4.0, -5.0)
)
ROUND = WholeBody(2.0, TURNED.apply((0, 0, 0.5)), TURNED.as_matrix() @ np.diag((1, 1, 0.3)) @ TURNED.as_matrix().T)
WHOLE = {"rotation": Rotation.from_rotvec((1.0, 0.2, 0.5)), "omega_body": (1.0, -2.0, 1.5)}
# errors of position (m) and rotation (rad) at t = 2 s with h = 1e-4, to be met within a tenth
PUBLISHED = {
    "strang": (2.2e-8, 4.6e-8),
    "rkmk4": (3.8e-8, 7.0e-8),
    "rattle": (1.7e-5, 1.1e-2),
    "simo_wong": (5.3e-4, 5.8e-3),
    "lie_midpoint": (3.4e-4, 3.5e-4),
    "generalized_alpha": (2.0e-3, 3.3e-3),
}


@pytest.mark.interpreted
@pytest.mark.parametrize("body", [SKEW, ROUND], ids=["skew", "round"])
def test_any_body_in_any_gravity_against_integers(body):
    times = [0.5, 2.0]
    assert np.array_equal(eval(repr(body)).numbers, body.numbers)
    R, omega = motion(body.facts.values(), WHOLE["rotation"], WHOLE["omega_body"], times)
    run = integrate(body, body.state(**WHOLE), t=times, method="dop853", rtol=1e-13, atol=1e-13)
    assert np.max(np.abs(run.rotation.as_matrix() - R)) < 1e-11
    assert np.max(np.abs(run.omega_body - omega)) < 1e-11
    assert np.max(np.abs(run.position - R @ body.com)) < 1e-11
    assert np.allclose(run.omega_world, (R @ omega[..., None])[..., 0], atol=1e-11)
    assert np.allclose(Rotation.from_quat(run.attitude, scalar_first=True).as_matrix(), R, atol=1e-11)
    assert np.ptp([body.energy(body.state(**WHOLE)), *run.energy]) < 1e-11 * np.max(np.abs(run.energy))
    assert all(np.max(error) < 1e-11 for error in body.errors(run.y, R).values())
    assert ("C2" in body.names) is (body is ROUND)


def test_errors_tell_position_from_spin():
    body = WholeBody.of(CASES["bruels"].top)
    y = body.state(rotation=np.eye(3), omega_body=(0, 1, 0))[None]
    spun = Rotation.from_rotvec((0, 0.25, 0)).inv().as_matrix()[None]
    found = body.errors(y, spun)
    assert found["position"][0] < 1e-15
    assert found["rotation"][0] == pytest.approx(0.25) == found["spin"][0]


@pytest.mark.parametrize("name", PUBLISHED)
def test_bruels_as_published_by_the_prototype(name):
    case = CASES["bruels"]
    body = WholeBody.of(case.top)
    y0 = body.state(rotation=case.rotation, omega_body=case.omega_body)
    run = integrate(body, y0, h=1e-4, steps=20_000, method=name)
    errors = body.errors(run.y[-1:], case.solution([2.0]).rotation.as_matrix())
    assert (errors["position"][0], errors["rotation"][0]) == pytest.approx(PUBLISHED[name], rel=0.1)


@pytest.mark.interpreted
def test_rho_damps():
    y0 = SKEW.state(**WHOLE)
    ends = [integrate(SKEW, y0, h=0.1, steps=200, method="generalized_alpha", rho=rho) for rho in (0.5, 1.0)]
    assert ends[0].energy[-1] < ends[1].energy[-1]


@pytest.mark.interpreted
def test_a_step_that_is_not_solved_is_refused():
    with np.errstate(all="ignore"), pytest.raises(StepError, match="not solved after 50 iterations"):
        integrate(SKEW, SKEW.state(**WHOLE), h=50.0, steps=1, method="rattle")
    assert pickle.loads(pickle.dumps(SKEW)) == SKEW
