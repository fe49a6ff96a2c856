"""A Lagrange top on a pivot that vibrates up and down: a Hamiltonian that depends on time.

    H = |J|²/2 + alpha(t) x3,   alpha(t) = alpha + strength cos(frequency t)

In the frame of the pivot, its acceleration adds to gravity. J3, |x|² and x·J are conserved, H is not. A fast vibration holds an
upright top that would fall without it: on average it acts like a term (strength/(2 frequency))² (x1² + x2²) in H.

Source: Kapitza, Zh. Eksp. Teor. Fiz. 21 (1951) 588; Landau & Lifshitz, Mechanics (1976), section 30.
"""

from __future__ import annotations

from typing import Any

from lagrange_bench.integrators.compiling.expression import cos
from lagrange_bench.integrators.problem.problem import Problem


def vibrating_pivot(alpha: float, strength: float, frequency: float) -> Problem:
    """The top on a vibrating pivot.

    Parameters
    ----------
    alpha, strength : float
        Mean and amplitude of the weight parameter, in units of J²/x.
    frequency : float
        Radians per unit of time, in units of J.

    Returns
    -------
    Problem
        Its Hamiltonian depends on t.
    """

    def hamiltonian(t: Any, y: Any, p: Any) -> Any:
        return (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / 2.0 + (p[0] + p[1] * cos(p[2] * t)) * y[5]

    numbers = (alpha, strength, frequency)
    return Problem("vibrating_pivot", "e3", hamiltonian, numbers, invariants={"J3": lambda t, y, p: y[2]})
