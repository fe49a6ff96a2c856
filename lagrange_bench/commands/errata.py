"""Errata of the paper, printed and corrected.

For readers of the paper that the Bäcklund methods come from (Kuznetsov, Petrera, Ragnisco 2004). List its errata: wrong formulas,
and wrong sentences beside right formulas. Each is evaluated at random points, as printed and as corrected. A residual says by how
much it fails: 0, but for rounding, if it is right.

examples:
  lagrange-bench errata
  lagrange-bench errata --points 100
  lagrange-bench errata --json | jq -r '.[] | select(.section == "5.5") | .corrected_text'

alpha, J1 … x3, λ, μ, x, X are as in the paper; J̃ is the image of J, ℓ = x·J, C1 = |x|². The corrected formulas are the modules
of lagrange_bench.integrators.paper.
"""

import argparse

from lagrange_bench.commands.arguments import positive
from lagrange_bench.support.output import Answer, table


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments.measuring import errata as paper

    errata = paper.measure(options.points)
    rows = [("section", "equation", "wrong", "residual", "", "statement")]
    for e in errata:
        wrong = "sentence" if e.prose else "formula"
        rows.append((e.section, e.equation, wrong, f"{e.printed:.1e}", "printed", e.printed_text))
        rows.append(("", "", "", f"{e.corrected:.1e}", "corrected", e.corrected_text))
    sum_up = f"{paper.count(errata)}; at {options.points} random points each: "
    sum_up += "the smallest residual as printed, the largest as corrected"
    return Answer("\n".join([*table(rows), "", sum_up]), errata)


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--points", type=positive, default=8, metavar="N", help="random points for each (default: 8)")
