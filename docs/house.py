"""Draws docs/house.svg from the imports of the code: `python docs/house.py`.

A box is a room: a folder, or some of the files that lie beside the folders of a package. Its lower line counts files and
lines. An arrow leads from the room that imports to the one that is imported. What an arrow or two already show (a room
two floors down, reached by way of the one between) is not drawn again. `make lint` fails if a room imports
from a room that is drawn above it.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path

import grimp
import matplotlib

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
SMALL = ("checks", "words", "machine", "memory", "interrupts", "imported", "files", "lazy", "precision")
CONTRACT = tuple(f"lagrange_bench.integrators.{name}" for name in ("interface", *SMALL))
FLOORS: tuple[tuple[tuple[str, tuple[str, ...]], ...], ...] = (  # from the top: label, and which modules live there
    (("lagrange_bench", ("lagrange_bench",)),),
    (("lagrange_bench/commands", ("lagrange_bench.commands",)),),
    (("lagrange_bench/runner", ("lagrange_bench.runner",)), ("report", ("lagrange_bench.report",))),
    (("results", ("lagrange_bench.results",)),),
    (("experiments", ("lagrange_bench.experiments",)),),
    (
        ("experiments/measuring", ("lagrange_bench.experiments.measuring",)),
        ("experiments/drawing", ("lagrange_bench.experiments.drawing",)),
    ),
    (("integrators: api, registry", ("lagrange_bench.integrators",)),),
    (("integrators/methods", ("lagrange_bench.integrators.methods",)),),
    (("integrators/paper", ("lagrange_bench.integrators.paper",)),),
    (
        ("integrators/torus", ("lagrange_bench.integrators.torus",)),
        ("integrators/truth", ("lagrange_bench.integrators.truth",)),
    ),
    (("integrators/problem", ("lagrange_bench.integrators.problem",)),),
    (("integrators/compiling", ("lagrange_bench.integrators.compiling",)),),
    (("integrators: interface, checks", CONTRACT),),
)
ROOMS = {prefix: label for floor in FLOORS for label, prefixes in floor for prefix in prefixes}
# packages' __init__: they only hand on names
FACES = ("lagrange_bench", *(f"lagrange_bench.{name}" for name in ("experiments", "results", "integrators")))
HELPERS = tuple(
    f"lagrange_bench.{name}" for name in ("text", "arguments", "trajectory", "differences", "judging", "columns")
)
COLOURS = {
    "lagrange_bench": "#e8d9f0", "report": "#d6e6f5", "results": "#fdf0cf", "experiments": "#dcefd8", "integrators": "#f7dcd3",
}  # fmt: skip
WIDTH, HEIGHT, STEP = 3.0, 0.6, 3.6


def room(module: str) -> str:
    """The room a module lies in: that of the longest prefix."""
    return ROOMS[max((prefix for prefix in ROOMS if f"{module}.".startswith(f"{prefix}.")), key=len)]


def arrows() -> set[tuple[str, str]]:
    """(importing room, imported room), without those that others imply."""
    with (
        tempfile.TemporaryDirectory() as folder
    ):  # laid out as a wheel installs it: grimp reads folders, not `package-dir`
        home = Path(folder, "lagrange_bench")
        for package in COLOURS:
            shutil.copytree(ROOT / package, home if package == home.name else home / package)
        sys.path.insert(0, folder)
        graph = grimp.build_graph("lagrange_bench", cache_dir=None)
        sys.path.remove(folder)
    below: dict[str, set[str]] = {label: set() for label in ROOMS.values()}
    for a in graph.modules:
        for b in graph.find_modules_directly_imported_by(a):
            if room(a) != room(b) and not {a, b} & {*FACES, *HELPERS}:
                below[room(a)].add(room(b))

    @cache
    def reach(label: str) -> frozenset[str]:
        return frozenset(below[label]).union(*(reach(other) for other in below[label]))

    return {(a, b) for a in below for b in below[a] if not any(b in reach(other) for other in below[a] - {b})}


def sizes() -> dict[str, tuple[int, int]]:
    """Files and lines of each room."""
    counted = dict.fromkeys(ROOMS.values(), (0, 0))
    for package in COLOURS:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT / package).with_suffix("").parts
            name = room(".".join(("lagrange_bench", *([package] if package != "lagrange_bench" else []), *parts)))
            files, lines = counted[name]
            counted[name] = files + 1, lines + len(path.read_text(encoding="utf-8").splitlines())
    return counted


def draw(path: Path) -> None:
    place, counted = {}, sizes()
    for level, floor in enumerate(FLOORS):
        for i, (label, _) in enumerate(floor):
            place[label] = ((i - (len(floor) - 1) / 2) * STEP, -1.0 * level)
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "house", "font.size": 9})
    figure, ax = plt.subplots(figsize=(7, 9))
    for a, b in sorted(arrows()):
        (x, y), (u, v) = place[a], place[b]
        bend = 0.35 if x == u and y - v > 1.5 else 0.0  # around the room between
        look = {"arrowstyle": "-|>", "mutation_scale": 10, "color": "#666666", "linewidth": 0.9, "zorder": 1}
        ends = (x, y - HEIGHT / 2 - 0.02), (u, v + HEIGHT / 2 + 0.02)
        ax.add_patch(FancyArrowPatch(*ends, connectionstyle=f"arc3,rad={bend}", shrinkA=0, shrinkB=0, **look))
    for label, (x, y) in place.items():
        colour = COLOURS[label.partition(":")[0].partition("/")[0]]
        corner = (x - WIDTH / 2, y - HEIGHT / 2)
        ax.add_patch(
            FancyBboxPatch(corner, WIDTH, HEIGHT, boxstyle="round,pad=0.02", fc=colour, ec="#555555", zorder=2)
        )
        files, lines = counted[label]
        ax.text(x, y + 0.11, label, ha="center", va="center", weight="bold", zorder=3)
        ax.text(
            x, y - 0.15, f"{files} files, {lines / 1000:.1f} k lines", ha="center", va="center", fontsize=7, zorder=3
        )
    ax.set_xlim(-3.6, 3.6)
    ax.set_ylim(0.4 - len(FLOORS), 0.5)
    ax.axis("off")
    figure.savefig(path, bbox_inches="tight", metadata={"Date": None} if path.suffix == ".svg" else None)
    plt.close(figure)


if __name__ == "__main__":
    draw(ROOT / "docs" / "house.svg")
