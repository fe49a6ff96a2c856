"""Perturbed tops and other problems: which method is best if there is no closed form?

A top in a uniform field has a closed form and needs no integrator. In most other fields (a tilted tide, a magnet, an uneven
field) it has none. The full profile has ten tops in such fields, the quick profile one, in a weak tide. Most are nearly
integrable: a weak field of size ε bends the tori a little. One is close to a separatrix. One is chaotic: an ulp grows to 1e-6 in
about 600 units.

The best method depends on ε, on the length of the run and on the error that is allowed. A splitting with the exact step inside
makes an error in proportion to ε. So it can take long steps in weak fields, but each costs more than a step of rotations. The
map of winners shows where the border is.

Part “drift” measures the drift of H, J3, C1 and C2 for each method that takes a potential. Part “order” measures how its error
falls with the step. Part “work” measures what an error costs: all compiled methods run over 10³ and 10⁴ units of time, and the
best of them also over 10⁵ on one top. Part “tolerance” gives the splitting with the exact step a tolerance in place of a step. It
compares the tolerance with the true error, on random tops in tides and near charges. Part “problem” follows problems other than a
top in a fixed field: a free body, a vibrating pivot, Kirchhoff's body, four spins.

Errors are measured against the reference in quadruple precision; on a chaotic orbit only until an ulp has grown to 1e-6. Times
and steps are in units of 1/(|J| + √(|alpha||x|)).
"""

import random
import warnings
from functools import partial

import numpy as np
import pandas as pd

from lagrange_bench.experiments import drift, work_precision
from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import numbers_in, show
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.reductions import largest
from lagrange_bench.integrators import METHODS, LagrangeTop, PerturbedTop, StepError, integrate, prepare
from lagrange_bench.integrators.interface import INVARIANTS, Method, StepWarning
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.potentials import CHARGE, PERTURBED_TOPS, TIDE
from lagrange_bench.integrators.truth import reference

VERSION = 2
SCALED_TIMES = True
MEASURED = {
    "problem": ("error", "kept"),
    "drift": ("t", *INVARIANTS),
    "order": ("error",),
    "work": work_precision.MEASURED[""],
    "tolerance": ("error",),
}

STEP = 0.125  # of the drift part
STEPS = {"quick": 10**4, "full": 10**6}
SPAN = 32.0  # of the order part
SIZES = {"quick": tuple(2.0**-k for k in range(0, 6, 2)), "full": tuple(2.0**-k for k in range(-1, 9))}
QUICK, QUICK_TOLERANCE = ("weak_tide",), ("random tides", 1e-8)  # each field and tolerance has kernels of its own
SLOW = ("gauss6", "gauss12")  # slow to compile: in the quick profile gauss4 and gauss8 stand for them
# span: longest run in s
WORK = {"quick": {1e3: 0.02}, "full": {1e3: 0.1, 1e4: 0.4, 1e5: 1.5}}
RACES = ("tide_1e-6", "weak_tide", "moderate_tide", "strong_tide", "fast_tide", "magnet")  # full profile
LONGEST = 1e5  # only on the tops LONG and for the best methods: the reference takes minutes
LONG = ("weak_tide",)
RIVALS = ("blanes_moan4", "blanes_moan6", "sofroniou_spaletta10", "force_gradient6", "verner9_projected", "taylor")
GRID = {"quick": (1, 3), "full": (2, 1)}  # steps in an octave, decades of tolerance between two runs
LOST = 1e-6  # a chaotic orbit is given up when an ulp has grown to this
OURS = "backlund_splitting"
# the options with which a method races
VARIANTS: dict[str, tuple[dict, ...]] = {
    OURS: ({"scheme": "strang"}, {"scheme": "strang", "modified_kick": False}, {"scheme": "processed6"})
}
# the part “tolerance”
FIELDS = {"random tides": TIDE, "random charges": CHARGE}
TOLERANCES = (1e-6, 1e-8)
LENGTHS = {"quick": (300.0,), "full": (300.0, 3000.0, 10000.0)}  # in time scales of each top
DRAWS = {"quick": 8, "full": 60}  # tops in each field, for each length and tolerance
SENSITIVE = 0.01  # an orbit is chaotic, and left out, if an ulp grows to this part of tol
ULP, NEAR = 2.0**-52, 2.0**-32  # a neighbour at the distance NEAR shows how an ulp grows
EPSILON = {"tide_1e-6": 1e-6, "weak_tide": 1e-4, "moderate_tide": 1e-2, "strong_tide": 1e-1}  # strengths of one tide


def cells(profile: str) -> list[dict]:
    listed: list[dict] = []
    full = profile == "full"
    per_octave, decades = GRID[profile]
    for state in PERTURBED_TOPS if full else QUICK:
        methods = {n: method for n, method in states.methods_on(state).items() if full or n not in SLOW}
        for name, method in methods.items():
            steps = states.affordable(method, STEPS[profile], full)
            listed.append({"part": "drift", "method": name, "state": state, "h": STEP, "steps": steps})
        for name, method in methods.items():
            if method.control == "step":
                listed += [{"part": "order", "method": name, "state": state, "h": h} for h in SIZES[profile]]
        for span, longest in WORK[profile].items() if state in RACES else ():
            sweep = {"span": span, "per_octave": per_octave, "decades": decades, "longest": longest}
            for name, method in methods.items():
                if not racing(method, state, span):
                    continue
                race = {"timing": True, "part": "work", "method": name, "state": state, **sweep}
                listed += [{**race, **way} for way in VARIANTS.get(name, ({},)) if full or len(way) < 2]
    for state in states.PROBLEMS if full else ():
        for name, method in states.methods_on(state).items():
            sizes = SIZES[profile] if method.control == "step" else (1.0,)
            listed += [{"part": "problem", "method": name, "state": state, "h": h} for h in sizes]
    tolerance = {"part": "tolerance", "method": OURS, "tops": DRAWS[profile]}
    return listed + [
        {**tolerance, "field": field, "span": span, "tol": tol}
        for field in FIELDS
        for span in LENGTHS[profile]
        for tol in TOLERANCES
        if full or (field, tol) == QUICK_TOLERANCE
    ]


def random_top(field: str, number: int) -> tuple[PerturbedTop, np.ndarray]:
    """A random top and its state. k is log-uniform from 1e-6 to 1e-2; a charge is 0.03, 0.1 or 0.3 outside the axis's sphere."""
    draw = random.Random(f"{field} {number}")

    def direction() -> np.ndarray:
        v = np.array([draw.gauss(0.0, 1.0) for _ in range(3)])
        return v / np.linalg.norm(v)

    alpha, k, speed = draw.choice((-1.0, 1.0)), 10.0 ** draw.uniform(-6.0, -2.0), draw.choice((0.3, 0.7, 1.0, 2.0))
    far = draw.choice((1.03, 1.1, 1.3)) if FIELDS[field] is CHARGE else 1.0
    place, J, x = far * direction(), speed * np.array([draw.gauss(0.0, 1.0) for _ in range(3)]), direction()
    return PerturbedTop(LagrangeTop(alpha), FIELDS[field], (k, *place.tolist())), np.concatenate((J, x))


def to_tolerance(cell: dict) -> list[dict]:
    """A row for each top: its error, or that the run was refused or is chaotic.

    Taylor's method serves as the truth: the reference would take an hour. It is right to 1e-12 if an ulp stays below 1e-10.
    """
    rows: list[dict] = []
    for number in range(cell["tops"]):
        top, y0 = random_top(cell["field"], number)
        time = cell["span"] * top.scales(y0)[2]
        right, near = (integrate(top, y, t=[time], method="taylor").y for y in (y0, y0 * (1.0 + NEAR)))
        if ULP / NEAR * metrics.scaled_error(top.top, y0, near, right).max() > SENSITIVE * cell["tol"]:
            rows.append({"answer": "chaotic", "reason": f"an ulp grows to {SENSITIVE:g} tol"})
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", StepWarning)  # V may be strong
                run = integrate(top, y0, t=[time], method=cell["method"], tol=cell["tol"])
        except StepError as refusal:
            rows.append({"answer": "refused", "reason": str(refusal)})
            continue
        error = float(metrics.scaled_error(top.top, y0, run.y, right)[0])
        rows.append({"answer": "given", "error": states.rounded(error)})
    return rows


def racing(method: Method, state: str, span: float) -> bool:
    """Whether a method takes part. Interpreted methods do not: they are a thousand times as slow."""
    return not states.interpreted(method) and (span < LONGEST or (state in LONG and method.name in (OURS, *RIVALS)))


def measure(cell: dict) -> list[dict]:
    if cell["part"] == "tolerance":
        return to_tolerance(cell)
    if cell["part"] == "problem":
        return [any_problem(cell)]
    top, y0 = states.of_cell(cell)
    unit = top.scales(y0)[2]
    if cell["part"] == "drift":
        counts = states.log_counts(cell["steps"], per_octave=2)
        return drift.against_steps(cell, top, y0, cell["h"] * unit, counts)
    span = cell.get("span", SPAN)
    # the top of the longest race is not chaotic. For problems that are no top the reference itself shows chaos
    follow = kinds.top(top) and span < LONGEST
    if follow and reference.horizon(top, y0, LOST, longest=span * unit) < span * unit:
        return [{"stopped": "chaotic", "reason": f"an ulp grows to {LOST:g} before t = {span:g}"}]
    if cell["part"] == "work":
        return work_precision.measure(cell)
    method, n = METHODS[cell["method"]], round(SPAN / cell["h"])
    h = SPAN * unit / n
    y = prepare(top, y0, h, method).advance(y0, n)
    error = metrics.scaled_error(top, y0, y, states.truth(top, y0, method, h, [n])[0])
    return [{"error": states.rounded(float(error))}]


def any_problem(cell: dict) -> dict:
    """The error at the end, and the largest errors of the invariants that the method claims and of the others."""
    problem, y0 = states.of_cell(cell)
    method, n = METHODS[cell["method"]], round(SPAN / cell["h"])
    h = SPAN * problem.scales(y0)[2] / n
    _, y, moved = drift.followed(cell, problem, y0, h, states.places(n))
    keeps = method.conserves_on(problem)
    sizes = {name: float(np.max(np.abs(error))) for name, error in moved.items()}
    kept, others = ([size for name, size in sizes.items() if (name in keeps) is said] for said in (True, False))
    error = metrics.scaled_error(problem, y0, y[-1], states.truth(problem, y0, method, h, [n])[0])
    row = {"error": states.rounded(float(error)), "kept": states.rounded(np.max(kept, initial=0.0))}
    return row | ({"others": states.rounded(np.max(others))} if others else {})


KEPT = "Tops in a potential: the largest relative error of each invariant that the top has"


@by_group(("state", "method"), "drift", KEPT)
def kept(state: str, method: str, run: pd.DataFrame) -> dict:
    """A line for each top and method."""
    top = states.of_cell({**run.iloc[0], "state": state})[0]
    errors = {name: largest(run[name]) if name in top.conserved else np.nan for name in INVARIANTS}
    says = METHODS[method].conserves_on(top) if method in METHODS else ()
    return {"steps": int(run.steps.max()), **errors, "claimed": ", ".join(name for name in INVARIANTS if name in says)}


@of_part(
    "problem",
    "Problems that are no top in a fixed field: orders claimed and measured, and the largest relative error of the invariants "
    "that a method says it keeps, and of the others, over all steps",
)
def problems(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each problem and method."""
    table = _orders(rows, (1e-10, 0.1))
    moved = rows.groupby(["state", "method"], sort=False)[["kept", "others"]].agg(largest)
    names = {"kept": "invariants it claims", "others": "its other invariants"}
    return table.join(moved.rename(columns=names), on=["state", "method"])


@of_part(
    "order",
    f"Tops in a potential: orders claimed, and measured as the slope of the error at t = {SPAN:g} against the step. At these "
    "steps some slopes are still below the order. Empty where fewer than three steps tell",
)
def orders(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each top and method."""
    return _orders(rows, (1e-12, 1e-3))


def _orders(good: pd.DataFrame, between: tuple[float, float]) -> pd.DataFrame:
    """The order of each method on each problem. between : round-off and saturation; the errors used lie between these."""
    table = []
    if "stopped" in good:
        good = good[good.stopped.isna()]
    for (state, method), run in good.groupby(["state", "method"], sort=False):
        # near the separatrix round-off is a hundred times larger
        floor = max(100 * run.error.min(skipna=False), between[0])
        run = run[(run.error > floor) & (run.error < between[1])].sort_values("h")[:4]
        slope = float(np.polyfit(np.log(run.h), np.log(run.error), 1)[0]) if len(run) > 2 else np.nan
        says = METHODS[method].order if method in METHODS else None
        table.append({"state": state, "method": method, "claimed": says, "measured": slope, "points": len(run)})
    return pd.DataFrame(table)


@of_part("work", "Tops in a potential: the cheapest method, set-up counted, and the best of the others")
def winners(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each top, length of run and target error."""
    targets = work_precision.TARGETS[:-1]
    return work_precision.against_ours(work_precision.useful(rows), work_precision.APART, targets, OURS)


@by_group(
    ("field", "span", "tol"),
    "tolerance",
    "The splitting with the exact step, given an error tol in place of a step, on random tops: how many runs it answers and "
    f"refuses, and the largest error. Chaotic: an ulp grows to {SENSITIVE:g} tol; these are left out",
)
def tolerances(field: str, span: float, tol: float, group: pd.DataFrame) -> dict:
    """A line for each field, length of run and tolerance."""
    answered = group.reindex(columns=["answer", "error"])[group.answer == "given"]
    refused = int((group.answer == "refused").sum())
    return {
        "answered": len(answered),
        "refused": refused,
        "share refused": refused / max(refused + len(answered), 1),
        "chaotic": int((group.answer == "chaotic").sum()),
        "largest error / tol": float(np.max(answered.error.to_numpy() / tol, initial=0.0)),
    }


@of_part("work")
def _draw_work(rows: pd.DataFrame, style, span: float):
    good = work_precision.useful(rows[rows.span == span])
    if good.empty:
        return None

    def named(here: pd.DataFrame) -> list[str]:
        best = work_precision.best(here, 1e-8, "total").method
        return [OURS, *best[best != OURS][:2]]

    titles = {state: numbers_in(states.label(state)) for state in dict.fromkeys(good.state)}
    size, shared = (2, 2.6), {"sharex": True, "sharey": True}
    fig = work_precision.draw_panels(good, titles, "state", size, style, named, **shared)
    fig.caption = (
        f"Error at t = {show(span)} against wall time, set-up included, for tops in a potential; down and left is better. "
        f"{style.naming(good.method, 'named: the exact step inside, the two others quickest to 1e-8, and the most accurate')}. "
        "Each curve joins a method's Pareto-optimal runs, one for each step size or tolerance."
    )
    return fig


@of_part("work")
def _draw_winner(rows: pd.DataFrame, style):
    """Draw a map over (ε, error) of the best other method's time, in units of the time of the exact step inside."""
    from matplotlib import colors

    table = winners(rows[rows.state.isin(EPSILON)])
    if table is None or table.empty:
        return None
    spans, tops = sorted(set(table.span)), [state for state in EPSILON if state in set(table.state)]
    targets = sorted(set(table["error at most"]), reverse=True)
    titles, labels = [f"t = {show(span)}" for span in spans], ("size of the tide, ε", "error at most")
    fig, axes = style.panels(titles, len(spans), (0.0, 2.6), *labels)
    for ax, span in zip(axes, spans, strict=True):
        here = table[table.span == span]
        wide = here.pivot(index="error at most", columns="state", values="times as long as the exact step inside")
        ratios = wide.reindex(index=targets, columns=tops).to_numpy(dtype=float)
        norm = colors.LogNorm(vmin=0.1, vmax=10.0)
        ax.pcolormesh(np.ma.masked_invalid(ratios), cmap="RdBu", norm=norm, edgecolors="white", linewidth=1.0)
        for (i, j), ratio in np.ndenumerate(ratios):
            unknown = "–" if tops[j] in set(here.state) else ""
            word = f"{ratio:.2g}" if np.isfinite(ratio) else unknown
            dark = np.isfinite(ratio) and not 0.3 < ratio < 3.3
            ax.text(j + 0.5, i + 0.5, word, ha="center", va="center", fontsize=7, color="white" if dark else "black")
        ax.set_xticks(np.arange(len(tops)) + 0.5, [show(EPSILON[state]) for state in tops])
        ax.set_yticks(np.arange(len(targets)) + 0.5, [show(target) for target in targets])
        ax.grid(visible=False)
    fig.caption = (
        "Who wins on the generic top in a tide of size ε: the wall time of the best other method, set-up included, in units "
        "of that of the splitting with the exact step. Above 1, blue: the exact step inside is quicker. Below, red: another "
        "method is. A dash: one of the two does not get there. Empty: not run over this time."
    )
    return fig


@of_part("order")
def _draw_order(rows: pd.DataFrame, style):
    if "error" not in rows or rows.error.isna().all():
        return None
    state = next((name for name in (*QUICK, *PERTURBED_TOPS) if (rows.state == name).any()), rows.state.iloc[0])
    here = rows[rows.state == state]
    label = states.label(state)
    fig, _ = style.by_family(here, "h", "error", style.STEP, f"error at t = {SPAN:g}\n{label}", (1e-16, 10))
    fig.caption = (
        f"Error against the step on “{label}”, one panel for each family of methods. The slopes are the "
        "orders; their numbers for all tops are in the table. A cross before a name: the method has no result."
    )
    return fig


work = {f"work_t{span:.0f}": partial(_draw_work, span=span) for span in WORK["full"]}
tables = tabulated(kept, orders, winners, tolerances, problems)
draw = drawn(**work, winner=_draw_winner, order=_draw_order)
