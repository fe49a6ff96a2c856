"""A rigid body in SI units: symmetric or not, heavy or free, with one point fixed or flying.

    H = Σ L_i²/(2 I_i) + w·Γ,   w = m |g| X,   Γ = Rᵀ(up)

X leads from the fixed point to the centre of mass. y = (q, L) has seven numbers: the unit quaternion of R, scalar first, and the
angular momentum along the principal axes of inertia, about the fixed point. For a flying body it is about the centre of mass.

H depends on q by the quadratic form q̄ up q. So |q| and the momentum about the vertical are conserved for any |q|, and H is
quadratic: a method that conserves quadratic functions conserves energy. The invariants have the names of the top: C1 is |q|², J3
the momentum about the vertical, and C2, for a symmetric body only, the momentum about its axis. A flying body turns like a free
one, and its centre of mass is at x + v t + g t²/2.

A multiple of |L|² in H does not change L. So L' is computed from D_i = 1/I_i − 1/I_r alone, with I_r one of the two nearest
moments. D_i = (I_r − I_i)/(I_i I_r) has no cancellation: nearly equal moments keep the digits of their difference.

**The Lagrange top inside.** A symmetric body has the moments A across and C along its axis. J = R L/A and the direction x of the
axis in the world are the state of a Lagrange top with alpha = |w|/A, in a frame whose third axis points up.

Source: Arnold, Mathematical Methods of Classical Mechanics (1989), sections 29 and 30.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_array, check_flag, check_numbers, check_real
from lagrange_bench.integrators.compiling.tape import Program, Tape
from lagrange_bench.integrators.problem import free_motion
from lagrange_bench.integrators.problem.inertia import (
    TURNED,
    check_inertia,
    check_range,
    differences_of_inverses,
    direction_of,
    principal,
    upright,
)
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.rotation import as_motion
from lagrange_bench.integrators.problem.system import BODY, System
from lagrange_bench.integrators.problem.top import LagrangeTop

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

UNIT = 1e-6  # largest difference of |q| from 1: a poor method loses as much in a long run, which may be continued


@cache
def _formulas(symmetry: int | None, pattern: tuple[float, ...]) -> tuple[System, tuple[tuple[str, Program], ...]]:
    """The system and the invariants of a kind of bodies, with p = (1/I_r, D, w, up).

    symmetry : the number of the axis. pattern : p with 0.5 for every number but 0 and 1, on which alone the formulas depend:
    recording them takes ten times as long as all else of a body.
    """
    differences, weights, directions = pattern[1:4], pattern[4:7], pattern[7:]

    def vertical_axis(y: Any, p: Any) -> list[Any]:
        """|q|² Rᵀ(up) = (q0² − |v|²) up + 2 (v·up) v − 2 q0 v × up, with q = (q0, v); 0 and 1 in `up` are constants."""
        up = [v if v in (0.0, 1.0) else p[7 + i] for i, v in enumerate(directions)]
        q0, q = y[0], y[1:4]
        scalar, along = q0 * q0 - sum(v * v for v in q), 2.0 * sum(v * u for v, u in zip(q, up, strict=True))
        pairs = [(1, 2), (2, 0), (0, 1)]
        across = [2.0 * q0 * (q[j] * up[k] - q[k] * up[j]) for j, k in pairs]
        return [scalar * u + along * v - w for u, v, w in zip(up, q, across, strict=True)]

    def hamiltonian(t: Any, y: Any, p: Any) -> Any:
        """|L|²/(2 I_r) + Σ D_i L_i²/2 + w·Γ."""
        kinetic = p[0] * sum(v * v for v in y[4:7]) / 2.0
        kinetic = kinetic + sum(p[1 + i] * (y[4 + i] * y[4 + i]) / 2.0 for i in range(3) if differences[i])
        return kinetic + sum(p[4 + i] * height for i, height in enumerate(vertical_axis(y, p)) if weights[i])

    def vertical_momentum(t: Any, y: Any, p: Any) -> Any:
        return sum(v * w for v, w in zip(y[4:7], vertical_axis(y, p), strict=True))

    invariants = {"J3": vertical_momentum}
    if symmetry is not None:
        invariants["C2"] = lambda t, y, p: y[4 + symmetry]
    problem = Problem("rigid_body", "body", hamiltonian, pattern, invariants, frame="body")
    tape = Tape()
    y, p = [tape.input() for _ in range(8)][1:], [tape.input() for _ in pattern]
    differing = [p[1 + i] * y[4 + i] if differences[i] else tape.constant(0.0) for i in range(3)]
    return replace(problem.system, relative_omega=tape.program(differing)), problem.extra_invariants


class RigidBody(Problem):
    """A rigid body, with one point fixed or flying, in a uniform field; SI units.

    Parameters
    ----------
    mass : float
        In kg.
    com : (3,)
        In m, the centre of mass in the body's frame. Its origin is the fixed point, for a flying body any point of the body.
    inertia_com : (3,) or (3, 3)
        In kg m², about the centre of mass: moments along the axes of the body's frame, or a matrix. Some books and papers have
        moments that no body has; a warning says so.
    gravity : (3,)
        In m/s², in the world's frame.
    fixed : bool
        Whether the origin of the body's frame is fixed. Otherwise the body flies, and its centre of mass is followed.

    Attributes
    ----------
    inertia : (3,)
        In kg m², principal moments about the fixed point, for a flying body about the centre of mass.
    axes : (3, 3)
        Their axes as rows, in the body's frame.
    symmetry : int or None
        The number of the axis of symmetry, about which a turn changes nothing, or None.
    weight, up : (3,)
        w in the principal frame, and the direction against gravity in the world's frame.

    Raises
    ------
    ValueError
        A malformed number, or a moment of inertia about the fixed point that is not positive.
    """

    def __init__(
        self,
        mass: float,
        com: ArrayLike,
        inertia_com: ArrayLike,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        fixed: bool = True,
    ) -> None:
        self.mass, self.fixed = check_real(mass, "mass"), check_flag(fixed, "fixed")
        self.com, self.gravity = check_array(com, "com", (3,)), check_array(gravity, "gravity", (3,))
        moments = check_array(inertia_com, "inertia_com", (3,), (3, 3))
        self.facts = {
            **{"mass": self.mass, "com": self.com.tolist(), "inertia_com": moments.tolist()},
            **{"gravity": self.gravity.tolist(), "fixed": self.fixed},
        }
        if self.mass <= 0:
            raise ValueError(f"mass must be positive; got {mass}")
        self.inertia_com = np.diag(moments) if moments.ndim == 1 else moments
        check_inertia(self.inertia_com)
        size, lever = math.hypot(*self.gravity.tolist()), self.com if self.fixed else np.zeros(3)
        self.up = -direction_of(self.gravity) if size else np.array((0.0, 0.0, 1.0))
        with np.errstate(all="ignore"):  # what is infinite is refused
            self.inertia, self.axes, self.symmetry = principal(self.inertia_com, self.mass, lever, heavy=size > 0.0)
            weight = self.mass * size * (self.axes @ lever)
            inverse = 1.0 / self.inertia
        check_range((*weight, *inverse, *inverse * np.max(self.inertia)))
        self.weight = np.where(np.abs(weight) > TURNED * np.max(np.abs(weight)), weight, 0.0)
        r, differences = differences_of_inverses(self.inertia)
        numbers = (1.0 / self.inertia[r], *differences, *self.weight, *self.up)
        pattern = tuple(number if number in (0.0, 1.0) else 0.5 for number in numbers)
        self.name, self.space = "rigid_body", BODY
        self.system, self.extra_invariants = _formulas(self.symmetry, pattern)
        self.numbers = tuple(map(float, numbers))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self.facts.items())})"

    def __str__(self) -> str:
        return f"{type(self).__name__} with moments {', '.join(f'{value:.6g}' for value in self.inertia)} kg m²"

    @cached_property
    def offers(self) -> frozenset[str]:
        """The words of any problem, and "body"."""
        return super().offers | {"body"}

    @property
    def is_free(self) -> bool:
        """Whether there is no torque."""
        return not np.any(self.weight)

    def period(self, y: ArrayLike) -> float:
        """The time in s after which ω of a free body comes back in the body's frame. The rotation does not come back.

        It is 0 if ω is constant there, and inf on the separatrix.

        Raises
        ------
        ValueError
            A weight acts on the body.
        """
        if not self.is_free:
            raise ValueError("period: only the motion of a free body has one; of a heavy top see exact.nutation_period")
        return free_motion.period(self.inertia, self.check_state(self.split_state(y)[0])[4:])

    # ------------------------------------------------------------------ states

    def state(
        self,
        *,
        rotation: Rotation | ArrayLike,
        omega_body: ArrayLike | None = None,
        omega_world: ArrayLike | None = None,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
    ) -> Array:
        """The state that `integrate` takes.

        Parameters
        ----------
        rotation : Rotation, (3, 3) or (4,)
            A SciPy Rotation, a matrix or a unit quaternion, scalar first, that takes vectors of the body to the world.
        omega_body, omega_world : (3,)
            Angular velocity in rad/s, in the frame of the body or of the world: one of the two.
        position, velocity : (3,)
            Of the centre of mass of a flying body, in the world, m and m/s; 0 by default.

        Returns
        -------
        (7,) or (13,)
            (q, L), for a flying body with position and velocity.

        Raises
        ------
        ValueError
            A malformed number, no or two angular velocities, or a position of a body with a fixed point.
        """
        from scipy.spatial.transform import Rotation

        turn, omega = as_motion(rotation, omega_body, omega_world)
        q = (turn * Rotation.from_matrix(self.axes.T)).as_quat(scalar_first=True)
        y = np.concatenate((q, self.inertia * (self.axes @ omega)))
        if self.fixed:
            if position is not None or velocity is not None:
                raise ValueError("position and velocity are those of a body that flies: RigidBody(…, fixed=False)")
            return y
        flight = [
            np.zeros(3) if v is None else check_array(v, name, (3,))
            for name, v in (("position", position), ("velocity", velocity))
        ]
        return np.concatenate((y, *flight))

    def split_state(self, y: Any) -> tuple[Any, Array | None]:
        """(q, L), and for a flying body position and velocity (6,), which are 0 if y has (q, L) only; otherwise None."""
        if self.fixed:
            return y, None
        if np.size(y) == 7:
            return y, np.zeros(6)
        return tuple(np.split(check_numbers(y, "y0", 13), [7]))  # type: ignore[return-value]

    def flight_at(self, flight: Array, t: Array) -> Array:
        """Position and velocity (N, 6) of the centre of mass at times (N,), from `flight` (6,) at t = 0: x + v t + g t²/2."""
        t, g = t[:, None], self.gravity
        return np.hstack((flight[:3] + t * (flight[3:] + (0.5 * t) * g), flight[3:] + t * g))

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (7,). ValueError: it is no state, or its quaternion is not of length 1."""
        state = super().check_state(y, name)
        length = float(np.linalg.norm(state[:4]))
        if abs(length - 1.0) > UNIT:
            raise ValueError(f"{name}: the quaternion must be a unit one; its length is {length:.9g}")
        return state

    # ------------------------------------------------------------------ observables of states (N, 7)

    def rotations(self, y: ArrayLike) -> Rotation:
        """Rotations from the body's frame to the world's."""
        from scipy.spatial.transform import Rotation

        quaternions = np.asarray(y, dtype=float)[..., :4]
        return Rotation.from_quat(quaternions, scalar_first=True) * Rotation.from_matrix(self.axes)

    def angular_velocity(self, y: ArrayLike) -> Array:
        """ω in the body's frame, rad/s, shape (N, 3)."""
        return (np.asarray(y, dtype=float)[..., 4:7] / self.inertia) @ self.axes

    def energy_of(self, rotation: Rotation | ArrayLike, omega_body: ArrayLike) -> Array:
        """ω·I ω/2 + R w·up in J, the rotational energy and the potential energy of the weight, shape (...,).

        rotation : a Rotation or matrices (..., 3, 3), body to world. omega_body : (..., 3) rad/s.
        """
        omega = np.asarray(omega_body, dtype=float) @ self.axes.T
        kinetic = np.sum(self.inertia * omega * omega, axis=-1) / 2
        return kinetic + (_matrices(rotation) @ (self.weight @ self.axes)) @ self.up

    def momentum_of(self, rotation: Rotation | ArrayLike, omega_body: ArrayLike) -> Array:
        """R I ω, the angular momentum in the world's frame, kg m²/s, shape (..., 3); arguments as for `energy_of`."""
        omega = np.asarray(omega_body, dtype=float) @ self.axes.T
        return (_matrices(rotation) @ ((self.inertia * omega) @ self.axes)[..., None])[..., 0]

    def errors(self, y: ArrayLike, rotation: ArrayLike) -> dict[str, Array]:
        """How far states (N, 7) are from the rotations (N, 3, 3), body to world, of another solution; each error (N,).

        position : of the centre of mass, m. rotation : the angle between the two, rad. spin : its part about the axis of a
        symmetric body, rad.
        """
        from scipy.spatial.transform import Rotation

        matrices = np.asarray(rotation, dtype=float)
        off = Rotation.from_matrix(matrices).inv() * self.rotations(y)
        errors = {
            "position": np.linalg.norm(self.rotations(y).apply(self.com) - matrices @ self.com, axis=-1),
            "rotation": off.magnitude(),
        }
        if self.symmetry is not None:
            q = off.as_quat(scalar_first=True)
            twist = 2.0 * np.arctan2(q[..., 1:] @ self.axes[self.symmetry], q[..., 0])
            errors["spin"] = np.abs(np.remainder(twist + math.pi, 2.0 * math.pi) - math.pi)
        return errors

    # ------------------------------------------------------------------ the Lagrange top inside a symmetric body

    @cached_property
    def axis(self) -> Array | None:
        """The unit vector (3,) in the body's frame along the axis of symmetry, towards the centre of mass, or None."""
        return None if self.symmetry is None else self._towards * self.axes[self.symmetry]

    @property
    def _towards(self) -> float:
        """-1 if the centre of mass is on the negative side of the axis of symmetry, otherwise 1."""
        return -1.0 if self.weight[self.symmetry] < 0.0 else 1.0

    @property
    def across(self) -> float:
        """A in kg m², the moment of inertia across the axis of symmetry."""
        assert self.symmetry is not None
        return float(self.inertia[(self.symmetry + 1) % 3])

    @property
    def top(self) -> LagrangeTop:
        """The Lagrange top of a symmetric body, alpha = |w|/A in 1/s². Its J is angular momentum over A (1/s), and |x| = 1.

        Raises
        ------
        ValueError
            The body is not symmetric.
        """
        if self.symmetry is None:
            raise ValueError(f"no Lagrange top is in a body that is not symmetric; moments {self.inertia.tolist()}")
        return LagrangeTop(abs(float(self.weight[self.symmetry])) / self.across)

    @cached_property
    def world(self) -> Array:
        """The frame of `top` in the world, as rows (3, 3); the third points up."""
        return upright(self.up)

    def reduced(self, y: Array) -> Array:
        """(J, x) of `top`, shape (6,), for one state (7,): J = R L/A, x = R axis, both in the frame `world`."""
        to_frame = self.world @ self.rotations(y).as_matrix() @ self.axes.T
        assert self.symmetry is not None
        return np.concatenate((to_frame @ (y[4:7] / self.across), self._towards * to_frame[:, self.symmetry]))


def _matrices(rotation: Any) -> Array:
    """The matrices of a Rotation, or the matrices themselves."""
    return rotation.as_matrix() if hasattr(rotation, "as_matrix") else np.asarray(rotation, dtype=float)
