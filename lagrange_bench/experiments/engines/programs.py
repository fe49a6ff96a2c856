"""The programs of the experiment `engines`, and the bodies that they follow."""

import json
import tomllib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from lagrange_bench.integrators import CASES, RigidBody
from lagrange_bench.integrators.cases import Case

HERE = Path(__file__).parent
WEB = HERE / "web"
OURS = "lagrange-bench"
DEFAULT, RECOMMENDED, BEST = "default", "recommended", "best"  # settings, as rows have them: see programs.toml
WORDS = {
    DEFAULT: "default",
    RECOMMENDED: "recommended",
    BEST: "as its documents advise",
}  # settings, as tables show them
UNTIL = 2.0  # s, of the tops
POWERS = {"bruels": range(10, 17), "slow": range(6, 14)}  # the sweep takes 2^k steps, which add up to 2 s exactly

# The tennis racket theorem in 5 s, with moments that matter can have: MuJoCo refuses the moments of the case `middle_axis`. If
# the start were as close to the axis as there, single precision would keep a digit or two of the result.
_PLATE = RigidBody(mass=1.0, com=(0.0, 0.0, 0.0), inertia_com=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, 0.0))
RACKET = Case("racket", _PLATE, np.eye(3), (0.01, 5.0, 0.0), until=5.0)
BODIES = {**{name: CASES[name] for name in ("slow", "bruels", "box")}, RACKET.name: RACKET}
AXIS = 1  # the axis of symmetry of a top, the middle axis of a free body


@dataclass(frozen=True)
class Engine:
    """A program and its integrators; the fields are described in programs.toml."""

    run: str
    package: str
    integrators: dict[str, str]
    release: str = ""
    engine: str = ""
    timed: bool = False
    least: float = 0.0
    worse: str = ""

    @property
    def in_node(self) -> bool:
        return self.run.startswith("web/")

    @property
    def version(self) -> str | None:
        """The version of the package that is installed here; None if there is none, or one of another release."""
        if self.in_node:
            path = WEB / "node_modules" / self.package / "package.json"
            return json.loads(path.read_text("utf-8"))["version"] if path.is_file() else None
        try:
            version = metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None
        return version if version.startswith(self.release) else None

    @property
    def needs(self) -> str:
        """The requirement, as messages name it."""
        if self.in_node:
            return f"{self.package} of npm (make web)"
        return f"{self.package}=={self.release}*" if self.release else self.package


def _engines() -> dict[str, Engine]:
    table = tomllib.loads((HERE / "programs.toml").read_text("utf-8"))
    return {name: Engine(**facts) for name, facts in table.items()}


ENGINES = _engines()
