"""What may be wrong with the rows of a trajectory: another convention, unit or time, or another body.

A hint is a convention under which the rows are much nearer to the exact motion, or agree much better with themselves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from functools import cache
from math import tau
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import CASES
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.judging.consistency import Rows, into_body
from lagrange_bench.judging.frames import AXES, GROUPS, Array, Convention, Exact, Frames

# units that numbers may have: what to say to --units, and the factor that leads to SI units
LENGTHS = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254, "feet": 0.3048}
SPEEDS = {"degrees per second": ("deg/s", tau / 360), "revolutions per minute": ("rpm", tau / 60)}
SPEEDS |= {"revolutions per second": ("rev/s", tau)}
CLOCKS = {"milliseconds": ("ms", 1e-3), "microseconds": ("us", 1e-6), "nanoseconds": ("ns", 1e-9)}
CLOCKS |= {"minutes": ("min", 60.0)}
# hint → the factor that leads to SI units
OMEGA_UNITS = {f"omega is in {name}: --units omega={unit}.": factor for name, (unit, factor) in SPEEDS.items()}
TIME_UNITS = {f"the times are in {name}: --units t={unit}.": factor for name, (unit, factor) in CLOCKS.items()}
LATE = {
    "second": "ω is half a step late: it is what turned the row before into its own, as in leapfrog and semi-implicit Euler.",
    "first": "ω is half a step early: it is what turns its row into the next, as in leapfrog.",
}
WITHOUT = "the program leaves out the gyroscopic torque ω × I ω: an option of many engines."
Reading = TypeVar("Reading")  # a hint, or what it changes
HEAD = 2000  # the most rows that hints are taken from
SHIFTS, SHIFTED = (1, -1, 2, -2, 3, -3), 10  # times may be late by so many rows; more than SHIFTED rows show it
BETTER = 10  # a hint makes errors so many times smaller than the rows as they are, and than any other hint
# if the whole run gives no hint, so many of its first rows are tried: a poor run is right only there
PREFIXES = (3, 5, 9, 17, 33, 65)
ENOUGH = 5  # fewer rows do not show another body
RIGHT = 0.05  # relative to the size of a quantity: a unit is named only if it brings the error below this
TURN = 0.1  # rad: a smaller turn of all rows is an error, not other axes
START = 1e-9  # relative to the size of a quantity: more than that is another start
SINGLE = 2e-7  # likewise, of a start in single precision


class Hints:
    """What may be wrong with rows: conventions under which they are much nearer to the exact motion.

    exact : the motion at the times of the rows. good : the rows without NaN. Some of them, from all over the run, are looked at.
    way : the option that takes quaternions in another order, if --quat does not.
    """

    def __init__(self, frames: Frames, trajectory: Mapping[str, Array], exact: Exact, good: Array, way: str = ""):
        self.frames, self.sizes, self.way = frames, frames.sizes, way
        self.first = _rows(trajectory, slice(1)) if len(good) and good[0] == 0 else {}
        self.head = _rows(trajectory, good[:HEAD]), _at(exact, good[:HEAD])
        some = good[np.linspace(0, len(good) - 1, min(HEAD, len(good))).astype(int)]
        self.trajectory, self.exact = _rows(trajectory, some), _at(exact, some)
        self.t = self.trajectory["time"][:, 0]
        self.now = {name: error.max(initial=0.0) for name, error in frames.errors(self.trajectory, self.exact).items()}

    def written(self) -> list[str]:
        """Hints at frames, orders, units and times, else at late ω and other bodies; none is tried where nothing is wrong."""
        hints = list(self._conventions()) or list(self._axes()) or list(self._mirrored())
        for each in (self._speeds, self._times, self._starts):
            hints += each()
        return hints or [*self._late(), *self.bodies()]

    def turned(self) -> list[str]:
        """Hints at positions of the fixed point, and at other axes."""
        return [*self._fixed_point(), *self._turns()]

    def _fixed_point(self) -> Iterator[str]:
        if "position" not in self.trajectory or not self.frames.length:
            return
        if np.linalg.norm(self.trajectory["position"], axis=1).max() < RIGHT * self.sizes["position"]:
            yield "the positions are those of the fixed point, not of the centre of mass."

    def _wrong(self, quantity: str) -> bool:
        return bool(self.now.get(quantity, 0.0) > START)

    def _limit(self, quantity: str) -> float:
        """Below it an error is much smaller than the error of the rows as they are."""
        return float(self.now[quantity] / BETTER)

    def _bound(self, quantity: str) -> float:
        """Below it an error is within `_limit`, and small beside the size of the quantity."""
        return min(self._limit(quantity), RIGHT * self.sizes[quantity])

    def _best(self, quantity: str, errors: Mapping[str, float]) -> list[str]:
        """The hint that makes rows right, if it does so clearly better than all others."""
        hint = _clearest(errors)
        return [hint] if hint is not None and errors[hint] < self._bound(quantity) else []

    def _scaled(self, group: str, factor: float) -> dict[str, Array]:
        return {**self.trajectory, group: factor * self.trajectory[group]}

    def _error(self, quantity: str, rows: Any = None, exact: Exact | None = None, **changes: Any) -> float:
        """The largest error of some `rows`, at other times (`exact`) or in another convention."""
        frames, rows = self.frames.changed(**changes) if changes else self.frames, rows or self.trajectory
        rows = {name: rows[name] for name in ("time", *GROUPS[quantity]) if name in rows}
        return float(frames.errors(rows, exact or self.exact)[quantity].max(initial=0.0))

    def _conventions(self) -> Iterator[str]:
        how = self.frames.convention
        quat, frame = _others(how)
        words = _words(how, self.way)
        errors: dict[str, dict[str, float]] = {}
        axes = how.angles.swapcase()
        moving = f"the angles are about axes that {'move' if axes.isupper() else 'do not move'} with the body: --angles {axes}"
        degrees = "--units angle=deg."
        for quantity, group, changes, text in (
            ("rotation", "", {"transposed": True}, words["transposed"]),
            ("rotation", "quaternion", {"quat": quat}, words["quat"]),
            ("rotation", "quaternion", {"quat": quat, "transposed": True}, words["both"]),
            ("rotation", "angles", {"degrees": True}, f"the angles are in degrees: {degrees}"),
            ("rotation", "angles", {"angles": axes}, f"{moving}."),
            ("rotation", "angles", {"degrees": True, "angles": axes}, f"{moving}; and in degrees: {degrees}"),
            ("rotation", "rotation vector", {"degrees": True}, f"the rotation vectors are in degrees: {degrees}"),
            ("omega", "", {"omega_frame": frame}, words["frame"]),
            ("position", "", {"displaced": True}, "the position is a displacement from the start: name it ux, uy, uz."),
        ):
            if self._wrong(quantity) and (not group or group in self.trajectory):
                errors.setdefault(quantity, {})[text] = self._error(quantity, **changes)
        for quantity, tried in errors.items():
            hint = _clearest(tried)
            if hint is not None and tried[hint] < self._limit(quantity):
                yield hint
        if "rotation vector" in self.trajectory and self._wrong("rotation"):
            rows = {**self.trajectory, "angles": self.trajectory["rotation vector"]}
            del rows["rotation vector"]
            for in_degrees, axes in itertools.product((True, False), ("XYZ", "xyz")):
                if self._error("rotation", rows=rows, degrees=in_degrees, angles=axes) < self._limit("rotation"):
                    kind, unit = "moving" if axes == "XYZ" else "fixed", "degrees" if in_degrees else "rad"
                    angles = f"angles about {kind} axes x, y, z in {unit}"
                    way = f"--columns angle1=…,angle2=…,angle3=… --angles {axes}{' --units angle=deg' * in_degrees}"
                    yield f"rx, ry, rz are no rotation vector, but {angles}: {way}."

    def _axes(self) -> Iterator[str]:
        """Another unit of positions, another axis upwards, another axis of symmetry."""
        how, up = self.frames.convention, None
        group = next((name for name in GROUPS["position"] if name in self.trajectory), "")
        if group and self._wrong("position"):
            tried = {
                (other, what): self._error("position", self._scaled(group, factor), up=other)
                for other, (what, factor) in itertools.product((how.up, *AXES), {"": 1.0, **LENGTHS}.items())
            }
            vertical, what = min(tried, key=tried.__getitem__)
            # a small enough factor makes positions right that should be zero; half a mirror is no axis
            still = self._error("position", self._scaled(group, 0.0)) / BETTER if what else math.inf
            if tried[vertical, what] < min(self._bound("position"), still):
                up = vertical
                if what:
                    yield f"{group} is in {what}: --units {group}={what}."
        axis = None
        if self._wrong("rotation"):
            ups = [up or how.up] if group else [how.up, *AXES]
            axes = [None] if self.frames.axis is None else [how.axis, *AXES]
            turned = {pair: self._error("rotation", up=pair[0], axis=pair[1]) for pair in itertools.product(ups, axes)}
            best = min(turned, key=turned.__getitem__)
            if turned[best] < self._limit("rotation"):
                up, axis = best
        if up not in (None, how.up):
            yield f"the axis {up} points up: --up={up}."
        if axis not in (None, how.axis):
            yield f"the axis of symmetry is {axis}: --axis={axis}."

    def _mirrored(self) -> Iterator[str]:
        """A world and a body with other axes, perhaps of the other hand: rotations are the same with all axes reversed."""
        known = [name for name in ("rotation", "position") if name in self.now]
        wrong = list(filter(self._wrong, known))
        if not wrong:
            return
        signs_and_letters = itertools.product(itertools.product(("", "-"), repeat=3), itertools.permutations("xyz"))
        triples = [tuple(map("".join, zip(*each, strict=True))) for each in signs_and_letters]
        left_handed = {triple: bool(np.linalg.det([AXES[name] for name in triple]) < 0) for triple in triples}
        errors = {
            (triple, up): max(self._error(name, mirror=triple, up=up) / self.sizes[name] for name in known)
            for triple, up in itertools.product(triples, {self.frames.convention.up, None})
            if left_handed[triple] or "position" in wrong
        }
        best = _clearest(errors)
        if best is not None and all(errors[best] * self.sizes[name] < self._bound(name) for name in wrong):
            triple, up = best
            axes, sign = f"({', '.join(triple)})", "−" * left_handed[triple]
            vector = f"the vector part of quaternions, rotation vectors and ω {sign}{axes}"
            others = "the world is left-handed" if left_handed[triple] else "the axes have other names"
            without = ", without --up" * (up != self.frames.convention.up)
            yield f"{others}: write {axes} for positions (x, y, z), and for {vector}{without}."

    def _speeds(self) -> Iterator[str]:
        """Another unit of angular velocities, perhaps in the other frame, too."""
        if self._wrong("omega"):
            now, other = self.frames.convention.omega_frame, _others(self.frames.convention)[1]
            factors = {**OMEGA_UNITS, "omega is of the other sign.": -1.0}
            scaled = {
                (hint, frame): self._error("omega", self._scaled("omega", factor), omega_frame=frame)
                for (hint, factor), frame in itertools.product(factors.items(), (now, other))
            }
            best = min(scaled, key=scaled.__getitem__)
            if scaled[best] < self._bound("omega"):
                hint, frame = best
                yield hint + f" It is in the {other} frame, too: --omega {other}." * (frame == other)

    def _times(self) -> Iterator[str]:
        quantity = next((name for name in ("rotation", "position") if name in self.now), "omega")
        if not self._wrong(quantity):
            return

        def error_at(t: Array) -> float:
            return self._error(quantity, exact=self.frames.exact(t))

        still = error_at(0 * self.t) / BETTER
        least = min(self._bound(quantity), still)
        scaled = {hint: error_at(factor * self.t) for hint, factor in TIME_UNITS.items()}
        yield from (hint for hint in self._best(quantity, scaled) if scaled[hint] < still)
        (trajectory, exact), late = self.head, {0: math.inf}
        n = len(exact[0])
        for k in SHIFTS if n > SHIFTED else ():
            ours, theirs = slice(max(0, -k), n - max(0, k)), slice(max(0, k), n + min(0, k))
            on_time, late[k] = (self._error(quantity, _rows(trajectory, ours), _at(exact, at)) for at in (ours, theirs))
            late[k] = late[k] if late[k] < min(on_time / BETTER, RIGHT * self.sizes[quantity]) else math.inf
        if k := min(late, key=lambda k: late[k]):
            way = "later" if k > 0 else "earlier"
            yield f"the times are shifted: each row holds the state {abs(k)} row{'s' * (abs(k) > 1)} {way}."
        elif self.first and self.t[0] and error_at(self.t - self.t[0]) < least:
            yield f"the first row is the start of the case: --t0 0, or subtract {self.t[0]:.9g} s from the times."

    def _late(self) -> Iterator[str]:
        """ω in the middle of a step, with rotations at its ends."""
        t = self.head[0]["time"][:, 0]
        if self._wrong("omega") and len(t) >= ENOUGH:
            step, later = float(np.median(np.diff(t))), _rows(self.trajectory, slice(1, None))
            shifted = {LATE["second"]: self.t[1:] - step / 2, LATE["first"]: self.t[1:] + step / 2}
            errors = {hint: self._error("omega", later, self.frames.exact(times)) for hint, times in shifted.items()}
            yield from self._best("omega", errors)

    def bodies(self) -> list[str]:
        """Another body: gravity the other way, moments about another point, no gyroscopic torque."""
        quantity = next((name for name in ("rotation", "position", "omega") if self._wrong(name)), None)
        if quantity is None or len(self.t) < ENOUGH:
            return []
        errors = {words: self._error(quantity, exact=each.exact(self.t)) for words, each in self.frames.others.items()}
        if kinds.free_body(self.frames.rigid_body):
            _, R, omega = self.frames.exact([0.0])
            turned = R[0] @ Rotation.from_rotvec(self.t[:, None] * omega).as_matrix()
            steady = self.exact[0], turned, np.repeat(omega, len(turned), axis=0)
            errors[WITHOUT] = self._error(quantity, exact=steady)
        return self._best(quantity, errors)

    def _starts(self) -> Iterator[str]:
        """The start of another case."""
        if self.first and self.t[0] == 0 and not self._starts_as(self.frames):
            how = self.frames.convention
            for name, case in CASES.items():
                comparable = how.axis is None or case.body.axis is not None
                if comparable and self._starts_as(_frames_of(name, how)):
                    yield f"this is the start of the case {name}."

    def first_row(self) -> list[str]:
        """The one convention in which the first row is the start of the case, if it is not so as it stands."""

        def right(changes: dict[str, Any]) -> bool:
            return self._starts_as(self.frames.changed(**changes), _at(self.exact, slice(1)))

        if not self.first or self.t[0] or right({}):
            return []
        words, names = _words(self.frames.convention, self.way), list(AXES)
        ups = {f"the axis {up} points up: --up={up}.": {"up": up} for up in names}
        axes = {f"the axis of symmetry is {axis}: --axis={axis}.": {"axis": axis} for axis in names}
        axes = {} if self.frames.axis is None else axes
        order = {words["quat"]: {"quat": _others(self.frames.convention)[0]}} if "quaternion" in self.trajectory else {}
        single: dict[str, dict[str, Any]] = {**order, words["transposed"]: {"transposed": True}, **ups, **axes}
        fits = [[text] for text, changes in single.items() if right(changes)]
        fits = fits or [[up, axis] for up, axis in itertools.product(ups, axes) if right({**ups[up], **axes[axis]})]
        return fits[0] if len(fits) == 1 else []

    def _starts_as(self, frames: Frames, exact: Exact | None = None) -> bool:
        errors = frames.errors(self.first, exact or frames.exact(self.t[:1]))
        return frames.starts({name: float(errors[name][0]) for name in self.sizes if name in errors}, SINGLE)

    def points(self) -> Iterator[str]:
        """Another origin, or another point of the body, if it is clear which of them; by the rotations of the rows themselves."""
        if "position" not in self.trajectory or not self._wrong("position"):
            return
        attitudes, body = self.frames.matrices(self.trajectory), self.frames.rigid_body
        R = self.exact[1] if attitudes is None else attitudes
        x = R @ body.com if body.fixed else self.exact[0]
        positions = self.trajectory["position"] @ self.frames.to_world.T
        in_body = into_body(R, positions - (0.0 if body.fixed else x))
        off, fits = np.linalg.norm(positions - x, axis=1).max(), []
        of_body = "are those of the point {} of the body, not of the centre of mass."
        for points, back, words in (
            (positions - x, self.frames.to_world.T, "are off by {}: another origin."),
            (in_body, self.frames.from_body, of_body),
        ):
            mean = points.mean(0)
            scatter = float(np.abs(points - mean).max())
            if scatter < self._bound("position") and off > max(BETTER * scatter, START * self.sizes["position"]):
                digits = max(0, -math.floor(math.log10(scatter))) if scatter > 0 else 9
                fits.append(f"the positions {words.format(_vector((back @ mean).round(min(digits, 9)), 'm'))}")
        yield from fits if len(fits) == 1 else []

    def _turns(self) -> Iterator[str]:
        """One turn that leads from all rotations to the right ones, if it is clear whether of the world or of the body."""
        R, right, fits = self.frames.matrices(self.trajectory), self.exact[1], []
        if R is None or not self._wrong("rotation"):
            return
        for turns, back, where in (
            (right @ R.transpose(0, 2, 1), self.frames.to_world.T, "world"),
            (R.transpose(0, 2, 1) @ right, self.frames.from_body, "body"),
        ):
            if np.linalg.det(turns).min() > 0.5:
                each = Rotation.from_matrix(turns)
                mean = each.mean()
                if mean.magnitude() > TURN and (each * mean.inv()).magnitude().max() < self._bound("rotation"):
                    vector = _vector(back @ mean.as_rotvec(), "rad")
                    turn = f"turn the {where} of the rows by the rotation vector {vector}"
                    fits.append(f"the axes of the {where} are others: {turn}.")
        yield from fits if len(fits) == 1 else []


@cache
def _frames_of(name: str, convention: Convention) -> Frames:
    """The frames of a named case."""
    return Frames(CASES[name].body, convention, case=CASES[name])


def find_hints(
    frames: Frames, trajectory: Mapping[str, Array], exact: Exact, good: Array, rows: Rows | None, way: str = ""
) -> list[str]:
    """Hints of the whole run; else of its first rows. `rows` themselves tell the frame of ω, and missing torques."""
    whole = Hints(frames, trajectory, exact, good, way)
    hints = whole.written() or whole.turned()
    if not hints and len(good) and good[0] == 0:
        # one step of Euler's changes ω as much in either frame: there only places and attitudes tell
        still = {name: array for name, array in trajectory.items() if name != "omega"}
        shown = [(still, 2), *((trajectory, n) for n in PREFIXES)]
        prefixes = (Hints(frames, run, exact, good[:n], way) for run, n in shown if n < len(good))
        hints = next(filter(None, (each.written() for each in prefixes)), [])
    hints = hints or whole.first_row()
    if not hints:
        own = own_hints(frames, trajectory, rows, way)
        hints = [hint for hint in own if hint not in (*LATE.values(), WITHOUT)] or list(whole.points())
    correction = next((changes for text, changes in _attitudes(frames, trajectory, way).items() if text in hints), {})
    if correction:  # misread rotations agree with a misread ω
        rows = frames.changed(**correction).rows(_rows(trajectory, slice(HEAD)))
    if rows is not None:
        if rows.other_frame() and not any("--omega" in hint for hint in hints):
            hints.append(_words(frames.convention)["frame"])
        elif rows.without_gyroscopic_torque(frames.rigid_body) and WITHOUT not in hints:
            hints.append(WITHOUT)
    return hints


def own_hints(frames: Frames, trajectory: Mapping[str, Array], rows: Rows | None, way: str = "") -> list[str]:
    """The convention in which the rows agree with themselves, q' = q ω/2, if that is clearly another one."""
    if rows is None or rows.omega is None:
        return []
    factors, ratio = {**OMEGA_UNITS, **TIME_UNITS}, rows.speed_ratio()
    if scaled := [hint for hint, factor in factors.items() if abs(ratio / factor - 1) < RIGHT]:
        return scaled
    how, words, some = frames.convention, _words(frames.convention, way), _rows(trajectory, slice(HEAD))
    frame = _others(how)[1]
    off: dict[tuple[str, str, str], float] = {}
    attitudes, spins = {"": {}, **_attitudes(frames, trajectory, way)}, (("", how.omega_frame), (words["frame"], frame))
    for (text, changes), (also, other) in itertools.product(attitudes.items(), spins):
        tried = frames.changed(**changes, omega_frame=other).rows(some)
        assert tried is not None
        off |= {(text, also, LATE.get(part, "")): tried.off(part=part) for part in ("mean", *LATE)}
    hints, left = [], dict(off)
    for place in range(3):  # the attitude, then the frame, then the time of ω
        best = min(left, key=left.__getitem__)[place]
        if all(min(left.values()) * BETTER < error for key, error in left.items() if key[place] != best):
            hints += [best] * bool(best)
        left = {key: error for key, error in left.items() if key[place] == best}
    return hints or [WITHOUT] * rows.without_gyroscopic_torque(frames.rigid_body)


def _attitudes(frames: Frames, trajectory: Mapping[str, Array], way: str = "") -> dict[str, dict[str, Any]]:
    """Other ways to read the rotations: the hint, and what it changes."""
    quat, words = _others(frames.convention)[0], _words(frames.convention, way)
    ways: dict[str, dict[str, Any]] = {words["transposed"]: {"transposed": True}}
    if "quaternion" in trajectory:
        ways |= {words["quat"]: {"quat": quat}, words["both"]: {"quat": quat, "transposed": True}}
    return ways


def _clearest(errors: Mapping[Reading, float]) -> Reading | None:
    """The way to read the rows whose error is clearly smaller than any other."""
    least, *others = sorted(errors.values()) or [math.nan]
    return min(errors, key=errors.__getitem__) if all(least * BETTER < error for error in others) and errors else None


def _others(how: Convention) -> tuple[str, str]:
    """The other order of quaternions, the other frame of ω."""
    return "xyzw" if how.quat == "wxyz" else "wxyz", "world" if how.omega_frame == "body" else "body"


def _words(how: Convention, way: str = "") -> dict[str, str]:
    """The hints at other conventions; `way` is the option that takes quaternions in another order, if --quat does not."""
    quat, frame = _others(how)
    return {
        "transposed": "the rotations are transposed: they take the world to the body. Write R transposed, or the conjugate.",
        "quat": f"the quaternions are in the order {quat}: {way or f'--quat {quat}, or other names'}.",
        "both": f"the order is {quat}, and they are conjugate.",
        "frame": f"ω is in the {frame} frame: --omega {frame}, from Python omega_frame.",
    }


def _rows(trajectory: Mapping[str, Array], at: Any) -> dict[str, Array]:
    return {name: array[at] for name, array in trajectory.items()}


def _at(exact: Exact, at: Any) -> Exact:
    x, R, omega = exact
    return x[at], R[at], omega[at]


def _vector(numbers: Array, unit: str) -> str:
    return f"({', '.join(f'{number + 0.0:.4g}' for number in numbers.round(9))}) {unit}"
