"""`python -m report.readme`: writes the claims, with what was found, into the README between its two marks, and its picture."""

from __future__ import annotations

from pathlib import Path

from experiments import EXPERIMENTS
from experiments.store import Store
from report import export, page, tables

ROOT = Path(__file__).resolve().parents[1]
BEGIN = "<!-- claims: written by `python -m report.readme`, checked by tests/test_readme.py -->"
PICTURE = "phase_h"
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


def main() -> None:
    path = ROOT / "README.md"
    text = with_claims(path.read_text(encoding="utf-8"), ROOT / "results" / "reference")
    print(page.write_file(path, text))
    print(export.export(PICTURE, ROOT / "results" / "reference", ROOT / "docs" / "headline.svg"))


if __name__ == "__main__":
    main()
