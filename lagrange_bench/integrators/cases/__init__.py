"""Named motions of rigid bodies with their exact solution, for comparison with any program that follows a rigid body.

Each case is a TOML file with decimals, because the digits are part of the case. A case of your own is such a file, too.
`Case.solution` gives doubles, from the truth by which all methods are judged: for a free or symmetric body a closed form, which
takes some microseconds a time, otherwise a reference solution. `Case.digits` gives up to 40 digits from Taylor series in
integers, an independent computation.
"""

from __future__ import annotations

import math
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from fractions import Fraction
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import check_count, check_times
from lagrange_bench.integrators.interface import StepError, Work
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.rotation import as_rotation
from lagrange_bench.integrators.trajectory import Trajectory
from lagrange_bench.integrators.truth import rotations, truths
from lagrange_bench.integrators.truth.rigid_body import about_fixed_point, rigid_motion
from lagrange_bench.support.files import read_toml
from lagrange_bench.support.words import suggestion

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MOST_DIGITS = 40  # of `Case.digits`
COLUMNS = "t,x,y,z,qw,qx,qy,qz,r11,r12,r13,r21,r22,r23,r31,r32,r33,wx,wy,wz"
CONVENTIONS = """\
t: s. x y z: centre of mass in the world, m, from the fixed point. qw qx qy qz: unit quaternion, scalar first, qw >= 0.
r11 ... r33: rotation matrix, row by row. Both take vectors of the body to the world.
wx wy wz: angular velocity in the body, rad/s."""


@dataclass(frozen=True, eq=False)
class Case:
    """The motion of a rigid body from a given start.

    Parameters
    ----------
    name : str
        Its name in tables.
    body : RigidBody
        The body that moves.
    rotation : Rotation, (3, 3) or (4,)
        At t = 0, from body to world; a quaternion has its scalar first.
    omega_body : (3,)
        In rad/s, at t = 0.
    position, velocity : (3,)
        Of the centre of mass of a flying body at t = 0, in m and m/s.
    until, every : float
        In s, the length of the motion, and the time between rows of a reference.
    title, source, remarks : str
        A title, the source of the numbers, and what to know.
    points : (K, 3)
        Places in the body, in m, whose positions a file may have in place of rotations.
    exact : dict
        The numbers of a case from a file, as decimals.
    """

    name: str
    body: RigidBody
    rotation: Rotation | ArrayLike
    omega_body: ArrayLike
    position: ArrayLike | None = None
    velocity: ArrayLike | None = None
    until: float = 1.0
    every: float = 0.1
    title: str = ""
    source: str = ""
    remarks: str = ""
    points: ArrayLike | None = None
    exact: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def state(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The state (7,) or (13,) that `integrate(case.body, case.state, …)` takes."""
        flight = {} if self.body.fixed else {"position": self.position, "velocity": self.velocity}
        return self.body.state(rotation=self.rotation, omega_body=self.omega_body, **flight)

    def solution(self, t: ArrayLike) -> Trajectory:
        """The exact motion at times t (N,), s, in any order: `.position` (N, 3), `.rotation`, `.omega_body` (N, 3), `.energy`.

        Numbers are doubles, and right to round-off at any time. A body that is neither free nor symmetric has a reference
        solution only: states are NaN from where a chaotic motion is lost, and 1000 turns take some seconds.
        """
        times, (state, flight) = check_times(t), self.body.split_state(self.state)
        try:
            y = truths.solution(self.body, state, times, longest=math.inf)
        except ValueError as error:  # a time beyond doubles
            raise StepError(truths.name(self.body), str(error)) from None
        y = y if flight is None else np.hstack((y, self.body.flight_at(flight, times)))
        return Trajectory(self.body, truths.name(self.body), times, y, Work())

    def digits(self, times: Sequence[Any], digits: int = 25) -> Iterator[list[Decimal]]:
        """Rows of COLUMNS at `times` (ascending from 0: decimal strings, Fractions, doubles), each number to `digits` digits.

        `truth.rigid_body` computes them in integers. A double in a case is taken as exact. ValueError : over 40 digits.
        """
        digits = check_count(digits, "digits", least=1)
        if digits > MOST_DIGITS:
            raise ValueError(f"digits must be at most {MOST_DIGITS}; got {digits}")
        facts = dict(self.exact) or self._facts()
        place, speed = ([Fraction(v) for v in facts.pop(word, (0, 0, 0))] for word in ("position", "velocity"))
        com, start = [Fraction(v) for v in facts["com"]], matrix(facts.pop("quaternion"))
        gravity = [Fraction(v) for v in facts["gravity"]]
        if not self.body.fixed:
            facts |= {"com": (0, 0, 0), "gravity": (0, 0, 0)}
        motion = rigid_motion(**facts, rotation=start, times=times, digits=digits + 5)
        for t, (R, omega) in zip(times, motion, strict=True):
            if self.body.fixed:
                position = [sum((a * b for a, b in zip(row, com, strict=True)), Fraction(0)) for row in R]
            else:
                s = Fraction(t)
                position = [x + s * (v + s * g / 2) for x, v, g in zip(place, speed, gravity, strict=True)]
            numbers = [Fraction(t), *position, *quaternion(R), *(v for row in R for v in row), *omega]
            yield [rounded(v, digits) for v in numbers]

    def _facts(self) -> dict[str, Any]:
        """The numbers of a case that comes from no file: the doubles themselves."""
        facts = {name: getattr(self.body, name) for name in ("mass", "com", "inertia_com", "gravity")}
        start = as_rotation(self.rotation).as_quat(scalar_first=True)
        flight = {"position": self.position, "velocity": self.velocity}
        flight = {} if self.body.fixed else {name: (0, 0, 0) if v is None else v for name, v in flight.items()}
        return {**facts, "quaternion": start, "omega_body": self.omega_body, **flight}

    def doubles(self, times: ArrayLike) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Rows of COLUMNS as doubles, (N, 20), from `solution`."""
        run = self.solution(times)
        q = run.rotation.as_quat(canonical=True, scalar_first=True)
        return np.column_stack((run.t, run.position, q, run.rotation.as_matrix().reshape(-1, 9), run.omega_body))


def matrix(q: Sequence[Any]) -> list[list[Fraction]]:
    """The rotation matrix of a quaternion of any length, scalar first, without rounding."""
    return rotations.matrix([Fraction(v) for v in q])


def quaternion(R: list[list[Fraction]]) -> list[Fraction]:
    """The unit quaternion of a matrix, scalar first and ≥ 0."""
    q = rotations.quaternion(R, root)
    return [-v for v in q] if q[0] < 0 else q


def root(v: Fraction) -> Fraction:
    with localcontext(prec=MOST_DIGITS + 20):
        return Fraction(decimal(v).sqrt())


def decimal(v: Fraction) -> Decimal:
    return Decimal(v.numerator) / v.denominator


def rounded(v: Fraction, digits: int) -> Decimal:
    """v to `digits` significant digits; below 1 to `digits` decimals."""
    with localcontext(prec=digits + 20):
        number = decimal(v)
        places = digits - max(0, number.adjusted() + 1)
        return (round(number, places) + 0).normalize()


NUMBERS: dict[str, list[tuple[int, ...]]] = {  # of a file: name → shapes; numbers with a default may be left out
    "mass": [()],
    "com": [(3,)],
    "inertia_com": [(3,), (3, 3)],
    "inertia": [(3,), (3, 3)],  # about the fixed point, in place of inertia_com
    "gravity": [(3,)],
    "quaternion": [(4,)],
    "angles": [(3,)],  # rad, about `axes`, in place of the quaternion
    "omega_body": [(3,)],
    "position": [(3,)],
    "velocity": [(3,)],
    "until": [()],
    "every": [()],
}
POSITIVE = ("mass", "until", "every")
DEFAULTS: dict[str, Any] = {"com": ["0", "0", "0"], "gravity": ["0", "0", "-9.81"], "quaternion": ["1", "0", "0", "0"]}
DEFAULTS |= {"until": "1", "every": "0.1"}
STILL = {"omega_body": ["0", "0", "0"]}  # for a body without a start
TEXTS = ("title", "source", "remarks")
OTHERS = ("fixed", "axes", "points")


def read_case(path: Path, start: bool = True) -> Case:
    """The case in a TOML file, in the form of the named ones. Numbers may be decimals in quotes, whose digits count.

    start : whether it must have a start; otherwise a body is enough.

    Raises
    ------
    ValueError
        The file has a mistake; the message says which.
    OSError
        The file cannot be read.
    """
    return _case(path.stem, {**({} if start else STILL), **read_toml(path)}, str(path))


def _case(name: str, content: Mapping[str, Any], where: str) -> Case:
    if unknown := sorted(set(content) - {*NUMBERS, *TEXTS, *OTHERS}):
        raise ValueError(f"{where}: {unknown[0]} is not known; a case has {', '.join((*NUMBERS, *OTHERS, *TEXTS))}")
    words = {word: " ".join(str(content.get(word, "")).split()) for word in TEXTS}
    numbers = {word: value for word, value in content.items() if word in NUMBERS}
    for word, value in numbers.items():
        _check_numbers(word, value, where)
    for one, other in (("inertia", "inertia_com"), ("angles", "quaternion")):
        if one in numbers and other in numbers:
            raise ValueError(f"{where}: give {one} or {other}, not both")
    facts: dict[str, Any] = {**DEFAULTS, **numbers}
    fixed = content.get("fixed", True)
    if "inertia" in facts and "mass" in facts:
        lever = [Fraction(v) for v in (facts["com"] if fixed else (0, 0, 0))]
        facts["inertia_com"] = about_fixed_point(-Fraction(facts["mass"]), lever, facts.pop("inertia"))
    if missing := [word for word in ("mass", "inertia_com", "omega_body") if word not in facts]:
        raise ValueError(f"{where}: {missing[0]} is missing")
    if "angles" in facts:
        facts["quaternion"] = _of_angles(facts.pop("angles"), content.get("axes"), where)
    values = {word: np.array(value, dtype=float) for word, value in facts.items()}
    if not np.any(values["quaternion"]):
        raise ValueError(f"{where}: quaternion must not be zero")
    until, every = float(values["until"]), float(values["every"])
    exact = {word: value for word, value in facts.items() if word not in ("until", "every")}
    rotation = [[float(v) for v in row] for row in matrix(facts["quaternion"])]
    try:
        body = RigidBody(float(values["mass"]), values["com"], values["inertia_com"], values["gravity"], fixed)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    place, speed = values.get("position"), values.get("velocity")
    if fixed and (place is not None or speed is not None):
        raise ValueError(f"{where}: position and velocity belong to a body that flies: fixed = false")
    points = None if "points" not in content else np.array(content["points"], dtype=float)
    if points is not None and (points.ndim != 2 or points.shape[1] != 3 or len(points) < 3):
        raise ValueError(f"{where}: points must be three or more places in the body; got {content['points']!r}")
    start = rotation, values["omega_body"], place, speed
    return Case(name, body, *start, until, every, **words, points=points, exact=exact)


def _check_numbers(word: str, value: Any, where: str) -> None:
    """ValueError unless a value of a file has finite numbers, as many as its word asks for."""
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    has_bool = any(isinstance(each, bool) for each in np.array(value, dtype=object).flat)
    if numbers.shape not in NUMBERS[word] or not np.all(np.isfinite(numbers)) or has_bool:
        raise ValueError(f"{where}: {word} must be {'a number' if NUMBERS[word] == [()] else 'numbers'}; got {value!r}")
    if word in POSITIVE and not numbers > 0:
        raise ValueError(f"{where}: {word} must be positive; got {value!r}")


def _of_angles(angles: Sequence[Any], axes: Any, where: str) -> list[float]:
    """The quaternion of three angles, rad, about axes as SciPy names them."""
    from scipy.spatial.transform import Rotation

    try:
        turn = Rotation.from_euler(str(axes), [float(v) for v in angles])
    except ValueError:
        raise ValueError(
            f'{where}: angles need their axes, such as axes = "ZXZ", that move, or "xyz"; got {axes!r}'
        ) from None
    return [float(v) for v in turn.as_quat(scalar_first=True)]


TOPS = ("bruels", "slow", "simo_wong", "metis", "kovalevskaya")
FREE = ("box", "t_body", "brick", "toutatis", "middle_axis", "flying_box")


class Cases(Mapping[str, Case]):
    """The named cases. Each is made at its first use, which takes some milliseconds."""

    def __init__(self, names: tuple[str, ...]):
        self._cases: dict[str, Case | None] = dict.fromkeys(names)

    def __repr__(self) -> str:
        return f"Cases({', '.join(self)})"

    def __getitem__(self, name: str) -> Case:
        if name not in self._cases:
            raise KeyError(f"unknown case {name!r}{suggestion(str(name), self)} Known: {', '.join(self)}")
        if (case := self._cases[name]) is None:
            text = files("lagrange_bench.integrators.cases").joinpath(f"{name}.toml").read_text("utf-8")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # about moments that no body has: the remarks say so
                case = self._cases[name] = _case(name, tomllib.loads(text), name)
        return case

    def __iter__(self) -> Iterator[str]:
        return iter(self._cases)

    def __len__(self) -> int:
        return len(self._cases)


CASES: Mapping[str, Case] = Cases((*TOPS, *FREE))
