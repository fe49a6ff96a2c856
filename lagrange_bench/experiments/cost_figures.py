"""Tables and figures of the experiment `cost`. They have a file of their own, so an edit here makes no row old."""

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring.states import ACCURACY_OPTIONS


def quickest(steps: pd.DataFrame) -> pd.DataFrame:
    """The least of every number over all rounds, for each method and step or tolerance."""
    columns = [name for name in ACCURACY_OPTIONS if name in steps]
    return steps.groupby(["method", *columns], sort=False, dropna=False).min(numeric_only=True).reset_index()


@of_part(
    "step",
    "What a step costs, by step size or tolerance: nanoseconds per step and per unit of time, counts of work, and the set-up of "
    "a stepper in µs; compilation is not included. h and time are in units of the top's time scale",
)
def steps(rows: pd.DataFrame) -> pd.DataFrame:
    columns = [name for name in ACCURACY_OPTIONS if name in rows]
    measured = ["ns_per_step", "ns_per_time", "steps_per_time", "evals_per_step", "iterations_per_step", "setup_us"]
    return quickest(rows)[["method", *columns, *measured]].dropna(axis=1, how="all")


@of_part(
    "periods",
    "What a long exact step costs, its length in nutation periods: nanoseconds per step, and the set-up of a stepper in µs",
)
def periods(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[["method", "periods", "ns_per_step", "setup_us"]]


@of_part(
    "start", "What the first use costs, in seconds: import, first use with and without cached machine code, second use"
)
def start(rows: pd.DataFrame) -> pd.DataFrame:
    fresh, cached = (rows[rows.cached.eq(known)].set_index("method") for known in (False, True))
    first, second = "first use, nothing cached, s", "first use, cached, s"
    columns = {"import, s": cached.import_s, first: fresh.first_s, second: cached.first_s}
    columns["second use, s"] = cached.second_s
    return pd.DataFrame(columns).reindex(rows.method.unique()).reset_index()


@of_part(
    "headline",
    "The exact step and heyoka's Taylor series at machine precision over the same time: seconds, their ratio, that of heyoka "
    "through this bench to heyoka called directly (adapter), and the errors at the end. h is in units of the top's time scale",
)
def headline(rows: pd.DataFrame) -> pd.DataFrame:
    ends = ["ratio", "adapter_ratio", "backlund_error", "heyoka_error"]
    columns = ["fraction", "h", "steps", "backlund_s", "heyoka_s", *ends]
    return rows[columns].rename(columns={"fraction": "h / nutation period"})


PRICES = {"ns_per_step": "ns per step", "setup_us": "set-up of a stepper, µs"}


@of_part("step")
def _draw_steps(steps: pd.DataFrame, style):
    """Draw a row for each method, by family, and within a family from cheap to dear."""
    level = steps.groupby("method").ns_per_step.min()
    families = [*style.FAMILIES, style.OTHERS]
    names = sorted(level.index, key=lambda name: (families.index(style.family(name)), level[name]))
    fig, axes = style.figure("page", 0.9 + 0.155 * len(names), ncols=len(PRICES), sharey=True)
    places = np.arange(len(names))[::-1]
    least = quickest(steps).groupby("method")
    for ax, (column, text) in zip(axes, PRICES.items(), strict=True):
        ends = least[column].agg(["min", "max"]).loc[names]
        colours = [style.bold(name)["color"] for name in names]
        ax.hlines(places, ends["min"], ends["max"], colors=colours, linewidth=2.2, alpha=0.35)
        ax.scatter(ends["min"], places, c=colours, s=14, zorder=3)
        ax.set_xscale("log")
        ax.margins(x=0.1)  # no dot across the edge
        ax.set_xlabel(text)
        for first, second in zip(range(len(names) - 1), range(1, len(names)), strict=True):
            if style.family(names[first]) != style.family(names[second]):
                ax.axhline(places[first] - 0.5, color="#d5d5d5", linewidth=0.6)
    axes[0].set_yticks(places, [style.plain(style.label(name)) for name in names])
    for tick, name in zip(axes[0].get_yticklabels(), names, strict=True):
        tick.set(color=style.readable(style.bold(name)["color"]), fontsize=6.5)
    axes[0].set_ylim(-0.7, len(names) - 0.3)
    fig.caption = (
        "What a step and a set-up cost, by family: the dot is the least of all step sizes or tolerances tried, the bar "
        "reaches to the most. One trajectory; minima of repeated samples, compilation not included. What a given error "
        "costs is in `work_precision`."
    )
    return fig


tables = tabulated(steps, periods, start, headline)
draw = drawn(steps=_draw_steps)
