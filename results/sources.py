"""Which source code computed a cell: a digest of the files its rows come from, stored with them.

These are the file of the experiment, that of the cell's method and that of its potential, and what these import, as
`imported` finds it. Of the methods that an experiment names in quotes the files count for all of its cells. The process that
computes a cell takes the digest before it begins, and looks afterwards whether a file was edited. What a figure looks like,
how cells are run, and which methods there are, decide about no row and do not count.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.catalogue import declared, installed
from lagrange_bench.support.source_digest import BENCH, IMPORTED_SOURCES, SourceDigest, Sources

DEFAULT = "backlund"  # the method of a cell that names none, as of `lagrange_bench.prepare`
QUOTED = re.compile(rb"""["'](\w+)["']""")

SAME, OTHER, UNKNOWN, OUTDATED = "same", "other", "unknown", "outdated"
WORDS = {
    OUTDATED: "with another VERSION of the experiment than this",
    OTHER: "with other source code than this",
    UNKNOWN: "with source code that was not recorded",
}


def of_cell(experiment: str, cell: Mapping[str, Any], sources: Sources = IMPORTED_SOURCES) -> str | None:
    """Digest of the source code that computes a cell; None if it is not known. sources : see `code_of_cell`."""
    return code_of_cell(experiment, cell, sources).digest


def code_of_cell(experiment: str, cell: Mapping[str, Any], sources: Sources = IMPORTED_SOURCES) -> SourceDigest:
    """The source code that computes a cell.

    sources : as this process read them; `Sources()` for the files as they are now.
    """
    method, potential = (name if isinstance(name, str) else None for name in map(cell.get, ("method", "potential")))
    asked = experiment, method, potential
    if asked not in sources.known:
        try:
            sources.known[asked] = _code(sources, *asked)
        except Exception:  # somebody else's, and not here, or not fit to be read
            sources.known[asked] = SourceDigest(None)
    return sources.known[asked]


def _code(sources: Sources, experiment: str, method: str | None, potential: str | None) -> SourceDigest:
    from lagrange_bench.integrators.registry import METHODS, POTENTIALS

    modules = {_module(experiment)}
    for name, registry in ((method or DEFAULT, METHODS), (potential, POTENTIALS)):
        if name is not None and (":" in name or name in set(registry)):  # the names only: nothing is loaded
            modules.add(registry.module(name))
    while True:
        files = sources.files(modules)
        texts = (sources.read(path) for name, path in files.items() if not name.startswith(f"{BENCH}.integrators."))
        named = {METHODS.module(word) for word in frozenset().union(*map(_quoted, texts)) & set(METHODS)}
        if named <= modules:
            return sources.code(modules)
        modules |= named


def _module(experiment: str) -> str:
    if experiment in EXPERIMENTS:
        return f"lagrange_bench.experiments.{experiment}"
    return experiment if "." in experiment else installed()[experiment].module


@cache
def _quoted(source: bytes) -> frozenset[str]:
    return frozenset(word.decode() for word in QUOTED.findall(source))


def judge(record: Mapping[str, Any], sources: Sources) -> str:
    """Whether a stored cell was computed by the sources that are here: SAME, OTHER, OUTDATED or UNKNOWN."""
    here = declared(record["experiment"], "VERSION")
    if here is None:
        return UNKNOWN
    if here != record["version"]:
        return OUTDATED
    return compared(record.get("sources"), of_cell(record["experiment"], record["cell"], sources))


def compared(one: str | None, other: str | None) -> str:
    """SAME, OTHER, or UNKNOWN if either is not known or they are digests of different kinds: older ones are shorter."""
    if one is None or other is None or len(one) != len(other):
        return UNKNOWN
    return SAME if one == other else OTHER


def summary(ages: Mapping[str, int]) -> str:
    """How many stored cells are not known to come from the sources that are here; empty if none. ages : see `judge`."""
    counts = {words: ages[age] for age, words in WORDS.items() if ages.get(age)}
    return "; ".join(f"{n} stored cell{' was' if n == 1 else 's were'} computed {words}" for words, n in counts.items())
