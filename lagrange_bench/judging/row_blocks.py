"""The two passes of `judge` over all rows of a trajectory, block by block: a long one need not fit into memory.

The first looks at all times, and takes the first rows, some of all others, and the last one. The second measures every row.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from lagrange_bench.judging.frames import UNITS, Frames
from lagrange_bench.judging.hints import HEAD
from lagrange_bench.judging.judgement import Error

Array = np.ndarray
# the rows of a trajectory from the first on, as often as it is called
Blocks = Callable[[], Iterator[Mapping[str, Array]]]
# Times that are sums of steps are rounded. If all are as near as NEAR, relative to the last time, to its decimals of the eighth
# place, they are taken as these; with fewer rows than FEW, as near as SOME. Half a unit of that place is more than NEAR, so that
# not all numbers are near.
DECIMALS, NEAR, SOME, FEW = 8, 1e-10, 5e-13, 100
POINTS = 2000  # of a curve
MOST = 3 * HEAD  # the most rows that a first look takes: HEAD first ones, and some of all others
BLOCK = 1 << 14  # rows of arrays that are compared at once


def of_arrays(trajectory: Mapping[str, Array]) -> Iterator[Mapping[str, Array]]:
    """Arrays (N, columns) in blocks."""
    for k in range(0, len(trajectory["time"]), BLOCK):
        yield {name: rows[k : k + BLOCK] for name, rows in trajectory.items()}


class Run(NamedTuple):
    """The result of a first look: how many rows; the first and the last time; whether times are `decimals`; some rows."""

    rows: int
    span: tuple[float, float]
    decimals: bool
    seen: dict[str, Array]


def look(blocks: Blocks) -> Run:
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
            time = f"the time is {t[i, 0]:.12g}{before}"
            raise ValueError(f"row {n + i + 1}: {time}; times must be numbers that increase")
        rows = {**block, "decimals": decimals(t)}
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
    return Run(n, (float(seen["time"][0, 0]), float(seen["time"][-1, 0])), decimal, seen)


class Measured(NamedTuple):
    """The errors of all rows and of the first one, their curves; how many rows hold a NaN, and the time of the first of these.

    mirrored : rows with a matrix of negative determinant.
    """

    errors: dict[str, Error]
    first: dict[str, float]
    curves: dict[str, Array]
    bad: int
    bad_from: float
    mirrored: int


def measure(frames: Frames, blocks: Iterator[Mapping[str, Array]], n: int) -> Measured:
    """The largest errors of n rows in blocks."""
    marks, at = np.linspace(0, n, min(n, POINTS) + 1).astype(int), 0
    t_marks, curves = np.full(len(marks) - 1, math.inf), dict[str, Array]()
    first: dict[str, float] = {}
    last: dict[str, float] = {}
    judged: dict[str, int] = {}  # the number of rows that have this quantity
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
            last[name], judged[name] = float(error[-1]), judged.get(name, 0) + len(t)
            here |= ~np.isfinite(error)
        here &= np.abs(t) <= frames.known_until
        bad_from = float(t[here][0]) if here.any() and not bad else bad_from
        bad, at = bad + int(np.count_nonzero(here)), at + len(t)
        if "matrix" in rows:
            mirrored += int(np.count_nonzero(np.linalg.det(rows["matrix"][new].reshape(-1, 3, 3)) < 0))
    if not curves:
        raise ValueError("a body without a start is judged by rotations with ω, by ω in the body, or by positions")
    ends = {name: (float(curves[name].max()), last[name]) for name in UNITS if name in curves}
    errors = {name: Error(*pair) if judged[name] == n else Error(math.nan, math.nan) for name, pair in ends.items()}
    drawn = {name: np.stack([t_marks, curve]) for name, curve in curves.items()}
    return Measured(errors, first, drawn, bad, bad_from, mirrored)


def _overlapping(blocks: Iterator[Mapping[str, Array]], n: int) -> Iterator[tuple[dict[str, Array], slice]]:
    """Blocks of the first n rows, with two rows before and one after, which slopes need; and the slice of a block's own rows."""
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


def decimals(t: Array) -> Array:
    """Times rounded to the eighth decimal place of the last of them; a sum of steps is not far from such decimals."""
    last = float(np.max(np.abs(t)))
    # per second; a power of ten, so that decimals are its multiples
    unit = 10 ** (DECIMALS - math.floor(math.log10(last))) if last else 1.0
    return np.asarray(np.round(t * unit) / unit)
