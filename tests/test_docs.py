"""What the documents show is what happens: code runs, links resolve, commands exist; and docstrings say all parameters."""

import importlib.util
import inspect
import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import lagrange_bench
from lagrange_bench import __main__ as cli
from lagrange_bench.experiments import EXPERIMENTS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
TESTS = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]


def script(path: Path):
    """A file of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


outputs = script(DOCS / "outputs.py")
LONG = ("pose-your-own-problem", "a-top-in-a-field", "a-long-run", "an-ensemble")  # they compile or draw much
LONG += ("reading-figures", "read-the-paper-with-the-code", "your-own-figures")
MARKED = [pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else []) for page in outputs.PAGES]


@pytest.mark.parametrize("page", MARKED, ids=lambda page: page.stem)
def test_pages_print_what_they_show(page, folder):
    """If this fails: python docs/outputs.py, and read what changed."""
    for block, printed in outputs.execute(page):
        where = f"{page.name}, line {block.line}"
        if block.shown is not None:
            assert printed.rstrip() == block.shown.rstrip() or outputs.agree(printed, block.shown), where
        elif block.kind == "python":
            assert bool(printed.strip()) == block.varies, f"{where}: prints what is not shown"
    shown = re.findall(r"\]\(pictures/([\w-]+\.\w+)\)", page.read_text(encoding="utf-8"))
    assert set(shown) <= {file.name for file in folder.iterdir()}, "it draws what it shows"


AGREE = [  # what is printed, what is shown, and whether they agree
    ("energy  2.84e-14\nx", "energy 0.0\nx", True),
    ("error 3.2e-12", "error 1.1e-12", False),  # above round-off
    ("error 1.78e-05", "error 1.77e-05", True),
    ("error 1.78e-05", "error 1.75e-05", False),
    ("x3 = 0.6400000000000001", "x3 = 0.64", True),
    ("x3 = 0.6312345678901234", "x3 = 0.64", False),
    ("1000 steps", "1001 steps", False),
    ("energy −1.25", "energy 1.25", False),
    ("energy 1e-15", "momentum 1e-15", False),
]


@pytest.mark.parametrize(("printed", "shown", "same"), AGREE)
def test_numbers_at_round_off_are_not_compared(printed, shown, same):
    assert outputs.agree(printed, shown) is same


def test_a_page_that_lies_is_found_out(folder):
    page = folder / "page.md"
    text = "```python\nx = 1\nprint(x + 1)\n```\n\n```text\n3\n```\n\n```python\nx / 0\n```\n"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(ZeroDivisionError) as caught:
        outputs.execute(page)
    assert caught.traceback[-1].lineno + 1 == 11
    page.write_text("```sh\nlagrange-bench methods --no-such-option\n```\n", encoding="utf-8")
    with pytest.raises(AssertionError, match="no-such-option"):
        outputs.execute(page)


def test_the_tables_of_what_was_measured_are_computed():
    """If this fails: python docs/measured.py, and read what changed."""
    for path, text in script(DOCS / "measured.py").written().items():
        assert outputs.agree(text, path.read_text(encoding="utf-8")), path


@cache
def commands() -> dict[str, set[str]]:
    """Every command with its options, as argparse knows them; "" for the program itself."""
    top = cli.parser()
    (sub,) = (action for action in top._actions if hasattr(action, "_name_parser_map"))
    return {name: set(parser._option_string_actions) for name, parser in {"": top, **sub.choices}.items()}


def unknown(text: str) -> list[str]:
    """What a page says of `lagrange-bench` that is not so."""
    known = commands()
    everything = set().union(*known.values())
    wrong = [option for option in re.findall(r"`(--[a-z][\w-]*)[^`]*`", text) if option not in everything]
    for command, words in re.findall(r"lagrange-bench +((?:[a-z]\w*)?)(?!\w)([^`\n|&#…]*)", text):
        wrong += [] if command in known else [command]
        options = re.findall(r"(?<!\S)--?[a-z][\w-]*", words)
        wrong += [f"{command} {option}" for option in options if option not in known.get(command, ())]
        experiments = re.findall(r"^ ([a-z_]+)(?!\S)", words) if command == "run" else ()
        wrong += [f"run {name}" for name in experiments if name not in (*EXPERIMENTS, "my_study")]
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_resolve_and_commands_exist(page):
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    for path, anchor in re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)#?([^)\s]*)\)", prose):
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), path
        headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), re.MULTILINE) if anchor else ()
        anchors = {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings}
        assert {anchor} - {""} <= anchors, path
    assert unknown(text) == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^ +|^)make (\w+)(?:`| {2,}|$)", text, re.MULTILINE):
        assert f"\n{target}:" in makefile, target
    for test in re.findall(r"`(?:test_\w+\.)?(test_\w+)`", text):
        assert any(f"def {test}(" in code for code in TESTS) or (ROOT / "tests" / f"{test}.py").exists(), test
    for file in re.findall(r"`((?:tests|experiments|integrators|report|docs)/[\w/.-]+)`", text):
        assert (ROOT / file).exists(), file


def test_the_least_versions_are_those_that_are_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = [Requirement(text) for text in project["dependencies"]]
    asked += [Requirement(text) for texts in project["optional-dependencies"].values() for text in texts]
    lines = (ROOT / "tests" / "oldest.txt").read_text("utf-8").splitlines()
    pinned = dict(line.lower().split("==") for line in lines if not line.startswith("#"))
    least = {r.name.lower(): s.version for r in asked for s in r.specifier if s.operator == ">="}
    newest = {"ruff", "mypy", "import-linter", "numpydoc", "mujoco", "exudyn"}  # of `make lint` and of `engines`
    assert least.keys() - newest == pinned.keys()
    assert [name for name in pinned if Version(least[name]) != Version(pinned[name])] == []


# no docstring; parameters that are missing, unknown, without a type or a description; no description of what is returned
ASKED = {"GL08", "PR01", "PR02", "PR04", "PR07", "PR10", "RT01", "RT03"}
BRIEF = ("sin", "cos", "exp", "log", "Stepper")  # the first four as `sqrt`; a protocol has no parameters of its own
RESULTS = ("Trajectory", "EnsembleTrajectory", "Comparison")  # what a user gets: their methods count, too


def functions():
    for name in lagrange_bench.__all__:
        item = getattr(lagrange_bench, name)
        if callable(item) and name not in BRIEF:
            yield f"{item.__module__}.{item.__qualname__}"
        if name in RESULTS:
            words = (word for word, _ in inspect.getmembers(item, inspect.isfunction) if word[0] != "_")
            yield from (f"{item.__module__}.{name}.{word}" for word in words)


def test_docstrings_say_parameters_and_results():
    # with Sphinx: collecting the tests does not wait for it; with the oldest packages it is not there
    validate = pytest.importorskip("numpydoc.validate").validate

    errors = {name: [text for code, text in validate(name)["errors"] if code in ASKED] for name in functions()}
    assert len(errors) > 50
    assert {name: texts for name, texts in errors.items() if texts} == {}
