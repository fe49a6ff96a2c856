"""Drift: which invariants does a method keep, and what is left after 10⁹ steps?

Every method follows sixteen random tops, and the Bäcklund step the named ones, too. The relative error of each invariant is
recorded at log-spaced times. Its root mean square over the sixteen tops grows like t^p. The verdict is bounded (p near 0), a
random walk of round-off (p near 1/2, Brouwer's law) or biased (p near 1). A quantity that a method itself claims to conserve,
such as a modified energy, is followed, too.

The part `h` varies h at a fixed length of run. The part `long` takes exact Bäcklund steps of about half a nutation period and
more, on tops of every kind. The part `phase` says how far the phase of the exact step is off. The part `longest` takes a
thousand million exact steps, and gives heyoka the same wall time. Times and steps are in units of 1/(|J| + √(|alpha||x|)).
"""

from collections.abc import Iterator
from time import perf_counter

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.experiments.measuring.reductions import largest, mean_square, worst
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.interface import INVARIANTS, Array
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop
from lagrange_bench.integrators.truth import exact

OWN = "kept: "  # before the name of a quantity that a method itself conserves: its column
ON_NAMED_TOPS = ("backlund", "backlund_unpinned")  # methods that take the named tops, too
BESIDE_PHASE = ("H", "C1", "C2")  # invariants whose errors are measured beside the phase


VERSION = 3
SCALED_TIMES = True
PHASE_ERRORS = ("t", *BESIDE_PHASE, "time", "angle", "error")
MEASURED = {  # part → the numbers that each of its rows must have, see `reductions`
    "time": ("t", *INVARIANTS),
    "h": INVARIANTS,
    "long": ("fraction", *INVARIANTS),
    "phase": PHASE_ERRORS,
    "longest": PHASE_ERRORS,
}

STEP = 0.125  # of the runs against time
STEPS = (10**5, 10**7)  # how many steps, in the quick and in the full profile
SIZES = {"quick": (1 / 8, 1 / 2, 1.0), "full": tuple(2.0**k for k in range(-6, 3))}  # steps tried against h
SPAN = 10**4  # length of the runs against h
H_STATES = {"quick": ("generic",), "full": ("generic", "figure1")}
FRACTIONS = (0.51, 1.0, 1.3)  # long steps, in nutation periods
LONG_TOPS = {"quick": 16, "full": len(states.WIDE)}  # how many tops take long steps
LONG_STEPS = {"quick": 10**4, "full": 10**6}  # how many long steps each takes
LONGEST = {"quick": 10**6, "full": 10**9}  # steps of the longest run


def cells(profile: str) -> list[dict]:
    methods, full = states.methods_on(), profile == "full"
    all_cells = []
    # state by state, so that two workers do not compile the same method at the same time
    for state in (*states.RANDOM, *TOPS):
        for name in ON_NAMED_TOPS if state in TOPS else methods:
            steps = states.affordable(methods[name], STEPS[full], full)
            all_cells.append({"part": "time", "method": name, "state": state, "h": STEP, "steps": steps})
    for state in H_STATES[profile]:
        for name in (name for name, method in methods.items() if method.control == "step"):
            for h in SIZES[profile]:
                all_cells.append({"part": "h", "method": name, "state": state, "span": SPAN, "h": h})
    # pins hide what long steps do
    for state in states.WIDE[: LONG_TOPS[profile]]:
        all_cells.append({"part": "long", "method": "backlund_unpinned", "state": state, "steps": LONG_STEPS[profile]})
    for state in states.RANDOM:
        all_cells.append({"part": "phase", "method": "backlund", "state": state, "h": STEP, "steps": STEPS[full]})
    longest = {"part": "longest", "timing": True, "state": "generic", "h": STEP, "steps": LONGEST[profile]}
    return [*all_cells, longest]


def measure(cell: dict) -> list[dict]:
    part = cell["part"]
    top, y0 = states.of_cell(cell)
    if part == "long":
        period, counts = exact.nutation_period(top, y0), states.log_counts(cell["steps"], per_octave=1)
        return [{"fraction": f, **_largest(cell, top, y0, f * period, counts)} for f in FRACTIONS]
    h = cell["h"] * top.scales(y0)[2]
    if part == "longest":
        return _longest(top, y0, h, states.log_counts(cell["steps"], per_octave=1))
    steps = round(cell["span"] / cell["h"]) if part == "h" else cell["steps"]
    counts = states.log_counts(steps, per_octave=4)
    if part == "phase":
        times, y = states.sample(top, y0, cell["method"], h, counts)
        return _errors(top, y0, times, y, exact.after_steps(top, y0, h, counts))
    return [_largest(cell, top, y0, h, counts)] if part == "h" else against_steps(cell, top, y0, h, counts)


def against_steps(cell: dict, top, y0: Array, h: float, counts: list[int]) -> list[dict]:
    """Rows of errors, one after each of `counts` steps."""
    return states.as_rows(_followed(cell, top, y0, h, counts))


def _largest(cell: dict, top, y0: Array, h: float, counts: list[int]) -> dict[str, float]:
    """The largest value of each error over `counts` steps."""
    columns = _followed(cell, top, y0, h, counts)
    return {name: states.rounded(largest(values)) for name, values in columns.items() if name != "t"}


def _followed(cell: dict, top, y0: Array, h: float, counts: list[int]) -> dict[str, Array]:
    """Times `t`, and relative errors of the problem's invariants and of the method's own conserved quantities."""
    times, after = states.sample(top, y0, cell["method"], h, counts, **states.options_of(cell))
    y = np.vstack((y0, after))
    columns = {"t": times * top.scales(y0)[0], **_of_invariants(top, times, y)}
    # these hold in a uniform field
    own_quantities = METHODS[cell["method"]].claims.conserves_own if kinds.uniform(top) else {}
    for name, quantity in own_quantities.items():
        values, size = quantity(top, h, y)
        columns[OWN + name] = (values[1:] - values[0]) / size
    return columns


def _of_invariants(top, times: Array, y: Array) -> dict[str, Array]:
    """The relative error of each invariant at `times` (N,). y : the states from the start on, (N + 1, n)."""
    values = top.invariants(y, np.concatenate(((0.0,), times)))
    drift = metrics.relative_drift(values, top.invariant_scales(y[0]))
    return dict(zip(top.names, drift[1:].T, strict=True))


def _errors(top, y0: Array, times: Array, after: Array, truth: Array) -> list[dict]:
    """Rows of the relative errors of the invariants, the phase errors (time, angle) and the whole error, in scaled units."""
    rate = top.scales(y0)[0]
    split = metrics.phase_split(top, truth, after - truth)
    drift = _of_invariants(top, times, np.vstack((y0, after)))
    columns = {"t": times * rate, **{name: drift[name] for name in BESIDE_PHASE}}
    columns |= {"time": split["time"] * rate, "angle": split["angle"]}
    columns["error"] = metrics.scaled_error(top, y0, after, truth)
    return states.as_rows(columns)


def _longest(top, y0: Array, h: float, counts: list[int]) -> list[dict]:
    """Run the exact Bäcklund map over all steps, then heyoka, for the same wall time and at most as far.

    heyoka shortens its own steps only to end at the times 16 h, 32 h, 64 h and so on.
    """
    from lagrange_bench.integrators.methods import taylor

    prepare(top, y0, h, "backlund").advance(y0, 1000)  # compiled before it is timed
    start = perf_counter()
    times, y = states.sample(top, y0, "backlund", h, counts)
    allowed = perf_counter() - start
    ours = _errors(top, y0, times, y, exact.after_steps(top, y0, h, counts))
    rows = [{"method": "backlund", **row} for row in ours]
    try:
        heyoka = taylor.integrator_of_thread(taylor.EPS, False)
    except ImportError:
        return rows
    heyoka.time, heyoka.state[:], heyoka.pars[0] = 0.0, y0, top.alpha
    ends, reached, clock, t = [], [], 0.0, 16 * h
    start = perf_counter()
    while clock < allowed and t <= times[-1]:
        heyoka.propagate_until(t)
        reached.append(heyoka.state.copy())
        ends.append(t)
        clock = perf_counter() - start
        t *= 2
    theirs = _errors(top, y0, np.array(ends), np.array(reached), exact.solution(top, y0, ends))
    return rows + [{"method": "taylor", **row} for row in theirs]


# ---------------------------------------------------------------- tables and figures


KNOWN = ("rk4", "strang")  # methods that everybody knows are named in figures
FLOOR = 16 * 2.0**-52  # sixteen ulps: an error that stays below is round-off, whatever its slope


def indexed(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the position of each sample in its run, which is the same for all states of a method."""
    return rows.assign(t_index=rows.groupby("key", sort=False).cumcount())


def _times(runs: pd.DataFrame) -> np.ndarray:
    """The times at which runs on several tops were sampled: the median over the tops."""
    return np.sort(runs.groupby("t_index").t.median().to_numpy())


def _growth(runs: pd.DataFrame, columns: list[str]) -> Iterator[tuple[str, float, metrics.Growth]]:
    """Each column with its largest error and the growth of its root mean square over the tops of these runs."""
    t = _times(runs)
    for name in columns:
        errors = runs.pivot(index="state", columns="t_index", values=name).to_numpy(dtype=float)
        yield name, largest(errors), metrics.growth_exponent(t, errors)


@of_part(
    "time",
    "How each invariant's error grows: sixteen random tops. Other quantities (e.g. a modified energy) are those a method itself "
    "claims to conserve",
)
def verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each method and quantity."""
    rows = indexed(rows[rows.state.isin(states.RANDOM)])
    own_columns = [name for name in rows.columns if name.startswith(OWN)]
    table = []
    for method, group in rows.groupby("method", sort=False):
        record = METHODS.get(method)
        has = {OWN + quantity for quantity in record.claims.conserves_own} if record else set()
        columns = [*INVARIANTS, *(column for column in own_columns if column in has or group[column].notna().any())]
        for name, most, growth in _growth(group, columns):
            # of a method that is not loaded nobody knows what it claims
            claimed = np.nan if record is None else name.startswith(OWN) or name in LagrangeTop().conserved_by(record)
            table.append(
                {
                    "method": method,
                    "invariant": name.removeprefix(OWN),
                    "claimed": claimed,
                    "largest relative error": most,
                    "length of run": float(_times(group)[-1]),
                    "exponent": growth.p,
                    "verdict": metrics.verdict(*growth, most, floor=FLOOR),
                }
            )
    return pd.DataFrame(table)


@by_group(
    ("method", "h"),
    "phase",
    "The phase after so many steps: root mean square of its error over the tops, in units of the time",
)
def phases(method: str, h: float, group: pd.DataFrame) -> dict:
    last = group.groupby("state").tail(1)
    error = float(np.sqrt(np.mean(np.square((last.time / last.t).to_numpy()))))
    return {"steps": group.steps.max(), "phase error / t": error}


@of_part("time", failed=True)
def _draw_time(rows: pd.DataFrame, style):
    random = rows[rows.state.isin(states.RANDOM)]
    rows = indexed(rows if random.empty else random)
    done = rows[rows.status == "done"]
    samples = [done.method, done.t_index]
    squares = mean_square(done.H, samples)  # over the tops
    lines = pd.DataFrame({"t": done.groupby(samples).t.median(), "error": np.sqrt(squares.where(squares > 0))})
    lines = lines.reset_index().assign(status="done")
    lines = pd.concat([lines, rows[~rows.method.isin(done.method)][["method", "status"]]])
    label = f"RMS error of H, {rows.state.nunique()} tops"
    fig, ax = style.figure("page", 3.8)
    last = done[done.t_index == done.groupby("method").t_index.transform("max")]
    style.draw_methods(
        ax, lines, "t", "error", [*KNOWN, *style.best_of_families(last.H.abs().groupby(last.method).max())]
    )
    style.ulp_line(ax)
    style.slope_guide(ax, 0.5, (1e3, 1e-8), 1e3, "√t")
    style.slope_guide(ax, 1.0, (1e3, 1e-8), 1e3, "t")
    ax.set(xlabel=style.TIME, ylabel=label, ylim=(1e-17, 1.0))
    style.legend_below(fig)
    fig.caption = (
        f"Relative error of the energy H against time, root mean square over {rows.state.nunique()} tops, step 1/8 or the "
        f"default tolerance. {style.naming(rows.method, 'named: RK4, Strang, and of the families the best at the end')}. "
        "The thin line is one ulp; dotted: growth like √t and t. A cross before a name: the method declined the step or failed. "
        "The other invariants are in the table."
    )
    return fig


@of_part("h", failed=True)
def _draw_h(rows: pd.DataFrame, style):
    """Draw all methods thin and the best of each family bold."""
    state = rows.state.iloc[0]
    of_state = rows[rows.state == state].assign(worst=worst(rows, INVARIANTS))
    fig, ax = style.figure("page", 3.6)
    near = of_state[(of_state.status == "done") & (of_state.h == 1 / 8)].set_index("method")
    style.draw_methods(ax, of_state, "h", "worst", [*KNOWN, *style.best_of_families(near.worst)])
    style.legend_below(fig)
    style.ulp_line(ax)
    ax.set(xlabel=style.STEP, ylabel="largest error of H, J3, C1, C2", ylim=(1e-17, 1e2))
    fig.caption = (
        f"The worst of the four invariants over t = {of_state.span.max():g} on “{states.label(state)}”, against the step. "
        f"{style.naming(of_state.method, 'named: RK4, Strang, and of the families the best at a step of 1/8')}. Crosses, in its "
        "colour: a method declined the step or failed. Errors above 100 are cut off."
    )
    return fig


@of_part("longest")
def _draw_longest(rows: pd.DataFrame, style):
    fig, (left, right) = style.figure("page", 2.9, ncols=2)
    for name in style.ordered(rows.method):
        run = rows[rows.method == name].sort_values("t")
        most = worst(run, BESIDE_PHASE)
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


tables = tabulated(verdicts, phases)
draw = drawn(time=_draw_time, h=_draw_h, longest=_draw_longest)
