"""Units in which a top is of order one. They are powers of two, so a change of units rounds nothing."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import StateUnits
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop

LARGEST_SPAN = 1e15  # |h| in time scales of the top: the phase of a longer step has no digits left
MODERATE = 1000  # powers of two up to this one are doubles themselves


@jit
def exponents(alpha: float, y: Any, h: float) -> tuple[int, int]:
    """Exponents (rate, length): |J| + √(|alpha||x|), or 1/|h| if this is 0, is about 2^rate, and |x| about 2^length."""
    J, rate = scaled_norm(y[0], y[1], y[2])
    x, length = scaled_norm(y[3], y[4], y[5])
    a, weight = math.frexp(abs(alpha))
    weight += length
    root = math.sqrt(math.ldexp(a * x, weight & 1))
    weight >>= 1
    if J == 0.0 and root == 0.0:
        return -math.frexp(h)[1], length
    if J == 0.0 or (root > 0.0 and weight > rate):
        J, root, rate, weight = root, J, weight, rate
    size, power = math.frexp(J + math.ldexp(root, weight - rate))
    return rate + power, length


@jit
def own_units(alpha: float, y: Any, h: float) -> tuple[int, int, float, float]:
    """`exponents`, then alpha and h in these units; h is infinite if an exponent is extreme or |h| too long."""
    rate, length = exponents(alpha, y, h)
    span = math.ldexp(h, rate)
    if max(abs(rate), abs(length)) >= MODERATE or not abs(span) < LARGEST_SPAN:
        return rate, length, 0.0, math.inf
    return rate, length, math.ldexp(alpha, length - 2 * rate), span


@jit
def scaled_norm(a: float, b: float, c: float) -> tuple[float, int]:
    """|(a, b, c)| as a number from 1/2 to 1 and the exponent of a power of two; (0, 0) if it vanishes."""
    power = math.frexp(max(abs(a), abs(b), abs(c)))[1]
    a, b, c = math.ldexp(a, -power), math.ldexp(b, -power), math.ldexp(c, -power)
    norm, exponent = math.frexp(math.sqrt(a * a + b * b + c * c))
    return norm, power + exponent


@jit
def shift(y: Array, rate: int, length: int) -> None:
    """Multiply J of states (..., 6) by 2^rate and x by 2^length, in place. A number that is too large becomes infinite."""
    moderate = max(abs(rate), abs(length)) < MODERATE
    J, x = math.ldexp(1.0, rate), math.ldexp(1.0, length)
    for first in range(0, y.size, 6):
        for k in range(6):
            number = y.flat[first + k]
            if moderate:
                y.flat[first + k] = number * (J if k < 3 else x)
            else:
                y.flat[first + k] = math.ldexp(number, rate if k < 3 else length)


def ldexp(number: float, exponent: int) -> float:
    """number · 2^exponent; beyond the largest double ±inf, which later checks refuse."""
    try:
        return math.ldexp(number, exponent)
    except OverflowError:
        return math.copysign(math.inf, number)


class Units(StateUnits):
    """The units of a top: powers of two that bring |x| and |J| + √(|alpha||x|) to order one."""

    def __init__(self, top: LagrangeTop, y0: Array, h: float):
        self.rate, self.length = exponents(top.alpha, tuple(y0.tolist()), h)
        self.alpha = ldexp(top.alpha, self.length - 2 * self.rate)

    def enter(self, y: Array) -> Array:
        scaled = np.array(y)
        shift(scaled, -self.rate, -self.length)
        return scaled

    def leave(self, y: Array) -> Array:
        """The state in the user's units, in place."""
        shift(y, self.rate, self.length)
        return y

    def time(self, t: float) -> float:
        return ldexp(t, self.rate)

    def span(self, method: str, h: float) -> float:
        """`time(h)`. StepError: |h| is so long that the exact flow over h has no phase in doubles."""
        span = self.time(h)
        if not abs(span) < LARGEST_SPAN:
            raise StepError(method, "|h| is over 1e15 times the time scale of the top: its phase is beyond double", h=h)
        return span

    def spans(self, method: str, times: Array) -> Array:
        """`span` of many times."""
        with np.errstate(over="ignore"):
            spans: Array = np.ldexp(times, self.rate)
        if not np.all(np.abs(spans) < LARGEST_SPAN):
            self.span(method, float(times[np.argmax(np.abs(spans))]))
        return spans

    def parameter(self, lam: complex) -> complex:
        """λ in these units; it has the dimension of x/J."""
        shift = self.rate - self.length
        return complex(ldexp(lam.real, shift), ldexp(lam.imag, shift))


def units_of(method: str, problem: Any, y0: Array, h: float) -> Units:
    """The units of a top in any field."""
    return Units(problem, y0, h) if kinds.uniform(problem) else units_in_field(method, problem, y0, h)


def units_in_field(method: str, problem: Problem, y0: Array, h: float) -> Units:
    """The units of a top in any field, with the force at y0 as weight if it is larger than alpha. Do not use their `alpha`."""
    force = float(np.max(np.abs((problem.alpha_and_rest[0], *problem.force(y0)))))
    if not math.isfinite(force):
        raise StepError(method, f"{problem.description} is not finite at x = {y0[3:].tolist()}", h=h)
    return Units(LagrangeTop(force), y0, h)


def scaled_size(problem: Any, y0: ArrayLike, difference: Array) -> Array:
    """The largest |vector|/scale of differences of states (..., n), shape (...,), with the scales of y0; v/0 is inf, 0/0 is 0."""
    sizes, start, ratios = problem.sizes(y0), 0, []
    for count in problem.vectors:
        length = np.linalg.norm(difference[..., start : start + count], axis=-1)
        size = float(sizes[start])
        ratios.append(length / size if size > 0 else np.where(length > 0, np.inf, 0.0))
        start += count
    return np.asarray(np.max(ratios, axis=0))


def scaled_distance(problem: Any, y0: ArrayLike, y: Array, other: Array) -> Array:
    """`scaled_size` of the differences of states (..., n). q and −q are the same rotation of a body: the nearer one counts."""
    difference = y - other
    if kinds.rigid_body(problem):
        opposite = np.sum(y[..., :4] * other[..., :4], axis=-1, keepdims=True) < 0
        difference[..., :4] = np.where(opposite, y[..., :4] + other[..., :4], difference[..., :4])
    return scaled_size(problem, y0, difference)
