"""The time loop of every compiled method.

A compiled method is a Numba function on a tuple of numbers, `step(s, c, counters) -> s`. A second one may restore invariants:
`restore(s, c) -> s` is called before every `block` steps, also before the first of a call. `c` is the method's array of
constants, and `counters` counts (see below). The state lives in registers; nothing is allocated. `lanes` has the loop of many
tops, and `methods.dop853` the loop of kernels that choose their steps.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import as_state, check_grid
from lagrange_bench.integrators.compiling.compiled import NumbaError, is_compiled, jit, useful_lines
from lagrange_bench.integrators.compiling.intrinsics import column, put_column
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work

# places in `counters`. A kernel that fails puts a code into FAILURE and its last residual into RESIDUAL. From MEMORY on are
# SIZE - MEMORY numbers, zero at the start of a call, which a kernel may carry from step to step (compensation).
# A `timed` kernel reads the number of its step from CLOCK, and computes the time from it, so that no rounding adds up
ITERATIONS, RHS_EVALS, FAILURE, FAILED_AT, RESIDUAL, CLOCK, MEMORY = range(7)
SIZE = 32

NEVER = 1 << 62  # a block that is longer than any run
INTERRUPTIBLE = 1 << 20  # most steps in one compiled call; Ctrl-C takes effect between two calls


@jit
def finite(numbers: Any) -> Any:
    """Whether an array has neither infinities nor nans. For few numbers it takes a fifth of NumPy's time."""
    good = True
    for number in numbers:
        good = good and np.isfinite(number)
    return good


@cache
def compile_loop(
    step: Callable[..., Any], restore: Callable[..., Any] | None, size: int = 6, timed: bool = False
) -> Callable[..., Any]:
    """The loop around one kernel of `size` numbers. It returns False if a step fails or the last state is not finite."""

    @jit
    def run(y: Array, first: int, last: int, every: int, block: int, c: Array, counters: Array, out: Array) -> bool:
        # From step number `first` to `last`. Rows are recorded and invariants restored at multiples of `every` and `block`,
        # counted from the start of the whole run. So the states do not depend on how a run is divided or recorded.
        s = column(y, 0, size, 1)
        i = first
        row = i // every
        next_row = (row + 1) * every
        next_restore = (i + block - 1) // block * block
        while i < last:
            if i == next_restore:
                next_restore += block
                if restore is not None:
                    s = restore(s, c)
            stop = min(last, next_row, next_restore)
            for k in range(i, stop):
                if timed:
                    counters[CLOCK] = k
                s = step(s, c, counters)
                if counters[FAILURE] != 0:
                    counters[FAILED_AT] = k
                    return False
            i = stop
            if i == next_row:
                row += 1
                next_row += every
                put_column(out, row * size, s, 1)
        put_column(y, 0, s, 1)
        return finite(y)

    return run


@cache
def compiled_loop(
    step: Callable[..., Any], restore: Callable[..., Any] | None, dtype: np.dtype, size: int, timed: bool
) -> Callable[..., Any]:
    """`compile_loop`, compiled for numbers of this type. ValueError if it cannot be compiled."""
    for kernel in (step, restore):
        if kernel is not None and not is_compiled(kernel):
            name = getattr(kernel, "__name__", repr(kernel))
            raise ValueError(f"the kernel {name} is not compiled: put @compiled above it")
    run = compile_loop(step, restore, size, timed)
    state = np.zeros(size, dtype)
    try:
        run(state, 0, 0, 1, 1, np.zeros(1, dtype), np.zeros(SIZE), np.empty((1, size), dtype))
    except NumbaError as error:  # its message has many thousand characters
        returned = re.search(r"\w+ x (\d+)\) for 's", str(error))
        if returned and int(returned[1]) != size:
            raise KernelError(f"the kernel {step.__name__} returns {returned[1]} numbers, {size} are needed") from error
        advice = f" (`lagrange-bench check {step.__module__}:METHOD` looks for the line)"
        raise KernelError(f"the kernel {step.__name__} cannot be compiled: {useful_lines(error)}", advice) from error
    return run


class KernelError(ValueError):
    """A kernel cannot be compiled. `reason` is a short text, and the cause Numba's error."""

    def __init__(self, reason: str, advice: str = "") -> None:
        super().__init__(reason + advice)
        self.reason = reason


@dataclass(frozen=True)
class Kernel:
    """One step of a compiled method, and what its loop must know.

    Parameters
    ----------
    step : callable
        Compiled, step(s, c, counters) → s, with s a tuple of numbers and c the constants.
    restore : callable, optional
        Compiled, restore(s, c) → s: moves a state back onto the invariants. Called before every `block` steps.
    block : int
        Steps between two calls of `restore`.
    failures : dict
        The reasons for the kernel's failure codes.
    rhs_per_step : int
        How many right-hand sides a step evaluates.
    timed : bool
        Whether the kernel reads the number of its step from counters[CLOCK]. Then a run must not be continued from a later state.
    memory : int
        How many numbers the kernel carries from step to step.
    """

    step: Callable[..., Any]
    restore: Callable[..., Any] | None = None
    block: int = NEVER
    failures: Mapping[int, str] = field(default_factory=dict)
    rhs_per_step: int = 0
    timed: bool = False
    memory: int = SIZE - MEMORY


class StateUnits:
    """The units of a kernel: powers of two times the user's, so that nothing is rounded. These are the user's own."""

    def enter(self, y: Array) -> Array:
        """A state in the kernel's units, as a fresh array."""
        return np.array(y)

    def leave(self, rows: Array) -> Array:
        """The kernel's rows in the user's units; may change `rows` in place."""
        return rows


OWN_UNITS = StateUnits()


class FixedStepper(Stepper):
    """A `Stepper` around a compiled kernel: one internal step per h.

    Parameters
    ----------
    name : str
        The name of the method, for messages.
    h : float
        The step, in the units of the top.
    kernel : Kernel or callable
        The kernel; a compiled step alone stands for Kernel(step).
    constants : (m,)
        Floats, the `c` of the kernel.
    units : StateUnits
        Its methods `enter` and `leave` change a state into the kernel's units and back.
    size : int
        The number of components of a state.

    Raises
    ------
    ValueError
        The constants are not floats, or a kernel cannot be compiled.
    StepError
        Raised by `advance` and `record`.
    """

    def __init__(
        self,
        name: str,
        h: float,
        kernel: Kernel | Callable[..., Any],
        constants: Array,
        units: StateUnits = OWN_UNITS,
        size: int = 6,
    ):
        if not isinstance(constants, np.ndarray) or constants.dtype.kind not in "fc":
            raise ValueError(f"constants must be an array of floats, np.array((…), dtype=float); got {constants!r}")
        self.kernel = kernel = kernel if isinstance(kernel, Kernel) else Kernel(kernel)
        self.name, self.h, self.constants, self.units, self.size = name, h, constants, units, size
        if kernel.timed:  # else the class decides
            self.from_start = True
        self._run = compiled_loop(kernel.step, kernel.restore, constants.dtype, size, kernel.timed)
        self.work, self.counters = Work(), np.zeros(max(SIZE, MEMORY + kernel.memory))

    # methods and no attributes: only the garbage collector frees a stepper that holds its own methods, which costs as much as a
    # short run
    def enter(self, y: Array) -> Array:
        """A state in the kernel's units, as a fresh array."""
        return self.units.enter(y)

    def leave(self, rows: Array) -> Array:
        """The kernel's rows in the user's units; may change `rows` in place."""
        return self.units.leave(rows)

    def record(self, y: Array, n: int, every: int) -> Array:
        check_grid(n, every)
        y = as_state(y, self.size)
        state = self.enter(y)
        out = np.empty((n // every + 1, self.size), dtype=state.dtype)
        out[0] = state
        self.counters = counters = np.zeros(len(self.counters))  # of the last call, for a method that reads its MEMORY
        for first in range(0, n, INTERRUPTIBLE):
            last, before = min(first + INTERRUPTIBLE, n), (state.copy(), counters.copy())
            if not self._run(state, first, last, every, self.kernel.block, self.constants, counters, out):
                raise self._failure(first, last, *before)
        self.work.steps += n
        self.work.iterations += int(counters[ITERATIONS])
        self.work.rhs_evals += int(counters[RHS_EVALS]) + n * self.kernel.rhs_per_step
        result = self.rows(out, every)
        result[0] = y
        if not finite(result.ravel()):  # a change of units may overflow
            raise StepError(self.name, "the state left the range of floating-point numbers", h=self.h)
        return result

    def rows(self, out: Array, every: int) -> Array:
        """The kernel's states after 0, every, 2 every, … steps in the user's units; may change `out` in place.

        The first row need not be changed, since the caller puts the user's own state there.
        """
        return self.leave(out)

    def _failure(self, first: int, last: int, y: Array, counters: Array) -> StepError:
        """Why the steps from `first` to `last` fail, from this state and counters, and at which step, found by bisection."""
        reason, out = "the state left the range of floating-point numbers", np.empty((2, self.size), y.dtype)
        while first < last:
            middle = (first + last) // 2 if last - first > 1 else last
            state, counted = y.copy(), counters.copy()
            if self._run(state, first, middle, middle, self.kernel.block, self.constants, counted, out):
                y, counters, first = state, counted, middle
                continue
            if code := int(counted[FAILURE]):
                reason = self.kernel.failures.get(code, f"failure code {code}")
                reason += f" (residual {counted[RESIDUAL]:.1e})" if counted[RESIDUAL] else ""
                return StepError(self.name, reason, h=self.h, step=int(counted[FAILED_AT]))
            if middle == last:
                break
            last = middle
        return StepError(self.name, reason, h=self.h, step=last)


@cache
def compile_map(step: Callable[..., Any], size: int = 6) -> Callable[..., Any]:
    """(rows, every, c, counters): one step of each row, in place. CLOCK grows by `every` from row to row."""

    @jit
    def run(rows: Array, every: int, c: Array, counters: Array) -> None:
        for i in range(len(rows)):
            put_column(rows, i * size, step(column(rows, i * size, size, 1), c, counters), 1)
            counters[CLOCK] += every

    return run


class ConjugateStepper(FixedStepper):
    """A stepper whose method is conjugate to its kernel: states enter and leave the kernel through a compiled map.

    `conversion` is a step like that of the kernel. It maps a state into the kernel with the constants `preprocess`, and out of it
    with `postprocess`. The other arguments are those of `FixedStepper`.
    """

    def __init__(
        self,
        name: str,
        h: float,
        kernel: Kernel,
        constants: Array,
        *,
        conversion: Callable[..., Any],
        preprocess: Array,
        postprocess: Array,
    ) -> None:
        self._run_map, self._preprocess, self._postprocess = compile_map(conversion), preprocess, postprocess
        super().__init__(name, h, kernel, constants)
        self._map(np.empty((0, self.size)), 0, preprocess)  # compile

    def enter(self, y: Array) -> Array:
        return self._map(np.array(y)[None], 0, self._preprocess)[0]

    def rows(self, out: Array, every: int) -> Array:
        self._map(out[1:], every, self._postprocess)
        return out

    def _map(self, rows: Array, every: int, constants: Array) -> Array:
        """The rows, mapped in place. They belong to the steps every, 2 every, …"""
        counters = np.zeros(SIZE)
        counters[CLOCK] = every
        self._run_map(rows, every, constants, counters)
        if counters[FAILURE] or not finite(rows.ravel()):
            off_range = "the state left the range of floating-point numbers"
            raise StepError(self.name, self.kernel.failures.get(int(counters[FAILURE]), off_range), h=self.h)
        return rows
