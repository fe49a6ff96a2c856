"""The splittings: coefficients in the free algebra, the two flows against independent arithmetic, and how to spoil them."""

import math
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, StepError, prepare
from lagrange_bench.integrators.methods import splitting as sp
from tests.reference import largest

GENERIC = TOPS["generic"]
EPS = np.finfo(float).eps


# ---------------------------------------------------------------- order conditions, in the algebra of words in A and B


class Words(list):
    """A polynomial in non-commuting A and B: degree d is an array of 2^d, a word's letters being the bits of its place."""

    def __mul__(self, other):
        def degree(d):
            return sum(np.multiply.outer(self[k], other[d - k]).ravel() for k in range(d + 1))

        return Words(degree(d) for d in range(len(self)))

    def __add__(self, other):
        return Words(p + q for p, q in zip(self, other, strict=True))

    def __rmul__(self, number):
        return Words(number * p for p in self)


def letters(degree):
    zero = [np.zeros(2**d) for d in range(degree + 1)]
    return tuple(Words((zero[0], np.eye(2)[k], *zero[2:])) for k in (0, 1))


def bracket(p, q):
    return p * q + -1.0 * (q * p)


def exponential(p):
    one = Words((np.ones(1), *(np.zeros_like(q) for q in p[1:])))
    power, total = one, one
    for k in range(1, len(p)):
        power = 1 / k * (power * p)
        total = total + power
    return total


def expanded(scheme, degree, swapped=False):
    """The product of the exponentials of a scheme, its processor included."""
    A, B = letters(degree)
    if swapped:
        A, B = B, A
    third = bracket(B, bracket(A, B))
    fifth = bracket(B, bracket(B, bracket(A, bracket(A, B))))
    none = (0.0,) * len(scheme.b)
    rotations = [exponential(a * A) for a in scheme.a]
    kicks = [
        exponential(b * B + c * third + d * fifth)
        for b, c, d in zip(scheme.b, scheme.c or none, scheme.d or none, strict=True)
    ]
    product = exponential(scheme.processor * bracket(A, B))
    for k in range(len(rotations) + len(kicks)):
        product = product * (rotations if (scheme.first == "A") == (k % 2 == 0) else kicks)[k // 2]
    return product * exponential(-scheme.processor * bracket(A, B))


@cache
def ideal(degree, swapped=False):
    """Orthonormal basis of what [B,[B,[B,A]]] generates in one degree: all that vanishes because H is quadratic in J."""
    A, B = letters(4)
    nothing = bracket(B, bracket(B, bracket(B, A)))[4]
    left, right = zip(*((i, degree - 4 - i) for i in range(degree - 3)), strict=True)
    rows = [np.kron(np.kron(u, nothing), v) for i, j in zip(left, right, strict=True)
            for u in np.eye(2**i) for v in np.eye(2**j)]  # fmt: skip
    basis, size, _ = np.linalg.svd(np.array(rows).T, full_matrices=False)
    return basis[:, size > 1e-10 * size[0]]


def residuals(scheme, degree, nystrom, swapped=False):
    """Distance from exp(A + B), degree by degree, in the free algebra or modulo [B,[B,[B,A]]] = 0."""
    A, B = letters(degree)
    found, wanted = expanded(scheme, degree, swapped), exponential(A + B)
    out = []
    for d in range(1, degree + 1):
        rest = found[d] - wanted[d]
        if nystrom and d >= 4:
            rest = rest - ideal(d) @ (ideal(d).T @ rest)
        out.append(float(np.linalg.norm(rest)))
    return np.array(out)


@pytest.mark.parametrize("name", sp.SCHEMES)
def test_order_conditions(name):
    """All words up to the order, to the rounding of the coefficients; and not one degree more."""
    scheme = sp.SCHEMES[name]
    degree = min(scheme.order + 1, 10)
    assert METHODS[name].family == "splitting"
    found = residuals(scheme, degree, scheme.nystrom)
    assert np.max(found[: scheme.order]) < 4e-15
    if degree > scheme.order:
        assert found[scheme.order] > 1e-8
    if scheme.nystrom:  # the mark is needed
        assert np.max(residuals(scheme, scheme.order, nystrom=False)) > 1e-6


def test_letters_of_nystrom_schemes_must_not_be_swapped():
    """With the quadratic energy in the place of the kicks, order 4 is left."""
    found = residuals(sp.SCHEMES["blanes_moan6"], 6, nystrom=True, swapped=True)
    assert np.max(found[:4]) < 4e-15
    assert found[4] > 1e-5


# ---------------------------------------------------------------- the rotation


def rotated(x, v, digits=50):
    """x turned by 2|v| about v."""
    with mp.workdps(digits):
        x, v = [mp.mpf(w) for w in x], [mp.mpf(w) for w in v]
        angle = 2 * mp.sqrt(mp.fdot(v, v))
        n = [2 * w / angle for w in v]
        u = [n[1] * x[2] - n[2] * x[1], n[2] * x[0] - n[0] * x[2], n[0] * x[1] - n[1] * x[0]]
        p = [n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0]]
        return [a + mp.sin(angle) * b + (1 - mp.cos(angle)) * c for a, b, c in zip(x, u, p, strict=True)]


def test_small_coefficients():
    """The polynomials in exact arithmetic, and what they do to |x|² (relative to its part across the axis, at most z)."""
    with mp.workdps(40):
        for k in range(1, 101):
            z = sp.PART * mp.mpf(k) / 100
            a, b = (z * w for w in sp.small_coefficients.py_func(z))
            angle = 2 * mp.sqrt(z)
            S, C = 2 * mp.sin(angle) / angle, (1 - mp.cos(angle)) / z
            assert abs(a - (S - 2 + z)) < 3e-19
            assert abs(b - (C - 2)) < 2e-19
            S, C = 2 + a - z, 2 + b
            assert z * abs(S * S + z * C * C - 2 * C) < 2e-19


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("angle", [1e-200, 0.999, 1.001, 3.1416, 255.0])
def test_rotation_to_round_off(angle, compensated):
    """A few ulp, and half an ulp of the angle; the length is not worse than the parts the turn is made in."""
    draw = np.random.default_rng(3)
    for _ in range(8):
        x, J = draw.normal(size=3), draw.normal(size=3)
        v = J * (0.5 * angle / np.linalg.norm(J))
        kernel = sp.KERNELS[compensated][0]
        y = np.array(kernel((*v, *x), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(24)))
        assert np.array_equal(y[:3], v)
        error = largest([float(a - b) for a, b in zip(rotated(x, v), y[3:], strict=True)])
        assert error <= (2 + angle) * EPS * np.linalg.norm(x)
        stretch = abs(float(sum(mp.mpf(w) ** 2 for w in y[3:]) / sum(mp.mpf(w) ** 2 for w in x)) - 1)
        assert stretch <= 4 * EPS * math.sqrt(max(1.0, 2 * angle))


def test_turns_too_long_are_refused():
    """In a step and in the flow a run begins with; nothing hangs for an infinite angle."""
    top, fast = LagrangeTop(1.0), np.array((0.0, 1.0, 300.0, 0.6, 0.0, 0.8))
    for method, h, words in (
        ("strang", 20.0, r"strang at h = 20.*256 radians in one part of the step"),
        ("strang", 1e300, "256 radians"),
        ("force_gradient4", 1e300, "beyond the range of doubles"),
    ):
        with pytest.raises(StepError, match=words):
            prepare(top, fast, h, method).advance(fast, 3)
    y = prepare(LagrangeTop(0.0), fast, 0.8, "strang").advance(fast, 1)  # 240 radians, the exact flow
    assert np.max(np.abs(y[3:] - [float(w) for w in rotated(fast[3:], 0.4 * fast[:3])])) < 250 * EPS


# ---------------------------------------------------------------- the step, letter by letter


def kicked(top, y, h, b, c=0.0, d=0.0):
    J, x = y[:3], y[3:]
    w = top.alpha * h * h
    force = h * top.alpha * (b + 2 * c * w * x[2] - 2 * d * w * w * (x @ x - 3 * x[2] ** 2))
    return np.concatenate((J + force * np.array((-x[1], x[0], 0.0)), x))


def turned(y, t):
    return np.concatenate((y[:3], [float(w) for w in rotated(y[3:], 0.5 * t * y[:3], 30)]))


def letter_by_letter(top, y, h, scheme):
    none = (0.0,) * len(scheme.b)
    kicks = list(zip(scheme.b, scheme.c or none, scheme.d or none, strict=True))
    for k in range(len(scheme.a) + len(kicks)):
        rotates = (scheme.first == "A") == (k % 2 == 0)
        y = turned(y, scheme.a[k // 2] * h) if rotates else kicked(top, y, h, *kicks[k // 2])
    return y


@pytest.mark.parametrize("name", sp.SCHEMES)
def test_steps_are_the_schemes(name):
    """The merged loop between `enter` and `leave` is the scheme as it is written, step by step and over several."""
    scheme = sp.SCHEMES[name]
    for top_name, h in (("generic", 0.7), ("figure1", -0.05)):
        top, y0 = states.find(top_name)
        g = 0.5 * scheme.processor * h * h * top.alpha
        y = np.array(sp.process(tuple(y0), g))
        for _ in range(3):
            y = letter_by_letter(top, y, h, scheme)
        y = np.array(sp.process(tuple(y), -g))
        stepper = prepare(top, y0, h, name)
        ours = stepper.advance(y0, 3)
        assert metrics.scaled_error(top, y0, ours, y) < 100 * EPS
        rows = stepper.record(y0, 3, 1)
        assert np.array_equal(rows[-1], ours)
        assert metrics.scaled_error(top, y0, stepper.advance(rows[1], 1), rows[2]) < 16 * EPS
        assert stepper.work.rhs_evals == 7 * min(len(scheme.a), len(scheme.b))


def gradient(function, y):
    """By central differences of order 4, exact for the polynomials below but for rounding."""
    e = 1e-2 * np.eye(6)
    return np.array([(8 * (function(y + v) - function(y - v)) - (function(y + 2 * v) - function(y - 2 * v))) / 0.12
                     for v in e])  # fmt: skip


def test_kicks_are_flows_of_brackets():
    """With [f, g] the flow of {g, f}: the Hamiltonians of [A,B], [B,[A,B]], [A,[A,B]], … and the kick made of them."""
    top, y = LagrangeTop(1.7), np.array((0.3, -0.4, 1.2, 0.5, 0.7, -0.9))
    f = {
        "A": lambda y: y[:3] @ y[:3] / 2,
        "B": lambda y: top.alpha * y[5],
        "AB": lambda y: top.alpha * (y[0] * y[4] - y[1] * y[3]),
        "BAB": lambda y: -(top.alpha**2) * (y[3] ** 2 + y[4] ** 2),
        "AAB": lambda y: top.alpha * (y[2] * (y[:3] @ y[3:]) - y[:3] @ y[:3] * y[5]),
        "BAAB": lambda y: 2 * top.alpha * y[5] * f["AB"](y),
        "BBAAB": lambda y: 2 * top.alpha * y[5] * f["BAB"](y),
    }
    slope = {word: gradient(function, y) for word, function in f.items()}
    for word in ("AB", "BAB", "AAB", "BAAB", "BBAAB"):
        assert slope[word[1:]] @ top.poisson(y) @ slope[word[0]] == pytest.approx(f[word](y), rel=1e-10)
    h, b, c, d = 0.6, 0.3, -0.2, 0.7
    kick = top.poisson(y) @ (h * b * slope["B"] + h**3 * c * slope["BAB"] + h**5 * d * slope["BBAAB"])
    assert np.allclose(kicked(top, y, h, b, c, d) - y, kick, rtol=1e-10, atol=1e-10)


# ---------------------------------------------------------------- the processor


def test_processor_is_the_flow_of_its_hamiltonian():
    """Its derivative at time 0, its inverse, its invariants, and that it is Poisson; |x| ≠ 1, large and small steps."""
    for name in ("generic", "figure1", "sleeping_stable", "slow"):
        top, y = states.find(name)
        size = np.linalg.norm(y[3:])
        g = 1e-6
        slope = (np.array(sp.process(tuple(y), g)) - np.array(sp.process(tuple(y), -g))) / (2 * g)
        gradient = 2.0 * np.array((y[4], -y[3], 0.0, -y[1], y[0], 0.0))
        assert np.allclose(slope, top.poisson(y) @ gradient, rtol=1e-7, atol=1e-8)
        for g in (0.01 / size, -0.5 / size):
            z = np.array(sp.process(tuple(y), g))
            drift = metrics.relative_drift(top.invariants(np.array((y, z))), top.invariant_scales(y))
            assert np.max(np.abs(drift[:, 1:])) < 16 * EPS
            assert metrics.scaled_error(top, y, np.array(sp.process(tuple(z), -g)), y) < 16 * EPS
            assert metrics.poisson_defect(lambda y, g=g: np.array(sp.process(tuple(y), g)), top, y).defect < 1e-10
    assert sp.process(tuple(GENERIC.state), 0.0) == tuple(GENERIC.state)
