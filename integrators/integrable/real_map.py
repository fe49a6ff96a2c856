"""The two-point map in its real, pole-free form, compiled: what a step of `methods.backlund` does.

With the point (λ, m) of the curve m² = Q(λ), λ = R + iη, and a(λ) = x + λJ + λ² alpha e3 = p + iq:

    w = 2η (Re m p + Im m q − p×q)/(|m|² + |p|² + |q|²),   |w| = η                       `direction`
    J̃ = J + 2 alpha e3 × w        x̃ = x + R (J̃ − J) + (J + J̃) × w                       `step`

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
def direction(s, c):
    """w, the vector about which the step turns; |w| = η."""
    J1, J2, J3, x1, x2, x3 = s
    p1 = x1 + c[R] * J1
    p2 = x2 + c[R] * J2
    p3 = x3 + c[P3]
    n = c[MM_Q3] + ((p1 * p1 + p2 * p2) + p3 * p3) + c[ETA2] * (J1 * J1 + J2 * J2)
    r = c[ETA_2] / n
    z = c[ETA] * x3 - c[ETA_B]
    w1 = ((c[MR] * p1 + c[MI_ETA] * J1) - (c[ETA_S] * x2 - z * J2)) * r
    w2 = ((c[MR] * p2 + c[MI_ETA] * J2) + (c[ETA_S] * x1 - z * J1)) * r
    w3 = ((c[MR] * p3 + c[MI_Q3]) - c[ETA] * (x1 * J2 - x2 * J1)) * r
    return w1, w2, w3


@jit
def step(s, c, tally):
    """One two-point map, for |λ| of order one or less."""
    J1, J2, J3, x1, x2, x3 = s
    w1, w2, w3 = direction(s, c)
    d1 = -c[ALPHA_2] * w2
    d2 = c[ALPHA_2] * w1
    K1 = J1 + d1
    K2 = J2 + d2
    s1 = J1 + K1
    s2 = J2 + K2
    y1 = x1 + (c[R] * d1 + (s2 * w3 - c[J3_2] * w2))
    y2 = x2 + (c[R] * d2 + (c[J3_2] * w1 - s1 * w3))
    y3 = x3 + (s1 * w2 - s2 * w1)
    return K1, K2, J3, y1, y2, y3


@jit
def long_direction(s, c):
    """w once more, made exactly as long as η: where p, q and m vanish together, its denominator has no digits left."""
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
    # Gram matrix ((a, b, d), (b, e, f), (d, f, g)) and its LDLᵀ solve
    a = jj + alpha * alpha
    b = alpha * x3
    d = xj + alpha * J3
    e = xx + x3 * x3
    f = xj + x3 * J3
    g = xx + jj + J3 * J3
    ridge = RIDGE * (a + e + g)
    a += ridge
    e += ridge
    g += ridge
    l1 = b / a
    l2 = d / a
    e -= l1 * b
    f -= l1 * d
    g -= l2 * d
    l3 = f / e
    g -= l3 * f
    r2 -= l1 * r1
    r3 -= l2 * r1 + l3 * r2
    p3 = r3 / g
    p2 = r2 / e - l3 * p3
    p1 = r1 / a - l1 * p2 - l2 * p3
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
    q, period, angle = ts.torus(alpha, y, abs(h))
    lam, m, rotation = ts.time_step(q, period, angle, h)
    return constants(alpha, y, q, lam, m, rotation), abs(h) > 0.5 * period[0]


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
