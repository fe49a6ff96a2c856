"""The closed form of the orbit through one state in a uniform field, and its constants, in mpmath.

The constants are computed once for each initial state, to any number of digits; `truth.exact` evaluates them. The doubles alpha
and y0 are taken as rationals, so every distinction of cases (equilibrium, separatrix, poles) is exact. Two reductions come first.
alpha < 0 becomes alpha > 0 by (alpha, x) -> (-alpha, -x), which leaves the equations unchanged. Units that are powers of two
make J and x of order 1.

With m = J3, l = x·J, s = |x|, J+ = J1 + iJ2, x+ = x1 + ix2 the equations of motion give

    x3'² = f(x3) = (2H - m² - 2 alpha x3)(s² - x3²) - (l - m x3)²,      J+ conj(x+) = l - m x3 - i x3'.

E = alpha x3/2 - H/6 then solves Weierstrass' equation E'² = 4E³ - g2 E - g3 with real roots E3 <= E2 <= E1:

    E = E3 + (E2 - E3) sn²(w, k),     w = kappa (t - t0),     kappa² = E1 - E3,     k² = (E2 - E3)/(E1 - E3).

|J+|², s - x3 and s + x3 are multiples of |P - E|, with P one of

    P_J = H/3 - m²/4  (|J+|² = 4 (P_J - E)),      P_A = alpha s/2 - H/6,      P_B = -alpha s/2 - H/6,

and P_B <= E3 <= E <= E2 <= {P_A, P_J} <= E1. As f(P) is minus a square, each has a factor F with |F|² = |P - E| and
(arg F)' = D/|P - E|, D² = |(P - E1)(P - E2)(P - E3)|. F is an elliptic function of the second kind:

    F = const e^{i lam (t-t0)} theta2(v - i sgn(D) beta)/theta4(v)   (theta1 for P_B),   v = pi w/2K,
    J+ = 2 F_J e^{i(psi + m (t-t0)/2)},     x+ = i (2/alpha) F_A F_B e^{i psi}.

These are quotients of entire functions. So there is no branch to choose, and nothing jumps when the axis passes a pole or J+
vanishes. For k² > 1/2 Jacobi's imaginary transformation (DLMF 20.7.30-33) replaces the nome by exp(-pi K/K'). So the nome never
exceeds e^-pi, and the limit k = 1, the separatrix, is regular.

Sources: Whittaker, Analytical Dynamics, §71-72; the paper's section 4 with its misprints corrected; DLMF, with numbers beside the
formulas. All formulas are derived again, and tested against the equations of motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

from mpmath import mp, mpf

from lagrange_bench.support.precision import workdps

Vector = tuple[Any, ...]  # of mpf, mpc, float or complex


class Series(NamedTuple):
    """A polynomial in z plus u times a polynomial in u; coefficients by increasing power."""

    z: Vector
    u: Vector = ()


class Nutation(NamedTuple):
    """A motion with varying x3, as a function of the time r since x3 was smallest; see `position`."""

    J3: Any
    period: Any  # inf on the separatrix
    advance: Any  # angle about e3 that x+ sweeps in a period; nan on the separatrix
    clock: Any  # z = exp(clock |r|): e^{2iv}, or e^{-pi |w|/K'} for the transformed series
    barrier: Any  # u = exp(-barrier)/z: the nome of the transformed series over z; None for the direct ones
    growth_J: Any  # exponential factor of J+
    growth_x: Any
    J: Series  # numerators of J+ and of the factors with |A|² = s - x3, |B|² = s + x3; theta is their denominator
    A: Series
    B: Series
    theta: Series
    t0: Any = None  # a time at which x3 is smallest
    phase: Any = None  # psi


class Rotation(NamedTuple):
    """A rigid rotation about a fixed axis: y = centre + cosine cos(rate t) + sine sin(rate t), each (6,)."""

    period: Any  # 2 pi/|rate|, inf at rest
    rate: Any
    centre: Vector
    cosine: Vector
    sine: Vector


class Orbit(NamedTuple):
    """An orbit in its own units. J times 2^rate, x times sign 2^size, and times times 2^-rate are in the user's units."""

    regime: str  # "elliptic", "homoclinic", "precession", "equilibrium", "free"
    motion: Nutation | Rotation
    roots: Vector  # of f, e1 >= e2 >= e3
    nutation_period: Any  # without nutation the period of small oscillations, inf if there are none
    precession: Any  # angle about e3 swept by x+ in this period, nan if the period is inf
    rate: int = 0
    size: int = 0
    sign: int = 1


@dataclass(frozen=True)
class State:
    """alpha, J and x in V = k x3²/2, and quantities that follow from them, as rationals of order 1."""

    alpha: Fraction  # not negative if k is 0
    J: tuple[Fraction, ...]
    x: tuple[Fraction, ...]
    k: Fraction = Fraction(0)

    @property
    def m(self) -> Fraction:
        return self.J[2]

    @cached_property
    def l(self) -> Fraction:  # noqa: E743
        return dot(self.x, self.J)

    @cached_property
    def c1(self) -> Fraction:
        return dot(self.x, self.x)

    @cached_property
    def H(self) -> Fraction:
        return dot(self.J, self.J) / 2 + self.alpha * self.x[2] + self.k * self.x[2] ** 2 / 2

    @cached_property
    def velocity(self) -> Fraction:
        """x3'."""
        return self.J[0] * self.x[1] - self.J[1] * self.x[0]

    @cached_property
    def acceleration(self) -> Fraction:
        """x3''."""
        across, x3 = dot(self.J[:2], self.x[:2]), self.x[2]
        return self.m * across - self.force * dot(self.x[:2], self.x[:2]) - x3 * dot(self.J[:2], self.J[:2])

    @property
    def force(self) -> Fraction:
        """The weight plus dV/dx3."""
        return self.alpha + self.k * self.x[2]


def find_orbit(alpha: float | Fraction, y0: tuple[float, ...], digits: int) -> Orbit:
    """The orbit through `y0`, with constants to `digits` decimal digits."""
    rate, size = units(alpha, y0)
    sign, two = -1 if alpha < 0 else 1, Fraction(2)
    state = State(
        abs(Fraction(alpha)) * two ** (size - 2 * rate),
        tuple(Fraction(v) * two**-rate for v in y0[:3]),
        tuple(sign * Fraction(v) * two**-size for v in y0[3:]),
    )
    with workdps(digits + 15):
        if state.alpha == 0:
            orbit = free(state)
        elif state.velocity == 0 and state.acceleration == 0:
            orbit = equilibrium(state)
        else:
            orbit = nutating(state, digits)
    return orbit._replace(rate=rate, size=size, sign=sign)


def units(alpha: float | Fraction, y0: Sequence[float], k: float | Fraction = 0) -> tuple[int, int]:
    """The binary exponents of the largest of |J|, sqrt(|alpha||x|) and sqrt(|k|)|x|, and of |x|; to a bit or two."""
    (J, J_exponent), (_, size) = (math.frexp(max(map(abs, part))) for part in (y0[:3], y0[3:]))
    rates = ([J_exponent] if J else []) + ([(math.frexp(alpha)[1] + size) // 2] if alpha else [])
    rates += [math.frexp(k)[1] // 2 + size] if k else []
    return max(rates, default=0), size


def dot(a: Iterable[Fraction], b: Iterable[Fraction]) -> Fraction:
    return sum((p * q for p, q in zip(a, b, strict=True)), Fraction(0))


def real(q: Fraction | int) -> mpf:
    return mpf(q.numerator) / q.denominator


def reals(*v: Fraction | int) -> Vector:
    return tuple(map(real, v))


# ---------------------------------------------------------------- evaluation, in doubles or in mpmath


def position(c: Nutation, r: Any, exp: Callable[[Any], Any]) -> tuple[Any, Any, Any]:
    """J+, x+ and x3 at times r after x3 was smallest, |r| <= period/2, without the turn by psi.

    c, r : doubles and an array, or mpmath numbers. exp : the exponential function for them.
    """
    a, side = abs(r), 1 - 2 * (r < 0)
    z = exp(c.clock * a)
    u = None if c.barrier is None else exp(-c.barrier - c.clock * a)
    theta = total(c.theta, z, u)
    J = exp(c.growth_J * a) * total(c.J, z, u) / theta
    A = exp(c.growth_x * a) * total(c.A, z, u) / theta
    B = total(c.B, z, u) / theta
    x, x3 = A * B, (B.real * B.real + B.imag * B.imag - A.real * A.real - A.imag * A.imag) / 2
    # reversing time about the lowest point reflects the motion in the vertical plane through it
    return J.real + 1j * (side * J.imag), x.real + 1j * (side * x.imag), x3


def total(series: Series, z: Any, u: Any) -> Any:
    value = horner(series.z, z)
    return value if u is None else value + u * horner(series.u, u)


def horner(coefficients: Any, z: Any) -> Any:
    value = coefficients[-1]
    for c in coefficients[-2::-1]:
        value = value * z + c
    return value


# ---------------------------------------------------------------- motions without elliptic functions


def free(state: State) -> Orbit:
    """The orbit for alpha = 0: J is constant, and x turns about it at the rate |J| (Rodrigues)."""
    J, x, l, m, square = state.J, state.x, state.l, state.m, dot(state.J, state.J)
    if square == 0:
        rest = Rotation(mpf("inf"), mpf(0), reals(*J, *x), reals(*[0] * 6), reals(*[0] * 6))
        return Orbit("free", rest, (mpf("inf"), real(x[2]), real(x[2])), mpf("inf"), mpf("nan"))
    rate = mp.sqrt(real(square))
    along = [l * v / square for v in J]
    moment = J[1] * x[2] - J[2] * x[1], J[2] * x[0] - J[0] * x[2], J[0] * x[1] - J[1] * x[0]
    motion = Rotation(
        2 * mp.pi / rate,
        rate,
        reals(*J, *along),
        reals(0, 0, 0, *(p - q for p, q in zip(x, along, strict=True))),
        tuple(v / rate for v in reals(0, 0, 0, *moment)),
    )
    # f = (|J|² - m²)(c1 - x3²) - (l - m x3)² is a quadratic
    middle = real(l * m / square)
    spread = mp.sqrt(real((square * state.c1 - l * l) * (square - m * m))) / real(square)
    # the integral of A/(s - x3) over a period is pi sgn(A), A = (m s - l)/2; likewise B = (m s + l)/2 with s + x3
    turns = [mp.sign(weight(state, pole)) for pole in (1, -1)]
    swept = past_poles(mp.pi * sum(turns), turns.count(0))
    return Orbit("free", motion, (mpf("inf"), middle + spread, middle - spread), motion.period, swept)


def equilibrium(state: State) -> Orbit:
    """The orbit if x3 is constant."""
    m, x3, rate = state.m, state.x[2], precession_rate(state)
    motion = steady(state, rate)
    square = 2 * state.H - 6 * state.alpha * x3  # -f''/2, the squared frequency of small oscillations of x3
    period, swept = mpf("inf"), mpf("nan")
    if square > 0:
        period = 2 * mp.pi / mp.sqrt(real(square))
        # about the vertical J+ and x+ have two frequencies, m/2 ± half the frequency of nutation
        swept = real(rate) * period if rate else past_poles(real(m) * period / 2, 1)
    e = heights(state, cubic(state)[0])
    return Orbit("precession" if rate else "equilibrium", motion, e, period, swept)


def precession_rate(state: State) -> Fraction:
    """Omega if x3 is constant: force x_perp = Omega J_perp, from J' = force e3 × x; or J vertical, x' = J × x."""
    (J1, J2, m), (x1, x2, _) = state.J, state.x
    if across := J1 * J1 + J2 * J2:
        return state.force * (J1 * x1 + J2 * x2) / across
    return m if x1 or x2 else Fraction(0)  # if x is vertical, too: sleeping or hanging


def steady(state: State, rate: Fraction) -> Rotation:
    """The motion of J and x that turn about e3 at the rate Omega."""
    (J1, J2, m), (x1, x2, x3) = state.J, state.x
    return Rotation(
        2 * mp.pi / real(abs(rate)) if rate else mpf("inf"),
        real(rate),
        reals(0, 0, m, 0, 0, x3),
        reals(J1, J2, 0, x1, x2, 0),
        reals(-J2, J1, 0, -x2, x1, 0),
    )


def past_poles(swept: mpf, poles: int) -> mpf:
    """The angle about e3 in a period, if the axis passes through 0, 1 or 2 poles. At each the azimuth jumps by ±pi.

    swept : the angle without the jumps. The smaller of the two limits is taken; of a pair ±pi the positive one.
    """
    if poles != 1:
        return swept
    if abs(swept) < mpf(10) ** (-mp.dps // 2):  # zero but for rounding
        return +mp.pi
    return swept - mp.sign(swept) * mp.pi


# ---------------------------------------------------------------- the cubic and the points P


def weight(state: State, pole: int) -> mpf:
    """m s - pole l for pole = ±1: f(pole s) = -(m s - pole l)². A zero is exactly 0."""
    m, l = state.m, pole * state.l
    product = real(m) * mp.sqrt(real(state.c1))
    if m * l <= 0:
        return product - real(l)
    return real(m * m * state.c1 - l * l) / (product + real(l))  # the difference itself would cancel


def cubic(state: State) -> tuple[Vector, Vector]:
    """Roots E1 >= E2 >= E3 of 4E³ - g2 E - g3, and their gaps (E1-E2, E2-E3, E1-E3), to full relative accuracy.

    Vieta: E = sqrt(g2/3) cos((phi + 2 pi j)/3), cos phi = sqrt(27) g3/g2^{3/2} (DLMF §4.43). The angle comes from the exact
    discriminant and the gaps from the addition theorem. So nearly double roots lose no digits.
    """
    alpha, H, l, m, c1 = state.alpha, state.H, state.l, state.m, state.c1
    g2 = H**2 / 3 + alpha**2 * c1 - alpha * l * m
    g3 = H**3 / 27 - alpha * l * m * H / 6 - alpha**2 * c1 * H / 3 + alpha**2 * (l**2 + c1 * m**2) / 4
    sine, cosine = mp.sqrt(real(g2**3 - 27 * g3**2)), mp.sqrt(27) * real(g3)
    phi, supplement = (mp.atan2(sine, c) if g2 else mpf(0) for c in (cosine, -cosine))
    size = mp.sqrt(real(g2))
    E = tuple(size / mp.sqrt(3) * mp.cos((phi + 2 * mp.pi * j) / 3) for j in (0, -1, 1))
    return E, (size * mp.sin(supplement / 3), size * mp.sin(phi / 3), size * mp.sin((phi + mp.pi) / 3))


def heights(state: State, E: Vector) -> Vector:
    """x3 from E."""
    return tuple((e + real(state.H) / 6) * 2 / real(state.alpha) for e in E)


class Distances(NamedTuple):
    """Gaps of the cubic; distances (|P-E1|, |P-E2|, |P-E3|), also of the initial E in place of P; and the D."""

    gaps: Vector
    start: Vector
    J: Vector
    A: Vector
    B: Vector
    D: Vector  # D_J, D_A, D_B, with signs


def distances(state: State, digits: int) -> Distances:
    """All distances to `digits` digits. The working precision is raised until cancellation does not matter."""
    working = digits + 15
    while True:
        with workdps(working):
            d = distances_now(state)
        smallest = min(abs(v) for part in (d.gaps, d.start, d.J, d.A, d.B) for v in part if v)
        if smallest > mpf(10) ** (digits + 5 - working):
            return d
        working *= 2


def distances_now(state: State) -> Distances:
    """Distances at the present precision. Those that vanish are exactly 0."""
    E, gaps = cubic(state)
    alpha, H, l, m = state.alpha, state.H, state.l, state.m
    height, shift = real(alpha) * mp.sqrt(real(state.c1)) / 2, real(H) / 6
    D = real((alpha * l - m * H + m**3 / 2) / 4), *(real(alpha) * weight(state, pole) / 4 for pole in (1, -1))
    to_3 = E[2] + height + shift if D[2] else mpf(0)
    return Distances(
        gaps,
        start=distances_at_start(state, E, gaps),
        J=distances_above(E, gaps, real(H / 3 - m * m / 4), D[0] == 0),
        A=distances_above(E, gaps, height - shift, D[1] == 0),
        B=(to_3 + gaps[2], to_3 + gaps[1], to_3),
        D=D,
    )


def distances_above(E: Vector, gaps: Vector, P: mpf, on_root: bool) -> Vector:
    """Distances of P in [E2, E1]. on_root : whether P is the nearer of the two roots."""
    to_1, to_2 = E[0] - P, P - E[1]
    if on_root:
        to_1, to_2 = (gaps[0], mpf(0)) if abs(to_2) < abs(to_1) else (mpf(0), gaps[0])
    return to_1, to_2, to_2 + gaps[1]


def distances_at_start(state: State, E: Vector, gaps: Vector) -> Vector:
    """Distances of E at t = 0. At a turning point, x3'' tells whether it is the lower or the upper one."""
    start = real(state.alpha * state.x[2] / 2 - state.H / 6)
    to_2, to_3 = E[1] - start, start - E[2]
    if state.velocity == 0:
        to_2, to_3 = (gaps[1], mpf(0)) if state.acceleration > 0 else (mpf(0), gaps[1])
    return to_2 + gaps[0], to_2, to_3


# ---------------------------------------------------------------- elliptic motion and its limit, the separatrix


class Torus(NamedTuple):
    """Quarter periods in w, and eta for each P, with the sign of D: P = E(K + i|eta|), and E(i|eta|) for P_B."""

    kappa: mpf
    K: mpf
    K_dual: mpf
    eta: Vector


def nutating(state: State, digits: int) -> Orbit:
    d = distances(state, digits)
    gap12, gap23, gap13 = d.gaps
    # DLMF 19.8.5: K = pi/(2 agm(1, k'))
    K_dual = mp.pi / (2 * mp.agm(1, mp.sqrt(gap23 / gap13)))
    K = mp.pi / (2 * mp.agm(1, mp.sqrt(gap12 / gap13))) if gap12 else mpf("inf")
    eta = eta_above(d.J, d.gaps, K_dual), eta_above(d.A, d.gaps, K_dual), eta_below(d.B, d.gaps)
    eta = tuple(-e if D < 0 else e for e, D in zip(eta, d.D, strict=True))  # at D = 0 both signs give the same F
    torus = Torus(mp.sqrt(gap13), K, K_dual, eta)
    motion = (direct if gap23 <= gap12 else transformed)(state, d, torus, digits)
    motion = with_phase(state, motion._replace(t0=-elapsed(state, d, torus)))
    e = heights(state, cubic(state)[0])
    return Orbit("elliptic" if gap12 else "homoclinic", motion, e, motion.period, motion.advance)


def elapsed(state: State, d: Distances, torus: Torus) -> mpf:
    """t - t0 at t = 0, at most half a period: w = F(phi, k), sin² phi = sn² w = (E - E3)/(E2 - E3) (DLMF 19.25.5)."""
    (to_1, to_2, to_3), (_, gap23, gap13) = d.start, d.gaps
    w = mp.sqrt(to_3 / gap23) * mp.elliprf(to_2 / gap23, to_1 / gap13, 1)
    return (-w if state.velocity < 0 else w) / torus.kappa


def eta_above(distance: Vector, gaps: Vector, K_dual: mpf) -> mpf:
    """eta in [0, K'] with P = E(K + i eta), for P in [E2, E1].

    sn(K + i eta, k) = 1/dn(eta, k') (DLMF Tables 22.4.3, 22.6.1), so sn²(eta, k') = (P-E2)(E1-E3)/((P-E3)(E1-E2)); then
    DLMF 19.25.5, multiplied through by (P-E3)(E1-E2).
    """
    (to_1, to_2, to_3), (gap12, gap23, gap13) = distance, gaps
    if to_2 == 0 or gap12 == 0:  # on the separatrix eta drops out: the nome is 0
        return mpf(0)
    if to_1 == 0:
        return K_dual
    return mp.sqrt(to_2 * gap13) * mp.elliprf(to_1 * gap23, gap23 * gap12, to_3 * gap12)


def eta_below(distance: Vector, gaps: Vector) -> mpf:
    """eta in [0, K') with P = E(i eta), for P <= E3: tan² am(eta, k') = (E3-P)/(E2-E3), DLMF 19.25.5."""
    (to_1, to_2, to_3), (_, gap23, gap13) = distance, gaps
    return mp.sqrt(to_3) * mp.elliprf(gap23, gap23 * to_1 / gap13, to_2)


def direct(state: State, d: Distances, torus: Torus, digits: int) -> Nutation:
    """k² <= 1/2: theta series in q = exp(-pi K'/K) (DLMF 20.2.1-4), as polynomials in z = e^{2iv}.

    The numerators begin at e^{-(2n+1)iv} and theta4 at e^{-2niv}. The factor e^{-iv} becomes part of the exponent.
    """
    q, unit = mp.exp(-mp.pi * torus.K_dual / torus.K), mp.pi * torus.kappa / (2 * torus.K)  # unit = dv/dt
    n = last_order(q, digits)
    theta4 = [(-1) ** j * q ** (j * j) for j in range(-n, n + 1)]
    at_bottom, at_top = mp.fsum(theta4), mp.fsum(map(abs, theta4))  # theta4(0), theta4(pi/2)
    parts = []
    for eta, odd in zip(torus.eta, (False, False, True), strict=True):
        powers = range(-2 * n - 1, 2 * n + 2, 2)
        terms = [
            q ** ((p * p - 1) // 4) * mp.exp(p * mp.pi * eta / (2 * torus.K)) for p in powers
        ]  # theta2(v - i beta)
        slope = mp.fsum(p * term for p, term in zip(powers, terms, strict=True))
        alternating = (term * (-1) ** ((p - 1) // 2) for p, term in zip(powers, terms, strict=True))  # i theta1
        parts.append((Series(tuple(alternating if odd else terms)), mp.fsum(terms), slope))
    (J, A, B), (lam_J, lam_x) = quotients(state, d, parts, at_bottom, at_top, unit)
    return Nutation(
        J3=real(state.m),
        period=2 * torus.K / torus.kappa,
        advance=sweep(d, torus, lam_x * 2 * torus.K / torus.kappa, [mp.pi, mp.pi]),
        clock=mp.mpc(0, 2 * unit),
        barrier=None,
        growth_J=mp.mpc(0, lam_J - unit),
        growth_x=mp.mpc(0, lam_x - 2 * unit),
        J=J,
        A=A,
        B=B,
        theta=Series(tuple(theta4)),
    )


def transformed(state: State, d: Distances, torus: Torus, digits: int) -> Nutation:
    """k² > 1/2: series in q = exp(-pi K/K') after DLMF 20.7.30-33, in z = e^{-2V} and u = q e^{2V}, V = pi |w|/2K'.

    Up to exponentials, theta2(v - i beta)/theta4(v) -> theta4(b + iV)/theta2(iV) and theta1 -> -i theta1(b + iV), b = pi eta/2K'.
    All series are divided by q^{1/4} e^V. So |z|, u <= 1, and the separatrix is q = 0.
    """
    barrier, unit = mp.pi * torus.K / torus.K_dual, mp.pi * torus.kappa / (2 * torus.K_dual)  # unit = dV/dt
    q = mp.exp(-barrier)
    n = last_order(q, digits)
    theta2 = Series((mpf(1), *(q ** (k * k + k) for k in range(n + 1))), tuple(q ** (k * k) for k in range(1, n + 2)))
    at_bottom, at_top = total(theta2, 1, q), 1 + 2 * mp.fsum(theta2.u)  # theta2(0), theta3(0)
    b = [mp.pi * eta / (2 * torus.K_dual) for eta in torus.eta]
    parts = [(even_series(q, n, b[0]), *theta4_at(q, n, b[0])), (even_series(q, n, b[1]), *theta4_at(q, n, b[1]))]
    parts.append((odd_series(q, n, b[2]), *theta4_at(q, n, b[2])))
    (J, A, B), (lam_J, lam_x) = quotients(state, d, parts, at_bottom, at_top, unit)
    period, turns = 2 * torus.K / torus.kappa, [mp.pi - 2 * abs(v) for v in b[1:]]
    return Nutation(
        J3=real(state.m),
        period=period,
        advance=sweep(d, torus, lam_x * period, turns) if mp.isfinite(period) else mpf("nan"),
        clock=-2 * unit,
        barrier=barrier,
        growth_J=mp.mpc(-unit, lam_J),
        growth_x=mp.mpc(-unit, lam_x),
        J=J,
        A=A,
        B=B,
        theta=theta2,
    )


def last_order(q: mpf, digits: int) -> int:
    """The least n with q^{(n+1)²} below the precision."""
    return int(mp.sqrt((digits + 10) * mp.log(10) / -mp.log(q))) if q else 0


def theta4_at(q: mpf, n: int, b: mpf) -> tuple[mpf, mpf]:
    """theta4(b) and its derivative."""
    terms = [(k, 2 * (-1) ** k * q ** (k * k)) for k in range(1, n + 2)]
    value = 1 + mp.fsum(c * mp.cos(2 * k * b) for k, c in terms)
    return value, -mp.fsum(2 * k * c * mp.sin(2 * k * b) for k, c in terms)


def even_series(q: mpf, n: int, b: mpf) -> Series:
    """theta4(b + iV)."""
    return Series(
        tuple((-1) ** k * q ** (k * k) * mp.expj(2 * k * b) for k in range(n + 1)),
        tuple((-1) ** k * q ** (k * k - k) * mp.expj(-2 * k * b) for k in range(1, n + 2)),
    )


def odd_series(q: mpf, n: int, b: mpf) -> Series:
    """theta1(b + iV)/(q^{1/4} e^V)."""
    i = mp.mpc(0, 1)
    return Series(
        (i * mp.expj(-b), *(-i * (-1) ** k * q ** (k * k + k) * mp.expj((2 * k + 1) * b) for k in range(n + 1))),
        tuple(i * (-1) ** k * q ** (k * k) * mp.expj(-(2 * k + 1) * b) for k in range(1, n + 2)),
    )


def quotients(
    state: State, d: Distances, parts: Sequence[tuple[Series, mpf, mpf]], at_bottom: mpf, at_top: mpf, unit: mpf
) -> tuple[list[Series], tuple[mpf, mpf]]:
    """The numerators with their constants, and the rates lam of J+ and x+.

    The denominator is stationary when x3 is smallest (for B: largest). There |F|² = |P - E| and (arg F)' = D/|P - E| must hold.
    Without its constant, the numerator has the size `value` and the logarithmic derivative slope/value there.
    """
    bottom_J, bottom_A, top_B = d.J[2], d.A[2], d.B[1]
    in_x = mp.sqrt(2 / real(state.alpha))
    sizes = 2 * mp.sqrt(bottom_J) * at_bottom, in_x * mp.sqrt(bottom_A) * at_bottom, in_x * mp.sqrt(top_B) * at_top
    rates = [D / P for D, P in zip(d.D, (bottom_J, bottom_A, top_B), strict=True)]
    series, lam = [], []
    for (numerator, value, slope), size, rate in zip(parts, sizes, rates, strict=True):
        z, u = (tuple(c * size / value for c in part) for part in (numerator.z, numerator.u))
        series.append(Series(z, u))
        lam.append(rate - unit * slope / value)
    return series, (lam[0] + real(state.m) / 2, lam[1] + lam[2])


def sweep(d: Distances, torus: Torus, base: mpf, turns: Sequence[mpf]) -> mpf:
    """The angle that x+ sweeps in a period: `base` from the exponent, and one turn each from the theta quotients A and B.

    Each turn has the sign of its D. If D = 0 and eta = 0, the axis passes through the pole.
    """
    signs = [(-1 if D < 0 else 1) if D or eta else 0 for D, eta in zip(d.D[1:], torus.eta[1:], strict=True)]
    return past_poles(base + signs[0] * turns[0] + signs[1] * turns[1], signs.count(0))


def with_phase(state: State, c: Nutation) -> Nutation:
    """`c` with the angle psi that makes J+ and x+ right at t = 0; the larger of the two counts most."""
    J, x, _ = position(c, -c.t0, mp.exp)
    (J1, J2, _), (x1, x2, _) = reals(*state.J), reals(*state.x)
    rate = real(dot(state.J, state.J) + state.alpha)
    overlap = J.conjugate() * mp.mpc(J1, J2) * real(state.c1) + x.conjugate() * mp.mpc(x1, x2) * rate
    return c._replace(phase=mp.arg(overlap))
