"""The free rigid body in its own frame, and its closed form: Euler's equations, solved by Jacobi's elliptic functions.

    J' = J × ω,   ω_i = J_i/I_i,   H = Σ J_i²/(2 I_i),   C = |J|²

Between the axis of the largest and that of the smallest moment, J follows one or the other on its sphere, as C exceeds
2H I of the middle axis or not. There

    J_i = α cn τ,  J_j = β sn τ,  J_k = γ dn τ,   τ = λ t + τ0,

with k the axis it goes round.

Source: Landau & Lifshitz, Mechanics (1976), section 37.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_numbers, check_real, check_times
from lagrange_bench.integrators.problem.problem import Problem


def free_body(I1: float, I2: float, I3: float) -> Problem:
    """A rigid body about its centre of mass.

    Parameters
    ----------
    I1, I2, I3 : float
        Moments of inertia, in any unit.

    Returns
    -------
    Problem
        Its state y is the angular momentum (3,) in the body's frame.
    """
    moments = [check_real(moment, f"I{i}") for i, moment in enumerate((I1, I2, I3), 1)]
    if min(moments) <= 0.0:
        raise ValueError(f"moments of inertia must be positive; got {moments}")

    def hamiltonian(t, y, p):
        return (y[0] * y[0] / p[0] + y[1] * y[1] / p[1] + y[2] * y[2] / p[2]) / 2.0

    return Problem("free_body", "so3", hamiltonian, moments, frame="body")


def solution(body: Problem, y0: ArrayLike, times: ArrayLike) -> Array:
    """The closed form: angular momenta (len(times), 3) of a body with three different moments of inertia.

    Raises
    ------
    ValueError : two moments are equal, or the body turns on the separatrix, where the formulas end.
    """
    from scipy.special import ellipj, ellipkinc

    J, t, a = check_numbers(y0, "y0", 3), check_times(times), 1.0 / np.array(body.numbers)
    C, D = float(J @ J), float(a @ (J * J))  # |J|² and 2 H
    i, j, k = (int(axis) for axis in np.argsort(-a))  # a_i > a_j > a_k: J goes round axis k if C a_j > D
    if C * a[j] < D:
        i, k = k, i
    across, along = (D - a[k] * C) / (a[i] - a[k]), (a[i] * C - D) / (a[i] - a[k])
    if len({*body.numbers}) < 3 or C * a[j] == D or along * (a[j] - a[k]) == 0.0:
        raise ValueError("the closed form needs three different moments and a J off the separatrix")
    m = (a[i] - a[j]) * across / ((a[j] - a[k]) * along)
    rate = math.sqrt((a[j] - a[k]) * (a[i] - a[k]) * along)
    gamma = math.copysign(math.sqrt(along), J[k])
    # the equations are those of the axes 1, 2, 3 in this order, but for the sign of an odd permutation and of a_i − a_k
    turn = float(np.linalg.det(np.eye(3)[[i, j, k]])) * math.copysign(1.0, a[i] - a[k]) * math.copysign(1.0, J[k])
    alpha, beta = math.sqrt(across), turn * math.sqrt(across * (a[i] - a[k]) / (a[j] - a[k]))
    start = ellipkinc(math.atan2(J[j] / beta, J[i] / alpha), m) if across else 0.0
    sn, cn, dn, _ = ellipj(rate * t + start, m)
    out = np.empty((len(t), 3))
    out[:, i], out[:, j], out[:, k] = alpha * cn, beta * sn, gamma * dn
    return out
