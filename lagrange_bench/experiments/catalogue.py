"""Finds and loads experiments by their names."""

import importlib
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.support.words import suggestion

SCALED = ("h", "span")  # times in a cell
GROUP = "lagrange_bench.experiments"  # of entry points: name = package.module


class UnknownExperiment(ValueError):
    """No experiment has this name, its module must not or cannot be imported, or the module is no experiment."""


@cache
def installed() -> dict[str, EntryPoint]:
    """The experiments of other packages, by name. Names of the bench and dotted names are not allowed."""
    entries = sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value), reverse=True)
    accepted = (entry for entry in entries if entry.name not in EXPERIMENTS and "." not in entry.name)
    return {entry.name: entry for entry in accepted}


def load(name: str) -> ModuleType:
    """Import and return the module of an experiment.

    name : in EXPERIMENTS, of an installed package, or the dotted path of a module. An import runs code, so the user must have
    given the name. For names in results see `load_stored`.

    Raises
    ------
    UnknownExperiment
        The name is unknown, or the module lacks a part of the protocol.
    """
    from lagrange_bench.integrators.own_modules import import_own, no_exit

    find: Callable[[str], ModuleType] = importlib.import_module
    if name in EXPERIMENTS:
        path = f"lagrange_bench.experiments.{name}"
    elif "." in name and all(map(str.isidentifier, name.split("."))):
        path, find = name, import_own
    elif name in installed():
        path = installed()[name].module
    else:
        known = [*EXPERIMENTS, *installed()]
        raise UnknownExperiment(f"unknown experiment {name!r}{suggestion(name, known)} Known: {', '.join(known)}")
    try:
        with no_exit():
            module = find(path)
    except Exception as error:  # somebody else's module may raise anything
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing and f"{path}.".startswith(f"{missing}."):
            raise UnknownExperiment(f"unknown experiment {name!r}: {error}") from None
        why = f"{type(error).__name__}: {error}"
        raise UnknownExperiment(f"experiment {name!r} cannot be loaded: {why}") from error
    label = f"experiment {name!r} ({getattr(module, '__file__', path)})"  # a folder without __init__.py has no file
    if absent := [part for part in ("VERSION", "cells", "measure", "draw", "tables") if not hasattr(module, part)]:
        raise UnknownExperiment(f"{label} lacks {', '.join(absent)}")
    if type(module.VERSION) not in (int, float):
        raise UnknownExperiment(f"{label}: VERSION must be a number; got {module.VERSION!r}")
    return module


def missing_package(name: str, cell: Mapping[str, Any]) -> str | None:
    """The package that the experiment needs for a cell and that is not installed here, or None. The method is not asked."""
    missing_for = getattr(load(name), "missing_package", None)
    return missing_for(cell) if missing_for else None


def load_stored(name: str) -> ModuleType:
    """As `load`, for a name in stored results. A dotted name must be imported already: the author of the results chose it."""
    if "." in name and name not in sys.modules:
        raise UnknownExperiment(f"unknown experiment {name!r}; if it is your own, add --module {name}")
    return load(name)


def declared(name: str, word: str, usual: Any = None) -> Any:
    """The attribute `word` of a stored experiment; `usual` if it has none, or if the experiment cannot be loaded here."""
    try:
        return getattr(load_stored(name), word, usual)
    except UnknownExperiment:
        return usual


def with_units(name: str, cell: Mapping[str, Any]) -> dict[str, Any]:
    """A cell as messages print it: times in the time scale of its top are called `h_scaled` and `span_scaled`."""
    scaled = declared(name, "SCALED_TIMES", False)
    if scaled is not True and cell.get("part") not in (scaled or ()):
        return dict(cell)
    return {f"{key}_scaled" if key in SCALED else key: value for key, value in cell.items()}
