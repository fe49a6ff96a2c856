"""The heavy top and free bodies in multibody codes and engines

How well do programs follow a spinning body? Each integrator of each engine follows the centre of mass and the rotation of
`bruels`, the usual test of multibody codes with 300 rad of spin, and of `slow`, with a fifteenth of the spin, for 2 s; and the
rotation of two free bodies for 5 s: `box`, which tumbles, and `racket`, which starts beside its middle axis and must turn
over. Errors are those against the exact solution. `bruels` is a stress test: engines are made for slower motions, contacts
and many bodies, of which nothing is measured here. Methods of this bench follow the same bodies beside them; among these
`backlund` is the exact step of a top, with the attitude.

Two sorts of rows. The sweep: steps of 2 s over powers of two, errors at the end, and times. A run is timed as a whole, without
its set-up (of `backlund` with it); the least of its repeats counts; all run on one core. The overhead is the time that as many
steps of a mass on a rail take: of the engine beside the top, and of the loop in Python where there is only that. The others
have the steps of games and robots, more columns, and no times.

Settings: “default” is what an engine does if nobody chooses, “recommended” what its documentation advises. “best” is what its
documentation says is more accurate, the highest order or accuracy on offer, or what was measured to be better; the comment
above ENGINES says which.

Engines are no part of the bench: in the clone `pip install '.[engines]'` brings MuJoCo and Exudyn, the others install by the
names in ENGINES. `make web` installs the engines of the web and runs them. Cells of an engine that is not there are skipped.
"""

import importlib
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments import adapters, heavy_top
from lagrange_bench.experiments.adapters import CONTROLLED, DISCRETE, DOUBLES, EXPLICIT
from lagrange_bench.experiments.drawing.shown import by_group, drawn, of_part, tabulated
from lagrange_bench.experiments.drawing.tables import show
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import rounded
from lagrange_bench.integrators import CASES, RigidBody
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array, StepError

VERSION = 1
MEASURED = {"": ("rotation",)}  # a run whose numbers become infinite fails
TIMES = ("version", "date")  # not compared by `verify`, as times are not
UNTIL = 2.0  # s, of the sweep
POWERS = {"bruels": range(10, 17), "slow": range(6, 14)}  # of 2, steps: so many times h is 2 s exactly
REPEATS, ENOUGH = 5, 0.5  # runs of a cell; no more than two if they take so many seconds together
DEFAULT, RECOMMENDED, BEST, OTHER = "default", "recommended", "best", ""  # settings

# The tennis racket theorem in 5 s, with moments that matter can have: MuJoCo refuses those of the case `middle_axis`, and of a
# start as close as its own, single precision keeps a digit or two.
_PLATE = RigidBody(mass=1.0, com=(0.0, 0.0, 0.0), inertia_com=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, 0.0))
RACKET = Case("racket", _PLATE, np.eye(3), (0.01, 5.0, 0.0), until=5.0)
BODIES = {**{name: CASES[name] for name in ("slow", "bruels", "box")}, RACKET.name: RACKET}
STEPS = (1 / 60, 1 / 240, 1 / 1024, 1 / 4096)  # s
ROWS = 512  # of a run, at most: how fine `until` is
NEAR = 0.1  # m, of the centre of mass of a top; rad, of the rotation of a free body
AXIS = 1  # in the body: of symmetry, or the middle one


@dataclass(frozen=True)
class Engine:
    """A program, and how its integrators are made to follow a body.

    start : the adapter. package : its distribution on PyPI. integrators : name → setting. module : the name to import, where it
    is not that of the package. release : the beginning of the only version that is meant, or "". timed : whether it is in the
    sweep. least : the smallest step, s, of a program that would take an hour with a smaller one. missing : why it has fewer
    rows than the others.
    """

    start: Callable[..., adapters.Run]
    package: str
    integrators: dict[str, str]
    module: str = ""
    release: str = ""
    timed: bool = False
    least: float = 0.0
    missing: str = ""

    def load(self) -> Any:
        return importlib.import_module(self.module or self.package.replace("-", "_"))

    def installed(self) -> str | None:
        """The version that is installed here."""
        try:
            return metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None

    @property
    def version(self) -> str | None:
        """The version that is installed here; None if another release is meant."""
        found = self.installed()
        return found if found and found.startswith(self.release) else None

    @property
    def needs(self) -> str:
        """What is to be installed."""
        return self.package + f"=={self.release}*" * bool(self.release)


class WebEngine(Engine):
    """A package of npm, which runs in node."""

    def load(self) -> None:
        return None

    def installed(self) -> str | None:
        path = adapters.WEB / "node_modules" / self.package / "package.json"
        return json.loads(path.read_text("utf-8"))["version"] if path.is_file() else None

    @property
    def needs(self) -> str:
        return f"{self.package} of npm (make web)"


def _web(name: str, package: str, *best: str) -> WebEngine:
    return WebEngine(partial(adapters.node, name), package, {"default": DEFAULT, **dict.fromkeys(best, BEST)})


OURS = "lagrange-bench"
METHODS = ("backlund", "strang", "rkmk4", "rattle", "generalized_alpha")
_MUJOCO = {"implicitfast": RECOMMENDED, "RK4": BEST}  # of all releases; the manual recommends implicitfast
_EXUDYN = {"generalized-alpha": DEFAULT, "generalized-alpha, Lie group": OTHER, **dict.fromkeys(EXPLICIT, OTHER)}
_DRAKE = {DISCRETE: DEFAULT, f"runge_kutta3{CONTROLLED}": DEFAULT, "runge_kutta2": OTHER, "runge_kutta3": OTHER}
_MERSON = "Runge-Kutta-Merson"
_ON_A_CPU = "not measured: on a processor a run takes minutes"
# Why a setting is called best. Documented: Drake (highest order), ODE (ERP up to 0.8, CFM 0 is a hard joint), PhysX (flag, TGS
# and more iterations), Jolt (flag), cannon-es (iterations). The highest order or accuracy on offer, or more iterations: RK4 of
# MuJoCo and Newton, RK67 of Exudyn, Simbody, Rapier. “undamped” takes away what is not in the equations. The better one of two
# that were measured: RKMK4 with Pinocchio's dynamics, the explicit flag of Bullet, doubles in MJX.
ENGINES = {
    OURS: Engine(adapters.bench, OURS, dict.fromkeys(METHODS, OTHER), timed=True),
    "MuJoCo": Engine(
        adapters.mujoco, "mujoco", {"Euler": DEFAULT, "implicit": OTHER, **_MUJOCO}, release="4.", timed=True
    ),
    "MuJoCo 3": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.17.", timed=True),
    "MuJoCo 3.10": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.10."),
    "MuJoCo 3.6": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.6."),
    "Exudyn": Engine(adapters.exudyn, "exudyn", _EXUDYN | {"RK67": BEST}, timed=True),
    "Drake": Engine(
        adapters.drake, "drake", _DRAKE | {"radau3": OTHER, "runge_kutta5": BEST}, module="pydrake", timed=True
    ),
    "Pinocchio": Engine(
        adapters.pinocchio, "pin", {"semi-implicit Euler": OTHER, "RKMK4": BEST}, module="pinocchio", timed=True
    ),
    "PyBullet": Engine(adapters.pybullet, "pybullet", {"Euler": DEFAULT, "Euler, undamped": BEST}, timed=True),
    "DART": Engine(adapters.dart, "dartpy", {"Euler": DEFAULT}, timed=True),
    "Simbody": Engine(adapters.simbody, "opensim", {_MERSON: DEFAULT, f"{_MERSON}, accuracy 1e-12": BEST}),
    "Rapier": Engine(adapters.rapier, "rapier3d", {"default": DEFAULT, "32 iterations, fast rotation": BEST}),
    "Bullet (Panda3D)": Engine(adapters.bullet, "panda3d", {"default": DEFAULT}, module="panda3d.bullet"),
    "ODE (Panda3D)": Engine(
        adapters.ode, "panda3d", {"default": DEFAULT, "ERP 0.8, CFM 0": BEST}, module="panda3d.ode"
    ),
    "PhysX (SAPIEN)": Engine(adapters.sapien, "sapien", {"default": DEFAULT, "undamped": BEST}),
    "MuJoCo Warp": Engine(
        adapters.mujoco_warp, "mujoco-warp", {"Euler": DEFAULT, **_MUJOCO}, least=1 / 1024, missing=_ON_A_CPU
    ),
    "MJX": Engine(
        adapters.mjx,
        "mujoco-mjx",
        {"Euler": DEFAULT, "RK4": OTHER, f"RK4{DOUBLES}": BEST},
        module="mujoco.mjx",
        missing=_ON_A_CPU,
    ),
    "Newton": Engine(
        adapters.newton,
        "newton",
        {"XPBD": DEFAULT, "Featherstone": OTHER, "XPBD, equal relaxation": BEST},
    ),
    "Newton (MuJoCo Warp)": Engine(
        adapters.newton,
        "newton",
        {"MuJoCo": DEFAULT, "MuJoCo, RK4": BEST},
        least=1 / 1024,
        missing=_ON_A_CPU,
    ),
    "cannon-es": _web("cannon", "cannon-es", "undamped, 100 iterations"),
    "Oimo": _web("oimo", "oimo"),
    "Havok": _web("havok", "@babylonjs/havok", "undamped"),
    "Jolt": _web("jolt", "jolt-physics", "undamped, gyroscopic torque"),
    "PhysX": _web("physx", "physx-js-webidl", "undamped, gyroscopic torque, TGS, 64 + 16 iterations"),
    "Rapier (JavaScript)": _web("rapier", "@dimforge/rapier3d-compat", "32 iterations"),
    "Bullet (ammo.js)": _web("ammo", "ammojs3", "explicit gyroscopic torque"),
}


def cells(profile: str) -> list[dict]:
    """The quick profile has the sweep of the methods of the bench alone: it never needs an engine."""
    full = profile == "full"
    sweep, others = [], []
    for name, engine in ENGINES.items() if full else [(OURS, ENGINES[OURS])]:
        for kind, how in engine.integrators.items():
            who = (
                {"engine": name, "method": kind}
                if name == OURS
                else {"engine": name, "integrator": kind, "setting": how}
            )
            if engine.timed and how != RECOMMENDED:
                steps = [(case, k) for case, powers in POWERS.items() for k in (powers if full else powers[:-2:2])]
                sweep += [{"timing": True, "case": case, **who, "h": UNTIL / 2**k} for case, k in steps]
            bodies = POWERS if kind == "backlund" else BODIES  # the former are tops
            others += [{"case": case, **who, "h": h} for case in bodies for h in STEPS if full and h >= engine.least]
    return sweep + others


def missing_package(cell: dict) -> str | None:
    """The package that a cell needs, if it is not installed here in the version that is meant."""
    engine = ENGINES.get(cell.get("engine", ""))
    return None if engine is None or engine.version else engine.needs


def followed(
    engine: Engine, case: Case, kind: str, h: float, steps: int, every: int, rail: bool = False
) -> tuple[float, list[Any]]:
    """The time of a run, s, without its set-up, and its rows. StepError: the engine refuses, or its numbers are not finite."""
    run = engine.start(engine.load(), adapters.Body.of(case), kind, h, *([True] if rail else []))
    who = f"{engine.package} {kind}"
    begin = perf_counter()
    try:
        rows = list(run(steps, every))
    except StepError:
        raise
    except Exception as error:  # what an engine raises here is its refusal, and a result
        raise StepError(who, re.split(r"\n|\. ", str(error).strip())[0]) from error
    seconds = perf_counter() - begin
    for n, row in enumerate(rows, 1):
        if not all(np.isfinite(part).all() for part in row):
            raise StepError(who, f"its numbers are not finite after {n * every * h:.3g} s")
    return seconds, rows


def timed(engine: Engine, case: Case, kind: str, h: float, steps: int, rail: bool) -> tuple[float, Any]:
    """The least time of a run, s, and its end."""
    samples: list[float] = []
    while len(samples) < 2 or (len(samples) < REPEATS and sum(samples) < ENOUGH):
        seconds, end = followed(engine, case, kind, h, steps, steps, rail)
        samples.append(seconds)
    return min(samples), end


def errors(case: Case, t: Array, rows: list[Any]) -> dict[str, Any]:
    """The errors at the end of rows at times t (N,), how long they are NEAR, and the precision of the numbers.

    position : m, of a top only. rotation : rad. spin : rad/s, error of the angular velocity about AXIS. energy : its change,
    relative to the start. energy_growth : the exponent p of its growth like t^p; NaN while it stays at round-off. until : s, how
    long the rows are NEAR. turns_over : s, of a free body, when its angular velocity about AXIS changes its sign; NaN if it never
    does.
    """
    place, turns, omega = (np.array(part, dtype=float) for part in zip(*rows, strict=True))
    exact, start = case.solution(t), case.solution([0.0])
    turn = (Rotation.from_quat if turns.ndim == 2 else Rotation.from_matrix)(turns)
    own = turn.apply(omega, inverse=True)
    top = np.any(case.body.com)
    found = {"position": np.linalg.norm(place - exact.position, axis=1)} if top else {}
    found |= {
        "rotation": (exact.rotation.inv() * turn).magnitude(),
        "spin": own[:, AXIS] - exact.omega_body[:, AXIS],
        "energy": case.body.energy_of(turn, own) / start.energy[0] - 1.0,
    }
    far = np.flatnonzero(~(found["position" if top else "rotation"] <= NEAR))
    row: dict[str, Any] = {name: rounded(values[-1]) for name, values in found.items()}
    single = bool(np.all(turns.astype(np.float32) == turns))
    floor = 4 * np.finfo(np.float32 if single else np.float64).eps  # of energies of numbers with this precision
    row |= {"energy_growth": rounded(metrics.growth_exponent(t, found["energy"], floor=float(floor)).p)}
    row |= {"until": rounded(t[far[0]] if len(far) else case.until), "precision": "single" if single else "double"}
    if not top:
        over = np.flatnonzero(own[:, AXIS] < 0)
        row["turns_over"] = rounded(t[over[0]]) if len(over) else np.nan
    return row


def measure(cell: dict) -> list[dict]:
    engine, case, h = ENGINES[cell["engine"]], BODIES[cell["case"]], cell["h"]
    kind, steps = cell.get("method") or cell["integrator"], round(case.until / h)
    when = {"version": engine.version or "", "date": datetime.now(UTC).date().isoformat()}
    if not cell.get("timing"):
        every = -(-steps // ROWS)
        _, rows = followed(engine, case, kind, h, steps, every)
        return [errors(case, np.arange(1, len(rows) + 1) * every * h, rows) | when]
    seconds, end = timed(engine, case, kind, h, steps, rail=False)
    row = errors(case, np.array([case.until]), end)
    row = {
        "position": row["position"],
        "rotation": row["rotation"],
        "ns_per_step": rounded(seconds / steps * 1e9),
    } | when
    if cell["engine"] != OURS:
        row["overhead_ns_per_step"] = rounded(timed(engine, case, kind, h, steps, rail=True)[0] / steps * 1e9)
    return [row]


SHOWN = 1 / 1024  # s, a step at which errors are told beside those with the smallest


def runs(rows: pd.DataFrame, sweep: bool = True) -> pd.DataFrame:
    """The rows of the sweep, or the others, with the name of each integrator, or method, and the seconds of a run."""
    wanted = ("timing", "integrator", "method", "setting", "ns_per_step", "overhead_ns_per_step", *FOLLOWED)
    rows = rows.reindex(columns=list(dict.fromkeys((*rows.columns, *wanted))))
    rows = rows[rows.timing.eq(True) == sweep]
    named = rows.integrator.astype(object).fillna(rows.method)
    seconds = rows.ns_per_step * 1e-9 * UNTIL / rows.h
    return rows.assign(integrator=named, setting=rows.setting.astype(object).fillna(""), seconds=seconds)


FOLLOWED = (
    "position",
    "rotation",
    "spin",
    "energy",
    "energy_growth",
    "until",
    "precision",
    "turns_over",
)  # of rows without times
ORDERS_APART = 1e3  # engines at the same step: worth a headline
OVERVIEW = {"1/60 s": 1 / 60, "1/1024 s": 1 / 1024}  # steps, s
KNOWN = (  # one of each family of results, and the two that run on graphics cards
    "MuJoCo", "MJX", "MuJoCo Warp", "Simbody", "PhysX", "Jolt", "Havok", "Rapier", "Bullet (ammo.js)"
)  # fmt: skip


def overview(rows: pd.DataFrame, engines: Iterable[str] = KNOWN) -> pd.DataFrame:
    """How well engines follow `slow`, with their default and their best settings.

    Parameters
    ----------
    rows : DataFrame
        As stored, of the experiment `engines`.
    engines : iterable of str
        Which, of ENGINES.

    Returns
    -------
    DataFrame
        A line for each engine and setting. `engine` with its version; `setting`, with the integrator; "1/60 s", "1/1024 s":
        the error of the centre of mass after 2 s with these steps, m (NaN: it gave up, or was not measured); `until`: how long
        it is within 10 cm with steps of 1/60 s, s; `limit`: what motion it tends to as the steps get smaller, or why an
        engine that is measured in part has no numbers.
    """
    good = runs(rows[rows.status == "done"], sweep=False)
    lines = []
    for name in engines:
        for kind, group in good[(good.engine == name) & good.setting.isin((DEFAULT, BEST))].groupby(
            "integrator", sort=False
        ):
            slow = group[group.case == "slow"].set_index("h").sort_index(ascending=False)
            if not slow.empty:
                how = slow.setting.iloc[-1]
                line = {
                    "engine": f"{name}, {slow.version.iloc[-1]}",
                    "setting": how if kind == how else f"{how}: {kind}",
                }
                line |= {step: slow.position.get(h, np.nan) for step, h in OVERVIEW.items()}
                lines.append({**line, "until": slow.until.get(1 / 60, np.nan), "limit": limit(group)})
        engine = ENGINES.get(name)
        if engine and engine.missing:
            measured = set(good[(good.engine == name) & (good.case == "slow")].integrator)
            wanted = {kind: how for kind, how in engine.integrators.items() if how in (DEFAULT, BEST)}
            lines += [
                {"engine": name, "setting": f"{how}: {kind}", "limit": engine.missing}
                for kind, how in wanted.items()
                if kind not in measured
            ]
    return pd.DataFrame(lines, columns=["engine", "setting", *OVERVIEW, "until", "limit"])


LOST_SPIN = 0.05  # rad/s, of `slow`: damping takes more
FALLS = 1.5  # errors fall if the smallest step makes them so many times smaller than the next one
TINY = 1e-6  # m: smaller errors need not fall
TURN = 10.0  # rad, half of what `slow` turns: a relative error of ω that grows evenly to e turns the body by TURN · e


def limit(group: pd.DataFrame) -> str:
    """What motion the runs of one integrator tend to, as the steps get smaller.

    Without gyroscopic torque `racket` never turns over. Damping and caps take a spin that smaller steps do not give back.
    Else the error of `slow` gets smaller to the end, or stays where round-off is: an ulp of ω a step, all one way.
    """
    finest = {case: runs.sort_values("h").iloc[:2] for case, runs in group.groupby("case")}
    slow, racket = finest["slow"], finest.get("racket", group[:0])
    if len(slow) < 2:
        return ""
    never = len(racket) > 0 and racket.turns_over.isna().all()
    lost, error = -slow.spin.to_numpy(), slow.position.to_numpy()
    damped = lost[0] > LOST_SPIN and lost[0] > lost[1] / 2
    causes = {"no gyroscopic torque": never, "damping": damped}
    if never or damped:
        return f"another motion: {', '.join(cause for cause, is_so in causes.items() if is_so)}"
    if error[0] < error[1] / FALLS or error[0] < TINY:
        return "the exact motion"
    round_off = TURN * np.finfo(slow.precision.iloc[0]).eps * UNTIL / slow.h.iloc[0]
    if error[0] < round_off:
        return "the exact motion, to round-off"
    return f"errors stay at {error[0]:.1g} m: another motion, damping or a cap?"


CAPTION = (
    "The heavy top in multibody codes and engines: measured orders of position and rotation; errors (m, rad) with steps of "
    "1/1024 s and with the smallest; the time of a step, and what a step of a mass on a rail takes. No order: too few errors "
    "below 0.1, or all at round-off"
)


OVERVIEW_CAPTION = (
    "The top of `slow` in engines, with default and best settings. The errors (m) are those of the centre of mass after 2 s, "
    "with two steps. `until` (s) is how long they stay below 10 cm with steps of 1/60 s. `limit` is the motion that smaller "
    "steps lead to"
)


@by_group(("case", "engine", "integrator"), "", CAPTION)
def orders(case: str, engine: str, kind: str, group: pd.DataFrame) -> dict:
    last, at, quantities = group.loc[group.h.idxmin()], group[group.h == SHOWN], ("position", "rotation")
    line = {"setting": last.setting, "version": last.version, "measured": last.date, **heavy_top.measured_orders(group)}
    line |= {f"{name}, h = 1/1024": at[name].iloc[0] if len(at) else np.nan for name in quantities}
    line |= {"smallest h": last.h} | {f"{name} there": last[name] for name in quantities}
    return line | {"ns per step": group.ns_per_step.min(), "of these overhead": group.overhead_ns_per_step.min()}


ENERGY_CAPTION = (
    "The energy of `slow` in engines with steps of 1/1024 s: how much of it is gained after 2 s, the exponent p of a change like "
    "t^p (none: it stays at round-off), and the precision of the numbers. Least error: of the position (m), with the step (s) "
    "that has it; smaller steps make it larger, unless it is the smallest that was taken"
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
    named |= tabulated(energy)(runs(rows, sweep=False))
    if len(engines):
        engines.attrs["caption"] = OVERVIEW_CAPTION
        named["overview"] = engines
    return named


COLOURS = (
    "#D55E00",
    "#8A3A00",
    "#C78900",
    "#009E73",
    "#CC79A7",
    "#7A5BB8",
    "#4D3500",
)  # of engines; the exact step is blue
NEUTRAL = "#8F8F8F"  # of an engine that has rows, and is no longer listed
MARKERS = ("o", "s", "D", "^", "v")


def looks(rows: pd.DataFrame, style) -> dict[tuple[str, str], dict]:
    """The look of each integrator: blue the exact step, black other methods of the bench, a colour for each engine."""
    timed = [name for name, engine in ENGINES.items() if engine.timed and name != OURS]
    looks, colours = {}, {OURS: style.INK} | dict(zip(timed, COLOURS, strict=False))
    for name, kind in dict.fromkeys(zip(rows.engine, rows.integrator, strict=True)):
        ours, colour = name == OURS, colours.get(name, NEUTRAL)
        if ours and kind in style.EXACT_STEPS:
            colour = style.of(kind)["color"]
        kinds = METHODS if ours else tuple(getattr(ENGINES.get(name), "integrators", ()))
        marker = MARKERS[kinds.index(kind) % len(MARKERS)] if kind in kinds else "none"
        text = style.label(kind) if ours else f"{name}, {kind}"
        looks[name, kind] = {"color": colour, "label": style.plain(text), "marker": marker, "markersize": 3.0}
    return looks


@of_part(failed=True)
def _draw_steps(rows: pd.DataFrame, style):
    """The bench and the best of each engine."""
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
    best = "Blue and black: the exact step and methods of this bench; other colours: the best integrator or settings of engines"
    which = "Methods of this bench; no engine ran here" if rows.engine.eq(OURS).all() else best
    same = rows[rows.engine.ne(OURS) & rows.status.eq("done")].groupby(["case", "h"]).position.agg(["min", "max"])
    if (apart := (same["max"] / same["min"]).max()) > ORDERS_APART:
        fig.headline = (
            f"At the same step the errors of engines differ by factors of up to {show(10.0 ** int(np.log10(apart)))}"
        )
    fig.caption = (
        "Error of the centre of mass at the end against the step, and against the wall time of the whole run on one core; down "
        f"and left is better. {which}. Crosses: steps at which an engine gave up."
    )
    return fig


EQUAL = 0.05  # relative: errors that differ by less with all steps are of one family


def families(rows: pd.DataFrame) -> list[list[tuple[str, str, pd.Series]]]:
    """Engines and integrators whose errors on `slow` are equal, with these errors by step; the largest families first."""
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
    """Error against step, a colour for each family."""
    found = [family for family in families(rows) if len(family[0][2]) > 1]
    if not found:
        return None
    fig, ax = style.figure("page", 4.6)
    colours = iter(COLOURS)
    for family in found:
        text = ", ".join(dict.fromkeys(name for name, _, _ in family))
        colour = next(colours, None) if len(family) > 1 else None
        for name, kind, error in family:
            look = {"color": colour or NEUTRAL, "linewidth": 1.4 if colour else 0.6, "marker": "o", "markersize": 3.0}
            label = style.plain(text) if colour and error is family[0][2] else "_thin"
            ax.loglog(error.index, error.clip(lower=1e-16), label=label, gid=style.title(f"{name}, {kind}"), **look)
    ax.set(xlabel="step, s", ylabel="error of position, m", title=f"slow, t = {UNTIL:g} s")
    style.legend_below(fig)
    if (many := len({name for name, _, _ in found[0]})) > 1:
        fig.headline = f"One formula has many names: {many} programs are off by the same amount at every step"
    fig.caption = (
        "Error of the centre of mass against the step. A colour is a family of programs whose numbers agree within "
        f"{EQUAL:.0%}: the same formula under different names. Grey: numbers that only one program has. Lines that end level "
        "follow another motion, or have met the round-off of single precision."
    )
    return fig


@of_part()
def _draw_racket(rows: pd.DataFrame, style):
    """When the racket turns over, by engine."""
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
        fig.headline = f"In {never} of {good.engine.nunique()} programs the body does not turn over, with some settings"
    fig.caption = (
        "A free body that starts beside its middle axis must turn over. Without the gyroscopic torque it never does, whatever "
        f"the step: these marks stand at {RACKET.until:g} s."
    )
    return fig


draw = drawn(steps=_draw_steps, families=_draw_families, racket=_draw_racket)
