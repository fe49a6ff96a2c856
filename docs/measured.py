"""Writes the tables of docs/heavy-top.md, docs/engines.md and, of programs, README.md: python docs/measured.py.

In heavy-top.md stand published numbers (docs/published.toml) beside the exact motion, in the others the stored rows of the
experiment `engines`. tests/test_docs.py compares.
"""

import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, Case, RigidBody, judge
from lagrange_bench.experiments.drawing import tables
from lagrange_bench.experiments.engines import figures, programs
from lagrange_bench.results.store import REFERENCE, Store

DOCS = Path(__file__).parent
BEGIN, END = "<!-- measured: written by `python docs/measured.py` -->", "<!-- end of measured -->"


def table(head: str, rows: Iterable[Iterable[str]]) -> list[str]:
    """A Markdown table. head : the names of the columns, with bars between them."""
    return [f"| {head} |", "|---" * (head.count("|") + 1) + "|", *(f"| {' | '.join(cells)} |" for cells in rows)]


def differences(reference: dict[str, Any]) -> str:
    """What the numbers of one reference are off by."""
    case, t = reference["case"], [reference["t"]]
    if isinstance(case, dict):  # a free body that has no name here
        body = RigidBody(1.0, (0, 0, 0), case["inertia_com"], (0, 0, 0))
        case = Case("", body, (1, 0, 0, 0), case["omega_body"])
    else:
        case = CASES[case]
    exact, texts = case.solution(t), []
    if "displacement" in reference:
        moved = judge(t, position=case.solution([0.0]).position + reference["displacement"], case=case)
        texts.append(f"{moved.position.max:.1e} m")
    if "quaternion" in reference:
        texts.append(f"{judge(t, rotation=[reference['quaternion']], case=case).rotation.max:.1e} rad")
    if "mrp" in reference:
        texts.append(f"{judge(t, rotation=Rotation.from_mrp([reference['mrp']]), case=case).rotation.max:.1e} rad")
    if "omega_body_degrees" in reference:
        off = np.degrees(exact.omega_body[0]) - reference["omega_body_degrees"]
        texts.append(f"{np.linalg.norm(off):.1e} °/s")
    if "omega_y_world" in reference:
        texts.append(f"{abs(exact.rotation.apply(exact.omega_body)[0, 1] - reference['omega_y_world']):.0e} rad/s")
    if "energy" in reference:
        energy = case.body.energy_of(exact.rotation, exact.omega_body)[0]
        texts.append(f"{abs(energy - reference['energy']):.1e} J")
    return ", ".join(texts)


def references() -> list[str]:
    """The table of published numbers."""
    rows = [
        (each["program"], each["what"], f"{each['t']:g}", differences(each), f"{each['source']} ({each['looked_up']})")
        for each in tomllib.loads((DOCS / "published.toml").read_text(encoding="utf-8"))["reference"]
    ]
    return table("program | what it publishes | t (s) | difference from the exact motion | source", rows)


@cache
def stored() -> pd.DataFrame:
    """The rows of engines."""
    return Store(REFERENCE).rows("engines")


def defaults() -> list[str]:
    """The table of programs in the README: how far each is off by default → as its documents advise, first on `slow`.

    It has the programs with both. Of two defaults it has the one of the same kind as the advice: the last.
    """
    errors = figures.tables(stored())["orders"].rename(columns={"position, h = 1/1024": "position"})
    lines = []
    for engine, rows in errors.groupby("engine", sort=False):
        chosen = [rows[rows.setting == programs.WORDS[setting]] for setting in (programs.DEFAULT, programs.BEST)]
        if any(each.empty for each in chosen):
            continue
        shown_rows = pd.concat([each.groupby("case").tail(1) for each in chosen])
        cells = []
        for case in ("slow", "bruels"):
            of_case = shown_rows[shown_rows.case == case]
            is_worse = of_case.position.iloc[1] > of_case.position.iloc[0]
            texts = " → ".join(shown(error) for error in of_case.position)
            cells.append(f"{texts} ({programs.ENGINES[engine].worse})" if is_worse else texts)
        lines.append([figures.title(engine, rows.version.iloc[0]), " → ".join(of_case.integrator), *cells])
    splitting = errors[errors.integrator == "strang"].set_index("case").position
    lines.append(["this bench", "`strang`", *(shown(splitting[case]) for case in ("slow", "bruels"))])
    return table("program | default → as its documents advise | 10 rad/s (m) | 150 rad/s (m)", lines)


def known() -> list[str]:
    """Known engines, with the steps of games and of robots."""
    heads = {"engine": "program", "until": "within 10 cm for, s", "limit": "smaller steps lead to"}
    heads |= {name: f"error at {name}, m" for name in figures.OVERVIEW}
    return tables.markdown(figures.overview(stored()).rename(columns=heads)).splitlines()


def scripts() -> list[str]:
    """Two of the files that run engines, whole."""
    texts = [(programs.HERE / f"{name}_run.py").read_text(encoding="utf-8") for name in ("mujoco", "rapier")]
    return ["\n".join(["```py", text.rstrip(), "```", ""]) for text in texts]


def story() -> list[str]:
    """What the rows say, in sentences with their numbers."""
    rows = figures.runs(stored(), sweep=False)
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
    twice = sorted(set(near) & set(games[games.until < programs.UNTIL].engine))  # engines with two defaults
    other_default = f", and {' and '.join(twice)} with another default," if twice else ""
    releases = {"3.6": "MuJoCo 3.6", "3.10": "MuJoCo 3.10", "3.17": "MuJoCo 3", "4.0": "MuJoCo"}
    box = (
        rows[(rows.case == "box") & (rows.integrator == "implicitfast") & (rows.h == 1 / 60)]
        .set_index("engine")
        .rotation
    )
    return [
        f"1. **Many engines leave out the gyroscopic torque ω × Iω by default**: {', '.join(lost)}. In them `racket` never "
        f"turns over, whatever the step. No option for it was found in {', '.join(without)}.",
        f"2. **With default settings and steps of 1/60 s** these stay within 10 cm for 2 s on `slow`: {', '.join(near)}. "
        f"The others{other_default} do so for {far.min():.2g} to {far.max():.2g} s.",
        "3. **A release can change the motion**: with MuJoCo's recommended integrator, implicitfast, and 1/60 s the rotation "
        f"of `box` is off by {', '.join(f'{box[name]:.2g} rad in {text}' for text, name in releases.items())}.",
    ]


def shown(error: float) -> str:
    return "gave up" if pd.isna(error) else f"{error:.2g}"


TABLES = {"heavy-top.md": [references], "engines.md": [known, story, scripts], "../README.md": [defaults]}


def written() -> dict[Path, str]:
    """The pages with the tables of today."""
    pages = {}
    for name, makers in TABLES.items():
        text, *blocks = (DOCS / name).read_text(encoding="utf-8").split(BEGIN)
        for make, block in zip(makers, blocks, strict=True):
            text = "\n".join((f"{text}{BEGIN}\n", *make(), f"\n{END}{block.split(END)[1]}"))
        pages[DOCS / name] = text
    return pages


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
