"""What the tests of the paper share: random points in double or in any number of digits."""

import random

import numpy as np
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import LagrangeTop
from lagrange_bench.integrators.paper.phase_space import gradient, poisson_tensor
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


def size(*states):
    """Size of the terms of a one-point map: cubic in its arguments."""
    return max(1, *(largest(y) for y in states)) ** 3


def chart_size(top, y, first, second):
    """Size of the terms of a two-point map in the chart (x, X), of degree six in x and X."""
    x, X = parameters(top, y, first, second)
    return (1 + abs(x)) ** 3 * (1 + abs(X)) ** 2 * (1 + largest(y)) ** 2


def poisson_defect(f, y):
    """Largest entry of D P(y) Dᵀ − P(f(y)), and of D, which says what round-off it may have."""
    D = gradient(f, y)
    return largest(D @ poisson_tensor(y) @ D.T - poisson_tensor(f(y))), 1 + largest(D)


CANONICAL = np.kron(((0, 1), (-1, 0)), np.eye(2, dtype=int))  # {q_k, p_l} = δ_kl of (q1, q2, p1, p2)
