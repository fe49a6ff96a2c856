"""Check the formulas of a section of the paper.

For readers of the paper that the Bäcklund methods come from. Evaluate the formulas of a section, in their corrected form, along
the orbit of a named top, and list by how much each fails. Without a section, list the sections.

examples:
  lagrange-bench paper                          the sections
  lagrange-bench paper two-point                two parameters that are independent
  lagrange-bench paper flow --top figure1
  lagrange-bench paper separation --json | jq .residuals

The formulas are functions of lagrange_bench.integrators.paper. docs/equations.md lists them by equation, and
lagrange-bench errata lists the misprints.

exit codes: 0 done · 1 a formula fails by more than is allowed · 2 bad input, or the section does not apply to this top
"""

import argparse
from typing import Any

from lagrange_bench.commands.arguments import refuse
from lagrange_bench.support.output import Answer, table


def add_options(command: argparse.ArgumentParser) -> None:
    text = "a section such as flow; without one they are listed"
    command.add_argument("section", nargs="?", metavar="SECTION", help=text)
    command.add_argument("--top", metavar="NAME", help="a named top (default: generic)")


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.experiments import paper_sections
    from lagrange_bench.integrators import TOPS
    from lagrange_bench.support.words import suggestion

    known = paper_sections.SECTIONS
    if options.section is None:
        refuse(options, ("top",), f"belongs to a SECTION: {', '.join(known)}")
        lines = [("section", "in the paper", "what it shows")]
        lines += [(name, number, paper_sections.title(name)) for name, (number, _) in known.items()]
        data = [{"name": name, "number": number, "title": title} for name, number, title in lines[1:]]
        return Answer("\n".join(table(lines)), data)
    top = options.top or "generic"
    for word, names, kind in ((options.section, known, "section"), (top, TOPS, "top")):
        if word not in names:
            raise ValueError(f"unknown {kind} {word!r}{suggestion(word, list(names))} Known: {', '.join(names)}")
    named = TOPS[top]
    defects = known[options.section][1](named.top, named.state)
    rows: list[Any] = [("formula", "misses by", "allowed", "")]
    for name, (defect, allowed) in defects.items():
        rows.append((name, f"{defect:.1e}", f"{allowed:.0e}", "" if defect <= allowed else "too much"))
    good = all(defect <= allowed for defect, allowed in defects.values())
    residuals = {name: {"found": defect, "allowed": allowed} for name, (defect, allowed) in defects.items()}
    answer = {"section": options.section, "top": top, "residuals": residuals}
    return Answer("\n".join(table(rows)), answer, 0 if good else 1)
