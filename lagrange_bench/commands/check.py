"""`lagrange-bench check`: test what a method claims."""

from __future__ import annotations

import argparse
import contextlib
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagrange_bench.arguments import location
from lagrange_bench.text import Answer, plain, table

if TYPE_CHECKING:
    from lagrange_bench.integrators import Method

SUMMARY = "test what a method claims"

RIVALS = ("rk4", "strang", "backlund")  # whom to draw a method beside, as a beginning

DESCRIPTION = """\
Test what a method claims: its order, its symmetry, whether a step is a Poisson map, its invariants; and the rules
that every stepper must follow. Prints a verdict per claim. Pass and fail are about what the method claims. "Not
claimed" has no bound: it is measured for your information. "Not judged" could not be measured, and the reason follows
the table. Drifts of invariants are relative: 1 is as large as the invariant's terms. A method that takes tops in a
potential is tested there, too ("in a field: …"). A method that cannot take its first step gets one verdict, with the
line of its code that fails.

Also for your own method, before you publish it. With --bounds, tests the drift of its invariants against a file of
bounds, too."""


EXAMPLES = """\
examples:
  lagrange-bench check backlund
  lagrange-bench check implicit_midpoint --quick
  lagrange-bench check mine:METHOD              METHOD in ./mine.py, else in an installed module of this name
  lagrange-bench check mine:METHOD --write-bounds bounds.toml     measure the drift, once
  lagrange-bench check mine:METHOD --bounds bounds.toml           test it from then on (docs/ci.md)

exit codes: 0 nothing fails · 1 a claim fails, or a bound is exceeded · 2 no such method or file"""


def run(options: argparse.Namespace) -> Answer:
    """Test the claims of one method; one that fails makes exit code 1."""
    from lagrange_bench.experiments.measuring import check as checks
    from lagrange_bench.integrators.registry import find_method

    method = find_method(options.method)
    if options.write_bounds:
        return _write(options.write_bounds, method)
    bounds = _bounds(options.bounds, method) if options.bounds else []
    verdicts = checks.check(options.method, quick=options.quick)
    if bounds and not any(verdict.claim == checks.TAKES_A_STEP for verdict in verdicts):
        from lagrange_bench.experiments.measuring import bounds as drift

        verdicts += drift.judge(method, bounds)
    rows = [("verdict", "claim", "measured", "bound", *(["how"] if options.verbose else []))]
    reasons = []
    for verdict in verdicts:
        measured = "" if verdict.measured is None else f"{verdict.measured:.3g}"
        how = " ".join(verdict.how.split())
        rows.append((verdict.word, verdict.claim, measured, verdict.bound, *([how] if options.verbose else [])))
        if verdict.word in ("fail", "not judged"):
            reasons.append(f"{verdict.word}: {verdict.claim}: {how}")
    failed = [verdict.claim for verdict in verdicts if verdict.passed is False]
    held = sum(verdict.passed is True for verdict in verdicts)
    file = _file(options.method)
    sum_up = f"{method.name} ({method.label}, {file}): {held} claims hold, {len(failed)} fail"
    sum_up += f": {', '.join(failed)}" if failed else ""
    notes = _name_taken(options.method, method)
    rivals = [name for name in RIVALS if name != method.name]
    what = "work_precision phase perturbed" if method.in_field else "work_precision phase"
    after = [] if failed else [f"lagrange-bench run {what} --methods {','.join([options.method, *rivals])}"]
    listed = [{**asdict(verdict), "verdict": verdict.word} for verdict in verdicts]
    data = {"method": method.name, "file": file, "passed": not failed, "verdicts": plain(listed)}
    data |= {"notes": notes, "next": after}
    lines = [*table(rows), "", *reasons, *notes, sum_up, *(f"next: {command}" for command in after)]
    return Answer("\n".join(lines), data, 1 if failed else 0)


def _file(name: str) -> str:
    """Where the record lies."""
    from lagrange_bench.integrators.registry import METHODS

    module = sys.modules[METHODS.module(name)]
    return module.__file__ or module.__name__


def _bounds(path: Path, method: Method) -> list[dict[str, Any]]:
    """What the file allows this method."""
    from lagrange_bench.experiments.measuring import bounds as drift

    bounds = [bound for bound in drift.read_bounds(path) if bound["method"] == method.name]
    if not bounds:
        raise ValueError(f"--bounds {path} has no bound for {method.name}: measure some with --write-bounds {path}")
    return bounds


def _write(path: Path, method: Method) -> Answer:
    """Measures the runs that the file has of this method, or the usual ones, and writes bounds on their drift."""
    from lagrange_bench.experiments.measuring import bounds as drift

    known = drift.read_bounds(path) if path.exists() else []
    plan = [bound for bound in known if bound["method"] == method.name] or drift.plan(method)
    bounds: list[dict[str, Any]] = []
    notes = []
    for run in plan:
        try:
            bounds += drift.measured(method, [run])
        except drift.Refused as error:
            notes.append(f"no bound: {error}")
    drift.write_bounds(path, bounds)
    text = "\n".join([*notes, f"written: {path}, with bounds on {len(bounds)} runs of {method.name}"])
    return Answer(text, {"method": method.name, "bounds": bounds, "notes": notes})


def _name_taken(word: str, method: Method) -> list[str]:
    """What to tell who checks a method of their own that is called like one of the registry."""
    from lagrange_bench.integrators import METHODS

    if ":" not in word or method.name not in METHODS:
        return []
    with contextlib.suppress(Exception):  # a plug-in that cannot be loaded has its name all the same
        if METHODS[method.name] == method:
            return []
    owner = METHODS.owner(method.name)
    yours = "" if method.name in METHODS.built_in else "; if that is your own, it is another copy of it"
    return [f"the name {method.name} is taken, by {owner}: choose another for an entry point{yours}"]


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "method", metavar="METHOD", help="a name (see lagrange-bench methods) or package.module:METHOD"
    )
    command.add_argument("--quick", action="store_true", help="fewer and shorter runs, for while you are developing")
    command.add_argument(
        "--verbose", action="store_true", help="say how each claim was measured, not only those that fail"
    )
    either = command.add_mutually_exclusive_group()
    text = "also test the largest drifts, in ulps, that this file allows the method"
    either.add_argument("--bounds", type=location, metavar="FILE", help=text)
    text = "measure the drifts and write twice what was found into this file, and test nothing"
    either.add_argument("--write-bounds", type=location, metavar="FILE", help=text)
