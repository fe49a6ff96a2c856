"""Runs the code of the documents, and writes below each block what it prints: python docs/outputs.py.

Every ```python block of a tutorial is executed, all of a page in one namespace and an empty folder, and so is every
line of an ```sh block. A block ```text directly below shows what is printed, as `agree` compares it; ```text varies
shows what differs from machine to machine. A block that starts with `# name.py` or `# name.toml` is that file. What a
page saves as NAME.svg or NAME.gif and shows goes to docs/pictures.

A part of every reference run, on the same machine and with nothing else running, for the times that pages show: see
results/README.md. `tests/test_docs.py` holds the pages to what they show.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import sys
import tempfile
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import matplotlib

from lagrange_bench import __main__ as cli

DOCS = Path(__file__).parent
GUIDES = ("gallery", "phase-theory", "reading-figures", "your-own-figures")
PAGES = [
    *sorted((DOCS / "tutorials").glob("*.md")),
    *sorted(DOCS.glob("adding-*.md")),
    *(DOCS / f"{name}.md" for name in GUIDES),
]
PICTURES = DOCS / "pictures"  # what pages save and show
REPEATABLE = {"svg.hashsalt": "lagrange-bench", "svg.fonttype": "none"}
# Numbers up to this one are round-off of errors and invariants of order one: they differ from processor to processor.
ROUND_OFF = 1e-12
NUMBER = re.compile(r"([-+−]?(?:\d+\.\d*|\.\d+|\d+)(?:e[-+]?\d+)?)")
FENCED = re.compile(r"^```(\w+(?: \w+)?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """One fenced block: its language with what follows it, its text, the line it starts on, what is shown below it."""

    kind: str
    text: str
    line: int
    shown: str | None = None  # None: nothing, or what varies
    varies: bool = False
    place: tuple[int, int] | None = None  # of what is shown, in the page


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page, each with the ```text block directly below it."""
    found: list[Block] = []
    end = 0
    for match in FENCED.finditer(page):
        kind, text = match.groups()
        if kind.startswith("text"):
            assert not page[end : match.start()].strip(), f"output of nothing: {text!r}"
            varies = kind == "text varies"
            found.append(found.pop()._replace(shown=None if varies else text, varies=varies, place=match.span(2)))
        else:
            found.append(Block(kind, text, page.count("\n", 0, match.start()) + 1))
        end = match.end()
    return found


def agree(printed: str, shown: str) -> bool:
    """Whether two texts say the same: words and integers to the letter, other numbers to the last digit that is shown.

    Two numbers at round-off agree. White space does not count: a column is as wide as its numbers.
    """
    printed_parts, shown_parts = NUMBER.split(printed), NUMBER.split(shown)
    if [text.split() for text in printed_parts[::2]] != [text.split() for text in shown_parts[::2]]:
        return False
    return all(map(_same_number, printed_parts[1::2], shown_parts[1::2]))


def _same_number(printed: str, shown: str) -> bool:
    a, b = (Decimal(text.replace("−", "-")) for text in (printed, shown))
    if max(abs(a), abs(b)) <= ROUND_OFF:
        return True
    if not {".", "e"} & {*printed, *shown}:
        return printed == shown
    last_digit = min(10.0 ** int(number.as_tuple().exponent) for number in (a, b))
    return float(abs(a - b)) <= max(1.01 * last_digit, ROUND_OFF * abs(float(b)))


def execute(page: Path) -> list[tuple[Block, str]]:
    """Runs the blocks of a page in the current folder; what each printed."""
    scope: dict = {"__name__": "__main__"}
    done = []
    for block in blocks(page.read_text(encoding="utf-8")):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            if file := re.match(r"# ([\w/]+\.(?:py|toml))\n", block.text):
                Path(file[1]).parent.mkdir(exist_ok=True)
                Path(file[1]).write_text(block.text, encoding="utf-8")
            elif block.kind == "python":  # empty lines in front, so that a traceback names the line of the page
                exec(compile("\n" * block.line + block.text, str(page), "exec"), scope)
            elif block.kind == "sh":
                for line in filter(None, block.text.splitlines()):
                    program, *words = shlex.split(line, comments=True)
                    assert program == "lagrange-bench", f"{page.name}: only lagrange-bench is run; `console` is not"
                    assert cli.main(words) == 0, line
        done.append((block, printed.getvalue()))
    return done


def refreshed(page: Path) -> str:
    """The page with what its blocks print now, in the current folder. What agrees with the page stays as it is."""
    text = page.read_text(encoding="utf-8")
    for block, printed in reversed(execute(page)):  # from the end, so that places stay right
        if block.place is not None and not (block.shown is not None and agree(printed, block.shown)):
            text = text[: block.place[0]] + printed.rstrip() + "\n" + text[block.place[1] :]
    return text


def main() -> None:
    """Of all pages, or of those whose names are given."""
    matplotlib.use("svg")
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")
    for page in [page for page in PAGES if page.stem in sys.argv[1:] or not sys.argv[1:]]:
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), matplotlib.rc_context(REPEATABLE):
            sys.path.insert(0, folder)
            text = refreshed(page)
            sys.path.remove(folder)
            for file in Path(folder).iterdir():
                if file.suffix in (".svg", ".gif") and f"pictures/{file.name}" in text:
                    shutil.copy(file, PICTURES)
        if text != page.read_text(encoding="utf-8"):
            page.write_text(text, encoding="utf-8")
            print(page.relative_to(DOCS.parent))


if __name__ == "__main__":
    main()
