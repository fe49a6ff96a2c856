"""Lets a package import its public names at first use. So the command line answers --help without importing Numba."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any


def public_module(
    package: str, homes: Mapping[str, tuple[str, ...]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package. homes : module → its public names, or the modules in a package."""
    places = {name: module for module, names in homes.items() for name in names}

    def getattribute(name: str) -> Any:
        if name not in places:
            close = get_close_matches(name, places, 1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        value = getattr(__import__(places[name], fromlist=[name]), name)  # imports a module of a package, too
        setattr(sys.modules[package], name, value)
        return value

    return getattribute, lambda: sorted({*vars(sys.modules[package]), *places})


def exported(file: str) -> dict[str, tuple[str, ...]]:
    """The names that a file imports for type checkers as `name as name`, in the form of the homes of `public_module`."""
    imports = [node for node in ast.walk(ast.parse(Path(file).read_bytes())) if isinstance(node, ast.ImportFrom)]
    names = [(str(node.module), alias.name) for node in imports for alias in node.names if alias.asname == alias.name]
    return {home: tuple(name for module, name in names if module == home) for home, _ in names}
