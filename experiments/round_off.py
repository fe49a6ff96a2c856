"""Round-off: which way of writing the exact Bäcklund step drifts least?

In exact arithmetic all forms here are the same map; only rounding differs. Sixteen random tops take ten million steps with each
form. How do the errors of H, C1 and C2 grow (exponent ½: a random walk, 1: a bias)? How far is the phase off, and what does a
step cost? Steps of half a nutation period and more are tried, too. A second part takes a thousand million steps of the exact
Bäcklund map, and gives heyoka the same wall time. Steps and times are in units of 1/(|J| + √(|alpha||x|)).
"""

import math
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.reductions import largest, mean_square, worst
from lagrange_bench.experiments.measuring.states import RANDOM, as_rows, find, follow, log_counts, rounded
from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.compiling.loops import NEVER, FixedStepper
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus.real_map import ETA, R
from lagrange_bench.integrators.truth import exact

VERSION = 3
SCALED_TIMES = True

SIZES = (0.125, 1.0)
STEPS = {"quick": (2 * 10**4,), "full": (10**7, 2 * 10**6)}  # for each size
FRACTIONS = (0.51, 1.0, 1.3)  # of the nutation period
FRACTION_STEPS = {"quick": 10**4, "full": 10**6}
LONG = {"quick": 10**6, "full": 10**9}
LONG_STATE = "generic"
INVARIANTS = ("H", "C1", "C2")
ERRORS = ("t", *INVARIANTS, "time", "angle", "error")
MEASURED = {"drift": ERRORS, "cost": ("ns_per_step", "ns_per_step_median"), "long": ERRORS}


# ---------------------------------------------------------------- forms of the Bäcklund step


class FormStepper(real_map.TorusStepper):
    """A stepper that also takes states off its torus, because some forms drift away from it."""

    def enter(self, y: Array) -> Array:
        return self.units.enter(y)


def exact_map(kernel: Callable[..., Any], pin: int = 0) -> Callable[..., FixedStepper]:
    """A builder of steppers with exact λ(h) and this kernel. pin : steps between two corrections of the invariants; 0: none."""

    def build(top, y0, h):
        units = Units(top, y0, h)
        state = units.enter(y0)
        c, turn = real_map.exact_constants(units.alpha, tuple(state), units.time(h))
        back, block = (real_map.restore_invariants, pin) if pin else (None, NEVER)
        return FormStepper("form", h, units, c, kernel, back, block, turn=turn)

    return build


def program(top, y0, h):
    """A stepper of the paper's program, with the exact λ(h)."""
    units = Units(top, y0, h)
    c, _ = real_map.exact_constants(units.alpha, tuple(units.enter(y0)), units.time(h))
    shift = units.length - units.rate
    return prepare(top, y0, h, "backlund_textbook", lam=complex(math.ldexp(c[R], shift), math.ldexp(c[ETA], shift)))


FORMS: dict[str, Callable[..., Any]] = {
    "paper's program": program,
    "increments": exact_map(real_map.step),
    "x turned": exact_map(real_map.turning_step),
    "compensated": exact_map(real_map.compensated_step),
    "pinned, every 1024": exact_map(real_map.step, 1024),
    "pinned, every 64": exact_map(real_map.step, 64),
    "pinned, every 8": exact_map(real_map.step, 8),
    "pinned, every step": exact_map(real_map.step, 1),
}


def cells(profile: str) -> list[dict]:
    sizes = SIZES[: len(STEPS[profile])]
    listed: list[dict] = [
        {"part": "drift", "form": form, "state": state, "h": h, "steps": steps}
        for h, steps in zip(sizes, STEPS[profile], strict=True)
        for form in FORMS
        for state in RANDOM
    ]
    listed += [
        {"part": "drift", "form": form, "state": state, "fraction": fraction, "steps": FRACTION_STEPS[profile]}
        for fraction in FRACTIONS
        for form in FORMS
        if form != "paper's program"  # it has no turn about e3, which long steps need
        for state in RANDOM
    ]
    listed += [{"part": "cost", "timing": True, "h": h} for h in sizes]
    listed.append({"part": "long", "timing": True, "state": LONG_STATE, "h": SIZES[0], "steps": LONG[profile]})
    return listed


def measure(cell: dict) -> list[dict]:
    return {"drift": _drift, "cost": _cost, "long": _long}[cell["part"]](cell)


def _follow(top, y0, stepper, h: float, counts: list[int]) -> list[dict]:
    states = [y for y, _ in follow(stepper, y0, counts)]
    truth = exact.after_steps(top, y0, h, counts)
    return judged(top, y0, h * np.array(counts, dtype=float), np.array(states), truth)


def judged(top, y0, times, states, truth) -> list[dict]:
    """Rows of the relative errors of the invariants, the phase errors (time, angle) and the whole error, in scaled units."""
    rate = top.scales(y0)[0]
    split = metrics.phase_split(top, truth, states - truth)
    drift = metrics.relative_drift(top.invariants(np.vstack((y0, states))), top.invariant_scales(y0))[1:]
    columns = {"t": times * rate, "H": drift[:, 0], "C1": drift[:, 2], "C2": drift[:, 3]}
    columns |= {"time": split["time"] * rate, "angle": split["angle"]}
    columns["error"] = metrics.scaled_error(top, y0, states, truth)
    return as_rows(columns)


def _drift(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    h = cell["fraction"] * exact.nutation_period(top, y0) if "fraction" in cell else cell["h"] * top.scales(y0)[2]
    stepper = FORMS[cell["form"]](top, y0, h)
    return _follow(top, y0, stepper, h, log_counts(cell["steps"], per_octave=4))


def _cost(cell: dict) -> list[dict]:
    """Time all forms in turn in one process."""
    top, y0 = find(LONG_STATE)
    h, n = cell["h"] * top.scales(y0)[2], 20_000
    runs = {name: partial(build(top, y0, h).advance, y0, n) for name, build in FORMS.items()}
    timed = timing.interleave(runs, min_time=0.01, repeats=7)
    return [
        {
            "form": name,
            "ns_per_step": rounded(t.min / n * 1e9),
            "ns_per_step_median": rounded(t.median / n * 1e9),
            "samples_ns": [rounded(sample / n * 1e9) for sample in t.samples],
        }
        for name, t in timed.items()
    ]


def _long(cell: dict) -> list[dict]:
    """Run the exact Bäcklund map over all steps, then heyoka, with its own steps, for the same wall time."""
    top, y0 = find(cell["state"])
    h = cell["h"] * top.scales(y0)[2]
    counts = log_counts(cell["steps"], per_octave=1)
    stepper = prepare(top, y0, h, "backlund")
    stepper.advance(y0, 1000)
    start = perf_counter()
    rows = [{"method": "backlund", **row} for row in _follow(top, y0, stepper, h, counts)]
    allowed = perf_counter() - start
    try:
        natural = _heyoka(top, y0)
    except ImportError:
        return rows
    times, states, clock, t = [], [], 0.0, 16 * h
    start = perf_counter()
    while clock < allowed and t <= counts[-1] * h:
        states.append(natural(t))
        times.append(t)
        clock = perf_counter() - start
        t *= 2
    truth = exact.solution(top, y0, times)
    return rows + [{"method": "taylor", **row} for row in judged(top, y0, np.array(times), np.array(states), truth)]


def _heyoka(top, y0) -> Callable[[float], Any]:
    """heyoka as a function of time that goes on from the last time. It shortens its last step to end at the time."""
    from lagrange_bench.integrators.methods.taylor import EPS, integrator_here

    ta = integrator_here(EPS, False)
    ta.time, ta.state[:], ta.pars[0] = 0.0, y0, top.alpha

    def until(t: float) -> Any:
        ta.propagate_until(t)
        return ta.state.copy()

    return until


@of_part(
    "",
    "Ways to write a step: largest relative error of each invariant, exponent of its growth, phase error, "
    "nanoseconds a step. Exponent 0: bounded, ½: a random walk, 1: drift",
)
def forms(rows: pd.DataFrame) -> pd.DataFrame:
    drift, cost = rows[rows.part == "drift"], rows[rows.part == "cost"]
    if drift.empty:
        return drift
    drift = drift.assign(place=drift.groupby("key", sort=False).cumcount())
    table = []
    drift = drift.reindex(columns=[*drift, *{"fraction"}.difference(drift)])
    for (h, fraction, form), group in drift.groupby(["h", "fraction", "form"], sort=False, dropna=False):
        t = np.sort(group.groupby("place").t.median().to_numpy())
        row: dict[str, Any] = {"form": form, "h": h, "nutation periods": fraction, "steps": group.steps.max()}
        for name in INVARIANTS:
            errors = group.pivot(index="state", columns="place", values=name).to_numpy()
            row[f"largest error of {name}"] = largest(errors)
            row[f"exponent of {name}"] = metrics.growth_exponent(t, errors).p
        last = group[group.place == group.place.max()]
        row["phase error / t"] = float(np.sqrt(np.mean(np.square((last.time / last.t).to_numpy()))))
        chosen = cost[(cost.form == form) & (cost.h == h)]
        row["ns per step"] = float(chosen.ns_per_step.min()) if len(chosen) else np.nan
        table.append(row)
    return pd.DataFrame(table)


@of_part("drift")
def _draw_forms(rows: pd.DataFrame, style):
    from matplotlib import colormaps

    drift = rows[rows.h == SIZES[0]]
    drift = drift.assign(place=drift.groupby("key", sort=False).cumcount())
    drift["worst"] = worst(drift, INVARIANTS)
    shades = {False: colormaps["viridis"], True: colormaps["Oranges"]}
    fig, axes = style.figure("page", 2.9, ncols=2)
    panels = (("worst", "largest error of H, C1, C2"), ("time", "phase (time) error"))
    for ax, (what, text) in zip(axes, panels, strict=True):
        names = [form for form in FORMS if (drift.form == form).any()]
        for i, form in enumerate(names):
            run = drift[drift.form == form]
            rms = np.sqrt(mean_square(run[what], run.place))
            pinned = form.startswith("pinned")
            colour = shades[pinned](0.5 + 0.05 * i if pinned else 0.7 * i / len(names))
            look = {"color": colour, "linestyle": style.DASHES[i % len(style.DASHES)], "linewidth": 1.0}
            ax.loglog(run.groupby("place").t.median(), rms.where(rms > 0), **look, label=form)
        ax.set(xlabel=style.TIME, ylabel=text)
        if what != "time":
            style.ulp_line(ax)
    style.label_ends(axes)
    fig.caption = (
        "The exact Bäcklund step in different forms, root mean square over sixteen tops, h = 1/8: the worst relative error of "
        "its invariants, and the phase error, in units of 1/(|J| + √(|α||x|)). Increments: the change of x is added; turned: x "
        "is turned about a vector made exactly long. Compensated: what an addition rounds off goes into the next. Pinned "
        "(orange): moved back onto the invariants. The thin line is one ulp."
    )
    return fig


@of_part("long")
def _draw_long(rows: pd.DataFrame, style):
    fig, (left, right) = style.figure("page", 2.9, ncols=2)
    for name in style.ordered(rows.method):
        run = rows[rows.method == name].sort_values("t")
        most = worst(run, INVARIANTS)
        left.loglog(run.t, run.error, **style.of(name))
        right.loglog(run.t, most.where(most > 0), **style.of(name))
    for ax, text in ((left, "error against the exact solution"), (right, "worst error of H, C1, C2")):
        ax.set(xlabel=style.TIME, ylabel=text)
        style.ulp_line(ax)
    style.slope_guide(left, 1.0, (1e3, 1e-15), 100, "$t$")
    style.slope_guide(left, 1.5, (1e0, 1e-12), 100, "$t^{3/2}$")
    style.legend_below(fig)
    fig.caption = (
        "The exact Bäcklund map over the longest run, step 1/8, and heyoka on its natural steps for as long on the clock: "
        "error against the exact solution, relative to the scales of J and x, and the worst relative error of the "
        "invariants. Dotted: growth like t, and like t^(3/2), Brouwer's law. The thin line is one ulp; errors that are "
        "exactly zero are left out."
    )
    return fig


tables = tabulated(forms)
draw = drawn(forms=_draw_forms, long_run=_draw_long)
