"""What a method or potential of somebody's own consists of: a digest of its sources, under which its results are stored.

One of the bench has none: the version of the bench stands for it.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from results.sources import BENCH


@cache
def digest(name: str, word: str = "method") -> str | None:
    """Of the method of a plug-in or of `module:METHOD`; None if it is one of the bench, or cannot be loaded.

    A function of the contents of files alone, the same in every process and on every machine: of the modules with the
    record and with its functions, or the whole packages these are in; of what they import from beside them, unless that is
    where packages are installed; and of the version of the package. `word` is "method" or "potential".
    """
    from integrators.registry import METHODS, POTENTIALS, find_method, find_potential

    registry, find = (METHODS, find_method) if word == "method" else (POTENTIALS, find_potential)
    if name in registry.built_in or not (":" in name or name in registry):
        return None
    try:
        if ":" in name:
            found, module = find(name), name.partition(":")[0]
            packages = metadata.packages_distributions().get(module.partition(".")[0], [])
            versions = [
                f"{package} {metadata.version(package)}" for package in sorted(set(packages) - {"lagrange-bench"})
            ]
        else:
            found, entry = registry[name], registry._entries[name]
            module = entry.module
            versions = [f"{entry.dist.name} {entry.dist.version}"] if entry.dist else []
    except Exception:  # its cells fail, each with the reason
        return None
    modules = {module, *filter(None, (getattr(f, "__module__", None) for f in _functions(found)))}
    hashed = hashlib.sha256("\n".join(versions).encode())
    for place, file in sorted(_files(modules).items()):
        hashed.update(f"\n{place}\n".encode() + hashlib.sha256(file.read_bytes()).digest())
    return hashed.hexdigest()


def _functions(found: Any) -> list[Any]:
    """What computes, of a Method or a Potential."""
    field = getattr(found, "in_field", None)
    functions = [found.prepare, field and field.prepare] if hasattr(found, "prepare") else [found.value, found.given]
    return [getattr(function, "func", function) for function in functions]  # of a functools.partial


def _files(modules: set[str]) -> dict[str, Path]:
    """The sources of these modules and of what they import from beside them, by their places."""
    files: dict[str, Path] = {}
    roots = {_sources(module)[0] for module in modules} - {None}
    waiting, seen = set(modules), set(BENCH)
    while waiting:
        seen.add(module := waiting.pop())
        root, fresh = _sources(module)
        if root is None or root not in roots:
            continue
        files |= fresh
        if not any(root.glob("*.dist-info")):
            waiting |= {name for path in fresh.values() for name in _imported(path)} - seen
    return files


def _sources(module: str) -> tuple[Path | None, dict[str, Path]]:
    """The folder a module is found in and the sources of it, or of the package it is part of; None: it has none."""
    top = module.partition(".")[0]
    try:
        spec = importlib.util.find_spec(module if top in BENCH else top)
    except (ImportError, ValueError):  # the latter: __main__
        spec = None
    if spec is None:
        return None, {}
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    paths = [path for folder in folders for path in folder.rglob("*.py")] or [Path(str(spec.origin))]
    if not all(path.is_file() for path in paths):  # built in, frozen, in an archive
        return None, {}
    root = (folders or paths)[0].parent
    return root, {path.relative_to(root).as_posix(): path for path in paths if path.is_relative_to(root)}


@cache
def _imported(path: Path) -> set[str]:
    """Top-level names of the modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found
