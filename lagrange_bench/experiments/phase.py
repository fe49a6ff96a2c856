"""Phase: how far is the top from its true place on the torus?

A method that conserves every invariant can still be anywhere on the torus. The error against the exact solution is split along
the two flows of the torus: a time error (nutation phase) and an angle error (precession phase). The rest is drift off the torus.
Both phases are fitted by a constant frequency shift and a residual. Orders are measured on single steps.

Part “promise” tests the exact Bäcklund step: its error must be no larger than an initial state changed by some ulps would make.
It runs on every named top, on 400 others, on 300 that are released with pure spin, and on 32 close to the separatrix (quick
profile: 32, 32 and 8). On tops of every kind and on released ones it also runs without pins.

Part “theory” compares other methods with backward error analysis: `predicted_phase` predicts their phases. Times are in units of
1/(|J| + √(|alpha||x|)).
"""

from itertools import product

import numpy as np

from lagrange_bench.experiments.measuring import metrics, orders, states
from lagrange_bench.experiments.phase_figures import draw as draw
from lagrange_bench.experiments.phase_figures import tables as tables
from lagrange_bench.experiments.phase_runs import PROMISE_H, SPAN, STATES
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.backward_error.prediction import predicted_phase
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.truth import exact

VERSION = 3
SCALED_TIMES = True
MEASURED = {
    "h": ("time", "angle", "off", "error"),
    "order": ("h", "error"),
    "time": ("t", "time", "angle", "off", "error"),
    "promise": ("h", "error", "ulps"),
    "theory": ("t", "time", "angle", "off", "error", "predicted_time", "predicted_angle", "left",
               "clock", "turn", "clock_growth", "turn_growth"),
}  # fmt: skip

STEPS = {"quick": tuple(2.0**-k for k in range(7)), "full": tuple(2.0 ** (-k / 2) for k in range(-6, 19))}
LONG = {"quick": (0.25, 10**4), "full": (0.25, 4 * 10**6)}  # step and number of steps of the runs against time
LONG_STATES = {"quick": ("generic",), "full": ("generic", "figure1", "near_separatrix")}
PROMISE_STEPS = 2000  # steps of each size
PROMISE_TURNS = (0.25, 0.49, 0.5, 1.0, 1.5)  # sizes beside PROMISE_H, as fractions of the nutation period
PROMISE_RANDOM = {"quick": 16, "full": 200}  # tops of each drawn kind, at most
UNSTABLE_SPAN = 20.0  # length of the runs on orbits without a period: errors grow exponentially there
THEORY_STATES = {"quick": ("generic",), "full": STATES["full"]}
THEORY_SPAN = 512.0  # length of the runs that are compared with theory


def cells(profile: str) -> list[dict]:
    methods = states.methods_on()
    stepping = {name: method.order for name, method in methods.items() if method.control == "step"}
    on = [{"method": name, "state": state} for state in STATES[profile] for name in stepping]
    listed: list[dict] = [{"part": "h", **each, "h": h} for each in on for h in STEPS[profile]]
    listed += [{"part": "order", "method": name} for name, order in stepping.items() if order is not None]
    h, steps = LONG[profile]
    for state, (name, method) in product(LONG_STATES[profile], methods.items()):
        n = states.affordable(method, steps, profile == "full")
        listed.append({"part": "time", "method": name, "state": state, "h": h, "steps": n})
    for state, (name, order) in product(THEORY_STATES[profile], stepping.items()):
        listed += [{"part": "theory", "method": name, "state": state, "h": h} for h in theory_steps(order)]
    some = PROMISE_RANDOM[profile]
    any_kind = (*states.WIDE[:some], *states.RELEASED[:some], *states.SPINNING[:some])
    tops = (*TOPS, *(f"random{i:03d}" for i in range(some)), *states.CLOSE[: some // 2], *any_kind)
    promised = (*product(("backlund",), tops), *product(("backlund_unpinned",), any_kind))
    return listed + [{"part": "promise", "method": method, "state": state} for method, state in promised]


def measure(cell: dict) -> list[dict]:
    if cell["part"] == "order":
        return _one_step(cell["method"])
    top, y0 = states.of_cell(cell)
    rate, _, unit = top.scales(y0)
    if cell["part"] == "promise":
        return promised_errors(top, y0, cell["method"])
    if cell["part"] == "theory":
        return _against_theory(cell, top, y0)
    if cell["part"] == "h":
        errors = _followed(cell, top, y0, states.places(max(round(SPAN / cell["h"]), 1)))[2]
        return [{name: states.rounded(np.max(np.abs(e))) for name, e in errors.items()}]
    times, _, errors = _followed(cell, top, y0, states.log_counts(cell["steps"], per_octave=4))
    return states.as_rows({"t": times * rate, **errors})


def _one_step(name: str) -> list[dict]:
    """Errors of single steps above round-off, as geometric means over eight tops and both signs of h.

    Single steps show the order: in long runs a method of high order may show the next order, or round-off. If a step depends on
    earlier ones, short runs are made, and their errors divided by the number of steps: rows with `run`.
    """
    points = orders.order_points(METHODS[name], orders.SPANS)
    length = {"run": orders.RUN} if points.runs else {}
    pairs = zip(points.spans, points.errors, strict=True)
    return [{"h": states.rounded(h), "error": states.rounded(error), **length} for h, error in pairs]


def theory_steps(order: int | None) -> tuple[float, ...]:
    """Two steps at which a method of this order has a small error above round-off in runs of `THEORY_SPAN`."""
    return () if order is None else tuple(states.rounded(2.0 ** (k + 1 - 15 / order)) for k in (1, 0))


def _against_theory(cell: dict, top, y0) -> list[dict]:
    """Phase errors of a run, measured and predicted, and the distance of its states from the predicted ones (`left`)."""
    rate, _, unit = top.scales(y0)
    predicted = predicted_phase(top, y0, cell["h"] * unit, METHODS[cell["method"]])
    if predicted.clock is None:
        return [{"reason": predicted.reason}]
    times, y, errors = _followed(cell, top, y0, states.log_counts(round(THEORY_SPAN / cell["h"]), per_octave=1))
    time, angle = predicted.shifts(times)
    columns = {"t": times * rate, **errors, "predicted_time": time * rate, "predicted_angle": angle}
    columns["left"] = metrics.scaled_error(top, y0, y, predicted.states(times))
    rates = {"clock": predicted.clock, "turn": predicted.turn * unit}
    rates |= {"clock_growth": predicted.clock_growth * unit, "turn_growth": predicted.turn_growth * unit * unit}
    rates = {name: states.rounded(value) for name, value in rates.items()}
    return [row | rates for row in states.as_rows(columns)]


def _followed(cell: dict, top, y0, counts: list[int]) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Times, states and scaled errors: of time and angle (in radians of their own phase), off the torus, and of the whole state.

    Only a top in a uniform field has a known torus. Any other problem has the error of the whole state alone.
    """
    h, method = cell["h"] * top.scales(y0)[2], METHODS[cell["method"]]
    times, y = states.sample(top, y0, cell["method"], h, counts, **states.options_of(cell))
    truth = states.truth(top, y0, method, h, counts)
    whole = metrics.scaled_error(top, y0, y, truth)
    if not kinds.uniform(top):
        return times, y, {"error": whole}
    split = metrics.phase_split(top, truth, y - truth)
    rate, size, _ = top.scales(truth[0])
    # off the torus: √Σ (c_I |∇I|)², for the error Σ c_I ∇I
    gradients = np.array([top.gradients(right) for right in truth]) / np.repeat((rate, size), 3)
    lengths = dict(zip(INVARIANTS, np.linalg.norm(gradients, axis=-1).T, strict=True))
    off = np.sqrt(sum(np.square(split[name] * lengths[name]) for name in INVARIANTS))
    return times, y, {"time": split["time"] * top.scales(y0)[0], "angle": split["angle"], "off": off, "error": whole}


def promised_errors(top, y0, method) -> list[dict]:
    """For each step size: the largest error at twenty places of 2000 steps, and the ulps of y0 that make the same error."""
    period = exact.nutation_period(top, y0) * top.scales(y0)[0]
    steps = [*PROMISE_H, *(period * part for part in PROMISE_TURNS if np.isfinite(period))]
    return [_promised_error(top, y0, method, h) for h in steps]


def _promised_error(top, y0, method, h) -> dict:
    unit = top.scales(y0)[2]
    unstable = np.isinf(exact.nutation_period(top, y0))
    steps = max(int(UNSTABLE_SPAN / unit / h), 1) if unstable else PROMISE_STEPS
    counts = states.places(steps, 20)
    times, y = states.sample(top, y0, method, h * unit, counts)
    error = metrics.scaled_error(top, y0, y, exact.after_steps(top, y0, h * unit, counts))
    ulps = error / (metrics.condition(top, y0, times) * np.finfo(float).eps)
    return {"h": h, "error": states.rounded(np.max(error)), "ulps": states.rounded(np.max(ulps))}
