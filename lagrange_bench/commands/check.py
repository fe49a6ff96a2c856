"""Test what a method claims.

For authors of integrators, here called methods. It tests each claim of a method: its order, its symmetry, its invariants, and
whether a step is a Poisson map. It also tests the rules that every method must follow. It prints one verdict for each:

  pass, fail    the claim is true, or false
  not claimed   it was measured for your information; there is no bound
  not judged    it could not be measured; the reason follows the table

"Bound" says which "measured" values are allowed. A drift, the change of an invariant, is relative: 1 is as large as the terms of
the invariant. "Largest at" names the top and the step with the largest value; steps are in units of the top's time
scale. A method that takes tops in a potential, or on a vibrating pivot, is tested there, too ("in a field: …"). If a method
cannot take its first step, the only verdict shows the line that fails, or what Numba says.

With --problem the claims are tested only on that problem, at a state and near it. To test bounds on drift in your own tests, see
docs/ci.md.

examples:
  lagrange-bench check backlund
  lagrange-bench check implicit_midpoint --quick
  lagrange-bench check mine:METHOD              METHOD in ./mine.py, else in an installed module of this name
  lagrange-bench check gauss6 --problem mine:PROBLEM --state 0.3,-0.4,1.2

exit codes: 0 nothing fails · 1 a claim fails · 2 no such method or file
"""

import argparse
import sys
from dataclasses import asdict

from lagrange_bench.commands.arguments import numbers, own_problem, refuse
from lagrange_bench.support.output import Answer, table

RIVALS = ("rk4", "strang", "backlund")  # methods to compare with at first


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments.measuring import check as checks
    from lagrange_bench.integrators.registry import METHODS, find_method

    if options.problem is None:
        refuse(options, ("state",), "belongs to --problem")
    method = find_method(options.method)
    problem = None if options.problem is None else own_problem(options.problem, options.state)[0]
    verdicts = checks.check(options.method, quick=options.quick, problem=problem, y0=options.state)
    rows, reasons = [("verdict", "claim", "measured", "bound", "how" if options.verbose else "largest at")], []
    for verdict in verdicts:
        measured = "" if verdict.measured is None else f"{verdict.measured:.3g}"
        evidence = " ".join(verdict.how.split())
        last = evidence if options.verbose else (verdict.at if verdict.measured else "")
        rows.append((verdict.word, verdict.claim, measured, verdict.bound, last))
        if verdict.word in ("fail", "not judged"):
            reasons.append(f"{verdict.word}: {verdict.claim}: {evidence}")
    failed = [verdict.claim for verdict in verdicts if verdict.passed is False]
    true = sum(verdict.passed is True for verdict in verdicts)
    module = sys.modules[METHODS.module(options.method)]
    file = module.__file__ or module.__name__
    sum_up = f"{method.name} ({method.label}, {file}): {true} claims hold, {len(failed)} fail"
    sum_up += f": {', '.join(failed)}" if failed else ""
    rivals = [name for name in RIVALS if name != method.name]
    experiments = "work_precision phase" if method.needs == "uniform" else "work_precision phase perturbed"
    command = f"lagrange-bench run {experiments} --methods {','.join([options.method, *rivals])}"
    after = [] if failed or options.problem else [command]
    records = [{**asdict(verdict), "verdict": verdict.word} for verdict in verdicts]
    data = {"method": method.name, "file": file, "passed": not failed, "verdicts": records, "next": after}
    lines = [*table(rows), "", *reasons, sum_up, *(f"next: {command}" for command in after)]
    return Answer("\n".join(lines), data, 1 if failed else 0)


def add_options(command: argparse.ArgumentParser) -> None:
    text = "a name (see lagrange-bench methods) or package.module:METHOD"
    command.add_argument("method", metavar="METHOD", help=text)
    text = "test the claims on this problem of your own, with --state"
    command.add_argument("--problem", metavar="package.module:PROBLEM", help=text)
    command.add_argument("--state", type=numbers, metavar="y1,y2,…", help="a state of the problem, for --problem")
    command.add_argument("--quick", action="store_true", help="fewer and shorter runs, while you are developing")
    text = "say how each claim was measured, not only the claims that fail"
    command.add_argument("--verbose", action="store_true", help=text)
