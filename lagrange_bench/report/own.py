"""The first part of a page with a user's own methods: their claims and findings, and their places among the published ones."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import pandas as pd

from lagrange_bench.experiments.drawing import style, tables
from lagrange_bench.experiments.measuring import states
from lagrange_bench.experiments.work_precision_figures import APART, TARGETS, best, useful
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.registry import BUILT_IN, METHODS, NAMED_TOPS, find_stored
from lagrange_bench.report import panels
from lagrange_bench.report.origin import Origin
from lagrange_bench.results.choice import Choice
from lagrange_bench.results.store import REFERENCE, Store

BESIDE = 4  # methods that a title names, at most


class OwnMethod(NamedTuple):
    """A method that is not the bench's, as the page shows it."""

    name: str
    label: str
    findings: pd.DataFrame  # claimed, found
    places: pd.DataFrame  # its times among the published ones


def methods(rows: Mapping[str, pd.DataFrame], source: Origin) -> list[OwnMethod]:
    """The user's own methods in the rows of all experiments. source : where the rows come from."""
    names = [name for name in _names(rows) if name not in BUILT_IN]
    if not names:
        return []
    findings, published = panels.findings(rows), useful(Store(REFERENCE).rows("work_precision"))
    timed = rows.get("work_precision", pd.DataFrame())
    found = {name: findings.get(name, []) + list(_missing(name, findings.get(name, []), source)) for name in names}
    tables = {name: pd.DataFrame(found[name], columns=["claimed", "found"]) for name in names}
    places = {name: pd.DataFrame(_places(name, timed, published)) for name in names}
    return [OwnMethod(name, style.label(name), tables[name], places[name]) for name in names]


def _missing(name: str, found: list[list[str]], source: Origin) -> Iterator[list[str]]:
    """The claims without rows, with the command that measures them; none of a method that takes no top or cannot be loaded."""
    try:
        record = find_stored(name, METHODS)
    except Exception:  # somebody else's module may raise anything
        return
    if record.takes(NAMED_TOPS["generic"].top):
        return
    claims = {f"order {record.order}": "phase"} if record.order else {}
    kept = [word for word in INVARIANTS if word in record.claims.conserves] + list(record.claims.conserves_own)
    claims |= {f"{word} kept": "drift" for word in kept}
    measured = {claim for claim, _ in found}
    for claim, experiment in claims.items():
        if claim not in measured:
            command = replace(source, choice=Choice(methods=(name,))).run(experiment)
            yield [claim, f"not measured here: {command}"]


def title(rows: Mapping[str, pd.DataFrame], own: list[OwnMethod]) -> str:
    """The title of the page: the user's own methods, and the others in the rows."""
    others = [style.label(name) for name in style.ordered(set(_names(rows)) - {method.name for method in own})]
    beside = ", ".join(others) if len(others) <= BESIDE else f"{len(others)} others"
    return ", ".join(method.label for method in own) + (f" beside {beside}" if others else "")


def _names(rows: Mapping[str, pd.DataFrame]) -> list[str]:
    named = [frame.method.dropna().unique() for frame in rows.values() if "method" in frame]
    return list(dict.fromkeys(str(name) for names in named for name in names))


def _places(name: str, rows: pd.DataFrame, published: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """A line for each top, length and error: the time, and how many of the published methods are faster."""
    if rows.empty:
        return
    for (span, state), run in rows[rows.method == name].groupby(APART, sort=False):
        good, others = useful(run), published[(published.span == span) & (published.state == state)]
        for target in TARGETS if len(others) else ():
            own, rivals = (best(runs, target, "total") for runs in (good, others))
            line = {"top": states.label(state), "length": span, "error at most": target}
            if own.empty:
                yield {**line, "place": f"not within {run.longest.iloc[0]:g} s; {len(rivals)} methods reach it"}
                continue
            time, first = own.total.iloc[0], rivals.iloc[0]
            place = f"{1 + int((rivals.total < time).sum())} of {1 + len(rivals)}"
            fastest = f"{style.label(first.method)}, {tables.show(states.rounded(1e3 * first.total, 2))} ms"
            yield {**line, "place": place, "time, ms": states.rounded(1e3 * time, 2), "fastest published": fastest}
