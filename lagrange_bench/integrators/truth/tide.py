"""The closed form of the orbit of a top in alpha x3 + k x3²/2, a vertical tide, in mpmath; compare `truth.orbit`.

With m = J3, l = x·J, s = |x|, J+ = J1 + iJ2, x+ = x1 + ix2 the equations of motion give a quartic,

    x3'² = f(x3) = (2H - m² - 2 alpha x3 - k x3²)(s² - x3²) - (l - m x3)²,      J = (x × x' + l x)/s².

Let x3 be smallest, `low`, at r = 0. Then e(x3) = f'(low)/(4 (x3 - low)) is Weierstrass' function of r, up to a constant. Its
periods are T, the period of the nutation, and iT'; if only two roots of f are real, T and (T + iT')/2. s - x3 and s + x3 have two
zeros each, of which one is a zero of x+: r = a and r = b. Both have the same poles. Therefore

    A = const e^{i lam r} theta1(r - a),      B = const theta1(r - b),      n = |A|² + |B|²,
    x3 = s (|B|² - |A|²)/n,      x+ = 2s A B/n,
    J+ = l x+/s² + 2i (B² W + A² conj(W))/n²,      W = A' conj(B) - A conj(B'),

with theta1 of these periods. |x| = s holds for any A and B, and the poles, J+ = 0 and k = 0 are no special cases.

To find a and b, go from `low` down to -s and up to s, and through infinity if another root of f is in the way. They are at
i eta, or at T/2 + i eta if the way leads through `high`. Up to a factor,

    theta1(w) = sinh(kappa w) sum_j C_|j| e^{2j kappa w},      C_j = sum_{n >= j} (-1)^n p^{n(n+1)/2},

with kappa = i pi/T and q = e^{-pi T'/T}; or, if T' < T, after Jacobi's transformation, with kappa = pi/T' and q = e^{-pi T/T'}.
p = q² if all roots of f are real, else p = -q. A double root makes p = 0: then T is infinite and the motion homoclinic, or T' is
infinite and x3 is a rational function of cos(2 pi r/T). With a triple root both are infinite, and kappa is 0.

Sources: Whittaker & Watson, 20.6 (e), 21.1 (theta1); Klein & Sommerfeld, Theorie des Kreisels, chapter VI (A and B, as
Cayley-Klein parameters); DLMF 19.25.35 (eta and periods), 20.7.30 (the transformation). All are tested against the equations of
motion.
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
    """A motion as a function of the time r since x3 was smallest, |r| <= period/2. It turns about e3 at a constant rate."""

    period: Any  # inf on the separatrix
    t0: Any  # a time at which x3 is smallest; from pole to pole, the time at which x3 is 0
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
    """J+, x+ and x3 at times r, without the turn and the phase.

    c, r : doubles and an array, or mpmath numbers. functions : numpy or mp, as these are.
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
    """The value of a factor, and its derivative by r."""
    rise = functions.expm1(-2 * kappa * r)  # near a triple root kappa r is small
    sinh, cosh = (-rise / (2 * kappa) if kappa else r), 1 + rise / 2
    first, slope = c.odd * sinh + c.even * cosh + c.rest, (c.odd - kappa * c.even) * (1 + rise)
    terms = [functions.exp(log + rate * r) for log, rate in zip(c.logs, c.rates, strict=True)]
    total, growth = sum(terms), sum(rate * term for rate, term in zip(c.rates, terms, strict=True))
    return first * total, slope * total + first * growth


def find_orbit(alpha: float | Fraction, k: float | Fraction, y0: Sequence[Any], digits: int) -> Orbit:
    """The orbit through `y0`, with constants to `digits` decimal digits; without roots and the angle of precession."""
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
        # time is counted from the sharper turn, where it must be known best; from pole to pole x3 rises
        sign, state = -1, State(-state.alpha, J, tuple(-v for v in x), state.k)
        places = find_places(state, digits)
    with workdps(places.working):
        motion = crossing(state) if places.crossing else nutating(state, places, digits)
        motion = motion._replace(phase=phase(state, motion))
    regime = "elliptic" if mp.isfinite(motion.period) else "homoclinic"
    return Orbit(regime, motion, (), motion.period, mpf("nan"), rate, size, sign)


def phase(state: State, c: Tide) -> mpf:
    """The angle that makes J+ and x+ right at t = 0; the larger of the two counts most."""
    J, x, _ = position(c, -c.t0, mp)
    (J1, J2, _), (x1, x2, _) = reals(*state.J), reals(*state.x)
    rate = real(dot(state.J, state.J) + abs(state.alpha) + abs(state.k))
    return mp.arg(J.conjugate() * mp.mpc(J1, J2) * real(state.c1) + x.conjugate() * mp.mpc(x1, x2) * rate)


# ---------------------------------------------------------------- the quartic


class Places(NamedTuple):
    """The finite roots of f, and places among them. A place that is a root is the same object as the root."""

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
        """Whether both turns are double roots, f = k (s² - x3²)²: the motion from pole to pole."""
        return self.low in self.others and self.high in self.others

    def slope(self, x3: mpf) -> mpf:
        """f' at x3."""
        with workdps(self.working):
            return horner(reals(*polyder(self.f)), x3)

    def e(self, x3: Any) -> Any:
        """e(x3); -inf at `low`."""
        if x3 == self.low:
            return -mp.inf
        return self.slope(self.low) / 4 / (x3 - self.low)


def find_places(state: State, digits: int) -> Places:
    """The places, with distances to `digits` digits. The working precision is raised until cancellation does not matter."""
    alpha, k, H, l, m, c1 = state.alpha, state.k, state.H, state.l, state.m, state.c1
    f = (2 * H - m**2) * c1 - l**2, 2 * (l * m - alpha * c1), -2 * H - k * c1, 2 * alpha, k
    working = digits + 15
    while True:
        with workdps(3 * working):
            zeros, s = roots(f), mp.sqrt(real(c1))
            top, bottom = (on_root(pole * s, zeros, weight(state, pole) == 0) for pole in (1, -1))
            start = on_root(real(state.x[2]), zeros, state.velocity == 0)
            smallest = min(abs(a - b) for a, b in combinations((*zeros, top, bottom, start), 2) if a is not b)
        if smallest > mpf(10) ** (digits + 5 - working):
            break
        working *= 2
    line, acceleration = [v for v in zeros if isinstance(v, mpf)], state.acceleration
    low = max(v for v in line if v < start or (v is start and acceleration > 0))
    high = min(v for v in line if v > start or (v is start and acceleration < 0))
    return Places(f, zeros, low, high, top, bottom, start, 2 * working)


def on_root(x3: mpf, zeros: Vector, exactly: bool) -> mpf:
    return min(zeros, key=lambda root: abs(root - x3)) if exactly else x3


def roots(f: Sequence[Fraction]) -> Vector:
    """Roots of a polynomial with rational coefficients; real ones are mpf. A root of order n is n times the same object."""
    f = f[: 1 + max(i for i, c in enumerate(f) if c)]
    if len(f) == 1:
        return ()
    repeated: Any = f
    rest: Any = polyder(f)
    while any(rest):  # Euclid: the common divisor of f and f'
        repeated, rest = rest, polydiv(repeated, rest)[1]
    simple: Vector = tuple(laguerre(reals(*polydiv(f, repeated)[0])))
    # the distance of two that are conjugate is twice that from the real line
    gaps = [min((abs(z - y) for y in simple if y is not z), default=mp.inf) for z in simple]
    simple = tuple(z.real if 4 * abs(z.imag) < gap else z for z, gap in zip(simple, gaps, strict=True))
    return (*simple, *(on_root(root, simple, True) for root in roots(repeated)))


def laguerre(f: Any) -> list[Any]:
    """Roots of a polynomial with simple roots, one by one (Laguerre's method), to all digits."""
    zeros = []
    while (n := len(f) - 1) > 0:
        z, f1, f2 = mp.mpc(0.1, 0.07), polyder(f), polyder(f, 2)
        for _ in range(mp.prec):
            value, slope, bend = (horner(c, z) for c in (f, f1, f2))
            if abs(value) <= 16 * mp.eps * horner([abs(c) for c in f], abs(z)):  # rounding
                break
            root = mp.sqrt(((n - 1) * slope) ** 2 - n * (n - 1) * value * bend)
            z -= n * value / max(slope + root, slope - root, key=abs)
        zeros.append(z)
        f = polydiv(f, (-z, mpf(1)))[0]
    return zeros


# ---------------------------------------------------------------- elliptic motion and its limits


class Lattice(NamedTuple):
    """e of the other three roots (the largest or the real one first), and the constants of theta1."""

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
    """Carlson's R_F, which is real here."""
    return mp.inf if squares.count(0) > 1 else mp.re(mp.elliprf(*squares))


def factor(c: Lattice, at: Places, pole: mpf, D: mpf) -> Factor:
    """A or B. At r = 0 they are real, and |A|² = s - x3, |B|² = s + x3.

    D : m s - l for A, -(m s + l) for B. Its sign says which of the two zeros of s - x3 or s + x3 is a zero of x+.
    """
    (e1, e2, e3), kappa, n = c.e, c.kappa, len(c.logs) - 1
    e = at.e(pole)
    if by_high := c.real and (e == e1 or e > (e2 + e3) / 2):
        e = e1 - (e1 - e2) * (e1 - e3) / (e1 - e) if e != e1 else -mp.inf  # half a period later
    eta = mpf(0) if mp.isinf(e) else carlson(e1 - e, e2 - e, e3 - e)
    side = 1 if (D > 0) == by_high else -1
    odd = even = rest = mpf(0)
    apart = [(mpf(0), mpf(0))]  # sinh(kappa (r - a)) as a sum of exponentials
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
    """The motion with varying x3, without its `phase`."""
    c, s = lattice(at, digits), mp.sqrt(real(state.c1))
    up, down = weight(state, 1), weight(state, -1)
    A, B = factor(c, at, at.top, up), factor(c, at, at.bottom, -down)
    # the rates of arg A and arg B where x3 is stationary, minus those of theta1
    lam = up / (2 * (at.top - at.low)) + down / (2 * (at.high - at.bottom))
    lam -= logarithmic_slope(A, c.kappa, mpf(0))
    if finite := mp.isfinite(c.period):
        lam -= logarithmic_slope(B, c.kappa, c.period / 2)
    e = at.e(at.start)
    since = mpf(0) if mp.isinf(e) else carlson(*(e - v for v in c.e))
    t0, zero = since if state.velocity < 0 else -since, mpf(0)
    motion = Tide(c.period, t0, zero, zero, real(state.m), real(state.l / state.c1), s, c.kappa, rotated(A, lam), B)
    turn = lam
    if finite:  # half the angle in a period, up to whole turns
        J, x, _ = position(motion, c.period / 2, mp)
        turn = 2 * mp.arg(max(J, x, key=abs)) / c.period
        turn += mp.nint((lam - turn) * c.period / (2 * mp.pi)) * 2 * mp.pi / c.period
    return motion._replace(turn=turn, A=rotated(A, lam - turn))


def logarithmic_slope(part: Factor, kappa: Any, r: mpf) -> mpf:
    """The rate of the argument of a factor."""
    value, slope = evaluate(part, kappa, r, mp)
    return mp.im(slope / value)


def rotated(part: Factor, rate: mpf) -> Factor:
    """`part` times e^{i rate r}."""
    return part._replace(rates=tuple(v + 1j * rate for v in part.rates))


def crossing(state: State) -> Tide:
    """The motion in a plane from the lower pole to the upper one, x3 = s tanh(kappa r), without its `phase`."""
    s, zero, (k, x3) = mp.sqrt(real(state.c1)), mpf(0), reals(state.k, state.x[2])
    kappa = mp.sqrt(k) * s
    A, B = (Factor(zero, zero, mpf(1), (zero,), (rate,)) for rate in (-kappa, zero))
    return Tide(mp.inf, -mp.atanh(x3 / s) / kappa, zero, zero, zero, zero, s, kappa, A, B, rising=True)
