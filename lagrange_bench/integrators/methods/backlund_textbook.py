"""The paper's MATLAB program (section 5.7): the two-point map in complex form. It shows what the real form gains.

The program carries six complex numbers. Round-off moves them off the real states: J+ is no longer the conjugate of J−, and x3 no
longer real. A row is the nearest real state. So a run that goes on from a row differs from one that was never stopped.
"""

from dataclasses import replace

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import FAILURE, FixedStepper, Kernel, StateUnits
from lagrange_bench.integrators.interface import Array, Claims
from lagrange_bench.integrators.methods.backlund import PAPER, SOURCE
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import time_step as ts
from lagrange_bench.integrators.torus.any_parameter import branch_guess, check_parameter, papers_parameter
from lagrange_bench.integrators.torus.real_map import check_constants

VANISHING = 1
FAILURES = {VANISHING: "B(λ) = J- λ + x- vanishes, as it does for a vertical top, and the program divides by it"}


@jit
def quotient(a, b):
    """a/b by the schoolbook formula. Compilers and the interpreter divide in two other ways, with other bits."""
    size = b.real * b.real + b.imag * b.imag
    return complex((a.real * b.real + a.imag * b.imag) / size, (a.imag * b.real - a.real * b.imag) / size)


@jit
def textbook_step(s, c, counters):
    """The loop body of the paper's program (section 5.7), complex, with its divisions. s = (J3, J-, J+, x3, x-, x+)."""
    J3, Jm, Jp, x3, xm, xp = s
    alpha, l1, l2, mu1, mu2 = c[0], c[1], c[2], c[3], c[4]
    B1 = Jm * l1 + xm
    B2 = Jm * l2 + xm
    A1 = (alpha - mu1) * l1 * l1 + J3 * l1 + x3
    A2 = (alpha + mu2) * l2 * l2 + J3 * l2 + x3
    denominator = B1 * A2 - B2 * A1
    if B1 == 0.0 or denominator == 0.0:
        counters[FAILURE] = VANISHING
        return s
    x = quotient(A1, B1)
    X = quotient((l2 - l1) * B1 * B2, denominator)
    # M(u) = u + M0; J̃ = J + [M0, alpha σ3], x̃ = x + M0 J − J̃ M0
    a, b = -l1 + x * X, X
    c_, d = -x * x * X + (l1 - l2) * x, -l2 - x * X
    Km = Jm - 2.0 * alpha * b
    Kp = Jp + 2.0 * alpha * c_
    y3 = x3 + a * J3 + b * Jp - (J3 * a + Km * c_)
    ym = xm + a * Jm - b * J3 - (J3 * b + Km * d)
    yp = xp + c_ * J3 + d * Jp - (Kp * a - J3 * c_)
    return J3, Km, Kp, y3, ym, yp


class ComplexUnits(StateUnits):
    """The units of a top, and complex states."""

    def __init__(self, units: Units):
        self.units = units

    def enter(self, y: Array) -> Array:
        J1, J2, J3, x1, x2, x3 = self.units.enter(y).astype(complex)
        with np.errstate(all="ignore"):  # as in `Units`
            return np.stack((J3, J1 - 1j * J2, J1 + 1j * J2, x3, x1 - 1j * x2, x1 + 1j * x2))

    def leave(self, rows: Array) -> Array:
        J3, Jm, Jp, x3, xm, xp = np.moveaxis(rows, -1, 0)
        with np.errstate(all="ignore"):
            parts = ((Jm + Jp) / 2, 1j * (Jm - Jp) / 2, J3, (xm + xp) / 2, 1j * (xm - xp) / 2, x3)
            return self.units.leave(np.stack([v.real for v in parts], axis=-1))


def prepare_textbook(top: LagrangeTop, y0: Array, h: float, *, lam: complex | None = None) -> FixedStepper:
    """The paper's program with λ = i h √C1/2 (or `lam`), and μ fixed at the start. Nothing is pinned."""
    units = Units(top, y0, h)
    state = units.enter(y0)
    lam = units.parameter(papers_parameter("backlund_textbook", y0, h) if lam is None else check_parameter(lam))
    _, m = ts.curve_point(units.alpha, tuple(state), lam.real, lam.imag, *branch_guess(units.alpha, state, lam))
    with np.errstate(all="ignore"):
        mu = -np.complex128(complex(m[0][0], m[1][0])) / np.complex128(lam) ** 2  # μ on the forward sheet
    mu = mu if h > 0 else -mu
    c = np.array([units.alpha, lam, lam.conjugate(), mu, mu.conjugate()])
    check_constants("backlund_textbook", c, h)
    stepper = FixedStepper("backlund_textbook", h, Kernel(textbook_step, failures=FAILURES), c, ComplexUnits(units))
    stepper.from_start = True  # see the module
    return stepper


METHOD = replace(
    PAPER,
    name="backlund_textbook",
    label="Bäcklund, paper's program",
    source=SOURCE + " and the program of section 5.7",
    prepare=prepare_textbook,
    kernels_for={},
    # The map conserves H, C1 and C2, too. But the divisions lose them where B(λ) is small: at each pass near the vertical.
    claims=Claims(symmetric=True, poisson=True, conserves={"J3"}),
)
