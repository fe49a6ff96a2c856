"""The paper's two figures, by its own program and by the real form of its map; and the exact step of n spins.

Figure 1 of Kuznetsov, Petrera and Ragnisco iterates the two-point map with λ = 0.02i a thousand times, Figure 2 with
λ = 500 + 5000i four thousand times. The paper's MATLAB program divides complex numbers. The real form has no poles. Both start
here from the same data, and the changes of H, J3, |x|² and x·J are measured.

Part “magnet” tests the exact step of the Gaudin magnet on random magnets: one step of 5 to 80 units of time, against the
reference solution of n spins. A unit is 1/√(Σ A_k² |s_k|²), with A_k the couplings of the site that moves.
"""

import math
from itertools import product
from random import Random

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.reductions import largest, worst
from lagrange_bench.experiments.measuring.states import find, options_of, rounded
from lagrange_bench.integrators import GaudinMagnet, prepare
from lagrange_bench.integrators.interface import INVARIANTS, Array
from lagrange_bench.integrators.truth import truths

VERSION = 1
MEASURED = {"": ("n", *INVARIANTS), "magnet": ("error",)}

FIGURES: dict[int, dict] = {
    1: {"state": "figure1", "re": 0.0, "im": 0.02, "steps": 1000},
    2: {"state": "figure2", "re": 500.0, "im": 5000.0, "steps": 4000},
}
FORMS = {  # name in tables: method, its options
    "real form": ("backlund", {"pin": 0}),
    "real form, pinned": ("backlund", {"pin": 8}),
    "paper's program": ("backlund_textbook", {}),
}

UNITS = (5.0, 20.0, 80.0)  # lengths of steps, in units of time
SPINS, SEEDS = {"quick": (2, 3), "full": range(2, 9)}, {"quick": range(1), "full": range(10)}


def cells(profile: str) -> list[dict]:
    figures = [
        {"figure": figure, "form": form, "method": method, **run, **options}
        for figure, run in FIGURES.items()
        for form, (method, options) in FORMS.items()
    ]
    magnets = product(SPINS[profile], UNITS, SEEDS[profile])
    return figures + [{"part": "magnet", "spins": n, "units": units, "seed": seed} for n, units, seed in magnets]


def measure(cell: dict) -> list[dict]:
    return _magnet(cell) if cell.get("part") == "magnet" else _figure(cell)


def random_magnet(n: int, seed: int) -> tuple[GaudinMagnet, Array]:
    """A magnet and its spins (n, 3) of lengths 0.2 to 1.5. Sites are 0.3 to 1 apart; any of them may be the moving one."""
    draw = Random(f"magnet{n}/{seed}")
    sites = np.cumsum([draw.uniform(0.3, 1.0) for _ in range(n)]).tolist()
    draw.shuffle(sites)
    spins = np.array([[draw.gauss(0.0, 1.0) for _ in range(3)] for _ in range(n)])
    spins *= [[draw.uniform(0.2, 1.5) / math.hypot(*spin)] for spin in spins]
    return GaudinMagnet(tuple(sites), draw.choice((-1, 1)) * draw.uniform(0.2, 1.5)), spins


def _magnet(cell: dict) -> list[dict]:
    magnet, spins = random_magnet(cell["spins"], cell["seed"])
    h = cell["units"] / float(np.linalg.norm(magnet.couplings[0] * np.linalg.norm(spins, axis=1)))
    true = truths.solution(magnet.problem(), spins.ravel(), [h], longest=math.inf)
    return [{"error": rounded(np.max(np.abs(magnet.exact_step(spins, h).ravel() - true)))}]


def _figure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    stepper = prepare(top, y0, 1.0, cell["method"], lam=complex(cell["re"], cell["im"]), **options_of(cell))
    y = stepper.record(y0, cell["steps"], 1)
    drift = metrics.relative_drift(top.invariants(y), top.invariant_scales(y0))
    axis = range(3 if cell["form"] == "real form" else 0)  # the orbit is drawn once
    columns = {"n": range(len(y)), **{f"x{i + 1}": [rounded(x, 6) for x in y[:, 3 + i]] for i in axis}}
    columns |= {name: [rounded(error) for error in drift[:, i]] for i, name in enumerate(INVARIANTS)}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


# ---------------------------------------------------------------- tables and figures


TITLES = {1: "steps close together, λ = 0.02i", 2: "steps far apart, λ = 500 + 5000i"}
LOOKS = {"real form": "backlund", "real form, pinned": "backlund_paper", "paper's program": "backlund_textbook"}


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


tables = tabulated(invariants)
draw = drawn(figures=_draw_orbits, invariants=_draw_drift)
