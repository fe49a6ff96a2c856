"""`judge`: how far the trajectory of any program is from the exact motion of a rigid body."""

from __future__ import annotations  # signatures show names of types, not what they stand for

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES, Case, RigidBody, registry
from lagrange_bench.integrators.cases import read_case
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.judging.advice import findings_of, so_read
from lagrange_bench.judging.columns import FileTrajectory, read
from lagrange_bench.judging.frames import ATTITUDES, GROUPS, Frames, Options, blurred, curve, hidden
from lagrange_bench.judging.judgement import Error, Judgement
from lagrange_bench.judging.start import started

Array = np.ndarray
Values = ArrayLike | None
Floors = Mapping[str, float]
STARTS = ("case", "first-row", "fit")
# relative to the size of a quantity: more than that is another start, in doubles and in single precision
START, SINGLE = 1e-9, 2e-7
# likewise: a start that is off by more is none of the case
RIGHT = 0.05
UNEXPLAINED = "No usual mistake explains this start: are the columns what they are taken for?"
UNEXPLAINED += " If the run starts elsewhere: --start first-row."


class Request(NamedTuple):
    """The motion that rows are compared with. start : one of STARTS; None if only the body counts."""

    case: Case
    start: str | None


def judge(
    t: ArrayLike | str | Path,
    position: Values = None,
    rotation: Values | Rotation = None,
    omega: Values = None,
    *,
    case: str | Case | None = None,
    body: str | Case | RigidBody | None = None,
    start: str = "case",
    quat: str | None = None,
    omega_frame: str | None = None,
    up: str | None = None,
    axis: str | None = None,
    **written: Any,
) -> Judgement:
    """Judge the trajectory of a rigid body by its exact motion; at least one of position, rotation and omega.

        judge(t, position=x, rotation=R, case="bruels").rotation.max
        judge("run.csv", case="bruels").findings

    Parameters
    ----------
    t : (N,), str or path
        In s, increasing. Or a file, which has all the rest.
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
    start : {"case", "first-row", "fit"}
        Where the exact motion starts: as the case does; as the first row does, which then needs a rotation and omega, or omega
        alone of a free body; or so that it fits the first rows best.
    quat : {"wxyz", "xyzw"}
        The order of the quaternions; "wxyz" if no name in a file says another one.
    omega_frame : {"body", "world"}
        The frame of omega; "body" if no name in a file says another one. Its error is measured in the same frame.
    up : str, optional
        The axis that points up in the world of these numbers, such as "y" or "-z"; by default as in the case. The smallest
        turn leads to it; where that is half a turn, it is about x.
    axis : str, optional
        The axis of symmetry in the body of these numbers, likewise.
    **written
        How a file is written: columns, units, angles, where, step, t0, since, until, as the options of `lagrange-bench judge`.

    Returns
    -------
    Judgement
        The largest and the last error of each quantity; `findings`, `notes` and `start` say what may be wrong.

    Raises
    ------
    ValueError
        Other shapes, times that do not increase, a name that is not known.
    """
    request, options = request_of(case, body, start), Options(quat=quat, omega_frame=omega_frame, up=up, axis=axis)
    if isinstance(t, str | Path):
        if position is not None or rotation is not None or omega is not None:
            raise ValueError("a file has its own positions, rotations and ω")
        return judge_file(Path(t), request, replace(options, **written))
    if written:
        raise ValueError(f"{next(iter(written))} is for files")
    return _judged(request, options, _of_arrays(t, position, rotation, omega))


def judge_file(path: Path, request: Request, options: Options) -> Judgement:
    """The judgement of a file. options : what the user says of it."""
    case = request.case
    try:
        track = read(path, options, case.points, case.body.com if case.body.fixed else (0, 0, 0))
        judgement = _judged(request, options, track)
    except (ValueError, EOFError) as error:
        raise ValueError(f"{path}: {error}") from None
    return replace(judgement, file=str(path), notes=[*track.notes, *judgement.notes], columns=track.columns)


def request_of(case: str | Case | None, body: str | Case | RigidBody | None, start: str) -> Request:
    """A case, or the body of one; ValueError unless it is one of the two."""
    if (case is None) == (body is None):
        raise ValueError("give a case, or a body without a start; one of the two")
    if start not in STARTS:
        raise ValueError(f"start must be one of {', '.join(STARTS)}; got {start!r}")
    if body is not None and start != "case":
        raise ValueError(f"a body without a start is not followed: for --start {start} give a case")
    if kinds.rigid_body(body):
        return Request(Case("body", body, np.eye(3), np.zeros(3)), None)  # type: ignore[arg-type]
    known = case is not None and start == "case"
    return Request(find(case if body is None else body, known), start if body is None else None)  # type: ignore[arg-type]


def find(case: str | Case, start: bool = True) -> Case:
    """The case of this name; or one's own, as a Case, as module:NAME, or in a TOML file, which may lack the start."""
    if isinstance(case, (str, Path)) and Path(case).suffix == ".toml":
        return read_case(Path(case), start)
    if isinstance(case, str) and ":" in case:
        return registry.find(case, registry.Registry("case", Case, {}))
    if not isinstance(case, str | Case):
        raise ValueError(f"case must be a name or a Case; got {case!r}")
    try:
        return CASES[case] if isinstance(case, str) else case
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def _of_arrays(
    t: ArrayLike, position: ArrayLike | None, rotation: ArrayLike | Rotation | None, omega: ArrayLike | None
) -> FileTrajectory:
    """The rows of arrays; what is masked is missing."""
    times: Array = np.ma.filled(np.ma.asarray(t, dtype=float), np.nan).ravel()
    n = len(times)
    if n == 0 or (position is None and rotation is None and omega is None):
        raise ValueError("give times and at least one of position, rotation and omega")
    if isinstance(rotation, Rotation):
        rotation = rotation.as_matrix()
    arrays = {"time": times[:, None]}
    for name, array, shapes in (
        ("position", position, [(n, 3)]),
        ("rotation", rotation, [(n, 3, 3), (n, 4)]),
        ("omega", omega, [(n, 3)]),
    ):
        if array is not None:
            values: Array = np.ma.filled(np.ma.asarray(array, dtype=float), np.nan)
            if values.shape not in shapes:
                raise ValueError(f"{name} must have the shape {' or '.join(map(str, shapes))}; got {values.shape}")
            kind = name if name != "rotation" else ATTITUDES[values.ndim - 2]
            arrays[kind] = values.reshape(n, -1)
    return FileTrajectory(arrays, times - times[0])


def _judged(request: Request, options: Options, track: FileTrajectory) -> Judgement:
    """The judgement of rows. What the user does not say, the names of columns do, or it is as usual."""
    frame = options.omega_frame or track.frame or ("world" if "momentum" in track.arrays else "body")
    options = replace(options, quat=track.quat or options.quat or "wxyz", omega_frame=frame)
    is_case, floor, notes = request.start == "case", track.floor, list[str]()
    written, case = track.arrays["time"][:, 0], request.case
    rows = {**track.arrays, "time": (written if is_case else track.elapsed)[:, None]}
    _check_times(rows["time"][:, 0], written)
    with np.errstate(all="ignore"):
        frames = Frames(case.body, options, floor.get("matrix", 0.0), case if is_case else None)
        rows = frames.with_omega(rows)
        if not is_case:
            frames.refer(rows)
        findings, remark = findings_of(frames, rows, track)
        if request.start in ("first-row", "fit"):
            case, text = started(request.start, case, frames, rows)
            notes.append(f"The motion starts at t = {written[0]:.9g} s {text}.")
            frames = Frames(case.body, options, frames.digit, case)
        errors, exact, clock = frames.by_the_better_clock(rows)
        remark, t = so_read(frames, rows, errors, findings) if findings else remark, rows["time"][:, 0]
        if not errors:
            raise ValueError("a body without a start is judged by rotations with ω, by ω in the body, or by positions")
        turned, rounding = frames.count_turns(rows, exact), floor.get("time", 0.0)
        blur = blurred(t, exact, rounding) if exact is not None and rounding else {}
    measured = {name: Error(float(error.max()), float(error[-1])) for name, error in errors.items()}

    def floors_of(known: Floors) -> dict[str, float]:
        return {name: 2 * value for name, value in hidden(known).items() if value > 0 and name in errors}

    floors = floors_of(floor)
    unseen = {name: value for name, value in blur.items() if name in errors and value > floors.get(name, 0.0)}
    notes = [*_odd_rows(t, errors, frames.known_until), *clock, *notes]
    if max(-t[0], t[-1]) > frames.known_until:
        after = f"rows after t = {written[0] - t[0] + frames.known_until:.6g} s are not compared."
        notes.append(f"No closed form is known of this motion: {after}")
    if shown := [name for name, value in unseen.items() if not measured[name].max > 100 * value]:
        notes.append(f"The times are rounded by {floor['time']:.1e} s, which hides errors of {', '.join(shown)}.")
    if not set(errors) - {"length", "orthogonality"}:
        notes.append("There is neither a rotation nor ω: nothing but lengths is judged.")
    start: dict[str, Any] = {}
    if is_case:
        off = {name: float(errors[name][0]) for name in GROUPS if name in errors}
        start = {"t": float(written[0]), **off}
        for word, least in (("right", START), ("single", SINGLE)):
            start[word] = frames.starts(off, least, floors_of(track.first_floor)) if t[0] == 0 else None
    judged = Judgement(
        case=case.name,
        rows=len(t),
        span=(float(written[0]), float(written[-1])),
        errors=measured,
        start=start,
        floor={**floors, **unseen},
        findings=findings,
        remark=remark,
        notes=notes,
        curves={name: curve(t, error) for name, error in errors.items()},
        turns=turned,
        sizes=frames.sizes,
    )
    if is_case:
        if judged.ends_before(case.until):
            judged.notes.insert(0, f"The last row is at t = {written[-1]:.9g} s; the case runs to {case.until:g} s.")
        if t[0] == 0 and not findings and any(error > RIGHT * frames.sizes[name] for name, error in off.items()):
            judged.notes.append(UNEXPLAINED)
    return judged


def _check_times(t: Array, written: Array) -> None:
    wrong = np.flatnonzero(~(np.diff(t, prepend=-math.inf) > 0) | ~np.isfinite(t))
    if len(wrong):
        i = int(wrong[0])
        before = f" after {written[i - 1]:.12g}" if i else ""
        raise ValueError(f"row {i + 1}: the time is {written[i]:.12g}{before}; times must be numbers that increase")


def _odd_rows(t: Array, errors: Mapping[str, Array], known_until: float) -> Iterator[str]:
    """Notes on what is odd about rows."""
    bad = ~np.all([np.isfinite(error) for error in errors.values()], axis=0) & (np.abs(t) <= known_until)
    if count := int(np.count_nonzero(bad)):
        odd = "a number that is missing or not finite, a matrix or quaternion that is no rotation, or a position of length 0"
        yield f"{count} of {len(t)} rows have {odd}, the first at t = {t[bad][0]:.9g}."
    if "orthogonality" in errors and (off := errors["orthogonality"].max()) > 1e-3:
        yield f"Matrices are not orthogonal or quaternions not of length 1, by {off:.2g}; quaternions are scaled to 1."
