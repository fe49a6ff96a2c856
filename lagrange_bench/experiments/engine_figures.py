"""Tables and figures of the experiment `engines`. They have a file of their own, so an edit here makes no row old."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.heavy_top_figures import measured_orders
from lagrange_bench.experiments.programs import AXIS, BEST, DEFAULT, ENGINES, METHODS, OURS, POWERS, RACKET, UNTIL

SHOWN = 1 / 1024  # s, the step whose errors tables show beside the smallest step
FOLLOWED = ("position", "rotation", "spin", "energy", "energy_growth", "until", "precision", "turns_over")  # untimed
ORDERS_APART = 1e3  # errors of engines at the same step that differ by more are worth a headline
OVERVIEW = {"1/60 s": 1 / 60, "1/1024 s": 1 / 1024}  # steps, s
# one engine of each family of results, and two that run on graphics cards
KNOWN = ("MuJoCo", "MJX", "Newton", "Simbody", "PhysX", "Jolt", "Havok", "Rapier", "Bullet (ammo.js)")


def runs(rows: pd.DataFrame, sweep: bool = True) -> pd.DataFrame:
    """The rows of the sweep, or the other rows, with the name of the integrator or method, and the seconds of a run."""
    wanted = ("timing", "integrator", "method", "setting", "ns_per_step", "overhead_ns_per_step", *FOLLOWED)
    rows = rows.reindex(columns=list(dict.fromkeys((*rows.columns, *wanted))))
    rows = rows[rows.timing.eq(True) == sweep]
    named = rows.integrator.astype(object).fillna(rows.method)
    seconds = rows.ns_per_step * 1e-9 * UNTIL / rows.h
    return rows.assign(integrator=named, setting=rows.setting.astype(object).fillna(""), seconds=seconds)


def overview(rows: pd.DataFrame, engines: Iterable[str] = KNOWN) -> pd.DataFrame:
    """How well engines follow `slow`, with their default and their best settings.

    Parameters
    ----------
    rows : DataFrame
        As stored, of the experiment `engines`.
    engines : iterable of str
        Names in ENGINES.

    Returns
    -------
    DataFrame
        A line for each engine and setting. `engine`: with its version. `setting`: with the integrator. "1/60 s", "1/1024 s":
        the error of the centre of mass after 2 s with these steps, m (NaN: it gave up, or was not measured). `until`: how long
        it is within 10 cm with steps of 1/60 s, s. `limit`: the motion that smaller steps lead to, or why an engine that is
        measured in part has no numbers.
    """
    good = runs(rows[rows.status == "done"], sweep=False)
    lines = []
    for name in engines:
        chosen = good[(good.engine == name) & good.setting.isin((DEFAULT, BEST))]
        for kind, group in chosen.groupby("integrator", sort=False):
            slow = group[group.case == "slow"].set_index("h").sort_index(ascending=False)
            if not slow.empty:
                how = slow.setting.iloc[-1]
                setting = how if kind == how else f"{how}: {kind}"
                line = {"engine": f"{name}, {slow.version.iloc[-1]}", "setting": setting}
                line |= {step: slow.position.get(h, np.nan) for step, h in OVERVIEW.items()}
                lines.append({**line, "until": slow.until.get(1 / 60, np.nan), "limit": limit(group)})
        if (engine := ENGINES.get(name)) and engine.missing:
            measured = set(chosen[chosen.case == "slow"].integrator)
            for kind, how in engine.integrators.items():
                if how in (DEFAULT, BEST) and kind not in measured:
                    lines.append({"engine": name, "setting": f"{how}: {kind}", "limit": engine.missing})
    return pd.DataFrame(lines, columns=["engine", "setting", *OVERVIEW, "until", "limit"])


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
    "1/1024 s and with the smallest; the time of a step. The overhead is the time of a step of a mass on a rail, in a run of as "
    "many steps: the part that has little to do with the top. No order: too few errors below 0.1, or all at round-off"
)
OVERVIEW_CAPTION = (
    "The top of `slow` in engines, with default and best settings. Errors (m) of the centre of mass after 2 s, with two "
    "steps. `until` (s) is how long they stay below 10 cm with steps of 1/60 s. `limit` is the motion that smaller "
    "steps lead to"
)


@by_group(("case", "engine", "integrator"), "", CAPTION)
def orders(case: str, engine: str, kind: str, group: pd.DataFrame) -> dict:
    last, at, quantities = group.loc[group.h.idxmin()], group[group.h == SHOWN], ("position", "rotation")
    line = {"setting": last.setting, "version": last.version, "measured": last.date, **measured_orders(group)}
    line |= {f"{name}, h = 1/1024": at[name].iloc[0] if len(at) else np.nan for name in quantities}
    line |= {"smallest h": last.h} | {f"{name} there": last[name] for name in quantities}
    return line | {"ns per step": group.ns_per_step.min(), "overhead, ns": group.overhead_ns_per_step.min()}


ENERGY_CAPTION = (
    "The energy of `slow` in engines with steps of 1/1024 s. Energy gained: its change after 2 s, relative to the start. "
    "Exponent p: the change grows like t^p (none: it stays at round-off). Precision: of the program's numbers. Least error: the "
    "smallest error of position (m) of all steps that were taken, and the step (s) that has it"
)


@by_group(("engine", "integrator"), "", ENERGY_CAPTION)
def energy(engine: str, kind: str, group: pd.DataFrame) -> dict:
    slow = group[group.case == "slow"].set_index("h")
    if SHOWN not in slow.index:
        return {}
    run, least = slow.loc[SHOWN], slow.loc[slow.position.idxmin()]
    line = {"setting": run.setting, "energy gained": run.energy, "exponent p": run.energy_growth}
    return line | {"precision": run.precision, "least error": least.position, "its step": least.name}


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    named, engines = tabulated(orders)(runs(rows)), overview(rows)
    places = {name: place for place, name in enumerate(KNOWN)}
    rows = rows.sort_values("engine", key=lambda names: names.map(places), kind="stable")  # the others below
    named |= tabulated(energy)(runs(rows, sweep=False))
    if len(engines):
        engines.attrs["caption"] = OVERVIEW_CAPTION
        named["overview"] = engines
    return named


# colours of engines; the exact step is blue
COLOURS = ("#D55E00", "#8A3A00", "#C78900", "#009E73", "#CC79A7", "#7A5BB8", "#4D3500")
NEUTRAL = "#8F8F8F"  # an engine that has rows but is no longer listed
MARKERS = ("o", "s", "D", "^", "v")


def looks(rows: pd.DataFrame, style) -> dict[tuple[str, str], dict]:
    """The look of each integrator: the exact step blue, each engine in its own colour.

    Beside engines other methods of the bench, and older versions of an engine, are thin and grey, without a name.
    """
    timed = [name for name, engine in ENGINES.items() if engine.timed and name != OURS]
    looks, colours = {}, {OURS: style.INK} | dict(zip(timed, COLOURS, strict=False))
    engines = set(rows.engine) - {OURS}
    for name, kind in dict.fromkeys(zip(rows.engine, rows.integrator, strict=True)):
        ours, colour = name == OURS, colours.get(name, NEUTRAL)
        if ours and kind in style.EXACT_STEPS:
            colour = style.of(kind)["color"]
        kinds = METHODS if ours else tuple(getattr(ENGINES.get(name), "integrators", ()))
        marker = MARKERS[kinds.index(kind) % len(MARKERS)] if kind in kinds else "none"
        text = style.label(kind) if ours else f"{name}, {kind}"
        looks[name, kind] = {"color": colour, "label": style.plain(text), "marker": marker, "markersize": 3.0}
        older = name.rstrip("0123456789. ") in engines - {name}
        if engines and ((ours and kind not in style.EXACT_STEPS) or older):
            thin = {"color": NEUTRAL, "label": "_thin", "marker": "none", "linewidth": 0.7, "zorder": 1}
            looks[name, kind] = {**thin, "gid": style.title(text)}
    return looks


@of_part(failed=True)
def _draw_steps(rows: pd.DataFrame, style):
    """Draw errors of the methods of the bench, and of each engine with its best settings."""
    rows = runs(rows)
    rows = rows[rows.engine.eq(OURS) | rows.setting.eq(BEST)]
    if rows.empty:
        return None
    cases = [case for case in POWERS if case in set(rows.case)]
    fig, grid = style.figure("page", 0.9 + 2.3 * len(cases), nrows=len(cases), ncols=2, sharey="row", squeeze=False)
    columns = {"h": "step, s", "seconds": "wall time of the run, s"}
    for line, case in zip(grid, cases, strict=True):
        for ax, (column, text) in zip(line, columns.items(), strict=True):
            for (name, kind), look in looks(rows, style).items():
                run = rows[(rows.case == case) & (rows.engine == name) & (rows.integrator == kind)]
                good = run[run.status == "done"].sort_values("h")
                if not good.empty:
                    ax.loglog(good[column], good.position.clip(lower=1e-16), **look)
            ax.set(xlabel=text, title=f"{case}, t = {UNTIL:g} s")
        line[0].set_ylabel("error of position, m")
        style.failure_marks(line[0], rows[(rows.case == case) & (rows.status == "failed")].h.unique())
    style.legend_below(fig)
    best = "Programs have their best integrator or settings; grey: other methods of this bench, and older versions"
    which = "Methods of this bench; no engine ran here" if rows.engine.eq(OURS).all() else best
    same = rows[rows.engine.ne(OURS) & rows.status.eq("done")].groupby(["case", "h"]).position.agg(["min", "max"])
    if (apart := (same["max"] / same["min"]).max()) > ORDERS_APART:
        factor = show(10.0 ** int(np.log10(apart)))
        fig.headline = f"At the same step the errors of engines differ by factors of up to {factor}"
    fig.caption = (
        "Error of the centre of mass at the end against the step, and against the wall time of the whole run on one core; down "
        f"and left is better. {which}. Crosses: steps at which an engine gave up."
    )
    return fig


EQUAL = 0.05  # relative: integrators whose errors differ by less at all steps are one family


def families(rows: pd.DataFrame) -> list[list[tuple[str, str, pd.Series]]]:
    """Families of (engine, integrator, errors by step) with equal errors on `slow`; the largest families first."""
    found: list[list[tuple[str, str, pd.Series]]] = []
    good = runs(rows[rows.status == "done"], sweep=False)
    good = good[(good.case == "slow") & (good.engine != OURS)].dropna(subset=["position"])
    for (name, kind), group in good.groupby(["engine", "integrator"], sort=False):
        error = group.set_index("h").position.sort_index()
        for family in found:
            ratio = (error / family[0][2]).dropna()
            if len(ratio) > 1 and np.all(np.abs(np.log(ratio)) < EQUAL):
                family.append((name, kind, error))
                break
        else:
            found.append([(name, kind, error)])
    return sorted(found, key=len, reverse=True)


@of_part(failed=True)
def _draw_families(rows: pd.DataFrame, style):
    """Draw errors against the step, with a colour for each family."""
    found = [family for family in families(rows) if len(family[0][2]) > 1]
    if not found:
        return None
    fig, ax = style.figure("page", 4.6)
    colours = iter(COLOURS)
    for family in found:
        text = ", ".join(dict.fromkeys(name for name, _, _ in family))
        colour = next(colours, None) if len(family) > 1 else None
        for name, kind, error in family:
            look = {"color": colour or NEUTRAL, "linewidth": 1.4 if colour else 0.6, "zorder": 2 if colour else 1}
            look |= {"marker": "o", "markersize": 3.0, "gid": style.title(f"{name}, {kind}")}
            label = style.plain(text) if colour and error is family[0][2] else "_thin"
            ax.loglog(error.index, error.clip(lower=1e-16), label=label, **look)
    ax.set(xlabel="step, s", ylabel="error of position, m", title=f"slow, t = {UNTIL:g} s")
    style.legend_below(fig)
    if (many := len({name for name, _, _ in found[0]})) > 1:
        fig.headline = f"One formula has many names: {many} programs are off by the same amount at every step"
    fig.caption = (
        "Error of the centre of mass against the step. Lines of one colour have errors that agree within "
        f"{EQUAL:.0%}: the same formula under different names. Grey: lines that agree with no other. Lines that end level "
        "follow another motion, or have met the round-off of single precision."
    )
    return fig


@of_part()
def _draw_racket(rows: pd.DataFrame, style):
    """Draw the time at which the racket turns over, by engine."""
    good = runs(rows, sweep=False)
    good = good[(good.case == RACKET.name) & good.setting.isin((DEFAULT, BEST)) & good.h.isin(OVERVIEW.values())]
    names = list(dict.fromkeys(zip(good.engine, good.integrator, strict=True)))
    if not names:
        return None
    t = np.linspace(0.0, RACKET.until, 5001)
    exact = t[np.argmax(RACKET.solution(t).omega_body[:, AXIS] < 0)]
    fig, ax = style.figure("page", 0.9 + 0.17 * len(names))
    ax.axvline(exact, color=style.of("backlund")["color"], linewidth=1.2, label="exact")
    for (step, h), look in zip(OVERVIEW.items(), ({"marker": "s", "mfc": "none"}, {"marker": "o"}), strict=True):
        at = good[good.h == h]
        places = [names.index(pair) for pair in zip(at.engine, at.integrator, strict=True)]
        times = at.turns_over.fillna(RACKET.until)
        ax.plot(times, places, linestyle="none", color=COLOURS[0], label=step, markersize=4.0, **look)
    ax.set_yticks(range(len(names)), [style.plain(f"{name}, {kind}") for name, kind in names], fontsize=6)
    seconds = np.arange(2.5, RACKET.until, 0.5)
    ax.set_xticks([*seconds, RACKET.until], [*(f"{t:g}" for t in seconds), "never"])
    ax.set(xlabel="time at which it turns over, s", ylim=(len(names), -1))
    style.legend_below(fig)
    if never := good[good.turns_over.isna()].engine.nunique():
        fig.headline = (
            f"{never} of {good.engine.nunique()} programs have a setting with which the body never turns over"
        )
    fig.caption = (
        "A free body that starts beside its middle axis must turn over. Without the gyroscopic torque it never does, whatever "
        f"the step. Marks at “never” are runs of {RACKET.until:g} s in which it did not."
    )
    return fig


draw = drawn(steps=_draw_steps, families=_draw_families, racket=_draw_racket)
