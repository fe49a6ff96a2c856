"""Section 4: Euler angles, and the motion in Weierstrass' ℘, ζ, σ.

    x1 = s sin φ sin θ     J1 =  p_θ cos φ + (ℓ/s − p_φ cos θ)/sin θ · sin φ                        (4.1) [59]
    x2 = s cos φ sin θ     J2 = −p_θ sin φ + (ℓ/s − p_φ cos θ)/sin θ · cos φ
    x3 = s cos θ           J3 =  p_φ                            s = √c1, ℓ = c2; the paper has s = 1

φ grows from e2 towards e1: x+ = i s sin θ e^{−iφ}. {p_θ, θ} = {p_φ, φ} = 1 (4.2) is the bracket (1.3), f' = {f, H} the
flow (1.1); hence θ' = −p_θ and φ' = −∂H/∂p_φ. (The paper's solution has the signs of the reversed flow, see ERRATA.)

With m = J3, E = H and ℘ of the invariants (general c1, either sign of alpha)

    g2 = H²/3 + alpha² c1 − alpha ℓ m        g3 = H³/27 − alpha ℓ m H/6 − alpha² c1 H/3 + alpha² (ℓ² + c1 m²)/4

the solution is x3 = (2/alpha)(℘(z) + H/6), z = t + d, d = ω3 + u0 with u0 real, and

    J+ = C e^{i m t/2 − ζ(b) t} σ(z + b)/σ(z)         ℘(b) = H/3 − m²/4,  ℘'(b) = (i/2)(alpha ℓ − m H + m³/2)
    x+ = J+'/(i alpha) = (J+/alpha) [m/2 − i (ζ(z + b) − ζ(z) − ζ(b))].

J+'' = i m J+' + alpha x3 J+ is Lamé's equation with n = 1: hence the σ. For φ see `Motion.phi`.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from operator import mul
from random import Random
from typing import Any

import numpy as np
from mpmath import mp, mpf
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import check_count, check_state
from lagrange_bench.integrators.paper.errata import Erratum
from lagrange_bench.integrators.paper.phase_space import components, function, refuse, sqrt
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth.exact import exact_times, solution
from lagrange_bench.support.precision import workdps

__all__ = ["Motion", "Weierstrass", "angles", "from_angles", "hamiltonian", "motion", "rates", "states", "to_angles"]

DIGITS = 20  # computed for a result in doubles
I = mp.mpc(0, 1)


def from_angles(angles: Any, c1: Any = 1.0, c2: Any = 0.0) -> NDArray[Any]:
    """States (J, x), (..., 6), on the leaf |x|² = c1, x·J = c2 from (θ, φ, p_θ, p_φ), (..., 4): (4.1).

    Real, complex or mpmath numbers. ValueError where sin θ = 0.
    """
    theta, phi, p_theta, p_phi = components(angles)
    s, sine, cosine = function("sqrt", c1), function("sin", theta), function("cos", theta)
    refuse(sine, "sin θ = 0: Euler angles are singular at the poles")
    along, (e1, e2) = (c2 / s - p_phi * cosine) / sine, (function("sin", phi), function("cos", phi))
    J1, J2 = p_theta * e2 + along * e1, along * e2 - p_theta * e1
    return np.stack((J1, J2, p_phi, s * e1 * sine, s * e2 * sine, s * cosine), axis=-1)


def to_angles(y: Any) -> NDArray[Any]:
    """(θ, φ, p_θ, p_φ), (..., 4), of states (J, x), (..., 6), the inverse of (4.1).

    Real, complex or mpmath numbers; for real states θ in [0, π], φ in [0, 2π). ValueError where x1² + x2² = 0.
    """
    J1, J2, J3, x1, x2, x3 = components(y)
    across = sqrt(x1 * x1 + x2 * x2)
    refuse(across, "x1² + x2² = 0: Euler angles are singular at the poles")
    s = sqrt(x1 * x1 + x2 * x2 + x3 * x3)
    theta = -1j * function("log", (x3 + 1j * across) / s)
    phi = -1j * function("log", (x2 + 1j * x1) / across)
    angles = np.stack((theta, phi, (J1 * x2 - J2 * x1) / across, J3 + 0 * theta), axis=-1)
    if not np.any(np.asarray(y).astype(complex).imag):
        angles = function("re", angles) if angles.dtype == object else angles.real
        angles[..., 1] %= 2 * (mp.pi if angles.dtype == object else np.pi)
    return angles


def hamiltonian(alpha: Any, angles: Any, c1: Any = 1.0, c2: Any = 0.0) -> Any:
    """H (4.3): p_θ²/2 + (p_φ² − 2(ℓ/s) p_φ cos θ + ℓ²/c1)/(2 sin² θ) + alpha s cos θ. J3 is p_φ (4.4)."""
    theta, _, p_theta, p_phi = components(angles)
    s, cosine = function("sqrt", c1), function("cos", theta)
    across = p_phi**2 - 2 * (c2 / s) * p_phi * cosine + c2**2 / c1
    return p_theta**2 / 2 + across / (2 * function("sin", theta) ** 2) + alpha * s * cosine


def rates(alpha: Any, angles: Any, c1: Any = 1.0, c2: Any = 0.0) -> NDArray[Any]:
    """Time derivatives of (θ, φ, p_θ, p_φ): θ' = −p_θ, φ' = −∂H/∂p_φ, p_θ' = ∂H/∂θ, p_φ' = 0."""
    theta, _, p_theta, p_phi = components(angles)
    s, sine, cosine = function("sqrt", c1), function("sin", theta), function("cos", theta)
    across = p_phi - (c2 / s) * cosine, c2 / s - p_phi * cosine  # their product over sin³θ is the centrifugal term
    force = across[0] * across[1] / sine**3 - alpha * s * sine
    return np.stack((-p_theta, -across[0] / sine**2, force, 0 * p_phi), axis=-1)


class Weierstrass:
    """℘, ζ, σ of a rectangular lattice, real g2, g3, g2³ > 27 g3², from theta functions. Made and used at the same `mp.dps`.

        ℘'² = 4℘³ − g2 ℘ − g3 = 4 (℘ − e1)(℘ − e2)(℘ − e3),  e1 > e2 > e3 real,     ζ' = −℘,     σ'/σ = ζ.

    ℘ is real on the lines Im z = 0, Im z = Im ω3, Re z = 0 and Re z = ω1, with ω1 > 0 and ω3/i > 0 the half-periods: along
    0 → ω1 → ω1 + ω3 → ω3 → 0 it falls from +∞ through e1, e2, e3 to −∞ (DLMF 23.5(ii)).

    roots : e1 > e2 > e3. omega1, omega3 : the half-periods. omega : ω1 or ω3, so that the nome is at most e^-π. eta : ζ(omega).
    """

    def __init__(self, g2: Any, g3: Any) -> None:
        self.g2, self.g3 = g2, g3
        discriminant = self.g2**3 - 27 * self.g3**2
        if not discriminant > 0:
            raise ValueError(f"g2³ − 27 g3² = {mp.nstr(discriminant, 5)}: the three roots must be real and distinct")
        # Vieta: e = √(g2/3) cos((angle + 2πj)/3), DLMF 4.43
        angle, size = mp.atan2(mp.sqrt(discriminant), mp.sqrt(27) * self.g3), mp.sqrt(self.g2 / 3)
        e1, e2, e3 = (size * mp.cos((angle + 2 * mp.pi * j) / 3) for j in (0, -1, 1))
        # DLMF 23.6.34-35, 19.8.5
        omega1 = mp.pi / (2 * mp.agm(mp.sqrt(e1 - e3), mp.sqrt(e1 - e2)))
        omega3 = I * mp.pi / (2 * mp.agm(mp.sqrt(e1 - e3), mp.sqrt(e2 - e3)))
        self.roots, self.omega1, self.omega3 = (e1, e2, e3), omega1, omega3
        self.omega, other = (mp.mpc(omega1), omega3) if omega3.imag >= omega1 else (omega3, -mp.mpc(omega1))
        self.nome, self.scale = mp.exp(I * mp.pi * other / self.omega).real, mp.pi / (2 * self.omega)
        self.slope = self.theta1(0, 1)
        self.eta = -(mp.pi**2) * self.theta1(0, 3) / (12 * self.omega * self.slope)  # DLMF 23.6.8

    def theta1(self, z: Any, derivative: int = 0) -> Any:
        """theta1, or one of its derivatives, at πz/(2 omega)."""
        return mp.jtheta(1, z * self.scale, self.nome, derivative)

    def logarithmic(self, z: Any) -> tuple[Any, ...]:
        """(θ1'/θ1, θ1''/θ1, θ1'''/θ1) at z."""
        theta, *derivatives = (self.theta1(z, k) for k in range(4))
        if abs(theta) <= abs(derivatives[0]) * mpf(10) ** (5 - mp.dps):
            raise ValueError(f"z = {mp.nstr(z, 8)} (modulo the lattice) is a pole")
        return tuple(derivative / theta for derivative in derivatives)

    def p(self, z: Any) -> Any:
        """℘(z)."""
        r1, r2, _ = self.logarithmic(z)
        return -self.eta / self.omega + self.scale**2 * (r1 * r1 - r2)

    def p_prime(self, z: Any) -> Any:
        """℘'(z)."""
        r1, r2, r3 = self.logarithmic(z)
        return self.scale**3 * (3 * r1 * r2 - r3 - 2 * r1**3)

    def zeta(self, z: Any) -> Any:
        """ζ(z), quasi-periodic: ζ(z + 2ω) = ζ(z) + 2η."""
        return self.eta * z / self.omega + self.scale * self.logarithmic(z)[0]

    def sigma(self, z: Any) -> Any:
        """σ(z), entire: DLMF 23.6.9."""
        return self.sigma_and_derivative(z)[0]

    def sigma_and_derivative(self, z: Any) -> tuple[Any, Any]:
        """σ(z) and σ'(z), also at the zeros of σ, where ζ = σ'/σ has its poles."""
        growth = mp.exp(self.eta * z**2 / (2 * self.omega)) / self.slope
        sigma = growth * self.theta1(z) / self.scale
        return sigma, sigma * self.eta * z / self.omega + growth * self.theta1(z, 1)

    def third_kind(self, a: Any, u: Any) -> Any:
        """∫ ℘'(a)/(℘(z) − ℘(a)) dz from ω3 to ω3 + u along the real direction; a as `inverse_imaginary` gives it.

        It is 2ζ(a) z + ln σ(z − a)/σ(z + a) (DLMF 23.6.9, 23.10.3). A factor e^{2 η1 a u/ω1} gives the quotient the
        period 2ω1, and its argument is then that of theta4²: between −π and π, the principal logarithm is continuous.
        """
        growth = 2 * self.zeta(self.omega1).real * a / self.omega1
        v = u - 2 * self.omega1 * mp.nint(u / (2 * self.omega1))
        now, start = (self.sigma(self.omega3 + w - a) / self.sigma(self.omega3 + w + a) for w in (v, mpf(0)))
        return (2 * self.zeta(a) - growth) * u + mp.log(mp.exp(growth * v) * now / start)

    # ------------------------------------------------ ℘ inverted on the lines where it is real

    def inverse_oval(self, p: Any, slope: Any) -> Any:
        """u real in (−ω1, ω1] with ℘(ω3 + u) = p in [e3, e2]; `slope` is ℘'(ω3 + u), of which the sign is used.

        ℘(ω3 + u) = e3 + (e3 − e1)(e3 − e2)/(℘(u) − e3) (Whittaker & Watson, 20.33), and u = RF(℘ − e1, ℘ − e2, ℘ − e3).
        """
        e1, e2, e3 = self.roots
        if p <= e3:
            return mpf(0)
        P = e3 + (e1 - e3) * (e2 - e3) / (p - e3)
        u = mp.elliprf(max(P - e1, mpf(0)), P - e2, P - e3)
        return -u if slope < 0 else u

    def inverse_imaginary(self, p: Any, slope: Any) -> Any:
        """z on the imaginary axis (p <= e3) or on ω1 + iy (p in [e2, e1]) with ℘(z) = p; `slope` is ℘'(z)/i.

        As ℘(iy; g2, g3) = −℘(y; g2, −g3), y = RF(e3 − ℘, e2 − ℘, e1 − ℘); in [e2, e1] after the shift by ω1.
        """
        e1, e2, e3 = self.roots
        if p <= (e2 + e3) / 2:
            y = mp.elliprf(max(e3 - p, mpf(0)), e2 - p, e1 - p)
            return -I * y if slope > 0 else I * y
        if p >= e1:
            return mp.mpc(self.omega1)
        P = e1 - (e1 - e2) * (e1 - e3) / (e1 - p)
        y = mp.elliprf(max(e3 - P, mpf(0)), e2 - P, e1 - P)
        return self.omega1 + (-I * y if slope < 0 else I * y)


def real(q: Fraction) -> mpf:
    return mpf(q.numerator) / q.denominator


class Motion:
    """The motion through one state: its constants, as mpmath numbers made and used at `dps` digits.

    z = ω3 + t + u0. C : constant of J+. poles : the a with ℘(a) = ±alpha s/2 − H/6. phi0 : φ at t = 0, None where it does not
    exist for all t.
    """

    def __init__(self, alpha: float, y0: tuple[float, ...], digits: int) -> None:
        if alpha == 0:
            raise ValueError("alpha = 0: no elliptic functions in a free rotation; use exact.solution")
        a, J, x = Fraction(alpha), list(map(Fraction, y0[:3])), list(map(Fraction, y0[3:]))
        squares, c1, l = (sum(map(mul, u, v), Fraction(0)) for u, v in ((J, J), (x, x), (J, x)))
        m, H, velocity = J[2], squares / 2 + a * x[2], J[0] * x[1] - J[1] * x[0]
        g2 = H**2 / 3 + a**2 * c1 - a * l * m
        g3 = H**3 / 27 - a * l * m * H / 6 - a**2 * c1 * H / 3 + a**2 * (l**2 + c1 * m**2) / 4
        if (discriminant := g2**3 - 27 * g3**2) == 0:
            raise ValueError("double root: separatrix, regular precession or vertical top; use exact.solution")
        pole_distance = (a * a * (m * m * c1 - l * l)) ** 2  # of the order of (℘(a+) − e2)(e3 − ℘(a-)), times gaps
        lost = sum(decimals(g2**3 / v) for v in (discriminant, pole_distance) if v)  # by differences that nearly vanish
        self.dps = 2 * (digits + 15) + max(0, lost)  # a turning point costs half of the digits
        with workdps(self.dps):
            slopes = real(a * velocity / 2), real((a * l - m * H + m**3 / 2) / 2)
            a, m, l, c1, H = (real(v) for v in (a, m, l, c1, H))
            self.alpha, self.m, self.c1, self.H = a, m, c1, H
            self.wp, s, (J1, J2, _, x1, x2, x3) = Weierstrass(real(g2), real(g3)), mp.sqrt(c1), map(mpf, y0)
            self.u0 = self.wp.inverse_oval(a * x3 / 2 - H / 6, slopes[0])
            self.b = self.wp.inverse_imaginary(H / 3 - m * m / 4, slopes[1])
            values = ((k * a * s / 2 - H / 6, -k * a * (m * s - k * l) / 2) for k in (1, -1))
            self.poles = [self.wp.inverse_imaginary(*value) for value in values]
            J, x = self.quotients(mpf(0))
            C = mp.conj(J) * mp.mpc(J1, J2) * c1 + mp.conj(x) * mp.mpc(x1, x2) * abs(a) * s
            self.C = C / (abs(J) ** 2 * c1 + abs(x) ** 2 * abs(a) * s)
            self.phi0 = None if pole_distance == 0 else mp.atan2(x1, x2) % (2 * mp.pi)

    def x3(self, t: Any) -> Any:
        """(2/alpha)(℘(z) + H/6)."""
        return 2 / self.alpha * (self.wp.p(self.wp.omega3 + t + self.u0).real + self.H / 6)

    def state(self, t: Any) -> list[Any]:
        """(J, x) at t."""
        J, x = (self.C * quotient for quotient in self.quotients(t))
        return [J.real, J.imag, self.m, x.real, x.imag, self.x3(t)]

    def quotients(self, t: Any) -> tuple[Any, Any]:
        """J+/C and x+/C; by σ' = ζσ, so that J+ = 0, where ζ(z + b) has a pole, is no exception."""
        wp, m, b, z = self.wp, self.m, self.b, self.wp.omega3 + t + self.u0
        above, slope = wp.sigma_and_derivative(z + b)
        turn = mp.exp((1j * m / 2 - wp.zeta(b)) * t) / wp.sigma(z)
        return turn * above, turn / self.alpha * ((m / 2 + 1j * (wp.zeta(z) + wp.zeta(b))) * above - 1j * slope)

    def angles(self, t: Any) -> list[Any]:
        """θ = arccos(x3/s), φ, p_θ = −θ', p_φ = m at t; ValueError at a pole."""
        x3 = self.x3(t)
        across = self.c1 - x3 * x3
        if across <= self.c1 * mpf(10) ** (-self.dps // 2):
            raise ValueError(f"the axis is at a pole at t = {mp.nstr(t, 8)}: Euler angles are singular there")
        velocity = 2 / self.alpha * self.wp.p_prime(self.wp.omega3 + t + self.u0).real
        return [mp.acos(x3 / mp.sqrt(self.c1)), self.phi(t), velocity / mp.sqrt(across), self.m]

    def phi(self, t: Any) -> Any:
        """φ(t), continuous: φ' = −(c1 m − ℓ x3)/(c1 − x3²) integrated.

        −φ' is Σ ℘'(a)/(2i (℘(z) − ℘(a))) over the two poles a, with ℘'(a±) = ∓(i/2) alpha (ms ∓ ℓ).
        """
        if self.phi0 is None:
            raise ValueError("the axis passes through a pole on this orbit, where φ jumps by π: use `states`")
        swept = sum(self.wp.third_kind(a, t + self.u0) - self.wp.third_kind(a, self.u0) for a in self.poles)
        return self.phi0 - (swept / 2j).real


cached = lru_cache(maxsize=256)(Motion)


def motion(top: LagrangeTop, y0: ArrayLike, digits: int = DIGITS) -> Motion:
    """The motion that is at y0 at t = 0, for values good to `digits` digits at |t| not much above a period.

    ValueError for alpha = 0 and for double roots of ℘ (separatrix, regular precession, vertical tops), where elliptic
    functions degenerate: `exact.solution` covers those.
    """
    return cached(top.alpha, tuple(check_state(y0).tolist()), check_count(digits, "digits", least=1))


def decimals(q: Fraction) -> int:
    """log10 |q|, about."""
    return round(0.302 * (q.numerator.bit_length() - q.denominator.bit_length()))


def states(top: LagrangeTop, y0: ArrayLike, t: Any, digits: int | None = None) -> NDArray[Any]:
    """(J, x) at times t by σ and ζ; arguments and shapes as in `exact.solution`, which takes theta functions."""
    return evaluate(Motion.state, top, y0, t, digits)


def angles(top: LagrangeTop, y0: ArrayLike, t: Any, digits: int | None = None) -> NDArray[Any]:
    """(θ, φ, p_θ, p_φ) at times t, φ continuous from [0, 2π) at t = 0; shape (n, 4), or (4,) for one time.

    Doubles to 1e-15 relative, or mpf to `digits` digits, 20 ms a time. ValueError at poles and as in `motion`.
    """
    return evaluate(Motion.angles, top, y0, t, digits)


def evaluate(method: Callable[..., Any], top: LagrangeTop, y0: ArrayLike, t: Any, digits: int | None) -> NDArray[Any]:
    times = exact_times(t)
    wanted = DIGITS if digits is None else digits
    with workdps(15):  # σ grows like e^{t²}: its exponent needs the digits of (t/ω)²
        longest = max((abs(v) / motion(top, y0, wanted).wp.omega1 for v in times.ravel()), default=mpf(0))
        guard = int(2 * mp.log10(longest + 1))
    prepared = motion(top, y0, wanted + -(-guard // 8) * 8)
    with workdps(prepared.dps):
        values = [method(prepared, mpf(v)) for v in times.ravel()]
    with workdps(wanted):
        table = np.array([[+v for v in row] for row in values], dtype=object)
    table = table.reshape(*times.shape, 4 if method is Motion.angles else 6)
    return table if digits is not None else table.astype(float)


# ---------------------------------------------------------------- misprints of section 4


def random_unit_top(rng: Random) -> tuple[LagrangeTop, list[float]]:
    theta, phi = rng.uniform(0.5, 2.5), rng.uniform(0.0, 6.0)
    state = from_angles((theta, phi, rng.uniform(0.3, 1.0), rng.uniform(0.5, 1.5)), c1=1.0, c2=rng.uniform(0.3, 1.0))
    return LagrangeTop(rng.uniform(0.5, 1.5)), state.tolist()


def theta_residual(rng: Random, printed: bool) -> float:
    """|cos θ of (4.5) − x3| with ℘ in the paper's scaling, at z = √(alpha/2)(t − t0), corrected + ω3, x3 lowest at t0."""
    top, y = random_unit_top(rng)
    t = rng.uniform(0.2, 0.8)
    with workdps(30):
        orbit = motion(top, y, 30)
        root = mp.sqrt(orbit.alpha / 2)
        wp = Weierstrass(orbit.wp.g2 / root**4, orbit.wp.g3 / root**6)
        cosine = orbit.H / (3 * orbit.alpha) + wp.p(root * (t + orbit.u0) + (0 if printed else wp.omega3)).real
    return abs(float(cosine) - float(solution(top, y, t)[5]))


def phi_residual(rng: Random, printed: bool) -> float:
    """|(m − 2ℓ x3)/(1 − x3²) − φ'|, corrected −(m − ℓ x3)/…, at a random state, φ' from (1.1)."""
    top, y = random_unit_top(rng)
    (J1, J2, m, x1, x2, x3), (v1, v2, _) = y, top.rhs(y)[3:]
    l, across = x1 * J1 + x2 * J2 + x3 * m, x1 * x1 + x2 * x2
    claimed = m - 2 * l * x3 if printed else l * x3 - m
    return float(abs(claimed - (v1 * x2 - v2 * x1)) / across)


def p_theta_residual(rng: Random, printed: bool) -> float:
    """|θ' − p_θ|, corrected |−θ' − p_θ|, at a random state, θ' from (1.1) and p_θ from (4.1)."""
    top, y = random_unit_top(rng)
    sign = -1 if printed else 1
    return abs(float(sign * top.rhs(y)[5] / np.hypot(y[3], y[4]) - to_angles(y)[2]))


ERRATA = [
    Erratum(
        "(4.5), θ", "4",
        "θ = arccos[E/3α + ℘(√(α/2) t)], E = H: has a pole at t = 0, and exceeds 1",
        "θ = arccos[E/3α + ℘(√(α/2)(t − t0) + ω3)], x3 lowest at t0", theta_residual,
    ),
    Erratum("(4.5), φ", "4", "φ' = (m − 2ℓ cos θ)/(1 − cos²θ)", "φ' = −(m − ℓ cos θ)/(1 − cos²θ)", phi_residual),
    Erratum("(4.5), p_θ", "4", "p_θ = dθ/dt", "p_θ = −dθ/dt", p_theta_residual),
]  # fmt: skip
