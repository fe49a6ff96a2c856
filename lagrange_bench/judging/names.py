"""What the names of columns mean, whatever program wrote them: one table of words, and the parts of a name.

A name is split into words, and each is looked up; so are two or three words that stand together. The longest that is known tells
the quantity, of two as long the first. docs/names.md prints the table.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import tau
from typing import NamedTuple

# quantity → its words; (ang angular) (vel velocity) stands for ang vel, ang velocity, angular vel, angular velocity
QUANTITIES = {
    "time": "t, ts, tout, time, timestamp, timestamps, stamp, simtime, seconds, elapsed",
    "position": """p, t, pos, position, positions, trans, translate, translation, translations, location, coord, coords,
        coordinate, coordinates, (center centre) of mass, (cm com cg) (pos position), r 0""",
    "displacement": "u, disp, displ, displacement, displacements",
    "quaternion": """q, qb, qn, qbn, e, ep, quat, quats, quaternion, quaternions, versor,
        euler (param params parameter parameters)""",
    "matrix": "m, c, dcm, mat, matrix, rotmat, (rot rotation) (mat matrix), r t",
    "rotation vector": "rv, rvec, rotvec, (rot rotation) (vec vector), expmap, exp map",
    "rotation vector or position": "r",
    "mrp": "mrp, mrps, sigma, rodrigues",
    "axis and angle": "axis, axes, axisangle, axis angle",
    "angles": "euler, angle, angles, rpy, ypr, tilt, theta, phi, psi, chi",
    "attitude": "rot, rotate, rotation, rotations, ori, orn, orin, orient, orientation, orientations, att, attitude",
    "omega": """w, wb, wn, wbn, om, omega, omegas, gyr, gyro, gyros, gyroscope, angular, avel, angvel, rate, rates,
        (ang angular angle rot rotation rotational) (vel velocity velocities rate rates speed),
        (euler attitude body) (rate rates)""",
    "gyro": "g",
    "momentum": "l, angmom, amom, (ang angular) (mom momentum momenta)",
    "velocity": "v, vel, velocity, velocities, lin, linear, linvel, speed, (lin linear) (vel velocity)",
    "qpos": "qpos",
    "qvel": "qvel",
    # a position only where no other word tells the quantity
    "point": "com, cg, cm, loc, center, centre, origin",
    # what else has components
    "": """a, f, h, j, b w, b a, force, forces, torque, torques, tau, moment, moments, mom, momentum, linear momentum,
        impulse, mag, magn, magnetic, magnetometer, scale, size, bias, biases, jerk, gravity, dir, direction, forward, up, ang,
        alpha, spin, basis, normal, normals, contact, energy, inertia, inertias,
        (center centre) of (rotation gravity pressure)""",
    # a name with one of these is not of the run, or of a derivative, whatever else it says
    "never": """err, error, errors, target, desired, command, commanded, cmd, ref, reference, cov, covariance, std, true, truth,
        exact, expected, dot, ddot, wdot, qdot, omegadot, domega, dw, dq, delta, acc, accel, acceleration, accelerations,
        accelerometer, linacc, angacc""",
}
# behind the quantity, these tell the frame of ω
FRAMES = {"body": ("body", "local", "loc", "b"), "world": ("world", "global", "inertial", "w")}
ABOUT = {*FRAMES["body"], *FRAMES["world"], "com", "cg", "base", "map", "odom"}  # may stand in brackets


def _phrases(text: str) -> Iterator[str]:
    """The phrases of a line of `QUANTITIES`."""
    for phrase in text.split(","):
        choices = [words.strip("()").split() for words in re.findall(r"\([^)]*\)|\S+", phrase)]
        yield from map(" ".join, itertools.product(*choices))


# word, or words that stand together → quantity
MEANING = {phrase: quantity for quantity, text in QUANTITIES.items() if quantity != "time" for phrase in _phrases(text)}
CLOCKS = set(_phrases(QUANTITIES["time"]))
NO_CLOCK = {"step", "steps", "factor", "wall", "cpu", "real", "delta", "derivative", "offset"}
LONGEST = 3  # words of a phrase


class Unit(NamedTuple):
    """What it measures: s, m, rad, rad/s, m/s or 1; and the factor that leads to it."""

    kind: str
    factor: float


_WORDS = {
    "s": {
        "s sec secs second seconds": 1.0,
        "ms msec msecs millis millisecond milliseconds": 1e-3,
        "us usec usecs micros microsecond microseconds": 1e-6,
        "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds": 1e-9,
        "ps picosecond picoseconds": 1e-12,
        "fs femtosecond femtoseconds": 1e-15,
        "min mins minute minutes": 60.0,
        "h hr hrs hour hours": 3600.0,
        "d day days": 86400.0,
    },
    "m": {
        "m meter meters metre metres": 1.0,
        "cm centimeter centimeters centimetre centimetres": 1e-2,
        "mm millimeter millimeters millimetre millimetres": 1e-3,
        "um micron microns micrometer micrometers": 1e-6,
        "nm nanometer nanometers": 1e-9,
        "å angstrom angstroms": 1e-10,
        "km kilometer kilometers": 1e3,
        "in inch inches": 0.0254,
        "ft foot feet": 0.3048,
    },
    "rad": {
        "rad rads radian radians": 1.0,
        "mrad": 1e-3,
        "deg degs degree degrees": tau / 360,
        "rev revs revolution revolutions turn turns": tau,
    },
    "rad/s": {"rpm": tau / 60, "dps degps": tau / 360, "hz": tau, "1/s": 1.0},
    "1": {"- 1 none unitless dimensionless": 1.0},
}
UNITS = {
    name: Unit(kind, factor)
    for kind, rows in _WORDS.items()
    for names, factor in rows.items()
    for name in names.split()
}
# what may stand behind a name without brackets; other words mean too much else, such as the "in" of "in_world", or the "cm" of
# a centre of mass
SUFFIXES = set(UNITS) - {"-", "1", "none", "in", "h", "d", "min", "turn", "turns", "hz", "å", "cm"}
EXPECTED = {"time": "s", "position": "m", "displacement": "m", "points": "m", "omega": "rad/s"}
EXPECTED |= dict.fromkeys(("angles", "rotation vector", "axis and angle"), "rad")
# letters that stand for names
PLAIN = str.maketrans(dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True)))
PLAIN |= str.maketrans({"ω": "omega", "Ω": "omega", "θ": "theta", "φ": "phi", "ϕ": "phi", "ψ": "psi", "σ": "sigma"})


def unit_of(text: str) -> Unit | None:
    """The unit that a text names, such as mm, °/s, deg s^-1 or radians per second; None if it names none."""
    word = text.strip().lower().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("·", " ")
    word = re.sub(r"\s*(\bper\b|/)\s*", "/", word)
    word = re.sub(r"[\s.*_]+(s|sec|min)(\^?-1|\^\(-1\)|\*\*-1|⁻¹)$", r"/\1", word)
    if word in UNITS:
        return UNITS[word]
    above, _, below = (UNITS.get(part) for part in word.partition("/"))
    if above and below and below.kind == "s" and above.kind in ("rad", "m"):
        return Unit(above.kind + "/s", above.factor / below.factor)
    return None


class Name(NamedTuple):
    """A name in its parts: what it belongs to, which component it is (x, w, roll, 0, 11, t, …; empty if none), its unit."""

    stem: tuple[str, ...]
    part: str
    unit: str
    strange: str


ROLES = ("x y z", "roll pitch yaw", "phi theta psi", "phi theta chi", "alpha beta gamma", "0 1 2", "1 2 3")
ANGLES = {name for role in ROLES[1:5] for name in role.split()}


def parse(word: str) -> Name:
    """The parts of a name; capitals do not matter, and a point is as good as a slash or an underscore."""
    unit, strange = "", ""

    def bracket(match: re.Match[str]) -> str:
        nonlocal unit, strange
        content = match[1].strip()
        if unit_of(content) and (not content.isdecimal() or (content == "1" and match[0][0] == "{")):
            unit = content
            return " "
        known = not re.search(r"[^\d\s,]", content) or content.lower() in ABOUT or _split([content.lower()])[1]
        strange = strange if known else content
        return match[0] if known else " "

    rest = re.sub(r"[\[({<]([^\])}>]*)[\])}>]", bracket, word.translate(PLAIN))
    tokens = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", rest).lower()
    words = [token for token in re.split(r"[\s./_\[\](){}<>,:;|\\\-#%$]+", tokens) if token]
    if len(words) == 1 and len(words[0]) > 1 and words[0] in SUFFIXES and UNITS[words[0]].kind == "s":
        return Name(("stamp",), "t", words[0], strange)  # sec and nsec
    places = [(i, i + n) for n in (2, 1) for i in range(1, len(words) + 1 - n)] if not unit else []
    for i, end in places:
        these = words[i:end]  # deg_s is °/s
        if SUFFIXES.issuperset(these) and unit_of("/".join(these)):
            stem, part = _split(words[:i] + words[end:])
            if part == "t" or (part and these != ["s"]):  # in q_s the s is no second
                return Name(tuple(stem), part, "/".join(these), strange)
    stem, part = _split(words)
    return Name(tuple(stem), part, unit, strange)


def _split(words: list[str]) -> tuple[list[str], str]:
    """The stem, and the component: the last word that can be one, or the end of a word such as qw, r11 or omega2."""
    if words and words[-1] in CLOCKS and not NO_CLOCK & set(words):
        return words, "t"
    digits = ""
    while words and words[-1].isdecimal():
        digits, words = words[-1] + digits, words[:-1]
    number = [digits] if digits else []
    for i, word in reversed(list(enumerate(words))):
        before, after = words[:i], [*words[i + 1 :], *number]
        if word in ("x", "y", "z", *ANGLES) or (word == "w" and not after):
            return before + after, word
        start, end = _ending(word)
        if end and not (digits and end not in "wxyz"):
            return [*before, start, *after], end
    if digits:
        return words, digits
    last = words[-1] if words else ""
    if ends := re.fullmatch(r"([a-z]+)(\d+)", last):
        letter = ends[1] in ("x", "y", "z")  # x1, y1, z1 are of body 1
        return ([*words[:-1], ends[2]], ends[1]) if letter else ([*words[:-1], ends[1]], ends[2])
    if last in ("w", "i", "j", "k", "s", "scalar", "real", "p", "q", "r", "angle"):
        return words[:-1], last
    return (words, "t") if CLOCKS & set(words) and not NO_CLOCK & set(words) else (words, "")


def _ending(word: str) -> tuple[str, str]:
    """A word of the table and the component at its end, as of qw, posx or rxy; two empty words if it has none."""
    for length, letters in ((1, "wxyz"), (2, "xyz"), (1, "sijk")):
        start, end = word[:-length], word[-length:]
        of_rotation = MEANING.get(start) in ("quaternion", "attitude")
        if word not in MEANING and start in MEANING and set(end) <= set(letters) and (letters != "sijk" or of_rotation):
            return start, end
    return "", ""


def kind_of(stem: Iterable[str]) -> str | None:
    """The quantity that a stem names; empty for one that is not judged; None where it names a body or nothing."""
    kinds = {phrase: MEANING[phrase] for _, phrase in _known(list(stem))}
    if "never" in kinds.values():
        return ""
    sure = [phrase for phrase, kind in kinds.items() if kind != "point"]
    return kinds[max(sure, key=len)] if sure else "position" if kinds else None


def frame_of(stem: Iterable[str]) -> str | None:
    """The frame that is named behind the quantity, as in omega_world; None where there is none."""
    words = list(stem)
    known = [(len(phrase), end) for end, phrase in _known(words) if MEANING[phrase] != "point"]
    behind = words[max(known)[1] :] if known else []
    return next((frame for frame, names in FRAMES.items() for word in behind if word in names), None)


def _known(words: list[str]) -> list[tuple[int, str]]:
    """The phrases of the table in some words, each with the place behind it."""
    spans = [(i, i + n) for i in range(len(words)) for n in range(1, LONGEST + 1) if i + n <= len(words)]
    return [(end, phrase) for start, end in spans if (phrase := " ".join(words[start:end])) in MEANING]


@dataclass
class Group:
    """Columns that are one quantity. order : the components as the file names them. rank : how sure that is, 0 the surest."""

    kind: str
    places: list[int]
    stem: tuple[str, ...]
    order: str
    rank: float
    twice: bool = False


SCALAR_FIRST = (*(f"{w} x y z" for w in ("w", "s", "scalar", "real")), *(f"{w} i j k" for w in ("w", "s", "r", "real")))
QUATERNIONS = (*SCALAR_FIRST, "0 1 2 3", "1 2 3 4")
VECTORS = ("x y z", "0 1 2", "1 2 3")
NINE = tuple(" ".join(a + b for a in row for b in row) for row in ("123", "012", "xyz"))
FLAT = tuple(" ".join(map(str, range(k, k + 9))) for k in (0, 1))
# kind of a stem -> what it holds, with which components
SHAPES: dict[str | None, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "": (),
    None: (
        ("quaternion or position", ("w x y z",)),
        ("quaternion", SCALAR_FIRST[1:]),
        ("position", ("x y z",)),
        ("angles", ROLES[1:5]),
        ("omega", ("p q r",)),
        ("matrix", NINE),
    ),
    "quaternion": (("quaternion", QUATERNIONS),),
    "attitude": (
        ("quaternion", QUATERNIONS),
        ("matrix", (*NINE, *FLAT)),
        ("angles", ROLES[1:5]),
        ("axis and angle", ("x y z angle",)),
        ("three of a rotation", VECTORS),
    ),
    "matrix": (("matrix", (*NINE, *FLAT)),),
    "rotation vector": (("rotation vector", VECTORS),),
    "rotation vector or position": (("matrix", (*NINE, *FLAT)), ("rotation vector or position", VECTORS)),
    "axis and angle": (("axis and angle", tuple(f"{order} angle" for order in VECTORS)),),
    "omega": (("omega", (*VECTORS, *ROLES[1:2], "p q r")),),
    "gyro": (("gyro", ("x y z",)),),
    "momentum": (("momentum of quaternion", QUATERNIONS), ("momentum", VECTORS)),
    "velocity": (("velocity", VECTORS), ("omega", ("p q r",))),
    "angles": (("angles", ROLES),),
    "qpos7": (("position", ("0 1 2",)), ("quaternion", ("3 4 5 6",))),  # of MuJoCo, of a free and of a ball joint
    "qpos4": (("quaternion", ("0 1 2 3",)),),
    "qvel6": (("velocity", ("0 1 2",)), ("omega", ("3 4 5",))),
    "qvel3": (("omega", ("0 1 2",)),),
    "position": (("position", VECTORS), ("quaternion", ("0 1 2 3",))),  # p0 … p3 are Euler's parameters
    **{kind: ((kind, VECTORS),) for kind in ("mrp", "displacement")},
}


def groups_of(names: Mapping[int, Name], user_columns: set[int]) -> tuple[list[Group], list[str]]:
    """All groups that are complete, and notes on others. user_columns : those that the user names, the surest."""
    stems: dict[tuple[str, ...], dict[str, list[int]]] = {}
    for i, name in names.items():
        if name.part:
            stems.setdefault(name.stem, {}).setdefault(name.part, []).append(i)
    for stem, parts in list(stems.items()):
        digit = {part[0] for part in parts if re.fullmatch(r"\d\d", part)}
        if len(digit) == 1 and len(parts) in (3, 4) and kind_of((*stem, *digit)) in ("position", "omega", "quaternion"):
            stems[(*stem, *digit)] = {part[1:]: places for part, places in stems.pop(stem).items()}  # r_0[1], q_1_1
    angles = [places for parts in stems.values() for part, places in parts.items() if part == "angle"]
    groups: list[Group] = []
    missing: dict[str, str] = {}
    for stem, parts in stems.items():
        kind = kind_of(stem)
        state = kind in ("qpos", "qvel")
        kind = f"{kind}{len(parts)}" if state else kind
        indexed = sum(part.isdecimal() for part in parts)
        if kind == "axis and angle" and len(angles) == 1:
            parts = {"angle": angles[0], **parts}
        if "t" in parts:
            twice = len(parts["t"]) > 1
            groups += [Group("time", [i], stem, "t", 0 if i in user_columns else 1, twice) for i in parts["t"]]
        grouped: set[str] = set()
        for shape, orders in SHAPES.get(kind, ()):
            for order in orders:
                if order[0].isdecimal() and indexed != len(order.replace("angle", "").split()) and not state:
                    continue
                if grouped & set(order.split()) or any(part not in parts for part in order.split()):
                    continue
                choices = [[i for i in parts[part] if i in user_columns] or parts[part] for part in order.split()]
                places, twice = [each[0] for each in choices], any(len(each) > 1 for each in choices)
                rank = 0 if user_columns & set(places) else 1 if kind else 3 if stem else 2
                index = 0.5 * order[0].isdecimal()  # qw says more than q0
                groups.append(Group(shape, places, stem, order, rank + index, twice))
                grouped |= set(order.split())
        if not grouped and kind and kind != "velocity":
            forms = [(shape, order.split()) for shape, orders in SHAPES.get(kind, ()) for order in orders]
            shape, best = max(forms, key=lambda pair: sum(part in parts for part in pair[1]) / len(pair[1]))
            if absent := [part for part in best if part not in parts and set(best) & set(parts)]:
                missing[shape] = f"No {shape}: there is no column {', '.join(_written(stem, part) for part in absent)}."
    have = {group.kind for group in groups}
    return groups, [note for kind, note in missing.items() if kind not in have]


def _written(stem: tuple[str, ...], part: str) -> str:
    word = "_".join(stem)
    return f"{word}{part}" if len(word) < 2 else f"{word}_{part}"
