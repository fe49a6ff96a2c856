"""The tape: what it folds, its derivatives, and the time loop: failures and interruptions."""

import mpmath
import numpy as np
import pytest

from lagrange_bench import TOPS, FixedStepper, Kernel, StepError, compiled, prepare
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import FUNCTIONS, apply, machine_code
from lagrange_bench.integrators.compiling.loops import FAILURE, RESIDUAL
from lagrange_bench.integrators.compiling.tape import Tape, record
from lagrange_bench.integrators.methods import dop853, taylor
from tests.faults import interrupted
from tests.installed import installed


def test_products_of_constants_are_taken_only_where_nothing_is_rounded():
    """2 (a/2) is a, 3 (a/5) stays."""
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


GENERIC = TOPS["generic"]
Y0 = GENERIC.state


@jit
def count(s, c, counters):
    """x1 counts the steps; fails when it reaches c[0]."""
    if s[3] == c[0]:
        counters[FAILURE] = 1
        counters[RESIDUAL] = 0.125
    return s[0], s[1], s[2], s[3] + 1.0, s[4], s[5]


START = np.array([0.0, 0, 0, 0, 0, 1])


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


def test_a_failure_says_where(monkeypatch):
    monkeypatch.setattr(loops, "INTERRUPTIBLE", 4)
    stepper = FixedStepper("count", 0.5, Kernel(count, failures={1: "told to"}), np.array([13.0]))
    for call in (lambda: stepper.advance(START, 40), lambda: stepper.record(START, 40, 5)):
        with pytest.raises(StepError, match=r"count at h = 0.5 \(own unit\), step 13: told to \(residual 1.2e-01\)"):
            call()
    assert stepper.advance(START, 13)[3] == 13
    assert stepper.work.steps == 13  # what was not returned is not counted


@pytest.mark.parametrize(
    ("name", "record"), [("backlund", False), ("taylor", False), ("implicit_midpoint", True), ("rk45", True)]
)
def test_control_c_ends_a_long_run(name, record):
    installed(name)
    stepper, n = prepare(GENERIC.top, Y0, 0.1, name), 10**11
    stepper.advance(Y0, 1)  # compiled
    with interrupted():
        stepper.record(Y0, n, n // 4) if record else stepper.advance(Y0, n)
