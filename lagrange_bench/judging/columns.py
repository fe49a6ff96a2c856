"""The trajectory in a file: which columns are what, by their names, the first rows and what the user says; and their numbers."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lagrange_bench.judging.frames import Options
from lagrange_bench.judging.names import (
    EXPECTED,
    ROLES,
    SHAPES,
    UNITS,
    Group,
    Name,
    Unit,
    frame_of,
    groups_of,
    kind_of,
    parse,
    unit_of,
)
from lagrange_bench.judging.rows import FileTable, is_number, number, open_table
from lagrange_bench.support.words import suggestion

Array = np.ndarray
KNOWN = (
    "t x y z px py pz ux uy uz qw qx qy qz q0 q1 q2 q3 q4 e0 e1 e2 e3 r11 r12 r13 r21 r22 r23 r31 r32 r33 rx ry rz roll pitch yaw"
    " angle1 angle2 angle3 mrp1 mrp2 mrp3 axis_x axis_y axis_z angle wx wy wz Lx Ly Lz"
)
# what --units names -> the groups
OF_UNITS = {name: [name] for name in ("time", "position", "displacement", "omega", "rotation vector")}
OF_UNITS |= {"t": ["time"], "position": ["position", "points"], "length": ["position", "displacement", "points"]}
OF_UNITS |= {word: ["angles", "axis and angle", "rotation vector"] for word in ("angle", "angles")}
JUDGED = ["time", "position", "displacement", "quaternion", "matrix", "rotation vector", "angles", "axis and angle"]
JUDGED += ["mrp", "omega", "momentum", "momentum of quaternion"]
BODIES = {"body", "bodies", "name", "link", "object", "node", "id", "entity", "model", "actor", "marker", "label"}
COUNTS = {("step",), ("steps",), ("timestep",), ("time", "step"), ("frame",), ("iteration",)}  # of rows, not of bodies
WHOLE = 1e-3  # quaternions are as near to length 1
# a time with many digits before a point and in all
STAMP = re.compile(r"[-+]?(?=[\d.]{16})\d{9,}(\.\d+)?")


@dataclass
class FileTrajectory:
    """The rows of a body.

    arrays : group of columns → numbers (n, columns) in SI units; what is missing is NaN. elapsed : (n,), s, since the first row,
    with the digits of the file. quat : order of the quaternions, if their names tell it: wxyz if a name says which is the
    scalar, xyzw if they are counted from 1. frame : of ω, if its name tells it. floor : half a unit of the
    last printed digit; first_floor : of numbers as large as those of the first row. columns : the groups and their names, and
    what is not used, to be read. other_order : the option that reads quaternions in the other order, where names tell an order.
    """

    arrays: dict[str, Array]
    elapsed: Array
    quat: str | None = None
    frame: str | None = None
    floor: dict[str, float] = field(default_factory=dict)
    first_floor: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    columns: str = ""
    other_order: str = ""


def read(
    path: Path, options: Options | None = None, points: ArrayLike | None = None, com: ArrayLike = (0, 0, 0)
) -> FileTrajectory:
    """The trajectory in a file. points : (K, 3), m, places in the body whose positions the file has; com : its centre of mass.

    Rodrigues parameters, axis and angle become rotation vectors; points become rotations and positions. Equal rows count once.

    Raises
    ------
    ValueError : an empty or binary file, no time, nothing to judge, columns that may be two things, rows of several bodies.
    """
    options = options or Options()
    table = open_table(path, [int(where) for where in options.columns.values() if where.isdecimal()])
    header = table.names or [""] * table.width
    names, user_columns = _names(header, table, options)
    rows, within = _where(header, table, options)
    sample = [row for row in table.sample if all(is_same(row[i], value) for i, value in rows.items())]
    names_within = {i: name for i, name in names.items() if within(name) or i in user_columns}
    groups, notes = groups_of(names_within, user_columns)
    chosen = _points(groups, points) or _choose(groups, header, sample, options, notes)
    counted = next(
        (i for i, name in names.items() if (*name.stem, *name.part.split()) in COUNTS and i not in user_columns), None
    )
    if options.step is None and "time" not in chosen:
        raise ValueError(_no_times(table, counted))
    if options.step is not None and "time" in chosen:
        place = chosen.pop("time").places[0]
        if all(is_number(row[place]) for row in sample):  # else they are dates
            raise ValueError(f"--step is for files without times: leave it out, or the column {header[place] or place}")
    if not set(chosen) - {"time"}:
        raise ValueError(_nothing(notes, table.names))
    factors: dict[int, float] = {}
    words: list[str] = []
    track = FileTrajectory({}, np.empty(0), notes=notes)
    for kind, group in chosen.items():
        factors |= _factors(kind, group, names, table, options, notes)
        words.append(f"{kind} {' '.join(map(table.word, group.places))}")
        printed = [[row[i] for i in group.places if i < len(row)] for row in sample]
        digits, factor = [word for row in printed for word in row], max(factors[i] for i in group.places)
        track.floor[kind], track.first_floor[kind] = (_floor(digits, like) * factor for like in (None, printed[0]))
    if unused := [name for i, name in enumerate(header) if i not in {*factors, *rows} and name]:
        words.append(f"not used: {' '.join(unused)[:200]}")
    track.columns = "; ".join(words)
    if quaternion := chosen.get("quaternion"):
        if quaternion.order[0] not in "01":
            w, x, y, z = map(table.word, quaternion.places)
            track.quat, track.other_order = "wxyz", f"--columns qw={z},qx={w},qy={x},qz={y}"
        elif quaternion.order == "1 2 3 4" and options.quat is None:
            track.quat = "xyzw"
            notes.append("The fourth part of the quaternions is taken for the scalar; if it is the first: --quat wxyz.")
    if omega := chosen.get("omega") or chosen.get("momentum"):
        track.frame = frame_of(omega.stem)
    places = [i for i in range(table.width) if i not in rows and i not in user_columns]
    labels = _labels(header, table, options, places)
    clocks = chosen["time"].places if "time" in chosen else []
    stamps = [i for i in clocks if _is_stamp([row[i] for row in sample])]
    counts = [counted] if options.step is not None and counted is not None else []
    columns = table.load(sorted({*factors, *counts} - set(stamps)), [*rows, *stamps])
    keep = np.full(len(next(iter(columns.values()))), True)
    for i, value in rows.items():
        keep &= np.isin(columns[i], [word for word in set(columns[i]) if is_same(word, value)])
    if not keep.any():
        raise ValueError("there are no rows to judge")
    columns = {i: column[keep] for i, column in columns.items()}
    for kind, group in chosen.items():
        if kind != "time":
            track.arrays[kind] = np.column_stack([_scaled(columns[i], factors[i]) for i in group.places])
    if "time" in chosen:
        t, track.elapsed = _times([(columns[i], factors[i]) for i in clocks], bool(stamps))
        i = clocks[0]
        track.floor["time"] = _time_floor([row[i] for row in sample], factors[i], track.elapsed if stamps else t)
    else:
        assert options.step is not None
        k = np.arange(len(keep[keep]), dtype=float)
        if counts and len(k) > 1 and np.all((steps := np.diff(columns[counts[0]])) > 0):
            k = np.concatenate(([0.0], np.cumsum(steps / steps.min())))
        t = track.elapsed = options.step * k
    track.arrays = {"time": (t if options.t0 is None else track.elapsed + options.t0)[:, None], **track.arrays}
    _drop_equal(track, labels)
    _window(track, options)
    _turned(track)
    if "points" in track.arrays:
        _rigid(track, np.asarray(points, dtype=float), np.asarray(com, dtype=float))
    return track


def _no_times(table: FileTable, counted: int | None) -> str:
    if counted is not None and table.names:
        return f"the column {table.names[counted]} counts steps; say the time between two rows: --step SECONDS"
    header = " ".join(table.names)[:200]
    columns = f"its columns are {header}" if header else f"it has no header of {table.width} names"
    advice = "Name them: --columns t=0,x=1,… or t=0,qw=1,…; or say --step SECONDS"
    return f"no column is named t or time; {columns}. {advice}"


def _points(groups: list[Group], points: ArrayLike | None) -> dict[str, Group]:
    """The times, and the positions of all points as one group; empty if the file has not as many of them."""
    if points is None:
        return {}
    places = sorted(
        (group for group in groups if group.kind in ("position", "rotation vector or position")),
        key=lambda group: group.places[0],
    )
    if len(places) != len(np.asarray(points)):
        return {}
    every = [i for group in places for i in group.places]
    chosen = {group.kind: group for group in groups if group.kind in ("time", "omega")}
    return {**chosen, "points": Group("points", every, (), " ".join(group.order for group in places), 1)}


def _names(header: list[str], table: FileTable, options: Options) -> tuple[dict[int, Name], set[int]]:
    """The names in their parts, with those that the user says in place of others, and where these are."""
    names = {i: parse(word) for i, word in enumerate(header) if word and any(row[i] for row in table.sample)}
    user_columns: set[int] = set()
    for name, where in options.columns.items():
        said = parse(name)
        if not said.part or (said.part != "t" and not SHAPES.get(kind_of(said.stem), ())):
            raise ValueError(f"--columns: unknown {name!r}{suggestion(name, KNOWN.split())} Known: {KNOWN}")
        same = [i for i, word in enumerate(header) if word == where]
        i = same[0] if same else int(where) if where.isdecimal() else table.width
        if i >= table.width:
            row = f"the first row is {' | '.join(table.sample[0])[:100]}"
            raise ValueError(f"--columns {name}={where}: there is no such column among {table.width}: {row}")
        if len(same) > 1:
            raise ValueError(f"--columns {name}={where}: {len(same)} columns have this name; give an index from 0")
        old = names.get(i)
        names[i] = Name(said.stem, said.part, said.unit or (old.unit if old else ""), "")
        user_columns.add(i)
    return names, user_columns


def _where(header: list[str], table: FileTable, options: Options) -> tuple[dict[int, str], Callable[[Name], bool]]:
    """The columns that choose rows, and whether a name belongs to the body that is asked for."""
    rows: dict[int, str] = {}
    bodies: list[str] = []
    for name, value in options.where.items():
        place = next((i for i, word in enumerate(header) if word and word == name), None)
        place = int(name) if place is None and name.isdecimal() and int(name) < table.width else place
        if place is not None:
            rows[place] = value
            if not any(is_same(row[place], value) for row in table.sample):
                values = sorted({row[place] for row in table.sample})[:20]
                raise ValueError(f"--where {name}={value}: no row has it; there are {', '.join(values)}")
        else:
            tokens = list(parse(f"{value}.x").stem)
            if not any(tokens == list(parse(word).stem[: len(tokens)]) or value in word for word in header):
                raise ValueError(f"--where {name}={value}: there is no column {name}, and no column of {value}")
            bodies.append(tokens[0] if tokens else value)
    return rows, lambda name: not bodies or name.part == "t" or any(body in name.stem for body in bodies)


def is_same(word: str, value: str) -> bool:
    """Whether two words are the same, or the same number, as 1 and 1.0 are."""
    return word == value or (is_number(word) and is_number(value) and number(word) == number(value))


def _labels(header: Sequence[str], table: FileTable, options: Options, places: Iterable[int]) -> list[str]:
    """What to say of columns that tell of which body a row is; ValueError where that is sure."""
    notes = []
    for i in places:
        words = [row[i] for row in table.sample if i < len(row)]
        values = list(dict.fromkeys(words))
        if "" in values or not 2 <= len(values) < min(len(words), 50):
            continue
        names_bodies, is_text = bool(BODIES & set(parse(header[i]).stem)), not all(map(is_number, values))
        is_cyclic = all(word == values[k % len(values)] for k, word in enumerate(words))
        is_count = all(word.isdecimal() for word in values) and (not header[i] or names_bodies or is_cyclic)
        if is_text or is_count:
            name = header[i] or f"{i}"
            values_seen = f"the column {name} has {', '.join(values[:10])} in turn"
            notes.append(f"{values_seen}; say which rows: --where {name}={values[-1]}")
            if names_bodies or (options.step is not None and is_cyclic):
                raise ValueError(notes[-1])
    return notes


def _choose(
    groups: list[Group], header: list[str], sample: list[list[str]], options: Options, notes: list[str]
) -> dict[str, Group]:
    """One group for each quantity; ValueError where two may be it."""
    for group in groups:
        words = [header[i] or f"{i}" for i in group.places]
        if group.kind == "quaternion or position":
            if _long_one(sample, group.places) and not _long_one(sample, group.places[1:]):
                group.kind = "quaternion"
                notes += _assumptions(group, words, "quaternion, for it has length 1", "p", words[1:])
            else:
                group.kind, group.places, group.order = "position", group.places[1:], "x y z"
        if group.kind == "gyro" and not any(other.kind == "omega" for other in groups):
            group.kind = "omega"
            notes += _assumptions(group, words, "gyro", "w", ["…"] * 3)
        if group.kind == "three of a rotation" and options.angles:
            group.kind = "angles"
        if group.kind == "rotation vector or position":
            is_place = _are_places(group, groups, sample)
            group.kind = "position" if is_place else "rotation vector"
            if is_place or words[0] != "rx":  # rx is its name here
                notes += _assumptions(group, words, group.kind, "r" if is_place else "p", words)
    chosen: dict[str, Group] = {}
    for kind in JUDGED:
        same = [group for group in groups if group.kind == kind]
        best = [group for group in same if group.rank == min(each.rank for each in same)]
        if kind == "time" and len(best) > 1:
            best = _clock(best, header) or best
        if len(best) > 1:
            candidates = "; ".join(" ".join(header[i] for i in group.places) for group in best)
            short = {"position": "x", "quaternion": "qw", "matrix": "r11", "omega": "wx", "time": "t"}.get(kind, "…")
            which = f"Say which: --columns {short}=…, or --where body=…"
            if kind == "position" and len(best) > 2:
                which += "; or, of points of one body, give their places in it: points = [[…], …] in the TOML file"
            raise ValueError(f"several columns may be the {kind}: {candidates[:300]}. {which}")
        if best and best[0].twice and kind != "time":
            word = header[best[0].places[0]]
            raise ValueError(f"names occur twice, such as {word!r}; give indices from 0: --columns {word}=1,…")
        if best:
            chosen[kind] = best[0]
    if "omega" in chosen:  # then a momentum tells nothing more, and may be in other axes
        chosen = {kind: group for kind, group in chosen.items() if not kind.startswith("momentum")}
    _order_angles(chosen, header, options, notes)
    for group in groups:
        if group.kind == "three of a rotation" and not options.angles and not {"quaternion", "matrix"} & set(chosen):
            candidates = " ".join(header[i] for i in group.places)
            either = "if angles, say --angles ZYX; if a rotation vector, --columns rx=…,ry=…,rz=…."
            notes.append(f"{candidates} are no quaternion: {either}")
    for label, word in options.units.items():
        if chosen and not {*OF_UNITS.get(label, chosen)} & {*chosen}:
            raise ValueError(f"--units {label}={word}: the file has no {label}, but {', '.join(chosen)}")
    return chosen


def _order_angles(chosen: dict[str, Group], header: list[str], options: Options, notes: list[str]) -> None:
    """Angles in the order in which --angles names their axes; without it only roll, pitch and yaw are known."""
    angles, axes = chosen.get("angles"), options.angles
    if axes is not None:
        if not re.fullmatch(r"([xyz])(?!\1)([xyz])(?!\2)[xyz]|([XYZ])(?!\3)([XYZ])(?!\4)[XYZ]", axes):
            raise ValueError(f"--angles {axes}: three axes are needed, such as ZXZ or xyz")
        if angles is None:
            advice = "name them: --columns angle1=…,angle2=…,angle3=…"
            raise ValueError(f"--angles {axes}: the file has no angles; {advice}")
        if len(set(axes)) == 3 and angles.order in ROLES[:3]:  # roll is about x, pitch about y, yaw about z
            angles.places = [angles.places["xyz".index(axis)] for axis in axes.lower()]
    elif angles is not None and {"quaternion", "matrix"} & set(chosen):
        del chosen["angles"]  # what they are about is surer of the others
    elif angles is not None and angles.order != "roll pitch yaw":
        words = " ".join(header[i] or f"{i}" for i in angles.places)
        notes.append(f"{words} are angles: say about which axes, --angles ZYX (that move) or xyz (that do not).")
        del chosen["angles"]


def _clock(clocks: list[Group], header: list[str]) -> list[Group]:
    """Seconds and nanoseconds of one time stamp; else the column that is just named t or time."""
    stamps = {parse(header[i]).unit[:1]: i for group in clocks for i in group.places}
    if len(clocks) == 2 and set(stamps) == {"s", "n"} and clocks[0].stem == clocks[1].stem:
        return [Group("time", [stamps["s"], stamps["n"]], clocks[0].stem, "t t", 1)]
    plain = ([group for group in clocks if group.stem in stems] for stems in ([("t",), ("time",)], [("timestamp",)]))
    return next((groups for groups in plain if len(groups) == 1), [])


def _assumptions(group: Group, words: Sequence[str], kind: str, letter: str, names: Sequence[str]) -> list[str]:
    """What columns are taken for, and how to name them, or others, as something else; nothing where the user names them."""
    other = ",".join(f"{letter}{axis}={name}" for axis, name in zip("xyz", names, strict=True))
    return [f"{' '.join(words)} is taken for a {kind}; else say --columns {other}."] if group.rank else []


def _are_places(group: Group, groups: Sequence[Group], sample: Sequence[Sequence[str]]) -> bool:
    """Whether r_x, r_y, r_z are a position: there is another rotation, or their distance from the origin is constant."""
    kinds = {other.kind for other in groups if other is not group}
    if group.rank == 0 or "position" in kinds:  # rank 0: the user names them
        return False
    lengths = _lengths(sample, group.places)
    lengths = lengths[np.isfinite(lengths)]
    constant = len(lengths) > 2 and np.ptp(lengths) < WHOLE * lengths.max()
    return bool(constant or kinds & {"quaternion", "matrix", "angles", "axis and angle", "mrp", "three of a rotation"})


def _long_one(sample: Sequence[Sequence[str]], places: Sequence[int]) -> bool:
    return bool(np.nanmax(np.abs(_lengths(sample, places) - 1), initial=0.0) < WHOLE)


def _lengths(sample: Sequence[Sequence[str]], places: Sequence[int]) -> np.ndarray:
    """Of the vectors in these columns; NaN where one is no number."""
    values = [[number(row[i], True) if is_number(row[i], True) else math.nan for i in places] for row in sample]
    return np.linalg.norm(np.array(values), axis=1)


def _factors(
    kind: str, group: Group, names: Mapping[int, Name], table: FileTable, options: Options, notes: list[str]
) -> dict[int, float]:
    """What leads to SI units, for each column: as the user says, the name, a row of units, or the text above."""
    for label, word in options.units.items():
        if label not in OF_UNITS:
            raise ValueError(f"--units: unknown {label!r}{suggestion(label, OF_UNITS)} Known: {', '.join(OF_UNITS)}")
        if unit_of(word) is None:
            raise ValueError(f"--units {label}={word}: unknown unit; such as s, ms, mm, ft, deg, deg/s, rpm")
    if kind not in EXPECTED:
        return dict.fromkeys(group.places, 1.0)
    expected = EXPECTED[kind]
    said = next((unit_of(word) for label, word in options.units.items() if kind in OF_UNITS[label]), None)
    degrees = re.search(r"indegrees\s*[=,:]?\s*(yes|true)", table.above, re.IGNORECASE)
    lengths = re.search(r"length units?\W+(\w+)", table.above, re.IGNORECASE)
    general = UNITS["deg"] if degrees and expected == "rad" else None
    general = unit_of(lengths[1]) if lengths and expected == "m" else general
    factors = {}
    for i, part in zip(group.places, group.order.split(), strict=False):
        name = names[i]
        written = name.unit or table.units.get(i, "")
        unit: Unit = said or (unit_of(written) if written else general) or UNITS["1"]
        if kind == "axis and angle" and part != "angle":
            unit = UNITS["1"]
        if unit.kind not in (expected, "1"):
            label = next((label for label in options.units if said and kind in OF_UNITS[label]), "")
            advice = f"it needs one such as {expected}: --units {kind if kind in OF_UNITS else 'angle'}={expected}"
            named = options.units.get(label, written)
            raise ValueError(f"{table.word(i)} is {kind}, but its unit is {named}; {advice}")
        if name.strange and not said:
            assumption = f"{expected} is taken; else say --units {kind}=…."
            notes.append(f"{table.word(i)}: {name.strange!r} is no known unit, {assumption}")
        factors[i] = unit.factor
    return factors


def _nothing(notes: list[str], header: list[str]) -> str:
    nothing = f"nothing to judge but times: no position, rotation or angular velocity. {' '.join(notes)}".strip()
    columns = f"Its columns are {' '.join(header)[:200]}. " if header else ""
    return f"{nothing} {columns}Name them: --columns x=1,y=2,z=3 or qw=4,… or r11=4,… or wx=4,… or angle1=4,…"


def _floor(words: Sequence[str], like: Sequence[str] | None = None) -> float:
    """Half a unit of the last digit of the numbers with most digits; 0 where these are 15, or where numbers are too few.

    like : of numbers only that are no larger than these.
    """
    numbers = _decimals(words)
    most = max((len(number.as_tuple().digits) for number in numbers), default=15)
    if most >= 15 or len(numbers) < 10:
        return 0.0
    top = max((number.adjusted() for number in _decimals(like or ())), default=math.inf)
    long = [number.as_tuple() for number in numbers if number.adjusted() <= top]
    exponents = [int(number.exponent) for number in long if len(number.digits) == most]
    return float(10.0 ** max(exponents, default=-math.inf) / 2)


def _decimals(words: Sequence[str]) -> set[Decimal]:
    plain = {re.sub(r"[dDqQ]", "e", word).replace(",", ".") for word in words}
    known = {word for word in plain if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", word, re.IGNORECASE)}
    return set(map(Decimal, known))


def _time_floor(words: list[str], factor: float, t: Array) -> float:
    """What times are rounded by, s; 0 where their digits are exact, as those of equal steps are. t : the times, s."""
    digit, t = _floor(words) * factor, np.unique(t[: len(words)])
    if len(t) < 10:
        return 0.0
    steps, ulp, span = np.diff(t), float(np.spacing(np.abs(t).max())), float(np.ptp(t))
    rounded = np.ptp(steps) > max(1e-3 * digit, 4 * ulp) and 1e3 * digit < span
    return max(digit * rounded, ulp / 2 * (ulp > 1e-10 * span))


def _is_stamp(words: Sequence[str]) -> bool:
    """Whether these times have more digits than a double holds, as nanoseconds since 1970 have."""
    known = all(STAMP.fullmatch(word) for word in words)
    return known and any(Decimal(word) != Decimal(f"{float(word):.17g}") for word in words)


def _scaled(values: Array, factor: float) -> Array:
    """Values in SI units; 1/1000 is no double, so they are divided by 1000."""
    whole = round(1 / factor) if factor < 1 else 0
    return values / whole if whole and 1 / whole == factor else values * factor


def _times(clocks: Sequence[tuple[Array, float]], is_stamp: bool) -> tuple[Array, Array]:
    """Times, and times since the first row, (n,), s, of clocks (column, factor) that are added. is_stamp : words, not numbers."""
    t, elapsed = np.zeros(1), np.zeros(1)
    for column, factor in clocks:
        since = column.astype(float) - float(column[0])
        if is_stamp:  # nanoseconds since 1970 have more digits than a double
            exact = [Decimal(word) for word in column.tolist()]
            since = np.array([float(word - exact[0]) for word in exact])
        t, elapsed = t + _scaled(column.astype(float), factor), elapsed + _scaled(since, factor)
    return t, elapsed


def _drop_equal(track: FileTrajectory, several: Sequence[str]) -> None:
    """Leave out rows that are equal to the one before. ValueError where times go back, and `several` says of which bodies."""
    late = np.diff(track.elapsed, prepend=-math.inf)
    same = late == 0
    for values in track.arrays.values():
        same[1:] &= ((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))).all(axis=1)
    if several and np.any(~(late > 0) & ~same):
        raise ValueError(several[0])
    if count := int(np.count_nonzero(same)):
        _keep(track, ~same)
        track.notes.append(f"{count} row{'s are' if count > 1 else ' is'} equal to the one before, and left out.")


def _window(track: FileTrajectory, options: Options) -> None:
    """Leave out rows before `since` and after `until`."""
    t = track.arrays["time"][:, 0]
    blur = 1e-9 * max(float(np.abs(t).max(initial=0.0)), 1e-300)  # 0.30000000000000004 is 0.3
    inside = (t >= (-math.inf if options.since is None else options.since - blur)) & (
        t <= (math.inf if options.until is None else options.until + blur)
    )
    if np.all(inside | ~np.isfinite(t)):
        return
    if not inside.any():
        raise ValueError(f"no row is in the window: the times go from {t[0]:.9g} to {t[-1]:.9g} s")
    _keep(track, inside)
    track.notes.append(f"{np.count_nonzero(~inside)} rows are outside the window, and left out.")


def _keep(track: FileTrajectory, rows: Array) -> None:
    track.arrays = {kind: values[rows] for kind, values in track.arrays.items()}
    track.elapsed = track.elapsed[rows] - track.elapsed[rows][0]


def _turned(track: FileTrajectory) -> None:
    """Write Rodrigues parameters, axis and angle as rotation vectors, and a momentum of quaternions as a momentum in the body."""
    groups = track.arrays
    for kind in [kind for kind in ("mrp", "axis and angle") if kind in groups]:
        values = groups.pop(kind)
        bad = ~np.isfinite(values).all(axis=1)
        values = np.where(bad[:, None], 1.0, values)
        if kind == "mrp":
            turns = Rotation.from_mrp(values)
        else:
            lengths = np.linalg.norm(values[:, :3], axis=1, keepdims=True)
            turns = Rotation.from_rotvec(values[:, :3] / np.where(lengths > 0, lengths, 1.0) * values[:, 3:])
        vectors = turns.as_rotvec()
        vectors[bad] = math.nan
        if "rotation vector" in groups:
            raise ValueError(f"{kind} and a rotation vector are there; choose one by --columns")
        groups["rotation vector"], track.floor["rotation vector"] = vectors, track.floor.get(kind, 0.0)
    if (p := groups.pop("momentum of quaternion", None)) is not None and "quaternion" in groups:
        q = groups["quaternion"]
        if track.quat == "xyzw":
            p, q = np.roll(p, 1, axis=1), np.roll(q, 1, axis=1)
        # of molecular dynamics: p = 2 q (0, L)
        groups["momentum"] = (q[:, :1] * p[:, 1:] - p[:, :1] * q[:, 1:] - np.cross(q[:, 1:], p[:, 1:])) / 2
        track.frame = "body"


def _rigid(track: FileTrajectory, points: Array, com: Array) -> None:
    """Rotations and positions from points of the body by Kabsch: R maximises Σ (xᵢ − x̄)·R (pᵢ − p̄)."""
    x = track.arrays.pop("points").reshape(-1, *points.shape)
    middle, p = x.mean(axis=1), points - points.mean(axis=0)
    good = np.isfinite(x).all(axis=(1, 2))
    H = np.where(good[:, None, None], np.einsum("nki,kj->nij", x - middle[:, None], p), np.eye(3))
    U, _, V = np.linalg.svd(H)
    U[:, :, 2] *= np.linalg.det(U @ V)[:, None]
    R = np.where(good[:, None, None], U @ V, np.nan)
    track.arrays |= {"matrix": R.reshape(-1, 9), "position": middle + R @ (com - points.mean(axis=0))}
    pairs = np.triu_indices(len(points), 1)
    now, right = (np.linalg.norm(a[..., pairs[0], :] - a[..., pairs[1], :], axis=-1) for a in (x, points))
    change = np.abs(now / right - 1)
    size = float(np.nanmedian(now / right))
    off = f"their distances are off by up to {np.nanmax(change):.2g} of their size"
    track.notes.append(f"Rotations are those of {len(points)} points; {off}.")
    if abs(size - 1) > 0.1:
        lengths = [name for name, unit in UNITS.items() if unit.kind == "m"]
        unit = min(lengths, key=lambda name: abs(math.log(size * UNITS[name].factor)))
        track.notes.append(f"The points are {size:.4g} times as far apart as in the body: --units position={unit}?")
