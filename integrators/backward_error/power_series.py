"""Truncated power series in the step h, whose coefficients are arrays: what a step does to many states, term by term.

Coefficients are numbers of the type they are given as. Sums, products and quotients of series are exact but for round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Series:
    """Σ c[k] h^k; `c` is (terms, points). Comparisons are those of the leading coefficients, at every point."""

    __array_ufunc__ = None  # NumPy leaves its operators to these

    def __init__(self, c: NDArray[Any]):
        self.c = c

    def __add__(self, other: Any) -> Series:
        c = self.c.copy()
        c[: len(c) if isinstance(other, Series) else 1] += other.c if isinstance(other, Series) else other
        return Series(c)

    def __neg__(self) -> Series:
        return Series(-self.c)

    def __sub__(self, other: Any) -> Series:
        return self + -other

    def __rsub__(self, other: Any) -> Series:
        return -self + other

    def __mul__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c * other)
        c = np.zeros_like(self.c)
        for k in np.flatnonzero(self.c.any(axis=1)):
            c[k:] += self.c[k] * other.c[: len(c) - k]
        return Series(c)

    def __truediv__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Series(self.c / other)
        c = np.empty_like(self.c)
        for k in range(len(c)):
            c[k] = (self.c[k] - np.sum(c[:k] * other.c[k:0:-1], axis=0)) / other.c[0]
        return Series(c)

    def __rtruediv__(self, other: Any) -> Series:
        return (self * 0.0 + other) / self

    def sqrt(self) -> Series:
        """The root with a positive leading coefficient."""
        c = np.empty_like(self.c)
        c[0] = np.sqrt(self.c[0])
        for k in range(1, len(c)):
            c[k] = (self.c[k] - np.sum(c[1:k] * c[k - 1 : 0 : -1], axis=0)) / (2.0 * c[0])
        return Series(c)

    def __gt__(self, other: float) -> bool:
        return bool(np.all(self.c[0] > other))

    def __le__(self, other: float) -> bool:
        return bool(np.all(self.c[0] <= other))

    __radd__, __rmul__ = __add__, __mul__
