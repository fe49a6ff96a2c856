"""The exact motion and rotation of a symmetric heavy body, from the theta functions of the Lagrange top inside it.

The third axis of the world points up; the third axis of the body is its axis of symmetry. The rotation from body to world is a
unitary matrix (u, −v*; v, u*) of Cayley–Klein parameters, with x+ = 2 u* v and x3 = |u|² − |v|². With A, B and n of `truth.tide`

    u = B*/√n e^(iχ − iφ/2),    v = A/√n e^(iχ + iφ/2),    χ' = −(ω_a − φ' x3)/2 − Im(A* A' − B* B')/n,

where φ is the turn about e3, and ω_a = L_a/C is constant. In a uniform field (k = 0) the divisor of the theta functions is real
on the orbit. So χ' is constant, too (Klein & Sommerfeld, Theorie des Kreisels, chapter VI). B gains a phase in each period. The
mean rate of χ counts it, and a second rate gives the rest within a period.

The numbers of the start are taken as exact. q/|q| is the rotation, and |q| stays constant. If `up` is along an axis of the
world, all cases are distinguished exactly, else to about 10^-60. Tested against `truth.rigid_body`.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.truth import tide
from lagrange_bench.integrators.truth.exact import DIGITS, Clock, check_digits, check_times, reduced, rounded
from lagrange_bench.integrators.truth.free_body import Rationals, clock, quaternions, real
from lagrange_bench.integrators.truth.orbit import Rotation
from lagrange_bench.support.precision import workdps

BITS = 400  # of directions that are not rational


class Facts(NamedTuple):
    """A body and its start, exact."""

    across: Fraction  # A
    along: Fraction  # C
    weight: Fraction  # along the axis
    axis: int
    up: Rationals
    start: Rationals  # (q, L)


class Motion(NamedTuple):
    """Constants of the motion; mpmath numbers, or doubles."""

    orbit: Any  # of `truth.tide`, or None if the axis only turns about the vertical
    turn: Any  # φ'
    spin: Any  # mean rate of χ
    drift: Any  # rate of the rest of χ within a period
    half: Any  # (2,): u and v, if they are constant
    momentum: Any  # (J+, J3) in that case
    world: Any  # (3, 3): rows are the frame with e3 up
    left: Any  # (4,): q = left g right, with the quaternion g of (u, v)
    right: Any  # (4,)
    rate: int  # times of the orbit are times 2^rate


def solution(body: Any, y0: ArrayLike, t: Any, digits: int | None = None, more: Array | float = 0.0) -> NDArray[Any]:
    """States (q, L) at times t of the motion that is at y0 at t = 0; as `exact.solution`.

    Parameters
    ----------
    body, y0 : a symmetric RigidBody with a weight, and a state (7,).
    t, digits : as in `exact.solution`, for N times.
    more : (N,), added to `t`, below an ulp of it; ignored with `digits`.

    Returns
    -------
    (N, 7): q or −q, which are the same rotation, and L. The errors of doubles are below 1e-14 of |q| and of the scale of L at
    every t, with `digits` below 10^-digits of these. ValueError as in `exact.solution`.
    """
    facts = facts_of(body, y0)
    if digits is not None:
        return in_mpmath(facts, check_times(t, exact=True), check_digits(digits))
    motion, period, turn, spin = prepared(facts)
    times, rest = np.ldexp(check_times(t), motion.rate), np.ldexp(more, motion.rate)
    r = reduced(period, times)[1] + rest
    phi, chi = (rate * (reduced(clock, times)[1] + rest) for rate, clock in ((motion.turn, turn), (motion.spin, spin)))
    return np.stack(state(facts, motion, r, phi, chi, np), axis=-1)


def in_mpmath(facts: Facts, times: NDArray[Any], digits: int) -> NDArray[Any]:
    """States (N, 7) at `times`, to `digits` digits."""
    rough, period, _ = find_motion(facts, DIGITS)
    latest = mp.ldexp(max(map(abs, times), default=mpf(0)), rough.rate)
    needed = digits + max(0, int(mp.log10(latest * (abs(rough.turn) + abs(rough.spin) + 1 / period) + 1)))
    motion, period, t0 = find_motion(facts, -(-needed // 16) * 16)  # rounded up, so that cached motions are used
    y = np.empty((len(times), 7), dtype=object)
    with workdps(needed + 15):
        for row, t in zip(y, [mp.ldexp(v, motion.rate) for v in times], strict=True):
            r = t - t0
            r -= mp.nint(r / period) * period if mp.isfinite(period) else 0
            row[:] = state(facts, motion, r, motion.turn * t, motion.spin * t, mp)
    with workdps(digits):
        return +y


def facts_of(body: Any, y0: ArrayLike) -> Facts:
    k = body.symmetry
    A, C, weight = (Fraction(float(v)) for v in (body.across, body.inertia[k], body.weight[k]))
    up, start = (tuple(Fraction(v) for v in values.tolist()) for values in (body.up, body.check_state(y0)))
    return Facts(A, C, weight, k, up, start)


def state(facts: Facts, c: Motion, r: Any, phi: Any, chi: Any, functions: Any) -> tuple[Any, ...]:
    """q and L. r : the time since x3 was smallest. phi : the turn about e3. chi : the phase χ by its mean rate alone."""
    g, J = parameters(c, r, phi, chi, functions)
    q = product(product(c.left, g), c.right)
    J = tuple(sum(row[n] * v for row, v in zip(c.world, J, strict=True)) for n in range(3))
    size = sum(v * v for v in q)
    _, *L = product(product(conjugate(q), (0 * r, *J)), q)
    A, along = facts.across, facts.start[4 + facts.axis]
    scale, spin = (float(v) if functions is np else real(v) for v in (A * Fraction(2) ** c.rate, along))
    L = [scale * v / size for v in L]
    L[facts.axis] = spin + 0 * r
    return *q, *L


def parameters(c: Motion, r: Any, phi: Any, chi: Any, functions: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """The quaternion of (u, v), and J; arguments as of `state`, arrays or mpmath numbers."""
    if c.orbit is None:
        (u, v), (J, J3) = c.half, c.momentum
    else:
        parts = (tide.evaluate(part, c.orbit.kappa, abs(r), functions)[0] for part in (c.orbit.A, c.orbit.B))
        side = 1 - 2 * (r < 0)
        A, B = (part.real + 1j * (side * part.imag) for part in parts)
        root = (A.real**2 + A.imag**2 + B.real**2 + B.imag**2) ** 0.5
        u, v = B.conjugate() / root, A / root
        J, J3, phi = tide.position(c.orbit, r, functions)[0], c.orbit.J3, phi + c.orbit.phase
    chi = chi + c.drift * r
    u, v = u * functions.exp(1j * (chi - phi / 2)), v * functions.exp(1j * (chi + phi / 2))
    J = J * functions.exp(1j * phi)
    return (u.real, -v.imag, v.real, -u.imag), (J.real, J.imag, J3)


# ---------------------------------------------------------------- constants


@lru_cache(maxsize=256)
def prepared(facts: Facts) -> tuple[Motion, Clock, Clock, Clock]:
    """The constants as doubles, and the clocks of the period, of φ and of χ."""
    motion, period, t0 = find_motion(facts, DIGITS)
    with workdps(DIGITS + 15):
        clocks = (
            clock(period, t0),
            *(clock(2 * mp.pi / abs(rate) if rate else mp.inf, mpf(0)) for rate in (motion.turn, motion.spin)),
        )
    return rounded(motion)._replace(rate=motion.rate), *clocks


@lru_cache(maxsize=256)
def find_motion(facts: Facts, digits: int) -> tuple[Motion, mpf, mpf]:
    """The constants, the period and t0, in units of the orbit."""
    A, C, weight, k, up, start = facts
    L, two = start[4:], Fraction(2)
    with workdps(digits + 15):
        R, world, steepness = matrix(start[:4]), upright(up), length(up)
        J, x = ([sum(a * b for a, b in zip(row, v, strict=True)) for row in world] for v in (
            [sum(a * b for a, b in zip(row, L, strict=True)) / A for row in R], [row[k] for row in R]
        ))  # fmt: skip
        alpha = weight / A * steepness
        orbit = tide.find_orbit(alpha, 0, [Fraction(v) for v in (*J, *x)], digits)
    with workdps(digits + 15):
        motion: Any = orbit.motion
        along = orbit.sign * real(L[k] / C * two**-orbit.rate)  # ω_a
        none = mpf(0)
        if isinstance(motion, Rotation):
            J1, J2, J3 = (real(v * two**-orbit.rate) for v in J)
            across = mp.mpc(real(x[0]), real(x[1]))
            u, v = mp.sqrt((1 + real(x[2])) / 2), mp.sqrt((1 - real(x[2])) / 2)
            half = u, v * (across / abs(across) if across else 1)
            spin = -(along - motion.rate * real(x[2])) / 2
            c = Motion(None, motion.rate, spin, none, half, (mp.mpc(J1, J2), J3), (), (), (), orbit.rate)
            period, t0 = mp.inf, none
        else:
            (a, da), (b, db) = (tide.evaluate(part, motion.kappa, none, mp) for part in (motion.A, motion.B))
            n = mp.re(a) ** 2 + mp.re(b) ** 2
            x3 = (mp.re(b) ** 2 - mp.re(a) ** 2) / n
            spin = -(along - motion.turn * x3) / 2 - mp.im(mp.conj(a) * da - mp.conj(b) * db) / n
            drift, period, t0 = none, motion.period, motion.t0
            if mp.isfinite(period):  # the phase that B gains
                drift = 2 * mp.arg(tide.evaluate(motion.B, motion.kappa, period / 2, mp)[0]) / period
            c = Motion(motion, motion.turn, spin - drift, drift, (), (), (), (), (), orbit.rate)
        frame = [np.array([[real(v)] for v in row], dtype=object) for row in world]
        upwards = tuple(quaternions(*frame)[:, 0])
        left, g = conjugate(upwards), parameters(c, -t0, none, none, mp)[0]
        right = product(conjugate(g), product(upwards, [real(v) for v in start[:4]]))
        return c._replace(world=tuple(tuple(map(real, row)) for row in world), left=left, right=right), period, t0


def conjugate(q: Any) -> tuple[Any, ...]:
    return q[0], -q[1], -q[2], -q[3]


def matrix(q: Rationals) -> list[list[Fraction]]:
    """The rotation of q/|q|."""
    columns = []
    for unit in ((0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)):
        columns.append(product(product(q, unit), conjugate(q))[1:])
    size = sum(v * v for v in q)
    return [[column[n] / size for column in columns] for n in range(3)]


def length(v: Rationals) -> Fraction:
    return rational(mp.sqrt(real(sum(a * a for a in v))))


def rational(v: mpf) -> Fraction:
    return Fraction(int(mp.nint(mp.ldexp(v, BITS))), 2**BITS)


def upright(up: Rationals) -> list[list[Fraction]]:
    """Rows of a frame whose third axis is along `up`: rational numbers, or close to them."""
    n = max(range(3), key=lambda n: abs(up[n]))
    first = tuple(Fraction(m == (n + 1) % 3) for m in range(3))
    if sum(map(bool, up)) == 1:
        third = tuple(v / abs(up[n]) for v in up)
    else:
        with workdps(BITS // 3):
            size = length(up)
            third = tuple(v / size for v in up)
            across = tuple(a - third[(n + 1) % 3] * b for a, b in zip(first, third, strict=True))
            size = length(across)
            first = tuple(v / size for v in across)
    second = [third[(m + 1) % 3] * first[(m + 2) % 3] - third[(m + 2) % 3] * first[(m + 1) % 3] for m in range(3)]
    return [list(first), second, list(third)]
