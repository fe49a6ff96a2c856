"""Tests for a method of your own: bounds on the drift of the invariants, and the order.

    from lagrange_bench.testing import assert_drift, assert_order

    def test_mine():
        assert_drift(METHOD, tops=("generic", "fast"), h=0.1, steps=10**4, J3=0, C1=500)  # ulps
        assert_drift(METHOD, growth="H", below=0.75)  # exponent of the growth in time
        assert_order(METHOD)

A method is a `Method`, a registered name or "package.module:METHOD". A top is a name, as in `lagrange-bench tops` (tops in a
potential, too), or a pair (problem, y0) of any problem that the method accepts. `measuring.drifts`
says how drifts are measured, docs/ci.md how to use this.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.experiments.measuring.drifts import TOPS, Refused, Run, Top, drifts, find_all
from lagrange_bench.integrators import Method
from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.registry import find_method

__tracebackhide__ = True  # pytest shows the user's test, not the lines of this file


def assert_drift(
    method: str | Method,
    *,
    tops: Top | Iterable[Top] | None = None,
    h: float | Iterable[float] = 0.1,
    steps: int | None = None,
    growth: str | None = None,
    below: float | None = None,
    options: Mapping[str, Any] | None = None,
    **ulps: float,
) -> None:
    """AssertionError if an invariant drifts further than a bound, or grows faster.

    Parameters
    ----------
    tops : one or several; default: TOPS; for `growth` the sixteen random tops of the drift experiment. h : one step or several,
    in the top's time scale.
    steps : default: LENGTH; fewer for a method that is interpreted. options : of the method.
    growth, below : the invariant whose root-mean-square error over the tops grows like t^p, and a bound on p.
    ulps : H=16, J3=0, C1=16, C2=16, or other `names` of the problem: bounds in ulps of the invariant's scale, on every top.

    Raises
    ------
    AssertionError : with the top, the step, the number of steps and the value of everything that is beyond its bound.
    ValueError : the arguments make no test: no such method, top or invariant; a top that does not conserve the invariant.
    """
    if (growth is None) != (below is None):
        raise ValueError("growth and below go together: growth='H', below=0.75")
    if not ulps and growth is None:
        raise ValueError("give a bound to test: H=16, or growth='H' and below=0.75")
    asked = [*ulps, *([] if growth is None else [growth])]
    for name, bound in ulps.items():
        if not check_real(bound, name) >= 0:
            raise ValueError(f"{name} must be a bound in ulps, at least 0; got {bound!r}")
    if below is not None:
        check_real(below, "below")
    found = find_method(method)
    if tops is None:
        tops = TOPS if growth is None else states.RANDOM
    named = find_all([tops] if isinstance(tops, str) else tops, asked)
    try:
        runs = list(drifts(found, named, h, steps, options))
    except Refused as error:
        raise AssertionError(str(error)) from None
    if not runs:
        raise ValueError("tops and h: give at least one of each")
    wrong = []
    for run in runs:
        for name, bound in ulps.items():
            value, step = run.largest(name)
            if not value <= bound:
                wrong.append(f"{name} is off by {value:.4g} ulps at step {step} on {run.top}, h = {run.h:g}: {bound:g}")
    lines = [f"{found.name}: {text} allowed" for text in wrong]
    if growth is not None and below is not None:
        lines += _grows(found, runs, growth, below)
    if lines:
        raise AssertionError("\n".join(lines))


def _grows(method: Method, runs: list[Run], name: str, below: float) -> Iterator[str]:
    """What is wrong with the exponents, one for each step. A drift that never exceeds half an ulp has none."""
    for h in dict.fromkeys(run.h for run in runs):
        these = [run for run in runs if run.h == h]
        E = np.array([run.drift(name) for run in these])
        where = f"on {len(these)} tops, h = {h:g}, {these[0].counts[-1]} steps"
        if not np.all(np.isfinite(E)):
            yield f"{method.name}: {name} is not finite {where}"
            continue
        times = abs(h) * np.array(these[0].counts)
        p, low, high = metrics.growth_exponent(times, E, floor=0.5)
        # in a short run an oscillation hides a drift for most of the time: the last decade may show it beyond doubt
        late = metrics.growth_exponent(times, E, floor=0.5, decades=1.0, blocks=6)
        if late.low >= below > p:
            (p, low, high), where = late, f"{where}, in the last decade"
        if p >= below:
            yield f"{method.name}: {name} grows like t^{p:.2f} (from {low:.2f} to {high:.2f}) {where}: below {below:g} allowed"


def assert_order(method: str | Method, order: int | None = None, *, tops: Sequence[Top] = check.ORDER_STATES) -> None:
    """AssertionError if the error of one step does not grow like h^(order + 1), as `lagrange-bench check` measures it.

    order : default: what the method claims for these tops, which are all in a potential or all not.

    Raises
    ------
    AssertionError : with the order that was found. ValueError : a method exact in time, or one that chooses its steps.
    """
    found, named = find_method(method), find_all(tops)
    if not named:
        raise ValueError("tops: give one or more")
    labels, problems = [label for label, _, _ in named], [problem for _, problem, _ in named]
    if len({"uniform" in problem.offers for problem in problems}) > 1:
        raise ValueError(f"tops must be all in a potential or all not; got {', '.join(labels)}")
    for problem in problems:
        if reason := found.takes(problem):
            raise ValueError(f"tops: {reason}")
    if order is not None:
        found = replace(found, order=order, exact_for="")
    claimed = found.order_for(problems[0])
    if claimed is None or found.control == "tolerance":
        why = "is exact in time" if claimed is None else "chooses its own steps"
        raise ValueError(f"{found.name} {why}: it has no order to measure")
    starts = tuple(
        label if isinstance(word, str) else (problem, y0)
        for word, (label, problem, y0) in zip(tops, named, strict=True)
    )
    (verdict,) = check.order(found, False, starts)
    if verdict.passed is False:
        raise AssertionError(f"{found.name}, {verdict}, on {', '.join(labels)}")
