"""Follow one top with one method.

For those who want a trajectory and its error. Follow one top, or a problem of your own, with one integrator (a method). Print the
final state, the invariants and their drift, the error against the exact solution, and the work done. If there is no exact
solution, a reference solution in quadruple precision takes its place. --output saves the trajectory, --draw draws the path of the
axis on its sphere.

examples:
  lagrange-bench integrate --top generic --h 0.1 --steps 10000
  lagrange-bench integrate --state 0.3,-0.4,1.2,0.48,0.6,0.64 --alpha 2 --times 0:1000:11 --output run.csv
  lagrange-bench integrate --top figure1 --method rk45 --option rtol=1e-6 --h 0.05 --steps 400 --draw axis.svg
  lagrange-bench integrate --top generic --potential tide --parameters 0.01,1,0,0 --method strang --h 0.1 --steps 100
  lagrange-bench integrate --problem mine:PROBLEM --state 0.3,-0.4,1.2 --method rk4 --h 0.1 --steps 1000

reading what --output wrote, without losing a bit:
  pandas.read_csv("run.csv", comment="#")     # before pandas 3.1 also float_precision="round_trip"
  file = numpy.load("run.npz"); file["t"], file["y"], json.loads(file["metadata"].item())
  pandas.read_parquet("run.parquet").attrs    # the metadata
"""

import argparse
from time import perf_counter
from typing import Any

from lagrange_bench.commands import arguments
from lagrange_bench.support.output import PICTURES, TABLES, Answer, check_target, plain


def add_options(command: argparse.ArgumentParser) -> None:
    text = "the top, at t = 0 (one of --top, --state, or --problem with --state)"
    start = command.add_argument_group(text)
    one = start.add_mutually_exclusive_group()
    text = "a named top (see lagrange-bench tops), or package.module:TOP (default: generic)"
    one.add_argument("--top", metavar="NAME", help=text)
    text = "angular momentum and axis in the rest frame, in any units; |x| need not be 1"
    one.add_argument("--state", type=arguments.numbers, metavar="J1,J2,J3,x1,x2,x3", help=text)
    text = "weight parameter of --state, in units of J²/x (default: 1)"
    start.add_argument("--alpha", type=arguments.number, metavar="A", help=text)
    text = "a problem of your own; --state has its numbers"
    start.add_argument("--problem", metavar="package.module:PROBLEM", help=text)
    text = "put the top in this potential: a name, see lagrange-bench potentials, or package.module:POTENTIAL"
    start.add_argument("--potential", metavar="NAME", help=text)
    text = "the numbers of its parameters, in their order"
    start.add_argument("--parameters", type=arguments.numbers, metavar="p,p,…", help=text)

    grid = command.add_argument_group("the times (--h or --h-scaled with --steps, or --times)")
    step = grid.add_mutually_exclusive_group()
    text = "step, in the top's own unit of time; negative: backwards"
    step.add_argument("--h", type=arguments.number, metavar="H", help=text)
    text = "the same in its time scale, 1/(|J| + √(|alpha||x|)) at the start"
    step.add_argument("--h-scaled", type=arguments.number, metavar="H", help=text)
    grid.add_argument("--steps", type=arguments.count, metavar="N", help="number of steps")
    text = "record every K-th state; K divides N (default: 1 if a file is written, else start and end only)"
    grid.add_argument("--every", type=arguments.count, metavar="K", help=text)
    text = "n equidistant times from t0 to t1, both included, or a list; for methods that give states at any time"
    grid.add_argument("--times", type=times, metavar="t0:t1:n | t,t,…", help=text)

    method = command.add_argument_group("the method")
    text = "see lagrange-bench methods; or package.module:METHOD (default: the exact one; for a top backlund)"
    method.add_argument("--method", metavar="NAME", help=text)
    text = "an option of the method, see methods --verbose; a number, a complex number as 0.1+0.5j, true, false or a "
    text += "word; may be repeated"
    method.add_argument("--option", type=arguments.option, action="append", default=[], metavar="KEY=VALUE", help=text)

    results = command.add_argument_group("the results")
    text = "keep times, states and metadata in FILE.csv, FILE.npz or FILE.parquet (needs pyarrow); a file of this "
    text += "name is replaced"
    results.add_argument("--output", type=arguments.location, metavar="FILE", help=text)
    text = "draw the axis on its sphere: FILE.svg, FILE.png or FILE.pdf; a file of this name is replaced"
    results.add_argument("--draw", type=arguments.location, metavar="FILE", help=text)


def times(text: str) -> list[float]:
    if ":" not in text:
        return arguments.numbers(text)
    parts = text.split(":")
    if len(parts) != 3:
        raise ValueError(f"must be t0:t1:n or a list t,t,…; got {text!r}")
    first, last, n = arguments.number(parts[0]), arguments.number(parts[1]), arguments.several(parts[2])
    return [first + (last - first) * (k / (n - 1)) for k in range(n - 1)] + [last]


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.ask import summary
    from lagrange_bench.integrators import integrate
    from lagrange_bench.integrators.api import default_method, own_step
    from lagrange_bench.integrators.registry import METHODS, find_method, without_archive

    name, top, y0 = _start(options)
    settings, every = dict(options.option), options.every
    if len(settings) < len(options.option):
        raise ValueError("--option: each name once")
    if options.times is not None:
        arguments.refuse(options, ("h", "h_scaled", "steps", "every"), "does not go with --times")
    else:
        options.h = own_step(options.h, options.h_scaled, top, y0)
        if options.h is None or options.steps is None:
            raise ValueError("give --h or --h-scaled, and --steps; or --times (see lagrange-bench integrate --help)")
        if every is None:
            every = 1 if options.output or options.draw else options.steps or 1
    method = find_method(options.method or default_method(top))
    if reason := method.takes(top):
        others = without_archive(other for other, method, _ in METHODS.each() if method and method.takes(top) is None)
        raise ValueError(f"--method: {reason} (these take it: {', '.join(others)})")
    check_target("--output", options.output, TABLES)  # now, and not after an hour of computing
    check_target("--draw", options.draw, PICTURES)
    if options.draw is not None and top.space.name != "e3":
        raise ValueError(f"--draw: {options.problem} has no axis on a sphere; --output keeps its states")

    begin = perf_counter()
    trajectory = integrate(top, y0, options.h, options.steps, method, every, options.times, **settings)
    seconds = perf_counter() - begin
    potential = getattr(top, "potential", None)
    facts = {
        "top": name,
        "alpha": getattr(top, "alpha", None),
        "y0": y0,
        "method": method.name,
        "options": settings,
        "potential": potential and (options.potential or potential.name),
        "parameters": list(getattr(top, "parameters", ())),
        "h": options.h,
        "h_scaled": options.h and options.h / top.scales(y0)[2],
        "steps": options.steps,
        "every": every,
        "work": vars(trajectory.work),
    }
    data = plain({**facts, "seconds": seconds, **summary.judge(trajectory, y0)})
    done = []
    if options.output is not None:
        done.append(summary.save(options.output, trajectory, plain(facts)))
    if options.draw is not None:
        done.append(summary.draw(options.draw, trajectory, name))
    if options.output is None:
        data |= {"t": trajectory.t, "y": trajectory.y}
    data["files"] = [str(path) for path in (options.output, options.draw) if path is not None]
    return Answer(summary.describe(trajectory, y0, data, method.label), data, remarks=done)


def _start(options: argparse.Namespace) -> tuple[str | None, Any, Any]:
    from lagrange_bench.integrators import LagrangeTop, PerturbedTop
    from lagrange_bench.integrators.checks import check_state
    from lagrange_bench.integrators.problem import kinds
    from lagrange_bench.integrators.registry import NAMED_TOPS, POTENTIALS, find

    if options.problem is not None:
        arguments.refuse(options, ("top", "alpha", "potential", "parameters"), "does not go with --problem")
        return options.problem, *arguments.own_problem(options.problem, options.state)
    if options.potential is None:
        arguments.refuse(options, ("parameters",), "belongs to --potential")
    name: str | None = None
    top: Any
    if options.state is not None:
        top = LagrangeTop(1.0 if options.alpha is None else options.alpha)
        state = check_state(options.state, "--state")
    else:
        arguments.refuse(options, ("alpha",), "belongs to --state J1,J2,J3,x1,x2,x3; a named top has its own")
        named = find(options.top or "generic", NAMED_TOPS)
        name, top, state = named.name, named.top, named.state
    if options.potential is not None:
        if not kinds.uniform(top):
            raise ValueError(f"--potential: {options.top} is in the potential {top.potential.name} already")
        top = PerturbedTop(top, find(options.potential, POTENTIALS), tuple(options.parameters or ()))
    return name, top, state
