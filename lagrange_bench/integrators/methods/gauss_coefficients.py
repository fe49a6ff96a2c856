"""Coefficients of Gauss collocation, for any number s of stages: nodes c, weights b and μᵢⱼ = aᵢⱼ/bⱼ.

With the Legendre polynomials L_k at the nodes zᵢ on [−1, 1],

    μᵢⱼ = ½ + ½ Σ_{0<k<s} (L_k(zᵢ) L_{k−1}(zⱼ) − L_{k−1}(zᵢ) L_k(zⱼ)).

μ is computed in exact fractions, then rounded to multiples of 2⁻⁵². So μᵢⱼ + μⱼᵢ = 1 stays exact. Rounded a and b would miss it
in every step the same way, and the invariants would drift in proportion to time.

Source: Antoñana, Makazaga & Murua, Numer. Algorithms 76 (2017) 861 (μ).
"""

import math
from fractions import Fraction
from functools import cache

import numpy as np

from lagrange_bench.integrators.interface import Array


@cache
def tableau(stages: int) -> tuple[list[Fraction], list[Fraction], list[list[Fraction]]]:
    """Nodes c on [0, 1], weights b and μ, to 35 digits (μ + μᵀ = 1 without error)."""
    z = legendre_zeros(stages)
    L = [legendre(stages, x) for x in z]
    b = [(1 - x * x) / (stages * P[stages - 1]) ** 2 for x, P in zip(z, L, strict=True)]
    mu = [[sum((P[k] * Q[k - 1] - P[k - 1] * Q[k] for k in range(1, stages)), Fraction(1)) / 2 for Q in L] for P in L]
    return [(1 + x) / 2 for x in z], b, mu


def legendre(n: int, x: Fraction) -> list[Fraction]:
    """L₀(x), …, Lₙ(x)."""
    L = [Fraction(1), x]
    for k in range(1, n):
        L.append(((2 * k + 1) * x * L[k] - k * L[k - 1]) / (k + 1))
    return L


def legendre_zeros(n: int) -> list[Fraction]:
    """The zeros of Lₙ in rising order, to multiples of 2⁻¹²⁰, by Newton's iteration from doubles."""
    zeros = []
    for k in range(n):
        x = Fraction(-math.cos(math.pi * (k + 0.75) / (n + 0.5)))
        for _ in range(6):
            L = legendre(n, x)
            x -= L[n] * (1 - x * x) / (n * (L[n - 1] - x * L[n]))
            x = Fraction(round(x * 2**120), 2**120)
        zeros.append(x)
    return [(a - b) / 2 for a, b in zip(zeros, reversed(zeros), strict=True)]


@cache
def matrices(stages: int) -> tuple[Array, Array, Array, Array, Array]:
    """c, b, μ, μ⁻¹ and the matrix that extrapolates K from one step to the next, in doubles."""
    c, b, mu = tableau(stages)
    grid = 2**52
    nodes, weights = np.array(c, dtype=float), np.array(b, dtype=float)
    mu_doubles = np.array([[round(m * grid) / grid for m in row] for row in mu])
    extrapolation = np.vander(nodes + 1) @ np.linalg.inv(np.vander(nodes)) * weights[:, None] / weights
    return nodes, weights, mu_doubles, np.linalg.inv(mu_doubles), extrapolation
