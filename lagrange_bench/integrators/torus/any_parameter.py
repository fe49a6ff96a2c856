"""The two-point map with any λ, such as the paper's: its constants, and one single step."""

import math

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import check_state
from lagrange_bench.integrators.compiling.loops import SIZE
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import time_step as ts
from lagrange_bench.integrators.torus.real_map import KERNELS, check_constants, constants, form


def papers_parameter(name: str, y0: Array, h: float) -> complex:
    """λ = i |h| √C1/2. For h < 0 the inverse map is used."""
    eta = abs(h) / 2 * math.hypot(*y0[3:])
    if not 0.0 < eta < math.inf:
        raise StepError(name, f"λ = i h √C1/2 is {eta} i: beyond the range of doubles", h=h)
    return complex(0.0, eta)


def check_parameter(lam: complex) -> complex:
    """λ as a finite complex number in the upper half-plane; else ValueError."""
    try:
        lam = complex(lam)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"lam must be a complex number; got {lam!r}") from None
    if not (math.isfinite(lam.real) and math.isfinite(lam.imag)) or lam.imag <= 0:
        raise ValueError(f"lam must be finite with a positive imaginary part; got {lam}")
    return lam


def plain_constants(alpha: float, state: Array, lam: complex, sheet: int) -> Array:
    """The constants for any λ. On sheet 1, m = √Q(λ) is continuous from +√C1 along the segment from 0 to λ."""
    q, (re, im) = ts.curve_point(alpha, tuple(state), lam.real, lam.imag, *branch_guess(alpha, state, lam))
    m = (re, im) if sheet > 0 else ((-re[0], -re[1]), (-im[0], -im[1]))
    return constants(alpha, tuple(state), q, ((lam.real, 0.0), (lam.imag, 0.0)), m)


def branch_guess(alpha: float, state: Array, lam: complex) -> tuple[float, float]:
    """√Q(λ) in double on the branch continuous from √C1: √C1 Π √(1 − λ/u) over the roots u of Q.

    Along the segment each factor runs straight from 1 to 1 − λ/u. It meets the cut of the principal root only if the segment
    runs through u.
    """
    q = [c[0] for c in ts.spectral_polynomial(alpha, tuple(state))]
    if not all(map(math.isfinite, q)):
        return math.nan, math.nan  # `check_constants` refuses these
    while abs(q[-1]) < 1e-60 * q[0]:  # roots far beyond any useful λ, and beyond what np.roots can do
        q.pop()
    product = complex(math.sqrt(q[0]))
    with np.errstate(all="ignore"):  # `check_constants` refuses constants that overflow
        for inverse in np.roots(q):  # ascending coefficients: the inverses of the roots of Q
            product *= np.sqrt(1 - lam * inverse)
    return float(product.real), float(product.imag)


def two_point(top: LagrangeTop, y: ArrayLike, lam: complex, sheet: int = 1) -> Array:
    """One step of the two-point Bäcklund transformation with parameters λ and λ̄, any λ with Im λ > 0.

    At a root of Q the two sheets meet: within 1e-14 of a simple root, or 1e-8 of a double one, round-off decides which is which.
    At a double root there is no inverse: a homoclinic state goes to the sleeping top. Source: paper, section 5.5;
    docs/exact-step.md.

    Parameters
    ----------
    top : LagrangeTop
        The top.
    y : (6,)
        The state.
    lam : complex
        λ, in units of x/J.
    sheet : int
        1 takes the branch of √Q(λ) continuous from +√C1 along the segment from 0 to λ; −1 the other one, which is the inverse
        map.

    Returns
    -------
    (6,)
        The image.

    Raises
    ------
    ValueError
        y, λ or sheet make no sense.
    StepError
        The image is beyond the range of doubles.
    """
    if not isinstance(top, LagrangeTop):
        raise ValueError("top must be a LagrangeTop: the map is that of a uniform field")
    top.require_single()
    y = check_state(y, "y")
    if sheet not in (1, -1):
        raise ValueError(f"sheet must be 1 or -1; got {sheet!r}")
    units = Units(top, y, 1.0)
    state = units.enter(y)
    c = plain_constants(units.alpha, state, units.parameter(check_parameter(lam)), sheet)
    check_constants("two_point", c)
    image = units.leave(np.array(KERNELS[form(c)](tuple(state), c, np.zeros(SIZE))))
    if not np.all(np.isfinite(image)):
        raise StepError("two_point", "the image is beyond the range of doubles")
    return image
