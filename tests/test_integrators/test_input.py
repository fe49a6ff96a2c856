"""Bad input: one ValueError, raised before anything is computed, whose message names the argument."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagrange_bench.experiments.measuring import states
from lagrange_bench.integrators import (
    METHODS,
    PERTURBED_TOPS,
    TOPS,
    HeavyTop,
    LagrangeTop,
    StepError,
    Stepper,
    Work,
    integrate,
    integrate_ensemble,
    prepare,
    two_point,
)
from lagrange_bench.integrators.truth import exact
from tests.installed import FOR_TOPS, installed

TOP = LagrangeTop(1.0)
Y0 = TOPS["generic"].state
NAN, INF = float("nan"), float("inf")

STATES = [
    ("five numbers", Y0[:5]),
    ("seven numbers", [*Y0, 1.0]),
    ("a column", Y0[:, None]),
    ("two states", np.stack((Y0, Y0))),
    ("nothing", []),
    ("a number", 1.0),
    ("None", None),
    ("ragged", [[1.0], [1.0, 2.0]]),
    ("words", ["a"] * 6),
    ("digits in words", ["1"] * 6),
    ("booleans", [True] * 6),
    ("complex", Y0 + 0j),
    ("objects", np.array([1, 2, 3, 4, 5, None], dtype=object)),
    ("a dict", {"J": 1}),
    ("NaN", [NAN, *Y0[1:]]),
    ("infinity", [*Y0[:5], INF]),
    ("no axis", [*Y0[:3], 0.0, 0.0, 0.0]),
    ("an axis of −0", [*Y0[:3], -0.0, 0.0, 0.0]),
]
STEPS = [
    0,
    0.0,
    -0.0,
    NAN,
    INF,
    -INF,
    "0.1",
    b"1",
    None,
    True,
    1j,
    [0.1],
    np.array([0.1, 0.2]),
    np.datetime64("now"),
    10**400,
]
COUNTS = [-1, 1.0, "1", None, True, np.float64(3), NAN, [1], np.bool_(True)]
ALPHAS = [NAN, INF, -INF, "1", b"1", None, True, np.bool_(True), 1j, np.complex128(1), [1.0], 10**400]


def refused(match, call, *args, **kwargs):
    """One ValueError with this beginning, without a warning, and not while handling another."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=match) as caught:
            call(*args, **kwargs)
    assert type(caught.value) is ValueError
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return str(caught.value)


# ---------------------------------------------------------------- the common arguments


@pytest.mark.parametrize(("label", "y0"), STATES, ids=[label for label, _ in STATES])
def test_states(label, y0):
    refused(r"^y0 ", integrate, TOP, y0, 0.1, 10)
    refused(r"^y0 ", integrate, TOP, y0, t=[1.0])
    refused(r"^y0 ", prepare, TOP, y0, 0.1)
    refused(r"^y ", two_point, TOP, y0, 1j)


@pytest.mark.parametrize("h", STEPS, ids=lambda v: repr(v)[:30])
def test_steps_in_time(h):
    refused(r"^h ", prepare, TOP, Y0, h)
    if h is not None:  # None: h was not given
        refused(r"^h ", integrate, TOP, Y0, h, 10)


@pytest.mark.parametrize("n", COUNTS, ids=repr)
def test_counts(n):
    if n is not None:
        refused(r"^steps ", integrate, TOP, Y0, 0.1, n)
        refused(r"^every ", integrate, TOP, Y0, 0.1, 10, every=n)


def test_every():
    refused(r"^every ", integrate, TOP, Y0, 0.1, 10, every=0)
    assert "does not divide steps = 10" in refused(r"^every = 3 ", integrate, TOP, Y0, 0.1, 10, every=3)
    assert len(integrate(TOP, Y0, 0.1, 0, every=7).y) == 1  # it divides 0


@pytest.mark.parametrize("missing", [{}, {"h": 0.1}, {"steps": 10}])
def test_h_and_steps_go_together(missing):
    refused(r"^give h and steps, or output times t", integrate, TOP, Y0, **missing)


@pytest.mark.parametrize("extra", [{"h": 0.1}, {"steps": 10}, {"every": 1}])
def test_t_goes_alone(extra):
    assert next(iter(extra)) in refused(r"^give either t or h and steps", integrate, TOP, Y0, t=[1.0], **extra)


@pytest.mark.parametrize("t", [1.0, [[1.0]], ["1"], [True], [1j], [NAN], [INF], [None]], ids=repr)
def test_output_times(t):
    for method in ("backlund", "rk45"):
        refused(r"^t ", integrate, TOP, Y0, t=t, method=method)


def test_output_times_need_dense_output():
    refused(r"^t: implicit_midpoint ", integrate, TOP, Y0, t=[1.0], method="implicit_midpoint")


@pytest.mark.parametrize("top", [None, 1.0, "generic", LagrangeTop, TOPS["generic"]], ids=lambda v: repr(v)[:30])
def test_tops(top):
    for call in (integrate, prepare):
        refused(r"^top ", call, top, Y0, 0.1, *([10] if call is integrate else []))
    refused(r"^top ", two_point, top, Y0, 1j)


@pytest.mark.parametrize("alpha", ALPHAS, ids=lambda v: repr(v)[:30])
def test_alpha(alpha):
    refused(r"^alpha ", LagrangeTop, alpha)


@pytest.mark.parametrize("alpha", [1, -2.5, 0, np.float32(0.5), np.int64(3), np.array(2.0)], ids=repr)
def test_alpha_may_be_any_real_number(alpha):
    top = LagrangeTop(alpha)
    assert type(top.alpha) is float
    assert top.alpha == float(alpha)


@pytest.mark.parametrize("y0", [Y0.tolist(), tuple(Y0), Y0.astype(np.float32), [1, 2, 3, 4, 5, 6], Y0[::-1][::-1]])
def test_states_may_be_anything_like_an_array(y0):
    assert integrate(TOP, y0, 0.1, 10).y.dtype == np.float64


# ---------------------------------------------------------------- methods and their options


def test_unknown_methods():
    assert "did you mean 'backlund'?" in refused(r"^unknown method 'baklund'", prepare, TOP, Y0, 0.1, "baklund")
    assert "did you mean 'taylor'?" in refused(r"^unknown method", integrate, TOP, Y0, 0.1, 10, "tailor")
    assert "Known: backlund, " in refused(r"^unknown method 'qqqq'", integrate, TOP, Y0, 0.1, 10, "qqqq")
    for method in (None, 3, ["backlund"]):
        refused(r"^method", integrate, TOP, Y0, 0.1, 10, method)


def test_unknown_options():
    text = refused(r"^unknown option 'rtoll' of rk45", prepare, TOP, Y0, 0.1, "rk45", rtoll=1e-3)
    assert "did you mean 'rtol'?" in text
    assert "rtol, atol" in text
    refused(r"^unknown option 'tol' of backlund_unpinned.*none", prepare, TOP, Y0, 0.1, "backlund_unpinned", tol=1e-3)
    refused(r"^unknown option 'solver' of rk45", integrate, TOP, Y0, t=[1.0], method="rk45", solver="newton")


OPTIONS = [
    *(("taylor", "tol", tol) for tol in (0.0, -1e-9, 1e-17, 2.0, NAN, INF, "1e-9", True, None, 1j)),
    *(("taylor", "high_accuracy", flag) for flag in (1, "yes", None)),
    *(("taylor_fixed", "order", order) for order in (0, -1, 61, 20.0, True, None, "20")),
    *(("rk45", "rtol", rtol) for rtol in (0.0, -1e-3, 1e-14, 2.0, NAN, INF, "1e-9", None)),
    *(("rk45", "atol", atol) for atol in (-1e-3, NAN, INF, "0", None)),
    *(("implicit_midpoint", "solver", solver) for solver in ("Newton", "", None, 1, True)),
    *(("backlund", "pin", pin) for pin in (-1, 1.0, True, None)),
    *(("backlund", "lam", lam) for lam in (0.0, 1.0, -1j, complex(NAN, 1), complex(1, INF), "x")),
    *(("backlund_textbook", "lam", lam) for lam in (0.0, -1j, "x")),
]


@pytest.mark.parametrize(("method", "option", "value"), OPTIONS)
def test_impossible_options(method, option, value):
    installed(method)
    refused(rf"^{option} ", prepare, TOP, Y0, 0.1, method, **{option: value})
    if METHODS[method].evaluate is not None and option in ("tol", "high_accuracy", "rtol", "atol"):
        refused(rf"^{option} ", integrate, TOP, Y0, t=[1.0], method=method, **{option: value})


@pytest.mark.parametrize("lam", [0.0, 1.0, -1j, complex(NAN, 1), complex(1, INF), "x", None, [1j]], ids=repr)
def test_parameters_of_the_map(lam):
    refused(r"^lam ", two_point, TOP, Y0, lam)


@pytest.mark.parametrize("sheet", [0, 2, None, "1", 1.5])
def test_sheets_of_the_map(sheet):
    refused(r"^sheet ", two_point, TOP, Y0, 1j, sheet)


@pytest.mark.parametrize("name", FOR_TOPS)
def test_steppers_check_their_counts(name):
    installed(name)
    stepper = prepare(TOP, Y0, 0.1, name)
    refused(r"^n ", stepper.advance, Y0, -1)
    refused(r"^n ", stepper.record, Y0, 2.5, 1)
    refused(r"^every ", stepper.record, Y0, 4, 0)
    refused(r"^every ", stepper.record, Y0, 4, 3)


@pytest.mark.parametrize("name", FOR_TOPS)
def test_steppers_take_what_prepare_takes(name):
    """A list, whole numbers or single precision; other shapes end in an error, not in somebody else's memory."""
    top, y0 = LagrangeTop(1.0), (1, 0, 2, 0, 1, 1)
    stepper = prepare(top, y0, 0.01, name)
    expected = prepare(top, y0, 0.01, name).advance(np.array(y0, dtype=float), 3)
    for y in (np.array(y0), list(y0), np.array(y0, dtype=np.float32)):
        assert prepare(top, y0, 0.01, name).record(y, 3, 3)[1].tobytes() == expected.tobytes()
        assert prepare(top, y0, 0.01, name).advance(y, 3).tobytes() == expected.tobytes()
    for wrong in (np.ones(5), np.ones(1), np.ones((1, 6)), np.ones(6, dtype=complex)):
        for run in (lambda y: stepper.advance(y, 3), lambda y: stepper.record(y, 3, 3)):
            with pytest.raises(ValueError, match=r"^y must "):
                run(wrong)


@pytest.mark.parametrize("factor", [(1, 1, 1, 2, 2, 2), (1, -1, 1, 1, 1, 1)])
def test_a_splitting_refuses_a_state_with_other_casimirs(factor):
    tide = PERTURBED_TOPS["weak_tide"]
    stepper = prepare(tide.top, tide.state, 0.1, "backlund_splitting")
    with pytest.raises(StepError, match="C1 or C2 of the state"):
        stepper.advance(tide.state * factor, 10)
    there = stepper.advance(tide.state, 1000)
    assert np.isfinite(stepper.advance(there, 1000)).all()  # a run may be continued


def test_the_axis_of_a_real_top_has_length_one():
    heavy = HeavyTop(mass=0.1, distance=0.03, gravity=9.81, A=1.5e-4, C=6e-5)
    y0 = heavy.state((0.5, 0.0, 0.0), (0.0, 1.0, 300.0))
    longer = y0 * (1, 1, 1, 2, 2, 2)
    for call in (
        lambda y: integrate(heavy, y, 1e-3, 1),
        lambda y: prepare(heavy, y, 1e-3),
        lambda y: integrate_ensemble(heavy, [y0, y], 1e-3, 1),
    ):
        call(y0)
        with pytest.raises(ValueError, match=r"\|x\|.* 1"):
            call(longer)


def test_a_state_of_another_torus_is_refused():
    stepper = prepare(TOP, Y0, 0.1)
    with pytest.raises(StepError, match=r"backlund at h = 0\.1: .*torus"):
        stepper.advance(Y0 * 1.001, 1)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(StepError, match="taylor: heyoka is not installed here"):
        prepare(TOP, Y0, 0.1, "taylor")


class Resting(Stepper):
    """A plug-in whose tops do not move; `fault` changes what it has in hand: y, the rows and what it returned last."""

    def __init__(self, fault):
        self.fault, self.work, self.buffer = fault, Work(), np.empty(6)

    def record(self, y, n, every):
        return self.fault(self, y, np.tile(y, (n // every + 1, 1)))


class Advancing(Resting):
    def advance(self, y, n):
        return self.record(y, n, max(n, 1))[-1]


def scribbling(stepper, y, rows):
    y *= 1.5
    return rows


def reusing(stepper, y, rows):
    stepper.buffer[:] = rows[-1]
    return [stepper.buffer]


FAULTS = {
    "a row too few": (lambda s, y, rows: rows[:-1], "record must return .* shape .*; got float64"),
    "a row too many": (lambda s, y, rows: np.vstack((rows, rows[-1])), "record must return .* shape"),
    "five numbers": (lambda s, y, rows: rows[:, :5], "must return .* shape"),
    "complex": (lambda s, y, rows: rows + 0j, r"must return an array of floats .*; got complex128"),
    "a list": (lambda s, y, rows: rows.tolist(), "must return .*; got list"),
    "another start": (lambda s, y, rows: rows + 1e-15, "row 0 of record must be the input"),
    "the input": (scribbling, "wrote to its input"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_steppers_of_plug_ins_are_looked_at(fault):
    """By `integrate`, by an ensemble, and by the loops of the experiments."""
    broken, said = FAULTS[fault]
    build = replace(METHODS["rk4"], name="mine", needs="uniform", prepare=lambda top, y0, h: Resting(broken))
    refused(rf"^mine: .*{said}", integrate, TOP, Y0, 0.1, 10, build, 5)
    refused(rf"^mine: .*{said}", integrate_ensemble, TOP, [Y0, Y0], 0.1, 10, build)
    with METHODS.lent(build) as name:
        refused(rf"^mine: .*{said}", states.sample, TOP, Y0, name, 0.1, [1, 2, 4])


@pytest.mark.parametrize(
    ("fault", "said"), [(reusing, "advance returned the same array twice"), (scribbling, "advance wrote to its input")]
)
def test_the_steps_of_plug_ins_are_looked_at(fault, said):
    build = replace(METHODS["rk4"], name="mine", prepare=lambda top, y0, h: Advancing(fault))
    with METHODS.lent(build) as name:
        refused(rf"^mine: {said}", states.sample, TOP, Y0, name, 0.1, [1, 2, 4])


def test_what_plug_ins_prepare_and_evaluate_is_looked_at():
    short = replace(METHODS["rk4"], name="mine", evaluate=lambda top, y0, times: (np.tile(y0, (1, 1)), Work()))
    refused(r"^mine: evaluate must return .* shape \(2, 6\)", integrate, TOP, Y0, t=[1.0, 2.0], method=short)
    refused(r"^mine: evaluate must return", integrate_ensemble, TOP, [Y0, Y0], t=[1.0, 2.0], method=short)
    for builder, said in (
        (lambda top, y0, h: None, "prepare returned None"),
        (lambda top, y0, h: scribbling(None, y0, Resting(None)), "prepare wrote to y0"),
    ):
        refused(f"^mine: {said}", integrate, TOP, Y0, 0.1, 10, replace(METHODS["rk4"], name="mine", prepare=builder))


def test_a_good_plug_in_is_looked_at_and_then_left_alone():
    found = prepare(
        TOP, Y0, 0.1, replace(METHODS["rk4"], prepare=lambda top, y0, h: Advancing(lambda s, y, rows: rows))
    )
    for _ in range(3):
        assert np.array_equal(found.record(Y0, 4, 2), np.tile(Y0, (3, 1)))
        assert np.array_equal(found.advance(Y0, 4), Y0)
    assert (found.record, found.advance) == (found.stepper.record, found.stepper.advance)


NUMBER = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize("name", [name for name in FOR_TOPS if METHODS[name].control == "step"])
@settings(max_examples=100, deadline=None, derandomize=True)
@given(y0=st.tuples(*[NUMBER] * 6), alpha=NUMBER, h=NUMBER)
def test_any_numbers(name, y0, alpha, h):
    """Over the whole range of doubles: finite states, or a named error."""
    said = None
    try:
        y = integrate(LagrangeTop(alpha), y0, h, 6, every=2, method=name).y
    except (StepError, ValueError) as error:
        said = str(error)
    if said is None:
        assert np.all(np.isfinite(y))
    else:
        assert said.startswith((f"{name} at h = ", "h must not be 0", "y0 has x = 0"))


# ---------------------------------------------------------------- a real top

REAL = {"mass": 0.5, "distance": 0.04, "gravity": 9.81, "A": 1e-3, "C": 4e-4}
MOTION = {"angles": (0.4, 0.1, 0.0), "rates": (0.0, 1.5, 120.0)}
IMPOSSIBLE = [
    *((name, value) for name in REAL for value in (NAN, INF, "1", None, True, 1j)),
    *((name, value) for name in ("mass", "A", "C") for value in (0.0, -1.0)),
    ("C", 2.1e-3),
    *(
        (name, value)
        for name in MOTION
        for value in ((0.1, 0.2), 1.0, None, (0.1, 0.2, NAN), (0.1, "2", 0.3), (1j, 0, 0))
    ),
]


@pytest.mark.parametrize(("name", "value"), IMPOSSIBLE)
def test_real_top(name, value):
    def state(angles, rates, **facts):
        return HeavyTop(**facts).state(angles, rates)

    refused(rf"^{name}\b", state, **{**REAL, **MOTION, name: value})


@pytest.mark.parametrize("t", [1e13, 1e16, -1e16, 1e308])
@pytest.mark.parametrize("name", [name for name in FOR_TOPS if METHODS[name].control == "tolerance"])
def test_times_that_no_steps_reach(name, t):
    installed(name)
    generic = TOPS["generic"]
    for times in ({"t": [0.0, t]}, {"h": t / 4, "steps": 4}):
        with pytest.raises(StepError, match=r"over 1e\+12 times the time scale of the top, .* = 0\.43"):
            integrate(generic.top, generic.state, method=name, **times)


@pytest.mark.parametrize("name", ["dop853", "rk45", "lsoda"])
def test_an_equilibrium_can_be_followed_for_ever(name):
    resting = TOPS["sleeping_stable"]
    assert np.array_equal(integrate(resting.top, resting.state, t=[1e16], method=name).y[0], resting.state)


@pytest.mark.parametrize("name", [name for name in FOR_TOPS if METHODS[name].evaluate])
@pytest.mark.parametrize("x", [(0.0, 1.0, 5e-324), (5e-324, 1.0, 0.0), (0.48, 0.6, 0.64)])
def test_at_time_zero_is_the_initial_state_itself(name, x):
    installed(name)
    y0 = np.array([0.0, 0.0, 0.0, *x])
    assert np.array_equal(integrate(LagrangeTop(0.5), y0, t=[0.0, 1.0], method=name).y[0], y0)


def test_digits_that_would_take_for_ever():
    generic = TOPS["generic"]
    with pytest.raises(ValueError, match="digits must be at most 1000; got 1000000"):
        exact.solution(generic.top, generic.state, 1.0, digits=10**6)
