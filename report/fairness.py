"""What was done so that no method is handicapped, with the numbers that show it. Reads stored rows and records of methods."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lagrange_bench.experiments.cost import quickest
from lagrange_bench.experiments.drawing import tables
from lagrange_bench.experiments.measuring.states import methods_on
from lagrange_bench.integrators.compiling.compiled import OPTIONS
from lagrange_bench.integrators.interface import Method

ENGINES = {
    "numba": "compiled here (Numba)",
    "heyoka": "compiled by heyoka (LLVM)",
    "scipy": "SciPy, interpreted",
    "python": "interpreted",
}


class Fairness(NamedTuple):
    """Sentences under a heading each, and a table with a row for each method."""

    rules: list[tuple[str, str]]
    methods: pd.DataFrame


def assemble(rows: dict[str, pd.DataFrame]) -> Fairness:
    """From the rows of all experiments, by name; what is not stored is not said."""
    cost, work, ensemble = (rows.get(name, pd.DataFrame()) for name in ("cost", "work_precision", "ensemble"))
    records = methods_on()
    step, start = (_part(cost, part) for part in ("step", "start"))
    step = step if step.empty else quickest(step)
    setup = _start(start, step, _part(ensemble, "setup"))
    return Fairness(_rules(records, step, setup, work), _methods(records, step, start))


def _part(rows: pd.DataFrame, part: str) -> pd.DataFrame:
    return rows[(rows.part == part) & (rows.status == "done")] if "part" in rows else pd.DataFrame()


def _rules(records: dict[str, Method], step: pd.DataFrame, setup: str, work: pd.DataFrame) -> list[tuple[str, str]]:
    from lagrange_bench.integrators.methods.backlund_splitting import (
        PIN_EVERY,  # compiles: not for who only imports this
    )

    engines = [record.engine for record in records.values()]
    many = ", ".join(f"{engines.count(e)} {text}" for e, text in ENGINES.items() if e in engines)
    flags = "off" if not OPTIONS["fastmath"] else "on"
    pinned = [name for name, record in records.items() if "pin" in record.options]
    projected = [name for name in records if name.endswith("_projected")]
    compensated = [name for name, record in records.items() if {"compensated", "high_accuracy"} & set(record.options)]
    return [
        ("Compiled or not.", f"{many}. {_interpretation(step)}"),
        (
            "The same flags.",
            f"Fused multiply-add and fast-math are {flags} for everything compiled here, rotations and kicks use no "
            "library sine. heyoka and SciPy run as installed.",
        ),
        ("Set-up and compilation apart.", setup),
        (
            "What an evaluation is.",
            "A right-hand side or a force, counted where a method has any. That is a stage of Runge-Kutta, a kick of a "
            "splitting, an order of a Taylor step, or a stage of one iteration of a Gauss method or midpoint rule. Explicit "
            "maps and closed forms have none and are compared by time only.",
        ),
        (
            "Tolerances are not errors.",
            "A tolerance bounds the error of one step. That of a run can be ten or a thousand times as large. Costs are "
            "compared at the error that is reached against the exact solution, never at equal tolerances or equal steps.",
        ),
        ("Each at its best step.", _sweep(work)),
        (
            "The efficient frontier.",
            "A run on the frontier is one that no other run beats in both time and error. Set-up counts in one column and not in "
            "the other: over short runs it decides.",
        ),
        (
            "Final state, one trajectory.",
            "Times are those to the state at the end. In the experiment work_precision no method may step over more than 16 "
            "units of time. An exact one could jump to the end for the price of a set-up: the experiments ensemble and gaudin "
            "show it. Storing every step costs extra, and so does dense output of Taylor and Runge-Kutta methods. This is the "
            "latency of one trajectory, not the throughput of many.",
        ),
        (
            "Methods that are moved back onto the invariants.",
            f"{_named(pinned)}, by default every eighth step, or in every step where steps of `addition_theorem` are long "
            f"(option `pin`); {_named(projected)} in every step. In a potential `backlund_splitting` is moved back onto C1 and "
            f"C2, every {PIN_EVERY} steps. No other method is.",
        ),
        (
            "Judged at its own time.",
            "A method with fixed steps is compared with the exact solution at exactly n·h rather than at the nearest double, "
            "which can differ by 6·10⁻¹¹ at t = 10⁶. That is more than some methods' error.",
        ),
        (
            "Summation.",
            "No method adds with compensation unless its label says so"
            + (f"; an option adds it to {', '.join(compensated)}." if compensated else ".")
            + " Nonlinear equations are iterated until they stagnate, with no tolerance to tune.",
        ),
        (
            "The same data.",
            "All start from the same doubles as the exact solution. |x| is not 1 on the sixteen random tops, so a formula that "
            "assumes |x| = 1 would fail there.",
        ),
    ]


def _interpretation(step: pd.DataFrame) -> str:
    """The price of interpretation: one formula, compiled and not."""
    if step.empty or not {"rk45", "rk45_fixed"} <= set(step.method):
        return ""
    least = step.groupby("method").ns_per_step.min()
    return (
        f"A step of the pair of Dormand and Prince takes {tables.show(float(least['rk45']) / 1000)} µs in SciPy and "
        f"{tables.show(float(least['rk45_fixed']))} ns compiled: a factor of {least['rk45'] / least['rk45_fixed']:.0f}, "
        "due to the interpreter and not the method. So each explicit interpreted method stands beside a compiled relative, "
        "and runs of interpreted methods are shorter."
    )


def _start(start: pd.DataFrame, step: pd.DataFrame, parameters: pd.DataFrame) -> str:
    said = "Reported times exclude compilation; the table of the cost experiment has it"
    if not start.empty:
        first = start[start.cached == False].set_index("method").first_s  # noqa: E712, an object column
        said += (
            f" (first use with nothing cached: {tables.show(float(first.median()))} s in the median, "
            f"{tables.show(float(first.max()))} s for {first.idxmax()})"
        )
    if step.empty:
        return f"{said}."
    setup = step.groupby("method").setup_us.min()
    least, most, ours = (tables.show(float(us)) for us in (setup.min(), setup.max(), setup.get("backlund", np.nan)))
    said = (
        f"{said}. Set-up of a stepper once compiled, which every new torus or step pays, is in a column of its own: "
        f"{least} to {most} µs, {ours} µs for the exact Bäcklund step"
    )
    if parameters.empty:
        return f"{said}."
    short, long = (tables.show(float(us)) for us in (parameters.setup_us.min(), parameters.setup_us.max()))
    return (
        f"{said}. Of short steps most of that is Python: in an ensemble λ(h) and the constants of a step take {short} µs for a "
        f"top. They take more for longer steps, up to {long} µs on average where the period of nutation is needed."
    )


def _named(methods: list[str]) -> str:
    return " and ".join(f"`{name}`" for name in methods)


def _sweep(work: pd.DataFrame) -> str:
    said = "Every method runs with the same list of steps (or tolerances), from coarse to fine"
    if "stopped" not in work:
        return f"{said}, and is judged at the one that is cheapest for the error asked for."
    last = work.groupby(["span", "state", "method"], sort=False).tail(1).stopped
    limits = ", ".join(
        f"{tables.show(float(limit))} s at t = {tables.show(float(span))}"
        for span, limit in sorted(work.groupby("span").longest.max().items())
    )
    call = tables.show(1e6 * float(work.seconds.min()))
    floor, long = (int((last == why).sum()) for why in ("round-off", "too long"))
    return (
        f"{said}. Of {len(last)} curves {floor} end where the error falls no more, {long} where one run would take too long, "
        f"and {len(last) - floor - long} at the tightest tolerance that is tried. The limits are the same for all: {limits}. A "
        f"run is one call from Python, and that call alone takes at least {call} µs. Each is judged at the step that is "
        "cheapest for the error asked for."
    )


def _methods(records: dict[str, Method], step: pd.DataFrame, start: pd.DataFrame) -> pd.DataFrame:
    table = []
    for name, record in records.items():
        row: dict[str, Any] = {
            "method": name,
            "family": record.family,
            "engine": ENGINES[record.engine],
            "order": record.order or "exact",
            "knob": record.knob,
            "options": _options(record),
        }
        mine = step[step.method == name] if len(step) else step
        for column, found in {"evaluations per step": "evals_per_step", "ns per step": "ns_per_step"}.items():
            least, most = (float(mine[found].min()), float(mine[found].max())) if len(mine) else (None, None)
            row[column] = "none" if least == 0.0 else least  # of all steps and tolerances
            row[f"{column}, at most"] = most or None
        row["set-up, µs"] = float(mine.setup_us.min()) if len(mine) else None
        fresh = start[(start.method == name) & (start.cached == False)] if len(start) else start  # noqa: E712
        row["first use, nothing cached, s"] = float(fresh.first_s.iloc[0]) if len(fresh) else None
        table.append(row)
    return pd.DataFrame(table)


def _options(record: Method) -> str:
    """The options and their values in every run of the report, the knob excepted; see `states.options_of`."""
    values = {name: parameter.default for name, parameter in inspect.signature(record.prepare).parameters.items()}
    if record.knob == "rtol":
        values["atol"] = "rtol/1000"
    return ", ".join(f"{name} = {values[name]}" for name in record.options if name != record.knob)
