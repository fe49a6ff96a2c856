"""Methods that choose their own steps: what is common to libraries with dense output.

Such a method supplies `run(y, grid, work) -> (len(grid), 6)`: the states at the times of a strictly monotone `grid`
that leads away from 0, counted into `work`. It raises `StepError` by itself where the library reports a failure.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from integrators.interface import Array, StepError, Work
from integrators.loops import check_grid

Run = Callable[[Array, Array, Work], Array]


class DenseStepper:
    """A `Stepper` whose h is only the output grid."""

    def __init__(self, name: str, h: float, run: Run):
        self.name, self.h, self.run = name, h, run
        self.work = Work()

    def advance(self, y: Array, n: int) -> Array:
        return self.record(y, n, max(n, 1))[-1]

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        out = np.empty((n // every + 1, 6))
        out[0] = y
        if n:
            with np.errstate(over="ignore"):
                grid = self.h * np.arange(every, n + 1, every, dtype=np.float64)
            if not np.isfinite(grid[-1]):
                raise StepError(self.name, f"the time n h is not finite for n = {n}", h=self.h)
            out[1:] = finite(self.name, self.run(out[0].copy(), grid, self.work), self.h)
        return out


def at_times(name: str, run: Run, y0: Array, times: Array) -> tuple[Array, Work]:
    """States at any times, in any order and on both sides of 0."""
    work = Work()
    out = np.empty((len(times), 6))
    out[times == 0.0] = y0
    for side in (times > 0, times < 0):
        if np.any(side):
            grid, places = np.unique(np.abs(times[side]), return_inverse=True)
            grid *= np.sign(times[side][0])
            out[side] = finite(name, run(y0.copy(), grid, work), None)[places]
    return out, work


def finite(name: str, states: Array, h: float | None) -> Array:
    if not np.all(np.isfinite(states)):
        raise StepError(name, "the state left the range of floating-point numbers", h=h)
    return states
