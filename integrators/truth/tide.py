"""The orbit of a top in alpha x3 + k x3²/2, a vertical tide: its closed-form solution, in mpmath, as in `truth.orbit`.

With m = J3, l = x·J, s = |x|, J+ = J1 + iJ2, x+ = x1 + ix2 the equations of motion give a quartic,

    x3'² = f(x3) = (2H - m² - 2 alpha x3 - k x3²)(s² - x3²) - (l - m x3)²,      J = (x × x' + l x)/s².

Let x3 be smallest, `low`, at r = 0. Then e(x3) = f'(low)/(4 (x3 - low)) is Weierstrass' function of r, up to a constant. Its
periods are T, that of the nutation, and iT'; if only two roots of f are real, T and (T + iT')/2. Of the two zeros of
s - x3 one is a zero of x+, at r = a, and so is one of s + x3, at r = b; the poles of both are the same. Therefore

    A = const e^{i lam r} theta1(r - a),      B = const theta1(r - b),      n = |A|² + |B|²,
    x3 = s (|B|² - |A|²)/n,      x+ = 2s A B/n,
    J+ = l x+/s² + 2i (B² W + A² conj(W))/n²,      W = A' conj(B) - A conj(B'),

with theta1 of these periods. |x| = s holds whatever A and B are, and neither the poles nor J+ = 0 nor k = 0 are special.
The ways from `low` down to -s and up to s, through infinity if another root of f is in the way, say where a and b are:
at i eta, or at T/2 + i eta where the way leads through `high`. Up to a factor, with kappa = i pi/T and p = q² or -q,
q = e^{-pi T'/T}; or, after Jacobi's transformation, where T' < T, with kappa = pi/T' and q = e^{-pi T/T'},

    theta1(w) = sinh(kappa w) sum_j C_|j| e^{2j kappa w},      C_j = sum_{n >= j} (-1)^n p^{n(n+1)/2},

p = q² if all roots of f are real. A double root makes p = 0: either T is infinite and the motion homoclinic, or T' is, and
x3 a rational function of cos(2 pi r/T). With a triple root both are, and kappa is 0.

Sources: Whittaker & Watson, 20.6 (e), 21.1 (theta1); Klein & Sommerfeld, Theorie des Kreisels, chapter VI (A and B, as
Cayley-Klein parameters); DLMF 19.25.35 (eta and periods), 20.7.30 (the transformation). All tested against the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations
from typing import Any, NamedTuple

from mpmath import mp, mpf
from numpy.polynomial.polynomial import polyder, polydiv

from lagrange_bench.integrators.truth.orbit import (
    Orbit,
    State,
    Vector,
    dot,
    horner,
    precession_rate,
    real,
    reals,
    steady,
    units,
    weight,
)  # fmt: skip
from lagrange_bench.support.precision import workdps


class Factor(NamedTuple):
    """((odd sinh(kappa r)/kappa + even cosh(kappa r)) e^{-kappa r} + rest) sum exp(logs + rates r), for r >= 0."""

    odd: Any
    even: Any
    rest: Any
    logs: Vector
    rates: Vector


class Tide(NamedTuple):
    """Motion by the time r since x3 was smallest, |r| <= period/2; the whole turns about e3 at a rate of its own."""

    period: Any  # inf on the separatrix
    t0: Any  # a time at which x3 is smallest; at which it is 0 on the way from pole to pole
    turn: Any  # rate
    phase: Any
    J3: Any
    spin: Any  # l/s²
    size: Any  # s
    kappa: Any
    A: Factor
    B: Factor
    rising: Any = False  # from pole to pole: x3 is an odd function of r


def position(c: Tide, r: Any, functions: Any) -> tuple[Any, Any, Any]:
    """J+, x+ and x3 at times r, but for the turn and the phase.

    `c` holds doubles and r is an array, or `c` and r are of mpmath; `functions` is numpy or mp.
    """
    (A, dA), (B, dB) = (evaluate(part, c.kappa, abs(r), functions) for part in (c.A, c.B))
    a, b = (part.real * part.real + part.imag * part.imag for part in (A, B))
    n, W = a + b, dA * B.conjugate() - A * dB.conjugate() + 1j * c.turn * A * B.conjugate()
    x, x3 = 2 * c.size * (A * B) / n, c.size * (b - a) / n
    J = c.spin * x + 2j * (B * B * W + A * A * W.conjugate()) / (n * n)
    side = 1 - 2 * (r < 0)
    if c.rising:
        return J, x, side * x3
    # reversing time about the lowest point reflects the motion in the vertical plane through it
    return J.real + 1j * (side * J.imag), x.real + 1j * (side * x.imag), x3


def evaluate(c: Factor, kappa: Any, r: Any, functions: Any) -> tuple[Any, Any]:
    """A factor and its derivative by r."""
    rise = functions.expm1(-2 * kappa * r)  # near a triple root kappa r is small, and only differences matter
    sinh, cosh = (-rise / (2 * kappa) if kappa else r), 1 + rise / 2
    first, slope = c.odd * sinh + c.even * cosh + c.rest, (c.odd - kappa * c.even) * (1 + rise)
    terms = [functions.exp(log + rate * r) for log, rate in zip(c.logs, c.rates, strict=True)]
    total, growth = sum(terms), sum(rate * term for rate, term in zip(c.rates, terms, strict=True))
    return first * total, slope * total + first * growth


def find_orbit(alpha: float | Fraction, k: float | Fraction, y0: Sequence[Any], digits: int) -> Orbit:
    """The orbit of `y0`, its constants good to `digits` decimal digits; without roots and the angle of precession."""
    (rate, size), two = units(alpha, y0, k), Fraction(2)
    J, x = (tuple(Fraction(v) * two**-e for v in part) for part, e in ((y0[:3], rate), (y0[3:], size)))
    state = State(Fraction(alpha) * two ** (size - 2 * rate), J, x, Fraction(k) * two ** (2 * (size - rate)))
    if state.velocity == 0 and state.acceleration == 0:
        speed = precession_rate(state)
        with workdps(digits + 15):
            motion: Any = steady(state, speed)
        return Orbit("precession" if speed else "equilibrium", motion, (), motion.period, mpf("nan"), rate, size)
    places = find_places(state, digits)
    sign = 1
    if abs(places.slope(places.low)) < abs(places.slope(places.high)) or (places.crossing and state.velocity < 0):
        # time counts from the sharper turn, where it must be known best; from pole to pole x3 rises
        sign, state = -1, State(-state.alpha, J, tuple(-v for v in x), state.k)
        places = find_places(state, digits)
    with workdps(places.working):
        motion = crossing(state) if places.crossing else nutating(state, places, digits)
        motion = motion._replace(phase=phase(state, motion))
    regime = "elliptic" if mp.isfinite(motion.period) else "homoclinic"
    return Orbit(regime, motion, (), motion.period, mpf("nan"), rate, size, sign)


def phase(state: State, c: Tide) -> mpf:
    """The angle that puts J+ and x+ right at t = 0, by whichever of them is not small."""
    J, x, _ = position(c, -c.t0, mp)
    (J1, J2, _), (x1, x2, _) = reals(*state.J), reals(*state.x)
    rate = real(dot(state.J, state.J) + abs(state.alpha) + abs(state.k))
    return mp.arg(J.conjugate() * mp.mpc(J1, J2) * real(state.c1) + x.conjugate() * mp.mpc(x1, x2) * rate)


# ---------------------------------------------------------------- the quartic


class Places(NamedTuple):
    """The roots of f, those that are finite, and what lies among them: what is on a root is the same object."""

    f: Vector  # by increasing power
    roots: Vector  # double ones twice
    low: mpf
    high: mpf
    top: mpf  # s, -s and x3 at t = 0
    bottom: mpf
    start: mpf
    working: int  # digits

    @property
    def others(self) -> list[Any]:
        """The two roots besides `low` and `high`."""
        others = [*self.roots, mp.inf, mp.inf]
        others.remove(self.low)
        others.remove(self.high)
        return others[:2]

    @property
    def crossing(self) -> bool:
        """Whether both turns are double roots: f = k (s² - x3²)², on the way from pole to pole."""
        return self.low in self.others and self.high in self.others

    def slope(self, x3: mpf) -> mpf:
        """f'."""
        with workdps(self.working):
            return horner(reals(*polyder(self.f)), x3)

    def e(self, x3: Any) -> Any:
        """e of x3; -inf at `low`."""
        if x3 == self.low:
            return -mp.inf
        return self.slope(self.low) / 4 / (x3 - self.low)


def find_places(state: State, digits: int) -> Places:
    """Places to `digits` digits of their distances: the working precision is raised by what these cancel."""
    alpha, k, H, l, m, c1 = state.alpha, state.k, state.H, state.l, state.m, state.c1
    f = (2 * H - m**2) * c1 - l**2, 2 * (l * m - alpha * c1), -2 * H - k * c1, 2 * alpha, k
    working = digits + 15
    while True:
        with workdps(3 * working):
            found, s = roots(f), mp.sqrt(real(c1))
            top, bottom = (on_root(pole * s, found, weight(state, pole) == 0) for pole in (1, -1))
            start = on_root(real(state.x[2]), found, state.velocity == 0)
            smallest = min(abs(a - b) for a, b in combinations((*found, top, bottom, start), 2) if a is not b)
        if smallest > mpf(10) ** (digits + 5 - working):
            break
        working *= 2
    line, turning = [v for v in found if isinstance(v, mpf)], state.acceleration
    low = max(v for v in line if v < start or (v is start and turning > 0))
    high = min(v for v in line if v > start or (v is start and turning < 0))
    return Places(f, found, low, high, top, bottom, start, 2 * working)


def on_root(x3: mpf, found: Vector, exactly: bool) -> mpf:
    return min(found, key=lambda root: abs(root - x3)) if exactly else x3


def roots(f: Sequence[Fraction]) -> Vector:
    """Roots of a polynomial with rational coefficients, mpf where they are real; one of order n is n times the same object."""
    f = f[: 1 + max(i for i, c in enumerate(f) if c)]
    if len(f) == 1:
        return ()
    repeated: Any = f
    rest: Any = polyder(f)
    while any(rest):  # Euclid: what f has in common with f'
        repeated, rest = rest, polydiv(repeated, rest)[1]
    simple: Vector = tuple(laguerre(reals(*polydiv(f, repeated)[0])))
    # the distance of two that are conjugate is twice that from the real line
    gaps = [min((abs(z - y) for y in simple if y is not z), default=mp.inf) for z in simple]
    simple = tuple(z.real if 4 * abs(z.imag) < gap else z for z, gap in zip(simple, gaps, strict=True))
    return (*simple, *(on_root(root, simple, True) for root in roots(repeated)))


def laguerre(f: Any) -> list[Any]:
    """Roots of a polynomial, all of them simple, one by one (Laguerre's method), as well as the digits allow."""
    found = []
    while (n := len(f) - 1) > 0:
        z, f1, f2 = mp.mpc(0.1, 0.07), polyder(f), polyder(f, 2)
        for _ in range(mp.prec):
            value, slope, bend = (horner(c, z) for c in (f, f1, f2))
            if abs(value) <= 16 * mp.eps * horner([abs(c) for c in f], abs(z)):  # rounding
                break
            root = mp.sqrt(((n - 1) * slope) ** 2 - n * (n - 1) * value * bend)
            z -= n * value / max(slope + root, slope - root, key=abs)
        found.append(z)
        f = polydiv(f, (-z, mpf(1)))[0]
    return found


# ---------------------------------------------------------------- elliptic motion and its limits


class Lattice(NamedTuple):
    """e of the other three roots, the largest or the real one first, and what theta1 needs."""

    e: Vector
    real: bool  # all roots are real
    period: mpf  # T
    kappa: Any
    logs: Vector  # of C_0, C_1, …


def lattice(at: Places, digits: int) -> Lattice:
    e1, e2, e3 = map(at.e, (at.high, *at.others))
    if all_real := isinstance(e2, mpf) and isinstance(e3, mpf):
        e2, e3 = max(e2, e3), min(e2, e3)
    base = e3 if all_real else e1
    period, dual = 2 * carlson(0, e1 - e2, e1 - e3), 2 * carlson(e1 - base, e2 - base, e3 - base)
    shorter, longer = min(period, dual), max(period, dual)
    if mp.isinf(shorter):
        return Lattice((e1, e2, e3), all_real, period, mpf(0), (mpf(0),))
    q = mp.exp(-mp.pi * longer / shorter)
    p, n = q * q if all_real else -q, 0
    while p and abs(p) ** (n * (n - 1) // 2) > mpf(10) ** -(digits + 15):
        n += 1
    terms = [(-1) ** i * p ** (i * (i + 1) // 2) for i in range(n + 1)]
    logs = tuple(mp.log(mp.mpc(mp.fsum(terms[j:]))) for j in range(n + 1))
    return Lattice((e1, e2, e3), all_real, period, (1j if period <= dual else 1) * mp.pi / shorter, logs)


def carlson(*squares: Any) -> mpf:
    """R_F, real here."""
    return mp.inf if squares.count(0) > 1 else mp.re(mp.elliprf(*squares))


def factor(c: Lattice, at: Places, pole: mpf, D: mpf) -> Factor:
    """A or B, with |A|² = s - x3 or |B|² = s + x3 at r = 0, where A and B are real.

    D : m s - l for A, -(m s + l) for B; its sign says which of the two zeros of s - x3 or s + x3 is that of x+.
    """
    (e1, e2, e3), kappa, n = c.e, c.kappa, len(c.logs) - 1
    e = at.e(pole)
    if by_high := c.real and (e == e1 or e > (e2 + e3) / 2):
        e = e1 - (e1 - e2) * (e1 - e3) / (e1 - e) if e != e1 else -mp.inf  # half a period later
    eta = mpf(0) if mp.isinf(e) else carlson(e1 - e, e2 - e, e3 - e)
    side = 1 if (D > 0) == by_high else -1
    odd = even = rest = mpf(0)
    apart = [(mpf(0), mpf(0))]  # exponentials that sinh(kappa (r - a)) consists of
    shift = 1j * kappa * side * eta if mp.isfinite(eta) else mpf(0)
    if by_high:
        rest = mpf(1)
        if kappa:
            apart = [(shift + 1j * mp.pi, -kappa), (-shift - kappa * c.period, kappa)][: 1 + mp.isfinite(c.period)]
    elif mp.isinf(eta):  # a double root of f at the pole: a single exponential
        odd, even = mpf(1), side / kappa
    else:
        odd, even = mp.cosh(shift), -mp.sinh(shift) / kappa if kappa else -1j * side * eta
    place = shift + (kappa * c.period / 2 if by_high and n else 0)
    terms = [
        (c.logs[abs(j)] - (2 * j * place if j else 0) + log, 2 * j * kappa + rate)
        for j in range(-n, n + 1)
        for log, rate in apart
    ]
    plain = Factor(odd, even, rest, *map(tuple, zip(*terms, strict=True)))
    value, slope = evaluate(plain, kappa, mpf(0), mp)
    if value:
        scale = mp.sqrt(abs(pole - at.low)) * value.conjugate() / abs(value) ** 2
    else:
        scale = 1j * mp.sqrt(at.slope(at.low)) / (2 * abs(slope))  # x3 - low = f' r²/4
    return plain._replace(odd=scale * odd, even=scale * even, rest=scale * rest)


def nutating(state: State, at: Places, digits: int) -> Tide:
    """`phase` is left out."""
    c, s = lattice(at, digits), mp.sqrt(real(state.c1))
    up, down = weight(state, 1), weight(state, -1)
    A, B = factor(c, at, at.top, up), factor(c, at, at.bottom, -down)
    # the rates of arg A and arg B are these where x3 is stationary, and the rest is that of theta1
    lam = up / (2 * (at.top - at.low)) + down / (2 * (at.high - at.bottom))
    lam -= logarithmic_slope(A, c.kappa, mpf(0))
    if finite := mp.isfinite(c.period):
        lam -= logarithmic_slope(B, c.kappa, c.period / 2)
    e = at.e(at.start)
    since = mpf(0) if mp.isinf(e) else carlson(*(e - v for v in c.e))
    t0, zero = since if state.velocity < 0 else -since, mpf(0)
    motion = Tide(c.period, t0, zero, zero, real(state.m), real(state.l / state.c1), s, c.kappa, turning(A, lam), B)
    turn = lam
    if finite:  # the half of the angle in a period, but for whole turns
        J, x, _ = position(motion, c.period / 2, mp)
        turn = 2 * mp.arg(max(J, x, key=abs)) / c.period
        turn += mp.nint((lam - turn) * c.period / (2 * mp.pi)) * 2 * mp.pi / c.period
    return motion._replace(turn=turn, A=turning(A, lam - turn))


def logarithmic_slope(part: Factor, kappa: Any, r: mpf) -> mpf:
    """Rate of arg."""
    value, slope = evaluate(part, kappa, r, mp)
    return mp.im(slope / value)


def turning(part: Factor, rate: mpf) -> Factor:
    """`part` times e^{i rate r}."""
    return part._replace(rates=tuple(v + 1j * rate for v in part.rates))


def crossing(state: State) -> Tide:
    """x3 = s tanh(kappa r) in a plane, from the lower pole to the upper one; `phase` is left out."""
    s, zero, (k, x3) = mp.sqrt(real(state.c1)), mpf(0), reals(state.k, state.x[2])
    kappa = mp.sqrt(k) * s
    A, B = (Factor(zero, zero, mpf(1), (zero,), (rate,)) for rate in (-kappa, zero))
    return Tide(mp.inf, -mp.atanh(x3 / s) / kappa, zero, zero, zero, zero, s, kappa, A, B, rising=True)
