"""The time of a two-point step with any λ, and its turn about e3, by quadrature in mpmath.

    T = 2 Im ∫_0^λ du/√Q        Θ = 2 alpha Im ∫_0^λ u du/√Q

The integrals run along the segment from 0 to λ, with √Q continuous from √C1. They diverge if a multiple root of Q lies on the
segment or at its end. `time_step` computes the inverse, λ from the time, and fast.

Source: paper, section 5.6, (5.6.11) corrected; docs/exact-step.md, section 1.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mpmath import mp
from numpy.polynomial.polynomial import polyval

from lagrange_bench.integrators.interface import Array

PANELS = (1, 4, 16)  # of the quadrature; more are needed if a root of Q is close to the segment


def time_and_turn(alpha: float, y: Array, lam: complex) -> tuple[Any, Any]:
    """T and Θ of one step of a real state, mpmath numbers. ValueError as of `integral`."""
    *J, x1, x2, x3 = map(mp.mpf, y)
    x, a = (x1, x2, x3), mp.mpf(alpha)
    q = mp.fdot(x, x), 2 * mp.fdot(x, J), mp.fdot(J, J) + 2 * a * x3, 2 * a * J[2], a * a
    T, turn = (2 * moment.imag for moment in moments(q, lam))
    return T, alpha * turn


def moments(q: Sequence[Any], lam: Any) -> tuple[Any, Any]:
    """∫_0^λ du/√Q and ∫_0^λ u du/√Q. q : ascending coefficients of Q."""
    return integral(q, lam, lambda u, m: 1 / m), integral(q, lam, lambda u, m: u / m)


def integral(q: Sequence[Any], lam: Any, integrand: Callable[[Any, Any], Any]) -> Any:
    """∫_0^λ integrand(u, √Q(u)) du, with √Q continuous from the principal √Q(0) along the segment.

    ValueError if Q(0) = 0, or if a root of Q is on the segment or so close to it that 16 panels do not suffice.
    """
    if q[0] == 0:
        raise ValueError("C1 = 0: the two sheets of the spectral curve meet at 0, there is no branch to follow")
    lam = mp.mpmathify(lam)
    inverses = np.roots([complex(c / q[0]) for c in q])  # of the roots of Q
    shares = (
        complex(lam) * inverses
    )  # each factor 1 − u/root runs straight to 1 − share, and meets the cut only at a root
    on_the_way = np.any((shares.real > 1 + 1e-12) & (abs(shares.imag) < 1e-12 * abs(shares)))

    def value(part: Any) -> Any:
        u = part * lam
        near = np.prod(np.sqrt(1 - complex(part) * shares)) * complex(mp.sqrt(q[0]))
        m = mp.sqrt(polyval(u, q))
        return integrand(u, m if (complex(m) * near.conjugate()).real > 0 else -m)

    size = abs(value(mp.mpf(1) / 2)) or mp.one  # the error of the quadrature is absolute
    for panels in () if on_the_way else PANELS:
        nodes = [mp.mpf(k) / panels for k in range(panels + 1)]
        total, error = mp.quad(lambda part: value(part) / size, nodes, error=True)
        if error <= 100 * mp.eps * (1 + abs(total)):
            return total * size * lam
    raise ValueError(f"lam = {mp.nstr(lam, 8)}: a root of Q lies on the segment from 0, or too close to it")
