"""Which source code computed a cell. Each cell is stored with digests of files.

`sources` is the digest of what computes: all files of `integrators/` and of `experiments/measuring/`, the file of the experiment,
and those of a method or a potential of the user's own. `own_sources` is the digest of the last alone: if it changed, a run
computes the cell again. Of a module in a package all files of the package count. What a module of the user's imports from
elsewhere does not count.

The process that computes a cell takes the digests before it begins, and afterwards checks that no file was edited.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import declared, installed
from lagrange_bench.support.source_digest import BENCH, IMPORTED_SOURCES, PACKAGE, SourceDigest, Sources, files_of

COMPUTING = (PACKAGE / "integrators", PACKAGE / "experiments" / "measuring")  # folders
SAME, OTHER, UNKNOWN, OUTDATED = "same", "other", "unknown", "outdated"
WORDS = {
    OUTDATED: "computed with another VERSION of the experiment than this",
    OTHER: "computed with other source code than this",
    UNKNOWN: "computed with source code that was not recorded",
}


class CellSources(NamedTuple):
    """The source code that computes a cell; None where it is not known."""

    all: SourceDigest | None
    own: SourceDigest | None  # of the user's own method and potential; None also if there is none

    @property
    def digests(self) -> dict[str, str | None]:
        """The fields of a record: `sources`, and `own_sources` if there are any."""
        own_digest = {"own_sources": self.own.digest} if self.own else {}
        return {"sources": self.all.digest if self.all else None, **own_digest}

    @property
    def edited(self) -> bool:
        """Whether a file was edited since it was read."""
        return self.all is not None and self.all.edited


def of_cell(experiment: str, cell: Mapping[str, Any], sources: Sources = IMPORTED_SOURCES) -> CellSources:
    """The source code that computes a cell.

    sources : the files as this process read them; `Sources()` takes them as they are now.
    """
    method, potential = (name if isinstance(name, str) else None for name in map(cell.get, ("method", "potential")))
    names = experiment, method, potential
    if names not in sources.known:
        sources.known[names] = _of_names(sources, *names)
    return sources.known[names]  # type: ignore[no-any-return]


def _of_names(sources: Sources, experiment: str, method: str | None, potential: str | None) -> CellSources:
    try:
        bench = [*COMPUTING, *_files_of_experiment(experiment)]
        sources.code(*bench)  # is read before any of it is imported
        own_files = _own_files(method, potential)
        return CellSources(sources.code(*bench, *own_files), sources.code(*own_files) if own_files else None)
    except Exception:  # a plug-in that is not here, or that cannot be read
        return CellSources(None, None)


def _own_files(method: str | None, potential: str | None) -> list[Path]:
    """The files of a method and a potential of the user's own; none of those of the bench."""
    from lagrange_bench.integrators.registry import METHODS, POTENTIALS

    named = ((method, METHODS), (potential, POTENTIALS))
    modules = {registry.module(name) for name, registry in named if name is not None and name not in registry.built_in}
    return [path for module in sorted(modules) if not module.startswith(f"{BENCH}.") for path in files_of(module)]


def _files_of_experiment(name: str) -> list[Path]:
    if name in EXPERIMENTS:
        place = PACKAGE / "experiments" / name
        return [path for path in (place, place.with_suffix(".py")) if path.exists()]
    return files_of(name if "." in name else installed()[name].module)


def judge(record: Mapping[str, Any], sources: Sources) -> str:
    """Whether a stored cell was computed by the present sources: SAME, OTHER, OUTDATED or UNKNOWN."""
    present = declared(record["experiment"], "VERSION")
    if present is None:
        return UNKNOWN
    if present != record["version"]:
        return OUTDATED
    return compared(record.get("sources"), of_cell(record["experiment"], record["cell"], sources).digests["sources"])


def compared(one: str | None, other: str | None) -> str:
    """SAME or OTHER; UNKNOWN if a digest is missing."""
    if one is None or other is None:
        return UNKNOWN
    return SAME if one == other else OTHER


def summary(ages: Mapping[str, int]) -> str:
    """How many stored cells do not come from the present sources, in words; "" if all do. ages : see `judge`."""
    total = sum(ages.values())
    return "; ".join(f"{ages[age]} of {total} stored cells {words}" for age, words in WORDS.items() if ages.get(age))
