"""How this project compiles: one decorator, and a cache of machine code that cannot go stale.

Fused multiply-add contraction and fastmath are off: the same bits on every IEEE machine. Numba's own cache only notices a
change in the file of the function itself, not in the functions it calls. So a kernel has a name of its own: it ends with a
digest of every source the kernel can call and of all that it closes over. Numba keeps the code of a function under its name, and
never finds that of another one. It keeps it beside the file of the function, which for a kernel is one in the user's cache
folder (LAGRANGE_BENCH_CACHE moves it, empty switches it off).
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
from numba.core.errors import NumbaError as NumbaError  # those who compile catch it
from numba.core.registry import CPUDispatcher

from lagrange_bench.support import announce
from lagrange_bench.support.files import cache_folder
from lagrange_bench.support.source_digest import IMPORTED_SOURCES, SourceDigest

config: Any = numba.config  # its attributes are made at run time
COMPILED = not config.DISABLE_JIT  # asked once: functions that are compiled and functions that are not do not mix
OPTIONS = {"nopython": True, "error_model": "numpy", "nogil": True, "fastmath": False, "no_cfunc_wrapper": True}

BELOW = ("compiling", "problem")  # rooms whose kernels reach others as arguments: part of every digest
# of Numba: they change machine code
SETTINGS = ("BOUNDSCHECK", "CPU_FEATURES", "CPU_NAME", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function: Numba's dispatcher with a digest, which identifies it in all processes; None: not known."""

    digest: str | None = None

    def __reduce__(self) -> Any:
        """By its digest: what closes over a kernel has a key in Numba's cache, made of the pickles of what it closes over."""
        return super().__reduce__() if self.digest is None else (identified, (self.digest,))

    def compile(self, signature: Any) -> Any:
        """As Numba's. What cannot be kept for the next process is compiled there again: no reason for this one to fail."""
        with announce.long_work("compiling" if self.digest is None else "compiling, once on this machine"):
            try:
                return super().compile(signature)
            except OSError:  # it is compiled; Numba saves it after that
                return super().compile(signature)

    def keep_in(self, folder: Path) -> None:
        """Have Numba keep the machine code there: it does so beside the file where a function stands."""
        function = self.py_func
        self.py_func = _renamed(function, function.__qualname__, str(folder / "kernels.py"))
        self.enable_caching()
        self.py_func = function


IDENTIFIED: WeakValueDictionary[str | None, Any] = WeakValueDictionary()


def identified(digest: str | None) -> Any:
    """The kernel, or the function that is `unrolled`, of this digest."""
    return IDENTIFIED[digest]


def jit(function: Callable[..., Any] | None = None, *, inline: bool = False) -> Any:
    """Compile a function of this package; its machine code is kept for the next process.

    With NUMBA_DISABLE_JIT=1 in the environment it stays a Python function, and computes the same bits. A function that closes
    over kernels of other packages is compiled in every process: of what those call nothing is known.

    Parameters
    ----------
    function : callable
        What Numba can compile, or a kernel, to be compiled once more. It may close over kernels, functions that are `unrolled`,
        numbers, arrays, and tuples of them.
    inline : bool
        Whether its code goes wherever it is called: for short kernels, where a call costs as much as the work; and for kernels in
        loops that are to be SIMD code.

    Returns
    -------
    Kernel
        The compiled function.
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
        kernel.keep_in(folder)
    return kernel


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
    return Kernel(function, targetoptions={**OPTIONS, **more}) if COMPILED else function


def is_compiled(function: Callable[..., Any]) -> bool:
    """Whether a kernel can be called from compiled code; where nothing is compiled, every one can."""
    return not COMPILED or hasattr(function, "py_func")


def is_kept(kernel: Kernel) -> bool:
    """Whether the cache has machine code of a kernel, of whatever types."""
    folder = kernel.stats.cache_path
    version = f".py{sys.version_info[0]}{sys.version_info[1]}"
    return folder is not None and any(Path(folder).glob(f"*.{kernel.py_func.__qualname__}-*{version}*.nbc"))


def _renamed(function: Any, name: str, file: str | None = None) -> FunctionType:
    """A copy of a function with another name, and another file where it stands."""
    code = function.__code__ if file is None else function.__code__.replace(co_filename=file)
    copy = FunctionType(code, function.__globals__, function.__name__, function.__defaults__, function.__closure__)
    update_wrapper(copy, function)
    copy.__qualname__ = name
    return copy


# ---------------------------------------------------------------- digests


def digest_of(value: Any, *more: Any) -> str | None:
    """What identifies a function, or a value that one closes over, in all processes; None: not known."""
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
        yield object()  # it is filled later: nothing is known of it


def _hash(*parts: Any) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def _sources(module: str) -> str | None:
    """Digest of all sources that the functions of a module can call, of `SETTINGS` and the processor; None: not known."""
    if module not in IMPORTED_SOURCES.known:
        settings = [f"{name}={getattr(config, name)}" for name in SETTINGS]
        machine = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
        try:
            if module not in sys.modules:  # Numba could not load what it keeps
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
    """Where the machine code of a module's functions is kept; None if it is not. It has a file for Numba to look at."""
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
    """Of an error of Numba, in one line: what is wrong, and the innermost place that is not in this folder."""
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
