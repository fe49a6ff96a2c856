"""`python -m lagrange_bench.report.readme` writes what was measured, and the picture, into README and docs."""

import hashlib
import re
from pathlib import Path

import numpy as np

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.drawing import figures, style, tables
from lagrange_bench.integrators import TOPS, integrate
from lagrange_bench.integrators.truth import exact
from lagrange_bench.report import page
from lagrange_bench.report.claims import CONFIRMED, grouped
from lagrange_bench.results.store import REFERENCE, Store
from lagrange_bench.support.files import write_file

ROOT = Path(__file__).resolve().parents[2]
BEGIN = (
    "<!-- claims: written by `python -m lagrange_bench.report.readme`, checked by tests/test_report/test_readme.py -->"
)
PICTURE = Path(__file__).with_name("exact-step.svg")
SHARE = 0.45  # of a nutation: the step of the picture
END = "<!-- end of claims -->"


def answers(judged: list[page.Judged], count: int | None = None) -> str:
    """The questions that claims answer, or the first `count` of them, as a Markdown table."""
    lines = ["| question | answer |", "|---|---|"]
    for question, text, each in page.in_brief(judged)[:count]:
        verdict = "" if each.verdict.word == CONFIRMED else f" (**{each.verdict.word}**)"
        lines.append(f"| {question} | {text}{verdict} |")
    return "\n".join(lines)


def all_claims(judged: list[page.Judged]) -> str:
    """Every claim, a Markdown table for each group: its first sentence, measured, required, experiment."""
    lines: list[str] = []
    for group, members in grouped(judged):
        lines += [
            "",
            f"## {group.capitalize()}",
            "",
            "| claim | measured | required | experiment |",
            "|---|---|---|---|",
        ]
        for each in members:
            first = re.split(r"(?<=[.]) ", each.claim.text, maxsplit=1)[0]
            text = tables.numbers_in(first).replace("|", "\\|")
            verdict = "" if each.verdict.word == CONFIRMED else f" (**{each.verdict.word}**)"
            lines.append(f"| {text}{verdict} | {numbers(each)} | `{each.claim.experiment}` |")
    return "\n".join(lines[1:])


def numbers(judged: page.Judged) -> str:
    """What was measured and what is required, in two cells of a table: a line for each bound of the claim."""
    findings = judged.verdict.findings
    return " | ".join("<br>".join(lines) for lines in zip(*((f.measured, f.required) for f in findings), strict=True))


def with_claims(text: str, table: str) -> str:
    """A document with the table between its marks written anew."""
    head, rest = text.split(BEGIN)
    _, tail = rest.split(END)
    return f"{head}{BEGIN}\n\n{table}\n\n{END}{tail}"


def documents(judged: list[page.Judged]) -> dict[Path, str]:
    """The documents that show claims, written anew."""
    docs = ROOT / "docs"
    contents = {
        ROOT / "README.md": answers(judged),
        docs / "paper.md": answers(judged, count=3),
        docs / "claims.md": all_claims(judged),
    }
    return {path: with_claims(path.read_text(encoding="utf-8"), table) for path, table in contents.items()}


def picture() -> str:
    """The picture as SVG, with the digest of what it shows: layouts differ between versions of Matplotlib, this does not."""
    figure = draw()
    return figures.svg(figure).replace("<svg ", f'<svg data-shows="{shown(figure)}" ', 1)


def draw(ours: str = "backlund", other: str = "strang") -> style.Figure:
    """The axis from above after each of 24 steps (rings), and two methods (dots); the other takes four steps for one of ours."""
    named = TOPS["generic"]
    h, steps = SHARE * exact.nutation_period(named.top, named.state), 24
    orbit = exact.solution(named.top, named.state, np.linspace(0, steps * h, 3000))[:, 3:5].T
    truth = exact.solution(named.top, named.state, h * np.arange(steps + 1))[:, 3:5].T
    with style.apply():
        figure, panels = style.figure("page", 2.8, ncols=2, sharey=True)
        colors = style.of(ours)["color"], "#D55E00"
        for ax, method, finer, color in zip(panels, (ours, other), (1, 4), colors, strict=True):
            run = integrate(named.top, named.state, h=h / finer, steps=finer * steps, every=finer, method=method)
            states = run.y[:, 3:5].T
            ax.plot(*orbit, color="#c4c4c4", linewidth=0.6)
            ax.plot(*truth, "o", color=style.INK, markersize=8, fillstyle="none", markeredgewidth=0.7)
            ax.plot(*np.stack((truth, states), axis=1), color=color, linewidth=0.9)
            ax.plot(*states, "o", color=color, markersize=4)
            ax.set(aspect="equal", xticks=[], yticks=[])
            ax.spines[:].set_visible(False)
        panels[0].set_title("The exact step is in every ring", color=colors[0], fontsize=11)
        panels[1].set_title("Strang’s four short steps are not", color=colors[1], fontsize=11)
        legend = "The axis of a top,\nfrom above.\nRings: where it is.\nDots: where the\nmethod has it."
        middle = {"ha": "center", "va": "center", "transform": panels[0].transAxes, "linespacing": 1.4, "fontsize": 10}
        panels[0].text(0.5, 0.5, legend, **middle)
    return figure


def shown(figure: style.Figure) -> str:
    """A digest of the curves in a figure, to three digits."""
    lines = [np.asarray(line.get_xydata(), dtype=float).ravel() for ax in figure.axes for line in ax.get_lines()]
    curves = [[f"{number:.2e}" for number in line] for line in lines]
    names = [[ax.get_title("left"), ax.get_xlabel(), *(text.get_text() for text in ax.texts)] for ax in figure.axes]
    return hashlib.sha256(repr((curves, names)).encode()).hexdigest()


def main() -> None:
    rows = {experiment: Store(REFERENCE).rows(experiment) for experiment in EXPERIMENTS}
    for path, text in documents(page.judge(rows)).items():
        print(write_file(path, text))
    print(write_file(PICTURE, picture()))


if __name__ == "__main__":
    main()
