"""Section 5.6: the two-point map as a step in time, and the Hamiltonian flow it interpolates.

For λ1 → λ2 the map becomes the flow of the Hamiltonian iμ2 in ε = iΔλ, (5.6.1)–(5.6.7). Exactly, one iteration is the
flow of z' = {H_int, z} over time 1, with H_int = ∫_{λ1}^{λ2} μ dλ, (5.6.11) corrected. Since dμ = −(dH + alpha λ dJ3)/λ²μ
on a leaf, that is the motion (1.1) over a time T followed by a rotation about e3 by Θ; with μ = −i√Q/λ²

    T = −i ∫_{λ2}^{λ1} du/√Q        Θ = −i alpha ∫_{λ2}^{λ1} u du/√Q        along λ2 → 0 → λ1

and for λ2 = λ̄1 = λ̄ real: T = 2 Im ∫_0^λ du/√Q. If a multiple root of Q lies on the path, or at its end, the integrals diverge,
and the step leads to a sleeping top (docs/exact-step.md, section 1). For a small λ = iη, T = 2η/√C1: the paper's −iΔλ if C1 = 1.

`sheet` is as for `two_point`, 1 forward in time; √Q is the branch of `lax.root`. `torus.clock` computes the integrals.
"""

from random import Random
from typing import Any

import numpy as np
from mpmath import mp

from lagrange_bench.integrators.paper import lax, phase_space
from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.one_point import gauge
from lagrange_bench.integrators.paper.phase_space import Numbers, function, invariants, lift, turn_rate, vector_field
from lagrange_bench.integrators.paper.two_point import Point, point, pole_free
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.torus import clock
from lagrange_bench.integrators.torus.any_parameter import check_parameter
from lagrange_bench.integrators.truth.curve import horner, series
from lagrange_bench.support.precision import workdps

# ------------------------------------------------------------------------------------------ the limit λ1 → λ2


def limit_parameters(top: LagrangeTop, y: Any, second: Point) -> tuple[Any, Any]:
    """x0 and X0 of x = x0 + O(ε), X = εX0 + O(ε²), ε = iΔλ; (5.6.1), (5.6.2). ValueError where B(λ2) = 0."""
    lam, mu = second
    A, B, _ = lax.entries(top, y, lam)
    phase_space.refuse(B, "B(λ2) = 0: the chart (x, X) of the two-point map is singular")
    return (A - mu) / B, 1j * B / (2 * mu)


def limit_matrix(top: LagrangeTop, y: Any, u: Any, second: Point) -> Numbers:
    """M1 of M(u) = (u − λ2)(1 + εM1 + O(ε²)), (..., 2, 2): (i/2μ2)(L(λ2) + μ2)/(u − λ2); (5.6.3)."""
    lam, mu = second
    mu = np.asarray(mu)[..., None, None]
    return (lax.lax_matrix(top, y, lam) + mu * np.eye(2, dtype=int)) * (0.5j / mu) / (u - lam)


def limit_lax_rate(top: LagrangeTop, y: Any, u: Any, second: Point) -> Numbers:
    """dL(u)/dε = (i/2μ2)[L(λ2)/(u − λ2), L(u)], (..., 2, 2); (5.6.4), (5.6.5) with the label 160."""
    return lax.commutator(limit_matrix(top, y, u, second), lax.lax_matrix(top, y, u))


def limit_rate(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1) -> Numbers:
    """The same flow on states, i{μ2, z} = −(z' + alpha λ2 e3 × z)/√Q(λ2), (..., 6); (5.6.7).

    At λ2 = 0 it is the physical flow in another unit of time, −z'/√C1: ε runs backwards, ε = −2 Im λ (5.6.8).
    """
    turn = turn_rate(y)
    field = vector_field(top, y) + turn * lift(lam, turn.ravel()[0]) * top.alpha
    return -lax.check_sheet(sheet) * field / np.asarray(lax.root(top, y, lam))[..., None]


def mu_near_zero(top: LagrangeTop, y: Any, eta: Any) -> Any:
    """μ2 at λ2 = iη on sheet 1 up to O(η), (5.6.9) for general C1 = r²: i r/η² − ℓ/rη + i(ℓ²/r² − 2H)/2r."""
    H, _, c1, c2 = invariants(top, y)
    r = lax.root(top, y, 0)
    return 1j * r / (eta * eta) - c2 / (r * eta) + 1j * (c2 * c2 / c1 - 2 * H) / (2 * r)


# ------------------------------------------------------------------------------------------ the exact statement


def moments(top: LagrangeTop, y: Any, lam: Any) -> tuple[Any, Any]:
    """∫_0^λ du/√Q and ∫_0^λ u du/√Q along the segment, mpmath numbers.

    ValueError if a root of Q lies on the segment, or so close to it that 16 panels do not reach the precision.
    """
    return clock.moments(lax.spectral_polynomial(top, phase_space.numbers(y)), lam)


def time_and_turn(top: LagrangeTop, y: Any, lam1: Any, lam2: Any = None, sheet: int = 1) -> tuple[Any, Any]:
    """T and Θ of one step with λ1, λ2 (default: λ̄1, then both are real for a real state); see the module."""
    F1, G1 = moments(top, y, lam1)
    if lam2 is None:
        check_parameter(lam1)
        T, turn = 2 * F1.imag, 2 * G1.imag
    else:
        F2, G2 = moments(top, y, lam2)
        T, turn = -1j * (F1 - F2), -1j * (G1 - G2)
    return lax.check_sheet(sheet) * T, sheet * top.alpha * turn


def hamiltonian(top: LagrangeTop, y: Any, lam1: Any, lam2: Any, sheet: int = 1) -> Any:
    """H_int = ∫_{λ1}^{λ2} μ dλ, (5.6.11) corrected, up to a function of C1 and C2 (the residue of μ at 0)."""
    if lam1 == 0 or lam2 == 0:
        raise ValueError("λ = 0 is the pole of μ")
    q = lax.spectral_polynomial(top, phase_space.numbers(y))
    r = mp.sqrt(q[0])
    b = q[1] / (2 * r)  # √Q = r + b u + …

    def integrand(u: Any, m: Any) -> Any:
        return (q[2] - b * b + u * (q[3] + u * q[4])) / (m + r + b * u)

    up, down = (clock.integral(q, lam, integrand) - r / lam + b * mp.log(lam) for lam in (lam2, lam1))
    return -1j * lax.check_sheet(sheet) * (up - down)


def interpolated(top: LagrangeTop, y: Any, T: Any, turn: Any) -> Numbers:
    """One state after the motion (1.1) over a time T, then a rotation about e3 by `turn`; both complex if need be.

    Taylor series in the precision of y, for moderate T. With `time_and_turn` it is the two-point map.
    """
    state, a = np.asarray(y), top.alpha
    size = float(max(abs(v) for v in state)) + float(abs(a)) ** 0.5
    steps = int(np.ceil(8 * size * float(abs(T)))) or 1
    terms = (mp.dps + 10 if state.dtype == object else 26) + 1
    J1, J2, J3, x1, x2, x3 = range(6)
    fall = ((-a, x2),), ((a, x1),), ()
    rates = (*fall, ((1, J2, x3), (-1, J3, x2)), ((1, J3, x1), (-1, J1, x3)), ((1, J1, x2), (-1, J2, x1)))
    for _ in range(steps):
        state = np.array([horner(coefficients, T / steps) for coefficients in series(rates, list(state), 1, terms)])
    return gauge(state, function("exp", -1j * turn))


# ------------------------------------------------------------------------------------------------ misprints


def _real_step(rng: Random) -> tuple[LagrangeTop, Numbers, complex]:
    """A random top, a real state with C1 = 1, and λ well inside the nearest root of Q."""
    top, y = draw(rng)
    state = y.real
    state[3:] /= np.linalg.norm(state[3:])
    rate, size, _ = top.scales(state)
    angle = np.pi * (0.3 + 0.3 * rng.random())
    return top, state, 0.3 * size / rate * complex(np.cos(angle), np.sin(angle))


def _interpolation(rng: Random, printed: bool) -> float:
    """The flow of i ∫ μ dλ, corrected ∫ μ dλ, over time 1 against the map."""
    top, y, lam = _real_step(rng)
    T, turn = ((1j if printed else 1.0) * complex(v) for v in time_and_turn(top, y, lam))
    return float(np.max(np.abs(interpolated(top, y + 0j, T, turn) - pole_free(top, y, lam, lam.conjugate()))))


def _time_step(rng: Random, printed: bool) -> float:
    """The motion over the time 2 Im λ = |iΔλ|, or over T and turned by Θ, against the map."""
    top, y, lam = _real_step(rng)
    T, turn = (2 * lam.imag, 0.0) if printed else map(float, time_and_turn(top, y, lam))
    return float(np.max(np.abs(interpolated(top, y, T, turn) - pole_free(top, y, lam, lam.conjugate()))))


def _physical_limit(rng: Random, printed: bool) -> float:
    """(5.6.5) at λ2 = iη, η = 1e-25, with the μ2 of (5.6.9), against (i/2u)[σ·x, L(u)], corrected minus that; C1 = 1."""
    top, y, _ = _real_step(rng)
    with workdps(90):
        state = phase_space.numbers(y)
        state[3:] /= mp.sqrt(sum(v * v for v in state[3:]))
        eta, u = mp.mpf(10) ** -25, mp.mpf(0.5 + rng.random())
        lam, mu = point(top, state, 1j * eta)
        assert abs(mu - mu_near_zero(top, state, eta)) < 1e-20
        rest = limit_lax_rate(top, state, u, (lam, mu)) - lax.lax_rate(top, state, u) * (1 if printed else -1)
        return float(max(abs(v) for v in rest.ravel()))


ERRATA = [
    Erratum(
        "(5.6.1), text", "5.6", "the physical time step is iΔλ, |iΔλ| = 2 Im λ",
        "T = 2 Im ∫_0^λ du/√Q, and a turn about e3 by Θ = 2 alpha Im ∫_0^λ u du/√Q", _time_step, prose=True,
    ),
    Erratum("(5.6.6)", "5.6", "… + 2 J3/λ2 + alpha²", "… + 2 alpha J3/λ2 + alpha²", lax.curve_residual),
    Erratum(
        "(5.6.9), (5.6.10)", "5.6", "with μ2 = i/η² − … (5.6.5) turns into L' = (i/2u)[σ·x, L]",
        "it turns into −(i/2u)[σ·x, L], which is {H, L}; with μ2 = −i/η² + … into (i/2u)[σ·x, L] = {L, H}",
        _physical_limit,
    ),
    Erratum(
        "(5.6.11)", "5.6", "H(λ1, λ2) = i ∫_{λ1}^{λ2} μ dλ", "∫_{λ1}^{λ2} μ dλ, with z' = {H, z}", _interpolation,
    ),
]  # fmt: skip
