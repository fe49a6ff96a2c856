"""Problems of one's own: every general method follows them with its order, and keeps what it claims; bad ones are refused.

The truth is SciPy's DOP853 on right-hand sides written by hand. The runs are interpreted, in a process of their own: a kernel
for each method and problem would be compiled else, and the bits are the same.
"""

import json
import os
import pickle
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import (
    METHODS,
    GaudinMagnet,
    Problem,
    StepError,
    WholeBody,
    cos,
    free_body,
    integrate,
    integrate_ensemble,
    sin,
    sqrt,
)

EPS = np.finfo(float).eps
END = 6.0
STEPS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)


def square(v):
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


def vibrating(t, y, p):
    return square(y[:3]) / 2 + (1.0 + p[0] * cos(p[1] * t)) * y[5]


def kirchhoff(t, y, p):
    """With terms in J·x, one of them across the axes: no splitting here knows it."""
    along = sum(y[i] ** 2 / (2 * p[i]) + p[3 + i] * y[3 + i] ** 2 / 2 + p[6 + i] * y[i] * y[3 + i] for i in range(3))
    return along + 0.25 * y[0] * y[4]


def heavy(t, y, p):
    """An asymmetric heavy top in the frame of the body, driven: rotations about three axes, and a kick."""
    return (
        sum(y[i] ** 2 / (2 * p[i]) for i in range(3))
        + p[3] * y[3]
        + p[4] * (1 + sin(t) / 2) * y[5]
        + p[4] * y[3] * y[0]
    )


def spins(t, y, p):
    a, b, c = y[:3], y[3:6], y[6:]
    return (
        p[0] * a[2] + p[1] * sum(u * v for u, v in zip(a, b, strict=True)) + p[2] * b[0] * c[0] + sqrt(1.0 + c[1] ** 2)
    )


J3 = {"J3": lambda t, y, p: y[2]}
PROBLEMS = {
    "body": Problem(
        "body", "so3", lambda t, y, p: sum(v * v / (2 * I) for v, I in zip(y, p, strict=True)), (1, 2, 3), frame="body"
    ),
    "vibrating": Problem("vibrating", "e3", vibrating, (0.3, 2.0), invariants=J3).starting(0.4),
    "heavy": Problem("heavy", "e3", heavy, (1.0, 1.5, 3.0, 0.5, 0.7), frame="body"),
    "kirchhoff": Problem("kirchhoff", "e3", kirchhoff, (1.0, 1.5, 3.0, 0.5, 0.6, 0.7, 0.1, 0.2, -0.1), frame="body"),
    "spins": Problem("spins", "so3**3", spins, (0.7, 1.2, -0.8)),
    "whole": WholeBody(1.0, (0.1, 0.3, -0.2), (1.0, 1.5, 2.0), (0.6, 0.0, -0.8)),
    "round": WholeBody(1.0, (0.0, 0.5, 0.0), (1.0, 0.7, 1.0), (0.0, 0.0, -0.8)),
}


class Quaternion(np.ndarray):
    def __new__(cls, numbers):
        return np.array(numbers, dtype=float).view(cls)

    def __mul__(self, other):
        if not isinstance(other, Quaternion):
            return np.array(self) * other
        (a, *u), (b, *v) = np.array(self), np.array(other)
        return Quaternion((a * b - np.dot(u, v), *(a * np.array(v) + b * np.array(u) + np.cross(u, v))))

    def back(self, v):
        conjugate = Quaternion(np.array(self) * (1, -1, -1, -1))
        return np.array(conjugate * Quaternion((0, *v)) * self)[1:]


def by_hand(name):
    """The right-hand side, written out with NumPy."""
    p = PROBLEMS[name].numbers
    if name in ("whole", "round"):
        w, up = np.reshape(p[3:], (2, 3))

        def body(t, y):
            q, L = Quaternion(y[:4]), y[4:]
            omega = L * p[:3]
            return np.concatenate((0.5 * (q * Quaternion((0, *omega))), np.cross(L, omega) + np.cross(q.back(up), w)))

        return body
    if name == "body":
        return lambda t, y: np.cross(y, y / p)
    if name == "vibrating":
        pull = np.array((0.0, 0.0, 1.0))

        def swings(t, y):
            weight = 1.0 + p[0] * np.cos(p[1] * (0.4 + t))
            return np.concatenate((np.cross(weight * pull, y[3:]), np.cross(y[:3], y[3:])))

        return swings
    if name == "heavy":

        def falls(t, y):
            J, x = y[:3], y[3:]
            u = J / p[:3] + np.array((p[4] * x[0], 0, 0))
            v = np.array((p[3] + p[4] * J[0], 0, p[4] * (1 + np.sin(t) / 2)))
            return np.concatenate((np.cross(J, u) + np.cross(x, v), np.cross(x, u)))

        return falls
    if name == "kirchhoff":
        inertia, added, coupled = np.array(p).reshape(3, 3)

        def rates(t, y):
            J, x = y[:3], y[3:]
            u = J / inertia + coupled * x + np.array((0.25 * x[1], 0, 0))
            v = added * x + coupled * J + np.array((0, 0.25 * J[0], 0))
            return np.concatenate((np.cross(J, u) + np.cross(x, v), np.cross(x, u)))

        return rates

    def turns(t, y):
        a, b, c = y.reshape(3, 3)
        fields = (
            p[1] * b + (0, 0, p[0]),
            p[1] * a + (p[2] * c[0], 0, 0),
            np.array((p[2] * b[0], c[1] / np.sqrt(1 + c[1] ** 2), 0)),
        )
        return np.concatenate([np.cross(f, s) for f, s in zip(fields, (a, b, c), strict=True)])

    return turns


@cache
def start(name):
    y = np.random.default_rng(5).normal(size=PROBLEMS[name].space.size)
    if name in ("whole", "round"):
        y[:4] /= np.linalg.norm(y[:4])
    return y


@cache
def end(name):
    return solve_ivp(by_hand(name), (0.0, END), start(name), "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


GENERAL = [name for name in METHODS if METHODS[name].needs in ("rhs", "smooth", "parts", "body")]
PAIRS = [(name, problem) for problem in PROBLEMS for name in GENERAL if METHODS[name].takes(PROBLEMS[problem]) is None]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_right_hand_side_and_its_derivative_are_those_of_the_formula(problem):
    posed, y, f = PROBLEMS[problem], start(problem), by_hand(problem)
    assert np.max(np.abs(posed.rhs(y, 0.3) - f(0.3, y))) < 8 * EPS * np.max(np.abs(y)) ** 2
    e = 1e-6
    slopes = [(f(0.3, y + e * unit) - f(0.3, y - e * unit)) / (2 * e) for unit in np.eye(len(y))]
    assert np.allclose(posed.jacobian(y, 0.3), np.transpose(slopes), atol=1e-8)
    casimirs = [posed.names.index(word) for word in posed.space.casimirs(y)]
    assert np.max(np.abs(posed.gradients(y)[casimirs] @ posed.poisson(y))) < 1e-14
    values = posed.gradients(y, 0.3) @ posed.rhs(y, 0.3)
    assert np.max(np.abs(values) / posed.invariant_scales(y)) < 1e-13
    assert pickle.loads(pickle.dumps(posed)) == posed


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


@cache
def interpreted():
    done = subprocess.run(
        [sys.executable, "-m", "tests.test_integrators.test_problem"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize(("name", "problem"), PAIRS)
def test_order_and_what_is_kept(name, problem):
    """Errors fall as fast as the order says, and the invariants named by `kept` stay."""
    errors, drift = interpreted()[f"{name} {problem}"]
    if METHODS[name].control == "tolerance":
        assert max(error for _, error in errors) < 1e-8
    else:
        (n, error), (m, less) = errors[-2:]
        assert np.log(error / less) / np.log(m / n) > 0.75 * METHODS[name].order_for(PROBLEMS[problem])
    assert drift < 64


@pytest.mark.parametrize("name", ["rk45_fixed", "gauss4", "rkmk4", "blanes_moan4"])
def test_compiled_kernels_have_the_bits_of_the_interpreted_ones(name):
    assert measured(name, "body")[0] == [tuple(pair) for pair in interpreted()[f"{name} body"][0]]


def test_a_component_that_stays_does_so_to_the_bit():
    posed, y0 = PROBLEMS["vibrating"], start("vibrating")
    assert np.all(integrate(posed, y0, h=0.1, steps=100, method="rk4", every=1).y[:, 2] == y0[2])
    assert METHODS["rk4"].kept(posed) == {"J3"}


def test_the_clock_starts_where_it_is_set():
    """A run from t on is the rest of a run from 0, and time is not summed: the same bits however it is recorded."""
    posed, y0 = Problem("vibrating", "e3", vibrating, (0.3, 2.0)), start("vibrating")
    whole = integrate(posed, y0, h=0.125, steps=16, method="verner9_fixed", every=8).y
    rest = integrate(posed.starting(1.0), whole[1], h=0.125, steps=8, method="verner9_fixed").y
    assert np.array_equal(rest[-1], whole[-1])
    assert np.max(np.abs(integrate(posed, whole[1], h=0.125, steps=8, method="verner9_fixed").y[-1] - whole[-1])) > 1e-3


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ({"hamiltonian": lambda t, y, p: y[0] if y[1] > 0 else y[2]}, "hamiltonian.* cannot branch"),
        ({"hamiltonian": lambda t, y, p: y[6]}, "hamiltonian asks for more than 6 numbers of y and 0 parameters"),
        ({"hamiltonian": lambda t, y: y[0]}, "hamiltonian.* takes 2 positional arguments"),
        ({"invariants": {"I": lambda t, y, p: y[1]}}, r"invariants\['I'\] is not conserved, as at y = "),
        ({"parts": [lambda t, y, p: square(y[:3]) / 2]}, "parts do not add up to the hamiltonian"),
        ({"parts": [lambda t, y, p: square(y[:3]) / 2 + y[5]]}, r"parts\[0\] has no closed flow"),
        ({"space": "e4"}, "space must be 'e3', 'so3', 'so3\\*\\*n', 'body' or a number of spins; got 'e4'"),
        ({"frame": "mine"}, "frame must be 'space' or 'body'"),
        ({"parameters": [np.nan]}, r"parameters\[0\] must be finite"),
    ],
)
def test_a_bad_problem_is_refused_in_a_line(words, reason):
    good = {"name": "mine", "space": "e3", "hamiltonian": lambda t, y, p: square(y[:3]) / 2 + y[5]}
    Problem(**good)
    with pytest.raises(ValueError, match=reason) as refused:
        Problem(**{**good, **words})
    assert "\n" not in str(refused.value)


def test_a_bad_call_is_refused_in_a_line():
    posed, y0 = PROBLEMS["kirchhoff"], start("kirchhoff")
    for call, reason in (
        (lambda: integrate(posed, y0[:3], h=0.1, steps=1, method="rk4"), "y0 must be 6 finite real numbers"),
        (lambda: integrate(posed, y0, h=0.1, steps=1), "backlund does not take the problem kirchhoff"),
        (
            lambda: integrate(posed, y0, h=0.1, steps=1, method="kahan"),
            "kahan needs a Hamiltonian [|]J[|]²/2 [+] U[(]x[)] with a quadratic U",
        ),
        (
            lambda: integrate(posed, y0, h=0.1, steps=1, method="taylor", attitude=True),
            "attitude: the body of a Problem",
        ),
    ):
        with pytest.raises(ValueError, match=reason):
            call()


if __name__ == "__main__":
    print(json.dumps({f"{name} {problem}": measured(name, problem) for name, problem in PAIRS}))


@pytest.mark.parametrize("method", ["rk4", "dop853", "backlund"])
def test_an_ensemble_has_the_bits_of_its_motions(method):
    magnet, spins = GaudinMagnet((0.0, -0.7, 1.1), 0.6), np.random.default_rng(3).normal(size=(3, 3, 3))
    cases = [(magnet, spins)] if method == "backlund" else [(magnet, spins), (free_body(1.0, 2.0, 3.0), spins[0])]
    for problem, Y0 in cases:
        together = integrate_ensemble(problem, Y0, 0.1, 20, method, every=10)
        alone = [integrate(problem, y0, 0.1, 20, method, every=10).y for y0 in Y0]
        assert np.array_equal(together, np.stack(alone, axis=1))
        assert np.array_equal(integrate_ensemble(problem, Y0, 0.1, 20, method), together[-1])
    for wrong, words in ((3, "^Y0 must be states"), (spins[:, :2], r"^Y0\[0\]")):
        with pytest.raises(ValueError, match=words):
            integrate_ensemble(magnet, wrong, 0.1, 20, "rk4")
