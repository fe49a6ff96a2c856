"""The discrete Lagrange top of Bobenko and Suris has a Lax pair, and is a two-point Bäcklund map in disguise.

The paper mentions it before section 5.1: “their discrete Lax matrix is deformed with respect to the continuous one”. The step is
that of `methods.bobenko_suris`, symmetric form: K = J + (h/2) alpha e3×x, x̃ − x = (h/2) K×(x + x̃),
J̃ = K + (h/2) alpha e3×x̃. With

    K₋ = J − (h/2) alpha e3×x        X = (1 + alpha h² x3/4) x − (h/2) J×x                         (`deformed`)
    L(u) = i σ·(alpha e3 + K₋/u + X/u²)        M(u) = u + (ih/2) σ·x                             (`lax_matrix`, `dressing`)

M L = L̃ M, and (K₋, X) moves by the two-point map of section 5.5, w = (h/2) x, at the point

    λ = i h |x|/2        m = |x| + i h x·J/2                                                     (`curve_point`)

of the deformed curve m² = Q_h(λ). Each step is the flow of the top with the state (K₋, X), over a time T and with a turn Θ that
are elliptic integrals (`clock`). The map of Kahan, Hirota and Kimura, `methods.kahan`, is the same map again, at another state
with another step (`of_kahan`). Proofs: Propositions 8 and 9 in docs/exact-step.md.

Sources: Bobenko & Suris, Commun. Math. Phys. 204 (1999) 147, and Suris, J. Nonlinear Math. Phys. 8 (2001) 534. Their abstracts
say that there are Lax representations. We have read only the abstracts. The pair here, and the proof that both maps are the
two-point map, are our own. We know of no published Lax pair of the map of Kahan, Hirota and Kimura for this top; Kimura, arXiv
1611.02271, has one for their Euler top.
"""

from typing import Any

import numpy as np

from lagrange_bench.integrators.paper import interpolating_flow, lax
from lagrange_bench.integrators.paper.phase_space import E3, Numbers, sqrt
from lagrange_bench.integrators.problem.top import LagrangeTop


def deformed(top: LagrangeTop, y: Any, h: Any) -> Numbers:
    """(K₋, X), shape (..., 6), of states (..., 6) of the symmetric form."""
    y = np.asarray(y)
    J, x = y[..., :3], y[..., 3:]
    X = x * (1 + top.alpha * h * h * x[..., 2:] / 4) - np.cross(J, x) * (h / 2)
    return np.concatenate((J - np.cross(E3, x) * (top.alpha * h / 2), X), axis=-1)


def lax_matrix(top: LagrangeTop, y: Any, h: Any, u: Any) -> Numbers:
    """i σ·ℓ(u), (..., 2, 2): the paper's (2.21) of the deformed state."""
    return lax.lax_matrix(top, deformed(top, y, h), u)


def dressing(y: Any, h: Any, u: Any) -> Numbers:
    """M(u) = u + (ih/2) σ·x, (..., 2, 2), with det M = u² + h²|x|²/4."""
    return u * np.eye(2, dtype=int) + lax.pauli(np.asarray(y)[..., 3:]) * (h / 2 * 1j)


def curve_point(y: Any, h: Any) -> tuple[Any, Any]:
    """λ = i h |x|/2 and m = |x| + i h x·J/2, m² = Q_h(λ)."""
    y = np.asarray(y)
    J, x = y[..., :3], y[..., 3:]
    size = sqrt(np.sum(x * x, axis=-1))
    return size * h * 0.5j, size + np.sum(x * J, axis=-1) * h * 0.5j


def clock(top: LagrangeTop, y: Any, h: float) -> tuple[float, float]:
    """T and Θ of one step of a real state, h > 0, modulo whole nutations: see `interpolating_flow.time_and_turn`."""
    z, (lam, m) = deformed(top, y, h), curve_point(y, h)
    sheet = 1 if abs(lax.root(top, z, lam) - m) < abs(m) else -1
    T, turn = interpolating_flow.time_and_turn(top, z, complex(lam), sheet=sheet)
    return float(T), float(turn)


def of_kahan(top: LagrangeTop, y: Any, h: Any) -> tuple[Numbers, Any]:
    """The state and the step with which the map of Bobenko and Suris is Kahan's step of h at y (6,).

    ValueError if κ eps² ≥ 1.
    """
    y = np.asarray(y)
    J, x = y[:3], y[3:]
    eps = top.alpha * h * h / 4
    r0 = np.sum(x * J) / (1 - eps * x[2])
    v = J * (h / 2) + E3 * (eps * h / 2 * r0)
    kappa = (np.sum(x * x) + (h / 2 * r0) ** 2) / (1 + np.sum(v * v))
    square = 1 - kappa * eps * eps
    if not square > 0:
        raise ValueError(f"kappa eps² = {float(1 - square):.3g}: the step is too long for a real state")
    beta = square**0.5
    return np.array((J[0], J[1], beta * (J[2] + eps * r0), beta * x[0], beta * x[1], x[2] + kappa * eps)), h / beta
