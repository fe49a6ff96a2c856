"""Section 5.1: the one-point Bäcklund transformation B_(λ,μ) of the top, a complex Poisson map.

    M(u) L(u) = L̃(u) M(u)     M(u) = ((u − λ + pq, p), (q, 1))     p = J-/(2 alpha)     q = J̃+/(2 alpha)

The point (λ, μ) of the spectral curve is given by λ and a sheet, μ = sheet · i m/λ² (`lax.eigenvalue`). μ is a function of the
state: with a fixed μ the map is not Poisson. C1 is general, C1 ≠ 0. At alpha = 0 there is no one-point map. With
k = x3 − q x- = x̃3 − p x̃+,  k² = C1 + λ x- x̃+ of (5.2.6), the sheet is the sign of k: k → sheet · √C1 as λ → 0, where the map
stays regular (only μ has a pole).

The map commutes with rotations about e3, also complex ones (the *gauge* J-, x- → d J-, d x-; J+, x+ → J+/d, x+/d).
Iterated, |J-|, |x-| grow and |J+|, |x+| shrink geometrically, so `orbit` keeps states balanced by such a gauge.

Its inverse is its mirror image: transposing L exchanges J- with J+ and p with q. So B⁻¹ = τ B τ at the same (λ, μ), with
τ: J2, x2 → −J2, −x2. B_(λ̄,ν)⁻¹ ∘ B_(λ,μ) on one sheet is the real two-point map of section 5.5,
`lagrange_bench.two_point(top, y, λ, sheet=s)` for the one-point maps of sheet −s.
"""

from functools import partial
from random import Random
from typing import Any

import numpy as np

from lagrange_bench.integrators.paper import phase_space
from lagrange_bench.integrators.paper.errata import Erratum, draw
from lagrange_bench.integrators.paper.lax import check_sheet, eigenvalue, root, square
from lagrange_bench.integrators.paper.phase_space import Numbers, cartesian, components, invariants, ladder, lift
from lagrange_bench.integrators.problem.top import LagrangeTop


def _m(top: LagrangeTop, y: Any, lam: Any, sheet: int, mu: Any) -> Any:
    """sheet · √Q(λ), or −iλ²μ for a given μ: the coordinate of the curve without a pole at λ = 0."""
    phase_space.refuse(
        top.alpha, "alpha = 0: the one-point map does not exist (p and q ~ 1/alpha); the two-point map does"
    )
    return check_sheet(sheet) * root(top, y, lam) if mu is None else -1j * lift(lam, mu) * lam * mu


def parameters(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1, mu: Any = None) -> tuple[Any, Any]:
    """p and q of the dressing matrix from the old variables, (5.1.6), (5.1.8).

    q = (A − μ)/B = −C/(A + μ), both times −iλ²: (a3 − m)/a- = −a+/(a3 + m) with a = x + λJ + λ² alpha e3. The form with the
    larger of a3 ± m has no cancellation. ValueError if its denominator vanishes (B = 0 on this sheet): the map sends the state
    to infinity.
    """
    m = _m(top, y, lam, sheet, mu)
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    lam = lift(lam, J3)
    a3, am, ap = x3 + lam * J3 + lam * lam * top.alpha, xm + lam * Jm, xp + lam * Jp
    plus = abs(a3 + m) >= abs(a3 - m)
    denominator = np.where(plus, a3 + m, am)
    phase_space.refuse(denominator, "B(λ) = 0 on this sheet: the one-point map sends the state to infinity")
    return Jm / (2 * top.alpha), np.asarray(np.where(plus, -ap, a3 - m) / denominator)[()]


def one_point(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1, mu: Any = None) -> Numbers:
    """The map, (5.1.10) with the label 79–84, of complex states (..., 6).

    Parameters
    ----------
    lam : Bäcklund parameter λ, complex. Also 0, unless `mu` is given.
    sheet : 1 or −1, the point over λ; see `lax.eigenvalue`.
    mu : μ itself, in place of μ on the curve through y. A fixed μ does an iteration no harm. But the map with constant μ is not
        Poisson, and changes C1 and C2 off its torus.
    """
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    p, q = parameters(top, y, lam, sheet, mu)
    w = p * q - lam
    return cartesian(
        J3,
        xm + Jm * w - 2 * p * J3,
        2 * q * top.alpha,
        x3 + p * Jp - q * xm - q * Jm * w + 2 * p * q * J3,
        xm * (p * q + w) - 2 * p * x3 - p * p * Jp + Jm * p * q * w - 2 * p * p * q * J3,
        Jp - 2 * top.alpha * q * w + 2 * q * J3,  # J- q/p = 2 alpha q, also at p = 0
    )


def real_form(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1, mu: Any = None) -> Numbers:
    """The same map by its formulas in J1, J2, J3, x1, x2, x3, (5.1.11) with the label 85–90, corrected."""
    (J1, J2, J3, _, _, x3), (_, Jm, Jp, _, xm, _) = components(y), ladder(y)
    _, q = parameters(top, y, lam, sheet, mu)
    a = lift(top.alpha, q)
    tail = J2 * J3 - q * J1 * J2 + 1j * J1 * J3
    square = q / (4 * a) * (J1**2 - J2**2)
    J1_new = a * q + xm / 2 - lam / 2 * Jm + square + 1j / (2 * a) * tail
    J2_new = -1j * a * q + 1j / 2 * xm - 1j * lam / 2 * Jm + 1j * square - tail / (2 * a)
    # the paper's brackets times q, so that 1/q disappears
    b2 = q * (lam / 2 * (J2**2 - J1**2) + Jm * xm + 1j * lam * J1 * J2) - Jm * x3
    b3 = q * (q * J1**2 * (J1 - 3j * J2) + 1j * q * J2**2 * (J2 + 3j * J1) - 2 * J3 * Jm**2) - Jm**2 * Jp
    even = b2 / (2 * a) + b3 / (8 * a * a) - lam / 2 * xm
    odd = a * q * lam + Jp / 2 - q * q / 2 * Jm + q * J3
    x3_new = x3 - q * xm + q * lam * Jm + ((J1**2 + J2**2) / 2 - q * q / 2 * (J1**2 - J2**2) - 1j * q * tail) / a
    return np.stack((J1_new, J2_new, J3 + 0 * q, odd + even, 1j * (even - odd), x3_new), axis=-1)


def inverse(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1, mu: Any = None) -> Numbers:
    """The state that `one_point` sends to y: the map of the adjugate N(u) = ((1, −p), (−q, u − λ + pq)), by τ B τ."""
    mirror = np.array((1, -1, 1, 1, -1, 1))  # τ, an anti-Poisson reflection
    return one_point(top, np.asarray(y) * mirror, lam, sheet, mu) * mirror


def dressing_matrix(p: Any, q: Any, lam: Any, u: Any) -> Numbers:
    """M(u; λ) = ((u − λ + pq, p), (q, 1)), shape (..., 2, 2), det M = u − λ; (5.1.4)."""
    return square(u - lam + p * q, p, q, 1 + 0 * q)


def k_value(top: LagrangeTop, y: Any, lam: Any, sheet: int = 1, mu: Any = None) -> Any:
    """k = x3 − q x- with its sign: k = m − λ J3 − λ² alpha + λ q J-, which is sheet · √C1 at λ = 0; (5.2.6)."""
    J3, Jm, *_ = ladder(y)
    _, q = parameters(top, y, lam, sheet, mu)
    return _m(top, y, lam, sheet, mu) - lam * (J3 + lift(lam, q) * top.alpha - q * Jm)


def gauge(y: Any, d: Any) -> Numbers:
    """The complex rotation about e3 with J-, x- → d J-, d x- and J+, x+ → J+/d, x+/d; a Poisson map."""
    J3, Jm, Jp, x3, xm, xp = ladder(y)
    return cartesian(J3 + 0 * d, Jm * d, Jp / d, x3 + 0 * d, xm * d, xp / d)


def balance(top: LagrangeTop, y: Any) -> tuple[Numbers, int]:
    """One state in the gauge d = 2^n that makes |J-|, |x-| as large as |J+|, |x+|, and n; d is exact."""
    _, _, c1, _ = invariants(top, y)
    _, Jm, Jp, _, xm, xp = ladder(y)
    scale = float(abs(top.alpha)) ** 0.5 / float(abs(c1)) ** 0.25  # brings x to the units of J
    minus, plus = float(abs(Jm)) + scale * float(abs(xm)), float(abs(Jp)) + scale * float(abs(xp))
    if minus == 0 or plus == 0:
        return np.asarray(y), 0
    n = round(0.5 * float(np.log2(plus) - np.log2(minus)))
    return gauge(y, 2.0**n), n


def orbit(top: LagrangeTop, y: Any, lam: Any, steps: int, sheet: int = 1) -> tuple[Numbers, list[int]]:
    """The map iterated from one state: states (steps + 1, 6), balanced, and the exponents of their gauges.

    The state of the plain iteration is gauge(states[n], 2**−exponents[n]).
    """
    state, total = np.asarray(y), 0
    states, exponents = [state], [0]
    for _ in range(steps):
        state, n = balance(top, one_point(top, state, lam, sheet))
        total += n
        states.append(state)
        exponents.append(total)
    return np.stack(states), exponents


# ------------------------------------------------------------------------------------------------ misprints


def _as_printed(top: LagrangeTop, y: Any, lam: Any) -> dict[int, Any]:
    """J̃2, x̃1, x̃2 of (5.1.11) as the paper prints them, under their place in the state."""
    (J1, J2, J3, x1, x2, x3), (_, Jm, Jp, _, xm, xp) = components(y), ladder(y)
    a, (_, q) = top.alpha, parameters(top, y, lam)
    b2 = lam / 2 * (J2**2 - J1**2) + Jm * (x1 - x3 / q) - 1j * x2 * Jp + 1j * lam * J1 * J2
    b3 = q * J1**2 * (J1 - 3j * J2) + q * J2**2 * (J2 - 3j * J1)
    b3 = b3 - 1j / q * (J1 - J2) ** 2 * (J1 + J2) - 2 * J3 * Jm**2
    brackets = q / (2 * a) * b2 + q / (8 * a * a) * b3
    J2_new = -1j * a * q + 1j / 2 * xp - 1j * lam / 2 * Jp + 1j * q / (4 * a) * (J1**2 - J2**2)
    J2_new = J2_new + (J2 * J3 - q * J1 * J2 - 1j * J1 * J3) / (2 * a)
    x1_new = a * q * lam + Jp / 2 - q * q / 2 * Jm - lam / 2 * xm + q * J3 + brackets
    x2_new = -1j * a * q * lam + 1j / 2 * Jm - 1j * q * q / 2 * Jp - 1j * lam / 2 * xm - 1j * q * J3 + 1j * brackets
    return {1: J2_new, 3: x1_new, 4: x2_new}


def _component(rng: Random, printed: bool, place: int) -> float:
    """One component of the real form against (5.1.10), over the size of the terms."""
    top, y = draw(rng)
    lam = complex(0.5 + rng.random(), 0.5 + rng.random())
    value = (_as_printed if printed else real_form)(top, y, lam)[place]
    _, q = parameters(top, y, lam)
    return float(abs(value - one_point(top, y, lam)[place]) / (10 * (1 + abs(q)) ** 2))


def _composition(rng: Random, printed: bool) -> float:
    """B_Q ∘ B_P − 1, B_Q = B_(λ,−μ) or the inverse, at a point not sent too far."""
    lam = complex(0.5 + rng.random(), 0.5 + rng.random())
    while True:
        top, y = draw(rng)
        image, mu = one_point(top, y, lam), eigenvalue(top, y, lam)
        if np.max(np.abs(image)) < 10:
            break
    back = one_point(top, image, lam, mu=-mu) if printed else inverse(top, image, lam, mu=mu)
    return float(np.max(np.abs(back - y)) / 100)


ERRATA = [
    Erratum(
        "(5.1.11) J̃2", "5.1", "i/2 (x1 + i x2) − iλ/2 (J1 + i J2) … + 1/(2 alpha) (J2 J3 − q J1 J2 − i J1 J3)",
        "i/2 (x1 − i x2) − iλ/2 (J1 − i J2) … − 1/(2 alpha) (J2 J3 − q J1 J2 + i J1 J3)",
        partial(_component, place=1),
    ),
    Erratum(
        "(5.1.11) x̃1", "5.1",
        "… − i x2 (J1 + i J2) … + q J2² (J2 − 3i J1) − (i/q)(J1 − J2)²(J1 + J2) …",
        "… − i x2 (J1 − i J2) … + i q J2² (J2 + 3i J1) − (1/q)(J1 − i J2)²(J1 + i J2) …",
        partial(_component, place=3),
    ),
    Erratum(
        "(5.1.11) x̃2", "5.1", "i/2 (J1 − i J2) − i q²/2 (J1 + i J2) … and the brackets of x̃1 as printed",
        "−i/2 (J1 + i J2) + i q²/2 (J1 − i J2) … and the brackets of x̃1 as corrected",
        partial(_component, place=4),
    ),
    Erratum(
        "before (5.5.2)", "5.5", "B_(λ,−μ) and B_(λ,μ), both of (5.1.4), are inverse to each other",
        "B_(λ,μ)⁻¹ is the map of the adjugate ((1, −p), (−q, u − λ + pq)) at (λ, μ)", _composition, prose=True,
    ),
]  # fmt: skip
