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
        return (not self.methods or cell.get("method") in self.methods) and (not self.tops or _top(cell) in self.tops)

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
        from lagrange_bench.integrators.own_modules import in_own_file
        from lagrange_bench.integrators.registry import NAMED_TOPS

        cells = list(cells)
        known_names = {"method": {cell.get("method") for cell in cells}, "top": set(map(_top, cells))}
        for flag, word, names in (
            ("--methods", "method", self.methods),
            ("--tops", "top", self.tops),
            ("--highlight", "method", self.highlight),
        ):
            known = sorted(name for name in known_names[word] if isinstance(name, str))
            if unknown := [name for name in names if name not in known]:
                close = (word == "method" and in_own_file(unknown[0], word)) or suggestion(unknown[0], known)
                if word == "method" and (why := _refusal(unknown[0], known_names["top"])):
                    raise ValueError(f"{flag}: {why}")
                if word == "top":
                    known = [name for name in known if name in NAMED_TOPS]  # those that are drawn are too many to list
                if word == "top" and unknown[0] in NAMED_TOPS:
                    close = f"; perhaps with --profile full, and from Python with tops={unknown[0]!r}."
                more = f" Known: {', '.join(known)}" if close.endswith(".") and known else ""
                raise ValueError(f"{flag}: no cell here has the {word} {unknown[0]!r}{close}{more}")
        if not any(map(self.takes, cells)):
            raise ValueError(f"{self.words.strip()}: no cell here has such a method on such a top")


ALL = Choice()


def _refusal(method: str, tops: Iterable[Any]) -> str | None:
    """Why a method has no cells, if all these tops are in a potential that it does not take."""
    from lagrange_bench.integrators import METHODS, PERTURBED_TOPS

    if method not in METHODS or not all(top in PERTURBED_TOPS for top in tops):
        return None
    return next(filter(None, (METHODS[method].takes(PERTURBED_TOPS[top].top) for top in sorted(tops))), None)


def _top(cell: Mapping[str, Any]) -> Any:
    return cell.get("state")
