"""Assertions for the tests of your own method: bounds on the drift of invariants, and the order.

    from lagrange_bench import assert_drift, assert_order

    def test_mine():
        assert_drift(METHOD, tops=("generic", "fast"), h_scaled=0.1, steps=10**4, J3=0, C1=500)  # ulps
        assert_drift(METHOD, growth="H", below=0.75)  # exponent of the growth in time
        assert_order(METHOD)

docs/ci.md says how to use this. `h` is in the top's own unit of time, `h_scaled` in its time scale, 1/(|J| + √(|alpha||x|)),
which makes steps on several tops alike. Drifts are in ulps (units in the last place) of the invariant's scale, the size of its
terms at the start. They are measured after 1, 2, 4, … steps, and at three counts between each two.
"""

from __future__ import annotations  # signatures show names of types, not what they stand for

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.experiments.measuring import check, metrics, orders, states
from lagrange_bench.integrators import METHODS, Method, StepError
from lagrange_bench.integrators.api import own_step
from lagrange_bench.integrators.checks import check_count, check_real, check_step
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.start import Start
from lagrange_bench.support.words import suggestion

__tracebackhide__ = True  # pytest shows the user's test, not the lines of this file

TOPS = ("generic", "figure1", "fast", "slow")
# steps of a run by default; 2000 if a method is interpreted
LENGTH = 10**5
ROUND_OFF = 2.0  # ulps

Top = str | tuple[Any, Any] | tuple[str, Any, Any]
Tops = Top | Iterable[Top]


class Run(NamedTuple):
    """One run: the drift (N,) of each invariant, in ulps, after `counts` (N,) steps of `step` (a text)."""

    top: str
    step: str
    counts: list[int]
    ulps: dict[str, np.ndarray]

    def largest(self, invariant: str) -> tuple[float, int]:
        """The largest drift of an invariant, and the step after which it was measured."""
        drift = np.abs(self.ulps[invariant])
        at = int(np.argmax(np.where(np.isnan(drift), np.inf, drift)))
        return float(drift[at]), self.counts[at]


def assert_drift(
    method: str | Method,
    *,
    tops: Tops | None = None,
    h: float | Iterable[float] | None = None,
    h_scaled: float | Iterable[float] | None = None,
    steps: int | None = None,
    growth: str | None = None,
    below: float | None = None,
    options: Mapping[str, Any] | None = None,
    **ulps: float,
) -> None:
    """AssertionError if an invariant drifts further than a bound, or grows faster.

    Parameters
    ----------
    method : str or Method
        A name, also "mine:METHOD", or a record.
    tops : str, tuple or list of them, optional
        Names (of tops in a potential, too), (problem, y0) or (name, problem, y0) of any problem that the method accepts.
        Default: TOPS; with `growth` sixteen random tops.
    h : float or list of float, optional
        One step or several, in the top's own unit of time.
    h_scaled : float or list of float, optional
        The same in its time scale; 0.1 if neither is given.
    steps : int, optional
        By default LENGTH, or fewer if the method is interpreted.
    growth : str, optional
        An invariant. Its root-mean-square error over the tops must grow slower than t^p, with p = `below`.
    below : float, optional
        The bound on p.
    options : dict, optional
        Options of the method.
    **ulps : float
        H=16, J3=0, C1=16, C2=16, or other `names` of the problem. Each is a bound on every top, in ulps of the scale.

    Raises
    ------
    AssertionError
        It names every value beyond its bound, with the top, the step and the number of steps.
    ValueError
        No such method, top or invariant, or a top does not conserve the invariant.
    """
    if (growth is None) != (below is None):
        raise ValueError("growth and below go together: growth='H', below=0.75")
    if not ulps and growth is None:
        raise ValueError("give a bound to test: H=16, or growth='H' and below=0.75")
    for name, bound in ulps.items():
        if not check_real(bound, name) >= 0:
            raise ValueError(f"{name} must be a bound in ulps, at least 0; got {bound!r}")
    if below is not None:
        check_real(below, "below")
    record = find_method(method)
    if tops is None:
        tops = TOPS if growth is None else states.RANDOM
    starts = starts_of(tops, record, [*ulps] if growth is None else [*ulps, growth])
    runs = list(drifts(record, starts, h, h_scaled, steps, options))
    if not runs:
        raise ValueError("h and h_scaled: give at least one step")
    lines = []
    for run in runs:
        for name, bound in ulps.items():
            value, step = run.largest(name)
            if not value <= bound:
                where = f"at step {step} on {run.top}, {run.step}"
                lines.append(f"{record.name}: {name} is off by {value:.4g} ulps {where}: {bound:g} allowed")
    if growth is not None and below is not None:
        lines += growth_beyond(record, runs, growth, below)
    if lines:
        raise AssertionError("\n".join(lines))


def growth_beyond(method: Method, runs: list[Run], name: str, below: float) -> Iterator[str]:
    """A message for each step for which the exponent is too large. A drift below `ROUND_OFF` is not judged."""
    for step in dict.fromkeys(run.step for run in runs):
        these = [run for run in runs if run.step == step]
        E = np.array([run.ulps[name] for run in these])
        where = f"on {len(these)} tops, {step}, {these[0].counts[-1]} steps"
        if not np.all(np.isfinite(E)):
            yield f"{method.name}: {name} is not finite {where}"
            continue
        if len(these[0].counts) < 3:
            yield f"{method.name}: the growth of {name} cannot be measured {where}: take more steps"
            continue
        times = np.array(these[0].counts, dtype=float)
        p, low, high = metrics.growth_exponent(times, E, floor=0.5)
        # in a short run an oscillation hides a drift for most of the time: the last decade may show it beyond doubt
        late = metrics.growth_exponent(times, E, floor=0.5, decades=1.0, blocks=6)
        if late.low >= below > p:
            (p, low, high), where = late, f"{where}, in the last decade"
        if np.isnan(p) and (most := np.max(np.abs(E))) > ROUND_OFF:
            yield f"{method.name}: {name} is off by {most:.4g} ulps at last {where}: too late for an exponent"
        elif p >= below:
            yield f"{method.name}: {name} grows like t^{p:.2f} (from {low:.2f} to {high:.2f}) {where}: below {below:g} allowed"


def assert_order(method: str | Method, order: int | None = None, *, tops: Tops = orders.STATES) -> None:
    """AssertionError unless the error of one step grows like h^(order + 1), measured as `lagrange-bench check` does.

    Parameters
    ----------
    method : str or Method
        A name, also "mine:METHOD", or a record.
    order : int, optional
        By default the order that the method claims.
    tops : list of str or tuples
        As for `assert_drift`.

    Raises
    ------
    AssertionError
        It gives the measured order, or says why it cannot be measured.
    ValueError
        The method is exact in time, or chooses its own steps.
    """
    record = find_method(method)
    starts = starts_of(tops, record)
    if order is not None:
        record = replace(record, order=order)
    if record.order is None or record.control == "tolerance":
        why = "is exact in time" if record.order is None else "chooses its own steps"
        raise ValueError(f"{record.name} {why}: it has no order to measure")
    (verdict,) = check.order(record, False, starts)
    if not verdict.passed:
        unknown = " (not judged)" if verdict.passed is None else ""
        names = ", ".join(start.name for start in starts)
        raise AssertionError(f"{record.name}, {verdict}, on {names}{unknown}")


def drifts(
    method: Method,
    starts: Iterable[Start],
    h: float | Iterable[float] | None,
    h_scaled: float | Iterable[float] | None,
    steps: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> Iterator[Run]:
    """A run for each top and each step; arguments as of `assert_drift`, with starts in place of tops.

    AssertionError if the method cannot take a step.
    """
    n = states.affordable(method, LENGTH, full=False) if steps is None else check_count(steps, "steps", least=1)
    counts = states.log_counts(n, per_octave=4)
    if h is not None and h_scaled is not None:
        raise ValueError("give h or h_scaled, not both")
    word, values = ("h_scaled", 0.1 if h_scaled is None else h_scaled) if h is None else ("h", h)
    sizes = [check_step(size, word) for size in (values if isinstance(values, Iterable) else [values])]
    name = method.name
    with METHODS.temporarily_registered(method):
        for start in starts:
            top, y0 = start.top, start.state
            for size in sizes:
                step = f"{word} = {size:g}"
                length = size if word == "h" else own_step(None, size, top, y0)
                try:
                    times, y = states.sample(top, y0, name, length, counts, **options or {})
                except StepError as error:
                    at = f"in {n} steps" if error.step is None else f"step {error.step} of {n}"
                    raise AssertionError(f"{name} on {start.name}, {step}, {at}: {error.reason}") from None
                with np.errstate(over="ignore", invalid="ignore"):  # of a run that has left every bound behind
                    values = top.invariants(np.vstack((y0, y)), np.concatenate(((0.0,), times)))
                    ulps = metrics.relative_drift(values, np.spacing(top.invariant_scales(y0)))[1:]
                yield Run(start.name, step, counts, dict(zip(top.names, ulps.T, strict=True)))


def starts_of(tops: Tops, method: Method, invariants: Iterable[str] = ()) -> tuple[Start, ...]:
    """The starts of `tops`; ValueError if there is none, if the method refuses one, or if one does not conserve an invariant."""
    starts = Start.each_of(tops)
    if not starts:
        raise ValueError("tops: give one or more")
    if refused := [reason for start in starts if (reason := method.takes(start.top))]:
        raise ValueError(f"tops: {refused[0]}")
    for start, name in product(starts, invariants):
        if name not in start.top.names:
            hint = suggestion(str(name), start.top.names)
            raise ValueError(f"unknown invariant {name!r}{hint} Known: {', '.join(start.top.names)}")
        if name not in start.top.conserved:
            raise ValueError(f"{name}: the motion of the top {start.name} does not conserve it")
    return starts
