"""Rows against the exact motion: which axes, which origin, which unit and which time make them right?

    R_exact = W R B        W takes the world of the rows to that of the case, B the body of the case to that of the rows
    x_exact = M W x + m    M a unit, or a mirror: rotations are the same with all axes reversed, so the hand shows here only

W and B together maximize Σ tr(R_exactᵀ W R B); each alone is a problem of Kabsch, and both in turn find them. A run is right at
its start and lost at its end, so the first 3, 5, 9, … rows and all of them are tried.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from scipy.integrate import cumulative_trapezoid

from lagrange_bench.integrators import RigidBody
from lagrange_bench.judging.findings import Finding, numbers, of_axes, of_unit, say, triple
from lagrange_bench.judging.fits import EACH, GOOD, Model, ModelChoice, choose, factor_of, maps
from lagrange_bench.judging.fits_kinematics import readings
from lagrange_bench.judging.fits_law import of_gravity
from lagrange_bench.judging.vectors import (
    NEAR,
    ONE,
    PROPER,
    Array,
    is_axes,
    nearest_rotation,
    rotvec,
    size,
    to_body,
    to_world,
)

# times t → positions (n, 3), matrices (n, 3, 3), angular velocities in the body (n, 3) of the exact motion
Exact = Callable[[Array], tuple[Array, Array, Array]]
# R, x, and ω in the body, or None
Parts = Sequence[Array | None]
LENGTHS = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254, "feet": 0.3048}
PREFIXES = (3, 5, 9, 17, 33, 65)
# rows of a prefix that are looked at
LOOKED_AT = 60
# a turn of the axes that are no signed axes must hold for so many rows, and while the body turns by so much, rad
ROWS, TURNED = 9, 0.5
# of W and of B in turn
TURNS = 8
# rows that all others may be late by
LATEST = 5
# a matrix of axes is off by less from a signed permutation
LIKE_AXES = 0.2


class FrameReading(NamedTuple):
    """How rotations are read: a reading, W, B."""

    reading: str
    W: Array
    B: Array


def frames(R: Array, exact_R: Array, other_readings: Mapping[str, Array], floor: float) -> ModelChoice | None:
    """The clearest choice of a `FrameReading` over prefixes of the rows."""
    best: ModelChoice | None = None
    for n in [*(n for n in PREFIXES if n < len(R)), len(R)]:
        places = np.unique(np.linspace(0, n - 1, min(n, LOOKED_AT)).astype(int))
        E = exact_R[places]
        if not np.isfinite(E).all():
            break
        turn = float(np.linalg.norm(rotvec(E @ E[:1].transpose(0, 2, 1)), axis=1).max())
        is_long = n >= ROWS and turn > TURNED
        scale = min(1.0, turn) or 1.0  # what explains the rows is right to a share of their turn
        models = [
            Model(price + model.cost, model.misfit / scale, FrameReading(reading, *model.value))
            for reading, price, A in readings(R, other_readings)
            for model in turns(A[places], E, is_long)
        ]
        choice = choose(models, floor / scale)
        # another convention is wrong from the first turn on
        if choice.winner is not None and choice.now.misfit > GOOD and (best is None or choice.gain > best.gain):
            best = choice
    return best


def turns(A: Array, E: Array, is_long: bool) -> Iterator[Model]:
    """Models of E = W A B for matrices (n, 3, 3); the value is W, B. is_long : long enough to tell any turn."""
    T = np.einsum("kab,kcd->abcd", E, A)  # the sum over rows of E_ab A_cd

    def model(cost: float, W: Array, B: Array) -> Model:
        return Model(cost, float(np.sqrt(np.mean((E - W @ A @ B) ** 2) * 1.5)), (W, B))

    def best_W(B: Array) -> Array:
        return nearest_rotation(np.einsum("abcd,db->ac", T, B))[0]

    def best_B(W: Array) -> Array:
        return nearest_rotation(np.einsum("abcd,ac->db", T, W))[0]

    yield model(0.0, ONE, ONE)
    if is_long:
        yield model(2.5, best_W(ONE), ONE)
        yield model(2.5, ONE, best_B(ONE))
    pairs = []
    for B in PROPER:
        W = best_W(B)
        if not is_axes(W, LIKE_AXES):
            continue
        W = W.round()
        if np.allclose(W, ONE) or np.allclose(B, ONE):
            if not np.allclose(W, B):
                yield model(1.5, W, B)
        else:  # a world and a body of the other hand are one claim
            pairs.append(model(1.5 if np.allclose(W @ B, ONE) else 2.5, W, B))
    pairs.sort(key=lambda pair: pair.misfit)
    if len(pairs) == 1 or (pairs and pairs[0].misfit * EACH < pairs[1].misfit):  # a motion in a plane does not tell
        yield pairs[0]
    if is_long:
        W, B = ONE, best_B(ONE)
        for _ in range(TURNS):
            W = best_W(B)
            B = best_B(W)
        yield model(3.5, W, B)


def distance(parts: Parts, exact: tuple[Array, Array, Array]) -> float:
    """How far rows are from the exact motion: by rotations, else by positions, else by ω in the body, relative."""
    R, x, omega = parts
    if R is not None:
        return size(rotvec(R @ exact[1].transpose(0, 2, 1)))
    if x is not None:
        return size(x - exact[0]) / (size(exact[0]) or 1.0)
    return math.nan if omega is None else size(omega - exact[2]) / (size(exact[2]) or 1.0)


def clocks(t: Array, parts: Parts, exact: Exact) -> Iterator[Model]:
    """Models of a constant that is added to the times, s. The error of rotation is τ Ω in the world if rows are late by τ."""
    yield Model(0.0, distance(parts, exact(t)), 0.0)
    if t[0]:
        yield Model(1.0, distance(parts, exact(t - t[0])), -float(t[0]))
    R, h, late = parts[0], float(np.median(np.diff(t))), 0.0
    if R is None:
        return
    for _ in range(TURNS):
        _, E, Omega = exact(t + late)
        error, w = rotvec(R @ E.transpose(0, 2, 1)), to_world(E, Omega)
        if not np.isfinite(error).all() or not np.isfinite(w).all() or not w.any():
            return
        late += float(np.clip(np.sum(error * w) / np.sum(w * w), -3 * h, 3 * h))
    rows = round(late / h)
    if 0 < abs(rows) <= LATEST and abs(late / h - rows) < 0.1:
        yield Model(1.0, distance(parts, exact(t + rows * h)), rows * h)


def places(
    t: Array, x: Array, R: Array | None, right: Array, start: Array, body: RigidBody, is_other: bool
) -> Iterator[Model]:
    """Models of the positions x, in axes of the case. The value is what is wrong, in findings.

    right : the exact positions, or those that the rotations give; start : the one at t = 0. is_other : another body or another
    gravity is found, so neither a point of the body nor the fall says more.
    """
    length = size(right) or 1.0

    def model(cost: float, off: Array, *wrong: Finding) -> Model:
        return Model(cost, size(off) / length, wrong)

    for each in maps(x, right, LENGTHS.values()):
        yield each._replace(value=of_places(each.value, body))
    shift = (right - x).mean(0)
    yield model(0.0, right - x)
    if start.any():
        yield model(1.0, right - x - start, say("displacement"))
    yield model(1.5, right - x - shift, say("origin", shift=f"({numbers(-shift)}) m"))
    if R is not None and not is_other:
        off = x if body.fixed else x - right
        point = to_body(R, off).mean(0)
        is_fixed = np.abs(point).max() <= 1e-9
        named = "the fixed point" if is_fixed else f"the point ({numbers(point)}) m of the body"
        yield model(1.5, off - R @ point, say("origin point", point=named))
    if not body.fixed:
        T = (t - t[0])[:, None] ** 2 / 2
        fall = ((x - right) * T).sum(0) / (T**2).sum()
        if not is_other:
            yield model(1.0, x - right - T * fall, of_gravity(body.gravity + fall, body))
        slowed = drag((x - right) / length, travelled(t, x - start) / length)
        yield slowed._replace(value=say("linear-damping", rate=slowed.value))


def travelled(t: Array, x: Array) -> Array:
    """∫ x dt from the first row on."""
    return cumulative_trapezoid(x, t, axis=0, initial=0)


def without_line(t: Array, x: Array) -> Array:
    """What the straight motion that fits positions best leaves of them."""
    return x - polyval(t, polyfit(t, x, 1)).T


def drag(off: Array, path: Array) -> Model:
    """The model v' = g − c v of a flight: off = x − x₀ − v₀ t − g t²/2 = −c path, path = ∫ (x − x₀) dt; the value is c, 1/s."""
    c = -float((off * path).sum() / (path**2).sum())
    return Model(1.0 if c > 0 else 2.0, size(off + c * path), c)


def parabola(t: Array, x: Array, floor: float) -> tuple[Array, float, float]:
    """The acceleration g of the parabola that fits positions best, m/s²; its misfit, relative; and the error of g, m/s².

    σ of the coefficient of s² is √180 σ(x)/√N, s from 0 to 1; g is known to six of it. floor : the least error of positions, m.
    """
    s = t - t[0]
    c = polyfit(s, x, 2)
    rest = size(x - polyval(s, c).T)
    error = 6 * 2 * math.sqrt(180 / len(t)) * max(rest, floor) / float(s[-1]) ** 2
    return 2 * c[2], rest / (size(x - x.mean(0)) or 1.0), error


def of_shift(shift: float, first: float, step: float) -> Finding:
    """A constant that is added to the times, s; first and step : of the times as they are."""
    rows = shift / step
    k = round(rows)
    if abs(rows) > LATEST + 0.5 or abs(rows - k) > NEAR:
        return say("time-shift", first=first)
    count, side = "row" if abs(k) == 1 else "rows", "later" if k > 0 else "earlier"
    return say("rows-late", rows=f"{abs(k)} {count} {side}")


def of_places(A: Array, body: RigidBody) -> Iterator[Finding]:
    """What is wrong with positions that a map makes right."""
    factor = factor_of(A)
    M = A / factor
    if abs(abs(factor) - 1) > NEAR / 4:
        yield of_unit("length-unit", abs(factor), LENGTHS)
    if np.linalg.det(A) < 0:
        yield say("left-handed", axes=triple(np.sign(factor) * M))
    elif not np.allclose(M, ONE, atol=NEAR):
        yield of_axes("world", M, body.up)
