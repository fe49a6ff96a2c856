"""Problems of one's own and bodies: every method follows them with its order, and keeps what it claims."""

import pickle
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench import Problem, RigidBody
from lagrange_bench.integrators import cos, integrate, kirchhoff_body, reference, sin
from lagrange_bench.integrators.interface import StepError
from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot
from lagrange_bench.integrators.registry import METHODS, available

pytestmark = [
    pytest.mark.interpreted,  # compiled, a kernel would be needed for each pair
    pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning"),
]
EPS = np.finfo(float).eps
END = 6.0
STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)


def vibrating(t, y, p):
    return y[:3] @ y[:3] / 2 + (p[0] + p[1] * cos(p[2] * t)) * y[5]


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


AXIS = np.array((0.48, 0.6, -0.64))
HAMILTONIANS = {  # formula, parameters, frame
    "free": (free, "so3", (1, 2, 3), "body"),
    "vibrating": (vibrating, "e3", (1.0, 0.3, 2.0), "space"),
    "heavy": (heavy, "e3", (1.0, 1.5, 3.0, 0.5, 0.7), "body"),
    "kirchhoff": (kirchhoff, "e3", (1.0, 1.5, 3.0, 0.5, 0.6, 0.7, 0.1, 0.2, -0.1), "body"),
    "spins": (spins, 3, (0.7, 1.2, -0.8), "space"),
}
PROBLEMS = {
    **{name: Problem(name, space, H, p, frame=frame) for name, (H, space, p, frame) in HAMILTONIANS.items()},
    "vibrating": vibrating_pivot(1.0, 0.3, 2.0).starting_at(0.4),
    "whole": RigidBody(1.0, (0.1, 0.3, -0.2), (1.0, 1.5, 2.0), (0.6, 0.0, -0.8)),
    "round": RigidBody(2.0, 0.5 * AXIS, np.eye(3) - 0.7 * np.outer(AXIS, AXIS), (0.3, 0.4, -0.5)),
}


def rates(name):
    """The right-hand side: the bracket with ∇H, by complex steps; of a body its own."""
    if name not in HAMILTONIANS:
        return lambda t, y: PROBLEMS[name].rhs(y, t)
    H, space, p, frame = HAMILTONIANS[name]
    start, sign = 0.4 if name == "vibrating" else 0.0, 1 if frame == "space" else -1

    def bracket(t, y):
        slopes = [H(start + t, y + 1e-30j * e, p).imag / 1e-30 for e in np.eye(len(y))]
        v, g = y.reshape(-1, 3), np.reshape(slopes, (-1, 3))
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


# seconds each: implicit stages of many spins
LONG = {(name, "spins") for name in ("gauss6", "gauss8")}
PAIRS = [
    pytest.param(name, problem, marks=[pytest.mark.slow] * ((name, problem) in LONG))
    for problem in PROBLEMS
    for name in METHODS
    if available(METHODS[name]) and METHODS[name].takes(PROBLEMS[problem]) is None
]


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


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")  # too long a step overflows
@pytest.mark.parametrize(("name", "problem"), PAIRS)
def test_order_and_what_is_kept(name, problem):
    """Errors fall as fast as the order says, and the invariants that are claimed stay."""
    posed, method, y0, errors = PROBLEMS[problem], METHODS[name], start(problem), []
    if method.control == "tolerance":
        tight = {"tol": 1e-13} if "tol" in method.options else {"rtol": 1e-10}
        path = integrate(posed, y0, h=END / 4, steps=4, method=name, **tight)
        assert np.max(np.abs(path.states[-1] - end(problem))) < 1e-8
        if method.evaluate:
            dense = integrate(posed, y0, t=[END, END / 2], method=name, **tight)
            assert np.max(np.abs(dense.states - path.states[[4, 2]])) < 1e-8
    for n in STEPS if method.control == "step" else ():
        try:
            path = integrate(posed, y0, h=END / n, steps=n, method=name)
        except StepError:  # too long a step
            continue
        error = np.max(np.abs(path.states[-1] - end(problem)))
        if error < 4e-12:  # close to round-off
            break
        errors.append((n, error))
    if method.order is None:
        assert not errors, "it is exact"
    elif method.control == "step":
        (n, error), (m, less) = errors[-2:]
        assert np.log(error / less) / np.log(m / n) > 0.75 * method.order
    drift = np.abs(path.invariants() - path.invariants()[0]) / posed.invariant_scales(y0)
    kept = [posed.names.index(word) for word in posed.conserved_by(method)]
    assert np.max(drift[:, kept], initial=0.0) < 64 * EPS


def test_a_hamiltonian_may_use_arrays():
    plain = Problem("p", "e3", lambda t, y, p: y[0] ** 2 + 2 * y[1] ** 2 + 4 * y[2] ** 2 + p[0] * y[5], (0.5,))
    y, weights = np.random.default_rng(3).normal(size=(20, 6)), np.array([1.0, 2.0, 4.0])
    for formula in (
        lambda t, y, p: y[:3] @ np.diag(weights) @ y[:3] + p @ y[5:],
        lambda t, y, p: np.dot(np.square(y[:3]), weights) + (p[0] * y[3:])[2],
    ):
        np.testing.assert_allclose(Problem("p", "e3", formula, (0.5,)).rhs(y), plain.rhs(y), rtol=1e-14, atol=1e-14)


def test_a_round_body_in_a_fluid_keeps_its_spin():
    y0 = np.random.default_rng(4).normal(size=6)
    a, b, c = (1.0, 1.0, 0.5), (0.1, 0.1, -0.2), (0.6, 0.6, 0.9)
    body, other = kirchhoff_body(a, b, c), kirchhoff_body((1.0, 1.1, 0.5), b, c)
    assert (body.names, other.names) == (("H", "C1", "C2", "J3"), ("H", "C1", "C2"))
    assert abs(body.rhs(y0)[2]) < 1e-15 < 1e-3 < abs(other.rhs(y0)[2])


Y0 = np.array((0.3, -0.2, 1.1, 0.4, 0.1, 0.9))
UNTIL = 12.0


def driven(t, y, p):
    weight = 1.0 + p[0] * cos(1.1 * t)  # a part of it is constant
    return y[:3] @ y[:3] / 2.0 + weight * y[5] + p[0] * cos(0.7 * t) * (y[3] * y[3] - 0.5 * y[4] * y[5])


DRIVEN = Problem("driven", "e3", driven, (0.01,)).starting_at(1.3)


SCHEMES = [
    *(("strang", 4, {}), ("processed6", 6, {}), ("aba864", 6, {})),
    *(("strang", 2, {without: False}) for without in ("corrector", "modified_kick")),
]


@pytest.mark.parametrize(("scheme", "order", "options"), SCHEMES)
def test_every_scheme_keeps_its_order_in_a_driven_field(scheme, order, options):
    right = reference.solution(DRIVEN, Y0, [UNTIL]).states[0]

    def error(n):
        run = integrate(DRIVEN, Y0, h=UNTIL / n, steps=n, method="backlund_splitting", scheme=scheme, **options)
        return np.max(np.abs(run.y[-1] - right))

    assert np.log2(error(48) / error(96)) == pytest.approx(order, abs=0.25)
