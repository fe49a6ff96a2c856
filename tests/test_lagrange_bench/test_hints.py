"""Hints of `judge`: a wrong convention, unit or clock, or another body, is named, from whole runs or from their first rows."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_judge import BOX, INTO, OMEGA, M, Q, R, T, X, write

from lagrange_bench import integrate, judge
from lagrange_bench.integrators import CASES, RigidBody


def told(judged):
    return [finding.text for finding in judged.findings]


def texts(found):
    return [finding["text"] for finding in found["findings"]]


SWAPPED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


@pytest.mark.parametrize(
    ("what", "hint"),
    [
        ({"rotation": M.transpose(0, 2, 1)}, "transposed"),
        ({"rotation": R.as_quat()}, "--quat xyzw"),
        ({"rotation": R.inv().as_quat()}, "--quat xyzw. the rotations are transposed"),
        ({"rotation": R, "omega": R.apply(OMEGA)}, "--omega world"),
        ({"rotation": M * [1, 1, -1]}, "determinant is negative"),
        ({"position": X - X[0]}, "name it ux, uy, uz"),
        ({"position": X @ INTO}, "--up=y"),
        ({"rotation": M @ INTO.T}, "--axis=z"),
        ({"position": X * [1, -1, -1]}, "--up=-z"),
        ({"position": 0 * X}, "those of the fixed point"),
        ({"position": X + np.arange(1, 4)}, "off by (1, 2, 3) m: another origin"),
        ({"position": 1e3 * X}, "position is in mm"),
        ({"omega": -OMEGA}, "omega is of the other sign"),
        ({"t": T + 2, "position": 3 * X}, ""),
        ({"rotation": 0 * M + np.eye(3)}, ""),
        ({"position": X * (T[2] != T)[:, None]}, ""),
        ({"position": np.where((T[-9] == T)[:, None], np.nan, X @ INTO)}, "--up=y"),
        (
            {"rotation": SWAPPED @ M, "position": X},
            "the axes of the world have other names: write (y, x, -z) for (x, y, z)",
        ),
        ({"rotation": SWAPPED @ M}, "of the world have other names: write (y, x, -z) for (x, y, z)"),
        (
            {"rotation": R * Rotation.from_rotvec([0, 0.5, 0])},
            "turn the body of the rows by the rotation vector (0, -0.5, 0)",
        ),
        # two rows later the fast spin has made almost this turn
        ({"rotation": R * Rotation.from_rotvec([0, np.pi / 2, 0])}, "the axes (x, y, z) of the body are (z, y, -x)"),
        ({"omega": np.rad2deg(OMEGA)}, "omega is in degrees per second"),
        (
            {"omega": np.rad2deg(R.apply(OMEGA))},
            "--omega world, from Python omega_frame. omega is in degrees per second: --units",
        ),
        ({"t": 1e3 * T, "position": X}, "milliseconds"),
        ({"rotation": np.roll(M, 1, 0)}, "1 row earlier"),
        ({"rotation": R * Rotation.from_rotvec([1e-3, 1e-3, 0])}, ""),
    ],
)
def test_a_wrong_convention_is_named(what, hint):
    what = {name: value[2:-2] for name, value in {"t": T, **what}.items()}
    judged = judge(**what, case="bruels")
    found = " ".join(told(judged))
    assert hint in found
    assert bool(hint) == bool(found)
    assert ("perhaps" in repr(judged)) == bool(hint)


@pytest.mark.parametrize("case", ["middle_axis", "bruels"])
def test_a_wrong_order_of_quaternions_says_nothing_of_omega(case):
    t = np.arange(300) / 60
    exact = CASES[case].solution(t)
    for omega, more in ((exact.omega_body, []), (exact.omega_world, ["--omega world"])):
        order, *others = told(judge(t, rotation=exact.rotation.as_quat(), omega=omega, case=case))
        assert "--quat xyzw" in order
        assert [part in hint for part, hint in zip(more, others, strict=True)] == [True] * len(more)


def test_two_axes_angles_in_degrees_and_the_start_of_another_case_are_named(tmp_path, answer):
    both = judge(T, 1e3 * X @ INTO, case="bruels")
    assert [hint[:18] for hint in told(both)] == ["position is in mm:", "the axis y points "]
    both = judge(T, X @ INTO, INTO.T @ M @ INTO.T, case="bruels")
    assert [hint.partition(":")[2] for hint in told(both)[:2]] == [" --up=y.", " --axis=z."]
    assert judge(T, X @ INTO, INTO.T @ M @ INTO.T, case="bruels", up="y", axis="z").rotation.max < 1e-12
    file = write(tmp_path / "run.csv", "t rx ry rz", T, R.as_euler("XYZ", degrees=True))
    (found,) = answer("judge", file, "--case", "bruels")["files"]
    assert texts(found) == [
        "the angles are in degrees, or about other axes: "
        "--columns angle1=…,angle2=…,angle3=… --angles XYZ --units angle=deg."
    ]
    assert found["remark"].startswith("So read: rotation ")
    file = write(tmp_path / "rpy.csv", "t roll pitch yaw", T, R.as_euler("XYZ", degrees=True))
    (hint,) = texts(answer("judge", file, "--case", "bruels")["files"][0])
    assert hint == "the angles are in degrees, or about other axes: --angles XYZ --units angle=deg."
    (found,) = answer("judge", file, "--case", "bruels", "--angles", "XYZ")["files"]
    assert texts(found) == ["the angles are in degrees, or about other axes: --units angle=deg."]
    (found,) = answer("judge", file, "--case", "bruels", "--angles", "XYZ", "--units", "angle=deg")["files"]
    assert (texts(found), found["rotation"]["max"] < 1e-12) == ([], True)
    assert told(judge(T, X, omega=OMEGA, case="slow")) == ["this is the start of the case bruels."]
    since_1970 = judge(T + 1.7e9, X, case="bruels")
    (hint,) = told(since_1970)
    assert (hint[:50], since_1970.notes) == ("the first row is the start of the case: --t0 0, or", [])
    box = CASES["box"].solution(T).rotation
    (hint,) = told(judge(T, box.apply((0, 0, 0.1)), box, case="box"))
    assert "point (0, 0, 0.1) m of the body" in hint, "no unit makes positions right that should be zero"
    named = write(tmp_path / "named.csv", "t pose.position.x y z q_w q_x q_y q_z", T, X, R.as_quat())
    (found,) = answer("judge", named, "--case", "bruels", "--quat", "xyzw")["files"]
    (hint,) = texts(found)
    way = hint.split("--columns ")[1].rstrip(".")
    (found,) = answer("judge", named, "--case", "bruels", "--columns", way)["files"]
    assert (texts(found), found["rotation"]["max"] < 1e-12) == ([], True), hint
    counted = write(tmp_path / "counted.csv", "t q(1) q(2) q(3) q(4)", T, Q)  # scalar first, as MATLAB has it
    (found,) = answer("judge", counted, "--case", "bruels")["files"]
    assert texts(found) == ["the quaternions are in the other order: --quat wxyz."]
    flying = CASES["flying_box"].solution(5 * T)
    for up, end in ((None, "(x, z, y)."), ("y", "(x, z, y), without --up and --axis.")):
        mirrored = flying.position @ MIRROR, MIRROR @ flying.rotation.as_matrix() @ MIRROR
        (hint,) = told(judge(5 * T, *mirrored, case="flying_box", up=up))
        assert hint.endswith(end), "half a mirror is no axis that points up"
    (hint,) = told(judge(T, X - X[0], case="bruels"))
    assert hint.endswith("name it ux, uy, uz.")
    (note,) = judge(T, OMEGA, case="bruels").notes
    assert "are the columns what they are taken for" in note
    assert judge(T, rotation=R * Rotation.from_rotvec([1e-3, 1e-3, 0]), case="bruels").notes == []
    single = judge(T, X.astype(np.float32), omega=OMEGA.astype(np.float32), case="bruels")
    assert (single.start["right"], single.start["single"], told(single)) == (False, True, [])


def poor(case, h, until=2.0, damping=0.0, cap=np.inf, gyroscopic=True):
    """A run of first order, as engines make it: rows of t, x, R and ω in the world, each a step."""
    body, R, omega = case.body, case.solution([0.0]).rotation.as_matrix()[0], np.array(case.omega_body)
    inertia = body.axes.T @ np.diag(body.inertia) @ body.axes

    def rate(w):
        torque = body.mass * np.cross(body.com, R.T @ body.gravity) - np.cross(w, inertia @ w)
        return np.linalg.solve(inertia, torque if gyroscopic else torque + np.cross(w, body.inertia_com @ w))

    rows = []
    for k in range(round(until / h) + 1):
        rows.append((k * h, R @ body.com, R, R @ omega))
        half = omega + h / 2 * rate(omega)
        new = (omega + h * rate(half)) * math.exp(-h * damping)
        new[1] = math.copysign(min(abs(new[1]), cap), new[1])
        R, omega = R @ Rotation.from_rotvec(h * new).as_matrix(), new
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize(("name", "h", "until"), [("slow", 1 / 60, 2), ("bruels", 1 / 240, 2)])
def test_conventions_of_poor_runs_are_named(name, h, until):
    """Runs that are lost within a second: their first rows tell, or the rows themselves, by q' = q ω/2."""
    t, x, M, omega = poor(CASES[name], h, until)
    right = judge(t, x, M, omega, case=name, omega_frame="world")
    assert right.position.max > 0.01
    # ω is that of the step before: what is left is the method
    assert all("half a step late" in hint for hint in told(right))
    for given, hint in (
        ({"rotation": M.transpose(0, 2, 1)}, "transposed"),
        ({"rotation": Rotation.from_matrix(M).as_quat()}, "--quat xyzw"),
        ({"position": x @ INTO, "rotation": INTO.T @ M}, "--up=y"),
        ({"rotation": M, "omega": omega}, "--omega world"),
    ):
        assert hint in told(judge(t, **given, case=name))[0]


def test_a_transposed_run_from_another_start_is_named():
    box = CASES["box"]
    other = type(box)("other", box.body, box.rotation, (3, 0.5, 2)).solution(BOX.t)
    assert "transposed" in told(judge(BOX.t, rotation=other.rotation.inv(), omega=other.omega_body, case="box"))[0]
    (hint,) = told(judge(BOX.t, rotation=other.rotation, omega=other.omega_body, case="box"))
    assert hint.startswith("the rows start elsewhere")


def test_what_engines_do_to_a_spin_is_named():
    slow = CASES["slow"]
    for engine, words in (
        ({"damping": 0.1}, "exp(−0.1 t): damping?"),
        ({"cap": 4.0}, "from 10 to 4 rad/s in the first step: a cap"),
    ):
        t, x, M, omega = poor(slow, 1 / 60, **engine)
        judged = judge(t, x, M, omega, case=slow, omega_frame="world")
        assert any(words in note for note in judged.notes), judged.notes
        assert judged.spin_rate.max > 1.0
    t, x, M, omega = poor(slow, 1 / 240, gyroscopic=False)
    judged = judge(t, x, M, omega, case=slow, omega_frame="world")
    assert "the program leaves out the gyroscopic torque ω × I ω: an option of many engines." in told(judged)
    lost = np.concatenate((omega[:1], 0 * omega[1:]))
    still = np.concatenate((M[:1], np.repeat(M[:1], len(M) - 1, axis=0)))
    assert any("equal" in note for note in judge(t, rotation=still, omega=lost, case=slow).notes)
    assert "After 2 s, 3.59 turns: axis off by" in judged.summary()[0]
    assert "within 0.1 m until t =" in judged.summary()[1]


CYCLE = np.roll(np.eye(3), -1, 1)
MIRROR = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]])  # y up, as in Unity


@pytest.mark.parametrize("name", ["slow", "bruels"])
def test_another_body_another_clock_and_another_hand_are_named(name):
    case, t = CASES[name], np.arange(0, 2, 1 / 240)
    body, right = case.body, case.solution(np.arange(0, 2, 1 / 240))
    arm = body.mass * (body.com @ body.com * np.eye(3) - np.outer(body.com, body.com))
    about = "about the fixed point were taken for those about the centre of mass"
    changes = ({"gravity": -body.gravity}, "gravity is reversed"), ({"inertia_com": body.inertia_com + arm}, about)
    for change, hint in changes:
        other = RigidBody(**{"mass": body.mass, "com": body.com, "inertia_com": body.inertia_com, **change})
        run = type(case)(name, other, case.rotation, case.omega_body).solution(t)
        for rows in ({"position": run.position}, {"rotation": run.rotation, "omega": run.omega_body}):
            (found,) = told(judge(t, **rows, case=name))
            assert hint in found
    M, mirrored = right.rotation.as_matrix(), {"position": right.position @ MIRROR, "omega": -right.omega_body @ MIRROR}
    for given, hint in (
        ({"t": 1e6 * t}, "microseconds: --units t=us"),
        ({"t": t / 60}, "minutes: --units t=min"),
        ({"position": 1e3 * right.position}, "mm: --units position=mm"),
        ({"omega": case.solution(t - 1 / 480).omega_body}, "half a step late"),
        ({**mirrored, "rotation": MIRROR @ M @ MIRROR}, "left-handed: write (x, z, y)"),
        (
            {"position": right.position @ CYCLE, "rotation": CYCLE.T @ M @ CYCLE, "omega": right.omega_body @ CYCLE},
            "(z, x, y)",
        ),
    ):
        rows = {"t": t, "position": right.position, "rotation": M, "omega": right.omega_body, **given}
        judged = judge(**rows, case=name)
        found = " ".join(told(judged))
        assert hint in found
        assert not any("The times go" in note for note in judged.notes), "the hint says it better"
    still = np.repeat(BOX.omega_body[:1], len(BOX.t), axis=0)
    assert "leaves out the gyroscopic torque" in told(judge(BOX.t, omega=still, case="box"))[0]
    judged = judge(1e4 * BOX.t, rotation=BOX.rotation, omega=BOX.omega_body, body="box")
    assert told(judged) == [], "a clock that no unit names"
    k = CASES["kovalevskaya"].solution(np.linspace(0, 10, 9))
    assert any("No closed form" in note for note in judge(1e6 * k.t, rotation=k.rotation, case="kovalevskaya").notes)


def test_rows_in_which_the_law_breaks_are_told_though_it_holds_in_most():
    """A contact: after 3 of 4 s the body turns half as fast again; the windows that cross it are few."""
    body = RigidBody(mass=1, com=(0, 0, 0), inertia_com=(1, 2, 3), gravity=(0, 0, 0))
    t = np.arange(401) / 100
    free = integrate(body, body.state(rotation=np.eye(3), omega_body=(0.3, 2.0, 0.5)), t=t[:301])
    after = body.state(rotation=free.rotation[-1], omega_body=1.5 * free.omega_body[-1])
    hit = integrate(body, after, t=t[1:101])
    rotation = Rotation.concatenate([free.rotation, hit.rotation])
    omega = np.concatenate([free.omega_body, hit.omega_body])
    assert "in most rows; near t = 3" in judge(t, rotation=rotation, omega=omega, body=body).remark
    right = judge(t[:301], rotation=free.rotation, omega=free.omega_body, body=body)
    assert right.remark.startswith("No cause is found")
    assert "most rows" not in right.remark
