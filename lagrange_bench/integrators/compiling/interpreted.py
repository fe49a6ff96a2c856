"""Interprets set-up code at its first calls, in milliseconds and with the same bits; compiling it would take seconds.

It is for kernels that Python calls once in a run, to prepare a step. If an earlier process left machine code in the cache, that
is used from the first call on.
"""

from __future__ import annotations

import math
from inspect import unwrap
from time import perf_counter
from types import CellType, FunctionType, ModuleType
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import COMPILED

PATIENCE = (
    4.0  # seconds that a kernel is interpreted in a process, about what compiling takes; 0 where times are measured
)
MANY = 1024  # an array of more numbers is a reason to compile at once
PACKAGE = __name__.rsplit(".", 2)[0] + "."

_interpreted: dict[tuple[FunctionType, Any], FunctionType] = {}


def at_first_interpreted(kernel: Any) -> Any:
    """A function for callers in Python. It interprets a kernel until that has taken about as long as compiling; then it compiles.

    It compiles at once if an array has more than `MANY` numbers, or if Python raises an arithmetic error, since compiled code
    goes on with infinities.
    """
    if not COMPILED:
        return kernel
    spent, ready = 0.0, None

    def call(*arguments: Any) -> Any:
        nonlocal spent, ready
        if ready is None:
            ready = kernel.is_saved
        ready = ready or spent >= PATIENCE or bool(kernel.overloads)
        arrays = [] if ready else [(k, a) for k, a in enumerate(arguments) if isinstance(a, np.ndarray)]
        if ready or any(a.size > MANY for _, a in arrays):
            return kernel(*arguments)
        own = list(arguments)
        for k, a in arrays:
            own[k] = a.copy()
        begin = perf_counter()
        try:
            with np.errstate(all="ignore"):
                result = _plain(interpreted(kernel)(*own))
        except (ArithmeticError, ValueError):
            return kernel(*arguments)
        finally:
            spent += perf_counter() - begin
        for k, a in arrays:
            a[...] = own[k]
        return result

    return call


def _plain(result: Any) -> Any:
    """A result with Python's numbers, which compiled code returns, too."""
    if isinstance(result, tuple):
        return tuple(map(_plain, result))
    return result.item() if isinstance(result, np.generic) else result


def interpreted(thing: Any, functions: Any = math) -> Any:
    """A kernel of this package, and all kernels that it calls, as Python functions; other things unchanged.

    functions : a hashable replacement of `math`, for numbers other than doubles.
    """
    if isinstance(thing, tuple):
        return tuple(interpreted(part, functions) for part in thing)
    if thing is math:
        return functions
    if isinstance(thing, ModuleType) and thing.__name__.startswith(PACKAGE):
        return _Kernels(thing, functions)
    # unrolled functions and intrinsics have a Python function; without compilation a kernel is one
    function = unwrap(thing) if hasattr(thing, "is_saved") else getattr(thing, "py_func", thing)
    if function is not thing or (functions is not math and isinstance(function, FunctionType)):
        return _function(function, functions)
    return function


def _function(function: FunctionType, functions: Any) -> FunctionType:
    key = function, functions
    if key not in _interpreted:
        code, known, cells = function.__code__, function.__globals__, function.__closure__ or ()
        names: dict[str, Any] = {}
        closure = tuple(CellType() for _ in cells)
        _interpreted[key] = FunctionType(code, names, function.__name__, function.__defaults__, closure)
        for own, cell in zip(closure, cells, strict=True):
            own.cell_contents = interpreted(cell.cell_contents, functions)
        names.update({name: interpreted(known[name], functions) for name in code.co_names if name in known})
    return _interpreted[key]


class _Kernels:
    """A module with interpreted kernels."""

    def __init__(self, module: ModuleType, functions: Any):
        self._module, self._functions = module, functions

    def __getattr__(self, name: str) -> Any:
        value = interpreted(getattr(self._module, name), self._functions)
        setattr(self, name, value)
        return value
