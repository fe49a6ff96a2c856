"""The exact flow of a Gaudin magnet over any time as one step: two-point maps and a turn about e3, by time doubling.

A step of k = ⌊n/2⌋ maps with the points (λ_i, m_i) of the curve m² = Q(λ), m = v Π(λ − a_j), is held as a pair of real
polynomials (Mumford's form): U = Π |u − λ_i|², and V of lower degree with V(λ_i) = i m_i, so that U divides V² + Q. A
step after itself is

- composition: U = U1², V ≡ V1 mod U1 such that U divides V² + Q, which one division gives;
- reduction: real A, B with A ≡ B V mod U, deg A ≤ 3k, deg B ≤ 3k − n, by Euclid's algorithm. A − iBy then vanishes at
  all points of the step, twice at each, and the other zeros of its norm, of the positive polynomial

      U' = (A² + B² Q)/U,   V' = −A/B mod U',

  are the λ' of the step that does the work of two, up to a turn about e3 (below).

At the two points at infinity A − iBy takes two values. The phase of their ratio is ∓2 arg(a + i alpha b), where a is
the coefficient of u^3k in A, and b that of u^(3k − n) in B. The divisor is trivial but for a turn about e3 by that
angle. So

- n odd: a step is k = (n − 1)/2 maps and a turn, 2k + 1 = n numbers for n times. λ' is infinite only where a = b = 0.
- n even: k = n/2 maps suffice. A with deg B < k leads to λ' = ∞ wherever a = 0, at one in a continuum of times. But two
  rows of Euclid's algorithm, one with a = 1, b = 0 and one with a = 0, alpha b = 1, give a step for every phase between
  them; the last doubling takes the phase with the smallest λ'.

Doubling starts from a time so short that ∫ du/√Q is a power series at a_site; there n equations for the λ_i in the scale
of that time are well conditioned, and Newton's method falls from the Padé parameters of `gaudin_curve` onto the solution.
The polynomials lose digits, up to 27 with 12 spins and 80 units of time: `exact_step` takes as many as two runs need to agree.
That reduction never fails, and that a good phase always exists, is measured and not proved: docs/exact-step.md, section 7.
"""

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp
from numpy.polynomial.polynomial import polyadd, polydiv

from lagrange_bench.integrators.paper.gaudin_curve import length, pade_roots, spectral_polynomial
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from lagrange_bench.integrators.paper.phase_space import Numbers, numbers
from lagrange_bench.integrators.precision import workdps
from lagrange_bench.integrators.truth.orbit import horner

DIGITS = 24  # of the first run, and two more for each spin
AGREE = 1e-18  # of λ and of the turn, relative, between two runs with different numbers of digits
MOST_DIGITS = 600
MOST_SPINS = 32  # the Padé parameters lose too many digits in double soon after
REACH = 1 / 16  # the series is used up to this part of its radius of convergence
PHASES = 8  # tried in the last doubling of a magnet with an even number of spins


Step = tuple[list[int], Numbers, Numbers, Fraction]  # near, lams, v, turn


class Divisor(NamedTuple):
    """A step in Mumford's form, ascending coefficients, and the angle of the turn."""

    U: Numbers
    V: Numbers
    angle: Any


def exact_step(magnet: GaudinMagnet, spins: Any, h: float) -> Step:
    """The flow of H_site over a time h.

    It is the maps with λ_i = a_near + lams_i and v_i, and a turn about e3, as a part of a revolution. λ_i is counted from the
    site next to it: a double of its place would not do for sites that lie far from 0.
    ValueError for more than MOST_SPINS spins. ArithmeticError if MOST_DIGITS do not suffice.
    """
    if len(magnet) > MOST_SPINS:
        raise ValueError(
            f"spins: the exact step is for at most {MOST_SPINS}; got {len(magnet)}. backlund_paper takes any number"
        )
    digits, before = DIGITS + 2 * len(magnet), None
    while digits <= MOST_DIGITS:
        try:
            with workdps(digits):
                found = _exact_step(magnet, spins, h)
        except ArithmeticError:  # so few digits that a polynomial lost its positivity
            found = None
        if before is not None and found is not None and _distance(before, found) <= AGREE:
            return _rounded(*found)
        digits, before = digits + max(10, digits // 3), found
    raise ArithmeticError(f"{MOST_DIGITS} digits do not suffice for the exact step of this magnet")


def _distance(a: tuple, b: tuple) -> float:
    """Of two runs: the largest relative change of a λ, or change of the turn."""
    turned = (a[2] - b[2]) / (2 * mp.pi)
    changes = [abs(turned - mp.nint(turned))]
    for lam in a[0]:
        changes.append(min((abs(lam - other) / abs(lam.imag) for other in b[0]), default=math.inf))
    return float(max(changes))


def _rounded(lams: list, v: list, angle: Any, sites: tuple) -> Step:
    with workdps(50):
        turn = Fraction(int(mp.floor(angle / (2 * mp.pi) * mp.mpf(2) ** 128)) % 2**128, 2**128)
        near = [min(range(len(sites)), key=lambda j: abs(x - sites[j])) for x in lams]
        lams = [complex(x - sites[j]) for x, j in zip(lams, near, strict=True)]
    return near, np.array(lams), np.array([complex(x) for x in v]), turn


def _exact_step(magnet: GaudinMagnet, spins: Any, h: float) -> tuple[list, list, Any, tuple]:
    """λ_i less a_site, v_i, the angle of the turn, and the sites less a_site."""
    n, alpha, site = len(magnet), mp.mpf(magnet.alpha), magnet.site or 0
    if n == 1:
        return [], [], 2 * alpha * mp.mpf(h), ()
    if not np.any(spins[site]):
        return [], [], mp.mpf(0), ()
    sites = [mp.mpmathify(a) for a in magnet.sites]
    fine = GaudinMagnet(tuple(a - sites[site] for a in sites), alpha, site)
    exactly = numbers(spins)
    Q = spectral_polynomial(fine, exactly)
    curve, start = _Curve(Q, alpha, n), _Start(fine, Q, exactly, mp.mpf(h))
    step = start.divisor()
    for i in range(start.halvings):
        step = curve.double(step, last=i == start.halvings - 1)
    lams = upper_roots(step.U)
    v = [horner(step.V, x) / (1j * mp.fprod(x - a for a in fine.sites)) for x in lams]
    return lams, v, step.angle, fine.sites


class _Curve:
    """Steps on one curve y² = Q(u)."""

    def __init__(self, Q: Numbers, alpha: Any, n: int):
        self.Q, self.alpha, self.n, self.k = Q, alpha, n, n // 2

    def double(self, step: Divisor, last: bool) -> Divisor:
        """Two such steps as one; `last`: with the best of many phases."""
        U, V, angle = step
        rest = polydiv(-polyadd(np.convolve(V, V), self.Q), U)[0]
        added: Numbers = polydiv(np.convolve(rest, inverse(2 * V, U)), U)[1]
        return self._reduce(np.convolve(U, U), polyadd(V, np.convolve(U, added)), 2 * angle, last)

    def _reduce(self, U: Numbers, V: Numbers, angle: Any, last: bool) -> Divisor:
        rows = euclid(U, V, 3 * self.k)
        _, (A, B) = next(rows), next(rows)
        if last and self.n % 2 == 0 and self.alpha:
            A, B = self._best_phase(U, (A, B), next(rows))
        reduced = self._norm(U, A, B)
        reduced = reduced / reduced[-1]
        V = -polydiv(np.convolve(A, inverse(B, reduced)), reduced)[1]
        top = 3 * self.k
        phase = mp.arg(mp.mpc(_coefficient(A, top), self.alpha * _coefficient(B, top - self.n)))
        return Divisor(reduced, V, angle + 2 * phase)

    def _norm(self, U: Numbers, A: Numbers, B: Numbers) -> Numbers:
        norm = polyadd(np.convolve(A, A), np.convolve(np.convolve(B, B), self.Q))
        return polydiv(norm, U)[0][: 2 * self.k + 1]

    def _best_phase(self, U: Numbers, even: tuple, odd: tuple) -> tuple:
        """Of the A, B between two rows of Euclid's algorithm those whose λ' stay farthest from infinity."""
        top = 3 * self.k
        scales = _coefficient(even[0], top), self.alpha * _coefficient(odd[1], top - self.n)
        even, odd = (tuple(p / scale for p in row) for row, scale in zip((even, odd), scales, strict=True))
        both = tuple(polyadd(p, q) for p, q in zip(even, odd, strict=True))
        first, second, mixed = (self._norm(U, *row) for row in (even, odd, both))
        mixed = mixed - first - second
        phases = [(mp.cospi(mp.mpf(i) / PHASES), mp.sinpi(mp.mpf(i) / PHASES)) for i in range(PHASES)]

        def largest(phase: tuple) -> float:
            c, s = phase
            return float(np.max(np.abs(rough_roots(c * c * first + c * s * mixed + s * s * second))))

        c, s = min(phases, key=largest)
        return even if s == 0 else tuple(polyadd(c * p, s * q) for p, q in zip(even, odd, strict=True))


class _Start:
    """A short enough part 2^−halvings of the flow of H_site over a time, from the power series of ∫ du/√Q at a_site = 0."""

    def __init__(self, magnet: GaudinMagnet, Q: Numbers, spins: Numbers, time: Any):
        n, self.k = len(magnet), len(magnet) // 2
        self.time, self.size, self.Q = time, length(spins[magnet.site]), Q
        self.root = self.size * mp.fprod(-b for b in magnet.sites if b)  # y at the site
        self.alpha, self.odd = magnet.alpha, n % 2
        terms = math.ceil(mp.dps / -math.log10(REACH)) + 2 * n + 10
        q = Q / Q[0]
        g = [mp.mpf(1)]  # of y(a_site)/y, from 2 Q f' = −Q' f
        for m in range(1, terms):
            g.append(-mp.fsum(q[j] * (1 - mp.mpf(j) / (2 * m)) * g[m - j] for j in range(1, min(m, 2 * n) + 1)))
        self.series = g
        rate = max(float(mp.root(abs(x), i)) for i, x in enumerate(g) if i)
        self.guess = pade_roots(self.k)
        reach = float(self.size * abs(time)) * float(np.max(np.abs(self.guess))) * rate
        self.halvings = max(0, math.ceil(math.log2(reach / REACH)))

    def divisor(self) -> Divisor:
        """The step over time · 2^−halvings: U, V and the turn."""
        length = self.size * abs(self.time) / 2**self.halvings  # the scale of λ − a_site
        z, excess = self._solve([x * length**i for i, x in enumerate(self.series)])
        sign = 1 if self.time > 0 else -1
        U, V = np.array([mp.mpf(1)]), np.array([mp.mpf(0)])
        for lam in (length * x for x in z):
            y = mp.sqrt(horner(self.Q, lam))
            y = sign * (y if (y * self.root).real > 0 else -y)
            value = (1j * y - horner(V, lam)) / horner(U, lam)
            slope = value.imag / lam.imag
            V = polyadd(V, np.convolve(U, np.array([value.real - slope * lam.real, slope])))
            U = np.convolve(U, np.array([abs(lam) ** 2, -2 * lam.real, mp.mpf(1)]))
        # the times of the maps are those of the flow and a common one, which the turn takes back
        common = sign * excess * length ** (2 * self.k + 1) / self.root if self.odd else mp.mpf(0)
        return Divisor(U, V, -2 * self.alpha * common)

    def _solve(self, g: list) -> tuple[list, Any]:
        """z_i with Σ Im ∫_0^z w^m Σ g_j w^j dw = (1, 0, 0, …), m < 2k, and the same sum for m = 2k."""
        k, z = self.k, [mp.mpmathify(x) for x in self.guess.tolist()]
        integrals = [[c / (m + j + 1) for j, c in enumerate(g)] for m in range(2 * k + 1)]
        for _ in range(100):
            rests, J = [], mp.matrix(2 * k, 2 * k)
            for i, x in enumerate(z):
                powers = [x]
                while len(powers) < len(g) + 2 * k:
                    powers.append(powers[-1] * x)
                heights = [power.imag for power in powers]
                rests.append([mp.fdot(integrals[m], heights[m : m + len(g)]) for m in range(2 * k + 1)])
                slope = mp.fdot(g, [mp.mpf(1), *powers[: len(g) - 1]])
                for m in range(2 * k):
                    J[m, i], J[m, k + i] = slope.imag, slope.real
                    slope *= x
            sums = [mp.fsum(column) for column in zip(*rests, strict=True)]
            delta = mp.lu_solve(J, mp.matrix([1 - sums[0], *(-x for x in sums[1 : 2 * k])]))
            z = [x + mp.mpc(delta[i], delta[k + i]) for i, x in enumerate(z)]
            if max(abs(x) for x in delta) < mp.mpf(10) ** (2 - mp.dps):
                return z, sums[2 * k]
        raise ArithmeticError("the parameters of a short step were not found")


# ------------------------------------------------------------------------------------------ polynomials, ascending


def euclid(m: Any, p: Any, degree: int) -> Iterator[tuple[Numbers, Numbers]]:
    """Rows r, t with r ≡ t p mod m of Euclid's algorithm: the last of degree above `degree`, and all that follow it."""
    row, following = (m, np.array([mp.mpf(0)])), (p, np.array([mp.mpf(1)]))
    while True:
        if len(following[0]) - 1 <= degree:
            yield row
        quotient, rest = polydiv(row[0], following[0])
        row, following = following, (rest, polyadd(row[1], -np.convolve(quotient, following[1])))


def inverse(p: Numbers, m: Numbers) -> Numbers:
    """1/p mod m."""
    rows = euclid(m, polydiv(p, m)[1], 0)
    _, (one, t) = next(rows), next(rows)
    return t / one[0]


def rough_roots(p: Numbers) -> Numbers:
    """All roots, in double."""
    p = p.astype(float)
    if not np.all(np.isfinite(p)):
        raise ArithmeticError("a polynomial left the range of doubles")
    return np.roots(p[::-1])


def upper_roots(U: Numbers) -> list:
    """The roots of a positive polynomial in the upper half-plane. Source: Ehrlich, Commun. ACM 10 (1967) 107; Aberth."""
    guess = rough_roots(U)
    guess = guess[np.argsort(-guess.imag)][: len(U) // 2]
    lowest = 1e-3 * np.max(np.abs(guess))  # a pair close to the real axis may have been taken for two real roots
    z = [mp.mpc(x.real, x.imag if x.imag > 0 else lowest * (i + 1)) for i, x in enumerate(guess)]
    slope = U[1:] * np.arange(1, len(U))
    for _ in range(200):
        others = [*z, *(x.conjugate() for x in z)]
        steps = []
        for i, x in enumerate(z):
            newton = horner(U, x) / horner(slope, x)
            pull = mp.fsum(1 / (x - y) for j, y in enumerate(others) if j != i)
            steps.append(newton / (1 - newton * pull))
        z = [x - step for x, step in zip(z, steps, strict=True)]
        if all(abs(step) <= mp.mpf(10) ** (5 - 2 * mp.dps / 3) * abs(x) for x, step in zip(z, steps, strict=True)):
            return [x if x.imag > 0 else x.conjugate() for x in z]
    raise ArithmeticError("the parameters of a step were not found")


def _coefficient(p: Numbers, power: int) -> Any:
    return p[power] if 0 <= power < len(p) else mp.mpf(0)
