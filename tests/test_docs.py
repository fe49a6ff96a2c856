"""What the documents show is what happens: their code runs, their links resolve, their commands exist."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from lagrange_bench import __main__ as cli
from lagrange_bench.experiments import EXPERIMENTS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
NOTEBOOK = DOCS / "notebook" / "the-top.ipynb"


# ---------------------------------------------------------------- running a page


def script(path: Path):
    """A file of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


outputs = script(DOCS / "outputs.py")


LONG = ("pose-your-own-problem", "a-top-in-a-field", "a-long-run", "an-ensemble")  # they compile or draw much
LONG += ("reading-figures", "read-the-paper-with-the-code", "your-own-figures")
MARKED = [pytest.param(page, marks=[pytest.mark.slow] * (page.stem in LONG)) for page in outputs.PAGES]


@pytest.mark.parametrize("page", MARKED, ids=lambda page: page.stem)
def test_pages_print_what_they_show(page, folder):
    """If this fails: python docs/outputs.py, and read what changed."""
    for block, printed in outputs.execute(page):
        where = f"{page.name}, line {block.line}"
        if block.shown is not None:
            assert printed.rstrip() == block.shown.rstrip(), where
        elif block.kind == "python":
            assert bool(printed.strip()) == block.varies, f"{where}: prints what is not shown"
    shown = re.findall(r"\]\(pictures/([\w-]+\.svg)\)", page.read_text(encoding="utf-8"))
    assert sorted(shown) == sorted(file.name for file in folder.glob("*.svg") if file.name in shown), (
        "it draws what it shows"
    )


def test_a_page_that_lies_is_found_out(folder):
    page = folder / "page.md"
    page.write_text(
        "```python\nx = 1\nprint(x + 1)\n```\n\n```text\n3\n```\n\n```python\nx / 0\n```\n", encoding="utf-8"
    )
    (first, second) = outputs.blocks(page.read_text(encoding="utf-8"))
    assert (first.shown, second.shown, second.line) == ("3\n", None, 10)
    with pytest.raises(ZeroDivisionError) as caught:
        outputs.execute(page)
    assert caught.traceback[-1].lineno + 1 == 11
    page.write_text("```sh\nlagrange-bench methods --no-such-option\n```\n", encoding="utf-8")
    with pytest.raises(AssertionError, match="no-such-option"):
        outputs.execute(page)


def test_the_table_of_published_references_is_computed():
    """If this fails: python docs/published.py, and read what changed."""
    published = script(DOCS / "published.py")
    assert published.written() == published.PAGE.read_text(encoding="utf-8")


# ---------------------------------------------------------------- links and commands


def slug(heading: str) -> str:
    """The anchor a forge makes of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@cache
def commands() -> dict[str, set[str]]:
    """Every command with its options, as argparse knows them; "" for the program itself."""
    top = cli.parser()
    (sub,) = (action for action in top._actions if action.dest == "==SUPPRESS==" or hasattr(action, "_name_parser_map"))
    parsers = {"": top, **sub.choices}
    return {name: {o for action in p._actions for o in action.option_strings} for name, p in parsers.items()}


def unknown(text: str) -> list[str]:
    """What a page says of `lagrange-bench` that is not so."""
    known, wrong = commands(), []
    for mention in re.findall(r"lagrange-bench +([^`\n|&#…]*)", text):
        words = re.findall(r"\S+", mention)
        if not words or not re.fullmatch(r"-?-?[a-z]\w*", words[0]):
            continue  # no command: prose, or a placeholder
        command = words[0] if not words[0].startswith("-") else ""
        wrong += [] if command in known else [words[0]]
        for word in words:
            if re.match(r"--?[a-z]", word) and word.partition("=")[0].rstrip(".,;:)") not in known.get(command, ()):
                wrong.append(f"{command} {word}")
        if command == "run":
            named = [w for w in words[1:2] if re.fullmatch(r"[a-z_]+", w)]
            wrong += [f"run {w}" for w in named if w not in EXPERIMENTS and w not in ("my_study",)]
    everything = set().union(*known.values())
    for option in re.findall(r"`(--[a-z][\w-]*)[^`]*`", text):
        wrong += [] if option in everything else [option]
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_resolve_and_commands_exist(page):
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    for path, anchor in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)#?([^)\s]*)\)", prose):
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), path
        headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), re.MULTILINE) if anchor else ()
        assert not anchor or anchor in map(slug, headings), (path, anchor)
    assert unknown(text) == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^ +|^)make (\w+)(?:`| {2,}|$)", text, re.MULTILINE):
        assert f"\n{target}:" in makefile, target
    for test in re.findall(r"`(?:test_\w+\.)?(test_\w+)`", text):
        assert any(f"def {test}(" in code for code in sources()) or (ROOT / "tests" / f"{test}.py").exists(), test
    for file in re.findall(r"`((?:tests|experiments|integrators|report|docs)/[\w/.-]+)`", text):
        assert (ROOT / file).exists(), file


@cache
def sources() -> list[str]:
    return [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]


def test_an_unknown_command_is_found_out():
    assert unknown("`lagrange-bench run drift --profile full` and `lagrange-bench --version`") == []
    assert unknown(
        "    lagrange-bench dance\n`lagrange-bench run drift --fast`, `lagrange-bench run drfit`, `--no-such`"
    ) == ["dance", "run --fast", "run drfit", "--no-such"]


# ---------------------------------------------------------------- reference


@pytest.mark.processes
@pytest.mark.skipif(importlib.util.find_spec("pdoc") is None, reason="needs pdoc: pip install 'lagrange-bench[docs]'")
@pytest.mark.slow
def test_the_reference_is_written_without_a_warning(tmp_path):
    """In a process of its own, in which kernels are Python functions. No page asks the network for anything."""
    words = [sys.executable, str(DOCS / "reference.py"), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert {"integrators.html", "exact.html", "two_point.html", "drift.html"} <= {page.name for page in pages}
    for page in pages:
        fetched = re.findall(
            r"(?:src=|<link[^>]*href=|url\(|@import )[\"']?https?://[^\"')\s]+", page.read_text(encoding="utf-8")
        )
        assert fetched == [], page.name


# ---------------------------------------------------------------- the paper


def test_the_paper_names_figures_that_exist_and_programs_that_are_missing(monkeypatch, capsys):
    paper = script(DOCS / "paper.py")
    named = [name for name, _ in paper.FIGURE.findall(paper.PAGE.read_text(encoding="utf-8"))]
    assert len(named) > 3
    assert all(name.partition("_")[0] in EXPERIMENTS for name in named)
    monkeypatch.setattr(paper.shutil, "which", lambda program: None)
    monkeypatch.setattr(sys, "argv", ["paper.py"])
    with pytest.raises(SystemExit) as caught:
        paper.main()
    assert caught.value.code == 2
    assert re.search("not installed: apt-get install pandoc texlive-xetex", capsys.readouterr().err)


# ---------------------------------------------------------------- the notebook


def test_the_notebook_shows_what_its_source_does():
    """Cells as in the source, texts as when run, one picture for each figure. If not: python docs/notebook/build.py."""
    import matplotlib.pyplot as plt

    build = script(NOTEBOOK.with_name("build.py"))
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert NOTEBOOK.stat().st_size < 300_000
    assert (stored["nbformat"], stored["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in stored["cells"]}) == len(stored["cells"])
    assert [(cell["cell_type"], "".join(cell["source"])) for cell in stored["cells"]] == build.cells()
    plt.close("all")  # of tests before this one
    try:
        fresh = build.notebook()
    finally:
        plt.close("all")
    for old, new in zip(stored["cells"], fresh["cells"], strict=True):
        kinds = [[o["output_type"] for o in cell.get("outputs", [])] for cell in (old, new)]
        assert kinds[0] == kinds[1]
        texts = [[o["text"] for o in cell.get("outputs", []) if "text" in o] for cell in (old, new)]
        assert texts[0] == texts[1]


def test_the_least_versions_are_those_that_are_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = [Requirement(text) for text in project["dependencies"]]
    asked += [Requirement(text) for texts in project["optional-dependencies"].values() for text in texts]
    lines = (ROOT / "tests" / "oldest.txt").read_text("utf-8").splitlines()
    pinned = dict(line.lower().split("==") for line in lines if not line.startswith("#"))
    least = {r.name.lower(): s.version for r in asked for s in r.specifier if s.operator == ">="}
    untested = {
        "ruff",
        "mypy",
        "import-linter",
        "numpydoc",
        "mujoco",
        "exudyn",
    }  # `make lint` and `engines` take the newest
    assert least.keys() - untested == pinned.keys()
    for name, version in pinned.items():
        assert Version(least[name]) == Version(version), name
