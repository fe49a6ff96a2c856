"""Runs a body in a program: `followed` in Python; or as a CSV file, which `lagrange-bench judge` reads:

    python -m lagrange_bench.experiments.engines.follow mujoco RK4 0.001 2000 1 slow > run.csv
    lagrange-bench judge run.csv --case slow --omega world

The words are a file NAME_run.py of this folder, an integrator of the program, the step (s), the number of steps, the steps
between two rows, and a body. The file has a function `run` of a `Body` and the four words between. Its rows, from the start on,
are the centre of mass (m), the rotation from body to world, and the angular velocity in the world (rad/s). Rotations are
quaternions with the scalar last, or matrices, row by row. All numbers are the program's own, so their precision can be seen.
"""

import csv
import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.experiments.engines.programs import BODIES, WEB
from lagrange_bench.integrators.cases import Case
from lagrange_bench.integrators.interface import Array, StepError

QUATERNION = ("qx", "qy", "qz", "qw")
MATRIX = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")


class Body(NamedTuple):
    """The body of a case and its start, without a rotation, as lists of numbers in SI units.

    is_free : no weight, and no fixed point; else a ball joint at the origin. moments : about the centre of mass, com.
    omega : angular velocity. velocity : of the centre of mass.
    """

    case: Case
    is_free: bool
    mass: float
    moments: list[float]
    com: list[float]
    gravity: list[float]
    omega: list[float]
    velocity: list[float]

    @classmethod
    def of(cls, case: Case) -> "Body":
        body, omega = case.body, np.asarray(case.omega_body, dtype=float)
        com, gravity = np.asarray(body.com, dtype=float), np.asarray(body.gravity, dtype=float)
        numbers = (np.diag(body.inertia_com), com, gravity, omega, np.cross(omega, com))
        return cls(case, not (com.any() or gravity.any()), float(body.mass), *(each.tolist() for each in numbers))


def rows_of(name: str, body: Body, integrator: str, h: float, steps: int, every: int) -> Iterator[Any]:
    """The rows of a run, from the start on. name : of NAME_run.py, or of web/NAME.mjs."""
    if not name.startswith("web/"):
        run = importlib.import_module(f"lagrange_bench.experiments.engines.{name}_run").run
        yield from run(body, integrator, h, steps, every)
        return
    facts = {key: value for key, value in body._asdict().items() if key != "case"}
    words = (name.removeprefix("web/"), integrator, repr(h), str(steps), str(every), json.dumps(facts))
    done = subprocess.run(["node", "follow.mjs", *words], cwd=WEB, capture_output=True, text=True, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "Error" in line]
        raise RuntimeError(errors[0] if errors else f"node ended with {done.returncode}")
    yield from np.loadtxt(done.stdout.splitlines(), delimiter=",", skiprows=1, ndmin=2)[:, 1:]


def followed(
    run: str, package: str, case: Case, integrator: str, h: float, steps: int, every: int
) -> tuple[float, Array]:
    """The time of a run without its set-up (s), and its rows (N, 10) or (N, 15).

    StepError: the program raises, which is a result, too; or its numbers are not finite.
    """
    who = f"{package} {integrator}"
    try:
        rows = rows_of(run, Body.of(case), integrator, h, steps, every)
        start = next(rows)
        begin = perf_counter()
        others = list(rows)
        seconds = perf_counter() - begin
    except StepError:
        raise
    except Exception as error:
        raise StepError(who, re.split(r"\n|\. ", str(error).strip())[0]) from error
    states = np.array([start, *others], dtype=float)
    bad = np.flatnonzero(~np.isfinite(states).all(axis=1))
    if len(bad):
        raise StepError(who, f"its numbers are not finite after {bad[0] * every * h:.3g} s")
    return seconds, states


if __name__ == "__main__":
    name, integrator, h, steps, every, body = sys.argv[1:]
    rows = rows_of(name, Body.of(BODIES[body]), integrator, float(h), int(steps), int(every))
    table = csv.writer(sys.stdout)
    for n, row in enumerate(rows):
        if n == 0:
            table.writerow(("t", "x", "y", "z", *(QUATERNION if len(row) == 10 else MATRIX), "wx", "wy", "wz"))
        table.writerow((n * int(every) * float(h), *map(float, row)))
