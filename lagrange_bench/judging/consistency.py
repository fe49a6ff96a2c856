"""Checks rows of a trajectory against each other, without the exact motion. Does ω turn the body? Does the torque change ω?

Neighbouring rows k, k + 1 give the turn Θ from one attitude to the next over the time between them, dt. Then

    Θ/dt = ω             in the body, and half way in the world: tells the frame of ω, and rows that are late or lost
    I (ω' − ω)/dt = T − ω × I ω       tells a program that leaves out ω × I_c ω, with I_c about the centre of mass

Medians over all rows decide, so that a few bad rows, as of a run that blows up, do not.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import RigidBody

Array = np.ndarray
CLEARLY = 4.0  # another frame, or another equation, must be so many times nearer
ANOTHER_TURN = 2.8  # rad: a larger turn between two rows may be the other way round
FEWEST = 3  # fewer rows tell nothing
LITTLE = 1e-3  # relative: a gyroscopic torque below this share of the change of ω is not seen


def into_body(R: Array, v: Array) -> Array:
    """Vectors of the world (N, 3) in the frame of the body, by attitudes (N, 3, 3)."""
    return (v[:, None, :] @ R)[:, 0]  # type: ignore[no-any-return]


def tensor(body: RigidBody) -> Array:
    """The moments of inertia (3, 3) in the body's frame: about the fixed point, of a flying body about the centre of mass."""
    return body.momentum_of(np.eye(3), np.eye(3))


class Rows:
    """Attitudes (N, 3, 3), body to world, and angular velocities (N, 3) in one of the frames, at times t (N,)."""

    def __init__(self, t: Array, R: Array, omega: Array | None, frame: str):
        good = np.isfinite(R).all((1, 2)) & (np.isfinite(omega).all(1) if omega is not None else True)
        self.t, self.R, self.frame, self.places = t[good], R[good], frame, np.flatnonzero(good)
        self.rows = len(t)
        self.omega = None if omega is None else omega[good]
        self.dt = np.diff(self.t)[:, None]
        turns = np.transpose(self.R[:-1], (0, 2, 1)) @ self.R[1:]
        self.turn = Rotation.from_matrix(turns).as_rotvec() if len(turns) else np.empty((0, 3))
        self.clear = np.linalg.norm(self.turn, axis=1) < ANOTHER_TURN

    def _in_body(self) -> Array:
        assert self.omega is not None
        return self.omega if self.frame == "body" else into_body(self.R, self.omega)

    def kinematics(self, frame: str | None = None, part: str = "mean") -> Array:
        """|Θ/dt − ω| between neighbouring rows, rad/s, (N − 1,), with ω in this frame; 0 if q' = q ω/2.

        part : ω of the "first" row, of the "second", or the "mean", which is of fourth order in dt by Magnus's series:

            ω = (ω₁ + ω₂)/2 + dt/12 (±ω₁ × ω₂ − (ω₂' − ω₁')),      + in the body, − in the world
        """
        assert self.omega is not None
        body = (frame or self.frame) == "body"
        turn = self.turn if body else np.einsum("nij,nj->ni", self.R[:-1], self.turn)
        first, second = self.omega[:-1], self.omega[1:]
        mean = {"first": first, "second": second}.get(part)
        if mean is None:
            change = np.diff(np.gradient(self.omega, self.t, axis=0, edge_order=2), axis=0) if len(self.t) > 2 else 0.0
            twist = np.cross(first, second) * (1 if body else -1)
            mean = (first + second) / 2 + self.dt / 12 * (twist - change)
        return np.linalg.norm(turn / self.dt - mean, axis=1)

    def speed(self) -> Array:
        """How fast the attitudes turn between two rows, rad/s, (N − 1,)."""
        return np.linalg.norm(self.turn / self.dt, axis=1)  # type: ignore[no-any-return]

    def speed_ratio(self) -> float:
        """How fast the attitudes turn, over |ω|: 1 unless one has another unit; NaN where the rows do not tell."""
        if self.omega is None or np.count_nonzero(self.clear) < FEWEST - 1:
            return np.nan
        size = np.median(np.linalg.norm(self.omega, axis=1))
        return float(np.median(self.speed()[self.clear]) / size) if size else np.nan

    def errors(self) -> Array | None:
        """`kinematics` of all rows (N,), 0 in the first and where a turn is not clear; None where few turns are clear."""
        if self.omega is None or not len(self.clear) or 2 * np.count_nonzero(self.clear) < len(self.clear):
            return None
        errors = np.zeros(self.rows)
        errors[self.places[1:]] = np.where(self.clear, self.kinematics(), 0.0)
        return errors

    def off(self, frame: str | None = None, part: str = "mean") -> float:
        """The median of `kinematics`; NaN where the rows do not tell."""
        if self.omega is None or np.count_nonzero(self.clear) < FEWEST - 1:
            return np.nan
        return float(np.median(self.kinematics(frame, part)[self.clear]))

    def other_frame(self) -> str | None:
        """The other frame, if ω is clearly in that one."""
        other = "world" if self.frame == "body" else "body"
        return other if CLEARLY * self.off(other) < self.off(self.frame) else None

    def without_gyroscopic_torque(self, body: RigidBody) -> bool:
        """Whether ω clearly changes as in a body without the torque ω × I_c ω."""
        if self.omega is None or np.count_nonzero(self.clear) < FEWEST:
            return False
        if not 0.5 < self.speed_ratio() < 2:  # another unit of times or of ω hides torques
            return False
        omega, inertia = self._in_body(), tensor(body)
        torque = np.cross(body.up @ self.R, body.weight @ body.axes)
        coupling, own = np.cross(omega, omega @ inertia), np.cross(omega, omega @ body.inertia_com)
        inverse = np.linalg.inv(inertia)
        change = np.diff(omega, axis=0) / self.dt
        right, other = ((part[:-1] + part[1:]) / 2 @ inverse for part in (torque - coupling, torque - coupling + own))

        def median(values: Array) -> float:
            return float(np.median(np.linalg.norm(values, axis=1)[self.clear]))

        nearer = CLEARLY * median(change - other) < median(change - right)
        return nearer and median(right - other) > LITTLE * median(right)

    def spin_rate(self, axis: Array) -> Array:
        """The angular velocity about an axis of the body, (N,)."""
        return self._in_body() @ axis

    def notes(self) -> list[str]:
        """Notes on the first two rows: they are equal, or the second has lost the angular velocity."""
        notes = []
        if len(self.t) > 1 and np.array_equal(self.R[0], self.R[1]) and (self.omega is None or self.omega[0].any()):
            notes.append("Rows 1 and 2 are equal: perhaps each row holds the state before.")
        elif self.omega is not None and len(self.t) >= FEWEST:
            first, second = np.linalg.norm(self.omega[:2], axis=1)
            seen = np.linalg.norm(self.turn[0] / self.dt[0])
            if first > 0 and second < 0.1 * first and seen < 0.1 * first:
                sizes = f"|ω| is {second:.3g} rad/s there, {first:.3g} at the start"
                lost = "Perhaps the program lost the velocities it was given."
                notes.append(f"The second row does not follow from the first: {sizes}. {lost}")
        return notes


def rate_notes(t: Array, rate: Array) -> list[str]:
    """A note if the angular velocity about the axis of symmetry falls; in the exact motion it is constant."""
    good = np.isfinite(rate)
    t, rate = t[good], np.abs(rate[good])
    if len(t) < FEWEST or not np.all(rate > 0):
        return []
    if rate[1] < 0.9 * rate[0] and np.all(np.abs(rate[1:] / rate[1] - 1) < 0.5):
        rates = f"from {rate[0]:.4g} to {rate[1]:.4g} rad/s"
        return [f"The spin falls {rates} in the first step: a cap on angular velocities?"]
    fall = np.log(rate / rate[0])
    slope = float(fall @ (t - t[0]) / ((t - t[0]) @ (t - t[0])))
    if fall[-1] < -0.01 and np.max(np.abs(fall - slope * (t - t[0]))) < 0.1 * abs(fall[-1]):
        return [f"The spin falls like exp(−{-slope:.3g} t): damping?"]
    return []
