"""`judge`: how far the trajectory of any program is from the exact motion of a rigid body."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench import reading
from lagrange_bench.arguments import own
from lagrange_bench.consistency import Rows, rate_note
from lagrange_bench.conventions import ATTITUDES, GROUPS, UNITS, Convention, Exact, Frames
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.hints import HEAD, SINGLE, START, Hints, find_hints, own_hints
from lagrange_bench.integrators import CASES, Case, RigidBody, StepError
from lagrange_bench.integrators.cases import read_case

Array = np.ndarray
# sums of steps round: times that all are that near, relative to the last one, to multiples of a billionth of it are these; with
# fewer rows than FEW they must be nearer
DECIMALS, NEAR, SOME, FEW = 9, 1e-10, 5e-13, 100
POINTS = 2000  # of a curve
BLOCK = 100_000  # rows that are compared at once
SOME_ROWS = 8  # fewer do not show how an error grows
KEPT = {"length", "orthogonality", "spin_rate", "energy", "momentum"}  # by the exact motion
ROUNDING = 1e-10  # relative: larger errors are not of rounding
ROUND_OFF = 1e-15  # relative to the size of a quantity: errors below it do not grow


class Error(NamedTuple):
    """The largest error of all rows, and that of the last row; NaN where a row holds NaN."""

    max: float
    end: float


@dataclass(frozen=True)
class Judgement:
    """What `judge` finds: `errors` of those `UNITS` that the trajectory has columns for, each also an attribute.

    span : s, first and last time. start : time and errors of the first row, and whether it is the start of the case, in doubles
    (`right`) and in single precision (`single`); None where that time is not 0; empty where no start is known. floor : errors
    below it are lost in the printed digits. hints : conventions that the rows perhaps have. curves : times and errors, (2, M), to
    be drawn. columns : of a file, how they were read. turns : of the motion. sizes : what some errors are compared with.
    """

    case: str
    rows: int
    span: tuple[float, float]
    errors: dict[str, Error]
    start: dict[str, Any]
    floor: dict[str, float] = field(default_factory=dict)
    hints: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    curves: dict[str, Array] = field(default_factory=dict, repr=False)
    file: str | None = None
    columns: str = ""
    turns: float = 0.0
    sizes: dict[str, float] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """The mean distance of two rows, s."""
        return (self.span[1] - self.span[0]) / (self.rows - 1) if self.rows > 1 else math.nan

    def ends_before(self, until: float) -> bool:
        """Whether the last row is before this time, s, by more than half of the distance of two rows."""
        return self.span[1] < until - (0.5 * self.step if self.rows > 1 else 0.0)

    def summary(self) -> list[str]:
        """How wrong it is, in a sentence; and until when it is near."""
        name = next((name for name in ("axis", "rotation", "omega", "position", "energy") if name in self.errors), None)
        if name is None or self.rows < 2 or not math.isfinite(self.errors[name].end):
            return []
        if "omega" not in self.errors and "energy" in self.errors:  # without a start
            names = [name for name in ("energy", "momentum") if self.sizes.get(name)]
            off = [
                f"{name} off by {self.errors[name].end / self.sizes[name]:.1e} of its size{self._growing(name)}"
                for name in names
            ]
        else:
            off = [f"{name} off by {self.errors[name].end:.1e} {UNITS[name]}{self._growing(name)}"]
        lines = [f"After {self.span[1] - self.span[0]:.4g} s, {self.turns:.3g} turns: {'; '.join(off)}."] if off else []
        near, bound = ("position", 0.1 * self.sizes["position"]) if "position" in self.errors else ("rotation", 0.1)
        if near in self.errors and self.errors[near].max > bound:
            t, error = self.curves[near]
            first = int(np.argmax(~(error <= bound)))
            until = f"until t = {t[first]:.3g} s" if first else "at no time"
            lines.append(f"The {near} is within {bound:.2g} {UNITS[near]} {until}.")
        return lines

    def growth(self, name: str) -> float:
        """The exponent p of an error that grows like t^p; NaN where the rows do not tell."""
        t, error = self.curves[name]
        least = 1 / self.step if name == "kinematics" else self.sizes.get(name, 1.0)
        floor = max(self.floor.get(name, 0.0), ROUND_OFF * least)
        if np.count_nonzero(error > floor) < SOME_ROWS:
            return math.nan
        return metrics.growth_exponent(t - t[0], error, floor=floor).p

    def grows(self, name: str) -> str:
        """The same in words, as `assert_drift` means them."""
        power = self.growth(name)
        if math.isnan(power):
            return ""
        if power < 0.25:
            return "bounded"
        nearest = round(power)
        law = "t" if nearest == 1 else f"t^{nearest}"
        law = law if abs(power - nearest) < 0.25 else f"t^{power:.1f}"
        rounding = name in KEPT and self.errors[name].max < ROUNDING * self.sizes.get(name, 1.0)
        return f"{law}, a random walk" if power < 0.75 and rounding else law

    def _growing(self, name: str) -> str:
        grows = self.grows(name)
        return f", {grows}" if grows == "bounded" else f", growing like {grows}" if grows else ""

    def __getattr__(self, name: str) -> Error:
        if name in UNITS and name in self.errors:
            return self.errors[name]
        raise AttributeError(f"{name} is not judged: there are no columns for it" if name in UNITS else name)

    def __repr__(self) -> str:
        errors = ", ".join(f"{name} {error.max:.1e}" for name, error in self.errors.items())
        hint = f"; perhaps {self.hints[0]}" if self.hints else ""
        return f"<{self.case}, {self.rows} rows to t = {self.span[1]:.6g}: {errors}{hint}>"

    def as_dict(self) -> dict[str, Any]:
        """The numbers of --json for a file."""
        errors = {name: {**error._asdict(), "growth": self.growth(name)} for name, error in self.errors.items()}
        facts = {"rows": self.rows, "step": self.step, **errors}
        return {**facts, "start": self.start, "floor": self.floor, "hints": self.hints, "notes": self.notes}


class Asked(NamedTuple):
    """What rows are compared with. start : "case"; "first-row"; None if only the body counts."""

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
        In place of a case: nothing is known of the start. The rows are compared with what the motion keeps, and with themselves.
    start : {"case", "first-row"}
        Where the exact motion starts: as the case does, or as the first row does, which then needs a rotation and omega.
    quat : {"wxyz", "xyzw"}
        The order of the quaternions.
    omega_frame : {"body", "world"}
        The frame of omega. Its error is measured in the same frame.
    up : str, optional
        The axis that points up in the world of these numbers, such as "y" or "-z"; by default that of the case. The smallest
        turn leads to it; where that is half a turn, it is about x.
    axis : str, optional
        The axis of symmetry in the body of these numbers, likewise.

    Returns
    -------
    Judgement
        The errors of what was given, each with its largest and its last; `hints`, `notes` and `start` say what may be wrong.

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
    return _judged(asked(case, body, start), Convention(quat, omega_frame, up, axis), trajectory, {}, {})


def judge_file(path: Path, what: Asked, convention: Convention, how: reading.Options) -> Judgement:
    """The judgement of a file. what : it is compared with this. how : the file is written like this."""
    layout = reading.survey(path, how)
    trajectory, way = reading.read(layout), ""
    convention = replace(convention, angles=how.angles or convention.angles)
    if layout.guessed:
        convention, trajectory["quaternion"] = (
            replace(convention, quat="xyzw"),
            np.roll(trajectory["quaternion"], -1, axis=1),
        )
    elif layout.named:  # --quat has no effect there
        w, x, y, z = layout.groups["quaternion"]
        convention, way = replace(convention, quat="wxyz"), f"--columns qw={z},qx={w},qy={x},qz={y}"
    try:
        judgement = _judged(what, convention, trajectory, layout.floor, layout.first_floor, way)
    except (ValueError, StepError) as error:
        raise ValueError(f"{path}: {error}") from None
    return replace(judgement, file=str(path), notes=[*layout.notes, *judgement.notes], columns=layout.columns)


def orders(judged: Sequence[Judgement], steps: Sequence[float]) -> dict[str, list[float]]:
    """Observed orders of position and rotation between neighbours, from the largest step to the smallest.

    NaN where an error says nothing; none of a quantity that not all files have columns for.
    """
    pairs = sorted(zip(steps, judged, strict=True), key=lambda pair: -pair[0])
    observed: dict[str, list[float]] = {"position": [], "rotation": []}
    for name, values in observed.items():
        known = all(name in each.errors for each in judged)
        for (h, coarse), (k, fine) in itertools.pairwise(pairs) if known else ():
            large, small = coarse.errors[name].max, fine.errors[name].max
            says = h > k and large > 0 and small > fine.floor.get(name, 0.0)
            values.append(math.log(large / small) / math.log(h / k) if says else math.nan)
    return observed


def converges_elsewhere(orders: Sequence[float]) -> bool:
    """Whether errors stop falling far from round-off, as those of a program that follows another motion."""
    known = [order for order in orders if math.isfinite(order)]
    return len(known) > 1 and known[-1] < 0.3 < max(known)


def asked(case: str | Case | None, body: str | Case | RigidBody | None = None, start: str = "case") -> Asked:
    """A case, or the body of one; ValueError unless it is one of the two."""
    if (case is None) == (body is None):
        raise ValueError("give a case, or a body without a start; one of the two")
    if start not in ("case", "first-row"):
        raise ValueError(f"start must be case or first-row; got {start!r}")
    if body is not None and start != "case":
        raise ValueError("a body without a start is not followed: for --start first-row give a case")
    if isinstance(body, RigidBody):
        return Asked(Case("body", body, np.eye(3), np.zeros(3)), None)
    known = case is not None and start == "case"
    return Asked(find(case if body is None else body, known), start if body is None else None)  # type: ignore[arg-type]


def find(case: str | Case, start: bool = True) -> Case:
    """The case of this name, or one's own: as it is, as module:NAME, or in a TOML file, which may lack its start."""
    if isinstance(case, (str, Path)) and Path(case).suffix == ".toml":
        return read_case(Path(case), start)
    if isinstance(case, str) and ":" in case:
        case = own(case, "case")
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
    flight = {} if case.body.fixed else dict(zip(("position", "velocity"), np.nan_to_num(frames.flown), strict=True))
    return replace(case, rotation=Rotation.from_matrix(R[0]), omega_body=omega[0], **flight, exact={})


def _judged(
    what: Asked,
    convention: Convention,
    trajectory: Mapping[str, Array],
    floor: Mapping[str, float],
    first_floor: Mapping[str, float],
    way: str = "",
) -> Judgement:
    """The judgement of a trajectory.

    floor, first_floor : of each group of columns, what the digits of the file and those of its first row hide. way : to have
    quaternions in another order.
    """
    case, own_start = what.case, what.start != "case"
    t = _times(trajectory["time"][:, 0])
    trajectory = {**trajectory, "time": (t - t[0] if own_start else t)[:, None]}
    # rows that hints are taken from: the first ones, and some of all others
    some = np.union1d(np.arange(min(HEAD, len(t))), np.linspace(0, len(t) - 1, HEAD).astype(int))
    seen, digit = {name: rows[some] for name, rows in trajectory.items()}, floor.get("matrix", 0.0)
    with np.errstate(all="ignore"):
        frames = Frames(case.body, convention, digit, None if own_start else case)
        if own_start:
            frames.refer(seen)
        if what.start == "first-row":
            case = _from_first_row(case, frames, trajectory)
            frames = Frames(case.body, convention, digit, case)
        measured = _measured(frames, trajectory)
        errors, good = measured.errors, measured.good[some].nonzero()[0]
        exact = None if frames.case is None else frames.exact(seen["time"][:, 0])
        rows = frames.rows({name: part[:BLOCK] for name, part in trajectory.items()})
        if own_start:
            hints = own_hints(frames, seen, rows, way)
            if exact is not None and len(good) and not hints:
                hints = Hints(frames, seen, seen["time"][:, 0], exact, good, way).bodies()
        else:
            assert exact is not None
            hints = find_hints(frames, seen, t[some], exact, good, rows, way) if len(good) else []
        if measured.mirrored:
            hints.insert(0, "a row or column of the matrices has the wrong sign: their determinant is negative.")

    def floors_of(known: Mapping[str, float]) -> dict[str, float]:
        worst = {
            name: 2 * max(known.get(each, 0.0) for each in groups) for name, groups in GROUPS.items() if name in errors
        }
        return {name: value for name, value in worst.items() if value > 0}

    floors, known = floors_of(floor), np.abs(trajectory["time"][:, 0]) <= frames.known
    notes = [*_notes(t, measured.bad & known, errors), *_own_notes(frames, rows, hints)]
    if not known.all():
        beyond = f"t = {t[known][-1]:.6g} s" if known.any() else "the start"
        notes.append(f"No closed form is known of this motion: rows after {beyond} are not compared.")
    if what.start == "first-row":
        notes.append(f"The motion starts as the first row does, at t = {t[0]:.9g} s.")
    if exact is not None and (blur := floor.get("time", 0.0)):
        for name, value in _blurred(frames, seen["time"][:, 0], exact, blur).items():
            if name in errors and value > floors.get(name, 0.0):
                floors[name] = value
                hidden = f"this hides errors of {name} below {value:.1e} {UNITS[name]}."
                notes.append(f"The times are rounded by {blur:.1e} s: {hidden}")
    start: dict[str, Any] = {}
    if not own_start:
        first = {name: measured.first[name] for name in GROUPS if name in errors}
        start = {"t": float(t[0]), **first}
        for word, least in (("right", START), ("single", SINGLE)):
            start[word] = frames.starts(first, least, floors_of(first_floor)) if t[0] == 0 else None
    turns = _turns(seen["time"][:, 0], seen.get("omega") if exact is None else exact[2], rows)
    span = (float(t[0]), float(t[-1]))
    judged = Judgement(
        case.name, len(t), span, errors, start, floors, hints, notes, measured.curves, turns=turns, sizes=frames.sizes
    )
    if own_start:
        return judged
    if t[-1] > 10 * case.until:
        judged.notes.insert(
            0, f"The times go to {t[-1]:.9g}, the case to {case.until:g} s: perhaps they are no seconds."
        )
    if judged.ends_before(case.until):
        judged.notes.insert(0, f"The last row is at t = {t[-1]:.9g} s; the case runs to {case.until:g} s.")
    return judged


def _turns(t: Array, omega: Array | None, rows: Rows | None) -> float:
    """How often the body turns, ∫|ω| dt/2π; without ω by the attitudes, NaN without either."""
    if omega is not None:
        speed = np.linalg.norm(omega, axis=1)
    elif rows is not None:
        t, speed = rows.t[1:], rows.speed()
    else:
        return math.nan
    return float(np.trapezoid(speed, t)) / math.tau


class _Measured(NamedTuple):
    """The errors of all rows and of the first one, their curves; whether each row has known errors, or a NaN."""

    errors: dict[str, Error]
    first: dict[str, float]
    curves: dict[str, Array]
    good: Array
    bad: Array
    mirrored: bool


def _measured(frames: Frames, trajectory: Mapping[str, Array]) -> _Measured:
    """In blocks of rows, so that a long file needs little memory; each block begins with the row before it."""
    t = trajectory["time"][:, 0]
    marks = np.linspace(0, len(t), min(len(t), POINTS) + 1).astype(int)
    edges = [*marks[: -1 : max(1, BLOCK * (len(marks) - 1) // len(t))], len(t)]
    highest: dict[str, list[Array]] = {}
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    good, bad, mirrored = np.ones(len(t), dtype=bool), np.zeros(len(t), dtype=bool), False
    for a, b in itertools.pairwise(edges):
        before = int(a > 0)
        block = {name: rows[a - before : b] for name, rows in trajectory.items()}
        block_errors = frames.errors(block, None if frames.case is None else frames.exact(block["time"][:, 0]))
        here = marks[(marks >= a) & (marks < b)] - a
        for name, whole in block_errors.items():
            error = whole[before:]
            highest.setdefault(name, []).append(np.maximum.reduceat(error, here))
            first.setdefault(name, float(error[0]))
            last[name] = float(error[-1])
            bad[a:b] |= ~np.isfinite(error)
            if name in GROUPS:
                good[a:b] &= np.isfinite(error)
        if "matrix" in block:
            mirrored |= bool(np.any(np.linalg.det(block["matrix"].reshape(-1, 3, 3)) < 0))
    if not highest:
        raise ValueError("a body without a start is judged by rotations with ω, by ω in the body, or by positions")
    curves = {name: np.stack([t[marks[:-1]], np.concatenate(parts)]) for name, parts in highest.items()}
    errors = {name: Error(float(curve[1].max()), last[name]) for name, curve in curves.items()}
    return _Measured({name: errors[name] for name in UNITS if name in errors}, first, curves, good, bad, mirrored)


def _times(t: Array) -> Array:
    """The times, without the rounding of a sum of steps; ValueError where they do not increase."""
    with np.errstate(all="ignore"):
        wrong = np.flatnonzero(~(np.diff(t, prepend=-math.inf) > 0) | ~np.isfinite(t))
    if len(wrong):
        i = wrong[0]
        before = f" after {t[i - 1]:.12g}" if i else ""
        raise ValueError(f"row {i + 1}: the time is {t[i]:.12g}{before}; times must be numbers that increase")
    last = float(np.max(np.abs(t)))
    if not last:
        return t
    unit = 10 ** (
        DECIMALS - math.floor(math.log10(last))
    )  # per second; a power of ten, so that decimals are its multiples
    rounded = np.round(t * unit) / unit
    return rounded if np.all(np.abs(rounded - t) < (NEAR if len(t) >= FEW else SOME) * last) else t


def _blurred(frames: Frames, t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times change by `blur`."""
    if not blur:
        return {}
    x, _, omega = frames.exact(t + blur)
    moved = {"position": x - exact[0], "rotation": omega * blur, "omega": omega - exact[2]}
    return {name: float(np.linalg.norm(change, axis=1).max()) for name, change in moved.items()}


def _notes(t: Array, bad: Array, errors: Mapping[str, Error]) -> Iterator[str]:
    if bad.any():
        what = "a number that is missing or not finite, a matrix or quaternion that is no "
        what += "rotation, or a position of length 0"
        yield f"{bad.sum()} of {len(t)} rows have {what}, the first at t = {t[bad][0]:.9g}."
    if "orthogonality" in errors and (off := errors["orthogonality"].max) > 1e-3:
        yield f"Matrices are not orthogonal or quaternions not of length 1, by {off:.2g}; quaternions are scaled to 1."


def _own_notes(frames: Frames, rows: Rows | None, hints: Sequence[str]) -> Iterator[str]:
    """Notes on the rows that need no exact motion."""
    if rows is None:
        return
    yield from rows.notes()
    if rows.omega is not None and frames.axis is not None and not hints:
        text = rate_note(rows.t, rows.spin_rate(frames.axis))
        yield from [text] if text else []


def draw(path: Path, judged: Sequence[Judgement]) -> str:
    """Draw position and rotation error, or what else there is, over time, a line for each file; write the picture."""
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.output import write_picture

    chosen = [name for name in ("position", "rotation") if name in judged[0].errors] or list(judged[0].errors)[:1]
    with style.apply():
        width = "page" if len(chosen) > 1 else "column"
        figure, axes = style.figure(width, ncols=len(chosen), squeeze=False)
        for panel, name in zip(axes[0], chosen, strict=True):
            for each in (each for each in judged if name in each.curves):
                t, error = each.curves[name]
                panel.plot(t, np.where(error > 0, error, np.nan), label=Path(each.file or each.case).stem)
            panel.set(yscale="log", xlabel="t (s)", ylabel=f"error of {name} ({UNITS[name]})")
        axes[0][0].legend()
    return write_picture(path, figure)
