"""Bad input: one ValueError, raised before anything is computed, whose message names the argument."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lagrange_bench as lb
from lagrange_bench import METHODS, PERTURBED_TOPS, POTENTIALS, TOPS, LagrangeTop, PerturbedTop, StepError
from lagrange_bench.integrators import Problem, RigidBody, available, exact, integrate, integrate_ensemble, prepare
from tests.installed import FOR_TOPS, installed

pytestmark = pytest.mark.interpreted
TOP = LagrangeTop(1.0)
Y0 = TOPS["generic"].state
FIVE = np.tile(Y0, (5, 1))
NAN, INF = float("nan"), float("inf")

STATES = [
    *(Y0[:5], Y0[:, None], np.stack((Y0, Y0)), None, [[1.0], [1.0, 2.0]], ["1"] * 6, [True] * 6, Y0 + 0j),
    *([NAN, *Y0[1:]], [*Y0[:5], INF], [*Y0[:3], 0.0, 0.0, 0.0], [*Y0[:3], -0.0, 0.0, 0.0]),
]
STEPS = [0, -0.0, NAN, -INF, "0.1", b"1", True, 1j, [0.1], np.array([0.1, 0.2]), np.datetime64("now"), 10**400]
ALPHAS = [NAN, -INF, "1", b"1", None, True, np.bool_(True), 1j, np.complex128(1), [1.0], 10**400]
LAMBDAS = [0.0, 1.0, -1j, complex(NAN, 1), complex(1, INF), "x", None, [1j]]


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


def ensemble(**wrong):
    many = LagrangeTop(np.linspace(0.5, 2.0, 5))
    return integrate_ensemble(**{"top": many, "Y0": FIVE, "h": 0.1, "steps": 10, **wrong})


TIDE = PERTURBED_TOPS["weak_tide"].top
MAGNET, SPINS = lb.GaudinMagnet((0, -1, -3), 0.5), np.eye(3)
BODY = RigidBody(1.3, (0.1, 0.3, -0.2), (1.0, 1.5, 2.0))


CHECKS = [  # of each check what does not pass, and one caller
    ("y0", STATES, lambda v: integrate(TOP, v, 0.1, 10)),
    ("Y0", [Y0, FIVE[:, :5], FIVE + 0j], lambda v: ensemble(Y0=v)),
    ("h", STEPS, lambda v: prepare(TOP, Y0, v)),
    ("threads", [0], lambda v: ensemble(threads=v)),
    ("t", [1.0, [[1.0]], [1.0, [2.0]], ["1"], [True], [1j], [NAN], [INF], [None]], lambda v: integrate(TOP, Y0, t=v)),
    ("top", [None, 1.0, LagrangeTop], lambda v: integrate(v, Y0, 0.1, 10)),
    ("alpha", ALPHAS, LagrangeTop),
    ("lam", LAMBDAS, lambda v: lb.two_point(TOP, Y0, v)),
    ("sheet", [0, 2, None, "1", 1.5], lambda v: lb.two_point(TOP, Y0, 1j, v)),
    ("rtol", [1e-14, 0.0, -1e-9, 2.0, NAN, "1e-9"], lambda v: prepare(TOP, Y0, 0.1, "dop853", rtol=v)),
    ("t", ["1", [[1.0]], NAN, INF, [1.0, None], 1j, [True], object()], lambda v: exact.solution(TOP, Y0, v)),
    ("y", [np.ones((2, 5)), np.ones((6, 2)), 1.0], TOP.invariants),
    ("parameters", [("a",), (NAN,), (INF,), "1e-3", 3.0, (0.1,)], lambda v: PerturbedTop(TOP, POTENTIALS["tide"], v)),
    ("sites", [(1.0, 2.0, 1.0), (), ("a", 1.0), (0.0, 1j)], lb.GaudinMagnet),
    ("spins", [SPINS[:1], SPINS * NAN, SPINS * 1j], lambda v: MAGNET.exact_step(v, 1.0)),
    ("h", [INF], lambda v: MAGNET.exact_step(SPINS, v)),
]


@pytest.mark.parametrize(("name", "values", "call"), CHECKS)
def test_values_that_an_argument_must_not_have(name, values, call):
    for value in values:
        refused(rf"^{name}\b", call, value)


def test_a_step_in_the_time_scale_of_the_motion():
    for problem, y0 in ((TOP, Y0), (TIDE, Y0), (BODY, BODY.state(rotation=np.eye(3), omega_body=(1.0, 0.2, 3.0)))):
        h = 0.1 * problem.scales(y0)[2]
        end = integrate(problem, y0, h, 10, "rk4").y[-1]
        assert np.array_equal(integrate(problem, y0, h_scaled=0.1, steps=10, method="rk4").y[-1], end)
        assert np.array_equal(prepare(problem, y0, method="rk4", h_scaled=0.1).advance(y0, 10), end)


def heavy(t, y, p):
    return y[:3] @ y[:3] / 2 + y[5]


MESSAGES = [  # a call, words in the message
    (lambda: integrate(TOP, Y0, 0.1, 10, every=3), "every = 3 does not divide steps = 10"),
    (lambda: integrate(TOP, Y0, steps=1), "give h and steps, or output times t"),
    (lambda: integrate(TOP, Y0, t=[1.0], every=1), "give either t or h and steps.* every"),
    (lambda: prepare(TOP, Y0, 0.1, h_scaled=0.1), "give h or h_scaled, not both"),
    (lambda: integrate(LagrangeTop(0), (0, 0, 0, 0, 0, 1), h_scaled=0.1, steps=1), "h_scaled: .* at rest for ever"),
    (lambda: ensemble(Y0=FIVE * (1, 1, 1, 0, 0, 0)), r"Y0\[0\] has x = 0"),
    (lambda: prepare(TOP, Y0, 0.1, "baklund"), "unknown method 'baklund'.*did you mean 'backlund'?"),
    (lambda: integrate(TOP, Y0, dt=0.1, steps=4), "unknown option 'dt' of backlund; did you mean 'h'"),
    (lambda: prepare(TOP, Y0, 0.1, "rk45", rtoll=1), "unknown option 'rtoll' of rk45.* 'rtol'?.*rtol, atol"),
    (lambda: Problem("mine", "e3", heavy, invariants={"H": lambda t, y, p: y[2]}), r".*\['H'\].* taken"),
    (lambda: integrate(MAGNET, SPINS, 0.1, 1), r"top must be .*; got GaudinMagnet: pass its problem\(\)"),
    (lambda: exact.solution(TOP, Y0, 2e14), ".*pass digits="),
    (lambda: prepare(PerturbedTop(TOP, POTENTIALS["charge"], (0.1, *Y0[3:])), Y0, 0.1), "y0: .*not finite at x"),
    (lambda: integrate(TIDE, Y0, 1.0, 3000, "rk4", every=3000).error(), "t = 3000 is longer than 2000 time scales"),
]


@pytest.mark.parametrize(("call", "words"), MESSAGES)
def test_messages(call, words):
    refused(rf"(?s)^(method: |problem mine: )?{words}", call)


@pytest.mark.parametrize("name", ["backlund", "theta_functions", "taylor", "dop853", "rk45"])
def test_steppers_check_what_prepare_checks(name):
    """A list of whole numbers or single precision will do; other shapes end in an error, not in somebody else's memory."""
    installed(name)
    y0 = (1, 0, 2, 0, 1, 1)
    stepper = prepare(TOP, y0, 0.01, name)
    expected = prepare(TOP, y0, 0.01, name).advance(np.array(y0, dtype=float), 3)
    assert np.array_equal(stepper.record(np.array(y0, dtype=np.float32), 3, 3)[1], expected)
    for wrong in (np.ones(5), np.ones((1, 6)), np.ones(6, dtype=complex)):
        refused("^y must ", stepper.advance, wrong, 3)
        refused("^y must ", stepper.record, wrong, 3, 3)
    refused(r"^n ", stepper.advance, y0, -1)
    refused(r"^every ", stepper.record, y0, 4, 3)


@pytest.mark.parametrize(
    ("name", "top", "factor", "words"),
    [
        ("backlund", TOP, 1 + 1e-8, "torus"),
        ("addition_theorem", TOP, 1 + 1e-8, "torus"),
        ("backlund_splitting", TIDE, (1, -1, 1, 1, 1, 1), "C1 or C2 of the state"),
    ],
)
def test_a_state_of_another_torus_is_refused(name, top, factor, words):
    stepper = prepare(top, Y0, 0.1, name)
    with pytest.raises(StepError, match=rf"{name} at h = 0\.1.*{words}"):
        stepper.advance(Y0 * np.array(factor), 1)
    there = stepper.advance(Y0, 1000)
    assert np.isfinite(stepper.advance(there, 1000)).all()  # a run may be continued


class Resting(lb.Stepper):
    """A stepper of a plug-in, whose tops do not move; `spoiled` makes of its rows what it returns."""

    def __init__(self, spoiled):
        self.spoiled, self.work = spoiled, lb.Work()

    def record(self, y, n, every):
        return self.spoiled(y, np.tile(y, (n // every + 1, 1)))


SPOILED = [
    (lambda y, rows: rows[1:], ValueError, r"mine: record must return .* shape \(3, 6\); got float64 \(2, 6\)"),
    (lambda y, rows: rows * [[1.0], [1.0], [NAN]], StepError, "a state that is not finite"),
    (lambda y, rows: rows + 1.0, ValueError, "return it as row 0"),
    (lambda y, rows: np.add(y, 1.0, out=y) + rows, ValueError, "leave its input as it is"),
]


@pytest.mark.parametrize(("spoiled", "error", "words"), SPOILED)
def test_what_a_plug_in_returns_is_looked_at(spoiled, error, words):
    """`check` looks at all else."""
    mine = replace(METHODS["rk4"], name="mine", prepare=lambda top, y0, h: Resting(spoiled), kernels_for={})
    with pytest.raises(error, match=words):
        integrate(TOP, Y0, 0.1, 10, mine, 5)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(StepError, match="taylor: heyoka is not installed here"):
        prepare(TOP, Y0, 0.1, "taylor")


FOLLOWING = [name for name in FOR_TOPS if METHODS[name].control == "tolerance" and available(METHODS[name])]
FAST = (0.0, 1.0, 300.0, 0.6, 0.0, 0.8)
TOO_LONG = [  # a method, a state, a step, words of the StepError
    ("backlund", Y0, 1e17, "1e15"),
    ("theta_functions", Y0, 1e14, r"step \d: n .* phase"),
    ("kahan", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), 2.0, r"kahan at h = 2 \(own unit\), step 0: .*pole"),
    ("strang", FAST, 20.0, r"strang at h = 20.*256 radians in one part of the step"),
    ("rkmk4", FAST, 20.0, r"rkmk4 at h = 20 \(own unit\), step 0: .* more than 1024 rad"),
    ("force_gradient4", FAST, 1e300, "beyond the range of doubles"),
    *((name, Y0, 1e13, r"over 1e\+12 times the shortest time scale of the motion") for name in FOLLOWING),
]


@pytest.mark.parametrize(("name", "y0", "h", "words"), TOO_LONG)
def test_steps_that_are_too_long(name, y0, h, words):
    with np.errstate(all="ignore"), pytest.raises(StepError, match=words):
        prepare(TOP, np.array(y0), h, name).advance(np.array(y0), 10)
