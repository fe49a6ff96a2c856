"""Splittings, letter by letter, against arithmetic in many digits."""

import math

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.linalg import expm

from lagrange_bench import metrics, prepare, states
from lagrange_bench.integrators.methods import splitting as sp
from lagrange_bench.integrators.problem.system import uniform_system
from tests.reference import flows, largest
from tests.test_integrators.test_gauss import hat

EPS = np.finfo(float).eps


def rotated(x, v, digits=50):
    """x turned by 2|v| about v."""
    with mp.workdps(digits):
        return list(mp.expm(2 * mp.matrix(hat(v))) * mp.matrix(list(map(mpf, x))))


@pytest.mark.parametrize("angle", [1e-200, 0.999, 1.001, 3.1416, 255.0])
def test_rotation_to_round_off(angle):
    """A few ulp, and half an ulp of the angle; the length is not worse than the parts the turn is made in."""
    draw = np.random.default_rng(3)
    for _ in range(8):
        x, J = draw.normal(size=3), draw.normal(size=3)
        v = J * (0.5 * angle / np.linalg.norm(J))
        kernel = sp.kernel(uniform_system(), 0)
        y = np.array(kernel((*v, *x), np.array((1.0, *(0.0,) * 5)), np.zeros(24)))
        assert np.array_equal(y[:3], v)
        error = largest([float(a - b) for a, b in zip(rotated(x, v), y[3:], strict=True)])
        assert error <= (2 + angle) * EPS * np.linalg.norm(x)
        stretch = abs(float(sum(mpf(w) ** 2 for w in y[3:]) / sum(mpf(w) ** 2 for w in x)) - 1)
        assert stretch <= 4 * EPS * math.sqrt(max(1.0, 2 * angle))


def kicked(top, y, h, b, c=0.0, d=0.0):
    J, x = y[:3], y[3:]
    w = top.alpha * h * h
    force = h * top.alpha * (b + 2 * c * w * x[2] - 2 * d * w * w * (x @ x - 3 * x[2] ** 2))
    return np.concatenate((J + force * np.array((-x[1], x[0], 0)), x))


def letter_by_letter(top, y, h, scheme, n=1):
    """n steps in mpmath."""
    none = (0.0,) * len(scheme.b)
    kicks = list(zip(scheme.b, scheme.c or none, scheme.d or none, strict=True))
    y = np.array(list(map(mpf, y)))
    for k in list(range(len(scheme.a) + len(kicks))) * n:
        if (scheme.first == "A") == (k % 2 == 0):
            y = np.array((*y[:3], *rotated(y[3:], scheme.a[k // 2] * h / 2 * y[:3])))
        else:
            y = kicked(top, y, h, *kicks[k // 2])
    return y


BITS = dict(zip(sp.SCHEMES, (40, 32, 36, 24, 36, 24), strict=True))  # of h^order, before the last digits show


@pytest.mark.parametrize("name", sp.SCHEMES)
def test_every_digit_of_a_scheme_gives_its_order(name):
    """The error of a step so short that a wrong ninth digit of a coefficient shows."""
    top, y = states.find("generic")
    order, errors, bits = sp.SCHEMES[name].order, [], BITS[name]
    with mp.workdps(40):
        for h in (mpf(2) ** (-bits / order), mpf(2) ** (-bits / order - 1)):
            errors.append(largest(letter_by_letter(top, y, h, sp.SCHEMES[name]) - flows(top.alpha, y, [h])[0]))
        assert float(mp.log(errors[0] / errors[1], 2)) == pytest.approx(order + 1, abs=0.06)


@pytest.mark.parametrize("name", sp.SCHEMES)
def test_steps_are_the_schemes(name):
    """The merged loop between `enter` and `leave` is the scheme as it is written, step by step and over several."""
    scheme = sp.SCHEMES[name]
    for top_name, h in (("generic", 0.7), ("figure1", -0.05)):
        top, y0 = states.find(top_name)
        y = letter_by_letter(top, y0, h, scheme, 3).astype(float)
        stepper = prepare(top, y0, h, name)
        ours = stepper.advance(y0, 3)
        assert metrics.scaled_error(top, y0, ours, y) < 100 * EPS
        assert stepper.work.rhs_evals == 3 * min(len(scheme.a), len(scheme.b))


def test_a_step_of_rkmk4_is_the_textbook_s():
    """On 6 × 6 matrices that act on (J, x): h (J, alpha e3) at a state, and its exponentials."""
    for state in ("generic", "figure1", "fast", "slow", "inverted", "weightless", "random000", "random001"):
        top, y0 = states.find(state)
        for h in np.array((0.1, -0.5, 2.0)) * top.scales(y0)[2]:

            def k(y, h=h, alpha=top.alpha):
                return h * np.block([[hat(y[:3]), hat((0, 0, alpha))], [np.zeros((3, 3)), hat(y[:3])]])

            k1 = k(y0)
            k2 = k(expm(k1 / 2) @ y0)
            k3 = k(expm(k2 / 2 - (k1 @ k2 - k2 @ k1) / 8) @ y0)
            k4 = k(expm(k3) @ y0)
            expected = expm((k1 + 2 * k2 + 2 * k3 + k4) / 6 - (k1 @ k4 - k4 @ k1) / 12) @ y0
            y = prepare(top, y0, h, "rkmk4").advance(y0, 1)
            assert metrics.scaled_error(top, y0, y, expected) < 64 * EPS, (state, h)
