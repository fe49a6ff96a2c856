"""Run a section of the paper: a picture and the residuals.

For readers of the paper that the Bäcklund methods come from. Evaluate the formulas of a section, in their corrected form, along
the orbit of a named top. Draw a picture, and list by how much each formula fails. Without a section, list the sections.

examples:
  lagrange-bench paper                          the sections
  lagrange-bench paper two-point                two parameters that are independent; writes paper-two-point.svg
  lagrange-bench paper flow --top figure1 --output flow.pdf
  lagrange-bench paper separation --json | jq .residuals

The formulas are functions of lagrange_bench.integrators.paper. docs/equations.md lists them by equation, and
lagrange-bench errata lists the misprints.

exit codes: 0 done · 1 a formula fails by more than is allowed · 2 bad input, or the section does not apply to this top
"""

import argparse
from pathlib import Path
from typing import Any

from lagrange_bench.commands.arguments import location
from lagrange_bench.support.output import PICTURES, Answer, check_target, table


def add_options(command: argparse.ArgumentParser) -> None:
    text = "a section such as flow; without one they are listed"
    command.add_argument("section", nargs="?", metavar="SECTION", help=text)
    command.add_argument("--top", metavar="NAME", help="a named top (default: generic)")
    text = "the picture, .svg, .pdf or .png (default: paper-SECTION.svg)"
    command.add_argument("--output", type=location, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments import paper_sections
    from lagrange_bench.experiments.drawing import figures
    from lagrange_bench.integrators import TOPS
    from lagrange_bench.support.words import suggestion

    known = paper_sections.SECTIONS
    if options.section is None:
        if options.top or options.output:
            raise ValueError(f"{'--top' if options.top else '--output'} belongs to a SECTION: {', '.join(known)}")
        listed = [("section", "in the paper", "what it shows")]
        listed += [(name, number, paper_sections.title(name)) for name, (number, _) in known.items()]
        data = [{"name": name, "number": number, "title": title} for name, number, title in listed[1:]]
        return Answer("\n".join(table(listed)), data)
    top = options.top or "generic"
    for word, names, what in ((options.section, known, "section"), (top, TOPS, "top")):
        if word not in names:
            raise ValueError(f"unknown {what} {word!r}{suggestion(word, list(names))} Known: {', '.join(names)}")
    path = options.output or Path(f"paper-{options.section}.svg")
    check_target("--output", path, PICTURES)
    named = TOPS[top]
    shown = paper_sections.show(options.section, named.top, named.state)
    done = figures.write(path, shown.figure)
    rows: list[Any] = [("formula", "misses by", "allowed", "")]
    for name, (defect, allowed) in shown.residuals.items():
        rows.append((name, f"{defect:.1e}", f"{allowed:.0e}", "" if defect <= allowed else "too much"))
    good = all(defect <= allowed for defect, allowed in shown.residuals.values())
    residuals = {name: {"found": defect, "allowed": allowed} for name, (defect, allowed) in shown.residuals.items()}
    answer = {"section": options.section, "top": top, "written": str(path), "residuals": residuals}
    text = [*table(rows), "", shown.figure.caption]
    return Answer("\n".join(text), answer, 0 if good else 1, [done])
