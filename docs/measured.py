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
from lagrange_bench.experiments import engines
from lagrange_bench.results.store import Store

DOCS = Path(__file__).parent
BEGIN, END = "<!-- measured: written by `python docs/measured.py` -->", "<!-- end of measured -->"
PUBLISHED = [
    "| program | what it publishes | t (s) | difference from the exact motion | source |",
    "|---|---|---|---|---|",
]
ENGINES = [
    "| program, version | integrator | order, `bruels` | order, `slow` | position, `bruels` | position, `slow` | µs a step "
    "| of these overhead |",
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
    table = engines.tables(Store(DOCS.parent / "results" / "reference").rows("engines"))["orders"]
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


def programs() -> list[str]:
    """The table of engines, and below them methods of the bench."""
    table, position = orders()
    lines = []
    for (engine, integrator), cases in table.groupby(["engine", "integrator"], sort=False):
        fast, slow = (cases[cases.case == case].iloc[0] for case in ("bruels", "slow"))
        own = engine == "lagrange-bench"
        setting = f" ({fast.setting})" if isinstance(fast.setting, str) and fast.setting else ""
        exact = own and METHODS[integrator].order is None
        cells = [
            f"{'this bench' if own else engine}, {fast.version}",
            f"`{integrator}`" if own else f"{integrator}{setting}",
            *("exact" if exact else shown(each["order of rotation"], ".1f", "–") for each in (fast, slow)),
            *(shown(each[position], ".1e", "gave up", " m") for each in (fast, slow)),
            *(shown(fast[name] / 1e3, ".2g", "–") for name in ("ns per step", "of these overhead")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return [*ENGINES, *sorted(lines, key=lambda line: line.startswith("| this bench"))]


def shown(number: float, form: str, none: str, unit: str = "") -> str:
    return none if pd.isna(number) else f"{number:{form}}{unit}"


TABLES = {"heavy-top.md": references, "engines.md": programs, "../README.md": defaults}


def written() -> dict[Path, str]:
    """The pages with the tables of today."""
    pages = {}
    for name, table in TABLES.items():
        head, rest = (DOCS / name).read_text(encoding="utf-8").split(BEGIN)
        pages[DOCS / name] = "\n".join((f"{head}{BEGIN}\n", *table(), f"\n{END}{rest.split(END)[1]}"))
    return pages


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
