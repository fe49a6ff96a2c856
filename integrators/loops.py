"""The only time loops of the project.

A compiled method is a pair of Numba functions on six scalars: `step(s, c, tally) -> s` and, where a method
pins its state, `finish(s, c) -> s`, called after every `block` steps and at the end of a call. `c` is the
method's array of constants, `tally` counts (see below). State lives in registers; nothing is allocated.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from integrators.compiled import compiled
from integrators.interface import Array, StepError, Work

# places in `tally`
ITERATIONS, RHS_EVALS, FAILURE, FAILED_AT = range(4)

INTERRUPTIBLE = 1 << 22  # steps in one compiled call, at most: Ctrl-C is seen between two of them


@cache
def compile_loops(step: Callable, finish: Callable | None, block: int) -> tuple[Callable, Callable]:
    """Compiled (advance, record) for one kernel; each kernel is compiled once per process."""

    @compiled
    def advance(y, n, c, tally):
        s = (y[0], y[1], y[2], y[3], y[4], y[5])
        done = 0
        while done < n:
            chunk = min(block, n - done)
            for i in range(chunk):
                s = step(s, c, tally)
                if tally[FAILURE] != 0:
                    tally[FAILED_AT] += done + i
                    return
            done += chunk
            if finish is not None:
                s = finish(s, c)
        y[0], y[1], y[2], y[3], y[4], y[5] = s

    @compiled
    def record(y, every, c, tally, out):
        # Pins fall on multiples of `block` counted from the start of the call, whatever `every` is, so a
        # recorded run and an unrecorded one go through the same states.
        s = (y[0], y[1], y[2], y[3], y[4], y[5])
        until_pin = block
        for row in range(out.shape[0]):
            for i in range(every):
                s = step(s, c, tally)
                if tally[FAILURE] != 0:
                    tally[FAILED_AT] += row * every + i
                    return
                if finish is not None:
                    until_pin -= 1
                    if until_pin == 0:
                        s = finish(s, c)
                        until_pin = block
            for k in range(6):
                out[row, k] = s[k]
        if finish is not None and until_pin != block:
            s = finish(s, c)
            for k in range(6):
                out[out.shape[0] - 1, k] = s[k]
        y[0], y[1], y[2], y[3], y[4], y[5] = s

    return advance, record


class FixedStepper:
    """A `Stepper` around a compiled kernel: one internal step per h.

    `enter` and `leave` turn a state into the kernel's own units and back (exactly, or not at all);
    `failures` maps the kernel's failure codes to reasons.
    """

    def __init__(
        self,
        name: str,
        h: float,
        constants: Array,
        step: Callable,
        finish: Callable | None = None,
        block: int = 1 << 16,
        *,
        enter: Callable[[Array], Array] = np.array,
        leave: Callable[[Array], Array] = np.array,
        rhs_per_step: int = 0,
        failures: dict[int, str] | None = None,
    ):
        self.name, self.h, self.constants, self.block = name, h, constants, block
        self.enter, self.leave = enter, leave
        self.rhs_per_step, self.failures = rhs_per_step, failures or {}
        self._advance, self._record = compile_loops(step, finish, block)
        self.work = Work()

    def advance(self, y: Array, n: int) -> Array:
        state = self.enter(y)
        tally = np.zeros(4, dtype=np.int64)
        stride = max(1, INTERRUPTIBLE // self.block) * self.block
        for done in range(0, n, stride):
            tally[FAILED_AT] = done
            self._advance(state, min(stride, n - done), self.constants, tally)
            self._check(tally)
        return self._leave(state, n, tally)

    def record(self, y: Array, n: int, every: int) -> Array:
        state = self.enter(y)
        tally = np.zeros(4, dtype=np.int64)
        out = np.empty((n // every + 1, 6), dtype=state.dtype)
        out[0] = state
        # a stride of whole rows and whole blocks keeps the pins where one undivided call would put them
        rows = max(1, INTERRUPTIBLE // (every * self.block)) * self.block
        for row in range(1, len(out), rows):
            tally[FAILED_AT] = (row - 1) * every
            self._record(state, every, self.constants, tally, out[row : row + rows])
            self._check(tally)
        result = self._leave(out, n, tally)
        result[0] = y
        return result

    def _check(self, tally: Array) -> None:
        if code := int(tally[FAILURE]):
            reason = self.failures.get(code, f"failure code {code}")
            raise StepError(self.name, reason, h=self.h, step=int(tally[FAILED_AT]))

    def _leave(self, state: Array, n: int, tally: Array) -> Array:
        self.work.steps += n
        self.work.iterations += int(tally[ITERATIONS])
        self.work.rhs_evals += int(tally[RHS_EVALS]) + n * self.rhs_per_step
        state = self.leave(state)
        if not np.all(np.isfinite(state)):
            raise StepError(self.name, "the state left the range of floating-point numbers", h=self.h)
        return state
