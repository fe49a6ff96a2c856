"""`judge`: how far the trajectory of any program is from the exact motion of a rigid body."""

from __future__ import annotations  # signatures show names of types, not what they stand for

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES, Case, RigidBody, StepError, registry
from lagrange_bench.integrators.cases import read_case
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.judging import columns, row_blocks, values
from lagrange_bench.judging.consistency import Rows, rate_notes
from lagrange_bench.judging.frames import ATTITUDES, GROUPS, Convention, Exact, Frames
from lagrange_bench.judging.hints import CLOCKS, RIGHT, SINGLE, START, Hints, find_hints, own_hints
from lagrange_bench.judging.judgement import Judgement

Array = np.ndarray
Floors = Mapping[str, float]
UNEXPLAINED = "are the columns what they are taken for? If the run starts elsewhere: --start first-row."


class Request(NamedTuple):
    """The motion that rows are compared with. start : "case"; "first-row"; None if only the body counts."""

    case: Case
    start: str | None


def judge(
    t: ArrayLike,
    position: ArrayLike | None = None,
    rotation: ArrayLike | Rotation | None = None,
    omega: ArrayLike | None = None,
    *,
    case: str | Case | None = None,
    body: str | Case | RigidBody | None = None,
    start: str = "case",
    quat: str = "wxyz",
    omega_frame: str = "body",
    up: str | None = None,
    axis: str | None = None,
) -> Judgement:
    """Judge the trajectory of a rigid body by its exact motion; at least one of position, rotation and omega.

        judge(t, position=x, rotation=R, case="bruels").rotation.max

    Parameters
    ----------
    t : (N,)
        In s, increasing.
    position : (N, 3), optional
        In m, of the centre of mass.
    rotation : Rotation of N, (N, 3, 3) or (N, 4), optional
        From body to world: matrices or quaternions.
    omega : (N, 3), optional
        In rad/s.
    case : str or Case
        A name, see `CASES`, or a case of your own.
    body : str, Case or RigidBody
        In place of a case: nothing is known of the start. Conserved quantities are compared with the first row, and the rows with
        each other.
    start : {"case", "first-row"}
        Where the exact motion starts: as the case does, or as the first row does, which then needs a rotation and omega.
    quat : {"wxyz", "xyzw"}
        The order of the quaternions.
    omega_frame : {"body", "world"}
        The frame of omega. Its error is measured in the same frame.
    up : str, optional
        The axis that points up in the world of these numbers, such as "y" or "-z"; by default as in the case. The smallest
        turn leads to it; where that is half a turn, it is about x.
    axis : str, optional
        The axis of symmetry in the body of these numbers, likewise.

    Returns
    -------
    Judgement
        The largest and the last error of each quantity; `hints`, `notes` and `start` say what may be wrong.

    Raises
    ------
    ValueError
        Other shapes, times that do not increase, a name that is not known.
    """
    trajectory: dict[str, Array] = {"time": np.asarray(t, dtype=float).ravel()[:, None]}
    n = len(trajectory["time"])
    if n == 0 or (position is None and rotation is None and omega is None):
        raise ValueError("give times and at least one of position, rotation and omega")
    if isinstance(rotation, Rotation):
        rotation = rotation.as_matrix()
    for name, array, shapes in (
        ("position", position, [(n, 3)]),
        ("rotation", rotation, [(n, 3, 3), (n, 4)]),
        ("omega", omega, [(n, 3)]),
    ):
        if array is not None:
            values = np.asarray(array, dtype=float)
            if values.shape not in shapes:
                raise ValueError(f"{name} must have the shape {' or '.join(map(str, shapes))}; got {values.shape}")
            kind = name if name != "rotation" else ATTITUDES[values.ndim - 2]
            trajectory[kind] = values.reshape(n, -1)

    blocks = partial(row_blocks.of_arrays, trajectory)
    return _judged(request_of(case, body, start), Convention(quat, omega_frame, up, axis), blocks, {}, {})


def judge_file(path: Path, what: Request, convention: Convention, how: columns.Options) -> Judgement:
    """The judgement of a file. what : the motion to compare it with. how : the file is written like this."""
    try:
        layout, way = columns.survey(path, how), ""
        angles, quat = layout.how.angles or convention.angles, layout.quat or convention.quat
        if layout.quat == "wxyz":  # by names: --quat has no effect there
            w, x, y, z = layout.groups["quaternion"]
            way = f"--columns qw={z},qx={w},qy={x},qz={y}"
        blocks, convention = partial(values.blocks, layout), replace(convention, angles=angles, quat=quat)
        judgement = _judged(what, convention, blocks, layout.floor, layout.first_floor, way)
    except (ValueError, EOFError, StepError) as error:
        clock = "; perhaps the times are no seconds, or start elsewhere: --units t=ns, --t0 0"
        raise ValueError(f"{path}: {error}{clock * isinstance(error, StepError)}") from None
    return replace(judgement, file=str(path), notes=[*layout.notes, *judgement.notes], columns=layout.columns)


def request_of(case: str | Case | None, body: str | Case | RigidBody | None, start: str) -> Request:
    """A case, or the body of one; ValueError unless it is one of the two."""
    if (case is None) == (body is None):
        raise ValueError("give a case, or a body without a start; one of the two")
    if start not in ("case", "first-row"):
        raise ValueError(f"start must be case or first-row; got {start!r}")
    if body is not None and start != "case":
        raise ValueError("a body without a start is not followed: for --start first-row give a case")
    if kinds.rigid_body(body):
        return Request(Case("body", body, np.eye(3), np.zeros(3)), None)  # type: ignore[arg-type]
    known = case is not None and start == "case"
    return Request(find(case if body is None else body, known), start if body is None else None)  # type: ignore[arg-type]


def find(case: str | Case, start: bool = True) -> Case:
    """The case of this name; or one's own, as a Case, as module:NAME, or in a TOML file, which may lack the start."""
    if isinstance(case, (str, Path)) and Path(case).suffix == ".toml":
        return read_case(Path(case), start)
    if isinstance(case, str) and ":" in case:
        return registry.find(case, registry.Registry("case", {}, "lagrange_bench.integrators:Case"))  # type: ignore[no-any-return]
    if not isinstance(case, str | Case):
        raise ValueError(f"case must be a name or a Case; got {case!r}")
    try:
        return CASES[case] if isinstance(case, str) else case
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def _from_first_row(case: Case, frames: Frames, trajectory: Mapping[str, Array]) -> Case:
    """The case with the start that the first row has; a flying body gets the velocity that fits all positions best."""
    first = {name: rows[:1] for name, rows in trajectory.items()}
    R, omega = frames.motion(first)
    if omega is None or not frames.attitudes(first) or not np.all(np.isfinite(R)) or not np.all(np.isfinite(omega)):
        raise ValueError("--start first-row: the first row needs a rotation and an angular velocity")
    flight = {} if case.body.fixed else dict(zip(("position", "velocity"), np.nan_to_num(frames.launch), strict=True))
    return replace(case, rotation=Rotation.from_matrix(R[0]), omega_body=omega[0], **flight, exact={})


def _judged(
    what: Request, convention: Convention, blocks: row_blocks.Blocks, floor: Floors, first_floor: Floors, way: str = ""
) -> Judgement:
    """The judgement of a trajectory.

    floor, first_floor : for each group of columns, the error that the digits of the file and of its first row hide. way : the
    option that takes quaternions in another order.
    """
    case, own_start = what.case, what.start != "case"
    run, digit = row_blocks.look(blocks), floor.get("matrix", 0.0)
    (first, end), zero = run.span, run.span[0] if own_start else 0.0
    seen = {**run.seen, "time": run.seen["time"] - zero}

    def timed() -> Iterator[dict[str, Array]]:
        for block in blocks():
            yield {**block, "time": (row_blocks.decimals(block["time"]) if run.decimals else block["time"]) - zero}

    with np.errstate(all="ignore"):
        frames = Frames(case.body, convention, digit, None if own_start else case)
        if own_start:
            frames.refer(seen)
        if what.start == "first-row":
            case = _from_first_row(case, frames, seen)
            frames = Frames(case.body, convention, digit, case)
        measured = row_blocks.measure(frames, timed(), run.rows)
        errors = measured.errors
        exact = None if frames.case is None else frames.exact(seen["time"][:, 0])
        known = [error for name, error in frames.errors(seen, exact).items() if name in GROUPS]
        good = np.flatnonzero(np.isfinite(known).all(axis=0))
        rows = frames.rows(next(timed()))
        if own_start:
            hints = own_hints(frames, seen, rows, way)
            if exact is not None and len(good) and not hints:
                hints = Hints(frames, seen, exact, good, way).bodies()
        else:
            assert exact is not None
            hints = find_hints(frames, seen, exact, good, rows, way) if len(good) else []
        if 2 * measured.mirrored > run.rows:
            hints.insert(0, "a row or column of the matrices has the wrong sign: their determinant is negative.")

    def floors_of(known: Floors) -> dict[str, float]:
        worst = {name: 2 * max(known.get(each, 0.0) for each in groups) for name, groups in GROUPS.items()}
        return {name: value for name, value in worst.items() if value > 0 and name in errors}

    floors = floors_of(floor)
    notes = list(_notes(measured, run.rows, frames, rows, hints))
    if max(zero - first, end - zero) > frames.known_until:
        after = f"rows after t = {zero + frames.known_until:.6g} s are not compared."
        notes.append(f"No closed form is known of this motion: {after}")
    if what.start == "first-row":
        notes.append(f"The motion starts as the first row does, at t = {first:.9g} s.")
    if exact is not None and (blur := floor.get("time", 0.0)):
        blurred = _blurred(frames, seen["time"][:, 0], exact, blur)
        if hidden := [name for name in blurred if name in errors and blurred[name] > floors.get(name, 0.0)]:
            floors |= {name: blurred[name] for name in hidden}
            notes.append(f"The times are rounded by {blur:.1e} s, which hides errors of {', '.join(hidden)}.")
    start: dict[str, Any] = {}
    if not own_start:
        off = {name: measured.first[name] for name in GROUPS if name in errors}
        start = {"t": first, **off}
        for word, least in (("right", START), ("single", SINGLE)):
            start[word] = frames.starts(off, least, floors_of(first_floor)) if first == 0 else None
    whole = rows if rows is not None and rows.rows == run.rows else None
    turns = _turns(seen["time"][:, 0], seen.get("omega") if exact is None else exact[2], whole)
    curves, sizes = measured.curves, frames.sizes
    judged = Judgement(case.name, run.rows, run.span, errors, start, floors, hints, notes, curves, turns, sizes)
    if own_start:
        return judged
    if first == 0 and not hints and any(error > RIGHT * frames.sizes[name] for name, error in off.items()):
        judged.notes.append(f"No usual mistake explains this start: {UNEXPLAINED}")
    wrong = judged.leaves or start["right"] is False
    if end - first > 10 * case.until and wrong and not any("--units t=" in hint for hint in hints):
        unit = min(CLOCKS.values(), key=lambda unit: abs(math.log((end - first) * unit[1] / case.until)))[0]
        perhaps = f"perhaps they are no seconds: --units t={unit}"
        judged.notes.insert(0, f"The times go to {end:.9g}, the case to {case.until:g} s: {perhaps}.")
    if judged.ends_before(case.until):
        judged.notes.insert(0, f"The last row is at t = {end:.9g} s; the case runs to {case.until:g} s.")
    return judged


def _turns(t: Array, omega: Array | None, rows: Rows | None) -> float:
    """How often the body turns, ∫|ω| dt/2π; without ω by all attitudes, NaN without either."""
    if omega is not None:
        return float(np.trapezoid(np.linalg.norm(omega, axis=1), t)) / math.tau
    return math.nan if rows is None else float(np.sum(rows.speed() * rows.dt[:, 0])) / math.tau


def _blurred(frames: Frames, t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times change by `blur`."""
    x, _, omega = frames.exact(t + blur)
    moved = {"position": x - exact[0], "rotation": omega * blur, "omega": omega - exact[2]}
    return {name: float(np.linalg.norm(change, axis=1).max()) for name, change in moved.items()}


def _notes(
    measured: row_blocks.Measured, n: int, frames: Frames, rows: Rows | None, hints: Sequence[str]
) -> Iterator[str]:
    """Notes on n rows: what is odd about them, and what attitudes and ω say without an exact motion."""
    if measured.bad:
        what = "a number that is missing or not finite, a matrix or quaternion that is no rotation, or a position of length 0"
        yield f"{measured.bad} of {n} rows have {what}, the first at t = {measured.bad_from:.9g}."
    if "orthogonality" in measured.errors and (off := measured.errors["orthogonality"].max) > 1e-3:
        yield f"Matrices are not orthogonal or quaternions not of length 1, by {off:.2g}; quaternions are scaled to 1."
    if rows is not None:
        yield from rows.notes()
        if rows.omega is not None and frames.axis is not None and not hints:
            yield from rate_notes(rows.t, rows.spin_rate(frames.axis))
