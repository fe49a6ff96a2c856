"""Faces of packages whose names are imported when they are first asked for: the command line answers --help without Numba."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def face(package: str, homes: Mapping[str, tuple[str, ...]]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package; homes: module → the names it has; () for the module itself."""
    places = {name: module for module, names in homes.items() for name in names or (module.rpartition(".")[2],)}

    def getattribute(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = importlib.import_module(places[name])
        value = getattr(module, name) if homes[places[name]] else module
        setattr(sys.modules[package], name, value)
        return value

    return getattribute, lambda: sorted({*vars(sys.modules[package]), *places})
