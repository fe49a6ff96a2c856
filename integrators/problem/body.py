"""A real symmetric top: physical units, any axis and any direction of gravity, the body's rotation, its energy.

The bench's own state (J, x) says where the axis points and how it moves; the body also turns about its axis. With the moments
of inertia A across and C along the axis, about the fixed point, J is the angular momentum over A,

    J = ω⊥ + (C/A) ω∥        ω = J + σ x,   σ = (1 − C/A) ω·x   constant.

The frame F that turns with J is followed exactly by a method (`Method.attitude`); the body has one more constant spin about its
own axis a: R(t) = F(t) R(0) exp(σ t â). J is never written ω + (C/A − 1)(ω·x) x in doubles: where the spin is large that loses
digits. Here such numbers are fractions of the user's doubles, rounded once.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import two_prod
from lagrange_bench.integrators.interface import Array, Method, StepError
from lagrange_bench.integrators.problem.top import LagrangeTop

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

UNIT = 1e-6  # largest difference of |x| from 1: what poor methods lose in a long run may be continued
OTHER = 1e-9  # relative: a state differs by more from what its rotation and spin say, so another top made it
PARTED = 1e-6  # of the axis: state and attitude are followed apart, and agree to round-off on a stable orbit
SYMMETRIC = 1e-12  # of the largest moment of inertia: what the rounding of a rotated matrix leaves
PI = Fraction("3.14159265358979323846264338327950288419716939937510582")
Vector = list[Fraction]


class BodyState(np.ndarray):
    """A state (J, x), shape (6,), with the body's rotation and spin: what `RigidTop.state` returns and `integrate` takes.

    rotation : a SciPy Rotation from the body to the world, None in what NumPy computes from such a state. spin : angular
    velocity about the axis, rad/s, exact.
    """

    rotation: Rotation | None = None
    spin: Fraction | None = None

    def __reduce__(self) -> Any:
        if self.rotation is None or self.spin is None:
            return super().__reduce__()
        return _body_state, (np.array(self), self.rotation, self.spin)  # NumPy's own would drop both


class RigidTop:
    """A rigid body with one point fixed, symmetric about an axis through that point, in a uniform field; SI units.

    Parameters
    ----------
    mass : float
        In kg.
    com : (3,)
        In m, the centre of mass in the body's frame, from the fixed point.
    inertia_com : (3,) or (3, 3)
        In kg m², about the centre of mass: moments along the axes of the body's frame, or a matrix.
    gravity : (3,)
        In m/s², in the world's frame.

    Attributes
    ----------
    A, C : float
        In kg m², moments of inertia about the fixed point, across and along the axis.
    axis : (3,)
        A unit vector in the body: the axis of `com`, or where `com` is 0 that of the single moment of inertia.
    distance : float
        In m, of the centre of mass along the axis.

    Raises
    ------
    ValueError
        A malformed number; moments of inertia that no body has; or a body that is not symmetric about an axis through the fixed
        point.
    """

    def __init__(
        self, mass: float, com: ArrayLike, inertia_com: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)
    ) -> None:
        I, self.com = real_array(inertia_com, "inertia_com", (3,), (3, 3)), real_array(com, "com", (3,))
        self.inertia_com = I if I.shape == (3, 3) else np.diag(I)
        axis, c = _axis_of_symmetry(self.inertia_com, self.com), _fractions(self.com)
        C = _dot(axis, [_dot(_fractions(row), axis) for row in self.inertia_com]) / _dot(axis, axis)
        across = (sum(_fractions(np.diag(self.inertia_com))) - C) / 2
        mass, gravity = check_real(mass, "mass"), real_array(gravity, "gravity", (3,))
        weight = float(np.linalg.norm(gravity))
        self._set_up(mass, gravity, across + Fraction(mass) * _dot(c, c), C, axis, float(_root(_dot(c, c))), weight)

    def _set_up(
        self, mass: float, gravity: Array, A: Fraction, C: Fraction, axis: Vector, distance: float, weight: float
    ) -> None:
        """`weight` is that of 1 kg where it acts against the third axis of `world`, in N."""
        for name, value in (("mass", mass), ("A", A), ("C", C)):
            if value <= 0:
                raise ValueError(f"{name} must be positive; got {float(value)}")
        self.mass, self.gravity, self.distance, self.weight = mass, gravity, distance, weight
        self.world = _upright(gravity, weight)  # (3, 3): rows are the frame of (J, x) in the world
        self.A, self.C, self.ratio = float(A), float(C), C / A
        self.direction, self.length = axis, _root(_dot(axis, axis))
        self.axis = np.array([float(v / self.length) for v in axis])

    def __repr__(self) -> str:
        com, inertia, gravity = self.com.tolist(), self.inertia_com.tolist(), self.gravity.tolist()
        return f"{type(self).__name__}(mass={self.mass}, com={com}, inertia_com={inertia}, gravity={gravity})"

    @property
    def top(self) -> LagrangeTop:
        """The Lagrange top with alpha = m g l / A (1/s²); its J is angular momentum over A (1/s), its |x| is 1."""
        return LagrangeTop(self.mass * self.weight * self.distance / self.A)

    problem = top  # what is integrated

    @property
    def inertia(self) -> Array:
        """(3, 3) kg m², about the fixed point, in the body's frame."""
        along = np.outer(self.axis, self.axis)
        return self.A * (np.eye(3) - along) + self.C * along

    def state(
        self,
        *,
        rotation: Rotation | ArrayLike,
        omega_body: ArrayLike | None = None,
        omega_world: ArrayLike | None = None,
    ) -> BodyState:
        """The state that `integrate` takes.

        rotation : a SciPy Rotation, a matrix (3, 3) or a unit quaternion (4,), scalar first, that takes vectors of the body to
        the world. omega_body or omega_world : (3,) rad/s, the angular velocity in the body's or in the world's frame.
        """
        turn, omega = as_motion(rotation, omega_body, omega_world)
        w, d, length = _fractions(omega), self.direction, self.length
        along = _dot(w, d) / length**2
        J = [float(a - (1 - self.ratio) * along * b) for a, b in zip(w, d, strict=True)]
        to_frame = self.world @ turn.as_matrix()
        return _body_state(np.concatenate((to_frame @ J, to_frame @ self.axis)), turn, along * length)

    def check_start(self, y0: Array) -> None:
        """ValueError for a state (6,) whose |x| is not 1, for x is the direction of the axis; or that belongs to another top."""
        if not has_unit_axis(y0):
            length = math.hypot(*y0[3:].tolist())
            raise ValueError(
                f"y0: |x| must be 1 for a {type(self).__name__}, whose axis is the direction x; got {length:.9g}"
            )
        if isinstance(y0, BodyState) and y0.rotation is not None and y0.spin is not None:
            J, x = np.split(np.array(y0), 2)
            apart = np.max(np.abs(self.world @ y0.rotation.apply(self.axis) - x))
            if apart > OTHER or abs(J @ x - float(self.ratio * y0.spin)) > OTHER * np.linalg.norm(J):
                raise ValueError(
                    "y0 belongs to a top with another axis, direction of gravity or C/A: use this one's `state`"
                )

    def energy(self, motion: ArrayLike | Rotation, omega_body: ArrayLike | None = None) -> Array:
        """Kinetic plus potential energy, in joules, 0 at the height of the fixed point; shape (...,).

        motion : states (..., 6); or, with `omega_body` (..., 3) in rad/s, a Rotation or matrices (..., 3, 3), body to world.
        """
        if omega_body is not None:
            R, omega = _matrices(motion), np.asarray(omega_body, dtype=float)
            kinetic = np.sum(omega * (omega @ self.inertia), axis=-1) / 2
            return kinetic - self.mass * ((R @ self.com) @ self.gravity)
        J, x = np.split(np.asarray(motion, dtype=float), 2, axis=-1)
        along = np.sum(J * x, axis=-1)
        kinetic = self.A * (np.sum(J * J, axis=-1) - along**2) / 2 + (self.A * along) ** 2 / (2 * self.C)
        return kinetic + self.mass * self.weight * self.distance * x[..., 2]

    def vertical_momentum(self, rotation: Rotation | ArrayLike, omega_body: ArrayLike) -> Array:
        """Angular momentum about the upward vertical, kg m²/s: constant. Arguments as in `energy`; shape (...,)."""
        momentum = _matrices(rotation) @ (np.asarray(omega_body, dtype=float) @ self.inertia)[..., None]
        return momentum[..., 0] @ self.world[2]

    def angular_velocity(self, y: ArrayLike, spin: float | None = None) -> Array:
        """ω of states (..., 6) in their frame, rad/s, shape (..., 3); `spin` is that about the axis, where it is known."""
        J, x = np.split(np.asarray(y, dtype=float), 2, axis=-1)
        along = np.einsum("...j,...j->...", J, x)[..., None]
        return (J - along * x) + (self.A / self.C * along if spin is None else spin) * x

    def positions(self, y: Array) -> Array:
        """The centre of mass of states (..., 6) in the world's frame, m, shape (..., 3)."""
        return self.distance * np.einsum("...j,jk", y[..., 3:], self.world)

    def own_spin(self, y0: Array) -> Fraction:
        """σ, the body's constant angular velocity about its axis relative to the frame that turns with J, rad/s."""
        if isinstance(y0, BodyState) and y0.spin is not None:
            return y0.spin * (1 - self.ratio)
        return _dot(_fractions(y0[:3]), _fractions(y0[3:])) * (1 / self.ratio - 1)


class HeavyTop(RigidTop):
    """A `RigidTop` with the axis e3, gravity along −e3, and the moments of inertia about the fixed point; SI units.

    Parameters
    ----------
    mass : float
        In kg.
    distance : float
        In m, from the fixed point to the centre of mass along the axis.
    gravity : float
        In m/s².
    A, C : float
        In kg m², moments of inertia about the fixed point, across and along the axis; C <= 2 (A − mass distance²).

    Raises
    ------
    ValueError
        A number that is not finite, mass, A or C not positive, A < mass distance², or C > 2 (A − mass distance²).
    """

    def __init__(self, mass: float, distance: float, gravity: float, A: float, C: float) -> None:
        facts = {"mass": mass, "distance": distance, "gravity": gravity, "A": A, "C": C}
        mass, distance, gravity, A, C = (check_real(value, name) for name, value in facts.items())
        across = A - mass * distance * distance
        self.com, self.inertia_com = np.array((0.0, 0.0, distance)), np.diag((across, across, C))
        down, axis = np.array((0.0, 0.0, -gravity)), _fractions((0.0, 0.0, 1.0))
        self._set_up(mass, down, Fraction(A), Fraction(C), axis, distance, gravity)
        if across < -SYMMETRIC * A:
            raise ValueError(
                f"A = {A} is less than mass · distance² = {mass * distance * distance:.6g}: A is the moment of inertia about the "
                "fixed point, not about the centre of mass"
            )
        if C - 2 * across > SYMMETRIC * A:
            raise ValueError(
                f"C = {C} is more than 2 (A − mass · distance²) = {2 * max(across, 0.0):.6g}: "
                "no rigid body has such moments of inertia about its centre of mass"
            )

    def __repr__(self) -> str:
        facts = f"mass={self.mass}, distance={self.distance}, gravity={self.weight}, A={self.A}, C={self.C}"
        return f"{type(self).__name__}({facts})"

    def state(self, angles: ArrayLike | None = None, rates: ArrayLike | None = None, **motion: Any) -> BodyState:
        """y0 = (J, x) from Euler angles (theta, phi, psi) in rad and their rates in rad/s; or as in `RigidTop.state`.

        theta is the inclination of the axis to the upward vertical, phi the precession, psi the spin; the axis is
        (sin theta cos phi, sin theta sin phi, cos theta).
        """
        if motion:
            if angles is not None or rates is not None:
                raise ValueError(f"give either angles and rates, or {' and '.join(motion)}")
            return super().state(**motion)
        theta, phi, psi = real_array(angles, "angles", (3,)).tolist()
        theta_rate, phi_rate, psi_rate = real_array(rates, "rates", (3,)).tolist()
        st, ct, sp, cp = math.sin(theta), math.cos(theta), math.sin(phi), math.cos(phi)
        axis = np.array((st * cp, st * sp, ct))
        node = np.array((-sp, cp, 0.0))  # theta grows by turning about this
        across = np.array((0.0, 0.0, phi_rate)) - phi_rate * ct * axis
        spin = psi_rate + phi_rate * ct  # angular velocity about the axis
        with np.errstate(over="ignore", invalid="ignore"):
            y0 = np.concatenate((theta_rate * node + across + (self.C / self.A) * spin * axis, axis))
        if not np.all(np.isfinite(y0)):
            raise ValueError(f"rates are too large: the angular momentum is beyond the largest double; got {rates!r}")
        return _body_state(y0, from_euler((theta, phi, psi)), Fraction(spin))


def has_unit_axis(states: Array) -> NDArray[np.bool_]:
    """Of states (..., 6): whether |x| is 1."""
    with np.errstate(over="ignore"):
        return np.abs(np.sqrt(np.sum(states[..., 3:] ** 2, axis=-1)) - 1.0) <= UNIT


# ------------------------------------------------------------------------------------------------ what users pass in


def real_array(values: Any, name: str, *shapes: tuple[int, ...]) -> Array:
    """`values` as a fresh array of finite doubles."""
    try:
        v = np.array(values)
    except ValueError:
        v = np.empty(0)
    if v.shape not in shapes or v.dtype.kind not in "iuf" or not np.all(np.isfinite(v)):
        raise ValueError(f"{name} must be finite real numbers, shape {' or '.join(map(str, shapes))}; got {values!r}")
    return v.astype(np.float64)


def as_rotation(rotation: Any) -> Rotation:
    """A single SciPy Rotation, from one, a matrix (3, 3) or a quaternion (4,), scalar first; ValueError for anything else."""
    from scipy.spatial.transform import Rotation  # not at the start: it takes 0.2 s

    if isinstance(rotation, Rotation):
        if not rotation.single:
            raise ValueError(f"rotation must be a single one; got {len(rotation)}")
        return rotation
    R = real_array(rotation, "rotation", (3, 3), (4,))
    if R.shape == (4,):
        if abs(R @ R - 1) > 1e-9:
            raise ValueError(f"rotation must be a unit quaternion, scalar first; got {R.tolist()}")
        return Rotation.from_quat(R, scalar_first=True)
    if np.max(np.abs(R.T @ R - np.eye(3))) > 1e-9 or np.linalg.det(R) < 0:
        raise ValueError(f"rotation must be an orthogonal matrix with determinant 1; got {R.tolist()}")
    return Rotation.from_matrix(R)


def as_motion(rotation: Any, omega_body: Any, omega_world: Any) -> tuple[Rotation, Array]:
    """A Rotation and the angular velocity in the body's frame, which is given in one of two."""
    turn = as_rotation(rotation)
    if (omega_body is None) == (omega_world is None):
        raise ValueError("give either omega_body or omega_world")
    if omega_world is None:
        return turn, real_array(omega_body, "omega_body", (3,))
    return turn, turn.inv().apply(real_array(omega_world, "omega_world", (3,)))


def _matrices(rotation: Any) -> Array:
    """Of a Rotation, or the matrices themselves."""
    return rotation.as_matrix() if hasattr(rotation, "as_matrix") else np.asarray(rotation, dtype=float)


def _body_state(y: Array, rotation: Rotation, spin: Fraction) -> BodyState:
    state = y.view(BodyState)
    state.rotation, state.spin = rotation, spin
    state.flags.writeable = False  # they would no longer belong to it
    return state


def principal_moments(inertia: Array) -> tuple[Array, Array]:
    """Those about the centre of mass, and their axes as columns; ValueError for a matrix that no body has."""
    moments, axes = np.linalg.eigh(inertia)
    slack = SYMMETRIC * float(np.max(np.abs(inertia)))
    if np.max(np.abs(inertia - inertia.T)) > slack:
        raise ValueError(f"inertia_com must be a symmetric matrix; got {inertia.tolist()}")
    if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
        raise ValueError(f"inertia_com: no rigid body has the moments {moments.tolist()} about its centre of mass")
    return moments, axes


def _axis_of_symmetry(inertia: Array, com: Array) -> Vector:
    """A vector along it; ValueError where there is none through the fixed point."""
    moments, axes = principal_moments(inertia)
    slack = SYMMETRIC * float(np.max(np.abs(inertia)))
    if np.any(com):
        along = com / np.linalg.norm(com)
    elif moments[2] - moments[0] <= slack:
        return _fractions((0.0, 0.0, 1.0))
    else:
        along = axes[:, 0 if moments[1] - moments[0] > moments[2] - moments[1] else 2]
    C = along @ inertia @ along
    A = (np.trace(inertia) - C) / 2
    if np.max(np.abs(inertia - A * np.eye(3) - (C - A) * np.outer(along, along))) > 4 * slack:
        raise ValueError(
            "com and inertia_com: only a body that is symmetric about an axis through the fixed point and the centre of mass "
            f"is followed so far; got com {com.tolist()}, moments of inertia {moments.tolist()}"
        )
    return _fractions(com if np.any(com) else along)


def _upright(gravity: Array, size: float) -> Array:
    """(3, 3): rows of a frame in the world whose third points up; along an axis of the world without rounding."""
    up = -gravity / size if size != 0 else np.array((0.0, 0.0, 1.0))
    if up[2] == 1.0:
        return np.eye(3)
    first = np.zeros(3)
    first[(np.argmax(np.abs(up)) + 1) % 3] = 1.0
    first -= (first @ up) * up
    first /= np.linalg.norm(first)
    return np.array((first, np.cross(up, first), up))


def _fractions(values: Any) -> Vector:
    return [Fraction(float(v)) for v in values]


def _dot(a: Vector, b: Vector) -> Fraction:
    return sum((v * w for v, w in zip(a, b, strict=True)), Fraction(0))


def _root(square: Fraction) -> Fraction:
    """The square root to 60 digits; that of a square itself."""
    p, q = square.numerator, square.denominator
    scale = 10**60
    root = math.isqrt(p * q * scale * scale)
    return Fraction(root, q * scale)


# ------------------------------------------------------------------------------------------------ rotations


@jit
def quaternion_product(a: Any, b: Any) -> Any:
    """The product of two quaternions, scalar first, given by their components."""
    return (
        a[0] * b[0] - (a[1] * b[1] + a[2] * b[2] + a[3] * b[3]),
        a[0] * b[1] + a[1] * b[0] + (a[2] * b[3] - a[3] * b[2]),
        a[0] * b[2] + a[2] * b[0] + (a[3] * b[1] - a[1] * b[3]),
        a[0] * b[3] + a[3] * b[0] + (a[1] * b[2] - a[2] * b[1]),
    )


def from_euler(angles: ArrayLike) -> Rotation:
    """The rotation of Euler angles (theta, phi, psi): R3(phi) R2(theta) R3(psi)."""
    from scipy.spatial.transform import Rotation

    theta, phi, psi = real_array(angles, "angles", (3,)).tolist()
    return Rotation.from_euler("ZYZ", (phi, theta, psi))


def check_attitude(g0: Any, y0: Array) -> Rotation:
    """The unit quaternion `g0` as a rotation that takes e3 to x; True stands for the one with psi = 0."""
    from scipy.spatial.transform import Rotation

    if g0 is True:
        x1, x2, x3 = y0[3:].tolist()
        return from_euler((math.atan2(math.hypot(x1, x2), x3), math.atan2(x2, x1), 0.0))
    g = real_array(g0, "attitude", (4,))
    if not np.max(np.abs(g)) <= 2 or abs(g @ g - 1) > 1e-12:
        raise ValueError(f"attitude must be True or a unit quaternion (4,), scalar first; got {g0!r}")
    rotation = Rotation.from_quat(g, scalar_first=True)
    if np.linalg.norm(rotation.apply((0.0, 0.0, 1.0)) - direction(y0[3:])) > 1e-9:
        raise ValueError("attitude does not take e3 to the axis x of y0")
    return rotation


def direction(x: Array) -> Array:
    """x (..., 3) over its length, whatever that is."""
    x = x / np.max(np.abs(x), axis=-1, keepdims=True)
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


@jit
def compose(frames: Any, left: Any, right: Any, axis: Any, half_turns: Any, times: Any, x: Any) -> float:
    """left·F(t)·right·(the own spin about the axis) into `frames`; returns by how much F x[0] and x[1 + i] differ at most."""
    apart, x0 = 0.0, (0.0, x[0, 0], x[0, 1], x[0, 2])
    for i in range(len(times)):
        F = (frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3])
        _, a, b, c = quaternion_product(quaternion_product(F, x0), (F[0], -F[1], -F[2], -F[3]))
        for off in (a - x[i + 1, 0], b - x[i + 1, 1], c - x[i + 1, 2]):
            apart = max(apart, abs(off)) if abs(off) < math.inf else math.inf
        p, e = two_prod(times[i], half_turns[0])
        half = 2.0 * math.pi * ((p - np.rint(p)) + (e + times[i] * half_turns[1]))
        s = math.sin(half)
        own = (math.cos(half), s * axis[0], s * axis[1], s * axis[2])
        g = quaternion_product(quaternion_product(left, F), quaternion_product(right, own))
        frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3] = g
    return apart


def follow(
    method: Method, top: Any, start: Array, turn: Rotation, times: Array, y: Array, h: float | None, options: Any
) -> Array:
    """Attitudes (N, 4) of the body at `times`, where its states are y (N, 6): unit quaternions, scalar first.

    top : a RigidTop, or a LagrangeTop for the body with equal moments of inertia. start : the state at time 0. turn : the
    body's rotation there. The method follows the frame that turns with J; the spin about the axis is added.
    """
    from scipy.spatial.transform import Rotation

    if method.attitude is None:
        raise ValueError(f"attitude: {method.name} does not follow the body; backlund, theta_functions and taylor do")
    if isinstance(top, RigidTop):
        plain, world, axis, spin = top.top, Rotation.from_matrix(top.world), top.axis, top.own_spin(start)
    else:
        plain, world, axis, spin = top, Rotation.identity(), np.array((0.0, 0.0, 1.0)), Fraction(0)
    try:
        frames = method.attitude(plain, np.array(start), times, **options)
    except StepError as error:
        raise StepError(error.method, error.reason, h=h, step=error.step) from None
    left, right = (tuple(q.as_quat(scalar_first=True).tolist()) for q in (world.inv(), world * turn))
    half_turns = float(spin / (4 * PI)), float(spin / (4 * PI) - Fraction(float(spin / (4 * PI))))
    x = np.concatenate((np.array(start)[None, 3:], y[:, 3:]))
    x = x if isinstance(top, RigidTop) else direction(x)
    apart = compose(frames, left, right, tuple(axis.tolist()), half_turns, times, x)
    if not apart < PARTED:
        raise StepError(method.name, f"attitude and state have parted by {apart:.1e}: the orbit is unstable", h=h)
    return frames
