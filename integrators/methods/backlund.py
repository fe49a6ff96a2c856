"""The two-point Bäcklund transformation of Kuznetsov, Petrera and Ragnisco as a real, pole-free integrator.

The map conserves H, J3, C1 and C2, is Poisson and symmetric; the formula is in `integrable.real_map`. A step costs one
division and about eighty other operations, its updates are increments of size O(h), so nothing cancels for small h. A
second form takes over where λ is large, or close to a root of Q.

Four records: `backlund` chooses λ(h) on the torus of the initial state, which makes the step the exact flow over h;
`backlund_unpinned` is the same without the correction below; `backlund_paper` takes λ = i h √C1/2, the paper's own time
step; `backlund_textbook` is the complex form of the paper's MATLAB program with the same λ, kept to show what the real
form gains.

Round-off: constants are computed in double-double and rounded once; what is left is a random walk. Every `pin` steps
the state is moved back onto its own invariants (H, C1, C2) by the smallest correction, ~1e-16 in size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integrators.compiling.compiled import jit
from integrators.compiling.loops import (
    FAILURE,
    NEVER,
    SIZE,
    FixedStepper,
    run_lanes,
)
from integrators.interface import Array, Method, StepError, Work, check_count
from integrators.problem.top import LagrangeTop
from integrators.problem.units import Units
from integrators.torus import attitude as at
from integrators.torus import time_step as ts
from integrators.torus.real_map import (
    CONSTANTS,
    KERNELS,
    NO_TURN,
    attitude_loop,
    constants,
    exact_constants,
    form,
    many_constants,
    many_jumps,
    on_torus,
    turn_many,
    turn_rows,
)
from integrators.torus.real_map import pin as onto_torus

FEW = 4  # tops below which one after the other is quicker than a block of lanes
Turn = tuple[tuple[float, float], tuple[float, float]]  # cos and sin of an angle, as double-doubles
OFF_TORUS = 4e-11  # distance of an invariant from the prepared torus, in scaled units, that is no longer round-off
MOST_PARTS = 10**8  # steps of an attitude between two rows: some seconds, not to be interrupted


class TorusStepper(FixedStepper):
    """A fixed-step kernel whose constants hold on one torus only: other states are refused.

    `turn` is (cos, sin) of a turn about e3 that belongs to each step and commutes with the kernel; it is left to the rows.
    """

    def __init__(self, name: str, h: float, units: Units, *args: Any, turn: Turn = NO_TURN, **kwargs: Any):
        self.units, self.turn = units, turn
        super().__init__(name, h, *args, enter=self._enter, leave=units.leave, **kwargs)

    def _enter(self, y: Array) -> Array:
        state = self.units.enter(y)
        if not on_torus(state, self.constants, OFF_TORUS):
            raise StepError(self.name, "the state is not on the torus this step was prepared for", h=self.h)
        return state

    def rows(self, out: Array, every: int) -> Array:
        if self.turn != NO_TURN:
            turn_rows(out[1:], *self.turn, every)
        return super().rows(out, every)


def _stepper(name: str, h: float, units: Units, c: Array, pin_every: int, turn: Turn = NO_TURN) -> FixedStepper:
    check_constants(name, c, h)
    back, block = (onto_torus, pin_every) if pin_every else (None, NEVER)
    return TorusStepper(name, h, units, c, KERNELS[form(c)], back, block, turn=turn)


def check_constants(name: str, c: Array, h: float | None = None) -> None:
    if not np.isfinite(c).all():
        raise StepError(name, "no Bäcklund parameter within the range of doubles was found", h=h)


def prepare_exact(top: LagrangeTop, y0: Array, h: float, *, pin: int = 8, lam: complex | None = None) -> FixedStepper:
    """The exact step over h, any h ≠ 0; or, with `lam`, the two-point map of that parameter.

    Parameters
    ----------
    pin : steps between two corrections onto the invariants, 0 for none.
    lam : λ with Im λ > 0. The map is then a time step of T(λ) and a turn about e3, and h only labels the steps;
        h < 0 takes the inverse map.
    """
    pin = check_count(pin, "pin")
    return _exact("backlund", top, y0, h, pin) if lam is None else _plain("backlund", top, y0, h, lam, pin)


def prepare_unpinned(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """The exact step over h with nothing pinned: what the map does by itself."""
    return _exact("backlund_unpinned", top, y0, h, 0)


def _exact(name: str, top: LagrangeTop, y0: Array, h: float, pin_every: int) -> FixedStepper:
    units = Units(top, y0, h)
    state, span = units.enter(y0), units.span(name, h)
    c, turn = exact_constants(units.alpha, tuple(state.tolist()), span)
    return _stepper(name, h, units, c, pin_every, turn)


def prepare_paper(top: LagrangeTop, y0: Array, h: float, *, pin: int = 8) -> FixedStepper:
    """The two-point map with the paper's time step, λ = i h √C1/2: second order, T = h + O(h³)."""
    return _plain("backlund_paper", top, y0, h, papers_parameter("backlund_paper", y0, h), check_count(pin, "pin"))


def papers_parameter(name: str, y0: Array, h: float) -> complex:
    """λ = i h √C1/2, for |h|: h < 0 takes the inverse map."""
    eta = abs(h) / 2 * math.hypot(*y0[3:])
    if not 0.0 < eta < math.inf:
        raise StepError(name, f"λ = i h √C1/2 is {eta} i: beyond the range of doubles", h=h)
    return complex(0.0, eta)


def _plain(name: str, top: LagrangeTop, y0: Array, h: float, lam: complex, pin_every: int) -> FixedStepper:
    units = Units(top, y0, h)
    state = units.enter(y0)
    lam = units.parameter(check_parameter(lam))
    c = plain_constants(units.alpha, state, lam, -1 if h < 0 else 1)
    return _stepper(name, h, units, c, pin_every)


def check_parameter(lam: complex, name: str = "lam") -> complex:
    """λ as a finite complex number in the upper half-plane."""
    try:
        lam = complex(lam)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a complex number; got {lam!r}") from None
    if not (math.isfinite(lam.real) and math.isfinite(lam.imag)) or lam.imag <= 0:
        raise ValueError(f"{name} must be finite with a positive imaginary part; got {lam}")
    return lam


def plain_constants(alpha: float, state: Array, lam: complex, sheet: int) -> Array:
    """Constants for any λ: m = √Q(λ), continuous from +√C1 along the segment from 0 to λ (sheet 1)."""
    q, (re, im) = ts.curve_point(alpha, tuple(state), lam.real, lam.imag, *branch_guess(alpha, state, lam))
    m = (re, im) if sheet > 0 else ((-re[0], -re[1]), (-im[0], -im[1]))
    return constants(alpha, tuple(state), q, ((lam.real, 0.0), (lam.imag, 0.0)), m)


def branch_guess(alpha: float, state: Array, lam: complex) -> tuple[float, float]:
    """√Q(λ) in double on the branch continuous from √C1: √C1 Π √(1 − λ/u) over the roots u of Q.

    Along the segment each factor runs from 1 straight to 1 − λ/u and meets the cut of the principal root only if
    the segment runs through u itself.
    """
    q = [c[0] for c in ts.spectral_polynomial(alpha, tuple(state))]
    if not all(map(math.isfinite, q)):
        return math.nan, math.nan  # refused with the constants it ends in
    while abs(q[-1]) < 1e-60 * q[0]:  # roots far beyond any λ that keeps digits, and beyond what np.roots can do
        q.pop()
    product = complex(math.sqrt(q[0]))
    with np.errstate(all="ignore"):  # what overflows is refused with the constants it ends in
        for inverse in np.roots(q):  # ascending coefficients: the inverses of the roots of Q
            product *= np.sqrt(1 - lam * inverse)
    return float(product.real), float(product.imag)


def two_point(top: LagrangeTop, y: Array, lam: complex, sheet: int = 1) -> Array:
    """One step of the map with any λ; see `integrators.two_point`."""
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


def evaluate_exact(top: LagrangeTop, y0: Array, times: Array) -> tuple[Array, Work]:
    """Jumps: one two-point map from y0 to each output time, whatever the distance."""
    units = Units(top, y0, float(np.max(np.abs(times), initial=0.0)) or 1.0)
    spans = np.array([units.span("backlund", t) for t in times.tolist()])
    y = units.leave(ts.flow(units.alpha, tuple(units.enter(y0)), spans))
    y[times == 0.0] = y0
    if not np.all(np.isfinite(y)):
        raise StepError("backlund", "no Bäcklund parameter was found for one of the times")
    return y, Work(steps=len(times))


def advance_many(
    alphas: Array,
    Y0: Array,
    h: float,
    steps: int,
    every: int,
    out: Array,
    stopped: Callable[[], bool],
    *,
    pin: int = 8,
    lam: complex | None = None,
) -> NDArray[np.bool_]:
    """The exact steps of many tops, each with λ(h) and constants of its own; options as in `prepare_exact`."""
    pin = check_count(pin, "pin")
    n = len(Y0)
    if lam is not None:
        check_parameter(lam)
    if lam is not None or n < FEW:  # one by one: λ is another in the units of each top, and a block wants to be filled
        return np.zeros(n, dtype=bool)
    states, units, forms = np.empty((n, 6)), np.empty((n, 6)), np.empty(n, dtype=np.int64)
    c, turns = np.empty((n, CONSTANTS)), np.empty((n, 4))
    many_constants(alphas, Y0, h, states, c, units, forms, turns)
    turned = (turns != np.ravel(NO_TURN)).any(axis=1) & (forms >= 0)
    scales = np.where(turned[:, None], 1.0, units)  # what turns keeps its own units until it has turned
    back, block = (onto_torus, pin) if pin else (None, NEVER)
    for number in range(len(KERNELS)):
        tops = np.flatnonzero(forms == number)
        if len(tops):
            run_lanes((KERNELS[number], back, block), states, c, tops, scales, steps, every, out, stopped)
    turn_many(out, np.flatnonzero(turned), turns, every, units)
    done: NDArray[np.bool_] = forms >= 0
    return done


def advance_many_unpinned(*arguments: Any) -> NDArray[np.bool_]:
    return advance_many(*arguments, pin=0)


def evaluate_many(alphas: Array, Y0: Array, times: Array, out: Array) -> NDArray[np.bool_]:
    """Jumps: one two-point map from each top's initial state to each output time."""
    done = np.empty(len(Y0), dtype=bool)
    many_jumps(alphas, Y0, times, out, done)
    return done


def attitude_exact(
    top: LagrangeTop, y0: Array, h: float, n: int, every: int, g0: Array, *, pin: int = 8, lam: complex | None = None
) -> Array:
    """Attitude of the frame that turns with J at 0, every·h, …, n·h, (n//every + 1, 4); exact, see `integrable.attitude`."""
    if lam is not None:
        raise ValueError("lam: the attitude is that of the exact step; it cannot be followed for another parameter")
    units = Units(top, y0, h)
    state = tuple(units.enter(y0))
    span = units.span("backlund", h)
    # whole nutations have no λ of their own: steps of at most half of one
    parts = max(1, math.ceil(2 * abs(span) / ts.torus(units.alpha, state, 0.0)[1][0]))
    if every * parts > MOST_PARTS:
        raise StepError("backlund", f"the attitude is followed by half nutations, at most {MOST_PARTS} a row", h=h)
    c, _ = exact_constants(units.alpha, state, span / parts)
    spin = at.step_spin(units.alpha, state, span / parts)
    block = check_count(pin, "pin") or NEVER
    g, out = tuple(g0), [g0]
    for _ in range(n // every):
        state, g = attitude_loop(state, g, c, spin, every * parts, block)
        out.append(np.array(g))
    return np.array(out)


# ------------------------------------------------------------------------------ the paper's MATLAB program

ALL = frozenset({"H", "J3", "C1", "C2"})
SOURCE = "Kuznetsov, Petrera, Ragnisco, J. Phys. A 37 (2004) 8495, arXiv nlin/0403028, section 5.5"


@jit
def quotient(a, b):
    """a/b as schools teach it: compilers and the interpreter have each another way, and other bits."""
    size = b.real * b.real + b.imag * b.imag
    return complex((a.real * b.real + a.imag * b.imag) / size, (a.imag * b.real - a.real * b.imag) / size)


@jit
def textbook_step(s, c, tally):
    """The loop body of the paper's program (section 5.7), complex, with its divisions; s = (J3, J-, J+, x3, x-, x+)."""
    J3, Jm, Jp, x3, xm, xp = s
    alpha, l1, l2, mu1, mu2 = c[0], c[1], c[2], c[3], c[4]
    B1 = Jm * l1 + xm
    B2 = Jm * l2 + xm
    A1 = (alpha - mu1) * l1 * l1 + J3 * l1 + x3
    A2 = (alpha + mu2) * l2 * l2 + J3 * l2 + x3
    below = B1 * A2 - B2 * A1
    if B1 == 0.0 or below == 0.0:
        tally[FAILURE] = 1
        return s
    x = quotient(A1, B1)
    X = quotient((l2 - l1) * B1 * B2, below)
    # M(u) = u + M0; J̃ = J + [M0, alpha σ3], x̃ = x + M0 J − J̃ M0
    a, b = -l1 + x * X, X
    c_, d = -x * x * X + (l1 - l2) * x, -l2 - x * X
    Km = Jm - 2.0 * alpha * b
    Kp = Jp + 2.0 * alpha * c_
    y3 = x3 + a * J3 + b * Jp - (J3 * a + Km * c_)
    ym = xm + a * Jm - b * J3 - (J3 * b + Km * d)
    yp = xp + c_ * J3 + d * Jp - (Kp * a - J3 * c_)
    return J3, Km, Kp, y3, ym, yp


def to_complex(y: Array) -> Array:
    J1, J2, J3, x1, x2, x3 = np.moveaxis(np.asarray(y, dtype=complex), -1, 0)
    return np.stack((J3, J1 - 1j * J2, J1 + 1j * J2, x3, x1 - 1j * x2, x1 + 1j * x2), axis=-1)


def to_real(s: Array) -> Array:
    J3, Jm, Jp, x3, xm, xp = np.moveaxis(s, -1, 0)
    half = ((Jm + Jp) / 2, 1j * (Jm - Jp) / 2, J3, (xm + xp) / 2, 1j * (xm - xp) / 2, x3)
    return np.stack([v.real for v in half], axis=-1)


def prepare_textbook(top: LagrangeTop, y0: Array, h: float, *, lam: complex | None = None) -> FixedStepper:
    """The paper's program with λ = i h √C1/2 (or `lam`), μ frozen at the start, nothing pinned."""
    units = Units(top, y0, h)
    state = units.enter(y0)
    lam = papers_parameter("backlund_textbook", y0, h) if lam is None else check_parameter(lam)
    lam = units.parameter(lam)
    _, m = ts.curve_point(units.alpha, tuple(state), lam.real, lam.imag, *branch_guess(units.alpha, state, lam))
    with np.errstate(all="ignore"):
        mu = -np.complex128(complex(m[0][0], m[1][0])) / np.complex128(lam) ** 2  # μ on the forward sheet
    mu = mu if h > 0 else -mu
    c = np.array([units.alpha, lam, lam.conjugate(), mu, mu.conjugate()])
    check_constants("backlund_textbook", c, h)

    def enter(y: Array) -> Array:
        with np.errstate(all="ignore"):  # as in `Units`
            return to_complex(units.enter(y))

    def leave(s: Array) -> Array:
        with np.errstate(all="ignore"):
            return units.leave(to_real(s))

    failures = {1: "B(λ) = J- λ + x- vanishes, as it does for a vertical top, and the program divides by it"}
    return FixedStepper("backlund_textbook", h, c, textbook_step, enter=enter, leave=leave, failures=failures)


EXACT = Method(
    name="backlund",
    label="Bäcklund, exact λ(h)",
    family="backlund",
    order=None,
    symmetric=True,
    poisson=True,
    conserves=ALL,
    control="step",
    source=SOURCE + "; λ(h) by time doubling, this project",
    prepare=prepare_exact,
    evaluate=evaluate_exact,
    attitude=attitude_exact,
    advance_many=advance_many,
    evaluate_many=evaluate_many,
)
UNPINNED = replace(
    EXACT,
    name="backlund_unpinned",
    label="Bäcklund, exact, not pinned",
    prepare=prepare_unpinned,
    evaluate=None,
    attitude=None,
    advance_many=advance_many_unpinned,
    evaluate_many=None,
)
PAPER = replace(
    UNPINNED,
    name="backlund_paper",
    label="Bäcklund, paper's λ",
    order=2,
    source=SOURCE,
    prepare=prepare_paper,
    advance_many=None,
)
TEXTBOOK = replace(
    PAPER,
    name="backlund_textbook",
    label="Bäcklund, paper's program",
    source=SOURCE + " and the program of section 5.7",
    prepare=prepare_textbook,
)
