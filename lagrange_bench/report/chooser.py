"""Which method should I take? From stored rows: the cheapest for each problem, length of run, error and conserved quantity."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import pandas as pd

from lagrange_bench.experiments.drawing import style, tables
from lagrange_bench.experiments.measuring.states import ACCURACY_OPTIONS, SCHEME_OPTIONS, find
from lagrange_bench.experiments.work_precision import TARGETS, races, useful
from lagrange_bench.integrators import CASES, METHODS
from lagrange_bench.integrators.registry import ARCHIVE

ASKED = ("problem", "length of the run", "error at most", "must conserve")
COLUMNS = (*ASKED, "method", "name", "cost", "beside it", "figure", "python")
NOTHING, LENGTHS, ENERGY = "nothing", "lengths (Casimirs)", "energy and lengths"
TIE = 1.05  # two times whose ratio is below are the same
RECOMMENDED = ("backlund", "backlund_splitting")  # named if they take at most PREFERRED times as long as the fastest
PREFERRED = 1.2
STEPS = 16  # of a run that was asked for by a tolerance: see `work_precision`
FAMOUS = ("rk4", "rk45")  # methods that everybody knows, to compare with


class Place(NamedTuple):
    """Where the rows of a kind of problem are: the experiment, which of its rows, and the figure drawn from them."""

    experiment: str
    where: dict[str, Any]
    figure: str


FIELDS = {
    "top in a weak field, ε = 1e-6": "tide_1e-6",
    "top in a weak field, ε = 1e-4": "weak_tide",
    "fast top in a weak field, ε = 1e-4": "fast_tide",
    "top in a field of ε = 0.01": "moderate_tide",
    "top in a strong field, ε = 0.1": "strong_tide",
    "top near a magnet": "magnet",
}
FIELD_FIGURE = "perturbed_work_t{:.0f}"  # the length of the runs
PLACES = {
    "top in a uniform field": Place("work_precision", {"state": "generic"}, "work_precision_time"),
    **{name: Place("perturbed", {"part": "work", "state": state}, FIELD_FIGURE) for name, state in FIELDS.items()},
    "whole body, not symmetric": Place("heavy_top", {"case": "kovalevskaya"}, "heavy_top_work"),
}


def answers(rows: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """A line for each problem, length, error and demand that some method meets; columns COLUMNS.

    rows : of all experiments, by name. The exact step of a body, with its attitude, is among the rows of `engines`.
    """
    names = ("heavy_top", "engines")
    if bodies := [rows[name] for name in names if "ns_per_step" in rows.get(name, ())]:
        rows = {**rows, "heavy_top": pd.concat([bodies[0], *(each[each.method == "backlund"] for each in bodies[1:])])}
    lines = [line for name, place in PLACES.items() for line in _of_problem(name, place, rows.get(place.experiment))]
    return pd.DataFrame(lines, columns=list(COLUMNS))


def _of_problem(name: str, place: Place, rows: pd.DataFrame | None) -> Iterator[tuple[str, ...]]:
    if rows is None or rows.empty or not set(place.where) <= set(rows.columns):
        return
    for field, value in place.where.items():
        rows = rows[rows[field] == value]
    body = "case" in place.where
    good = _priced_body(rows) if body else useful(rows)
    good = good.rename(columns={"total": "price"})
    good = good[~good.method.isin(ARCHIVE)]
    if good.empty:
        return
    code = place.where["case" if body else "state"]
    problem, y0 = (CASES[code].body, CASES[code].state) if body else find(code)
    title = f"{name} ({code})"
    unit = 1.0 if body else problem.scales(y0)[2]
    conserved = {method: problem.conserved_by(METHODS[method]) for method in good.method.unique() if method in METHODS}
    good = good.sort_values("span", kind="stable")
    for fields, best in races(good, ["span"], TARGETS, "price"):
        length, target = fields.values()
        when = f"{tables.show(length)} s" if body else tables.show(length)
        for demand, names in _demands(problem).items():
            candidates = best[[names <= conserved.get(method, frozenset()) for method in best.method]]
            if len(candidates):
                first, *answer = _answer(candidates)
                python = line(code, first, unit)
                yield (title, when, tables.show(target), demand, *answer, place.figure.format(length), python)


def _priced_body(rows: pd.DataFrame) -> pd.DataFrame:
    """The runs with `span`, the larger `error` of position (m) and rotation (rad), and `price`: the time of all steps."""
    good = rows[rows.status == "done"]
    if "ns_per_step" not in good:
        return good[:0]
    good = good.dropna(subset=["ns_per_step"])  # engines have rows without times, too
    error = good[["position", "rotation"]].max(axis=1, skipna=False)
    span = good.case.map(lambda case: CASES[case].until)
    return good.assign(error=error, span=span, price=1e-9 * good.ns_per_step * span / good.h)


def _demands(problem: Any) -> dict[str, frozenset[str]]:
    """What may be asked for, as names of invariants of the problem."""
    lengths = frozenset(name for name in problem.names if name.startswith(("C", "|")))
    energy = frozenset(name for name in problem.names if name.startswith("H"))
    return {NOTHING: frozenset(), **({LENGTHS: lengths} if lengths else {}), ENERGY: lengths | energy}


def line(code: str, run: pd.Series, unit: float) -> str:
    """The line of Python that repeats a stored run, with its step in the unit of `integrate`.

    code : the name of the problem. unit : the unit of stored times, in the problem's own unit of time.
    """
    steps = round(run.span / run.h) if pd.notna(run.get("h")) else STEPS
    options = {name: run.get(name) for name in (*ACCURACY_OPTIONS[1:], *SCHEME_OPTIONS) if pd.notna(run.get(name))}
    words = [f"h={run.span * unit / steps:.6g}", f"steps={steps}", f'method="{run.method}"']
    words += [f"{name}={_literal(value)}" for name, value in options.items()]
    end = "" if unit == 1.0 else f"  # to t = {run.span * unit:.4g}, which is {tables.show(run.span)} units"
    return f'integrate("{code}", {", ".join(words)}){end}'


def _literal(value: Any) -> str:
    """A value as Python writes it."""
    return f'"{value}"' if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


def _answer(best: pd.DataFrame) -> tuple[Any, ...]:
    """The run, its method and cost, the best rival (of an exact method: the best that is not exact), and the FAMOUS."""
    preferred = best[best.method.isin(RECOMMENDED) & (best.price <= PREFERRED * best.price.iloc[0])]
    first = (preferred if len(preferred) else best).iloc[0]
    cost = f"{tables.show(float(f'{1e3 * first.price:.2g}'))} ms"
    others = best[best.method.map(style.family) != style.family(first.method)]
    relation = "best of another family"
    if _is_exact(first.method):
        others, relation = others[~others.method.map(_is_exact)], "best that is not exact"
    rivals = [f"{relation}: {_times(run, first)}" for _, run in others[:1].iterrows()]
    rivals += [_times(run, first) for _, run in others[1:].iterrows() if run.method in FAMOUS]
    return first, tables.label(first.method), first.method, cost, "; ".join(rivals)


def _is_exact(method: str) -> bool:
    """Whether a method has no error but round-off."""
    return method in METHODS and METHODS[method].order is None


def _times(run: pd.Series, first: pd.Series) -> str:
    ratio = run.price / first.price
    times = f"{tables.show(float(f'{ratio:.2g}'))} times" if round(abs(ratio - 1), 9) > TIE - 1 else "just"
    return f"{tables.label(run.method)}, {times} as long"
