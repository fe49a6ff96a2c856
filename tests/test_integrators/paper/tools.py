"""What the tests of the paper share: random points in double or in any number of digits, and exact derivatives."""

import random

import numpy as np
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import LagrangeTop
from lagrange_bench.integrators.paper.phase_space import poisson_tensor
from lagrange_bench.integrators.paper.two_point import parameters
from tests.reference import largest


class Point:
    """A random top, state y, λ, ν and u, and more complex numbers. `tol` is what an identity may miss by."""

    def __init__(self, digits, seed):
        self.rng, self.digits, self.sheet = random.Random(seed), digits, (1, -1)[seed % 2]
        self.tol = 1e-12 if digits == 15 else mpf(10) ** (12 - digits)
        self.top = LagrangeTop(self.rng.choice((-1.5, 0.5, 1.5)) + self.rng.choice((0.0, 0.25)))
        self.y, (self.lam, self.nu), self.u = self.numbers(6), self.numbers(2), 2 * self.number()

    def number(self):
        """Complex, in the unit square around a corner of it: never small."""
        parts = [self.rng.choice((-1, 1)) * (mpf(self.rng.getrandbits(200)) / 2**200 + 1) / 2 for _ in range(2)]
        return complex(*parts) if self.digits == 15 else mpc(*parts)

    def numbers(self, n):
        return np.array([self.number() for _ in range(n)])

    def same(self, a, b, terms=1):
        """Equality up to round-off, relative to 1, to the largest entry or to the size of the terms behind them."""
        scale = max(1, terms, largest(a), largest(b))
        error = largest(np.asarray(a) - np.asarray(b))
        assert error <= self.tol * scale, (error, scale)


def at_point(digits, seed):
    """The point, with the working precision set while it is in use."""
    with mp.workdps(digits):
        yield Point(digits, seed)


class Dual:
    """A number with its derivatives: + − * / and powers, so that a Jacobian is exact to round-off."""

    def __init__(self, value, d):
        self.value, self.d = value, d

    def _split(self, other):
        return (other.value, other.d) if isinstance(other, Dual) else (other, 0 * self.d)

    def __add__(self, other):
        value, d = self._split(other)
        return Dual(self.value + value, self.d + d)

    def __mul__(self, other):
        value, d = self._split(other)
        return Dual(self.value * value, self.d * value + self.value * d)

    def __pow__(self, n):
        power = self.value**n
        return Dual(power, self.d * (n * power / self.value))

    def __neg__(self):
        return Dual(-self.value, -self.d)

    def __sub__(self, other):
        return self + (-other)

    def __rsub__(self, other):
        return -self + other

    def __truediv__(self, other):
        return self * other**-1 if isinstance(other, Dual) else Dual(self.value / other, self.d / other)

    def __rtruediv__(self, other):
        return self**-1 * other

    __radd__, __rmul__ = __add__, __mul__

    def __complex__(self):
        return complex(self.value)

    def __abs__(self):
        return abs(self.value)


def duals(z):
    """The numbers z (n,) as independent variables."""
    z = np.asarray(z)
    unit = np.eye(len(z), dtype=int) * (0 * z[0] + 1)  # in the precision of z
    return np.array([Dual(v, d) for v, d in zip(z, unit, strict=True)], dtype=object)


def jacobian(f, z):
    """Derivative (m, n) of f: (n,) → (m,) at z, exact to round-off; f made of + − * / and roots."""
    return np.stack([v.d if isinstance(v, Dual) else np.zeros(len(z)) for v in np.asarray(f(duals(z))).ravel()])


def size(*states):
    """Size of the terms of a one-point map: cubic in its arguments."""
    return max(1, *(largest(y) for y in states)) ** 3


def chart_size(top, y, first, second):
    """Size of the terms of a two-point map in the chart (x, X), of degree six in x and X."""
    x, X = parameters(top, y, first, second)
    return (1 + abs(x)) ** 3 * (1 + abs(X)) ** 2 * (1 + largest(y)) ** 2


def poisson_defect(f, y):
    """Largest entry of D P(y) Dᵀ − P(f(y)), and of D, which says what round-off it may have."""
    D = jacobian(f, y)
    return largest(D @ poisson_tensor(y) @ D.T - poisson_tensor(f(y))), 1 + largest(D)


CANONICAL = np.array(
    ((0, 0, 1, 0), (0, 0, 0, 1), (-1, 0, 0, 0), (0, -1, 0, 0))
)  # {q_k, p_l} = δ_kl of (q1, q2, p1, p2)
