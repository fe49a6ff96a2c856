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

    def __bool__(self) -> bool:
        """Whether the choice leaves any cell out."""
        return bool(self.methods or self.tops)

    @property
    def words(self) -> str:
        """The choice as options of a command."""
        options = {"--methods": self.methods, "--tops": self.tops}
        return "".join(f" {flag} {shlex.quote(','.join(names))}" for flag, names in options.items() if names)

    def takes(self, cell: Mapping[str, Any]) -> bool:
        """Whether a cell belongs to the choice."""
        choices = (self.methods, "method"), (self.tops, "state")
        return all(not names or cell.get(field) in names for names, field in choices)

    def include(self) -> None:
        """Load the methods from the user's own files, `module:NAME`. ValueError if one cannot be loaded."""
        from lagrange_bench.integrators.registry import METHODS

        for name in self.methods:
            if ":" in name:
                METHODS.include(name)

    def check(self, cells: Iterable[Mapping[str, Any]]) -> None:
        """ValueError if no cell has one of the names, or if the choice leaves no cell: otherwise nobody would notice."""
        if not self:
            return
        cells = list(cells)
        filters = ("--methods", self.methods, "method", "method"), ("--tops", self.tops, "top", "state")
        for flag, names, word, field in filters:
            known = {str(cell[field]) for cell in cells if cell.get(field) is not None}
            for name in names:
                if name not in known:
                    raise ValueError(f"{flag}: no cell here has the {word} {name!r}{_advice(name, known)}")
        if not any(map(self.takes, cells)):
            raise ValueError(f"{self.words.strip()}: no cell here has such a method on such a top")


ALL = Choice()


def _advice(name: str, known: Iterable[str]) -> str:
    """What may be meant by a name that no cell has. Tops that are drawn at random are too many to list."""
    from lagrange_bench.integrators.problem.examples import is_drawn

    names = sorted(name for name in known if not is_drawn(name))
    advice = suggestion(name, names)
    return f"{advice} Known: {', '.join(names)}" if advice.endswith(".") and names else advice
