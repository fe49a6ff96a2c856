"""λ(h) in plain doubles, for splittings with the exact flow, in which every step has another torus.

It gives 15 digits for a small part of the cost of `time_step`. A long run with one h needs the 32 digits of `time_step`, because
an error of λ is an error of the clock that grows for ever.

The start. T = h and Θ = 0 mean dλ/dh = −m λ̄/(2η). With s = iτ, τ = √C1 h/2, m̂ = m/√C1 and the power series λ = Σ l_k s^k

    dλ/ds = m̂ (E − O)/E,    λ = s (E + O),    with E and O the even and odd part of λ/s.

The l_k come one by one from the numbers p_k = q_k/q_0, where Q(u) = Σ q_k u^k (`series`): l_2 = p1/6, l_3 = p2/6 − p1²/24, …
Here λ is in units of τ and m in units of √C1. In these, s = i and Q(u) = 1 + P_1 u + P_2 u² + P_3 u³ + P_4 u⁴, P_k = τ^k p_k,
and nothing depends on the caller's units.

Larger times. `double_time` has the formula of `time_step`, with the divisions by N = 2|m|² and by B = N b side by side.

`ok` says that T has a relative error below 2e-15. It requires that 2|h| is below the nutation period, that |m|² is at least C1/4,
and that the start is in reach. |m| falls towards a double root of Q, next to the separatrix, and for a nearly planar top from
|h| = T_nut/3 on. There the error of T grows like C1/|m|²; take `time_step`. Lengths and rates may have any size from 1e-70 to
1e70. h < 0 takes the inverse map. alpha may have either sign or be 0.

A kernel calls `R, eta, mr, mi, ok = parameter(invariants(s, alpha), s[2], alpha, h)`, then `move`.
"""

import math
from operator import mul

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import sqrt
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.torus import real_map

# terms of the power series of the start
TERMS = 11
# longest time of the start, in units of 1/√max(2H + 2|alpha|√C1, |alpha|√C1)
REACH = 2.0**-3
# most doublings
MOST = 12
# least |m|²/C1 for which T is right to 2e-15
LEAST = 1 / 4

increments = jit(real_map.increments, inline=True)

# ---------------------------------------------------------------- the power series


def cauchy(a, b):
    """Σ a_i b_(n−i), the last coefficient of the product of two power series of n + 1 terms."""
    first, *others = map(mul, a, reversed(b))
    return sum(others, first)


def series(P):
    """a_n of λ/s = Σ a_n s^n."""
    a, m = [1.0], [1.0]  # of λ/s and of m̂
    powers = [[1.0], a, [1.0], [1.0], [1.0]]  # of λ/s, by the power
    for n in range(1, TERMS):
        # s^n in m̂² = 1 + Σ P_k s^k (λ/s)^k, then in E dλ/ds = m̂ (E − O): both are linear in what is new
        degree = min(n, 4)
        square = cauchy(P[:degree], [powers[k][n - k] for k in range(degree, 0, -1)])
        if n > 1:
            square -= cauchy(m[1:], m[1:])
        m.append(0.5 * square)
        total = cauchy(m[1:], [-c if i % 2 else c for i, c in enumerate(a)])
        for i in range(2, n, 2):
            total -= (n + 1 - i) * (a[i] * a[n - i])
        a.append(total * (1 / (n + 1 + n % 2)))
        for k in (2, 3, 4):
            powers[k].append(cauchy(powers[k - 1], a))
    return a


def alternating(a):
    """a_0 − a_1 + a_2 − …, the last and smallest terms first."""
    total = a[-1]
    for c in a[-2::-1]:
        total = c - total
    return total


@unrolled
def start(P):
    """(R, η, Re m, Im m) for the time of the start; m = √Q(λ) with Re m > 0."""
    a = series(P)
    R, eta = -alternating(a[1::2]), alternating(a[::2])  # s = i
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


# ---------------------------------------------------------------- λ(h) on a torus


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
    length = math.sqrt(q[0])
    weight = abs(alpha) * length
    t, far, doublings = abs(h), (h * h) * max(q[2] + 2.0 * weight, weight), 0
    while far > REACH * REACH and doublings <= MOST:
        t, far, doublings = 0.5 * t, 0.25 * far, doublings + 1
    if doublings > MOST:
        t = 0.0
    weight = (alpha * length) * (t * t)
    P = 0.5 * (q[1] * (t / length)), 0.25 * (q[2] * (t * t)), 0.25 * (weight * (j3 * t)), 0.0625 * (weight * weight)
    z, ok = start(P), doublings <= MOST
    for _ in range(min(doublings, MOST)):
        z, B = double_time(P, z)
        ok = ok & (B > 0.0)
    N, _, B = slope(P, z)
    ok = ok & (B > 0.0) & (N >= 2.0 * LEAST)  # the time is below T_nut/2, and |m| so large that T has 15 digits
    tau, m = 0.5 * (length * t), math.copysign(length, h)  # the units of λ and m
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
