"""Which sources computed a cell: a digest of the definitions its rows come from, stored with them.

It starts at the experiment's `measure`, at the records of the methods and at the cell's potential, and follows every name
to the function, class or constant of the bench that it stands for, in whatever file that is. So an edit of one method marks
that method's cells, an edit of a figure marks none. A method counts if the cell names it or the code that measures does, in
a string. Of a table `ByMethod` only the entry of the cell's method counts.

Comments, docstrings, layout, type annotations and import statements are left out, and no path or module name goes in:
files may be moved. What comes from outside the bench counts by its name there.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from experiments.catalogue import load, load_stored

BENCH = frozenset(("integrators", "experiments", "results", "report", "lagrange_bench"))
INDEX = "integrators.registry"  # not followed: which methods there are decides about no row
DEFAULT = "backlund"  # the method of a cell that names none, as of `integrators.prepare`
TABLE = "ByMethod"  # the annotation of a dict by names of methods
IGNORED = frozenset(("annotation", "ctx", "kind", "returns", "type_comment"))  # fields of syntax trees

SAME, OTHER, UNKNOWN = "same", "other", "unknown"
OUTDATED, LEFT_OUT = "outdated", "left out"  # of another VERSION: shown because there is nothing newer; not shown
WORDS = {
    OUTDATED: "with another VERSION of the experiment than this",
    LEFT_OUT: "with another VERSION of the experiment than this, and left out",
    OTHER: "with other source code than this",
    UNKNOWN: "with source code that was not recorded",
}

Place = tuple[str, str]  # a module and a name defined there; "" for all of them


def of_cell(experiment: str, cell: Mapping[str, Any]) -> str | None:
    """Digest of the sources that compute a cell here and now, as they were first asked for; None if it is not known."""
    method, potential = (cell.get(word) for word in ("method", "potential"))
    return _of(experiment, *(name if isinstance(name, str) else None for name in (method, potential)))


def version(experiment: str) -> float | None:
    """VERSION of a stored experiment here and now; None if it is not known."""
    try:
        return float(load_stored(experiment).VERSION)  # the record does not choose what is imported
    except Exception:
        return None


def outdated(record: Mapping[str, Any]) -> bool:
    """Whether a stored cell was computed with another VERSION of the experiment than the one that is here."""
    return version(record["experiment"]) not in (None, record["version"])


def judge(record: Mapping[str, Any]) -> str:
    """Whether a stored cell was computed by the sources that are here: SAME, OTHER, OUTDATED or UNKNOWN."""
    if version(record["experiment"]) is None:
        return UNKNOWN
    if outdated(record):
        return OUTDATED
    return compared(record.get("sources"), of_cell(record["experiment"], record["cell"]))


def compared(one: str | None, other: str | None) -> str:
    """SAME, OTHER, or UNKNOWN if either is."""
    if one is None or other is None:
        return UNKNOWN
    return SAME if one == other else OTHER


def told(ages: Mapping[str, int]) -> str:
    """How many stored cells are not known to come from the sources that are here; empty if none. ages : see `judge`."""
    return "; ".join(f"{_cells(ages[age])} computed {words}" for age, words in WORDS.items() if ages.get(age))


def _cells(count: int) -> str:
    return f"{count} stored cell was" if count == 1 else f"{count} stored cells were"


@cache
def _of(experiment: str, method: str | None, potential: str | None = None) -> str | None:
    try:
        module = load(experiment)
        if _module(module.__name__) is not None:
            start = {(module.__name__, "measure")}
        else:  # a sweep, made of a file
            start = {(module.measure.__module__, module.measure.__qualname__)}
        records = [_record(method) if method else None, _record(potential, "potential") if potential else None]
        start.update(filter(None, records))
        found = _reached(start, {DEFAULT} if method is None else set(), method)
    except Exception:  # somebody else's, and not here, or not fit to be loaded or read
        return None
    return None if found is None else hashlib.sha256("".join(sorted(found)).encode()).hexdigest()[:16]


def _reached(start: set[Place], words: set[str], method: str | None) -> set[str] | None:
    """Digests of all that is used from these places on, and by methods of these names; None: not all have a source.

    method : of the cell.
    """
    if any(_module(module) is None for module, _ in start):
        return None
    packages = BENCH | {module.partition(".")[0] for module, _ in start}
    waiting = {place for path in start for place in _places(".".join(path), packages) if not isinstance(place, str)}
    digests, seen = set(), set(waiting)
    while waiting:
        module, name = waiting.pop()
        for unit in _units(module, name) if module != INDEX else ():
            text, paths, said = _read(module, _entry(unit, method))
            places = frozenset().union(*(_places(path, packages) for path in paths))
            digests |= {text, *(place for place in places if isinstance(place, str))}
            waiting |= {place for place in places if not isinstance(place, str)} - seen
            words |= said
        if not waiting and any(module.partition(".")[0] == "integrators" for module, _ in seen):
            waiting = {place for word in words if ":" not in word and (place := _record(word))} - seen
            words.clear()
        seen |= waiting
    return digests


@cache
def _record(name: str, word: str = "method") -> Place | None:
    """Where the record of a method or potential is, by its name or as `module:NAME`; None if there is none."""
    from integrators.registry import METHODS, POTENTIALS

    registry = METHODS if word == "method" else POTENTIALS
    value = registry._entries[name].value if name in registry else name
    module, colon, name = value.partition(":")
    return (module, name.partition(".")[0]) if colon else None


# ---------------------------------------------------------------- modules and what they define


@dataclass(frozen=True)
class _Module:
    units: dict[str, list[ast.stmt]] = field(default_factory=dict)  # name → the statements that bind it
    imports: dict[str, set[str]] = field(default_factory=dict)  # name → "package.module" or "package.module.name"


@cache
def _module(name: str) -> _Module | None:
    """None if there is no such module, or no file with its source."""
    path = _file(name)
    if path is None:
        return None
    tree, found = ast.parse(path.read_bytes()), _Module()
    for bound, target in _imports(tree, name if path.name == "__init__.py" else name.rpartition(".")[0]):
        found.imports.setdefault(bound, set()).add(target)
    for statement in tree.body:
        for bound in set(_bound(statement)):
            found.units.setdefault(bound, []).append(statement)
    return found


def _file(name: str) -> Path | None:
    top, *rest = name.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    if not rest and spec.origin and spec.origin.endswith(".py"):
        return Path(spec.origin)
    for folder in spec.submodule_search_locations or ():
        for place in (Path(folder, *rest, "__init__.py"), Path(folder, *rest).with_suffix(".py")):
            if place.is_file():
                return place
    return None


def _imports(tree: ast.Module, package: str) -> Iterator[tuple[str, str]]:
    """Name → what it stands for, of every import statement of a file, those within functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield (alias.asname, alias.name) if alias.asname else (alias.name.partition(".")[0],) * 2
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            for alias in node.names:
                yield alias.asname or alias.name, ".".join([*above, *filter(None, [node.module]), alias.name])


def _bound(node: ast.AST) -> Iterator[str]:
    """The names a statement binds where it stands, also within if, for and try, but not in scopes of their own."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        yield node.name
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id
    elif not isinstance(node, (ast.Lambda, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)):
        for part in ast.iter_child_nodes(node):
            yield from _bound(part)


def _units(module: str, name: str) -> Iterable[ast.stmt]:
    found = _module(module)
    if found is None:
        return ()
    if name in found.units:
        return found.units[name]
    return [unit for units in found.units.values() for unit in units]


@cache
def _places(path: str, packages: frozenset[str]) -> frozenset[Place | str]:
    """The places a dotted path leads to, through re-exports; the path itself if that is outside the bench."""
    words = path.split(".")
    for count in range(len(words), 0, -1) if words[0] in packages else ():
        module = ".".join(words[:count])
        if (found := _module(module)) is not None:
            name, rest = (words[count], words[count + 1 :]) if count < len(words) else ("", [])
            if name in found.units or name not in found.imports:
                return frozenset({(module, name if name in found.units else "")})
            targets = (".".join([target, *rest]) for target in found.imports[name])
            return frozenset().union(*(_places(target, packages) for target in targets if target != path))
    return frozenset({path})


# ---------------------------------------------------------------- one definition


@cache
def _entry(unit: ast.stmt, method: str | None) -> ast.stmt:
    """Of a table by names of methods, what it has for one of them; any other definition as it is."""
    if method is None or not (isinstance(unit, ast.AnnAssign) and isinstance(unit.value, ast.Dict)):
        return unit
    if ast.unparse(unit.annotation) != TABLE:
        return unit
    pairs = zip(unit.value.keys, unit.value.values, strict=True)
    own = [value for name, value in pairs if isinstance(name, ast.Constant) and name.value == method]
    return ast.copy_location(ast.Expr(ast.List(own)), unit)


@cache
def _read(module: str, unit: ast.stmt) -> tuple[str, frozenset[str], frozenset[str]]:
    """Digest of a definition, the dotted paths of what it uses, and its strings, among them names of methods."""
    digest = hashlib.sha256(repr(_plain(unit)).encode()).hexdigest()
    strings = {node.value for node in ast.walk(unit) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    ours = module.partition(".")[0] == "integrators"  # a method does not call another by its name
    return digest, frozenset(_used(unit, module, frozenset())), frozenset(() if ours else strings)


def _plain(node: Any) -> Any:
    """A syntax tree as nested tuples, the same in every version of Python."""
    if isinstance(node, list):
        return tuple(_plain(part) for part in node if not isinstance(part, (ast.Import, ast.ImportFrom)))
    if not isinstance(node, ast.AST):
        return node
    fields = {name: value for name, value in ast.iter_fields(node) if name not in IGNORED and value not in (None, [])}
    if _documented(node):
        fields["body"] = fields["body"][1:]
    return type(node).__name__, *((name, _plain(value)) for name, value in fields.items())


def _documented(node: ast.AST) -> bool:
    documented = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
    return documented and ast.get_docstring(node, clean=False) is not None  # type: ignore[arg-type]


def _used(node: ast.AST, module: str, hidden: frozenset[str]) -> Iterator[str]:
    """hidden : names that stand for something local where the node is."""
    words: list[str] = []
    inner = node
    while isinstance(inner, ast.Attribute):
        words.insert(0, inner.attr)
        inner = inner.value
    if isinstance(inner, ast.Name):
        found = _module(module)
        if found and inner.id not in hidden:
            yield from (".".join([target, *words]) for target in found.imports.get(inner.id, ()))
            yield from [f"{module}.{inner.id}"] if inner.id in found.units else []
        return
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        arguments = {part.arg for part in ast.walk(node.args) if isinstance(part, ast.arg)}
        hidden = hidden | arguments.union(*(_bound(part) for part in node.body))
    for name, value in ast.iter_fields(node):
        if name not in IGNORED:
            parts = value if isinstance(value, list) else [value]
            for part in parts[1:] if name == "body" and _documented(node) else parts:
                if isinstance(part, ast.AST):
                    yield from _used(part, module, hidden)
