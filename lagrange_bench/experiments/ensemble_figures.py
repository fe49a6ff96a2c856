"""Tables and figures of the experiment `ensemble`. They have a file of their own, so an edit here makes no row old."""

import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.ensemble_sizes import FEW, FIELD_JUDGED, FIELD_SPAN, FIELD_TOPS, JUDGED, RIVALS
from lagrange_bench.experiments.measuring.states import rounded
from lagrange_bench.integrators.compiling.lanes import LANES


@of_part(
    "rival",
    f"Ensembles of {RIVALS['numba']} tops on one core ({RIVALS['heyoka']} for heyoka): for each method and step or tolerance the "
    f"median and the largest error of {JUDGED} tops at the end, µs per top, and times the cost of the cheapest exact step that "
    "is no less accurate",
)
def rivals(runs: pd.DataFrame) -> pd.DataFrame:
    exact_steps = runs[runs.method == "backlund"]

    def times(run: pd.Series) -> float:
        as_good = exact_steps[exact_steps.error <= run.error]
        return rounded(run.ns_per_time / as_good.ns_per_time.min(), 3) if len(as_good) else float("nan")

    runs = runs.assign(**{"times the exact step": [times(run) for _, run in runs.iterrows()]})
    columns = ["method", *(name for name in ("h", "tol") if name in runs), "error", "largest_error", "us_per_top"]
    return runs[[*columns, "ns_per_time", "times the exact step"]].dropna(axis=1, how="all")


SHOWN = {  # part → its columns in a table, and the caption
    "bound": (("pinned_ns", "pinned_bound_ns", "pinned_ratio", "free_ns", "free_bound_ns", "free_ratio"),
              "One top: nanoseconds per step, pinned or not (free), and those of a loop of only the "
              "operations that must wait for each other; no code can be faster"),
    "tops": (("tops", "threads", "steps", "ns_per_step", "ns_per_step_and_core", "setup_us"),
             "Many tops in one call: nanoseconds per step and top, on all cores and for one; set-up in µs per top"),
    "lanes": (("lanes", "pinned_ns_per_step", "free_ns_per_step"),
              "How many tops a core takes at once, and nanoseconds per step and top"),
    "setup": (("h", "setup_us", "first_step_us"),
              "Set-up of each top, λ(h) and the constants of its step, in µs, by step size"),
    "many": (("tops", "steps", "threads", "seconds", "us_per_top", "memory"),
             "A large ensemble: seconds in all, µs per top, memory in units of one array of states"),
    "jump": (("span", "error", "largest_error", "us_per_top"),
             f"One jump to a far time for each of {RIVALS['numba']} tops: µs per top, and the median and the largest error of "
             f"{JUDGED} of them"),
    "perturbed": (("method", "h", "error", "largest_error", "setup_us", "us_per_top", "ns_per_time", "ns_per_kick"),
                  f"{FIELD_TOPS} tops in a weak tide, on one core: the median and the largest error of "
                  f"{FIELD_JUDGED} of them at t = {FIELD_SPAN:g}; set-up, and all, in µs per top; nanoseconds per top and unit "
                  "of time, and per kick with the flow before it, without set-up"),
}  # fmt: skip


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    frames = {}
    for part, (columns, caption) in SHOWN.items():
        here = rows[(rows.part == part) & (rows.status == "done")]
        if len(here):
            frames[part] = here[list(columns)]
            frames[part].attrs["caption"] = caption
    return frames | tabulated(rivals)(rows)


@of_part()
def _draw_throughput(good: pd.DataFrame, style):
    if not (good.part == "tops").any():
        return None
    fig, (steps, setups, growth) = style.figure("page", 2.6, ncols=3)
    look = {**style.of("backlund"), "label": "_one"}
    runs = good[good.part == "tops"].sort_values("tops")
    for i, (threads, group) in enumerate(runs.groupby("threads")):
        text = "1 thread" if threads == 1 else f"{threads:.0f} threads, time × {threads:.0f}"
        colours, markers = style.FAMILIES["backlund"]
        steps.loglog(group.tops, group.ns_per_step_and_core, color=colours[-i], marker=markers[i],
                     linestyle=style.DASHES[i], label=text)  # fmt: skip
    bound = good[good.part == "bound"]
    if not bound.empty:
        alone = float(bound.pinned_ns.min())
        steps.axhline(alone, color=style.FAINT, linewidth=0.8)
        steps.annotate("one top alone", (0.98, alone), (0, -2), textcoords="offset points", fontsize=7, ha="right",
                       va="top", xycoords=("axes fraction", "data"))  # fmt: skip
    style.few_decades(steps.yaxis)
    steps.set(title="a step of many tops", xlabel="tops", ylabel="ns per step of a top, one core")
    setups.set(title="the set-up of one", xlabel="step h", ylabel="µs per set-up, one core")
    growth.set(title="a short run of many", xlabel="tops", ylabel=f"µs per top, {FEW} steps, all cores")
    steps.legend(loc="upper right", bbox_to_anchor=(1.0, 0.88))
    for ax, part, across, up in ((setups, "setup", "h", "setup_us"), (growth, "many", "tops", "us_per_top")):
        chosen = good[good.part == part].sort_values(across)
        if not chosen.empty:
            ax.semilogx(chosen[across], chosen[up], **look)
            ax.set_ylim(0, 1.1 * chosen[up].max())
    fig.caption = (
        f"A step of the exact map against the number of tops, {LANES} of them to a SIMD block; few tops leave lanes empty. "
        "Set-up of a top, λ(h) and constants, against the step in the tops' units of time; of long steps "
        "it includes the period and the turn of a nutation. Short runs of very many tops, set-up included."
    )
    return fig


@of_part()
def _draw_rivals(good: pd.DataFrame, style):
    runs = good[good.part == "rival"]
    if runs.empty:
        return None
    fig, ax = style.figure("page", 3.4)
    for method in style.ordered(runs.method):
        chosen = runs[runs.method == method].sort_values([name for name in ("h", "tol") if name in runs])
        ax.loglog(chosen.ns_per_time, chosen.error.clip(lower=1e-17), **style.of(method))
    jump = good[good.part == "jump"]
    if not jump.empty:
        look = {"linestyle": "none", "marker": "*", "markersize": 7, "color": style.FAMILIES["backlund"][0][2]}
        ax.loglog(jump.ns_per_time, jump.error, **look, label="Bäcklund, one jump")
    ax.set(xlabel="ns for a top and a unit of time, one core, set-up included")
    ax.set(ylabel=f"error at the end, median of {JUDGED} tops")
    style.legend_below(fig)
    fig.caption = (
        "Many tops over the same time on one core: the exact step and heyoka's batch mode, in SIMD lanes, and the fixed steps of "
        f"others, one top after another. The runs are t = {show(float(runs.span.iloc[0]))} long. Along a line "
        "the step or, for heyoka, the tolerance changes. A jump is one map from the start to the end, not a sequence of steps."
    )
    return fig


draw = drawn(throughput=_draw_throughput, rivals=_draw_rivals)
