"""The numbers that show that no method is handicapped: from stored rows and records of methods. The page has the rules."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from lagrange_bench.experiments.cost import quickest
from lagrange_bench.experiments.measuring.reductions import done
from lagrange_bench.experiments.measuring.states import methods_on
from lagrange_bench.integrators.compiling.compiled import OPTIONS
from lagrange_bench.integrators.interface import Method

ENGINES = {
    "numba": "compiled here (Numba)",
    "heyoka": "compiled by heyoka (LLVM)",
    "scipy": "SciPy, interpreted",
    "python": "interpreted",
}
Numbers = dict[str, Any]


class Fairness(NamedTuple):
    """Numbers for the rules on the page, and a table with a row for each method."""

    numbers: Numbers
    methods: pd.DataFrame


def assemble(rows: Mapping[str, pd.DataFrame]) -> Fairness:
    """From the rows of all experiments, by name. A number whose rows are not stored is left out."""
    cost, work, ensemble = (rows.get(name, pd.DataFrame()) for name in ("cost", "work_precision", "ensemble"))
    records = methods_on()
    step, start, parameters = done(cost, "step"), done(cost, "start"), done(ensemble, "setup")
    step = quickest(step) if len(step) else step
    first = start[start.cached.eq(False)].set_index("method").first_s if len(start) else pd.Series(dtype=float)
    numbers = {**_of_records(records), **_of_steps(step), **_of_runs(work)}
    if len(first):
        numbers["first"] = {"median": first.median(), "most": first.max(), "method": first.idxmax()}
    if len(parameters):
        numbers["parameters"] = (parameters.setup_us.min(), parameters.setup_us.max())
    return Fairness(numbers, pd.DataFrame([_method(name, record, step, first) for name, record in records.items()]))


def _of_records(records: Mapping[str, Method]) -> Numbers:
    """What the methods themselves say."""
    from lagrange_bench.integrators.methods.backlund_splitting import PIN_EVERY  # compiles: only who draws a page waits

    engines = [record.engine for record in records.values()]
    return {
        "engines": [(engines.count(engine), text) for engine, text in ENGINES.items() if engine in engines],
        "fastmath": OPTIONS["fastmath"],
        "pinned": [name for name, record in records.items() if "pin" in record.options],
        "pin_every": PIN_EVERY,
        "projected": [name for name in records if name.endswith("_projected")],
        "compensated": [name for name, r in records.items() if {"compensated", "high_accuracy"} & set(r.options)],
    }


def _of_steps(step: pd.DataFrame) -> Numbers:
    """Set-up of steppers; and the price of interpretation: one formula, compiled and not."""
    if step.empty:
        return {}
    numbers = {}
    least, setup = step.groupby("method").ns_per_step.min(), step.groupby("method").setup_us.min()
    if {"rk45", "rk45_fixed"} <= set(least.index):
        numbers["interpreted"] = {"us": least["rk45"] / 1000, "ns": least["rk45_fixed"]}
    return {**numbers, "setup": {"least": setup.min(), "most": setup.max(), "ours": setup.get("backlund")}}


def _of_runs(work: pd.DataFrame) -> Numbers:
    """Where the curves of error against time end, and the shortest run."""
    if "stopped" not in work:
        return {}
    ends = list(work.groupby(["span", "state", "method"], sort=False).tail(1).stopped)
    floor, long = ends.count("round-off"), ends.count("too long")
    return {
        "curves": {"all": len(ends), "floor": floor, "long": long, "tight": len(ends) - floor - long},
        "limits": sorted(work.groupby("span").longest.max().items()),
        "call": 1e6 * work.seconds.min(),
    }


def _method(name: str, record: Method, step: pd.DataFrame, first: pd.Series) -> Numbers:
    """How a method runs; None where nothing is stored of it."""
    mine = step[step.method == name] if len(step) else step
    least, most = (
        of.to_dict() if len(mine) else {} for of in (mine.min(), mine.max())
    )  # over all steps and tolerances
    evaluations = least.get("evals_per_step")
    return {
        "method": name,
        "family": record.family,
        "engine": ENGINES[record.engine],
        "order": record.order or "exact",
        "knob": record.knob,
        "options": _options(record),
        "evaluations per step": "none" if evaluations == 0.0 else evaluations,
        "evaluations per step, at most": most.get("evals_per_step") or None,
        "ns per step": least.get("ns_per_step"),
        "ns per step, at most": most.get("ns_per_step"),
        "set-up, µs": least.get("setup_us"),
        "first use, nothing cached, s": first.get(name),
    }


def _options(record: Method) -> str:
    """The options and their values in every run of the report, the knob excepted; see `states.options_of`."""
    values = {name: parameter.default for name, parameter in inspect.signature(record.prepare).parameters.items()}
    if record.knob == "rtol":
        values["atol"] = "rtol/1000"
    return ", ".join(f"{name} = {values[name]}" for name in record.options if name != record.knob)
