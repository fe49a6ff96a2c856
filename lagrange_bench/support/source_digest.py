"""Which source code runs: the files that a module imports, and a digest of them.

Rows of an experiment and machine code are stored under such a digest. A file may be edited while a process runs. So each process
reads a file once, before what it decides about is computed, and asks afterwards whether any was written since: `Sources.edited`.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import re
import sys
import sysconfig
from collections.abc import Collection
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any, NamedTuple

BENCH = "lagrange_bench"
PUBLIC_MODULES = (BENCH, f"{BENCH}.integrators")  # `from lagrange_bench import name` means the module that has the name
# what decides about no row: which methods there are, how figures look, how cells are run, and this file
IGNORED_MODULES = re.compile(
    rf"{BENCH}(\.(integrators(\.registry)?|experiments(\.drawing(\..*)?)?|support(\.(announce|lazy|source_digest))?"
    r"|(?!integrators|experiments|support)\w+(\..*)?))?"
)
# of every method one entry: a cell depends on its own method only
NOT_FOLLOWED = ("lagrange_bench.integrators.backward_error.steps",)
IMPORT = re.compile(
    r"(?:^|[:;])[ \t]*(?:from[ \t]+(\.*[\w.]*)[ \t]+)?import\b[ \t]*(\([^)]*\)|(?:\\\n|[^\n;])*)", re.MULTILINE
)


class SourceDigest(NamedTuple):
    """Source code that computes something."""

    digest: str | None  # 24 hexadecimal digits, of the names of modules and the content of their files; None: not known
    paths: frozenset[str] = frozenset()


class Sources:
    """Source files by their path, each as it was when it was first asked for."""

    def __init__(self) -> None:
        self.content: dict[str, bytes] = {}
        self.known: dict[Any, SourceDigest] = {}  # for those who ask for the same code again
        self._stamps: dict[str, tuple[int, int] | None] = {}
        self._places: dict[str, tuple[str, bool] | None] = {}  # see `_place`
        self._targets: dict[str, set[str]] = {}  # of the imports of a module

    def read(self, path: str) -> bytes:
        if path not in self.content:
            self._stamps[path] = _stamp(path)
            self.content[path] = Path(path).read_bytes()
        return self.content[path]

    def edited(self, code: SourceDigest) -> bool:
        """Whether one of the files was written since it was read: which state of it this process imported is then not known."""
        return any(_stamp(path) != self._stamps[path] for path in code.paths if path in self._stamps)

    def code(self, modules: Collection[str], *more: str) -> SourceDigest:
        """Those modules and all that they import; its digest is of names and content, and of `more`."""
        files = self.files(modules)
        lines = [f"{name} {hashlib.sha256(self.content[path]).hexdigest()}" for name, path in sorted(files.items())]
        digest = hashlib.sha256("\n".join([*lines, *more]).encode()).hexdigest()[:24]
        return SourceDigest(digest, frozenset(files.values()))

    def files(self, modules: Collection[str]) -> dict[str, str]:
        """Modules that these import, directly or not, and their files; without Python itself and installed packages.

        Of an installed package the modules count if it is one of those asked for.

        Raises
        ------
        ImportError, OSError : one of `modules` is not there, or has no file.
        """
        packages = {name.partition(".")[0] for name in modules}
        found: dict[str, str] = {}
        waiting = {part: part in modules for name in modules for part in _parents(name)}
        while waiting:
            name, needed = waiting.popitem()
            path = self._path(name, packages)
            if path is None and needed and not IGNORED_MODULES.fullmatch(name):
                raise ImportError(f"no source file of {name}")
            if path is None or name in found or IGNORED_MODULES.fullmatch(name):
                continue
            self.read(path)
            found[name] = path
            if name not in NOT_FOLLOWED:
                waiting |= dict.fromkeys(self._imported(name, path) - set(found), False)
        return found

    def _path(self, name: str, packages: Collection[str]) -> str | None:
        """The file of a module; None if it has none, or is not to be followed."""
        if name not in self._places:
            self._places[name] = _place(name)
        path, installed = self._places[name] or (None, False)
        return path if name.partition(".")[0] in packages or not installed else None

    def _imported(self, name: str, path: str) -> set[str]:
        """Modules with a file that a file imports, installed packages among them."""
        if name not in self._targets:
            package = name if Path(path).name == "__init__.py" else name.rpartition(".")[0]
            targets = {
                self._home(*target) if target[0] in PUBLIC_MODULES else ".".join(filter(None, target))
                for target in _statements(self.content[path], package)
            }
            self._targets[name] = {
                part for whole in targets for part in _parents(whole) if self._path(part, _parents(part))
            }
        return self._targets[name]

    def _home(self, package: str, name: str) -> str:
        """The module that has a name which a public module of the bench offers; or that is the name, a module in its folder."""
        if name and self._path(f"{package}.{name}", ()):
            return f"{package}.{name}"
        path = self._path(package, ())
        offers = _statements(self.read(path), package) if path else ()
        for module, offered in offers:
            if name and offered == name and module != package:  # not an example in its docstring
                return f"{module}.{name}"
        return next((self._home(module, name) for module, offered in offers if offered == "*"), package)


IMPORTED_SOURCES = Sources()  # of this process


def _stamp(path: str) -> tuple[int, int] | None:
    try:
        status = Path(path).stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


@cache
def _statements(source: bytes, package: str) -> tuple[tuple[str, str], ...]:
    """(module, name imported from it or "") of every import statement, those in functions and docstrings too."""
    found = []
    text = re.sub("#.*", "", importlib.util.decode_source(source))
    for origin, names in IMPORT.findall(text):
        listed = [words.split()[0] for words in re.sub(r"[()\\]", " ", names).split(",") if words.split()]
        if origin:
            try:
                origin = importlib.util.resolve_name(origin, package or None)
            except ImportError:  # more dots than packages
                continue
            found += [(origin, ""), *((origin, name) for name in listed)]
        else:
            found += [(name, "") for name in listed]
    return tuple(dict.fromkeys(found))


def _parents(name: str) -> list[str]:
    """A dotted name and the packages it is in."""
    words = name.split(".")
    return [".".join(words[:count]) for count in range(1, len(words) + 1)]


# ---------------------------------------------------------------- where modules are


def _place(name: str) -> tuple[str, bool] | None:
    """The file of a module, found without running anything; and whether it is one of an installed package."""
    top = name.partition(".")[0]
    spec = None if top in sys.stdlib_module_names else _spec(name)
    if spec is None or not spec.origin or not Path(spec.origin).is_file():
        return None
    origin = Path(spec.origin)
    return spec.origin, top != BENCH and _holds_packages(origin.parents[name.count(".") + (origin.stem == "__init__")])


def _spec(name: str) -> ModuleSpec | None:
    """As importlib.util.find_spec, but no package is imported for it."""
    module, parent = sys.modules.get(name), name.rpartition(".")[0]
    if module is not None and getattr(module, "__spec__", None) is not None:
        return module.__spec__
    place = _spec(parent) if parent else None
    if parent and (place is None or place.submodule_search_locations is None):
        return None
    path = list(place.submodule_search_locations or ()) if place else None
    if path is None and name != BENCH:
        with contextlib.suppress(OSError):  # as `registry.import_own` does
            if (own := PathFinder.find_spec(name, [str(Path.cwd())])) is not None:
                return own
    finders = (finder.find_spec for finder in sys.meta_path if hasattr(finder, "find_spec"))
    return next(filter(None, (find(name, path, None) for find in finders)), None)


@cache
def _holds_packages(folder: Path) -> bool:
    """Whether packages are installed in a folder, or it is Python's own."""
    return str(folder).startswith(sysconfig.get_path("stdlib")) or any(folder.glob("*.dist-info"))
