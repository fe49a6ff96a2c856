"""A matrix of mistakes, and which of them `diagnose` names: python tests/mistakes.py RUNS SEED prints the table of the docs.

Bodies × what a program does wrong or a reader misreads × integrators × digits, drawn by a seed. The exact motion is by DOP853.
"""

from __future__ import annotations

import itertools
import sys
import warnings
from collections.abc import Callable, Iterable
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, Case, RigidBody
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.judging.diagnosis import Floor, Rows, diagnose

Array = np.ndarray
# s and rad between two rows, at most
LONGEST, WIDEST = 1 / 30, 0.45
# rad a step: a run that turns faster is over
BLOWN_UP = 30.0
NAMED = ("box", "bruels", "slow", "simo_wong", "t_body", "brick", "middle_axis", "flying_box", "kovalevskaya")
SEQUENCES = ("xyz", "XYZ", "ZYX", "zyx")
SIGNED = [
    np.eye(3)[list(p)] * np.array(s)[:, None]
    for p in itertools.permutations(range(3))
    for s in itertools.product((1, -1), repeat=3)
]


class Program(NamedTuple):
    """What a program computes. torque : the share of the gyroscopic torque. damping : 1/s. cap : of |ω|. late : s, of rows."""

    case: Case
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
    path: Callable[[Array], tuple[Array, Array, Array]] | None
    angles: Array | None = None


class Run(NamedTuple):
    """The arguments of `diagnose`, and the causes that name each mistake."""

    rows: Rows
    ways: dict[str, Array]
    body: RigidBody
    exact: Callable[[Array], tuple[Array, Array, Array]] | None
    floor: Floor
    causes: list[set[str]]

    def findings(self) -> list[Any]:
        return diagnose(self.rows, self.ways, self.body, self.exact, self.floor)


# ------------------------------------------------------------------------------------------------------------- motions


def tensor(body: RigidBody) -> Array:
    return body.axes.T @ np.diag(body.inertia) @ body.axes


def equations(program: Program) -> Callable[[float, Array], Array]:
    """q' = q ω/2 and I ω' = m c × Rᵀg − ω × I ω + (1 − torque) ω × I_c ω − damping I ω, for y = (q, ω)."""
    body, (a, b, c) = program.case.body, program.case.body.gravity.tolist()
    I, inverse = tensor(body), np.linalg.inv(tensor(body))
    turning = (I - (1 - program.torque) * body.inertia_com).tolist()
    (u, v, w), damping = (body.mass * body.com * body.fixed).tolist(), program.damping

    def rates(t: float, y: Array) -> Array:
        q0, q1, q2, q3, p, q, r = y.tolist()
        # Rᵀg by two products with the vector part
        k1, k2, k3 = q2 * c - q3 * b, q3 * a - q1 * c, q1 * b - q2 * a
        g1 = a - 2 * q0 * k1 + 2 * (q2 * k3 - q3 * k2)
        g2 = b - 2 * q0 * k2 + 2 * (q3 * k1 - q1 * k3)
        g3 = c - 2 * q0 * k3 + 2 * (q1 * k2 - q2 * k1)
        l1, l2, l3 = (row[0] * p + row[1] * q + row[2] * r for row in turning)
        torque = [
            v * g3 - w * g2 - q * l3 + r * l2,
            w * g1 - u * g3 - r * l1 + p * l3,
            u * g2 - v * g1 - p * l2 + q * l1,
        ]
        turn = [-q1 * p - q2 * q - q3 * r, q0 * p + q2 * r - q3 * q, q0 * q + q3 * p - q1 * r, q0 * r + q1 * q - q2 * p]
        return np.concatenate((np.array(turn) / 2, inverse @ torque - damping * y[4:]))

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


def exact_motion(program: Program, until: float) -> Callable[[Array], tuple[Array, Array, Array]]:
    """The motion at times between −until/5 and until; NaN elsewhere."""
    ends = (until, -until / 5)
    f, y0 = equations(program), start_of(program.case)
    later, before = (
        solve_ivp(f, (0, end), y0, "DOP853", rtol=1e-12, atol=1e-13, dense_output=True).sol for end in ends
    )

    def motion(t: Array) -> tuple[Array, Array, Array]:
        y = np.full((len(t), 7), np.nan)
        for known, solution in (((t >= 0) & (t <= ends[0]), later), ((t < 0) & (t >= ends[1]), before)):
            if known.any():
                y[known] = solution(t[known]).T
        return columns_of(program.case, t, y)

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


# what a program does
MADE: dict[str, Callable[[Program, Any, float], Program]] = {
    "gyroscopic torque left out": lambda p, rng, dt: p._replace(torque=0.0),
    "damping": lambda p, rng, dt: p._replace(damping=float(rng.uniform(0.1, 1.0)) / (50 * dt)),
    "cap on ω": lambda p, rng, dt: p._replace(cap=float(np.linalg.norm(p.case.omega_body) * rng.uniform(0.2, 0.8))),
    "rotation multiplied on the other side": lambda p, rng, dt: p._replace(multiplies_in_world=True),
    "explicit step": lambda p, rng, dt: p._replace(is_explicit=True),
    "moments of other axes": lambda p, rng, dt: renamed(p, rng),
    "other moments": lambda p, rng, dt: other_moments(p, rng),
    "products of inertia left out": lambda p, rng, dt: no_products(p, rng),
    "moments about the other point": lambda p, rng, dt: with_body(p, inertia_com=tensor(p.case.body)),
    "other gravity": lambda p, rng, dt: other_gravity(p, rng),
    "other start": lambda p, rng, dt: elsewhere(p, rng),
    "rows of another step": lambda p, rng, dt: p._replace(late=dt * int(rng.choice([1, -1, 2]))),
}


def omega_at(c: Columns, late: float) -> Array:
    assert c.path is not None
    _, R, omega = c.path(c.t + late)
    return omega if c.frame == "body" else np.einsum("kij,kj->ki", R, omega)


def lagging(c: Columns, rng: Any) -> Columns:
    assert c.path is not None
    before = np.concatenate((c.R[:1], c.R[:-1]))
    return c._replace(omega=np.einsum("kji,kjl,kl->ki", before, c.R, c.path(c.t)[2]), frame="body")


def in_angles(c: Columns, rng: Any) -> Columns:
    """ω = rates of the angles: the slope from rows as near as one likes."""
    assert c.path is not None
    h = 1e-4 * (c.t[1] - c.t[0])
    near = [Rotation.from_matrix(c.path(c.t + late)[1]).as_euler(c.kind) for late in (-h, h)]
    before, after = np.unwrap(np.stack(near), axis=0)
    return c._replace(omega=(after - before) / (2 * h), frame="body")


def integrated(c: Columns, rng: Any) -> Columns:
    omega = c.omega if c.frame == "body" else np.einsum("kji,kj->ki", c.R, c.omega)
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


# what is written or read wrongly, before the numbers are rounded
WRITTEN: dict[str, Callable[[Columns, Any], Columns]] = {
    "ω half a step late or early": lambda c, rng: c._replace(
        omega=omega_at(c, rng.choice([-0.5, 0.5]) * (c.t[1] - c.t[0]))
    ),
    "ω of the next row": lambda c, rng: c._replace(omega=omega_at(c, rng.choice([-1, 1]) * (c.t[1] - c.t[0]))),
    "ω in the body of the row before": lagging,
    "rates of angles for ω": in_angles,
    "ω integrated as angles": integrated,
    "rotations transposed": lambda c, rng: c._replace(R=c.R.transpose(0, 2, 1)),
    "world with other axes": other_world,
    "body with other axes": other_body,
    "left-handed world": mirrored,
    "ω in the other frame": lambda c, rng: c._replace(frame={"body": "world", "world": "body"}[c.frame]),
    "unit of ω": lambda c, rng: c._replace(omega=c.omega / rng.choice([pi / 180, pi / 30, 2 * pi])),
    "sign of ω": lambda c, rng: c._replace(omega=-c.omega),
    "axes of ω": lambda c, rng: c._replace(omega=c.omega @ signed(rng, proper=False)),
    "gyroscope mounted askew": lambda c, rng: c._replace(omega=c.omega @ turned(rng)),
    "unit of time": lambda c, rng: c._replace(t=c.t / rng.choice([1e-3, 1e-6, 60.0])),
    "times from another zero": lambda c, rng: c._replace(t=c.t + rng.uniform(0.5, 3)),
    "unit of length": lambda c, rng: c._replace(x=c.x / rng.choice([1e-3, 0.01, 0.0254, 0.3048])),
    "origin": lambda c, rng: c._replace(x=c.x + np.abs(c.x).max() * rng.normal(size=3)),
    "displacement for position": lambda c, rng: c._replace(x=c.x - c.x[0]),
    "order of quaternions": lambda c, rng: c._replace(kind="xyzw"),
    "degrees, or moving axes": lambda c, rng: c._replace(kind=f"{c.kind} {rng.choice(['degrees', 'swapped'])}"),
}
# mistake → causes that name it, with a case and with a body alone; None where rows alone cannot show it
CAUSES: dict[str, tuple[str, str | None]] = {
    "ω in the other frame": ("omega-frame", "omega-frame"),
    "unit of ω": ("omega-unit", "omega-unit"),
    "sign of ω": ("omega-sign", "omega-sign"),
    "axes of ω": ("omega-axes", "omega-axes"),
    "gyroscope mounted askew": ("omega-turned", "omega-turned"),
    "ω half a step late or early": ("omega-half-step", "omega-half-step"),
    "ω of the next row": ("omega-row", "omega-row"),
    "ω in the body of the row before": ("omega-lag", "omega-lag"),
    "rates of angles for ω": ("angle-rates", "angle-rates"),
    "ω integrated as angles": ("angles-integrated", "angles-integrated"),
    "rotations transposed": ("rotation-transposed", "rotation-transposed"),
    "degrees, or moving axes": ("rotation-angles", "rotation-angles"),
    "order of quaternions": ("quaternion-order", "quaternion-order"),
    "rotation multiplied on the other side": ("rotation-product", "rotation-product"),
    "unit of time": ("time-unit", "time-unit"),
    "times from another zero": ("time-shift", None),
    "rows of another step": ("rows-late", None),
    "world with other axes": ("world-axes", "world-axes gravity"),
    "body with other axes": ("body-axes", "body-axes moments"),
    "left-handed world": ("left-handed", None),
    "unit of length": ("length-unit", "length-unit"),
    "origin": ("origin", None),
    "displacement for position": ("displacement", None),
    "gyroscopic torque left out": ("gyroscopic-torque", "gyroscopic-torque"),
    "damping": ("damping", "damping"),
    "cap on ω": ("cap", "cap"),
    "moments of other axes": ("body-axes moments", "body-axes moments"),
    "other moments": ("moments", "moments"),
    "products of inertia left out": ("moments", "moments"),
    "moments about the other point": ("moments", "moments"),
    "other gravity": ("gravity world-axes", "gravity world-axes"),
    "explicit step": ("explicit-step omega-half-step", "explicit-step omega-half-step"),
    "other start": ("other-start", None),
}
EXACT = {
    "ω half a step late or early",
    "ω of the next row",
    "ω in the body of the row before",
    "rates of angles for ω",
    "times from another zero",
    "rows of another step",
}
POOR = {"cap on ω", "rotation multiplied on the other side", "explicit step"}
ANGLES = {"rates of angles for ω", "ω integrated as angles", "degrees, or moving axes"}
HEAVY = {"left-handed world", "unit of length", "origin", "displacement for position", "other gravity"}


def body_kinds(mistakes: set[str], with_case: bool) -> set[str]:
    """The kinds of bodies that can show all of these mistakes."""
    kinds = {"free", "flying", "heavy", "top"}
    if mistakes & HEAVY or (not with_case and "world with other axes" in mistakes):
        kinds -= {"free"}
    if "displacement for position" in mistakes:
        kinds -= {"flying"}
    if mistakes & {"moments about the other point"}:
        kinds = {"heavy"}
    if mistakes & {"moments of other axes", "body with other axes", "products of inertia left out"}:
        kinds -= {"top"}
    return kinds


def draw_case(rng: Any, kinds: set[str]) -> Case:
    """A named case, or a body that could exist, in axes of its own or in principal ones."""
    while True:
        if rng.random() < 0.4:
            case = CASES[NAMED[rng.integers(len(NAMED))]]
            body = case.body
            kind = (
                "flying" if not body.fixed else "free" if body.is_free else "heavy" if body.symmetry is None else "top"
            )
            if kind in kinds and (body.symmetry is None or "top" in kinds):
                return case
            continue
        kind = sorted(kinds)[rng.integers(len(kinds))]
        mass, (a, b, c) = rng.uniform(0.5, 10), rng.uniform(0.15, 1.0, 3)
        a, com = (
            (b, np.array([0, 0, rng.uniform(0.3, 1)]))
            if kind == "top"
            else (a, rng.uniform(-0.5, 0.5, 3) * (kind == "heavy"))
        )
        Q = np.eye(3) if kind == "top" or rng.random() < 0.3 else turned(rng)
        I = mass / 5 * Q @ np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) @ Q.T
        body = RigidBody(mass, com, (I + I.T) / 2, (0, 0, 0 if kind == "free" else -9.81), kind != "flying")
        omega = rng.normal(size=3)
        omega *= rng.uniform(2, 12) / np.linalg.norm(omega)
        omega = np.array([*rng.normal(size=2), rng.uniform(5, 30)]) if kind == "top" else omega
        flight = {} if body.fixed else {"position": rng.normal(size=3), "velocity": 4 * rng.normal(size=3)}
        return Case(kind, body, turned(rng), omega, **flight)


def run(rng: Any, mistakes: Iterable[str], with_case: bool, reach: float = 1.0) -> Run:
    """A run with these mistakes that they can be seen in. reach : rows are so many times farther apart than usual."""
    mistakes = set(mistakes)
    while True:
        case = draw_case(rng, body_kinds(mistakes, with_case))
        products = case.body.inertia_com - np.diag(np.diag(case.body.inertia_com))
        if "products of inertia left out" in mistakes and np.abs(products).max() < 0.1 * case.body.inertia.max():
            continue
        speed = float(np.linalg.norm(case.omega_body))
        dt = min(LONGEST, min(WIDEST, rng.uniform(0.03, 0.5)) / speed) * rng.uniform(0.4, 1) * reach
        t = np.arange(int(rng.integers(50, 150))) * dt
        program = Program(case)
        for name in mistakes & set(MADE):
            program = MADE[name](program, rng, dt)
        columns = written(rng, program, t, mistakes)
        if not np.isfinite(columns.R).all():
            continue  # it blew up
        right = columns
        for name in [name for name in WRITTEN if name in mistakes]:
            columns = WRITTEN[name](columns, rng)
        if is_seen(case, right, columns, bool(mistakes & set(MADE))):
            break
    rows, ways, floor = read(columns, int(rng.choice([5, 6, 7, 9, 12, 17])))
    exact = exact_motion(Program(case), 1.3 * t[-1] + 4) if with_case else None
    causes = [set((CAUSES[name][not with_case] or "").split()) for name in mistakes]
    return Run(rows, ways, case.body, exact, floor, causes)


def written(rng: Any, program: Program, t: Array, mistakes: set[str]) -> Columns:
    """The columns of a program, right but for what it computes."""
    is_poor = program.multiplies_in_world or program.cap < inf or program.is_explicit
    is_poor = is_poor or not (mistakes & EXACT or rng.random() < 0.4)
    path = None
    if is_poor:
        is_rk4 = rng.random() < 0.5 and program.cap == inf and not program.is_explicit
        substeps = 1 if program.is_explicit else int(rng.integers(1, 3) if is_rk4 else rng.integers(3, 10))
        x, R, omega = poor_motion(program, t, substeps, is_rk4)
    else:
        path = exact_motion(program, t[-1] + 4 * (t[1] - t[0]))
        x, R, omega = path(t + program.late)
    frame = (
        "body"
        if program.multiplies_in_world or mistakes & {"ω integrated as angles"}
        else str(rng.choice(["body", "world"]))
    )
    kind = str(rng.choice(["wxyz", "matrix", SEQUENCES[rng.integers(4)]]))
    kind = SEQUENCES[rng.integers(4)] if mistakes & ANGLES else "wxyz" if "order of quaternions" in mistakes else kind
    return Columns(t, R, omega if frame == "body" else np.einsum("kij,kj->ki", R, omega), x, frame, kind, path)


def is_seen(case: Case, right: Columns, columns: Columns, is_made: bool) -> bool:
    """Whether a mistake changes anything: ω by 1 %, rotations by 0.05 rad, or positions, times or how they are read."""
    if is_made:
        until = right.t[-1]
        if np.nanmax(np.abs(exact_motion(Program(case), 1.01 * until)(right.t)[1] - right.R)) < 0.05:
            return False
    if columns.frame == right.frame and columns.omega is right.omega:
        return True
    omega = columns.omega
    if columns.frame != right.frame:
        omega = np.einsum("kij,kj->ki" if right.frame == "world" else "kji,kj->ki", right.R, omega)
    sizes = np.linalg.norm(omega - right.omega, axis=1), np.linalg.norm(right.omega, axis=1)
    return bool(np.nanmedian(sizes[0]) > 0.01 * np.nanmedian(sizes[1]))


def rounded(v: Array, digits: int) -> Array:
    """Numbers to so many digits."""
    if digits >= 17:
        return v
    unit = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(np.where(v == 0, 1.0, v)))))
    return np.round(v * unit) / unit


def read(c: Columns, digits: int) -> tuple[Rows, dict[str, Array], Floor]:
    """The columns as a file has them, and as a reader reads them."""
    digit = 10.0**-digits if digits < 17 else 1e-16
    omega, x, ways, angles = rounded(c.omega, digits), rounded(c.x, digits), dict[str, Array](), None
    sequence, _, wrong = c.kind.partition(" ")
    if sequence == "matrix":
        R = rounded(c.R, digits)
    elif sequence in ("wxyz", "xyzw"):
        q = rounded(Rotation.from_matrix(c.R).as_quat(scalar_first=sequence == "wxyz"), digits)
        R = Rotation.from_quat(q, scalar_first=True).as_matrix()
        ways["--quat xyzw"] = Rotation.from_quat(q).as_matrix()
    else:
        angles = c.angles
        if angles is None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # near a pole
                angles = np.unwrap(Rotation.from_matrix(c.R).as_euler(sequence), axis=0)
        angles = rounded(np.degrees(angles) if wrong == "degrees" else angles, digits)
        said = sequence.swapcase() if wrong == "swapped" else sequence
        R = Rotation.from_euler(said, angles).as_matrix()
        for option, axes, values in (
            ("--units angle=deg", said, np.radians(angles)),
            (f"--angles {said.swapcase()}", said.swapcase(), angles),
            (f"--angles {said.swapcase()} --units angle=deg", said.swapcase(), np.radians(angles)),
        ):
            ways[option] = Rotation.from_euler(axes, values).as_matrix()
    floor = Floor(
        0.0,
        digit * (1 if angles is None else float(np.abs(angles).max())),
        digit * np.abs(omega).max(),
        digit * np.abs(x).max(),
    )
    return Rows(c.t, R, omega, x, c.frame, angles), ways, floor


def right_run(rng: Any) -> Run:
    """A right run of any kind: also steady, planar or resting, of few rows or far apart, of few digits, with noise of sensors."""
    style = str(rng.choice(["any", "any", "steady", "planar", "resting", "noise", "far", "few", "slow"]))
    case = draw_case(rng, {"free", "flying", "heavy", "top"})
    speed = float(np.linalg.norm(case.omega_body))
    if style in ("steady", "resting"):
        case = draw_case(rng, {"free", "flying"})
        speed = 0.0 if style == "resting" else rng.uniform(0.5, 10)
        case = Case(
            style, case.body, case.rotation, case.body.axes[rng.integers(3)] * speed, case.position, case.velocity
        )
    elif style == "planar":  # a pendulum about a principal axis
        body = RigidBody(1.0, (0, 0, -rng.uniform(0.2, 1)), rng.uniform(0.5, 0.9, 3))
        case, speed = Case(style, body, np.eye(3), (rng.uniform(-3, 3), 0, 0)), 4.0
    step = {"far": rng.uniform(0.5, 8), "slow": rng.uniform(0.001, 0.02)}.get(style, rng.uniform(0.02, 1.0))
    n = int(rng.integers(4, 12 if style == "few" else 201))
    t = np.arange(max(4, min(n, int(200 / step)))) * step / (speed or 1.0)
    exact = exact_motion(Program(case), 1.1 * t[-1] + 1)
    x, R, omega = exact(t)
    frame, sequence = str(rng.choice(["body", "world"])), SEQUENCES[rng.integers(4)]
    omega = omega if frame == "body" else np.einsum("kij,kj->ki", R, omega)
    if style == "noise":
        noise = float(rng.choice([1e-4, 1e-3, 1e-2, 5e-2]))
        R = R @ Rotation.from_rotvec(noise * rng.normal(size=(len(t), 3))).as_matrix()
        omega = omega + noise * rng.choice([0.1, 1.0]) * (speed or 1.0) * rng.normal(size=(len(t), 3))
        x = x + noise * rng.normal(size=(len(t), 3))
    columns = Columns(t, R, omega, x, frame, str(rng.choice(["wxyz", "matrix", sequence])), None)
    rows, ways, floor = read(columns, int(rng.integers(3, 18)))
    gone = str(rng.choice(["R", "omega", "x", "", "", ""]))
    if gone:
        rows = rows._replace(**{gone: None, **({"angles": None} if gone == "R" else {})})
        ways = {} if gone == "R" else ways
    return Run(rows, ways, case.body, exact if rng.random() < 0.5 else None, floor, [])


# --------------------------------------------------------------------------------------------------------------- power


def named(one: Run) -> bool:
    """Whether each mistake is among the findings."""
    found = {finding.cause for finding in one.findings()}
    return all(found & causes for causes in one.causes)


def power(mistake: str, with_case: bool, runs: int, seed: int, reach: float = 1.0) -> int:
    """In how many runs this mistake is named."""
    place = list(CAUSES).index(mistake)
    return sum(
        named(run(np.random.default_rng([seed, place, k, with_case]), [mistake], with_case, reach)) for k in range(runs)
    )


def pair(rng: Any) -> list[str]:
    """Two mistakes that do not touch the same columns in the same way."""
    while True:
        one, other = (str(name) for name in rng.choice(list(CAUSES), 2, replace=False))
        kinds = [
            CAUSES[name][0].partition("-")[0].replace("angles", "omega").replace("angle", "omega")
            for name in (one, other)
        ]
        both = {one, other}
        is_one_program = both <= set(MADE) or (both & EXACT and both & (POOR | {"rows of another step"}))
        is_one_reading = len(both & (ANGLES | {"order of quaternions"})) > 1
        if kinds[0] != kinds[1] and not is_one_program and not is_one_reading and body_kinds(both, True):
            return [one, other]


def table(runs: int, seed: int) -> list[str]:
    """The table of docs/diagnosis.md: how many of so many runs are named."""
    lines = [
        "| mistake | with a case | with a body alone | with a case, rows 3 times as far apart |",
        "|---|--:|--:|--:|",
    ]
    for mistake, (_, alone) in CAUSES.items():
        cells = [power(mistake, True, runs, seed), power(mistake, False, runs, seed) if alone else "–"]
        lines.append(f"| {mistake} | {cells[0]} | {cells[1]} | {power(mistake, True, runs, seed, 3.0)} |")
    return lines


if __name__ == "__main__":
    print("\n".join(table(*map(int, sys.argv[1:] or (12, 1)))))
