"""Growth of an error in time, from many initial states or from one."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
ROUND_OFF = 2.0**-53  # half an ulp of 1: a relative error below this carries no information


class Growth(NamedTuple):
    """Exponent p of error ~ t^p with its 95 % interval; NaN where it cannot be measured."""

    p: float
    low: float
    high: float


def growth_exponent(
    t: ArrayLike,
    E: ArrayLike,
    *,
    floor: float = ROUND_OFF,
    decades: float = 2.0,
    blocks: int = 12,
    resamples: int = 2000,
) -> Growth:
    """Exponent of the growth of an error, from many initial states.

    p is the slope of a straight line through log RMS against log t. The last `decades` of the run are cut into log-spaced
    blocks, and the RMS is taken over the states and over the samples in a block. Block maxima would not do: the maximum of noise
    grows with the number of samples in a block, the RMS does not. The whole run would not do either: early on, oscillation and
    the rounding of the first steps hide a drift, and would pull p down.

    The interval is a bootstrap over states (expanded percentiles; seeded), and NaN for fewer than 4 states. At least 16 states
    are needed to make the interval shorter than the gap between ½ and 1. All is NaN if an error is not finite, or if fewer than
    3 blocks are above the floor.

    Parameters
    ----------
    t : (N,), growing. E : (n_states, N), relative errors, signed or not.
    floor : blocks with an RMS up to this are left out. blocks : their number. resamples : of the bootstrap.
    """
    t, E = np.asarray(t, dtype=float), np.atleast_2d(np.asarray(E, dtype=float))
    nothing = Growth(np.nan, np.nan, np.nan)
    if not np.all(np.isfinite(E)) or t[-1] <= 0:
        return nothing
    starts, ends = log_blocks(t, t[-1] * 10.0**-decades, blocks)
    x = np.array([np.mean(np.log(t[a:b])) for a, b in zip(starts, ends, strict=True)])
    V = np.stack([np.mean(E[:, a:b] ** 2, axis=1) for a, b in zip(starts, ends, strict=True)], axis=1)
    known = np.sqrt(np.mean(V, axis=0)) > floor
    if np.count_nonzero(known) < 3:
        return nothing
    x, V = x[known], V[:, known]
    p = float(slope(x, np.log(np.mean(V, axis=0)) / 2))
    n = len(V)
    if n < 4:
        return Growth(p, np.nan, np.nan)
    weights = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), size=resamples) / n
    # a resample of states without any error has no logarithm: take the floor instead
    slopes = slope(x, np.log(np.maximum(weights @ V, floor**2 + np.finfo(float).tiny)) / 2)
    # expanded percentiles: Student's t with n − 1 degrees of freedom reaches further out than a normal distribution
    tail = scipy.stats.norm.cdf(np.sqrt(n / (n - 1)) * scipy.stats.t.ppf(0.025, n - 1))
    low, high = np.quantile(slopes, (tail, 1 - tail))
    return Growth(p, min(p, float(low)), max(p, float(high)))


def log_blocks(t: Array, start: float, blocks: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and one-past-last index of the samples in each block between `start` and t[-1], without empty blocks."""
    if t.ndim != 1 or np.any(np.diff(t) <= 0):
        raise ValueError("t must be one-dimensional and growing")
    if not 0 < start <= t[-1]:
        raise ValueError("t needs a sample after t = 0")
    edges = np.searchsorted(t, np.geomspace(start, t[-1], blocks + 1) * (1 - 1e-12))
    edges[-1] = len(t)
    filled = np.diff(edges) > 0
    return edges[:-1][filled], edges[1:][filled]


def slope(x: Array, y: Array) -> Array:
    """Slope of the least-squares line through (x, y); y may be (..., n)."""
    x = x - np.mean(x)
    return y @ x / (x @ x)
