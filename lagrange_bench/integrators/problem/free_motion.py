"""The free rigid body in its own frame: Euler's equations and the constants of their solution.

    L' = L × ω,   ω = L/I,   a = 1/I,   G = |L|,   D = Σ a L²

j is the axis of the middle moment. L goes round axis k: if D < a_j G², the axis of the largest moment, otherwise of the smallest.
i is the third axis. Then

    L_i = α cn u,  L_j = β sn u,  L_k = γ dn u,   u = λ t + u0
    α² = (D − a_k G²)/(a_i − a_k)      β² = (D − a_k G²)/(a_j − a_k)      γ² = (a_i G² − D)/(a_i − a_k)
    λ² = (a_j − a_k)(a_i G² − D)       1 − k² = (a_i − a_k)(a_j G² − D)/λ²

In 1 − k², k is the modulus; it is 1 on the separatrix. All differences are exact fractions of the doubles, so nothing cancels.
Roots have 128 bits.

Source: Landau & Lifshitz, Mechanics (1976), section 37.
"""

import math
from fractions import Fraction
from typing import NamedTuple

from lagrange_bench.integrators.checks import Array

MARGIN = 256  # bits of a square whose root is taken


class FreeMotion(NamedTuple):
    """Constants of the motion through one L, in the letters of the module. `axes` are the numbers of i, j, k."""

    axes: tuple[int, int, int]
    amplitudes: tuple[float, float, float]  # α, β, γ with their signs: u0 is within a quarter period of 0
    start: tuple[float, float]  # sn and cn of u0
    complement: float  # 1 − k²
    rate: Fraction  # λ
    momentum: Fraction  # G
    inverse: tuple[Fraction, Fraction, Fraction]  # a_i, a_j, a_k
    low: Fraction  # D − a_k G²
    middle: Fraction  # a_j G² − D
    high: Fraction  # a_i G² − D


def free_motion(inertia: Array, L: Array) -> FreeMotion | None:
    """The constants of the motion through L (3,), for principal moments `inertia` (3,); None if L is constant."""
    I, J = (tuple(map(Fraction, v.tolist())) for v in (inertia, L))
    a = [1 / v for v in I]
    if all(J[n] * J[m] * (a[n] - a[m]) == 0 for n, m in ((0, 1), (1, 2), (2, 0))):
        return None
    squares = [v * v for v in J]
    i, j, k = sorted(range(3), key=lambda n: -a[n])
    # a_j G² − D: if it is 0, both choices of k give the same motion
    if (a[j] - a[i]) * squares[i] + (a[j] - a[k]) * squares[k] < 0 or a[j] == a[k]:
        i, k = k, i
    ij, jk, ik = a[i] - a[j], a[j] - a[k], a[i] - a[k]
    low = ik * squares[i] + jk * squares[j]  # D − a_k G²
    high = ij * squares[j] + ik * squares[k]  # a_i G² − D
    middle = jk * squares[k] - ij * squares[i]  # a_j G² − D
    odd = (i, j, k) in ((0, 2, 1), (2, 1, 0), (1, 0, 2))
    alpha, beta, gamma = (float(root(v)) for v in (low / ik, low / jk, high / ik))
    alpha, gamma = math.copysign(alpha, L[i]), math.copysign(gamma, L[k])
    turn = (-1.0 if odd else 1.0) * math.copysign(1.0, alpha) * math.copysign(1.0, gamma) * (1.0 if ik > 0 else -1.0)
    beta *= turn  # L_j' = ± (a_i − a_k) L_k L_i
    sine, cosine = (float(root(v / low)) for v in (squares[j] * jk, squares[i] * ik))
    return FreeMotion(
        axes=(i, j, k),
        amplitudes=(alpha, beta, gamma),
        start=(turn * math.copysign(sine, L[j]), cosine),
        complement=float(ik * middle / (jk * high)),
        rate=root(jk * high),
        momentum=root(sum(squares, Fraction(0))),
        inverse=(a[i], a[j], a[k]),
        low=low,
        middle=middle,
        high=high,
    )


def root(square: Fraction) -> Fraction:
    """√square, to 128 bits."""
    p, q = square.numerator, square.denominator
    shift = max(0, MARGIN - p.bit_length() + q.bit_length())
    shift += shift & 1
    return Fraction(math.isqrt((p << shift) // q), 1 << (shift // 2))


def period(inertia: Array, L: Array) -> float:
    """4K/λ: the time in s after which L and ω come back in the body; 0 if they are constant, inf on the separatrix."""
    from scipy.special import ellipkm1

    motion = free_motion(inertia, L)
    return 0.0 if motion is None else float(4.0 * ellipkm1(motion.complement) / float(motion.rate))
