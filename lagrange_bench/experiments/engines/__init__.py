"""The heavy top and free bodies in multibody codes and engines

How well do programs follow a spinning body? Each integrator of each program follows the centre of mass and the rotation of two
heavy tops for 2 s: `bruels`, the usual test of multibody codes with 300 rad of spin, and `slow`, with a fifteenth of the spin.
By default and as its documents advise, it follows the rotation of `racket`, a free body that starts beside its middle axis and
must turn over, for 5 s. Releases of MuJoCo follow `box`, which tumbles. Errors are measured against the exact solution. `bruels`
is a stress test: engines are made for slower motions, contacts and many bodies, and nothing of that is measured here. Methods of
this bench follow the same tops; one of them, `backlund`, is the exact step of a top, with the attitude.

Rows of the sweep have steps of 2 s over powers of two, errors at the end, and times. A whole run is timed without its set-up
(`backlund` with it), on one core; the least of a few repeats counts. The other rows have the steps of games and robots, more
columns, and no times.

A file of this folder runs each program, as one who uses it would: body and start in, rows out. `follow` calls it, and `judge`
measures the rows, as it measures the file of any program. `programs.toml` lists programs and settings, and says what the settings
are. Programs are no part of the bench: in the clone `pip install '.[engines]'` brings MuJoCo and Exudyn, the others install by
the names in that list. `make web` installs the engines of the web and runs them. Cells of a missing program are skipped.
"""

from datetime import UTC, datetime
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments.engines.figures import draw as draw
from lagrange_bench.experiments.engines.figures import tables as tables
from lagrange_bench.experiments.engines.follow import followed
from lagrange_bench.experiments.engines.programs import (
    AXIS,
    BEST,
    BODIES,
    DEFAULT,
    ENGINES,
    OURS,
    POWERS,
    RECOMMENDED,
    UNTIL,
)
from lagrange_bench.experiments.measuring.states import rounded
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array
from lagrange_bench.judging import judge

VERSION = 1
MEASURED = {"": ("rotation",)}  # a run whose numbers become infinite fails
TIMES = ("version", "date")  # not compared by `verify`, as times are not
STEPS = (1 / 60, 1 / 240, 1 / 1024, 1 / 4096)  # s
LEAST_OF_RACKET = 1 / 1024  # s: whether it turns over is clear by then
RELEASED = "implicitfast"  # the integrator that releases of MuJoCo changed: only it follows `box`
ROWS = 512  # most rows of a run: they are the resolution of `until`
NEAR = 0.1  # largest error that is near: m for the centre of mass of a top, rad for the rotation of a free body
REPEATS, ENOUGH = 5, 0.5  # most runs of a cell; none is added once there are two and they took ENOUGH seconds together


def cells(profile: str) -> list[dict]:
    """The quick profile has the sweep of the methods of the bench alone: it never needs an engine."""
    full = profile == "full"
    sweep, others = [], []
    for name, engine in ENGINES.items() if full else [(OURS, ENGINES[OURS])]:
        for kind, setting in engine.integrators.items():
            who = {"engine": name}
            who |= {"method": kind} if name == OURS else {"integrator": kind, "setting": setting}
            if engine.timed and setting != RECOMMENDED:
                steps = [(case, k) for case, powers in POWERS.items() for k in (powers if full else powers[:-2:2])]
                sweep += [{"timing": True, "case": case, **who, "h": UNTIL / 2**k} for case, k in steps]
            if not full:
                continue
            others += [{"case": "slow", **who, "h": h} for h in STEPS if h >= engine.least]
            if setting in (DEFAULT, BEST):
                others += [{"case": "racket", **who, "h": h} for h in STEPS if h >= max(engine.least, LEAST_OF_RACKET)]
            if kind == RELEASED:
                others.append({"case": "box", **who, "h": STEPS[0]})
    return sweep + others


def missing_package(cell: dict) -> str | None:
    """The package that a cell needs, if it is not installed here in the right version."""
    engine = ENGINES.get(cell.get("engine", ""))
    return None if engine is None or engine.version else engine.needs


def measure(cell: dict) -> list[dict]:
    engine, case, h = ENGINES[cell["engine"]], BODIES[cell["case"]], cell["h"]
    kind, steps = cell.get("method") or cell["integrator"], round(case.until / h)
    every = steps if cell.get("timing") else -(-steps // ROWS)
    samples: list[float] = []
    repeats = REPEATS if cell.get("timing") else 1
    while len(samples) < min(2, repeats) or (len(samples) < repeats and sum(samples) < ENOUGH):
        seconds, rows = followed(engine.run, engine.package, case, kind, h, steps, every)
        samples.append(seconds)
    row = errors(case, np.arange(len(rows)) * every * h, rows)
    if cell.get("timing"):
        row = {name: row[name] for name in ("position", "rotation")}
        row["ns_per_step"] = rounded(min(samples) / steps * 1e9)
    return [row | {"version": engine.version or "", "date": datetime.now(UTC).date().isoformat()}]


def errors(case: Case, t: Array, rows: Array) -> dict[str, Any]:
    """The errors of the last row, the time up to which rows are NEAR, and the precision of their numbers.

    Parameters
    ----------
    t : (N,), s, from 0 on. rows : (N, 10) or (N, 15), of `follow`.

    Returns
    -------
    position : m, for a top only. rotation : rad. spin : rad/s, error of the angular velocity about AXIS. energy : its change,
    relative to the start. until : s, the first time at which a row is not NEAR, or the end. turns_over : s, for a free body, the
    time at which its angular velocity about AXIS changes sign; NaN if it never does.
    """
    place, rotation, omega = rows[:, :3], rows[:, 3:-3], rows[:, -3:]
    is_single = bool(np.all(rotation.astype(np.float32) == rotation))
    turns = Rotation.from_quat(rotation) if rotation.shape[1] == 4 else Rotation.from_matrix(rotation.reshape(-1, 3, 3))
    is_top = bool(np.any(case.body.com))
    judged = judge(t, place if is_top else None, turns, omega, case=case, omega_frame="world")
    row: dict[str, Any] = {"position": rounded(judged.position.end)} if is_top else {}
    row["rotation"] = rounded(judged.rotation.end)
    in_body = turns.apply(omega, inverse=True)
    row["spin"] = rounded(in_body[-1, AXIS] - case.solution(t[-1:]).omega_body[0, AXIS])
    energy = case.body.energy_of(turns, in_body) / case.solution([0.0]).energy[0] - 1.0
    row["energy"] = rounded(energy[-1])
    times, error = judged.curves["position" if is_top else "rotation"]
    far = np.flatnonzero(~(error <= NEAR))
    row |= {"until": rounded(times[far[0]] if len(far) else case.until)}
    row |= {"precision": "single" if is_single else "double"}
    if not is_top:
        over = np.flatnonzero(in_body[:, AXIS] < 0)
        row["turns_over"] = rounded(t[over[0]]) if len(over) else np.nan
    return row
