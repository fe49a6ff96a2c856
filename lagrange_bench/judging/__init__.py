"""`judge`: how far the trajectory of any program is from the exact motion of a rigid body."""

from __future__ import annotations  # signatures show names of types, not what they stand for

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES, Case, RigidBody, StepError, registry
from lagrange_bench.integrators.cases import read_case
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.judging.columns import Options, Trajectory, read
from lagrange_bench.judging.consistency import Rows, rate_notes
from lagrange_bench.judging.frames import ATTITUDES, GROUPS, UNITS, Convention, Exact, Frames
from lagrange_bench.judging.hints import CLOCKS, RIGHT, SINGLE, START, Hints, find_hints, own_hints
from lagrange_bench.judging.judgement import Error, Judgement

Array = np.ndarray
Floors = Mapping[str, float]
STARTS = ("case", "first-row", "fit")
UNEXPLAINED = "are the columns what they are taken for? If the run starts elsewhere: --start first-row."
POINTS = 2000  # of a curve
BLOCK = 1 << 16  # rows that are compared at once
HEAD, SOME = 2000, 4000  # the first rows that are looked at for what is wrong, and how many of all others
FITTED = 50  # rows that --start fit takes
# Sums of steps are rounded: times that are as near to decimals of DECIMALS places, relative to the last time, may be these.
DECIMALS, NEAR = 8, 1e-10
# Residuals of a fit are noise if they change from row to row by so much of their size; a smooth error changes less.
NOISE = 0.7


class Request(NamedTuple):
    """The motion that rows are compared with. start : one of STARTS; None if only the body counts."""

    case: Case
    start: str | None


def judge(
    t: ArrayLike | str | os.PathLike[str],
    position: ArrayLike | None = None,
    rotation: ArrayLike | Rotation | None = None,
    omega: ArrayLike | None = None,
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
    request, convention = request_of(case, body, start), Convention(quat or "wxyz", omega_frame or "body", up, axis)
    if isinstance(t, str | os.PathLike):
        if position is not None or rotation is not None or omega is not None:
            raise ValueError("a file has its own positions, rotations and ω")
        return judge_file(Path(t), request, convention, Options(quat=quat, omega_frame=omega_frame, **written))
    if written:
        raise ValueError(f"{next(iter(written))} is for files")
    return _judged(request, convention, _of_arrays(t, position, rotation, omega))


def judge_file(path: Path, request: Request, convention: Convention, written: Options) -> Judgement:
    """The judgement of a file. written : what the user says of it."""
    case = request.case
    try:
        found = read(path, written, case.points, case.body.com if case.body.fixed else (0, 0, 0))
        frame = written.omega_frame or found.frame or ("world" if "momentum" in found.arrays else "body")
        angles, quat = found.angles or convention.angles, found.quat or convention.quat
        judgement = _judged(request, replace(convention, angles=angles, quat=quat, omega_frame=frame), found)
    except (ValueError, EOFError, StepError) as error:
        clock = "; perhaps the times are no seconds, or start elsewhere: --units t=ns, --t0 0"
        raise ValueError(f"{path}: {error}{clock if isinstance(error, StepError) else ''}") from None
    return replace(judgement, file=str(path), notes=[*found.notes, *judgement.notes], columns=found.columns)


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
        return registry.find(case, registry.Registry("case", "lagrange_bench.integrators.cases:Case", dict))
    if not isinstance(case, str | Case):
        raise ValueError(f"case must be a name or a Case; got {case!r}")
    try:
        return CASES[case] if isinstance(case, str) else case
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def _of_arrays(
    t: ArrayLike, position: ArrayLike | None, rotation: ArrayLike | Rotation | None, omega: ArrayLike | None
) -> Trajectory:
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
    return Trajectory(arrays, times - times[0])


def _judged(request: Request, convention: Convention, found: Trajectory) -> Judgement:
    """The judgement of rows."""
    case, own_start, floor = request.case, request.start != "case", found.floor
    written = found.arrays["time"][:, 0]
    _check_times(written if not own_start else found.elapsed, written)
    rows = {**found.arrays, "time": (found.elapsed if own_start else written)[:, None]}
    n, notes, digit = len(written), list[str](), floor.get("matrix", 0.0)
    with np.errstate(all="ignore"):
        frames = Frames(case.body, convention, digit, None if own_start else case)
        rows = frames.with_omega(rows)
        if own_start:
            frames.refer(rows)
        if request.start in ("first-row", "fit"):
            case, text = _started(request.start, case, frames, rows)
            notes.append(f"The motion starts at t = {written[0]:.9g} s {text}.")
            frames = Frames(case.body, convention, digit, case)
        errors, used, note = _of_both_clocks(frames, rows)
        rows["time"], notes = used, [*note, *notes]
        measured = {name: _error(error) for name, error in errors.items()}
        if not measured:
            raise ValueError("a body without a start is judged by rotations with ω, by ω in the body, or by positions")
        seen = {name: values[_some(n)] for name, values in rows.items()}
        exact = None if frames.case is None else frames.exact(seen["time"][:, 0])
        hints = _hints(frames, seen, exact, own_start, found)
    t, first = rows["time"][:, 0], {name: float(error[0]) for name, error in errors.items()}

    def floors_of(known: Floors) -> dict[str, float]:
        worst = {name: 2 * max(known.get(each, 0.0) for each in groups) for name, groups in GROUPS.items()}
        return {name: value for name, value in worst.items() if value > 0 and name in errors}

    floors = floors_of(floor)
    notes = [*_odd_rows(frames, rows, errors, hints), *notes]
    if max(-t[0], t[-1]) > frames.known_until:
        after = f"rows after t = {written[0] - t[0] + frames.known_until:.6g} s are not compared."
        notes.append(f"No closed form is known of this motion: {after}")
    if exact is not None and (blur := floor.get("time", 0.0)):
        blurred = _blurred(frames, seen["time"][:, 0], exact, blur)
        hidden = [name for name in blurred if name in errors and blurred[name] > floors.get(name, 0.0)]
        floors |= {name: blurred[name] for name in hidden}
        if shown := [name for name in hidden if not measured[name].max > 100 * blurred[name]]:
            notes.append(f"The times are rounded by {blur:.1e} s, which hides errors of {', '.join(shown)}.")
    if not set(errors) - {"length", "orthogonality"}:
        notes.append("There is neither a rotation nor ω: nothing but lengths is judged.")
    start: dict[str, Any] = {}
    if not own_start:
        off = {name: first[name] for name in GROUPS if name in errors}
        start = {"t": float(written[0]), **off}
        for word, least in (("right", START), ("single", SINGLE)):
            start[word] = frames.starts(off, least, floors_of(found.first_floor)) if t[0] == 0 else None
    span = float(written[0]), float(written[-1])
    curves = {name: _curve(t, error) for name, error in errors.items()}
    turns = _turns(frames, seen, exact)
    judged = Judgement(case.name, n, span, measured, start, floors, hints, notes, curves, turns, frames.sizes)
    if not own_start:
        judged.notes[:0] = _other_clock(judged, case, hints)
        if t[0] == 0 and not hints and any(error > RIGHT * frames.sizes[name] for name, error in off.items()):
            judged.notes.append(f"No usual mistake explains this start: {UNEXPLAINED}")
    return judged


def _check_times(t: Array, written: Array) -> None:
    wrong = np.flatnonzero(~(np.diff(t, prepend=-math.inf) > 0) | ~np.isfinite(t))
    if len(wrong):
        i = int(wrong[0])
        before = f" after {written[i - 1]:.12g}" if i else ""
        raise ValueError(f"row {i + 1}: the time is {written[i]:.12g}{before}; times must be numbers that increase")


def _some(n: int) -> Array:
    """The first rows, some of all others, and the last one."""
    return np.unique(np.concatenate((np.arange(min(n, HEAD)), np.linspace(0, n - 1, min(n, SOME)).astype(int))))


# ------------------------------------------------------------------------------------------------------------ the start


def _started(start: str, case: Case, frames: Frames, rows: Mapping[str, Array]) -> tuple[Case, str]:
    """The case with the start of the first row, or with the one that fits the first rows best; and what to say of it.

    Of a free body ω alone is enough, for it does not depend on the attitude. A flying body gets the velocity that fits all
    positions best.
    """
    head = {name: values[: FITTED if start == "fit" else 1] for name, values in rows.items()}
    R, omega = frames.motion(head)
    has_rotation = bool(frames.attitudes(head))
    if omega is None and start == "fit" and has_rotation and len(R) > 1:
        steps = Rotation.from_matrix(R[0].T @ R[1]).as_rotvec() / (head["time"][1] - head["time"][0])
        first = steps
    elif omega is not None and (has_rotation or (kinds.free_body(case.body) and case.body.fixed)):
        first = omega[0]
    else:
        first = np.full(3, np.nan)
    if not np.all(np.isfinite(R[0])) or not np.all(np.isfinite(first)):
        raise ValueError(f"--start {start}: the first row needs a rotation and an angular velocity")
    flight = {} if case.body.fixed else dict(zip(("position", "velocity"), np.nan_to_num(frames.launch), strict=True))
    case = replace(case, rotation=Rotation.from_matrix(R[0]), omega_body=first, **flight, exact={})
    if start == "fit":
        return _fitted(case, head["time"][:, 0], R if has_rotation else None, omega)
    return case, "as the first row does"


def _fitted(case: Case, t: Array, R: Array | None, omega: Array | None) -> tuple[Case, str]:
    """The case with the start that fits these rows best, by least squares over rotation and ω; and what to say of it."""
    first, spin = as_rotation(case.rotation), np.asarray(case.omega_body, dtype=float)
    size = float(np.linalg.norm(spin)) or 1.0
    units = {"rad/s": omega, "rad": R}
    units = {unit: values for unit, values in units.items() if values is not None}

    def start(u: Array) -> Case:
        turn = Rotation.from_rotvec(u[3:]) if len(u) > 3 else Rotation.identity()
        return replace(case, rotation=turn * first, omega_body=spin + size * u[:3])

    def residuals(u: Array) -> Array:
        motion = start(u).solution(t)
        off = []
        if omega is not None:
            off.append((motion.omega_body - omega) / size)
        if R is not None:
            off.append(Rotation.from_matrix(motion.rotation.as_matrix().transpose(0, 2, 1) @ R).as_rotvec())
        return np.concatenate([np.nan_to_num(each) for each in off], axis=None)

    unknowns = 3 if R is None else 6
    if 3 * len(t) <= unknowns:
        return case, "as the first row does: there are too few to fit a start"
    fit = least_squares(residuals, np.zeros(unknowns))
    off = fit.fun.reshape(-1, len(t), 3)
    rms, changes = (np.sqrt(np.mean(each**2, axis=(1, 2))) for each in (off, np.diff(off, axis=1)))
    sizes = [size if unit == "rad/s" else 1.0 for unit in units]
    scatter = ", ".join(f"{value * scale:.2g} {unit}" for value, scale, unit in zip(rms, sizes, units, strict=True))
    noise = " from row to row: noise" if np.all(changes > NOISE * rms) and rms.max() > 1e-9 else ""
    return start(fit.x), f"so that it fits the first {len(t)} rows best; these are off by {scatter}{noise}"


# ----------------------------------------------------------------------------------------------------------- the errors


def _of_both_clocks(frames: Frames, rows: dict[str, Array]) -> tuple[dict[str, Array], Array, list[str]]:
    """The errors of all rows, (n,) each, the times (n, 1) of them, and what to say of these.

    A sum of steps is rounded, so the decimals near to the times may be the right ones: those with the smaller errors are taken.
    """
    t, rounded = rows["time"], _decimals(rows["time"])
    errors, off = _errors(frames, rows), float(np.max(np.abs(rounded - t)))
    if off == 0 or off > NEAR * float(np.max(np.abs(t))):
        return errors, t, []
    others = _errors(frames, {**rows, "time": rounded})
    judged = [name for name in ("rotation", "position", "omega", "kinematics") if name in errors]
    before, after = (max((float(np.median(each[name])) for name in judged), default=0.0) for each in (errors, others))
    if after >= before:
        return errors, t, []
    matters = after < before / 2 and off > 1e-13 * float(np.max(np.abs(t)))
    note = f"The times are taken for the decimals near to them, by up to {off:.1e} s: sums of steps are rounded."
    return others, rounded, [note] if matters else []


def _decimals(t: Array) -> Array:
    """Times rounded to the eighth decimal place of the last of them; a sum of steps is not far from such decimals."""
    last = float(np.max(np.abs(t)))
    # per second; a power of ten, so that decimals are its multiples
    unit = 10 ** (DECIMALS - math.floor(math.log10(last))) if last else 1.0
    return np.asarray(np.round(t * unit) / unit)


def _errors(frames: Frames, rows: Mapping[str, Array]) -> dict[str, Array]:
    """The error of each quantity in each row, in parts, to save memory; slopes need two rows before a part and one after it."""
    n, parts = len(rows["time"]), list[dict[str, Array]]()
    for first in range(0, n, BLOCK):
        begin, end = max(0, first - 2), min(n, first + BLOCK + 1)
        part = {name: values[begin:end] for name, values in rows.items()}
        exact = None if frames.case is None else frames.exact(part["time"][:, 0])
        kept = slice(first - begin, min(n, first + BLOCK) - begin)
        parts.append({name: error[kept] for name, error in frames.errors(part, exact).items()})
    names = [name for name in UNITS if any(name in part for part in parts)]
    missing = [np.full(min(BLOCK, n - first), np.nan) for first in range(0, n, BLOCK)]
    return {
        name: np.concatenate([part.get(name, nan) for part, nan in zip(parts, missing, strict=True)]) for name in names
    }


def _error(error: Array) -> Error:
    return Error(float(error.max()), float(error[-1]))


def _curve(t: Array, error: Array) -> Array:
    """Times and the largest errors of some rows each, (2, M), to draw."""
    starts = np.unique(np.linspace(0, len(t), min(len(t), POINTS) + 1).astype(int))[:-1]
    return np.stack([t[starts], np.maximum.reduceat(error, starts)])


def _turns(frames: Frames, rows: Mapping[str, Array], exact: Exact | None) -> float:
    """How often the body turns, ∫|ω| dt/2π; without ω by all attitudes, NaN without either."""
    t, omega = rows["time"][:, 0], rows.get("omega") if exact is None else exact[2]
    if omega is not None:
        return float(np.trapezoid(np.linalg.norm(omega, axis=1), t)) / math.tau
    both = frames.rows(rows)
    return math.nan if both is None else float(np.sum(both.speed() * both.dt[:, 0])) / math.tau


def _blurred(frames: Frames, t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times change by `blur`."""
    x, _, omega = frames.exact(t + blur)
    moved = {"position": x - exact[0], "rotation": omega * blur, "omega": omega - exact[2]}
    return {name: float(np.linalg.norm(change, axis=1).max()) for name, change in moved.items()}


# ------------------------------------------------------------------------------------------------------------- the words


def _hints(
    frames: Frames, seen: Mapping[str, Array], exact: Exact | None, own_start: bool, found: Trajectory
) -> list[str]:
    way = ""
    if found.wxyz:  # as the columns would have to be named
        w, x, y, z = found.wxyz
        way = f"--columns qw={z},qx={w},qy={x},qz={y}"
    rows = frames.rows({name: values[:HEAD] for name, values in seen.items()})
    known = [error for name, error in frames.errors(seen, exact).items() if name in GROUPS]
    good = np.flatnonzero(np.isfinite(known).all(axis=0))
    if own_start:
        hints = own_hints(frames, seen, rows, way)
        if exact is not None and len(good) and not hints:
            hints = Hints(frames, seen, exact, good, way).bodies()
    else:
        assert exact is not None
        hints = find_hints(frames, seen, exact, good, rows, way) if len(good) else []
    if "matrix" in seen and np.median(np.linalg.det(seen["matrix"].reshape(-1, 3, 3))) < 0:
        hints.insert(0, "a row or column of the matrices has the wrong sign: their determinant is negative.")
    return hints


def _odd_rows(
    frames: Frames, rows: Mapping[str, Array], errors: Mapping[str, Array], hints: list[str]
) -> Iterator[str]:
    """Notes on the rows: what is odd about them, and what attitudes and ω say without an exact motion."""
    t = rows["time"][:, 0]
    bad = ~np.all([np.isfinite(error) for error in errors.values()], axis=0) & (np.abs(t) <= frames.known_until)
    if count := int(np.count_nonzero(bad)):
        odd = "a number that is missing or not finite, a matrix or quaternion that is no rotation, or a position of length 0"
        yield f"{count} of {len(t)} rows have {odd}, the first at t = {t[bad][0]:.9g}."
    if "orthogonality" in errors and (off := errors["orthogonality"].max()) > 1e-3:
        yield f"Matrices are not orthogonal or quaternions not of length 1, by {off:.2g}; quaternions are scaled to 1."
    both: Rows | None = frames.rows({name: values[:HEAD] for name, values in rows.items()})
    if both is not None:
        yield from both.notes()
        if both.omega is not None and frames.axis is not None and not hints:
            yield from rate_notes(both.t, both.spin_rate(frames.axis))


def _other_clock(judged: Judgement, case: Case, hints: list[str]) -> Iterator[str]:
    """Notes on a file that ends early, or whose times go far beyond the case."""
    first, end = judged.span
    if judged.ends_before(case.until):
        yield f"The last row is at t = {end:.9g} s; the case runs to {case.until:g} s."
    wrong = judged.leaves or judged.start["right"] is False
    if end - first > 10 * case.until and wrong and not any("--units t=" in hint for hint in hints):
        unit = min(CLOCKS.values(), key=lambda unit: abs(math.log((end - first) * unit[1] / case.until)))[0]
        yield f"The times go to {end:.9g}, the case to {case.until:g} s: perhaps they are no seconds: --units t={unit}."
