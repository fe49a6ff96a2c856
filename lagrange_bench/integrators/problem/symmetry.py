"""Reads formulas for properties of a problem: do outputs of a program vanish, or are they polynomials, for all inputs?

A formula is a rational function of its inputs and of the roots, sines, … in it. Each root or sine is replaced by a random number,
one for each argument, that keeps sin² + cos² = 1, parity, and the values at 0 or 1. One random point modulo a large prime P then
shows whether the function vanishes. Nothing is rounded there, and no value is small but not zero. Other laws, such as
exp(a) exp(b) = exp(a + b), are not seen: the answer is no.

A constant in a formula stands for the fraction with a denominator of up to a million that rounds to it, if there is one
(0.1 is a tenth). Otherwise it stands for the double itself, as a parameter always does.

Source: Schwartz, J. ACM 27 (1980) 701; Zippel, EUROSAM '79, Lecture Notes in Computer Science 72 (1979) 216.
"""

from __future__ import annotations

import cmath
import hashlib
import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.unroll import Number

P = 2**127 - 1  # prime; −1 is no square modulo P; a double is a multiple of P only if it is 0
SIMPLE = 10**6  # largest denominator of a constant
POINTS = 8  # of `remainder`
SAME = 1e-12  # a smaller remainder may come from rounded numbers, or from laws that are unknown here


class Sample(Number):
    """A number of a formula at a random point.

    residue : the number modulo P. rough : a complex number, with the true roots and sines, but with exp(iw) for exp(w), which is
    never small and keeps the law of exponents. size : of the terms that add up to it.
    """

    __slots__ = ("residue", "rough", "size")

    def __init__(self, residue: int, rough: complex, size: float | None = None):
        self.residue, self.rough, self.size = residue % P, rough, _length(rough) if size is None else size

    def make(self, operation: str, *operands: Any) -> Sample:
        """The result of an operation. ValueError : division by 0, or a constant that is not finite."""
        a, b = (x if isinstance(x, Sample) else _constant(x) for x in (operands[0], operands[-1]))
        if operation == "add":
            return Sample(a.residue + b.residue, a.rough + b.rough, a.size + b.size)
        if operation == "sub":
            return Sample(a.residue - b.residue, a.rough - b.rough, a.size + b.size)
        if operation == "neg":
            return Sample(-a.residue, -a.rough, a.size)
        if operation == "mul":
            return Sample(a.residue * b.residue, a.rough * b.rough, a.size * b.size)
        if operation == "div":
            rough, size = (a.rough / b.rough, a.size / _length(b.rough)) if b.rough else (math.nan, math.nan)
            return Sample(a.residue * pow(b.residue, -1, P), rough, size)
        return Sample(_function(operation, a.residue), _rough(operation, a.rough))


@lru_cache(maxsize=4096)
def _drawn(*words: Any) -> int:
    """A random number modulo P, always the same for the same words."""
    return int.from_bytes(hashlib.sha256(repr(words).encode()).digest(), "big") % P


def _function(name: str, w: int) -> int:
    """f(w) modulo P: random, but it keeps f(0), f(1), parity and sin² + cos² = 1."""
    # exp w = (1 + u)/(1 − u),   sin w = 2u/(1 + u²),   cos w = (1 − u²)/(1 + u²),   u odd in w
    if (name, w) in (("sqrt", 0), ("sqrt", 1), ("log", 1)):
        return w if name == "sqrt" else 0
    if name in ("sqrt", "log"):
        return _drawn(name, w)
    kind = "exponent" if name == "exp" else "angle"
    u = _drawn(kind, min(w, P - w)) * (1 if w <= P - w else -1) if w else 0
    if name == "exp":
        return (1 + u) * pow(1 - u, -1, P)
    return (2 * u if name == "sin" else 1 - u * u) * pow(1 + u * u, -1, P)


def _length(rough: complex) -> float:
    return math.hypot(rough.real, rough.imag)  # abs() raises where it overflows


def _rough(name: str, w: complex) -> complex:
    try:
        if name == "log":
            return math.log(_length(w))
        return cmath.exp(1j * w) if name == "exp" else getattr(cmath, name)(w)  # type: ignore[no-any-return]
    except (ValueError, OverflowError):
        return math.nan


def _sample(number: Fraction) -> Sample:
    return Sample(number.numerator * pow(number.denominator, -1, P), float(number))


@lru_cache(maxsize=4096)
def _constant(value: float) -> Sample:
    simple = Fraction(value).limit_denominator(SIMPLE)
    return _sample(simple if float(simple) == value else Fraction(value))


def _at(program: Program, numbers: Sequence[float], point: Sequence[int]) -> list[Sample] | None:
    """The outputs at a point, with `numbers` as the last inputs; None if one is not finite."""
    inputs = (Sample(v, 8.0 * (v % P) / P - 4.0) for v in point)
    try:
        outputs = program(*inputs, *(_sample(Fraction(v)) for v in numbers))
        return [value if isinstance(value, Sample) else _constant(value) for value in outputs]
    except (ValueError, OverflowError):
        return None


def generic(numbers: Sequence[float]) -> tuple[float, ...]:
    """Random parameters with the same zeros, ±1 and equalities (but for signs): a property that they show holds for `numbers`."""
    drawn = {0.0: 0.0, 1.0: 1.0}
    return tuple(math.copysign(drawn.setdefault(abs(v), 0.5 + _drawn(len(drawn)) / P), v) for v in numbers)


@lru_cache(maxsize=4096)
def are_polynomials(program: Program, degree: int, numbers: tuple[float, ...]) -> tuple[bool, ...]:
    """Whether the formula of each output shows that it is a polynomial of this degree at most; degree −1: that it vanishes.

    degree : in all inputs together except the parameters, which have the values `numbers`. The test: the difference of order
    degree + 1 along a random line vanishes, Σ_k (−1)^k C(degree + 1, k) f(a + k b) = 0 modulo P.
    """
    count, order = program.inputs - len(numbers), degree + 1
    start, step = ([_drawn(word, i) for i in range(count)] for word in ("start", "step"))
    totals = [0] * len(program.outputs)
    for k in range(order + 1):
        outputs = _at(program, numbers, [a + k * b for a, b in zip(start, step, strict=True)])
        if outputs is None:
            return (False,) * len(totals)
        weight = (-1) ** k * math.comb(order, k)
        totals = [total + weight * value.residue for total, value in zip(totals, outputs, strict=True)]
    return tuple(total % P == 0 for total in totals)


def remainder(program: Program, numbers: Sequence[float] = ()) -> float:
    """The largest value, at random points, of outputs that should vanish, relative to their terms.

    It is 0 only if the formulas show that all outputs vanish, and NaN if none is finite anywhere.
    """
    points = [[_drawn(k, i) for i in range(program.inputs - len(numbers))] for k in range(POINTS)]
    outputs = [value for point in points for value in _at(program, numbers, point) or ()]
    left = [_length(value.rough) / value.size if value.size else math.nan for value in outputs if value.residue]
    finite = [max(v, math.ulp(0.0)) for v in left if not math.isnan(v)]
    return max(finite, default=0.0 if outputs and not left else math.nan)
