"""Does ω turn the body? Fits of the angular velocities to the rates of the rotations, and to those of the angles.

    M ω = Θ'        Θ' the rate of R from five rows, in the body, in the world, or in the body of the row before

M is 1, a unit, signed axes, or a turn, as of a gyroscope that is mounted askew. ω may be half a step or a row late or early.
Rotations may be transposed, or read in the other ways that the reader offers.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.judging.findings import Finding, numbers, of_unit, say, triple
from lagrange_bench.judging.fits import CLEARLY, Model, factor_of, maps
from lagrange_bench.judging.vectors import NEAR, ONE, Array, common, is_axes, rotvec, size, steps, to_body, to_world

# ω has other units: what --units calls them, and the factor that leads to rad/s
SPEEDS = {"deg/s": math.tau / 360, "rpm": math.tau / 60, "rev/s": math.tau}
SPEED_NAMES = {"deg/s": "degrees per second", "rpm": "revolutions per minute", "rev/s": "revolutions per second"}
# unit of time → s: a rate that is off by it is of other times
CLOCKS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
# a larger turn, rad, may be the other way round
ANOTHER_TURN = 2.8
# fewer rows show no cap
FEWEST = 8
# relative: |ω| falls to a cap by more in its first step
FALLS = 0.05
BODY, WORLD, BEFORE = "body", "world", "body of the row before"
ON_TIME = "on time"
# ω of the middle of a step, and what it turns
HALVES = {
    "half a step late": "the row before into its own, as in leapfrog and semi-implicit Euler",
    "half a step early": "its row into the next, as in leapfrog",
}
# when ω is of another time: its cost
TIMES = {ON_TIME: 0.0, **dict.fromkeys(HALVES, 1.0), "one row late": 1.5, "one row early": 1.5}
TRANSPOSED = "transposed"
# the cost of the other frame of ω beside another reading, which costs 1: both must cost less than signed axes of ω, 1.5
READ_ANEW = 0.4


class Spin(NamedTuple):
    """How ω is read: by rotations that are read in this way, in this frame, at this time, as M ω."""

    reading: str
    frame: str
    time: str
    M: Array


def rates(t: Array, R: Array) -> tuple[Array, float]:
    """The rates of R in the body at the rows 2 … N − 3, from five rows, and how far they may be off, relative.

    Rotation vectors Θ(s) from the row k to its neighbours are a polynomial of degree four with Θ(0) = 0, and Θ'(0) is the rate:
    Σ Θⱼ/sⱼ Π sₘ/(sₘ − sⱼ), m ≠ j, by Lagrange. Rates from three rows are off by h² ω''/6; the square of the difference is the
    size of what five rows leave.
    """
    k = np.arange(2, len(t) - 2)
    neighbours = (-2, -1, 1, 2)
    s = np.stack([t[k + j] - t[k] for j in neighbours], 1)
    turns = np.stack([rotvec(R[k].transpose(0, 2, 1) @ R[k + j]) for j in neighbours], 1)
    others = [[m for m in range(4) if m != j] for j in range(4)]
    weights = (s[:, others] / (s[:, others] - s[:, :, None])).prod(2) / s
    five = np.einsum("kj,kji->ki", weights, turns)
    three = (turns[:, 2] - turns[:, 1]) / (s[:, 2] - s[:, 1])[:, None]
    folded = np.linalg.norm(turns[:, [0, 3]], axis=2).max(1) > ANOTHER_TURN
    five[folded] = three[folded]
    length = size(five) if len(five) else 0.0
    return five, (size(five - three) / length) ** 2 if length else 0.0


def readings(R: Array, other_readings: Mapping[str, Array]) -> Iterator[tuple[str, float, Array]]:
    """The rotations as read and as others would read them: a name, its cost, matrices."""
    for name, matrices in {"": R, **other_readings}.items():
        cost = 1.0 if name else 0.0
        yield name, cost, matrices
        yield f"{name} {TRANSPOSED}".strip(), cost + 1.0, matrices.transpose(0, 2, 1)


def spins(t: Array, R: Array, omega: Array, frame: str, other_readings: Mapping[str, Array]) -> Iterator[Model]:
    """Models of M ω = Θ' over readings of the rotations, frames and times of ω; the value is a `Spin`."""
    k, inner = np.arange(3, len(t) - 3), slice(1, -1)
    for reading, price, A in readings(R, other_readings):
        five, blur = rates(t, A)
        step = steps(A) / np.diff(t)[:, None]
        series = {  # rates in the body, and the attitudes that take them to the world
            ON_TIME: (five[inner], A[k]),
            "half a step late": (step[k - 1], A[k]),
            "half a step early": (step[k], A[k]),
            "one row late": (five[:-2], A[k - 1]),
            "one row early": (five[2:], A[k + 1]),
        }
        for time, (in_body, at) in series.items():
            in_world = to_world(at, in_body)
            targets = [(BODY, in_body, 0.0), (WORLD, in_world, 0.0)]
            if time == ON_TIME:
                targets.append((BEFORE, to_body(A[k - 1], in_world), 0.5))
            for other, target, extra in targets:
                frame_cost = 0.0 if other == frame else READ_ANEW if price else 1.0
                cost = price + TIMES[time] + extra + frame_cost
                for model in maps(omega[k], target, [*SPEEDS.values(), *CLOCKS.values()]):
                    misfit = max(model.misfit, CLEARLY * blur)
                    yield Model(cost + model.cost, misfit, Spin(reading, other, time, model.value))


def lateness(t: Array, omega: Array, rate: Array) -> Model:
    """The model that ω in the body is late by τ, s, less than a step: ω = Θ' − τ Θ''; the value is τ."""
    slope, off = np.gradient(rate, t, axis=0), rate - omega
    near = common(off)
    late = float(np.sum(off[near] * slope[near]) / np.sum(slope[near] ** 2))
    is_part = abs(late) < float(np.median(np.diff(t)))
    return Model(1.0, size(off - late * slope) / size(rate) if is_part else math.nan, late)


def of_spin(spin: Spin, frame: str) -> Iterator[Finding]:
    """What is wrong with ω, which was read in this frame."""
    if spin.frame == BEFORE:
        yield say("omega-lag")
    elif spin.frame != frame:
        yield say("omega-frame", frame=spin.frame)
    if spin.time in HALVES:
        yield say("omega-half-step", time=spin.time, step=HALVES[spin.time])
    elif spin.time != ON_TIME:
        yield say("omega-row", time=spin.time)
    factor = factor_of(spin.M)
    M = spin.M / factor
    if abs(abs(factor) - 1) > NEAR / 4:
        yield of_unit("omega-unit", abs(factor), SPEEDS, SPEED_NAMES)
    if factor < 0:
        yield say("omega-sign")
    elif not is_axes(M):
        yield say("omega-turned", turn=numbers(rotvec(M[None])[0]))
    elif not np.allclose(M, ONE, atol=NEAR):
        yield say("omega-axes", axes=triple(M))


def of_reading(reading: str) -> Iterator[Finding]:
    """Rotations that are read otherwise: by an option, or "transposed", or both."""
    if option := reading.removesuffix(TRANSPOSED).strip():
        is_order = "quat" in option or "qw" in option
        yield say("quaternion-order" if is_order else "rotation-angles", option=option)
    if reading.endswith(TRANSPOSED):
        yield say("rotation-transposed")


def angle_rates(t: Array, angles: Array, omega: Array) -> Iterator[Model]:
    """Models of M ω = rates of the columns of angles; ω of the middle of two rows, or of one of them, as a program adds it."""
    turns = np.unwrap(angles, axis=0)
    slope = np.diff(turns, axis=0) / np.diff(t)[:, None]
    of_steps = [(each, slope) for each in ((omega[1:] + omega[:-1]) / 2, omega[1:], omega[:-1])]
    for of_rows, target in [*of_steps, (omega[1:-1], (slope[1:] + slope[:-1]) / 2)]:
        for model in maps(of_rows, target, [*SPEEDS.values(), *(1 / unit for unit in SPEEDS.values())]):
            yield model._replace(cost=model.cost + 1.0)


def kinematics(t: Array, R: Array, omega: Array, frame: str) -> Array | None:
    """|Θ/dt − ω| from the row before to each row, rad/s, (N,): 0 in the first, and where a turn may be the other way round.

    None where that may be most turns. Θ leads from one attitude to the next, ω is the mean between them.
    """
    errors, turn = np.zeros(len(t)), steps(R)
    good = np.isfinite(R).all((1, 2)) & np.isfinite(omega).all(1)
    clear = (np.linalg.norm(turn, axis=1) < ANOTHER_TURN) & good[1:] & good[:-1]
    if len(t) < 2 or 2 * np.count_nonzero(clear) < np.count_nonzero(good[1:] & good[:-1]) or not clear.any():
        return None
    if frame == "world":
        turn = np.einsum("nij,nj->ni", R[:-1], turn)
    off = turn / np.diff(t, axis=0) - means(t[:, 0], omega, frame)
    errors[1:] = np.where(clear, np.linalg.norm(off, axis=1), 0.0)
    return errors


def means(t: Array, omega: Array, frame: str) -> Array:
    """The mean ω between two rows, (N − 1, 3), of fourth order in dt by Magnus: it turns one attitude to the next.

    (ω₁ + ω₂)/2 + dt/12 (±ω₁ × ω₂ − (ω₂' − ω₁')),      + in the body, − in the world
    """
    dt, first, second = np.diff(t)[:, None], omega[:-1], omega[1:]
    change = np.diff(np.gradient(omega, t, axis=0, edge_order=2), axis=0) if len(t) > 2 else 0.0
    twist = np.cross(first, second) * (1 if frame == BODY else -1)
    return np.asarray((first + second) / 2 + dt / 12 * (twist - change))


def disagreement(t: Array, R: Array, omega: Array, frame: str) -> float:
    """The median of `kinematics`, relative to ω; NaN where it tells nothing."""
    errors, speed = kinematics(t[:, None], R, omega, frame), size(omega)
    return math.nan if errors is None or not speed else float(np.median(errors[1:])) / speed


def turned(t: Array, omega: Array) -> Array:
    """The rotations (N, 3, 3) that ω in the body turns from 1: R' = R ω."""
    R = [np.eye(3)]
    for step in Rotation.from_rotvec(np.diff(t)[:, None] * means(t, omega, BODY)).as_matrix():
        R.append(R[-1] @ step)
    return np.array(R)


def cap(omega: Array) -> tuple[float, float] | None:
    """|ω| before and after a first step in which it falls as in no other, if it stays there; else None."""
    speed = np.linalg.norm(omega, axis=1)
    if len(speed) < FEWEST:
        return None
    steps, after = np.abs(np.diff(speed)), speed[1:]
    if speed[0] - speed[1] < max(FALLS * speed[0], 10 * float(np.median(steps))):
        return None
    top = float(np.max(after))
    is_reached_often = np.count_nonzero(after > top * (1 - 2e-4)) >= 5
    stays = is_reached_often or np.ptp(after[: len(after) // 4]) < 0.1 * (speed[0] - top)
    return (float(speed[0]), top) if stays else None
