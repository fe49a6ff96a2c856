"""What the project says of itself: the claims of `claims.toml`, and the functions that read their numbers from stored rows."""

import tomllib
from collections.abc import Sequence
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.tables import flat, show
from lagrange_bench.experiments.measuring.states import CLOSE, RANDOM, RELEASED, SPINNING, WIDE, methods_on
from lagrange_bench.experiments.work_precision import APART, TARGETS, best, useful
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.registry import BUILT_IN, METHODS, available
from lagrange_bench.report.claims import Bound, Claim, Measure, NoData, Reading, Refuted, ShortAnswer, select, values
from lagrange_bench.report.sections import tables_of
from lagrange_bench.results.store import Store, find_results

EXACT = ("backlund", "closed-form")  # families that are exact in time
SETS = {  # of tops, as `where` names them
    "@named": tuple(TOPS),
    "@perturbed": tuple(PERTURBED_TOPS),
    "@random": RANDOM,
    "@random200": tuple(f"random{i:03d}" for i in range(200)),
    "@close": CLOSE,
    "@wide": WIDE,
    "@released": RELEASED,
    "@spinning": SPINNING,
}


def table(rows: pd.DataFrame, experiment: str, name: str) -> pd.DataFrame:
    """The named table an experiment makes of its rows. NoData: it makes none of that name."""
    tables = tables_of(experiment, rows)
    if name not in tables or tables[name].empty:
        raise NoData(f"no table {name!r}")
    return flat(tables[name])


@cache
def published() -> frozenset[str]:
    """The built-in methods that have published rows. A new one has none: nothing is claimed of it yet."""
    cells = (record["cell"] for record in Store(find_results("reference")).open("cost").latest)
    return frozenset(BUILT_IN).intersection(cell.get("method") for cell in cells)


def all_methods(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, if every published method that can run here is among them. Others are judged where they have rows."""
    expected = [name for name in methods_on() if name in published() and available(METHODS[name])]
    if missing := sorted(set(expected) - set(rows.method)):
        raise NoData(f"not measured: {', '.join(missing)}")
    return rows


def orders_as_claimed(rows: pd.DataFrame) -> Reading:
    """Distances of measured orders from those claimed, over methods of finite order with a fixed step."""
    orders = table(rows, "phase", "orders")
    finite, hidden = orders[~orders.hidden], sorted(set(orders[orders.hidden].method))
    away = (finite.measured - finite.claimed.astype(float)).abs()  # NaN, which refutes, where no order was measured
    note = f"orders of {len(finite)} methods with a fixed step; worst: {finite.method[_worst(away)]}"
    if hidden:
        note += f"; steeper, the leading term being too small to show above round-off: {', '.join(hidden)}"
    return Reading(away, note)


def taken_by_theory(rows: pd.DataFrame) -> Reading:
    """The share of a measured error that theory takes away, of each run whose error says something."""
    from lagrange_bench.integrators.backward_error.prediction import PREDICTED

    expected = {name for name, m in methods_on().items() if m.control == "step" and m.order is not None}
    expected &= published() & PREDICTED
    if missing := sorted(expected - set(rows[rows.part == "theory"].method)):
        raise NoData(f"not held against theory: {', '.join(missing)}")
    theory = table(rows, "phase", "theory")
    theory = theory[theory.method.isin(expected)]
    judged = theory[theory["in range"].eq(True)]
    if unseen := sorted(expected - set(judged.method)):
        raise Refuted(f"no prediction, or no error in range, of {', '.join(unseen)}")
    worst = judged.loc[_worst(judged["share left"])]
    note = f"{len(judged)} runs of {len(expected)} methods with a fixed step; "
    note += f"worst: {worst.method}, {worst.state}, h_scaled = {show(worst.h)}"
    if without := int(theory["in range"].isna().sum()):
        note += f"; no prediction for {without} more, where the series does not converge"
    return Reading(1.0 - judged["share left"], note)


def kept_as_claimed(rows: pd.DataFrame) -> Reading:
    """Growth exponents of what methods claim to conserve."""
    verdicts = all_methods(table(rows, "drift", "verdicts"))
    claimed = verdicts[verdicts.claimed.eq(True)]
    if (claimed.verdict == "failed").any():
        bad = claimed[claimed.verdict == "failed"].iloc[0]
        raise Refuted(f"{bad.method}: {bad.invariant} is not finite")
    walking = claimed[~claimed.verdict.isin(("exact", "round-off"))]  # of an error of a few ulps the slope says nothing
    if walking.empty:
        raise NoData("no claimed invariant moves by more than sixteen ulps")
    worst = walking.loc[_worst(walking.exponent)]
    note = f"{len(claimed)} invariants claimed by {claimed.method.nunique()} methods; worst: {worst.invariant} of {worst.method}"
    return Reading(walking.exponent, note)


def kept_in_a_field(rows: pd.DataFrame) -> Reading:
    """Errors of what methods claim to conserve on tops in a potential, over √steps ulps."""
    drifts = table(rows, "perturbed", "kept")
    shares = {
        f"{name} of {run.method} on {run.state}": float(getattr(run, name)) / np.sqrt(run.steps) / np.finfo(float).eps
        for run in drifts.itertuples()
        for name in filter(None, run.claimed.split(", "))
    }
    worst = _worst(pd.Series(shares))
    note = f"{drifts.method.nunique()} methods on {drifts.state.nunique()} tops; worst: {worst}"
    return Reading(list(shares.values()), note)


def _worst(numbers: pd.Series) -> Any:
    """The label of the largest of some numbers, or of one that could not be measured."""
    return numbers.fillna(np.inf).idxmax()


def lead(
    rows: pd.DataFrame, errors: Sequence[tuple[float, float, float]], closed: bool = False, every: float = np.inf
) -> Reading:
    """The time of the best method that is not exact in time, over the time of the best Bäcklund map; set-up is counted.

    errors : (length of the runs, largest, smallest error) asked for. closed : the closed forms instead, which are exact in
    time. every : the longest step that counts. The ratio is 0 where no Bäcklund map gets there, ∞ where no other method does.
    """
    ratios = {}
    runs = useful(all_methods(rows))
    if "h" in runs:
        runs = runs[~(runs.h > every)]  # of a tolerance every run counts
    expected = {"backlund", *(name for name in published() if closed and METHODS[name].family == "closed-form")}
    groups = runs.groupby(APART, sort=False)
    for ((span, state), group), target in product(groups, TARGETS):
        if any(span == length and least <= target <= most for length, most, least in errors):
            if missing := sorted(expected - set(group.method)):
                raise NoData(f"a run with method = {missing[0]} over t = {show(span)} on {state} is missing")
            race = best(group, target, "total")
            rivals = race.family == "closed-form" if closed else ~race.family.isin(EXACT)
            ours, others = race[race.family == "backlund"].total, race[rivals].total
            ratio = others.min() / ours.min() if len(ours) and len(others) else np.inf if len(ours) else 0.0
            ratios[f"error {show(target)} at t = {show(span)} on {state}, reached by {len(others)} more"] = ratio
    if not ratios:
        raise NoData("no runs of these lengths")
    return Reading(list(ratios.values()), f"closest: {min(ratios, key=lambda run: abs(np.log(ratios[run] or 1e-9)))}")


def per_state(rows: pd.DataFrame) -> Reading:
    """The time that heyoka takes from one output state to the next, over the time of the exact step."""
    ratio, steps, ours, theirs = values(rows, "ratio", "steps", "backlund_s", "heyoka_s", part="headline").T
    ours, theirs = (span(numbers / steps) for numbers in (1e9 * ours, 1e6 * theirs))
    return Reading(ratio, f"a state takes {ours} ns, with heyoka {theirs} µs")


def span(numbers: np.ndarray) -> str:
    """The least and the largest number, or the one."""
    least, most = (show(float(number)) for number in (numbers.min(), numbers.max()))
    return least if least == most else f"{least}–{most}"


def relative_error(rows: pd.DataFrame) -> np.ndarray:
    """Errors of the exact step over the errors of heyoka."""
    ours, theirs = values(rows, "backlund_error", "heyoka_error", part="headline").T
    return np.asarray(ours / theirs)


def setup_in_steps(rows: pd.DataFrame) -> np.ndarray:
    """Times to prepare the exact step, over the time of its quickest step."""
    setups, steps = values(rows, "setup_us", "ns_per_step", part=("step", "periods"), method="backlund").T
    return np.asarray(1e3 * setups / steps.min())


def batch_ratios(rows: pd.DataFrame, rivals: Sequence[str]) -> np.ndarray:
    """What a top and a unit of time cost with the rivals, over what they cost with the best exact step with no larger error."""
    methods = "backlund", tuple(rivals)
    ours, theirs = (values(rows, "ns_per_time", "error", part="rival", method=names) for names in methods)
    return np.array([price / min(ours[ours[:, 1] <= error, 0], default=np.inf) for price, error in theirs])


def long_run_lead(rows: pd.DataFrame) -> Reading:
    """Both had the same hours: the error of the exact step at its last time, over the error of heyoka at its last time."""
    runs = [select(rows, part="longest", method=name).sort_values("t") for name in ("backlund", "taylor")]
    far, near = (run.iloc[-1] for run in runs)  # if one is missing, the bound says so: see `Bound.missing`
    if not far.t > near.t:
        raise Refuted(f"heyoka reached t = {show(near.t)}, the exact step t = {show(far.t)}")
    note = f"exact step: error {show(far.error)} at t = {show(far.t)}; heyoka: {show(near.error)} at t = {show(near.t)}"
    return Reading([far.error / near.error], note)


def error_ratios(
    rows: pd.DataFrame, where: dict[str, Any], above: Sequence[tuple[str, str]], below: Sequence[tuple[str, str]]
) -> np.ndarray:
    """The errors `above` over the errors `below`, at one step. Each is pairs of a method and a measured column."""
    over, under = (
        np.array([values(rows, column, **{**where, "method": name}).ravel() for name, column in pairs])
        for pairs in (above, below)
    )
    return (over[:, None] / under[None]).ravel()


def _claim(entry: dict[str, Any]) -> Claim:
    bounds = tuple(_bound(entry["experiment"], bound) for bound in entry.pop("bound"))
    answers = tuple(ShortAnswer(**answer) for answer in entry.pop("answer", ()))
    return Claim(**entry, bounds=bounds, answers=answers)


def _bound(experiment: str, entry: dict[str, Any]) -> Bound:
    where = {name: _expanded(wanted) for name, wanted in entry.pop("where").items()}
    sign, limit, *unit = entry.pop("required").split(" ", 2)
    measure = _measure(experiment, entry, where)
    return Bound(measure, sign, float(limit), "".join(unit), where, **entry)


def _measure(experiment: str, entry: dict[str, Any], where: dict[str, Any]) -> tuple[str, ...] | Measure:
    """What a bound compares, taken out of its entry; `claims.toml` says how that is written."""
    columns = tuple(entry.pop("columns", ()))
    if "read" in entry:
        return partial(globals()[entry.pop("read")], **entry.pop("with", {}))  # a function above
    if "above" in entry:
        return partial(error_ratios, where=where, above=entry.pop("above"), below=entry.pop("below"))
    if "table" in entry:
        name, lines = entry.pop("table"), entry.pop("lines", {})
        return lambda rows: values(table(rows, experiment, name), *columns, **lines)
    return columns


def _expanded(wanted: Any) -> Any:
    """Values of a field; of a list all must be there."""
    if not isinstance(wanted, list):
        return wanted
    return tuple(value for each in wanted for value in (SETS.get(each, (each,)) if isinstance(each, str) else (each,)))


ENTRIES = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))["claim"]
CLAIMS = [_claim(entry) for entry in ENTRIES]
