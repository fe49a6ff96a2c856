"""DOP853: the explicit Runge-Kutta pair of order 8 with error estimates of orders 5 and 3, on its natural steps, compiled.

The step control is that of Hairer's program with its defaults (safety 0.9, a step at most 6 times and at least a third of
the one before, no stabilization), as are the first step and the interpolant of order 7: the strongest explicit Runge-Kutta method
with step control, without interpretation. The exponent 1/8 of the control is three square roots. h is only the output grid.
A step takes 12 right-hand sides, the slope at its start among them, and 4 more if it is interpolated.

Source: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), sections II.4 (first step), II.5, II.6, and
the program DOP853.
"""

from __future__ import annotations

import math

import numpy as np

from integrators.compiled import jit
from integrators.dense import DenseStepper, Run, at_times
from integrators.interface import Array, Method, StepError, Work, check_real
from integrators.loops import (
    INTERPOLATED,
    INTERRUPTIBLE,
    REJECTED,
    ROW,
    STEP,
    STUCK,
    TAKEN,
    TIME,
    WALK,
    compile_natural_loop,
)
from integrators.methods.runge_kutta import floats, slopes_of, weigh
from integrators.tableaux import DOP853, DOP853_MORE
from integrators.top import LagrangeTop
from integrators.unroll import unrolled

ALPHA, RTOL, ATOL = range(3)  # places of the constants
LEAST_RTOL = 100 * float(np.finfo(float).eps)  # as SciPy's
LEAST_SCALE = 2.0**-1022
LARGEST = 2.0**1000  # of a state: beyond, stages overflow, and steps are cut until they change nothing
PLACES = ((0, 0), (1, 1), (2, 3), (3, 4), (4, 5))  # of J1, J2, x1, x2, x3 in a slope and in a state
SAFETY = 0.9
NEGLIGIBLE = 1e-16  # an error that lets the step grow as much as it may

A = tuple(map(floats, DOP853.a))
B = floats(DOP853.b)
E5 = floats(DOP853_MORE["e5"])
E3 = tuple(float(b - e) for b, e in zip(DOP853.b, DOP853_MORE["e3"], strict=True))
AHEAD = (B, *(floats(DOP853_MORE[str(i)]) for i in (14, 15, 16)))  # stages 13 to 16
D = tuple(floats(DOP853_MORE[f"d{i}"]) for i in (4, 5, 6, 7))


@unrolled("attempt")
def attempt(s, alpha, h):
    """Increment, both errors, and all twelve slopes, each of (J1, J2, x1, x2, x3)."""
    slopes = slopes_of(A, s, alpha, h)
    return weigh(B, slopes), weigh(E5, slopes), weigh(E3, slopes), slopes


@unrolled("polynomial")
def polynomial(s, increment, alpha, h, slopes):
    """Coefficients of the interpolant, in its own nested form."""
    J1, J2, J3, x1, x2, x3 = s
    slopes = slopes_of(AHEAD, s, alpha, h, slopes)

    def minus(a, b):
        return tuple(p - q for p, q in zip(a, b, strict=True))

    bend = minus(slopes[0], increment)
    twist = minus(minus(increment, slopes[12]), bend)
    return (J1, J2, x1, x2, x3), increment, bend, twist, *(weigh(d, slopes) for d in D)


@unrolled("nested")
def nested(f, theta):
    total = f[7]
    for power, coefficients in enumerate(f[6::-1]):
        factor = 1.0 - theta if power % 2 else theta
        total = tuple(c + factor * v for c, v in zip(coefficients, total, strict=True))
    return total


@jit
def value(f, theta):
    J1, J2, x1, x2, x3 = nested(f[1], theta)
    return J1, J2, f[0], x1, x2, x3


@jit
def eighth_root(a):
    return math.sqrt(math.sqrt(math.sqrt(a)))


@jit
def trial(s, h, c):
    J1, J2, J3, x1, x2, x3 = s
    d, e, f, slopes = attempt(s, c[ALPHA], h)
    new = (J1 + d[0], J2 + d[1], J3, x1 + d[2], x2 + d[3], x3 + d[4])
    fifth = third = 0.0
    for i, j in PLACES:
        r = 1.0 / max(c[ATOL] + c[RTOL] * max(abs(s[j]), abs(new[j])), LEAST_SCALE)
        p, q = e[i] * r, f[i] * r
        fifth += p * p
        third += q * q
    both = fifth + 0.01 * third
    error = fifth / math.sqrt(6.0 * both) if both > 0.0 else both  # six components share it; or NaN
    growth = SAFETY / eighth_root(max(error, NEGLIGIBLE))
    return new, error, growth, (d, slopes)


@jit
def interpolant(s, new, h, c, made):
    d, slopes = made
    return s[2], polynomial(s, d, c[ALPHA], h, slopes)


@unrolled("slope")
def slope(s, alpha):
    return slopes_of((), s, alpha, 1.0)[0]


@jit
def size(v, s, c):
    """The largest component, in units of its tolerance: the squares of the root mean square might overflow."""
    largest = 0.0
    for i, j in PLACES:
        largest = max(largest, abs(v[i]) / max(c[ATOL] + c[RTOL] * abs(s[j]), LEAST_SCALE))
    return largest


@jit
def first_step(s, end, c):
    """A step whose error should be a hundredth of the tolerance, from the size of f and of its change along an Euler step."""
    J1, J2, J3, x1, x2, x3 = s
    f = slope(s, c[ALPHA])
    d0, d1 = size((J1, J2, x1, x2, x3), s, c), size(f, s, c)
    h = 0.01 * d0 / d1 if min(d0, d1) > 1e-5 else 1e-6
    h = math.copysign(min(h, abs(end)), end)
    if h != 0.0:
        g = slope((J1 + h * f[0], J2 + h * f[1], J3, x1 + h * f[2], x2 + h * f[3], x3 + h * f[4]), c[ALPHA])
        d2 = size((g[0] - f[0], g[1] - f[1], g[2] - f[2], g[3] - f[3], g[4] - f[4]), s, c) / abs(h)
        steepest = max(d1, d2)
        best = eighth_root(0.01 / steepest) if steepest > 1e-15 else max(1e-6, 1e-3 * abs(h))
        h = math.copysign(min(100.0 * abs(h), best, abs(end)), end)
    return h if h != 0.0 else 1e-6 * end  # the control finds its step from anywhere


def prepare(top: LagrangeTop, y0: Array, h: float, *, rtol: float = 1e-9, atol: float = 1e-12) -> DenseStepper:
    """Natural steps with the local error kept below atol + rtol |y_i|, root mean square over the components."""
    return DenseStepper("dop853", top, y0, h, _runner(top, rtol, atol))


def evaluate(
    top: LagrangeTop, y0: Array, times: Array, *, rtol: float = 1e-9, atol: float = 1e-12
) -> tuple[Array, Work]:
    """Dense output at any times; options as in `prepare`."""
    return at_times("dop853", top, _runner(top, rtol, atol), y0, times)


def _runner(top: LagrangeTop, rtol: float, atol: float) -> Run:
    rtol, atol = check_tolerances(rtol, atol)
    loop = compile_natural_loop(trial, interpolant, value)
    c = np.array((top.alpha, rtol, atol))
    loop(np.zeros(6), np.zeros(1), 0, c, np.zeros(WALK), np.zeros((1, 6)))  # compile
    first_step((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0, c)

    def run(y: Array, grid: Array, work: Work) -> Array:
        if not np.max(np.abs(y)) <= LARGEST:
            raise StepError("dop853", "a state this close to the largest double leaves a step no room")
        state, out, walk = y.copy(), np.empty((len(grid), 6)), np.zeros(WALK)
        walk[STEP] = first_step(tuple(y.tolist()), float(grid[-1]), c)
        while walk[ROW] < len(grid) and not walk[STUCK]:
            loop(state, grid, INTERRUPTIBLE, c, walk, out)
        taken, rejected, interpolated = (int(walk[place]) for place in (TAKEN, REJECTED, INTERPOLATED))
        work.steps += taken
        work.rejected += rejected
        work.rhs_evals += 2 + 12 * (taken + rejected) + 4 * interpolated
        if walk[STUCK]:
            reason = f"the step fell below the spacing of doubles (t = {walk[TIME]:g})"
            raise StepError("dop853", reason, step=taken)
        return out

    return run


def check_tolerances(rtol: float, atol: float) -> tuple[float, float]:
    rtol, atol = check_real(rtol, "rtol"), check_real(atol, "atol")
    if not LEAST_RTOL <= rtol <= 1:
        raise ValueError(f"rtol must be between {LEAST_RTOL:.3g} (100 eps) and 1; got {rtol:g}")
    if atol < 0:
        raise ValueError(f"atol must not be negative; got {atol:g}")
    return rtol, atol


METHOD = Method(
    name="dop853",
    label="DOP853",
    family="runge-kutta",
    order=8,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="tolerance",
    source="Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5 and II.6; program DOP853",
    prepare=prepare,
    evaluate=evaluate,
)
