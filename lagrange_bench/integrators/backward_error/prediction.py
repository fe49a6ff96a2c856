"""Predicts by backward error analysis where a method will be: how wrong its clock is, and how fast it turns too far.

After n steps of h, at t = nh, a state is at the exact solution of the time t + τ(t), turned about e3 by θ(t), and off the
torus by the drift of the invariants. Apart from oscillations with the nutation,

    τ = clock t + ½ clock_growth t²        θ = turn t + ½ turn_growth t².

The growths and the distance to the torus are 0 unless the method lets the invariants drift. `PredictedPhase.states` has all
parts. docs/phase-theory.md has the formulas and their sources.

For the two-point map, T(λ) and Θ(λ) are known, so clock = T/h − 1 and turn = Θ/h, and nothing oscillates. For any other method
the local error δ is a power series in h (`steps`), of which `TERMS` terms are taken. To first order in δ the error e = X p + E o
obeys

    o ← o + Gδ        p ← p + S o + X⁺δ        S = Σ(s + h) − Σ(s),   Σ' = X⁺(f' E − E'),

with y' = f(y), X = (X_H, X_J3), the gradients of H, J3, C1 and C2 as rows of G, and E = Gᵀ(G Gᵀ)⁻¹. p is the error along the
torus, and o the error of the invariants. All terms are periodic in s, the time modulo a nutation, and Fourier series sum them.
For a symmetric method the mean of Gδ vanishes; a mean that is left at first order is removed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.backward_error.steps import STEPS, Series, taylor_flow
from lagrange_bench.integrators.checks import check_state, check_step, check_times
from lagrange_bench.integrators.interface import Array, Method
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.torus.any_parameter import papers_parameter
from lagrange_bench.integrators.torus.clock import time_and_turn
from lagrange_bench.integrators.truth import exact
from lagrange_bench.support.precision import workdps

PAPERS = ("backlund_paper", "backlund_textbook")  # two-point maps with λ = i h √C1/2
PREDICTED = frozenset((*STEPS, *PAPERS))  # methods whose errors are predicted; others need no entry
SPANS = (1e-6, 1e3)  # least and largest |h|, in time scales of the top
DIGITS = 30  # of T(λ), which for small h is nearly h
TERMS = 20  # of the power series of the local error
CONVERGED = 1e-3  # the last two terms may be this part of the sum of all
POINTS = (64, 256, 1024)  # in a nutation; more are tried if 64 do not resolve it
SMOOTH = 1e-5  # the highest Fourier modes may be this part of the largest
RESONANT = 1e-9  # a mode with a smaller |e^{iθ} − 1| has the same phase θ at every step
ROUND_OFF = 1e-14  # a smaller local error, in units of the top, is round-off
THIN = 1e-6  # independent unit vectors have a larger ratio of least to largest singular value


class NoPrediction(ValueError):
    """There is no theory for a method on a top. The message is the reason."""


def predicted_phase(top: LagrangeTop, y0: ArrayLike, h: float, method: str | Method = "backlund") -> PredictedPhase:
    """Predict the phase errors of a method, and where it will be, by backward error analysis, without taking a step.

    Parameters
    ----------
    top, y0, h, method : LagrangeTop, (6,), float, str or Method
        As in `integrate`; `top` is in a uniform field.

    Returns
    -------
    PredictedPhase
        `states(t)` are the states of the method after a time t. The rates say the same in a few numbers. Apart from oscillations,
        the method is at the exact solution of the time t + clock t + ½ clock_growth t², turned about e3 by turn t + ½ turn_growth
        t².

    Raises
    ------
    NoPrediction
        A ValueError: there is no theory for this method on this top, with this step. The message is the reason.
    ValueError
        An argument is not valid; the message names it.
    """
    if not kinds.uniform(top):
        raise ValueError(f"top must be a LagrangeTop; got {type(top).__name__}")
    top.require_single()
    record, state, h = find_method(method), check_state(y0), check_step(h)
    span = abs(h) / top.scales(state)[2]
    if not SPANS[0] <= span <= SPANS[1]:
        raise NoPrediction(f"h is {span:g} time scales of the top, and must be between {SPANS[0]:g} and {SPANS[1]:g}")
    if record.name in PAPERS:
        return of_two_point(top, state, h, papers_parameter(record.name, state, h))
    if record.control != "step":
        raise NoPrediction(f"{record.name} chooses its own steps")
    if record.order is None:
        return exact_in_time(top, state, h)
    if record.name not in STEPS:
        raise NoPrediction(f"no power series of a step of {record.name} is known")
    return of_first_order(top, state, h, record)


@dataclass(frozen=True)
class Sum:
    """The sum g(s_0) + … + g(s_{n−1}) of a periodic g with s_n = nh: n mean + w(s_n) − w(s_0).

    The wave w obeys w(s + h) − w(s) = g(s) − mean.
    """

    mean: Array
    modes: NDArray[Any]  # of w
    angle: Array  # by which a step turns each mode

    @classmethod
    def of(cls, g: Array, angle: NDArray[Any]) -> Sum:
        modes, divisors = np.fft.fft(g, axis=0) / len(g), np.expm1(1j * angle)
        still = np.abs(divisors) < RESONANT
        mean = modes[still].sum(axis=0).real
        modes[still] = 0.0
        return cls(mean, modes / np.where(still, 1.0, divisors)[:, None], angle)

    def values(self) -> Array:
        """w on the grid of g."""
        return np.fft.ifft(self.modes, axis=0).real * len(self.modes)

    def wave(self, n: Array) -> Array:
        """w(s_n)."""
        return (np.exp(1j * np.outer(n, self.angle)) @ self.modes).real

    def __call__(self, n: Array) -> Array:
        return np.outer(n, self.mean) + self.wave(n) - self.wave(np.zeros(1))


class PredictedPhase:
    """The prediction for the runs of one method, from one state, with one step, to first order in its local error.

    Parameters
    ----------
    top, y0, h : LagrangeTop, array (6,), float
        As in `predicted_phase`.
    step : (points, 6)
        The increments of p and o in a step, at equal distances over a nutation, in units of the top.
    S : (points, 2, 4)
        The shear, at the same places.
    angle : (points,)
        The angle by which a step turns each Fourier mode.
    drifts : bool
        Whether the invariants drift in the mean.

    Attributes
    ----------
    clock, turn : float
        The relative error of the method's clock (positive: fast), and the rate by which it turns too far about e3, in rad per
        unit of time.
    clock_growth, turn_growth : float
        Their growth per unit of time. It is 0 if the method conserves the invariants in the mean.
    """

    def __init__(
        self,
        top: LagrangeTop,
        y0: Array,
        h: float,
        step: Array,
        S: NDArray[Any],
        angle: NDArray[Any],
        drifts: bool = False,
    ):
        self.units, self.user_h = Units(top, y0, h), h
        self.top, self.y0, self.h = LagrangeTop(self.units.alpha), self.units.enter(y0), self.units.time(h)
        # o after k steps is k mean + Q(s_k) − Q(0), so S o is a periodic part and k times another, the ramp
        off = Sum.of(step[:, 2:], angle)
        self.off = off if drifts else replace(off, mean=np.zeros(4))
        Q = self.off.values()
        self.along = Sum.of(step[:, :2] + times(S, Q - Q[0]), angle)
        self.ramp = Sum.of(times(S, np.broadcast_to(self.off.mean, Q.shape)), angle)
        self.ramps = Sum.of(self.ramp.values(), angle)
        # p = n along + n (n − 1)/2 ramp on average, with n = t/h
        second = self.units.time(1.0)
        self.clock, turn = (float(v) for v in (self.along.mean - self.ramp.mean / 2) / self.h)
        self.clock_growth, turn_growth = (float(v) * second for v in self.ramp.mean / self.h**2)
        self.turn, self.turn_growth = turn * second, turn_growth * second

    def states(self, t: ArrayLike) -> Array:
        """The states (N, 6) of the method at times t (N,), multiples of h as in `Trajectory.t`; between them a smooth curve.

        They include oscillations and the drift of the invariants. For the two-point map they are exact. For any other method they
        are wrong by about error²/amplitude, with the amplitude of the nutation relative to the scales of J and x. If the error is
        as large as the amplitude, the prediction may be worse than none.
        """
        n = check_times(t) / self.user_h
        # by parts: Σ_{k<n} k g(s_k) = n (n − 1)/2 mean + (n − 1) w(s_n) − Σ_{0<k<n} w(s_k)
        ramped = np.outer(n * (n - 1) / 2, self.ramp.mean) + (n - 1)[:, None] * self.ramp.wave(n)
        p = self.along(n) + ramped + self.ramp.wave(np.zeros(1)) - self.ramps(n)
        y = exact.solution(self.top, self.y0, self.h * n + p[:, 0])
        c, s = np.cos(p[:, 1]), np.sin(p[:, 1])
        for i in (0, 3):
            y[:, i], y[:, i + 1] = c * y[:, i] - s * y[:, i + 1], s * y[:, i] + c * y[:, i + 1]
        return self.units.leave(y + times(np.linalg.pinv(gradients(self.top, y)), self.off(n)))


def exact_in_time(top: LagrangeTop, y0: Array, h: float) -> PredictedPhase:
    """The prediction for a method without error."""
    return PredictedPhase(top, y0, h, np.zeros((1, 6)), np.zeros((1, 2, 4)), np.zeros(1))


def of_two_point(top: LagrangeTop, y0: Array, h: float, lam: complex) -> PredictedPhase:
    """The prediction for the two-point map: the time T(λ) and the turn Θ(λ), both exact. A step with h < 0 is the inverse map."""
    try:
        with workdps(DIGITS):
            T, turn = time_and_turn(top.alpha, y0, lam)
            ahead = float(T - abs(h))
    except ValueError as error:
        raise NoPrediction(f"T(λ) and Θ(λ) are not known: {error}") from None
    sign, units = math.copysign(1.0, h), Units(top, y0, h)
    step = sign * np.array([[units.time(ahead), float(turn), 0.0, 0.0, 0.0, 0.0]])
    return PredictedPhase(top, y0, h, step, np.zeros((1, 2, 4)), np.zeros(1))


def of_first_order(user_top: LagrangeTop, user_y0: Array, user_h: float, method: Method) -> PredictedPhase:
    units = Units(user_top, user_y0, user_h)
    top, y0, h = LagrangeTop(units.alpha), units.enter(user_y0), units.time(user_h)
    period = exact.nutation_period(top, y0)
    if not np.isfinite(period):
        raise NoPrediction("the motion has no period")
    for points in POINTS:
        s = np.arange(points) * (period / points)
        states, ends = exact.solution(top, y0, s), exact.solution(top, y0, s + h)
        error, X = local_error(top, states, h, method), flows(top, ends)
        if top.alpha == 0.0 and np.max(np.abs(error)) < ROUND_OFF:  # exact without weight
            return exact_in_time(user_top, user_y0, user_h)
        G = gradients(top, ends + error / 2)  # invariants are of second degree: G e is their change
        step = np.concatenate((times(np.linalg.pinv(X), error), times(G, error)), axis=1)
        shear = shears(top, states)
        if smooth(step) and smooth(shear):
            break
    else:
        raise NoPrediction(f"{points} points of a nutation do not resolve the local error")
    angle = (2 * np.pi / period * h) * np.fft.fftfreq(points, 1 / points)
    # S = Σ(s + h) − Σ(s): a mode of Σ' that a step turns by θ gets the factor h (e^{iθ} − 1)/(iθ)
    modes = np.fft.fft(shear, axis=0)
    modes[1:] *= (np.expm1(1j * angle[1:]) / (1j * angle[1:]))[:, None, None]
    S = h * np.fft.ifft(modes, axis=0).real
    return PredictedPhase(user_top, user_y0, user_h, step, S, angle, drifts=not method.claims.symmetric)


def local_error(top: LagrangeTop, states: Array, h: float, method: Method) -> Array:
    """Φ_h − φ_h at states (N, 6), from `TERMS` terms of its power series in h, which begins at the order of the method."""
    assert method.order is not None
    alpha, first, power = top.require_single(), method.order + 1, method.order + TERMS
    *y, step = (Series(np.zeros((power + 1, len(states)))) for _ in range(7))
    for part, column in zip(y, states.T, strict=True):
        part.c[0] = column
    step.c[1] = 1.0
    after, right = (flow(alpha, tuple(y), step, power) for flow in (STEPS[method.name], taylor_flow))
    coefficients = np.array([(a - b).c[first:] for a, b in zip(after, right, strict=True)])
    terms = coefficients * (h ** np.arange(first, power + 1))[:, None]
    total = terms.sum(axis=1)
    if not np.abs(terms[:, -2:]).max() <= CONVERGED * np.abs(total).max():
        raise NoPrediction("the power series of the local error does not converge: take a smaller |h|")
    return total.T


def times(matrices: NDArray[Any], vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", matrices, vectors)


def flows(top: LagrangeTop, states: Array) -> Array:
    """X_H and X_J3 at states (N, 6), as columns (N, 6, 2)."""
    X = np.zeros((*states.shape, 2))
    X[:, :, 0] = top.rhs(states)
    X[:, (0, 3), 1], X[:, (1, 4), 1] = -states[:, (1, 4)], states[:, (0, 3)]
    # the gradients of the invariants are independent where the flows are
    lengths = np.linalg.norm(X, axis=1, keepdims=True)
    values = np.linalg.svd(X / np.where(lengths > 0, lengths, 1.0), compute_uv=False)
    if not np.all(values[:, -1] > THIN * values[:, 0]):
        raise NoPrediction("the flows of H and J3 are one: a regular precession, or very close to it")
    return X


def gradients(top: LagrangeTop, states: Array) -> Array:
    """The gradients of H, J3, C1 and C2, as rows (N, 4, 6)."""
    return np.array([top.gradients(y) for y in states])


def shears(top: LagrangeTop, states: Array) -> Array:
    """X⁺(f' E − E') at states (N, 6), shape (N, 2, 4). Because X⁺ Gᵀ = 0, it is X⁺(f' Gᵀ − Gᵀ')(G Gᵀ)⁻¹."""
    X, G, rates = flows(top, states), gradients(top, states), top.rhs(states)
    still = gradients(top, np.zeros_like(states))  # gradients are affine functions of the state
    changes = gradients(top, rates) - still
    transposed = G.transpose(0, 2, 1)
    f = np.array([top.jacobian(y) for y in states])
    changed = f @ transposed - changes.transpose(0, 2, 1)
    return np.linalg.pinv(X) @ changed @ np.linalg.inv(G @ transposed)


def smooth(values: Array) -> bool:
    """Whether the Fourier series of a periodic function on a grid ends before the modes of the grid do."""
    size = np.abs(np.fft.fft(values, axis=0)).reshape(len(values), -1).max(axis=1)
    return bool(size[3 * len(size) // 8 : 5 * len(size) // 8].max() <= SMOOTH * size.max())
