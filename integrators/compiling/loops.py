"""The time loop of every compiled method.

A compiled method is a pair of Numba functions on six scalars: `step(s, c, tally) -> s` and, where a method
pins its state, `pin(s, c) -> s`, called before every `block` steps, the first of a call included: what a call returns
has been stepped since it was pinned. `c` is the
method's array of constants, `tally` counts (see below). State lives in registers; nothing is allocated.
"""

from __future__ import annotations

import dis
import threading
from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import TypingError
from numpy.typing import NDArray

from integrators.checks import check_count
from integrators.compiling.compiled import inlined_copy, jit_over
from integrators.compiling.numba_internals import column, put_column, strided
from integrators.interface import Array, StepError, Work

# places in `tally`; a kernel that fails puts a code into FAILURE and what it could not reduce into RESIDUAL; from MEMORY on
# there are SIZE - MEMORY numbers, zero at the start of a call, for what a kernel carries from step to step (compensation)
ITERATIONS, RHS_EVALS, FAILURE, FAILED_AT, RESIDUAL, MEMORY = range(6)
SIZE = 32

NEVER = 1 << 62  # a block no run reaches the end of
INTERRUPTIBLE = 1 << 20  # steps in one compiled call, at most: Ctrl-C is seen between two of them


@cache
def compile_loop(step: Callable, pin: Callable | None) -> Callable:
    """The loop around one kernel."""

    @jit_over(step, pin)
    def run(y, first, last, every, block, c, tally, out):
        # From step number `first` to `last`. Rows and pins fall on multiples of `every` and of `block`,
        # counted from the start of the whole run: however it is divided, and whatever is recorded, it goes
        # through the same states.
        s = (y[0], y[1], y[2], y[3], y[4], y[5])
        i = first
        row = i // every
        next_row = (row + 1) * every
        next_pin = (i + block - 1) // block * block
        while i < last:
            if i == next_pin:
                next_pin += block
                if pin is not None:
                    s = pin(s, c)
            stop = min(last, next_row, next_pin)
            for k in range(i, stop):
                s = step(s, c, tally)
                if tally[FAILURE] != 0:
                    tally[FAILED_AT] = k
                    return
            i = stop
            if i == next_row:
                row += 1
                next_row += every
                out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4], out[row, 5] = s
        y[0], y[1], y[2], y[3], y[4], y[5] = s

    return run


@cache
def compiled_loop(step: Callable, pin: Callable | None, dtype: np.dtype) -> Callable:
    """`compile_loop`, compiled for numbers of that type."""
    run = compile_loop(step, pin)
    state = np.zeros(6, dtype)
    run(state, 0, 0, 1, 1, np.zeros(1, dtype), np.zeros(SIZE), np.empty((1, 6), dtype))
    return run


class FixedStepper:
    """A `Stepper` around a compiled kernel: one internal step per h.

    `enter` and `leave` turn a state into the kernel's own units and back (exactly, or not at all);
    `failures` maps the kernel's failure codes to reasons. `lane` is a kernel for many tops at once and the number of constants
    it takes: all of them, or those of one of the equal parts that a step consists of. It has the bits of `step`, or sets
    FAILURE. By default it is `step` itself if that has no loop, else None.
    """

    def __init__(
        self,
        name: str,
        h: float,
        constants: Array,
        step: Callable,
        pin: Callable | None = None,
        block: int = NEVER,
        *,
        enter: Callable[[Array], Array] = np.array,
        leave: Callable[[Array], Array] = np.asarray,
        rhs_per_step: int = 0,
        failures: dict[int, str] | None = None,
        lane: tuple[Callable, int] | None = None,
    ):
        self.name, self.h, self.constants, self.block = name, h, constants, block
        self.enter, self.leave = enter, leave
        self.rhs_per_step, self.failures = rhs_per_step, failures or {}
        if lane is None and constants.dtype == np.float64 and straight(step) and straight(pin):
            lane = step, len(constants)
        self.pin, self.lane = pin, lane
        self._run = compiled_loop(step, pin, constants.dtype)
        self.work = Work()

    def advance(self, y: Array, n: int) -> Array:
        return self.record(y, n, max(n, 1))[-1]

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        state = self.enter(y)
        out = np.empty((n // every + 1, 6), dtype=state.dtype)
        out[0] = state
        tally = np.zeros(SIZE)
        for first in range(0, n, INTERRUPTIBLE):
            last = min(first + INTERRUPTIBLE, n)
            self._run(state, first, last, every, self.block, self.constants, tally, out)
            self._check(state, last, tally)
        self.work.steps += n
        self.work.iterations += int(tally[ITERATIONS])
        self.work.rhs_evals += int(tally[RHS_EVALS]) + n * self.rhs_per_step
        result = self.rows(out, every)
        result[0] = y
        if self.leave is not np.asarray and not np.isfinite(result).all():  # a change of units may overflow
            raise StepError(self.name, "the state left the range of floating-point numbers", h=self.h)
        return result

    def rows(self, out: Array, every: int) -> Array:
        """The kernel's states after 0, every, 2 every, … steps as those of the user, (rows, 6); may work in `out`."""
        return self.leave(out)

    def _check(self, state: Array, last: int, tally: Array) -> None:
        if code := int(tally[FAILURE]):
            reason = self.failures.get(code, f"failure code {code}")
            if tally[RESIDUAL]:
                reason += f" (residual {tally[RESIDUAL]:.1e})"
            raise StepError(self.name, reason, h=self.h, step=int(tally[FAILED_AT]))
        if not np.all(np.isfinite(state)):
            reason = "the state left the range of floating-point numbers in this step or before it"
            raise StepError(self.name, reason, h=self.h, step=last)


def check_grid(n: int, every: int) -> None:
    """ValueError unless n steps can be recorded every `every` of them."""
    check_count(n, "n")
    if n % check_count(every, "every", least=1):
        raise ValueError(f"every = {every} does not divide n = {n}")


# ------------------------------------------------------------------------------------ many tops at once

compiling = threading.Lock()
LANES = 32  # tops that take a step together: some SIMD registers full, so that none waits for a result of its own


@cache
def straight(kernel: Any) -> bool:
    """Whether a kernel has no loop, nor what it calls: no jump backwards in their bytecode. Only then are its lanes SIMD code."""
    function = getattr(kernel, "py_func", kernel)
    if not isinstance(function, FunctionType):
        return True  # no kernel, a number, an intrinsic
    code = function.__code__
    if any(i.opcode in JUMPS and i.argval <= i.offset for i in dis.get_instructions(code)):
        return False
    names = [function.__globals__.get(name) for name in code.co_names]
    names += [cell.cell_contents for cell in function.__closure__ or ()]
    names += [getattr(owner, name, None) for owner in names if isinstance(owner, ModuleType) for name in code.co_names]
    return all(straight(f) for f in names if isinstance(f, FunctionType) or hasattr(f, "py_func"))


JUMPS = frozenset(dis.hasjrel + dis.hasjabs)


@cache
def compile_lanes(step: Callable, pin: Callable | None, size: int, lanes: int) -> Callable:
    """The loop around one kernel for `lanes` tops at a time, each with constants of its own, `size` for each call of it.

    If the kernel is free of loops, the loop over the lanes is SIMD code. No bit of a top depends on its lane or on its
    neighbours, and all bits are those of `compile_loop`.
    """
    step = inlined_copy(step)

    @jit_over(step, pin)
    def run(columns, first, last, every, block, parts, tops, units, out):
        # `columns` holds blocks of columns of `lanes` numbers: states, tallies, and the constants of the `parts` of a step. They
        # are those of the `tops` of `out`, −1 for a lane that is not used; a row of `out` is a state times `units`, the
        # first after `every` steps. A lane that fails goes on: what becomes of it is of no use.
        for b in range(len(tops) // lanes):
            origin = b * (6 + SIZE + parts * size) * lanes
            constants = origin + (6 + SIZE) * lanes
            i = first
            row = i // every
            next_row = (row + 1) * every
            next_pin = (i + block - 1) // block * block
            while i < last:
                if i == next_pin:
                    next_pin += block
                    if pin is not None:
                        for j in range(lanes):
                            s = column(columns, origin + j, 6, lanes)
                            c = column(columns, constants + j, size, lanes)
                            put_column(columns, origin + j, pin(s, c), lanes)
                stop = min(last, next_row, next_pin)
                for _ in range(i, stop):
                    for part in range(parts):
                        place = constants + part * size * lanes
                        for j in range(lanes):
                            s = column(columns, origin + j, 6, lanes)
                            c = column(columns, place + j, size, lanes)
                            tally = strided(columns, origin + 6 * lanes + j, lanes)
                            put_column(columns, origin + j, step(s, c, tally), lanes)
                i = stop
                if i == next_row:
                    for j in range(lanes):
                        top = tops[b * lanes + j]
                        if top >= 0:
                            for k in range(6):
                                out[row, top, k] = columns[origin + k * lanes + j] * units[top, k]
                    row += 1
                    next_row += every

    return run


def run_lanes(
    kernel: tuple[Callable, Callable | None, int],
    states: Array,
    constants: Array,
    tops: NDArray[np.int64],
    units: Array,
    steps: int,
    every: int,
    out: Array,
    stopped: Callable[[], bool],
    lanes: int = LANES,
    size: int | None = None,
) -> NDArray[np.bool_]:
    """Takes the `tops` among `states` (m, 6) through `steps` steps of a kernel (step, pin, steps between two pins).

    `constants` (m, k) are those of each top, of which the kernel takes `size` at a time, all by default. Rows of `out`
    (steps // every, m, 6) are the states times `units` (m, 6) after every, 2 every, … steps. Ends early, its rows
    unfinished, once `stopped()`. Returns which of the `tops` it did not fail for.
    """
    step, pin, block = kernel
    count = -(-len(tops) // lanes)
    size = constants.shape[1] if size is None else size
    parts = constants.shape[1] // size
    places = np.resize(tops, count * lanes)  # tops over again in the lanes left over: their numbers do no harm
    rows = np.concatenate((states[places], np.zeros((len(places), SIZE)), constants[places]), axis=1)
    columns = np.ascontiguousarray(rows.reshape(count, lanes, -1).transpose(0, 2, 1)).ravel()
    places[len(tops) :] = -1
    with compiling:  # once, not in every thread
        run = compile_lanes(step, pin, size, lanes)
        try:
            run(columns, 0, 0, 1, 1, parts, places, units, out)
        except TypingError:  # a kernel of somebody else that needs its constants to be an array
            return np.zeros(len(tops), dtype=bool)
    stride = max(1, INTERRUPTIBLE * 4 // (len(places) * parts))
    for first in range(0, steps, stride):
        if stopped():
            break
        run(columns, first, min(first + stride, steps), every, block, parts, places, units, out)
    fine: NDArray[np.bool_] = columns.reshape(count, -1, lanes)[:, 6 + FAILURE].ravel()[: len(tops)] == 0.0
    return fine


# places in `walk`: where a run on natural steps is, so that it can be resumed, and what it has done
TIME, STEP, ROW, TAKEN, REJECTED, INTERPOLATED, STUCK, WALK = range(8)  # WALK: the size of it
SHRINK, GROW = 1.0 / 3.0, 6.0  # a step is at least this many times, and at most this many times, the one before


@cache
def compile_natural_loop(trial: Callable, interpolant: Callable, value: Callable) -> Callable:
    """The loop around a kernel that controls its own error.

    `trial(s, h, c) -> (new, error, growth, slopes)`: the step is taken if error ≤ 1, and the next is growth·h;
    `interpolant(s, new, h, c, slopes)` prepares what `value(interpolant, theta)` evaluates at s + theta h, 0 < theta < 1.
    """

    @jit_over(trial, interpolant, value)
    def run(y, grid, most, c, walk, out):
        # Up to `most` natural steps towards the last time of `grid`; rows of `out` where a step passes their times. Every h is
        # the difference of two times, so that times do not add up roundings.
        s = (y[0], y[1], y[2], y[3], y[4], y[5])
        t, h, row, end = walk[TIME], walk[STEP], int(walk[ROW]), grid[-1]
        fresh = True  # not the repetition of a rejected step
        while row < len(grid) and (most > 0 or not fresh):
            most -= 1
            last = abs(1.01 * h) >= abs(end - t)  # no tiny step at the end
            ahead = end if last else t + h
            h = ahead - t
            if abs(h) <= 2.0**-50 * abs(t):
                walk[STUCK] = 1.0
                break
            new, error, growth, slopes = trial(s, h, c)
            if error <= 1.0:
                if abs(grid[row]) < abs(ahead):
                    walk[INTERPOLATED] += 1.0
                    f = interpolant(s, new, h, c, slopes)
                    while abs(grid[row]) < abs(ahead):
                        at = value(f, (grid[row] - t) / h)
                        out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4], out[row, 5] = at
                        row += 1
                s, t = new, ahead
                if grid[row] == t:
                    out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4], out[row, 5] = s
                    row += 1
                walk[TAKEN] += 1.0
                h *= min(growth, GROW) if fresh else min(growth, 1.0)
                fresh = True
            else:
                walk[REJECTED] += 1.0
                h *= growth if SHRINK < growth < 1.0 else SHRINK  # the latter if the error is not a number
                fresh = False
        walk[TIME], walk[STEP], walk[ROW] = t, h, row
        y[0], y[1], y[2], y[3], y[4], y[5] = s

    return run
