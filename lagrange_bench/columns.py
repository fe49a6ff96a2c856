"""The columns of a trajectory that any program wrote as text: which is what, and their numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.integrators.words import suggestion

NAMED = ("qw", "qx", "qy", "qz")
NAMES = {  # what stands in a group of columns → the names that it may have
    "time": ("t", "time"),
    "position": ("x y z", "px py pz", "pos_x pos_y pos_z"),
    "displacement": ("ux uy uz", "u0 u1 u2"),
    "quaternion": (" ".join(NAMED), "q0 q1 q2 q3", "e0 e1 e2 e3"),
    "matrix": ("r11 r12 r13 r21 r22 r23 r31 r32 r33", "r00 r01 r02 r10 r11 r12 r20 r21 r22"),
    "rotation vector": ("rx ry rz", "rvx rvy rvz"),
    "angles": ("roll pitch yaw",),
    "omega": ("wx wy wz", "omega_x omega_y omega_z"),
}
UNITS = {"", "s", "sec", "m", "rad", "rad/s", "-"}  # that may stand in brackets behind a name; indices may, too
HEAD = 1 << 18  # bytes in which the header and the first line of numbers must stand


class Columns(NamedTuple):
    """The numbers of a file: group → (n, columns); whether names say which part of a quaternion is the scalar; remarks."""

    groups: dict[str, np.ndarray]
    named: bool
    notes: list[str]


def read(path: Path, given: Mapping[str, str] | None = None) -> Columns:
    """The columns of a file whose names are known; what is missing in a line is NaN.

    given : name → word of the header, or index of the column from 0; for files whose header has other names or none.

    Raises
    ------
    ValueError : an empty or binary file, no column of time, nothing to judge, a line with other than numbers or with too many.
    """
    import pandas as pd

    lines = _head(path)
    shown = [i for i, line in enumerate(lines) if line.strip()]
    comments = [i for i in shown if lines[i].lstrip()[0] in "#%"]
    body = [i for i in shown if i not in set(comments)]
    if not body:
        raise ValueError(f"{path}: there is no line of numbers in it")
    comment = lines[comments[0]].lstrip()[0] if comments else "#"
    separator = next((mark for mark in ";\t," if mark in lines[body[0]]), None)
    first = _words(lines[body[0]].partition(comment)[0], separator)
    above = [_words(lines[i].lstrip(" #%"), separator) for i in comments if i < body[0]]
    in_body = not all(map(_is_number, first))
    header = first if in_body else above[-1] if above and len(above[-1]) == len(first) else []
    index = _index(path, header, len(first), given or {})
    places, notes = _groups(index)
    if "time" not in places:
        there = f"its columns are {' '.join(header)[:200]}" if header else "it has no header"
        raise ValueError(f"{path}: no column is named t or time; {there}. Name them: --columns t=0,x=1,y=2,z=3")
    if len(places) == 1:
        why = " ".join(notes)
        raise ValueError(f"{path}: nothing to judge but times: no position, rotation or angular velocity. {why}")
    used = [header[i] for of in places.values() for i in of] if header else []
    units = set(re.findall(r"[\[(](.*?)[\])]", " ".join(used)))
    if strange := sorted(unit for unit in units if unit.strip().lower() not in UNITS and not unit.isdecimal()):
        expected = "s, m, rad and rad/s are expected."
        notes.append(f"Units are not converted, but the header has {', '.join(strange)}: {expected}")
    settings: dict[str, Any] = {"sep": separator or r"\s+", "comment": comment, "skiprows": body[0] + in_body}
    settings |= {"header": None, "dtype": float, "skipinitialspace": True, "compression": None}
    try:
        frame = pd.read_csv(path, **settings)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path}: {error}") from None
    if len(frame.columns) < len(first):
        raise ValueError(f"{path}: {len(frame.columns)} columns of numbers under {len(first)} names")
    numbers = frame.to_numpy()
    return Columns({name: numbers[:, of] for name, of in places.items()}, set(NAMED) <= set(index), notes)


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
    """Name → column; units in brackets and capitals do not matter."""
    plain = [re.sub(r"[\[(].*", "", word).strip().lower() for word in header]
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
