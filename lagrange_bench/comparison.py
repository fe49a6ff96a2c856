"""`work_precision`: a few methods against each other, from Python."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pandas as pd

from lagrange_bench.experiments import work_precision as experiment
from lagrange_bench.experiments.drawing import style
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS, Method
from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.registry import find_method

if TYPE_CHECKING:
    from lagrange_bench.experiments.drawing.style import Figure

SPANS = (1e-3, 1e9)  # of `time`: shorter runs are a step each, and longer ones take seconds only to be tried
COLUMNS = ("method", "error", "seconds", "setup_seconds")  # that are there in any case


def work_precision(
    methods: Iterable[str | Method], top: str = "generic", time: float = 100.0, longest: float = 0.4
) -> tuple[Figure, pd.DataFrame]:
    """What an error costs each of some methods, as the experiment work_precision measures it.

        figure, frame = work_precision(["rk4", "strang", METHOD], top="fast")
        figure.savefig("mine.pdf")

    Parameters
    ----------
    methods : registered names, "package.module:METHOD" or `Method` objects, each name once. top : a name, in a potential or not.
    time : length of the run, in units of the top's time scale. longest : s; no single run takes longer.

    Returns
    -------
    the figure, and a frame with a row for each step or tolerance: error, seconds, setup_seconds, steps, evals. The error is the
    largest in the last fifth of the run, in a potential that at its end, over the scales of J and x. In the last
    row of a method `stopped` says why there are no more. Methods that are not of the bench have black dashes.

    Raises
    ------
    ValueError : no such method or top, two methods of one name, or a method that does not take the top.
    """
    if isinstance(methods, str) or not isinstance(methods, Iterable):
        raise ValueError(f"methods must be a list of names or Method objects; got {methods!r}")
    found = [find_method(method) for method in methods]
    names = [method.name for method in found]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"methods: give at least one, and each name once; got {names}")
    if not SPANS[0] <= check_real(time, "time") <= SPANS[1]:
        raise ValueError(f"time must be from {SPANS[0]:g} to {SPANS[1]:g} time scales of the top; got {time!r}")
    if not check_real(longest, "longest") > 0:
        raise ValueError(f"longest must be positive; got {longest!r}")
    if not isinstance(top, str):
        raise ValueError(f"top must be a name; got {top!r}")
    problem = find(top)[0]
    if refused := [reason for method in found if (reason := method.takes(problem))]:
        raise ValueError(f"methods: {'; '.join(refused)}")
    cell = {"state": top, "span": float(time), "per_octave": 1, "decades": 1, "longest": longest}
    with ExitStack() as lent:
        for method in found:
            lent.enter_context(METHODS.lent(method))
        rows = [
            {"method": name, **cell, **row, "status": "done", "failure": None}
            for name in names
            for row in experiment.measure({"method": name, **cell})
        ]
        frame = pd.DataFrame(rows, columns=list(dict.fromkeys([*COLUMNS, *(name for row in rows for name in row)])))
        if experiment.useful(frame).empty:
            raise ValueError(f"methods: no run has an error below {experiment.USEFUL:g} within longest = {longest:g} s")
        with style.apply():
            figure = experiment.draw_frontier(frame, style)
    return figure, frame
