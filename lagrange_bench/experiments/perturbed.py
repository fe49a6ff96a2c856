"""Tops in other fields: which method is best if there is no closed form?

A top in a uniform field has a closed form and needs no integrator. In most other fields it has none. The fields are a tilted
tide, a magnet, an uneven field. The full profile has ten tops in such fields, the quick profile one, in a weak tide. Most are
nearly integrable: a weak field of size ε bends the tori a little. One is close to a separatrix. One is chaotic: an ulp grows to
1e-6 in about 600 units. The best method depends on ε, on the length of the run and on the error that is allowed. A splitting with
the exact step inside makes an error in proportion to ε. So it can take long steps in weak fields, but each costs more than a step
of rotations. The table of winners shows where the border is.

Part “drift” measures the drift of H, J3, C1 and C2 for each method that takes a potential. Part “work” measures what an error
costs: all compiled methods run over 10³ and 10⁴ units of time. Part “tolerance”
gives the splitting with the exact step a tolerance in place of a step. It compares the tolerance with the true error, on random
tops in tides and near charges.

Errors are measured against the reference in quadruple precision. Wall time is the least of several runs, with set-up. Times and
steps are in units of 1/(|J| + √(|alpha||x|)).
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
from lagrange_bench.experiments.work_precision import APART, TARGETS, champions, draw_panels, races, useful
from lagrange_bench.integrators import METHODS, LagrangeTop, PerturbedTop, StepError, integrate
from lagrange_bench.integrators.interface import INVARIANTS, StepWarning
from lagrange_bench.integrators.problem.potentials import CHARGE, PERTURBED_TOPS, TIDE

VERSION = 3
SCALED_TIMES = True
MEASURED = {
    "drift": ("t", *INVARIANTS),
    "work": work_precision.MEASURED[""],
    "tolerance": ("error",),
}

OURS = "backlund_splitting"  # the splitting with the exact step inside
# of the quick profile: each field has kernels of its own, which take seconds to compile
QUICK = "weak_tide"
# part “drift”
DRIFT_STEP = 0.125
DRIFT_STEPS = {"quick": 10**4, "full": 10**6}
SLOW = ("gauss6",)  # slow to compile: in the quick profile gauss4 and gauss8 stand for it
# part “work”
RACES = ("tide_1e-6", "weak_tide", "moderate_tide", "strong_tide", "fast_tide", "magnet")  # full profile
LONGEST_RUNS = {"quick": {1e3: 0.02}, "full": {1e3: 0.1, 1e4: 0.4}}  # span: s
GRID = {"quick": (1, 3), "full": (2, 1)}  # steps in an octave, decades of tolerance between two runs
# the options with which a method races
VARIANTS: dict[str, tuple[dict, ...]] = {
    OURS: ({"scheme": "strang"}, {"scheme": "strang", "modified_kick": False}, {"scheme": "processed6"}),
    "taylor": ({}, {"high_accuracy": True}),
}
# part “tolerance”
FIELDS = {"random tides": TIDE, "random charges": CHARGE}
ASKED = (1e-6, 1e-8)  # tolerances
QUICK_TOLERANCE = ("random tides", 1e-8)
LENGTHS = {"quick": (300.0,), "full": (300.0, 3000.0, 10000.0)}  # in time scales of each top
DRAWS = {"quick": 8, "full": 60}  # tops in each field, for each length and tolerance
SENSITIVE = 0.01  # an orbit is chaotic, and left out, if an ulp grows to this part of tol
ULP, NEAR = 2.0**-52, 2.0**-32  # a neighbour at the distance NEAR shows how an ulp grows


def cells(profile: str) -> list[dict]:
    all_cells: list[dict] = []
    full = profile == "full"
    per_octave, decades = GRID[profile]
    for state in (name for name in PERTURBED_TOPS if full or name == QUICK):
        methods = {n: method for n, method in states.methods_on(states.find(state)[0]).items() if full or n not in SLOW}
        for name, method in methods.items():
            steps = states.affordable(method, DRIFT_STEPS[profile], full)
            all_cells.append({"part": "drift", "method": name, "state": state, "h": DRIFT_STEP, "steps": steps})
        for span, longest in LONGEST_RUNS[profile].items() if state in RACES else ():
            sweep = {"span": span, "per_octave": per_octave, "decades": decades, "longest": longest}
            for name, method in methods.items():
                if states.interpreted(method):  # a thousand times as slow
                    continue
                race = {"timing": True, "part": "work", "method": name, "state": state, **sweep}
                all_cells += [{**race, **options} for options in VARIANTS.get(name, ({},)) if full or len(options) < 2]
    tolerance = {"part": "tolerance", "method": OURS, "tops": DRAWS[profile]}
    all_cells += [
        {**tolerance, "field": field, "span": span, "tol": tol}
        for field in FIELDS
        for span in LENGTHS[profile]
        for tol in ASKED
        if full or (field, tol) == QUICK_TOLERANCE
    ]
    return all_cells


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


def measure(cell: dict) -> list[dict]:
    if cell["part"] == "tolerance":
        return to_tolerance(cell)
    top, y0 = states.of_cell(cell)
    unit = top.scales(y0)[2]
    if cell["part"] == "drift":
        counts = states.log_counts(cell["steps"], per_octave=2)
        return drift.against_steps(cell, top, y0, cell["h"] * unit, counts)
    return work_precision.measure(cell)


# ---------------------------------------------------------------- tables and figures


@by_group(
    ("state", "method"), "drift", "Tops in a potential: the largest relative error of each invariant that the top has"
)
def kept(state: str, method: str, run: pd.DataFrame) -> dict:
    """A line for each top and method."""
    top = states.of_cell({**run.iloc[0], "state": state})[0]
    errors = {name: largest(run[name]) if name in top.conserved else np.nan for name in INVARIANTS}
    says = top.conserved_by(METHODS[method]) if method in METHODS else ()
    return {"steps": int(run.steps.max()), **errors, "claimed": ", ".join(name for name in INVARIANTS if name in says)}


@of_part(
    "work",
    "The cheapest method, set-up counted, and the best of the others beside the splitting with the exact step",
)
def winners(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each top, length of run and target error."""
    table = []
    for fields, race in races(useful(rows), APART, TARGETS, "total"):
        ours, others = race[race.method == OURS].total, race[race.method != OURS]
        line = {**fields, "cheapest": race.method.iloc[0], "seconds": race.total.iloc[0]}
        line["best of the others"] = others.method.iloc[0] if len(others) else ""
        ratio = others.total.min() / ours.min() if len(ours) and len(others) else np.nan
        table.append({**line, "times as long as the exact step inside": ratio})
    return pd.DataFrame(table)


@by_group(
    ("field", "span", "tol"),
    "tolerance",
    "The splitting with the exact step, given an error tol in place of a step, on random tops: how many runs it answers and "
    "refuses, and the largest error. Chaotic runs are left out",
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
    """Draw error against time of the runs of one length, with a panel for each top."""
    good = useful(rows[rows.span == span])
    if good.empty:
        return None
    titles = {state: numbers_in(states.label(state)) for state in dict.fromkeys(good.state)}
    labels = "wall time of the run with set-up, s", "error at the end"
    fig = draw_panels(good, "state", titles, "total", labels, champions(good), style)
    fig.caption = (
        f"Error at the end against wall time, set-up included, for tops in a potential, t = {show(span)}; down and left is "
        f"better. {style.naming(good.method, 'named: of each family the cheapest at most errors')}. "
        "Each curve joins a method's Pareto-optimal runs, one for each step size or tolerance."
    )
    return fig


tables = tabulated(kept, winners, tolerances)


def draw(rows: pd.DataFrame) -> dict:
    """A figure for each length of run of the part “work”."""
    spans = sorted(set(rows["span"].dropna())) if "span" in rows else ()
    return drawn(**{f"work_t{span:.0f}": partial(_draw_work, span=span) for span in spans})(rows)
