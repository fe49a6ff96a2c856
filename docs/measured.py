"""Writes the tables of docs/heavy-top.md, docs/engines.md and, of programs, README.md: python docs/measured.py.

In heavy-top.md stand published numbers (docs/published.toml) beside the exact motion, in the others the stored rows of the
experiment `engines`. tests/test_docs.py compares.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, METHODS, Case, RigidBody, judge
from lagrange_bench.experiments import engine_figures, programs
from lagrange_bench.results.store import Store

DOCS = Path(__file__).parent
STORY = [
    "1. **Many engines leave out the gyroscopic torque ω × Iω by default**: {lost}. In them `racket` never turns over, whatever "
    "the step. No option for it was found in {without}.",
    "2. **With default settings and steps of 1/60 s** these stay within 10 cm for 2 s on `slow`: {near}. The others do so for "
    "{least} to {most} s.",
    "3. **One formula has many names**: {family} take the semi-implicit Euler step in reduced coordinates, and are all off by "
    "{equal} m with 1/1024 s. Bullet's point joint, a constraint, errs by {joint} m there.",
    "4. **Some defaults are no physics**: damping and caps. With the smallest step a spin of 10 rad/s on `slow` is after 2 s "
    "{spins}.",
    "5. **A release can change the motion**: with MuJoCo's recommended integrator, implicitfast, and 1/60 s the rotation of "
    "`box` is off by {box}.",
    "6. **Energy and small steps can mislead**: cannon-es without damping changes the energy of `slow` by {calm} and is {off} m "
    "off. In single precision, with 32 iterations, Rapier errs on `racket` by {coarse} rad with 1/60 s and by {fine} rad with "
    "1/1024 s.",
]
KNOWN = [
    "| program, version | settings | error, 1/60 s | error, 1/1024 s | within 10 cm, 1/60 s | smaller steps lead to |",
    "|---|---|---|---|---|---|",
]
ENERGIES = [
    "| program | settings | numbers | energy gained | p | least error | its step |",
    "|---|---|---|---|---|---|---|",
]
BEGIN, END = "<!-- measured: written by `python docs/measured.py` -->", "<!-- end of measured -->"
PUBLISHED = [
    "| program | what it publishes | t (s) | difference from the exact motion | source |",
    "|---|---|---|---|---|",
]
ENGINES = [
    "| program, version | integrator | order, `bruels` | order, `slow` | position, `bruels` | position, `slow` | µs a step "
    "| overhead, µs |",
    "|---|---|---|---|---|---|---|---|",
]


def differences(reference: dict[str, Any]) -> str:
    """What the numbers of one reference are off by."""
    case, t = reference["case"], [reference["t"]]
    if isinstance(case, dict):  # a free body that has no name here
        body = RigidBody(1.0, (0, 0, 0), case["inertia_com"], (0, 0, 0))
        case = Case("", body, (1, 0, 0, 0), case["omega_body"])
    else:
        case = CASES[case]
    exact, found = case.solution(t), []
    if "displacement" in reference:
        moved = judge(t, position=case.solution([0.0]).position + reference["displacement"], case=case)
        found.append(f"{moved.position.max:.1e} m")
    if "quaternion" in reference:
        found.append(f"{judge(t, rotation=[reference['quaternion']], case=case).rotation.max:.1e} rad")
    if "mrp" in reference:
        found.append(f"{judge(t, rotation=Rotation.from_mrp([reference['mrp']]), case=case).rotation.max:.1e} rad")
    if "omega_body_degrees" in reference:
        off = np.degrees(exact.omega_body[0]) - reference["omega_body_degrees"]
        found.append(f"{np.linalg.norm(off):.1e} °/s")
    if "omega_y_world" in reference:
        found.append(f"{abs(exact.rotation.apply(exact.omega_body)[0, 1] - reference['omega_y_world']):.0e} rad/s")
    if "energy" in reference:
        energy = case.body.energy_of(exact.rotation, exact.omega_body)[0]
        found.append(f"{abs(energy - reference['energy']):.1e} J")
    return ", ".join(found)


def references() -> list[str]:
    """The table of published numbers."""
    rows = list(PUBLISHED)
    for each in tomllib.loads((DOCS / "published.toml").read_text(encoding="utf-8"))["reference"]:
        source = f"{each['source']} ({each['looked_up']})"
        rows.append(f"| {each['program']} | {each['what']} | {each['t']:g} | {differences(each)} | {source} |")
    return rows


@cache
def orders() -> tuple[pd.DataFrame, str]:
    """Integrators of engines with their errors, and the column of the position at the step of the documents."""
    table = engine_figures.tables(stored())["orders"]
    return table, next(name for name in table if name.startswith("position, h"))


def defaults() -> list[str]:
    """The table of programs in the README: how far the default and the best integrator of each are off on `bruels`."""
    table, position = orders()
    table = table[table.case == "bruels"]
    exact = table[table.integrator == "backlund"].iloc[0]
    lines = ["| program | default | best |", "|---|---|---|"]
    for engine, rows in table[table.engine != exact.engine].groupby("engine", sort=False):
        cells = [f"{engine}, {rows.version.iloc[0]}"]
        for word in ("default", "best"):
            chosen = rows[rows.setting.str.contains(word, na=False)]
            cells.append(
                "; ".join(
                    f"{row.integrator}: {shown(row[position], '.1e', 'gave up', ' m')}" for _, row in chosen.iterrows()
                )
            )
        lines.append(f"| {' | '.join(cell or '–' for cell in cells)} |")
    return [*lines, f"| this bench | | `backlund`, any step: {shown(exact[position], '.1e', '–', ' m')} |"]


def sweep() -> list[str]:
    """The default and the best integrators of the sweep, and below them methods of the bench."""
    table, position = orders()
    lines = []
    for (engine, integrator), cases in table.groupby(["engine", "integrator"], sort=False):
        fast, slow = (cases[cases.case == case].iloc[0] for case in ("bruels", "slow"))
        own = engine == programs.OURS
        if not own and not fast.setting:
            continue
        exact = own and METHODS[integrator].order is None
        cells = [
            f"{'this bench' if own else engine}, {fast.version}",
            f"`{integrator}`" if own else f"{integrator} ({fast.setting})",
            *("exact" if exact else shown(each["order of rotation"], ".1f", "–") for each in (fast, slow)),
            *(shown(each[position], ".1e", "gave up", " m") for each in (fast, slow)),
            *(shown(fast[name] / 1e3, ".2g", "–") for name in ("ns per step", "overhead, ns")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return [*ENGINES, *sorted(lines, key=lambda line: line.startswith("| this bench"))]


@cache
def stored() -> pd.DataFrame:
    """The rows of engines."""
    return Store(DOCS.parent / "results" / "reference").rows("engines")


def known() -> list[str]:
    """Known engines with the steps of games, and the splitting of this bench beside them."""
    table = engine_figures.overview(stored())
    lines = [
        f"| {row.engine} | {row.setting} | {' | '.join(shown(row[step], '.1e', '–', ' m') for step in engine_figures.OVERVIEW)} "
        f"| {shown(row.until, '.2g', '–', ' s')} | {row.limit} |"
        for _, row in table.iterrows()
    ]
    ours = [shown(value(programs.OURS, "strang", h=h), ".1e", "–", " m") for h in engine_figures.OVERVIEW.values()]
    return [
        *KNOWN,
        *lines,
        f"| this bench | `strang`, the splitting of Touma and Wisdom | {' | '.join(ours)} | 2 s | the exact motion |",
    ]


def energies() -> list[str]:
    """What becomes of the energy in known engines, and how small their errors get."""
    table = engine_figures.tables(stored())["energy"]
    table = table[table.engine.isin(engine_figures.KNOWN) & table.setting.isin((programs.DEFAULT, programs.BEST))]
    lines = []
    for _, row in table.iterrows():
        setting = row.setting if row.integrator == row.setting else f"{row.setting}: {row.integrator}"
        growth = shown(row["exponent p"], ".1f", "–")
        cells = [row.engine, setting, row.precision, shown(row["energy gained"], ".1e", "–"), growth]
        lines.append(
            f"| {' | '.join(cells)} | {shown(row['least error'], '.1e', '–', ' m')} | 1/{1 / row['its step']:.0f} s |"
        )
    return [*ENERGIES, *lines]


def value(engine: str, kind: str, case: str = "slow", h: float = 1 / 4096, column: str = "position") -> float:
    """What is stored of a run; NaN if it gave up."""
    rows = engine_figures.runs(stored(), sweep=False)
    (found,) = rows[(rows.engine == engine) & (rows.integrator == kind) & (rows.case == case) & (rows.h == h)][column]
    return float(found)


def story() -> list[str]:
    """What the rows say, in sentences with their numbers."""
    rows = engine_figures.runs(stored(), sweep=False)
    rows = rows[(rows.status == "done") & rows.engine.ne(programs.OURS)]
    finest = rows[rows.h == rows.groupby(["case", "engine", "integrator"]).h.transform("min")]
    racket, default = finest[finest.case == "racket"], rows[rows.setting == programs.DEFAULT]
    never = racket[racket.turns_over.isna()]
    lost, without = (sorted(set(never[never.setting == word].engine)) for word in (programs.DEFAULT, programs.BEST))
    without = sorted(set(without) & set(lost))
    without += sorted(set(lost) & {name for name, engine in programs.ENGINES.items() if len(engine.integrators) == 1})
    games = default[(default.case == "slow") & (default.h == 1 / 60)]
    near = sorted(set(games[games.until >= programs.UNTIL].engine))
    far = games[games.until < programs.UNTIL].until
    family = engine_figures.families(stored())[0]
    spins = {name: 10 + value(name, "default", column="spin") for name in ("cannon-es", "PhysX", "Jolt", "Havok")}
    releases = {"3.6": "MuJoCo 3.6", "3.10": "MuJoCo 3.10", "3.17": "MuJoCo 3", "4.0": "MuJoCo"}
    box = {text: value(name, "implicitfast", "box", 1 / 60, "rotation") for text, name in releases.items()}
    rapier = [value("Rapier", "32 iterations, fast rotation", "racket", h, "rotation") for h in (1 / 60, 1 / 1024)]
    calm = [value("cannon-es", "undamped, 100 iterations", column=name) for name in ("energy", "position")]
    facts = {
        "lost": ", ".join(lost),
        "without": ", ".join(without),
        "near": ", ".join(near),
        "least": f"{far.min():.2g}",
        "most": f"{far.max():.2g}",
        "family": ", ".join(dict.fromkeys(name for name, _, _ in family)),
        "equal": f"{family[0][2][1 / 1024]:.2g}",
        "joint": f"{value('Bullet (ammo.js)', 'default', h=1 / 1024):.2g}",
        "spins": ", ".join(f"{spin:.3g} in {name}" for name, spin in spins.items()),
        "box": ", ".join(f"{error:.2g} rad in {name}" for name, error in box.items()),
        "calm": f"{calm[0]:.0e}",
        "off": f"{calm[1]:.2g}",
        "coarse": f"{rapier[0]:.2g}",
        "fine": f"{rapier[1]:.2g}",
    }
    return [line.format(**facts) for line in STORY]


def shown(number: float, form: str, none: str, unit: str = "") -> str:
    return none if pd.isna(number) else f"{number:{form}}{unit}"


TABLES = {"heavy-top.md": [references], "engines.md": [known, story, energies, sweep], "../README.md": [defaults]}


def written() -> dict[Path, str]:
    """The pages with the tables of today."""
    pages = {}
    for name, tables in TABLES.items():
        text, *blocks = (DOCS / name).read_text(encoding="utf-8").split(BEGIN)
        for table, block in zip(tables, blocks, strict=True):
            text = "\n".join((f"{text}{BEGIN}\n", *table(), f"\n{END}{block.split(END)[1]}"))
        pages[DOCS / name] = text
    return pages


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
