"""The free rigid body in closed form, with its rotation: any moments of inertia, any start, any time.

L is that of `problem.free_motion`. Where G = |L| points up, the axis k turns about the vertical by

    ψ = G a_i t − G (a_i − a_k)/λ · [C]      C(u) = r sn³/3 · R_J(cn², dn², 1, 1 + r sn²),   r = (a_i − a_j)/(a_j − a_k)

from its start: Legendre's integral of the third kind is u − C. Whole half periods are taken off u first. With
η = arg(L_1 + i L_2) and θ the angle from axis k to L, in axes 1, 2, 3 = k that are right-handed,

    R(t) = R(0) M(0)ᵀ M(t)        M = R3(ψ) R2(−θ) R3(−η)

Sources: Landau & Lifshitz, Mechanics (1976), section 37; van Zon and Schofield, J. Comput. Phys. 225 (2007) 145; Carlson, Numer.
Algorithms 10 (1995) 13 (R_J); Bulirsch, Numer. Math. 7 (1965) 78 (elliptic functions from 1 − k²).
"""

from __future__ import annotations

import math

import numpy as np

from lagrange_bench.integrators.checks import check_grid
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.problem.free_motion import FreeMotion, free_motion
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.rotation import product

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


def third(s: Array, c: Array, d: Array, ratio: float) -> Array:
    """C(u) from sn, cn and dn."""
    from scipy.special import elliprj

    if ratio == 0.0:
        return np.zeros_like(s)
    return ratio * s**3 / 3.0 * elliprj(c * c, d * d, 1.0, 1.0 + ratio * s * s)


def momenta_and_turns(motion: FreeMotion, t: Array) -> tuple[Array, Array]:
    """L (N, 3) at times (N,), and quaternions (4, N) of the turn from the body at each time to the body at the start."""
    from scipy.special import ellipkm1, elliprf

    m1, (s0, c0) = motion.complement, motion.start
    quarter = float(ellipkm1(m1))
    size = math.hypot(s0, c0)
    s0, c0 = s0 / size, c0 / size
    u0 = s0 * float(elliprf(c0 * c0, c0 * c0 + m1 * s0 * s0, 1.0))
    u = motion.rate * np.concatenate(([0.0], t)) + u0
    n = np.zeros_like(u) if math.isinf(quarter) else np.rint(u / (2.0 * quarter))
    n[0] = 0.0  # also where rounding takes u0 beyond a quarter period
    if not np.all(np.abs(n) < MOST_TURNS):
        raise StepError("theta_functions", "t is over 2^45 half periods of the motion: its phase is beyond double")
    rest = u if math.isinf(quarter) else u - 2.0 * quarter * n
    s, c, d = sncndn(rest, m1)
    s[0], c[0], d[0] = s0, c0, math.sqrt(c0 * c0 + m1 * s0 * s0)
    if math.isinf(quarter):  # sn = tanh
        root = math.sqrt(motion.ratio)
        C = (motion.ratio * u - root * np.arctan(root * s)) / (1.0 + motion.ratio)
    else:
        whole = 2.0 * float(third(np.ones(1), np.zeros(1), np.full(1, math.sqrt(m1)), motion.ratio)[0])
        C = third(s, c, d, motion.ratio) + n * whole
    psi = motion.momentum * (motion.last * np.concatenate(([0.0], t)) - motion.across / motion.rate * (C - C[0]))
    sign = 1.0 - 2.0 * np.remainder(n, 2.0)
    alpha, beta, gamma = motion.amplitudes
    parts = sign * alpha * c, sign * beta * s, gamma * d
    L = np.empty((len(u), 3))
    for axis, part in zip(motion.axes, parts, strict=True):
        L[:, axis] = part
    k = motion.axes[2]
    one, two = (k + 1) % 3, (k + 2) % 3
    half = 0.5 * np.arctan2(np.hypot(L[:, one], L[:, two]), L[:, k])
    psi, eta = 0.5 * psi, 0.5 * np.arctan2(L[:, two], L[:, one])
    q = np.empty((4, len(u)))  # of M, from half angles
    q[0], q[1 + k] = np.cos(half) * np.cos(psi - eta), np.cos(half) * np.sin(psi - eta)
    q[1 + one], q[1 + two] = np.sin(half) * np.sin(psi + eta), -np.sin(half) * np.cos(psi + eta)
    back = q[0, 0], -q[1, 0], -q[2, 0], -q[3, 0]
    return L[1:], np.stack(product(back, q[:, 1:]))


def evaluate(body: RigidBody, y0: Array, times: Array) -> tuple[Array, Work]:
    """States (N, 7) of a free body at any times, one evaluation each."""
    motion, y = free_motion(body.inertia, y0[4:]), np.empty((len(times), 7))
    if motion is None:  # L stays, and the body turns about it
        omega = y0[4:] / body.inertia
        half, axis = 0.5 * float(np.linalg.norm(omega)) * times, omega / (np.linalg.norm(omega) or 1.0)
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
