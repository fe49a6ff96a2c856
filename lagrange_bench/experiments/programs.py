"""The programs of the experiment `engines`, and the bodies that they follow.

No program is part of the bench. In the clone `pip install '.[engines]'` brings MuJoCo and Exudyn; the others install by the names
in ENGINES. `make web` installs the programs that run in JavaScript.
"""

import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np

from lagrange_bench.experiments import adapters
from lagrange_bench.experiments.adapters import CONTROLLED, DISCRETE, DOUBLES, EXPLICIT
from lagrange_bench.integrators import CASES, RigidBody
from lagrange_bench.integrators.cases import Case

UNTIL = 2.0  # s, of the tops
POWERS = {"bruels": range(10, 17), "slow": range(6, 14)}  # the sweep takes 2^k steps, which add up to 2 s exactly
DEFAULT, RECOMMENDED, BEST, OTHER = "default", "recommended", "best", ""  # settings: see `engines`

# The tennis racket theorem in 5 s, with moments that matter can have: MuJoCo refuses the moments of the case `middle_axis`. If
# the start were as close to the axis as there, single precision would keep a digit or two of the result.
_PLATE = RigidBody(mass=1.0, com=(0.0, 0.0, 0.0), inertia_com=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, 0.0))
RACKET = Case("racket", _PLATE, np.eye(3), (0.01, 5.0, 0.0), until=5.0)
BODIES = {**{name: CASES[name] for name in ("slow", "bruels", "box")}, RACKET.name: RACKET}
AXIS = 1  # the axis of symmetry of a top, the middle axis of a free body


@dataclass(frozen=True)
class Engine:
    """A program and its integrators.

    start : the adapter. package : its distribution on PyPI. integrators : name → setting. module : the name to import, if it is
    not the package's. release : the beginning of the only version that counts, or "". timed : whether it is in the sweep.
    least : the smallest step, s, of a program that would take an hour with a smaller one. missing : why it has fewer rows than
    the others.
    """

    start: Callable[..., adapters.Run]
    package: str
    integrators: dict[str, str]
    module: str = ""
    release: str = ""
    timed: bool = False
    least: float = 0.0
    missing: str = ""

    def load(self) -> Any:
        return importlib.import_module(self.module or self.package.replace("-", "_"))

    def installed(self) -> str | None:
        """The version that is installed here."""
        try:
            return metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None

    @property
    def version(self) -> str | None:
        """The version that is installed here; None if it is of another release."""
        found = self.installed()
        return found if found and found.startswith(self.release) else None

    @property
    def needs(self) -> str:
        """The requirement, as messages name it."""
        return self.package + f"=={self.release}*" * bool(self.release)


class WebEngine(Engine):
    """A package of npm, which runs in node."""

    def load(self) -> None:
        return None

    def installed(self) -> str | None:
        path = adapters.WEB / "node_modules" / self.package / "package.json"
        return json.loads(path.read_text("utf-8"))["version"] if path.is_file() else None

    @property
    def needs(self) -> str:
        return f"{self.package} of npm (make web)"


def _web(name: str, package: str, *best: str) -> WebEngine:
    return WebEngine(partial(adapters.node, name), package, {"default": DEFAULT, **dict.fromkeys(best, BEST)})


OURS = "lagrange-bench"
METHODS = ("backlund", "strang", "rkmk4", "rattle", "generalized_alpha")
_MUJOCO = {"implicitfast": RECOMMENDED, "RK4": BEST}  # of all releases; the manual recommends implicitfast
_EXUDYN = {"generalized-alpha": DEFAULT, "generalized-alpha, Lie group": OTHER, **dict.fromkeys(EXPLICIT, OTHER)}
_DRAKE = {DISCRETE: DEFAULT, f"runge_kutta3{CONTROLLED}": DEFAULT, "runge_kutta2": OTHER, "runge_kutta3": OTHER}
_MERSON = "Runge-Kutta-Merson"
_ON_A_CPU = "not measured: on a processor a run takes minutes"
# Why a setting is called best:
# - Documented: Drake (highest order), ODE (ERP up to 0.8, CFM 0 is a hard joint), PhysX (flag, TGS and more iterations), Jolt
#   (flag), cannon-es (iterations).
# - The highest order or accuracy on offer, or more iterations: RK4 of MuJoCo and Newton, RK67 of Exudyn, Simbody, Rapier.
# - “undamped” removes damping and caps, which are not in the equations.
# - The better one of two that were measured: RKMK4 with Pinocchio's dynamics, the explicit flag of Bullet, doubles in MJX, equal
#   relaxation in Newton's XPBD (without it errors stop falling with the step).
ENGINES = {
    OURS: Engine(adapters.bench, OURS, dict.fromkeys(METHODS, OTHER), timed=True),
    "MuJoCo": Engine(
        adapters.mujoco, "mujoco", {"Euler": DEFAULT, "implicit": OTHER, **_MUJOCO}, release="4.", timed=True
    ),
    "MuJoCo 3": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.17.", timed=True),
    "MuJoCo 3.10": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.10."),
    "MuJoCo 3.6": Engine(adapters.mujoco, "mujoco", _MUJOCO, release="3.6."),
    "Exudyn": Engine(adapters.exudyn, "exudyn", _EXUDYN | {"RK67": BEST}, timed=True),
    "Drake": Engine(
        adapters.drake, "drake", _DRAKE | {"radau3": OTHER, "runge_kutta5": BEST}, module="pydrake", timed=True
    ),
    "Pinocchio": Engine(
        adapters.pinocchio, "pin", {"semi-implicit Euler": OTHER, "RKMK4": BEST}, module="pinocchio", timed=True
    ),
    "PyBullet": Engine(adapters.pybullet, "pybullet", {"Euler": DEFAULT, "Euler, undamped": BEST}, timed=True),
    "DART": Engine(adapters.dart, "dartpy", {"Euler": DEFAULT}, timed=True),
    "Simbody": Engine(adapters.simbody, "opensim", {_MERSON: DEFAULT, f"{_MERSON}, accuracy 1e-12": BEST}),
    "Rapier": Engine(adapters.rapier, "rapier3d", {"default": DEFAULT, "32 iterations, fast rotation": BEST}),
    "Bullet (Panda3D)": Engine(adapters.bullet, "panda3d", {"default": DEFAULT}, module="panda3d.bullet"),
    "ODE (Panda3D)": Engine(
        adapters.ode, "panda3d", {"default": DEFAULT, "ERP 0.8, CFM 0": BEST}, module="panda3d.ode"
    ),
    "PhysX (SAPIEN)": Engine(adapters.sapien, "sapien", {"default": DEFAULT, "undamped": BEST}),
    "MuJoCo Warp": Engine(
        adapters.mujoco_warp, "mujoco-warp", {"Euler": DEFAULT, **_MUJOCO}, least=1 / 1024, missing=_ON_A_CPU
    ),
    "MJX": Engine(
        adapters.mjx,
        "mujoco-mjx",
        {"Euler": DEFAULT, "RK4": OTHER, f"RK4{DOUBLES}": BEST},
        module="mujoco.mjx",
        missing=_ON_A_CPU,
    ),
    "Newton": Engine(
        adapters.newton, "newton", {"XPBD": DEFAULT, "Featherstone": OTHER, "XPBD, equal relaxation": BEST}
    ),
    "Newton (MuJoCo Warp)": Engine(
        adapters.newton, "newton", {"MuJoCo": DEFAULT, "MuJoCo, RK4": BEST}, least=1 / 1024, missing=_ON_A_CPU
    ),
    "cannon-es": _web("cannon", "cannon-es", "undamped, 100 iterations"),
    "Oimo": _web("oimo", "oimo"),
    "Havok": _web("havok", "@babylonjs/havok", "undamped"),
    "Jolt": _web("jolt", "jolt-physics", "undamped, gyroscopic torque"),
    "PhysX": _web("physx", "physx-js-webidl", "undamped, gyroscopic torque, TGS, 64 + 16 iterations"),
    "Rapier (JavaScript)": _web("rapier", "@dimforge/rapier3d-compat", "32 iterations"),
    "Bullet (ammo.js)": _web("ammo", "ammojs3", "explicit gyroscopic torque"),
}
