"""Tests the claims of a method, for `lagrange-bench check METHOD` and for the tests of the bench.

No method gets special treatment: `Method.prepare` makes the steppers, and only `advance` and `record` are called. A fresh stepper
is prepared for every initial state, because a stepper may belong to a torus. Spans are steps in units of the top's time scale.

The same functions test a method wherever it goes: on tops with either sign of alpha, in a tide, near a charge, on a vibrating
pivot, on bodies, and on a problem of the user's own. A tide is quadratic and breaks the symmetry, a charge on the vertical is not
quadratic and keeps it, a vibrating pivot drives the top.
"""

from __future__ import annotations

import contextlib
import random
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.experiments.measuring import first_step, metrics, orders
from lagrange_bench.experiments.measuring.duties import extremes, purity
from lagrange_bench.experiments.measuring.states import CHARGE, NEGATIVE, PIVOT, TIDE, Starts, placed, prepared
from lagrange_bench.experiments.measuring.verdicts import NOT_CLAIMED, Verdict, Worst
from lagrange_bench.integrators.interface import Array, Method, StepError, StepWarning
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.registry import find_method
from lagrange_bench.integrators.start import Start
from lagrange_bench.integrators.truth import truths

EPS = float(np.finfo(float).eps)

# ---------------------------------------------------------------- where claims are tested

ORDER_STATES = (*orders.STATES[:4], *(name + NEGATIVE for name in orders.STATES[4:]))
STATES = ("generic", "figure1", "random000", "random001" + NEGATIVE)
FIELDS = {"in a field": (TIDE, CHARGE), "on a vibrating pivot": (PIVOT,)}
# a method for bodies is tested on those of these that it takes
BODIES = {
    "heavy body": RigidBody(0.8, (0.1, -0.3, 0.9), np.diag((0.4, 0.5, 0.3)), (0.0, 0.0, -9.81)),
    "free body": RigidBody(0.8, (0.0, 0.0, 0.0), np.diag((0.4, 0.5, 0.3)), (0.0, 0.0, 0.0)),
}
BODY_START = np.array((0.8, 0.2, -0.4, 0.4, 0.3, -0.9, 3.0))
# states at and near one of the user's own
NEAR_STATES = 8

# ---------------------------------------------------------------- steps and bounds

# no series reaches the last: a method may decline it, but must keep its claims otherwise
SPANS = (0.1, 0.5, 3.0)
AT = "h_scaled = 0.1, 0.5, 3, {} states"
# steps that a method may refuse, and how many are taken
LONG_SPANS, LONG_RUNS = (10.0, 30.0, 100.0, 1e4), (1, 10)
# steps of the runs that test conservation outside a uniform field
FIELD_STEPS = 1000
# ulps for each time scale of a step: round-off grows with the angle of the turn
A_UNIT = 256
# ulps a step that round-off may change an invariant by: always the same way, or either way
BIAS, WALK = 8, 128
# an error below this over some hundred steps is round-off
EXACT = 1e-12
# of a run of t = 20 with a default tolerance
FOLLOWS = 1e-4
# of the scales: a run with a larger error says nothing about accuracy
LOST = 0.1
# two steps have some hundred roundings, and a method of order 8 that is not symmetric errs by far more
SYMMETRIC = 256 * EPS
# at a state of the user's own a rounding may weigh more
SYMMETRIC_NEAR = 1024 * EPS
# of differences of order 6
POISSON = 1e-8
# of a measured order in a potential, which varies over less than |x|: beyond order 5 the next term shows in doubles
FIELD_TOLERANCE = 0.3
# fewer steps show no order
FEWEST = 4
# errors of higher order fall from the largest to the least that count in few steps, and tops may have none in common
HIGH_ORDER = 12

# the only verdict on a method that takes none
TAKES_A_STEP = "takes a step"

Check = Callable[[Method, bool], Iterator[Verdict]]


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
        return [Verdict(TAKES_A_STEP, False, fault)]
    checks = CHECKS if record.takes(LagrangeTop()) is None else (of_its_kind,)
    if problem is not None:
        checks = (_on(problem, y0, record, getattr(problem, "name", str(problem))),)
    verdicts: list[Verdict] = []
    for function in checks:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", StepWarning)
                verdicts += function(record, quick)
        except (Exception, SystemExit) as error:  # a plug-in may raise anything
            evidence = f"ended in {first_step.describe(error, record, word)}"
            verdicts.append(Verdict(function.__name__.replace("_", " "), False, evidence))
    return verdicts


# ---------------------------------------------------------------- accuracy


def order(method: Method, quick: bool, names: Starts = ORDER_STATES) -> Iterator[Verdict]:
    """The error of one step grows like h^(p+1): see `orders`."""
    claimed = method.order
    if claimed is None:
        return
    claim = f"order {claimed}"
    if method.control == "tolerance":
        yield Verdict(claim, None, "h is only the output grid")
        return
    points = orders.order_points(method, orders.SPANS, names)
    if points.exact:
        yield Verdict(claim, None, "every step here is exact up to round-off, as at an equilibrium")
        return
    tolerance = orders.TOLERANCE if kinds.uniform(placed(names[0]).top) else FIELD_TOLERANCE
    if len(points.spans) < FEWEST:
        evidence = f"fewer than {FEWEST} steps have an error of {orders.FLOOR:g} to {orders.CEILING:g} on all states"
        yield Verdict(claim, None if claimed > HIGH_ORDER else False, evidence)
        return
    p = float(np.polyfit(np.log(points.spans), np.log(points.errors), 1)[0]) - 1
    runs = f"runs of t = {orders.RUN:g}, for a step depends on those before," if points.runs else "one step"
    steps = f"h from {points.spans[-1]:.2g} to {points.spans[0]:.2g}, ± h"
    evidence = f"{runs} against the {_truth(names)}, {steps}, {len(names)} states"
    hidden = orders.hides_leading_term(points.spans[-1], p - claimed, tolerance)
    yield Verdict(claim, None if hidden else abs(p - claimed) <= tolerance, evidence, p, f"{claimed} ± {tolerance}")


def solution(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """The accuracy of methods that are exact in time or control their error, and the accuracy of any method for h < 0."""
    forwards, backwards = Worst(), Worst()
    span, n = 0.25, 80
    for start in map(placed, names):
        top, y0, h = start.top, start.state, span * start.unit
        end = truths.after_steps(top, y0, h, [n])[0]
        y = prepared(method, top, y0, h).advance(y0, n)
        forwards = forwards.worse_of(float(metrics.scaled_error(top, y0, y, end)), start, span)
        y = prepared(method, starting_later(top, n * h), end, -h).advance(end, n)
        backwards = backwards.worse_of(float(metrics.scaled_error(top, y0, y, y0)), start, -span)
    if method.control == "step" and method.order is None:
        evidence = f"{n} steps against the {_truth(names)}, h_scaled = {span}, {len(names)} states"
        yield forwards.verdict("exact in time", EXACT, evidence)
    elif method.control == "tolerance":
        evidence = f"default tolerance, t = {n * span:g}, {len(names)} states"
        yield forwards.verdict(f"follows the {_truth(names)}", FOLLOWS, evidence)
    # the two errors differ by a factor of order one, unless they are round-off or the way there is lost
    evidence = f"largest error of the way back from t = {n * span:g}, against {forwards.size:.1e} of the way there"
    verdict = backwards.verdict("negative h is as accurate", 10 * forwards.size + EXACT, evidence)
    yield replace(verdict, passed=None) if forwards.size > LOST else verdict


def starting_later(problem: Any, t: float) -> Any:
    """The problem with its start moved by t."""
    return problem.starting_at(problem.start + t) if getattr(problem, "timed", False) else problem


# ---------------------------------------------------------------- structure


def steps_on(names: Starts) -> Iterator[tuple[Start, Any, Array, float, float]]:
    """For each start and each of SPANS: the start, its problem and state, the step in time scales, and the step."""
    for name, span in product(names, SPANS):
        start = placed(name)
        yield start, start.top, start.state, span, span * start.unit


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
        yield Verdict("symmetric", None, NOT_CLAIMED)
        return
    worst = Worst()
    for start, top, y0, span, h in steps_on(names):
        with declines_long_steps(span):
            stepped = prepared(method, top, y0, h).advance(y0, 1)
            back = prepared(method, starting_later(top, h), stepped, -h).advance(stepped, 1)
            worst = worst.worse_of(float(metrics.scaled_error(top, y0, back, y0)), start, span)
    bound = SYMMETRIC if isinstance(names[0], str) else SYMMETRIC_NEAR
    yield worst.verdict("symmetric", bound, f"a step and its inverse, {AT.format(len(names))}")


def poisson(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """D P(y) Dᵀ = P(ỹ) for the derivative D of one step."""
    if not method.claims.poisson:
        yield Verdict("Poisson map", None, NOT_CLAIMED)
        return
    worst = Worst()
    names = names[:2] if quick else names
    for start, top, y0, span, h in steps_on(names):
        with declines_long_steps(span):
            result = metrics.poisson_defect(lambda y: prepared(method, top, y, h).advance(y, 1), top, y0)  # noqa: B023
            if span < 1 or result.error <= POISSON:  # or the map bends too much for differences
                worst = worst.worse_of(result.defect, start, span)
    evidence = f"‖D P(y) Dᵀ − P(ỹ)‖, D by central differences of order 6, {AT.format(len(names))}"
    yield worst.verdict("Poisson map", POISSON, evidence)


def conserves(method: Method, quick: bool, names: Starts = STATES, steps: int | None = None) -> Iterator[Verdict]:
    """The claimed invariants change by round-off only, for small and large h. Other invariants are only reported.

    Roundings that go either way add up like √n. Roundings that always go the same way add up like n: a fault of 0.4 ulps a step
    shows after 10⁵ steps.
    """
    n = steps or (10_000 if quick else 100_000)
    if method.control == "tolerance":  # each has many steps of the method's own
        n //= 2500 if method.engine == "scipy" else 500
    n = max(n, 10)
    drifts: defaultdict[str, Worst] = defaultdict(Worst)
    claimed: defaultdict[str, set[str]] = defaultdict(set)  # quantity → the starts where it is claimed
    stopped: dict[float, str] = {}  # step in time scales → why
    starts = [placed(name) for name in names]
    for start in starts:
        for quantity in (*start.top.conserved_by(method), *_own_quantities(method, start.top)):
            claimed[quantity].add(start.name)
    for start, top, y0, span, h in steps_on(names):
        try:
            y = prepared(method, top, y0, h).record(y0, n, n // 10)
        except StepError as error:
            if span < 1:
                stopped.setdefault(span, f"{error.reason} ({start.name})")
            continue
        own_quantities = {name: value(top, h, y) for name, value in _own_quantities(method, top).items()}
        for quantity, size in _drifts(top, y0, h * (n // 10), y, own_quantities).items():
            # where a quantity is not claimed, it says nothing about the claim elsewhere
            if start.name in claimed[quantity] or not claimed[quantity]:
                drifts[quantity] = drifts[quantity].worse_of(size, start, span)
    tops = [start.top for start in starts]
    conserved = dict.fromkeys(word for top in tops for word in top.names if word in top.conserved)
    invariants = set(conserved)
    if any(name.startswith("C") for name in invariants):  # C1 and C2 stand for all Casimirs
        invariants |= {"C1", "C2"}
    for word in sorted(method.claims.conserves - invariants):
        why = f"{tops[0].description} does not have; its invariants are {', '.join(conserved)}"
        yield Verdict(f"conserves {word}", None, f"claims {word}, which {why}. Name a problem that has it by --problem")
    bound = EPS * min(BIAS * n, WALK * n**0.5)
    for quantity in dict.fromkeys((*conserved, *claimed)):
        if quantity not in drifts:
            yield Verdict(f"conserves {quantity}", None, f"no run gets through {n} steps")
            continue
        evidence = f"largest error over {n} steps, {AT.format(len(claimed[quantity] or names))}"
        verdict = drifts[quantity].verdict(f"conserves {quantity}", bound, evidence)
        not_claimed = replace(verdict, passed=None, bound="", how=f"{NOT_CLAIMED}; {verdict.how}")
        yield verdict if claimed[quantity] else not_claimed
    if stopped:  # a fault only at the smallest step: an explicit method may be unstable at others
        evidence = "; ".join(f"fails at h_scaled = {span:g}: {why}" for span, why in stopped.items())
        yield Verdict(f"takes {n} steps", None if min(stopped) > SPANS[0] else False, evidence)


def _own_quantities(method: Method, top: Any) -> Mapping[str, Any]:
    """The quantities that a method says it conserves of its own: in a uniform field only."""
    return method.claims.conserves_own if kinds.uniform(top) else {}


def _drifts(top: Any, y0: Array, dt: float, y: Array, quantities: dict[str, tuple[Array, float]]) -> dict[str, float]:
    """The largest drift of each conserved invariant, and of each of `quantities`, over states (N, n) at equal intervals."""
    with np.errstate(over="ignore", invalid="ignore"):  # a run may go astray
        values = top.invariants(y, dt * np.arange(len(y)))
        drift = np.max(np.abs(metrics.relative_drift(values, top.invariant_scales(y0))), axis=0)
    drifts = {word: size for word, size in zip(top.names, drift, strict=True) if word in top.conserved}
    return drifts | {name: np.max(np.abs(values - values[0]) / unit) for name, (values, unit) in quantities.items()}


def long_steps(method: Method, quick: bool, names: Starts = STATES) -> Iterator[Verdict]:
    """The claimed invariants are also conserved in very long steps and next to the upright top, unless a step is refused."""
    nearly_upright = (Start(LagrangeTop(1.0), np.array((tilt, 0.0, 0.3, tilt, 0.0, 1.0))) for tilt in (1e-3, 1e-9))
    starts = (*map(placed, names), *nearly_upright) if method.control == "step" else ()
    worst = Worst()
    for start, span, steps in product(starts, LONG_SPANS, LONG_RUNS):
        top, y0, h = start.top, start.state, span * start.unit
        with contextlib.suppress(StepError):
            drifts = _drifts(top, y0, h, prepared(method, top, y0, h).record(y0, steps, 1), {})
            size = np.max([drifts[word] for word in top.conserved_by(method)], initial=0.0)
            worst = worst.worse_of(size / (A_UNIT * EPS * span), start, span)
    if worst.at:
        evidence = f"steps of h_scaled = 10, 30, 100, 1e4 that are not refused, over {A_UNIT} ulps for each unit of it"
        yield worst.verdict("conserves in long steps", 1.0, evidence)


# ---------------------------------------------------------------- in other fields, on bodies, on a problem of the user's own


def in_field(method: Method, quick: bool) -> Iterator[Verdict]:
    """The same claims on tops in a potential and on a vibrating pivot, where the method takes them."""
    for where, fields in FIELDS.items():
        accepted_fields = [field for field in fields if method.takes(placed("generic" + field).top) is None]
        if accepted_fields:
            names = tuple(name + field for name in ("generic", "random001") for field in accepted_fields)
            ordered = tuple(name + field for name in orders.STATES for field in accepted_fields)
            yield from _claims(method, quick, where, ordered, names, names)
        else:
            yield Verdict(where, None, str(method.takes(placed("generic" + fields[0]).top)))


def of_its_kind(method: Method, quick: bool) -> Iterator[Verdict]:
    """The same claims on a heavy and on a free body of any shape, for methods that take only bodies."""
    accepted_bodies = {name: body for name, body in BODIES.items() if method.takes(body) is None}
    for name, body in accepted_bodies.items():
        yield from _on(body, BODY_START, method, name)(method, quick)
    if not accepted_bodies:
        yield Verdict("claims", None, f"{method.takes(BODIES['free body'])}. Name a problem that it takes by --problem")


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
        *(() if where in FIELDS else purity(method, quick, names[:2])),
        *extremes(method, quick, names),
    ):
        yield replace(verdict, claim=f"{where}: {verdict.claim}")


def _on(problem: Any, y0: ArrayLike | None, method: Method, where: str) -> Check:
    """A check of all claims on a problem, at y0 and near it. ValueError if the problem, the method and y0 do not fit."""
    if not hasattr(problem, "offers"):
        raise ValueError(f"problem must be a Problem or a top; got {type(problem).__name__}")
    if reason := method.takes(problem):
        raise ValueError(f"problem: {reason}")
    if y0 is None:
        raise ValueError("y0: give a state of the problem")
    if not np.isfinite(problem.scales(problem.check_state(y0))[2]):
        raise ValueError(f"y0: {where} has no time scale there, so nothing can be measured")
    name = getattr(problem, "name", where)
    starts = [Start(problem, y, given_name=f"{name} from {np.round(y, 3).tolist()}") for y in _states_near(problem, y0)]

    def claims(method: Method, quick: bool) -> Iterator[Verdict]:
        yield from _claims(method, quick, where, starts, starts[:2], starts[:4])

    return claims


def _states_near(problem: Any, y0: ArrayLike) -> list[Array]:
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


# ---------------------------------------------------------------- shared

CHECKS: tuple[Check, ...] = (order, solution, symmetric, conserves, long_steps, poisson, purity, extremes, in_field)


def _truth(names: Starts) -> str:
    return truths.name(placed(names[0]).top)
