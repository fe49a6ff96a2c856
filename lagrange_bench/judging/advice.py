"""What is wrong with the rows of a file, and how wrong they are when they are read as a finding says."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lagrange_bench.judging.columns import OF_UNITS, FileTrajectory
from lagrange_bench.judging.diagnosis import MOST, BodyRows, Diagnosis
from lagrange_bench.judging.findings import Finding, say
from lagrange_bench.judging.fits_frames import Exact
from lagrange_bench.judging.frames import UNITS, Frames, hidden
from lagrange_bench.judging.names import unit_of

Array = np.ndarray
# causes that --up and --axis change
AXES = ("world-axes", "body-axes", "left-handed")


def findings_of(frames: Frames, rows: Mapping[str, Array], track: FileTrajectory) -> tuple[list[Finding], str]:
    """What is wrong with rows, by their first ones; and how well they agree with themselves if nothing is found.

    found : what the file says of its columns.
    """
    head = {name: values[:MOST] for name, values in rows.items()}
    if "matrix" in head and np.nanmedian(np.linalg.det(head["matrix"].reshape(-1, 3, 3))) < 0:
        return [say("left-handed matrix")], ""
    exact, options = None if frames.case is None else frames.exact, frames.options
    diagnosis = diagnosis_of(frames, head, track, exact)
    findings = diagnosis.findings()
    if (options.up or options.axis) and any(finding.cause in AXES for finding in findings):
        as_in_case = Frames(frames.rigid_body, replace(options, up=None, axis=None), frames.digit, frames.case)
        others = diagnosis_of(as_in_case, head, track, exact).findings()
        if len(others) < len(findings):  # without the user's axes, fewer things are wrong
            return [other._replace(text=f"{other.text[:-1]}, without --up and --axis.") for other in others], ""
    return findings, "" if findings else diagnosis.agreement()


def diagnosis_of(frames: Frames, rows: Mapping[str, Array], track: FileTrajectory, exact: Exact | None) -> Diagnosis:
    """The rows in these frames, and other ways to read them. exact : the motion at any times, None without a start."""
    is_angles = "angles" in rows and not {"quaternion", "matrix", "rotation vector"} & set(rows)
    known = BodyRows(
        t=rows["time"][:, 0],
        R=frames.matrices(rows),
        omega=frames.omega(rows) if "omega" in rows else None,
        x=next(frames.positions(rows), None),
        frame=frames.frame,
        angles=rows["angles"] if is_angles else None,
    )
    return Diagnosis(
        known, frames.other_readings(rows, track.other_order), frames.rigid_body, exact, hidden(track.floor)
    )


def so_read(frames: Frames, rows: Mapping[str, Array], before: Mapping[str, Array], findings: Sequence[Finding]) -> str:
    """The errors of rows that are read with the options of findings; empty if these do not say all.

    before : the errors as the rows are read.
    """
    if any(not finding.option.startswith("--") for finding in findings):
        return ""
    rows, changes = dict(rows), dict[str, Any]()
    for word, value in re.findall(r"--(\w+)[ =](\S+)", " ".join(finding.option for finding in findings)):
        name, _, unit = value.partition("=")
        if word == "units":
            known = unit_of(unit)
            for group in rows.keys() & OF_UNITS[name]:
                rows[group] = rows[group] * (known.factor if known is not None else 1.0)
        elif word == "t0":
            rows["time"] = rows["time"] - rows["time"][0] + float(value)
        elif word == "columns" and name == "angle1":
            rows["angles"] = rows.pop("rotation vector")
        elif word == "columns":  # the other order of quaternions
            changes["quat"] = "xyzw" if frames.options.quat == "wxyz" else "wxyz"
        elif word in ("quat", "angles", "up", "axis", "omega"):
            changes[word if word != "omega" else "omega_frame"] = value
        else:
            return ""
    other = Frames(frames.rigid_body, replace(frames.options, **changes), frames.digit, frames.case)
    if other.case is None:
        other.refer(rows)
    errors, _, _ = other.by_the_better_clock(rows)
    names = [name for name in ("rotation", "position", "omega", "kinematics") if name in errors]
    if any(np.nanmedian(errors[name]) > np.nanmedian(before[name]) for name in names if name in before):
        return ""  # the options do not say all that is to be changed
    shown = [f"{name} {errors[name].max():.1g} {UNITS[name]}" for name in names]
    return f"So read: {', '.join(shown)}." if shown else ""
