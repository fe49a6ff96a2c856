"""Digests of source files. Rows and machine code are stored under them.

A file may be edited while a process runs. So a process reads a file once, before it computes anything that depends on it, and
asks afterwards whether the file was edited: `SourceDigest.edited`.
"""

import hashlib
import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

BENCH = "lagrange_bench"
PACKAGE = Path(__file__).parents[1]
SUFFIXES = (".py", ".toml")  # of files that compute; cases are TOML
Stamp = tuple[int, int] | None  # time of the last change in ns, size; None: there is no such file


class SourceDigest(NamedTuple):
    """The content of some files, and when it was read."""

    digest: str  # 24 hexadecimal digits
    stamps: tuple[tuple[Path, Stamp], ...]

    @property
    def edited(self) -> bool:
        """Whether one of the files was edited since it was read. Then it is not known which version this process imported."""
        return any(_stamp(path) != stamp for path, stamp in self.stamps)


class Sources:
    """Source files, each as it was when it was first read."""

    def __init__(self) -> None:
        self._read: dict[Path, SourceDigest] = {}
        self.known: dict[Any, Any] = {}  # answers that callers keep for the next time

    def code(self, *places: Path) -> SourceDigest:
        """The digest of files, and of all files in folders. OSError if there is no such file."""
        for place in places:
            if place not in self._read:
                self._read[place] = _digest_of(place)
        parts = [self._read[place] for place in places]
        names = [f"{place.name} {part.digest}" for place, part in zip(places, parts, strict=True)]
        return SourceDigest(_hash(names), sum((part.stamps for part in parts), ()))


IMPORTED_SOURCES = Sources()  # of this process


def _digest_of(place: Path) -> SourceDigest:
    files = sorted(path for path in place.rglob("*") if path.suffix in SUFFIXES) if place.is_dir() else [place]
    stamps = tuple((path, _stamp(path)) for path in files)
    lines = [f"{path.relative_to(place)} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in files]
    return SourceDigest(_hash(lines), stamps)


def _hash(lines: list[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:24]


def _stamp(path: Path) -> Stamp:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def files_of(module: str) -> list[Path]:
    """The file of a module of the user's, or the folders of its package; it imports nothing.

    A file in the current folder comes first, as in `own_modules.import_own`. ImportError if there is none.
    """
    top = module.partition(".")[0]
    spec = PathFinder.find_spec(top, [str(Path.cwd()), *sys.path]) or find_spec(top)
    if spec is None or not (spec.submodule_search_locations or spec.origin):
        raise ImportError(f"no source file of {module}")
    return [Path(folder) for folder in spec.submodule_search_locations or [str(spec.origin)]]
