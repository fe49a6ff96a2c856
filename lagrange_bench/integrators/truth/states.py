"""States as users ask for them: proven doubles at a few times, doubles of a table at many, and any number of digits."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from flint import arb, fmpq
from mpmath import mp, mpf
from mpmath.libmp import from_man_exp
from numpy.typing import NDArray

from lagrange_bench.integrators.checks import Array, check_count
from lagrange_bench.integrators.truth.curve import FIRST_BITS, LOST, certified, rational
from lagrange_bench.integrators.truth.table import TOO_LATE, Table, has_table
from lagrange_bench.integrators.truth.top import Top
from lagrange_bench.support.precision import workdps

FEW = 30  # times that are computed one by one; a table takes as long as these
PROVEN = fmpq(1, 10**17)  # radii of states that are rounded to doubles, relative to the scales
LATEST = 2**48  # times 1/rate; later, doubles differ by 1/32 of it and more
MOST_DIGITS = 1000  # they take a tenth of a second for each time


class Enclosure(NamedTuple):
    """Midpoints and radii, object arrays of mpf: each component of the true state is within its radius of its midpoint."""

    midpoints: NDArray[Any]
    radii: NDArray[Any]


def solution(motion: Top, t: Any, digits: int | None = None, more: Array | float = 0.0) -> NDArray[Any]:
    """States (N, n) at N times, (n,) at one. more : (N,), added to t, below an ulp of it; ignored with `digits`."""
    if digits is None:
        times = check_times(t)
        rows = np.atleast_1d(times)
        states = in_doubles(motion, rows, np.broadcast_to(more, rows.shape))
    else:
        times, digits = check_times(t, exact=True), check_digits(digits)
        mids = enclosure(motion, times, digits + 1).midpoints
        with workdps(digits + 3):
            states = +np.atleast_2d(mids)
    return states.reshape(*times.shape, states.shape[-1])


def enclosure(motion: Top, times: NDArray[Any], digits: int) -> Enclosure:
    """Balls (…, n) at `times`, with radii below 10^-digits of the scales."""
    balls = [proven(motion, rational(t), fmpq(1, 10**digits)) for t in times.ravel()]
    shape = *times.shape, len(motion.radii(PROVEN))
    mids, radii = ([[as_mpf(part(v)) for v in row] for row in balls] for part in (arb.mid, arb.rad))
    return Enclosure(*(np.array(rows, dtype=object).reshape(shape) for rows in (mids, radii)))


def in_doubles(motion: Top, times: Array, more: Array) -> Array:
    """States (N, n) at `times` + `more`."""
    if (
        len(times)
        and not motion.steady
        and motion.node is None
        and any(abs(rational(t)) * motion.rate > LATEST for t in (times.min(), times.max()))
    ):
        raise ValueError(TOO_LATE)
    if len(times) > FEW and has_table(motion):
        states = table(motion)(times, more)
    else:
        whens = [rational(t) + rational(rest) for t, rest in zip(times.tolist(), more.tolist(), strict=True)]
        rows = [[float(v) for v in proven(motion, t, PROVEN)] for t in whens]
        states = np.array(rows).reshape(len(times), len(motion.radii(PROVEN)))
    if not np.all(np.isfinite(states)):
        raise ValueError("the solution overflows: choose less extreme units of time and length")
    return states


@lru_cache(maxsize=64)
def table(motion: Top) -> Table:
    return Table(motion)


def proven(motion: Top, t: fmpq, tolerance: fmpq) -> list[arb]:
    """The state at a time, with radii below `tolerance` of the scales."""
    doublings = max(0, int(abs(t) * motion.rate).bit_length())
    bits = FIRST_BITS + int(tolerance.q).bit_length() + LOST * doublings
    return certified(lambda: motion.at(t), motion.radii(tolerance), bits)


def as_mpf(v: arb) -> mpf:
    """An exact number."""
    return mp.make_mpf(from_man_exp(*map(int, v.man_exp())))


# ---------------------------------------------------------------- checks of arguments


def check_digits(digits: int) -> int:
    digits = check_count(digits, "digits", least=1)
    if digits > MOST_DIGITS:
        raise ValueError(f"digits must be at most {MOST_DIGITS}; got {digits}")
    return digits


def check_times(t: Any, exact: bool = False) -> NDArray[Any]:
    """`t` as an array with 0 or 1 axes, of doubles or, if `exact`, of mpf; else ValueError."""
    try:
        times = np.asarray(t)
        if times.ndim > 1 or (times.size and times.dtype.kind not in ("iufO" if exact else "iuf")):
            raise ValueError(f"got shape {times.shape}, dtype {times.dtype}")
        if not exact:
            times = times.astype(np.float64)
        else:
            exact_times = [v if isinstance(v, mpf) else mpf(v) for v in times.ravel().tolist()]  # mpf(v) would round v
            times = np.array(exact_times, dtype=object).reshape(times.shape)
    except (TypeError, ValueError) as error:
        raise ValueError(f"t must be a time or a sequence of times, real numbers: {error}") from None
    if not (all(map(mp.isfinite, times.flat)) if exact else np.all(np.isfinite(times))):
        raise ValueError(f"t must be finite; got {t!r}")
    return times
