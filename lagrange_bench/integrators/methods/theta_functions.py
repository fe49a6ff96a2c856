"""The closed-form solution from theta functions, compiled. It is evaluated at each time; no state is carried from step to step.

Let m = J3, l = x·J, s = |x| and ζ = alpha (x3(t) − x3(0)). Then ζ'² = 2 (ζ − ζ1)(ζ − ζ2)(ζ − ζ3), and ζ goes to and fro between
ζ3 and ζ2. The solution is ζ = ζ3 + (ζ2 − ζ3) sn²(w, k) with w = κ (t − t0), κ² = (ζ1 − ζ3)/2 and k² = (ζ2 − ζ3)/(ζ1 − ζ3). Three
quantities are linear in ζ,

    |J+|² = 2 (ζ_J − ζ)     |A|² = s − x3 = (ζ_A − ζ)/alpha     |B|² = s + x3 = (ζ − ζ_B)/alpha     ζ_B ≤ ζ3, ζ2 ≤ ζ_J, ζ_A ≤ ζ1

and J+ = F_J e^{i(ψ + m (t − t0)/2)}, x+ = i F_A F_B e^{iψ}. The F have these moduli, and (arg F)' = alpha D/|ζ_F − ζ| with

    D_J = (l − m x_J)/2 (x_J: where J+ would vanish)     D_A = (m s − l)/2     D_B = (m s + l)/2.

Hence F = const e^{iλ(t − t0)} θ2(v − iσβ)/θ4(v) for F_J and F_A, and with θ1 in place of θ2 for F_B. Here v = πw/2K and σ = sign
D. β belongs to w = K + iη or iη, where ζ = ζ_F. For k² > 1/2 the functions of the complementary modulus are used (Jacobi's
imaginary transformation), which are regular on the separatrix: θ4(σb + iV)/θ2(iV) and −i θ1(σb + iV)/θ2(iV), V = πw/2K',
b = πη/2K'. Either way the nome is at most e^−π, and four terms are enough. Poles of the axis and zeros of J+ are zeros of entire
functions.

The period, and the precession in it (a complete integral of the third kind), come from the arithmetic-geometric mean. They are
double-doubles, computed with + − × ÷ √ alone. Whole periods are subtracted from t before anything is rounded. The rest is in
doubles: errors stay at round-off for any t, up to the conditioning of the orbit itself.

This is a formula and no stepping kernel, so it may call sin, cos and exp. A step is one evaluation, at t = n h from the start of
the run; `evaluate` takes any times. The truth by which methods are judged, `truth.exact`, doubles points of a
curve. It shares nothing with this file.

Sources: Whittaker, Analytical Dynamics, sections 71-72; Jacobi, Werke 2 (1882) 477; DLMF 19.8.7-8, 19.25, 20.7.30-33, 22.2.
"""

from __future__ import annotations

import math

import numpy as np

from lagrange_bench.integrators.checks import as_state
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import add, dd, div, mul, neg, scale, sqrt, sub, two_prod
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import store_tuple
from lagrange_bench.integrators.compiling.loops import FAILURE, MEMORY, FixedStepper, Kernel
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.closed_body import BodyStepper, closed_form
from lagrange_bench.integrators.methods.lie_group import add as add_vector
from lagrange_bench.integrators.methods.lie_group import cross, times
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus.time_step import TWO_PI, largest_root, period_and_turn

# places of the constants
KIND, H, TIME_0, PERIOD, PERIOD_LO, TURN, TURN_LO, CLOCK, BARRIER, NOME, SIGN = range(11)
RATE_J, RATE_X, SIZE_J, SIZE_X, SIZE_A2, SIZE_B2, PSI_RE, PSI_IM, J3 = range(11, 20)
START = 20  # the initial state
TERMS = 4
COS_J, SIN_J, COS_A, SIN_A, COS_B, SIN_B, THETA = range(26, 26 + 7 * TERMS, TERMS)
SIZE = THETA + TERMS

NAME = "theta_functions"
REST, FREE, DIRECT, TRANSFORMED, TOO_UPRIGHT = range(5)
TOO_LATE = 1
LATEST = 1e15  # in units of 1/(|J| + √(|alpha||x|)); doubles of later times say nothing about the phase
FAILURES = {
    TOO_LATE: f"n |h| is over {LATEST:g} times the time scale of the top: its phase is beyond double",
}
WEIGHTLESS = 2.0**-100  # a smaller alpha, in units of the orbit, changes no double at any admissible time
UPRIGHT = 1e-40  # least J+ or x+, in units of the orbit: the fourth powers of smaller ones underflow
state_of = tuple_loader(6)


@jit
def reduced(t, c):
    """The number n of whole periods since t0, and the rest r in [−T/2, T/2]; n T is subtracted in double-double."""
    if c[PERIOD] == math.inf:
        return 0.0, t + c[TIME_0]
    n = np.rint((t + c[TIME_0]) / c[PERIOD])
    p, e = two_prod(n, c[PERIOD])
    return n, ((t - p) - (e + n * c[PERIOD_LO])) + c[TIME_0]


@jit
def turned(n, turn, turn_lo):
    """The angle of n whole periods, in (−π, π]. turn, turn_lo : turns in one period."""
    p, e = two_prod(n, turn)
    return TWO_PI[0] * ((p - np.rint(p)) + (e + n * turn_lo))


@jit
def direct(v, c):
    """θ2(v − iσβ)/θ4(v) for J+ and A, θ1(v − iσβ)/θ4(v) for B, each up to a constant."""
    z = complex(math.cos(v), math.sin(v))
    zz = z * z
    J = A = B = complex(0.0, 0.0)
    theta, even, sign = 1.0, complex(1.0, 0.0), 1.0
    for n in range(TERMS):
        J += complex(c[COS_J + n] * z.real, c[SIN_J + n] * z.imag)
        A += complex(c[COS_A + n] * z.real, c[SIN_A + n] * z.imag)
        B += complex(c[COS_B + n] * z.imag, -(c[SIN_B + n] * z.real)) * sign
        z *= zz
        even *= zz
        sign = -sign
        theta += c[THETA + n] * even.real
    return J / theta, A / theta, B / theta


@jit
def transformed(v, c):
    """θ4(σb + iV)/θ2(iV) for J+ and A, −i θ1(σb + iV)/θ2(iV) for B; all sums times e^−|V|."""
    V = abs(v)
    q, decay = c[NOME], math.exp(-V)
    u = math.exp(2.0 * (V - c[BARRIER])) if q > 0.0 else 0.0  # q e^2V
    d2 = decay * decay
    J, A, B = complex(decay, 0.0), complex(decay, 0.0), complex(0.0, 0.0)
    theta = 0.0
    grow, fall, power, tail = 1.0, 1.0, 1.0, d2  # u^n, e^−2nV, q^(n²), q^n e^−(2n+2)V
    q_n = 1.0
    for n in range(TERMS):
        if n > 0:  # q^(n²) cosh, sinh of 2nV
            x, y = grow * power / q_n, power * fall
            even, odd = decay * (x + y), decay * (x - y)
            J += complex(c[COS_J + n] * even, c[SIN_J + n] * odd)
            A += complex(c[COS_A + n] * even, c[SIN_A + n] * odd)
        # q^(n²+n) cosh, sinh of (2n+1)V
        x, y = power * grow, power * tail
        theta += x + y
        B += complex(c[COS_B + n] * (x - y), c[SIN_B + n] * (x + y))
        grow *= u
        fall *= d2
        q_n *= q
        tail *= q * d2
        power *= q_n * q_n / q if q > 0.0 else 0.0
        if power == 0.0:
            break
    if v < 0.0:
        J, A, B = J.conjugate(), A.conjugate(), -B.conjugate()
    return J / theta, A / theta, B / theta


@jit
def factors(r, c):
    return direct(c[CLOCK] * r, c) if c[KIND] == DIRECT else transformed(c[CLOCK] * r, c)


@jit
def unit(angle):
    return complex(math.cos(angle), math.sin(angle))


@jit
def model(n, r, c):
    """J+, x+ and x3 for ψ = 0."""
    J, A, B = factors(r, c)
    turn = turned(n, c[TURN], c[TURN_LO])
    x3 = 0.5 * (c[SIZE_B2] * (B.real * B.real + B.imag * B.imag) - c[SIZE_A2] * (A.real * A.real + A.imag * A.imag))
    AB = A * B
    x = complex(-AB.imag, AB.real) * unit(turn + c[RATE_X] * r) * c[SIZE_X]
    return J * unit(turn + c[RATE_J] * r) * c[SIZE_J], x, x3


@jit
def position(t, rest, c):
    """The state at time t + `rest`, which is below an ulp of t."""
    s = state_of(c, START)
    if c[KIND] == REST or t == 0.0:
        return s
    if c[KIND] == FREE:
        return about(s, t, rest, c)
    n, r = reduced(t, c)
    r += rest
    J, x, x3 = model(n, r, c)
    psi = complex(c[PSI_RE], c[PSI_IM])
    J *= psi
    x *= psi
    return J.real, J.imag, c[J3], c[SIGN] * x.real, c[SIGN] * x.imag, c[SIGN] * x3


@jit
def about(s, t, rest, c):
    """x turned about the constant J. c[CLOCK] = |J|."""
    J, x = (s[0], s[1], s[2]), (s[3], s[4], s[5])
    _, r = reduced(t, c)
    angle, rate = c[CLOCK] * (r + rest), c[CLOCK]
    e = J[0] / rate, J[1] / rate, J[2] / rate
    half = math.sin(0.5 * angle)
    v = cross(e, x)
    d = add_vector(times(math.sin(angle), v), 2.0 * half * half, cross(e, v))
    return s[0], s[1], s[2], x[0] + d[0], x[1] + d[1], x[2] + d[2]


@jit
def step(s, c, counters):
    """The state at the next multiple of h since the start of the run. It does not depend on s, only on the number of steps."""
    n = counters[MEMORY] + 1.0
    counters[MEMORY] = n
    t, rest = two_prod(n, c[H])
    if abs(t) > LATEST:
        counters[FAILURE] = TOO_LATE
        return s
    return position(t, rest, c)


@jit
def positions(instants, c):
    out = np.empty((len(instants), 6))
    for i in range(len(instants)):
        store_tuple(out[i], 0, position(instants[i], 0.0, c))
    return out


# ------------------------------------------------------------------------------------ constants


@jit
def pair(product, total):
    """The two numbers with this product, which is not above zero, and this sum. Neither loses a digit."""
    half = scale(total, 0.5)
    root = sqrt(sub(mul(half, half), product))
    return add(half, root), sub(half, root)


@jit
def roots(alpha, y):
    """ζ1, ζ2, ζ3, ζ_J, ζ_A, ζ_B and alpha D_J, alpha D_A, alpha D_B, double-doubles; alpha > 0."""
    J1, J2, m, x1, x2, x3 = y
    a, m_ = dd(alpha), dd(m)
    jj = add(two_prod(J1, J1), two_prod(J2, J2))
    xx = add(two_prod(x1, x1), two_prod(x2, x2))
    xj = add(two_prod(x1, J1), two_prod(x2, J2))
    slope = sub(two_prod(J1, x2), two_prod(J2, x1))
    s = sqrt(add(xx, two_prod(x3, x3)))
    if x3 >= 0.0:
        up = add(s, dd(x3))
        down = div(xx, up)
    else:
        down = sub(s, dd(x3))
        up = div(xx, down)
    zJ, zA, zB = scale(jj, 0.5), mul(a, down), neg(mul(a, up))
    half_a = scale(a, 0.5)
    dJ = scale(sub(mul(a, xj), mul(m_, zJ)), 0.5)
    dA = mul(half_a, sub(mul(m_, down), xj))
    dB = mul(half_a, add(mul(m_, up), xj))
    # The cubic of ξ = ζ_A − ζ. ζ1 and ζ2 lie on either side of ξ = 0, so they keep their digits where they are close.
    h0 = sub(jj, scale(zA, 2.0))
    c2 = add(h0, sub(mul(m_, m_), scale(mul(a, s), 4.0)))
    c1 = scale(add(mul(mul(a, s), h0), scale(mul(m_, dA), 2.0)), -2.0)
    c0 = scale(mul(dA, dA), 4.0)
    far = largest_root(c0, c1, c2)
    product = neg(div(scale(c0, 0.5), far))
    x2_, x1_ = pair(product, div(sub(scale(c1, 0.5), product), far))
    z1, z2, z3 = sub(zA, x1_), sub(zA, x2_), sub(zA, far)
    if x2_[0] - x1_[0] >= far[0] - x2_[0]:
        # The cubic of ζ: the same holds for ζ2 and ζ3.
        c2 = sub(scale(two_prod(alpha, x3), 4.0), add(jj, mul(m_, m_)))
        c1 = scale(mul(a, sub(sub(mul(m_, xj), mul(dd(x3), jj)), mul(a, xx))), 2.0)
        c0 = mul(mul(a, slope), mul(a, slope))
        z1 = largest_root(c0, c1, c2)
        product = neg(div(scale(c0, 0.5), z1))
        z2, z3 = pair(product, div(sub(scale(c1, 0.5), product), z1))
    return z1, z2, z3, zJ, zA, zB, dJ, dA, dB


@jit
def carlson(x, y, z):
    """R_F (DLMF 19.16.1) by duplication; at most one argument is zero."""
    for _ in range(60):
        mean = (x + y + z) / 3.0
        if max(abs(x - mean), abs(y - mean), abs(z - mean)) < 2e-3 * mean:
            break
        a, b, d = math.sqrt(x), math.sqrt(y), math.sqrt(z)
        shift = a * b + b * d + d * a
        x, y, z = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift)
    X, Y = (mean - x) / mean, (mean - y) / mean
    Z = -X - Y
    e2, e3 = X * Y - Z * Z, X * Y * Z
    series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0
    return (series - 5.0 * e2 * e2 * e2 / 208.0 + 3.0 * e3 * e3 / 104.0 + e2 * e2 * e3 / 16.0) / math.sqrt(mean)


@jit
def above(z1, z2, z3, z, d):
    """z − ζ2 and ζ1 − z for ζ2 ≤ z ≤ ζ1, where 2 (ζ1 − z)(z − ζ2)(z − ζ3) = 4 d². The smaller one comes from this product."""
    low, high = sub(z, z2), sub(z1, z)
    rest = scale(sub(z, z3), 0.5)
    if low[0] < high[0]:
        low = div(mul(d, d), mul(high, rest))
    elif low[0] > 0.0:
        high = div(mul(d, d), mul(low, rest))
    return low, high


@jit
def side(d, low, high):
    """σ: the sign of D. If D = 0, it is 0 for a factor with a real zero (ζ_F = ζ2), and 1 for one without (ζ_F = ζ1)."""
    if d[0] == 0.0:
        return 0.0 if low[0] < high[0] or low[0] <= 0.0 else 1.0
    return math.copysign(1.0, d[0])


@jit
def nome(squared, complementary):
    """q of k² and k'², k² <= 1/2 (DLMF 19.5.6 and 19.5.7)."""
    k = math.sqrt(complementary)
    root = math.sqrt(k)
    e = 0.5 * squared / ((1.0 + k) * (1.0 + root) * (1.0 + root))
    e4 = e * e * e * e
    return e * (1.0 + e4 * (2.0 + e4 * (15.0 + e4 * 150.0)))


@jit
def direct_series(c, cos_at, sigma, eta, K):
    """Coefficients q^(n²+n) cosh and σ sinh of (2n+1)β, over cosh β, with η' = K' − η for `eta`; returns d arg/dv."""
    q = c[NOME]
    grow = math.exp(-math.pi * eta / K)  # q e^2β
    fall = q / grow if sigma != 0.0 else 1.0  # e^−2β
    y = grow + q * fall
    even, even_before = 1.0, 1.0
    odd = sigma * (1.0 - fall) / (1.0 + fall)
    odd_before = -odd
    top, bottom, power = 0.0, 0.0, q  # q^(2n+1)
    for n in range(TERMS):
        c[cos_at + n], c[cos_at + TERMS + n] = even, odd
        top += (2.0 * n + 1.0) * odd
        bottom += even
        even, even_before = power * (y * even - power * even_before), even
        odd, odd_before = power * (y * odd - power * odd_before), odd
        power *= q * q
    return top / bottom


@jit
def transformed_series(c, cos_at, sigma, b, odd):
    """Coefficients of a factor, ± cos and −σ sin of 2nb or, `odd`, of (2n+1)b; returns d arg/dV."""
    top, bottom, sign = 0.0, 1.0, 1.0
    power, step_ = 1.0, c[NOME]  # q^(n²), q^(2n+1)
    for n in range(TERMS):
        angle = (2.0 * n + 1.0) * b if odd else 2.0 * n * b
        c[cos_at + n], c[cos_at + TERMS + n] = sign * math.cos(angle), -sigma * sign * math.sin(angle)
        if n > 0:
            top -= 4.0 * n * sign * power * math.sin(2.0 * n * b)
            bottom += 2.0 * sign * power * math.cos(2.0 * n * b)
        power *= step_
        step_ *= c[NOME] * c[NOME]
        sign = -sign
    return sigma * top / bottom


@jit
def agm(a, g):
    while abs(a - g) > 1e-8 * a:
        a, g = 0.5 * (a + g), math.sqrt(a * g)
    return 0.5 * (a + g)


# ------------------------------------------------------------------------------------ the constants, in four stages


@jit
def constants(alpha, y, h):
    """Everything `position` needs for the motion through y at t = 0."""
    c = np.zeros(SIZE)
    c[H], c[J3], c[PERIOD], c[SIGN] = h, y[2], math.inf, 1.0
    for k in range(6):
        c[START + k] = y[k]
    if is_plain(alpha, y, c):
        return c
    if alpha < 0.0:  # the mirror image
        c[SIGN], alpha, y = -1.0, -alpha, (y[0], y[1], y[2], -y[3], -y[4], -y[5])
    found = roots(alpha, y)
    gaps, places = put_clock(found, y[2], c)
    K, K_ = put_start(found, y, gaps, c)
    slopes = put_direct(gaps, places, K, K_, c) if gaps[2] <= gaps[0] else put_transformed(gaps, places, K, K_, c)
    put_scales(found, places[0][2], places[1][2], places[2][1], slopes, alpha, y, c)
    return c


@jit
def is_plain(alpha, y, c):
    """Whether the motion is a rest, a turn about a constant J, or too upright; then it has its constants."""
    J1, J2, m, x1, x2, _ = y
    if abs(alpha) < WEIGHTLESS:
        rate = sqrt(add(add(two_prod(J1, J1), two_prod(J2, J2)), two_prod(m, m)))
        c[KIND] = FREE if rate[0] > 0.0 else REST
        if rate[0] > 0.0:
            c[CLOCK] = rate[0]
            c[PERIOD], c[PERIOD_LO] = div(TWO_PI, rate)
        return True
    off = max(max(abs(J1), abs(J2)), max(abs(x1), abs(x2)))
    if off < UPRIGHT:
        c[KIND] = TOO_UPRIGHT if off > 0.0 else REST
    return off < UPRIGHT


@jit
def put_clock(found, m, c):
    """1: the period, and the turn in it, in double-double. From here on doubles do.

    Returns ζ1 − ζ2, ζ1 − ζ3, ζ2 − ζ3; for J, A and B the distances of ζ_F from ζ1, ζ2, ζ3, and σ.
    """
    z1, z2, z3, zJ, zA, zB, dJ, dA, dB = found
    J_low, J_high = above(z1, z2, z3, zJ, dJ)
    T, turn = period_and_turn(z1, z2, z3, sub(zJ, z3), J_low, J_high, dJ, dd(m))
    c[PERIOD], c[PERIOD_LO] = T
    c[TURN], c[TURN_LO] = turn
    A_low, A_high = above(z1, z2, z3, zA, dA)
    of_J = max(J_high[0], 0.0), max(J_low[0], 0.0), sub(zJ, z3)[0], side(dJ, J_low, J_high)
    of_A = max(A_high[0], 0.0), max(A_low[0], 0.0), sub(zA, z3)[0], side(dA, A_low, A_high)
    B3 = max(sub(z3, zB)[0], 0.0)
    of_B = sub(z1, zB)[0], sub(z2, zB)[0], B3, math.copysign(1.0, dB[0]) if dB[0] != 0.0 and B3 > 0.0 else 0.0
    return (sub(z1, z2)[0], sub(z1, z3)[0], sub(z2, z3)[0]), (of_J, of_A, of_B)


@jit
def put_start(found, y, gaps, c):
    """2: the time since x3 was smallest. Returns K and K'; CLOCK is κ for now."""
    (z12, z13, z23), (J1, J2, _, x1, x2, _) = gaps, y
    c[CLOCK] = math.sqrt(0.5 * z13)
    K_ = 0.5 * math.pi / agm(1.0, math.sqrt(z23 / z13))
    K = 0.5 * math.pi / agm(1.0, math.sqrt(z12 / z13)) if z12 > 0.0 else math.inf
    z1, z2, z3, w = found[0][0], found[1][0], found[2][0], 0.0
    if z3 < 0.0:
        w = math.sqrt(-z3) * carlson(max(z2, 0.0), z1 * z23 / z13, z23)
    c[TIME_0] = math.copysign(w, J1 * x2 - J2 * x1) / c[CLOCK]
    return K, K_


@jit
def put_direct(gaps, places, K, K_, c):
    """3: the coefficients of the series of k ≤ 1/√2. Returns d arg/dv of J, A, B."""
    z12, z13, z23 = gaps
    c[KIND], c[NOME] = DIRECT, nome(z23 / z13, z12 / z13)
    c[CLOCK] = 0.5 * math.pi * c[CLOCK] / K
    slopes = np.zeros(3)
    for i, (to_1, to_2, to_3, sigma) in enumerate(places):
        eta = K_
        if sigma != 0.0 and i < 2:
            eta = math.sqrt(to_1) * carlson(to_2, to_3 * z12 / z13, z12)
        elif sigma != 0.0:
            eta = math.sqrt(z13) * carlson(to_3, to_2, to_1)
        slopes[i] = direct_series(c, COS_J + 2 * TERMS * i, sigma, eta, K)
    power, odd = -2.0 * c[NOME], -c[NOME] * c[NOME] * c[NOME]  # 2 (−1)^n q^(n²), −q^(2n+1)
    for n in range(TERMS):
        c[THETA + n] = power
        power *= odd
        odd *= c[NOME] * c[NOME]
    return slopes


@jit
def put_transformed(gaps, places, K, K_, c):
    """3: the same for k > 1/√2, by functions of the complementary modulus; d arg/dV."""
    z12, z13, z23 = gaps
    c[KIND], c[NOME] = TRANSFORMED, nome(z12 / z13, z23 / z13)
    c[CLOCK] = 0.5 * math.pi * c[CLOCK] / K_
    c[BARRIER] = 0.5 * math.pi * K / K_
    per_K, slopes = 0.5 * math.pi / K_, np.zeros(3)
    for i, (to_1, to_2, to_3, sigma) in enumerate(places):
        b = 0.0
        if sigma != 0.0 and i < 2:
            b = per_K * math.sqrt(to_2 * z13) * carlson(to_1 * z23, z23 * z12, to_3 * z12)
        elif sigma != 0.0:
            b = per_K * math.sqrt(to_3) * carlson(z23, z23 * to_1 / z13, to_2)
        slopes[i] = transformed_series(c, COS_J + 2 * TERMS * i, sigma, b, i == 2)
    return slopes


@jit
def put_scales(found, J3_, A3, B2, slopes, alpha, y, c):
    """4: the rates λ, the constant factors, and the phase ψ at the start."""
    J1, J2, m, x1, x2, x3 = y
    dJ, dA, dB = found[6:]
    c[RATE_J] = 0.5 * m + (dJ[0] / J3_ - c[CLOCK] * slopes[0])
    c[RATE_X] = (dA[0] / A3 - c[CLOCK] * slopes[1]) + (dB[0] / B2 - c[CLOCK] * slopes[2])
    # factors of J+ and A where x3 is smallest, of B where it is largest
    J, A, B = factors(0.0, c)
    c[SIZE_J] = math.sqrt(2.0 * J3_) / abs(J)
    c[SIZE_A2] = A3 / alpha / (A.real * A.real + A.imag * A.imag)
    J, A, B = factors(0.5 * c[PERIOD], c)
    c[SIZE_B2] = B2 / alpha / (B.real * B.real + B.imag * B.imag)
    c[SIZE_X] = math.sqrt(c[SIZE_A2] * c[SIZE_B2])
    n, r = reduced(0.0, c)
    J, x, _ = model(n, r, c)
    length = x1 * x1 + x2 * x2 + x3 * x3
    weight = J1 * J1 + J2 * J2 + m * m + alpha * math.sqrt(length)
    psi = J.conjugate() * complex(J1, J2) * length + x.conjugate() * complex(x1, x2) * weight
    c[PSI_RE], c[PSI_IM] = psi.real / abs(psi), psi.imag / abs(psi)


def found_constants(units: Units, y: Array, span: float, h: float | None = None) -> Array:
    c: Array = constants(units.alpha, tuple(units.enter(y).tolist()), span)
    if c[KIND] == TOO_UPRIGHT:
        reason = f"J and x are off the vertical, but by less than {UPRIGHT:g} of their size: the closed form underflows"
        raise StepError(NAME, reason, h=h)
    if np.any(np.isnan(c)):
        raise StepError(NAME, "the constants of the closed form are beyond the range of doubles", h=h)
    return c


class ThetaStepper(FixedStepper):
    """Evaluates the closed form at every multiple of h since the state with which the run began."""

    from_start = True

    def __init__(self, top: LagrangeTop, y0: Array, h: float):
        self.top_units = units = Units(top, y0, h)
        self.span = units.span(NAME, h)
        super().__init__(NAME, h, Kernel(step, failures=FAILURES), found_constants(units, y0, self.span, h), units)

    def record(self, y: Array, n: int, every: int) -> Array:
        y = as_state(y)
        self.constants = found_constants(self.top_units, y, self.span, self.h)
        return super().record(y, n, every)


def evaluate(top: LagrangeTop, y0: Array, times: Array) -> tuple[Array, Work]:
    """The states at any times, with one evaluation for each."""
    if kinds.rigid_body(top):
        return closed_form(top, y0, times), Work(steps=len(times))  # type: ignore[arg-type]
    units = Units(top, y0, 1.0)
    states = units.leave(positions(units.spans(NAME, times), found_constants(units, y0, 0.0)))
    states[times == 0.0] = y0  # with the digits that the formulas lose beside |x|
    return states, Work(steps=len(times))


def prepare_body(body: RigidBody, y0: Array, h: float) -> BodyStepper:
    """The closed form of a free or symmetric body at every multiple of h."""
    return BodyStepper(body, h, closed_form)


METHOD = Method(
    name=NAME,
    label="Theta functions",
    family="closed-form",
    order=None,
    claims=Claims(symmetric=True, poisson=True, conserves={"H", "J3", "C1", "C2"}),
    source="Whittaker, Analytical Dynamics, sections 37, 71-72; Jacobi, Werke 2 (1882) 477",
    prepare=ThetaStepper,
    evaluate=evaluate,
    kernels_for={kinds.symmetric_body: prepare_body, kinds.free_body: prepare_body},
)
