"""The paper's two figures: its program beside the real, pole-free form of the same map.

Figure 1 of Kuznetsov, Petrera and Ragnisco iterates the two-point map with λ = 0.02i a thousand times, Figure 2 with
λ = 500 + 5000i four thousand times. Both maps, the paper's MATLAB program with its complex divisions and the real form,
are iterated here from the same data; what is judged is how far H, J3, |x|² and x·J move.
"""

import numpy as np
import pandas as pd

from lagrange_bench.experiments import script
from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.reductions import largest, worst
from lagrange_bench.experiments.measuring.states import find, options_of, rounded
from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.interface import INVARIANTS

VERSION = 1
MEASURED = {"": ("n", *INVARIANTS)}

FIGURES: dict[int, dict] = {
    1: {"state": "figure1", "re": 0.0, "im": 0.02, "steps": 1000},
    2: {"state": "figure2", "re": 500.0, "im": 5000.0, "steps": 4000},
}
TITLES = {1: "steps close together, λ = 0.02i", 2: "steps far apart, λ = 500 + 5000i"}
FORMS = {  # name in tables: method, its options
    "real form": ("backlund", {"pin": 0}),
    "real form, pinned": ("backlund", {"pin": 8}),
    "paper's program": ("backlund_textbook", {}),
}


def cells(profile: str) -> list[dict]:
    return [
        {"figure": figure, "form": form, "method": method, **run, **options}
        for figure, run in FIGURES.items()
        for form, (method, options) in FORMS.items()
    ]


def measure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    stepper = prepare(top, y0, 1.0, cell["method"], lam=complex(cell["re"], cell["im"]), **options_of(cell))
    y = stepper.record(y0, cell["steps"], 1)
    drift = metrics.relative_drift(top.invariants(y), top.invariant_scales(y0))
    axis = range(3 if cell["form"] == "real form" else 0)  # the orbit is drawn once
    columns = {"n": range(len(y)), **{f"x{i + 1}": [rounded(x, 6) for x in y[:, 3 + i]] for i in axis}}
    columns |= {name: [rounded(error) for error in drift[:, i]] for i, name in enumerate(INVARIANTS)}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


@of_part(
    "",
    "The two runs of the paper's figures: the largest relative error of each invariant, by the way the map is written",
)
def invariants(rows: pd.DataFrame) -> pd.DataFrame:
    runs = rows.groupby(["figure", "form"], sort=False)
    return runs[list(INVARIANTS)].agg(largest).assign(steps=runs.steps.first()).reset_index()


@of_part()
def _draw_orbits(rows: pd.DataFrame, style):
    fig, axes = style.figure("page", 3.3, ncols=2, subplot_kw={"projection": "3d"})
    for ax, (figure, run) in zip(axes, FIGURES.items(), strict=True):
        points = rows[(rows.figure == figure) & (rows.form == "real form")]
        x = points[["x1", "x2", "x3"]].to_numpy()
        size = float(np.linalg.norm(find(run["state"])[1][3:]))
        theta, phi = np.linspace(0, np.pi, 25), np.linspace(0, 2 * np.pi, 49)
        grid = [np.outer(np.sin(theta), f(phi)) * size for f in (np.cos, np.sin)]
        grid.append(np.outer(np.cos(theta), np.ones_like(phi)) * size)
        ax.plot_wireframe(*grid, color="#dddddd", linewidth=0.3, rstride=3, cstride=4)
        if figure == 1:
            ax.plot(*x.T, color="#E69F00", linewidth=0.3)
        # each point a line of hardly any length: as marks or pixels they would be many more bytes
        ends = np.repeat(x, 3, axis=0)
        ends[1::3, 0] += 0.006 * size
        ends[2::3] = np.nan
        ax.plot(*ends.T, color="#0072B2", linewidth=1.0, solid_capstyle="round")
        ax.set_box_aspect((1, 1, 1), zoom=0.94)  # leaves room for the labels, which the layout engine does not see
        ax.set_title(TITLES[figure], y=1.0)
        for i, axis in enumerate((ax.xaxis, ax.yaxis, ax.zaxis), start=1):
            axis.set_label_text(f"$x_{i}$")
            axis.set_rotate_label(False)
            axis.labelpad = -6
        ax.tick_params(pad=-1)
        ax.locator_params(nbins=4)
    fig.caption = (
        "The axis of the top, x, on the sphere |x| = constant: left 1000 steps from the data of the paper's "
        "Figure 1, joined by lines as there; right 4000 steps from those of its Figure 2."
    )
    return fig


@of_part()
def _draw_drift(rows: pd.DataFrame, style):
    labels = "number of steps", "largest relative error so far"
    fig, axes = style.panels(list(TITLES.values()), 2, (0.0, 2.9), *labels, sharey=True)
    for ax, figure in zip(axes, FIGURES, strict=True):
        for form, (method, options) in FORMS.items():
            chosen = rows[(rows.figure == figure) & (rows.form == form) & (rows.n > 0)]
            look = style.of("backlund_paper" if options.get("pin") else method)
            most = worst(chosen, INVARIANTS).cummax()
            ax.loglog(chosen.n, most.clip(lower=1e-17), **{**look, "marker": "none", "label": form})
        style.ulp_line(ax)
    style.legend_below(fig)
    fig.caption = (
        "Largest relative error so far of H, J3, |x|² and x·J, for the same map in two forms, from the data of the paper's "
        "Figures 1 (left) and 2 (right). The program divides by "
        "numbers that nearly vanish; the real form has no pole; pinned, it is moved back onto its invariants every eighth "
        "step. The grey line is one ulp."
    )
    return fig


tables = tabulated(invariants)
draw = drawn(figures=_draw_orbits, invariants=_draw_drift)

if __name__ == "__main__":
    script.run("paper")
