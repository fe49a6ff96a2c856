"""The questions of the bench, in one call each; the answer is a `Comparison`, which is a frame and draws figures.

    answer = work_precision(["rk4", "strang", METHOD], tops=["generic", (problem, y0)])
    answer.frame
    answer.plot(x="evals", y="error", xlim=(1e2, 1e5))

All raise ValueError for bad input, and for a method that does not take a top. Steps and times are in two units, and every frame
has both: `h`, `t` and `span` are in the top's own unit of time, as for `integrate`; `h_scaled`, `t_scaled` and `span_scaled` in
its time scale, for a top 1/(|J| + √(|alpha||x|)).
"""

from __future__ import annotations  # signatures show names of types, not what they stand for

import warnings
from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.ask.comparison import Comparison
from lagrange_bench.ask.data import in_both_units
from lagrange_bench.experiments import drift as drift_experiment
from lagrange_bench.experiments import perturbed as field_experiment
from lagrange_bench.experiments import phase as phase_experiment
from lagrange_bench.experiments import work_precision as work_experiment
from lagrange_bench.experiments.measuring import orders
from lagrange_bench.experiments.measuring.reductions import worst
from lagrange_bench.integrators import METHODS, Method, StepError
from lagrange_bench.integrators.checks import check_count, check_real
from lagrange_bench.integrators.interface import StepWarning
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import NamedTop
from lagrange_bench.integrators.registry import NAMED_TOPS, find_method
from lagrange_bench.integrators.start import Start
from lagrange_bench.integrators.truth import truths

Cell = dict[str, Any]
Measure = Callable[[Cell], list[Cell]]
Methods = str | Method | Iterable[str | Method]
Top = str | NamedTop | tuple[Any, Any] | tuple[str, Any, Any]
Tops = Top | Iterable[Top]
Number = float | None


def drift(
    methods: Methods, tops: Tops = "generic", *, h: Number = None, h_scaled: Number = None, steps: int = 10_000
) -> Comparison:
    """How far the invariants of the problem drift along a run.

    Parameters
    ----------
    methods : str, Method or list of them
        Names, also "mine:METHOD", or `Method`.
    tops : str, NamedTop, tuple or list of them
        Names, also "mine:TOP", `NamedTop`, (problem, y0) or ("name", problem, y0). A `Problem` of your own will do.
    h : float, optional
        The step in the top's own unit of time.
    h_scaled : float, optional
        The same in its time scale; 0.125 if neither is given.
    steps : int
        The number of steps. Samples are taken after 1, 2, 3, … of them, evenly on a logarithmic scale.

    Returns
    -------
    Comparison
        A column for each invariant, such as H, J3, C1, C2: its change over the size of its terms. `worst` is the largest of the
        conserved ones; "kept: …" are quantities that a method conserves of its own.
    """
    steps = check_count(steps, "steps", least=1)
    step = _step(h, h_scaled, 0.125)
    request = _Request(methods, tops)
    frame = request.measure(drift_experiment.measure, lambda unit: {"part": "time", "h": step(unit), "steps": steps})
    for top in request.tops:
        of_top, names = frame["top"] == top.name, [name for name in top.top.names if name in top.top.conserved]
        frame.loc[of_top, "worst"] = worst(frame.reindex(columns=names)[of_top], names)
    return request.comparison(frame, "t_scaled", "worst")


def phase(
    methods: Methods, tops: Tops = "generic", *, h: Number = None, h_scaled: Number = None, steps: int = 4_000
) -> Comparison:
    """How far a run is from where it should be, and, of a top in a uniform field, where on its torus.

    Parameters
    ----------
    methods, tops : str or list
        As for `drift`.
    h, h_scaled : float, optional
        The step, as for `drift`; h_scaled = 0.25 if neither is given.
    steps : int
        The number of steps. Without a closed form of the motion, only runs of up to 2000 time scales have a reference solution;
        longer ones raise a ValueError.

    Returns
    -------
    Comparison
        `error` is the distance to the exact or reference solution. Of tops in a uniform field `time` and `angle` say by how much
        nutation and precession are off, and `off` is the distance to the torus.
    """
    steps = check_count(steps, "steps", least=1)
    step = _step(h, h_scaled, 0.25)
    request = _Request(methods, tops)
    for top in request.tops:
        if not truths.closed_form(top.top) and step(top.unit) * steps > truths.LONGEST:
            beyond = f"beyond {truths.LONGEST:g} time scales; take fewer"
            raise ValueError(f"steps: {top.name} has no reference solution {beyond}")
    frame = request.measure(phase_experiment.measure, lambda unit: {"part": "time", "h": step(unit), "steps": steps})
    return request.comparison(frame, "t_scaled", "time" if "time" in frame and frame["time"].notna().all() else "error")


def order(methods: Methods, tops: Tops = "generic") -> Comparison:
    """The error of one step against the step: the slope is the order plus one.

    Parameters
    ----------
    methods, tops : str or list
        As for `drift`.

    Returns
    -------
    Comparison
        `error` is the mean for a step of h and one of −h, and `order` the measured order. The steps are those with small errors
        above round-off: from 1e-14 to 3e-13, as a rule. If the steps of a method depend on earlier ones, the errors are those of
        short runs, divided by the number of steps. A method without an order has one row, whose `order` is "exact", or "own
        steps" if the method chooses them.
    """
    request = _Request(methods, tops)

    def measure(cell: Cell) -> list[Cell]:
        method = METHODS[cell["method"]]
        if method.control == "tolerance":
            return [{"order": "own steps"}]
        if method.order is None:
            return [{"order": "exact"}]
        start = next(top for top in request.tops if top.name == cell["state"])
        points = orders.order_points(method, orders.SPANS, (start,))
        if points.exact:
            raise StepError(cell["method"], f"every step is exact up to round-off on {cell['state']}")
        few = len(points.spans) < 3
        slope = np.nan if few else np.polyfit(np.log(points.spans), np.log(points.errors), 1)[0] - 1
        return [{"h": h, "error": e, "order": slope} for h, e in zip(points.spans, points.errors, strict=True)]

    return request.comparison(request.measure(measure, lambda unit: {}), "h_scaled", "error")


def work_precision(
    methods: Methods, tops: Tops = "generic", *, t: Number = None, t_scaled: Number = None, longest: float = 0.4
) -> Comparison:
    """What an error costs each method, in runs with ever smaller steps or tolerances.

    Parameters
    ----------
    methods, tops : str or list
        As for `drift`.
    t : float, optional
        Length of the runs in the top's own unit of time.
    t_scaled : float, optional
        The same in its time scale; 100 if neither is given.
    longest : float
        Seconds; no single run takes longer.

    Returns
    -------
    Comparison
        A row for each step or tolerance. `error` is the largest in the last fifth of the run, without a closed form that at its
        end; `seconds` (missing where the error is above 0.1), `setup_seconds`, `total` of both, `steps` and `evals` are what it
        costs. In the last row of a method `stopped` says why there are no more.

    Raises
    ------
    ValueError
        Also if there is no run with an error below 0.1 within `longest`.
    """
    request, span = _Request(methods, tops), _step(t, t_scaled, 100.0, "t")
    if not check_real(longest, "longest") > 0:
        raise ValueError(f"longest must be positive; got {longest!r}")
    uniform = {top.name for top in request.tops if kinds.uniform(top.top)}

    def measure(cell: Cell) -> list[Cell]:
        if cell["state"] in uniform:
            return work_experiment.measure(cell)
        return field_experiment.measure({**cell, "part": "work"})

    fields = {"per_octave": 1, "decades": 1, "longest": longest}
    frame = request.measure(measure, lambda unit: {**fields, "span": float(span(unit))})
    if "seconds" not in frame or not frame["seconds"].notna().any():
        why = next((f": {reason}" for reason in frame.get("reason", ()) if isinstance(reason, str)), "")
        below = f"below {work_experiment.USEFUL:g} within longest = {longest:g} s"
        raise ValueError(f"methods: no run has an error {below}{why}")
    frame["total"] = frame["seconds"] + frame["setup_seconds"]
    return request.comparison(frame, "seconds" if uniform else "total", "error")


class _Request:
    """Methods and starts, each of another name; every method takes every problem."""

    def __init__(self, methods: Methods, tops: Tops):
        if not isinstance(methods, str | Method | Iterable):
            raise ValueError(f"methods must be names or Method objects; got {methods!r}")
        several = [methods] if isinstance(methods, str | Method) else methods
        self.methods, self.tops = tuple(find_method(method) for method in several), Start.each_of(tops)
        for word, named in (("methods", self.methods), ("tops", self.tops)):
            names = [each.name for each in named]
            if len(set(names)) < max(len(names), 1):
                raise ValueError(f"{word}: give at least one, and each name once; got {names}")
        if still := [top.name for top in self.tops if not np.isfinite(top.unit)]:
            raise ValueError(f"tops: {still[0]} is at rest for ever: its time has no scale")
        refused = [reason for top in self.tops for method in self.methods if (reason := method.takes(top.top))]
        if refused:
            raise ValueError(f"methods: {'; '.join(refused)}")

    def measure(self, measure: Measure, cell: Callable[[float], Cell]) -> pd.DataFrame:
        """The rows of `measure` for each top and method, in both units of time; after a StepError a failed row."""
        rows: list[Cell] = []
        names = METHODS.temporarily_registered(*self.methods), NAMED_TOPS.temporarily_registered(*self.tops)
        with names[0], names[1], warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)  # of steps that are tried because they are long
            for top, method in product(self.tops, self.methods):
                fields = {"method": method.name, "state": top.name, **cell(top.unit)}
                try:
                    measured = [{**row, "status": "done", "failure": None} for row in measure(fields)]
                except StepError as error:
                    measured = [{"status": "failed", "failure": str(error)}]
                scale = float(top.top.scales(top.state)[0]) * top.unit  # experiments multiply times by it; 1 for a top
                rows += [{**fields, **row, **({"t": row["t"] / scale} if "t" in row else {})} for row in measured]
        frame = pd.DataFrame(rows).rename(columns={"state": "top"}).drop(columns="part", errors="ignore")
        return in_both_units(frame, {top.name: top.unit for top in self.tops})

    def comparison(self, frame: pd.DataFrame, x: str, y: str) -> Comparison:
        labels = {top.name: top.label for top in self.tops}
        invariants = tuple(dict.fromkeys(name for top in self.tops for name in top.top.names))
        return Comparison(frame, x, y, self.methods, labels, invariants)


def _step(unscaled: float | None, scaled: float | None, usual: float, word: str = "h") -> Callable[[float], float]:
    """The time scale of a top → the step, or the length of a run, in this time scale."""
    if unscaled is not None and scaled is not None:
        raise ValueError(f"give {word} or {word}_scaled, not both")
    if unscaled is None:
        word = f"{word}_scaled"
    number = check_real(unscaled if unscaled is not None else usual if scaled is None else scaled, word)
    if not number > 0:
        raise ValueError(f"{word} must be positive; got {number:g}")
    return lambda unit: number if unscaled is None else number / unit
