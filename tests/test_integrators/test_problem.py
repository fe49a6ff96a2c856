"""Problems of one's own: every general method follows them with its order, and keeps what it claims; bad ones are refused.

The truth is SciPy's DOP853 on right-hand sides from dual numbers. Compiled, a kernel would be needed for each pair.
"""

import pickle
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import (
    METHODS,
    TOPS,
    Problem,
    StepError,
    WholeBody,
    cos,
    free_body,
    integrate,
    sin,
    vibrating_pivot,
)
from lagrange_bench.integrators.methods.explicit import explicit_stepper
from tests.test_integrators.paper.tools import jacobian

pytestmark = pytest.mark.interpreted
EPS = np.finfo(float).eps
END = 6.0
STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)


def vibrating(t, y, p):
    return y[:3] @ y[:3] / 2 + (1.0 + p[0] * cos(p[1] * t)) * y[5]


def kirchhoff(t, y, p):
    """With terms in J·x, one of them across the axes: no splitting here knows it."""
    along = sum(y[i] ** 2 / (2 * p[i]) + p[3 + i] * y[3 + i] ** 2 / 2 + p[6 + i] * y[i] * y[3 + i] for i in range(3))
    return along + 0.25 * y[0] * y[4]


def heavy(t, y, p):
    """An asymmetric heavy top in the frame of the body, driven: rotations about three axes, and a kick."""
    kinetic = sum(y[i] ** 2 / (2 * p[i]) for i in range(3))
    return kinetic + p[3] * y[3] + p[4] * (1 + sin(t) / 2) * y[5] + p[4] * y[3] * y[0]


def spins(t, y, p):
    a, b, c = y[:3], y[3:6], y[6:]
    return p[0] * a[2] + p[1] * (a @ b) + p[2] * b[0] * c[0] + (1.0 + c[1] ** 2) ** 0.5


def free(t, y, p):
    return sum(v * v / (2 * I) for v, I in zip(y, p, strict=True))


HAMILTONIANS = {  # formula, parameters, frame
    "free": (free, "so3", (1, 2, 3), "body"),
    "vibrating": (vibrating, "e3", (0.3, 2.0), "space"),
    "heavy": (heavy, "e3", (1.0, 1.5, 3.0, 0.5, 0.7), "body"),
    "kirchhoff": (kirchhoff, "e3", (1.0, 1.5, 3.0, 0.5, 0.6, 0.7, 0.1, 0.2, -0.1), "body"),
    "spins": (spins, "so3**3", (0.7, 1.2, -0.8), "space"),
}
J3 = {"J3": lambda t, y, p: y[2]}
PROBLEMS = {
    **{
        name: Problem(name, space, H, p, invariants=J3 if name == "vibrating" else {}, frame=frame)
        for name, (H, space, p, frame) in HAMILTONIANS.items()
    },
    "whole": WholeBody(1.0, (0.1, 0.3, -0.2), (1.0, 1.5, 2.0), (0.6, 0.0, -0.8)),
    "round": WholeBody(1.0, (0.0, 0.5, 0.0), (1.0, 0.7, 1.0), (0.0, 0.0, -0.8)),
}
PROBLEMS["vibrating"] = PROBLEMS["vibrating"].starting(0.4)


def rates(name):
    """The right-hand side: the bracket with ∇H, exact from dual numbers; of a whole body, see `test_rigid_top`, its own."""
    if name not in HAMILTONIANS:
        return lambda t, y: PROBLEMS[name].rhs(y, t)
    H, space, p, frame = HAMILTONIANS[name]
    start, sign = 0.4 if name == "vibrating" else 0.0, 1 if frame == "space" else -1

    def bracket(t, y):
        v, g = y.reshape(-1, 3), jacobian(lambda z: np.array([H(start + t, z, p)]), y)[0].reshape(-1, 3)
        if space != "e3":
            return sign * np.cross(g, v).ravel()
        return sign * np.concatenate((np.cross(g[0], v[0]) + np.cross(g[1], v[1]), np.cross(g[0], v[1])))

    return bracket


@cache
def start(name):
    y = np.random.default_rng(5).normal(size=PROBLEMS[name].space.size)
    if name in ("whole", "round"):
        y[:4] /= np.linalg.norm(y[:4])
    return y


@cache
def end(name):
    return solve_ivp(rates(name), (0.0, END), start(name), "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


GENERAL = [name for name in METHODS if METHODS[name].needs in ("rhs", "smooth", "parts", "body")]
PAIRS = [(name, problem) for problem in PROBLEMS for name in GENERAL if METHODS[name].takes(PROBLEMS[problem]) is None]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_right_hand_side_and_its_derivative_are_those_of_the_formula(problem):
    posed, y, f = PROBLEMS[problem], start(problem), rates(problem)
    assert np.max(np.abs(posed.rhs(y, 0.3) - f(0.3, y))) < 8 * EPS * np.max(np.abs(y)) ** 2
    e = 1e-6
    slopes = [(f(0.3, y + e * unit) - f(0.3, y - e * unit)) / (2 * e) for unit in np.eye(len(y))]
    assert np.allclose(posed.jacobian(y, 0.3), np.transpose(slopes), atol=1e-8)
    casimirs = [posed.names.index(word) for word in posed.space.casimirs(y)]
    assert np.max(np.abs(posed.gradients(y)[casimirs] @ posed.poisson(y))) < 1e-14
    values = posed.gradients(y, 0.3) @ posed.rhs(y, 0.3)
    assert np.max(np.abs(values) / posed.invariant_scales(y)) < 1e-13
    assert pickle.loads(pickle.dumps(posed)) == posed
    if problem in HAMILTONIANS:
        assert posed.parameters == HAMILTONIANS[problem][2]


def measured(name, problem):
    """Errors by numbers of steps, as long as they are clear of round-off; and the largest drift of what is kept, in ulps."""
    posed, method, y0 = PROBLEMS[problem], METHODS[name], start(problem)
    errors = {}
    if method.control == "tolerance":
        tight = {"tol": 1e-13} if "tol" in method.options else {"rtol": 1e-10, "atol": 1e-12}
        path = integrate(posed, y0, h=END / 4, steps=4, method=name, every=1, **tight)
        dense = integrate(posed, y0, t=[END, END / 2], method=name, **tight).y if method.evaluate else path.y[[4, 2]]
        errors = {4: np.max(np.abs(path.y[-1] - end(problem))), 2: np.max(np.abs(dense - path.y[[4, 2]]))}
    for n in STEPS if method.control == "step" else ():
        try:
            path = integrate(posed, y0, h=END / n, steps=n, method=name, every=1)
        except StepError:  # too long a step
            continue
        error = np.max(np.abs(path.y[-1] - end(problem)))
        if error < 4e-12:
            break
        errors[n] = error
    drift = np.abs(path.invariants() - path.invariants()[0]) / posed.invariant_scales(y0)
    kept = [posed.names.index(word) for word in method.kept(posed)]
    return list(errors.items()), float(np.max(drift[:, kept], initial=0.0) / EPS)


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")  # too long a step overflows
@pytest.mark.parametrize(("name", "problem"), PAIRS)
def test_order_and_what_is_kept(name, problem):
    """Errors fall as fast as the order says, and the invariants named by `kept` stay."""
    errors, drift = measured(name, problem)
    if METHODS[name].control == "tolerance":
        assert max(error for _, error in errors) < 1e-8
    else:
        (n, error), (m, less) = errors[-2:]
        assert np.log(error / less) / np.log(m / n) > 0.75 * METHODS[name].order_for(PROBLEMS[problem])
    assert drift < 64


@pytest.mark.parametrize(
    "formula",
    [
        lambda t, y, p: y[:3] @ np.diag([1.0, 2.0, 4.0]) @ y[:3] + p[0] * y[5],
        lambda t, y, p: np.sum(np.array([1.0, 2.0, 4.0]) * y[:3] ** 2) + p @ y[5:],
        lambda t, y, p: np.dot(np.square(y[:3]), (1.0, 2.0, 4.0)) + (p[0] * y[3:])[2],
    ],
)
def test_a_hamiltonian_may_use_arrays(formula):
    plain = Problem("p", "e3", lambda t, y, p: y[0] ** 2 + 2 * y[1] ** 2 + 4 * y[2] ** 2 + p[0] * y[5], (0.5,))
    y = np.random.default_rng(3).normal(size=(20, 6))
    np.testing.assert_allclose(Problem("p", "e3", formula, (0.5,)).rhs(y), plain.rhs(y), rtol=1e-14, atol=1e-14)


def test_the_clock_starts_where_it_is_set():
    """A run from t on is the rest of a run from 0, and time is not summed: the same bits however it is recorded."""
    posed, y0 = Problem("vibrating", "e3", vibrating, (0.3, 2.0)), start("vibrating")
    whole = integrate(posed, y0, h=0.125, steps=16, method="verner9_fixed", every=8).y
    rest = integrate(posed.starting(1.0), whole[1], h=0.125, steps=8, method="verner9_fixed").y
    assert np.array_equal(rest[-1], whole[-1])
    assert np.max(np.abs(integrate(posed, whole[1], h=0.125, steps=8, method="verner9_fixed").y[-1] - whole[-1])) > 1e-3


def kutta(rates, t, y, h):
    k1 = rates(t, y)
    k2 = rates(t + h / 2, [a + b / 2 for a, b in zip(y, k1, strict=True)])
    k3 = rates(t + h / 2, [a + b / 2 for a, b in zip(y, k2, strict=True)])
    k4 = rates(t + h, [a + b for a, b in zip(y, k3, strict=True)])
    return [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]


def test_an_explicit_method_of_ones_own_follows_any_problem():
    """Kutta's formula, written once: a pivot that vibrates, a free body, a top."""
    top = TOPS["generic"]
    for problem, y0 in (
        (vibrating_pivot(1.0, 0.5, 3.0), top.state),
        (free_body(1.0, 2.0, 3.0), top.state[:3]),
        (top.top, top.state),
    ):
        stepper = explicit_stepper("kutta", problem, 0.05, kutta)
        expected = integrate(problem, y0, h=0.05, steps=40, method="rk4").y[-1]
        assert np.allclose(stepper.advance(y0, 40), expected, rtol=0, atol=1e-13)
        assert stepper.work.rhs_evals == 160
    with pytest.raises(ValueError, match="increment gives 3 numbers; a state has 6"):
        explicit_stepper("short", top.top, 0.1, lambda rates, t, y, h: rates(t, y)[:3])
