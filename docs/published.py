"""Writes the table of published references into docs/heavy-top.md: python docs/published.py.

The numbers are those of docs/published.toml, the errors those against the exact motion. tests/test_docs.py compares.
"""

import tomllib
from pathlib import Path
from typing import Any

from lagrange_bench import CASES, judge

DOCS = Path(__file__).parent
PAGE = DOCS / "heavy-top.md"
BEGIN, END = "<!-- published: written by `python docs/published.py` -->", "<!-- end of published -->"
HEAD = ["| program | what it publishes | t (s) | difference from the exact motion | source |", "|---|---|---|---|---|"]


def differences(reference: dict[str, Any]) -> str:
    """What the numbers of one reference are off by."""
    case, t = CASES[reference["case"]], [reference["t"]]
    exact, found = case.solution(t), []
    if "displacement" in reference:
        moved = judge(t, position=case.solution([0.0]).position + reference["displacement"], case=case)
        found.append(f"{moved.position.max:.1e} m")
    if "quaternion" in reference:
        found.append(f"{judge(t, rotation=[reference['quaternion']], case=case).rotation.max:.1e} rad")
    if "omega_y_world" in reference:
        found.append(f"{abs(exact.rotation.apply(exact.omega_body)[0, 1] - reference['omega_y_world']):.0e} rad/s")
    if "energy" in reference:
        energy = case.top.energy(exact.rotation, exact.omega_body)[0]
        found.append(f"{abs(energy - reference['energy']):.1e} J")
    return ", ".join(found)


def table() -> str:
    """The table in Markdown."""
    rows = list(HEAD)
    for each in tomllib.loads((DOCS / "published.toml").read_text(encoding="utf-8"))["reference"]:
        source = f"{each['source']} ({each['looked_up']})"
        rows.append(f"| {each['program']} | {each['what']} | {each['t']:g} | {differences(each)} | {source} |")
    return "\n".join(rows)


def written() -> str:
    """The page with the table of today."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return f"{head}{BEGIN}\n\n{table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(written(), encoding="utf-8")
