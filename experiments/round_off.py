"""Round-off: the same map written in different ways, and what each of them lets drift.

In exact arithmetic all forms of a method here are one map; what differs is rounding. Sixteen random tops take ten
million steps with each: how do the errors of H, C1 and C2 grow (exponent ½: a random walk, 1: a bias), how far is the
phase off, and what does a step cost? Steps of half a nutation period and more are tried too. A second part takes a
thousand million steps of the exact Bäcklund map beside heyoka, which gets the same wall time. Steps and times are in
units of 1/(|J| + √(|alpha||x|)).
"""

import math
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments import script
from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import numbers_in
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.reductions import largest, mean_square, worst
from lagrange_bench.experiments.measuring.states import RANDOM, as_rows, find, follow, log_counts, rounded
from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.loops import MEMORY, NEVER, FixedStepper
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus.real_map import ALPHA, ALPHA_2, ETA, ETA2, MI_ETA, MR, P3, R
from lagrange_bench.integrators.truth import exact

VERSION = 3

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


@compiled
def direction(p, q, mr, mi, factor):
    """factor (Re m p + Im m q − p×q)."""
    return (
        factor * ((mr * p[0] + mi * q[0]) - (p[1] * q[2] - p[2] * q[1])),
        factor * ((mr * p[1] + mi * q[1]) - (p[2] * q[0] - p[0] * q[2])),
        factor * ((mr * p[2] + mi * q[2]) - (p[0] * q[1] - p[1] * q[0])),
    )


@compiled
def curve(s, c):
    """p and q of a(λ) = p + iq."""
    J1, J2, J3, x1, x2, x3 = s
    p = (x1 + c[R] * J1, x2 + c[R] * J2, x3 + c[P3])
    return p, (c[ETA] * J1, c[ETA] * J2, c[ETA] * (J3 + c[ALPHA_2] * c[R]))


@compiled
def squares(p, q):
    return ((p[0] * p[0] + p[1] * p[1]) + p[2] * p[2]) + ((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2])


@compiled
def axis(s, c):
    """w, with m as it was at the start."""
    p, q = curve(s, c)
    mr, mi = c[MR], c[MI_ETA] / c[ETA]
    return direction(p, q, mr, mi, 2.0 * c[ETA] / ((mr * mr + mi * mi) + squares(p, q)))


@compiled
def incremented(s, w, c):
    J1, J2, J3, x1, x2, x3 = s
    d1, d2 = -c[ALPHA_2] * w[1], c[ALPHA_2] * w[0]
    s1, s2, s3 = J1 + (J1 + d1), J2 + (J2 + d2), J3 + J3
    y1 = x1 + (c[R] * d1 + (s2 * w[2] - s3 * w[1]))
    y2 = x2 + (c[R] * d2 + (s3 * w[0] - s1 * w[2]))
    return J1 + d1, J2 + d2, J3, y1, y2, x3 + (s1 * w[1] - s2 * w[0])


@compiled
def corrected_m(s, c, tally):
    """m is brought up to date in every step, m ← (m + a·a/m)/2; it is kept in the tally, m = 0 says not yet."""
    p, q = curve(s, c)
    mr, mi = tally[MEMORY], tally[MEMORY + 1]
    if mr == 0.0 and mi == 0.0:
        mr, mi = c[MR], c[MI_ETA] / c[ETA]
    re = ((p[0] * p[0] + p[1] * p[1]) + p[2] * p[2]) - ((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2])
    im = 2.0 * ((p[0] * q[0] + p[1] * q[1]) + p[2] * q[2])
    r = 1.0 / (mr * mr + mi * mi)
    mr, mi = 0.5 * (mr + (re * mr + im * mi) * r), 0.5 * (mi + (im * mr - re * mi) * r)
    tally[MEMORY], tally[MEMORY + 1] = mr, mi
    w = direction(p, q, mr, mi, 2.0 * c[ETA] / ((mr * mr + mi * mi) + squares(p, q)))
    return incremented(s, w, c)


@compiled
def constant_denominator(s, c, tally):
    """|m|² + |p|² + |q|² from what it is on the torus, a constant less 4 alpha η² x3: the last constant is that one."""
    p, q = curve(s, c)
    n = c[-1] - 4.0 * c[ALPHA] * c[ETA2] * s[5]
    return incremented(s, direction(p, q, c[MR], c[MI_ETA] / c[ETA], 2.0 * c[ETA] / n), c)


@compiled
def assigned(s, c, tally):
    """x̃ = ((R² − η²) x + 2 (w·x) w + 2R w×x)/|λ|²: the rotation as a matrix, x assigned and not incremented."""
    J1, J2, J3, x1, x2, x3 = s
    w1, w2, w3 = axis(s, c)
    r = 1.0 / (c[R] * c[R] + c[ETA2])
    a, b, d = (c[R] * c[R] - c[ETA2]) * r, 2.0 * ((w1 * x1 + w2 * x2) + w3 * x3) * r, 2.0 * c[R] * r
    y1 = a * x1 + (b * w1 + d * (w2 * x3 - w3 * x2))
    y2 = a * x2 + (b * w2 + d * (w3 * x1 - w1 * x3))
    y3 = a * x3 + (b * w3 + d * (w1 * x2 - w2 * x1))
    return J1 - c[ALPHA_2] * w2, J2 + c[ALPHA_2] * w1, J3, y1, y2, y3


class FormStepper(real_map.TorusStepper):
    """Takes any state: a form that leaves its torus is what is measured here."""

    def enter(self, y: Array) -> Array:
        return self.units.enter(y)


def exact_map(kernel: Callable[..., Any], pin: int = 0) -> Callable[..., FixedStepper]:
    """Builder of a stepper with exact λ(h), this kernel, and a pin every so many steps."""

    def build(top, y0, h):
        units = Units(top, y0, h)
        state = units.enter(y0)
        c, turn = real_map.exact_constants(units.alpha, state, units.time(h))
        p, q = curve.py_func(tuple(state), c)
        n = c[MR] ** 2 + (c[MI_ETA] / c[ETA]) ** 2 + squares.py_func(p, q) + 4 * c[ALPHA] * c[ETA2] * state[5]
        back, block = (real_map.pin, pin) if pin else (None, NEVER)
        return FormStepper("form", h, units, np.append(c, n), kernel, back, block, turn=turn)

    return build


def program(top, y0, h):
    """The paper's program with the exact λ(h)."""
    units = Units(top, y0, h)
    c, _ = real_map.exact_constants(units.alpha, units.enter(y0), units.time(h))
    shift = units.length - units.rate
    return prepare(top, y0, h, "backlund_textbook", lam=complex(math.ldexp(c[R], shift), math.ldexp(c[ETA], shift)))


# ---------------------------------------------------------------- good and bad forms of two rivals


@compiled
def midpoint_equation(s, c, tally, tolerance, doubled):
    """The midpoint rule by plain iteration to a tolerance, 0 for stagnation; x̃ = 2x̄ − x or x̃ = x + h J̄×x̄."""
    J1, J2, J3, x1, x2, x3 = s
    alpha, h = c[0], c[1]
    y1, y2, y3 = x1, x2, x3
    last = math.inf
    for _ in range(200):
        K1 = J1 - 0.5 * h * alpha * y2
        K2 = J2 + 0.5 * h * alpha * y1
        z1 = x1 + 0.5 * h * (K2 * y3 - J3 * y2)
        z2 = x2 + 0.5 * h * (J3 * y1 - K1 * y3)
        z3 = x3 + 0.5 * h * (K1 * y2 - K2 * y1)
        change = abs(z1 - y1) + abs(z2 - y2) + abs(z3 - y3)
        y1, y2, y3 = z1, z2, z3
        if change <= tolerance or (change >= last and change < 1e-14):
            break
        last = change
    K1, K2 = J1 - 0.5 * h * alpha * y2, J2 + 0.5 * h * alpha * y1
    L1, L2 = J1 - h * alpha * y2, J2 + h * alpha * y1
    if doubled:
        return L1, L2, J3, 2.0 * y1 - x1, 2.0 * y2 - x2, 2.0 * y3 - x3
    return L1, L2, J3, x1 + h * (K2 * y3 - J3 * y2), x2 + h * (J3 * y1 - K1 * y3), x3 + h * (K1 * y2 - K2 * y1)


@compiled
def midpoint_to_a_tolerance(s, c, tally):
    return midpoint_equation(s, c, tally, 1e-12, False)


@compiled
def midpoint_doubled(s, c, tally):
    return midpoint_equation(s, c, tally, 0.0, True)


@compiled
def strang_as_a_matrix(s, c, tally):
    """Kick, rotation x ← cos θ x + sin θ n×x + (1 − cos θ)(n·x) n, kick: as textbooks write it."""
    J1, J2, J3, x1, x2, x3 = s
    half, h = 0.5 * c[1] * c[0], c[1]
    J1, J2 = J1 - half * x2, J2 + half * x1
    size = math.sqrt((J1 * J1 + J2 * J2) + J3 * J3)
    n1, n2, n3 = J1 / size, J2 / size, J3 / size
    a, b = math.cos(h * size), math.sin(h * size)
    d = (1.0 - a) * ((n1 * x1 + n2 * x2) + n3 * x3)
    x1, x2, x3 = (
        a * x1 + (b * (n2 * x3 - n3 * x2) + d * n1),
        a * x2 + (b * (n3 * x1 - n1 * x3) + d * n2),
        a * x3 + (b * (n1 * x2 - n2 * x1) + d * n3),
    )
    return J1 - half * x2, J2 + half * x1, J3, x1, x2, x3


def kernel_of(kernel: Callable[..., Any]) -> Callable[..., FixedStepper]:
    return lambda top, y0, h: FixedStepper("form", h, np.array((top.alpha, h)), kernel)


def method(name: str, **options: Any) -> Callable[..., Any]:
    return lambda top, y0, h: prepare(top, y0, h, name, **options)


# name in tables → (method it is a form of, builder)
FORMS: dict[str, tuple[str, Callable[..., Any]]] = {
    "paper's program": ("backlund", program),
    "x assigned": ("backlund", exact_map(assigned)),
    "constant denominator": ("backlund", exact_map(constant_denominator)),
    "corrected m": ("backlund", exact_map(corrected_m)),
    "increments": ("backlund", exact_map(real_map.step)),
    "x turned": ("backlund", exact_map(real_map.turning_step)),
    "compensated": ("backlund", exact_map(real_map.compensated_step)),
    "pinned, every 1024": ("backlund", exact_map(real_map.step, 1024)),
    "pinned, every 64": ("backlund", exact_map(real_map.step, 64)),
    "pinned, every 8": ("backlund", exact_map(real_map.step, 8)),
    "pinned, every step": ("backlund", exact_map(real_map.step, 1)),
    "midpoint, tolerance 1e-12": ("implicit_midpoint", kernel_of(midpoint_to_a_tolerance)),
    "midpoint, 2x̄ − x": ("implicit_midpoint", kernel_of(midpoint_doubled)),
    "midpoint, as registered": ("implicit_midpoint", method("implicit_midpoint")),
    "Strang, matrix of sines": ("strang", kernel_of(strang_as_a_matrix)),
    "Strang, as registered": ("strang", method("strang")),
    "Strang, compensated": ("strang", method("strang", compensated=True)),
}


def cells(profile: str) -> list[dict]:
    sizes = SIZES[: len(STEPS[profile])]
    listed: list[dict] = [
        {"part": "drift", "form": form, "state": state, "h": h, "steps": steps}
        for h, steps in zip(sizes, STEPS[profile], strict=True)
        for form in FORMS
        if h == SIZES[0] or FORMS[form][0] == "backlund"
        for state in RANDOM
    ]
    listed += [
        {"part": "drift", "form": form, "state": state, "fraction": fraction, "steps": FRACTION_STEPS[profile]}
        for fraction in FRACTIONS
        for form, (of, _) in FORMS.items()
        if of == "backlund" and form != "paper's program"  # which has no turn about e3
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
    """Relative errors of the invariants; time and angle phase, and the whole error, in scaled units."""
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
    stepper = FORMS[cell["form"]][1](top, y0, h)
    return _follow(top, y0, stepper, h, log_counts(cell["steps"], per_octave=4))


def _cost(cell: dict) -> list[dict]:
    """All forms in turn in one process."""
    top, y0 = find(LONG_STATE)
    h, n = cell["h"] * top.scales(y0)[2], 20_000
    forms = {name: build for name, (of, build) in FORMS.items() if cell["h"] == SIZES[0] or of == "backlund"}
    runs = {name: partial(build(top, y0, h).advance, y0, n) for name, build in forms.items()}
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
    """The exact Bäcklund map over all steps; then heyoka, on its natural steps, for as long a time on the clock."""
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
    """heyoka carried on from time to time; a last step shortened at each doubling of the time changes nothing of note."""
    from lagrange_bench.integrators.methods.taylor import EPS, integrator_here

    ta = integrator_here(EPS, False)
    ta.time, ta.state[:], ta.pars[0] = 0.0, y0, top.alpha

    def until(t: float) -> Any:
        ta.propagate_until(t)
        return ta.state.copy()

    return until


@of_part(
    "",
    "Ways to write a step: largest relative error of each invariant, exponent of its growth with its interval (low, high), phase "
    "error, nanoseconds a step. Exponent 0: bounded, ½: a random walk, 1: drift",
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
            growth = metrics.growth_exponent(t, errors)
            row[f"largest error of {name}"] = largest(errors)
            row[f"exponent of {name}"] = growth.p
            row[f"{name} low"], row[f"{name} high"] = growth.low, growth.high
        last = group[group.place == group.place.max()]
        row["phase error / t"] = float(np.sqrt(np.mean(np.square((last.time / last.t).to_numpy()))))
        found = cost[(cost.form == form) & (cost.h == h)]
        row["ns per step"] = float(found.ns_per_step.min()) if len(found) else np.nan
        table.append(row)
    return pd.DataFrame(table)


@of_part(
    "long",
    "The longest runs, which take the same wall time: where they end, and the errors there, relative to the scales of J and x "
    "and of each invariant",
)
def long_run(rows: pd.DataFrame) -> pd.DataFrame:
    last = rows.groupby("method", sort=False).tail(1)
    return last[["method", "t", "error", "time", "angle", *INVARIANTS]].reset_index(drop=True)


@of_part("drift")
def _draw_forms(rows: pd.DataFrame, style):
    from matplotlib import colormaps

    drift = rows[rows.h == SIZES[0]]
    drift = drift.assign(place=drift.groupby("key", sort=False).cumcount())
    drift["worst"], drift["casimirs"] = worst(drift, INVARIANTS), worst(drift, ("C1", "C2"))
    panels = (  # of which method, what, its name, title
        ("backlund", "worst", "largest error of H, C1, C2", "Bäcklund, exact λ(h)"),
        ("backlund", "time", "phase (time) error", "Bäcklund, exact λ(h): phase"),
        ("implicit_midpoint", "worst", "largest error of H, C1, C2", "Implicit midpoint"),
        ("strang", "casimirs", "largest error of C1, C2", "Strang splitting"),
    )
    shades = {False: colormaps["viridis"], True: colormaps["Oranges"]}
    fig, axes = style.figure("page", 4.9, nrows=2, ncols=2, sharex=True)
    for ax, (of, what, text, title) in zip(axes.flat, panels, strict=True):
        if what != "time" and ax is not axes[0, 0]:
            ax.sharey(axes[0, 0])
        names = [form for form in FORMS if FORMS[form][0] == of and (drift.form == form).any()]
        for i, form in enumerate(names):
            run = drift[drift.form == form]
            rms = np.sqrt(mean_square(run[what], run.place))
            pinned = form.startswith("pinned")
            colour = shades[pinned](0.5 + 0.05 * i if pinned else 0.7 * i / len(names))
            look = {"color": colour, "linestyle": style.DASHES[i % len(style.DASHES)], "linewidth": 1.0}
            ax.loglog(run.groupby("place").t.median(), rms.where(rms > 0), **look, label=numbers_in(form))
        ax.set(title=title, ylabel=text)
        if what != "time":
            style.ulp_line(ax)
    for ax in axes[-1]:
        ax.set_xlabel(style.TIME)
    style.label_ends(axes.flat)
    fig.caption = (
        "The same maps in different forms, root mean square over sixteen tops, h = 1/8: the worst relative error of the "
        "invariants a map conserves, and the phase error of the exact one, in units of 1/(|J| + √(|α||x|)). Assigned: the new x "
        "is computed as a whole; increments: its change is added; turned: x is turned about a vector made exactly long. "
        "Constant denominator and corrected m take a part of the formula from the torus, or bring it up to date. "
        "Compensated: what an addition rounds off goes into the next. Pinned (orange): moved back onto the invariants. "
        "The thin line is one ulp."
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


tables = tabulated(forms, long_run)
draw = drawn(forms=_draw_forms, long_run=_draw_long)

if __name__ == "__main__":
    script.run("round_off")
