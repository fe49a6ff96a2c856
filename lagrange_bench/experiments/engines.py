"""The heavy top and free bodies in multibody codes and engines

How well do programs follow a spinning body? Each integrator of each program follows the centre of mass and the rotation of two
heavy tops for 2 s: `bruels`, the usual test of multibody codes with 300 rad of spin, and `slow`, with a fifteenth of the spin.
It follows the rotation of two free bodies for 5 s: `box`, which tumbles, and `racket`, which starts beside its middle axis and
must turn over. Errors are measured against the exact solution. `bruels` is a stress test: engines are made for slower motions,
contacts and many bodies, and nothing of that is measured here. Methods of this bench follow the same bodies; one of them,
`backlund`, is the exact step of a top, with the attitude.

Rows of the sweep have steps of 2 s over powers of two, errors at the end, and times. A whole run is timed without its set-up
(`backlund` with it), on one core; the least of a few repeats counts. The overhead is the time of as many steps of a mass on a
rail: the work of the program apart from the top, with the loop over the steps if that is in Python. The other rows have the
steps of games and robots, more columns, and no times.

A program without any choice has its “default” setting. Its documentation advises the “recommended” one. The “best” setting is
more accurate by the documentation, has the highest order or accuracy on offer, or was measured to be better; the comment above
ENGINES in `experiments/programs.py` says which.

Programs are no part of the bench. In the clone `pip install '.[engines]'` brings MuJoCo and Exudyn; the others install by the
names in ENGINES. `make web` installs the engines of the web and runs them. Cells of a missing program are skipped.
"""

import re
from datetime import UTC, datetime
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments import adapters
from lagrange_bench.experiments.engine_figures import draw as draw
from lagrange_bench.experiments.engine_figures import tables as tables
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import rounded
from lagrange_bench.experiments.programs import AXIS, BODIES, ENGINES, OURS, POWERS, RECOMMENDED, UNTIL, Engine
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array, StepError

VERSION = 1
MEASURED = {"": ("rotation",)}  # a run whose numbers become infinite fails
TIMES = ("version", "date")  # not compared by `verify`, as times are not
STEPS = (1 / 60, 1 / 240, 1 / 1024, 1 / 4096)  # s
ROWS = 512  # most rows of a run: they are the resolution of `until`
NEAR = 0.1  # largest error that is near: m for the centre of mass of a top, rad for the rotation of a free body
REPEATS, ENOUGH = 5, 0.5  # most runs of a cell; none is added once there are two and they took ENOUGH seconds together


def cells(profile: str) -> list[dict]:
    """The quick profile has the sweep of the methods of the bench alone: it never needs an engine."""
    full = profile == "full"
    sweep, others = [], []
    for name, engine in ENGINES.items() if full else [(OURS, ENGINES[OURS])]:
        for kind, how in engine.integrators.items():
            who = {"engine": name} | ({"method": kind} if name == OURS else {"integrator": kind, "setting": how})
            if engine.timed and how != RECOMMENDED:
                steps = [(case, k) for case, powers in POWERS.items() for k in (powers if full else powers[:-2:2])]
                sweep += [{"timing": True, "case": case, **who, "h": UNTIL / 2**k} for case, k in steps]
            bodies = POWERS if kind == "backlund" else BODIES  # POWERS has the tops
            others += [{"case": case, **who, "h": h} for case in bodies for h in STEPS if full and h >= engine.least]
    return sweep + others


def missing_package(cell: dict) -> str | None:
    """The package that a cell needs, if it is not installed here in the right version."""
    engine = ENGINES.get(cell.get("engine", ""))
    return None if engine is None or engine.version else engine.needs


def followed(
    engine: Engine, case: Case, kind: str, h: float, steps: int, every: int, rail: bool = False
) -> tuple[float, list[Any]]:
    """The time of a run in s without its set-up, and its rows. StepError: the engine refuses, or its numbers are not finite."""
    run = engine.start(engine.load(), adapters.Body.of(case), kind, h, *([True] if rail else []))
    who = f"{engine.package} {kind}"
    begin = perf_counter()
    try:
        rows = list(run(steps, every))
    except StepError:
        raise
    except Exception as error:  # an engine that raises here refuses the run: this is a result
        raise StepError(who, re.split(r"\n|\. ", str(error).strip())[0]) from error
    seconds = perf_counter() - begin
    for n, row in enumerate(rows, 1):
        if not all(np.isfinite(part).all() for part in row):
            raise StepError(who, f"its numbers are not finite after {n * every * h:.3g} s")
    return seconds, rows


def timed(engine: Engine, case: Case, kind: str, h: float, steps: int, rail: bool) -> tuple[float, Any]:
    """The least time of a run in s, and the row at its end."""
    samples: list[float] = []
    while len(samples) < 2 or (len(samples) < REPEATS and sum(samples) < ENOUGH):
        seconds, end = followed(engine, case, kind, h, steps, steps, rail)
        samples.append(seconds)
    return min(samples), end


def errors(case: Case, t: Array, rows: list[Any]) -> dict[str, Any]:
    """The errors of the last of the rows at times t (N,), the time up to which rows are NEAR, and the precision of the numbers.

    position : m, for a top only. rotation : rad. spin : rad/s, error of the angular velocity about AXIS. energy : its change,
    relative to the start. energy_growth : exponent p of its growth like t^p; NaN if it stays at round-off. until : s, the first
    time at which a row is not NEAR, or the end. turns_over : s, for a free body, the time at which its angular velocity about
    AXIS changes sign; NaN if it never does.
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
    floor = 4 * np.finfo(np.float32 if single else np.float64).eps  # round-off of an energy in this precision
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
    row = {name: row[name] for name in ("position", "rotation")} | when
    row["ns_per_step"] = rounded(seconds / steps * 1e9)
    if cell["engine"] != OURS:
        row["overhead_ns_per_step"] = rounded(timed(engine, case, kind, h, steps, rail=True)[0] / steps * 1e9)
    return [row]
