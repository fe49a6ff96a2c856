"""`judge`: whatever a program writes is read in its own convention, and the error that was put in is the one reported."""

import gzip
import json
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench import judge
from lagrange_bench.integrators import CASES, RigidBody, integrate
from lagrange_bench.judging import find
from lagrange_bench.judging import rows as reading_rows

BRUELS = CASES["bruels"]
T = np.linspace(0, 2, 401)
X, R, OMEGA = (motion := BRUELS.solution(T)).position, motion.rotation, motion.omega_body
Q, M = R.as_quat(scalar_first=True), R.as_matrix()
TURNED = Rotation.from_matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # takes y to z, keeps x
INTO = TURNED.as_matrix()
NINE = " ".join(f"r{i}{j}" for i in "123" for j in "123")


def write(path, header, *parts, digits=17):
    rows = np.column_stack(parts)
    np.savetxt(path, rows, fmt=f"%.{digits}g", delimiter=",", header=",".join(header.split()), comments="")
    return path


CONVENTIONS = {
    "quaternions": ("t x y z qw qx qy qz wx wy wz", (X, Q, OMEGA), ()),
    "displacement": ("time u0 u1 u2 q0 q1 q2 q3 wx wy wz", (X - X[0], -Q, R.apply(OMEGA)), ("--omega", "world")),
    "scalar last": ("t e0 e1 e2 e3 wx wy wz", (R.as_quat(), OMEGA), ("--quat", "xyzw")),
    "matrices": (f"t {NINE} wx wy wz", (M.reshape(-1, 9), OMEGA), ()),
    "roll, pitch, yaw": ("t roll pitch yaw", (R.as_euler("xyz"),), ()),
    "y up": (f"t x y z {NINE} wx wy wz", (X @ INTO, (INTO.T @ M).reshape(-1, 9), OMEGA), ("--up", "y")),
    "axis z": (f"t {NINE} wx wy wz", ((M @ INTO.T).reshape(-1, 9), OMEGA @ INTO.T), ("--axis", "z")),
}  # fmt: skip


@pytest.mark.parametrize("name", CONVENTIONS)
def test_the_exact_motion_is_right_in_every_convention(name, tmp_path, answer):
    header, parts, options = CONVENTIONS[name]
    file = write(tmp_path / "run.txt", header, T, *parts)
    (found,) = answer("judge", file, "--case", "bruels", *options)["files"]
    limits = {"position": 1e-14, "axis": 1e-14, "rotation": 1e-12, "spin": 1e-12, "omega": 1e-11, "energy": 1e-9}
    judged = {quantity: found[quantity]["max"] for quantity in limits if quantity in found}
    assert {"position", "rotation"} & set(judged)
    assert all(judged[quantity] < limits[quantity] for quantity in judged), judged
    assert (found["rows"], found["start"]["right"], found["findings"], found["notes"]) == (401, True, [], [])


def test_the_error_that_was_put_in_is_found():
    t, x, attitude, omega = T[::20], X[::20], R[::20], OMEGA[::20]
    spun = judge(t, rotation=attitude * Rotation.from_rotvec([0, 1e-3, 0]), case="bruels")
    assert spun.rotation.max == pytest.approx(1e-3) == spun.spin.end
    assert spun.axis.max < 1e-12
    tilt = attitude * Rotation.from_rotvec([1e-3, 0, 0])
    tilted = judge(t, x + np.array([3e-3, 0, 4e-3]), tilt, omega + np.array([0, 1e-3, 0]), case=BRUELS)
    assert (tilted.axis.max, tilted.position.max) == pytest.approx((1e-3, 5e-3))
    assert tilted.omega.max == pytest.approx(1e-3)
    energy = 0.46875 * (150 * 1e-3 + 1e-6 / 2)  # and m g times how much higher the tilted axis ends
    heights = tilt.apply([0, 1, 0])[:, 2] - x[:, 2]
    assert tilted.energy.max == pytest.approx(np.max(np.abs(energy + 15 * 9.81 * heights)), rel=1e-6)
    assert not tilted.start["right"]
    far = judge([0, 1e-3], position=[[0, 1.25, 0], [0, np.nan, 0]], case="bruels")
    assert (far.length.max, far.length.end, far.start["position"]) == pytest.approx((np.nan, np.nan, 0.25), nan_ok=True)
    assert judge([0.0], [[0, 1.25, 0]], case="bruels").length.max == pytest.approx(0.25)
    scaled = judge(T, rotation=-0.7 * Q, case="bruels")
    assert (scaled.rotation.max < 1e-12, scaled.orthogonality.max) == (True, pytest.approx(0.3))
    sums = np.cumsum(np.full(2_000_000, 1e-6))[999::1000]  # 7e-11 s from where they should be
    late = judge(sums, rotation=BRUELS.solution(np.arange(1, 2001) / 1000).rotation, case="bruels")
    assert (late.rotation.max < 1e-12, late.start["right"]) == (True, None)
    once = judge(t, x + (t == 1)[:, None] * [1e-3, 0, 0], case="bruels")
    assert (once.position.max, once.position.end < 1e-14) == (pytest.approx(1e-3), True)
    assert judge([0.0], X[:1], case="bruels").start["right"]
    assert judge([0.0, 100.0], BRUELS.solution([0.0, 100.0]).position, case="bruels").notes == [], "these are seconds"


def test_all_groups_of_columns_are_judged(tmp_path, answer):
    for header, parts, quantity in (
        (f"t qw qx qy qz {NINE}", (Q, M.transpose(0, 2, 1).reshape(-1, 9)), "rotation"),
        (f"t {NINE} qw qx qy qz", (M.reshape(-1, 9), R.inv().as_quat(scalar_first=True)), "rotation"),
        ("t x y z ux uy uz", (X, X), "position"),
        ("t ux uy uz x y z", (X - X[0], X - X[0]), "position"),
    ):
        file = write(tmp_path / "run.csv", header, T[::20], *(part[::20] for part in parts))
        (found,) = answer("judge", file, "--case", "bruels")["files"]
        assert found[quantity]["max"] > 0.5, header


@pytest.mark.parametrize("factor", [0.0, 1.01, [1, 1, -1]], ids=str)
def test_a_matrix_that_is_no_rotation_violates_every_bound(factor, tmp_path, run):
    file = write(tmp_path / "run.csv", f"t {NINE} wx wy wz", T, (M * factor).reshape(-1, 9), OMEGA)
    names = ("axis", "rotation", "spin", "energy", "momentum")
    words = ("judge", file, "--case", "bruels", "--bounds", ",".join(f"{name}=1e9" for name in names))
    code, out, _ = run(*words)
    assert (code, "The start is right" in out) == (1, False)
    assert [name for name in names if f"{name} is off by nan" not in out] == []
    coarse = write(tmp_path / "coarse.csv", f"t {NINE}", T[::20], M[::20].reshape(-1, 9), digits=2)
    assert run("judge", coarse, "--case", "bruels", "--bounds", "rotation=0.03")[0] == 0, "few digits are a rotation"


def test_spin_at_half_a_turn():
    for angle in np.pi - np.array([0, 1e-16, 1e-12, 1e-8, -1e-8, 1e-3]):
        for spun in (R * Rotation.from_rotvec([0, angle, 0]), -M * [1, -1, 1]):
            judged = judge(T[::20], rotation=spun[::20], case="bruels")
            assert judged.spin.max == pytest.approx(min(angle, 2 * np.pi - angle), abs=2e-3), angle


FILES = {  # what is in it → exit code, what is said
    "x" * 2_000_000: (2, "there is no line of numbers in it"),
    "t,a,b\n0,1,2": (2, "angular velocity. Its columns are t a b. Name them: --columns x=1"),
    "t,x,y,z\n0,0,foo,0": (2, "line 2: 'foo' is no number"),
    "t,x,y,z\n0,0,1,0\n1,0,1,0\n.5,0,1,0": (2, "row 3: the time is 0.5 after 1; times must be numbers that increase"),
    "t,x,y,z\n1e300,0,1,0": (2, "perhaps the times are no seconds, or start elsewhere: --units t=ns, --t0 0"),
    "t\tx\ty\tz\n\n0\t0\t1\t0 # start\r\n0.1\t\t1\t0\r\n": (0, "1 of 2 rows have a number that is missing"),
    "t,qw,qx,qy,qz\n0,0,0,0,0": (0, "1 of 1 rows have a number that is missing or not finite, a matrix or quaternion"),
    "t,x,y,z\n0,0,1,0\n0.1,0,1,0": (0, "The last row is at t = 0.1 s; the case runs to 2 s."),
    "t [ms],x (mm),y (mm),z (mm)\n0,0,1000,0": (0, "is right, as far as the file says: it has no angular velocity."),
    gzip.compress(b"t,x,y,z\n0,0,1,0\n", mtime=0)[:-9]: (2, "run.csv: Compressed file ended before"),
}


@pytest.mark.parametrize("text", FILES, ids=lambda text: repr(text[:30]))
def test_whatever_a_file_holds_gets_a_clear_line(text, tmp_path, run):
    (tmp_path / "run.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    code, out, err = run("judge", tmp_path / "run.csv", "--case", "bruels")
    expected, said = FILES[text]
    assert (code, said in (out if code == 0 else err)) == (expected, True), out + err
    assert err.count("\n") == err.count("run.csv") == (1 if code else 0)


def test_bounds_json_digits_and_a_picture(tmp_path, run, answer):
    six = write(tmp_path / "six.csv", "t x y z", T, X, digits=6)
    code, out, err = run("judge", six, "--case", "bruels", "--bounds", "position=1e-5", "--draw", tmp_path / "a.svg")
    assert (code, "nothing of errors below 1.0e-06 m" in out) == (0, True)
    assert (tmp_path / "a.svg").stat().st_size > 1000
    code, out, _ = run("judge", six, "--case", "bruels", "--bounds", "position=1e-9", "--json")
    data = json.loads(out)
    assert (code, len(data["violated"]), data["case"]) == (1, 1, "bruels")
    assert data["orders"] == {"position": []}
    assert data["files"][0]["position"]["max"] == pytest.approx(7e-7, rel=0.3)
    half = write(tmp_path / "half.csv", "t x y z", T[::2], X[::2], digits=6)
    assert answer("judge", six, half, "--case", "bruels")["orders"] == {"position": [None]}
    assert "order" not in run("judge", six, six, "--case", "bruels")[1]  # equal steps tell none
    assert "give their steps" in run("judge", six, six, half, "--case", "bruels")[1]
    gap = write(tmp_path / "gap.csv", "t x y z", T[:2], [X[0], X[1] * np.nan])
    early = write(tmp_path / "early.csv", "t x y z", T[:9], X[:9])
    wild = write(tmp_path / "wild.csv", "t x y z wx wy wz", T, X, OMEGA + (T == 1)[:, None] * np.nan)
    for file, until, code, said in (
        (gap, "0.005", 1, "position is off by nan"),
        (early, "2", 1, "the last row is at t = 0.04, before 2 s"),
        (early, "0.055", 1, "the last row is at t = 0.04, before 0.055 s"),
        (early, "0.04", 0, "All errors are within the bounds."),
        (wild, "2", 1, "omega, spin rate cannot be measured: a number is not finite"),
    ):
        words = run("judge", file, "--case", "bruels", "--bounds", "position=9", "--until", until)
        assert (words[0], said in words[1]) == (code, True), words
    assert run("judge", early, "--case", "bruels", "--bounds", "position=9")[0] == 1
    assert answer("judge", gap, "--case", "bruels")["files"][0]["position"] == dict.fromkeys(("max", "end", "growth"))
    end, start = os.pipe()
    os.write(start, b"t,x,y,z\n0,0,1,0\n")
    os.close(start)
    code, _, err = run("judge", f"/dev/fd/{end}", "--case", "bruels")
    assert (code, "a pipe cannot be read twice" in err) == (2, True)


@pytest.mark.parametrize("head", [1 << 18, 1 << 12], ids=["line by line", "pandas"])
def test_no_row_of_a_long_file_is_lost(head, tmp_path, answer, monkeypatch):
    """The largest error is one of all rows; a row that is equal to the one before counts once."""
    n = 101
    rows = np.repeat(np.arange(n), np.where(np.isin(np.arange(n), (6, 7, 49, 100)), 2, 1))
    off = 1e-3 * (np.arange(n) == 79)[:, None]
    x = X[:n] + off - np.where(np.arange(n) == 50, np.nan, 0)[:, None]
    file = write(tmp_path / "run.csv", "t x y z qw qx qy qz wx wy wz", T[rows], x[rows], Q[rows], OMEGA[rows])
    step = write(tmp_path / "step.csv", "x y z", X[:n])
    rows_of = "\n".join(
        f"{label},{','.join(map(str, (t, *x)))}"
        for t, x in zip(T[:n].tolist(), X[:n].tolist(), strict=True)
        for label in ("top", "", "NA")  # words that pandas takes for a missing number
    )
    (tmp_path / "bodies.csv").write_text(f"body,t,x,y,z\n{rows_of}", encoding="utf-8")
    monkeypatch.setattr(reading_rows, "HEAD", head)
    (top,) = answer("judge", tmp_path / "bodies.csv", "--case", "bruels", "--where", "body=top")["files"]
    assert (top["rows"], top["position"]["max"] < 1e-14) == (n, True)
    (whole,) = answer("judge", file, "--case", "bruels", "--t0", "0")["files"]
    (bare,) = answer("judge", step, "--case", "bruels", "--step", "0.005")["files"]
    assert (whole["rows"], bare["position"]["max"] < 1e-14) == (n, True)
    assert whole["notes"][0] == "4 rows are equal to the one before, and left out."
    assert "1 of 101 rows have a number that is missing" in whole["notes"][2]
    late = judge(T[:n], X[:n] + off, R[:n], case="bruels")
    assert (late.position.max, late.rows) == (pytest.approx(1e-3 * 3**0.5), n)
    assert late.curves["position"][0] == pytest.approx(T[:n], abs=1e-15)


def test_of_times_near_decimals_the_better_reading_counts():
    thirds = np.arange(361) / 60
    assert judge(thirds, rotation=BRUELS.solution(thirds).rotation, case="bruels").rotation.max < 1e-12
    t = np.linspace(0, 2, 201) * (1 + 4e-11)
    exact, nearly = (
        judge(t, rotation=BRUELS.solution(at).rotation, case="bruels") for at in (t, np.linspace(0, 2, 201))
    )
    assert (exact.rotation.max < 1e-12, exact.notes) == (True, [])
    assert nearly.rotation.max < 1e-12
    assert "The times are taken for the decimals near to them, by up to 8.0e-11 s" in nearly.notes[0]


def test_times_of_few_digits_hide_errors(tmp_path, answer, run):
    """In four digits they are off by up to 5e-5 s, in which the body turns by 0.0075 rad."""
    t = np.arange(40) / 750
    rows = zip(t, BRUELS.solution(t).position.tolist(), strict=True)
    lines = [f"{time:.4f},{x!r},{y!r},{z!r}" for time, (x, y, z) in rows]
    (tmp_path / "run.csv").write_text("\n".join(["t,x,y,z", *lines]))
    (found,) = answer("judge", tmp_path / "run.csv", "--case", "bruels")["files"]
    assert "The times are rounded by 5.0e-05 s, which hides errors of position." in found["notes"]
    assert 1e-6 < found["position"]["max"] < found["floor"]["position"]
    out = run("judge", tmp_path / "run.csv", "--case", "bruels")[1]
    assert f"say nothing of errors below {found['floor']['position']:.1e} m (position)." in out


def test_a_case_of_ones_own_is_named_by_its_module(folder):
    words = "from lagrange_bench import CASES\nCASE = CASES['bruels']\nOTHER = 5\n"
    (folder / "my_own_case.py").write_text(words, encoding="utf-8")
    assert judge(T, X, case="my_own_case:CASE").position.max < 1e-12
    for name, message in (("my_own_case:NONE", "cannot be loaded"), ("my_own_case:OTHER", "not a lagrange_bench.Case")):
        with pytest.raises(ValueError, match=message):
            judge(T, X, case=name)


MOLECULE = """
mass = 1.3e-25
inertia_com = ["1.46e-45", "1.46e-45", "2.92e-45"]
gravity = [0, 0, 0]
omega_body = ["1e12", "2e12", "3e12"]
until = 4e-13
every = 1e-14
"""


def test_any_body_is_judged(tmp_path):
    """Free, flying, heavy without symmetry; a molecule, whose times are nothing to a second; a case in a file."""
    (tmp_path / "molecule.toml").write_text(MOLECULE)
    for name in ("box", "flying_box", "kovalevskaya", "middle_axis", str(tmp_path / "molecule.toml")):
        case = find(name)
        t = np.linspace(0.0, case.until, 9)
        exact = case.solution(t)
        right = judge(t, exact.position, exact.rotation, exact.omega_body, case=case)
        assert right.start["right"] is True
        assert max(right.rotation.max, right.omega.max / np.max(np.abs(case.omega_body))) < 1e-14
        assert right.momentum.max < 1e-13 * np.max(np.linalg.norm(exact.momentum, axis=1))
        assert ("spin" in right.errors) is (case.body.axis is not None)
        turned = exact.rotation * Rotation.from_rotvec((0.0, 1e-5, 0.0))
        assert judge(t, rotation=turned, case=case).rotation.max == pytest.approx(1e-5, rel=1e-6)
    assert judge(t[:-1], rotation=exact.rotation[1:], case=case).start["right"] is False
    flown = CASES["flying_box"].solution([0.0, 1.0]).position + np.array((0, 0, 1e-3))
    assert judge([0.0, 1.0], flown, case="flying_box").position.max == pytest.approx(1e-3)


BOX = CASES["box"].solution(np.arange(0, 5, 1 / 240))
SPIN = BOX.rotation.apply(BOX.omega_body)


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ({}, ""),
        ({"omega": SPIN}, "--omega world"),
        ({"omega": SPIN, "omega_frame": "world"}, ""),
        ({"rotation": BOX.rotation.as_quat(), "omega": SPIN, "omega_frame": "world"}, "--quat xyzw"),
        ({"t": 1e3 * BOX.t}, "--units t=ms"),
    ],
)
def test_a_body_without_a_start_is_judged_by_itself(given, hint):
    """By what its motion keeps, and by q' = q ω/2; `first-row` adds the exact motion."""
    rows = {"rotation": BOX.rotation, "omega": BOX.omega_body, **given}
    judged = judge(rows.pop("t", BOX.t), **rows, body="box")
    assert hint in ([finding.text for finding in judged.findings] or [""])[0]
    assert len(judged.findings) == bool(hint)
    assert (judged.start, "rotation" in judged.errors) == ({}, False)
    if not hint:
        assert (judged.kinematics.max < 1e-5, judged.energy.max < 1e-15, judged.momentum.max < 1e-15) == (True,) * 3
        assert judge(BOX.t + 7, **rows, case="box", start="first-row").rotation.max < 1e-13
        turned = (BOX.rotation[:-1].inv() * BOX.rotation[1:]).magnitude().sum()
        assert judged.turns == pytest.approx(turned / (2 * np.pi), rel=1e-4)
    else:
        assert judged.kinematics.max > 1e-3


def test_drifts_of_a_body_without_a_start():
    """Their size, what they grow like, and the flight."""
    t = np.arange(1, 2001) / 100
    box, flying = CASES["box"].solution(t), CASES["flying_box"].solution(t)
    for power, words in ((1, "t"), (0, "bounded"), (2, "t^2"), (0.5, "t^0.5, a random walk")):
        grown = 1e-11 * t[:, None] ** power * np.cos(50 * t[:, None])
        judged = judge(t, omega=box.omega_body * (1 + grown), body="box")
        assert judged.grows("energy") == words
        assert judged.growth("energy") == pytest.approx(power, abs=0.1)
        share = judged.momentum.end / judged.sizes["momentum"]
        assert f"momentum off by {share:.1e} of its size" in judged.summary()[0]
    for start in ({"body": "flying_box"}, {"case": "flying_box", "start": "first-row"}):
        for offset in (0.0, 1e-3):
            x = flying.position + offset * np.cos(t)[:, None]
            judged = judge(t, x, flying.rotation, flying.omega_body, **start)
            assert judged.position.max == pytest.approx(1.7 * offset, rel=0.3, abs=1e-11)
    off = RigidBody(1, (0, 1.5, 0), (1, 2, 2))
    leans = judge(t[:9], box.rotation.apply([0, 1, 0])[:9], box.rotation[:9], box.omega_body[:9], body=off)
    assert leans.position.max == pytest.approx(0.5)


def test_what_starts_and_bodies_need(tmp_path, run):
    (tmp_path / "mine.toml").write_text("mass = 1\ninertia_com = [1, 2, 2.5]\ngravity = [0, 0, 0]\n")
    write(tmp_path / "run.csv", "t qw qx qy qz wx wy wz", [3, 4], [[1, 0, 0, 0]] * 2, [[0, 0, 2.0]] * 2)
    write(tmp_path / "bare.csv", "t qw qx qy qz", [3, 4], [[1, 0, 0, 0]] * 2)
    mine, other = tmp_path / "mine.toml", tmp_path / "other.toml"
    other.write_text("mass = 1\ninertia = [1, 2, 2]\nomega_body = [0, 0, true]")
    for words, code, said in (
        (("run.csv", "--case", other), 2, "omega_body must be numbers"),
        (("run.csv", "--case", "box", "--axis", "z"), 2, "--axis is of no use"),
        (("run.csv", "--body", mine, "--bounds", "energy=1e-12"), 0, "All errors are within the bounds."),
        (("run.csv", "--case", mine), 2, "omega_body is missing"),
        (("run.csv", "--case", mine, "--start", "first-row"), 0, "The motion starts at t = 3 s as the first row does."),
        (("bare.csv", "--case", mine, "--start", "first-row"), 2, "needs a rotation and an angular velocity"),
        (("run.csv", "--body", mine, "--start", "first-row"), 2, "for --start first-row give a case"),
        (("run.csv",), 2, "one of the arguments --case --body is required"),
    ):
        found = run("judge", tmp_path / words[0], *words[1:])
        assert (found[0], said in found[1] + found[2]) == (code, True), found
    with pytest.raises(ValueError, match="one of the two"):
        judge([0], omega=[[1, 2, 3]])
    with pytest.raises(ValueError, match="start must be one of case, first-row, fit"):
        judge([0], omega=[[1, 2, 3]], case="box", start="last-row")


def test_a_start_is_found_by_the_rows(tmp_path, answer):
    """ω alone of a free body; a fit of noisy rows, which the first row misses; rotations alone."""
    free, t = CASES["brick"], np.arange(200) / 50
    right = free.solution(t)
    alone = judge(t + 3, omega=right.omega_body, case="brick", start="first-row")
    assert (alone.omega.max < 1e-12, list(alone.errors)) == (True, ["omega", "energy", "momentum"])
    noise = np.random.default_rng(1).normal(size=(3, 200, 3))
    noisy = {
        "rotation": right.rotation * Rotation.from_rotvec(1e-3 * noise[0]),
        "omega": right.omega_body + 1e-2 * noise[1],
    }
    first, fit = (judge(t, **noisy, case="brick", start=start) for start in ("first-row", "fit"))
    assert fit.rotation.max < 0.02 < 0.05 < first.rotation.max
    assert "so that it fits the first 50 rows best; these are off by 0.0" in fit.notes[0]
    assert fit.notes[0].endswith("from row to row: noise.")
    smooth = judge(t, rotation=right.rotation, case="brick", start="fit")
    assert (smooth.rotation.max < 1e-9, "noise" in smooth.notes[0]) == (True, False)
    with pytest.raises(ValueError, match="the first row needs a rotation and an angular velocity"):
        judge(t, omega=right.omega_body, case="bruels", start="first-row")
    file = write(tmp_path / "run.csv", "t wx wy wz", t, right.omega_body + np.where(t < 1, 5.0, 0)[:, None])
    words = ("--case", "brick", "--start", "first-row", "--from", "1", "--until", "3")
    (found,) = answer("judge", file, *words)["files"]
    assert (found["rows"], found["omega"]["max"] < 1e-12) == (101, True)


def test_a_momentum_is_an_angular_velocity(tmp_path, answer):
    """In the world, in the body, or times 2 q as in molecular dynamics."""
    box, t = CASES["box"], np.arange(50) / 20
    motion = box.solution(t)
    q, L = motion.rotation.as_quat(scalar_first=True), motion.momentum
    in_body = motion.rotation.inv().apply(L)
    w, v = q[:, :1], q[:, 1:]
    p = 2 * np.hstack([-np.sum(v * in_body, 1, keepdims=True), w * in_body + np.cross(v, in_body)])
    for names, values, words in (
        ("Lx Ly Lz", L, ()),
        ("L_body_x L_body_y L_body_z", in_body, ()),
        ("Lx Ly Lz", in_body, ("--omega", "body")),
        ("angmom[0] angmom[1] angmom[2] angmom[3]", p, ()),
    ):
        file = write(tmp_path / "run.csv", f"t qw qx qy qz {names}", t, q, values)
        (found,) = answer("judge", file, "--case", "box", *words)["files"]
        assert (found["omega"]["max"] < 1e-13, found["findings"]) == (True, []), names
    file = write(tmp_path / "lengths.csv", "t qw qx qy qz", t, q)
    (found,) = answer("judge", file, "--body", "box")["files"]
    assert "There is neither a rotation nor ω" not in found["notes"]
    lever = write(tmp_path / "lever.csv", "t x y z", T, X)
    (found,) = answer("judge", lever, "--body", "bruels")["files"]
    assert found["notes"] == ["There is neither a rotation nor ω: nothing but lengths is judged."]


def test_a_path_and_masked_arrays_are_judged(tmp_path):
    file = write(tmp_path / "run.csv", "t qx qy qz qw wx wy wz", T, R.as_quat(), np.rad2deg(OMEGA))
    judged = judge(file, case="bruels", units={"omega": "deg/s"}, until=1.0)
    assert (judged.rotation.max < 1e-12, judged.omega.max < 1e-10, judged.span[1]) == (True, True, 1.0)
    assert judge(str(file), case="bruels").findings[0].option == "--units omega=deg/s"
    for wrong, says in (
        ({"t": file, "position": X}, "has its own positions"),
        ({"t": T, "omega": OMEGA, "t0": 0.0}, "t0 is for"),
    ):
        with pytest.raises(ValueError, match=says):
            judge(**wrong, case="bruels")
    masked = np.ma.masked_array(OMEGA, mask=(T == 1)[:, None] * np.ones(3, bool))
    assert np.isnan(judge(T, omega=masked, case="bruels").omega.max)
    tiny = Q * np.where(T == 1, 1e-320, 1)[:, None]
    assert "1 of 401 rows have" in judge(T, rotation=tiny, case="bruels").notes[0]


def test_orders_say_why_there_is_none(tmp_path, run):
    """At round-off, and where errors are as large as they can be; while rotations are near, energies have orders, too."""
    body, y0 = CASES["box"].body, CASES["box"].state
    files = [integrate(body, y0, 5 / n, n, "rk4", every=1).save(tmp_path / f"{n}.csv") for n in (2000, 4000)]
    assert "order of omega, from the largest step to the smallest: 4.0" in run("judge", *files, "--case", "box")[1]
    exact = CASES["box"].solution(np.linspace(0, 5, 401)).rotation
    for name, sizes, says in (
        ("round-off", (1e-14, 1e-14), "order of rotation, from the largest step to the smallest: none, at round-off"),
        ("half-way", (0.2, 0.1), "to the smallest: 1.00\nThese are the orders until t = 2.5"),
        ("lost", (3.1, 3.1), "none, the errors are as large as they can be"),
    ):
        files = []
        for k, error in enumerate(sizes):
            late = np.where(np.arange(401) > 200, 3.0, error) * (np.arange(401) > (0 if name != "lost" else -1))
            rows = (exact * Rotation.from_rotvec(np.outer(late, [1, 0, 0]))).as_quat(scalar_first=True)
            files.append(write(tmp_path / f"{name}{k}.csv", "t qw qx qy qz", np.linspace(0, 5, 401), rows))
        out = run("judge", *files, "--case", "box", "--steps", "0.01,0.005")[1]
        assert says in out, out
    assert "The rotation is lost after 0 s: it is off by up to half a turn." in out
    assert "These are the orders" not in out


def test_a_fall_in_another_direction_grows_like_t_squared():
    flying, t = CASES["flying_box"], np.linspace(0, 5, 251)
    turned = flying.solution(t).position @ INTO
    judged = judge(t, turned, body="flying_box")
    assert judged.grows("position") == "t^2"
    assert "--up=y" in judged.findings[0].option
    assert "position off by" in judged.summary()[0]


OWN = """
mass = 2
com = [0, 0, 0.5]
inertia = [0.9, 0.8, 0.1]
angles = [0.3, "0.9", 0]
axes = "ZXZ"
omega_body = [0, 1, 2]
title = "a\\rb"
"""


def test_a_case_of_ones_own_may_give_moments_about_the_pivot_and_angles(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(OWN.replace("\\\\", "\\"))
    case = find(file)
    assert np.diag(case.body.inertia_com) == pytest.approx([0.4, 0.3, 0.1])
    assert case.body.inertia == pytest.approx([0.9, 0.8, 0.1])
    assert Rotation.from_matrix(case.rotation).as_euler("ZXZ") == pytest.approx([0.3, 0.9, 0])
    assert case.title == "a b"
    (row,) = case.digits(["0"], 15)
    assert [float(v) for v in row[1:4]] == pytest.approx(case.solution([0.0]).position[0], abs=1e-14)
    for old, new, says in (
        ("mass = 2", "mass = true", "mass must be a number; got True"),
        ("mass = 2", "mass = 2\nuntil = -1", "until must be positive"),
        ("mass = 2", "mass = 2\nevery = 0", "every must be positive"),
        ("mass = 2", "mass = 2\ninertia_com = [1, 1, 1]", "give inertia or inertia_com, not both"),
        ('axes = "ZXZ"', "", "angles need their axes"),
        ("mass = 2", "mass = 2\npoints = [[1, 0, 0]]", "points must be three or more places"),
        ('angles = [0.3, "0.9", 0]\naxes = "ZXZ"', "quaternion = [0, 0, 0, 0]", "quaternion must not be zero"),
    ):
        file.write_text(OWN.replace(old, new))
        with pytest.raises(ValueError, match=says):
            find(file)


def test_a_start_is_judged_by_the_digits_of_its_own_row(tmp_path, answer):
    """Of a run that blows up the last numbers have no digits after the point."""
    omega = np.array([[0, 13, -4.61537981033], *(np.array([[1.23456789123, 9.9, 3]]) * 50.0 ** np.arange(12)[:, None])])
    file = write(tmp_path / "run.csv", "t wx wy wz", np.arange(13) / 60, omega, digits=12)
    start = answer("judge", file, "--case", "slow")["files"][0]["start"]
    assert (start["right"], start["omega"]) == (False, pytest.approx(3.0))
