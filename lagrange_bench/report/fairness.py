"""Numbers that show that no method is at a disadvantage, from stored rows and records of methods. The page has the rules."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from lagrange_bench.experiments.cost_figures import quickest
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


def assemble(rows: Mapping[str, pd.DataFrame]) -> Numbers:
    """From the rows of all experiments, by name. A number whose rows are not stored is left out."""
    cost, work, ensemble = (rows.get(name, pd.DataFrame()) for name in ("cost", "work_precision", "ensemble"))
    step, start, parameters = done(cost, "step"), done(cost, "start"), done(ensemble, "setup")
    numbers = {**_of_records(methods_on()), **_of_steps(step), **_of_runs(work)}
    if len(start):
        first = start[start.cached.eq(False)].set_index("method").first_s
        numbers["first"] = {"median": first.median(), "most": first.max(), "method": first.idxmax()}
    if len(parameters):
        numbers["parameters"] = (parameters.setup_us.min(), parameters.setup_us.max())
    return numbers


def _of_records(records: Mapping[str, Method]) -> Numbers:
    """What the methods themselves say."""
    # compiles: only who draws a page waits
    from lagrange_bench.integrators.methods.backlund_kernel import RESTORE_EVERY

    engines = [record.engine for record in records.values()]
    return {
        "engines": [(engines.count(engine), text) for engine, text in ENGINES.items() if engine in engines],
        "fastmath": OPTIONS["fastmath"],
        "pinned": [name for name, record in records.items() if "pin" in record.options],
        "pin_every": RESTORE_EVERY,
        "projected": [name for name in records if name.endswith("_projected")],
        "compensated": [name for name, r in records.items() if {"compensated", "high_accuracy"} & set(r.options)],
    }


def _of_steps(step: pd.DataFrame) -> Numbers:
    """Set-up of steppers; and the price of interpretation: one formula, compiled and not."""
    if step.empty:
        return {}
    numbers, methods = {}, quickest(step).groupby("method")
    least, setup = methods.ns_per_step.min(), methods.setup_us.min()
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
