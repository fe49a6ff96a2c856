"""Tables and figures of the experiment `engines`."""

import re
from collections.abc import Iterable
from itertools import product

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.engines.programs import BEST, DEFAULT, ENGINES, OURS, UNTIL, WORDS
from lagrange_bench.experiments.heavy_top import measured_orders

SHOWN = 1 / 1024  # s, the step whose errors tables show beside the smallest step
FOLLOWED = ("position", "rotation", "spin", "until", "precision", "turns_over")  # columns of rows without times
ORDERS_APART = 1e3  # errors of engines at the same step that differ by more are worth a headline
OVERVIEW = {"1/60 s": 1 / 60, "1/1024 s": 1 / 1024}  # steps, s
# one engine of each family of results, and two that run on graphics cards
KNOWN = ("MuJoCo", "MJX", "Newton", "Simbody", "PhysX", "Jolt", "Havok", "Rapier", "Bullet (ammo.js)")


def title(name: str, version: str) -> str:
    """An engine with its version, and with the package's, where that has another name."""
    engine = ENGINES.get(name)
    release = name.rstrip("0123456789. ")  # "MuJoCo 3.10" is a release of MuJoCo
    letters = (re.sub("[^a-z]", "", text.lower()) for text in (name, engine.package if engine else name))
    if engine is None or len(set(letters)) == 1:
        return f"{release} {version}"
    return " ".join(filter(None, (name, engine.engine, f"({engine.package} {version})")))


def runs(rows: pd.DataFrame, sweep: bool = True) -> pd.DataFrame:
    """The rows of the sweep, or the other rows, with the name of the integrator or method, and the seconds of a run."""
    wanted = ("timing", "integrator", "method", "setting", "ns_per_step", *FOLLOWED)
    rows = rows.reindex(columns=list(dict.fromkeys((*rows.columns, *wanted))))
    rows = rows[rows.timing.eq(True) == sweep]
    named = rows.integrator.astype(object).fillna(rows.method)
    seconds = rows.ns_per_step * 1e-9 * UNTIL / rows.h
    return rows.assign(integrator=named, setting=rows.setting.astype(object).fillna(""), seconds=seconds)


def overview(rows: pd.DataFrame, engines: Iterable[str] = KNOWN) -> pd.DataFrame:
    """How well engines follow `slow`, by default and as their documents advise.

    Parameters
    ----------
    rows : DataFrame
        As stored, of the experiment `engines`.
    engines : iterable of str
        Names in ENGINES.

    Returns
    -------
    DataFrame
        A line for each engine and setting. `engine`: with its version. `setting`: with the integrator, and with a reason where
        the advice is worse than the default. "1/60 s", "1/1024 s": the error of the centre of mass after 2 s with these steps,
        m (NaN: it gave up, or was not measured). `until`: how long it is within 10 cm with steps of 1/60 s, s. `limit`: the
        motion that smaller steps lead to.
    """
    good = runs(rows[rows.status == "done"], sweep=False)
    lines = []
    for name in engines:
        chosen = good[(good.engine == name) & good.setting.isin((DEFAULT, BEST))]
        least = np.inf  # error of the default with the smaller step
        for kind, group in chosen.groupby("integrator", sort=False):
            slow = group[group.case == "slow"].set_index("h").sort_index(ascending=False)
            if slow.empty:
                continue
            errors = {step: slow.position.get(h, np.nan) for step, h in OVERVIEW.items()}
            setting = in_words(name, kind, slow.setting.iloc[-1], errors["1/1024 s"] > least)
            least = min(least, errors["1/1024 s"])
            line = {"engine": title(name, slow.version.iloc[-1]), "setting": setting, **errors}
            lines.append({**line, "until": slow.until.get(1 / 60, np.nan), "limit": limit(group)})
    return pd.DataFrame(lines, columns=["engine", "setting", *OVERVIEW, "until", "limit"])


def in_words(name: str, kind: str, setting: str, is_worse: bool = False) -> str:
    """A setting and an integrator of an engine, as tables show them; is_worse : than the default."""
    words = WORDS[setting] if kind == setting else f"{WORDS[setting]}: {kind}"
    return f"{words} ({ENGINES[name].worse})" if is_worse and ENGINES[name].worse else words


LOST_SPIN = 0.05  # rad/s: damping takes more of the spin of `slow`
FALLS = 1.5  # errors fall if the smallest step makes them at least this many times smaller than the next step
TINY = 1e-6  # m: smaller errors need not fall
TURN = 10.0  # rad, half the turn of `slow`: a relative error of ω that grows evenly to e turns the body by TURN · e


def limit(group: pd.DataFrame) -> str:
    """The motion to which the runs of one integrator tend as the steps get smaller, in words.

    Without gyroscopic torque `racket` never turns over. Damping and caps take spin, and smaller steps do not give it back.
    Otherwise the error of `slow` falls to the end, or stays below the round-off of one ulp of ω a step, all one way.
    """
    finest = {case: runs.sort_values("h").iloc[:2] for case, runs in group.groupby("case")}
    slow, racket = finest["slow"], finest.get("racket", group[:0])
    if len(slow) < 2:
        return ""
    never = len(racket) > 0 and racket.turns_over.isna().all()
    lost, error = -slow.spin.to_numpy(), slow.position.to_numpy()
    damped = lost[0] > LOST_SPIN and lost[0] > lost[1] / 2
    if causes := [cause for cause, is_so in (("no gyroscopic torque", never), ("damping", damped)) if is_so]:
        return f"another motion: {', '.join(causes)}"
    if error[0] < error[1] / FALLS or error[0] < TINY:
        return "the exact motion"
    round_off = TURN * np.finfo(slow.precision.iloc[0]).eps * UNTIL / slow.h.iloc[0]
    if error[0] < round_off:
        return "the exact motion, to round-off"
    return f"errors of {error[0]:.1g} m: another motion?"


CAPTION = (
    "The heavy top in multibody codes and engines: measured orders of position and rotation; errors (m, rad) with steps of "
    "1/1024 s and with the smallest; the time of a step. No order: too few errors below 0.1, or all at round-off"
)
OVERVIEW_CAPTION = (
    "The top of `slow` in engines, by default and as their documents advise. Errors (m) of the centre of mass after 2 s, with "
    "two steps. `until` (s) is how long they stay below 10 cm with steps of 1/60 s. `limit` is the motion that smaller "
    "steps lead to"
)


@by_group(("case", "engine", "integrator"), "", CAPTION)
def orders(case: str, engine: str, kind: str, group: pd.DataFrame) -> dict:
    last, at, quantities = group.loc[group.h.idxmin()], group[group.h == SHOWN], ("position", "rotation")
    setting = WORDS.get(last.setting, "")
    line = {"setting": setting, "version": last.version, "measured": last.date, **measured_orders(group)}
    line |= {f"{name}, h = 1/1024": at[name].iloc[0] if len(at) else np.nan for name in quantities}
    line |= {"smallest h": last.h} | {f"{name} there": last[name] for name in quantities}
    return line | {"ns per step": group.ns_per_step.min()}


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    named, engines = tabulated(orders)(runs(rows)), overview(rows)
    if len(engines):
        engines.attrs["caption"] = OVERVIEW_CAPTION
        named["overview"] = engines
    return named


# the lines of the sweep: at most one of each engine, and of this bench the exact step and its splitting
LINES = {
    ("MuJoCo", "RK4"): "#D55E00",
    ("Exudyn", "RK67"): "#8A3A00",
    ("Drake", "runge_kutta5"): "#009E73",
    ("PyBullet", "Euler, undamped"): "#CC79A7",
    (OURS, "strang"): "",
    (OURS, "backlund"): "",
}


@of_part()
def _draw_steps(rows: pd.DataFrame, style):
    """Draw the errors of one integrator of each engine against the step and the time."""
    rows = runs(rows)
    cases = [case for case in ("slow", "bruels") if case in set(rows.case)]
    if not cases:
        return None
    fig, grid = style.figure("page", 0.9 + 2.3 * len(cases), nrows=len(cases), ncols=2, squeeze=False)
    columns = {"h": "step, s", "seconds": "wall time of the run, s"}
    for (case, line), (place, name) in product(zip(cases, grid, strict=True), enumerate(columns)):
        for (engine, kind), colour in LINES.items():
            run = rows[(rows.case == case) & (rows.engine == engine) & (rows.integrator == kind)].sort_values("h")
            look = style.of(kind) if engine == OURS else {"label": f"{engine}, {kind}", "marker": ".", "color": colour}
            line[place].loglog(run[name], run.position.clip(lower=1e-16), **look)
        line[place].set(xlabel=columns[name], ylabel="error of position, m", title=f"{case}, t = {UNTIL:g} s")
    style.legend_below(fig)
    same = rows[rows.engine.ne(OURS)].groupby(["case", "h"]).position.agg(["min", "max"])
    if (apart := (same["max"] / same["min"]).max()) > ORDERS_APART:
        factor = show(10.0 ** int(np.log10(apart)))
        fig.headline = f"At the same step the errors of engines differ by factors of up to {factor}"
    fig.caption = (
        "Error of the centre of mass at the end against the step, and against the wall time of the whole run on one core; down "
        "and left is better. Each engine has its most accurate integrator."
    )
    return fig


draw = drawn(steps=_draw_steps)
