"""The two-point map in its real, pole-free form, compiled: the step of `methods.backlund`.

For a point (λ, m) of the curve m² = Q(λ), with λ = R + iη and a(λ) = x + λJ + λ² alpha e3 = p + iq,

    w = 2η (Re m p + Im m q − p×q)/(|m|² + |p|² + |q|²),   |w| = η
    J̃ = J + 2 alpha e3 × w        x̃ = x + R (J̃ − J) + (J + J̃) × w

The denominator vanishes only at the unstable sleeping top if λ is the double root of Q; see `direction`. Units make |x| and
|J| + √(|alpha||x|) of order one. One array holds the constants of a torus and a step.
"""

import math

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import add, cmul, dd, mul, scale, sub, times, two_sum
from lagrange_bench.integrators.compiling.intrinsics import load_tuple
from lagrange_bench.integrators.compiling.loops import MEMORY, FixedStepper, Kernel, finite
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem.units import Units, own_units
from lagrange_bench.integrators.torus import time_step as ts

# places of the constants
R, ETA, ETA_2, ETA2, ETA_S, ETA_B, MR, MI_ETA, MI_Q3, MM_Q3, P3, ALPHA_2, J3_2 = range(13)
ALPHA, H, C1, C2, H_LO, C1_LO, C2_LO = range(13, 20)
CONSTANTS = C2_LO + 1  # how many there are

RIDGE = 2.0**-14  # see `corrected`
GRID = 1.5 * 2.0**27  # a number added to this is rounded to a multiple of 2^-25


@jit
def increments(s, c):
    """The increments of J1, J2, x1, x2 and x3 in one two-point map, for |λ| of order one or less.

    With w = r u the new state is a polynomial in r = 2η/n. Its coefficients are ready when the division is. The longest chain
    from state to state is five additions, three products and one division.
    """
    J1, J2, J3, x1, x2, x3 = s
    p1 = x1 + c[R] * J1
    p2 = x2 + c[R] * J2
    p3 = x3 + c[P3]
    n = (p1 * p1 + p2 * p2) + ((c[MM_Q3] + p3 * p3) + c[ETA2] * (J1 * J1 + J2 * J2))
    r = c[ETA_2] / n
    z = c[ETA] * x3 - c[ETA_B]
    u1 = (c[MR] * p1 + c[MI_ETA] * J1) - (c[ETA_S] * x2 - z * J2)
    u2 = (c[MR] * p2 + c[MI_ETA] * J2) + (c[ETA_S] * x1 - z * J1)
    u3 = (c[MR] * p3 + c[MI_Q3]) - c[ETA] * (x1 * J2 - x2 * J1)
    v1 = c[ALPHA_2] * u1
    v2 = c[ALPHA_2] * u2
    K1 = J1 + J1
    K2 = J2 + J2
    y1 = K2 * u3 - (c[R] * v2 + c[J3_2] * u2)
    y2 = (c[R] * v1 + c[J3_2] * u1) - K1 * u3
    y3 = K1 * u2 - K2 * u1
    return (
        -(r * v2),
        r * v1,
        r * (y1 + r * (v1 * u3)),
        r * (y2 + r * (v2 * u3)),
        r * (y3 - r * (v1 * u1 + v2 * u2)),
    )


@jit
def step(s, c, counters):
    """One two-point map, for |λ| of order one or less."""
    J1, J2, J3, x1, x2, x3 = s
    d1, d2, e1, e2, e3 = increments(s, c)
    return J1 + d1, J2 + d2, J3, x1 + e1, x2 + e2, x3 + e3


@jit
def compensated_step(s, c, counters):
    """The same map with compensated sums: the rounding error of an addition goes into the next one.

    For steps of about an ulp, such as a whole nutation without its turn. Without compensation they would all err the same way.
    """
    J1, J2, J3, x1, x2, x3 = s
    d1, d2, e1, e2, e3 = increments(s, c)
    J1, counters[MEMORY] = two_sum(J1, d1 + counters[MEMORY])
    J2, counters[MEMORY + 1] = two_sum(J2, d2 + counters[MEMORY + 1])
    x1, counters[MEMORY + 2] = two_sum(x1, e1 + counters[MEMORY + 2])
    x2, counters[MEMORY + 3] = two_sum(x2, e2 + counters[MEMORY + 3])
    x3, counters[MEMORY + 4] = two_sum(x3, e3 + counters[MEMORY + 4])
    return J1, J2, J3, x1, x2, x3


@jit
def direction(s, c):
    """u along w, and |u|. It serves also where p, q and m vanish together, so that the denominator has no digits left."""
    J1, J2, J3, x1, x2, x3 = s
    p3 = x3 + c[P3]
    z = c[ETA] * x3 - c[ETA_B]
    u1 = (c[MR] * (x1 + c[R] * J1) + c[MI_ETA] * J1) - (c[ETA_S] * x2 - z * J2)
    u2 = (c[MR] * (x2 + c[R] * J2) + c[MI_ETA] * J2) + (c[ETA_S] * x1 - z * J1)
    u3 = (c[MR] * p3 + c[MI_Q3]) - c[ETA] * (x1 * J2 - x2 * J1)
    size = math.sqrt(u1 * u1 + u2 * u2 + u3 * u3)
    if size > 0.0:
        return u1, u2, u3, size
    return 0.0, 0.0, 1.0, 1.0  # the unstable sleeping top with λ the root: turn about the vertical


@jit
def turning_step(s, c, counters):
    """The same map, with w scaled to its exact length and x turned about it. It costs more than twice as much.

    For large |λ|, where increments of x would cancel, and for λ close to a root of Q. The rotation is orthogonal up to the
    rounding of f. It is made of u and not of w, whose denominator |λ|² would be rounded the same way in every step.
    """
    J1, J2, J3, x1, x2, x3 = s
    u1, u2, u3, size = direction(s, c)
    r = c[ETA] / size
    a = c[R] / r
    f = 2.0 / (a * a + (u1 * u1 + u2 * u2 + u3 * u3))
    v1 = u2 * x3 - u3 * x2
    v2 = u3 * x1 - u1 * x3
    v3 = u1 * x2 - u2 * x1
    y1 = x1 + f * ((u2 * v3 - u3 * v2) + a * v1)
    y2 = x2 + f * ((u3 * v1 - u1 * v3) + a * v2)
    y3 = x3 + f * ((u1 * v2 - u2 * v1) + a * v3)
    return J1 - c[ALPHA_2] * (r * u2), J2 + c[ALPHA_2] * (r * u1), J3, y1, y2, y3


@jit
def turn_rows(rows, cos, sin, every):
    """Turn rows k = 0, 1, … about e3 by (k + 1)·every times the angle of (cos, sin), all in double-double.

    Whole nutations turn the top about e3. This turn commutes with the map, so the time loop leaves it out. Inside the loop its
    rounded cosine and sine would scale J and x by the same cos² + sin² ≠ 1 in every step: a linear drift.
    """
    first = ts.power(cos, sin, every)
    a, b = first
    for k in range(len(rows)):
        for i in (0, 3):
            u, v = rows[k, i], rows[k, i + 1]
            rows[k, i] = sub(times(a, u), times(b, v))[0]
            rows[k, i + 1] = add(times(b, u), times(a, v))[0]
        a, b = cmul((a, b), first)


@jit
def leave_many(out, are_plain, turns, every, units):
    """`turn_rows` for the tops in out (rows, n, 6), then back to the users' units. turns : (n, 4), cos and sin as double-doubles.

    Only tops that `are_plain`, see `many_constants`.
    """
    for top in range(len(are_plain)):
        if are_plain[top]:
            turn = (turns[top, 0], turns[top, 1]), (turns[top, 2], turns[top, 3])
            if turn != NO_TURN:
                turn_rows(out[:, top], turn[0], turn[1], every)
            for row in range(len(out)):
                for k in range(6):
                    out[row, top, k] *= units[top, k]


@unrolled
def gram(s, alpha):
    """The Gram matrix ((a, b, d), (b, e, f), (d, f, g)) of the gradients of H, C1/2 and C2 with J3 fixed, as a, b, d, e, f, g."""
    J1, J2, J3, x1, x2, x3 = s
    jj = J1 * J1 + J2 * J2
    xx = x1 * x1 + x2 * x2
    xj = x1 * J1 + x2 * J2
    return jj + alpha * alpha, alpha * x3, xj + alpha * J3, xx + x3 * x3, xj + x3 * J3, xx + jj + J3 * J3


@unrolled
def adjugate(a, b, d, e, f, g):
    """The adjugate of such a matrix, in the same order, and its determinant."""
    A = e * g - f * f
    B = d * f - b * g
    D = b * f - d * e
    return A, B, D, a * g - d * d, b * d - a * f, a * e - b * b, a * A + (b * B + d * D)


@unrolled
def corrected(s, alpha, r1, r2, r3):
    """The state after one Newton step: the smallest change of J1, J2, x1, x2, x3 that removes the residuals of H, C1/2 and C2.

    On the vertical and at regular precession the gradients are dependent. A small ridge leaves such directions alone. Elsewhere
    it makes the correction 99.99 %, which suffices, because corrections are frequent.
    """
    J1, J2, J3, x1, x2, x3 = s
    a, b, d, e, f, g = gram(s, alpha)
    ridge = RIDGE * (a + (e + g))
    # one division, and not three in a row
    A, B, D, E, F, G, determinant = adjugate(a + ridge, b, d, e + ridge, f, g + ridge)
    r = 1.0 / determinant
    p1 = (A * r1 + B * r2 + D * r3) * r
    p2 = (B * r1 + E * r2 + F * r3) * r
    p3 = (D * r1 + F * r2 + G * r3) * r
    return (
        J1 - (p1 * J1 + p3 * x1),
        J2 - (p1 * J2 + p3 * x2),
        J3,
        x1 - (p2 * x1 + p3 * J1),
        x2 - (p2 * x2 + p3 * J2),
        x3 - (p1 * alpha + p2 * x3 + p3 * J3),
    )


@unrolled
def halves(a):
    """a as a multiple of 2^-25 and a rest. Products of such multiples are exact, and so are their sums below 8."""
    high = (a + GRID) - GRID
    return high, a - high


@jit(inline=True)
def restore_invariants(s, c):
    """Move a state back onto (H, C1, C2), with residuals right to 2^-75.

    With G the gradients, an error e of the state leaves the residuals G e. The smallest change that removes G e is no longer
    than e, even if the gradients are nearly dependent. So the correction is as small as the error, if the residuals are right.
    (In plain doubles their round-off, divided by the least singular value of G, would become an error of the state.) Large sums
    are exact here, and the rest is small.
    """
    J1, J2, J3, x1, x2, x3 = s
    alpha = c[ALPHA]
    (A, a), (B, b), (C, c_) = halves(J1), halves(J2), halves(J3)
    (X, x), (Y, y), (Z, z) = halves(x1), halves(x2), halves(x3)
    W, w = halves(alpha)
    h2 = (((A * A + B * B) + C * C) + 2.0 * (W * Z)) - 2.0 * c[H]
    c1 = ((X * X + Y * Y) + Z * Z) - c[C1]
    c2 = ((X * A + Y * B) + Z * C) - c[C2]
    h2 += ((J1 + A) * a + (J2 + B) * b) + ((J3 + C) * c_ + 2.0 * (W * z + w * x3))
    c1 += ((x1 + X) * x + (x2 + Y) * y) + (x3 + Z) * z
    c2 += ((X * a + x * J1) + (Y * b + y * J2)) + (Z * c_ + z * J3)
    return corrected(s, alpha, 0.5 * h2 - c[H_LO], 0.5 * (c1 - c[C1_LO]), c2 - c[C2_LO])


@jit
def on_torus(s, c, tolerance):
    """Whether a state has the invariants that the constants were computed for."""
    J1, J2, J3, x1, x2, x3 = s
    H_ = 0.5 * (J1 * J1 + J2 * J2 + J3 * J3) + c[ALPHA] * x3
    return (
        abs(H_ - c[H]) <= tolerance
        and abs(2.0 * J3 - c[J3_2]) <= 2.0 * tolerance
        and abs(x1 * x1 + x2 * x2 + x3 * x3 - c[C1]) <= tolerance
        and abs(x1 * J1 + x2 * J2 + x3 * J3 - c[C2]) <= tolerance
    )


@jit
def rows_on_torus(rows, c, tolerance):
    """How many of the first rows are on the torus."""
    for i in range(len(rows)):
        if not on_torus(load_tuple(rows[i], 0, 6), c, tolerance):
            return i
    return len(rows)


@jit
def constants(alpha, y, q, lam, m):
    """The constants of a step. They are computed in double-double and rounded once."""
    c = np.zeros(CONSTANTS)
    R_, eta = lam
    mr, mi = m
    a = dd(alpha)
    J3 = dd(y[2])
    S = add(J3, scale(mul(a, R_), 2.0))  # q = η (J1, J2, S)
    q3 = mul(eta, S)
    c[R] = R_[0]
    c[ETA] = eta[0]
    c[ETA_2] = 2.0 * eta[0]
    c[ETA2] = mul(eta, eta)[0]
    c[ETA_S] = q3[0]
    c[ETA_B] = mul(eta, mul(a, add(mul(R_, R_), mul(eta, eta))))[0]
    c[MR] = mr[0]
    c[MI_ETA] = mul(mi, eta)[0]
    c[MI_Q3] = mul(mi, q3)[0]
    c[MM_Q3] = add(add(mul(mr, mr), mul(mi, mi)), mul(q3, q3))[0]
    c[P3] = add(mul(R_, J3), mul(a, sub(mul(R_, R_), mul(eta, eta))))[0]
    c[ALPHA_2] = 2.0 * alpha
    c[J3_2] = 2.0 * y[2]
    c[ALPHA] = alpha
    c[H], c[H_LO] = scale(q[2], 0.5)
    c[C1], c[C1_LO] = q[0]
    c[C2], c[C2_LO] = scale(q[1], 0.5)
    return c


@jit
def exact_constants(alpha, y, h):
    """Constants for the exact time step h, and (cos, sin) of the turn about e3 after it; see `turn_rows`."""
    q = ts.spectral_polynomial(alpha, y)
    period, angle = (math.inf, 0.0), (dd(1.0), dd(0.0))
    if abs(h) * ts.rate(q) > 1.5:  # half a period is at least π/2 in these units; shorter steps need no period
        q, period, angle = ts.torus(alpha, y, abs(h))
    lam, m, turn = ts.time_step(q, period, angle, h)
    return constants(alpha, y, q, lam, m), turn


NO_TURN = ((1.0, 0.0), (0.0, 0.0))
KERNELS = (step, turning_step, compensated_step)
TINY = 2.0**-40  # for smaller |λ| the increments are few ulps: take `compensated_step`
FAR = 4.0  # for larger |λ|, in units of |x| and |J| + √(|alpha||x|), `turning_step` loses less than `step`
CLOSE = 1e-2  # the same for smaller |m|²/C1, where λ is close to a root of Q


@jit
def form(c):
    """The number in KERNELS of the step that loses least with these constants."""
    if abs(c[R]) + c[ETA] < TINY:
        return 2
    m = c[MI_ETA] / c[ETA]
    if c[MR] * c[MR] + m * m < CLOSE * c[C1] or c[R] * c[R] + c[ETA] * c[ETA] > FAR * FAR:
        return 1
    return 0


@jit
def many_constants(alphas, Y, h, states, c, units, are_plain, turns):
    """Fill arrays for each top: its state and constants in its own units, these units, and its turn, 4 numbers.

    are_plain : whether its kernel is `step`, and nothing of extreme size. Others, a few in a thousand, are left alone.
    """
    for i in range(len(Y)):
        are_plain[i] = False
        y = load_tuple(Y[i], 0, 6)
        rate, length, alpha, span = own_units(alphas[i], y, h)
        if span == math.inf:
            continue
        J, x = math.ldexp(1.0, rate), math.ldexp(1.0, length)
        for k in range(3):
            states[i, k], states[i, k + 3] = y[k] * (1.0 / J), y[k + 3] * (1.0 / x)
            units[i, k], units[i, k + 3] = J, x
        s = load_tuple(states[i], 0, 6)
        constants, turn = exact_constants(alpha, s, span)
        (turns[i, 0], turns[i, 1]), (turns[i, 2], turns[i, 3]) = turn
        for k in range(CONSTANTS):
            c[i, k] = constants[k]
        are_plain[i] = finite(constants) and form(constants) == 0


# ---------------------------------------------------------------- the stepper around a kernel

Turn = tuple[tuple[float, float], tuple[float, float]]  # cos and sin of an angle, as double-doubles
OFF_TORUS = 4e-11  # largest distance of an invariant from the prepared torus, in scaled units, that counts as round-off


class TorusStepper(FixedStepper):
    """A stepper whose constants hold on one torus only. States on another torus are refused.

    turn : (cos, sin) of a turn about e3 that belongs to each step and commutes with the kernel. It is applied to the rows.
    """

    def __init__(self, name: str, h: float, kernel: Kernel, constants: Array, units: Units, turn: Turn = NO_TURN):
        super().__init__(name, h, kernel, constants, units)
        self.turn = turn

    def enter(self, y: Array) -> Array:
        state = super().enter(y)
        if not on_torus(state, self.constants, OFF_TORUS):
            raise StepError(self.name, "the state is not on the torus this step was prepared for", h=self.h)
        return state

    def rows(self, out: Array, every: int) -> Array:
        if self.turn != NO_TURN:
            turn_rows(out[1:], *self.turn, every)
        return super().rows(out, every)


def check_constants(name: str, c: Array, h: float | None = None) -> None:
    if not finite(c):
        raise StepError(name, "no Bäcklund parameter within the range of doubles was found", h=h)
