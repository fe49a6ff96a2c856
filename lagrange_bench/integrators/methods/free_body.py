"""The free rigid body in closed form, with its rotation: any moments of inertia, any start, any time.

L, G = |L|, λ and the other constants are those of `problem.free_motion`. Let L point up. Since u = 0 the axis k has turned about
the vertical by

    ψ = a_j G t + (a_j G² − D)/(G λ) C(u) + atan(p sn u cn u/dn u)        p = (a_i − a_j) G/λ
    C(u) = ∫ N sn²/(1 − N sn²) du = N sn³/3 · R_J(cn², dn², 1, 1 − N sn²)     1 − N = (a_j G² − D)/(a_i G² − D)

Landau and Lifshitz have a_i G t − G (a_i − a_k)/λ (u − Π(u, −r)), r = (a_i − a_j)/(a_j − a_k): large terms, which cancel where r
is large, as in needles. DLMF 19.7.10 takes −r to N = (k² + r)/(1 + r). Then all terms have one sign, or, for bodies of matter,
cancel by half at most. Whole half periods and whole turns are subtracted in double-double. With η = arg(L_1 + i L_2) and the
angle θ from axis k to L, in right-handed axes 1, 2, 3 = k,

    R(t) = R(0) M(0)ᵀ M(t)        M = R3(ψ) R2(−θ) R3(−η)

Errors are about 1e-15 of |q| and |L| at any time, also of needles and plates, and 1.5e-14 next to the separatrix.

Sources: Landau & Lifshitz, Mechanics (1976), section 37; van Zon and Schofield, J. Comput. Phys. 225 (2007) 145; Carlson, Numer.
Algorithms 10 (1995) 13 (R_J); Bulirsch, Numer. Math. 7 (1965) 78 (elliptic functions from 1 − k²).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators.checks import check_grid
from lagrange_bench.integrators.compiling.double_double import div, two_prod
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.problem.free_motion import FreeMotion, free_motion, root
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.torus.time_step import TWO_PI, period_and_turn

Pair = tuple[float, float]
MOST_TURNS = 2.0**45  # half periods: beyond them doubles hardly resolve the phase


def sncndn(u: Array, complement: float) -> tuple[Array, Array, Array]:
    """Jacobi's sn, cn, dn at u (N,) within a quarter period of 0, from 1 − k²; Bulirsch's descending transformation."""
    if complement == 0.0:
        with np.errstate(over="ignore"):  # 1/inf is right
            c = 1.0 / np.cosh(u)
        return np.tanh(u), c, c
    means, roots = [1.0], [math.sqrt(complement)]
    while abs(means[-1] - roots[-1]) > 1e-9 * means[-1]:
        means, roots = [*means, 0.5 * (means[-1] + roots[-1])], [*roots, math.sqrt(means[-1] * roots[-1])]
    last = 0.5 * (means[-1] + roots[-1])
    s, c = np.sin(last * u), np.cos(last * u)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = c / s
        scaled, d = last * ratio, np.ones_like(u)
        for mean, root in zip(means[::-1], roots[::-1], strict=True):
            # dn and c/s of the next larger modulus
            ratio, scaled = scaled * ratio, d * scaled
            d = (root + ratio) / (mean + ratio)
            ratio = scaled / mean
        sine = np.copysign(1.0 / np.sqrt(scaled * scaled + 1.0), s)
        cosine = scaled * sine
    still = s == 0.0
    return np.where(still, 0.0, sine), np.where(still, 1.0, cosine), np.where(still, 1.0, d)


class Formula(NamedTuple):
    """The numbers of the formulas above, for one motion."""

    start: tuple[float, float]  # sn and cn of u0, on the unit circle
    phase: float  # u0; u = λ t + u0
    rate: float  # λ
    fast: float  # (a_j G² − D)/(G λ)
    bend: float  # p
    ratio: float  # N
    rest: float  # 1 − N
    slow: Pair  # a_j G/2π, turns in a second; a double-double, as the next two
    half: Pair  # half a period, 2K/λ; inf on the separatrix
    turn: Pair  # turns of ψ − a_j G t in half a period, without whole turns


def formula(motion: FreeMotion) -> Formula:
    """The numbers of a motion, computed from fractions and rounded once."""
    from scipy.special import elliprf

    (s, c), (a_i, a_j, a_k), G, rate = motion.start, motion.inverse, motion.momentum, motion.rate
    low, middle, high = motion.low, motion.middle, motion.high
    # (a_j G² − D)/(G (1 − N sn²)) is (arg F_J)' of a top whose ζ2 is 0, with κ = 1, in the time λ t
    unit = 2 / (G * rate) ** 2
    z1, z3 = unit * G**2 * (a_i - a_k) * middle, -unit * G**2 * (a_i - a_j) * low
    J, below, above = unit * low * high, unit * low * middle, unit * high * middle
    slope, steady = J * middle / (G * rate), -2 * middle / (G * rate)
    half, turn = period_and_turn(*map(pair, (z1, Fraction(0), z3, J, below, above, slope, steady)))
    size = math.hypot(s, c)
    s, c = s / size, c / size
    return Formula(
        start=(s, c),
        phase=s * float(elliprf(c * c, c * c + motion.complement * s * s, 1.0)),
        rate=float(rate),
        fast=float(middle / (G * rate)),
        bend=float((a_i - a_j) * G / rate),
        ratio=float((a_i - a_j) * G**2 / high),
        rest=float(middle / high),
        slow=div(pair(a_j * G), TWO_PI),
        half=half if math.isinf(half[0]) else div(half, pair(rate)),
        turn=turn,
    )


def pair(v: Fraction) -> Pair:
    """v as a double-double."""
    return float(v), float(v - Fraction(float(v)))


def bent(f: Formula, s: Any, c: Any, d: Any) -> Any:
    """ψ − a_j G t, from sn, cn and dn."""
    from scipy.special import elliprj

    if f.rest == 0.0:  # on the separatrix cn = dn
        return np.arctan(f.bend * s)
    C = f.ratio * s**3 / 3.0 * elliprj(c * c, d * d, 1.0, c * c + f.rest * s * s)
    return f.fast * C + np.arctan2(f.bend * s * c, d)


def turned(n: Array, turns: Pair) -> Any:
    """The angle of n·turns, without whole turns."""
    p, e = two_prod(n, turns[0])
    return 2.0 * math.pi * ((p - np.rint(p)) + (e + n * turns[1]))


def momenta_and_turns(motion: FreeMotion, t: Array) -> tuple[Array, Array]:
    """L (N, 3) at times (N,), and quaternions (4, N) of the rotation from the body at each time to the body at the start."""
    f = formula(motion)
    t = np.concatenate(([0.0], t))
    n, m1, (s0, c0) = np.zeros_like(t), motion.complement, f.start
    since = t
    if not math.isinf(f.half[0]):
        n = np.rint((t + f.phase / f.rate) / f.half[0])
        n[0] = 0.0  # even if rounding takes u0 beyond a quarter period
        p, e = two_prod(n, f.half[0])
        since = (t - p) - (e + n * f.half[1])
    if not np.all(np.abs(n) < MOST_TURNS):
        raise StepError("theta_functions", "t is over 2^45 half periods of the motion: its phase is beyond double")
    s, c, d = sncndn(f.rate * since + f.phase, m1)
    s[0], c[0], d[0] = s0, c0, math.sqrt(c0 * c0 + m1 * s0 * s0)
    psi = bent(f, s, c, d)
    psi += turned(t, f.slow) + turned(n, f.turn) - psi[0]
    sign = 1.0 - 2.0 * np.remainder(n, 2.0)
    alpha, beta, gamma = motion.amplitudes
    parts = sign * alpha * c, sign * beta * s, gamma * d
    L = np.empty((len(t), 3))
    for axis, part in zip(motion.axes, parts, strict=True):
        L[:, axis] = part
    k = motion.axes[2]
    one, two = (k + 1) % 3, (k + 2) % 3
    half = 0.5 * np.arctan2(np.hypot(L[:, one], L[:, two]), L[:, k])
    psi, eta = 0.5 * psi, 0.5 * np.arctan2(L[:, two], L[:, one])
    q = np.empty((4, len(t)))  # of M, from half angles
    q[0], q[1 + k] = np.cos(half) * np.cos(psi - eta), np.cos(half) * np.sin(psi - eta)
    q[1 + one], q[1 + two] = np.sin(half) * np.sin(psi + eta), -np.sin(half) * np.cos(psi + eta)
    back = q[0, 0], -q[1, 0], -q[2, 0], -q[3, 0]
    return L[1:], np.stack(product(back, q[:, 1:]))


def evaluate(body: RigidBody, y0: Array, times: Array) -> tuple[Array, Work]:
    """States (N, 7) of a free body at any times, one evaluation each."""
    motion, y = free_motion(body.inertia, y0[4:]), np.empty((len(times), 7))
    if motion is None:  # L is constant in the body, which turns about L
        omega = y0[4:] / body.inertia
        squares = (
            Fraction(L) ** 2 / Fraction(I) ** 2 for L, I in zip(y0[4:].tolist(), body.inertia.tolist(), strict=True)
        )
        half = 0.5 * turned(times, div(pair(root(sum(squares, Fraction(0)))), TWO_PI))
        axis = omega / (np.linalg.norm(omega) or 1.0)
        y[:, 4:], turn = y0[4:], np.vstack((np.cos(half), axis[:, None] * np.sin(half)))
    else:
        y[:, 4:], turn = momenta_and_turns(motion, times)
    y[:, :4] = np.stack(product(tuple(y0[:4].tolist()), turn), axis=1)
    y[:, :4] /= np.linalg.norm(y[:, :4], axis=1, keepdims=True)
    y[times == 0.0] = y0
    return y, Work(steps=len(times))


class FreeStepper(Stepper):
    """The closed form at every multiple of h."""

    from_start = True

    def __init__(self, body: RigidBody, h: float):
        self.body, self.h, self.work = body, h, Work()

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        times = self.h * (every * np.arange(n // every + 1, dtype=np.float64))
        self.work.steps += n
        return evaluate(self.body, y, times)[0]


def prepare(body: RigidBody, y0: Array, h: float) -> FreeStepper:
    """The closed form of a free body at every multiple of h."""
    return FreeStepper(body, h)
