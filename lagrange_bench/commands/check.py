"""`lagrange-bench check`: test what a method claims."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from lagrange_bench.text import Answer, plain, table

if TYPE_CHECKING:
    from integrators import Method

SUMMARY = "test what a method claims"

DESCRIPTION = """\
Test what a method claims: its order, symmetry, Poisson map, invariants, and the contract of a stepper. Prints a verdict
per claim: pass, fail or not judged. A method that takes tops in a potential is tested there, too ("in a field: …"). Also for your
own method, before you publish it."""


EXAMPLES = """\
examples:
  lagrange-bench check backlund
  lagrange-bench check implicit_midpoint --quick
  lagrange-bench check my_package.my_method:METHOD     no entry point needed; the current folder is searched too

exit codes: 0 nothing fails · 1 a claim fails · 2 no such method"""


def run(options: argparse.Namespace) -> Answer:
    """Test the claims of one method; one that fails makes exit code 1."""
    from experiments.measuring import check as checks
    from integrators.registry import find_method

    method = find_method(options.method)
    verdicts = checks.check(method, quick=options.quick)
    rows = [("verdict", "claim", "measured", "bound", "how")]
    for verdict in verdicts:
        measured = "" if verdict.measured is None else f"{verdict.measured:.3g}"
        rows.append((verdict.word, verdict.claim, measured, verdict.bound, " ".join(verdict.how.split())))
    failed = [verdict.claim for verdict in verdicts if verdict.passed is False]
    held = sum(verdict.passed is True for verdict in verdicts)
    sum_up = f"{method.name} ({method.label}): {held} claims hold, {len(failed)} fail"
    sum_up += f": {', '.join(failed)}" if failed else ""
    notes = _name_taken(options.method, method)
    listed = [{**asdict(verdict), "verdict": verdict.word} for verdict in verdicts]
    data = {"method": method.name, "passed": not failed, "verdicts": plain(listed), "notes": notes}
    return Answer("\n".join([*table(rows), "", *notes, sum_up]), data, 1 if failed else 0)


def _name_taken(word: str, method: Method) -> list[str]:
    """What to tell who checks a method of their own that is called like one of the registry."""
    from integrators import METHODS

    if ":" not in word or method.name not in METHODS:
        return []
    try:
        taken = METHODS[method.name] != method
    except Exception:  # a plug-in that cannot be loaded has its name all the same
        taken = True
    return [f"the name {method.name} is taken: choose another for an entry point"] if taken else []


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "method", metavar="METHOD", help="a name (see lagrange-bench methods) or package.module:METHOD"
    )
    command.add_argument("--quick", action="store_true", help="fewer and shorter runs, for while you are developing")
