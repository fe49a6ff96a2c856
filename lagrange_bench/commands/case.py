"""Named motions of rigid bodies, with their exact solution as a CSV file.

For those who test a program that follows rigid bodies, in any language. A case is a body with its start. Without a NAME the
command lists the cases. With a NAME it writes the exact motion: centre of mass, quaternion, rotation matrix and angular velocity
at equal distances in time, in SI units.

With --code it writes a file of C or Python that gives the same motion at any time. The file needs no library: put it into the
tests of your program.

Up to 17 digits come from doubles, and the last one or two are round-off. More digits, up to 40, come from a Taylor series in
integers, which takes some seconds for a hundred turns. Lines that begin with # explain the columns.
pandas.read_csv("ref.csv", comment="#") reads the file; before pandas 3.1 add float_precision="round_trip".

examples:
  lagrange-bench case --verbose
  lagrange-bench case bruels --until 2 --every 0.1 --output ref.csv
  lagrange-bench case metis --digits 25
  lagrange-bench case box --code c --output box.c
"""

import argparse
from fractions import Fraction
from typing import Any

from lagrange_bench.commands.arguments import in_range, location, positive, refuse
from lagrange_bench.support.output import Answer, table

MOST_ROWS = 10**7  # 4 GB of text
DOUBLE = 17  # digits from which a double can be read back exactly


def run(options: argparse.Namespace) -> Answer:
    from lagrange_bench.integrators import CASES
    from lagrange_bench.integrators.cases.standalone import standalone
    from lagrange_bench.judging import find
    from lagrange_bench.support.files import replace_file

    if options.name is None:
        words = ("until", "every", "digits", "code", "output")
        refuse(options, words, f"belongs to the NAME of a case: {', '.join(CASES)}")
        lines = table([("name", "title", "until"), *((c.name, c.title, f"{c.until:g} s") for c in CASES.values())])
        for case in CASES.values() if options.verbose else ():
            lines += ["", f"{case.name}: {case.source}", "", case.remarks]
        words = ("name", "title", "until", "source", "remarks")
        return Answer("\n".join(lines), [{word: getattr(case, word) for word in words} for case in CASES.values()])
    case = find(options.name)
    data: dict[str, Any]
    if options.code is None:
        rows = rows_of(case, options.until, options.every, options.digits or DOUBLE)
        text = "\n".join((*head(case), *rows, ""))
        data = {"columns": head(case)[-1].split(","), "rows": [row.split(",") for row in rows]}
    else:
        refuse(options, ("until", "every", "digits"), "is for rows; --code gives the motion at any time")
        text = standalone(case, options.code, facts(case))
        data = {"language": options.code, "text": text}
    if options.output is not None:
        text, data = replace_file(options.output, text), {"file": str(options.output)}
    return Answer(text.rstrip("\n"), {"case": case.name, **data})


def facts(case: Any) -> list[str]:
    """Two lines: the case, its body and start."""
    import numpy as np

    top, start = case.body, f"start: omega {np.asarray(case.omega_body, dtype=float).tolist()} rad/s"
    body = f"mass {top.mass} kg, com {top.com.tolist()} m, gravity {top.gravity.tolist()} m/s^2, inertia about the com"
    if not top.fixed:
        start += f", position {case.state[7:10].tolist()} m, velocity {case.state[10:].tolist()} m/s"
    title = f"{case.name}: {case.title}" if case.title else case.name
    return [f"{title}; lagrange-bench", f"{body} {top.inertia_com.tolist()} kg m^2, {start}"]


def head(case: Any) -> list[str]:
    """The lines above the rows: comments, and the names of the columns."""
    from lagrange_bench.integrators.cases import COLUMNS, CONVENTIONS

    conventions = CONVENTIONS if case.body.fixed else CONVENTIONS.replace(", from the fixed point", "")
    return [f"# {line}" for line in (*facts(case), *conventions.splitlines())] + [COLUMNS]


def rows_of(case: Any, until: Fraction | None, every: Fraction | None, digits: int) -> list[str]:
    """The rows as lines of text; times are exact decimals."""
    end, gap = until or Fraction(f"{case.until}"), every or Fraction(f"{case.every}")
    if end / gap >= MOST_ROWS:
        raise ValueError(f"--every {float(gap):g} gives more than {MOST_ROWS} rows up to --until {float(end):g}")
    times = [k * gap for k in range(int(end / gap) + 1)]
    if digits > DOUBLE:
        return [",".join(f"{v:f}" for v in row) for row in case.digits(times, digits)]
    numbers = case.doubles([float(t) for t in times])[:, 1:].tolist()
    start = (f"{float(t):.15g}" for t in times)
    return [",".join((t, *(f"{v + 0.0:.{digits}g}" for v in row))) for t, row in zip(start, numbers, strict=True)]


def add_options(command: argparse.ArgumentParser) -> None:
    time = in_range(Fraction, 1e-15, 1e9, "a positive number of seconds such as 0.1, at most 10^9")
    settings: dict[str, Any] = {"type": time, "metavar": "SECONDS"}
    text = "the case, mine.toml, or module:CASE; without it they are listed"
    command.add_argument("name", nargs="?", metavar="NAME", help=text)
    command.add_argument("--verbose", action="store_true", help="also print sources and remarks")
    command.add_argument("--until", help="last time (default: as the case says)", **settings)
    command.add_argument("--every", help="time between two rows (default: as the case says)", **settings)
    command.add_argument("--digits", type=positive, metavar="N", help="of each number (default: 17)")
    text = "one file that gives the motion at any time, in this language"
    command.add_argument("--code", choices=("c", "python"), help=text)
    command.add_argument("--output", type=location, metavar="FILE", help="write here (default: stdout)")
