"""Laws of the stepping interface, at drawn states and steps: of every method, in a uniform field and in others."""

# ruff: noqa: PT017, an error that is allowed is looked at where it is caught

import json
import math
import os
import random
import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lagrange_bench import METHODS, PERTURBED_TOPS, TOPS, LagrangeTop, PerturbedTop, StepError, metrics
from lagrange_bench.integrators import available, exact, integrate, prepare
from lagrange_bench.integrators.checks import keyword_options
from lagrange_bench.integrators.problem.potentials import TIDE
from tests.faults import python
from tests.installed import FOR_TOPS, installed

EPS = float(np.finfo(float).eps)
GENERIC, UNIFORM = TOPS["generic"], LagrangeTop(1.0)
STEPPING = [name for name in FOR_TOPS if METHODS[name].control == "step" and available(METHODS[name])]
TIDAL = PerturbedTop(UNIFORM, TIDE, (0.1, 0.8, 0.6, 0.0))  # other tests use it, too: it is compiled once for all
LONG = ("gauss6", "gauss8")  # to compile; the kernel is that of gauss4, with more stages
COORDINATE = st.integers(-1024, 1024).map(lambda n: n / 1024)  # nothing so small that a product of it underflows
STATES = st.tuples(*[COORDINATE] * 6).map(np.array).filter(lambda y: np.linalg.norm(y[3:]) > 0.1)
STEPS = st.floats(0.05, 0.4)
pytestmark = [
    pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning"),
    pytest.mark.xdist_group("test_contract"),  # which compiles the same kernels
]
interpreted = pytest.mark.interpreted
few = settings(max_examples=3, deadline=None, derandomize=True)


@interpreted
@pytest.mark.parametrize("name", STEPPING)
@few
@given(y=STATES, h=STEPS, length=st.integers(-200, 200), rate=st.integers(-200, 200))
def test_units_that_are_powers_of_two_change_no_bit(name, y, h, length, rate):
    """J in units of 2^rate, x in units of 2^length: alpha and h to match."""
    if name == "force_gradient6":  # it has alpha³, which must be a double
        length, rate = length // 4, rate // 4
    scale = np.ldexp(1.0, [rate] * 3 + [length] * 3)
    here = prepare(UNIFORM, y, h, name).advance(y, 4)
    top = LagrangeTop(np.ldexp(1.0, 2 * rate - length))
    there = prepare(top, y * scale, np.ldexp(h, -rate), name).advance(y * scale, 4)
    assert np.array_equal(there, here * scale)


@interpreted
@pytest.mark.parametrize("name", [name for name in STEPPING if not METHODS[name].takes(TIDAL)])
@few
@given(y=STATES, h=STEPS)
def test_a_potential_of_strength_0_is_none(name, y, h):
    n = np.array((0.8, 0.6, 0.0))
    assume(abs(n @ y[3:]) * np.linalg.norm(np.cross(n, y[3:])) > 0.05)  # else the tide moves nothing
    nothing = PerturbedTop(UNIFORM, TIDE, (0.0, *n))
    one, other, seen = (prepare(problem, y, h, name).advance(y, 5) for problem in (UNIFORM, nothing, TIDAL))
    assert metrics.scaled_error(UNIFORM, y, other, one) < 32 * EPS
    assert metrics.scaled_error(UNIFORM, y, seen, one) > 1e-6, "negative control"


LARGEST, LEAST = sys.float_info.max, 5e-324


def hard_numbers():
    """States, alphas and steps of any size."""
    yield (0.0, 0.7 * LARGEST, 0.7 * LARGEST, 0.0, 0.0, 1.0), 0.0, 1.0  # |J| is larger than a double
    yield (0.0, 0.0, 0.0, 0.0, 0.0, 1.4e147), 1.3e161, 4.5e-290  # alpha |x| is, its root is not
    yield (0.0, 0.0, 0.0, 0.7 * LARGEST, 0.0, 0.8 * LARGEST), 1.0, 1e-200  # |x| is
    yield (1.0, 0.0, 0.0, 0.0, LEAST, 0.0), LARGEST, LEAST
    yield (LEAST, 0.0, 0.0, 0.0, 0.0, LEAST), LEAST, LARGEST
    draw = random.Random("hard numbers")
    for _ in range(50):
        numbers = [math.ldexp(draw.uniform(-1, 1), draw.choice((0, draw.randint(-1073, 1024)))) for _ in range(8)]
        numbers = [number if draw.random() < 0.8 else 0.0 for number in numbers]
        yield tuple(numbers[:6]), numbers[6], numbers[7]


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in STEPPING])
def test_any_numbers_give_finite_states_or_a_named_error(name):
    for y0, alpha, h in hard_numbers():
        try:
            assert np.all(np.isfinite(integrate(LagrangeTop(alpha), y0, h, 6, every=2, method=name).y))
        except (StepError, ValueError) as error:
            assert str(error).startswith((f"{name} at h = ", "h must not be 0", "y0 has x = 0"))


JUNK = [
    *(None, True, 0, -1, 3, 2.5, 5e-324, 1e300, math.nan, math.inf, 10**400, 1 - 1j),
    *("", "Newton", b"auto", [1.0], {}, np.array([1.0, 2.0])),
    *(object(), int, np.int64(3), np.float32(0.5), np.array(3), np.datetime64("now")),
]


def attempt(name, option, value, arguments):
    """A run of the generic top with this option, or None after an error that says what is wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return integrate(GENERIC.top, GENERIC.state, method=name, **{option: value}, **arguments)
    except ValueError as error:
        assert type(error) is ValueError, f"{type(error).__name__}: {error}"
        assert re.match(rf"(unknown )?{option}\b", str(error)), str(error)
    except StepError as error:
        assert (error.method, error.h) in ((name, 0.1), (name, None)), str(error)
        assert error.reason
    return None


@interpreted
@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_option(name):
    """Whatever an option is set to: a result, or a ValueError that begins with its name; and no run that never ends."""
    record = installed(name)
    for option in record.options:
        dense = record.evaluate is not None and option in keyword_options(record.evaluate)
        for arguments in ({"h": 0.1, "steps": 3}, {"t": [0.1]})[: 1 + dense]:
            for value in JUNK:
                made = attempt(name, option, value, arguments)
                assert made is None or np.all(np.isfinite(made.y))


@pytest.mark.parametrize("name", FOR_TOPS)
def test_any_output_times(name):
    """In any order, on both sides of 0; at 0 the initial state itself, also of subnormal numbers."""
    record = installed(name)
    if record.evaluate is None:
        with pytest.raises(ValueError, match=r"^t: "):
            integrate(GENERIC.top, GENERIC.state, t=[1.0], method=name)
        return
    t = np.array([3.0, -2.0, 0.0, 3.0, 60.0, -50.0, 1e-3])
    run = integrate(GENERIC.top, GENERIC.state, t=t, method=name)
    error = metrics.scaled_error(GENERIC.top, GENERIC.state, run.y, exact.solution(GENERIC.top, GENERIC.state, t))
    assert np.max(error) < 1e-6  # RK45 at its default rtol 1e-9; the others are at round-off
    assert np.array_equal(run.y[2], GENERIC.state)
    assert np.array_equal(run.y[0], run.y[3])
    assert integrate(GENERIC.top, GENERIC.state, t=[], method=name).y.shape == (0, 6)
    for x in ((0.0, 1.0, 5e-324), (5e-324, 1.0, 0.0), (0.48, 0.6, 0.64)):
        y0 = np.array([0.0, 0.0, 0.0, *x])
        assert np.array_equal(integrate(LagrangeTop(0.5), y0, t=[0.0, 1.0], method=name).y[0], y0)


def ends():
    """The bits of the state after four steps of each method: in the uniform field, and in another of one per family."""
    bits = {}
    for label, named in {"uniform": GENERIC, "magnet": PERTURBED_TOPS["magnet"]}.items():
        h, families = 0.05 * named.top.scales(named.state)[2], set()
        for name, record in METHODS.items():
            if not available(record) or record.takes(named.top) is not None:
                continue
            if label == "uniform" or record.family not in families:
                families.add(record.family)
                bits[f"{name} {label}"] = integrate(named.top, named.state, h, 4, name).y[-1].tobytes().hex()
    return bits


@pytest.mark.processes
def test_without_compilation_each_method_has_the_same_bits():
    """Numba rearranges nothing; and no kernel leaves its arrays, for NumPy would refuse it."""
    settings = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
    code = "import json, test_laws; print(json.dumps(test_laws.ends()))"
    done = python("-c", code, env=settings, cwd=Path(__file__).parent, timeout=300)
    assert done.returncode == 0, done.stderr
    interpreted = json.loads(done.stdout)
    assert len(interpreted) > len(STEPPING)
    assert interpreted == ends()
