"""The numbers of a file whose layout is known, in SI units, block by block: a long file need not fit into memory."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lagrange_bench.judging import rows
from lagrange_bench.judging.columns import Layout, is_chosen, several

Array = np.ndarray


def blocks(layout: Layout) -> Iterator[dict[str, Array]]:
    """The rows in blocks: group → numbers (n, columns) in SI units; what is missing is NaN.

    Rodrigues parameters, axis and angle become rotation vectors. Equal rows count once; the layout gets a note of it.

    Raises
    ------
    ValueError : a line with other than numbers, or with too many; rows of several bodies; no rows.
    """
    how, table, count, same = layout.how, layout.table, 0, 0
    start: Array | None = None
    before: dict[str, Array] = {}
    waiting: list[dict[str, Array]] = []  # where few rows are chosen, those of many blocks are joined
    for columns in table.load(sorted({i for places in layout.groups.values() for i in places}), list(layout.rows)):
        keep = np.full(len(next(iter(columns.values()))), True)
        for i, value in layout.rows.items():
            keep &= np.isin(columns[i], [word for word in set(columns[i]) if is_chosen({i: word}, {i: value})])
        groups = {kind: _in_units(layout, columns, places)[keep] for kind, places in layout.groups.items()}
        if not (n := int(np.count_nonzero(keep))):
            continue
        if how.step is not None:
            groups = {"time": how.step * np.arange(count, count + n, dtype=float)[:, None], **groups}
        start = groups["time"][:1] if start is None else start
        if how.t0 is not None:  # first the difference, for its digits
            groups["time"] = groups["time"] - start
        groups["time"] = groups["time"].sum(axis=1, keepdims=True) + (how.t0 or 0.0)
        last = {kind: values[-1:] for kind, values in groups.items()}
        new = ~_again(layout, _joined([before, groups]) if before else groups)[-n:]
        _turned(layout, groups)
        count, same, before = count + n, same + n - int(np.count_nonzero(new)), last
        if new.any():
            waiting.append({kind: values[new] for kind, values in groups.items()})
        if sum(len(part["time"]) for part in waiting) >= rows.CHUNK:
            yield _joined(waiting)
            waiting = []
    if waiting:
        yield _joined(waiting)
    if not count:
        raise ValueError("there are no rows to judge")
    note = f"{same} row{'s are' if same > 1 else ' is'} equal to the one before, and left out."
    if same and note not in layout.notes:
        layout.notes.append(note)


def _joined(parts: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    return {kind: np.concatenate([part[kind] for part in parts]) for kind in parts[0]}


def _in_units(layout: Layout, columns: Mapping[int, Array], places: Sequence[int]) -> Array:
    """Some columns (n, columns) in SI units."""
    values = np.column_stack([columns[i] for i in places])
    for k, i in enumerate(places):
        if (factor := layout.factors[i]) != 1:
            whole = round(1 / factor) if factor < 1 else 0
            exact = whole and 1 / whole == factor  # 1/1000 is no double, 1000 is one
            values[:, k] = values[:, k] / whole if exact else values[:, k] * factor
    return values


def _again(layout: Layout, groups: Mapping[str, Array]) -> Array:
    """Which rows are equal to those before; ValueError where rows are of several bodies."""
    late = np.diff(groups["time"][:, 0], prepend=-math.inf)
    same = late == 0
    for i in np.flatnonzero(same):
        same[i] = all(np.array_equal(part[i], part[i - 1], equal_nan=True) for part in groups.values())
    if layout.labels and np.any(~(late > 0) & ~same):
        header = layout.table.names or [""] * layout.table.width
        raise ValueError(several(header, layout.table, layout.labels[0]))
    return same


def _turned(layout: Layout, groups: dict[str, Array]) -> None:
    """Write Rodrigues parameters, axis and angle as rotation vectors."""
    from scipy.spatial.transform import Rotation

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
        groups["rotation vector"], layout.floor["rotation vector"] = vectors, layout.floor.get(kind, 0.0)
