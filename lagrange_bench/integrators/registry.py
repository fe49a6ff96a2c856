"""METHODS, POTENTIALS and NAMED_TOPS: methods, in legend order, potentials and tops by name.

Other packages add theirs as entry points, name = `package.module:OBJECT`. The groups are `lagrange_bench.methods`,
`lagrange_bench.potentials`, and `lagrange_bench.tops` for tops with a name and an initial state. An entry that cannot be loaded,
or whose name is taken, does not stop the others.
"""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from lagrange_bench.integrators import methods
from lagrange_bench.integrators.interface import Method, StepError
from lagrange_bench.integrators.methods import ARCHIVE, BUILT_IN
from lagrange_bench.integrators.own_modules import import_own, no_exit
from lagrange_bench.integrators.problem.perturbed import Potential
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS, POTENTIALS_BUILT_IN
from lagrange_bench.integrators.problem.top import TOPS, NamedTop
from lagrange_bench.support.words import suggestion

MANY = 8  # of so many methods, or fewer, none is left out


def without_archive(names: Iterable[str]) -> list[str]:
    """The distinct names of methods; of more than MANY only those that are not in the archive."""
    distinct = list(dict.fromkeys(names))
    return [name for name in distinct if name not in ARCHIVE] if len(distinct) > MANY else distinct


class Registry(Mapping[str, Any]):
    """Name → record. Methods, and what other packages have, are imported when they are asked for.

    word : "method", "potential" or "top", also in the name of the entry-point group. kind : the type of the records.
    built_in : the names of the bench, each with "module:OBJECT" or with the record itself.
    """

    def __init__(self, word: str, kind: type[Any], built_in: Mapping[str, Any]):
        self.word, self.group, self.kind, self.built_in = word, f"lagrange_bench.{word}s", kind, built_in

    @cached_property
    def _entries(self) -> dict[str, Any]:
        """Name → record, or the entry point that leads to it."""
        entries = {
            name: EntryPoint(name, value, self.group) if isinstance(value, str) else value
            for name, value in self.built_in.items()
        }
        for entry in sorted(entry_points(group=self.group), key=lambda e: (e.name, e.value)):
            if entries.setdefault(entry.name, entry) is not entry:
                text = f"the plug-in {entry.name!r} ({entry.value}) is left out, for its name is taken"
                warnings.warn(text, RuntimeWarning, stacklevel=2)
        return entries

    def __getitem__(self, name: str) -> Any:
        if name not in self._entries:
            close = suggestion(str(name), self._entries)
            raise KeyError(f"unknown {self.word} {name!r}{close} All: lagrange-bench {self.word}s")
        entry = self._entries[name]
        if not hasattr(entry, "load"):  # a record; entry points of importlib_metadata have a type of their own
            return entry
        with no_exit():
            record = entry.load()
        if not isinstance(record, self.kind):
            raise TypeError(f"{entry.value} is a {type(record).__name__}, not a lagrange_bench.{self.kind.__name__}")
        return record

    def include(self, name: str) -> None:
        """Register `module:NAME` under these very words in this process, without an entry point; ValueError if it cannot be."""
        if name not in self._entries:
            find(name, self)
            self._entries = {**self._entries, name: EntryPoint(name, name, self.group)}

    def module(self, name: str) -> str:
        """The module with the record of a registered name, or of `module:NAME`."""
        return name.partition(":")[0] if ":" in name else self._entries[name].module

    @contextmanager
    def temporarily_registered(self, *records: Any) -> Iterator[None]:
        """Register records under their names while the block runs."""
        before = self._entries
        self._entries = {**before, **{record.name: record for record in records}}
        try:
            yield
        finally:
            self._entries = before

    @property
    def state(self) -> tuple[tuple[str, Any], ...]:
        """A key for caches of what is registered now."""
        return tuple(self._entries.items())

    def each(self) -> Iterator[tuple[str, Any, str]]:
        """Every name with its record and ""; or with None and the reason why the record cannot be loaded."""
        for name in self:
            try:
                yield name, self[name], ""
            except Exception as error:  # somebody else's package may raise anything, and the other names follow
                yield name, None, f"{type(error).__name__}: {error}"

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


METHODS = Registry("method", Method, {name: f"{methods.__name__}.{place}" for name, place in BUILT_IN.items()})
POTENTIALS = Registry("potential", Potential, POTENTIALS_BUILT_IN)
NAMED_TOPS = Registry("top", NamedTop, {**TOPS, **PERTURBED_TOPS})


class NotInstalled(StepError):
    """A method cannot run here, because a package that it needs is not installed."""


def find(thing: Any, registry: Registry) -> Any:
    """The record that has a name in the registry, or is `module:NAME`, or `thing` itself; else ValueError."""
    word, kind = registry.word, registry.kind.__name__
    if isinstance(thing, registry.kind):
        return thing
    if not isinstance(thing, str):
        raise ValueError(f"{word} must be a name, package.module:{word.upper()} or a {kind}; got {thing!r}")
    path, colon, attribute = thing.partition(":")
    try:
        record = getattr(import_own(path), attribute) if colon else registry[thing]
    except KeyError as error:
        raise ValueError(str(error.args[0])) from None
    except Exception as error:  # importing somebody else's module may raise anything
        raise ValueError(f"{word} {thing} cannot be loaded: {type(error).__name__}: {error}") from error
    if not isinstance(record, registry.kind):
        raise ValueError(f"{word} {thing} is a {type(record).__name__}, not a lagrange_bench.{kind}")
    return record


def find_method(method: str | Method) -> Method:
    """`find` of a method that can run here; NotInstalled if it needs another package."""
    record: Method = find(method, METHODS)
    if not available(record):
        raise NotInstalled(record.name, how_to_get(str(record.requires)))
    return record


def find_stored(name: str, registry: Registry) -> Any:
    """`find` of a name in stored results: it imports no module for `module:NAME`."""
    module, colon, _ = name.partition(":")
    if colon and module not in sys.modules:
        raise ValueError(f"unknown {registry.word} {name!r}; if it is your own, add --module {module}")
    return find(name, registry)


def available(method: Method) -> bool:
    """Whether the package a method needs is installed here.

    Parameters
    ----------
    method : Method
        A record.

    Returns
    -------
    bool
        False if `method.requires` cannot be imported.
    """
    return method.requires is None or importlib.util.find_spec(method.requires) is not None


def how_to_get(package: str) -> str:
    """How to install a package that is missing here."""
    name = "heyoka.py" if package == "heyoka" else package  # as conda-forge calls it
    return (
        f"{package} is not installed here; it comes with conda install -c conda-forge {name} (on Linux also with pip)"
    )
