"""The words of a diagnosis: for each cause a sentence with its number, and what mends it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES, RigidBody
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.judging import fits_kinematics as fk
from lagrange_bench.judging.fits import (
    NEAR,
    ONE,
    Array,
    axis_name,
    factor_of,
    is_axes,
    name_of,
    numbers,
    rotvec,
    triple,
)
from lagrange_bench.judging.fits_frames import LATEST, LENGTHS
from lagrange_bench.judging.fits_law import Law, moments

CLOCK_NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds", "min": "minutes"}
MOMENTS = "give the program the moments of the body"
SMALLER = "take smaller steps, or another integrator"


class Words(NamedTuple):
    """A cause, a sentence on it, and the option or the change that mends it."""

    cause: str
    text: str
    option: str


class Finding(NamedTuple):
    """A cause, a sentence on it, the misfit before and after it is mended, and the option or the change that mends it."""

    cause: str
    text: str
    before: float
    after: float
    option: str


def of_shift(shift: float, first: float, step: float) -> Words:
    """A constant that is added to the times, s; first and step : of the times as they are."""
    rows = shift / step
    if abs(rows) > LATEST + 0.5 or abs(rows - round(rows)) > NEAR:
        text = f"the first row is the start of the case: --t0 0, or subtract {first:.9g} s from the times"
        return Words("time-shift", text, "--t0 0")
    k = round(rows)
    count, side = "row" if abs(k) == 1 else "rows", "later" if k > 0 else "earlier"
    text = f"the times are shifted: each row holds the state {abs(k)} {count} {side}"
    return Words("rows-late", text, "write the row on the other side of the step")


def of_start(R: Array | None, omega: Array | None, x: Array | None) -> Words:
    """Another start, perhaps of a named case; rows of rotations, ω in the body and positions."""
    for name, case in CASES.items():
        rotation = as_rotation(case.rotation).as_matrix()
        position = rotation @ case.body.com if case.body.fixed else np.asarray(case.position)
        starts = [(R, rotation), (omega, np.asarray(case.omega_body)), (x, position)]
        known = [
            np.abs(rows[0] - start).max() < 1e-6 * max(1.0, np.abs(start).max())
            for rows, start in starts
            if rows is not None
        ]
        if omega is not None and len(known) > 1 and all(known):
            return Words("other-start", f"this is the start of the case {name}", f"--case {name}")
    return Words("other-start", "the rows start elsewhere than the case: --start first-row", "--start first-row")


def of_reading(reading: str) -> Iterator[Words]:
    """Rotations that are read otherwise: an option, or "transposed", or both."""
    if option := reading.removesuffix(fk.TRANSPOSED).strip():
        is_order = "quat" in option or "qw" in option
        cause = "quaternion-order" if is_order else "rotation-angles"
        words = (
            "the quaternions are in the other order" if is_order else "the angles are in degrees, or about other axes"
        )
        yield Words(cause, f"{words}: {option}", option)
    if reading.endswith(fk.TRANSPOSED):
        mend = "write R transposed, or the conjugate"
        yield Words(
            "rotation-transposed", f"the rotations are transposed: they take the world to the body; {mend}", mend
        )


def of_hand(axes: str) -> Words:
    """A left-handed world; axes : what to write for x, y, z."""
    vectors = f"for the vector part of quaternions, rotation vectors and ω −{axes}"
    text = f"the world is left-handed: write {axes} for positions (x, y, z), and {vectors}"
    return Words("left-handed", text, f"write {axes} for (x, y, z)")


def smallest_turn(a: Array, b: Array) -> Array:
    """The smallest turn that takes the direction a to b, as --up and --axis do; half a turn is about x, or about y."""
    if a @ b < NEAR - 1:
        return np.diag([1.0, -1.0, -1.0] if abs(b[0]) < 0.5 else [-1.0, 1.0, -1.0])
    return Rotation.align_vectors(b, a)[0].as_matrix()


def of_world(W: Array, body: RigidBody) -> Words:
    """Other axes of the world; W takes the world of the rows to that of the case."""
    if not is_axes(W):
        turn = f"turn the world of the rows by the rotation vector ({numbers(rotvec(W[None])[0])}) rad"
        return Words("world-axes", f"the axes of the world are others: {turn}", turn)
    up = W.T @ body.up
    if np.abs(up).max() > 1 - NEAR and np.allclose(smallest_turn(up, body.up), W.round(), atol=NEAR):
        option = f"--up={axis_name(up)}"
        return Words("world-axes", f"the axis {axis_name(up)} points up: {option}", option)
    write = f"write {triple(W)} for (x, y, z)"
    return Words("world-axes", f"the axes of the world have other names: {write}", write)


def of_body(B: Array, body: RigidBody) -> Words:
    """Other axes of the body; B takes the body of the case to that of the rows."""
    if not is_axes(B):
        turn = f"turn the body of the rows by the rotation vector ({numbers(rotvec(B[None])[0])}) rad"
        return Words("body-axes", f"the axes of the body are others: {turn}", turn)
    own = np.zeros(3) if body.axis is None else body.axis
    axis = B @ own
    if np.abs(axis).max() > 1 - NEAR and np.allclose(smallest_turn(axis, own).T, B.round(), atol=NEAR):
        option = f"--axis={axis_name(axis)}"
        return Words("body-axes", f"the axis of symmetry is {axis_name(axis)}: {option}", option)
    write = f"the axes (x, y, z) of the body are {triple(B.T)} in the rows"
    return Words("body-axes", f"the axes of the body have other names: {write}", write)


def of_spin(spin: fk.Spin, frame: str) -> Iterator[Words]:
    """What is wrong with ω, which was read in this frame."""
    if spin.frame == fk.BEFORE:
        mend = "turn ω by the rotation of its own row"
        yield Words("omega-lag", f"ω is in the frame of the body of the row before: {mend}", mend)
    elif spin.frame != frame:
        option = f"--omega {spin.frame}"
        yield Words("omega-frame", f"ω is in the {spin.frame} frame: {option}, from Python omega_frame", option)
    if spin.time in fk.HALVES:
        text = f"ω is {spin.time}: it is what turns {fk.HALVES[spin.time]}"
        yield Words("omega-half-step", text, "take the mean of two rows, or shift the times of ω by half a step")
    elif spin.time != fk.ON_TIME:
        yield Words(
            "omega-row", f"ω is {spin.time}: write ω and rotation of one time", "write ω and rotation of one time"
        )
    factor = factor_of(spin.M)
    M = spin.M / factor
    if abs(abs(factor) - 1) > NEAR / 4:
        unit = name_of(abs(factor), fk.SPEEDS)
        text = (
            f"omega is in {fk.SPEED_NAMES[unit]}: --units omega={unit}"
            if unit
            else f"ω has the factor {abs(factor):.4g}"
        )
        yield Words("omega-unit", text, f"--units omega={unit}" if unit else "another unit of ω")
    if factor < 0:
        yield Words("omega-sign", "omega is of the other sign", "change the sign of ω")
    elif is_axes(M) and not np.allclose(M, ONE, atol=NEAR):
        write = f"write {triple(M)} for (x, y, z)"
        yield Words("omega-axes", f"ω is in other axes: {write}", write)
    elif not is_axes(M):
        turn = f"turn ω by the rotation vector ({numbers(rotvec(M[None])[0])}) rad"
        yield Words("omega-turned", f"ω is in other axes, as of a gyroscope that is mounted askew: {turn}", turn)


def of_product(frame: str) -> Words:
    """A product of rotations on the wrong side; frame : in which the rotations take ω to be."""
    text = f"ω is right as it is read, but the rotations turn as if it were in the {frame}: multiply on the other side"
    return Words("rotation-product", text, "q ← q δq for ω in the body, q ← δq q for ω in the world")


def of_angles(is_integrated: bool) -> Words:
    """ω is the rate of the columns of angles: are the angles wrong, or ω?"""
    if is_integrated:
        text = "the angles are the integrals of ω (φ' = p, θ' = q, ψ' = r): ω is taken for the rates of the angles"
        return Words("angles-integrated", text, "integrate q' = q ω/2, or R' = R ω")
    return Words(
        "angle-rates", "the columns of ω are the rates of the angles, not ω", "write ω, or leave these columns out"
    )


def of_cap(before: float, after: float) -> Words:
    """|ω| falls to a cap, rad/s."""
    speeds = f"from {before:.4g} to {after:.5g} rad/s ({math.degrees(after):.4g} °/s)"
    return Words(
        "cap", f"|ω| falls {speeds} in the first step, and not below: a cap", "lift the cap on angular velocities"
    )


def of_law(law: Law, body: RigidBody) -> Iterator[Words]:
    """What is wrong with the body, and with each term."""
    if law.word is None:
        I, products = moments(law.body), law.body[3:6]
        has_products = np.abs(products).max() > NEAR * np.abs(I).max()
        tail = f"products {numbers(products)}" if has_products else "no products"
        lever = f", m c = ({numbers(law.body[6:])}) kg m" if np.any(law.body[6:]) else ""
        verb = "follow the law" if lever else "keep the momentum"
        yield Words(
            "moments", f"the rows {verb} of a body with moments {numbers(np.diag(I))} and {tail}{lever}", MOMENTS
        )
    elif law.word:
        cause, text = law.word
        yield Words(cause, text, MOMENTS)
    for name, value in law.terms.items():
        yield of_gravity(np.asarray(value), body) if name == "gravity" else of_term(name, float(value))


def of_term(name: str, value: float) -> Words:
    """A term of the law with its coefficient."""
    if name == "torque":
        share = "" if value == 1 else f" ({value:.2f} of it)"
        text = f"the program leaves out the gyroscopic torque ω × I ω{share}: an option of many engines"
        return Words("gyroscopic-torque", text, "switch the gyroscopic torque on")
    if name == "explicit":
        side = "before" if value > 0 else "after"
        text = f"the gyroscopic torque is that of {abs(value):.3g} s {side}: an explicit step"
        return Words("explicit-step", text, SMALLER)
    if value < 0:
        return Words("explicit-step", f"L grows like exp({-value:.3g} t): an explicit step", SMALLER)
    return Words("damping", f"L decays like exp(−{value:.3g} t): damping", "switch the damping off")


def of_gravity(g: Array, body: RigidBody) -> Words:
    """Another gravity, m/s²."""
    was, strength, length = body.gravity, float(np.linalg.norm(body.gravity)), float(np.linalg.norm(g))
    mend = "give the program the gravity of the body"
    if length < NEAR * strength:
        return Words("gravity", "the program has no gravity", mend)
    share = float(g @ was) / strength**2 if strength else math.inf
    if np.linalg.norm(np.cross(g, was)) > NEAR * strength * length:
        up, is_as_strong = -g / length, abs(length / strength - 1) < NEAR
        if is_as_strong and np.abs(up).max() > 1 - NEAR:
            option = f"--up={axis_name(up)}"
            return Words(
                "world-axes",
                f"gravity pulls along {axis_name(-up)}: the axis {axis_name(up)} points up: {option}",
                option,
            )
        return Words("gravity", f"gravity is ({numbers(g)}) m/s², not ({numbers(was)})", mend)
    if abs(share + 1) < NEAR:
        return Words("gravity", "gravity is reversed: it points up", mend)
    return Words("gravity", f"gravity is {length:.4g} m/s², {share:.3g} of that of the body", mend)


def of_length(unit: str) -> Words:
    """Another unit of length."""
    return Words("length-unit", f"position is in {unit}: --units position={unit}", f"--units position={unit}")


def of_place(word: str, value: Array, body: RigidBody) -> Iterator[Words]:
    """What is wrong with positions."""
    if word == "displacement":
        mend = "name it ux, uy, uz"
        yield Words("displacement", f"the position is a displacement from the start: {mend}", mend)
    elif word == "origin":
        shift = f"({numbers(-value)}) m"
        yield Words("origin", f"the positions are off by {shift}: another origin", f"subtract {shift}")
    elif word == "point":
        point = f"the point ({numbers(value)}) m of the body" if np.abs(value).max() > 1e-9 else "the fixed point"
        yield Words(
            "origin", f"the positions are those of {point}, not of the centre of mass", "write the centre of mass"
        )
    elif word == "gravity":
        yield of_gravity(body.gravity + value, body)
    else:
        factor = factor_of(value)
        M = value / factor
        if abs(abs(factor) - 1) > NEAR / 4:
            unit = name_of(abs(factor), LENGTHS)
            text = (
                f"position is in {unit}: --units position={unit}"
                if unit
                else f"positions have the factor {abs(factor):.4g}"
            )
            yield Words("length-unit", text, f"--units position={unit}" if unit else "another unit of length")
        if np.linalg.det(value) < 0:
            yield of_hand(triple(np.sign(factor) * M))
        elif not np.allclose(M, ONE, atol=NEAR):
            yield of_world(M, body)
