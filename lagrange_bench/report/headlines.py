"""What a figure shows, in a sentence with its numbers, for figures that say none themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import pandas as pd

from lagrange_bench.experiments.drawing.looks import label
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring import states
from lagrange_bench.experiments.perturbed import SPANS
from lagrange_bench.integrators import INVARIANTS

Tables = Mapping[str, pd.DataFrame]


def headline(figure: str, rows: pd.DataFrame, tables: Tables) -> str:
    """The sentence above a figure; "" if there is none, or if these rows do not show it.

    figure : with its experiment, such as "drift_time". rows, tables : of this experiment.
    """
    try:
        return HEADLINES[figure](rows, tables) if figure in HEADLINES else ""
    except (LookupError, ValueError):  # a run of one's own lacks the method, or the table
        return ""


def _where(table: pd.DataFrame, **wanted: Any) -> pd.DataFrame:
    """The rows with these values, or all; LookupError if there is none."""
    for column, value in wanted.items():
        table = table[table[column].eq(value)]
    if table.empty:
        raise LookupError(wanted)
    return table


def _drift_in_time(rows: pd.DataFrame, tables: Tables) -> str:
    verdicts = _where(tables["verdicts"], invariant="H")["verdict"]
    conserved = verdicts.isin(("round-off", "exact")).sum()
    return f"{conserved} of {len(verdicts)} methods conserve the energy to round-off"


def _drift_by_step(rows: pd.DataFrame, tables: Tables) -> str:
    exact = _where(rows, part="h", method="backlund")
    worst, h = exact[list(INVARIANTS)].abs().to_numpy().max(), show(exact["h"].max())
    return f"With steps up to {h} time scales the exact step changes no invariant by more than {show(worst)}"


def _theory(rows: pd.DataFrame, tables: Tables) -> str:
    left = _where(tables["theory"], **{"in range": True})["share left"]
    return f"Theory predicts the phase error of {len(left)} runs to within {show(100 * left.max())} %"


def _steps(rows: pd.DataFrame, tables: Tables) -> str:
    ns = tables["steps"].groupby("method")["ns_per_step"].min()
    exact, strang, rk4 = (show(round(ns[name])) for name in ("backlund", "strang", "rk4"))
    return f"An exact step takes {exact} ns, one of Strang {strang} ns, one of RK4 {rk4} ns"


def _profile(rows: pd.DataFrame, tables: Tables) -> str:
    races = _where(tables["cheapest"], **{"set-up counted": "yes"})["cheapest"]
    won = races.isin(("backlund", "backlund_unpinned")).sum()
    return f"Set-up counted, the Bäcklund step is the cheapest in {won} of {len(races)} races"


def _races(rows: pd.DataFrame, tables: Tables, **where: Any) -> str:
    races = _where(tables["winners"], **where)["cheapest"]
    won = races.eq("backlund_splitting").sum()
    return f"The exact step inside a splitting is the cheapest in {won} of {len(races)} races"


def _gain(rows: pd.DataFrame, tables: Tables) -> str:
    races = _where(tables["winners"], part="work").set_index(["state", "span"])
    ratios = races["times as long as the exact step inside"]
    (state, span), gain = ratios.idxmax(), ratios.max()
    return f"Inside a splitting the exact step gains most for “{states.label(state)}” and t = {show(span)}: {gain:.0f} times"


def _forms(rows: pd.DataFrame, tables: Tables) -> str:
    forms = tables["forms"].dropna(subset="h").set_index(["h", "form"])["phase error / t"]
    before, after = (forms[forms.index.levels[0].min(), form] for form in ("paper's program", "pinned, every step"))
    return f"Restored invariants lower the phase error from {show(before)} to {show(after)} of the time"


def _batches(rows: pd.DataFrame, tables: Tables) -> str:
    times = _where(tables["rivals"], method="taylor")["times the exact step"]
    return f"heyoka in batches takes {show(times.min())} to {show(times.max())} times as long as the exact step"


def _bodies(rows: pd.DataFrame, tables: Tables) -> str:
    table = _where(tables["orders"], case="bruels").set_index("method")
    ratio = table["rotation"] / table["position"]
    worst = ratio.idxmax()
    return f"On “bruels” {label(worst)} errs {show(ratio[worst])} times as much in rotation (rad) as in position (m)"


def _paper(rows: pd.DataFrame, tables: Tables) -> str:
    worst = tables["invariants"].groupby("form")[list(INVARIANTS)].max().max(axis=1)
    program, ours = (show(worst[form]) for form in ("paper's program", "real form, pinned"))
    return f"The paper's program changes an invariant by up to {program}, the pinned form by {ours}"


def _magnets(rows: pd.DataFrame, tables: Tables) -> str:
    table = _where(tables["magnets"])
    units, error, most = (show(table[name].max()) for name in ("units", "error", "spins"))
    return f"One step of up to {units} units is right to {error}, with {show(table['spins'].min())} to {most} spins"


HEADLINES: dict[str, Callable[[pd.DataFrame, Tables], str]] = {
    "drift_time": _drift_in_time,
    "drift_h": _drift_by_step,
    "phase_theory": _theory,
    "cost_steps": _steps,
    "work_precision_profile": _profile,
    **{f"perturbed_work_t{span:.0f}": partial(_races, part="work", span=span) for span in SPANS},
    "perturbed_winner": _gain,
    "perturbed_driven": partial(_races, part="driven"),
    "drift_form": _forms,
    "ensemble_rivals": _batches,
    "heavy_top_steps": _bodies,
    "paper_invariants": _paper,
    "paper_magnet": _magnets,
}
