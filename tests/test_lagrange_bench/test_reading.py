"""Trajectory files as programs write them: each is read right, or refused in a line that says what to do."""

import bz2
import gzip
import json
import lzma
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import constants
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES, integrate
from lagrange_bench.judging import names
from lagrange_bench.judging.columns import read
from lagrange_bench.judging.frames import Options
from lagrange_bench.judging.names import unit_of
from lagrange_bench.judging.rows import number

T = np.arange(12) / 10
X = np.stack([np.cos(T), np.sin(T), 0.3 - T], 1)
R = Rotation.from_rotvec(np.stack([0.2 + T, 1 - T, 0.5 * T**2], 1))
Q, M, V, DEG = R.as_quat(scalar_first=True), R.as_matrix().reshape(-1, 9), R.as_rotvec(), 180 / np.pi
W = np.stack([1 + T, 2 - T, 3 * T], 1)
RIGHT = {"time": T[:, None], "position": X, "quaternion": Q, "matrix": M, "rotation vector": V, "omega": W}
K = np.arange(12)


def table(header, *parts, separator=",", number="{:.17g}", end="\n"):
    rows = np.column_stack(parts)
    lines = [separator.join(number.format(value) for value in row) for row in rows]
    return end.join([*([header] if header else []), *lines, ""])


def check(path, how=None, groups=("position",)):
    layout = read(path, how)
    rows = layout.arrays
    if layout.quat == "xyzw":
        rows["quaternion"] = np.roll(rows["quaternion"], 1, axis=1)
    if "angles" in rows:
        rows["rotation vector"] = Rotation.from_euler(how.angles, rows.pop("angles")).as_rotvec()
    assert set(rows) == {"time", *groups}, layout.columns
    for kind, values in rows.items():
        assert values == pytest.approx(RIGHT[kind], abs=2e-9), kind
    return layout


# program | names | the numbers below them | what the user says; d… is in degrees
FORMS = """
Rapier | t translation.~xyz rotation.~xyzw angvel.~xyz | t x xyzw w |
Babylon | time position._~xyz rotationQuaternion._~xyzw | t x xyzw |
Unity, angles | Time eulerAngles.~yxz | t dYXZ | angles=YXZ units=angles:deg
Godot | t origin.~xyz quaternion.~xyzw linear_velocity.~xyz angular_velocity.~xyz | t x xyzw - w |
MuJoCo, free joint | time qpos[*]~0123456 qvel[*]~012345 | t x wxyz - w |
MuJoCo, ball joint | time qpos_~0123 qvel_~012 | t wxyz w |
Drake | time top_q~wxyz top_~xyz top_w~xyz top_v~xyz | t wxyz x w - |
ROS 2 | header.stamp.sec header.stamp.nanosec pose.position.~xyz orientation.~xyzw angular.~xyz | sec nanosec x xyzw w | t0=0
rostopic | %time field.header.stamp field.pose.position.~xyz field.pose.orientation.~xyzw | ns ns x xyzw | units=t:ns
PlotJuggler | __time /pose/pose/position/~xyz /pose/pose/orientation/~wxyz /pose/covariance[*]~012 | t x wxyz - |
TUM | #timestamp t~xyz q~xyzw | t x xyzw |
EuRoC | #timestamp[ns] p_RS_R_*[m]~xyz q_RS_*[]~wxyz v_RS_R_*[m/s]~xyz b_w_RS_S_*[rad/s]~xyz | ns x wxyz - - |
OpenSim | top¶inDegrees=yes¶endheader¶time top_~XYZ roll pitch yaw | t x dxyz | angles=xyz
Vicon | Trajectories¶10¶,,top:M1,,¶Frame Sub-Frame X Y Z¶,,mm,mm,mm | k k mm | step=0.1
TRC | PathFileType,4,(X/Y/Z),a.trc¶10,m¶Frame#,Time,M1,,¶,,X1,Y1,Z1 | k t x |
Basilisk | time[ns] sigma_BN[*]~012 omega_BN_B[*]~012 r_BN_N[*]~012 | ns mrp w x |
JSBSim | Time /fdm/velocities/*-rad_sec~pqr /fdm/attitude/*-rad~phi,theta,psi | t w rxyz | angles=ZYX
JSBSim, degrees | Time P_(deg/s) Q_(deg/s) R_(deg/s) Psi_(deg) Theta_(deg) Phi_(deg) | t dw dZYX | angles=ZYX
GMAT | Sat.ElapsedSecs Sat.EarthMJ2000Eq.~XYZ Sat.Q~1234 Sat.AngularVelocity~XYZ | t mm xyzw dw | units=position:mm,omega:deg/s
Adams | Time .top.CM_Position.~XYZ .top.CM_Angular_Velocity.~XYZ | t x w |
Modelica | "time" "body.w_a[*]"~123 "body.Q[*]"~1234 | t w xyzw |
MATLAB | t pos_~123 omega_~123 | t x w |
Xsens | // Start Time: 12¶PacketCounter SampleTimeFine Quat_q~0123 Gyr_~XYZ Acc_~XYZ | k t wxyz w - |
pandas | ,t x y z | k t x |
axis and angle | t axis_~xyz angle[deg] | t v dangle |
a rotation vector in degrees | t r~xyz | t dv | units=angles:deg
vector r beside a quaternion | t r_~xyz q~wxyz | t x wxyz |
vector r of a robot | t ~xyz r~xyz | t x v |
vector r that changes its length | t r_~xyz w_~xyz | t v w |
Isaac Lab | time root_pos_w_~xyz root_quat_w_~wxyz root_ang_vel_b_~xyz root_lin_vel_w_~xyz | t x wxyz w - |
Modelica, position | time body.r_0[*]~123 body.frame_a.R.T[*]~11,12,13,21,22,23,31,32,33 | t x m |
Simulink | time q_1_~1234 w:1(*)~123 | t xyzw w |
Julia | t q*~₀₁₂₃ ω*~₁₂₃ | t wxyz w |
Gazebo | sec nsec ~x,y,z | sec nanosec x | t0=0
Euler parameters | Time p*[-]~0123 om*[deg/s]~xyz | t wxyz dw |
Bullet | step t ori.~xyzw ang.~xyz up.~xyz | k t xyzw - - |
others beside | t wb_~xyz domega_~xyz wdot_~xyz mag_~xyz x_true y_true z_true | t w - - - - |
Webots | time translation_~xyz rotation_~xyz rotation_angle[deg] | t x v dangle |
PyBullet | time pos[*]~012 orn[*]~0123 | t x wxyz |
Euler | t phi theta psi | t dZXZ | angles=ZXZ units=angles:deg
Chrono, local axes | t ~x,y,z e~0123 w*_loc~xyz | t x wxyz w |
omega of one run of two | t w*_sim~xyz w*_ref~xyz | t w - |
speeds | t AVel~XYZ Vel~XYZ | t w - |
NASA 42 | tout qbn~1234 RotSpeed~XYZ | t xyzw w |
PX4 | timestamp timestamp_sample q[*]~0123 | ns ns wxyz | units=t:ns
Maya | t translate~XYZ rotate~XYZ | t x dxyz | angles=xyz units=angles:deg
angles by axes | t theta_~xyz | t dxyz | angles=xyz units=angles:deg
angles beside a quaternion | t q~wxyz roll pitch yaw | t wxyz - |
nine of a matrix | t R~012345678 | t m |
matrix by letters | t Rx~xyz Ry~xyz Rz~xyz | t m |
units in names | time_ns ~x_mm,y_mm,z_mm ~wx_deg_s,wy_deg_s,wz_deg_s | ns mm dw |
words for units | Elapsed_(nanoseconds) X{mm} Y{mm} Z{mm} ~wx(rpm),wy(rpm),wz(rpm) | ns mm rpm |
two bodies aside | t top.~xyz base.~xyz | t x - | where=body:top
columns given | a b c d | t x | columns=t:a,x:1,y:c,z:d
columns given beside others | t position.~xyz a b c | t - x | columns=x:a,y:b,z:c
a late clock | t x y z | late x | t0=0
OpenFOAM | t centreOfRotation[*]~012 centreOfMass[*]~012 rotation[*]~012 omega[*]~012 | t - x rxyz w | angles=xyz
gyro of a phone | t g~xyz q~wxyz | t w wxyz |
angles of a molecule | t theta phi chi | t dtheta | angles=ZXZ units=angles:deg
a unit of 1 | t_{s} q*_{1}~wxyz *_{m}~xyz | t wxyz x |
rows of a step | Step ~x,y,z | ks x | step=0.1
a time stamp | header.stamp.secs header.stamp.nsecs ~x,y,z | sec nanosec x | t0=0
no names | | t x | columns=t:0,x:1,y:2,z:3
"""
NUMBERS = {"t": T, "k": K, "ns": K * 1e8, "sec": 1700000000 + K // 10, "nanosec": K % 10 * 1e8, "late": 1700 + T}
NUMBERS |= {
    "x": X,
    "mm": 1e3 * X,
    "-": X - W,
    "w": W,
    "dw": W * DEG,
    "rpm": W * 30 / np.pi,
    "m": M,
    "v": V,
    "dv": V * DEG,
}
NUMBERS |= {"wxyz": Q, "xyzw": R.as_quat(), "mrp": R.as_mrp(), "rxyz": R.as_euler("xyz"), "dangle": R.magnitude() * DEG}
NUMBERS |= {"dtheta": R.as_euler("ZXZ", degrees=True)[:, [1, 0, 2]], "ks": 20 * K}
NUMBERS |= {f"d{axes}": R.as_euler(axes, degrees=True) for axes in ("xyz", "YXZ", "ZYX", "ZXZ")}
VECTOR = dict.fromkeys(("dtheta", "v", "dv", "mrp", "rxyz", "dxyz", "dYXZ", "dZYX", "dZXZ"), "rotation vector")
GROUP = {**VECTOR, "x": "position", "mm": "position", "w": "omega", "dw": "omega", "rpm": "omega", "m": "matrix"}
GROUP |= {"wxyz": "quaternion", "xyzw": "quaternion"}


def header(text):
    """a.~xyz is a.x, a.y, a.z, and a[*]~01 is a[0], a[1]."""
    words = []
    for word in text.split(" "):
        stem, tilde, ends = word.partition("~")
        ends = ends.split(",") if "," in ends else ends
        words += [stem.replace("*", end) if "*" in stem else stem + end for end in ends] if tilde else [word]
    return ",".join(words)


@pytest.mark.parametrize("form", FORMS.strip().split("\n"), ids=lambda form: form.split(" |")[0])
def test_a_file_of_a_program_is_read_right(form, tmp_path):
    _, words, parts, said = (word.strip() for word in form.split("|"))
    options = dict(word.split("=") for word in said.split())
    for name in options.keys() - {"angles"}:
        value = options[name]
        options[name] = dict(pair.split(":") for pair in value.split(",")) if ":" in value else float(value)
    lines = [header(line) if " " in line else line for line in words.split("¶")]
    text = table("\n".join(lines) if words else "", *(NUMBERS[part] for part in parts.split()))
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    check(tmp_path / "run.csv", Options(**options), {GROUP[part] for part in parts.split() if part in GROUP})


PLAIN = "t,x,y,z"
ROWS = list(zip(T.tolist(), X.tolist(), strict=True))


def lines(header, row):
    return "\n".join([header, *(row.format(t, *x) for t, x in ROWS), ""])


FRAME, PANDAS = pd.DataFrame(np.column_stack((T, X)), columns=list("txyz")), ("columns", "index", "split", "table")
WAYS = {  # how text is written → the bytes of the file
    "tabs, one at the end": lambda: table("t\tx\ty\tz", T, X, separator="\t", end="\t\n").replace("z\t", "z"),
    "tabs, also below the header": lambda: table("t\tx\ty\tz\t", T, X, separator="\t", end="\t\n").replace("\t\t", "\t"),
    "blanks": lambda: table("Time (s)  X (m)  Y (m)  Z (m)", T, X, separator="   "),
    "Markdown": lambda: table("|t|x|y|z|\n|---|---|---|---|", [""] * 12, *map(list, [T, *X.T]), separator="|", number="{}"),
    "decimal commas": lambda: table("t;x;y;z", T, X, separator=";").replace(".", ","),
    "decimal commas, tabs": lambda: table("t\tx\ty\tz", T, X, separator="\t").replace(".", ","),
    "decimal commas, blanks": lambda: table("t x y z", T, X, separator=" ").replace(".", ","),
    "D": lambda: table("# t x y z", T, X, separator="  ", number="{:.16e}").replace("e", "D"),
    "CRLF, a mark": lambda: b"\xef\xbb\xbf" + table(PLAIN, T, X, end="\r\n").encode(),
    "old Mac": lambda: table(PLAIN, T, X, end="\r"),
    "UTF-16": lambda: table("t\tx\ty\tz", T, X, separator="\t").encode("utf-16"),
    "Latin": lambda: table("Prüfstand: µ\nt,x,y,z", T, X).encode("cp1252"),
    "gzip": lambda: gzip.compress(table(PLAIN, T, X).encode()),
    "bzip2": lambda: bz2.compress(table(PLAIN, T, X).encode()),
    "xz": lambda: lzma.compress(table(PLAIN, T, X).encode()),
    "quotes": lambda: table('"t","x","y","z"', T, X, number='"{:.17g}"'),
    "brackets": lambda: lines("t,x,y,z", "{},({}, {}, {})"),
    "vectors in cells": lambda: lines("t;pos", "{};({}, {}, {})"),
    "a printed array": lambda: lines("t x y z", " [ {}  {}  {}  {}]").replace("z\n [", "z\n[["),
    "lists": lambda: lines("{t, x, y, z}", "{{{}, {}, {}, {}}}"),
    "blank lines": lambda: "\n\n" + table("# t x y z", T, X, separator=" ", end="\n\n"),
    "a row of units": lambda: table("t,x,y,z\n[s],[m],[m],[m]", T, X),
    "durations": lambda: lines("Time,x,y,z", "{} sec,{},{},{}"),
    "clocks": lambda: lines("Time,x,y,z", "00:00:0{:.1f},{},{},{}"),
    "numbers of NumPy": lambda: lines("t,x,y,z", "np.float64({}),{},{},np.float64({})"),
    "a text column": lambda: lines("t,state,x,y,z", "{},run,{},{},{}"),
    "JSON lines": lambda: "\n".join(json.dumps({"t": t, "pose": {"position": x}}) for t, x in ROWS),
    "JSON in a long line": lambda: json.dumps({"t": T.tolist(), "pos": X.tolist(), "rest": [[0.5] * 6000] * 12}),
    "JSON of rows": lambda: json.dumps([{"t": t, **dict(zip("xyz", x, strict=True))} for t, x in ROWS], indent=1),
    "JSON of frames": lambda: json.dumps({"dt": 0.1, "frames": [{"t": t, "body": {"pos": x}} for t, x in ROWS]}),
    "JSON of vectors": lambda: json.dumps({"t": T.tolist(), "pos": [dict(zip("xyz", x, strict=True)) for _, x in ROWS]}),
    "JSON of arrays": lambda: json.dumps({"t": T.tolist(), "position": X.T.tolist()}),
    **{f"pandas, JSON, {orient}": partial(FRAME.to_json, orient=orient, double_precision=15) for orient in PANDAS},
    "an empty column": lambda: lines("SampleTime,Second,x,y,z", "{},,{},{},{}"),
    "numbered rows": lambda: table("t x y z", K + 1, T, X, separator=" "),
    "equal rows": lambda: table(PLAIN, T[K.repeat(2)], X[K.repeat(2)]),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_write_a_table_is_read(way, tmp_path):
    content = WAYS[way]()
    (tmp_path / "run.txt").write_bytes(content if isinstance(content, bytes) else content.encode())
    layout = check(tmp_path / "run.txt")
    assert layout.notes == (["12 rows are equal to the one before, and left out."] if way == "equal rows" else [])


def test_arrays_and_what_the_bench_saves(tmp_path):
    np.savez(tmp_path / "a.npz", time=T, position=X, rotation=M.reshape(-1, 3, 3), name="top")
    savemat(tmp_path / "a.mat", {"out": {"t": T[:, None], "pos": X.T, "omega": W}})
    FRAME.to_parquet(tmp_path / "a.parquet")
    FRAME.set_index("t").to_parquet(tmp_path / "index.parquet")
    double = pd.MultiIndex.from_tuples([("time", ""), *(("pos", letter) for letter in "xyz")])
    FRAME.set_axis(double, axis=1).to_parquet(tmp_path / "double.parquet")
    np.save(tmp_path / "a.npy", np.column_stack((T, X)))
    check(tmp_path / "a.npy", Options(columns={"t": "0", "x": "1", "y": "2", "z": "3"}))
    check(tmp_path / "a.npz", groups=("position", "matrix"))
    (tmp_path / "part.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:300])
    savemat(tmp_path / "modelica.mat", {"Aclass": ["Atrajectory"], "data_2": X}, format="4")
    for name, words in {"part.npz": "only a part", "modelica.mat": "a result of Modelica"}.items():
        with pytest.raises(ValueError, match=words):
            read(tmp_path / name)
    check(tmp_path / "a.mat", groups=("position", "omega"))
    for name in ("a", "index", "double"):
        check(tmp_path / f"{name}.parquet")
    case = CASES["slow"]
    run = integrate(case.body, case.state, h=0.01, steps=20, method="rk4", every=1)
    for ending in ("csv", "npz", "parquet"):
        rows = read(run.save(tmp_path / f"run.{ending}")).arrays
        assert np.array_equal(rows["position"], run.position), ending
        assert np.array_equal(rows["omega"], run.omega_body), ending
        assert "quaternion" in rows


REFUSED = {  # what is in a file → what the line says
    "0 0 1 0\n.1 0 1 0\n": "it has no header of 4 names. Name them: --columns t=0",
    "x,y,z\n0,1,0\n0,1,0\n": "or say --step SECONDS",
    "t,x,y,z,x\n0,0,1,0,5\n": "names occur twice, such as 'x'",
    "t,body,x,y,z\n0,base,0,0,0\n.5,top,0,1,0\n1,base,0,0,0\n": "the column body has base, top in turn; say which",
    "t,q0,q1,q2,q3,e0,e1,e2,e3\n0,1,0,0,0,1,0,0,0\n": "several columns may be the quaternion",
    "t,rotation.x,rotation.y,rotation.z\n0,0,0,0\n": "if angles, say --angles ZYX; if a rotation vector, --columns rx=",
    "t,x,y,z\n0,0,1,0\n1,0,1\n": "line 3: 3 columns instead of 4; a table must have one header, then a line with all",
    "t,vx_com,vy_com,vz_com\n0,0,1,0\n": "or wx=4,… or angle1=4,…",
    "t,force.x,force.y,force.z\n0,0,1,0\n": "nothing to judge but times",
    "t,wx [m],wy [m],wz [m]\n0,0,1,0\n": "wx [m] is omega, but its unit is m; it needs one such as rad/s: --units omega=rad/s",
    "t,x,y,z\n0,0,1,0\n1,0,1,0\nt,x,y,z\n2,0,1,0\n3,0,1,0\n4,0,1,0\n": "line 2: numbers above the line of text",
    "t,x,y,z\n": "no line of numbers in it; the last line is 't,x,y,z'; write a table",
    "MATLAB 7.3 MAT-file": "from MATLAB with save(…, '-v7')",
    json.dumps(
        {"t": [0, 1], "top": [[{"q": [1, 0, 0, 0]}] * 2] * 2}
    ): "several columns may be the quaternion: top.0.q[0]",
    "FEA1\0": "write a text file with one row a line, .npz, .parquet or .mat",
    "SQLite format 3\0": "write its topic as .csv",
    '{"t": 0, "x": [1, 2]}\n{"t": 0, "x": [1]}\n': "its rows have not all the same numbers",
    "[" * 100_000: "this is no JSON with a row a line, or an array for each name: it is nested too deep",
    '{"t": [0, 1], "z": null}': "nothing to judge but times",
    "time,x,y,z\n2024-01-01T00:00,0,1,0\n": "'2024-01-01T00:00' is no number; without times in seconds, say --step",
}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: repr(text[:30]))
def test_what_cannot_be_read_gets_a_line_that_says_what_to_do(text, tmp_path):
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(REFUSED[text])) as error:
        read(tmp_path / "run.csv")
    assert "\n" not in str(error.value)


def test_nothing_is_lost_or_guessed_in_silence(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("0 world 0 1 0\n.1 world 0 1 0\n", encoding="utf-8")
    said = Options(columns={"t": "0", "x": "2", "y": "3", "z": "4"})
    assert len(read(file, said).arrays["time"]) == 2
    file.write_text(table("t,w,x,y,z", T, Q), encoding="utf-8")
    assert "taken for a quaternion" in check(file, groups=("quaternion",)).notes[0]
    file.write_text(table("t,r_x,r_y,r_z", T, X / np.linalg.norm(X, axis=1)[:, None]), encoding="utf-8")
    (note,) = read(file).notes
    assert note == "r_x r_y r_z is taken for a position; else say --columns rx=r_x,ry=r_y,rz=r_z."
    said = Options(columns={"rx": "r_x", "ry": "r_y", "rz": "r_z"})
    assert set(read(file, said).arrays) == {"time", "rotation vector"}
    file.write_text("t,r_x,r_y,r_z\n" + "".join(f"{t},nan,nan,nan\n" for t in T), encoding="utf-8")
    assert "rotation vector" in read(file).arrays, "what is missing is no position, and gives no warning"
    file.write_text(table("t,q1,q2,q3,q4", T, R.as_quat()), encoding="utf-8")
    assert "--quat wxyz" in check(file, groups=("quaternion",)).notes[0]
    file.write_text(table("t,q1,q2,q3,q4", T, Q), encoding="utf-8")
    layout = read(file, Options(quat="wxyz"))
    assert (layout.quat, np.array_equal(layout.arrays["quaternion"], Q)) == (None, True)
    file.write_text("t,x [furlong],y,z,b\n0,0,1,0,1.#QNAN\n1,-1.#IND,1.#INF,0,5\n", encoding="utf-8")
    layout = read(file)
    assert layout.arrays["position"][1] == pytest.approx([np.nan, np.inf, 0], nan_ok=True)
    assert ("'furlong' is no known unit" in layout.notes[0], "not used: b" in layout.columns) == (True, True)
    file.write_text("t,x,y,z\n0,0,1,0\n1,,,\n,,,\n", encoding="utf-8")
    assert read(file).arrays["position"] == pytest.approx(np.array([[0, 1, 0], 3 * [np.nan]]), nan_ok=True)
    file.write_text("10 0 1 0\n20 0 0 0\n10 0 1 0\n20 0 0 0\n", encoding="utf-8")
    said = {"columns": {"x": "1", "y": "2", "z": "3"}, "step": 0.5}
    with pytest.raises(ValueError, match="the column 0 has 10, 20 in turn"):
        read(file, Options(**said))
    assert read(file, Options(**said, where={"0": "10"})).arrays["time"].tolist() == [[0], [0.5]]
    file.write_text(table("t,roll,pitch,yaw", T, X), encoding="utf-8")
    for unit in ({"omega": "furlong"}, {"o": "s"}, {"omega": "deg/s"}):
        with pytest.raises(ValueError, match="--units"):
            read(file, Options(units=unit))
    for name, value in {"angles": "ZXX", "where": {"a": "b"}, "step": 1.0, "columns": {"t": "4"}}.items():
        says = {"step": "leave it out, or the column t", "columns": "the first row is 0 | 1 | 0 |"}.get(
            name, f"--{name}"
        )
        with pytest.raises(ValueError, match=re.escape(says)):
            read(file, Options(**{name: value}))


def test_digits_of_times_and_positions(tmp_path):
    file = tmp_path / "run.csv"
    ways = (np.arange(20) / 7.5, "{:.6f}", 5e-7), (np.arange(20) / 10, "{:.6f}", 0), (1.7e9 + T, "{:.17g}", 1.2e-7)
    for times, digits, floor in ways:
        file.write_text(table("t,x,y,z", times, np.ones((len(times), 3)), number=digits), encoding="utf-8")
        assert read(file).floor["time"] == pytest.approx(floor, rel=0.01)
    # x moves by 0.1 a row: the digits of y and z tell how all are printed
    file.write_text(table("t,x,y,z", T, T, X[:, :2], number="{:.9g}"), encoding="utf-8")
    assert read(file).floor["position"] == pytest.approx(5e-10)


def test_stamps_with_more_digits_than_a_double_keep_them(tmp_path):
    file, stamps = tmp_path / "run.csv", [1603259701123456789 + 100_000_001 * k for k in range(12)]
    file.write_text("t,x,y,z\n" + "".join(f"{stamp},{x},{y},{z}\n" for stamp, (x, y, z) in zip(stamps, X, strict=True)))
    found = read(file, Options(units={"t": "ns"}, t0=0.0))
    assert found.arrays["time"][:, 0] == pytest.approx(0.100000001 * K, abs=1e-15)
    assert (found.floor["time"], found.elapsed[-1]) == (0, pytest.approx(1.100000011, abs=1e-15))


def test_rows_of_a_window_and_of_lost_steps(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text(table("t,x,y,z", T, X), encoding="utf-8")
    found = read(file, Options(since=0.3, until=0.7))
    assert (found.arrays["time"][[0, -1], 0] == pytest.approx([0.3, 0.7]), found.elapsed[0]) == (True, 0)
    assert found.notes == ["7 rows are outside the window, and left out."]
    with pytest.raises(ValueError, match=r"no row is in the window: the times go from 0 to 1\.1 s"):
        read(file, Options(since=5.0))
    file.write_text(table("timestep,x,y,z", 20 * np.delete(K, 5), np.delete(X, 5, 0)), encoding="utf-8")
    assert read(file, Options(step=0.1)).arrays["time"][:, 0] == pytest.approx(np.delete(T, 5))
    with pytest.raises(ValueError, match="the column timestep counts steps; say the time between two rows: --step"):
        read(file)


def test_points_of_a_body_are_a_rotation(tmp_path):
    """In columns and in an XYZ file; the unit of the latter is told, and how rigid the points are."""
    points = np.array([[1, 0, 0], [-1, 0, 0.5], [0, 0.6, 0.1], [0, -0.6, -0.1]])
    places = np.stack([R.apply(point) + X for point in points], 1)
    file = tmp_path / "run.csv"
    header = "t," + ",".join(f"{axis}{k}" for k in range(1, 5) for axis in "xyz")
    file.write_text(table(header, T, places.reshape(12, 12)), encoding="utf-8")
    found = read(file, points=points)
    assert found.arrays["matrix"] == pytest.approx(M, abs=1e-12)
    assert found.arrays["position"] == pytest.approx(X, abs=1e-12)
    assert "Rotations are those of 4 points; their distances are off by up to" in found.notes[0]
    with pytest.raises(ValueError, match="of points of one body, give their places in it: points ="):
        read(file)
    frames = [
        f"4\nstep 3, t= {t:.1f}\n" + "".join("H {} {} {}\n".format(*x) for x in 1e10 * frame)
        for t, frame in zip(T, places, strict=True)
    ]
    file = tmp_path / "run.xyz"
    file.write_text("".join(frames))
    assert "times as far apart as in the body: --units position=å?" in read(file, points=points).notes[1]
    assert read(file, Options(units={"position": "å"}), points).arrays["matrix"] == pytest.approx(M, abs=1e-12)
    file.write_text("".join(frames)[:-90])
    with pytest.raises(ValueError, match="no XYZ file with 4 atoms in each frame"):
        read(file, points=points)


def test_the_page_of_words_has_the_table():
    """All of it; each word of the table is found, and no word stands in two rows."""
    page = (Path(__file__).parents[2] / "docs/names.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in page.split("\n") if " | " in line]
    others = {"": "not judged", "never": "not judged, whatever else the name says"}
    others["point"] = "position, if no other word is known"
    for kind, text in names.QUANTITIES.items():
        assert [" ".join(text.split()), others.get(kind, kind)] in rows
    for frame, words in names.FRAMES.items():
        assert [", ".join(words), f"ω in the {frame}"] in rows
    for shape, orders in (form for forms in names.SHAPES.values() for form in forms):
        assert any(shape in row[0].split(", ") and set(orders) <= set(row[1].split("; ")) for row in rows)
    units = {word: row[1] for row in rows for word in row[0].split(", ")}
    assert {word: f"{unit.factor:.10g} {unit.kind}" for word, unit in names.UNITS.items()}.items() <= units.items()
    phrases = [phrase for kind, text in names.QUANTITIES.items() if kind != "time" for phrase in names._phrases(text)]
    assert len(phrases) == len(set(phrases))
    for name, kind in (("root_pos_w", "position"), ("linear velocity", "velocity"), ("ang_vel_body", "omega")):
        assert names.kind_of(name.replace(" ", "_").split("_")) == kind
    assert [names.frame_of(name.split("_")) for name in ("omega_world", "base_w", "ang_vel_b")] == [
        "world",
        None,
        "body",
    ]


SI = {  # of one word for each unit: the kind and the factor of an independent table
    "s": {"s": 1.0, "ms": constants.milli, "us": constants.micro, "ns": constants.nano, "ps": constants.pico},
    "m": {"m": 1.0, "cm": constants.centi, "mm": constants.milli, "um": constants.micron, "nm": constants.nano},
    "rad": {"rad": 1.0, "mrad": constants.milli, "deg": constants.degree, "rev": 2 * np.pi},
    "rad/s": {"rpm": 2 * np.pi / constants.minute, "dps": constants.degree, "hz": 2 * np.pi, "1/s": 1.0},
    "1": {"-": 1.0},
}
SI["s"] |= {"fs": constants.femto, "min": constants.minute, "h": constants.hour, "d": constants.day}
SI["m"] |= {"å": constants.angstrom, "km": constants.kilo, "in": constants.inch, "ft": constants.foot}
SI["rad/s"] |= {"deg s^-1": constants.degree, "degrees per second": constants.degree, "rad/ms": 1 / constants.milli}
SI["rad/s"] |= {"°/min": constants.degree / constants.minute, "rad s^-1": 1.0}
SI["m/s"] = {"km/h": constants.kmh}


def test_units_and_clocks_have_the_factors_of_an_independent_table():
    for kind, units in SI.items():
        for word, factor in units.items():
            assert unit_of(word) == (kind, pytest.approx(factor, rel=1e-15)), word
    assert {unit_of(word) for word in names.UNITS} <= {unit_of(word) for units in SI.values() for word in units}
    assert unit_of("furlong") is None
    assert number("02:03:04.5") == 2 * constants.hour + 3 * constants.minute + 4.5
