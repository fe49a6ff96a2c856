"""Which source code computed a cell. Each cell is stored with a digest of the files that its rows depend on.

The files are those of the experiment, the method and the potential, and all that these import (`support.source_digest`).
If an experiment names a method in quotes, the file of that method counts for all its cells. The process that computes a cell
takes the digest before it begins, and afterwards checks that no file was edited. What decides about no row does not count:
comments and docstrings, how figures look, how cells are run, and the list of methods.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import declared, installed
from lagrange_bench.support.source_digest import BENCH, IMPORTED_SOURCES, SourceDigest, Sources

DEFAULT = "backlund"  # the method of a cell that names none
QUOTED = re.compile(rb"""["'](\w+)["']""")

SAME, OTHER, UNKNOWN, OUTDATED = "same", "other", "unknown", "outdated"
WORDS = {
    OUTDATED: "with another VERSION of the experiment than this",
    OTHER: "with other source code than this",
    UNKNOWN: "with source code that was not recorded",
}


def of_cell(experiment: str, cell: Mapping[str, Any], sources: Sources = IMPORTED_SOURCES) -> str | None:
    """The digest of the source code that computes a cell; None if it is not known. sources : see `code_of_cell`."""
    return code_of_cell(experiment, cell, sources).digest


def code_of_cell(experiment: str, cell: Mapping[str, Any], sources: Sources = IMPORTED_SOURCES) -> SourceDigest:
    """The source code that computes a cell.

    sources : the files as this process read them; `Sources()` takes them as they are now.
    """
    method, potential = (name if isinstance(name, str) else None for name in map(cell.get, ("method", "potential")))
    asked = experiment, method, potential
    if asked not in sources.known:
        try:
            sources.known[asked] = _code(sources, *asked)
        except Exception:  # a plug-in that is not here, or that cannot be read
            sources.known[asked] = SourceDigest(None)
    return sources.known[asked]


def _code(sources: Sources, experiment: str, method: str | None, potential: str | None) -> SourceDigest:
    from lagrange_bench.integrators.registry import METHODS, POTENTIALS

    modules = {_module(experiment)}
    for name, registry in ((method or DEFAULT, METHODS), (potential, POTENTIALS)):
        if name is not None and (":" in name or name in set(registry)):  # compares names, loads nothing
            modules.add(registry.module(name))
    while True:
        files = sources.files(modules)
        texts = (sources.read(path) for name, path in files.items() if not name.startswith(f"{BENCH}.integrators."))
        named = {METHODS.module(word) for word in frozenset().union(*map(_quoted, texts)) & set(METHODS)}
        if named <= modules:
            return sources.code(modules, words=False)
        modules |= named


def _module(experiment: str) -> str:
    if experiment in EXPERIMENTS:
        return f"lagrange_bench.experiments.{experiment}"
    return experiment if "." in experiment else installed()[experiment].module


@cache
def _quoted(source: bytes) -> frozenset[str]:
    return frozenset(word.decode() for word in QUOTED.findall(source))


def judge(record: Mapping[str, Any], sources: Sources) -> str:
    """Whether a stored cell was computed by the present sources: SAME, OTHER, OUTDATED or UNKNOWN."""
    here = declared(record["experiment"], "VERSION")
    if here is None:
        return UNKNOWN
    if here != record["version"]:
        return OUTDATED
    return compared(record.get("sources"), of_cell(record["experiment"], record["cell"], sources))


def compared(one: str | None, other: str | None) -> str:
    """SAME or OTHER; UNKNOWN if a digest is missing, or if one is of the older, shorter kind."""
    if one is None or other is None or len(one) != len(other):
        return UNKNOWN
    return SAME if one == other else OTHER


def summary(ages: Mapping[str, int]) -> str:
    """How many stored cells do not come from the present sources, as a sentence; "" if all do. ages : see `judge`."""
    counts = {words: ages[age] for age, words in WORDS.items() if ages.get(age)}
    return "; ".join(f"{n} stored cell{' was' if n == 1 else 's were'} computed {words}" for words, n in counts.items())
