"""The errors of all rows of a trajectory."""

import math
from collections.abc import Mapping

import numpy as np

from lagrange_bench.judging.fits import steps
from lagrange_bench.judging.frames import Exact, Frames

Array = np.ndarray
# points of a curve
POINTS = 2000
# Sums of steps are rounded: times that are as near to decimals of DECIMALS places, relative to the last time, may be these.
DECIMALS, NEAR = 8, 1e-10


def by_the_better_clock(frames: Frames, rows: Mapping[str, Array]) -> tuple[dict[str, Array], Array, list[str]]:
    """The errors of all rows, (n,) each, the times (n, 1) of them, and what to say of these.

    A sum of steps is rounded, so the decimals near to the times may be the right ones: those with the smaller errors are taken.
    """

    def errors_at(t: Array) -> dict[str, Array]:
        exact = None if frames.case is None else frames.exact(t[:, 0])
        return frames.errors({**rows, "time": t}, exact)

    t, rounded = rows["time"], _decimals(rows["time"])
    errors, off = errors_at(t), float(np.max(np.abs(rounded - t)))
    if off == 0 or off > NEAR * float(np.max(np.abs(t))):
        return errors, t, []
    others = errors_at(rounded)
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


def curve(t: Array, error: Array) -> Array:
    """Times and the largest errors of some rows each, (2, M), to draw."""
    starts = np.unique(np.linspace(0, len(t), min(len(t), POINTS) + 1).astype(int))[:-1]
    return np.stack([t[starts], np.maximum.reduceat(error, starts)])


def count_turns(frames: Frames, rows: Mapping[str, Array], exact: Exact | None) -> float:
    """How often the body turns, ∫|ω| dt/2π; without ω by all attitudes, NaN without either."""
    t, omega = rows["time"], rows.get("omega") if exact is None else exact[2]
    if omega is not None:
        return float(np.trapezoid(np.linalg.norm(omega, axis=1), t[:, 0])) / math.tau
    R = frames.matrices(rows)
    return math.nan if R is None else float(np.nansum(np.linalg.norm(steps(R), axis=1))) / math.tau


def blurred(frames: Frames, t: Array, exact: Exact, blur: float) -> dict[str, float]:
    """The largest changes of the motion while the times change by `blur`."""
    x, _, omega = frames.exact(t + blur)
    moved = {"position": x - exact[0], "rotation": omega * blur, "omega": omega - exact[2]}
    return {name: float(np.linalg.norm(change, axis=1).max()) for name, change in moved.items()}
