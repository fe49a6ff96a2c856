"""The frames and orders in which a trajectory of a rigid body is written, and its errors in them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import Case, RigidBody, StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.truth import truths
from lagrange_bench.judging.findings import smallest_turn
from lagrange_bench.judging.fits_kinematics import kinematics
from lagrange_bench.judging.vectors import steps, tensor, to_body, to_world

Array = np.ndarray
Exact = tuple[Array, Array, Array]  # position (n, 3), matrix (n, 3, 3), angular velocity in the body (n, 3)
UNITS = {  # what is judged → its unit, in the order in which it is reported
    **{"position": "m", "axis": "rad", "rotation": "rad", "spin": "rad", "length": "m", "orthogonality": "1"},
    **{"omega": "rad/s", "spin_rate": "rad/s", "kinematics": "rad/s", "energy": "J", "momentum": "kg m²/s"},
}
AXES = {sign + name: unit for name, e in zip("xyz", np.eye(3), strict=True) for sign, unit in (("", e), ("-", -e))}
ATTITUDES = ("quaternion", "matrix", "rotation vector", "angles")
# quantity → the groups of columns that it is judged by
GROUPS = {"position": ("position", "displacement"), "rotation": ATTITUDES, "omega": ("omega",), "time": ("time",)}
# another gravity must fit a flight so many times better
FALLS = 10
# the largest |RᵀR − 1| of a rotation; more if the file has few digits
OFF = 1e-3
# points of a curve
POINTS = 2000
# Sums of steps are rounded: times that are as near to decimals of DECIMALS places, relative to the last time, may be these.
DECIMALS, NEAR = 8, 1e-10


@dataclass(frozen=True)
class Options:
    """What the user says of how rows are written; None where nothing is said.

    columns : name → word of the header, or index from 0. units : group → unit. angles : the axes of three angles, as SciPy names
    them. where : column → the word in its rows that are read. step : s, where there are no times. t0 : s, the first time.
    quat : the order of quaternions without names. omega_frame : of ω. since, until : s, only rows from this time to that one.
    up, axis : the axis of these numbers that points up, and the one of symmetry.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    angles: str | None = None
    where: Mapping[str, str] = field(default_factory=dict)
    step: float | None = None
    t0: float | None = None
    quat: str | None = None
    omega_frame: str | None = None
    since: float | None = None
    until: float | None = None
    up: str | None = None
    axis: str | None = None

    def __post_init__(self) -> None:
        known = {"quat": ("wxyz", "xyzw"), "omega_frame": ("body", "world"), "up": AXES, "axis": AXES}
        for name, values in known.items():
            value = getattr(self, name)
            if value is not None and value not in values:
                raise ValueError(f"{name} must be one of {', '.join(values)}; got {value!r}")


class Frames:
    """A rigid body, and the axes in which a trajectory of it is written.

    `to_world` takes vectors from the world of the rows to the world of the case. `from_body` takes them from the body of the case
    to the body of the rows. `known_until` is the time up to which the exact motion is known.

    case : its exact motion is compared with the rows; without a case they are compared with themselves. digit : the rounding of
    matrices in the file.
    """

    def __init__(self, body: RigidBody, options: Options, digit: float = 0.0, case: Case | None = None):
        self.rigid_body, self.axis, self.digit, self.case, self.known_until = body, body.axis, digit, case, math.inf
        if options.axis is not None and self.axis is None:
            raise ValueError("--axis is of no use, for the body has no axis of symmetry")
        self.options, self.to_world, self.from_body = options, np.eye(3), np.eye(3)
        self.frame, self.angles = options.omega_frame or "body", options.angles or "xyz"
        if options.up is not None:
            self.to_world = smallest_turn(AXES[options.up], body.up)
        if options.axis is not None and self.axis is not None:
            self.from_body = smallest_turn(AXES[options.axis], self.axis).T
        self.length = float(np.linalg.norm(body.com)) if body.fixed else 0.0
        if case is None:
            self.sizes = {"position": self.length or 1.0}
            self.energy, self.momentum, self.spin_rate = np.array(np.nan), np.full(3, np.nan), np.nan
            self.launch = np.full(3, np.nan), np.full(3, np.nan)
            return
        if not (kinds.free_body(body) or kinds.symmetric_body(body)):
            scale = float(body.scales(body.split_state(case.state)[0])[2])
            self.known_until = max(truths.LONGEST * scale, case.until)
        x, R, omega = self.exact([0.0, case.until])
        self.start = x[0]
        size = self.length or float(np.linalg.norm(x, axis=1).max()) or 1.0
        self.sizes = {"position": size, "rotation": 1.0, "omega": float(np.linalg.norm(omega, axis=1).max())}
        self._refer(R[0], omega[0])

    def _refer(self, R: Array, omega: Array) -> None:
        """Compute the constants of the motion from one attitude and the angular velocity in the body."""
        self.spin_rate = math.nan if self.axis is None else float(omega @ self.axis)
        self.energy, self.momentum = self.rigid_body.energy_of(R, omega), self.rigid_body.momentum_of(R, omega)
        kinetic = float(omega @ self.rigid_body.momentum_of(np.eye(3), omega)) / 2
        self.sizes |= {"energy": kinetic, "momentum": float(np.linalg.norm(self.momentum))}

    def refer(self, trajectory: Mapping[str, Array]) -> None:
        """Compute the constants of the motion from the first good row, and the parabola that fits all positions best."""
        R, omega = self.motion(trajectory)
        if omega is not None and len(good := np.flatnonzero(np.isfinite(R).all((1, 2)) & np.isfinite(omega).all(1))):
            self._refer(R[good[0]], omega[good[0]])
        self.start = R[0] @ self.rigid_body.com if self.rigid_body.fixed else np.zeros(3)
        for x in [] if self.rigid_body.fixed else self.positions(trajectory):
            good = np.isfinite(x).all(1)
            if not good.any():
                continue
            t, fall = trajectory["time"][good, 0], x[good] - trajectory["time"][good] ** 2 / 2 * self.rigid_body.gravity
            launch, free = (polyfit(t, fall, degree, full=True)[0] for degree in (1, 2))
            off, least = (np.abs(fall - polyval(t, each).T).max() for each in (launch, free))
            # of another gravity, the errors grow like t²; the best launch for the right one would hide that
            self.launch = tuple(free[:2] if FALLS * least < off else launch)

    def flight(self, t: Array) -> Array:
        """The parabola x₀ + v t + g t²/2, (N, 3), at times (N, 1)."""
        return self.launch[0] + t * self.launch[1] + t**2 / 2 * self.rigid_body.gravity  # type: ignore[no-any-return]

    def exact(self, t: ArrayLike) -> Exact:
        """The motion of the case; NaN after `known_until`, because its series would take too long, and where it is lost."""
        assert self.case is not None
        times = np.asarray(t, dtype=float)
        known = np.abs(times) <= self.known_until
        try:
            motion = self.case.solution(times[known])
        except (ValueError, StepError):
            clock = "perhaps the times are no seconds, or start elsewhere: --units t=ns, --t0 0"
            raise ValueError(f"no exact motion is known at t = {np.abs(times).max():.6g} s; {clock}") from None
        is_finite = np.isfinite(motion.y).all(axis=1)
        known[known], motion = is_finite, replace(motion, y=motion.y[is_finite], t=motion.t[is_finite])
        R = motion.rotation.as_matrix()
        parts = R @ self.rigid_body.com if self.rigid_body.fixed else motion.position, R, motion.omega_body
        x, R, omega = (np.full((len(times), *part.shape[1:]), np.nan) for part in parts)
        x[known], R[known], omega[known] = parts
        return x, R, omega

    # ------------------------------------------------------------------------------- what the rows say, in the axes of the case

    def positions(self, trajectory: Mapping[str, Array]) -> Iterator[Array]:
        """The positions (n, 3) of each group of columns that holds them."""
        for group in ("position", "displacement"):
            if group in trajectory:
                x = trajectory[group] @ self.to_world.T
                yield x + self.start if group == "displacement" else x

    def attitudes(self, trajectory: Mapping[str, Array]) -> list[tuple[Array, dict[str, Array]]]:
        """`attitude` of each group of columns that holds attitudes."""
        return [self.attitude(group, trajectory[group]) for group in ATTITUDES if group in trajectory]

    def matrices(self, trajectory: Mapping[str, Array]) -> Array | None:
        """The attitudes (n, 3, 3) of the first group of columns that holds attitudes; None without one."""
        return next((self.attitude(name, trajectory[name])[0] for name in ATTITUDES if name in trajectory), None)

    def other_readings(self, trajectory: Mapping[str, Array], other_order: str = "") -> dict[str, Array]:
        """Other ways to read the first group of attitudes: the option → matrices (n, 3, 3).

        other_order : the option for the other order of quaternions, where their names tell an order.
        """
        group = next((name for name in ATTITUDES if name in trajectory), "")
        values, readings = trajectory.get(group, np.empty(0)), dict[str, Rotation]()
        if group == "quaternion":
            other = "xyzw" if self.options.quat == "wxyz" else "wxyz"
            readings[other_order or f"--quat {other}"] = _turns(group, values, other)
        elif group == "angles":
            axes, degrees = self.angles.swapcase(), "--units angle=deg"
            readings[degrees] = _turns(group, np.deg2rad(values), self.angles)
            readings[f"--angles {axes}"] = _turns(group, values, axes)
            readings[f"--angles {axes} {degrees}"] = _turns(group, np.deg2rad(values), axes)
        elif group == "rotation vector":
            readings["--units angle=deg"] = _turns(group, np.deg2rad(values))
            for axes in ("XYZ", "xyz"):
                option = f"--columns angle1=…,angle2=…,angle3=… --angles {axes}"
                readings[option] = _turns("angles", values, axes)
                readings[f"{option} --units angle=deg"] = _turns("angles", np.deg2rad(values), axes)
        return {option: self.to_world @ turns.as_matrix() @ self.from_body for option, turns in readings.items()}

    def motion(self, trajectory: Mapping[str, Array]) -> tuple[Array, Array | None]:
        """Attitudes, or the identity if there are none; and ω in the body, or None if it cannot be known."""
        R, is_body = self.matrices(trajectory), self.frame == "body"
        omega = self.omega(trajectory) if "omega" in trajectory else None
        if omega is not None and not is_body:
            omega = None if R is None else to_body(R, omega)
        return np.broadcast_to(np.eye(3), (len(trajectory["time"]), 3, 3)) if R is None else R, omega

    def omega(self, trajectory: Mapping[str, Array]) -> Array:
        """The angular velocity in its own frame, with the axes of the case."""
        turn = self.from_body if self.frame == "body" else self.to_world.T
        return trajectory["omega"] @ turn

    def with_omega(self, trajectory: dict[str, Array]) -> dict[str, Array]:
        """The trajectory with ω = I⁻¹ L in place of an angular momentum L, in the frame of L."""
        if "momentum" not in trajectory or "omega" in trajectory:
            return trajectory
        others = {name: values for name, values in trajectory.items() if name != "momentum"}
        R, L = self.motion({**others, "omega": trajectory["momentum"]})
        if L is None:
            raise ValueError("an angular momentum in the world tells ω only with rotations; in the body: --omega body")
        omega = np.linalg.solve(tensor(self.rigid_body), L.T).T
        in_rows = omega @ self.from_body.T if self.frame == "body" else to_world(R, omega) @ self.to_world
        return {**others, "omega": in_rows}

    def attitude(self, group: str, values: Array) -> tuple[Array, dict[str, Array]]:
        """Matrices from the body to the world of the case; and how far they are from orthogonal, or quaternions from length 1.

        A matrix that is no rotation becomes NaN: it mirrors, or is off by more than `OFF` and than the digits of the file.
        """
        defect = {}
        if group == "matrix":
            R = values.reshape(-1, 3, 3)
            off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max((1, 2))
            defect["orthogonality"] = off
            rotation = (off <= max(OFF, 4 * self.digit)) & (np.linalg.det(R) > 0)
            R = np.where(rotation[:, None, None], R, np.nan)
        else:
            known = np.isfinite(values).all(1)
            if group == "quaternion":
                length = np.linalg.norm(values, axis=1)
                defect["orthogonality"], known = np.abs(length - 1), np.isfinite(length) & (length > 0)
            R = _turns(group, values, self.angles if group == "angles" else str(self.options.quat)).as_matrix()
            R[~known] = np.nan
        return self.to_world @ R @ self.from_body, defect

    # ------------------------------------------------------------------------------------------------------------ errors

    def errors(self, trajectory: Mapping[str, Array], exact: Exact | None) -> dict[str, Array]:
        """The error of each quantity in each row, (n,); where several groups hold one quantity, the larger error counts.

        Without an exact motion, constants of the motion are compared with the first row, and positions with the rotations.
        """
        largest: dict[str, Array] = {}

        def add(**errors: Array) -> None:
            largest.update({name: np.maximum(error, largest.get(name, 0.0)) for name, error in errors.items()})

        attitudes = self.attitudes(trajectory)
        for R, defect in attitudes:
            add(**({} if exact is None else self._turned(exact[1].transpose(0, 2, 1) @ R)), **defect)
        for x in self.positions(trajectory):
            length = np.linalg.norm(x, axis=1)
            if exact is not None:
                add(position=np.linalg.norm(x - exact[0], axis=1))
            elif self.rigid_body.fixed and attitudes:
                add(position=np.linalg.norm(x - attitudes[0][0] @ self.rigid_body.com, axis=1))
            elif not self.rigid_body.fixed:
                add(position=np.linalg.norm(x - self.flight(trajectory["time"]), axis=1))
            if self.length:
                add(length=np.abs(length - self.length))
            if self.length and self.axis is not None and not attitudes and exact is not None:
                add(axis=_angle(x / length[:, None], exact[0]))
        if "omega" in trajectory:
            is_body, omega = self.frame == "body", self.omega(trajectory)
            if exact is not None:
                right = exact[2] if is_body else to_world(exact[1], exact[2])
                add(omega=np.linalg.norm(omega - right, axis=1))
            if is_body and self.axis is not None:
                add(spin_rate=np.abs(omega @ self.axis - self.spin_rate))
            for R, _ in attitudes:
                in_body = omega if is_body else to_body(R, omega)
                if self.axis is not None:
                    add(spin_rate=np.abs(in_body @ self.axis - self.spin_rate))
                add(energy=np.abs(self.rigid_body.energy_of(R, in_body) - self.energy))
                off = self.rigid_body.momentum_of(R, in_body) - self.momentum
                without_torque = self.rigid_body.is_free  # else only the part about the vertical is conserved
                add(momentum=np.linalg.norm(off, axis=1) if without_torque else np.abs(off @ self.rigid_body.up))
            if is_body and not attitudes and kinds.free_body(self.rigid_body):
                length = np.linalg.norm(self.rigid_body.momentum_of(np.eye(3), omega), axis=1)
                add(energy=np.abs(self.rigid_body.energy_of(np.eye(3), omega) - self.energy))
                add(momentum=np.abs(length - np.linalg.norm(self.momentum)))
            if exact is None and attitudes:
                off = kinematics(trajectory["time"], attitudes[0][0], omega, self.frame)
                if off is not None:
                    add(kinematics=off)
        return {name: largest[name] for name in UNITS if name in largest}

    def starts(self, first: Mapping[str, float], least: float, floors: Mapping[str, float]) -> bool:
        """Whether a row with these errors is the start of the case, relative to the size of each quantity."""
        return all(error <= least * self.sizes[name] + 2 * floors.get(name, 0.0) for name, error in first.items())

    def _turned(self, E: Array) -> dict[str, Array]:
        """The angles of rotations E from the right attitude: the whole angle, its part about the axis, and the tilt of the axis.

        The angle is at least the chord ‖E − 1‖/√2, which also shows that a matrix is no rotation in its last digits.
        """
        vector = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], 1)
        trace = E.trace(axis1=1, axis2=2)
        angle = np.arctan2(np.linalg.norm(vector, axis=1), trace - 1)
        chord = np.linalg.norm(E - np.eye(3), axis=(1, 2)) / math.sqrt(2)
        rotation = np.maximum(angle, chord)
        if self.axis is None:
            return {"rotation": rotation}
        along = E @ self.axis
        # of the quaternion (w, v) of E: 4 w v·axis, 4 w² and 4 (v·axis)²; of the two ratios the one that keeps its digits
        both, w, v = np.abs(vector @ self.axis), 1 + trace, 1 + 2 * along @ self.axis - trace
        spin = 2 * np.arctan2(np.where(w >= v, both, v), np.where(w >= v, w, both))
        return {"axis": _angle(along, self.axis), "rotation": rotation, "spin": spin}

    def by_the_better_clock(self, rows: dict[str, Array]) -> tuple[dict[str, Array], Exact | None, list[str]]:
        """The errors of all rows, (n,) each, the exact motion, and what to say of the times; rows get the better times (n, 1).

        A sum of steps is rounded, so the decimals near to the times may be the right ones. Those with the smaller errors are
        taken.
        """

        def errors_at(t: Array) -> tuple[dict[str, Array], Exact | None]:
            exact = None if self.case is None else self.exact(t[:, 0])
            return self.errors({**rows, "time": t}, exact), exact

        t, rounded = rows["time"], _decimals(rows["time"])
        (errors, exact), off = errors_at(t), float(np.max(np.abs(rounded - t)))
        if off == 0 or off > NEAR * float(np.max(np.abs(t))):
            return errors, exact, []
        others, motion = errors_at(rounded)
        judged = [name for name in ("rotation", "position", "omega", "kinematics") if name in errors]
        before, after = (
            max((float(np.median(each[name])) for name in judged), default=0.0) for each in (errors, others)
        )
        if after >= before:
            return errors, exact, []
        rows["time"] = rounded
        matters = after < before / 2 and off > 1e-13 * float(np.max(np.abs(t)))
        note = f"The times are taken for the decimals near to them, by up to {off:.1e} s: sums of steps are rounded."
        return others, motion, [note] if matters else []

    def count_turns(self, rows: Mapping[str, Array], exact: Exact | None) -> float:
        """How often the body turns, ∫|ω| dt/2π; without ω by all attitudes, NaN without either."""
        t, omega = rows["time"], rows.get("omega") if exact is None else exact[2]
        if omega is not None:
            return float(np.trapezoid(np.linalg.norm(omega, axis=1), t[:, 0])) / math.tau
        R = self.matrices(rows)
        return math.nan if R is None else float(np.nansum(np.linalg.norm(steps(R), axis=1))) / math.tau


def blurred(t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times (n,) change by `blur`, s."""
    x, _, omega = exact
    rates = {"position": np.gradient(x, t, axis=0), "rotation": omega, "omega": np.gradient(omega, t, axis=0)}
    return {name: blur * float(np.linalg.norm(rate, axis=1).max()) for name, rate in rates.items()}


def _decimals(t: Array) -> Array:
    """Times rounded to the eighth decimal place of the last of them; a sum of steps is not far from such decimals."""
    last = float(np.max(np.abs(t)))
    # per second; a power of ten, so that decimals are its multiples
    unit = 10 ** (DECIMALS - math.floor(math.log10(last))) if last else 1.0
    return np.asarray(np.round(t * unit) / unit)


def hidden(floor: Mapping[str, float]) -> dict[str, float]:
    """The errors of each quantity that the digits of a file hide. floor : of each group of columns."""
    return {name: max(floor.get(group, 0.0) for group in groups) for name, groups in GROUPS.items()}


def curve(t: Array, error: Array) -> Array:
    """Times and the largest errors of some rows each, (2, M), to draw."""
    starts = np.unique(np.linspace(0, len(t), min(len(t), POINTS) + 1).astype(int))[:-1]
    return np.stack([t[starts], np.maximum.reduceat(error, starts)])


def _turns(group: str, values: Array, order: str = "") -> Rotation:
    """The rotations of a group of columns; of what is missing or has no direction any. order : of quaternions or of axes."""
    known = np.nan_to_num(values, posinf=0.0, neginf=0.0)
    if group == "angles":
        return Rotation.from_euler(order, known)
    if group == "rotation vector":
        return Rotation.from_rotvec(known)
    length = np.linalg.norm(known, axis=1, keepdims=True)
    return Rotation.from_quat(
        np.where(length > 0, known / np.where(length > 0, length, 1.0), 0.5), scalar_first=order == "wxyz"
    )


def _angle(a: Array, b: Array) -> Array:
    """The angle between vectors (..., 3); it keeps its digits where it is small."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))
