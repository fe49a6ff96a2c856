"""Drift: do H, J3, C1 and C2 stay constant, and whatever else a method claims to conserve?

Every method follows sixteen random tops and the named ones. The relative error of each invariant is recorded at log-spaced
times. Its root mean square over the sixteen tops grows like t^p. The verdict is bounded (p near 0), a random walk of round-off
(p near 1/2, Brouwer's law) or biased (p near 1). A quantity that a method itself claims to conserve, such as a modified energy,
is followed, too.

A second part varies h at a fixed length of run. A third part takes exact Bäcklund steps of about half a nutation period and
more, on tops of every kind. Times and steps are in units of 1/(|J| + √(|alpha||x|)).
"""

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.reductions import largest, mean_square, worst
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop
from lagrange_bench.integrators.truth import exact

VERSION = 2
SCALED_TIMES = True
MEASURED = {  # part → the numbers that each of its rows must have, see `reductions`
    "time": ("t", *INVARIANTS),
    "h": INVARIANTS,
    "long": ("fraction", *INVARIANTS),
}

KEPT = "kept: "  # before the name of a quantity that a method itself conserves: its column
STEP = 0.125  # of the runs against time
STEPS = (10**5, 10**7)  # how many steps, in the quick and in the full profile
NAMED = ("generic", "figure1", "through_pole", "near_separatrix")  # named tops of the quick profile
SIZES = {"quick": (1 / 4, 1 / 2, 1.0), "full": tuple(2.0**k for k in range(-6, 3))}  # steps tried against h
SPAN = 10**4  # length of the runs against h
H_STATES = {"quick": ("generic",), "full": ("generic", "figure1")}
FRACTIONS = (0.51, 1.0, 1.3)  # long steps, in nutation periods
LONG = {
    "quick": (16, 10**4),
    "full": (len(states.WIDE), 10**6),
}  # how many tops take long steps, and how many steps each takes
FLOOR = 16 * 2.0**-52  # sixteen ulps: an error that stays below is round-off, whatever its slope


def cells(profile: str) -> list[dict]:
    methods, full = states.methods_on(), profile == "full"
    listed = []
    # state by state, so that two workers do not compile the same method at the same time
    for state in (*states.RANDOM, *(TOPS if full else NAMED)):
        for name, method in methods.items():
            steps = states.affordable(method, STEPS[full], full)
            if (
                state in TOPS and method.order is not None
            ):  # only methods exact in time take all steps on each named top
                steps //= 10
            listed.append({"part": "time", "method": name, "state": state, "h": STEP, "steps": steps})
    for state in H_STATES[profile]:
        for name in (name for name, method in methods.items() if method.control == "step"):
            for h in SIZES[profile]:
                listed.append({"part": "h", "method": name, "state": state, "span": SPAN, "h": h})
    tops, steps = LONG[profile]
    exact_steps = [name for name, method in methods.items() if method.family == "backlund" and method.order is None]
    for state in states.WIDE[:tops]:
        listed += [{"part": "long", "method": name, "state": state, "steps": steps} for name in exact_steps]
    return listed


def measure(cell: dict) -> list[dict]:
    top, y0 = states.of_cell(cell)
    if cell["part"] == "long":
        period, counts = exact.nutation_period(top, y0), states.log_counts(cell["steps"], per_octave=1)
        return [{"fraction": f, **_largest(cell, top, y0, f * period, counts)} for f in FRACTIONS]
    h = cell["h"] * top.scales(y0)[2]
    steps = cell["steps"] if cell["part"] == "time" else round(cell["span"] / cell["h"])
    counts = states.log_counts(steps, per_octave=4)
    if cell["part"] == "h":
        return [_largest(cell, top, y0, h, counts)]
    return against_steps(cell, top, y0, h, counts)


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
    values = top.invariants(y, np.concatenate(((0.0,), times)))
    drift = metrics.relative_drift(values, top.invariant_scales(y[0]))
    columns = dict(zip(top.names, drift[1:].T, strict=True))
    own_quantities = (
        METHODS[cell["method"]].claims.conserves_own if kinds.uniform(top) else {}
    )  # these hold in a uniform field
    for own, quantity in own_quantities.items():
        values, size = quantity(top, h, y)
        columns[KEPT + own] = (values[1:] - values[0]) / size
    return times, after, columns


@of_part(
    "time",
    "How each invariant's error grows: sixteen random tops. Other quantities (e.g. a modified energy) are those a method itself "
    "claims to conserve",
)
def verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method and quantity."""
    from lagrange_bench.integrators import METHODS

    rows = indexed(rows[rows.state.isin(states.RANDOM)])
    own = [name for name in rows.columns if name.startswith(KEPT)]
    table = []
    for method, group in rows.groupby("method", sort=False):
        record = METHODS.get(method)
        t = np.sort(group.groupby("t_index").t.median().to_numpy())
        has = {KEPT + quantity for quantity in record.claims.conserves_own} if record else set()
        for name in (*INVARIANTS, *(column for column in own if column in has or group[column].notna().any())):
            errors = group.pivot(index="state", columns="t_index", values=name).to_numpy(dtype=float)
            growth = metrics.growth_exponent(t, errors)
            most = largest(errors)
            quantity = name.removeprefix(KEPT)
            claimed = record is not None and (name.startswith(KEPT) or name in record.conserves_on(LagrangeTop()))
            table.append(
                {
                    "method": method,
                    "invariant": quantity,
                    "claimed": claimed,
                    "largest relative error": most,
                    "length of run": float(t[-1]),
                    "exponent": growth.p,
                    "low": growth.low,
                    "high": growth.high,
                    "verdict": metrics.verdict(*growth, most, floor=FLOOR),
                }
            )
    return pd.DataFrame(table)


def indexed(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the position of each sample in its run, which is the same for all states of a method."""
    return rows.assign(t_index=rows.groupby("key", sort=False).cumcount())


@of_part("time", "Largest relative error of H, J3, C1 and C2 on the named tops, and the top where it is")
def named_tops(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method."""
    named = rows[rows.state.isin(TOPS)].reset_index(drop=True)
    named = named.assign(error=worst(named, INVARIANTS).fillna(np.inf))
    table = named.loc[named.groupby("method", sort=False).error.idxmax(), ["method", "steps", "error", "state"]]
    return table.rename(columns={"error": "largest error", "state": "worst top"})


@of_part("long", "Largest relative error of each invariant where steps are long: tops of every kind")
def long_steps(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method and each length of step."""
    grouped = rows.groupby(["method", "fraction"], sort=False)
    table = grouped[list(INVARIANTS)].agg(largest)
    table.insert(0, "tops", grouped.state.nunique())
    table.insert(1, "steps", grouped.steps.max())
    return table.reset_index().rename(columns={"fraction": "step / nutation period"})


@of_part("time", failed=True)
def _draw_time(rows: pd.DataFrame, style):
    random = rows[rows.state.isin(states.RANDOM)]
    rows = indexed(rows if random.empty else random)
    done = rows[rows.status == "done"]
    runs = [done.method, done.t_index]
    squares = mean_square(done.H, runs)
    lines = pd.DataFrame({"t": done.groupby(runs).t.median(), "error": np.sqrt(squares.where(squares > 0))})
    lines = lines.reset_index().assign(status="done")
    lines = pd.concat([lines, rows[~rows.method.isin(done.method)][["method", "status"]]])
    label = f"RMS error of {rows.state.nunique()} tops"
    fig, axes = style.by_family(lines, "t", "error", style.TIME, label, (1e-17, 1.0), marker="none")
    for ax in axes:
        style.ulp_line(ax)
    style.slope_guide(axes[0], 0.5, (1e0, 1e-9), 1e4, "√t")  # once: the panels have one scale
    style.slope_guide(axes[0], 1.0, (1e0, 1e-9), 1e4, "t")
    fig.caption = (
        f"Relative error of the energy H against time, root mean square over {rows.state.nunique()} tops, step 1/8 or the "
        "default tolerance, one panel for each family of methods; pale blue: the exact Bäcklund step. The thin line is one ulp; "
        "dotted, in the first panel: growth like √t and t. A cross before a name: the method declined the step or failed. "
        "The other invariants are in the table."
    )
    return fig


@of_part("h", failed=True)
def _draw_h(rows: pd.DataFrame, style):
    state = rows.state.iloc[0]
    here = rows[rows.state == state].assign(worst=worst(rows, INVARIANTS))
    ylabel = "largest error of H, J3, C1, C2"
    fig, _ = style.by_family(here, "h", "worst", style.STEP, ylabel, (1e-17, 1e2))
    fig.caption = (
        f"The worst of the four invariants over t = {here.span.max():g} on “{states.label(state)}”, against the step; pale blue: "
        "the exact Bäcklund step. Crosses, in its colour: a method declined the step or failed. Errors above 100 are cut off."
    )
    return fig


tables = tabulated(verdicts, named_tops, long_steps)
draw = drawn(time=_draw_time, h=_draw_h)
