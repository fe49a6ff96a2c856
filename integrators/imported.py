"""Which source code runs in this process: each file as it was imported, and the files that a module depends on.

A file may be edited after its import, so it says nothing about what runs. Where rows are computed, `install` therefore puts
an import hook in place. The hook reads each file of the bench and of the user once, compiles what it read, and remembers it. A
digest is made of what was read: rows of an experiment and machine code are stored under it. Byte code is used only if it names
the hash of the same source (PEP 552); Python's own check, the time of the last edit in seconds, misses a second edit within one.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import marshal
import re
import sys
import sysconfig
from collections.abc import Collection
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from typing import Any

BENCH = "lagrange_bench"
FACES = (BENCH, f"{BENCH}.integrators")  # `from FACE import name` means the module that has the name
# what decides about no row: which methods there are, how figures look, how cells are run, and this file
NO_ROW = re.compile(
    rf"{BENCH}(\.(integrators(\.(registry|lazy|imported))?|experiments(\.drawing(\..*)?)?|(?!integrators|experiments)\w+(\..*)?))?"
)
TABLES = (
    "lagrange_bench.integrators.backward_error.steps",
)  # of every method one entry: a cell depends on its own method only
IMPORT = re.compile(
    r"(?:^|[:;])[ \t]*(?:from[ \t]+(\.*[\w.]*)[ \t]+)?import\b[ \t]*(\([^)]*\)|(?:\\\n|[^\n;])*)", re.MULTILINE
)
BYTE_CODE = b"\3\0\0\0"  # flags of a .pyc that is valid for one hash of its source, and is to be checked


class Sources:
    """The content of source files by their path. Each is read once, when it is imported or first asked for."""

    def __init__(self) -> None:
        self.content: dict[str, bytes] = {}
        self.digests: dict[Any, str | None] = {}  # for those who compute them
        self._places: dict[str, tuple[str, bool] | None] = {}  # see `_place`
        self._targets: dict[str, set[str]] = {}  # of the imports of a module

    def forget(self) -> None:
        """After an import: where modules are may be known better now."""
        self.digests.clear()
        self._places.clear()
        self._targets.clear()

    def read(self, path: str) -> bytes:
        if path not in self.content:
            self.content[path] = Path(path).read_bytes()
        return self.content[path]

    def files(self, modules: Collection[str]) -> dict[str, bytes]:
        """Modules that these import, directly or not, and their files; without Python itself and installed packages.

        Of an installed package the modules count if it is one of those asked for.

        Raises
        ------
        ImportError, OSError : one of `modules` is not there, or has no file.
        """
        packages = {name.partition(".")[0] for name in modules}
        found: dict[str, bytes] = {}
        waiting = {part: part in modules for name in modules for part in _parents(name)}
        while waiting:
            name, needed = waiting.popitem()
            path = self._path(name, packages)
            if path is None and needed and not NO_ROW.fullmatch(name):
                raise ImportError(f"no source file of {name}")
            if path is None or name in found or NO_ROW.fullmatch(name):
                continue
            found[name] = self.read(path)
            if name not in TABLES:
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
                self._home(*target) if target[0] in FACES else ".".join(filter(None, target))
                for target in _statements(self.content[path], package)
            }
            self._targets[name] = {
                part for whole in targets for part in _parents(whole) if self._path(part, _parents(part))
            }
        return self._targets[name]

    def _home(self, face: str, name: str) -> str:
        """The module that has a name which a face of the bench offers."""
        path = self._path(face, ())
        for module, offered in _statements(self.read(path), face) if path else ():
            if name and offered == name:
                return f"{module}.{name}"
            if offered == "*":
                return self._home(module, name)
        return face


IMPORTED = Sources()  # as this process has imported them


def digest(files: dict[str, bytes], *more: str) -> str:
    """24 hexadecimal digits; of the names of modules and the content of their files, not of their places."""
    lines = [f"{name} {hashlib.sha256(source).hexdigest()}" for name, source in sorted(files.items())]
    return hashlib.sha256("\n".join([*lines, *more]).encode()).hexdigest()[:24]


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
    if top == BENCH:
        return _place_in_bench(name)
    spec = None if top in sys.stdlib_module_names else _spec(name)
    if spec is None or not spec.origin or not Path(spec.origin).is_file():
        return None
    return spec.origin, _installed(name, spec.origin)


@cache
def _place_in_bench(name: str) -> tuple[str, bool] | None:
    spec = _spec(name)
    return (str(spec.origin), False) if spec and spec.has_location else None


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
    return next(filter(None, (_asked(finder, name, path) for finder in sys.meta_path)), None)


def _asked(finder: Any, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
    if isinstance(finder, Hook) or not hasattr(finder, "find_spec"):
        return None
    spec: ModuleSpec | None = finder.find_spec(name, path, target)
    return spec


def _installed(name: str, origin: str) -> bool:
    """Whether a file lies where packages are installed, or is Python's own."""
    return _holds_packages(Path(origin).parents[name.count(".") + (Path(origin).stem == "__init__")])


@cache
def _holds_packages(folder: Path) -> bool:
    return str(folder).startswith(sysconfig.get_path("stdlib")) or any(folder.glob("*.dist-info"))


# ---------------------------------------------------------------- the hook


class Hook:
    """A finder that has every module of the bench and of the user loaded by `Loader`."""

    def __init__(self) -> None:
        self.packages, self.installed = {BENCH}, set[str]()

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        top, _, inner = name.partition(".")
        if top in sys.stdlib_module_names:
            return None
        found = next(filter(None, (_asked(finder, name, path, target) for finder in sys.meta_path)), None)
        if found is None or type(found.loader) is not SourceFileLoader:
            return found
        if top not in self.packages and ((inner and top in self.installed) or _installed(name, found.loader.path)):
            self.installed.add(top)
            return found
        found.loader = Loader(found.loader.name, found.loader.path)
        return found


class Loader(SourceFileLoader):
    """Runs exactly what IMPORTED has of a file."""

    imported: set[str] = set()  # noqa: RUF012 - of all loaders

    def get_code(self, fullname: str) -> Any:
        path = str(self.path)
        if path in self.imported:  # the user reloads it
            IMPORTED.content.pop(path, None)
        if path in self.imported or fullname.partition(".")[0] != BENCH:
            IMPORTED.forget()
        self.imported.add(path)
        source = IMPORTED.read(path)
        head = importlib.util.MAGIC_NUMBER + BYTE_CODE + importlib.util.source_hash(source)
        kept = importlib.util.cache_from_source(path)
        with contextlib.suppress(OSError, ValueError, EOFError, TypeError):
            data = self.get_data(kept)
            code = marshal.loads(data[len(head) :]) if data.startswith(head) else None
            if code is not None and code.co_filename == path:
                return code
        code = self.source_to_code(source, path)
        if not sys.dont_write_bytecode:
            self.set_data(kept, head + marshal.dumps(code))
        return code


def follow(module: str) -> None:
    """Have a module that the user names, and its package, loaded by the hook, also if they are installed."""
    for finder in sys.meta_path:
        if isinstance(finder, Hook):
            finder.packages.add(module.partition(".")[0])


def install() -> None:
    """Put the hook in place; before any module that decides about rows is imported."""
    if not any(isinstance(finder, Hook) for finder in sys.meta_path):
        sys.meta_path.insert(0, Hook())
        for name in [name for name in sys.modules if name.partition(".")[0] == BENCH]:
            if place := _place(name):
                IMPORTED.read(place[0])
