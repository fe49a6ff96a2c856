"""The integrators and what they claim.

List the integrators, here called methods, and their claims: order, whether a step is symmetric and a Poisson map, and which
invariants are conserved up to round-off. H is the energy, J3 the vertical angular momentum, C1 = |x|², C2 = x·J. With --top,
say which methods take this top, and why the others do not.

examples:
  lagrange-bench methods
  lagrange-bench methods --archive              also the methods that figures and quick runs leave out
  lagrange-bench methods --verbose              with sources, options (for integrate --option) and families
  lagrange-bench methods --top weak_tide        methods for this top, and the invariants that they conserve on it
  lagrange-bench methods --json | jq -r '.[] | select(.poisson) | .name'

A method of your own package joins the list through the entry-point group lagrange_bench.methods (name = package.module:METHOD).
lagrange-bench check tests its claims.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from lagrange_bench.commands.arguments import loaded
from lagrange_bench.support.output import Answer, table


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.integrators import INVARIANTS, METHODS, available
    from lagrange_bench.integrators.interface import needed
    from lagrange_bench.integrators.registry import ARCHIVE, NAMED_TOPS, find

    problem = find(options.top or "generic", NAMED_TOPS).top
    methods, broken = loaded(METHODS)
    data: list[dict[str, Any]] = []
    for name, method in methods.items():
        fields = ("label", "family", "order", "control", "requires", "source")
        claims = {"name": name, **{field: getattr(method, field) for field in fields}}
        claims |= {"symmetric": method.claims.symmetric, "poisson": method.claims.poisson}
        refuses = method.takes(problem)
        conserves = method.claims.conserves if refuses else problem.conserved_by(method)
        claims["conserves"] = [invariant for invariant in INVARIANTS if invariant in conserves]
        claims |= {"available": available(method), "options": list(method.options), "archived": name in ARCHIVE}
        if options.top:
            claims["refuses"] = refuses
        elif refuses:
            claims["takes"] = needed(method.needs)
        data.append(claims)
    shown = [claims for claims in data if options.archive or options.top or not claims["archived"]]
    usable = [claims for claims in shown if not claims.get("refuses")]
    header = ("name", "label", "order", "symmetric", "Poisson", "conserves")
    lines = [*table([header, *map(_row, usable)]), *_notes(shown, usable)]
    lines += [f"{facts['name']}: cannot be loaded: {facts['error']}" for facts in broken]
    if len(shown) < len(data):
        lines.append(f"{len(data) - len(shown)} more are in the archive: lagrange-bench methods --archive")
    if options.verbose:
        facts = [(c["name"], c["family"], c["control"], ", ".join(c["options"]) or "none", c["source"]) for c in usable]
        lines += ["", *table([("name", "family", "control", "options", "source"), *facts])]
    return Answer("\n".join(lines), data + broken)


def _row(claims: dict[str, Any]) -> tuple[str, ...]:
    order = "exact" if claims["order"] is None else str(claims["order"])
    words = {True: "yes", False: "no", None: "?"}
    symmetric, poisson = (words[claims[field]] for field in ("symmetric", "poisson"))
    return claims["name"], claims["label"], order, symmetric, poisson, " ".join(claims["conserves"]) or "-"


def _notes(shown: list[dict[str, Any]], usable: list[dict[str, Any]]) -> list[str]:
    """One line for each missing package, for each kind of problem, and for each reason why methods do not take the top."""
    from lagrange_bench.integrators.registry import how_to_get

    missing = _names((claims["requires"], claims["name"]) for claims in usable if not claims["available"])
    notes = [f"{names}: {how_to_get(package)}" for package, names in missing.items()]
    others = _names((claims["takes"], claims["name"]) for claims in usable if "takes" in claims)
    notes += [line for problems, names in others.items() for line in (f"only for {problems}:", f"  {names}")]
    refusing = ((claims["refuses"], claims["name"]) for claims in shown if claims.get("refuses"))
    reasons = _names((reason.removeprefix(name).strip(), name) for reason, name in refusing)
    return notes + [f"left out: {names}: {reason}" for reason, names in reasons.items()]


def _names(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """The names in pairs (word, name) of each word, in a row."""
    groups = defaultdict(list)
    for word, name in pairs:
        groups[word].append(name)
    return {word: ", ".join(names) for word, names in groups.items()}


def add_options(command: argparse.ArgumentParser) -> None:
    text = "only methods that take this top: a name, see lagrange-bench tops, or package.module:TOP"
    command.add_argument("--top", metavar="NAME", help=text)
    text = "also the methods of the archive, which quick runs and figures of many methods leave out"
    command.add_argument("--archive", action="store_true", help=text)
    command.add_argument("--verbose", action="store_true", help="also print each method's source, options and family")
