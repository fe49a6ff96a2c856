"""Weierstrass' functions ℘, ζ, σ of a rectangular lattice, from theta functions, at the present precision of mpmath.

    ℘'² = 4℘³ − g2 ℘ − g3 = 4 (℘ − e1)(℘ − e2)(℘ − e3),  e1 > e2 > e3 real,     ζ' = −℘,     σ'/σ = ζ.

℘ is real on the lines Im z = 0, Im z = Im ω3, Re z = 0 and Re z = ω1, with ω1 > 0 and ω3/i > 0 the half-periods: along
0 → ω1 → ω1 + ω3 → ω3 → 0 it falls from +∞ through e1, e2, e3 to −∞ (DLMF 23.5(ii)).
"""

from typing import Any

from mpmath import mp, mpf

I = mp.mpc(0, 1)


class Weierstrass:
    """The functions with real invariants g2, g3, g2³ > 27 g3². Made and used at the same `mp.dps`.

    roots : e1 > e2 > e3. omega1, omega3 : the half-periods. basis : half-periods (ω, ω') with Im ω'/ω >= 1: the nome is at most
    e^-π. weights : 2 (−1)^n q^{(n + 1/2)²}, q = e^{iπτ}, τ = ω'/ω. etas : ζ(ω), ζ(ω').
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
        basis = (mp.mpc(omega1), omega3) if omega3.imag >= omega1 else (omega3, -mp.mpc(omega1))
        log_q = (I * mp.pi * basis[1] / basis[0]).real
        last = int(mp.sqrt(mp.dps * mp.log(10) / -log_q)) + 2
        self.weights = tuple(2 * (-1) ** n * mp.exp(log_q * (mpf(2 * n + 1) / 2) ** 2) for n in range(last + 1))
        self.roots, self.omega1, self.omega3, self.basis = (e1, e2, e3), omega1, omega3, basis
        # DLMF 23.6.8, and Legendre's relation η ω' − η' ω = iπ/2
        _, first, _, third = self.theta1(mp.mpc(0))
        eta = -(mp.pi**2) * third / (12 * basis[0] * first)
        self.etas = eta, (eta * basis[1] - I * mp.pi / 2) / basis[0]

    def theta1(self, v: Any) -> tuple[Any, ...]:
        """theta1 and its first three derivatives at v, for |Im v| <= π Im τ/2 (DLMF 20.2.1)."""
        up = mp.expj(v)
        down, step_up = 1 / up, up * up
        step_down, total = down * down, [mp.mpc(0)] * 4
        for n, weight in enumerate(self.weights):
            p = 2 * n + 1
            a, b = weight * up / 2, weight * down / 2
            sine, cosine = (a - b) / I, a + b
            for k, term in enumerate((sine, p * cosine, -p * p * sine, -(p**3) * cosine)):
                total[k] += term
            up, down = up * step_up, down * step_down
        return tuple(total)

    def reduced(self, z: Any) -> tuple[Any, int, int]:
        """z0 and whole numbers n, n' with z = z0 + 2nω + 2n'ω', z0 in the period cell about 0."""
        omega, dual = self.basis
        n_dual = int(mp.nint((z / omega).imag / (2 * (dual / omega).imag)))
        z = z - 2 * n_dual * dual
        n = int(mp.nint((z / omega).real / 2))
        return z - 2 * n * omega, n, n_dual

    def logarithmic(self, z: Any) -> tuple[Any, ...]:
        """(θ1'/θ1, θ1''/θ1, θ1'''/θ1) and the scale dv/dz at z in the period cell about 0."""
        scale = mp.pi / (2 * self.basis[0])
        theta = self.theta1(z * scale)
        if abs(theta[0]) <= abs(theta[1]) * mpf(10) ** (5 - mp.dps):
            raise ValueError(f"z = {mp.nstr(z, 8)} (modulo the lattice) is a pole")
        return (*(derivative / theta[0] for derivative in theta[1:]), scale)

    def p(self, z: Any) -> Any:
        """℘(z)."""
        r1, r2, _, scale = self.logarithmic(self.reduced(z)[0])
        return -self.etas[0] / self.basis[0] + scale**2 * (r1 * r1 - r2)

    def p_prime(self, z: Any) -> Any:
        """℘'(z)."""
        r1, r2, r3, scale = self.logarithmic(self.reduced(z)[0])
        return scale**3 * (3 * r1 * r2 - r3 - 2 * r1**3)

    def zeta(self, z: Any) -> Any:
        """ζ(z), quasi-periodic: ζ(z + 2ω) = ζ(z) + 2η."""
        z0, n, n_dual = self.reduced(z)
        r1, _, _, scale = self.logarithmic(z0)
        return self.etas[0] * z0 / self.basis[0] + scale * r1 + 2 * (n * self.etas[0] + n_dual * self.etas[1])

    def sigma(self, z: Any) -> Any:
        """σ(z), entire: DLMF 23.6.9, 23.2.17."""
        return self.sigma_and_derivative(z)[0]

    def sigma_and_derivative(self, z: Any) -> tuple[Any, Any]:
        """σ(z) and σ'(z), also at the zeros of σ, where ζ = σ'/σ has its poles."""
        z0, n, n_dual = self.reduced(z)
        omega, eta, scale = self.basis[0], self.etas[0], mp.pi / (2 * self.basis[0])
        shift, eta_shift = n * omega + n_dual * self.basis[1], n * eta + n_dual * self.etas[1]
        theta, theta_prime, _, _ = self.theta1(z0 * scale)
        growth = eta * z0**2 / (2 * omega) + 2 * eta_shift * (z0 + shift)
        at_0 = sum((2 * k + 1) * weight for k, weight in enumerate(self.weights))  # theta1'(0)
        factor = (-1) ** (n + n_dual + n * n_dual) * mp.exp(growth) / (scale * at_0)
        slope = eta * z0 / omega + 2 * eta_shift
        return factor * theta, factor * (slope * theta + scale * theta_prime)

    def third_kind(self, a: Any, u: Any) -> Any:
        """∫ ℘'(a)/(℘(z) − ℘(a)) dz from ω3 to ω3 + u along the real direction; a as `inverse_imaginary` gives it.

        It is 2ζ(a) z + ln σ(z − a)/σ(z + a) (DLMF 23.6.9, 23.10.3). A factor e^{2 η1 a u/ω1} gives the quotient the
        period 2ω1, and its argument is then that of theta4²: between −π and π, the principal logarithm is continuous.
        """
        eta1 = self.etas[0] if self.basis[1] == self.omega3 else -self.etas[1]  # ζ(ω1)
        growth = 2 * eta1.real * a / self.omega1
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
