"""`lagrange-bench check` and `bits`: verdicts, their reasons and exit codes."""

from __future__ import annotations

import json
import re

import pytest
from test_cli import HERE

from lagrange_bench.experiments.measuring import bits, check


def test_check_a_method_that_keeps_its_word(run):
    code, out, err = run("check", "backlund", "--quick")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["verdict", "claim", "measured", "bound"]
    assert any(line.startswith("pass") and "conserves H" in line for line in lines)
    assert re.fullmatch(r"backlund \(.*/methods/backlund.py\): \d+ claims hold, 0 fail", lines[-2])
    assert lines[-1] == "next: lagrange-bench run work_precision phase --methods backlund,rk4,strang"


def test_check_a_method_that_does_not(run, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    code, out, err = run("check", "toys.lies:METHOD", "--quick", "--json")
    assert (code, err) == (1, "")
    data = json.loads(out)
    assert (data["method"], data["passed"]) == ("lies", False)
    passed = {verdict["claim"]: verdict["passed"] for verdict in data["verdicts"]}
    false = {"order 2", "symmetric", "conserves H"}
    assert {claim for claim, kept in passed.items() if kept is False} == false
    # what is true of it is not refuted, and what it does not claim is not judged
    assert passed["Poisson map"]
    assert passed["conserves J3"]
    assert passed["conserves C2"] is None


def test_check_says_why_a_claim_fails_and_with_verbose_how_every_one_was_measured(run, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setattr(check, "CHECKS", (check.symmetric, check.poisson))
    out = run("check", "toys.lies:METHOD", "--quick")[1]
    assert re.search(r"^fail: symmetric: a step and its inverse, .*; largest on \w+, h = 3$", out, re.MULTILINE)
    assert "central differences" not in out
    assert "central differences" in run("check", "toys.lies:METHOD", "--quick", "--verbose")[1]


# ---------------------------------------------------------------- bits


@pytest.fixture
def written(monkeypatch):
    """What is written down of two kernels, as this machine computes it."""
    hashes = bits.measured(1000, ["rk4", "strang"])
    monkeypatch.setattr(bits, "golden", lambda: hashes)
    return hashes


def test_bits_that_are_the_same(run, answer, written):
    code, out, err = run("bits", "rk4", "--quick", "--python")
    assert (code, err) == (0, "")
    words = [line.split() for line in out.splitlines()]
    assert ["rk4", "interpreted", "6", "same"] in words
    assert ["rk4", "compensated", "compiled", "6", "same"] in words
    assert words[-1][:3] == ["4", "the", "same,"]
    assert run("bits", "rk4", "--quick", "--quiet")[1] == "2 the same, 0 differ, 0 not written down\n"
    data = answer("bits", "strang compensated", "--quick")
    assert [verdict["kernel"] for verdict in data["verdicts"]] == ["strang compensated"]


def test_bits_that_differ_or_are_not_written_down(run, written):
    written["rk4"]["figure1 1000"] = "0"
    del written["strang"]
    code, out, err = run("bits", "rk4", "strang", "--quick")
    assert (code, err) == (1, "")
    assert re.search(r"^rk4 +compiled +6 +differs at figure1 1000$", out, re.MULTILINE)
    assert re.search(r"^strang +compiled +0 +not written down$", out, re.MULTILINE)
    assert out.splitlines()[-1] == "2 the same, 1 differ, 1 not written down"
