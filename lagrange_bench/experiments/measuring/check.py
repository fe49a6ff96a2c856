"""Tests the claims of a method, for `lagrange-bench check METHOD` and for the tests of the bench.

No method gets special treatment: `Method.prepare` makes the steppers, and only `advance` and `record` are called. A fresh stepper
is prepared for every initial state, because a stepper may belong to a torus. Spans are steps in units of the top's time scale.

If a method takes tops in a potential, the same functions test it in two more fields. One is a tide, which is quadratic and breaks
the symmetry. The other is a charge on the vertical, which is not quadratic and keeps the symmetry. A method for rigid bodies is
tested on a `RigidBody`. Any method can be tested on a problem and a state of the user's own.
"""

from __future__ import annotations

import contextlib
import pickle
import random
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.experiments.measuring import first_step, metrics, states
from lagrange_bench.integrators import INVARIANTS, POTENTIALS, PerturbedTop
from lagrange_bench.integrators.interface import Array, Method, StepError, Stepper, StepWarning
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.truth import truths

EPS = float(np.finfo(float).eps)

ORDER_STATES = tuple(f"random{i:03d}" for i in range(8))
STATES = ("generic", "figure1", "random000", "random001")
TIDE, CHARGE = " in a tide", " near a charge"  # `find` takes these behind the name of a state
FIELD_ORDER_STATES = tuple(f"random{i:03d}{kind}" for i in range(8) for kind in (TIDE, CHARGE))
FIELD_STATES = tuple(f"{name}{kind}" for name in ("generic", "random001") for kind in (TIDE, CHARGE))
FIELD_STEPS = 1000  # steps of the runs that test conservation in a field
SPANS = (0.1, 0.5, 3.0)  # no series reaches the last: a method may decline it, but must keep its claims otherwise
AT = "h_scaled = 0.1, 0.5, 3, {} states"
LONG_SPANS, LONG_RUNS = (10.0, 30.0, 100.0, 1e4), (1, 10)  # steps that a method may refuse, and how many are taken
A_UNIT = 256  # ulps for each time scale of a step: round-off grows with the angle of the turn
BIAS, WALK = 8, 128  # ulps a step that round-off may change an invariant by: always the same way, or either way
ROUND_OFF = 1.5  # ulps a step: a drift up to this may be nothing but round-off
TOLERANCE = 0.15  # of a measured order
FIELD_TOLERANCE = 0.3  # in a potential, which varies over less than |x|: beyond order 5 the next term shows in doubles
EXACT = 1e-12  # an error below this over some hundred steps is round-off
FLOOR, CEILING = 1e-14, 1e-2  # errors of one step between these show the order: above round-off, below saturation
POINTS = 8  # of the smallest steps above the floor show the order
# length in time scales, and most steps, of the runs that show the order of a method with memory
RUN, MOST_STEPS = 4.0, 512
RUN_FLOOR = 1e-12  # least error of these runs
ORDER_SPANS = 2.0 ** np.arange(2, -18, -0.125)  # steps that are tried for an order
LOST = 0.1  # of the scales: a run with a larger error says nothing about accuracy
TOGETHER = 32  # steps that show whether a method has memory: the starter of a method of high order takes several
# if all steps are longer than NEAR time scales, the slope may exceed the order by up to STEEPER
NEAR, STEEPER = 0.25, 1.25


NOT_CLAIMED = "not claimed"
TAKES_A_STEP = "takes a step"  # the only verdict on a method that takes none


@dataclass(frozen=True)
class Verdict:
    """The verdict on one claim. passed : None if it is not judged; `how` says why. at : state and step of the largest value."""

    claim: str
    passed: bool | None
    measured: float | None
    bound: str
    how: str
    at: str = ""

    @property
    def word(self) -> str:
        if self.passed is None:
            return NOT_CLAIMED if self.how.startswith(NOT_CLAIMED) else "not judged"
        return "pass" if self.passed else "fail"

    def __str__(self) -> str:
        measured = "" if self.measured is None else f" {self.measured:.4g}, bound {self.bound};"
        return f"{self.claim}:{measured} {self.how}"


class Worst(NamedTuple):
    """The largest of several errors, with its top and step. NaN counts as infinite."""

    size: float = 0.0
    at: str = ""

    def worse_of(self, size: float, name: Start, span: float) -> Worst:
        size = float("inf") if np.isnan(size) else float(size)
        return self if self.at and size <= self.size else Worst(size, f"{label(name)}, h_scaled = {span:g}")

    @property
    def where(self) -> str:
        return f"; largest on {self.at}" if self.at else ""


Check = Callable[[Method, bool], Iterator[Verdict]]
Start = str | tuple[Any, Array]  # the name of a state, or a problem and a state
Starts = tuple[Start, ...]


def check(method: str | Method, quick: bool = False, problem: Any = None, y0: ArrayLike | None = None) -> list[Verdict]:
    """Test all claims of one method.

    A check that raises an exception counts as a failed claim, and the other claims are tested all the same. But if the first step
    raises one, nothing else is tested. One step of a user's own method is also taken without Numba.

    Parameters
    ----------
    method : str or Method
        A record, its name, or package.module:METHOD.
    quick : bool
        Take a tenth of the steps.
    problem, y0 : Problem and its state, optional
        Test the claims on this problem instead, at this state and near it.

    Returns
    -------
    list of Verdict
        One for each claim.

    Raises
    ------
    ValueError : the method is unknown, or the method, the problem and the state do not fit. NotInstalled : a package is missing.
    """
    record, word = find_method(method), method if isinstance(method, str) else None
    if (fault := first_step.problem(record, word)) is not None:
        return [Verdict(TAKES_A_STEP, False, None, "", fault)]
    checks = CHECKS if record.takes(LagrangeTop()) is None else (of_its_kind,)
    if problem is not None:
        checks = (_on(problem, y0, record),)
    verdicts: list[Verdict] = []
    for function in checks:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", StepWarning)
                verdicts += function(record, quick)
        except (Exception, SystemExit) as error:  # a plug-in may raise anything
            how = f"ended in {first_step.describe(error, record, word)}"
            verdicts.append(Verdict(function.__name__.replace("_", " "), False, None, "", how))
    return verdicts


# ---------------------------------------------------------------- accuracy


def order(method: Method, quick: bool, names: Starts = ORDER_STATES) -> Iterator[Verdict]:
    """The error of one step grows like h^(p+1).

    One step accumulates no round-off. The error is the geometric mean over states and over both signs of h: the next term of
    the error, of relative size h, changes its sign with h and drops out. So order 20 can be read off in doubles. There is one
    exception. If the leading term is very small (Verner's formulas), the next terms show as long as the error is above
    round-off, and the slope is steeper than the order. Then the order is not judged.

    For a method with memory (e.g. Adams), one step would be a step of its starter. So its errors come from runs of one length.
    """
    claimed = method.order
    if claimed is None:
        return
    if method.control == "tolerance":
        yield not_judged(f"order {claimed}", "h is only the output grid")
        return
    points = order_points(method, ORDER_SPANS, names)
    tolerance = TOLERANCE if names == ORDER_STATES else FIELD_TOLERANCE
    claim, bound = f"order {claimed}", f"{claimed} ± {tolerance}"
    if points.exact:
        yield not_judged(claim, "every step here is exact up to round-off, as at an equilibrium")
        return
    if len(points.spans) < 4:
        yield Verdict(claim, False, None, bound, f"fewer than 4 steps have an error between {FLOOR:g} and {CEILING:g}")
        return
    p = float(np.polyfit(np.log(points.spans), np.log(points.errors), 1)[0]) - 1
    what = f"runs of t = {RUN:g}, for a step depends on those before," if points.runs else "one step"
    smallest, largest = points.spans[-1], points.spans[0]
    how = f"{what} against the {_truth(names)}, h from {smallest:.2g} to {largest:.2g}, ± h, {len(names)} states"
    hidden = smallest > NEAR and tolerance < p - claimed < STEEPER
    yield Verdict(claim, None if hidden else abs(p - claimed) <= tolerance, p, bound, how)


class OrderPoints(NamedTuple):
    """Falling steps (N,), in time scales, and errors (N,) of one step. They give the order p: error ~ h^(p+1)."""

    spans: Array
    errors: Array
    runs: bool  # whether the errors are errors of runs of length RUN, divided by the number of steps
    exact: bool = False  # all steps are exact up to round-off: there are no points


def order_points(method: Method, spans: Array, names: Starts = ORDER_STATES) -> OrderPoints:
    """The smallest steps of `spans` (falling) with errors above round-off, as geometric means over states and signs.

    A state does not count if all its errors are round-off, as at an equilibrium.
    """
    runs, counts = remembers(method, names[:2]), np.ones(1)
    if runs:
        counts = np.unique(np.rint(RUN / spans[(spans <= RUN / 4) & (spans >= RUN / MOST_STEPS)]))
        spans, errors = RUN / counts, run_errors(method, names, counts)
    else:
        errors = one_step_errors(method, names, spans)
    least = RUN_FLOOR if runs else FLOOR
    known = ~np.all(np.isnan(errors), axis=1)  # a state where every step fails is no equilibrium
    still = known & ~np.any(errors > least, axis=1)
    if np.all(still):
        return OrderPoints(spans[:0], spans[:0], runs, exact=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.exp(np.mean(np.log(errors[~still]), axis=0))
    usable = np.flatnonzero((mean > least) & (mean < CEILING))[-POINTS:]  # NaN: not usable
    return OrderPoints(spans[usable], (mean / counts)[usable], runs)


def remembers(method: Method, names: Starts = ORDER_STATES[:2]) -> bool:
    """Whether the method has memory: n steps in one call differ from n calls of one step by more than round-off."""
    for name in names:
        top, y0 = find(name)
        for span in (0.25, -0.5):
            try:
                stepper = prepared(method, top, y0, span * top.scales(y0)[2])
                together, y = stepper.advance(y0, TOGETHER), y0
                for _ in range(TOGETHER):
                    y = stepper.advance(y, 1)
            except StepError:
                continue
            if metrics.scaled_error(top, y0, together, y) > EXACT:
                return True
    return False


def run_errors(method: Method, names: Starts, counts: Array) -> Array:
    """Errors after ± RUN time scales in `counts` steps, (2 len(names), len(counts)); NaN if a run fails."""
    errors = np.full((2 * len(names), len(counts)), np.nan)
    for row, (name, sign) in enumerate(product(names, (1, -1))):
        for i, n in enumerate(counts):
            with contextlib.suppress(StepError):
                errors[row, i] = run_error(method, name, sign * RUN / n, int(n))
    return errors


def one_step_errors(method: Method, names: Starts, spans: Array) -> Array:
    """Errors of one step of ± `spans` (falling), (2 len(names), len(spans)); NaN if a step fails or is pure round-off."""
    errors = np.full((2 * len(names), len(spans)), np.nan)
    for row, (name, sign) in enumerate(product(names, (1, -1))):
        top, y0 = find(name)
        times = sign * spans * top.scales(y0)[2]
        truth = truths.solution(top, y0, times)
        for i, h in enumerate(times):
            try:
                y = prepared(method, top, y0, h).advance(y0, 1)
            except StepError:
                continue
            errors[row, i] = metrics.scaled_error(top, y0, y, truth[i])
            if errors[row, i] < 0.1 * FLOOR:
                break
    return errors


def solution(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """The accuracy of methods that are exact in time or control their error, and the accuracy of any method for h < 0."""
    forward, back_again = Worst(), Worst()
    for name in names:
        forward = forward.worse_of(run_error(method, name, 0.25, 80), name, 0.25)
        back_again = back_again.worse_of(return_error(method, name, 0.25, 80), name, -0.25)
    ahead, back = forward.size, back_again.size
    if method.control == "step" and method.order is None:
        how = f"80 steps against the {_truth(names)}, h_scaled = 0.25, {len(names)} states{forward.where}"
        yield Verdict("exact in time", ahead <= EXACT, ahead, f"≤ {EXACT:g}", how, forward.at)
    elif method.control == "tolerance":
        how = f"default tolerance, t = 20, {len(names)} states{forward.where}"
        yield Verdict(f"follows the {_truth(names)}", ahead <= 1e-4, ahead, "≤ 1e-4", how, forward.at)
    # the two errors differ by a factor of order one, unless they are round-off
    passed = None if ahead > LOST else back <= 10 * ahead + EXACT
    how = f"largest error of the way back from t = 20, against that of the way there{back_again.where}"
    how += f"; the way there is off by more than {LOST:g}: nothing can be said" if passed is None else ""
    yield Verdict("negative h is as accurate", passed, back, f"≤ 10 × {ahead:.1e} forwards", how, back_again.at)


def run_error(method: Method, name: Start, span: float, n: int) -> float:
    top, y0 = find(name)
    h = span * top.scales(y0)[2]
    y = prepared(method, top, y0, h).advance(y0, n)
    return float(metrics.scaled_error(top, y0, y, truths.after_steps(top, y0, h, [n])[0]))


def return_error(method: Method, name: Start, span: float, n: int) -> float:
    """The error of n steps back to the start, from the exact state after n steps."""
    top, y0 = find(name)
    h = span * top.scales(y0)[2]
    end = truths.after_steps(top, y0, h, [n])[0]
    y = prepared(method, starting_later(top, n * h), end, -h).advance(end, n)
    return float(metrics.scaled_error(top, y0, y, y0))


def starting_later(problem: Any, t: float) -> Any:
    """The problem with its start moved by t."""
    return problem.starting_at(problem.start + t) if getattr(problem, "timed", False) else problem


# ---------------------------------------------------------------- structure


def steps_on(names: Starts) -> Iterator[tuple[Start, float, Any, Array, float]]:
    """For each start and each of SPANS: the start, the step in time scales, the problem, the state and the step."""
    for name in names:
        top, y0 = find(name)
        for span in SPANS:
            yield name, span, top, y0, span * top.scales(y0)[2]


@contextlib.contextmanager
def declines_long_steps(span: float) -> Iterator[None]:
    """Ignore a StepError in the block if the step is at least one time scale long."""
    try:
        yield
    except StepError:
        if span < 1:
            raise


def symmetric(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """A step of −h undoes a step of h."""
    if not method.claims.symmetric:
        yield not_judged("symmetric", NOT_CLAIMED)
        return
    worst = Worst()
    for name, span, top, y0, h in steps_on(names):
        with declines_long_steps(span):
            stepped = prepared(method, top, y0, h).advance(y0, 1)
            back = prepared(method, starting_later(top, h), stepped, -h).advance(stepped, 1)
            worst = worst.worse_of(float(metrics.scaled_error(top, y0, back, y0)), name, span)
    # two steps have some hundred roundings, and a method of order 8 that is not symmetric errs by far more. At a state of the
    # user's own a rounding may weigh more
    bound = (256 if isinstance(names[0], str) else 1024) * EPS
    how = f"a step and its inverse, {AT.format(len(names))}{worst.where}"
    yield Verdict("symmetric", worst.size <= bound, worst.size, f"≤ {bound:.1e}", how, worst.at)


def poisson(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """D P(y) Dᵀ = P(ỹ) for the derivative D of one step."""
    if not method.claims.poisson:
        yield not_judged("Poisson map", NOT_CLAIMED)
        return
    worst, bound = Worst(), 1e-8
    names = names[:2] if quick else names
    for name, span, top, y0, h in steps_on(names):
        with declines_long_steps(span):
            result = metrics.poisson_defect(lambda y: prepared(method, top, y, h).advance(y, 1), top, y0)  # noqa: B023
            if span < 1 or result.error <= bound:  # or the map bends too much for differences
                worst = worst.worse_of(result.defect, name, span)
    how = f"‖D P(y) Dᵀ − P(ỹ)‖, D by central differences of order 6, {AT.format(len(names))}{worst.where}"
    yield Verdict("Poisson map", worst.size <= bound, worst.size, f"≤ {bound:g}", how, worst.at)


def conserves(method: Method, quick: bool, names: Starts = STATES, steps: int | None = None) -> Iterator[Verdict]:
    """The claimed invariants change by round-off only, for small and large h. Other invariants are only reported.

    Roundings that go either way add up like √n. Roundings that always go the same way add up like n: a fault of 0.4 ulps a step
    shows after 10⁵ steps.
    """
    n = steps or (10_000 if quick else 100_000)
    if method.control == "tolerance":
        n = n // 500 if method.engine != "scipy" else max(n // 2500, 10)  # each has many steps of the method's own
    n = max(n, 10)
    # "quantity" if the method claims it, "(quantity)" if only the motion conserves it
    worst: defaultdict[str, Worst] = defaultdict(Worst)
    stopped: dict[tuple[float, str], list[str]] = {}
    claimed: dict[str, list[str]] = {}
    quantities: dict[str, None] = {}
    for name, span, top, y0, h in steps_on(names):
        words, own = method.conserves_on(top), method.claims.conserves_own if kinds.uniform(top) else {}
        if span == SPANS[0]:
            for quantity in (*words, *own):
                claimed.setdefault(quantity, []).append(label(name))
            quantities |= dict.fromkeys(top.names)
        try:
            y = prepared(method, top, y0, h).record(y0, n, n // 10)
        except StepError as error:
            if span < 1:
                stopped.setdefault((span, error.reason), []).append(label(name))
            continue
        times = h * (n // 10) * np.arange(len(y))
        with np.errstate(over="ignore", invalid="ignore"):  # a run may go astray
            drift = np.abs(metrics.relative_drift(top.invariants(y, times), top.invariant_scales(y0)))
        sizes = dict(zip(top.names, np.max(drift, axis=0), strict=True))
        drifts = {word if word in words else f"({word})": sizes[word] for word in top.names if word in top.conserved}
        for quantity, value in own.items():
            values, unit = value(top, h, y)
            drifts[quantity] = np.max(np.abs(values - values[0]) / unit)
        for quantity, size in drifts.items():
            worst[quantity] = worst[quantity].worse_of(size, name, span)
    at = f"largest error over {n} steps, {AT}" + (", where it gets through" if stopped else "")
    for quantity in sorted(method.claims.conserves - set(INVARIANTS) - set(quantities)):
        why = f"no problem here has an invariant {quantity}; name one by --problem"
        yield not_judged(f"conserves {quantity}", why)
    for quantity in dict.fromkeys((*quantities, *claimed)):
        on, claim = claimed.get(quantity, ()), f"conserves {quantity}"
        largest = worst.get(quantity if on else f"({quantity})")
        if largest is None:
            if on or any(quantity in find(name)[0].conserved for name in names):
                yield not_judged(claim, f"no run gets through {n} steps")
            continue
        how = at.format(len(on or names)) + largest.where
        if not on:
            yield Verdict(claim, None, largest.size, "", f"{NOT_CLAIMED}; {how}", largest.at)
            continue
        bound = EPS * min(BIAS * n, WALK * n**0.5)
        if bound < largest.size <= ROUND_OFF * n * EPS:
            how += f"; that is {largest.size / (n * EPS):.1g} ulp a step, which may be no fault of the formula: see “A rounding "
            how += "that always goes the same way” in docs/adding-a-method.md"
        yield Verdict(claim, largest.size <= bound, largest.size, f"≤ {bound:.1e}", how, largest.at)
    if stopped:  # a fault only at the smallest step: an explicit method may be unstable at others
        harmless = min(stopped)[0] > SPANS[0]
        how = "; ".join(f"fails at h_scaled = {span:g}: {why} ({', '.join(on)})" for (span, why), on in stopped.items())
        how += f"; only a failure at h_scaled = {SPANS[0]:g} or below counts against a method" if harmless else ""
        yield Verdict(f"takes {n} steps", None if harmless else False, None, "", how)


def long_steps(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """The claimed invariants are also conserved in very long steps and next to the upright top, unless a step is refused."""
    starts = (*names, *((LagrangeTop(1.0), np.array((tilt, 0.0, 0.3, tilt, 0.0, 1.0))) for tilt in (1e-3, 1e-9)))
    worst = Worst()
    for name, span, steps in product(starts, LONG_SPANS, LONG_RUNS) if method.control == "step" else ():
        top, y0 = find(name)
        claimed = [word in method.conserves_on(top) for word in top.names]
        with contextlib.suppress(StepError):
            y = prepared(method, top, y0, span * top.scales(y0)[2]).record(y0, steps, 1)
            with np.errstate(over="ignore", invalid="ignore"):
                drift = np.abs(metrics.relative_drift(top.invariants(y), top.invariant_scales(y0)))[:, claimed]
            worst = worst.worse_of(float(np.max(drift, initial=0.0)) / (A_UNIT * EPS * span), name, span)
    if worst.at:
        how = f"steps of h_scaled = 10, 30, 100, 1e4 that are not refused, over {A_UNIT} ulps for each unit of it{worst.where}"
        yield Verdict("conserves in long steps", worst.size <= 1.0, worst.size, "≤ 1", how, worst.at)


# ---------------------------------------------------------------- behaviour


def purity(method: Method, quick: bool, names: Starts = ("generic", "figure1")) -> Iterator[Verdict]:
    """A stepper is a function of its arguments: it modifies nothing, remembers nothing, and shares nothing."""
    (top, y0), (other, z0) = map(find, names[:2])
    h, k = 0.25 * top.scales(y0)[2], -0.4 * other.scales(z0)[2]
    y = y0.copy()
    stepper = prepared(method, top, y, h)
    first = stepper.advance(y, 50)
    rows = stepper.record(y, 50, 10)
    yield verdict("input is not modified", same(y, y0), "bits of y after prepare, advance and record")
    y.flags.writeable = False
    again = (stepper.advance(y, 50), prepared(method, top, y, h).advance(y, 50))
    how = "advance twice, and with a second stepper"
    yield verdict("same input, same bits", all(same(a, first) for a in again), how)
    stranger = prepared(method, other, z0, k)
    alone = stranger.advance(z0, 50)
    stepper, stranger = prepared(method, top, y0, h), prepared(method, other, z0, k)
    turns = [(stepper.advance(y0, 50), stranger.advance(z0, 50)) for _ in range(2)]
    shared_nothing = all(same(a, first) and same(b, alone) for a, b in turns)
    yield verdict("two steppers share nothing", shared_nothing, "two tops in turns, against each alone")
    apart = first is not again[0] and not np.shares_memory(first, again[0]) and not np.shares_memory(first, y0)
    yield verdict("results are fresh arrays", apart, "memory of two results and of the input")
    yield from recording(method, stepper, y0, first, rows)


def recording(method: Method, stepper: Stepper, y0: Array, last: Array, rows: Array) -> Iterator[Verdict]:
    shape = rows.shape == (6, len(y0)) and same(rows[0], y0) and rows.dtype == np.float64 and last.shape == y0.shape
    nothing = same(stepper.advance(y0, 0), y0) and same(stepper.record(y0, 0, 1), y0[None])
    yield verdict("record has the start in row 0", shape and nothing, "shapes and row 0 for 50 and for 0 steps")
    decided = isinstance(getattr(stepper, "from_start", None), bool)
    yield verdict("from_start is True or False", decided, "an attribute; False in classes that derive from Stepper")
    if method.control == "step":
        ends = (stepper.record(y0, 50, every)[-1] for every in (1, 25, 50))
        yield verdict("record ends where advance does", all(same(end, last) for end in ends), "bits, every = 1, 25, 50")
        before = stepper.work.steps
        stepper.advance(y0, 7)
        stepper.record(y0, 6, 3)
        yield verdict("work counts steps", stepper.work.steps == before + 13, "7 steps advanced, 6 recorded")


Extreme = tuple[str, Any, Array, float]  # a label, a top, a state, a step


def extremes(method: Method, quick: bool, cases: Iterable[Extreme] | None = None) -> Iterator[Verdict]:
    """Any finite state and step give finite numbers, or a StepError that says why."""
    bad: dict[str, list[str]] = {}  # what is wrong → the runs
    runs, raised = 0, []
    for label, top, y0, h in extreme_cases() if cases is None else cases:
        runs += 1
        try:
            with np.errstate(all="ignore"):  # the result may be finite after an overflow
                y = prepared(method, top, y0, h).record(y0, 4, 2)
            if not np.all(np.isfinite(y)):
                bad.setdefault(str(y[-1].tolist()), []).append(label)
        except StepError as error:
            raised.append(error)
        except Exception as error:
            bad.setdefault(first_step.describe(error, method, None), []).append(label)
    where = {what: on[0] if len(on) == 1 else f"{len(on)} of {runs} runs ({on[0]}, …)" for what, on in bad.items()}
    how = "; ".join(f"{on}: {what}" for what, on in where.items())
    how = how or f"{len(raised)} StepErrors, the other runs finite"
    yield Verdict("finite, or a StepError", not bad, float(sum(map(len, bad.values()))), "0", how)
    if raised:
        copies = [pickle.loads(pickle.dumps(error)) for error in raised]
        same = all(str(a) == str(b) and vars(a) == vars(b) for a, b in zip(copies, raised, strict=True))
        others = dict.fromkeys(repr(error.method) for error in raised if error.method != method.name)
        how = f"{len(raised)} of them"
        if others:
            how = f"StepErrors say {', '.join(others)}, the record says {method.name!r}: "
            how += "give FixedStepper, or StepError, the record's name"
        elif not all(error.reason for error in raised):
            others, how = {"": None}, "one of them has no reason"
        yield verdict("StepErrors name the method", not others, how)
        yield verdict("StepErrors survive pickling", same, f"{len(raised)} of them")


def extreme_cases() -> Iterator[Extreme]:
    for name, named in TOPS.items():
        for span in (0.1, 3.0):
            yield f"{name}, h_scaled = {span}", named.top, named.state, span * named.top.scales(named.state)[2]
    top, y0 = TOPS["generic"].top, TOPS["generic"].state
    for size in (1e-300, 1e-150, 1e-30, 1e30, 1e150, 1e300):
        y = size * y0
        yield f"size {size:g}", top, y, 0.3 * top.scales(y)[2]
        y = np.concatenate((y0[:3], size * y0[3:]))
        yield f"|x| = {size:g}", top, y, 0.3 * top.scales(y)[2]
    for h in (1e-300, -1e-12, 30.0):
        yield f"h = {h:g} (own unit)", top, y0, h
    yield "at rest without weight", LagrangeTop(0.0), np.array((0.0, 0, 0, 0, 0, 1)), 0.5
    yield "hanging at rest", top, np.array((0.0, 0, 0, 0, 0, -1)), 0.5


# ---------------------------------------------------------------- in a field


def in_field(method: Method, quick: bool) -> Iterator[Verdict]:
    """The same claims on tops in a potential, if the method takes them."""
    refused = {name: method.takes(find(name)[0]) for name in (*FIELD_ORDER_STATES, *FIELD_STATES)}
    ordered, names = (tuple(n for n in listed if not refused[n]) for listed in (FIELD_ORDER_STATES, FIELD_STATES))
    if not names:
        yield not_judged("in a field", str(refused[FIELD_STATES[0]]))
        return
    yield from _claims(method, quick, "in a field", ordered, names, names)


def _claims(
    method: Method, quick: bool, where: str, ordered: Starts, solved: Starts, names: Starts
) -> Iterator[Verdict]:
    """All claims in other fields or on other problems. ordered, solved, names : states for order, accuracy, and other claims."""
    for verdict in (
        *order(method, quick, ordered),
        *solution(method, quick, solved),
        *symmetric(method, quick, names),
        *conserves(method, quick, names, FIELD_STEPS if quick else 10 * FIELD_STEPS),
        *poisson(method, quick, names[:2]),
        *(purity(method, quick, names[:2]) if where != "in a field" else ()),
        *extremes(method, quick, extreme_fields(names)),
    ):
        yield replace(verdict, claim=f"{where}: {verdict.claim}")


# ---------------------------------------------------------------- on other problems

BODY = RigidBody(0.8, (0.1, -0.3, 0.9), np.diag((0.4, 0.5, 0.3)), (0.0, 0.0, -9.81))
BODY_START = np.array((0.8, 0.2, -0.4, 0.4, 0.3, -0.9, 3.0))
NEAR_STATES = 8


def of_its_kind(method: Method, quick: bool) -> Iterator[Verdict]:
    """The same claims on a body of any shape, for methods that take only bodies."""
    if method.takes(BODY) is None:
        yield from _on(BODY, BODY_START, method)(method, quick)


def _on(problem: Any, y0: ArrayLike | None, method: Method) -> Check:
    """A check of all claims on a problem, at y0 and near it. ValueError if the problem, the method and y0 do not fit."""
    if not hasattr(problem, "offers"):
        raise ValueError(f"problem must be a Problem or a top; got {type(problem).__name__}")
    if reason := method.takes(problem):
        raise ValueError(f"problem: {reason}")
    if y0 is None:
        raise ValueError("y0: give a state of the problem")
    starts = tuple((problem, y) for y in random_states_near(problem, y0))

    def claims(method: Method, quick: bool) -> Iterator[Verdict]:
        yield from _claims(method, quick, getattr(problem, "name", str(problem)), starts, starts[:2], starts[:4])

    return claims


def random_states_near(problem: Any, y0: ArrayLike) -> list[Array]:
    """NEAR_STATES states: y0, and others that differ from it by up to a fifth of its scales."""
    y = problem.check_state(y0)
    draw = random.Random("near a state")
    near = [y]
    while len(near) < NEAR_STATES:
        other = y + 0.2 * problem.sizes(y) * np.array([draw.uniform(-1, 1) for _ in y])
        if kinds.rigid_body(problem):
            other[:4] /= np.linalg.norm(other[:4])
        with contextlib.suppress(ValueError):  # where H is not finite
            near.append(problem.check_state(other))
    return near


def extreme_fields(names: Starts) -> Iterator[Extreme]:
    for name in names[:2]:
        top, y0 = find(name)
        for h in (1e-300, -3.0, 30.0):
            yield f"{label(name)}, h = {h:g} (own unit)", top, y0, h
        momenta = np.zeros(len(y0), dtype=bool)
        momenta[top.system.space.momenta] = True
        for size in (1e-30, 1e30):
            yield f"{label(name)}, |J| = {size:g}", top, np.where(momenta, size * y0, y0), 0.3 / size
    if any(CHARGE in label(name) for name in names):
        top = PerturbedTop(LagrangeTop(1.0), POTENTIALS["charge"], (1.0, 0.0, 0.0, 1.0), axisymmetric=True)
        yield "falling into a charge", top, np.array((0.0, 0.0, 0.0, 0.6, 0.0, 0.8)), 0.1


@lru_cache(maxsize=64)
def _placed(name: str, kind: str) -> tuple[Any, Array]:
    top, y0 = states.find(name)
    size = float(np.linalg.norm(y0[3:]))
    if kind == TIDE:
        return PerturbedTop(top, POTENTIALS["tide"], (0.5 * top.alpha / size, 0.8, 0.0, 0.6)), y0
    place = (0.0, 0.0, 1.5 * size)
    return PerturbedTop(top, POTENTIALS["charge"], (0.2 * top.alpha * size**2, *place), axisymmetric=True), y0


# ---------------------------------------------------------------- shared

CHECKS: tuple[Check, ...] = (order, solution, symmetric, conserves, long_steps, poisson, purity, extremes, in_field)


def label(start: Start) -> str:
    """The name of a start in messages."""
    if isinstance(start, str):
        return start
    problem = start[0]
    name = problem if kinds.rigid_body(problem) else getattr(problem, "name", problem)
    return f"{name} from {np.round(start[1], 3).tolist()}"


def find(name: Start) -> tuple[Any, Array]:
    """The problem and state of a start: as `states.find`, and for "NAME in a tide" and "NAME near a charge"."""
    if not isinstance(name, str):
        return name[0], name[1].copy()
    for kind in (TIDE, CHARGE):
        if name.endswith(kind):
            top, y0 = _placed(name.removesuffix(kind), kind)
            return top, y0.copy()
    return states.find(name)


def _truth(names: Starts) -> str:
    return truths.name(find(names[0])[0])


def prepared(method: Method, top: Any, y: Array, h: float) -> Stepper:
    return method.prepare_for(top)(top, y.copy() if y.flags.writeable else y, float(h))


def same(a: Array, b: Array) -> bool:
    """The same bits."""
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def verdict(claim: str, passed: bool, how: str) -> Verdict:
    return Verdict(claim, bool(passed), None, "", how)


def not_judged(claim: str, why: str) -> Verdict:
    return Verdict(claim, None, None, "", why)
