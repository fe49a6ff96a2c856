"""The named tops.

List the named tops: weight parameter alpha, initial state (J1, J2, J3, x1, x2, x3), kind of motion and nutation period, the time
that the axis takes to nod. For a top in a potential, list the parameters of the potential and what the motion conserves.

The equations are J' = alpha e3 × x, x' = J × x, with e3 upwards. You choose the units; alpha has the units of J²/x. A period is
inf (null in JSON) on the separatrix, and where x3 is constant and unstable. lagrange-bench potentials has the formulas of
potentials.

For a top of your own, write MINE = NamedTop(…) in a file my_tops.py and give --top my_tops:MINE. A top of your package joins this
list through the entry-point group lagrange_bench.tops (name = package.module:TOP).

examples:
  lagrange-bench tops --verbose
  lagrange-bench tops --json | jq '.[] | select(.regime == "elliptic") | .name'
  lagrange-bench integrate --top near_separatrix --h 0.1 --steps 1000
  lagrange-bench integrate --top magnet --method blanes_moan4 --h 0.1 --steps 1000
"""

import argparse
from typing import Any

from lagrange_bench.commands.arguments import loaded
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.support.output import Answer, table


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.integrators import INVARIANTS
    from lagrange_bench.integrators.registry import NAMED_TOPS
    from lagrange_bench.integrators.truth import exact

    tops, broken = loaded(NAMED_TOPS)
    data: list[dict[str, Any]] = []
    rows = [("name", "alpha", "state J1,J2,J3,x1,x2,x3", "motion", "nutation")]
    inside = [("name", "alpha", "state J1,J2,J3,x1,x2,x3", "potential", "parameters", "conserves")]
    for named in tops.values():
        start = named.name, f"{named.alpha:g}", ",".join(f"{value:.10g}" for value in named.y0)
        facts = {"name": named.name, "alpha": named.alpha, "state": list(named.y0)}
        facts |= {"label": named.label, "note": named.note}
        if kinds.uniform(named.top):
            kind, period = exact.regime(named.top, named.state), exact.nutation_period(named.top, named.state)
            rows.append((*start, kind, f"{period:.4g}"))
            data.append({**facts, "regime": kind, "nutation_period": period})
            continue
        potential, parameters = named.top.potential.name, named.top.parameters
        conserved = [name for name in INVARIANTS if name in named.top.conserved]
        numbers = ",".join(f"{value:.10g}" for value in parameters)
        inside.append((*start, potential, numbers, " ".join(conserved)))
        data.append({**facts, "potential": potential, "parameters": list(parameters), "conserves": conserved})
    lines = [*table(rows), "", "in a potential:", *table(inside)]
    if options.verbose:
        lines += ["", *table([("name", "note"), *((facts["name"], facts["note"]) for facts in data)])]
    lines += [f"{facts['name']}: cannot be loaded: {facts['error']}" for facts in broken]
    return Answer("\n".join(lines), data + broken)


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--verbose", action="store_true", help="also say what is special about each")
