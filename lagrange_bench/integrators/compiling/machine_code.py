"""Kernels, compiled by Numba, and a cache of their machine code that is never out of date and never loaded damaged.

Numba saves the code of a function under its name, and notices a change in the file of the function, but not in the functions
that it calls. So the cache has one folder for each state of `integrators`, named by the digest of all files there. If a file is
edited while a process runs, this process neither saves nor loads code of the kernels that it has not compiled yet.

A power loss leaves files that are empty or cut, and Numba loads them without looking. So each kernel has a seal beside its files:
a digest of their content. If it is missing or wrong, the files are removed, and the kernel is compiled anew.

LAGRANGE_BENCH_CACHE names another folder of caches; if it is empty, there is no cache.
"""

import contextlib
import hashlib
import os
import sys
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any
from weakref import WeakValueDictionary

import llvmlite.binding as llvm
import numba
from numba.core.registry import CPUDispatcher

from lagrange_bench.support import announce
from lagrange_bench.support.files import cache_folder
from lagrange_bench.support.source_digest import IMPORTED_SOURCES, PACKAGE

SOURCES = IMPORTED_SOURCES.code(PACKAGE / "integrators")  # before a kernel is imported
HOME = cache_folder()
# Numba's settings that change machine code
SETTINGS = ("BOUNDSCHECK", "CPU_FEATURES", "CPU_NAME", "LOOP_VECTORIZE", "OPT", "SLP_VECTORIZE")

# the kernels and unrolled functions of this process by their digests
IDENTIFIED: WeakValueDictionary[str | None, Any] = WeakValueDictionary()


def identified(digest: str | None) -> Any:
    """The kernel or unrolled function with this digest."""
    return IDENTIFIED[digest]


class CompiledFunction(CPUDispatcher):
    """A compiled function: Numba's dispatcher with a digest, which identifies it in all processes, or None."""

    digest: str | None = None
    _saves: bool | None = None  # whether its machine code is saved; None: not yet decided

    def __reduce__(self) -> Any:
        """Pickle the digest. Numba's cache identifies a function by the pickles of all that it closes over."""
        return super().__reduce__() if self.digest is None else (identified, (self.digest,))

    def compile(self, signature: Any) -> Any:
        """As Numba's, but the machine code is saved and loaded under a seal; without an error if it cannot be saved."""
        self._begin_to_save()
        compiled_before = self._times_compiled()
        once = "compiling, once on this machine, about 5 s"
        with announce.long_work(once if self._saves else "compiling"):
            if self._saves:
                self._remove_damaged()
            try:
                entry = super().compile(signature)
            except OSError:  # it was compiled before Numba tried to save it
                entry = super().compile(signature)
        if self._saves and self._times_compiled() > compiled_before:
            with contextlib.suppress(OSError):
                self._seal.write_text(self._digest_of_files())
        return entry

    def _begin_to_save(self) -> None:
        """Let Numba save the machine code in the folder of caches, as if the file of the function were there, if it can be."""
        if self._saves is not None:
            return
        folder = _folder() if self.digest is not None and not SOURCES.edited else None
        self._saves = folder is not None
        if folder is not None:
            function = self.py_func
            code = function.__code__.replace(co_filename=str(folder / "kernels.py"))
            self.py_func = FunctionType(code, function.__globals__, function.__name__, None, function.__closure__)
            self.py_func.__qualname__ = function.__qualname__
            self.enable_caching()
            self.py_func = function

    def _times_compiled(self) -> int:
        return sum(self.stats.cache_misses.values())

    @property
    def _seal(self) -> Path:
        return Path(str(self.stats.cache_path)) / f"{self.digest}.sha256"

    def _files(self) -> list[Path]:
        return sorted(self._seal.parent.glob(f"*_{self.digest}-*.nb[ic]"))

    def _digest_of_files(self) -> str:
        total = hashlib.sha256()
        for path in self._files():
            content = path.read_bytes()
            total.update(f"{path.name} {len(content)} ".encode() + content)
        return total.hexdigest()

    def _remove_damaged(self) -> None:
        """Remove the files of this kernel if their seal is missing or wrong."""
        with contextlib.suppress(OSError):  # another process removes them, too
            if not self._seal.exists() or self._seal.read_text(errors="replace") != self._digest_of_files():
                for path in self._files():
                    path.unlink()


@cache
def _folder() -> Path | None:
    """The folder for machine code, with a file for Numba; None if there is no cache."""
    if HOME is None:
        return None
    settings = [f"{name}={getattr(numba.config, name)}" for name in SETTINGS]
    machine = [llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    words = [SOURCES.digest, numba.__version__, str(sys.implementation.cache_tag), *settings, *machine]
    folder = HOME / hashlib.sha256("\n".join(words).encode()).hexdigest()[:24]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            (folder / "kernels.py").touch(exist_ok=False)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None
