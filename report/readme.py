"""`python -m report.readme`: writes the claims, with what was found, into the README between its two marks, and its picture."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from experiments import EXPERIMENTS, phase, work_precision
from experiments.drawing import figures, style, tables
from integrators.files import write_file
from report import page
from results.store import Store

ROOT = Path(__file__).resolve().parents[1]
BEGIN = "<!-- claims: written by `python -m report.readme`, checked by tests/test_report/test_readme.py -->"
PICTURE = ROOT / "docs" / "headline.svg"
TOP, SPAN = "generic", 1e4  # of the picture
END = "<!-- end of claims -->"
WORDS = {True: "holds", False: "**refuted**", None: "no data"}


def claims_table(results: Path) -> str:
    """The claims as a Markdown table: sentence, what was found, bound, verdict, experiment."""
    lines = ["| claim | found | bound | | experiment |", "|---|---|---|---|---|"]
    rows = {experiment: Store(results).rows(experiment) for experiment in EXPERIMENTS}
    for judged in page.judge(rows)[0]:
        verdict = judged.verdict
        found, bound = ("" if v is None else tables.show(v) for v in (verdict.value, verdict.bound))
        found += f" ({verdict.over})" if verdict.over else ""
        text = tables.numbers_in(judged.claim.text).replace("|", "\\|")
        lines.append(f"| {text} | {found} | {bound} | {WORDS[verdict.passed]} | `{judged.claim.experiment}` |")
    return "\n".join(lines)


def with_claims(readme: str, results: Path) -> str:
    """The README with its claims written anew."""
    head, rest = readme.split(BEGIN)
    _, tail = rest.split(END)
    return f"{head}{BEGIN}\n\n{claims_table(results)}\n\n{END}{tail}"


def picture(results: Path) -> str:
    """The picture as SVG, with the digest of what it shows: layouts differ between versions of Matplotlib, this does not."""
    figure = draw(results)
    return figures.svg(figure).replace("<svg ", f'<svg data-shows="{shown(figure)}" ', 1)


def draw(results: Path) -> style.Figure:
    """Error against the step on one top, and against time of computation, the same methods bold in both."""
    steps, runs = (Store(results).rows(name) for name in ("phase", "work_precision"))
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
    path = ROOT / "README.md"
    text = with_claims(path.read_text(encoding="utf-8"), ROOT / "results" / "reference")
    print(write_file(path, text))
    print(write_file(PICTURE, picture(ROOT / "results" / "reference")))


if __name__ == "__main__":
    main()
