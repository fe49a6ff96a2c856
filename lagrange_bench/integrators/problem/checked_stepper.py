"""Checks what a stepper that a user wrote returns, so that wrong rows are refused.

Steppers of the bench itself are not checked here: tests check them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import Array, as_state, check_grid
from lagrange_bench.integrators.interface import StepError, Stepper


def checked_stepper(name: str, stepper: Any, size: int = 6) -> Stepper:
    """The stepper of `name`, for states of `size` numbers, with checks; ValueError if it is no stepper."""
    for word in ("record", "advance", "work"):
        if getattr(stepper, word, None) is None or getattr(type(stepper), word, None) is Stepper.record:
            raise ValueError(f"{name}: prepare returned {stepper!r} without {word}: return a stepper")
    return CheckedStepper(name, stepper, size)  # type: ignore[return-value]


class CheckedStepper:
    """A stepper whose results are checked. Everything else goes to the stepper itself.

    Raises
    ------
    ValueError : a result has the wrong shape or type, its first row is not the input, it was returned before, or the input was
    written to.
    StepError : a state is not finite.
    """

    def __init__(self, name: str, stepper: Stepper, size: int = 6):
        self.name, self.stepper, self.size, self.last = name, stepper, size, None

    def __getattr__(self, word: str) -> Any:
        return getattr(self.stepper, word)

    def advance(self, y: Array, n: int) -> Array:
        if getattr(type(self.stepper), "advance", None) is Stepper.advance:  # the last row of `record`
            return self.record(y, n, max(n, 1))[-1]
        return self._call("advance", (self.size,), as_state(y, self.size), n)

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        y = as_state(y, self.size)
        rows = self._call("record", (n // every + 1, self.size), y, n, every)
        if rows[0].tobytes() != y.tobytes():
            raise ValueError(f"{self.name}: row 0 of record must be the input {y.tolist()}; got {rows[0].tolist()}")
        return rows

    def _call(self, word: str, shape: tuple[int, ...], y: Array, *counts: int) -> Array:
        before = y.tobytes()
        rows = getattr(self.stepper, word)(y, *counts)
        if y.tobytes() != before:
            raise ValueError(f"{self.name}: {word} wrote to its input; it must return a fresh array")
        check_rows(self.name, word, rows, shape)
        if rows is self.last:
            raise ValueError(f"{self.name}: {word} returned the same array twice; it must return a fresh one")
        if not np.isfinite(rows).all():
            raise StepError(self.name, f"{word} returned a state that is not finite")
        self.last = rows
        return rows  # type: ignore[no-any-return]


def check_rows(name: str, word: str, rows: Any, shape: tuple[int, ...]) -> None:
    """ValueError unless `rows`, which `word` of the method `name` returned, is an array of floats of this shape."""
    if not isinstance(rows, np.ndarray) or rows.shape != shape or rows.dtype != np.float64:
        kind = f"{rows.dtype} {rows.shape}" if isinstance(rows, np.ndarray) else type(rows).__name__
        raise ValueError(f"{name}: {word} must return an array of floats (float64) of shape {shape}; got {kind}")
