"""Gaudin magnet: how long do a central spin and its bath keep their conservation laws, and at what price?

One spin in a field couples to n − 1 others with strengths that fall off, the central-spin model: the flow of H_1 of
the magnet the top comes from. It is followed by two-point Bäcklund maps and by heyoka. One map with the paper's time
step is of order two; k maps at the roots of a Padé approximant are of order 2k; half as many maps as spins, with
parameters fitted to the torus, are exact. Relative errors of the spins |s_j| and of all the H_j against time, of the
whole state against the step, and what a step costs. Times are in units of 1/√(Σ A_k²), A_k the couplings.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from experiments import script
from experiments.drawing.tables import captioned
from experiments.measuring import metrics, timing
from experiments.measuring.states import log_counts, rounded
from integrators.interface import Array, StepError
from integrators.paper import gaudin_step
from integrators.paper.gaudin_model import GaudinMagnet

VERSION = 1

SIZES = (2, 3, 8, 32)
STEP = {"order 2": 0.25, "exact": 2.0, "taylor": 2.0}  # of the runs against time; for heyoka only between outputs
SPAN_LONG = {"quick": 2.0**11, "full": 2.0**18}
SWEPT = 8  # size of the magnet of the runs against the step
SPAN = 8.0  # and their length
SWEEP = {"quick": (0.125, 0.25, 0.5, 1.0, 2.0), "full": tuple(2.0 ** (-k / 2) for k in range(-4, 15))}
ORDERS = (2, 4, 6, 8)
ROUNDS = {"quick": 1, "full": 3}


def cells(profile: str) -> list[dict]:
    listed: list[dict] = []
    for n in SIZES:
        for variant, h in STEP.items():
            steps = round(SPAN_LONG[profile] / h)
            listed.append({"part": "time", "n": n, "variant": variant, "h": h, "steps": steps})
    for variant in (*(f"order {p}" for p in ORDERS), "exact"):
        listed += [{"part": "h", "n": SWEPT, "variant": variant, "h": h} for h in SWEEP[profile]]
    for round_ in range(ROUNDS[profile]):
        for n in SIZES:
            for variant in STEP:
                listed.append({"part": "cost", "n": n, "variant": variant, "round": round_, "timing": True})
    return [{"method": _method(cell["variant"]), **cell} for cell in listed]


def _method(variant: str) -> str:
    """The method of the top that a variant goes with: what it needs to be installed, and its colour."""
    return {"exact": "backlund", "taylor": "taylor"}.get(variant, "backlund_paper")


def central_spin(n: int) -> tuple[GaudinMagnet, Array]:
    """Unit spins in random directions, couplings A_k = 2/(a_1 − a_k) ~ exp(−2k/n) with Σ A_k² = 1, field 2 alpha = 1.

    The generator is Python's own, whose `random()` never changes.
    """
    couplings = [math.exp(-2 * k / n) for k in range(1, n)]
    size = math.sqrt(math.fsum(A * A for A in couplings))
    draw = random.Random(f"gaudin{n}")
    spins = []
    for _ in range(n):
        z, phi = draw.uniform(-1, 1), draw.uniform(0, 2 * math.pi)
        r = math.sqrt(1 - z * z)
        spins.append((r * math.cos(phi), r * math.sin(phi), z))
    return GaudinMagnet((0.0, *(-2 * size / A for A in couplings)), 0.5), np.array(spins)


def measure(cell: dict) -> list[dict]:
    return {"time": _measure_time, "h": _measure_h, "cost": _measure_cost}[cell["part"]](cell)


def _stepper(magnet: GaudinMagnet, spins: Array, variant: str, h: float) -> gaudin_step.MagnetStepper:
    if variant == "exact":
        return gaudin_step.prepare(magnet, spins, h, None, exact=True)
    return gaudin_step.prepare(magnet, spins, h, int(variant.removeprefix("order ")) // 2)


def _measure_time(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    counts = log_counts(cell["steps"], per_octave=4)
    times = cell["h"] * np.array(counts, dtype=float)
    if cell["variant"] == "taylor":
        states = heyoka(magnet, spins)[0](times)
    else:
        stepper = _stepper(magnet, spins, cell["variant"], cell["h"])
        states, s, done = np.empty((len(counts), *spins.shape)), spins, 0
        for i, count in enumerate(counts):
            s = states[i] = stepper.advance(s, count - done)
            done = count
    rows = []
    for t, state in zip(times, states, strict=True):
        lengths = np.sqrt(magnet.casimirs(state) / magnet.casimirs(spins)) - 1
        energies = (magnet.hamiltonians(state) - magnet.hamiltonians(spins)) / magnet.hamiltonian_scales(spins)
        errors = {"spins": rounded(np.max(np.abs(lengths))), "hamiltonians": rounded(np.max(np.abs(energies)))}
        rows.append({"t": rounded(t), **errors})
    return rows


def _measure_h(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    steps = round(SPAN / cell["h"])
    stepper = _stepper(magnet, spins, cell["variant"], SPAN / steps)
    error = np.max(np.abs(stepper.advance(spins, steps) - reference(magnet, spins, SPAN)))
    return [{"error": rounded(error), "maps": len(stepper.lams)}]


def reference(magnet: GaudinMagnet, spins: Array, t: float) -> Array:
    """The flow of H_1 by SciPy's DOP853 at its tightest, good to about 1e-13 here; no method of the comparison."""
    from scipy.integrate import solve_ivp

    c = np.eye(len(magnet))[0]

    def rhs(_: float, y: Array) -> Array:
        rate: Array = magnet.rhs(y.reshape(-1, 3), c).ravel()
        return rate

    found = solve_ivp(rhs, (0, t), spins.ravel(), method="DOP853", rtol=3e-14, atol=1e-15)
    if not found.success:
        raise StepError("DOP853", found.message)
    end: Array = found.y[:, -1].reshape(-1, 3)
    return end


def heyoka(magnet: GaudinMagnet, spins: Array) -> tuple[Callable[[Array], Array], Callable[[float], int]]:
    """heyoka on its natural steps: times → states by dense output, and t → the number of steps it took."""
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    n = len(magnet)
    s = [hy.make_vars(*(f"s{j}_{i}" for i in "123")) for j in range(n)]
    couplings = [2 / (magnet.sites[0] - a) for a in magnet.sites[1:]]
    field = [hy.sum([A * s_k[i] for A, s_k in zip(couplings, s[1:], strict=True)]) for i in range(3)]
    field[2] = field[2] + 2 * magnet.alpha
    system = []
    for j, (x, y, z) in enumerate(s):
        a, b, c = field if j == 0 else [couplings[j - 1] * s[0][i] for i in range(3)]
        system += [(x, b * z - c * y), (y, c * x - a * z), (z, a * y - b * x)]
    ta = hy.taylor_adaptive(system, list(spins.ravel()), compact_mode=n > 8)

    def restart() -> None:
        ta.time = 0.0
        ta.state[:] = spins.ravel()

    def states(times: Array) -> Array:
        restart()
        outcome, *_, rows = ta.propagate_grid([0.0, *times])
        _check(outcome, hy)
        found: Array = rows[1:].reshape(-1, n, 3)
        return found

    def steps(t: float) -> int:
        restart()
        outcome, _, _, count, *_ = ta.propagate_until(t)
        _check(outcome, hy)
        return int(count)

    return states, steps


def _check(outcome: Any, hy: Any) -> None:
    if outcome != hy.taylor_outcome.time_limit:
        raise StepError("taylor", f"heyoka stopped: {outcome}")


def _measure_cost(cell: dict) -> list[dict]:
    magnet, spins = central_spin(cell["n"])
    n, variant = cell["n"], cell["variant"]
    if variant == "taylor":
        run, span = heyoka(magnet, spins)[1], 200.0
        steps, maps = run(span), 0
        timed = timing.time_call(lambda: run(span), repeats=5)
        h = span / steps
    else:
        h = STEP[variant]
        stepper = _stepper(magnet, spins, variant, h)
        maps = len(stepper.lams)
        steps = 4 * 10**6 // (n * maps)
        timed = timing.time_call(lambda: stepper.advance(spins, steps), repeats=5)
    ns = timed.min / steps * 1e9
    row = {"h": rounded(h), "maps": maps, "ns_per_step": rounded(ns), "ns_per_time": rounded(ns / h)}
    if maps:
        row["ns_per_spin_and_map"] = rounded(ns / (n * maps))
    return [{**row, "unstable": timed.unstable}]


# ------------------------------------------------------------------------------------------ what the rows say


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    good = rows[rows.status == "done"]
    found = {}
    timed = good[good.part == "time"]
    if not timed.empty:
        worst = timed.groupby(["n", "variant"], sort=False)[["spins", "hamiltonians"]].max().reset_index()
        worst.insert(2, "length of run", timed.groupby(["n", "variant"], sort=False).t.max().to_numpy())
        found["drift"] = worst
    swept = good[good.part == "h"]
    if not swept.empty:
        found["orders"] = orders(swept)
    cost = good[good.part == "cost"]
    if not cost.empty:
        columns = ["h", "maps", "ns_per_step", "ns_per_spin_and_map", "ns_per_time"]
        columns = [name for name in columns if name in cost]
        found["cost"] = cost.groupby(["n", "variant"], sort=False)[columns].min().reset_index()
    captions = {
        "drift": "Gaudin magnets of n spins: the largest relative error of the lengths of the spins and of the Hamiltonians",
        "orders": "Order of each variant, as the slope of the error against the step, with its standard error (±)",
        "cost": "Gaudin magnets of n spins: nanoseconds per step, per spin and map, and per unit of time",
    }
    return captioned(found, captions)


def orders(rows: pd.DataFrame) -> pd.DataFrame:
    """Measured order of each variant from the whole error against the step."""
    table = []
    for variant, group in rows.groupby("variant", sort=False):
        fit = metrics.order(group.h, group.error, floor=1e-13)
        maps = int(group.maps.iloc[0])
        smallest = float(group.error.min())
        table.append({"variant": variant, "maps": maps, "order": fit.p, "±": fit.stderr, "smallest error": smallest})
    return pd.DataFrame(table)


def draw(rows: pd.DataFrame) -> dict:
    from experiments.drawing import style

    figures = {}
    if (rows.part == "time").any():
        figures["time"] = _draw_time(rows[rows.part == "time"], style)
    if (rows.part == "h").any():
        figures["h"] = _draw_h(rows[rows.part == "h"], style)
    return figures


LABELS = {"exact": "Bäcklund, exact", "taylor": "heyoka", **{f"order {p}": f"Bäcklund, order {p}" for p in ORDERS}}


SHADES = {"order 4": ("#7D9BD1", "s", 1), "order 6": ("#3F93CF", "h", 3), "order 8": ("#0F5C80", "^", 0)}


def _look(style, variant: str) -> dict:
    look = {**style.of(_method(variant)), "label": LABELS[variant]}
    if variant in SHADES:
        colour, marker, dash = SHADES[variant]
        look |= {"color": colour, "marker": marker, "linestyle": style.DASHES[dash]}
    return look


def _draw_time(rows: pd.DataFrame, style):
    quantities = {"hamiltonians": "$H_j$", "spins": "$|s_j|$"}
    panels = [(name, n) for name in quantities for n in sorted(set(rows.n))]
    columns = len(panels) // 2 if style.width() == "page" else 2
    height = 0.4 + 1.75 * len(panels) / columns
    size = {"nrows": len(panels) // columns, "ncols": columns, "sharex": True, "sharey": True, "squeeze": False}
    fig, grid = style.figure(style.width(), height, **size)
    for ax, (name, n) in zip(grid.flat, panels, strict=True):
        for variant in dict.fromkeys(rows.variant):
            chosen = rows[(rows.n == n) & (rows.variant == variant) & (rows.status == "done")]
            if not chosen.empty:
                t, error = metrics.block_maxima(chosen.t, chosen[name])
                ax.loglog(t, np.maximum(error, 2.0**-54), **{**_look(style, variant), "marker": "none"})
        ax.set_title(f"{quantities[name]}, n = {n}")
        ax.axhline(2.0**-52, color=style.FAINT, linewidth=0.6)
    for ax in grid[-1]:
        ax.set_xlabel("time")
    for ax in grid[:, 0]:
        ax.set_ylabel("largest relative error")
    style.legend_below(fig)
    fig.caption = (
        "Relative errors of all the Hamiltonians and of all the spin lengths of a central-spin magnet with n spins, "
        f"maxima over blocks of time. Steps of {STEP['order 2']:g} (order 2) and {STEP['exact']:g} (exact), heyoka on "
        "its own. The grey line is one ulp; errors below a quarter of it are drawn there."
    )
    return fig


def _draw_h(rows: pd.DataFrame, style):
    fig, ax = style.figure("column", 3.0)
    for variant in dict.fromkeys(rows.variant):
        chosen = rows[(rows.variant == variant) & (rows.status == "done")].sort_values("h")
        if not chosen.empty:
            ax.loglog(chosen.h, chosen.error.clip(lower=1e-16), **_look(style, variant))
    ticks = sorted({2.0 ** round(math.log2(h)) for h in rows.h})[:: 2 if len(set(rows.h)) > 6 else 1]
    ax.set_xticks(ticks, [f"{h:g}" if h >= 1 else f"1/{1 / h:g}" for h in ticks])
    ax.minorticks_off()
    ax.set_xlabel("step")
    ax.set_ylabel(f"largest error at t = {SPAN:g}")
    style.legend_below(fig)
    fig.caption = (
        f"Largest error of a spin component at t = {SPAN:g} against the step, n = {SWEPT}: k maps to a step have order "
        "2k, fitted to the torus they have no error in time. The floor is round-off, that of the reference (DOP853) included."
    )
    return fig


if __name__ == "__main__":
    script.run("gaudin")
