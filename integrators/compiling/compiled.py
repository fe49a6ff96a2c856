"""How this project compiles: one decorator, and a cache of machine code that cannot go stale.

Fused multiply-add contraction and fastmath are off: the same bits on every IEEE machine. Numba's own cache only
notices a change in the file of the function itself, not in the functions it calls. So ours lives in a folder named by a digest
of every source the function can call, in the user's cache directory (LAGRANGE_BENCH_CACHE moves it, empty switches it off).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

from lagrange_bench.integrators.compiling.numba_internals import (
    CompilerToLink,
    config,
    keep_code,
    link,
    name_of,
    set_name,
    unlink,
)
from lagrange_bench.integrators.files import cache_folder
from lagrange_bench.integrators.imported import IMPORTED, Code

njit: Any = numba.njit  # its types know fewer options than it has
OPTIONS = {"error_model": "numpy", "nogil": True, "fastmath": False, "no_cfunc_wrapper": True}
TO_LINK = {"no_cpython_wrapper": True, "pipeline_class": CompilerToLink}

BELOW = ("compiling", "problem")  # rooms whose kernels reach others as arguments: part of every digest
SETTINGS = ("BOUNDSCHECK", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")  # of Numba: they change the machine code


def _folder(module: str) -> str | None:
    """Where the machine code of a module's functions is kept: named by all sources that they can call, and by `SETTINGS`."""
    home = cache_folder()
    if home is None:
        return None
    if module not in IMPORTED.known:
        settings = [f"{name}={getattr(config, name)}" for name in SETTINGS]
        try:
            code = IMPORTED.code({module, *_below()}, numba.__version__, *settings)
            IMPORTED.known[module] = Code(None) if IMPORTED.edited(code) else code
        except (ImportError, OSError):  # a module without a file
            IMPORTED.known[module] = Code(None)
    digest = IMPORTED.known[module].digest
    if digest is None:
        return None
    folder = os.path.join(home, digest)
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@cache
def _below() -> frozenset[str]:
    package, here = __name__.rsplit(".", 2)[0], Path(__file__).parents[1]
    return frozenset(f"{package}.{room}.{file.stem}" for room in BELOW for file in (here / room).glob("[!_]*.py"))


def compiled(function: Callable[..., Any], **more: Any) -> Any:
    """Compile a function with Numba: no fastmath, and no cache on disk, so every process compiles it again.

    The kernels of plug-ins are compiled with this. Numba raises its errors at the first call.

    Parameters
    ----------
    function : callable
        What Numba can compile.
    **more : dict
        Options of `numba.njit`.

    Returns
    -------
    callable
        The compiled function.
    """
    return njit(**{**OPTIONS, **more})(function)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a kernel can be called from compiled code; where nothing is compiled, every one can."""
    return bool(config.DISABLE_JIT) or hasattr(function, "py_func")


def jit(function: Callable[..., Any], **more: Any) -> Any:
    """Compile a function of this package; its machine code is kept for the next process.

    With NUMBA_DISABLE_JIT=1 in the environment it stays a Python function, and computes the same bits.
    """
    if config.DISABLE_JIT:
        return function
    known = function.__module__ in sys.modules  # else Numba keeps code that it cannot load again
    folder = _folder(function.__module__) if known else None
    if folder is None:
        return link(compiled(function, **more), lambda: compiled(function, **more, **TO_LINK))
    options, linked = {**OPTIONS, **more, "cache": True}, os.path.join(folder, "linked")
    dispatcher = keep_code(njit(**options), function, folder)
    link(dispatcher, lambda: keep_code(njit(**options, **TO_LINK), function, linked))
    if function.__closure__ is None:
        # Numba's random name for a function is part of the key of every closure over it: one name for all processes
        set_name(dispatcher, f"{folder} {function.__module__}.{function.__qualname__}")
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """`jit`, and the code goes wherever it is called: for short kernels, where a call costs as much as the work."""
    return jit(function, forceinline=True)


def jit_as(name: str, **more: Any) -> Callable[[Callable[..., Any]], Any]:
    """The decorator `jit` for a function that a factory makes; `name` tells it from its siblings, in all processes."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = jit(function, **more)
        module = function.__module__
        return dispatcher if config.DISABLE_JIT else set_name(dispatcher, f"{_folder(module)} {module}.{name}")

    return decorate


def jit_over(*kernels: Any) -> Callable[[Callable[..., Any]], Any]:
    """The decorator for a loop that closes over `kernels`: cached if they all are this package's own.

    Of another package's functions the digest knows nothing: what closes over them is compiled in every process. The loop and
    its kernels are optimised one by one: together they take up to 1.3 times as long a step.
    """
    if config.DISABLE_JIT:
        return compiled
    kernels = tuple(unlink(kernel) for kernel in kernels if kernel is not None)
    ours = all(kernel.py_func.__module__.startswith("lagrange_bench.integrators.") for kernel in kernels)
    return (lambda function: unlink(jit(function))) if ours else compiled


def inlined_copy(kernel: Any) -> Any:
    """A compiled function once more, as `inlined` would have it: a loop around the call of a long kernel is never SIMD code.

    Not cached: what closes over it is.
    """
    if config.DISABLE_JIT:
        return kernel
    return set_name(compiled(kernel.py_func, forceinline=True), f"{name_of(kernel)} inlined")
