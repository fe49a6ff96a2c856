"""The two-point map in its real, pole-free form, compiled: what a step of `methods.backlund` does.

With the point (λ, m) of the curve m² = Q(λ), λ = R + iη, and a(λ) = x + λJ + λ² alpha e3 = p + iq:

    w = 2η (Re m p + Im m q − p×q)/(|m|² + |p|² + |q|²),   |w| = η
    J̃ = J + 2 alpha e3 × w        x̃ = x + R (J̃ − J) + (J + J̃) × w

The denominator vanishes only at the unstable sleeping top with λ on the double root of Q; see `long_direction`.
States are in units that make |x| and |J| + √(|alpha||x|) of order one. The constants of a torus and a step are one array.
"""

from __future__ import annotations

import math

import numpy as np

from integrators.compiled import jit
from integrators.integrable import attitude as at
from integrators.integrable import time_step as ts
from integrators.integrable.double_double import add, dd, mul, scale, sub

# places of the constants
R, ETA, ETA_2, ETA2, ETA_S, ETA_B, MR, MI_ETA, MI_Q3, MM_Q3, P3, ALPHA_2, J3_2 = range(13)
COS, SIN, ALPHA, H, C1, C2, H_LO, C1_LO, C2_LO = range(13, 22)

RIDGE = 2.0**-14  # see `pin`


@jit
def step(s, c, tally):
    """One two-point map, for |λ| of order one or less.

    With w = r u the new state is a polynomial in r = 2η/n whose coefficients are ready when the division is. The
    longest chain from state to state is five additions, three products and one division.
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
        J1 - r * v2,
        J2 + r * v1,
        J3,
        x1 + r * (y1 + r * (v1 * u3)),
        x2 + r * (y2 + r * (v2 * u3)),
        x3 + r * (y3 - r * (v1 * u1 + v2 * u2)),
    )


@jit
def long_direction(s, c):
    """w made exactly as long as η: where p, q and m vanish together, the denominator above has no digits left."""
    J1, J2, J3, x1, x2, x3 = s
    p3 = x3 + c[P3]
    z = c[ETA] * x3 - c[ETA_B]
    n1 = (c[MR] * (x1 + c[R] * J1) + c[MI_ETA] * J1) - (c[ETA_S] * x2 - z * J2)
    n2 = (c[MR] * (x2 + c[R] * J2) + c[MI_ETA] * J2) + (c[ETA_S] * x1 - z * J1)
    n3 = (c[MR] * p3 + c[MI_Q3]) - c[ETA] * (x1 * J2 - x2 * J1)
    n = math.sqrt(n1 * n1 + n2 * n2 + n3 * n3)
    if n > 0.0:
        r = c[ETA] / n
        return n1 * r, n2 * r, n3 * r
    return 0.0, 0.0, c[ETA]  # the unstable sleeping top with λ the root itself: about the vertical


@jit
def turning_step(s, c, tally):
    """The same map with w made exactly long and x turned about it; half as dear again.

    For large |λ|, where the increments of x would cancel, and for λ close to a root of Q.
    """
    J1, J2, J3, x1, x2, x3 = s
    w1, w2, w3 = long_direction(s, c)
    f = 2.0 / (c[R] * c[R] + (w1 * w1 + w2 * w2 + w3 * w3))  # exactly orthogonal, whatever the rounding of w
    v1 = w2 * x3 - w3 * x2
    v2 = w3 * x1 - w1 * x3
    v3 = w1 * x2 - w2 * x1
    y1 = x1 + f * ((w2 * v3 - w3 * v2) + c[R] * v1)
    y2 = x2 + f * ((w3 * v1 - w1 * v3) + c[R] * v2)
    y3 = x3 + f * ((w1 * v2 - w2 * v1) + c[R] * v3)
    return J1 - c[ALPHA_2] * w2, J2 + c[ALPHA_2] * w1, J3, y1, y2, y3


@jit
def rotate(s, c):
    """Turn J and x about e3: what whole nutations amount to."""
    J1, J2, J3, x1, x2, x3 = s
    a, b = c[COS], c[SIN]
    return a * J1 - b * J2, b * J1 + a * J2, J3, a * x1 - b * x2, b * x1 + a * x2, x3


@jit
def step_and_turn(s, c, tally):
    return rotate(step(s, c, tally), c)


@jit
def turning_step_and_turn(s, c, tally):
    return rotate(turning_step(s, c, tally), c)


@jit
def turn(s, c, tally):
    return rotate(s, c)


@jit
def pin(s, c):
    """Back onto (H, C1, C2) by the smallest change of J1, J2, x1, x2, x3: one Newton step.

    The Gram matrix of the gradients is singular at regular precession and on the vertical, and nearly so close to
    them, where a residual of one ulp would be answered by a correction of many. A small ridge leaves such directions
    alone; pins are frequent, so elsewhere nothing is lost by correcting 99.99 % at a time.
    """
    J1, J2, J3, x1, x2, x3 = s
    alpha = c[ALPHA]
    jj = J1 * J1 + J2 * J2
    xx = x1 * x1 + x2 * x2
    xj = x1 * J1 + x2 * J2
    # residuals of H, C1/2, C2
    r1 = (0.5 * (jj + J3 * J3) + alpha * x3 - c[H]) - c[H_LO]
    r2 = 0.5 * ((xx + x3 * x3 - c[C1]) - c[C1_LO])
    r3 = (xj + x3 * J3 - c[C2]) - c[C2_LO]
    # Gram matrix ((a, b, d), (b, e, f), (d, f, g)) and its adjoint, for one division and not three in a row
    a = jj + alpha * alpha
    b = alpha * x3
    d = xj + alpha * J3
    e = xx + x3 * x3
    f = xj + x3 * J3
    g = xx + jj + J3 * J3
    ridge = RIDGE * (a + (e + g))
    a += ridge
    e += ridge
    g += ridge
    A = e * g - f * f
    B = d * f - b * g
    D = b * f - d * e
    E = a * g - d * d
    F = b * d - a * f
    G = a * e - b * b
    r = 1.0 / (a * A + (b * B + d * D))
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


@jit
def on_torus(s, c, tolerance):
    """Whether the invariants of a state are those the constants were made for."""
    J1, J2, J3, x1, x2, x3 = s
    H_ = 0.5 * (J1 * J1 + J2 * J2 + J3 * J3) + c[ALPHA] * x3
    return (
        abs(H_ - c[H]) <= tolerance
        and abs(2.0 * J3 - c[J3_2]) <= 2.0 * tolerance
        and abs(x1 * x1 + x2 * x2 + x3 * x3 - c[C1]) <= tolerance
        and abs(x1 * J1 + x2 * J2 + x3 * J3 - c[C2]) <= tolerance
    )


@jit
def constants(alpha, y, q, lam, m, rotation):
    """The constants of a step, computed in double-double and rounded once."""
    c = np.zeros(22)
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
    c[COS], c[SIN] = rotation[0][0], rotation[1][0]
    c[ALPHA] = alpha
    c[H], c[H_LO] = scale(q[2], 0.5)
    c[C1], c[C1_LO] = q[0]
    c[C2], c[C2_LO] = scale(q[1], 0.5)
    return c


@jit
def exact_constants(alpha, y, h):
    """Constants for the exact time step h, and whether the rotation is needed."""
    q = ts.spectral_polynomial(alpha, y)
    period, angle = (math.inf, 0.0), (dd(1.0), dd(0.0))
    if abs(h) * ts.rate(q) > 1.5:  # half a period is at least π/2 of these units, and needs no period below that
        q, period, angle = ts.torus(alpha, y, abs(h))
    lam, m, rotation = ts.time_step(q, period, angle, h)
    return constants(alpha, y, q, lam, m, rotation), abs(h) > 0.5 * period[0]


KERNELS = (step, step_and_turn, turning_step, turning_step_and_turn, turn)
FAR = 4.0  # |λ|, in units of |x| and |J| + √(|alpha||x|), from which `turning_step` loses less than `step`
CLOSE = 1e-2  # |m|²/C1 below which it does so too: λ is close to a root of Q


@jit
def form(c, turns):
    """Number in KERNELS of the step that loses least with these constants, with or without the rotation after it."""
    if c[ETA] == 0.0:
        return 4
    m = c[MI_ETA] / c[ETA]
    if c[MR] * c[MR] + m * m < CLOSE * c[C1] or c[R] * c[R] + c[ETA] * c[ETA] > FAR * FAR:
        return 3 if turns else 2
    return 1 if turns else 0


@jit
def exponents(alpha, y, h):
    """Powers of two that bring |x|, and |J| + √(|alpha||x|) or, where that is 0, 1/|h| to between 1/2 and 1."""
    J, rate = scaled_norm(y[0], y[1], y[2])
    x, length = scaled_norm(y[3], y[4], y[5])
    a, weight = math.frexp(abs(alpha))
    weight += length
    root = math.sqrt(math.ldexp(a * x, weight & 1))
    weight >>= 1
    if J == 0.0 and root == 0.0:
        return -math.frexp(h)[1], length
    if J == 0.0 or (root > 0.0 and weight > rate):
        J, root, rate, weight = root, J, weight, rate
    size, more = math.frexp(J + math.ldexp(root, weight - rate))
    return rate + more, length


@jit
def scaled_norm(a, b, c):
    """|(a, b, c)| as a number from 1/2 to 1 and a power of two; 0, 0 of nothing."""
    power = math.frexp(max(abs(a), abs(b), abs(c)))[1]
    a, b, c = math.ldexp(a, -power), math.ldexp(b, -power), math.ldexp(c, -power)
    norm, more = math.frexp(math.sqrt(a * a + b * b + c * c))
    return norm, power + more


LARGEST_SPAN = 1e15  # of |h|, in time scales of the top: beyond it the phase has no digits left
MODERATE = 1000  # of the powers of two of the units: then they are doubles themselves


@jit
def many_constants(alphas, Y, h, states, c, units, forms):
    """For each top its state and constants in its own units, these units, and the number of its kernel.

    −1 for a top of extreme size, step or constants, which is left alone.
    """
    for i in range(len(Y)):
        forms[i] = -1
        y = (Y[i, 0], Y[i, 1], Y[i, 2], Y[i, 3], Y[i, 4], Y[i, 5])
        rate, length = exponents(alphas[i], y, h)
        span, alpha = math.ldexp(h, rate), math.ldexp(alphas[i], length - 2 * rate)
        if max(abs(rate), abs(length)) >= MODERATE or not abs(span) < LARGEST_SPAN:
            continue
        for k in range(6):
            states[i, k] = math.ldexp(y[k], -(rate if k < 3 else length))
            units[i, k] = math.ldexp(1.0, rate if k < 3 else length)
        s = (states[i, 0], states[i, 1], states[i, 2], states[i, 3], states[i, 4], states[i, 5])
        own, turns = exact_constants(alpha, s, span)
        finite = True
        for k in range(len(own)):
            c[i, k] = own[k]
            finite = finite and math.isfinite(own[k])
        if finite:
            forms[i] = form(own, turns)


@jit
def many_jumps(alphas, Y, times, out, done):
    """`time_step.flow` for each top, in its own units; `done` is False for a top of extreme size or times."""
    longest = 0.0
    for t in times:
        longest = max(longest, abs(t))
    spans = np.empty(len(times))
    for i in range(len(Y)):
        y = (Y[i, 0], Y[i, 1], Y[i, 2], Y[i, 3], Y[i, 4], Y[i, 5])
        rate, length = exponents(alphas[i], y, longest if longest > 0.0 else 1.0)
        done[i] = max(abs(rate), abs(length)) < MODERATE and math.ldexp(longest, rate) < LARGEST_SPAN
        if not done[i]:
            continue
        for k in range(len(times)):
            spans[k] = math.ldexp(times[k], rate)
        J, x = math.ldexp(1.0, -rate), math.ldexp(1.0, -length)
        s = (y[0] * J, y[1] * J, y[2] * J, y[3] * x, y[4] * x, y[5] * x)
        found = ts.flow(math.ldexp(alphas[i], length - 2 * rate), s, spans)
        for k in range(len(times)):
            for j in range(6):
                out[k, i, j] = y[j] if times[k] == 0.0 else math.ldexp(found[k, j], rate if j < 3 else length)


@jit
def attitude_loop(s, g, c, spin, steps, block):
    """(state, attitude) after so many steps; pinned before every `block` of them."""
    tally = np.zeros(5)
    for i in range(steps):
        if i % block == 0:
            s = pin(s, c)
        g = at.turn_with(g, (s[3], s[4], s[5]), c[R], long_direction(s, c), spin)
        s = turning_step(s, c, tally)
    return s, g
