"""Section 1 of the paper on the complexified phase space: states, brackets, equations of motion, invariants.

A state is y = (J1, J2, J3, x1, x2, x3), the last axis of an array: real, complex, or mpmath numbers in a list or an object array.
All modules of the paper need only + − * / and a square root, so the same line runs in double and in any number of digits.
C1 = |x|² is general; x·x is the bilinear form, nothing is conjugated.
"""

from collections.abc import Callable
from random import Random
from typing import Any

import mpmath
import numpy as np
from mpmath import mp
from numpy.typing import NDArray

from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.problem.top import LagrangeTop

Numbers = NDArray[Any]  # complex128, or objects with + − * / ** such as mpmath numbers
E3 = np.array((0, 0, 1))


def components(y: Any) -> tuple[Any, ...]:
    """The entries of the last axis, apart."""
    return tuple(np.moveaxis(np.asarray(y), -1, 0))


def dot(a: Any, b: Any) -> Numbers:
    """a·b along the last axis, nothing conjugated."""
    return np.sum(np.asarray(a) * b, axis=-1)


def turn_rate(y: Any) -> Numbers:
    """(e3 × J, e3 × x) of states (..., 6): how they move as they turn about e3."""
    y = np.asarray(y)
    return np.concatenate((np.cross(E3, y[..., :3]), np.cross(E3, y[..., 3:])), axis=-1)


def ladder(y: Any) -> tuple[Any, ...]:
    """J3, J-, J+, x3, x-, x+ with J± = J1 ± i J2, x± = x1 ± i x2; (1.4)."""
    J1, J2, J3, x1, x2, x3 = components(y)
    return J3, J1 - 1j * J2, J1 + 1j * J2, x3, x1 - 1j * x2, x1 + 1j * x2


def cartesian(J3: Any, Jm: Any, Jp: Any, x3: Any, xm: Any, xp: Any) -> Numbers:
    """The state (..., 6) of given J3, J-, J+, x3, x-, x+; inverse of `ladder`."""
    return np.stack(((Jm + Jp) / 2, 1j * (Jm - Jp) / 2, J3, (xm + xp) / 2, 1j * (xm - xp) / 2, x3), axis=-1)


def lift(z: Any, like: Any) -> Any:
    """z in the precision of `like`: without it the product of two Python floats would be rounded to double."""
    return z + 0 * like


def numbers(y: Any) -> Numbers:
    """An object array of mpmath numbers. Doubles are taken as exact."""
    return np.frompyfunc(mp.mpmathify, 1, 1)(np.asarray(y))


def check_numbers(values: Any, name: str) -> Numbers:
    """An array of finite numbers: real, complex or mpmath ones. ValueError naming the argument."""
    try:
        array = np.array(values)
        finite = array.dtype.kind in "iufcO" and bool(np.all(np.isfinite(array.astype(complex))))
    except (TypeError, ValueError, OverflowError):
        finite = False
    if not finite:
        raise ValueError(f"{name} must be finite numbers; got {values!r}")
    return array


def check_reals(values: Any, name: str) -> Numbers:
    """The same for real numbers."""
    array = check_numbers(values, name)
    if any(isinstance(v, (complex, mpmath.mpc)) for v in array.ravel().tolist()):
        raise ValueError(f"{name} must be real numbers; got {values!r}")
    return array


def sqrt(z: Any) -> Any:
    """Principal root of complex or mpmath numbers."""
    z = np.asarray(z)
    return z**0.5 if z.dtype == object else np.sqrt(z.astype(complex))


def root_near(square: Any, near: Any) -> Any:
    """The root of `square` closest to `near`, to all its digits."""
    root = sqrt(square)
    turned = np.asarray(root).astype(complex) * np.conj(np.asarray(near).astype(complex))
    sign = np.where(turned.real < 0, -1, 1)
    return sign * root if np.ndim(root) else int(sign) * root


def function(name: str, z: Any) -> Any:
    """An elementary function of NumPy numbers or arrays, or of mpmath numbers or object arrays of them."""
    z = np.asarray(z)
    return np.frompyfunc(getattr(mp, name), 1, 1)(z) if z.dtype == object else getattr(np, name)(z)


def gradient(F: Callable[[Numbers], Any], z: Any) -> Numbers:
    """∂F/∂z, (..., n), at numbers z (n,): central differences in 3/2 of mpmath's digits, right to nearly all digits of mpmath."""
    z, d = numbers(z), mp.mpf(10) ** (-mp.dps // 2)
    with mp.workdps(3 * mp.dps // 2):
        return np.stack([(F(z + d * e) - F(z - d * e)) / (2 * d) for e in np.eye(len(z), dtype=int)], axis=-1)


def refuse(z: Any, reason: str) -> None:
    """ValueError with this reason if a number is 0."""
    if np.any(np.asarray(z) == 0):
        raise ValueError(reason)


def invariants(top: LagrangeTop, y: Any) -> tuple[Any, Any, Any, Any]:
    """H, J3, C1, C2 of complex states; (1.2), (1.5)."""
    J1, J2, J3, x1, x2, x3 = components(y)
    H = (J1 * J1 + J2 * J2 + J3 * J3) / 2 + top.alpha * x3
    return H, J3, x1 * x1 + x2 * x2 + x3 * x3, x1 * J1 + x2 * J2 + x3 * J3


def vector_field(top: LagrangeTop, y: Any) -> Numbers:
    """J' = alpha e3 × x, x' = J × x of complex states, (1.1): the flow f' = {f, H}."""
    y = np.asarray(y)
    J, x = y[..., :3], y[..., 3:]
    return np.concatenate((np.cross(E3, x) * top.alpha, np.cross(J, x)), axis=-1)


def poisson_tensor(*blocks: Any) -> Numbers:
    """P (6, 6) at the state (J, x) of the top, (1.3), or (3n, 3n) at spins s_1, …, s_n, (2.3).

    One argument of six numbers is a state, n arguments of three numbers are n spins; {f, g} = ∇f·P∇g.
    """
    if len(blocks) == 1 and len(blocks[0]) == 6:
        J, x = _minus_hat(blocks[0][:3]), _minus_hat(blocks[0][3:])
        return np.block([[J, x], [x, np.zeros((3, 3), dtype=int)]])
    n = len(blocks)
    zero = np.zeros((3, 3), dtype=int)
    return np.block([[_minus_hat(blocks[j]) if j == k else zero for k in range(n)] for j in range(n)])


def _minus_hat(v: Any) -> Numbers:
    a, b, c = v
    return np.array(((0, c, -b), (-c, 0, a), (b, -a, 0)))


# ------------------------------------------------------------------------------------------------ misprints


def _force(rng: Random, printed: bool) -> float:
    """Torque of the force P = (0, 0, alpha), corrected −P, on the axis, against J'."""
    top, y = draw(rng)
    P = np.array((0.0, 0.0, top.alpha if printed else -top.alpha))
    return float(np.max(np.abs(vector_field(top, y)[:3] - np.cross(y[3:], P))))


ERRATA = [
    Erratum(
        "(1.1), text", "1", "P is the constant vector along the gravity field (then J' = x × P)",
        "the gravity force is −P: J' = x × (−P) = P × x", _force, prose=True,
    ),
]  # fmt: skip
