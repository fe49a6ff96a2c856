"""The decorator that compiles kernels, and a cache of machine code that is never out of date.

Fused multiply-adds and fastmath are off, so every IEEE machine computes the same bits. Numba caches the code of a function under
its name. It notices a change in the file of the function, but not in the functions that it calls. So each kernel gets a name that
ends with a digest of all sources that it can call and of all that it closes over: a changed kernel has a new name. Numba puts its
cache beside the file of the function, so kernels get a file in the user's cache folder. (LAGRANGE_BENCH_CACHE names another
folder; if it is empty, there is no cache.)
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any
from weakref import WeakValueDictionary

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core.errors import NumbaError as NumbaError  # for callers who catch it
from numba.core.registry import CPUDispatcher

from lagrange_bench.support import announce
from lagrange_bench.support.files import cache_folder
from lagrange_bench.support.source_digest import IMPORTED_SOURCES, SourceDigest

config: Any = numba.config  # its attributes are made at run time
COMPILED = not config.DISABLE_JIT  # read once, since compiled and other functions do not mix
OPTIONS = {"nopython": True, "error_model": "numpy", "nogil": True, "fastmath": False, "no_cfunc_wrapper": True}

BELOW = ("compiling", "problem")  # kernels of these rooms are passed as arguments, so every digest contains them
# Numba's settings that change machine code
SETTINGS = ("BOUNDSCHECK", "CPU_FEATURES", "CPU_NAME", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function: Numba's dispatcher with a digest, which identifies it in all processes, or None."""

    digest: str | None = None

    def __reduce__(self) -> Any:
        """Pickle the digest. Numba's cache identifies a function by the pickles of all that it closes over."""
        return super().__reduce__() if self.digest is None else (identified, (self.digest,))

    def compile(self, signature: Any) -> Any:
        """As Numba's, but without an error if the machine code cannot be saved."""
        with announce.long_work("compiling" if self.digest is None else "compiling, once on this machine"):
            try:
                return super().compile(signature)
            except OSError:  # it was compiled before Numba tried to save it
                return super().compile(signature)

    def cache_in(self, folder: Path) -> None:
        """Let Numba save the machine code in a folder, as if the file of the function were there."""
        function = self.py_func
        self.py_func = _renamed(function, function.__qualname__, str(folder / "kernels.py"))
        self.enable_caching()
        self.py_func = function


IDENTIFIED: WeakValueDictionary[str | None, Any] = WeakValueDictionary()


def identified(digest: str | None) -> Any:
    """The kernel or unrolled function with this digest."""
    return IDENTIFIED[digest]


def jit(function: Callable[..., Any] | None = None, *, inline: bool = False) -> Any:
    """Compile a function of this package, and save its machine code for later processes. Returns a `Kernel`.

    With NUMBA_DISABLE_JIT=1 in the environment it stays a Python function, and computes the same bits. A function that closes
    over kernels of other packages is compiled in every process, because it is not known what they call.

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
    function = original
    kernel = compiled(_renamed(function, f"{function.__name__}_{digest}"), **options)
    kernel.digest, IDENTIFIED[digest] = digest, kernel
    folder = _folder(function.__module__)
    if folder is not None:
        kernel.cache_in(folder)
    return kernel


def compiled(function: Callable[..., Any], **more: Any) -> Any:
    """Compile a kernel of your own method with Numba, without fastmath. Every process compiles it again.

    Numba raises its errors at the first call.

    Parameters
    ----------
    function : callable
        A function that Numba can compile.
    **more : dict
        Options of `numba.njit`.

    Returns
    -------
    callable
        The compiled function.
    """
    return Kernel(function, targetoptions={**OPTIONS, **more}) if COMPILED else function


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether compiled code can call a kernel; always true without compilation."""
    return not COMPILED or hasattr(function, "py_func")


def is_cached(kernel: Kernel) -> bool:
    """Whether the cache has machine code of a kernel, for any types."""
    folder = kernel.stats.cache_path
    version = f".py{sys.version_info[0]}{sys.version_info[1]}"
    return folder is not None and any(Path(folder).glob(f"*.{kernel.py_func.__qualname__}-*{version}*.nbc"))


def _renamed(function: Any, name: str, file: str | None = None) -> FunctionType:
    """A copy of a function with another name and another file."""
    code = function.__code__ if file is None else function.__code__.replace(co_filename=file)
    copy = FunctionType(code, function.__globals__, function.__name__, function.__defaults__, function.__closure__)
    update_wrapper(copy, function)
    copy.__qualname__ = name
    return copy


# ---------------------------------------------------------------- digests


def digest_of(value: Any, *more: Any) -> str | None:
    """A text that identifies a function, or a value that it closes over, in all processes; None if there is none."""
    if isinstance(value, FunctionType):
        sources = _sources(value.__module__)
        cells = [sources, *map(digest_of, _closed_over(value))]
        return (
            None
            if None in cells
            else _hash(value.__module__, value.__qualname__, value.__code__.co_code, *cells, *more)
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


def _sources(module: str) -> str | None:
    """A digest of all sources that the functions of a module can call, of `SETTINGS` and the processor; None if unknown."""
    if module not in IMPORTED_SOURCES.known:
        settings = [f"{name}={getattr(config, name)}" for name in SETTINGS]
        machine = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
        try:
            if module not in sys.modules:  # Numba could not load the code again
                raise ImportError(module)
            code = IMPORTED_SOURCES.code({module, *_below()}, numba.__version__, *settings, *machine)
            IMPORTED_SOURCES.known[module] = SourceDigest(None) if IMPORTED_SOURCES.edited(code) else code
        except (ImportError, OSError):  # a module without a file
            IMPORTED_SOURCES.known[module] = SourceDigest(None)
    return IMPORTED_SOURCES.known[module].digest


@cache
def _below() -> frozenset[str]:
    package, here = __name__.rsplit(".", 2)[0], Path(__file__).parents[1]
    return frozenset(f"{package}.{room}.{file.stem}" for room in BELOW for file in (here / room).glob("[!_]*.py"))


def _folder(module: str) -> Path | None:
    """The folder for the machine code of a module's functions, with a file for Numba; None if there is no cache."""
    home, digest = cache_folder(), _sources(module)
    if home is None or digest is None:
        return None
    folder = home / digest
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            (folder / "kernels.py").touch(exist_ok=False)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


# ---------------------------------------------------------------- Numba's errors


def useful_lines(error: Any) -> str:
    """An error of Numba in one line: its reason, and the innermost place outside this folder."""
    words = []
    for line in str(error).splitlines():
        if line.startswith(("During:", "There are", 'File "')):
            break
        if line.strip() and not line.startswith("Failed in"):
            words.append(line.strip())
    places = re.findall(r'^(?:During: .* at|File) "?(.+?)"?,? (?:\(|line )(\d+)[):]$', str(error), re.MULTILINE)
    here = os.path.dirname(__file__)
    where = [f" ({file}:{line})" for file, line in places if os.path.dirname(os.path.abspath(file)) != here]
    return f"{' '.join(words)[:300]}{''.join(where[:1])}"
