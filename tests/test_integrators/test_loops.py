"""The time loop: pins, records and interruptions leave no trace in the bits."""

import math

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, StepError, prepare
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import FAILURE, RESIDUAL, FixedStepper
from tests.faults import interrupted

GENERIC = TOPS["generic"]
Y0 = GENERIC.state


@jit
def count(s, c, tally):
    """x1 counts the steps; fails when it reaches c[0]."""
    if s[3] == c[0]:
        tally[FAILURE] = 1
        tally[RESIDUAL] = 0.125
    return s[0], s[1], s[2], s[3] + 1.0, s[4], s[5]


@jit
def mark(s, c):
    """x2 counts the pins; x3 sums the steps at which they fell."""
    return s[0], s[1], s[2], s[3], s[4] + 1.0, s[5] + s[3]


def counter(fails_at=-1.0, block=1 << 62, pins=True):
    return FixedStepper(
        "count", 0.5, np.array([fails_at]), count, mark if pins else None, block, failures={1: "told to"}
    )


START = np.array([0.0, 0, 0, 0, 0, 1])


def test_pins_fall_before_multiples_of_block():
    assert counter(block=8).advance(START, 20)[3:].tolist() == [20, 3, 1 + 0 + 8 + 16]
    assert counter(block=8).advance(START, 16)[3:].tolist() == [16, 2, 1 + 0 + 8]
    assert counter(block=8, pins=False).advance(START, 20)[3:].tolist() == [20, 0, 1]


@pytest.mark.parametrize("every", [1, 5, 20])
def test_a_recorded_run_has_the_same_pins(every):
    rows = counter(block=8).record(START, 20, every)
    assert rows[:, 3].tolist() == list(range(0, 21, every))
    assert rows[:, 4].tolist() == [math.ceil(n / 8) for n in range(0, 21, every)]
    assert rows[-1, 3:].tolist() == [20, 3, 1 + 0 + 8 + 16]


@pytest.mark.parametrize("stride", [1, 8, 1000])
def test_dividing_a_run_changes_nothing(stride, monkeypatch):
    stepper = prepare(GENERIC.top, Y0, 0.1)  # pinned every 8 steps
    end, rows = stepper.advance(Y0, 1003), stepper.record(Y0, 1000, 25)
    monkeypatch.setattr(loops, "INTERRUPTIBLE", stride)
    assert np.array_equal(stepper.advance(Y0, 1003), end)
    assert np.array_equal(stepper.record(Y0, 1000, 25), rows)


@pytest.mark.parametrize("stride", [4, 1 << 20])
def test_a_failure_says_where(stride, monkeypatch):
    monkeypatch.setattr(loops, "INTERRUPTIBLE", stride)
    stepper = counter(fails_at=13.0)
    for call in (lambda: stepper.advance(START, 40), lambda: stepper.record(START, 40, 5)):
        with pytest.raises(StepError, match=r"count at h = 0.5, step 13: told to \(residual 1.2e-01\)"):
            call()
    assert stepper.work.steps == 0  # what was not returned is not counted
    assert counter(fails_at=13.0).advance(START, 13)[3] == 13


def test_not_finite_is_never_returned():
    with pytest.raises(StepError, match="the state left the range of floating-point numbers in this step or before it"):
        counter().advance(np.full(6, np.nan), 3)


@pytest.mark.parametrize(
    ("name", "record"), [("backlund", False), ("implicit_midpoint", True), ("taylor", False), ("rk45", True)]
)
def test_control_c_ends_a_long_run(name, record):
    if name == "taylor":
        pytest.importorskip("heyoka")
    stepper = prepare(GENERIC.top, Y0, 0.1, name)
    stepper.advance(Y0, 1)
    n = 10**11
    with interrupted():
        stepper.record(Y0, n, n // 4) if record else stepper.advance(Y0, n)
