"""Which columns of a file are what, in which units and conventions: by its names, by its first rows, by what the user says."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from lagrange_bench.judging.names import (
    EXPECTED,
    ROLES,
    SHAPES,
    UNITS,
    Group,
    Name,
    Unit,
    groups_of,
    kind_of,
    parse,
    unit_of,
)
from lagrange_bench.judging.rows import Table, is_number, number, open_table
from lagrange_bench.support.words import suggestion

Array = np.ndarray
KNOWN = (
    "t x y z px py pz ux uy uz qw qx qy qz q0 q1 q2 q3 q4 e0 e1 e2 e3 r11 r12 r13 r21 r22 r23 r31 r32 r33 rx ry rz roll pitch yaw"
    " angle1 angle2 angle3 mrp1 mrp2 mrp3 axis_x axis_y axis_z angle wx wy wz"
)
# what --units names -> the groups
OF_UNITS = {name: [name] for name in ("time", "position", "displacement", "omega", "rotation vector")}
OF_UNITS |= {"t": ["time"], "length": ["position", "displacement"]}
OF_UNITS |= {word: ["angles", "axis and angle", "rotation vector"] for word in ("angle", "angles")}
JUDGED = ["time", "position", "displacement", "quaternion", "matrix", "rotation vector", "angles", "axis and angle"]
JUDGED += ["mrp", "omega"]
BODIES = {"body", "bodies", "name", "link", "object", "node", "id", "entity", "model", "actor", "marker", "label"}
WHOLE = 1e-3  # quaternions are as near to length 1


@dataclass(frozen=True)
class Options:
    """What the user says of a file.

    columns : name → word of the header, or index from 0. units : group → unit. angles : the axes of three angles, as SciPy names
    them. where : column → the word in its rows that are read. step : s, where there are no times. t0 : s, the first time. quat :
    the order of quaternions without names.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    angles: str | None = None
    where: Mapping[str, str] = field(default_factory=dict)
    step: float | None = None
    t0: float | None = None
    quat: str | None = None


@dataclass
class Layout:
    """How a file is written.

    groups : the indices of its columns. quat : order of the quaternions, if their names tell it: wxyz if a name says which is
    the scalar, xyzw if they are counted from 1. floor : half a unit of the last printed digit; first_floor : of numbers as large
    as those of the first row. columns : the groups and their names, and what is not used, to be read.
    """

    table: Table
    how: Options
    groups: dict[str, list[int]]
    quat: str | None
    floor: dict[str, float]
    first_floor: dict[str, float]
    notes: list[str]
    columns: str
    factors: dict[int, float]
    rows: dict[int, str]
    labels: list[int]


def survey(path: Path, how: Options | None = None) -> Layout:
    """How a file is written, from its beginning.

    Raises
    ------
    ValueError : an empty or binary file, no time, nothing to judge, columns that may be two things.
    """
    how = how or Options()
    table = open_table(path, [int(where) for where in how.columns.values() if where.isdecimal()])
    header = table.names or [""] * table.width
    names, given = _names(header, table, how)
    rows, within = _where(header, table, how)
    sample = [row for row in table.sample if is_chosen(row, rows)]
    free = [i for i in range(table.width) if i not in rows and i not in given]
    labels = [i for i in free if _label(header[i], table.sample, i)]
    groups, notes = groups_of({i: name for i, name in names.items() if within(name) or i in given}, given)
    chosen = _choose(groups, header, sample, how, notes)
    if how.step is None and "time" not in chosen:
        listed = f"its columns are {' '.join(table.names)[:200]}" if table.names else ""
        columns = listed or f"it has no header of {table.width} names"
        advice = "Name them: --columns t=0,x=1,… or t=0,qw=1,…; or say --step SECONDS"
        raise ValueError(f"no column is named t or time; {columns}. {advice}")
    if how.step is not None and "time" in chosen:
        place = chosen.pop("time").places[0]
        if all(is_number(row[place]) for row in sample):  # else they are dates
            raise ValueError(f"--step is for files without times: leave it out, or the column {header[place] or place}")
    if not set(chosen) - {"time"}:
        raise ValueError(_nothing(names, notes, table.names))
    quat = None
    if "quaternion" in chosen:
        order = chosen["quaternion"].order
        if order[0] not in "01":  # named by letters
            quat = "wxyz"
        elif order == "1 2 3 4" and how.quat is None:
            quat = "xyzw"
            notes.append("The fourth part of the quaternions is taken for the scalar; if it is the first: --quat wxyz.")
    factors: dict[int, float] = {}
    words: list[str] = []
    floor: dict[str, float] = {}
    first_floor: dict[str, float] = {}
    for kind, group in chosen.items():
        factors |= _factors(kind, group, header, names, table, how, notes)
        words.append(f"{kind} {' '.join(header[i] if table.names else f'{i}' for i in group.places)}")
        printed = [[row[i] for i in group.places if i < len(row)] for row in sample]
        digits, factor = [word for row in printed for word in row], max(factors[i] for i in group.places)
        floor[kind], first_floor[kind] = (_floor(digits, like) * factor for like in (None, printed[0]))
    used = {*factors, *rows}
    if unused := [name for i, name in enumerate(header) if i not in used and name]:
        words.append(f"not used: {' '.join(unused)[:200]}")
    if "time" in chosen:
        i = chosen["time"].places[0]
        floor["time"] = _time_floor([row[i] for row in sample]) * factors[i]
    for i in labels:
        if BODIES & set(parse(header[i]).stem) or (how.step is not None and _cyclic([row[i] for row in table.sample])):
            raise ValueError(several(header, table, i))
    places = {kind: group.places for kind, group in chosen.items()}
    columns = "; ".join(words)
    return Layout(table, how, places, quat, floor, first_floor, notes, columns, factors, rows, labels)


def _names(header: list[str], table: Table, how: Options) -> tuple[dict[int, Name], set[int]]:
    """The names in their parts, with those that the user says in place of others, and where these are."""
    names = {i: parse(word) for i, word in enumerate(header) if word and any(row[i] for row in table.sample)}
    given: set[int] = set()
    for name, where in how.columns.items():
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
        given.add(i)
    return names, given


def _where(header: list[str], table: Table, how: Options) -> tuple[dict[int, str], Any]:
    """The columns that choose rows, and whether a name belongs to the body that is asked for."""
    rows: dict[int, str] = {}
    bodies: list[str] = []
    for name, value in how.where.items():
        place = next((i for i, word in enumerate(header) if word and word == name), None)
        place = int(name) if place is None and name.isdecimal() and int(name) < table.width else place
        if place is not None:
            rows[place] = value
            if not any(is_chosen(row, {place: value}) for row in table.sample):
                values = sorted({row[place] for row in table.sample})[:20]
                raise ValueError(f"--where {name}={value}: no row has it; there are {', '.join(values)}")
        else:
            tokens = list(parse(f"{value}.x").stem)
            if not any(tokens == list(parse(word).stem[: len(tokens)]) or value in word for word in header):
                raise ValueError(f"--where {name}={value}: there is no column {name}, and no column of {value}")
            bodies.append(tokens[0] if tokens else value)
    return rows, lambda name: not bodies or name.part == "t" or any(body in name.stem for body in bodies)


def is_chosen(row: Sequence[str] | Mapping[int, str], rows: Mapping[int, str]) -> bool:
    """Whether a row has these words in these columns; 1 and 1.0 are the same."""

    def same(one: str, two: str) -> bool:
        return one == two or (is_number(one) and is_number(two) and number(one) == number(two))

    return all(same(row[i], value) for i, value in rows.items())


def _label(name: str, sample: Sequence[Sequence[str]], i: int) -> bool:
    """Whether a column may say of which body a row is: it has a few words or whole numbers in turn."""
    words = [row[i] for row in sample if i < len(row)]
    values = set(words)
    if not 2 <= len(values) < min(len(words), 50) or "" in values:
        return False
    if any(not is_number(word) for word in values):
        return True
    may_count = not name or bool(BODIES & set(parse(name).stem)) or _cyclic(words)
    return may_count and all(word.isdecimal() for word in values)


def _cyclic(words: Sequence[str]) -> bool:
    n = len(set(words))
    return len(words) > n > 1 and all(word == words[i % n] for i, word in enumerate(words))


def several(header: Sequence[str], table: Table, i: int) -> str:
    """What to say of a file whose rows are of several bodies, as column i shows."""
    name, values = header[i] or f"{i}", list(dict.fromkeys(row[i] for row in table.sample))
    return f"the column {name} has {', '.join(values[:10])} in turn; say which rows: --where {name}={values[-1]}"


def _choose(
    groups: list[Group], header: list[str], sample: list[list[str]], how: Options, notes: list[str]
) -> dict[str, Group]:
    """One group for each quantity; ValueError where two may be it."""
    for group in groups:
        if group.kind == "quaternion or position":
            _, x, y, z = group.places
            if _long_one(sample, group.places) and not _long_one(sample, group.places[1:]):
                group.kind, words = "quaternion", " ".join(header[i] for i in group.places)
                if group.rank:
                    advice = f"else say --columns px={x},py={y},pz={z}."
                    notes.append(f"{words} is taken for a quaternion, for it has length 1; {advice}")
            else:
                group.kind, group.places, group.order = "position", [x, y, z], "x y z"
        if group.kind == "three of a rotation" and how.angles:
            group.kind = "angles"
        if group.kind == "rotation vector or position":
            group.kind = "position" if _are_places(group, groups, sample) else "rotation vector"
            first, second, third = (header[i] for i in group.places)
            if group.rank and (group.kind == "position" or first != "rx"):  # rx is its name here
                p = "r" if group.kind == "position" else "p"
                advice = f"else say --columns {p}x={first},{p}y={second},{p}z={third}."
                notes.append(f"{first} {second} {third} is taken for a {group.kind}; {advice}")
    chosen: dict[str, Group] = {}
    for kind in JUDGED:
        same = [group for group in groups if group.kind == kind]
        best = [group for group in same if group.rank == min(each.rank for each in same)]
        if kind == "time" and len(best) > 1:
            best = _clock(best, header) or best
        if len(best) > 1:
            listed = "; ".join(" ".join(header[i] for i in group.places) for group in best)
            short = {"position": "x", "quaternion": "qw", "matrix": "r11", "omega": "wx", "time": "t"}.get(kind, "…")
            which = f"Say which: --columns {short}=…, or --where body=…"
            raise ValueError(f"several columns may be the {kind}: {listed[:300]}. {which}")
        if best and best[0].twice and kind != "time":
            word = header[best[0].places[0]]
            raise ValueError(f"names occur twice, such as {word!r}; give indices from 0: --columns {word}=1,…")
        if best:
            chosen[kind] = best[0]
    _order_angles(chosen, header, how, notes)
    for group in groups:
        if group.kind == "three of a rotation" and not how.angles and not {"quaternion", "matrix"} & set(chosen):
            words = " ".join(header[i] for i in group.places)
            either = "if angles, say --angles ZYX; if a rotation vector, --columns rx=…,ry=…,rz=…."
            notes.append(f"{words} are no quaternion: {either}")
    for what, word in how.units.items():
        if chosen and not {*OF_UNITS.get(what, chosen)} & {*chosen}:
            raise ValueError(f"--units {what}={word}: the file has no {what}, but {', '.join(chosen)}")
    return chosen


def _order_angles(chosen: dict[str, Group], header: list[str], how: Options, notes: list[str]) -> None:
    """Angles in the order in which --angles names their axes; without it only roll, pitch and yaw are known."""
    angles, axes = chosen.get("angles"), how.angles
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
    kind: str, group: Group, header: list[str], names: Mapping[int, Name], table: Table, how: Options, notes: list[str]
) -> dict[int, float]:
    """What leads to SI units, for each column: as the user says, the name, a row of units, or the text above."""
    for what, word in how.units.items():
        if what not in OF_UNITS:
            raise ValueError(f"--units: unknown {what!r}{suggestion(what, OF_UNITS)} Known: {', '.join(OF_UNITS)}")
        if unit_of(word) is None:
            raise ValueError(f"--units {what}={word}: unknown unit; such as s, ms, mm, ft, deg, deg/s, rpm")
    if kind not in EXPECTED:
        return dict.fromkeys(group.places, 1.0)
    expected = EXPECTED[kind]
    said = next((unit_of(word) for what, word in how.units.items() if kind in OF_UNITS[what]), None)
    degrees = re.search(r"indegrees\s*[=,:]?\s*(yes|true)", table.above, re.IGNORECASE)
    lengths = re.search(r"length units?\W+(\w+)", table.above, re.IGNORECASE)
    general = UNITS["deg"] if degrees and expected == "rad" else None
    general = unit_of(lengths[1]) if lengths and expected == "m" else general
    factors = {}
    for i, part in zip(group.places, group.order.split(), strict=False):
        name = names[i]
        own = name.unit or table.units.get(i, "")
        unit: Unit = said or (unit_of(own) if own else general) or UNITS["1"]
        if kind == "axis and angle" and part != "angle":
            unit = UNITS["1"]
        if unit.kind not in (expected, "1"):
            advice = f"say --units {kind if kind in OF_UNITS else 'angle'}={expected}"
            raise ValueError(f"{header[i] or i} is {kind}, but its unit is {own or how.units}: {advice}")
        if name.strange and not said:
            taken = f"{expected} is taken; else say --units {kind}=…."
            notes.append(f"{header[i]}: {name.strange!r} is no known unit, {taken}")
        factors[i] = unit.factor
    return factors


def _nothing(names: Mapping[int, Name], notes: list[str], header: list[str]) -> str:
    if {(("j",), "1"), (("3",), "x")} <= {(name.stem, name.part) for name in names.values()}:
        return "a run of the bench in J and x has no position or rotation; its `error()` compares it"
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


def _time_floor(words: list[str]) -> float:
    """What the times are rounded by; 0 where their digits are exact, as those of equal steps are."""
    digit, t = _floor(words), np.unique([number(word, True) for word in words if is_number(word, True)])
    if len(t) < 10:
        return 0.0
    steps, ulp, span = np.diff(t), float(np.spacing(np.abs(t).max())), float(np.ptp(t))
    rounded = np.ptp(steps) > max(1e-3 * digit, 4 * ulp) and 1e3 * digit < span
    return max(digit * rounded, ulp / 2 * (ulp > 1e-10 * span))
