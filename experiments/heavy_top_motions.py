"""The motions of whole bodies that `heavy_top` follows: body, start, length and end of each.

If A = B = 2C and the centre of mass is on the first axis, K = |(ω1 + iω2)² − (w/C)(Γ1 + iΓ2)|² is constant.

Source of K: Kowalevski, Acta Math. 12 (1889) 177.
"""

from fractions import Fraction
from functools import cache

import numpy as np

from lagrange_bench.integrators import CASES, RigidBody
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.truth.rigid_body import rigid_motion

# mass, centre of mass, moments of inertia about it, gravity. About the fixed point A = B = 2 and C = 1
KOVALEVSKAYA = (1, (0.5, 0, 0), (2, 1.75, 0.75), (0, 0, -9.81))
# rotation, body to world; angular velocity in the body
START = (((1, 0, 0), (0, 0.8, -0.6), (0, 0.6, 0.8)), (1.5, -1.0, 2.0))
UNTIL = {"bruels": 2.0, "slow": 2.0, "simo_wong": 10.0, "kovalevskaya": 10.0}


def motion(case: str) -> tuple[RigidBody, Array]:
    """The body and its state at t = 0."""
    if case == "kovalevskaya":
        body = RigidBody(*KOVALEVSKAYA)
        return body, body.state(rotation=np.array(START[0]), omega_body=START[1])
    return CASES[case].body, CASES[case].state


@cache
def end(case: str) -> Array:
    """The rotation matrix at the end."""
    if case != "kovalevskaya":
        return CASES[case].solution([UNTIL[case]]).rotation.as_matrix()[0]
    rotation = [[Fraction(v).limit_denominator(10) for v in row] for row in START[0]]
    ((R, _),) = rigid_motion(*KOVALEVSKAYA, rotation, START[1], [UNTIL[case]], digits=20)
    return np.array([[float(v) for v in row] for row in R])


def kovalevskaya(y: Array) -> Array:
    """Kovalevskaya's integral K (N,) at states (N, 7) of her body."""
    body = motion("kovalevskaya")[0]
    omega, up = body.angular_velocity(y), body.rotations(y).apply((0.0, 0.0, 1.0), inverse=True)
    z = (omega[:, 0] + 1j * omega[:, 1]) ** 2 - body.weight[0] / body.inertia[2] * (up[:, 0] + 1j * up[:, 1])
    return np.abs(z) ** 2
