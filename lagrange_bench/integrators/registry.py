"""METHODS, POTENTIALS and NAMED_TOPS: methods, in legend order, potentials and tops by name, loaded when first asked for.

Other packages add theirs as entry points, name = `package.module:OBJECT`. The groups are `lagrange_bench.methods`,
`lagrange_bench.potentials`, and `lagrange_bench.tops` for tops with a name and an initial state. An entry that cannot be loaded,
or whose name is taken, does not stop the others.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from lagrange_bench.integrators.interface import Method, StepError
from lagrange_bench.integrators.own_modules import import_own, in_own_file, no_exit
from lagrange_bench.support.words import suggestion

BUILT_IN = {
    # backlund
    "backlund": "backlund:EXACT",
    "backlund_unpinned": "backlund:UNPINNED",
    "backlund_paper": "backlund:PAPER",
    "backlund_textbook": "backlund_textbook:METHOD",
    "backlund_splitting": "backlund_splitting:METHOD",
    # closed-form
    "addition_theorem": "addition_theorem:METHOD",
    "theta_functions": "theta_functions:METHOD",
    # taylor
    "taylor": "taylor:NATURAL",
    "taylor_fixed": "taylor_fixed:METHOD",
    # runge-kutta
    "rk4": "runge_kutta:CLASSICAL",
    "rk45_fixed": "runge_kutta:FIFTH",
    "dop853_fixed": "runge_kutta:EIGHTH",
    "verner9_fixed": "runge_kutta:NINTH",
    "verner9_projected": "runge_kutta:PROJECTED",
    "dop853": "dop853:METHOD",
    "rk45": "scipy_ivp:RK45",
    "scipy_dop853": "scipy_ivp:DOP853",
    # splitting
    "strang": "splitting:STRANG",
    "blanes_moan4": "splitting:BLANES_MOAN4",
    "force_gradient4": "splitting:FORCE_GRADIENT4",
    "blanes_moan6": "splitting:BLANES_MOAN6",
    "force_gradient6": "splitting:FORCE_GRADIENT6",
    "kahan_li8": "splitting:KAHAN_LI8",
    # integrable
    "kahan": "kahan:METHOD",
    "bobenko_suris": "bobenko_suris:METHOD",
    # implicit
    "implicit_midpoint": "implicit_midpoint:METHOD",
    "gauss4": "gauss:GAUSS4",
    "gauss6": "gauss:GAUSS6",
    "gauss8": "gauss:GAUSS8",
    # lie-group
    "rkmk4": "lie_group:RKMK4",
    # whole-body
    "rattle": "whole_body:RATTLE",
    "simo_wong": "whole_body:SIMO_WONG",
    "lie_midpoint": "whole_body:LIE_MIDPOINT",
    "generalized_alpha": "whole_body:GENERALIZED_ALPHA",
}

# Each of these has a better, or better known, method in its family. Their rows and claims are kept; figures and quick runs of
# many methods leave them out.
ARCHIVE = frozenset([
    "backlund_unpinned", "backlund_paper", "backlund_textbook", "taylor_fixed", "rk45_fixed", "dop853_fixed", "scipy_dop853",
    "force_gradient4", "gauss4", "gauss6", "lie_midpoint",
])  # fmt: skip
MANY = 8  # of so many methods, or fewer, none is left out

POTENTIALS_BUILT_IN = {
    name: f"lagrange_bench.integrators.problem.potentials:{name.upper()}"
    for name in ("quadratic", "axisymmetric", "charge", "dipole", "tide")
}


def without_archive(names: Iterable[str]) -> list[str]:
    """The distinct names of methods; of more than MANY only those that are not in the archive."""
    distinct = list(dict.fromkeys(names))
    return [name for name in distinct if name not in ARCHIVE] if len(distinct) > MANY else distinct


class Registry(Mapping[str, Any]):
    """Name → Method, Potential or NamedTop. Listing the names of methods and potentials imports nothing.

    word : "method", "potential" or "top", also in the name of the entry-point group. kind : the place of the type, "module:Type".
    built_in : returns the names of the bench, each with "module:OBJECT" or with the object itself.
    """

    def __init__(self, word: str, kind: str, built_in: Callable[[], Mapping[str, Any]]):
        self.word, self.group = word, f"lagrange_bench.{word}s"
        self._kind, self._built_in = kind, built_in
        self._loaded: dict[EntryPoint, Any] = {}

    @cached_property
    def kind(self) -> Any:
        """The type of what is registered."""
        return EntryPoint("", self._kind, "").load()

    @cached_property
    def built_in(self) -> Mapping[str, Any]:
        """What the bench itself has."""
        return self._built_in()

    @cached_property
    def _entries(self) -> dict[str, Any]:
        entries = {
            name: EntryPoint(name, value, self.group) if isinstance(value, str) else value
            for name, value in self.built_in.items()
        }
        clashes = []
        for entry in sorted(entry_points(group=self.group), key=lambda e: (e.name, e.value)):
            if entries.setdefault(entry.name, entry) is not entry:
                package = entry.dist.name if entry.dist else entry.module
                clashes.append(
                    f"the plug-in {entry.name!r} ({entry.value} of the package {package}) is left out, for its name is "
                    f"taken: give the {self.word} another name, or pip uninstall {package}"
                )
        if clashes and multiprocessing.parent_process() is None:  # said once, not by every worker
            warnings.warn("; ".join(clashes), RuntimeWarning, stacklevel=2)
        return entries

    def __getitem__(self, name: str) -> Any:
        if name not in self._entries:
            close = suggestion(str(name), self._entries)
            names = ", ".join(self._entries) or f"your own, as mine:{self.word.upper()}"
            known = f"All: lagrange-bench {self.word}s" if close.endswith("?") else f"Known: {names}"
            raise KeyError(f"unknown {self.word} {name!r}{close} {known}")
        entry = self._entries[name]
        if not hasattr(
            entry, "load"
        ):  # no isinstance: importlib_metadata, once imported, finds entry points of its own type
            return entry
        if entry not in self._loaded:
            with no_exit():
                record = entry.load()
            if not isinstance(record, self.kind):
                raise TypeError(
                    f"{entry.value} is a {type(record).__name__}, not a lagrange_bench.{self.kind.__name__}"
                )
            if record.name != name and ":" not in name:
                raise ValueError(f"{entry.value} calls itself {record.name!r} but is registered as {name!r}")
            self._loaded[entry] = record
        return self._loaded[entry]

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


def _methods() -> Mapping[str, Any]:
    return {name: f"lagrange_bench.integrators.methods.{place}" for name, place in BUILT_IN.items()}


def _tops() -> Mapping[str, Any]:
    from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
    from lagrange_bench.integrators.problem.top import TOPS

    return {**TOPS, **PERTURBED_TOPS}


METHODS = Registry("method", "lagrange_bench.integrators.interface:Method", _methods)
POTENTIALS = Registry(
    "potential", "lagrange_bench.integrators.problem.potential:Potential", lambda: POTENTIALS_BUILT_IN
)
NAMED_TOPS = Registry("top", "lagrange_bench.integrators.problem.top:NamedTop", _tops)


class NotInstalled(StepError):
    """A method cannot run here, because a package that it needs is not installed."""


def find_method(method: str | Method) -> Method:
    """The method of a name in METHODS or of `package.module:METHOD`, or the method itself, if it can run here.

    ValueError if there is none, or it cannot be loaded; NotInstalled if it needs another package.
    """
    record = find(method, METHODS) if isinstance(method, str) else method
    if not isinstance(record, Method):
        raise ValueError(f"method must be a name in METHODS, package.module:METHOD or a Method; got {method!r}")
    if not available(record):
        raise NotInstalled(record.name, how_to_get(str(record.requires)))
    return record


def find_potential(potential: str | Any) -> Any:
    """The potential of a name in POTENTIALS or of `package.module:POTENTIAL`, or the potential itself; else ValueError."""
    record = find(potential, POTENTIALS) if isinstance(potential, str) else potential
    if not isinstance(record, POTENTIALS.kind):
        raise ValueError(
            f"potential must be a name in POTENTIALS, package.module:POTENTIAL or a Potential; got {potential!r}"
        )
    return record


def find_top(name: str) -> Any:
    """The named top of a name in NAMED_TOPS or of `package.module:TOP`; else ValueError."""
    return find(name, NAMED_TOPS)


def find(name: str, registry: Registry) -> Any:
    """What has a name in the registry, or `module:NAME`; ValueError if there is none, or it cannot be loaded."""
    word = registry.word
    path, colon, attribute = name.partition(":")
    if path.endswith(".py"):
        file = Path(path)
        where = "" if file.parent == Path() else f" in the folder {file.parent}"
        raise ValueError(f"{word} {name}: write {file.stem}:{attribute or word.upper()}{where}")
    try:
        record = getattr(import_own(path), attribute) if colon else registry[name]
    except KeyError as error:
        if hint := in_own_file(name, word):
            raise ValueError(f"no {word} is registered as {name!r}{hint}") from None
        raise ValueError(str(error.args[0])) from None
    except Exception as error:  # importing somebody else's module may raise anything
        raise ValueError(f"{word} {name} cannot be loaded: {type(error).__name__}: {error}") from error
    if not isinstance(record, registry.kind):
        raise ValueError(f"{word} {name} is a {type(record).__name__}, not a lagrange_bench.{registry.kind.__name__}")
    return record


def find_stored(name: str, registry: Registry) -> Any:
    """The method or potential of a name in stored results, else ValueError; it imports no module for `module:NAME`."""
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
