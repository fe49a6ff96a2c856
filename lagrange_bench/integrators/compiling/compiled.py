"""The decorator that compiles kernels.

Fused multiply-adds and fastmath are off, so every IEEE machine computes the same bits. With NUMBA_DISABLE_JIT=1 in the
environment, or without Numba, kernels stay Python functions, with the same bits. `machine_code` saves what was compiled.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from collections.abc import Callable, Iterator
from functools import partial, update_wrapper
from types import FunctionType
from typing import Any

import numpy as np

try:
    import numba
    from numba.core.errors import NumbaError as NumbaError  # for callers who catch it

    COMPILED = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
except ImportError:
    COMPILED, NumbaError = False, RuntimeError  # type: ignore[misc, assignment]
if COMPILED:  # read once, since compiled and other functions do not mix
    from lagrange_bench.integrators.compiling.machine_code import IDENTIFIED, CompiledFunction

Compiled = Callable[..., Any]  # what `jit` and `unrolled` return
OPTIONS = {"nopython": True, "error_model": "numpy", "nogil": True, "fastmath": False, "no_cfunc_wrapper": True}
ROOM = __name__.rsplit(".", 2)[0] + "."  # only of functions in `integrators` is it known what they can call


def jit(function: Callable[..., Any] | None = None, *, inline: bool = False) -> Any:
    """Compile a function of this package, and save its machine code for later processes.

    Returns a `machine_code.CompiledFunction`.

    A function that closes over kernels of other packages is compiled in every process, because it is not known what they call.

    function : a function that Numba can compile, or a kernel, which is compiled again. It may close over kernels, unrolled
    functions, numbers, arrays, and tuples of them. inline : whether to inline its code at every call. Use it for short kernels,
    whose call costs as much as their work, and for kernels in loops that should become SIMD code.
    """
    if function is None:
        return partial(jit, inline=inline)
    if not COMPILED:
        return function
    options = {"forceinline": True} if inline else {}
    original = getattr(function, "py_func", function)
    foreign = original is not function and getattr(function, "digest", None) is None
    digest = None if foreign else digest_of(original, inline)
    if digest is None:
        return compiled(original, **options)
    kernel = compiled(_renamed(original, f"{original.__name__}_{digest}"), **options)
    kernel.digest, IDENTIFIED[digest] = digest, kernel
    return kernel


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a kernel of your own method with Numba, without fastmath. Every process compiles it again.

    Numba raises its errors at the first call.

    Parameters
    ----------
    function : callable
        A function that Numba can compile.
    **options : dict
        Options of `numba.njit`.

    Returns
    -------
    callable
        The compiled function.
    """
    return CompiledFunction(function, targetoptions={**OPTIONS, **options}) if COMPILED else function


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether compiled code can call a kernel; always true without compilation."""
    return not COMPILED or hasattr(function, "py_func")


def _renamed(function: Any, name: str) -> FunctionType:
    """A copy of a function with another qualified name, by which Numba saves its machine code."""
    defaults, closure = function.__defaults__, function.__closure__
    copy = FunctionType(function.__code__, function.__globals__, function.__name__, defaults, closure)
    update_wrapper(copy, function)
    copy.__qualname__ = name
    return copy


def digest_of(value: Any, *settings: Any) -> str | None:
    """A text that identifies a function, or a value that it closes over, in all processes with the same `integrators`.

    None if there is none. Numba tells functions of one name apart by counting them, and two processes count otherwise.
    """
    if isinstance(value, FunctionType):
        if not value.__module__.startswith(ROOM):
            return None
        cells = [*map(digest_of, _closed_over(value))]
        return (
            None
            if None in cells
            else _hash(value.__module__, value.__qualname__, value.__code__.co_code, *cells, *settings)
        )
    if isinstance(value, tuple):
        parts = list(map(digest_of, value))
        return None if None in parts else _hash(*parts)
    if isinstance(value, np.ndarray):
        return _hash(value.dtype, value.shape, value.tobytes())
    if value is None or isinstance(value, (bool, int, float, str)):
        return repr(value)
    return getattr(value, "digest", None)


def _closed_over(function: FunctionType) -> Iterator[Any]:
    yield from function.__defaults__ or ()
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):
            yield cell.cell_contents
            continue
        yield object()  # a cell that is filled later has no digest


def _hash(*parts: Any) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def useful_lines(error: Any) -> str:
    """An error of Numba in one line: its reason, and the innermost place outside this folder."""
    words = []
    for line in str(error).splitlines():
        if line.startswith(("During:", "There are", 'File "')):
            break
        if line.strip() and not line.startswith("Failed in"):
            words.append(line.strip())
    places = re.findall(r'^(?:During: .* at|File) "?(.+?)"?,? (?:\(|line )(\d+)[):]$', str(error), re.MULTILINE)
    this_folder = os.path.dirname(__file__)
    where = [f" ({file}:{line})" for file, line in places if os.path.dirname(os.path.abspath(file)) != this_folder]
    return f"{' '.join(words)[:300]}{''.join(where[:1])}"
