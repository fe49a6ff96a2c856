"""A choice of cells: some methods, some tops. `run`, the store and the figures take one."""

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lagrange_bench.support.words import suggestion


@dataclass(frozen=True)
class Choice:
    """Names of methods and tops; no names mean all. A cell without a method is left out if methods are named; so with tops."""

    methods: tuple[str, ...] = ()
    tops: tuple[str, ...] = ()
    highlight: tuple[str, ...] = ()  # methods that are drawn with the reserved look, as plug-ins are
    archive: bool = False  # whether figures of many methods show those of the archive, too

    def __bool__(self) -> bool:
        """Whether the choice leaves any cell out."""
        return bool(self.methods or self.tops)

    @property
    def words(self) -> str:
        """The choice as options of a command."""
        options = {"--methods": self.methods, "--tops": self.tops, "--highlight": self.highlight}
        words = "".join(f" {flag} {shlex.quote(','.join(names))}" for flag, names in options.items() if names)
        return words + " --archive" * self.archive

    def takes(self, cell: Mapping[str, Any]) -> bool:
        """Whether a cell belongs to the choice."""
        choices = (self.methods, "method"), (self.tops, "state")
        return all(not names or cell.get(field) in names for names, field in choices)

    def include(self) -> None:
        """Load the methods from the user's own files, `module:NAME`. ValueError if one cannot be loaded."""
        from lagrange_bench.integrators.registry import METHODS

        for name in (*self.methods, *self.highlight):
            if ":" in name or name.endswith(".py"):
                METHODS.include(name)

    def check(self, cells: Iterable[Mapping[str, Any]]) -> None:
        """ValueError if no cell has one of the names, or if the choice leaves no cell: otherwise nobody would notice."""
        if not (self or self.highlight):
            return
        cells = list(cells)
        methods, tops = ({cell.get(field) for cell in cells} for field in ("method", "state"))
        for flag, names in (("--methods", self.methods), ("--highlight", self.highlight)):
            if unknown := [name for name in names if name not in methods]:
                raise ValueError(f"{flag}: {_no_method(unknown[0], methods, tops)}")
        if unknown := [name for name in self.tops if name not in tops]:
            raise ValueError(f"--tops: {_no_top(unknown[0], tops)}")
        if not any(map(self.takes, cells)):
            raise ValueError(f"{self.words.strip()}: no cell here has such a method on such a top")


ALL = Choice()


def _no_method(name: str, methods: Iterable[Any], tops: Iterable[Any]) -> str:
    """The message for a method that no cell has. If it takes no potential of these tops, that is the reason."""
    from lagrange_bench.integrators import METHODS, PERTURBED_TOPS
    from lagrange_bench.integrators.own_modules import in_own_file

    fields = sorted(top for top in tops if top in PERTURBED_TOPS)
    if name in METHODS and fields and "generic" not in tops:
        reasons = (METHODS[name].takes(PERTURBED_TOPS[top].top) for top in fields)
        if reason := next(filter(None, reasons), None):
            return reason
    known = sorted(method for method in methods if isinstance(method, str))
    return _no_cell("method", name, in_own_file(name, "method") or suggestion(name, known), known)


def _no_top(name: str, tops: Iterable[Any]) -> str:
    """The message for a top that no cell has. Tops that are drawn at random are too many to list."""
    from lagrange_bench.integrators.problem.examples import is_drawn
    from lagrange_bench.integrators.registry import NAMED_TOPS

    known = sorted(top for top in tops if isinstance(top, str) and not is_drawn(top))
    elsewhere = f"; perhaps with --profile full, and from Python with tops={name!r}."
    close = elsewhere if name in NAMED_TOPS else suggestion(name, known)
    return _no_cell("top", name, close, known)


def _no_cell(word: str, name: str, close: str, known: list[str]) -> str:
    more = f" Known: {', '.join(known)}" if close.endswith(".") and known else ""
    return f"no cell here has the {word} {name!r}{close}{more}"
