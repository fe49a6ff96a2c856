"""A real symmetric top: physical units, the body's attitude, angular velocity, Euler angles, energy.

The state (J, x) says where the axis points and how it moves; the body also turns about its axis. Let g be the unit
quaternion (scalar first) that takes the body's frame to the rest frame, so that the axis is x = g e3 ḡ. The frame with
angular velocity J is followed exactly by the Bäcklund step (`torus.attitude`); the body itself has angular
velocity ω = J + (A/C − 1)(x·J) x, that is, one more constant spin about its own axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from integrators.checks import check_real
from integrators.interface import Array, Method, StepError
from integrators.problem.top import LagrangeTop

UNIT = 1e-6  # largest difference of |x| from 1: what poor methods lose in a long run may be continued
PARTED = 1e-6  # of the axis: state and attitude are followed apart, and agree to round-off on a stable orbit


@dataclass(frozen=True)
class HeavyTop:
    """A symmetric top with one point fixed, under gravity; SI units.

    mass : kg. distance : m, from the fixed point to the centre of mass along the axis. gravity : m/s².
    A, C : kg m², moments of inertia about the fixed point, across and along the axis; C <= 2A for a rigid body.

    Raises
    ------
    ValueError : a number that is not finite, mass, A or C not positive, or C > 2A.
    """

    mass: float
    distance: float
    gravity: float
    A: float
    C: float

    def __post_init__(self) -> None:
        for name in ("mass", "distance", "gravity", "A", "C"):
            object.__setattr__(self, name, check_real(getattr(self, name), name))
        for name in ("mass", "A", "C"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive; got {getattr(self, name)}")
        if self.C > 2 * self.A:
            raise ValueError(f"C = {self.C} > 2 A = {2 * self.A}: no rigid body has such moments of inertia")

    @property
    def top(self) -> LagrangeTop:
        """The Lagrange top with alpha = m g l / A (1/s²); its J is angular momentum over A (1/s), its |x| is 1."""
        return LagrangeTop(self.mass * self.gravity * self.distance / self.A)

    def state(self, angles: ArrayLike, rates: ArrayLike) -> Array:
        """y0 = (J, x) from Euler angles (theta, phi, psi) in rad and their rates in rad/s.

        theta is the inclination of the axis to the upward vertical, phi the precession, psi the spin; the axis is
        (sin theta cos phi, sin theta sin phi, cos theta). psi itself does not enter, its rate does.
        """
        (theta, phi, _), (theta_rate, phi_rate, psi_rate) = _three(angles, "angles"), _three(rates, "rates")
        st, ct, sp, cp = math.sin(theta), math.cos(theta), math.sin(phi), math.cos(phi)
        axis = np.array((st * cp, st * sp, ct))
        node = np.array((-sp, cp, 0.0))  # theta grows by turning about this
        across = np.array((0.0, 0.0, phi_rate)) - phi_rate * ct * axis
        spin = psi_rate + phi_rate * ct  # angular velocity about the axis
        with np.errstate(over="ignore", invalid="ignore"):
            y0 = np.concatenate((theta_rate * node + across + (self.C / self.A) * spin * axis, axis))
        if not np.all(np.isfinite(y0)):
            raise ValueError(f"rates are too large: the angular momentum is beyond the largest double; got {rates!r}")
        return y0

    def check_state(self, y0: Array) -> None:
        """ValueError for a state (6,) whose |x| is not 1: x is the direction of the axis here."""
        if not has_unit_axis(y0):
            length = math.hypot(*y0[3:].tolist())
            raise ValueError(f"y0: |x| must be 1 for a HeavyTop, whose axis is the direction x; got {length:.9g}")

    def energy(self, y: ArrayLike) -> Array:
        """Kinetic plus potential energy, in joules, of states (..., 6); shape (...,)."""
        J, x = np.split(np.asarray(y, dtype=float), 2, axis=-1)
        along = np.sum(J * x, axis=-1)
        across = np.sum(J * J, axis=-1) - along**2
        kinetic = self.A * across / 2 + (self.A * along) ** 2 / (2 * self.C)
        energy: Array = kinetic + self.mass * self.gravity * self.distance * x[..., 2]
        return energy

    def angular_velocity(self, y: ArrayLike) -> Array:
        """ω in the rest frame, rad/s, of states (..., 6); shape (..., 3)."""
        J, x = np.split(np.asarray(y, dtype=float), 2, axis=-1)
        omega: Array = J + (self.A / self.C - 1) * np.sum(J * x, axis=-1, keepdims=True) * x
        return omega

    def own_spin(self, y0: ArrayLike) -> float:
        """The body's constant angular velocity about its axis relative to the frame that turns with J, rad/s."""
        y = np.asarray(y0, dtype=float)
        return float((self.A / self.C - 1) * (y[:3] @ y[3:]))


def has_unit_axis(states: Array) -> NDArray[np.bool_]:
    """Of states (..., 6): whether |x| is 1."""
    with np.errstate(over="ignore"):
        unit: NDArray[np.bool_] = np.abs(np.sqrt(np.sum(states[..., 3:] ** 2, axis=-1)) - 1.0) <= UNIT
    return unit


def _three(values: ArrayLike, name: str) -> tuple[float, float, float]:
    v = np.asarray(values)
    if v.shape != (3,) or v.dtype.kind not in "iuf" or not np.all(np.isfinite(v)):
        raise ValueError(f"{name} must be three finite numbers (theta, phi, psi); got {values!r}")
    return float(v[0]), float(v[1]), float(v[2])


# ------------------------------------------------------------------------------------------------ quaternions


def quaternion_product(a: Any, b: Any) -> tuple[Any, Any, Any, Any]:
    """The product of two quaternions given by their components: numbers, or arrays of them."""
    return (
        a[0] * b[0] - (a[1] * b[1] + a[2] * b[2] + a[3] * b[3]),
        a[0] * b[1] + a[1] * b[0] + (a[2] * b[3] - a[3] * b[2]),
        a[0] * b[2] + a[2] * b[0] + (a[3] * b[1] - a[1] * b[3]),
        a[0] * b[3] + a[3] * b[0] + (a[1] * b[2] - a[2] * b[1]),
    )


def product(a: ArrayLike, b: ArrayLike) -> Array:
    """Products of quaternions (..., 4), scalar first."""
    a, b = (np.moveaxis(np.asarray(g, dtype=float), -1, 0) for g in (a, b))
    return np.stack(quaternion_product(a, b), axis=-1)


def from_euler(angles: ArrayLike) -> Array:
    """Unit quaternion of Euler angles (theta, phi, psi): R3(phi) R2(theta) R3(psi); shape (4,)."""
    theta, phi, psi = _three(angles, "angles")
    half = np.array((phi, theta, psi)) / 2
    (a, b, c), (d, e, f) = np.cos(half), np.sin(half)
    return product(product((a, 0, 0, d), (b, 0, e, 0)), (c, 0, 0, f))


def to_euler(g: ArrayLike) -> Array:
    """Euler angles (theta, phi, psi) of unit quaternions (..., 4), phi and psi in (−π, π]; shape (..., 3).

    On the vertical only phi ± psi is defined; all of it is then given to phi.
    """
    w, x, y, z = np.moveaxis(np.asarray(g, dtype=float), -1, 0)
    upper, lower = np.hypot(w, z), np.hypot(x, y)
    theta = 2 * np.arctan2(lower, upper)
    total = 2 * np.where(upper > 0, np.arctan2(z, w), 0.0)  # phi + psi
    difference = 2 * np.where(lower > 0, np.arctan2(-x, y), 0.0)  # phi − psi
    phi = np.where(lower == 0, total, np.where(upper == 0, difference, (total + difference) / 2))
    psi = np.where((lower == 0) | (upper == 0), 0.0, (total - difference) / 2)
    return np.stack((theta, _wrapped(phi), _wrapped(psi)), axis=-1)


def _wrapped(angle: Array) -> Array:
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def axis_attitude(x: ArrayLike) -> Array:
    """The attitude with spin angle psi = 0 whose axis points along x (3,)."""
    x1, x2, x3 = np.asarray(x, dtype=float)
    return from_euler((math.atan2(math.hypot(x1, x2), x3), math.atan2(x2, x1), 0.0))


def check_attitude(g0: Any, y0: Array) -> Array:
    """`g0` as a unit quaternion that takes e3 to x; True stands for the one with psi = 0."""
    if g0 is True:
        return axis_attitude(y0[3:])
    try:
        g = np.asarray(g0)
    except ValueError:
        g = np.empty(0)
    if g.shape != (4,) or g.dtype.kind not in "iuf" or not np.max(np.abs(g)) <= 2 or abs(g @ g - 1) > 1e-12:
        raise ValueError(f"attitude must be True or a unit quaternion (4,), scalar first; got {g0!r}")
    g = g.astype(np.float64)
    axis = product(product(g, (0, 0, 0, 1)), g * (1, -1, -1, -1))[1:]
    if np.linalg.norm(axis - direction(y0[3:])) > 1e-9:
        raise ValueError("attitude does not take e3 to the axis x of y0")
    return g


def direction(x: Array) -> Array:
    """x (..., 3) over its length, whatever that is."""
    x = x / np.max(np.abs(x), axis=-1, keepdims=True)
    unit: Array = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return unit


def follow(
    method: Method, top: LagrangeTop, y: Array, h: float, every: int, g0: Array, spin: float, options: dict[str, Any]
) -> Array:
    """Attitudes (N, 4) along the recorded states y (N, 6), `every` steps of h apart.

    Those of the frame that turns with J, as the method follows it, and on top of it `spin` about the axis, rad per
    unit of time.
    """
    if method.attitude is None:
        raise StepError(method.name, "does not follow the body's attitude; backlund and taylor do", h=h)
    g = method.attitude(top, y[0], h, every * (len(y) - 1), every, g0, **options)
    axis = product(product(g, (0, 0, 0, 1)), g * (1, -1, -1, -1))[:, 1:]
    apart = np.max(np.abs(axis - direction(y[:, 3:])))
    if not apart < PARTED:
        raise StepError(method.name, f"attitude and state have parted by {apart:.1e}: the orbit is unstable", h=h)
    half = spin * h * every * np.arange(len(g)) / 2
    own = np.stack((np.cos(half), 0 * half, 0 * half, np.sin(half)), axis=-1)
    return product(g, own)
