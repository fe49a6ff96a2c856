"""Section 5.5: the two-point Bäcklund transformation B_(P1,Q2) of the top; for λ2 = λ̄1 a real map.

    M(u) L(u) = L̃(u) M(u)     M(u) = ((u − λ1 + xX, X), (−x²X + Δλ x, u − λ2 − xX))          (5.5.2), (5.5.3)
    det M = (u − λ1)(u − λ2)     Δλ = λ1 − λ2     λ0 = (λ1 + λ2)/2                            (5.5.4), (5.5.8)

B_(P1,Q2) is the one-point map of P1 = (λ1, μ1), followed by the inverse of the one-point map of (λ2, μ2). Its own inverse
exchanges the two points, or changes the sign of both μ. Like the paper, the formulas of 5.5 take points: pairs (λ, μ) from
`point`. The tilde here is the paper's double tilde. C1 is general, C1 ≠ 0; alpha = 0 is no exception.

All these formulas divide by B(λ), which vanishes on some states: the chart is singular there, not the map. With
M(u) = u − λ0 + i w·σ, a_k = x + λ_k J + λ_k² alpha e3 and m_k = iλ_k² μ_k = √Q(λ_k) the same map is

    w = (Δλ/2i) (m2 a1 + m1 a2 − i a1×a2)/(m1 m2 + a1·a2)      w·w = −Δλ²/4
    J̃ = J + 2 alpha e3×w      x̃ = x + λ0 (J̃ − J) + (J + J̃)×w

(a result of this project). For real states and λ2 = λ̄1, m2 = m̄1, it is the real map of `lagrange_bench.two_point`, and the
denominator is |m|² + |Re a|² + |Im a|². `sheet` is the sheet of m, 1 forward in time: sheet −1 of `lax.eigenvalue`.

μ and m are functions of the state. With their values on the curve at every state the map is Poisson; with fixed values it is not.
`interpolating_flow` shows what the map is in time, section 5.6.
"""

from collections.abc import Callable
from functools import partial
from random import Random
from typing import Any

import numpy as np

from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.one_point import one_point
from lagrange_bench.integrators.paper.phase_space import E3, Numbers, cartesian, components, ladder, lift, refuse
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.torus.any_parameter import check_parameter

Point = tuple[Any, Any]  # (λ, μ)


def point(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1) -> Point:
    """(λ, μ) on the curve through y, μ = −i sheet √Q(λ)/λ²; (5.5.7). ValueError at λ = 0, the pole of μ."""
    mu = lax.eigenvalue(top, y, lam, -lax.check_sheet(sheet))
    return lift(lam, np.ravel(mu)[0]), mu


def parameters(top: LagrangeTop, y: Any, first: Point, second: Point) -> tuple[Any, Any]:
    """x and X from the old variables, by the first expressions of (5.5.5), (5.5.6).

    ValueError where they are singular charts: B(λ1) = 0, or (λ1, μ1) = (λ2, −μ2) and the like.
    """
    (lam1, mu1), (lam2, mu2) = first, second
    A1, B1, _ = lax.entries(top, y, lam1)
    A2, B2, _ = lax.entries(top, y, lam2)
    refuse(B1, "B(λ1) = 0: the chart (x, X) of the two-point map is singular; `pole_free` has no such poles")
    x, below = (A1 - mu1) / B1, B1 * (A2 + mu2) - B2 * (A1 - mu1)
    refuse(below, "X = ∞: the points (λ1, μ1) and (λ2, −μ2) have one eigenvector, the map is singular")
    return x, (lam2 - lam1) * B1 * B2 / below


def expressions_x(top: LagrangeTop, y: Any, image: Any, first: Point, second: Point) -> list[Any]:
    """The five expressions of (5.5.5) for x, four at alpha = 0."""
    (lam1, mu1), (lam2, mu2) = first, second
    A, B, C = lax.entries(top, y, lam1)
    A_new, B_new, C_new = lax.entries(top, image, lam2)
    x = [(A - mu1) / B, -C / (A + mu1), (A_new - mu2) / B_new, -C_new / (A_new + mu2)]
    if top.alpha == 0:
        return x
    Jp_between = ladder(one_point(top, y, lam1, mu=mu1))[2]  # the single tilde: after B_P1
    return [*x, Jp_between / (2 * top.alpha)]


def expressions_X(top: LagrangeTop, y: Any, image: Any, first: Point, second: Point) -> list[Any]:
    """The five expressions of (5.5.6) for X, four at alpha = 0."""
    (lam1, mu1), (lam2, mu2) = first, second
    (A1, B1, C1), (A2, B2, C2) = (lax.entries(top, y, lam) for lam in (lam1, lam2))
    (a1, b1, c1), (a2, b2, c2) = (lax.entries(top, image, lam) for lam in (lam1, lam2))
    gap = lam1 - lam2
    X = [
        -gap * B1 * B2 / (B1 * (A2 + mu2) - B2 * (A1 - mu1)),
        gap * (A1 + mu1) * (A2 - mu2) / ((A1 + mu1) * C2 - (A2 - mu2) * C1),
        -gap * b1 * b2 / (b2 * (a1 + mu1) - b1 * (a2 - mu2)),
        gap * (a1 - mu1) * (a2 + mu2) / ((a2 + mu2) * c1 - (a1 - mu1) * c2),
    ]
    return X if top.alpha == 0 else [*X, (ladder(y)[1] - ladder(image)[1]) / (2 * top.alpha)]


def dressing_matrix(x: Any, X: Any, lam1: Any, lam2: Any, u: Any) -> Numbers:
    """M(u; λ1, λ2), shape (..., 2, 2), with det M = (u − λ1)(u − λ2); (5.5.3), (5.5.4)."""
    return lax.square(u - lam1 + x * X, X, x * (lam1 - lam2 - x * X), u - lam2 - x * X)


def explicit(top: LagrangeTop, y: Any, first: Point, second: Point, printed: bool = False) -> Numbers:
    """The map by components, (5.5.9), corrected or as the paper prints it."""
    (J3, Jm, Jp, x3, xm, xp), (x, X) = ladder(y), parameters(top, y, first, second)
    gap, mean, product = first[0] - second[0], (first[0] + second[0]) / 2, x * X
    rest, twist, lever, a = x * (gap - product), 2 * product - gap, x * (gap - product), top.alpha
    if printed:
        twist, lever, a = 2 * product + gap, top.alpha * (gap - product), 1.0
    return cartesian(
        J3 + 0 * x,
        Jm - 2 * a * X,
        Jp + 2 * a * rest,
        x3 - lever * Jm + X * Jp + 2 * a * X * rest,
        xm + twist * Jm - 2 * X * J3 - 2 * a * X * (product + mean - gap / 2),
        xp - twist * Jp + 2 * rest * J3 - 2 * a * rest * (product - mean - gap / 2),
    )


def real_generators(top: LagrangeTop, y: Any, first: Point, second: Point, printed: bool = False) -> Numbers:
    """The map in J1, J2, J3, x1, x2, x3, (5.5.10) with the label 145–150.

    Corrected, or as the paper prints it: without alpha, and with the braces exchanged.
    """
    (J1, J2, J3, x1, x2, x3), (x, X) = components(y), parameters(top, y, first, second)
    gap, mean, a = first[0] - second[0], (first[0] + second[0]) / 2, top.alpha
    even, odd = x * gap - X * (1 + x * x), x * gap + X * (1 - x * x)
    low, high, twist = mean - gap / 2, mean + 3 * gap / 2, 2 * x * X - gap
    brace1 = x * X**2 * (1 - x * x) + X * (low + x * x * high) - x * gap * (mean + gap / 2)
    brace2 = x * X**2 * (1 + x * x) + X * (low - x * x * high) + x * gap * (mean + gap / 2)
    if printed:
        a, brace1, brace2 = 1.0, brace2, brace1
    image = (
        J1 + a * even,
        J2 - 1j * a * odd,
        J3 + 0 * x,
        x1 - 1j * J2 * twist + J3 * even - a * brace1,
        x2 + 1j * J1 * twist - 1j * J3 * odd - 1j * a * brace2,
        x3 - J1 * even + 1j * J2 * odd - 2 * a * x * X * (x * X - gap),
    )
    return np.stack(image, axis=-1)


def matrix_form(top: LagrangeTop, y: Any, first: Point, second: Point) -> Numbers:
    """The map in one line, with M(u) = u + M0: J̃ = J + alpha [M0, σ3], x̃ = x + M0 J − J̃ M0; the program of 5.7."""
    M0 = dressing_matrix(*parameters(top, y, first, second), first[0], second[0], 0)
    J, x = lax.pauli(np.asarray(y)[..., :3]), lax.pauli(np.asarray(y)[..., 3:])
    J_new = J + top.alpha * lax.commutator(M0, lax.PAULI[2])
    return lax.from_pauli(J_new, x + M0 @ J - J_new @ M0)


def inverse(top: LagrangeTop, y: Any, first: Point, second: Point) -> Numbers:
    """The state that `explicit` sends to y: B_(P2,Q1), the two points exchanged."""
    return explicit(top, y, second, first)


def axis(top: LagrangeTop, y: Any, lam1: Any, lam2: Any, sheet: int = 1, m: Any = None) -> Numbers:
    """w of M(u) = u − λ0 + i w·σ, shape (..., 3). m : (m1, m2), in place of their values on the curve.

    ValueError at a pole. For a real state and λ2 = λ̄1 this is only a(λ) = 0: a vertical top, and λ the double root of Q.
    """
    sheet, y = lax.check_sheet(sheet), np.asarray(y)
    roots = (sheet * lax.root(top, y, lam1), sheet * lax.root(top, y, lam2)) if m is None else m
    m1, m2 = (np.asarray(r)[..., None] for r in roots)
    lam1, lam2 = (lift(lam, m1.ravel()[0]) for lam in (lam1, lam2))
    a1, a2 = (y[..., 3:] + y[..., :3] * lam + E3 * (lam * lam * top.alpha) for lam in (lam1, lam2))
    below = m1 * m2 + np.sum(a1 * a2, axis=-1, keepdims=True)
    refuse(below, "λ: the denominator m1 m2 + a1·a2 of the two-point map vanishes at this state")
    return (m2 * a1 + m1 * a2 - 1j * np.cross(a1, a2)) * ((lam1 - lam2) / 2j) / below


def pole_free(top: LagrangeTop, y: Any, lam1: Any, lam2: Any, sheet: int = 1, m: Any = None) -> Numbers:
    """The map by its vector w, complex, for any λ1 and λ2, also 0. Arguments as for `axis`."""
    J, x = np.asarray(y)[..., :3], np.asarray(y)[..., 3:]
    w = axis(top, y, lam1, lam2, sheet, m)
    J_new = J + np.cross(E3, w) * (2 * top.alpha)
    mean = (lift(lam1, w.ravel()[0]) + lam2) / 2
    x_new = x + (J_new - J) * mean + np.cross(J + J_new, w)
    return np.concatenate((J_new, x_new), axis=-1)


def real_form(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1) -> Numbers:
    """The real map, λ1 = λ and λ2 = λ̄ (5.5.11) with μ2 = −μ̄1, Im λ > 0: `pole_free`, real for a real state."""
    check_parameter(lam)
    image = pole_free(top, y, lam, lam.conjugate(), sheet)
    if not all(getattr(v, "imag", None) == 0 and not isinstance(v, complex) for v in np.ravel(y)):
        return image
    return image.real if image.dtype != object else np.reshape([v.real for v in image.ravel()], image.shape)


# ------------------------------------------------------------------------------------------------ misprints


def _points(rng: Random, top: LagrangeTop, y: Any) -> tuple[Point, Point]:
    """Two points of the curve, λ1 above and λ2 below the real axis, not conjugate, on one random sheet each."""
    lams = [complex(0.5 + rng.random(), sign * (0.5 + rng.random())) for sign in (1, -1)]
    return point(top, y, lams[0], rng.choice((1, -1))), point(top, y, lams[1], rng.choice((1, -1)))


def _component(rng: Random, printed: bool, name: str, form: Callable[..., Numbers]) -> float:
    """One component, as printed or as corrected, against the pole-free map, over the size of the terms."""
    top, y = draw(rng)
    first, second = _points(rng, top, y)
    m = tuple(1j * lam * lam * mu for lam, mu in (first, second))
    truth = pole_free(top, y, first[0], second[0], m=m)
    names, parts = (REAL, components) if form is real_generators else (LADDER, ladder)
    claimed, right = (parts(image)[names.index(name)] for image in (form(top, y, first, second, printed), truth))
    x, _ = parameters(top, y, first, second)
    error = abs(claimed - right)
    return float(error / ((1 + abs(x)) * (1 + np.max(np.abs(truth)))))


def _reality(rng: Random, printed: bool) -> float:
    """Largest imaginary part of the image of a real state, λ2 = λ̄1, μ2 = μ̄1, corrected −μ̄1."""
    top, y = draw(rng)
    lam, mu = point(top, y.real, complex(0.5 + rng.random(), 0.5 + rng.random()))
    image = explicit(top, y.real, (lam, mu), (lam.conjugate(), mu.conjugate() * (1 if printed else -1)))
    return float(np.max(np.abs(image.imag)) / (1 + np.max(np.abs(image))))


LADDER = ("J̃3", "J̃-", "J̃+", "x̃3", "x̃-", "x̃+")
REAL = ("J̃1", "J̃2", "J̃3", "x̃1", "x̃2", "x̃3")
MISPRINTS = (
    ("J̃-", "J- − 2X", "J- − 2 alpha X"),
    ("J̃+", "J+ + 2x(Δλ − xX)", "J+ + 2 alpha x(Δλ − xX)"),
    ("x̃3", "x3 − alpha (Δλ − xX)J- + X J+ + 2xX(Δλ − xX)", "x3 − x(Δλ − xX)J- + X J+ + 2 alpha xX(Δλ − xX)"),
    ("x̃-", "x- + (2xX + Δλ)J- − 2X J3 − 2X(xX + λ0 − Δλ/2)", "x- + (2xX − Δλ)J- − 2X J3 − 2 alpha X(xX + λ0 − Δλ/2)"),
    (
        "x̃+",
        "x+ − (2xX + Δλ)J+ + 2x(Δλ − xX)J3 − 2x(Δλ − xX)(xX − λ0 − Δλ/2)",
        "x+ − (2xX − Δλ)J+ + 2x(Δλ − xX)J3 − 2 alpha x(Δλ − xX)(xX − λ0 − Δλ/2)",
    ),
)
REAL_MISPRINTS = (
    ("J̃1", "J1 + xΔλ − X(1 + x²)", "J1 + alpha [xΔλ − X(1 + x²)]"),
    ("J̃2", "J2 − i[xΔλ + X(1 − x²)]", "J2 − i alpha [xΔλ + X(1 − x²)]"),
    (
        "x̃1",
        "… − {xX²(1 + x²) + X[λ0 − Δλ/2 − x²(λ0 + 3Δλ/2)] + xΔλ(λ0 + Δλ/2)}",
        "… − alpha {xX²(1 − x²) + X[λ0 − Δλ/2 + x²(λ0 + 3Δλ/2)] − xΔλ(λ0 + Δλ/2)}",
    ),
    (
        "x̃2",
        "… − i{xX²(1 − x²) + X[λ0 − Δλ/2 + x²(λ0 + 3Δλ/2)] − xΔλ(λ0 + Δλ/2)}",
        "… − i alpha {xX²(1 + x²) + X[λ0 − Δλ/2 − x²(λ0 + 3Δλ/2)] + xΔλ(λ0 + Δλ/2)}",
    ),
    ("x̃3", "… − 2xX(xX − Δλ)", "… − 2 alpha xX(xX − Δλ)"),
)


ERRATA = [
    *(
        Erratum(f"({number}) {name}", "5.5", printed, corrected, partial(_component, name=name, form=form))
        for number, form, misprints in (("5.5.9", explicit, MISPRINTS), ("5.5.10", real_generators, REAL_MISPRINTS))
        for name, printed, corrected in misprints
    ),
    Erratum(
        "(5.5.11)", "5.5", "real for λ1 = λ̄2, whatever the μ: also μ2 = μ̄1", "real for λ1 = λ̄2 and μ2 = −μ̄1",
        _reality, prose=True,
    ),
]  # fmt: skip
