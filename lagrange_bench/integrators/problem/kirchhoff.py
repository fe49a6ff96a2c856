"""Kirchhoff's body: a rigid body in an ideal fluid at rest at infinity, in the frame of the body.

    H = Σ (a_i J_i² + 2 b_i J_i x_i + c_i x_i²)/2,   J' = J × ∂H/∂J + x × ∂H/∂x,   x' = x × ∂H/∂J

J is the angular and x the linear momentum of body and fluid. a holds the inverse moments, b the coupling of a screw, and c the
inverse masses, all with the fluid. |x|² and x·J are conserved. If a, b and c are the same for the first two axes, J3 is
conserved, too (Kirchhoff's integrable case). In general the motion is chaotic.

Source: Lamb, Hydrodynamics (1932), chapter VI, sections 117 to 126.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lagrange_bench.integrators.problem.problem import Problem


def kirchhoff_body(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> Problem:
    """A body with three planes of symmetry, or a screw, in an ideal fluid.

    Parameters
    ----------
    a, b, c : (3,)
        The coefficients of J_i², J_i x_i and x_i².

    Returns
    -------
    Problem
        On "e3", in the body's frame.

    Raises
    ------
    ValueError : a, b or c has not three finite real numbers.
    """
    numbers = (*a, *b, *c)
    if len(a) != 3 or len(b) != 3 or len(c) != 3:
        raise ValueError(f"a, b and c must be three numbers each; got {a}, {b}, {c}")

    def hamiltonian(t: Any, y: Any, p: Any) -> Any:
        J, x = y[:3], y[3:]
        terms = (p[i] * J[i] * J[i] + 2.0 * p[3 + i] * J[i] * x[i] + p[6 + i] * x[i] * x[i] for i in range(3))
        return sum(terms) / 2.0

    round_body = all(part[0] == part[1] for part in (a, b, c))
    invariants = {"J3": lambda t, y, p: y[2]} if round_body else {}
    return Problem("kirchhoff_body", "e3", hamiltonian, numbers, invariants=invariants, frame="body")
