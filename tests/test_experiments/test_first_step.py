"""What `check` reports of a method that cannot take a step: one fault, in one line."""

from __future__ import annotations

import re
import sys

import pytest

from lagrange_bench.experiments.measuring import check, first_step
from lagrange_bench.integrators import METHODS, registry
from lagrange_bench.integrators.registry import find_method

MINE = """\
import numpy as np

from lagrange_bench.integrators import Method
from lagrange_bench import FixedStepper, compiled


@compiled
def turned(s, push):
    return s[0] - push * s[4], s[1] + push * s[3], s[2], s[3], s[4], s[5]


@compiled
def step(s, c, tally):
    alpha, h = c[0], c[1]
    return turned(s, alpha * h)


def prepare(top, y0, h):
    return FixedStepper("mine", h, np.array((top.alpha, h)), step)


METHOD = Method(
    name="mine",
    label="mine",
    family="mine",
    order=1,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="step",
    source="here",
    prepare=prepare,
)
"""
NAME = ("turned(s, alpha * h)", "turned(s, aplha * h)")


@pytest.fixture
def word(tmp_path, monkeypatch):
    """word(old, new) -> the name of the method in a file with this change."""
    monkeypatch.chdir(tmp_path)

    def write(old, new):
        assert old in MINE
        (tmp_path / "my_first.py").write_text(MINE.replace(old, new), encoding="utf-8")
        return "my_first:METHOD"

    yield write
    sys.modules.pop("my_first", None)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (NAME, "the kernel cannot be compiled: NameError: name 'aplha' is not defined"),
        (("return FixedStepper", "FixedStepper"), "ValueError: prepare returned None: return a stepper"),
        (
            ("@compiled\ndef step", "def step"),
            "ValueError: the kernel step is not compiled: put @compiled above it ({folder}/my_first.py:18)",
        ),
    ],
    ids=["a name", "no stepper", "not compiled"],
)
def test_a_fault_is_told_once_with_its_line(word, tmp_path, change, message):
    (verdict,) = check.check(word(*change), quick=True)
    assert (verdict.claim, verdict.passed) == (check.TAKES_A_STEP, False)
    assert verdict.how == message.format(folder=tmp_path)


def test_a_sound_method_has_no_problem(word):
    name = word("order=1", "order=1")
    assert first_step.problem(find_method(name), name) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('frozenset({"J3"})', '["J3"]'), "conserves must be a set, such as frozenset({'J3'}); got ['J3']"),
        (('frozenset({"J3"})', '{"J4"}'), "conserves names unknown invariants: ['J4']"),
        (("order=1", 'order="1"'), "order must be a whole number or None; got '1'"),
        (
            ("prepare=prepare", 'prepare=prepare, needs="field"'),
            "needs must be one of uniform, rhs, ",
        ),
        (("prepare=prepare", "prepare=None"), "prepare must be a function; got None"),
        (("poisson=", "poison="), "unexpected keyword argument 'poison'; did you mean 'poisson'?"),
    ],
    ids=["list", "unknown", "order", "needs", "prepare", "keyword"],
)
def test_a_record_of_wrong_types_is_refused_by_the_field(word, change, message):
    with pytest.raises(ValueError, match=f"^method my_first:METHOD cannot be loaded: .*{re.escape(message)}"):
        find_method(word(*change))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("my_first.py:METHOD", "method my_first.py:METHOD: write my_first:METHOD"),
        ("./my_first.py", "method ./my_first.py: write my_first:METHOD"),
        ("far/my_first.py", "method far/my_first.py: write my_first:METHOD in the folder far"),
        (
            "my_frist:METHOD",
            "No module named 'my_frist'; there is no my_frist.py in {folder}; did you mean 'my_first'?",
        ),
    ],
)
def test_a_name_that_is_nearly_right(word, tmp_path, name, message):
    word("order=1", "order=1")
    with pytest.raises(ValueError, match=f"{re.escape(message.format(folder=tmp_path))}$"):
        find_method(name)


def test_a_name_that_is_taken_is_told_with_its_owner(monkeypatch):
    entry = registry.EntryPoint("mine", "their_package:METHOD", METHODS.group)
    monkeypatch.setitem(vars(METHODS), "_entries", {**METHODS._entries, "mine": entry})
    assert METHODS.owner("mine") == "the package their_package (their_package:METHOD)"
    assert METHODS.owner("rk4") == "the bench"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("    return Fixed", '    raise KeyError("boom")\n    return Fixed'), "KeyError: 'boom' ({file}:19)"),
        (("    return Fixed", "    return prepare(top, y0, h)\n    return Fixed"), "RecursionError: maximum recursion"),
        (("prepare(top, y0, h):", "prepare(top, y0):\n    h = 1"), "TypeError: prepare() takes 2 positional arguments"),
        (("    return Fixed", "    raise SystemExit(3)\n    return Fixed"), "SystemExit: 3 ({file}:19)"),
    ],
    ids=["KeyError", "RecursionError", "TypeError", "SystemExit"],
)
def test_integrate_says_of_a_failing_method_what_check_says(word, run, tmp_path, change, message):
    name, wanted = word(*change), message.format(file=tmp_path / "my_first.py")
    assert wanted in check.check(name, quick=True)[0].how
    code, out, err = run("integrate", "--method", name, "--h", "0.1", "--steps", "10")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"lagrange-bench: error: mine: {wanted}")
