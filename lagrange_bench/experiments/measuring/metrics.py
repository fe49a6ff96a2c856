"""Measures of errors, as pure functions of arrays. Each is tested on synthetic signals.

Drift is judged by the growth of the root-mean-square error over many initial states. Phase is judged by a split of the error
along the two flows of the torus. Order is judged by the points between round-off and saturation.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import scaled_distance
from lagrange_bench.integrators.truth import exact
from lagrange_bench.support.growth import ROUND_OFF as ROUND_OFF
from lagrange_bench.support.growth import Growth as Growth
from lagrange_bench.support.growth import growth_exponent as growth_exponent


def _floats(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


# ---------------------------------------------------------------- size of an error


def relative_drift(invariants: ArrayLike, scales: ArrayLike) -> Array:
    """(I − I[0])/scale, (N, k), of k invariants (N, k). scales : (k,), see `invariant_scales` of the problem."""
    I = _floats(invariants)
    drift: Array = (I - I[0]) / _floats(scales)
    return drift


def scaled_error(problem: Any, y0: ArrayLike, y: ArrayLike, y_exact: ArrayLike) -> Array:
    """The largest |δvector|/scale of states (..., n), with the scales of y0 (n,); shape (...,). A top has the vectors J and x."""
    return scaled_distance(problem, y0, _floats(y), _floats(y_exact))


def pareto_front(cost: ArrayLike, error: ArrayLike) -> NDArray[np.intp]:
    """Indices (M,), by growing cost, of the points (N,) that no other point beats in both. Only finite points count."""
    cost, error = _floats(cost), _floats(error)
    finite = np.flatnonzero(np.isfinite(cost) & np.isfinite(error))
    order = finite[np.lexsort((error[finite], cost[finite]))]
    best = np.minimum.accumulate(np.concatenate(((np.inf,), error[order])))[:-1]
    return order[error[order] < best]


# ---------------------------------------------------------------- growth in time


def verdict(p: float, low: float, high: float, max_error: float, floor: float = 4 * ROUND_OFF) -> str:
    """The meaning of a growth exponent with the interval [low, high], in words.

    "exact": no error at all. "round-off": never above `floor`. "bounded": p < ¼ and high < ½.
    "random walk": ¼ ≤ p < ¾, 0 < low, high < 1 (Brouwer's law). "biased": p ≥ ¾ and low > ½.
    "undecided": the interval does not tell these apart. "failed": the error is not finite. max_error : the largest error.
    """
    if not np.isfinite(max_error):
        return "failed"
    if max_error == 0:
        return "exact"
    if max_error <= floor:
        return "round-off"
    if p < 0.25 and high < 0.5:
        return "bounded"
    if 0.25 <= p < 0.75 and low > 0 and high < 1:
        return "random walk"
    if p >= 0.75 and low > 0.5:
        return "biased"
    return "undecided"


# ---------------------------------------------------------------- phase


def condition(top: LagrangeTop, y0: Array, times: Array) -> Array:
    """The factor (N,) by which a change of y0 has grown at `times` (N,): the largest over the six components, in scaled units.

    It comes from differences of exact solutions, with a component of y0 changed by 1e-11 of its scale, and is good to 1e-3.
    """
    rate, size, _ = top.scales(y0)
    truth, grown = exact.solution(top, y0, times), []
    for change in 1e-11 * np.diag(np.repeat((rate, size), 3)):
        y = y0 + change
        moved = np.max(np.abs(y - y0) / np.repeat((rate, size), 3))  # the change as it was rounded
        grown.append(scaled_error(top, y0, exact.solution(top, y, times), truth) / moved)
    return np.asarray(np.max(grown, axis=0))


def phase_split(top: LagrangeTop, y_exact: ArrayLike, error: ArrayLike) -> dict[str, Array]:
    """Split an error into shifts along the torus and drift off it:

        e = time X_H + angle X_J3 + H ∇H + J3 ∇J3 + C1 ∇C1 + C2 ∇C2

    So y is close to the exact state at t + `time`, rotated about e3 by `angle`, plus four terms that leave the torus. The
    vectors are taken half-way between y_exact and y: then the remainder is of third order in e, and not of second as with those
    at y_exact. Each basis vector has length 1 in scaled units. Singular values below 1e-7 of the largest are dropped, and the
    shortest solution is taken.

    Parameters
    ----------
    y_exact, error : (N, 6). The error must be small against the state, and near a regular precession against the
    amplitude of the nutation.

    Returns
    -------
    "time" (nutation phase, in units of t), "angle" (precession phase, in rad), "H", "J3", "C1", "C2", and "off", the length
    of the last four terms in scaled units, √Σ (c_I |∇I|)²; each (N,).
    Where the flows or gradients are dependent (regular precession, sleeping) "time" and "angle" cannot be separated.
    """
    y = np.atleast_2d(_floats(y_exact))
    e = np.atleast_2d(_floats(error))
    rate, size, _ = top.scales(y[0])
    unit = np.repeat((rate if rate > 0 else 1.0, size), 3)
    middle = y + e / 2
    turning = np.cross((0.0, 0.0, 1.0), middle.reshape(-1, 2, 3)).reshape(-1, 6)  # X_J3: (J, x)' = (e3 × J, e3 × x)
    gradients = np.array([top.gradients(state) for state in middle])
    basis = np.stack((top.rhs(middle), turning, *gradients.transpose(1, 0, 2)), axis=2) / unit[:, None]
    length = np.linalg.norm(basis, axis=-2, keepdims=True)
    basis /= np.where(length > 0, length, 1.0)
    U, s, Vt = np.linalg.svd(basis)
    keep = s > 1e-7 * s[:, :1]
    coordinates = np.einsum("nji,nj->ni", U, e / unit) * keep / np.where(keep, s, 1.0)
    parts = np.einsum("nji,nj->ni", Vt, coordinates)
    c = parts / np.where(length > 0, length, 1.0)[:, 0]
    names = ("time", "angle", "H", "J3", "C1", "C2")
    return {**dict(zip(names, c.T, strict=True)), "off": np.linalg.norm(parts[:, 2:], axis=1)}


# ---------------------------------------------------------------- order


def order(h: ArrayLike, error: ArrayLike, floor: float = 0.0, saturation: float = 0.1) -> float:
    """Order of convergence p of errors ~ h^p, from errors (N,) at several h (N,): the median of the slopes between neighbours.

    Errors are left out if they are at or below 10 `floor`, above `saturation`, zero or not finite. Slopes of at most ½ are left
    out, too: there the error is round-off. NaN for fewer than 2 slopes.
    """
    steps, errors = np.abs(_floats(h)), _floats(error)
    usable = np.flatnonzero(np.isfinite(errors) & (errors > 10 * floor) & (errors <= saturation))
    usable = usable[np.argsort(steps[usable])]
    slopes = np.diff(np.log(errors[usable])) / np.diff(np.log(steps[usable]))
    slopes = slopes[slopes > 0.5]
    return float(np.median(slopes)) if len(slopes) >= 2 else np.nan


# ---------------------------------------------------------------- structure


class PoissonDefect(NamedTuple):
    """By how much a map fails to preserve the Poisson tensor, and the error of this number."""

    defect: float  # max |D P(y) Dᵀ − P(ỹ)| / max |P(ỹ)|, in scaled units
    error: float  # of `defect`, from two differencing steps: a smaller defect says nothing


def poisson_defect(step: Callable[[Array], Array], problem: Any, y: ArrayLike) -> PoissonDefect:
    """‖D P(y) Dᵀ − P(ỹ)‖ for ỹ = step(y), with D its derivative by central differences of order 6.

    `step` must be defined in a neighbourhood of y; a stepper made for one torus is not. Compiled maps take no complex numbers,
    so four real differencing steps are tried, and the two neighbours that agree best are used. For a top this takes 145 calls.
    """
    y = _floats(y)
    sizes = problem.sizes(y)
    unit = np.where(sizes > 0, sizes, 1.0)
    target = problem.poisson(step(y)) / np.outer(unit, unit)
    source = problem.poisson(y) / np.outer(unit, unit)
    pushed = [D @ source @ D.T for D in (_derivative(step, y, unit, delta) for delta in (0.02, 0.01, 0.005, 0.0025))]
    size_of_P = float(np.max(np.abs(target)))
    gaps = [float(np.max(np.abs(a - b))) for a, b in pairwise(pushed)]
    best = int(np.argmin(gaps))
    return PoissonDefect(float(np.max(np.abs(pushed[best + 1] - target))) / size_of_P, gaps[best] / size_of_P)


def _derivative(step: Callable[[Array], Array], y: Array, unit: Array, delta: float) -> Array:
    """Derivative of `step` at y (n,) in scaled units, (n, n), by 7-point central differences."""
    n = len(y)
    D = np.empty((n, n))
    for j in range(n):
        shift = np.zeros(n)
        shift[j] = delta * unit[j]
        difference = [(step(y + k * shift) - step(y - k * shift)) / unit for k in (1, 2, 3)]
        D[:, j] = (45 * difference[0] - 9 * difference[1] + difference[2]) / (60 * delta)
    return D
