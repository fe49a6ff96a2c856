"""Kernels at their first calls: interpreted, which takes milliseconds where compiling takes seconds, with the same bits.

For what is called from Python, once in a run: the set-up of a step. Machine code that an earlier process left in the cache is
used from the first call on.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
from collections.abc import Callable
from types import CellType, FunctionType, ModuleType
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.numba_internals import address_of, call_by_name, config, is_kept

OFTEN = 10  # calls of a kernel in one process, from which it is compiled; what measures times sets it to 0
MANY = 1024  # numbers in an array from which it is compiled at once
PACKAGE = __name__.rsplit(".", 2)[0] + "."
ENTRY = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.POINTER(ctypes.c_double))

_calls: dict[Any, int] = {}
_made: dict[tuple[FunctionType, Any], FunctionType] = {}
_entries: list[Any] = []  # compiled code calls them as long as the process lives


def seldom(kernel: Any, times: int = 1) -> bool:
    """Whether a kernel has no machine code, here or in the cache, and this is one of the first times·`OFTEN` questions."""
    if config.DISABLE_JIT or kernel.overloads or (kernel not in _calls and is_kept(kernel)):
        return False
    _calls[kernel] = _calls.get(kernel, 0) + 1
    return _calls[kernel] <= times * OFTEN


def at_first_interpreted(kernel: Any) -> Any:
    """A compiled function for callers in Python: its first `OFTEN` calls in a process are interpreted, then it is compiled.

    Compiled at once where an array has more than `MANY` numbers, and where Python raises an error of arithmetic: compiled code
    goes on with infinities.
    """
    if config.DISABLE_JIT:
        return kernel

    ready = False

    def call(*arguments: Any) -> Any:
        nonlocal ready
        ready = ready or not seldom(kernel)
        if not ready:
            arrays = [(k, a) for k, a in enumerate(arguments) if isinstance(a, np.ndarray)]
            if all(a.size <= MANY for _, a in arrays):
                given = list(arguments)
                for k, a in arrays:
                    given[k] = a.copy()
                try:
                    with np.errstate(all="ignore"):
                        result = interpreted(kernel)(*given)
                except (ArithmeticError, ValueError):
                    return kernel(*arguments)
                for k, a in arrays:
                    a[...] = given[k]
                return result
        return kernel(*arguments)

    return call


def outlined(function: Callable[..., Any], name: str) -> Any:
    """A function of a pointer to doubles that gives an int: kernels call it and hold no copy. For long code, seldom run.

    Numba puts a copy of all that a kernel calls into the kernel, and LLVM optimises each copy. A kernel out of the cache needs
    this function, too: call `outlined` wherever such a kernel is made. Its first calls are interpreted, a hundred times as many
    as those of a set-up; in a process that compiles it then, each further call costs a microsecond more.
    """
    if config.DISABLE_JIT:
        return function
    kernel, symbol = jit(function, no_cfunc_wrapper=False), f"{function.__module__}.{name}"
    if not seldom(kernel):
        return call_by_name(address_of(kernel), symbol)
    made: list[Any] = []

    def call(numbers: Any) -> int:
        if not made and seldom(kernel, 100):
            with contextlib.suppress(ArithmeticError, ValueError), np.errstate(all="ignore"):
                return int(interpreted(kernel)(numbers))
        if not made:
            made.append(ENTRY(address_of(kernel)))
        return int(made[0](numbers))

    _entries.append(ENTRY(call))
    return call_by_name(ctypes.cast(_entries[-1], ctypes.c_void_p).value or 0, symbol)


def interpreted(thing: Any, functions: Any = math) -> Any:
    """A kernel of this package as Python runs it, with all kernels that it calls; other things as they are.

    functions : what stands in the place of `math`, if the kernel is to run on other numbers than doubles; hashable.
    """
    thing = getattr(thing, "interpreted", thing)
    if isinstance(thing, tuple):
        return tuple(interpreted(part, functions) for part in thing)
    if thing is math:
        return functions
    if isinstance(thing, ModuleType) and thing.__name__.startswith(PACKAGE):
        return _Kernels(thing, functions)
    # what is `unrolled` is an ordinary function, and where nothing is compiled a kernel is one
    function = getattr(thing, "py_func", thing)
    if hasattr(thing, "overloads") or (functions is not math and isinstance(function, FunctionType)):
        return _function(function, functions)
    return function


def _function(function: FunctionType, functions: Any) -> FunctionType:
    key = function, functions
    if key not in _made:
        code, known, cells = function.__code__, function.__globals__, function.__closure__ or ()
        names: dict[str, Any] = {}
        closure = tuple(CellType() for _ in cells)
        _made[key] = FunctionType(code, names, function.__name__, function.__defaults__, closure)
        for own, cell in zip(closure, cells, strict=True):
            own.cell_contents = interpreted(cell.cell_contents, functions)
        names.update({name: interpreted(known[name], functions) for name in code.co_names if name in known})
    return _made[key]


class _Kernels:
    """A module whose kernels are interpreted."""

    def __init__(self, module: ModuleType, functions: Any):
        self._module, self._functions = module, functions

    def __getattr__(self, name: str) -> Any:
        value = interpreted(getattr(self._module, name), self._functions)
        setattr(self, name, value)
        return value
