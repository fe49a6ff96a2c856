"""`judge`: how far the trajectory of any program is from the exact motion of a rigid body."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from lagrange_bench.integrators.problem import kinds

Array = np.ndarray
# the rows of a trajectory from the first on, as often as it is called
Blocks = Callable[[], Iterator[Mapping[str, Array]]]
# sums of steps round: times that all are that near, relative to the last one, to its decimals of the eighth place are these;
# with fewer rows than FEW they must be nearer. Half a unit of that place is more than NEAR, so that not all numbers are near.
DECIMALS, NEAR, SOME, FEW = 8, 1e-10, 5e-13, 100
POINTS = 2000  # of a curve
MOST = 3 * HEAD  # rows that hints are taken from, of the first ones and of all others
BLOCK = 1 << 14  # rows that are compared at once
SOME_ROWS = 8  # fewer do not show how an error grows
KEPT = {"length", "orthogonality", "spin_rate", "energy", "momentum"}  # by the exact motion
ROUNDING = 1e-10  # relative: larger errors are not of rounding
ROUND_OFF = 1e-15  # relative to the size of a quantity: errors below it do not grow


class Error(NamedTuple):
    """The largest error of all rows, and the error of the last row; NaN where a row holds NaN, or only part of the rows tell."""

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
        turns = "" if math.isnan(self.turns) else f", {self.turns:.3g} turns"
        lines = [f"After {self.span[1] - self.span[0]:.4g} s{turns}: {'; '.join(off)}."] if off else []
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

    def blocks() -> Iterator[Mapping[str, Array]]:
        for k in range(0, n, BLOCK):
            yield {name: rows[k : k + BLOCK] for name, rows in trajectory.items()}

    return _judged(asked(case, body, start), Convention(quat, omega_frame, up, axis), blocks, {}, {})


def judge_file(path: Path, what: Asked, convention: Convention, how: reading.Options) -> Judgement:
    """The judgement of a file. what : it is compared with this. how : the file is written like this."""
    try:
        judgement = _as_laid_out(reading.survey(path, how), what, convention)
    except (ValueError, StepError) as error:
        raise ValueError(f"{path}: {error}") from None
    return replace(judgement, file=str(path))


def _as_laid_out(layout: reading.Layout, what: Asked, convention: Convention) -> Judgement:
    way, convention = "", replace(convention, angles=layout.how.angles or convention.angles)
    if layout.guessed:
        convention = replace(convention, quat="xyzw")
    elif layout.named:  # --quat has no effect there
        w, x, y, z = layout.groups["quaternion"]
        convention, way = replace(convention, quat="wxyz"), f"--columns qw={z},qx={w},qy={x},qz={y}"

    def blocks() -> Iterator[Mapping[str, Array]]:
        for rows in reading.blocks(layout):
            if layout.guessed:
                rows["quaternion"] = np.roll(rows["quaternion"], -1, axis=1)
            yield rows

    judgement = _judged(what, convention, blocks, layout.floor, layout.first_floor, way)
    return replace(judgement, notes=[*layout.notes, *judgement.notes], columns=layout.columns)


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
    if kinds.rigid_body(body):
        return Asked(Case("body", body, np.eye(3), np.zeros(3)), None)  # type: ignore[arg-type]
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
    blocks: Blocks,
    floor: Mapping[str, float],
    first_floor: Mapping[str, float],
    way: str = "",
) -> Judgement:
    """The judgement of a trajectory.

    floor, first_floor : of each group of columns, what the digits of the file and those of its first row hide. way : to have
    quaternions in another order.
    """
    case, own_start = what.case, what.start != "case"
    run, digit = _look(blocks), floor.get("matrix", 0.0)
    (first, end), zero = run.span, run.span[0] if own_start else 0.0
    seen = {**run.seen, "time": run.seen["time"] - zero}

    def timed() -> Iterator[dict[str, Array]]:
        for block in blocks():
            yield {**block, "time": (_decimals(block["time"]) if run.decimals else block["time"]) - zero}

    with np.errstate(all="ignore"):
        frames = Frames(case.body, convention, digit, None if own_start else case)
        if own_start:
            frames.refer(seen)
        if what.start == "first-row":
            case = _from_first_row(case, frames, seen)
            frames = Frames(case.body, convention, digit, case)
        measured = _measured(frames, timed(), run.rows)
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

    def floors_of(known: Mapping[str, float]) -> dict[str, float]:
        worst = {
            name: 2 * max(known.get(each, 0.0) for each in groups) for name, groups in GROUPS.items() if name in errors
        }
        return {name: value for name, value in worst.items() if value > 0}

    floors = floors_of(floor)
    notes = [*_notes(measured, run.rows), *_own_notes(frames, rows, hints)]
    if max(zero - first, end - zero) > frames.known:
        notes.append(
            f"No closed form is known of this motion: rows after t = {zero + frames.known:.6g} s are not compared."
        )
    if what.start == "first-row":
        notes.append(f"The motion starts as the first row does, at t = {first:.9g} s.")
    if exact is not None and (blur := floor.get("time", 0.0)):
        for name, value in _blurred(frames, seen["time"][:, 0], exact, blur).items():
            if name in errors and value > floors.get(name, 0.0):
                floors[name] = value
                hidden = f"this hides errors of {name} below {value:.1e} {UNITS[name]}."
                notes.append(f"The times are rounded by {blur:.1e} s: {hidden}")
    start: dict[str, Any] = {}
    if not own_start:
        off = {name: measured.first[name] for name in GROUPS if name in errors}
        start = {"t": first, **off}
        for word, least in (("right", START), ("single", SINGLE)):
            start[word] = frames.starts(off, least, floors_of(first_floor)) if first == 0 else None
    whole = rows if rows is not None and rows.rows == run.rows else None
    turns = _turns(seen["time"][:, 0], seen.get("omega") if exact is None else exact[2], whole)
    judged = Judgement(
        case.name,
        run.rows,
        (first, end),
        errors,
        start,
        floors,
        hints,
        notes,
        measured.curves,
        turns=turns,
        sizes=frames.sizes,
    )
    if own_start:
        return judged
    if end > 10 * case.until:
        judged.notes.insert(0, f"The times go to {end:.9g}, the case to {case.until:g} s: perhaps they are no seconds.")
    if judged.ends_before(case.until):
        judged.notes.insert(0, f"The last row is at t = {end:.9g} s; the case runs to {case.until:g} s.")
    return judged


def _turns(t: Array, omega: Array | None, rows: Rows | None) -> float:
    """How often the body turns, ∫|ω| dt/2π; without ω by all attitudes, NaN without either."""
    if omega is not None:
        return float(np.trapezoid(np.linalg.norm(omega, axis=1), t)) / math.tau
    return math.nan if rows is None else float(np.sum(rows.speed() * rows.dt[:, 0])) / math.tau


class _Run(NamedTuple):
    """What a first look finds: how many rows; the first and the last time; whether times are `_decimals`; some rows."""

    rows: int
    span: tuple[float, float]
    decimals: bool
    seen: dict[str, Array]


def _look(blocks: Blocks) -> _Run:
    """Look at all times; take the first rows, some of all others, and the last. ValueError where times do not increase."""
    n, gap, off, last, places = 0, 1, 0.0, -math.inf, np.empty(0, dtype=int)
    seen: dict[str, Array] = {}
    for block in blocks():
        t = block["time"]
        with np.errstate(all="ignore"):
            wrong = np.flatnonzero(~(np.diff(t[:, 0], prepend=last) > 0) | ~np.isfinite(t[:, 0]))
        if len(wrong):
            i = int(wrong[0])
            before = f" after {t[i - 1, 0] if i else last:.12g}" if n + i else ""
            raise ValueError(
                f"row {n + i + 1}: the time is {t[i, 0]:.12g}{before}; times must be numbers that increase"
            )
        rows = {**block, "decimals": _decimals(t)}
        off = max(off, float(np.max(np.abs(rows["decimals"] - t)) / (np.max(np.abs(t)) or 1.0)))
        places = np.concatenate((places, np.arange(n, n + len(t))))
        seen = {name: np.concatenate((seen[name], part)) if n else part for name, part in rows.items()}
        n, last = n + len(t), t[-1, 0]
        while np.count_nonzero(kept := (places < HEAD) | (places % gap == 0) | (places == n - 1)) > MOST:
            gap *= 2
        seen, places = {name: part[kept] for name, part in seen.items()}, places[kept]
    rounded = seen.pop("decimals")
    if decimal := off < (NEAR if n >= FEW else SOME):
        seen["time"] = rounded
    return _Run(n, (float(seen["time"][0, 0]), float(seen["time"][-1, 0])), decimal, seen)


class _Measured(NamedTuple):
    """The errors of all rows and of the first one, their curves; how many rows hold a NaN, and the time of the first of these.

    mirrored : rows with a matrix of negative determinant.
    """

    errors: dict[str, Error]
    first: dict[str, float]
    curves: dict[str, Array]
    bad: int
    bad_from: float
    mirrored: int


def _measured(frames: Frames, blocks: Iterator[Mapping[str, Array]], n: int) -> _Measured:
    """The largest errors of n rows in blocks."""
    marks, at = np.linspace(0, n, min(n, POINTS) + 1).astype(int), 0
    t_marks, curves = np.full(len(marks) - 1, math.inf), dict[str, Array]()
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    told: dict[str, int] = {}  # in how many rows
    bad, bad_from, mirrored = 0, math.nan, 0
    for rows, new in _overlapping(blocks, n):
        t = rows["time"][new, 0]
        part_of = np.searchsorted(marks, np.arange(at, at + len(t)), side="right") - 1
        starts = np.flatnonzero(np.diff(part_of, prepend=-1))
        parts = part_of[starts]
        t_marks[parts] = np.minimum(t_marks[parts], t[starts])
        here = np.full(len(t), False)
        exact = None if frames.case is None else frames.exact(rows["time"][:, 0])
        for name, error in frames.errors(rows, exact).items():
            error, curve = error[new], curves.setdefault(name, np.zeros(len(marks) - 1))
            curve[parts] = np.maximum(curve[parts], np.maximum.reduceat(error, starts))
            first.setdefault(name, float(error[0]))
            last[name], told[name] = float(error[-1]), told.get(name, 0) + len(t)
            here |= ~np.isfinite(error)
        here &= np.abs(t) <= frames.known
        bad_from = float(t[here][0]) if here.any() and not bad else bad_from
        bad, at = bad + int(np.count_nonzero(here)), at + len(t)
        if "matrix" in rows:
            mirrored += int(np.count_nonzero(np.linalg.det(rows["matrix"][new].reshape(-1, 3, 3)) < 0))
    if not curves:
        raise ValueError("a body without a start is judged by rotations with ω, by ω in the body, or by positions")
    errors = {
        name: Error(float(curves[name].max()), last[name]) if told[name] == n else Error(math.nan, math.nan)
        for name in UNITS
        if name in curves
    }
    drawn = {name: np.stack([t_marks, curve]) for name, curve in curves.items()}
    return _Measured(errors, first, drawn, bad, bad_from, mirrored)


def _overlapping(blocks: Iterator[Mapping[str, Array]], n: int) -> Iterator[tuple[dict[str, Array], slice]]:
    """Blocks of the first n rows with two rows before and one after their own, which slopes need; and where their own are."""
    rows: dict[str, Array] = {}
    first = at = 0  # of `rows` that were not compared yet, and of the trajectory
    for block in blocks:
        new = {name: part[: n - at] for name, part in block.items()}  # a file may grow while it is read
        rows = {name: np.concatenate((rows[name], part)) if rows else part for name, part in new.items()}
        at += len(new["time"])
        end = len(rows["time"]) - (at < n)
        if end > first:
            yield rows, slice(first, end)
        first = min(end, 2)
        rows = {name: part[end - first :] for name, part in rows.items()}


def _decimals(t: Array) -> Array:
    """Times rounded to the eighth decimal place of the last of them; a sum of steps is not far from such decimals."""
    last = float(np.max(np.abs(t)))
    # per second; a power of ten, so that decimals are its multiples
    unit = 10 ** (DECIMALS - math.floor(math.log10(last))) if last else 1.0
    return np.asarray(np.round(t * unit) / unit)


def _blurred(frames: Frames, t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times change by `blur`."""
    if not blur:
        return {}
    x, _, omega = frames.exact(t + blur)
    moved = {"position": x - exact[0], "rotation": omega * blur, "omega": omega - exact[2]}
    return {name: float(np.linalg.norm(change, axis=1).max()) for name, change in moved.items()}


def _notes(measured: _Measured, n: int) -> Iterator[str]:
    errors = measured.errors
    if measured.bad:
        what = "a number that is missing or not finite, a matrix or quaternion that is no "
        what += "rotation, or a position of length 0"
        yield f"{measured.bad} of {n} rows have {what}, the first at t = {measured.bad_from:.9g}."
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
