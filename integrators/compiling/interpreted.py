"""Kernels at their first calls: interpreted, which takes milliseconds where compiling takes seconds, with the same bits.

For what is called from Python, once in a run: the set-up of a step. Machine code that an earlier process left in the cache is
used from the first call on.
"""

from __future__ import annotations

import math
from inspect import unwrap
from time import perf_counter
from types import CellType, FunctionType, ModuleType
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import COMPILED, Kernel, is_kept

PATIENCE = (
    4.0  # seconds that a kernel is interpreted in a process, about what compiling takes; 0 where times are measured
)
MANY = 1024  # numbers in an array from which it is compiled at once
PACKAGE = __name__.rsplit(".", 2)[0] + "."

_interpreted: dict[tuple[FunctionType, Any], FunctionType] = {}


def at_first_interpreted(kernel: Any) -> Any:
    """A compiled function for callers in Python: interpreted until that has taken as long as compiling would, then compiled.

    Compiled at once where an array has more than `MANY` numbers, and where Python raises an error of arithmetic: compiled code
    goes on with infinities.
    """
    if not COMPILED:
        return kernel
    spent, ready = 0.0, None

    def call(*arguments: Any) -> Any:
        nonlocal spent, ready
        if ready is None:
            ready = is_kept(kernel)
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
    """With Python's numbers, as compiled code returns them."""
    if isinstance(result, tuple):
        return tuple(map(_plain, result))
    return result.item() if isinstance(result, np.generic) else result


def interpreted(thing: Any, functions: Any = math) -> Any:
    """A kernel of this package as Python runs it, with all kernels that it calls; other things as they are.

    functions : what stands in the place of `math`, if the kernel is to run on other numbers than doubles; hashable.
    """
    if isinstance(thing, tuple):
        return tuple(interpreted(part, functions) for part in thing)
    if thing is math:
        return functions
    if isinstance(thing, ModuleType) and thing.__name__.startswith(PACKAGE):
        return _Kernels(thing, functions)
    # what is `unrolled`, and an intrinsic, has a Python function, and where nothing is compiled a kernel is one
    function = unwrap(thing) if isinstance(thing, Kernel) else getattr(thing, "py_func", thing)
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
    """A module whose kernels are interpreted."""

    def __init__(self, module: ModuleType, functions: Any):
        self._module, self._functions = module, functions

    def __getattr__(self, name: str) -> Any:
        value = interpreted(getattr(self._module, name), self._functions)
        setattr(self, name, value)
        return value
