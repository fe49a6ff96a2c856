"""The documents and the docstrings are in plain English: short sentences, usual words."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "results" / "README.md", *(ROOT / "docs").rglob("*.md")])
ROOMS = ["integrators", "experiments", "results", "report", "lagrange_bench"]
LONGEST, MEAN = 40, 20  # words
UNUSUAL = r"\btold\b|\bwhoever\b|\bis said\b|, say[,.;)]|\bamong them\b|\bthereof\b|\bwherein\b|\bwhat is of\b"
RARE = r"\btold\b|\b[Ww]hoever\b|, say[.;)]|\bsay,"  # in the code
# code, formulas, tables, pictures
SKIPPED = r"^ {0,3}```.*?^ {0,3}```|<!--.*?-->|\$\$.*?\$\$|^ {4,}\S[^\n]*$|^ *\|[^\n]*$|!\[.*?\]\(.*?\)"


def sentences(text):
    """Of the running text: lists of words."""
    text = re.sub(SKIPPED, "\n\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "Code", re.sub(r"\$[^$]+\$", "formula", text))
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[-*#]|\d+\.) )", text):
        for sentence in re.split(r"(?<=[.!?:;])[*_”)]*\s+(?=[^a-z0-9])|;\s", " ".join(block.split())):
            if words := re.findall(r"[^\W\d_][\w’'-]*", sentence):
                yield words


def docstrings(source):
    """Of the module, its classes and its functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def assert_short(found):
    assert not [" ".join(words) for words in found if len(words) > LONGEST]
    assert sum(map(len, found)) <= MEAN * len(found)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short_and_words_usual(path):
    text = path.read_text(encoding="utf-8")
    assert_short(list(sentences(text)))
    assert not re.findall(UNUSUAL, re.sub(SKIPPED, "", text, flags=re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("room", ROOMS)
def test_sentences_of_docstrings_are_short(room):
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / room).rglob("*.py")]
    found = [words for source in sources for text in docstrings(source) for words in sentences(text)]
    assert found
    assert_short(found)


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_and_messages_use_usual_words(room):
    found = []
    for path in (ROOT / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found += [(path.name, node.lineno, word) for word in re.findall(RARE, node.value)]
    assert not found


def test_a_long_sentence_and_a_rare_word_are_found():
    assert [len(words) for words in sentences("A b, c. D `e` f\n\n- g h\n\n    h = 1\n")] == [3, 3, 2]
    assert len(re.findall(UNUSUAL, "take one, say, and whoever is told")) >= 3
    assert len(re.findall(RARE, "take one, say, and whoever is told")) == 3


@pytest.mark.parametrize("lengths", [[LONGEST + 1, 1, 1], [MEAN + 1, MEAN]])
def test_long_sentences_of_docstrings_are_found(lengths):
    """One that is too long, and some that are too long in the mean."""
    first, *others = [" ".join(["Word"] * n) + "." for n in lengths]
    source = f'"""{first}"""\nclass A:\n    def f(self):\n        """{" ".join(others)}"""\n'
    found = [words for text in docstrings(source) for words in sentences(text)]
    assert [len(words) for words in found] == lengths
    with pytest.raises(AssertionError):
        assert_short(found)
