"""The frames, orders and units in which a trajectory of a rigid body is written, and its errors under them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import Case, RigidBody
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.truth import truths
from lagrange_bench.judging.consistency import Rows, into_body, tensor

Array = np.ndarray
Exact = tuple[Array, Array, Array]  # position (n, 3), matrix (n, 3, 3), angular velocity in the body (n, 3)
UNITS = {  # what is judged → its unit, in the order in which it is reported
    **{"position": "m", "axis": "rad", "rotation": "rad", "spin": "rad", "length": "m", "orthogonality": "1"},
    **{"omega": "rad/s", "spin_rate": "rad/s", "kinematics": "rad/s", "energy": "J", "momentum": "kg m²/s"},
}
AXES = {sign + name: unit for name, e in zip("xyz", np.eye(3), strict=True) for sign, unit in (("", e), ("-", -e))}
ATTITUDES = ("quaternion", "matrix", "rotation vector", "angles")
# quantity → the groups of columns that it is judged by
GROUPS = {"position": ("position", "displacement"), "rotation": ATTITUDES, "omega": ("omega",)}
FALLS = 10  # another gravity must fit a flight so many times better
OFF = 1e-3  # the largest |RᵀR − 1| of a rotation; more if the file has few digits


@dataclass(frozen=True)
class Convention:
    """How rotations, angular velocities and frames are written, see `judge`. The fields from `transposed` on are for hints."""

    quat: str = "wxyz"
    omega_frame: str = "body"
    up: str | None = None
    axis: str | None = None
    angles: str = "xyz"
    transposed: bool = False
    degrees: bool = False
    displaced: bool = False
    mirror: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        known = {"quat": ("wxyz", "xyzw"), "omega_frame": ("body", "world"), "up": (*AXES, None), "axis": (*AXES, None)}
        for name, values in known.items():
            if getattr(self, name) not in values:
                raise ValueError(f"{name} must be one of {', '.join(map(str, values))}; got {getattr(self, name)!r}")


class Frames:
    """A rigid body, and the axes in which a trajectory of it is written.

    `to_world` takes vectors from the world of the rows to the world of the case. `from_body` takes them from the body of the case
    to the body of the rows. `known_until` is the time up to which the exact motion is known.

    case : its exact motion is compared with the rows; without a case they are compared with themselves. digit : the rounding of
    matrices in the file.
    """

    def __init__(self, body: RigidBody, convention: Convention, digit: float = 0.0, case: Case | None = None):
        self.rigid_body, self.axis, self.digit, self.case, self.known_until = body, body.axis, digit, case, math.inf
        self._convert(convention)
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

    def _convert(self, convention: Convention) -> None:
        if convention.axis is not None and self.axis is None:
            raise ValueError("--axis is of no use, for the body has no axis of symmetry")
        mirror = np.eye(3) if convention.mirror is None else np.array([AXES[name] for name in convention.mirror])
        self.convention, self.hand = convention, round(float(np.linalg.det(mirror)))
        self.to_world = _turn(convention.up, self.rigid_body.up) @ mirror
        self.from_body = mirror.T @ (np.eye(3) if self.axis is None else _turn(convention.axis, self.axis).T)

    def changed(self, **changes: Any) -> Frames:
        """A copy in another convention."""
        other = copy(self)
        other._convert(replace(self.convention, **changes))
        return other

    @cached_property
    def others(self) -> dict[str, Frames]:
        """A mistake in words → the frames of the body that a user with this mistake has simulated."""
        body = self.rigid_body
        changes: dict[str, dict[str, Any]] = {}
        if np.any(body.gravity) and (np.any(body.weight) or not body.fixed):
            changes["gravity is reversed: it points up."] = {"gravity": -body.gravity}
        if self.length:
            steiner = tensor(body) - body.inertia_com
            about = "were taken for those about the"
            for one, two, sign in (("fixed point", "centre of mass", 1), ("centre of mass", "fixed point", -1)):
                words = f"the moments of inertia about the {one} {about} {two}."
                changes[words] = {"inertia_com": body.inertia_com + sign * steiner}
        others = {}
        for words, change in changes.items():
            other = copy(self)
            with warnings.catch_warnings(), suppress(ValueError):
                warnings.simplefilter("ignore", RuntimeWarning)  # of moments that no body has
                other.case = replace(self.case, body=RigidBody(**{**body.facts, **change}), exact={})  # type: ignore[type-var]
                others[words] = other
        return others

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
        for x in [] if self.rigid_body.fixed else self._positions(trajectory):
            some = np.isfinite(x).all(1)
            t, span = trajectory["time"][some], np.ptp(trajectory["time"]) or 1.0
            terms = np.column_stack((np.ones_like(t), t / span))
            fall = x[some] - t**2 / 2 * self.rigid_body.gravity
            place, way = np.linalg.lstsq(terms, fall, rcond=None)[0]
            with_g = np.column_stack((terms, (t / span) ** 2))
            free = np.linalg.lstsq(with_g, fall, rcond=None)[0]
            # of another gravity, the errors grow like t²; the best launch for the right one would hide that
            if FALLS * np.abs(fall - with_g @ free).max() < np.abs(fall - terms @ [place, way]).max():
                place, way = free[:2]
            self.launch = place, way / span

    def flight(self, t: Array) -> Array:
        """The parabola x₀ + v t + g t²/2, (N, 3), at times (N, 1)."""
        return self.launch[0] + t * self.launch[1] + t**2 / 2 * self.rigid_body.gravity  # type: ignore[no-any-return]

    def exact(self, t: ArrayLike) -> Exact:
        """The motion of the case; NaN after `known_until`, because its series would take too long, and where it is lost."""
        assert self.case is not None
        times = np.asarray(t, dtype=float)
        known = np.abs(times) <= self.known_until
        motion = self.case.solution(times[known])
        found = np.isfinite(motion.y).all(axis=1)
        known[known], motion = found, replace(motion, y=motion.y[found], t=motion.t[found])
        R = motion.rotation.as_matrix()
        parts = R @ self.rigid_body.com if self.rigid_body.fixed else motion.position, R, motion.omega_body
        x, R, omega = (np.full((len(times), *part.shape[1:]), np.nan) for part in parts)
        x[known], R[known], omega[known] = parts
        return x, R, omega

    def with_omega(self, trajectory: dict[str, Array]) -> dict[str, Array]:
        """The trajectory with ω = I⁻¹ L in place of an angular momentum L, in the frame of L."""
        if "momentum" not in trajectory or "omega" in trajectory:
            return trajectory
        others = {name: values for name, values in trajectory.items() if name != "momentum"}
        L, I = self.omega({**others, "omega": trajectory["momentum"]}), tensor(self.rigid_body)
        if self.convention.omega_frame == "body":
            return {**others, "omega": np.linalg.solve(I, L.T).T @ self.from_body.T}
        R = self.matrices(trajectory)
        if R is None:
            raise ValueError(
                "an angular momentum in the world tells ω only with the rotations; in the body: --omega body"
            )
        in_body = np.linalg.solve(I, into_body(R, L).T).T
        return {**others, "omega": (R @ in_body[..., None])[..., 0] @ self.to_world}

    def _positions(self, trajectory: Mapping[str, Array]) -> Iterator[Array]:
        for group in ("position", "displacement"):
            if group in trajectory:
                x = trajectory[group] @ self.to_world.T
                yield x + self.start if self.convention.displaced or group == "displacement" else x

    def attitudes(self, trajectory: Mapping[str, Array]) -> list[tuple[Array, dict[str, Array]]]:
        """`attitude` of each group of columns that holds attitudes."""
        return [self.attitude(group, trajectory[group]) for group in ATTITUDES if group in trajectory]

    def matrices(self, trajectory: Mapping[str, Array]) -> Array | None:
        """The attitudes (n, 3, 3) of the first group of columns that holds attitudes; None without one."""
        return next((self.attitude(name, trajectory[name])[0] for name in ATTITUDES if name in trajectory), None)

    def motion(self, trajectory: Mapping[str, Array]) -> tuple[Array, Array | None]:
        """Attitudes, or the identity if there are none; and ω in the body, or None if it cannot be known."""
        R, body = self.matrices(trajectory), self.convention.omega_frame == "body"
        omega = self.omega(trajectory) if "omega" in trajectory else None
        if omega is not None and not body:
            omega = None if R is None else into_body(R, omega)
        return np.broadcast_to(np.eye(3), (len(trajectory["time"]), 3, 3)) if R is None else R, omega

    def omega(self, trajectory: Mapping[str, Array]) -> Array:
        """The angular velocity in its own frame, with the axes of the case."""
        turn = self.from_body if self.convention.omega_frame == "body" else self.to_world.T
        return self.hand * trajectory["omega"] @ turn

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
        for x in self._positions(trajectory):
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
            body, omega = self.convention.omega_frame == "body", self.omega(trajectory)
            if exact is not None:
                right = exact[2] if body else (exact[1] @ exact[2][..., None])[..., 0]
                add(omega=np.linalg.norm(omega - right, axis=1))
            if body and self.axis is not None:
                add(spin_rate=np.abs(omega @ self.axis - self.spin_rate))
            for R, _ in attitudes:
                in_body = omega if body else into_body(R, omega)
                if self.axis is not None:
                    add(spin_rate=np.abs(in_body @ self.axis - self.spin_rate))
                add(energy=np.abs(self.rigid_body.energy_of(R, in_body) - self.energy))
                off = self.rigid_body.momentum_of(R, in_body) - self.momentum
                without_torque = self.rigid_body.is_free  # else only the part about the vertical is conserved
                add(momentum=np.linalg.norm(off, axis=1) if without_torque else np.abs(off @ self.rigid_body.up))
            if body and not attitudes and kinds.free_body(self.rigid_body):
                length = np.linalg.norm(self.rigid_body.momentum_of(np.eye(3), omega), axis=1)
                add(energy=np.abs(self.rigid_body.energy_of(np.eye(3), omega) - self.energy))
                add(momentum=np.abs(length - np.linalg.norm(self.momentum)))
            if exact is None and attitudes:
                rows = Rows(trajectory["time"][:, 0], attitudes[0][0], omega, self.convention.omega_frame)
                if (kinematics := rows.errors()) is not None:
                    add(kinematics=kinematics)
        return {name: largest[name] for name in UNITS if name in largest}

    def rows(self, trajectory: Mapping[str, Array]) -> Rows | None:
        """Attitudes and angular velocities, to be compared with each other; None without attitudes."""
        R, omega = self.matrices(trajectory), self.omega(trajectory) if "omega" in trajectory else None
        return None if R is None else Rows(trajectory["time"][:, 0], R, omega, self.convention.omega_frame)

    def starts(self, first: Mapping[str, float], least: float, floors: Mapping[str, float] | None = None) -> bool:
        """Whether a row with these errors is the start of the case, relative to the size of each quantity."""
        known = floors or {}
        return all(error <= least * self.sizes[name] + 2 * known.get(name, 0.0) for name, error in first.items())

    def attitude(self, group: str, values: Array) -> tuple[Array, dict[str, Array]]:
        """Matrices from the body to the world of the case; and how far they are from orthogonal, or quaternions from length 1.

        A matrix that is no rotation becomes NaN: it mirrors, or is off by more than `OFF` and than the digits of the file.
        """
        how, defect = self.convention, {}
        if group == "matrix":
            R = values.reshape(-1, 3, 3)
            off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max((1, 2))
            defect["orthogonality"] = off
            rotation = (off <= max(OFF, 4 * self.digit)) & (np.linalg.det(R) > 0)
            R = np.where(rotation[:, None, None], R, np.nan)
        else:
            bad = ~np.isfinite(values).all(1)
            if group == "quaternion":
                defect["orthogonality"] = np.abs(np.linalg.norm(values, axis=1) - 1)
                bad |= ~(np.linalg.norm(values, axis=1) > 0)
            values = np.where(bad[:, None], 1.0, np.deg2rad(values) if how.degrees else values)
            if group == "quaternion":
                turns = Rotation.from_quat(values, scalar_first=how.quat == "wxyz")
            elif group == "rotation vector":
                turns = Rotation.from_rotvec(values)
            else:
                turns = Rotation.from_euler(how.angles, values)
            R = turns.as_matrix()
            R[bad] = np.nan
        return self.to_world @ (R.transpose(0, 2, 1) if how.transposed else R) @ self.from_body, defect

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


def _turn(name: str | None, to: Array) -> Array:
    """The smallest rotation from a named axis to the axis `to`; half a turn is about x, or about y if `to` is x."""
    if name is None:
        return np.eye(3)
    if AXES[name] @ to < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0] if abs(to[0]) < 0.5 else [-1.0, 1.0, -1.0])
    return Rotation.align_vectors(to, AXES[name])[0].as_matrix()


def _angle(a: Array, b: Array) -> Array:
    """The angle between vectors (..., 3); it keeps its digits where it is small."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))
