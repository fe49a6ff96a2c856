"""Motions on a curve y² = f(x), deg f <= 4, at any time and with a proven error, by the group law in ball arithmetic.

Along a motion a coordinate x obeys x'² = f(x), and y = x'. Complex quantities Z obey Z'/Z = R(x, y) with a rational R. As a
function on the curve, each Z has simple zeros (v, c) and as many simple poles, at the points at infinity. Let P(t) be the point
(x, y) at the time t, and −P = (x, −y). The parabola y = A(x) = A0 + A1 x + A2 x² through −P(t), −P(u) and P(0) meets the curve
in one more point, and that is P(t + u):

    A(x) = −y(t) + a (x − x(t)) + b (x − x(t)) (x − x(u))
    a = (y(t) − y(u))/(x(u) − x(t))                        for u = t the tangent, a = −f'(x(t))/(2 y(t))
    b = ((y(0) + y(t))/(x(0) − x(t)) − a)/(x(0) − x(u))
    x(t + u) + x(t) + x(u) + x(0) = (f3 − 2 A1 A2)/(A2² − k)        y(t + u) = A(x(t + u))
    Z(t + u) = Z(t) Z(u)/Z(0) · Π (c − A(v))/((v − x(t)) (v − x(u)))/N                                    `Curve.add`

k and f3 are the coefficients of x⁴ and x³ in f; the product is over the zeros of Z; N = A2² − k if Z has two zeros and two poles,
and N = −A2 if it has one of each, where k = 0. So the state at t/2^n leads by n *doublings* to the state at t. Nothing else is
needed: no roots, periods or theta functions, and double roots of f or zeros of Z are no special cases.

Proof. The function g = y − A(x) has the zeros −P(t), −P(u), P(0), Q, and its poles are at infinity. By Abel's theorem ∫ dx/y over
the four zeros does not depend on A; here dx/y = dt, so Q moves with the time t + u, and Q = P(0) for t = u = 0. The same theorem
for the differential d log Z = R dx/y, which has the residues +1 at the zeros p of Z and −1 at its poles q, says

    d log Z(−P(t)) + d log Z(−P(u)) + d log Z(Q) = Σ_p d log g(p) − Σ_q d log g(q).

d log (Z(P) Z(−P)) is rational in x and has the poles and residues of d log Π (v − x), so Z(P) Z(−P) is const Π (v − x).
At infinity g = (±√k − A2) x² + …, so the poles contribute d log (A2² − k), and for k = 0 a single one d log A2. Hence both sides
of the formula for Z have one quotient. It is 1, since for t, u → 0 the parabola becomes steep, A2 → ∞, g ~ −A2 (x − x(0))², and
both sides tend to Z(0). ∎

P(0) may be any point of the motion. The code takes the *base point*, at a short time after the start.

**The first step** is a Taylor series of the equations of motion, u' = B(u, u) + C u. Its parts, over their scales, have norms at
most 1 at t = 0, and their rates at most r times the product of two such norms, or of one. So w' = r w², w(0) = 1 is a majorant:
its solution is 1/(1 − r t), the norms of all coefficients are at most r^n, and after N terms the rest is at most

    |r t|^N/(1 − |r t|).                                                                                     `Top.near`

Balls (Arb) hold the true value after every operation; the precision is raised until they are small (`certified`).

Sources: Miller, The Weil pairing, and its efficient calculation, J. Cryptology 17 (2004) (the formula for Z, for pairings);
Johansson, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic, arXiv 1611.02831.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

from flint import acb, arb, fmpq

from lagrange_bench.support.precision import workprec

I = acb(0, 1)
MOST_BITS = 60_000  # of precision; a motion 1e-1000 beside the separatrix needs about as many
FIRST_BITS = 64  # of precision beyond the digits, to begin with
LOST = 6  # bits that one doubling usually loses
BITS = 192  # of periods and turns; with 105 of them doubles lose nothing

Terms = tuple[tuple[Any, ...], ...]  # of a rate: (c, i) stands for c u_i, (c, i, j) for c u_i u_j


class Uncertain(ArithmeticError):
    """The precision does not suffice."""


def rational(v: Any) -> fmpq:
    """A double, int, fraction or mpf without rounding."""
    if hasattr(v, "_mpf_"):
        sign, mantissa, exponent, _ = v._mpf_
        return fmpq(-int(mantissa) if sign else int(mantissa)) * fmpq(2) ** int(exponent)
    v = Fraction(v)
    return fmpq(v.numerator, v.denominator)


def midpoint(v: arb) -> fmpq:
    """The midpoint of a ball."""
    mantissa, exponent = v.mid().man_exp()
    return fmpq(int(mantissa)) * fmpq(2) ** int(exponent)


def around(size: Any) -> arb:
    """The ball about 0 that holds all numbers up to a size."""
    return abs(arb(size)).upper() * arb(0, 1)


def above(v: arb) -> fmpq:
    """A rational number above a ball."""
    return midpoint(v.upper())


def power_above(v: arb) -> fmpq:
    """The next power of two; 1 for 0."""
    mantissa, exponent = v.upper().man_exp()
    return fmpq(2) ** (int(exponent) + int(mantissa).bit_length()) if mantissa else fmpq(1)


# ---------------------------------------------------------------- the group law


class Point(NamedTuple):
    """A point of the curve and the values of all Z there."""

    x: arb
    y: arb
    Z: tuple[acb, ...]


class Parabola(NamedTuple):
    A0: arb
    A1: arb
    A2: arb


class Zero(NamedTuple):
    """The zero (v, c) of a Z that has one zero and one pole; k = 0."""

    v: arb
    c: acb

    def ratio(self, A: Parabola, k: arb, x1: arb, x2: arb) -> acb:
        """Z(t + u) Z(0)/(Z(t) Z(u))."""
        v = self.v
        return (self.c - (A.A0 + (A.A1 + A.A2 * v) * v)) / ((v - x1) * (v - x2) * -A.A2)


class Zeros(NamedTuple):
    """The zeros x = ±√(v0/v1), y = c0 + c1 x of a Z that has two; v1 = 0 means that they are at infinity."""

    c0: acb
    c1: acb
    v0: arb
    v1: arb

    def ratio(self, A: Parabola, k: arb, x1: arb, x2: arb) -> acb:
        """Z(t + u) Z(0)/(Z(t) Z(u)). c − A(v) is even + odd v; the product over both zeros needs no root."""
        v0, v1 = self.v0, self.v1
        even, odd = v1 * (self.c0 - A.A0) - v0 * A.A2, self.c1 - A.A1
        apart = (v0 - v1 * x1 * x1) * (v0 - v1 * x2 * x2)
        return (even * even - odd * odd * (v0 * v1)) / (apart * (A.A2 * A.A2 - k))


class Curve(NamedTuple):
    """f by its coefficients, without f(0), the zeros of each Z, and the base point P(0)."""

    f1: arb
    f2: arb
    f3: arb
    k: arb
    zeros: tuple[Zero | Zeros, ...]
    base: Point

    def add(self, p: Point, q: Point) -> Point:
        """P(t + u) from P(t) and P(u); the same object twice for a doubling."""
        base, k = self.base, self.k
        apart, d = q.x - p.x, base.x - p.x
        a = -self.slope(p.x) / (2 * p.y) if p is q else (p.y - q.y) / apart
        b = ((base.y + p.y) / d - a) / (base.x - q.x)
        # x(t + u) − x(t), from the sum of all roots of A² − f, counted from x(t)
        step = (self.f3 + 4 * k * p.x - 2 * b * (a - b * apart)) / (b * b - k) - d - apart
        A = Parabola((b * q.x - a) * p.x - p.y, a - b * (p.x + q.x), b)
        factors = zip(self.zeros, base.Z, p.Z, q.Z, strict=True)
        Z = tuple(z1 * z2 / z0 * zero.ratio(A, k, p.x, q.x) for zero, z0, z1, z2 in factors)
        return Point(p.x + step, (b * (step - apart) + a) * step - p.y, Z)

    def slope(self, x: arb) -> arb:
        """f'(x)."""
        return ((4 * self.k * x + 3 * self.f3) * x + 2 * self.f2) * x + self.f1

    def multiples(self, first: Point, count: int) -> list[Point]:
        """The points at 0, 1, …, count times the time of `first`; by sums of halves, so that errors do not add up."""
        points = [self.base, first]
        for n in range(2, count + 1):
            points.append(self.add(points[n // 2], points[n - n // 2]))
        return points


# ---------------------------------------------------------------- Taylor series


def series(rates: Sequence[Terms], start: Sequence[Any], unit: Any, terms: int) -> list[list[Any]]:
    """Taylor coefficients in t/unit of the solution of u' = Σ c u_i u_j + Σ c u_i; u may be balls, or arrays of doubles."""
    u = [[v] for v in start]
    products = {tuple(places) for row in rates for _, *places in row if len(places) == 2}
    for n in range(terms - 1):
        value: dict[tuple[int, ...], Any] = {(i, j): sum(map(mul, u[i], u[j][::-1])) for i, j in products}
        value |= {(i,): coefficients[n] for i, coefficients in enumerate(u)}
        for coefficients, row in zip(u, rates, strict=True):
            total = sum((c * value[tuple(places)] for c, *places in row), 0 * coefficients[0])
            coefficients.append(total * unit / (n + 1))
    return u


def horner(coefficients: Any, x: Any) -> Any:
    """The value of a polynomial; coefficients by increasing power."""
    value = coefficients[-1]
    for c in coefficients[-2::-1]:
        value = value * x + c
    return value


def certified(compute: Callable[[], list[arb]], radii: Sequence[fmpq], bits: int) -> list[arb]:
    """compute() at rising precision, until the radii of its balls are below these ones.

    Raises
    ------
    ValueError
        MOST_BITS do not suffice.
    """
    bits = -(-bits // 64) * 64  # so that kept series are used again
    while bits <= MOST_BITS:
        with workprec(bits):
            try:
                balls = compute()
            except Uncertain:
                balls = []
            if balls and all(v.is_finite() and v.rad() <= most for v, most in zip(balls, radii, strict=True)):
                return balls
        bits = -(-(bits * 3 // 2) // 64) * 64
    raise ValueError(f"{MOST_BITS} bits do not suffice: take an earlier time, or fewer digits")
