"""The exact step over h in rational form, by the addition theorems of Weierstrass' and Lamé's functions.

Y(t) = alpha x3/2 satisfies Y'² = 4Y³ − 2HY² + G1 Y + G0, so Y = ℘ + H/6. J+ = J1 + iJ2 obeys J+' = i alpha x+. Freed of a
rotation, u = J+ e^{−i J3 t/2}, it obeys Lamé's equation u'' = (2Y − J3²/4) u. Over a step h,

    u(t + h) = M11 u + M12 u',    μ = (Y'(h) − Y'(t)) / (2 (Y(h) − Y(t)))
    M11 = −c1 (Y(h) − J3²/4 + Y(t)) − c0 μ        M12 = c0 + c1 μ        Y(t + h) = μ² − Y(t) − Y(h) + H/2.

Y(h) is the solution with the pole at h = 0. The constants are c1 = −φ(h)/3 and c0 = φ'(h)/3, with the solution φ ~ h² of Lamé's
equation. All three depend on the torus and on h only. (M12 is an elliptic function of t. It has simple poles where Y(t) or
Y(t + h) has a pole, so it is linear in μ. The rest follows from M' = A(t + h) M − M A(t), A = (0, 1; 2Y − J3²/4, 0).) On real
orbits Y(h) > Y(t), so this denominator does not vanish. The familiar quotient of elliptic functions divides by x+, which may.

In x3, x+ = x1 + ix2 and J+ nothing is divided by alpha. With p = 1/Y(h), n = −p', χ = φ/p and
e = (n x3 − p x3')/(2 − alpha p x3) all updates are increments of size h, and h = 0, p = 0 is a regular point.

Off the torus the map is not the flow, and leads further off exponentially. So the state is moved back onto H, C1 and C2 every few
steps, or in every step if h is long. Near the separatrix a long step may take Y(h) close to the largest Y(t) of the orbit. Then
the denominator loses the digits of x3, and the step is refused. The constants of a still longer step have no digits, and lead to
rows off the torus. Such rows are refused, too.

Set-up, in double-double: p and φ come from their power series at h/2^k. Then k doublings follow: the formulas above with t = h. h
is taken modulo the nutation period; a whole period is a rotation about e3, `time_step.precession`.

Sources: Whittaker & Watson, A Course of Modern Analysis, 20.3 and 23.7; DLMF 23.10, 29.2; matrix form: this project.
"""

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import (
    add,
    cadd,
    cmul,
    cscale,
    dd,
    div,
    mul,
    neg,
    scale,
    small_turn,
    sub,
)
from lagrange_bench.integrators.compiling.loops import FixedStepper, Kernel
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus import time_step as ts
from lagrange_bench.integrators.torus.real_map import ALPHA, C1, C1_LO, C2, C2_LO, H_LO, J3_2, H
from lagrange_bench.integrators.torus.real_map import CONSTANTS as TORUS

# places of the constants, behind those of the torus; complex ones take two
HALF_N, HALF_P, HALF_ALPHA_P, HALF_ALPHA, D0, D1, D2 = range(TORUS, TORUS + 7)
G, GX, GE, GE_X, K1, K2, K3, L = range(TORUS + 7, TORUS + 23, 2)
SIZE = L + 2

TERMS = 9  # of the power series in h²
START = 2.0**-8  # longest time of the series, in units of 1/(|J| + √(|alpha||x|)) up to a factor two

LONG = 0.5  # from this |h| on, in the same units, every step moves the state back onto its torus
UNSTABLE = 1.0  # times up to which no unstable orbit has gone far
LEAST = 1e-3  # least 1 − Y(t)/Y(h)

ZERO, ONE = (0.0, 0.0), (1.0, 0.0)


@jit
def step(s, c, counters):
    """The map. a1 + i a2 and so on are complex numbers; x3' = v."""
    J1, J2, J3, x1, x2, x3 = s
    v = J1 * x2 - J2 * x1  # x3'
    r = 1.0 / (1.0 - c[HALF_ALPHA_P] * x3)
    e = (c[HALF_N] * x3 - c[HALF_P] * v) * r
    d = (c[D0] + c[HALF_ALPHA] * (e * e)) + ((c[D1] + c[D2] * x3) * x3 - c[HALF_N] * v) * r
    z = x3 + d
    # J+ += a J+ − alpha k x+,  x+ += b x+ + f J+
    a1 = (c[G] + c[GE] * e) + c[L + 1] * x3
    a2 = (c[G + 1] + c[GE + 1] * e) - c[L] * x3
    b1 = (c[GX] + c[GE_X] * e) + c[L + 1] * z
    b2 = (c[GX + 1] + c[GE_X + 1] * e) - c[L] * z
    k1 = c[K1] + c[L] * e
    k2 = c[K1 + 1] + c[L + 1] * e
    f1 = k1 * x3 + (c[K2] * d - c[K3] * v)
    f2 = k2 * x3 + (c[K2 + 1] * d - c[K3 + 1] * v)
    return (
        J1 + ((a1 * J1 - a2 * J2) - c[ALPHA] * (k1 * x1 - k2 * x2)),
        J2 + ((a1 * J2 + a2 * J1) - c[ALPHA] * (k1 * x2 + k2 * x1)),
        J3,
        x1 + ((b1 * x1 - b2 * x2) + (f1 * J1 - f2 * J2)),
        x2 + ((b1 * x2 + b2 * x1) + (f1 * J2 + f2 * J1)),
        z,
    )


# ------------------------------------------------------------------------------------ constants, in double-double


@unrolled
def cubic(alpha, y):
    """The torus: H, J3, C1, C2; c1, c0 of x3'² = 2 alpha x3³ − 2H x3² + c1 x3 + c0; G1 = alpha c1/2, G0 = alpha² c0/4."""
    q = ts.spectral_polynomial(alpha, y)
    H_, m, C1_, C2_, a = scale(q[2], 0.5), dd(y[2]), q[0], scale(q[1], 0.5), dd(alpha)
    c1 = scale(sub(mul(C2_, m), mul(a, C1_)), 2.0)
    c0 = sub(mul(C1_, sub(q[2], mul(m, m))), mul(C2_, C2_))
    return H_, m, C1_, C2_, c1, c0, scale(mul(a, c1), 0.5), scale(mul(mul(a, a), c0), 0.25)


@unrolled
def bracket(p, H_, G1, G0):
    """p'²/p = 4 − 2Hp + G1 p² + G0 p³."""
    return add(dd(4.0), mul(p, add(scale(H_, -2.0), mul(p, add(G1, mul(p, G0))))))


@jit
def product(a, b, j, low):
    """Coefficient j of the product of two series whose coefficients start at `low`."""
    s = dd(0.0)
    for i in range(low, j - low + 1):
        s = add(s, mul((a[i, 0], a[i, 1]), (b[j - i, 0], b[j - i, 1])))
    return s


@jit
def start(torus, h):
    """p, p', φ, φ' and e^{i J3 h/2} for a small h, from power series in h².

    They solve p'' = 2 − 2Hp + 3 G1 p²/2 + 2 G0 p³ and p φ'' = (2 − J3² p/4) φ.
    """
    H_, m, C1_, C2_, c1, c0, G1, G0 = torus
    quarter = scale(mul(m, m), 0.25)
    p, f, pp = np.zeros((TERMS + 1, 2)), np.zeros((TERMS + 1, 2)), np.zeros((TERMS + 1, 2))
    p[1, 0] = f[1, 0] = 1.0
    for j in range(1, TERMS):
        pp[j, 0], pp[j, 1] = product(p, p, j, 1)
        s = add(scale(mul(H_, (p[j, 0], p[j, 1])), -2.0), mul(mul(dd(1.5), G1), (pp[j, 0], pp[j, 1])))
        s = add(s, scale(mul(G0, product(p, pp, j, 1)), 2.0))
        p[j + 1, 0], p[j + 1, 1] = div(s, dd((2.0 * j + 2.0) * (2.0 * j + 1.0)))
        s = mul(quarter, product(p, f, j + 1, 1))
        for i in range(2, j + 2):
            k = j + 2 - i
            s = add(s, mul(mul((p[i, 0], p[i, 1]), (f[k, 0], f[k, 1])), dd(2.0 * k * (2.0 * k - 1.0))))
        f[j + 1, 0], f[j + 1, 1] = neg(div(s, dd((2.0 * j + 2.0) * (2.0 * j + 1.0) - 2.0)))
    hh = mul(h, h)
    P = dP = F = dF = ZERO
    for j in range(TERMS, 0, -1):
        P, F = add(mul(P, hh), (p[j, 0], p[j, 1])), add(mul(F, hh), (f[j, 0], f[j, 1]))
        dP = add(mul(dP, hh), mul((p[j, 0], p[j, 1]), dd(2.0 * j)))
        dF = add(mul(dF, hh), mul((f[j, 0], f[j, 1]), dd(2.0 * j)))
    return mul(P, hh), mul(dP, h), mul(F, hh), mul(dF, h), small_turn(scale(mul(m, h), 0.5), TERMS + 4)


@unrolled
def double_time(torus, p, dp, f, df, turn):
    """The values of `functions` at 2h, from those at h: t = h in the formulas of the module's docstring."""
    H_, m, C1_, C2_, c1, c0, G1, G0 = torus
    quarter = scale(mul(m, m), 0.25)
    Hp, pp = mul(H_, p), mul(p, p)
    Y = div(ONE, p)
    dY = neg(div(dp, pp))
    mu = neg(div(add(sub(dd(3.0), Hp), scale(mul(G1, pp), 0.25)), dp))  # Y''/(2Y')
    B = bracket(p, H_, G1, G0)
    p3 = mul(pp, p)
    G11 = add(scale(mul(G1, G1), 0.0625), scale(mul(H_, G0), 0.5))
    N = sub(ONE, sub(add(scale(mul(G1, pp), 0.5), scale(mul(G0, p3), 2.0)), mul(G11, mul(pp, pp))))
    dN = add(neg(add(mul(G1, p), mul(mul(dd(6.0), G0), pp))), scale(mul(G11, p3), 4.0))
    dpB = add(sub(dd(4.0), scale(Hp, 4.0)), add(mul(mul(dd(3.0), G1), pp), scale(mul(G0, p3), 4.0)))
    p2 = div(mul(p, B), N)
    dp2 = scale(mul(dp, div(sub(mul(dpB, N), mul(mul(p, B), dN)), mul(N, N))), 0.5)
    V = sub(scale(Y, 2.0), quarter)
    V2 = add(Y, sub(div(ONE, p2), quarter))
    ff, fd, d2 = mul(f, f), scale(mul(f, df), 2.0), mul(df, df)
    three = dd(3.0)
    f2 = div(add(sub(mul(V, ff), mul(mu, fd)), d2), three)
    df2 = div(sub(sub(mul(V2, fd), mul(mu, d2)), mul(ff, sub(mul(mu, V), dY))), three)
    return p2, dp2, f2, df2, cmul(turn, turn)


@jit
def functions(torus, h):
    """p, p', φ, φ' and e^{i J3 h/2} for |h| up to half a nutation period."""
    doublings = 0
    while abs(h[0]) > START:
        h = scale(h, 0.5)
        doublings += 1
    p, dp, f, df, turn = start(torus, h)
    for _ in range(doublings):
        p, dp, f, df, turn = double_time(torus, p, dp, f, df, turn)
    return p, dp, f, df, turn


@jit
def coefficients(alpha, torus, values, turn):
    """All constants of a step, as double-doubles: seven real ones, then eight complex ones, turned about e3 by `turn`."""
    H_, m, C1_, C2_, c1, c0, G1, G0 = torus
    p, dp, f, df, half_turn = values
    eps = cmul(half_turn, turn)
    X, dX = ONE, ZERO  # χ = φ/p and its derivative
    if p[0] != 0.0:
        X = div(f, p)
        dX = div(sub(df, mul(dp, X)), p)
    one_third = div(ONE, dd(3.0))
    a, half_m = dd(alpha), scale(m, 0.5)
    k1, k0 = neg(mul(f, one_third)), mul(df, one_third)  # c1 and c0 of M
    S = add(scale(mul(dp, X), 0.5), mul(mul(p, dX), one_third))
    pp = mul(p, p)
    inner = sub(ONE, mul(p, mul(add(scale(mul(m, m), 0.25), H_), one_third)))
    inner = add(inner, mul(scale(mul(pp, add(G1, mul(p, G0))), 0.5), one_third))
    a0 = add(mul(X, inner), scale(mul(mul(dX, dp), one_third), 0.5))
    mS = mul(half_m, S)
    reals = (
        scale(dp, -0.5),
        scale(p, 0.5),
        scale(mul(a, p), 0.5),
        scale(a, 0.5),
        mul(p, add(scale(c1, 0.25), scale(mul(mul(a, c0), p), 0.125))),
        sub(scale(bracket(p, H_, G1, G0), 0.5), dd(2.0)),
        mul(a, p),
    )
    minus_one = (dd(-1.0), ZERO)
    g = cadd(cmul(eps, (a0, neg(mS))), minus_one)
    gx = cadd(cmul(eps, (a0, mS)), minus_one)
    ge = cscale(cmul(eps, (k0, mul(half_m, k1))), scale(a, -0.5))
    ge_x = cscale(cmul(eps, (k0, neg(mul(half_m, k1)))), scale(a, -0.5))
    minus_i_eps = (eps[1], neg(eps[0]))
    first = cscale(minus_i_eps, S)
    second = cscale(cmul(minus_i_eps, (k0, mul(half_m, k1))), dd(0.5))
    third = cscale(minus_i_eps, scale(k1, 0.5))
    return reals, (g, gx, ge, ge_x, first, second, third, cscale(third, a))


@jit
def constants(alpha, y, h):
    """The constants of `step` on the torus of y, and the least denominator. Computed in double-double, rounded once."""
    torus = cubic(alpha, y)
    period = ts.nutation_period(alpha, y)
    turn, r = (ONE, ZERO), dd(h)
    periods = np.rint(h / period[0])  # 0 for an infinite period
    if periods != 0.0:
        r = sub(r, mul(period, dd(periods)))
        c, s = ts.precession(ts.spectral_polynomial(alpha, y), alpha, y, period)
        turn = ts.power(c, s, int(periods))
    reals, complexes = coefficients(alpha, torus, functions(torus, r), turn)
    c = np.zeros(SIZE)
    c[ALPHA], c[J3_2] = alpha, 2.0 * y[2]
    c[H], c[H_LO] = torus[0]
    c[C1], c[C1_LO] = torus[2]
    c[C2], c[C2_LO] = torus[3]
    for k, number in enumerate(reals):
        c[HALF_N + k] = number[0]
    for k, (re, im) in enumerate(complexes):
        c[G + 2 * k], c[G + 2 * k + 1] = re[0], im[0]
    least_denominator = 1.0
    if abs(r[0]) > UNSTABLE:
        least_denominator -= c[HALF_P] * (alpha * y[5] + ts.nutation_roots(alpha, y)[1][0])
    return c, least_denominator


class AdditionStepper(real_map.TorusStepper):
    """Refuses rows off the torus. The map leaves it if h is so long that the constants have no digits."""

    def rows(self, out: Array, every: int) -> Array:
        count = real_map.rows_on_torus(out, self.constants, real_map.OFF_TORUS)
        if count < len(out):
            reason = "the map has left the torus: h is too long so near the separatrix"
            raise StepError(self.name, reason, h=self.h, step=count * every)
        return super().rows(out, every)


def prepare(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """The exact step over h."""
    name = "addition_theorem"
    units = Units(top, y0, h)
    state, span = units.enter(y0), units.span(name, h)
    c, least_denominator = constants(units.alpha, tuple(state.tolist()), span)
    if not (least_denominator >= LEAST and np.all(np.isfinite(c))):
        raise StepError(name, "h is too long so near the separatrix: the denominator of the map nearly vanishes", h=h)
    kernel = Kernel(step, real_map.restore_invariants, 8 if abs(span) < LONG else 1)
    return AdditionStepper(name, h, kernel, c, units)


METHOD = Method(
    name="addition_theorem",
    label="Addition theorem",
    family="closed-form",
    order=None,
    claims=Claims(symmetric=True, poisson=True, conserves={"H", "J3", "C1", "C2"}),
    source="Whittaker and Watson, A Course of Modern Analysis, 20.3 and 23.7; matrix form: this project",
    prepare=prepare,
)
