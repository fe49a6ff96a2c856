"""The columns of a trajectory that any program wrote as text: which is what, and their numbers."""

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators.words import suggestion

NAMES = {  # what stands in a group of columns → the names that it may have
    "time": ("t", "time"),
    "position": ("px py pz", "pos_x pos_y pos_z", "position_x position_y position_z", "x y z"),
    "displacement": ("ux uy uz", "u0 u1 u2"),
    "quaternion": (
        "qw qx qy qz", "q_w q_x q_y q_z", "quat_w quat_x quat_y quat_z",
        "orientation_w orientation_x orientation_y orientation_z", "q0 q1 q2 q3", "e0 e1 e2 e3",
    ),
    "matrix": ("r11 r12 r13 r21 r22 r23 r31 r32 r33", "r00 r01 r02 r10 r11 r12 r20 r21 r22"),
    "rotation vector": ("rx ry rz", "rvx rvy rvz"),
    "angles": ("roll pitch yaw",),
    "omega": ("wx wy wz", "omega_x omega_y omega_z", "angular_velocity_x angular_velocity_y angular_velocity_z"),
}  # fmt: skip
SCALARS = ("qw", "q_w", "quat_w", "orientation_w")  # they say which part of a quaternion is the scalar
UNITS = {"", "s", "sec", "m", "rad", "rad/s", "-"}  # that may stand in brackets behind a name; indices may, too
HEAD = 1 << 18  # bytes in which the header and some lines of numbers must stand
SAMPLE = 200  # lines whose printed digits are counted


class Layout(NamedTuple):
    """How a file is written.

    groups : the indices of its columns. named : whether the names of the columns say which part of a quaternion is the scalar.
    floor : half a unit of the last printed digit. columns : the groups and their names, and what is not used, to be read.
    """

    path: Path
    separator: str | None
    comment: str
    skip: int
    width: int
    groups: dict[str, list[int]]
    named: bool
    floor: dict[str, float]
    notes: list[str]
    columns: str


def survey(path: Path, given: Mapping[str, str] | None = None) -> Layout:
    """How the file is written, from its beginning.

    given : name → word of the header, or index of the column from 0; for files whose header has other names or none.

    Raises
    ------
    ValueError : an empty or binary file, no column of time, nothing to judge.
    """
    lines = _head(path)
    shown = [i for i, line in enumerate(lines) if line.strip()]
    comments = [i for i in shown if lines[i].lstrip()[0] in "#%"]
    comment = lines[comments[0]].lstrip()[0] if comments else "#"
    body = [i for i in shown if i not in set(comments)]
    separator = next((mark for mark in ";\t," if body and mark in lines[body[0]]), None)
    rows = [_words(lines[i].partition(comment)[0], separator) for i in body[: SAMPLE + 1]]
    above = [_words(lines[i].lstrip(" #%"), separator) for i in comments if i < body[0]] if body else []
    header = above[-1] if above and len(above[-1]) == len(rows[0]) else []
    if rows and not all(map(_is_number, rows[0])):
        header, rows, body = rows[0], rows[1:], body[1:]
    if not rows:
        raise ValueError(f"{path}: there is no line of numbers in it")
    width = len(header or rows[0])
    for i, row in zip(body, rows, strict=False):
        if len(row) != width:
            raise ValueError(f"{path}, line {i + 1}: {len(row)} columns instead of {width}")
    index = _index(path, header, width, given or {})
    groups, notes = _groups(index)
    if "time" not in groups:
        there = f"its columns are {' '.join(header)[:200]}" if header else "it has no header"
        raise ValueError(f"{path}: no column is named t or time; {there}. Name them: --columns t=0,x=1,y=2,z=3")
    if len(groups) == 1:
        nothing = f"nothing to judge but times: no position, rotation or angular velocity. {' '.join(notes)}".strip()
        there = f"Its columns are {' '.join(header)[:200]}. " if header else ""
        if {"j1", "x3"} <= set(index):
            raise ValueError(
                f"{path}: a run of the bench in J and x has no position or rotation; its `error()` compares it"
            )
        raise ValueError(f"{path}: {nothing} {there}Name them: --columns x=1,y=2,z=3 or qw=4,…")
    used = {i for places in groups.values() for i in places}
    words = [f"{what} {' '.join(header[i] if header else f'{i}' for i in places)}" for what, places in groups.items()]
    if unused := [name for i, name in enumerate(header) if i not in used and name]:
        words.append(f"not used: {' '.join(unused)[:200]}")
    units = {unit for i in used for unit in re.findall(r"[\[(](.*?)[\])]", header[i] if header else "")}
    if strange := sorted(unit for unit in units if unit.strip().lower() not in UNITS and not unit.isdecimal()):
        there = f"but the header has {', '.join(strange)}: s, m, rad and rad/s are expected."
        notes.append(f"Units are not converted, {there}")
    floor = {name: _floor([row[i] for row in rows for i in places]) for name, places in groups.items()}
    named = any(index.get(name, -1) in groups.get("quaternion", ()) for name in SCALARS)
    return Layout(path, separator, comment, body[0], width, groups, named, floor, notes, "; ".join(words))


def _head(path: Path) -> list[str]:
    with path.open("rb") as file:
        if not file.seekable():
            raise ValueError(f"{path}: a pipe cannot be read twice; write a file")
        start = file.read(HEAD)
    if not start.strip():
        raise ValueError(f"{path}: the file is empty")
    whole = start[: start.rfind(b"\n") + 1] if len(start) == HEAD else start
    try:
        text = whole.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text or not whole:
        raise ValueError(f"{path}: this is no text in UTF-8 with one row a line")
    return text.split("\n")


def _words(line: str, separator: str | None) -> list[str]:
    return [word.strip().strip("\"'") for word in line.strip(" \r\n").split(separator)]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return not word
    return True


def _index(path: Path, header: list[str], width: int, given: Mapping[str, str]) -> dict[str, int]:
    """Name → column; units in brackets and capitals do not matter, and a point is as good as _."""
    plain = [re.sub(r"[\[(].*", "", word).strip().lower().replace(".", "_") for word in header]
    index = {name: i for i, name in reversed(list(enumerate(plain)))}
    known = {name for choices in NAMES.values() for names in choices for name in names.split()}
    for name, where in given.items():
        if name not in known:
            raise ValueError(f"--columns: unknown {name!r}{suggestion(name, known)} Known: {' '.join(sorted(known))}")
        index[name] = int(where) if where.isdecimal() else header.index(where) if where in header else width
        if index[name] >= width:
            raise ValueError(f"{path}: --columns {name}={where}: there is no such column among {width}")
    return index


def _groups(index: Mapping[str, int]) -> tuple[dict[str, list[int]], list[str]]:
    """The groups that are complete, and what to say of others."""
    groups, notes = {}, []
    for what, choices in NAMES.items():
        best = max((names.split() for names in choices), key=lambda names: sum(name in index for name in names))
        missing = [name for name in best if name not in index]
        if not missing:
            groups[what] = [index[name] for name in best]
        elif len(missing) < len(best):
            notes.append(f"No {what}: there is no column {', '.join(missing)}.")
    return groups, notes


def _floor(words: list[str]) -> float:
    """Half a unit of the last digit of the numbers with most digits; 0 where these are 15, or where numbers are too few."""
    known = {word for word in words if word and _is_number(word) and math.isfinite(float(word))}
    numbers = [Decimal(word).as_tuple() for word in known]
    most = max((len(number.digits) for number in numbers), default=15)
    if most >= 15 or len(numbers) < 10:
        return 0.0
    return float(10.0 ** max(int(number.exponent) for number in numbers if len(number.digits) == most) / 2)


def read(layout: Layout) -> dict[str, np.ndarray]:
    """The rows: group → numbers (n, columns); what is missing is NaN.

    Raises
    ------
    ValueError : a line with other than numbers, or with too many.
    """
    import pandas as pd

    wanted = sorted({i for places in layout.groups.values() for i in places})
    usecols = wanted if len(wanted) < layout.width else None  # a line with too many columns is an error without it
    settings: dict[str, Any] = {"sep": layout.separator or r"\s+", "comment": layout.comment, "skiprows": layout.skip}
    settings |= {"header": None, "usecols": usecols, "dtype": float, "skipinitialspace": True, "compression": None}
    try:
        frame = pd.read_csv(layout.path, **settings)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{layout.path}{_fault(layout, wanted) or f': {error}'}") from None
    return {name: frame[places].to_numpy() for name, places in layout.groups.items()}


def _fault(layout: Layout, wanted: list[int]) -> str:
    """The first line that cannot be read, and why."""
    with layout.path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, 1):
            if number <= layout.skip or not line.strip() or line.lstrip().startswith(layout.comment):
                continue
            words = _words(line.partition(layout.comment)[0], layout.separator)
            if len(words) > layout.width:
                return f", line {number}: {len(words)} columns instead of {layout.width}"
            for word in (words[i] for i in wanted if i < len(words)):
                if not _is_number(word):
                    point = " (decimals need a point)" if re.fullmatch(r"[-+\d]+,\d+", word) else ""
                    return f", line {number}: {word[:40]!r} is no number{point}"
    return ""
