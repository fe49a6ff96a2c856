"""The tape: what it folds, its derivatives, kernels that know the time; and the time loop: pins, records, interruptions."""

import math

import mpmath
import numpy as np
import pytest

from lagrange_bench import TOPS, FixedStepper, StepError, compiled, prepare
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import FUNCTIONS, apply, machine_code
from lagrange_bench.integrators.compiling.loops import CLOCK, FAILURE, RESIDUAL
from lagrange_bench.integrators.compiling.tape import Tape, record
from lagrange_bench.integrators.methods import dop853, taylor
from tests.faults import interrupted
from tests.installed import installed


def test_nothing_is_collected_that_would_be_rounded_elsewhere():
    """Without fixed inputs only exact products of constants: 2 (a/2) is a, 3 (a/5) stays."""
    assert record(lambda a: (2.0 * (a / 2.0), 3.0 * (a / 5.0)), 1).outputs[0] == 0
    assert len(record(lambda a: (3.0 * (a / 5.0),), 1).lines) == 2


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_has_the_same_value_and_derivative_everywhere(name):
    tape = Tape()
    x = tape.input()
    value = apply(name, x * x + 0.5)
    program = tape.program((value, *tape.gradient(value, [x]), *tape.along([value], [x], [1.0])))
    a = 0.83
    exact = [
        getattr(mpmath, name)(mpmath.mpf(a) ** 2 + 0.5),
        mpmath.diff(lambda v: getattr(mpmath, name)(v * v + 0.5), a),
    ]
    wanted = np.array([exact[0], exact[1], exact[1]], float)
    code = machine_code(program)
    in_a_kernel = compiled(lambda v: code((v,), ()))(a)
    for got in (program(a), program(np.float64(a)), program(mpmath.mpf(a)), in_a_kernel):
        assert np.allclose(np.array(got, float), wanted, rtol=1e-15)
    assert np.allclose(np.array(program(np.full(3, a))), wanted[:, None], rtol=1e-15)
    heyoka = pytest.importorskip("heyoka")
    v = heyoka.make_vars("v")
    assert np.allclose(heyoka.cfunc(list(program(v)), [v])([a]), wanted, rtol=1e-15)


def test_a_timed_kernel_of_any_size_counts_its_steps():
    """y1' = t by midpoints is exact: nothing adds up but the states."""

    @compiled
    def step(s, c, counters):
        return s[0] + c[0] * (c[0] * (counters[CLOCK] + 0.5)), s[1] - 1.0

    stepper = FixedStepper("mine", 0.25, np.array((0.25,)), step, size=2, timed=True)
    rows = stepper.record(np.array((0.0, 8.0)), 8, 2)
    assert np.array_equal(rows, [((0.5 * k) ** 2 / 2, 8.0 - 2 * k) for k in range(5)])
    assert stepper.from_start
    with pytest.raises(ValueError, match="y must be 2 finite real numbers"):
        stepper.advance([1.0, 2.0, 3.0], 1)


GENERIC = TOPS["generic"]
Y0 = GENERIC.state


@jit
def count(s, c, counters):
    """x1 counts the steps; fails when it reaches c[0]."""
    if s[3] == c[0]:
        counters[FAILURE] = 1
        counters[RESIDUAL] = 0.125
    return s[0], s[1], s[2], s[3] + 1.0, s[4], s[5]


@jit
def mark(s, c):
    """x2 counts the pins; x3 sums the steps at which they fell."""
    return s[0], s[1], s[2], s[3], s[4] + 1.0, s[5] + s[3]


def counter(fails_at=-1.0, block=1 << 62):
    return FixedStepper("count", 0.5, np.array([fails_at]), count, mark, block, failures={1: "told to"})


START = np.array([0.0, 0, 0, 0, 0, 1])


@pytest.mark.parametrize("every", [1, 5, 20])
def test_pins_fall_before_multiples_of_a_block_recorded_or_not(every):
    rows, end = counter(block=8).record(START, 20, every), counter(block=8).advance(START, 20)
    assert np.array_equal(rows[-1], end)
    assert rows[:, 3].tolist() == list(range(0, 21, every))
    assert rows[:, 4].tolist() == [math.ceil(n / 8) for n in range(0, 21, every)]
    assert rows[-1, 3:].tolist() == [20, 3, 1 + 0 + 8 + 16]


@pytest.mark.parametrize(
    ("name", "module", "stride"),
    [*(("backlund", loops, stride) for stride in (1, 8, 1000)), ("dop853", dop853, 3), ("taylor", taylor, 7)],
)
def test_dividing_a_run_changes_nothing(name, module, stride, monkeypatch):
    """The exact step is pinned every 8 steps."""
    installed(name)
    stepper = prepare(GENERIC.top, Y0, 0.1, name)
    end, rows, steps = stepper.advance(Y0, 1003), stepper.record(Y0, 1000, 25), stepper.work.steps
    monkeypatch.setattr(module, "INTERRUPTIBLE", stride)
    assert np.array_equal(stepper.advance(Y0, 1003), end)
    assert np.array_equal(stepper.record(Y0, 1000, 25), rows)
    assert stepper.work.steps == 2 * steps


@pytest.mark.parametrize("stride", [4, 1 << 20])
def test_a_failure_says_where(stride, monkeypatch):
    monkeypatch.setattr(loops, "INTERRUPTIBLE", stride)
    stepper = counter(fails_at=13.0)
    for call in (lambda: stepper.advance(START, 40), lambda: stepper.record(START, 40, 5)):
        with pytest.raises(StepError, match=r"count at h = 0.5 \(own unit\), step 13: told to \(residual 1.2e-01\)"):
            call()
    assert stepper.work.steps == 0  # what was not returned is not counted
    assert counter(fails_at=13.0).advance(START, 13)[3] == 13


@pytest.mark.parametrize(
    ("name", "record"), [("backlund", False), ("taylor", False), ("implicit_midpoint", True), ("rk45", True)]
)
def test_control_c_ends_a_long_run(name, record):
    installed(name)
    stepper, n = prepare(GENERIC.top, Y0, 0.1, name), 10**11
    stepper.advance(Y0, 1)  # compiled
    with interrupted():
        stepper.record(Y0, n, n // 4) if record else stepper.advance(Y0, n)
