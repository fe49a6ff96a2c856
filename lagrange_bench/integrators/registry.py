"""METHODS, POTENTIALS and NAMED_TOPS: methods, in legend order, potentials and tops by name, loaded when first asked for.

Other packages add theirs as entry points, name = `package.module:OBJECT`. The groups are `lagrange_bench.methods`,
`lagrange_bench.potentials`, and `lagrange_bench.tops` for tops with a name and an initial state. An entry that cannot be loaded,
or whose name is taken, does not stop the others.
"""

from __future__ import annotations

import copyreg
import importlib
import importlib.util
import inspect
import itertools
import multiprocessing
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from lagrange_bench.integrators.interface import Method, StepError
from lagrange_bench.integrators.own_modules import import_own, in_own_file, no_exit
from lagrange_bench.support.words import suggestion

BUILT_IN = {
    # backlund
    "backlund": "lagrange_bench.integrators.methods.backlund:EXACT",
    "backlund_unpinned": "lagrange_bench.integrators.methods.backlund:UNPINNED",
    "backlund_paper": "lagrange_bench.integrators.methods.backlund:PAPER",
    "backlund_textbook": "lagrange_bench.integrators.methods.backlund_textbook:METHOD",
    "backlund_splitting": "lagrange_bench.integrators.methods.backlund_splitting:METHOD",
    # closed-form
    "addition_theorem": "lagrange_bench.integrators.methods.addition_theorem:METHOD",
    "theta_functions": "lagrange_bench.integrators.methods.theta_functions:METHOD",
    # taylor
    "taylor": "lagrange_bench.integrators.methods.taylor:NATURAL",
    "taylor_fixed": "lagrange_bench.integrators.methods.taylor_fixed:METHOD",
    # runge-kutta
    "rk4": "lagrange_bench.integrators.methods.runge_kutta:CLASSICAL",
    "rk45_fixed": "lagrange_bench.integrators.methods.runge_kutta:FIFTH",
    "dop853_fixed": "lagrange_bench.integrators.methods.runge_kutta:EIGHTH",
    "verner9_fixed": "lagrange_bench.integrators.methods.runge_kutta:NINTH",
    "verner9_projected": "lagrange_bench.integrators.methods.runge_kutta:PROJECTED",
    "dop853": "lagrange_bench.integrators.methods.dop853:METHOD",
    "rk45": "lagrange_bench.integrators.methods.scipy_ivp:RK45",
    "scipy_dop853": "lagrange_bench.integrators.methods.scipy_ivp:DOP853",
    # splitting
    "strang": "lagrange_bench.integrators.methods.splitting:STRANG",
    "blanes_moan4": "lagrange_bench.integrators.methods.splitting:BLANES_MOAN4",
    "force_gradient4": "lagrange_bench.integrators.methods.splitting:FORCE_GRADIENT4",
    "blanes_moan6": "lagrange_bench.integrators.methods.splitting:BLANES_MOAN6",
    "force_gradient6": "lagrange_bench.integrators.methods.splitting:FORCE_GRADIENT6",
    "kahan_li8": "lagrange_bench.integrators.methods.splitting:KAHAN_LI8",
    # integrable
    "kahan": "lagrange_bench.integrators.methods.kahan:METHOD",
    "bobenko_suris": "lagrange_bench.integrators.methods.bobenko_suris:METHOD",
    # implicit
    "implicit_midpoint": "lagrange_bench.integrators.methods.implicit_midpoint:METHOD",
    "gauss4": "lagrange_bench.integrators.methods.gauss:GAUSS4",
    "gauss6": "lagrange_bench.integrators.methods.gauss:GAUSS6",
    "gauss8": "lagrange_bench.integrators.methods.gauss:GAUSS8",
    # lie-group
    "rkmk4": "lagrange_bench.integrators.methods.lie_group:RKMK4",
    # whole-body
    "rattle": "lagrange_bench.integrators.methods.whole_body:RATTLE",
    "simo_wong": "lagrange_bench.integrators.methods.whole_body:SIMO_WONG",
    "lie_midpoint": "lagrange_bench.integrators.methods.whole_body:LIE_MIDPOINT",
    "generalized_alpha": "lagrange_bench.integrators.methods.whole_body:GENERALIZED_ALPHA",
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


BLOCKS = itertools.count(1)  # numbers of the blocks of `temporarily_registered`


class Registry(Mapping[str, Any]):
    """Name → Method, or Potential. Listing the names imports nothing.

    word : "method" or "potential", also in the name of the entry-point group. kind : the place of the type, "module:Type".
    """

    def __init__(self, word: str, built_in: Mapping[str, str], kind: str):
        self.word, self.built_in, self.group = word, built_in, f"lagrange_bench.{word}s"
        self._kind = kind
        self._loaded: dict[str, tuple[EntryPoint, Any]] = {}
        # the number of the block, and what is registered for it only; no other thread sees it
        self._in_block: ContextVar[tuple[int, Mapping[str, Any]]] = ContextVar(f"{word}s", default=(0, {}))

    @cached_property
    def kind(self) -> Any:
        """The type of what is registered."""
        return EntryPoint("", self._kind, "").load()

    @cached_property
    def _entries(self) -> dict[str, EntryPoint]:
        entries = {name: EntryPoint(name, value, self.group) for name, value in self.built_in.items()}
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
        if name in (own := self._in_block.get()[1]):
            return own[name]
        if name not in self._entries:
            close = suggestion(str(name), self._entries)
            names = ", ".join(self._entries) or f"your own, as mine:{self.word.upper()}"
            known = f"All: lagrange-bench {self.word}s" if close.endswith("?") else f"Known: {names}"
            raise KeyError(f"unknown {self.word} {name!r}{close} {known}")
        entry = self._entries[name]
        loaded = self._loaded.get(name)
        if loaded is not None and loaded[0] is entry:
            return loaded[1]
        with no_exit():
            record = entry.load()
        if not isinstance(record, self.kind):
            raise TypeError(f"{entry.value} is a {type(record).__name__}, not a lagrange_bench.{self.kind.__name__}")
        if record.name != name and ":" not in name:
            raise ValueError(f"{entry.value} calls itself {record.name!r} but is registered as {name!r}")
        self._loaded[name] = entry, record
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
        """Register records under their names while the block runs, in this thread only."""
        own = self._in_block.get()[1]
        token = self._in_block.set((next(BLOCKS), {**own, **{record.name: record for record in records}}))
        try:
            yield
        finally:
            self._in_block.reset(token)

    @property
    def state(self) -> tuple[tuple[str, ...], int]:
        """A key for caches: it differs where the names in this thread differ."""
        return tuple(self._entries), self._in_block.get()[0]

    def each(self) -> Iterator[tuple[str, Any, str]]:
        """Every name with its record and ""; or with None and the reason why the record cannot be loaded."""
        for name in self:
            try:
                yield name, self[name], ""
            except Exception as error:  # somebody else's package may raise anything, and the other names follow
                yield name, None, f"{type(error).__name__}: {error}"

    def __iter__(self) -> Iterator[str]:
        return iter({**self._entries, **self._in_block.get()[1]})

    def __len__(self) -> int:
        return len({**self._entries, **self._in_block.get()[1]})


class TopRegistry(Registry):
    """Name → NamedTop: the named tops of the bench, in a potential or not, and those of packages."""

    def __init__(self) -> None:
        super().__init__("top", {}, "lagrange_bench.integrators.problem.top:NamedTop")

    @cached_property
    def _ours(self) -> dict[str, Any]:
        from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
        from lagrange_bench.integrators.problem.top import TOPS

        return {**TOPS, **PERTURBED_TOPS}

    @cached_property
    def _entries(self) -> dict[str, EntryPoint]:
        self.built_in = dict.fromkeys(self._ours, "")  # takes the names; the tops are in `_ours`
        return super()._entries

    def __getitem__(self, name: str) -> Any:
        return self._ours[name] if name in self._ours else super().__getitem__(name)


METHODS = Registry("method", BUILT_IN, "lagrange_bench.integrators.interface:Method")
POTENTIALS = Registry("potential", POTENTIALS_BUILT_IN, "lagrange_bench.integrators.problem.potential:Potential")
NAMED_TOPS = TopRegistry()


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


def _reduced(method: Method) -> Any:
    """Pickle a registered record by its name, because its builder may be a closure, which pickle refuses."""
    entry, registered = METHODS._loaded.get(method.name, (None, None))
    if entry is not None and entry.value and registered is method:
        return find_method, (method.name,)
    return object.__reduce_ex__(method, 2)


copyreg.pickle(Method, _reduced)


def find_potential(potential: str | Any) -> Any:
    """The potential of a name in POTENTIALS or of `package.module:POTENTIAL`, or the potential itself; else ValueError."""
    if isinstance(potential, str):
        return find(potential, POTENTIALS)
    if not isinstance(potential, POTENTIALS.kind):
        raise ValueError(
            f"potential must be a name in POTENTIALS, package.module:POTENTIAL or a Potential; got {potential!r}"
        )
    return potential


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
        if not colon:
            return registry[name]
        record = getattr(import_own(path), attribute)
    except KeyError as error:
        if hint := in_own_file(name, word):
            raise ValueError(f"no {word} is registered as {name!r}{hint}") from None
        raise ValueError(str(error.args[0])) from None
    except Exception as error:  # importing somebody else's module may raise anything
        hint = _meant(name, error, registry)
        raise ValueError(f"{word} {name} cannot be loaded: {type(error).__name__}: {error}{hint}") from error
    if not isinstance(record, registry.kind):
        raise ValueError(f"{word} {name} is a {type(record).__name__}, not a lagrange_bench.{registry.kind.__name__}")
    return record


def _meant(name: str, error: Exception, registry: Registry) -> str:
    """The end of the message that `module:NAME` cannot be loaded: what was perhaps meant."""
    module = name.partition(":")[0]
    if isinstance(error, ModuleNotFoundError) and error.name == module and "." not in module:
        files = [path.stem for path in Path.cwd().glob("*.py")]
        return f"; there is no {module}.py in {Path.cwd()}{suggestion(module, files).rstrip('.')}"
    # Python 3.13 says itself what was perhaps meant
    keyword = re.search(r"(\w+)\.__init__\(\) got an unexpected keyword argument '(\w+)'$", str(error))
    if keyword and keyword[1] == registry.kind.__name__:
        return suggestion(keyword[2], inspect.signature(registry.kind).parameters).rstrip(".")
    return ""


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
