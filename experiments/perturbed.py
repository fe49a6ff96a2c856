"""Perturbed top: what is the exact step worth where the top is not integrable?

A potential ε alpha x1²/(2|x|) breaks the symmetry about the vertical: there is no torus, no λ(h) for good, and no exact
step. What is left of it is a flow to split with: half a kick by the perturbation, the exact flow of the unperturbed top
over h, half a kick, with an error of ε h² (“exact, order 2”), or the composition of Laskar and Robutel with five flows
and an error of ε h⁸ + ε² h² (“exact, SABA4”). Since a kick leaves the torus, every flow needs its λ(h) anew. Their
rivals split off the rotation by J instead and do not care what the potential is: order 2, and order 6 of Kahan and Li.
Times are in units of 1/(|J| + √(|alpha||x|)).

What is compared is the error at equal steps, not the time. The wall times in the rows compare nothing: the splittings
with the exact flow run in the interpreter, through `prepare` at every flow, and their rivals are compiled whole.

Source: Laskar & Robutel, Celest. Mech. Dyn. Astron. 80 (2001) 39; Kahan & Li, Math. Comp. 66 (1997) 1089.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from experiments import engine, metrics, timing
from experiments.states import find, rounded
from integrators import prepare
from integrators.compiled import compiled
from integrators.interface import Array, StepError
from integrators.top import LagrangeTop

VERSION = 1

STATE = "generic"
SPAN = 32.0
SIZES = {"quick": (1e-4, 1e-1), "full": (1e-6, 1e-4, 1e-2, 1.0)}  # ε
EXACT = ("exact, order 2", "exact, SABA4")
ROTATION = ("rotation, order 2", "rotation, order 6")
STEPS = {  # exact flows, rotations
    "quick": ((4.0, 1.0, 0.25), (0.5, 0.125, 2.0**-5, 2.0**-7)),
    "full": (tuple(2.0**-k for k in range(-2, 4)), tuple(2.0**-k for k in range(12))),
}

_ROOT = math.sqrt(30)
_OUTER, _INNER = math.sqrt(525 + 70 * _ROOT), math.sqrt(525 - 70 * _ROOT)
# (flow, kick, flow, …, flow), fractions of h
SCHEMES = {
    "exact, order 2": ((0.0, 1.0, 0.0), (0.5, 0.5)),
    "exact, SABA4": (
        (0.5 - _OUTER / 70, (_OUTER - _INNER) / 70, _INNER / 35, (_OUTER - _INNER) / 70, 0.5 - _OUTER / 70),
        (0.25 - _ROOT / 72, 0.25 + _ROOT / 72, 0.25 + _ROOT / 72, 0.25 - _ROOT / 72),
    ),
}
WEIGHTS = {  # of the steps of order 2 in a symmetric composition, up to the middle one
    "rotation, order 2": (1.0,),
    "rotation, order 6": (
        0.39216144400731413928,
        0.33259913678935943860,
        -0.70624617255763935981,
        0.08221359629355080023,
        0.79854399093482996340,
    ),
}


def cells(profile: str) -> list[dict]:
    listed = []
    for eps in SIZES[profile]:
        for variants, steps in zip((EXACT, ROTATION), STEPS[profile], strict=True):
            for variant in variants:
                listed += [{"timing": True, "eps": eps, "variant": variant, "h": h} for h in steps]
    return listed


def measure(cell: dict) -> list[dict]:
    top, y0 = find(STATE)
    unit = top.scales(y0)[2]
    strength = cell["eps"] * top.alpha / float(np.linalg.norm(y0[3:]))
    n = round(SPAN / cell["h"])
    run = exact_run if cell["variant"] in EXACT else rotation_run
    advance = run(top, strength, cell["h"] * unit, n, cell["variant"])
    advance(y0)  # compiles
    y = advance(y0)
    error = metrics.scaled_error(top, y0, y, reference(cell["eps"]))
    seconds = timing.time_call(lambda: advance(y0), min_time=0.002, repeats=3).min
    return [{"error": rounded(float(error)), "seconds": rounded(seconds), "us_per_step": rounded(seconds / n * 1e6)}]


def kick(y: Array, strength: float, h: float) -> Array:
    """J' = ∇V × x for the perturbation V = strength x1²/2; x stays."""
    push = h * strength * y[3]
    return np.array((y[0], y[1] - push * y[5], y[2] + push * y[4], y[3], y[4], y[5]))


def exact_run(top: LagrangeTop, strength: float, h: float, n: int, variant: str) -> Callable[[Array], Array]:
    """n steps of kicks and exact flows of the unperturbed top, each a Bäcklund step of its own torus."""
    flows, kicks = SCHEMES[variant]

    def advance(y: Array) -> Array:
        for _ in range(n):
            for i, part in enumerate(flows):
                if part:
                    y = prepare(top, y, part * h, "backlund").advance(y, 1)
                if i < len(kicks):
                    y = kick(y, strength, kicks[i] * h)
        return y

    return advance


@cache
def _rotations() -> Callable:
    """The compiled rival: half a kick by the whole potential, rotation of x about J, half a kick; composed."""

    @compiled
    def run(y, alpha, strength, h, n, weights):
        J1, J2, J3, x1, x2, x3 = y
        for _ in range(n):
            for w in weights:
                half = 0.5 * w * h
                J1, J2, J3 = (
                    J1 - half * alpha * x2,
                    J2 + half * (alpha * x1 - strength * x1 * x3),
                    J3 + half * strength * x1 * x2,
                )
                size = math.sqrt(J1 * J1 + J2 * J2 + J3 * J3)
                angle = 0.5 * w * h * size
                s = math.sin(angle) / size if size else w * half
                a, b = 2 * s * math.cos(angle), 2 * s * s
                d1, d2, d3 = J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1
                x1, x2, x3 = (
                    x1 + a * d1 + b * (J2 * d3 - J3 * d2),
                    x2 + a * d2 + b * (J3 * d1 - J1 * d3),
                    x3 + a * d3 + b * (J1 * d2 - J2 * d1),
                )
                J1, J2, J3 = (
                    J1 - half * alpha * x2,
                    J2 + half * (alpha * x1 - strength * x1 * x3),
                    J3 + half * strength * x1 * x2,
                )
        return J1, J2, J3, x1, x2, x3

    return run


def rotation_run(top: LagrangeTop, strength: float, h: float, n: int, variant: str) -> Callable[[Array], Array]:
    """n compiled steps of a symmetric composition of kicks and rotations."""
    half = WEIGHTS[variant]
    weights = np.array((*half[:-1], *half[::-1]))
    run = _rotations()
    return lambda y: np.array(run(y, top.alpha, strength, h, n, weights))


@cache
def reference(eps: float) -> Array:
    """The end of the run by SciPy's DOP853 at its tightest, good to about 1e-13 here; no method of the comparison."""
    top, y0 = find(STATE)
    strength = eps * top.alpha / float(np.linalg.norm(y0[3:]))

    def rhs(_: float, y: Array) -> Array:
        rate: Array = top.rhs(y)
        rate[1] -= strength * y[3] * y[5]
        rate[2] += strength * y[3] * y[4]
        return rate

    found = solve_ivp(rhs, (0, SPAN * top.scales(y0)[2]), y0, method="DOP853", rtol=3e-14, atol=1e-15)
    if not found.success:
        raise StepError("DOP853", found.message)
    end: Array = found.y[:, -1]
    return end


# ------------------------------------------------------------------------------------------ what the rows say

TARGETS = (1e-4, 1e-6, 1e-8, 1e-10)


def longest_steps(rows: pd.DataFrame) -> pd.DataFrame:
    """For each ε and error the longest step of each variant that reaches it; empty where none does."""
    good = rows[rows.status == "done"]
    table = []
    for eps, group in good.groupby("eps", sort=False):
        for target in TARGETS:
            steps = group[group.error <= target].groupby("variant").h.max()
            table.append({"ε": eps, "error at most": target, **steps.reindex([*EXACT, *ROTATION])})
    return pd.DataFrame(table)


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    table = longest_steps(rows)
    table.attrs["caption"] = f"Longest step that reaches an error at t = {SPAN:g}, with exact flows and without"
    return {"steps": table} if len(table) else {}


def draw(rows: pd.DataFrame) -> dict:
    from report import style
    from report.tables import show

    good = rows[rows.status == "done"]
    if good.empty:
        return {}
    sizes = list(dict.fromkeys(good.eps))
    columns = min(len(sizes), 2)
    shape = {"nrows": -(-len(sizes) // columns), "ncols": columns, "sharex": True, "sharey": True, "squeeze": False}
    fig, grid = style.figure("page", 0.5 + 2.1 * shape["nrows"], **shape)
    blue, orange = style.FAMILIES["backlund"], style.FAMILIES["splitting"]
    looks = dict(zip((*EXACT, *ROTATION), ((blue, 0), (blue, 1), (orange, 0), (orange, 1)), strict=True))
    for ax, eps in zip(grid.flat, sizes, strict=False):
        for variant, ((colours, markers), place) in looks.items():
            run = good[(good.eps == eps) & (good.variant == variant)].sort_values("h")
            look = {"color": colours[place], "marker": markers[place], "linestyle": style.DASHES[place]}
            if not run.empty:
                ax.loglog(run.h, run.error.clip(lower=1e-15), **look, label=variant)
        ax.set_title(f"ε = {show(eps)}")
        ax.set_ylim(3e-16, 10)
    for ax in grid.flat[len(sizes) :]:
        ax.remove()
    for ax in grid[-1]:
        ax.set_xlabel("step h")
    for ax in grid[:, 0]:
        ax.set_ylabel(f"error at t = {SPAN:g}")
    style.legend_below(fig)
    fig.caption = (
        "A top in a potential that breaks its symmetry: error against step, for splittings with the exact flow of the "
        "symmetric top and kicks by the perturbation, and for splittings with a rotation and kicks by the whole potential. "
        "The smaller ε is, the longer the steps with the exact flow may be. A step of order 2 has one flow or rotation, one "
        "of SABA4 five, one of order 6 nine. Times are not compared: the exact flows run in the interpreter here, the "
        "rotations are compiled."
    )
    return {"h": fig}


if __name__ == "__main__":
    raise SystemExit(engine.main("perturbed"))
