"""The exact step of the magnet: order of the Padé steps, the exact step against integration, its sites."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import solve_ivp

from lagrange_bench.integrators import GaudinMagnet
from lagrange_bench.integrators.paper.gaudin_curve import pade_roots
from lagrange_bench.integrators.paper.gaudin_maps import two_point


def magnet(n):
    """A central spin at 0 and others at sites of one sign; multiples of 1/1024."""
    rng = np.random.default_rng(0)
    spins = rng.normal(size=(n, 3))
    return GaudinMagnet((0.0, *-np.cumsum(np.rint(1024 * rng.uniform(0.3, 1, n - 1)) / 1024)), 0.7), spins


def flow(m, spins, c, t=1.0):
    """The flow of Σ c_j H_j by SciPy's DOP853, good to 1e-12 here."""
    found = solve_ivp(
        lambda _, y: m.rhs(y.reshape(spins.shape), c).ravel(), (0, t), spins.ravel(), "DOP853", rtol=1e-13, atol=1e-13
    )
    assert found.success
    return found.y[:, -1].reshape(spins.shape)


@pytest.mark.parametrize("factors", [1, 3])
def test_pade_steps_have_order_twice_their_number(factors):
    m, spins = magnet(6)
    truth, z, errors = flow(m, spins, np.eye(6)[0]), list(map(complex, pade_roots(factors))), []
    for steps in (4, 8, 16):
        lams = np.tile(np.linalg.norm(spins[0]) / steps * np.array(z), steps)
        errors.append(np.max(np.abs(reduce(lambda s, lam: two_point(m, s, lam), lams, spins) - truth)))
    orders = -np.diff(np.log2(errors))
    assert abs(orders[-1] - 2 * factors) < 0.35


def cases():
    """Magnets, spins and times: 1 to 8 spins, no field, spins that are zero or along the field."""
    for n, h in ((1, 0.7), (2, 40.0), (5, -7.0), (8, 5.0)):
        m, spins = magnet(n)
        yield replace(m, site=n - 1), spins, h
    m, spins = magnet(4)
    yield replace(m, alpha=0.0), spins, 3.0
    yield from ((m, spins * np.array([[a], [1], [0], [1]]), 3.0) for a in (0, 1))
    yield m, spins * (0.0, 0.0, 1.0), 3.0


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(i, marks=pytest.mark.slow) for i in (2, 3, 4, 6, 7)), 5])
def test_the_exact_step_is_the_flow(case):
    m, spins, h = list(cases())[case]
    image = m.exact_step(spins, h)
    assert np.max(np.abs(image - flow(m, spins, np.eye(len(m))[m.site], h))) < 2e-11
    assert np.max(np.abs(m.exact_step(image, -h) - spins)) < 1e-13
    assert np.array_equal(m.exact_step(spins, 0.0), spins)


def test_only_differences_of_sites_count():
    m, spins = magnet(3)
    with mp.workdps(50):
        for far in (2.0**40, -(mp.mpf(2) ** 100)):
            moved = replace(m, sites=tuple(a + far for a in m.sites))
            assert np.array_equal(moved.exact_step(spins, 5.0), m.exact_step(spins, 5.0))
    apart, spins = GaudinMagnet((-5e7, 1e8, 1e8 + 0.5, 1e8 + 2), 0.7, site=2), magnet(4)[1]
    image = apart.exact_step(spins, 5.0)
    assert np.max(np.abs(image - flow(apart, spins, np.eye(4)[2], 5.0))) < 1e-11
