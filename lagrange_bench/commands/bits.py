"""`lagrange-bench bits`: are the kernels' bits those of the golden file?"""

from __future__ import annotations

import argparse
from dataclasses import asdict

from lagrange_bench.integrators.words import suggestion
from lagrange_bench.text import Answer, table

SUMMARY = "are the kernels' bits the same here"

DESCRIPTION = """\
Do the compiled kernels compute on this machine what they computed on another, to the last bit? Prints a verdict for
each: same, differs at a place, or not written down. Adaptive methods and libraries promise no bits and are left out."""


EXAMPLES = """\
examples:
  lagrange-bench bits                           every kernel, a million steps on three tops: a minute
  lagrange-bench bits backlund gauss4           two of them
  lagrange-bench bits my_method --write         once, for a new method of the bench; then commit golden.json
  lagrange-bench bits --quick --json | jq '.verdicts[] | select(.passed == false) | .kernel'

exit codes: 0 nothing differs · 1 a kernel differs · 2 no such kernel"""


def add_options(command: argparse.ArgumentParser) -> None:
    text = "a method, with or without “ compensated” (default: all that are compiled)"
    command.add_argument("kernels", nargs="*", metavar="KERNEL", help=text)
    command.add_argument("--quick", action="store_true", help="ten thousand steps instead of a million")
    text = "write the bits of these kernels into the golden file: for a method that is new, or was changed on purpose"
    command.add_argument("--write", action="store_true", help=text)
    command.add_argument("--quiet", action="store_true", help="print only what differs or is not written down")


def run(options: argparse.Namespace) -> Answer:
    """Compare the bits of compiled kernels with those written down; exit code 1 if any differ."""
    from lagrange_bench.experiments.measuring import bits as machine
    from lagrange_bench.integrators import METHODS

    for name in options.kernels:
        if (method := name.removesuffix(" compensated")) not in METHODS:
            raise ValueError(f"unknown kernel {name!r}{suggestion(method, METHODS)} See lagrange-bench methods")
    golden, only = machine.golden(), options.kernels or None
    if options.write and (only is None or options.quick):
        raise ValueError("--write goes with the names of kernels, and without --quick")
    found = machine.measured(machine.COUNTS[1 if options.quick else -1], only)
    if strange := set(only or ()) - {word for kernel in found for word in (kernel, kernel.partition(" ")[0])}:
        raise ValueError(f"{sorted(strange)[0]} has no kernel of its own whose bits could be compared")
    if options.write:
        machine.write(found)
        golden = machine.golden()
    verdicts = machine.compare(golden, found)
    rows, counts = [("kernel", "hashes", "verdict")], dict.fromkeys((True, False, None), 0)
    for verdict in verdicts:
        counts[verdict.passed] += 1
        word = {True: "same", False: f"differs at {verdict.first}", None: "not written down"}[verdict.passed]
        if not (options.quiet and verdict.passed):
            rows.append((verdict.kernel, str(verdict.compared), word))
    sum_up = f"{counts[True]} the same, {counts[False]} differ, {counts[None]} not written down"
    data = {"same": not counts[False], "verdicts": [asdict(verdict) for verdict in verdicts]}
    lines = [*table(rows), "", sum_up] if len(rows) > 1 else [sum_up]
    return Answer("\n".join(lines), data, 1 if counts[False] else 0)
