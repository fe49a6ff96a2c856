"""λ(h) in mpmath as mathematics, in double-double as compiled, and in plain doubles, against independent integration."""

import math
import random

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench import TOPS, LagrangeTop, compiled, exact, prepare
from lagrange_bench.integrators.paper.two_point import pole_free
from lagrange_bench.integrators.torus import plain_step as ps
from lagrange_bench.integrators.torus import time_step as ts
from tests.reference import flows, largest, real, turned


@pytest.mark.parametrize("name", TOPS)
@pytest.mark.parametrize("h", [1e-6, -2.2, 11.0])
def test_one_step_is_the_flow_to_25_digits(name, h):
    named = TOPS[name]
    h = h / named.top.scales(named.state)[0]
    with mp.workdps(40):
        expected = flows(named.alpha, named.y0, [h], digits=34)[0]
        found = ts.time_step(*ts.torus(named.alpha, named.y0, abs(h)), h)
        lam, m, rotation = (mpc(*map(real, z)) for z in found)
        y = np.array([mpf(v) for v in named.y0])
        if lam.imag > 0:
            y = pole_free(named.top, y, lam, lam.conjugate(), m=(m, m.conjugate()))
        got = turned(rotation.real, rotation.imag, [v.real for v in y])
        error = largest([a - b for a, b in zip(got, expected, strict=True)])
        assert error <= 1e-25 * (1 + largest(expected))


def random_torus(draw):
    """alpha and state over many regimes: generic, near vertical, planar, weak and strong weight."""
    kind = draw.randrange(6)
    alpha = draw.gauss(0, 2)
    J = [draw.gauss(0, 2) for _ in range(3)]
    x = [draw.gauss(0, 1) for _ in range(3)]
    if kind == 1:
        J[:2], x[:2] = [v * 1e-6 for v in J[:2]], [v * 1e-6 for v in x[:2]]
    elif kind == 2:
        J, x = [J[0], 0.0, 0.0], [0.0, *x[1:]]
    elif kind == 3:
        alpha *= 10 ** draw.uniform(-12, 2)
    elif kind == 4:
        alpha = 0.0
    return alpha, np.array(J + x)


def test_never_a_failure_on_any_torus():
    """Every step size in (−3, 3) nutation periods finds its λ, λ stays moderate, and one step equals one jump.

    The step rounds, and passing the saddle amplifies that by up to 1/k' (measured 8.8 ulps of 1 + 1/k'); a jump is in
    double-double throughout, but has its λ from the same place: so every fiftieth is held against theta functions.
    """
    draw = random.Random(7)
    for i in range(500):
        alpha, y = random_torus(draw)
        top = LagrangeTop(alpha)
        rate, size, _ = top.scales(y)
        period = ts.nutation_period(alpha, tuple(y))[0]
        h = draw.uniform(-3, 3) * min(period, 30 / rate)
        stepper = prepare(top, y, h)
        assert np.all(np.isfinite(stepper.constants))
        torus = ts.torus(alpha, tuple(y), abs(h))
        lam, m, rotation = ts.time_step(*torus, h)
        assert math.hypot(lam[0][0], lam[1][0]) * rate / size < 4.57
        assert abs(math.hypot(rotation[0][0], rotation[1][0]) - 1) < 1e-15
        jump = ts.exact_flow(alpha, tuple(y), np.array([h]))[0]
        z1, z2, z3 = (z[0] for z in ts.nutation_roots(alpha, tuple(y)))
        saddle = math.sqrt((z1 - z3) / (z1 - z2)) if z1 > z2 else 1.0  # 1/k'; z1 = z2 = z3: hanging at rest, α = 0
        units = np.repeat((rate, size), 3) * 2.0**-52
        assert np.max(np.abs(stepper.advance(y, 1) - jump) / units) < 12 * (1 + saddle)
        if i % 50 == 0:
            assert np.max(np.abs(exact.solution(top, y, h) - jump) / units) < 12


def test_whole_nutations():
    """At and near a multiple of the nutation period, where λ goes through 0, the step is the rotation about e3."""
    named = TOPS["generic"]
    for turns in (-3.0, 1.0 + 1e-16, 1.0 - 1e-3, 1000.0 + 1e-6):
        h = turns * ts.torus(named.alpha, named.y0, 1e9)[1][0]
        y = prepare(named.top, named.state, h).advance(named.state, 1)
        assert np.max(np.abs(y - exact.solution(named.top, named.state, h))) < 4e-15


@compiled
def plain_step(y, alpha, h):
    return ps.parameter(ps.invariants(y, alpha), y[2], alpha, h)


def wrong_clock(alpha, y, h, found):
    """(T/h − 1, Θ, |m − √Q(λ)|/|m|) of a λ and m that are nearly right, by the derivatives of T and Θ; and |m|²/C1."""
    q = ts.spectral_polynomial(alpha, y)
    lam, m = ts.parameter(q, (abs(h), 0.0))
    off = complex(found[0] - lam[0][0] - lam[0][1], found[1] - lam[1][0] - lam[1][1])
    sign = math.copysign(1.0, h)
    m_off = complex(sign * found[2] - m[0][0] - m[0][1], sign * found[3] - m[1][0] - m[1][1])
    u, v = complex(lam[0][0], lam[1][0]), complex(m[0][0], m[1][0])
    slope = sum(k * q[k][0] * u ** (k - 1) for k in range(1, 5)) / (2 * v)
    turn = 2 * alpha * (u * off / v).imag
    return 2 * (off / v).imag / abs(h), turn, abs(m_off - slope * off) / abs(v), abs(v) ** 2 / q[0][0]


def drawn(n, seed):
    """n random tori of all regimes, with |h| up to half a nutation period, or 15 units."""
    draw = random.Random(seed)
    for i in range(n):
        alpha, y = random_torus(draw)
        if i % 3 == 0:  # units far from 1
            length, rate = 10 ** draw.uniform(-4, 4), 10 ** draw.uniform(-4, 4)
            alpha, y = alpha * rate**2 / length, y * np.repeat((rate, length), 3)
        y = tuple(y.tolist())
        period, unit = ts.nutation_period(alpha, y)[0], 1 / LagrangeTop(alpha).scales(y)[0]
        h = draw.choice((-1, 1)) * draw.uniform(0, 0.49) * min(period, 30 * unit)
        yield alpha, y, h, period


def test_the_clock_on_a_thousand_tori():
    """2e-15 wherever ok; and ok wherever |h| < T_nut/2 and |m|² > C1/4, which all but few tori with |h| ≤ 0.4 T_nut are."""
    clocks, refused, near = [], 0, 0
    for alpha, y, h, period in drawn(1000, 7):
        if period * LagrangeTop(alpha).scales(y)[0] < 100:
            assert not plain_step(y, alpha, 0.501 * period)[4]
            assert not plain_step(y, alpha, 1.3 * period)[4]
        found = plain_step(y, alpha, h)
        clock, turn, off_curve, branch = wrong_clock(alpha, y, h, found)
        assert found[4] == (branch >= ps.LEAST) or abs(branch - ps.LEAST) < 1e-9
        if found[4]:
            clocks.append(abs(clock))
            assert abs(turn) < 5e-14
            assert off_curve < 5e-14
        elif abs(h) <= 0.4 * period:
            refused += 1
        else:
            near += 1
            assert abs(clock) < 1e-15 / branch or branch < 1e-9
    assert np.max(clocks) < 2e-15  # `max` may drop NaN
    assert refused < 80
    assert 0 < near < 80
