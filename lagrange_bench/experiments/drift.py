"""Drift: which invariants does a method keep, how should the exact step be coded, and what is left after 10⁹ steps?

Every method follows sixteen random tops and the named ones. The relative error of each invariant is recorded at log-spaced
times. Its root mean square over the sixteen tops grows like t^p. The verdict is bounded (p near 0), a random walk of round-off
(p near 1/2, Brouwer's law) or biased (p near 1). A quantity that a method itself claims to conserve, such as a modified energy,
is followed, too.

The part `h` varies h at a fixed length of run. The part `long` takes exact Bäcklund steps of about half a nutation period and
more, on tops of every kind. The part `form` compares ways to write the exact Bäcklund step, which are the same map but for
rounding: how the errors grow, and how far the phase is off. The part `form_cost` times them. The part `longest` takes a thousand
million exact steps, and gives heyoka the same wall time. Times and steps are in units of 1/(|J| + √(|alpha||x|)).
"""

from functools import partial
from time import perf_counter

import numpy as np

from lagrange_bench.experiments.drift_figures import draw as draw
from lagrange_bench.experiments.drift_figures import tables as tables
from lagrange_bench.experiments.measuring import metrics, states, timing
from lagrange_bench.experiments.step_forms import FORM_INVARIANTS, FORMS, OWN, PROGRAM
from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.interface import INVARIANTS, Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.truth import exact

VERSION = 3
SCALED_TIMES = True
FORM_ERRORS = ("t", *FORM_INVARIANTS, "time", "angle", "error")
MEASURED = {  # part → the numbers that each of its rows must have, see `reductions`
    "time": ("t", *INVARIANTS),
    "h": INVARIANTS,
    "long": ("fraction", *INVARIANTS),
    "form": FORM_ERRORS,
    "form_cost": ("ns_per_step", "ns_per_step_median"),
    "longest": FORM_ERRORS,
}

STEP = 0.125  # of the runs against time
STEPS = (10**5, 10**7)  # how many steps, in the quick and in the full profile
NAMED = ("generic", "figure1", "through_pole", "near_separatrix")  # named tops of the quick profile
SIZES = {"quick": (1 / 4, 1 / 2, 1.0), "full": tuple(2.0**k for k in range(-6, 3))}  # steps tried against h
SPAN = 10**4  # length of the runs against h
H_STATES = {"quick": ("generic",), "full": ("generic", "figure1")}
FRACTIONS = (0.51, 1.0, 1.3)  # long steps, in nutation periods
LONG_TOPS = {"quick": 16, "full": len(states.WIDE)}  # how many tops take long steps
LONG_STEPS = {"quick": 10**4, "full": 10**6}  # how many long steps each takes, of each method and each form
FORM_STEPS = {"quick": {STEP: 2 * 10**4}, "full": {STEP: 10**7, 1.0: 2 * 10**6}}  # h → how many steps each form takes
FORM_STATE = "generic"  # of the timed steps, and of the longest run
LONGEST = {"quick": 10**6, "full": 10**9}  # steps of the longest run


def cells(profile: str) -> list[dict]:
    return _cells_of_methods(profile) + _cells_of_forms(profile)


def _cells_of_methods(profile: str) -> list[dict]:
    methods, full = states.methods_on(), profile == "full"
    listed = []
    # state by state, so that two workers do not compile the same method at the same time
    for state in (*states.RANDOM, *(TOPS if full else NAMED)):
        for name, method in methods.items():
            steps = states.affordable(method, STEPS[full], full)
            # only methods exact in time take all steps on each named top
            if state in TOPS and method.order is not None:
                steps //= 10
            listed.append({"part": "time", "method": name, "state": state, "h": STEP, "steps": steps})
    for state in H_STATES[profile]:
        for name in (name for name, method in methods.items() if method.control == "step"):
            for h in SIZES[profile]:
                listed.append({"part": "h", "method": name, "state": state, "span": SPAN, "h": h})
    exact_steps = [name for name, method in methods.items() if method.family == "backlund" and method.order is None]
    for state in states.WIDE[: LONG_TOPS[profile]]:
        for name in exact_steps:
            listed.append({"part": "long", "method": name, "state": state, "steps": LONG_STEPS[profile]})
    return listed


def _cells_of_forms(profile: str) -> list[dict]:
    sizes = FORM_STEPS[profile]
    runs = [(form, {"h": h}, steps) for h, steps in sizes.items() for form in FORMS]
    # the paper's program has no turn about e3, which long steps need
    long = [form for form in FORMS if form != PROGRAM]
    runs += [(form, {"fraction": fraction}, LONG_STEPS[profile]) for fraction in FRACTIONS for form in long]
    listed: list[dict] = [
        {"part": "form", "form": form, "state": state, **step, "steps": steps}
        for form, step, steps in runs
        for state in states.RANDOM
    ]
    listed += [{"part": "form_cost", "timing": True, "h": h} for h in sizes]
    longest = {"part": "longest", "timing": True, "state": FORM_STATE, "h": STEP, "steps": LONGEST[profile]}
    return [*listed, longest]


def measure(cell: dict) -> list[dict]:
    part = cell["part"]
    if part == "form_cost":
        return _form_cost(cell["h"])
    top, y0 = states.of_cell(cell)
    if part == "long":
        period, counts = exact.nutation_period(top, y0), states.log_counts(cell["steps"], per_octave=1)
        return [{"fraction": f, **_largest(cell, top, y0, f * period, counts)} for f in FRACTIONS]
    h = cell["fraction"] * exact.nutation_period(top, y0) if "fraction" in cell else cell["h"] * top.scales(y0)[2]
    if part == "longest":
        return _longest(top, y0, h, states.log_counts(cell["steps"], per_octave=1))
    steps = round(cell["span"] / cell["h"]) if part == "h" else cell["steps"]
    counts = states.log_counts(steps, per_octave=4)
    if part == "form":
        return _stepped(top, y0, FORMS[cell["form"]](top, y0, h), h, counts)
    return [_largest(cell, top, y0, h, counts)] if part == "h" else against_steps(cell, top, y0, h, counts)


def against_steps(cell: dict, top, y0: np.ndarray, h: float, counts: list[int]) -> list[dict]:
    """Rows of errors, one after each of `counts` steps."""
    times, _, drift = followed(cell, top, y0, h, counts)
    return states.as_rows({"t": times * top.scales(y0)[0], **drift})


def _largest(cell: dict, top, y0: np.ndarray, h: float, counts: list[int]) -> dict[str, float]:
    """The largest value of each error over `counts` steps."""
    _, _, drift = followed(cell, top, y0, h, counts)
    return {name: states.rounded(np.max(np.abs(error))) for name, error in drift.items()}


def followed(
    cell: dict, top, y0: np.ndarray, h: float, counts: list[int]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Times, states, and relative errors of the problem's invariants and of the method's own conserved quantities."""
    from lagrange_bench.integrators import METHODS

    times, after = states.sample(top, y0, cell["method"], h, counts, **states.options_of(cell))
    y = np.vstack((y0, after))
    columns = _of_invariants(top, times, y)
    # these hold in a uniform field
    own_quantities = METHODS[cell["method"]].claims.conserves_own if kinds.uniform(top) else {}
    for own, quantity in own_quantities.items():
        values, size = quantity(top, h, y)
        columns[OWN + own] = (values[1:] - values[0]) / size
    return times, after, columns


def _of_invariants(top, times: Array, y: Array) -> dict[str, Array]:
    """The relative error of each invariant at `times` (N,). y : the states from the start on, (N + 1, n)."""
    values = top.invariants(y, np.concatenate(((0.0,), times)))
    drift = metrics.relative_drift(values, top.invariant_scales(y[0]))
    return dict(zip(top.names, drift[1:].T, strict=True))


def _stepped(top, y0: Array, stepper, h: float, counts: list[int]) -> list[dict]:
    """Rows of the errors of a stepper of the exact map, one after each of `counts` steps."""
    after = np.array([y for y, _ in states.follow(stepper, y0, counts)])
    return _errors(top, y0, h * np.array(counts, dtype=float), after, exact.after_steps(top, y0, h, counts))


def _errors(top, y0: Array, times: Array, after: Array, truth: Array) -> list[dict]:
    """Rows of the relative errors of the invariants, the phase errors (time, angle) and the whole error, in scaled units."""
    rate = top.scales(y0)[0]
    split = metrics.phase_split(top, truth, after - truth)
    drift = _of_invariants(top, times, np.vstack((y0, after)))
    columns = {"t": times * rate, **{name: drift[name] for name in FORM_INVARIANTS}}
    columns |= {"time": split["time"] * rate, "angle": split["angle"]}
    columns["error"] = metrics.scaled_error(top, y0, after, truth)
    return states.as_rows(columns)


def _form_cost(h_scaled: float) -> list[dict]:
    """Time all forms in turn in one process."""
    top, y0 = states.find(FORM_STATE)
    h, n = h_scaled * top.scales(y0)[2], 20_000
    runs = {name: partial(build(top, y0, h).advance, y0, n) for name, build in FORMS.items()}
    timed = timing.interleave(runs, min_time=0.01, repeats=7)
    return [
        {
            "form": name,
            "ns_per_step": states.rounded(t.min / n * 1e9),
            "ns_per_step_median": states.rounded(t.median / n * 1e9),
            "samples_ns": [states.rounded(sample / n * 1e9) for sample in t.samples],
        }
        for name, t in timed.items()
    ]


def _longest(top, y0: Array, h: float, counts: list[int]) -> list[dict]:
    """Run the exact Bäcklund map over all steps, then heyoka, for the same wall time and at most as far.

    heyoka shortens its own steps only to end at the times 16 h, 32 h, 64 h and so on.
    """
    from lagrange_bench.integrators.methods import taylor

    stepper = prepare(top, y0, h, "backlund")
    stepper.advance(y0, 1000)
    start = perf_counter()
    rows = [{"method": "backlund", **row} for row in _stepped(top, y0, stepper, h, counts)]
    allowed = perf_counter() - start
    try:
        heyoka = taylor.integrator_here(taylor.EPS, False)
    except ImportError:
        return rows
    heyoka.time, heyoka.state[:], heyoka.pars[0] = 0.0, y0, top.alpha
    times, after, clock, t = [], [], 0.0, 16 * h
    start = perf_counter()
    while clock < allowed and t <= counts[-1] * h:
        heyoka.propagate_until(t)
        after.append(heyoka.state.copy())
        times.append(t)
        clock = perf_counter() - start
        t *= 2
    found = _errors(top, y0, np.array(times), np.array(after), exact.solution(top, y0, times))
    return rows + [{"method": "taylor", **row} for row in found]
