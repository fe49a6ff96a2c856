"""λ(h) in plain doubles, for steps that are used once or a few times.

It serves short runs of many tops, and splittings with the exact flow, in which every step has another torus. It gives 15 digits
for a small part of the cost of `time_step`, also in SIMD lanes. A long run with one h needs the 32 digits of `time_step`, because
an error of λ is an error of the clock that grows for ever.

The start. T = h and Θ = 0 mean dλ/dh = −m λ̄/(2η). With s = iτ, τ = √C1 h/2, m̂ = m/√C1 and the power series λ = Σ l_k s^k

    dλ/ds = m̂ (E − O)/E,    λ = s (E + O),    with E and O the even and odd part of λ/s.

So the l_k are polynomials in p_k = q_k/q_0, where Q(u) = Σ q_k u^k, with rational coefficients: l_2 = p1/6,
l_3 = p2/6 − p1²/24, … (`series`). With τ^k p_k = P_k, R/τ and η/τ are polynomials in P_1 … P_4. They are used up to the weight
`WEIGHT`. Here λ is in units of τ and m in units of √C1. In these, Q(u) = 1 + P_1 u + P_2 u² + P_3 u³ + P_4 u⁴, and nothing
depends on the caller's units.

Larger times. `double_time` has the formula of `time_step`, with the divisions by N = 2|m|² and by B = N b side by side. For times
beyond half a nutation, ensembles subtract whole nutations (`whole_nutations`).

`ok` says that T has a relative error below 2e-15. It requires that 2|h| is below the nutation period, that |m|² is at least C1/4,
and that the start is in reach. |m| falls towards a double root of Q, next to the separatrix, and for a nearly planar top from
|h| = T_nut/3 on. There the error of T grows like C1/|m|²; take `time_step`. Lengths and rates may have any size from 1e-70 to
1e70. h < 0 takes the inverse map. alpha may have either sign or be 0.

A kernel of one top calls `R, eta, mr, mi, ok = parameter(invariants(s, alpha), s[2], alpha, h)`, then `move`. In SIMD lanes,
`solve` has no branches and takes as many doublings as the top that needs most; `move` has a loop of its own.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling import double_double
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import add, dd, div, mul, scale, sub, times, two_prod
from lagrange_bench.integrators.compiling.expression import Program, sqrt
from lagrange_bench.integrators.compiling.intrinsics import column, put_column
from lagrange_bench.integrators.compiling.lanes import LANES
from lagrange_bench.integrators.compiling.tape import record
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus import time_step as ts
from lagrange_bench.integrators.torus.real_map import ALPHA, CONSTANTS, H
from lagrange_bench.integrators.torus.time_step import nutation_cubic, spectral_polynomial

WEIGHT = 10  # highest weight of the polynomials of the start
REACH = 2.0**-3  # longest time of the start, in units of 1/√max(2H + 2|alpha|√C1, |alpha|√C1)
MOST = 12  # most doublings
LEAST = 1 / 4  # least |m|²/C1 for which T is right to 2e-15

NEAR = 0.05  # least (z1 − z2)/(z1 − z3); next to the separatrix errors grow too fast for plain doubles
VERTICAL = 1e-9  # least (z_p − z2)/(z1 − z3); with J nearer to the vertical, half a revolution per nutation may be lost
NEWTON, AGM = 12, 12  # steps for the largest root of the cubic of nutation, in double, and of the means
PI, PI_LO = 3.141592653589793, 1.2246467991473532e-16

increments, lower_roots = jit(real_map.increments, inline=True), jit(ts.lower_roots, inline=True)
root = jit(double_double.sqrt, inline=True)

Polynomial = dict[tuple[int, int, int, int], Fraction]  # in p1, …, p4 by their exponents


# ---------------------------------------------------------------- the power series


def _times(a: Polynomial, b: Polynomial) -> Polynomial:
    product: Any = Counter()
    for i, u in a.items():
        product.update({tuple(map(operator.add, i, j)): u * v for j, v in b.items()})
    return product


def _sum(*terms: tuple[Fraction | int, Polynomial]) -> Polynomial:
    total: Any = Counter()
    for factor, a in terms:
        total.update({k: factor * v for k, v in a.items()})
    return {k: v for k, v in total.items() if v}


@cache
def series(weight: int) -> list[Polynomial]:
    """a_n of λ/s = Σ a_n s^n, n up to `weight`: l_{n+1} of the docstring."""
    one: Polynomial = {(0, 0, 0, 0): Fraction(1)}
    p: list[Any] = [{tuple(int(i == k) for i in range(4)): Fraction(1)} for k in range(4)]
    a, m = [one], [one]  # of λ/s and of m̂
    powers = [[one] + [{}] * weight, a, [one], [one], [one]]  # of λ/s, by the power
    for n in range(1, weight + 1):
        # s^n in m̂² = 1 + Σ p_k s^k (λ/s)^k, then in E dλ/ds = m̂ (E − O): both are linear in what is new
        square = _sum(*((1, _times(p[k - 1], powers[k][n - k])) for k in range(1, min(n, 4) + 1)))
        m.append(_sum((Fraction(1, 2), square), *((Fraction(-1, 2), _times(m[j], m[n - j])) for j in range(1, n))))
        right = [((-1) ** (n - j), _times(m[j], a[n - j])) for j in range(1, n + 1)]
        left = [(i - n - 1, _times(a[i], a[n - i])) for i in range(2, n, 2)]
        a.append(_sum(*((Fraction(c, n + 1 + n % 2), t) for c, t in (*right, *left))))
        for k in range(2, 5):
            powers[k].append(_sum(*((1, _times(powers[k - 1][i], a[n - i])) for i in range(n + 1))))
    return a


def _horner(a: Polynomial, P, order=(0, 2, 1, 3)):
    """The value of a polynomial, nested: a polynomial in P[order[0]], whose coefficients are polynomials in P[order[1]], …"""
    if not order:
        return float(a[0, 0, 0, 0])
    first, value, power = order[0], None, max(k[order[0]] for k in a)
    for exponent in range(power, -1, -1):
        if value is not None:
            value = value * P[first]
        part: Any = {
            tuple(0 if i == first else e for i, e in enumerate(k)): v for k, v in a.items() if k[first] == exponent
        }
        if part:
            c = _horner(part, P, order[1:])
            value = c if value is None else value + c
    return value


@cache
def _start_program() -> Program:
    """R/τ and η/τ − 1 as formulas in P."""
    a = series(WEIGHT)
    eta: Polynomial = {}
    R: Polynomial = {}
    for n in range(1, WEIGHT + 1):  # i s^n is real for odd n, s^n for even
        part, sign = (R, (-1) ** ((n + 1) // 2)) if n % 2 else (eta, (-1) ** (n // 2))
        part.update({k: sign * v for k, v in a[n].items()})
    return record(lambda *P: (_horner(R, P), _horner(eta, P)), 4)


@unrolled
def start(P):
    """(R, η, Re m, Im m) for the time of the start; m = √Q(λ) with Re m > 0."""
    R, more = _start_program()(*P)  # and η − 1
    eta = 1.0 + more
    t, r = 2.0 * R, R * R + eta * eta
    b3 = P[2] + t * P[3]
    b2 = P[1] + (t * b3 - r * P[3])
    b1 = P[0] + (t * b2 - r * b3)
    re, im = 1.0 + (R * b1 - r * b2), eta * b1  # Q(λ): divided by (u − λ)(u − λ̄)
    mr = sqrt(0.5 * (sqrt(re * re + im * im) + re))
    return R, eta, mr, 0.5 * im / mr


# ---------------------------------------------------------------- doubling the time


@unrolled
def slope(P, z):
    """N = 2|m|², G = Q'(λ) m̄ and B = N b = N Re m + η Im G. B > 0 while twice the time is below T_nut."""
    R, eta, mr, mi = z
    t, r = 2.0 * R, R * R + eta * eta
    b3 = 4.0 * P[3]
    b2 = 3.0 * P[2] + t * b3
    b1 = 2.0 * P[1] + (t * b2 - r * b3)
    re, im = P[0] + (R * b1 - r * b2), eta * b1
    N = 2.0 * (mr * mr + mi * mi)
    G = re * mr + im * mi, im * mr - re * mi
    return N, G, N * mr + eta * G[1]


@unrolled
def double_time(P, z):
    """(R, η, Re m, Im m) for twice the time, and B, which is positive while twice the time is below T_nut; see `time_step`."""
    R, eta, mr, mi = z
    N, G, B = slope(P, z)
    over_b, over_n = 1.0 / B, 1.0 / N
    e = (eta * G[0]) * over_b
    eta2 = eta * eta
    r = N * over_b
    b = mr + (eta * G[1]) * over_n
    f = (P[3] * (eta2 * eta2)) * r
    c = mr + f
    s = sqrt(c * r)
    re = s * (2.0 * (c + f) - b * (1.0 + e * e))
    im = e * (3.0 * c + f) - mi
    return (R - eta * e, 2.0 * (eta * s), re, im), B


@unrolled
def onto_curve(q, R, eta, mr, mi, inverse):
    """m with m² = Q(λ), by one step of Newton's method. q : coefficients of Q. inverse : roughly 1/(2|m|²)."""
    t, r = 2.0 * R, R * R + eta * eta
    b3 = q[3] + t * q[4]
    b2 = q[2] + (t * b3 - r * q[4])
    b1 = q[1] + (t * b2 - r * b3)
    re, im = (q[0] + (R * b1 - r * b2)) - (mr * mr - mi * mi), eta * b1 - 2.0 * mr * mi
    return mr + inverse * (re * mr + im * mi), mi + inverse * (im * mr - re * mi)


# ---------------------------------------------------------------- λ(h) on a torus


@jit(inline=True)
def first_time(q, alpha, h):
    """The time of the start and the number of doublings that reach |h|; MOST + 1 doublings if |h| is too far."""
    weight = abs(alpha) * math.sqrt(q[0])
    t, far, doublings = abs(h), (h * h) * max(q[2] + 2.0 * weight, weight), 0
    while far > REACH * REACH and doublings <= MOST:
        t, far, doublings = 0.5 * t, 0.25 * far, doublings + 1
    return t if doublings <= MOST else 0.0, doublings


@unrolled
def scaled_curve(q, j3, alpha, t):
    """P_1, …, P_4, the unit τ of λ and the unit √C1 of m, for a start with the time t."""
    length = sqrt(q[0])
    weight = (alpha * length) * (t * t)
    P = 0.5 * (q[1] * (t / length)), 0.25 * (q[2] * (t * t)), 0.25 * (weight * (j3 * t)), 0.0625 * (weight * weight)
    return P, 0.5 * (length * t), length


@jit(inline=True)
def verdict(P, z):
    """Whether the time of z is below T_nut/2, and |m| so large that T has 15 digits."""
    N, _, B = slope(P, z)
    return (B > 0.0) & (N >= 2.0 * LEAST)


@unrolled
def invariants(s, alpha):
    """C1, 2 C2 and 2H, which are the coefficients of Q below u³."""
    J1, J2, J3, x1, x2, x3 = s
    c1 = (x1 * x1 + x2 * x2) + x3 * x3
    c2 = (x1 * J1 + x2 * J2) + x3 * J3
    return c1, 2.0 * c2, ((J1 * J1 + J2 * J2) + J3 * J3) + 2.0 * (alpha * x3)


@jit
def parameter(q, j3, alpha, h):
    """(Re λ, Im λ, Re m, Im m, ok) of the exact step over h on the torus of q = (C1, 2 C2, 2H) and J3."""
    t, doublings = first_time(q, alpha, h)
    P, tau, length = scaled_curve(q, j3, alpha, t)
    z, ok = start(P), doublings <= MOST
    for _ in range(min(doublings, MOST)):
        z, B = double_time(P, z)
        ok = ok & (B > 0.0)
    ok = ok & verdict(P, z)
    m = math.copysign(length, h)
    return tau * z[0], tau * z[1], m * z[2], m * z[3], ok


# ---------------------------------------------------------------- the step


@unrolled
def step_constants(alpha, j3, R, eta, mr, mi):
    """The constants of `real_map.constants` that a step needs, in the same order, in plain doubles."""
    q3 = eta * (j3 + (2.0 * alpha) * R)
    rr, ee = R * R, eta * eta
    return (
        R, eta, 2.0 * eta, ee, q3, eta * (alpha * (rr + ee)), mr, mi * eta, mi * q3, (mr * mr + mi * mi) + q3 * q3,
        R * j3 + alpha * (rr - ee), 2.0 * alpha, 2.0 * j3,
    )  # fmt: skip


@jit(inline=True)
def move(s, alpha, lam):
    """The state after one two-point map. lam : (Re λ, Im λ, Re m, Im m)."""
    J1, J2, J3, x1, x2, x3 = s
    d1, d2, e1, e2, e3 = increments(s, step_constants(alpha, J3, lam[0], lam[1], lam[2], lam[3]))
    return J1 + d1, J2 + d2, J3, x1 + e1, x2 + e2, x3 + e3


# ---------------------------------------------------------------- whole nutations

# places in a block of columns for period and turn: the cubic and its largest root; the AGM; terms of the turn
CUBIC, MEANS, TURN, NUTATION = 0, 7 * LANES, 17 * LANES, 22 * LANES


@jit(inline=True)
def largest_root(c0, c1, c2, z):
    """The largest root of the cubic of nutation, improved from one that is right in double, and the size of the correction."""
    f = add(times(add(times(add(dd(2.0 * z), c2), z), c1), z), c0)
    step = f[0] / ((6.0 * z + 2.0 * c2[0]) * z + c1[0])
    return add(dd(z), dd(-step)), abs(step)


@jit(inline=True)
def first_means(alpha, s, c1, c2, z1):
    """The first a, g, p, Q and Σ Q_n of `whole_nutations`; the terms of the turn; z1 − z2, z1 − z3 and z_p − z2."""
    J1, J2, J3, x1, x2, x3 = s
    z2, z3 = lower_roots(c1, c2, z1)
    pole = scale(add(two_prod(J1, J1), two_prod(J2, J2)), 0.5)
    residue = sub(mul(dd(alpha), add(two_prod(x1, J1), two_prod(x2, J2))), mul(dd(J3), pole))
    near, far, close, wide = sub(pole, z2), sub(pole, z3), sub(z1, z2), sub(z1, z3)
    a, g = root(scale(wide, 0.5)), root(scale(close, 0.5))
    p = mul(a, root(div(near, far)))
    share = scale(div(residue, far), 0.25), div(sub(z2, z3), near)
    return (*a, *g, *p, 1.0, 0.0, 1.0, 0.0), (*share[0], *share[1]), close[0], wide[0], near[0]


@jit(inline=True)
def next_means(now):
    a, g, p, Q, total = (now[0], now[1]), (now[2], now[3]), (now[4], now[5]), (now[6], now[7]), (now[8], now[9])
    ag, pp = mul(a, g), mul(p, p)
    above = add(pp, ag)
    Q = scale(mul(Q, div(sub(pp, ag), above)), 0.5)
    return (*scale(add(a, g), 0.5), *root(ag), *scale(div(above, p), 0.5), *Q, *add(total, Q))


@jit
def whole_nutations(work, nutation):
    """Subtract the nearest number of nutations from the span in `work`, and halve a rest of more than a quarter of one.

    `nutation` gets the turn of the subtracted nutations in revolutions, the number of parts of the rest, and 1 if all is well.

    Let z = alpha x3, z_p = H − J3²/2 (where J is vertical) and D = alpha C2 − J3 z_p. The azimuth of J has the rate
    J3/2 + D/(2(z_p − z)). So period and turn of a nutation are complete elliptic integrals of the first and third kind,

        T = π/M,    P = T (J3/2 + D (2 + (z2 − z3)/(z_p − z2) Σ Q_n)/(4 (z_p − z3))),    M = agm(a_0, g_0)

    with DLMF 19.8.7-8: a_0² = (z1 − z3)/2, g_0² = (z1 − z2)/2, p_0² = a_0² (z_p − z2)/(z_p − z3), Q_0 = 1 and

        p_{n+1} = (p_n² + a_n g_n)/(2 p_n)        Q_{n+1} = Q_n (p_n² − a_n g_n)/(2 (p_n² + a_n g_n)).

    All is in double-double, because an error is repeated with every nutation.
    """
    for j in range(LANES):
        s, alpha = column(work, STATE + j, 6, LANES), work[GIVEN + j]
        c0, c1, c2 = nutation_cubic(alpha, s)
        length = math.sqrt((s[3] * s[3] + s[4] * s[4]) + s[5] * s[5])
        # z1 + z2 + z3 = H, and z2 and z3 are at least −|alpha x|
        z = 0.5 * ((s[0] * s[0] + s[1] * s[1]) + s[2] * s[2]) + 2.0 * (abs(alpha) * length)
        put_column(nutation, CUBIC + j, (*c0, *c1, *c2, z), LANES)
    for _ in range(NEWTON):  # falls onto z1 from the right
        for j in range(LANES):
            c0, _, c1, _, c2, _, z = column(nutation, CUBIC + j, 7, LANES)
            z -= (((2.0 * z + c2) * z + c1) * z + c0) / ((6.0 * z + 2.0 * c2) * z + c1)
            put_column(nutation, CUBIC + 6 * LANES + j, (z,), LANES)
    for j in range(LANES):
        c = column(nutation, CUBIC + j, 7, LANES)
        c1, c2 = (c[2], c[3]), (c[4], c[5])
        z1, step = largest_root((c[0], c[1]), c1, c2, c[6])
        first, kept, close, wide, near = first_means(work[GIVEN + j], column(work, STATE + j, 6, LANES), c1, c2, z1)
        put_column(nutation, MEANS + j, first, LANES)
        good = 1.0 if (step <= 1e-12 * close) & (close >= NEAR * wide) & (near >= VERTICAL * wide) else 0.0
        put_column(nutation, TURN + j, (*kept, good), LANES)
    for _ in range(AGM):
        for j in range(LANES):
            put_column(nutation, MEANS + j, next_means(column(nutation, MEANS + j, 10, LANES)), LANES)
    for j in range(LANES):
        a, a_lo, g, g_lo, _, _, Q, _, total, total_lo = column(nutation, MEANS + j, 10, LANES)
        share, share_lo, ratio, ratio_lo, good = column(nutation, TURN + j, 5, LANES)
        J3, span = work[STATE + 2 * LANES + j], work[GIVEN + LANES + j]
        over = div(dd(0.5), scale(add((a, a_lo), (g, g_lo)), 0.5))  # 1/(2M)
        period = mul((2.0 * PI, 2.0 * PI_LO), over)
        more = add(dd(2.0), mul((ratio, ratio_lo), (total, total_lo)))
        turn = mul(add(dd(0.5 * J3), mul((share, share_lo), more)), over)
        number = np.rint(span / period[0])
        rest = sub(dd(span), mul(period, dd(number)))[0]
        angle = mul(turn, dd(number))
        angle = add(angle, dd(-np.rint(angle[0])))
        good = good if (abs(a - g) <= 1e-10 * a) & (abs((share * ratio) * Q) <= 1e-20) else 0.0
        parts = 2.0 if abs(rest) > 0.25 * period[0] else 1.0
        put_column(work, GIVEN + LANES + j, (rest / parts,), LANES)
        put_column(nutation, TURN + j, (*angle, parts, good), LANES)


# ---------------------------------------------------------------- many tops

# places in a block of columns: state; alpha, h and first time; doublings left, 1 if all is well; z; P, τ, √C1; the constants
STATE, GIVEN, LEFT, POINT, CURVE, FOUND = 0, 6 * LANES, 9 * LANES, 11 * LANES, 15 * LANES, 21 * LANES
INVARIANTS, END = FOUND + H * LANES, FOUND + CONSTANTS * LANES
HALVES = len(real_map.KERNELS)  # stands for the first kernel, taken twice in a step


@jit
def solve(work, most):
    """Compute λ(h) and the constants of a step in each lane, for the h in `work`, with at most `most` doublings."""
    for j in range(LANES):
        s, (alpha, _, t) = column(work, STATE + j, 6, LANES), column(work, GIVEN + j, 3, LANES)
        (c1, c1_lo), (c2, c2_lo), (h2, h2_lo), _, _ = spectral_polynomial(alpha, s)
        P, tau, length = scaled_curve((c1, c2, h2), s[2], alpha, t)
        put_column(work, POINT + j, (*start(P), *P, tau, length), LANES)
        put_column(work, INVARIANTS + j, (0.5 * h2, c1, 0.5 * c2, 0.5 * h2_lo, c1_lo, 0.5 * c2_lo), LANES)
    for k in range(most):
        for j in range(LANES):
            (left, fine), z = column(work, LEFT + j, 2, LANES), column(work, POINT + j, 4, LANES)
            y, B = double_time(column(work, CURVE + j, 4, LANES), z)
            more = k < left
            fine = fine if B > 0.0 or not more else 0.0
            z = y[0] if more else z[0], y[1] if more else z[1], y[2] if more else z[2], y[3] if more else z[3]
            put_column(work, LEFT + j, (left, fine, *z), LANES)
    for j in range(LANES):
        z, P = column(work, POINT + j, 4, LANES), column(work, CURVE + j, 4, LANES)
        (left, fine), (tau, length) = column(work, LEFT + j, 2, LANES), column(work, CURVE + 4 * LANES + j, 2, LANES)
        J3, (alpha, span) = work[STATE + 2 * LANES + j], column(work, GIVEN + j, 2, LANES)
        fine = fine if verdict(P, z) else 0.0
        mr, mi = onto_curve((1.0, *P), *z, 0.5 / (z[2] * z[2] + z[3] * z[3]))  # halves the error of a run
        m = math.copysign(length, span)
        put_column(work, FOUND + j, step_constants(alpha, J3, tau * z[0], tau * z[1], m * mr, m * mi), LANES)
        put_column(work, LEFT + j, (left, fine), LANES)
        put_column(work, FOUND + ALPHA * LANES + j, (alpha,), LANES)


@jit(inline=True)
def turn_by(angle, turns, i):
    """Put cos and sin of an angle (in revolutions) into turns[i], with length 1 to twice the digits, lest steps scale."""
    full, rest = mul(angle, (2.0 * PI, 2.0 * PI_LO))
    c, s = math.cos(full), math.sin(full)
    c, s = c - s * rest, s + c * rest
    too_long = 0.5 * sub(add(two_prod(c, c), two_prod(s, s)), dd(1.0))[0]
    turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = c, -c * too_long, s, -s * too_long


@jit
def many_plain_constants(alphas, Y, h, states, c, units, forms, turns):
    """`real_map.many_constants`, with λ(h) in plain doubles if that is good enough.

    First h itself is tried. Tops for which it is too long are taken again, after subtracting whole nutations, whose turn goes
    into `turns`. If more than a quarter of a nutation is left, the step is taken in two halves, and the number in `forms` is
    HALVES.

    The loops over the lanes of a block of tops are SIMD code. No bit of a top depends on its lane or its neighbours.
    """
    work, nutation = np.ones(END), np.ones(NUTATION)
    waiting, given = np.empty(len(Y), np.int64), np.empty((len(Y), 2))
    count = 0
    for i in range(len(Y)):
        forms[i] = -1
        given[i, 0], given[i, 1] = real_map.enter(alphas, Y, h, i, states, units)
        if given[i, 1] != math.inf:
            waiting[count] = i
            count += 1
    for again in (False, True):
        left = 0
        for first in range(0, count, LANES):
            tops = waiting[first : min(first + LANES, count)].copy()
            for j in range(len(tops)):
                i = tops[j]
                s = states[i, 0], states[i, 1], states[i, 2], states[i, 3], states[i, 4], states[i, 5]
                put_column(work, STATE + j, (*s, given[i, 0], given[i, 1]), LANES)
            if again:
                whole_nutations(work, nutation)
            most = 0
            for j in range(len(tops)):
                s, (alpha, span) = column(work, STATE + j, 6, LANES), column(work, GIVEN + j, 2, LANES)
                t, doublings = first_time(invariants(s, alpha), alpha, span)
                most = max(most, doublings)
                put_column(work, GIVEN + 2 * LANES + j, (t, float(doublings), 1.0), LANES)
            solve(work, most)
            for j in range(len(tops)):
                i, own = tops[j], column(work, FOUND + j, CONSTANTS, LANES)
                good = work[LEFT + LANES + j] != 0.0 and work[LEFT + j] <= MOST
                turn, turn_lo, parts, fine = 0.0, 0.0, 1.0, 1.0
                if again:
                    turn, turn_lo, parts, fine = column(nutation, TURN + j, 4, LANES)
                form = real_map.form(own)
                if good and fine != 0.0 and form != 1:
                    for k in range(CONSTANTS):
                        c[i, k] = own[k]
                    turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = 1.0, 0.0, 0.0, 0.0
                    if turn != 0.0:
                        turn_by((turn, turn_lo), turns, i)
                    forms[i] = HALVES if parts == 2.0 else form
                elif again:
                    real_map.set_up(given[i, 0], given[i, 1], i, states, c, forms, turns)
                else:
                    waiting[left] = i
                    left += 1
        count = left
