"""`lagrange-bench tops`: the named tops."""

from __future__ import annotations

import argparse

from lagrange_bench.text import Answer, plain, table

SUMMARY = "the named tops"

DESCRIPTION = """\
List the named tops: weight parameter alpha, initial state (J1, J2, J3, x1, x2, x3), kind of motion, nutation period."""


EXAMPLES = """\
The equations are J' = alpha e3 × x, x' = J × x; units are yours, alpha has those of J²/x. A period is inf where x3 is
constant and unstable, or on the separatrix (null in JSON).

examples:
  lagrange-bench tops
  lagrange-bench tops --json | jq '.[] | select(.regime == "elliptic") | .name'
  lagrange-bench integrate --top near_separatrix --h 0.1 --steps 1000"""


def run(options: argparse.Namespace) -> Answer:
    """The named tops."""
    from integrators import TOPS
    from integrators.truth import exact

    data, rows = [], [("name", "alpha", "state J1,J2,J3,x1,x2,x3", "motion", "nutation", "note")]
    for named in TOPS.values():
        kind, period = exact.regime(named.top, named.state), exact.nutation_period(named.top, named.state)
        state = ",".join(f"{v:.10g}" for v in named.y0)
        rows.append((named.name, f"{named.alpha:g}", state, kind, f"{period:.4g}", named.note))
        facts = {"regime": kind, "nutation_period": plain(period), "label": named.label, "note": named.note}
        data.append({"name": named.name, "alpha": named.alpha, "state": list(named.y0), **facts})
    return Answer("\n".join(table(rows)), data)


def add_options(command: argparse.ArgumentParser) -> None:
    """It has none."""
