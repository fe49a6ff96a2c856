"""Gaudin magnet: how long do a central spin and its bath keep their conservation laws, and at what price?

One spin in a field couples to n − 1 others with strengths that fall off, the central-spin model: the flow of H_1 (site 0 in
the code) of the magnet the top comes from. It is followed by two-point Bäcklund maps and by their rivals: heyoka, DOP853,
splittings into pairs of spins, midpoint rules. One map with the paper's time step is of order two; k maps at the roots of a Padé
approximant are of order 2k; half as many maps as spins, with parameters found by time doubling, are exact for any step.
Relative errors of the spins |s_j| and of all the H_j against time, of the whole state against the step, what a step
costs, and how long a run takes to an error. Times are in units of 1/√(Σ A_k²), A_k the couplings.

"random" is the test of the exact step: on random magnets, with steps of 1 to 80 units, its error after one step, judged
by heyoka, and the drift after many.
"""

import itertools
import math
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments import script
from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.reductions import largest
from lagrange_bench.experiments.measuring.states import follow, log_counts, rounded
from lagrange_bench.integrators.api import prepare
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet, central_spin, random_magnet, unit_of_time
from lagrange_bench.integrators.registry import METHODS

VERSION = 3
MEASURED = {
    "time": ("t", "spins", "hamiltonians"),
    "h": ("error",),
    "random": ("failed", "error", "drift"),
    "cost": ("h", "maps", "ns_per_step", "ns_per_time"),
    "work": ("knob", "error", "seconds", "setup_seconds"),
}

SIZES = (2, 3, 8, 32)
EXACT_SIZES = {"quick": (2, 3, 8), "full": SIZES}  # the exact step of 32 spins takes seconds to prepare
STEP = {"order 2": 0.25, "exact": 2.0, "taylor": 2.0}  # of the runs against time; for heyoka only between outputs
RIVALS = ("strang", "blanes_moan4", "implicit_midpoint", "spherical_midpoint")
SPAN_LONG = {"quick": 2.0**11, "full": 2.0**18}
SWEPT = 8  # size of the magnet of the runs against the step, and of the rivals
SPAN = 8.0  # and their length
SWEEP = {"quick": (0.125, 0.25, 0.5, 1.0, 2.0), "full": tuple(2.0 ** (-k / 2) for k in range(-4, 15))}
SWEEP_RIVALS = {"quick": (0.03125, 0.0625, 0.125), "full": tuple(2.0 ** (-k / 2) for k in range(2, 15))}
ORDERS = (2, 4, 6, 8)
ROUNDS = {"quick": 1, "full": 3}
RANDOM = {"quick": {2: 4, 3: 4, 8: 1}, "full": dict.fromkeys((2, 3, 4, 5, 8, 12), 200)}  # n → how many magnets
RANDOM_STEPS = (1, 5, 20, 80)
DRIFT_STEPS = {"quick": 2000, "full": 10**5}
SPANS = {"quick": (64.0,), "full": (64.0, 2.0**10, 2.0**14)}  # of the runs to an error
# the exact step: one jump; the others: steps, or tolerances
WORK = {
    "exact": (), "order 2": (-7, -5, -3), "order 8": (-3, -2, -1), "strang": (-7, -5, -3), "blanes_moan4": (-6, -4, -2),
    "implicit_midpoint": (-7, -5, -3), "spherical_midpoint": (-7, -5, -3),
}  # fmt: skip
WORK_TOLERANCES = {"taylor": (1e-16, 1e-12, 1e-8, 1e-5), "dop853": (1e-13, 1e-9, 1e-5)}
CALL = 4 * 10**6  # maps of spins in a call that is timed
LONGEST = 2.0**10  # span up to which DOP853, interpreted, is measured


def cells(profile: str) -> list[dict]:
    kinds = [(n, variant) for n in SIZES for variant in STEP if variant != "exact" or n in EXACT_SIZES[profile]]
    runs = [
        *((n, variant, STEP[variant]) for n, variant in kinds),
        *((SWEPT, rival, STEP["order 2"]) for rival in RIVALS),
    ]
    listed: list[dict] = [
        {"part": "time", "n": n, "variant": variant, "h": h, "steps": round(SPAN_LONG[profile] / h)}
        for n, variant, h in runs
    ]
    for variant in (*(f"order {p}" for p in ORDERS), "exact", *RIVALS):
        steps_tried = (SWEEP_RIVALS if variant in RIVALS else SWEEP)[profile]
        listed += [{"part": "h", "n": SWEPT, "variant": variant, "h": h} for h in steps_tried]
    for n, magnets in RANDOM[profile].items():
        given = {"magnets": magnets, "steps": DRIFT_STEPS[profile]}
        listed += [{"part": "random", "n": n, "variant": "exact", "h": h, **given} for h in RANDOM_STEPS]
    rounds = range(ROUNDS[profile])
    listed += [{"part": "cost", "n": n, "variant": v, "round": r, "timing": True} for r in rounds for n, v in kinds]
    listed += [
        {"part": "work", "n": SWEPT, "variant": variant, "span": span, "timing": True}
        for span in SPANS[profile]
        for variant in (*WORK, *WORK_TOLERANCES)
        if variant != "dop853" or span <= LONGEST
    ]
    # so it is known what has to be installed, and a cell can be chosen by the method's name
    return [{"method": _method(cell["variant"]), **cell} for cell in listed]


def _method(variant: str) -> str:
    names = {"exact": "backlund", "dop853": "scipy_dop853"}
    return "backlund_paper" if variant.startswith("order") else names.get(variant, variant)


def measure(cell: dict) -> list[dict]:
    parts = {"time": _time, "h": _h, "random": _random, "cost": _cost, "work": _work}
    return parts[cell["part"]](cell)


class OfSpins:
    """A stepper of the 3n numbers of a state, for spins (n, 3)."""

    def __init__(self, stepper: Any):
        self.stepper, self.work, self.from_start = stepper, stepper.work, stepper.from_start
        self.lams = getattr(stepper, "lams", ())  # of Bäcklund maps

    def advance(self, spins: Array, n: int) -> Array:
        return self.stepper.advance(spins.ravel(), n).reshape(-1, 3)

    def solve(self, spins: Array, times: Array) -> Array:
        """Spins at times (m,) that grow, in one run; of a library."""
        return self.stepper.run(spins.ravel(), times, self.work).reshape(len(times), -1, 3)


def _stepper(magnet: GaudinMagnet, spins: Array, variant: str, h: float, **options: Any) -> Any:
    if variant.startswith("order "):
        options["factors"] = int(variant.removeprefix("order ")) // 2
    return OfSpins(prepare(magnet, spins, h, _method(variant), **options))


def _drift(magnet: GaudinMagnet, spins: Array, state: Array) -> dict[str, float]:
    lengths = np.sqrt(magnet.casimirs(state) / magnet.casimirs(spins)) - 1
    energies = (magnet.hamiltonians(state) - magnet.hamiltonians(spins)) / magnet.hamiltonian_scales(spins)
    return {"spins": rounded(np.max(np.abs(lengths))), "hamiltonians": rounded(np.max(np.abs(energies)))}


def _time(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    counts = log_counts(cell["steps"], per_octave=4)
    stepper = _stepper(magnet, spins, cell["variant"], cell["h"])
    if stepper.from_start:
        states = stepper.solve(spins, cell["h"] * np.array(counts, dtype=float))
    else:
        states = [s for s, _ in follow(stepper, spins, counts)]
    return [
        {"t": rounded(cell["h"] * count), **_drift(magnet, spins, state)}
        for count, state in zip(counts, states, strict=True)
    ]


def _h(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    steps = round(SPAN / cell["h"])
    stepper = _stepper(magnet, spins, cell["variant"], SPAN / steps)
    error = np.max(np.abs(stepper.advance(spins, steps) - reference(cell["n"])))
    maps = {"maps": len(stepper.lams)} if len(stepper.lams) else {}
    return [{"error": rounded(error), **maps}]


@cache
def reference(n: int) -> Array:
    """The spins at SPAN by SciPy's DOP853 at its tightest, good to about 1e-13."""
    magnet, spins = central_spin(n)
    return _stepper(magnet, spins, "dop853", SPAN).advance(spins, 1)


def _random(cell: dict) -> list[dict]:
    """One step on each magnet against heyoka, and many steps; a magnet without a step counts as failed."""
    failed, errors, drifts = 0, [0.0], [0.0]
    for seed in range(cell["magnets"]):
        magnet, spins = random_magnet(cell["n"], seed)
        h = cell["h"] * unit_of_time(magnet, spins)
        first = np.argsort(np.arange(len(magnet)) != magnet.site, kind="stable")  # the system heyoka has compiled
        other = GaudinMagnet(tuple(np.array(magnet.sites)[first]), magnet.alpha, site=0)
        truth = _stepper(other, spins[first], "taylor", h).advance(spins[first], 1)
        try:
            stepper = _stepper(magnet, spins, "exact", h)
        except StepError:
            failed += 1
            continue
        errors.append(np.max(np.abs(stepper.advance(spins, 1)[first] - truth)))
        drifts += _drift(magnet, spins, stepper.advance(spins, cell["steps"])).values()
    return [{"failed": failed, "error": rounded(max(errors)), "drift": rounded(max(drifts))}]


def _cost(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    n, variant, span = cell["n"], cell["variant"], 200.0
    stepper = _stepper(magnet, spins, variant, span if variant == "taylor" else STEP[variant])
    if variant == "taylor":  # one call: many steps of its own
        stepper.advance(spins, 1)
        calls, steps, maps = 1, stepper.work.steps, 0
        h = span / steps
    else:
        h, maps = STEP[variant], len(stepper.lams)
        calls = steps = CALL // (n * maps)
    timed = timing.time_call(lambda: stepper.advance(spins, calls), repeats=5)
    ns = timed.min / steps * 1e9
    row = {"h": rounded(h), "maps": maps, "ns_per_step": rounded(ns), "ns_per_time": rounded(ns / h)}
    if maps:
        row["ns_per_spin_and_map"] = rounded(ns / (n * maps))
    if variant == "exact":
        row["setup_ms"] = rounded(1e3 * stepper.work.setup_seconds)
    return [{**row, "unstable": timed.unstable}]


def _work(cell: dict) -> list[dict]:
    """Error at the end of the span and seconds of the run, compilation excluded, for every step or tolerance.

    The exact step jumps there at once. heyoka judges all others, and is judged by the exact step.
    """
    magnet, spins = central_spin(cell["n"])
    variant, span = cell["variant"], cell["span"]
    truth = _stepper(magnet, spins, "exact" if variant == "taylor" else "taylor", span).advance(spins, 1)
    runs: list[tuple[float, int, dict]] = [(span, 1, {})]
    if variant in WORK_TOLERANCES:
        name = METHODS[_method(variant)].knob
        runs = [(span, 1, {name: tolerance}) for tolerance in WORK_TOLERANCES[variant]]
    elif WORK[variant]:
        runs = [(2.0**k, round(span / 2.0**k), {}) for k in WORK[variant]]
    rows = []
    for h, steps, options in runs:
        stepper = _stepper(magnet, spins, variant, h, **options)
        if variant not in WORK_TOLERANCES:
            stepper.advance(spins, 1)  # compiles
        start = perf_counter()
        error = np.max(np.abs(stepper.advance(spins, steps) - truth))
        seconds, unstable = perf_counter() - start, False
        if seconds < 0.1:
            timed = timing.time_call(lambda: stepper.advance(spins, steps), min_time=0.002, repeats=3)  # noqa: B023
            seconds, unstable = timed.min, timed.unstable
        setup = 0.0 if variant == "taylor" else stepper.work.setup_seconds  # of heyoka it is compilation
        knob = next(iter(options.values()), h)
        row = {"knob": knob, "error": rounded(error), "seconds": rounded(seconds), "setup_seconds": rounded(setup)}
        rows.append({**row, "unstable": unstable})
    return rows


DRIFT = "Gaudin magnets of n spins: the largest relative error of the lengths of the spins and of the Hamiltonians"


@by_group(("n", "variant"), "time", DRIFT)
def drift(n: int, variant: str, run: pd.DataFrame) -> dict:
    return {"length of run": run.t.max(), "spins": largest(run.spins), "hamiltonians": largest(run.hamiltonians)}


@of_part(
    "cost", "Gaudin magnets of n spins: nanoseconds per step, per spin and map, and per unit of time; set-up in ms"
)
def cost(rows: pd.DataFrame) -> pd.DataFrame:
    columns = ["h", "maps", "ns_per_step", "ns_per_spin_and_map", "ns_per_time", "setup_ms"]
    columns = [name for name in columns if name in rows]
    return rows.groupby(["n", "variant"], sort=False)[columns].min().reset_index()


@of_part(
    "random",
    "Random magnets at steps of h units: one exact step against heyoka, and the drift of the invariants over a run",
)
def random(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[["n", "h", "magnets", "failed", "error", "steps", "drift"]].reset_index(drop=True)


TARGETS = (1e-4, 1e-7, 1e-10)
RUN, WHOLE = "times as long as the exact step", "with set-up"


@of_part(
    "work",
    "Gaudin magnets: the quickest other method than Bäcklund maps, and its time over that of the exact step; then the same with "
    "set-up counted for both",
)
def work(rows: pd.DataFrame) -> pd.DataFrame:
    table = []
    rows = rows.assign(total=rows.seconds + rows.setup_seconds)
    for (span, group), target in itertools.product(rows.groupby("span"), TARGETS):
        reached = group[group.error <= target]
        ours = reached[reached.variant == "exact"]
        others = reached[~reached.method.isin(("backlund", "backlund_paper"))]
        if len(ours) and len(others):
            line = {"span": span, "error at most": target}
            for price, name, ratio in (("seconds", "quickest other", RUN), ("total", "quickest with set-up", WHOLE)):
                best = others.loc[others[price].idxmin()]
                line |= {name: best.variant, ratio: best[price] / ours[price].iloc[0]}
            table.append(line)
    return pd.DataFrame(table)


ORDER = "Order of each variant, as the slope of the error against the step, with its standard error (±)"


@by_group(("variant",), "h", ORDER)
def orders(variant: str, group: pd.DataFrame) -> dict:
    steps = SPAN / np.round(SPAN / group.h)  # a whole number of them was taken
    fit, maps = metrics.order(steps, group.error, floor=1e-13), group.maps.iloc[0] if "maps" in group else np.nan
    return {"maps": maps, "order": fit.p, "±": fit.stderr, "smallest error": float(group.error.min())}


UNIT = "Times are in units of 1/√(ΣA²), A the couplings."
LABELS = {f"order {p}": f"Bäcklund, order {p}" for p in ORDERS} | {"exact": "Bäcklund, exact"}
SHADES = {"order 4": ("#7D9BD1", "s", 1), "order 6": ("#3F93CF", "h", 3), "order 8": ("#0F5C80", "^", 0)}


def _look(style, variant: str) -> dict:
    like = {"spherical_midpoint": "collective_midpoint"}.get(variant, _method(variant))  # of the methods for tops
    look = {**style.of(like), "label": LABELS.get(variant) or METHODS[_method(variant)].label}
    if variant in SHADES:
        colour, marker, dash = SHADES[variant]
        look |= {"color": colour, "marker": marker, "linestyle": style.DASHES[dash]}
    return look


@of_part("time")
def _draw_time(rows: pd.DataFrame, style):
    quantities = {"hamiltonians": "$H_j$", "spins": "$|s_j|$"}
    panels = [(name, n) for name in quantities for n in sorted(set(rows.n))]
    columns = len(panels) // 2 if style.width() == "page" else 2
    size = {"nrows": len(panels) // columns, "ncols": columns, "sharex": True, "sharey": True, "squeeze": False}
    fig, grid = style.figure(style.width(), 0.4 + 1.75 * len(panels) / columns, **size)
    for ax, (name, n) in zip(grid.flat, panels, strict=True):
        for variant, chosen in rows[rows.n == n].groupby("variant", sort=False):
            t, error = metrics.block_maxima(chosen.t, chosen[name])
            ax.loglog(t, np.maximum(error, 2.0**-54), **{**_look(style, variant), "marker": "none"})
        ax.set_title(f"{quantities[name]}, n = {n}")
        style.ulp_line(ax)
    for ax in grid[-1]:
        ax.set_xlabel("time · √(ΣA²)")
    for ax in grid[:, 0]:
        ax.set_ylabel("largest relative error")
    style.legend_below(fig)
    fig.caption = (
        "Relative errors of all the Hamiltonians and of all the spin lengths of a central-spin magnet with n spins, "
        f"maxima over blocks of time. Steps of {STEP['order 2']:g} (order 2) and {STEP['exact']:g} (exact), heyoka "
        "with steps of its own choice. The grey line is one ulp; errors below a quarter of it are drawn there. "
        f"{UNIT}"
    )
    return fig


@of_part("h")
def _draw_h(rows: pd.DataFrame, style):
    fig, ax = style.figure("column", 3.0)
    for variant, chosen in rows.groupby("variant", sort=False):
        chosen = chosen.sort_values("h")
        ax.loglog(SPAN / np.round(SPAN / chosen.h), chosen.error.clip(lower=1e-16), **_look(style, variant))
    ticks = sorted({2.0 ** round(math.log2(h)) for h in rows.h})[:: 2 if len(set(rows.h)) > 6 else 1]
    ax.set_xticks(ticks, [f"{h:g}" if h >= 1 else f"1/{1 / h:g}" for h in ticks])
    ax.minorticks_off()
    ax.set(xlabel="step h · √(ΣA²)", ylabel=f"largest error at t = {SPAN:g}")
    style.legend_below(fig)
    fig.caption = (
        f"Largest error of a spin component at t = {SPAN:g} against the step, n = {SWEPT}: k maps to a step have order "
        "2k, fitted to the torus they have no error in time. The floor is round-off, that of the reference (DOP853) included. "
        f"{UNIT}"
    )
    return fig


@of_part("work")
def _draw_work(rows: pd.DataFrame, style):
    spans = sorted(set(rows.span))
    titles, labels = [f"t = {span:g}" for span in spans], ("time of one run, s", "largest error at the end")
    fig, axes = style.panels(titles, len(spans), (0.0, 3.4), *labels, sharey=True)
    for ax, span in zip(axes, spans, strict=True):
        here = rows[rows.span == span]
        for variant, chosen in here.groupby("variant", sort=False):
            chosen = chosen.sort_values("seconds")
            ax.loglog(chosen.seconds, chosen.error.clip(lower=1e-15), **_look(style, variant))
        for own in here[here.variant == "exact"].head(1).itertuples():
            ax.plot(own.seconds + own.setup_seconds, max(own.error, 1e-15), "o", mfc="none", color=style.INK)
    style.legend_below(fig)
    program = rows[rows.variant == "dop853"].span.max()
    fig.caption = (
        f"Error against time of a run, set-up and compilation excluded, n = {SWEPT}. The exact step takes one jump; the "
        "empty circle is the jump with its set-up, which is Python with many digits. DOP853 calls Python at every stage"
        f"{'' if not program < spans[-1] else f'; it runs up to t = {program:g} only'}. {UNIT}"
    )
    return fig


tables = tabulated(drift, orders, cost, random, work)
draw = drawn(time=_draw_time, h=_draw_h, work=_draw_work)

if __name__ == "__main__":
    script.run("gaudin")
