"""The exact motion and rotation of a free rigid body, by theta functions, for any moments, any start and any time.

    L' = L × ω,   ω = L/I,   a = 1/I,   G = |L|,   D = Σ a L²

Axes i, j, k are as in Euler's solution: j is the middle one, and L goes round k.

    L_i = α cn u,  L_j = β sn u,  L_k = γ dn u,   u = λ (t − t0),  λ² = (a_j − a_k)(a_i G² − D),  k² = (a_i − a_j)(D − a_k G²)/λ²
    α² = (D − a_k G²)/(a_i − a_k),   β² = (D − a_k G²)/(a_j − a_k),   γ² = (a_i G² − D)/(a_i − a_k)

Take a frame of the world whose third axis is along L. The complex number ζ_n holds the other two components of body axis n in it.
ζ' = ζ × ω, and its solutions are quotients of theta functions of v = πu/2K, with one common phase:

    ζ_i = γ/G θ4(v − iβ)/θ4(iβ),   ζ_j = ±i θ3(v − iβ)/θ3(iβ),   ζ_k = −α/G θ1(v − iβ)/θ1(−iβ),   all times θ4(0)/θ4(v) e^(iΛt)

Here β = ±πb/2K with the sign of a_i − a_k, and sc²(b, k') = (a_j − a_k)/(a_i − a_j). Λ makes ζ_j turn at the rate D/G when
L_j = 0. For k² > 1/2 Jacobi's imaginary transformation replaces v by ix with x = πu/2K', and v − iβ by ix + δ with δ = ±πb/2K'.
It exchanges θ2 and θ4. So the nome never exceeds e^-π. It vanishes on the separatrix, and if two moments are equal.

With w = iv or −x all these functions are sums of e^(mw) over one list of whole numbers m. As in `exact`, half periods are
subtracted from t − t0, and whole turns from the mean growth of the phase. mpmath computes the constants from the doubles as
rationals, so no case is decided by rounding. No method is imported, and no formula is shared with one.

Sources: Jacobi, Gesammelte Werke 2 (1882) 289; Whittaker, Analytical Dynamics (1937), section 69; DLMF 20.2, 20.7(viii), 22.2,
19.25(v).
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.truth.exact import (
    DIGITS,
    NEVER,
    NOTHING,
    Clock,
    check_digits,
    check_times,
    reduced,
    split,
)
from lagrange_bench.support.precision import workdps

GUARD = 15  # digits
DOUBLE = 20  # digits to which series are summed in doubles
BLOCK = 4096  # so many times are computed at once
IN_DOUBLES = np.exp, np.real, np.imag
IN_MPMATH = tuple(np.frompyfunc(function, 1, 1) for function in (mp.exp, mp.re, mp.im))
Rationals = tuple[Fraction, ...]


class Motion(NamedTuple):
    """Constants of the motion: mpmath numbers, or these rounded to doubles."""

    axes: tuple[int, int, int]  # i, j, k
    half_period: Any  # 2K/λ, inf on the separatrix
    t0: Any
    turn: Any  # mean rate of the phase
    drift: Any  # rate of the rest of the phase, which is the same in each half period
    speed: Any  # rate of w: imaginary, or real after the transformation
    barrier: Any  # minus the logarithm of the nome
    orders: Any  # m (M,)
    logs: Any  # (M,): terms of the sums are e^(mw − log)
    table: Any  # (7, M): coefficients of the numerators of L_i, L_j, L_k, ζ_i, ζ_j, ζ_k and of their denominator
    before: Any  # (4,): q(0) times the inverse of the quaternion at t = 0 in the frame of L


class Spin(NamedTuple):
    """A turn about an axis that is fixed in the body and in the world."""

    axis: Any  # (3,), its length is 1, or 0 at rest
    turn: Any  # |ω|


def solution(body: Any, y0: ArrayLike, t: Any, digits: int | None = None, more: Array | float = 0.0) -> NDArray[Any]:
    """States (q, L) at times t of the free motion that is at y0 at t = 0; as `exact.solution`.

    Parameters
    ----------
    body, y0 : a RigidBody without torque, and a state (7,). Its moments and the state are taken as exact. q/|q| is the rotation,
    and |q| stays constant.
    t, digits : as in `exact.solution`.
    more : (N,), added to `t`, below an ulp of it; ignored with `digits`.

    Returns
    -------
    (N, 7) for N times, (7,) for one; q or −q, which are the same rotation. The errors of doubles are below 2e-15 of |q| and |L|
    at every t, with `digits` below 10^-digits of these. ValueError as in `exact.solution`, and if a torque acts on the body.
    """
    if not kinds.free_body(body):
        raise ValueError(f"body must be a free RigidBody; got {body!r}")
    start = tuple(Fraction(v) for v in body.check_state(y0).tolist())
    inertia = tuple(Fraction(v) for v in body.inertia.tolist())
    if digits is None:
        times = check_times(t)
        rows, rest = np.atleast_1d(times), np.broadcast_to(more, np.size(times))
        parts = [slice(first, first + BLOCK) for first in range(0, max(1, len(rows)), BLOCK)]
        y = np.vstack([in_doubles(inertia, start, rows[part], rest[part]) for part in parts])
    else:
        digits, times = check_digits(digits), check_times(t, exact=True)
        y = in_mpmath(inertia, start, np.atleast_1d(times), digits)
    return y[0] if times.ndim == 0 else y


# ---------------------------------------------------------------- constants


@lru_cache(maxsize=256)
def find_motion(inertia: Rationals, start: Rationals, digits: int) -> Motion | Spin:
    """The constants of a motion, to `digits` decimal digits."""
    a, L = [1 / v for v in inertia], start[4:]
    with workdps(digits + GUARD):
        if all(L[n] * L[m] * (a[n] - a[m]) == 0 for n, m in ((0, 1), (1, 2), (2, 0))):
            size = mp.sqrt(real(sum(v * v for v in L)))
            omega = mp.sqrt(real(sum((v * w) ** 2 for v, w in zip(L, a, strict=True))))
            return Spin(np.array([real(v) / (size or 1) for v in L]), omega)
        motion = tumbling(a, L, digits)
        first = quaternions(*components(motion, np.array([-motion.t0]), np.array([mpf(0)]), IN_MPMATH))[:, 0]
        inverse = first[0], -first[1], -first[2], -first[3]
        return motion._replace(before=np.array(product([real(v) for v in start[:4]], inverse)))


def tumbling(a: list[Fraction], L: Rationals, digits: int) -> Motion:
    """The constants of a motion with a moving L, except `before`."""
    G2, D = sum(v * v for v in L), sum(v * w * w for v, w in zip(a, L, strict=True))
    i, j, k = sorted(range(3), key=lambda n: -a[n])
    if a[j] * G2 < D or a[j] == a[k]:
        i, k = k, i
    ij, jk, ik = a[i] - a[j], a[j] - a[k], a[i] - a[k]
    low, high = D - a[k] * G2, a[i] * G2 - D
    m, m1 = ij * low / (jk * high), ik * (a[j] * G2 - D) / (jk * high)  # k² and k'²
    alpha, beta, gamma = (mp.sqrt(real(v)) for v in (low / ik, low / jk, high / ik))
    alpha, gamma = -alpha if L[i] < 0 else alpha, -gamma if L[k] < 0 else gamma
    parity, side = 1 if (j - i) % 3 == 1 else -1, 1 if ik > 0 else -1
    beta *= parity * side * mp.sign(alpha) * mp.sign(gamma)  # L_j' = ±(a_i − a_k) L_k L_i
    G, rate = mp.sqrt(real(G2)), mp.sqrt(real(jk * high))
    K, K1 = (mp.pi / (2 * mp.agm(1, mp.sqrt(real(v)))) if v else mp.inf for v in (m1, m))
    u0 = first_kind(real(L[j]) / beta, real(L[i]) / alpha, real(m1))
    transformed = 2 * m > 1
    if transformed:
        unit, barrier, divisor = mp.pi / (2 * K1), mp.pi * K / K1, 2
        shift, centre = 1j * side * unit * first_kind(mp.sqrt(abs(real(jk))), mp.sqrt(abs(real(ij))), real(m)), 0
    else:  # K' − b in place of b, which is infinite if a_i = a_j
        unit, barrier, divisor = mp.pi / (2 * K), mp.pi * K1 / K, 4
        shift, centre = -side * unit * first_kind(abs(gamma), abs(alpha), real(m)), side
    last = reach(barrier, digits + GUARD)
    orders = np.arange(-last, last + 1)
    logs = np.array([smallness(v, 0, barrier) if transformed else mpf(0) for v in orders.tolist()])

    def series(number: int, shift: Any = 0, centre: int = 0) -> Any:
        """Coefficients of a theta function of w + shift + barrier/2 centre, up to one factor for even and one for odd m."""
        terms = zip(orders.tolist(), logs.tolist(), strict=True)
        return np.array([sign(number, v) * mp.exp(log - smallness(v, centre, barrier) + v * shift) if mp.isfinite(log) else mpf(0)
                         for v, log in terms])  # fmt: skip

    def value(coefficients: Any) -> Any:
        return sum(coefficients * IN_MPMATH[0](-logs))

    other = 6 - divisor
    divide, across, along, middle = (series(number) for number in (divisor, other, 3, 1))
    top, side_on, end_on = (series(number, shift, centre) for number in (divisor, 3, 1))
    scale = value(divide)
    slope = value(along) / value(across) * (-1j if transformed else 1)  # sn u = slope θ1/θ4, or θ1/θ2
    speed = rate * unit * (-1 if transformed else 1j)
    table = np.array((
        alpha * scale / value(across) * across,
        beta * slope * middle,
        gamma * scale / value(along) * along,
        gamma / G * scale / value(top) * top,
        1j * parity * scale / value(side_on) * side_on,
        -alpha / G * scale / value(end_on) * end_on,
        divide,
    ))  # fmt: skip
    turn = real(D) / G - mp.im(speed * value(orders * side_on) / value(side_on))
    drift = mp.im(shift) * rate / K  # θ(ix + δ)/θ2(ix) takes up a factor of e^(−2iδ) in a half period
    return Motion((i, j, k), 2 * K / rate, -u0 / rate, turn - drift, drift, speed, barrier, orders, logs, table, None)


def real(q: Fraction | int) -> mpf:
    return mpf(q.numerator) / q.denominator


def first_kind(s: mpf, c: mpf, complement: mpf) -> mpf:
    """Legendre's integral of the first kind at the angle of (c, s), c >= 0. complement : 1 − k²."""
    size = mp.hypot(s, c)
    s, c = s / size, c / size
    return s * mp.elliprf(c * c, c * c + complement * s * s, 1)


def reach(barrier: mpf, digits: int) -> int:
    """The largest |m| that is needed for so many digits."""
    return 1 + math.ceil(math.sqrt(1 + 4 * math.log(10) * digits / barrier))


def smallness(m: int, centre: int, barrier: mpf) -> mpf:
    """Minus the logarithm of the power of the nome at e^(mw), relative to the largest one."""
    power = (m - centre) ** 2 - (m - centre) % 2
    return barrier * power / 4 if power else mpf(0)


def sign(number: int, m: int) -> Any:
    """The sign of e^(mw) in a theta function."""
    if (number in (1, 2)) != (m % 2 == 1):
        return 0
    turn = -1 if number in (1, 4) and m % 4 > 1 else 1
    return turn * (mp.mpc(0, -1) if number == 1 else 1)


# ---------------------------------------------------------------- evaluation


def components(c: Motion, r: Any, angle: Any, functions: Any, odd: Any = 0) -> tuple[Any, Any, Any]:
    """Re ζ, Im ζ and L (3, N) at the times r since t0. odd : 1 after an odd number of half periods, else 0.

    angle : the mean rate of the phase times t. functions : IN_DOUBLES or IN_MPMATH, as the numbers are.
    """
    exp, re, im = functions
    w = c.speed * r
    largest = abs(w) if not im(c.speed) else 0 * r
    sums = c.table @ exp(np.multiply.outer(c.orders, w) - c.logs[:, None] - largest)
    flip, phase = 1 - 2 * odd, exp(1j * (angle + c.drift * r))
    quotients = sums[:6] / sums[6]
    quotients[:2] *= flip
    quotients[3:5] *= phase
    quotients[5] *= flip * phase
    order = np.argsort(c.axes)
    L, zeta = quotients[:3][order], quotients[3:][order]
    return re(zeta), im(zeta), re(L)


def quaternions(first: Any, second: Any, L: Any) -> Any:
    """The quaternions (4, N) from the body to a frame. Its axes have these components (3, N) in the body; L has any length."""
    third = L / sum(L * L) ** 0.5
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = first, second, third
    # 4 q qᵀ; take the row with the largest diagonal
    rows = np.array((
        (1 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz),
    ))  # fmt: skip
    diagonal = np.array([rows[n, n] for n in range(4)], dtype=float)
    q = rows[np.argmax(diagonal, axis=0), :, np.arange(rows.shape[2])].T
    return q / sum(q * q) ** 0.5


@lru_cache(maxsize=256)
def prepared(inertia: Rationals, start: Rationals) -> tuple[Motion | Spin, Clock, Clock]:
    """The constants as doubles, and the clocks of half periods and of the turn."""
    motion = find_motion(inertia, start, DIGITS)
    with workdps(DIGITS + GUARD):
        turn = clock(2 * mp.pi / abs(motion.turn) if motion.turn else mp.inf, mpf(0))
        if isinstance(motion, Spin):
            return Spin(motion.axis.astype(float), float(motion.turn)), turn, turn
        half = clock(motion.half_period, motion.t0)
        keep = abs(motion.orders) <= reach(motion.barrier, DOUBLE)
        motion = motion._replace(
            speed=complex(motion.speed) if mp.im(motion.speed) else float(motion.speed),
            turn=float(motion.turn),
            drift=float(motion.drift),
            orders=motion.orders[keep].astype(float),
            logs=motion.logs[keep].astype(float),
            table=motion.table[:, keep].astype(complex),
            before=motion.before.astype(float),
        )
    return motion, half, turn


def clock(period: mpf, t0: mpf) -> Clock:
    if mp.isinf(period):
        return Clock(NEVER, split(t0, t0), NOTHING, 0.0, NEVER)
    return Clock(split(period, period), split(t0, period), NOTHING, 0.0, NEVER)


def in_doubles(inertia: Rationals, start: Rationals, times: Array, more: Array) -> Array:
    """States (N, 7) at `times` + `more`."""
    motion, half, turn = prepared(inertia, start)
    angle = motion.turn * (reduced(turn, times)[1] + more)
    if isinstance(motion, Spin):
        return spun(motion, [float(v) for v in start], angle, np.cos, np.sin)
    n, r = reduced(half, times)
    return followed(motion, r + more, angle, IN_DOUBLES, np.remainder(n, 2.0))


def in_mpmath(inertia: Rationals, start: Rationals, times: NDArray[Any], digits: int) -> NDArray[Any]:
    """States (N, 7) at `times`, to `digits` digits."""
    rough = find_motion(inertia, start, DIGITS)
    fastest = abs(rough.turn) + (0 if isinstance(rough, Spin) else 1 / rough.half_period)
    needed = digits + max(0, int(mp.log10(max(map(abs, times), default=mpf(0)) * fastest + 1)))
    needed = -(-needed // 16) * 16  # rounded up, so that cached motions are used
    motion = find_motion(inertia, start, needed)
    with workdps(needed + GUARD):
        if isinstance(motion, Spin):
            cos, sin = (np.frompyfunc(function, 1, 1) for function in (mp.cos, mp.sin))
            y = spun(motion, [real(v) for v in start], motion.turn * times, cos, sin)
        else:
            since = times - motion.t0
            n = np.array([mp.nint(v / motion.half_period) for v in since], dtype=object)
            r = since if mp.isinf(motion.half_period) else since - n * motion.half_period
            odd = np.array([int(v) % 2 for v in n], dtype=object)
            y = followed(motion, r, motion.turn * times, IN_MPMATH, odd)
    with workdps(digits):
        return +y


def followed(c: Motion, r: Any, angle: Any, functions: Any, odd: Any) -> NDArray[Any]:
    """States (N, 7) of a motion with a moving L; arguments as of `components`."""
    first, second, L = components(c, r, angle, functions, odd)
    return np.vstack((*product(c.before, quaternions(first, second, L)), L)).T


def spun(c: Spin, start: list[Any], angle: Any, cos: Any, sin: Any) -> NDArray[Any]:
    """States (N, 7) after turns about a fixed axis by the angles (N,)."""
    turn = cos(angle / 2), *(v * sin(angle / 2) for v in c.axis)
    return np.vstack((*product(start[:4], turn), *np.broadcast_to(np.array(start[4:])[:, None], (3, len(angle))))).T
