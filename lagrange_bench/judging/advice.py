"""What is wrong with rows, and how wrong they are when they are read as a finding says."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from lagrange_bench.integrators import Case, RigidBody
from lagrange_bench.judging.columns import Trajectory
from lagrange_bench.judging.diagnosis import MOST, RATES, Floor, Rows, diagnose
from lagrange_bench.judging.errors import by_the_better_clock
from lagrange_bench.judging.findings import Finding
from lagrange_bench.judging.fits_law import Windows
from lagrange_bench.judging.frames import ATTITUDES, UNITS, Convention, Frames, kinematics, tensor
from lagrange_bench.judging.names import unit_of

Array = np.ndarray
# another body must make the errors so many times smaller, and smaller than this share of the size; of so many rows
BETTER, RIGHT, ENOUGH = 10, 0.5, 5
# positions that are this near to the fixed point, of the length of the body, are those of it
POINT = 0.05
# the other frame of ω must be so many times nearer
CLEARLY = 10
# causes beside which ω may be in the other frame
READINGS = ("quaternion-order", "rotation-transposed", "rotation-angles")
# a law that is off by more of its size does not hold
HOLDS = 0.05
# and rows whose law is off so many times more than in most are told
APART = 100.0
# causes that --up and --axis change
AXES = ("world-axes", "body-axes", "left-handed")
OF_UNITS = {"t": ("time",), "position": ("position",), "omega": ("omega",), "angle": ("angles", "rotation vector")}


def findings_of(frames: Frames, rows: Mapping[str, Array], found: Trajectory) -> list[Finding]:
    """What is wrong with rows, by their first ones. found : what the file says of its columns."""
    head = {name: values[:MOST] for name, values in rows.items()}
    if "matrix" in head and np.nanmedian(np.linalg.det(head["matrix"].reshape(-1, 3, 3))) < 0:
        text = "a row or column of the matrices has the wrong sign: their determinant is negative."
        return [Finding("left-handed", text, math.nan, math.nan, "change the sign of a row or a column")]
    findings, how = _causes(frames, head, found), frames.convention
    if (how.up or how.axis) and any(finding.cause in AXES for finding in findings):
        as_in_case = Frames(frames.rigid_body, replace(how, up=None, axis=None), frames.digit, frames.case)
        others = _causes(as_in_case, head, found)
        if len(others) < len(findings):  # without the user's axes, fewer things are wrong
            return [other._replace(text=f"{other.text[:-1]}, without --up and --axis.") for other in others]
    return findings


def _causes(frames: Frames, rows: Mapping[str, Array], found: Trajectory) -> list[Finding]:
    """What is wrong with rows in these frames."""
    R, floor = frames.matrices(rows), found.floor
    if R is None and (found_by_places := _fixed_point(frames, rows) or _other_body(frames, rows)):
        return found_by_places
    known = Rows(
        t=rows["time"][:, 0],
        R=R,
        omega=frames.omega(rows) if "omega" in rows else None,
        x=next(frames.positions(rows), None),
        frame=frames.convention.omega_frame,
        angles=None if {"quaternion", "matrix", "rotation vector"} & set(rows) else rows.get("angles"),
    )
    hidden = Floor(
        t=floor.get("time", 0.0),
        R=max((floor.get(name, 0.0) for name in ATTITUDES if name in rows), default=0.0),
        omega=floor.get("omega", 0.0),
        x=floor.get("position", 0.0),
    )
    exact, ways = None if frames.case is None else frames.exact, frames.ways(rows, _other_order(found))
    findings = diagnose(known, ways, frames.rigid_body, exact, hidden)
    return findings + _frame_of_omega(known, ways, findings)


def _frame_of_omega(rows: Rows, ways: Mapping[str, Array], findings: Sequence[Finding]) -> list[Finding]:
    """The other frame of ω, where rows are too far apart for other causes: by the means of ω between two rows."""
    if rows.R is None or rows.omega is None or any(finding.cause not in READINGS for finding in findings):
        return []
    R = next((ways[finding.option] for finding in findings if finding.option in ways), rows.R)
    R = R.transpose(0, 2, 1) if any(finding.cause == "rotation-transposed" for finding in findings) else R
    speed, off = float(np.nanmedian(np.linalg.norm(rows.omega, axis=1))), dict[str, float]()
    for frame in ("body", "world"):
        errors = kinematics(rows.t[:, None], R, rows.omega, frame)
        off[frame] = math.nan if errors is None or not speed else float(np.nanmedian(errors[1:])) / speed
    other = "world" if rows.frame == "body" else "body"
    if not CLEARLY * off[other] < min(off[rows.frame], 1.0):
        return []
    option = f"--omega {other}"
    text = f"ω is in the {other} frame: {option}, from Python omega_frame."
    return [Finding("omega-frame", text, off[rows.frame], off[other], option)]


def _other_order(found: Trajectory) -> str:
    """The option for another order of quaternions whose names tell it."""
    if not found.wxyz:
        return ""
    w, x, y, z = found.wxyz
    return f"--columns qw={z},qx={w},qy={x},qz={y}"


def _fixed_point(frames: Frames, rows: Mapping[str, Array]) -> list[Finding]:
    """Whether positions are those of the fixed point."""
    if frames.case is None or not frames.length or "position" not in rows:
        return []
    off = float(np.nanmax(np.linalg.norm(rows["position"], axis=1)) / frames.length)
    text = "the positions are those of the fixed point, not of the centre of mass."
    return [Finding("origin", text, 1.0, off, "write the centre of mass")] if off < POINT else []


def _other_body(frames: Frames, rows: Mapping[str, Array]) -> list[Finding]:
    """The body that rows without rotations follow: with gravity reversed, or with moments about another point."""
    quantity = next((name for name in ("position", "omega") if name in rows), "")
    if frames.case is None or not quantity or len(rows["time"]) < ENOUGH:
        return []
    body = frames.rigid_body
    others: dict[tuple[str, str], dict[str, Array]] = {}
    if np.any(body.gravity) and (np.any(body.weight) or not body.fixed):
        others["gravity", "gravity is reversed: it points up."] = {"gravity": -body.gravity}
    about, points = "were taken for those about the", ("fixed point", "centre of mass")
    if frames.length:
        steiner = tensor(body) - body.inertia_com
        for sign, (one, two) in ((1, points), (-1, points[::-1])):
            words = f"the moments of inertia about the {one} {about} {two}."
            others["moments", words] = {"inertia_com": body.inertia_com + sign * steiner}

    def off(case: Case) -> float:
        other = Frames(case.body, frames.convention, case=case)
        errors = other.errors(rows, other.exact(rows["time"][:, 0]))
        return float(np.median(errors[quantity]) / frames.sizes[quantity])

    found = {}
    for key, change in others.items():
        with warnings.catch_warnings(), suppress(ValueError):
            warnings.simplefilter("ignore", RuntimeWarning)  # of moments that no body has
            found[key] = off(replace(frames.case, body=RigidBody(**{**body.facts, **change}), exact={}))
    now, best = off(frames.case), min(found, key=found.__getitem__, default=None)
    if best is None or not BETTER * found[best] < min(now, RIGHT):
        return []
    cause, text = best
    return [Finding(cause, text, now, found[best], f"give the program the {cause} of the body")]


def looked_at(frames: Frames, rows: Mapping[str, Array]) -> str:
    """How well rows in which nothing is found agree with themselves; empty if these are too few, or too far apart."""
    head = {name: values[:MOST] for name, values in rows.items()}
    R, omega = frames.motion(head)
    good = np.isfinite(R).all((1, 2)) & np.isfinite(omega).all(1) if omega is not None else np.full(len(R), False)
    if omega is None or not frames.attitudes(head) or np.count_nonzero(good) < RATES:
        return ""
    t, R, omega = head["time"][good], R[good], omega[good]
    speed, off = float(np.median(np.linalg.norm(omega, axis=1))), kinematics(t, R, omega, "body")
    if off is None or not speed or speed * float(np.median(np.diff(t[:, 0]))) > 1:
        return ""
    windows = Windows(t[:, 0], R, omega, frames.rigid_body)
    misfits = np.linalg.norm(windows.X @ windows.claimed, axis=1) / windows.scale
    law = float(np.median(misfits))
    holds = f"the law of motion {'holds to' if law < HOLDS else 'is off by'} {law:.0e}"
    agree = f"ω and the rotations agree to {float(np.median(off)) / speed:.0e}, {holds}"
    broken = misfits > max(HOLDS, APART * law)
    if not broken.any():
        return f"No cause is found: {agree}."
    when = float(t[int(np.argmax(broken)) + windows.w, 0])
    where = f"near t = {when:.4g} s it is off by {misfits.max():.0e}: look there for a cap on ω, a contact or a reset"
    return f"No cause is found: {agree} in most rows; {where}."


def so_read(frames: Frames, rows: dict[str, Array], before: Mapping[str, Array], findings: Sequence[Finding]) -> str:
    """The errors of rows that are read with the options of findings; empty if these do not say all.

    before : the errors as the rows are read.
    """
    options = " ".join(finding.option for finding in findings)
    words = re.findall(r"--(\w+)[ =](\S+)", options)
    if not findings or any(not finding.option.startswith("--") for finding in findings):
        return ""
    rows, changes = dict(rows), dict[str, str]()
    for word, value in words:
        if word in ("units", "t0", "columns"):
            _change(rows, word, value, frames.convention, changes)
        elif word in ("quat", "angles", "up", "axis", "omega"):
            changes[word if word != "omega" else "omega_frame"] = value
        else:
            return ""
    other = Frames(frames.rigid_body, replace(frames.convention, **changes), frames.digit, frames.case)
    if other.case is None:
        other.refer(rows)
    errors, _, _ = by_the_better_clock(other, rows)
    names = [name for name in ("rotation", "position", "omega", "kinematics") if name in errors]
    if any(np.nanmedian(errors[name]) > np.nanmedian(before[name]) for name in names if name in before):
        return ""  # the options do not say all that is to be changed
    shown = [f"{name} {errors[name].max():.1g} {UNITS[name]}" for name in names]
    return f"So read: {', '.join(shown)}." if shown else ""


def _change(rows: dict[str, Array], word: str, value: str, how: Convention, changes: dict[str, str]) -> None:
    """Change rows as an option of their columns says, or what is to be changed in the convention."""
    name, _, unit = value.partition("=")
    if word == "t0":
        rows["time"] = rows["time"] - rows["time"][0] + float(value)
    elif word == "columns" and value.startswith("angle1"):
        rows["angles"] = rows.pop("rotation vector")
    elif word == "columns":  # the other order of quaternions
        changes["quat"] = "xyzw" if how.quat == "wxyz" else "wxyz"
    elif (known := unit_of(unit)) is not None:
        for group in OF_UNITS.get(name, ()):
            if group in rows:
                rows[group] = rows[group] * known.factor
