"""Finds the files that a module imports, and makes a digest of them.

Rows and machine code are stored under such a digest. A file may be edited while a process runs. So a process reads a file once,
before it computes anything that depends on it, and asks afterwards whether the file was edited: `Sources.edited`.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import io
import re
import sys
import sysconfig
import tokenize
from collections.abc import Collection
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any, NamedTuple

BENCH = "lagrange_bench"
PUBLIC_MODULES = (BENCH, f"{BENCH}.integrators")  # they pass on names of other modules
# these decide about no row: the list of methods, the look of figures, how cells are run, and this file.
# A module of experiments whose name ends in _figures only shows rows.
IGNORED_MODULES = re.compile(
    rf"{BENCH}(\.(integrators(\.registry)?|experiments(\.(drawing(\..*)?|\w+_figures))?|support(\.(announce|lazy|source_digest))?"
    r"|(?!integrators|experiments|support)\w+(\..*)?))?"
)
# it has an entry for each method, but a cell depends on its own method only
NOT_FOLLOWED = ("lagrange_bench.integrators.backward_error.steps",)
IMPORT = re.compile(
    r"(?:^|[:;])[ \t]*(?:from[ \t]+(\.*[\w.]*)[ \t]+)?import\b[ \t]*(\([^)]*\)|(?:\\\n|[^\n;])*)", re.MULTILINE
)


class SourceDigest(NamedTuple):
    """The source code of some modules."""

    digest: str | None  # 24 hexadecimal digits, of the names and the content of the modules; None: not known
    paths: frozenset[str] = frozenset()


class Sources:
    """Source files by their path, each as it was when it was first read."""

    def __init__(self) -> None:
        self.content: dict[str, bytes] = {}
        self.known: dict[Any, SourceDigest] = {}  # answers that callers keep for the next time
        self._stamps: dict[str, tuple[int, int] | None] = {}
        self._places: dict[str, tuple[str, bool] | None] = {}  # see `_place`
        self._targets: dict[str, set[str]] = {}  # what a module imports

    def read(self, path: str) -> bytes:
        if path not in self.content:
            self._stamps[path] = _stamp(path)
            self.content[path] = Path(path).read_bytes()
        return self.content[path]

    def edited(self, code: SourceDigest) -> bool:
        """Whether one of the files was edited since it was read. Then it is not known which version this process imported."""
        return any(_stamp(path) != self._stamps[path] for path in code.paths if path in self._stamps)

    def code(self, modules: Collection[str], *more: str, words: bool = True) -> SourceDigest:
        """The source code of these modules and of all that they import.

        more : texts that enter the digest, too. words : whether comments, docstrings and empty lines count. It takes a second to
        leave them out of all files.
        """
        files = self.files(modules)
        content = {
            name: self.content[path] if words else _without_words(self.content[path]) for name, path in files.items()
        }
        lines = [f"{name} {hashlib.sha256(content[name]).hexdigest()}" for name in sorted(content)]
        digest = hashlib.sha256("\n".join([*lines, *more]).encode()).hexdigest()[:24]
        return SourceDigest(digest, frozenset(files.values()))

    def files(self, modules: Collection[str]) -> dict[str, str]:
        """These modules and all modules that they import, directly or not, with their files.

        Python's own modules are left out. So are installed packages, unless one of `modules` is in the package. ImportError or
        OSError if one of `modules` is missing, or has no file.
        """
        packages = {name.partition(".")[0] for name in modules}
        files: dict[str, str] = {}
        waiting = {part: part in modules for name in modules for part in _parents(name)}
        while waiting:
            name, needed = waiting.popitem()
            path = self._path(name, packages)
            if path is None and needed and not IGNORED_MODULES.fullmatch(name):
                raise ImportError(f"no source file of {name}")
            if path is None or name in files or IGNORED_MODULES.fullmatch(name):
                continue
            self.read(path)
            files[name] = path
            if name not in NOT_FOLLOWED:
                waiting |= dict.fromkeys(self._imported(name, path) - set(files), False)
        return files

    def _path(self, name: str, packages: Collection[str]) -> str | None:
        """The file of a module; None if it has none, or if it is in an installed package other than `packages`."""
        if name not in self._places:
            self._places[name] = _place(name)
        path, installed = self._places[name] or (None, False)
        return path if name.partition(".")[0] in packages or not installed else None

    def _imported(self, name: str, path: str) -> set[str]:
        """The modules that a file imports and that have a file, installed packages among them."""
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
        """The module that defines `name`, which the public module `package` passes on; or the module `package.name`."""
        if name and self._path(f"{package}.{name}", ()):
            return f"{package}.{name}"
        path = self._path(package, ())
        offers = _statements(self.read(path), package) if path else ()
        for module, offered in offers:
            if name and offered == name and module != package:  # else an example in its docstring
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
def _without_words(source: bytes) -> bytes:
    """A module without comments, docstrings and empty lines, which decide about no number."""
    text = importlib.util.decode_source(source)
    lines = text.splitlines(keepends=True)
    tokens = list(tokenize.generate_tokens(io.StringIO(text).readline))
    words = [token for token in tokens if token.type in (tokenize.COMMENT, tokenize.NL)]
    code = [token for token in tokens if token.type not in (tokenize.COMMENT, tokenize.NL)]
    for before, here, after in zip([None, *code], code, code[1:], strict=False):
        begins = before is None or before.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
        if begins and here.type == tokenize.STRING and after.type == tokenize.NEWLINE:
            words.append(here)  # a statement that is a string
    for word in sorted(words, key=lambda word: word.start, reverse=True):
        (first, left), (last, right) = word.start, word.end
        rest = lines[first - 1][:left].rstrip() + lines[last - 1][right:]
        lines[first - 1 : last] = [rest if rest.strip() else ""]
    return "".join(lines).encode()


@cache
def _statements(source: bytes, package: str) -> tuple[tuple[str, str], ...]:
    """(module, imported name or "") of every import statement, also in functions and docstrings."""
    imports = []
    text = re.sub("#.*", "", importlib.util.decode_source(source))
    for origin, names in IMPORT.findall(text):
        listed = [words.split()[0] for words in re.sub(r"[()\\]", " ", names).split(",") if words.split()]
        if origin:
            try:
                origin = importlib.util.resolve_name(origin, package or None)
            except ImportError:  # more dots than packages
                continue
            imports += [(origin, ""), *((origin, name) for name in listed)]
        else:
            imports += [(name, "") for name in listed]
    return tuple(dict.fromkeys(imports))


def _parents(name: str) -> list[str]:
    """A dotted name and the packages that contain it."""
    words = name.split(".")
    return [".".join(words[:count]) for count in range(1, len(words) + 1)]


# ---------------------------------------------------------------- where modules are


def _place(name: str) -> tuple[str, bool] | None:
    """The file of a module, without running any code; and whether it is in an installed package."""
    top = name.partition(".")[0]
    spec = None if top in sys.stdlib_module_names else _spec(name)
    if spec is None or not spec.origin or not Path(spec.origin).is_file():
        return None
    origin = Path(spec.origin)
    return spec.origin, top != BENCH and _holds_packages(origin.parents[name.count(".") + (origin.stem == "__init__")])


def _spec(name: str) -> ModuleSpec | None:
    """As importlib.util.find_spec, but it imports no package."""
    module, parent = sys.modules.get(name), name.rpartition(".")[0]
    if module is not None and getattr(module, "__spec__", None) is not None:
        return module.__spec__
    place = _spec(parent) if parent else None
    if parent and (place is None or place.submodule_search_locations is None):
        return None
    path = list(place.submodule_search_locations or ()) if place else None
    if path is None and name != BENCH:
        with contextlib.suppress(OSError):  # as `own_modules.import_own` does
            if (own := PathFinder.find_spec(name, [str(Path.cwd())])) is not None:
                return own
    finders = (finder.find_spec for finder in sys.meta_path if hasattr(finder, "find_spec"))
    return next(filter(None, (find(name, path, None) for find in finders)), None)


@cache
def _holds_packages(folder: Path) -> bool:
    """Whether packages are installed in a folder, or it belongs to Python itself."""
    return str(folder).startswith(sysconfig.get_path("stdlib")) or any(folder.glob("*.dist-info"))
