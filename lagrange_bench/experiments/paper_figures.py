"""Tables and figures of the experiment `paper`. They have a file of their own, so an edit here makes no row old."""

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring.reductions import largest, worst
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators.interface import INVARIANTS

TITLES = {1: "steps close together, λ = 0.02i", 2: "steps far apart, λ = 500 + 5000i"}
LOOKS = {"real form": "backlund", "real form, pinned": "backlund_paper", "paper's program": "backlund_textbook"}


@of_part(
    "",
    "The two runs of the paper's figures: the largest relative error of each invariant, by the way the map is written",
)
def invariants(rows: pd.DataFrame) -> pd.DataFrame:
    runs = rows.groupby(["figure", "form"], sort=False)
    return runs[list(INVARIANTS)].agg(largest).assign(steps=runs.steps.first()).reset_index()


@of_part(
    "magnet", "The exact step of random magnets: the largest difference from the reference solution after one step"
)
def magnets(rows: pd.DataFrame) -> pd.DataFrame:
    runs = rows.groupby(["spins", "units"], sort=False)
    return runs.error.agg(largest).reset_index().assign(magnets=runs.size().to_numpy())


@of_part()
def _draw_orbits(rows: pd.DataFrame, style):
    fig, axes = style.figure("page", 3.3, ncols=2, subplot_kw={"projection": "3d"})
    for ax, figure in zip(axes, TITLES, strict=True):
        points = rows[(rows.figure == figure) & (rows.form == "real form")]
        x = points[["x1", "x2", "x3"]].to_numpy()
        size = float(np.linalg.norm(find(f"figure{figure}")[1][3:]))
        theta, phi = np.linspace(0, np.pi, 25), np.linspace(0, 2 * np.pi, 49)
        grid = [np.outer(np.sin(theta), f(phi)) * size for f in (np.cos, np.sin)]
        grid.append(np.outer(np.cos(theta), np.ones_like(phi)) * size)
        ax.plot_wireframe(*grid, color="#dddddd", linewidth=0.3, rstride=3, cstride=4)
        if figure == 1:
            ax.plot(*x.T, color="#999999", linewidth=0.5)
        # each point is a very short line: marks or pixels would take many more bytes
        ends = np.repeat(x, 3, axis=0)
        ends[1::3, 0] += 0.006 * size
        ends[2::3] = np.nan
        ax.plot(*ends.T, color="#0072B2", linewidth=1.0, solid_capstyle="round")
        ax.set_box_aspect((1, 1, 1), zoom=0.94)  # makes room for the labels: the layout engine does not see them
        ax.set_title(TITLES[figure], y=1.0)
        for i, axis in enumerate((ax.xaxis, ax.yaxis, ax.zaxis), start=1):
            axis.set_label_text(f"$x_{i}$")
            axis.set_rotate_label(False)
            axis.labelpad = -6
        ax.tick_params(pad=-1)
        ax.locator_params(nbins=4)
    fig.caption = (
        "The axis of the top, x, on the sphere |x| = constant: left 1000 steps from the data of the paper's "
        "Figure 1, joined by grey lines as there; right 4000 steps from those of its Figure 2."
    )
    return fig


@of_part()
def _draw_drift(rows: pd.DataFrame, style):
    labels = "number of steps", "largest relative error so far"
    fig, axes = style.panels(list(TITLES.values()), 2, (0.0, 2.9), *labels, sharey=True)
    for ax, figure in zip(axes, TITLES, strict=True):
        for form, method in LOOKS.items():
            chosen = rows[(rows.figure == figure) & (rows.form == form) & (rows.n > 0)]
            most = worst(chosen, INVARIANTS).cummax()
            ax.loglog(chosen.n, most.clip(lower=1e-17), **{**style.of(method), "marker": "none", "label": form})
        style.ulp_line(ax)
    style.legend_below(fig)
    fig.caption = (
        "Largest relative error so far of H, J3, |x|² and x·J, for the same map in two forms, from the data of the paper's "
        "Figures 1 (left) and 2 (right). The program divides by "
        "numbers that nearly vanish; the real form has no pole; pinned, it is moved back onto its invariants every eighth "
        "step. The grey line is one ulp."
    )
    return fig


@of_part("magnet")
def _draw_magnets(rows: pd.DataFrame, style):
    fig, ax = style.figure("column", 2.8)
    for (units, runs), marker, beside in zip(rows.groupby("units"), "osD", (-0.15, 0.0, 0.15), strict=False):
        look = {"linestyle": "none", "marker": marker, "label": f"a step of {units:g} units"}
        ax.semilogy(runs.spins + beside, runs.error.clip(lower=1e-17), **look)
    ax.set(xlabel="number of spins", ylabel="error of the exact step")
    style.legend_below(fig)
    fig.caption = (
        "The exact step of random Gaudin magnets: the largest error of a component of a spin after one step, against the "
        "reference solution. It is that of the rounded couplings there."
    )
    return fig


tables = tabulated(invariants, magnets)
draw = drawn(figures=_draw_orbits, invariants=_draw_drift, magnet=_draw_magnets)
