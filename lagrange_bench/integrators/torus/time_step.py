"""λ(h): the Bäcklund parameter with which one two-point step is the exact flow over time h.

Notation: Q(u) = C1 + 2 C2 u + 2H u² + 2 alpha J3 u³ + alpha² u⁴, and (λ, m) is a point of the curve m² = Q(λ) with λ = R + iη in
the upper half-plane. One step is the flow over the time T, followed by a rotation about e3 by Θ, where

    T = 2 Im ∫_0^λ du/√Q        Θ = 2 alpha Im ∫_0^λ u du/√Q.

λ(h) solves T = h, Θ = 0. For small h it is a power series. Larger times come from *time doubling*, which is exact and needs
neither a branch nor an iteration: two steps with (λ, m) are one with (λ', m'). This is the group law of the curve with its two
points at infinity glued, twice a divisor reduced (Cantor, Math. Comp. 48 (1987) 95). Its use for λ(h) is a result of this
project, with the proof below:

    g  = Q'(λ)/(2m)      a1 = Re m/η      b0 = Re g/(2η)      b1 = (a1 + Im g)/(2η²)
    λ' = R − b0/b1 + iη'                  η' = √(2 a1 b1 + alpha²)/b1
    m' = i(a1 v − Im m) − b1 η'(v² + η²)  v  = λ' − R

Proof. The real cubic A(u) with A(λ) = i m, A'(λ) = i g makes A − i√Q vanish twice at (λ, m) and at (λ̄, −m̄). Its values at the
two points at infinity are equal, so its divisor is trivial also for the rotation about e3. A² + Q has degree six and is
b1² |u − λ|⁴ (u − λ')(u − λ̄'); comparing coefficients gives the formula. b1 falls to zero exactly when twice the step is the
nutation period, and λ' goes to infinity there. With one division and one root after g the formula is

    b = Re m + η Im g    e = η Re g/b    f = alpha² η⁴/b    s = √((Re m + f)/b)
    λ' = R − ηe + 2iηs   m' = s(2 Re m + 4f − b(1 + e²)) + i(e(3 Re m + 4f) − Im m)                    `double_time`

All is in double-double arithmetic, because an error of one ulp in the time step is a phase error that grows for ever.
"""

import math
from fractions import Fraction

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import (
    add,
    cadd,
    cdiv,
    cmul,
    dd,
    div,
    mul,
    neg,
    quick,
    scale,
    sqrt,
    sub,
    times,
    two_prod,
)
from lagrange_bench.integrators.compiling.unroll import unrolled

SERIES = 20  # terms of the power series of 1/√Q
EXACT = 10  # so many in double-double; the others are below 1e-16 of the sum
START = 2.0**-4  # longest time of the series, in units of 1/(|J| + √(|alpha||x|))
TWO_PI = (6.283185307179586, 2.4492935982947064e-16)
TINY_BRANCH = 1e-25  # for smaller |m| the homoclinic orbit has reached the sleeping top, to all digits


def _weights():
    """1 − k/2n as double-doubles, [n, k]."""
    w = np.zeros((SERIES, 5, 2))
    for n in range(1, SERIES):
        for k in range(1, min(n, 4) + 1):
            exact = Fraction(2 * n - k, 2 * n)
            w[n, k] = float(exact), float(exact - Fraction(float(exact)))
    return w


WEIGHTS = _weights()


@unrolled
def spectral_polynomial(alpha, y):
    """Coefficients of Q as five double-doubles, from doubles taken as exact."""
    J1, J2, J3, x1, x2, x3 = y
    c1 = add(add(two_prod(x1, x1), two_prod(x2, x2)), two_prod(x3, x3))
    c2 = add(add(two_prod(x1, J1), two_prod(x2, J2)), two_prod(x3, J3))
    j2 = add(add(two_prod(J1, J1), two_prod(J2, J2)), two_prod(J3, J3))
    h2 = add(j2, scale(two_prod(alpha, x3), 2.0))
    return c1, scale(c2, 2.0), h2, scale(two_prod(alpha, J3), 2.0), two_prod(alpha, alpha)


@unrolled
def horner(q, u):
    """Q(u) for complex double-double u."""
    r = (q[4], dd(0.0))
    for k in range(3, -1, -1):
        r = cadd(cmul(r, u), (q[k], dd(0.0)))
    return r


@unrolled
def slope(q, lam, m):
    """g = Q'(λ)/(2m)."""
    R, eta = lam
    t, r = scale(R, 2.0), add(mul(R, R), mul(eta, eta))
    b2 = add(mul(q[3], dd(3.0)), mul(t, scale(q[4], 4.0)))
    b1 = add(scale(q[2], 2.0), sub(mul(t, b2), mul(r, scale(q[4], 4.0))))
    d = add(q[1], sub(mul(R, b1), mul(r, b2))), mul(eta, b1)  # Q'(λ): a real polynomial, divided by (u − λ)(u − λ̄)
    n = scale(add(mul(m[0], m[0]), mul(m[1], m[1])), 2.0)
    re, im = cmul(d, (m[0], neg(m[1])))
    return div(re, n), div(im, n)


@jit
def double_time(q, lam, m):
    """(λ, m) of twice the time; see the module's docstring."""
    eta = lam[1]
    g = slope(q, lam, m)
    eta2 = mul(eta, eta)
    b = add(m[0], mul(eta, g[1]))
    r = div(dd(1.0), b)
    e = mul(mul(eta, g[0]), r)
    f = mul(mul(q[4], mul(eta2, eta2)), r)
    c = add(m[0], f)
    s = sqrt(mul(c, r))
    re = mul(s, sub(scale(add(c, f), 2.0), mul(b, add(mul(e, e), dd(1.0)))))
    im = sub(mul(e, add(times(c, 3.0), f)), m[1])
    return (sub(lam[0], mul(eta, e)), scale(mul(eta, s), 2.0)), (re, im)


@jit
def series(q):
    """g_k of 1/√Q = Σ g_k u^k, from 2 Q f' = −Q' f, as rows of double-doubles; the last SERIES − EXACT are doubles."""
    g = np.empty((SERIES, 2))
    one = div(dd(1.0), q[0])
    p = (dd(1.0), mul(q[1], one), mul(q[2], one), mul(q[3], one), mul(q[4], one))
    g[0, 0], g[0, 1] = sqrt(one)
    for n in range(1, EXACT):
        s = dd(0.0)
        for k in range(min(n, 4), 0, -1):
            weight = (WEIGHTS[n, k, 0], WEIGHTS[n, k, 1])
            s = sub(s, mul(mul(p[k], weight), (g[n - k, 0], g[n - k, 1])))
        g[n, 0], g[n, 1] = s
    for n in range(EXACT, SERIES):
        t = 0.0
        for k in range(4, 0, -1):
            t -= WEIGHTS[n, k, 0] * p[k][0] * g[n - k, 0]
        g[n, 0], g[n, 1] = t, 0.0
    return g


@jit
def rough_moments(g, R, eta):
    """Im F and Im G of λ = R + iη, in double; F = ∫_0^λ du/√Q, G = ∫_0^λ u du/√Q."""
    t, r = 2.0 * R, R * R + eta * eta
    f1 = f2 = d1 = d2 = 0.0
    for k in range(SERIES - 1, -1, -1):
        f1, f2 = g[k, 0] / (k + 1.0) + (t * f1 - r * f2), f1
        d1, d2 = g[k, 0] / (k + 2.0) + (t * d1 - r * d2), d1
    return eta * f1, eta * (t * d1 - r * d2)


@jit
def moments(g, R, eta):
    """The same in double-double, for doubles R and η."""
    t, r = 2.0 * R, add(two_prod(R, R), two_prod(eta, eta))
    h1 = h2 = e1 = e2 = 0.0
    for k in range(SERIES - 1, EXACT - 1, -1):
        h1, h2 = g[k, 0] / (k + 1.0) + (t * h1 - r[0] * h2), h1
        e1, e2 = g[k, 0] / (k + 2.0) + (t * e1 - r[0] * e2), e1
    f1, f2, d1, d2 = dd(h1), dd(h2), dd(e1), dd(e2)
    for k in range(EXACT - 1, -1, -1):
        gk = (g[k, 0], g[k, 1])
        f1, f2 = add(div(gk, dd(k + 1.0)), sub(times(f1, t), mul(r, f2))), f1
        d1, d2 = add(div(gk, dd(k + 2.0)), sub(times(d1, t), mul(r, d2))), d1
    return times(f1, eta), times(sub(times(d1, t), mul(r, d2)), eta)


@jit
def start(q, h):
    """(λ, m) for a small time h > 0, from T = h and Θ = 0 as power series, by Newton's method.

    All steps but the last are in double. The last step doubles the digits, and needs only the residual in double-double.
    """
    g = series(q)
    half = scale(h, 0.5)
    mr, mi = math.sqrt(q[0][0]), 0.0
    eta = half[0] * mr
    R = g[1, 0] / g[0, 0] * eta * eta / 3.0
    for i in range(4):
        # m = √Q(λ), a step of Newton's method; Q by division by (u − λ)(u − λ̄)
        t, r = 2.0 * R, R * R + eta * eta
        b3 = q[3][0] + t * q[4][0]
        b2 = q[2][0] + (t * b3 - r * q[4][0])
        b1 = q[1][0] + (t * b2 - r * b3)
        re, im = q[0][0] + (R * b1 - r * b2), eta * b1
        s = 0.5 / (mr * mr + mi * mi)
        mr, mi = 0.5 * mr + (re * mr + im * mi) * s, 0.5 * mi + (im * mr - re * mi) * s
        if i == 3:
            break
        F, G = rough_moments(g, R, eta)
        b = half[0] - F
        a = -(G + R * b) / eta
        R += a * mr - b * mi
        eta += a * mi + b * mr
    F2, G2 = moments(g, R, eta)
    b = sub(half, F2)[0]
    a = -(G2[0] + R * b) / eta
    lam = quick(R, a * mr - b * mi), quick(eta, a * mi + b * mr)
    Q = horner(q, lam)
    m = cmul((dd(mr), dd(mi)), (dd(mr), dd(mi)))
    re, im = sub(Q[0], m[0])[0], sub(Q[1], m[1])[0]
    s = 0.5 / (mr * mr + mi * mi)
    return lam, (quick(mr, (re * mr + im * mi) * s), quick(mi, (im * mr - re * mi) * s))


@jit
def rate(q):
    """|J| + √(|alpha||x|), at most three times too large."""
    weight = math.sqrt(math.sqrt(q[4][0] * q[0][0]))
    return math.sqrt(max(0.0, q[2][0] + 2.0 * weight * weight)) + weight


@jit
def parameter(q, h):
    """(λ, m) with T = h, Θ = 0, for 0 < h < nutation period; all are (complex) double-doubles."""
    doublings = 0
    while h[0] * rate(q) > START:
        h = scale(h, 0.5)
        doublings += 1
    lam, m = start(q, h)
    for _ in range(doublings):
        if m[0][0] * m[0][0] + m[1][0] * m[1][0] < TINY_BRANCH * TINY_BRANCH * q[0][0]:
            break
        lam, m = double_time(q, lam, m)
    return lam, m


@jit
def largest_root(c0, c1, c2):
    """The largest root of 2z³ + c2 z² + c1 z + c0, whose roots are real.

    Newton's method falls monotonically from a double on its right: in double while the steps are well above round-off, then with
    the polynomial in double-double. At a double root each step only halves the error; it still reaches 1e-17.
    """
    z = 2.0 * max(abs(c2[0]), math.sqrt(abs(c1[0])), abs(c0[0]) ** (1.0 / 3.0)) + 1e-300
    for _ in range(200):
        f = ((2.0 * z + c2[0]) * z + c1[0]) * z + c0[0]
        d = (6.0 * z + 2.0 * c2[0]) * z + c1[0]
        if f <= 0.0 or f <= 1e-5 * d * abs(z):
            break
        z -= f / d
    root = dd(z)
    for _ in range(60):
        f = add(mul(add(mul(add(scale(root, 2.0), c2), root), c1), root), c0)
        d = add(mul(add(mul(dd(6.0), root), scale(c2, 2.0)), root), c1)
        if f[0] == 0.0 or d[0] == 0.0:
            break
        step = f[0] / d[0]
        root = add(root, dd(-step))
        if abs(step) <= 1e-20 * abs(root[0]):
            break
    return root


@jit
def nutation_roots(alpha, y):
    """The roots z1 >= z2 >= z3 of the cubic of nutation, minus z at y. z = alpha x3 moves in [z3, z2].

    With ζ = z − z(y) it is ζ'² = 2ζ³ + (4 alpha x3 − |J|²) ζ² + 2 alpha x3'' ζ + alpha² x3'², with coefficients at y. They keep
    their digits also at the marginal sleeping top, where all roots come together. alpha may have either sign or be 0.
    """
    J1, J2, J3, x1, x2, x3 = y
    slope = sub(two_prod(J1, x2), two_prod(J2, x1))
    xx = add(two_prod(x1, x1), two_prod(x2, x2))
    xj = add(two_prod(x1, J1), two_prod(x2, J2))
    jj = add(two_prod(J1, J1), two_prod(J2, J2))
    a = dd(alpha)
    curvature = sub(sub(mul(dd(J3), xj), mul(dd(x3), jj)), mul(a, xx))
    c2 = sub(sub(scale(two_prod(alpha, x3), 4.0), two_prod(J3, J3)), jj)
    c1 = scale(mul(a, curvature), 2.0)
    c0 = mul(mul(a, slope), mul(a, slope))
    z1 = largest_root(c0, c1, c2)
    # z2 and z3 are the roots of the quadratic that remains after dividing by ζ − z1
    mean = scale(add(c2, scale(z1, 2.0)), -0.25)
    product = sub(scale(c1, 0.5), scale(mul(z1, mean), 2.0))
    half = sqrt(sub(mul(mean, mean), product))
    return z1, add(mean, half), sub(mean, half)


@jit
def nutation_period(alpha, y):
    """π/agm(√((z1 − z3)/2), √((z1 − z2)/2)) as a double-double; inf on the separatrix and if nothing moves."""
    z1, z2, z3 = nutation_roots(alpha, y)
    x, y = sqrt(scale(sub(z1, z3), 0.5)), sqrt(scale(sub(z1, z2), 0.5))
    if x[0] <= 0.0 or y[0] <= 0.0:
        return math.inf, 0.0
    for _ in range(40):
        if abs(x[0] - y[0]) <= 1e-8 * x[0]:
            break
        x, y = scale(add(x, y), 0.5), sqrt(mul(x, y))
    mean, half = scale(add(x, y), 0.5), 0.5 * sub(x, y)[0]
    mean = add(mean, dd(-0.25 * half * half / mean[0]))  # agm(mean + half, mean − half) to half⁴
    return div((3.141592653589793, 1.2246467991473532e-16), mean)


@jit
def period_and_turn(z1, z2, z3, J, low, high, dJ, m):
    """The period T and the precession in it over 2π, as double-doubles; `J`, `low`, `high` = ζ_J − ζ3, ζ_J − ζ2, ζ1 − ζ_J.

    (arg F_J)' = dJ/(ζ_J − ζ) over a period is (2 dJ/κJ) Π(n, k), n = (ζ2 − ζ3)/J; where n is close to 1, and J+ close to 0 when
    ζ = ζ2, Π(n) = K − Π(k²/n) + (κJ/|2 dJ|) π instead (DLMF 19.7.8).
    """
    a, g = sqrt(scale(sub(z1, z3), 0.5)), sqrt(scale(sub(z1, z2), 0.5))
    if g[0] <= 0.0:
        return (math.inf, 0.0), dd(0.0)
    close = low[0] < high[0]
    p = sqrt(scale(high, 0.5)) if close else mul(a, sqrt(div(low, J)))
    total, Q = dd(1.0), dd(1.0)
    for _ in range(60):
        ag, pp = mul(a, g), mul(p, p)
        bottom = add(pp, ag)
        Q = scale(mul(Q, div(sub(pp, ag), bottom)), 0.5)
        total = add(total, Q)
        done = abs(a[0] - g[0]) <= 1e-16 * a[0] and abs(Q[0]) < 1e-33
        p = div(scale(bottom, 0.5), p)
        a, g = scale(add(a, g), 0.5), sqrt(ag)
        if done:
            break
    T = div(scale(TWO_PI, 0.5), a)
    half = scale(T, 0.5)
    turn = mul(m, half)
    if close:
        turn = sub(turn, mul(mul(div(dJ, high), half), total))
    else:
        turn = add(turn, mul(mul(div(dJ, J), half), add(dd(2.0), mul(div(sub(z2, z3), low), total))))
    turn = div(turn, TWO_PI)
    if close:
        turn = add(turn, dd(0.5))
    return T, sub(turn, dd(np.rint(turn[0])))


@jit
def two_point_dd(alpha, y, lam, m):
    """One two-point step in double-double, with the formula of the fast kernel. y : a 6-tuple of double-doubles."""
    J1, J2, J3, x1, x2, x3 = y
    R, eta = lam
    a = dd(alpha)
    lam2 = add(mul(R, R), mul(eta, eta))
    S = add(J3, scale(mul(a, R), 2.0))
    z = mul(eta, sub(x3, mul(a, lam2)))
    E = add(mul(m[0], R), mul(eta, m[1]))
    etaS = mul(eta, S)
    P3 = add(mul(R, J3), mul(a, sub(mul(R, R), mul(eta, eta))))
    n1 = add(sub(add(mul(m[0], x1), mul(E, J1)), mul(etaS, x2)), mul(z, J2))
    n2 = sub(add(add(mul(m[0], x2), mul(E, J2)), mul(etaS, x1)), mul(z, J1))
    n3 = add(mul(m[0], add(x3, P3)), mul(eta, sub(mul(m[1], S), sub(mul(x1, J2), mul(x2, J1)))))
    r = div(eta, sqrt(add(add(mul(n1, n1), mul(n2, n2)), mul(n3, n3))))
    w1, w2, w3 = mul(n1, r), mul(n2, r), mul(n3, r)
    a2 = scale(a, 2.0)
    d1, d2 = neg(mul(a2, w2)), mul(a2, w1)
    s1, s2, s3 = add(scale(J1, 2.0), d1), add(scale(J2, 2.0), d2), scale(J3, 2.0)
    return (
        add(J1, d1),
        add(J2, d2),
        J3,
        add(add(x1, mul(R, d1)), sub(mul(s2, w3), mul(s3, w2))),
        add(add(x2, mul(R, d2)), sub(mul(s3, w1), mul(s1, w3))),
        add(x3, sub(mul(s1, w2), mul(s2, w1))),
    )


@jit
def precession(q, alpha, y, period):
    """cos and sin, as double-doubles, of the angle about e3 by which the top turns in one nutation period."""
    lam, m = parameter(q, scale(period, 0.5))
    s = (dd(y[0]), dd(y[1]), dd(y[2]), dd(y[3]), dd(y[4]), dd(y[5]))
    e = two_point_dd(alpha, two_point_dd(alpha, s, lam, m), lam, m)
    k = 0 if y[0] * y[0] + y[1] * y[1] > y[3] * y[3] + y[4] * y[4] else 3
    a1, a2, b1, b2 = (s[0], s[1], e[0], e[1]) if k == 0 else (s[3], s[4], e[3], e[4])
    c = add(mul(a1, b1), mul(a2, b2))
    d = sub(mul(a1, b2), mul(a2, b1))
    n = sqrt(add(mul(c, c), mul(d, d)))
    if n[0] == 0.0:  # on the vertical there is no angle
        return dd(1.0), dd(0.0)
    return div(c, n), div(d, n)


@jit
def power(c, s, k):
    """(cos kP, sin kP) from (cos P, sin P)."""
    z = (c, s) if k >= 0 else (c, neg(s))
    r = (dd(1.0), dd(0.0))
    k = abs(k)
    while k > 0:
        if k & 1:
            r = cmul(r, z)
        z = cmul(z, z)
        k >>= 1
    return r


@jit
def time_step(q, period, turn, h):
    """(λ, m, rotation) of the exact flow over time h on a torus, for |h| < 1e15 periods; all double-doubles.

    First take the two-point step with (λ, m), then the rotation (cos, sin) about e3. h is reduced modulo the period to [−T/2,
    T/2], where |λ| is moderate. A negative remainder takes the inverse step, (λ, −m). If η = 0, there is only the rotation.

    q : spectral polynomial of the torus. period : of nutation. turn : (cos, sin) of the precession in a nutation, read only if
    |h| > period/2.
    """
    r, rotation = dd(h), (dd(1.0), dd(0.0))
    turns = np.rint(h / period[0])  # 0 for an infinite period
    if turns != 0.0:
        r = sub(r, mul(period, dd(turns)))
        rotation = power(turn[0], turn[1], int(turns))
    if r[0] == 0.0:
        return (dd(0.0), dd(0.0)), (dd(1.0), dd(0.0)), rotation
    if r[0] > 0.0:
        lam, m = parameter(q, r)
    else:
        lam, m = parameter(q, neg(r))
        m = (neg(m[0]), neg(m[1]))
    return lam, m, rotation


@jit
def torus(alpha, y, longest):
    """(q, period, turn) of the torus of y, for time steps up to `longest`; see `time_step`."""
    q = spectral_polynomial(alpha, y)
    period = nutation_period(alpha, y)
    turn = (dd(1.0), dd(0.0))
    if longest > 0.49 * period[0]:
        turn = precession(q, alpha, y, period)
    return q, period, turn


@jit
def exact_flow(alpha, y, times):
    """The exact states (n, 6) at any times. Each is one two-point map away from y; all is in double-double."""
    longest = 0.0
    for t in times:
        longest = max(longest, abs(t))
    q, period, turn = torus(alpha, y, longest)
    start_state = (dd(y[0]), dd(y[1]), dd(y[2]), dd(y[3]), dd(y[4]), dd(y[5]))
    out = np.empty((len(times), 6))
    for i in range(len(times)):
        lam, m, rotation = time_step(q, period, turn, times[i])
        s = start_state
        if lam[1][0] > 0.0:
            s = two_point_dd(alpha, s, lam, m)
        c, d = rotation
        out[i, 0], out[i, 1] = sub(mul(c, s[0]), mul(d, s[1]))[0], add(mul(d, s[0]), mul(c, s[1]))[0]
        out[i, 3], out[i, 4] = sub(mul(c, s[3]), mul(d, s[4]))[0], add(mul(d, s[3]), mul(c, s[4]))[0]
        out[i, 2], out[i, 5] = s[2][0], s[5][0]
    return out


@jit
def curve_point(alpha, y, R, eta, guess_re, guess_im):
    """Q and m = √Q(λ) in double-double, for any double λ = R + iη. guess : a few digits of m, which choose its sign."""
    q = spectral_polynomial(alpha, y)
    Q = horner(q, (dd(R), dd(eta)))
    m = (dd(guess_re), dd(guess_im))
    if guess_re * guess_re + guess_im * guess_im > 0.0:
        near = np.sqrt(complex(Q[0][0], Q[1][0]))
        if near.real * guess_re + near.imag * guess_im < 0.0:
            near = -near
        m = (dd(near.real), dd(near.imag))
        for _ in range(2 if near != 0.0 else 0):  # Newton's method
            c = cdiv(Q, m)
            m = (scale(add(m[0], c[0]), 0.5), scale(add(m[1], c[1]), 0.5))
    return q, m
