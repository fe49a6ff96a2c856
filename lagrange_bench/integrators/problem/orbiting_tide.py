"""The tide of a body on an eccentric orbit: a quadratic potential that turns and pulses, a Hamiltonian that depends on time.

    H = |J|²/2 + alpha x3 + strength (a/r)³ (n·x)²,   n = (cos f, sin f, 0)

x is the axis of a symmetric satellite or planet (alpha = 0), and n the direction to the other body, in a plane normal to e3. r is
its distance, a the semi-major axis, f the true anomaly. With moments of inertia A and C, A = 1, and a distant mass m the strength
is 3/2 G m (C − A)/a³.

Kepler's equation has no closed solution. So Fourier series in the mean anomaly M = motion·t are taken, to the second order in the
eccentricity e; they miss a part of the order e³. The problem has exactly this H:

    (a/r)³         = 1 + 3e²/2 + 3e cos M + 9e²/2 cos 2M
    (a/r)³ cos 2f  = −e/2 cos M + (1 − 5e²/2) cos 2M + 7e/2 cos 3M + 17e²/2 cos 4M,   sin 2f as cos 2f

|x|² and x·J are conserved, H and J3 are not.

Source: MacCullagh's formula and Hansen's coefficients: Murray & Dermott, Solar System Dynamics (1999), chapters 2 and 5; Kaula,
Theory of Satellite Geodesy (1966), the functions G_lpq(e) with l = 2.
"""

from __future__ import annotations

from typing import Any

from lagrange_bench.integrators.compiling.expression import cos, sin
from lagrange_bench.integrators.problem.problem import Problem


def orbiting_tide(strength: float, eccentricity: float, motion: float, alpha: float = 0.0) -> Problem:
    """The top in a tide along an eccentric orbit.

    Parameters
    ----------
    strength : float
        In units of J²/x².
    eccentricity : float
        Of the orbit.
    motion : float
        Radians of mean anomaly per unit of time, in units of J.
    alpha : float
        Of the uniform field, in units of J²/x.

    Returns
    -------
    Problem
        Its Hamiltonian depends on t.
    """

    def hamiltonian(t: Any, y: Any, p: Any) -> Any:
        k, e, rate, weight = p
        M, (_, _, _, a, b, c) = rate * t, y
        mean = 1.0 + 1.5 * e * e + 3.0 * e * cos(M) + 4.5 * e * e * cos(2.0 * M)
        once, thrice = -0.5 * e, 3.5 * e  # factors of the harmonics beside the second
        twice, four = 1.0 - 2.5 * e * e, 8.5 * e * e
        even = once * cos(M) + twice * cos(2.0 * M) + thrice * cos(3.0 * M) + four * cos(4.0 * M)
        odd = once * sin(M) + twice * sin(2.0 * M) + thrice * sin(3.0 * M) + four * sin(4.0 * M)
        tide = mean * (a * a + b * b) + even * (a * a - b * b) + 2.0 * odd * a * b
        return (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / 2.0 + weight * c + 0.5 * k * tide

    return Problem("orbiting_tide", "e3", hamiltonian, (strength, eccentricity, motion, alpha))
