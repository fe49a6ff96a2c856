"""Ensembles: what does the exact step cost among many tops, each with its own alpha, torus and λ(h), and what do its rivals?

The rivals are heyoka in batch mode, and splittings and a Runge-Kutta formula, one top after another. (In SIMD lanes, which the
bench once had for them, they took 0.1 to 0.4 of this time.) All cover the same time with tops of the same kind. Nanoseconds per
top and unit of time, with set-up, are shown against the error. Times are in the units
of the tops: alpha in [0.3, 2], each J in [−2, 2], |x| in [0.5, 2].
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.states import options_of, rounded, truth
from lagrange_bench.integrators import METHODS, LagrangeTop, StepError, integrate_ensemble
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.taylor import equations

VERSION = 3
MEASURED = {"rival": ("us_per_top", "ns_per_time", "error", "largest_error")}

RIVALS = {"numba": 128, "heyoka": 64}  # how many tops, by engine
JUDGED = 8  # errors are measured on the first so many tops
SPAN = 10_000.0  # length of the rivals' runs
TRIED: dict[str, dict[str, tuple[float, ...]]] = {
    "quick": {"backlund": (1.0,), "taylor": (2.3e-16,), "blanes_moan6": (0.2,)},
    "full": {
        "backlund": (0.1, 0.25, 1.0, 4.0),
        "taylor": (1e-3, 1e-6, 1e-9, 1e-12, 2.3e-16),
        "force_gradient4": (0.05, 0.1, 0.2),
        "force_gradient6": (0.05, 0.1, 0.2),
        "blanes_moan6": (0.05, 0.1, 0.2, 0.5),
        "kahan_li8": (0.05, 0.1, 0.2, 0.4),
        "verner9_fixed": (0.05, 0.1, 0.2, 0.4),
    },
}


def cells(profile: str) -> list[dict]:
    all_cells: list[dict] = []
    for method, values in TRIED[profile].items():
        tops = RIVALS[METHODS[method].engine]
        run = {"part": "rival", "method": method, "tops": tops, "span": SPAN}
        all_cells += [{"timing": True, **run, METHODS[method].accuracy_option: value} for value in values]
    return all_cells


def alphas_and_states(n: int) -> tuple[Array, Array]:
    """alpha (n,) and states (n, 6) of n tops, the same ones every time."""
    generator = np.random.default_rng(20040328)
    Y = generator.uniform(-2, 2, (n, 6))
    Y[:, 3:] *= (generator.uniform(0.5, 2, n) / np.linalg.norm(Y[:, 3:], axis=1))[:, None]
    return generator.uniform(0.3, 2, n), Y


def follow_in_batches(alphas: Array, Y: Array, span: float, tol: float) -> Callable[[], Array]:
    """Make a function that follows the tops in heyoka's batch mode: one top in each SIMD lane, with its own steps."""
    import heyoka as hy

    width = hy.recommended_simd_size()
    batch = hy.taylor_adaptive_batch(equations(), np.ones((6, width)), tol=tol, compact_mode=False)

    def run() -> Array:
        end = np.empty_like(Y)
        for first in range(0, len(Y), width):
            places = np.minimum(np.arange(first, first + width), len(Y) - 1)  # the last top fills free lanes
            batch.set_time(0.0)
            batch.pars[:], batch.state[:] = alphas[places], Y[places].T
            batch.propagate_until(np.full(width, span))
            if any(result[0] != hy.taylor_outcome.time_limit for result in batch.propagate_res):
                raise StepError("taylor", f"heyoka: {batch.propagate_res}")
            end[first : first + width] = batch.state.T[: len(Y) - first]
        return end

    return run


def measure(cell: dict) -> list[dict]:
    """The cost on one core, and errors of the first JUDGED tops."""
    alphas, Y = alphas_and_states(cell["tops"])
    span, h = cell["span"], cell.get("h", cell["span"])
    steps, options = round(span / h), options_of(cell)
    top, method = LagrangeTop(alphas), METHODS[cell["method"]]

    def run() -> Any:
        return integrate_ensemble(top, Y, span / steps, steps, cell["method"], threads=1, **options).y[-1]

    if method.name == "taylor":
        run = follow_in_batches(alphas, Y, span, **options)
    end, errors = run(), []
    for alpha, y0, y in list(zip(alphas, Y, end, strict=True))[:JUDGED]:
        one = LagrangeTop(alpha)
        errors.append(float(metrics.scaled_error(one, y0, y, truth(one, y0, method, span / steps, [steps])[0])))
    per_top = timing.time_call(run, repeats=3).min() / len(Y)
    row = {"error": np.median(errors), "largest_error": max(errors)}
    row |= {"us_per_top": per_top * 1e6, "ns_per_time": per_top / span * 1e9}
    return [{name: rounded(float(value)) for name, value in row.items()}]


@of_part("rival")
def _draw_rivals(runs: pd.DataFrame, style):
    fig, ax = style.figure("page", 3.4)
    for method in style.ordered(runs.method):
        chosen = runs[runs.method == method].sort_values([name for name in ("h", "tol") if name in runs])
        ax.loglog(chosen.ns_per_time, chosen.error.clip(lower=1e-17), **style.of(method))
    ax.set(xlabel="ns for a top and a unit of time")
    ax.set(ylabel=f"error at the end, median of {JUDGED} tops")
    style.legend_below(fig)
    fig.caption = (
        "Many tops over the same time on one core: the exact step and heyoka's batch mode, in SIMD lanes, and the fixed steps of "
        f"others, one top after another. The runs are t = {show(float(runs.span.iloc[0]))} long. Along a line "
        "the step or, for heyoka, the tolerance changes."
    )
    return fig


tables = tabulated()
draw = drawn(rivals=_draw_rivals)
