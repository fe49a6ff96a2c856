"""λ(h) in plain doubles: its clock against the double-double route, its step against the flow."""

import math
import random

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.torus import plain_step as ps
from lagrange_bench.integrators.torus import time_step as ts
from tests.test_integrators.test_time_step import random_torus


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


@pytest.mark.parametrize("count", [1000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_the_clock_on_thousands_of_tori(count):
    """2e-15 wherever ok; and ok wherever |h| < T_nut/2 and |m|² > C1/4, which all but few tori with |h| ≤ 0.4 T_nut are."""
    clocks, refused, near = [], 0, 0
    for alpha, y, h, period in drawn(count, 7):
        found = ps.plain_step(y, alpha, h)
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
    assert refused < 0.08 * count
    assert 0 < near < 0.08 * count


def test_half_a_period_is_the_limit():
    """ok is False from there on, whatever |m|; here the branch is large."""
    for alpha, y, _, period in drawn(100, 3):
        if period * LagrangeTop(alpha).scales(y)[0] < 100:
            for part in (0.501, 0.75, 0.99, 1.01, 1.3, 2.2, 7.7):
                assert not ps.plain_step(y, alpha, part * period)[4]


def test_too_long_and_no_step_at_all():
    named = TOPS["homoclinic"]  # no period
    assert not ps.plain_step(named.y0, named.alpha, 1e4)[4]
    assert not ps.plain_step(named.y0, named.alpha, math.nan)[4]
    assert not ps.plain_step((1.0, 2.0, 3.0, 0.0, 0.0, 0.0), 1.0, 0.1)[4]
    R, eta, mr, mi, ok = ps.plain_step(TOPS["generic"].y0, TOPS["generic"].alpha, 0.0)
    assert (R, eta, mi, ok) == (0.0, 0.0, 0.0, True)
    assert mr == math.hypot(*TOPS["generic"].y0[3:])


def test_powers_of_two_and_signs_change_no_bit():
    for alpha, y, h, _ in drawn(30, 5):
        R, eta, mr, mi, ok = ps.plain_step(y, alpha, h)
        assert ps.plain_step(y, alpha, -h) == (R, eta, -mr, -mi, ok)
        s = (*(v * 2.0**40 for v in y[:3]), *(v * 2.0**-70 for v in y[3:]))
        scaled = ps.plain_step(s, alpha * 2.0**150, h * 2.0**-40)
        assert scaled == (R * 2.0**-110, eta * 2.0**-110, mr * 2.0**-70, mi * 2.0**-70, ok)


@compiled
def one_step(alpha, y, h):
    R, eta, mr, mi, ok = ps.plain_step(y, alpha, h)
    return ps.move(y, alpha, (R, eta, mr, mi)), ok


@pytest.mark.parametrize("name", [n for n in TOPS if n not in ("homoclinic",)])
@pytest.mark.parametrize("span", [1e-6, -1.0])
def test_named_tops(name, span):
    """Degenerate tori too: regular precession, sleeping, hanging, planar, next to the separatrix."""
    named = TOPS[name]
    rate, size, _ = named.top.scales(named.state)
    got, ok = one_step(named.alpha, named.y0, span / rate)
    assert ok
    expected = ts.flow(named.alpha, named.y0, np.array([span / rate]))[0]
    assert np.max(np.abs(got - expected) / np.repeat((rate, size), 3)) < 2e-15
