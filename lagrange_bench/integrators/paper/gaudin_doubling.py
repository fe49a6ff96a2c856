"""The exact flow of a Gaudin magnet over any time as one step: two-point maps and a turn about e3, by time doubling.

A step of k = ⌊n/2⌋ maps with the points (λ_i, m_i) of the curve m² = Q(λ), m = v Π(λ − a_j), is stored as two real polynomials
(Mumford's form): U = Π |u − λ_i|², and V of lower degree with V(λ_i) = i m_i, so that U divides V² + Q. Cantor's algorithm for
twice a divisor gives the step that does the work of two:

- composition: V mod U² such that U² divides V² + Q, by Newton's method;
- reduction: real A, B with A ≡ B V mod U², deg A ≤ 3k, deg B ≤ 3k − n, by Euclid's algorithm. A − iBy then vanishes twice at each
  point of the step. The other zeros of its norm, of the positive polynomial

      U' = (A² + B² Q)/U²,   V' = −A/B mod U',

  are the λ' of the new step, up to a turn about e3.

At the two points at infinity A − iBy takes two values. The phase of their ratio is ∓2 arg(a + i alpha b), where a is the
coefficient of u^3k in A, and b the coefficient of u^(3k − n) in B. The divisor is trivial but for a turn about e3 by this angle.
So for odd n a step is k = (n − 1)/2 maps and a turn: 2k + 1 = n numbers for n times. For even n Euclid's algorithm ends with
b = 0 and there is no turn: k = n/2 maps are 2k = n numbers. λ' is infinite where a = 0, at isolated times.

Doubling starts from a time so short that the Padé parameters of `gaudin_curve` are right to all digits. It takes as many
digits as two runs need to agree: 30 for most magnets with up to 8 spins. That reduction never fails is measured and not
proved: docs/exact-step.md, section 7.

Source: Cantor, Math. Comp. 48 (1987) 95, for composition and reduction; its use for λ(h) is a result of this project.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from mpmath import mp
from numpy.polynomial.polynomial import polyadd, polydiv, polysub

from lagrange_bench.integrators.paper.gaudin_curve import pade_roots, polynomial_roots, spectral_polynomial
from lagrange_bench.integrators.paper.gaudin_maps import two_point
from lagrange_bench.integrators.paper.phase_space import Numbers, dot, numbers, root_near
from lagrange_bench.integrators.truth.curve import horner
from lagrange_bench.support.precision import workdps

DIGITS, MOST_DIGITS = 30, 600  # of the first run, and of the last
AGREE = 1e-18  # largest difference of two runs with different digits, relative to the largest spin


def exact_step(magnet: Any, spins: Numbers, h: float) -> Numbers:
    """Real spins (n, 3) after the flow of H_site over a time h, in double. ArithmeticError if MOST_DIGITS are not enough."""
    digits, before = DIGITS, None
    while digits <= MOST_DIGITS:
        try:
            with workdps(digits):
                image = numbers(spins) if h == 0 or not np.any(spins[magnet.site]) else flow(magnet, spins, h)
                if before is not None and np.max(np.abs(image - before)) <= AGREE * np.max(np.abs(spins)):
                    return image.astype(complex).real
        except ArithmeticError:  # so few digits that a polynomial lost its positivity
            image = None
        digits, before = digits + max(10, digits // 3), image
    raise ArithmeticError(f"{MOST_DIGITS} digits do not suffice for the exact step of this magnet")


def flow(magnet: Any, spins: Any, h: Any) -> Numbers:
    """The same in the precision of mpmath; neither h nor the spin at the site is 0."""
    n, origin = len(magnet), mp.mpmathify(magnet.sites[magnet.site])
    sites = tuple(mp.mpmathify(a) - origin for a in magnet.sites)  # which may lie far from 0
    magnet = replace(magnet, sites=sites, alpha=mp.mpmathify(magnet.alpha))
    spins, h = numbers(spins), mp.mpf(h)
    if n == 1:
        return turned(spins, 2 * magnet.alpha * h)
    Q = spectral_polynomial(magnet, spins)
    U, V, doublings = short_step(magnet, spins, Q, h)
    angle = mp.mpf(0)
    for _ in range(doublings):
        U, V, turn = double(U, V, Q, magnet.alpha, n)
        angle = 2 * angle + turn
    for lam in polynomial_roots(U):
        if lam.imag > 0:
            spins = two_point(magnet, spins, lam, v=horner(V, lam) / (1j * mp.fprod(lam - b for b in sites)))
    return turned(spins, angle)


def short_step(magnet: Any, spins: Numbers, Q: Numbers, h: Any) -> tuple[Numbers, Numbers, int]:
    """U and V of the step over h/2^m, and m, for which the Padé parameters are right to all digits."""
    k, spin = len(magnet) // 2, spins[magnet.site]
    parameters = [mp.sqrt(dot(spin, spin)) * abs(h) * z for z in pade_roots(k)]
    nearest = (
        min(abs(Q[0] / q) ** (mp.one / j) for j, q in enumerate(Q) if j and q) / 2
    )  # no root of Q is nearer: Fujiwara
    reach = max(map(abs, parameters)) / nearest
    doublings = max(0, math.ceil(mp.log(reach, 2) + mp.mpf(mp.prec) / (2 * k)))
    at_site = mp.sign(h) * mp.sqrt(Q[0]) * mp.sign(mp.fprod(-b for b in magnet.sites if b))
    U, V = np.array([mp.one]), np.array([mp.zero])
    for lam in (parameter / 2**doublings for parameter in parameters):
        m = root_near(horner(Q, lam), at_site)
        value = (1j * m - horner(V, lam)) / horner(U, lam)  # Newton's interpolation at λ and λ̄
        slope = value.imag / lam.imag
        V = polyadd(V, np.convolve(U, np.array([value.real - slope * lam.real, slope])))
        U = np.convolve(U, np.array([abs(lam) ** 2, -2 * lam.real, mp.one]))
    return U, V, doublings


def double(U: Numbers, V: Numbers, Q: Numbers, alpha: Any, n: int) -> tuple[Numbers, Numbers, Any]:
    """U and V of the step that does the work of two, and the angle of its turn."""
    k, squared = n // 2, np.convolve(U, U)
    for _ in range(2):  # the second puts V back onto the curve: errors of V would grow with each doubling
        off = polyadd(np.convolve(V, V), Q)
        V = polydiv(polysub(V, np.convolve(off, inverse(2 * V, squared))), squared)[1]
    A, B = euclid(squared, V, 3 * k)
    norm = polyadd(np.convolve(A, A), np.convolve(np.convolve(B, B), Q))
    U = polydiv(norm, squared)[0]
    U = U / U[-1]
    V = -polydiv(np.convolve(A, inverse(B, U)), U)[1]
    return U, V, 2 * mp.arg(mp.mpc(coefficient(A, 3 * k), alpha * coefficient(B, 3 * k - n)))


def turned(spins: Numbers, angle: Any) -> Numbers:
    """Spins (n, 3) turned about e3."""
    (x, y, z), c, s = spins.T, mp.cos(angle), mp.sin(angle)
    return np.stack((c * x - s * y, s * x + c * y, z), axis=-1)


# ------------------------------------------------------------------------------------------ polynomials, ascending


def euclid(m: Numbers, p: Numbers, degree: int) -> tuple[Numbers, Numbers]:
    """r and t with r ≡ t p mod m: the first remainder r of Euclid's algorithm with at most this degree."""
    before, now = (m, np.array([mp.zero])), (p, np.array([mp.one]))
    while len(now[0]) - 1 > degree:
        quotient_and_rest: tuple[Numbers, Numbers] = polydiv(before[0], now[0])
        quotient, rest = quotient_and_rest
        before, now = now, (rest, polysub(before[1], np.convolve(quotient, now[1])))
    return now


def inverse(p: Numbers, m: Numbers) -> Numbers:
    """1/p mod m."""
    one, t = euclid(m, polydiv(p, m)[1], 0)
    return t / one[0]


def coefficient(p: Numbers, power: int) -> Any:
    """The coefficient of a power, 0 if p has none."""
    return p[power] if 0 <= power < len(p) else mp.zero
