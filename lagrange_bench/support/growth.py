"""Growth of an error in time, from many initial states or from one."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

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
    if t.ndim != 1 or np.any(np.diff(t) <= 0):
        raise ValueError("t must be one-dimensional and growing")
    if not np.all(np.isfinite(E)) or t[-1] <= 0:
        return nothing
    edges = np.searchsorted(t, np.geomspace(t[-1] * 10.0**-decades, t[-1], blocks + 1) * (1 - 1e-12))
    edges[-1] = len(t)
    filled = [slice(first, end) for first, end in pairwise(edges) if first < end]
    x = np.array([np.mean(np.log(t[block])) for block in filled])
    V = np.stack([np.mean(E[:, block] ** 2, axis=1) for block in filled], axis=1)
    known = np.sqrt(np.mean(V, axis=0)) > floor
    if np.count_nonzero(known) < 3:
        return nothing
    x, V = x[known], V[:, known]
    p = float(np.polyfit(x, np.log(np.mean(V, axis=0)) / 2, 1)[0])
    n = len(V)
    if n < 4:
        return Growth(p, np.nan, np.nan)
    weights = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), size=resamples) / n
    # a resample of states without any error has no logarithm: take the floor instead
    logarithms = np.log(np.maximum(weights @ V, floor**2 + np.finfo(float).tiny)) / 2
    slopes = np.polyfit(x, logarithms.T, 1)[0]
    # expanded percentiles: Student's t with n − 1 degrees of freedom reaches further out than a normal distribution
    tail = scipy.stats.norm.cdf(np.sqrt(n / (n - 1)) * scipy.stats.t.ppf(0.025, n - 1))
    low, high = np.quantile(slopes, (tail, 1 - tail))
    return Growth(p, min(p, float(low)), max(p, float(high)))
