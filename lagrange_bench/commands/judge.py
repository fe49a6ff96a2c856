"""Judge the trajectory of any program by the exact motion of a rigid body, and say what is wrong with it.

For those who have a multibody program, a physics engine or a simulator, in any language. Read the trajectory of a rigid body that
the program wrote: heavy or free, symmetric or not, with a fixed point or flying. Print its errors: position, direction of the
axis, rotation, spin about the axis, length, orthogonality, angular velocity, energy and angular momentum, as far as the file has
them (docs/heavy-top.md explains each). Say whether the start is right. Name what is wrong, if it is clear: a convention, a unit,
a clock, moments, gravity, damping, a cap, a missing torque; with the misfit before and after, and the option that mends it.
docs/tutorials/is-my-multibody-code-right.md mends a run, docs/engine-defaults.md lists what engines do by default.

Columns are found by what their names mean: topic.pose.orientation.x, quat_x and qx are the same. docs/names.md has the table of
words, components and units. A name may begin with another one, such as the name of the body.
  t | time | timestamp | …       s; header.stamp.sec and .nanosec are added
  px | position.x | top.x …      m, position of the centre of mass; ux uy uz: its displacement
  qw | rotation.w | quat_w …     quaternion, body to world; q0 … q3, q[0] … in the order of --quat; q1 … q4: scalar last
  r11 … r33 | m00 … m22 | …      matrix, body to world, row by row
  rx ry rz | mrp1 … | axis_x …   rotation vector, modified Rodrigues parameters, axis and angle
  roll pitch yaw                 about the fixed axes x, y, z in this order; all other angles need --angles
  wx | angvel.x | gyro_x …       rad/s, in the frame of --omega; Lx Ly Lz in its place: angular momentum
  x1 y1 z1 x2 …                  m, points of the body whose places the TOML file gives; XYZ files
  qpos, qvel                     of a free or a ball joint of MuJoCo
Units are converted if they are in brackets, at the end of a name (x_mm, wx_deg_s) or in a row below the names. In a text file
the names are in the last line above the numbers that has as many words as a row has numbers. Commas, semicolons, tabs, bars or
blanks separate them. Decimal commas, exponents with D, UTF-16, .gz, JSON (lines, rows or arrays), .npz, .npy, .parquet and .mat
are read. If a column may mean two things, the file is refused, or a note says what it is taken for. Both name the option that
decides. If your body has another axis of symmetry, or another axis of your world points up, add --axis z, --up y, or --up=-y. The
smallest turn leads from there to the frames of the case; if that is half a turn, it is about x.

Sums of steps are rounded: times near to decimals of nine digits (1e-10 of the last time) are taken for these if that makes errors
smaller. q and -q are the same rotation. If a file has quaternions and matrices, or positions and displacements, the larger error
counts. Angles beside these are not read without --angles. A NaN in a row makes the error NaN, and so does a matrix that is no
rotation. A row needs some 0.6 kB of memory, so ten million rows need 6 GB.

Without a start, --body compares the energy and all else that the motion conserves with the first row, and judges whether ω fits
the rotations (kinematics, of fourth order in the distance of the rows). With --bounds, a file also fails if a number in it is not
finite, or if it ends before the case does (--until).

examples:
  lagrange-bench judge run.csv --case bruels
  lagrange-bench judge coarse.csv fine.csv --case bruels                 with the observed orders
  lagrange-bench judge run.txt --case bruels --columns t=0,x=1,y=2,z=3   without a header
  lagrange-bench judge a.csv --case bruels --where body=top --units omega=deg/s --angles ZXZ
  lagrange-bench judge run.csv --body mine.toml                          any run of any length: drifts, and how they grow
  lagrange-bench judge run.csv --case mine.toml --start first-row        the motion starts as the file does
  lagrange-bench judge phone.csv --case mine.toml --start fit --from 0.3 --until 1     measured data
  lagrange-bench judge run.csv --case bruels --bounds position=1e-6,rotation=1e-5

exit codes: 0 done · 1 a bound is violated, or the run ends early · 2 a file that cannot be judged
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lagrange_bench.commands.arguments import location, number, pairs, seconds
from lagrange_bench.support import announce
from lagrange_bench.support.output import PICTURES, Answer, check_target, table
from lagrange_bench.support.words import suggestion

HIDDEN = 100  # an error of so many times the floor of its digits is not hidden by them


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("files", nargs="+", type=location, metavar="FILE", help="a table with a row for each time")
    text = "the body and its start: a name, see lagrange-bench case; a file mine.toml in the form of the named ones; "
    text += "or module:CASE, a Case of your own in ./module.py"
    subject = command.add_mutually_exclusive_group(required=True)
    subject.add_argument("--case", metavar="NAME", help=text)
    text = "a body without a start, a file or as --case: judges what the motion keeps, and whether ω fits the rotations"
    subject.add_argument("--body", metavar="NAME", help=text)
    text = "the motion of --case starts as the case says (default), as the first row does, or so that it fits the first rows best"
    command.add_argument("--start", default="case", choices=("case", "first-row", "fit"), help=text)
    form = command.add_argument_group("how the files are written")
    text = "which column is which quantity: a word of the header, or an index from 0"
    form.add_argument("--columns", type=pairs, default={}, metavar="t=0,x=3,…", help=text)
    text = "units that the file does not say, of t, position, angles, omega: s, ms, ns, mm, ft, deg, deg/s, rpm, …"
    form.add_argument("--units", type=pairs, default={}, metavar="omega=deg/s,t=ns", help=text)
    text = "axes of three angles, as SciPy names them: capitals move with the body (ZXZ), small letters do not (xyz)"
    form.add_argument("--angles", metavar="AXES", help=text)
    text = "only rows with this word in this column, named or by index; or only columns whose names begin with it"
    form.add_argument("--where", type=pairs, default={}, metavar="body=top", help=text)
    text = "time between two rows, such as 1/60; for files without times"
    form.add_argument("--step", type=seconds, metavar="SECONDS", help=text)
    form.add_argument("--t0", type=number, metavar="SECONDS", help="count times so that the first row is at this one")
    text = "only rows from this time on, in the times of the file"
    form.add_argument("--from", dest="since", type=number, metavar="SECONDS", help=text)
    text = (
        "only rows up to this time; exit with 1 if a file ends before it (default with --bounds: the end of the case)"
    )
    form.add_argument("--until", type=number, metavar="SECONDS", help=text)
    text = "order of the quaternions q0 … q3 or e0 … e3 (default: wxyz; of q1 … q4: xyzw); no effect where names have w, x, y, z"
    form.add_argument("--quat", choices=("wxyz", "xyzw"), help=text)
    text = "frame of the angular velocity (default: as its name says, else body; of an angular momentum world)"
    form.add_argument("--omega", choices=("body", "world"), help=text)
    axes = tuple(sign + name for name in "xyz" for sign in ("", "-"))
    form.add_argument("--up", choices=axes, help="axis of the world that points up (default: as in the case)")
    form.add_argument("--axis", choices=axes, help="axis of symmetry in the body (default: as in the case)")
    text = "the steps of the files, for the orders (default: the distances of their rows)"
    form.add_argument("--steps", type=_steps, metavar="h,h,…", help=text)
    results = command.add_argument_group("results")
    text = "exit with 1 if the largest error of a quantity is above its bound"
    results.add_argument("--bounds", type=_bounds, metavar="position=1e-6,…", default={}, help=text)
    text = f"draw the errors over time: a name that ends in {', '.join(PICTURES)}"
    results.add_argument("--draw", type=location, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench import judging
    from lagrange_bench.judging import frames, judgement

    bounds = options.bounds
    if options.steps and len(options.steps) != len(options.files):
        raise ValueError(f"--steps: {len(options.steps)} steps for {len(options.files)} files")
    check_target("--draw", options.draw, PICTURES)
    request = judging.request_of(options.case, options.body, options.start)
    body, known = options.case or options.body, request.start == "case"
    names = ("columns", "units", "angles", "where", "step", "t0", "quat", "since", "until", "up", "axis")
    written = frames.Options(**{name: getattr(options, name) for name in names}, omega_frame=options.omega)
    with announce.long_work(f"comparing with the motion of {body}"):
        judged = [judging.judge_file(path, request, written) for path in options.files]
    orders, words = judgement.orders(judged, options.steps or [each.step for each in judged])
    until = request.case.until if known else -math.inf
    until = until if options.until is None else options.until
    bounded = bool(bounds) or options.until is not None
    violated = [line for each in judged if bounded for line in _violated(each, bounds, until)]
    lines = [line for each in judged for line in [*_described(each, frames.UNITS), ""]]
    lines += words
    steps = {f"{each.step:.6g}" for each in judged}
    if not options.steps and 1 < len(steps) < len(judged):
        lines.append("No order where the rows of two files are equally far apart: give their steps, --steps h,h")
    lines += violated or (["All errors are within the bounds."] if bounds else [])
    drawn = [_draw(options.draw, judged)] if options.draw is not None else []
    data = {"case": body, "files": [{"file": each.file, **each.as_dict()} for each in judged], "orders": orders}
    data |= {"violated": violated} if bounded else {}
    return Answer("\n".join(lines).rstrip(), data, 1 if violated else 0, drawn)


def _steps(text: str) -> list[float]:
    return [seconds(word) for word in text.split(",")]


def _bounds(text: str) -> dict[str, float]:
    from lagrange_bench.judging.frames import UNITS

    words = pairs(text)
    if unknown := [name for name in words if name not in UNITS]:
        raise ValueError(f"unknown {unknown[0]!r}{suggestion(unknown[0], UNITS)} Known: {', '.join(UNITS)}")
    return {name: number(word) for name, word in words.items()}


def _violated(judged: Any, bounds: dict[str, float], until: float) -> list[str]:
    if missing := [name for name in bounds if name not in judged.errors]:
        raise ValueError(f"--bounds: {judged.file} has no columns to judge {missing[0]} by")
    off = {name: judged.errors[name].max for name in bounds if not judged.errors[name].max <= bounds[name]}
    lines = [f"{judged.file}: {name} is off by {error:.3g}: above {bounds[name]:g}" for name, error in off.items()]
    if bad := [name for name, error in judged.errors.items() if not math.isfinite(error.max) and name not in off]:
        lines.append(f"{judged.file}: {', '.join(bad).replace('_', ' ')} cannot be measured: a number is not finite")
    if judged.ends_before(until):
        lines.append(f"{judged.file}: the last row is at t = {judged.span[1]:.9g}, before {until:g} s")
    return lines


def _described(judged: Any, units: dict[str, str]) -> list[str]:
    rows: list[tuple[str, ...]] = [("error of", "largest", "end", "unit", "grows like")]
    for name, error in judged.errors.items():
        numbers = f"{error.max:.2e}", f"{error.end:.2e}"
        rows.append((name.replace("_", " "), *numbers, units[name], judged.grows(name)))
    first, last = judged.span
    lines = [f"{judged.file}: {judged.rows} rows, t = {first:.9g} to {last:.9g}", f"read as {judged.columns}"]
    lines += table(rows)
    lines += [_start(judged.start, units)] if judged.start else []
    floors = {name: floor for name, floor in judged.floor.items() if not judged.errors[name].max > HIDDEN * floor}
    if floors:
        below = ", ".join(f"{floor:.1e} {units[name]} ({name})" for name, floor in floors.items())
        lines.append(f"The digits in the file say nothing of errors below {below}.")
    return [*lines, *judged.notes, *judged.reasons(), *judged.summary()]


def _start(start: dict[str, Any], units: dict[str, str]) -> str:
    if start["right"] is None:
        return f"The first row is at t = {start['t']:.9g}: nothing can be said of the start."
    off = ", ".join(f"{name} {start[name]:.2e} {units[name]}" for name in start if name in units)
    if start["right"]:
        known = "" if "omega" in start else ", as far as the file says: it has no angular velocity"
        return f"The start is right{known}."
    known = "right to single precision" if start["single"] else "not that of the case"
    return f"The start is {known}. Its errors: {off}."


def _draw(path: Path, judged: Sequence[Any]) -> str:
    """Draw position and rotation error, or what else there is, over time, a line for each file; write the picture."""
    import numpy as np

    from lagrange_bench.experiments.drawing import figures, style
    from lagrange_bench.judging.frames import UNITS

    chosen = [name for name in ("position", "rotation") if name in judged[0].errors] or list(judged[0].errors)[:1]
    with style.apply():
        width = "page" if len(chosen) > 1 else "column"
        figure, axes = style.figure(width, ncols=len(chosen), squeeze=False)
        for panel, name in zip(axes[0], chosen, strict=True):
            for each in (each for each in judged if name in each.curves):
                t, error = each.curves[name]
                panel.plot(t, np.where(error > 0, error, np.nan), label=Path(each.file or each.case).stem)
            panel.set(yscale="log", xlabel="t (s)", ylabel=f"error of {name} ({UNITS[name]})")
        axes[0][0].legend()
    return figures.write(path, figure)
