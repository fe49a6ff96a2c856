"""What `check`, `integrate` and the registry say of a method that cannot take a step: one fault, in one line."""

import re

import pytest

from lagrange_bench.experiments.measuring import check, first_step
from lagrange_bench.integrators.registry import find_method

MINE = """\
from dataclasses import replace
import numpy as np
from lagrange_bench import METHODS, FixedStepper, compiled

@compiled
def turned(s, push):
    return s[0] - push * s[4], s[1] + push * s[3], s[2], s[3], s[4], s[5]

@compiled
def step(s, c, tally):
    alpha, h = c[0], c[1]
    return turned(s, alpha * h)

def prepare(top, y0, h):
    return FixedStepper("mine", h, np.array((top.alpha, h)), step)

METHOD = replace(METHODS["rk4"], name="mine", order=1, conserves=frozenset({"J3"}), prepare=prepare, needs="uniform")
"""
KEPT = 'frozenset({"J3"})'
BODY = "    return FixedStepper"


@pytest.fixture
def mine(folder):
    """mine(old, new) -> the name of the method in a file with this change."""

    def write(old="", new=""):
        assert old in MINE
        (folder / "my_first.py").write_text(MINE.replace(old, new, 1), encoding="utf-8")
        return "my_first:METHOD"

    return write


FAULTS = [  # a change of the file, and what is said
    ("alpha * h)", "aplha * h)", "the kernel cannot be compiled: NameError: name 'aplha' is not defined"),
    (BODY, "    FixedStepper", "ValueError: prepare returned None: return a stepper"),
    ("@compiled\ndef step", "def step", "the kernel step is not compiled: put @compiled above it ({file}:14)"),
    (BODY, f'    raise KeyError("boom")\n{BODY}', "KeyError: 'boom' ({file}:15)"),
    ("prepare(top, y0, h):", "prepare(top, y0):\n    h = 1", "TypeError: prepare() takes 2 positional arguments"),
    (BODY, f"    raise SystemExit(3)\n{BODY}", "SystemExit: 3 ({file}:15)"),
]


@pytest.mark.parametrize(("old", "new", "message"), FAULTS, ids=[message[-20:] for *_, message in FAULTS])
def test_a_fault_is_told_once_with_its_line(mine, run, tmp_path, old, new, message):
    name, wanted = mine(old, new), message.format(file=tmp_path / "my_first.py")
    (verdict,) = check.check(name, quick=True)
    assert (verdict.claim, verdict.passed) == (check.TAKES_A_STEP, False)
    assert wanted in verdict.how
    code, out, err = run("integrate", "--method", name, "--h", "0.1", "--steps", "10")
    assert (code in (1, 2), out, err.count("\n")) == (True, "", 1)
    assert wanted.rpartition(": ")[2].partition(" (")[0] in err


def test_an_index_beyond_the_constants_is_found(mine, tmp_path):
    """Compiled code would read what lies there."""
    told = first_step.problem(find_method(mine("c[0], c[1]", "c[0], c[7]")), "my_first:METHOD")
    assert told == f"IndexError: index 7 is out of bounds for axis 0 with size 2 ({tmp_path / 'my_first.py'}:11)"


def test_a_name_of_the_bench_is_taken(mine, run):
    assert "the bench has a method named kahan" in run("check", mine('"mine", order', '"kahan", order'), "--quick")[1]


RECORDS = [
    (KEPT, '["J3"]', "conserves must be a set"),
    (KEPT, '{"J4"}', "conserves names unknown invariants: ['J4']"),
    ("order=1", 'order="1"', "order must be a whole number or None; got '1'"),
    ('needs="uniform"', 'needs="field"', "needs must be one of uniform, rhs, "),
    ("prepare=prepare", "prepare=None", "prepare must be a function; got None"),
    ("order=1", "oder=1", "unexpected keyword argument 'oder'; did you mean 'order'?"),
]


@pytest.mark.parametrize(("old", "new", "message"), RECORDS)
def test_a_record_of_wrong_types_is_refused_by_the_field(mine, old, new, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        find_method(mine(old, new))


def test_a_name_that_is_nearly_right(mine):
    mine()
    for name in ("my_first.py:METHOD", "far/my_first.py", "my_frist:METHOD"):
        with pytest.raises(ValueError, match="my_first"):
            find_method(name)
