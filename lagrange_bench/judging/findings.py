"""The causes that `judge` names: a sentence with its number for each, and what mends it."""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.judging.fits import name_of
from lagrange_bench.judging.vectors import NEAR, Array, is_axes, rotvec

# cause, and a second word if it has several sentences | the sentence | the option or the change that mends it
TABLE = """
time-unit | the times are in {name}: {mend} | --units t={unit}
time-unit unnamed | the times have the factor {factor:.3g} | divide the times by it: --step or --units t=…
time-shift | the first row is the start of the case: {mend}, or subtract {first:.9g} s from the times | --t0 0
rows-late | the times are shifted: each row holds the state {rows} | write the row on the other side of the step
other-start | the rows start elsewhere than the case: {mend} | --start first-row
quaternion-order | the quaternions are in the other order: {mend} | {option}
rotation-angles | the angles are in degrees, or about other axes: {mend} | {option}
rotation-transposed | the rotations are transposed: they take the world to the body; {mend} | write R transposed, or the conjugate
rotation-product | ω is right as it is read, but the rotations turn as if it were in the {frame}: multiply on the other side |
    q ← q δq for ω in the body, q ← δq q for ω in the world
left-handed | the world is left-handed: {mend} | write {axes} for positions (x, y, z), and for the vector part of quaternions,
    rotation vectors and ω −{axes}
left-handed matrix | a row or column of the matrices has the wrong sign: their determinant is negative | change the sign of a
    row or a column
world-axes | the axes of the world have other names: {mend} | write {axes} for (x, y, z)
world-axes option | the axis {axis} points up: {mend} | --up={axis}
world-axes turned | the axes of the world are others: {mend} | turn the world of the rows by the rotation vector ({turn}) rad
world-axes gravity | gravity pulls along {down}: the axis {axis} points up: {mend} | --up={axis}
body-axes | the axes of the body have other names: {mend} | the axes (x, y, z) of the body are {axes} in the rows
body-axes option | the axis of symmetry is {axis}: {mend} | --axis={axis}
body-axes turned | the axes of the body are others: {mend} | turn the body of the rows by the rotation vector ({turn}) rad
body-axes moments | the body has other axes, {axes} of the rows, or its moments have changed places: {moments} | give the
    program the moments of the body
omega-lag | ω is in the frame of the body of the row before: {mend} | turn ω by the rotation of its own row
omega-frame | ω is in the {frame} frame: {mend}, from Python omega_frame | --omega {frame}
omega-half-step | ω is {time}: it is what turns {step} | take the mean of two rows, or shift the times of ω by half a step
omega-half-step part | ω is {late:.3g} s {side}, a part of the time between two rows: rotation and ω are of different moments of a
    step | write ω and rotation of one time
omega-row | ω is {time}: {mend} | write ω and rotation of one time
omega-unit | omega is in {name}: {mend} | --units omega={unit}
omega-unit unnamed | ω has the factor {factor:.4g} | another unit of ω
omega-sign | omega is of the other sign | change the sign of ω
omega-axes | ω is in other axes: {mend} | write {axes} for (x, y, z)
omega-turned | ω is in other axes, as of a gyroscope that is mounted askew: {mend} | turn ω by the rotation vector ({turn}) rad
angles-integrated | the angles are the integrals of ω (φ' = p, θ' = q, ψ' = r): ω is taken for the rates of the angles |
    integrate q' = q ω/2, or R' = R ω
angle-rates | the columns of ω are the rates of the angles, not ω | write ω, or leave these columns out
cap | |ω| falls from {before:.4g} to {after:.5g} rad/s ({degrees:.4g} °/s) in the first step, and not below: a cap | lift the
    cap on angular velocities
cap spin | the spin falls from {before:.4g} to {after:.4g} rad/s in the first step: a cap | lift the cap on angular velocities
moments | the rows {verb} of a body with moments {moments} and {rest} | give the program the moments of the body
moments left-out | the products of inertia are left out | give the program the moments of the body
moments sign | the products of inertia have the other sign | give the program the moments of the body
moments point | the moments of inertia about the {one} were taken for those about the {other} | give the program the moments
    of the body
gyroscopic-torque | the program leaves out the gyroscopic torque ω × I ω: an option of many engines | switch the gyroscopic
    torque on
damping spin | the spin falls like exp(−{rate:.3g} t): damping | switch the damping off
damping | L decays like exp(−{rate:.3g} t): damping | switch the damping off
linear-damping | the body flies by v' = g − {rate:.3g} v: linear damping | switch the damping off
explicit-step | the gyroscopic torque is that of {late:.3g} s {side}: an explicit step | take smaller steps, or another integrator
explicit-step grows | L grows like exp({rate:.3g} t): an explicit step | take smaller steps, or another integrator
gravity none | the program has no gravity | give the program the gravity of the body
gravity reversed | gravity is reversed: it points up | give the program the gravity of the body
gravity share | gravity is {length:.4g} m/s², {share:.3g} of that of the body | give the program the gravity of the body
gravity | gravity is ({g}) m/s², not ({was}) | give the program the gravity of the body
length-unit | position is in {name}: {mend} | --units position={unit}
length-unit unnamed | positions have the factor {factor:.4g} | another unit of length
displacement | the position is a displacement from the start: {mend} | name it ux, uy, uz
origin | the positions are off by {shift}: another origin | subtract {shift}
origin point | the positions are those of {point}, not of the centre of mass | write the centre of mass
"""
SENTENCES = {
    name: (sentence, mend)
    for line in re.split(r"\n(?=\S)", TABLE.strip())
    for name, sentence, mend in [" ".join(line.split()).split(" | ")]
}


class Finding(NamedTuple):
    """A cause, a sentence on it, the misfit before and after it is mended, and the option or the change that mends it."""

    cause: str
    text: str
    before: float
    after: float
    option: str


def say(name: str, /, **facts: Any) -> Finding:
    """The finding of a line of `SENTENCES`; no misfits are known of it yet."""
    text, mend = SENTENCES[name]
    option = mend.format(**facts)
    return Finding(name.partition(" ")[0], f"{text.format(mend=option, **facts)}.", math.nan, math.nan, option)


def of_unit(cause: str, factor: float, units: Mapping[str, float], names: Mapping[str, str] | None = None) -> Finding:
    """Another unit of a quantity, or a factor that has no name. units, names : the unit → its factor, its name in words."""
    unit = name_of(factor, units)
    if unit is None:
        return say(f"{cause} unnamed", factor=factor)
    return say(cause, unit=unit, name=unit if names is None else names[unit])


def of_axes(part: str, M: Array, axis: Array) -> Finding:
    """Other axes of the "world" or of the "body".

    M : takes vectors from the rows to the case. axis : of the case, up or the axis of symmetry.
    """
    if not is_axes(M):
        turn = rotvec(M[None])[0] if part == "world" else rotvec(M.T[None])[0]
        return say(f"{part}-axes turned", turn=numbers(turn))
    in_rows = M.T @ axis
    if np.abs(in_rows).max() > 1 - NEAR and np.allclose(smallest_turn(in_rows, axis), M.round(), atol=NEAR):
        return say(f"{part}-axes option", axis=axis_name(in_rows))
    return say(f"{part}-axes", axes=triple(M))


def smallest_turn(a: Array, b: Array) -> Array:
    """The smallest turn that takes the direction a to b; half a turn is about x, or about y if b is x."""
    if a @ b < NEAR - 1:
        return np.diag([1.0, -1.0, -1.0] if abs(b[0]) < 0.5 else [-1.0, 1.0, -1.0])
    return Rotation.align_vectors(b, a)[0].as_matrix()


def axis_name(v: Array) -> str:
    """The axis that is nearest to a vector, such as -y."""
    place = int(np.argmax(np.abs(v)))
    sign = "-" if v[place] < 0 else ""
    return f"{sign}{'xyz'[place]}"


def triple(P: Array) -> str:
    """The rows of a signed permutation: (x, z, -y)."""
    return f"({', '.join(axis_name(row) for row in P)})"


def numbers(values: Iterable[float]) -> str:
    """Numbers to four digits, with commas."""
    return ", ".join(f"{float(value) + 0.0:.4g}" for value in np.round(list(values), 9))
