"""A matrix of mistakes, and which of them `Diagnosis` names: python tests/mistakes.py RUNS SEED prints how many.

Bodies × what a program does wrong or a reader misreads × integrators × digits, drawn by a seed. The exact motion is by DOP853.
"""

import sys
import warnings
from collections.abc import Callable, Iterable
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lagrange_bench import Case, RigidBody
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.judging.advice import diagnosis_of
from lagrange_bench.judging.columns import FileTrajectory
from lagrange_bench.judging.diagnosis import Diagnosis
from lagrange_bench.judging.frames import Frames, Options
from lagrange_bench.judging.vectors import SIGNED, tensor, to_body, to_world

Array = np.ndarray
Motion = Callable[[Array], tuple[Array, Array, Array]]  # times → positions, matrices, ω in the body
# s and rad between two rows, at most
LONGEST, WIDEST = 1 / 30, 0.45
# rad a step: a run that turns faster is over
BLOWN_UP = 30.0
SEQUENCES = ("xyz", "XYZ", "ZYX", "zyx")


class Program(NamedTuple):
    """What a program computes. torque : the share of the gyroscopic torque. damping : 1/s. cap : of |ω|. late : s, of rows."""

    case: Case
    step: float = 1 / 60
    torque: float = 1.0
    damping: float = 0.0
    cap: float = inf
    multiplies_in_world: bool = False
    is_explicit: bool = False
    late: float = 0.0


class Columns(NamedTuple):
    """What it writes: times, rotations, ω in `frame`, positions. path : the motion at any times, where it is exact."""

    t: Array
    R: Array
    omega: Array
    x: Array
    frame: str
    kind: str
    path: Motion | None
    angles: Array | None = None


class Mistake(NamedTuple):
    """How a run is spoiled, and the findings that name it.

    causes : any of them, if the start is known. spoil : a `Program` or `Columns`, and a generator of random numbers → the same
    with the mistake. alone : causes with the body alone; None where rows alone cannot show it. bodies : those that can show it.
    needs : "exact" columns, a "poor" integrator, "angles".
    """

    causes: str
    spoil: Callable[[Any, Any], Any]
    alone: str | None = ""
    bodies: str = "free flying heavy top"
    needs: str = ""


# ------------------------------------------------------------------------------------------------------------- motions


def cross_by(v: Array) -> Array:
    """The matrix of v ×."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def equations(program: Program) -> Callable[[float, Array], Array]:
    """q' = q ω/2 and I ω' = m c × Rᵀg − ω × I ω + (1 − torque) ω × I_c ω − damping I ω, for y = (q, ω)."""
    body, g = program.case.body, program.case.body.gravity
    I, inverse = tensor(body), np.linalg.inv(tensor(body))
    turning, lever = I - (1 - program.torque) * body.inertia_com, cross_by(body.mass * body.com * body.fixed)

    def rates(t: float, y: Array) -> Array:
        w, V, omega = y[0], cross_by(y[1:4]), y[4:]
        in_body = g + 2 * V @ (V @ g - w * g)  # Rᵀg
        torque = lever @ in_body - cross_by(omega) @ (turning @ omega)
        turn = np.concatenate(([-y[1:4] @ omega], w * omega + V @ omega))
        return np.concatenate((turn / 2, inverse @ torque - program.damping * omega))

    return rates


def start_of(case: Case) -> Array:
    return np.concatenate((as_rotation(case.rotation).as_quat(scalar_first=True), np.asarray(case.omega_body, float)))


def columns_of(case: Case, t: Array, y: Array) -> tuple[Array, Array, Array]:
    """Positions, matrices, ω in the body."""
    R = np.full((len(t), 3, 3), np.nan)
    known = np.isfinite(y).all(1)
    R[known] = Rotation.from_quat(y[known, :4], scalar_first=True).as_matrix()
    if case.body.fixed:
        return R @ case.body.com, R, y[:, 4:]
    s = t[:, None]
    return np.asarray(case.position) + s * np.asarray(case.velocity) + s**2 / 2 * case.body.gravity, R, y[:, 4:]


def exact_motion(program: Program, until: float) -> Motion:
    """The motion at times between −until/5 and until; NaN elsewhere."""
    first, f, y0 = -until / 5, equations(program), start_of(program.case)
    later, before = (
        solve_ivp(f, (0, end), y0, "DOP853", rtol=1e-12, atol=1e-13, dense_output=True).sol for end in (until, first)
    )

    def motion(t: Array) -> tuple[Array, Array, Array]:
        y = np.where(t < 0, before(t), later(t))
        return columns_of(program.case, t, np.where((t < first) | (t > until), np.nan, y).T)

    return motion


def poor_motion(program: Program, t: Array, substeps: int, is_rk4: bool) -> tuple[Array, Array, Array]:
    """Rows of an engine: ω by RK4 or by an explicit step, then q turned by it; RK4 for both if nothing hinders."""
    f, h = equations(program), (t[1] - t[0]) / substeps
    y = start_of(program.case)
    rows = [y]
    for k in range((len(t) - 1) * substeps):
        if np.linalg.norm(y[4:]) * h > BLOWN_UP:
            break
        a = f(0.0, y)
        new = y + h * a
        if is_rk4:
            b = f(0.0, y + h / 2 * a)
            c = f(0.0, y + h / 2 * b)
            new = y + h / 6 * (a + 2 * b + 2 * c + f(0.0, y + h * c))
        if not is_rk4 or program.multiplies_in_world:
            omega = new[4:] * min(1.0, program.cap / (np.linalg.norm(new[4:]) or 1.0))
            turn = Rotation.from_rotvec(h * ((omega + y[4:]) / 2 if is_rk4 else omega))
            q = Rotation.from_quat(y[:4], scalar_first=True)
            q = turn * q if program.multiplies_in_world else q * turn
            new = np.concatenate((q.as_quat(scalar_first=True), omega))
        y = new / np.concatenate((np.full(4, np.linalg.norm(new[:4])), np.ones(3)))
        if (k + 1) % substeps == 0:
            rows.append(y)
    return columns_of(program.case, t, np.array(rows + [np.full(7, np.nan)] * (len(t) - len(rows))))


# ------------------------------------------------------------------------------------------------------------ mistakes


def signed(rng: Any, proper: bool = True) -> Array:
    """Signed axes that are neither 1 nor −1."""
    fitting = [P for P in SIGNED if abs(np.trace(P)) < 3 and (np.linalg.det(P) > 0 or not proper)]
    return fitting[rng.integers(len(fitting))]


def turned(rng: Any) -> Array:
    return Rotation.from_quat(rng.normal(size=4)).as_matrix()


def with_body(program: Program, **change: Any) -> Program:
    case = program.case
    flight = {} if case.body.fixed else {"position": case.position, "velocity": case.velocity}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of moments that no body has
        body = RigidBody(**{**case.body.facts, **change})
    return program._replace(case=Case(case.name, body, case.rotation, case.omega_body, **flight))


def other_moments(program: Program, rng: Any) -> Program:
    while True:
        Q = np.diag(rng.uniform(0.7, 1.4, 3))
        I = Q @ program.case.body.inertia_com @ Q
        least, middle, most = np.linalg.eigvalsh(I)
        if least + middle > most:
            return with_body(program, inertia_com=I)


def other_gravity(program: Program, rng: Any) -> Program:
    g = program.case.body.gravity
    return with_body(program, gravity=[-g, g[[0, 2, 1]], g / 2, 0 * g][rng.integers(4)])


def no_products(program: Program, rng: Any) -> Program:
    I = program.case.body.inertia_com
    diagonal = np.diag(np.diag(I))
    return with_body(program, inertia_com=diagonal if rng.random() < 0.5 else 2 * diagonal - I)


def renamed(program: Program, rng: Any) -> Program:
    P = signed(rng)
    return with_body(program, inertia_com=P @ program.case.body.inertia_com @ P.T)


def elsewhere(program: Program, rng: Any) -> Program:
    case = program.case
    omega = np.asarray(case.omega_body) + 0.3 * np.linalg.norm(case.omega_body) * rng.normal(size=3)
    flight = {} if case.body.fixed else {"position": rng.normal(size=3), "velocity": rng.normal(size=3)}
    return program._replace(case=Case(case.name, case.body, turned(rng), omega, **flight))


def late_omega(c: Columns, rows: float) -> Columns:
    _, R, omega = c.path(c.t + rows * (c.t[1] - c.t[0]))
    return c._replace(omega=omega if c.frame == "body" else to_world(R, omega))


def lagging(c: Columns, rng: Any) -> Columns:
    before = np.concatenate((c.R[:1], c.R[:-1]))
    return c._replace(omega=to_body(before, to_world(c.R, c.path(c.t)[2])), frame="body")


def in_angles(c: Columns, rng: Any) -> Columns:
    """ω = rates of the angles: the slope from rows as near as one likes."""
    h = 1e-4 * (c.t[1] - c.t[0])
    near = [Rotation.from_matrix(c.path(c.t + late)[1]).as_euler(c.kind) for late in (-h, h)]
    before, after = np.unwrap(np.stack(near), axis=0)
    return c._replace(omega=(after - before) / (2 * h), frame="body")


def integrated(c: Columns, rng: Any) -> Columns:
    omega = c.omega if c.frame == "body" else to_body(c.R, c.omega)
    steps = (omega[1:] + omega[:-1]) / 2 * np.diff(c.t)[:, None]
    first = Rotation.from_matrix(c.R[0]).as_euler(c.kind)
    return c._replace(angles=first + np.concatenate((np.zeros((1, 3)), np.cumsum(steps, 0))), omega=omega, frame="body")


def mirrored(c: Columns, rng: Any) -> Columns:
    mirrors = [P for P in SIGNED if np.linalg.det(P) < 0 and np.trace(P) == 1]
    S = mirrors[rng.integers(len(mirrors))]
    return c._replace(x=c.x @ S, R=S @ c.R @ S, omega=-c.omega @ S)


def other_world(c: Columns, rng: Any) -> Columns:
    W = signed(rng)
    return c._replace(x=c.x @ W, R=W.T @ c.R, omega=c.omega @ W if c.frame == "world" else c.omega)


def other_body(c: Columns, rng: Any) -> Columns:
    B = signed(rng)
    return c._replace(R=c.R @ B, omega=c.omega @ B if c.frame == "body" else c.omega)


HEAVY, UNEQUAL = "flying heavy top", "free flying heavy"
# what a program computes
PROGRAMS = {
    "gyroscopic torque left out": Mistake("gyroscopic-torque", lambda p, rng: p._replace(torque=0.0)),
    "damping": Mistake("damping", lambda p, rng: p._replace(damping=float(rng.uniform(0.1, 1.0)) / (50 * p.step))),
    "cap on ω": Mistake(
        "cap",
        lambda p, rng: p._replace(cap=float(np.linalg.norm(p.case.omega_body) * rng.uniform(0.2, 0.8))),
        needs="poor",
    ),
    "rotation multiplied on the other side": Mistake(
        "rotation-product", lambda p, rng: p._replace(multiplies_in_world=True), needs="poor"
    ),
    "explicit step": Mistake(
        "explicit-step omega-half-step", lambda p, rng: p._replace(is_explicit=True), needs="poor"
    ),
    "moments of other axes": Mistake("body-axes moments", renamed, bodies=UNEQUAL),
    "other moments": Mistake("moments", other_moments),
    "products of inertia left out": Mistake("moments", no_products, bodies=UNEQUAL),
    "moments about the other point": Mistake(
        "moments", lambda p, rng: with_body(p, inertia_com=tensor(p.case.body)), bodies="heavy"
    ),
    "other gravity": Mistake("gravity world-axes", other_gravity, bodies=HEAVY),
    "other start": Mistake("other-start", elsewhere, alone=None),
    "rows of another step": Mistake(
        "rows-late",
        lambda p, rng: p._replace(late=p.step * int(rng.choice([1, -1, 2]))),
        alone=None,
        needs="exact",
    ),
}
# what is written or read wrongly, before the numbers are rounded; those that compute ω anew come first
COLUMNS = {
    "ω half a step late or early": Mistake(
        "omega-half-step", lambda c, rng: late_omega(c, rng.choice([-0.5, 0.5])), needs="exact"
    ),
    "ω of the next row": Mistake("omega-row", lambda c, rng: late_omega(c, rng.choice([-1, 1])), needs="exact"),
    "ω in the body of the row before": Mistake("omega-lag", lagging, needs="exact"),
    "rates of angles for ω": Mistake("angle-rates", in_angles, needs="exact angles"),
    "ω integrated as angles": Mistake("angles-integrated", integrated, needs="angles"),
    "rotations transposed": Mistake("rotation-transposed", lambda c, rng: c._replace(R=c.R.transpose(0, 2, 1))),
    "world with other axes": Mistake("world-axes", other_world, alone="world-axes gravity"),
    "body with other axes": Mistake("body-axes", other_body, alone="body-axes moments", bodies=UNEQUAL),
    "left-handed world": Mistake("left-handed", mirrored, alone=None, bodies=HEAVY),
    "ω in the other frame": Mistake(
        "omega-frame", lambda c, rng: c._replace(frame={"body": "world", "world": "body"}[c.frame])
    ),
    "unit of ω": Mistake(
        "omega-unit", lambda c, rng: c._replace(omega=c.omega / rng.choice([pi / 180, pi / 30, 2 * pi]))
    ),
    "sign of ω": Mistake("omega-sign", lambda c, rng: c._replace(omega=-c.omega)),
    "axes of ω": Mistake("omega-axes", lambda c, rng: c._replace(omega=c.omega @ signed(rng, proper=False))),
    "gyroscope mounted askew": Mistake("omega-turned", lambda c, rng: c._replace(omega=c.omega @ turned(rng))),
    "unit of time": Mistake("time-unit", lambda c, rng: c._replace(t=c.t / rng.choice([1e-3, 1e-6, 60.0]))),
    "times from another zero": Mistake(
        "time-shift", lambda c, rng: c._replace(t=c.t + rng.uniform(0.5, 3)), alone=None, needs="exact"
    ),
    "unit of length": Mistake(
        "length-unit", lambda c, rng: c._replace(x=c.x / rng.choice([1e-3, 0.01, 0.0254, 0.3048])), bodies=HEAVY
    ),
    "origin": Mistake(
        "origin", lambda c, rng: c._replace(x=c.x + np.abs(c.x).max() * rng.normal(size=3)), alone=None, bodies=HEAVY
    ),
    "displacement for position": Mistake(
        "displacement", lambda c, rng: c._replace(x=c.x - c.x[0]), alone=None, bodies="heavy top"
    ),
    "order of quaternions": Mistake("quaternion-order", lambda c, rng: c._replace(kind="xyzw")),
    "degrees, or moving axes": Mistake(
        "rotation-angles",
        lambda c, rng: c._replace(kind=f"{c.kind} {rng.choice(['degrees', 'swapped'])}"),
        needs="angles",
    ),
}
MISTAKES = PROGRAMS | COLUMNS


def causes_of(name: str, with_case: bool) -> set[str]:
    """The causes that name a mistake; none where the rows cannot show it."""
    mistake = MISTAKES[name]
    return set((mistake.causes if with_case or mistake.alone == "" else mistake.alone or "").split())


def kinds_of(names: Iterable[str], with_case: bool) -> set[str]:
    """The kinds of bodies that can show all of these mistakes."""
    kinds = set.intersection(*(set(MISTAKES[name].bodies.split()) for name in names))
    return kinds if with_case or "world with other axes" not in names else kinds - {"free"}


def draw_case(rng: Any, kinds: Iterable[str]) -> Case:
    """A body that could exist, in axes of its own or in principal ones, and its start."""
    kind = str(rng.choice(sorted(kinds)))
    mass, (a, b, c), com, Q = rng.uniform(0.5, 10), rng.uniform(0.15, 1.0, 3), np.zeros(3), np.eye(3)
    omega = rng.normal(size=3)
    omega *= rng.uniform(2, 12) / np.linalg.norm(omega)
    if kind == "top":
        a, com[2], omega[2] = b, rng.uniform(0.3, 1), rng.uniform(5, 30)
    elif kind == "heavy":
        com = rng.uniform(-0.5, 0.5, 3)
    if kind != "top" and rng.random() < 0.7:
        Q = turned(rng)
    I = mass / 5 * Q @ np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) @ Q.T
    body = RigidBody(mass, com, (I + I.T) / 2, (0, 0, 0 if kind == "free" else -9.81), kind != "flying")
    flight = {} if body.fixed else {"position": rng.normal(size=3), "velocity": 4 * rng.normal(size=3)}
    return Case(kind, body, turned(rng), omega, **flight)


def run(rng: Any, names: Iterable[str], with_case: bool) -> tuple[Diagnosis, list[set[str]]]:
    """What `judge` reads of a run with these mistakes, in which they can be seen; and the causes that name each of them."""
    names = set(names)
    while True:
        case = draw_case(rng, kinds_of(names, with_case))
        products = case.body.inertia_com - np.diag(np.diag(case.body.inertia_com))
        if "products of inertia left out" in names and np.abs(products).max() < 0.1 * case.body.inertia.max():
            continue
        speed = float(np.linalg.norm(case.omega_body))
        dt = min(LONGEST, min(WIDEST, rng.uniform(0.03, 0.5)) / speed) * rng.uniform(0.4, 1)
        t = np.arange(int(rng.integers(50, 150))) * dt
        program = Program(case, dt)
        for name in [name for name in PROGRAMS if name in names]:
            program = PROGRAMS[name].spoil(program, rng)
        right = columns = written(rng, program, t, names)
        if not np.isfinite(columns.R).all():
            continue  # it blew up
        for name in [name for name in COLUMNS if name in names]:
            columns = COLUMNS[name].spoil(columns, rng)
        is_other = bool(names & set(PROGRAMS))
        if is_other and np.abs(exact_motion(Program(case), 1.01 * t[-1])(t)[1] - right.R).max() < 0.05:
            continue  # in this run it changes nothing
        if changes_omega(right, columns):
            break
    exact = exact_motion(Program(case), 1.3 * t[-1] + 4) if with_case else None
    digits = int(rng.choice([5, 6, 7, 9, 12, 17]))
    return read(columns, digits, case.body, exact), [causes_of(name, with_case) for name in names]


def written(rng: Any, program: Program, t: Array, names: set[str]) -> Columns:
    """The columns of a program, right but for what it computes."""
    needs = " ".join(MISTAKES[name].needs for name in names)
    path = None
    if "poor" in needs or not ("exact" in needs or rng.random() < 0.4):
        is_rk4 = rng.random() < 0.5 and program.cap == inf and not program.is_explicit
        substeps = 1 if program.is_explicit else int(rng.integers(1, 3) if is_rk4 else rng.integers(3, 10))
        x, R, omega = poor_motion(program, t, substeps, is_rk4)
    else:
        path = exact_motion(program, t[-1] + 4 * (t[1] - t[0]))
        x, R, omega = path(t + program.late)
    is_body = program.multiplies_in_world or "ω integrated as angles" in names or rng.random() < 0.5
    kind = str(rng.choice(["wxyz", "matrix", SEQUENCES[rng.integers(4)]]))
    kind = SEQUENCES[rng.integers(4)] if "angles" in needs else "wxyz" if "order of quaternions" in names else kind
    return Columns(t, R, omega if is_body else to_world(R, omega), x, "body" if is_body else "world", kind, path)


def changes_omega(right: Columns, columns: Columns) -> bool:
    """Whether ω, if a mistake concerns it, changes by 1 %."""
    if columns.frame == right.frame and columns.omega is right.omega:
        return True
    omega = columns.omega
    if columns.frame != right.frame:
        omega = to_world(right.R, omega) if right.frame == "world" else to_body(right.R, omega)
    off, size = np.linalg.norm(omega - right.omega, axis=1), np.linalg.norm(right.omega, axis=1)
    return bool(np.nanmedian(off) > 0.01 * np.nanmedian(size))


def rounded(v: Array, digits: int) -> Array:
    """Numbers with so many digits, as a file has them."""
    return np.array([float(f"{number:.{digits}g}") for number in v.ravel()]).reshape(v.shape)


def read(c: Columns, digits: int, body: RigidBody, exact: Motion | None, without: str = "") -> Diagnosis:
    """The columns as a file has them and `judge` reads them, without one of R, omega and x if that is said."""
    digit = 10.0**-digits if digits < 17 else 1e-16
    (sequence, _, wrong), said = c.kind.partition(" "), None
    if sequence == "matrix":
        group, values = sequence, c.R.reshape(-1, 9)
    elif sequence in ("wxyz", "xyzw"):
        group, values = "quaternion", Rotation.from_matrix(c.R).as_quat(scalar_first=sequence == "wxyz")
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # near a pole
            values = np.unwrap(Rotation.from_matrix(c.R).as_euler(sequence), axis=0)
        group, values = "angles", values if c.angles is None else c.angles
        values = np.degrees(values) if wrong == "degrees" else values
        said = sequence.swapcase() if wrong == "swapped" else sequence
    rows = {"time": c.t[:, None], group: rounded(values, digits)}
    rows |= {"omega": rounded(c.omega, digits), "position": rounded(c.x, digits)}
    floor = {name: digit * np.abs(rows[name]).max() for name in ("omega", "position")}
    floor[group] = digit * (np.abs(rows[group]).max() if group == "angles" else 1.0)
    rows.pop({"R": group, "omega": "omega", "x": "position"}.get(without), None)
    frames = Frames(body, Options(quat="wxyz", omega_frame=c.frame, angles=said), digit)
    return diagnosis_of(frames, rows, FileTrajectory({}, c.t, floor=floor), exact)


def right_run(rng: Any) -> Diagnosis:
    """A right run of any kind: also steady, planar or resting, of few rows or far apart, of few digits, with noise of sensors."""
    style = str(rng.choice(["any", "any", "steady", "planar", "resting", "noise", "far", "few", "slow"]))
    case = draw_case(rng, ("free", "flying") if style in ("steady", "resting") else ("free", "flying", "heavy", "top"))
    speed = float(np.linalg.norm(case.omega_body))
    if style in ("steady", "resting"):
        speed *= style == "steady"
        axis = case.body.axes[rng.integers(3)]
        case = Case(style, case.body, case.rotation, speed * axis, case.position, case.velocity)
    elif style == "planar":  # a pendulum about a principal axis
        body = RigidBody(1.0, (0, 0, -rng.uniform(0.2, 1)), rng.uniform(0.5, 0.9, 3))
        case, speed = Case(style, body, np.eye(3), (rng.uniform(-3, 3), 0, 0)), 4.0
    step = {"far": rng.uniform(0.5, 8), "slow": rng.uniform(0.001, 0.02)}.get(style, rng.uniform(0.02, 1.0))
    n = int(rng.integers(4, 12 if style == "few" else 201))
    t = np.arange(max(4, min(n, int(200 / step)))) * step / (speed or 1.0)
    exact = exact_motion(Program(case), 1.1 * t[-1] + 1)
    x, R, omega = exact(t)
    frame = str(rng.choice(["body", "world"]))
    omega = omega if frame == "body" else to_world(R, omega)
    if style == "noise":
        noise = float(rng.choice([1e-4, 1e-3, 1e-2, 5e-2]))
        R = R @ Rotation.from_rotvec(noise * rng.normal(size=(len(t), 3))).as_matrix()
        omega = omega + noise * rng.choice([0.1, 1.0]) * (speed or 1.0) * rng.normal(size=(len(t), 3))
        x = x + noise * rng.normal(size=(len(t), 3))
    kind = str(rng.choice(["wxyz", "matrix", rng.choice(SEQUENCES)]))
    digits, gone = int(rng.integers(3, 18)), str(rng.choice(["R", "omega", "x", "", "", ""]))
    known = exact if rng.random() < 0.5 else None
    return read(Columns(t, R, omega, x, frame, kind, None), digits, case.body, known, gone)


# --------------------------------------------------------------------------------------------------------------- power


def is_named(diagnosis: Diagnosis, mistakes: list[set[str]]) -> bool:
    """Whether each mistake is among the findings, by one of its causes."""
    found = {finding.cause for finding in diagnosis.findings()}
    return all(found & causes for causes in mistakes)


def power(mistake: str, with_case: bool, runs: int, seed: int) -> int:
    """In how many runs this mistake is named."""
    place = list(MISTAKES).index(mistake)
    seeds = ([seed, place, k, with_case] for k in range(runs))
    return sum(is_named(*run(np.random.default_rng(each), [mistake], with_case)) for each in seeds)


def pair(rng: Any) -> list[str]:
    """Two mistakes that do not touch the same columns in the same way."""
    while True:
        names = [str(name) for name in rng.choice(list(MISTAKES), 2, replace=False)]
        one, other = (MISTAKES[name] for name in names)
        needs = f"{one.needs} {other.needs}"
        quantities = {
            "omega" if each.causes.startswith("angle") else each.causes.partition("-")[0] for each in (one, other)
        }
        is_one_program = {*names} <= PROGRAMS.keys() or ("exact" in needs and "poor" in needs)
        is_one_reading = ("order of quaternions" in names and "angles" in needs) or needs.count("angles") > 1
        if len(quantities) == 2 and not is_one_program and not is_one_reading and kinds_of(names, True):
            return names


if __name__ == "__main__":
    for mistake in MISTAKES:
        print(
            mistake,
            *(power(mistake, known, *map(int, sys.argv[1:])) for known in (True, False) if causes_of(mistake, known)),
        )
