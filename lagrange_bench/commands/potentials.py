"""The potentials a top can be in.

For those whose top stands in an uneven field, such as the tide of a distant mass. List the potentials V(x) that can be added to
the weight of a top: their parameters, in the order of --parameters, and the formula with its units.

The top moves by J' = ∇U × x, x' = J × x with U = alpha x3 + V(x). V has the units of J², and the axis x has any length.

examples:
  lagrange-bench potentials
  lagrange-bench integrate --state 0,1,2,0.6,0,0.8 --potential tide --parameters 1e-3,1,0,0 --method rk4 --h 0.01 --steps 100
  lagrange-bench potentials --json

For a potential of your own, write POTENTIAL = Potential("name", value) in a file my_field.py and give
--potential my_field:POTENTIAL. `value` is a function of (x1, x2, x3, p) made of + - * /, whole and half powers, and sqrt, sin,
cos, exp, log from lagrange_bench. A potential of your package joins this list through the entry-point group
lagrange_bench.potentials (name = package.module:POTENTIAL).
"""

import argparse
from typing import Any

from lagrange_bench.commands.arguments import loaded
from lagrange_bench.support.output import Answer, table


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.integrators import POTENTIALS

    data: list[dict[str, Any]] = []
    rows = [("name", "parameters", "formula and units")]
    potentials, broken = loaded(POTENTIALS)
    for name, potential in potentials.items():
        parameters = None if potential.parameters is None else list(potential.parameters)
        rows.append((name, "any number" if parameters is None else ",".join(parameters) or "none", potential.note))
        data.append({"name": name, "parameters": parameters, "note": potential.note})
    lines = [f"{facts['name']}: cannot be loaded: {facts['error']}" for facts in broken]
    return Answer("\n".join([*table(rows), *lines]), data + broken)
