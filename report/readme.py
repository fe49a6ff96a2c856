"""`python -m lagrange_bench.report.readme` writes the claims, with what was measured, and the picture into README and docs."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from lagrange_bench.experiments import EXPERIMENTS, phase, work_precision
from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.integrators.files import write_file
from lagrange_bench.report import page
from lagrange_bench.report.claims import CONFIRMED, grouped
from lagrange_bench.report.origin import PUBLISHED
from lagrange_bench.results.store import Store

ROOT = Path(__file__).resolve().parents[1]
BEGIN = (
    "<!-- claims: written by `python -m lagrange_bench.report.readme`, checked by tests/test_report/test_readme.py -->"
)
PICTURE = ROOT / "docs" / "headline.svg"
TOP, SPAN = "generic", 1e4  # of the picture
END = "<!-- end of claims -->"


def six_claims(judged: list[page.Judged]) -> str:
    """The claims that have a brief sentence, as a Markdown table: the sentence, measured, required, how to reproduce it."""
    lines = ["| claim | measured | required | reproduce |", "|---|---|---|---|"]
    for each in (each for each in judged if each.claim.brief):
        verdict = "" if each.verdict.word == CONFIRMED else f" (**{each.verdict.word}**)"
        lines.append(f"| {each.claim.brief}{verdict} | {numbers(each)} | `{PUBLISHED.run(each.claim.experiment)}` |")
    return "\n".join(lines)


def all_claims(judged: list[page.Judged]) -> str:
    """Every claim, a Markdown table for each group: the sentence, measured, required, verdict, experiment."""
    lines: list[str] = []
    for group, members in grouped(judged):
        head = "| claim | measured | required | | experiment |"
        lines += ["", f"## {group.capitalize()}", "", head, "|---|---|---|---|---|"]
        for each in members:
            text = tables.numbers_in(each.claim.text).replace("|", "\\|")
            lines.append(f"| {text} | {numbers(each)} | {each.verdict.word} | `{each.claim.experiment}` |")
    return "\n".join(lines[1:])


def numbers(judged: page.Judged) -> str:
    """What was measured and what is required, in two cells of a table: a line for each bound of the claim."""
    findings = judged.verdict.findings
    return " | ".join("<br>".join(lines) for lines in zip(*((f.measured, f.required) for f in findings), strict=True))


def with_claims(text: str, made: str) -> str:
    """A document with the table between its marks written anew."""
    head, rest = text.split(BEGIN)
    _, tail = rest.split(END)
    return f"{head}{BEGIN}\n\n{made}\n\n{END}{tail}"


def documents(judged: list[page.Judged]) -> dict[Path, str]:
    """The documents that show claims, written anew."""
    made = {ROOT / "README.md": six_claims(judged), ROOT / "docs" / "claims.md": all_claims(judged)}
    return {path: with_claims(path.read_text(encoding="utf-8"), table) for path, table in made.items()}


def picture(rows: Mapping[str, pd.DataFrame]) -> str:
    """The picture as SVG, with the digest of what it shows: layouts differ between versions of Matplotlib, this does not."""
    figure = draw(rows)
    return figures.svg(figure).replace("<svg ", f'<svg data-shows="{shown(figure)}" ', 1)


def draw(rows: Mapping[str, pd.DataFrame]) -> style.Figure:
    """Error against the step on one top, and against time of computation, the same methods bold in both."""
    steps, runs = rows["phase"], rows["work_precision"]
    steps = steps[steps.state == TOP]
    good = work_precision.useful(runs[(runs.state == TOP) & (runs.span == SPAN)])
    best = phase.best_of_families(steps)
    with style.apply():
        figure, (left, right) = style.figure("page", 3.3, ncols=2)
        phase.draw_steps(left, steps, best, style)
        work_precision.draw_runs(right, good, best, style)
        left.set_title("Error against the step")
        right.set_title("Error against time of computation")
        right.set(xlabel=work_precision.WALL, ylabel=f"error at t = {tables.show(SPAN)}")
        style.label_ends([right])
    return figure


def shown(figure: style.Figure) -> str:
    """A digest of the curves in a figure, to three digits."""
    lines = [np.asarray(line.get_xydata(), dtype=float).ravel() for ax in figure.axes for line in ax.get_lines()]
    curves = [[f"{number:.2e}" for number in line] for line in lines]
    names = [[ax.get_title("left"), ax.get_xlabel(), *(text.get_text() for text in ax.texts)] for ax in figure.axes]
    return hashlib.sha256(repr((curves, names)).encode()).hexdigest()


def main() -> None:
    rows = {experiment: Store(ROOT / "results" / "reference").rows(experiment) for experiment in EXPERIMENTS}
    for path, text in documents(page.judge(rows)).items():
        print(write_file(path, text))
    print(write_file(PICTURE, picture(rows)))


if __name__ == "__main__":
    main()
