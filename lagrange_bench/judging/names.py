"""What the names of columns mean, whatever program wrote them: a grammar of quantities, components and units."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import tau
from typing import NamedTuple


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
EXPECTED = {"time": "s", "position": "m", "displacement": "m", "omega": "rad/s"}
EXPECTED |= dict.fromkeys(("angles", "rotation vector", "axis and angle"), "rad")
# what names of Unicode mean in plain letters
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


# words of which a component may be the end, as qw, posx or tz
LETTERED = (
    r"q|quat|quaternion|orientation|rotation|ori|att|w|om|omega|angvel|v|vel|velocity|p|t|pos|position|u|disp|r|rv|rot|euler|mrp|m|c"
    r"|dcm|a|f"
)
ROLES = ("x y z", "roll pitch yaw", "phi theta psi", "alpha beta gamma", "0 1 2", "1 2 3")
ANGLES = {name for role in ROLES[1:4] for name in role.split()}
CLOCKS = {"t", "ts", "tout", "time", "timestamp", "timestamps", "stamp", "simtime", "seconds", "elapsed"}
NO_CLOCK = {"step", "steps", "factor", "wall", "cpu", "real", "delta", "derivative", "offset"}
FRAMES = {"body", "world", "local", "global", "inertial", "com", "cg", "base", "map", "odom"}


def parse(word: str) -> Name:
    """The parts of a name; capitals do not matter, and a point is as good as a slash or an underscore."""
    unit, strange = "", ""

    def bracket(match: re.Match[str]) -> str:
        nonlocal unit, strange
        content = match[1].strip()
        if unit_of(content) and not content.isdecimal():
            unit = content
            return " "
        known = not re.search(r"[^\d\s,]", content) or content.lower() in FRAMES or _split([content.lower()])[1]
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
        ends = re.fullmatch(rf"({LETTERED})([wxyzsijk]|[xyz]{{2}})", word)
        if ends and not (digits and ends[2] not in "wxyz"):
            return [*before, ends[1], *after], ends[2]
    if digits:
        return words, digits
    last = words[-1] if words else ""
    if ends := re.fullmatch(r"([a-z]+)(\d+)", last):
        letter = ends[1] in ("x", "y", "z")  # x1, y1, z1 are of body 1
        return ([*words[:-1], ends[2]], ends[1]) if letter else ([*words[:-1], ends[1]], ends[2])
    if last in ("w", "i", "j", "k", "s", "scalar", "real", "p", "q", "r", "angle"):
        return words[:-1], last
    return (words, "t") if CLOCKS & set(words) and not NO_CLOCK & set(words) else (words, "")


KINDS = [  # the first that fits the words of a stem; "" is something else that has components
    (
        "",
        r"acc|force|torque|\btau|moment|mom\b|impuls|\berr|target|desired|command|cmd|\bref|\bcov|magn|scale|size|bias|gravity|jerk"
        r"|\bstd|direction|\bdir$|forward|\bup$|\bang$|\balpha$|\bspin$|\bbasis|\bmag$|dot\b|\bd(omega|w|q)$"
        r"|\btrue$|truth|exact|expect",
    ),
    ("", r"\binertias?$|energy|(^|\w{3} )[afhjl]$|\bb [aw]\b|normal$"),
    ("qpos", r"\bqpos$"),
    ("qvel", r"\bqvel$"),
    ("omega", r"omega|\bom$|(ang(ular)?|rot(ation)?) ?(vel|rate|speed)|\bavel|\bgyr|\brates?\b|\bangular\b|\bwb?n?$"),
    ("velocity", r"\bvel|linvel|\blinear\b|\bv$|speed"),
    ("axis and angle", r"\baxis"),
    ("quaternion", r"quat|versor|\bqb?n?$|\be$|\bep$|euler param"),
    ("angles", r"euler|\bangles?\b|\brpy\b|\bypr\b|\b(tilt|theta|phi|psi)$"),
    ("position", r"\br [a-z]{2} [a-z]$"),  # r_BN_N
    ("rotation vector", r"rot(ation)? ?vec|\brv$|\brvec|exp ?map"),
    ("rotation vector or position", r"\br$"),
    ("mrp", r"\bmrp|rodrigues|\bsigma"),
    ("matrix", r"\bdcm|matrix|mat$|\bm$|\bc$|\br t$"),
    ("attitude", r"\brotat(e|ion)|\brot$|orient|\bor[in]\b|attitude|\batt\b"),
    ("displacement", r"disp|\bu$"),
    ("position", r"pos|translat|location|^loc$|^(?![vw] ).*\b(com|cg)\b|origin|cent(er|re)|\b[pt]$|coord"),
]


def kind_of(stem: Iterable[str]) -> str | None:
    """The quantity that a stem names; None where it names a body or nothing."""
    if tuple(stem)[-2:] == ("r", "0"):  # of Modelica
        return "position"
    words = [word for word in stem if not word.isdecimal()]
    in_frame = len(words) > 1 and words[-1] in ("w", "b")  # of the world or the body, as in pos_w
    if in_frame and (kind := kind_of(words[:-1])):
        return kind
    if all(len(word) <= 2 for word in words) and not re.search(r"\br .. .$|\bb [aw]\b", " ".join(words)):
        words = words[:1]  # p_RS_R
    while True:
        kind = next((kind for kind, pattern in KINDS if re.search(pattern, " ".join(words))), None)
        if kind is not None:
            return kind
        if len(words) < 2 or not (len(words[-1]) <= 2 or words[-1] in FRAMES):  # names of frames, as in omega_BN_B
            kind = kind_of(words[:1]) if len(words) > 1 else None
            return kind if kind in ("omega", "velocity", "quaternion") else None  # w_sim is no place
        words = words[:-1]


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
        ("angles", ROLES[1:4]),
        ("omega", ("p q r",)),
        ("matrix", NINE),
    ),
    "quaternion": (("quaternion", QUATERNIONS),),
    "attitude": (
        ("quaternion", QUATERNIONS),
        ("matrix", (*NINE, *FLAT)),
        ("angles", ROLES[1:4]),
        ("axis and angle", ("x y z angle",)),
        ("three of a rotation", VECTORS),
    ),
    "matrix": (("matrix", (*NINE, *FLAT)),),
    "rotation vector": (("rotation vector", VECTORS),),
    "rotation vector or position": (("matrix", (*NINE, *FLAT)), ("rotation vector or position", VECTORS)),
    "axis and angle": (("axis and angle", tuple(f"{order} angle" for order in VECTORS)),),
    "omega": (("omega", (*VECTORS, *ROLES[1:2], "p q r")),),
    "velocity": (("velocity", VECTORS), ("omega", ("p q r",))),
    "angles": (("angles", ROLES),),
    "qpos7": (("position", ("0 1 2",)), ("quaternion", ("3 4 5 6",))),  # of MuJoCo, of a free and of a ball joint
    "qpos4": (("quaternion", ("0 1 2 3",)),),
    "qvel6": (("velocity", ("0 1 2",)), ("omega", ("3 4 5",))),
    "qvel3": (("omega", ("0 1 2",)),),
    "position": (("position", VECTORS), ("quaternion", ("0 1 2 3",))),  # p0 … p3 are Euler's parameters
    **{kind: ((kind, VECTORS),) for kind in ("mrp", "displacement")},
}


def groups_of(names: Mapping[int, Name], given: set[int]) -> tuple[list[Group], list[str]]:
    """All groups that are complete, and notes on others. given : the columns that the user named; they are the surest."""
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
            groups += [Group("time", [i], stem, "t", 0 if i in given else 1, len(parts["t"]) > 1) for i in parts["t"]]
        used: set[str] = set()
        for what, orders in SHAPES.get(kind, ()):
            for order in orders:
                if order[0].isdecimal() and indexed != len(order.replace("angle", "").split()) and not state:
                    continue
                if used & set(order.split()) or any(part not in parts for part in order.split()):
                    continue
                choices = [[i for i in parts[part] if i in given] or parts[part] for part in order.split()]
                places, twice = [each[0] for each in choices], any(len(each) > 1 for each in choices)
                rank = 0 if given & set(places) else 1 if kind else 3 if stem else 2
                index = 0.5 * order[0].isdecimal()  # qw says more than q0
                groups.append(Group(what, places, stem, order, rank + index, twice))
                used |= set(order.split())
        if not used and kind and kind != "velocity":
            forms = [(what, order.split()) for what, orders in SHAPES.get(kind, ()) for order in orders]
            what, best = max(forms, key=lambda pair: sum(part in parts for part in pair[1]) / len(pair[1]))
            if absent := [part for part in best if part not in parts and set(best) & set(parts)]:
                missing[what] = f"No {what}: there is no column {', '.join(_written(stem, part) for part in absent)}."
    have = {group.kind for group in groups}
    return groups, [note for kind, note in missing.items() if kind not in have]


def _written(stem: tuple[str, ...], part: str) -> str:
    word = "_".join(stem)
    return f"{word}{part}" if len(word) < 2 else f"{word}_{part}"
