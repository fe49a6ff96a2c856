"""docs/exact-step.md as LaTeX and PDF, with its figures drawn from the stored rows: `make print`.

Needs pandoc and a TeX with xelatex, from the system. The figures are those of paragraphs that begin with
**Figure** (`lagrange-bench figure NAME`): the rest of the paragraph is the caption.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

from lagrange_bench.experiments.drawing.tables import TEX_MATH

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "exact-step.md"
OUTPUT = ROOT / "build" / "exact-step"
NEEDED = {"pandoc": "pandoc", "xelatex": "texlive-xetex texlive-latex-recommended texlive-fonts-recommended lmodern"}
FIGURE = re.compile(r"^\*\*Figure\*\* \(`lagrange-bench figure (\w+)`\): (.*)$", re.MULTILINE)
LETTERS = {**TEX_MATH, "Σ": r"\Sigma", "∎": r"\blacksquare"}  # outside of formulas, where the text font lacks them
HEADER = r"""\usepackage{amssymb}
\emergencystretch=3em
\pretolerance=400
"""


def figures(text: str, folder: Path) -> str:
    """The page with its figures drawn as PDF into the folder, and shown."""
    from lagrange_bench.report import export

    def shown(match: re.Match[str]) -> str:
        name, caption = match.groups()
        (path,), *_ = export.export(name, ROOT / "results" / "reference", folder / f"{name}.pdf", "pdf", "page")
        return f"![{caption}]({path.relative_to(folder.parent).as_posix()}){{width=100%}}"

    return FIGURE.sub(shown, text)


def walk(node: Any, function: Any) -> Any:
    """The tree of pandoc with `function` applied to every element, the inner ones first."""
    if isinstance(node, list):
        return [walk(part, function) for part in node]
    if not isinstance(node, dict):
        return node
    return function({key: walk(value, function) for key, value in node.items()})


def element(node: dict[str, Any]) -> dict[str, Any]:
    """Links into the repository lose their targets; names in code may be broken; Greek letters become formulas."""
    kind, content = node.get("t"), node.get("c")
    if kind == "Link" and not content[2][0].startswith("http"):
        return {"t": "Span", "c": [["", [], []], content[1]]}
    if kind == "Code":
        text = re.sub(r"([_&%#$])", r"\\\1", content[1])
        return raw(r"\texttt{" + re.sub(r"(\\_|[./])", r"\1\\allowbreak{}", greek(text)) + "}")
    if kind == "Str" and any(letter in content for letter in LETTERS):
        return raw(greek(re.sub(r"([_&%#$])", r"\\\1", content)))
    return node


def raw(text: str) -> dict[str, Any]:
    return {"t": "RawInline", "c": ["latex", text]}


def greek(text: str) -> str:
    return "".join(rf"\ensuremath{{{LETTERS[c]}}}" if c in LETTERS else c for c in text)


def pandoc(*words: str, text: str) -> str:
    done = subprocess.run(["pandoc", *words], input=text, capture_output=True, text=True, encoding="utf-8", check=False)
    if done.returncode:
        raise SystemExit(f"make print: pandoc failed: {done.stderr.strip()}")
    return done.stdout


def latex(text: str) -> str:
    """A LaTeX document of a page; its first heading is the title."""
    words = "-f", "markdown-fancy_lists-example_lists", "-t", "json", "--shift-heading-level-by=-1"
    tree = json.loads(pandoc(*words, text=text))
    tree = walk(tree, element)
    variables = ["-V", "documentclass=article", "-V", "fontsize=11pt", "-V", "geometry:margin=2.6cm"]
    variables += ["-V", "header-includes=" + HEADER]
    return pandoc("-f", "json", "-t", "latex", "--standalone", *variables, text=json.dumps(tree))


def main() -> None:
    """exact-step.tex, exact-step.pdf and the figures in OUTPUT."""
    if missing := [packages for program, packages in NEEDED.items() if shutil.which(program) is None]:
        raise SystemExit(f"make print: not installed: apt-get install {' '.join(missing)}")
    (OUTPUT / "figures").mkdir(parents=True, exist_ok=True)
    text = figures(PAGE.read_text(encoding="utf-8"), OUTPUT / "figures")
    tex = OUTPUT / "exact-step.tex"
    tex.write_text(latex(text), encoding="utf-8")
    for _ in range(2):  # the second run knows the numbers of the first
        words = ["xelatex", "-interaction=nonstopmode", "-halt-on-error", tex.name]
        done = subprocess.run(words, cwd=OUTPUT, capture_output=True, text=True, errors="replace", check=False)
        if done.returncode:
            wrong = [line for line in done.stdout.splitlines() if line.startswith("!")]
            raise SystemExit(f"make print: xelatex failed: {' '.join(wrong)} (see {tex.with_suffix('.log')})")
    log = tex.with_suffix(".log").read_text(encoding="utf-8", errors="replace")
    if lost := sorted(set(re.findall(r"Missing character: There is no (\S+)", log))):
        raise SystemExit(f"make print: the font lacks {' '.join(lost)}: add them to LETTERS here")
    print(tex, tex.with_suffix(".pdf"), sep="\n")


if __name__ == "__main__":
    main()
