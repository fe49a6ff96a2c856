"""The order of a method, from the errors of single steps against the exact motion.

One step accumulates no round-off. Its error is ~ h^(p+1), with the geometric mean over states and over both signs of h: the next
term, of relative size h, changes its sign with h and drops out. So order 20 can be read off in doubles. For a method with memory
(e.g. Adams) one step would be a step of its starter: the errors come from runs of one length.
"""

import contextlib
from itertools import product
from typing import NamedTuple

import numpy as np

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import Starts, placed, prepared
from lagrange_bench.integrators.interface import Array, Method, StepError
from lagrange_bench.integrators.start import Start
from lagrange_bench.integrators.truth import truths

# of eight drawn tops, for which an order is claimed and measured
STATES = tuple(f"random{i:03d}" for i in range(8))
# steps that are tried, in time scales
SPANS = 2.0 ** np.arange(2, -18, -0.125)
# errors of one step between these show the order: above round-off, below saturation
FLOOR, CEILING = 1e-14, 1e-2
# so many of the smallest steps above the floor show the order
POINTS = 8
# length in time scales, most steps, and least error of the runs that show the order of a method with memory
RUN, MOST_STEPS, RUN_FLOOR = 4.0, 512, 1e-12
# steps that show whether a method has memory: the starter of a method of high order takes several
TOGETHER = 32
# two calls of so many steps differ by less than this, unless there is a memory
SAME = 1e-12
# of a measured order
TOLERANCE = 0.15
# if all steps are longer than NEAR time scales, the slope may exceed the order by up to STEEPER
NEAR, STEEPER = 0.25, 1.25


class OrderPoints(NamedTuple):
    """Falling steps (N,), in time scales, and errors (N,) of one step. They give the order p: error ~ h^(p+1)."""

    spans: Array
    errors: Array
    runs: bool  # whether the errors are errors of runs of length RUN, divided by the number of steps
    exact: bool = False  # all steps are exact up to round-off: there are no points


def order_points(method: Method, spans: Array, names: Starts = STATES) -> OrderPoints:
    """The smallest steps of `spans` (falling) with errors above round-off, as geometric means over states and signs.

    A state does not count if all its errors are round-off, as at an equilibrium.
    """
    runs, counts = remembers(method, names[:2]), np.ones(len(spans))
    if runs:
        counts = np.unique(np.rint(RUN / spans[(spans <= RUN / 4) & (spans >= RUN / MOST_STEPS)]))
        spans = RUN / counts
    least = RUN_FLOOR if runs else FLOOR
    errors = np.array([_errors(method, name, sign * spans, counts, least) for name, sign in product(names, (1, -1))])
    known = ~np.all(np.isnan(errors), axis=1)  # a state where every step fails is no equilibrium
    still = known & ~np.any(errors > least, axis=1)
    if np.all(still):
        return OrderPoints(spans[:0], spans[:0], runs, exact=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.exp(np.mean(np.log(errors[~still]), axis=0))
    usable = np.flatnonzero((mean > least) & (mean < CEILING))[-POINTS:]  # NaN: not usable
    return OrderPoints(spans[usable], (mean / counts)[usable], runs)


def _errors(method: Method, name: str | Start, spans: Array, counts: Array, least: float) -> Array:
    """Errors (N,) after `counts` steps of `spans` (falling in size); NaN if a run fails, or after one at pure round-off."""
    start = placed(name)
    top, y0, steps, errors = start.top, start.state, spans * start.unit, np.full(len(spans), np.nan)
    truth = truths.solution(top, y0, steps * counts)
    for i, (h, n) in enumerate(zip(steps, counts, strict=True)):
        with contextlib.suppress(StepError):
            errors[i] = metrics.scaled_error(top, y0, prepared(method, top, y0, h).advance(y0, int(n)), truth[i])
        if errors[i] < 0.1 * least:
            break
    return errors


def remembers(method: Method, names: Starts = STATES[:2]) -> bool:
    """Whether the method has memory: n steps in one call differ from n calls of one step by more than round-off."""
    for name, span in product(names, (0.25, -0.5)):
        start = placed(name)
        y0 = start.state
        with contextlib.suppress(StepError):
            stepper = prepared(method, start.top, y0, span * start.unit)
            together, y = stepper.advance(y0, TOGETHER), y0
            for _ in range(TOGETHER):
                y = stepper.advance(y, 1)
            if metrics.scaled_error(start.top, y0, together, y) > SAME:
                return True
    return False


def hides_leading_term(smallest: float, excess: float, tolerance: float = TOLERANCE) -> bool:
    """Whether the leading term may be too small to be seen (Verner's formulas): the next ones show, and the slope is steeper.

    smallest : the smallest step with an error above round-off, in time scales. excess : measured order over the claimed one.
    """
    return bool(smallest > NEAR and tolerance < excess < STEEPER)
